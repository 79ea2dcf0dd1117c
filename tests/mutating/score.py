# SPDX-License-Identifier: GPL-3.0-or-later
"""The mutation score of rooms of C: of the small faults put into it, how many its tests notice.

`python tests/mutating/score.py ROOM... [--mutants N] [--seed N]`. N of its mutants are put into one build.
Each is switched on for the C unit tests that reach its place. Whom they do not notice, meets the quick files
of pytest that reach it, at most MOST_FILES of them: the score is a lower bound. A test that fails, or takes
ten times as long, has noticed the mutant. Prints who survived; `build/mutation/ROOM.txt` keeps them. Exit
code: 0 done, 1 the tests fail without a mutant, 2 wrong usage.
"""

from __future__ import annotations

import argparse
import json
import os
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from mutants import Mutant, choose
from mutated import MOST, SOURCES, NoScore, Room

# Whose tests start the room's programs; a room that has none is proven by C alone.
PYTEST = {
    "ber": ["snmp", "iec61850"],
    "gps": ["position"],
    "iec104": ["station", "controlling"],
    "map": ["gateway", "modules"],
    "modbus": ["lines"],
} | {room: [room] for room in ("goose", "iec61850", "logic", "snmp", "web")}
MOST_FILES = 5
SLOWER = 10.0
PATIENCE_S = 5.0
WORKERS = 2


@dataclass(frozen=True)
class Test:
    """What it runs in which folder, how long that takes without a mutant, and whose places it reaches."""

    name: str
    command: list[str]
    folder: Path
    took_s: float = 0.0
    reaches: frozenset[int] = frozenset()


def unit_tests(room: Room) -> list[Test]:
    listed = subprocess.run(
        ["meson", "introspect", "--tests", room.build], capture_output=True, text=True, check=True
    )
    return [Test(test["name"], test["cmd"], room.build) for test in json.loads(listed.stdout)]


def file_tests(room: Room) -> list[Test]:
    """A file of pytest each: its tests share what they start."""
    pytest = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-x",
        "-n0",
        "-m",
        "not slow and not soak",
        "-p",
        "no:cacheprovider",
    ]
    files = [
        file for name in PYTEST.get(room.name, []) for file in sorted(Path("tests", name).glob("test_*.py"))
    ]
    return [Test(str(file), [*pytest, str(file)], Path.cwd()) for file in files]


def passes(room: Room, test: Test, limit_s: float | None, **environment: str) -> bool:
    """The environment is for unit tests; the modules of a gateway read the files of the room."""
    process = subprocess.Popen(
        test.command,
        cwd=test.folder,
        env=os.environ | {"OPENRTU_BUILD": str(room.build), "MALLOC_PERTURB_": "85"} | environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        return process.wait(limit_s) in (0, 5)  # pytest's 5: all of the file is slow
    except subprocess.TimeoutExpired:
        return False
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def tried(room: Room, test: Test, reached: Path, **environment: str) -> Test:
    """Without a mutant."""
    reached.parent.mkdir(exist_ok=True)
    reached.write_bytes(bytes(MOST + 1))
    reached.chmod(0o666)  # modules have users of their own
    begun_s = time.monotonic()
    if not passes(room, test, None, **environment):
        raise NoScore(
            f"{test.name} fails without a mutant: OPENRTU_BUILD={room.build} {shlex.join(test.command)}"
        )
    took_s = time.monotonic() - begun_s
    numbers = frozenset(number for number, was in enumerate(reached.read_bytes()) if was)
    return Test(test.name, test.command, test.folder, took_s, numbers)


class Trial:
    """Which mutants of a room its tests notice."""

    def __init__(self, room: Room, mutants: dict[int, Mutant]) -> None:
        self.room = room
        self.mutants = mutants
        self.reached: frozenset[int] = frozenset()

    def survivors(self) -> list[int]:
        left = list(self._unnoticed_by_units())
        print(f"{self.room.name}: {len(left)} of {len(self.mutants)} are left by the unit tests", flush=True)
        return list(self._unnoticed_by_files(left))

    def _unnoticed_by_units(self) -> Iterator[int]:
        """Each test has its own file of what it reaches, so two run at a time."""
        folder = self.room.folder / "reached"

        def first(test: Test) -> Test:
            own = folder / test.name.replace(" ", "-")
            return tried(self.room, test, own, MUTANT="0", MUTANTS_REACHED=str(own))

        def unnoticed(number: int) -> bool:
            return all(
                passes(self.room, test, test.took_s * SLOWER + PATIENCE_S, MUTANT=str(number))
                for test in self._reaching(tests, number)
            )

        with ThreadPoolExecutor(WORKERS) as pool:
            tests = list(pool.map(first, unit_tests(self.room)))
            self.reached |= frozenset().union(*(test.reaches for test in tests))
            left = pool.map(unnoticed, self.mutants)
            yield from (number for number, is_left in zip(self.mutants, left, strict=True) if is_left)

    def _unnoticed_by_files(self, left: list[int]) -> Iterator[int]:
        """One at a time: all processes of a gateway read in the room's folder who is on."""
        self.room.turn_on(0)
        files = [tried(self.room, test, self.room.reached) for test in file_tests(self.room)]
        self.reached |= frozenset().union(*(test.reaches for test in files))
        for number in left:
            self.room.turn_on(number)
            reaching = self._reaching(files, number)[:MOST_FILES]
            if all(passes(self.room, test, test.took_s * SLOWER + PATIENCE_S) for test in reaching):
                yield number

    @staticmethod
    def _reaching(tests: list[Test], number: int) -> list[Test]:
        return sorted((test for test in tests if number in test.reaches), key=lambda test: test.took_s)


def told(trial: Trial, survived: list[int]) -> str:
    room, mutants = trial.room, trial.mutants
    lines = [
        f"{mutants[n].file.relative_to(room.sources)}:{mutants[n].line}: {mutants[n].what}"
        f"{'' if n in trial.reached else ' (not reached)'}"
        for n in survived
    ]
    noticed = len(mutants) - len(survived)
    percent = 100 * noticed / len(mutants)
    return "\n".join(
        [*lines, f"{room.name}: {noticed} of {len(mutants)} mutants were noticed, {percent:.1f} %"]
    )


def score(room: Room, count: int, seed: int) -> str:
    room.copied()
    found = room.mutants()
    chosen = dict(enumerate(choose(found, count, seed), 1))
    print(f"{room.name}: {len(found)} mutants, {len(chosen)} of them are tried; compiles", flush=True)
    trial = Trial(room, room.compiled(chosen))
    return told(trial, trial.survivors())


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument(
        "rooms",
        nargs="+",
        metavar="ROOM",
        choices=[path.parent.name for path in sorted(SOURCES.glob("*/meson.build"))],
    )
    parser.add_argument("--mutants", type=int, default=300, help="at most so many (300)")
    parser.add_argument("--seed", type=int, default=1, help="which of them (1)")
    wanted = parser.parse_args()
    if not 0 < wanted.mutants <= MOST:
        parser.error(f"--mutants: 1 to {MOST}")
    try:
        for room in map(Room, wanted.rooms):
            text = score(room, wanted.mutants, wanted.seed)
            (room.folder / f"{room.name}.txt").write_text(text + "\n")
            print(text, flush=True)
    except NoScore as reason:
        print(f"mutation: {reason}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
