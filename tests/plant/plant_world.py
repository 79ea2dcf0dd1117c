# SPDX-License-Identifier: GPL-3.0-or-later
"""Worlds of the plant: programs, devices, what changes and what fails, all from one seed; and their runs."""

from __future__ import annotations

import json
import os
import random
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from operator import itemgetter
from pathlib import Path
from typing import Any

REPOSITORY = Path(__file__).resolve().parents[2]
PARTS = Path(__file__).with_name("plant_parts.py")
BUILD = Path(os.environ.get("OPENRTU_PLANT", REPOSITORY / "build" / "plant"))
GATEWAY = Path(os.environ.get("OPENRTU_BUILD", REPOSITORY / "build" / "native"))
LINESIM = Path(os.environ.get("OPENRTU_LINESIM", REPOSITORY / "build" / "linesim" / "linesim"))
BEGIN_NS = 1000 * 10**9  # main.c
PORT = 2404
LINES = 2
DEVICES = 3  # of a line
BAUD, SLOW_BAUD = 9600, 2400  # slow: a scan is a dozen requests a second, and not five times as many
PERIOD_MS = 1000
POINTS = 2  # of a device, beside its bit
CHANGES_FROM_S = 5.0
FAULTS_FROM_S = 10.0
RECOVERY_S = 60.0  # without a fault, before the end
SETTLED_S = 10.0  # without a change, before the end
MODULES = ("rtu-modbus-1", "rtu-iec104", "rtud", "rtu-centre")
CALLS_MAX = 200
LOST_ONE_OF = 3  # cuts
BAD_S, QUIET_S = 60.0, 80.0
KILLS_APART_S = 10.0  # two in one instant of the plant would tell the same twice
LINE_LONGEST_S = 40.0
LATEST_S = 3.0
STALLS_MAX = 20
STALL_LONGEST_S = 3.0
STALL_CALLS_MAX = 20
LONGEST_S = {"stop": 20.0, "silent": 20.0, "cut": 40.0}


class PlantError(Exception):
    """A plant that could not be run; the text says why."""


@dataclass(frozen=True)
class Fault:
    """What goes wrong, from a time on."""

    at_s: float
    kind: str  # kill, stop, cut, lost, power: the plant's; silent, late: a device's; unplugged: a line's
    of: str  # a process, a TCP port, a device, a line
    calls: int = 0
    for_s: float = 0.0
    late_s: float = 0.0

    @property
    def end_s(self) -> float:
        return self.at_s + self.for_s

    def __str__(self) -> str:
        what = {
            "kill": f"{self.of} is killed at its call {self.calls}",
            "stop": f"{self.of} stops for {self.for_s:.3f} s at its call {self.calls}",
            "cut": f"TCP port {self.of} is cut for {self.for_s:.3f} s",
            "lost": f"connections to TCP port {self.of} are lost, and nobody is told",
            "power": f"the centre at TCP port {self.of} loses power, and nobody is told",
            "silent": f"device {self.of} is silent for {self.for_s:.3f} s",
            "late": f"device {self.of} answers {self.late_s:.3f} s later for {self.for_s:.3f} s",
            "unplugged": f"line {self.of} is unplugged for {self.for_s:.3f} s",
        }
        return f"{self.at_s:.3f} s: {what[self.kind]}"


@dataclass(frozen=True)
class Change:
    """A register of a device has a new value."""

    at_s: float
    device: str
    table: str
    address: int
    value: int

    @property
    def point(self) -> str:
        line, unit = self.device.split(".")
        base = {"input_registers": 30001, "discrete_inputs": 10001}[self.table]
        return f"{int(line) * 1000 + int(unit)}.{base + self.address}"


