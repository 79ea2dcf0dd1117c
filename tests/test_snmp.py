# SPDX-License-Identifier: GPL-3.0-or-later
"""rtu-snmp, as managers see it that others wrote: Net-SNMP's commands, snmptrapd, pysnmp."""

import asyncio
import contextlib
import json
import os
import re
import signal
import socket
import struct
import subprocess
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import c104
import pytest
from pysnmp.hlapi.v3arch.asyncio import (
    USM_AUTH_HMAC192_SHA256,
    USM_PRIV_CFB128_AES,
    ContextData,
    ObjectIdentity,
    ObjectType,
    SnmpEngine,
    UdpTransportTarget,
    UsmUserData,
    bulk_cmd,
    get_cmd,
    set_cmd,
)
from pysnmp.proto.rfc1902 import Integer32, Null, ObjectName

from desk import Desk, chapter_5, desk_of, everything_read
from lab.gateway import free_port, remove, run_directory
from lab.manager import (
    CENTRE,
    ENGINE,
    ENGINEER,
    USERS,
    WATCH,
    Manager,
    Receiver,
    Refused,
    Silent,
    User,
    columns,
    free_udp_port,
    make_keys,
    oid,
    receiver,
)
from lab.patience import Deadline

ROOT = Path(__file__).resolve().parent.parent
BREAKER, LAMP = "1010.1", "1010.101"  # a double point with selection; a single one without
OFF, ON = 2, 3  # of a double point
(
    INACTIVE,
    SELECT,
    ACCEPTED,
    REFUSED_SELECTION,
    INTERRUPT,
    INTERRUPTED,
    EXECUTE,
    EXECUTING,
    REFUSED,
    EXECUTED,
) = range(1, 11)
NONE, DONE, TIMEOUT, NOT_SELECTED = 1, 2, 4, 6
UNKNOWN_FATE = 10
COMMAND, CYCLIC = 5, 9  # of rtuEventKind
INCONSISTENT = 12  # of RFC 3416's errors
NO_BITS = b"\0"


@dataclass
class Site:
    """A gateway with its devices, a controlling station, managers and a receiver of notifications."""

    desk: Desk
    folder: Path
    port: int
    received: Receiver

    def manager(self, user: User = CENTRE, level: str = "authPriv", timeout_s: int = 5) -> Manager:
        return Manager(self.port, self.folder, user, level, timeout_s)

    def last(self) -> int:
        (number,) = self.manager().get("rtuEventLast.0")
        assert isinstance(number, int)
        return number

    def states_told(self, after: int, count: int) -> list[int]:
        """The states of a command that were told by notifications behind this number."""
        told = self.received.wait_for("rtuCommandChanged", count, after)
        return [int(each.value("rtuCommandState")) for each in told]

    def wait_state(self, row: str, state: int) -> None:
        manager = self.manager()
        self.desk.gateway.wait_for(lambda: manager.state(row) == state, 60.0, f"{row} has the state {state}")

    def is_released(self, row: str) -> bool:
        """Returns it to inactive, if that is possible now."""
        for user in (CENTRE, ENGINEER):
            with contextlib.suppress(Refused):
                self.manager(user).wish(row, INACTIVE)
        return self.manager().state(row) == INACTIVE

    def writes(self, since: int, unit: int = 10) -> int:
        """How many times a device was told to write."""
        self.desk.lines.get("1.10", "coils", 0)
        frames = self.desk.lines.frames(since)
        return sum(f.kind == "received" and f.unit == unit and f.bytes[1] in (5, 6, 15, 16) for f in frames)


METER_POWER, ALARMS, POWER_FACTOR = "2020.30015", "2020.30013", "2020.30007"
PERIOD_MS = 400
METER, FIRST, AT_ONCE = "4.40", 100, 20  # registers that change together
GET_S, SINK_TIMEOUT_S = 0.05, 0.5


def with_units(config: dict[str, Any]) -> dict[str, Any]:
    """Two points of a meter are sent of themselves; one has a unit, one other decimals than usual."""
    meter = config["port"][1]["slaves"][0]["input_registers"]
    by_address = {object_["address"]: object_ for object_ in meter}
    by_address[14] |= {"cyclic_ms": PERIOD_MS, "unit": "kW"}
    by_address[12]["background_ms"] = 86_400_000
    by_address[6]["decimals"] = 5
    registers = [{"address": FIRST + i, "type": "scaled"} for i in range(AT_ONCE)]
    config["port"][3]["slaves"][0]["input_registers"] += registers
    return config


class Quick:
    """Managers in this process, by pysnmp: what is asked at a time is under way at a time."""

    def __init__(self, port: int) -> None:
        self.loop = asyncio.new_event_loop()
        self.port = port
        self.engines = {user: SnmpEngine() for user in USERS}

    def close(self) -> None:
        for engine in self.engines.values():
            engine.close_dispatcher()
        self.loop.run_until_complete(asyncio.sleep(0))
        self.loop.close()

    async def ask(self, command: Any, user: User, pairs: list[tuple[str, Any]]) -> tuple[int, list[Any]]:
        """The error's number, and the values."""
        target = await UdpTransportTarget.create(("127.0.0.1", self.port), timeout=5, retries=0)
        wanted = [(ObjectName(oid(name)), value) for name, value in pairs]
        failure, status, _, found = await command(
            self.engines[user], secrets_of(user), target, ContextData(), *wanted, lookupMib=False
        )
        assert failure is None, failure
        return int(status), [int(value) for _, value in found]

    async def get(self, user: User, *names: str) -> list[int]:
        status, values = await self.ask(get_cmd, user, [(name, Null("")) for name in names])
        assert status == 0
        return values

    async def wish(self, user: User, row: str, spin: int, state: int, value: int | None = None) -> bool:
        """False: it was inconsistentValue."""
        numbers = {"SpinLock": spin, "State": state} | ({} if value is None else {"Value": value})
        pairs = [(f"rtuCommand{name}.{row}", Integer32(number)) for name, number in numbers.items()]
        status, _ = await self.ask(set_cmd, user, pairs)
        assert status in (0, INCONSISTENT), status
        return status == 0


def secrets_of(user: User) -> UsmUserData:
    return UsmUserData(
        user.name,
        user.authentication,
        user.encryption,
        authProtocol=USM_AUTH_HMAC192_SHA256,
        privProtocol=USM_PRIV_CFB128_AES,
    )


@pytest.fixture(scope="module")
def quick(site: Site) -> Iterator[Quick]:
    managers = Quick(site.port)
    yield managers
    managers.close()


def configuration(folder: Path, port: int, sink_port: int, **more: Any) -> dict[str, Any]:
    users = [{"name": user.name, "role": role} for user, role in USERS.items()]
    sink = {"name": "nms", "address": "127.0.0.1", "port": sink_port, "user": CENTRE.name}
    sink["timeout_ms"] = int(SINK_TIMEOUT_S * 1000)
    snmp = {"address": "127.0.0.1", "port": port, "users": users, "sinks": [sink], "rate": 100000}
    return with_units(chapter_5()) | {
        "snmp": snmp | {"keys": str(folder / "keys"), "state": str(folder / "state")} | more
    }


