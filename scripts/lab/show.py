# SPDX-License-Identifier: GPL-3.0-or-later
"""The steps that each show has, on any gateway; and `make run-native`, which runs all of it on this machine.

The set-up is that of the project report, chapter 5.

Exit code 0: every step succeeded; 1: one did not, with the reason.
"""

from __future__ import annotations

import argparse
import contextlib
import datetime
import functools
import itertools
import json
import signal
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import c104

from lab import drive, kept, managed, operator, ports
from lab.errors import LabError
from lab.gateway import (
    HEARTBEAT_LIMIT_MS,
    REPOSITORY,
    Gateway,
    Rtu,
    default_build,
    free_port,
    listening_on,
    remove,
    run_directory,
)
from lab.linesim import Frame, LineSim
from lab.managed import Managed
from lab.manager import free_udp_port
from lab.master import Master, Report
from lab.modules import EXAMPLES, compiled, place, program
from lab.verdict import Verdict, run
from openrtu_tools.cli import main as openrtu

CHAPTER_5 = REPOSITORY / "tests" / "fixtures" / "chapter5"
STATION = 3067  # port 3, slave 67
DEVICE = "3.67"
LEVEL = ("input_registers", 2)  # of that device, for the modules of others
MODULES = (921, 922, 923)  # their stations
SOURCES = REPOSITORY / "docs/examples/logic"
INTERLOCK, FILLING = 931, 932
PROGRAMS = {"interlock": INTERLOCK, "filling": FILLING}  # their stations
LIMIT = 90  # of the sequence
ORDER = "order"  # has no value until somebody gives one
BREAKER, EARTHED = ("coils", 3), ("discrete_inputs", 0)  # of the device
PUMPING_STATION, PUMP = "5.50", ("coils", 1)
NEWCOMER = "5.51"
SWITCH, SBO_ENHANCED = "OpenRTUCA1010/GGIO1.DPCSO1", 4  # with selection; its ctlModel

# Figure 5.6, rows 1 to 13: what the interrogation of CA 3067 brought.
FIGURE_5_3: dict[int, int] = {
    **{1: 1, 2: 0, 3: 1, 4: 0},
    **{10001: 1, 10002: 0, 10003: 0},
    **{30001: 1495, 30002: 98, 30003: 30},
    **{40001: 1500, 40002: 100, 40003: 0},
}
FIGURE_5_5 = bytes([67, 5, 0, 3, 255, 0, 115, 24])
FIGURE_5_8 = bytes([67, 6, 0, 2, 0, 255, 103, 104])

# Patience with a busy host: what it lets wait is no dead device and no dead module.
RESPONSE_MS = 5000  # a command is not repeated
RETRIES = 1
PROBE_MAX_S = 2
MODULE_LIMIT_MS = 2000
DEADLINE_S = 120.0  # for what takes a second on an idle host

TYPES_OF_TABLE_4_1 = {
    "M_SP_NA_1",
    "M_DP_NA_1",
    "M_ME_NA_1",
    "M_ME_NB_1",
    "M_ME_NC_1",
    "M_ST_NA_1",
    "M_BO_NA_1",
}


class NotSeenError(LabError):
    """Something of the show did not happen as it should."""


def configuration() -> dict[str, Any]:
    """Chapter 5 with patience. A device that comes back is seen soon, however often it was probed."""
    config: dict[str, Any] = json.loads((CHAPTER_5 / "gateway.json").read_text())
    config["modbus"] = {"heartbeat_limit_ms": HEARTBEAT_LIMIT_MS}
    for slave in (slave for port in config["port"] for slave in port["slaves"] if slave["id"]):
        slave |= {
            "response_timeout_ms": RESPONSE_MS,
            "response_timeout_min_ms": RESPONSE_MS,
            "retries": RETRIES,
            "probe_max_s": PROBE_MAX_S,
        }
    return config


def name_level(config: dict[str, Any]) -> None:
    """A register of the device is the level of a tank, for programs and modules of others."""
    slaves = [slave for port in config["port"] for slave in port["slaves"] if slave["id"] == 67]
    for register in slaves[0]["input_registers"]:
        if register["address"] == LEVEL[1]:
            register["name"] = "tank.level"


