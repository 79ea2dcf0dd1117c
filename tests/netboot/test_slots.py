# SPDX-License-Identifier: GPL-3.0-or-later
"""The table of slots and marks, and the boot command that is made of it, without a board."""

import random
import re
import shlex
from configparser import ConfigParser
from itertools import pairwise
from pathlib import Path

import pytest

from netboot import images
from nuc980.netboot.board import FACTORY, Nand
from nuc980.netboot.cli import main
from nuc980.netboot.errors import FlashNotPossible, LayoutUnknown, UnusableInput
from nuc980.netboot.limits import (
    BLOCK,
    DEVICE_TREE_AT,
    MEMORY,
    PAGE,
    ROOT_OFFSET,
    ROOT_SIZE,
    ROOT_VOLUME,
    UIMAGE_AT,
)
from nuc980.netboot.slots.layout import BASE, NAMES, PLACES, TRIAL, Area, check_flash, root_volume
from nuc980.netboot.slots.marks import LOOK
from nuc980.netboot.slots.script import MADE, ROOM, partitions, root_arguments, variables

AREAS = [*(area for slot in PLACES.values() for area in (slot.kernel, slot.device_tree)), *BASE, TRIAL]
ARGUMENTS = "console=ttyS0,115200n8 ethaddr0=02:00:00:00:00:01 ethaddr1=02:00:00:00:00:02"
PAGE_OF_DOCS = Path(__file__).parents[2] / "docs/update.md"
BOARD = Path(__file__).parents[2] / "board/nuc980"


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


def test_arguments_of_the_kernel_are_one_word() -> None:
    """U-Boot takes 16 words in a command. With more, it would pass over the slot, at least on trial."""
    command = re.search(r"setenv bootargs .*?(?= && )", variables(chip(), ARGUMENTS)["rtu_boot"])
    assert command
    assert len(shlex.split(command[0])) == 3


def test_each_variable_is_made_and_used() -> None:
    script = variables(chip(), ARGUMENTS)
    used = {name for value in script.values() for name in re.findall(r"run (\w+)", value)}
    assert used | {"bootcmd", "rtu_args", "rtu_parts"} == set(script)


def test_root_in_ubi_is_where_the_image_has_it() -> None:
    """The kernel's own arguments, the volumes of its UBI image and the boot command agree."""
    fragment = (BOARD / "linux/root-ubi.fragment").read_text()
    assert f'CONFIG_CMDLINE="{root_arguments("a")}"' in fragment
    ubi = ConfigParser()
    ubi.read(BOARD / "ubinize.cfg")
    for name in NAMES:
        volume = ubi[root_volume(name)]
        assert (volume["vol_name"], volume["vol_size"]) == (root_volume(name), f"{ROOT_VOLUME >> 20}MiB")


@pytest.mark.slow
def test_install_without_a_root_in_its_ubi_image(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its kernel would panic. With root_a, all of UBI is planned, and of B that it has no device tree."""
    chance = random.Random(980)
    (tmp_path / "uImage").write_bytes(images.uimage(b"kernel"))
    (tmp_path / "dtb").write_bytes(images.device_tree(chance))
    ubi = bytearray(images.ubi_image(chance, 2))
    (tmp_path / "ubi").write_bytes(ubi)
    words = ["install", "--dry-run", "--site", str(tmp_path / "site"), "--board-ip", "10.0.2.15/24"]
    words += ["--server-ip", "10.0.2.2", "--no-backup", "a dry run", "--ubi", str(tmp_path / "ubi")]
    words += [str(tmp_path / name) for name in ("uImage", "dtb")]
    assert main([*words, "--slot", "b"]) == 2
    assert "is not for one slot" in capsys.readouterr().err
    assert main(words) != 0
    assert "has no volume root_a" in capsys.readouterr().err
    ubi[8192:8199] = b"root_a\0"
    (tmp_path / "ubi").write_bytes(ubi)
    assert main(words) == 0
    shown = "".join(capsys.readouterr())
    assert "The UBI: " in shown
    assert "device tree B" in shown
    assert "kernel B" not in shown


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
