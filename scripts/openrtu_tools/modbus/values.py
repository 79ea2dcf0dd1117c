# SPDX-License-Identifier: GPL-3.0-or-later
"""Between registers and numbers: the formats and orders of the configuration."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass

from openrtu_tools.modbus.made import BYTE_ORDERS, FORMATS, WORD_ORDERS

# Of each format: how struct calls it, with the high octet first.
CODES = {
    "int16": "h",
    "uint16": "H",
    "int32": "i",
    "uint32": "I",
    "int64": "q",
    "uint64": "Q",
    "float32": "f",
    "float64": "d",
}
FLOATS = "fd"
FLOAT32_DIGITS = range(6, 10)  # 9 tell any two of them apart
BIG, LITTLE = WORD_ORDERS
WITHOUT = "uint16"  # the format of what has none
assert BYTE_ORDERS == WORD_ORDERS


@dataclass(frozen=True)
class Layout:
    """How a number stands in registers."""

    format: str = WITHOUT
    word_order: str = BIG
    byte_order: str = BIG

    @property
    def width(self) -> int:
        """Registers."""
        return struct.calcsize(f">{CODES[self.format]}") // 2

    def number(self, words: Sequence[int]) -> int | float:
        ordered = words if self.word_order == BIG else words[::-1]
        octets = b"".join(word.to_bytes(2, self._byte_order) for word in ordered)
        return struct.unpack(f">{CODES[self.format]}", octets)[0]

    def words(self, text: str) -> list[int]:
        """Raises ValueError, which says why the format has no such number."""
        try:
            octets = struct.pack(f">{CODES[self.format]}", self._parsed(text))
        except (struct.error, OverflowError) as error:
            raise ValueError(f'"{text}" is out of the range of {self.format}') from error
        words = [int.from_bytes(octets[at : at + 2], self._byte_order) for at in range(0, len(octets), 2)]
        return words if self.word_order == BIG else words[::-1]

    def text(self, words: Sequence[int]) -> str:
        number = self.number(words)
        if CODES[self.format] == "f":
            return _shortest(number)
        return str(number)

    @property
    def _byte_order(self) -> str:
        return "big" if self.byte_order == BIG else "little"

    def _parsed(self, text: str) -> int | float:
        try:
            number = float(text) if CODES[self.format] in FLOATS else int(text, 0)
        except ValueError as error:
            kind = "number" if CODES[self.format] in FLOATS else "integer"
            raise ValueError(f'"{text}" is no {kind}, which {self.format} needs') from error
        if not math.isfinite(number):
            raise ValueError(f'"{text}" is no number that can be written')
        return number


def _shortest(number: float) -> str:
    """What a float of 32 bits was, before its 24 bits became a double's 53."""
    if math.isfinite(number):
        for digits in FLOAT32_DIGITS:
            text = f"{number:.{digits}g}"
            if struct.pack(">f", float(text)) == struct.pack(">f", number):
                return text
    return str(number)


assert set(FORMATS) == set(CODES)
