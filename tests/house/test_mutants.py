# SPDX-License-Identifier: GPL-3.0-or-later
"""The mutants of C: where they are, that all of a file compile together, that each is on alone."""

import os
import subprocess
from itertools import pairwise
from pathlib import Path

import pytest

from mutants import Mutant, choose, mutants_of, written

HERE = Path(__file__).resolve().parents[1] / "mutating"
# With what has no mutant: constants, a macro's argument, a pointer that nothing can be added to.
SOURCE = b"""#include <stdbool.h>
#include <string.h>
#define TWICE(x) ((x) + (x))
enum { SIZE = 4 * 2 };
static int total = 3 + 4;
static int calls;

static void count(void) { calls++; }

static bool is_small(int a)
{
    static const int limit = 5 - 1;
    char room[SIZE + 2];
    memset(room, 0, sizeof(room));
    if (a < limit)
        count();
    else
        total = a;
    switch (a) {
    case 1 + 1: return false;
    default: break;
    }
    return a < limit && !room[0];
}

int main(void)
{
    int of_macro = TWICE(total * 2);
    return is_small(3) && !is_small(4) && !is_small(2) && calls == 2 && of_macro == 28 ? 0 : 1;
}
"""


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("mutants") / "room.c"
    path.write_bytes(SOURCE)
    return path


@pytest.fixture(scope="module")
def mutants(room: Path) -> dict[int, Mutant]:
    """Those of what main tests, none within another."""
    found = [
        mutant
        for mutant in mutants_of(room, [])
        if mutant.line < SOURCE[: SOURCE.index(b"int main")].count(b"\n")
    ]
    return dict(enumerate(choose(found, len(found), 1), 1))


def test_no_mutant_stands_where_c_wants_a_constant_nor_within_a_macro(room: Path) -> None:
    constants = ("SIZE = ", "SIZE +", "total = 3", "limit = 5", "case 1", "TWICE(t")
    lines = SOURCE.decode().splitlines()
    found = mutants_of(room, [])
    without = {n for n, line in enumerate(lines, 1) if any(word in line for word in constants)}
    assert not without & {mutant.line for mutant in found}
    assert {"< to <=", "&& to ||", "! left out", "left out: total = a", "left out: count()"} <= {
        m.what for m in found
    }


def test_none_is_within_another_and_the_seed_decides(room: Path) -> None:
    found = mutants_of(room, [])
    chosen = choose(found, 5, 7)
    assert len(chosen) == 5 and choose(found, 5, 7) == chosen != choose(found, 5, 8)
    assert all(a.end <= b.start for a, b in pairwise(chosen))


def test_each_is_on_alone_and_is_noticed_but_for_one(room: Path, mutants: dict[int, Mutant]) -> None:
    """total = a: nobody looks at it."""
    changed = room.with_name("changed.c")
    changed.write_bytes(written(SOURCE, mutants))
    program = room.with_name("program")
    subprocess.run(
        [
            "cc",
            "-w",
            f'-DMUTANTS_FOLDER="{room.parent}"',
            "-include",
            HERE / "mutant.h",
            HERE / "mutant.c",
            changed,
            "-o",
            program,
        ],
        check=True,
    )

    def result(number: int) -> int:
        return subprocess.run([program], env=os.environ | {"MUTANT": str(number)}).returncode

    assert result(0) == 0
    left = {mutant.what for number, mutant in mutants.items() if result(number) == 0}
    assert left == {"left out: total = a"}


def test_what_was_reached_is_known_of_a_program_without_our_environment(
    room: Path, mutants: dict[int, Mutant]
) -> None:
    reached = room.parent / "reached.bin"
    reached.write_bytes(bytes(65536))
    (room.parent / "on").write_text("0")
    subprocess.run([room.with_name("program")], env={}, check=True)
    assert {number for number, was in enumerate(reached.read_bytes()) if was} == set(mutants)