def add_modules(config: dict[str, Any], directory: Path, build: Path) -> None:
    """Three modules of others, in Python and C, around the level of the tank."""
    place(directory, build)
    settings = {"low": 20, "high": 40, "full": 90}
    point = {"ioa": 1, "type": "single"}
    programs = {
        "pump": (program(directory, "pump", EXAMPLES / "pump.py"), {"name": "pump"}),
        "filter": (
            compiled(directory, "filter", EXAMPLES / "filter.c"),
            {"name": "tank.level-smooth", "type": "float"},
        ),
        "guard": (
            program(directory, "guard", EXAMPLES / "guard.py"),
            {"name": "pump-2", "command": True, "initial": 0},
        ),
    }
    config["modules"] = [
        {
            "name": name,
            "program": path,
            "ca": ca,
            "points": [point | keys],
            "reads": ["tank.level"],
            "heartbeat_limit_ms": MODULE_LIMIT_MS,
            "config": settings,
        }
        for ca, (name, (path, keys)) in zip(MODULES, programs.items(), strict=True)
    ]
    config["synch"] = ["line3 -> filter"]


def add_iec61850(config: dict[str, Any], address: str, controller: str, **more: Any) -> None:
    """A server of IEC 61850 at this address, and who may command."""
    config["iec61850"] = {"address": address, "controllers": [controller], **more}


def compile_programs(directory: Path) -> None:
    """Those of `add_logic`, as files of this folder."""
    for name in PROGRAMS:
        file = directory / f"{name}.rtul"
        with contextlib.redirect_stdout(None):
            code = openrtu(["logic", "compile", str(SOURCES / f"{name}.st"), "-o", str(file)])
        check(code == 0, f"{name}.st is not compiled")


def add_logic(config: dict[str, Any], directory: str) -> None:
    """Two programs of Structured Text: an interlock before the breaker, and a sequence that pumps."""
    points = {
        "interlock": [{"name": ORDER, "ioa": 1}, {"name": "locked", "ioa": 2}],
        "filling": [{"name": "limit", "ioa": 1, "value": LIMIT}, {"name": "phase", "ioa": 2}],
    }
    names = {
        "interlock": {"breaker": f"p{DEVICE}.c{BREAKER[1]}", "earthed": f"p{DEVICE}.d{EARTHED[1]}"},
        "filling": {"pump": f"p{PUMPING_STATION}.c{PUMP[1]}", "level": "tank.level"},
    }
    config["logic"] = [
        {
            "name": name,
            "program": f"{directory}/{name}.rtul",
            "ca": ca,
            "points": points[name],
            "names": names[name],
        }
        for name, ca in PROGRAMS.items()
    ]


def with_limit(config: dict[str, Any], limit: int) -> dict[str, Any]:
    """The configuration with another limit of the sequence."""
    for one in config["logic"]:
        for point in one["points"]:
            if point["name"] == "limit":
                point["value"] = limit
    return config


@dataclass
class Desk:
    """A gateway on simulated lines, with a master: what the steps work on."""

    lines: LineSim
    gateway: Rtu
    master: Master


@dataclass
class ServedDesk(Desk):
    """The same with a manager of SNMPv3 and a client of IEC 61850."""

    managed: Managed
    iec61850: int  # the port of this machine that leads to the server


def say(text: str = "") -> None:
    print(text, flush=True)


def check(condition: bool, otherwise: str) -> None:
    if not condition:
        raise NotSeenError(otherwise)


def check_none(reports: list[Report], fault: str) -> None:
    """Raises NotSeenError when there are such reports."""
    some = ", ".join(f"CA {report.ca} IOA {report.ioa}" for report in reports[:3])
    more = f" and {len(reports) - 3} others" if len(reports) > 3 else ""
    check(not reports, "\n".join((f"{some}{more} {fault}", *map(str, reports))))


def shown(value: Any) -> str:
    """A value as a master's table shows it."""
    if isinstance(value, bool):
        return "1 on" if value else "0 off"
    return f"{value:g}" if isinstance(value, float) else str(value)


