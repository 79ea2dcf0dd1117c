# SPDX-License-Identifier: GPL-3.0-or-later
"""Programs in the configuration: what rtud --check says of them, and schema and loader agree."""

import copy
import json
import random
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from openrtu_tools.logic.binary import encode
from openrtu_tools.logic.compile import compile_text
from openrtu_tools.logic.errors import Findings

ROOT = Path(__file__).resolve().parents[2]
SCHEMA = json.loads((ROOT / "package/openrtu/src/rtud/config.schema.json").read_text())
PROGRAM = """PROGRAM p
VAR_EXTERNAL
  level, whole : INT; order, breaker, alarm : BOOL; total : UDINT; limit : REAL;
END_VAR
VAR asked : REQUEST; act : COMMAND; END_VAR
asked(POINT := order, REFUSE := level > 5, STATE := act.STATE, RESULT := act.RESULT);
act(POINT := breaker, EXECUTE := asked.ACTIVE, VALUE := asked.VALUE);
alarm := INT_TO_REAL(level) > limit;
whole := level; total := INT_TO_UDINT(level);
END_PROGRAM
"""

Edit = Callable[[dict[str, Any]], object]


def compiled(text: str) -> bytes:
    findings = Findings()
    program = compile_text(text, findings)
    assert not findings.failed, findings.sorted()
    return encode(program)


def document() -> dict[str, Any]:
    pace = {"baud_rate": 9600, "data_bits": 8, "stop_bits": 1, "parity": 0}
    slave = {
        "id": 10,
        "coils": [{"address": 0, "name": "breaker"}],
        "discrete_inputs": [{"address": 0, "name": "door"}],
        "input_registers": [
            {"address": 0, "name": "tank.level"},
            {"address": 1, "type": "float"},
            {"address": 3, "format": "string", "length": 4, "name": "serial"},
        ],
    }
    points = [
        {"name": "order", "ioa": 1, "select": True},
        {"name": "alarm", "ioa": 2, "group": 3},
        {"name": "whole", "ioa": 3, "deadband": 2},
        {"name": "total", "ioa": 4, "type": "counter"},
        {"name": "limit", "ioa": 5, "value": 80.5},
    ]
    program = {
        "name": "p",
        "program": "p.rtul",
        "period_ms": 50,
        "budget": 5000,
        "ca": 7000,
        "points": points,
    }
    program["names"] = {"level": "tank.level"}
    return {"port": [{"value": 1, "active": 1, **pace, "slaves": [slave]}], "logic": [program]}


def check(
    programs: Path, folder: Path, config: dict[str, Any], octets: bytes | None = None
) -> tuple[int, list[str]]:
    (folder / "p.rtul").write_bytes(compiled(PROGRAM) if octets is None else octets)
    file = folder / "gateway.json"
    file.write_text(json.dumps(config))
    run = subprocess.run(
        [programs / "rtud/rtud", "--check", file], capture_output=True, text=True, timeout=60, check=False
    )
    return run.returncode, [line.partition(": ")[2] for line in run.stderr.splitlines()]


def test_a_good_file_is_good_for_loader_and_schema(programs: Path, tmp_path: Path) -> None:
    assert [error.message for error in Draft202012Validator(SCHEMA).iter_errors(document())] == []
    assert check(programs, tmp_path, document()) == (0, [])


def own(config: dict[str, Any], name: str) -> dict[str, Any]:
    return next(point for point in config["logic"][0]["points"] if point["name"] == name)


def without(config: dict[str, Any], name: str) -> None:
    config["logic"][0]["points"].remove(own(config, name))


