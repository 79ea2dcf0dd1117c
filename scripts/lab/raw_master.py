# SPDX-License-Identifier: GPL-3.0-or-later
"""A controlling station on a bare socket: no threads, every octet its own, objects dated as they arrive."""

from __future__ import annotations

import contextlib
import datetime
import itertools
import select
import socket
import ssl
import time
from collections import deque
from dataclasses import dataclass, field
from types import TracebackType
from typing import Self

START = 0x68
STARTDT_ACT, STARTDT_CON = 0x07, 0x0B
TESTFR_ACT, TESTFR_CON = 0x43, 0x83
S_FORMAT = 0x01
W = 8  # I frames received before they are acknowledged, at most (9.6)

C_IC_NA_1 = 100
SPONTANEOUS, ACTIVATION, ACTIVATION_CON, ACTIVATION_TERM, INTROGEN = 3, 6, 7, 10, 20
NEGATIVE = 0x40
QOI_STATION = 20

# Octets of an element, its time tag included, for the types that single points and scaled values come in.
ELEMENT_SIZE = {1: 1, 11: 3, 30: 8, 35: 10}
SINGLE_POINTS = {1, 30}
TIME_TAG_SIZE = 7  # CP56Time2a, at the end of the element
TIME_TAGGED = {30, 35}
INVALID = 0x80  # IV of a quality descriptor

ANSWER_TIMEOUT_S = 30.0


class StationError(Exception):
    """The controlled station did not answer as the protocol asks."""


@dataclass(frozen=True)
class Object:
    """One information object as it arrived."""

    type: int
    cause: int  # with the bits of P/N and test
    ca: int
    ioa: int
    value: int
    quality: int  # the quality descriptor's bits; 0: good
    arrived_ns: int  # time.monotonic_ns() when its bytes had been read
    recorded_at: datetime.datetime | None = None  # its time tag, taken as UTC


@dataclass
class Interrogation:
    """A station interrogation, from the moment it was sent to its termination."""

    begun_ns: int
    ended_ns: int = 0
    objects: list[Object] = field(default_factory=list)

    @property
    def seconds(self) -> float:
        return (self.ended_ns - self.begun_ns) / 1e9


@dataclass(frozen=True)
class Asdu:
    """The head of an ASDU, and what follows it."""

    type: int
    count: int
    sequence: bool
    cause: int
    originator: int
    ca: int
    body: bytes
    arrived_ns: int

    @classmethod
    def parse(cls, asdu: bytes, arrived_ns: int) -> Self:
        if len(asdu) < 6:
            raise StationError(f"an ASDU of {len(asdu)} octets")
        number, ca = asdu[1], int.from_bytes(asdu[4:6], "little")
        return cls(asdu[0], number & 0x7F, bool(number & 0x80), asdu[2], asdu[3], ca, asdu[6:], arrived_ns)

    def objects(self) -> list[Object]:
        """Its information objects; none for a type that is not of ELEMENT_SIZE."""
        size = ELEMENT_SIZE.get(self.type)
        if size is None:
            return []
        expected = 3 + self.count * size if self.sequence else self.count * (3 + size)
        if len(self.body) != expected:
            raise StationError(f"type {self.type} with {self.count} objects in {len(self.body)} octets")
        return [self._object(index, size) for index in range(self.count)]

    def _object(self, index: int, size: int) -> Object:
        """Of a sequence, only the first object has its address in front (101, 7.2.2.1)."""
        begin = 0 if self.sequence else index * (3 + size)
        ioa = int.from_bytes(self.body[begin : begin + 3], "little")
        if self.sequence:
            ioa, begin = ioa + index, index * size
        element = self.body[begin + 3 : begin + 3 + size]
        value, quality = _decode(self.type, element)
        recorded_at = _time_tag(element[-TIME_TAG_SIZE:]) if self.type in TIME_TAGGED else None
        return Object(self.type, self.cause, self.ca, ioa, value, quality, self.arrived_ns, recorded_at)


