# SPDX-License-Identifier: GPL-3.0-or-later
"""The way to U-Boot's prompt, from wherever the board is."""

from __future__ import annotations

import math
import re
import threading
from collections.abc import Callable
from enum import Enum, auto

from nuc980.netboot import host, linux
from nuc980.netboot.commandline import LINE_ROOM
from nuc980.netboot.entrance import OPEN, Entrance
from nuc980.netboot.errors import (
    AutobootKeyed,
    AutobootMissed,
    BoardHung,
    Garbage,
    NetbootError,
    NoOutput,
    NotUBoot,
    PasswordNeeded,
    PasswordRefused,
    PowerHookFailed,
    SpeedRefused,
    StuckConsole,
)
from nuc980.netboot.transport import Line

# Stops autoboot, ends a command that looks for it, gives up a half-typed line, shows the prompt; U-Boot says
# <INTERRUPT> to it, which no shell of Linux's does. A bare Enter would run the last command again. A board
# with another speed reads it as other bytes, of which none is an Enter.
CTRL_C = b"\x03"
# Goes before the first Ctrl-C to a board that says nothing: to the end of the line, and one character back.
# U-Boot's line editor and a shell's answer neither at an empty line; a Linux terminal shows the former, also
# while a program runs. No speed makes an Enter of it.
KNOCK = b"\x05\x7f"
KNOCKED_AT_LINUX = b"^E"

# The factory's, the others of its table, the usual ones of other boards.
SPEEDS = (115200, 57600, 38400, 9600, 19200, 921600)

# From a start's first words on. With bootdelay=0 U-Boot looks once whether a key waits in the UART, which has
# room for 16. Those before the UART is set up (last after relocation, less than 50 ms before on the twin) are
# lost, each one too many gets a prompt of its own.
POKE_SECONDS = 0.02
# When autoboot counts, one key does, and each one more is a try where it asks for a password then.
COUNTING_POKE_SECONDS = 0.25
# A program that is at work on the console shows itself within; then the knock is answered within.
LISTEN_SECONDS = 1.5
KNOCK_SECONDS = 0.3
# A board that says nothing: enough to see it at its prompt, too little to be in the way of a boot ROM.
IDLE_POKE_SECONDS = 1.0
QUIET_SECONDS = 2.0  # from here on it says nothing
SPEED_SECONDS = 0.4  # an answer takes so long at most
SETTLED_SECONDS = 0.25  # the answers to all keys are there

COUNTS = rb"\x08\x08\x08[ \d]\d "  # autoboot does
STARTING = re.compile(
    rb"^U-Boot (?:SPL )?\d{4}\.\d\d|^DRAM: |^[^\n]*(?:to stop autoboot|(?i:autoboot) in \d)|" + COUNTS, re.M
)
# U-Boot, from the network: it may try for ever.
LOADS = re.compile(rb"^(?:Loading: |TFTP |BOOTP |ARP Retry|Retry count|Using \S+ device)|(?:#|T ){4}", re.M)
KERNEL = re.compile(rf"Starting kernel|{linux.KERNEL}".encode())
LOGIN = re.compile(rb"(?:login|Password): \Z")
# A shell repeats its prompt for a Ctrl-C.
SHELL = re.compile(rb"(?:^|\n)([^\n]*[#$] )(?:(?!<INTERRUPT>)[^\n]){0,16}\n+\1\Z")
PROMPT = re.compile(rb"<INTERRUPT>\n([ -~]{1,40})\Z")
LIKE_A_PROMPT = re.compile(rb"(?:^|\n)[ -~]{0,40}[>#$] ?\Z")

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
    TALKS = auto()  # something that nobody has seen start
    KEYED = auto()  # autoboot, which a certain string stops
    LOCKED = auto()  # it asks for a password
    KERNEL = auto()
    LINUX = auto()  # its login, or a shell
    PROMPT = auto()
    HUNG = auto()  # U-Boot, for ever


NO_KEYS = (Place.TALKS, Place.KEYED, Place.LOCKED, Place.KERNEL, Place.LINUX, Place.PROMPT)
WAITING = {
    Place.SILENT: "Waiting for the board: switch it on, or press its reset button.",
    Place.KERNEL: "The board boots what it has: switch it off and on again.",
    Place.LINUX: "Linux runs on the board: switch it off and on again.",
    Place.TALKS: "Something runs on the board, and keys could end it: switch the board off and on again.",
}


