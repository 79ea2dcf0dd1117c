# SPDX-License-Identifier: GPL-3.0-or-later
"""`openrtu scan`: which units answer on serial ports, at which speed and parity, or on Modbus TCP.

It reads with functions 1 to 4 and 43, and writes nothing. What it finds it prints as a configuration.
Exit codes: 0 something was found, 1 nothing was, or somebody else is on the line, 2 nothing was asked.
"""

from __future__ import annotations

import argparse
import ipaddress
import json
import sys
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any

from nuc980.errors import UnusableInput
from openrtu_tools import devices
from openrtu_tools.devices import Device as Template
from openrtu_tools.modbus import arguments, frames
from openrtu_tools.modbus.ascii_text import AsciiStream
from openrtu_tools.modbus.errors import (
    Damaged,
    Exceptional,
    ForeignTraffic,
    HungUp,
    LinkLost,
    NoAnswer,
    NotAsked,
    OtherUnit,
    PortUnusable,
    Unreachable,
)
from openrtu_tools.modbus.fitting import Registers, fitting, sunspec_models
from openrtu_tools.modbus.links import (
    Link,
    RtuLink,
    SerialStream,
    Stream,
    TcpLink,
    frame_at,
    network_link,
    network_name,
    shown,
)
from openrtu_tools.modbus.serial_port import PARITIES, Settings

TIMEOUT_S = 0.5
LISTEN_S = 2.0
REQUEST_CHARACTERS, ASCII_CHARACTERS = 8, 17
TRAFFIC_LEAST = 4  # octets: fewer are noise, as of a transceiver that turns round
LATE_MOST = 3  # units that may still answer
HOSTS_MOST = 4096
FIRST_PORT = 7  # numbers of ports that name their device, or are of TCP
NOT_BEHIND = (10, 11)  # a gateway's exceptions: nobody there
ILLEGAL_FUNCTION = 1
DESCRIPTION_MOST = 39
FUNCTIONS = {number: table for table, number in frames.READ_FUNCTIONS.items()}


@dataclass
class Device:
    """What answered."""

    unit: int
    functions: dict[int, int] = field(default_factory=dict)  # that it knows, of 1 to 4: 0, or its exception
    says: dict[int, str] = field(default_factory=dict)  # of its identification: maker, product, version
    fits: list[Template] | None = None  # None: it was compared with none
    models: list[str] = field(default_factory=list)  # of SunSpec, each with its address
    late: bool = False

    def text(self) -> str:
        parts = [f"knows functions {', '.join(map(str, self.functions))}"] if self.functions else []
        if self.functions and all(self.functions.values()):
            codes = ", ".join(map(str, sorted(set(self.functions.values()))))
            parts.append(f"refuses address 0 of each (exception {codes}), as some servers do of any unit")
        parts += [", ".join(self.identification())] if self.says else []
        parts += self._fitting()
        parts += ["answers late: look at it again with a longer --timeout"] if self.late else []
        return f"unit {self.unit}: {'; '.join(parts) or 'answers'}"

    def identification(self) -> list[str]:
        return [self.says[number] for number in sorted(self.says) if self.says[number]]

    def _fitting(self) -> Iterator[str]:
        if self.models:
            yield f"has SunSpec models: openrtu devices --sunspec {' '.join(self.models)}"
        if self.fits:
            yield f"fits {', '.join(template.name for template in self.fits)}"
        elif self.fits is not None:
            yield "fits no template that says how its device is known"

    def template(self) -> Template | None:
        """The one that fits, where no other does."""
        return self.fits[0] if self.fits and len(self.fits) == 1 else None

    def slave(self, line: int) -> dict[str, Any]:
        name = " ".join(self.identification()[:2]).encode()[:DESCRIPTION_MOST].decode(errors="ignore").strip()
        template = self.template()
        own = {"template": template.name, "name_prefix": f"p{line}.{self.unit}/"} if template else {}
        return {"id": self.unit} | ({"description": name} if name else {}) | own


