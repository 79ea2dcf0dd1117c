# SPDX-License-Identifier: GPL-3.0-or-later
"""The table of slots and marks, and the boot command that is made of it, without a board."""

import re
from itertools import pairwise
from pathlib import Path

import pytest

from nuc980.netboot.board import FACTORY, Nand
from nuc980.netboot.errors import FlashNotPossible, LayoutUnknown, UnusableInput
from nuc980.netboot.limits import BLOCK, DEVICE_TREE_AT, MEMORY, PAGE, ROOT_OFFSET, ROOT_SIZE, UIMAGE_AT
from nuc980.netboot.slots.layout import BASE, PLACES, TRIAL, Area, check_flash
from nuc980.netboot.slots.marks import LOOK
from nuc980.netboot.slots.script import MADE, ROOM, partitions, variables

AREAS = [*(area for slot in PLACES.values() for area in (slot.kernel, slot.device_tree)), *BASE, TRIAL]
ARGUMENTS = "console=ttyS0,115200n8 ethaddr0=02:00:00:00:00:01 ethaddr1=02:00:00:00:00:02"
PAGE_OF_DOCS = Path(__file__).parents[2] / "docs/update.md"


def chip(*bad: int) -> Nand:
    assert FACTORY.nand
    return Nand(FACTORY.nand.size, BLOCK, PAGE, bad)


def test_places_are_whole_blocks_and_apart() -> None:
    """Between U-Boot's own and UBI, so that neither is touched."""
    ends = [0x200000, *(number for area in AREAS for number in (area.offset, area.end)), ROOT_OFFSET]
    assert all(number % BLOCK == 0 for number in ends)
    assert all(one <= other for one, other in pairwise(ends))


def test_slots_are_alike() -> None:
    """The boot command reads as much of either."""
    sizes = {(slot.kernel.size, slot.device_tree.size) for slot in PLACES.values()}
    assert len(sizes) == 1


def test_memory_is_apart() -> None:
    """Of what is loaded and what is looked at."""
    kernel, tree = PLACES["a"].kernel, PLACES["a"].device_tree
    assert UIMAGE_AT + kernel.size <= DEVICE_TREE_AT
    assert DEVICE_TREE_AT + tree.size <= LOOK
    assert LOOK + PAGE <= MADE < MADE + PAGE < MEMORY


def test_each_variable_fits_a_line() -> None:
    script = variables(chip(), ARGUMENTS)
    assert max(len(value) for value in script.values()) < ROOM
    with pytest.raises(UnusableInput, match="rtu_args has 250 characters"):
        variables(chip(), "x" * ROOM)


def test_each_variable_is_made_and_used() -> None:
    script = variables(chip(), ARGUMENTS)
    used = {name for value in script.values() for name in re.findall(r"run (\w+)", value)}
    assert used | {"bootcmd", "rtu_args", "rtu_parts"} == set(script)


def test_linux_has_the_same_places() -> None:
    """As partitions; between them nothing, before them U-Boot, which it may not write."""
    first, *parts = partitions().removeprefix("mtdparts=nand0:").split(",")
    assert first == "2048k(u-boot)ro"
    found = [re.fullmatch(r"(\d+)k@(\d+)k\(([\w-]+)\)", part) for part in parts]
    places = {part[3]: (int(part[2]) * 1024, int(part[1]) * 1024) for part in found if part}
    assert [*places.values()] == [*((area.offset, area.size) for area in AREAS), (ROOT_OFFSET, ROOT_SIZE)]
    assert [*places] == [*("kernel-a", "tree-a", "kernel-b", "tree-b", "base-1", "base-2", "trial", "rootfs")]


def test_marks_go_around_blocks_that_are_bad() -> None:
    script = variables(chip(*(area.offset for area in (*BASE, TRIAL))), "")
    assert "0x1520000" in script["rtu_base1"]
    assert "0x1560000" in script["rtu_base2"]
    assert "0x15a0000" in script["rtu_trial"]
    assert "0x15a0800 0x15a1000 0x15a1800" in script["rtu_trial"]


def test_no_good_block_for_a_mark() -> None:
    with pytest.raises(LayoutUnknown, match="no place for a mark"):
        variables(chip(TRIAL.offset, TRIAL.offset + BLOCK), "")


def test_another_flash() -> None:
    with pytest.raises(FlashNotPossible, match="laid out for"):
        check_flash(Nand(1 << 28, BLOCK, PAGE, ()))


@pytest.mark.parametrize("area", AREAS)
def test_page_names_each_place(area: Area) -> None:
    assert f"0x{area.offset:X}" in PAGE_OF_DOCS.read_text()
