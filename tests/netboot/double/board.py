# SPDX-License-Identifier: GPL-3.0-or-later
"""The board: from power-up through U-Boot's main loop to a kernel. And the double: one in a thread."""

from __future__ import annotations

import threading
import traceback
from collections.abc import Mapping, Sequence
from mmap import mmap
from types import TracebackType
from typing import Literal, Self

from . import environment, flash, linux
from .commands import COMMANDS
from .environment import packed
from .faults import Fault, Refused, Reset
from .hush import Hush, SimpleParser, SyntaxFault, Unfinished
from .nand import BLOCK, Nand
from .readline import LineEditor
from .text import hexadecimal
from .variant import FACTORY_ENVIRONMENT, VARIANTS, Variant
from .wire import Ended, PowerCut, Wire

HANG_S = 600.0  # of a test: no host is as slow
RAM = 0x4000000
State = Literal["opened", "off", "prompt", "login", "shell"]


def dark_memory() -> mmap:
    """After power-up all is 0; pages that nobody writes take none of the tests' memory."""
    return mmap(-1, RAM)


class DataAbort(Exception):
    """An access to what is no memory, or to U-Boot's own."""


class Board:
    """What a reset forgets, and the main loop."""

    own_memory = 0x3B50000  # U-Boot, its stack and its heap are from here on

    def __init__(self, double: Double) -> None:
        self.variant: Variant = double.variant
        self.wire: Wire = double.wire
        self.faults: Sequence[Fault] = double.faults
        self.nand: Nand = double.nand
        self.ram = double.ram
        self.second = double.second
        self.ending: linux.Ending = double.linux
        self.cuts = self.variant.cuts if double.cuts is None else double.cuts
        self._double = double
        self.variables: dict[str, str] = {}
        self.commands = [name for name in sorted(COMMANDS) if name not in self.variant.absent]
        self.load_address = 0xE00000
        self.boot_file = ""
        self.port_name = self.variant.ports[0]
        self.dump_at = self.dump_count = 0
        self.dump_size = 4
        self._running: list[str] = []
        self._repeatable = False
        self._repeating = False
        parser = Hush if double.hush else SimpleParser
        self._shell = parser(self.variables, self._call)
        self._editor = LineEditor(self.wire, self.commands, self._echo)

    # ---- from power-up to the prompt

    def start(self) -> None:
        """Banner, environment, autoboot. It never comes back: an exception ends it."""
        self.wire.line_end = self.variant.line_end
        if not self._double.talks:
            self.wire.deaf()
        self.wire.forget()
        self.puts(f"\n\n{self.variant.version}\n\n{self.variant.head}")
        if self._double.slow_start:
            self.wire.tstc(HANG_S)
        self._load_environment()
        self.puts(f"{self.variant.streams}Net:   {self._ports()}")
        self._autoboot()
        self.main_loop()

    def start_at_prompt(self) -> None:
        """As somebody has left it: nothing is said until a key is pressed."""
        self.variables |= flash.stored_environment(self) or self.variant.environment
        self.main_loop()

    def main_loop(self) -> None:
        last, unfinished = "", ""
        while True:
            for fault in self.faults:
                fault.prompt(self)
            self.wire.turn_to()
            line = self._editor.read("> " if unfinished else self._double.prompt)
            self.wire.leave()
            if line is None:
                self.puts("<INTERRUPT>\n")
                unfinished, self._repeatable = "", False
                continue
            self._double.lines.append(line)
            if not unfinished:
                self._repeating = not line and self._repeatable
                if not line and not self._repeatable:
                    continue
                self._repeatable = True
                last = line or last
            unfinished = self._run_typed(f"{unfinished}\n{line}" if unfinished else last)

    def _run_typed(self, line: str) -> str:
        """Runs it, and returns it when it is not complete."""
        try:
            self._shell.run(line)
        except Unfinished:
            return line
        except SyntaxFault:
            self.puts("syntax error\n")
            self._repeatable = False
        return ""

    def _load_environment(self) -> None:
        stored = flash.stored_environment(self)
        self.puts(self.variant.no_environment if stored is None else self.variant.found)
        self.variables |= self.variant.environment if stored is None else stored
        if self.variant.name == "factory":
            self.variables.setdefault("ethact", self.variant.ports[0])

    def _ports(self) -> str:
        """The ports and what lacks an address; 2023.01 does not count those."""
        factory = self.variant.name == "factory"
        text, found = "", 0
        for number, name in enumerate(self.variant.ports):
            address = self.variables.get(f"eth{number or ''}addr")
            if address or factory:
                text += (", " if found else "") + (name if factory else f"eth{number}: {name}")
                found += 1
            if not address:
                text += f"\nError: {name} address not set.\n"
        return text + ("\n" if found else "No ethernet found.\n\n")

    def _autoboot(self) -> None:
        command = self.variables.get("bootcmd")
        delay = int(self.variables.get("bootdelay", "3"))
        if delay == -1 or command is None:
            return
        self.puts(f"Hit any key to stop autoboot: {delay:2} ")
        stopped = self.wire.tstc()
        if stopped:
            self.wire.getc()
            self.puts("\b\b\b 0")
        while delay > 0 and not stopped:
            delay -= 1
            if self.wire.tstc(self._double.countdown_second):
                self.wire.getc()
                stopped, delay = True, 0
            self.puts(f"\b\b\b{delay:2} ")
        self.puts("\n")
        if not stopped:
            self.run_line(command)

    # ---- what the commands use

    @property
    def bad_blocks(self) -> set[int]:
        return self.nand.bad | self.variant.reserved

    @property
    def kernels_started(self) -> int:
        return self._double.kernels_started

    @kernels_started.setter
    def kernels_started(self, count: int) -> None:
        self._double.kernels_started = count

    def puts(self, text: str) -> None:
        for fault in self.faults:
            text = fault.output(self, self._running, text)
        self.wire.puts(text)

    def number(self, text: str) -> int:
        return hexadecimal(text)

    def memory(self, address: int, size: int) -> bytes:
        if address + size > RAM:
            raise DataAbort
        return bytes(self.ram[address : address + size])

    def store(self, address: int, data: bytes) -> None:
        if address + len(data) > self.own_memory:
            raise DataAbort
        self.ram[address : address + len(data)] = data

    def server(self, address: str) -> tuple[str, int]:
        """Where the datagrams for a TFTP server really go."""
        host, port = self._double.tftp or (address, 69)
        if self.variant.tftp_port and "tftpdstp" in self.variables:
            return host, int(self.variables["tftpdstp"])
        return host, port

    def named(self, word: str) -> str | None:
        """The command of this name, or of this unique beginning."""
        stem = word.partition(".")[0]
        found = [name for name in self.commands if name.startswith(stem)]
        return stem if stem in found else found[0] if len(found) == 1 else None

    def usage(self, name: str) -> int:
        command = COMMANDS[name]
        self.puts(f"{name} - {command.usage}\n\nUsage:\n{name} {command.help}\n")
        return 1

    def run_line(self, line: str) -> int:
        return self._shell.run(line)

    def _call(self, words: list[str]) -> int:
        for fault in self.faults:
            try:
                fault.command(self, words)
            except Refused as refused:
                self.puts(str(refused))
                return 1
        name = self.named(words[0])
        if name is None:
            self.puts(f"Unknown command '{words[0]}' - try 'help'\n")
            return 1
        command = COMMANDS[name]
        self._double.commands.append(words)
        if len(words) > command.most:
            return self.usage(name)
        if command.run is None:
            raise NotImplementedError(" ".join(words))
        self._repeatable &= command.repeats
        self._running = words
        try:
            return command.run(self, words, self._repeating)
        finally:
            self._running = []

    def _echo(self, key: str) -> str:
        for fault in self.faults:
            key = fault.echo(self, key)
        return key


