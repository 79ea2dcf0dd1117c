# SPDX-License-Identifier: GPL-3.0-or-later
"""What others see of a station by a centre.

A city's centre: the town's is a controlled station of it, c104 is the city, a gateway's module is between. An
engineer: the frames of a connection, as tshark sees them. A service of the web: where it is.
"""

import functools
import json
import os
import re
import subprocess
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import c104
import pytest

from control_room import POINTS, Site, Stations, described, until
from lab.centre_client import AnswerError, Client
from lab.gateway import Gateway, default_build, free_port, listening_on, remove, run_directory
from lab.master import Master, Report
from lab.modules import library
from lab.vehicles import (
    M_ME_TF_1,
    M_SP_TB_1,
    M_ST_TB_1,
    POSITION,
    Station,
    measured,
    position,
    single,
    stepped,
)
from openrtu_tools.centre.apdu import CAUSES, NAMES, decode
from openrtu_tools.centre.codes import State
from openrtu_tools.centre.errors import CentreError
from openrtu_tools.centre.higher import PROGRAM, gateway
from openrtu_tools.centre.settings import load
from rig.capture import PORT, Connection, write_pcap

pytestmark = pytest.mark.slow  # a centre, a gateway and its module in Python for one use of a centre

CA, OWN_CA, ADDED, GUARDED = 500, 501, 1000, 2000
PLACE, PUMP, LAMP, LEVEL = (ADDED + ioa for ioa in range(1, 5))
LISTED = POINTS.replace("1,1,,,place", "1,1,position,,place") + "1,6,M_ST_NA_1,C_RC_NA_1,tap,,true,,,,\n"
TAP = ADDED + 6
LONGITUDE = PLACE + 1_000_000
BAD = "NonTopical+Invalid"  # and the last value that is known


class Service(ThreadingHTTPServer):
    """Of the web, which is out of order at first; it keeps what it was told."""

    def __init__(self) -> None:
        self.told: list[tuple[str | None, bytes]] = []
        super().__init__(("127.0.0.1", 0), Telling)
        threading.Thread(target=self.serve_forever, daemon=True).start()


class Telling(BaseHTTPRequestHandler):
    server: Service

    def do_POST(self) -> None:
        content = self.rfile.read(int(self.headers["Content-Length"]))
        self.server.told.append((self.headers["Authorization"], content))
        self.send_response(503 if len(self.server.told) == 1 else 204)
        self.end_headers()

    def log_message(self, *_: object) -> None:
        """Nothing."""


@dataclass
class City:
    """The higher centre, and what it sees."""

    master: Master
    gateway: Gateway
    site: Site
    service: Service

    def sees(self, ioa: int, ca: int = CA) -> Report | None:
        """As it was told last."""
        told = [each for each in self.master.reports_since(0) if (each.ca, each.ioa) == (ca, ioa)]
        return told[-1] if told else None

    def wait(self, ioa: int, value: Any, quality: str = "good", ca: int = CA) -> Report:
        def there() -> Report | None:
            report = self.sees(ioa, ca)
            same = report and report.quality == quality and report.value == pytest.approx(value, rel=1e-6)
            return report if same else None

        return until(there, f"{ioa} is {value}, {quality}: {self.gateway.log(5)}")

    def command(self, ioa: int, on: bool) -> bool:
        return self.master.command(CA, ioa, "C_SC_NA_1", c104.SingleCmd(on=on), select=ioa % ADDED == 2)

    def came_of(self, name: str) -> str:
        """What a point's command has ended with at the gateway; empty while it goes on."""
        row = next(row for row in self.gateway.query("commands") if row["name"] == name)
        return "" if row["state"] == "executing command" else str(row["result"])

    def ended_since(self, begin: float, name: str) -> str:
        """The same, of a command that began no earlier; begin: time.monotonic()."""
        row = next(row for row in self.gateway.query("commands") if row["name"] == name)
        old = row["age_s"] is None or row["age_s"] > time.monotonic() - begin
        return "" if old else self.came_of(name)


@pytest.fixture(scope="module")
def guarded(stations: Stations) -> Iterator[Station]:
    """A second person of the town releases its commands."""
    made = stations.station()
    yield made
    stations.do(made.stop())