@dataclass
class Found:
    """A line or a connection with devices: its keys of the configuration, and them."""

    keys: dict[str, Any]
    devices: list[Device] = field(default_factory=list)


class ScanLink(RtuLink):
    """A serial line that is left when somebody else speaks on it."""

    def __init__(self, stream: Stream, timeout_s: float, settings: Settings) -> None:
        super().__init__(stream, timeout_s, settings)
        self.silent: deque[int] = deque(maxlen=LATE_MOST)  # the last units that did not answer
        self.late: list[int] = []

    def overheard(self, octets: bytes) -> None:
        body = frame_at(octets, 0)
        if body and body[0] in self.silent:
            self.late.append(body[0])
        elif len(octets) >= TRAFFIC_LEAST:
            raise ForeignTraffic(f"somebody else speaks on {self.stream.name}: {shown(octets)}")


# ---- what is asked for -----------------------------------------------------------------------------


def numbers(text: str) -> list[int]:
    """`1-10,20`"""
    found: list[int] = []
    for part in text.split(","):
        first, dash, last = part.partition("-")
        if not first.isdigit() or (dash and not last.isdigit()):
            raise argparse.ArgumentTypeError(f'"{text}" is no list as 1-10,20')
        found += range(int(first), int(last or first) + 1)
    if not found or max(found) > arguments.UNIT_LAST:
        raise argparse.ArgumentTypeError(f'"{text}" has no units, or some beyond {arguments.UNIT_LAST}')
    return list(dict.fromkeys(found))


def speeds(text: str) -> list[int]:
    return [arguments.speed(part) for part in text.split(",")]


def parities(text: str) -> list[str]:
    found = text.split(",")
    if not set(found) <= PARITIES.keys():
        raise argparse.ArgumentTypeError(f'"{text}" is no list of {", ".join(PARITIES)}')
    return found


def hosts(text: str) -> list[tuple[str, int]]:
    """HOST, FIRST-LAST or NETWORK/LENGTH, and :PORT behind each. Raises UnusableInput."""
    whole, port = arguments.address(text)
    first, dash, last = whole.partition("-")
    with suppress(ValueError):
        if "/" in whole:
            network = ipaddress.ip_network(whole, strict=False)
            if network.num_addresses > HOSTS_MOST:
                raise UnusableInput(f"{text}: more than {HOSTS_MOST} addresses")
            return [(str(address), port) for address in network.hosts()]
        if dash:
            low = ipaddress.IPv4Address(first)
            high = ipaddress.IPv4Address(last if "." in last else f"{first.rpartition('.')[0]}.{last}")
            if not 0 <= int(high) - int(low) < HOSTS_MOST:
                raise UnusableInput(f"{text}: no range, or more than {HOSTS_MOST} addresses")
            return [(str(low + step), port) for step in range(int(high) - int(low) + 1)]
    if "/" in whole:
        raise UnusableInput(f"{text} is no network as 192.0.2.0/28")
    return [(whole, port)]


def is_serial(where: str) -> bool:
    """A path; 192.0.2.0/28 is none."""
    return where.startswith(("/", "./", "../"))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "where",
        nargs="+",
        help="a serial port, by its path; or HOST, 192.0.2.10-20 or 192.0.2.0/28, with :PORT if not 502",
    )
    parser.add_argument(
        "-u", "--units", type=numbers, required=True, metavar="LIST", help="Modbus addresses, as 1-20,100"
    )
    line = parser.add_argument_group("of serial ports: all of these, until one brings an answer")
    line.add_argument(
        "--baud", type=speeds, default=[arguments.BAUD], metavar="LIST", help=f"speeds [{arguments.BAUD}]"
    )
    line.add_argument(
        "--parity", type=parities, default=[arguments.PARITY], metavar="LIST", help=f"[{arguments.PARITY}]"
    )
    line.add_argument("--data-bits", type=int, choices=(7, 8), help="[8; with --ascii 7]")
    line.add_argument("--stop-bits", type=int, choices=(1, 2), default=1, help="[1]")
    line.add_argument("--ascii", action="store_true", help="Modbus ASCII in place of RTU")
    parser.add_argument("--udp", action="store_true", help="addresses by UDP in place of TCP")
    parser.add_argument(
        "--function",
        type=int,
        choices=sorted(FUNCTIONS),
        default=3,
        help="that asks whether a unit is there [3]",
    )
    parser.add_argument(
        "--timeout",
        type=arguments.ranged(0.01, 60, float),
        default=TIMEOUT_S,
        metavar="S",
        help=f"seconds that an answer may take [{TIMEOUT_S:g}]",
    )
    parser.add_argument(
        "--folder", type=Path, help="where the templates are that may fit [those of this OpenRTU]"
    )


