# SPDX-License-Identifier: GPL-3.0-or-later
"""Does the plan of a flash with a journal; goes around blocks that fail, goes on after an interruption."""

from __future__ import annotations

import hashlib
import time
import zlib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import Any

from nuc980.netboot.board import BoardReport, Nand
from nuc980.netboot.console import TRIES
from nuc980.netboot.errors import DoesNotFit, FlashFailed, JournalUnusable
from nuc980.netboot.flash.backup import Way, check_room, reads_well
from nuc980.netboot.flash.images import Image, programmed
from nuc980.netboot.flash.journal import OLD, Event, Journal
from nuc980.netboot.flash.layout import DEVICE_TREE, KERNEL, LOADER, UBI, Slot
from nuc980.netboot.flash.plan import Work, plan_backups, plan_end, plan_opening, plan_reading, plan_writing
from nuc980.netboot.flash.steps import BLOCK_SECONDS, BackedUp, BlockFailed, FlashStep, Verified, WriteBlock
from nuc980.netboot.plan import Step
from nuc980.netboot.probe import probe_nand
from nuc980.netboot.session import Session
from nuc980.netboot.steps import ram_crc

_STAY = "do not switch the board off: U-Boot still runs; flash --roll-back restores the old one"


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
        opening = plan_opening(replace(self.work, images=tuple(images)))
        for image in images:
            image.check_unchanged()
        self._do([*before, *opening])
        started = time.monotonic()
        for image in images:
            begun = time.monotonic()
            self._write(image)
            self.seconds = time.monotonic() - started
            if image.name == KERNEL:
                self.kernel_seconds = time.monotonic() - begun
        self._do(plan_end())
        self.journal.add("finished", content=self.work.content)

    def _write(self, image: Image) -> None:
        failures: Counter[int] = Counter()
        first = 0
        while True:
            try:
                steps = plan_writing(self.work, image, first)
                image.check_unchanged()
                return self._do(steps)
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
        self.work = replace(self.work, nand=replace(self.work.nand, bad=nand.bad))
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
                    "address": image.slot.address,
                },
                "path": str(image.path.resolve()),
                "size": image.size,
                "crc32": image.crc32,
                "sha256": image.sha256,
                "first_sums": _first_sums(image, nand.block),
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
        if journal.content_of(entry["image"]) == OLD:
            continue  # not erased, or restored: what the board has written there since is its own
        backup = journal.backup_of(entry["image"])
        if backup is None:
            raise JournalUnusable(
                f"{journal.folder}: the {entry['image']} was written without a backup"
                f" ({journal.header['no_backup']}).",
                next_step="flash --resume",
            )
        path = journal.folder / backup["file"]
        if not _is_there(path, backup):
            raise JournalUnusable(f"{path} is not the backup any more.", next_step="flash --resume")
        slot = _slot_of(entry)
        if slot.name == UBI:
            path = without_free_blocks(path, slot, nand)
        images.append(Image.of_backup(slot, path, nand.page))
    return tuple(images)


def without_free_blocks(path: Path, slot: Slot, nand: Nand) -> Path:
    """The same UBI for the good blocks that there are now.

    UBI uses every block of its partition, so after one has died its backup is too long. A block with nothing
    but its erase counter (the first page) is free, and UBI does not miss it.
    """
    content = path.read_bytes()
    blocks = [content[at : at + nand.block] for at in range(0, len(content), nand.block)]
    free = [number for number, block in enumerate(blocks) if not programmed(block[nand.page :], nand.page)]
    excess = max(len(blocks) - len(slot.blocks(nand)), 0)
    if not excess:
        return path
    left_out = set(free[-excess:])
    shorter = path.with_suffix(".shorter")
    shorter.write_bytes(b"".join(block for at, block in enumerate(blocks) if at not in left_out))
    return shorter


def _image_of(entry: Event, path: Path) -> Image:
    if not path.exists():
        raise JournalUnusable(f"{path} is gone.", next_step="put the file back, or flash --roll-back")
    return Image.of(_slot_of(entry), path)


def _slot_of(entry: Event) -> Slot:
    slot = entry["slot"]
    limit = tuple(slot["limit"]) if slot["limit"] else None
    return Slot(entry["image"], slot["offset"], slot["end"], slot["room"], limit, slot["address"])


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


# Blocks looked at: the first one has the uImage's time and CRC, or all of the device tree.
TELLING = 4


def check_same_content(session: Session, journal: Journal, nand: Nand, address: int) -> None:
    """That where a kernel or device tree was begun, each of the first blocks is of the old or of the new one.

    Bad blocks alone do not tell one board from another. A block in work may hold anything; UBI's change by
    themselves. address: of a block's room in RAM. Raises JournalUnusable.
    """
    in_work = journal.in_work()
    for entry in journal.header["images"]:
        backup = journal.backup_of(entry["image"])
        begun = journal.content_of(entry["image"]) != OLD
        if entry["image"] not in (KERNEL, DEVICE_TREE) or not begun or backup is None:
            continue
        file = journal.folder / backup["file"]
        if not _is_there(file, backup):
            continue
        slot = _slot_of(entry)
        old = Image.of(slot, file)
        known = {*entry["first_sums"], *_first_sums(old, nand.block), zlib.crc32(b"\xff" * nand.block)}
        for offset in slot.blocks(nand)[:TELLING]:
            if offset in in_work or not reads_well(session, address, offset, nand.block):
                continue
            if not any(ram_crc(session, address, nand.block) in known for _ in range(TRIES)):
                raise JournalUnusable(
                    f"The block at {offset:#x} ({slot.name}) holds neither what {journal.folder} found there,"
                    " nor what it wrote.",
                    cause="--site names another board's folder, or something else has written there since",
                    next_step=f"name this board's site; to give that flash up, move {journal.folder} away",
                )


def _is_there(file: Path, backup: Event) -> bool:
    """Whether a backup is still what it was."""
    return file.exists() and _file_facts(file)["sha256"] == backup["sha256"]


def _first_sums(image: Image, block: int) -> list[int]:
    """The CRC32 of each of its first blocks, and of as many more as bad blocks could push to the front."""
    return [zlib.crc32(image.content(at * block, block)) for at in range(2 * TELLING)]


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


def prepare(journal: Journal, work: Work, way: Way | None) -> tuple[Step, ...]:
    """The backups of a new flash, or none."""
    if way is None:
        return ()
    check_room(
        journal.folder, sum(len(image.slot.blocks(work.nand)) for image in work.images) * work.nand.block
    )
    return plan_backups(work, journal.folder, way)
