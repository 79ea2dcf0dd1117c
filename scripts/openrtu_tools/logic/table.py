# SPDX-License-Identifier: GPL-3.0-or-later
"""
Inputs over time, as a table (CSV): a column `time` in seconds, one for each point that the program reads.

An empty cell keeps the value, `!` behind a value makes it invalid. In a test, a column `= NAME` has what a
point shall be then; a column `answer NAME` says how the device answers commands of a point from then on. In a
column `master NAME` a controlling station commands that value; `= master NAME` has how that ended.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from openrtu_tools.logic.binary import Program
from openrtu_tools.logic.desk import INVALID, NOT_GOOD, Desk, Scan, Value
from openrtu_tools.logic.errors import LogicError
from openrtu_tools.logic.types import RANGES, REALS

US = 1_000_000
# How a device answers a command: state and result, as map_command_state and map_command_result have them.
ANSWERS = {
    "DONE": (9, 1),
    "EXCEPTION": (8, 2),
    "TIMEOUT": (8, 3),
    "TOO_OLD": (8, 4),
    "INTERLOCK": (8, 6),
    "OUT_OF_RANGE": (8, 7),
}
RESULTS = {result: word for word, (_, result) in ANSWERS.items()}
PENDING = "PENDING"  # a command that the program has not decided about yet
START_US = 1_767_225_600 * US  # 2026-01-01: virtual time


@dataclass
class Row:
    line: int
    time_us: int
    inputs: dict[str, Value] = field(default_factory=dict)
    expected: dict[str, Value] = field(default_factory=dict)
    answers: dict[str, tuple[int, int]] = field(default_factory=dict)
    requests: dict[str, float] = field(default_factory=dict)
    endings: dict[str, str] = field(default_factory=dict)  # expected: a word of ANSWERS, or PENDING


@dataclass(frozen=True)
class Step:
    time_us: int
    inputs: dict[str, Value]
    scan: Scan
    row: Row | None  # that begins here
    endings: dict[str, str]  # of each request that there was: how the last one ended


def cell(text: str, kind: str, where: str) -> Value:
    quality = INVALID if text.endswith("!") else 0
    text = text.removesuffix("!").strip()
    try:
        if kind == "BOOL":
            return Value({"0": False, "1": True, "FALSE": False, "TRUE": True}[text.upper()], quality)
        if kind in REALS:
            return Value(float(text), quality)
        low, high = RANGES[kind]
        if not low <= int(text) <= high:
            raise ValueError
        return Value(int(text), quality)
    except (KeyError, ValueError):
        raise LogicError(f"{where}: {text!r} is no {kind}") from None


def answer(text: str, where: str) -> tuple[int, int]:
    if text.upper() not in ANSWERS:
        raise LogicError(
            f"{where}: {text!r} is not an answer of a device, expected one of {', '.join(ANSWERS)}"
        )
    return ANSWERS[text.upper()]


def ending(text: str, where: str) -> str:
    if text.upper() not in (PENDING, *ANSWERS):
        raise LogicError(
            f"{where}: {text!r} is no end of a command; it may be {PENDING}, {', '.join(ANSWERS)}"
        )
    return text.upper()


def parted(head: str) -> tuple[str, str]:
    """What a column is (an input: "", "=", "answer", "master", "= master"), and its point."""
    found = re.match(r"(=\s*master\s|=|answer\s|master\s)?\s*(.*)", head.strip())
    return " ".join((found[1] or "").replace("=", "= ").split()), found[2]


def read_columns(path: Path, heads: list[str], program: Program) -> list[tuple[str, str]]:
    points = {point.name: point for point in program.points}
    commanded = {command.name for command in program.commands}
    requested = {request.name for request in program.requests}
    columns = [parted(head) for head in heads]
    for what, name in columns:
        if name not in points:
            raise LogicError(f"{path}:1: {name} is not a point of the program, which has {', '.join(points)}")
        if what == "" and points[name].written:
            raise LogicError(f"{path}:1: the program itself writes {name}; `= {name}` states what it must be")
        if what == "answer" and name not in commanded:
            raise LogicError(f"{path}:1: no command of the program goes to {name}")
        if what.endswith("master") and name not in requested:
            raise LogicError(f"{path}:1: the program has no REQUEST for {name}")
    return columns


def read_table(path: Path, program: Program) -> list[Row]:
    with path.open(newline="", encoding="utf-8") as file:
        lines = [row for row in csv.reader(file) if row]
    if not lines or lines[0][0].strip() != "time":
        raise LogicError(f"{path}:1: expected a first column `time`, in seconds")
    columns = read_columns(path, lines[0][1:], program)
    kinds = {point.name: point.type for point in program.points}
    rows: list[Row] = []
    for number, line in enumerate(lines[1:], 2):
        where = f"{path}:{number}"
        if len(line) > 1 + len(columns):
            raise LogicError(f"{where}: {len(line)} cells for {1 + len(columns)} columns")
        try:
            row = Row(number, round(float(line[0]) * US))
        except ValueError:
            raise LogicError(f"{where}: {line[0]!r} is not a time in seconds") from None
        if row.time_us < (rows[-1].time_us if rows else 0):
            raise LogicError(f"{where}: the time goes backwards")
        for (what, name), text in zip(columns, line[1:], strict=False):
            if not text.strip():
                continue
            if what == "answer":
                row.answers[name] = answer(text.strip(), where)
            elif what == "master":
                row.requests[name] = float(cell(text.strip(), kinds[name], where).value)
            elif what == "= master":
                row.endings[name] = ending(text.strip(), where)
            else:
                target = row.expected if what == "=" else row.inputs
                target[name] = cell(text.strip(), kinds[name], where)
        rows.append(row)
    if not rows:
        raise LogicError(f"{path}: the table has no rows")
    return rows


def steps(desk: Desk, rows: list[Row], period_us: int, start_us: int = START_US) -> Iterator[Step]:
    """A scan each period, from 0 to the last row; a row counts from the first scan that is not before it."""
    values: dict[str, Value] = {}
    answers = [(0, 0)] * len(desk.program.commands)
    before = [False] * len(answers)
    devices: dict[str, tuple[int, int]] = {}
    requests: dict[str, float] = {}
    endings: dict[str, str] = {}
    pending = list(rows)
    for time_us in range(0, rows[-1].time_us + period_us, period_us):
        begun = None
        while pending and pending[0].time_us <= time_us:
            begun = pending.pop(0)
            values |= {
                name: Value(value.value, value.quality, start_us + time_us)
                for name, value in begun.inputs.items()
            }
            devices |= begun.answers
            requests |= begun.requests
            endings |= dict.fromkeys(begun.requests, PENDING)
            if pending and pending[0].time_us <= time_us and begun.expected:
                raise LogicError(
                    f"line {begun.line} of the table: two rows within one period of {period_us / US:g} s"
                )
        active = [requests.get(request.name) for request in desk.program.requests]
        scan = desk.scan(time_us, period_us if time_us else 0, start_us + time_us, values, answers, active)
        for request, (decision, result) in zip(desk.program.requests, scan.verdicts, strict=True):
            if request.name in requests and decision in ("executed", "refused"):
                del requests[request.name]
                endings[request.name] = RESULTS.get(result, str(result))
        yield Step(time_us, dict(values), scan, begun, dict(endings))
        for number, (execute, _, _) in enumerate(scan.commands):
            rises = bool(execute.value) and not before[number]
            before[number] = bool(execute.value)
            # A command whose value or reason is not valid is not sent.
            if rises and execute.quality & NOT_GOOD:
                answers[number] = ANSWERS["OUT_OF_RANGE"]
            elif not execute.value:
                answers[number] = (0, 0)
            elif rises:
                answers[number] = devices.get(desk.program.commands[number].name, ANSWERS["DONE"])


def compared(step: Step) -> Iterator[tuple[str, str, str]]:
    """What a row checks: the point, what it expects, what there is. What does not differ is shown alike."""
    if step.row is None:
        return
    for name, expected in step.row.expected.items():
        found = step.scan.outputs[name] if name in step.scan.outputs else step.inputs[name]
        yield name, expected.shown(), (found if differs(expected, found) else expected).shown()
    for name, ending in step.row.endings.items():
        yield f"the command of {name}", ending, step.endings.get(name, "none")


def differs(expected: Value, found: Value) -> bool:
    """A number may differ in the sixth digit; an invalid value has only its flag compared."""
    if bool(expected.quality & NOT_GOOD) != bool(found.quality & NOT_GOOD):
        return True
    if expected.quality & NOT_GOOD:
        return False
    if isinstance(expected.value, float):
        return abs(expected.value - found.value) > 1e-6 * max(1.0, abs(expected.value))
    return expected.value != found.value