class Double:
    """A board on a pty, from `with` to its end.

    variant: "factory" (2016.11) or "ours" (2023.01). faults: what goes wrong.
    tftp: the host and the UDP port that "serverip", port 69, really is; without it, it is that.
    environment: what is stored in the flash; None: nothing. Without it the factory's.
    state: "opened" powers up when a tool opens the port; "off" waits for power_cycle(); "prompt", "login" and
    "shell" have been there before. prompt, hush: of a build. talks: False is a dead board.
    linux: how a kernel ends. cuts: how many of bootm's last characters are lost; None: the variant's.
    second: how many seconds one of U-Boot's (TFTP's time-outs, sleep) lasts;
    countdown_second: one of autoboot's; slow_start: from its banner on U-Boot takes until a key is pressed.
    lines: what has been typed and entered, in order. commands: what of it has run, and of autoboot, as words.
    kernels_started, power_ups: how many.
    """

    def __init__(
        self,
        variant: Literal["factory", "ours"] = "factory",
        faults: Sequence[Fault] = (),
        tftp: tuple[str, int] | None = None,
        environment: Mapping[str, str] | None = FACTORY_ENVIRONMENT,
        state: State = "opened",
        prompt: str = "=> ",
        hush: bool = True,
        talks: bool = True,
        linux: linux.Ending = "login",
        cuts: int | None = None,
        baud: int = 115200,
        second: float = 0.02,
        countdown_second: float = 1.0,
        slow_start: bool = False,
        seed: int = 980,
    ) -> None:
        self.variant = VARIANTS[variant]
        self.faults = list(faults)
        self.tftp = tftp
        self.prompt, self.hush, self.talks = prompt, hush, talks
        self.linux: linux.Ending = linux
        self.cuts = cuts
        self.second, self.countdown_second = second, countdown_second
        self.slow_start = slow_start
        self.nand = Nand()
        self.ram = dark_memory()
        self.lines: list[str] = []
        self.commands: list[list[str]] = []
        self.kernels_started = 0
        self.power_ups = 0
        self._state = state
        if environment is not None:
            self.store_environment(environment)
        self.wire = Wire(baud, self.variant.line_end, self.faults, seed)
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._live, name="double", daemon=True)

    @property
    def port(self) -> str:
        """The path of the serial port."""
        return self.wire.port

    @property
    def power_hook(self) -> str:
        """A shell command that switches the supply off and on."""
        return f"printf p > {self.wire.switch}"

    def power_cycle(self) -> None:
        self.wire.press(b"p")

    def store_environment(self, variables: Mapping[str, str]) -> None:
        """Puts an environment into the flash, as if by another U-Boot before."""
        self.nand.load(environment.OFFSET, packed(variables, self.variant.env_size))

    def stored_environment(self) -> dict[str, str] | None:
        """What the flash has, None when its CRC is wrong."""
        return flash.stored_environment(Board(self))

    def block(self, number: int) -> bytes:
        return self.nand.content(number * BLOCK, BLOCK)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.wire.press(b"e")
        self._thread.join(10)
        alive = self._thread.is_alive()
        self.wire.free()
        if self._error and error:
            error.add_note("and the double: " + "".join(traceback.format_exception(self._error)))
        elif self._error:
            raise self._error
        elif alive:
            raise RuntimeError("the double does not end")

    def _live(self) -> None:
        try:
            self._from_power_to_power()
        except Ended:
            pass
        except BaseException as error:
            self._error = error

    def _from_power_to_power(self) -> None:
        state = self._state
        while True:
            try:
                self._run(state)
            except PowerCut:
                self.ram = dark_memory()
            except Reset:
                pass
            except DataAbort:
                self._crash()
            state = "on"

    def _crash(self) -> None:
        try:
            self.wire.puts("data abort\npc : [<03f7c0d4>]\t   lr : [<03f7c0c8>]\n")
            self.wire.puts("Resetting CPU ...\n\nresetting ...\n")
        except PowerCut:
            self.ram = dark_memory()

    def _run(self, state: str) -> None:
        """Until the board is switched off or resets."""
        if state == "off":
            self.wire.deaf()
        board = Board(self)
        if state == "prompt":
            board.start_at_prompt()
        if state == "login" or state == "shell":
            linux.stay(self.wire, state)
        if state == "opened":
            while not self.wire.opened():
                self.wire.pause(0.005)
            self.wire.pause(0.02)  # a tool that opens a port drops what is in it
        self.power_ups += 1
        board.start()
