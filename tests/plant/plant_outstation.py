# SPDX-License-Identifier: GPL-3.0-or-later
"""An outstation of IEC 60870-5-104 that keeps what its master has not acknowledged, and may tell it late."""

from __future__ import annotations

import json
import random
import select
import socket
import struct
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field

CA, IOA = 1, 1
PORT_BACKLOG = 8
UNACKNOWLEDGED_MAX = 12
SPONTANEOUS, ACT, ACT_CON, ACT_TERM, INTERROGATED = 3, 6, 7, 10, 20
SCALED, SCALED_WITH_TIME, INTERROGATION = 11, 35, 100
START, HEAD_SIZE = 0x68, 6
ANSWERS = {0x07: 0x0B, 0x13: 0x23, 0x43: 0x83}  # STARTDT, STOPDT, TESTFR: act, and con
SEQUENCES = 1 << 15
MEAN_S, LEAST_S = 4.0, 0.2
QUIET_PART, QUIET_S = 0.3, (20.0, 40.0)
STAYS_S, AWAY_S = (25.0, 60.0), (0.5, 8.0)  # it hangs up, and takes nobody for a while
LATE_PART, LATE_S = 0.7, 15.0  # of its connections, those in which it tells late what it had kept


def say(**what: object) -> None:
    at = time.clock_gettime_ns(time.CLOCK_MONOTONIC)
    sys.stdout.write(json.dumps({"at": at, **what}) + "\n")
    sys.stdout.flush()


