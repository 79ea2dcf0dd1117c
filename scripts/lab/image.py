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

from lab.board import ETHERNET, netboot
from lab.board_show import QEMU, UBOOT, add_console
from lab.gateway import remove
from lab.show import NotSeenError, say
from lab.verdict import Verdict, run
from nuc980.netboot import cli
from nuc980.netboot.progress import Progress
from nuc980.netboot.target import Linux
from nuc980.netboot.transport import Line
from nuc980.twin.linux import TROUBLE
from nuc980.twin.machine import Machine
from nuc980.twin.nand import NandImage
from nuc980.twin.network import free_udp_port

BOOT_SECONDS = 300.0
LOG_SECONDS = 5.0
IMAGE = ("uImage", "nuc980-gateway.dtb", "rootfs.ubi")  # the last one only where the root is in the flash
# What the console says, by what it is.
SEEN = {
    "U-Boot": r"^(U-Boot \d.*?)\r?$",
    "kernel": r"(Linux version .*?)\r?$",
    "board": r"Machine model: (.*?)\r?$",
    "arguments": r"Kernel command line: (.*?)\r?$",
    "/data": r'UBIFS.*: mounted (UBI device \d+, volume \d+), name "data"',
    "log-in": r"^(\S+ login:)",
}


def show(folder: Path, verdict: Verdict) -> None:
    """Boots it. The flash is empty, and there in any case: the vendor's kernel needs one.

    Raises NetbootError, MachineError, NotSeenError.
    """
    directory = Path(tempfile.mkdtemp(prefix="openrtu-"))
    verdict.expected = "the image boots to its log-in"
    with contextlib.ExitStack() as stack, verdict.watched():
        stack.callback(remove, directory)
        flash = NandImage.blank(directory / "nand.img")
        console = directory / "console.log"
        add_console(verdict, console)
        arguments = ["-bios", UBOOT, "-drive", f"if=mtd,format=raw,file={flash.path}"]
        arguments += [word for network in ETHERNET for word in network.arguments({})]
        machine = stack.enter_context(
            Machine(QEMU, *arguments, uarts=(), chardevs={0: f"pty,logfile={console}"})
        )
        verdict.add_machine(machine)
        uimage, dtb, ubi = (folder / name for name in IMAGE)
        in_flash = ubi.exists()
        if in_flash:
            install(machine, directory, uimage, dtb, ubi)
        begin = time.monotonic()
        if in_flash:
            boot_from_flash(machine)
        else:
            netboot(machine, directory, uimage, dtb, Progress())
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


def install(machine: Machine, directory: Path, uimage: Path, dtb: Path, ubi: Path) -> None:
    """Writes all of it into the flash, as one does with a board. Raises NotSeenError."""
    code = cli.main(
        ["flash", "--kernel", str(uimage), "--dtb", str(dtb), "--ubi", str(ubi),
         "--no-backup", "the flash is empty", "--site", str(directory / "site"), "--port", machine.pty(0),
         "--board-ip", ETHERNET[0].board, "--server-ip", ETHERNET[0].host,
         "--listen", "127.0.0.1", "--seen-as", "127.0.0.1", "--tftp-port", str(free_udp_port())]
    )  # fmt: skip
    if code:
        raise NotSeenError(
            f"nuc980-netboot flash ended with {code}; its lines are above", expected="the image in the flash"
        )


def boot_from_flash(machine: Machine) -> None:
    """As a board does by itself: by its own boot command. Raises NetbootError."""
    with Line(machine.pty(0)) as line:
        machine.command("system_reset")
        Linux(line).expect(SEEN["log-in"], BOOT_SECONDS)


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
    images = folder / "images" if (folder / "images").is_dir() else folder
    for name in IMAGE[:2]:
        if not (images / name).exists():
            print(f"make run: {images / name} does not exist; type: make image-buildroot", file=sys.stderr)
            return 2
    verdict = Verdict(f"make run IMAGE={folder}", "run-image")
    return run(verdict, lambda: show(images, verdict))


if __name__ == "__main__":
    sys.exit(main())
