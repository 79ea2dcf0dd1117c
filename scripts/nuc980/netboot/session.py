# SPDX-License-Identifier: GPL-3.0-or-later
"""What the steps of a plan run on: a board at its prompt, and how board and host reach each other."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from ipaddress import IPv4Address, IPv4Interface

from nuc980.netboot import host
from nuc980.netboot.console import Console
from nuc980.netboot.errors import HostAmbiguous, NoHostAddress, UnusableInput
from nuc980.netboot.linux import LinuxWatch
from nuc980.netboot.progress import Progress
from nuc980.netboot.site import Site, with_prefix
from nuc980.netboot.tftp import FileService

TFTP_PORT = 69


@dataclass(frozen=True)
class Network:
    """How board and host reach each other.

    board, server: the addresses as the board has and sees them; device: U-Boot's name of the port to use
    (ethact), None for the one it takes itself. listen and seen_as differ from server and board when a NAT is
    between them, as in QEMU's user network. port: UDP; another than 69 needs a U-Boot with CONFIG_TFTP_PORT.
    """

    board: IPv4Interface
    server: IPv4Address
    port: int = TFTP_PORT
    device: str | None = None
    listen: IPv4Address | None = None
    seen_as: IPv4Address | None = None

    def __str__(self) -> str:
        """Who serves whom, and what else this host could be to the board."""
        here = self.listen or self.server
        found = host.addresses()
        which = next((f" ({each.interface})" for each in found if each.address == here), "")
        others = [each for each in host.near(self.board.ip, found) if each.address != self.server]
        choice = f"; --server-ip chooses another: {', '.join(map(str, others))}" if others else ""
        seen = self.seen_as or self.board.ip
        return f"files by TFTP at UDP port {self.port} of {here}{which}, to {seen} alone{choice}"

    def service(self) -> FileService:
        """The TFTP server for this board alone."""
        return FileService(str(self.listen or self.server), self.port, str(self.seen_as or self.board.ip))


def board_address(given: IPv4Interface | None, site: Site, environment: Mapping[str, str]) -> IPv4Interface:
    """The board's address: as given, else the site's (`board-ip`), else U-Boot's. Raises UnusableInput."""
    known = given or site.board_ip()
    if known:
        return known
    try:
        return with_prefix(f"{environment['ipaddr']}/{environment['netmask']}")
    except KeyError:
        raise UnusableInput(
            "The board needs an IP address; its U-Boot has none.",
            next_step=f"--board-ip ADDRESS/PREFIX, or write it into {site.folder / 'board-ip'}",
        ) from None
    except ValueError as error:
        raise UnusableInput(f"U-Boot's ipaddr and netmask: {error}", next_step="give --board-ip") from error


def server_address(board: IPv4Interface) -> IPv4Address:
    """The host's address in the board's network. Raises NoHostAddress, HostAmbiguous: they say what to do."""
    addresses = host.addresses()
    found = host.near(board.ip, addresses)
    if not found:
        raise NoHostAddress(
            f"The board will be {board}, and this host has no address that it can reach.",
            next_step=host.advice(board.ip, addresses),
        )
    if others := host.rivals(found[0], found):
        which = ", ".join(map(str, (found[0], *others)))
        raise HostAmbiguous(f"The board will be {board}, and this host has {which}.")
    return found[0].address


@dataclass
class Session:
    """A board at U-Boot's prompt; a server for its files, when a plan needs one; in the end its Linux."""

    console: Console
    progress: Progress
    network: Network | None = None
    files: FileService | None = None  # both from serving() on
    linux: LinuxWatch | None = None  # from bootm on

    @contextmanager
    def serving(self, network: Network) -> Iterator[None]:
        """With a server for the board's files. Raises TftpError."""
        self.network = network
        self.progress.note(f"Serve {network}.")
        with network.service() as self.files:
            yield
