# SPDX-License-Identifier: GPL-3.0-or-later
"""Commands of modules that others wrote: of their own points by masters, and of others' points."""

import copy
import datetime
import json
import re
import struct
import subprocess
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from lab.gateway import Gateway, free_port, listening_on, remove, run_directory
from lab.modules import place, program
from lab.raw_master import Asdu, RawMaster
from rig.cp56 import cp56

FIXTURES = Path(__file__).resolve().parents[1] / "fixtures/foreign"
VALVE, DRIVE = 911, 912  # common addresses
C_SC, C_DC, C_RC, C_SE_NA, C_SE_NB, C_SE_NC, C_BO = 45, 46, 47, 48, 49, 50, 51
LOWER, HIGHER = 1, 2
C_CI, C_CS = 101, 103
M_IT, M_IT_TAGGED, M_ME_TAGGED, M_ST_TAGGED = 15, 37, 35, 32
TAGGED = 13  # 58 is 45 with a time tag, and so on
ACT, ACT_CON, DEACT, DEACT_CON, ACT_TERM = 6, 7, 8, 9, 10
RETURN_REMOTE, RETURN_LOCAL = 11, 12
NEGATIVE, SELECT = 0x40, 0x80
SHORT = 1 << 2
PATIENCE_S = 60.0
SINGLE, DOUBLE, SELECTED, NORMALIZED, SCALED, FLOAT, BITS, PASSED_ON, PLAIN, COUNT = range(1, 11)
TAP = 20
M_TAGGED = {
    SINGLE: 30,
    DOUBLE: 31,
    SELECTED: 30,
    NORMALIZED: 34,
    SCALED: 35,
    FLOAT: 36,
    BITS: 33,
    PASSED_ON: 35,
}
TYPES = {
    "single": {"short_pulse_ms": 100},
    "double": {},
    "selected": {"type": "single", "select": True},
    "normalized": {},
    "scaled": {},
    "float": {},
    "bitstring": {},
    "passed-on": {"type": "scaled"},
    "plain": {"type": "single", "command": False},
}


def modules(directory: Path) -> list[dict[str, Any]]:
    points = [
        {"name": f"valve.{name}", "type": name, "ioa": ioa, "command": True} | keys
        for ioa, (name, keys) in enumerate(TYPES.items(), 1)
    ]
    points.append({"name": "valve.count", "type": "counter", "ioa": COUNT, "counter_group": 2})
    points.append({"name": "valve.sent", "type": "counter", "ioa": COUNT + 1, "freeze_s": 1})
    points.append({"name": "valve.tap", "type": "step", "ioa": TAP, "command": True, "initial": 62})
    valve = {
        "name": "valve",
        "program": program(directory, "valve", FIXTURES / "valve.py"),
        "period_ms": 20,
        "ca": VALVE,
        "points": points,
        "reads": ["drive*"],
        "commands": ["drive", "drive-kept"],
        "config": {"file": str(directory / "valve.json")},
    }
    drive = {
        "name": "drive",
        "program": program(directory, "drive", FIXTURES / "drive.py"),
        "period_ms": 10,
        "ca": DRIVE,
        "points": [
            {"name": "drive", "type": "scaled", "ioa": 1, "command": True, "select": True, "initial": 0},
            {"name": "drive-kept", "type": "scaled", "ioa": 2, "command": True, "initial": 0, "retain": True},
        ],
        "config": {"file": str(directory / "drive.json")},
    }
    listener = {
        "name": "listener",
        "program": program(directory, "listener", FIXTURES / "listener.py"),
        "period_ms": 50,
        "reads": ["drive*", "valve.count"],
        "config": {"file": str(directory / "listener.json")},
    }
    return [module | {"heartbeat_limit_ms": 5000} for module in (valve, drive, listener)]


