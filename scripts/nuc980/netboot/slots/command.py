# SPDX-License-Identifier: GPL-3.0-or-later
"""The subcommands `install` and `slots`: their options, and what they lead to."""

from __future__ import annotations

import argparse
import zlib
from collections.abc import Mapping
from contextlib import nullcontext
from pathlib import Path
from tempfile import TemporaryDirectory

from nuc980.netboot.board import Nand
from nuc980.netboot.boot import Images, arguments_for
from nuc980.netboot.errors import FlashFailed, UnusableImage, UnusableInput
from nuc980.netboot.flash import layout
from nuc980.netboot.flash.backup import nand_read
from nuc980.netboot.flash.command import Flash, add_backup, check_backup
from nuc980.netboot.flash.images import Image, check_image
from nuc980.netboot.flash.journal import only_one, refuse_unfinished
from nuc980.netboot.flash.plan import check_board
from nuc980.netboot.limits import DEVICE_TREE_AT, UIMAGE_AT
from nuc980.netboot.plan import Plan
from nuc980.netboot.run import Run
from nuc980.netboot.session import Session
from nuc980.netboot.slots import script
from nuc980.netboot.slots.layout import (
    BASE,
    NAMES,
    PLACES,
    ROOT,
    TRIAL,
    check_flash,
    kernel_slot,
    root_volume,
    tree_slot,
)
from nuc980.netboot.slots.marks import (
    BASE_WORD,
    TRIAL_WORD,
    WriteMark,
    page,
    plan_base,
    plan_trial,
    read_marks,
)
from nuc980.netboot.steps import CRC_SLOWEST, PATIENCE
from nuc980.netboot.uimage import UImage

FLAT_DT = 8  # IH_TYPE_FLATDT of U-Boot's include/image.h


def add_install_options(command: argparse.ArgumentParser) -> None:
    """The options of `install` itself."""
    command.add_argument(
        "uimage", type=Path, help="the kernel, a uImage: its root file system is inside, or that of --ubi"
    )
    command.add_argument("dtb", type=Path, help="the device tree, compiled")
    command.add_argument(
        "--ubi", type=Path, metavar="FILE", help="the UBI image of its root file system; /data is made anew"
    )
    command.add_argument(
        "--slot", choices=NAMES, help="write only this slot, of a board with slots, which does not boot it"
    )
    add_backup(command)


def run_install(run: Run) -> None:
    """Both slots with these images, marks, and the boot command; raises NetbootError."""
    parsed = run.parsed
    if parsed.slot and parsed.ubi:
        raise UnusableInput(
            "a UBI image has the roots of both slots and /data: it is not for one slot",
            next_step="rtu-update on the board writes the root of one (docs/update.md)",
        )
    check_backup(parsed)
    tree = Images.read(parsed.uimage, parsed.dtb).tree
    with (
        TemporaryDirectory(prefix="netboot-") as folder,
        nullcontext() if run.dry else only_one(run.site.folder),
    ):
        if not run.dry:
            refuse_unfinished(run.site.folder)
        with run.board(flash=True) as (session, board):
            nand = check_board(board)
            check_flash(nand)
            script.check_board(board)
            network = run.target.network(board)
            flash = Flash(run, session, board, network, Path(folder))
            images = _images(run, nand)
            variables = None
            if not parsed.slot:
                own = _own(board.environment)
                arguments = arguments_for(tree, own, None, run.site.macs(board.environment))
                variables = script.variables(nand, arguments)
                run.note(f"The kernel's arguments, beside those of the boot command: {arguments}")
            if run.dry:
                run.show(flash.planned(images, variables), network)
                return
            if parsed.slot:
                script.check_installed(board.environment)
                _free(session, nand, parsed.slot)
            with session.serving(network):
                if parsed.ubi:
                    images += flash.tables({layout.UBI: parsed.ubi})
                flash.begin(images, variables)


def _free(session: Session, nand: Nand, name: str) -> None:
    """Sees to it that a slot does not boot, also not on a trial that is left over. Raises UnusableInput."""
    marks = read_marks(session.console, nand)
    if name == marks.base_slot:
        other = next(each for each in NAMES if each != name)
        raise UnusableInput(
            f"The board boots from slot {name.upper()}.",
            next_step=f"write slot {other.upper()}: --slot {other}",
        )
    if marks.trial:
        Plan((WriteMark(TRIAL, nand, TRIAL_WORD, None),)).run(session)


def _own(environment: Mapping[str, str]) -> Mapping[str, str]:
    """An environment whose bootargs are those of before the first `install`."""
    if not script.is_installed(environment):
        return environment
    return {**environment, "bootargs": environment.get("rtu_args", "")}


