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

STARTING = "Starting kernel ..."
UNPACKED = "booting the kernel"  # the last word of a zImage that unpacks itself
UBOOT = re.compile(r"^U-Boot (SPL )?\d{4}\.\d\d")
RESET = re.compile(r"[Mm]ust RESET (the )?board")
PANIC = re.compile(r"Kernel panic - not syncing")
TROUBLE = re.compile(rf"{PANIC.pattern}|Internal error: |Unable to handle kernel |Cannot open root device")
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

    first_seconds: for the kernel's first word, after it has unpacked itself; seconds: from there to the goal.
    """

    pattern: str = r"^\S+ login: "
    seconds: float = 120.0
    first_seconds: float = 30.0


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

    def until_kernel(self, seconds: float) -> None:
        """Until the kernel's first word. Raises BootmFailed, KernelMute."""
        deadline = time.monotonic() + seconds
        started = False
        while self._hear(deadline):
            while self._new:
                if self._gave_up(self._new[0]):
                    raise self._bootm_failed()
                if started and self._new[0].strip():
                    return
                started |= STARTING in self._judge()
            if started and self._rest.strip():
                return
        if not started:
            raise BootmFailed(f"bootm did not end within {seconds:g} s: {self._last_words()}")
        raise KernelMute(f"Not a word of the kernel within {seconds:g} s.")

    def until(self, goal: Goal) -> str:
        """Returns the goal's line, or its beginning. Raises KernelPanic, BoardReset, LinuxSilent."""
        wanted = re.compile(goal.pattern)
        deadline = time.monotonic() + goal.seconds
        while True:
            while self._new:
                if UBOOT.match(self._new[0]):
                    raise BoardReset(
                        f"The board started anew while Linux came up, after {self._last_words()}",
                        cause="the watchdog, a kernel that restarts it (panic=10), or power dips",
                    )
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
        said = self._line.read(deadline - time.monotonic())
        *whole, self._rest = (self._rest + said).split(b"\n")
        if len(self._rest) > LINE_LIMIT:
            whole, self._rest = [*whole, self._rest], b""
        for line in map(text, whole):
            self.show(line)
            self._new.append(line)
        return bool(said) and time.monotonic() < deadline

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
        return KernelOops(f"The kernel stumbled:\n{lines}")

    def _gave_up(self, line: str) -> bool:
        return bool(self._ended.search(f"{line}\n".encode()) or RESET.search(line) or UBOOT.match(line))

    def _bootm_failed(self) -> BootmFailed:
        said = "\n".join(f"  {line}" for line in (*self._judged, *self._new))
        causes = (cause for words, cause in BOOTM_WORDS.items() if re.search(words, said))
        return BootmFailed(f"U-Boot did not start the kernel:\n{said}", cause=next(causes, ""))

    def _silence(self, goal: Goal) -> NetbootError:
        what = f"No line with '{goal.pattern}' within {goal.seconds:g} s; the last one: {self._last_words()}"
        if NO_ROOT.search(self._last_words()):
            return RootMissing(what)
        return KernelMute(what) if UNPACKED in self._last_words() else LinuxSilent(what)

    def _last_words(self) -> str:
        unfinished = "" if self._new else text(self._rest).strip()
        lines = [line for line in self._judged if line.strip()]
        return repr(unfinished or (lines[-1] if lines else ""))
