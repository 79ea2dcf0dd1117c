# SPDX-License-Identifier: GPL-3.0-or-later
"""States of the modules: an engineer stops, starts and restarts them."""

import os
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from lab.gateway import Gateway, GatewayError, free_port, listening_on, remove, run_directory
from rig.desk import chapter_5

LINE, OTHER = "rtu-modbus-1", "rtu-modbus-2"


@pytest.fixture(scope="module")
def gateway(programs: Path) -> Iterator[Gateway]:
    """Chapter 5 without its devices."""
    directory = run_directory()
    try:
        with Gateway(listening_on(chapter_5(), free_port()), directory, programs) as gateway:
            yield gateway
    finally:
        remove(directory)


@pytest.fixture(autouse=True)
def all_running(gateway: Gateway) -> None:
    gateway.wait_for(
        lambda: all(gateway.modules()[name]["state"] == "running" for name in (LINE, OTHER)),
        30.0,
        "the lines run",
    )


def refusal(gateway: Gateway, *arguments: str) -> tuple[int, str]:
    command = [gateway.build / "rtuctl" / "rtuctl", "--map", gateway.map, "module", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    return done.returncode, done.stderr


def test_what_was_stopped_stays_so_and_nobody_else_notices(gateway: Gateway) -> None:
    before = gateway.modules()
    assert gateway.ctl("module", LINE, "stop") == f"{LINE}: stopped\n"
    stopped = gateway.modules()
    assert (stopped[LINE]["state"], stopped[LINE]["pid"], stopped[LINE]["alive"]) == ("stopped", None, False)
    assert stopped[LINE]["restarts"] == before[LINE]["restarts"]
    points = [point for point in gateway.points().values() if point["owner"] == LINE]
    assert points
    assert {point["quality"] for point in points} == {"invalid"}
    gateway.ctl("module", OTHER, "restart")  # rtud looks at all modules again and again meanwhile
    assert gateway.modules()[LINE]["state"] == "stopped"
    assert gateway.ctl("module", LINE, "stop") == f"{LINE}: stopped\n"
    assert gateway.query("module", LINE, "start") == {"name": LINE, "state": "running"}
    after = gateway.modules()
    assert after[LINE]["starts"] == before[LINE]["starts"] + 1
    assert after["rtu-iec104"]["pid"] == before["rtu-iec104"]["pid"]


def test_restart_is_no_failure(gateway: Gateway) -> None:
    before = gateway.modules()[LINE]
    assert gateway.ctl("module", LINE, "restart") == f"{LINE}: running\n"
    after = gateway.modules()[LINE]
    assert after["pid"] != before["pid"]
    assert after["starts"] == before["starts"] + 1
    assert after["restarts"] == before["restarts"]
    assert gateway.ctl("module", LINE, "start") == f"{LINE}: running\n"
    assert gateway.modules()[LINE]["pid"] == after["pid"]


def test_one_that_hangs_is_stopped_too(gateway: Gateway) -> None:
    os.kill(gateway.modules()[LINE]["pid"], signal.SIGSTOP)
    assert gateway.ctl("module", LINE, "stop") == f"{LINE}: stopped\n"
    assert gateway.ctl("module", LINE, "start") == f"{LINE}: running\n"


def test_wrong_use_is_explained(gateway: Gateway) -> None:
    assert refusal(gateway, "rtu-modbus-9", "stop") == (
        1,
        'rtuctl: there is no module "rtu-modbus-9": "rtuctl modules" lists them all\n',
    )
    assert refusal(gateway, LINE, "pause") == (
        2,
        'rtuctl: "pause" is nothing to do with a module, expected stop, start or restart\n',
    )
    assert refusal(gateway, "rtud", "stop") == (1, "rtuctl: rtud starts no process for rtud\n")
    with pytest.raises(GatewayError, match="an argument is missing"):
        gateway.ctl("module", LINE)
