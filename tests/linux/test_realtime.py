# SPDX-License-Identifier: GPL-3.0-or-later
"""Real time on the emulated board: priorities as docs/realtime.md has them, clock, timers; rt-report."""

import fnmatch
import json
import re
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest

from lab.board_show import BoardDesk, latency
from nuc980.twin.linux import Linux
from rig.desk import chapter_5

ROOT = Path(__file__).parents[2]
LINES = (1, 2, 3, 4, 6, 8)
PATIENCE_S = 300.0  # a busy host


def documented() -> list[tuple[str, int]]:
    """Pattern of a thread's name and priority, as the page's table has them."""
    rows = re.findall(r"^\| `([^`]+)` \| (\d+) \|", (ROOT / "docs/realtime.md").read_text(), re.MULTILINE)
    return [(name, int(priority)) for name, priority in rows]


def on_the_board() -> list[tuple[str, int]]:
    file = ROOT / "board/nuc980/rootfs-overlay/etc/priorities"
    lines = [line.split() for line in file.read_text().splitlines() if not line.startswith("#")]
    return [(name, int(priority)) for name, priority in lines]


@pytest.fixture(scope="module")
def extra_files() -> dict[str, str]:
    """All six lines."""
    return {"etc/openrtu/gateway.json": json.dumps(chapter_5())}


@pytest.fixture(scope="module")
def threads(linux: Linux) -> dict[str, int]:
    """Names and priorities of all threads, once the gateway runs."""
    linux.run("until [ $(rtuctl modules | grep -c '^rtu-.* running') = 3 ]; do sleep 0.2; done", PATIENCE_S)
    output = linux.run("for p in /proc/[0-9]*; do cat $p/comm; chrt -p ${p#/proc/}; done")
    found = re.findall(r"^(\S.*)\n.*policy.*\n.*priority: (\d+)$", output, re.MULTILINE)
    return {name: int(priority) for name, priority in found}


def test_the_boards_table_is_the_documented_one() -> None:
    assert documented() == on_the_board() != []


def test_priorities_are_the_documented_ones(threads: dict[str, int]) -> None:
    table = documented()
    expected = {
        name: next(priority for pattern, priority in table if fnmatch.fnmatchcase(name, pattern))
        for name in threads
        if any(fnmatch.fnmatchcase(name, pattern) for pattern, _ in table)
    }
    assert {name: threads[name] for name in expected} == expected
    for pattern in ("irq/*-ttyS[1-9]*", "irq/*-ttyS0", "watchdogd", "ktimers/0", "rtud", "rtu-modbus-*"):
        assert fnmatch.filter(expected, pattern), pattern
    assert len(fnmatch.filter(expected, "irq/*-ttyS[1-9]*")) == len(LINES)


def test_what_faces_the_network_is_below_the_lines(threads: dict[str, int]) -> None:
    lines = threads["rtu-modbus-1"]
    assert threads["rtu-iec104"] == 0
    network = [priority for name, priority in threads.items() if re.match("irq/.*-emac", name)]
    assert network
    assert max(network) < lines < min(threads[name] for name in fnmatch.filter(threads, "irq/*-ttyS[1-9]*"))


def test_kernel_is_preemptible_and_its_timers_are_fine(linux: Linux) -> None:
    assert "PREEMPT_RT" in linux.run("uname -v")
    assert re.search(r"hres_active\s*: 1", linux.run("cat /proc/timer_list"))
    source = linux.run("cat /sys/devices/system/clocksource/clocksource0/current_clocksource").strip()
    assert source == "nuc980-etimer5"
    assert "at 12MHz, resolution 83ns" in linux.run("dmesg")


@pytest.mark.usefixtures("threads")
def test_report_finds_all_as_it_should_be(linux: Linux) -> None:
    status, report = linux.try_to("rt-report --emulator --seconds 3", PATIENCE_S)
    assert status == 0, report
    assert "FAIL" not in report
    for what in ("PREEMPT_RT", "high-resolution timers", "rtu-modbus-1     45", "without load", "with load"):
        assert what in report


@pytest.mark.usefixtures("threads")
def test_report_finds_a_thread_that_is_out_of_place(linux: Linux) -> None:
    linux.run("chrt -f -p 30 $(pidof ktimers/0)")
    status, report = linux.try_to("rt-report --emulator --seconds 1", PATIENCE_S)
    linux.run("/etc/init.d/S60priorities start")
    assert status == 1
    assert re.search(r"FAIL +ktimers/0 +30", report)
    assert report.count("FAIL") == 1


@pytest.mark.usefixtures("threads")
def test_report_judges_the_latency_of_a_board(linux: Linux) -> None:
    """Here the emulator passes for one, with a limit that nothing can keep."""
    impossible = "sed s/^LIMIT_US=.*/LIMIT_US=0/ $(which rt-report) > /tmp/r; sh /tmp/r --seconds 1"
    status, report = linux.try_to(impossible, PATIENCE_S)
    assert status == 1
    assert report.count("FAIL") == 2


@pytest.fixture
def without_cyclictest(linux: Linux) -> Iterator[Linux]:
    """The board, as an image without rt-tests would be."""
    linux.run("mount -o bind /dev/null /usr/bin/cyclictest")
    yield linux
    linux.run("umount /usr/bin/cyclictest")


@pytest.mark.usefixtures("threads")
def test_report_says_that_cyclictest_is_missing(without_cyclictest: Linux) -> None:
    status, report = without_cyclictest.try_to("rt-report --emulator --seconds 1", PATIENCE_S)
    assert status == 1
    assert re.findall("FAIL.*", report) == [
        "FAIL  latency was not measured: this image lacks cyclictest "
        "(package rt-tests of Debian and Buildroot)"
    ]


def test_show_leaves_out_a_latency_that_the_image_cannot_measure(
    without_cyclictest: Linux, capsys: pytest.CaptureFixture[str]
) -> None:
    gateway = SimpleNamespace(inside=without_cyclictest.run)
    latency(cast(BoardDesk, SimpleNamespace(gateway=gateway)))
    assert "skipped: this image has no cyclictest" in capsys.readouterr().out


def test_wrong_usage_is_said(linux: Linux) -> None:
    status, output = linux.try_to("rt-report --seconds soon")
    assert status == 2
    assert output.startswith("usage: rt-report")