def table(reports: list[Report]) -> None:
    say("     Address    CA    Value  Type        Cause                    Flags")
    for report in reports:
        say(
            f"     {report.ioa:07d}  {report.ca:5d} {shown(report.value):>8}  {report.type:<10}"
            f"  {report.cause:<23}  {report.quality}"
        )


def indented(text: str) -> str:
    return "\n".join(f"     {line}".rstrip() for line in text.strip("\n").splitlines())


def octets(frame: bytes) -> str:
    """A frame in the manner of the report's figures."""
    return "[" + " ".join(map(str, frame)) + "]"


def invalid(reports: list[Report]) -> list[Report]:
    return [report for report in reports if "Invalid" in report.quality]


def interrogated(desk: Desk, *stations: int) -> list[Report]:
    """What these stations report; asked again while some of it is invalid, up to the deadline.

    A busy host can keep a simulated device from answering in time at any moment.
    The gateway then says invalid, as it must, until the next poll.
    """
    deadline = time.monotonic() + DEADLINE_S
    while True:
        reports = [report for ca in stations for report in desk.master.interrogate(ca)]
        if not invalid(reports) or time.monotonic() > deadline:
            return reports
        say("     master       some values are invalid: it asks again")


# ---- the steps -----------------------------------------------------------------------------------


def interrogate(desk: Desk) -> None:
    """The interrogation of CA 3067"""
    reports = interrogated(desk, STATION)
    table(reports)
    seen = {report.ioa: int(report.value) for report in reports}
    wrong = [report for report in reports if FIGURE_5_3.get(report.ioa) != int(report.value)]
    check_none(wrong, "have other values than in figure 5.6")
    check(
        seen.keys() == FIGURE_5_3.keys(), f"the station has the objects {sorted(seen)}, figure 5.6 has others"
    )
    check_none([report for report in reports if not report.good], "are not good")
    check(len(reports) == len(FIGURE_5_3), f"{len(reports)} objects came instead of {len(FIGURE_5_3)}")


def single_command(desk: Desk) -> None:
    """A single command: IOA 4 on"""
    mark = desk.lines.mark()
    since = desk.master.mark()
    confirmed = desk.master.command(STATION, 4, "C_SC_NA_1", c104.SingleCmd(on=True))
    frame = desk.lines.wait_frame(lambda f: received(f, FIGURE_5_5), since=mark)
    say(f"     on line 3    {frame.text}")
    check(confirmed, "the station did not confirm the command")
    say("     master       activation confirmed: the device has answered")
    returned = (STATION, 4, "RETURN_INFO_REMOTE", True)
    event(desk.master.wait(lambda r: (r.ca, r.ioa, r.cause, r.value) == returned, since, DEADLINE_S))


def set_point(desk: Desk) -> None:
    """A set-point command with time tag: IOA 40003 to 255"""
    desk.master.synchronise_clock(STATION)  # a busy host has made the emulated board's time late since
    mark = desk.lines.mark()
    since = desk.master.mark()
    info = c104.ScaledCmd(target=c104.Int16(255), recorded_at=datetime.datetime.now(datetime.UTC))
    confirmed = desk.master.command(STATION, 40003, "C_SE_TB_1", info)
    frame = desk.lines.wait_frame(lambda f: received(f, FIGURE_5_8), since=mark)
    say(f"     on line 3    {frame.text}")
    check(confirmed, "the station did not confirm the command")
    say("     master       activation confirmed: the device has answered")
    event(desk.master.wait(lambda r: (r.ca, r.ioa, r.value) == (STATION, 40003, 255), since, DEADLINE_S))


def refused_command(desk: Desk) -> None:
    """A command that the device refuses (exception 4) is confirmed negatively"""
    desk.lines.fault(DEVICE, "exception", 4, 6)
    info = c104.ScaledCmd(target=c104.Int16(7))
    confirmed = desk.master.command(STATION, 40003, "C_SE_NB_1", info)
    desk.lines.fault(DEVICE, "clear")
    check(not confirmed, "the station confirmed a command that the device refused")
    check(
        desk.lines.get(DEVICE, "holding_registers", 2) == 255, "the device took a value that it had refused"
    )
    say("     master       negative confirmation; the register still holds 255")


