# SPDX-License-Identifier: GPL-3.0-or-later
"""The flash chip: 1024 blocks of 64 pages of 2048 bytes; of the spare bytes only the ECC's verdict."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Literal

PAGE = 2048
BLOCK = 0x20000
SIZE = 0x8000000


@dataclass(frozen=True)
class Operation:
    """An erase or a program that the chip has seen: its first byte, how many, and whether it succeeded."""

    kind: Literal["erase", "program"]
    address: int
    size: int
    good: bool


class Nand:
    """Programming only clears bits. A page programmed twice does not fit its ECC, but with the same bytes.

    journal: all that was done to the chip, in order. `load` is not in it.
    """

    def __init__(self) -> None:
        self.bad: set[int] = set()  # numbers of blocks
        self.journal: list[Operation] = []
        self.witness: Callable[[Operation], None] = lambda operation: None  # called before each
        self._blocks: dict[int, bytearray] = {}
        self._misfit: set[int] = set()  # numbers of pages that do not fit their ECC

    def load(self, address: int, data: bytes) -> None:
        """What the factory has left at an address; the blocks that it touches are erased before."""
        for block, offset, part in _by_block(address, data):
            self._blocks[block] = bytearray(b"\xff" * BLOCK)
            self._blocks[block][offset : offset + len(part)] = part

    def content(self, address: int, size: int) -> bytes:
        """The bytes as they are, bad blocks among them."""
        erased = b"\xff" * BLOCK
        first, last = address // BLOCK, (address + size - 1) // BLOCK
        blocks = b"".join(self._blocks.get(block, erased) for block in range(first, last + 1))
        return blocks[address - first * BLOCK :][:size]

    def fits(self, address: int, size: int) -> bool:
        """Whether the ECC of all pages of the range is right."""
        return self._misfit.isdisjoint(_pages(address, size))

    def erase(self, block: int, good: bool = True) -> None:
        """Makes a block all ones; one that fails stays as it is."""
        self._record("erase", block * BLOCK, BLOCK, good)
        if good:
            self._blocks.pop(block, None)
            self._misfit.difference_update(_pages(block * BLOCK, BLOCK))

    def program(self, address: int, data: bytes, good: bool = True) -> None:
        """Clears bits within one block. With good=False the first page fits no ECC, and the rest is left."""
        self._record("program", address, len(data), good)
        block, offset = divmod(address, BLOCK)
        cells = self._blocks.setdefault(block, bytearray(b"\xff" * BLOCK))
        for start in range(0, len(data) if good else PAGE, PAGE):
            page = slice(offset + start, offset + start + len(data[start : start + PAGE]))
            wanted, old = data[start : start + PAGE], bytes(cells[page])
            cells[page] = (int.from_bytes(old) & int.from_bytes(wanted)).to_bytes(len(old))
            if cells[page] != wanted or not good:
                self._misfit.add((address + start) // PAGE)

    def wear(self, address: int, mask: int = 0xFF) -> None:
        """Turns bits of a byte over, unseen by the ECC."""
        block, offset = divmod(address, BLOCK)
        self._blocks.setdefault(block, bytearray(b"\xff" * BLOCK))[offset] ^= mask

    def spoil(self, address: int) -> None:
        """More wrong bits in a page than its ECC can correct."""
        self._misfit.add(address // PAGE)

    def _record(self, kind: Literal["erase", "program"], address: int, size: int, good: bool) -> None:
        operation = Operation(kind, address, size, good)
        self.witness(operation)
        self.journal.append(operation)


def _pages(address: int, size: int) -> Iterable[int]:
    return range(address // PAGE, (address + size + PAGE - 1) // PAGE)


def _by_block(address: int, data: bytes) -> Iterator[tuple[int, int, bytes]]:
    at = 0
    while at < len(data):
        block, offset = divmod(address + at, BLOCK)
        part = data[at : at + BLOCK - offset]
        yield block, offset, part
        at += len(part)
