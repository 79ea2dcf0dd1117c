# SPDX-License-Identifier: GPL-3.0-or-later
"""A manager of SNMPv3, Net-SNMP's, that reads the points' tables and the events."""

from __future__ import annotations

import json
import subprocess
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

from plant_excuses import AFTER_S, AGE_S, device_of, overlaps, troubled_times
from plant_history import History, Violation, seconds
from plant_same import Event, tell_the_same
from plant_world import (
    BUILD,
    CHANGES_FROM_S,
    REPOSITORY,
    SETTLED_S,
    Front,
    PlantError,
    Programs,
    World,
)

PROCESS, MANAGER = "rtu-snmp", "manager"
PORT = 1161
TOOLS = REPOSITORY / "scripts" / "openrtu"
ENGINE = "80001f8805aabbccddeeff0011"
USER, AUTHENTICATION, ENCRYPTION = "watch", "watch-authentic", "watch-encrypted"
PERIOD_S = 2
CHANGE = 1  # of rtuEventKind


@cache
def keys() -> bytes:
    """Localized to the engine, as the engineer makes them. Raises PlantError."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "passphrases").write_text(f"{USER} {AUTHENTICATION} {ENCRYPTION}\n")
        users = [{"name": USER, "role": "viewer"}]
        (folder / "gateway.json").write_text(json.dumps({"port": [], "snmp": {"users": users}}))
        command = [TOOLS, "snmp-keys", folder / "gateway.json", folder / "keys", "--engine-id", ENGINE]
        command += ["--passphrases", folder / "passphrases"]
        result = subprocess.run(command, capture_output=True, text=True, check=False)
        if result.returncode != 0:
            raise PlantError(result.stderr)
        return (folder / "keys").read_bytes()


@dataclass(frozen=True)
class Snmp(Front):
    def configure(self, world: World, config: dict[str, Any], folder: Path) -> None:
        config["snmp"] = {
            "address": "127.0.0.1",
            "port": PORT,
            "users": [{"name": USER, "role": "viewer"}],
            "keys": f"{folder}/snmp.keys",
            "state": f"{folder}/snmp",
        }

    def lay_out(self, world: World, folder: Path, gateway: Path) -> None:
        (folder / "snmp.keys").write_bytes(keys())
        (folder / "snmp.keys").chmod(0o400)

    def programs(self, world: World, folder: Path, gateway: Path) -> Programs:
        command = [f"{BUILD}/manager", f"127.0.0.1:{PORT}", USER, AUTHENTICATION, ENCRYPTION, f"{PERIOD_S}"]
        return {MANAGER: (2.0, command)}

    @property
    def processes(self) -> tuple[str, ...]:
        return (PROCESS,)

    def judge(self, history: History) -> Iterator[Violation]:
        managed = Managed(history)
        for rule in RULES:
            for violation in rule(managed):
                yield replace(violation, text=f"by SNMP {violation.text}")


@dataclass(frozen=True)
class Reading:
    """A point in an answer that came between two times."""

    asked_s: float
    at_s: float
    point: str
    value: int
    good: bool

    def __str__(self) -> str:
        return f"{self.point} is {self.value}, {'good' if self.good else 'not good'}"


@dataclass(frozen=True)
class Row(Event):
    """Of rtuEventTable."""

    at_s: float
    epoch: int
    number: int
    kind: int

    def __str__(self) -> str:
        state = "good" if self.good else "not good"
        return f"{self.point} is told as {self.value}, {state} of {self.tag_s:.3f} s"


class Managed:
    """What the manager has read."""

    def __init__(self, history: History) -> None:
        self.history = history
        self.rounds = history.run.told(MANAGER)

    def value(self, point: str, told: int) -> int:
        """A single point is 1 or 2."""
        return told - 1 if point.endswith(".10001") else told

    @cached_property
    def readings(self) -> list[Reading]:
        return [
            Reading(seconds(each["asked"]), seconds(each["at"]), point, self.value(point, told), quality == 0)
            for each in self.rounds
            for point, told, quality, _ in each.get("points", [])
            if point in self.history.held
        ]

    @cached_property
    def events(self) -> list[Row]:
        return [
            Row(
                at_s=(at_s := seconds(each["at"])),
                epoch=each["epoch"],
                number=int(number),
                kind=kind,
                point=(point := f"{ca}.{address}"),
                value=self.value(point, value),
                good=quality == 0,
                tag_s=self.history.tag_s(tag_ms * 1_000_000, at_s),
            )
            for each in self.rounds
            for number, kind, ca, address, value, quality, tag_ms in each.get("events", [])
        ]

    @cached_property
    def changes(self) -> list[Row]:
        return [one for one in self.events if one.kind == CHANGE and one.point in self.history.held]

    @property
    def own(self) -> list[tuple[float, float]]:
        """When the agent may not answer, and no event comes to it."""
        return [
            (fault.at_s, fault.end_s + AFTER_S)
            for fault in self.history.faults
            if fault.of in (PROCESS, "rtud")
        ]


def readings_are_true(managed: Managed) -> Iterator[Violation]:
    """As of the rule `true`: the manager waits for its answer."""
    for reading in managed.readings:
        from_s = reading.asked_s - AGE_S if reading.good else float("-inf")
        if not managed.history.held_within(reading.point, reading.value, from_s, reading.at_s):
            yield Violation("true", reading.at_s, f"{reading}")


def readings_are_good(managed: Managed) -> Iterator[Violation]:
    """Where neither the device, nor its line, nor the process that reads it has trouble."""
    for reading in managed.readings:
        if reading.good or reading.asked_s < CHANGES_FROM_S:
            continue
        times = troubled_times(device_of(reading.point), managed.history.faults)
        if not overlaps(times, reading.asked_s - AGE_S, reading.at_s):
            yield Violation("good", reading.at_s, f"{reading}")


def events_are_true(managed: Managed) -> Iterator[Violation]:
    for event in managed.changes:
        from_s = event.tag_s - AGE_S if event.good else float("-inf")
        if not managed.history.held_within(event.point, event.value, from_s, event.tag_s + 0.001):
            yield Violation("true", event.at_s, f"{event}")


def events_are_whole(managed: Managed) -> Iterator[Violation]:
    """Numbers without a gap, as long as they do not begin anew."""
    for before, event in pairwise(managed.events):
        if event.epoch == before.epoch and event.number != before.number + 1:
            yield Violation("no event lost", event.at_s, f"{event.number} follows {before.number}")


def answers_come(managed: Managed) -> Iterator[Violation]:
    """The agent answers while it runs."""
    for each in managed.rounds:
        from_s, to_s = seconds(each["asked"]), seconds(each["at"])
        if not each["whole"] and not overlaps(managed.own, from_s, to_s):
            yield Violation("answer", to_s, "nobody answers the manager")


def tells_the_same(managed: Managed) -> Iterator[Violation]:
    yield from tell_the_same(managed.history, "SNMP", managed.changes, managed.own)


def freezes_are_told(managed: Managed) -> Iterator[Violation]:
    """A counter that stands still makes no change, only freezes. The first reading is a change."""
    seen: dict[str, tuple[int, int, bool]] = {}
    for event in managed.events:
        if event.point not in managed.history.run.world.counters:
            continue
        what = (event.epoch, event.value, event.good)
        if event.kind == CHANGE and what == seen.get(event.point):
            yield Violation("change", event.at_s, f"{event}, as before")
        seen[event.point] = what


def all_recovers(managed: Managed) -> Iterator[Violation]:
    history = managed.history
    last = {reading.point: reading for reading in managed.readings}
    for point, held in history.held.items():
        reading = last.get(point)
        known = reading and reading.good and reading.at_s > history.end_s - SETTLED_S
        if not known or reading.value != held[-1][1]:
            yield Violation(
                "recovery", history.end_s, f"{point} is {held[-1][1]}, the manager knows {reading}"
            )


RULES = (
    readings_are_true,
    readings_are_good,
    events_are_true,
    events_are_whole,
    answers_come,
    tells_the_same,
    freezes_are_told,
    all_recovers,
)
