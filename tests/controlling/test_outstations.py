# SPDX-License-Identifier: GPL-3.0-or-later
"""rtu-104m: other stations of IEC 60870-5-104 as a southbound of the gateway."""

import contextlib
import datetime
import json
import re
import struct
import subprocess
import time
from collections.abc import Callable, Iterator
from itertools import chain, repeat
from pathlib import Path
from typing import Any

import c104
import pytest

from lab import modules
from lab.gateway import Gateway, free_port, listening_on, remove, run_directory
from lab.master import Master
from lab.raw_master import RawMaster
from peers.hangs_up import hangs_up
from peers.outstation import (
    ACT_CON,
    CLOCK,
    COUNTERS,
    INTERROGATED,
    INTERROGATION,
    LIMIT_S,
    NEGATIVE,
    Asked,
    Outstation,
    asdu,
    time56,
)
from rig.outstation import CA, NAMES, THERE, outstation, points

PAGE = Path(__file__).resolve().parents[2] / "docs/concentrator.md"
C_RD = 102
WIRE = [1, 3, 5, 7, 9, 11, 13, 15]
GOOD = {
    1: (1, b"\x01"),
    3: (2, b"\x02"),
    5: (3, b"\x05\x00"),
    7: (4, b"\x0f\x00\x00\x80\x00"),
    9: (5, b"\x00\x40\x00"),
    11: (6, b"\xf9\xff\x00"),
    13: (7, b"\x00\x00\x20\x40\x00"),
    15: (8, b"\x2a\x00\x00\x00\x03"),
}
VALUES = {
    "breaker": "on",
    "position": "on",
    "tap": 5,
    "bits": 0x8000000F,
    "share": 0.5,
    "level": -7,
    "power": 2.5,
    "energy": 42,
}


def config(*outstations: dict[str, Any]) -> dict[str, Any]:
    return listening_on({"port": [], "outstations": list(outstations)}, free_port())


Run = Callable[..., Gateway]


@pytest.fixture
def gateway(programs: Path) -> Iterator[Run]:
    with contextlib.ExitStack() as ends:

        def start(*outstations: dict[str, Any]) -> Gateway:
            directory = run_directory()
            ends.callback(remove, directory)
            return ends.enter_context(Gateway(config(*outstations), directory, programs))

        yield start


@pytest.fixture
def town() -> Iterator[Outstation]:
    with Outstation() as made:
        made.interrogated = [asdu(kind, INTERROGATED, THERE, GOOD[kind]) for kind in WIRE[:-1]]
        yield made


def wait_quality(gateway: Gateway, name: str, quality: str) -> dict[str, Any]:
    gateway.wait_for(lambda: gateway.points(name)[name]["quality"] == quality, 60.0, f"{name} is {quality}")
    return gateway.points(name)[name]


def wait_value(gateway: Gateway, name: str, value: object) -> dict[str, Any]:
    gateway.wait_for(lambda: gateway.points(name)[name]["value"] == value, 60.0, f"{name} is {value}")
    return gateway.points(name)[name]


def counters(gateway: Gateway) -> dict[str, int]:
    return {row["counter"]: row["value"] for row in gateway.query("counters", "rtu-104m")}


def commanded(gateway: Gateway, *arguments: str) -> dict[str, Any]:
    """What `rtuctl set` says in the end."""
    return json.loads(gateway.ctl("--json", *arguments, check=False))  # type: ignore[no-any-return]


class Commanding:
    """`rtuctl set`, while something happens."""

    def __init__(self, gateway: Gateway, *arguments: str) -> None:
        command = [gateway.build / "rtuctl" / "rtuctl", "--map", gateway.map, "--json", *arguments]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)

    def end(self) -> dict[str, Any]:
        out, _ = self.process.communicate(timeout=LIMIT_S)
        return json.loads(out)  # type: ignore[no-any-return]


# ---- values -------------------------------------------------------------------------------------


def test_every_type_reaches_the_control_centre(gateway: Run, town: Outstation) -> None:
    one = gateway(outstation(town.port, counters_s=3600))
    wait_quality(one, "power", "good")
    town.wait(lambda: any(asked.type == COUNTERS for asked in town.asked), "counters are interrogated")
    town.say(15, THERE, GOOD[15], cause=37)
    wait_quality(one, "energy", "good")
    assert {name: one.points(name)[name]["value"] for name in NAMES} == VALUES
    with Master(*one.address) as master:
        reports = {report.ioa: report for report in master.interrogate(CA)}
        assert {ioa: report.value for ioa, report in reports.items()} == {
            101: True,
            102: "ON",
            103: 5,
            104: 0x8000000F,
            105: pytest.approx(0.5),
            106: -7,
            107: 2.5,
        }
        assert all(report.good for report in reports.values())
        (total,) = master.interrogate_counters(CA)
        assert (total.ioa, total.value) == (108, 42)


def test_quality_of_the_wire(gateway: Run, town: Outstation) -> None:
    one = gateway(outstation(town.port))
    wait_quality(one, "power", "good")
    for octet, quality in [
        (0x80, "invalid"),
        (0x40, "not topical"),
        (0x20, "substituted"),
        (0x10, "blocked"),
    ]:
        town.say(1, THERE, (1, bytes((octet,))))
        wait_quality(one, "breaker", quality)
    town.say(13, THERE, (7, b"\x00\x00\x20\x40\x01"))
    wait_quality(one, "power", "overflow")


