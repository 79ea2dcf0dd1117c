# SPDX-License-Identifier: GPL-3.0-or-later
"""One run of a subcommand: the board at its prompt, or without one, what would be typed there."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from typing import cast

from nuc980.netboot.arrival import CTRL_C
from nuc980.netboot.console import Console, typed
from nuc980.netboot.environment import Environment, keep
from nuc980.netboot.errors import LineLost, UnusableInput
from nuc980.netboot.plan import Plan
from nuc980.netboot.power import PowerHook
from nuc980.netboot.probe import FACTORY, BoardReport, probe, questions
from nuc980.netboot.progress import Progress
from nuc980.netboot.report import Report, board_of
from nuc980.netboot.session import Network, Session, board_address, server_address
from nuc980.netboot.site import Site
from nuc980.netboot.transport import Line

CONFIRM = "version"  # what Console.reach() asks


class Run:
    """The options of the command line, the board that they lead to, and what is reported of it."""

    def __init__(self, parsed: argparse.Namespace) -> None:
        self.parsed = parsed
        self.progress = Progress()
        self.report = Report(parsed.command, phases=self.progress.phases)
        self.site = Site(parsed.site)
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
        if not self.parsed.port:
            raise UnusableInput(
                "no --port is given", next_step="look at /dev/serial/by-id for the ports there are"
            )
        with Line(self.parsed.port, self.parsed.baud, self.parsed.log) as line:
            console = Console(line, self.note)
            hook = self.parsed.power_cycle
            with self.progress.phase("reach U-Boot"):
                console.reach(PowerHook(hook) if hook else None)
            session = Session(console, self.progress)
            try:
                board = self.report.board = probe(console, self.progress, flash=flash)
                if change:
                    self._keep(board)
                yield session, board
            except KeyboardInterrupt:
                if session.linux is None:
                    with suppress(LineLost):
                        line.write(
                            CTRL_C
                        )  # ends what U-Boot does at the moment, a transfer that nobody serves
                raise

    def network(self, board: BoardReport) -> Network:
        """How the two reach each other, by the options, the site and the board's environment."""
        parsed = self.parsed
        own = board_address(parsed.board_ip, self.site, board.environment)
        server = parsed.server_ip or server_address(own)
        return Network(own, server, parsed.tftp_port, parsed.ethact, parsed.listen, parsed.seen_as)

    def carry_out(self, plan: Plan, session: Session, network: Network | None = None) -> None:
        """Does it, with a server for the board's files when there is a network; in a dry run shows it."""
        if self.dry:
            self.show(plan, network)
            return
        with session.serving(network) if network else nullcontext():
            plan.run(session)

    def show(self, plan: Plan, network: Network | None = None) -> None:
        """The lines that would be typed, and what is done beside."""
        if network:
            self.note(
                f"Serve files by TFTP at UDP port {network.port} of {network.listen or network.server}, "
                f"to {network.seen_as or network.board.ip} alone, each while its step runs."
            )
        for title, lines in plan.dialogue(self._asked + 1):
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

    def _keep(self, board: BoardReport) -> None:
        environment = Environment(board.environment, board.environment_room)
        kept = keep(self.site.folder, environment, board.version, self.parsed.port)
        if kept:
            self.note(f"The board's environment is kept in {kept}.")
