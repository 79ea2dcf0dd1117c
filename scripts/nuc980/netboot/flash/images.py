# SPDX-License-Identifier: GPL-3.0-or-later
"""Images for the flash: what a file must be to be written, and what belongs into each block."""

from __future__ import annotations

import hashlib
import struct
import zlib
from dataclasses import dataclass
from pathlib import Path

from nuc980.netboot.board import Nand
from nuc980.netboot.errors import UnusableImage
from nuc980.netboot.flash import layout
from nuc980.netboot.flash.layout import Slot
from nuc980.netboot.uimage import UImage, check_place, read_tree, read_uimage

ERASED = 0xFF


@dataclass(frozen=True)
class Image:
    """What a slot is to hold: the first `size` bytes of a file, and 0xFF up to the slot's end."""

    slot: Slot
    path: Path
    size: int
    crc32: int
    sha256: str

    @property
    def name(self) -> str:
        """The slot's."""
        return self.slot.name

    @classmethod
    def of(cls, slot: Slot, path: Path, size: int | None = None) -> Image:
        """As the file is now; size: how much of it counts."""
        content = path.read_bytes()[:size]
        return cls(slot, path, len(content), zlib.crc32(content), hashlib.sha256(content).hexdigest())

    @classmethod
    def of_backup(cls, slot: Slot, path: Path, page: int) -> Image:
        """A backup, without the erased pages at its end."""
        return cls.of(slot, path, programmed(path.read_bytes(), page))

    def check_unchanged(self) -> None:
        """That the file is the one that was checked. Raises UnusableImage."""
        if Image.of(self.slot, self.path, self.size) != self:
            raise UnusableImage(
                f"{self.path} changed while the board was worked with.",
                cause="a build that writes it meanwhile",
                next_step="wait until it is whole, and start again",
            )

    def content(self, start: int, size: int) -> bytes:
        """What belongs to so many bytes of the slot, counted over its good blocks."""
        with self.path.open("rb") as file:
            file.seek(start)
            own = file.read(max(min(size, self.size - start), 0))
        return own.ljust(size, bytes([ERASED]))


def check_image(image: Image, nand: Nand) -> None:
    """That a file is what it is to be written as, and fits. Raises UnusableImage, DoesNotFit."""
    match image.name:
        case name if name in layout.ALL_KERNELS:
            kernel = read_uimage(image.path)
            if image.slot.address is not None:
                check_place(image.path, kernel, image.slot.address + UImage.LAYOUT.size)
        case layout.DEVICE_TREE:
            read_tree(image.path)
        case layout.UBI:
            _check_ubi(image.path, image.path.read_bytes(), nand)
        case layout.LOADER:
            _check_loader(image.path, image.path.read_bytes())
    image.slot.check_fits(image.size, nand)


def _check_ubi(path: Path, content: bytes, nand: Nand) -> None:
    """The header that begins each block: Linux's drivers/mtd/ubi/ubi-media.h, struct ubi_ec_hdr."""
    made = f"make it with ubinize -p {nand.block} -m {nand.page}"
    if not content or len(content) % nand.block:
        raise UnusableImage(
            f"{path} has {len(content)} bytes, not a whole number of blocks of {nand.block}.", next_step=made
        )
    for at in range(0, len(content), nand.block):
        header = content[at : at + 64]
        magic, version, vid, data, crc = struct.unpack(">4sB11xII36xI", header)
        if magic != b"UBI#" or version != 1 or zlib.crc32(header[:60]) ^ 0xFFFFFFFF != crc:
            raise UnusableImage(
                f"{path} is not a UBI image with blocks of {nand.block}: no good header at {at:#x}.",
                next_step=made,
            )
        if (vid, data) != (nand.page, 2 * nand.page):
            raise UnusableImage(
                f"{path} was made for another page size: headers at {vid}, data at {data}.", next_step=made
            )


def _check_loader(path: Path, content: bytes) -> None:
    if len(content) < 32 or content[3] != 0xEA:
        raise UnusableImage(
            f"{path} does not begin as U-Boot for ARM does, with a branch.", next_step="take u-boot.bin"
        )


def blocks_needed(size: int, nand: Nand) -> int:
    return -(-size // nand.block)


def programmed(content: bytes, page: int) -> int:
    """How many bytes are left when the pages at the end that are all 0xFF are not written."""
    used = len(content.rstrip(bytes([ERASED])))
    return -(-used // page) * page