@pytest.fixture(scope="module")
def site(programs: Path) -> Iterator[Site]:
    folder = run_directory()
    port, sink_port = free_udp_port(), free_udp_port()
    config = configuration(folder, port, sink_port, release_time=15)
    config["commands"] = {"select_timeout": 2, "command_timeout": 10}
    make_keys(config, folder)
    with receiver(sink_port, folder / "receiver") as received, desk_of(config, programs) as desk:
        yield Site(desk, folder, port, received)
    remove(folder)


@pytest.fixture(autouse=True)
def nothing_under_way(site: Site) -> Iterator[None]:
    """What a test has left of its commands ends by itself."""
    yield
    for row in (BREAKER, LAMP):
        site.desk.gateway.wait_for(lambda row=row: site.is_released(row), 60.0, f"{row} is released")


# ---- the MIB -------------------------------------------------------------------------------------


@pytest.mark.slow  # `make test-quick` does not fetch the MIBs of others
def test_the_mib_is_sound(mibs: Path) -> None:
    path = ROOT / "package/openrtu/src/snmp/OPENRTU-MIB.txt"
    paths = f"{mibs}:/usr/share/snmp/mibs"
    lint = subprocess.run(
        ["smilint", "-l", "6", path], env={**os.environ, "SMIPATH": paths}, capture_output=True, text=True
    )
    assert (lint.returncode, lint.stdout + lint.stderr) == (0, "")
    command = [
        "snmptranslate",
        "-M",
        f"{mibs}:/usr/share/snmp/mibs:{path.parent}",
        "-m",
        "OPENRTU-MIB",
        "-On",
    ]
    for name, number in columns().items():
        found = subprocess.run([*command, f"OPENRTU-MIB::{name}"], capture_output=True, text=True).stdout
        assert found.strip() == f".{number}"


@pytest.mark.slow
def test_each_object_of_the_mib_is_there_and_nothing_else(site: Site) -> None:
    """For the operator, who may read all."""
    seen = {key.partition(".")[0] for key in site.manager().rows("snmpbulkwalk", "-Cr40", oid("openRtuMIB"))}
    assert seen == set(columns())


# ---- points --------------------------------------------------------------------------------------

VALUES = {
    "single": ("rtuSingle", lambda value: {"off": 1, "on": 2}[value]),
    "double": ("rtuDouble", lambda value: {"intermediate": 1, "off": 2, "on": 3, "indeterminate": 4}[value]),
    "step": ("rtuStep", int),
    "bitstring": ("rtuBitstring", int),
    "normalized": ("rtuMeasured", lambda value: round(value * 32768)),
    "scaled": ("rtuMeasured", int),
    "float": ("rtuMeasured", None),
    "counter": ("rtuTotal", int),
}
BITS = {"invalid": 0x80, "not topical": 0x40, "substituted": 0x20, "blocked": 0x10, "overflow": 0x01}


@pytest.mark.slow
def test_every_point_is_as_rtuctl_says(site: Site) -> None:
    manager = site.manager(WATCH)
    points = site.desk.gateway.points()
    by_address = {f"{point['ca']}.{point['ioa']}": (name, point) for name, point in points.items()}
    texts = {index: name.decode() for index, name in manager.walk("rtuPointName").items()}
    assert texts == {index: name for index, (name, _) in by_address.items()}
    columns_of = {
        base: (manager.walk(f"{base}Value"), manager.walk(f"{base}Quality"))
        for base in {base for base, _ in VALUES.values()}
    }
    for index, (name, point) in by_address.items():
        base, shown = VALUES[point["type"]]
        values, qualities = columns_of[base]
        quality = sum(BITS[word] for word in point["quality"].split(",") if word != "good")
        assert qualities[index] == bytes([quality]), name
        if not quality and shown is not None:
            assert values[index] == shown(point["value"]), name


def test_a_float_has_the_decimals_that_it_is_given(site: Site) -> None:
    manager = site.manager(WATCH)
    values, decimals = manager.walk("rtuMeasuredValue"), manager.walk("rtuMeasuredPrecision")
    assert decimals[POWER_FACTOR] == 5
    for point in site.desk.gateway.points().values():
        index = f"{point['ca']}.{point['ioa']}"
        if point["type"] == "float" and point["quality"] == "good":
            assert decimals[index] == (5 if index == POWER_FACTOR else 3)
            assert values[index] == round(point["value"] * 10 ** decimals[index])


@pytest.mark.slow
def test_a_point_has_a_unit_and_limits(site: Site) -> None:
    manager = site.manager(WATCH)
    units = manager.walk("rtuPointUnit")
    assert {index: unit for index, unit in units.items() if unit} == {METER_POWER: b"kW"}
    ends = [manager.walk(f"rtuPoint{end}") for end in ("Low", "High")]
    limits = {index: tuple(struct.unpack(">f", each[index])[0] for each in ends) for index in units}
    assert limits["1010.30003"] == (-32768, 32767)  # scaled
    assert limits[BREAKER] == (0, 3)


# ---- initialisation, cyclic data, polling --------------------------------------------------------


@pytest.mark.slow
def test_the_station_tells_its_start_and_each_end_of_initialisation(site: Site) -> None:
    (started,) = site.received.wait_for("rtuStarted")
    assert started.value("rtuStationStarts") == 1
    assert [each.numbers for each in site.received.wait_for("1.3.6.1.6.3.1.1.5.1")] == [
        [started.numbers[0] - 1]
    ]
    stations = {point["ca"] for point in site.desk.gateway.points().values()}
    told = site.received.wait_for("rtuStationInitialised", len(stations))
    causes = {each.value("rtuEventCommonAddress"): each.value("rtuEventValue") for each in told}
    assert causes == dict.fromkeys(stations, 0)
    assert len(told) == len(stations)
    assert site.manager().walk("rtuInitialised") == dict.fromkeys(map(str, sorted(stations)), 1)


