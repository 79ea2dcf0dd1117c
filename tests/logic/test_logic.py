# SPDX-License-Identifier: GPL-3.0-or-later
"""Structured Text: values, qualities, faults; compiler and machine beside a second interpreter."""

import json
import math
import os
import random
import re
import shlex
import struct
import subprocess
import zlib
from pathlib import Path

import pytest
from logic_findings import MODE, UNIT, findings_of
from logic_reference import INPUTS, Random, Reference, text_of

from openrtu_tools.cli import main
from openrtu_tools.logic.binary import encode
from openrtu_tools.logic.compile import compile_text
from openrtu_tools.logic.desk import Desk, Scan, Value, desk_command
from openrtu_tools.logic.errors import Findings
from openrtu_tools.logic.table import ANSWERS
from openrtu_tools.logic.watch import named

ROOT = Path(__file__).resolve().parents[2]
SECOND = 1_000_000


@pytest.fixture(autouse=True)
def machine(programs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if "OPENRTU_LOGIC_DESK" not in os.environ:
        monkeypatch.setenv("OPENRTU_LOGIC_DESK", shlex.quote(str(programs / "logic/logic-desk")))


def scans(
    body: str, declared: str, *inputs: dict[str, Value], budget: int = 200_000, units: str = ""
) -> list[Scan]:
    findings = Findings()
    program = compile_text(f"{units}PROGRAM p\n{declared}\n{body}\nEND_PROGRAM", findings)
    assert not findings.failed, findings.sorted()
    with Desk(program, budget) as desk:
        return [desk.scan(n * SECOND, SECOND, n * SECOND, values) for n, values in enumerate(inputs or [{}])]


def result(expression: str, kind: str, declared: str = "") -> Value:
    (scan,) = scans(f"out := {expression};", f"{declared} VAR_EXTERNAL out : {kind}; END_VAR")
    return scan.outputs["out"]


# ---- values ------------------------------------------------------------------------------------------

CONFORMITY = [
    ("7 MOD 3 - 7 / 2 * 2", "DINT", -5),
    ("-7 / 2", "DINT", -3),
    ("i ** 3", "LREAL", 1000.0),
    ("i > 3 AND NOT (i = 4) XOR FALSE", "BOOL", True),
    ("SUB(ADD(i, 2, MUL(3, i, 2)), DIV(i, MOD(i, 4)))", "DINT", 67),
    ("AND(GT(i, 9), GE(i, 10), LT(i, 11), LE(10, i), NE(i, 9)) AND OR(FALSE, EQ(i, 10))", "BOOL", True),
    ("XOR(i > 3, TRUE, MOVE(i) = 10)", "BOOL", True),
    ("16#FF", "BYTE", 255),
    ("2#1010_1010", "BYTE", 170),
    ("SHL(BYTE#16#81, 1)", "BYTE", 2),
    ("ROL(BYTE#16#81, 1)", "BYTE", 3),
    ("ROR(WORD#1, 1)", "WORD", 0x8000),
    ("NOT WORD#16#0F0F", "WORD", 0xF0F0),
    ("REAL_TO_INT(2.5)", "INT", 2),
    ("REAL_TO_INT(3.5)", "INT", 4),
    ("TRUNC(-2.9)", "DINT", -2),
    ("DINT_TO_BYTE(i * 26)", "BYTE", 4),
    ("BOOL_TO_INT(i > 3)", "INT", 1),
    ("INT_TO_BOOL(i)", "BOOL", True),
    ("TIME_TO_DINT(T#1m2s3ms)", "DINT", 62003),
    ("DINT_TO_TIME(1500) + T#500ms", "TIME", 2_000_000),
    ("T#3s * 2 - T#1s", "TIME", 5_000_000),
    ("T#3s / 2.0", "TIME", 1_500_000),
    ("DT#2026-01-02-00:00:00 - DT#2026-01-01-00:00:00", "TIME", 86_400_000_000),
    ("DT#1970-01-01-00:00:00 + T#1d", "DATE_AND_TIME", 86_400_000_000),
    ("MAX(1, i, 3)", "INT", 10),
    ("MIN(i, 3, 7)", "INT", 3),
    ("LIMIT(0, i, 5)", "INT", 5),
    ("SEL(i > 3, 1, 2)", "DINT", 2),
    ("MUX(i - 8, 5, 6, 7)", "INT", 7),
    ("MUX(0, 1.5, 2)", "LREAL", 1.5),
    ("SEL(i > 3, 1, 2)", "INT", 2),
    ("SEL(i > 3, 16#01, MAX(2, 3))", "BYTE", 3),
    ("SEL(i > 3, 1, 2)", "REAL", 2.0),
    ("MAX(1, 3, i)", "INT", 10),
    ("MIN(7, 3)", "SINT", 3),
    ("LIMIT(1, 9, 5)", "USINT", 5),
    ("late + T#1s", "TIME", 6_000_000),
    ("late * 2", "TIME", 10_000_000),
    ("day + late", "DATE_AND_TIME", 86_405_000_000),
    ("day - DT#1970-01-01-00:00:00", "TIME", 86_400_000_000),
    ("late > T#4s", "BOOL", True),
    ("-late", "TIME", -5_000_000),
    ("n * 2 + 1", "INT", 601),
    ("ABS(-i)", "INT", 10),
    ("SQRT(2.0)", "LREAL", math.sqrt(2)),
    ("ATAN(1.0) * 4.0", "LREAL", math.pi),
]


PAGE = (ROOT / "docs/logic.md").read_text()
TABLE = re.findall(r"^\| [^|]+ \| `([^`]+)` \| (yes|no) \|$", PAGE, re.MULTILINE)


@pytest.mark.parametrize(("example", "there"), TABLE)
def test_what_there_is_of_the_language(example: str, there: str) -> None:
    units = example if example.startswith(("FUNCTION", "TYPE")) else ""
    declared = example if example.startswith("VAR") else ""
    if not units and not declared:
        declared = "VAR_EXTERNAL x : INT; b : BOOL; r : REAL; w : WORD; END_VAR " + example
    text = f"{units} PROGRAM p {declared} END_PROGRAM"
    errors = [finding for finding in findings_of(text) if ": error: " in finding]
    assert (errors == []) == (there == "yes"), errors


def test_the_table_of_the_language_is_whole() -> None:
    assert len(TABLE) == len(re.findall(r"\| (?:yes|no) \|$", PAGE, re.MULTILINE))
    assert len(TABLE) > 30


@pytest.mark.parametrize(("expression", "kind", "expected"), CONFORMITY)
def test_conformity(expression: str, kind: str, expected: float) -> None:
    declared = """VAR i : INT := 10; END_VAR
VAR CONSTANT late : TIME := T#5s; day : DT := DT#1970-01-02-00:00:00; n : INT := 300; END_VAR"""
    found = result(expression, kind, declared)
    assert found.quality == 0
    assert found.value == pytest.approx(expected, rel=1e-15)


@pytest.mark.parametrize(
    "function", ["SQRT", "LN", "LOG", "EXP", "SIN", "COS", "TAN", "ASIN", "ACOS", "ATAN"]
)
def test_functions_are_those_of_mathematics(function: str) -> None:
    """Beside the C library's: within some units of the last digit, relative to the argument's scale."""
    chance = random.Random(function)
    arguments = [chance.uniform(-1, 1) for _ in range(60)]
    if function in ("SQRT", "LN", "LOG"):
        arguments = [abs(x) * 10 ** chance.randint(-12, 12) + 1e-300 for x in arguments]
    elif function in ("SIN", "COS", "TAN", "EXP", "ATAN"):
        arguments = [x * 10 ** chance.randint(-3, 2) for x in arguments]
    of = {"LN": math.log, "LOG": math.log10}.get(function, getattr(math, function.lower(), None))
    declared = "VAR_EXTERNAL x : LREAL; out : LREAL; END_VAR"
    found = scans(f"out := {function}(x);", declared, *({"x": Value(x)} for x in arguments))
    for x, scan in zip(arguments, found, strict=True):
        assert scan.outputs["out"].value == pytest.approx(
            of(x), rel=8e-16 if function == "SQRT" else 4e-15, abs=1e-15
        )
    if function == "SQRT":
        assert [scan.outputs["out"].value for scan in found] == [math.sqrt(x) for x in arguments]


def test_statements() -> None:
    body = """
total := 0; i := 10;
WHILE i > 0 DO i := i - 3; IF i = 4 THEN CONTINUE; END_IF; total := total + i; END_WHILE;
REPEAT total := total + 100; UNTIL total > 250 END_REPEAT;
FOR i := 5 TO 1 BY -2 DO a[i] := i; END_FOR;
CASE total OF 1, 2: kind := 1; 200..400: kind := 2; ELSE kind := 3; END_CASE;
sum := a[1] + a[3] + a[5];
limit(low := 3, value := total, clipped => small);
twice(n := total);
"""
    units = """
FUNCTION_BLOCK clip VAR_INPUT low, value : DINT; END_VAR VAR_OUTPUT clipped : DINT; END_VAR
IF value > low THEN clipped := low; RETURN; END_IF; clipped := value; END_FUNCTION_BLOCK
FUNCTION_BLOCK doubled VAR_IN_OUT n : DINT; END_VAR n := n * 2; END_FUNCTION_BLOCK
"""
    declared = """VAR_EXTERNAL total, kind, sum, small : DINT; END_VAR
VAR i : DINT; a : ARRAY[1..5] OF DINT; limit : clip; twice : doubled; END_VAR"""
    (scan,) = scans(body, declared, units=units)
    assert {name: value.value for name, value in scan.outputs.items()} == {
        "total": 612,
        "kind": 2,
        "sum": 9,
        "small": 3,
    }


def test_messages() -> None:
    """Of each MESSAGE one in a scan, as it was said last; at most eight."""
    declared = """VAR_EXTERNAL x : INT; r : REAL; w : WORD; END_VAR
VAR i : INT; t : TIME := T#90s; END_VAR"""
    body = """IF x > 3 THEN MESSAGE('it$'s {}, {}!', x, r); END_IF;
FOR i := 1 TO 3 DO MESSAGE('{} of {} {}', i, w, t); END_FOR;"""
    given = ({"x": Value(4, 0x40), "r": Value(0.5), "w": Value(10)}, {"x": Value(3), "w": Value(0)})
    first, second = scans(body, declared, *given)
    assert first.messages == ((4, "it's 4!, 0.5!!"), (5, "3 of 16#A 90 s"))
    assert second.messages == ((5, "3 of 16#0 90 s"),)
    (scan,) = scans("MESSAGE('{}{} {}', m, i, m);", f"{declared} VAR m : mode := TRIP; END_VAR", units=MODE)
    assert scan.messages == ((4, "TRIP0 TRIP"),)
    (scan,) = scans("\n".join(f"MESSAGE('{n}');" for n in range(9)), declared)
    assert [text for _, text in scan.messages] == list("01234567")


OF_TEXTS = [
    ("'it$'s $$5'", "it's $5"),
    ("CONCAT(s, '-', s, '!')", "pump 7-pump 7!"),
    ("LEFT(s, 4)", "pump"),
    ("LEFT(s, 99)", "pump 7"),
    ("RIGHT(s, 1)", "7"),
    ("RIGHT(s, 0)", ""),
    ("MID(s, 2, 3)", "mp"),
    ("MID(s, 9, 6)", "7"),
    ("MID(s, 2, 9)", ""),
    ("INSERT(s, 's', 4)", "pumps 7"),
    ("INSERT(s, '<', 0)", "<pump 7"),
    ("DELETE(s, 2, 4)", "pum7"),
    ("REPLACE(s, 'valve', 4, 1)", "valve 7"),
    ("SEL(n > 3, 'low', 'high')", "high"),
    ("MAX(s, 'pump 65', 'pum')", "pump 7"),
    ("f(LEFT(s, 2))", "pupu"),
    ("words[n - 4]", "two"),
    ("table[2].t", "second"),
    ("DINT_TO_STRING(-n * 7)", "-35"),
    ("BOOL_TO_STRING(n > 3)", "TRUE"),
    ("LREAL_TO_STRING(1.0 / 3.0)", "0.333333333333333"),
    ("TIME_TO_STRING(T#90s)", "90 s"),
    ("WORD_TO_STRING(WORD#16#FF)", "16#FF"),
    ("mode_TO_STRING(mode#RUN)", "RUN"),
    ("CONCAT(cut, '')", "abcd"),
]


def test_texts() -> None:
    units = """TYPE mode : (OFF, RUN); row : STRUCT t : STRING(6) := 'first'; n : INT; END_STRUCT; END_TYPE
FUNCTION f : STRING(12) VAR_INPUT t : STRING(3); END_VAR f := CONCAT(t, t); END_FUNCTION
"""
    declared = """VAR s : STRING := 'pump 7'; n : INT := 5; cut : STRING[4]; shown : STRING(40);
words : ARRAY[0..1] OF STRING(3) := ['one', 'two']; table : ARRAY[1..2] OF row; END_VAR"""
    told = []
    for number in range(0, len(OF_TEXTS), 8):  # so many messages a scan
        say = [f"shown := {one}; MESSAGE(shown);" for one, _ in OF_TEXTS[number : number + 8]]
        (scan,) = scans(
            "cut := 'abcdef'; table[n - 3].t := 'second'; " + "\n".join(say), declared, units=units
        )
        assert sum(scan.faults) == 0
        told += [text for _, text in scan.messages]
    assert told == [
        text if text != "abcd" else "abcd!"  # what was cut is overflown
        for _, text in OF_TEXTS
    ]


@pytest.mark.parametrize(
    ("expression", "kind", "expected"),
    [
        ("LEN(s)", "INT", Value(3)),
        ("FIND(s, 'c')", "INT", Value(3)),
        ("FIND(s, 'd')", "INT", Value(0)),
        ("FIND(s, '')", "INT", Value(0)),
        ("s = 'abc' AND s <> 'abcd' AND s < 'abcd' AND s >= 'ab' AND 'b' > s", "BOOL", Value(True)),
        ("LEN(LEFT(s, -1))", "INT", Value(0, 0x80)),
        ("LEN(MID(s, 1, 0))", "INT", Value(0, 0x80)),
        ("LEN(bad)", "INT", Value(1, 0x40)),
        ("s = bad", "BOOL", Value(False, 0x40)),
        ("LEN(CONCAT(s, AS_GOOD(bad)))", "INT", Value(4)),
        ("QUALITY(CONCAT(s, bad))", "BYTE", Value(0x40)),
        ("LEN(INT_TO_STRING(x))", "INT", Value(1, 0x40)),
        ("LEN(words[x])", "INT", Value(0, 0xC0)),  # no such element
        ("LEN(DOUBTFUL_AS(s, x))", "INT", Value(3, 0x40)),
    ],
)
def test_numbers_of_texts(expression: str, kind: str, expected: Value) -> None:
    declared = f"""VAR_EXTERNAL x : INT; out : {kind}; END_VAR
VAR s : STRING(3) := 'abc'; bad : STRING(8); words : ARRAY[1..2] OF STRING(9); END_VAR"""
    (scan,) = scans(f"bad := INT_TO_STRING(x); out := {expression};", declared, {"x": Value(7, 0x40)})
    assert scan.outputs["out"] == expected


MOTORS = """FUNCTION_BLOCK motor VAR_INPUT go : BOOL; END_VAR VAR_OUTPUT runs : BOOL; last : STRING(5);
END_VAR VAR_OUTPUT RETAIN starts : INT; END_VAR VAR late : TON; edge : R_TRIG; END_VAR
late(IN := go, PT := T#1s); runs := late.Q; edge(CLK := runs);
IF edge.Q THEN starts := starts + 1; last := INT_TO_STRING(starts); END_IF; END_FUNCTION_BLOCK
"""


def test_blocks_in_an_array_remember_each_their_own() -> None:
    declared = """VAR_EXTERNAL i, n, one : INT; x, up : BOOL; END_VAR
VAR m : ARRAY[1..3] OF motor; k : INT; c : ARRAY[0..1, 1..2] OF CTU; END_VAR"""
    body = """FOR k := 1 TO 3 DO m[k](go := k = i); END_FOR; n := m[i].starts; one := m[1].starts;
x := m[2].runs; c[1, 2](CU := m[2].runs, PV := 1, Q => up); MESSAGE(m[2].last);"""
    given = [{"i": Value(i)} for i in (1, 1, 2, 2, 1, 1, 2, 2)]
    found = scans(body, declared, *given, units=MOTORS)
    shown = [
        "".join(str(int(scan.outputs[name].value)) for scan in found) for name in ("n", "one", "x", "up")
    ]
    assert shown == ["01011212", "01111222", "00010001", "00011111"]
    assert [text for scan in found for _, text in scan.messages][-2:] == ["1", "2"]
    (outside,) = scans(body, declared, {"i": Value(4)}, units=MOTORS)
    assert (outside.outputs["n"], outside.faults[2]) == (Value(0, 0x80), 1)
    (doubtful,) = scans("m[i](go := TRUE); n := m[1].starts;", declared, {"i": Value(2, 0x40)}, units=MOTORS)
    assert doubtful.outputs["n"] == Value(0, 0x40)  # it might have been the first one


def test_blocks_in_an_array_are_retained_and_watched() -> None:
    text = (
        MOTORS
        + """PROGRAM p VAR_EXTERNAL n : INT; END_VAR VAR m : ARRAY[{0}] OF motor; END_VAR
m[2](go := TRUE); n := m[2].starts; END_PROGRAM"""
    )
    program = compile_text(text.format("1..2"), Findings())
    assert {"M[1].STARTS", "M[2].LATE.ET", "M[2].LAST"} <= set(program.debug.variables)
    with Desk(program) as desk:
        values = [desk.scan(n * SECOND, SECOND, 0, {}).outputs["n"].value for n in range(3)]
        assert desk.reload(compile_text(text.format("2..5"), Findings())) == 1
        values += [desk.scan(n * SECOND, SECOND, 0, {}).outputs["n"].value for n in range(3)]
    assert values == [0, 1, 1, 1, 2, 2]


STATION = """TYPE pump : STRUCT m : motor; limit : INT := 1; up : ARRAY[0..1] OF CTU; END_STRUCT
station : STRUCT pumps : ARRAY[1..2] OF pump := [(limit := 2)]; alone : pump; END_STRUCT END_TYPE
"""
IN_STRUCTURES = """FOR k := 1 TO 2 DO
  s.pumps[k].m(go := k = i); s.pumps[k].up[1](CU := s.pumps[k].m.runs, PV := s.pumps[k].limit);
END_FOR;
s.alone.m(go := i = 0); n := s.pumps[i].m.starts; x := s.pumps[1].up[1].Q; one := s.alone.m.starts;
IF s.alone.m.runs THEN MESSAGE(s.alone.m.last); END_IF;"""
BESIDE = {
    "s.pumps[k].m": "m[k]",
    "s.pumps[i].m": "m[i]",
    "s.pumps[k].up[1]": "up[k]",
    "s.pumps[1].up[1]": "up[1]",
}
BESIDE |= {"s.pumps[k].limit": "limit[k]", "s.alone.m": "alone"}


def test_blocks_in_structures_are_blocks_beside_them() -> None:
    """Its text with variables of their own in their place does the same, quality and faults too."""
    points = "VAR_EXTERNAL i, n, one : INT; x : BOOL; END_VAR VAR k : INT; "
    plain = IN_STRUCTURES
    for inside, outside in BESIDE.items():
        plain = plain.replace(inside, outside)
    assert "s." not in plain.replace("alone", "").replace("starts", "")
    own = "m : ARRAY[1..2] OF motor; up : ARRAY[1..2] OF CTU; limit : ARRAY[1..2] OF INT := [2, 1];"
    inputs = [Value(at, 0x40 if n == 9 else 0) for n, at in enumerate((1, 1, 2, 2, 0, 0, 1, 1, 2, 2, 3, 1))]
    given = [{"i": one} for one in inputs]
    found = scans(IN_STRUCTURES, f"{points} s : station; END_VAR", *given, units=MOTORS + STATION)
    other = scans(plain, f"{points} {own} alone : motor; END_VAR", *given, units=MOTORS)
    assert [scan.outputs for scan in found] == [scan.outputs for scan in other]
    assert [scan.faults for scan in found] == [scan.faults for scan in other]
    assert [scan.messages for scan in found] != [()] * len(found)
    shown = "".join(str(int(scan.outputs["n"].value)) for scan in found[:9])
    assert shown == "010100121" and found[7].outputs["x"].value is True


def test_blocks_in_structures_are_retained_and_watched() -> None:
    text = (
        MOTORS
        + STATION
        + """PROGRAM p VAR_EXTERNAL n : INT; END_VAR VAR {} : station; END_VAR
s.pumps[2].m(go := TRUE); n := s.pumps[2].m.starts + s.pumps[2].limit; END_PROGRAM"""
    )
    program = compile_text(text.format("s"), Findings())
    inside = set(program.debug.variables)
    assert {"S.PUMPS[1].M.STARTS", "S.PUMPS[2].M.LATE.ET", "S.PUMPS[2].UP[1].CV", "S.ALONE.M.LAST"} <= inside
    sights = named(text.format("s"), program)[-1]
    assert {one.path for one in sights} >= {"S.PUMPS[2].M.STARTS", "S.PUMPS[2].M.RUNS", "S.PUMPS[2].LIMIT"}
    with Desk(program) as desk:
        values = [desk.scan(n * SECOND, SECOND, 0, {}).outputs["n"].value for n in range(3)]
        assert desk.reload(compile_text(text.format("before, s"), Findings())) == 3
        values += [desk.scan(n * SECOND, SECOND, 0, {}).outputs["n"].value for n in range(3)]
    assert values == [1, 2, 2, 2, 3, 3]


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        ("m(go := TRUE);", "M is an array of blocks; name one: M[…]"),
        ("m[4](go := TRUE);", "the index 4 is outside of 1..3"),
        ("m[1].late(IN := TRUE);", "M[…] is a block; call it: M[…](…)"),
        ("x := m.runs;", "M is an array of blocks; name one: M[…]"),
        ("x := m[1];", "M[…] is a block; name one of its outputs"),
        ("x := m[1].late;", "M has no output LATE; did you mean LAST?"),
        ("m[1].runs := x;", "only the block itself writes M.RUNS"),
        ("m[1] := x;", "M[…] is a block; name one of its outputs"),
        ("MESSAGE(m[i].last);", "LAST is not one value; it needs a constant as index"),
        ("m[1, 2](go := TRUE);", "m has 1 dimension, found 2 indices"),
        ("x[1](go := TRUE);", "X is not a function block"),
    ],
)
def test_mistakes_with_arrays_of_blocks(body: str, expected: str) -> None:
    declared = "VAR_EXTERNAL x : BOOL; i : INT; END_VAR VAR m : ARRAY[1..3] OF motor; END_VAR"
    found = findings_of(f"{MOTORS}PROGRAM p {declared}\n{body}\nEND_PROGRAM")
    assert any(finding.lower().endswith(expected.lower()) for finding in found), found
    declared = "VAR c : ARRAY[1..2] OF COMMAND; END_VAR"
    assert any(
        "it must be a plain variable" in one for one in findings_of(f"PROGRAM p {declared} END_PROGRAM")
    )


