# SPDX-License-Identifier: GPL-3.0-or-later
"""The plant under a clock of its own (docs/plant.md): one seed is one trace, whatever else the host does."""

import os
import shlex
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest

import plant_world
from lab.patience import Deadline
from plant_faults import FAULTS, look_for, names
from plant_history import LINK_UP, WALL_NS, Violation
from plant_judge import judge
from plant_run import shrunk, story
from plant_seeds import FAR_LINES, calm, far, restless, troubled
from plant_trials import Lines, busy_processes, run_alone, run_script, run_world, spoiled_copy
from plant_world import BUILD, PORT, Change, Fault, Run, World

SECONDS = 60.0
TROUBLED_S = 300.0
SHORT_S = 140.0  # nine faults of all kinds, and time to recover
INVALID, NOT_TOPICAL = 128, 64


def run(seed: int, folder: Path) -> Run:
    return run_world(calm(seed, SECONDS), folder)


@pytest.fixture(scope="module")
def first(programs: Path, linesim_program: Path, folder: Path) -> Run:
    return run(1, folder / "first")


def test_one_seed_one_trace(first: Run, folder: Path) -> None:
    assert run(1, folder / "second").trace == first.trace


@pytest.mark.slow
def test_one_seed_one_trace_beside_busy_processes(first: Run, folder: Path) -> None:
    with busy_processes():
        assert run(1, folder / "busy").trace == first.trace


@pytest.mark.slow
def test_another_seed_another_trace(first: Run, folder: Path) -> None:
    assert run(2, folder / "other").trace != first.trace


def test_the_last_value_of_each_register_comes_to_the_centre(first: Run) -> None:
    held = {change.point: change.value for change in first.world.changes if change.at_s < SECONDS - 10}
    told = {told["point"]: told["value"] for told in first.told("consumer") if told["kind"] == "value"}
    last = {change.point for change in first.world.changes if change.at_s >= SECONDS - 10}
    assert len(held) > 10
    assert {point: told[point] for point in held.keys() - last} == {
        point: held[point] for point in held.keys() - last
    }


def test_the_trace_is_in_the_order_of_its_time(first: Run) -> None:
    times = [float(line.split(b" ", 1)[0]) for line in first.trace.splitlines()]
    assert times == sorted(times)
    assert times[-1] > SECONDS
    names = {line.split(b" ")[1] for line in first.trace.splitlines()}
    assert {b"linesim#1", b"rtud#1", b"rtu-modbus-1#1", b"rtu-iec104#1", b"rtu-centre#1"} <= names


@pytest.mark.slow
def test_a_world_with_faults_is_one_trace(programs: Path, linesim_program: Path, folder: Path) -> None:
    world = troubled(18, SHORT_S, fault_every_s=5.0)
    assert {fault.kind for fault in world.faults} == {"kill", "stop", "silent", "cut", "lost", "power"}
    first = run_world(world, folder / "troubled")
    with busy_processes():
        assert run_world(world, folder / "troubled-busy").trace == first.trace


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 3, 6, 8])
def test_what_must_hold_in_a_world_with_faults(
    programs: Path, linesim_program: Path, folder: Path, seed: int
) -> None:
    ran = run_world(troubled(seed, TROUBLED_S, fault_every_s=8.0), folder / f"seed-{seed}")
    violations = judge(ran)
    assert not violations, story(ran, violations)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [8, 9])
def test_what_must_hold_on_lines_of_a_busy_host(
    programs: Path, linesim_program: Path, folder: Path, seed: int
) -> None:
    ran = run_world(restless(seed, TROUBLED_S), folder / f"lines-{seed}")
    violations = judge(ran)
    assert not violations, story(ran, violations)


@pytest.mark.slow
def test_a_world_far_away_is_one_trace(programs: Path, linesim_program: Path, folder: Path) -> None:
    world = far(14, 100.0, fault_every_s=3.0)
    assert {"cut", "hung", "kill", "reload", "step"} <= {fault.kind for fault in world.faults}
    first = run_world(world, folder / "far")
    assert run_world(world, folder / "far-again").trace == first.trace


@pytest.mark.slow
def test_what_must_hold_far_away(programs: Path, linesim_program: Path, folder: Path) -> None:
    ran = run_world(far(7, TROUBLED_S), folder / "far-7")
    violations = judge(ran)
    assert not violations, story(ran, violations)


def test_what_must_hold_in_a_calm_world(first: Run) -> None:
    assert judge(first) == []


# ---- the faults do what they say ----------------------------------------------------------------------