@pytest.mark.slow
def test_cyclic_data_waits_for_each_manager_until_it_has_taken_it(site: Site) -> None:
    """It is told when it waits, and not again until somebody has taken it. Nobody takes another's."""
    manager, other = site.manager(), site.manager(ENGINEER)
    mine, others = (list(USERS).index(user) + 1 for user in (CENTRE, ENGINEER))
    base, wait_for = oid("rtuCyclicFloat"), site.desk.gateway.wait_for

    def taken(number: int) -> None:
        manager.set({f"rtuPollCyclicTaken.{mine}": ("u", number)})

    def number_of(name: str) -> int:
        (number,) = manager.get(name)
        assert isinstance(number, int)
        return number

    def waiting(row: int) -> int:
        return number_of(f"rtuPollCyclicWaiting.{row}")

    def turns(count: int) -> None:
        last = number_of("rtuCyclicLast.0")
        wait_for(lambda: number_of("rtuCyclicLast.0") >= last + count, 20.0, f"{count} more turns")

    def tells() -> int:
        return list(manager.walk("rtuEventKind").values()).count(CYCLIC)

    wait_for(lambda: waiting(mine) > 0, 20.0, "cyclic data waits")
    before, told = site.last(), tells()
    rows = manager.rows("snmpbulkwalk", "-Cr40", base)
    found = {row.split(".", 2)[2]: (int(row.split(".")[1]), value) for row, value in rows.items()}
    turn, value = found[METER_POWER]
    assert manager.get(f"rtuMeasuredFloat.{METER_POWER}") == [value]
    deadline = Deadline(30)
    while tells() == told:  # a turn can end before what was the last one is taken
        assert not deadline.over
        taken(number_of("rtuCyclicLast.0"))
    ready = site.received.wait_for("rtuCyclicReady", 1, before)
    assert int(ready[0].value("rtuCyclicLast")) > turn
    turns(1)
    told = tells()
    turns(2)
    assert tells() == told
    assert waiting(others) >= waiting(mine) > 0
    (newer,) = manager.rows("snmpgetnext", f"{base}.{turn}.65535.16777215")
    assert int(newer.split(".")[1]) > turn
    last = number_of("rtuCyclicLast.0")
    for number, user, reason in ((last + 1000, manager, "wrongValue"), (1, other, "noAccess")):
        with pytest.raises(Refused, match=reason):
            user.set({f"rtuPollCyclicTaken.{mine}": ("u", number)})
    with pytest.raises(Refused, match="wrongType"):
        manager.set({f"rtuPollCyclicTaken.{mine}": 1})


def test_class_1_is_polled_by_number(site: Site) -> None:
    manager, row = site.manager(), list(USERS).index(CENTRE) + 1
    last = site.last()
    manager.set({f"rtuPollEventTaken.{row}": ("u", last)})
    site.desk.set_and_scan("6.247", "coils", 0, [0])
    site.desk.set_and_scan("6.247", "coils", 0, [1])
    waiting, newest = manager.get(f"rtuPollEventsWaiting.{row}", "rtuEventLast.0")
    assert isinstance(newest, int) and newest > last
    assert waiting == newest - last
    (first,) = manager.rows("snmpgetnext", f"{oid('rtuEventKind')}.{last}")
    assert first == f"rtuEventKind.{last + 1}"


def test_a_float_is_told_whole(site: Site) -> None:
    octets = site.manager().walk("rtuMeasuredFloat")
    for name, point in site.desk.gateway.points().items():
        if point["type"] == "float" and point["quality"] == "good":
            (number,) = struct.unpack(">f", octets[f"{point['ca']}.{point['ioa']}"])
            assert number == pytest.approx(point["value"], rel=1e-6), name


def test_the_image_says_what_the_tables_say(site: Site) -> None:
    """An interrogation in few octets."""
    manager = site.manager()
    found = {}
    for index, data in manager.walk("rtuImageData").items():
        ca = index.split(".")[0]
        assert len(data) % 12 == 0
        for at in range(0, len(data), 12):
            ioa, kind = int.from_bytes(data[at : at + 3], "big"), data[at + 3]
            found[f"{ca}.{ioa}"] = (kind, data[at + 4 : at + 8], data[at + 8])
    assert {index: kind for index, (kind, _, _) in found.items()} == manager.walk("rtuPointType")
    for index, value in manager.walk("rtuMeasuredFloat").items():
        kind, octets, _ = found[index]
        number = struct.unpack(">f" if kind == 7 else ">i", octets)[0]
        assert number == struct.unpack(">f", value)[0], index


# ---- commands: figures 2 to 6 of the paper -------------------------------------------------------


def test_select_and_execute(site: Site) -> None:
    """Figure 2."""
    manager, before, mark = site.manager(), site.last(), site.desk.lines.mark()
    assert manager.state(BREAKER) == INACTIVE
    manager.wish(BREAKER, SELECT, value=ON)
    assert site.states_told(before, 1) == [ACCEPTED]
    manager.wish(BREAKER, EXECUTE)
    assert site.states_told(before, 3) == [ACCEPTED, EXECUTING, EXECUTED]
    assert manager.get(f"rtuCommandOwner.{BREAKER}", f"rtuCommandResult.{BREAKER}") == [b"centre", DONE]
    manager.wish(BREAKER, INACTIVE)
    assert manager.state(BREAKER) == INACTIVE
    assert site.writes(mark) == 1
    assert site.desk.lines.get("1.10", "coils", 0) == 0 or site.desk.lines.get("1.10", "coils", 1) == 1


@pytest.mark.slow
def test_an_interrupted_selection(site: Site) -> None:
    """Figure 3."""
    manager, before, mark = site.manager(), site.last(), site.desk.lines.mark()
    manager.wish(BREAKER, SELECT, value=OFF)
    assert site.states_told(before, 1) == [ACCEPTED]
    manager.wish(BREAKER, INTERRUPT)
    assert site.states_told(before, 2) == [ACCEPTED, INTERRUPTED]
    manager.wish(BREAKER, INACTIVE)
    assert manager.state(BREAKER) == INACTIVE
    assert site.writes(mark) == 0


@pytest.mark.slow
def test_a_refused_selection(site: Site) -> None:
    """Figure 4: a command from long ago."""
    manager, before = site.manager(), site.last()
    long_ago = (int(time.time() * 1000) - 60_000).to_bytes(8, "big")
    manager.wish(BREAKER, SELECT, value=OFF, issued=long_ago)
    (told,) = site.received.wait_for("rtuCommandChanged", 1, before)
    assert (told.value("rtuCommandState"), told.value("rtuCommandResult")) == (REFUSED_SELECTION, 5)
    manager.wish(BREAKER, INACTIVE)
    assert manager.state(BREAKER) == INACTIVE


@pytest.mark.slow
def test_a_direct_command(site: Site) -> None:
    """Figure 5."""
    manager, before, mark = site.manager(), site.last(), site.desk.lines.mark()
    manager.wish(LAMP, EXECUTE, value=2)
    assert site.states_told(before, 2) == [EXECUTING, EXECUTED]
    manager.wish(LAMP, INACTIVE)
    assert manager.state(LAMP) == INACTIVE
    assert site.writes(mark) == 1


def test_a_refused_command(site: Site) -> None:
    """Figure 6: one that needs a selection."""
    manager, before, mark = site.manager(), site.last(), site.desk.lines.mark()
    manager.wish(BREAKER, EXECUTE, value=ON)
    (told,) = site.received.wait_for("rtuCommandChanged", 1, before)
    assert (told.value("rtuCommandState"), told.value("rtuCommandResult")) == (REFUSED, NOT_SELECTED)
    manager.wish(BREAKER, INACTIVE)
    assert manager.state(BREAKER) == INACTIVE
    assert site.writes(mark) == 0


def test_a_repeated_request_acts_once(site: Site) -> None:
    manager, mark = site.manager(), site.desk.lines.mark()
    spin = manager.spin(LAMP)
    manager.wish(LAMP, EXECUTE, spin=spin, value=2)
    with pytest.raises(Refused, match="inconsistentValue"):
        manager.wish(LAMP, EXECUTE, spin=spin, value=2)
    site.wait_state(LAMP, EXECUTED)
    with pytest.raises(Refused, match="inconsistentValue"):
        manager.wish(LAMP, EXECUTE, value=2)  # of an executed command only inactive may follow
    manager.wish(LAMP, INACTIVE)
    assert site.writes(mark) == 1


