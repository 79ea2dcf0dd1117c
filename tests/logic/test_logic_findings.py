# SPDX-License-Identifier: GPL-3.0-or-later
"""What `openrtu logic` says of Structured Text: mistakes, values beside lines, an editor's colours."""

import json
import random
import re
from pathlib import Path

import pytest
from logic_findings import MODE, UNIT, findings_of
from logic_reference import text_of

from openrtu_tools.cli import main
from openrtu_tools.logic.binary import OPERATIONS
from openrtu_tools.logic.compile import MESSAGE_OCTETS, MESSAGE_VALUES, compile_text
from openrtu_tools.logic.desk import Value
from openrtu_tools.logic.errors import Findings
from openrtu_tools.logic.parser import KEYWORDS
from openrtu_tools.logic.texts import OCTETS_MAX
from openrtu_tools.logic.types import TYPES
from openrtu_tools.logic.watch import Inside, Sight, named, page

ROOT = Path(__file__).resolve().parents[2]


def test_all_mistakes_come_at_once() -> None:
    text = """PROGRAM p
VAR_EXTERNAL level : REAL; pump : BOOL; END_VAR
VAR i : INT; t : TON; big : SINT := 200; END_VAR
pump := levle > 5.0;
i := level
t(IM := pump);
IF i THEN pump := TRUE; END_IF;
EXIT;
i := 40000;
END_PROGRAM
"""
    assert [found for found in findings_of(text) if "error" in found] == [
        "p:3:37: error: 200 overflows SINT, which is -128 to 127",
        "p:4:9: error: unknown name LEVLE; did you mean LEVEL?",
        "p:5:11: error: expected ';' after the assignment, found 't'",
        "p:7:4: error: expected BOOL, found INT",
        "p:8:1: error: EXIT is not in a loop",
        "p:9:6: error: 40000 overflows INT, which is -32768 to 32767",
    ]


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        ("b := x = 1.5;", "two REAL are rarely equal; compare ABS(a - b) with a tolerance"),
        ("IF FALSE THEN b := TRUE; END_IF;", "the condition is always FALSE: this branch is never reached"),
        ("b := TRUE; b := FALSE;", "b is written twice: here and in line 2"),
        ("RETURN; b := TRUE;", "this statement is never reached"),
        ("CASE i OF 1: b := TRUE; 1: b := FALSE; END_CASE;", "1 is already a case in line 2"),
    ],
)
def test_warnings(body: str, expected: str) -> None:
    declared = "VAR_EXTERNAL x : REAL; i : INT; b : BOOL; END_VAR"
    text = f"PROGRAM p {declared}\n{body} b := x > 1.0 AND i > 1;\nEND_PROGRAM"
    found = [finding for finding in findings_of(text) if expected in finding]
    assert found and ": warning: " in found[0]


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        ("x := i;", "expected BOOL, found INT"),
        ("i := 1.5;", "expected INT, found the REAL number 1.5"),
        ("i := d;", "expected INT, found DINT; DINT_TO_INT(…) converts it"),
        ("i := SQTR(2.0);", "unknown function SQTR; did you mean SQRT?"),
        ("IF x THEN i := 1; ", "expected 'END_IF' for the IF of line 2, found 'END_PROGRAM'"),
        ("i := (1 + 2;", "expected ')' for the '(' of column 6, found ';'"),
        ("i := T#5q;", "T#5q is not a duration; write T#1d2h3m4s5ms, or T#1.5s"),
        ("t(IN := x, PT := 5);", "expected TIME, found 5; write T#1.5s"),
        ("t.Q := TRUE;", "only the block itself writes T.Q"),
        ("x := NOT;", "expected a value, found ';'"),
        ("FOR i := 1 TO 5 BY 0 DO x := TRUE; END_FOR;", "a loop with a step of 0 never ends"),
        ("i := i # 2;", "unknown character '#'"),
        ("i := 1; (* no end", "2:9: error: a comment '(*' without its end '*)'"),
        ("i := SEL(x, 1, 40000);", "40000 overflows INT, which is -32768 to 32767"),
        ("i := n * n;", "90000 overflows INT"),
        ("d := late - 1;", "expected TIME, found 1; write T#1.5s"),
    ],
)
def test_errors(body: str, expected: str) -> None:
    declared = """VAR x : BOOL; i : INT; d : DINT; t : TON; END_VAR
VAR CONSTANT n : INT := 300; late : TIME := T#5s; END_VAR""".replace("\n", " ")
    text = f"PROGRAM p {declared}\n{body}\nEND_PROGRAM"
    assert any(finding.endswith(expected) for finding in findings_of(text)), findings_of(text)


