# SPDX-License-Identifier: GPL-3.0-or-later
"""What must hold in each world, seen from outside: docs/plant.md has a sentence for each."""

from __future__ import annotations

import itertools
from bisect import bisect_right
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from plant_world import (
    BEGIN_NS,
    CABLE,
    CHANGES_FROM_S,
    CONFIGURATIONS,
    JOURNAL,
    MODBUS_PORT,
    NETWORKED,
    ORDERED,
    PORT,
    RECOVERY_S,
    SETTLED_S,
    Change,
    Configuration,
    Fault,
    Order,
    Run,
)

WALL_NS = 1767225600 * 10**9  # main.c
S = 10**9
AGE_S = 3.0
HELD_S = 5.0
RETURN_S = 1.0  # from its first words until a module is told to be back
SAME_S = 0.1  # rtud looks at heartbeats every 50 ms
CALL_WITHIN_S = 10.0  # main.c
PASSED_ON_S = 1.0
NEXT_S = 0.002  # a time tag has milliseconds
LOST_DELAYS = 3  # flights.c: of what is lost and repeated, at most
AFTER_S = 15.0  # what is behind a fault may still be its consequence
RAREST_S = 65.0  # the longest pause before a probe, and the probe (docs/limit.md)
PROBED_S = 5.0  # a device that lived for long before is probed so soon after it was dead for as long again
INVALID_S = 5.0  # from the last answer of a device until its points are told invalid
DOUBTED_S = 5.0  # the first pause that a device seems to need (docs/limit.md)
WINDOW_S = 10
CHANGED_S = 5.0  # from the end of a reload until all has been read by it
CONNECTIONS = 16  # of rtu-iec104; of others there are fewer
GROWTH_KIB = 1024  # pages that are used later
LINES_AT_ONCE = 40  # about peers, of a program that has begun (docs/telecontrol.md)
LINES_A_MINUTE = 60  # of a program: worlds with a fault every 8 s have half as many
MINUTE = len("2026-01-01T00:00")
ANSWERS_LEAST = 15  # of a device that lives, in each window: two reads a second, and a neighbour's time-outs
JOURNAL_S = 90.0  # what waits in a gateway without a journal, and is lost with rtud
RECORDED_S = 5.0  # until an event is in the journal: it is read, waits for the next record, and is written
READERS = ("rtud", "rtu-modbus-1")
DISK = ("full", "refuses", "worn")
BEGINS_ANEW = ("kill", "stop", "hung", "cut", "lost")  # a process, or a connection
EVENTS = (3, 11)  # spontaneous, and what a command has changed
EXECUTED, REFUSED = 9, 8
NOT_SENT = (6, 7, 64, 65, 66)  # docs/centre.md
ORDER_S = 5.0  # a command takes that long where nothing fails, besides its ways
END_OF_INITIALIZATION = 70  # M_EI_NA_1
LINK_UP, LINK_DOWN = 3, 4
CENTRE = "rtu-centre"
ENDS_OF_CONNECTION = ("rtu-iec104", "rtud", CENTRE, f"{PORT}")
ENDS_CONNECTION_S = {"kill": 15.0, "stop": 15.0, "cut": 20.0, "lost": 45.0, "power": 45.0}


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


def age_s(history: History, told: Told) -> float:
    """How old a value may be at its time tag, or as it comes. What is not good is an old one's."""
    if not told.good:
        return float("inf")
    return AGE_S + (history.delay_s(told.at_s) if told.tag_s is None else 0.0)


def values_are_true(history: History) -> Iterator[Violation]:
    """Good is what its device held shortly before. What is not good, it held at some time before."""
    for told in history.told:
        until_s = told.at_s if told.tag_s is None else told.tag_s
        from_s = until_s - age_s(history, told)
        if told.point not in history.held:
            yield Violation("no value of nobody", told.at_s, f"{told.point} is {told.value}")
        elif not history.held_within(told.point, told.value, from_s, until_s + 0.001):
            yield Violation("true", told.at_s, f"{told.point} is told as {told}")


