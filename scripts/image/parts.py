# SPDX-License-Identifier: GPL-3.0-or-later
"""
python3 -m image.parts: adds to each defconfig what it lacks of the parts (configs/parts) that its head names.
A new line comes behind the one that is before it in the part; `make savedefconfig` gives all their order.
A line that a part no longer has stays: take it out of the defconfigs by hand, `make test` names them.
"""

from __future__ import annotations

import sys
from pathlib import Path

from image.checks import defconfigs, parts_of, settings

ROOT = Path(__file__).resolve().parents[2]


def completed(defconfig: Path) -> list[str]:
    """The defconfig's lines with what it lacks. A symbol that it has with another value takes the part's."""
    lines = defconfig.read_text(encoding="utf-8").splitlines()
    for part in parts_of(defconfig):
        before = len(lines) - 1
        for each in settings(part):
            if each.text not in lines:
                lines = [line for line in lines if not _sets(line, each.symbol)]
                lines.insert(before + 1, each.text)
            before = lines.index(each.text)
    return lines


def _sets(line: str, symbol: str) -> bool:
    return line.startswith(f"{symbol}=") or line == f"# {symbol} is not set"


def main() -> int:
    for defconfig in defconfigs(ROOT):
        text = "\n".join(completed(defconfig)) + "\n"
        if text != defconfig.read_text(encoding="utf-8"):
            defconfig.write_text(text, encoding="utf-8")
            print(f"{defconfig.relative_to(ROOT)} is changed")
    return 0


if __name__ == "__main__":
    sys.exit(main())
