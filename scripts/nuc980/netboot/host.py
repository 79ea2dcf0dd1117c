# SPDX-License-Identifier: GPL-3.0-or-later
"""The host's own IPv4 addresses: which a board can reach, what a person must do when none is; its load."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from ipaddress import IPv4Address, IPv4Interface, IPv4Network

import psutil

USUAL_PREFIX = 24  # of a service bench; U-Boot does without a netmask
NO_ADDRESS = IPv4Interface("0.0.0.0/32")


@dataclass(frozen=True)
class HostAddress:
    """An interface with one of its addresses; one without any has 0.0.0.0/32.

    up: it is switched on, and has a link.
    """

    interface: str
    address: IPv4Address
    prefix: int
    up: bool

    @property
    def network(self) -> IPv4Network:
        return IPv4Network((self.address, self.prefix), strict=False)

    def __str__(self) -> str:
        return f"{self.address}/{self.prefix} ({self.interface}{'' if self.up else ', down'})"


def addresses() -> tuple[HostAddress, ...]:
    """Of all interfaces, also of those that are down or have no address yet."""
    states = psutil.net_if_stats()
    return tuple(
        HostAddress(interface, found.ip, found.network.prefixlen, states[interface].isup)
        for interface, entries in sorted(psutil.net_if_addrs().items())
        if interface in states  # or it has gone meanwhile
        for found in list(_ipv4(entries)) or [NO_ADDRESS]
    )


def _ipv4(entries: Sequence[psutil._common.snicaddr]) -> Iterator[IPv4Interface]:
    for entry in entries:
        if entry.family == socket.AF_INET:
            yield IPv4Interface((entry.address, entry.netmask or "255.255.255.255"))


def near(board: IPv4Address, addresses: Sequence[HostAddress]) -> list[HostAddress]:
    """The host's addresses in the board's network: those that are up first, then by the smallest network."""
    fitting = [host for host in addresses if board in host.network and board != host.address]
    return sorted(fitting, key=lambda host: (not host.up, -host.prefix))


def rivals(chosen: HostAddress, near: Sequence[HostAddress]) -> list[HostAddress]:
    """Those of another interface that may lead to the board as well.

    A link decides nothing: a board at the other end of a cable gives none before its U-Boot wakes its PHY.
    A smaller network does: this host's answers go there.
    """
    return [host for host in near if host.interface != chosen.interface and host.prefix == chosen.prefix]


def advice(board: IPv4Address, addresses: Sequence[HostAddress]) -> str:
    """What a person must do so that the board reaches this host, in one or two sentences."""
    wired = [host for host in addresses if not host.address.is_loopback]
    if twin := next((host for host in wired if host.address == board), None):
        return f"{board} is this host's own address ({twin.interface}): give the board another one."
    found = near(board, addresses)
    if not found:
        return f"{_networks(board, wired)} {_new_address(board, wired)}"
    host = found[0]
    if host.up:
        return (
            f"{host.interface} ({host.address}/{host.prefix}) is in the board's network: the cable must lead"
            " there, and a firewall must let the board's UDP in."
        )
    return (
        f"{host.interface} ({host.address}/{host.prefix}) is in the board's network and is down:"
        f" plug the cable in, or sudo ip link set {host.interface} up."
    )


def _networks(board: IPv4Address, wired: Sequence[HostAddress]) -> str:
    has = ", ".join(str(host) for host in wired if not host.address.is_unspecified)
    return f"No address of this host is in the network of {board}; it has {has or 'none'}."


def _new_address(board: IPv4Address, wired: Sequence[HostAddress]) -> str:
    network = IPv4Network((board, USUAL_PREFIX), strict=False)
    free = next(address for address in network.hosts() if address != board)
    idle = [host for host in wired if host.address.is_unspecified]
    only = idle[0].interface if len(idle) == 1 else "INTERFACE"
    names = ", ".join(f"{host.interface}{'' if host.up else ' (down)'}" for host in idle)
    which = f" (without an address: {names})" if len(idle) > 1 else ""
    return (
        f"Give one to the interface with the board's cable{which}:"
        f" sudo ip address add {free}/{USUAL_PREFIX} dev {only}"
    )


BUSY = 4.0  # processes that share a processor


def busy() -> str:
    """What is to be said of a load that a slow answer may come from, or an empty text."""
    load, processors = os.getloadavg()[0], os.cpu_count() or 1
    if load < BUSY * processors:
        return ""
    return f"this host is busy (load {load:.0f} on {processors} processors), and serves the line late"
