# SPDX-License-Identifier: GPL-3.0-or-later
"""What the steps of a plan run on."""

from __future__ import annotations

from dataclasses import dataclass
from ipaddress import IPv4Address, IPv4Interface

from nuc980.netboot.console import Console
from nuc980.netboot.progress import Progress
from nuc980.netboot.tftp import FileService


@dataclass(frozen=True)
class Network:
    """How board and host reach each other.

    board, server: the addresses as the board has and sees them; device: U-Boot's name of the port to use
    (ethact), None for the one it takes itself. listen and seen_as differ from server and board when a NAT is
    between them, as in QEMU's user network. port: UDP; another than 69 needs a U-Boot with CONFIG_TFTP_PORT.
    """

    board: IPv4Interface
    server: IPv4Address
    port: int = 69
    device: str | None = None
    listen: IPv4Address | None = None
    seen_as: IPv4Address | None = None

    def service(self) -> FileService:
        """The TFTP server for this board alone."""
        return FileService(str(self.listen or self.server), self.port, str(self.seen_as or self.board.ip))


@dataclass
class Session:
    """A board at U-Boot's prompt, with a server for its files while a plan needs one."""

    console: Console
    progress: Progress
    files: FileService | None = None  # runs while the session does; None: nothing to load is planned
