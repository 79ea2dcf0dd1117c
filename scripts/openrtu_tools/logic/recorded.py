# SPDX-License-Identifier: GPL-3.0-or-later
"""Inputs that were recorded: a gateway's journal of events, or a value change dump (VCD, IEEE 1364, 18)."""

from __future__ import annotations

import json
import math
import subprocess
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from openrtu_tools.logic.binary import Point, Program
from openrtu_tools.logic.desk import INVALID, Value
from openrtu_tools.logic.errors import LogicError
from openrtu_tools.logic.table import START_US, US, Row
from openrtu_tools.logic.types import RANGES, REAL_MAX, REALS
from openrtu_tools.programs import command

MAGIC = b"ORJ1"  # of a journal: journal/record.c
NS_PER_US = 1000
NORMALIZED_ONE = 32768.0  # IEC 60870-5-101, 7.2.6.6
OFF, ON = 1.0, 2.0  # of a double point
SIGNS = "01xXzZbBrR"  # of a change
UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "ps": 1e-12, "fs": 1e-15}


@dataclass(frozen=True)
class Recording:
    rows: list[Row]
    start_us: int = START_US  # what the clock says at time 0


def fitted(number: float, point: Point, quality: int) -> Value:
    """What the program's type does not have is invalid, as in the machine."""
    if point.type in REALS:
        fits = math.isfinite(number) and (point.type == "LREAL" or abs(number) <= REAL_MAX)
        return Value(number if fits else 0.0, quality if fits else quality | INVALID)
    low, high = RANGES[point.type]
    fits = number.is_integer() and low <= number <= high
    value = int(number) if fits else 0
    return Value(bool(value) if point.type == "BOOL" else value, quality if fits else quality | INVALID)


def rows_of(changes: Iterable[tuple[int, str, Value]]) -> list[Row]:
    """A row for each moment; changes are in order."""
    rows: list[Row] = []
    for line, (time_us, name, value) in enumerate(changes, 1):
        if not rows or rows[-1].time_us != time_us:
            rows.append(Row(line, time_us))
        rows[-1].inputs[name] = value
    return rows


# ---- the journal ---------------------------------------------------------------------------------


