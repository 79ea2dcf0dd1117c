# SPDX-License-Identifier: GPL-3.0-or-later
"""The pages that say which slot boots.

Base, in two copies: a word that tells it from anything else, and the slot. Trial: the same with another word;
the pages behind it are erased until an attempt uses them up. A page whose programming was cut fails its ECC,
or looks as one without, and then lacks bits of its words: such a mark counts as none, such an attempt as used
up, or, with hardly a bit, as unused.
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from typing import ClassVar

from nuc980.netboot.board import Nand
from nuc980.netboot.console import Console
from nuc980.netboot.errors import FlashFailed, LineUnsafe
from nuc980.netboot.flash.backup import nand_read
from nuc980.netboot.limits import PAGE
from nuc980.netboot.plan import Plan, Step
from nuc980.netboot.session import Session
from nuc980.netboot.slots.layout import BASE, TRIAL, Area
from nuc980.netboot.steps import PATIENCE

LOOK = 0x1000000  # in RAM, away from where kernel and device tree go
ATTEMPTS = 3
BASE_WORD, TRIAL_WORD = (struct.unpack("<I", word)[0] for word in (b"RTUB", b"RTUT"))
SLOT_WORDS = {"a": 0x41414141, "b": 0x42424242}
USED_WORD = 0x55AA55AA
ERASED_WORD = 0xFFFFFFFF


def page(word: int, slot: str) -> bytes:
    """A mark as it is in the flash."""
    return struct.pack("<2I", word, SLOT_WORDS[slot]).ljust(PAGE, b"\xff")


@dataclass(frozen=True)
class Marks:
    """What a board's marks say. None: none, or one that cannot be read."""

    base: tuple[str | None, str | None]  # the copies
    trial: str | None
    attempts: int  # that are left

    @property
    def base_slot(self) -> str:
        """The slot that boots without a trial: the first copy's; a board without marks boots A."""
        return self.base[0] or self.base[1] or "a"

    @property
    def order(self) -> tuple[str, ...]:
        """The slots as the next start takes them."""
        other = "b" if self.base_slot == "a" else "a"
        tried = (self.trial,) * self.attempts if self.trial else ()
        return (*tried, self.base_slot, other)


def read_marks(console: Console, nand: Nand) -> Marks:
    """As the boot command sees them. Raises LayoutUnknown, LineUnsafe, CommandFailed."""
    first, second = (_slot_of(_words(console, area.first_good(nand)), BASE_WORD) for area in BASE)
    trial = TRIAL.first_good(nand)
    pages = (_words(console, trial + PAGE * number) for number in range(1, ATTEMPTS + 1))
    left = sum(words == (ERASED_WORD, ERASED_WORD) for words in pages)
    return Marks((first, second), _slot_of(_words(console, trial), TRIAL_WORD), left)


def _words(console: Console, offset: int) -> tuple[int, int] | None:
    """A page's first two words; None for one that cannot be read."""
    if console.run(nand_read(LOOK, offset, PAGE), PATIENCE).status:
        return None
    shown = console.run_twice(f"md.l {LOOK:#x} 2").required()
    found = re.search(r": ([0-9a-f]{8}) ([0-9a-f]{8}) ", shown)
    if not found:
        raise LineUnsafe(f"md shows no words of {LOOK:#x}: {shown.strip()!r}")
    return int(found[1], 16), int(found[2], 16)


def _slot_of(words: tuple[int, int] | None, kind: int) -> str | None:
    """Which slot a mark names. The boot command takes for A what is not B."""
    if words is None or words[0] != kind:
        return None
    return "b" if words[1] == SLOT_WORDS["b"] else "a"


@dataclass(frozen=True)
class WriteMark(Step):
    """Erases the block of a mark, and writes the mark; no slot: leaves it erased. Then it is read back."""

    area: Area
    nand: Nand
    word: int
    slot: str | None
    phase: ClassVar[str] = "marks"

    def title(self) -> str:
        return f"Mark {self.slot.upper()} at {self._offset:#x}." if self.slot else f"Erase {self._offset:#x}."

    @property
    def _offset(self) -> int:
        return self.area.first_good(self.nand)

    def commands(self) -> tuple[str, ...]:
        show = f"md.l {LOOK:#x} 2"
        return (*self._writing(), nand_read(LOOK, self._offset, PAGE), show, show)

    def _writing(self) -> tuple[str, ...]:
        erase = f"nand erase {self._offset:#x} {self.nand.block:#x}"
        if self.slot is None:
            return (erase,)
        return (
            f"mw.l {LOOK:#x} {ERASED_WORD:#x} {PAGE // 4:#x}",
            f"mw.l {LOOK:#x} {self.word:#x}",
            f"mw.l {LOOK + 4:#x} {SLOT_WORDS[self.slot]:#x}",
            erase,
            f"nand write {LOOK:#x} {self._offset:#x} {PAGE:#x}",
        )

    def run(self, session: Session) -> None:
        for command in self._writing():
            session.console.run(command, PATIENCE, repeatable=not command.startswith("nand write")).required()
        words = _words(session.console, self._offset)
        wanted = (self.word, SLOT_WORDS[self.slot]) if self.slot else (ERASED_WORD, ERASED_WORD)
        if words != wanted:
            raise FlashFailed(
                f"The mark at {self._offset:#x} does not read back as written.",
                cause="a worn block",
                next_step="nuc980-netboot slots shows what boots; install goes around blocks marked as bad",
            )


def plan_trial(nand: Nand, slot: str) -> Plan:
    """The next starts take this slot, three times at most."""
    return Plan((WriteMark(TRIAL, nand, TRIAL_WORD, slot),))


def plan_base(nand: Nand, slot: str) -> Plan:
    """This slot boots from now on. One copy after the other: one is whole at any time; then no trial."""
    return Plan(
        (
            *(WriteMark(area, nand, BASE_WORD, slot) for area in BASE),
            WriteMark(TRIAL, nand, TRIAL_WORD, None),
        )
    )
