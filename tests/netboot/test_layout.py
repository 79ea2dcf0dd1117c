# SPDX-License-Identifier: GPL-3.0-or-later
"""Where images belong: from boot commands as boards have them, with bad blocks; and what is refused."""

import subprocess
import tomllib
from pathlib import Path

import pytest

from nuc980.netboot.board import Nand, Partition
from nuc980.netboot.errors import DoesNotFit, LayoutUnknown
from nuc980.netboot.flash.layout import (
    DEVICE_TREE,
    KERNEL,
    UBI,
    Layout,
    Slot,
    layout_of,
    loader_slot,
)
from nuc980.netboot.uimage import partitions_of, read_tree

ROOT = Path(__file__).parents[2]
LIMITS = tomllib.loads((ROOT / "board/nuc980/boards/gateway/image-limits.toml").read_text())["flash"]
SIZE, BLOCK = 0x8000000, 0x20000
FACTORY = "nand read 0x7FC0 0x200000 0x500000; nand read 0xA00000 0x700000 0x100000; bootm 0x7Fc0 - 0xA00000"
PARTS = (
    Partition("u-boot", 0, 0x200000),
    Partition("kernel", 0x200000, 0x500000),
    Partition("dtb", 0x700000, 0x100000),
    Partition("user", 0x1600000, SIZE - 0x1600000),
)


def nand(*bad: int, partitions: tuple[Partition, ...] = ()) -> Nand:
    return Nand(SIZE, BLOCK, 2048, bad, partitions=partitions)


def layout(
    bootcmd: str,
    *bad: int,
    explicit: dict[str, tuple[int, int]] | None = None,
    partitions: tuple[Partition, ...] = (),
    linux: tuple[Partition, ...] = (),
    **variables: str,
) -> Layout:
    return layout_of({"bootcmd": bootcmd, **variables}, nand(*bad, partitions=partitions), explicit, linux)


def place(slot: Slot | None) -> tuple[int, int, int] | None:
    return slot and (slot.offset, slot.end, slot.room)


def test_factorys_places_are_those_of_the_image_limits() -> None:
    found = layout(FACTORY)
    for slot, limit in (
        (found.kernel, LIMITS["kernel"]),
        (found.device_tree, LIMITS["device_tree"]),
        (found.ubi, LIMITS["root"]),
    ):
        end = limit["offset"] + limit["size"]
        assert place(slot) == (limit["offset"], end, limit["size"])
    assert found.notes == ()


@pytest.mark.parametrize(
    "bootcmd",
    [
        "nand read 7fc0 200000 500000;nand read A00000 700000 100000;bootm 7fc0 - a00000",
        "nand device 0; nand read.e 0x7FC0 0x200000 0x500000 && nand read.i 0xA00000 0x700000 0x100000"
        " && bootm 0x7FC0 - 0xA00000",
        "run load; run start",
        "run load start",
        "nand read 0x7fc0 kernel; nand read 0xa00000 dtb; bootm 0x7fc0 - 0xa00000",
        "nand read 0x7fc0 nand0,kernel 0x500000; nand read ${tree} dtb; bootm 0x7fc0 - $tree",
        "setenv at 0x7fc0; nand read $at 0x200000 0x500000; nand read $tree 0x700000 0x100000;"
        " bootm $at - $tree; run nothing",
        "nand read 0x7fc0 0x200000 0x1400000; nand read 0xa00000 0x700000 0x100000; bootm 0x7fc0 - 0xa00000",
    ],
)
def test_boot_command_says_it_in_other_words(bootcmd: str) -> None:
    found = layout(
        bootcmd,
        partitions=PARTS,
        tree="0xa00000",
        load="nand read 0x7FC0 0x200000 0x500000; nand read 0xA00000 0x700000 0x100000",
        start="bootm 0x7Fc0 - 0xA00000",
    )
    assert place(found.kernel) == (0x200000, 0x700000, 0x500000)
    assert place(found.device_tree) == (0x700000, 0x800000, 0x100000)


