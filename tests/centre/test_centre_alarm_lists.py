# SPDX-License-Identifier: GPL-3.0-or-later
"""Alarms and events as they are asked for: of one fault, by text and time, how often. With kills."""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest import mock

import pytest

from control_room import PASSWORD, Site, Stations, described, now_ms, until
from lab.centre_client import AnswerError, Client
from lab.vehicles import M_ME_TF_1, M_SP_TB_1, Station, measured, single
from openrtu_tools.centre.database import open_store
from openrtu_tools.centre.settings import load
from openrtu_tools.centre.users import put
from postgres import Server

pytestmark = pytest.mark.slow

NAMES = ("mill", "north", "south", "weir")
GROUPS = {"mill": "power"}


@pytest.fixture(scope="module")
def made(stations: Stations, server: Server | None) -> Iterator[dict[str, Station]]:
    """Others for each store."""
    found = {name: stations.station() for name in NAMES}
    yield found
    for station in found.values():
        stations.do(station.stop())


@pytest.fixture(scope="module")
def site(
    programs: Path,
    made: dict[str, Station],
    server: Server | None,
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[Site]:
    folder = tmp_path_factory.mktemp("lists")
    here = [
        described(station, folder, name, group=GROUPS.get(name, "water")) for name, station in made.items()
    ]
    alarms = {"network_stations": 3}
    with Site(programs, folder, here, users=("emil", "olga"), server=server, centre={"alarms": alarms}) as on:
        with (
            mock.patch.dict(os.environ, on.environment),
            contextlib.closing(open_store(load(on.file).database, alone=False)) as store,
        ):
            store.transaction(
                lambda database: put(database, "walter", "operator", PASSWORD, "tests", ["water"])
            )
        yield on


@pytest.fixture
def olga(site: Site) -> Client:
    client = site.client("olga")
    until(lambda: links(client) == {3}, "all are connected")
    return client


def links(client: Client) -> set[int]:
    return {each["link"] for each in client.get("/api/stations")}


def kinds(client: Client, query: str = "") -> list[str]:
    """Of what is no part of something else."""
    return [each["kind"] for each in client.get(f"/api/alarms{query}") if not each["suppressed_by"]]


def names(client: Client, rows: list[dict[str, Any]]) -> set[str]:
    found = {each["id"]: each["name"] for each in client.get("/api/stations")}
    return {found[row["station"]] for row in rows}


def is_on(client: Client, station: str) -> bool:
    fires = [each for each in client.get("/api/points?search=fire") if each["value"] == 1]
    return station in names(client, fires)


def test_fault_of_the_network_is_one_alarm_with_its_stations(
    site: Site, olga: Client, stations: Stations, made: dict[str, Station]
) -> None:
    """A kill of the centre changes nothing. Who acknowledges it acknowledges its parts; each station comes
    back by itself. Who sees some stations only is told of each of these.
    """
    gone = ("mill", "north", "south")
    for name in gone:
        stations.do(made[name].stop())
    until(lambda: kinds(olga, "?kind=network") == ["network"], "one alarm of all")
    site.kill(site.centre)
    site.start_centre()
    olga = site.client("olga")
    until(lambda: links(olga) == {3, 4}, "the collector has told all")
    assert kinds(olga) == ["network"]
    [network] = olga.get("/api/alarms?kind=network")
    parts = olga.get(f"/api/alarms?part_of={network['id']}")
    assert (network["value"], names(olga, parts)) == (3, set(gone))
    walter = site.client("walter")
    assert kinds(walter) == ["lost", "lost"]
    assert [each["kind"] for each in walter.get("/api/alarms?from=0")] == ["lost", "lost"]
    rates = walter.get("/api/alarms/rates")
    assert [each["kind"] for each in rates["top"]] == ["lost", "lost"]
    assert (rates["standing"], rates["suppressed"]) == (2, 0)
    with pytest.raises(AnswerError) as refused:
        walter.post(f"/api/alarms/{network['id']}/acknowledge")
    assert refused.value.code == "gone"
    olga.post(f"/api/alarms/{network['id']}/acknowledge")
    parts = olga.get(f"/api/alarms?part_of={network['id']}")
    assert [each["by"] for each in parts] == ["olga"] * 3
    audit = site.client("emil").get("/api/audit?kind=alarms")
    assert [row["detail"].partition(": ")[2] for row in audit] == ["lost"] * 3 + ["network"]
    stations.do(made["mill"].listen())
    until(lambda: len(olga.get("/api/alarms?kind=lost")) == 2, "one is back")
    assert kinds(olga) == ["network"]
    for name in gone[1:]:
        stations.do(made[name].listen())
    until(lambda: not olga.get("/api/alarms"), "all are back")
    assert len(olga.get(f"/api/alarms?part_of={network['id']}")) == 3


def test_past_alarms_and_events_are_found_by_text_time_and_kind(
    olga: Client, site: Site, stations: Stations, made: dict[str, Station]
) -> None:
    before = now_ms()
    stations.say(made["weir"], 4, M_ME_TF_1, measured(before, 9))
    stations.say(made["mill"], 5, M_SP_TB_1, single(before + 1, True))
    until(lambda: sorted(kinds(olga)) == ["high", "state"], "two alarms")
    high, state = (olga.get(f"/api/alarms?kind={kind}")[0] for kind in ("high", "state"))
    olga.post(f"/api/alarms/{state['id']}/shelve", {"minutes": 5, "why": "Fire 100% drill"})
    olga.post(f"/api/alarms/{high['id']}/acknowledge")

    def found(query: str) -> set[int]:
        return {each["id"] for each in olga.get(f"/api/alarms?{query}")} & {high["id"], state["id"]}

    past = f"from={before - 10_000}&to={now_ms() + 10_000}"
    for span in (past, ""):
        assert found(f"{span}&text=LEVEL") == {high["id"]}
        assert found(f"{span}&text=wei") == {high["id"]}
        assert found(f"{span}&text=OLGA") == {high["id"]}
        assert found(f"{span}&text=100%25 drill".replace(" ", "%20")) == {state["id"]}
        assert found(f"{span}&text=1%25d") == set()
    assert found(f"to={before - 1}") == set()
    assert names(olga, olga.get(f"/api/events?from={before}&text=level")) == {"weir"}
    assert names(olga, olga.get(f"/api/events?from={before}&text=MILL")) == {"mill"}
    assert {each["value"] for each in olga.get(f"/api/events?from={before}&cause=spontaneous")} == {9, 1}
    assert olga.get(f"/api/events?from={before}&cause=local&text=level") == []
    assert olga.get(f"/api/events?to={before - 1}&text=level&cause=spontaneous") == []
    for wrong in ("events?cause=x", "alarms?from=0&kind=x"):
        with pytest.raises(AnswerError):
            olga.get(f"/api/{wrong}")
    _, octets = olga.raw("GET", f"/api/events?from={before}&text=level&cause=spontaneous&format=csv")
    lines = octets.decode().splitlines()
    assert len(lines) == 2 and ",weir,level,9.0," in lines[1]
    stations.say(made["weir"], 4, M_ME_TF_1, measured(now_ms(), 1))
    stations.say(made["mill"], 5, M_SP_TB_1, single(now_ms(), False))
    until(lambda: all(each["gone"] for each in olga.get("/api/alarms")), "both are gone")
    olga.post(f"/api/alarms/{state['id']}/acknowledge")


def test_rates_say_how_often_alarms_came_and_which_chatter(
    olga: Client, site: Site, stations: Stations, made: dict[str, Station]
) -> None:
    """Each time that one comes, though it is one alarm and all of it is stored at once; what is shelved does
    not come."""
    before, begun = olga.get("/api/alarms/rates"), now_ms()
    for number in range(8):
        stations.say(made["south"], 5, M_SP_TB_1, single(begun + number, number % 2 == 0))
    until(lambda: [each["returns"] for each in olga.get("/api/alarms")] == [3], "it came four times")
    until(lambda: is_on(olga, "south") is False, "it has gone")
    after = olga.get("/api/alarms/rates")
    assert after["day"] - before["day"] == 4
    assert sum(after["bars"]) == after["day"] and len(after["bars"]) == 144
    assert after["peak"] >= after["last_10_min"] and after["last_hour"] >= after["last_10_min"] >= 4
    assert names(olga, [after["top"][0]]) == {"south"} and after["top"][0]["n"] == 4
    [chatters] = after["chattering"]
    assert (chatters["kind"], chatters["n"], chatters["ca"]) == ("state", 4, 1)
    assert (after["standing"], after["unacknowledged"]) == (0, 1)
    [alarm] = olga.get("/api/alarms")
    olga.post(f"/api/alarms/{alarm['id']}/shelve", {"minutes": 5})
    stations.say(made["south"], 5, M_SP_TB_1, single(now_ms(), True))
    until(lambda: olga.get("/api/alarms")[0]["returns"] == 4, "it came once more")
    shelved = olga.get("/api/alarms/rates")
    assert (shelved["day"], shelved["shelved"], shelved["standing"]) == (after["day"], 1, 0)
    assert shelved["chattering"][0]["n"] == 5
    seen = site.client("walter").get("/api/alarms/rates")
    assert "south" in names(olga, seen["top"]) and "mill" not in names(olga, seen["top"])
    stations.say(made["south"], 5, M_SP_TB_1, single(now_ms(), False))
    olga.post(f"/api/alarms/{alarm['id']}/acknowledge")
    until(lambda: not olga.get("/api/alarms"), "it ended")