def test_texts_of_blocks_are_handed_over_and_retained() -> None:
    text = """FUNCTION_BLOCK log VAR_INPUT new : STRING; END_VAR VAR_IN_OUT all : STRING(8); END_VAR
VAR_OUTPUT last : STRING(4); END_VAR last := all; all := CONCAT(all, new); END_FUNCTION_BLOCK
PROGRAM p VAR_EXTERNAL n : INT; END_VAR VAR RETAIN all : STRING({0}); END_VAR
VAR l : log; last : ARRAY[1..2] OF STRING(9); i : INT := 2; END_VAR
l(new := 'ab', all := all, last => last[i]); MESSAGE('{{}} {{}} {{}}', all, last[2], l.last); n := LEN(all);
END_PROGRAM"""
    with Desk(compile_text(text.format(8), Findings())) as desk:
        told = [desk.scan(n, 1, n, {}).messages[0][1] for n in range(5)]
        assert told == [
            "ab  ",
            "abab ab ab",
            "ababab abab abab",
            "abababab abab! abab!",
            "abababab! abab! abab!",
        ]
        assert desk.reload(compile_text(text.format(8), Findings())) == 1
        assert desk.scan(5, 1, 5, {}).outputs["n"] == Value(8, 1)
        assert desk.reload(compile_text(text.format(7), Findings())) == 0
        assert desk.scan(6, 1, 6, {}).outputs["n"] == Value(2)