def lines_of(ran: Run, *words: bytes) -> list[bytes]:
    return [line for line in ran.trace.splitlines() if all(word in line for word in words)]


def faulty(folder: Path, *faults: Fault) -> Run:
    world = World(2, SECONDS, (), faults)  # whose centre interrogates again and again
    return run_world(world, folder / "-".join(f"{fault.kind}-{fault.of}" for fault in faults))


def test_a_module_is_killed_and_begins_again(programs: Path, linesim_program: Path, folder: Path) -> None:
    ran = faulty(folder, Fault(10.0, "kill", "rtu-iec104", calls=3))
    assert len(lines_of(ran, b"rtu-iec104#1 is killed")) == 1
    assert len(lines_of(ran, b"rtu-iec104#2 begins")) == 1


@pytest.mark.slow
def test_a_module_that_stops_does_nothing_meanwhile(
    programs: Path, linesim_program: Path, folder: Path
) -> None:
    ran = faulty(folder, Fault(10.0, "stop", "rtu-modbus-1", calls=5, for_s=1.0))
    times = [float(line.split()[0]) for line in lines_of(ran, b" rtu-modbus-1#1 ")]
    assert max(after - before for before, after in pairwise(times)) == pytest.approx(1.0)


def told_behind_a_stop(folder: Path, *others: Fault) -> list[tuple[int, int]]:
    """Quality and value of a register that changes at 20.6 s, while its process stands, from 21.7 s on."""
    changes = (
        Change(16.0, "2.3", "input_registers", 0, 11),
        Change(20.6, "2.3", "input_registers", 0, 14),
    )
    stop = Fault(20.3, "stop", "rtu-modbus-1", calls=5, for_s=1.4)
    world = World(2, 45.0, changes, (stop, *others), scanned=(2,))
    ran = run_world(world, folder / f"returned-{len(others)}")
    assert judge(ran) == []
    return [
        (line["quality"], line["value"])
        for line in ran.told("consumer")
        if line.get("point") == "2003.30001" and (line["tag"] or 0) - WALL_NS > 21.7e9
    ]


@pytest.mark.slow
def test_a_line_process_that_was_stopped_reads_before_it_is_believed(
    programs: Path, linesim_program: Path, folder: Path
) -> None:
    assert told_behind_a_stop(folder) == [(0, 14)]


@pytest.mark.slow
def test_what_it_cannot_read_then_is_not_topical(programs: Path, linesim_program: Path, folder: Path) -> None:
    told = told_behind_a_stop(folder, Fault(20.9, "silent", "2.3", for_s=10.0))
    assert told == [(NOT_TOPICAL, 11), (INVALID, 11), (0, 14)]


@pytest.mark.slow
def test_a_scan_in_which_it_was_stopped_does_not_say_how_long_one_takes(
    programs: Path, linesim_program: Path, folder: Path
) -> None:
    """Three stops in a row: what was read before the second is more than 3 s old behind the third."""
    stops = ((20.3, 1.9), (22.85, 1.7), (24.65, 1.8))
    changes = (
        Change(16.0, "2.3", "input_registers", 0, 11),
        Change(23.0, "2.3", "input_registers", 0, 14),
    )
    faults = tuple(Fault(at_s, "stop", "rtu-modbus-1", calls=1, for_s=for_s) for at_s, for_s in stops)
    ran = run_world(World(2, 45.0, changes, faults, scanned=(2,)), folder / "stops")
    assert judge(ran) == []


@pytest.mark.slow
def test_with_rtud_its_modules_are_killed(programs: Path, linesim_program: Path, folder: Path) -> None:
    ran = faulty(folder, Fault(10.0, "kill", "rtud"))
    assert len(lines_of(ran, b"rtud#2 begins")) == 1
    assert len(lines_of(ran, b"rtu-iec104#2 begins")) == 1
    killed_s = float(lines_of(ran, b"rtud#1 is killed")[0].split()[0])
    assert max(float(line.split()[0]) for line in lines_of(ran, b" rtu-modbus-1#1 ")) <= killed_s


@pytest.mark.slow
def test_nothing_comes_through_a_cut(programs: Path, linesim_program: Path, folder: Path) -> None:
    ran = faulty(folder, Fault(10.0, "cut", f"{plant_world.PORT}", for_s=5.0))
    at_s = [told["at"] / 1e9 - 1000 for told in ran.told("consumer")]
    assert not [time for time in at_s if 10.0 < time < 15.0]
    assert [time for time in at_s if time > 15.0]


def connections(ran: Run) -> list[float]:
    """When one was made."""
    up = [told for told in ran.told("consumer") if told.get("state") == LINK_UP]
    return [told["at"] / 1e9 - 1000 for told in up]