def _images(run: Run, nand: Nand) -> list[Image]:
    """What one slot is to hold, or both and the marks. Raises UnusableImage, DoesNotFit."""
    parsed = run.parsed
    content = wrapped(parsed.dtb.read_bytes(), root_in_ubi=parsed.ubi is not None)
    tree, none = _kept(run, f"device-tree-{zlib.crc32(content):08x}", content), _kept(run, "no-mark", b"")

    def slot(name: str) -> list[Image]:
        return [Image.of(kernel_slot(name), parsed.uimage), Image.of(tree_slot(name), tree)]

    if parsed.slot:
        images = slot(parsed.slot)
    else:
        base = _kept(run, "base-mark-a", page(BASE_WORD, "a"))
        marks = zip(layout.MARKS, (*BASE, TRIAL), (base, base, none), strict=True)
        images = [*slot("a"), *(Image.of(area.named(name), file) for name, area, file in marks)]
        # In UBI there is no root for B until the first update.
        images += [Image.of(tree_slot("b"), none), _root(parsed.ubi, nand)] if parsed.ubi else slot("b")
    for image in images:
        check_image(image, nand)
    return images


def _root(ubi: Path, nand: Nand) -> Image:
    """All of UBI. Raises UnusableImage when the boot command would find no root in it."""
    image = Image.of(ROOT.named(layout.UBI), ubi)
    volume = root_volume("a")
    # ubinize begins with the two copies of the table of volumes.
    if f"{volume}\0".encode() not in image.content(0, 2 * nand.block):
        raise UnusableImage(
            f"{ubi} has no volume {volume}, where slot A has its root.",
            next_step="take rootfs.ubi of make image-buildroot, or ubinize with board/nuc980/ubinize.cfg",
        )
    return image


def _kept(run: Run, name: str, content: bytes) -> Path:
    """A file in the site's folder: an interrupted work goes on with what it began with."""
    run.site.folder.mkdir(parents=True, exist_ok=True)
    (run.site.folder / name).write_bytes(content)
    return run.site.folder / name


def wrapped(tree: bytes, *, root_in_ubi: bool = False) -> bytes:
    """A device tree with a uImage's header (mkimage -T flat_dt), for its CRC and for the boot command."""

    def header(crc: int) -> bytes:
        fields = (UImage.MAGIC, crc, 0, len(tree), 0, 0, zlib.crc32(tree))
        return UImage.LAYOUT.pack(
            *fields, UImage.LINUX, UImage.ARM, FLAT_DT, UImage.NOT_COMPRESSED, script.TREE_NAMES[root_in_ubi]
        )

    return header(zlib.crc32(header(0))) + tree


# ---- slots


def add_slots_options(command: argparse.ArgumentParser) -> None:
    """The options of `slots` itself."""
    group = command.add_mutually_exclusive_group()
    group.add_argument(
        "--try", dest="trial", choices=NAMES, metavar="SLOT", help="boot it, three times at most: a or b"
    )
    group.add_argument("--base", choices=NAMES, metavar="SLOT", help="boot it from now on: a or b")


def run_slots(run: Run) -> None:
    """Shows slots and marks; changes marks. Raises NetbootError."""
    wanted = run.parsed.trial or run.parsed.base
    with (
        nullcontext() if run.dry or not wanted else only_one(run.site.folder),
        run.board(flash=True, change=False) as (session, board),
    ):
        nand = check_board(board)
        check_flash(nand)
        plan = None
        if wanted:
            plan = plan_trial(nand, wanted) if run.parsed.trial else plan_base(nand, wanted)
        if run.dry:
            run.show(plan or Plan(()))
            return
        script.check_installed(board.environment)
        if plan:
            check_loads(session, wanted)
            plan.run(session)
        _show(run, session, nand)


def check_loads(session: Session, name: str) -> None:
    """That U-Boot would start what is in a slot. Raises FlashFailed."""
    if missing := _fault(session, name):
        raise FlashFailed(
            f"Slot {name.upper()} is not marked: {missing}.",
            cause="it was never written, or not completely",
            next_step="nuc980-netboot install --slot writes it (docs/update.md)",
        )


def _show(run: Run, session: Session, nand: Nand) -> None:
    for name in NAMES:
        run.note(f"slot {name.upper()}  {_fault(session, name) or _whole(session)}")
    marks = read_marks(session.console, nand)
    copies = ", ".join(copy.upper() if copy else "none" for copy in marks.base)
    run.note(f"base    {marks.base_slot.upper()} (its copies: {copies})")
    trial = f"{marks.trial.upper()}, {marks.attempts} attempts left" if marks.trial else "none"
    run.note(f"trial   {trial}")
    run.note(f"the next start takes {', '.join(name.upper() for name in marks.order)}, until one loads")


def _whole(session: Session) -> str:
    """Of a slot without a fault, whose device tree is still in RAM."""
    shown = session.console.run(f"iminfo {DEVICE_TREE_AT:#x}", PATIENCE).required()
    unseen = script.TREE_NAMES[True].decode()
    return "kernel and device tree are whole" + (f"; {unseen}, not looked at" if unseen in shown else "")


def _fault(session: Session, name: str) -> str | None:
    """Why the boot command would pass over a slot; None: it would start it."""
    places, console = PLACES[name], session.console
    seconds = PATIENCE + places.kernel.size / CRC_SLOWEST
    for what, area, address in (
        ("kernel", places.kernel, UIMAGE_AT),
        ("device tree", places.device_tree, DEVICE_TREE_AT),
    ):
        if console.run(nand_read(address, area.offset, area.size), seconds).status:
            return f"its {what} cannot be read"
        if console.run(f"iminfo {address:#x}", seconds).status:
            return f"it has no whole {what}"
    return None