def spontaneous(desk: Desk) -> None:
    """A value changes at the device and arrives as an event"""
    since = desk.master.mark()
    desk.lines.set(DEVICE, "input_registers", 0, 1510)
    say("     device 3.67  input register 0 = 1510")
    event(desk.master.wait(lambda r: (r.ca, r.ioa, r.value) == (STATION, 30001, 1510), since, DEADLINE_S))


def unplugged(desk: Desk) -> None:
    """The device is unplugged: its points turn invalid; it comes back"""
    wanted = set(FIGURE_5_3)
    since = desk.master.mark()
    desk.lines.fault(DEVICE, "mute")
    say("     device 3.67  unplugged")
    for ioa in sorted(wanted):
        report = desk.master.wait(
            lambda r, i=ioa: (r.ca, r.ioa) == (STATION, i) and "Invalid" in r.quality, since, DEADLINE_S
        )
    event(report, f"and {len(wanted) - 1} others too")
    others = [report for report in interrogated(desk, 3035) if not report.good]
    check_none(others, "are invalid, but they are not of the unplugged device")
    say("     neighbour    CA 3035 stayed good")
    since = desk.master.mark()
    desk.lines.fault(DEVICE, "clear")
    say("     device 3.67  plugged in again")
    for ioa in sorted(wanted):
        report = desk.master.wait(
            lambda r, i=ioa: (r.ca, r.ioa) == (STATION, i) and r.good, since, DEADLINE_S
        )
    event(report, f"and {len(wanted) - 1} others too")


def all_types(desk: Desk) -> None:
    """The other lines: every type of information object"""
    reports = interrogated(desk, 1010, 2020, 4040)
    table(reports)
    say("     an interrogation does not report counters; a change at the meter does")
    since = desk.master.mark()
    desk.lines.set("2.20", "input_registers", 8, 19, 1)
    reports.append(desk.master.wait(lambda r: (r.ca, r.ioa) == (2020, 30009), since, DEADLINE_S))
    event(reports[-1])
    missing = TYPES_OF_TABLE_4_1 - {report.type for report in reports}
    check(not missing, f"no station sent the types {', '.join(sorted(missing))}")


def modules_of_others(desk: Desk) -> None:
    """Modules that others write: Python switches a pump by a level, C smooths it, a command is judged"""
    pump, smooth, guard = MODULES
    for level, on in ((10, True), (50, False)):
        since = desk.master.mark()
        desk.lines.set(DEVICE, *LEVEL, level)
        say(f"     device 3.67  input register 2 = {level}, the level of the tank")
        event(desk.master.wait(lambda r, on=on: (r.ca, r.value) == (pump, on) and r.good, since, DEADLINE_S))
    event(
        desk.master.wait(lambda r: r.ca == smooth and r.value > 49 and r.good, since, DEADLINE_S),
        "filtered in C",
    )
    fired = {row["name"]: row["firings"] for row in desk.gateway.query("synch")[0]["transitions"]}
    scans, ends = fired["filter.scan_begin"], fired["line3.scan_end"]
    check(0 < scans <= ends + 1, f"the net has not led the filter: {fired}")
    say(f"     rtu-synch    line3 -> filter: {scans} scans of the filter behind {ends} of line 3")
    for level, takes in ((50, True), (95, False)):
        since = desk.master.mark()
        if level != 50:
            desk.lines.set(DEVICE, *LEVEL, level)
            desk.master.wait(lambda r: (r.ca, r.ioa, r.value) == (STATION, 30003, 95), since, DEADLINE_S)
        confirmed = desk.master.command(guard, 1, "C_SC_NA_1", c104.SingleCmd(on=True))
        check(
            confirmed == takes, f"the module {'refused' if takes else 'took'} a command at a level of {level}"
        )
        answer = "activation confirmed" if takes else "negative confirmation"
        say(f"     master       pump-2 on at a level of {level}: {answer}, by the module")


