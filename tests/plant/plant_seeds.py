# SPDX-License-Identifier: GPL-3.0-or-later
"""What a seed makes of a world: what its devices hold, and what fails."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

from front_counter import Counter
from front_disk import Disk
from front_goose import Goose
from front_journal import Journal
from front_kept import Kept
from front_logic import Logic
from front_masters import SecondMaster
from front_mms import Mms
from front_outstation import Outstation
from front_queue import ShortQueue
from front_snmp import Snmp
from front_strangers import Strangers
from plant_history import CALL_WITHIN_S
from plant_world import (
    CHANGES_FROM_S,
    CONFIGURATIONS,
    DEVICES,
    MODBUS_PORT,
    NETWORKED,
    POINTS,
    PORT,
    RECOVERY_S,
    SERIAL,
    SETTLED_S,
    Change,
    Fault,
    Front,
    Link,
    Order,
    World,
)

FAULTS_FROM_S = 10.0
ALL_FRONTS = 5  # a seed that it divides
OVERFULL, OVERFULL_FIRST = 12, 7
MODULES = ("rtu-modbus-1", "rtu-iec104", "rtud", "rtu-centre")
CALLS_MAX = 200
WRITING_PART, WRITING_CALLS_MAX = 0.5, 20
STORES_MAX, RARE_MAX, RARE_PART = 1000, 24, 0.7
LOST_ONE_OF = 3  # cuts
BAD_S, QUIET_S = 60.0, 80.0
KILLS_APART_S = 10.0  # two in one instant of the plant would tell the same twice
LINE_LONGEST_S = 40.0
LATEST_S = 3.0
STORING = ("rtu-journal", "rtu-journal", "rtud")  # who loses power at a call of theirs
STORING_CALLS = 40
DISK_LONGEST_S = 30.0
STALLS_MAX = 20
STALL_LONGEST_S = 3.0
STALL_CALLS_MAX = 20
LONGEST_S = {"stop": 20.0, "silent": 20.0, "cut": 40.0}
SESSION_FAULTS = ("hung", "closing", "tearing", "idling", "cut", "lost", "late", "silent", "unplugged")
CLOSINGS = ("closing", "tearing", "idling")
CLOSED_APART_S = 2.0
CONNECTED_S = 20.0  # by then a connection over GPRS is made: what was before is no event
SESSION_LONGEST_S = 30.0
BESIDE_A_LEAP_S = 3.0  # rtud has to be there to see it
AWAY_S, AWAY_PART = (30.0, 90.0), 0.2
QUEUED_EACH_S = 0.25  # changes: a short queue is full within half a minute
STARVED_S, STARVED_PART = 8.0, 0.5
REFUSED_EACH_S = (10.0, 40.0)
STORM_S = (10.0, 25.0)
DRIFT_PPM = 500  # as much as a daemon may slew a clock
LEAST_STEP_S = 1000.0
FAR_LINES = (1, NETWORKED)
SIX, FIVE = tuple(range(1, 7)), 5  # lines, and devices of each
GPRS, RADIO, FIELD_BUS = Link(PORT, 0.6, 1.5), Link(PORT, 0.05, 0.4), Link(MODBUS_PORT, 0.002, 0.02)


@dataclass
class Field:
    """What devices hold: values that never come twice, so that each report says which change it is of."""

    random: random.Random
    seconds: float
    lines: tuple[int, ...] = SERIAL
    next_value: int = 1
    bits: dict[str, int] = field(default_factory=dict)
    modules: tuple[str, ...] = MODULES
    cables: tuple[str, ...] = ()
    devices: int = DEVICES

    def line(self) -> int:
        return self.lines[self.random.randrange(len(self.lines))]

    def device(self) -> str:
        return f"{self.line()}.{self.random.randrange(self.devices) + 1}"

    def change(self, at_s: float) -> Change:
        device = self.device()
        if self.random.random() < 0.2:
            self.bits[device] = 1 - self.bits.get(device, 0)
            return Change(at_s, device, "discrete_inputs", 0, self.bits[device])
        self.next_value = self.next_value % 32000 + 1
        if self.lines == FAR_LINES and self.random.random() < 0.1:
            return Change(at_s, f"{self.line()}.1", "input_registers", POINTS, self.next_value)
        return Change(at_s, device, "input_registers", self.random.randrange(POINTS), self.next_value)

    def register_change(self, at_s: float) -> Change:
        self.next_value = self.next_value % 32000 + 1
        place = self.random.randrange(POINTS)
        return Change(at_s, self.device(), "input_registers", place, self.next_value)

    def times(self, from_s: float, to_s: float, mean_s: float) -> Iterator[float]:
        at_s = from_s
        while (at_s := at_s + self.random.expovariate(1 / mean_s)) < to_s:
            yield round(at_s, 3)

    def changes(self, mean_s: float, from_s: float = CHANGES_FROM_S) -> tuple[Change, ...]:
        end_s = self.seconds - SETTLED_S
        return tuple(self.change(at_s) for at_s in self.times(from_s, end_s, mean_s))

    def fault(self, at_s: float) -> Fault:
        kind = self.random.choice(("kill", "stop", "silent", "cut"))
        for_s = round(LONGEST_S[kind] * self.random.random() ** 3, 3) if kind != "kill" else 0.0
        calls = self.random.randrange(CALLS_MAX)
        match kind:
            case "silent":
                return Fault(at_s, kind, self.device(), for_s=for_s)
            case "cut" if calls % LOST_ONE_OF == 0:
                return Fault(at_s, "power" if calls % 2 else "lost", f"{PORT}")
            case "cut" if self.cables:
                return Fault(at_s, kind, self.random.choice((f"{PORT}", *self.cables)), for_s=for_s)
            case "cut":
                return Fault(at_s, kind, f"{PORT}", for_s=for_s)
            case _:
                return Fault(at_s, kind, self.random.choice(self.modules), calls, for_s)

    def disk_fault(self, at_s: float) -> Fault:
        kind = self.random.choice(("blackout", "blackout", "full", "refuses", "worn"))
        if kind == "blackout":
            return Fault(at_s, kind, self.random.choice(STORING), self.random.randrange(STORING_CALLS))
        return Fault(at_s, kind, "disk", for_s=round(DISK_LONGEST_S * self.random.random() ** 2, 3))

    def queued_fault(self, at_s: float) -> Fault:
        if self.random.random() < AWAY_PART:
            return Fault(at_s, "cut", f"{PORT}", for_s=round(self.random.uniform(*AWAY_S), 3))
        return self.fault(at_s)

    def stored_fault(self, at_s: float) -> Fault:
        return self.random.choice((self.fault, self.disk_fault))(at_s)

    def order(self, at_s: float, value: int) -> Order:
        line, unit = map(int, self.device().split("."))
        return Order(at_s, line, unit, value)

    def orders(self, mean_s: float) -> tuple[Order, ...]:
        times = self.times(CHANGES_FROM_S, self.seconds - SETTLED_S, mean_s)
        return tuple(self.order(at_s, value) for value, at_s in enumerate(times, 1))

    def session_fault(self, at_s: float) -> Fault:
        """Of what is behind Modbus TCP."""
        kind = self.random.choice(SESSION_FAULTS)
        for_s = round(SESSION_LONGEST_S * self.random.random() ** 2, 3)
        part = self.random.random()
        match kind:
            case "hung":
                return Fault(at_s, kind, f"{NETWORKED}")
            case "cut":
                return Fault(at_s, kind, f"{MODBUS_PORT}", for_s=for_s)
            case "lost":
                return Fault(at_s, kind, f"{MODBUS_PORT}")
            case "late":
                return Fault(at_s, kind, self.device(), for_s=for_s, late_s=round(LATEST_S * part**2, 3))
            case "silent":
                return Fault(at_s, kind, self.device(), for_s=for_s)
            case "tearing":
                return Fault(at_s, kind, f"{NETWORKED}", self.random.choice((5, 7)), for_s)
            case "idling":
                return Fault(at_s, kind, f"{NETWORKED}", for_s=for_s, late_s=round(0.05 + part, 3))
            case _:
                return Fault(at_s, kind, f"{NETWORKED}", for_s=for_s)

    def step(self, at_s: float) -> Fault:
        """Long ones: the judge must know of each time tag whether it is of before."""
        by_s = LEAST_STEP_S * (1 + 99 * self.random.random() ** 2)
        return Fault(at_s, "step", "clock", by_s=round(by_s * self.random.choice((1, -1)), 3))

    def reload(self, at_s: float) -> Fault:
        number = self.random.randrange(len(CONFIGURATIONS))
        return Fault(at_s, "reload", f"{number}", calls=round(at_s * 1000) % 2)

    def far_fault(self, at_s: float) -> Fault:
        make = self.random.choice(
            (self.session_fault, self.session_fault, self.fault, self.step, self.reload)
        )
        return make(at_s)

    def made_by(self, make: Callable[[float], Fault], mean_s: float) -> tuple[Fault, ...]:
        end_s = self.seconds - RECOVERY_S
        made = (make(at_s) for at_s in self.times(FAULTS_FROM_S, end_s, mean_s))
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
        kind = self.random.choice(("silent", "late", "deaf", "unplugged", "stalls", "kill"))
        for_s = round(LINE_LONGEST_S * self.random.random() ** 2, 3)
        late_s = round(LATEST_S * self.random.random() ** 2, 3)
        match kind:
            case "stalls":
                yield from self.stalls(at_s)
            case "kill":
                yield Fault(at_s, kind, "rtu-modbus-1", self.random.randrange(CALLS_MAX))
            case "unplugged":
                yield Fault(at_s, kind, f"{self.line()}", for_s=for_s)
            case "deaf":
                yield Fault(at_s, kind, self.device(), for_s=round(for_s / 2, 3), late_s=late_s)
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


def with_one_closing(faults: tuple[Fault, ...]) -> tuple[Fault, ...]:
    """A line closes its sessions in one way at a time: two may look like a peer that never answers."""
    kept: list[Fault] = []
    until_s = 0.0
    for fault in faults:
        if fault.kind in CLOSINGS:
            if fault.at_s < until_s:
                continue
            until_s = fault.end_s + CLOSED_APART_S
        kept.append(fault)
    return tuple(kept)


def modules_of(fronts: tuple[Front, ...]) -> tuple[str, ...]:
    return (*MODULES, *(name for front in fronts for name in front.processes))


def writes_the_map(process: str) -> bool:
    return process == "rtud" or (process.startswith("rtu-") and not process.startswith("rtu-centre"))


def at_a_store(chance: random.Random, fault: Fault) -> Fault:
    """Most stores are into what counts something: those into anything else are seldom hit by their number."""
    rare = chance.random() < RARE_PART
    stores = chance.randrange(1, RARE_MAX) if rare else round(STORES_MAX ** chance.random())
    return replace(fault, calls=fault.calls % WRITING_CALLS_MAX, stores=stores, rare=rare)


def between_stores(world: World) -> World:
    """Half of those who write the map die and stop between two of their stores into it."""
    chance = random.Random(world.seed)
    faults = tuple(
        at_a_store(chance, fault)
        if fault.kind in ("kill", "stop") and writes_the_map(fault.of) and chance.random() < WRITING_PART
        else fault
        for fault in world.faults
    )
    return replace(world, faults=faults)


def calm(seed: int, seconds: float) -> World:
    """Nothing fails."""
    return World(seed, seconds, Field(random.Random(seed), seconds).changes(mean_s=1.0))


def troubled(seed: int, seconds: float, fault_every_s: float = 30.0, fronts: tuple[Front, ...] = ()) -> World:
    """Modules die and stop, devices are silent, the link to the centre is cut."""
    cables = tuple(name for front in fronts for name in front.cables)
    of_seed = Field(random.Random(seed), seconds, modules=modules_of(fronts), cables=cables)
    changes = of_seed.changes(mean_s=1.0)
    return World(seed, seconds, changes, of_seed.made_by(of_seed.fault, fault_every_s), fronts=fronts)


def is_beside(fault: Fault, at_s: float) -> bool:
    return fault.at_s < at_s + BESIDE_A_LEAP_S and at_s < fault.end_s + CALL_WITHIN_S + BESIDE_A_LEAP_S


def with_a_clock(world: World) -> World:
    """Whose calendar drifts and leaps by a second. Nothing changes then: what is told of it has two times."""
    chance = random.Random(world.seed)
    at_s = float(chance.randrange(int(FAULTS_FROM_S), int(world.seconds - RECOVERY_S)))
    leap = Fault(at_s, "leap", "clock", by_s=float(chance.choice((-1, 1))))
    changes = tuple(change for change in world.changes if abs(change.at_s - at_s) > BESIDE_A_LEAP_S)
    apart = [fault for fault in world.faults if fault.of != "rtud" or not is_beside(fault, at_s)]
    faults = tuple(sorted((*apart, leap), key=lambda fault: fault.at_s))
    drift_ppm = chance.choice((-1, 1)) * chance.randrange(1, DRIFT_PPM + 1)
    return replace(world, changes=changes, faults=faults, drift_ppm=drift_ppm)


def without_memory(world: World, modules: tuple[str, ...]) -> World:
    """Some that are killed begin without memory for a while, and some get none while they run."""
    chance = random.Random(world.seed)
    faults = [
        replace(fault, for_s=round(STARVED_S * chance.random(), 3))
        if fault.kind == "kill" and fault.of in modules and chance.random() < STARVED_PART
        else fault
        for fault in world.faults
    ]
    at_s = FAULTS_FROM_S
    while (at_s := at_s + chance.uniform(*REFUSED_EACH_S)) < world.seconds - RECOVERY_S:
        of, calls = chance.choice(modules), chance.randrange(CALLS_MAX)
        faults.append(Fault(round(at_s, 3), "memory", of, calls, round(chance.uniform(1.0, 10.0), 3)))
    return replace(world, faults=tuple(sorted(faults, key=lambda fault: fault.at_s)))


def with_storms(world: World) -> World:
    """Before the power the link to the centre goes: what happens then is in the journal alone."""
    chance = random.Random(world.seed)
    cuts = []
    for fault in world.faults:
        before_s, behind_s = (round(chance.uniform(*STORM_S), 3) for _ in range(2))
        at_s = fault.at_s - before_s
        if (
            fault.kind == "blackout"
            and at_s > FAULTS_FROM_S
            and fault.at_s + behind_s < world.seconds - RECOVERY_S
        ):
            cuts.append(Fault(round(at_s, 3), "cut", f"{PORT}", for_s=round(before_s + behind_s, 3)))
    return replace(world, faults=tuple(sorted((*world.faults, *cuts), key=lambda fault: fault.at_s)))


def stored(seed: int, seconds: float, fault_every_s: float = 30.0) -> World:
    """The same, of a gateway with a journal that loses its power, and whose disk fails."""
    disk = (Disk(), Kept())
    of_seed = Field(random.Random(seed), seconds, modules=modules_of(disk))
    changes = of_seed.changes(mean_s=1.0)
    world = World(seed, seconds, changes, of_seed.made_by(of_seed.stored_fault, fault_every_s), fronts=disk)
    return without_memory(with_storms(world), modules_of(disk))


def overfull(seed: int, seconds: float, fault_every_s: float = 30.0) -> World:
    """The centre is away for longer than its queue has room for."""
    of_seed = Field(random.Random(seed), seconds)
    changes = of_seed.changes(mean_s=QUEUED_EACH_S)
    faults = of_seed.made_by(of_seed.queued_fault, fault_every_s)
    return World(seed, seconds, changes, faults, fronts=(ShortQueue(),))


def restless(seed: int, seconds: float, fault_every_s: float = 8.0) -> World:
    """Devices are silent or late, lines are unplugged, the host is busy; then all is well for some time."""
    of_seed = Field(random.Random(seed), seconds)
    changes = of_seed.changes(mean_s=1.0)
    return World(seed, seconds, changes, of_seed.bad_phases(fault_every_s), scanned=(2,))


def far(seed: int, seconds: float, fault_every_s: float = 8.0) -> World:
    """Devices behind Modbus TCP hang up, hang, and cannot be reached, and are commanded."""
    of_seed = Field(random.Random(seed), seconds, FAR_LINES)
    changes = of_seed.changes(mean_s=1.0, from_s=CONNECTED_S)
    faults = with_one_closing(of_seed.made_by(of_seed.far_fault, fault_every_s))
    links = (of_seed.random.choice((GPRS, RADIO)), FIELD_BUS)
    orders = of_seed.orders(mean_s=3.0)
    return World(seed, seconds, changes, faults, lines=FAR_LINES, links=links, orders=orders)


def fronts(groups: bool) -> tuple[Front, ...]:
    return (
        SecondMaster(groups),
        Logic(),
        Journal(),
        Counter(),
        Snmp(),
        Mms(),
        Goose(),
        Outstation(),
        Kept(fails=True),
    )


def large(seed: int, seconds: float) -> World:
    """Six lines with thirty devices, read once a second each, and all that looks at them; nothing changes."""
    return World(seed, seconds, (), lines=SIX, fronts=fronts(groups=True), devices=FIVE, bits=False)


def storm(seed: int, seconds: float) -> World:
    """The same, and each second as many registers change as there are."""
    world = large(seed, seconds)
    of_seed = Field(random.Random(seed), seconds, SIX, devices=FIVE)
    end_s = seconds - SETTLED_S
    times = of_seed.times(CHANGES_FROM_S, end_s, 1.0 / (len(world.units) * POINTS))
    return replace(world, changes=tuple(of_seed.register_change(at_s) for at_s in times))


WORLDS = {"large": large, "storm": storm}


def world_of(seed: int, seconds: float, fault_every_s: float = 30.0) -> World:
    return between_stores(kind_of(seed, seconds, fault_every_s))


def kind_of(seed: int, seconds: float, fault_every_s: float) -> World:
    """Each fifth has all fronts, and of the others each twelfth is overfull.

    Of six others two are about lines, two far away, one a disk.
    """
    if seed % ALL_FRONTS == 0:
        return troubled(seed, seconds, fault_every_s, fronts(groups=bool(seed % 2)))
    if seed % OVERFULL == OVERFULL_FIRST:
        return overfull(seed, seconds, fault_every_s)
    match seed % 6:
        case 0 | 3:
            return restless(seed, seconds)
        case 1:
            return with_a_clock(troubled(seed, seconds, fault_every_s, (Strangers(),)))
        case 4:
            return stored(seed, seconds, fault_every_s)
    return far(seed, seconds, fault_every_s)
