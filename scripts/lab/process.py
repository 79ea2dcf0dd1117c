# SPDX-License-Identifier: GPL-3.0-or-later
"""The plants of `make centre`: what their simulated devices measure follows what they are commanded.

docs/examples/pictures shows both: a feeder's bay, and a pumping station.
"""

from __future__ import annotations

import contextlib
import threading
from dataclasses import dataclass
from typing import Any

from lab.errors import LabError
from lab.linesim import LineSim

PERIOD_S = 1.0
RELAY, TAP_CHANGER, PUMPS, FLOW, VALVE = "1.10", "4.40", "3.67", "3.155", "3.201"
COILS, INPUTS, MEASURED, SET = "coils", "discrete_inputs", "input_registers", "holding_registers"
CURRENT, POWER = 16384, -120  # of a feeder that carries its load
SPEED, VALVE_STEP, KILOVOLTS = 1480, 20, 20
OFF, ON, BETWEEN = (1, 0), (0, 1), (0, 0)  # of a double point's two inputs

# What the objects of the pump's controller, the flow meter and the valve's actuator are called.
NAMES = {
    PUMPS: {
        COILS: ("pump1.command", "pump2.command"),
        INPUTS: ("pump1.running", "pump2.running", "pumps.fault"),
        MEASURED: ("pump1.speed", "sump.level", "tank.level"),
    },
    FLOW: {MEASURED: ("flow.rate", "flow.pressure")},
    VALVE: {COILS: ("valve.command",), MEASURED: ("valve.position",)},
}
UNITS = {
    "pump1.speed": "1/min", "sump.level": "%", "tank.level": "%", "flow.rate": "m³/h",
    "flow.pressure": "kPa", "valve.position": "%",
}  # fmt: skip
# Beside those of the report.
SWITCHES, FIRST_SWITCH = ("feeder10.earth-switch-position", "feeder10.busbar2-position"), 6
SECOND_SPEED = 3


def named(config: dict[str, Any]) -> dict[str, Any]:
    """A gateway's configuration with the names of a plant."""
    for port in config["port"]:
        for slave in port["slaves"]:
            device = f"{port['value']}.{slave['id']}"
            for table, names in NAMES.get(device, {}).items():
                for entry, name in zip(slave[table], names, strict=False):
                    entry["name"] = name
                    entry |= {"unit": UNITS[name]} if name in UNITS else {}
            if device == PUMPS:
                slave[MEASURED].append({"address": SECOND_SPEED, "name": "pump2.speed", "unit": "1/min"})
            elif device == RELAY:
                slave[INPUTS] += [
                    {"address": FIRST_SWITCH + 2 * number, "type": "double", "name": name}
                    for number, name in enumerate(SWITCHES)
                ]
    return config


@dataclass
class Plant:
    """The devices of a gateway."""

    lines: LineSim
    breaker: tuple[int, int] = ON
    sump: float = 60.0
    tank: float = 45.0
    valve: int = 100
    number: int = 0

    def begin(self) -> None:
        self.lines.set(RELAY, INPUTS, FIRST_SWITCH, *OFF, *OFF)
        self.lines.set(TAP_CHANGER, SET, 1, KILOVOLTS * 10)
        self.lines.set(PUMPS, COILS, 0, 1, 0)
        self.lines.set(VALVE, COILS, 0, 1)

    def run(self, ended: threading.Event) -> None:
        """Until it is ended; a device that is unplugged is left alone."""
        with contextlib.suppress(LabError):
            self.begin()
        while not ended.wait(PERIOD_S):
            self.number += 1
            with contextlib.suppress(LabError):
                self._bay()
                self._pumps()

    def _read(self, device: str, table: str, count: int) -> tuple[int, ...]:
        return tuple(self.lines.get(device, table, address) for address in range(count))

    def _bay(self) -> None:
        """A breaker is between its positions for a moment."""
        wanted = self._read(RELAY, COILS, 2)
        if wanted in (OFF, ON) and wanted != self.breaker:
            self.breaker = BETWEEN if self.breaker != BETWEEN else wanted
        self.lines.set(RELAY, INPUTS, 0, *self.breaker)
        swing = (self.number * 37) % 23 - 11
        carries = self.breaker == ON
        self.lines.set(RELAY, MEASURED, 0, (CURRENT + swing * 200) if carries else 0)
        self.lines.set(RELAY, MEASURED, 3, (POWER + swing if carries else 0) & 0xFFFF)

    def _pumps(self) -> None:
        """What runs moves water from the sump to the tank, as far as the valve is open."""
        running = self._read(PUMPS, COILS, 2)
        (opened,) = self._read(VALVE, COILS, 1)
        self.valve = min(100, max(0, self.valve + (VALVE_STEP if opened else -VALVE_STEP)))
        swing = (self.number * 37) % 23 - 11
        flow = sum(running) * (58 + swing // 4) * self.valve // 100
        self.sump = min(98.0, max(8.0, self.sump + 0.9 - flow / 60))
        self.tank = min(98.0, max(5.0, self.tank - 0.8 + flow / 60))
        if self.tank > 90 or self.sump < 20:
            self.lines.set(PUMPS, COILS, 0, 0, 0)
        elif self.tank < 35:
            self.lines.set(PUMPS, COILS, 0, 1, 1 if self.sump > 70 else 0)
        first, second = (on * (SPEED + swing) for on in running)
        self.lines.set(PUMPS, INPUTS, 0, *running, 0)
        self.lines.set(PUMPS, MEASURED, 0, first, round(self.sump), round(self.tank), second)
        self.lines.set(FLOW, MEASURED, 0, flow, 120 + flow * 2 + swing)
        self.lines.set(VALVE, MEASURED, 0, self.valve)
