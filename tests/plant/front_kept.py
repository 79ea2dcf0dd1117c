# SPDX-License-Identifier: GPL-3.0-or-later
"""A program with variables that it retains: behind a power cut they are whole, no older than the journal."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from front_logic import compiled
from plant_excuses import JOURNAL_S, has_journal, unwritten_from_s
from plant_history import History, Told, Violation
from plant_world import Fault, Front, World

PERIOD_MS = 1000
CA = 9400
SHOWN, MIXED = f"{CA}.1", f"{CA}.2"


@dataclass(frozen=True)
class Kept(Front):
    fails: bool = False  # it may be killed, and stop

    def configure(self, world: World, config: dict[str, Any], folder: Path) -> None:
        config["logic"] = [
            *config.get("logic", []),
            {
                "name": "kept",
                "program": f"{folder}/kept.rtul",
                "period_ms": PERIOD_MS,
                "ca": CA,
                "points": [{"name": "shown", "ioa": 1}, {"name": "mixed", "ioa": 2}],
            },
        ]

    def lay_out(self, world: World, folder: Path, gateway: Path) -> None:
        (folder / "kept.rtul").write_bytes(compiled("kept"))

    @property
    def processes(self) -> tuple[str, ...]:
        return ("rtu-logic-kept",) if self.fails else ()

    @property
    def points(self) -> tuple[str, ...]:
        return (SHOWN, MIXED)

    def judge(self, history: History) -> Iterator[Violation]:
        for rule in (nothing_is_mixed, nothing_is_older_than_the_journal, it_counts_at_the_end):
            yield from rule(history)


def of(history: History, point: str) -> list[Told]:
    return [told for told in history.all_told if told.point == point]


def nothing_is_mixed(history: History) -> Iterator[Violation]:
    for told in of(history, MIXED):
        if told.value:
            yield Violation("kept", told.at_s, f"of two variables the sum is {told.value}")


def lost_from_s(history: History, end: Fault) -> float:
    """From when on the variables may be lost with the gateway; a worn disk may give nothing back."""
    from_s = unwritten_from_s(history, end)
    return from_s if has_journal(history, end) else min(from_s, end.at_s - JOURNAL_S)


def nothing_is_older_than_the_journal(history: History) -> Iterator[Violation]:
    """The count goes back where the gateway ended, by what was not in the journal yet."""
    ends = [fault for fault in history.faults if (fault.kind, fault.of) == ("kill", "rtud")]
    losses = [(end.at_s, lost_from_s(history, end)) for end in ends]
    events = [(told.tag_s, told.value) for told in of(history, SHOWN) if told.good and told.tag_s is not None]
    for place, (tag_s, value) in enumerate(events):
        for before_s, before in events[:place]:
            lost = any(from_s <= before_s and at_s <= tag_s for at_s, from_s in losses)
            if before > value and before_s < tag_s and not lost:
                yield Violation("kept", tag_s, f"a count of {value} behind {before} of {before_s:.3f} s")
                break


def it_counts_at_the_end(history: History) -> Iterator[Violation]:
    last = of(history, SHOWN)[-1:]
    if not last or not last[0].good:
        yield Violation("recovery", history.end_s, "the program with kept variables has no good point")
