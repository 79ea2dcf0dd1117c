# SPDX-License-Identifier: GPL-3.0-or-later
"""A relay of GOOSE, libiec61850's: it takes what the gateway publishes, and publishes a point."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from plant_excuses import AFTER_S, AGE_S, could_be_lost, device_of, overlaps, troubled_times
from plant_history import NEXT_S, History, Told, Violation, seconds
from plant_judge import HELD_S, age_s
from plant_libiec61850 import program
from plant_world import CABLE, CHANGES_FROM_S, SETTLED_S, Front, Programs, World

PROCESS, RELAY = "rtu-goose", "relay"
PROGRAM = "goose_peer"
INTERFACE = "plant0"  # packets.c
BLOCK = "GW1LD0/LLN0$GO$bay"
OWN_BLOCK, OWN_SET = "IED1LD0/LLN0$GO$count", "IED1LD0/LLN0$count"
COUNT = "9100.1"
VALIDITY = 3  # of a quality, its first two bits
CHANGE_EVERY = 14  # messages, of which two come in a second


@dataclass(frozen=True)
class Goose(Front):
    def configure(self, world: World, config: dict[str, Any], folder: Path) -> None:
        line = world.lines[0]
        config["goose"] = {
            "interface": INTERFACE,
            "publish": [
                {
                    "name": "bay",
                    "control_block": BLOCK,
                    "data_set": BLOCK.replace("$GO$", "$"),
                    "destination": "01:0c:cd:01:00:01",
                    "app_id": 1,
                    "points": [f"p{line}.1.{'d0' if world.bits else 'i0'}", f"p{line}.3.i1"],
                }
            ],
            "subscribe": [
                {
                    "name": "relay",
                    "control_block": OWN_BLOCK,
                    "destination": "01:0c:cd:01:00:02",
                    "app_id": 2,
                    "ca": 9100,
                    "data": [{"name": "relay.count", "type": "integer", "ioa": 1}],
                }
            ],
        }

    def programs(self, world: World, folder: Path, gateway: Path) -> Programs:
        words = [f"{program(PROGRAM)}", BLOCK, OWN_BLOCK, OWN_SET, f"{CHANGE_EVERY}"]
        return {RELAY: (2.0, words)}

    @property
    def processes(self) -> tuple[str, ...]:
        return (PROCESS,)

    @property
    def points(self) -> tuple[str, ...]:
        return (COUNT,)

    @property
    def cables(self) -> tuple[str, ...]:
        return (CABLE,)

    def judge(self, history: History) -> Iterator[Violation]:
        relay = Relay(history)
        for rule in RULES:
            for violation in rule(relay):
                yield replace(violation, text=f"by GOOSE {violation.text}")


@dataclass(frozen=True)
class Entry:
    """Of a state that came."""

    at_s: float
    point: str
    value: int
    good: bool

    def __str__(self) -> str:
        return f"{self.point} is told as {self.value}, {'good' if self.good else 'not good'}"


class Relay:
    """What it was told, and what it told."""

    def __init__(self, history: History) -> None:
        self.history = history
        self.lines = history.run.told(RELAY)

    @property
    def published(self) -> tuple[str, str]:
        world = self.history.run.world
        line = world.lines[0]
        return f"{line}001.{10001 if world.bits else 30001}", f"{line}003.30002"

    @cached_property
    def entries(self) -> list[Entry]:
        """In the order in which they came."""
        return [
            Entry(seconds(line["at"]), point, value, quality & VALIDITY == 0)
            for line in self.lines
            if "values" in line
            for point, value, quality in zip(
                self.published, line["values"][::2], line["values"][1::2], strict=True
            )
        ]

    @cached_property
    def sent(self) -> list[tuple[float, int]]:
        """From when on which count."""
        return [(seconds(line["at"]), line["sent"]) for line in self.lines if "sent" in line]

    @cached_property
    def counts(self) -> list[Told]:
        """What a centre was told of it."""
        return [told for told in self.history.all_told if told.point == COUNT]

    @cached_property
    def own(self) -> list[tuple[float, float]]:
        """When messages may find no way."""
        faults = [fault for fault in self.history.faults if fault.of in (PROCESS, "rtud", CABLE)]
        return [(fault.at_s, fault.end_s + AFTER_S) for fault in faults]


def states_are_true(relay: Relay) -> Iterator[Violation]:
    history = relay.history
    for entry in relay.entries:
        from_s = entry.at_s - AGE_S - history.delay_s(entry.at_s) if entry.good else float("-inf")
        if not history.held_within(entry.point, entry.value, from_s, entry.at_s):
            yield Violation("true", entry.at_s, f"{entry}")


def states_are_good(relay: Relay) -> Iterator[Violation]:
    history = relay.history
    for entry in relay.entries:
        if entry.good or entry.at_s < CHANGES_FROM_S:
            continue
        times = [*troubled_times(device_of(entry.point), history.faults), *relay.own]
        if not overlaps(times, entry.at_s - AGE_S - history.delay_s(entry.at_s), entry.at_s):
            yield Violation("good", entry.at_s, f"{entry}")


def states_are_sent(relay: Relay) -> Iterator[Violation]:
    """Of what a device holds for a while."""
    history, point = relay.history, relay.published[1]
    told = {entry.value for entry in relay.entries if entry.point == point}
    held = history.held[point]
    ends = [since for since, _ in held[1:]] + [history.end_s]
    for (since_s, value), until_s in zip(held, ends, strict=True):
        until_s = min(until_s, since_s + HELD_S)
        if until_s < since_s + HELD_S or value == 0 or value in told:
            continue
        if not could_be_lost(point, since_s, until_s, history) and not overlaps(relay.own, since_s, until_s):
            yield Violation("no event lost", since_s, f"{point} was {value}")


def counts_are_true(relay: Relay) -> Iterator[Violation]:
    """What is told of the relay's count it had sent shortly before: a message lives for two seconds."""
    ends = [since for since, _ in relay.sent[1:]] + [float("inf")]
    for told in relay.counts:
        until_s = told.at_s if told.tag_s is None else told.tag_s
        from_s = until_s - age_s(relay.history, told)
        lived = [
            value
            for (since_s, value), end_s in zip(relay.sent, ends, strict=True)
            if since_s <= until_s + NEXT_S and from_s < end_s
        ]
        if told.value not in (lived if told.good else [0, *lived]):
            yield Violation("true", told.at_s, f"{COUNT} is told as {told}")


