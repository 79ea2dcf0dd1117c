# SPDX-License-Identifier: GPL-3.0-or-later
"""Modules that are killed, hang or are stopped, under load: the others go on, and no stale value is good."""

import datetime
import itertools
import os
import signal
import threading
import time
from pathlib import Path

import pytest

from desk import Desk, chapter_5, desk_of
from lab.gateway import Gateway
from lab.master import Master

KILLS = 50
SOAK_KILLS = 1000
INVALID_WITHIN = datetime.timedelta(milliseconds=100)
# The stations of each line process; 1000 is only written, and never valid.
STATIONS = {
    "rtu-modbus-1": (1010, 2020, 3035, 3067, 3155, 3201),
    "rtu-modbus-2": (4040, 5050, 5051, 6001, 6247),
}


class Load:
    """Values that change all the time while modules die."""

    def __init__(self, desk: Desk) -> None:
        self._desk = desk
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
                self._desk.lines.set(unit, "input_registers", 0, value)
            self._desk.lines.set("4.40", "input_registers", 1, value)


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

    gateway.wait_for(restarted, 15, f"{name} runs again")


def kill_lines(desk: Desk, name: str, times: int) -> None:
    """Every point of its lines turns invalid, and good again; no point of another process is touched."""
    stations = STATIONS[name]
    others = {ca for other in STATIONS if other != name for ca in STATIONS[other]}
    restarts = desk.gateway.modules()[name]["restarts"]
    with Master(*desk.gateway.address) as master:
        master.synchronise_clock(3067)
        for _ in range(times):
            since = master.mark()
            pid, when = kill(desk.gateway, name)
            for ca in stations:
                report = master.wait(lambda r, c=ca: r.ca == c and "Invalid" in r.quality, since)
                assert report.recorded_at is not None
                assert report.recorded_at - when < INVALID_WITHIN
            wait_restarted(desk.gateway, name, pid)
            for ca in stations:
                master.wait(lambda r, c=ca: r.ca == c and r.good, since)
            assert not [r for r in master.reports_since(since) if r.ca in others and r.quality == "Invalid"]
    assert desk.gateway.modules()[name]["restarts"] == restarts + times
    for ca in stations:
        desk.wait_all_good(ca)


def kill_station(desk: Desk, times: int) -> None:
    """The lines go on, and the next connection finds the station as it was."""
    restarts = desk.gateway.modules()["rtu-iec104"]["restarts"]
    for _ in range(times):
        pid, _ = kill(desk.gateway, "rtu-iec104")
        wait_restarted(desk.gateway, "rtu-iec104", pid)
        assert not [p for p in desk.gateway.points("p3.*").values() if p["quality"] == "invalid"]
    assert desk.gateway.modules()["rtu-iec104"]["restarts"] == restarts + times
    with Master(*desk.gateway.address) as master:
        assert len(master.interrogate(3067)) == 13


@pytest.mark.slow
@pytest.mark.parametrize("name", STATIONS)
def test_killed_line_process_loses_nothing(desk: Desk, name: str) -> None:
    with Load(desk):
        kill_lines(desk, name, KILLS)


@pytest.mark.slow
def test_killed_station_loses_nothing(desk: Desk) -> None:
    with Load(desk):
        kill_station(desk, KILLS)


@pytest.mark.soak
@pytest.mark.parametrize("name", STATIONS)
def test_a_thousand_kills_of_a_line_process(desk: Desk, name: str) -> None:
    with Load(desk):
        for _ in range(SOAK_KILLS // KILLS):  # each with a controlling station of its own
            kill_lines(desk, name, KILLS)


@pytest.mark.soak
def test_a_thousand_kills_of_the_station(desk: Desk) -> None:
    with Load(desk):
        kill_station(desk, SOAK_KILLS)


def test_one_kill_of_each_module(desk: Desk) -> None:
    for name in STATIONS:
        kill_lines(desk, name, 1)
    kill_station(desk, 1)


def test_stopped_line_process_is_invalid_until_it_goes_on(desk: Desk) -> None:
    with Master(*desk.gateway.address) as master:
        since = master.mark()
        pid, _ = kill(desk.gateway, "rtu-modbus-2", signal.SIGSTOP)
        master.wait(lambda r: r.ca == 4040 and "Invalid" in r.quality, since)
        since = master.mark()
        os.kill(pid, signal.SIGCONT)
        for ca in (4040, 6001):
            master.wait(lambda r, c=ca: r.ca == c and r.good, since)
    assert desk.gateway.modules()["rtu-modbus-2"]["pid"] == pid  # it was given the time to come back


def test_hung_line_process_is_killed_and_restarted(desk: Desk) -> None:
    pid, _ = kill(desk.gateway, "rtu-modbus-2", signal.SIGSTOP)
    wait_restarted(desk.gateway, "rtu-modbus-2", pid)
    desk.wait_all_good(4040)


def test_end_of_rtud_is_the_end_of_all(programs: Path) -> None:
    """Nothing goes on unsupervised, and the next rtud finds no obstacle."""
    with desk_of(chapter_5(), programs) as desk:
        pids = [module["pid"] for module in desk.gateway.modules().values() if module["pid"]]
        assert desk.gateway.process is not None
        desk.gateway.process.kill()
        desk.gateway.process.wait()
        deadline = time.monotonic() + 5
        while any(alive(pid) for pid in pids):
            assert time.monotonic() < deadline, "modules go on without rtud"
            time.sleep(0.01)
        desk.gateway.start()
        desk.wait_all_good(3067)


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().split(") ")[1][0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


def test_stop_is_clean(programs: Path) -> None:
    with desk_of(chapter_5(), programs) as desk:
        begin = time.monotonic()
        assert desk.gateway.stop() == 0
        assert time.monotonic() - begin < 3  # nobody had to be killed
        assert not list(desk.gateway.map.iterdir())  # segments and bells are gone