@dataclass(frozen=True)
class World:
    """Two lines of three devices, rtud with its modules, one controlling station."""

    seed: int
    seconds: float
    changes: tuple[Change, ...]
    faults: tuple[Fault, ...] = ()
    scanned: tuple[int, ...] = ()  # lines whose devices are read as often as the line allows

    def baud(self, line: int) -> int:
        return SLOW_BAUD if line in self.scanned else BAUD

    def slaves(self, line: int) -> list[dict[str, Any]]:
        registers = [{"address": place} for place in range(POINTS)]
        period = {} if line in self.scanned else {"period_ms": PERIOD_MS}
        return [
            {"id": unit, **period, "discrete_inputs": [{"address": 0}], "input_registers": registers}
            for unit in range(1, DEVICES + 1)
        ]

    @property
    def gateway(self) -> dict[str, Any]:
        line = {"active": 1, "data_bits": 8, "stop_bits": 1, "parity": 0}
        return {
            "iec104": {"address": "127.0.0.1", "port": PORT},
            "port": [
                {"value": number, "baud_rate": self.baud(number), **line, "slaves": self.slaves(number)}
                for number in range(1, LINES + 1)
            ],
        }

    @property
    def centre(self) -> dict[str, Any]:
        addresses = [line * 1000 + unit for line in range(1, LINES + 1) for unit in range(1, DEVICES + 1)]
        station = {"name": "rtu", "address": "127.0.0.1", "port": PORT, "common_addresses": addresses}
        period_s = 0 if self.seed % 2 else 20  # 0: what was missed once no later interrogation brings
        return {"stations": [{**station, "interrogation_s": period_s}], "retry_ms": 500, "retry_max_ms": 2000}

    @property
    def script(self) -> list[str]:
        """What the field does, as linesim's commands."""
        told = [
            (change.at_s, f"set {change.device} {change.table} {change.address} {change.value}")
            for change in self.changes
        ]
        for fault in self.faults:
            match fault.kind:
                case "silent":
                    told += [(fault.at_s, f"fault {fault.of} mute"), (fault.end_s, f"fault {fault.of} clear")]
                case "late":
                    late = f"fault {fault.of} late {round(fault.late_s * 1000)}"
                    told += [(fault.at_s, late), (fault.end_s, f"fault {fault.of} clear")]
                case "unplugged":
                    told += [(fault.at_s, f"unplug {fault.of}"), (fault.end_s, f"plug {fault.of}")]
        return [
            f"{BEGIN_NS + round(at_s * 1e9)} {command}" for at_s, command in sorted(told, key=itemgetter(0))
        ]

    def plan(self, folder: Path, gateway: Path) -> list[str]:
        """What the runner reads."""
        python = [str(Path(sys.executable).resolve()), "-I", "-S", "-B", str(PARTS)]
        dev, consumer = folder / "dev", folder / "consumer"
        rtud = [f"{gateway}/rtud/rtud", "--uid-base", "0", "--map", f"{folder}/map", "--dev", f"{dev}"]
        centre = [f"{gateway}/centre/rtu-centre", "--socket", f"{consumer}", f"{folder}/centre.json"]
        programs: dict[str, tuple[float, list[str]]] = {
            "linesim": (0.0, [f"{LINESIM}", "--config", f"{folder}/gateway.json", "--dir", f"{dev}"]),
            "gateway": (
                0.5,
                [*python, "keep", *rtud, "--modules", f"{gateway}/modules", f"{folder}/gateway.json"],
            ),
            "centre": (1.0, [*python, "keep", *centre]),
            "consumer": (1.5, [*python, "consume", f"{consumer}"]),
            "watch": (1.5, [*python, "watch", f"{dev}/control"]),
            "field": (1.5, [*python, "change", f"{dev}/control", f"{folder}/script"]),
        }
        lines = [["end", f"{self.seconds}"]]
        for name, (at_s, words) in programs.items():
            lines.append(["start", name, f"{at_s}", f"{folder}/{name}.out", f"{folder}/{name}.log", *words])
        for fault in self.faults:
            match fault.kind:
                case "kill":
                    lines.append(["kill", fault.of, f"{fault.at_s}", f"{fault.calls}"])
                case "stop":
                    lines.append(["stop", fault.of, f"{fault.at_s}", f"{fault.calls}", f"{fault.for_s}"])
                case "cut":
                    lines.append(["cut", fault.of, f"{fault.at_s}", f"{fault.end_s}"])
                case "lost":
                    lines.append(["lose", fault.of, f"{fault.at_s}"])
                case "power":
                    lines.append(["lose", fault.of, f"{fault.at_s}"])
                    lines.append(["kill", "rtu-centre", f"{fault.at_s}", "0"])
        return ["\t".join(line) for line in lines]