@dataclass
class Plan:
    """All that will be asked."""

    ports: list[str]
    settings: list[Settings]
    hosts: list[tuple[str, int]]
    units: list[int]
    function: int
    timeout_s: float
    ascii: bool = False
    udp: bool = False
    templates: list[Template] = field(default_factory=list)

    def longest_s(self) -> float:
        """If nobody answers."""
        request = ASCII_CHARACTERS if self.ascii else REQUEST_CHARACTERS
        characters = [settings.character_s * request for settings in self.settings]
        a_port = LISTEN_S + sum((self.timeout_s + sent) * len(self.units) for sent in characters)
        a_host = self.timeout_s * (1 + len(self.units))
        return len(self.ports) * a_port + len(self.hosts) * a_host

    def text(self) -> str:
        parts = []
        if self.ports:
            parts.append(f"{_many(len(self.ports), 'port')} with {_many(len(self.settings), 'setting')}")
        if self.hosts:
            parts.append(_many(len(self.hosts), "address", "addresses"))
        longest = round(self.longest_s())
        spans = f"{longest // 3600} h {longest // 60 % 60} min" if longest >= 3600 else f"{longest // 60} min"
        takes = spans if longest >= 3600 else f"{spans} {longest % 60} s"
        return f"{' and '.join(parts)}, {_many(len(self.units), 'unit')} each: takes {takes} at most"


def _many(count: int, one: str, several: str = "") -> str:
    return f"{count} {one if count == 1 else several or one + 's'}"


def plan_of(parsed: argparse.Namespace) -> Plan:
    """Raises UnusableInput."""
    ports = [where for where in parsed.where if is_serial(where)]
    data_bits = arguments.data_bits_of(parsed)
    if parsed.udp and ports:
        raise UnusableInput("--udp: a serial port has no other way")
    if parsed.ascii and len(ports) < len(parsed.where):
        raise UnusableInput("--ascii: a scan of addresses asks by Modbus TCP alone")
    if ports and (0 in parsed.units or max(parsed.units) > arguments.SERIAL_UNIT_LAST):
        raise UnusableInput(f"--units: those of a serial line are 1 to {arguments.SERIAL_UNIT_LAST}")
    return Plan(
        ports,
        [
            Settings(baud, parity, parsed.stop_bits, data_bits)
            for baud, parity in product(parsed.baud, parsed.parity)
        ],
        [host for where in parsed.where if not is_serial(where) for host in hosts(where)],
        parsed.units,
        parsed.function,
        parsed.timeout,
        parsed.ascii,
        parsed.udp,
        templates_of(parsed.folder),
    )


# ---- the scan --------------------------------------------------------------------------------------


def say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


