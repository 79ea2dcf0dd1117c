# SPDX-License-Identifier: GPL-3.0-or-later
"""The tables of bad blocks that a new system needs, where the flash has none.

The vendor's kernel makes them when it starts from the flash, over whatever is in the last blocks. Ours does
not, and needs them for a worn block that does not take its mark. So `flash` writes them, after a backup.
Their form is that of drivers/mtd/nand/raw/nand_bbt.c in Linux and U-Boot (bbt_main_no_oob_descr).
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from pathlib import Path

from nuc980.netboot.board import TABLE_BLOCKS, Nand
from nuc980.netboot.errors import LayoutUnknown
from nuc980.netboot.flash.images import ERASED, Image
from nuc980.netboot.flash.journal import NEW
from nuc980.netboot.flash.layout import TABLES, Slot
from nuc980.netboot.probe import FLASH_SECONDS
from nuc980.netboot.session import Session
from nuc980.netboot.steps import ram_has

TABLE, MIRROR = b"Bbt0", b"1tbB"
VERSION = 1


def tables_slot(nand: Nand) -> Slot:
    """The last blocks of the chip."""
    size = TABLE_BLOCKS * nand.block
    return Slot(TABLES, nand.size - size, nand.size, size)


def tables_content(nand: Nand) -> bytes:
    """What the good ones of the last blocks are to hold. Raises LayoutUnknown for less than two of them.

    Two bits a block, 00 for a bad one and 11 for a good one; the table is in the last good block, its mirror
    in the one before.
    """
    good = len(tables_slot(nand).blocks(nand))
    if good < 2:
        raise LayoutUnknown("Only one of the last blocks is good: no room for bad-block tables.")
    table = bytearray([ERASED]) * (nand.size // nand.block // 4)
    for offset in nand.bad:
        block = offset // nand.block
        table[block // 4] &= ~(3 << 2 * (block % 4))
    mirror, main = (
        (word + bytes([VERSION]) + table).ljust(nand.block, bytes([ERASED])) for word in (MIRROR, TABLE)
    )
    return bytes([ERASED]) * ((good - 2) * nand.block) + mirror + main


def tables_image(nand: Nand, folder: Path) -> Image:
    """The tables in a file of this folder, named by its content: a flash goes on with what it began with."""
    content = tables_content(nand)
    path = folder / f"bad-block-tables-{zlib.crc32(content):08x}"
    folder.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return Image.of(tables_slot(nand), path)


def has_tables(session: Session, nand: Nand, address: int) -> bool:
    """Whether the flash has one at least; address: of a page's room in RAM."""
    if nand.keeps_table:
        return True
    for offset in tables_slot(nand).blocks(nand):
        read = session.console.run(f"nand read {address:#x} {offset:#x} {nand.page:#x}", FLASH_SECONDS)
        if read.status == 0 and any(ram_has(session, address, word) for word in (TABLE, MIRROR)):
            return True
    return False


def up_to_date(
    images: Sequence[Image], bad: Sequence[int], nand: Nand, content: str, folder: Path
) -> tuple[Image, ...]:
    """The images, with tables that know what has died since `bad` was all that was bad.

    None where U-Boot has found those that were written: it lets nobody write there any more, and adds to them
    what dies.
    """
    if set(nand.bad) == set(bad):
        return tuple(images)
    others = tuple(image for image in images if image.name != TABLES)
    if len(others) == len(images) or nand.keeps_table:
        return others
    return (*others, tables_image(nand, folder)) if content == NEW else tuple(images)