def test_run_prints_what_a_program_says(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, table = tmp_path / "p.st", tmp_path / "p.csv"
    file.write_text(
        "PROGRAM p\nVAR_EXTERNAL x : INT; END_VAR\nIF x > 1 THEN MESSAGE('x is {}', x); END_IF;\nEND_PROGRAM"
    )
    table.write_text("time,x\n0,1\n1,2\n")
    assert main(["logic", "run", str(file), str(table), "--period", "1000"]) == 0
    assert capsys.readouterr().err == f"{file}:3: at 1 s: x is 2\n"


def test_enumerations() -> None:
    types = """TYPE mode : (OFF, RUN := 5, TRIP) := RUN; END_TYPE
FUNCTION next : mode VAR_INPUT m : mode; END_VAR
CASE m OF OFF: next := mode#RUN; RUN: next := TRIP; ELSE next := OFF; END_CASE; END_FUNCTION """
    declared = """VAR_EXTERNAL a, b, c : INT; d : BOOL; END_VAR
VAR x : mode; y : mode := TRIP; z : ARRAY[1..2] OF mode := [OFF]; END_VAR
VAR CONSTANT k : mode := TRIP; END_VAR"""
    body = """x := next(x); a := mode_TO_INT(x); b := mode_TO_INT(z[2]); c := mode_TO_INT(SEL(x = k, y, OFF));
d := z[1] <> RUN AND y = k;"""
    found = scans(body, declared, {}, {}, {}, units=types)
    assert [[scan.outputs[name].value for name in "abcd"] for scan in found] == [
        [6, 5, 0, True],
        [0, 5, 6, True],
        [5, 5, 6, True],
    ]


@pytest.mark.parametrize(
    ("cases", "expected"),
    [
        ("OFF: i := 1;", "this CASE has neither ELSE nor RUN, TRIP of MODE"),
        ("OFF: i := 1; mode#RUN, OFF: i := 2; ELSE i := 3;", "MODE#OFF is already a case in line 2"),
        ("OFF: i := 1; mode#RUN, TRIP: i := 2;", None),
    ],
)
def test_a_case_of_an_enumeration_is_whole(cases: str, expected: str | None) -> None:
    declared = "VAR_EXTERNAL i : INT; END_VAR VAR m : mode; END_VAR"
    found = findings_of(f"{MODE}PROGRAM p {declared}\nCASE m OF {cases} END_CASE;\nEND_PROGRAM")
    assert [finding.partition("warning: ")[2] for finding in found] == ([expected] if expected else [])


def test_structures_and_arrays_are_handed_over() -> None:
    units = """TYPE
  row : ARRAY[-1..1] OF INT := [1, 2(2)];
  limit : STRUCT low, high : REAL := 9.0; END_STRUCT;
  line : STRUCT name : INT; l : limit := (low := 1.0); r : row; END_STRUCT
END_TYPE
FUNCTION width : REAL VAR_INPUT l : limit; END_VAR VAR own : limit; END_VAR
own.high := own.high + 1.0; width := l.high - l.low + own.high; END_FUNCTION
FUNCTION sum : INT VAR_INPUT m : ARRAY[1..2, 1..2] OF INT; END_VAR
sum := m[1, 1] + m[1, 2] * 10 + m[2, 1] * 100 + m[2, 2] * 1000; END_FUNCTION
FUNCTION_BLOCK shift VAR_IN_OUT r : row; END_VAR VAR_OUTPUT was : line; END_VAR
was.r := r; r[-1] := r[0]; r[0] := r[1]; r[1] := 7; END_FUNCTION_BLOCK
"""
    declared = """VAR_EXTERNAL i, a, b, c, d, e, f : INT; x : REAL; END_VAR
VAR lines : ARRAY[1..3] OF line := [(r := [4, 5, 6]), 2((name := 8, l := (high := 3.0)))];
m : ARRAY[1..2] OF ARRAY[1..2] OF INT := [[1, 2], [3, 4]]; s : shift; k : line; END_VAR
VAR CONSTANT table : ARRAY[0..2] OF INT := [10, 20, 30]; END_VAR"""
    body = """x := width(lines[2].l); k := lines[i]; s(r := lines[i].r, was => lines[3]);
a := k.r[0]; b := lines[i].r[1]; c := lines[3].r[-1]; d := sum(m); m[2] := m[i]; e := sum(m);
f := table[i];"""
    first, second, outside = scans(body, declared, *({"i": Value(i)} for i in (1, 1, 3)), units=units)
    assert {name: value.value for name, value in first.outputs.items()} == {
        "x": 12.0, "a": 5, "b": 7, "c": 4, "d": 4321, "e": 2121, "f": 20
    }  # fmt: skip
    assert [second.outputs[name].value for name in "abc"] == [6, 7, 5]
    # The row that is not there: each of its two values is a fault, of the table another one.
    assert (outside.faults[2], outside.outputs["e"].quality, outside.outputs["f"]) == (
        2 + 1,
        0x80,
        Value(0, 0x80),
    )


def test_a_doubtful_index_doubts_what_it_may_have_chosen() -> None:
    declared = """VAR_EXTERNAL i : INT; a, b, c, d : BYTE; END_VAR
VAR u : ARRAY[1..2] OF unit; m : ARRAY[1..2, 1..2] OF INT; END_VAR"""
    body = """u[i].v[1] := 1.0; m[2, i] := 1;
a := QUALITY(u[1].v[1]); b := QUALITY(u[2].v[2]); c := QUALITY(m[2, 1]); d := QUALITY(m[1, 2]);"""
    (scan,) = scans(body, declared, {"i": Value(2, 0x80)}, units=UNIT)
    assert [scan.outputs[name].value for name in "abcd"] == [0x80, 0, 0x80, 0]


def test_a_case_of_constants() -> None:
    declared = "VAR CONSTANT mode : USINT := 2; two : INT := 2; END_VAR VAR_EXTERNAL out : INT; END_VAR"
    (scan,) = scans("CASE mode OF 1: out := 10; two: out := 20; END_CASE;", declared)
    assert scan.outputs["out"] == Value(20)


def test_what_remembers_nothing_begins_anew_at_each_call() -> None:
    units = """FUNCTION count : INT VAR n : INT := 4; a : ARRAY[1..2] OF INT := [7]; END_VAR
n := n + 1; a[1] := a[1] + n; a[2] := a[2] + 1; count := a[1] + a[2]; END_FUNCTION
FUNCTION_BLOCK block VAR_OUTPUT sum : INT; END_VAR VAR_TEMP n : INT; a : ARRAY[1..2] OF INT; END_VAR
n := n + 1; a[2] := a[2] + n; sum := n + a[2]; END_FUNCTION_BLOCK
"""
    declared = "VAR_EXTERNAL f, b, t : INT; END_VAR VAR g : block; END_VAR VAR_TEMP n : INT := 2; END_VAR"
    for scan in scans("n := n + 1; t := n; f := count(); g(sum => b);", declared, {}, {}, units=units):
        assert [scan.outputs[name].value for name in ("f", "b", "t")] == [13, 2, 3]


def test_codes_of_commands_are_those_of_the_map() -> None:
    text = (ROOT / "package/openrtu/src/map/codes.h").read_text()

    def names(rows: str) -> dict[int, str]:
        table = text.partition(f"#define {rows}(ROW)")[2].partition("\n\n")[0]
        return {int(number): name for name, number in re.findall(r"ROW\((\w+), (\d+),", table)}

    states, results = names("MAP_COMMAND_STATES"), names("MAP_COMMAND_RESULTS")
    assert {name: (states[state], results[result]) for name, (state, result) in ANSWERS.items()} == {
        "DONE": ("MAP_EXECUTED_COMMAND", "MAP_RESULT_DONE"),
        **{
            name: ("MAP_REFUSED_COMMAND", f"MAP_RESULT_{name}")
            for name in ("EXCEPTION", "TIMEOUT", "TOO_OLD", "INTERLOCK", "OUT_OF_RANGE")
        },
    }


def test_a_table_says_how_a_device_answers(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "p.st").write_text("""PROGRAM p
VAR_EXTERNAL go, breaker : BOOL; state, result : USINT; END_VAR
VAR c : COMMAND; END_VAR
c(POINT := breaker, EXECUTE := go, VALUE := 1.0);
state := c.STATE; result := c.RESULT;
END_PROGRAM
""")
    table = tmp_path / "p.test.csv"
    table.write_text("""time,go,answer breaker,= state,= result
0,0,EXCEPTION,0,0
1,1,,,
2,0,DONE,8,2
3,1,,,
4,,,9,1
""")
    assert main(["logic", "test", str(tmp_path / "p.st")]) == 0, capsys.readouterr()
    for text, complaint in (
        ("time,answer go\n0,DONE\n", "no command of the program goes to go"),
        ("time,answer breaker\n0,OK\n", "'OK' is not an answer of a device, expected one of DONE, EXCEPTION"),
    ):
        table.write_text(text)
        assert main(["logic", "test", str(tmp_path / "p.st")]) == 2
        assert complaint in capsys.readouterr().err


def test_timers_and_counters() -> None:
    body = """on(IN := x, PT := T#2s); off(IN := x, PT := T#2s); pulse(IN := x, PT := T#2s);
up(CU := x, PV := 2); q_on := on.Q; q_off := off.Q; q_pulse := pulse.Q; q_up := up.Q;"""
    declared = """VAR_EXTERNAL x, q_on, q_off, q_pulse, q_up : BOOL; END_VAR
VAR on : TON; off : TOF; pulse : TP; up : CTU; END_VAR"""
    found = scans(body, declared, *({"x": Value(bit == "1")} for bit in "0111100010"))
    traces = {
        name: "".join(str(int(scan.outputs[name].value)) for scan in found) for name in found[0].outputs
    }
    assert traces == {
        "q_on": "0001100000",
        "q_off": "0111111011",
        "q_pulse": "0110000011",
        "q_up": "0000000011",
    }


# ---- quality -----------------------------------------------------------------------------------------

BAD, GOOD = Value(5, 0x80), Value(5)


@pytest.mark.parametrize(
    ("body", "quality"),
    [
        ("out := x + 1;", 0x80),
        ("out := 1; IF x > 3 THEN out := 2; END_IF;", 0x80),
        ("out := 1; IF x > 300 THEN out := 2; END_IF;", 0x80),  # it might have been
        ("out := 0; FOR i := 1 TO x DO out := out + 1; END_FOR;", 0x80),
        ("out := 0; FOR i := 1 TO 9 DO IF x = i THEN EXIT; END_IF; out := i; END_FOR;", 0x80),
        ("out := 0; FOR i := 1 TO 9 DO IF x > 300 THEN EXIT; END_IF; out := i; END_FOR;", 0x80),
        ("out := 7; IF x > 300 THEN RETURN; END_IF; out := 8;", 0x80),
        ("a[x] := 1; out := a[1];", 0x80),
        ("out := SEL(IS_GOOD(x), 1, x);", 0),
        ("out := SEL(x > 3, x, i);", 0x80),
        ("IF IS_GOOD(x) THEN out := x; ELSE out := 0; END_IF;", 0),
        ("out := AS_GOOD(x);", 0),
        ("out := DOUBTFUL_AS(i, x);", 0x80),
        ("out := MUX(0, i, x);", 0),
        ("out := MUX(1, i, x);", 0x80),
        ("out := MUX(SEL(x > 3, 0, 0), i, i);", 0x80),
        ("out := 1; i := x;", 0),
        ("out := BYTE_TO_INT(QUALITY(x));", 0),
    ],
)
def test_quality_goes_where_the_value_goes(body: str, quality: int) -> None:
    declared = "VAR_EXTERNAL x, out : INT; END_VAR VAR i : INT; a : ARRAY[1..9] OF INT; END_VAR"
    for given, expected in ((BAD, quality), (GOOD, 0)):
        (scan,) = scans(body, declared, {"x": given})
        assert scan.outputs["out"].quality == expected


def test_time_of_a_point() -> None:
    declared = "VAR_EXTERNAL x : INT; old : BOOL; END_VAR"
    body = "old := NOW() - TIME_OF(x) > T#1s; IF x > 100 THEN old := TRUE; END_IF;"
    first, later = scans(body, declared, {"x": Value(1, 0, 0)}, {"x": Value(1, 0, -SECOND)})
    assert (first.outputs["old"].value, later.outputs["old"].value) == (False, True)


def test_a_command_is_an_import() -> None:
    declared = "VAR_EXTERNAL breaker, ok : BOOL; END_VAR VAR c : COMMAND; END_VAR"
    body = "c(POINT := breaker, EXECUTE := TRUE, VALUE := 1.0, SELECT := TRUE); ok := c.STATE = 9;"
    program = compile_text(f"PROGRAM p {declared} {body} END_PROGRAM", Findings())
    with Desk(program) as desk:
        asked = desk.scan(0, 0, 0, {"breaker": Value(False)})
        answered = desk.scan(1, 1, 1, {"breaker": Value(False)}, [(9, 1)])
    assert program.commands[0].name == "breaker"
    assert asked.commands == [(Value(True), 1.0, True)]
    assert (asked.outputs["ok"].value, answered.outputs["ok"].value) == (False, True)


# ---- faults ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("body", "fault", "quality"),
    [
        ("out := 5 / zero;", "division by zero", 0x80),
        ("out := 5 MOD zero;", "division by zero", 0x80),
        ("out := big * big;", "out of its type's range", 0x81),
        ("out := a[zero];", "index out of bounds", 0x80),
        ("out := MUX(zero + 2, big, zero);", "index out of bounds", 0x80),
        ("a[zero] := 1; out := a[2];", "index out of bounds", 0x80),
        ("out := LREAL_TO_DINT(SQRT(-1.0));", "outside of a function's domain", 0x80),
        ("out := LREAL_TO_DINT(1.0E30);", "out of its type's range", 0x81),
        ("WHILE zero = 0 DO out := 1; END_WHILE;", "too many instructions", 0x80),
    ],
)
def test_a_fault_is_counted_and_its_result_invalid(body: str, fault: str, quality: int) -> None:
    declared = """VAR_EXTERNAL out : DINT; END_VAR
VAR zero : DINT; big : DINT := 2000000000; a : ARRAY[1..3] OF DINT; END_VAR"""
    (scan,) = scans(body, declared)
    assert (scan.last_fault, sum(scan.faults), scan.outputs["out"].quality) == (fault, 1, quality)
    assert scan.last_line == 4  # the text's


