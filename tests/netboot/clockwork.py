# SPDX-License-Identifier: GPL-3.0-or-later
"""Boards whose time runs as fast as it is looked at, or on a pty in real time, as their consoles show them.

A board's life is a generator. It yields bytes to say, a number of seconds to let pass, or KEY to get the next
byte that arrives (`(yield KEY)`); POLL gets None when nothing has arrived.
"""

from __future__ import annotations

import os
import random
import re
import select
import threading
import time
import tty
from collections import deque
from collections.abc import Callable, Generator
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Self

from nuc980.netboot.errors import SpeedRefused

KEY, POLL = "key", "poll"
Life = Generator[Any, int | None, Any]

VERSION = b"U-Boot 2016.11 (Nov 20 2019 - 10:32:17 +0800)"
BANNER = b"\n\n" + VERSION + b"\n\nCPU: NUC980\nBoard: NUC980\nDRAM:  64 MiB\nNAND:  128 MiB\n"
STREAMS = b"In:    serial\nOut:   serial\nErr:   serial\nNet:   emac\n"
COMMANDS = (
    *("version", "echo", "true", "false", "write", "unended", "crc32"),
    *("sleep", "erase", "hang", "chatter", "reset"),
)
KERNEL = b"Starting kernel ...\n\n[    0.000000] Booting Linux on physical CPU 0x0\n"


@dataclass(frozen=True)
class Noise:
    """What a byte may become, each with a chance of its own."""

    drop: float = 0.0
    change: float = 0.0
    insert: float = 0.0
    double: float = 0.0

    def on(self, data: bytes, chance: random.Random) -> bytes:
        out = bytearray()
        for byte in data:
            if chance.random() < self.insert:
                out.append(chance.randrange(256))
            if chance.random() < self.drop:
                continue
            out.append(chance.randrange(256) if chance.random() < self.change else byte)
            if chance.random() < self.double:
                out.append(byte)
        return bytes(out)


QUIET = Noise()


class Board:
    """A life, and what it has done. now: its time in seconds."""

    def __init__(self, life: Callable[[Board], Life], baud: int = 115200) -> None:
        self._birth = life
        self.baud = baud
        self.now = 0.0
        self.ran: list[str] = []  # the commands that U-Boot has run
        self.fifo: deque[int] = deque()
        self.power_ups = 0
        self.born()

    def born(self) -> None:
        self._life = self._birth(self)
        self._wants: Any = next(self._life)
        self._wake = self._waking()

    def _waking(self) -> float:
        return self.now + self._wants if isinstance(self._wants, int | float) else self.now

    def advance(self, until: float) -> bytes:
        """What is said next, if anything is until then."""
        while True:
            answer: int | None = None
            match self._wants:
                case bytes() as octets:
                    self._go_on(None)
                    return octets
                case "key" if not self.fifo:
                    self.now = max(self.now, until)
                    return b""
                case "key" | "poll":
                    answer = self.fifo.popleft() if self.fifo else None
                case _ if self._wake > until:
                    self.now = max(self.now, until)
                    return b""
                case _:
                    self.now = max(self.now, self._wake)
            self._go_on(answer)

    def _go_on(self, answer: int | None) -> None:
        self._wants = self._life.send(answer)
        self._wake = self._waking()

    def power_cycle(self) -> None:
        self.power_ups += 1
        self.fifo.clear()
        self.born()


class VirtualLine:
    """nuc980.netboot.transport.Line to a board, in the board's time."""

    url = "virtual"
    has_speed = True

    def __init__(self, board: Board, to: Noise = QUIET, back: Noise = QUIET, seed: int = 0) -> None:
        self.board = board
        self.to, self.back = to, back
        self.chance = random.Random(seed)
        self.sent = b""
        self.delay = 0.0  # of the way to the board
        self._baud = 115200

    def now(self) -> float:
        return self.board.now

    @property
    def baud(self) -> int:
        return self._baud

    @baud.setter
    def baud(self, speed: int) -> None:
        if speed == 921600:
            raise SpeedRefused("not this one")
        self._baud = speed

    def write(self, data: bytes, *, secret: bool = False) -> None:
        self.sent += data
        self.board.now += self.delay
        self.board.fifo.extend(self.to.on(at_speed(data, self._baud, self.board.baud), self.chance))

    def read(self, seconds: float) -> bytes:
        until = self.board.now + max(seconds, 0)
        octets = self.board.advance(until)
        while octets and (more := self.board.advance(self.board.now)):
            octets += more
            if len(octets) > 4096:
                break
        heard = self.back.on(at_speed(octets, self.board.baud, self._baud), self.chance)
        return heard if heard or not octets else self.read(until - self.board.now)

    def reveal(self) -> None:
        pass

    def other_readers(self) -> str:
        return ""