@dataclass
class Scan:
    plan: Plan
    found: list[Found] = field(default_factory=list)
    code: int = 0  # of what could not be asked

    def run(self) -> None:
        for port in self.plan.ports:
            try:
                self._port(port)
            except (ForeignTraffic, LinkLost, PortUnusable) as error:  # the other ports may be well
                self.code = max(self.code, error.exit_code)
                say(f"openrtu scan: {error}")
        for host, port in self.plan.hosts:
            self._host(host, port)

    def _port(self, port: str) -> None:
        stream: Stream = SerialStream(port, self.plan.settings[0])
        if self.plan.ascii:
            stream = AsciiStream(stream)
        with ScanLink(stream, self.plan.timeout_s, self.plan.settings[0]) as link:
            heard = link.listen(LISTEN_S)
            if len(heard) >= TRAFFIC_LEAST:
                raise ForeignTraffic(f"somebody else speaks on {port}: {shown(heard)}")
            for settings in self.plan.settings:
                link.configure(settings)
                if self._line(link, port, settings):
                    return  # a line has one speed

    def _line(self, link: ScanLink, port: str, settings: Settings) -> list[Device]:
        keys = {
            "device": port,
            "baud_rate": settings.baud,
            "data_bits": settings.data_bits,
            "stop_bits": settings.stop_bits,
            "parity": PARITIES[settings.parity],
        } | ({"framing": "ascii"} if self.plan.ascii else {})
        place = Found(keys)
        name = f"{port}, {settings}{' ASCII' if self.plan.ascii else ''}"
        link.silent.clear()
        for unit in self._counted(name):
            self._unit(link, place, name, unit)
            self._late(link, place, name)
        link.overheard(link.listen(self.plan.timeout_s))
        self._late(link, place, name)
        return place.devices

    def _host(self, host: str, port: int) -> None:
        name = network_name(host, port, self.plan.udp)
        place: Found | None = None
        link: TcpLink | None = None
        for unit in self._counted(name):
            try:
                link = link or network_link(host, port, self.plan.timeout_s, self.plan.udp)
                place = place or Found(self._keys(link, port))
                self._unit(link, place, name, unit)
            except HungUp:  # as some do on a unit that they do not know
                assert link
                link.stream.close()
                link = None
            except (Unreachable, LinkLost, Damaged) as error:
                if len(self.plan.hosts) == 1 or isinstance(error, Damaged):
                    say(error.what)
                break
        if link:
            link.stream.close()

    def _keys(self, link: TcpLink, port: int) -> dict[str, Any]:
        """What the configuration would have of it."""
        transport = {"transport": "udp"} if self.plan.udp else {}
        return {"host": link.stream.address, "tcp_port": port} | transport

    def _counted(self, name: str) -> Iterator[int]:
        """The units; a terminal sees where the scan is."""
        terminal = sys.stderr.isatty()
        if not terminal:
            say(name)
        for number, unit in enumerate(self.plan.units, 1):
            if terminal:
                count = sum(len(place.devices) for place in self.found)
                print(
                    f"\r{name}: unit {unit}, {number} of {len(self.plan.units)}, {count} found\x1b[K",
                    end="", file=sys.stderr, flush=True,
                )  # fmt: skip
            yield unit
        if terminal:
            print("\r\x1b[K", end="", file=sys.stderr, flush=True)

    def _unit(self, link: Link, place: Found, name: str, unit: int) -> None:
        try:
            link.ask(frames.read(unit, FUNCTIONS[self.plan.function], 0, 1))
        except Exceptional as error:
            if error.code in NOT_BEHIND:
                return
        except NoAnswer:
            if isinstance(link, ScanLink):
                link.silent.append(unit)
            return
        except NotAsked as error:
            self._another(link, error, place, name, unit)
            return
        except Damaged as error:
            if isinstance(link, TcpLink):
                raise
            say(f"\r{name}: {error.what}; {error.cause}")
            return
        self._look(link, place, name, unit)

    def _look(self, link: Link, place: Found, name: str, unit: int) -> None:
        device = looked_at(link, unit)
        registers = Registers(link, unit, list(device.functions))
        try:
            if self.plan.templates:
                device.fits = fitting(self.plan.templates, device.says, registers)
                device.models = known_models(self.plan.templates, registers)
        finally:  # it is there, whatever these reads did to the line
            if registers.silent and isinstance(link, ScanLink):
                link.silent.append(unit)
            self._add(place, name, device)

    def _another(self, link: Link, error: NotAsked, place: Found, name: str, unit: int) -> None:
        """Somebody else answered: one that was asked before, and is slow; on TCP, one with its own unit."""
        other = error.unit if isinstance(error, OtherUnit) else None
        if isinstance(link, ScanLink):
            if other not in link.silent:
                raise ForeignTraffic(error.what) from error
            link.late.append(other)
            self._unit(link, place, name, unit)
        elif other is not None and all(device.unit != other for device in place.devices):
            self._look(link, place, name, other)

    def _late(self, link: ScanLink, place: Found, name: str) -> None:
        while link.late:
            unit = link.late.pop()
            if all(device.unit != unit for device in place.devices):
                self._add(place, name, Device(unit, late=True))

    def _add(self, place: Found, name: str, device: Device) -> None:
        if not place.devices:
            self.found.append(place)
        place.devices.append(device)
        say(f"{chr(13) if sys.stderr.isatty() else ''}{name}, {device.text()}")


