# SPDX-License-Identifier: GPL-3.0-or-later
"""An outstation below the gateway, which keeps events while its master is away, and may tell them late."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from plant_excuses import AFTER_S, AGE_S, LOST_S, goes_with_the_gateway, overlaps
from plant_history import CALL_WITHIN_S, CENTRE, NEXT_S, History, Told, Violation, seconds
from plant_world import BEGIN_NS, CHANGES_FROM_S, PORT, SETTLED_S, Fault, Front, Programs, World

PROCESS, OUTSTATION, PROGRAM = "rtu-104m", "outstation", Path(__file__).with_name("plant_outstation.py")
STATION_PORT = 2410
CA, POINT = 9200, "9200.1"
T1_S = 3.0  # in which an answer comes, or the link ends
BACK_S = 5.0  # from the end of a trouble until the link is there again, and interrogated
ENDS_LATER_S = {"kill": CALL_WITHIN_S, "stop": CALL_WITHIN_S, "lost": LOST_S, "power": LOST_S}
SETTLES_S = 15.0  # it is interrogated again 10 s after the last time at the latest
TOLD_S = 20.0  # until an event is told, where nothing keeps it


@dataclass(frozen=True)
class Outstation(Front):
    def configure(self, world: World, config: dict[str, Any], folder: Path) -> None:
        points = [{"name": "count", "type": "scaled", "ioa": 1}]
        config["outstations"] = [
            {
                "name": "town",
                "addresses": ["127.0.0.1"],
                "port": STATION_PORT,
                "retry_ms": 500,
                "retry_max_ms": 2000,
                "t1": round(T1_S),
                "t2": 1,
                "t3": 4,
                "sets": [{"ca": CA, "remote_ca": 1, "points": points}],
            }
        ]

    def programs(self, world: World, folder: Path, gateway: Path) -> Programs:
        until_s = BEGIN_NS / 1e9 + world.seconds - SETTLED_S
        words = [f"{Path(sys.executable).resolve()}", "-I", "-S", "-B", f"{PROGRAM}"]
        return {OUTSTATION: (0.2, [*words, f"{STATION_PORT}", f"{world.seed}", f"{until_s}"])}

    @property
    def processes(self) -> tuple[str, ...]:
        return (PROCESS,)

    @property
    def points(self) -> tuple[str, ...]:
        return (POINT,)

    @property
    def cables(self) -> tuple[str, ...]:
        return (f"{STATION_PORT}",)

    def judge(self, history: History) -> Iterator[Violation]:
        below = Below(history)
        for rule in RULES:
            for violation in rule(below):
                yield replace(violation, text=f"of the outstation {violation.text}")


def ends_s(fault: Fault) -> float:
    """A kill or a stop waits for its call. A connection that is lost each side has to find out."""
    return fault.end_s + ENDS_LATER_S.get(fault.kind, 0.0)


class Below:
    """What the outstation held, and what a centre was told of it."""

    def __init__(self, history: History) -> None:
        self.history = history

    @cached_property
    def lines(self) -> list[dict[str, Any]]:
        return self.history.run.told(OUTSTATION)

    @cached_property
    def held(self) -> list[tuple[float, int]]:
        """From when on which value."""
        changes = [(seconds(line["at"]), line["held"]) for line in self.lines if "held" in line]
        return [(float("-inf"), 0), *changes]

    @cached_property
    def away(self) -> list[tuple[float, float]]:
        """When it had hung up."""
        lines = [line for line in self.lines if "away_until" in line]
        return [(seconds(line["at"]), seconds(line["away_until"])) for line in lines]

    @cached_property
    def late(self) -> list[tuple[float, float]]:
        """When it told what it had kept."""
        return [(seconds(line["at"]), seconds(line["at"])) for line in self.lines if "late" in line]

    @cached_property
    def told(self) -> list[Told]:
        return [told for told in self.history.all_told if told.point == POINT]

    def settles_s(self, from_s: float, to_s: float) -> float:
        """From when on what was told last must be what it has had since from_s."""
        of = (PROCESS, "rtud", f"{STATION_PORT}", "rtu-iec104", CENTRE, f"{PORT}")
        ends = [ends_s(fault) for fault in self.history.faults if fault.of in of and fault.at_s < to_s]
        ends += [end_s for begin_s, end_s in (*self.away, *self.late) if begin_s < to_s]
        return max([from_s, *ends]) + SETTLES_S

    @cached_property
    def silent(self) -> list[tuple[float, float]]:
        """When the gateway may not know yet that it is not heard, or not that it is heard again."""
        return [(begin_s, end_s - AFTER_S + BACK_S) for begin_s, end_s in self.troubled]

    @cached_property
    def troubled(self) -> list[tuple[float, float]]:
        """When it may not be heard."""
        faults = [fault for fault in self.history.faults if fault.of in (PROCESS, "rtud", f"{STATION_PORT}")]
        times = [*((fault.at_s, ends_s(fault)) for fault in faults), *self.away]
        return [(begin_s, end_s + AFTER_S) for begin_s, end_s in times]

    def held_within(self, value: int, from_s: float, to_s: float) -> bool:
        ends = [since_s for since_s, _ in self.held[1:]] + [float("inf")]
        return any(
            has == value and since_s <= to_s and from_s < end_s
            for (since_s, has), end_s in zip(self.held, ends, strict=True)
        )


def values_are_true(below: Below) -> Iterator[Violation]:
    """At the time tag, or shortly before it came. An answer is of the time when it was asked for."""
    for told in below.told:
        from_s, to_s = float("-inf"), told.at_s
        if told.tag_s is not None and told.good:
            from_s, to_s = told.tag_s - NEXT_S, told.tag_s + T1_S
        elif told.good:
            from_s = told.at_s - AGE_S - below.history.delay_s(told.at_s)
        excused = told.tag_s is None and overlaps(below.silent, from_s, to_s)
        if not excused and not below.held_within(told.value, from_s, to_s):
            yield Violation("true", told.at_s, f"{POINT} is told as {told}")


def values_are_good(below: Below) -> Iterator[Violation]:
    for told in below.told:
        at_s = told.at_s if told.tag_s is None else told.tag_s
        from_s = at_s - AGE_S - below.history.delay_s(told.at_s)
        if not told.good and at_s > CHANGES_FROM_S and not overlaps(below.troubled, from_s, at_s + NEXT_S):
            yield Violation("good", told.at_s, f"{POINT} is told as {told}")


def events_are_told(below: Below) -> Iterator[Violation]:
    """All, by their time: who keeps them until they are acknowledged loses none to a fault of the link."""
    told = {(one.value, round(one.tag_s or 0.0, 1)) for one in below.told if one.good}
    for since_s, value in below.held[1:]:
        tags = {round(since_s + by_s, 1) for by_s in (-0.05, 0.0, 0.05)}
        if since_s > below.history.end_s - TOLD_S or any((value, tag) in told for tag in tags):
            continue
        if not goes_with_the_gateway(below.history, since_s):
            yield Violation("no event lost", since_s, f"{POINT} was {value}")


def the_last_is_the_state(below: Below) -> Iterator[Violation]:
    """An old event goes on, and the state is told again behind it."""
    ends = [since_s for since_s, _ in below.held[1:]] + [below.history.end_s]
    for (since_s, value), end_s in zip(below.held[1:], ends[1:], strict=True):
        if end_s < below.settles_s(since_s, end_s):
            continue
        last = [told for told in below.told if told.at_s < end_s][-1:]
        if not last or not last[0].good or last[0].value != value:
            known = last[0] if last else "nothing"
            text = f"{POINT} is {value} since {since_s:.3f} s, the centre knows {known}"
            yield Violation("state", end_s, text)


def all_recovers(below: Below) -> Iterator[Violation]:
    last, value = below.told[-1] if below.told else None, below.held[-1][1]
    if not last or not last.good or last.value != value:
        text = f"{POINT} is {value}, the centre knows {last or 'nothing'}"
        yield Violation("recovery", below.history.end_s, text)


RULES = (values_are_true, values_are_good, events_are_told, the_last_is_the_state, all_recovers)
