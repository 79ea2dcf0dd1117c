# SPDX-License-Identifier: GPL-3.0-or-later
"""What conftest.py makes of a collection: the quick cases of a table, the order of files for workers."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]
TABLE = """
import pytest


@pytest.mark.sample(3)
@pytest.mark.parametrize("number", range(7))
def test_number(number: int) -> None:
    pass
"""


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """A file of an area that waits for nothing, and another."""
    for name in ("tests/pins/test_a.py", "tests/test_b.py"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(TABLE)
    return tmp_path


def cases(tree: Path, *options: str) -> list[str]:
    """The quick ones, as they run."""
    command = [sys.executable, "-m", "pytest", "-c", ROOT / "pyproject.toml", "--rootdir", tree]
    command += ["-p", "conftest", "-p", "no:cacheprovider", "-v", "-m", "not slow", *options]
    command += [tree / "tests/pins/test_a.py", tree / "tests/test_b.py"]
    environment = os.environ | {"PYTHONPATH": f"{ROOT}/tests:{ROOT}/tests/run:{ROOT}/scripts"}
    environment.pop("OPENRTU_TIMES", None)
    done = subprocess.run(command, cwd=tree, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return list(dict.fromkeys(re.findall(r"tests/\S+\[\d\]", done.stdout)))


def quick(file: str) -> list[str]:
    return [f"tests/{file}::test_number[{number}]" for number in (0, 3, 6)]


def test_first_and_each_nth_case_of_a_sample_are_quick(tree: Path) -> None:
    assert cases(tree) == quick("pins/test_a.py") + quick("test_b.py")


def test_workers_end_with_what_waits_for_nothing(tree: Path) -> None:
    """A test that waits for a timer at the end leaves a processor idle."""
    words = ("-n", "1", "--dist", "loadfile", "--no-loadscope-reorder")
    assert cases(tree, *words) == quick("test_b.py") + quick("pins/test_a.py")
