# SPDX-License-Identifier: GPL-3.0-or-later
"""Processes of the control centre are killed at random: no event is lost, none is stored twice."""

import os
import random
import signal
import sqlite3
import time
from pathlib import Path
from typing import Any

import pytest

from centre.records import Result, State
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
    with Site(programs, tmp_path, [described(station, tmp_path)], users=()) as site:
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
    with Site(programs, tmp_path, [described(station, tmp_path)], users=("vera",)) as site:
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


def test_killed_shard_strands_its_own_commands_only(
    programs: Path, stations: Stations, tmp_path: Path
) -> None:
    """A selection at a station of each of two shards: one shard is killed, the other's is executed."""
    names = "north", "south"
    made = {name: stations.station() for name in names}
    described_ones = [described(made[name], tmp_path, name) for name in names]
    with Site(programs, tmp_path, described_ones, users=("olga",), shards=2) as site:
        client = site.client("olga")

        def links() -> list[int]:
            found = {each["name"]: int(each["link"]) for each in client.get("/api/stations")}
            return [found[name] for name in names]

        def in_state(command: dict[str, Any], *states: State) -> dict[str, Any]:
            def found() -> dict[str, Any] | None:
                now = client.get(f"/api/commands/{command['id']}")
                return now if now["state"] in states else None

            return until(found, f"{command['id']} in {states}")

        until(lambda: links() == [3, 3], "both are connected")
        of_station = {each["id"]: each["name"] for each in client.get("/api/stations")}
        selected = {
            of_station[point["station"]]: client.post("/api/commands", {"point": point["id"], "value": 1})
            for point in client.get("/api/points")
            if point["name"] == "pump"
        }
        for command in selected.values():
            in_state(command, State.ACCEPTED_SELECTION)
        assert site.collector
        pid = site.collector.pid
        north = int(Path(f"/proc/{pid}/task/{pid}/children").read_text().split()[0])
        os.kill(north, signal.SIGKILL)
        ended = in_state(selected["north"], State.INTERRUPTED_SELECTION)
        assert ended["result"] == Result.UNKNOWN_FATE
        client.post(f"/api/commands/{selected['south']['id']}/execute")
        done = in_state(selected["south"], State.EXECUTED_COMMAND, State.REFUSED_COMMAND)
        assert done["result"] == Result.DONE
        until(lambda: links() == [3, 3], "the killed one has begun again")
        assert [made[name].connections for name in names] == [2, 1]
    for station in made.values():
        stations.do(station.stop())
