# SPDX-License-Identifier: GPL-3.0-or-later
"""The control centre over HTTP: values, commands, alarms, users. With a station that the tests command."""

import asyncio
import csv
import doctest
import io
import itertools
import json
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

import aiohttp
import pytest

from control_room import PASSWORD, USERS, Site, Stations, Watch, now_ms, until
from lab.centre_client import AnswerError, Client
from lab.vehicles import M_ME_TF_1, M_SP_TB_1, POSITION, Station, measured, position, single
from openrtu_tools.centre import stream
from openrtu_tools.centre.api import AUDITED, ROUTES, document
from openrtu_tools.centre.codes import Result, State
from openrtu_tools.centre.records import ENDED
from openrtu_tools.centre.stream import View

INVALID = 128
CONFIRMED = {"own_password": PASSWORD}
TOKEN = {"label": "report", "days": 1, "scope": "read", **CONFIRMED}


@pytest.fixture(scope="module", autouse=True)
def filled(site: Site, stations: Stations, north: Station, south: Station) -> None:
    """Each station has said something of each point."""
    stations.say(north, 1, POSITION, position(now_ms(), 44.8, 20.5, 117))
    for ioa in (2, 3, 5):
        stations.say(north, ioa, M_SP_TB_1, single(now_ms(), False))
    stations.say(north, 4, M_ME_TF_1, measured(now_ms(), 1.5))
    for ioa in (2, 3):
        stations.say(south, ioa, M_SP_TB_1, single(now_ms(), False))
    client = site.client("vera")
    until(lambda: all(point["at"] for point in client.get("/api/points")), "all points are known")


@pytest.fixture(scope="module")
def operator(site: Site) -> Client:
    """One session: a log-in costs the centre 50 ms of a processor."""
    return site.client("olga")


@pytest.fixture
def manner(north: Station) -> Iterator[Station]:
    yield north
    north.manner = "done"


def point(client: Client, name: str) -> dict[str, Any]:
    return next(each for each in client.get("/api/points") if each["name"] == name)


def station_id(client: Client, name: str) -> int:
    return next(int(each["id"]) for each in client.get("/api/stations") if each["name"] == name)


def link(client: Client, name: str) -> int:
    return next(int(each["link"]) for each in client.get("/api/stations") if each["name"] == name)


def value_of(client: Client, name: str) -> float:
    return float(point(client, name)["value"])


def open_alarms(client: Client, kind: str) -> list[dict[str, Any]]:
    return [alarm for alarm in client.get("/api/alarms") if alarm["kind"] == kind]


def in_state(client: Client, id_: int, *states: State) -> dict[str, Any]:
    def found() -> dict[str, Any] | None:
        command = client.get(f"/api/commands/{id_}")
        return command if command["state"] in states else None

    return until(found, f"command {id_} in {states}")


# ---- values --------------------------------------------------------------------------------------


def test_values_come_with_name_quality_and_the_stations_time(
    site: Site, stations: Stations, north: Station, operator: Client
) -> None:
    at = now_ms()
    stations.say(north, 4, M_ME_TF_1, measured(at, 2.5, INVALID))
    level = until(lambda: value_of(operator, "level") == 2.5 and point(operator, "level"), "the value")
    assert (level["quality"], level["at"], level["unit"]) == (INVALID, at, "m")
    assert until(lambda: open_alarms(operator, "quality"), "an alarm of the quality")[0]["ca"] == 1
    stations.say(north, 4, M_ME_TF_1, measured(now_ms(), 2.5))
    until(lambda: not point(operator, "level")["quality"], "good again")
    values = operator.get(f"/api/points/{level['id']}/history")
    assert [(row["value"], row["quality"]) for row in values][-2:] == [(2.5, INVALID), (2.5, 0)]


@pytest.mark.slow
def test_events_are_a_file_too_and_no_text_is_a_formula(site: Site, operator: Client) -> None:
    _, octets = operator.raw("GET", "/api/events?format=csv")
    rows = list(csv.DictReader(io.StringIO(octets.decode())))
    assert {"pump", "level"} <= {row["point"] for row in rows}


@pytest.mark.parametrize(
    "path",
    [
        "/api/points?station=x",
        "/api/points?nothing=1",
        "/api/tracks?format=pdf",
        "/api/points/99999999999999999999/history",
        "/api/events?from=9999999999999999999",
    ],
)
def test_a_wrong_question_is_refused_with_a_reason(operator: Client, path: str) -> None:
    with pytest.raises(AnswerError) as refused:
        operator.get(path)
    assert refused.value.status == 400


def test_openapi_has_every_route_and_its_body(operator: Client) -> None:
    described = operator.get("/api/openapi.json")
    assert described == document()
    assert {(method.upper(), path) for path, methods in described["paths"].items() for method in methods} == {
        (route.method, route.path) for route in ROUTES
    }


# ---- commands: each fate ----------------------------------------------------------------------


def test_select_then_execute(operator: Client, north: Station) -> None:
    pump = point(operator, "pump")
    north.commanded.clear()
    command = operator.post("/api/commands", {"point": pump["id"], "value": 1})
    in_state(operator, command["id"], State.ACCEPTED_SELECTION)
    assert not north.commanded
    operator.post(f"/api/commands/{command['id']}/execute")
    done = in_state(operator, command["id"], State.EXECUTED_COMMAND)
    assert done["result"] == Result.DONE
    assert north.commanded == [(2, 1)]
    until(lambda: value_of(operator, "pump") == 1, "what the device says now")


