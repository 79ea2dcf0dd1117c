# SPDX-License-Identifier: GPL-3.0-or-later
"""Simulated controlled stations of IEC 60870-5-104 that report a position (type 201) and objects of any type.

What a station has to say waits in its queue until it is acknowledged; else it is sent again on the next
connection.
"""

from __future__ import annotations

import asyncio
import contextlib
import datetime
import struct
from collections import deque
from dataclasses import dataclass, field

START = 0x68
STARTDT_ACT, STARTDT_CON, STOPDT_ACT, STOPDT_CON, TESTFR_ACT, TESTFR_CON = 0x07, 0x0B, 0x13, 0x23, 0x43, 0x83
K = 12
M_SP_NA_1, M_SP_TB_1, M_ST_NA_1, M_ST_TB_1, M_ME_NC_1, M_ME_TF_1, POSITION = 1, 30, 5, 32, 13, 36, 201
C_SC_NA_1, C_RC_NA_1, C_IC_NA_1, C_CS_NA_1, C_RD_NA_1 = 45, 47, 100, 103, 102
SPONTANEOUS, REQUEST, ACT, ACT_CON, DEACT, DEACT_CON, ACT_TERM, INTERROGATED = 3, 5, 6, 7, 8, 9, 10, 20
UNKNOWN_TYPE, NEGATIVE, SELECT = 44, 0x40, 0x80
HIGHER = 2  # RCS of a regulating step; 1 lower
UNTAGGED = {M_SP_TB_1: M_SP_NA_1, M_ST_TB_1: M_ST_NA_1, M_ME_TF_1: M_ME_NC_1, POSITION: POSITION}
INVALID, OVERFLOW = 0x80, 1  # of a quality descriptor
NO_ALTITUDE = (-(2**23)).to_bytes(3, "little", signed=True)
TIME_OCTETS = 7
QUEUE_MOST = 100_000


def time_tag(at_ms: int) -> bytes:
    """CP56Time2a, UTC."""
    at = datetime.datetime.fromtimestamp(at_ms / 1000, datetime.UTC)
    ms = at.second * 1000 + at_ms % 1000
    return struct.pack(
        "<HBBBBB", ms, at.minute, at.hour, at.day | at.isoweekday() << 5, at.month, at.year % 100
    )


def position(at_ms: int, latitude: float, longitude: float, altitude: float = 0, fix: int = 1) -> bytes:
    """The element of type 201: docs/positioning.md. Without a fix it has no place and no altitude."""
    if not fix:
        return struct.pack("<ii", 0, 0) + NO_ALTITUDE + bytes([0, INVALID | OVERFLOW]) + time_tag(at_ms)
    place = struct.pack("<ii", round(latitude * 1e7), round(longitude * 1e7))
    height = round(altitude * 10).to_bytes(3, "little", signed=True)
    return place + height + bytes([fix | 9 << 4, 0]) + time_tag(at_ms)


def single(at_ms: int, on: bool, quality: int = 0) -> bytes:
    return bytes([on | quality]) + time_tag(at_ms)


def stepped(at_ms: int, position: int, quality: int = 0) -> bytes:
    """VTI: of a tap changer, from -64 to 63."""
    return bytes([position & 0x7F, quality]) + time_tag(at_ms)


def measured(at_ms: int, value: float, quality: int = 0) -> bytes:
    return struct.pack("<fB", value, quality) + time_tag(at_ms)


@dataclass
class Station:
    """One that listens; `port` is known once it does. `manner` is how it takes commands."""

    ca: int = 1
    manner: str = "done"  # or refuse, silent, hang up: at the execution
    port: int = 0
    queue: deque[bytes] = field(default_factory=deque)  # ASDUs, the oldest first
    objects: dict[int, tuple[int, bytes]] = field(
        default_factory=dict
    )  # by IOA: type and element, with its tag
    commanded: list[tuple[int, int]] = field(default_factory=list)
    connections: int = 0
    interrogations: int = 0
    tap: int = 0  # where its tap changer stands
    _server: asyncio.Server | None = None
    _session: Session | None = None

    async def listen(self, port: int = 0) -> None:
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", port or self.port)
        self.port = self._server.sockets[0].getsockname()[1]

    @property
    def is_connected(self) -> bool:
        return self._session is not None

    async def stop(self) -> None:
        """Hangs up, and listens no more."""
        if self._server:
            self._server.close()
        if self._session:
            self._session.writer.close()

    def say(self, ioa: int, type_: int, element: bytes) -> None:
        """An event: an object with time tag, now or when there is a connection."""
        self.objects[ioa] = (type_, element)
        self.queue.append(self.asdu(type_, SPONTANEOUS, ioa, element))
        if len(self.queue) > QUEUE_MOST:
            self.queue.popleft()
        if self._session:
            self._session.send_events()

    def asdu(self, type_: int, cause: int, ioa: int, element: bytes) -> bytes:
        return struct.pack("<BBBBHHB", type_, 1, cause, 0, self.ca, ioa & 0xFFFF, ioa >> 16) + element

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        session = Session(self, writer)
        try:
            with contextlib.suppress(OSError, asyncio.IncompleteReadError):
                while True:
                    start, size = await reader.readexactly(2)
                    frame = await reader.readexactly(size)
                    if start != START or size < 4:
                        break
                    session.take(frame)
        finally:
            writer.close()
            session.give_back()
            if self._session is session:
                self._session = None

    def opened(self, session: Session) -> None:
        if self._session and self._session is not session:
            self._session.writer.close()
            self._session.give_back()
        self._session = session
        self.connections += 1


