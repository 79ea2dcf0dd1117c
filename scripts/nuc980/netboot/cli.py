# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line of nuc980-netboot. Exit codes: 0 done, 1 failed, 2 unusable input, 128 + n: signal n."""

from __future__ import annotations

import argparse
import os
import re
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from ipaddress import IPv4Address, IPv4Interface
from pathlib import Path
from types import FrameType

from nuc980 import VERSION
from nuc980.netboot import environment
from nuc980.netboot.boot import Images
from nuc980.netboot.environment import differences, plan_restore
from nuc980.netboot.errors import NetbootError, UnusableInput
from nuc980.netboot.flash.command import add_flash_options, run_flash
from nuc980.netboot.linux import Goal
from nuc980.netboot.probe import described
from nuc980.netboot.run import Run
from nuc980.netboot.session import TFTP_PORT
from nuc980.netboot.site import with_prefix
from nuc980.netboot.slots.command import (
    add_install_options,
    add_slots_options,
    run_install,
    run_slots,
)
from nuc980.netboot.terminal import check_terminal
from nuc980.netboot.transport import BAUD

# What ends a run early; port and server are closed first.
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
# An OSError that is about what the user named.
UNUSABLE = (FileNotFoundError, PermissionError, IsADirectoryError, NotADirectoryError)

