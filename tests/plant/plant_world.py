# SPDX-License-Identifier: GPL-3.0-or-later
"""Worlds of the plant: programs, devices, what changes and what fails, all from one seed; and their runs."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
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
PORT, MODBUS_PORT = 2404, 1502
CABLE = "1"  # shared.h: the port that stands for the Ethernet
JOURNAL = "rtu-journal"
SERIAL = (1, 2)  # lines
NETWORKED = 7  # the line whose devices are behind Modbus TCP
DEVICES = 3  # of a line
BAUD, SLOW_BAUD = 9600, 2400  # slow: a scan is a dozen requests a second, and not five times as many
PERIOD_MS = 1000
ORDERED = 40001
POINTS = 2  # of a device, beside its bit
MORE = 30001 + POINTS  # the object that one configuration has and another has not
ADDRESSES_MAX = 16  # of a station of rtu-centre: those that it interrogates
CHANGES_FROM_S = 5.0
SETTLED_S = 10.0  # without a change, before the end
RECOVERY_S = 60.0  # without a fault, before the end


class PlantError(Exception):
    """A plant that could not be run; the text says why."""


@dataclass(frozen=True)
class Fault:
    """What goes wrong, from a time on."""

    at_s: float
    kind: (
        str  # kill, stop, cut, lost, power, step: the plant's; silent, late, deaf: a device's; else a line's
    )
    of: str  # a process, a TCP port, a device, a line
    calls: int = 0
    for_s: float = 0.0
    late_s: float = 0.0
    by_s: float = 0.0
    stores: int = 0  # into the map, behind the call
    rare: bool = False  # of them those into what is not written often

    @property
    def place(self) -> str:
        """Where a process dies, or stops."""
        if not self.stores:
            return f"at its call {self.calls}"
        return f"before its {'rare ' * self.rare}store {self.stores} behind call {self.calls}"

    @property
    def at_stores(self) -> list[str]:
        """As the runner reads it."""
        return [f"{self.stores}", *(["rare"] if self.rare else [])] if self.stores else []

    @property
    def end_s(self) -> float:
        return self.at_s + self.for_s

    def __str__(self) -> str:
        what = {
            "kill": f"{self.of} is killed {self.place}"
            + (f", and begins without memory for {self.for_s:.3f} s" if self.for_s else ""),
            "blackout": f"the gateway loses power at call {self.calls} of {self.of}",
            "full": f"the disk is full for {self.for_s:.3f} s",
            "refuses": f"the disk fails half of what changes it, for {self.for_s:.3f} s",
            "worn": f"the disk fails half of what reads it, for {self.for_s:.3f} s",
            "memory": f"{self.of} gets no memory for {self.for_s:.3f} s from its call {self.calls} on",
            "stop": f"{self.of} stops for {self.for_s:.3f} s {self.place}",
            "cut": f"TCP port {self.of} is cut for {self.for_s:.3f} s",
            "lost": f"connections to TCP port {self.of} are lost, and nobody is told",
            "power": f"the centre at TCP port {self.of} loses power, and nobody is told",
            "silent": f"device {self.of} is silent for {self.for_s:.3f} s",
            "late": f"device {self.of} answers {self.late_s:.3f} s later for {self.for_s:.3f} s",
            "deaf": f"device {self.of} hears nothing for {self.late_s:.3f} s behind its answers, "
            f"for {self.for_s:.3f} s",
            "unplugged": f"line {self.of} is unplugged for {self.for_s:.3f} s",
            "leap": f"a leap second moves the calendar clock by {self.by_s:.0f} s",
            "step": f"the calendar clock is moved by {self.by_s:.3f} s",
            "reload": f"configuration {self.of} is loaded" + (" by SIGHUP" if self.calls else ""),
            "hung": f"the sessions of line {self.of} answer nothing any more",
            "tearing": f"line {self.of} hangs up in the place of answer {self.calls}, for {self.for_s:.3f} s",
            "closing": f"line {self.of} hangs up behind each answer for {self.for_s:.3f} s",
            "idling": f"line {self.of} hangs up after {self.late_s:.3f} s of silence, for {self.for_s:.3f} s",
        }
        return f"{self.at_s:.3f} s: {what[self.kind]}".replace(f"TCP port {CABLE} ", "the Ethernet ")


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


def field_commands(fault: Fault) -> tuple[str, str]:
    """Of linesim, at the fault's begin and at its end; none of a fault that is no device's or line's."""
    clear = f"fault {fault.of} clear"
    match fault.kind:
        case "silent":
            return f"fault {fault.of} mute", clear
        case "late":
            return f"fault {fault.of} late {round(fault.late_s * 1000)}", clear
        case "deaf":
            return f"fault {fault.of} deaf {round(fault.late_s * 1000)}", clear
        case "unplugged":
            return f"unplug {fault.of}", f"plug {fault.of}"
        case "hung":
            return f"session {fault.of} hang", ""
        case "tearing":
            return f"session {fault.of} tear {fault.calls}", f"session {fault.of} clear"
        case "closing":
            return f"session {fault.of} close", f"session {fault.of} clear"
        case "idling":
            return f"session {fault.of} idle {round(fault.late_s * 1000)}", f"session {fault.of} clear"
    return "", ""