class PtyBoard:
    """The same board on a pty, in real time; a speed is the pty's."""

    def __init__(self, board: Board) -> None:
        self.board = board
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.port = os.ttyname(self._slave)
        self._end, self._ended = os.pipe()
        self._thread = threading.Thread(target=self._live, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        os.write(self._ended, b"e")
        self._thread.join()
        for end in (self._end, self._ended):
            os.close(end)
        self.unplug()

    def unplug(self) -> None:
        for end in (self._master, self._slave):
            if end >= 0:
                os.close(end)
        self._master = self._slave = -1

    def _live(self) -> None:
        start = time.monotonic()
        while True:
            while octets := self.board.advance(time.monotonic() - start):
                os.write(self._master, octets)
            ready, _, _ = select.select([self._master, self._end], [], [], 0.002)
            if self._end in ready:
                return
            if ready:
                self.board.fifo.extend(os.read(self._master, 4096))


def fastest(deed: Callable[[], object], tries: int) -> float:
    """Seconds of its fastest try: a busy host makes some of them slow."""

    def seconds() -> float:
        start = time.monotonic()
        deed()
        return time.monotonic() - start

    return min(seconds() for _ in range(tries))


def at_speed(data: bytes, sent: int, read: int, resync: bool = True) -> bytes:
    """What a receiver at one speed makes of bytes sent at another, bit by bit.

    resync: a stop bit that is low is taken for the next start bit, as a 16550 does; else the line has to be
    high before.
    """
    if sent == read:
        return data
    levels = [1]
    for byte in data:
        levels += [0, *(byte >> bit & 1 for bit in range(8)), 1]
    ratio = sent / read  # sender's bits in one of the receiver's
    out = bytearray()
    at = 0.0

    def level(when: float) -> int:
        return levels[int(when)] if when < len(levels) else 1

    while at < len(levels):
        if level(at):
            at = int(at) + 1
            continue
        bits = [level(at + (bit + 0.5) * ratio) for bit in range(10)]
        if bits[0]:
            at += 0.5 * ratio
            continue
        out.append(sum(bit << number for number, bit in enumerate(bits[1:9])))
        at += 9.5 * ratio
        while not resync and at < len(levels) and not level(at):
            at += 1
    return bytes(out)


# ---- U-Boot


class Reset(Exception):
    """The board starts anew by itself."""


@dataclass
class UBoot:
    """A build of U-Boot, as a life. end: of its lines; the vendor's driver has it the wrong way round."""

    prompt: bytes = b"=> "
    end: bytes = b"\n\r"
    delay: int = 3
    bootcmd: bool = True
    hush: bool = True
    editing: bool = True
    before: bytes = b""  # the power-up's noise
    at_prompt: bool = False  # since long, with so much of a line:
    typed: bytes = b""
    unfinished: str = ""  # and this line before it, which wants more
    running: str = ""  # a command that somebody has left running
    echo: Callable[[int, bytes], bytes] = lambda count, byte: byte  # what the n-th echo becomes
    prompts: Callable[[int], tuple[float, bytes]] = lambda count: (0.0, b"")  # before the n-th one
    linux: Callable[[Board], Life] | None = None  # what the boot command starts
    autoboot: bytes = b"Autoboot in 3 seconds\n"  # with a string that alone stops it:
    stop: bytes = b""
    password: bytes = b""  # asked for when autoboot was stopped; tries are in `ran`
    asks: bytes = b"Password: "
    key_seconds: float = 0.0  # that it takes for each, on a busy host

    def __call__(self, board: Board) -> Life:
        self._board = board
        self._echoes = self._prompted = 0
        self._history: list[bytes] = []
        self._repeats = False
        first = (self.at_prompt or self.running) and not board.power_ups
        if first and self.running:
            yield from self._run(self.running)
        while True:
            try:
                if not first and (yield from self._boots()):
                    yield from (self.linux or kernel)(board)
                yield from self._main_loop(first)
            except Reset:
                first = False

    def _say(self, octets: bytes) -> Life:
        yield octets.replace(b"\n", self.end)

    def _boots(self) -> Life:
        yield self.before or 0.0
        yield 0.02
        self._board.fifo.clear()  # the UART is set up
        yield from self._say(BANNER)
        yield 0.2
        yield from self._say(STREAMS)
        if not self.bootcmd:
            return False
        if self.stop:
            return not (yield from self._is_told_the_string())
        yield from self._say(b"Hit any key to stop autoboot: %2d " % self.delay)
        stopped = bool(self._board.fifo)
        for left in range(self.delay - 1, -1, -1):
            for _ in range(100):
                stopped = stopped or bool(self._board.fifo)
                if not stopped:
                    yield 0.01
            yield from self._say(b"\b\b\b%2d " % left)
            if stopped:
                break
        if stopped:
            self._board.fifo.popleft()
        yield from self._say(b"\n")
        if stopped and self.password:
            yield from self._asks_password()
        return not stopped

    def _is_told_the_string(self) -> Life:
        """passwd_abort_key() of common/autoboot.c."""
        yield from self._say(self.autoboot)
        heard = bytearray()
        for _ in range(self.delay * 100):
            while (key := (yield POLL)) is not None:
                heard.append(key)
                if heard.endswith(self.stop):
                    return True
            yield 0.01
        return False

    def _asks_password(self) -> Life:
        """Some vendors' own; it has no end."""
        while True:
            yield from self._say(self.asks)
            typed = bytearray()
            while (key := (yield KEY)) not in (0x03, 0x0D):
                typed.append(key)
            self._board.ran.append(f"try {typed.decode()}")
            yield from self._say(b"\n")
            if typed == self.password:
                return
            yield from self._say(b"Wrong password\n")

    def _main_loop(self, first: bool) -> Life:
        unfinished = self.unfinished if first else ""
        line = self.typed if first else b""
        last = ""
        while True:
            pause, noise = self.prompts(self._prompted)
            yield pause
            if noise:
                yield noise
            self._prompted += 1
            if not first:
                yield from self._say(b"> " if unfinished else self.prompt)
            first = False
            read = yield from self._read_line(line)
            line = b""
            if read is None:
                yield from self._say(b"<INTERRUPT>\n")
                unfinished, self._repeats = "", False
                continue
            if not unfinished and not read:
                if not self._repeats:
                    continue
                read = last
            whole = f"{unfinished}; {read}" if unfinished else read
            last = whole
            self._repeats = True
            done = yield from (self._shell(whole) if self.hush else self._simple(whole))
            unfinished = "" if done else whole

    def _read_line(self, typed: bytes) -> Life:
        """cread_line of common/cli_readline.c, or without the editor cli_readline's own loop."""
        line, at, past = list(typed), len(typed), 0
        while True:
            key = yield KEY
            yield self.key_seconds
            shown = b""
            match key:
                case 0x00:
                    pass
                case 0x0A | 0x0D:
                    yield from self._say(b"\n")
                    read = bytes(line)
                    self._history.append(read)
                    return read.decode("latin-1")
                case 0x03:
                    return None
                case 0x01 if self.editing:
                    shown, at = b"\b" * at, 0
                case 0x02 if self.editing and at:
                    shown, at = b"\b", at - 1
                case 0x05 if self.editing:
                    shown, at = bytes(line[at:]), len(line)
                case 0x06 if self.editing and at < len(line):
                    shown, at = bytes([line[at]]), at + 1
                case 0x04 if self.editing and at < len(line):
                    del line[at]
                    shown = bytes(line[at:]) + b" " + b"\b" * (len(line) - at + 1)
                case 0x15 | 0x18:
                    shown, line, at = b"\b" * at + b" " * len(line) + b"\b" * len(line), [], 0
                case 0x0B if self.editing:
                    shown = b" " * (len(line) - at) + b"\b" * (len(line) - at)
                    del line[at:]
                case 0x08 | 0x7F | 0xFF:
                    if at:
                        at -= 1
                        del line[at]
                        rest = bytes(line[at:])
                        shown = b"\b" + rest + b" " + b"\b" * (len(rest) + 1)
                case 0x10 | 0x0E if self.editing:
                    past = past + 1 if key == 0x10 else past - 1
                    if 0 < past <= len(self._history):
                        wiped = b"\b" * at + b" " * len(line) + b"\b" * len(line)
                        line = list(self._history[-past])
                        shown, at = wiped + bytes(line), len(line)
                    else:
                        past, shown = max(min(past, len(self._history)), 0), b"\a"
                case 0x02 | 0x04 | 0x06 | 0x09 | 0x0E | 0x10 | 0x1B if self.editing:
                    shown = b"\a" if key == 0x09 else b""
                case _:
                    if len(line) >= 255:
                        shown = b"\a"
                    else:
                        line.insert(at, key)
                        rest = bytes(line[at:])
                        at += 1
                        shown = self.echo(self._echoes, rest[:1]) + rest[1:] + b"\b" * (len(rest) - 1)
                        self._echoes += 1
            if shown:
                yield shown

    def _shell(self, whole: str) -> Life:
        """Hush, as far as `;` and `if` go. Whether the line was complete."""
        words = [part.strip() for part in re.split(r"[;\n]", whole)]
        tokens: list[str] = []
        for word in words:
            while found := re.match(r"(if|then|else|fi)(?: +|$)", word):
                tokens.append(found[1])
                word = word[found.end() :].strip()
            if word:
                tokens.append(f" {word}")
        if tokens.count("if") > tokens.count("fi"):
            return False
        shape = "".join({"if": "(", "then": "t", "else": "e", "fi": ")"}.get(token, "") for token in tokens)
        while "(te)" in shape or "(t)" in shape:
            shape = shape.replace("(te)", "").replace("(t)", "")
        if shape:
            yield from self._say(b"syntax error\n")
            return True
        runs = [True]
        status = 0
        for token in tokens:
            match token:
                case "if":
                    runs.append(runs[-1])
                case "then":
                    runs[-1] = runs[-1] and status == 0
                    was_true = status == 0
                case "else":
                    runs[-1] = runs[-2] and not was_true
                case "fi":
                    runs.pop()
                case _ if runs[-1]:
                    status = yield from self._run(token.strip())
        return True

    def _simple(self, whole: str) -> Life:
        for part in whole.split(";"):
            yield from self._run(part.strip())
        return True

    def _run(self, command: str) -> Life:
        """One command; its exit status."""
        if not re.fullmatch(r"echo @\d+:(ok|failed)", command):
            self._board.ran.append(command)
        name, _, rest = command.partition(" ")
        match name:
            case "version":
                yield from self._say(b"\n" + VERSION + b"\narm-linux-gcc (GCC) 4.8.4\n")
            case "echo":
                yield from self._say(rest.encode("latin-1") + b"\n")
            case "true" | "write":
                pass
            case "false":
                return 1
            case "unended":
                yield from self._say(rest.encode("latin-1"))
            case "crc32":
                yield from self._say(b"crc32 for 00000000 ... 0000000f ==> ")
                yield 0.3
                yield from self._say(b"bcda9946\n")
            case "sleep":
                for _ in range(int(float(rest) * 100)):
                    if (yield POLL) == 0x03:
                        return 1
                    yield 0.01
            case "erase":
                yield float(rest)
            case "hang":
                yield 1e9
            case "chatter":
                while True:
                    yield from self._say(b"link is up, link is down\n")
                    yield 0.03
            case "reset":
                yield from self._say(b"resetting ...\n")
                raise Reset
            case _:
                yield from self._say(b"Unknown command '%s' - try 'help'\n" % name.encode("latin-1"))
                return 1
        return 0


# ---- what is no U-Boot


def silent(board: Board) -> Life:
    while True:
        yield KEY


def kernel(board: Board) -> Life:
    """Talks for ever."""
    yield KERNEL
    while True:
        yield b"[%12.6f] random: crng init\r\n" % board.now
        yield 0.05


def login(board: Board) -> Life:
    """A getty, which ends at Ctrl-C and comes again; keys it gets are counted in `ran`."""
    yield b"\r\nopenrtu login: "
    while True:
        key = yield KEY
        board.ran.append(f"key {key}")
        yield b"\r\nopenrtu login: " if key == 3 else bytes([key])


def shell(board: Board) -> Life:
    """A root shell of Linux."""
    while True:
        key = yield KEY
        board.ran.append(f"key {key}")
        yield b"^C\r\n# " if key == 3 else bytes([key])


@dataclass
class Program:
    """At work on Linux's console; ends at Ctrl-C, which `ran` tells. echo: of the terminal."""

    says: bytes = b"Writing kernel: %d%%\r\n"
    period: float = 1.0
    echo: bool = False

    def __call__(self, board: Board) -> Life:
        told = 0
        wait = 0.0
        while True:
            if wait <= 0:
                told, wait = told + 1, self.period
                yield self.says % told if b"%" in self.says else self.says
            while (key := (yield POLL)) is not None:
                if key == 3:
                    board.ran.append("ended by Ctrl-C")
                if self.echo:
                    yield b"^" + bytes([key + 64]) if key < 32 else b"\b\b  \b\b"
            yield 0.01
            wait -= 0.01


def hiss(board: Board) -> Life:
    """An open input."""
    chance = random.Random(1)
    while True:
        yield bytes(chance.choice((0x00, 0x80, 0xE0, 0xFE, 0xFF)) for _ in range(6))
        yield 0.1
