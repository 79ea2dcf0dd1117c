# SPDX-License-Identifier: GPL-3.0-or-later
"""The plan of `flash`: images into the NAND so that nothing is erased that was not verified before.

All backups; then all that fits into RAM, loaded and compared; then block by block: erase, write; then read
back. The kernel last: the flash alone cannot boot from the first erase to the end, and its part is short.
"""

from __future__ import annotations

import hashlib
import struct
import time
import zlib
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import Any, ClassVar

from nuc980.netboot.backup import (
    BySerial,
    ByTftp,
    Way,
    check_room,
    nand_read,
    plan_backup,
    ram_crc,
    reads_well,
)
from nuc980.netboot.errors import (
    DoesNotFit,
    FlashFailed,
    FlashNotPossible,
    JournalUnusable,
    LineUnsafe,
    WrongBytes,
    WrongImage,
)
from nuc980.netboot.journal import NEW, OLD, Event, Journal
from nuc980.netboot.layout import DEVICE_TREE, KERNEL, LOADER, UBI, Slot
from nuc980.netboot.plan import SetVariable, Step
from nuc980.netboot.probe import BoardReport, Nand, probe_nand
from nuc980.netboot.session import Session
from nuc980.netboot.steps import PATIENCE, Load, Slice

CHUNK = 8 << 20  # loaded, backed up and read back at once, bytes
NEEDED = ("nand", "crc32", "mw", "tftpboot")
ORDER = (UBI, DEVICE_TREE, KERNEL, LOADER)
ERASED = 0xFF
POISON = 0x0DEFACED

# What stays free of ours: in front, vectors and boot parameters; below U-Boot, its stack.
RAM_FRONT, RAM_BACK = 0x100000, 0x100000
ERASE_SECONDS, WRITE_SPEED, READ_SPEED = 0.005, 1_000_000, 3_000_000  # a slow one: for the forecast only
BLOCK_SECONDS = 30.0  # patience with an erase or a write of one block


# ---- images


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
        return cls.of(slot, path, _programmed(path.read_bytes(), page))

    def content(self, start: int, size: int) -> bytes:
        """What belongs to so many bytes of the slot, counted over its good blocks."""
        with self.path.open("rb") as file:
            file.seek(start)
            own = file.read(max(min(size, self.size - start), 0))
        return own.ljust(size, bytes([ERASED]))


def check_image(name: str, path: Path, nand: Nand) -> None:
    """That a file is what it is to be written as. Raises WrongImage."""
    _CHECKS[name](path, path.read_bytes(), nand)


def _check_kernel(path: Path, content: bytes, nand: Nand) -> None:
    if len(content) < 64 or content[:4] != b"\x27\x05\x19\x56":
        raise WrongImage(f"{path} is no uImage: it does not begin with 27051956.")
    header_crc, size, data_crc = struct.unpack_from(">4xI4xI8xI", content)
    if zlib.crc32(content[:4] + bytes(4) + content[8:64]) != header_crc:
        raise WrongImage(f"{path}: the header does not match its CRC.")
    if len(content) != 64 + size or zlib.crc32(content[64:]) != data_crc:
        raise WrongImage(f"{path}: what follows the header does not match its size or CRC.")


def _check_device_tree(path: Path, content: bytes, nand: Nand) -> None:
    magic, size = struct.unpack_from(">II", content.ljust(8, b"\0"))
    if magic != 0xD00DFEED or size != len(content):
        raise WrongImage(f"{path} is no compiled device tree of its own {len(content)} bytes.")


def _check_ubi(path: Path, content: bytes, nand: Nand) -> None:
    """The header that begins each block: Linux's drivers/mtd/ubi/ubi-media.h, struct ubi_ec_hdr."""
    if not content or len(content) % nand.block:
        raise WrongImage(f"{path} has {len(content)} bytes, not a whole number of blocks of {nand.block}.")
    for at in range(0, len(content), nand.block):
        header = content[at : at + 64]
        magic, version, vid, data, crc = struct.unpack(">4sB11xII36xI", header)
        if magic != b"UBI#" or version != 1 or zlib.crc32(header[:60]) ^ 0xFFFFFFFF != crc:
            raise WrongImage(
                f"{path} is no UBI image with blocks of {nand.block}: no good header at {at:#x}."
            )
        if (vid, data) != (nand.page, 2 * nand.page):
            raise WrongImage(f"{path} was made for another page size: headers at {vid}, data at {data}.")


