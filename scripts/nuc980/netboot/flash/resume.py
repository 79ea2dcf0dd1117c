# SPDX-License-Identifier: GPL-3.0-or-later
"""A flash that was begun, by its journal: what it began with, what it has done, what it still has to do."""

from __future__ import annotations

import hashlib
import zlib
from collections.abc import Mapping
from pathlib import Path

from nuc980.netboot.board import BoardReport, Nand
from nuc980.netboot.console import TRIES
from nuc980.netboot.environment import kept
from nuc980.netboot.errors import JournalUnusable
from nuc980.netboot.flash.backup import reads_well
from nuc980.netboot.flash.images import Image, programmed
from nuc980.netboot.flash.journal import NEW, OLD, Event, Journal
from nuc980.netboot.flash.layout import ALL_DEVICE_TREES, ALL_KERNELS, UBI, Slot
from nuc980.netboot.flash.plan import Work, plan_reading
from nuc980.netboot.session import Session
from nuc980.netboot.steps import ram_crc

# Blocks looked at: the first one has the uImage's time and CRC, or all of the device tree.
TELLING = 4


def header_of(
    work: Work, board: BoardReport, no_backup: str | None, environment: Mapping[str, str] | None = None
) -> Event:
    """What a journal begins with: all that --resume and --roll-back need.

    environment: the variables that are written to the flash in the end, None for a flash that writes none.
    """
    nand = work.nand
    return {
        "version": 1,
        "uboot": board.version,
        **({"environment": {OLD: kept(board.environment), NEW: environment}} if environment else {}),
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


def environment_of(journal: Journal, content: str) -> Mapping[str, str] | None:
    """What the environment is to be in the end: all of it, as a cut while it is written loses all of it."""
    both = journal.header.get("environment")
    if both is None:
        return None
    return both[OLD] | (both[NEW] if content == NEW else {})


def images_of(journal: Journal) -> tuple[Image, ...]:
    """The images of a journal, whose files must be what they were. Raises JournalUnusable."""
    images = []
    for entry in journal.header["images"]:
        image = _image_of(entry, Path(entry["path"]))
        if image.sha256 != entry["sha256"]:
            raise JournalUnusable(
                f"{image.path} is not the file that {journal.folder} began with.",
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
            raise JournalUnusable(f"{path} is no longer the backup.", next_step="flash --resume")
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
            f"{journal.folder} belongs to another board: size, blocks or bad blocks of its flash differ.",
            cause="--site names another board's folder",
            next_step="name this board's site",
        )


def check_same_content(session: Session, journal: Journal, nand: Nand, address: int) -> None:
    """That where a kernel or device tree was begun, each of the first blocks is of the old or of the new one.

    Bad blocks alone do not tell one board from another. A block in work may hold anything; UBI's change by
    themselves. address: of a block's room in RAM. Raises JournalUnusable.
    """
    in_work = journal.in_work()
    for entry in journal.header["images"]:
        backup = journal.backup_of(entry["image"])
        begun = journal.content_of(entry["image"]) != OLD
        if entry["image"] not in ALL_KERNELS + ALL_DEVICE_TREES or not begun or backup is None:
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
    return file.exists() and file_facts(file)["sha256"] == backup["sha256"]


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


def file_facts(path: Path) -> Event:
    """What the journal keeps of a backup."""
    content = path.read_bytes()
    return {
        "file": path.name,
        "size": len(content),
        "crc32": zlib.crc32(content),
        "sha256": hashlib.sha256(content).hexdigest(),
    }
