# SPDX-License-Identifier: GPL-3.0-or-later
"""A client of IEC 61850, libiec61850's, that takes the buffered reports of all devices."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from string import ascii_letters as LETTERS
from typing import Any

from plant_excuses import AFTER_S, AGE_S, device_of, overlaps, troubled_times
from plant_history import NEXT_S, History, Violation, seconds
from plant_judge import is_followed, lost_of
from plant_libiec61850 import program
from plant_same import Event, tell_the_same
from plant_world import CHANGES_FROM_S, Front, Programs, World

PROCESS, CLIENT = "rtu-iec61850", "mms-client"
PROGRAM = "mms_client"
PORT = 1102
DATA_CHANGE, QUALITY_CHANGE, GENERAL = 1, 2, 16
MEMBER_OF_POINT = 2  # separators
VALIDITY = 3  # of the quality, its first two bits
CHOSEN, CHOSEN_UNIT = "brcbChosen", 2
# Whole points, and an attribute between them.
CHOSEN_POINTS = ("p{line}.2.d0", "p{line}.2.i0", "p{line}.2.i1[mag.f]", "p{line}.2.i1")
CHOSEN_MEMBERS = ("GGIO1$ST$Ind10001", "GGIO1$MX$AnIn30001", "GGIO1$MX$AnIn30002$mag$f", "GGIO1$MX$AnIn30002")
BLOCKS = ("brcbMeasured01", "brcbStatus01")


def is_chosen(world: World, line: int, unit: int) -> bool:
    """The device whose data set the configuration names."""
    return (line, unit) == (world.lines[0], CHOSEN_UNIT)


@dataclass(frozen=True)
class Mms(Front):
    def configure(self, world: World, config: dict[str, Any], folder: Path) -> None:
        chosen = CHOSEN_POINTS if world.bits else CHOSEN_POINTS[1:]
        members = [place.format(line=world.lines[0]) for place in chosen]
        reports = [{"name": CHOSEN, "buffered": True}]
        config["iec61850"] = {
            "address": "127.0.0.1",
            "port": PORT,
            "data_sets": [{"name": "chosen", "points": members, "reports": reports}],
        }

    def programs(self, world: World, folder: Path, gateway: Path) -> Programs:
        blocks = [
            f"OpenRTUCA{line * 1000 + unit}/LLN0.BR.{block}"
            for line, unit in world.units
            for block in ((f"{CHOSEN}01",) if is_chosen(world, line, unit) else BLOCKS[: 1 + world.bits])
        ]
        return {CLIENT: (2.0, [f"{program(PROGRAM)}", f"{PORT}", *blocks])}

    @property
    def processes(self) -> tuple[str, ...]:
        return (PROCESS,)

    def judge(self, history: History) -> Iterator[Violation]:
        reported = Reported(history)
        for rule in RULES:
            for violation in rule(reported):
                yield replace(violation, text=f"by IEC 61850 {violation.text}")


@dataclass(frozen=True)
class Member(Event):
    """A member of a report."""

    at_s: float
    reason: int
    session: int

    @property
    def is_change(self) -> bool:
        return bool(self.reason & (DATA_CHANGE | QUALITY_CHANGE))

    def __str__(self) -> str:
        state = "good" if self.good else "not good"
        return f"{self.point} is told as {self.value}, {state} of {self.tag_s:.3f} s"


def point_of(member: str) -> str:
    """Of OpenRTUCA1001/GGIO1$ST$Ind10001."""
    device, _, variable = member.partition("/")
    return f"{device.removeprefix('OpenRTUCA')}.{variable.rpartition('$')[2].lstrip(LETTERS)}"


def is_attribute(member: str) -> bool:
    return member.count("$") > MEMBER_OF_POINT


def number_of(value: bool | float | list[float]) -> int:
    """Of a state, or of a magnitude."""
    return int(value[0] if isinstance(value, list) else value)


class Reported:
    """What the client was told."""

    def __init__(self, history: History) -> None:
        self.history = history
        self.lines = history.run.told(CLIENT)

    @cached_property
    def all_members(self) -> list[Member]:
        members, session = [], 0
        for line in self.lines:
            session += line.get("state") == "down"
            if "member" not in line or is_attribute(line["member"]):
                continue
            value, quality, tag_ms = line["value"]
            members.append(
                Member(
                    point=point_of(line["member"]),
                    tag_s=self.history.tag_s(tag_ms * 1_000_000, at_s := seconds(line["at"])),
                    value=number_of(value),
                    good=quality & VALIDITY == 0,
                    at_s=at_s,
                    reason=line["reason"],
                    session=session,
                )
            )
        return members

    @cached_property
    def members(self) -> list[Member]:
        return [member for member in self.all_members if member.point in self.history.held]

    @property
    def own(self) -> list[tuple[float, float]]:
        """When the server may not be there."""
        faults = [fault for fault in self.history.faults if fault.of in (PROCESS, "rtud")]
        return [(fault.at_s, fault.end_s + AFTER_S) for fault in faults]


def members_are_true(reported: Reported) -> Iterator[Violation]:
    """As of `true`: a change by its time, a state as it comes."""
    history = reported.history
    for member in reported.members:
        until_s = member.tag_s + NEXT_S if member.is_change else member.at_s
        age_s = AGE_S + (0.0 if member.is_change else history.delay_s(member.at_s))
        from_s = until_s - age_s if member.good else float("-inf")
        if not history.held_within(member.point, member.value, from_s, until_s):
            yield Violation("true", member.at_s, f"{member}")


def members_are_good(reported: Reported) -> Iterator[Violation]:
    history = reported.history
    for member in reported.members:
        at_s = member.tag_s if member.is_change else member.at_s
        if member.good or at_s < CHANGES_FROM_S:
            continue
        times = troubled_times(device_of(member.point), history.faults)
        if not overlaps(times, at_s - AGE_S - history.delay_s(member.at_s), at_s + AGE_S):
            yield Violation("good", member.at_s, f"{member}")


def changes_are_in_order(reported: Reported) -> Iterator[Violation]:
    """Within an association. A return that is nothing new of one point is told of its neighbours."""
    changes = [member for member in reported.members if member.is_change]
    latest: dict[tuple[str, int], Member] = {}
    for place, member in enumerate(changes, 1):
        before = latest.get((member.point, member.session), member)
        latest[member.point, member.session] = member
        goes_back = member.tag_s < before.tag_s - NEXT_S
        if goes_back and not is_followed(member, before, changes[place:], reported.history):
            yield Violation("order", member.at_s, f"{member} after {before}")


def changes_are_changes(reported: Reported) -> Iterator[Violation]:
    """dchg is another value, within an association and the life of all who have to do with it."""
    latest: dict[str, Member] = {}
    for member in reported.all_members:
        before = latest.get(member.point)
        latest[member.point] = member
        if member.reason != DATA_CHANGE or not before or before.session != member.session:
            continue
        same = (before.value, before.good) == (member.value, member.good)
        times = [*reported.own, *troubled_times(device_of(member.point), reported.history.faults)]
        if same and not overlaps(times, before.at_s - AGE_S, member.at_s):
            yield Violation("change", member.at_s, f"{member}, as before")


def data_sets_are_as_named(reported: Reported) -> Iterator[Violation]:
    """A report on all has the members that the configuration names; an attribute is the value alone."""
    reports: dict[tuple[float, int], set[str]] = defaultdict(set)
    for line in reported.lines:
        if CHOSEN not in line.get("block", ""):
            continue
        name, at_s = line["member"].partition("/")[2], seconds(line["at"])
        if line["reason"] == GENERAL:
            reports[at_s, line["number"]].add(name)
        if is_attribute(name) == isinstance(line["value"], list):
            yield Violation("members", at_s, f"{name} is told as {line['value']}")
    wanted = CHOSEN_MEMBERS if reported.history.run.world.bits else CHOSEN_MEMBERS[1:]
    for (at_s, _), names in reports.items():
        if names != set(wanted):
            yield Violation("members", at_s, f"a report has the members {', '.join(sorted(names))}")


def no_change_is_lost(reported: Reported) -> Iterator[Violation]:
    """As of `no event lost`."""
    yield from lost_of(reported.history, {member.what for member in reported.members})


def associations_stay(reported: Reported) -> Iterator[Violation]:
    for line in reported.lines:
        at_s = seconds(line["at"])
        if line.get("state") == "down" and not overlaps(reported.own, at_s - NEXT_S, at_s):
            yield Violation("connection", at_s, "an association ends")


def tells_the_same(reported: Reported) -> Iterator[Violation]:
    changes = [member for member in reported.members if member.is_change]
    yield from tell_the_same(reported.history, "IEC 61850", changes, reported.own)


def all_recovers(reported: Reported) -> Iterator[Violation]:
    history = reported.history
    last = {member.point: member for member in reported.members}
    for point, held in history.held.items():
        member = last.get(point)
        if not member or not member.good or member.value != held[-1][1]:
            text = f"{point} is {held[-1][1]}, the client knows {member or 'nothing'}"
            yield Violation("recovery", history.end_s, text)


RULES = (
    members_are_true,
    members_are_good,
    changes_are_in_order,
    changes_are_changes,
    data_sets_are_as_named,
    no_change_is_lost,
    associations_stay,
    tells_the_same,
    all_recovers,
)
