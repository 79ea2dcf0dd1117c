# SPDX-License-Identifier: GPL-3.0-or-later
"""Every change of a flash while boards ran with it, one by one, and what a power cut leaves of one.

A board writes through QEMU's driver blklogwrites, whose log has the format of Linux' dm-log-writes.
"""

import random
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from nuc980.netboot.slots.layout import Area
from nuc980.twin.nand import DATA, PAGE, PAGES, NandImage

SECTOR = 512
ENTRY = struct.Struct("<4Q")  # first sector, sectors, flags, bytes of other data
FLAGS_WITHOUT_DATA = 1 | 4  # flush, discard
BLOCK = PAGES * PAGE


@dataclass(frozen=True)
class Change:
    """A page that was programmed or a block that was erased: what it holds from then on."""

    page: int  # the block's first
    content: bytes

    @property
    def pages(self) -> int:
        return len(self.content) // PAGE

    def is_in(self, area: Area) -> bool:
        return area.offset <= self.page * DATA < area.end

    def apply(self, nand: NandImage) -> None:
        put(nand, self.page, self.content)

    def torn(self, before: bytes, share: float, chance: random.Random) -> bytes:
        """What is there when the power goes meanwhile: this share of the bits has changed, in 64ths."""
        size = len(before)
        old, new = int.from_bytes(before, "big"), int.from_bytes(self.content, "big")
        return (old ^ (old ^ new) & _bits(8 * size, share, chance)).to_bytes(size, "big")


def put(nand: NandImage, page: int, content: bytes) -> None:
    """Pages with their spare bytes, as if they had always been there."""
    with nand.path.open("r+b") as file:
        file.seek(page * PAGE)
        file.write(content)


def content(nand: NandImage, page: int, count: int) -> bytes:
    """So many pages, with their spare bytes."""
    with nand.path.open("rb") as file:
        file.seek(page * PAGE)
        return file.read(count * PAGE)


def _bits(count: int, share: float, chance: random.Random) -> int:
    """So many random bits, of which a share is 1: a multiple of 1/64."""
    wanted, bits = round(share * 64), 0
    for place in range(6):
        more = chance.getrandbits(count)
        bits = bits | more if wanted >> place & 1 else bits & more
    return bits


def recording(nand: NandImage, log: Path) -> tuple[str, str]:
    """QEMU's arguments for a board with this flash, every change of which goes into a log."""
    log.touch()
    options = {
        "if": "mtd",
        "driver": "blklogwrites",
        "file.driver": "raw",
        "file.file.driver": "file",
        "file.file.filename": nand.path,
        "log.driver": "raw",
        "log.file.driver": "file",
        "log.file.filename": log,
    }
    return "-drive", ",".join(f"{name}={value}" for name, value in options.items())


def changes(log: Path) -> list[Change]:
    """What a log has, in order."""
    return [_change(*write) for write in _writes(log.read_bytes())]


def _writes(log: bytes) -> Iterator[tuple[int, bytes]]:
    """The first byte of each write, and what was written: whole sectors."""
    at = SECTOR  # behind the super block
    while at < len(log):
        first, sectors, flags, _ = ENTRY.unpack_from(log, at)
        at += SECTOR
        if not flags & FLAGS_WITHOUT_DATA:
            yield first * SECTOR, log[at : at + sectors * SECTOR]
            at += sectors * SECTOR


def _change(start: int, content: bytes) -> Change:
    if len(content) == BLOCK and start % BLOCK == 0:
        assert content == b"\xff" * BLOCK
        return Change(start // PAGE, content)
    # The one page within the sectors, which begin and end in its neighbours.
    page = -(-start // PAGE)
    inner = page * PAGE - start
    assert inner + PAGE <= len(content) < 2 * PAGE
    return Change(page, content[inner : inner + PAGE])