def is_told_twice(event: Told, before: Told) -> bool:
    """Within a connection. A module may be lost twice in a millisecond: silent, and then killed."""
    what = (event.session, event.tag_s, event.value, event.good)
    return event.good and what == (before.session, before.tag_s, before.value, before.good)


def tells_the_same(event: Told, other: Told) -> bool:
    return (event.value, event.good) == (other.value, other.good)


def is_followed(event: Told, lost: Told, later: list[Told]) -> bool:
    """What a module read before it was lost, and tells behind that: its return is told as well."""
    return not lost.good and any(
        (lost.tag_s or 0) < (other.tag_s or 0) and other.at_s <= event.at_s + RETURN_S for other in later
    )


def was_told(event: Told, told: list[Told], slack_s: float) -> bool:
    """As then; as the calendar clock drifts meanwhile, its time tag is another one."""
    return any(
        abs((event.tag_s or 0) - (other.tag_s or 0)) <= slack_s
        and event.good == other.good
        and (event.value == other.value or not event.good)
        for other in told
    )


def events_are_in_order(history: History) -> Iterator[Violation]:
    """Within a connection none comes twice, or after a later one; a new connection may repeat."""
    for point, events in history.events.items():
        latest = events[0]
        for place, (before, event) in enumerate(zip([None, *events[:-1]], events, strict=True), 1):
            if before and is_told_twice(event, before):
                yield Violation("once", event.at_s, f"{point} of {event.tag_s:.3f} s")
            goes_back = (event.tag_s or 0) < (latest.tag_s or 0) and not tells_the_same(event, latest)
            goes_back = goes_back and not is_followed(event, latest, events[place:])
            before_it = [] if event.session == latest.session else events[: place - 1]
            if goes_back and not was_told(event, before_it, history.drift_s):
                yield Violation("order", event.at_s, f"{point}: {event} after {latest}")
            latest = max(latest, event, key=lambda told: told.tag_s or 0)


def is_trouble_of(device: str, fault: Fault) -> bool:
    """It may keep the device from being read. What comes late falls into what others say on the line."""
    line = device.split(".")[0]
    if fault.kind in ("reload", "closing", "tearing", "idling", "memory", *DISK):
        return False
    if fault.kind in ("cut", "lost", "power"):
        return (line, fault.of) == (f"{NETWORKED}", f"{MODBUS_PORT}")
    if fault.kind == "late":
        return fault.of.split(".")[0] == line
    return fault.of in ("rtu-modbus-1", "rtud", "linesim", device, line)


def doubted_s(fault: Fault) -> float:
    """Until none is tried in the place of a pause that it needed: after 5 s, and twice as long each time."""
    return fault.for_s + DOUBTED_S if fault.kind == "deaf" else 0.0


def is_read_again_s(fault: Fault, troubles: list[Fault]) -> float:
    """From when on a device must be read as ever, by what docs/limit.md says of its probes."""
    lived = not any(fault.at_s - RAREST_S < other.end_s and other.at_s < fault.at_s for other in troubles)
    begins_later_s = AFTER_S if fault.kind in BEGINS_ANEW else 0.0
    probed_s = max(AFTER_S, fault.for_s + PROBED_S) if lived else RAREST_S
    return fault.end_s + doubted_s(fault) + begins_later_s + probed_s


def troubled_times(device: str, faults: tuple[Fault, ...]) -> list[tuple[float, float]]:
    """When the device may not be read as it should."""
    troubles = [fault for fault in faults if is_trouble_of(device, fault)]
    return [(fault.at_s, is_read_again_s(fault, troubles)) for fault in troubles]


def overlaps(times: list[tuple[float, float]], from_s: float, to_s: float) -> bool:
    return any(begin_s < to_s and from_s < end_s for begin_s, end_s in times)


