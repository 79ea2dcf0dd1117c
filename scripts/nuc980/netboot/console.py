# SPDX-License-Identifier: GPL-3.0-or-later
"""U-Boot's command line: reach it, type so that nothing else than meant is run, know how it ended."""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from dataclasses import dataclass

from nuc980.netboot.errors import (
    AutobootMissed,
    BoardReset,
    CommandFailed,
    Garbage,
    LineTooLong,
    LineUnsafe,
    NoOutput,
    NoStatus,
    NotUBoot,
    StuckConsole,
)
from nuc980.netboot.transport import Line

# What the UART's receiver holds while U-Boot looks elsewhere; the factory's console drops the rest.
CHUNK = 16
# CONFIG_SYS_CBSIZE is 256, the reader takes 254 (shared by the vendor's and the mainline cread_line).
LINE_ROOM = 254
# Of the console's table of speeds, and the usual ones of others.
SPEEDS = (115200, 57600, 38400, 9600, 19200, 921600)

# Stops autoboot, gives up a half-typed line, shows the prompt. A bare Enter would run the last command again.
CTRL_C = b"\x03"

ECHO_SECONDS = 1.0
PROMPT_SECONDS = 3.0
POKE_SECONDS = 0.1
TRIES = 3

BANNER = re.compile(rb"(^|\n)U-Boot (SPL )?\d{4}\.\d\d")
RESTARTED = re.compile(rb"\nU-Boot (SPL )?\d{4}\.\d\d[^\n]*\n(.*\n)*?DRAM:")
COUNTDOWN = re.compile(rb"to stop autoboot|autoboot in \d")
KERNEL = re.compile(rb"Starting kernel|Uncompressing Linux|Booting Linux|Linux version \d")
LINUX = re.compile(rb"login: $|Password: $")
PROMPT = re.compile(rb"(?:^|\n)([!-~][ -~]{0,30}[>#$%] ?)$|(?:^|\n)([>#$%] ?)$")


@dataclass(frozen=True)
class Answer:
    """What U-Boot printed for a command, and its exit status."""

    command: str
    status: int
    output: str

    def required(self) -> str:
        """The output of a command that must succeed. Raises CommandFailed."""
        if self.status:
            raise CommandFailed(f"U-Boot: '{self.command}' failed: {self.output.strip() or 'without a word'}")
        return self.output


Watch = Callable[[str], None]


def _nothing(_: str) -> None:
    return