def test_a_function_or_a_block_that_contains_itself_is_refused() -> None:
    text = """FUNCTION f : INT VAR_INPUT a : INT; END_VAR f := f(a); END_FUNCTION
PROGRAM p VAR i : INT; END_VAR i := f(1); END_PROGRAM"""
    assert any("F calls itself" in finding for finding in findings_of(text))
    text = "FUNCTION_BLOCK g VAR h : g; END_VAR END_FUNCTION_BLOCK PROGRAM p END_PROGRAM"
    assert any("G contains itself" in finding for finding in findings_of(text))


BLOCKS = "TYPE t : STRUCT a : TON; c : ARRAY[0..1] OF CTU; n : INT; END_STRUCT; END_TYPE "


@pytest.mark.parametrize(
    ("types", "declared", "body", "expected"),
    [
        (MODE, "x : mode;", "x := mode#RNU;", "2:6: error: MODE has no value RNU; did you mean RUN?"),
        (MODE, "x : mode;", "x := RUN;", "2:6: error: RUN is of several types; write MODE#RUN or OTHER#RUN"),
        (MODE, "x : mode;", "x := TRIPP;", "2:6: error: unknown name TRIPP; did you mean TRIP?"),
        (MODE, "x : mode;", "x := 5;", "expected MODE, found 5; write MODE#… with a name of its values"),
        (MODE, "x : mode;", "x := IDLE;", "expected MODE, found OTHER"),
        (MODE, "x : mode;", "x := mode_TO_INT(x);", "expected MODE, found INT"),
        (MODE, "x : INT;", "x := OFF;", "expected INT, found MODE"),
        (MODE, "x : INT; m : mode;", "x := m;", "expected INT, found MODE; MODE_TO_INT(…) converts it"),
        (MODE, "x : mode;", "IF x < TRIP THEN x := OFF; END_IF;", "2:6: error: < needs numbers, found MODE"),
        (MODE, "x : mode;", "x := x + TRIP;", "+ needs numbers, found MODE"),
        (
            MODE,
            "x : mode;",
            "CASE x OF 5: x := OFF; END_CASE;",
            "expected MODE, found 5; write MODE#… with a name of its values",
        ),
        (
            MODE,
            "x : mode;",
            "CASE x OF OFF..TRIP: x := OFF; END_CASE;",
            "MODE has no ranges; write its values with ',' between them",
        ),
        (MODE, "x : mode;", "x := mood#OFF;", "MOOD is not a type with values; did you mean MODE?"),
        (MODE, "x : mode := IDLE;", "", "expected MODE, found OTHER"),
        ("TYPE t : (A, B := 0); END_TYPE ", "x : t;", "", "1:14: error: B is 0, as A is"),
        ("TYPE t : (A, A); END_TYPE ", "x : t;", "", "A is declared twice"),
        (
            "TYPE t : (A, B) := C; END_TYPE ",
            "x : t;",
            "",
            "expected a constant: numbers, names of VAR CONSTANT",
        ),
        ("TYPE t : ; END_TYPE ", "x : t;", "", "1:10: error: expected a type, found ';'"),
        ("TYPE INT : (A); END_TYPE ", "x : INT;", "", "INT is defined already; give this type another name"),
        (
            "TYPE t : STRUCT a : s; END_STRUCT; s : STRUCT b : t; END_STRUCT; END_TYPE ",
            "",
            "",
            "T contains itself",
        ),
        (
            "TYPE t : ARRAY[1..2] OF TON; END_TYPE ",
            "",
            "",
            "an instance of TON must be a plain variable",
        ),
        (BLOCKS, "s : t := (a := 1);", "", "TON is a block, and has no initial value"),
        (BLOCKS, "s, r : t;", "s := r;", "s has a TON in it; copy its other members one by one"),
        (BLOCKS, "s : t;", "s.a := TRUE;", "S.A is a block; call it: S.A(…)"),
        (BLOCKS, "s : t;", "s.a.Q := TRUE;", "only the block itself writes S.A.Q"),
        (BLOCKS, "s : t;", "s.a(N := 1);", "S.A has no input N; did you mean IN?"),
        (BLOCKS, "s : t;", "s(N := 1);", "S is not a function block"),
        (BLOCKS, "s : t; b : BOOL;", "b := s.a;", "S.A is a block; name one of its outputs"),
        (BLOCKS, "s : t; b : BOOL;", "b := s.c.QU;", "S.C is an array of blocks; name one: S.C[…]"),
        (BLOCKS, "s : ARRAY[1..2] OF t; b : BOOL;", "b := s.a.Q;", "name one: S[…].A"),
        (BLOCKS, "s : ARRAY[1..2] OF t; b : BOOL;", "b := s[3].a.Q;", "the index 3 is outside of 1..2"),
        (
            f"{BLOCKS} FUNCTION_BLOCK f VAR_IN_OUT s : t; END_VAR END_FUNCTION_BLOCK ",
            "s : t; g : f;",
            "g(s := s);",
            "s has a TON in it: it must be a plain variable",
        ),
        (
            "TYPE t : STRUCT a : g; END_STRUCT END_TYPE "
            "FUNCTION_BLOCK g VAR s : t; END_VAR END_FUNCTION_BLOCK ",
            "s : t;",
            "",
            "G contains itself",
        ),
        ("TYPE t : STRUCT a, a : INT; END_STRUCT; END_TYPE ", "", "", "a is declared twice"),
        ("TYPE t : STRUCT END_STRUCT; END_TYPE ", "", "", "t has no member"),
        (
            "TYPE t : STRUCT a : INT END_STRUCT; END_TYPE ",
            "",
            "",
            "1:24: error: expected ';' after the declaration, found 'END_STRUCT'",
        ),
        (
            "TYPE t : STRUCT a : INT := 99999; END_STRUCT; END_TYPE ",
            "",
            "",
            "1:28: error: 99999 overflows INT, which is -32768 to 32767",
        ),
        (
            "TYPE t : ARRAY[1..200, 1..200] OF INT; END_TYPE ",
            "",
            "",
            "40000 values are too many; a variable has 30000 at most",
        ),
        (UNIT, "x : unit;", "x.m := 1;", "2:3: error: UNIT has no member M"),
        (UNIT, "x : unit;", "x := 1;", "expected a variable of UNIT"),
        (UNIT, "x : unit; i : INT;", "i := x;", "x is a structure; name a member"),
        (UNIT, "x : unit; i : INT;", "i := x.v;", "x.V is an array; name an element"),
        (UNIT, "x : unit; i : INT;", "x := i;", "expected UNIT, found INT"),
        (UNIT, "x : unit;", "x[1] := 1;", "2:2: error: x is not an array"),
        (UNIT, "x : unit;", "x.v.n := 1;", "x.V is an array; name an element before .N"),
        (UNIT, "x : unit;", "x.n.k := 1;", "x.N is no structure before .K"),
        (UNIT, "x : unit := (n := 1, k := 2);", "", "UNIT has no member K"),
        (UNIT, "x : unit := (n := 1, n := 2);", "", "N is given twice"),
        (UNIT, "x : unit := 5;", "", "expected the members of UNIT: (N := …)"),
        (UNIT, "x : unit := (v := 5);", "", "expected '[' and the values of ARRAY[1..3] OF REAL"),
        (UNIT, "x : unit := (n := [5]);", "", "expected a value of INT, not of many"),
        (UNIT, "x : ARRAY[1..2] OF unit := [3((n := 5))];", "", "3 initial values for 2 elements"),
        ("", "x : ARRAY[1..2, 0..1] OF INT;", "x[1, 2] := 0;", "2:6: error: the index 2 is outside of 0..1"),
        ("", "x : ARRAY[1..2, 0..1] OF INT;", "x[1, 1, 1] := 0;", "x has 2 dimensions, found 3 indices"),
        (
            "",
            "x : ARRAY[1..2, 0..1] OF INT; l : LINT;",
            "x[l, l] := 0;",
            "one of several indices cannot be a LINT; LINT_TO_DINT(…) converts it",
        ),
        ("", "x : ARRAY[1..2, 3..1] OF INT;", "", "an array from 3 to 1 has no element"),
        ("", "x : ARRAY[1..2] OF INT := [1, 2(3, 4)];", "", "5 initial values for 2 elements"),
        (
            "",
            "x : ARRAY[1..2] OF INT := [1, 2(3;",
            "",
            "expected ')' or ',' after the values that are repeated, found ';'",
        ),
        ("", "x : (A, B);", "", "expected the name of a type, found '('; declare it in TYPE … END_TYPE"),
        ("", "x : WSTRING;", "", "there is no WSTRING; STRING has ASCII characters"),
        ("", "x : STRING(256);", "", "a STRING has 1 to 255 characters, not 256"),
        ("", "x : STRING(0);", "", "a STRING has 1 to 255 characters, not 0"),
        ("", "x : STRING(4;", "", "expected ')' after the length of the STRING, found ';'"),
        ("", "x : STRING(4) := 'abcde';", "", "STRING(4) has 4 ASCII characters at most"),
        ("", "x : STRING(4) := 5;", "", "expected a text of STRING(4): '…'"),
        ("", "x : STRING;", "x := 'š';", "2:6: error: a STRING has ASCII characters only"),
        ("", "x : STRING;", f"x := '{'a' * 256}';", "a STRING has 255 characters at most"),
        ("", "x : STRING; y : INT;", "x := y;", "expected STRING, found INT; INT_TO_STRING(…) is its text"),
        ("", "x : STRING;", "x := 5;", "2:6: error: expected STRING, found a number"),
        ("", "x : STRING; y : INT;", "y := x;", "2:6: error: expected INT, found STRING"),
        ("", "x : STRING;", "x := x + 'a';", "2:8: error: + needs numbers, found STRING"),
        ("", "x : STRING;", "IF x THEN x := 'a'; END_IF;", "2:4: error: expected BOOL, found STRING"),
        ("", "x : STRING; y : BOOL;", "y := x = 5;", "2:8: error: expected STRING, found 5; write it as '…'"),
        ("", "x : STRING;", "x[1] := 'a';", "x is not an array"),
        ("", "x : STRING; y : REAL;", "x := LEFT(x, y);", "expected a number of characters, found REAL"),
        ("", "x : STRING;", "x := MUX(1, x, 'a');", "MUX has no STRING; an array of them has"),
        (
            "",
            "x : STRING; y : DT;",
            "x := DT_TO_STRING(y);",
            "DT_TO_STRING is not a conversion of the language",
        ),
        (
            "",
            "x : STRING; y : INT;",
            "y := STRING_TO_INT(x);",
            "STRING_TO_INT is not a conversion of the language",
        ),
        ("", "x : INT;", "x := 'a';", "2:6: error: expected INT, found STRING"),
        ("", "x : STRING;", "MESSAGE('a {}', 'b');", "2:17: error: a constant can stand in the text itself"),
        ("", "x : INT;", "MESSAGE('a {}');", "2:9: error: 1 {} in the text, 0 values; 8 at most"),
        ("", "x : INT;", "MESSAGE('a', x);", "2:9: error: 0 {} in the text, 1 values; 8 at most"),
        ("", "x : INT;", f"MESSAGE('{'{}' * 9}'{', x' * 9});", "9 {} in the text, 9 values; 8 at most"),
        ("", "x : INT;", "MESSAGE(x);", "expected MESSAGE('a text with {}', a value for each {})"),
        ("", "x : INT;", "MESSAGE('a {}', 5);", "2:17: error: a constant can stand in the text itself"),
        ("", "x : INT;", "MESSAGE('a {}', y);", "2:17: error: unknown name Y"),
        ("", "x : DT;", "MESSAGE('a {}', x);", "a message has no DATE_AND_TIME; the log has the time"),
        ("", "x : INT;", "MESSAGE('a$Nb');", "a text has printable characters, $' and $$; it is one line"),
        ("", "x : INT;", f"MESSAGE('{'ü' * 56}');", "112 octets are too many; a line of the log has 111"),
        ("", "x : INT;", "MESSAGE('a", '2:9: error: a text without its end "\'" in this line'),
        ("", "x : REEL;", "", "1:19: error: unknown type REEL; did you mean REAL?"),
    ],
)
def test_mistakes_with_types(types: str, declared: str, body: str, expected: str) -> None:
    text = f"{types}PROGRAM p VAR {declared} END_VAR\n{body}\nEND_PROGRAM"
    assert any(finding.endswith(expected) for finding in findings_of(text)), findings_of(text)


