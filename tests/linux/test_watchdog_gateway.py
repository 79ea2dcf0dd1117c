# SPDX-License-Identifier: GPL-3.0-or-later
"""rtud feeds the board's watchdog: what resets the board, and what must not."""

import json
from collections.abc import Callable

import pytest

from nuc980.twin.linux import Linux
from rig.desk import chapter_5

CONFIG = "etc/openrtu/gateway.json"
PROGRAM = "/usr/libexec/openrtu/rtu-modbus"
STATE = "/sys/class/watchdog/watchdog0/state"
TIMEOUT_S = 30
LONGER_S = TIMEOUT_S + 8
CARDRESET = "32"


# The board's time goes by its instructions and leaps over its waits: nobody sits through the time-outs.
LEAPING = ("-icount", "shift=3,sleep=off")


@pytest.fixture(scope="module")
def board_arguments() -> tuple[str, ...]:
    return LEAPING


@pytest.fixture(scope="module")
def extra_files() -> dict[str, str]:
    """Lines whose devices are all dead: nothing is wired to the board."""
    return {CONFIG: json.dumps(chapter_5())}


def attribute(linux: Linux, name: str) -> str:
    return linux.run(f"cat /sys/class/watchdog/watchdog0/{name}").strip()


def wait_fed(linux: Linux) -> None:
    linux.run(f"until [ $(cat {STATE}) = active ]; do sleep 0.2; done", seconds=120)


def rtud(linux: Linux) -> str:
    return linux.run("pidof rtud").strip()


def outlives_the_time_out(linux: Linux) -> bool:
    linux.machine.events("RESET")
    linux.run(f"sleep {LONGER_S}", seconds=LONGER_S + 60)
    return not linux.machine.events("RESET")


def test_rtud_asks_for_half_a_minute_and_says_what_it_has(linux: Linux) -> None:
    wait_fed(linux)
    assert attribute(linux, "timeout") == str(TIMEOUT_S)
    assert "/dev/watchdog0 resets the board after 30 s without rtud" in linux.run("rtuctl log")


def test_what_rtud_takes_care_of_does_not_reset(linux: Linux) -> None:
    """Dead devices, a module that cannot run, the end of rtud itself: it is started again in time."""
    wait_fed(linux)
    linux.run(f"mount -o remount,rw / && mv {PROGRAM} {PROGRAM}.good")
    linux.run("pkill -9 rtu-modbus")
    linux.run("until rtuctl log | grep -q 'cannot start rtu-modbus'; do sleep 0.2; done", seconds=120)
    linux.run(f"echo no program > {PROGRAM} && chmod 755 {PROGRAM}")  # without one, rtud does not start
    killed = rtud(linux)
    linux.run(f"kill -9 {killed}")
    assert outlives_the_time_out(linux)
    assert rtud(linux) not in ("", killed)
    assert "rtu-modbus-1 exited with code 127" in linux.run("rtuctl log")
    linux.run(f"mv {PROGRAM}.good {PROGRAM}")


def test_orderly_stop_stops_the_watchdog(linux: Linux) -> None:
    linux.run("/etc/init.d/S80rtud stop")
    assert attribute(linux, "state") == "inactive"
    assert outlives_the_time_out(linux)
    linux.run("/etc/init.d/S80rtud start")
    wait_fed(linux)


def test_rtud_that_hangs_resets_the_board(linux: Linux) -> None:
    wait_fed(linux)
    linux.machine.events("RESET")
    linux.run("kill -STOP $(pidof rtud)")
    linux.machine.wait_for_event("RESET")
    linux.wait_for_shell()
    assert attribute(linux, "bootstatus") == CARDRESET
    wait_fed(linux)


def test_bad_configuration_does_not_reset_for_ever(boot: Callable[..., Linux]) -> None:
    with boot(*LEAPING, files={CONFIG: json.dumps({"port": [{"value": 1, "active": 1}]})}) as linux:
        assert outlives_the_time_out(linux)
        assert attribute(linux, "state") == "inactive"
        assert attribute(linux, "bootstatus") == "0"
