# SPDX-License-Identifier: GPL-3.0-or-later
"""`make run IMAGE=folder`: boots a Buildroot image over the emulated board's network or from its flash.

Exit code 0: the log-in came; 1: not, with the reason; 2: there is no image.
"""

from __future__ import annotations

import argparse
import contextlib
import re
import sys
import tempfile
import time
from pathlib import Path

from lab.board import ETHERNET
from lab.board_show import QEMU, UBOOT, add_console
from lab.boots import LOG_IN, Image, flash_for
from lab.gateway import remove
from lab.show import say
from lab.verdict import Verdict, run
from nuc980.netboot.progress import Progress
from nuc980.twin.linux import TROUBLE
from nuc980.twin.machine import Machine

LOG_SECONDS = 5.0
# What the console says, by what it is.
SEEN = {
    "U-Boot": r"^(U-Boot \d.*?)\r?$",
    "kernel": r"(Linux version .*?)\r?$",
    "board": r"Machine model: (.*?)\r?$",
    "arguments": r"Kernel command line: (.*?)\r?$",
    "/data": r'UBIFS.*: mounted (UBI device \d+, volume \d+), name "data"',
    "log-in": LOG_IN,
}


def show(image: Image, verdict: Verdict) -> None:
    """Boots it. Raises NetbootError, MachineError, NotSeenError."""
    directory = Path(tempfile.mkdtemp(prefix="openrtu-"))
    verdict.expected = "the image boots to its log-in"
    with contextlib.ExitStack() as stack, verdict.watched():
        stack.callback(remove, directory)
        console = directory / "console.log"
        add_console(verdict, console)
        arguments = ["-bios", UBOOT, *flash_for(image, QEMU, UBOOT, directory)]
        arguments += [word for network in ETHERNET for word in network.arguments({})]
        machine = stack.enter_context(
            Machine(QEMU, *arguments, uarts=(), chardevs={0: f"pty,logfile={console}"})
        )
        verdict.add_machine(machine)
        begin = time.monotonic()
        image.boot(machine, directory, Progress())
        took = time.monotonic() - begin
        tell(log_of(console), took)


def log_of(console: Path) -> str:
    """All of the log. QEMU gives octets to the port first: the log-in was seen there, and is here later."""
    deadline = time.monotonic() + LOG_SECONDS
    while True:
        log = console.read_text(errors="replace")
        if re.search(SEEN["log-in"], log, re.MULTILINE) or time.monotonic() > deadline:
            return log
        time.sleep(0.01)


def tell(log: str, seconds: float) -> None:
    """What was seen."""
    say()
    for name, pattern in SEEN.items():
        found = re.search(pattern, log, re.MULTILINE)
        say(f"{name:<10} {found[1] if found else 'not seen'}")
    for trouble in TROUBLE.findall(log):
        say(f"{'trouble':<10} {trouble}")
    say(f"{'took':<10} {seconds:.1f} s from U-Boot to the log-in")


def main() -> int:
    parser = argparse.ArgumentParser(prog="make run IMAGE=", description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="build/nuc980_netboot, or another with an image")
    folder = parser.parse_args().folder
    image = Image(folder)
    if missing := image.missing():
        print(f"make run: {missing} does not exist; type: make image-buildroot", file=sys.stderr)
        return 2
    verdict = Verdict(f"make run IMAGE={folder}", "run-image")
    return run(verdict, lambda: show(image, verdict))


if __name__ == "__main__":
    sys.exit(main())