def logic(desk: Desk) -> None:
    """Programs of Structured Text: an interlock refuses a command, a sequence starts a pump"""

    def order(on: bool, earthed: bool) -> None:
        command = c104.SingleCmd(on=on)
        confirmed = desk.master.command_to_its_end(INTERLOCK, 1, "C_SC_NA_1", command)
        check(confirmed != (on and earthed), "the interlock decided otherwise")
        answer = (
            "activation confirmed, by the device" if confirmed else "negative confirmation, by the interlock"
        )
        line = "earthed" if earthed else "not earthed"
        say(f"     master       breaker {'on' if on else 'off'}, the line is {line}: {answer}")

    at_its_start(desk)
    order(False, True)
    order(True, True)
    refused = "a command of order was refused: interlock"
    desk.gateway.wait_for(lambda: refused in desk.gateway.log(), DEADLINE_S, refused)
    say(f"     log          {refused}")
    since = desk.master.mark()
    desk.lines.set(DEVICE, *EARTHED, 0)
    desk.master.wait(lambda r: (r.ca, r.ioa, r.value) == (INTERLOCK, 2, False), since, DEADLINE_S)
    order(True, False)
    desk.lines.set(DEVICE, *LEVEL, 70)
    since = desk.master.mark()
    limit = c104.ScaledCmd(target=c104.Int16(60))
    check(desk.master.command(FILLING, 1, "C_SE_NB_1", limit), "the limit was not taken")
    say("     master       limit of the sequence = 60, the level is 70: activation confirmed")
    pumps(desk, since)


def at_its_start(desk: Desk) -> None:
    """The sequence waits: a step before may have left a level at which it pumps."""
    desk.lines.set(DEVICE, *LEVEL, 50)

    def waits() -> bool:
        points = desk.gateway.points()
        return points["tank.level"]["value"] == 50 and points["phase"]["value"] == 0

    desk.gateway.wait_for(waits, DEADLINE_S, "the sequence is at its start")


def pumps(desk: Desk, since: int) -> None:
    """The sequence has started the pump."""
    event(
        desk.master.wait(lambda r: (r.ca, r.ioa, r.value) == (FILLING, 2, 2), since, DEADLINE_S), "it pumps"
    )
    check(desk.lines.get(PUMPING_STATION, *PUMP) == 1, "the pump does not run")
    say(f"     device {PUMPING_STATION}  coil {PUMP[1]} = 1")


Step = Callable[[Desk], None]
STEPS: tuple[Step, ...] = (
    interrogate,
    single_command,
    set_point,
    refused_command,
    spontaneous,
    unplugged,
    all_types,
)

# ---- while the gateway runs -------------------------------------------------------------------------


def without_newcomer(config: dict[str, Any]) -> dict[str, Any]:
    port, unit = map(int, NEWCOMER.split("."))
    for line in config["port"]:
        if line["value"] == port:
            line["slaves"] = [slave for slave in line["slaves"] if slave["id"] != unit]
    return config


def reload(desk: Desk, *file: str) -> None:
    """Without a file, rtud's own."""
    desk.gateway.ctl("reload", *file)


def limit_reloaded(desk: Desk) -> None:
    """A reload changes the limit of a program: its sequence starts the pump"""
    at_its_start(desk)
    since = desk.master.mark()
    desk.lines.set(DEVICE, *LEVEL, 85)
    desk.master.wait(lambda r: (r.ca, r.ioa, r.value) == (STATION, 30003, 85), since, DEADLINE_S)
    say(f"     device {DEVICE}  input register {LEVEL[1]} = 85, the level; the limit is {LIMIT}")
    check(desk.lines.get(PUMPING_STATION, *PUMP) == 0, "the pump runs")
    reload(desk, desk.gateway.put(with_limit(desk.gateway.configuration(), 80)))
    say("     rtuctl       reload with a limit of 80")
    pumps(desk, since)


def longest_pause_ms(desk: Desk, port: int, since: int) -> float:
    times = [f.monotonic_ns for f in desk.lines.frames(since) if (f.kind, f.port) == ("received", port)]
    return max(later - earlier for earlier, later in pairwise(times)) / 1e6