def test_protection_and_packed_singles(gateway: Run, town: Outstation) -> None:
    one = gateway(outstation(town.port))
    wait_quality(one, "power", "good")
    at = time56(datetime.datetime.now(datetime.UTC))
    for kind, address, element, name, value in [
        (38, 2, b"\x01\x00\x01" + at, "position", "off"),
        (39, 4, b"\x03\x00\x00\x01" + at, "bits", 3),
        (40, 4, b"\x05\x00\x00\x01" + at, "bits", 5),
        (20, 4, b"\x01\x00\x00\x80\x00", "bits", 0x80000001),
    ]:
        town.say(kind, THERE, (address, element))
        wait_value(one, name, value)


@pytest.mark.slow
def test_events_have_the_outstations_time(gateway: Run, town: Outstation) -> None:
    """Also one that it kept from before this machine's start; one that is to come, or invalid, is of now."""
    one = gateway(outstation(town.port))
    wait_quality(one, "power", "good")
    now = datetime.datetime.now(datetime.UTC)
    past = now - datetime.timedelta(days=30)
    with Master(*one.address) as master:
        mark = master.mark()
        for tag in [
            time56(past),
            time56(now - datetime.timedelta(seconds=90)),
            time56(now + datetime.timedelta(hours=2)),
            time56(past, 0x80),
        ]:
            town.say(30, THERE, (1, b"\x01" + tag))
        town.say(36, THERE, (7, b"\x00\x00\x40\x40\x00" + time56(now)))
        master.wait(lambda r: r.ioa == 107, since=mark, what="the last event")
        seen = [r.recorded_at for r in master.reports_since(mark) if r.ioa == 101]
    assert len(seen) == 4
    oldest, older, coming, invalid = sorted(time for time in seen if time)
    ms = datetime.timedelta(milliseconds=2)
    assert abs(oldest - past) < ms
    assert abs(older - (now - datetime.timedelta(seconds=90))) < ms
    minute = datetime.timedelta(minutes=1)
    assert abs(coming - now) < minute
    assert abs(invalid - now) < minute
    assert counters(one)["town.untimely"] == 1


def before(seconds: float) -> bytes:
    return time56(datetime.datetime.now(datetime.UTC) - datetime.timedelta(seconds=seconds))


def scaled(value: int) -> bytes:
    return struct.pack("<hB", value, 0)


@pytest.mark.slow
def test_what_was_before_an_interrogation_is_an_event_and_no_state(gateway: Run, town: Outstation) -> None:
    """A station answers the interrogation, then tells what it had kept, as lib60870's do. It is asked again,
    and whoever keeps the last event has the state in the end."""
    one = gateway(outstation(town.port))
    wait_value(one, "level", -7)
    with Master(*one.address) as master:
        mark = master.mark()
        town.say(35, THERE, (6, scaled(50) + before(60)))
        old = master.wait(lambda r: r.ioa == 106, since=mark, what="the old event")
        assert (old.value, old.good) == (50, True)
        assert old.recorded_at is not None
        age = datetime.datetime.now(datetime.UTC) - old.recorded_at
        assert age > datetime.timedelta(seconds=59)
        assert one.points("level")["level"]["value"] == -7
        mark = master.mark()
        master.interrogate(CA)
        assert next(r.value for r in master.reports_since(mark) if r.ioa == 106) == -7
        mark = master.mark()
        state = master.wait(lambda r: r.ioa == 106, since=mark, what="the state again")
        assert state.value == -7
    assert counters(one)["town.past"] == 1
    rows = [json.loads(line) for line in one.ctl("--json", "events").splitlines()]
    assert [row["value"] for row in rows if row.get("past")] == [50]
    assert " past\n" in one.ctl("events")
    assert one.log().count("tells events of before its last interrogation") == 1


LISTENS = """
from openrtu import Module

with Module() as module:
    module.log("it listens")
    for _ in module.scans():
        for event in module.events():
            module.log(f"{event.name} {event.sample.value:g} {'past' if event.past else 'present'}")
"""


@pytest.mark.slow
def test_module_of_others_is_told_what_is_past(programs: Path, town: Outstation) -> None:
    directory = run_directory()
    modules.place(directory, programs)
    (directory / "script.py").write_text(LISTENS)
    listener = {"name": "listens", "program": modules.program(directory, "listens", directory / "script.py")}
    listener |= {"period_ms": 20, "reads": ["level"]}
    try:
        with Gateway(config(outstation(town.port)) | {"modules": [listener]}, directory, programs) as one:
            wait_value(one, "level", -7)
            one.wait_for(lambda: "it listens" in one.log(), 30.0, "it listens")
            town.say(35, THERE, (6, scaled(50) + before(60)))
            one.wait_for(lambda: "level 50 past" in one.log(), 30.0, "the old event is told so")
    finally:
        remove(directory)


@pytest.mark.slow
def test_station_with_a_slow_clock_is_believed_by_interrogations(gateway: Run, town: Outstation) -> None:
    one = gateway(outstation(town.port))
    wait_value(one, "level", -7)
    town.interrogated[5] = asdu(11, INTERROGATED, THERE, (6, scaled(50)))
    town.say(35, THERE, (6, scaled(50) + before(60)))
    wait_value(one, "level", 50)


@pytest.mark.slow
def test_events_among_themselves_are_in_the_order_of_their_tags(gateway: Run, town: Outstation) -> None:
    """One without a tag is of now; what was asked for is the state, whatever its tag."""
    one = gateway(outstation(town.port))
    wait_value(one, "level", -7)
    for seconds, value in ((0.0, 1), (5.0, 2), (3.0, 3)):
        town.say(35, THERE, (6, scaled(value) + before(seconds)))
    town.say(11, THERE, (6, scaled(4)))
    town.say(35, THERE, (6, scaled(5) + before(2)))
    town.say(36, THERE, (7, struct.pack("<fB", 9.0, 0) + before(0)))
    wait_value(one, "power", 9.0)
    assert one.points("level")["level"]["value"] == 4
    town.say(35, THERE, (6, scaled(6) + before(300)), cause=5)
    wait_value(one, "level", 6)


