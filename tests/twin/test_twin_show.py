# SPDX-License-Identifier: GPL-3.0-or-later
"""`make twin`: what it says is what happened."""

import subprocess
import sys
from pathlib import Path

import pytest

from lab import twin_show as twin

SCRIPTS = Path(__file__).parents[2] / "scripts"


def test_all_of_it_is_seen() -> None:
    command = [sys.executable, "-m", "lab.twin_show"]
    ran = subprocess.run(command, capture_output=True, text=True, env={"PYTHONPATH": str(SCRIPTS)})
    assert (ran.returncode, ran.stderr) == (0, "")
    before, after = ran.stdout.split("after U-Boot's set-up")
    assert "uart0    0 of  2  off" in before
    assert "uart0    2 of  2  connected" in after
    assert "lacks UART0_TXD (PF12)" in after


def test_missing_program_is_said(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(sys, "argv", ["twin"])
    monkeypatch.setattr(twin, "UBOOT", Path("nowhere/u-boot.bin"))
    assert twin.main() == 2
    assert "type: make uboot" in capsys.readouterr().err


def test_qemu_that_ends_is_the_cause() -> None:
    """It is killed in the middle; the show says so in three lines."""
    command = [sys.executable, "-m", "lab.twin_show"]
    pipe = subprocess.PIPE
    with subprocess.Popen(
        command, stdout=pipe, stderr=pipe, text=True, env={"PYTHONPATH": str(SCRIPTS)}
    ) as show:
        assert show.stdout is not None and show.stderr is not None
        for line in show.stdout:
            if "U-Boot on the debug UART" in line:
                break
        subprocess.run(["pkill", "-KILL", "-P", str(show.pid), "qemu-system-arm"], check=True)
        lines = show.stderr.read().strip().splitlines()
    assert (show.returncode, len(lines)) == (1, 3)
    assert lines[2].startswith("probably: QEMU ended with -9; ")
