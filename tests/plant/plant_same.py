# SPDX-License-Identifier: GPL-3.0-or-later
"""What two fronts tell of one change is the same."""

from __future__ import annotations

from bisect import bisect_left
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from plant_excuses import AFTER_S, AGE_S, is_disturbed, overlaps
from plant_history import History, Violation
from plant_world import CHANGES_FROM_S, SETTLED_S

ROUNDED_S = 0.0015  # a time of IEC 61850 has parts of a second that are no milliseconds


@dataclass(frozen=True)
class Event:
    """A value, or that a point is not good."""

    point: str
    tag_s: float
    value: int
    good: bool

    @property
    def what(self) -> tuple[str, int | None]:
        return self.point, self.value if self.good else None


class Events:
    def __init__(self, events: Iterable[Event]) -> None:
        self.all = list(events)
        self._tags: dict[tuple[str, int | None], list[float]] = defaultdict(list)
        for event in self.all:
            self._tags[event.what].append(event.tag_s)
        for tags in self._tags.values():
            tags.sort()

    def __contains__(self, event: Event) -> bool:
        tags = self._tags[event.what]
        place = bisect_left(tags, event.tag_s - ROUNDED_S)
        return place < len(tags) and tags[place] <= event.tag_s + ROUNDED_S


def by_104(history: History) -> Iterator[Event]:
    for point, events in history.events.items():
        for event in events:
            yield Event(point, event.tag_s or 0.0, event.value, event.good)


def tell_the_same(
    history: History, front: str, told: Iterable[Event], excused: list[tuple[float, float]]
) -> Iterator[Violation]:
    """As IEC 60870-5-104, and that as the front, where nothing keeps an event from either."""
    of_104, of_front = Events(by_104(history)), Events(told)
    missed = [(event, "IEC 60870-5-104") for event in of_front.all if event not in of_104]
    missed += [(event, front) for event in of_104.all if event not in of_front]
    for event, who in missed:
        from_s, until_s = event.tag_s - AGE_S, event.tag_s + AFTER_S + history.way_s
        if not CHANGES_FROM_S < event.tag_s < history.end_s - SETTLED_S or overlaps(excused, from_s, until_s):
            continue
        if not is_disturbed(event.point, list(history.faults), from_s, until_s):
            state = f"{event.value}, {'good' if event.good else 'not good'} of {event.tag_s:.3f} s"
            yield Violation("same", event.tag_s, f"{event.point} is {state}: {who} does not tell it")
