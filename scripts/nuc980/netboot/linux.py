# SPDX-License-Identifier: GPL-3.0-or-later
"""Watches a kernel come up on the console: until its login, or its panic."""

from __future__ import annotations

import re
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from nuc980.netboot.commandline import ended, text
from nuc980.netboot.errors import (
    BoardHung,
    BoardReset,
    BootmFailed,
    KernelMute,
    KernelOops,
    KernelPanic,
    LinuxSilent,
    NetbootError,
    RootMissing,
)
from nuc980.netboot.transport import Line

# bootm's last words. The vendor's U-Boot takes the console's pins away while the UART still has up to 17 of
# these characters; a kernel's first ones stand behind what was sent: `Startin[    0.000000] Booting Linux`.
STARTING = "Starting kernel ..."
# What it says before them, when nothing else is to come but lines of the second kind.
HANDED_OVER = re.compile(r"   (?:Loading|Using) Device Tree ")
UBOOTS_OWN = re.compile(r"   |Working FDT set to ")
# What a kernel says first: a line with its time, the decompressor's, those of a kernel without times.
KERNEL = r"\[ *\d+\.\d{6}\]|Uncompressing Linux|Booting Linux on |Linux version \d"
IMAGE_NAME = "   Image Name: "  # what stands behind it is the uImage's
UNPACKED = "booting the kernel"  # the last word of a zImage that unpacks itself
UBOOT = re.compile(r"^U-Boot (SPL )?\d{4}\.\d\d")
HUNG = "Please RESET the board"  # U-Boot's hang(), which nothing ends but a reset
RESET = re.compile(r"[Mm]ust RESET (the )?board")
PANIC = re.compile(r"Kernel panic - not syncing")
TROUBLE = re.compile(rf"{PANIC.pattern}|Internal error: |Unable to handle kernel |Cannot open root device")
FIRST_WORDS = re.compile(rf"{KERNEL}|{TROUBLE.pattern}")
NO_ROOT = re.compile(r"Unable to mount root fs|Waiting for root device|Cannot open root device")
THE_END = re.compile(r"---\[ end Kernel panic|Rebooting in \d+ seconds")

LINES_KEPT = 200
LINE_LIMIT = 4096  # what is longer is cut
PANIC_SECONDS = 10.0  # its lines come within
QUIET_SECONDS = 2.0  # this long after a panic's last line, it was the last

# What U-Boot's bootm says when it gives up (2016.11 and 2023.01: bootm.c, image-fdt.c), and why.
BOOTM_WORDS = {
    r"Bad Magic Number|Wrong Image Format|Can't get kernel image": "U-Boot finds no uImage at the address",
    r"Bad Header Checksum|Bad Data CRC": "the kernel in the RAM has changed since it was checked: bad RAM",
    r"Unsupported Architecture|is not supported|Wrong Image Type": "a uImage for another processor or system",
    r"cmdline Flattened Device Tree|valid device tree|is not a fdt": "no device tree at the address",
    r"overlaps OS image|overwritten|allocation error": "kernel and device tree do not fit beside each other",
    r"uncompress error|Image too large|Unimplemented compression": "a uImage that this U-Boot cannot unpack",
}


@dataclass(frozen=True)
class Goal:
    """The line that ends a boot, a regular expression; times in seconds.

    bootm_seconds: for U-Boot, to check what it was given and to hand over; seconds: from there to the
    kernel's first word, which a quiet one says late, and from that to the goal.
    """

    pattern: str = r"^\S+ login: "
    seconds: float = 120.0
    bootm_seconds: float = 30.0


