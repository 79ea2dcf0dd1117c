# SPDX-License-Identifier: GPL-3.0-or-later
"""Chapter 5 of report 003, live: the steps, wherever the gateway runs; and `make run-native`, all of it here.

Exit code 0: all of it was seen; 1: not, with the reason.
"""

from __future__ import annotations

import argparse
import contextlib
import datetime
import json
import signal
import sys
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import c104

from lab.gateway import REPOSITORY, Gateway, GatewayError, Rtu, listening_on, remove, run_directory
from lab.linesim import Frame, LineSim, LineSimError
from lab.master import Master, MasterError, Report

CHAPTER_5 = REPOSITORY / "tests" / "fixtures" / "chapter5"
STATION = 3067  # port 3, slave 67
DEVICE = "3.67"

# Figure 5.6, rows 1 to 13: what the interrogation of CA 3067 brought.
FIGURE_5_3: dict[int, int] = {
    **{1: 1, 2: 0, 3: 1, 4: 0},
    **{10001: 1, 10002: 0, 10003: 0},
    **{30001: 1495, 30002: 98, 30003: 30},
    **{40001: 1500, 40002: 100, 40003: 0},
}
FIGURE_5_5 = bytes([67, 5, 0, 3, 255, 0, 115, 24])
FIGURE_5_8 = bytes([67, 6, 0, 2, 0, 255, 103, 104])

TYPES_OF_TABLE_4_1 = {
    "M_SP_NA_1",
    "M_DP_NA_1",
    "M_ME_NA_1",
    "M_ME_NB_1",
    "M_ME_NC_1",
    "M_ST_NA_1",
    "M_BO_NA_1",
}


class NotSeenError(Exception):
    """Something of the show did not happen as it should."""


@dataclass
class Stage:
    """What a step works on."""

    lines: LineSim
    gateway: Rtu
    master: Master


def say(text: str = "") -> None:
    print(text, flush=True)


def check(condition: bool, otherwise: str) -> None:
    if not condition:
        raise NotSeenError(otherwise)


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


def octets(frame: bytes) -> str:
    """A frame in the manner of the report's figures."""
    return "[" + " ".join(map(str, frame)) + "]"


# ---- the steps -----------------------------------------------------------------------------------


def interrogate(stage: Stage) -> None:
    """The interrogation of CA 3067 (figures 5.3, 5.6)"""
    reports = stage.master.interrogate(STATION)
    table(reports)
    seen = {report.ioa: int(report.value) for report in reports}
    check(seen == FIGURE_5_3, f"figure 5.6 has {FIGURE_5_3}, the station sent {seen}")
    check(all(report.good for report in reports), "not every object is good")
    check(len(reports) == len(FIGURE_5_3), f"{len(reports)} objects came instead of {len(FIGURE_5_3)}")


def single_command(stage: Stage) -> None:
    """The single command: IOA 4 on (figure 5.5)"""
    mark = stage.lines.mark()
    since = stage.master.mark()
    confirmed = stage.master.command(STATION, 4, "C_SC_NA_1", c104.SingleCmd(on=True))
    frame = stage.lines.wait_frame(lambda f: received(f, FIGURE_5_5), since=mark)
    say(f"     on line 3    {frame.text}")
    check(confirmed, "the station did not confirm the command")
    say("     master       activation confirmed: the device has answered")
    report = stage.master.wait(
        lambda r: (r.ioa, r.cause) == (4, "RETURN_INFO_REMOTE") and r.value is True, since
    )
    event(report)


def set_point(stage: Stage) -> None:
    """The set-point command with time tag: IOA 40003 to 255 (figure 5.8)"""
    mark = stage.lines.mark()
    since = stage.master.mark()
    info = c104.ScaledCmd(target=c104.Int16(255), recorded_at=datetime.datetime.now(datetime.UTC))
    confirmed = stage.master.command(STATION, 40003, "C_SE_TB_1", info)
    frame = stage.lines.wait_frame(lambda f: received(f, FIGURE_5_8), since=mark)
    say(f"     on line 3    {frame.text}")
    check(confirmed, "the station did not confirm the command")
    say("     master       activation confirmed: the device has answered")
    event(stage.master.wait(lambda r: r.ioa == 40003 and r.value == 255, since))


def refused_command(stage: Stage) -> None:
    """A command that the device refuses (exception 4) is confirmed negatively"""
    stage.lines.fault(DEVICE, "exception", 4, 6)
    info = c104.ScaledCmd(target=c104.Int16(7))
    confirmed = stage.master.command(STATION, 40003, "C_SE_NB_1", info)
    stage.lines.fault(DEVICE, "clear")
    check(not confirmed, "the station confirmed a command that the device refused")
    check(
        stage.lines.get(DEVICE, "holding_registers", 2) == 255, "the device changed a value that it refused"
    )
    say("     master       negative confirmation; the register still holds 255")


def spontaneous(stage: Stage) -> None:
    """A value changes at the device and arrives as an event"""
    since = stage.master.mark()
    stage.lines.set(DEVICE, "input_registers", 0, 1510)
    say("     device 3.67  input register 0 = 1510")
    event(stage.master.wait(lambda r: (r.ca, r.ioa, r.value) == (STATION, 30001, 1510), since))


