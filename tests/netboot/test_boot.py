# SPDX-License-Identifier: GPL-3.0-or-later
"""The plan of `boot`: what the kernel is told, what U-Boot is told, what is refused for want of room."""

import re
from dataclasses import replace
from ipaddress import IPv4Address, IPv4Interface
from pathlib import Path

import libfdt
import pytest

from nuc980.netboot.board import BoardReport, Port
from nuc980.netboot.boot import Addresses, Images, arguments_for, plan_boot, tree_for
from nuc980.netboot.commandline import LINE_ROOM
from nuc980.netboot.errors import DoesNotFit, LineTooLong, UnusableImage, UnusableInput
from nuc980.netboot.linux import Goal
from nuc980.netboot.plan import SetVariable
from nuc980.netboot.session import Network
from nuc980.netboot.steps import Slice
from nuc980.netboot.uimage import UImage, read_tree

MACS = ("02:00:00:00:00:01", "02:00:00:00:00:02")
OWN = "ethaddr0=02:00:00:00:00:01 ethaddr1=02:00:00:00:00:02"
FACTORY = {"baudrate": "115200", "bootdelay": "3", "ethact": "emac"}
BOARD = BoardReport(
    version="U-Boot 2016.11",
    commands=frozenset({"tftpboot", "crc32", "bootm"}),
    environment=FACTORY,
    ram=((0, 64 << 20),),
    ram_end=0x3D00000,
    ports=(Port("emac0", None), Port("emac1", None)),
)
NETWORK = Network(IPv4Interface("192.168.1.20/24"), IPv4Address("192.168.1.2"))
FILE = Slice(Path("file"), 0, 1000, 0)


@pytest.fixture
def tree(dtb: Path) -> libfdt.Fdt:
    """The board's, without arguments."""
    return read_tree(dtb)


def with_arguments(tree: libfdt.Fdt, arguments: str) -> libfdt.Fdt:
    return libfdt.Fdt(tree_for(tree, arguments, ()))


def dialogue(board: BoardReport = BOARD, network: Network = NETWORK) -> list[str]:
    """What would be typed, without the markers."""
    plan = plan_boot(board, network, MACS, FILE, FILE, Goal(), Addresses.of(board))
    lines = [line for _, typed in plan.dialogue() for line in typed]
    return [re.sub(r"^if (.*); then echo @\d+:ok; else echo @\d+:failed; fi$", r"\1", line) for line in lines]


# ---- what the kernel is told


def test_tree_without_arguments_gets_the_addresses(tree: libfdt.Fdt) -> None:
    assert arguments_for(tree, FACTORY, None, MACS) == OWN


def test_trees_own_arguments_come_first(tree: libfdt.Fdt) -> None:
    own = with_arguments(tree, "console=ttyS0 root=/dev/ram0")
    assert arguments_for(own, FACTORY, None, MACS) == f"console=ttyS0 root=/dev/ram0 {OWN}"


def test_another_boards_addresses_go(tree: libfdt.Fdt) -> None:
    own = with_arguments(tree, "a ethaddr0=02:00:00:00:00:77 b ethaddr1=02:00:00:00:00:78")
    assert arguments_for(own, FACTORY, None, MACS) == f"a b {OWN}"


def test_uboots_arguments_hold_against_the_trees(tree: libfdt.Fdt) -> None:
    """As U-Boot would do it: it puts its bootargs into the tree."""
    own = with_arguments(tree, "of the tree")
    assert arguments_for(own, {**FACTORY, "bootargs": "of U-Boot"}, None, MACS) == f"of U-Boot {OWN}"


def test_arguments_given_hold_against_all(tree: libfdt.Fdt) -> None:
    given = "mine ethaddr0=02:00:00:00:00:99"
    found = arguments_for(tree, {**FACTORY, "bootargs": "of U-Boot"}, given, MACS)
    assert found == f"{given} ethaddr1={MACS[1]}"
    assert arguments_for(with_arguments(tree, "of the tree"), FACTORY, "", MACS) == OWN


@pytest.mark.parametrize("given", ["x" * 1024, "a\nb", "naïve", "x" * (1023 - len(OWN))])
def test_arguments_that_no_kernel_takes_are_refused(tree: libfdt.Fdt, given: str) -> None:
    with pytest.raises(UnusableInput, match="printable ASCII, less than 1024"):
        arguments_for(tree, FACTORY, given, MACS)
    assert len(arguments_for(tree, FACTORY, "x" * (1022 - len(OWN)), MACS)) == 1023


def test_addresses_are_in_the_tree(tree: libfdt.Fdt) -> None:
    served = libfdt.Fdt(tree_for(tree, "some arguments", MACS))
    assert served.getprop(served.path_offset("/chosen"), "bootargs").as_str() == "some arguments"
    for port, mac in enumerate(MACS):
        node = served.path_offset(served.get_alias(f"ethernet{port}"))
        assert bytes(served.getprop(node, "local-mac-address")).hex(":") == mac
    assert served.getprop(0, "model").as_str() == tree.getprop(0, "model").as_str()
    assert "bootargs" not in properties(tree, "/chosen")  # the one that was given is as it was


@pytest.mark.parametrize(("flash", "status"), [(False, "disabled"), (True, "okay")])
def test_linux_gets_the_flash_only_if_told_so(tree: libfdt.Fdt, flash: bool, status: str) -> None:
    served = libfdt.Fdt(tree_for(tree, "", MACS, flash=flash))
    node = served.path_offset("/ahb/fmi@b0019000")
    assert served.getprop(node, "status").as_str() == status
    assert served.getprop(served.path_offset(served.get_alias("ethernet1")), "status").as_str() == "okay"