def reloaded(desk: Desk) -> None:
    """A device leaves the configuration and comes back; the master stays connected"""
    station = 5051
    here, frames = desk.gateway.query("iec104", "connections"), desk.lines.mark()
    reload(desk, desk.gateway.put(without_newcomer(desk.gateway.configuration())))
    check(desk.master.is_refused(station), f"CA {station} is known without its device")
    say(f"     rtuctl       reload without device {NEWCOMER}: CA {station} is unknown")
    since = desk.master.mark()
    reload(desk)
    event(desk.master.wait(lambda r: r.ca == station and r.good, since, DEADLINE_S))
    say(f"     rtuctl       reload with device {NEWCOMER}: {len(interrogated(desk, station))} objects")
    now = desk.gateway.query("iec104", "connections")
    check([row["peer"] for row in now] == [row["peer"] for row in here], "a connection has ended")
    pause = longest_pause_ms(desk, 3, frames)
    say(f"     neighbour    port 3 was polled on, its longest pause was {pause:.0f} ms")


def position(desk: Desk) -> None:
    """A receiver on a line, recorded on a boat: rtu-centre polls its position, type 201, and sees it move"""
    reload(desk, desk.gateway.put(drive.instead_of_devices(desk.gateway.configuration())))
    say(f"     rtuctl       reload with a receiver on {drive.DEVICE} instead of line {drive.PORT}'s devices")
    with (
        drive.Drive(functools.partial(desk.lines.say, drive.PORT)),
        tempfile.TemporaryDirectory() as directory,
        contextlib.closing(drive.polled(Path(directory), desk.gateway.address)) as positions,
    ):
        for latitude, longitude, altitude in itertools.islice(positions, drive.FIXES):
            say(
                f"     rtu-centre   CA {drive.CA} IOA {drive.IOA}: {latitude:.7f} N {longitude:.7f} E,"
                f" {altitude:.1f} m, good"
            )
            check(drive.is_recorded(latitude, longitude), "the boat was not there")
        say(indented(desk.gateway.ctl("gps")))
    reload(desk)
    desk.gateway.wait_for(lambda: all_read(desk.gateway), DEADLINE_S, "the devices are read again")
    say(f"     rtuctl       reload: line {drive.PORT} has its devices again, all points are good")


def operated_by_iec61850(desk: ServedDesk) -> None:
    """IEC 61850: a client browses, a breaker is operated (SBO, enhanced security), a report tells it"""
    since = desk.master.mark()
    outcomes = operator.operate(desk.iec61850, SWITCH, "false", "browse", "report", "select", "operate")
    devices = outcomes["browse"]
    check(len(devices) > 1, f"it sees the logical devices {devices}")
    say(f"     libiec61850  {len(devices)} logical devices, {sum(devices.values())} logical nodes")
    check(outcomes["model"] == SBO_ENHANCED, f"ctlModel is {outcomes['model']}")
    for service, words in (("select", "SBOw"), ("operate", "Oper, confirmed by the device")):
        check(outcomes[service]["done"], f"{service} was refused: {outcomes[service]}")
        say(f"     libiec61850  {SWITCH}: {words}")
    check([each["cause"] for each in outcomes["terminations"]] == [0], "no positive CommandTermination")
    say("     libiec61850  CommandTermination, behind the value that was read back")
    check(outcomes["report"] != [], "no report has told it")
    say(f"     libiec61850  report of urcbStatus01, data change: {outcomes['report'][0]}")
    event(desk.master.wait(lambda r: (r.ca, r.ioa) == (1010, 1), since, DEADLINE_S))


def managed_by_snmp(desk: ServedDesk) -> None:
    """SNMPv3: a manager interrogates, selects and executes; informs tell it"""
    manager, row = desk.managed.manager, managed.BREAKER
    qualities = [*manager.walk("rtuMeasuredQuality").values()]
    good = sum(quality == b"\0" for quality in qualities)
    say(f"     snmpbulkwalk rtuMeasuredQuality: {good} of {len(qualities)} measured values are good")
    check(good > 0, "no measured value is good")
    before = desk.managed.last()
    manager.wish(row, managed.SELECT, value=managed.ON)
    say(f"     snmpset      rtuCommandState.{row} = selectionRequest, rtuCommandValue.{row} = on")
    say(f"     snmptrapd    {desk.managed.told(managed.ACCEPTED, before)}")
    manager.wish(row, managed.EXECUTE)
    say(f"     snmpset      rtuCommandState.{row} = executionRequest")
    say(f"     snmptrapd    {desk.managed.told(managed.EXECUTING, before)}")
    say(f"     snmptrapd    {desk.managed.told(managed.EXECUTED, before)}, confirmed by the device")
    manager.wish(row, managed.INACTIVE)


