# SPDX-License-Identifier: GPL-3.0-or-later
"""What the devices of a world held, what was written into them, and what a control centre was told."""

from __future__ import annotations

import itertools
from bisect import bisect_right
from collections import defaultdict
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol

from plant_world import (
    BEGIN_NS,
    CABLE,
    CONFIGURATIONS,
    MODBUS_PORT,
    ORDERED,
    PORT,
    Change,
    Configuration,
    Fault,
    Run,
)

WALL_NS = 1767225600 * 10**9  # main.c
S = 10**9
CALL_WITHIN_S = 10.0  # main.c
PASSED_ON_S = 1.0
NEXT_S = 0.002  # a time tag has milliseconds
LOST_DELAYS = 3  # flights.c: of what is lost and repeated, at most
CHANGED_S = 5.0  # from the end of a reload until all has been read by it
EVENTS = (3, 11)  # spontaneous, and what a command has changed
END_OF_INITIALIZATION = 70  # M_EI_NA_1
LINK_UP, LINK_DOWN = 3, 4
CENTRE = "rtu-centre"


@dataclass(frozen=True)
class Violation:
    """Something that must not be; `rule` names what docs/plant.md says."""

    rule: str
    at_s: float
    text: str

    def __str__(self) -> str:
        return f"{self.at_s:.3f} s: {self.rule}: {self.text}"


@dataclass(frozen=True)
class Write:
    """A register that was written by a master."""

    at_s: float
    device: str
    address: int
    value: int

    @property
    def point(self) -> str:
        line, unit = self.device.split(".")
        return f"{int(line) * 1000 + int(unit)}.{ORDERED + self.address}"


class Dated(Protocol):
    """Of a point, however it was told."""

    @property
    def at_s(self) -> float: ...
    @property
    def tag_s(self) -> float | None: ...
    @property
    def good(self) -> bool: ...


@dataclass(frozen=True)
class Told:
    """A value that came to the consumer."""

    at_s: float
    point: str
    value: int
    good: bool
    tag_s: float | None
    cause: int
    session: int  # counts the connections of the station over all lives of the centre

    @property
    def as_good(self) -> Told:
        return replace(self, good=True)

    def __str__(self) -> str:
        of = "" if self.tag_s is None else f" of {self.tag_s:.3f} s"
        return f"{self.value}, {'good' if self.good else 'not good'}{of}"


def seconds(time_ns: int) -> float:
    return (time_ns - BEGIN_NS) / S


def change_of(at_s: float, command: str) -> Change:
    """That a device took: the one of the script, when it came to it."""
    _, device, table, address, value = command.split()
    return Change(at_s, device, table, int(address), int(value))


def seen(fault: Fault) -> Fault:
    """As what: without power rtud ends, and all with it."""
    return replace(fault, kind="kill", of="rtud") if fault.kind == "blackout" else fault


def held_until_s(hold: Fault) -> float:
    """A stop waits for its call; then what waited is dealt with."""
    return hold.end_s + (CALL_WITHIN_S if hold.kind == "stop" else 0.0) + PASSED_ON_S


@dataclass(frozen=True)
class Master:
    """A control centre: its process, and who takes what that is told."""

    process: str = CENTRE
    consumer: str = "consumer"

    def sees(self, fault: Fault) -> Fault:
        """Its own process is the centre, that of another is nothing to it."""
        return replace(fault, of={CENTRE: "another", self.process: CENTRE}.get(fault.of, fault.of))


