# SPDX-License-Identifier: GPL-3.0-or-later
"""The plan of `flash`: images into the NAND so that nothing is erased that was not verified before.

All backups; then all that fits into RAM, loaded and compared; then block by block: erase, write; then read
back. The kernel last: the flash alone cannot boot from the first erase to the end, and its part is short.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from nuc980.netboot.board import BoardReport, Nand
from nuc980.netboot.environment import IN_WORK
from nuc980.netboot.errors import FlashNotPossible
from nuc980.netboot.flash.backup import BySerial, ByTftp, Way, plan_backup
from nuc980.netboot.flash.forecast import Forecast
from nuc980.netboot.flash.images import Image, blocks_needed, programmed
from nuc980.netboot.flash.journal import NEW
from nuc980.netboot.flash.layout import ALL_DEVICE_TREES, ALL_KERNELS, LOADER, MARKS, ONE_SLOT, TABLES, UBI
from nuc980.netboot.flash.steps import (
    Announce,
    BackedUp,
    CheckRam,
    Fill,
    ReadBack,
    Verified,
    WriteBlock,
)
from nuc980.netboot.plan import SetVariable, Step
from nuc980.netboot.steps import Load, Slice
from nuc980.netboot.transport import BAUD

CHUNK = 8 << 20  # loaded, backed up and read back at once, bytes
NEEDED = ("nand", "crc32", "mw", "tftpboot")
# The tables late: a block may die before.
ORDER = (UBI, *ALL_DEVICE_TREES, *ALL_KERNELS, *MARKS, TABLES, LOADER)

# What stays free of ours: in front, vectors and boot parameters; below U-Boot, its stack.
RAM_FRONT, RAM_BACK = 0x100000, 0x100000


def check_board(board: BoardReport, needs: tuple[str, ...] = ()) -> Nand:
    """The flash, if this board and its U-Boot can do what is needed. Raises FlashNotPossible.

    needs: commands for a backup.
    """
    missing = [name for name in (*NEEDED, *needs) if not board.knows(name)]
    if missing:
        raise FlashNotPossible(f"This U-Boot has no {', '.join(missing)}.")
    nand = board.nand
    if nand is None or not nand.size or not nand.block or not nand.page or nand.size % nand.block:
        raise FlashNotPossible("U-Boot finds no NAND, or does not report its size.")
    return nand


def choose_way(board: BoardReport, wanted: str | None, nand: Nand) -> Way:
    """How to back up: with tftpput where U-Boot has it, else over the serial line."""
    if wanted == "serial" or (wanted is None and not board.knows("tftpput")):
        return BySerial(nand.block)
    return ByTftp()


# ---- where things are in RAM meanwhile


@dataclass(frozen=True)
class Ram:
    """Addresses. scratch: CHUNK bytes to read to; loads: where each image is, None for piece by piece."""

    scratch: int
    loads: dict[str, int | None]
    pieces: int  # CHUNK bytes for those

    def of(self, name: str) -> tuple[int, bool]:
        """Where an image or its pieces go, and whether all of it stays there."""
        at = self.loads[name]
        return (self.pieces, False) if at is None else (at, True)


def plan_ram(board: BoardReport, images: Sequence[Image], nand: Nand) -> Ram:
    """Room for all images beside each other, or the UBI one by pieces. Raises FlashNotPossible."""
    start = max(board.ram[0][0], RAM_FRONT)
    end = min(board.ram_end, sum(board.ram[0])) - RAM_BACK
    scratch, pieces, free = start, start + CHUNK, start + 2 * CHUNK
    loads: dict[str, int | None] = {}
    for image in sorted(images, key=lambda image: image.size):
        need = blocks_needed(image.size, nand) * nand.block
        fits = free + need <= end
        if not fits and image.name != UBI:
            break
        loads[image.name] = free if fits else None
        free += need if fits else 0
    if len(loads) < len(images) or pieces + CHUNK > end:
        raise FlashNotPossible(f"{end - start} bytes of free RAM are too few for these images.")
    return Ram(scratch, loads, pieces)


# ---- the plan


@dataclass(frozen=True)
class Work:
    """What is to be done to a board: pure facts that the plans below are made of."""

    images: tuple[Image, ...]  # in the order of writing
    nand: Nand
    ram: Ram
    content: str = NEW  # OLD: the images are backups


def plan_session(board: BoardReport) -> tuple[Step, ...]:
    """Variables: `quiet` would hide what `nand erase` says; IN_WORK tells whether the board was reset."""
    quiet = (SetVariable("quiet", ""),) if board.environment.get("quiet") else ()
    return (*quiet, SetVariable(IN_WORK, "yes"))


def plan_end() -> tuple[Step, ...]:
    """So that a saveenv by hand does not keep it: then a reset would not be noticed any more."""
    return (SetVariable(IN_WORK, ""),)


def plan_backups(work: Work, folder: Path, way: Way) -> tuple[Step, ...]:
    """Every slot that is to be erased, whole."""
    nand, ram = work.nand, work.ram
    return tuple(
        step
        for image in work.images
        for step in (
            *plan_backup(
                image.name,
                image.slot.blocks(nand),
                nand.block,
                ram.scratch,
                CHUNK,
                backup_file(folder, image),
                way,
            ),
            BackedUp(image.name, backup_file(folder, image)),
        )
    )


def backup_file(folder: Path, image: Image) -> Path:
    """Where a slot's backup is."""
    return folder / f"{image.name.replace(' ', '-').lower()}.backup"


