# SPDX-License-Identifier: GPL-3.0-or-later
"""How the emulated board reaches a TFTP server of this host.

Where this host allows an unprivileged user a network of their own, the server is at port 69 of an address in
the board's subnet, as it is beside a real board. Else it is behind QEMU's NAT, at another port, which our
U-Boot takes as tftpdstp: port 69 would be QEMU's own.
"""

from __future__ import annotations

import shlex
import socket
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from ipaddress import IPv4Address, IPv4Interface
from types import TracebackType
from typing import Self

TFTP_PORT = 69
LOCALHOST = IPv4Address("127.0.0.1")


class NotAllowedError(Exception):
    """This host gives its user no network of their own; the text is the reason."""


class PrivateNetwork:
    """A user and a network name space, from `with` to its end; without an interface but lo.

    prefix: before a command, runs it there.
    """

    def __init__(self) -> None:
        self._holder = subprocess.Popen(
            ["unshare", "--user", "--map-root-user", "--net", "sh", "-c",
             "ip link set lo up && echo up && exec cat"],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        assert self._holder.stdout is not None
        if self._holder.stdout.readline() != "up\n":
            raise NotAllowedError(self._holder.communicate()[1].strip())
        self.prefix = ("nsenter", "-t", str(self._holder.pid), "-U", "-n", "--preserve-credentials")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._holder.communicate()

    def run(self, command: str) -> None:
        """Runs one there; raises CalledProcessError."""
        subprocess.run([*self.prefix, *shlex.split(command)], check=True, capture_output=True, text=True)


@dataclass(frozen=True)
class BoardNetwork:
    """The network at one port of the board, and a host in it.

    prefix: before the commands of QEMU and of nuc980-netboot. nic: QEMU's -nic. netboot: nuc980-netboot's
    options. told: which of the two it is, for who looks on.
    """

    prefix: tuple[str, ...]
    nic: str
    netboot: tuple[str, ...]
    told: str


@contextmanager
def board_network(board: IPv4Interface, server: IPv4Address) -> Iterator[BoardNetwork]:
    """The best that this host allows. Both are addresses of one subnet, the board's and the server's."""
    try:
        private = PrivateNetwork()
    except NotAllowedError as error:
        yield _behind_nat(board, server, str(error))
        return
    with private:
        private.run(f"ip address add {server}/32 dev lo")
        yield _private(board, server, private.prefix)


def _private(board: IPv4Interface, server: IPv4Address, prefix: tuple[str, ...]) -> BoardNetwork:
    """QEMU's own two hosts get unused addresses; the forward only makes it answer ARP for the server."""
    gateway, names = _unused(board, server)
    return BoardNetwork(
        prefix,
        f"user,net={board.network},host={gateway},dns={names},guestfwd=tcp:{server}:9-cmd:true",
        _netboot(board, server, server),
        f"TFTP at {server}, port {TFTP_PORT}, in a network of its own",
    )


def _behind_nat(board: IPv4Interface, server: IPv4Address, why: str) -> BoardNetwork:
    port = free_udp_port()
    return BoardNetwork(
        (),
        f"user,net={board.network},host={server}",
        (*_netboot(board, server, LOCALHOST), "--tftp-port", str(port)),
        f"NOT AS BESIDE A REAL BOARD: TFTP at port {port} (tftpdstp) behind QEMU's NAT, because this host"
        f" allows no network of one's own: {why}",
    )


def _netboot(board: IPv4Interface, server: IPv4Address, here: IPv4Address) -> tuple[str, ...]:
    """Its options; here: the address at which its server listens, and sees the board."""
    words = {"board-ip": board, "server-ip": server, "listen": here, "seen-as": here}
    return tuple(part for name, value in words.items() for part in (f"--{name}", str(value)))


def _unused(board: IPv4Interface, server: IPv4Address) -> list[IPv4Address]:
    """Two addresses of the subnet; from its end, as QEMU's DHCP has those from 15 on."""
    last = int(board.network.broadcast_address) - 1
    candidates = (IPv4Address(last - n) for n in range(4))
    return [address for address in candidates if address not in (board.ip, server)][:2]


def free_udp_port() -> int:
    """One of this host's that nobody has."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind((str(LOCALHOST), 0))
        return taken.getsockname()[1]