@dataclass(frozen=True)
class Run:
    """A world that has been run; its files are in `folder`."""

    world: World
    folder: Path
    real_s: float
    code: int
    said: str

    @cached_property
    def trace(self) -> bytes:
        return (self.folder / "trace").read_bytes()

    def told(self, part: str) -> list[dict[str, Any]]:
        """The lines of the consumer or the field; one that the end cut off is none."""
        lines = (self.folder / f"{part}.out").read_text().split("\n")
        return [json.loads(line) for line in lines[:-1]]

    @property
    def speed(self) -> float:
        return self.world.seconds / self.real_s


def run(world: World, folder: Path, *, traced: bool = True, gateway: Path = GATEWAY) -> Run:
    """Raises PlantError. A trace of a day is long: two GB."""
    (folder / "dev").mkdir(parents=True)
    (folder / "gateway.json").write_text(json.dumps(world.gateway))
    (folder / "centre.json").write_text(json.dumps(world.centre))
    (folder / "script").write_text("\n".join(world.script) + "\n")
    (folder / "world").write_text("\n".join(world.plan(folder, gateway)) + "\n")
    command = [BUILD / "plant", "--seed", str(world.seed), "--trace"]
    command += [folder / "trace" if traced else "/dev/null", folder / "world"]
    begun = time.monotonic()
    try:
        result = subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError as error:
        raise PlantError(f"{command[0]}: {error.strerror}; type make build") from None
    if result.returncode == 2:
        raise PlantError(result.stderr.strip())
    return Run(world, folder, time.monotonic() - begun, result.returncode, result.stderr.strip())


