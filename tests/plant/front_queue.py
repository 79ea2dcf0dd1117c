# SPDX-License-Identifier: GPL-3.0-or-later
"""A short queue: while the centre is away it loses events, holds no more than it may, and counts the lost."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from plant_excuses import overlaps
from plant_history import CALL_WITHIN_S, LINK_UP, History, Told, Violation, seconds
from plant_world import Front, World

LIMIT = 100  # the least that a group may have
CA = 9300
LOSING, LOST = f"{CA}.1", f"{CA}.101"
OF_OTHERS = (f"{CA}.9", f"{CA}.109")  # in no group
IN_FLIGHT = 12  # sent, and not acknowledged when the connection ended
ENDED_S = 1.0
KEEPERS = ("rtu-iec104", "rtud")


@dataclass(frozen=True)
class ShortQueue(Front):
    """Of the first centre, as a redundancy group; the gateway says as points what it loses."""

    def configure(self, world: World, config: dict[str, Any], folder: Path) -> None:
        config["redundancy_groups"] = [{"name": "first", "masters": ["127.0.0.1"], "queue": LIMIT}]
        config["iec104"]["own_ca"] = CA

    @property
    def points(self) -> tuple[str, ...]:
        return (LOSING, LOST, *OF_OTHERS)

    def excuses(self, history: History, found: list[Violation]) -> list[Violation]:
        """What it counted as lost need not be told. Behind a loss all values are sent, known or not."""
        found = [one for one in found if not is_gone_with_its_count(history, one)]
        lost = [one for one in found if one.rule == "no event lost"]
        if lost:
            return found if len(lost) > counted(history) else []
        losing = losing_times(history)
        return [
            one for one in found if one.rule != "once" or not overlaps(losing, one.at_s - ENDED_S, one.at_s)
        ]

    def judge(self, history: History) -> Iterator[Violation]:
        for rule in (no_more_waits_than_may, losing_ends):
            yield from rule(history)


def of(history: History, point: str) -> list[Told]:
    return [told for told in history.all_told if told.point == point and told.good]


def counted(history: History) -> int:
    """Over all lives of the gateway: each begins with 0."""
    whole = before = 0
    for told in of(history, LOST):
        whole += told.value - before if told.value >= before else told.value
        before = told.value
    return whole


def is_gone_with_its_count(history: History, one: Violation) -> bool:
    """The gateway ended, with what it had counted, before the centre heard of it again."""
    heard = [told.at_s for told in history.all_told]
    ends = [fault.at_s for fault in history.faults if (fault.kind, fault.of) == ("kill", "rtud")]
    return one.rule == "no event lost" and any(
        one.at_s < end_s and not any(one.at_s + ENDED_S < at_s < end_s for at_s in heard) for end_s in ends
    )


def losing_times(history: History) -> list[tuple[float, float]]:
    """From the first event that is lost until all current values were sent."""
    told = of(history, LOSING)
    ends = [one.at_s for one in told[1:]] + [history.end_s]
    return [
        (one.at_s if one.tag_s is None else one.tag_s, end_s + ENDED_S)
        for one, end_s in zip(told, ends, strict=True)
        if one.value
    ]


def began_s(history: History) -> list[float]:
    lines = history.run.told(history.master.consumer)
    return [seconds(line["at"]) for line in lines if line.get("state") == LINK_UP]


def no_more_waits_than_may(history: History) -> Iterator[Violation]:
    """What happened before a connection and is told in it had waited: no more than a queue may hold."""
    begins = began_s(history)
    kept_up = [(fault.at_s, fault.end_s + CALL_WITHIN_S) for fault in history.faults if fault.of in KEEPERS]
    for begun_s, until_s in zip(begins, [*begins[1:], history.end_s], strict=True):
        waited = {
            (told.point, told.tag_s, told.value, told.good)  # once: behind each loss all values are sent
            for events in history.events.values()
            for told in events
            if begun_s <= told.at_s < until_s and (told.tag_s or 0.0) < begun_s - ENDED_S
        }
        current = len(history.run.world.points) + len(history.run.world.points_of_fronts)
        if overlaps(kept_up, begun_s - ENDED_S, begun_s):
            continue  # nobody had dropped what came meanwhile
        if len(waited) > LIMIT + IN_FLIGHT + current:
            yield Violation("queue", begun_s, f"{len(waited)} events had waited, where {LIMIT} may")


def losing_ends(history: History) -> Iterator[Violation]:
    """What is lost is told to be, and its end, too."""
    losing = of(history, LOSING)
    if losing and losing[-1].value:
        yield Violation("queue", history.end_s, "it is losing events for ever")