@pytest.mark.sample(6)
@pytest.mark.parametrize(
    ("state", "more", "reason"),
    [
        (ACCEPTED, {"value": ON}, "wrongValue"),
        (EXECUTED, {"value": ON}, "wrongValue"),
        (11, {"value": ON}, "wrongValue"),
        (SELECT, {"value": 1}, "wrongValue"),
        (SELECT, {"value": ON, "qualifier": 2}, "wrongValue"),
        (SELECT, {"value": ON, "issued": b"\0" * 7}, "wrongLength"),
        (SELECT, {"value": b"\0"}, "wrongType"),
        (SELECT, {}, "inconsistentValue"),
        (INTERRUPT, {}, "inconsistentValue"),
        (INACTIVE, {}, "inconsistentValue"),
        (SELECT, {"value": ON, "number": 3}, "notWritable"),
    ],
)
def test_a_request_that_cannot_be(site: Site, state: int, more: dict[str, Any], reason: str) -> None:
    manager = site.manager()
    with pytest.raises(Refused, match=reason):
        manager.wish(BREAKER, state, **more)
    assert manager.state(BREAKER) == INACTIVE


def test_all_of_a_request_or_nothing(site: Site) -> None:
    manager, mark = site.manager(), site.desk.lines.mark()
    with pytest.raises(Refused, match="wrongValue"):
        manager.set(
            {
                f"rtuCommandSpinLock.{LAMP}": manager.spin(LAMP),
                f"rtuCommandState.{LAMP}": EXECUTE,
                f"rtuCommandValue.{LAMP}": 2,
                f"rtuCommandSpinLock.{BREAKER}": manager.spin(BREAKER),
                f"rtuCommandState.{BREAKER}": EXECUTED,
            }
        )
    assert (manager.state(LAMP), site.writes(mark)) == (INACTIVE, 0)


@pytest.mark.slow
def test_another_user_has_no_part_in_a_selection(site: Site) -> None:
    manager, other = site.manager(), site.manager(ENGINEER)
    manager.wish(BREAKER, SELECT, value=ON)
    site.wait_state(BREAKER, ACCEPTED)
    for state in (EXECUTE, INTERRUPT, INACTIVE, SELECT):
        with pytest.raises(Refused, match="inconsistentValue"):
            other.wish(BREAKER, state)
    manager.wish(BREAKER, INTERRUPT)
    site.wait_state(BREAKER, INTERRUPTED)


@pytest.mark.slow
def test_a_selection_ends_by_itself_and_is_released(site: Site) -> None:
    """In rtuctl, too."""
    manager, before = site.manager(), site.last()
    manager.wish(BREAKER, SELECT, value=ON)
    assert site.states_told(before, 2) == [ACCEPTED, INTERRUPTED]
    (row,) = site.desk.gateway.query("commands", "feeder10.breaker-command")
    assert row["state"] == "interrupted selection"
    site.wait_state(BREAKER, INACTIVE)


@pytest.mark.slow
@pytest.mark.parametrize("races", [10, pytest.param(1000, marks=pytest.mark.soak)])
def test_of_several_managers_one_acts(site: Site, quick: Quick, races: int) -> None:
    """Two users of SNMP and a controlling station of IEC 60870-5-104 at a time: a write for each who acts."""
    ca, ioa = map(int, LAMP.split("."))
    row = [f"rtuCommand{name}.{LAMP}" for name in ("SpinLock", "State")]

    async def state_of(*wanted: int) -> list[int]:
        deadline = Deadline(20)
        while (found := await quick.get(CENTRE, *row))[1] not in wanted:
            assert not deadline.over, found
            await asyncio.sleep(0.01)
        return found

    async def told(number: int) -> int:
        """The state of the lamp's command that an event tells; 0: it tells something else."""
        columns = ("Kind", "CommonAddress", "ObjectAddress", "Value")
        *what, state = await quick.get(CENTRE, *(f"rtuEvent{column}.{number}" for column in columns))
        return state if what == [COMMAND, ca, ioa] else 0

    async def race() -> None:
        mark = site.desk.lines.mark()
        spin, *_ = await state_of(INACTIVE)
        (seen,) = await quick.get(CENTRE, "rtuEventLast.0")
        confirming = asyncio.to_thread(site.desk.master.command, ca, ioa, "C_SC_NA_1", c104.SingleCmd(True))
        wishes = [quick.wish(user, LAMP, spin, EXECUTE, 2) for user in (CENTRE, ENGINEER)]
        first, second, confirmed = await asyncio.gather(*wishes, confirming)
        assert not (first and second)
        if first or second:
            spin, _ = await state_of(REFUSED, EXECUTED)
            assert await quick.wish(CENTRE if first else ENGINEER, LAMP, spin, INACTIVE)
        await state_of(INACTIVE)
        # A busy host may let a device miss a request, or its answer: a command is refused then, not repeated.
        states: list[int] = []
        deadline = Deadline(20)

        def all_told() -> bool:
            done, refused, begun = (states.count(state) for state in (EXECUTED, REFUSED, EXECUTING))
            return 0 < begun <= done + refused and done <= site.writes(mark) <= begun

        while not all_told():
            assert not deadline.over, (states, site.desk.lines.frames(mark))
            (last,) = await quick.get(CENTRE, "rtuEventLast.0")
            states += [state for number in range(seen + 1, last + 1) if (state := await told(number))]
            seen = last
        assert states.count(EXECUTED) >= confirmed

    for _ in range(races):
        quick.loop.run_until_complete(race())


# ---- totals, parameters, the clock, groups -------------------------------------------------------

METERS, REGISTER = "2020", "2020.30009"
FREEZE, FREEZE_AND_RESET = 1, 2
VOLTAGES = ("2020.30001", "2020.30003")
WRONG, LIMITS = struct.pack(">f", -1.0), (struct.pack(">f", 10.0), struct.pack(">f", 500.0))


def freeze(site: Site, row: str, action: int, **more: int) -> None:
    """Raises Refused. Waits for all that read the totals."""
    manager = site.manager()
    (spin,) = manager.get(f"rtuFreezeSpinLock.{row}")
    assert isinstance(spin, int)
    values: dict[str, int | bytes] = {f"rtuFreezeSpinLock.{row}": spin, f"rtuFreezeAction.{row}": action}
    manager.set(values | {f"rtuFreeze{key.capitalize()}.{row}": value for key, value in more.items()})
    site.desk.gateway.wait_for(
        lambda: manager.get(f"rtuFreezeState.{row}") != [EXECUTING], 20.0, "the totals are frozen"
    )
    assert manager.get(f"rtuFreezeState.{row}", f"rtuFreezeResult.{row}") == [EXECUTED, DONE]


