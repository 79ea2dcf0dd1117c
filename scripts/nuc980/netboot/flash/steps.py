# SPDX-License-Identifier: GPL-3.0-or-later
"""The steps of a flash: RAM that is compared, blocks that are erased, written and read back."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from nuc980.netboot.console import TRIES, Answer
from nuc980.netboot.environment import IN_WORK
from nuc980.netboot.errors import BoardReset, FlashFailed, LineUnsafe, WrongBytes
from nuc980.netboot.flash.backup import nand_read, reads_well
from nuc980.netboot.flash.images import ERASED
from nuc980.netboot.flash.journal import NEW, Event
from nuc980.netboot.plan import Cost, Step
from nuc980.netboot.session import Session
from nuc980.netboot.steps import PATIENCE, crc_command, ram_has_crc

POISON = 0x0DEFACED
BLOCK_SECONDS = 30.0  # patience with an erase or a write of one block

# A board that was reset meanwhile has lost the variable, as what was loaded into its RAM: there `printenv`
# fails, and what comes after `&&` is not done.
GUARD = f"printenv {IN_WORK} && "
FAILING = re.compile("failure|Skip(ping)? bad block")


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
        return (crc_command(self.address, self.size),)

    def cost(self) -> Cost:
        return Cost(summed=self.size)

    def run(self, session: Session) -> None:
        if not ram_has_crc(session, self.address, self.size, self.crc32):
            raise WrongBytes(f"The {self.image} in RAM is not the file's any more, CRC32 {self.crc32:08x}.")


class BlockFailed(FlashFailed):
    """A block does not accept what is written.

    index: which of the slot's good blocks; offset: in the flash.
    """

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
        erase = f"{GUARD}nand erase {self.offset:#x} {self.block:#x}"
        if not self.size:
            return (erase,)
        return erase, f"{GUARD}nand write {self.address:#x} {self.offset:#x} {self.size:#x}"

    def record(self) -> Event:
        return {"image": self.image, "offset": self.offset, "erases": True}

    def cost(self) -> Cost:
        return Cost(erased=1, written=self.size)

    def run(self, session: Session) -> None:
        for _ in range(TRIES):
            try:
                return self._run(session)
            except LineUnsafe as error:  # whether it was written is unknown: from the erase on again
                lost = error
        raise lost

    def _run(self, session: Session) -> None:
        erase, *write = self.commands()
        # U-Boot says OK even of a bad block, and of one that did not erase; this line, of one that did.
        done = f"Erasing at {self.offset:#x} -- 100% complete."
        self._judge(session, session.console.run(erase, BLOCK_SECONDS), done)
        for command in write:
            answer = session.console.run(command, BLOCK_SECONDS, repeatable=False)
            self._judge(session, answer, f" {self.size} bytes written: OK")

    def _judge(self, session: Session, answer: Answer, done: str) -> None:
        """A block fails when U-Boot says so; words that noise has hit say nothing of it."""
        received = answer.output
        if answer.status and session.console.run(f"printenv {IN_WORK}").status:
            raise BoardReset("The board restarted: what was loaded into its RAM is lost.")
        if answer.status or FAILING.search(received):
            lines = [line.strip() for line in received.splitlines() if line.strip() and IN_WORK not in line]
            raise BlockFailed(self.image, self.index, self.offset, "; ".join(lines) or "it printed nothing")
        if done not in received:
            raise LineUnsafe(f"What became of the block at {self.offset:#x} cannot be read: {received!r}")


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
            crc_command(self.address, self.size),
        )

    def cost(self) -> Cost:
        return Cost(read=self.size, summed=self.size)

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


def _poison(address: int, size: int) -> str:
    return f"mw.l {address:#x} {POISON:#x} {size // 4:#x}"


def _reads_as(session: Session, address: int, offset: int, size: int, crc32: int) -> bool:
    session.console.run(_poison(address, size), PATIENCE).required()
    return reads_well(session, address, offset, size) and ram_has_crc(session, address, size, crc32)
