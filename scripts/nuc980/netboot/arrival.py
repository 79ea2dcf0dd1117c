# SPDX-License-Identifier: GPL-3.0-or-later
"""The way to U-Boot's prompt, from wherever the board is."""

from __future__ import annotations

import re
import threading
from collections.abc import Callable
from enum import Enum, auto

from nuc980.netboot import linux
from nuc980.netboot.errors import (
    AutobootMissed,
    BoardHung,
    Garbage,
    NetbootError,
    NoOutput,
    NotUBoot,
    PowerHookFailed,
    SpeedRefused,
    StuckConsole,
)
from nuc980.netboot.transport import Line

# Stops autoboot, ends a command that looks for it, gives up a half-typed line, shows the prompt; U-Boot says
# <INTERRUPT> to it, which no shell of Linux's does. A bare Enter would run the last command again. A board
# with another speed reads it as other bytes, of which none is an Enter.
CTRL_C = b"\x03"

# The factory's, the others of its table, the usual ones of other boards.
SPEEDS = (115200, 57600, 38400, 9600, 19200, 921600)

# From a start's first words on. With bootdelay=0 U-Boot looks once whether a key waits in the UART, which has
# room for 16. Those before the UART is set up (last after relocation, less than 50 ms before on the twin) are
# lost, each one too many gets a prompt of its own.
POKE_SECONDS = 0.02
# A board that says nothing: enough to see it at its prompt, too little to be in the way of a boot ROM.
IDLE_POKE_SECONDS = 1.0
QUIET_SECONDS = 2.0  # from here on it says nothing
SPEED_SECONDS = 0.4  # an answer takes so long at most
SETTLED_SECONDS = 0.25  # the answers to all keys are there

STARTING = re.compile(rb"^U-Boot (?:SPL )?\d{4}\.\d\d|^DRAM: |to stop autoboot|autoboot in \d", re.M)
KERNEL = re.compile(rf"Starting kernel|{linux.KERNEL}".encode())
LOGIN = re.compile(rb"(?:login|Password): \Z")
# A shell repeats its prompt for a Ctrl-C.
SHELL = re.compile(rb"(?:^|\n)([^\n]*[#$] )(?:(?!<INTERRUPT>)[^\n]){0,16}\n+\1\Z")
PROMPT = re.compile(rb"<INTERRUPT>\n([ -~]{1,40})\Z")

SPEED_ELSEWHERE = (
    "set what this port leads to, a serial server or a pty's other end, to the board's 115200 bit/s, 8N1:"
    " the port itself has no speed"
)

NOISE_WINDOW = 48
TEXT_LEAST = 8
KEPT = 1 << 14  # of what the board says, ample for a start
TAIL = 300  # more than a prompt and the answer before it


class Place(Enum):
    """Where the board is."""

    SILENT = auto()
    NOISE = auto()
    UNKNOWN = auto()
    KERNEL = auto()
    LINUX = auto()  # its login, or a shell
    PROMPT = auto()
    HUNG = auto()  # U-Boot, for ever


NO_KEYS = (Place.KERNEL, Place.LINUX, Place.PROMPT)
WAITING = {
    Place.SILENT: "Waiting for the board: switch it on, or press its reset button.",
    Place.KERNEL: "The board boots what it has: switch it off and on again.",
    Place.LINUX: "Linux runs on the board: switch it off and on again.",
}


