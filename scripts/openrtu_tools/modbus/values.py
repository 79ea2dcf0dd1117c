# SPDX-License-Identifier: GPL-3.0-or-later
"""Between registers and numbers: the formats and orders of the configuration."""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Sequence
from dataclasses import dataclass

from openrtu_tools.modbus.made import BYTE_ORDERS, FORMATS, WORD_ORDERS

FORMAT = re.compile(r"(?P<kind>u?int|float|bcd|mod10_|fixed24_)(?P<size>\d+)")
TEXTS = ("string", "string16")  # of the gateway's objects alone, which say how long they are
NUMBERS = tuple(name for name in FORMATS if name not in TEXTS)
FLOATS = {32: "f", 64: "d"}  # as struct calls them, by their bits
MOD10 = 10_000  # of a register, which has a sign
FIXED_ONE = 256  # of fixed24_8: 24 bits before the point
WORD = 16
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
        return self._bits // WORD

    def number(self, words: Sequence[int]) -> int | float | None:
        """None: what the registers hold is no number."""
        ordered = words if self.word_order == BIG else words[::-1]
        octets = b"".join(word.to_bytes(2, self._byte_order) for word in ordered)
        match self._kind:
            case "float":
                found: float = struct.unpack(f">{FLOATS[self._bits]}", octets)[0]
                return found
            case "bcd":
                return int(octets.hex()) if octets.hex().isdecimal() else None
            case "mod10_":
                return _of_mod10(octets)
            case "fixed24_":
                return int.from_bytes(octets, signed=True) / FIXED_ONE
            case kind:
                return int.from_bytes(octets, signed=kind == "int")

    def words(self, text: str) -> list[int]:
        """Raises ValueError, which says why the format has no such number."""
        try:
            octets = self._octets(self._parsed(text))
        except (struct.error, OverflowError) as error:
            raise ValueError(f'"{text}" is out of the range of {self.format}') from error
        words = [int.from_bytes(octets[at : at + 2], self._byte_order) for at in range(0, len(octets), 2)]
        return words if self.word_order == BIG else words[::-1]

    def text(self, words: Sequence[int]) -> str:
        number = self.number(words)
        if number is None:
            return "no number"
        return _shortest(number) if self.format == "float32" else str(number)

    def _octets(self, number: int | float) -> bytes:
        size = self._bits // 8
        match self._kind:
            case "float":
                return struct.pack(f">{FLOATS[self._bits]}", number)
            case "bcd":
                return _to_bcd(int(number), 2 * size)
            case "mod10_":
                return _to_mod10(int(number), self.width)
            case "fixed24_":
                return round(number * FIXED_ONE).to_bytes(size, signed=True)
            case kind:
                return int(number).to_bytes(size, signed=kind == "int")

    @property
    def _parts(self) -> re.Match[str]:
        found = FORMAT.fullmatch(self.format)
        assert found, f"{self.format} is a format that nobody has taught us"
        return found

    @property
    def _kind(self) -> str:
        return self._parts["kind"]

    @property
    def _bits(self) -> int:
        return 2 * WORD if self._kind == "fixed24_" else int(self._parts["size"])

    @property
    def _byte_order(self) -> str:
        return "big" if self.byte_order == BIG else "little"

    def _parsed(self, text: str) -> int | float:
        fraction = self._kind in ("float", "fixed24_")
        try:
            number = float(text) if fraction else int(text, 0)
        except ValueError as error:
            kind = "number" if fraction else "integer"
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


def _of_mod10(octets: bytes) -> int | None:
    """Each register is a place of the number, with a sign."""
    number = 0
    for at in range(0, len(octets), 2):
        place = int.from_bytes(octets[at : at + 2], signed=True)
        if abs(place) >= MOD10:
            return None
        number = number * MOD10 + place
    return number


def _to_mod10(number: int, registers: int) -> bytes:
    """Raises OverflowError."""
    places, rest = [], abs(number)
    for _ in range(registers):
        rest, place = divmod(rest, MOD10)
        places.append((place if number > 0 else -place).to_bytes(2, signed=True))
    if rest:
        raise OverflowError
    return b"".join(reversed(places))


def _to_bcd(number: int, digits: int) -> bytes:
    """Raises OverflowError."""
    text = f"{number:0{digits}}"
    if number < 0 or len(text) > digits:
        raise OverflowError
    return bytes.fromhex(text)
