# SPDX-License-Identifier: GPL-3.0-or-later
"""The folder of a board's site: whose addresses a board gets, and which are refused."""

import os
import re
import subprocess
from concurrent.futures import ThreadPoolExecutor
from ipaddress import IPv4Interface
from pathlib import Path
from threading import Barrier

import libfdt
import pytest

from nuc980.netboot import site as site_module
from nuc980.netboot.errors import UnusableInput
from nuc980.netboot.site import Site, with_prefix

ROOT = Path(__file__).parents[2]
GOOD = "eth0 02:00:00:00:00:01\neth1 02:00:00:00:00:02\n"


@pytest.fixture
def site(tmp_path: Path) -> Site:
    return Site(tmp_path / "site")


def write(site: Site, text: str, name: str = "macs") -> None:
    site.folder.mkdir(exist_ok=True)
    (site.folder / name).write_text(text)


def test_addresses_are_made_once(site: Site) -> None:
    first = site.macs({})
    assert site.macs({}) == first
    assert Site(site.folder).macs({"ethaddr": "02:00:00:00:00:99"}) == first
    assert first[0] != first[1]
    for mac in first:
        assert int(mac[:2], 16) & 3 == 2  # one board's, locally administered


def test_addresses_of_two_sites_differ(tmp_path: Path) -> None:
    assert not set(Site(tmp_path / "a").macs({})) & set(Site(tmp_path / "b").macs({}))


def test_all_who_come_at_once_get_the_same(site: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each has seen that there is no file, and made up addresses of its own, before the first one writes."""
    together = Barrier(8)
    made_up = site_module._local_address
    monkeypatch.setattr(site_module, "_local_address", lambda: (together.wait(), made_up())[1])
    with ThreadPoolExecutor(8) as pool:
        assert len(set(pool.map(lambda _: site.macs({}), range(8)))) == 1
    assert [path.name for path in site.folder.iterdir()] == ["macs"]


def test_the_boards_own_address_stays(site: Site) -> None:
    eth0, eth1 = site.macs({"ethaddr": "00:11:22:AA:BB:CC"})
    assert eth0 == "00:11:22:aa:bb:cc"
    assert eth1 != eth0


@pytest.mark.parametrize(
    "known",
    ["00:00:00:11:66:88", "08:00:27:00:01:92", "00:00:00:00:00:00", "01:00:5e:00:00:01", "none", ""],
)
def test_address_that_is_no_boards_own_does_not_stay(site: Site, known: str) -> None:
    assert site.macs({"ethaddr": known})[0] != known


def test_one_address_for_both_ports_does_not_stay(site: Site) -> None:
    own = "00:11:22:33:44:55"
    eth0, eth1 = site.macs({"ethaddr": own, "eth1addr": own})
    assert eth0 == own != eth1


def test_file_may_have_other_lines(site: Site) -> None:
    write(site, "# gateway 7\neth1\t02:00:00:00:00:0B \r\n\neth0   02:00:00:00:00:0A\n")
    assert site.macs({}) == ("02:00:00:00:00:0a", "02:00:00:00:00:0b")


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "0 lines for eth0"),
        ("eth0 02:00:00:00:00:01\n", "0 lines for eth1"),
        (GOOD + "eth0 02:00:00:00:00:03\n", "2 lines for eth0"),
        (GOOD.replace(":02\n", ":01\n"), "gives both ports 02:00:00:00:00:01"),
        (GOOD.replace("eth0 02", "eth0 03"), "group's address"),
        (GOOD.replace("02:00:00:00:00:01", "00:00:00:00:00:00"), "is not an address"),
        (GOOD.replace("02:00:00:00:00:01", "08:00:27:00:01:93"), "address of every board"),
        (GOOD.replace("02:00:00:00:00:01", "02-00-00-00-00-01"), "not a MAC address"),
        (GOOD.replace("02:00:00:00:00:01", "02:00:00:00:00:1"), "not a MAC address"),
        ("\udcff\udcfe", "0 lines for eth0"),
    ],
)
def test_unusable_addresses_are_refused(site: Site, text: str, why: str) -> None:
    write(site, text.encode("utf-8", "surrogateescape").decode("latin-1"))
    with pytest.raises(UnusableInput, match=re.escape(why)):
        site.macs({})


def test_image_takes_the_file_too(site: Site, tmp_path: Path) -> None:
    """board/nuc980/place-macs.sh reads what is written here, with its own words."""
    macs = site.macs({})
    tree = libfdt.Fdt.create_empty_tree(4096)
    aliases = tree.add_subnode(0, "aliases")
    for port in (0, 1):
        tree.setprop_str(aliases, f"ethernet{port}", f"/emac{port}")
    for port in (0, 1):
        tree.add_subnode(0, f"emac{port}")
    (tmp_path / "tree").write_bytes(tree.as_bytearray())
    environment = {**os.environ, "SITE_SETTINGS": str(site.folder)}
    subprocess.run([ROOT / "board/nuc980/place-macs.sh", tmp_path / "tree"], env=environment, check=True)
    placed = libfdt.Fdt((tmp_path / "tree").read_bytes())
    arguments = placed.getprop(placed.path_offset("/chosen"), "bootargs").as_str()
    assert arguments == f"ethaddr0={macs[0]} ethaddr1={macs[1]}"
    for port in (0, 1):
        own = placed.getprop(placed.path_offset(f"/emac{port}"), "local-mac-address")
        assert bytes(own) == bytes.fromhex(macs[port].replace(":", ""))


def test_folder_that_cannot_be_written_is_no_traceback(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(OSError) as raised:
        Site(tmp_path / "file").macs({})
    assert raised.value.filename == os.fspath(tmp_path / "file") or "file" in str(raised.value.filename)


# ---- the board's IP address


def test_address_is_in_a_file(site: Site) -> None:
    assert site.board_ip() is None
    write(site, "192.168.21.100/24\n", "board-ip")
    assert site.board_ip() == IPv4Interface("192.168.21.100/24")


def test_unusable_file_is_named(site: Site) -> None:
    write(site, "192.168.21.100", "board-ip")
    with pytest.raises(UnusableInput, match=r"board-ip: '192.168.21.100' lacks its network's prefix"):
        site.board_ip()


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "is not an IPv4 address"),
        ("192.168.1.300/24", "is not an IPv4 address"),
        ("192.168.1.3/33", "is not an IPv4 address"),
        ("fe80::1/64", "is not an IPv4 address"),
        ("192.168.1.3", "lacks its network's prefix"),
        ("192.168.1.0/24", "the address of a network"),
        ("192.168.1.255/24", "the address of a network"),
        ("224.0.0.1/24", "not an address for a board"),
        ("127.0.0.1/8", "not an address for a board"),
    ],
)
def test_what_is_no_boards_address_is_refused(text: str, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        with_prefix(text)


@pytest.mark.parametrize("text", ["192.168.1.3/24", "192.168.1.3/255.255.255.0", "10.0.0.2/31"])
def test_what_is_one_is_taken(text: str) -> None:
    assert str(with_prefix(text).ip) == text.split("/")[0]