@dataclass
class Plant:
    """A gateway with a valve that takes commands and passes one on to a drive."""

    gateway: Gateway

    def say(self, name: str, **words: Any) -> None:
        """In one step: a module reads the file at any time."""
        fresh = self.gateway.directory / f"{name}.new"
        fresh.write_text(json.dumps(words))
        fresh.rename(self.gateway.directory / f"{name}.json")

    def wait_log(self, text: str) -> None:
        self.gateway.wait_for(lambda: text in self.gateway.log(10_000), PATIENCE_S, f"the log has {text!r}")

    def wait_point(self, name: str, value: Any) -> None:
        def there() -> bool:
            point = self.gateway.points(name)[name]
            return (point["value"], point["quality"]) == (value, "good")

        self.gateway.wait_for(there, PATIENCE_S, f"{name} is {value}, good")

    def result(self, name: str) -> tuple[str, str]:
        """State and result of a point's command, as anyone sees them."""
        row = {row["name"]: row for row in self.gateway.query("commands")}[name]
        return str(row["state"]), str(row["result"])


@pytest.fixture(scope="module")
def running(programs: Path) -> Iterator[Plant]:
    directory = run_directory()
    try:
        place(directory, programs)
        for name in ("valve", "drive", "listener"):
            (directory / f"{name}.json").write_text("{}")
        config = listening_on({"port": [], "modules": modules(directory)}, free_port())
        config |= {"commands": {"command_timeout": 2}, "event_ring": 64}
        with Gateway(config, directory, programs) as gateway:
            yield Plant(gateway)
    finally:
        remove(directory)


@pytest.fixture
def plant(running: Plant) -> Plant:
    running.say("valve")
    running.say("drive")
    running.say("listener")
    running.gateway.wait_for(
        lambda: all(row["alive"] for row in running.gateway.modules().values() if row["name"] != "rtuctl"),
        PATIENCE_S,
        "all modules run",
    )
    return running


@pytest.fixture
def master(plant: Plant) -> Iterator[RawMaster]:
    with RawMaster(*plant.gateway.address) as master:
        master.request(
            C_CS, VALVE, 0, cp56(datetime.datetime.now(datetime.UTC))
        )  # or no time tag would be believed
        assert master.answer(C_CS).cause == ACT_CON
        yield master


def until(master: RawMaster, kind: int, cause: int) -> list[Asdu]:
    """What arrives until a command of that type is answered with that cause, or refused."""
    seen: list[Asdu] = []
    while not seen or seen[-1].type != kind or seen[-1].cause not in (cause, ACT_CON | NEGATIVE):
        seen.append(master.next_asdu(time.monotonic() + PATIENCE_S))
    return seen


def heads(asdus: list[Asdu]) -> list[tuple[int, int]]:
    """Without what is spontaneous."""
    return [(asdu.type, asdu.cause) for asdu in asdus if asdu.cause != 3]


# ---- of own points -------------------------------------------------------------------------------

HALF = struct.pack("<hB", 0x4000, 0)
COMMANDS = [
    (C_SC, SINGLE, b"\x01", b"\x01"),
    (C_DC, DOUBLE, b"\x02", b"\x02"),
    (C_SE_NA, NORMALIZED, HALF, HALF),
    (C_SE_NB, SCALED, b"\x23\x00\x00", b"\x23\x00\x00"),
    (C_SE_NC, FLOAT, struct.pack("<fB", 1.5, 0), struct.pack("<fB", 1.5, 0)),
    (C_BO, BITS, b"\x78\x56\x34\x12", b"\x78\x56\x34\x12\0"),
]


