# SPDX-License-Identifier: GPL-3.0-or-later
"""One run of a subcommand: on the board, or dry, on one that is assumed."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from typing import cast

from nuc980.netboot.board import FACTORY, BoardReport
from nuc980.netboot.commandline import typed
from nuc980.netboot.console import Console
from nuc980.netboot.errors import LineLost, NetbootError
from nuc980.netboot.plan import Plan
from nuc980.netboot.probe import probe, questions
from nuc980.netboot.progress import Progress
from nuc980.netboot.report import Report, board_of
from nuc980.netboot.session import Network, Session
from nuc980.netboot.site import Site
from nuc980.netboot.target import Target
from nuc980.netboot.terminal import hand_over
from nuc980.netboot.transport import Line

CONFIRM = "version"  # what Console.reach() asks
ENTRANCE = ("prompt", "autoboot", "interrupt", "password_prompt", "password_file")
NETWORK = ("board_ip", "server_ip", "tftp_port", "ethact", "listen", "seen_as")


class Run:
    """The options of the command line, the board that they lead to, and what is reported of it."""

    def __init__(self, parsed: argparse.Namespace) -> None:
        self.parsed = parsed
        self.progress = Progress()
        self.report = Report(parsed.command, phases=self.progress.phases)
        self.site = Site(parsed.site, dry=parsed.dry_run)
        self.target = Target(
            parsed.port,
            baud=parsed.baud,
            power_cycle=parsed.power_cycle,
            log=parsed.log,
            site=parsed.site,
            dry_run=parsed.dry_run,
            **{name: getattr(parsed, name) for name in ENTRANCE},
            **{name: getattr(parsed, name) for name in NETWORK if hasattr(parsed, name)},
        )
        self._asked = 0  # commands before the plan's

    @property
    def dry(self) -> bool:
        """Whether nothing is to be done."""
        return self.parsed.dry_run

    def note(self, text: str) -> None:
        self.progress.note(text)

    @contextmanager
    def board(self, *, flash: bool, change: bool = True) -> Iterator[tuple[Session, BoardReport]]:
        """The board at U-Boot's prompt, probed; change: its environment is kept first.

        In a dry run one that is assumed: there is no console then.
        """
        if self.dry:
            yield self._assumed(flash=flash, change=change)
            return
        with (
            self.target.line() as line,
            self._console_after(line),
            self.target.session(line, self.progress) as session,
        ):
            board = self.report.board = probe(session.console, self.progress, flash=flash)
            if change and (kept := self.target.keep_environment(board)):
                self.note(f"The board's environment is kept in {kept}.")
            yield session, board

    @contextmanager
    def _console_after(self, line: Line) -> Iterator[None]:
        """Tells the times; with --console, the terminal is the board's then, also when something failed."""
        try:
            yield
        except LineLost:
            raise
        except NetbootError as error:
            if self.parsed.console:
                self.note(str(error))
                hand_over(line)
            raise
        self.note(self.report.times())
        if self.parsed.console:
            hand_over(line)

    def carry_out(self, plan: Plan, session: Session, network: Network | None = None) -> None:
        """Does it, with a server for the board's files when there is a network; in a dry run shows it."""
        if self.dry:
            self.show(plan, network)
            return
        with session.serving(network) if network else nullcontext():
            plan.run(session)

    def show(self, plan: Plan, network: Network | None = None) -> None:
        """What would be typed, and what is done beside."""
        if network:
            if not (macs := self.site.folder / "macs").exists():
                self.note(
                    f"Write the board's MAC addresses into {macs}; new ones are shown here as examples."
                )
            self.note(f"Serve {network}.")
        first = self._asked + 1
        shown = plan.dialogue(first)
        if not self.parsed.all_lines and (summary := plan.summary(first)) != shown:
            shown = summary
            self.note("What is done many times is shown once; --all-lines shows each line.")
        for title, lines in shown:
            self._show(title, lines)

    def _show(self, title: str, lines: list[str]) -> None:
        self.note(title)
        for line in lines:
            self.note(f"    => {line}")

    def _assumed(self, *, flash: bool, change: bool) -> tuple[Session, BoardReport]:
        board = board_of(self.parsed.board_as) if self.parsed.board_as else FACTORY
        self.note(f"Nothing is done. The board is taken to be: {board.version}")
        self.note(f"Open {self.parsed.port or 'the port'} at {self.parsed.baud} bit/s.")
        if self.parsed.power_cycle:
            self.note(f"Run {self.parsed.power_cycle}")
        asked = [CONFIRM, *questions(board, flash=flash)]
        lines = [typed(command, number) for number, command in enumerate(asked, 1)]
        self._asked = len(asked)
        self._show("Stop autoboot with Ctrl-C, until the prompt comes.", lines[:1])
        self._show("Ask what the board is.", lines[1:])
        if change:
            self.note(f"Keep its environment in {self.site.folder}, if no file there has the same.")
        no_console = cast(Console, None)  # whoever types in a dry run has a bug
        return Session(no_console, self.progress), board