@pytest.mark.slow
def test_a_connection_that_is_lost_is_found_out_by_each_side(
    programs: Path, linesim_program: Path, folder: Path
) -> None:
    """By a frame that is not acknowledged in t1, or by t3 and t1: nobody is told."""
    ran = faulty(folder, Fault(10.0, "lost", f"{plant_world.PORT}"))
    first, second = connections(ran)
    assert first < 10.0 + 15.0 <= second < 10.0 + 20.0 + 15.0 + 2.0
    assert not [told for told in ran.told("consumer") if 10.0 < told["at"] / 1e9 - 1000 < second - 1.0]
    assert judge(ran) == []


@pytest.mark.slow
def test_a_centre_that_lost_power_comes_while_its_old_connection_is_there(
    programs: Path, linesim_program: Path, folder: Path
) -> None:
    ran = faulty(folder, Fault(10.0, "power", f"{plant_world.PORT}"))
    _, second = connections(ran)
    assert second < 15.0
    log = (ran.folder / "gateway.log").read_text()
    ended = [line for line in log.splitlines() if "rtu-iec104" in line and "connection ends" in line]
    assert len(ended) == 1
    assert ended[0] > "2026-01-01T00:00:15"
    assert judge(ran) == []


@pytest.mark.slow
def test_points_of_a_silent_device_are_invalid(programs: Path, linesim_program: Path, folder: Path) -> None:
    ran = faulty(folder, Fault(10.0, "silent", "1.2", for_s=10.0))
    bad = {told["point"] for told in ran.told("consumer") if told.get("quality") and told["at"] > 1010e9}
    assert bad == {"1002.10001", "1002.30001", "1002.30002"}


def answers_between(ran: Run, device: str, from_s: float, to_s: float) -> int:
    within = [
        line["answers"][device] for line in ran.told("watch") if from_s <= line["at"] / 1e9 - 1000 <= to_s
    ]
    return within[-1] - within[0]


@pytest.mark.slow
def test_a_line_that_is_unplugged_answers_nothing(
    programs: Path, linesim_program: Path, folder: Path
) -> None:
    ran = faulty(folder, Fault(10.0, "unplugged", "2", for_s=15.0))
    assert answers_between(ran, "2.1", 10.2, 24.8) == 0
    assert answers_between(ran, "1.1", 10.2, 24.8) > 25
    assert answers_between(ran, "2.1", 45.0, 58.0) > 20
    bad = {told["point"] for told in ran.told("consumer") if told.get("quality") and told["at"] > 1010e9}
    assert len(bad) == 9
    assert {point[0] for point in bad} == {"2"}


@pytest.mark.slow
def test_a_device_that_is_late_answers_behind_its_time(
    programs: Path, linesim_program: Path, folder: Path
) -> None:
    """It counts as dead: what it says comes to no request."""
    ran = faulty(folder, Fault(10.0, "late", "1.2", for_s=15.0, late_s=0.8))
    bad = {told["point"] for told in ran.told("consumer") if told.get("quality") and told["at"] > 1010e9}
    assert bad == {"1002.10001", "1002.30001", "1002.30002"}
    assert 0 < answers_between(ran, "1.2", 10.2, 24.8) < 15


def test_a_device_that_needs_a_pause_for_a_while(programs: Path, linesim_program: Path, folder: Path) -> None:
    """It is read behind that pause, and soon without it."""
    ran = run_world(
        World(2, SECONDS, (), (Fault(10.0, "deaf", "2.2", for_s=10.0, late_s=0.3),), scanned=(2,)),
        folder / "deaf",
    )
    assert 10 < answers_between(ran, "2.2", 10.2, 19.8) < 25
    assert answers_between(ran, "2.2", 35.0, 45.0) > 25
    assert judge(ran) == []


@pytest.mark.slow
def test_a_configuration_is_loaded_by_a_signal(programs: Path, linesim_program: Path, folder: Path) -> None:
    """And rtud begins with it, when it was killed before it was asked."""
    faults = (
        Fault(15.0, "reload", "2", calls=1),
        Fault(25.0, "reload", "2", calls=1),
        Fault(27.0, "kill", "rtud"),
        Fault(27.05, "reload", "0", calls=1),
    )
    ran = run_world(World(2, SECONDS, (), faults), folder / "signalled")
    in_force = [line["at"] / 1e9 - 1000 for line in ran.told("reload") if line["kind"] == "in force"]
    assert len(in_force) == 3
    assert in_force[1] < 27.0, "the second changes nothing, as the log says at once"
    assert len([line for line in ran.log("gateway") if "SIGHUP: reads the configuration" in line]) >= 2
    assert answers_between(ran, "1.3", 21.0, 24.0) == 0
    assert answers_between(ran, "1.3", 45.0, 55.0) > 15
    assert judge(ran) == []


