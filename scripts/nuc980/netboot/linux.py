# SPDX-License-Identifier: GPL-3.0-or-later
"""Watches a kernel come up on the console: until its login, or its panic."""

from __future__ import annotations

import re
import time
from dataclasses import dataclass

from nuc980.netboot.console import text
from nuc980.netboot.errors import CommandFailed, KernelPanic, LinuxSilent
from nuc980.netboot.session import Session

PANIC = re.compile(rb"Kernel panic|Internal error: Oops|Unable to mount root fs")


@dataclass(frozen=True)
class Goal:
    """The line that ends a boot, a regular expression; seconds: how long it may take."""

    pattern: str = r"login: $"
    seconds: float = 120.0


def watch_linux(session: Session, goal: Goal, marker: int) -> None:
    """Shows the kernel's lines until the goal. marker: the number that appears when bootm gives up.

    Raises CommandFailed (bootm came back), KernelPanic, LinuxSilent.
    """
    line = session.console.line
    wanted = re.compile(goal.pattern.encode(), re.MULTILINE)
    failed = re.compile(rb"[\r\n]@%d:\d+\r?\n" % marker)
    said = b""
    shown = 0
    deadline = time.monotonic() + goal.seconds
    while not wanted.search(said):
        new = line.read(deadline - time.monotonic())
        said += new
        while (end := said.find(b"\n", shown)) >= 0:
            session.progress.note(f"  | {text(said[shown:end])}")
            shown = end + 1
        if failed.search(said):
            raise CommandFailed(f"bootm came back: {text(said)[-500:].strip()}")
        if PANIC.search(said):
            raise KernelPanic(f"The kernel panics: {text(said)[-500:].strip()}")
        if not new:
            raise LinuxSilent(f"No {goal.pattern!r} within {goal.seconds:g} s: {text(said)[-300:].strip()!r}")
