# SPDX-License-Identifier: GPL-3.0-or-later
"""The subcommand `flash`: its options, and what they lead to."""

from __future__ import annotations

import argparse
import re
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

from nuc980.netboot.board import BoardReport
from nuc980.netboot.boot import plan_network
from nuc980.netboot.errors import JournalUnusable, UnusableInput
from nuc980.netboot.flash.backup import check_room
from nuc980.netboot.flash.flasher import Flasher
from nuc980.netboot.flash.images import Image, check_image
from nuc980.netboot.flash.journal import NEW, OLD, Journal, newest_unfinished, only_one, refuse_unfinished
from nuc980.netboot.flash.layout import DEVICE_TREE, KERNEL, LOADER, TABLES, UBI, layout_of, loader_slot
from nuc980.netboot.flash.plan import (
    Work,
    check_board,
    choose_way,
    in_order,
    plan_backups,
    plan_flash,
    plan_ram,
    plan_session,
)
from nuc980.netboot.flash.resume import (
    backups_of,
    check_same_board,
    check_same_content,
    header_of,
    images_of,
    not_backed_up,
    still_to_do,
)
from nuc980.netboot.flash.tables import has_tables, tables_image, up_to_date
from nuc980.netboot.plan import Plan, Step
from nuc980.netboot.run import Run
from nuc980.netboot.session import Network, Session

PLACES = {KERNEL: "kernel", DEVICE_TREE: "dtb", UBI: "ubi"}  # options
NEWEST = Path()  # --resume without a folder


def add_flash_options(command: argparse.ArgumentParser) -> None:
    """The options of `flash` itself."""
    group = command.add_argument_group("images")
    group.add_argument("--kernel", type=Path, metavar="FILE", help="the uImage")
    group.add_argument("--dtb", type=Path, metavar="FILE", help="the device tree, compiled")
    group.add_argument("--ubi", type=Path, metavar="FILE", help="the UBI image of the root file system")
    group.add_argument(
        "--bootloader", type=Path, metavar="FILE", help="U-Boot itself; only alone, with --i-know"
    )
    group.add_argument("--i-know", action="store_true", help="that a failure needs a programmer")
    for name, option in PLACES.items():
        group.add_argument(
            f"--{option}-at",
            type=_place,
            metavar="OFFSET+SIZE",
            help=f"place of the {name}, not the board's own",
        )
    group = command.add_argument_group("what was there before")
    group.add_argument("--no-backup", metavar="REASON", help="do not keep it; the journal keeps the reason")
    group.add_argument("--backup-by", choices=("tftp", "serial"), help="how it comes to the host")
    group = command.add_mutually_exclusive_group()
    for option, does in (
        ("--resume", "bring an interrupted flash to its end"),
        ("--roll-back", "write back what was there before"),
    ):
        group.add_argument(option, type=Path, nargs="?", const=NEWEST, metavar="FOLDER", help=does)


def run_flash(run: Run) -> None:
    """Raises NetbootError."""
    files = _files(run.parsed)
    with nullcontext() if run.dry else only_one(run.site.folder):
        journal = _journal(run.parsed, run.site.folder)
        if run.dry and journal:
            raise UnusableInput(
                "--dry-run shows a new flash: how one goes on depends on what the flash holds"
            )
        with run.board(flash=True) as (session, board):
            network = run.target.network(board)
            flash = _Flash(run, session, board, network)
            if run.dry:
                run.show(flash.planned(files), network)
                return
            with session.serving(network):
                if journal is None:
                    flash.begin(files)
                else:
                    flash.go_on(journal, OLD if run.parsed.roll_back else NEW)


def _files(parsed: argparse.Namespace) -> dict[str, Path]:
    """The images of the command line. Raises UnusableInput."""
    given = {KERNEL: parsed.kernel, DEVICE_TREE: parsed.dtb, UBI: parsed.ubi, LOADER: parsed.bootloader}
    files = {name: path for name, path in given.items() if path is not None}
    goes_on = parsed.resume is not None or parsed.roll_back is not None
    if goes_on and files:
        raise UnusableInput("--resume and --roll-back take the files that the journal names")
    if not goes_on and not files:
        raise UnusableInput("name what to write: --kernel, --dtb, --ubi")
    if LOADER in files and not parsed.i_know:
        raise UnusableInput(
            "the boot loader's place is not written",
            cause="a board whose boot loader is damaged has no way in but a programmer",
            next_step="leave it as it is, or add --i-know",
        )
    if LOADER in files and len(files) > 1:
        raise UnusableInput("the boot loader is written alone")
    if parsed.no_backup is not None and not parsed.no_backup.strip():
        raise UnusableInput("--no-backup needs a reason")
    return files


def _journal(parsed: argparse.Namespace, site: Path) -> Journal | None:
    """The one to go on with; None for a new flash."""
    folder = parsed.resume or parsed.roll_back
    if folder is None:
        refuse_unfinished(site)
        return None
    journal = newest_unfinished(site) if folder == NEWEST else Journal(folder)
    if journal is None:
        raise JournalUnusable(
            f"{site} has no unfinished flash.", next_step="a finished one can be rolled back by its folder"
        )
    return journal


