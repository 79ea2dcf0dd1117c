# SPDX-License-Identifier: GPL-3.0-or-later
"""Hands the line over to a person: a terminal as simple as it gets, of which the log keeps every byte too."""

from __future__ import annotations

import os
import select
import signal
import sys
import termios
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import NoReturn

from nuc980.netboot.errors import UnusableInput
from nuc980.netboot.transport import Line

LEAVE = b"\x1d"  # Ctrl-], as telnet and miniterm have it
HINT = "Terminal on {url}. Ctrl-] leaves it; all other keys, Ctrl-C too, go to the board."
TURN_SECONDS = 0.02


def check_terminal() -> None:
    """That there is one to hand over to. Raises UnusableInput."""
    if not sys.stdin.isatty():
        raise UnusableInput("--console needs a terminal", next_step="omit --console, or use ssh -t")


def hand_over(line: Line) -> None:
    """Standard input and output are the board's until Ctrl-] or the end of input; then as they were before.

    Raises UnusableInput without a terminal, LineLost.
    """
    check_terminal()
    keyboard, screen = sys.stdin.fileno(), sys.stdout.fileno()
    with _raw(keyboard):  # which drops what was typed before: the hint comes after it
        _write_all(screen, f"{HINT.format(url=line.url)}\r\n".encode())
        while _keys_to(line, keyboard):
            _write_all(screen, line.read(TURN_SECONDS))
    print("\nThe terminal is yours again; the board runs on.", flush=True)


def _keys_to(line: Line, keyboard: int) -> bool:
    """Whether to go on."""
    ready, _, _ = select.select([keyboard], [], [], 0)
    if not ready:
        return True
    keys, leave, _ = os.read(keyboard, 4096).partition(LEAVE)
    if keys:
        line.write(keys)
    return bool(keys) and not leave


def _write_all(screen: int, data: bytes) -> None:
    while data:
        data = data[os.write(screen, data) :]


@contextmanager
def _raw(keyboard: int) -> Iterator[None]:
    """A terminal that is killed (SIGTERM, SIGHUP) is put right as well."""

    def end(number: int, _: FrameType | None) -> NoReturn:
        sys.exit(128 + number)

    before = termios.tcgetattr(keyboard)
    handlers = {number: signal.signal(number, end) for number in (signal.SIGTERM, signal.SIGHUP)}
    try:
        tty.setraw(keyboard)
        yield
    finally:
        termios.tcsetattr(keyboard, termios.TCSADRAIN, before)
        for number, handler in handlers.items():
            signal.signal(number, handler)