def test_a_scan_after_an_endless_one_is_whole() -> None:
    declared = "VAR_EXTERNAL x : BOOL; out : DINT; END_VAR"
    first, second = scans(
        "WHILE x DO out := 1; END_WHILE; out := 3;", declared, {"x": Value(True)}, {"x": Value(False)}
    )
    assert (first.outputs["out"].quality, second.outputs["out"]) == (0x80, Value(3))


def test_what_is_retained_goes_on_by_name_and_type() -> None:
    text = """PROGRAM p VAR_EXTERNAL n, m : DINT; END_VAR VAR RETAIN {0} END_VAR
n := k; k := k + 1; m := l; l := 9; END_PROGRAM"""
    old, new = (
        compile_text(text.format(kinds), Findings())
        for kinds in ("k : DINT; l : DINT;", "l : INT := 4; other : DINT; k : DINT;")
    )
    with Desk(old) as desk:
        for n in range(3):
            desk.scan(n, 1, n, {})
        assert desk.reload(new) == 1
        scan = desk.scan(3, 1, 3, {})
    assert (scan.outputs["n"].value, scan.outputs["m"].value) == (3, 4)


def test_what_blocks_remember_goes_on_in_a_changed_program() -> None:
    """The library's: a timer runs on, an edge is not seen twice. What own blocks keep begins anew."""
    text = """FUNCTION_BLOCK own VAR_OUTPUT n : INT; END_VAR n := n + 1; END_FUNCTION_BLOCK
PROGRAM p VAR_EXTERNAL n, edges, own_n : INT; x : BOOL; END_VAR
VAR {}t : TON; e : R_TRIG; c : CTU; pair : ARRAY[1..2] OF CTU; o : own; END_VAR
t(IN := TRUE, PT := T#3s); e(CLK := TRUE); c(CU := e.Q, PV := 9); pair[2](CU := t.Q); o();
x := t.Q; edges := c.CV; own_n := o.n; n := pair[2].CV; END_PROGRAM"""
    with Desk(compile_text(text.format(""), Findings())) as desk:
        found = [desk.scan(n * SECOND, SECOND, 0, {}).outputs for n in range(2)]
        assert desk.reload(compile_text(text.format("first : TOF; "), Findings())) == 0
        found += [desk.scan(n * SECOND, SECOND, 0, {}).outputs for n in range(2, 5)]
    seen = [[one[name].value for one in found] for name in ("x", "edges", "own_n", "n")]
    assert seen == [[False, False, False, True, True], [1] * 5, [1, 2, 1, 2, 3], [0, 0, 0, 1, 1]]


