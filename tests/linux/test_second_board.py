# SPDX-License-Identifier: GPL-3.0-or-later
"""A second board on the emulated chip: Linux finds what its device tree has and nothing more; its image."""

import subprocess
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from lab.board import ETHERNET, netboot
from nuc980.netboot.progress import Progress
from nuc980.twin.linux import TROUBLE, Kernel, Linux
from nuc980.twin.machine import Machine
from nuc980.twin.nand import NandImage

ROOT = Path(__file__).parents[2]
SOURCE = ROOT / "dts/nuvoton/nuc980-numaker.dts"
BUILT = ROOT / "build/boards/numaker"
SYSTEM, UBOOT = BUILT / "system", BUILT / "u-boot/u-boot.bin"
MODEL = "NuMaker NUC980 DEV V1.0 (OpenRTU)"


@pytest.fixture(scope="module")
def kernel(kernel: Kernel, tmp_path_factory: pytest.TempPathFactory) -> Kernel:
    dtb = tmp_path_factory.mktemp("dtb") / "numaker.dtb"
    subprocess.run([ROOT / "scripts/build-dtb.sh", SOURCE, dtb], check=True)
    return replace(kernel, dtb=dtb).without_services()


@pytest.fixture(scope="module")
def linux(qemu: Path, kernel: Kernel, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Linux]:
    nand = NandImage.blank(tmp_path_factory.mktemp("nand") / "nand")
    drive = f"if=mtd,format=raw,file={nand.path}"
    board = Linux.boot(qemu, kernel, "-drive", drive, "-nic", "user", options="board=numaker")
    yield board
    board.close()


def test_linux_runs_on_the_board_of_the_tree(linux: Linux) -> None:
    assert linux.run("cat /proc/device-tree/model").rstrip("\0") == MODEL
    assert linux.troubles == []


def test_it_has_its_devices_and_no_other_boards(linux: Linux) -> None:
    assert linux.run("ls /sys/class/net").split() == ["eth0", "lo"]
    names = linux.run("cat /sys/class/mtd/mtd?/name").split()
    assert names == ["u-boot", "kernel", "rootfs"]


def test_every_device_has_its_pins_on_this_board(linux: Linux) -> None:
    _, _, devices = linux.machine.info("nuc980-pins").replace("\r", "").partition("\n\n")
    rows = {row.split()[0]: row for row in devices.splitlines()[1:] if row.strip()}
    assert "connected" in rows["uart0"]
    assert "connected" in rows["emac0"]
    assert "connected" in rows["fmi"]
    assert "emac1" not in rows
    assert "uart1" not in rows


def test_its_image_comes_onto_it_over_the_network(qemu: Path, tmp_path: Path) -> None:
    """By a U-Boot of its own, which knows of the one Ethernet port that the board has."""
    for file in (SYSTEM / "uImage", UBOOT):
        if not file.exists():
            pytest.fail(f"{file} is not there: `make image-debian uboot BOARD=numaker`", pytrace=False)
    console = tmp_path / "console.log"
    arguments = (qemu, "-bios", UBOOT, *ETHERNET[0].arguments({}))
    chardevs = {0: f"pty,logfile={console}"}
    with Machine(*arguments, uarts=(), chardevs=chardevs, options="board=numaker") as machine:
        netboot(machine, tmp_path, SYSTEM / "uImage", SYSTEM / "nuc980-numaker.dtb", Progress())
    said = console.read_text(errors="replace")
    assert "eth0 : emac0" in said
    assert "emac1" not in said
    assert f"Machine model: {MODEL}" in said
    assert "emac0 eth0: Link is Up" in said
    assert "can't find device" not in said
    assert TROUBLE.findall(said) == []
