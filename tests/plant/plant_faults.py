# SPDX-License-Identifier: GPL-3.0-or-later
"""`make plant-faults`: puts each fault of tests/plant/faults into a copy of the gateway; is it found?"""

from __future__ import annotations

import argparse
import resource
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import count
from pathlib import Path

from plant_judge import judge
from plant_run import FAILED, UNUSABLE, Folders
from plant_seeds import world_of
from plant_world import GATEWAY, REPOSITORY, PlantError, World, run

FAULTS = Path(__file__).with_name("faults")
BUILD = REPOSITORY / "build" / "plant-faults"
TARGETS = ("rtud/rtud", "modules/rtu-modbus", "modules/rtu-iec104", "centre/rtu-centre", "rtuctl/rtuctl")
OF_FRONTS = tuple(f"modules/rtu-{name}" for name in ("104m", "goose", "iec61850", "journal", "logic", "snmp"))
SECONDS = 300.0
FAULT_EVERY_S = 8.0
CPU_S = 600.0


@dataclass(frozen=True)
class Found:
    """What came of a fault: the rules that failed, by which seed; none, when the time was over."""

    fault: str
    seed: int
    cpu_s: float
    rules: tuple[str, ...] = ()

    def __str__(self) -> str:
        if self.rules:
            return (
                f"{self.fault}: found by seed {self.seed} in {self.cpu_s:.0f} CPU s: {', '.join(self.rules)}"
            )
        return f"{self.fault}: not found by {self.seed} seeds in {self.cpu_s:.0f} CPU s"


def names() -> list[str]:
    return sorted(path.stem for path in FAULTS.glob("*.patch"))


def told(*command: str | Path, cwd: Path | None = None) -> None:
    """Raises PlantError with the end of what the command said."""
    result = subprocess.run(command, capture_output=True, text=True, check=False, cwd=cwd)
    if result.returncode != 0:
        last = (result.stdout + result.stderr).splitlines()[-20:]
        raise PlantError("\n".join([f"{command[0]} failed:", *last]))


def fresh_copy() -> Path:
    """Of the gateway's sources, without a fault. What differs from before is newer, and is built again."""
    source = BUILD / "openrtu"
    command = ["rsync", "--recursive", "--links", "--perms", "--checksum", "--delete"]
    told(*command, f"{REPOSITORY / 'package' / 'openrtu'}/", f"{source}/")
    return source


@contextmanager
def built_with(fault: str) -> Iterator[Path]:
    """The folder of the programs."""
    BUILD.mkdir(parents=True, exist_ok=True)
    native, source = BUILD / "programs", fresh_copy()
    told("patch", "--strip=1", "--input", FAULTS / f"{fault}.patch", cwd=source)
    if not (native / "build.ninja").exists():
        told("meson", "setup", "-Dtests=disabled", "-Dsnmp=true", native, source / "src")
    told("ninja", "-C", native, *TARGETS)
    yield native


def cpu_s() -> float:
    """Of all that were waited for."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def failing(world: World, gateway: Path, folders: Folders) -> set[str]:
    ran = run(world, folders.next(), traced=False, gateway=gateway)
    rules = {violation.rule for violation in judge(ran)}
    shutil.rmtree(ran.folder)
    return rules


def look_for(fault: str, most_s: float) -> Found:
    with built_with(fault) as gateway, Folders() as folders:
        begun_s = cpu_s()
        for seed in count(1):
            world = world_of(seed, SECONDS, FAULT_EVERY_S)
            if world.fronts:
                told("ninja", "-C", gateway, *OF_FRONTS)
            rules = failing(world, gateway, folders)
            if rules:
                rules -= failing(world, GATEWAY, folders)  # without the fault: that does not show it
            spent_s = cpu_s() - begun_s
            if rules or spent_s > most_s:
                return Found(fault, seed, spent_s, tuple(sorted(rules)))
    raise AssertionError


def look_for_all(faults: Sequence[str], most_s: float) -> int:
    missed = 0
    for fault in faults:
        found = look_for(fault, most_s)
        missed += not found.rules
        print(found, flush=True)
    print(f"{len(faults) - missed} of {len(faults)} faults found")
    return FAILED if missed else 0


def main() -> int:
    parser = argparse.ArgumentParser(prog="plant-faults", description=__doc__)
    parser.add_argument("faults", nargs="*", metavar="FAULT", help="these alone")
    parser.add_argument(
        "--cpu-seconds", type=float, default=CPU_S, metavar="S", help="for each at most [%(default)s]"
    )
    arguments = parser.parse_args()
    for fault in arguments.faults:
        if fault not in names():
            parser.error(f"{fault}: expected one of {', '.join(names())}")
    try:
        return look_for_all(arguments.faults or names(), arguments.cpu_seconds)
    except PlantError as error:
        print(f"plant-faults: {error}", file=sys.stderr)
        return UNUSABLE


if __name__ == "__main__":
    sys.exit(main())
