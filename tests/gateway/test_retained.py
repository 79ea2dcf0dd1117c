# SPDX-License-Identifier: GPL-3.0-or-later
"""Retained points and variables over a power cut: all processes killed, the map gone, the file as written."""

import datetime
import json
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from lab.gateway import Gateway, free_port, listening_on, remove, run_directory
from lab.modules import place, program
from lab.raw_master import ACTIVATION_CON, RawMaster
from openrtu_tools.logic.binary import encode
from openrtu_tools.logic.compile import compile_text
from openrtu_tools.logic.errors import Findings
from rig.cp56 import cp56
from rig.power import cut_power

FIXTURES = Path(__file__).resolve().parents[1] / "fixtures/foreign"
PATIENCE_S = 60.0
C_CS = 103
TOTAL = """PROGRAM total VAR_EXTERNAL limit, total : DINT; END_VAR
IF total < limit THEN total := total + 1; END_IF; END_PROGRAM"""
COUNTS = """PROGRAM counts
VAR_EXTERNAL limit, shown, length : DINT; END_VAR
VAR RETAIN counted : {} := {}; rest : LREAL; word : STRING(16); END_VAR
IF {} AND counted < limit THEN counted := counted + 1; END_IF;
IF {} AND LEN(word) < 12 THEN word := CONCAT(word, '-'); rest := rest + 0.125; END_IF;
shown := counted; length := LEN(word) + LREAL_TO_INT(rest);
END_PROGRAM"""
SLACK_S = 0.7  # rtuctl's answer may wait for the processor


@pytest.fixture
def directory() -> Iterator[Path]:
    directory = run_directory()
    yield directory
    remove(directory)


def configuration(directory: Path) -> dict[str, Any]:
    """A module that takes commands and retains one of two points; a program that retains both of its own."""
    (directory / "drive.json").write_text("{}")
    point = {"type": "scaled", "command": True, "initial": 0}
    drive = {
        "name": "drive",
        "program": program(directory, "drive", FIXTURES / "drive.py"),
        "period_ms": 20,
        "heartbeat_limit_ms": 2000,
        "ca": 922,
        "points": [
            point | {"name": "setpoint", "ioa": 1, "retain": True},
            point | {"name": "scratch", "ioa": 2},
        ],
        "config": {"file": str(directory / "drive.json")},
    }
    journal = {"path": str(directory / "journal"), "interval_s": 1, "volume_mb": 1048576}
    (directory / "total.rtul").write_bytes(encode(compile_text(TOTAL, Findings())))
    total = {
        "name": "total",
        "program": str(directory / "total.rtul"),
        "period_ms": 20,
        "ca": 923,
        "points": [
            {"name": "limit", "ioa": 1, "value": 5, "retain": True},
            {"name": "total", "ioa": 2, "retain": True},
        ],
    }
    sections = {"port": [], "modules": [drive], "logic": [total], "journal": journal}
    return listening_on(sections, free_port())


def found(gateway: Gateway, name: str) -> tuple[Any, str]:
    point = gateway.points(name)[name]
    return point["value"], point["quality"]


def wait_found(gateway: Gateway, name: str, value: Any, quality: str) -> dict[str, Any]:
    gateway.wait_for(
        lambda: found(gateway, name) == (value, quality), PATIENCE_S, f"{name} is {value}, {quality}"
    )
    point: dict[str, Any] = gateway.points(name)[name]
    return point


def wait_record(gateway: Gateway, file: Path, value: int) -> None:
    """Until the last record says it: the type, the IOA, 0 in place of a number, the value."""
    entry = b"\x05" + (1).to_bytes(4, "little") + bytes(4) + value.to_bytes(4, "little")
    gateway.wait_for(
        lambda: file.exists() and entry in file.read_bytes(), PATIENCE_S, f"the journal has {value}"
    )


def set_clock(gateway: Gateway) -> None:
    """Or no time that the file has would be believed."""
    with RawMaster(*gateway.address) as master:
        master.request(C_CS, 922, 0, cp56(datetime.datetime.now(datetime.UTC)))
        assert master.answer(C_CS).cause == ACTIVATION_CON


def moment(point: dict[str, Any]) -> float:
    return time.monotonic() - float(point["age_s"])