def test_select_then_cancel(operator: Client, north: Station) -> None:
    north.commanded.clear()
    command = operator.post("/api/commands", {"point": point(operator, "pump")["id"], "value": 0})
    in_state(operator, command["id"], State.ACCEPTED_SELECTION)
    operator.post(f"/api/commands/{command['id']}/cancel")
    in_state(operator, command["id"], State.INTERRUPTED_SELECTION)
    with pytest.raises(AnswerError) as refused:
        operator.post(f"/api/commands/{command['id']}/execute")
    assert refused.value.code == "not_selected"
    assert not north.commanded


def test_only_who_selected_executes(site: Site, operator: Client) -> None:
    command = operator.post("/api/commands", {"point": point(operator, "pump")["id"], "value": 0})
    in_state(operator, command["id"], State.ACCEPTED_SELECTION)
    other = site.client("omar")
    with pytest.raises(AnswerError) as refused:
        other.post(f"/api/commands/{command['id']}/execute")
    assert refused.value.code == "not_yours"
    with pytest.raises(AnswerError) as refused:
        other.post("/api/commands", {"point": point(operator, "pump")["id"], "value": 1})
    assert refused.value.code == "busy"
    operator.post(f"/api/commands/{command['id']}/cancel")
    in_state(operator, command["id"], State.INTERRUPTED_SELECTION)


def test_selection_is_refused(operator: Client, manner: Station) -> None:
    manner.manner = "refuse selection"
    command = operator.post("/api/commands", {"point": point(operator, "pump")["id"], "value": 1})
    assert in_state(operator, command["id"], State.REFUSED_SELECTION)["result"] == Result.EXCEPTION


def test_command_is_refused_with_the_stations_reason(operator: Client, manner: Station) -> None:
    manner.manner = "refuse"
    command = operator.post("/api/commands", {"point": point(operator, "lamp")["id"], "value": 1})
    refused = in_state(operator, command["id"], State.REFUSED_COMMAND)
    assert refused["result"] == Result.EXCEPTION
    assert refused["cause"] == 7


def test_fate_is_unknown_when_the_connection_ends(operator: Client, manner: Station) -> None:
    manner.manner = "hang up"
    command = operator.post("/api/commands", {"point": point(operator, "lamp")["id"], "value": 1})
    ended = in_state(operator, command["id"], State.REFUSED_COMMAND)
    assert ended["result"] == Result.UNKNOWN_FATE
    manner.manner = "done"
    until(lambda: link(operator, "north") == 3, "connected again")


@pytest.mark.parametrize(
    ("name", "value", "code"),
    [
        ("lamp", 2, "out_of_range"),
        ("lamp", 0.5, "out_of_range"),
        ("level", 1, "no_command"),
        ("lamp", 1e300, "out_of_range"),
    ],
)
def test_what_is_no_command_is_not_sent(
    operator: Client, north: Station, name: str, value: float, code: str
) -> None:
    north.commanded.clear()
    with pytest.raises(AnswerError) as refused:
        operator.post("/api/commands", {"point": point(operator, name)["id"], "value": value})
    assert refused.value.code == code
    assert not north.commanded


