# SPDX-License-Identifier: GPL-3.0-or-later
"""The bench of servers of IEC 61850: what it counts, and that it runs through."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from mms_servers import DEVICES, MEASURED, STATES, configuration

from lab.gateway import REPOSITORY


def test_both_have_5000_points(programs: Path, tmp_path: Path) -> None:
    assert DEVICES * (STATES + MEASURED + 1) == 5000
    file = tmp_path / "gateway.json"
    file.write_text(json.dumps(configuration(2404, 102)))
    listed = subprocess.run(
        [programs / "rtud/rtud", "--points", file], capture_output=True, text=True, check=True
    )
    assert len(listed.stdout.splitlines()) == 1 + 5000  # the heading


@pytest.mark.slow
def test_the_bench_runs_through(programs: Path) -> None:
    """Each server has answered all, and ours has lost no report at the lowest rate."""
    bench = [sys.executable, Path(__file__).with_name("mms_servers.py"), "--quick"]
    environment = os.environ | {"PYTHONPATH": str(REPOSITORY / "scripts"), "OPENRTU_BUILD": str(programs)}
    run = subprocess.run(bench, env=environment, capture_output=True, text=True, timeout=300, check=False)
    assert (run.returncode, run.stderr) == (0, "")
    rows = [line.strip("|").split("|") for line in run.stdout.splitlines() if line.startswith("| ")][2:]
    assert len(rows) >= 14
    assert all(cell.strip() for row in rows[:9] for cell in row)
    assert all(float(row[1].split()[0]) > 0 for row in rows[9:11])
    assert "p99" in rows[11][1] or os.geteuid() != 0
