# SPDX-License-Identifier: GPL-3.0-or-later
"""When an alarm comes and goes, and of which other one it is a part; in either store."""

import contextlib
import json
import struct
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from openrtu_tools.centre import alarms as module
from openrtu_tools.centre.codes import INVALID, TAGGED, Cause, Content, Kind, Link
from openrtu_tools.centre.database import open_store
from openrtu_tools.centre.errors import CentreError
from openrtu_tools.centre.intake import Intake
from openrtu_tools.centre.model import Alarm
from openrtu_tools.centre.records import Record
from openrtu_tools.centre.settings import AlarmClass, AlarmRules, Meaning, StationSettings, load
from openrtu_tools.centre.store import Database, Store
from postgres import Server

NOW = time.time_ns()
S = 10**9
TANK = Meaning("level", high=5.0, low=1.0, deadband=0.5)
FLOW = Meaning("flow", high=5.0, alarm_class="flow")
STATIONS = 40
SETTINGS = {
    f"s{number}": StationSettings(f"s{number}", points={(1, 1): TANK, (1, 2): FLOW})
    for number in range(STATIONS)
}


@pytest.fixture
def store(server: Server | None, tmp_path: Path) -> Iterator[Store]:
    where = server.new_database() if server else tmp_path / "centre.db"
    with contextlib.closing(open_store(where, alone=True)) as made:
        yield made


class Room:
    """The intake of a centre with these stations; what comes, comes at a time that the test says."""

    def __init__(self, store: Store, monkeypatch: pytest.MonkeyPatch, **rules: object) -> None:
        self.store = store
        self.now_ns = NOW
        monkeypatch.setattr(module.time, "time_ns", lambda: self.now_ns)
        self.rules = AlarmRules(**{"network_stations": 5, **rules})  # type: ignore[arg-type]
        self.start()

    def start(self, settings: dict[str, StationSettings] = SETTINGS) -> None:
        """As after a kill, too: all is read from the store."""
        self.intake = self.store.transaction(lambda database: Intake(database, settings, (), self.rules))
        self.intake.stored()
        named = [
            Record(Kind.STATION, 0, 0, place, 0, 0, name=name, received_ns=1)
            for place, name in enumerate(settings)
        ]
        self.take(*named)

    def take(self, *records: Record) -> None:
        self.intake.begin()
        self.store.transaction(lambda database: self.intake.take(database, records))
        self.intake.stored()

    def at(self, seconds: float) -> None:
        """It is so late, and the centre has looked what is due."""
        self.now_ns = NOW + int(seconds * S)
        self.intake.begin()
        self.store.transaction(self.intake.due)
        self.intake.stored()

    def link(self, up: bool, *places: int) -> None:
        rest = bytes([Link.UP if up else Link.DOWN]) + bytes(11)
        self.take(
            *(Record(Kind.LINK, 0, 0, each, 0, 0, received_ns=self.now_ns, rest=rest) for each in places)
        )

    def say(self, value: float, ioa: int = 1, ago_s: float = 0, quality: int = 0, place: int = 0) -> None:
        rest = struct.pack("<fHB5x", value, 0, Content.FLOAT)
        self.take(
            Record(
                Kind.INFORMATION, TAGGED, 1, place, 1, ioa, received_ns=self.now_ns,
                tag_ns=self.now_ns - int(ago_s * S), type=36,
                cause=Cause.SPONTANEOUS, quality=quality, rest=rest,
            )
        )  # fmt: skip

    def alarms(self, kind: str = "") -> list[Alarm]:
        return [alarm for alarm in self.intake.model.alarms.values() if kind in ("", alarm.kind)]

    def active(self, kind: str = "") -> list[Alarm]:
        return [alarm for alarm in self.alarms(kind) if alarm.active]

    def standing(self) -> list[str]:
        """What the list shows: the kinds of those that are no part of another one."""
        return [alarm.kind for alarm in self.active() if alarm.suppressed_by is None]

    def acknowledge(self, alarm: Alarm) -> None:
        done = module.replace(alarm, acknowledged_ns=self.now_ns, acknowledged_by="olga")
        self.intake.begin()
        self.store.transaction(lambda database: self.intake.alarms.put(database, done))
        self.intake.stored()

    def rows(self, sql: str) -> list[tuple[object, ...]]:
        return self.store.transaction(lambda database: [tuple(row) for row in database.execute(sql)])


