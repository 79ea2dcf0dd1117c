# SPDX-License-Identifier: GPL-3.0-or-later
"""The tables of bad blocks that `flash` writes, byte by byte, and when they are not right any more."""

from dataclasses import replace
from pathlib import Path

import pytest

from nuc980.netboot.board import Nand
from nuc980.netboot.errors import LayoutUnknown
from nuc980.netboot.flash.journal import NEW, OLD
from nuc980.netboot.flash.layout import KERNEL, TABLES
from nuc980.netboot.flash.tables import still_right, tables_content, tables_image, tables_slot

BLOCK, BLOCKS = 0x20000, 1024


def chip(*bad: int) -> Nand:
    return Nand(BLOCKS * BLOCK, BLOCK, 2048, tuple(block * BLOCK for block in bad))


def test_they_are_in_the_last_two_good_blocks() -> None:
    content = tables_content(chip(1022))
    assert len(content) == 3 * BLOCK
    assert [content[at : at + 5] for at in range(0, 3 * BLOCK, BLOCK)] == [
        b"\xff" * 5, b"1tbB\x01", b"Bbt0\x01"
    ]  # fmt: skip


def test_two_bits_tell_of_a_block() -> None:
    bad = {0, 5, 1000, 1020}
    table = tables_content(chip(*bad))[-BLOCK + 5 :]
    assert {at for at in range(BLOCKS) if table[at // 4] >> 2 * (at % 4) & 3 == 0} == bad
    assert table[BLOCKS // 4 :] == b"\xff" * (BLOCK - 5 - BLOCKS // 4)


def test_without_two_good_blocks_there_is_no_room() -> None:
    with pytest.raises(LayoutUnknown, match="no room"):
        tables_content(chip(1020, 1021, 1023))


@pytest.mark.parametrize(
    ("content", "died", "left"),
    [
        (NEW, (), (KERNEL, TABLES)),
        (NEW, (300,), (KERNEL,)),
        (NEW, (1023,), (KERNEL,)),
        (OLD, (300,), (KERNEL, TABLES)),
        (OLD, (1020, 1021, 1022, 1023), (KERNEL,)),  # U-Boot uses the new ones
    ],
)
def test_right_until_a_block_dies(
    tmp_path: Path, content: str, died: tuple[int, ...], left: tuple[str, ...]
) -> None:
    before = chip(7)
    tables = tables_image(before, tmp_path)
    assert tables.slot == tables_slot(before)
    kernel = replace(tables, slot=replace(tables.slot, name=KERNEL))
    right = still_right((kernel, tables), before.bad, chip(7, *died), content)
    assert tuple(image.name for image in right) == left