@pytest.mark.slow
def test_a_manager_freezes_what_a_counter_interrogation_reads(site: Site) -> None:
    """And resets it: in both, and not in the meter."""
    manager = site.manager()
    site.desk.set_and_scan("2.20", "input_registers", 8, [19, 5])
    (number,) = manager.get(f"rtuTotalFrozenNumber.{REGISTER}")
    freeze(site, METERS, FREEZE)
    frozen, again = manager.get(f"rtuTotalFrozen.{REGISTER}", f"rtuTotalFrozenNumber.{REGISTER}")
    assert (frozen, again) == ((19 << 16) + 5, (number + 1) % 32)
    by_station = {report.ioa: report.value for report in site.desk.master.interrogate_counters(2020)}
    assert by_station[30009] == frozen
    freeze(site, "65535", FREEZE_AND_RESET)
    assert manager.get(f"rtuTotalValue.{REGISTER}", f"rtuTotalFrozen.{REGISTER}") == [0, frozen]
    assert site.desk.lines.get("2.20", "input_registers", 9) == 5
    for action, group, reason in ((4, 0, "wrongValue"), (0, 0, "wrongValue"), (1, 5, "wrongValue")):
        with pytest.raises(Refused, match=reason):
            freeze(site, METERS, action, group=group)


def load(site: Site, user: User, values: dict[str, int | bytes]) -> None:
    """Parameters with the spin locks of their rows. Raises Refused."""
    manager = site.manager(user)
    rows = {key.partition(".")[2] for key in values}
    spins = {f"rtuParameterSpinLock.{row}": manager.get(f"rtuParameterSpinLock.{row}")[0] for row in rows}
    manager.set(spins | values)


@pytest.mark.slow
def test_parameters_of_a_request_are_in_force_together_or_not_at_all(site: Site) -> None:
    manager, before = site.manager(ENGINEER), site.last()
    low, high = LIMITS
    wanted: dict[str, int | bytes] = {f"rtuParameterLowLimit.{row}": low for row in VOLTAGES}
    wanted |= {f"rtuParameterHighLimit.{row}": high for row in VOLTAGES}
    for name, wrong, reason in (
        ("rtuParameterThreshold", WRONG, "wrongValue"),
        ("rtuParameterThreshold", struct.pack(">f", float("nan")), "wrongValue"),
        ("rtuParameterHighLimit", struct.pack(">f", 9.0), "inconsistentValue"),
        ("rtuParameterHighLimit", b"\0" * 3, "wrongLength"),
        ("rtuParameterCyclic", 1, "inconsistentValue"),
        ("rtuParameterLoaded", b"\0", "notWritable"),
    ):
        with pytest.raises(Refused, match=reason):
            load(site, ENGINEER, wanted | {f"{name}.{VOLTAGES[1]}": wrong})
    with pytest.raises(Refused, match="noAccess"):
        load(site, CENTRE, wanted)
    assert all(manager.get(f"rtuParameterLoaded.{row}") == [NO_BITS] for row in VOLTAGES)
    load(site, ENGINEER, wanted)
    told = site.received.wait_for("rtuParameterChanged", 2, before)
    assert {each.value("rtuParameterHighLimit") for each in told} == {high}
    for row in VOLTAGES:
        state = manager.get(*(f"rtuParameter{name}.{row}" for name in ("LowLimit", "Loaded", "Result")))
        assert state == [low, b"\x30", DONE]


@pytest.mark.slow
def test_limits_move_in_either_direction(site: Site) -> None:
    """The owner takes one after the other; the low one is never above the high one."""
    row = "2020.30005"
    for low, high in ((100.0, 200.0), (300.0, 400.0), (1.0, 2.0)):
        octets = [struct.pack(">f", low), struct.pack(">f", high)]
        load(
            site,
            ENGINEER,
            {f"rtuParameterLowLimit.{row}": octets[0], f"rtuParameterHighLimit.{row}": octets[1]},
        )
        wanted = [*octets, DONE]
        names = [f"rtuParameter{name}.{row}" for name in ("LowLimit", "HighLimit", "Result")]
        site.desk.gateway.wait_for(
            lambda names=names, wanted=wanted: site.manager().get(*names) == wanted, 20.0, f"{low} to {high}"
        )


def set_clock(site: Site, time_ms: int, user: User = CENTRE, **more: int) -> None:
    manager = site.manager(user)
    (spin,) = manager.get("rtuClockSpinLock.0")
    assert isinstance(spin, int)
    values: dict[str, int | bytes] = {
        "rtuClockSpinLock.0": spin,
        "rtuClockSet.0": time_ms.to_bytes(8, "big"),
    }
    manager.set(values | {f"rtuClock{key.capitalize()}.0": value for key, value in more.items()})
    site.desk.gateway.wait_for(lambda: manager.get("rtuClockResult.0") == [DONE], 20.0, "the clock is set")


def clock_ms(site: Site) -> int:
    (octets,) = site.manager().get("rtuClockTime.0")
    assert isinstance(octets, bytes)
    return int.from_bytes(octets, "big")


@pytest.mark.slow
def test_a_manager_sets_the_clock(site: Site) -> None:
    """With what its message was under way; an old message finds another number, and a viewer is refused."""
    before, hour = site.last(), 3_600_000
    began = time.monotonic()
    set_clock(site, hour, delay=5000)
    shown = clock_ms(site) - hour
    assert 5000 <= shown <= 5000 + (time.monotonic() - began) * 1000 + 1
    assert site.received.wait_for("rtuClockChanged", 1, before)[0].value("rtuClockState") == 2
    manager = site.manager()
    (spin,) = manager.get("rtuClockSpinLock.0")
    assert isinstance(spin, int)
    old = {"rtuClockSpinLock.0": spin - 1, "rtuClockSet.0": hour.to_bytes(8, "big")}
    with pytest.raises(Refused, match="inconsistentValue"):
        manager.set(old)
    with pytest.raises(Refused, match="noAccess"):
        set_clock(site, hour, WATCH)
    with pytest.raises(Refused, match="wrongValue"):
        set_clock(site, hour, delay=60_001)
    set_clock(site, int(time.time() * 1000))


@pytest.mark.slow
def test_a_group_is_interrogated_as_iec104_does(site: Site) -> None:
    for group, ca in ((1, 1010), (2, 1010), (3, 2020)):
        rows = site.manager().rows("snmpbulkwalk", "-Cr40", f"{oid('rtuGroupData')}.{group}")
        packed = b"".join(rows.values())
        seen = {int.from_bytes(packed[at : at + 3], "big") for at in range(0, len(packed), 12)}
        assert seen == {report.ioa for report in site.desk.master.interrogate(ca, group)}


@pytest.mark.slow
def test_a_manager_sees_what_a_controlling_station_commands(site: Site) -> None:
    before = site.last()
    ca, ioa = map(int, LAMP.split("."))
    assert site.desk.master.command(ca, ioa, "C_SC_NA_1", c104.SingleCmd(False))
    told = site.received.wait_for("rtuCommandChanged", 2, before)
    assert [each.value("rtuCommandState") for each in told] == [EXECUTING, EXECUTED]
    assert {(each.value("rtuCommandOwner"), each.value("rtuCommandProtocol")) for each in told} == {
        (b"rtu-iec104", 3)
    }


# ---- who may what --------------------------------------------------------------------------------


