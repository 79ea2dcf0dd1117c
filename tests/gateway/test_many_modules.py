# SPDX-License-Identifier: GPL-3.0-or-later
"""How many modules a gateway has, what a check says of them, and what becomes of those that are taken out."""

import json
import os
import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from lab.gateway import Gateway, free_port, listening_on, remove, run_directory
from lab.master import Master
from lab.modules import place, program
from openrtu_tools.logic.binary import encode
from openrtu_tools.logic.compile import compile_text
from openrtu_tools.logic.errors import Findings

ROOT = Path(__file__).resolve().parents[2]
MOST = 64  # MAP_MODULES_MAX
CA = 2000
TICKS = """from openrtu import Module
with Module() as module:
    for _ in module.scans():
        module["ticks"] = module.config["value"]
"""


COUNT = """PROGRAM count
VAR_EXTERNAL NAME : DINT; END_VAR
VAR c : DINT; END_VAR
c := c + 1;
NAME := c;
END_PROGRAM
"""


@pytest.fixture
def directory() -> Iterator[Path]:
    made = run_directory()
    yield made
    remove(made)


def foreign(name: str, path: str, value: int = 0, ca: int = CA) -> dict[str, Any]:
    point = {"name": "ticks" if ca == CA else name, "type": "scaled", "ioa": 1}
    return {
        "name": name,
        "program": path,
        "period_ms": 200,
        "heartbeat_limit_ms": 5000,
        "ca": ca,
        "points": [point],
        "config": {"value": value},
    }


def counting(directory: Path, name: str) -> str:
    """A program of logic whose point has this name."""
    path = directory / f"{name}.rtul"
    path.write_bytes(encode(compile_text(COUNT.replace("NAME", name), Findings())))
    return str(path)


def lines(count: int, first: int = 7) -> list[dict[str, Any]]:
    """Each a process; of devices that are not there."""
    device = {"id": 1, "coils": [{"address": 1}]}
    return [
        {
            "value": n,
            "host": "127.0.0.1",
            "tcp_port": 1000 + n,
            "active": 1,
            "process": n - first + 1,
            "slaves": [device],
        }
        for n in range(first, first + count)
    ]


def station(**keys: Any) -> dict[str, Any]:
    return listening_on({"port": []}, free_port()) | keys


def logic(directory: Path, count: int) -> list[dict[str, Any]]:
    """Programs l0, l1 …, each with a point of its name."""
    return [
        {
            "name": f"l{n}",
            "program": counting(directory, f"l{n}"),
            "ca": 20000 + n,
            "period_ms": 1000,
            "points": [{"name": f"l{n}", "ioa": 1}],
        }
        for n in range(count)
    ]


def too_many(directory: Path) -> dict[str, Any]:
    others = [foreign(f"m{n}", "/bin/true", ca=CA + n) for n in range(40)]
    return station(logic=logic(directory, 30), modules=others)


def one_port(directory: Path) -> dict[str, Any]:
    made = station()
    return made | {"iec61850": {"address": "0.0.0.0", "port": made["iec104"]["port"]}}


@pytest.mark.parametrize(
    ("made", "reason"),
    [
        (too_many, f"too many processes: {MOST} modules at most"),
        (one_port, "rtu-iec104 and rtu-iec61850 would listen at one port, {port} of TCP"),
    ],
    ids=["modules", "ports"],
)
def test_check_says_what_a_start_would(programs: Path, directory: Path, made: Any, reason: str) -> None:
    config = made(directory)
    file = directory / "gateway.json"
    file.write_text(json.dumps(config))
    rtud = [programs / "rtud/rtud", "--map", directory / "map", "--modules", programs / "modules"]
    reason = reason.format(port=config["iec104"]["port"])
    checked = subprocess.run([*rtud, "--check", file], capture_output=True, text=True, check=False)
    started = subprocess.run([*rtud, file], capture_output=True, text=True, check=False, timeout=20)
    assert (checked.returncode, checked.stdout, checked.stderr) == (1, "", f"{reason}\n")
    assert (started.returncode, started.stderr) == (1, f"rtud: {reason}\n")


def test_check_misses_a_program(programs: Path, directory: Path) -> None:
    """It is no error: it costs its points alone. One beside rtud will do."""
    file = directory / "gateway.json"
    file.write_text(json.dumps(station(modules=[foreign("mine", "/nowhere/mine")])))
    alone = shutil.copy(programs / "rtud/rtud", directory / "rtud")
    empty = directory / "empty"
    empty.mkdir()

    def check(rtud: str | Path) -> tuple[int, list[str]]:
        command = [rtud, "--modules", empty, "--check", file]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        return done.returncode, done.stderr.splitlines()

    note = f"note: the gateway would run without rtu-iec104: there is no program rtu-iec104 in {empty}"
    assert check(alone) == (0, [note])
    assert check(programs / "rtud/rtud") == (0, [])


@pytest.mark.slow
def test_six_lines_every_protocol_and_thirty_programs(programs: Path, directory: Path) -> None:
    config = station(
        port=lines(6),
        logic=logic(directory, 30),
        journal={"path": str(directory / "journal")},
        iec61850={"address": "127.0.0.1", "port": free_port()},
    )
    with Gateway(config, directory, programs) as gateway:

        def all_run() -> bool:
            rows = gateway.modules().values()
            return all(row["state"] == "running" for row in rows if row["kind"] != "rtuctl")

        gateway.wait_for(all_run, 120.0, "all modules run")
        counts = [f"l{n}" for n in range(30)]
        gateway.wait_for(
            lambda: all(gateway.points()[name]["quality"] == "good" for name in counts), 120.0, "all count"
        )
        modules = gateway.modules()
        if os.geteuid() == 0:
            users = [
                re.search(r"^Uid:\t(\d+)", Path(f"/proc/{row['pid']}/status").read_text(), re.MULTILINE)
                for row in modules.values()
                if row["pid"] and row["name"] != "rtud"
            ]
            assert len({user[1] for user in users if user}) == len(users) == 39


@pytest.mark.slow
def test_renamed_modules_give_their_numbers_and_users_away(programs: Path, directory: Path) -> None:
    """Each reload takes a module out and brings another, with the same point."""
    place(directory, programs)
    path = program(directory, "ticks", _script(directory / "source"))
    config = station(modules=[foreign("m0", path, 0)])
    with Gateway(config, directory, programs) as gateway, Master(*gateway.address) as master:
        gateway.wait_for(lambda: gateway.points()["ticks"]["quality"] == "good", 60.0, "it runs")
        for turn in range(1, 14):
            mark = master.mark()
            file = directory / "next.json"
            file.write_text(json.dumps(config | {"modules": [foreign(f"m{turn}", path, turn)]}))
            gateway.ctl("reload", str(file))
            told = master.wait(
                lambda r, turn=turn: (r.ca, r.value, r.good) == (CA, turn, True), since=mark, what=f"m{turn}"
            )
            assert told.ioa == 1
        modules = gateway.modules()
        assert modules["m13"]["state"] == "running"
        assert len(modules) < 20
        bells = [file.name for file in gateway.map.glob("m*.bell")]
        assert len(bells) <= 10, bells
        assert gateway.modules()["rtu-iec104"]["restarts"] == 0


def _script(directory: Path) -> Path:
    directory.mkdir()
    script = directory / "ticks.py"
    script.write_text(TICKS)
    return script
