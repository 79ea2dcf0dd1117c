# SPDX-License-Identifier: GPL-3.0-or-later
"""Qualities of a point as IEC 60870-5-104 and IEC 61850 tell them, and a module of all types of points."""

from pathlib import Path

CHANCE = Path(__file__).parents[1] / "fixtures/foreign/chance.py"
CA, DEVICE = 920, "OpenRTUCA920"
TYPES = (
    "single",
    "double",
    "step",
    "bitstring",
    "normalized",
    "scaled",
    "float",
    "integer",
    "angle",
)
# The quality descriptor (101, 7.2.6.3).
INVALID, NOT_TOPICAL, SUBSTITUTED, BLOCKED, OVERFLOW = 0x80, 0x40, 0x20, 0x10, 0x01


def quality_of_iec61850(quality: int) -> int:
    """13 bits, the first the greatest: as docs/iec61850.md has them."""
    bits = "00"
    if quality & INVALID:
        bits = "01"
    elif quality & (NOT_TOPICAL | OVERFLOW):
        bits = "11"
    bits += "1" if quality & OVERFLOW else "0"
    bits += "000"  # outOfRange, badReference, oscillatory
    bits += "1" if quality & INVALID else "0"  # failure
    bits += "1" if quality & NOT_TOPICAL else "0"  # oldData
    bits += "00"  # inconsistent, inaccurate
    bits += "1" if quality & SUBSTITUTED else "0"
    bits += "0"  # test
    bits += "1" if quality & BLOCKED else "0"
    return int(bits, 2)
