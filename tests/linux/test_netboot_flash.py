# SPDX-License-Identifier: GPL-3.0-or-later
"""A board that is started over the network keeps its flash, byte for byte, spare bytes included."""

import hashlib
from pathlib import Path

from lab.board import ETHERNET, netboot
from netboot.flashbench import noise, ubi_image
from nuc980.netboot.progress import Progress
from nuc980.twin.machine import Machine
from nuc980.twin.nand import BLOCKS, DATA, PAGES, NandImage
from nuc980.twin.uboot import Console

SYSTEM = Path(__file__).resolve().parents[2] / "build/system"
ROOT_AT, LAST = 0x1600000, 8  # blocks at the chip's end
IN_RAM = 0x1000000


def factorys(qemu: Path, uboot: Path, folder: Path) -> NandImage:
    """A flash without tables of bad blocks: a UBI that would grow when attached, and data to the end.

    A U-Boot that makes tables has made them by then: the data takes their place.
    """
    nand = NandImage.blank(folder / "nand")
    nand.mark_bad(1000)
    drive = ("-drive", f"if=mtd,format=raw,file={nand.path}")
    with Machine(qemu, "-bios", uboot, *drive, options="pace=off") as machine:
        console = Console(machine)
        content = ubi_image(folder, "factory", 1)
        machine.write_memory(IN_RAM, content)
        assert "OK" in console.run(f"nand write {IN_RAM:#x} {ROOT_AT:#x} {len(content):#x}")
    for block in range(BLOCKS - LAST, BLOCKS):
        nand.write(block * PAGES, noise(DATA, block))
    return nand


def test_netboot_does_not_write(qemu: Path, uboot: Path, tmp_path: Path) -> None:
    nand = factorys(qemu, uboot, tmp_path)
    before = hashlib.sha256(nand.path.read_bytes()).hexdigest()
    console = tmp_path / "console.log"
    nics = [word for network in ETHERNET for word in network.arguments({})]
    with Machine(
        *(qemu, "-bios", uboot, *nics, "-drive", f"if=mtd,format=raw,file={nand.path}"),
        uarts=(),
        chardevs={0: f"pty,logfile={console}"},
    ) as machine:
        netboot(machine, tmp_path, SYSTEM / "uImage", SYSTEM / "nuc980-gateway.dtb", Progress())
    assert "login: " in console.read_text(errors="replace")
    assert hashlib.sha256(nand.path.read_bytes()).hexdigest() == before