def counts_are_good(relay: Relay) -> Iterator[Violation]:
    for told in relay.counts:
        at_s = told.at_s if told.tag_s is None else told.tag_s
        if not told.good and at_s > CHANGES_FROM_S:
            from_s = at_s - AGE_S - relay.history.delay_s(told.at_s)
            if not overlaps(relay.own, from_s, at_s):
                yield Violation("good", told.at_s, f"{COUNT} is told as {told}")


def counts_are_told(relay: Relay) -> Iterator[Violation]:
    told = {one.value for one in relay.counts if one.good and one.tag_s is not None}
    for since_s, value in relay.sent:
        until_s = since_s + HELD_S
        if value in told or not CHANGES_FROM_S < since_s < relay.history.end_s - SETTLED_S:
            continue
        if not could_be_lost(COUNT, since_s, until_s, relay.history) and not overlaps(
            relay.own, since_s, until_s
        ):
            yield Violation("no event lost", since_s, f"{COUNT} was {value}")


def all_recovers(relay: Relay) -> Iterator[Violation]:
    history = relay.history
    last = {entry.point: entry for entry in relay.entries}
    for point in relay.published:
        entry, value = last.get(point), history.held[point][-1][1]
        if not entry or not entry.good or entry.value != value:
            yield Violation(
                "recovery", history.end_s, f"{point} is {value}, the relay knows {entry or 'nothing'}"
            )
    value = max(value for since_s, value in relay.sent if since_s < history.end_s - HELD_S)
    if not relay.counts or not relay.counts[-1].good or relay.counts[-1].value < value:
        yield Violation("recovery", history.end_s, f"{COUNT} is {value}, the centre knows another")


RULES = (
    states_are_true,
    states_are_good,
    states_are_sent,
    counts_are_true,
    counts_are_good,
    counts_are_told,
    all_recovers,
)
