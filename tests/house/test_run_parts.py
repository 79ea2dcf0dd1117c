# SPDX-License-Identifier: GPL-3.0-or-later
"""`make test` runs all parts, whichever fails, and says at the end what took how long and what failed."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

RUN = Path(__file__).resolve().parents[1] / "run" / "run.py"
GOALS = [
    ".shared",
    ".linux-alone",
    "image-debian",
    "lab",
    "lint",
    "unit",
    "coverage",
    "asan",
    "cross",
    "fuzzers",
    "test-sanitizers",
    "test-native",
    "test-linux",
]


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A Makefile that notes what it is asked for; what FAILING names fails, and test-native says a word."""
    (tmp_path / "Makefile").write_text(
        f".PHONY: {' '.join(GOALS)}\n{' '.join(GOALS)}:\n"
        "\t@echo $@ >> ran\n\t@echo 'words of $@'\n\t@case ' $(FAILING) ' in *' $@ '*) exit 1;; esac\n"
    )
    return tmp_path


def run(tree: Path, *words: str, failing: str = "") -> subprocess.CompletedProcess[str]:
    environment = {key: value for key, value in os.environ.items() if not key.startswith(("MAKE", "MFLAGS"))}
    return subprocess.run(
        [sys.executable, RUN, *words],
        cwd=tree,
        env=environment | {"FAILING": failing},
        check=False,
        capture_output=True,
        text=True,
    )


def ran(tree: Path) -> list[str]:
    return (tree / "ran").read_text().split()


@pytest.mark.slow
def test_all_parts_run_and_their_times_are_told(tree: Path) -> None:
    done = run(tree)
    assert done.returncode == 0, done.stderr
    assert sorted(ran(tree)) == sorted(GOALS)
    assert ran(tree)[0] == ".shared"
    told = re.findall(r"^ +\d+ s  (.*)$", done.stdout.partition("the parts:")[2], re.MULTILINE)
    assert told == [
        *("build", "lint", "unit", "coverage", "asan", "cross", "fuzzers", "test-sanitizers"),
        *("rest of test-linux's builds", "test-linux", "rest of test-native"),
    ]
    assert done.stdout.count("words of test-native") == 1  # out of its log, once


@pytest.mark.slow
def test_what_fails_is_named_and_the_rest_still_runs(tree: Path) -> None:
    done = run(tree, failing="unit test-native image-debian")
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1] == "make test: failed: unit test-native"
    assert sorted(ran(tree)) == sorted({*GOALS} - {"lab"})  # which needs what failed
    assert "words of image-debian" in done.stdout


@pytest.mark.slow
def test_only_these(tree: Path) -> None:
    assert run(tree, "--only", "unit", "lint").returncode == 0
    assert ran(tree) == ["unit", "lint"]
    assert run(tree, "--only", "units").returncode == 2
