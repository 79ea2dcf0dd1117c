# SPDX-License-Identifier: GPL-3.0-or-later
"""
Changes of what holds for all modules; modules that command others come, change and go. One gateway runs
through all of it: its line and its station keep their processes, a controlling station its connections.
"""

import json
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import c104
import pytest

from lab.gateway import GatewayError, free_port
from lab.manager import CENTRE, USERS, Manager, free_udp_port, make_keys
from lab.master import Master
from lab.operator import operate
from lab.raw_master import RawMaster
from rig.desk import Desk, gateway_on_lines, patience
from rig.web import make_user

pytestmark = pytest.mark.slow

WAIT_S = 60.0
PATIENCE_MS = 2000
HEARTBEAT_LIMIT_MS = 5000
CA, DEVICE = 1005, "1.5"
LINE, STATION = "rtu-modbus-1", "rtu-iec104"
LAMP, BREAKER, LEVEL = 0, 2, 7  # addresses of two coils and of an input register
C_DC, C_IC, SELECT, ACT_CON, NEGATIVE = 46, 100, 0x80, 7, 0x40
EXECUTE, EXECUTED = 7, 10  # of rtuCommandState

Config = dict[str, Any]


def base() -> Config:
    coils = [{"address": LAMP, "name": "lamp"}, {"address": BREAKER, "type": "double", "select": True}]
    slave = {"id": 5, "coils": coils, "input_registers": [{"address": LEVEL, "name": "level"}]}
    # a device or a new line process that a busy host delays is not dead: its value would be told twice
    slave |= patience(PATIENCE_MS)
    pace = {"baud_rate": 38400, "data_bits": 8, "stop_bits": 1, "parity": 0}
    return {
        "iec104": {"connections_per_address": 8},
        "modbus": {"heartbeat_limit_ms": HEARTBEAT_LIMIT_MS},
        "port": [{"value": 1, "active": 1, **pace, "slaves": [slave]}],
    }


@dataclass
class Running(Desk):
    """What runs, and what it was told so far."""

    sent: list[int] = field(default_factory=list)  # values of the register, in this test
    last: int = 1000
    line_stays: bool = True
    mark: int = 0

    @property
    def folder(self) -> Path:
        return self.gateway.directory

    def take(self, check: bool = True, **more: Any) -> str:
        """The configuration that it began with, and these keys."""
        file = self.folder / "next.json"
        file.write_text(json.dumps(self.gateway.configuration() | more))
        return self.gateway.ctl("reload", str(file), check=check)

    def kept(self) -> tuple[Any, ...]:
        """What no change in these tests may touch."""
        modules = self.gateway.modules()
        peers = sorted((row["peer"], row["started"]) for row in self.gateway.query("iec104", "connections"))
        return modules[LINE]["pid"] if self.line_stays else 0, modules[STATION]["pid"], peers

    def change(self) -> None:
        """A value that nobody had yet."""
        self.last += 1
        self.sent.append(self.last)
        self.set_and_scan(DEVICE, "input_registers", LEVEL, [self.last])

    def wait_told(self) -> None:
        """Each of the values came once, in order."""
        self.master.wait(lambda r: r.ioa == 30001 + LEVEL and r.value == self.last, self.mark)
        reports = [r for r in self.master.reports_since(self.mark) if r.ioa == 30001 + LEVEL]
        assert [r.value for r in reports if r.cause == "SPONTANEOUS"] == self.sent

    def lamp(self) -> int:
        return self.lines.get(DEVICE, "coils", LAMP)

    def command_lamp(self, on: bool) -> None:
        assert self.master.command(CA, 1 + LAMP, "C_SC_NA_1", c104.SingleCmd(on))
        self.gateway.wait_for(lambda: self.lamp() == on, WAIT_S, f"the lamp is {on}")


@pytest.fixture(scope="module")
def running(programs: Path) -> Iterator[Running]:
    with (
        gateway_on_lines(base(), programs, initial={}) as (lines, gateway),
        Master(*gateway.address) as master,
    ):
        desk = Running(lines, gateway, master)
        desk.wait_all_good(CA)
        master.synchronise_clock(CA)
        yield desk


