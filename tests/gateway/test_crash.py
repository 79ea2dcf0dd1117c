# SPDX-License-Identifier: GPL-3.0-or-later
"""Modules that are killed, hang or are stopped, under load: the others go on, and no stale value is good."""

import datetime
import itertools
import os
import re
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import pytest

from busy import busy_processes
from lab.gateway import HEARTBEAT_LIMIT_MS, Gateway
from lab.raw_master import INVALID, Object, RawMaster
from rig.desk import Substation, chapter_5, gateway_on_lines, substation_of

KILLS = 50
SOAK_KILLS = 1000
ARRIVES_WITHIN_S = 30.0
# As its end is seen, not as its heartbeat is missed.
INVALID_WITHIN = datetime.timedelta(milliseconds=HEARTBEAT_LIMIT_MS)
AS_ON_A_BOARD = {"heartbeat_limit_ms": 100}
# The stations of each line process; 1000 is only written, and never valid.
STATIONS = {
    "rtu-modbus-1": (1010, 2020, 3035, 3067, 3155, 3201),
    "rtu-modbus-2": (4040, 5050, 5051, 6001, 6247),
}


@pytest.fixture(scope="module")
def substation(programs: Path) -> Iterator[Substation]:
    """The gateway of chapter 5 without a controlling station: each test connects its own."""
    with substation_of(chapter_5(), programs) as substation:
        yield substation


class Load:
    """Values that change all the time while modules die."""

    def __init__(self, substation: Substation) -> None:
        self._substation = substation
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def __enter__(self) -> None:
        self._thread.start()

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        for value in itertools.cycle(range(1000)):
            if self._stop.wait(0.01):
                return
            for unit in ("3.35", "3.155"):
                self._substation.lines.set(unit, "input_registers", 0, value)
            self._substation.lines.set("4.40", "input_registers", 1, value)


def kill(
    gateway: Gateway, name: str, number: signal.Signals = signal.SIGKILL
) -> tuple[int, datetime.datetime]:
    module = gateway.modules()[name]
    when = datetime.datetime.now(datetime.UTC)
    os.kill(module["pid"], number)
    return module["pid"], when


def wait_restarted(gateway: Gateway, name: str, pid: int) -> None:
    def restarted() -> bool:
        module = gateway.modules()[name]
        return module["state"] == "running" and module["pid"] not in (0, pid)

    gateway.wait_for(restarted, 60.0, f"{name} runs again")


def collect(master: RawMaster, wanted: Callable[[Object], bool], stations: Iterable[int]) -> list[Object]:
    """What arrives until every one of the stations has reported an object that is wanted; all of it."""
    missing, seen = set(stations), []
    deadline = time.monotonic() + ARRIVES_WITHIN_S
    while missing:
        objects = master.spontaneous(deadline)
        seen += objects
        missing -= {found.ca for found in objects if wanted(found)}
    return seen


def kill_lines(substation: Substation, name: str, times: int) -> None:
    """Every point of its lines turns invalid, and good again; no point of another process is touched."""
    gateway, stations = substation.gateway, STATIONS[name]
    others = {ca for other in STATIONS if other != name for ca in STATIONS[other]}
    restarts = gateway.modules()[name]["restarts"]
    with RawMaster(*gateway.address) as master:
        for _ in range(times):
            pid, when = kill(gateway, name)
            seen = collect(master, lambda found: bool(found.quality & INVALID), stations)
            for found in seen:
                if found.quality & INVALID:
                    assert found.recorded_at is not None
                    assert found.recorded_at - when < INVALID_WITHIN
            wait_restarted(gateway, name, pid)
            seen += collect(master, lambda found: found.quality == 0, stations)
            assert not [found for found in seen if found.ca in others and found.quality & INVALID]
    assert gateway.modules()[name]["restarts"] == restarts + times
    for ca in stations:
        substation.wait_all_good(ca)


def kill_station(substation: Substation, times: int) -> None:
    """The lines go on, and the next connection finds the station as it was."""
    gateway = substation.gateway
    restarts = gateway.modules()["rtu-iec104"]["restarts"]
    for _ in range(times):
        pid, _ = kill(gateway, "rtu-iec104")
        wait_restarted(gateway, "rtu-iec104", pid)
        assert not [p for p in gateway.points("p3.*").values() if p["quality"] == "invalid"]
    assert gateway.modules()["rtu-iec104"]["restarts"] == restarts + times
    with RawMaster(*gateway.address) as master:
        assert len(master.interrogate(3067).objects) == 13


@pytest.mark.slow
@pytest.mark.parametrize("name", STATIONS)
def test_killed_line_process_loses_nothing(substation: Substation, name: str) -> None:
    with Load(substation):
        kill_lines(substation, name, KILLS)