def test_a_misspelled_use_does_not_make_its_name_unused() -> None:
    text = "PROGRAM p VAR_EXTERNAL level : REAL; b : BOOL; END_VAR b := levle > 5.0; END_PROGRAM"
    assert findings_of(text) == ["p:1:61: error: unknown name LEVLE; did you mean LEVEL?"]
    assert any("level is not used" in finding for finding in findings_of(text.replace("levle", "1.0")))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (
            "FUNCTION f : INT VAR t : TON; END_VAR f := 1; END_FUNCTION",
            "TON keeps a state, but a",
        ),
        ("FUNCTION f : INT VAR RETAIN n : INT; END_VAR f := n; END_FUNCTION", "cannot retain a value"),
        (
            "FUNCTION_BLOCK f VAR_TEMP t : TON; END_VAR END_FUNCTION_BLOCK",
            "TON keeps a state, but a",
        ),
    ],
)
def test_what_remembers_nothing_holds_nothing_that_does(text: str, expected: str) -> None:
    assert any(expected in finding for finding in findings_of(f"{text} PROGRAM p END_PROGRAM"))


@pytest.mark.slow
@pytest.mark.parametrize("good", [(ROOT / "docs/examples/logic/pump.st").read_text(), text_of([])])
def test_any_text_gets_an_answer(good: str) -> None:
    """The compiler, with damaged text: findings, never an exception."""
    good = good.replace("values := 0;", "s.p := u[i_in, 0].p; (*")  # of the sums one line is enough
    words = [*re.findall(r"\w+#\S+|\w+|[^\w\s]+", good), "T#1d99999999999999h", "1E999", str(1 << 64)]
    chance = random.Random(3)
    for _ in range(100):
        at, length = chance.randrange(len(good)), chance.randrange(12)
        inserted = "".join(chance.choice(":=;()[].#'0aIF\n") for _ in range(chance.randrange(4)))
        if chance.random() < 0.5:
            inserted = f" {chance.choice(words)} {chance.choice(words)} "
        findings_of(good[:at] + inserted + good[at + length :])