@pytest.fixture(scope="module")
def city(
    programs: Path,
    stations: Stations,
    north: Station,
    south: Station,
    guarded: Station,
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[City]:
    folder = tmp_path_factory.mktemp("town")
    higher = {"ca": CA, "token_file": "token", "gateway": listening_on({}, free_port())}
    here = [
        described(north, folder, points=LISTED, higher={"1": ADDED}),
        described(south, folder, "south", LISTED, higher={"1": ADDED}, higher_ca=OWN_CA),
        described(guarded, folder, "guarded", LISTED, higher={"1": GUARDED}, release=True),
    ]
    stations.say(north, 1, POSITION, position(int(time.time() * 1000), 44.8125, 20.4612))
    service = Service()
    (folder / "secret").write_text("a secret\n")
    (folder / "secret").chmod(0o600)
    url = f"http://127.0.0.1:{service.server_port}/here"
    push = {"url": url, "period_s": 1, "token_file": "secret"}
    directory = run_directory()
    program = directory / "run-station"  # rtud gives a module no environment
    program.write_text(f'#!/bin/sh\nOPENRTU_LIBRARY={library(default_build())} exec {PROGRAM} "$@"\n')
    program.chmod(0o755)
    with Site(
        programs, folder, here, users=["olga", "emil"], centre={"higher": higher, "push": push}
    ) as site:
        (folder / "token").write_text(site.run("token", "olga", "--label", "the city", "--scope", "command"))
        configuration = json.loads(site.run("station"))
        for module in configuration["modules"]:
            module["program"] = str(program)
        made = Gateway(configuration, directory)
        if os.geteuid() == 0:  # this Python is where only root may be
            made.options = ["--uid-base", "0"]
        with made, Master(*made.address) as master:
            master.interrogate(CA)
            there = City(master, made, site, service)
            stations.say(guarded, 3, M_SP_TB_1, single(int(time.time() * 1000), False))
            there.wait(GUARDED + 3, False)  # it has its link
            yield there
    service.shutdown()
    service.server_close()
    remove(directory)


def test_the_city_sees_the_towns_points(city: City, stations: Stations, north: Station) -> None:
    """Value, quality and the station's time; a change and back within one scan are two events."""
    city.wait(PLACE, 44.8125)
    city.wait(LONGITUDE, 20.4612)
    at_ms = int(time.time() * 1000) - 5000
    mark = city.master.mark()
    stations.say(north, 4, M_ME_TF_1, measured(at_ms, 1.5))
    stations.say(north, 4, M_ME_TF_1, measured(at_ms + 7, 2.5))
    stations.say(north, 4, M_ME_TF_1, measured(at_ms + 9, 1.5, 0x10))
    city.wait(LEVEL, 1.5, "Blocked")
    # That nothing was told yet is an event of its own. It may come between: queues go by time, it is younger.
    told = [each for each in city.master.reports_since(mark) if "NonTopical" not in each.quality]
    events = [each for each in told if each.ioa == LEVEL and each.cause == "SPONTANEOUS"][-3:]
    assert [(each.value, each.quality) for each in events] == [(1.5, "good"), (2.5, "good"), (1.5, "Blocked")]
    times = [each.recorded_at.timestamp() * 1000 for each in events if each.recorded_at]
    assert times == pytest.approx([at_ms, at_ms + 7, at_ms + 9], abs=2)


def test_a_station_may_have_a_common_address_of_its_own(
    city: City, stations: Stations, south: Station
) -> None:
    """It is a second module of the gateway, as of more points than one can have."""
    stations.say(south, 4, M_ME_TF_1, measured(int(time.time() * 1000), 7.5))
    city.wait(LEVEL, 7.5, ca=OWN_CA)
    assert city.master.command(OWN_CA, LAMP, "C_SC_NA_1", c104.SingleCmd(on=True), select=False)
    assert south.commanded[-1] == (3, 1)


def test_a_service_is_told_where_the_vehicle_is(city: City) -> None:
    """As GPX, once more when it had not taken it, and only what is new."""
    told = city.service.told
    until(lambda: len(told) >= 2, "it is told again")
    authorization, content = told[1]
    assert authorization == "Bearer a secret"
    assert re.findall(rb'<wpt lat="([\d.]+)" lon="([\d.]+)".*<name>(\w+)</name>', content) == [
        (b"44.8125000", b"20.4612000", b"north")
    ]
    assert told[0][1] == content
    assert "it answers 503" in city.site.log()


def test_commands_go_down_to_the_station(city: City, north: Station) -> None:
    """The pump is selected there and executed; the lamp takes none, or says nothing."""
    assert city.command(PUMP, True)
    until(lambda: north.commanded[-1:] == [(2, 1)], "the pump is commanded")
    city.wait(PUMP, True)
    north.manner = "refuse"
    try:
        assert not city.command(LAMP, True)
    finally:
        north.manner = "done"
    assert {row[0] for row in city.site.rows('SELECT "user" FROM commands')} == {"olga"}


def test_regulating_steps_go_down_to_the_station(city: City, stations: Stations, north: Station) -> None:
    """Each a step there; a position is none."""
    north.tap = 62
    stations.say(north, 6, M_ST_TB_1, stepped(int(time.time() * 1000), north.tap))
    city.wait(TAP, 62)
    for step, tap in (c104.Step.HIGHER, 63), (c104.Step.LOWER, 62):
        assert city.master.command(CA, TAP, "C_RC_NA_1", c104.StepCmd(step), select=True)
        city.wait(TAP, tap)
    assert north.commanded[-2:] == [(6, 1), (6, -1)]
    city.gateway.ctl("set", "north/tap", "5", "--select", check=False)
    assert city.came_of("north/tap") == "out of range"
    city.gateway.ctl("step", "north/tap", "higher", "--select")
    assert north.commanded[-1] == (6, 1)


def asked(city: City, town: Client, ioa: int, on: bool) -> dict[str, Any]:
    """The command that waits for a second person. On a busy host one may be too old before it is there."""
    name = {2: "guarded/pump", 3: "guarded/lamp"}[ioa]

    def came(begin: float) -> dict[str, Any] | str | None:
        commands = town.get("/api/commands")
        waiting = next((each for each in commands if each["state"] == State.ACCEPTED_SELECTION), None)
        return waiting or city.ended_since(begin, name)

    while True:
        begin = time.monotonic()
        assert city.command(GUARDED + ioa, on)
        command = until(functools.partial(came, begin), "a command waits")
        if isinstance(command, dict):
            return command
        assert command == "too old"


@pytest.mark.parametrize(("ioa", "name"), [(2, "pump"), (3, "lamp")])
def test_a_second_person_of_the_town_releases(city: City, guarded: Station, ioa: int, name: str) -> None:
    """It has begun for the city, and nothing is done before; with a selection at the station, and without."""
    emil = city.site.client("emil")
    command = asked(city, emil, ioa, True)
    assert command["user"] == "olga"
    until(lambda: not city.came_of(f"guarded/{name}"), "it has begun")
    assert guarded.commanded == []
    emil.post(f"/api/commands/{command['id']}/execute")
    until(lambda: city.came_of(f"guarded/{name}") == "done", "it is done")
    assert guarded.commanded.pop() == (ioa, 1)
    city.wait(GUARDED + ioa, True)
    assert ("emil", "release") in city.site.rows('SELECT "user", action FROM audit')


def test_a_second_person_of_the_town_may_not_want_it(city: City, guarded: Station) -> None:
    emil = city.site.client("emil")
    emil.post(f"/api/commands/{asked(city, emil, 3, False)['id']}/cancel")
    until(lambda: city.came_of("guarded/lamp") == "interlock", "the city is told")
    assert guarded.commanded == []


@pytest.mark.slow
def test_what_nobody_releases_is_never_sent(city: City, guarded: Station) -> None:
    """Half a minute is the second person's."""
    emil = city.site.client("emil")
    path = f"/api/commands/{asked(city, emil, 3, False)['id']}"
    until(lambda: city.came_of("guarded/lamp") == "too old", "the city is told", 0.5)
    with pytest.raises(AnswerError) as refused:
        emil.post(f"{path}/execute")
    assert refused.value.code == "not_selected"
    assert guarded.commanded == []


def test_nothing_waits_for_a_station_that_is_away(city: City, stations: Stations, north: Station) -> None:
    city.wait(PUMP, True)
    stations.do(north.stop())
    city.wait(PUMP, True, BAD)
    before = list(north.commanded)
    assert not city.command(LAMP, True)
    stations.do(north.listen())
    city.wait(PUMP, True)
    assert north.commanded == before
    assert city.command(LAMP, True)


def test_a_centre_that_is_gone_is_seen(city: City, north: Station) -> None:
    """Its points are invalid; when it is back they are told again."""
    city.wait(PUMP, True)
    city.site.kill(city.site.centre)
    city.wait(PUMP, True, BAD)
    before = list(north.commanded)
    assert not city.command(PUMP, False)
    city.site.start_centre()
    city.wait(PUMP, True)
    assert north.commanded == before


def tshark(frames: list[dict[str, Any]], pcap: Path) -> list[list[str]]:
    """Type, cause, common address and addresses of each, by another program."""
    carried = Connection("", [(not frame["sent"], bytes.fromhex(frame["octets"])) for frame in frames])
    with pcap.open("wb") as file:
        write_pcap(file, [carried])
    fields = [f"-eiec60870_asdu.{name}" for name in ("typeid", "causetx", "addr", "ioa", "float")]
    command = ["tshark", "-r", pcap, "-d", f"tcp.port=={PORT},iec60870_104", "-T", "fields", *fields]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return [line.split("\t") for line in done.stdout.splitlines()]


def test_an_engineer_sees_the_frames(city: City, stations: Stations, north: Station, tmp_path: Path) -> None:
    """On demand, and nobody else; both directions; what tshark says of the same octets is the same."""
    emil, olga = city.site.client("emil"), city.site.client("olga")
    with pytest.raises(AnswerError, match="403"):
        olga.get("/api/stations/1/trace")
    until(lambda: emil.get("/api/stations/1/trace") == [], "it is traced")
    stations.say(north, 4, M_ME_TF_1, measured(int(time.time() * 1000), 3.25))
    stations.say(north, 1, POSITION, position(int(time.time() * 1000), -33.5, 151.25))
    olga.post("/api/stations/1/interrogate")

    def seen() -> list[dict[str, Any]] | None:
        frames = emil.get("/api/stations/1/trace")
        return frames if any(frame.get("cause") == "actterm" for frame in frames) else None

    frames = until(seen, "an interrogation has ended")
    for frame, (type_, cause, ca, ioas, floats) in zip(
        frames, tshark(frames, tmp_path / "pcap"), strict=True
    ):
        if frame["kind"] != "I":
            assert not type_
            continue
        assert NAMES[int(type_)] == frame["type"]
        assert CAUSES[int(cause)] == frame["cause"]
        assert (int(ca), ioas) == (frame["ca"], ",".join(str(ioa) for ioa, _ in frame["objects"]))
        assert not floats or frame["objects"][0][1].startswith(f"{float(floats):g}")
    told = [(frame["sent"], frame["type"], text) for frame in frames for _, text in frame.get("objects", [])]
    assert (True, "C_IC_NA_1", "20") in told
    assert any(type_ == "M_ME_TF_1" and text.startswith("3.25 20") for _, type_, text in told)
    assert any(text.startswith("-33.5000000 151.2500000 0 m fix 1, 9 satellites") for _, _, text in told)
    last = frames[-1]["number"]
    # What was received last is acknowledged some time (t2): a frame that may come meanwhile.
    later = emil.get(f"/api/stations/1/trace?after={last}")
    assert [frame["kind"] for frame in later if frame["number"] <= last or frame["kind"] == "I"] == []
    assert ("emil", "trace") in city.site.rows('SELECT "user", action FROM audit')


def test_frames_that_are_none_are_told_as_they_are() -> None:
    """Cut at every octet, of every type, with more objects than there are."""
    for type_ in range(256):
        whole = bytes([0x68, 50, 2, 0, 4, 0, type_, 127, 0x83, 0, 1, 0, *range(40)])
        for size in range(len(whole)):
            decode(whole[:size])
    assert decode(bytes.fromhex("680401000a00")).what == "5"
    assert decode(bytes.fromhex("680443000000")).what == "TESTFR act"
    two = decode(bytes.fromhex("6814000000000d82030001000100000000803f900000004080"))
    assert two.objects == [(1, "1 BL IV"), (2, "2 IV")]


def test_what_cannot_be_told_is_refused(tmp_path: Path) -> None:
    """Two points of one address, no station at all, a long name, more points than modules have."""

    def told(points: str, **keys: Any) -> Any:
        (tmp_path / "p.csv").write_text("ca,ioa,type,name\n" + points)
        station = {"name": "north", "points": "p.csv", **keys}
        content = {"stations": [station], "centre": {"higher": {"ca": 7, "token_file": "t"}}}
        (tmp_path / "c.json").write_text(json.dumps(content))
        return gateway(load(tmp_path / "c.json"))

    with pytest.raises(CentreError, match="have the address 6: "):
        told("1,1,M_SP_NA_1,a\n2,2,M_SP_NA_1,b\n", higher={"1": 5, "2": 4})
    with pytest.raises(CentreError, match="no station"):
        told("1,1,M_SP_NA_1,a\n")
    with pytest.raises(CentreError, match="longer than 39"):
        told(f"1,1,M_SP_NA_1,{'a' * 34}\n", higher={"1": 0})
    with pytest.raises(CentreError, match="1025 points have the common address 7, which takes 1024"):
        told("".join(f"1,{ioa},M_SP_NA_1,p{ioa}\n" for ioa in range(1025)), higher={"1": 0})
    configuration, left_out = told("1,1,,a\n1,2,M_SP_NA_1,b b\n", higher={"1": 0})
    assert [point["name"] for point in configuration["modules"][0]["points"]] == ["north/b-b"]
    assert left_out == ["north: a: its list says no type"]