def test_more_than_a_record_can_hold_are_an_error(programs: Path, tmp_path: Path) -> None:
    config = configuration(tmp_path)
    config["journal"]["size_kb"] = 64
    points = config["modules"][0]["points"]
    points += [{"name": f"p-{n}", "type": "float", "ioa": 10 + n, "retain": True} for n in range(400)]
    file = tmp_path / "gateway.json"
    file.write_text(json.dumps(config))
    done = subprocess.run([programs / "rtud/rtud", "--check", file], capture_output=True, text=True)
    assert done.returncode == 1
    assert "journal: has no room for 403 retained points and 0 retained values of programs" in done.stderr
    del points[100:]
    file.write_text(json.dumps(config))
    subprocess.run([programs / "rtud/rtud", "--check", file], capture_output=True, check=True)


@pytest.mark.slow
def test_setpoint_outlives_the_power(programs: Path, directory: Path) -> None:
    """With its old time, as not topical, until its module says it again; from the records that are whole."""
    place(directory, programs)
    config = configuration(directory)
    with Gateway(config, directory, programs) as gateway:
        wait_found(gateway, "setpoint", 0, "good")
        set_clock(gateway)
        gateway.ctl("set", "limit", "7")
        wait_found(gateway, "total", 7, "good")
        gateway.ctl("set", "setpoint", "31")
        gateway.ctl("set", "scratch", "32")
        before = moment(wait_found(gateway, "setpoint", 31, "good"))
        file = directory / "journal/events"
        wait_record(gateway, file, 31)
        cut_power(gateway)

        with file.open("ab") as torn:
            torn.write(file.read_bytes()[:50])
        time.sleep(max(0.0, before + 2 * SLACK_S - time.monotonic()))  # a new time would be another one
        gateway.start()
        after = wait_found(gateway, "setpoint", 31, "not topical")
        wait_found(gateway, "scratch", 0, "good")
        wait_found(gateway, "limit", 7, "good")
        wait_found(gateway, "total", 7, "not topical")
        gateway.ctl("set", "limit", "9")
        wait_found(gateway, "total", 9, "not topical")
        assert abs(moment(after) - before) < SLACK_S
        assert "3 retained points restored from the journal" in gateway.log(1000)
        assert "the journal's last 50 bytes are incomplete" in gateway.log(1000)

        gateway.ctl("set", "setpoint", "-5")
        wait_found(gateway, "setpoint", -5, "good")


def counting(directory: Path) -> dict[str, Any]:
    names = enumerate(("limit", "shown", "length"), 1)
    program = {
        "name": "counts",
        "program": str(directory / "counts.rtul"),
        "period_ms": 20,
        "ca": 923,
        "points": [{"name": name, "ioa": ioa, "type": "integer"} for ioa, name in names],
    }
    program["points"][0] |= {"value": 3, "retain": True}
    journal = {"path": str(directory / "journal"), "interval_s": 1, "volume_mb": 1048576}
    return listening_on({"port": [], "logic": [program], "journal": journal}, free_port())


def rewrite(directory: Path, kind: str, initial: int, counts: bool) -> None:
    text = COUNTS.format(kind, initial, counts, counts)
    (directory / "counts.rtul").write_bytes(encode(compile_text(text, Findings())))


@pytest.mark.slow
def test_variables_outlive_the_power(programs: Path, directory: Path) -> None:
    """By name and type, with their quality; what has another type now, or is damaged, begins anew."""
    file = directory / "journal/events"
    kept = (7).to_bytes(4, "little") + b"\0\0\x84"  # the value, its quality, that it is a variable
    rewrite(directory, "DINT", 0, True)
    with Gateway(counting(directory), directory, programs) as gateway:
        wait_found(gateway, "length", 14, "good")
        gateway.ctl("set", "limit", "7")
        gateway.wait_for(
            lambda: file.exists() and kept in file.read_bytes(), PATIENCE_S, "the journal has it"
        )
        cut_power(gateway)
        rewrite(directory, "DINT", 0, False)
        gateway.start()
        wait_found(gateway, "length", 14, "good")
        wait_found(gateway, "shown", 7, "good")
        log = gateway.log(1000)
        assert "5 retained values of programs restored from the journal" in log
        assert "belong to no variable" not in log

        cut_power(gateway)
        rewrite(directory, "INT", 9, False)
        gateway.start()
        wait_found(gateway, "shown", 9, "good")
        wait_found(gateway, "length", 14, "good")
        assert "1 retained values of the journal belong to no variable" in gateway.log(1000)

        cut_power(gateway)
        damaged = bytearray(file.read_bytes())
        damaged[20] ^= 1
        file.write_bytes(damaged)
        rewrite(directory, "INT", 1, False)
        gateway.start()
        wait_found(gateway, "shown", 1, "good")
        wait_found(gateway, "length", 0, "good")
        assert "nothing can be read" in gateway.log(1000)