def plan_loads(work: Work) -> tuple[Step, ...]:
    """All that stays in RAM, loaded and compared before the first erase."""
    return tuple(
        step
        for image in work.images
        if work.ram.loads[image.name] is not None
        for piece in _pieces(image, work)
        for step in _load(piece, work.nand)
    )


def plan_writing(work: Work, image: Image, first: int = 0) -> tuple[Step, ...]:
    """One image from its block number `first` on, and the reading back of all of it."""
    nand = work.nand
    blocks = image.slot.blocks(nand)
    steps: list[Step] = []
    needed = blocks_needed(image.size, nand)
    _, stays = work.ram.of(image.name)
    for piece in _pieces(image, work):
        if piece.first + len(piece.blocks) <= first:
            continue
        if not stays:
            steps += _load(piece, nand)
        steps.append(CheckRam(image.name, piece.address, piece.size, piece.crc32))
        steps += [
            WriteBlock(image.name, index, offset, nand.block, piece.address + at * nand.block, size)
            for at, (index, offset, size) in enumerate(
                zip(piece.indices, piece.blocks, piece.sizes, strict=True)
            )
            if index >= first
        ]
    steps += [
        WriteBlock(image.name, index, blocks[index], nand.block, 0, 0)
        for index in range(max(needed, first), len(blocks))
    ]
    return (*steps, *plan_reading(work, image), Verified(image.name, work.content))


def plan_reading(work: Work, image: Image) -> tuple[ReadBack, ...]:
    """All of an image's slot."""
    nand = work.nand
    blocks = image.slot.blocks(nand)
    count = CHUNK // nand.block
    return tuple(
        ReadBack(
            image.name,
            image.slot.offset if first == 0 else blocks[first],
            first,
            blocks[first : first + count],
            nand.block,
            work.ram.scratch,
            tuple(
                zlib.crc32(image.content(index * nand.block, nand.block))
                for index in range(first, min(first + count, len(blocks)))
            ),
            zlib.crc32(image.content(first * nand.block, len(blocks[first : first + count]) * nand.block)),
        )
        for first in range(0, len(blocks), count)
    )


def plan_flash(work: Work) -> tuple[Step, ...]:
    """Loads, the warning, the writing of all images, and the end."""
    writing = (step for image in work.images for step in plan_writing(work, image))
    return (*plan_opening(work), *writing, *plan_end())


def plan_opening(work: Work) -> tuple[Step, ...]:
    return (*plan_loads(work), Announce(warning(work))) if work.images else ()


def warning(work: Work) -> str:
    """What the reader must know before the first erase."""
    writing = (step for image in work.images for step in plan_writing(work, image))
    seconds = Forecast(writing, BAUD).left(0.0)
    names = ", ".join(image.name for image in work.images)
    if {image.name for image in work.images} in ONE_SLOT:
        return (
            f"From here on, for about {seconds:.0f} s, {names} are written; the board boots its other slot."
        )
    if any(image.name == LOADER for image in work.images):
        return (
            f"From here to the end, for about {seconds:.0f} s, a board that loses power cannot even start"
            " U-Boot, and only a programmer can bring it back. Do not switch it off."
        )
    return (
        f"From here to the end, for about {seconds:.0f} s, the flash alone cannot boot ({names}). If it is"
        " interrupted: U-Boot is not touched; `nuc980-netboot boot` starts the board from the network, and"
        " `flash --resume` or `flash --roll-back` bring the flash to its end."
    )


def in_order(images: Sequence[Image]) -> tuple[Image, ...]:
    """UBI, device trees, kernels: a kernel's slot is without a kernel for the shortest time; then marks."""
    return tuple(sorted(images, key=lambda image: ORDER.index(image.name)))


@dataclass(frozen=True)
class _Piece:
    """At most CHUNK bytes of an image."""

    name: str
    first: int
    blocks: tuple[int, ...]
    sizes: tuple[int, ...]  # to write of each block
    address: int
    source: Slice
    size: int  # with what fills its last block
    crc32: int  # of that

    @property
    def indices(self) -> range:
        return range(self.first, self.first + len(self.blocks))


def _pieces(image: Image, work: Work) -> Iterator[_Piece]:
    nand = work.nand
    blocks = image.slot.blocks(nand)[: blocks_needed(image.size, nand)]
    base, stays = work.ram.of(image.name)
    count = CHUNK // nand.block
    for first in range(0, len(blocks), count):
        some = blocks[first : first + count]
        start, size = first * nand.block, len(some) * nand.block
        content = image.content(start, size)
        own = min(size, image.size - start)
        yield _Piece(
            f"{image.name.replace(' ', '-')}-{first}",
            first,
            some,
            tuple(programmed(content[at : at + nand.block], nand.page) for at in range(0, size, nand.block)),
            base + start if stays else base,
            Slice(image.path, start, own, zlib.crc32(content[:own])),
            size,
            zlib.crc32(content),
        )


def _load(piece: _Piece, nand: Nand) -> tuple[Step, ...]:
    rest = piece.size - piece.source.size
    fill = (Fill(piece.address + piece.source.size, rest),) if rest else ()
    return (Load(piece.name, piece.source, piece.address), *fill)
