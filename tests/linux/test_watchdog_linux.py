# SPDX-License-Identifier: GPL-3.0-or-later
"""The watchdog's driver: time-outs, who is reset and who is not, and what the board says of it afterwards."""

import dataclasses
import os
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from nuc980.twin.linux import Kernel, Linux

PROGRAMS = Path(__file__).parent / "programs"
COMPILER = os.environ.get("CROSS_COMPILE", "arm-linux-gnueabi-") + "gcc"
SYSFS = "/sys/class/watchdog/watchdog0"

WDT_CTL, WDT_RUNS, REGWPCTL = 0xB0040000, 1 << 7, 0xB00001FC
PCLKEN0, WDT_CLOCK, DIV8, X32K = 0xB0000218, 1 << 0, 0xB0000240, 3
CARDRESET = 0x20
TOUTSEL = 0x7 << 8
SHORT_INTERVAL, LONG_INTERVAL = 6 << 8, 7 << 8  # 2^16 and 2^18 ticks
LATE_S = 8.0  # a busy host; less than what lies between the intervals


@pytest.fixture(scope="module")
def extra_files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    program = tmp_path_factory.mktemp("watchdog") / "watchdog"
    subprocess.run([COMPILER, "-static", "-O2", "-o", program, PROGRAMS / "watchdog.c"], check=True)
    return {"usr/bin/watchdog-test": program}


def attribute(linux: Linux, name: str) -> str:
    return linux.run(f"cat {SYSFS}/{name}").strip()


def bootstatus(linux: Linux) -> int:
    return int(attribute(linux, "bootstatus"))


def seconds_to_reset(linux: Linux, command: str) -> float:
    """From before the command, which feeds it last, until the board is reset; it has started anew then."""
    linux.machine.events("RESET")
    begin = time.monotonic()
    linux.type(f"{command}\n<run 0>\n")
    linux.machine.wait_for_event("RESET")
    seconds = time.monotonic() - begin
    linux.wait_for_shell()
    return seconds


@pytest.mark.parametrize(
    ("asked", "real"), [(1, 2), (2, 2), (3, 11), (10, 11), (11, 11), (12, 12), (30, 30), (3600, 3600)]
)
def test_time_outs_are_those_of_the_intervals_or_exact(linux: Linux, asked: int, real: int) -> None:
    assert linux.run(f"watchdog-test {asked} stop").split() == [str(real)]
    assert attribute(linux, "timeout") == str(real)
    assert attribute(linux, "state") == "inactive"


def test_time_out_of_nothing_is_refused(linux: Linux) -> None:
    status, output = linux.try_to("watchdog-test 0 stop")
    assert status == 1
    assert "Invalid argument" in output


def test_new_time_out_of_a_running_watchdog_is_the_hardwares(linux: Linux) -> None:
    linux.run("watchdog-test 30 stop")
    for timeout, interval in ((2, SHORT_INTERVAL), (30, LONG_INTERVAL), (2, SHORT_INTERVAL)):
        linux.run(f"watchdog-test {timeout} feed & sleep 1; kill -9 $!")
        assert linux.machine.read(WDT_CTL) & (TOUTSEL | WDT_RUNS) == interval | WDT_RUNS
    linux.run("watchdog-test 30 stop")


@pytest.mark.parametrize(("timeout", "at_least"), [(2, 65536 / 23437.5), (11, 262144 / 23437.5), (13, 13.0)])
def test_who_leaves_it_running_is_reset_in_time(linux: Linux, timeout: int, at_least: float) -> None:
    """2 and 11 by the hardware alone, 13 with the core; whatever it was before."""
    linux.run(f"watchdog-test {30 if timeout == 2 else 2} stop")
    seconds = seconds_to_reset(linux, f"watchdog-test {timeout} leave")
    assert at_least <= seconds <= at_least + LATE_S
    assert bootstatus(linux) == CARDRESET


def test_boot_status_is_the_last_resets(linux: Linux) -> None:
    seconds_to_reset(linux, "watchdog-test 2 leave")
    assert bootstatus(linux) == CARDRESET
    linux.type("reboot -f\n<run 0>\n")
    linux.wait_for_shell()
    assert bootstatus(linux) == 0


def test_stopped_or_fed_it_does_not_reset(linux: Linux) -> None:
    linux.run("watchdog-test 2 stop")
    linux.machine.events("RESET")
    linux.run("sleep 5")
    assert not linux.machine.events("RESET")
    linux.run("watchdog-test 2 feed > /dev/null & sleep 8; kill -9 $!; wait $!; watchdog-test 2 stop")
    assert not linux.machine.events("RESET")


def test_kernel_feeds_what_a_boot_loader_has_started(linux: Linux) -> None:
    """Over more than the longest interval, and then for who opens it."""
    machine = linux.machine
    machine.events("RESET")
    machine.command("stop")
    machine.command("system_reset")
    machine.wait_for_event("RESET")
    machine.write(DIV8, X32K << 8)
    machine.write(PCLKEN0, machine.read(PCLKEN0) | WDT_CLOCK)
    for key in (0x59, 0x16, 0x88):
        machine.write(REGWPCTL, key)
    machine.write(WDT_CTL, 8 << 8 | WDT_RUNS | 1 << 1)  # 32 s, longer than a kernel needs
    machine.write(REGWPCTL, 0)
    machine.command("cont")
    linux.wait_for_shell()
    linux.run("sleep 14")
    assert not machine.events("RESET")
    assert machine.read(WDT_CTL) & WDT_RUNS
    assert attribute(linux, "state") == "inactive"
    linux.run("watchdog-test 2 stop")
    assert not machine.read(WDT_CTL) & WDT_RUNS


def test_nowayout_is_honoured(
    boot: Callable[..., Linux], kernel: Kernel, extra_files: dict[str, Path]
) -> None:
    arguments = f"{kernel.arguments} nuc980_wdt.nowayout=1"
    with boot(kernel=dataclasses.replace(kernel, arguments=arguments), files=extra_files) as linux:
        assert attribute(linux, "nowayout") == "1"
        seconds_to_reset(linux, "watchdog-test 2 stop")
        assert bootstatus(linux) == CARDRESET