NATIVE_STEPS: tuple[Step, ...] = (
    *STEPS,
    modules_of_others,
    limit_reloaded,
    logic,
    reloaded,
    position,
    operated_by_iec61850,
    managed_by_snmp,
)


def received(frame: Frame, wanted: bytes) -> bool:
    return frame.kind == "received" and frame.bytes == wanted


def event(report: Report, more: str = "") -> None:
    when = f"{report.recorded_at:%H:%M:%S.%f}"[:-3] if report.recorded_at else "no time"
    say(
        f"     master       {report.type} IOA {report.ioa} = {shown(report.value)}, {report.quality},"
        f" {report.cause.lower()}, {when}{' ' + more if more else ''}"
    )


# ---- the whole -----------------------------------------------------------------------------------


def start_lines(
    stack: contextlib.ExitStack,
    directory: Path,
    config: Path,
    verdict: Verdict,
    silence_us: int | None = None,
) -> LineSim:
    simulated = LineSim(config, CHAPTER_5 / "values.json", directory / "dev", silence_us=silence_us)
    lines = stack.enter_context(simulated)
    verdict.sources["the last frames on the lines"] = lambda: "\n".join(map(str, lines.frames()[-100:]))
    verdict.causes.append(lambda: reason(lines.check_up))
    devices = [
        (port["value"], slave) for port in json.loads(config.read_text())["port"] for slave in port["slaves"]
    ]
    say(f"   * {len(devices)} simulated Modbus devices on six lines, ptys in {directory}/dev")
    return lines


def reason(check_up: Callable[[], None]) -> str:
    """Why something is not up, or an empty text."""
    try:
        check_up()
    except LabError as error:
        return error.seen
    return ""


def add_gateway(verdict: Verdict, gateway: Rtu) -> None:
    """What a gateway has to say when a show fails."""

    def failing() -> str:
        modules = [each for name, each in gateway.modules().items() if name != "rtuctl"]
        ended = [f"{each['name']} does not run" for each in modules if not each["pid"]]
        still = [f"{each['name']} hangs" for each in modules if each["pid"] and not each["alive"]]
        again = [
            f"{each['name']} ended and was restarted"
            for each in modules
            if each["restarts"] > gateway.killed.count(each["name"])
        ]
        return ", ".join(ended + still + again)

    verdict.causes += [lambda: reason(gateway.check_up), failing]
    verdict.sources["rtud's log"] = lambda: gateway.log(1000)
    for table in ("modules", "lines", "points"):
        verdict.sources[f"rtuctl {table}"] = lambda table=table: gateway.ctl(table)


def start_gateway(
    stack: contextlib.ExitStack, directory: Path, config: dict[str, Any], verdict: Verdict
) -> Gateway:
    gateway = Gateway(config, directory)
    add_gateway(verdict, gateway)
    stack.enter_context(gateway)
    seconds = gateway.wait_for(lambda: all_read(gateway), DEADLINE_S, "every device has been read")
    say(f"   * {', '.join(running(gateway))}; all points read after {seconds:.1f} s")
    return gateway


def running(gateway: Rtu) -> list[str]:
    return [f"{name} (pid {module['pid']})" for name, module in gateway.modules().items() if module["pid"]]


@contextlib.contextmanager
def mastered(gateway: Rtu, verdict: Verdict) -> Iterator[Master]:
    """A master for the steps alone: c104 can end its process when others take its connections from it."""
    gateway.check_ours()
    with Master(*gateway.address) as master:
        verdict.sources["the last reports"] = lambda: "\n".join(map(str, master.reports_since(0)[-100:]))
        master.synchronise_clock(STATION)
        host, port = gateway.address
        say(f"   * a master of another make (c104, lib60870) on {host}:{port}; clock synchronised")
        yield master


