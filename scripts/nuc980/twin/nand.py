# SPDX-License-Identifier: GPL-3.0-or-later
"""The image of the board's NAND flash as the twin keeps it: each page's data, then its spare bytes."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

DATA = 2048
SPARE = 64
PAGE = DATA + SPARE
PAGES = 64  # a block
BLOCKS = 1024
SIZE = PAGE * PAGES * BLOCKS

ERASED = 0xFF
BAD_MARK = 0x00  # as a maker leaves it: anything but 0xFF in the first spare byte of a block's first page


class NandError(Exception):
    """An image that is none of this flash, or a place outside of it."""


class NandImage:
    """A raw image file; no machine may run with it meanwhile."""

    def __init__(self, path: Path) -> None:
        self.path = path
        if not path.is_file():
            raise NandError(f"{path} is not there: NandImage.blank() makes one")
        size = path.stat().st_size
        if size != SIZE:
            raise NandError(
                f"{path} has {size} bytes: a raw image has {SIZE}, {BLOCKS} blocks of {PAGES} pages of"
                f" {DATA} bytes and {SPARE} spare ones (qemu-img convert -O raw makes one of a qcow2)"
            )

    @classmethod
    def blank(cls, path: Path) -> NandImage:
        """A new flash: all erased, no bad block."""
        block = bytes([ERASED]) * (PAGE * PAGES)
        with path.open("wb") as file:
            for _ in range(BLOCKS):
                file.write(block)
        return cls(path)

    def read(self, page: int) -> bytes:
        """A page's data, and its spare bytes."""
        with self.path.open("rb") as file:
            file.seek(_place(page))
            return file.read(PAGE)

    def write(self, page: int, content: bytes, start: int = 0) -> None:
        """Puts bytes into a page from its byte start on, as if they had always been there."""
        if start < 0 or start + len(content) > PAGE:
            raise NandError(f"{len(content)} bytes from {start} on: a page has {PAGE}")
        with self.path.open("r+b") as file:
            file.seek(_place(page) + start)
            file.write(content)

    def flip(self, page: int, bits: Iterable[int]) -> None:
        """Turns bits over, counted from the page's first byte, highest bit first."""
        content = bytearray(self.read(page))
        for bit in bits:
            if not 0 <= bit < 8 * PAGE:
                raise NandError(f"bit {bit}: a page has {8 * PAGE}")
            content[bit // 8] ^= 0x80 >> bit % 8
        self.write(page, content)

    def mark_bad(self, block: int) -> None:
        """As the maker's test marks a block that must not be used."""
        self.write(block * PAGES, bytes([BAD_MARK]), start=DATA)

    def bad_blocks(self) -> list[int]:
        return [block for block in range(BLOCKS) if self.read(block * PAGES)[DATA] != ERASED]


def _place(page: int) -> int:
    if not 0 <= page < PAGES * BLOCKS:
        raise NandError(f"page {page}: the flash has pages 0 to {PAGES * BLOCKS - 1}")
    return page * PAGE
