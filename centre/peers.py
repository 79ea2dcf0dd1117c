# SPDX-License-Identifier: GPL-3.0-or-later
"""Where a request comes from: the peer, or whom a proxy that the file trusts has forwarded."""

from __future__ import annotations

from collections.abc import Iterable
from ipaddress import IPv4Address, IPv4Network, IPv6Address, IPv6Network, ip_address, ip_network

Address = IPv4Address | IPv6Address
Network = IPv4Network | IPv6Network
OF_ONE_HOST = 64  # whoever has an address of IPv6 has so many bits to choose from


def read(text: str) -> Address | None:
    """
    >>> read("::ffff:192.0.2.1"), read("fe80::1%eth0"), read("unknown")
    (IPv4Address('192.0.2.1'), IPv6Address('fe80::1'), None)
    """
    try:
        address = ip_address(text.strip().strip("[]").partition("%")[0])
    except ValueError:
        return None
    return getattr(address, "ipv4_mapped", None) or address


def source(peer: str, forwarded: Iterable[str], proxies: tuple[Network, ...]) -> str:
    """The last one in X-Forwarded-For that no trusted proxy is: what stands before it anybody can write.

    >>> proxies = (ip_network("127.0.0.1"), ip_network("10.0.0.0/8"))
    >>> source("127.0.0.1", ["198.51.100.9, 203.0.113.5", "10.0.0.7"], proxies)
    '203.0.113.5'
    >>> source("192.0.2.1", ["203.0.113.5"], proxies), source("127.0.0.1", ["nonsense"], proxies)
    ('192.0.2.1', '127.0.0.1')
    """
    found = read(peer)
    hops = [hop for line in forwarded for hop in line.split(",")]
    while found and is_in(found, proxies) and hops:
        before = read(hops.pop())
        if before is None:
            break
        found = before
    return str(found or peer)


def is_in(address: Address, networks: tuple[Network, ...]) -> bool:
    return any(address.version == network.version and address in network for network in networks)


def host(address: str) -> str:
    """What one host can be counted by.

    >>> host("192.0.2.1"), host("2001:db8::1:2:3:4")
    ('192.0.2.1', '2001:db8::/64')
    """
    found = read(address)
    if isinstance(found, IPv6Address):
        return str(ip_network((found, OF_ONE_HOST), strict=False))
    return str(found or address)
