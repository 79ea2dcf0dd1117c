# SPDX-License-Identifier: GPL-3.0-or-later
"""An object's place: as manuals and the key `register` have it (40001), or a letter and its address (h0)."""

from __future__ import annotations

import re
from dataclasses import dataclass

from openrtu_tools.modbus.made import ADDRESS_LAST, NUMBER_DIGITS, TABLES

LETTERS = "cdih"  # of the tables, as names of points have them
SHORT, LONG = 5, 6  # digits of a number
BY_ADDRESS = re.compile(rf"([{LETTERS}])(0x[0-9a-f]{{1,4}}|\d{{1,5}})", re.IGNORECASE)
SHORT_LAST = 9998


@dataclass(frozen=True)
class Place:
    table: str
    address: int

    @property
    def letter(self) -> str:
        return LETTERS[TABLES.index(self.table)]

    @property
    def number(self) -> str:
        """As manuals print it."""
        width = SHORT if self.address <= SHORT_LAST else LONG
        return f"{NUMBER_DIGITS[TABLES.index(self.table)]}{self.address + 1:0{width - 1}}"

    def __str__(self) -> str:
        return f"{self.number} {self.letter}{self.address}"


def place(text: str) -> Place:
    """Raises ValueError, which says what is wrong."""
    if found := BY_ADDRESS.fullmatch(text):
        table, address = TABLES[LETTERS.index(found[1].lower())], int(found[2], 0)
    elif text.isascii() and text.isdigit() and len(text) in (SHORT, LONG) and text[0] in NUMBER_DIGITS:
        table, address = TABLES[NUMBER_DIGITS.index(text[0])], int(text[1:]) - 1
    else:
        raise ValueError(f'"{text}" is no place: {_expected(text)}')
    if not 0 <= address <= ADDRESS_LAST:
        raise ValueError(f'"{text}" is beyond Modbus addresses, 0 to {ADDRESS_LAST}')
    return Place(table, address)


def _expected(text: str) -> str:
    if text.isascii() and text.isdigit() and int(text) <= ADDRESS_LAST:
        return (
            f"for Modbus address {int(text)} write h{int(text)} (holding register), i{int(text)} (input "
            f"register), c{int(text)} (coil) or d{int(text)} (discrete input)"
        )
    return (
        "expected a number as manuals print it (40001), or a letter of c, d, i, h and the Modbus address (h0)"
    )