@pytest.fixture
def desk(running: Running) -> Iterator[Running]:
    """Nothing but what it is about has noticed."""
    before, running.mark, running.sent = running.kept(), running.master.mark(), []
    running.change()
    yield running
    running.change()
    running.wait_told()
    running.command_lamp(running.lamp() == 0)
    assert running.kept() == (before if running.line_stays else (0, *before[1:]))
    running.line_stays = True
    assert {row["restarts"] for row in running.gateway.modules().values()} == {0}


# ---- settings of all modules ----------------------------------------------------------------------


def test_forces_are_allowed_and_end_with_the_permission(desk: Running) -> None:
    with pytest.raises(GatewayError, match="force_max_s"):
        desk.gateway.ctl("force", "level", "77", "--for", "10s")
    assert "force_max_s changes for all\n" in desk.take(force_max_s=600)
    desk.gateway.ctl("force", "level", "77", "--for", "10m")
    assert desk.gateway.points()["level"]["value"] == 77
    desk.take()
    desk.gateway.wait_for(lambda: desk.gateway.query("forces") == [], WAIT_S, "nothing is forced")
    desk.mark, desk.sent = desk.master.mark(), []


def test_a_selection_ends_by_the_new_time(desk: Running) -> None:
    """The line, which is asked, goes on with the former configuration."""
    assert "commands changes for all\n" in desk.take(commands={"select_timeout": 1})
    with RawMaster(*desk.gateway.address) as master:
        master.request(C_DC, CA, 1 + BREAKER, bytes([SELECT | 2]))
        assert master.answer(C_DC).cause == ACT_CON
        time.sleep(1.1)  # the time that is tested
        master.request(C_DC, CA, 1 + BREAKER, bytes([2]))
        assert master.answer(C_DC).cause == ACT_CON | NEGATIVE
    assert desk.lines.get(DEVICE, "coils", BREAKER) == 0
    desk.take()


def test_a_selection_holds_while_its_line_is_exchanged(desk: Running) -> None:
    desk.line_stays = False
    config = desk.gateway.configuration()
    config["port"][0]["slaves"].append({"id": 6, "input_registers": [{"address": 0}]})
    for state, changes in ((2, {"port": config["port"]}), (1, {})):
        with RawMaster(*desk.gateway.address) as master:
            master.request(C_DC, CA, 1 + BREAKER, bytes([SELECT | state]))
            assert master.answer(C_DC).cause == ACT_CON
            assert f"{LINE} gets a new process\n" in desk.take(**changes)
            master.request(C_DC, CA, 1 + BREAKER, bytes([state]))
            assert master.answer(C_DC).cause == ACT_CON  # after the device's answer
            coils = [desk.lines.get(DEVICE, "coils", BREAKER + coil) for coil in (0, 1)]
            assert coils == [state == 1, state == 2]


def test_whom_the_clock_is_from_and_where_it_is_shown(desk: Running) -> None:
    """Time tags are as valid as they were, whatever the time zone is."""
    assert "clock changes for all\ntimezone changes for all\n" in desk.take(clock="gateway", timezone="CET-1")
    assert desk.gateway.points()["level"]["quality"] == "good"
    with RawMaster(*desk.gateway.address) as master:
        master.request(C_IC, CA, 0, bytes([20]))
        assert master.answer(C_IC).cause == ACT_CON
    desk.take()


# ---- modules that command -------------------------------------------------------------------------


def test_a_server_of_iec_61850_comes_changes_and_goes(desk: Running) -> None:
    """It commands points of a line that was there before."""
    port = free_port()
    server = {"address": "127.0.0.1", "port": port, "controllers": ["127.0.0.1"]}
    assert "rtu-iec61850 is added\n" in desk.take(iec61850=server)
    lamp = "OpenRTUCA1005/GGIO1.SPCSO1"
    answers = operate(port, lamp, "true", "operate")
    assert answers["operate"]["done"], answers
    assert desk.lamp() == 1
    report = desk.take(iec61850=server | {"control_security": "normal", "report_buffer": 512})
    assert "rtu-iec61850 gets a new process\n" in report
    desk.gateway.wait_for(lambda: operate(port, lamp, "false", "operate")["operate"]["done"], WAIT_S, "again")
    assert desk.lamp() == 0
    report = desk.take(iec61850=server | {"report_buffer": 512})
    assert "rtu-iec61850 is started again\n" in report
    assert "rtu-iec61850 is removed\n" in desk.take()
    assert "rtu-iec61850" not in desk.gateway.modules()


