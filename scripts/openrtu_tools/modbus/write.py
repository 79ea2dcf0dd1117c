# SPDX-License-Identifier: GPL-3.0-or-later
"""`openrtu write`: coils and holding registers of a device that is in no file, read back.

Exit codes: 0 the device has what was written, 1 it refused, was silent or has something else, 2 nothing was
sent.
"""

from __future__ import annotations

import argparse

from nuc980.errors import UnusableInput
from openrtu_tools.modbus import arguments, frames
from openrtu_tools.modbus.errors import Exceptional, ModbusError
from openrtu_tools.modbus.frames import COILS, HOLDING_REGISTERS, Request
from openrtu_tools.modbus.links import Link
from openrtu_tools.modbus.made import ADDRESS_LAST
from openrtu_tools.modbus.read import TIMEOUT_S, Asked
from openrtu_tools.modbus.registers import Place
from openrtu_tools.modbus.values import Layout

SIGNED = "int16"  # a number below 0 without --format
STATES = {"0": 0, "1": 1, "off": 0, "on": 1}
COILS_MOST, REGISTERS_MOST = 1968, 123  # MODBUS Application Protocol V1.1b3, 6.11 and 6.12
ILLEGAL_FUNCTION = 1


def add_arguments(parser: argparse.ArgumentParser) -> None:
    arguments.add_device(parser)
    parser.add_argument(
        "place",
        type=arguments.place,
        metavar="OBJECT",
        help="a coil or holding register: as manuals print it (40001), or c or h and the Modbus address (h0)",
    )
    parser.add_argument(
        "values", nargs="+", metavar="VALUE", help="of a coil on or off; the next ones go behind it"
    )
    parser.add_argument(
        "--multiple",
        action="store_true",
        help="write one coil or register with function 15 or 16, not 5 or 6",
    )
    arguments.add_layout(parser)
    arguments.add_line(parser)
    arguments.add_link(parser, TIMEOUT_S)


def request_of(parsed: argparse.Namespace) -> Request:
    """Raises UnusableInput."""
    place: Place = parsed.place
    raw = _raw(place, parsed)
    if place.address + len(raw) - 1 > ADDRESS_LAST:
        raise UnusableInput(f"{place.letter}{place.address}: so many go beyond address {ADDRESS_LAST}")
    most = COILS_MOST if place.table == COILS else REGISTERS_MOST
    if len(raw) > most:
        raise UnusableInput(f"{len(raw)} {place.table.replace('_', ' ')}: one request writes at most {most}")
    make = frames.write_bits if place.table == COILS else frames.write_registers
    return make(parsed.unit, place.address, raw, parsed.multiple)


def _raw(place: Place, parsed: argparse.Namespace) -> list[int]:
    if place.table == COILS:
        unknown = next((value for value in parsed.values if value not in STATES), None)
        if unknown is not None:
            raise UnusableInput(f'"{unknown}" is no state of a coil: on, off, 1 or 0')
        return [STATES[value] for value in parsed.values]
    if place.table != HOLDING_REGISTERS:
        raise UnusableInput(
            f"{place.letter}{place.address}: {place.table.replace('_', ' ')} cannot be written"
        )
    layout = arguments.layout_of(parsed)
    signed = Layout(SIGNED, parsed.word_order, parsed.byte_order)
    try:
        return [
            word
            for value in parsed.values
            for word in (signed if value.startswith("-") and not parsed.format else layout).words(value)
        ]
    except ValueError as error:
        raise UnusableInput(str(error)) from error


def run(parsed: argparse.Namespace) -> int:
    request = request_of(parsed)
    with arguments.link_of(parsed) as link:
        if arguments.is_broadcast(parsed):
            link.tell(request)
            print("sent to all units; nobody answers, so nobody knows who did it")
            return 0
        _write(link, request)
        return _read_back(link, parsed)


def _write(link: Link, request: Request) -> None:
    try:
        link.ask(request)
    except Exceptional as error:
        if error.code == ILLEGAL_FUNCTION and request.function in frames.ECHOES:
            error.next_step = "the device may take the other function: try --multiple"
        raise
    except ModbusError as error:
        error.next_step = "read it before you write again: the device may or may not have done it"
        raise


def _read_back(link: Link, parsed: argparse.Namespace) -> int:
    """Says what the device has now, and whether that is what was written."""
    place: Place = parsed.place
    try:
        values = Asked(place, len(parsed.values), arguments.named_layout(parsed)).read(link, parsed.unit)
    except ModbusError as error:
        error.what = f"the device confirmed the write, but: {error.what}"
        error.next_step = "nothing, if this cannot be read: some registers are written only"
        raise
    raw = _raw(place, parsed)
    width = arguments.width(place, arguments.layout_of(parsed))
    wanted = [tuple(raw[at : at + width]) for at in range(0, len(raw), width)]
    for value, words, text in zip(values, wanted, parsed.values, strict=True):
        same = value.words == words
        print(f"{value.row()}  {'as written' if same else f'but {text} was written'}")
    return 0 if [value.words for value in values] == wanted else 1