def _check_loader(path: Path, content: bytes, nand: Nand) -> None:
    if len(content) < 32 or content[3] != 0xEA:
        raise WrongImage(f"{path} does not begin as U-Boot for ARM does, with a branch.")


_CHECKS: dict[str, Callable[[Path, bytes, Nand], None]] = {
    KERNEL: _check_kernel,
    DEVICE_TREE: _check_device_tree,
    UBI: _check_ubi,
    LOADER: _check_loader,
}


def check_board(board: BoardReport, way: Way | None) -> Nand:
    """The flash, if this board and its U-Boot can do what is needed. Raises FlashNotPossible."""
    missing = [name for name in NEEDED if not board.knows(name)]
    if isinstance(way, ByTftp) and not board.knows("tftpput"):
        missing.append("tftpput")
    if isinstance(way, BySerial) and not board.knows("md"):
        missing.append("md")
    if missing:
        raise FlashNotPossible(f"This U-Boot has no {', '.join(missing)}.")
    nand = board.nand
    if nand is None or not nand.size or not nand.block or not nand.page or nand.size % nand.block:
        raise FlashNotPossible("U-Boot sees no NAND, or does not say its size.")
    return nand


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
        need = _blocks(image.size, nand) * nand.block
        fits = free + need <= end
        if not fits and image.name != UBI:
            break
        loads[image.name] = free if fits else None
        free += need if fits else 0
    if len(loads) < len(images) or pieces + CHUNK > end:
        raise FlashNotPossible(f"{end - start} bytes of free RAM are too few for these images.")
    return Ram(scratch, loads, pieces)


# ---- steps


@dataclass(frozen=True)
class FlashStep(Step):
    """A step that the journal tells apart."""

    image: str

    def record(self) -> Event:
        """What the journal keeps of it."""
        return {"image": self.image}


@dataclass(frozen=True)
class Announce(Step):
    """Tells the reader something before it happens."""

    text: str
    phase: ClassVar[str] = "flash"

    def title(self) -> str:
        return self.text

    def commands(self) -> tuple[str, ...]:
        return ()

    def run(self, session: Session) -> None:
        return


@dataclass(frozen=True)
class Fill(Step):
    """0xFF behind an image in RAM, up to the end of its last block."""

    address: int
    size: int
    phase: ClassVar[str] = "load"

    def title(self) -> str:
        return f"Fill {self.size} bytes from {self.address:#x} on with 0xFF."

    def commands(self) -> tuple[str, ...]:
        return (f"mw.b {self.address:#x} {ERASED:#x} {self.size:#x}",)

    def run(self, session: Session) -> None:
        session.console.run(self.commands()[0], PATIENCE).required()


@dataclass(frozen=True)
class CheckRam(FlashStep):
    """That RAM still holds what was loaded, just before it is needed."""

    address: int
    size: int
    crc32: int
    phase: ClassVar[str] = "load"

    def title(self) -> str:
        return f"Check the {self.image} in RAM."

    def commands(self) -> tuple[str, ...]:
        return (f"crc32 {self.address:#x} {self.size:#x}",)

    def run(self, session: Session) -> None:
        found = ram_crc(session, self.address, self.size)
        if found != self.crc32:
            raise WrongBytes(f"The {self.image} in RAM: CRC32 {found:08x}, and {self.crc32:08x} in the file.")


class BlockFailed(FlashFailed):
    """A block does not take what is written. index: which of the slot's good blocks; offset: in the flash."""

    def __init__(self, image: str, index: int, offset: int, what: str) -> None:
        super().__init__(f"The block at {offset:#x} ({image}) fails: {what}")
        self.image, self.index, self.offset = image, index, offset


