# SPDX-License-Identifier: GPL-3.0-or-later
"""The bench of scans: what it compares is the same program, of 1 000 statements, in at most 80 KiB."""

from pathlib import Path

import logic_scans
import pytest
from logic_scans import agree, built, in_python, timed

MEMORY_MAX = 80 << 10


@pytest.mark.slow
def test_what_is_compared_is_the_same_program(tmp_path: Path) -> None:
    programs = built(tmp_path, ["native"])
    ours = timed(programs["machine native"], 230)
    agree([ours, timed(programs["plain native"], 230), in_python(230)])
    assert ours.memory <= MEMORY_MAX
    with pytest.raises(logic_scans.BenchError, match="are not the same"):
        agree([ours, in_python(231)])


def test_it_has_1000_statements() -> None:
    assert logic_scans.PART.count(":=") - 2 + 3 == 20  # without IN and PT; the call, IF and CASE
    assert logic_scans.PARTS * 20 == 1000
