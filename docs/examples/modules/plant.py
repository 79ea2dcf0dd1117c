#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""A plant that is not there: a tank with a pump and a feeder with a breaker, to try programs on."""

import time
from dataclasses import dataclass

from openrtu import Module, Request


@dataclass
class Tank:
    """Water flows in; the pump takes it out. All is in per cent of the tank, and of it a second."""

    level: float = 50.0
    inflow: float = 1.0
    pumped: float = 3.0
    pump: bool = False

    def step(self, seconds: float) -> None:
        flow = self.inflow - (self.pumped if self.pump and self.level > 0 else 0)
        self.level = min(max(self.level + flow * seconds, 0.0), 100.0)


@dataclass
class Feeder:
    """A line behind a breaker, which trips by overcurrent: closed onto an earthed line, too."""

    load_a: float = 120.0
    trip_a: float = 400.0
    trip_s: float = 0.1
    short_a: float = 8000.0
    closed: bool = False
    earthed: bool = False
    tripped: bool = False
    over_s: float = 0.0

    @property
    def current_a(self) -> float:
        return 0.0 if not self.closed else self.short_a if self.earthed else self.load_a

    def close(self, closed: bool) -> None:
        self.closed, self.over_s = closed, 0.0
        self.tripped = self.tripped and not closed

    def step(self, seconds: float) -> None:
        self.over_s = self.over_s + seconds if self.current_a > self.trip_a else 0.0
        if self.over_s >= self.trip_s:
            self.close(False)
            self.tripped = True


def obey(request: Request, tank: Tank, feeder: Feeder) -> None:
    match request.name:
        case "tank.pump":
            tank.pump = bool(request.value)
        case "tank.inflow":
            tank.inflow = request.value
        case "feeder.breaker":
            feeder.close(bool(request.value))
        case "feeder.earth":
            feeder.earthed = bool(request.value)
        case "feeder.load":
            feeder.load_a = request.value
    request.done()


def main() -> None:
    with Module() as module:
        tank, feeder = Tank(**module.config.get("tank", {})), Feeder(**module.config.get("feeder", {}))
        before = time.monotonic()
        for _ in module.scans():
            now = time.monotonic()
            seconds, before = now - before, now
            for request in module.requests():
                obey(request, tank, feeder)
            tank.step(seconds)
            feeder.step(seconds)
            values = {
                "tank.level": round(tank.level),
                "tank.pump": tank.pump,
                "tank.inflow": tank.inflow,
                "feeder.breaker": feeder.closed,
                "feeder.earth": feeder.earthed,
                "feeder.load": feeder.load_a,
                "feeder.current": feeder.current_a,
                "feeder.tripped": feeder.tripped,
            }
            for name, value in values.items():
                module[name] = value


if __name__ == "__main__":
    main()
