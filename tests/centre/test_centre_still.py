# SPDX-License-Identifier: GPL-3.0-or-later
"""Whoever is removed while a request waits does nothing with it: the transaction looks again."""

import contextlib
import sqlite3
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from typing import Any

import pytest

from control_room import PASSWORD, Site, Stations, Watch, until
from lab.centre_client import AnswerError, Client
from lab.vehicles import M_SP_TB_1, Station, single
from openrtu_tools.centre.codes import Link
from openrtu_tools.centre.records import ENDED
from test_centre_kill import full

pytestmark = pytest.mark.slow

Make = Callable[..., Site]


@pytest.fixture(scope="module")
def site(of_north: Make, stations: Stations, north: Station) -> Iterator[Site]:
    with of_north() as started:
        for ioa in (2, 3, 5):
            stations.say(north, ioa, M_SP_TB_1, single(time.time_ns() // 1_000_000, ioa == 5))
        client = started.client("vera")
        until(lambda: client.get("/api/alarms"), "the station burns")
        until(lambda: sum(bool(point["at"]) for point in client.get("/api/points")) >= 3, "the points")
        yield started


@contextlib.contextmanager
def nothing_is_written(site: Site) -> Iterator[sqlite3.Connection]:
    """Until its end whatever the centre wants to store waits. What is done here is stored before."""
    with closing(sqlite3.connect(site.folder / "centre.db", isolation_level=None)) as database:
        database.execute("PRAGMA foreign_keys = ON")
        database.execute("BEGIN IMMEDIATE")
        yield database
        database.execute("COMMIT")


def refusal(client: Client, method: str, path: str, body: Any) -> str | None:
    try:
        client.raw(method, path, body)
    except AnswerError as error:
        return error.code
    return None


def add(engineer: Client) -> None:
    for name, role in (("olga", "operator"), ("rita", "engineer")):
        made = {"name": name, "role": role, "password": PASSWORD, "own_password": PASSWORD}
        engineer.post("/api/users", made)


def gone(database: sqlite3.Connection) -> None:
    database.execute("DELETE FROM users WHERE name IN ('olga', 'rita')")


def lowered(database: sqlite3.Connection) -> None:
    database.execute("UPDATE users SET role = 'viewer' WHERE name IN ('olga', 'rita')")


@pytest.mark.parametrize("change", [gone, lowered])
def test_who_is_removed_while_a_request_waits_does_nothing(
    site: Site, change: Callable[[sqlite3.Connection], None]
) -> None:
    emil, vera = site.client("emil"), site.client("vera")
    add(emil)
    olga, rita = site.client("olga"), site.client("rita")
    points = {point["name"]: point["id"] for point in olga.get("/api/points")}
    [station] = [each["id"] for each in olga.get("/api/stations")]
    alarms = [each["id"] for each in olga.get("/api/alarms") if not each["acknowledged"]]
    selected = olga.post("/api/commands", {"point": points["pump"], "value": 1})["id"]
    until(lambda: olga.get(f"/api/commands/{selected}")["state"] == 2, "it is selected")
    [session] = [each["id"] for each in emil.get("/api/sessions") if each["own"]]
    asked = [
        (olga, "POST", "/api/commands", {"point": points["lamp"], "value": 1}),
        (olga, "POST", f"/api/commands/{selected}/execute", None),
        (olga, "POST", f"/api/alarms/{alarms[0]}/shelve", {"minutes": 5}),
        (olga, "POST", "/api/alarms/acknowledge", {"ids": alarms}),
        (olga, "POST", f"/api/alarms/{alarms[0]}/acknowledge", None),
        (olga, "POST", f"/api/stations/{station}/interrogate", None),
        (rita, "GET", f"/api/stations/{station}/trace", None),
        (rita, "POST", f"/api/sessions/{session}/end?user=emil", None),
    ]
    before = site.rows("SELECT max(id) FROM audit")[0][0]
    with ThreadPoolExecutor(len(asked)) as pool:
        with nothing_is_written(site) as database:
            answers = [pool.submit(refusal, *each) for each in asked]
            # All that is asked waits behind the first one, which is slow enough to be a fault.
            until(lambda: vera.get("/api/me")["fault"], "they wait")
            change(database)
        codes = [answer.result() for answer in answers]
    assert codes == ["session"] * len(asked)
    done = {row[1] for row in site.rows(f"SELECT id, action FROM audit WHERE id > {before}")}
    assert not done & {"command", "execute", "shelve", "acknowledge", "interrogate", "trace", "session ended"}
    assert emil.get("/api/me")["user"] == "emil"
    add(emil)
    site.client("olga").post(f"/api/commands/{selected}/cancel")
    until(lambda: vera.get(f"/api/commands/{selected}")["state"] in ENDED, "it is cancelled")


def test_a_page_is_told_that_its_session_has_ended_though_nothing_changes(
    site: Site, stations: Stations
) -> None:
    client, emil = site.client("omar"), site.client("emil")
    [session] = [each["id"] for each in client.get("/api/sessions") if each["own"]]
    with Watch(stations, client, {"view": "stations"}) as page:
        emil.post(f"/api/sessions/{session}/end?user=omar")
        until(page.listening.done, "it is sent away")
        assert page.socket and page.socket.close_code == 4401


def test_a_trace_that_could_not_begin_begins_when_it_is_asked_for_again(site: Site) -> None:
    """It is in the audit before a frame is shown, and rtu-centre is told of it."""
    emil = site.client("emil")
    [station] = [each["id"] for each in emil.get("/api/stations")]
    path = f"/api/stations/{station}/trace"

    def begun() -> int:
        return len(site.rows("SELECT id FROM audit WHERE action = 'trace'"))

    with full(site):
        assert refusal(emil, "GET", path, None) == "store"
    site.kill(site.collector)
    until(lambda: not emil.get("/api/me")["collects"], "rtu-centre is gone")
    until(lambda: refusal(emil, "GET", path, None) == "no_collector", "it can be stored again", 0.2)
    site.start_collector()
    until(lambda: emil.get("/api/stations")[0]["link"] == Link.UP, "the station is connected", 0.2)
    before = begun()
    emil.get(path)
    assert begun() == before + 1
    emil.post(f"/api/stations/{station}/interrogate")
    until(lambda: emil.get(path), "frames", 0.2)
    assert begun() == before + 1