@pytest.mark.parametrize("tagged", [False, True], ids=["", "tagged"])
@pytest.mark.parametrize(("kind", "ioa", "body", "value"), COMMANDS, ids=lambda value: str(value)[:2])
def test_master_commands_a_modules_point(
    plant: Plant, master: RawMaster, kind: int, ioa: int, body: bytes, value: bytes, tagged: bool
) -> None:
    """Direct: confirmation, return information, termination."""
    sent, information = (
        (kind + TAGGED, body + cp56(datetime.datetime.now(datetime.UTC))) if tagged else (kind, body)
    )
    master.request(sent, VALVE, ioa, information)
    answers = until(master, sent, ACT_TERM)
    assert heads(answers) == [(sent, ACT_CON), (M_TAGGED[ioa], RETURN_REMOTE), (sent, ACT_TERM)]
    returned = next(asdu for asdu in answers if asdu.cause == RETURN_REMOTE)
    assert returned.body[:-7] == ioa.to_bytes(3, "little") + value


def test_regulating_steps_of_a_modules_point(plant: Plant, master: RawMaster) -> None:
    """Each says where the point is then, as far as its type goes; RCS 0 and 3 say nothing."""
    for rcs, position in ((HIGHER, 63), (HIGHER, 63), (LOWER, 62)):
        master.request(C_RC, VALVE, TAP, bytes([rcs]))
        answers = until(master, C_RC, ACT_TERM)
        assert heads(answers) == [(C_RC, ACT_CON), (M_ST_TAGGED, RETURN_REMOTE), (C_RC, ACT_TERM)]
        returned = next(asdu for asdu in answers if asdu.cause == RETURN_REMOTE)
        assert returned.body[:5] == TAP.to_bytes(3, "little") + bytes([position, 0])
        plant.wait_log(f"step of valve.tap: {1 if rcs == HIGHER else -1}")
    for rcs in (0, 3):
        master.request(C_RC, VALVE, TAP, bytes([rcs]))
        assert heads(until(master, C_RC, ACT_TERM)) == [(C_RC, ACT_CON | NEGATIVE)]
    plant.gateway.ctl("set", "valve.tap", "7")
    plant.wait_point("valve.tap", 7)
    master.request(C_RC, VALVE, SCALED, bytes([HIGHER]))
    assert master.answer(C_RC).cause & 0x3F == 47


def test_selection_is_judged_by_the_module(plant: Plant, master: RawMaster) -> None:
    master.request(C_SC, VALVE, SELECTED, b"\x01")  # without a selection
    assert heads(until(master, C_SC, ACT_CON)) == [(C_SC, ACT_CON | NEGATIVE)]
    for value in (1, 0):
        master.request(C_SC, VALVE, SELECTED, bytes([SELECT | value]))
        assert heads(until(master, C_SC, ACT_CON)) == [(C_SC, ACT_CON)]
        plant.wait_log(f"selection of valve.selected: {bool(value)}")
        master.request(C_SC, VALVE, SELECTED, bytes([value]))
        assert heads(until(master, C_SC, ACT_TERM))[-1] == (C_SC, ACT_TERM)
        plant.wait_point("valve.selected", "on" if value else "off")
    plant.say("valve", refuse=6)
    # The module reads the file in each scan: it has by the time it has seen another command.
    master.request(C_SC, VALVE, SINGLE, b"\x00")
    while heads(until(master, C_SC, ACT_TERM))[-1] != (C_SC, ACT_CON | NEGATIVE):
        master.request(C_SC, VALVE, SINGLE, b"\x00")
    master.request(C_SC, VALVE, SELECTED, bytes([SELECT | 1]))
    assert heads(until(master, C_SC, ACT_CON)) == [(C_SC, ACT_CON | NEGATIVE)]


def test_selection_is_cancelled(plant: Plant, master: RawMaster) -> None:
    master.request(C_SC, VALVE, SELECTED, bytes([SELECT | 1]))
    assert heads(until(master, C_SC, ACT_CON)) == [(C_SC, ACT_CON)]
    master.request(C_SC, VALVE, SELECTED, bytes([SELECT | 1]), cause=DEACT)
    assert heads(until(master, C_SC, DEACT_CON)) == [(C_SC, DEACT_CON)]
    master.request(C_SC, VALVE, SELECTED, b"\x01")
    assert heads(until(master, C_SC, ACT_CON)) == [(C_SC, ACT_CON | NEGATIVE)]