def looked_at(link: Link, unit: int) -> Device:
    """What a unit that is there says of itself."""
    found = {number: _refusal(link, unit, FUNCTIONS[number]) for number in sorted(FUNCTIONS)}
    known = {number: code for number, code in found.items() if code is not None}
    return Device(unit, known, _identification(link, unit))


def _refusal(link: Link, unit: int, table: str) -> int | None:
    """0: it gives address 0; None: it does not know the function; else its exception."""
    try:
        link.ask(frames.read(unit, table, 0, 1))
    except Exceptional as error:
        return None if error.code == ILLEGAL_FUNCTION else error.code
    except (NoAnswer, Damaged, NotAsked):
        return None
    return 0


def known_models(templates: Sequence[Template], registers: Registers) -> list[str]:
    """As `openrtu devices --sunspec` takes them."""
    known = {template.about.get("model") for template in templates}
    return [f"{model}@{address}" for model, address in sunspec_models(registers) if model in known]


def _identification(link: Link, unit: int) -> dict[int, str]:
    """Few devices have one: what is wrong with it is no matter."""
    texts: dict[int, str] = {}
    first = 0
    with suppress(Exceptional, NoAnswer, Damaged, NotAsked):
        while True:
            pdu = link.ask(frames.identify(unit, first))
            texts |= dict(frames.objects_of(pdu))
            if pdu[frames.MORE_AT] != frames.MORE_FOLLOWS or pdu[frames.MORE_AT + 1] <= first:
                break
            first = pdu[frames.MORE_AT + 1]
    return texts


def configuration(found: Sequence[Found]) -> dict[str, Any]:
    ports = []
    for number, place in enumerate(found, FIRST_PORT):
        slaves = [device.slave(number) for device in sorted(place.devices, key=lambda device: device.unit)]
        ports.append({"value": number, "active": 1, **place.keys, "slaves": slaves})
    templates = [device.template() for place in found for device in place.devices]
    files = sorted({str(template.file) for template in templates if template})
    return ({"include": files} if files else {}) | {"port": ports}


def templates_of(folder: Path | None) -> list[Template]:
    """What devices are compared with: none where the gateway is not installed. Raises UnusableInput."""
    if folder:
        return devices.read(folder)
    try:
        return devices.read(devices.folder())
    except UnusableInput as error:
        say(f"openrtu scan: looks for no template that fits: {error}")
        return []


def run(parsed: argparse.Namespace) -> int:
    plan = plan_of(parsed)
    say(plan.text())
    scan = Scan(plan)
    try:
        scan.run()
    except KeyboardInterrupt:
        say("interrupted")
    if scan.found:
        json.dump(configuration(scan.found), sys.stdout, indent=2, ensure_ascii=False)
        print()
    else:
        say("nothing answered")
    return scan.code or (0 if scan.found else 1)