@pytest.mark.slow
def test_killed_station_loses_nothing(substation: Substation) -> None:
    with Load(substation):
        kill_station(substation, KILLS)


@pytest.mark.soak
@pytest.mark.parametrize("name", STATIONS)
def test_a_thousand_kills_of_a_line_process(substation: Substation, name: str) -> None:
    with Load(substation):
        kill_lines(substation, name, SOAK_KILLS)


@pytest.mark.soak
def test_a_thousand_kills_of_the_station(substation: Substation) -> None:
    with Load(substation):
        kill_station(substation, SOAK_KILLS)


@pytest.mark.slow
def test_one_kill_of_each_module(substation: Substation) -> None:
    for name in STATIONS:
        kill_lines(substation, name, 1)
    kill_station(substation, 1)


@pytest.mark.slow
def test_stopped_line_process_is_invalid_until_it_goes_on(substation: Substation) -> None:
    with RawMaster(*substation.gateway.address) as master:
        pid, _ = kill(substation.gateway, "rtu-modbus-2", signal.SIGSTOP)
        collect(master, lambda found: bool(found.quality & INVALID), [4040])
        os.kill(pid, signal.SIGCONT)
        collect(master, lambda found: found.quality == 0, [4040, 6001])
    assert substation.gateway.modules()["rtu-modbus-2"]["pid"] == pid  # it was given the time to come back
    for line in (
        r"rtud warning: rtu-modbus-2 has been silent for \d+ ms \(limit 2000\): its points are invalid",
        r"rtu-modbus-2 warning: silent for \d+ ms \(limit 2000\): this process was stopped or busy all",
        r"rtud warning: rtu-modbus-2 is back: it was silent for [2-9]\d\d\d ms",
    ):
        wait_logged(substation.gateway, line)


def wait_logged(gateway: Gateway, pattern: str) -> re.Match[str]:
    """Until the log has such a line."""

    def found() -> re.Match[str] | None:
        return re.search(pattern, gateway.log_file.read_text())

    gateway.wait_for(lambda: found() is not None, 60, f"the log has {pattern}")
    match = found()
    assert match is not None
    return match


@pytest.mark.slow
def test_hung_line_process_is_killed_and_restarted(programs: Path) -> None:
    with gateway_on_lines(chapter_5() | {"modbus": AS_ON_A_BOARD}, programs) as (_, gateway):
        pid, _ = kill(gateway, "rtu-modbus-2", signal.SIGSTOP)
        wait_restarted(gateway, "rtu-modbus-2", pid)
        wait_logged(gateway, r"rtu-modbus-2 has been silent for \d+ ms \(limit 100\)")


@pytest.mark.slow
def test_a_host_without_time_for_a_line_process_is_blamed(programs: Path) -> None:
    """It shares a processor, of which it gets what others leave, with two that leave nothing."""
    config = chapter_5() | {"modbus": AS_ON_A_BOARD | {"priority": 0}}
    with gateway_on_lines(config, programs) as (_, gateway):
        pid = gateway.modules()["rtu-modbus-2"]["pid"]
        processor = {min(os.sched_getaffinity(0))}
        with busy_processes(2, processor):
            os.sched_setaffinity(pid, processor)
            os.sched_setscheduler(pid, os.SCHED_IDLE, os.sched_param(0))
            late = wait_logged(
                gateway,
                r"rtu-modbus-2 warning: silent for (\d+) ms \(limit 100\): "
                r"the host gave this process no time for (\d+) ms",
            )
    silent_ms, waited_ms = map(int, late.groups())
    assert silent_ms >= 100  # cut off at a millisecond
    assert silent_ms / 2 <= waited_ms <= silent_ms + 1


@pytest.mark.slow
def test_end_of_rtud_is_the_end_of_all(programs: Path) -> None:
    """Nothing goes on unsupervised, and the next rtud finds no obstacle."""
    with substation_of(chapter_5(), programs) as substation:
        pids = [module["pid"] for module in substation.gateway.modules().values() if module["pid"]]
        assert substation.gateway.process is not None
        substation.gateway.process.kill()
        substation.gateway.process.wait()
        deadline = time.monotonic() + 60
        while any(alive(pid) for pid in pids):
            assert time.monotonic() < deadline, "modules go on without rtud"
            time.sleep(0.01)
        substation.gateway.start()
        substation.wait_all_good(3067)


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().split(") ")[1][0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


def test_stop_is_clean(programs: Path) -> None:
    with substation_of(chapter_5(), programs) as substation:
        begin = time.monotonic()
        assert substation.gateway.stop() == 0
        assert time.monotonic() - begin < 3  # nobody had to be killed
        assert not list(substation.gateway.map.iterdir())  # segments and bells are gone
