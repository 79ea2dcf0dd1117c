# SPDX-License-Identifier: GPL-3.0-or-later
"""Between two stores into memory that others see, a process may die or stop (docs/plant.md)."""

import platform
from pathlib import Path

import pytest

from plant_seeds import between_stores, troubled, writes_the_map
from plant_trials import run_script

STORES = """
import mmap, os, time
file = os.open("{file}", os.O_RDWR | os.O_CREAT)
os.ftruncate(file, 4096)
shared = mmap.mmap(file, 4096)
child = os.fork()
time.sleep(2 if child else 1)
if child:
    print(shared[:8].hex(), flush=True)
    time.sleep(30)
    print(shared[:8].hex(), flush=True)
else:
    time.sleep(0.1)
    for place in range(8):
        shared[place] = place + 1
"""
DYING, STOPPING = "kill\tscript\t0.5\t0\t{}\n", "stop\tscript\t0.5\t0\t10\t{}\n"

stepped = pytest.mark.skipif(platform.machine() != "x86_64", reason="nothing lets one store alone through")


@stepped
@pytest.mark.parametrize(
    ("stores", "seen"), [(1, "0000000000000000"), (5, "0102030400000000"), (8, "0102030405060700")]
)
def test_a_process_dies_before_a_store(programs: Path, tmp_path: Path, stores: int, seen: str) -> None:
    ran = run_script(tmp_path, STORES.format(file=tmp_path / "shared"), DYING.format(stores))
    assert (ran.returncode, ran.stderr) == (0, "")
    assert (tmp_path / "out").read_text().split() == [seen, seen]


@stepped
def test_a_process_stops_before_a_store_and_goes_on(programs: Path, tmp_path: Path) -> None:
    ran = run_script(tmp_path, STORES.format(file=tmp_path / "shared"), STOPPING.format(4))
    assert (ran.returncode, ran.stderr) == (0, "")
    assert (tmp_path / "out").read_text().split() == ["0102030000000000", "0102030405060708"]


COUNTING = """
import mmap, os, time
file = os.open("{file}", os.O_RDWR | os.O_CREAT)
os.ftruncate(file, 8192)
shared = mmap.mmap(file, 8192)
if os.fork():
    time.sleep(20)
    print(shared[:8].hex())
else:
    for turn in range(8):
        time.sleep(0.6)
        for count in range(100):
            shared[4096] = count
        shared[turn] = 1
"""


@stepped
def test_what_is_written_often_is_no_rare_store(programs: Path, tmp_path: Path) -> None:
    ran = run_script(tmp_path, COUNTING.format(file=tmp_path / "shared"), DYING.format("3\trare"))
    assert (ran.returncode, ran.stderr) == (0, "")
    assert (tmp_path / "out").read_text().split() == ["0101010100000000"]


def test_half_of_those_who_write_the_map_fail_between_two_stores() -> None:
    world = between_stores(troubled(7, 3600.0, 10.0))
    failing = [fault for fault in world.faults if fault.kind in ("kill", "stop")]
    writing = [fault for fault in failing if writes_the_map(fault.of)]
    at_stores = [fault for fault in failing if fault.stores]
    assert at_stores == [fault for fault in writing if fault.stores]
    assert "rtu-centre" in {fault.of for fault in failing} - {fault.of for fault in writing}
    assert 0.4 < len(at_stores) / len(writing) < 0.65
    assert {fault.rare for fault in at_stores} == {False, True}