def test_an_agent_of_snmp_comes_and_goes(desk: Running) -> None:
    port, folder = free_udp_port(), desk.folder / "snmp"
    folder.mkdir()
    sink = {"name": "nms", "address": "127.0.0.1", "port": free_udp_port(), "user": CENTRE.name}
    users = [{"name": user.name, "role": role} for user, role in USERS.items()]
    snmp = {"address": "127.0.0.1", "port": port, "users": users, "sinks": [sink]}
    snmp |= {"keys": str(folder / "keys"), "state": str(folder / "state")}
    make_keys(desk.gateway.configuration() | {"snmp": snmp}, folder)
    manager, row = Manager(port, folder), f"{CA}.{1 + LAMP}"
    for _ in range(2):
        assert "rtu-snmp is added\n" in desk.take(snmp=snmp)
        on = 1 - desk.lamp()
        manager.wish(row, EXECUTE, value=on + 1)
        desk.gateway.wait_for(lambda on=on: desk.lamp() == on, WAIT_S, "it was commanded")
        desk.gateway.wait_for(lambda: manager.state(row) == EXECUTED, WAIT_S, "it has ended")
        assert "rtu-snmp is removed\n" in desk.take()


def test_a_page_comes_and_goes(desk: Running) -> None:
    port, users = free_port(), desk.folder / "web.users"
    make_user(users, "operator", "operator")
    page = {"address": "127.0.0.1", "port": port, "users": str(users)}
    for commands in (False, True):
        assert "rtu-web " in desk.take(web=page | {"commands": commands})
        status = urlopen(f"http://127.0.0.1:{port}/", timeout=WAIT_S).status
        assert status == 200
    assert "rtu-web is removed\n" in desk.take()


# ---- the journal ------------------------------------------------------------------------------------


def test_a_journal_comes_moves_and_goes(desk: Running) -> None:
    first, second = desk.folder / "journal", desk.folder / "another"

    def written(folder: Path) -> bool:
        return any(file.stat().st_size for file in folder.iterdir())

    assert "rtu-journal is added\n" in desk.take(journal={"path": str(first)})
    desk.gateway.wait_for(lambda: written(first), WAIT_S, "the journal is written")
    assert "rtu-journal is started again\n" in desk.take(journal={"path": str(second), "interval_s": 3600})
    desk.gateway.wait_for(lambda: written(second), WAIT_S, "it is written at once in its new folder")
    assert "rtu-journal is removed\n" in desk.take()
    assert "rtu-journal" not in desk.gateway.modules()


# ---- what a changed line keeps ------------------------------------------------------------------------


def counted(desk: Running) -> dict[str, int]:
    line = {row["counter"]: row["value"] for row in desk.gateway.query("counters", LINE)}
    ((device, *_),) = (row["devices"] for row in desk.gateway.query("lines"))
    (histogram,) = desk.gateway.query("lines", "--histogram")
    return line | {"device": device["answers"], "transactions": sum(histogram["transactions"]["counts"])}


def test_a_line_counts_on(desk: Running) -> None:
    desk.line_stays = False
    desk.command_lamp(True)
    mark, before = desk.lines.mark(), counted(desk)
    config = desk.gateway.configuration()
    config["port"][0]["slaves"].append({"id": 6, "input_registers": [{"address": 0}]})
    assert f"{LINE} gets a new process\n" in desk.take(port=config["port"])
    during = counted(desk)
    assert f"{LINE} gets a new process\n" in desk.take()
    after = counted(desk)
    growing = ("p1.requests", "p1.answers", "p1.commands", "p1.noise_bytes", "device", "transactions")
    for name in growing:
        assert before[name] <= during[name] <= after[name], name
    asked = sum(frame.kind == "received" for frame in desk.lines.frames(mark))
    assert after["p1.requests"] - before["p1.requests"] <= asked + 1, "none was counted twice"


def test_event_rings_grow_and_shrink_around_what_waits(desk: Running) -> None:
    """A controlling station that is away finds all of it."""
    desk.line_stays = False
    for size in (2048, 1024, 256):
        assert "event_ring changes for all\n" in desk.take(event_ring=size)
        desk.change()
    desk.take()


