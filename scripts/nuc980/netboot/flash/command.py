# SPDX-License-Identifier: GPL-3.0-or-later
"""The subcommand `flash`: its options, and what they lead to."""

from __future__ import annotations

import argparse
import re
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from nuc980.netboot.board import BoardReport
from nuc980.netboot.boot import Images, plan_network
from nuc980.netboot.environment import IN_WORK, plan_restore
from nuc980.netboot.errors import JournalUnusable, UnusableInput
from nuc980.netboot.flash.backup import BackUp, BySerial, check_room
from nuc980.netboot.flash.flasher import Flasher
from nuc980.netboot.flash.forecast import Forecast
from nuc980.netboot.flash.images import Image, check_image
from nuc980.netboot.flash.journal import NEW, OLD, Journal, newest_unfinished, only_one, refuse_unfinished
from nuc980.netboot.flash.layout import (
    DEVICE_TREE,
    KERNEL,
    LOADER,
    ONE_SLOT,
    TABLES,
    UBI,
    layout_of,
    loader_slot,
)
from nuc980.netboot.flash.plan import (
    Work,
    backup_file,
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
    environment_of,
    header_of,
    images_of,
    not_backed_up,
    still_to_do,
)
from nuc980.netboot.flash.steps import BackedUp
from nuc980.netboot.flash.tables import has_tables, tables_image, up_to_date
from nuc980.netboot.flash.through_linux import NEEDS, Place, checked, plan_linux
from nuc980.netboot.plan import Plan, SetVariable, Step
from nuc980.netboot.run import Run
from nuc980.netboot.session import Network, Session
from nuc980.netboot.uimage import partitions_of, read_tree

PLACES = {KERNEL: "kernel", DEVICE_TREE: "dtb", UBI: "ubi"}  # options
NEWEST = Path()  # --resume without a folder
LINUX = "linux"  # a way to back up
LONG_SECONDS = 300.0  # a backup over the line that another way is offered for
ERASED_IS_NOT_SENT = " Erased blocks need not be sent, so it may take less time."
OFFER = (
    "A Linux out of RAM backs it up in minutes: --backup-by linux --backup-kernel uImage --backup-dtb DTB,"
    " the files of the image nuc980_netboot. Nothing is erased yet: after Ctrl-C, --resume takes them."
)


def add_flash_options(command: argparse.ArgumentParser) -> None:
    """The options of `flash` itself."""
    _add_images(command)
    add_backup(command)
    group = command.add_mutually_exclusive_group()
    for option, does in (
        ("--resume", "bring an interrupted flash to its end"),
        ("--roll-back", "write back what was there before"),
    ):
        group.add_argument(option, type=Path, nargs="?", const=NEWEST, metavar="FOLDER", help=does)


def _add_images(command: argparse.ArgumentParser) -> None:
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


def add_backup(command: argparse.ArgumentParser) -> None:
    """What becomes of what was there before."""
    group = command.add_argument_group("what was there before")
    group.add_argument("--no-backup", metavar="REASON", help="do not keep it; the journal keeps the reason")
    group.add_argument(
        "--backup-by",
        choices=("tftp", "serial", LINUX),
        help="how it comes to the host (default: by U-Boot's tftpput where it has that, else by serial)",
    )
    group.add_argument(
        "--backup-kernel", type=Path, metavar="FILE", help="for linux: the uImage of the image nuc980_netboot"
    )
    group.add_argument("--backup-dtb", type=Path, metavar="FILE", help="for linux: the board's device tree")


def run_flash(run: Run) -> None:
    """Raises NetbootError."""
    files = _files(run.parsed)
    check_backup(run.parsed)
    with (
        TemporaryDirectory(prefix="netboot-") as folder,
        nullcontext() if run.dry else only_one(run.site.folder),
    ):
        journal = _journal(run.parsed, run.site.folder)
        if run.dry and journal:
            raise UnusableInput(
                "--dry-run shows a new flash: how one goes on depends on what the flash holds"
            )
        with run.board(flash=True) as (session, board):
            network = run.target.network(board)
            flash = Flash(run, session, board, network, Path(folder))
            if run.dry:
                run.show(flash.planned(flash.images(files)), network)
                return
            with session.serving(network):
                if journal is None:
                    flash.begin((*flash.images(files), *flash.tables(files)))
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


def check_backup(parsed: argparse.Namespace) -> None:
    """The options of a backup by Linux, and its files. Raises UnusableInput, UnusableImage."""
    files = (parsed.backup_kernel, parsed.backup_dtb)
    if parsed.backup_by != LINUX and any(files):
        raise UnusableInput("--backup-kernel and --backup-dtb are for --backup-by linux")
    if parsed.backup_by == LINUX:
        if not all(files):
            raise UnusableInput(
                "--backup-by linux needs a kernel and a device tree",
                next_step="--backup-kernel uImage --backup-dtb DTB, of the image nuc980_netboot",
            )
        Images.read(*files)


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
        raise argparse.ArgumentTypeError(f"'{text}' is not of the form 0x200000+0x500000")
    return int(found[1], 0), int(found[2], 0)