def test_classes_are_of_the_file(tmp_path: Path) -> None:
    """A point names one in the station's alarms or in its list; one that is not there is refused."""
    (tmp_path / "points.csv").write_text(
        "ca,ioa,name,high,deadband,class\n1,1,flow,5,,flow\n1,2,level,5,0.1,\n1,3,door,,,\n"
    )
    station = {"name": "north", "points": "points.csv", "alarms": {"door": {"state": 1, "class": "slow"}}}
    classes = {"flow": {"on_s": 10, "deadband": 0.5}, "slow": {"off_s": 3}, "high": {"deadband": 9}}
    file = tmp_path / "centre.json"
    content = {"stations": [station], "centre": {"alarms": {"network_stations": 7, "classes": classes}}}
    file.write_text(json.dumps(content))
    found = load(file)
    rules, (flow, level, door) = found.alarms, found.stations["north"].points.values()
    assert (rules.network_stations, rules.network_s) == (7, 60)
    assert [rules.deadband("high", meaning) for meaning in (flow, level)] == [0.5, 0.1]
    assert [rules.of("high", flow).on_s, rules.of("state", door).off_s, rules.of("lost").on_s] == [10, 3, 0]
    del classes["slow"]
    file.write_text(json.dumps(content))
    with pytest.raises(CentreError, match="door: class: there is no slow"):
        load(file)


# ---- deadband and delays -----------------------------------------------------------------------------