def test_what_watch_shows_beside_a_line() -> None:
    text = (
        "PROGRAM p\nVAR_EXTERNAL level, Full : INT; END_VAR (* level\nlevel *)\n"
        "full := LEVEL + level; // other\nEND_PROGRAM\n"
    )
    program = compile_text(text, Findings())
    names = named(text, program)
    level, full = Sight("level"), Sight("Full")
    assert names == [[], [level, full], [], [full, level], []]
    points = {
        "tank/level": {"value": 5, "quality": "good", "forced": {"value": 5}},
        "Full": {"value": None, "quality": "invalid", "forced": None},
    }
    seen = page(text, names, points, {"level": "tank/level"}, Inside({}, {})).splitlines()
    assert [line.partition("|")[2] for line in seen] == [
        "",
        " level=5 (forced)  Full=? (invalid)",
        "",
        " Full=? (invalid)  level=5 (forced)",
        "",
    ]


MOTOR = """FUNCTION_BLOCK motor
VAR_INPUT on : BOOL; END_VAR
VAR_OUTPUT runs : BOOL; END_VAR
VAR wait : TON; tries : ARRAY[1..3] OF INT; i : INT := 2; END_VAR
wait(IN := on, PT := T#1s);
tries[i] := tries[i] + 1; runs := wait.Q;
END_FUNCTION_BLOCK
FUNCTION unused : INT VAR_INPUT runs : INT; END_VAR unused := runs; END_FUNCTION
PROGRAM p
VAR_EXTERNAL go, out : BOOL; END_VAR
VAR left, right : motor; mask : BYTE; on : BOOL; END_VAR
left(on := go);
right(on := NOT on, (* on *) runs => out);
mask := BYTE#16#1F;
END_PROGRAM
"""


