# SPDX-License-Identifier: GPL-3.0-or-later
"""What all commands for a Modbus device take: where it is, how its line is set, its unit, its objects."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from typing import Any

from nuc980.errors import UnusableInput
from openrtu_tools.modbus import registers, serial_port
from openrtu_tools.modbus.ascii_text import AsciiStream
from openrtu_tools.modbus.frames import BIT_TABLES, BROADCAST
from openrtu_tools.modbus.links import (
    Link,
    RtuLink,
    SerialStream,
    SocketStream,
    Stream,
    network_link,
)
from openrtu_tools.modbus.made import BYTE_ORDERS, WORD_ORDERS
from openrtu_tools.modbus.registers import Place
from openrtu_tools.modbus.serial_port import PARITIES, SPEEDS, Settings
from openrtu_tools.modbus.values import NUMBERS, WITHOUT, Layout

PORT = 502
UNIT_LAST = 255
SERIAL_UNIT_LAST = 247
DAY_S = 86400
BAUD, PARITY = 19200, "even"  # MODBUS over Serial Line V1.02, 2.4 and 2.5.1: what every device has


def ranged(low: float, high: float, kind: Callable[[str], Any]) -> Callable[[str], Any]:
    def number(text: str) -> Any:
        try:
            found = kind(text)
        except ValueError:
            found = math.nan
        if not low <= found <= high:
            raise argparse.ArgumentTypeError(f'"{text}" is not from {low:g} to {high:g}')
        return found

    return number


def place(text: str) -> Place:
    try:
        return registers.place(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def speed(text: str) -> int:
    if not text.isdigit() or int(text) not in SPEEDS or int(text) == 0:
        raise argparse.ArgumentTypeError(f'"{text}" is no speed of a serial port, as 9600 or 19200')
    return int(text)


def add_device(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "device", help="a serial port (/dev/ttyUSB0), or HOST or HOST:PORT of a device on Modbus TCP"
    )
    parser.add_argument(
        "-u", "--unit", type=ranged(0, UNIT_LAST, int), required=True, help="the device's Modbus address"
    )


def add_line(parser: argparse.ArgumentParser) -> None:
    line = parser.add_argument_group("of a serial port")
    line.add_argument("--baud", type=speed, default=BAUD, metavar="BIT/S", help=f"speed [{BAUD}]")
    line.add_argument("--parity", choices=PARITIES, default=PARITY, help=f"[{PARITY}]")
    line.add_argument("--data-bits", type=int, choices=(7, 8), help="[8; with --ascii 7]")
    line.add_argument("--stop-bits", type=int, choices=(1, 2), default=1, help="[1]")


def add_link(parser: argparse.ArgumentParser, timeout_s: float) -> None:
    parser.add_argument(
        "--rtu", action="store_true", help="to HOST:PORT, RTU in place of Modbus TCP: through a serial server"
    )
    parser.add_argument("--ascii", action="store_true", help="Modbus ASCII in place of RTU or Modbus TCP")
    parser.add_argument("--udp", action="store_true", help="to HOST:PORT, Modbus TCP in datagrams of UDP")
    parser.add_argument(
        "--timeout",
        type=ranged(0.01, 60, float),
        default=timeout_s,
        metavar="S",
        help=f"seconds that an answer may take to begin [{timeout_s:g}]",
    )
    parser.add_argument(
        "--octets", action="store_true", help="print what goes out (>) and comes in (<), with the time"
    )


def add_layout(parser: argparse.ArgumentParser) -> None:
    layout = parser.add_argument_group("of registers, as the keys of an object (docs/configuration.md)")
    layout.add_argument(  # a page of the manual has no line that is as long as all of them
        "--format",
        choices=NUMBERS,
        metavar="FORMAT",
        help=f"what they hold: {', '.join(NUMBERS)} [{WITHOUT}]",
    )
    layout.add_argument("--word-order", choices=WORD_ORDERS, default=WORD_ORDERS[0], help="[big]")
    layout.add_argument("--byte-order", choices=BYTE_ORDERS, default=BYTE_ORDERS[0], help="[big]")


def layout_of(parsed: argparse.Namespace) -> Layout:
    return Layout(parsed.format or WITHOUT, parsed.word_order, parsed.byte_order)


def named_layout(parsed: argparse.Namespace) -> Layout | None:
    """None: nobody said what a register holds."""
    layout = layout_of(parsed)
    return layout if parsed.format or layout != Layout() else None


def width(place: Place, layout: Layout) -> int:
    """Bits or registers of a value there."""
    return 1 if place.table in BIT_TABLES else layout.width


def is_serial(device: str) -> bool:
    return "/" in device


def is_broadcast(parsed: argparse.Namespace) -> bool:
    """On Modbus TCP, unit 0 is one like others."""
    return parsed.unit == BROADCAST and (parsed.rtu or parsed.ascii or is_serial(parsed.device))


def data_bits_of(parsed: argparse.Namespace) -> int:
    """Raises UnusableInput."""
    data_bits: int = parsed.data_bits or (7 if parsed.ascii else serial_port.DATA_BITS)
    if data_bits == 7 and not parsed.ascii:
        raise UnusableInput("--data-bits 7: RTU sends whole octets", next_step="add --ascii, or leave it out")
    return data_bits


def settings_of(parsed: argparse.Namespace) -> Settings:
    return Settings(parsed.baud, parsed.parity, parsed.stop_bits, data_bits_of(parsed))


def link_of(parsed: argparse.Namespace) -> Link:
    """Opened. Raises UnusableInput."""
    link = _opened(parsed)
    stream = link.stream
    (stream.text if isinstance(stream, AsciiStream) else stream).traced = parsed.octets
    return link


def _opened(parsed: argparse.Namespace) -> Link:
    if parsed.rtu and parsed.ascii:
        raise UnusableInput("--rtu and --ascii: a line speaks one of them")
    if parsed.udp and (parsed.rtu or parsed.ascii or is_serial(parsed.device)):
        raise UnusableInput("--udp carries frames of Modbus TCP, to HOST or HOST:PORT")
    if is_serial(parsed.device):
        if parsed.unit > SERIAL_UNIT_LAST:
            raise UnusableInput(f"--unit {parsed.unit}: units of a serial line are 1 to {SERIAL_UNIT_LAST}")
        if parsed.rtu:
            raise UnusableInput("--rtu: a serial port has no other way")
        settings = settings_of(parsed)
        stream: Stream = SerialStream(parsed.device, settings)
        return RtuLink(AsciiStream(stream) if parsed.ascii else stream, parsed.timeout, settings)
    host, port = address(parsed.device)
    if not (parsed.rtu or parsed.ascii):
        return network_link(host, port, parsed.timeout, parsed.udp)
    stream = SocketStream(host, port, parsed.timeout)
    return RtuLink(AsciiStream(stream) if parsed.ascii else stream, parsed.timeout, None)


def address(device: str) -> tuple[str, int]:
    """HOST, HOST:PORT, [IPv6]:PORT or an IPv6 address by itself. Raises UnusableInput."""
    host, colon, port = device.rpartition(":")
    if not colon or device.endswith("]") or (":" in host.strip("[]") and not host.startswith("[")):
        host, port = device, str(PORT)
    host = host.removeprefix("[").removesuffix("]")
    if not host or not port.isascii() or not port.isdigit() or not 0 < int(port) < 1 << 16:
        raise UnusableInput(f'"{device}" is no HOST or HOST:PORT, nor a serial port as /dev/ttyUSB0')
    return host, int(port)