class Arrival:
    """Listens and presses Ctrl-C until U-Boot's prompt is there.

    Linux gets no keys: they could end what runs there, or make init give up a getty that ends too often.
    """

    def __init__(
        self, line: Line, say: Callable[[str], None], power_cycle: Callable[[], None] | None = None
    ) -> None:
        self.received = b""  # all of it, without carriage returns
        self.prompt = b""
        self._line = line
        self._say = say
        self._hook = _Running(power_cycle) if power_cycle else None
        self._first = line.baud
        self._speeds = (self._first, *(speed for speed in SPEEDS if speed != self._first and line.has_speed))
        self._untried = 0 if self._hook else len(self._speeds)
        self._tuned = 0  # where in `received` the present speed begins
        self._started = line.now()
        self._tuned_at = self._heard_at = self._poked_at = self._started
        self._words: Place | None = None  # where the last words that could be read came from
        self._told: Place | None = None

    def wait(self, patience: float) -> str:
        """Returns at the prompt, with what the board said on the way.

        patience: seconds, from the end of the power hook on if there is one.
        Raises AutobootMissed, BoardHung, Garbage, NoOutput, NotUBoot, PowerHookFailed, StuckConsole.
        """
        deadline = self._started + patience
        self._poke()
        while self._line.now() < deadline:
            self._listen()
            place = self._place()
            if self._hook and self._hook.runs():
                deadline = self._line.now() + patience
            elif place is Place.PROMPT and self._quiet() >= SETTLED_SECONDS:
                return self._arrived()
            elif place is Place.HUNG or (place is Place.KERNEL and self._hook):
                raise self._why_not()
            self._tell(place)
            self._act(place)
        raise self._why_not()

    def _listen(self) -> None:
        if new := self._line.read(POKE_SECONDS).replace(b"\r", b""):
            self.received = (self.received + new)[-KEPT:]
            self._tuned = min(self._tuned, len(self.received) - len(new))
            self._heard_at = self._line.now()

    def _quiet(self) -> float:
        return self._line.now() - self._heard_at

    def _place(self) -> Place:
        heard = self.received[self._tuned :]
        words = self._since_start(heard)
        end = words[-TAIL:]
        if is_noise(heard[-NOISE_WINDOW:]):
            return Place.NOISE
        if linux.HUNG.encode() in end:
            self._words = Place.HUNG
        elif PROMPT.search(end):
            self._words = Place.PROMPT
        elif LOGIN.search(end) or SHELL.search(end):
            self._words = Place.LINUX
        elif KERNEL.search(words):
            self._words = Place.KERNEL
        elif is_text(words[-NOISE_WINDOW:]):
            self._words = Place.UNKNOWN
        else:
            return Place.UNKNOWN if words else Place.SILENT
        return self._words

    def _since_start(self, heard: bytes) -> bytes:
        """Without what came before the board's last start; nothing until the hook has made it start."""
        starts = [found.start() for found in STARTING.finditer(heard)]
        if starts:
            return heard[starts[-1] :]
        return b"" if self._hook else heard

    def _act(self, place: Place) -> None:
        if place is Place.NOISE and len(self._speeds) > 1:
            self._untried = len(self._speeds)
            self._retune()
        elif place in (Place.SILENT, Place.UNKNOWN) and not self._readable() and self._speed_is_over():
            self._untried -= 1
            self._retune()
        elif place not in NO_KEYS and self._line.now() - self._poked_at >= self._pause(place):
            self._poke()

    def _readable(self) -> bool:
        return len(self.received) - self._tuned >= TEXT_LEAST

    def _speed_is_over(self) -> bool:
        return self._untried > 0 and self._line.now() - self._tuned_at >= SPEED_SECONDS

    def _pause(self, place: Place) -> float:
        return POKE_SECONDS if place is Place.UNKNOWN and self._quiet() < QUIET_SECONDS else IDLE_POKE_SECONDS

    def _poke(self) -> None:
        self._line.write(CTRL_C)
        self._poked_at = self._line.now()

    def _retune(self) -> None:
        at = self._speeds.index(self._line.baud)
        for speed in (*self._speeds[at + 1 :], *self._speeds[: at + 1]):
            try:
                self._line.baud = speed
                break
            except SpeedRefused:
                self._untried -= 1
        self._tuned = len(self.received)
        self._tuned_at = self._line.now()
        self._poke()

    def _tell(self, place: Place) -> None:
        waited = self._line.now() - self._started > IDLE_POKE_SECONDS
        sweeps = self._untried > 0 and not self._words
        if place in WAITING and place is not self._told and not self._hook and waited and not sweeps:
            self._say(WAITING[place])
            self._told = place

    def _arrived(self) -> str:
        found = PROMPT.search(self.received)
        assert found
        self.prompt = found[1]
        if self._line.baud != self._first:
            self._say(f"The board's console has {self._line.baud} bit/s, not {self._first}.")
        return self.received.decode(errors="replace")

    def _why_not(self) -> NetbootError:
        last = self.received.decode(errors="replace")[-200:]
        match self._words:
            case Place.HUNG:
                return BoardHung(f"U-Boot does not come up. It says: {last.strip()!r}")
            case None if not self.received:
                what = f"Nothing came from {self._line.url}{self._tried()}."
                return NoOutput(what, cause=self._line.other_readers())
            case None if self._hook and not is_noise(self.received[-NOISE_WINDOW:]):
                return PowerHookFailed("The power hook ran, but the board did not restart.")
            case None:
                what = f"What comes from {self._line.url} is not text{self._tried()}."
                elsewhere = "" if self._line.has_speed else SPEED_ELSEWHERE
                return Garbage(what, cause=self._line.other_readers(), next_step=elsewhere)
            case Place.LINUX if STARTING.search(self.received):
                return AutobootMissed("The board booted what it has: U-Boot's prompt was missed.")
            case Place.LINUX:
                return NotUBoot(f"Linux runs on the board, and no start was seen. It says: {last!r}")
            case Place.KERNEL:
                return AutobootMissed("The board boots what it has: U-Boot's prompt was missed.")
            case _:
                return StuckConsole(f"No prompt of U-Boot's came. The last words: {last!r}")

    def _tried(self) -> str:
        return f", at {', '.join(map(str, self._speeds))} bit/s" if self._line.has_speed else ""


class _Running:
    """A power hook at work, while the line is listened to: a board may start before its hook has ended."""

    def __init__(self, switch: Callable[[], None]) -> None:
        self._switch = switch
        self._error: Exception | None = None
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        try:
            self._switch()
        except Exception as error:  # raised again where it is waited for
            self._error = error

    def runs(self) -> bool:
        """Raises what the hook raised."""
        if self._thread.is_alive():
            return True
        if self._error:
            raise self._error
        return False


def is_noise(received: bytes) -> bool:
    """Enough to judge, and a third of it is no text."""
    return _odd(received) >= 4 and _odd(received) * 3 > len(received)


def is_text(received: bytes) -> bool:
    """Enough to judge, and nearly all of it is text."""
    return len(received) >= TEXT_LEAST and _odd(received) * 10 <= len(received)


def _odd(received: bytes) -> int:
    return sum(byte not in b"\a\b\t\n\r\x1b" and not 32 <= byte < 127 for byte in received)