EXAMPLES = {
    None: """\
examples:
  nuc980-netboot probe --port /dev/ttyUSB0
  nuc980-netboot boot --port /dev/ttyUSB0 --board-ip 192.168.1.20/24 uImage nuc980-gateway.dtb
  nuc980-netboot boot --dry-run --board-ip 192.168.1.20/24 uImage nuc980-gateway.dtb

exit codes: 0 done, 1 failed, 2 unusable input, 130 Ctrl-C. docs/netboot.md: the first boot of a board.""",
    "probe": """\
examples:
  nuc980-netboot probe --port /dev/ttyUSB0
  nuc980-netboot probe --port rfc2217://bench:4000 --json board.json --no-flash

It sets nothing. A U-Boot built to keep bad-block tables in the flash writes them at its first access if there
are none (this tree's only uses those that are there); --no-flash leaves the flash out.""",
    "boot": """\
examples:
  nuc980-netboot boot --port /dev/ttyUSB0 --board-ip 192.168.1.20/24 uImage nuc980-gateway.dtb
  nuc980-netboot boot --port /dev/ttyUSB0 --power-cycle 'uhubctl -a cycle -p 2' --junit boot.xml \\
    --board-ip 192.168.1.20/24 uImage nuc980-gateway.dtb
  nuc980-netboot boot --dry-run --as board.json --board-ip 192.168.1.20/24 uImage nuc980-gateway.dtb

The flash is not written: Linux does not get it, and after the next power-up the board is as before.
With --with-flash, Linux may write there by itself: the vendor's kernel makes bad-block tables in the last
four blocks when there are none, and UBI writes once it is attached.""",
    "flash": """\
examples:
  nuc980-netboot flash --port /dev/ttyUSB0 --board-ip 192.168.1.20/24 \\
    --kernel uImage --dtb nuc980-gateway.dtb --ubi rootfs.ubi
  nuc980-netboot flash --port /dev/ttyUSB0 --board-ip 192.168.1.20/24 --resume
  nuc980-netboot flash --port /dev/ttyUSB0 --board-ip 192.168.1.20/24 --roll-back
  nuc980-netboot flash --port /dev/ttyUSB0 --board-ip 192.168.1.20/24 --ubi rootfs.ubi \\
    --backup-by linux --backup-kernel netboot/uImage --backup-dtb netboot/nuc980-gateway.dtb

What is there is kept in the site's folder before anything is erased.""",
    "install": """\
examples:
  nuc980-netboot install --port /dev/ttyUSB0 --board-ip 192.168.1.20/24 uImage nuc980-gateway.dtb
  nuc980-netboot install --slot b --port /dev/ttyUSB0 --board-ip 192.168.1.20/24 uImage nuc980-gateway.dtb
  nuc980-netboot install --dry-run --board-ip 192.168.1.20/24 uImage nuc980-gateway.dtb
  nuc980-netboot install --port /dev/ttyUSB0 --board-ip 192.168.1.20/24 --ubi rootfs.ubi \\
    uImage nuc980-gateway.dtb

The root file system is inside the kernel, as in the image of make image-debian; UBI, with /data, then stays.
With --ubi it is in UBI, as in the images of make image-buildroot, and /data is made anew. What is there is
kept in the site's folder before anything is erased; flash --resume and --roll-back go on after an
interruption. docs/update.md has the rest.""",
    "slots": """\
examples:
  nuc980-netboot slots --port /dev/ttyUSB0
  nuc980-netboot slots --port /dev/ttyUSB0 --try b
  nuc980-netboot slots --port /dev/ttyUSB0 --base b

Without an option nothing is changed. A slot is marked only when its kernel and device tree are whole.""",
    "restore-env": """\
examples:
  nuc980-netboot restore-env --port /dev/ttyUSB0 site/environment.txt
  nuc980-netboot restore-env --port /dev/ttyUSB0 --save site/environment.txt

Without --save it is in the RAM only, until the next reset.""",
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs one subcommand; returns the exit code."""
    parsed = _parser().parse_args(arguments)
    run = Run(parsed)
    code = 0
    try:
        with _ended_by_signals():
            _check(parsed)
            parsed.act(run)
    except (NetbootError, OSError, KeyboardInterrupt) as error:
        code = _tell(error)
        run.report.failed, run.report.error = run.progress.failed, error
    if not run.dry:
        try:
            run.report.write(parsed.junit, parsed.json)
        except OSError as error:
            code = code or _tell(error)
    return code


def _tell(error: BaseException) -> int:
    """Says what happened; returns the exit code."""
    match error:
        case NetbootError():
            message, code = str(error), error.exit_code
        case _Ended():
            message, code = f"{error}; port and server are closed", error.exit_code
        case BrokenPipeError():  # nobody reads on, as behind `| head`
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return NetbootError.exit_code
        case OSError(filename=str() | Path()):
            message = f"{error.filename}: {error.strerror}"
            code = (UnusableInput if isinstance(error, UNUSABLE) else NetbootError).exit_code
        case _:
            message, code = str(error), NetbootError.exit_code
    print(f"nuc980-netboot: {message}", file=sys.stderr)
    return code


class _Ended(KeyboardInterrupt):
    """A signal; leaves all `with` on its way."""

    def __init__(self, number: int) -> None:
        super().__init__(
            "interrupted" if number == signal.SIGINT else f"ended by {signal.Signals(number).name}"
        )
        self.exit_code = 128 + number


@contextmanager
def _ended_by_signals() -> Iterator[None]:
    """The first one raises; the others wait until everything is closed. What was ignored stays so (nohup)."""

    def end(number: int, frame: FrameType | None) -> None:
        for each in before:
            signal.signal(each, signal.SIG_IGN)
        raise _Ended(number)

    before = {each: signal.getsignal(each) for each in SIGNALS if signal.getsignal(each) != signal.SIG_IGN}
    for each in before:
        signal.signal(each, end)
    try:
        yield
    finally:
        for each, action in before.items():
            signal.signal(each, action)


def _check(parsed: argparse.Namespace) -> None:
    """What argparse cannot see. Raises UnusableInput."""
    if parsed.board_as and not parsed.dry_run:
        raise UnusableInput("--as is for --dry-run", next_step="without --dry-run the tool asks the board")
    if parsed.all_lines and not parsed.dry_run:
        raise UnusableInput("--all-lines is for --dry-run", next_step="--log FILE keeps what is typed")
    if parsed.console:
        check_terminal()
    for path in (parsed.junit, parsed.json):
        if path and not path.parent.is_dir():
            raise UnusableInput(f"{path}: there is no folder {path.parent}")
        if path and path.is_dir():
            raise UnusableInput(f"{path} is a folder")


# ---- the options


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="nuc980-netboot",
        description="Boot and flash a NUC980 board over its debug UART and Ethernet.",
        epilog=EXAMPLES[None],
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s (OpenRTU) {VERSION}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    def add(name: str, act: Callable[[Run], None], does: str) -> argparse.ArgumentParser:
        command = commands.add_parser(
            name,
            help=does,
            description=f"{does[0].upper()}{does[1:]}.",
            epilog=EXAMPLES[name],
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        command.set_defaults(act=act)
        return command

    command = add("probe", _probe, "report what a board is: U-Boot, RAM, flash, network, with remarks")
    command.add_argument("--no-flash", action="store_true", help="do not touch the flash")
    _add_common(command)

    command = add("boot", _boot, "load kernel and device tree by TFTP and start them")
    command.add_argument("uimage", type=Path, help="the kernel, a uImage")
    command.add_argument("dtb", type=Path, help="the device tree, compiled")
    _add_linux(command)
    _add_network(command)
    _add_common(command)

    command = add("flash", run_flash, "write kernel, device tree or UBI image into the flash")
    add_flash_options(command)
    _add_network(command)
    _add_common(command)

    command = add(
        "install", run_install, "make two slots of the flash, and a boot command that falls back by itself"
    )
    add_install_options(command)
    _add_network(command)
    _add_common(command)

    command = add("slots", run_slots, "show a board's two slots, and which one boots")
    add_slots_options(command)
    _add_common(command)

    command = add("restore-env", _restore, "put a saved environment back")
    command.add_argument("file", type=Path, help="as printenv shows it; site/environment.txt")
    command.add_argument("--save", action="store_true", help="then write it to the flash (saveenv)")
    _add_common(command)
    return parser


def _add_common(command: argparse.ArgumentParser) -> None:
    group = command.add_argument_group("serial line")
    group.add_argument("--port", help="/dev/ttyUSB0, socket://HOST:PORT, rfc2217://HOST:PORT")
    group.add_argument("--baud", type=int, default=BAUD, help="bit/s (default: %(default)s)")
    group.add_argument(
        "--power-cycle", metavar="COMMAND", help="switches the board off and on (default: somebody does)"
    )
    group.add_argument("--log", type=Path, metavar="FILE", help="keep every byte of the line, with its time")
    group.add_argument(
        "--console", action="store_true", help="hand the terminal over in the end; Ctrl-] leaves it"
    )
    group = command.add_argument_group("a U-Boot that is locked")
    group.add_argument(
        "--interrupt",
        default="",
        metavar="TEXT",
        help="stops autoboot (default: Ctrl-C); \\xHH is a character",
    )
    group.add_argument(
        "--autoboot",
        type=_pattern,
        default="",
        metavar="PATTERN",
        help="the line that says how autoboot is stopped (default: one with 'autoboot')",
    )
    group.add_argument(
        "--password-file",
        type=Path,
        metavar="FILE",
        help="U-Boot's password, or a secret --interrupt; - asks you for it",
    )
    group.add_argument(
        "--password-prompt",
        type=_pattern,
        default="",
        metavar="PATTERN",
        help="how U-Boot asks for it (default: a last line as 'Password: ')",
    )
    group.add_argument(
        "--prompt",
        type=_pattern,
        default="",
        metavar="PATTERN",
        help="U-Boot's prompt (default: what it says to Ctrl-C)",
    )
    group = command.add_argument_group("files")
    group.add_argument(
        "--site",
        type=Path,
        default=Path("site"),
        metavar="FOLDER",
        help="the board's own files (default: %(default)s)",
    )
    group.add_argument("--junit", type=Path, metavar="FILE", help="write a JUnit report, a case per phase")
    group.add_argument("--json", type=Path, metavar="FILE", help="write what was found and done")
    group = command.add_argument_group("without a board")
    group.add_argument(
        "--dry-run", action="store_true", help="show what would be typed and done; no port is opened"
    )
    group.add_argument(
        "--all-lines", action="store_true", help="with --dry-run: also each of many lines that are alike"
    )
    group.add_argument(
        "--as",
        dest="board_as",
        type=Path,
        metavar="FILE",
        help="on the board of which probe --json wrote this (default: one as from the factory)",
    )


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
        type=_udp_port,
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


def _add_linux(command: argparse.ArgumentParser) -> None:
    group = command.add_argument_group("Linux")
    group.add_argument(
        "--bootargs", metavar="TEXT", help="the kernel's arguments instead of the device tree's"
    )
    group.add_argument(
        "--with-flash",
        action="store_true",
        help="leave the flash on in the device tree: the kernel may write there by itself",
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


def _udp_port(text: str) -> int:
    if not text.isdecimal() or not 0 < int(text) < 1 << 16:
        raise argparse.ArgumentTypeError(f"{text!r} is not a UDP port: give a number from 1 to 65535")
    return int(text)


def _pattern(text: str) -> str:
    try:
        re.compile(text)
    except re.error as error:
        raise argparse.ArgumentTypeError(f"{text!r}: {error}") from error
    return text


# ---- the subcommands


def _probe(run: Run) -> None:
    with run.board(flash=not run.parsed.no_flash, change=False) as (_, board):
        if not run.dry:
            run.note(described(board))


def _boot(run: Run) -> None:
    parsed = run.parsed
    Images.read(parsed.uimage, parsed.dtb)  # before a board is touched
    goal = Goal(parsed.until, parsed.timeout)
    with run.board(flash=False) as (session, board):
        network = run.target.network(board)
        planned = run.target.planned_boot(
            board, network, parsed.uimage, parsed.dtb, parsed.bootargs, goal, flash=parsed.with_flash
        )
        if not parsed.with_flash:
            run.note("Linux gets no flash: its node in the device tree is off (--with-flash leaves it on).")
        with planned as (plan, arguments):
            run.note(f"The kernel's arguments: {arguments}")
            run.carry_out(plan, session, network)


def _restore(run: Run) -> None:
    wanted = environment.load(run.parsed.file).variables
    with run.board(flash=False) as (session, board):
        found = list(differences(board.environment, wanted))
        run.note("\n".join(map(str, found)) or "Nothing differs.")
        run.carry_out(plan_restore(board.environment, wanted, save=run.parsed.save), session)