def test_pulse_is_the_modules(plant: Plant, master: RawMaster) -> None:
    """It begins, is confirmed, and ends; another command has to wait for that."""
    master.request(C_SC, VALVE, SINGLE, bytes([SHORT | 1]))
    assert heads(until(master, C_SC, ACT_CON))[0] == (C_SC, ACT_CON)
    assert heads(until(master, C_SC, ACT_TERM))[-1] == (C_SC, ACT_TERM)
    plant.wait_point("valve.single", "off")
    assert "command of valve.single: True, 100 ms, False" in plant.gateway.log(10_000)
    master.request(C_DC, VALVE, DOUBLE, bytes([SHORT | 1]))  # it has no short pulse
    assert heads(until(master, C_DC, ACT_CON)) == [(C_DC, ACT_CON | NEGATIVE)]


def test_local_command_is_told_apart(plant: Plant, master: RawMaster) -> None:
    plant.gateway.ctl("set", "valve.scaled", "12")
    while (asdu := master.next_asdu(time.monotonic() + PATIENCE_S)).cause != RETURN_LOCAL:
        assert asdu.cause == 3
    plant.wait_log("command of valve.scaled: 12, 0 ms, True")


def test_module_that_refuses_says_why(plant: Plant) -> None:
    plant.say("valve", refuse=6)

    def refused() -> bool:
        plant.gateway.ctl("set", "valve.scaled", "13", check=False)
        return plant.result("valve.scaled") == ("refused command", "interlock")

    plant.gateway.wait_for(refused, PATIENCE_S, "the module has refused")


@pytest.mark.slow
def test_module_that_does_not_look_ends_in_a_time_out(plant: Plant, master: RawMaster) -> None:
    plant.say("valve", deaf=True)
    plant.gateway.wait_for(
        lambda: "valve" in plant.gateway.modules(), PATIENCE_S, "the module has seen the file"
    )
    begun = time.monotonic()
    answers: list[tuple[int, int]] = []
    while (C_SC, ACT_CON | NEGATIVE) not in answers:  # it may not have read its file at first
        begun = time.monotonic()
        master.request(C_SC, VALVE, SINGLE, b"\x01")
        answers = heads(until(master, C_SC, ACT_TERM))
    assert time.monotonic() - begun >= 1.9  # command_timeout
    plant.say("valve")


def test_point_without_command_takes_none(plant: Plant, master: RawMaster) -> None:
    master.request(C_SC, VALVE, PLAIN, b"\x01")
    assert master.answer(C_SC).cause & 0x3F == 47


@pytest.mark.slow
def test_command_of_a_module_that_died_is_of_unknown_fate(plant: Plant) -> None:
    """Killed while it executes, and the pulse that it has begun is nobody's."""
    plant.say("valve", deaf=True)
    setting = subprocess.Popen([*plant.gateway.rtuctl, "set", "valve.single", "1"], stdout=subprocess.DEVNULL)
    try:
        plant.gateway.wait_for(
            lambda: plant.result("valve.single")[0] == "executing command", PATIENCE_S, "it executes"
        )
        plant.gateway.kill("valve")
        assert setting.wait(PATIENCE_S) != 0
    finally:
        setting.kill()
    plant.say("valve")

    def done() -> bool:
        plant.gateway.ctl("set", "valve.single", "1", check=False)
        return plant.result("valve.single")[0] in ("executed command", "inactive command")

    plant.gateway.wait_for(done, PATIENCE_S, "the next process takes commands")


# ---- of others' points ---------------------------------------------------------------------------


def test_module_passes_a_command_on(plant: Plant, master: RawMaster) -> None:
    """With a selection, and the answer of the other module is the command's own."""
    master.request(C_SE_NB, VALVE, PASSED_ON, b"\x2a\x00\x00")
    answers = heads(until(master, C_SE_NB, ACT_TERM))
    assert (C_SE_NB, ACT_TERM) in answers
    assert (M_TAGGED[PASSED_ON], RETURN_REMOTE) in answers
    plant.wait_point("drive", 42)
    plant.wait_log("valve info: drive: DONE")