@dataclass(frozen=True)
class Configuration:
    """What of it differs from the others: on each line, so that one is in force whole or not at all."""

    more: bool = False  # a register of each line's first device
    fewer: bool = False  # without each line's last device
    ring: int = 4096
    period_ms: int = PERIOD_MS

    def has(self, unit: int, address: int) -> bool:
        return not (self.fewer and unit == DEVICES) and (address != MORE or (self.more and unit == 1))


CONFIGURATIONS = (
    Configuration(),
    Configuration(more=True),
    Configuration(fewer=True),
    Configuration(more=True, ring=8192),
    Configuration(ring=512),
    Configuration(period_ms=500),
)
WHOLE = Configuration(more=True)  # what the devices have


@dataclass(frozen=True)
class Order:
    """The control room commands a register; no value comes twice."""

    at_s: float
    line: int
    unit: int
    value: int

    @property
    def device(self) -> str:
        return f"{self.line}.{self.unit}"


@dataclass(frozen=True)
class Link:
    """What goes over it is so long on its way, and longer where TCP repeats it."""

    port: int
    least_s: float
    most_s: float


def part(*words: str) -> list[str]:
    """One of plant_parts.py."""
    return [str(Path(sys.executable).resolve()), "-I", "-S", "-B", str(PARTS), *words]


Programs = dict[str, tuple[float, list[str]]]  # of each name, when it starts and its words


class Front:
    """Who else looks at the gateway, or what else it has: a front, a master, programs, a journal."""

    has_disk = False  # its folder "data" is one

    @property
    def lines(self) -> dict[str, int]:
        """In a minute of the log, of a program of which it makes more than there are else."""
        return {}

    def configure(self, world: World, config: dict[str, Any], folder: Path) -> None:
        """Its part of the gateway's configuration."""

    def lay_out(self, world: World, folder: Path, gateway: Path) -> None:
        """Its files."""

    def programs(self, world: World, folder: Path, gateway: Path) -> Programs:
        return {}

    @property
    def processes(self) -> tuple[str, ...]:
        """Those that may be killed, or stop."""
        return ()

    @property
    def cables(self) -> tuple[str, ...]:
        """What may be cut beside the centre's connection."""
        return ()

    @property
    def points(self) -> tuple[str, ...]:
        """Those of no device."""
        return ()

    @property
    def counters(self) -> tuple[str, ...]:
        """Those of its points that are frozen, and stand still."""
        return ()

    @property
    def hosts(self) -> dict[str, str]:
        """The addresses of programs that are not at 127.0.0.1."""
        return {}

    def excuses(self, history: Any, found: list[Any]) -> list[Any]:
        """The violations of a rule that are left."""
        return found

    def judge(self, history: Any) -> Iterator[Any]:
        """Violations of the rules that it has besides."""
        yield from ()


