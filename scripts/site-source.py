#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""
site-source.py OUT: the pages of this tree for MkDocs, into the folder OUT, in the folders that they have
here. With them comes what they link to: figures, examples and files of the tree, as they are.
"""

from __future__ import annotations

import re
import shutil
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FIRST = ("README.md", "CHANGELOG.md", "CONTRIBUTING.md", "SECURITY.md", "docs")
LINK = re.compile(r"\]\((?!\w+:)([^)#\s]+)(?:#[^)\s]*)?\)")
ITEM = re.compile(r"(?:[-*]|\d+\.) +(?=\S)")
INDENT = 4  # of what belongs to an item of a list, for Python's Markdown


def linked(page: Path) -> set[Path]:
    """The files that a page links to."""
    targets = LINK.findall(page.read_text(encoding="utf-8"))
    return {path for target in targets if (path := (page.parent / target).resolve()).is_file()}


def site_files() -> set[Path]:
    """All that is below FIRST, and what is linked from there, pages of pages too."""
    waiting = {file for name in FIRST for file in (ROOT / name, *(ROOT / name).rglob("*")) if file.is_file()}
    found: set[Path] = set()
    while waiting:
        file = waiting.pop()
        found.add(file)
        if file.suffix == ".md":
            waiting |= linked(file) - found
    return found


def indented(page: str) -> str:
    """Blocks of a list's items as Python's Markdown knows them; forges do by the column of the item's text.

    >>> print(indented("1. Type\\n\\n   ```sh\\n   make\\n   ```\\n2. Wait"))
    1. Type
    <BLANKLINE>
        ```sh
        make
        ```
    <BLANKLINE>
    2. Wait
    <BLANKLINE>
    """
    lines: list[str] = []
    column = 0  # of the text of the item that is open
    blocks = fenced = False  # the item has several; a fence of its own is open
    for line in page.splitlines():
        if not line.startswith(" ") and line.startswith("```"):
            fenced = not fenced
        if not fenced and (item := ITEM.match(line)):
            if blocks and lines[-1]:
                lines.append("")  # else it would go on with the last block
            column, blocks = item.end(), False
        elif line.strip() and not line.startswith(" "):
            column, blocks = 0, False
        elif column and line.startswith(" " * column):
            line, blocks = " " * INDENT + line[column:], blocks or not lines[-1]
        lines.append(line)
    return "\n".join(lines) + "\n"


def main(out: Path) -> None:
    shutil.rmtree(out, ignore_errors=True)
    for file in sorted(site_files()):
        place = out / file.relative_to(ROOT)
        place.parent.mkdir(parents=True, exist_ok=True)
        if file.suffix == ".md":
            place.write_text(indented(file.read_text(encoding="utf-8")), encoding="utf-8")
        else:
            shutil.copyfile(file, place)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