@dataclass(frozen=True)
class WriteBlock(FlashStep):
    """Erases one block and programs its first `size` bytes; the pages behind them stay erased, for UBIFS."""

    index: int
    offset: int
    block: int
    address: int
    size: int
    phase: ClassVar[str] = "flash"

    def title(self) -> str:
        done = f"write {self.size} bytes" if self.size else "leave it erased"
        return f"Erase the block at {self.offset:#x} ({self.image}), {done}."

    def commands(self) -> tuple[str, ...]:
        erase = f"nand erase {self.offset:#x} {self.block:#x}"
        if not self.size:
            return (erase,)
        return erase, f"nand write {self.address:#x} {self.offset:#x} {self.size:#x}"

    def record(self) -> Event:
        return {"image": self.image, "offset": self.offset, "erases": True}

    def run(self, session: Session) -> None:
        for _ in range(3):
            try:
                return self._run(session)
            except LineUnsafe as error:  # whether it was written is unknown: from the erase on again
                lost = error
        raise lost

    def _run(self, session: Session) -> None:
        erase, *write = self.commands()
        answer = session.console.run(erase, BLOCK_SECONDS)
        # U-Boot says OK even of a bad block, and of one that did not erase; this line, of one that did.
        if answer.status or f"Erasing at {self.offset:#x} -- 100% complete." not in answer.output:
            self._fail(answer.output)
        if "Skipping bad block" in answer.output or "failure" in answer.output:
            self._fail(answer.output)
        for command in write:
            answer = session.console.run(command, BLOCK_SECONDS, repeatable=False)
            if answer.status or f" {self.size} bytes written: OK" not in answer.output:
                self._fail(answer.output)
            if "Skip bad block" in answer.output:
                self._fail(answer.output)

    def _fail(self, said: str) -> None:
        raise BlockFailed(self.image, self.index, self.offset, said.strip()[-300:] or "without a word")


@dataclass(frozen=True)
class ReadBack(FlashStep):
    """Reads good blocks as the boot command does, over RAM that holds something else; compares the CRC32."""

    offset: int
    first: int  # the index of its first block
    blocks: tuple[int, ...]  # their offsets
    block: int
    address: int
    sums: tuple[int, ...]  # what each block's CRC32 must be
    crc32: int  # what that of all must be
    phase: ClassVar[str] = "read back"

    @property
    def size(self) -> int:
        return len(self.blocks) * self.block

    def title(self) -> str:
        return f"Read back {self.size} bytes of the {self.image} from {self.offset:#x}."

    def commands(self) -> tuple[str, ...]:
        return (
            _poison(self.address, self.size),
            nand_read(self.address, self.offset, self.size),
            f"crc32 {self.address:#x} {self.size:#x}",
        )

    def matches(self, session: Session) -> bool:
        """Whether the flash holds it."""
        return _reads_as(session, self.address, self.offset, self.size, self.crc32)

    def run(self, session: Session) -> None:
        if self.matches(session):
            return
        for index, (offset, wanted) in enumerate(zip(self.blocks, self.sums, strict=True), self.first):
            if not _reads_as(session, self.address, offset, self.block, wanted):
                raise BlockFailed(self.image, index, offset, "it does not read back as written")
        raise FlashFailed(
            f"The {self.image} does not read back as written, and each of its blocks alone does.",
            cause="a read beyond what the bad blocks leave, or RAM",
        )


@dataclass(frozen=True)
class Verified(FlashStep):
    """The end of an image's work."""

    content: str  # NEW or OLD
    phase: ClassVar[str] = "read back"

    def title(self) -> str:
        return f"The {self.image}: {'written' if self.content == NEW else 'restored'}, and read back."

    def commands(self) -> tuple[str, ...]:
        return ()

    def run(self, session: Session) -> None:
        return


def _poison(address: int, size: int) -> str:
    return f"mw.l {address:#x} {POISON:#x} {size // 4:#x}"


