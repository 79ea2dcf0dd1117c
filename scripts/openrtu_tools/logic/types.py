# SPDX-License-Identifier: GPL-3.0-or-later
"""The elementary types, in the order of logic_type (format.h), and what one becomes without being asked."""

from __future__ import annotations

import struct
from datetime import datetime, timedelta

TYPES = [
    "BOOL",
    "SINT",
    "INT",
    "DINT",
    "LINT",
    "USINT",
    "UINT",
    "UDINT",
    "BYTE",
    "WORD",
    "DWORD",
    "TIME",
    "DATE_AND_TIME",
    "REAL",
    "LREAL",
]
CODES = {name: code for code, name in enumerate(TYPES)}
ALIASES = {"DT": "DATE_AND_TIME"}
SIGNED = ("SINT", "INT", "DINT", "LINT")
UNSIGNED = ("USINT", "UINT", "UDINT")
BITS = ("BYTE", "WORD", "DWORD")
INTEGERS = (*SIGNED, *UNSIGNED)
REALS = ("REAL", "LREAL")
NUMBERS = (*INTEGERS, *REALS)
RANGES = {
    "BOOL": (0, 1),
    **{
        name: (-(1 << 8 * size - 1), (1 << 8 * size - 1) - 1)
        for name, size in zip(SIGNED, (1, 2, 4, 8), strict=True)
    },
    **{name: (0, (1 << 8 * size) - 1) for name, size in zip(UNSIGNED, (1, 2, 4), strict=True)},
    **{name: (0, (1 << 8 * size) - 1) for name, size in zip(BITS, (1, 2, 4), strict=True)},
    "TIME": (-(1 << 63), (1 << 63) - 1),
    "DATE_AND_TIME": (-(1 << 63), (1 << 63) - 1),
}
DT_MAX = 253_402_300_799_999_999  # the end of the year 9999, in microseconds
REAL_MAX = 3.4028234663852886e38


def widens(narrow: str, wide: str) -> bool:
    """Whether each value of the one is one of the other."""
    if narrow == wide or (narrow, wide) == ("REAL", "LREAL"):
        return True
    if (narrow in INTEGERS and wide in INTEGERS) or (narrow in BITS and wide in BITS):
        return RANGES[wide][0] <= RANGES[narrow][0] and RANGES[narrow][1] <= RANGES[wide][1]
    exact = {"REAL": 1 << 24, "LREAL": 1 << 53}
    return narrow in INTEGERS and wide in exact and RANGES[narrow][1] <= exact[wide]


def machine_type(kind: str) -> int:
    """The machine's number of a type. What is none of its own is an enumeration."""
    return CODES.get(kind, CODES["DINT"])


def common(left: str, right: str) -> str | None:
    """The narrowest type that both widen to."""
    if left == right:
        return left
    return next((name for name in TYPES if widens(left, name) and widens(right, name)), None)


def literal(kind: str, value: float | str) -> str:
    """A value as the text of a program has it: `TRUE`, `T#1.5s`, `16#FF`."""
    if kind == "STRING":
        return "'" + str(value).replace("$", "$$").replace("'", "$'") + "'"
    if kind == "BOOL":
        return str(bool(value)).upper()
    if kind in BITS:
        return f"16#{int(value):X}"
    if kind == "TIME":
        return f"T#{value / 1e6:.10g}s"
    if kind == "DATE_AND_TIME":
        moment = datetime(1970, 1, 1) + timedelta(microseconds=min(max(value, 0), DT_MAX))
        return f"DT#{moment:%Y-%m-%d-%H:%M:%S}"
    if kind in REALS:
        return f"{value:.7g}" if kind == "REAL" else f"{value:.10g}"
    return str(value)


def pack(kind: str, value: float) -> int:
    """The bits of a cell."""
    if kind == "REAL":
        return int.from_bytes(struct.pack("<f", value), "little")
    if kind == "LREAL":
        return int.from_bytes(struct.pack("<d", value), "little")
    return int(value) & 0xFFFF_FFFF_FFFF_FFFF


def unpack(kind: str, bits: int) -> bool | int | float:
    octets = bits.to_bytes(8, "little")
    if kind == "REAL":
        return struct.unpack("<f", octets[:4])[0]
    if kind == "LREAL":
        return struct.unpack("<d", octets)[0]
    return bool(bits) if kind == "BOOL" else int.from_bytes(octets, "little", signed=True)