@dataclass(frozen=True)
class World:
    """Lines of three devices, rtud with its modules, one controlling station, and the fronts beside."""

    seed: int
    seconds: float
    changes: tuple[Change, ...]
    faults: tuple[Fault, ...] = ()
    scanned: tuple[int, ...] = ()  # lines whose devices are read as often as the line allows
    lines: tuple[int, ...] = SERIAL
    links: tuple[Link, ...] = ()  # those with delay
    orders: tuple[Order, ...] = ()
    fronts: tuple[Front, ...] = ()
    devices: int = DEVICES  # of a line
    bits: bool = True  # each device has one beside its registers, and so two requests a period
    drift_ppm: int = 0  # of the calendar clock, against the other

    @property
    def units(self) -> list[tuple[int, int]]:
        return [(line, unit) for line in self.lines for unit in range(1, self.devices + 1)]

    def baud(self, line: int) -> int:
        return SLOW_BAUD if line in self.scanned else BAUD

    def slave(self, line: int, unit: int, configuration: Configuration) -> dict[str, Any]:
        registers = [
            {"address": place} for place in range(POINTS + 1) if configuration.has(unit, 30001 + place)
        ]
        period = {} if line in self.scanned else {"period_ms": configuration.period_ms}
        objects: dict[str, Any] = {"input_registers": registers}
        if self.bits:
            objects["discrete_inputs"] = [{"address": 0}]
        if self.orders:
            objects["holding_registers"] = [{"address": 0}]
        return {"id": unit, **period, **objects}

    @property
    def reloads(self) -> list[Fault]:
        return [fault for fault in self.faults if fault.kind == "reload"]

    @property
    def addresses(self) -> list[int]:
        """Of each device's information objects."""
        read = [*([10001] if self.bits else []), *range(30001, 30001 + POINTS)]
        return [*read, ORDERED] if self.orders else read

    def line(self, number: int, configuration: Configuration) -> dict[str, Any]:
        if number == NETWORKED:
            medium: dict[str, Any] = {"host": "127.0.0.1", "tcp_port": MODBUS_PORT}
        else:
            medium = {"baud_rate": self.baud(number), "data_bits": 8, "stop_bits": 1, "parity": 0}
        units = [unit for unit in range(1, self.devices + 1) if configuration.has(unit, 30001)]
        slaves = [self.slave(number, unit, configuration) for unit in units]
        return {"value": number, "active": 1, **medium, "slaves": slaves}

    def gateway(self, configuration: Configuration, folder: Path) -> dict[str, Any]:
        station = {"address": "127.0.0.1", "port": PORT}
        ring = {"event_ring": configuration.ring} if configuration.ring != Configuration().ring else {}
        ports = [self.line(number, configuration) for number in self.lines]
        config: dict[str, Any] = {"iec104": station, **ring, "port": ports}
        for front in self.fronts:
            front.configure(self, config, folder)
        return config

    @property
    def has_disk(self) -> bool:
        return any(front.has_disk for front in self.fronts)

    @property
    def points(self) -> dict[str, tuple[int, int]]:
        """Of all configurations: the unit of each, and its information object."""
        return {
            f"{line * 1000 + unit}.{address}": (unit, address)
            for line, unit in self.units
            for address in [*self.addresses, *([MORE] if self.reloads and unit == 1 else [])]
        }

    @property
    def counters(self) -> list[str]:
        """Those that are frozen, and stand still."""
        return [point for front in self.fronts for point in front.counters]

    @property
    def points_of_fronts(self) -> list[str]:
        return [point for front in self.fronts for point in front.points]

    @property
    def centre(self) -> dict[str, Any]:
        addresses = [line * 1000 + unit for line, unit in self.units]
        addresses += sorted({int(point.split(".")[0]) for point in self.points_of_fronts} - set(addresses))
        station = {
            "name": "rtu",
            "address": "127.0.0.1",
            "port": PORT,
            "common_addresses": addresses[:ADDRESSES_MAX],
        }
        period_s = 0 if self.seed % 2 else 20  # 0: what was missed once no later interrogation brings
        times = {"retry_ms": 500, "retry_max_ms": 2000}
        if self.links:
            times["t2"] = 5  # with its way an acknowledgement comes before t1
        return {"stations": [{**station, "interrogation_s": period_s}], **times}

    @property
    def script(self) -> list[str]:
        """What the field does, as linesim's commands."""
        told = [
            (change.at_s, f"set {change.device} {change.table} {change.address} {change.value}")
            for change in self.changes
        ]
        for fault in self.faults:
            begin, end = field_commands(fault)
            told += [(fault.at_s, begin)] if begin else []
            told += [(fault.end_s, end)] if end else []
        return [
            f"{BEGIN_NS + round(at_s * 1e9)} {command}" for at_s, command in sorted(told, key=itemgetter(0))
        ]

    @property
    def ordered(self) -> list[str]:
        """For the consumer."""
        return [
            f"{BEGIN_NS + round(order.at_s * 1e9)} {order.line * 1000 + order.unit} {order.value}"
            for order in self.orders
        ]

    @property
    def reloaded(self) -> list[str]:
        """For who operates the gateway."""
        return [
            f"{BEGIN_NS + round(one.at_s * 1e9)} {one.of} {'signal' if one.calls else 'rtuctl'}"
            for one in self.reloads
        ]

    def plan(self, folder: Path, gateway: Path) -> list[str]:
        """What the runner reads."""
        dev, consumer = folder / "dev", folder / "consumer"
        linesim = [f"{LINESIM}", "--tcp", "--whole", "--config", f"{folder}/field.json", "--dir", f"{dev}"]
        rtud = [f"{gateway}/rtud/rtud", "--uid-base", "0", "--map", f"{folder}/map", "--dev", f"{dev}"]
        rtud += ["--modules", f"{gateway}/modules", f"{folder}/gateway.json"]
        centre = [f"{gateway}/centre/rtu-centre", "--socket", f"{consumer}", f"{folder}/centre.json"]
        keep = ["keep-machine", f"{folder}/data", f"{folder}/map"] if self.has_disk else ["keep"]
        programs: Programs = {
            "linesim": (0.0, linesim),
            "gateway": (0.5, part(*keep, *rtud)),
            "centre": (1.0, part("keep", *centre)),
            "consumer": (1.5, part("consume", f"{consumer}", f"{folder}/orders")),
            "watch": (1.5, part("watch", f"{dev}/control")),
            "field": (1.5, part("change", f"{dev}/control", f"{folder}/script")),
        }
        if self.orders:
            programs["writes"] = (1.5, part("writes", f"{dev}/control"))
        if self.reloads:
            rtuctl = f"{gateway}/rtuctl/rtuctl"
            programs["reload"] = (1.5, part("reload", f"{folder}/map", f"{folder}", rtuctl))
        lines = [["end", f"{self.seconds}"]]
        for front in self.fronts:
            programs |= front.programs(self, folder, gateway)
            lines += [["host", name, address] for name, address in front.hosts.items()]
        for name, (at_s, words) in programs.items():
            lines.append(["start", name, f"{at_s}", f"{folder}/{name}.out", f"{folder}/{name}.log", *words])
        if self.has_disk:
            lines.append(["disk", f"{folder}/data"])
        if self.drift_ppm:
            lines.append(["drift", f"{self.drift_ppm}"])
        for link in self.links:
            lines.append(["delay", f"{link.port}", f"{link.least_s}", f"{link.most_s}"])
        for fault in self.faults:
            match fault.kind:
                case "kill":
                    lines.append(["kill", fault.of, f"{fault.at_s}", f"{fault.calls}", *fault.at_stores])
                    if fault.for_s:
                        lines.append(["starve", fault.of, f"{fault.at_s}", f"{fault.end_s}"])
                case "stop" | "memory":
                    words = [fault.kind, fault.of, f"{fault.at_s}", f"{fault.calls}", f"{fault.for_s}"]
                    lines.append([*words, *fault.at_stores])
                case "cut":
                    lines.append(["cut", fault.of, f"{fault.at_s}", f"{fault.end_s}"])
                case "blackout":
                    lines.append(["power", fault.of, f"{fault.at_s}", f"{fault.calls}"])
                case "full" | "refuses" | "worn":
                    lines.append([fault.kind, f"{fault.at_s}", f"{fault.end_s}"])
                case "step" | "leap":
                    lines.append([fault.kind, f"{fault.at_s}", f"{fault.by_s}"])
                case "lost":
                    lines.append(["lose", fault.of, f"{fault.at_s}"])
                case "power":
                    lines.append(["lose", fault.of, f"{fault.at_s}"])
                    lines.append(["kill", "rtu-centre", f"{fault.at_s}", "0"])
        return ["\t".join(line) for line in lines]