def test_sessions_that_hang_and_that_are_closed(programs: Path, linesim_program: Path, folder: Path) -> None:
    """The devices behind a hung one are invalid for some seconds; those behind one that is closed are not."""
    faults = (Fault(10.0, "hung", "7"), Fault(30.0, "closing", "7", for_s=10.0))
    idling = Fault(42.0, "idling", "7", for_s=10.0, late_s=0.3)
    ran = run_world(World(2, SECONDS, (), (*faults, idling), lines=FAR_LINES), folder / "sessions")
    bad = {told["at"] // 10**9 - 1000 for told in ran.told("consumer") if told.get("quality")}
    assert bad
    assert 10 <= min(bad) <= max(bad) < 20
    assert len(lines_of(ran, b" linesim#1 accept ")) > 40
    assert answers_between(ran, "7.1", 30.0, 52.0) > 40
    assert judge(ran) == []


@pytest.mark.slow
def test_the_calendar_clock_is_set(programs: Path, linesim_program: Path, folder: Path) -> None:
    """No connection ends, no point is bad; the judge knows each time tag."""
    faults = (Fault(20.0, "step", "clock", by_s=5000.0), Fault(35.0, "step", "clock", by_s=-9000.5))
    ran = run_world(World(2, SECONDS, calm(2, SECONDS).changes, faults), folder / "steps")
    tags = [told["tag"] for told in ran.told("consumer") if told.get("tag")]
    assert max(tags) - min(tags) > 8000 * 10**9
    assert judge(ran) == []


@pytest.fixture(scope="module")
def reloaded(programs: Path, linesim_program: Path, folder: Path) -> Run:
    """A register more, and then a device less."""
    faults = (Fault(20.0, "reload", "1"), Fault(35.0, "reload", "2"))
    changes = tuple(Change(15.0 + at, "1.1", "input_registers", 2, at + 1) for at in range(0, 30, 4))
    return run_world(World(2, SECONDS, changes, faults), folder / "reloaded")


@pytest.mark.slow
def test_a_configuration_is_loaded_and_another(reloaded: Run) -> None:
    assert [line["kind"] for line in reloaded.told("reload")] == ["asked", "in force"] * 2
    good = {
        told["at"] // 10**9 - 1000 for told in reloaded.told("consumer") if told.get("point") == "1001.30003"
    }
    assert 20 <= min(good) <= max(good) < 40
    assert answers_between(reloaded, "1.3", 41.0, 55.0) == 0
    assert answers_between(reloaded, "1.2", 41.0, 55.0) > 20
    assert judge(reloaded) == []


# ---- the judge sees what is wrong ----------------------------------------------------------------------


def value_events(lines: Lines) -> list[int]:
    """Where the events of registers are."""
    return [place for place, line in enumerate(lines) if line.get("type") == 35 and line["quality"] == 0]


def with_another_value(lines: Lines) -> None:
    lines[value_events(lines)[3]]["value"] = 31999


def without_one(lines: Lines) -> None:
    """Of a value that was held for long: the judge knows which."""
    for place in reversed(value_events(lines)):
        del lines[place]


def with_one_twice(lines: Lines) -> None:
    place = value_events(lines)[3]
    lines.insert(place, dict(lines[place]))


def with_an_old_one_behind(lines: Lines) -> None:
    events = value_events(lines)
    point = lines[events[-1]]["point"]
    old = next(lines[place] for place in events if lines[place]["point"] == point)
    lines.append(old | {"at": lines[-1]["at"]})


def with_one_good_again_too_early(lines: Lines) -> None:
    event = lines[value_events(lines)[-1]]
    lines.append(event | {"quality": 128, "tag": event["tag"] + 10**9})
    lines.append(event | {"quality": 0, "tag": event["tag"] + 10**8})


def with_a_later_value_that_is_bad(lines: Lines) -> None:
    places = value_events(lines)
    later = next(place for place in places if lines[place]["value"] > 20)
    lines.insert(places[0], lines[later] | {"quality": 128, "tag": lines[places[0]]["tag"]})


def with_an_alarm_of_nothing(lines: Lines) -> None:
    place = value_events(lines)[3]
    lines.insert(place, lines[place] | {"quality": 128})


def with_an_answer_that_is_good_while_events_are_not(lines: Lines) -> None:
    """A point is told invalid for 4 s; an interrogation between says that it is good."""
    event = lines[value_events(lines)[-1]]
    for at_s, told in ((0, {"quality": 128}), (2, {"tag": None, "cause": 20}), (4, {})):
        moved = {"at": event["at"] + at_s * 10**9, "tag": event["tag"] + at_s * 10**9}
        lines.append(event | moved | told)


def with_a_connection_that_ends(lines: Lines) -> None:
    lines.append({"at": lines[-1]["at"], "kind": "link", "state": 4})


def with_an_end_that_is_bad(lines: Lines) -> None:
    lines.append(lines[value_events(lines)[-1]] | {"quality": 128})


@pytest.mark.parametrize(
    ("spoil", "rule"),
    [
        (with_another_value, "true"),
        (without_one, "no event lost"),
        (with_one_twice, "once"),
        (with_an_old_one_behind, "order"),
        (with_one_good_again_too_early, "order"),
        (with_a_later_value_that_is_bad, "true"),
        (with_an_end_that_is_bad, "recovery"),
        (with_an_alarm_of_nothing, "good"),
        (with_an_answer_that_is_good_while_events_are_not, "same"),
        (with_a_connection_that_ends, "connection"),
    ],
)
def test_the_judge_sees(first: Run, tmp_path: Path, spoil: Callable[[Lines], None], rule: str) -> None:
    lines = first.told("consumer")
    spoil(lines)
    spoiled = spoiled_copy(first, tmp_path, "consumer", lines)
    assert rule in {violation.rule for violation in judge(spoiled)}


@pytest.mark.parametrize(("ended_ms", "is_in_order"), [(1900, True), (2100, False)])
def test_what_a_module_tells_behind_its_loss_is_followed_by_its_end(
    first: Run, tmp_path: Path, ended_ms: int, is_in_order: bool
) -> None:
    """It was stopped, told what it had read before, and was stopped again: as found by seed 2049."""
    lines = first.told("consumer")
    event = lines[value_events(lines)[-1]]
    for by_ms, tag_ms, quality in ((200, 200, INVALID), (1000, 100, 0), (1000 + ended_ms, 3000, INVALID)):
        moved = {"at": event["at"] + by_ms * 10**6, "tag": event["tag"] + tag_ms * 10**6}
        lines.append(event | moved | {"quality": quality})
    spoiled = spoiled_copy(first, tmp_path, "consumer", lines)
    assert ("order" not in {violation.rule for violation in judge(spoiled)}) is is_in_order


@pytest.fixture(scope="module")
def commanded(programs: Path, linesim_program: Path, folder: Path) -> Run:
    world = replace(far(5, SECONDS), faults=())
    return run_world(world, folder / "commanded")


def with_a_write_twice(lines: Lines) -> None:
    lines.append(lines[-1] | {"at": lines[-1]["at"]})


def without_a_write(lines: Lines) -> None:
    del lines[3]


def without_an_end(lines: Lines) -> None:
    """Of the third command."""
    lines[:] = [line for line in lines if line["kind"] != "progress" or line["order"] != 3]


@pytest.mark.slow
def test_commands_are_executed_and_answered(commanded: Run) -> None:
    ends = [line for line in commanded.told("consumer") if line.get("state") == 9]
    assert len(ends) > 5
    assert judge(commanded) == []


@pytest.mark.parametrize(
    ("part", "spoil", "rule"),
    [
        ("writes", with_a_write_twice, "command once"),
        ("writes", without_a_write, "command true"),
        ("consumer", without_an_end, "command done"),
    ],
)
def test_the_judge_sees_of_commands(
    commanded: Run, tmp_path: Path, part: str, spoil: Callable[[Lines], None], rule: str
) -> None:
    lines = commanded.told(part)
    spoil(lines)
    assert rule in {violation.rule for violation in judge(spoiled_copy(commanded, tmp_path, part, lines))}


@pytest.mark.parametrize(
    ("kind", "of", "by_s", "may_fail"),
    [
        ("closing", "7", 0.5, True),
        ("closing", "7", -5.0, False),
        ("lost", f"{PORT}", -40.0, True),
        ("lost", f"{PORT}", -46.0, False),
    ],
)
def test_a_command_may_meet_what_nobody_knows_yet(
    commanded: Run, tmp_path: Path, kind: str, of: str, by_s: float, may_fail: bool
) -> None:
    """The first hang-up behind an answer, or a lost connection: as found by the seeds 2084 and 2342."""
    lines = commanded.told("consumer")
    ordered = next(line for line in lines if line["kind"] == "order" and line["order"] == 3)
    without_an_end(lines)
    spoiled = spoiled_copy(commanded, tmp_path, "consumer", lines)
    unknown = Fault(ordered["at"] / 1e9 - 1000 + by_s, kind, of)
    found = judge(replace(spoiled, world=replace(commanded.world, faults=(unknown,))))
    assert ("command done" not in {violation.rule for violation in found}) is may_fail


def test_the_judge_sees_a_device_that_is_asked_too_seldom(first: Run, tmp_path: Path) -> None:
    """Half as often, for a dozen seconds."""
    lines = first.told("watch")
    for place in range(20, len(lines)):
        lines[place]["answers"]["2.1"] -= min(place - 20, 12)
    assert {violation.rule for violation in judge(spoiled_copy(first, tmp_path, "watch", lines))} == {
        "period"
    }


def test_the_judge_sees_a_value_that_is_not_in_the_configuration(reloaded: Run, tmp_path: Path) -> None:
    lines = reloaded.told("consumer")
    gone = next(line for line in lines if line.get("point") == "1001.30003" and line["quality"] == 0)
    late = gone | {"at": 1055 * 10**9, "tag": WALL_NS + 50 * 10**9, "value": 29, "cause": 3}
    told = judge(spoiled_copy(reloaded, tmp_path, "consumer", [*lines, late]))
    assert [violation.rule for violation in told] == ["configuration"]


def test_the_judge_sees_a_device_that_is_not_in_the_configuration(reloaded: Run, tmp_path: Path) -> None:
    lines = reloaded.told("watch")
    lines[-1]["answers"]["1.3"] += 1
    told = judge(spoiled_copy(reloaded, tmp_path, "watch", lines))
    assert [violation.rule for violation in told] == ["configuration"]


def test_the_judge_sees_a_configuration_that_is_never_whole(reloaded: Run, tmp_path: Path) -> None:
    told = judge(spoiled_copy(reloaded, tmp_path, "reload", reloaded.told("reload")[:-1]))
    assert [violation.rule for violation in told] == ["recovery"]


def test_the_judge_sees_a_log_that_is_flooded(first: Run, tmp_path: Path) -> None:
    spoiled = spoiled_copy(first, tmp_path, "watch", first.told("watch"))
    flood = "".join(f"2026-01-01T00:00:{second:02}.000Z rtu-web info: here\n" * 2 for second in range(31))
    (tmp_path / "gateway.log").write_text(flood)
    assert [violation.text for violation in judge(spoiled)] == ["rtu-web writes 62 lines in a minute"]


@pytest.mark.parametrize(("count", "is_flooded"), [(76, False), (77, True)])
def test_a_reload_may_have_lines_of_its_own(
    reloaded: Run, tmp_path: Path, count: int, is_flooded: bool
) -> None:
    """Two of them, of two lines with six devices: as found by seed 2054."""
    spoiled = spoiled_copy(reloaded, tmp_path, "watch", reloaded.told("watch"))
    (tmp_path / "gateway.log").write_text("2026-01-01T00:00:07.000Z rtu-modbus-1 info: here\n" * count)
    assert ("log" in {violation.rule for violation in judge(spoiled)}) is is_flooded


def test_the_judge_sees_a_silence_that_nobody_tells(first: Run, tmp_path: Path) -> None:
    spoiled = spoiled_copy(first, tmp_path, "watch", first.told("watch"))
    world = replace(first.world, faults=(Fault(20.0, "silent", "1.3", for_s=10.0),))
    told = [violation for violation in judge(replace(spoiled, world=world)) if violation.rule == "silence"]
    assert [violation.text.split()[0] for violation in told] == ["1003.10001", "1003.30001", "1003.30002"]


# ---- make plant ----------------------------------------------------------------------------------------


def test_a_story_has_the_faults_that_it_takes(first: Run) -> None:
    faults = tuple(Fault(10.0 + number, "cut", f"{2400 + number}", for_s=1.0) for number in range(6))
    tried = []

    def attempt(world: World, *, traced: bool = False) -> tuple[Run, list[Violation]]:
        tried.append(world)
        folder = first.folder / "none"
        fails = {faults[1], faults[4]} <= set(world.faults)
        found = [Violation("true", 20.0, "a value"), Violation("once", 12.0, "an event")] if fails else []
        return Run(world, folder, 1.0, 0, ""), found

    least = shrunk(World(1, SECONDS, (), faults), {"true"}, attempt)
    assert least.faults == (faults[1], faults[4])
    assert [len(world.faults) for world in tried] == [3, 3, 5, 4, 4, 3, 2, 2]
    ran, violations = attempt(least)
    assert story(ran, violations).splitlines() == [
        "  11.000 s: TCP port 2401 is cut for 1.000 s",
        "! 12.000 s: once: an event",
        "  14.000 s: TCP port 2404 is cut for 1.000 s",
        "! 20.000 s: true: a value",
    ]


def plant(*words: object) -> "subprocess.CompletedProcess[str]":
    program = plant_world.PARTS.with_name("plant_run.py")
    command = [sys.executable, program, *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.mark.slow
def test_one_seed_again_keeps_its_trace(programs: Path, linesim_program: Path, tmp_path: Path) -> None:
    result = plant("--seed", 3, "--hours", 0.04, "--out", tmp_path)
    assert result.returncode == 0, result.stdout + result.stderr
    assert "1 seeds, 0.04 hours of a plant" in result.stdout
    assert (tmp_path / "3" / "trace").stat().st_size > 10_000


def test_too_short_a_time_is_no_plant() -> None:
    result = plant("--hours", 0.01)
    assert (result.returncode, "expected a seed and 0.033 hours at least" in result.stderr) == (2, True)


# ---- faults of the past --------------------------------------------------------------------------------


@pytest.mark.parametrize("name", names())
def test_a_fault_of_the_past_fits_into_the_tree(name: str) -> None:
    """Who changes what is around it, changes the patch as well."""
    source = plant_world.REPOSITORY / "package" / "openrtu"
    command = ["patch", "--dry-run", "--force", "--fuzz=0", "--strip=1", "--input", FAULTS / f"{name}.patch"]
    result = subprocess.run(command, cwd=source, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout


@pytest.mark.slow
def test_the_plant_finds_a_fault_of_the_past(programs: Path, linesim_program: Path) -> None:
    assert "no event lost" in look_for("events-gone-when-sent", most_s=60.0).rules


# ---- the runner ----------------------------------------------------------------------------------------


def wait_until(condition: Callable[[], bool]) -> None:
    deadline = Deadline(60.0)
    while not condition():
        assert not deadline.over
        time.sleep(0.05)


def processes_with(argument: str) -> list[str]:
    """Which have it among their arguments. One may end while it is looked at."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if os.fsencode(argument) in (process / "cmdline").read_bytes().split(b"\0"):
                found.append(process.name)
    return found


NESTED = """
import ctypes, select, time
libc = ctypes.CDLL(None)
timer = libc.timerfd_create(time.CLOCK_MONOTONIC, 0)
libc.timerfd_settime(timer, 0, (ctypes.c_long * 4)(0, 0, 2, 0), None)
inner, outer = select.epoll(), select.epoll()
inner.register(timer, select.EPOLLIN)
outer.register(inner.fileno(), select.EPOLLIN)
begun = time.monotonic()
found = outer.poll(10)
print(len(found), time.monotonic() - begun)
"""


ECHO = """
import socket
with socket.create_server(("127.0.0.1", 2404)) as server:
    peer, _ = server.accept()
    while octets := peer.recv(100):
        peer.sendall(octets)
"""
ASK = """
import select, socket, time
begun = time.monotonic()
def passed(): return round(time.monotonic() - begun, 3)
peer = socket.socket()
peer.setblocking(False)
peer.connect_ex(("127.0.0.1", 2404))
select.select([], [peer], [])
print("connected", passed())
peer.send(b"one")
peer.send(b"two")
select.select([peer], [], [])
print(peer.recv(100), passed())
peer.shutdown(socket.SHUT_WR)
select.select([peer], [], [])
print(peer.recv(100), passed())
"""


def test_a_link_with_delay(programs: Path, tmp_path: Path) -> None:
    lines = ["end\t60", "delay\t2404\t1\t1"]
    for name, script, at_s in (("echo", ECHO, "0"), ("ask", ASK, "1")):
        path = tmp_path / name
        path.write_text(script)
        start = ["start", name, at_s, f"{path}.out", f"{path}.log", sys.executable, "-I", "-S", f"{path}"]
        lines.append("\t".join(start))
    assert run_alone(tmp_path, "\n".join(lines) + "\n").returncode == 0
    said = (tmp_path / "ask.out").read_text()
    assert said == "connected 2.0\nb'onetwo' 4.0\nb'' 6.0\n", (said, (tmp_path / "ask.log").read_text())


FLUSH = """
import os, termios, tty
far, near = os.openpty()
tty.setraw(near)
got = 0
for _ in range(300):
    os.write(near, b"12345678")
    termios.tcflush(near, termios.TCOFLUSH)
    got += len(os.read(far, 100))
print(got)
"""


def test_what_was_written_to_a_terminal_has_left_it(programs: Path, tmp_path: Path) -> None:
    """A flush drops of it what the kernel's worker has not moved yet, as the host's load has it."""
    assert run_script(tmp_path, FLUSH).returncode == 0
    assert (tmp_path / "out").read_text() == "2400\n", (tmp_path / "log").read_text()


def test_an_epoll_in_an_epoll_knows_when_its_timer_is_due(programs: Path, tmp_path: Path) -> None:
    assert run_script(tmp_path, NESTED).returncode == 0
    assert (tmp_path / "out").read_text() == "1 2.0\n", (tmp_path / "log").read_text()


def test_a_shell_and_what_it_starts(programs: Path, tmp_path: Path) -> None:
    start = ["start", "shell", "0", f"{tmp_path}/out", f"{tmp_path}/log"]
    words = [*start, "/bin/sh", "-c", "date +%T; sleep 7; date +%T"]
    assert run_alone(tmp_path, "end\t60\n" + "\t".join(words) + "\n").returncode == 0
    assert (tmp_path / "out").read_text() == "00:00:00\n00:00:07\n", (tmp_path / "log").read_text()


def test_who_asks_for_the_time_until_it_passes_sees_it_pass(programs: Path, tmp_path: Path) -> None:
    script = "import time\nend = time.monotonic() + 0.005\nwhile time.monotonic() < end: pass\nprint('there')"
    assert run_script(tmp_path, script).returncode == 0
    assert (tmp_path / "out").read_text() == "there\n"


def test_a_process_whose_time_is_behind_the_end_never_begins(programs: Path, tmp_path: Path) -> None:
    assert run_script(tmp_path, "print('there')", at_s=70.0).returncode == 0
    assert (tmp_path / "out").read_text() == ""
    assert (tmp_path / "trace").read_bytes() == b""


def test_no_process_outlives_the_runner(programs: Path, tmp_path: Path) -> None:
    """As when make is interrupted: not even what another has started."""
    script = f"import time\nopen('{tmp_path}/there', 'w').close()\nwhile True: time.sleep(0.001)"
    (tmp_path / "script").write_text(script)
    python = shlex.join([sys.executable, "-I", "-S", f"{tmp_path}/script"])
    words = ["/bin/sh", "-c", f"{python}; true"]
    starts = [["start", name, "0", f"{tmp_path}/out", f"{tmp_path}/log", *words] for name in ("one", "other")]
    (tmp_path / "world").write_text("end\t1e7\n" + "".join("\t".join(start) + "\n" for start in starts))
    command = [BUILD / "plant", "--seed", "1", "--trace", "/dev/null", tmp_path / "world"]
    with subprocess.Popen(command) as runner:
        wait_until((tmp_path / "there").exists)
        runner.kill()
    wait_until(lambda: not processes_with(f"{tmp_path}/script"))


def test_a_crash_is_told(programs: Path, tmp_path: Path) -> None:
    words = [sys.executable, "-I", "-S", "-c", "import os; os.abort()"]
    start = ["start", "wild", "0", f"{tmp_path}/out", f"{tmp_path}/log", *words]
    result = run_alone(tmp_path, "end\t5\n" + "\t".join(start) + "\n")
    assert (result.returncode, result.stderr) == (1, "plant: wild crashes\n")
    assert b"wild#1 crashes" in (tmp_path / "trace").read_bytes()


@pytest.mark.parametrize(
    ("world", "said"),
    [
        ("end\tsoon\n", "soon: expected a time in seconds"),
        ("end\t5\n", "expected an end and a process"),
        ("begin\t5\n", "begin: unknown word"),
        ("end\t5\nstart\tx\t0\n", "start: expected a name, a time, two files and a program"),
        ("kill\trtud\t1\n", "expected a number"),
        ("kill\trtud\t1\t0\t3\toften\n", "often: expected nothing behind the stores, or rare"),
        ("lose\t2404\n", "expected a time in seconds"),
        ("step\t1\tlate\n", "expected a time in seconds"),
        ("delay\t2404\t2\t1\n", "expected a port, and two times"),
        ("host\trtu-centre\tnowhere\n", "expected a name and an IPv4 address"),
    ],
)
def test_a_world_that_is_none(programs: Path, tmp_path: Path, world: str, said: str) -> None:
    result = run_alone(tmp_path, world)
    assert (result.returncode, said in result.stderr) == (2, True), result.stderr