def unplugged(stage: Stage) -> None:
    """The device is unplugged: its points turn invalid; it comes back"""
    wanted = set(FIGURE_5_3)
    since = stage.master.mark()
    stage.lines.fault(DEVICE, "mute")
    say("     device 3.67  unplugged")
    for ioa in sorted(wanted):
        report = stage.master.wait(
            lambda r, i=ioa: (r.ca, r.ioa) == (STATION, i) and "Invalid" in r.quality, since
        )
    event(report, f"and {len(wanted) - 1} others alike")
    others = [report for report in stage.master.interrogate(3035) if not report.good]
    check(not others, f"a dead device made points of its neighbour invalid: {others}")
    say("     neighbour    CA 3035 is good all the time")
    since = stage.master.mark()
    stage.lines.fault(DEVICE, "clear")
    say("     device 3.67  plugged in again")
    for ioa in sorted(wanted):
        report = stage.master.wait(
            lambda r, i=ioa: (r.ca, r.ioa) == (STATION, i) and r.good, since, timeout_s=20.0
        )
    event(report, f"and {len(wanted) - 1} others alike")


def all_types(stage: Stage) -> None:
    """The other lines: every type of table 4.1"""
    reports = [report for ca in (1010, 2020, 4040) for report in stage.master.interrogate(ca)]
    table(reports)
    say("     counters are no part of an interrogation; a change at the meter brings one")
    since = stage.master.mark()
    stage.lines.set("2.20", "input_registers", 8, 19, 1)
    reports.append(stage.master.wait(lambda r: (r.ca, r.ioa) == (2020, 30009), since))
    event(reports[-1])
    missing = TYPES_OF_TABLE_4_1 - {report.type for report in reports}
    check(not missing, f"types that no station sent: {sorted(missing)}")


Step = Callable[[Stage], None]
STEPS: tuple[Step, ...] = (
    interrogate,
    single_command,
    set_point,
    refused_command,
    spontaneous,
    unplugged,
    all_types,
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
    stack: contextlib.ExitStack, directory: Path, config: Path, silence_us: int | None = None
) -> LineSim:
    simulated = LineSim(config, CHAPTER_5 / "values.json", directory / "dev", silence_us=silence_us)
    lines = stack.enter_context(simulated)
    devices = [
        (port["value"], slave) for port in json.loads(config.read_text())["port"] for slave in port["slaves"]
    ]
    say(f"   * {len(devices)} simulated Modbus devices on six lines, ptys in {directory}/dev")
    return lines


def start_gateway(stack: contextlib.ExitStack, directory: Path, config: dict[str, Any]) -> Gateway:
    gateway = stack.enter_context(Gateway(config, directory))
    seconds = gateway.wait_for(lambda: all_read(gateway), 20.0, "every device has been read")
    say(f"   * {', '.join(running(gateway))}; all points read after {seconds:.1f} s")
    return gateway


def running(gateway: Rtu) -> list[str]:
    return [f"{name} (pid {module['pid']})" for name, module in gateway.modules().items() if module["pid"]]


def start_master(stack: contextlib.ExitStack, gateway: Rtu) -> Master:
    master = stack.enter_context(Master(*gateway.address))
    master.synchronise_clock(STATION)
    host, port = gateway.address
    say(f"   * a master of another make (c104, lib60870) on {host}:{port}; clock synchronised")
    return master


def all_read(gateway: Rtu) -> bool:
    """Every point is good, but those behind a broadcast address, which can only be written."""
    return all(point["quality"] != "invalid" for point in gateway.points().values() if not point["broadcast"])


def run_steps(stage: Stage, steps: Sequence[Step]) -> None:
    for number, step in enumerate(steps, 1):
        say()
        say(f"{number:2d}. {step.__doc__}")
        step(stage)
    say()
    say(f"All {len(steps)} steps were seen.")


def keep_up(stage: Stage) -> None:
    host, port = stage.gateway.address
    say()
    say(f"The gateway stays up: a controlled station on {host}:{port}.")
    say("In another terminal:")
    for command in ("points 'p3.67.*'", "watch", "lines", "modules", "set p3.67.c3 off"):
        say(f"  {stage.gateway.rtuctl} {command}")
    say(f"Faults: echo 'fault 3.67 mute' | nc -U {stage.lines.directory}/control   (tests/linesim/README.md)")
    say("Ctrl-C ends it.")
    stopped = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stopped.set())
    stopped.wait()


def show(port: int, keep: bool) -> None:
    """Runs the show; raises what went wrong."""
    directory = run_directory()
    config = listening_on(json.loads((CHAPTER_5 / "gateway.json").read_text()), port)
    say("OpenRTU: Modbus devices on six lines, seen and commanded over IEC 60870-5-104")
    with contextlib.ExitStack() as stack:
        stack.callback(remove, directory)
        config_file = directory / "linesim.json"
        config_file.write_text(json.dumps(config))
        lines = start_lines(stack, directory, config_file)
        gateway = start_gateway(stack, directory, config)
        stage = Stage(lines, gateway, start_master(stack, gateway))
        run_steps(stage, STEPS)
        if keep:
            keep_up(stage)


def main() -> int:
    """The command line. Exit codes: 0 all was seen, 1 something was not, 2 wrong usage."""
    parser = argparse.ArgumentParser(prog="make run-native", description=__doc__)
    add_options(parser)
    arguments = parser.parse_args()
    return told("make run-native", lambda: show(arguments.port, arguments.keep))


def add_options(parser: argparse.ArgumentParser) -> None:
    """What every show takes."""
    parser.add_argument("--port", type=int, default=2404, help="TCP port of the controlled station [2404]")
    parser.add_argument(
        "--keep", action="store_true", help="stay up afterwards, for your own master and rtuctl"
    )


# A show's end: text for its user, no traceback.
REASONS = (NotSeenError, GatewayError, LineSimError, MasterError)


def told(name: str, act: Callable[[], None], reasons: tuple[type[Exception], ...] = REASONS) -> int:
    """The exit code of a show, and what it did not see. Who ends it ends all that it has started."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        act()
    except reasons as error:
        print(f"\n{name}: not seen: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 1
    return 0