class Console:
    """The command line at the other end of a line. say: gets a note now and then of what is being tried."""

    def __init__(self, line: Line, say: Watch = _nothing) -> None:
        self.line = line
        self.say = say
        self.prompt = b""
        self._commands = 0

    # ---- to the prompt

    def reach(self, power_cycle: Callable[[], None] | None = None, patience: float = 60.0) -> str:
        """Brings the board to U-Boot's prompt, from wherever it is; returns what it said on the way.

        power_cycle: switches the board off and on; without it, a board that is not at the prompt already is
        waited for: somebody has to switch it on within `patience` seconds.
        Raises NoOutput, Garbage, AutobootMissed, NotUBoot, NoStatus.
        """
        tries = TRIES if power_cycle else 1
        for attempt in range(tries):
            if power_cycle:
                power_cycle()
            try:
                said = self._listen(patience)
                break
            except (AutobootMissed, Garbage, NoOutput) as error:
                if attempt == tries - 1:
                    raise
                self.say(f"{error.what} Once more.")
        self._confirm()
        return text(said)

    def _listen(self, patience: float) -> bytes:
        """Until something that looks like U-Boot's prompt."""
        said = b""
        speeds = [self.line.baud, *(speed for speed in SPEEDS if speed != self.line.baud)]
        start = poked = time.monotonic()
        self.line.write(CTRL_C)
        waiting_told = False
        while (now := time.monotonic()) - start < patience:
            new = self.line.read(POKE_SECONDS)
            said += new
            if not new and self._at_prompt(said):
                return said
            if KERNEL.search(said):
                raise AutobootMissed("The board boots what it has: the prompt was missed.")
            if _is_noise(said):
                self._next_speed(speeds)
                said = b""
                self.line.write(CTRL_C)
            elif (BANNER.search(said) or COUNTDOWN.search(said)) and now - poked >= POKE_SECONDS:
                self.line.write(CTRL_C)
                poked = now
            elif not waiting_told and now - start > 1.0:
                self.say("Waiting for the board: switch it on, or press its reset button.")
                waiting_told = True
        raise self._why_nothing(said)

    def _at_prompt(self, said: bytes) -> bool:
        found = PROMPT.search(said.replace(b"\r", b""))
        if found and not LINUX.search(said):
            self.prompt = found[1] or found[2]
            return True
        return False

    def _next_speed(self, speeds: list[int]) -> None:
        speeds.pop(0)
        if not speeds:
            raise Garbage("What comes from the board is no text at any of the usual speeds.")
        self.say(f"No text at {self.line.baud} bit/s; trying {speeds[0]}.")
        self.line.baud = speeds[0]

    def _why_nothing(self, said: bytes) -> Exception:
        if LINUX.search(said):
            return NotUBoot("Linux asks for a login; no power-up was seen.")
        if not said:
            return NoOutput(f"Nothing came from {self.line.url} at {self.line.baud} bit/s.")
        return StuckConsole(f"No prompt came. The last words: {text(said)[-200:]!r}")

    def _confirm(self) -> None:
        """That it is U-Boot, and tells how a command ended."""
        answer = self.run("version")
        if "U-Boot" not in answer.output:
            raise NotUBoot(
                f"At the prompt {self.prompt.decode()!r} 'version' says {answer.output.strip()!r}."
            )

    # ---- commands

    def run(
        self, command: str, seconds: float = 10.0, watch: Watch = _nothing, *, repeatable: bool = True
    ) -> Answer:
        """Runs a command; `seconds` is how long it may take, watch gets its output as it comes.

        repeatable: whether it may be run again when its answer was lost on the line.
        Raises StuckConsole, LineUnsafe, BoardReset, NoStatus, LineTooLong.
        """
        for attempt in range(TRIES):
            number = self.start(command)
            output = self._answer(number, seconds, watch)
            if isinstance(output, Answer):
                return Answer(command, output.status, output.output)
            if not self._resynchronise():
                raise StuckConsole(
                    f"'{command}' did not end within {seconds:g} s; it said {text(output)[-300:]!r}"
                )
            if not repeatable or attempt == TRIES - 1:
                break
            self.say(f"The answer to '{command}' was lost; once more.")
        raise LineUnsafe(f"The answer to '{command}' could not be read: {text(output)[-300:]!r}")

    def start(self, command: str) -> int:
        """Types a command and Enter, and leaves it running; returns the number of its marker."""
        self._commands += 1
        self._type(typed(command, self._commands))
        self.line.write(b"\r")
        return self._commands

    def _type(self, line: str) -> None:
        for _ in range(TRIES):
            self._drain()
            if all(self._echoed(line[at : at + CHUNK].encode()) for at in range(0, len(line), CHUNK)):
                return
            self._resynchronise()
        raise LineUnsafe(f"'{line}' does not come back as typed.")

    def _echoed(self, chunk: bytes) -> bool:
        self.line.write(chunk)
        heard = b""
        deadline = time.monotonic() + ECHO_SECONDS
        while heard != chunk and chunk.startswith(heard):
            new = self.line.read(deadline - time.monotonic())
            if not new:
                return False
            heard += new
        return heard == chunk

    def _answer(self, number: int, seconds: float, watch: Watch) -> Answer | bytes:
        """The answer, or what came instead of a whole one within the time."""
        marker = re.compile(rb"(?:^|[\r\n])@%d:(\$\?|\d+)\r?\n" % number)
        said = b""
        deadline = time.monotonic() + seconds
        while not (found := marker.search(said)):
            new = self.line.read(deadline - time.monotonic())
            if not new:
                return said
            said += new
            watch(text(new))
            if RESTARTED.search(said.replace(b"\r", b"")):
                raise BoardReset("The board started anew while a command ran.")
        if found[1] == b"$?":
            raise NoStatus("U-Boot's parser does not know '$?'.")
        if not self._await_prompt(said[found.end() - 1 :]):
            self._resynchronise()
        return Answer("", int(found[1]), text(said[: found.start()]).lstrip("\n"))

    def _await_prompt(self, said: bytes) -> bool:
        deadline = time.monotonic() + PROMPT_SECONDS
        while not said.endswith(b"\n" + self.prompt):
            new = self.line.read(deadline - time.monotonic())
            if not new:
                return False
            said += new
        return True

    def _resynchronise(self) -> bool:
        """Gives up what is typed or runs; whether the prompt came."""
        self.line.write(CTRL_C)
        return self._await_prompt(b"")

    def _drain(self) -> None:
        while self.line.read(0):
            pass


def typed(command: str, number: int) -> str:
    """A command as it is typed: with a marker that shows its end and exit status. Raises LineTooLong."""
    line = f"{command}; echo @{number}:$?"
    if len(line) > LINE_ROOM:
        raise LineTooLong(f"{len(line)} characters are too many for U-Boot's line of {LINE_ROOM}: {line}")
    if not line.isascii() or not line.isprintable():
        raise LineTooLong(f"U-Boot's command line takes printable ASCII only: {line!r}")
    return line


def text(said: bytes) -> str:
    """A line's output as one reads it."""
    return said.decode(errors="replace").replace("\r", "")


def _is_noise(said: bytes) -> bool:
    """Enough to judge, and a third of it is no text."""
    odd = sum(byte not in b"\b\t\n\r\x1b\x07\0" and not 32 <= byte < 127 for byte in said)
    return odd >= 4 and odd * 3 > len(said)
