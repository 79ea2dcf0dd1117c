# SPDX-License-Identifier: GPL-3.0-or-later
"""What is said on rtu-centre's socket: docs/centre.md, "The consumer"."""

from __future__ import annotations

import struct
from dataclasses import dataclass

from openrtu_tools.centre.codes import (
    SELECT,
    TAGGED,
    TIME_INVALID,
    Ask,
    Cause,
    Content,
    Kind,
    State,
)
from openrtu_tools.centre.errors import CentreError
from openrtu_tools.codes import TYPES

MAGIC = b"RTU1"
HEADER = struct.Struct("<4sHHQ")
RECORD = struct.Struct("<BBHIII32s")
SAID = struct.Struct("<qqBBBB12s")  # the 32 octets of a record that names no station
REQUEST = struct.Struct("<BBHIQI4sBBb5x")
PACKET_MAX = HEADER.size + 1024 * RECORD.size

EVENTS = (Cause.SPONTANEOUS, Cause.RETURN_REMOTE, Cause.RETURN_LOCAL)
UNKNOWN_ALTITUDE = -(2**23)  # dm, of type 201
ENDED = frozenset(
    {State.REFUSED_SELECTION, State.INTERRUPTED_SELECTION, State.REFUSED_COMMAND, State.EXECUTED_COMMAND}
)
SIGNED = {Content.STEP, Content.NORMALIZED, Content.SCALED, Content.TOTAL}


@dataclass(frozen=True, slots=True)
class Record:
    kind: int
    flags: int
    ca: int
    station: int
    connection: int
    ioa: int
    name: str = ""
    received_ns: int = 0
    tag_ns: int = 0
    type: int = 0
    cause: int = 0
    quality: int = 0
    detail: int = 0
    rest: bytes = b""
    octets: bytes = b""  # of Kind.OCTETS

    @property
    def tagged(self) -> bool:
        return self.flags & (TAGGED | TIME_INVALID) == TAGGED

    @property
    def is_event(self) -> bool:
        return self.cause in EVENTS

    @property
    def content(self) -> Content:
        return Content.POSITION if self.kind == Kind.POSITION else Content(self.rest[6])

    @property
    def value(self) -> float:
        content = self.content
        form = "<f" if content == Content.FLOAT else "<i" if content in SIGNED else "<I"
        return float(struct.unpack_from(form, self.rest)[0])

    @property
    def position(self) -> tuple[int, int, int]:
        """Latitude and longitude in 1e-7 degree, altitude in dm or UNKNOWN_ALTITUDE."""
        latitude, longitude, altitude = struct.unpack("<iii", self.rest)
        return latitude, longitude, altitude

    @property
    def link(self) -> tuple[int, int, int, int]:
        """State, reason, errno, milliseconds until the next attempt."""
        state, reason, error, retry = struct.unpack("<BB2xII", self.rest)
        return state, reason, error, retry

    @property
    def progress(self) -> tuple[int, int, int]:
        """State, result, id."""
        state, result, id_ = struct.unpack("<BB2xQ", self.rest)
        return state, result, id_


def read_batch(octets: bytes) -> tuple[int, list[Record]]:
    """The sequence of a batch and its records."""
    if len(octets) < HEADER.size:
        raise CentreError("rtu-centre sent a packet that is no batch: are both of one version?")
    magic, size, count, sequence = HEADER.unpack_from(octets)
    if magic != MAGIC or size != RECORD.size or len(octets) != HEADER.size + count * size:
        raise CentreError("rtu-centre sent a batch of another form: are both of one version?")
    return sequence, [_record(*fields) for fields in RECORD.iter_unpack(octets[HEADER.size :])]


def _record(kind: int, flags: int, ca: int, station: int, connection: int, ioa: int, body: bytes) -> Record:
    if kind == Kind.STATION:
        name = body.rstrip(b"\0").decode(errors="replace")
        return Record(kind, flags, ca, station, connection, ioa, name)
    if kind == Kind.OCTETS:
        seen_ns = int.from_bytes(body[:8], "little")
        octets = body[8 : 8 + ca]
        return Record(kind, flags, 0, station, connection, 0, received_ns=seen_ns, octets=octets)
    return Record(kind, flags, ca, station, connection, ioa, "", *SAID.unpack(body))


def acknowledgement(sequence: int) -> bytes:
    return REQUEST.pack(Ask.ACKNOWLEDGE, 0, 0, 0, sequence, 0, bytes(4), 0, 0, 0)


def request(kind: Ask, station: int, ca: int, id_: int, qualifier: int = 0) -> bytes:
    """All but a command: it needs no value."""
    return REQUEST.pack(kind, 0, ca, station, id_, 0, bytes(4), 0, qualifier, 0)


def trace(station: int, id_: int, on: bool) -> bytes:
    return REQUEST.pack(Ask.TRACE, 0, 0, station, id_, 0, int(on).to_bytes(4, "little"), 0, 0, 0)


def command(
    station: int, ca: int, ioa: int, id_: int, type_: str, value: float, select: bool, qualifier: int = 0
) -> bytes:
    """Raises CentreError when the value is none of the type."""
    step = 0
    if type_ == "float":
        octets = struct.pack("<f", value)
    else:
        number = int(value)
        if number != value or not -(2**31) <= number < 2**32:
            raise CentreError(f"{value} is not a value of the type {type_}")
        octets = (number & 0xFFFFFFFF).to_bytes(4, "little")
    if type_ == "step":
        step = int(value)
    return REQUEST.pack(
        Ask.COMMAND,
        TYPES["bitstring" if type_ == "bits" else type_],
        ca,
        station,
        id_,
        ioa,
        octets,
        SELECT if select else 0,
        qualifier,
        step,
    )