def test_watch_shows_variables_of_blocks_and_of_the_instance_that_was_asked_for() -> None:
    findings = Findings()
    program = compile_text(MOTOR, findings)
    assert not findings.failed
    values = {path: Value(0) for path in program.debug.variables}
    values |= {
        "LEFT.RUNS": Value(True),
        "RIGHT.TRIES[2]": Value(7, 0x81),
        "RIGHT.I": Value(2),
        "RIGHT.WAIT.ET": Value(1_250_000),
        "MASK": Value(31),
    }
    kinds = {path: slot.type for path, slot in program.debug.variables.items()}
    sights = named(MOTOR, program, "right")
    seen = page(MOTOR, sights, {}, {}, Inside(values, kinds)).splitlines()
    beside = [line.partition("|")[2].strip() for line in seen]
    assert beside[4] == "wait.Q=FALSE  wait.ET=T#1.25s  on=FALSE"
    assert beside[5] == "tries[i][2]=7 (invalid, overflow)  runs=FALSE  wait.Q=FALSE"
    assert beside[11] == "left.RUNS=TRUE  go=? (no such point)"
    assert beside[12] == "right.RUNS=FALSE  on=FALSE  out=? (no such point)"
    assert beside[13] == "mask=16#1F"
    first = page(MOTOR, named(MOTOR, program), {}, {}, Inside(values, kinds, "it is another one"))
    assert first.startswith("Only points are shown: it is another one\n")
    assert "runs=TRUE" in first