def direct_times(device: str, faults: tuple[Fault, ...]) -> list[tuple[float, float]]:
    """When a device that answers may be read too seldom."""
    return [
        (fault.at_s, fault.end_s + doubted_s(fault) + (AFTER_S if fault.kind in BEGINS_ANEW else PROBED_S))
        for fault in faults
        if is_trouble_of(device, fault)
    ]


def device_of(point: str) -> str:
    ca = int(point.split(".")[0])
    return f"{ca // 1000}.{ca % 1000}"


def unwritten_from_s(history: History, end: Fault) -> float:
    """From when on the journal need not have what happens, if that ends it; all, if it is not read again."""
    from_s = end.at_s - RECORDED_S
    for fault in sorted(history.faults, key=lambda fault: fault.at_s, reverse=True):
        near = fault.at_s < end.at_s + CALL_WITHIN_S + AFTER_S and fault.end_s + RECORDED_S > from_s
        if fault.kind == "worn" and near:
            return end.at_s - JOURNAL_S
        if fault.kind in ("full", "refuses") and near:
            from_s = min(from_s, fault.at_s - RECORDED_S)
    return from_s


def unread_times(device: str, faults: tuple[Fault, ...]) -> list[tuple[float, float]]:
    """When it may not be read. With its process it is not dead: that reads it as soon as it is back."""
    own = tuple(fault for fault in faults if fault.of not in READERS)
    behind_s = CALL_WITHIN_S + AFTER_S
    readers = [(fault.at_s, fault.end_s + behind_s) for fault in faults if fault.of in READERS]
    return [*troubled_times(device, own), *readers]


def has_journal(history: History, end: Fault) -> bool:
    """One that nothing had kept from its work before the gateway's end."""
    if not any(JOURNAL in front.processes for front in history.run.world.fronts):
        return False
    kept_up = [(fault.at_s, fault.end_s + AFTER_S) for fault in history.faults if fault.of == JOURNAL]
    return not overlaps(kept_up, end.at_s - AFTER_S, end.at_s)


def goes_with_the_gateway(history: History, since_s: float) -> bool:
    """What came then may have waited in it, as it ended."""
    for fault in history.faults:
        if (fault.kind, fault.of) != ("kill", "rtud"):
            continue
        journal = has_journal(history, fault)
        from_s = unwritten_from_s(history, fault) if journal else fault.at_s - JOURNAL_S
        if from_s < since_s < fault.at_s + (CALL_WITHIN_S + AFTER_S if journal else JOURNAL_S):
            return True
    return False


def could_be_lost(point: str, since_s: float, until_s: float, history: History) -> bool:
    """The line was not read meanwhile, or the gateway went with what waited in it."""
    troubled = unread_times(device_of(point), history.faults)
    return overlaps(troubled, since_s, until_s) or goes_with_the_gateway(history, since_s)


def lifeless_times(events: list[Told]) -> Iterator[tuple[float, float]]:
    """When a point was not good, as its events of one connection have it."""
    since_s = None
    for event in events:
        tag_s = event.tag_s or 0.0
        if not event.good and since_s is None:
            since_s = tag_s
        elif event.good and since_s is not None:
            yield since_s, tag_s
            since_s = None


def interrogations_tell_the_same(history: History) -> Iterator[Violation]:
    """What its events tell as not good, from before to after it, no interrogation tells as good."""
    lifeless: dict[tuple[str, int], list[tuple[float, float]]] = {}
    for point, events in history.events.items():
        for session, of_session in itertools.groupby(events, key=lambda event: event.session):
            lifeless[point, session] = list(lifeless_times(list(of_session)))
    for told in history.told:
        if told.tag_s is not None or not told.good:
            continue
        asked_s = told.at_s - history.delay_s(told.at_s)
        for since_s, until_s in lifeless.get((told.point, told.session), []):
            if since_s < asked_s - SAME_S and told.at_s < until_s - SAME_S:
                text = f"{told.point} is told as {told}, by events not from {since_s:.3f} to {until_s:.3f} s"
                yield Violation("same", told.at_s, text)


