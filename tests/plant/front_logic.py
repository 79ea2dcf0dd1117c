# SPDX-License-Identifier: GPL-3.0-or-later
"""Two programs of Structured Text: one computes from registers of two lines, the other from its result."""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

from plant_excuses import AFTER_S, could_be_lost, device_of, overlaps, troubled_times
from plant_history import History, Told, Violation
from plant_judge import HELD_S, age_s, events_are_in_order
from plant_world import REPOSITORY, Front, PlantError, World

COMPILER = REPOSITORY / "scripts" / "openrtu"
SOURCES = Path(__file__).with_name("logic")
PERIOD_MS = 500
SCANS_S = 2 * PERIOD_MS / 1000  # of the two, one behind the other
STARTED_S = 15.0  # from the start: the first scan waits 10 s at most
REGISTER = 30001
CA = {"sub": 9000, "neg": 9001}
SIGN = {f"{CA['sub']}.1": 1, f"{CA['neg']}.1": -1}  # of each program's point: the difference, or its opposite


@cache
def compiled(name: str) -> bytes:
    """Raises PlantError."""
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / f"{name}.rtul"
        command = [COMPILER, "logic", "compile", SOURCES / f"{name}.st", "-o", program]
        result = subprocess.run(command, capture_output=True, text=True, check=False)
        if result.returncode != 0:
            raise PlantError(result.stderr)
        return program.read_bytes()


class OfPrograms(History):
    """What a centre was told of the programs' points."""

    @property
    def told(self) -> list[Told]:
        return [told for told in self.all_told if told.point in SIGN]


@dataclass(frozen=True)
class Logic(Front):
    """A program that begins anew may have a first result as its return is told: then it is told twice."""

    def configure(self, world: World, config: dict[str, Any], folder: Path) -> None:
        one, other = (f"p{line}.1.i0" for line in world.lines[:2])
        config["logic"] = [
            {
                "name": "sub",
                "program": f"{folder}/sub.rtul",
                "period_ms": PERIOD_MS,
                "ca": CA["sub"],
                "names": {"one": one, "other": other},
                "points": [{"name": "difference", "ioa": 1}],
            },
            {
                "name": "neg",
                "program": f"{folder}/neg.rtul",
                "period_ms": PERIOD_MS,
                "ca": CA["neg"],
                "points": [{"name": "negated", "ioa": 1}],
            },
        ]

    def lay_out(self, world: World, folder: Path, gateway: Path) -> None:
        for name in CA:
            (folder / f"{name}.rtul").write_bytes(compiled(name))

    @property
    def processes(self) -> tuple[str, ...]:
        return tuple(f"rtu-logic-{name}" for name in CA)

    @property
    def points(self) -> tuple[str, ...]:
        return tuple(SIGN)

    def judge(self, history: History) -> Iterator[Violation]:
        of_programs = OfPrograms(history.run, history.master)
        for rule in RULES:
            yield from (one for one in rule(of_programs) if one.rule != "once")


def inputs(history: History) -> tuple[str, str]:
    one, other = (f"{line * 1000 + 1}.{REGISTER}" for line in history.run.world.lines[:2])
    return one, other


def held_between(history: History, point: str, from_s: float, to_s: float) -> set[int]:
    held = history.held[point]
    ends = [since for since, _ in held[1:]] + [float("inf")]
    return {value for (since, value), end in zip(held, ends, strict=True) if since <= to_s and from_s < end}


def values_are_computed(history: History) -> Iterator[Violation]:
    """Of what the devices held shortly before; what is not good, of what they held at some time."""
    one, other = inputs(history)
    for told in history.told:
        until_s = told.at_s if told.tag_s is None else told.tag_s
        from_s = until_s - age_s(history, told) - SCANS_S
        ones, others = (held_between(history, point, from_s, until_s + 0.001) for point in (one, other))
        if not any(told.value == SIGN[told.point] * (x - y) for x in ones for y in others):
            yield Violation("true", told.at_s, f"{told.point} is told as {told}")


def troubles(history: History) -> list[tuple[float, float]]:
    """When a program may have no good input, or does not run."""
    of_programs = [fault for fault in history.faults if fault.of.startswith("rtu-logic-")]
    times = [(fault.at_s, fault.end_s + AFTER_S) for fault in of_programs]
    for point in inputs(history):
        times += troubled_times(device_of(point), history.faults)
    return times


def results_are_told(history: History) -> Iterator[Violation]:
    """Where both inputs stay as they are for long enough."""
    one, other = inputs(history)
    changes = sorted({since for point in (one, other) for since, _ in history.held[point][1:]})
    for since_s, until_s in pairwise([*changes, history.end_s]):
        (x,), (y,) = (held_between(history, point, since_s, since_s) for point in (one, other))
        lost = [could_be_lost(point, since_s, since_s + HELD_S, history) for point in (one, other)]
        if until_s - since_s < HELD_S or since_s < STARTED_S or any(lost):
            continue
        for point, sign in SIGN.items():
            if overlaps(troubles(history), since_s, since_s + HELD_S):
                continue
            if not any(told.value == sign * (x - y) and told.good for told in history.events.get(point, [])):
                yield Violation("no event lost", since_s, f"{point} was {sign * (x - y)}")


def results_are_good(history: History) -> Iterator[Violation]:
    """While the inputs can be read and the programs run."""
    for point, events in history.events.items():
        for event in events:
            tag_s = event.tag_s or 0.0
            if event.good or tag_s < STARTED_S:
                continue
            if not overlaps(troubles(history), tag_s - age_s(history, event.as_good), tag_s + SCANS_S):
                yield Violation("good", event.at_s, f"{point} is told as {event}")


def all_recovers(history: History) -> Iterator[Violation]:
    """At the end each result is that of what the devices hold."""
    x, y = (history.held[point][-1][1] for point in inputs(history))
    last = {told.point: told for told in history.told}
    for point, sign in SIGN.items():
        told = last.get(point)
        if told is None or not told.good or told.value != sign * (x - y):
            text = f"{point} is {sign * (x - y)}, the centre knows {told or 'nothing'}"
            yield Violation("recovery", history.end_s, text)


RULES = (events_are_in_order, values_are_computed, results_are_told, results_are_good, all_recovers)
