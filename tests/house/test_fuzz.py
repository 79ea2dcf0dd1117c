# SPDX-License-Identifier: GPL-3.0-or-later
"""The fuzzers from their seeds, for some seconds and in every run alike; `make fuzz` goes on from there."""

from pathlib import Path

import pytest
from fuzzing import SEEDS, TARGETS, run

# Some five seconds each, by the targets' speeds.
RUNS = {
    "asdu": 40_000,
    "controlling": 80_000,
    "information": 150_000,
    "outstation": 6_000,
    "session": 150_000,
    "station": 25_000,
    "line": 50_000,
    "config": 3_000,
    "centre": 400_000,
    "journal": 1_700,
    "goose": 300_000,
    "nmea": 40_000,
    "gpsd": 100_000,
    "logic": 100_000,
    "synch": 20_000,
    "requests": 12_000,
    "snmp": 4_000,
    "web": 100_000,
    "ber": 150_000,
    "mms-acse": 400_000,
    "mms-association": 40_000,
    "mms-presentation": 300_000,
    "mms-service": 30_000,
    "mms-session": 400_000,
    "mms-transport": 20_000,
}
SEED_SIZE_MAX = 1024
SEEDS_MAX = 224


@pytest.mark.slow
@pytest.mark.parametrize("target", TARGETS)
def test_nothing_is_found(target: str, fuzzers: Path, tmp_path: Path) -> None:
    done = run(target, fuzzers, tmp_path, f"-runs={RUNS[target]}", "-seed=104")
    assert done.returncode == 0, done.stderr[-6000:]
    assert f"Done {RUNS[target]} runs" in done.stderr


def test_seeds_are_few_and_small() -> None:
    seeds = [file for file in SEEDS.rglob("*") if file.is_file()]
    assert {file.parent.name for file in seeds} == set(TARGETS)
    assert len(seeds) < SEEDS_MAX
    assert [str(file) for file in seeds if file.stat().st_size >= SEED_SIZE_MAX] == []