def test_structures_are_retained_member_by_member() -> None:
    """A member goes on where its name, type and dimensions are the same, whatever stands beside it."""
    text = """TYPE mode : (OFF, RUN, {0}); unit : STRUCT {1} END_STRUCT END_TYPE
PROGRAM p VAR_EXTERNAL a, b, c, d : INT; END_VAR VAR RETAIN u : ARRAY[1..2] OF unit; m : mode; END_VAR
a := u[2].n; b := u[1].v[2]; c := mode_TO_INT(m); d := u[1].w[1, 1];
u[2].n := 5; u[1].v[2] := 6; u[1].w[1, 1] := 7; m := RUN; END_PROGRAM"""
    members = "n : INT; v : ARRAY[1..2] OF INT; w : ARRAY[1..2, 1..2] OF INT;"
    old = compile_text(text.format("TRIP", members), Findings())
    for values, now, carried, expected in (
        ("TRIP", members, 4, [5, 6, 1, 7]),
        ("TRIP", "x : REAL; w : ARRAY[1..2, 1..2] OF INT; v : ARRAY[1..2] OF INT; n : INT;", 4, [5, 6, 1, 7]),
        ("LOCKED", members.replace("1..2, 1..2", "1..4, 1..1"), 2, [5, 6, 0, 0]),
    ):
        with Desk(old) as desk:
            desk.scan(0, 1, 0, {})
            assert desk.reload(compile_text(text.format(values, now), Findings())) == carried
            scan = desk.scan(1, 1, 1, {})
        assert [scan.outputs[name].value for name in "abcd"] == expected


