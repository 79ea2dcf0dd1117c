# SPDX-License-Identifier: GPL-3.0-or-later
"""`make run`: the emulated board from reset to the control room's table, live.

Exit code 0: all of it was seen; 1: not, with the reason; 2: something is not built.
"""

from __future__ import annotations

import argparse
import contextlib
import re
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lab import managed
from lab.board import (
    ETHERNET,
    PORTS,
    SILENCE_US,
    SSH_PORT,
    STATION_PORT,
    Board,
    Ssh,
    configuration,
    lines_at,
    stations,
)
from lab.boots import Image, flash_for
from lab.gateway import REPOSITORY, free_port, remove
from lab.manager import free_udp_port
from lab.ports import check_free
from lab.show import (
    CHAPTER_5,
    DEADLINE_S,
    PROGRAMS,
    STATION,
    STEPS,
    ServedDesk,
    Step,
    add_gateway,
    add_iec61850,
    add_logic,
    add_options,
    all_read,
    check,
    check_none,
    compile_programs,
    event,
    indented,
    interrogated,
    invalid,
    keep_up,
    limit_reloaded,
    logic,
    managed_by_snmp,
    mastered,
    name_level,
    operated_by_iec61850,
    position,
    run_steps,
    running,
    say,
    start_lines,
    table,
    typed,
)
from lab.verdict import Verdict, run
from nuc980.netboot.progress import Progress
from nuc980.twin.linux import TROUBLE
from nuc980.twin.machine import INSTRUCTION_TIME, Machine

QEMU = REPOSITORY / "build/qemu/bin/qemu-system-arm"
UBOOT = REPOSITORY / "build/u-boot/u-boot.bin"
SYSTEM = Image(REPOSITORY / "build/system-lab")
KEY = REPOSITORY / "build/site/key"

IEC61850_PORT, SNMP_PORT = 102, 161
DATA = "/data/openrtu"  # of the engineer's files

LATENCY_SECONDS = 5  # without load, and as long with it


@dataclass
class BoardDesk(ServedDesk):
    """What a step on the board works on."""

    gateway: Board


# ---- the steps that only a board has


def kernel(desk: BoardDesk) -> None:
    """The kernel"""
    version = desk.gateway.inside("uname -a").strip()
    say(f"     {version}")
    check("PREEMPT_RT" in version, "the kernel is not PREEMPT_RT")


def modules(desk: BoardDesk) -> None:
    """The gateway's processes, seen from inside: rtuctl modules"""
    say(indented(desk.gateway.ctl("modules")))
    modules = desk.gateway.modules()
    down = [name for name, module in modules.items() if not module["pid"] and name != "rtuctl"]
    check(not down, f"not running: {', '.join(down)}")


def pins(desk: BoardDesk) -> None:
    """The pins of the running board: which devices have theirs (info nuc980-pins)"""
    view = desk.gateway.machine.info("nuc980-pins").replace("\r", "")
    _, _, devices = view.partition("\n\n")
    say(indented(devices))
    for device in ("uart0", *(f"uart{number}" for number in PORTS), "emac0", "emac1"):
        found = re.search(rf"^{device} .*connected", devices, re.MULTILINE)
        check(found is not None, f"{device} has no pins")


def killed(desk: BoardDesk) -> None:
    """A line process is killed (kill -9): its points turn invalid, and rtud restarts it"""
    lines = next(name for name in desk.gateway.modules() if name.startswith("rtu-modbus"))
    before = desk.gateway.modules()[lines]["pid"]
    since = desk.master.mark()
    desk.gateway.kill(lines)
    say(f"     board        kill -9 {before} ({lines})")
    gone = desk.master.wait(lambda r: r.ca == STATION and "Invalid" in r.quality, since, timeout_s=DEADLINE_S)
    event(gone)
    event(desk.master.wait(lambda r: (r.ca, r.ioa, r.good) == (gone.ca, gone.ioa, True), since, DEADLINE_S))
    desk.gateway.wait_for(lambda: all_read(desk.gateway), DEADLINE_S, "all points are good again")
    after = desk.gateway.modules()[lines]["pid"]
    say(f"     board        {lines} runs again (pid {after}); the master stayed connected")
    check(after != before, f"rtud did not restart {lines}")


def latency(desk: BoardDesk) -> None:
    """Ten seconds of cyclictest, half of them with load: rt-report"""
    if not desk.gateway.inside("command -v cyclictest || true"):
        say("     skipped: this image has no cyclictest (package rt-tests)")
        return
    # Its exit code is about errors too, such as characters that a busy host made the emulator lose.
    measured = desk.gateway.inside(f"rt-report --emulator --seconds {LATENCY_SECONDS} || true")
    say(indented(measured))
    check(measured.count("us at most") == 2, "cyclictest measured nothing")
    say("     These are times of an emulator; docs/realtime.md says what to measure on a board")


def whole_station(desk: BoardDesk) -> None:
    """All stations, as the control room sees them at the end"""
    # What the load before took from the lines comes back.
    desk.gateway.wait_for(lambda: all_read(desk.gateway), DEADLINE_S, "all points are good")
    reports = interrogated(desk, *stations())
    table(reports)
    check_none(invalid(reports), "are not valid")


BOARD_STEPS: tuple[Step, ...] = (
    kernel,
    modules,
    pins,
    *STEPS,
    limit_reloaded,
    logic,
    killed,
    position,
    operated_by_iec61850,
    managed_by_snmp,
    latency,
    whole_station,
)


# ---- the board


