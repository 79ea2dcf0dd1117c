# SPDX-License-Identifier: GPL-3.0-or-later
"""What the bench of scans asks a gateway for."""

import json
import subprocess
from pathlib import Path

import pytest
from module_scans import configuration, counts_of, readings_of


@pytest.mark.parametrize("source", ["", "/bin/true"])
@pytest.mark.parametrize("points", [500, 5000])
def test_map_has_as_many_points_as_the_row_says(
    programs: Path, tmp_path: Path, points: int, source: str
) -> None:
    file = tmp_path / "gateway.json"
    file.write_text(json.dumps(configuration(points, "/bin/true", net=True, source=source)))
    listed = subprocess.run(
        [programs / "rtud/rtud", "--points", file], capture_output=True, text=True, check=True
    )
    assert len(listed.stdout.splitlines()) == 1 + points  # the heading
    assert sum(",in-" in line or line.startswith("in-") for line in listed.stdout.splitlines()) == 100


def test_readings_are_told_from_what_else_is_in_the_log() -> None:
    log = "rtud info: BENCH scan 1\nBENCH scan 2500\nBENCH attach 1000\nBENCH scan 500\nBENCH scan\n"
    assert readings_of(log) == {"scan": [2.5, 0.5], "attach": [1.0]}


def test_counts_are_the_median_of_all_batches() -> None:
    output = "COUNT octets 7\nCOUNT calls 5\nBENCH row 900\nCOUNT octets 9\nCOUNT octets 100\n"
    assert counts_of(output) == {"octets": 9, "calls": 5}
