# SPDX-License-Identifier: GPL-3.0-or-later
"""`make twin`: the emulated board from reset to a file loaded over TFTP, its pins, and what a wrong pin does.

Exit code 0: all of it was seen; 1: not, with the reason; 2: QEMU or U-Boot is not built.
"""

from __future__ import annotations

import argparse
import random
import re
import sys
import tempfile
import zlib
from pathlib import Path

from lab.errors import LabError
from lab.gateway import REPOSITORY
from lab.verdict import Verdict, run
from nuc980 import VERSION
from nuc980.twin.machine import Machine
from nuc980.twin.uboot import Console

QEMU = REPOSITORY / "build/qemu/bin/qemu-system-arm"
UBOOT = REPOSITORY / "build/u-boot/u-boot.bin"

MFP_PF_HIGH = 0xB000009C  # pins PF8 to PF15, four bits each
PF12 = 0xF << 16  # of it: UART0_TXD is 1


class NotSeenError(LabError):
    """Something did not happen as it should."""


def say(text: str = "") -> None:
    print(text, flush=True)


def indented(text: str) -> str:
    return "\n".join(f"    {line}".rstrip() for line in text.strip().splitlines())


def seen(command: str, console: Console) -> str:
    """Runs a command of U-Boot's before the reader's eyes."""
    say(indented(f"=> {command}"))
    answer = console.run(command).removeprefix("\n")
    say(indented(answer))
    return answer


def show_pins(machine: Machine, when: str) -> None:
    say(f"\nThe pins {when} (info nuc980-pins):")
    say(indented(machine.info("nuc980-pins")))


def show_tftp(console: Console, content: bytes) -> None:
    say(f"\n{len(content)} bytes over TFTP, checked with crc32:")
    for command in ("setenv ethaddr 02:00:00:00:00:01", "setenv ipaddr 10.0.0.15; setenv serverip 10.0.0.2"):
        seen(command, console)
    answer = seen("tftpboot 0x7fc0 file", console)
    if f"Bytes transferred = {len(content)} " not in answer:
        raise NotSeenError("the file did not arrive")
    found = re.search(r"==> ([0-9a-f]{8})", seen(f"crc32 0x7fc0 {len(content):#x}", console))
    if not found or int(found[1], 16) != zlib.crc32(content):
        raise NotSeenError(f"the file's CRC32 is {zlib.crc32(content):08x}")
    say(f"    of the file itself: {zlib.crc32(content):08x}")


def show_wrong_pin(console: Console) -> None:
    say("\nPF12 switched from UART0_TXD to GPIO: the board still runs, but nobody hears it.")
    machine = console.machine
    right = machine.read(MFP_PF_HIGH)
    machine.write(MFP_PF_HIGH, right & ~PF12)
    console.line.send(b"setexpr x 6 * 7\r")
    heard = console.line.receive(1.0)
    say(f"    heard on the debug UART: {heard!r}")
    if heard:
        raise NotSeenError("UART0 was heard although it has no pin")
    say(indented(pin_line(machine, "uart0")))
    machine.write(MFP_PF_HIGH, right)
    say("  Switched back:")
    if seen("echo $x", console).strip() != "2a":
        raise NotSeenError("U-Boot did not run the command that it got meanwhile")


def pin_line(machine: Machine, device: str) -> str:
    """What the pin view says of a device."""
    view = machine.info("nuc980-pins")
    return "\n".join(line for line in view.splitlines() if line.split()[:1] == [device])


def show(qemu: Path, uboot: Path, verdict: Verdict) -> None:
    with tempfile.TemporaryDirectory(prefix="twin-") as served:
        content = random.Random(980).randbytes(2_742_200)  # as long as a kernel of the gateway
        (Path(served) / "file").write_bytes(content)
        nics = [part for n in (0, 1) for part in ("-nic", f"user,net=10.0.{n}.0/24,tftp={served}")]
        verdict.expected = "the board at reset"
        with Machine(qemu, registers=True) as machine:
            show_pins(machine, "at reset")
        with Machine(qemu, "-bios", uboot, *nics) as machine, verdict.watched():
            verdict.add_machine(machine)
            say("\nU-Boot on the debug UART, from reset on:")
            verdict.expected = "U-Boot on the debug UART"
            console = Console(machine)
            say(indented(console.banner))
            show_pins(machine, "after U-Boot's set-up")
            verdict.expected = "a file over TFTP, whole"
            show_tftp(console, content)
            verdict.expected = "a pin that is wrong for a while"
            show_wrong_pin(console)


def main() -> int:
    parser = argparse.ArgumentParser(prog="make twin", description=__doc__.splitlines()[0])
    parser.add_argument("--version", action="version", version=f"%(prog)s (OpenRTU) {VERSION}")
    parser.parse_args()
    for program, target in ((QEMU, "qemu"), (UBOOT, "uboot")):
        if not program.exists():
            print(f"twin: {program} does not exist; type: make {target}", file=sys.stderr)
            return 2
    verdict = Verdict("make twin", "twin")
    return run(verdict, lambda: show(QEMU, UBOOT, verdict))


if __name__ == "__main__":
    sys.exit(main())