@pytest.mark.slow
def test_place_of_before_is_an_event_and_no_state(gateway: Run, town: Outstation) -> None:
    van = outstation(town.port)
    van["sets"][0]["points"].append({"name": "van", "type": "position", "ioa": 200, "remote_ioa": 9})
    one = gateway(van)
    wait_quality(one, "power", "good")
    town.say(201, THERE, (9, place(448125000, 204612000, 1372)))
    wait_value(one, "van.latitude", 44.8125)
    with RawMaster(*one.address) as master:
        master.request(C_RD, 9999, 1, b"")
        town.say(201, THERE, (9, place(10000000, 20000000, 5)[:-7] + before(60)))
        told = master.answer(201)
        assert int.from_bytes(told.body[3:7], "little") == 10000000
    assert one.points("van.latitude")["van.latitude"]["value"] == 44.8125
    assert counters(one)["town.past"] == 1


@pytest.mark.slow
def test_several_events_of_one_point_in_one_asdu(gateway: Run, town: Outstation) -> None:
    one = gateway(outstation(town.port))
    wait_quality(one, "power", "good")
    with Master(*one.address) as master:
        mark = master.mark()
        at = time56(datetime.datetime.now(datetime.UTC))
        town.say(30, THERE, *((1, bytes((number % 2,)) + at) for number in range(6)))
        town.say(36, THERE, (7, b"\x00\x00\x40\x40\x00" + at))
        master.wait(lambda r: r.ioa == 107, since=mark, what="the last event")
        seen = [r.value for r in master.reports_since(mark) if r.ioa == 101]
    assert seen == [False, True] * 3


def place(latitude: int, longitude: int, altitude_dm: int, quality: int = 0, satellites: int = 9) -> bytes:
    """The element of type 201: docs/positioning.md."""
    where = struct.pack("<ii", latitude, longitude) + altitude_dm.to_bytes(3, "little", signed=True)
    return where + bytes((1 | satellites << 4, quality)) + time56(datetime.datetime.now(datetime.UTC))


@pytest.mark.slow
def test_position_is_one_event_of_four_points(gateway: Run, town: Outstation) -> None:
    """And goes on as what it came as, also when it is invalid; an unknown altitude is invalid."""
    van = outstation(town.port)
    van["sets"][0]["points"].append(
        {"name": "van", "type": "position", "ioa": 200, "remote_ioa": 9, "group": 1}
    )
    one = gateway(van)
    wait_quality(one, "power", "good")
    assert one.points("van.latitude")["van.latitude"]["quality"] == "invalid"
    with RawMaster(*one.address) as master:
        first, second = place(448125000, 204612000, 1372), place(448126055, -204611750, -8388608, quality=1)
        for sent in (first, second):
            master.request(C_RD, 9999, 1, b"")  # what came before is not looked at
            town.say(201, THERE, (9, sent))
            told = master.answer(201)
            assert (told.cause, told.ca, told.body[:16]) == (3, CA, b"\xc8\0\0" + sent[:13])
        points = one.points("van.*")
        assert {name: point["quality"] for name, point in points.items()} == {
            "van.position": "good",
            "van.latitude": "good",
            "van.longitude": "good",
            "van.altitude": "invalid",
        }
        assert [points[f"van.{name}"]["value"] for name in ("latitude", "longitude")] == [
            44.8126055,
            -20.461175,
        ]
        # Without a fix, some stations say 0 degrees, and an altitude.
        master.request(C_RD, 9999, 1, b"")
        town.say(201, THERE, (9, place(0, 0, 0, quality=0x80)))
        told = master.answer(201)
        assert told.body[:16] == b"\xc8\0\0" + second[:12] + b"\x81"
        town.say(201, THERE, (9, second))
        assert master.answer(201).body[:16] == b"\xc8\0\0" + second[:13]
        town.die()
        told = master.answer(201)
        assert told.body[:16] == b"\xc8\0\0" + second[:12] + b"\x81"  # invalid; its altitude is still unknown


@pytest.mark.slow
def test_object_is_read_in_its_period(gateway: Run, town: Outstation) -> None:
    """And what was read is the point's value; an interrogation alone has the rest."""
    values = chain(range(5), repeat(5))  # whoever looks late sees the last, too

    def answer(asked: Asked, octets: bytes) -> list[bytes]:
        if asked.type != C_RD:
            return town.usual(asked, octets)
        return [asdu(11, asked.cause, THERE, (asked.ioa, bytes((next(values), 0, 0))))]

    town.answer = answer
    read = outstation(town.port)
    level = read["sets"][0]["points"][NAMES.index("level")]
    level |= {"read_ms": 100}
    one = gateway(read)
    wait_value(one, "level", 5)
    reads = [asked for asked in town.asked if asked.type == C_RD]
    assert {(asked.ca, asked.ioa, asked.cause) for asked in reads} == {(THERE, 6, 5)}
    assert one.points("power")["power"]["value"] == 2.5


