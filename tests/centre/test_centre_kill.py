# SPDX-License-Identifier: GPL-3.0-or-later
"""Processes of the control centre are killed at random: no event is lost, none is stored twice."""

import contextlib
import os
import random
import signal
import sqlite3
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from control_room import Site, Stations, Watch, described, until
from lab.centre_client import LIMIT_S
from lab.vehicles import M_ME_TF_1, measured
from openrtu_tools.centre.codes import Result, State
from postgres import SEGMENT_MIB, Server

pytestmark = pytest.mark.slow

EVENTS = 1500
KILLS = 6
PAUSE_S = 0.2  # between questions that cost a process
EVENTS_AT_ONCE = 200


def stored(site: Site) -> list[int]:
    return [
        int(float(row[0])) for row in site.rows("SELECT value FROM history WHERE tagged <> 0 ORDER BY id")
    ]


def test_no_event_is_lost_and_none_comes_twice(
    programs: Path, stations: Stations, server: Server | None, tmp_path: Path
) -> None:
    chance = random.Random(26)
    kills = KILLS // 2 if server else KILLS
    station = stations.station()
    begin_ms = time.time_ns() // 1_000_000 - EVENTS
    sent = 0
    with Site(programs, tmp_path, [described(station, tmp_path)], users=(), server=server) as site:
        for kill in range(kills):
            for _ in range(EVENTS // kills):
                stations.say(station, 4, M_ME_TF_1, measured(begin_ms + sent, float(sent)))
                sent += 1
            wanted = min(len(stored(site)) + chance.randrange(EVENTS // kills // 2), sent)
            until(lambda wanted=wanted: len(stored(site)) >= wanted, "some are stored", PAUSE_S)
            if server and kill % 3 == 2:
                server.stop()
                server.start()
            elif kill % 2:
                site.kill(site.collector)
                site.start_collector()
            else:
                site.kill(site.centre)
                site.start_centre()
        until(lambda: len(set(stored(site))) == EVENTS, "all are stored", PAUSE_S)
        until(lambda: not station.queue, "the station is told that it may forget them")
        assert station.connections >= kills // 2
    assert stored(site) == list(range(sent))
    stations.do(station.stop())


@contextlib.contextmanager
def locked(site: Site) -> Iterator[None]:
    """Somebody else holds what the centre wants to write to."""
    if site.server:
        session = site.server.psql()
        assert session.stdin
        assert session.stdout
        session.stdin.write("BEGIN; LOCK TABLE history;\n\\echo locked\n")
        session.stdin.flush()
        assert session.stdout.readline() == "locked\n"
        yield
        session.communicate("ROLLBACK;\n", LIMIT_S)
        return
    with contextlib.closing(sqlite3.connect(site.folder / "centre.db", isolation_level=None)) as database:
        database.execute("BEGIN IMMEDIATE")
        yield
        database.execute("ROLLBACK")


@contextlib.contextmanager
def full(site: Site) -> Iterator[None]:
    """No file may grow: the kernel does not say ENOSPC, but it says no at the same place."""
    assert site.centre
    most = 1
    processes = [site.centre.pid]
    if site.server:
        # The server's log must go on, in segments of a size: so the table is made larger than one of them.
        site.server.rows(
            "INSERT INTO history (point, at_ns, received_ns, value, quality, cause, tagged)"
            f" SELECT 0, {time.time_ns()}, 0, 0, 0, 0, 0 FROM generate_series(1, 16000)"
        )
        [(size,)] = site.server.rows(
            "SELECT max(pg_relation_size(inhrelid)) FROM pg_inherits WHERE inhparent = 'history'::regclass"
        )
        most = int(size)
        assert most > SEGMENT_MIB << 20
        processes = site.server.processes()
    before = site.server.before if site.server else []  # whoever the process belongs to
    for limit in str(most), "unlimited":
        for process in processes:
            limited = ("prlimit", "--pid", str(process), f"--fsize={limit}:unlimited")
            subprocess.run([*before, *limited], check=False)  # one may have ended
        if limit != "unlimited":
            yield


@contextlib.contextmanager
def gone(site: Site) -> Iterator[None]:
    assert site.server
    site.server.stop()
    yield
    site.server.start()


def test_database_that_takes_nothing_holds_the_events_back(
    programs: Path, stations: Stations, server: Server | None, tmp_path: Path
) -> None:
    """Nothing is acknowledged then, the page is told why, and all is stored at last, once."""
    station = stations.station()
    sent: list[int] = []
    troubles = {locked: "not answered", full: "File too large" if server else "disk I/O error"}
    if server:  # a file that is open cannot go
        troubles[gone] = ""
    with Site(programs, tmp_path, [described(station, tmp_path)], users=("vera",), server=server) as site:
        client = site.client("vera")
        until(lambda: client.get("/api/stations")[0]["link"] == 3, "connected")
        with Watch(stations, client, {"view": "stations"}) as page:
            for trouble, why in troubles.items():
                with trouble(site):
                    for _ in range(EVENTS_AT_ONCE):
                        sent.append(len(sent) + 1)
                        event = measured(time.time_ns() // 1_000_000, float(sent[-1]))
                        stations.say(station, 4, M_ME_TF_1, event)
                    assert why in until(lambda: page.fault, f"the page is told of {trouble.__name__}")
                    assert station.queue
                until(lambda: set(stored(site)) >= set(sent), "all is stored at last", PAUSE_S)
                until(lambda: not page.fault, "all is well")
        assert station.connections == 1
        assert stored(site) == sent
    stations.do(station.stop())


@contextlib.contextmanager
def restarted(site: Site) -> Iterator[None]:
    """The centre's connection is to the server as it was before; nothing has been asked over it since."""
    with gone(site):
        pass
    yield


def test_centre_ends_though_nothing_can_be_stored(
    programs: Path, stations: Stations, server: Server | None, tmp_path: Path
) -> None:
    station = stations.station()
    with Site(programs, tmp_path, [described(station, tmp_path)], users=("vera",), server=server) as site:
        for trouble in (gone, restarted) if server else (locked,):
            client = site.client("vera")
            until(lambda client=client: client.get("/api/stations")[0]["link"] == 3, "connected")
            with trouble(site):
                assert site.centre
                site.centre.send_signal(signal.SIGTERM)
                assert site.centre.wait(LIMIT_S) == 0, site.log()
            site.start_centre()
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
