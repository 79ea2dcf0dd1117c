# SPDX-License-Identifier: GPL-3.0-or-later
"""`nuc980-netboot boot` on the emulated board in a network of its own: TFTP at port 69, as on a desk."""

import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator
from ipaddress import IPv4Address, IPv4Interface
from pathlib import Path

import pytest

from netboot.emulated import Emulated
from nuc980.twin import network
from nuc980.twin.network import BoardNetwork, NotAllowedError, PrivateNetwork, board_network

pytestmark = pytest.mark.slow

# The report's.
BOARD, SERVER = IPv4Interface("172.16.0.50/12"), IPv4Address("172.16.0.1")


@pytest.fixture
def its_network() -> Iterator[BoardNetwork]:
    with board_network(BOARD, SERVER) as found:
        yield found


@pytest.fixture
def behind_nat(monkeypatch: pytest.MonkeyPatch) -> Iterator[BoardNetwork]:
    """What a host has that allows no other."""

    def refuse() -> PrivateNetwork:
        raise NotAllowedError("unshare: Operation not permitted")

    monkeypatch.setattr(network, "PrivateNetwork", refuse)
    with board_network(BOARD, SERVER) as found:
        yield found


@pytest.mark.parametrize("kind", ["its_network", "behind_nat"])
def test_board_boots(
    kind: str,
    request: pytest.FixtureRequest,
    emulated: Callable[..., Emulated],
    qemu: Path,
    uboot: Path,
    payload: Path,
    dtb: Path,
    tmp_path: Path,
) -> None:
    found: BoardNetwork = request.getfixturevalue(kind)
    if kind == "its_network" and not found.prefix:
        warnings.warn(found.told, stacklevel=1)
        pytest.skip(found.told)
    twin = emulated(*found.prefix, qemu, "-M", "nuc980", "-bios", uboot, "-nic", found.nic, "-nic", "user")
    twin.prefix = found.prefix
    site = ("--site", tmp_path / "site")
    power = ("--power-cycle", twin.power_cycle)
    done = twin.netboot("boot", payload / "uImage", dtb, *power, *found.netboot, *site)
    assert done.returncode == 0, done.stdout
    assert ("tftpdstp" in done.stdout) == (kind == "behind_nat")


def test_network_is_its_own_and_ends() -> None:
    """What runs in it sees no interface but lo, and the host sees nothing of it."""
    try:
        private = PrivateNetwork()
    except NotAllowedError as error:
        pytest.skip(f"NOT TESTED: this host allows no network of one's own: {error}")
    with private:
        private.run("ip address add 172.16.0.1/32 dev lo")
        names = "import socket; print([name for _, name in socket.if_nameindex()])"
        inside = subprocess.run(
            [*private.prefix, sys.executable, "-c", names], check=True, capture_output=True, text=True
        )
        assert inside.stdout == "['lo']\n"
        here = subprocess.run(
            ["ip", "address", "show", "dev", "lo"], check=True, capture_output=True, text=True
        )
        assert "172.16.0.1" not in here.stdout
    gone = subprocess.run([*private.prefix, "true"], capture_output=True)
    assert gone.returncode != 0


def test_refusal_is_told_loudly(behind_nat: BoardNetwork) -> None:
    assert behind_nat.prefix == ()
    assert behind_nat.told.startswith("NOT AS BESIDE A REAL BOARD")
    assert "Operation not permitted" in behind_nat.told