@pytest.mark.parametrize(
    ("bootcmd", "why"),
    [
        ("", "no bootcmd"),
        ("nand read 0x7fc0 0x200000 0x500000", "no bootm"),
        ("tftp 0x7fc0 uImage; bootm 0x7fc0", "'tftp 0x7fc0 uImage'"),
        (f"if test 1; then {FACTORY}; fi", "'if test 1'"),
        (f"ping 1.2.3.4 || {FACTORY}", "ping"),
        ("run load; bootm 0x7fc0", "no variable load"),
        ("run bootcmd", "runs itself"),
        ("nand read 0x7fc0 kernel; bootm 0x7fc0", "partition kernel"),
        ("nand read 0x7fc0 0x200000 5M; bootm 0x7fc0", "'5M'"),
        ("nand read 0x7fc0 0x200000 0x500000; bootm 0x8000", "0x8000"),
        ("nand read 0x7fc0 0x200000 0x500000; bootm 0x7fc0 0x900000 0xa00000", "bootm"),
        ("nand read 0xa00000 0x700000 0x100000; nand read 0x7fc0 0x200000 0xa00000;"
         " bootm 0x7fc0 - 0xa00000", "over another"),
        ("nand read 0x7fc0 0x200000 0x500000; nand read 0x7000 0x700000 0x100000;"
         " bootm 0x7fc0 - 0x7000", "over another"),
        ("nand read 0x7fc0 0x200000 0x500000; nand read 0x200000 0x900000 0x1000; bootm 0x7fc0", "another"),
        ("mtdparts add nand0 1m kernel; nand read 0x7fc0 0x200000 0x500000; bootm 0x7fc0", "mtdparts add"),
        ("nand device 1; nand read 0x7fc0 0x200000 0x500000; bootm 0x7fc0", "nand device 1"),
        ("ubi part rootfs; ubi read 0x7fc0 kernel; bootm 0x7fc0", "'ubi part rootfs'"),
    ],
)  # fmt: skip
def test_what_is_not_understood_is_refused_with_the_reason(bootcmd: str, why: str) -> None:
    found = layout(bootcmd)
    for name in (KERNEL, DEVICE_TREE, UBI):
        with pytest.raises(LayoutUnknown, match="is unknown") as refused:
            found.slot(name)
        assert why in str(refused.value)


def test_place_can_be_named_instead() -> None:
    found = layout("tftp 0x7fc0 uImage; bootm", explicit={KERNEL: (0x200000, 0x400000)})
    assert place(found.slot(KERNEL)) == (0x200000, 0x600000, 0x400000)
    with pytest.raises(LayoutUnknown):
        found.slot(DEVICE_TREE)


@pytest.mark.parametrize(
    ("offset", "size"),
    [
        (0, 0x100000),
        (0x80000, 0x20000),  # the environment
        (0x1E0000, 0x20000),
        (0x200100, 0x20000),
        (0x200000, 0x20100),
        (SIZE - 4 * BLOCK, 4 * BLOCK),  # the tables of bad blocks
        (0x1600000, 0x100000),  # the root file system's
        (0x700000, 0x100000),  # the device tree's
        (0x1500000, 0x200000),
    ],
)
def test_no_place_is_what_something_else_has(offset: int, size: int) -> None:
    with pytest.raises(LayoutUnknown):
        layout(FACTORY, explicit={KERNEL: (offset, size)})


@pytest.mark.parametrize("offset", ["0x0", "0x80000", "0x100000", "0x1e0000"])
def test_boot_command_does_not_open_the_boot_loaders_place(offset: str) -> None:
    with pytest.raises(LayoutUnknown, match="boot loader's"):
        layout(f"nand read 0x7fc0 {offset} 0x20000; bootm 0x7fc0")


def test_bad_blocks_take_room() -> None:
    found = layout(FACTORY, 0x200000, 0x6E0000, 0x720000, 0x900000)
    flash = nand(0x200000, 0x6E0000, 0x720000, 0x900000)
    kernel = found.slot(KERNEL)
    assert kernel.usable(flash) == 0x500000 - 2 * BLOCK
    assert kernel.blocks(flash)[0] == 0x220000
    assert kernel.blocks(flash)[-1] == 0x6C0000
    kernel.check_fits(0x500000 - 2 * BLOCK, flash)
    with pytest.raises(DoesNotFit, match="2 bad blocks"):
        kernel.check_fits(0x500000 - 2 * BLOCK + 1, flash)
    assert len(found.notes) == 2
    assert "beyond 0x700000" in found.notes[0]


def test_room_is_what_is_read_even_if_no_whole_block() -> None:
    found = layout("nand read 0x7fc0 0x200000 0x210001; bootm 0x7fc0")
    assert place(found.kernel) == (0x200000, 0x420000, 0x210001)
    assert found.device_tree is None


def test_kernel_ends_where_the_device_tree_is_in_ram() -> None:
    found = layout("nand read 7fc0 200000 1000000; nand read 100000 1200000 20000; bootm 7fc0 - 100000")
    assert found.kernel
    assert found.kernel.room == 0x100000 - 0x7FC0


def test_kernel_ends_where_something_else_is_read() -> None:
    with pytest.raises(LayoutUnknown, match="overlap"):
        layout("nand read 7fc0 200000 500000; nand read 2000000 600000 20000; bootm 7fc0")


