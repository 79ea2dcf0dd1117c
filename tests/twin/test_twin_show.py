# SPDX-License-Identifier: GPL-3.0-or-later
"""`make twin`: what it says is what happened."""

import subprocess
import sys
from pathlib import Path

import pytest

from nuc980.twin import __main__ as twin

SCRIPTS = Path(__file__).parents[2] / "scripts"


def test_all_of_it_is_seen() -> None:
    command = [sys.executable, "-m", "nuc980.twin"]
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
    assert "run make uboot" in capsys.readouterr().err