class LinuxWatch:
    """The console after bootm. marker: the number of the command, which appears when bootm gives up.

    show: gets each line as it is complete.
    """

    def __init__(self, line: Line, marker: int, show: Callable[[str], None]) -> None:
        self._line = line
        self._ended = ended(marker)
        self.show = show
        self._judged: deque[str] = deque(maxlen=LINES_KEPT)
        self._new: deque[str] = deque()  # whole lines, not judged yet
        self._rest = b""  # of the line at hand
        self._handed_over = False  # by U-Boot, as far as it says
        self._announced = False  # by it, in a line of its own

    def until_kernel(self, goal: Goal) -> None:
        """Until a word that is a kernel's. Raises BootmFailed, BoardHung, BoardReset, KernelMute."""
        wanted = re.compile(goal.pattern)
        deadline = time.monotonic() + goal.bootm_seconds
        while True:
            before = self._handed_over
            self._hear(deadline)
            if self._kernel_speaks(wanted):
                self._handed_over = True
                return
            if self._handed_over and not before:
                deadline = time.monotonic() + goal.seconds
            elif time.monotonic() >= deadline:
                raise self._no_kernel(goal)

    def _kernel_speaks(self, wanted: re.Pattern[str]) -> bool:
        """Judges U-Boot's lines; from the first one that a kernel has a part in, all is left to until()."""
        while self._new:
            line = self._new[0]
            self._check_uboot(line)
            if own := self._kernels_part(line, wanted):
                self._new[0] = own
                return True
            self._judge()
            if line == STARTING or (self._handed_over and line and STARTING.startswith(line)):
                self._handed_over = self._announced = True
            self._handed_over |= bool(HANDED_OVER.match(line))
        own = self._kernels_part(text(self._rest), wanted)
        if own and (FIRST_WORDS.search(own) or wanted.search(own)):  # another part may be U-Boot's still
            self._rest = own.encode()
            return True
        return False

    def _kernels_part(self, line: str, wanted: re.Pattern[str]) -> str:
        """What of a line a kernel has said, or a program of Linux; an empty text if nothing."""
        if FIRST_WORDS.search(line) and not line.startswith(IMAGE_NAME):
            return line
        if not self._handed_over or UBOOTS_OWN.match(line) or not line.strip():
            return ""
        if self._announced or wanted.search(line):
            return line
        return line[_announced(line) :]

    def _check_uboot(self, line: str) -> None:
        """Raises BootmFailed, BoardHung, BoardReset."""
        if self._ended.search(f"{line}\n".encode()) or RESET.search(line):
            raise self._bootm_failed()
        if HUNG in line:
            raise BoardHung(f"U-Boot gave up in bootm:\n{self._story()}")
        if UBOOT.match(line):
            when, cause = "in bootm", ""
            if self._handed_over:
                when, cause = (
                    "while Linux came up",
                    "the watchdog, a kernel that restarts it (panic=10), or power dips",
                )
            raise BoardReset(f"The board restarted {when}, after {self._last_words()}", cause=cause)

    def _no_kernel(self, goal: Goal) -> NetbootError:
        others = self._line.other_readers()
        if self._handed_over:
            return KernelMute(f"The kernel printed nothing within {goal.seconds:g} s.", cause=others)
        what = f"bootm did not end within {goal.bootm_seconds:g} s: {self._last_words()}"
        return BootmFailed(what, cause=others)

    def until(self, goal: Goal) -> str:
        """Returns the goal's line, or its beginning.

        Raises KernelPanic, LinuxSilent, and what until_kernel() does.
        """
        wanted = re.compile(goal.pattern)
        deadline = time.monotonic() + goal.seconds
        while True:
            while self._new:
                self._check_uboot(self._new[0])
                line = self._judge()
                if TROUBLE.search(line):
                    raise self._trouble(line)
                if wanted.search(line):
                    return line
            if wanted.search(text(self._rest)):
                line, self._rest = text(self._rest), b""
                self.show(line)
                return line
            if not self._hear(deadline):
                raise self._silence(goal)

    def _hear(self, deadline: float) -> bool:
        """Takes in what comes next; False when nothing does until then."""
        received = self._line.read(deadline - time.monotonic())
        *whole, self._rest = (self._rest + received).split(b"\n")
        if len(self._rest) > LINE_LIMIT:
            whole, self._rest = [*whole, self._rest], b""
        for line in map(text, whole):
            self.show(line)
            self._new.append(line)
        return bool(received) and time.monotonic() < deadline

    def _judge(self) -> str:
        self._judged.append(self._new.popleft())
        return self._judged[-1]

    def _trouble(self, first: str) -> NetbootError:
        """With what the kernel says of it: until it has ended, or is quiet."""
        story = [first]
        deadline = time.monotonic() + PANIC_SECONDS
        while not THE_END.search(story[-1]) and len(story) < LINES_KEPT:
            if self._new:
                story.append(self._judge())
            elif not self._hear(min(deadline, time.monotonic() + QUIET_SECONDS)):
                break
        lines = "\n".join(f"  {line}" for line in story)
        if any(NO_ROOT.search(line) for line in story):
            return RootMissing(f"The kernel found no root file system:\n{lines}")
        if any(PANIC.search(line) for line in story):
            return KernelPanic(f"The kernel panicked:\n{lines}")
        return KernelOops(f"The kernel reported an error:\n{lines}")

    def _bootm_failed(self) -> BootmFailed:
        received = self._story()
        causes = (cause for words, cause in BOOTM_WORDS.items() if re.search(words, received))
        return BootmFailed(f"U-Boot did not start the kernel:\n{received}", cause=next(causes, ""))

    def _story(self) -> str:
        return "\n".join(f"  {line}" for line in (*self._judged, *self._new))

    def _silence(self, goal: Goal) -> NetbootError:
        what = f"No line with '{goal.pattern}' within {goal.seconds:g} s; the last one: {self._last_words()}"
        if NO_ROOT.search(self._last_words()):
            return RootMissing(what)
        kind = KernelMute if UNPACKED in self._last_words() else LinuxSilent
        return kind(what, cause=self._line.other_readers())

    def _last_words(self) -> str:
        unfinished = "" if self._new else text(self._rest).strip()
        lines = [line for line in self._judged if line.strip()]
        return repr(unfinished or (lines[-1] if lines else ""))


def _announced(line: str) -> int:
    """How many characters of bootm's last words a line begins with."""
    return next(size for size in range(len(STARTING), -1, -1) if line.startswith(STARTING[:size]))