def time56(at_ns: int) -> bytes:
    at = time.gmtime(at_ns // 10**9)
    ms = at.tm_sec * 1000 + at_ns % 10**9 // 10**6
    day = at.tm_mday | (at.tm_wday + 1) << 5
    return struct.pack("<HBBBBB", ms, at.tm_min, at.tm_hour, day, at.tm_mon, at.tm_year - 2000)


def asdu(kind: int, cause: int, element: bytes) -> bytes:
    head = bytes((kind, 1, cause, 0)) + struct.pack("<H", CA)
    return head + IOA.to_bytes(3, "little") + element


@dataclass(frozen=True)
class Event:
    at_ns: int
    value: int

    @property
    def asdu(self) -> bytes:
        return asdu(SCALED_WITH_TIME, SPONTANEOUS, struct.pack("<hB", self.value, 0) + time56(self.at_ns))


@dataclass
class Session:
    """A connection of the master: what was sent in it, and not acknowledged."""

    peer: socket.socket
    begun_ns: int
    late_s: float  # so long behind the answer to an interrogation it tells what is from before; 0: at once
    ends_s: float | None
    kept_until_s: float | None = None
    started: bool = False
    received: int = 0
    sent: int = 0
    octets: bytes = b""
    pending: list[Event | None] = field(default_factory=list)

    def frame(self, control: bytes, octets: bytes = b"") -> None:
        self.peer.sendall(bytes((START, 4 + len(octets))) + control + octets)

    def tell(self, octets: bytes, event: Event | None = None) -> None:
        self.frame(struct.pack("<HH", self.sent << 1, self.received << 1), octets)
        self.sent = (self.sent + 1) % SEQUENCES
        self.pending.append(event)

    def frames(self) -> list[bytes]:
        whole = []
        while len(self.octets) >= 2 and len(self.octets) >= 2 + self.octets[1]:
            size = 2 + self.octets[1]
            whole.append(self.octets[:size])
            self.octets = self.octets[size:]
        return whole


class Outstation:
    """One point, whose values count. One master: a new connection takes the place of the one before."""

    def __init__(self, port: int, seed: int, until_s: float) -> None:
        self.chance = random.Random(seed)
        self.listener = socket.create_server(("127.0.0.1", port), backlog=PORT_BACKLOG)
        self.session: Session | None = None
        self.value = 0
        self.events: list[Event] = []  # that no master has acknowledged
        self.until_s = until_s
        self.back_s = 0.0
        self.next_s: float | None = time.monotonic() + MEAN_S

    def wait_s(self) -> float | None:
        session = self.session
        due = [self.next_s, *((session.kept_until_s, session.ends_s) if session else (self.back_s,))]
        now_s = time.monotonic()
        coming = [one_s for one_s in due if one_s is not None and (session or one_s > now_s)]
        return max(0.0, min(coming) - now_s) if coming else None

    def run(self) -> None:
        while True:
            hears = self.session or time.monotonic() >= self.back_s
            sockets = [*([self.listener] if hears else []), *([self.session.peer] if self.session else [])]
            readable, _, _ = select.select(sockets, [], [], self.wait_s())
            if self.listener in readable:
                self.take_master()
            elif readable:
                self.guarded(self.hear)
            if self.next_s is not None and time.monotonic() >= self.next_s:
                self.change(self.next_s)
            if self.session and self.session.ends_s and time.monotonic() >= self.session.ends_s:
                self.hang_up(self.session)
            self.guarded(self.tell_events)

    def take_master(self) -> None:
        peer, _ = self.listener.accept()
        if self.session:
            self.session.peer.close()
        late_s = self.chance.uniform(0.0, LATE_S) if self.chance.random() < LATE_PART else 0.0
        ends_s = time.monotonic() + self.chance.uniform(*STAYS_S)
        ends = ends_s if ends_s < self.until_s - STAYS_S[0] else None
        self.session = Session(peer, time.time_ns(), late_s, ends)

    def hang_up(self, session: Session) -> None:
        session.peer.close()
        self.session = None
        self.back_s = time.monotonic() + self.chance.uniform(*AWAY_S)
        say(away_until=round(self.back_s * 1e9))

    def guarded(self, work: Callable[[Session], None]) -> None:
        if not self.session:
            return
        try:
            work(self.session)
        except OSError:
            self.session.peer.close()
            self.session = None

    def change(self, due_s: float) -> None:
        self.value += 1
        self.events.append(Event(time.time_ns(), self.value))
        say(held=self.value)
        quiet = self.chance.random() < QUIET_PART
        next_s = due_s + (
            self.chance.uniform(*QUIET_S) if quiet else LEAST_S + self.chance.expovariate(1 / MEAN_S)
        )
        self.next_s = next_s if next_s < self.until_s else None

    def tell_events(self, session: Session) -> None:
        if session.kept_until_s is not None and session.kept_until_s <= time.monotonic():
            session.late_s, session.kept_until_s = 0.0, None
            say(late=len(self.events))
        waiting = [event for event in self.events if event not in session.pending]
        if session.late_s:
            waiting = [event for event in waiting if event.at_ns > session.begun_ns]
        for event in waiting if session.started else []:
            if len(session.pending) < UNACKNOWLEDGED_MAX:
                session.tell(event.asdu, event)

    def hear(self, session: Session) -> None:
        octets = session.peer.recv(4096)
        if not octets:
            raise ConnectionError
        session.octets += octets
        for frame in session.frames():
            self.take(session, frame)

    def take(self, session: Session, frame: bytes) -> None:
        if frame[2] & 3 == 3:
            session.started = session.started or frame[2] == 0x07
            if frame[2] in ANSWERS:
                session.frame(bytes((ANSWERS[frame[2]], 0, 0, 0)))
            return
        self.acknowledge(session, struct.unpack("<H", frame[4:6])[0] >> 1)
        if frame[2] & 1 == 0:
            session.received = (session.received + 1) % SEQUENCES
            session.frame(bytes((1, 0)) + struct.pack("<H", session.received << 1))
            self.answer(session, frame[HEAD_SIZE:])

    def acknowledge(self, session: Session, number: int) -> None:
        while session.pending and (session.sent - len(session.pending)) % SEQUENCES != number:
            event = session.pending.pop(0)
            if event:
                self.events.remove(event)

    def answer(self, session: Session, asked: bytes) -> None:
        if asked[0] != INTERROGATION or asked[2] & 0x3F != ACT:
            session.tell(asked[:2] + bytes((ACT_CON | 0x40,)) + asked[3:])
            return
        session.tell(asked[:2] + bytes((ACT_CON,)) + asked[3:])
        session.tell(asdu(SCALED, INTERROGATED, struct.pack("<hB", self.value, 0)))
        session.tell(asked[:2] + bytes((ACT_TERM,)) + asked[3:])
        if session.late_s and session.kept_until_s is None:
            session.kept_until_s = time.monotonic() + session.late_s


if __name__ == "__main__":
    Outstation(int(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3])).run()