def test_value_must_come_back_by_the_deadband(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    room = Room(store, monkeypatch)
    steps = ((5.1, True), (4.9, True), (4.6, True), (4.5, False), (4.9, False), (5.1, True))
    for second, (value, is_so) in enumerate(steps):
        room.at(second)
        room.say(value)
        assert bool(room.active("high")) == is_so, value
    room.say(0.9)
    for value, is_so in ((1.4, True), (1.5, False)):
        room.at(room.now_ns / S - NOW / S + 1)
        room.say(value)
        assert bool(room.active("low")) == is_so, value
    [high] = room.alarms("high")
    assert high.returns == 1


def test_alarm_comes_when_its_cause_has_lasted(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    """By its class, or by its kind; a centre that was killed meanwhile knows since when."""
    classes = {"flow": AlarmClass(on_s=10, off_s=30), "lost": AlarmClass(on_s=20)}
    room = Room(store, monkeypatch, classes=classes)
    room.say(9, ioa=2)
    room.link(False, 3)
    room.say(9)  # its class has no delay
    assert room.standing() == ["high"]
    room.at(5)
    room.say(1, ioa=2)
    room.at(11)
    assert room.standing() == ["high"]  # the flow was too high for 5 s
    room.say(9, ioa=2)
    room.start()
    room.at(20)
    assert sorted(room.standing()) == ["high", "lost"]
    room.at(21)
    assert sorted(room.standing()) == ["high", "high", "lost"]
    assert {alarm.since_ns for alarm in room.active("high")} == {NOW, NOW + 11 * S}
    room.say(1, ioa=2)
    room.at(40)
    room.say(9, ioa=2)
    room.at(80)
    assert len(room.active("high")) == 2  # it was not too high for 19 s
    room.say(1, ioa=2)
    room.start()
    room.at(110)
    assert len(room.active("high")) == 1
    assert not room.rows("SELECT * FROM causes")
    assert all(not alarm.returns for alarm in room.alarms())


def test_events_that_waited_tell_what_lasted(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    """All came at once; by their times one was so for an hour, and another for a second."""
    room = Room(store, monkeypatch, classes={"flow": AlarmClass(on_s=10)})
    room.at(4000)
    room.say(9, ioa=2, ago_s=3900)
    room.say(1, ioa=2, ago_s=300)
    [flow] = room.alarms("high")
    assert (flow.since_ns, flow.gone_ns) == (NOW + 100 * S, NOW + 3700 * S)
    room.acknowledge(flow)
    room.say(9, ioa=2, ago_s=200)
    room.say(1, ioa=2, ago_s=199)
    room.at(5000)
    assert not room.alarms()


def test_alarm_does_not_end_before_it_came_again(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever times are told."""
    room = Room(store, monkeypatch)
    key = ("clock", room.intake.by_name["s0"], 1, None)
    room.intake.begin()

    def tell(database: Database) -> None:
        alarms = room.intake.alarms
        for at_s, so in ((10, True), (20, False), (30, True), (15, False)):
            if so:
                alarms.raise_(database, key, 3, at_s * S, value=1)
            else:
                alarms.clear(database, key, at_s * S)

    store.transaction(tell)
    room.intake.stored()
    [alarm] = room.alarms("clock")
    assert (alarm.since_ns, alarm.last_ns, alarm.gone_ns, alarm.returns) == (10 * S, 30 * S, 30 * S, 1)


# ---- what is a part of another fault ---------------------------------------------------------------


def test_many_lost_stations_are_one_fault(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each is a part of it, comes back by itself, and a centre that is killed meanwhile goes on."""
    room = Room(store, monkeypatch)
    room.link(False, 0, 1, 2, 3)
    assert room.standing() == ["lost"] * 4
    room.at(20)
    room.link(False, 4)
    assert room.standing() == ["network"]
    [network] = room.active("network")
    assert network.value == 5
    assert {alarm.suppressed_by for alarm in room.active("lost")} == {network.id}
    room.start()
    room.at(70)  # within a minute of the last one
    room.link(False, *range(5, 30))
    assert room.standing() == ["network"]
    assert room.active("network")[0].value == 30
    room.at(200)
    room.link(False, 30)
    assert room.standing() == ["network", "lost"]
    room.start()
    room.link(True, *range(1, 31))
    assert (len(room.active("lost")), room.standing()) == (1, ["network"])
    room.link(True, 0)
    assert not room.active()
    [network] = room.alarms("network")
    assert network.gone_ns == NOW + 200 * S
    # Each coming is counted; what the list showed of them were four stations, the fault, and the last one.
    assert room.rows("SELECT count(*), sum(shown) FROM comings") == [(32, 6)]


def test_stations_that_are_lost_one_by_one_are_no_fault_of_the_network(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    room = Room(store, monkeypatch)
    for place in range(10):
        room.at(16 * place)
        room.link(False, place)
    assert room.standing() == ["lost"] * 10


def test_what_was_acknowledged_hides_nothing_new(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stations that are lost behind it stand for themselves, until they are enough for another fault."""
    room = Room(store, monkeypatch)
    room.link(False, *range(5))
    room.acknowledge(room.active("network")[0])
    room.at(10)
    room.link(False, 5, 6, 7, 8)
    assert room.standing() == ["network"] + ["lost"] * 4
    room.link(False, 9)
    assert room.standing() == ["network", "network"]
    room.link(True, *range(10))
    assert not room.active()


def test_alarms_of_a_lost_station_are_parts_of_its_loss(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    room = Room(store, monkeypatch)
    room.say(9)
    room.say(9, place=1)
    room.say(0, ioa=2, quality=INVALID)
    assert sorted(room.standing()) == ["high", "high", "quality"]
    room.link(False, 0)
    assert sorted(room.standing()) == ["high", "lost"]
    room.start()
    assert sorted(room.standing()) == ["high", "lost"]
    room.link(True, 0)
    assert sorted(room.standing()) == ["high", "high", "quality"]
    room.say(3)
    assert sorted(room.standing()) == ["high", "quality"]


def test_a_late_event_of_a_lost_station_is_a_part_of_its_loss(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    room = Room(store, monkeypatch, classes={"flow": AlarmClass(on_s=10)})
    room.say(9, ioa=2)
    room.link(False, 0)
    room.at(30)
    assert room.standing() == ["lost"]
    assert len(room.active("high")) == 1
    room.link(True, 0)
    assert room.standing() == ["high"]


def test_what_the_file_has_no_more_ends(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    """A station that is lost, a limit, and what waits for its time: nothing would ever end them."""
    room = Room(store, monkeypatch, classes={"flow": AlarmClass(on_s=10)})
    room.say(9)
    room.say(9, place=1)
    room.say(9, ioa=2)
    room.link(False, *range(STATIONS - 5, STATIONS))
    assert sorted(room.standing()) == ["high", "high", "network"]
    without = {name: StationSettings(name) for name in [*SETTINGS][:1]}
    left = {name: SETTINGS[name] for name in [*SETTINGS][1 : STATIONS - 5]}
    room.start({**without, **left})
    room.at(20)
    assert room.standing() == ["high"]
    assert [alarm.station for alarm in room.active()] == [room.intake.by_name["s1"]]