def _reads_as(session: Session, address: int, offset: int, size: int, crc32: int) -> bool:
    session.console.run(_poison(address, size), PATIENCE).required()
    return reads_well(session, address, offset, size) and ram_crc(session, address, size) == crc32


# ---- the plan


@dataclass(frozen=True)
class Work:
    """What is to be done to a board: pure facts that the plans below are made of."""

    images: tuple[Image, ...]  # in the order of writing
    nand: Nand
    ram: Ram
    content: str = NEW  # OLD: the images are backups

    def retired(self, nand: Nand) -> Work:
        """The same with the bad blocks of now."""
        return replace(self, nand=nand)


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


@dataclass(frozen=True)
class BackedUp(FlashStep):
    """The end of a slot's backup."""

    file: Path
    phase: ClassVar[str] = "back up"

    def title(self) -> str:
        return f"The {self.image}'s place is backed up."

    def commands(self) -> tuple[str, ...]:
        return ()

    def run(self, session: Session) -> None:
        return


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
    needed = _blocks(image.size, nand)
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
    """Loads, the warning, and the writing of all images."""
    return (*_plan_opening(work), *(step for image in work.images for step in plan_writing(work, image)))


def _plan_opening(work: Work) -> tuple[Step, ...]:
    return (*plan_loads(work), Announce(warning(work))) if work.images else ()


def warning(work: Work) -> str:
    """What the reader must know before the first erase."""
    seconds = sum(
        len(image.slot.blocks(work.nand)) * (ERASE_SECONDS + work.nand.block / READ_SPEED)
        + image.size / WRITE_SPEED
        for image in work.images
    )
    names = ", ".join(image.name for image in work.images)
    if any(image.name == LOADER for image in work.images):
        return (
            f"From here to the end, for about {seconds:.0f} s, a board that loses power cannot even start"
            " U-Boot, and there is no way back but a programmer. Do not switch it off."
        )
    return (
        f"From here to the end, for about {seconds:.0f} s, the flash alone cannot boot ({names}). If it is"
        " interrupted: U-Boot is not touched; `nuc980-netboot boot` starts the board from the network, and"
        " `flash --resume` or `flash --roll-back` bring the flash to its end."
    )


def in_order(images: Sequence[Image]) -> tuple[Image, ...]:
    """UBI, device tree, kernel: the kernel's slot is without a kernel for the shortest time."""
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
    blocks = image.slot.blocks(nand)[: _blocks(image.size, nand)]
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
            tuple(_programmed(content[at : at + nand.block], nand.page) for at in range(0, size, nand.block)),
            base + start if stays else base,
            Slice(image.path, start, own, zlib.crc32(content[:own])),
            size,
            zlib.crc32(content),
        )


def _load(piece: _Piece, nand: Nand) -> tuple[Step, ...]:
    rest = piece.size - piece.source.size
    fill = (Fill(piece.address + piece.source.size, rest),) if rest else ()
    return (Load(piece.name, piece.source, piece.address), *fill)