class Arrival:
    """Listens, and presses Ctrl-C until U-Boot's prompt is there.

    Linux gets no keys: they could end what runs there, or make init give up a getty that ends too often. So a
    board that was not seen to start is listened to first; what talks is left alone.
    """

    def __init__(
        self,
        line: Line,
        say: Callable[[str], None],
        power_cycle: Callable[[], None] | None = None,
        entrance: Entrance = OPEN,
    ) -> None:
        self.received = b""  # all of it, without carriage returns
        self.prompt = b""
        self._line = line
        self._say = say
        self._entrance = entrance
        self._hook = _Running(power_cycle) if power_cycle else None
        self._first = line.baud
        self._speeds = (self._first, *(speed for speed in SPEEDS if speed != self._first and line.has_speed))
        self._untried = 0 if self._hook else len(self._speeds)
        self._tuned = 0  # where in `received` the present speed begins
        self._started = line.now()
        self._tuned_at = self._heard_at = self._poked_at = self._started
        self._knocked_at: float | None = None  # at the present speed
        self._may_press = bool(power_cycle)  # at a board that was not seen to start
        self._retunes = 0
        self._answered = 0  # where in `received` begins what came after the last secret
        self._typed_to: set[Place] = set()  # what asked for it
        self._words: Place | None = None  # where the last words that could be read came from
        self._told: Place | None = None

    def wait(self, patience: float) -> str:
        """Returns at the prompt, with what the board said on the way.

        patience: seconds, from the end of the power hook on if there is one.
        Raises AutobootKeyed, AutobootMissed, BoardHung, Garbage, NoOutput, NotUBoot, PasswordNeeded,
        PasswordRefused, PowerHookFailed, StuckConsole.
        """
        deadline = self._started + patience
        if self._may_press:
            self._poke()
        while self._line.now() < deadline:
            self._listen()
            place = self._place()
            if self._hook and self._hook.runs():
                deadline = self._line.now() + patience
            elif place is Place.PROMPT and self._quiet() >= SETTLED_SECONDS:
                return self._arrived()
            elif place is Place.HUNG or (place is Place.KERNEL and (self._hook or self._typed_to)):
                raise self._why_not()
            elif place in (Place.KEYED, Place.LOCKED) and self._quiet() >= SETTLED_SECONDS:
                self._unlock(place, self._unanswered(self._words_since_start()))
            self._tell(place)
            self._act(place)
        raise self._why_not()

    def _listen(self) -> None:
        if new := self._line.read(POKE_SECONDS).replace(b"\r", b""):
            self.received = (self.received + new)[-KEPT:]
            self._tuned = min(self._tuned, len(self.received) - len(new))
            self._answered = min(self._answered, len(self.received) - len(new))
            self._heard_at = self._line.now()

    def _quiet(self) -> float:
        return self._line.now() - self._heard_at

    def _place(self) -> Place:
        words = self._words_since_start()
        if is_noise(self.received[self._tuned :][-NOISE_WINDOW:]):
            return Place.NOISE
        place = self._place_by(words)
        if place not in (Place.UNKNOWN, Place.SILENT) or is_text(words[-NOISE_WINDOW:]):
            self._words = place
        return place

    def _place_by(self, words: bytes) -> Place:
        end = words[-TAIL:]
        is_linux = LOGIN.search(end) or SHELL.search(end)
        if linux.HUNG.encode() in end:
            return Place.HUNG
        if self._prompt_in(end):
            return Place.PROMPT
        if KERNEL.search(words):
            return Place.LINUX if is_linux else Place.KERNEL
        if self._starts(words):
            return self._barred(self._unanswered(words)) or Place.UNKNOWN
        if is_linux or self._knock_was_shown():
            return Place.LINUX
        if self._says_lines(words) and not LOADS.search(words) and not LIKE_A_PROMPT.search(end):
            return Place.TALKS
        return Place.UNKNOWN if words else Place.SILENT

    def _says_lines(self, words: bytes) -> bool:
        """Or what is no line that somebody has half typed."""
        return (b"\n" in words.strip() or len(words) > LINE_ROOM) and is_text(words[-NOISE_WINDOW:])

    def _barred(self, words: bytes) -> Place | None:
        if self._entrance.asks_password(words):
            return Place.LOCKED
        return Place.KEYED if self._entrance.keyed_line(words) else None

    def _unanswered(self, words: bytes) -> bytes:
        """What of them came after the last secret was typed."""
        return words[max(0, self._answered - (len(self.received) - len(words))) :]

    def _starts(self, words: bytes) -> bool:
        return bool(STARTING.search(words) or self._entrance.autoboot_line(words))

    def _prompt_in(self, end: bytes) -> re.Match[bytes] | None:
        return PROMPT.search(end) or self._entrance.prompt_in(end)

    def _knock_was_shown(self) -> bool:
        return self._knocked_at is not None and KNOCKED_AT_LINUX in self.received[self._tuned :]

    def _words_since_start(self) -> bytes:
        """Without what came before the board's last start; nothing until the hook has made it start."""
        heard = self.received[self._tuned :]
        starts = [found.start() for found in STARTING.finditer(heard)]
        if starts:
            return heard[starts[-1] :]
        own = self._entrance.autoboot_line(heard)
        return b"" if self._hook and not own else heard

    def _act(self, place: Place) -> None:
        if place is Place.NOISE and len(self._speeds) > 1:
            self._untried = len(self._speeds)
            self._retune()
        elif place in (Place.SILENT, Place.UNKNOWN) and not self._readable() and self._speed_is_over():
            self._untried -= 1
            self._retune()
        elif place in NO_KEYS or self._line.now() - self._poked_at < self._pause(place):
            return
        elif self._may_press or self._is_uboot(self.received[self._tuned :]):
            self._poke()
        elif place is not Place.NOISE:
            self._knock()

    def _is_uboot(self, heard: bytes) -> bool:
        return self._starts(heard) or bool(LOADS.search(heard))

    def _knock(self) -> None:
        """Before the first key, and after a silence."""
        if self._knocked_at is None:
            if self._quiet() >= LISTEN_SECONDS:
                self._line.write(KNOCK)
                self._knocked_at = self._line.now()
        elif self._line.now() - self._knocked_at >= KNOCK_SECONDS:
            self._may_press = True
            self._tuned_at = self._line.now()

    def _unlock(self, place: Place, words: bytes) -> None:
        """Types what stops autoboot, or the password, once. Raises what is to be said if there is none."""
        asked = self._entrance.keyed_line(words) if place is Place.KEYED else words.rpartition(b"\n")[2]
        what = repr(asked.decode(errors="replace").strip())
        keys = self._entrance.interrupt_keys if place is Place.KEYED else self._entrance.password_keys
        if place in self._typed_to:
            raise PasswordRefused(f"The board asks again: {what}.")
        if not keys and place is Place.KEYED:
            raise AutobootKeyed(f"Autoboot is not stopped by any key: {what}.")
        if not keys:
            raise PasswordNeeded(f"U-Boot asks for a password: {what}.")
        self._line.write(keys, secret=True)
        self._typed_to.add(place)
        self._answered = len(self.received)
        self._poked_at = self._line.now()

    def _readable(self) -> bool:
        heard = self.received[self._tuned :]
        return len(heard) >= TEXT_LEAST or len(heard) - _odd(heard) >= TEXT_LEAST // 2

    def _speed_is_over(self) -> bool:
        sweeps = self._untried > 0 and (self._may_press or self._retunes)
        return sweeps and self._line.now() - self._tuned_at >= SPEED_SECONDS

    def _pause(self, place: Place) -> float:
        """Seconds from one key to the next."""
        heard = self.received[self._tuned :]
        hurry = place is Place.UNKNOWN and self._quiet() < QUIET_SECONDS and self._is_uboot(heard)
        if not hurry or self._typed_to:
            return IDLE_POKE_SECONDS
        if self._entrance.autoboot_line(heard):
            return COUNTING_POKE_SECONDS
        # or the first key would be one too many of the string that stops autoboot
        return math.inf if self._entrance.interrupt_keys else POKE_SECONDS

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
        self._retunes += 1
        self._may_press |= self._retunes >= len(self._speeds)  # each was listened to
        if self._may_press:
            self._poke()

    def _tell(self, place: Place) -> None:
        waited = self._line.now() - self._started > IDLE_POKE_SECONDS
        sweeps = self._untried > 0 and not self._words
        if place in WAITING and place is not self._told and not self._hook and waited and not sweeps:
            self._say(WAITING[place])
            self._told = place

    def _arrived(self) -> str:
        self._line.reveal()
        found = self._prompt_in(self.received)
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
            case Place.LINUX | Place.KERNEL if Place.KEYED in self._typed_to:
                return PasswordRefused("The board booted what it has: it did not take the stop string.")
            case Place.LINUX if STARTING.search(self.received):
                what = "The board booted what it has: U-Boot's prompt was missed."
                return AutobootMissed(what, cause=host.busy())
            case Place.LINUX:
                return NotUBoot(f"Linux runs on the board, and no start was seen. It says: {last!r}")
            case Place.TALKS:
                what = f"Something runs on the board that no key was pressed to. It says: {last!r}"
                return NotUBoot(what, cause="a program at Linux's console, or another boot loader")
            case Place.KERNEL:
                what = "The board boots what it has: U-Boot's prompt was missed."
                return AutobootMissed(what, cause=host.busy())
            case _:
                return StuckConsole(
                    f"No prompt of U-Boot's came. The last words: {last!r}", cause=host.busy()
                )

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