def test_refusal_of_the_device_comes_back(plant: Plant, master: RawMaster) -> None:
    plant.say("drive", broken=True)

    def refused() -> bool:
        master.request(C_SE_NB, VALVE, PASSED_ON, b"\x01\x00\x00")
        return heads(until(master, C_SE_NB, ACT_TERM))[-1] == (C_SE_NB, ACT_CON | NEGATIVE)

    plant.gateway.wait_for(refused, PATIENCE_S, "the drive has refused")
    plant.wait_log("valve info: drive: EXCEPTION")
    assert plant.result("valve.passed-on")[1] == "exception"


def test_owner_that_is_not_there_refuses(plant: Plant, master: RawMaster) -> None:
    """A command that may have been carried out ends with an unknown fate, or it is not posted at all."""
    plant.gateway.kill("drive")
    master.request(C_SE_NB, VALVE, PASSED_ON, b"\x02\x00\x00")
    answers = heads(until(master, C_SE_NB, ACT_TERM))
    assert answers[-1] in ((C_SE_NB, ACT_TERM), (C_SE_NB, ACT_CON | NEGATIVE))
    plant.wait_point("drive", 0 if answers[-1][1] != ACT_TERM else 2)


# ---- what outlives a process ---------------------------------------------------------------------


def test_retained_point_goes_on(plant: Plant, master: RawMaster) -> None:
    """And whoever has seen it turn invalid sees that; a busy station may look only when it is back."""
    plant.gateway.ctl("set", "drive", "30", "--select")
    plant.gateway.ctl("set", "drive-kept", "31")
    restarts = plant.gateway.modules()["drive"]["restarts"]
    plant.gateway.kill("drive")
    plant.gateway.wait_for(
        lambda: plant.gateway.modules()["drive"]["restarts"] > restarts, PATIENCE_S, "it was killed"
    )
    plant.wait_point("drive", 0)  # initial
    plant.wait_point("drive-kept", 31)
    plant.gateway.ctl("set", "drive-kept", "32")
    told: list[tuple[int, int]] = []
    while (32, 0) not in told:
        body = master.answer(M_ME_TAGGED).body
        for octets in (body[begin : begin + 13] for begin in range(0, len(body), 13)):
            if octets.startswith(b"\x02\x00\x00"):
                told.append((int.from_bytes(octets[3:5], "little"), octets[5]))
    since = [(value if not quality else None, quality) for value, quality in told[told.index((31, 0)) + 1 :]]
    assert since in ([(None, 0x80), (31, 0), (32, 0)], [(31, 0), (32, 0)], [(32, 0)])


@pytest.mark.slow
def test_reload_exchanges_a_module_between_two_scans(plant: Plant, master: RawMaster) -> None:
    """Its retained point passes over, and no master is told that it was invalid, nor loses its connection."""
    gateway = plant.gateway
    gateway.ctl("set", "drive-kept", "31")
    plant.wait_point("drive-kept", 31)
    before, config = gateway.modules(), gateway.configuration()
    changed = copy.deepcopy(config)
    next(module for module in changed["modules"] if module["name"] == "drive")["period_ms"] = 15
    try:
        gateway.ctl("reload", gateway.put(changed))
        after = gateway.modules()
        assert after["drive"]["pid"] != before["drive"]["pid"]
        assert after["drive"]["restarts"] == before["drive"]["restarts"]
        assert after["rtu-iec104"]["pid"] == before["rtu-iec104"]["pid"]
        plant.wait_point("drive-kept", 31)
        gateway.ctl("set", "drive-kept", "32")
        seen: list[tuple[int, int]] = []
        while (32, 0) not in seen:
            body = master.answer(M_ME_TAGGED).body
            for octets in (body[begin : begin + 13] for begin in range(0, len(body), 13)):
                if octets.startswith(b"\x02\x00\x00"):
                    seen.append((int.from_bytes(octets[3:5], "little", signed=True), octets[5]))
        assert set(seen) <= {(31, 0), (32, 0)}
    finally:
        gateway.ctl("reload", gateway.put(config))


