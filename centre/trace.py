# SPDX-License-Identifier: GPL-3.0-or-later
"""The frames of stations that somebody looks at now: the last ones of each, in memory alone."""

from __future__ import annotations

import time
from collections import deque
from dataclasses import dataclass, field

from openrtu_tools.centre.apdu import START, decode
from openrtu_tools.centre.codes import GAP, SENT
from openrtu_tools.centre.model import NS_PER_MS, Json
from openrtu_tools.centre.records import Record

FRAMES_MOST = 500  # of a station
STATIONS_MOST = 8  # at once
CONNECTIONS_MOST = 8  # and directions
LOOKED_AT_S = 10.0  # a page that asks no more has left


@dataclass
class Trace:
    """Of a station."""

    frames: deque[Json] = field(default_factory=lambda: deque(maxlen=FRAMES_MOST))
    count: int = 0
    asked_s: float = 0.0
    rest: dict[tuple[int, bool], bytes] = field(default_factory=dict)  # of a connection and a direction

    def take(self, record: Record) -> None:
        """Octets of a connection: the frames that are whole with them."""
        sent = bool(record.flags & SENT)
        key = record.connection, sent
        if record.flags & GAP:
            self.rest.clear()
            self._add(record, sent, {"kind": "", "what": "…"})
        elif key not in self.rest and len(self.rest) >= CONNECTIONS_MOST:
            del self.rest[next(iter(self.rest))]  # of one that has ended long ago
        stream = self.rest.get(key, b"") + record.octets
        while True:
            begin = stream.find(START)  # of one that was looked at from its middle on
            stream = stream[begin:] if begin >= 0 else b""
            if len(stream) < 2 or len(stream) < 2 + stream[1]:
                break
            apdu, stream = stream[: 2 + stream[1]], stream[2 + stream[1] :]
            self._add(record, sent, vars(decode(apdu)) | {"octets": apdu.hex(" ")})
        self.rest[key] = stream

    def _add(self, record: Record, sent: bool, content: Json) -> None:
        self.count += 1
        head = {"number": self.count, "at": record.received_ns // NS_PER_MS, "connection": record.connection}
        self.frames.append({**head, "sent": sent, **content})

    def after(self, number: int) -> list[Json]:
        self.asked_s = time.monotonic()
        return [frame for frame in self.frames if frame["number"] > number]

    @property
    def left(self) -> bool:
        """Nobody looks any more."""
        return time.monotonic() - self.asked_s > LOOKED_AT_S
