# SPDX-License-Identifier: GPL-3.0-or-later
"""Numbers as U-Boot reads and prints them."""

from __future__ import annotations

import re


def size_text(size: int) -> str:
    """print_size of lib/display_options.c."""
    for shift, unit in ((30, "G"), (20, "M"), (10, "K")):
        if size >> shift:
            whole, rest = size >> shift, size & ((1 << shift) - 1)
            tenth = (10 * rest + (1 << (shift - 1))) >> shift
            if tenth >= 10:
                whole, tenth = whole + 1, tenth - 10
            return f"{whole}{f'.{tenth}' if tenth else ''} {unit}iB"
    return f"{size} Bytes"


def hexadecimal(text: str) -> int:
    """simple_strtoul to base 16: as far as it is a number, else 0."""
    found = re.match(r"(?:0[xX])?([0-9a-fA-F]+)", text)
    return int(found[1], 16) if found else 0


def whole_number(text: str) -> int | None:
    """str2long to base 16: None when it is not a number to its end."""
    return int(text, 16) if re.fullmatch(r"(?:0[xX])?[0-9a-fA-F]+", text) else None