def test_versions_without_security_have_no_answer(site: Site) -> None:
    for version in ("1", "2c"):
        with pytest.raises(Silent):
            site.manager(timeout_s=1).run("snmpget", oid("rtuStationName.0"), version=version)


@pytest.mark.sample(2)
@pytest.mark.parametrize("level", ["noAuthNoPriv", "authNoPriv"])
def test_without_encryption_nothing_is_told(site: Site, level: str) -> None:
    with pytest.raises(Refused, match="authorizationError"):
        site.manager(level=level).get("rtuStationName.0")


@pytest.mark.parametrize(
    "user",
    [User("nobody", CENTRE.authentication, CENTRE.encryption), User("centre", "wrong-authentic", "x" * 8)],
)
def test_a_stranger_has_no_answer(site: Site, user: User) -> None:
    with pytest.raises((Silent, Refused)):
        site.manager(user, timeout_s=1).get("rtuStationName.0")


def test_a_viewer_only_views(site: Site) -> None:
    viewer = site.manager(WATCH)
    with pytest.raises(Refused, match="noAccess"):
        viewer.wish(BREAKER, SELECT, value=ON)
    assert not viewer.rows("snmpbulkwalk", oid("rtuSinkTable")) or "No Such" in viewer.run(
        "snmpget", oid("rtuSinkName.1")
    )
    assert "No Such" in viewer.run("snmpget", oid("rtuSinkName.1"))


def test_the_tables_of_users_and_views_are_not_there(site: Site) -> None:
    for table in ("1.3.6.1.6.3.15.1.2", "1.3.6.1.6.3.16"):
        assert "No Such" in site.manager(ENGINEER).run("snmpget", f"{table}.2.1.3.0")
    with pytest.raises(Refused, match="noCreation"):
        site.manager(ENGINEER).set({"1.3.6.1.6.3.15.1.2.1.0": 1})


# ---- sizes ---------------------------------------------------------------------------------------


@pytest.mark.sample(3)
@pytest.mark.parametrize("most", [484, 1472, 65507])
def test_an_answer_is_no_longer_than_its_asker_takes(site: Site, most: int) -> None:
    """However much is asked for: through a relay that measures."""
    messages: list[bytes] = []
    with relayed(site.port, messages) as port:
        asked = asyncio.run(bulk(port, most))
    assert len(asked) > 4
    assert min(most, 1472) - 120 < max(map(len, messages)) <= min(most, 1472)


async def bulk(port: int, most: int) -> list[Any]:
    """By pysnmp: 2^31 - 1 repetitions, of a manager that takes messages of that size."""
    engine = SnmpEngine()
    (size,) = engine.get_mib_builder().import_symbols("__SNMP-FRAMEWORK-MIB", "snmpEngineMaxMessageSize")
    size.syntax = size.syntax.clone(most)
    target = await UdpTransportTarget.create(("127.0.0.1", port), timeout=5, retries=0)
    names = [ObjectType(ObjectIdentity(oid(name))) for name in ("rtuPointName", "rtuPointType")]
    failure, status, _, rows = await bulk_cmd(
        engine, secrets_of(CENTRE), target, ContextData(), 0, 2**31 - 1, *names
    )
    engine.close_dispatcher()
    assert (str(failure), int(status)) == ("None", 0)
    return list(rows)


@contextlib.contextmanager
def relayed(port: int, messages: list[bytes]) -> Iterator[int]:
    """A port before the agent's; what passes it is kept."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as relay:
        relay.bind(("127.0.0.1", 0))
        relay.settimeout(0.1)
        done = threading.Event()
        thread = threading.Thread(target=pass_on, args=(relay, port, messages, done))
        thread.start()
        try:
            yield relay.getsockname()[1]
        finally:
            done.set()
            thread.join()


def pass_on(relay: socket.socket, port: int, messages: list[bytes], done: threading.Event) -> None:
    asker = None
    while not done.is_set():
        try:
            octets, source = relay.recvfrom(65535)
        except TimeoutError:
            continue
        messages.append(octets)
        if source[1] == port:
            relay.sendto(octets, asker)
        else:
            asker = source
            relay.sendto(octets, ("127.0.0.1", port))


def test_tshark_with_the_keys_reads_it(site: Site, tmp_path: Path) -> None:
    """A request and its answer, authentic by tshark's own reckoning, decrypted and decoded."""
    messages: list[bytes] = []
    with relayed(site.port, messages) as port:
        name, number = replace(site.manager(), port=port).get(f"rtuPointName.{BREAKER}", "rtuEventLast.0")
    assert isinstance(name, bytes)
    dump, packets = tmp_path / "dump", tmp_path / "packets"
    # Each octet has its line: text2pcap wants no more than the offset.
    lines = ("".join(f"{at:06x} {octet:02x}\n" for at, octet in enumerate(each)) for each in messages)
    dump.write_text("\n".join(lines))
    subprocess.run(["text2pcap", "-q", "-u", "40000,161", dump, packets], check=True)
    words = (CENTRE.name, "SHA2-256", CENTRE.authentication, "AES", CENTRE.encryption)
    users = ",".join([ENGINE, *(f'"{word}"' for word in words)])
    wanted = ("snmp.authentication_ok", "snmp.name", "snmp.value.octets", "snmp.value.g32")
    read = subprocess.run(
        ["tshark", "-r", packets, "-o", f"uat:snmp_users:{users}", "-T", "fields"]
        + [word for field in wanted for word in ("-e", field)],
        capture_output=True,
        text=True,
        check=True,
    )
    names = f"{oid(f'rtuPointName.{BREAKER}')},{oid('rtuEventLast.0')}"
    *_, request, answer = (line.split("\t") for line in read.stdout.splitlines())
    assert request[1] == names
    assert answer[1:] == [names, name.hex(), str(number)]
    assert request[0] and answer[0]


# ---- events --------------------------------------------------------------------------------------


def test_a_change_is_told_with_its_number(site: Site) -> None:
    before = site.last()
    site.desk.set_and_scan("6.247", "coils", 0, [0])
    site.desk.set_and_scan("6.247", "coils", 0, [1])
    changed = [
        (number, each.objects[f"rtuEventValue.{number}"])
        for each in site.received.wait_for("rtuPointChanged", 1, before)
        for number in each.numbers
        if each.objects[f"rtuEventCommonAddress.{number}"] == 6247
    ]
    assert changed[-1][1] in (1, 2)
    rows = site.manager().rows("snmpbulkwalk", "-Cr40", oid("rtuEventValue"))
    assert rows[f"rtuEventValue.{changed[0][0]}"] == changed[0][1]


def test_no_number_is_left_out_or_told_twice_by_an_informed_sink(site: Site) -> None:
    last = site.last()
    site.desk.gateway.wait_for(lambda: last in site.received.numbers(), 20.0, "the sink has all events")
    numbers = sorted(set(site.received.numbers()))
    assert numbers == list(range(1, numbers[-1] + 1))