class Flash:
    """One run of a subcommand that writes images, on a board that has been probed."""

    def __init__(
        self, run: Run, session: Session, board: BoardReport, network: Network, folder: Path
    ) -> None:
        self.parsed, self.session, self.board, self.site = run.parsed, session, board, run.site
        self.network, self.folder = network, folder
        parsed = run.parsed
        self.baud = parsed.baud if run.dry else session.console.line.baud
        self.nand = check_board(board)
        self.backs_up = parsed.no_backup is None
        self.way = choose_way(board, parsed.backup_by, self.nand)
        if self.backs_up and parsed.backup_by == LINUX:
            check_board(board, NEEDS)
            checked(parsed.backup_kernel, parsed.backup_dtb, board)
        elif self.backs_up:
            check_board(board, self.way.needs)
        self.macs = run.site.macs(board.environment)
        self.setup: tuple[Step, ...] = (*plan_session(board), *plan_network(board, network, self.macs))

    def planned(self, images: Sequence[Image], environment: Mapping[str, str] | None = None) -> Plan:
        """What begin() does when nothing goes wrong, and the flash has bad-block tables."""
        work = self._work(in_order(images))
        wanted = self.board.environment | environment if environment else None
        steps = (
            *(*self.setup, *self._backups(work, self.site.folder / "flash-DATE"), *plan_flash(work)),
            *self._environment(wanted),
        )
        if any(image.name == UBI for image in images) and not self.nand.keeps_table:
            self.session.progress.note(f"A flash without {TABLES} gets them too, in its last blocks.")
        self._forecast(steps)
        return Plan(steps)

    def begin(self, images: Sequence[Image], environment: Mapping[str, str] | None = None) -> None:
        """environment: variables that are added to the board's, and written to the flash in the end."""
        work = self._work(in_order(images))
        header = header_of(work, self.board, self.parsed.no_backup, environment)
        journal = Journal.create(self.site.folder, header)
        if self.backs_up:
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

    def _forecast(self, steps: Sequence[Step]) -> Forecast:
        """Tells how long they take."""
        forecast = Forecast(steps, self.baud)
        sent = any(isinstance(step, BackUp) and isinstance(step.way, BySerial) for step in steps)
        self.session.progress.note(f"It takes {forecast}.{ERASED_IS_NOT_SENT if sent else ''}")
        if sent and self.parsed.backup_by is None and forecast.planned[BackUp.phase] > LONG_SECONDS:
            self.session.progress.note(OFFER)
        return forecast

    def _work(self, images: tuple[Image, ...], content: str = NEW) -> Work:
        return Work(images, self.nand, plan_ram(self.board, images, self.nand), content)

    def _backups(self, work: Work, folder: Path) -> tuple[Step, ...]:
        """Of the images' places."""
        if not self.backs_up or not work.images:
            return ()
        if self.parsed.backup_by != LINUX:
            return plan_backups(work, folder, self.way)
        places = [
            Place(image.name, image.slot.blocks(self.nand), self.nand.block, backup_file(folder, image))
            for image in work.images
        ]
        steps = plan_linux(
            *(self.board, self.network, self.macs, self.parsed.backup_kernel, self.parsed.backup_dtb),
            *(places, work.ram.scratch, self.folder),
        )
        # The board was restarted: what was set is gone.
        return (*steps, *self.setup, *(BackedUp(place.image, place.file) for place in places))

    def _environment(self, wanted: Mapping[str, str] | None) -> tuple[Step, ...]:
        """Makes it the board's in the flash, without what was only set for this work."""
        if wanted is None:
            return ()
        here = dict(self.board.environment)
        for step in self.setup:
            if isinstance(step, SetVariable) and step.name != IN_WORK:
                here[step.name] = step.value
        return plan_restore({name: value for name, value in here.items() if value}, wanted, save=True).steps

    def images(self, files: dict[str, Path]) -> list[Image]:
        """Where this board's boot command reads them. Raises LayoutUnknown, UnusableImage, DoesNotFit."""
        if LOADER in files:
            slots = {LOADER: loader_slot(self.nand)}
        else:
            explicit = {
                name: place
                for name, option in PLACES.items()
                if (place := getattr(self.parsed, f"{option}_at")) is not None
            }
            linux = partitions_of(read_tree(files[DEVICE_TREE])) if DEVICE_TREE in files else ()
            layout = layout_of(self.board.environment, self.nand, explicit, linux)
            slots = {name: layout.slot(name) for name in files}
            for note in layout.notes:
                self.session.progress.note(note)
        images = [Image.of(slots[name], path) for name, path in files.items()]
        for image in images:
            check_image(image, self.nand)
        return images

    def tables(self, files: dict[str, Path]) -> list[Image]:
        """With a new root file system, in a flash that has none."""
        address = plan_ram(self.board, (), self.nand).scratch
        if UBI not in files or has_tables(self.session, self.nand, address):
            return []
        return [tables_image(self.nand, self.site.folder)]

    def _run(
        self, journal: Journal, work: Work, backups: tuple[Step, ...], images: tuple[Image, ...]
    ) -> None:
        note = self.session.progress.note
        before = (*self.setup, *backups)
        try:
            forecast = self._forecast((*before, *plan_flash(replace(work, images=images))))
            after = self._environment(environment_of(journal, work.content))
            flasher = Flasher(self.session, journal, work, forecast, after)
            flasher.run(before, images)
        except BaseException:  # also Ctrl-C, and a full disk
            note(f"Not finished. `flash --resume` and `flash --roll-back` go on from {journal.folder}.")
            raise
        if images and {image.name for image in work.images} not in ONE_SLOT:
            note(
                f"The flash alone could not boot for {flasher.seconds:.1f} s;"
                f" its kernel was away for {flasher.kernel_seconds:.1f} s of them."
            )
        note(f"Done. The journal{' and what was there before' if self.backs_up else ''}: {journal.folder}")