@dataclass
class Session:
    """A connection: numbers, and what is under way."""

    station: Station
    writer: asyncio.StreamWriter
    started: bool = False
    sent: int = 0
    received: int = 0
    under_way: deque[tuple[bytes, bool]] = field(default_factory=deque)  # and whether it came from the queue

    def give_back(self) -> None:
        """The events that were not acknowledged, at their place."""
        self.started = False
        events = [asdu for asdu, is_event in self.under_way if is_event]
        self.station.queue.extendleft(reversed(events))
        self.under_way.clear()

    def take(self, frame: bytes) -> None:
        control = frame[0]
        if control & 1 == 0:
            self.received = (self.received + 1) & 0x7FFF
            self.acknowledged(struct.unpack_from("<H", frame, 2)[0] >> 1)
            self.answer(frame[4:])
        elif control & 3 == 1:
            self.acknowledged(struct.unpack_from("<H", frame, 2)[0] >> 1)
        elif control == STARTDT_ACT:
            self.started = True
            self.station.opened(self)
            self.send_control(STARTDT_CON)
        elif control == STOPDT_ACT:
            self.started = False
            self.send_control(STOPDT_CON)
        elif control == TESTFR_ACT:
            self.send_control(TESTFR_CON)
        self.send_events()

    def acknowledged(self, number: int) -> None:
        while self.under_way and (self.sent - len(self.under_way)) & 0x7FFF != number:
            self.under_way.popleft()

    def send_control(self, control: int) -> None:
        self.writer.write(bytes([START, 4, control, 0, 0, 0]))

    def send(self, asdu: bytes, is_event: bool = False) -> None:
        self.under_way.append((asdu, is_event))
        numbers = struct.pack("<HH", self.sent << 1, self.received << 1)
        self.sent = (self.sent + 1) & 0x7FFF
        self.writer.write(bytes([START, len(asdu) + 4]) + numbers + asdu)

    def send_events(self) -> None:
        while self.started and self.station.queue and len(self.under_way) < K:
            self.send(self.station.queue.popleft(), True)

    def mirror(self, asdu: bytes, cause: int) -> None:
        self.send(asdu[:2] + bytes([cause]) + asdu[3:])

    def answer(self, asdu: bytes) -> None:
        type_, _, cause = asdu[:3]
        ioa = int.from_bytes(asdu[6:9], "little")
        if type_ == C_IC_NA_1:
            self.station.interrogations += 1
            self.mirror(asdu, ACT_CON)
            for ioa, (of_type, element) in self.station.objects.items():
                whole = element if of_type == POSITION else element[:-TIME_OCTETS]
                self.send(self.station.asdu(UNTAGGED[of_type], INTERROGATED, ioa, whole))
            self.mirror(asdu, ACT_TERM)
        elif type_ == C_CS_NA_1:
            self.mirror(asdu, ACT_CON)
        elif type_ == C_RD_NA_1 and ioa in self.station.objects:
            of_type, element = self.station.objects[ioa]
            whole = element if of_type == POSITION else element[:-TIME_OCTETS]
            self.send(self.station.asdu(UNTAGGED[of_type], REQUEST, ioa, whole))
        elif type_ in (C_SC_NA_1, C_RC_NA_1):
            self.command(asdu, cause & 0x3F, ioa, asdu[9])
        else:
            self.mirror(asdu, UNKNOWN_TYPE | NEGATIVE)

    def command(self, asdu: bytes, cause: int, ioa: int, qualifier: int) -> None:
        manner = self.station.manner
        if cause == DEACT:
            self.mirror(asdu, DEACT_CON)
        elif qualifier & SELECT:
            self.mirror(asdu, ACT_CON | (NEGATIVE if manner == "refuse selection" else 0))
        elif manner == "refuse":
            self.mirror(asdu, ACT_CON | NEGATIVE)
        elif manner == "hang up":
            self.writer.close()
        elif manner != "silent":
            at_ms = int(datetime.datetime.now().timestamp() * 1000)
            if asdu[0] == C_RC_NA_1:
                step = 1 if qualifier & 3 == HIGHER else -1
                self.station.tap += step
                self.station.commanded.append((ioa, step))
                returned = M_ST_TB_1, stepped(at_ms, self.station.tap)
            else:
                self.station.commanded.append((ioa, qualifier & 1))
                returned = M_SP_TB_1, single(at_ms, bool(qualifier & 1))
            self.mirror(asdu, ACT_CON)
            self.station.say(ioa, *returned)
            self.mirror(asdu, ACT_TERM)
