# SPDX-License-Identifier: GPL-3.0-or-later
"""Does the plan of a flash with a journal, and goes around blocks that fail."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby

from nuc980.netboot.errors import DoesNotFit, FlashFailed
from nuc980.netboot.flash.forecast import Forecast
from nuc980.netboot.flash.images import Image
from nuc980.netboot.flash.journal import Journal
from nuc980.netboot.flash.layout import ALL_KERNELS, LOADER
from nuc980.netboot.flash.plan import Work, plan_end, plan_loads, plan_opening, plan_writing
from nuc980.netboot.flash.resume import file_facts
from nuc980.netboot.flash.steps import BLOCK_SECONDS, BackedUp, BlockFailed, FlashStep, Verified, WriteBlock
from nuc980.netboot.flash.tables import up_to_date
from nuc980.netboot.plan import Step
from nuc980.netboot.probe import probe_nand
from nuc980.netboot.session import Session

_STAY = "do not switch the board off: U-Boot still runs; flash --roll-back restores the old one"


@dataclass
class Flasher:
    """Does a plan's steps with a journal, and goes around blocks that fail."""

    session: Session
    journal: Journal
    work: Work
    forecast: Forecast
    after: tuple[Step, ...] = ()  # of the images, before the journal is finished
    seconds: float = 0.0  # from the first erase to the last byte read back
    kernel_seconds: float = 0.0  # of that, the kernel's

    def run(self, before: Sequence[Step], images: Sequence[Image]) -> None:
        """The steps, then these images; then the journal is finished. Raises NetbootError."""
        opening = plan_opening(replace(self.work, images=tuple(images)))
        for image in images:
            image.check_unchanged()
        self.session.progress.left = self.forecast.left
        self._do([*before, *opening])
        bad, started = self.work.nand.bad, time.monotonic()
        for image in images:
            begun = time.monotonic()
            self._write(self._up_to_date(image, bad))
            self.seconds = time.monotonic() - started
            if image.name in ALL_KERNELS:
                self.kernel_seconds += time.monotonic() - begun
        self._do((*plan_end(), *self.after))
        self.journal.add("finished", content=self.work.content)

    def _up_to_date(self, image: Image, bad: Sequence[int]) -> Image:
        """Tables of bad blocks with what has died since; loaded again then."""
        (found,) = up_to_date([image], bad, self.work.nand, self.work.content, self.journal.folder) or [image]
        if found != image:
            images = (*(each for each in self.work.images if each.name != image.name), found)
            self.work = replace(self.work, images=images)
            self._do(plan_loads(replace(self.work, images=(found,))))
        return found

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
        # What it says of a worn block is an error: `nand bad` tells.
        console.run(f"nand markbad {failed.offset:#x}", BLOCK_SECONDS)
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
        with self.session.progress.phase(step.phase), self.forecast.measured(step):
            step.run(self.session)
        self.journal.add("end", step=step.title(), **facts)
        self._note_milestone(step)

    def _note_milestone(self, step: Step) -> None:
        match step:
            case Verified():
                self.journal.add("verified", image=step.image, content=step.content)
            case BackedUp():
                self.journal.add("backup", image=step.image, **file_facts(step.file))
