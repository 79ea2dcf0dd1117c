# SPDX-License-Identifier: GPL-3.0-or-later
"""A running program's text, with the values of its points and variables beside the lines that name them."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from openrtu_tools.codes import QUALITIES
from openrtu_tools.logic.binary import Program, String, encode
from openrtu_tools.logic.desk import Value
from openrtu_tools.logic.errors import LogicError
from openrtu_tools.logic.types import literal, unpack

PERIOD_S = 1.0
PATIENCE_S = 10.0
WIDTH_MAX = 90  # of the text; what is longer pushes its values to the right
HOME, CLEAR_LINE, CLEAR_BELOW = "\033[H", "\033[K", "\033[J"
SILENT = re.compile(r"\(\*.*?\*\)|//[^\n]*|'[^'\n]*'", re.DOTALL)  # comments and strings name no variable
# A variable with its elements and members, a literal with a type, or a parenthesis.
WORD = re.compile(r"\w+#[\w.#:-]+|(?<![\w.])[A-Za-z_]\w*(?:\.[A-Za-z_]\w*|\[[^\[\]]*\])*|[()]")
INDEX = re.compile(r"\[([^\[\]]*)\]")
FORMAL = re.compile(r"\s*(:=|=>)")


@dataclass(frozen=True)
class Sight:
    """What a line names: a point, or a variable of the program with its path in the debug table."""

    name: str
    path: str | None = None  # None: a point
    prefix: str = ""  # of the paths of its unit, where an index is looked up


@dataclass(frozen=True)
class Inside:
    """The variables of a running program between two scans; or why they are not known."""

    values: dict[str, Value]
    kinds: dict[str, str]
    reason: str = ""
    enumerations: dict[str, dict[int, str]] = field(default_factory=dict)

    def text(self, path: str) -> str:
        """A value as the text of a program has it: `T#1.5s`, `MODE#REMOTE`."""
        kind, value = self.kinds[path], self.values[path].value
        names = self.enumerations.get(kind, {})
        return f"{kind}#{names[int(value)]}" if value in names else literal(kind, value)


def named(text: str, program: Program, instance: str = "") -> list[list[Sight]]:
    """Of each line, what it names, in its order. Instance: of a block, in the text of the block."""
    heard = SILENT.sub(lambda found: re.sub(r"[^\n]", " ", found.group()), text)
    points = {point.name.upper(): point.name for point in program.points}
    lines, depth = [], 0
    for number, line in enumerate(heard.splitlines(), 1):
        prefix = prefix_at(program, number, instance)
        sights: list[Sight] = []
        for found in WORD.finditer(line):
            word = found.group()
            depth += {"(": 1, ")": -1}.get(word, 0)
            formal = FORMAL.match(line, found.end())
            if (depth > 0 and formal is not None) or prefix is None:
                continue  # the name of a block's input: it is not the caller's
            sights += sights_of(word, prefix, points, program)
        lines.append(list(dict.fromkeys(sights)))
    return lines


def prefix_at(program: Program, line: int, instance: str) -> str | None:
    """Of the paths of what a line names; None: nobody uses the unit that it is of."""
    places = next((places for first, places in reversed(program.debug.units) if first <= line), [])
    wanted = f"{instance.upper()}."
    return wanted if wanted in places else next(iter(places), None)


def sights_of(word: str, prefix: str, points: dict[str, str], program: Program) -> list[Sight]:
    """A block is shown by its outputs."""
    path = prefix + re.sub(r"\s", "", word.upper())
    if prefix == "" and path in points:
        return [Sight(points[path])]
    if path in program.debug.outputs:
        outputs = program.debug.outputs[path]
        return [Sight(f"{word}.{output}", f"{path}.{output}", prefix) for output in outputs]
    array, bracket, _ = path.partition("[")
    known = path in program.debug.variables or (
        bracket and any(one.startswith(array + bracket) for one in program.debug.variables)
    )
    return [Sight(word, path, prefix)] if known else []


def ask(command: Sequence[str], *words: str) -> list[dict[str, Any]]:
    """What rtuctl says in rows."""
    try:
        done = subprocess.run(
            [*command, "--json", *words], capture_output=True, text=True, check=False, timeout=PATIENCE_S
        )
        rows = json.loads(done.stdout) if done.returncode == 0 else None
    except OSError as error:
        raise LogicError(
            f"{command[0]}: {error.strerror}; say how to reach the gateway: --rtuctl 'ssh gateway rtuctl'"
        ) from None
    except subprocess.TimeoutExpired:
        raise LogicError(f"{command[0]} has not answered for {PATIENCE_S:g} s") from None
    except json.JSONDecodeError:
        raise LogicError(f"{command[0]} prints no points: is it rtuctl, or a way to it?") from None
    if rows is None:
        raise LogicError(done.stderr.strip() or f"{command[0]} ended with {done.returncode}")
    return rows


def look_inside(command: Sequence[str], program: Program, running: str) -> Inside:
    """The variables, if the gateway runs this very text."""
    octets = encode(program)
    kinds = {path: slot.type for path, slot in program.debug.variables.items()}
    try:
        (row,) = ask(command, "logic", running)
    except LogicError as error:
        return Inside({}, kinds, f"{error}; --program NAME says which one it is")
    if int(row["file"], 16) != int.from_bytes(octets[12:16], "little"):
        return Inside({}, kinds, f"{running} runs another text than this one: compile it, and rtuctl reload")
    values = {}
    for path, slot in program.debug.variables.items():
        slots = slot.slots if isinstance(slot, String) else [slot]
        cells = [tuple(int(part, 16) for part in row["cells"][one.number].split(":")) for one in slots]
        bits, quality = cells[0]
        values[path] = Value(text_in(cells) if isinstance(slot, String) else unpack(slot.type, bits), quality)
    return Inside(values, kinds, enumerations=program.debug.enumerations)


def text_in(cells: Sequence[tuple[int, ...]]) -> str:
    """Of a STRING: how many octets, and they."""
    octets = b"".join(bits.to_bytes(8, "little") for bits, _ in cells[1:])
    return octets[: cells[0][0]].decode("ascii", "replace")


def shown(name: str, point: dict[str, Any] | None) -> str:
    """A point: `level=50`, `level=50 (invalid)`."""
    if point is None:
        return f"{name}=? (no such point)"
    value = "?" if point["value"] is None else point["value"]
    notes = [point["quality"]] if point["quality"] != "good" else []
    notes += ["forced"] if point["forced"] else []
    return f"{name}={value}" + (f" ({', '.join(notes)})" if notes else "")


def shown_inside(sight: Sight, inside: Inside) -> str | None:
    """A variable: `timer.ET=T#1.5s`. An index may be a variable; None: it is more than that."""
    path = INDEX.sub(lambda found: f"[{index_of(found[1], sight.prefix, inside)}]", sight.path)
    value = inside.values.get(path)
    if value is None:
        return None
    name = sight.name if path == sight.path else f"{sight.name}{path[path.index('[') :]}"
    notes = [word for word, bit in QUALITIES.items() if value.quality & bit]
    return f"{name}={inside.text(path)}" + (f" ({', '.join(notes)})" if notes else "")


def index_of(text: str, prefix: str, inside: Inside) -> str:
    """Numbers and variables between brackets, as numbers; `?` for what is neither."""
    numbers = []
    for part in (one.strip() for one in text.split(",")):
        found = inside.values.get(prefix + part)
        numbers.append(part if re.fullmatch(r"-?\d+", part) else str(found.value) if found else "?")
    return ",".join(numbers)


def page(
    text: str,
    sights: list[list[Sight]],
    points: dict[str, dict[str, Any]],
    aliases: dict[str, str],
    inside: Inside,
) -> str:
    """The text with what is true now."""
    lines = text.expandtabs(4).splitlines()
    width = min(max(map(len, lines), default=0), WIDTH_MAX)
    printed = [f"Only points are shown: {inside.reason}"] if inside.reason else []
    for number, (line, seen) in enumerate(zip(lines, sights, strict=True), 1):
        values = [
            shown(sight.name, points.get(aliases.get(sight.name, sight.name)))
            if sight.path is None
            else shown_inside(sight, inside)
            for sight in seen
        ]
        beside = "  ".join(value for value in values if value is not None)
        printed.append(f"{number:4} {line:{width}}  | {beside}" if beside else f"{number:4} {line}")
    return "\n".join(printed)


@dataclass(frozen=True)
class View:
    """What is watched, and how it is reached."""

    text: str
    program: Program
    command: Sequence[str]
    running: str  # the program's name in the gateway's configuration
    aliases: dict[str, str]
    instance: str = ""

    def drawn(self, sights: list[list[Sight]]) -> str:
        points = {row["name"]: row for row in ask(self.command, "points")}
        inside = look_inside(self.command, self.program, self.running)
        return page(self.text, sights, points, self.aliases, inside)


def watch(view: View, once: bool) -> None:
    """Prints the page once, or again and again until Ctrl-C."""
    sights = named(view.text, view.program, view.instance)
    if once or not sys.stdout.isatty():
        print(view.drawn(sights))
        return
    print(HOME + CLEAR_BELOW, end="")
    try:
        while True:
            drawn = view.drawn(sights)
            print(
                HOME + drawn.replace("\n", CLEAR_LINE + "\n") + CLEAR_LINE + "\n" + CLEAR_BELOW,
                end="",
                flush=True,
            )
            time.sleep(PERIOD_S)
    except KeyboardInterrupt:
        print()