def no_event_is_lost(history: History) -> Iterator[Violation]:
    """What a device held for a while, and the line could read, is told."""
    told = {(event.point, event.value) for events in history.events.values() for event in events}
    for point, held in history.held.items():
        if point.endswith(".10001"):
            continue  # a bit has but two values
        ends = [since for since, _ in held[1:]] + [history.end_s]
        for (since_s, value), until_s in zip(held, ends, strict=True):
            if until_s - since_s < HELD_S or value == 0 or (point, value) in told:
                continue
            if not history.has(point, since_s, since_s + HELD_S):
                continue
            if not could_be_lost(point, since_s, since_s + HELD_S, history):
                text = f"{point} was {value} from {since_s:.3f} to {until_s:.3f} s"
                yield Violation("no event lost", since_s, text)


def all_recovers(history: History) -> Iterator[Violation]:
    """Some time after the last fault the centre knows each value, and that it is good."""
    if history.configured[-1][0] > history.end_s:
        yield Violation("recovery", history.end_s, "no configuration is in force as a whole")
    last = {told.point: told for told in history.told}
    for point, held in history.held.items():
        told = last.get(point)
        if not history.has(point, history.end_s - SETTLED_S, history.end_s):
            continue
        if told is None or not told.good or told.value != held[-1][1]:
            seen = "nothing" if told is None else f"{told.value}, {'good' if told.good else 'not good'}"
            text = f"{point} is {held[-1][1]}, the centre knows {seen}"
            yield Violation("recovery", history.end_s, text)


def first_point(device: str) -> str:
    line, unit = map(int, device.split("."))
    return f"{line * 1000 + unit}.30001"


def periods_are_kept(history: History) -> Iterator[Violation]:
    """A device is asked as often as it should be, whatever its neighbours do, and soon after its trouble."""
    samples = history.answers
    devices = samples[0][1] if samples else {}
    least = ANSWERS_LEAST if history.run.world.bits else ANSWERS_LEAST // 2
    for device in devices:
        direct, troubled = direct_times(device, history.faults), troubled_times(device, history.faults)
        dead = history.dead_times(device)
        for (from_s, before), (to_s, after) in zip(samples, samples[WINDOW_S:], strict=False):
            count = after[device] - before[device]
            if not history.has(first_point(device), from_s, to_s):
                continue
            if count >= least or from_s < CHANGES_FROM_S or to_s - from_s < WINDOW_S - 1:
                continue
            may_be_dead = overlaps(troubled, from_s, to_s) and overlaps(dead, from_s, to_s)
            if not may_be_dead and not overlaps(direct, from_s, to_s):
                text = f"device {device} answered {count} requests from {from_s:.3f} to {to_s:.3f} s"
                yield Violation("period", to_s, text)


def is_disturbed(point: str, others: list[Fault], from_s: float, to_s: float) -> bool:
    """Something else has to do with the point, or with its way to the centre."""
    device = device_of(point)
    if overlaps(troubled_times(device, tuple(others)), from_s, to_s):
        return True
    on_its_way = [other for other in others if other.of in ("rtu-iec104", CENTRE, f"{PORT}")]
    return overlaps([(other.at_s, other.end_s + AFTER_S) for other in on_its_way], from_s, to_s)


def silence_is_told(history: History) -> Iterator[Violation]:
    """The points of a device that answers nothing any more are told invalid soon."""
    for fault in history.faults:
        until_s = fault.at_s + INVALID_S
        if fault.kind not in ("silent", "unplugged") or fault.for_s < INVALID_S:
            continue
        others = [other for other in history.faults if other is not fault]
        for point in history.held:
            events = history.events.get(point, [])
            if not history.has(point, fault.at_s, until_s):
                continue
            if not is_trouble_of(device_of(point), fault) or is_disturbed(point, others, fault.at_s, until_s):
                continue
            if not any(not event.good and fault.at_s <= (event.tag_s or 0) <= until_s for event in events):
                yield Violation("silence", until_s, f"{point} is not told invalid")


