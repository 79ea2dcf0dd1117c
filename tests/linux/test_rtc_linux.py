# SPDX-License-Identifier: GPL-3.0-or-later
"""The clock's driver: what is read and set, the ends of its range; the alarm; a clock that nobody has set."""

import dataclasses
import os
import re
import subprocess
from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path

import pytest

from nuc980.twin.linux import Kernel, Linux

ROOT = Path(__file__).parents[2]
PROGRAMS = Path(__file__).parent / "programs"
COMPILER = os.environ.get("CROSS_COMPILE", "arm-linux-gnueabi-") + "gcc"
LATE = timedelta(seconds=15)  # a busy host
A_BOOT = timedelta(minutes=5)
SETS = 400


@pytest.fixture(scope="module")
def kernel(kernel: Kernel, tmp_path_factory: pytest.TempPathFactory) -> Kernel:
    """On a board that has the crystal."""
    dtb = tmp_path_factory.mktemp("rtc") / "nuc980-gateway.dtb"
    build = [ROOT / "scripts/build-dtb.sh", ROOT / "dts/nuvoton/nuc980-gateway.dts", dtb, "GATEWAY_RTC=1"]
    subprocess.run(build, check=True)
    return dataclasses.replace(kernel, dtb=dtb)


@pytest.fixture(scope="module")
def extra_files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("rtc")
    options = ["-static", "-std=c11", "-O2", "-D_GNU_SOURCE", "-D_TIME_BITS=64", "-D_FILE_OFFSET_BITS=64",
               "-Wall", "-Wextra", "-Werror"]  # fmt: skip
    for name in ("clock", "busy"):
        subprocess.run([COMPILER, *options, "-o", folder / name, PROGRAMS / f"{name}.c"], check=True)
    return {f"usr/bin/{name}": folder / name for name in ("clock", "busy")}


@pytest.fixture(scope="module")
def board_arguments() -> tuple[str, ...]:
    return ("-rtc", "base=2031-02-28T22:00:00")


def read(linux: Linux) -> datetime:
    return datetime.fromisoformat(linux.run("clock read").strip())


def assert_soon_after(time: datetime, begin: str, late: timedelta = LATE) -> None:
    expected = datetime.fromisoformat(begin)
    assert expected <= time <= expected + late


def test_system_starts_with_the_clocks_time(linux: Linux) -> None:
    found = re.search(r"setting system clock to (\S+) UTC", linux.run("dmesg"))
    assert found
    assert_soon_after(datetime.fromisoformat(found[1]), "2031-02-28T22:00:00")


@pytest.mark.parametrize(
    "to",
    [
        "2000-01-01T00:00:00",
        "2027-12-31T23:59:59",
        "2028-02-28T23:59:59",  # a leap year
        "2031-10-10T10:10:10",
        "2099-03-01T12:00:00",  # 68 years from its start: the twin moves its clock no further
    ],
)
def test_clock_is_set_and_runs_on(linux: Linux, to: str) -> None:
    linux.run(f"clock set {to}")
    first = read(linux)
    assert_soon_after(first, to)
    linux.run("sleep 2")
    assert read(linux) > first


def test_clock_is_set_by_whoever_is_often_kept_waiting(linux: Linux) -> None:
    """For longer than a key opens its registers, 31 ms; at any of its steps."""
    to = "2050-06-07T08:09:10"
    linux.run(f"busy 45 10 clock set {to} {SETS}", seconds=300)
    assert_soon_after(read(linux), to)


def test_time_beyond_its_century_is_refused(linux: Linux) -> None:
    linux.run("clock set 2040-05-06T07:08:09")
    status, output = linux.try_to("clock set 2100-01-01T00:00:00")
    assert status != 0
    assert "Numerical result out of range" in output
    assert read(linux).year == 2040


def test_clock_survives_a_restart(linux: Linux) -> None:
    linux.run("clock set 2044-02-29T23:59:30")
    linux.type("reboot -f\n<run 0>\n")
    linux.wait_for_shell()
    assert_soon_after(read(linux), "2044-02-29T23:59:30", A_BOOT)


@pytest.mark.parametrize("begin", ["2033-03-03T03:03:03", "2035-12-31T23:59:58"])
def test_alarm_comes_by_interrupt(linux: Linux, begin: str) -> None:
    linux.run(f"clock set {begin}")
    before = interrupts(linux)
    kind, late = linux.run("clock alarm 4").split()
    assert kind == "alarm"
    assert 0 <= int(late) <= LATE.total_seconds()
    assert interrupts(linux) == before + 1


def interrupts(linux: Linux) -> int:
    return int(linux.run("grep b0041000.rtc /proc/interrupts").split()[1])


def test_clock_without_its_battery_is_invalid_until_it_is_set(
    boot: Callable[..., Linux], extra_files: dict[str, Path]
) -> None:
    with boot("-global", "nuc980-rtc.battery=off", files=extra_files) as linux:
        assert "unable to read the hardware clock" in linux.run("dmesg")
        status, output = linux.try_to("clock read")
        assert status != 0
        assert "Invalid argument" in output
        linux.run("clock set 2033-03-03T03:03:03")
        assert_soon_after(read(linux), "2033-03-03T03:03:03")