def _decode(type_id: int, element: bytes) -> tuple[int, int]:
    if type_id in SINGLE_POINTS:
        return element[0] & 0x01, element[0] & 0xF0
    return int.from_bytes(element[:2], "little", signed=True), element[2]


def _time_tag(octets: bytes) -> datetime.datetime:
    """CP56Time2a (101, 7.2.6.18): milliseconds, minute, hour, day, month, year of the century."""
    milliseconds = int.from_bytes(octets[:2], "little")
    minute, hour, day, month, year = (
        octet & mask for octet, mask in zip(octets[2:], (0x3F, 0x1F, 0x1F, 0x0F, 0x7F), strict=True)
    )
    whole = datetime.datetime(2000 + year, month, day, hour, minute, tzinfo=datetime.UTC)
    return whole + datetime.timedelta(milliseconds=milliseconds)


_sources = itertools.count()


def new_source(address: str) -> str:
    """
    An address to connect from. The station keeps events for each address that has connected. Where there
    are many, on the loopback, each controlling station has one of its own, and begins with no events of
    another one.
    """
    if not address.startswith("127."):
        return ""
    number = next(_sources) % (200 * 250)
    return f"127.0.{1 + number // 250}.{1 + number % 250}"


class RawMaster:
    """One connection with started data transfer."""

    def __init__(
        self,
        address: str,
        port: int,
        source: str | None = None,
        tls: ssl.SSLContext | None = None,
    ) -> None:
        self._address = (address, port)
        self._source = (new_source(address) if source is None else source, 0)
        self._tls = tls
        self._socket: socket.socket | None = None
        self._buffer = bytearray()
        self._asdus: deque[Asdu] = deque()
        self._sent = self._received = self._unacknowledged = 0
        self._started = False

    def __enter__(self) -> Self:
        self._socket = socket.create_connection(self._address, ANSWER_TIMEOUT_S, self._source)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        if self._tls:
            self._socket = self._tls.wrap_socket(self._socket)
        self._send_u(STARTDT_ACT)
        deadline = time.monotonic() + ANSWER_TIMEOUT_S
        while not self._started:
            self._read(deadline, "STARTDT con")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._connected.close()

    def interrogate(self, ca: int) -> Interrogation:
        """A station interrogation. What arrives meanwhile for other causes is dropped."""
        deadline = time.monotonic() + ANSWER_TIMEOUT_S
        self._asdus.clear()
        interrogation = Interrogation(time.monotonic_ns())
        self._send_i(bytes((C_IC_NA_1, 1, ACTIVATION, 0, *ca.to_bytes(2, "little"), 0, 0, 0, QOI_STATION)))
        while not interrogation.ended_ns:
            asdu = self._next_asdu(deadline, f"termination of the interrogation of CA {ca}")
            if asdu.type == C_IC_NA_1 and asdu.cause & NEGATIVE:
                raise StationError(f"CA {ca} refused the interrogation")
            if asdu.type == C_IC_NA_1 and asdu.cause == ACTIVATION_TERM:
                interrogation.ended_ns = asdu.arrived_ns
            elif asdu.cause == INTROGEN:
                interrogation.objects += asdu.objects()
        self._acknowledge()
        return interrogation

    def request(
        self, kind: int, ca: int, ioa: int, element: bytes, cause: int = ACTIVATION, originator: int = 0
    ) -> None:
        """Sends one information object. What arrived before and was not asked for is dropped."""
        self._asdus.clear()
        head = bytes((kind, 1, cause, originator)) + ca.to_bytes(2, "little")
        self._send_i(head + ioa.to_bytes(3, "little") + element)

    def answer(self, kind: int, timeout_s: float = ANSWER_TIMEOUT_S) -> Asdu:
        """The next ASDU of that type, acknowledged. Raises StationError when none comes in time."""
        return self.answer_of({kind}, timeout_s)

    def answer_of(self, kinds: set[int], timeout_s: float = ANSWER_TIMEOUT_S) -> Asdu:
        """The next ASDU of one of these types, likewise."""
        deadline = time.monotonic() + timeout_s
        while True:
            asdu = self._next_asdu(deadline, f"answer of type {', '.join(map(str, sorted(kinds)))}")
            self._acknowledge()
            if asdu.type in kinds:
                return asdu

    def next_asdu(self, deadline: float) -> Asdu:
        """Whatever comes next, acknowledged. deadline: time.monotonic()."""
        asdu = self._next_asdu(deadline, "ASDU")
        self._acknowledge()
        return asdu

    def spontaneous(self, deadline: float) -> list[Object]:
        """The objects of the next spontaneous ASDU. deadline: time.monotonic()."""
        while True:
            asdu = self._next_asdu(deadline, "spontaneous object")
            self._acknowledge()
            if asdu.cause == SPONTANEOUS:
                return asdu.objects()

    # ---- inside ------------------------------------------------------------------------------

    @property
    def _connected(self) -> socket.socket:
        if self._socket is None:
            raise StationError("not connected: use `with RawMaster(…) as master`")
        return self._socket

    def _next_asdu(self, deadline: float, what: str) -> Asdu:
        while not self._asdus:
            self._read(deadline, what)
        return self._asdus.popleft()

    def _read(self, deadline: float, what: str) -> None:
        """Takes what the socket has, at least a byte."""
        arrived = self._receive(deadline)
        arrived_ns = time.monotonic_ns()
        if arrived is None:
            raise StationError(f"no {what} in time")
        if not arrived:
            raise StationError(f"the station closed the connection before: {what}")
        self._buffer += arrived
        while len(self._buffer) >= 2 and len(self._buffer) >= 2 + self._buffer[1]:
            apdu = bytes(self._buffer[: 2 + self._buffer[1]])
            del self._buffer[: len(apdu)]
            self._take(apdu, arrived_ns)

    def _receive(self, deadline: float) -> bytes | None:
        """None: nothing came in time."""
        connected = self._connected
        while self._is_ready(deadline):
            if not isinstance(connected, ssl.SSLSocket):
                return connected.recv(65536)
            with contextlib.suppress(ssl.SSLWantReadError):  # a record of TLS may hold nothing for us
                connected.setblocking(False)
                return connected.recv(65536)
        return None

    def _is_ready(self, deadline: float) -> bool:
        if isinstance(self._connected, ssl.SSLSocket) and self._connected.pending():
            return True
        return bool(select.select([self._connected], [], [], max(0.0, deadline - time.monotonic()))[0])

    def _take(self, apdu: bytes, arrived_ns: int) -> None:
        if apdu[0] != START or len(apdu) < 6:
            raise StationError(f"not an APDU: {apdu.hex(' ')}")
        if not apdu[2] & 0x01:
            self._take_i(apdu, arrived_ns)
        elif apdu[2] == STARTDT_CON:
            self._started = True
        elif apdu[2] == TESTFR_ACT:
            self._send_u(TESTFR_CON)

    def _take_i(self, apdu: bytes, arrived_ns: int) -> None:
        number = int.from_bytes(apdu[2:4], "little") >> 1
        if number != self._received:
            raise StationError(f"I frame {number} instead of {self._received}")
        self._received = (self._received + 1) & 0x7FFF
        self._unacknowledged += 1
        if self._unacknowledged >= W:
            self._acknowledge()
        self._asdus.append(Asdu.parse(apdu[6:], arrived_ns))

    def _acknowledge(self) -> None:
        if self._unacknowledged:
            self._unacknowledged = 0
            self._send(bytes((S_FORMAT, 0, *self._receive_number())))

    def _send_i(self, asdu: bytes) -> None:
        number = (self._sent << 1).to_bytes(2, "little")
        self._sent = (self._sent + 1) & 0x7FFF
        self._unacknowledged = 0
        self._send(bytes((*number, *self._receive_number())) + asdu)

    def _send_u(self, function: int) -> None:
        self._send(bytes((function, 0, 0, 0)))

    def _send(self, apdu: bytes) -> None:
        if self._tls:
            self._connected.settimeout(ANSWER_TIMEOUT_S)
        self._connected.sendall(bytes((START, len(apdu))) + apdu)

    def _receive_number(self) -> bytes:
        return (self._received << 1).to_bytes(2, "little")