@pytest.mark.slow
def test_position_that_is_no_news_is_no_event(gateway: Run, town: Outstation) -> None:
    van = outstation(town.port, interrogation_s=1)
    van["sets"][0]["points"].append({"name": "van", "type": "position", "ioa": 200, "remote_ioa": 9})
    town.interrogated.append(asdu(201, INTERROGATED, THERE, (9, place(448125000, 204612000, 1372))))
    one = gateway(van)
    wait_quality(one, "van.latitude", "good")
    before = counters(one)["town.objects"]
    town.say(201, THERE, (6, place(1, 1, 0)), (77, place(1, 1, 0)))
    one.wait_for(lambda: counters(one)["town.objects"] >= before + 20, 60.0, "it is interrogated again")
    assert one.ctl("--json", "events").count('"van.') == 4
    assert (counters(one)["town.mistyped"], counters(one)["town.unmapped"]) == (1, 1)


@pytest.mark.slow
def test_what_is_no_point_is_counted(gateway: Run, town: Outstation) -> None:
    one = gateway(outstation(town.port))
    wait_quality(one, "power", "good")
    town.say(1, THERE, (999, b"\x01"))  # no such object
    town.say(1, THERE + 1, (1, b"\x01"))  # nor common address
    town.say(13, THERE, (1, b"\x00\x00\x20\x40\x00"))  # a float, where a single point is
    town.send(asdu(125, 3, THERE, (1, b"\x01")))
    town.say(1, THERE, (1, b"\x00"))
    wait_value(one, "breaker", "off")
    seen = counters(one)
    assert [seen[f"town.{name}"] for name in ("unmapped", "mistyped", "unknown")] == [2, 1, 1]


def test_test_frames_are_no_information(gateway: Run, town: Outstation) -> None:
    one = gateway(outstation(town.port))
    wait_quality(one, "power", "good")
    town.send(asdu(1, 3 | 0x80, THERE, (1, b"\x00")))
    town.say(13, THERE, (7, b"\x00\x00\x40\x40\x00"))
    wait_value(one, "power", 3.0)
    assert one.points("breaker")["breaker"]["value"] == "on"


# ---- the connection -----------------------------------------------------------------------------


@pytest.mark.slow
def test_points_are_invalid_until_it_has_answered_and_after_it_is_lost(
    gateway: Run, town: Outstation
) -> None:
    town.die()
    one = gateway(outstation(town.port))
    assert one.points("power")["power"]["quality"] == "invalid"
    town.listen()
    wait_quality(one, "power", "good")
    with Master(*one.address) as master:
        master.interrogate(CA)
        mark = master.mark()
        town.die()
        lost = master.wait(lambda r: r.ioa == 107, since=mark, what="it is lost")
        assert ("INVALID" in lost.quality.upper(), lost.value) == (True, 2.5)
        mark = master.mark()
        town.listen()
        assert master.wait(lambda r: r.ioa == 107, since=mark, what="it is back").good


def test_what_an_interrogation_leaves_out_stays_invalid(gateway: Run, town: Outstation) -> None:
    one = gateway(outstation(town.port))
    wait_quality(one, "power", "good")
    town.interrogated = town.interrogated[:1]
    town.die()
    wait_quality(one, "power", "invalid")
    town.listen()
    wait_quality(one, "breaker", "good")
    assert one.points("power")["power"]["quality"] == "invalid"


def test_initialised_station_is_interrogated_again(gateway: Run, town: Outstation) -> None:
    one = gateway(outstation(town.port))
    wait_quality(one, "power", "good")
    town.send(asdu(70, 4, THERE, (0, b"\x00")))
    town.wait(lambda: [a.type for a in town.asked].count(INTERROGATION) == 2, "it is interrogated again")


def silent(asked: Asked, octets: bytes) -> list[bytes]:
    return []


def refuses(asked: Asked, octets: bytes) -> list[bytes]:
    return [octets[:2] + bytes((NEGATIVE | ACT_CON,)) + octets[3:]]


@pytest.mark.slow
@pytest.mark.parametrize(("answer", "how"), [(silent, "does not answer"), (refuses, "refuses")])
def test_interrogation_that_fails_is_repeated(
    gateway: Run, town: Outstation, answer: Callable[[Asked, bytes], list[bytes]], how: str
) -> None:
    """A station that has only just started may not know its own points yet."""
    town.answer = answer
    one = gateway(outstation(town.port, confirmation_ms=300))
    failure = f"town: CA {THERE} {how} the general interrogation, which is repeated"
    one.wait_for(lambda: failure in one.log(), 20.0, failure)
    town.answer = town.usual
    wait_quality(one, "power", "good")
    assert one.log().count(failure) == 1


@pytest.mark.slow
def test_clock_is_set_once_the_gateways_is(gateway: Run, town: Outstation) -> None:
    wanted = outstation(town.port, clock_s=1)
    one = gateway(wanted)
    wait_quality(one, "power", "good")  # the interrogation comes behind the clock
    (clock,) = one.query("clock")
    if not clock["valid"]:  # this machine's is not synchronised
        assert not any(asked.type == CLOCK for asked in town.asked)
        with Master(*one.address) as master:
            master.synchronise_clock(CA)
    town.wait(lambda: any(asked.type == CLOCK for asked in town.asked), "its clock is set")


def test_lib60870s_server(gateway: Run) -> None:
    server = c104.Server(ip="127.0.0.1", port=free_port(), tick_rate_ms=100)
    station = server.add_station(common_address=THERE)
    station.add_point(io_address=7, type=c104.Type.M_ME_NC_1).value = 1.5
    done: list[object] = []

    def on_command(
        point: c104.Point, previous_info: c104.Information, message: c104.IncomingMessage
    ) -> c104.ResponseState:
        done.append(point.value)
        return c104.ResponseState.SUCCESS

    command = station.add_point(io_address=12, type=c104.Type.C_DC_NA_1)
    command.command_mode = c104.CommandMode.SELECT_AND_EXECUTE
    command.on_receive(callable=on_command)
    server.start()
    try:
        one = gateway(outstation(server.port, terminates=False))
        wait_quality(one, "power", "good")
        assert one.points("power")["power"]["value"] == 1.5
        assert commanded(one, "set", "position", "on", "--select")["result"] == "done"
        assert done == [c104.Double.ON]
    finally:
        server.stop()


