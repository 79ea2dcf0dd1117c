# SPDX-License-Identifier: GPL-3.0-or-later
"""U-Boot's command line: reach it, type so that nothing else than meant is run, know how it ended."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

from nuc980.netboot import host
from nuc980.netboot.arrival import CTRL_C, SETTLED_SECONDS, Arrival
from nuc980.netboot.commandline import ended, text, typed
from nuc980.netboot.entrance import OPEN, Entrance
from nuc980.netboot.errors import (
    AutobootMissed,
    BoardHung,
    BoardReset,
    CommandFailed,
    LineUnsafe,
    NoStatus,
    NotUBoot,
    StuckConsole,
)
from nuc980.netboot.linux import HUNG
from nuc980.netboot.transport import Line

# What the UART's receiver holds while U-Boot looks elsewhere; the factory's console drops the rest.
CHUNK = 16

# For a chunk, with a slow network between. It is waited out only when something was lost.
ECHO_SECONDS = 1.0
PROMPT_SECONDS = 3.0
TRIES = 3
DRAIN_SECONDS = 60.0  # for a slow board to answer all keys that were pressed on the way to its prompt
SLOW = 10  # an echo may take so many times as long as the one that was measured
TYPING_TRIES = 8  # nothing runs before the Enter, so that a noisy line costs time only

IF = b"if "
# The line editor's keys: to the start (answered by backspaces), to the end (by the line as the board has it).
TO_START, TO_END = b"\x01", b"\x05"
INTERRUPTED = b"<INTERRUPT>\n"
SECOND_PROMPT = b"\n> "  # the line is not finished
RESTARTED = re.compile(rb"\n(?:U-Boot SPL \d{4}\.\d\d|DRAM:  |[^\n]{0,40}to stop autoboot)")
TAIL = 300  # a marker, a prompt or a line of RESTARTED is not longer


@dataclass(frozen=True)
class Answer:
    """What U-Boot printed for a command, and its exit status: 0, or 1 when it failed."""

    command: str
    status: int
    output: str

    def required(self) -> str:
        """The output of a command that must succeed. Raises CommandFailed."""
        if self.status:
            raise CommandFailed(
                f"U-Boot: '{self.command}' failed: {self.output.strip() or 'it printed nothing'}"
            )
        return self.output


Watch = Callable[[str], None]


def _nothing(_: str) -> None:
    return


class Console:
    """The command line at the other end of a line. say: gets a note now and then of what is being tried."""

    def __init__(self, line: Line, say: Watch = _nothing, entrance: Entrance = OPEN) -> None:
        self.line = line
        self.say = say
        self.entrance = entrance
        self.prompt = b""
        self._commands = 0
        self._edits = True  # U-Boot has its line editor (CONFIG_CMDLINE_EDITING)
        self._tail = b""
        self._marks = 0
        self._delay = 0.0  # of an echo, the longest that was measured

    # ---- to the prompt

    def reach(self, power_cycle: Callable[[], None] | None = None, patience: float = 60.0) -> str:
        """Brings the board to U-Boot's prompt, from wherever it is; returns what it said on the way.

        power_cycle: switches the board off and on, while the line is listened to; without it, a board that is
        not at the prompt already is waited for: somebody has to switch it on within `patience` seconds.
        Raises NoStatus, what Arrival.wait raises, and what power_cycle raises.
        """
        for attempt in range(TRIES):
            arrival = Arrival(self.line, self.say, power_cycle, self.entrance)
            try:
                received = arrival.wait(patience)
                break
            except AutobootMissed as error:
                if not power_cycle or attempt == TRIES - 1:
                    raise
                self.say(f"{error.what} Once more.")
        self.prompt, self._tail = arrival.prompt, b""
        self._settle()
        self._confirm()
        return received

    def _confirm(self) -> None:
        """That it is U-Boot, and tells how a command ended."""
        answer = self.run("version")
        if "U-Boot" not in answer.output:
            raise NotUBoot(f"At the prompt {text(self.prompt)!r} 'version' says {answer.output.strip()!r}.")

    def _settle(self) -> None:
        """Until each key that was pressed has its answer: a mark comes back after them. Measures the line."""
        until = self.line.now() + DRAIN_SECONDS
        for _ in range(TRIES):
            self._marks += 1
            mark = b"#%d." % self._marks  # a comment, if noise makes it a command
            begin = self.line.now()
            self.line.write(mark)
            heard = b""
            while (
                not heard.endswith(mark) and self.line.now() < until and (new := self._read(PROMPT_SECONDS))
            ):
                heard += new
            if came := heard.endswith(mark):
                self._delay = max(self._delay, self.line.now() - begin)
            self._interrupt("A mark was typed")
            if came:
                return

    # ---- commands

    def run(
        self, command: str, seconds: float = 10.0, watch: Watch = _nothing, *, repeatable: bool = True
    ) -> Answer:
        """Runs a command; `seconds` is how long it may take, watch gets its output as it comes.

        The command is run as it is meant or not at all, and the status is its own. The output is what came
        through the line: what must be right in it has to be checked by what it says (a CRC, twice the same).
        repeatable: whether it may be run again when its answer was lost on the line.
        Raises StuckConsole, LineUnsafe, BoardReset, BoardHung, NoStatus, LineTooLong, LineLost.
        """
        received = b""
        for _ in range(TRIES if repeatable else 1):
            number = self.start(command)
            entered = self.line.now()
            received = self._answer(number, seconds, watch)
            if found := ended(number).search(received):
                return _answer_of(command, found)
            if b"Unknown command 'if'" in received:
                raise NoStatus("U-Boot's parser has no 'if'.")
            late = self.line.now() - entered >= seconds
            received += self._interrupt(f"'{command}' did not end within {self.line.now() - entered:.0f} s")
            found = ended(number).search(received)
            if found and found[1] == b"ok":
                return _answer_of(command, found)
            if found and late:
                raise StuckConsole(f"'{command}' did not end within {seconds:g} s; Ctrl-C ended it.")
        what = f"The answer to '{command}' was lost; there came {text(received)[-300:]!r}"
        raise LineUnsafe(what, cause=self._suspect())

    def run_twice(self, command: str, seconds: float = 10.0) -> Answer:
        """As run(), until two answers are the same: for numbers that nothing else checks.

        Raises what run() raises; LineUnsafe also when no two are.
        """
        answers: list[Answer] = []
        for _ in range(TYPING_TRIES):
            answers.append(self.run(command, seconds))
            if answers[-1] in answers[:-1]:
                return answers[-1]
        raise LineUnsafe(f"The answers to '{command}' differ.", cause=self._suspect())

    def start(self, command: str) -> int:
        """Types a command and Enter, and leaves it running; returns the number of its marker.

        Raises StuckConsole, LineUnsafe, BoardReset, BoardHung, LineTooLong, LineLost.
        """
        line = typed(command, self._commands + 1).encode()
        self._commands += 1
        self._type(line)
        self.line.write(b"\r")
        return self._commands

    # ---- typing

    def _type(self, line: bytes) -> None:
        for _ in range(TYPING_TRIES):
            self._drain()
            if self._echoed(line) and (not self._edits or self._read_back(line)):
                return
            self._interrupt(f"'{text(line)}' did not come back as typed")
            self._settle()
        raise LineUnsafe(f"'{text(line)}' does not come back as typed.", cause=self._suspect())

    def _echoed(self, line: bytes) -> bool:
        """Types it. First the `if` alone: once it is there, a noise byte that is an Enter does no harm."""
        starts = range(len(IF), len(line), CHUNK)
        chunks = [IF, *(line[at : at + CHUNK] for at in starts)]
        return all(self._answered(chunk, chunk) == chunk for chunk in chunks)

    def _read_back(self, line: bytes) -> bool:
        """Whether the board has the line: an echo that lost what a noise byte added looks right."""
        keys = TO_START + TO_END
        whole = b"\b" * len(line) + line
        heard = self._answered(keys, whole, keys)
        if heard == keys:
            self._edits = False
        return heard == whole and not self.line.read(0)

    def _answered(self, keys: bytes, *expected: bytes) -> bytes:
        """What comes for keys, until it is as expected, or cannot be any more, or nothing more comes."""
        self.line.write(keys)
        heard = b""
        while heard not in expected and any(answer.startswith(heard) for answer in expected):
            new = self._read(self._patient(ECHO_SECONDS))
            if not new:
                break
            heard += new
        return heard

    def _patient(self, seconds: float) -> float:
        """Longer, on a line that was measured to be slow."""
        return max(seconds, SLOW * self._delay)

    def _suspect(self) -> str:
        return self.line.other_readers() or host.busy()

    # ---- listening

    def _answer(self, number: int, seconds: float, watch: Watch) -> bytes:
        """What comes for a command, up to its end and the prompt, or as far as it comes within the time."""
        end = ended(number)
        deadline = self.line.now() + seconds
        received = b""
        found = None
        while not found and (left := deadline - self.line.now()) > 0:
            # An Enter is answered at once, and after a prompt there is nothing to come.
            over = not received or received.endswith((b"\n" + self.prompt, SECOND_PROMPT))
            new = self._read(min(left, self._patient(ECHO_SECONDS)) if over else left)
            if not new and over:
                break
            received += new
            watch(text(new))
            found = end.search(received, max(0, len(received) - len(new) - TAIL))
        if found and not self._prompt_comes(received[found.end() - 1 :]):
            self._interrupt("No prompt came")
        return received

    def _prompt_comes(self, received: bytes) -> bool:
        deadline = self.line.now() + self._patient(PROMPT_SECONDS)
        while not received.endswith(b"\n" + self.prompt):
            new = self._read(deadline - self.line.now())
            if not new:
                return False
            received += new
        return True

    def _interrupt(self, before: str) -> bytes:
        """Gives up what is typed or runs; returns what the board says to it. Raises StuckConsole."""
        received = b""
        for _ in range(TRIES):
            self.line.write(CTRL_C)
            deadline = self.line.now() + self._patient(PROMPT_SECONDS)
            while (left := deadline - self.line.now()) > 0:
                at_prompt = received.endswith((b"\n" if self.entrance.prompt else INTERRUPTED) + self.prompt)
                new = self._read(min(left, SETTLED_SECONDS) if at_prompt else left)
                if at_prompt and not new:
                    return received
                received += new
        what = f"{before}, and Ctrl-C brings no prompt; there came {text(received)[-300:]!r}"
        raise StuckConsole(what, cause=self._suspect())

    def _drain(self) -> None:
        deadline = self.line.now() + PROMPT_SECONDS
        while self.line.now() < deadline and self._read(0):
            pass

    def _read(self, seconds: float) -> bytes:
        """What comes, as Line.read. Raises BoardReset, BoardHung.

        Without carriage returns, which the vendor's driver sends after a line feed and others before it.
        """
        deadline = self.line.now() + seconds
        while new := self.line.read(deadline - self.line.now()):
            if new := new.replace(b"\r", b""):
                self._watch_for_the_end(new)
                break
        return new

    def _watch_for_the_end(self, new: bytes) -> None:
        self._tail = self._tail[-TAIL:] + new
        if HUNG.encode() in self._tail:
            received, self._tail = text(self._tail).strip(), b""
            raise BoardHung(f"U-Boot gave up. Its last words: {received!r}")
        if RESTARTED.search(self._tail):
            self._tail = b""
            raise BoardReset("The board restarted during the work.")


def _answer_of(command: str, end: re.Match[bytes]) -> Answer:
    output = text(end.string[: end.start()])
    return Answer(command, 0 if end[1] == b"ok" else 1, output.removeprefix("\n"))
