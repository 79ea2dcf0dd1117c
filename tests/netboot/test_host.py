# SPDX-License-Identifier: GPL-3.0-or-later
"""Which of the host's addresses a board can reach, and what a person is told when none is."""

import socket
from ipaddress import IPv4Address

import pytest

from nuc980.netboot.host import HostAddress, addresses, advice, near, rivals

BOARD = IPv4Address("192.168.1.50")


def host(interface: str, address: str = "0.0.0.0/32", up: bool = True) -> HostAddress:
    number, prefix = address.split("/")
    return HostAddress(interface, IPv4Address(number), int(prefix), up)


LO = host("lo", "127.0.0.1/8")
OFFICE = host("eth0", "10.1.2.3/16")
BENCH = host("eth1", "192.168.1.10/24")
IDLE = host("eth2")


@pytest.mark.parametrize(
    ("found", "expected"),
    [
        ([], None),
        ([LO, OFFICE, IDLE], None),
        ([LO, OFFICE, BENCH], BENCH),
        ([host("wide", "192.168.0.1/16"), BENCH], BENCH),
        ([BENCH, host("wide", "192.168.0.1/16")], BENCH),
        ([host("eth1", "192.168.1.10/24", up=False), host("wide", "192.168.0.1/16")],
         host("wide", "192.168.0.1/16")),
        ([host("eth1", "192.168.1.10/24", up=False)], host("eth1", "192.168.1.10/24", up=False)),
        ([host("eth1", "192.168.1.50/24")], None),  # the board's own
        ([host("tunnel", "192.168.1.49/32")], None),
        ([host("all", "192.168.1.1/0")], host("all", "192.168.1.1/0")),
    ],
)  # fmt: skip
def test_near(found: list[HostAddress], expected: HostAddress | None) -> None:
    assert next(iter(near(BOARD, found)), None) == expected


def test_near_a_board_on_this_host() -> None:
    """An emulated one behind a NAT."""
    assert near(IPv4Address("127.0.0.9"), [OFFICE, LO]) == [LO]


@pytest.mark.parametrize(
    ("other", "rival"),
    [
        (host("eth2", "192.168.1.11/24"), True),
        (host("eth2", "192.168.1.11/24", up=False), True),  # a board at its cable is silent still
        (host("eth1", "192.168.1.11/24"), False),  # the same wire
        (host("wide", "192.168.0.1/16"), False),  # answers go to the smaller network
        (OFFICE, False),
    ],
)
def test_rivals(other: HostAddress, rival: bool) -> None:
    found = near(BOARD, [BENCH, other])
    assert found[0] == BENCH
    assert rivals(BENCH, found) == ([other] if rival else [])


@pytest.mark.parametrize(
    ("found", "parts"),
    [
        ([LO, OFFICE, BENCH], ["eth1 (192.168.1.10/24) is in the board's network", "cable", "firewall"]),
        ([LO, host("eth1", "192.168.1.10/24", up=False)], ["is down", "sudo ip link set eth1 up"]),
        ([LO, host("eth1", "192.168.1.50/24")], ["192.168.1.50 is this host's own address (eth1)"]),
        ([LO, OFFICE], ["it has 10.1.2.3/16 (eth0)", "192.168.1.1/24 dev INTERFACE"]),
        ([LO, OFFICE, IDLE], ["it has 10.1.2.3/16 (eth0)", "sudo ip address add 192.168.1.1/24 dev eth2"]),
        ([LO, host("eth0", "10.1.2.3/16", up=False), IDLE], ["it has 10.1.2.3/16 (eth0, down)"]),
        ([IDLE, host("eth3", up=False)], ["it has none", "eth2, eth3 (down)", "dev INTERFACE"]),
        ([], ["it has none", "dev INTERFACE"]),
    ],
)
def test_advice(found: list[HostAddress], parts: list[str]) -> None:
    text = advice(BOARD, found)
    assert [part for part in parts if part not in text] == []
    assert "127.0.0.1" not in text
    assert "0.0.0.0" not in text


def test_advised_address_is_not_the_boards() -> None:
    assert "192.168.1.2/24" in advice(IPv4Address("192.168.1.1"), [IDLE])


def test_this_host() -> None:
    found = addresses()
    assert HostAddress("lo", IPv4Address("127.0.0.1"), 8, True) in found
    assert {entry.interface for entry in found} == {name for _, name in socket.if_nameindex()}
    for entry in found:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind((str(entry.address), 0))  # else it is not this host's