def _place(text: str) -> tuple[int, int]:
    found = re.fullmatch(r"(0x[0-9a-fA-F]+|\d+)\+(0x[0-9a-fA-F]+|\d+)", text)
    if not found or not int(found[2], 0):
        raise argparse.ArgumentTypeError(f"'{text}' is not as 0x200000+0x500000")
    return int(found[1], 0), int(found[2], 0)


class _Flash:
    """One run of the subcommand on a board that has been probed."""

    def __init__(self, run: Run, session: Session, board: BoardReport, network: Network) -> None:
        self.parsed, self.session, self.board, self.site = run.parsed, session, board, run.site
        parsed = run.parsed
        self.nand = check_board(board, None)
        self.way = None
        if parsed.no_backup is None:
            self.way = choose_way(board, parsed.backup_by, self.nand)
            check_board(board, self.way)
        macs = run.site.macs(board.environment)
        self.setup: tuple[Step, ...] = (*plan_session(board), *plan_network(board, network, macs))

    def planned(self, files: dict[str, Path]) -> Plan:
        """What begin() does when nothing goes wrong, and the flash has bad-block tables."""
        work = self._work(in_order(self._images(files)))
        backups = self._backups(work, self.site.folder / "flash-DATE")
        if UBI in files and not self.nand.keeps_table:
            self.session.progress.note(f"A flash without {TABLES} gets them too, in its last blocks.")
        return Plan((*self.setup, *backups, *plan_flash(work)))

    def begin(self, files: dict[str, Path]) -> None:
        work = self._work(in_order((*self._images(files), *self._tables(files))))
        journal = Journal.create(self.site.folder, header_of(work, self.board, self.parsed.no_backup))
        if self.way:
            slots = (image.slot for image in work.images)
            check_room(journal.folder, sum(len(slot.blocks(self.nand)) for slot in slots) * self.nand.block)
        self._run(journal, work, self._backups(work, journal.folder), work.images)

    def go_on(self, journal: Journal, content: str) -> None:
        check_same_board(journal, self.nand)
        images = in_order(images_of(journal) if content == NEW else backups_of(journal, self.nand))
        images = up_to_date(images, journal.header["nand"]["bad"], self.nand, content, self.site.folder)
        for image in images:
            image.slot.check_fits(image.size, self.nand)
        work = self._work(images, content)
        check_same_content(self.session, journal, self.nand, work.ram.scratch)
        if journal.is_finished:
            journal.add("begun again", content=content)
        backups: tuple[Step, ...] = ()
        if content == NEW and journal.header["no_backup"] is None:
            missing = not_backed_up(self.session, journal, work)
            backups = self._backups(replace(work, images=missing), journal.folder)
        self._run(journal, work, backups, still_to_do(self.session, journal, work))

    def _work(self, images: tuple[Image, ...], content: str = NEW) -> Work:
        return Work(images, self.nand, plan_ram(self.board, images, self.nand), content)

    def _backups(self, work: Work, folder: Path) -> tuple[Step, ...]:
        return plan_backups(work, folder, self.way) if self.way else ()

    def _images(self, files: dict[str, Path]) -> list[Image]:
        if LOADER in files:
            slots = {LOADER: loader_slot(self.nand)}
        else:
            explicit = {
                name: place
                for name, option in PLACES.items()
                if (place := getattr(self.parsed, f"{option}_at")) is not None
            }
            layout = layout_of(self.board.environment, self.nand, explicit)
            slots = {name: layout.slot(name) for name in files}
            for note in layout.notes:
                self.session.progress.note(note)
        images = [Image.of(slots[name], path) for name, path in files.items()]
        for image in images:
            check_image(image, self.nand)
        return images

    def _tables(self, files: dict[str, Path]) -> list[Image]:
        """With a new root file system, in a flash that has none."""
        address = plan_ram(self.board, (), self.nand).scratch
        if UBI not in files or has_tables(self.session, self.nand, address):
            return []
        return [tables_image(self.nand, self.site.folder)]

    def _run(
        self, journal: Journal, work: Work, backups: tuple[Step, ...], images: tuple[Image, ...]
    ) -> None:
        note = self.session.progress.note
        flasher = Flasher(self.session, journal, work)
        try:
            flasher.run((*self.setup, *backups), images)
        except BaseException:  # also Ctrl-C, and a full disk
            note(f"Not finished. `flash --resume` and `flash --roll-back` go on from {journal.folder}.")
            raise
        if images:
            note(
                f"The flash alone could not boot for {flasher.seconds:.1f} s;"
                f" its kernel was away for {flasher.kernel_seconds:.1f} s of them."
            )
        note(f"Done. The journal{' and what was there before' if self.way else ''}: {journal.folder}")