def _blocks(size: int, nand: Nand) -> int:
    return -(-size // nand.block)


def _programmed(content: bytes, page: int) -> int:
    """How many bytes are left when the pages at the end that are all 0xFF are not written."""
    used = len(content.rstrip(bytes([ERASED])))
    return -(-used // page) * page


# ---- doing it


@dataclass
class Flasher:
    """Does a plan's steps with a journal, and goes around blocks that fail."""

    session: Session
    journal: Journal
    work: Work
    seconds: float = 0.0  # from the first erase to the last byte read back
    kernel_seconds: float = 0.0  # of that, the kernel's

    def run(self, before: Sequence[Step], images: Sequence[Image]) -> None:
        """The steps, then these images; then the journal is finished. Raises NetbootError."""
        self._do([*before, *_plan_opening(replace(self.work, images=tuple(images)))])
        started = time.monotonic()
        for image in images:
            begun = time.monotonic()
            self._write(image)
            self.seconds = time.monotonic() - started
            if image.name == KERNEL:
                self.kernel_seconds = time.monotonic() - begun
        self.journal.add("finished", content=self.work.content)

    def _write(self, image: Image) -> None:
        failures: Counter[int] = Counter()
        first = 0
        while True:
            try:
                return self._do(plan_writing(self.work, image, first))
            except BlockFailed as failed:
                self.session.progress.note(f"  {failed.what}")
                self.journal.add("failed", image=image.name, offset=failed.offset, said=failed.what)
                failures[failed.offset] += 1
                if failures[failed.offset] > 1:
                    self._retire(failed, image)
                first = failed.index

    def _retire(self, failed: BlockFailed, image: Image) -> None:
        """Twice is enough: the block is marked as bad, and the image goes on behind it."""
        if image.name == LOADER:
            raise FlashFailed(f"{failed.what}. The SPL knows no bad blocks.", next_step=_STAY)
        console = self.session.console
        self.journal.add("bad", offset=failed.offset)
        console.run(
            f"nand markbad {failed.offset:#x}", BLOCK_SECONDS
        )  # what it says of a worn block is an error
        nand = probe_nand(console)
        if nand is None or failed.offset not in nand.bad:
            raise FlashFailed(f"{failed.what}, and cannot be marked as bad.")
        self.session.progress.note(f"  The block at {failed.offset:#x} is bad now, and left out.")
        self.work = self.work.retired(nand)
        try:
            image.slot.check_fits(image.size, nand)
        except DoesNotFit as error:
            raise FlashFailed(f"{failed.what}. Without it: {error.what}") from failed

    def _do(self, steps: Sequence[Step]) -> None:
        """Blocks are shown as a bar, all else by its title."""
        progress = self.session.progress
        for writes, some in groupby(steps, lambda step: isinstance(step, WriteBlock)):
            group = list(some)
            if not writes:
                for step in group:
                    progress.note(step.title())
                    self._do_one(step)
                continue
            title = f"erase and write {len(group)} blocks"
            with progress.bar(title, len(group), "blocks") as bar:
                for done, step in enumerate(group, 1):
                    self._do_one(step)
                    bar.at(done)

    def _do_one(self, step: Step) -> None:
        facts = step.record() if isinstance(step, FlashStep) else {}
        self.journal.add("begin", step=step.title(), **facts)
        with self.session.progress.phase(step.phase):
            step.run(self.session)
        self.journal.add("end", step=step.title(), **facts)
        self._note_milestone(step)

    def _note_milestone(self, step: Step) -> None:
        match step:
            case Verified():
                self.journal.add("verified", image=step.image, content=step.content)
            case BackedUp():
                self.journal.add("backup", image=step.image, **_file_facts(step.file))


_STAY = "do not switch the board off: U-Boot still runs; flash --roll-back restores the old one"


def _file_facts(path: Path) -> dict[str, Any]:
    content = path.read_bytes()
    return {
        "file": path.name,
        "size": len(content),
        "crc32": zlib.crc32(content),
        "sha256": hashlib.sha256(content).hexdigest(),
    }


# ---- from and to the journal


def header_of(work: Work, board: BoardReport, no_backup: str | None) -> Event:
    """What a journal begins with: all that --resume and --roll-back need."""
    nand = work.nand
    return {
        "version": 1,
        "uboot": board.version,
        "nand": {"size": nand.size, "block": nand.block, "page": nand.page, "bad": list(nand.bad)},
        "no_backup": no_backup,
        "images": [
            {
                "image": image.name,
                "slot": {
                    "offset": image.slot.offset,
                    "end": image.slot.end,
                    "room": image.slot.room,
                    "limit": image.slot.limit,
                },
                "path": str(image.path.resolve()),
                "size": image.size,
                "crc32": image.crc32,
                "sha256": image.sha256,
            }
            for image in work.images
        ],
    }


def images_of(journal: Journal) -> tuple[Image, ...]:
    """The images of a journal, whose files must be what they were. Raises JournalUnusable."""
    images = []
    for entry in journal.header["images"]:
        image = _image_of(entry, Path(entry["path"]))
        if image.sha256 != entry["sha256"]:
            raise JournalUnusable(
                f"{image.path} is another file than {journal.folder} began with.",
                next_step="put the file back, or flash --roll-back",
            )
        images.append(image)
    return tuple(images)


def backups_of(journal: Journal, nand: Nand) -> tuple[Image, ...]:
    """What --roll-back writes: the backups of all that may have been erased. Raises JournalUnusable."""
    images = []
    for entry in journal.header["images"]:
        backup = journal.backup_of(entry["image"])
        if backup is None:
            if journal.content_of(entry["image"]) == OLD:
                continue  # nothing was erased
            raise JournalUnusable(
                f"{journal.folder}: the {entry['image']} was written without a backup"
                f" ({journal.header['no_backup']}).",
                next_step="flash --resume",
            )
        path = journal.folder / backup["file"]
        if not path.exists() or _file_facts(path)["sha256"] != backup["sha256"]:
            raise JournalUnusable(f"{path} is not the backup any more.", next_step="flash --resume")
        images.append(Image.of_backup(_slot_of(entry), path, nand.page))
    return tuple(images)


def _image_of(entry: Event, path: Path) -> Image:
    if not path.exists():
        raise JournalUnusable(f"{path} is gone.", next_step="put the file back, or flash --roll-back")
    return Image.of(_slot_of(entry), path)


def _slot_of(entry: Event) -> Slot:
    slot = entry["slot"]
    limit = tuple(slot["limit"]) if slot["limit"] else None
    return Slot(entry["image"], slot["offset"], slot["end"], slot["room"], limit)


def check_same_board(journal: Journal, nand: Nand) -> None:
    """Raises JournalUnusable for a flash that cannot be the journal's: blocks never get good again."""
    then = journal.header["nand"]
    same = (then["size"], then["block"], then["page"]) == (nand.size, nand.block, nand.page)
    if not same or not set(then["bad"]) <= set(nand.bad):
        raise JournalUnusable(
            f"{journal.folder} is of another board: size, blocks or bad blocks of its flash differ.",
            cause="--site names another board's folder",
            next_step="name this board's site",
        )


def still_to_do(session: Session, journal: Journal, work: Work) -> tuple[Image, ...]:
    """The images that the flash does not hold for certain.

    A place that was begun and not read back afterwards counts as torn, even when it reads right now: what an
    interrupted erase or program leaves can read right today and wrong tomorrow.
    """
    images = []
    for image in work.images:
        known = journal.content_of(image.name) == work.content
        if known and all(step.matches(session) for step in plan_reading(work, image)):
            session.progress.note(f"The {image.name} is there already, read back.")
        else:
            images.append(image)
    return tuple(images)


def not_backed_up(session: Session, journal: Journal, work: Work) -> tuple[Image, ...]:
    """The images whose place was never erased and has no backup that is still what is there."""
    images = []
    for image in work.images:
        if journal.content_of(image.name) != OLD:
            continue
        backup = journal.backup_of(image.name)
        if backup is None:
            images.append(image)
            continue
        old = Image.of_backup(image.slot, journal.folder / backup["file"], work.nand.page)
        if not all(step.matches(session) for step in plan_reading(work, old)):
            session.progress.note(f"What is in the {image.name}'s place changed since its backup.")
            images.append(image)
    return tuple(images)


def quiet_off(board: BoardReport) -> tuple[Step, ...]:
    """`quiet` would hide what `nand erase` says of bad blocks."""
    return (SetVariable("quiet", ""),) if board.environment.get("quiet") else ()


def choose_way(board: BoardReport, wanted: str | None, nand: Nand) -> Way:
    """How to back up: with tftpput where U-Boot has it, else over the serial line."""
    if wanted == "serial" or (wanted is None and not board.knows("tftpput")):
        return BySerial(nand.block)
    return ByTftp()


def prepare(journal: Journal, work: Work, way: Way | None) -> tuple[Step, ...]:
    """The backups of a new flash, or none."""
    if way is None:
        return ()
    check_room(
        journal.folder, sum(len(image.slot.blocks(work.nand)) for image in work.images) * work.nand.block
    )
    return plan_backups(work, journal.folder, way)
