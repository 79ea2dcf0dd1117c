# SPDX-License-Identifier: GPL-3.0-or-later
"""`make run IMAGE=folder`: boots what `make image` made, on the emulated board over the network.

Exit code 0: the log-in came; 1: not, with the reason; 2: there is no image.
"""

from __future__ import annotations

import argparse
import contextlib
import re
import sys
import tempfile
from pathlib import Path

from lab.board import ETHERNET, netboot
from lab.board_show import QEMU, UBOOT
from lab.gateway import remove
from lab.show import REASONS, say, told
from nuc980.netboot.errors import NetbootError
from nuc980.netboot.progress import Progress
from nuc980.twin.linux import TROUBLE
from nuc980.twin.machine import Machine, MachineError
from nuc980.twin.nand import NandImage

# What the console says, by what it is.
SEEN = {
    "U-Boot": r"^(U-Boot \d.*?)\r?$",
    "kernel": r"(Linux version .*?)\r?$",
    "board": r"Machine model: (.*?)\r?$",
    "arguments": r"Kernel command line: (.*?)\r?$",
    "log-in": r"^(\S+ login:)",
}


def show(folder: Path) -> None:
    """Boots it, with an empty flash: the vendor's kernel needs one. Raises NetbootError, MachineError."""
    directory = Path(tempfile.mkdtemp(prefix="openrtu-"))
    with contextlib.ExitStack() as stack:
        stack.callback(remove, directory)
        flash = NandImage.blank(directory / "nand.img")
        console = directory / "console.log"
        arguments = ["-bios", UBOOT, "-drive", f"if=mtd,format=raw,file={flash.path}"]
        arguments += [word for network in ETHERNET for word in network.arguments({})]
        machine = stack.enter_context(
            Machine(QEMU, *arguments, uarts=(), chardevs={0: f"pty,logfile={console}"})
        )
        progress = Progress()
        netboot(machine, directory, folder / "uImage", folder / "nuc980-gateway.dtb", progress)
        tell(console.read_text(errors="replace"), progress)


def tell(said: str, progress: Progress) -> None:
    """What was seen."""
    say()
    for name, pattern in SEEN.items():
        found = re.search(pattern, said, re.MULTILINE)
        say(f"{name:<10} {found[1] if found else 'not seen'}")
    for trouble in TROUBLE.findall(said):
        say(f"{'trouble':<10} {trouble}")
    say(
        f"{'took':<10} {sum(progress.phases.values()):.1f} s, of which Linux {progress.phases['Linux']:.1f} s"
    )


def main() -> int:
    parser = argparse.ArgumentParser(prog="make run IMAGE=", description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="build/nuc980_netboot, or another with an image")
    folder = parser.parse_args().folder
    images = folder / "images" if (folder / "images").is_dir() else folder
    for name in ("uImage", "nuc980-gateway.dtb"):
        if not (images / name).exists():
            print(f"make run: {images / name} is not there: make image", file=sys.stderr)
            return 2
    return told(f"make run IMAGE={folder}", lambda: show(images), (*REASONS, MachineError, NetbootError))


if __name__ == "__main__":
    sys.exit(main())