# ---- a changed configuration --------------------------------------------------------------------


@pytest.mark.slow
def test_what_another_process_took_over_ends_without_its_outstation(gateway: Run, town: Outstation) -> None:
    one = gateway(outstation(town.port))
    wait_quality(one, "power", "good")
    changed = json.loads(one.config_file.read_text())
    changed["outstations"][0]["k"] = 11
    one.ctl("reload", one.put(changed))
    one.wait_for(lambda: counters(one)["town.started"] > 0, LIMIT_S, "data transfer again")
    assert one.points("power")["power"]["quality"] == "good"
    pid = one.modules()["rtu-104m"]["pid"]
    town.die()
    wait_quality(one, "power", "invalid")
    assert one.modules()["rtu-104m"]["pid"] == pid


@pytest.mark.slow
def test_outstation_that_is_gone_with_the_former_process(gateway: Run, town: Outstation) -> None:
    one = gateway(outstation(town.port))
    wait_quality(one, "power", "good")
    changed = json.loads(one.config_file.read_text())
    changed["outstations"][0]["port"] = free_port()  # where nobody is
    one.ctl("reload", one.put(changed))
    wait_quality(one, "power", "invalid")


# ---- commands -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "value", "kind", "element"),
    [
        ("breaker", "on", 45, b"\x01"),
        ("bits", "77", 51, b"\x4d\x00\x00\x00"),
        ("share", "-0.5", 48, b"\x00\xc0\x00"),
        ("level", "-7", 49, b"\xf9\xff\x00"),
        ("power", "2.5", 50, b"\x00\x00\x20\x40\x00"),
    ],
)
def test_command_of_each_type(
    gateway: Run, town: Outstation, name: str, value: str, kind: int, element: bytes
) -> None:
    one = gateway(outstation(town.port))
    wait_quality(one, "power", "good")
    assert commanded(one, "set", name, value)["result"] == "done"
    (done,) = town.executions()
    assert (done.type, done.ca, done.ioa, done.element) == (kind, THERE, 11 + NAMES.index(name), element)


def test_step_and_pulse(gateway: Run, town: Outstation) -> None:
    one = gateway(outstation(town.port))
    wait_quality(one, "power", "good")
    assert commanded(one, "step", "tap", "lower")["result"] == "done"
    assert commanded(one, "set", "breaker", "on", "--pulse", "long")["result"] == "done"
    assert [(done.type, done.element) for done in town.executions()] == [(47, b"\x01"), (45, b"\x09")]


@pytest.mark.slow
def test_selection_goes_before_the_execution(gateway: Run, town: Outstation) -> None:
    one = gateway(outstation(town.port))
    wait_quality(one, "power", "good")
    assert commanded(one, "set", "position", "on")["result"] == "not selected"
    assert commanded(one, "set", "position", "on", "--select")["result"] == "done"
    assert [a.element for a in town.asked if a.is_command] == [b"\x82", b"\x02"]


@pytest.mark.slow
def test_master_commands_through(gateway: Run, town: Outstation) -> None:
    """Its confirmation is the outstation's, and it sees what became of it."""
    one = gateway(outstation(town.port))
    wait_quality(one, "power", "good")

    def answer(asked: Asked, octets: bytes) -> list[bytes]:
        answers = town.usual(asked, octets)
        if asked.executes:
            answers.insert(1, asdu(1, 11, THERE, (1, b"\x00")))
        return answers

    town.answer = answer
    with Master(*one.address) as master:
        mark = master.mark()
        assert master.command(CA, 101, "C_SC_NA_1", c104.SingleCmd(False))
        back = master.wait(lambda r: r.ioa == 101, since=mark, what="return information")
        assert (back.value, back.cause) == (False, "RETURN_INFO_REMOTE")
        town.answer = lambda asked, octets: [octets[:2] + bytes((ACT_CON | NEGATIVE,)) + octets[3:]]
        assert not master.command(CA, 101, "C_SC_NA_1", c104.SingleCmd(True))


@pytest.mark.sample(4)
@pytest.mark.parametrize("cause", [ACT_CON | NEGATIVE, 44, 45, 46, 47, 47 | NEGATIVE])
@pytest.mark.parametrize("selected", [False, True])
def test_refusal_has_its_reason(gateway: Run, town: Outstation, cause: int, selected: bool) -> None:
    one = gateway(outstation(town.port))
    wait_quality(one, "power", "good")
    town.answer = lambda asked, octets: [octets[:2] + bytes((cause,)) + octets[3:]]
    arguments = ["position", "on", "--select"] if selected else ["breaker", "on"]
    seen = commanded(one, "set", *arguments)
    assert (seen["state"], seen["result"], seen["exception"]) == (
        "refused command",
        "exception",
        cause & 0x3F,
    )
    assert len(town.executions()) == (0 if selected else 1)
    assert counters(one)["town.refused"] == 1


def confirms_only(asked: Asked, octets: bytes) -> list[bytes]:
    return [octets[:2] + bytes((ACT_CON,)) + octets[3:]]


