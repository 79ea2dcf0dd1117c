# SPDX-License-Identifier: GPL-3.0-or-later
"""QEMU's parts are in QEMU's own style, as its own judge sees it."""

import subprocess
from pathlib import Path

import pytest

OVERLAY = Path(__file__).parents[2] / "board/nuc980/qemu"
# From chip data and pin table: nobody's style.
GENERATED = "nuc980_pins_table.h"
SOURCES = sorted(path for path in OVERLAY.rglob("*.[ch]") if path.name != GENERATED)


@pytest.fixture(scope="session")
def checkpatch(qemu_source: Path) -> Path:
    return qemu_source / "scripts/checkpatch.pl"


@pytest.mark.parametrize("source", SOURCES, ids=lambda path: path.name)
def test_source_is_clean(checkpatch: Path, source: Path) -> None:
    command = ["perl", checkpatch, "--no-tree", "--terse", "--no-summary", "-f", source]
    ran = subprocess.run(command, capture_output=True, text=True)
    assert (ran.returncode, ran.stdout) == (0, "")


def test_judge_finds_what_is_wrong(checkpatch: Path, tmp_path: Path) -> None:
    bad = tmp_path / "bad.c"
    bad.write_text("int f(void)\n{\n\tif (1) return 0;\n}\n")
    ran = subprocess.run(["perl", checkpatch, "--no-tree", "-f", bad], capture_output=True)
    assert ran.returncode == 1
