# SPDX-License-Identifier: GPL-3.0-or-later
"""A controlled station of IEC 60870-5-104 that says what it is told to, and notes what it is asked."""

import contextlib
import datetime
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Self

from lab.gateway import free_port

STARTDT_ACT, STARTDT_CON = 0x07, 0x0B
TESTFR_ACT, TESTFR_CON = 0x43, 0x83
SPONTANEOUS, REQUEST, ACT, ACT_CON, DEACT, DEACT_CON, ACT_TERM, INTERROGATED = 3, 5, 6, 7, 8, 9, 10, 20
NEGATIVE = 0x40
BITS, INTERROGATION, COUNTERS, CLOCK = 51, 100, 101, 103
SELECT = 0x80
LIMIT_S = 60.0  # for a hang only


def time56(at: datetime.datetime, flags: int = 0) -> bytes:
    """CP56Time2a. flags: 0x80 is invalid."""
    ms = at.second * 1000 + at.microsecond // 1000
    return struct.pack(
        "<HBBBBB", ms, at.minute | flags, at.hour, at.day | at.isoweekday() << 5, at.month, at.year - 2000
    )


def asdu(type_id: int, cause: int, ca: int, *objects: tuple[int, bytes]) -> bytes:
    """Objects: address and element."""
    body = b"".join(ioa.to_bytes(3, "little") + element for ioa, element in objects)
    return bytes((type_id, len(objects), cause, 0)) + ca.to_bytes(2, "little") + body


@dataclass(frozen=True)
class Asked:
    """An ASDU in control direction."""

    type: int
    cause: int
    ca: int
    ioa: int
    element: bytes

    @classmethod
    def of(cls, octets: bytes) -> Self:
        return cls(
            octets[0],
            octets[2] & 0x3F,
            int.from_bytes(octets[4:6], "little"),
            int.from_bytes(octets[6:9], "little"),
            octets[9:],
        )

    @property
    def is_command(self) -> bool:
        return 45 <= self.type <= 64

    @property
    def executes(self) -> bool:
        """It is no selection. S/E is in the qualifier of a set-point; a bit string has none."""
        place = {48: 2, 49: 2, 50: 4}.get(self.type, 0)
        is_selection = self.type != BITS and self.element[place] >= SELECT
        return self.is_command and self.cause == ACT and not is_selection


class Outstation:
    """Answers each request as `answer` says: (request) -> ASDUs. None of its sockets outlives it."""

    def __init__(self, port: int = 0, address: str = "127.0.0.1") -> None:
        self.port = port or free_port()
        self.address = address
        self.asked: list[Asked] = []
        self.started = 0
        self.starts = True  # it confirms STARTDT
        self.deaf = False  # it takes octets, and does nothing
        self.interrogated: list[bytes] = []  # what an interrogation is told
        self.answer: Callable[[Asked, bytes], list[bytes]] = self.usual
        self._changed = threading.Condition()
        self._peers: list[socket.socket] = []
        self._active: socket.socket | None = None
        self._sent = self._received = 0
        self._listener: socket.socket | None = None

    def __enter__(self) -> Self:
        self.listen()
        return self

    def __exit__(self, *_: object) -> None:
        self.die()

    def listen(self) -> None:
        listener = socket.create_server((self.address, self.port))
        self._listener = listener
        threading.Thread(target=self._accept, args=(listener,), daemon=True).start()

    def die(self) -> None:
        """As without power: all ends at once."""
        with self._changed:
            listener, self._listener = self._listener, None
            peers, self._peers = self._peers, []
            self._active = None
        for one in (listener, *peers):
            if one:
                with contextlib.suppress(OSError):
                    one.shutdown(socket.SHUT_RDWR)
                one.close()

    @property
    def connections(self) -> int:
        with self._changed:
            return len(self._peers)

    def _accept(self, listener: socket.socket) -> None:
        while True:
            try:
                peer, _ = listener.accept()
            except OSError:
                return
            with self._changed:
                self._peers.append(peer)
                self._changed.notify_all()
            threading.Thread(target=self._serve, args=(peer,), daemon=True).start()

    def _frames(self, peer: socket.socket) -> Iterator[bytes]:
        data = b""
        while True:
            try:
                more = peer.recv(4096)
            except OSError:
                return
            if not more:
                return
            if self.deaf:
                continue
            data += more
            if data[0] != 0x68:  # TLS, of which it knows nothing
                return
            while len(data) >= 2 and len(data) >= 2 + data[1]:
                yield data[: 2 + data[1]]
                data = data[2 + data[1] :]

    def _serve(self, peer: socket.socket) -> None:
        for frame in self._frames(peer):
            if frame[2] & 1 == 0:
                self._take(peer, frame[6:])
            elif frame[2] == STARTDT_ACT and self.starts:
                with self._changed:
                    self._active, self._sent, self._received = peer, 0, 0
                    self.started += 1
                    self._changed.notify_all()
                self.octets(bytes((0x68, 4, STARTDT_CON, 0, 0, 0)), peer)
            elif frame[2] == TESTFR_ACT:
                self.octets(bytes((0x68, 4, TESTFR_CON, 0, 0, 0)), peer)
        with self._changed:
            if peer in self._peers:
                self._peers.remove(peer)
            self._active = None if self._active is peer else self._active

    def _take(self, peer: socket.socket, octets: bytes) -> None:
        asked = Asked.of(octets)
        with self._changed:
            self._received += 1
            self.asked.append(asked)
            self._changed.notify_all()
        self.octets(bytes((0x68, 4, 1, 0)) + struct.pack("<H", self._received << 1 & 0xFFFF), peer)
        for answer in self.answer(asked, octets):
            self.send(answer)

    def usual(self, asked: Asked, octets: bytes) -> list[bytes]:
        """Confirmation, data, termination."""

        def mirrored(cause: int) -> bytes:
            return octets[:2] + bytes((cause,)) + octets[3:]

        if asked.cause == DEACT:
            return [mirrored(DEACT_CON)]
        if asked.type == CLOCK or (asked.is_command and not asked.executes):
            return [mirrored(ACT_CON)]
        data = self.interrogated if asked.type == INTERROGATION else []
        return [mirrored(ACT_CON), *data, mirrored(ACT_TERM)]

    def send(self, octets: bytes) -> None:
        """An ASDU on the connection that is started."""
        with self._changed:
            peer = self._active
            head = struct.pack("<HH", self._sent << 1 & 0xFFFF, self._received << 1 & 0xFFFF)
            self._sent += 1
            if peer:
                self.octets(bytes((0x68, 4 + len(octets))) + head + octets, peer)

    def octets(self, octets: bytes, peer: socket.socket | None = None) -> None:
        """Whatever they are."""
        peer = peer or self._active
        with contextlib.suppress(OSError):
            if peer:
                peer.sendall(octets)

    def say(self, type_id: int, ca: int, *objects: tuple[int, bytes], cause: int = SPONTANEOUS) -> None:
        self.send(asdu(type_id, cause, ca, *objects))

    def wait(self, condition: Callable[[], bool], what: str) -> None:
        until = time.monotonic() + LIMIT_S
        with self._changed:
            while not condition():
                assert time.monotonic() < until, f"{what}; asked: {self.asked}"
                self._changed.wait(0.1)

    def executions(self) -> list[Asked]:
        """What it was told to do."""
        with self._changed:
            return [asked for asked in self.asked if asked.executes]