def waited_s(pid: int | str) -> float:
    """How long a process was ready to run and had no processor: what is the host's doing, not its own."""
    return int(Path(f"/proc/{pid}/schedstat").read_text().split()[1]) / 1e9


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [2, pytest.param(60, marks=pytest.mark.soak)])
def test_a_sink_that_is_killed_gets_all_later_and_disturbs_nobody(
    site: Site, quick: Quick, seconds: int
) -> None:
    """100 events a second go on, memory does not grow with them, and no answer waits for the sink."""
    agent = site.desk.gateway.modules()["rtu-snmp"]["pid"]
    times: list[float] = []

    def memory_kib() -> int:
        status = Path(f"/proc/{agent}/status").read_text()
        return int(re.findall(r"^RssAnon:\s+(\d+) kB", status, re.MULTILINE)[0])

    def last_event() -> int:
        waited, begun = waited_s(agent) + waited_s("thread-self"), time.perf_counter()
        (last,) = quick.loop.run_until_complete(quick.get(CENTRE, "rtuEventLast.0"))
        elapsed = time.perf_counter() - begun
        times.append(elapsed - (waited_s(agent) + waited_s("thread-self") - waited))
        return last

    def make_events(seconds: int, first: int) -> int:
        """Each fifth of a second all registers of a meter change, or as often as its line is read."""
        last = last_event()
        for step in range(5 * seconds):
            again = time.monotonic() + 0.2
            site.desk.lines.set(METER, "input_registers", FIRST, *[first + step] * AT_ONCE)
            site.desk.gateway.wait_for(lambda last=last: last_event() >= last + AT_ONCE, 60.0, "events")
            last = last_event()
            time.sleep(max(0.0, again - time.monotonic()))
        return last

    before = make_events(2, 1)
    kib, after = memory_kib(), len(times)
    site.received.stop()
    last = make_events(seconds, 1000)
    grown, found = memory_kib() - kib, sorted(times[after:])
    site.received.start()
    assert last >= before + 100 * seconds
    # A machine that others use stops now and then; who waits for a sink waits for its timeout, at the least.
    assert found[len(found) * 9 // 10] < GET_S
    assert found[-1] < SINK_TIMEOUT_S
    assert grown <= 512
    site.desk.gateway.wait_for(lambda: last in site.received.numbers(), 120.0, "the sink has all events")
    numbers = sorted(set(site.received.numbers()))
    assert numbers == list(range(1, numbers[-1] + 1))
    print(
        f"{last - before} events, {grown} KiB more, {len(found)} GETs, "
        f"half of them below {found[len(found) // 2] * 1e3:.1f} ms, the slowest {found[-1] * 1e3:.1f} ms"
    )


def test_a_killed_agent_goes_on(site: Site) -> None:
    """Its numbers, its boots, and what a sink has not confirmed."""
    manager = site.manager()
    boots, last = manager.get("1.3.6.1.6.3.10.2.1.2.0", "rtuEventLast.0")
    site.desk.gateway.kill("rtu-snmp")
    gateway = site.desk.gateway
    gateway.wait_for(lambda: gateway.modules()["rtu-snmp"]["restarts"] == 1, 20.0, "it was restarted")
    gateway.wait_for(lambda: gateway.modules()["rtu-snmp"]["alive"], 20.0, "it runs again")
    again, later = manager.get("1.3.6.1.6.3.10.2.1.2.0", "rtuEventLast.0")
    assert again == boots + 1
    assert later >= last
    site.desk.gateway.wait_for(lambda: later in site.received.numbers(), 20.0, "the sink has all events")
    numbers = sorted(set(site.received.numbers()))
    assert numbers == list(range(1, numbers[-1] + 1))


def restarted(site: Site) -> None:
    """rtu-snmp is killed, and runs again."""
    gateway = site.desk.gateway
    before = gateway.modules()["rtu-snmp"]["restarts"]
    gateway.kill("rtu-snmp")
    gateway.wait_for(lambda: gateway.modules()["rtu-snmp"]["restarts"] > before, 20.0, "it was restarted")


@pytest.mark.slow
def test_each_of_20_kills_is_a_boot(site: Site) -> None:
    """Its number is on the disk before anybody gets an answer."""
    gateway, manager, file = site.desk.gateway, site.manager(), site.folder / "state/boots"
    for _ in range(20):
        before = int(file.read_text())
        assert manager.get("1.3.6.1.6.3.10.2.1.2.0") == [before]
        restarted(site)
        gateway.wait_for(lambda: gateway.modules()["rtu-snmp"]["alive"], 20.0, "it runs again")
        assert int(file.read_text()) == before + 1


@pytest.mark.slow
@pytest.mark.parametrize("left", [b"", b"1", b"2147483648\n"], ids=["empty", "cut", "too great"])
def test_a_damaged_number_of_boots_keeps_the_agent_down(site: Site, left: bytes) -> None:
    """Time would begin anew for whoever has kept old messages. The log says what to do."""
    gateway, file = site.desk.gateway, site.folder / "state/boots"
    whole = file.read_bytes()
    file.write_bytes(left)
    before = gateway.ctl("log").count("boots is damaged")
    restarted(site)
    line = f"{file.parent}/boots is damaged: give the gateway another engine ID"
    gateway.wait_for(lambda: gateway.ctl("log").count(line) > before, 20.0, "it says so")
    with pytest.raises(Silent):
        site.manager(timeout_s=1).get("rtuStationName.0")
    file.write_bytes(whole)
    gateway.wait_for(lambda: gateway.modules()["rtu-snmp"]["alive"], 60.0, "it runs again")
    assert site.manager().get("1.3.6.1.6.3.10.2.1.2.0") == [int(whole) + 1]


@pytest.mark.slow
def test_a_line_that_dies_leaves_no_command_open(site: Site) -> None:
    """Its fate is unknown, and nothing is repeated."""
    manager, before = site.manager(), site.last()
    manager.wish(BREAKER, SELECT, value=ON)
    site.wait_state(BREAKER, ACCEPTED)
    site.desk.gateway.kill("rtu-modbus-1")
    assert site.states_told(before, 2)[-1] == INTERRUPTED
    site.desk.wait_all_good(1010)


# ---- what others make of it ----------------------------------------------------------------------


@pytest.mark.slow
def test_prometheus_graphs_it(site: Site, mibs: Path, exporter: Path, tmp_path: Path) -> None:
    """Debian's exporter, with what its generator makes of our example."""
    example = (ROOT / "docs/examples/snmp/generator.yml").read_text()
    for shipped, ours in (
        ("username: graphs", f"username: {WATCH.name}"),
        (" password: changed-by-you", f" password: {WATCH.authentication}"),
        ("changed-by-you-too", WATCH.encryption),
    ):
        assert example.count(f"{shipped}\n") == 1
        example = example.replace(f"{shipped}\n", f"{ours}\n")
    (tmp_path / "generator.yml").write_text(example)
    paths = {"MIBDIRS": f"{mibs}:/usr/share/snmp/mibs:{ROOT / 'package/openrtu/src/snmp'}"}
    generate = [exporter / "prometheus-snmp-generator", "generate"]
    subprocess.run(generate, cwd=tmp_path, env=os.environ | paths, check=True, capture_output=True)
    port = free_port()
    command = [
        exporter / "prometheus-snmp-exporter",
        "--config.file=snmp.yml",
        f"--web.listen-address=127.0.0.1:{port}",
    ]
    with subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.DEVNULL) as server:
        try:
            page = f"http://127.0.0.1:{port}/snmp?target=127.0.0.1:{site.port}&module=openrtu"
            text = fetched(page)
        finally:
            server.kill()
    values = dict(re.findall(r'^rtuMeasuredValue\{.*rtuPointName="([^"]+)".*\} (\S+)$', text, re.MULTILINE))
    for name, point in site.desk.gateway.points().items():
        if point["type"] == "scaled" and point["quality"] == "good":
            assert float(values[name]) == point["value"], name
    assert re.search(r'^rtuCounterValue\{rtuCounterIndex="1",rtuCounterName="', text, re.MULTILINE)


