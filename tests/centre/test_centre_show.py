# SPDX-License-Identifier: GPL-3.0-or-later
"""`make centre`, as a process of its own."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from lab.centre_show import STEPS
from lab.gateway import free_port

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.slow
def test_all_of_it_is_seen(programs: Path) -> None:
    show = subprocess.run(
        [sys.executable, "-m", "lab.centre_show", "--port", str(free_port())],
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(ROOT / "scripts")},
        text=True,
        capture_output=True,
        check=False,
    )
    assert (show.returncode, show.stderr) == (0, "")
    assert re.search(r"user operator, password \S+ \(of this run only\)", show.stdout)
    assert re.search(r"connected +19; not: ", show.stdout)
    assert re.search(r"lost +45\.\d+, \d\.\d+ is invalid\n +found +45\.\d+, \d\.\d+\n", show.stdout)
    assert f"All {len(STEPS)} steps succeeded." in show.stdout
