# SPDX-License-Identifier: GPL-3.0-or-later
"""An NTP server (RFC 5905, figure 8) whose time, leap indicator and silence a test decides."""

from __future__ import annotations

import math
import socket
import struct
import threading
import time
from datetime import datetime
from types import TracebackType
from typing import Self

SINCE_1900 = 2_208_988_800  # seconds from NTP's epoch to 1970
SERVER, CLIENT = 4, 3
LEAP_NONE, LEAP_INSERTED = 0, 1
PACKET = struct.Struct("!BBbbII4sQQQQ")


class NtpServer:
    """Answers at a UDP port of 127.0.0.1, from `with` to its end, unless it is silent."""

    def __init__(self, silent: bool = False) -> None:
        self.silent = silent
        self.leap_s = math.inf  # when its leap second begins, by its own time
        self.ahead_s = 0.0  # of this machine's clock
        self.asked = 0
        self._ends = False
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self.port: int = self._socket.getsockname()[1]
        self._thread = threading.Thread(target=self._serve, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ends = True
        self._socket.sendto(b"", self._socket.getsockname())  # it waits for a request
        self._thread.join()
        self._socket.close()

    def now(self) -> float:
        """The time that it tells, in seconds since 1970."""
        told = time.time() + self.ahead_s
        return told if told < self.leap_s else told - 1

    def tell(self, then: datetime, leap: datetime) -> None:
        """From here on it tells the time that begins with this one; a leap second is inserted at `leap`."""
        self.leap_s = leap.timestamp()
        self.ahead_s = then.timestamp() - time.time()

    def _serve(self) -> None:
        while not self._ends:
            request, peer = self._socket.recvfrom(1024)
            arrived = self.now()
            if len(request) < PACKET.size or request[0] & 7 != CLIENT:
                continue
            self.asked += 1
            if not self.silent:
                self._socket.sendto(self._answer(request, arrived), peer)

    def _answer(self, request: bytes, arrived: float) -> bytes:
        version, poll, originated = request[0] & 0o70, request[2], PACKET.unpack_from(request)[-1]
        leap = LEAP_INSERTED if arrived < self.leap_s < math.inf else LEAP_NONE
        first = leap << 6 | version | SERVER
        return PACKET.pack(
            first,
            1,
            poll,
            -20,
            0,
            0,
            b"TEST",
            _stamp(arrived),
            originated,
            _stamp(arrived),
            _stamp(self.now()),
        )


def _stamp(seconds: float) -> int:
    return int((seconds + SINCE_1900) * 2**32) & (2**64 - 1)
