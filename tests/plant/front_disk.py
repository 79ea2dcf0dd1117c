# SPDX-License-Identifier: GPL-3.0-or-later
"""A journal on a disk that is full, fails, loses power: what is synchronised stays, what fails is said."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from front_journal import Journal
from plant_excuses import AFTER_S, overlaps
from plant_history import CALL_WITHIN_S, WALL_NS, History, S, Violation, seconds
from plant_world import JOURNAL, World

SAID_S = 0.5


@dataclass(frozen=True)
class Disk(Journal):
    has_disk = True

    def configure(self, world: World, config: dict[str, Any], folder: Path) -> None:
        super().configure(world, config, folder)
        config["journal"]["path"] = f"{folder}/data/openrtu/journal"

    def lay_out(self, world: World, folder: Path, gateway: Path) -> None:
        (folder / "data").mkdir()

    def judge(self, history: History) -> Iterator[Violation]:
        yield from what_the_disk_refuses_is_said(history)


def refused(history: History) -> list[float]:
    """When the disk did not take what the journal wrote."""
    path = history.run.folder / "data.refused"
    lines = [line.split() for line in path.read_text().splitlines()] if path.exists() else []
    return [seconds(int(at)) for at, program, _ in lines if program == JOURNAL]


def told_failures(history: History) -> Iterator[tuple[float, bool]]:
    """When the log has begun and ended to say that the journal cannot be written."""
    for line in history.run.log("gateway"):
        if f" {JOURNAL} " in line and ("cannot write" in line or "writes again" in line):
            yield told_s(line), "cannot write" in line


def told_s(line: str) -> float:
    """Of a line of the log; of a world whose calendar clock is not set."""
    return datetime.fromisoformat(line.split(" ", 1)[0]).timestamp() - WALL_NS / S


def what_the_disk_refuses_is_said(history: History) -> Iterator[Violation]:
    """Once, until it can be written again."""
    told = list(told_failures(history))
    ends = ("kill", "stop")
    kept_up = [
        (fault.at_s, fault.end_s + CALL_WITHIN_S + AFTER_S)
        for fault in history.faults
        if fault.kind in ends and fault.of in (JOURNAL, "rtud")
    ]
    for at_s in refused(history):
        before = [fails for since_s, fails in told if since_s <= at_s]
        now = any(fails and at_s <= since_s < at_s + SAID_S for since_s, fails in told)
        if not now and not (before and before[-1]) and not overlaps(kept_up, at_s, at_s + SAID_S):
            yield Violation("disk", at_s, "what the disk refuses is not said")
