# SPDX-License-Identifier: GPL-3.0-or-later
"""A disk that fails, and power cuts (docs/plant.md): what was synchronised stays, nothing torn is a value."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from front_disk import Disk
from plant_disk import Log, restore_after_a_power_cut
from plant_history import WALL_NS
from plant_judge import judge
from plant_seeds import calm, stored
from plant_trials import run_world, spoiled_copy
from plant_world import PORT, Fault, Run

SECONDS = 60.0
CUT = Fault(15.0, "cut", f"{PORT}", for_s=15.0)  # what happens waits for the centre


def run(folder: Path, seed: int, *faults: Fault) -> Run:
    return run_world(replace(calm(seed, SECONDS), faults=faults, fronts=(Disk(),)), folder)


def logged(ran: Run, *words: str) -> list[str]:
    return [line for line in ran.log("gateway") if all(word in line for word in words)]


@pytest.mark.parametrize("seed", [1, 2])
def test_events_outlive_a_power_cut(programs: Path, linesim_program: Path, folder: Path, seed: int) -> None:
    """Those of the first journal of a new gateway, too: its folder was made a moment ago."""
    ran = run(folder / f"cut-{seed}", seed, CUT, Fault(26.0, "blackout", "rtu-journal", calls=7))
    assert len(logged(ran, "events restored from the journal")) == 1
    assert judge(ran) == []


@pytest.mark.slow
def test_a_world_with_a_disk_is_one_trace(programs: Path, linesim_program: Path, folder: Path) -> None:
    world = stored(59, 120.0, fault_every_s=4.0)
    kinds = {"blackout", "cut", "full", "kill", "memory", "power", "refuses", "silent", "stop", "worn"}
    assert {fault.kind for fault in world.faults} == kinds
    first = run_world(world, folder / "disk")
    assert run_world(world, folder / "disk-again").trace == first.trace
    assert judge(first) == []


@pytest.fixture(scope="module")
def full(programs: Path, linesim_program: Path, folder: Path) -> Run:
    return run(folder / "full", 3, CUT, Fault(18.0, "full", "disk", for_s=8.0))


def test_a_full_disk_is_said_once_and_written_again(full: Run) -> None:
    assert len(logged(full, "rtu-journal", "cannot write", "No space left")) == 1
    assert len(logged(full, "rtu-journal", "writes again")) == 1
    assert judge(full) == []


def with_log(ran: Run, tmp_path: Path, without: str) -> Run:
    spoiled = spoiled_copy(ran, tmp_path, "watch", ran.told("watch"))
    kept = [line for line in ran.log("gateway") if without not in line]
    (tmp_path / "gateway.log").write_text("".join(f"{line}\n" for line in kept))
    return spoiled


def test_the_judge_sees_that_a_full_disk_is_not_said(full: Run, tmp_path: Path) -> None:
    silent = judge(with_log(full, tmp_path, "cannot write"))
    assert {violation.rule for violation in silent} == {"disk"}


def told_between(ran: Run, from_s: float, to_s: float) -> list[int]:
    """Values of registers with such a time tag, of which each is there once."""
    tags = [WALL_NS + int(at_s * 1e9) for at_s in (from_s, to_s)]
    values = [
        line["value"]
        for line in ran.told("consumer")
        if line.get("type") == 35 and tags[0] < (line["tag"] or 0) < tags[1] and line["quality"] == 0
    ]
    return sorted(set(values))


def test_the_judge_sees_what_a_power_cut_must_not_lose(
    programs: Path, linesim_program: Path, folder: Path
) -> None:
    """What was in the journal by then. Without one it would be excused."""
    ran = run(folder / "lost", 3, CUT, Fault(26.0, "blackout", "rtu-journal", calls=7))
    gone = told_between(ran, 15.0, 20.0)
    lines = [line for line in ran.told("consumer") if line.get("value") not in gone]
    (ran.folder / "consumer.out").write_text("".join(f"{json.dumps(line)}\n" for line in lines))
    told = judge(replace(ran))
    assert {violation.rule for violation in told if 15.0 < violation.at_s < 20.0} == {"no event lost"}
    unjournaled = replace(ran, world=replace(ran.world, fronts=()))
    assert not [violation for violation in judge(unjournaled) if violation.rule == "no event lost"]


def test_a_disk_that_gives_nothing_is_said(programs: Path, linesim_program: Path, folder: Path) -> None:
    """The gateway begins without what the journal has, and keeps the file."""
    faults = (CUT, Fault(25.0, "worn", "disk", for_s=10.0), Fault(26.0, "kill", "rtud"))
    ran = run(folder / "worn", 1, *faults)
    assert len(logged(ran, "rtud", "cannot be read")) == 1
    assert len(logged(ran, "rtud", "it is kept as")) == 1
    assert judge(ran) == []


# ---- what a power cut leaves --------------------------------------------------------------------------


def power_cut(root: Path, log: bytes, number: int) -> dict[str, bytes]:
    """The files that are left."""
    root.mkdir(exist_ok=True)
    root.with_suffix(".log").write_bytes(log + f"power {number}\n".encode())
    assert restore_after_a_power_cut(root)
    return {path.name: path.read_bytes() for path in root.rglob("*") if path.is_file()}


def outcomes(tmp_path: Path, *lines: str) -> list[dict[str, bytes]]:
    """Of many cuts, each kind once."""
    found: list[dict[str, bytes]] = []
    for number in range(40):
        root = tmp_path / f"{number}"
        left = power_cut(root, "".join(line.replace("@", f"{root}") for line in lines).encode(), number)
        if left not in found:
            found.append(left)
    return found


CREATED = "create 7 @/a\n"
WRITTEN = "write 7 0 4\nsame"
NEWER = "create 8 @/a.new\nwrite 8 0 3\nnew"


@pytest.mark.parametrize(
    ("lines", "holds"),
    [
        ((CREATED, WRITTEN, "sync 7 @/a\n"), lambda left: {"a": b"same"} in left and {} in left),
        ((CREATED, WRITTEN, "sync 7 @/a\n", "sync 1 @/x\n"), lambda left: {} in left),
        ((CREATED, "sync 1 @\n", WRITTEN), lambda left: {"a": b""} in left and {"a": b"same"} in left),
        ((CREATED, "sync 1 @\n", WRITTEN), lambda left: {"a": bytes(4)} in left and {"a": b"sa"} in left),
        ((CREATED, "sync 1 @\n", WRITTEN, "sync 7 @/a\n"), lambda left: left == [{"a": b"same"}]),
        (
            (
                CREATED,
                WRITTEN,
                "sync 7 @/a\n",
                NEWER,
                "sync 8 @/a.new\n",
                "sync 1 @\n",
                "rename @/a.new\t@/a\n",
            ),
            lambda left: sorted(map(sorted, left)) == [["a"], ["a", "a.new"]],
        ),
        (
            (CREATED, WRITTEN, "sync 7 @/a\n", "sync 1 @\n", "link @/a\t@/b\n"),
            lambda left: sorted(map(len, left)) == [1, 2] and {"a": b"same", "b": b"same"} in left,
        ),
        ((CREATED, "sync 1 @\n", "remove @/a\n"), lambda left: {} in left and {"a": b""} in left),
    ],
)
def test_what_a_power_cut_leaves(
    tmp_path: Path, lines: tuple[str, ...], holds: Callable[[list[dict[str, bytes]]], bool]
) -> None:
    assert holds(outcomes(tmp_path, *lines))


def test_a_second_power_cut_begins_with_what_the_first_has_left(tmp_path: Path) -> None:
    root = tmp_path / "disk"
    log = f"create 7 {root}/a\nsync 1 {root}\nwrite 7 0 4\nsamesync 7 {root}/a\n".encode()
    assert power_cut(root, log, 1) == {"a": b"same"}
    begun = root.with_suffix(".log").read_bytes()
    number = (root / "a").stat().st_ino
    assert begun == f"base {number} {root}/a\n".encode()
    assert power_cut(root, begun + f"truncate {number} 2\nsync {number} {root}/a\n".encode(), 2) == {
        "a": b"sa"
    }


def test_without_a_power_cut_nothing_is_lost(tmp_path: Path) -> None:
    assert not restore_after_a_power_cut(tmp_path / "none")
    assert Log(tmp_path).load(b"folder /x\n") is None
