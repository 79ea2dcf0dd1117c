# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws what a show printed as a picture of a terminal, for the README.

python -m lab.picture PICTURE.svg < RECORDED. A table keeps its first rows; an ellipsis is the rest.
"""

from __future__ import annotations

import html
import itertools
import re
import sys
from collections.abc import Iterable
from pathlib import Path

COMMAND = "make run-native"
ROWS_OF_A_TABLE = 4
COLUMNS = 112
CHARACTER = 8.43  # px, of a 14 px monospaced font
LINE = 19  # px
MARGIN = 16
TITLE_BAR = 30

# The first style whose pattern fits colours that part of a line.
STYLES = [
    ("command", re.compile(r"^\$ .*")),
    ("step", re.compile(r"^ ?\d+\. .*|^All \d+ steps .*")),
    ("bad", re.compile(r"\bInvalid\b|\bunplugged\b|negative confirmation")),
    ("good", re.compile(r"\bgood\b|activation confirmed|plugged in again")),
    ("frame", re.compile(r"\[\d+( \d+)+\]")),
    ("quiet", re.compile(r"^   \* .*|^       (?! ).*|^     Address .*|^     …$")),
]


def shortened(lines: Iterable[str]) -> list[str]:
    """The lines with the first rows of each table."""
    kept: list[str] = []
    for is_row, group in itertools.groupby(lines, lambda line: re.match(r"     \d{7} ", line) is not None):
        rows = list(group)
        kept += [*rows[:ROWS_OF_A_TABLE], "     …"] if is_row and len(rows) > ROWS_OF_A_TABLE else rows
    return kept


def wrapped(line: str) -> list[str]:
    """A line as a terminal of this width shows it, but broken between words."""
    if len(line) <= COLUMNS:
        return [line]
    end = line.rindex(" ", 0, COLUMNS)
    return [line[:end], *wrapped("       " + line[end + 1 :])]


def spans(line: str) -> str:
    """The line's text in SVG, each styled part in its own tspan."""
    found = sorted(
        (match.start(), match.end(), style) for style, pattern in STYLES for match in pattern.finditer(line)
    )
    parts: list[str] = []
    at = 0
    for start, end, style in found:
        if start < at:
            continue
        parts.append(html.escape(line[at:start]))
        parts.append(f'<tspan class="{style}">{html.escape(line[start:end])}</tspan>')
        at = end
    return "".join([*parts, html.escape(line[at:])])


def draw(recorded: str) -> str:
    """The picture, in SVG."""
    shown = shortened(recorded.rstrip("\n").split("\n"))
    lines = [f"$ {COMMAND}", *(part for line in shown for part in wrapped(line))]
    width = COLUMNS * CHARACTER + 2 * MARGIN
    height = TITLE_BAR + len(lines) * LINE + MARGIN
    texts = [
        f'  <text x="{MARGIN}" y="{TITLE_BAR + number * LINE}" xml:space="preserve">{spans(line)}</text>'
        for number, line in enumerate(lines, 1)
        if line
    ]
    return "\n".join(
        [
            "<!-- SPDX-License-Identifier: GPL-3.0-or-later -->",
            "<!-- Drawn by scripts/lab/picture.py. -->",
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" role="img"'
            ' aria-labelledby="title">',
            f'  <title id="title">What {COMMAND} shows</title>',
            "  <style>",
            '    text { font: 14px "DejaVu Sans Mono", Menlo, Consolas, monospace; fill: #d5dbe3 }',
            "    .command { fill: #ffffff; font-weight: bold }",
            "    .step { fill: #7cc7ff; font-weight: bold }",
            "    .good { fill: #7bd88f }",
            "    .bad { fill: #ff8f8f }",
            "    .frame { fill: #f5c86e }",
            "    .quiet { fill: #93a1b3 }",
            "  </style>",
            f'  <rect width="{width:g}" height="{height:g}" rx="10" fill="#18202b"/>',
            *(
                f'  <circle cx="{18 + 20 * place}" cy="17" r="6" fill="{colour}"/>'
                for place, colour in enumerate(("#ff6159", "#ffbd2e", "#28c941"))
            ),
            *texts,
            "</svg>",
            "",
        ]
    )


def main(arguments: list[str]) -> int:
    if len(arguments) != 1:
        print(__doc__, file=sys.stderr)
        return 2
    Path(arguments[0]).write_text(draw(sys.stdin.read()), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