@dataclass(frozen=True)
class Account:
    """What a life of a process held, 20 s after its begin and later: descriptors, and KiB of memory."""

    process: str
    life: int
    first_descriptors: int
    most_descriptors: int
    first_kib: int
    last_kib: int


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
    def accounts(self) -> list[Account]:
        lines = [line.split() for line in (self.folder / "world.accounts").read_text().splitlines()]
        return [Account(name, *map(int, numbers)) for name, *numbers in lines]

    def log(self, program: str) -> list[str]:
        return (self.folder / f"{program}.log").read_text(errors="replace").splitlines()

    @property
    def speed(self) -> float:
        return self.world.seconds / self.real_s


def run(world: World, folder: Path, *, traced: bool = True, gateway: Path = GATEWAY) -> Run:
    """Raises PlantError. A trace of a day is long: two GB."""
    (folder / "dev").mkdir(parents=True)
    (folder / "gateway.json").write_text(json.dumps(world.gateway(CONFIGURATIONS[0], folder)))
    (folder / "field.json").write_text(
        json.dumps(world.gateway(WHOLE if world.reloads else CONFIGURATIONS[0], folder))
    )
    for number, configuration in enumerate(CONFIGURATIONS if world.reloads else ()):
        (folder / f"gateway-{number}.json").write_text(json.dumps(world.gateway(configuration, folder)))
    (folder / "reloads").write_text("".join(f"{line}\n" for line in world.reloaded))
    (folder / "centre.json").write_text(json.dumps(world.centre))
    (folder / "orders").write_text("".join(f"{order}\n" for order in world.ordered))
    (folder / "script").write_text("\n".join(world.script) + "\n")
    for front in world.fronts:
        front.lay_out(world, folder, gateway)
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