def test_watch_shows_members_elements_and_names_of_values() -> None:
    text = """TYPE mode : (LOCAL, REMOTE := 5); END_TYPE
TYPE bay : STRUCT at : mode; limits : ARRAY[0..1] OF INT; END_STRUCT; END_TYPE
PROGRAM p
VAR_EXTERNAL go : BOOL; END_VAR
VAR bays : ARRAY[1..2, 3..4] OF bay; i : INT := 2; END_VAR
bays[i, 3].at := mode#REMOTE; bays[1, 4].limits[1] := 7; go := bays[i, 4].at = mode#LOCAL;
END_PROGRAM
"""
    program = compile_text(text, Findings())
    values = {path: Value(0) for path in program.debug.variables}
    assert len(set(map(id, program.debug.variables.values()))) == len(values) == 4 * 3 + 2
    values |= {"I": Value(2), "BAYS[2,3].AT": Value(5), "BAYS[1,4].LIMITS[1]": Value(7)}
    kinds = {path: slot.type for path, slot in program.debug.variables.items()}
    inside = Inside(values, kinds, enumerations=program.debug.enumerations)
    beside = page(text, named(text, program), {}, {}, inside).splitlines()[5].partition("|")[2]
    assert "[2,3].AT=MODE#REMOTE" in beside
    assert "bays[1, 4].limits[1]=7" in beside
    assert "[2,4].AT=MODE#LOCAL" in beside


