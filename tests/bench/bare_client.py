# SPDX-License-Identifier: GPL-3.0-or-later
"""A controlling station that looks at no more of a frame than it must, so that it is not what is measured."""

from __future__ import annotations

import contextlib
import selectors
import socket
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass, field

CA = 1001
W = 8
PATIENCE_S = 3.0


class BenchError(Exception):
    """A station did not do what is measured."""


class Client:
    """A connection that was started."""

    def __init__(self, address: tuple[str, int], source: str = "127.0.0.1") -> None:
        self.socket = socket.create_connection(address, 10, (source, 0))
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._waiting = b""
        self._sent = self._taken = self._owed = 0
        self.socket.sendall(bytes.fromhex("680407000000"))
        while not self.frames():
            pass

    def frames(self) -> list[bytes]:
        """What one read brings, acknowledged at w; U frames among it."""
        octets = self.socket.recv(1 << 18)
        if not octets:
            raise BenchError("the station closed the connection")
        stream, at, frames = self._waiting + octets, 0, []
        while len(stream) - at >= 6 and len(stream) - at >= 2 + stream[at + 1]:
            frame = stream[at : at + 2 + stream[at + 1]]
            at += len(frame)
            frames.append(frame)
            if not frame[2] & 1:
                self._taken += 1
                self._owed += 1
            elif frame[2] == 0x43:
                self.socket.sendall(bytes.fromhex("680483000000"))
            if self._owed >= W:
                self.acknowledge()
        self._waiting = stream[at:]
        return frames

    def acknowledge(self) -> None:
        self._owed = 0
        self.socket.sendall(b"\x68\x04\x01\x00" + self._number(self._taken))

    def ask(self, *asdus: bytes) -> None:
        stream = b""
        for asdu in asdus:
            numbers = self._number(self._sent) + self._number(self._taken)
            stream += bytes((0x68, 4 + len(asdu))) + numbers + asdu
            self._sent += 1
        self._owed = 0
        self.socket.sendall(stream)

    @staticmethod
    def _number(count: int) -> bytes:
        return (count % 32768 << 1).to_bytes(2, "little")


def asdu(kind: int, cause: int, ioa: int, element: bytes) -> bytes:
    return bytes((kind, 1, cause, 0)) + CA.to_bytes(2, "little") + ioa.to_bytes(3, "little") + element


def interrogate(client: Client, points: int) -> float:
    """Seconds from sending it to its termination. Raises BenchError unless it brings so many objects."""
    begun = time.perf_counter()
    client.ask(asdu(100, 6, 0, b"\x14"))
    objects = 0
    while True:
        for frame in client.frames():
            if not frame[2] & 1 and frame[8] == 20:
                objects += frame[7] & 0x7F
            if not frame[2] & 1 and frame[6] == 100 and frame[8] == 10:
                if objects != points:
                    raise BenchError(f"an interrogation brought {objects} objects")
                client.acknowledge()
                return time.perf_counter() - begun


def read(client: Client, count: int) -> None:
    """Read commands, w of them under way."""
    for _ in range(count // W):
        client.ask(*(asdu(102, 5, 30001 + n, b"") for n in range(W)))
        answers = 0
        while answers < W:
            answers += sum(not f[2] & 1 and f[8] == 5 and f[6] == 11 for f in client.frames())
    client.acknowledge()


@dataclass
class Counted:
    """The events that one master has had; values and addresses count upwards."""

    events: int = 0
    arrivals: list[tuple[int, float]] = field(default_factory=list)  # events before this ASDU, its time

    def take(self, frame: bytes) -> None:
        if frame[2] & 1 or frame[8] != 3:
            return
        if int.from_bytes(frame[15:17], "little") != (self.events + 1) & 0xFFFF:
            raise BenchError(f"event {self.events} is missing")
        self.arrivals.append((self.events, time.perf_counter()))
        self.events += frame[7] & 0x7F


@dataclass(frozen=True)
class Arrival:
    """Of events that were made at a rate."""

    seconds: float  # to the last one at the slowest master
    wait_s: float  # the first master's median, beyond the shortest that there was


def receive_events(clients: list[Client], make: Callable[[], None], rate: int, events: int) -> Arrival:
    """So many events, which make() begins to make. Raises BenchError when one was lost."""
    counted = {client: Counted() for client in clients}
    with selectors.DefaultSelector() as selector:
        for client in clients:
            selector.register(client.socket, selectors.EVENT_READ, client)
        begun = time.perf_counter()
        make()
        while any(each.events < events for each in counted.values()):
            ready = selector.select(PATIENCE_S)
            if not ready:
                raise BenchError("events are missing")
            for key, _ in ready:
                for frame in key.data.frames():
                    counted[key.data].take(frame)
    for client in clients:
        client.acknowledge()
    delays = [at_s - before / rate for before, at_s in counted[clients[0]].arrivals]
    last_s = max(each.arrivals[-1][1] for each in counted.values())
    return Arrival(last_s - begun, statistics.median(delays) - min(delays))


def count_events(client: Client, most: int) -> int:
    """Events of registers with a value, as the made ones have it: up to so many, or until no more come."""
    count = 0
    client.socket.settimeout(PATIENCE_S)
    with contextlib.suppress(TimeoutError):
        while count < most:
            count += sum(map(values_in, client.frames()))
    client.acknowledge()
    return count


def values_in(frame: bytes) -> int:
    """Objects of a spontaneous ASDU of scaled values, tagged or not, that are not 0."""
    if frame[2] & 1 or frame[8] != 3 or frame[6] not in (11, 35):
        return 0
    size = (len(frame) - 12) // (frame[7] & 0x7F)
    return sum(frame[at + 3 : at + 5] != b"\0\0" for at in range(12, len(frame), size))