@pytest.mark.slow
@pytest.mark.parametrize(("answer", "state"), [(silent, "no ACT_CON"), (confirms_only, "no ACT_TERM")])
def test_command_that_is_not_answered_times_out(
    gateway: Run, town: Outstation, answer: Callable[[Asked, bytes], list[bytes]], state: str
) -> None:
    one = gateway(outstation(town.port, confirmation_ms=300, termination_ms=300))
    wait_quality(one, "power", "good")
    town.answer = answer
    assert commanded(one, "set", "breaker", "on")["result"] == "time-out", state
    assert len(town.executions()) == 1


@pytest.mark.slow
def test_command_without_a_link_is_negative(gateway: Run, town: Outstation) -> None:
    town.die()
    one = gateway(outstation(town.port))
    assert commanded(one, "set", "breaker", "on")["state"] == "refused command"
    town.listen()
    wait_quality(one, "power", "good")
    assert town.executions() == []


@pytest.mark.parametrize("answer", [silent, confirms_only])
def test_link_lost_under_way_is_of_unknown_fate_and_never_repeated(
    gateway: Run, town: Outstation, answer: Callable[[Asked, bytes], list[bytes]]
) -> None:
    one = gateway(outstation(town.port))
    wait_quality(one, "power", "good")
    town.answer = answer
    command = Commanding(one, "set", "breaker", "on")
    town.wait(lambda: len(town.executions()) == 1, "it is commanded")
    town.die()
    assert command.end()["result"] == "unknown fate"
    town.answer = town.usual
    town.listen()
    wait_quality(one, "power", "good")
    assert len(town.executions()) == 1
    assert commanded(one, "set", "breaker", "on")["result"] == "done"


@pytest.mark.slow
def test_selection_that_comes_too_late_is_not_executed(programs: Path, town: Outstation) -> None:
    """commands.command_timeout: whoever asked has given up."""
    directory = run_directory()
    wanted = config(outstation(town.port)) | {"commands": {"command_timeout": 1}}
    try:
        with Gateway(wanted, directory, programs) as one:
            wait_quality(one, "power", "good")
            town.answer = silent
            asked_at = time.monotonic()
            command = Commanding(one, "set", "position", "on", "--select")
            town.wait(lambda: any(a.is_command for a in town.asked), "it is selected")
            one.wait_for(lambda: time.monotonic() > asked_at + 2, 30.0, "the command is too old")
            town.say(46, THERE, (12, b"\x82"), cause=ACT_CON)
            assert command.end()["state"] == "refused command"
            one.wait_for(lambda: counters(one)["town.refused"] == 1, 30.0, "it was refused")
            assert town.executions() == []
    finally:
        remove(directory)


# ---- kill -9 ------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("moment", ["selected", "executed", "confirmed"])
def test_killed_in_each_state_of_a_command(gateway: Run, town: Outstation, moment: str) -> None:
    """One write at most; whoever asked is told that it failed; the next process repeats nothing."""
    one = gateway(outstation(town.port))
    wait_quality(one, "power", "good")
    answers = {"selected": silent, "executed": silent, "confirmed": confirms_only}
    town.answer = answers[moment]
    if moment == "selected":
        command = Commanding(one, "set", "position", "on", "--select")
        town.wait(lambda: any(a.is_command for a in town.asked), "it is selected")
    else:
        command = Commanding(one, "set", "breaker", "on", "--pulse", "short")
        town.wait(lambda: len(town.executions()) == 1, "it is commanded")
    if moment == "confirmed":
        one.wait_for(
            lambda: any(row["result"] == "done" for row in one.query("commands", "breaker")),
            30.0,
            "confirmed",
        )
    one.kill("rtu-104m")
    assert command.end()["state"] == "refused command"
    town.answer = town.usual
    one.wait_for(lambda: one.modules()["rtu-104m"]["restarts"] == 1, 60.0, "it is started again")
    wait_quality(one, "power", "good")
    assert len(town.executions()) == (0 if moment == "selected" else 1)
    # Nothing of it is left: no interlock, no pulse.
    assert commanded(one, "set", "breaker", "on", "--pulse", "short")["result"] == "done"


# ---- redundant links ----------------------------------------------------------------------------


@pytest.fixture
def pair() -> Iterator[tuple[Outstation, Outstation]]:
    """One station at two addresses."""
    with Outstation() as first, Outstation(first.port, "127.0.0.2") as second:
        for one in (first, second):
            one.interrogated = [asdu(kind, INTERROGATED, THERE, GOOD[kind]) for kind in WIRE[:-1]]
        yield first, second


def redundant(port: int, **keys: Any) -> dict[str, Any]:
    return outstation(port, addresses=["127.0.0.1", "127.0.0.2"], **keys)


@pytest.mark.slow
def test_one_link_is_started_and_the_other_takes_over(
    gateway: Run, pair: tuple[Outstation, Outstation]
) -> None:
    first, second = pair
    one = gateway(redundant(first.port))
    wait_quality(one, "power", "good")
    active, standby = (first, second) if first.started else (second, first)
    standby.wait(lambda: len(standby._peers) == 1, "the other is connected")
    assert (active.started, standby.started) == (1, 0)
    with Master(*one.address) as master:
        master.interrogate(CA)
        mark = master.mark()
        active.die()
        standby.wait(lambda: standby.started == 1, "it takes over")
        standby.wait(lambda: any(a.type == INTERROGATION for a in standby.asked), "it is interrogated")
        standby.say(13, THERE, (7, b"\x00\x00\x40\x40\x00"))
        master.wait(lambda r: r.ioa == 107 and r.value == 3.0, since=mark, what="a value by the other link")
        assert all(report.good for report in master.reports_since(mark))  # nothing was invalid meanwhile
    assert commanded(one, "set", "breaker", "on")["result"] == "done"
    assert (len(active.executions()), len(standby.executions())) == (0, 1)