@pytest.mark.slow
def test_of_commands_at_the_same_moment_one_is_sent(site: Site, operator: Client) -> None:
    """Each of two operators wants the opposite of the other's: all but one are told that it is busy."""
    clients, pump = [operator, site.client("omar")], point(operator, "pump")["id"]
    for _ in range(5):
        gate = threading.Barrier(8)

        def post(number: int, gate: threading.Barrier = gate) -> int | str:
            gate.wait()
            try:
                body = {"point": pump, "value": number // 2 % 2}
                return int(clients[number % 2].post("/api/commands", body)["id"])
            except AnswerError as refused:
                return refused.code

        with ThreadPoolExecutor(8) as pool:
            answers = list(pool.map(post, range(8)))
        assert answers.count("busy") == 7, answers
        [(number, id_)] = [(number, each) for number, each in enumerate(answers) if isinstance(each, int)]
        in_state(operator, id_, State.ACCEPTED_SELECTION)
        clients[number % 2].post(f"/api/commands/{id_}/cancel")
        in_state(operator, id_, *ENDED)


@pytest.mark.slow
def test_nothing_waits_for_a_station_that_is_absent(
    site: Site, operator: Client, stations: Stations, north: Station
) -> None:
    north.commanded.clear()
    stations.do(north.stop())
    until(lambda: link(operator, "north") == 4, "down")
    assert open_alarms(operator, "lost")
    with pytest.raises(AnswerError) as refused:
        operator.post("/api/commands", {"point": point(operator, "lamp")["id"], "value": 1})
    assert refused.value.code == "not_up"
    stations.do(north.listen())
    until(lambda: link(operator, "north") == 3, "connected again")
    assert not north.commanded
    last = site.client("emil").get("/api/audit")
    assert any(row["action"] == "command refused" and row["user"] == "olga" for row in last)


@pytest.mark.slow
def test_second_person_releases_a_selection(site: Site, operator: Client, south: Station) -> None:
    south.commanded.clear()
    mine = point(operator, "south pump")
    command = operator.post("/api/commands", {"point": mine["id"], "value": 1})
    in_state(operator, command["id"], State.ACCEPTED_SELECTION)
    path = f"/api/commands/{command['id']}"
    with pytest.raises(AnswerError) as refused:
        operator.post(f"{path}/execute")
    assert refused.value.code == "second"
    with pytest.raises(AnswerError) as refused:
        site.client("vera").post(f"{path}/execute")
    assert refused.value.code == "role"
    assert not south.commanded
    site.client("omar").post(f"{path}/execute")
    in_state(operator, command["id"], State.EXECUTED_COMMAND)
    assert south.commanded == [(2, 1)]
    done = [(row["user"], row["action"]) for row in site.client("emil").get("/api/audit")[:9]]
    assert {("omar", "release"), ("olga", "select")} <= set(done)


@pytest.mark.slow
def test_second_person_releases_what_knows_no_selection(site: Site, operator: Client, south: Station) -> None:
    """Nothing is sent before; one that is cancelled is never sent."""
    south.commanded.clear()
    lamp = point(operator, "south lamp")["id"]
    first = operator.post("/api/commands", {"point": lamp, "value": 1})
    assert first["state"] == State.ACCEPTED_SELECTION
    cancelled = operator.post(f"/api/commands/{first['id']}/cancel")
    assert cancelled["state"] == State.INTERRUPTED_SELECTION
    second = operator.post("/api/commands", {"point": lamp, "value": 0})
    path = f"/api/commands/{second['id']}"
    other = site.client("omar")
    with pytest.raises(AnswerError):
        operator.post(f"{path}/execute")
    other.post(f"{path}/execute")
    in_state(operator, second["id"], State.EXECUTED_COMMAND)
    assert south.commanded == [(3, 0)]
    with pytest.raises(AnswerError) as refused:
        other.post(f"{path}/execute")
    assert refused.value.code == "not_selected"


@pytest.mark.slow
@pytest.mark.parametrize("change", ["removed", "disabled", "viewer", "of another group"])
@pytest.mark.parametrize("name", ["south pump", "south lamp"])
def test_nobody_releases_a_command_of_who_may_not_command_any_more(
    site: Site, south: Station, name: str, change: str
) -> None:
    """Selected at the station, or held by the centre."""
    south.commanded.clear()
    engineer = site.client("emil")
    as_before = {"name": "ina", "role": "operator", "groups": []}
    engineer.post("/api/users", {**as_before, "password": PASSWORD, **CONFIRMED})
    insider = site.client("ina")
    command = insider.post("/api/commands", {"point": point(insider, name)["id"], "value": 1})
    in_state(engineer, command["id"], State.ACCEPTED_SELECTION)
    changes: dict[str, dict[str, Any]] = {
        "disabled": {"disabled": True},
        "viewer": {"role": "viewer"},
        "of another group": {"groups": ["gas"]},
    }
    if change == "removed":
        engineer.post("/api/users/ina/remove", CONFIRMED)
    else:
        engineer.post("/api/users", {**as_before, **changes[change], **CONFIRMED})
    omar = site.client("omar")
    with pytest.raises(AnswerError) as refused:
        omar.post(f"/api/commands/{command['id']}/execute")
    assert (refused.value.status, refused.value.code) == (409, "withdrawn")
    omar.post(f"/api/commands/{command['id']}/cancel")
    in_state(engineer, command["id"], State.INTERRUPTED_SELECTION)
    assert not south.commanded
    if change != "removed":
        engineer.post("/api/users/ina/remove", CONFIRMED)


@pytest.mark.slow
def test_nobody_is_named_as_the_bus(site: Site) -> None:
    """Whose commands would be this user's."""
    with pytest.raises(AnswerError) as refused:
        site.client("emil").post(
            "/api/users", {"name": "mqtt", "role": "operator", "password": PASSWORD, **CONFIRMED}
        )
    assert refused.value.code == "name"


def test_clock_of_a_station(stations: Stations, operator: Client, south: Station) -> None:
    """An event that waited for long does not make it wrong."""
    for ahead in (-7_200_000, 0, 90_000, -500):
        stations.say(south, 4, M_ME_TF_1, measured(now_ms() + ahead, 1))

    def clock() -> int:
        return next(each["clock"] or 0 for each in operator.get("/api/stations") if each["name"] == "south")

    until(lambda: clock() > 0, "an event that is ahead")
    assert 0 <= 90_000 - clock() < 60_000  # of which the delay of a busy host is a part


@pytest.mark.slow
def test_events_that_waited_are_events_and_no_state(
    stations: Stations, operator: Client, north: Station
) -> None:
    """The station tells what waited, before the answer of the interrogation and behind it."""
    value = now_ms() % 1000 / 1024  # of no test before
    stations.say(north, 4, M_ME_TF_1, measured(now_ms(), value))
    until(lambda: value_of(operator, "level") == value, "the value")
    north.interrogations = 0
    stations.keep(north, 4, M_ME_TF_1, [measured(now_ms() - ago, 3) for ago in (60_000, 50_000)])
    level = point(operator, "level")["id"]
    until(lambda: 3 in [row["value"] for row in operator.get(f"/api/points/{level}/history")], "the events")
    assert value_of(operator, "level") == value
    waited = [north.asdu(M_ME_TF_1, 3, 4, measured(now_ms() - 40_000, 4))]
    until(lambda: north.interrogations, "the answer of the interrogation is between these events")
    stations.loop.call_soon_threadsafe(north.queue.extend, waited)
    stations.say(north, 2, M_SP_TB_1, single(now_ms(), False))
    until(lambda: north.interrogations > 1, "it is asked what is so")
    until(lambda: 4 in [row["value"] for row in operator.get(f"/api/points/{level}/history")], "the event")
    assert value_of(operator, "level") == value


@pytest.mark.slow
def test_news_of_a_station_whose_clock_is_behind(
    stations: Stations, operator: Client, south: Station, site: Site
) -> None:
    """An hour: its event looks as if it had waited, until the station is asked. An alarm says by how much."""

    def value() -> float:
        of_south = operator.get(f"/api/points?station={station_id(operator, 'south')}")
        return next((float(each["value"]) for each in of_south if each["ioa"] == 4), 0.0)

    stations.say(south, 4, M_ME_TF_1, measured(now_ms(), 40))
    until(lambda: value() == 40, "the value")
    stations.do(south.stop())
    until(lambda: link(operator, "south") == 4, "down")
    south.interrogations = 0
    stations.do(south.listen())
    until(lambda: south.interrogations, "the interrogation")
    stations.say(south, 4, M_ME_TF_1, measured(now_ms() - 3_600_000, 41))
    until(lambda: value() == 41, "the value, once it was asked for")
    [alarm] = until(
        lambda: [each for each in open_alarms(operator, "clock") if not each["gone"]], "an alarm of the clock"
    )
    assert -3700 < alarm["value"] <= -3600
    stations.say(south, 4, M_ME_TF_1, measured(now_ms() - 3_600_000, 42))
    until(lambda: value() == 42, "the next one")
    stations.say(south, 4, M_ME_TF_1, measured(now_ms(), 1))
    until(lambda: all(each["gone"] for each in open_alarms(operator, "clock")), "a clock that is right")
    for each in open_alarms(operator, "clock"):
        operator.post(f"/api/alarms/{each['id']}/acknowledge")


# ---- alarms --------------------------------------------------------------------------------------


@pytest.mark.slow
def test_alarm_is_acknowledged_once_and_ends_when_its_cause_does(
    site: Site, stations: Stations, north: Station
) -> None:
    people = [site.client("olga"), site.client("omar")]
    stations.say(north, 4, M_ME_TF_1, measured(now_ms(), 9))
    alarm = until(lambda: open_alarms(people[0], "high"), "level is too high")[0]

    def acknowledge(client: Client) -> str:
        try:
            return str(client.post(f"/api/alarms/{alarm['id']}/acknowledge")["by"])
        except AnswerError as error:
            assert error.code == "acknowledged"
            return ""

    with ThreadPoolExecutor(2) as both:
        by = sorted(both.map(acknowledge, people))
    assert by[0] == ""
    assert by[1] in ("olga", "omar")
    assert open_alarms(people[0], "high")[0]["by"] == by[1]
    stations.say(north, 4, M_ME_TF_1, measured(now_ms(), 1))
    until(lambda: not open_alarms(people[0], "high"), "it ended")


@pytest.mark.slow
def test_one_that_comes_and_goes_is_one_alarm(site: Site, stations: Stations, north: Station) -> None:
    client = site.client("olga")
    for on in (True, False, True, False):
        stations.say(north, 5, M_SP_TB_1, single(now_ms(), on))
        until(lambda on=on: value_of(client, "fire") == on, "the state")
        time.sleep(0.002)  # the time tags differ
    alarms = open_alarms(client, "state")
    assert len(alarms) == 1
    assert alarms[0]["gone"]
    assert alarms[0]["returns"] and alarms[0]["last"] > alarms[0]["since"]
    shelved = client.post(f"/api/alarms/{alarms[0]['id']}/shelve", {"minutes": 10, "why": "fire drill"})
    assert shelved["shelved"] > now_ms() and shelved["why"] == "fire drill"
    assert site.client("emil").get("/api/audit?kind=alarms")[0]["detail"].endswith("10 min: fire drill")
    client.post(f"/api/alarms/{alarms[0]['id']}/acknowledge")
    assert not open_alarms(client, "state")


@pytest.mark.slow
def test_many_alarms_are_acknowledged_in_one_step(site: Site, stations: Stations, north: Station) -> None:
    """Each is in the audit. Nothing is said of those that are gone, or are not there for the user."""
    client = site.client("olga")
    stations.say(north, 5, M_SP_TB_1, single(now_ms(), True))
    stations.say(north, 4, M_ME_TF_1, measured(now_ms(), 9))
    until(lambda: open_alarms(client, "state") and open_alarms(client, "high"), "two alarms")
    ids = [open_alarms(client, kind)[0]["id"] for kind in ("state", "high")]
    answer = client.post("/api/alarms/acknowledge", {"ids": [*ids, ids[0], 10**9]})
    assert answer == {"acknowledged": ids}
    assert {each["by"] for kind in ("state", "high") for each in open_alarms(client, kind)} == {"olga"}
    assert client.post("/api/alarms/acknowledge", {"ids": ids}) == {"acknowledged": []}
    audit = site.client("emil").get("/api/audit?kind=alarms")
    assert {row["detail"] for row in audit[:2]} == {f"alarm {ids[0]}: state", f"alarm {ids[1]}: high"}
    stations.say(north, 5, M_SP_TB_1, single(now_ms(), False))
    stations.say(north, 4, M_ME_TF_1, measured(now_ms(), 1))
    until(lambda: not open_alarms(client, "state") and not open_alarms(client, "high"), "both are gone")
    past = client.get("/api/alarms?from=0&kind=high")
    assert past[0]["id"] == ids[1] and {each["kind"] for each in past} == {"high"}
    assert client.get(f"/api/alarms?from=0&station={station_id(client, 'south')}&kind=high") == []
    with pytest.raises(AnswerError):
        client.get("/api/alarms?kind=x")


@pytest.mark.slow
def test_vehicle_in_an_area_and_out_of_one(site: Site, stations: Stations, north: Station) -> None:
    """The area of another group is none of this one's."""
    client = site.client("vera")
    stations.say(north, 1, POSITION, position(now_ms(), 10.01, 10.01))
    inside = until(lambda: open_alarms(client, "inside"), "it is on the island")
    outside = open_alarms(client, "outside")
    assert [alarm["area"] for alarm in inside + outside] == ["island", "land"]
    stations.say(north, 1, POSITION, position(now_ms(), 10.03, 10.04, fix=0))  # nobody knows where it is
    stations.say(north, 1, POSITION, position(now_ms(), 44.8, 20.5))
    until(lambda: open_alarms(client, "inside")[0]["gone"], "it has left the island")
    assert open_alarms(client, "outside")[0]["gone"]
    for alarm in inside + outside:
        site.client("olga").post(f"/api/alarms/{alarm['id']}/acknowledge")
    names = [feature["properties"]["name"] for feature in client.get("/api/areas")["features"]]
    assert names == ["island", "land", "elsewhere"]


# ---- tracks --------------------------------------------------------------------------------------


@pytest.mark.slow
def test_track_with_one_place_of_each_step(site: Site, stations: Stations, north: Station) -> None:
    """As replay asks for it. A place without a fix cuts it all the same. The places have waited."""
    client, begin = site.client("vera"), now_ms() // 10_000 * 10_000 - 3_000_000
    places = [position(begin + 1000 * i, 44 + i / 1000, 20, fix=int(i != 25)) for i in range(50)]
    stations.keep(north, 1, POSITION, places)
    path = f"/api/tracks?from={begin}&to={begin + 50_000}"

    def ways(**keys: int) -> list[list[str]]:
        answer = client.get(path + "".join(f"&{key}={value}" for key, value in keys.items()))
        return [[text[17:19] for text in each["properties"]["times"]] for each in answer["features"]]

    until(lambda: sum(map(len, ways())) == 49, "all are stored")
    assert [len(way) for way in ways()] == [25, 24]
    assert [len(way) for way in ways(step=10_000)] == [3, 3]
    _, octets = client.raw("GET", f"{path}&format=gpx&step=0")
    assert octets.count(b"<trkpt") == 49
    with pytest.raises(AnswerError):
        ways(step=10**6)


# ---- users ---------------------------------------------------------------------------------------


@pytest.mark.slow
def test_without_a_session_nothing_is_said(site: Site) -> None:
    for route in ROUTES:
        path = route.path.replace("{id}", "1").replace("{name}", "x")
        with pytest.raises(AnswerError) as refused:
            site.client().raw(route.method, path)
        assert refused.value.status == 401, route.path


@pytest.mark.slow
@pytest.mark.parametrize("user", sorted(USERS))
def test_nobody_does_what_the_role_does_not_allow(site: Site, user: str) -> None:
    client = site.client(user)
    roles = ["viewer", "operator", "engineer"]
    for route in ROUTES:
        if roles.index(route.role) > roles.index(USERS[user]):
            path = route.path.replace("{id}", "1").replace("{name}", "vera")
            with pytest.raises(AnswerError) as refused:
                client.raw(route.method, path)
            assert (refused.value.status, refused.value.code) == (403, "role"), route.path


@pytest.fixture
def stranger(site: Site) -> Iterator[Client]:
    """An operator of the stations of another group."""
    engineer = site.client("emil")
    gas = {"name": "gary", "role": "operator", "password": PASSWORD, "groups": ["gas", "heat"]}
    engineer.post("/api/users", {**gas, **CONFIRMED})
    assert (
        next(each for each in engineer.get("/api/users") if each["name"] == "gary")["groups"] == gas["groups"]
    )
    yield site.client("gary")
    engineer.post("/api/users/gary/remove", CONFIRMED)


@pytest.mark.slow
def test_second_person_of_another_group_releases_nothing(
    operator: Client, stranger: Client, south: Station
) -> None:
    south.commanded.clear()
    command = operator.post("/api/commands", {"point": point(operator, "south pump")["id"], "value": 1})
    in_state(operator, command["id"], State.ACCEPTED_SELECTION)
    for deed in ("execute", "cancel"):
        with pytest.raises(AnswerError) as refused:
            stranger.post(f"/api/commands/{command['id']}/{deed}")
        assert refused.value.code == "unknown"
    assert not south.commanded
    operator.post(f"/api/commands/{command['id']}/cancel")


@pytest.mark.slow
def test_station_of_another_group_is_not_there(
    site: Site, stranger: Client, stations: Stations, north: Station
) -> None:
    stations.say(north, 4, M_ME_TF_1, measured(now_ms(), 9))
    operator = site.client("olga")
    alarm = until(lambda: open_alarms(operator, "high"), "level is too high")[0]
    pump = point(operator, "pump")
    command = operator.post("/api/commands", {"point": point(operator, "lamp")["id"], "value": 1})["id"]
    in_state(operator, command, State.EXECUTED_COMMAND)
    for path in ("stations", "points", "events", "events?from=0", "alarms", "alarms?from=0", "commands"):
        assert stranger.get(f"/api/{path}") == [], path
        assert operator.get(f"/api/{path}") != [], path
    for path in ("positions", "tracks?from=0"):
        assert stranger.get(f"/api/{path}")["features"] == []
        assert operator.get(f"/api/{path}")["features"] != []
    assert len(stranger.raw("GET", "/api/events?from=0&format=csv")[1].splitlines()) == 1
    assert [each["properties"]["name"] for each in stranger.get("/api/areas")["features"]] == [
        "island", "land", "elsewhere",
    ]  # fmt: skip
    asks = [
        ("GET", f"points/{pump['id']}/history"),
        ("GET", f"tracks?point={point(operator, 'place')['id']}"),
        ("GET", f"commands/{command}"),
        ("POST", f"stations/{pump['station']}/interrogate"),
        ("POST", f"commands/{command}/execute"),
        ("POST", f"alarms/{alarm['id']}/acknowledge"),
    ]
    for method, path in asks:
        with pytest.raises(AnswerError) as refused:
            stranger.raw(method, f"/api/{path}")
        assert refused.value.status in (404, 409), path
    with pytest.raises(AnswerError) as refused:
        stranger.post(f"/api/alarms/{alarm['id']}/shelve", {"minutes": 1})
    assert refused.value.code == "gone"
    with pytest.raises(AnswerError) as refused:
        stranger.post("/api/commands", {"point": pump["id"], "value": 1})
    assert refused.value.code == "unknown"
    assert told(stranger, site.port, "stations") == {
        "stations": [],
        "points": [],
        "alarms": [],
        "commands": [],
    }
    assert told(operator, site.port, "stations")["stations"] != []
    stations.say(north, 4, M_ME_TF_1, measured(now_ms(), 1))
    operator.post(f"/api/alarms/{alarm['id']}/acknowledge")


def told(client: Client, port: int, view: str) -> dict[str, list[Any]]:
    """What a page is told at first."""

    async def listen() -> dict[str, Any]:
        async with (
            aiohttp.ClientSession(headers=client.headers) as session,
            session.ws_connect(f"http://127.0.0.1:{port}/api/stream") as socket,
        ):
            await socket.send_json({"view": view})
            return dict(await socket.receive_json())

    message = asyncio.run(listen())
    return {kind: message[kind] for kind in ("stations", "points", "alarms", "commands")}


@pytest.mark.slow
def test_page_is_told_what_its_view_shows_and_only_what_changes(
    site: Site, stations: Stations, north: Station
) -> None:
    def go(latitude: float, longitude: float) -> None:
        stations.say(north, 1, POSITION, position(now_ms(), latitude, longitude, 117))

    def told_of(page: Watch, begin: int, kind: str = "points") -> list[Any]:
        return [each for message in page.messages[begin:] for each in message[kind]]

    client = site.client("vera")
    go(44.8, 20.5)
    place = point(client, "place")["id"]
    until(lambda: point(client, "place")["latitude"] == 44.8, "it is there")
    here, there = [44, 20, 45, 21], [9, 9, 11, 11]
    with Watch(stations, client, {"view": "map", "bounds": here}) as page:
        first = page.messages[0]
        assert [(each["id"], each["name"]) for each in first["points"]] == [(place, "place")]
        assert first["vehicles"] == 1
        assert first["extent"] == [44.8, 20.5, 44.8, 20.5]
        assert [each["name"] for each in first["stations"]] == ["north"]
        for step in range(1, 30):  # more often than a page is told
            go(44.8 + step / 1000, 20.5)
            time.sleep(0.05)
        until(lambda: told_of(page, 1) and told_of(page, 1)[-1]["latitude"] == 44.829, "it moves")
        assert not any("name" in each for each in told_of(page, 1))
        moments = [message["now"] for message in page.messages]
        assert all(b - a > 900 for a, b in itertools.pairwise(moments)), moments
        begin = len(page.messages)
        go(10, 10)
        until(lambda: told_of(page, begin, "gone") == [place], "it has left the view")
        begin = len(page.messages)
        stations.say(north, 4, M_ME_TF_1, measured(now_ms(), 1.25))  # no view of a map shows it
        go(10.5, 10)
        until(lambda: point(client, "place")["latitude"] == 10.5, "it moves elsewhere")
        page.look({"view": "map", "bounds": there})
        assert [each["name"] for each in until(lambda: told_of(page, begin), "the other part")] == ["place"]
        begin = len(page.messages)
        page.look({"view": "map", "bounds": here})
        until(lambda: told_of(page, begin, "gone") == [place], "back again")
        page.look({"view": "map", "bounds": here, "search": "NOR"})
        assert until(lambda: told_of(page, begin), "searched everywhere")[0]["latitude"] == 10.5
    for wrong in ({"view": "map", "bounds": [1, 2, 3]}, {"view": "map", "bounds": "all"}, [], {"view": "x"}):
        with pytest.raises(ValueError, match=r"view|bounds"):
            View.read(wrong)
    assert doctest.testmod(stream).failed == 0


@pytest.mark.slow
def test_who_manages_users_sees_all(site: Site) -> None:
    scoped = {"name": "eva", "role": "engineer", "password": PASSWORD, "groups": ["gas"], **CONFIRMED}
    with pytest.raises(AnswerError) as refused:
        site.client("emil").post("/api/users", scoped)
    assert refused.value.code == "groups"


def test_another_sites_page_cannot_use_a_cookie(site: Site, operator: Client) -> None:
    lamp = point(operator, "lamp")["id"]
    forged = site.client()
    forged.headers = {"Cookie": operator.headers["Cookie"]}
    for token in ({}, {"X-CSRF-Token": "guessed"}):
        with pytest.raises(AnswerError) as refused:
            forged.raw("POST", "/api/commands", {"point": lamp, "value": 1}, **token)
        assert refused.value.code == "csrf"
    upgrade = {
        "Upgrade": "websocket",
        "Connection": "Upgrade",
        "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Key": "eA==",
    }
    with pytest.raises(AnswerError) as refused:
        forged.raw("GET", "/api/stream", Origin="https://elsewhere.example", **upgrade)
    assert refused.value.code == "origin"
    with pytest.raises(AnswerError) as refused:
        forged.raw(
            "POST", "/api/login", {"name": "olga", "password": "x"}, Origin="https://elsewhere.example"
        )
    assert refused.value.code == "origin"


def test_cookie_is_for_this_site_and_no_script(site: Site) -> None:
    response, _ = site.client().raw(
        "POST", "/api/login", {"name": "vera", "password": "correct horse battery"}
    )
    cookie = response.getheader("Set-Cookie") or ""
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    assert "script-src" not in (response.getheader("Content-Security-Policy") or "")
    assert "default-src 'self'" in (response.getheader("Content-Security-Policy") or "")


def test_logout_ends_a_session_for_good(site: Site) -> None:
    client = site.client("vera")
    client.post("/api/logout")
    with pytest.raises(AnswerError) as refused:
        client.get("/api/me")
    assert refused.value.status == 401


@pytest.mark.slow
def test_page_that_watches_is_told_nothing_after_its_session(
    site: Site, stations: Stations, north: Station
) -> None:
    client = site.client("vera")
    before = {"view": "points", "station": point(client, "level")["station"]}
    with Watch(stations, client, before) as page:
        client.post("/api/logout")
        stations.say(north, 4, M_ME_TF_1, measured(now_ms(), 2.875))
        until(page.listening.done, "it is closed")
        assert page.socket
        assert page.socket.close_code == 4401
        told = [each["value"] for message in page.messages for each in message["points"]]
    assert 2.875 not in told


@pytest.mark.slow
def test_token_is_worth_no_more_than_its_user(site: Site) -> None:
    """Another role, an end, and another user of the same name: each ends it."""
    engineer = site.client("emil")
    user = {"name": "tina", "role": "operator", "password": PASSWORD, **CONFIRMED}

    def token() -> Client:
        made = site.client().login("tina", PASSWORD).post("/api/tokens", TOKEN)
        return Client(site.port, made["token"])

    def ended(client: Client) -> bool:
        with pytest.raises(AnswerError) as refused:
            client.get("/api/me")
        return refused.value.status == 401

    engineer.post("/api/users", user)
    first = token()
    with pytest.raises(AnswerError) as refused:
        first.post("/api/users", user | {"role": "engineer"})
    assert refused.value.code == "role"
    engineer.post("/api/users", user | {"role": "viewer"})
    assert ended(first)
    second = token()
    engineer.post("/api/users/tina/remove", CONFIRMED)
    assert ended(second)
    engineer.post("/api/users", user)
    assert ended(second)
    engineer.post("/api/users/tina/remove", CONFIRMED)


@pytest.mark.slow
def test_token_of_yesterday(site: Site) -> None:
    vera = site.client("vera")
    token = vera.post("/api/tokens", TOKEN)["token"]
    assert Client(site.port, token).get("/api/me")["user"] == "vera"
    short = vera.post("/api/tokens", {**TOKEN, "days": 0.000001})["token"]
    with pytest.raises(AnswerError) as refused:
        Client(site.port, short).get("/api/me")
    assert refused.value.status == 401
    forged = site.client()
    forged.headers = {"Cookie": f"openrtu_session={token}"}  # a token is no cookie
    with pytest.raises(AnswerError):
        forged.get("/api/me")


@pytest.mark.slow
def test_passwords_cannot_be_guessed_fast(site: Site) -> None:
    codes = set()
    for _ in range(7):
        with pytest.raises(AnswerError) as refused:
            site.client().raw("POST", "/api/login", {"name": "nobody", "password": "x" * 12})
        codes.add(refused.value.code)
    assert codes == {"password", "guesses"}


@pytest.mark.slow
def test_new_password_ends_all_sessions_of_a_user(site: Site) -> None:
    engineer = site.client("emil")
    nina = {"name": "nina", "role": "operator", **CONFIRMED}
    engineer.post("/api/users", {**nina, "password": "a long password"})
    before = site.client().login("nina", "a long password")
    engineer.post("/api/users", {**nina, "password": "another password"})
    with pytest.raises(AnswerError):
        before.get("/api/me")
    engineer.post("/api/users/nina/remove", CONFIRMED)
    with pytest.raises(AnswerError):
        site.client().login("nina", "another password")


@pytest.mark.slow
def test_user_who_is_disabled_keeps_the_password_and_may_nothing(site: Site) -> None:
    """A session and a token end with it."""
    engineer = site.client("emil")
    dora = {"name": "dora", "role": "viewer", **CONFIRMED}
    with pytest.raises(AnswerError) as refused:
        engineer.post("/api/users", dora)
    assert refused.value.code == "password"
    engineer.post("/api/users", {**dora, "password": PASSWORD})
    client = site.client("dora")
    token = client.post("/api/tokens", TOKEN)["token"]
    engineer.post("/api/users", {**dora, "disabled": True})
    for each in (client, Client(site.port, token)):
        with pytest.raises(AnswerError) as refused:
            each.get("/api/me")
        assert refused.value.status == 401
    with pytest.raises(AnswerError) as refused:
        site.client("dora")
    assert refused.value.code == "password"
    engineer.post("/api/users", {**dora, "role": "operator"})
    assert site.client("dora").get("/api/me")["role"] == "operator"
    engineer.post("/api/users/dora/remove", CONFIRMED)


@pytest.mark.slow
def test_users_are_changed_only_with_ones_own_password(site: Site) -> None:
    """Who has found a session open makes nobody an engineer. There is always one."""
    engineer = site.client("emil")
    vera = {"name": "vera", "role": "engineer"}
    for path in ("/api/users", "/api/users/vera/remove"):
        body = vera if path == "/api/users" else {}
        for own, code in ({}, "form"), ({"own_password": "guessed password"}, "own_password"):
            with pytest.raises(AnswerError) as refused:
                engineer.post(path, {**body, **own})
            assert refused.value.code == code
    for role, disabled in (("viewer", False), ("engineer", True)):
        with pytest.raises(AnswerError) as refused:
            body = {"name": "emil", "role": role, "disabled": disabled}
            engineer.post("/api/users", {**body, **CONFIRMED})
        assert refused.value.code == "yourself"
    with pytest.raises(AnswerError) as refused:
        engineer.post("/api/users/emil/remove", CONFIRMED)
    assert refused.value.code == "yourself"
    roles = {each["name"]: (each["role"], each["disabled"]) for each in engineer.get("/api/users")}
    assert (roles["vera"], roles["emil"]) == (("viewer", False), ("engineer", False))


@pytest.mark.slow
def test_audit_says_who_did_what_to_which_station(site: Site, operator: Client) -> None:
    """By user, station, kind and time; as a file, too, which is in it from then on."""
    engineer = site.client("emil")
    north = next(each["id"] for each in operator.get("/api/stations") if each["name"] == "north")
    begin = now_ms()
    command = operator.post("/api/commands", {"point": point(operator, "lamp")["id"], "value": 1})["id"]
    in_state(operator, command, State.EXECUTED_COMMAND)
    site.client("omar").post(f"/api/stations/{north}/interrogate")

    def done(**asked: Any) -> list[tuple[str, str, int]]:
        query = urlencode({"from": begin, **asked})
        return [(row["user"], row["action"], row["station"]) for row in engineer.get(f"/api/audit?{query}")]

    commanded, interrogated = ("olga", "command", north), ("omar", "interrogate", north)
    assert {commanded, interrogated, ("omar", "login", None)} <= set(done())
    assert done(kind="commands") == [commanded]
    assert done(user="olga", station=north) == [commanded]
    assert done(station=north) == [interrogated, commanded]
    assert done(user="nobody' OR 1") == done(station=99) == done(to=begin - 1) == []
    with pytest.raises(AnswerError) as refused:
        done(kind="secrets")
    assert refused.value.status == 400
    _, octets = engineer.raw("GET", f"/api/audit?format=csv&station={north}&from={begin}")
    rows = list(csv.DictReader(io.StringIO(octets.decode())))
    assert [(row["user"], row["action"], row["station"], row["detail"]) for row in rows] == [
        ("olga", "command", "north", "lamp = 1"), ("omar", "interrogate", "north", ""),
    ]  # fmt: skip
    assert done(kind="exports") == [("emil", "export", None)]
    actions = {action for (action,) in site.rows("SELECT DISTINCT action FROM audit")}
    assert actions <= {action for kind in AUDITED.values() for action in kind}


@pytest.mark.slow
@pytest.mark.parametrize("path", ["/../centre/api.py", "/%2e%2e/%2e%2e/README.md", "//etc/passwd"])
def test_no_file_but_the_page(site: Site, path: str) -> None:
    with pytest.raises(AnswerError) as refused:
        site.client().raw("GET", path)
    assert refused.value.status in (403, 404)


@pytest.mark.slow
def test_what_the_command_line_is_told_wrong(site: Site, tmp_path: Path) -> None:
    file = tmp_path / "wrong.json"
    file.write_text(json.dumps({"stations": [{"name": "a", "address": "::1", "location": [95, 0]}]}))
    site.file, file = file, site.file
    try:
        with pytest.raises(AssertionError, match=r"stations\.0\.location\.0: 95 is greater than"):
            site.run("collector")
    finally:
        site.file = file
