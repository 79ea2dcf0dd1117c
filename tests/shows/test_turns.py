# SPDX-License-Identifier: GPL-3.0-or-later
"""What a show asks of Linux beside busy processes."""

import os
import platform
import subprocess
import sys
from pathlib import Path

import pytest

from lab.patience import Deadline, slowness

SCRIPTS = Path(__file__).resolve().parents[2] / "scripts"
# sched_getattr(2) of a child, after its parent has asked: niceness and runtime.
ASK = """
import ctypes, os, struct, subprocess, sys
from lab.turns import SYSTEM_CALLS, take_short_turns
if sys.argv[1:] != ["child"]:
    os.nice(3)
    take_short_turns()
    sys.exit(subprocess.run([sys.executable, __file__, "child"]).returncode)
attributes = ctypes.create_string_buffer(48)
number = SYSTEM_CALLS[os.uname().machine] + 1  # sched_getattr stands behind sched_setattr
assert ctypes.CDLL(None).syscall(number, 0, attributes, 48, 0) == 0
_, policy, _, nice, _, runtime, _, _ = struct.unpack("=IIQiIQQQ", attributes.raw)
print(policy, nice, runtime)
"""


def kernel() -> tuple[int, int]:
    major, minor = platform.release().split(".")[:2]
    return int(major), int(minor)


def test_short_turns_pass_to_what_a_show_starts_and_keep_its_niceness(tmp_path: Path) -> None:
    program = tmp_path / "ask.py"
    program.write_text(ASK)
    done = subprocess.run(
        [sys.executable, program],
        env=os.environ | {"PYTHONPATH": str(SCRIPTS)}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert not done.stderr
    policy, nice, runtime = map(int, done.stdout.split())
    assert (policy, nice) == (0, os.getpriority(os.PRIO_PROCESS, 0) + 3)
    assert runtime == (100_000 if kernel() >= (6, 12) else 0)


def test_a_deadline_moves_with_the_load(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    monkeypatch.setattr(os, "getloadavg", lambda: (0.5, 0.0, 0.0))
    assert slowness() == 1
    deadline = Deadline(0)
    assert deadline.over
    deadline = Deadline(1000)
    assert 900 < deadline.left <= 1000
    monkeypatch.setattr(os, "getloadavg", lambda: (20.0, 0.0, 0.0))
    assert 9900 < deadline.left <= 10_000
