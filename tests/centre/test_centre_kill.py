# SPDX-License-Identifier: GPL-3.0-or-later
"""Processes of the control centre are killed at random: no event is lost, none is stored twice."""

import random
import sqlite3
import time
from pathlib import Path

import pytest

from control_room import Site, Stations, described, until
from lab.vehicles import M_ME_TF_1, measured

pytestmark = pytest.mark.slow

EVENTS = 3000
KILLS = 6


def stored(site: Site) -> list[int]:
    with sqlite3.connect(site.folder / "centre.db") as database:
        rows = database.execute("SELECT value FROM history WHERE tagged ORDER BY id")
        return [int(row[0]) for row in rows]


def test_no_event_is_lost_and_none_comes_twice(programs: Path, stations: Stations, tmp_path: Path) -> None:
    chance = random.Random(26)
    station = stations.station()
    begin_ms = time.time_ns() // 1_000_000 - EVENTS
    said = 0
    with Site(programs, tmp_path, [described(station, tmp_path)]) as site:
        for kill in range(KILLS):
            for _ in range(EVENTS // KILLS):
                stations.say(station, 4, M_ME_TF_1, measured(begin_ms + said, float(said)))
                said += 1
            wanted = len(stored(site)) + chance.randrange(EVENTS // KILLS // 2)
            until(lambda wanted=wanted: len(stored(site)) >= min(wanted, EVENTS), "some are stored")
            if kill % 2:
                site.kill(site.collector)
                site.start_collector()
            else:
                site.kill(site.centre)
                site.start_centre()
        until(lambda: len(set(stored(site))) == EVENTS, "all are stored")
        assert not station.queue
        assert station.connections >= KILLS
    assert stored(site) == list(range(said))
    stations.do(station.stop())


def test_disk_that_is_busy_holds_the_events_back(programs: Path, stations: Stations, tmp_path: Path) -> None:
    """While the database takes nothing, nothing is acknowledged, and the page can say so."""
    station = stations.station()
    with Site(programs, tmp_path, [described(station, tmp_path)]) as site:
        client = site.client("vera")
        until(lambda: client.get("/api/stations")[0]["link"] == 3, "connected")
        locked = sqlite3.connect(site.folder / "centre.db", isolation_level=None)
        locked.execute("BEGIN IMMEDIATE")
        stations.say(station, 4, M_ME_TF_1, measured(time.time_ns() // 1_000_000, 7.0))
        fault = until(lambda: client.get("/api/me")["fault"], "the centre says what is wrong")
        assert "locked" in fault
        assert station.connections == 1
        locked.execute("ROLLBACK")
        locked.close()
        until(lambda: 7 in stored(site), "it is stored at last")
        until(lambda: not client.get("/api/me")["fault"], "all is well")
    stations.do(station.stop())