@pytest.mark.slow
def test_link_that_hangs_is_left_by_test_and_time_out(
    gateway: Run, pair: tuple[Outstation, Outstation]
) -> None:
    first, second = pair
    one = gateway(redundant(first.port, t1=2, t3=1))
    wait_quality(one, "power", "good")
    active, standby = (first, second) if first.started else (second, first)
    standby.wait(lambda: len(standby._peers) == 1, "the other is connected")
    active.deaf = True
    standby.wait(lambda: standby.started == 1, "it takes over")
    wait_quality(one, "power", "good")


def test_both_links_lost_is_invalid(gateway: Run, pair: tuple[Outstation, Outstation]) -> None:
    first, second = pair
    one = gateway(redundant(first.port))
    wait_quality(one, "power", "good")
    first.die()
    second.die()
    wait_quality(one, "power", "invalid")
    second.listen()
    wait_quality(one, "power", "good")


@pytest.mark.slow
def test_standby_that_does_not_start_leaves_the_points_invalid(
    gateway: Run, pair: tuple[Outstation, Outstation]
) -> None:
    first, second = pair
    one = gateway(redundant(first.port, t1=2))
    wait_quality(one, "power", "good")
    active, standby = (first, second) if first.started else (second, first)
    standby.starts = False
    standby.wait(lambda: len(standby._peers) == 1, "the other is connected")
    active.die()
    wait_quality(one, "power", "invalid")


# ---- hostile stations ---------------------------------------------------------------------------

HOSTILE = {
    "no 104": b"HTTP/1.1 400 Bad Request\r\n\r\n",
    "zeros": bytes(300),
    "short frame": b"\x68\x03\x00\x00\x00",
    "long frame": b"\x68\xfe" + bytes(300),
    "wrong N(S)": bytes.fromhex("680e02000000 0101030001000100 0001"),
    "N(R) of nothing": bytes.fromhex("680401000600"),
    "STARTDT act": bytes.fromhex("680407000000"),
    "no objects": bytes.fromhex("680a00000000 010003002f00"),
    "too few octets": bytes.fromhex("680d00000000 018003002f00010000"),
    "command to us": bytes.fromhex("680e00000000 2d0206002f0001000001"),
}


@pytest.mark.sample(4)
@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_station_reaches_no_other(gateway: Run, town: Outstation, name: str) -> None:
    with Outstation() as hostile:
        bad = outstation(hostile.port) | {"name": "bad"}
        bad["sets"] = [{"ca": 900, "remote_ca": 1, "points": [{"type": "single", "ioa": 1}]}]
        one = gateway(bad, outstation(town.port))
        wait_quality(one, "power", "good")
        hostile.wait(lambda: hostile.started >= 1, "it is started")
        hostile.octets(HOSTILE[name])
        hostile.wait(lambda: hostile.started >= 2, "its connection was closed")
        assert one.points("bad-900.1")["bad-900.1"]["quality"] == "invalid"
        town.say(13, THERE, (7, b"\x00\x00\x40\x40\x00"))
        wait_value(one, "power", 3.0)
        assert commanded(one, "set", "breaker", "on")["result"] == "done"
        assert one.modules()["rtu-104m"]["restarts"] == 0


@pytest.mark.slow
def test_slow_and_dead_stations_reach_no_other(gateway: Run, town: Outstation) -> None:
    """One that accepts and says nothing, one that does not confirm STARTDT, one that is not there."""
    with Outstation() as deaf, Outstation() as stopped:
        deaf.deaf, stopped.starts = True, False
        others = []
        for number, port in enumerate((deaf.port, stopped.port, free_port())):
            other = outstation(port) | {"name": f"other{number}"}
            other["sets"] = [{"ca": 900 + number, "points": [{"type": "single", "ioa": 1}]}]
            others.append(other)
        one = gateway(*others, outstation(town.port))
        wait_quality(one, "power", "good")
        deaf.wait(lambda: deaf.connections > 0, "it is connected")
        for value in range(20):
            town.say(11, THERE, (6, bytes((value, 0, 0))))
            wait_value(one, "level", value)
        assert {p["quality"] for p in one.points("other*").values()} == {"invalid"}
        assert commanded(one, "set", "other0-900.1", "on")["result"] == "not commandable"


@pytest.mark.slow
@pytest.mark.parametrize("answer", [b"", bytes.fromhex("68040b000000")], ids=["at once", "once started"])
def test_station_that_hangs_up_is_no_flood_in_the_log(gateway: Run, answer: bytes) -> None:
    """A line counts many failures, and the points are said to be invalid no more than once."""
    with hangs_up(answer) as host:
        one = gateway(outstation(host.port))
        one.wait_for(lambda: host.connections >= 16, 60.0, "it is tried again and again")
        lines = [line.partition("town: ")[2] for line in one.log(1000).splitlines() if "town: " in line]
        assert 1 <= len(lines) < host.connections / 2, lines
        assert any(re.fullmatch(r"127\.0\.0\.1 .*; trying again in 50 ms", line) for line in lines)


def test_our_own_station(gateway: Run, town: Outstation) -> None:
    """A gateway below a gateway: what one concentrates, the other does again."""
    below = gateway(outstation(town.port))
    wait_quality(below, "power", "good")
    listed = [point | {"remote_ioa": point["ioa"]} for point in points()]
    for point in listed:
        point.pop("command_ioa", None)
        if point["type"] == "step":
            point.pop("command"), point.pop("select")
    upper = outstation(below.address[1])
    upper["sets"] = [{"ca": 7, "remote_ca": CA, "points": listed}]
    above = gateway(upper)
    wait_quality(above, "power", "good")
    assert {name: above.points(name)[name]["value"] for name in NAMES[:-1]} == {
        name: VALUES[name] for name in NAMES[:-1]
    }
    assert commanded(above, "set", "position", "off", "--select")["result"] == "done"
    assert [done.element for done in town.executions()] == [b"\x01"]
    town.say(13, THERE, (7, b"\x00\x00\x20\x40\x40"))
    wait_quality(above, "power", "not topical")