def read_journal(path: Path, program: Program, points: Path | None, aliases: dict[str, str]) -> Recording:
    """Time 0 is the first event; the clock says what it said then."""
    inputs = addressed(points, program, aliases)
    done = subprocess.run(
        [*command("journal-events", "journal"), str(path)], capture_output=True, text=True, check=False
    )
    if done.returncode != 0:
        raise LogicError(done.stderr.strip() or f"{path} is no journal: expected rtu-journal's file `events`")
    events = sorted(
        (int(when) // NS_PER_US, (int(ca), int(ioa), kind), float(number), int(quality, 16))
        for when, ca, ioa, kind, number, quality in (line.split() for line in done.stdout.splitlines())
    )
    heard = [event for event in events if event[1] in inputs]
    if not heard:
        raise LogicError(f"{path}: none of its {len(events)} events is of a point that the program reads")
    start_us = heard[0][0]
    return Recording(
        rows_of(
            (time_us - start_us, inputs[place].name, taken(number, place[2], inputs[place], quality))
            for time_us, place, number, quality in heard
        ),
        start_us,
    )


def addressed(points: Path | None, program: Program, aliases: dict[str, str]) -> dict[tuple, Point]:
    """A journal knows a point by CA, IOA and type; the list of points has its name."""
    if points is None:
        raise LogicError("a journal has no names: --points FILE, made by `rtuctl --json points`, has them")
    try:
        rows = {row["name"]: (row["ca"], row["ioa"], row["type"]) for row in json.loads(points.read_text())}
    except (ValueError, KeyError, TypeError):
        raise LogicError(f"{points} has no points: expected what `rtuctl --json points` prints") from None
    inputs = [point for point in program.points if not point.written]
    missing = [point.name for point in inputs if aliases.get(point.name, point.name) not in rows]
    if missing:
        raise LogicError(f"{points} lacks {', '.join(missing)}: --name NAME=POINT says what it is there")
    return {rows[aliases.get(point.name, point.name)]: point for point in inputs}


def taken(number: float, kind: str, point: Point, quality: int) -> Value:
    """As logic/value.c does it."""
    if kind == "double" and point.type == "BOOL":
        return Value(number == ON, quality if number in (OFF, ON) else quality | INVALID)
    if kind == "normalized" and point.type in REALS:
        number /= NORMALIZED_ONE
    return fitted(number, point, quality)


# ---- value change dumps --------------------------------------------------------------------------


def read_vcd(path: Path, program: Program) -> Recording:
    """Variables have the names of points, in any scope; x and z are invalid."""
    points = {point.name.upper(): point for point in program.points if not point.written}
    names: dict[str, list[tuple[Point, int]]] = {}
    unit_s, time_us, changes = 1e-9, 0, []
    words = iter(path.read_text(encoding="utf-8", errors="replace").split())
    try:
        for word in words:
            if word in ("$dumpvars", "$dumpall", "$dumpon", "$dumpoff", "$end"):
                continue
            if word.startswith("$"):
                inside = section(words)
                if word == "$timescale":
                    unit_s = timescale("".join(inside))
                if word == "$var" and inside[3].upper() in points:
                    names.setdefault(inside[2], []).append((points[inside[3].upper()], int(inside[1])))
            elif word.startswith("#"):
                time_us = round(int(word[1:]) * unit_s * US)
                if changes and time_us < changes[-1][0]:
                    raise LogicError(f"{path}: the time goes backwards at {word}")
            elif word[0] not in SIGNS:
                raise ValueError
            else:
                sign, rest = word[0], word[1:]
                code = next(words) if sign in "bBrR" else rest
                changes += [(time_us, p.name, change(sign, rest, p, bits)) for p, bits in names.get(code, [])]
    except (StopIteration, ValueError, IndexError, KeyError):
        raise LogicError(f"{path} is no value change dump, or it is cut off") from None
    if not changes:
        raise LogicError(f"{path}: no variable of it has the name of a point that the program reads")
    return Recording(rows_of(changes))


def section(words: Iterator[str]) -> list[str]:
    """Up to $end, which may not be missing."""
    inside = []
    while (word := next(words)) != "$end":
        inside.append(word)
    return inside


def timescale(text: str) -> float:
    number = text.rstrip("munpfs")
    return int(number) * UNITS[text[len(number) :]]


def change(sign: str, rest: str, point: Point, bits: int) -> Value:
    if sign in "rR":
        return fitted(float(rest), point, 0)
    digits = rest if sign in "bB" else sign
    if set(digits) & set("xXzZ"):
        return fitted(0.0, point, INVALID)
    number = int(digits, 2)
    if point.type in RANGES and RANGES[point.type][0] < 0 and number >> (bits - 1) == 1:
        number -= 1 << bits
    return fitted(float(number), point, 0)


def vcd(names: list[tuple[str, str]], steps: Iterable[tuple[int, dict[str, Value]]]) -> Iterator[str]:
    """The lines of a dump: names with their types, then what changed at each time. What is not good is x."""
    codes = {name: f"v{number:x}" for number, (name, _) in enumerate(names)}
    yield "$timescale 1 us $end\n$scope module program $end"
    for name, kind in names:
        size = "real 64" if kind in REALS else f"wire {1 if kind == 'BOOL' else 64}"
        yield f"$var {size} {codes[name]} {name} $end"
    yield "$upscope $end\n$enddefinitions $end"
    before: dict[str, str] = {}
    for time_us, values in steps:
        now = {name: dumped(kind, values[name], codes[name]) for name, kind in names}
        changed = [text for name, text in now.items() if before.get(name) != text]
        if changed:
            yield "\n".join([f"#{time_us}", *changed])
        before = now


def dumped(kind: str, value: Value, code: str) -> str:
    if value.quality & INVALID:
        return f"x{code}" if kind == "BOOL" else f"rnan {code}" if kind in REALS else f"bx {code}"
    if kind in REALS:
        return f"r{value.value!r} {code}"
    return f"{int(value.value)}{code}" if kind == "BOOL" else f"b{int(value.value) & (1 << 64) - 1:b} {code}"
