# SPDX-License-Identifier: GPL-3.0-or-later
"""A board to be worked on: to U-Boot's prompt, and to Linux. For programs, tests and the command line."""

from __future__ import annotations

import re
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cached_property
from ipaddress import IPv4Address, IPv4Interface
from pathlib import Path

from nuc980.netboot.arrival import CTRL_C
from nuc980.netboot.board import BoardReport
from nuc980.netboot.boot import Addresses, Images, arguments_for, plan_boot, tree_for
from nuc980.netboot.commandline import text
from nuc980.netboot.console import Console
from nuc980.netboot.entrance import Entrance, keys_of, read_password
from nuc980.netboot.environment import Environment, keep
from nuc980.netboot.errors import CommandFailed, LineLost, LinuxSilent, UnusableInput
from nuc980.netboot.linux import Goal
from nuc980.netboot.plan import Plan
from nuc980.netboot.power import PowerHook
from nuc980.netboot.probe import probe
from nuc980.netboot.progress import Progress
from nuc980.netboot.session import TFTP_PORT, Network, Session, board_address, server_address
from nuc980.netboot.site import Site, with_prefix
from nuc980.netboot.steps import Slice
from nuc980.netboot.transport import BAUD, Line

LOGIN = Goal()


@dataclass(frozen=True)
class Target:
    """How a board is reached; the same as the options of nuc980-netboot of these names."""

    port: str | None
    board_ip: str | IPv4Interface | None = None
    server_ip: str | IPv4Address | None = None
    tftp_port: int = TFTP_PORT
    ethact: str | None = None
    listen: str | IPv4Address | None = None
    seen_as: str | IPv4Address | None = None
    baud: int = BAUD
    power_cycle: str | None = None
    log: Path | None = None
    prompt: str = ""
    autoboot: str = ""
    interrupt: str = ""
    password_prompt: str = ""
    password_file: str | Path | None = None
    site: str | Path = "site"
    dry_run: bool = False

    @cached_property
    def entrance(self) -> Entrance:
        """How its U-Boot is entered. Raises UnusableInput."""
        try:
            interrupt = keys_of(self.interrupt) if self.interrupt else b""
        except ValueError as error:
            raise UnusableInput(f"--interrupt {self.interrupt}: {error}") from error
        password = read_password(Path(self.password_file)) if self.password_file else b""
        return Entrance(self.prompt, self.autoboot, interrupt, self.password_prompt, password)

    @contextmanager
    def line(self) -> Iterator[Line]:
        """The serial port, open."""
        if not self.port:
            raise UnusableInput(
                "no --port is given", next_step="/dev/serial/by-id lists the ports of this machine"
            )
        _ = self.entrance  # which may ask somebody: before a board waits
        with Line(self.port, self.baud, self.log) as line:
            yield line

    @contextmanager
    def session(self, line: Line, progress: Progress) -> Iterator[Session]:
        """At U-Boot's prompt, as Console.reach() gets there."""
        if others := line.other_readers():
            progress.note(f"Beware: {others}. Close that program.")
        console = Console(line, progress.note, self.entrance)
        with progress.phase("reach U-Boot"):
            console.reach(PowerHook(self.power_cycle) if self.power_cycle else None)
        session = Session(console, progress)
        try:
            yield session
        except KeyboardInterrupt:
            if session.linux is None:  # end what U-Boot does at the moment, as a transfer
                with suppress(LineLost):
                    line.write(CTRL_C)
            raise

    def network(self, board: BoardReport) -> Network:
        """How the two reach each other: as said, else by the site and by what U-Boot knows."""
        given = with_prefix(str(self.board_ip)) if self.board_ip else None
        own = board_address(given, Site(Path(self.site)), board.environment)
        server = IPv4Address(self.server_ip) if self.server_ip else server_address(own)
        nat = (IPv4Address(given) if given else None for given in (self.listen, self.seen_as))
        return Network(own, server, self.tftp_port, self.ethact, *nat)

    def keep_environment(self, board: BoardReport) -> Path | None:
        """Into the folder of the site; None when a file there has the same."""
        environment = Environment(board.environment, board.environment_room)
        return keep(Path(self.site), environment, board.version, str(self.port))

    @contextmanager
    def planned_boot(
        self,
        board: BoardReport,
        network: Network,
        uimage: Path,
        tree: Path,
        bootargs: str | None = None,
        goal: Goal = LOGIN,
        *,
        flash: bool = False,
    ) -> Iterator[tuple[Plan, str]]:
        """The plan of a boot, whose files are there until the end of `with`; and the kernel's arguments.

        flash: Linux gets the flash, and may write by itself.
        """
        images = Images.read(uimage, tree)
        addresses = Addresses.of(board)
        images.check(board, addresses)
        macs = Site(Path(self.site), dry=self.dry_run).macs(board.environment)
        arguments = arguments_for(images.tree, board.environment, bootargs, macs)
        with tempfile.TemporaryDirectory(prefix="netboot-") as folder:
            served = Path(folder) / "nuc980.dtb"
            served.write_bytes(tree_for(images.tree, arguments, macs, flash=flash))
            plan = plan_boot(board, network, macs, Slice.of(uimage), Slice.of(served), goal, addresses)
            yield plan, arguments

    @contextmanager
    def uboot(self, progress: Progress | None = None) -> Iterator[UBoot]:
        """The board at U-Boot's prompt, until the end of `with`. Raises NetbootError."""
        progress = progress or Progress()
        with self.line() as line, self.session(line, progress) as session:
            yield UBoot(self, session, probe(session.console, progress, flash=False))