def all_read(gateway: Rtu) -> bool:
    """Every point is good, but those behind a broadcast address, and others that were never written."""
    return all(
        point["quality"] != "invalid"
        for name, point in gateway.points().items()
        if not point["never_read"] and name != ORDER
    )


def run_steps(desk: Desk, steps: Sequence[Step], verdict: Verdict) -> None:
    for number, step in enumerate(steps, 1):
        verdict.expected = f"step {number}: {step.__doc__}"
        say()
        say(f"{number:2d}. {step.__doc__}")
        step(desk)
    say()
    say(f"All {len(steps)} steps succeeded.")


def keep_up(gateway: Rtu, lines: LineSim) -> None:
    host, port = gateway.address
    say()
    say(f"The gateway stays up: a controlled station on {host}:{port}.")
    say("In another terminal:")
    command = "scripts/kept" if port == ports.STATION else f"scripts/kept --port {port}"
    for words in ("points 'p3.67.*'", "watch", "lines", "modules", "set p3.67.c3 off"):
        say(f"  {command} rtuctl {words}")
    say("Faults of a device (tests/linesim/README.md has them all):")
    for words in ("fault 3.67 mute", "fault 3.67 clear"):
        say(f"  {command} linesim {words}")
    say("Ctrl-C ends it.")
    stopped = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stopped.set())
    with kept.known(port, gateway, lines):
        stopped.wait()


def show(port: int, keep: bool, verdict: Verdict) -> None:
    """Runs the show; raises what went wrong."""
    ports.check_free(port, f"make run-native{' KEEP=1' if keep else ''}")
    directory = run_directory()
    config, here = listening_on(configuration(), port), "127.0.0.1"
    name_level(config)
    add_modules(config, directory, default_build())
    add_iec61850(config, here, here, port=free_port())
    compile_programs(directory)
    add_logic(config, str(directory))
    folder, snmp_port = directory / "management", free_udp_port()
    config["snmp"] = managed.settings(
        here, address=here, port=snmp_port, keys=f"{managed.keys_of(folder)}", state=f"{directory}/snmp"
    )
    say("OpenRTU: Modbus devices on six lines, seen and commanded over IEC 60870-5-104")
    with contextlib.ExitStack() as stack, verdict.watched():
        stack.callback(remove, directory)
        config_file = directory / "linesim.json"
        config_file.write_text(json.dumps(config))
        lines = start_lines(stack, directory, config_file, verdict)
        management = stack.enter_context(managed.managed(folder, config["snmp"], snmp_port))
        gateway = start_gateway(stack, directory, config, verdict)
        with mastered(gateway, verdict) as master:
            desk = ServedDesk(lines, gateway, master, management, config["iec61850"]["port"])
            run_steps(desk, NATIVE_STEPS, verdict)
        if keep:
            keep_up(gateway, lines)


def main() -> int:
    """The command line. Exit codes: 0 every step succeeded, 1 one did not, 2 wrong usage."""
    parser = argparse.ArgumentParser(prog="make run-native", description=__doc__)
    add_options(parser)
    arguments = parser.parse_args()
    verdict = Verdict(typed("make run-native", arguments), "run-native")
    return run(verdict, lambda: show(arguments.port, arguments.keep, verdict))


def typed(command: str, arguments: argparse.Namespace) -> str:
    """What its user types for the show."""
    port = f" PORT={arguments.port}" if arguments.port != ports.STATION else ""
    return f"{command}{port}{' KEEP=1' if arguments.keep else ''}"


def tcp_port(text: str) -> int:
    """A port that one can listen on. Raises ArgumentTypeError."""
    if not text.isdecimal() or not 1 <= int(text) <= 65535:
        raise argparse.ArgumentTypeError(f"{text} is not a TCP port: give a number from 1 to 65535")
    return int(text)


def add_options(parser: argparse.ArgumentParser) -> None:
    """What every show takes."""
    parser.add_argument(
        "--port", type=tcp_port, default=ports.STATION, help="TCP port of the controlled station [2404]"
    )
    parser.add_argument(
        "--keep", action="store_true", help="stay up afterwards, for your own master and rtuctl"
    )