def test_watch_says_how_to_reach_the_gateway(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "p.st"
    file.write_text("PROGRAM p\nVAR_EXTERNAL a : INT; END_VAR\na := 1;\nEND_PROGRAM\n")
    assert main(["logic", "watch", str(file), "--rtuctl", "/no/rtuctl"]) == 2
    assert "--rtuctl 'ssh gateway rtuctl'" in capsys.readouterr().err
    assert main(["logic", "watch", str(file), "--rtuctl", "echo no"]) == 2
    assert "is it rtuctl" in capsys.readouterr().err
    assert main(["logic", "watch", str(file), "--rtuctl", "false"]) == 2
    assert "false ended with 1" in capsys.readouterr().err


def test_operations_are_those_of_the_machine() -> None:
    text = (ROOT / "package/openrtu/src/logic/format.h").read_text()
    assert re.findall(r"^\tOP\((\w+),", text, re.MULTILINE) == OPERATIONS
    assert f"#define LOGIC_MESSAGE_VALUES {MESSAGE_VALUES}\n" in text
    assert f"#define LOGIC_STRING_MAX {OCTETS_MAX}\n" in text
    text = (ROOT / "package/openrtu/src/map/map.h").read_text()
    assert f"#define MAP_LOG_TEXT_SIZE {MESSAGE_OCTETS + 1}\n" in text


def coloured(line: str, patterns: list[dict[str, str]]) -> dict[str, str]:
    """What an editor makes of a line: of the patterns the one that begins first, then the first one."""
    found, at = {}, 0
    while hits := [(hit, one) for one in patterns if (hit := re.search(one["match"], line[at:]))]:
        hit, pattern = min(hits, key=lambda pair: pair[0].start())
        found[hit[0]] = pattern["name"].removesuffix(".structured-text")
        at += hit.end()
    return found


def test_an_editor_colours_what_the_compiler_knows(tmp_path: Path) -> None:
    assert main(["logic", "editor", str(tmp_path / "st")]) == 0
    package = json.loads((tmp_path / "st/package.json").read_text())
    path = package["contributes"]["grammars"][0]["path"]
    patterns = json.loads((tmp_path / "st" / path).read_text())["patterns"]
    patterns = [{**one, "match": one.get("match") or one["begin"]} for one in patterns]
    for word in KEYWORDS | {*TYPES}:
        (scope,) = coloured(word.lower(), patterns).values()
        assert scope.startswith(("keyword", "storage", "constant.language")), word
    line = (
        "IF t.q AND forty <> 4 THEN x := mode#RUN; w := 16#FF; r := LOG(INT_TO_REAL(log)); u : TON; END_IF;"
    )
    assert coloured(line, patterns) == {
        **dict.fromkeys(["IF", "THEN", "END_IF"], "keyword.control"),
        **dict.fromkeys(["4", "16#FF"], "constant.numeric"),
        **dict.fromkeys(["<>", ":="], "keyword.operator"),
        **dict.fromkeys(["LOG", "INT_TO_REAL"], "support.function"),
        "AND": "keyword.operator.word",
        "mode#RUN": "constant.other.enumeration",
        "TON": "support.class",
    }
    for text, scope in (
        ("// IF", "comment.line"),
        ("(* IF", "comment.block"),
        ("'IF", "string.quoted.single"),
    ):
        assert next(iter(coloured(text, patterns).values())) == scope