@dataclass
class Field:
    """What devices hold: values that never come twice, so that each report says which change it is of."""

    random: random.Random
    seconds: float
    next_value: int = 1
    bits: dict[str, int] = field(default_factory=dict)

    def device(self) -> str:
        return f"{self.random.randrange(LINES) + 1}.{self.random.randrange(DEVICES) + 1}"

    def change(self, at_s: float) -> Change:
        device = self.device()
        if self.random.random() < 0.2:
            self.bits[device] = 1 - self.bits.get(device, 0)
            return Change(at_s, device, "discrete_inputs", 0, self.bits[device])
        self.next_value = self.next_value % 32000 + 1
        return Change(at_s, device, "input_registers", self.random.randrange(POINTS), self.next_value)

    def times(self, from_s: float, to_s: float, mean_s: float) -> Iterator[float]:
        at_s = from_s
        while (at_s := at_s + self.random.expovariate(1 / mean_s)) < to_s:
            yield round(at_s, 3)

    def changes(self, mean_s: float) -> tuple[Change, ...]:
        end_s = self.seconds - SETTLED_S
        return tuple(self.change(at_s) for at_s in self.times(CHANGES_FROM_S, end_s, mean_s))

    def fault(self, at_s: float) -> Fault:
        kind = self.random.choice(("kill", "stop", "silent", "cut"))
        for_s = round(LONGEST_S[kind] * self.random.random() ** 3, 3) if kind != "kill" else 0.0
        calls = self.random.randrange(CALLS_MAX)
        match kind:
            case "silent":
                return Fault(at_s, kind, self.device(), for_s=for_s)
            case "cut" if calls % LOST_ONE_OF == 0:
                return Fault(at_s, "power" if calls % 2 else "lost", f"{PORT}")
            case "cut":
                return Fault(at_s, kind, f"{PORT}", for_s=for_s)
            case _:
                return Fault(at_s, kind, self.random.choice(MODULES), calls, for_s)

    def faults(self, mean_s: float) -> tuple[Fault, ...]:
        end_s = self.seconds - RECOVERY_S
        made = (self.fault(at_s) for at_s in self.times(FAULTS_FROM_S, end_s, mean_s))
        return tuple(fault for fault in made if fault.end_s < end_s)

    def stalls(self, at_s: float) -> Iterator[Fault]:
        """Of a busy host: again and again somebody does not run for a while."""
        of = self.random.choice(("linesim", "rtu-modbus-1"))
        for _ in range(self.random.randrange(1, STALLS_MAX)):
            for_s = round(STALL_LONGEST_S * self.random.random() ** 2, 3)
            yield Fault(round(at_s, 3), "stop", of, self.random.randrange(STALL_CALLS_MAX), for_s)
            at_s += for_s + self.random.expovariate(1.0)

    def line_faults(self, at_s: float) -> Iterator[Fault]:
        """What a line, its devices and the host do to it."""
        kind = self.random.choice(("silent", "late", "unplugged", "stalls", "kill"))
        for_s = round(LINE_LONGEST_S * self.random.random() ** 2, 3)
        late_s = round(LATEST_S * self.random.random() ** 2, 3)
        match kind:
            case "stalls":
                yield from self.stalls(at_s)
            case "kill":
                yield Fault(at_s, kind, "rtu-modbus-1", self.random.randrange(CALLS_MAX))
            case "unplugged":
                yield Fault(at_s, kind, f"{self.random.randrange(LINES) + 1}", for_s=for_s)
            case _:
                yield Fault(at_s, kind, self.device(), for_s=for_s, late_s=late_s if kind == "late" else 0.0)

    def bad_phases(self, mean_s: float) -> tuple[Fault, ...]:
        """Phases with faults and phases without; none of something that has one, or was just killed."""
        faults: list[Fault] = []
        from_s = FAULTS_FROM_S
        while from_s + BAD_S + QUIET_S < self.seconds:
            until_s: dict[str, float] = {}
            for at_s in self.times(from_s, from_s + BAD_S, mean_s):
                for fault in self.line_faults(at_s):
                    if fault.end_s < from_s + BAD_S and fault.at_s > until_s.get(fault.of, 0.0):
                        until_s[fault.of] = fault.end_s + (KILLS_APART_S if fault.kind == "kill" else 0.0)
                        faults.append(fault)
            from_s += BAD_S + QUIET_S
        return tuple(sorted(faults, key=lambda fault: fault.at_s))


def calm(seed: int, seconds: float) -> World:
    """Nothing fails."""
    return World(seed, seconds, Field(random.Random(seed), seconds).changes(mean_s=1.0))


def troubled(seed: int, seconds: float, fault_every_s: float = 30.0) -> World:
    """Modules die and stop, devices are silent, the link to the centre is cut."""
    of_seed = Field(random.Random(seed), seconds)
    changes = of_seed.changes(mean_s=1.0)
    return World(seed, seconds, changes, of_seed.faults(fault_every_s))


def restless(seed: int, seconds: float, fault_every_s: float = 8.0) -> World:
    """Devices are silent or late, lines are unplugged, the host is busy; then all is well for some time."""
    of_seed = Field(random.Random(seed), seconds)
    changes = of_seed.changes(mean_s=1.0)
    return World(seed, seconds, changes, of_seed.bad_phases(fault_every_s), scanned=(2,))


def world_of(seed: int, seconds: float, fault_every_s: float = 30.0) -> World:
    """Every third one is about lines."""
    return troubled(seed, seconds, fault_every_s) if seed % 3 else restless(seed, seconds)