def fetched(page: str) -> str:
    """Waits until somebody listens there."""
    deadline = Deadline(30)
    while True:
        try:
            with urllib.request.urlopen(page, timeout=30) as answer:
                text = answer.read().decode()
                assert isinstance(text, str)
                return text
        except urllib.error.URLError:
            assert not deadline.over, page
            time.sleep(0.05)


# ---- kill -9 in each of the ten states -----------------------------------------------------------

LINE = "rtu-modbus-1"
WISHES = {SELECT: (BREAKER, INACTIVE), INTERRUPT: (BREAKER, ACCEPTED), EXECUTE: (LAMP, INACTIVE)}


def reach(site: Site, state: int) -> str:
    """The row of a command that has this state. Of a wish the line's process is stopped: it stays one."""
    manager = site.manager()
    if state in WISHES:
        row, before = WISHES[state]
        if before == ACCEPTED:
            reach(site, ACCEPTED)
        os.kill(site.desk.gateway.modules()[LINE]["pid"], signal.SIGSTOP)
        value = {} if before == ACCEPTED else {"value": 2}
        manager.wish(row, state, **value)
        return row
    row = LAMP if state in (EXECUTING, EXECUTED) else BREAKER
    if state == EXECUTING:
        site.desk.lines.fault("1.10", "mute")
    if state in (ACCEPTED, INTERRUPTED):
        manager.wish(row, SELECT, value=OFF)
        site.wait_state(row, ACCEPTED)
    if state == INTERRUPTED:
        manager.wish(row, INTERRUPT)
    elif state == REFUSED_SELECTION:
        manager.wish(row, SELECT, value=OFF, issued=(int(time.time() * 1000) - 60_000).to_bytes(8, "big"))
    elif state in (REFUSED, EXECUTING, EXECUTED):
        manager.wish(row, EXECUTE, value=2)
    site.wait_state(row, state)
    return row


@pytest.mark.slow
@pytest.mark.parametrize("state", range(INACTIVE, EXECUTED + 1))
@pytest.mark.parametrize("victim", ["rtu-snmp", LINE])
def test_nothing_is_repeated_or_open_after_a_kill(site: Site, state: int, victim: str) -> None:
    """The device is written to once at most; in the end the row is inactive."""
    gateway, mark = site.desk.gateway, site.desk.lines.mark()
    row = reach(site, state)
    assert site.manager().state(row) == state
    line, before = gateway.modules()[LINE]["pid"], gateway.modules()[victim]["restarts"]
    gateway.kill(victim)
    if victim != LINE and state in WISHES:
        os.kill(line, signal.SIGCONT)
    gateway.wait_for(lambda: gateway.modules()[victim]["restarts"] > before, 30.0, "it was restarted")
    gateway.wait_for(lambda: gateway.modules()[victim]["alive"], 30.0, "it runs again")
    if victim == LINE and state in (ACCEPTED, *WISHES, EXECUTING):
        gateway.wait_for(
            lambda: site.manager().get(f"rtuCommandResult.{row}") == [UNKNOWN_FATE],
            10.0,
            "its fate is unknown",
        )
    site.desk.lines.fault("1.10", "clear")
    gateway.wait_for(lambda: site.is_released(row), 60.0, f"{row} is released")
    site.desk.wait_all_good(1010)
    writes = site.writes(mark)
    executes = state in (EXECUTE, EXECUTING, EXECUTED)
    assert writes <= 1 if executes else writes == 0


# ---- a changed configuration ---------------------------------------------------------------------


@pytest.mark.slow
def test_the_agent_starts_again_with_a_changed_configuration(site: Site) -> None:
    """It knows points by their numbers, which a change moves. Events go on, with the addresses they had."""
    gateway, manager = site.desk.gateway, site.manager()
    running = gateway.config_file.read_text()

    def reload(config: dict[str, Any]) -> str:
        (site.folder / "changed.json").write_text(json.dumps(config))
        return gateway.ctl("reload", str(site.folder / "changed.json"))

    def told() -> list[dict[str, Any]]:
        names = ("CommonAddress", "ObjectAddress", "Type", "Value", "Kind")
        return [
            {index: value for index, value in manager.walk(f"rtuEvent{name}").items() if int(index) <= last}
            for name in names
        ]

    site.desk.set_and_scan("1.10", "discrete_inputs", 4, [0])
    site.desk.set_and_scan("1.10", "discrete_inputs", 4, [1])
    boots, epoch, last = manager.get("1.3.6.1.6.3.10.2.1.2.0", "rtuEventEpoch.0", "rtuEventLast.0")
    before = told()
    assert 1010 in before[0].values()
    count = len(manager.walk("rtuPointName"))
    config = json.loads(running)
    assert "nothing changes" in reload(config)
    config["snmp"]["max_message"] = 65507
    assert "rtu-snmp is started again\n" in reload(config)
    messages: list[bytes] = []
    with relayed(site.port, messages) as port:
        asyncio.run(bulk(port, 65507))
    assert 1472 < max(map(len, messages)) <= 65507
    assert manager.get("1.3.6.1.6.3.10.2.1.2.0") == [boots + 1]
    config["port"][0]["slaves"].pop()
    assert "rtu-snmp is started again\n" in reload(config)
    assert len(manager.walk("rtuPointName")) < count
    assert told() == before
    assert "rtu-snmp is started again\n" in reload(json.loads(running))
    site.desk.gateway.wait_for(lambda: everything_read(gateway), 60.0, "every device is read")
    manager.wish(LAMP, EXECUTE, value=1)
    site.wait_state(LAMP, EXECUTED)
    assert manager.get("1.3.6.1.6.3.10.2.1.2.0") == [boots + 3]
    assert (manager.get("rtuEventEpoch.0"), told()) == ([epoch], before)
    (came,) = site.received.wait_for("rtuStationInitialised", 1, int(last))
    assert (came.value("rtuEventCommonAddress"), came.value("rtuEventValue")) == (1010, 129)
    assert len(site.received.wait_for("rtuStarted", 2, int(last))) == 2
    newest = site.last()
    gateway.wait_for(lambda: newest in site.received.numbers(), 20.0, "the sink has all events")
    assert sorted(set(site.received.numbers())) == list(range(1, max(site.received.numbers()) + 1))
