# SPDX-License-Identifier: GPL-3.0-or-later
"""`make plant`: runs worlds, one a seed, judges them, and tells the story of each that fails."""

from __future__ import annotations

import argparse
import dataclasses
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from plant_history import Violation
from plant_judge import judge
from plant_seeds import WORLDS, world_of
from plant_world import RECOVERY_S, PlantError, Run, World, run

LEAST_S = RECOVERY_S + 60
TOLD_MAX = 10  # violations of a story
FAILED, UNUSABLE = 1, 2

Try = Callable[[World], tuple[Run, list[Violation]]]


class Folders:
    """Where worlds run: a folder each, on a tmpfs, gone with this unless it is kept."""

    def __init__(self) -> None:
        self.root = Path(tempfile.mkdtemp(prefix="openrtu-plant-", dir="/dev/shm"))
        self.number = 0

    def next(self) -> Path:
        self.number += 1
        return self.root / f"{self.number}"

    def __enter__(self) -> Folders:
        return self

    def __exit__(self, *_: object) -> None:
        shutil.rmtree(self.root, ignore_errors=True)

    def judged(self, world: World, *, traced: bool = False) -> tuple[Run, list[Violation]]:
        ran = run(world, self.next(), traced=traced)
        return ran, judge(ran)


def shrunk(world: World, rules: set[str], attempt: Try) -> World:
    """Without the faults that it does not take: halves are left out, then quarters, and at last each once."""
    size = (len(world.faults) + 1) // 2
    while size > 0:
        for first in range(len(world.faults) - size, -1, -size):
            faults = world.faults[:first] + world.faults[first + size :]
            ran, violations = attempt(dataclasses.replace(world, faults=faults))
            shutil.rmtree(ran.folder, ignore_errors=True)
            if rules & {violation.rule for violation in violations}:
                world = dataclasses.replace(world, faults=faults)
        size //= 2
    return world


def story(ran: Run, violations: Sequence[Violation]) -> str:
    """What went wrong on purpose, and what came of it, in the order of plant time."""
    told = [(fault.at_s, f"  {fault}") for fault in ran.world.faults]
    told += [(violation.at_s, f"! {violation}") for violation in violations[:TOLD_MAX]]
    lines = [line for _, line in sorted(told, key=lambda one: one[0])]
    if len(violations) > TOLD_MAX:
        lines.append(f"  and {len(violations) - TOLD_MAX} more")
    return "\n".join(lines)


def keep(ran: Run, out: Path) -> Path:
    """The trace and all that the programs said."""
    kept = out / f"{ran.world.seed}"
    shutil.rmtree(kept, ignore_errors=True)
    kept.parent.mkdir(parents=True, exist_ok=True)
    shutil.copytree(ran.folder, kept, ignore=shutil.ignore_patterns("map", "dev", "consumer"))
    return kept


def fail(ran: Run, violations: list[Violation], folders: Folders, out: Path) -> None:
    rules = {violation.rule for violation in violations}
    ran, violations = folders.judged(shrunk(ran.world, rules, folders.judged), traced=True)
    print(f"seed {ran.world.seed} fails: {', '.join(sorted(rules))}; with the faults that it takes:")
    print(story(ran, violations))
    print(f"its trace and logs: {keep(ran, out)}", flush=True)


def run_seeds(
    seeds: Sequence[int], seconds: float, out: Path, keeps: bool, make: Callable[[int, float], World]
) -> int:
    failed = 0
    begun = time.monotonic()
    with Folders() as folders:
        for seed in seeds:
            ran, violations = folders.judged(make(seed, seconds), traced=keeps)
            if violations:
                failed += 1
                fail(ran, violations, folders, out)
            elif keeps:
                print(story(ran, violations))
                print(f"its trace and logs: {keep(ran, out)}")
            shutil.rmtree(ran.folder)
    took_s = time.monotonic() - begun
    plant_s = seconds * len(seeds)
    print(
        f"{len(seeds)} seeds, {plant_s / 3600:.2f} hours of a plant in {took_s:.0f} s, "
        f"{plant_s / took_s:.0f} x real time; {failed} failed"
    )
    return FAILED if failed else 0


def main() -> int:
    parser = argparse.ArgumentParser(prog="plant", description=__doc__)
    parser.add_argument("--seeds", type=int, default=20, metavar="N", help="worlds to run [%(default)s]")
    parser.add_argument("--hours", type=float, default=0.1, help="of a plant, each [%(default)s]")
    parser.add_argument("--seed", type=int, help="this one alone; its trace is kept")
    parser.add_argument("--world", choices=sorted(WORLDS), help="this one, and not what the seed chooses")
    parser.add_argument("--out", type=Path, default=Path("build/plant-runs"), help="for traces [%(default)s]")
    arguments = parser.parse_args()
    if arguments.seeds < 1 or arguments.hours * 3600 < LEAST_S:
        parser.error(f"expected a seed and {LEAST_S / 3600:.3f} hours at least")
    one = arguments.seed is not None
    seeds = [arguments.seed] if one else range(1, arguments.seeds + 1)
    try:
        make = WORLDS.get(arguments.world, world_of)
        return run_seeds(seeds, arguments.hours * 3600, arguments.out, one, make)
    except PlantError as error:
        print(f"plant: {error}", file=sys.stderr)
        return UNUSABLE


if __name__ == "__main__":
    sys.exit(main())
