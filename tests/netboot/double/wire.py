# SPDX-License-Identifier: GPL-3.0-or-later
"""The console's UART on the master side of a pty: its FIFO, its speed, and the faults of the line."""

from __future__ import annotations

import errno
import os
import random
import select
import shutil
import tempfile
import termios
import time
import tty
from collections.abc import Sequence
from pathlib import Path

from .faults import Fault

FIFO = 16
AT_ONCE = 2048  # bytes
NOBODY = termios.B50  # the pty's speed until somebody opens it


class PowerCut(Exception):
    """The supply went off and on again."""


class Ended(Exception):
    """The test is over, or the port is gone."""


class Wire:
    """getc, tstc and puts as U-Boot has them. All wait in `_wait`, which the board's power switch interrupts.

    baud: the board's speed; what a tool says or hears at another one is garbage. line_end: what is sent for a
    line feed.
    heard: all that came, as it left the tool.
    """

    def __init__(self, baud: int, line_end: bytes, faults: Sequence[Fault], seed: int) -> None:
        self.line_end = line_end
        self._speed = getattr(termios, f"B{baud}")
        self._faults = faults
        self._random = random.Random(seed)
        self._fifo = bytearray()
        self._unsent = bytearray()
        self._left = True
        self.heard = bytearray()
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self._set_speed(NOBODY)
        os.set_blocking(self._master, False)
        self.port = os.ttyname(self._slave)
        # A named pipe, so that a command of the tool's can press the switch as well as a test.
        self._folder = tempfile.mkdtemp(prefix="double-")
        self.switch = Path(self._folder) / "power"
        os.mkfifo(self.switch)
        self._pressed = os.open(self.switch, os.O_RDWR | os.O_NONBLOCK)

    # ---- the test's side

    def press(self, key: bytes) -> None:
        """b"p": the supply goes off and on; b"e": the end."""
        os.write(self._pressed, key)

    def free(self) -> None:
        self.unplug()
        os.close(self._pressed)
        shutil.rmtree(self._folder)

    def unplug(self) -> None:
        """The port is gone, as a USB adapter's is that was pulled out."""
        for end in (self._master, self._slave):
            if end >= 0:
                os.close(end)
        self._master = self._slave = -1

    # ---- the board's side

    def opened(self) -> bool:
        """Whether a tool has set the port's speed."""
        return termios.tcgetattr(self._master)[4] != NOBODY

    def pause(self, seconds: float) -> None:
        """Lets time pass; what comes meanwhile stays in the line."""
        deadline = time.monotonic() + seconds
        while (left := deadline - time.monotonic()) > 0:
            self._wait([], [], left)

    def deaf(self) -> None:
        """For ever."""
        while True:
            self.pause(3600)

    def forget(self) -> None:
        """A reset: what has come is lost."""
        while self._receive():
            pass
        self._fifo.clear()
        self._left = True

    def tstc(self, seconds: float = 0) -> bool:
        """Whether a byte is there, or comes within the time."""
        if not self._fifo:
            self._wait([self._master], [], seconds)
            self._receive()
        return bool(self._fifo)

    def getc(self) -> int:
        while not self.tstc(3600):
            pass
        return self._fifo.pop(0)

    def leave(self) -> None:
        """The board turns to something else: what comes now beyond the FIFO's size is lost."""
        self._left = True
        del self._fifo[FIFO:]

    def turn_to(self) -> None:
        """The board reads on."""
        self._wait([], [], 0)
        while self._receive():
            pass
        self._left = False

    def puts(self, text: str | bytes, cut: int = 0) -> None:
        """With the carriage returns of the UART's driver. Text is Latin-1. cut: bytes lost at its end."""
        data = text.encode("latin-1", "replace") if isinstance(text, str) else text
        data = data.replace(b"\n", self.line_end)
        data = data[: max(len(data) - cut, 0)]
        for fault in self._faults:
            data = fault.sent(data)
        self._unsent += data
        if len(self._unsent) > AT_ONCE:
            self._send()

    def _send(self) -> None:
        """What was put since the last time: before the board waits, and when it is much."""
        data, self._unsent = bytes(self._unsent), bytearray()
        if data and self._wrong_speed():
            data = self._garbage(data)
        while data:
            self._wait([], [self._master], 3600)
            try:
                data = data[os.write(self._master, data) :]
            except BlockingIOError:
                continue
            except OSError as error:
                raise Ended from error

    def _receive(self) -> bool:
        try:
            data = os.read(self._master, 4096)
        except BlockingIOError:
            return False
        except OSError as error:
            if error.errno == errno.EIO:
                raise Ended from error
            raise
        self.heard += data
        if self._wrong_speed():
            data = self._garbage(data)
        for fault in self._faults:
            data = fault.received(data)
        self._fifo += data
        if self._left:
            del self._fifo[FIFO:]
        return True

    def _wait(self, readers: list[int], writers: list[int], seconds: float) -> None:
        if self._master < 0:
            raise Ended
        if self._unsent and not writers:
            self._send()
        ready, _, _ = select.select([self._pressed, *readers], writers, [], seconds)
        if self._pressed in ready:
            keys = os.read(self._pressed, 4096)
            raise Ended if b"e" in keys else PowerCut

    def _set_speed(self, speed: int) -> None:
        settings = termios.tcgetattr(self._slave)
        settings[4] = settings[5] = speed
        termios.tcsetattr(self._slave, termios.TCSANOW, settings)

    def _wrong_speed(self) -> bool:
        if self._master < 0:
            raise Ended
        return termios.tcgetattr(self._master)[5] not in (self._speed, NOBODY)

    def _garbage(self, data: bytes) -> bytes:
        """Some bytes too few, and most with the upper bits of a start bit taken for data."""
        return bytes(self._random.choice((0x00, 0x80, 0xE0, 0xF8, 0x78, 0xFE)) for _ in data[::2])
