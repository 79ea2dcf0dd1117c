# SPDX-License-Identifier: GPL-3.0-or-later
"""Where slots and marks are in the flash: image-limits.toml, less what is bad on this board."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from nuc980.netboot.board import Nand
from nuc980.netboot.errors import FlashNotPossible, LayoutUnknown
from nuc980.netboot.flash import layout
from nuc980.netboot.limits import BLOCK, FLASH, MARKS, PAGE, ROOT_OFFSET, ROOT_SIZE, SLOTS, UIMAGE_AT

NAMES = ("a", "b")


@dataclass(frozen=True)
class Area:
    """A part of the flash. Bytes; room: without the blocks that may be bad."""

    offset: int
    size: int
    room: int

    @classmethod
    def of(cls, row: Mapping[str, Any]) -> Area:
        return cls(row["offset"], row["size"], row["size"] - row.get("reserve", 0) * BLOCK)

    @property
    def end(self) -> int:
        return self.offset + self.size

    def named(self, name: str, address: int | None = None) -> layout.Slot:
        """As `flash` takes it; address: in RAM."""
        return layout.Slot(name, self.offset, self.end, self.room, address=address)

    def first_good(self, nand: Nand) -> int:
        """The offset of its first good block. Raises LayoutUnknown."""
        for offset in range(self.offset, self.end, BLOCK):
            if offset not in nand.bad:
                return offset
        raise LayoutUnknown(
            f"All blocks of {self.offset:#x}..{self.end:#x} are bad: no place for a mark.",
            cause="a worn flash",
            next_step="this board boots from the network, or without slots, by `flash`",
        )


@dataclass(frozen=True)
class Places:
    """A slot's."""

    kernel: Area
    device_tree: Area

    def named(self) -> tuple[tuple[str, Area], ...]:
        """As Linux' partitions of a board with slots are called, before their slot's name."""
        return ("kernel", self.kernel), ("tree", self.device_tree)


PLACES = {name: Places(Area.of(SLOTS[name]["kernel"]), Area.of(SLOTS[name]["device_tree"])) for name in NAMES}
BASE = tuple(Area.of(MARKS[name]) for name in ("base_1", "base_2"))
TRIAL = Area.of(MARKS["trial"])
ROOT = Area(ROOT_OFFSET, ROOT_SIZE, ROOT_SIZE)


def root_volume(name: str) -> str:
    """A slot's root file system in UBI, where it is not inside the kernel."""
    return f"root_{name}"


def check_flash(nand: Nand) -> None:
    """Raises FlashNotPossible for a chip that these places are not made for."""
    if (nand.size, nand.block, nand.page) != (FLASH, BLOCK, PAGE):
        raise FlashNotPossible(
            f"The slots are laid out for {FLASH} bytes in blocks of {BLOCK} and pages of {PAGE};"
            f" this flash has {nand.size}, {nand.block} and {nand.page}."
        )


def kernel_slot(name: str) -> layout.Slot:
    return PLACES[name].kernel.named(layout.KERNELS[name], UIMAGE_AT)


def tree_slot(name: str) -> layout.Slot:
    return PLACES[name].device_tree.named(layout.DEVICE_TREES[name])