@dataclass(frozen=True)
class UBoot:
    """A board at its prompt."""

    target: Target
    session: Session
    board: BoardReport

    def run(self, command: str, seconds: float = 10.0) -> str:
        """What a command prints. Raises CommandFailed when it fails."""
        return self.session.console.run(command, seconds).required()

    def boot(
        self,
        uimage: str | Path,
        tree: str | Path,
        bootargs: str | None = None,
        goal: Goal = LOGIN,
        *,
        flash: bool = False,
    ) -> Linux:
        """Kernel and device tree by TFTP, and Linux up to its goal. Raises NetbootError.

        flash: Linux gets the flash, and may write by itself.
        """
        self.target.keep_environment(self.board)
        network = self.target.network(self.board)
        planned = self.target.planned_boot(
            self.board, network, Path(uimage), Path(tree), bootargs, goal, flash=flash
        )
        with planned as (plan, _), self.session.serving(network):
            plan.run(self.session)
        return Linux(self.session.console.line)


class Linux:
    """Linux on the console: at its login, then at a shell."""

    def __init__(self, line: Line) -> None:
        self._line = line
        self._received = ""
        self._commands = 0

    def send(self, words: str) -> None:
        """Types them, and Enter."""
        self._line.write(words.encode() + b"\r")

    def expect(self, pattern: str, seconds: float = 30.0) -> re.Match[str]:
        """Reads until the pattern has come, from what came after the last one on. Raises LinuxSilent."""
        wanted = re.compile(pattern, re.MULTILINE | re.DOTALL)
        deadline = time.monotonic() + seconds
        while not (found := wanted.search(self._received)):
            new = self._line.read(deadline - time.monotonic())
            if not new:
                raise LinuxSilent(f"No {pattern!r} within {seconds:g} s: {self._received[-300:]!r}")
            self._received += text(new)
        self._received = self._received[found.end() :]
        return found

    def login(self, user: str = "root", password: str = "") -> None:
        """From the login to a shell. Raises CommandFailed, LinuxSilent."""
        self.send(user)
        if self.expect(r"(assword: |[#$>] )$")[1].startswith("assword"):
            self.send(password)
            if self.expect(r"(incorrect|[#$>] $)")[1] == "incorrect":
                raise CommandFailed(f"Linux refuses {user} and the password.")

    def run(self, command: str, seconds: float = 30.0) -> str:
        """What a shell's command prints. Raises CommandFailed when its exit status is not 0.

        A prompt may come before or after the echo; neither has the marks as the shell prints them.
        """
        self._commands += 1
        mark = f"@{self._commands}:"
        self.send(f"echo {mark}; {command}; echo {mark}$?")
        found = self.expect(rf"{mark}\n(.*?){mark}(\d+)\n", seconds)
        if found[2] != "0":
            raise CommandFailed(f"Linux: '{command}' ended with {found[2]}: {found[1].strip()}")
        return found[1]