def test_no_memory_is_allocated_once_it_runs(gateway: Run, town: Outstation) -> None:
    """Its data segment does not grow with what it hears and is asked."""
    one = gateway(outstation(town.port))
    wait_quality(one, "power", "good")
    pid = one.modules()["rtu-104m"]["pid"]

    def data() -> str:
        return next(
            line for line in Path(f"/proc/{pid}/status").read_text().splitlines() if line.startswith("VmData")
        )

    before = data()
    for value in range(200):
        town.say(11, THERE, *((6, bytes((value, 0, 0))) for _ in range(30)))
    wait_value(one, "level", 199)
    assert commanded(one, "set", "breaker", "on")["result"] == "done"
    assert data() == before


# ---- the file -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"addresses": []}, "addresses: is empty, expected one address, or two"),
        ({"addresses": ["town.example"]}, "addresses[0]: is not an IP address"),
        ({"addresses": ["192.0.2.1"] * 3}, "addresses: has 3"),
        ({"w": 13, "k": 12}, "w: 13 is too much, expected at most k (12)"),
        ({"t2": 15, "t1": 15}, "t2: 15 is too much, expected less than t1 (15)"),
        ({"retry_ms": 300}, "retry_ms: 300 is too much, expected at most retry_max_ms (200)"),
        ({"timezone": "here"}, "timezone: is not a time zone"),
        ({"name": "a b"}, "name: has a space"),
        ({"sets": []}, "sets: is empty"),
        ({"sets": [{"ca": 0, "points": []}]}, "sets[0].ca: 0 is out of range"),
        (
            {"sets": [{"ca": 1, "points": []}, {"ca": 2, "remote_ca": 1, "points": []}]},
            "sets[1]: 1 is the remote_ca of another set",
        ),
        (
            {"sets": [{"ca": 1, "points": []}, {"ca": 1, "remote_ca": 2, "points": []}]},
            "1 is the common address",
        ),
    ],
)
def test_mistakes_of_an_outstation(
    programs: Path, tmp_path: Path, change: dict[str, Any], message: str
) -> None:
    assert message in errors(programs, tmp_path, outstation(2404) | change)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"type": "integer"}, "type: "),
        ({"select": True}, 'select: is of a point that takes commands, expected "command": true'),
        ({"type": "counter", "command": True}, "is a counter, for which there is no command"),
        (
            {"type": "bitstring", "command": True, "select": True},
            "is a bitstring, whose command has no selection",
        ),
        ({"type": "float", "command": True, "long_pulse_ms": 5}, "has a pulse, expected that of a single"),
        ({"command": True, "short_pulse_ms": 5, "long_pulse_ms": 5}, "has two pulses of one length"),
        ({"ioa": 16777215, "count": 2}, "ioa: is too high for 2 objects"),
        ({"remote_ioa": 2}, "2 is the remote_ioa of another point"),
        ({"name": "x?"}, "name: has a space or one of"),
        ({"type": "position", "count": 2}, "count: is not for a position, which has four points"),
        ({"type": "position", "command": True}, "is a position, for which there is no command"),
        ({"type": "position", "ioa": 16777213}, "ioa: is too high for the four points"),
        ({"count": 1001}, "count: 1001 is out of range"),
    ],
)
def test_mistakes_of_a_point(programs: Path, tmp_path: Path, change: dict[str, Any], message: str) -> None:
    listed = [{"type": "single", "ioa": 2}, {"type": "single", "ioa": 1} | change]
    assert message in errors(programs, tmp_path, outstation(2404, sets=[{"ca": 1, "points": listed}]))


def test_example_of_the_page_is_right(programs: Path) -> None:
    example = PAGE.parent / "examples/concentrator.json"
    command = [programs / "rtud" / "rtud", "--check", example]
    done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S, check=False)
    assert done.returncode == 0, done.stderr
    (shown,) = re.findall(r"^```json\n(.*?)^```", PAGE.read_text(), re.MULTILINE | re.DOTALL)
    assert json.loads(shown) == json.loads(example.read_text())["outstations"][0]


def test_page_names_every_counter(gateway: Run, town: Outstation) -> None:
    shown = {name.removeprefix("town.") for name in counters(gateway(outstation(town.port)))}
    table = PAGE.read_text().split("## What the process shows")[1].split("## Limits")[0]
    rows = [line.split("|")[1] for line in table.splitlines() if line.startswith("| `")]
    assert shown == {name for row in rows for name in re.findall(r"`(\w+)`", row)}


def test_too_many_points(programs: Path, tmp_path: Path) -> None:
    listed = [{"type": "single", "ioa": 1 + 1000 * number, "count": 1000} for number in range(5)]
    found = errors(programs, tmp_path, outstation(2404, sets=[{"ca": 1, "points": listed}]))
    assert "outstations: has 5000 points, expected at most 4096" in found


def errors(programs: Path, folder: Path, wanted: dict[str, Any]) -> str:
    file = folder / "gateway.json"
    file.write_text(json.dumps(config(wanted)))
    command = [programs / "rtud" / "rtud", "--check", file]
    done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S, check=False)
    assert done.returncode == 1, done.stdout + done.stderr
    return done.stdout + done.stderr