# ---- redundancy groups --------------------------------------------------------------------------------


def waiting(desk: Running) -> dict[str, int]:
    return {row["name"]: row["waiting"] for row in desk.gateway.query("iec104", "queues") if row["group"]}


def group(name: str, address: str) -> Config:
    return {"name": name, "masters": [address]}


def test_groups_come_and_go_around_one_that_stays(desk: Running) -> None:
    """It keeps what waits for it wherever it stands in the file; a new one begins with what happens then."""
    stays, goes, comes = group("b", "192.0.2.2"), group("a", "192.0.2.1"), group("c", "192.0.2.3")
    assert "redundancy_groups changes for all\n" in desk.take(redundancy_groups=[goes, stays])
    desk.change()
    before = waiting(desk)
    assert before["a"] == before["b"] > 0
    desk.take(redundancy_groups=[stays, comes])
    desk.gateway.wait_for(lambda: set(waiting(desk)) == {"b", "c"}, WAIT_S, "the new group is there")
    assert (waiting(desk)["b"], waiting(desk)["c"]) == (before["b"], 0)
    desk.change()
    desk.gateway.wait_for(lambda: waiting(desk)["c"] > 0, WAIT_S, "events wait for it")
    desk.take(redundancy_groups=[comes, goes])
    desk.gateway.wait_for(lambda: set(waiting(desk)) == {"a", "c"}, WAIT_S, "it is as new")
    assert waiting(desk)["a"] == 0 < waiting(desk)["c"]
    desk.take()
    desk.gateway.wait_for(lambda: waiting(desk) == {}, WAIT_S, "there is none")


def queues(desk: Running) -> dict[str, int]:
    """How many events wait, in groups and for addresses."""
    return {row["name"]: row["waiting"] for row in desk.gateway.query("iec104", "queues")}


def test_what_waits_for_a_master_goes_with_it_into_a_new_group(desk: Running) -> None:
    """From its address into one, and into another; nobody else has it, and it comes once."""
    moved, other = "127.0.9.1", "127.0.9.2"
    for address in (moved, other):
        with RawMaster(*desk.gateway.address, source=address):
            pass
    desk.change()
    before = queues(desk)
    assert before[moved] == before[other] > 0
    desk.take(redundancy_groups=[group("first", moved)])
    desk.gateway.wait_for(lambda: "first" in queues(desk), WAIT_S, "the group is there")
    now = queues(desk)
    assert (now["first"], now[other], moved in now) == (before[moved], before[other], False)
    desk.change()
    desk.take(redundancy_groups=[group("second", moved), group("third", "127.0.9.3")])
    desk.gateway.wait_for(lambda: set(waiting(desk)) == {"second", "third"}, WAIT_S, "and another")
    assert (waiting(desk)["second"], waiting(desk)["third"]) == (queues(desk)[other], 0)
    told = []
    with RawMaster(*desk.gateway.address, source=moved) as master:
        deadline = time.monotonic() + WAIT_S
        while len(told) < 2:
            told += [o.value for o in master.spontaneous(deadline) if o.ioa == 30001 + LEVEL]
    assert told == desk.sent[1:]
    desk.take()


def test_a_ninth_group_is_refused_while_eight_go(desk: Running) -> None:
    """Queues that go are told from those that come; when they are gone there is room."""
    eight = [group(f"g{i}", f"192.0.2.{10 + i}") for i in range(8)]
    ninth = group("ninth", "192.0.2.20")
    desk.take(redundancy_groups=eight)
    desk.gateway.wait_for(lambda: len(waiting(desk)) == 8, WAIT_S, "all are there")
    with pytest.raises(GatewayError, match="there is no room for ninth beside the groups that go"):
        desk.take(redundancy_groups=[*eight[1:], ninth])
    assert set(waiting(desk)) == {row["name"] for row in eight}
    desk.take(redundancy_groups=eight[1:])
    desk.take(redundancy_groups=[*eight[1:], ninth])
    desk.gateway.wait_for(lambda: "ninth" in waiting(desk), WAIT_S, "there is room")
    desk.take()
    desk.gateway.wait_for(lambda: waiting(desk) == {}, WAIT_S, "there is none")