# ---- the second interpreter --------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seeds", "least", "some"), [(5, 2, 10), pytest.param(25, 15, 100, marks=pytest.mark.slow)]
)
def test_random_programs_do_what_a_second_interpreter_does(seeds: int, least: int, some: int) -> None:
    faults = doubtful = compared = 0
    for seed in range(seeds):
        chance = random.Random(seed)
        tree = Random(chance).block(12)
        findings = Findings()
        program = compile_text(text_of(tree), findings)
        if findings.failed:  # chance made a constant that its type does not have
            continue
        compared += 1
        reference = Reference()
        with Desk(program) as desk:
            for n in range(6):
                inputs = {
                    name: (given(kind, chance), chance.choice([0, 0, 0, 0x80, 0x20]))
                    for name, kind in INPUTS.items()
                }
                scan = desk.scan(n, 1, n, {name: Value(*value) for name, value in inputs.items()})
                expected = reference.scan(tree, inputs)
                found = {name: (value.value, value.quality) for name, value in scan.outputs.items()}
                assert found == expected, f"seed {seed}, scan {n}\n{text_of(tree)}"
                texts = [text for _, text in scan.messages]
                assert texts == reference.messages(), f"seed {seed}, scan {n}\n{text_of(tree)}"
                assert sum(scan.faults) == reference.faults, f"seed {seed}, scan {n}\n{text_of(tree)}"
                doubtful += sum(quality != 0 for _, quality in expected.values())
        faults += reference.faults
    assert compared > least and faults > some and doubtful > some, "the programs hardly do anything"


