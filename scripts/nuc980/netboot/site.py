# SPDX-License-Identifier: GPL-3.0-or-later
"""The folder of a board's site: its MAC addresses, its IP address, its saved environment, its backups."""

from __future__ import annotations

import os
import random
import re
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import suppress
from ipaddress import AddressValueError, IPv4Interface, NetmaskValueError
from pathlib import Path

from nuc980.netboot.errors import UnusableInput

MAC = re.compile(r"[0-9a-f]{2}(:[0-9a-f]{2}){5}")
# Of every board whose kernel or U-Boot was not told another: the vendor compiles them in.
EVERYBODYS = ("08:00:27:00:01:92", "08:00:27:00:01:93", "00:00:00:11:66:88")
PORTS = ("eth0", "eth1")
UBOOT_NAMES = {"eth0": "ethaddr", "eth1": "eth1addr"}


class Site:
    """A folder, made when something is to be kept in it. The same as SITE= of `make image-buildroot`.

    dry: nothing is to be kept.
    """

    def __init__(self, folder: Path, *, dry: bool = False) -> None:
        self.folder, self.dry = folder, dry

    def macs(self, environment: Mapping[str, str]) -> tuple[str, str]:
        """The board's own two addresses, from the file `macs`: lines "eth0 XX:XX:XX:XX:XX:XX" and "eth1 …".

        Without the file it is written, once: with the addresses that U-Boot's environment has, else with new
        ones. Raises UnusableInput for addresses that no two boards may have.
        """
        path = self.folder / "macs"
        text = ""
        if not path.exists():
            text = "".join(f"{port} {mac}\n" for port, mac in _new_macs(environment))
            if not self.dry:
                self._write_once(path, text)
        if path.exists():
            text = path.read_text(encoding="utf-8", errors="replace")
        eth0, eth1 = (_mac_of(port, text, path) for port in PORTS)
        if eth0 == eth1:
            raise UnusableInput(
                f"{path} gives both ports {eth0}.", next_step="give each port its own address"
            )
        return eth0, eth1

    def board_ip(self) -> IPv4Interface | None:
        """The address in the file `board-ip`: ADDRESS/PREFIX. None when there is no such file."""
        path = self.folder / "board-ip"
        if not path.exists():
            return None
        text = path.read_text(encoding="utf-8", errors="replace").strip()
        try:
            return with_prefix(text)
        except ValueError as error:
            raise UnusableInput(f"{path}: {error}") from error

    def _write_once(self, path: Path, text: str) -> None:
        """Whole or not at all; the one who comes second finds the file of the first."""
        self.folder.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile("w", dir=self.folder, prefix=".macs") as file:
            file.write(text)
            file.flush()
            with suppress(FileExistsError):
                os.link(file.name, path)
                path.chmod(0o644)


def with_prefix(text: str) -> IPv4Interface:
    """ADDRESS/PREFIX, of a host. Raises ValueError, whose text a user can read."""
    try:
        address = IPv4Interface(text)
    except (AddressValueError, NetmaskValueError) as error:
        raise ValueError(f"{text!r} is not an IPv4 address with its prefix, as 192.168.1.20/24") from error
    if "/" not in text:
        raise ValueError(f"{text!r} lacks its network's prefix, as in {text}/24")
    network = address.network
    if network.prefixlen < 31 and address.ip in (network.network_address, network.broadcast_address):
        raise ValueError(f"{text!r} is the address of a network, not of a board")
    if address.ip.is_multicast or address.ip.is_unspecified or address.ip.is_loopback:
        raise ValueError(f"{text!r} is not an address for a board")
    return address


def why_not_unique(mac: str) -> str:
    """Why an address cannot be one board's own, or an empty text. mac: lower case."""
    if not MAC.fullmatch(mac):
        return "is not a MAC address, XX:XX:XX:XX:XX:XX"
    if int(mac[:2], 16) & 1:
        return "is a group's address: the first byte is odd"
    if mac == "00:00:00:00:00:00":
        return "is not an address"
    if mac in EVERYBODYS:
        return "is the address of every board that was given none"
    return ""


def _mac_of(port: str, text: str, path: Path) -> str:
    found = re.findall(rf"^{port}[ \t]+(.*?)[ \t\r]*$", text, re.MULTILINE)
    if len(found) != 1:
        raise UnusableInput(
            f"{path} has {len(found)} lines for {port}; expected one, '{port} XX:XX:XX:XX:XX:XX'."
        )
    mac = found[0].lower()
    if why := why_not_unique(mac):
        raise UnusableInput(
            f"{path}: {port}'s {found[0]!r} {why}.",
            next_step="enter the board's own address, or remove the file: the tool then writes a new one",
        )
    return mac


def _new_macs(environment: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    taken: set[str] = set()
    for port in PORTS:
        known = environment.get(UBOOT_NAMES[port], "").lower()
        mac = _local_address() if why_not_unique(known) or known in taken else known
        taken.add(mac)
        yield port, mac


def _local_address() -> str:
    """A random unicast address, locally administered (IEEE 802, 0x02 of the first byte)."""
    first, *rest = random.SystemRandom().randbytes(6)
    return ":".join(f"{byte:02x}" for byte in (first & 0xFC | 0x02, *rest))
