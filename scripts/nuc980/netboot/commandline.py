# SPDX-License-Identifier: GPL-3.0-or-later
"""A line as it is typed at U-Boot's hush, and how its end is known.

A command is typed as `if COMMAND; then echo @N:ok; else echo @N:failed; fi`. A part of this line runs
nothing: U-Boot waits for the `fi`, so that a noise byte that is an Enter, or one just before the Enter, leads
to its second prompt and no further. The two ends differ in more than noise turns over.
"""

from __future__ import annotations

import re

from nuc980.netboot.errors import LineTooLong

# CONFIG_SYS_CBSIZE is 256, the reader takes 254 (shared by the vendor's and the mainline cread_line).
LINE_ROOM = 254


def _check_printable(words: str) -> None:
    if not words.isascii() or not words.isprintable():
        raise LineTooLong(f"U-Boot's command line accepts only printable ASCII: {words!r}")


def typed(command: str, number: int) -> str:
    """A command as it is typed: with a marker that shows its end and how it ended. Raises LineTooLong."""
    line = f"if {command}; then echo @{number}:ok; else echo @{number}:failed; fi"
    if len(line) > LINE_ROOM:
        raise LineTooLong(f"{len(line)} characters are too many for U-Boot's line of {LINE_ROOM}: {line}")
    _check_printable(line)
    return line


# What a command may have, up to the number 9999.
COMMAND_ROOM = LINE_ROOM - len(typed("", 9999))


def ended(number: int) -> re.Pattern[bytes]:
    """The end of a command's output, in bytes without carriage returns; group 1: `ok` or `failed`."""
    return re.compile(rb"@%d:(ok|failed)\n" % number)


def text(received: bytes) -> str:
    """A line's output as one reads it."""
    return received.decode(errors="replace").replace("\r", "")


def quoted(value: str) -> str:
    """A word that U-Boot's hush takes as it is: there a back-slash is one in single quotes too.

    Raises LineTooLong for what no line can carry.
    """
    _check_printable(value)
    return "'" + value.replace("\\", "\\\\").replace("'", r"'\''") + "'"
