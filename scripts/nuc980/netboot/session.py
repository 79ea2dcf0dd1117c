# SPDX-License-Identifier: GPL-3.0-or-later
"""What the steps of a plan run on: a board at its prompt, and how board and host reach each other."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from ipaddress import IPv4Address, IPv4Interface

from nuc980.netboot import host
from nuc980.netboot.console import Console
from nuc980.netboot.errors import NoHostAddress, UnusableInput
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
    """The host's address in the board's network. Raises NoHostAddress, which says what to do."""
    addresses = host.addresses()
    found = host.towards(board.ip, addresses)
    if found is None:
        raise NoHostAddress(
            f"The board will be {board}, and this host has no address that it can reach.",
            next_step=host.advice(board.ip, addresses),
        )
    return found.address


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
        with network.service() as self.files:
            yield