def given(kind: str, chance: random.Random) -> bool | int | float:
    if kind == "BOOL":
        return chance.random() < 0.5
    if kind in ("INT", "DINT"):
        return chance.choice([0, 1, -1, 3, 7, 300, -32768, 32767])
    value = chance.choice([0.0, 1.5, -2.25, 1e9, 1e-3, 65504.0, chance.uniform(-10, 10)])
    return struct.unpack("f", struct.pack("f", value))[0] if kind == "REAL" else value


@pytest.mark.slow
@pytest.mark.parametrize("example", ["pump.st", "pumps.st"])
def test_a_damaged_program_is_refused_or_harmless(example: str, tmp_path: Path) -> None:
    """With a right CRC, so that the verifier alone decides; whatever it accepts then runs and ends."""
    good = encode(compile_text((ROOT / "docs/examples/logic" / example).read_text(), Findings()))
    chance = random.Random(1)
    codes, file = [], tmp_path / "damaged"
    for _ in range(200):
        octets = bytearray(good)
        for _ in range(chance.randint(1, 3)):
            octets[chance.randrange(16, len(octets))] = chance.choice([0, 1, 255, chance.randrange(256)])
        octets[12:16] = struct.pack("<I", zlib.crc32(octets[16:]))
        file.write_bytes(octets)
        lines = "scan 0 0 0 20000 42b40000:0:0 1:0:0 1:0:0\nmessages\n" * 3 + "coverage\n"
        done = subprocess.run(
            [*desk_command(), file], input=lines, capture_output=True, text=True, check=False
        )
        codes.append(done.returncode)
    assert set(codes) == {0, 2}, "a signal"
    assert min(codes.count(0), codes.count(2)) > 20
    file.write_bytes(good[:-1] + b"x")
    done = subprocess.run([*desk_command(), file], capture_output=True, text=True, check=False)
    assert (done.returncode, "damaged" in done.stderr) == (2, True)


