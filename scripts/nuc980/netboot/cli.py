# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line of nuc980-netboot. Exit codes: 0 done, 1 failed, 2 unusable input."""

from __future__ import annotations

import argparse
import re
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from ipaddress import IPv4Address, IPv4Interface
from pathlib import Path

from nuc980.netboot.boot import Addresses, Images, arguments_for, plan_boot, tree_for
from nuc980.netboot.console import Console
from nuc980.netboot.errors import NetbootError, UnusableInput
from nuc980.netboot.flashing import add_flash_options, run_flash
from nuc980.netboot.linux import Goal
from nuc980.netboot.probe import BoardReport, probe
from nuc980.netboot.progress import Progress
from nuc980.netboot.session import TFTP_PORT, Network, Session, board_address, server_address
from nuc980.netboot.site import Site, with_prefix
from nuc980.netboot.steps import Slice
from nuc980.netboot.transport import BAUD, Line

INTERRUPTED = 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs one subcommand; returns the exit code."""
    parsed = _parser().parse_args(arguments)
    try:
        return parsed.run(parsed)
    except NetbootError as error:
        print(f"nuc980-netboot: {error}", file=sys.stderr)
        return error.exit_code
    except OSError as error:
        print(f"nuc980-netboot: {error.filename}: {error.strerror}", file=sys.stderr)
        return UnusableInput.exit_code
    except KeyboardInterrupt:
        print("nuc980-netboot: interrupted; port and server are closed", file=sys.stderr)
        return INTERRUPTED


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="nuc980-netboot", description="Boot and flash a NUC980 board over its debug UART and Ethernet."
    )
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    command = commands.add_parser("boot", help="load kernel and device tree by TFTP and start them")
    command.add_argument("uimage", type=Path, help="the kernel, a uImage")
    command.add_argument("dtb", type=Path, help="the device tree, compiled")
    _add_line(command)
    _add_network(command)
    _add_linux(command)
    command.set_defaults(run=_boot)
    command = commands.add_parser("flash", help="write kernel, device tree or UBI image into the flash")
    add_flash_options(command)
    _add_line(command)
    _add_network(command)
    command.set_defaults(run=lambda parsed: run_flash(parsed, _session, _network))
    return parser


def _add_line(command: argparse.ArgumentParser) -> None:
    group = command.add_argument_group("serial line")
    group.add_argument("--port", required=True, help="/dev/ttyUSB0, socket://HOST:PORT, rfc2217://HOST:PORT")
    group.add_argument("--baud", type=int, default=BAUD, help="bit/s (default: %(default)s)")
    group.add_argument("--power-cycle", metavar="COMMAND", help="switches the board off and on")
    group.add_argument("--log", type=Path, metavar="FILE", help="keep every byte of the line, with its time")


def _add_network(command: argparse.ArgumentParser) -> None:
    group = command.add_argument_group("network")
    group.add_argument(
        "--board-ip",
        type=_board_ip,
        metavar="ADDRESS/PREFIX",
        help="the board's (default: what the site's file board-ip says, else U-Boot's ipaddr and netmask)",
    )
    group.add_argument(
        "--server-ip",
        type=IPv4Address,
        metavar="ADDRESS",
        help="this host's, as the board sees it (default: the one in the board's network)",
    )
    group.add_argument(
        "--tftp-port",
        type=int,
        default=TFTP_PORT,
        help="UDP; another than %(default)s needs a U-Boot that knows tftpdstp",
    )
    group.add_argument(
        "--ethact", metavar="NAME", help="U-Boot's name of the Ethernet port (default: U-Boot's own choice)"
    )
    group.add_argument(
        "--listen", type=IPv4Address, metavar="ADDRESS", help="behind a NAT: where the server listens"
    )
    group.add_argument(
        "--seen-as",
        type=IPv4Address,
        metavar="ADDRESS",
        help="behind a NAT: the board, as the server sees it",
    )
    group.add_argument(
        "--site",
        type=Path,
        default=Path("site"),
        metavar="FOLDER",
        help="the board's own files (default: %(default)s)",
    )


def _add_linux(command: argparse.ArgumentParser) -> None:
    group = command.add_argument_group("Linux")
    group.add_argument(
        "--bootargs", metavar="TEXT", help="the kernel's arguments instead of the device tree's"
    )
    group.add_argument(
        "--until",
        type=_pattern,
        metavar="PATTERN",
        default=Goal.pattern,
        help="the line that ends the boot, a regular expression (default: the login)",
    )
    group.add_argument(
        "--timeout",
        type=float,
        metavar="SECONDS",
        default=Goal.seconds,
        help="for Linux to get there (default: %(default)g)",
    )


def _board_ip(text: str) -> IPv4Interface:
    try:
        return with_prefix(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def _pattern(text: str) -> str:
    try:
        re.compile(text)
    except re.error as error:
        raise argparse.ArgumentTypeError(f"{text!r}: {error}") from error
    return text


@contextmanager
def _session(parsed: argparse.Namespace) -> Iterator[Session]:
    progress = Progress()
    with Line(parsed.port, parsed.baud, parsed.log) as line:
        console = Console(line, progress.note)
        with progress.phase("reach U-Boot"):
            console.reach(_power_hook(parsed.power_cycle))
        yield Session(console, progress)


def _power_hook(command: str | None) -> Callable[[], None] | None:
    if command is None:
        return None
    return lambda: _run_hook(command)


def _run_hook(command: str) -> None:
    done = subprocess.run(shlex.split(command), capture_output=True, text=True)
    if done.returncode:
        raise UnusableInput(f"--power-cycle: '{command}' ended with {done.returncode}: {done.stderr.strip()}")


def _network(parsed: argparse.Namespace, board: BoardReport) -> Network:
    own = board_address(parsed.board_ip, Site(parsed.site), board.environment)
    server = parsed.server_ip or server_address(own)
    return Network(own, server, parsed.tftp_port, parsed.ethact, parsed.listen, parsed.seen_as)


def _boot(parsed: argparse.Namespace) -> int:
    images = Images.read(parsed.uimage, parsed.dtb)
    goal = Goal(parsed.until, parsed.timeout, min(parsed.timeout, Goal.first_seconds))
    with _session(parsed) as session, tempfile.TemporaryDirectory(prefix="netboot-") as folder:
        board = probe(session.console, session.progress, flash=False)
        addresses = Addresses.of(board)
        images.check(board, addresses)
        network, macs = _network(parsed, board), Site(parsed.site).macs(board.environment)
        arguments = arguments_for(images.tree, board.environment, parsed.bootargs, macs)
        served = Path(folder) / "nuc980.dtb"
        served.write_bytes(tree_for(images.tree, arguments, macs))
        session.progress.note(f"The kernel's arguments: {arguments}")
        plan = plan_boot(board, network, macs, Slice.of(parsed.uimage), Slice.of(served), goal, addresses)
        with session.serving(network):
            plan.run(session)
    for name, seconds in session.progress.phases.items():
        print(f"{seconds:8.2f} s  {name}")
    return 0
