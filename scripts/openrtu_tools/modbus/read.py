# SPDX-License-Identifier: GPL-3.0-or-later
"""`openrtu read`: some objects of a device that is in no file.

Exit codes: 0 read, 1 a device did not give something, 2 nothing could be asked.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from nuc980.errors import UnusableInput
from openrtu_tools.modbus import arguments, frames
from openrtu_tools.modbus.errors import Exceptional
from openrtu_tools.modbus.frames import BIT_TABLES, BITS_MOST, REGISTERS_MOST
from openrtu_tools.modbus.links import Link
from openrtu_tools.modbus.made import ADDRESS_LAST
from openrtu_tools.modbus.registers import Place
from openrtu_tools.modbus.values import Layout

SIGN = 0x8000
TIMEOUT_S = 1.0


@dataclass(frozen=True)
class Value:
    """An object as it was read."""

    place: Place
    words: tuple[int, ...]  # its registers; of a bit, 0 or 1
    layout: Layout | None  # None: nobody said what a register holds

    def row(self) -> str:
        place = f"{self.place.number:<7}{self.place.letter}{self.place.address:<6}"
        raw = "" if self.place.table in BIT_TABLES else "".join(f"0x{word:04X} " for word in self.words)
        return f"{place} {raw} {self.text()}"

    def text(self) -> str:
        if self.place.table in BIT_TABLES:
            return str(self.words[0])
        if self.layout:
            return self.layout.text(self.words)
        (word,) = self.words
        return f"{word} ({word - 2 * SIGN})" if word & SIGN else str(word)

    def record(self) -> dict[str, Any]:
        value = (self.layout or Layout()).number(self.words)
        if value is not None and not math.isfinite(value):
            value = None  # JSON has no NaN
        return {
            "table": self.place.table,
            "address": self.place.address,
            "register": self.place.number,
            "raw": list(self.words),
            "value": value,
        }


@dataclass(frozen=True)
class Asked:
    """Neighbouring objects that one request reads."""

    place: Place
    count: int  # objects
    layout: Layout | None

    def _width(self) -> int:
        return arguments.width(self.place, self.layout or Layout())

    def read(self, link: Link, unit: int) -> list[Value]:
        width, bits = self._width(), self.place.table in BIT_TABLES
        request = frames.read(unit, self.place.table, self.place.address, self.count * width)
        pdu = link.ask(request)
        raw = frames.bits_of(pdu, self.count) if bits else frames.words_of(pdu)
        return [
            Value(
                Place(self.place.table, self.place.address + at),
                tuple(raw[at : at + width]),
                None if bits else self.layout,
            )
            for at in range(0, self.count * width, width)
        ]


def requests(places: Sequence[Place], count: int, layout: Layout | None) -> Iterator[Asked]:
    """In as few requests as the protocol allows; each place has its own. Raises UnusableInput."""
    for place in places:
        width = arguments.width(place, layout or Layout())
        if place.address + count * width - 1 > ADDRESS_LAST:
            raise UnusableInput(
                f"{place.letter}{place.address}: {count} from there go beyond address {ADDRESS_LAST}"
            )
        most = BITS_MOST if place.table in BIT_TABLES else REGISTERS_MOST // width
        for first in range(0, count, most):
            there = Place(place.table, place.address + first * width)
            yield Asked(there, min(most, count - first), layout)


def asked_for(parsed: argparse.Namespace) -> list[Asked]:
    """Raises UnusableInput."""
    if arguments.is_broadcast(parsed):
        raise UnusableInput("--unit 0: is the broadcast of a serial line, which nobody answers")
    return list(requests(parsed.places, parsed.count, arguments.named_layout(parsed)))


def add_objects(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "places",
        type=arguments.place,
        nargs="+",
        metavar="OBJECT",
        help="a number as manuals print it (40001), or c, d, i or h and the Modbus address (h0)",
    )
    parser.add_argument(
        "-n",
        "--count",
        type=arguments.ranged(1, ADDRESS_LAST + 1, int),
        default=1,
        help="so many values from each [1]",
    )
    arguments.add_layout(parser)
    arguments.add_line(parser)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    arguments.add_device(parser)
    add_objects(parser)
    arguments.add_link(parser, TIMEOUT_S)
    parser.add_argument("--json", action="store_true", help="print JSON lines, an object each")


def run(parsed: argparse.Namespace) -> int:
    asked, refused = asked_for(parsed), 0
    with arguments.link_of(parsed) as link:
        for one in asked:
            try:
                values = one.read(link, parsed.unit)
            except Exceptional as error:  # the next one may be there
                print(f"openrtu read: {error}", file=sys.stderr)
                refused += 1
                continue
            for value in values:
                print(json.dumps(value.record()) if parsed.json else value.row())
    return 1 if refused else 0