def is_no_alarm(history: History, event: Told) -> bool:
    """Neither its device, nor its line, nor the process that reads it had trouble."""
    tag_s = event.tag_s or 0.0
    times = troubled_times(device_of(event.point), history.faults)
    there = history.has(event.point, tag_s, tag_s + AGE_S)
    return there and not event.good and not overlaps(times, tag_s - AGE_S, tag_s + AGE_S)


def nothing_is_bad_without_trouble(history: History) -> Iterator[Violation]:
    """What a device that can be read holds is good, whatever else fails, and whatever time it is."""
    for point, events in history.events.items():
        for event in events:
            if is_no_alarm(history, event):
                yield Violation("good", event.at_s, f"{point} is told as {event}")


def connections_stay(history: History) -> Iterator[Violation]:
    """One ends behind trouble of its ends, or of the link."""
    ended = [
        (fault.at_s, fault.end_s + ENDS_CONNECTION_S.get(fault.kind, 0.0))
        for fault in history.faults
        if fault.of in ENDS_OF_CONNECTION
    ]
    for line in history.run.told(history.master.consumer):
        at_s = seconds(line["at"])
        if line.get("state") == LINK_DOWN and not overlaps(ended, at_s - NEXT_S, at_s):
            yield Violation("connection", at_s, "the centre's connection ends")


def lines_a_minute(run: Run) -> Iterator[tuple[str, int]]:
    """Of each program that writes, but for its first; rtu-centre's lines have no time, and come evenly."""
    counts: Counter[tuple[str, str]] = Counter()
    for line in run.log("gateway"):
        if " " in line:
            counts[line[:MINUTE], line.split(" ", 2)[1]] += 1 - LINES_AT_ONCE * (" listening on " in line)
    yield from ((program, count) for (_, program), count in counts.items())
    yield "rtu-centre", round(len(run.log("centre")) * 60 / run.world.seconds)


def commands_are_executed_once(history: History) -> Iterator[Violation]:
    """At most once, whatever becomes of connections and programs: each has a value of its own."""
    seen: set[int] = set()
    for write in history.writes:
        if write.value in seen:
            yield Violation("command once", write.at_s, f"{write.value} is written again into {write.device}")
        seen.add(write.value)


def is_answered_truly(order: Order, told: list[tuple[float, int, int]], writes: list[Write]) -> bool:
    """Executed is what the device has done before; what was not sent it never does."""
    for at_s, state, result in told:
        written = any(write.at_s <= at_s and write.device == order.device for write in writes)
        if (state == EXECUTED and not written) or (result in NOT_SENT and writes):
            return False
    return True


def is_done_or_not_sent(states: list[tuple[int, int]]) -> bool:
    return bool(states) and (states[-1][0] == EXECUTED or states[-1][1] in NOT_SENT)


def has_to_be_done(history: History, order: Order) -> bool:
    """Neither the device nor the way to it has trouble, nor had it shortly before."""
    until_s = order.at_s + ORDER_S + 4 * history.way_s
    point = f"{order.line * 1000 + order.unit}.{ORDERED}"
    tearing = [(fault.at_s, fault.end_s) for fault in history.faults if fault.kind in ("tearing", "step")]
    if not history.has(point, order.at_s, until_s) or overlaps(tearing, order.at_s - AGE_S, until_s):
        return False
    return not is_disturbed(point, list(history.faults), order.at_s, until_s)


