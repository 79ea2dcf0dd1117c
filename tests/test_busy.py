# SPDX-License-Identifier: GPL-3.0-or-later
"""`make busy` counts what passed and keeps what failed."""

import re
import subprocess
import sys
from pathlib import Path

from busy import ROOT


def busy(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, ROOT / "tests" / "busy.py", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)


def test_passes_and_failures_are_counted_and_logs_are_kept(tmp_path: Path) -> None:
    ran = busy("--processes", "1", "--times", "2", "--logs", str(tmp_path), "help", "nonsense")
    assert ran.returncode == 1, ran
    assert re.search(r"^help +2 of 2 +\d+ s +\d+ s +\d+ s  none$", ran.stdout, re.MULTILINE), ran.stdout
    assert re.search(r"^nonsense +0 of 2 .* nonsense-1.log, nonsense-2.log$", ran.stdout, re.MULTILINE)
    assert "No rule to make target 'nonsense'" in (tmp_path / "nonsense-2.log").read_text()
    assert "make run-native" in (tmp_path / "help-1.log").read_text()


def test_all_that_passed_is_0() -> None:
    assert busy("--processes", "0", "--times", "1", "help").returncode == 0


def test_wrong_usage_is_2() -> None:
    assert busy("--times", "0", "help").returncode == 2