# ---- events --------------------------------------------------------------------------------------


@pytest.mark.slow
def test_events_are_heard_in_order_and_once(plant: Plant) -> None:
    """More of them than scans of who hears them."""
    values = list(range(700, 712))
    for value in values:
        plant.gateway.ctl("set", "drive", str(value), "--select")
    plant.wait_log("event: drive 711 0")
    log = plant.gateway.log(10_000)
    assert re.findall(r"event: drive (7\d\d) 0", log) == [str(value) for value in values]
    assert "goes back" not in log


def test_end_of_a_module_is_an_event_of_its_points(plant: Plant) -> None:
    plant.gateway.ctl("set", "drive", "0", "--select")
    invalid = plant.gateway.log(10_000).count("event: drive 0 128")
    plant.gateway.kill("drive")
    plant.gateway.wait_for(
        lambda: plant.gateway.log(10_000).count("event: drive 0 128") > invalid, PATIENCE_S, "it is heard"
    )
    plant.wait_point("drive", 0)


@pytest.mark.slow
def test_lost_events_are_counted_and_shown(plant: Plant) -> None:
    """The count of the valve changes in each of its scans, and its ring keeps 63."""
    plant.say("listener", sleep_s=1.9)
    plant.wait_log("listener info: lost")
    assert plant.gateway.modules()["listener"]["lost_events"] > 0


# ---- counters ------------------------------------------------------------------------------------


def frozen(master: RawMaster, qualifier: int) -> list[tuple[int, int, int]]:
    """Address, reading and sequence notation of what a counter interrogation brings."""
    master.request(C_CI, VALVE, 0, bytes([qualifier]))
    seen = [asdu for asdu in until(master, C_CI, ACT_TERM) if asdu.type == M_IT]
    return [
        (int.from_bytes(a.body[:3], "little"), int.from_bytes(a.body[3:7], "little", signed=True), a.body[7])
        for a in seen
    ]


@pytest.mark.slow
def test_counter_is_frozen_and_reset(plant: Plant, master: RawMaster) -> None:
    """QCC: freeze with reset of group 2 (FRZ 2), then read it; the module counts a scan each."""
    master.request(C_CI, VALVE, 0, bytes([2 << 6 | 2]))
    assert master.answer(C_CI).cause == ACT_CON
    first = frozen(master, 2)
    assert [ioa for ioa, _, _ in first] == [COUNT]
    count = plant.gateway.points("valve.count")["valve.count"]["value"]
    plant.gateway.wait_for(
        lambda: plant.gateway.points("valve.count")["valve.count"]["value"] > count + 3,
        PATIENCE_S,
        "it counts",
    )
    master.request(C_CI, VALVE, 0, bytes([2 << 6 | 2]))
    assert master.answer(C_CI).cause == ACT_CON
    second = frozen(master, 2)
    assert second[0][1] >= 4
    assert (second[0][2] & 0x1F) == (first[0][2] & 0x1F) + 1
    assert plant.gateway.points("valve.count")["valve.count"]["value"] < count + second[0][1]


@pytest.mark.slow
def test_counter_is_frozen_by_the_clock(plant: Plant, master: RawMaster) -> None:
    address = (COUNT + 1).to_bytes(3, "little")
    sequences: list[int] = []
    while len(sequences) < 2:
        body = master.answer(M_IT_TAGGED).body
        objects = [body[begin : begin + 15] for begin in range(0, len(body), 15)]
        sequences += [octets[7] & 0x1F for octets in objects if octets.startswith(address)]
    assert sequences[1] == (sequences[0] + 1) % 32