@pytest.mark.parametrize(
    ("edit", "expected"),
    [
        (lambda c: c["logic"][0].update(program="q.rtul"), 'q.rtul": No such file or directory'),
        (lambda c: c["logic"][0].update(program="."), "is no file of at most 1 MiB"),
        (lambda c: c["logic"][0].update(name="P"), '"P" has other signs than a-z, 0-9'),
        (lambda c: c["logic"].append(c["logic"][0]), '"p" is the name of another program'),
        (lambda c: c["logic"][0].update(ca=1010), '1010 is the common address of "p1.10"'),
        (lambda c: c["logic"][0]["names"].clear(), 'names the point "level", which there is not'),
        (lambda c: c["logic"][0]["names"].update(level="nobody"), 'names the point "nobody", which there'),
        (lambda c: c["logic"][0]["names"].update(lvl="door"), "names.lvl: is no point of the program"),
        (lambda c: c["logic"][0]["names"].update(level=5), "names.level: expected the name of a point"),
        (lambda c: c["logic"][0]["names"].update(level="door"), "declares level with a type that no single"),
        (lambda c: c["logic"][0]["names"].update(level="p1.10.i1"), "level with a type that no float point"),
        (lambda c: c["logic"][0]["names"].update(level="serial"), "level, which is a text: no point of a"),
        (
            lambda c: c["logic"][0]["names"].update(breaker="door"),
            "commands breaker, which takes no commands",
        ),
        (lambda c: own(c, "alarm").update(name="alrm"), '"alrm" is no point of the program'),
        (lambda c: own(c, "alarm").update(select=True), "nobody can command alarm: the program writes it"),
        (lambda c: own(c, "alarm").update(value=1), "is for a point that controlling stations alone set"),
        (lambda c: own(c, "order").update(value=1), "is for a point that controlling stations alone set"),
        (lambda c: own(c, "alarm").update(ioa=1), "1 is the information object address of another"),
        (
            lambda c: own(c, "total").pop("type"),
            "is missing: the program's type for total is none of a point",
        ),
        (lambda c: own(c, "total").update(type="text"), '"text" is not known, expected one of single'),
        (lambda c: own(c, "total").update(type="float"), "float does not fit the program's type for total"),
        (lambda c: without(c, "order"), 'names the point "order", which there is not'),
        (
            lambda c: (without(c, "order"), c["logic"][0]["names"].update(order="door")),
            "has a REQUEST for order",
        ),
        (
            lambda c: (without(c, "alarm"), c["logic"][0]["names"].update(alarm="door")),
            "writes alarm, which is",
        ),
        (
            lambda c: c["port"][0]["slaves"][0]["coils"].append({"address": 3, "name": "alarm"}),
            'points[1]: needs the name "alarm", but another point has it',
        ),
    ],
)
def test_what_does_not_go_together_is_said(programs: Path, tmp_path: Path, edit: Edit, expected: str) -> None:
    config = copy.deepcopy(document())
    edit(config)
    code, errors = check(programs, tmp_path, config)
    assert code == 1
    assert any(expected in line for line in errors), errors


@pytest.mark.parametrize("octets", [b"", b"RTUL", b"\0" * 4000, b"RTUL\1\0" + bytes(300)])
def test_a_file_that_is_no_program_is_refused(programs: Path, tmp_path: Path, octets: bytes) -> None:
    code, errors = check(programs, tmp_path, document(), octets)
    assert code == 1
    assert any("expected a file that openrtu logic compile has written" in line for line in errors), errors


@pytest.mark.slow
def test_a_damaged_program_is_refused(programs: Path, tmp_path: Path) -> None:
    whole, chance = compiled(PROGRAM), random.Random(29)
    for _ in range(40):
        octets = bytearray(whole)
        octets[chance.randrange(8, len(octets))] ^= 1 << chance.randrange(8)
        code, errors = check(programs, tmp_path, document(), bytes(octets[: chance.choice((None, -7))]))
        assert (code, bool(errors)) == (1, True)


@pytest.mark.parametrize("place", ["logic[0]", "logic[0].points[0]"])
def test_schema_and_loader_know_the_same_keys(programs: Path, tmp_path: Path, place: str) -> None:
    config = document()
    target, name = (
        (config["logic"][0], "program")
        if place == "logic[0]"
        else (config["logic"][0]["points"][0], "program_point")
    )
    target["zzzzzzzz"] = 0
    assert not Draft202012Validator(SCHEMA).is_valid(config)
    _, errors = check(programs, tmp_path, config)
    (line,) = [line for line in errors if "zzzzzzzz" in line]
    assert line.partition("expected one of ")[2].split(", ") == list(SCHEMA["$defs"][name]["properties"])
    for key in SCHEMA["$defs"][name]["required"]:
        config = document()
        del (config["logic"][0] if name == "program" else config["logic"][0]["points"][0])[key]
        _, errors = check(programs, tmp_path, config)
        assert any(f"{place}.{key}: is missing" in line for line in errors), errors