class History:
    """What the devices held, and what a centre was told."""

    def __init__(self, run: Run, master: Master | None = None) -> None:
        self.run = run
        self.master = master or Master()
        self.faults = tuple(self.master.sees(seen(fault)) for fault in run.world.faults)
        self.end_s = run.world.seconds

    @cached_property
    def held(self) -> dict[str, list[tuple[float, int]]]:
        """Of each point, from when on it had which value."""
        held: dict[str, list[tuple[float, int]]] = {
            point: [(float("-inf"), 0)] for point in self.run.world.points
        }
        for write in self.writes:
            held[write.point].append((write.at_s, write.value))
        for line in self.run.told("field"):
            if line["command"].startswith("set "):
                change = change_of(seconds(line["at"]), line["command"])
                if change.point in held:
                    held[change.point].append((change.at_s, change.value))
        return held

    @cached_property
    def writes(self) -> list[Write]:
        if not self.run.world.orders:
            return []
        return [
            Write(seconds(line["at"]), f"{line['port']}.{line['unit']}", line["address"], line["value"])
            for line in self.run.told("writes")
        ]

    @cached_property
    def ordered(self) -> dict[int, list[tuple[float, int, int]]]:
        """Of each command that was sent, when it came into which state, with which result."""
        ordered: dict[int, list[tuple[float, int, int]]] = {}
        for line in self.run.told("consumer"):
            if line["kind"] == "order":
                ordered[line["order"]] = []
            elif line["kind"] == "progress":
                ordered[line["order"]].append((seconds(line["at"]), line["state"], line["result"]))
        return ordered

    @cached_property
    def configured(self) -> list[tuple[float, float, Configuration]]:
        """From when to when which was in force, without the time of its change."""
        configured, since_s, now = [], 0.0, CONFIGURATIONS[0]
        for line in self.run.told("reload") if self.run.world.reloads else []:
            at_s = seconds(line["at"])
            if line["kind"] == "asked":
                configured.append((since_s, at_s, now))
                since_s, now = float("inf"), CONFIGURATIONS[line["configuration"]]
            elif line["kind"] == "in force":
                since_s = at_s + CHANGED_S
        return [*configured, (since_s, float("inf"), now)]

    def has(self, point: str, from_s: float, to_s: float) -> bool:
        """The point is there all that time."""
        return any(
            since_s <= from_s and to_s <= until_s and configuration.has(*self.run.world.points[point])
            for since_s, until_s, configuration in self.configured
        )

    def has_not(self, point: str, from_s: float, to_s: float) -> bool:
        """It is not there all that time."""
        return any(
            since_s <= from_s and to_s <= until_s and not configuration.has(*self.run.world.points[point])
            for since_s, until_s, configuration in self.configured
        )

    def dead_times(self, device: str) -> list[tuple[float, float]]:
        """When its points are told as not good."""
        line, unit = device.split(".")
        dead, since_s = [], None
        for event in self.events.get(f"{int(line) * 1000 + int(unit)}.30001", []):
            if not event.good and since_s is None:
                since_s = event.tag_s
            elif event.good and since_s is not None:
                dead.append((since_s, event.tag_s or 0.0))
                since_s = None
        return dead if since_s is None else [*dead, (since_s, self.end_s)]

    @cached_property
    def answers(self) -> list[tuple[float, dict[str, int]]]:
        """How many requests each device had answered until then."""
        return [(seconds(line["at"]), line["answers"]) for line in self.run.told("watch")]

    @cached_property
    def told(self) -> list[Told]:
        """Of devices' points."""
        others = set(self.run.world.points_of_fronts)
        return [told for told in self.all_told if told.point not in others]

    @cached_property
    def all_told(self) -> list[Told]:
        told, session, connection = [], 0, None
        for line in self.run.told(self.master.consumer):
            if line["kind"] == "centre is gone" or line.get("state") == LINK_UP:
                session += 1
                connection = None
            if line["kind"] != "value" or line["type"] == END_OF_INITIALIZATION:
                continue
            if connection is not None and line["connection"] != connection:
                session += 1
            connection = line["connection"]
            told.append(self._of(line, session))
        return told

    @cached_property
    def steps(self) -> list[Fault]:
        return [fault for fault in self.faults if fault.kind in ("step", "leap")]

    def tag_s(self, tag_ns: int, at_s: float) -> float:
        """In plant time: by the calendar clock of a time before it came, as which it is the latest."""
        ahead_s = itertools.accumulate([step.by_s for step in self.steps if step.at_s < at_s], initial=0.0)
        by_each = [self.by_the_calendar(tag_ns, ahead) for ahead in ahead_s]
        leaps = [step.at_s for step in self.steps if step.kind == "leap" and step.at_s < at_s]
        if leaps:  # a second is too short to tell it from the way: the time says whether it is before
            return by_each[-1] if by_each[-1] >= leaps[-1] - NEXT_S else by_each[-2]
        return max((tag_s for tag_s in by_each if tag_s < at_s + NEXT_S), default=by_each[-1])

    @property
    def drift_s(self) -> float:
        """Of the calendar clock, over the whole time."""
        return abs(self.run.world.drift_ppm) / 1e6 * self.end_s

    def by_the_calendar(self, tag_ns: int, ahead_s: float) -> float:
        """A drift is by the other clock."""
        return round(((tag_ns - WALL_NS) / S - ahead_s) / (1 + self.run.world.drift_ppm / 1e6), 3)

    def _of(self, line: dict[str, Any], session: int) -> Told:
        tag, at_s = line["tag"], seconds(line["at"])
        return Told(
            at_s=at_s,
            point=line["point"],
            value=line["value"],
            good=line["quality"] == 0,
            tag_s=None if tag is None else self.tag_s(tag, at_s),
            cause=line["cause"],
            session=session,
        )

    @cached_property
    def events(self) -> dict[str, list[Told]]:
        """With a time tag, of each point, in the order in which they came."""
        events = defaultdict(list)
        for told in self.told:
            if told.tag_s is not None and told.cause in EVENTS:
                events[told.point].append(told)
        return events

    def held_within(self, point: str, value: int, from_s: float, to_s: float) -> bool:
        held = self.held[point]
        first = max(0, bisect_right(held, (from_s, -1)) - 1)
        return any(has == value for since, has in held[first:] if since <= to_s)

    @property
    def way_s(self) -> float:
        """To the centre, at most."""
        return sum(LOST_DELAYS * link.most_s for link in self.run.world.links if link.port == PORT)

    @cached_property
    def holds(self) -> list[Fault]:
        """What holds up what is told, the last first."""
        field = ("rtu-modbus-1", "linesim", f"{MODBUS_PORT}", CABLE)
        holds = [fault for fault in self.faults if fault.kind in ("stop", "cut") and fault.of not in field]
        return sorted(holds, key=held_until_s, reverse=True)

    def delay_s(self, at_s: float) -> float:
        """How long it may have been held up, one behind the other, what came then; and its way."""
        since_s = at_s - self.way_s
        for hold in self.holds:
            if hold.at_s < since_s <= held_until_s(hold):
                since_s -= min(hold.for_s, since_s - hold.at_s)
        return at_s - since_s