# ---- the command line --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("example", "expected"),
    [
        ("pump.st", "16 checks, 0 failed; lines 9 of 9, branches 4 of 4\n"),
        ("tank.st", "7 checks, 0 failed; lines 8 of 8, branches 0 of 0\n"),
        ("interlock.st", "16 checks, 0 failed; lines 6 of 6, branches 2 of 2\n"),
        ("pumps.st", "14 checks, 0 failed; lines 16 of 16, branches 18 of 18\n"),
        (
            "filling.st",
            "14 checks, 0 failed; lines 15 of 15, branches 17 of 20\nnot covered: line 27, 33, 37\n",
        ),
    ],
)
def test_the_examples_pass_their_tests(
    example: str, expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["logic", "test", str(ROOT / "docs/examples/logic" / example)]) == 0
    assert capsys.readouterr() == (expected, "")


def test_the_interlock_without_its_condition_fails(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("interlock.st", "interlock.test.csv"):
        text = (ROOT / "docs/examples/logic" / name).read_text()
        (tmp_path / name).write_text(text.replace("locked := earthed", "locked := FALSE"))
    assert main(["logic", "test", str(tmp_path / "interlock.st")]) == 1
    assert (
        "interlock.test.csv:3: the command of order at 1 s: expected INTERLOCK, found PENDING"
        in capsys.readouterr().out
    )


def test_a_failed_test_names_the_row(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "p.st").write_text(
        "PROGRAM p VAR_EXTERNAL x, y : INT; END_VAR\nIF x > 2 THEN\ny := 1;\nEND_IF;\nEND_PROGRAM"
    )
    (tmp_path / "p.test.csv").write_text("time,x,= y\n0,1,1\n")
    assert main(["logic", "test", str(tmp_path / "p.st")]) == 1
    out = capsys.readouterr().out
    assert "p.test.csv:2: y at 0 s: expected 1, found 0" in out
    assert "not covered: line 2, 3" in out


def test_exit_codes_and_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "p.st"
    file.write_text("PROGRAM p VAR i : INT; END_VAR i := x; END_PROGRAM")
    assert main(["logic", "check", "--json", str(file)]) == 1
    (finding,) = json.loads(capsys.readouterr().out)["findings"]
    assert finding == {"line": 1, "column": 37, "severity": "error", "text": "unknown name X"}
    assert main(["logic", "check", str(tmp_path / "none.st")]) == 2
    file.write_bytes(b"\xff\xfe")
    assert main(["logic", "check", str(file)]) == 2
    (tmp_path / "t.csv").write_text("time,z\n0,1\n")
    assert main(["logic", "run", str(ROOT / "docs/examples/logic/pump.st"), str(tmp_path / "t.csv")]) == 2
    assert "z is not a point of the program" in capsys.readouterr().err


def test_run_writes_a_table_and_a_picture(tmp_path: Path) -> None:
    (tmp_path / "in.csv").write_text("time,level,door_open\n0,85,0\n3,85!,0\n4,85,0\n")
    plot, out = tmp_path / "p.svg", tmp_path / "out.csv"
    words = ["run", str(ROOT / "docs/examples/logic/pump.st"), str(tmp_path / "in.csv"), "--period", "1000"]
    assert main(["logic", *words, "-o", str(out), "--plot", str(plot)]) == 0
    assert out.read_text().startswith("time,pump,starts\n0,0,0\n1,0,0\n2,1,1\n3,0,1\n")
    assert plot.read_text().startswith("<svg") and "#c00" in plot.read_text()
