# SPDX-License-Identifier: GPL-3.0-or-later
"""Programs of Structured Text on the desk, with inputs that were recorded: a journal, a value change dump."""

import json
import os
import shlex
import struct
import zlib
from pathlib import Path

import pytest

from openrtu_tools.cli import main

SINGLE, DOUBLE, NORMALIZED, SCALED, FLOAT = 0, 1, 4, 5, 6  # enum map_type
CA = 7000
START_NS = 1_790_000_000 * 1_000_000_000  # 2026-09-21 14:13:20 UTC
TEXT = """PROGRAM p
VAR_EXTERNAL
  level : REAL; breaker, door : BOOL; count : INT;
  sum : REAL; closed, shut, fresh : BOOL; twice : INT; day : DINT;
END_VAR
sum := level + 0.5;
closed := breaker;
shut := NOT door;
twice := count * 2;
fresh := TIME_OF(count) = NOW();
day := TIME_TO_DINT(NOW() - DT#2026-09-21-00:00:00);
END_PROGRAM
"""
NAMES = {"level": "tank/level", "breaker": "q0", "door": "door", "count": "starts"}
POINTS = [("tank/level", 1, "float"), ("q0", 2, "double"), ("door", 3, "single"), ("starts", 4, "scaled")]


@pytest.fixture(autouse=True)
def desk(programs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if "OPENRTU_LOGIC_DESK" not in os.environ:
        monkeypatch.setenv("OPENRTU_LOGIC_DESK", shlex.quote(str(programs / "logic/logic-desk")))
    monkeypatch.setenv("OPENRTU_JOURNAL_EVENTS", str(programs / "journal/journal-events"))


@pytest.fixture
def program(tmp_path: Path) -> Path:
    (tmp_path / "p.st").write_text(TEXT)
    rows = [{"name": name, "ca": CA, "ioa": ioa, "type": kind} for name, ioa, kind in POINTS]
    (tmp_path / "points.json").write_text(json.dumps(rows))
    return tmp_path / "p.st"


def event(after_ms: int, ioa: int, kind: int, value: float, quality: int = 0) -> bytes:
    bits = struct.pack("<f", value) if kind == FLOAT else struct.pack("<i", value)
    head = struct.pack("<HBBII", CA, 1, kind, ioa, 0)
    return head + bits + struct.pack("<BBBBQ", quality, 0, 0, 1, START_NS + after_ms * 1_000_000)


def record(number: int, *events: bytes) -> bytes:
    """As package/openrtu/src/journal/record.h describes it, without queues."""
    rest = struct.pack("<BBHI", 1, 0, 0, len(events)) + b"".join(events)
    head = struct.pack("<4sII", b"ORJ1", len(rest), number)
    return head + struct.pack("<I", zlib.crc32(rest, zlib.crc32(head))) + rest


def test_a_journal_runs_a_program_at_the_time_that_it_recorded(
    program: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    journal = program.parent / "events"
    first = [
        event(0, 1, FLOAT, 1.5),
        event(0, 2, DOUBLE, 2),
        event(0, 3, SINGLE, 1),
        event(1000, 9, SCALED, 5),  # of another point
        event(1500, 4, SCALED, 40000 - 65536),
    ]
    torn = record(2, event(9000, 4, SCALED, 1))[:-3]
    journal.write_bytes(
        record(0, *first)
        + record(1, event(1000, 2, DOUBLE, 3), event(2000, 1, FLOAT, 2.5, 0x80), event(2000, 4, SCALED, 7))
        + torn
    )
    points = str(program.parent / "points.json")
    names = [f"--name={name}={point}" for name, point in NAMES.items()]
    words = ["run", str(program), str(journal), "--points", points, "--period", "500", "--json", *names]
    assert main(["logic", *words]) == 0
    steps = json.loads(capsys.readouterr().out)
    assert [step["time"] for step in steps] == [0.0, 0.5, 1.0, 1.5, 2.0]
    seen = [{name: out["value"] for name, out in step["outputs"].items()} for step in steps]
    flags = [{name for name, out in step["outputs"].items() if out["quality"] & 0x80} for step in steps]
    assert [row["sum"] for row in seen] == [2.0, 2.0, 2.0, 2.0, 3.0]
    assert [row["closed"] for row in seen] == [True, True, False, False, False]
    assert [row["day"] for row in seen] == [51_200_000 + 500 * n for n in range(5)]
    assert [row["fresh"] for row in seen][3:] == [True, True] and seen[4]["twice"] == 14
    assert flags == [{"twice"}, {"twice"}, {"twice", "closed"}, {"twice", "closed"}, {"closed", "sum"}]


GIVEN = ["--points", "points.json", *(f"--name={name}={point}" for name, point in NAMES.items())]


@pytest.mark.parametrize(
    ("content", "more", "says"),
    [
        (b"ORJ1 but nothing more", GIVEN, "octet 0 begins no record"),
        (record(0), [], "--points FILE"),
        (record(0), ["--points", "p.st"], "has no points"),
        (record(0), ["--points", "points.json"], "lacks breaker, count, level: --name NAME=POINT"),
        (record(0, event(0, 9, SCALED, 1)), GIVEN, "none of its 1 events"),
        (b"time,level\n0,1\n", ["--points", "points.json"], "is none"),
    ],
)
def test_what_is_wrong_with_a_journal(
    program: Path, content: bytes, more: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    journal = program.parent / "events"
    journal.write_bytes(content)
    words = [str(program.parent / word) if "." in word else word for word in more]
    assert main(["logic", "run", str(program), str(journal), *words]) == 2
    assert says in capsys.readouterr().err


DUMP = """$date today $end $timescale 10 ms $end
$scope module board $end
$var wire 1 ! door $end $var wire 16 a Count $end $var real 64 # level $end
$upscope $end $enddefinitions $end
#0 $dumpvars 0! b1111111111111101 a r2.25 # $end
#100
x!
b101 a
#250 1! rnan #
"""


def test_a_dump_is_an_input_and_an_output(program: Path) -> None:
    dump, out = program.parent / "in.vcd", program.parent / "out.vcd"
    dump.write_text(DUMP)
    assert main(["logic", "run", str(program), str(dump), "--period", "500", "-o", str(out)]) == 0
    text = out.read_text()
    names = {line.split()[4]: line.split()[3] for line in text.splitlines() if line.startswith("$var")}
    changes: dict[str, list[str]] = {}
    for part in text.split("#")[1:]:
        time, *values = part.splitlines()
        changes[time] = values
    assert f"r2.75 {names['sum']}" in changes["0"] and f"1{names['shut']}" in changes["0"]
    assert f"x{names['closed']}" in changes["0"]
    minus_six = (1 << 64) - 6
    assert f"b{minus_six:b} {names['twice']}" in changes["0"]
    assert f"x{names['shut']}" in changes["1000000"] and f"b1010 {names['twice']}" in changes["1000000"]
    assert f"rnan {names['sum']}" in changes["2500000"] and f"0{names['shut']}" in changes["2500000"]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("nothing at all", "is no value change dump"),
        (DUMP[:60], "cut off"),
        (DUMP.replace("10 ms", "10 days"), "is no value change dump"),
        (DUMP.replace("level", "x").replace("Count", "y").replace("door", "z"), "no variable of it has"),
        (DUMP.replace("#250", "#50"), "the time goes backwards at #50"),
    ],
)
def test_what_is_wrong_with_a_dump(
    program: Path, text: str, says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    dump = program.parent / "in.vcd"
    dump.write_text(text)
    assert main(["logic", "run", str(program), str(dump)]) == 2
    assert says in capsys.readouterr().err
