# SPDX-License-Identifier: GPL-3.0-or-later
"""The tables of bad blocks that `flash` writes, byte by byte, and what becomes of them when a block dies."""

from dataclasses import replace
from pathlib import Path

import pytest

from nuc980.netboot.board import Nand
from nuc980.netboot.errors import LayoutUnknown
from nuc980.netboot.flash.journal import NEW, OLD
from nuc980.netboot.flash.layout import KERNEL
from nuc980.netboot.flash.tables import tables_content, tables_image, tables_slot, up_to_date

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


@pytest.mark.parametrize("died", [(), (300,), (1023,)])
@pytest.mark.parametrize("content", [NEW, OLD])
def test_new_ones_know_what_has_died(tmp_path: Path, content: str, died: tuple[int, ...]) -> None:
    before, now = chip(7), chip(7, *died)
    old = tables_image(before, tmp_path)
    (image,) = up_to_date([old], before.bad, now, content, tmp_path)
    assert image.slot == tables_slot(now)
    known = now if content == NEW else before
    assert image.path.read_bytes() == tables_content(known)


def test_tables_that_u_boot_uses_are_its_own(tmp_path: Path) -> None:
    before = chip(7)
    tables = tables_image(before, tmp_path)
    kernel = replace(tables, slot=replace(tables.slot, name=KERNEL))
    now = replace(chip(7, 1020, 1021, 1022, 1023), keeps_table=True)
    assert up_to_date([kernel, tables], before.bad, now, NEW, tmp_path) == (kernel,)
