# SPDX-License-Identifier: GPL-3.0-or-later
"""A consumer of rtu-centre: what docs/centre.md says of the socket, in Python."""

from __future__ import annotations

import socket
import struct
from collections import Counter, deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import IntFlag
from pathlib import Path
from typing import Self

from openrtu_tools.centre import codes
from openrtu_tools.centre.codes import Ask, Kind, Link, Result, State

MAGIC = b"RTU1"
HEADER = struct.Struct("<4sHHQ")
RECORD = struct.Struct("<BBHIII32s")
REPORTED = struct.Struct("<qqBBBB12s")  # the 32 octets of a record that is no STATION
REQUEST = struct.Struct("<BBHIQI4sBBb5x")
PACKET_MAX = 65536
LIMIT_S = 60.0  # for a hang only


class Flag(IntFlag):
    LAST = codes.LAST
    TEST = codes.TEST
    TAGGED = codes.TAGGED
    TIME_INVALID = codes.TIME_INVALID
    NEGATIVE = codes.NEGATIVE


@dataclass(frozen=True)
class Record:
    kind: Kind
    flags: Flag
    ca: int
    station: int
    connection: int
    ioa: int
    name: str = ""
    received_ns: int = 0
    wall_ns: int = 0
    type: int = 0
    cause: int = 0
    quality: int = 0
    detail: int = 0
    rest: bytes = b""

    @classmethod
    def read(cls, octets: bytes) -> Self:
        kind, flags, ca, station, connection, ioa, tail = RECORD.unpack(octets)
        head = (Kind(kind), Flag(flags), ca, station, connection, ioa)
        if kind == Kind.STATION:
            return cls(*head, name=tail.rstrip(b"\0").decode())
        received, wall, type_, cause, quality, detail, rest = REPORTED.unpack(tail)
        return cls(*head, "", received, wall, type_, cause, quality, detail, rest)

    @property
    def unsigned(self) -> int:
        return int(struct.unpack_from("<I", self.rest)[0])

    @property
    def position(self) -> tuple[int, int, int]:
        latitude, longitude, altitude = struct.unpack("<iii", self.rest)
        return latitude, longitude, altitude

    @property
    def link(self) -> tuple[Link, int, int, int]:
        """State, reason, errno, milliseconds until the next attempt."""
        state, reason, error, retry = struct.unpack("<BB2xII", self.rest)
        return Link(state), reason, error, retry

    @property
    def progress(self) -> tuple[State, Result, int]:
        """State, result, id."""
        state, result, low, high = struct.unpack("<BB2xII", self.rest)
        return State(state), Result(result), low | high << 32


class Consumer:
    """Connected; `stations` are names by number."""

    def __init__(self, path: Path, acknowledges: bool = True) -> None:
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.socket.settimeout(LIMIT_S)
        self.socket.connect(str(path))
        self.acknowledges = acknowledges
        self.last = 0
        self.stations: dict[int, str] = {}
        self.waiting: deque[Record] = deque()  # of a batch, behind what records() has given
        self.counts: Counter[tuple[int, Kind]] = Counter()

    def close(self) -> None:
        self.socket.close()

    def packet(self) -> list[Record]:
        """The next batch; b"" of the socket is an EOFError."""
        octets = self.socket.recv(PACKET_MAX)
        if not octets:
            raise EOFError
        magic, size, count, self.sequence = HEADER.unpack_from(octets)
        assert magic == MAGIC
        assert size == RECORD.size
        assert self.sequence == self.last + 1
        assert len(octets) == HEADER.size + count * size
        self.last += 1
        places = range(HEADER.size, len(octets), size)
        records = [Record.read(octets[place : place + size]) for place in places]
        for record in records:
            if record.kind == Kind.STATION:
                self.stations[record.station] = record.name
            self.counts[record.station, record.kind] += 1
        if self.acknowledges:
            self.acknowledge()
        return records

    def acknowledge(self) -> None:
        self.send(Ask.ACKNOWLEDGE, id=self.last)

    def records(self) -> Iterator[Record]:
        while True:
            while self.waiting:
                yield self.waiting.popleft()
            self.waiting.extend(self.packet())

    def until(self, fits: Callable[[Record], bool]) -> Record:
        return next(record for record in self.records() if fits(record))

    def until_link(self, station: int, state: Link) -> Record:
        return self.until(
            lambda record: record.kind == Kind.LINK and record.station == station and record.link[0] == state
        )

    def until_progress(self, id: int, *states: State) -> Record:
        return self.until(
            lambda record: (
                record.kind == Kind.PROGRESS
                and record.progress[2] == id
                and (not states or record.progress[0] in states)
            )
        )

    def send(
        self,
        kind: Ask,
        station: int = 0,
        id: int = 1,
        ca: int = 1,
        ioa: int = 0,
        type: int = 0,
        value: int | float | bytes = 0,
        flags: int = 0,
        qualifier: int = 0,
        step: int = 0,
    ) -> None:
        if isinstance(value, float):
            value = struct.pack("<f", value)
        elif isinstance(value, int):
            value = (value & 0xFFFFFFFF).to_bytes(4, "little")
        self.socket.send(REQUEST.pack(kind, type, ca, station, id, ioa, value, flags, qualifier, step))