@dataclass(frozen=True)
class Ways:
    """The ports of this machine that lead to services of the board."""

    station: int
    ssh: int
    iec61850: int
    snmp: int

    def arguments(self) -> list[str]:
        """QEMU's."""
        streams = {self.station: STATION_PORT, self.ssh: SSH_PORT, self.iec61850: IEC61850_PORT}
        return ETHERNET[0].arguments(streams, {self.snmp: SNMP_PORT})


def furnished(directory: Path, snmp: dict[str, Any]) -> tuple[dict[str, Any], dict[str, bytes]]:
    """What an engineer brings to the board: a configuration with more than the image's, and its files."""
    config = configuration() | {"snmp": snmp}
    name_level(config)
    add_iec61850(config, ETHERNET[0].address, ETHERNET[0].host)
    add_logic(config, DATA)
    compile_programs(directory)
    return config, {f"{DATA}/{name}.rtul": (directory / f"{name}.rtul").read_bytes() for name in PROGRAMS}


def start_board(
    stack: contextlib.ExitStack,
    directory: Path,
    ways: Ways,
    config: dict[str, Any],
    files: dict[str, bytes],
    image: Image,
    verdict: Verdict,
) -> Board:
    """From reset to the gateway's first answer."""
    nics = [
        *ways.arguments(),
        *ETHERNET[1].arguments({}),
    ]
    console = directory / "console.log"
    add_console(verdict, console)
    chardevs = {0: f"pty,logfile={console}", **lines_at(directory / "dev")}
    flash = flash_for(image, QEMU, UBOOT, directory) if image.ubi.exists() else []
    arguments = [*INSTRUCTION_TIME, "-bios", UBOOT, *nics, *flash]
    machine = stack.enter_context(Machine(QEMU, *arguments, uarts=(), chardevs=chardevs))
    verdict.add_machine(machine)
    say(f"   * the emulated board is switched on; its debug UART is {machine.pty(0)}")
    progress = Progress()
    image.boot(machine, directory, progress)
    ssh = stack.enter_context(Ssh(ways.ssh, KEY, directory))
    board = Board(machine, ssh.run, ("127.0.0.1", ways.station))
    board.rtuctl = [*ssh.command, "rtuctl"]
    with progress.phase("log-in by ssh"):
        board.wait_for(ssh.answers, DEADLINE_S, "the log-in by ssh succeeds")
    add_gateway(verdict, board)
    with progress.phase("programs, keys and a configuration brought by ssh"):
        for path, content in files.items():
            board.place(path, content)
        board.start_again(config)
    with progress.phase("all points read"):
        board.wait_for(lambda: all_read(board), DEADLINE_S, "every device has been read")
    say(f"   * {', '.join(running(board))}; all points read")
    say("     seconds of this host by phase:")
    for phase, seconds in progress.phases.items():
        say(f"     {seconds:8.1f}  {phase}")
    return board


def add_console(verdict: Verdict, console: Path) -> None:
    """What U-Boot and the kernel said on the debug UART, and what in it is a cause."""

    def trouble() -> str:
        found = TROUBLE.search(console.read_text(errors="replace"))
        return f"the kernel reported: {found[1]}" if found else ""

    verdict.sources["the debug UART"] = lambda: console.read_text(errors="replace")
    verdict.causes.append(trouble)


def show(port: int, keep: bool, image: Image, verdict: Verdict) -> None:
    """Runs the show; raises what went wrong."""
    check_free(port, f"make run{' KEEP=1' if keep else ''}")
    begin = time.monotonic()
    directory = Path(tempfile.mkdtemp(prefix="openrtu-"))
    say("OpenRTU on the emulated board: from reset to the control room's table")
    with contextlib.ExitStack() as stack, verdict.watched():
        stack.callback(remove, directory)
        lines = start_lines(stack, directory, CHAPTER_5 / "gateway.json", verdict, SILENCE_US)
        ways = Ways(port, free_port(), free_port(), free_udp_port())
        snmp = managed.settings(ETHERNET[0].host, keys=f"{DATA}/snmp.keys", state=f"{DATA}/snmp")
        folder = directory / "management"
        management = stack.enter_context(managed.managed(folder, snmp, ways.snmp))
        config, files = furnished(directory, snmp)
        files[snmp["keys"]] = managed.keys_of(folder).read_bytes()
        board = start_board(stack, directory, ways, config, files, image, verdict)
        with mastered(board, verdict) as master:
            desk = BoardDesk(lines, board, master, management, ways.iec61850)
            run_steps(desk, BOARD_STEPS, verdict)
        trouble = TROUBLE.findall((directory / "console.log").read_text(errors="replace"))
        check(not trouble, f"the kernel reported: {'; '.join(trouble)}")
        say(f"It took {time.monotonic() - begin:.0f} s.")
        if keep:
            keep_up(board, lines)


def main() -> int:
    """The command line. Exit codes: 0 every step succeeded, 1 one did not, 2 wrong usage or nothing built."""
    parser = argparse.ArgumentParser(prog="make run", description=__doc__.splitlines()[0])
    add_options(parser)
    parser.add_argument("--image", type=Path, help="another one, made with SITE=build/site/lab")
    arguments = parser.parse_args()
    image = Image(arguments.image) if arguments.image else SYSTEM
    for file, target in ((QEMU, "qemu"), (UBOOT, "uboot"), (image.uimage, "run")):
        if not file.exists():
            print(f"make run: {file} does not exist; type: make {target}", file=sys.stderr)
            return 2
    verdict = Verdict(typed("make run", arguments), "run")
    return run(verdict, lambda: show(arguments.port, arguments.keep, image, verdict))


if __name__ == "__main__":
    sys.exit(main())