def test_tree_without_chosen_and_aliases_gets_arguments() -> None:
    served = libfdt.Fdt(tree_for(libfdt.Fdt.create_empty_tree(512), "x" * 1023, MACS))
    assert served.getprop(served.path_offset("/chosen"), "bootargs").as_str() == "x" * 1023


def properties(tree: libfdt.Fdt, path: str) -> set[str]:
    found = set()
    at = tree.first_property_offset(tree.path_offset(path), libfdt.QUIET_NOTFOUND)
    while at >= 0:
        found.add(tree.get_property_by_offset(at).name)
        at = tree.next_property_offset(at, libfdt.QUIET_NOTFOUND)
    return found


# ---- what U-Boot is told


def test_dialogue_of_a_factorys_board() -> None:
    assert dialogue() == [
        "setenv ethaddr '02:00:00:00:00:01'",
        "setenv eth1addr '02:00:00:00:00:02'",
        "setenv ipaddr '192.168.1.20'",
        "setenv netmask '255.255.255.0'",
        "setenv serverip '192.168.1.2'",
        "setenv netretry 'no'",
        "setenv tftptimeout '2000'",
        "setenv tftptimeoutcountmax '4'",
        "tftpboot 0x7fc0 uImage",
        "crc32 0x7fc0 0x3e8",
        "tftpboot 0xa00000 nuc980.dtb",
        "crc32 0xa00000 0x3e8",
        "bootm 0x7fc0 - 0xa00000",
    ]


def test_what_is_right_already_is_not_set() -> None:
    known = {**FACTORY, "ethaddr": MACS[0], "eth1addr": MACS[1], "ipaddr": "192.168.1.20", "netretry": "no"}
    lines = dialogue(replace(BOARD, environment=known))
    assert [line for line in lines if re.search("ethaddr|eth1addr|ipaddr|netretry", line)] == []


def test_what_stands_in_the_way_is_taken_out_in_the_ram() -> None:
    lines = dialogue(replace(BOARD, environment={**FACTORY, "bootargs": "x", "fdt_high": "0xffffffff"}))
    assert {"setenv bootargs", "setenv fdt_high"} <= set(lines)


def test_title_says_whether_a_variable_is_set_or_removed() -> None:
    assert SetVariable("bootcmd", "bootm").title() == "Set bootcmd."
    assert SetVariable("bootcmd", "").title() == "Remove bootcmd."


@pytest.mark.parametrize("word", ["saveenv", "nand", "ubi", "erase", "protect", "mtd"])
def test_flash_is_not_touched(word: str) -> None:
    assert [line for line in dialogue() if word in line] == []


def test_load_starts_nothing() -> None:
    """U-Boot's tftpboot runs bootm by itself with autostart=yes."""
    lines = dialogue(replace(BOARD, environment={**FACTORY, "autostart": "yes"}))
    assert lines.index("setenv autostart 'no'") < lines.index("tftpboot 0x7fc0 uImage")


def test_another_port_of_the_server_and_of_the_board() -> None:
    lines = dialogue(network=replace(NETWORK, port=6969, device="emac1"))
    assert {"setenv tftpdstp '6969'", "setenv ethact 'emac1'"} <= set(lines)


def test_another_port_of_a_run_before_is_put_right() -> None:
    lines = dialogue(replace(BOARD, environment={**FACTORY, "tftpdstp": "6969"}))
    assert "setenv tftpdstp '69'" in lines


def test_ethernet_port_that_is_not_there_is_refused() -> None:
    with pytest.raises(UnusableInput, match=r"no Ethernet port 'eth0'; it has emac0, emac1"):
        dialogue(network=replace(NETWORK, device="eth0"))


def test_every_line_fits() -> None:
    plan = plan_boot(BOARD, NETWORK, MACS, FILE, FILE, Goal(), Addresses())
    assert all(len(line) <= LINE_ROOM for _, lines in plan.dialogue(9000) for line in lines)


def test_bad_name_of_a_port_never_reaches_the_board() -> None:
    with pytest.raises(LineTooLong):
        dialogue(replace(BOARD, ports=()), replace(NETWORK, device="a\nb"))


# ---- what has room


def images(tree: libfdt.Fdt, size: int, runs_at: int = 0x8000) -> Images:
    return Images(Path("uImage"), UImage(runs_at, runs_at, size, ""), tree)


def test_addresses_count_from_the_rams_start() -> None:
    assert Addresses.of(BOARD) == Addresses(0x7FC0, 0xA00000)
    there = Addresses.of(replace(BOARD, ram=((0x40000000, 128 << 20),)))
    assert (there.uimage, there.dtb, there.runs_at) == (0x40007FC0, 0x40A00000, 0x40008000)
    with pytest.raises(UnusableInput, match="where the board's RAM is"):
        Addresses.of(replace(BOARD, ram=()))


def test_kernel_fills_the_room_and_no_more(tree: libfdt.Fdt) -> None:
    images(tree, 10_453_056).check(BOARD, Addresses())
    with pytest.raises(DoesNotFit, match="has 10453057 bytes, 1 more than fit before the device tree"):
        images(tree, 10_453_057).check(BOARD, Addresses())


@pytest.mark.parametrize(
    "board",
    [
        replace(BOARD, ram=((0, 10 << 20),)),
        replace(BOARD, ram_end=0xA00000 + 8192),
    ],
)
def test_tree_must_lie_in_free_ram(tree: libfdt.Fdt, board: BoardReport) -> None:
    with pytest.raises(DoesNotFit, match="goes to 0xa00000"):
        images(tree, 1000).check(board, Addresses())


def test_kernel_for_another_place_is_refused(tree: libfdt.Fdt) -> None:
    with pytest.raises(UnusableImage, match="made to run at 0x208000"):
        images(tree, 1000, runs_at=0x208000).check(BOARD, Addresses())
