# SPDX-License-Identifier: GPL-3.0-or-later
"""The journal's file: package/openrtu/src/journal/record.h has its format."""

import struct
from collections.abc import Iterator

MAGIC = b"ORJ1"
HEAD_SIZE, EVENT_SIZE = 16, 28
RETAINED = 0x80  # an event's cause, from which on it is no event but something else that is kept
ENTRY = 0x83  # the same: a change for buffered reports


def records(octets: bytes) -> Iterator[bytes]:
    """Those that are whole; none is looked for behind one that is not."""
    while octets[: len(MAGIC)] == MAGIC:
        size = HEAD_SIZE + struct.unpack_from("<I", octets, 4)[0]
        if len(octets) < size:
            return
        yield octets[:size]
        octets = octets[size:]


def events(record: bytes) -> Iterator[bytes]:
    """At its end."""
    count = struct.unpack_from("<I", record, 20)[0]
    for at in range(len(record) - EVENT_SIZE * count, len(record), EVENT_SIZE):
        yield record[at : at + EVENT_SIZE]


def number_of(event: bytes) -> int:
    number: int = struct.unpack_from("<I", event, 8)[0]
    return number


def cause_of(event: bytes) -> int:
    return event[18]


def told_by(event: bytes) -> bytes:
    """What it tells, without its place in the map."""
    return event[:2] + event[3:8] + event[12:]