def commands_are_answered_truly(history: History) -> Iterator[Violation]:
    """Executed is told of what the device has done, and of all that nothing kept from it."""
    for order in history.run.world.orders:
        told = history.ordered.get(order.value)
        if told is None:
            continue
        writes = [write for write in history.writes if write.value == order.value]
        states = [(state, result) for _, state, result in told]
        what = f"{order.value} to {order.device}: {states}, {len(writes)} writes"
        if not is_answered_truly(order, told, writes):
            yield Violation("command true", order.at_s, what)
        elif not is_done_or_not_sent(states) and has_to_be_done(history, order):
            yield Violation("command done", order.at_s, what)


def values_are_of_the_configuration(history: History) -> Iterator[Violation]:
    """What is not in the one in force is not told as good."""
    for point, events in history.events.items():
        for event in events:
            tag_s = event.tag_s or 0.0
            if event.good and history.has_not(point, tag_s, event.at_s):
                yield Violation("configuration", event.at_s, f"{point} is told as {event}")


def devices_are_of_the_configuration(history: History) -> Iterator[Violation]:
    """Nor is a device asked that is not in it."""
    for (from_s, before), (to_s, after) in itertools.pairwise(history.answers):
        for device in before:
            if after[device] > before[device] and history.has_not(first_point(device), from_s, to_s):
                yield Violation("configuration", to_s, f"device {device} is asked")


def no_log_is_flooded(history: History) -> Iterator[Violation]:
    """What goes on happening is counted, and does not fill the log."""
    for program, count in lines_a_minute(history.run):
        most = [front.lines.get(program, 0) for front in history.run.world.fronts]
        if count > max(LINES_A_MINUTE, *most, 0):
            yield Violation("log", history.end_s, f"{program} writes {count} lines in a minute")


def who_cannot_start_says_why(history: History) -> Iterator[Violation]:
    """Each module that begins without memory and ends has a line that says so."""
    begun = any(fault.kind == "kill" and fault.for_s for fault in history.faults)
    log = history.run.log("gateway") if begun else []
    ended = sum("exited with code" in line for line in log)
    said = sum("memory" in line for line in log)
    if said < ended:
        yield Violation("start", history.end_s, f"{ended} modules could not start, {said} said why")


def nothing_grows_without_end(history: History) -> Iterator[Violation]:
    """What a program holds stays what it was some time after its begin, but for its connections."""
    for account in history.run.accounts:
        if not account.process.startswith("rtu"):
            continue
        descriptors = account.most_descriptors - account.first_descriptors
        kib = account.last_kib - account.first_kib
        if descriptors > CONNECTIONS or kib > GROWTH_KIB:
            what = f"{account.process} in its life {account.life} holds {descriptors} descriptors"
            yield Violation("bounded", history.end_s, f"{what} and {kib} KiB more than before")


def nobody_crashes(history: History) -> Iterator[Violation]:
    if history.run.code != 0:
        yield Violation("no crash", history.end_s, history.run.said)


OF_THE_PLANT = (
    nobody_crashes,
    nothing_grows_without_end,
    who_cannot_start_says_why,
    periods_are_kept,
    no_log_is_flooded,
    devices_are_of_the_configuration,
    commands_are_executed_once,
    commands_are_answered_truly,
)
OF_A_MASTER = (
    values_are_true,
    events_are_in_order,
    interrogations_tell_the_same,
    no_event_is_lost,
    silence_is_told,
    nothing_is_bad_without_trouble,
    connections_stay,
    values_are_of_the_configuration,
    all_recovers,
)
assert SETTLED_S < RECOVERY_S


def judge_master(history: History) -> Iterator[Violation]:
    """What must hold for each that is told."""
    for rule in OF_A_MASTER:
        yield from rule(history)


def judge(run: Run) -> list[Violation]:
    """In the order of time."""
    history = History(run)
    found = [one for rule in OF_THE_PLANT for one in rule(history)]
    found += judge_master(history)
    found += [one for front in run.world.fronts for one in front.judge(history)]
    return sorted(found, key=lambda one: one.at_s)
