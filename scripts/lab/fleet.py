# SPDX-License-Identifier: GPL-3.0-or-later
"""Vehicles on roads: each has a gateway of its own, as a real one, with a receiver of positions on a pty.

The receivers have whims of recorded ones: they lose their fix in tunnels, step their clocks, wake up cold, or
count their satellites where nobody looks.
"""

from __future__ import annotations

import contextlib
import datetime
import math
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import Enum, auto
from typing import Any

from lab.gateway import Gateway, free_port, listening_on, remove, run_directory
from lab.receiver import Receiver, burst, sentence
from lab.roads import WAYS, Place, Road

SPEED_M_S = 22.0
KNOT_M_S = 1852 / 3600
APART_M = 7000  # on their roads, at the same time
TUNNEL_S, PERIOD_S = 60, 600
SILENT_S = 20
COLD_S, DATELESS_S = 10, 10
STEPS_S = 20
EVERY_M, EVERY_S = 40, 10
ERA = datetime.timedelta(weeks=1024)
HOUR = datetime.timedelta(hours=1)
BEGIN_OF_GPS = datetime.datetime(1980, 1, 6, tzinfo=datetime.UTC)
NO_FIX, FIX, ESTIMATED = 0, 1, 6
CA, POSITION, FIRST = 1, 1, 10  # common address; of the position as one object; of its parts


class Whim(Enum):
    NONE = auto()
    TUNNELS = auto()  # without a fix in tunnels
    RECKONS = auto()  # goes on by its wheels there
    COLD = auto()  # wakes up without a fix, then without a date
    STEPS = auto()  # its clock is an hour behind at times
    ROLLED_OVER = auto()  # its date is 1 024 weeks behind
    UNCOUNTED = auto()  # GGA has 00 satellites
    LATE = auto()  # RMC is of 20 ms later than GGA
    SILENT = auto()  # says nothing more


WHIMS = {
    "Torino-Milano": Whim.TUNNELS,
    "Bogotá-Tunja": Whim.RECKONS,
    "Barcelona-Girona": Whim.COLD,
    "Kraków-Katowice": Whim.STEPS,
    "Mumbai-Pune": Whim.ROLLED_OVER,
    "Hamburg-Bremen": Whim.UNCOUNTED,
    "München-Nürnberg": Whim.LATE,
    "Oslo-Hamar": Whim.SILENT,
}


def direction(a: Place, b: Place) -> float:
    """In degrees from north, between two places that are near each other."""
    east = (b[1] - a[1]) * math.cos(math.radians(a[0]))
    return math.degrees(math.atan2(east, b[0] - a[0])) % 360


@dataclass
class Vehicle:
    """One that drives to and fro; `tunnel` holds it in one."""

    name: str
    number: int
    receiver: Receiver
    gateway: Gateway
    tunnel: threading.Event = field(default_factory=threading.Event)

    def __post_init__(self) -> None:
        self.road = Road(WAYS[self.name])
        self.whim = WHIMS.get(self.name, Whim.NONE)
        self.begun = time.monotonic()

    @property
    def port(self) -> int:
        return self.gateway.address[1]

    def _in_tunnel(self, since_s: float) -> bool:
        return self.tunnel.is_set() or since_s % PERIOD_S >= PERIOD_S - TUNNEL_S

    def _method(self, since_s: float) -> int:
        """How its receiver finds its place."""
        if self.whim is Whim.TUNNELS and self._in_tunnel(since_s):
            return NO_FIX
        if self.whim is Whim.RECKONS and self._in_tunnel(since_s):
            return ESTIMATED
        return NO_FIX if self.whim is Whim.COLD and since_s < COLD_S else FIX

    def _clock(self, since_s: float, now: datetime.datetime) -> datetime.datetime:
        """Its receiver's."""
        if self.whim is Whim.COLD and since_s < COLD_S + DATELESS_S:
            return BEGIN_OF_GPS + datetime.timedelta(seconds=since_s)
        if self.whim is Whim.STEPS and STEPS_S <= since_s % PERIOD_S < STEPS_S + PERIOD_S / 2:
            return now - HOUR
        return now - ERA if self.whim is Whim.ROLLED_OVER else now

    def says(self) -> bytes:
        """What its receiver says of this second."""
        since_s, now_s = time.monotonic() - self.begun, time.time()
        if self.whim is Whim.SILENT and since_s > SILENT_S:
            return b""
        here, there = (self.road.at(at_s * SPEED_M_S + self.number * APART_M) for at_s in (now_s, now_s + 1))
        lines = burst(
            self._clock(since_s, datetime.datetime.fromtimestamp(int(now_s), datetime.UTC)),
            *here,
            method=self._method(since_s),
            speed_knots=SPEED_M_S / KNOT_M_S,
            course=direction(here, there),
            altitude_m=120 + 11 * self.number,
            satellites=0 if self.whim is Whim.UNCOUNTED else 7,
            rmc_ms=20 if self.whim is Whim.LATE else 0,
        )
        return lines + sentence("PGRME,2.4,M,3.5,M,4.2,M")


def configuration(port: int) -> dict[str, Any]:
    receiver = {"name": "van", "device": "gps", "ca": CA, "ioa": FIRST, "position_ioa": POSITION}
    rule = {"distance_m": EVERY_M, "interval_s": EVERY_S, "topical_s": 5}
    return listening_on({"port": [], "gps": [receiver | rule]}, port)


@contextlib.contextmanager
def vehicle(name: str, number: int) -> Iterator[Vehicle]:
    """It stands, and its gateway listens."""
    directory = run_directory()
    (directory / "dev").mkdir()
    try:
        with (
            Receiver(directory / "dev" / "gps") as receiver,
            Gateway(configuration(free_port()), directory) as gateway,
        ):
            yield Vehicle(name, number, receiver, gateway)
    finally:
        remove(directory)


@contextlib.contextmanager
def driving(vehicles: list[Vehicle]) -> Iterator[None]:
    """Their receivers speak each second."""
    ended = threading.Event()

    def speak() -> None:
        while not ended.wait(1 - time.time() % 1):
            for each in vehicles:
                each.receiver.say(each.says())

    thread = threading.Thread(target=speak, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
