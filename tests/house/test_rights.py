# SPDX-License-Identifier: GPL-3.0-or-later
"""A test that its user may not run is left out, and counted where everybody sees it."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
AREA = "lines"  # of those that a report of costs knows
TESTS = """
import pytest

from rig import rights
from rig.rights import NETWORK, SUPERUSER, need, needed

rights.lacks = lambda right: True


@needed(SUPERUSER, "sockets")
def test_marked() -> None:
    assert False


@pytest.mark.parametrize("number", range(2))
def test_within(number: int) -> None:
    need(NETWORK, "ports")
    assert False


def test_not_run() -> None:
    pytest.skip("for a reason of its own")
"""


@pytest.mark.slow
@pytest.mark.parametrize("workers", ["0", "1"])
def test_what_is_left_out_is_counted(tmp_path: Path, workers: str) -> None:
    (tmp_path / "tests").mkdir()
    (tmp_path / "tests" / f"test_{AREA}.py").write_text(TESTS)
    command = [sys.executable, "-m", "pytest", "-c", ROOT / "pyproject.toml", "--rootdir", tmp_path]
    command += ["-p", "conftest", "-p", "no:cacheprovider", "-n", workers, tmp_path / "tests"]
    environment = os.environ | {"PYTHONPATH": f"{ROOT}/tests:{ROOT}/scripts"}
    environment.pop("OPENRTU_TIMES", None)
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert "4 skipped" in done.stdout, done.stdout + done.stderr
    assert "left out, since this user lacks the right: 2 a network of its own, 1 root\n" in done.stdout