@pytest.mark.parametrize("fallback", ["nand read 7fc0 3000000 500000; bootm 7fc0; reset", "run other"])
def test_what_is_read_when_bootm_fails_is_no_place_for_ubi(fallback: str) -> None:
    with pytest.raises(LayoutUnknown, match=r"UBI .* and read at 0x3000000 .* overlap"):
        layout(f"{FACTORY}; {fallback}", other="echo once more; nand read 0x7fc0 0x3000000 0x500000")


def test_partition_of_which_bad_blocks_leave_too_little_cannot_be_read() -> None:
    """U-Boot: "Size of read exceeds partition or device limit", and not one byte."""
    bootcmd = "nand read 0x7fc0 kernel 0x500000; bootm 0x7fc0"
    layout(bootcmd, partitions=PARTS).slot(KERNEL).check_fits(1, nand())
    slot = layout(bootcmd, 0x300000, partitions=PARTS).slot(KERNEL)
    with pytest.raises(DoesNotFit, match="reads nothing"):
        slot.check_fits(1, nand(0x300000))


def test_partition_without_size_is_read_less_its_bad_blocks() -> None:
    slot = layout("nand read 0x7fc0 kernel; bootm 0x7fc0", 0x300000, partitions=PARTS).slot(KERNEL)
    slot.check_fits(0x500000 - BLOCK, nand(0x300000))
    with pytest.raises(DoesNotFit):
        slot.check_fits(0x500000 - BLOCK + 1, nand(0x300000))


def test_root_is_the_boards_partition_but_never_the_tables() -> None:
    assert place(layout(FACTORY, partitions=PARTS).ubi) == (
        0x1600000, SIZE - 4 * BLOCK, SIZE - 4 * BLOCK - 0x1600000
    )  # fmt: skip
    with pytest.raises(LayoutUnknown, match="overlap"):
        layout(FACTORY, partitions=(Partition("rootfs", 0x300000, SIZE - 0x300000),))


def test_root_is_where_the_new_device_tree_has_it() -> None:
    """Of a board that is not the gateway, and whose U-Boot has no partitions."""
    root = Partition("rootfs", 0x2000000, 0x1000000)
    assert place(layout(FACTORY, linux=(PARTS[1], root)).ubi) == (0x2000000, 0x3000000, 0x1000000)
    assert place(layout(FACTORY, partitions=PARTS, linux=PARTS).ubi) == place(
        layout(FACTORY, partitions=PARTS).ubi
    )


def test_root_is_no_longer_than_the_new_device_tree_has_it() -> None:
    """U-Boot's may be: Linux would not find the end of an image that needs it."""
    uboot, linux = (Partition("rootfs", 0x2000000, size) for size in (0x1000000, 0x800000))
    assert place(layout(FACTORY, partitions=(PARTS[1], uboot), linux=(linux,)).ubi) == (
        0x2000000, 0x2800000, 0x800000
    )  # fmt: skip
    with pytest.raises(LayoutUnknown, match=r"rootfs has 0x800000 bytes at 0x2000000, .* 0x1000000 at"):
        layout(FACTORY, partitions=(PARTS[1], linux), linux=(uboot,))


def test_uboot_and_device_tree_that_disagree_on_the_root_are_refused() -> None:
    """Linux would not find there what was written: nothing is erased until somebody says where."""
    root = Partition("rootfs", 0x2000000, 0x1000000)
    with pytest.raises(
        LayoutUnknown, match=r"0x1600000, the device tree's partition rootfs 0x1000000 at 0x2000000"
    ) as why:
        layout(FACTORY, partitions=PARTS, linux=(root,))
    assert "--ubi-at" in str(why.value)
    found = layout(FACTORY, partitions=PARTS, linux=(root,), explicit={UBI: (0x2000000, 0x1000000)})
    assert place(found.ubi) == (0x2000000, 0x3000000, 0x1000000)


@pytest.mark.parametrize("board", ["gateway", "numaker"])
def test_partitions_of_a_boards_device_tree(board: str, tmp_path: Path) -> None:
    tree = tmp_path / "board.dtb"
    source = ROOT / f"dts/nuvoton/nuc980-{board}.dts"
    subprocess.run([ROOT / "scripts/build-dtb.sh", source, tree], check=True, capture_output=True)
    found = {partition.name: partition for partition in partitions_of(read_tree(tree))}
    limits = tomllib.loads((ROOT / f"board/nuc980/boards/{board}/image-limits.toml").read_text())["flash"]
    for limit in (limits["kernel"], limits["root"]):
        assert found[limit["label"]] == Partition(limit["label"], limit["offset"], limit["size"])


def test_boot_loaders_place_wants_good_blocks() -> None:
    assert place(loader_slot(nand(0x180000))) == (0x100000, 0x180000, 500 * 1024)
    with pytest.raises(LayoutUnknown, match="bad"):
        loader_slot(nand(0x140000))
