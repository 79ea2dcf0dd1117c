# SPDX-License-Identifier: GPL-3.0-or-later
"""A running program's text, with the values of its points beside the lines that name them."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import time
from collections.abc import Sequence
from typing import Any

from logic.binary import Program
from logic.errors import LogicError

PERIOD_S = 1.0
PATIENCE_S = 10.0
WIDTH_MAX = 90  # of the text; what is longer pushes its values to the right
HOME, CLEAR_LINE, CLEAR_BELOW = "\033[H", "\033[K", "\033[J"
SILENT = re.compile(r"\(\*.*?\*\)|//[^\n]*|'[^'\n]*'", re.DOTALL)  # comments and strings name no point


def named(text: str, program: Program) -> list[list[str]]:
    """Of each line, the points that it names, in their order."""
    known = {point.name.casefold(): point.name for point in program.points}
    heard = SILENT.sub(lambda found: re.sub(r"[^\n]", " ", found.group()), text)
    words = (re.findall(r"[A-Za-z_]\w*", line) for line in heard.splitlines())
    return [list(dict.fromkeys(known[w.casefold()] for w in line if w.casefold() in known)) for line in words]


def ask(command: Sequence[str]) -> dict[str, dict[str, Any]]:
    """All points of the gateway, as rtuctl has them."""
    try:
        done = subprocess.run(
            [*command, "--json", "points"], capture_output=True, text=True, check=False, timeout=PATIENCE_S
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
    return {row["name"]: row for row in rows}


def shown(name: str, point: dict[str, Any] | None) -> str:
    """One value: `level=50`, `level=50 (invalid)`."""
    if point is None:
        return f"{name}=? (no such point)"
    value = "?" if point["value"] is None else point["value"]
    notes = [point["quality"]] if point["quality"] != "good" else []
    notes += ["forced"] if point["forced"] else []
    return f"{name}={value}" + (f" ({', '.join(notes)})" if notes else "")


def page(
    text: str, names: list[list[str]], points: dict[str, dict[str, Any]], aliases: dict[str, str]
) -> str:
    """The text with what is true now."""
    lines = text.expandtabs(4).splitlines()
    width = min(max(map(len, lines), default=0), WIDTH_MAX)
    shows = [
        "  ".join(shown(name, points.get(aliases.get(name, name))) for name in mentioned)
        for mentioned in names
    ]
    return "\n".join(
        f"{number:4} {line:{width}}  | {values}" if values else f"{number:4} {line}"
        for number, (line, values) in enumerate(zip(lines, shows, strict=True), 1)
    )


def watch(text: str, program: Program, command: Sequence[str], aliases: dict[str, str], once: bool) -> None:
    """Prints the page once, or again and again until Ctrl-C."""
    names = named(text, program)
    if once or not sys.stdout.isatty():
        print(page(text, names, ask(command), aliases))
        return
    print(HOME + CLEAR_BELOW, end="")
    try:
        while True:
            drawn = page(text, names, ask(command), aliases)
            print(
                HOME + drawn.replace("\n", CLEAR_LINE + "\n") + CLEAR_LINE + "\n" + CLEAR_BELOW,
                end="",
                flush=True,
            )
            time.sleep(PERIOD_S)
    except KeyboardInterrupt:
        print()
