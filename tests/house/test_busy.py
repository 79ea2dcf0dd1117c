# SPDX-License-Identifier: GPL-3.0-or-later
"""`make busy` counts what passed and keeps what failed."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from busy import ROOT, keep_details


def busy(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, ROOT / "tests/run/busy.py", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)


@pytest.mark.slow
def test_passes_and_failures_are_counted_and_logs_are_kept(tmp_path: Path) -> None:
    ran = busy("--processes", "1", "--times", "2", "--logs", str(tmp_path), "help", "nonsense")
    assert ran.returncode == 1, ran
    assert re.search(r"^help +2 of 2 +\d+ s +\d+ s +\d+ s  none$", ran.stdout, re.MULTILINE), ran.stdout
    assert re.search(r"^nonsense +0 of 2 .* nonsense-1.log, nonsense-2.log$", ran.stdout, re.MULTILINE)
    assert "No rule to make target 'nonsense'" in (tmp_path / "nonsense-2.log").read_text()
    assert "make run-native" in (tmp_path / "help-1.log").read_text()


def test_what_a_failed_show_says_is_in_its_log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And not what an earlier one has said."""
    monkeypatch.setattr("busy.ROOT", tmp_path)
    details, log = tmp_path / "build/log/run-failed.log", tmp_path / "run-1.log"
    log.write_text("step 1\n")
    keep_details("run", log, 0)
    details.parent.mkdir(parents=True)
    details.write_text("seen: nothing\n")
    keep_details("run", log, details.stat().st_mtime + 1)
    assert log.read_text() == "step 1\n"
    keep_details("run", log, details.stat().st_mtime)
    assert log.read_text() == "step 1\nseen: nothing\n"


def test_what_a_failed_step_says_is_in_its_log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("busy.ROOT", tmp_path)
    step, log = tmp_path / "build/log/unit.log", tmp_path / "test-quick-1.log"
    step.parent.mkdir(parents=True)
    step.write_text("0x5 != 0\n")
    log.write_text("   * native: done\n   * unit: failed after 53 s; the end of build/log/unit.log:\n")
    keep_details("test-quick", log, step.stat().st_mtime)
    assert log.read_text().endswith(":\n0x5 != 0\n")


@pytest.mark.slow
def test_all_that_passed_is_0() -> None:
    assert busy("--processes", "0", "--times", "1", "help").returncode == 0


def test_wrong_usage_is_2() -> None:
    assert busy("--times", "0", "help").returncode == 2
