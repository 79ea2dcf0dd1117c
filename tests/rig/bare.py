# SPDX-License-Identifier: GPL-3.0-or-later
"""A controlling station that does nothing by itself: each of its frames is the test's."""

import socket
import struct
import time
from types import TracebackType
from typing import Self

import pytest

from lab.raw_master import new_source

SEQUENCE_MODULO = 32768
ANSWER_TIMEOUT_S = 30.0

STARTDT, STARTDT_CON = bytes.fromhex("680407000000"), bytes.fromhex("68040b000000")
STOPDT, STOPDT_CON = bytes.fromhex("680413000000"), bytes.fromhex("680423000000")
TESTFR, TESTFR_CON = bytes.fromhex("680443000000"), bytes.fromhex("680483000000")


def i_frame(sent: int, received: int, asdu: bytes) -> bytes:
    numbers = struct.pack("<HH", sent % SEQUENCE_MODULO << 1, received % SEQUENCE_MODULO << 1)
    return bytes([0x68, 4 + len(asdu)]) + numbers + asdu


def s_frame(received: int) -> bytes:
    return bytes([0x68, 4, 1, 0]) + struct.pack("<H", received % SEQUENCE_MODULO << 1)


def is_i(frame: bytes) -> bool:
    return not frame[2] & 1


class Bare:
    """One connection, stopped. `sent` and `taken` count I frames, without end."""

    def __init__(self, address: tuple[str, int], source: str | None = None) -> None:
        origin = (new_source(address[0]) if source is None else source, 0)
        self.socket = socket.create_connection(address, ANSWER_TIMEOUT_S, origin)
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.sent = self.taken = 0
        self._waiting = b""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.socket.close()

    def send(self, octets: bytes) -> None:
        self.socket.sendall(octets)

    def start(self) -> Self:
        self.send(STARTDT)
        assert self.frame() == STARTDT_CON
        return self

    def ask(self, *asdus: bytes) -> None:
        """An I frame each, in one piece, which acknowledge what was taken."""
        self.send(b"".join(i_frame(self.sent + n, self.taken, asdu) for n, asdu in enumerate(asdus)))
        self.sent += len(asdus)

    def acknowledge(self) -> None:
        self.send(s_frame(self.taken))

    def frame(self, timeout_s: float = ANSWER_TIMEOUT_S) -> bytes:
        """The station's next frame, its sequence number checked. TimeoutError: none came."""
        self.socket.settimeout(timeout_s)
        while len(self._waiting) < 2 or len(self._waiting) < 2 + self._waiting[1]:
            octets = self.socket.recv(65536)
            if not octets:
                pytest.fail("the station closed the connection")
            self._waiting += octets
        size = 2 + self._waiting[1]
        frame, self._waiting = self._waiting[:size], self._waiting[size:]
        if is_i(frame):
            assert frame[2:4] == struct.pack("<H", self.taken % SEQUENCE_MODULO << 1)
            self.taken += 1
        return frame

    def asdu(self) -> bytes:
        """The next ASDU; S frames before it are passed over."""
        while not is_i(frame := self.frame()):
            assert frame[2] == 1
        return frame[6:]

    def asdus_until(self, last: bytes) -> list[bytes]:
        """Acknowledged as they come, up to and with the one that begins so."""
        taken: list[bytes] = []
        while not taken or not taken[-1].startswith(last):
            taken.append(self.asdu())
            self.acknowledge()
        return taken

    def nothing_for(self, seconds: float) -> None:
        """The station sends nothing."""
        with pytest.raises(TimeoutError):
            pytest.fail(f"the station sent {self.frame(seconds).hex(' ')}")

    def closed(self) -> float:
        """Reads on until the station closes; returns when it did, by time.monotonic()."""
        self.socket.settimeout(ANSWER_TIMEOUT_S)
        try:
            while self.socket.recv(65536):
                pass
        except ConnectionResetError:
            pass
        return time.monotonic()
