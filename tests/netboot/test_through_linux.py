# SPDX-License-Identifier: GPL-3.0-or-later
"""What a Linux out of RAM is started with for a backup, and what of it counts as one."""

import re
import subprocess
import zlib
from ipaddress import IPv4Address, IPv4Interface
from pathlib import Path

import libfdt
import pytest

from netboot.double import BLOCK, Double
from netboot.flashbench import (
    noise,
    ubi_image,
)
from nuc980.netboot.board import Nand
from nuc980.netboot.cli import main
from nuc980.netboot.console import Console
from nuc980.netboot.errors import BackupFailed, FlashNotPossible, UnusableImage
from nuc980.netboot.flash import through_linux
from nuc980.netboot.flash.through_linux import Findings, FindTables, Place, runs, tree_of
from nuc980.netboot.progress import Progress
from nuc980.netboot.session import Network, Session
from nuc980.netboot.transport import Line

NAND = Nand(0x8000000, BLOCK, 2048, ())
NETWORK = Network(IPv4Interface("192.168.1.20/24"), IPv4Address("192.168.1.1"), 6969)
MACS = ("02:00:00:00:00:01", "02:00:00:00:00:02")
UBI, BAD = range(176, 204), {180, 181}  # blocks


# ---- what Linux is started with


@pytest.fixture
def place(tmp_path: Path) -> Place:
    offsets = tuple(block * BLOCK for block in UBI if block not in BAD)
    return Place("UBI", offsets, BLOCK, tmp_path / "ubi.backup")


@pytest.fixture
def tree(dtb: Path, place: Place) -> libfdt.Fdt:
    """The board's, with arguments as an image has them whose root is in the flash."""
    own = libfdt.Fdt(bytearray(dtb.read_bytes()))
    own.resize(own.totalsize() + 4096)
    words = "console=ttyS0,115200 ubi.mtd=rootfs root=ubi0:root rootfstype=ubifs init=/sbin/init mem=64M"
    own.setprop_str(own.path_offset("/chosen"), "bootargs", words)
    return libfdt.Fdt(bytearray(tree_of(own, NAND, NETWORK, MACS, [place])))


def test_its_flash_cannot_be_written(tree: libfdt.Fdt) -> None:
    """One partition, all of the chip, read-only; nothing wants tables of bad blocks, or UBI."""
    flash = through_linux._flash_node(tree)
    partitions = tree.subnode_offset(flash, "partitions")
    only = tree.first_subnode(partitions)
    assert tree.next_subnode(only, libfdt.QUIET_NOTFOUND) < 0
    assert tree.hasprop(only, "read-only")
    assert tree.getprop(only, "reg") == bytes(4) + (0x8000000).to_bytes(4)
    assert not tree.hasprop(flash, "nand-on-flash-bbt")
    assert tree.getprop(flash, "nand-ecc-strength").as_uint32() == 8
    arguments = tree.getprop(tree.path_offset("/chosen"), "bootargs").as_str()
    assert arguments.startswith("console=ttyS0,115200 mem=64M ethaddr0=02:00:00:00:00:01 ")
    assert not re.search(r"ubi|root=|init=/sbin", arguments)
    assert " rdinit=/bin/sh -- -c " in arguments


def test_its_script_is_one(tree: libfdt.Fdt) -> None:
    script = bytes(tree.getprop(tree.path_offset("/chosen"), through_linux.SCRIPT))
    done = subprocess.run(["sh", "-n"], input=script, capture_output=True)
    assert (done.returncode, done.stderr) == (0, b"")
    assert b"send ubi 176+4 182+22\n" in script
    assert script.endswith(b"over\n")


def test_tree_without_a_flash_is_none() -> None:
    tree = libfdt.Fdt.create_empty_tree(256)
    with pytest.raises(UnusableImage):
        tree_of(tree, NAND, NETWORK, MACS, [])


def test_runs_of_blocks() -> None:
    assert runs([block * BLOCK for block in (0, 1, 2, 5, 7, 8)], BLOCK) == ["0+3", "5+1", "7+2"]
    assert runs([], BLOCK) == []


# ---- what counts as a backup


def test_other_bytes_than_uboots_are_no_backup(place: Place) -> None:
    content = noise(place.size, 1)
    rest = len(place.blocks) - 4
    sums = {
        ("UBI", 0): (3, zlib.crc32(content[: 3 * BLOCK])),
        ("UBI", 4): (rest, zlib.crc32(content[4 * BLOCK :])),
        ("kernel", 0): (1, 1),
    }
    found = Findings(sums | {("UBI", 0): (3, 0)}, {("UBI", 3): b"w" * BLOCK})
    with pytest.raises(BackupFailed, match=r"3 blocks from 0x1600000 on \(UBI\)"):
        found.apply(place, bytearray(content))
    with pytest.raises(BackupFailed, match="bytes of the UBI's"):
        found.apply(place, bytearray(content[:-1]))
    found.sums = {("UBI", 0): sums["UBI", 0]}
    with pytest.raises(BackupFailed, match="did not sum up all"):
        found.apply(place, bytearray(content))
    found.sums = sums
    whole = bytearray(content)
    found.apply(place, whole)
    assert whole[3 * BLOCK : 4 * BLOCK] == b"w" * BLOCK
    assert whole[: 3 * BLOCK] == content[: 3 * BLOCK] and whole[4 * BLOCK :] == content[4 * BLOCK :]


@pytest.mark.slow
@pytest.mark.parametrize("marks", [(), (b"Bbt0",), (b"Bbt0", b"1tbB")])
def test_without_tables_of_bad_blocks_no_linux_is_started(marks: tuple[bytes, ...]) -> None:
    step = FindTables(NAND, 0x100000)
    with Double("factory") as double, Line(double.port) as line:
        for block, mark in enumerate(marks, 1021):
            double.nand.load(block * BLOCK, mark)
        console = Console(line)
        console.reach()
        session = Session(console, Progress())
        if len(marks) == 2:
            step.run(session)
        else:
            with pytest.raises(FlashNotPossible, match="no tables of bad blocks"):
                step.run(session)
        assert double.nand.journal == []


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--backup-by", "linux"), "needs a kernel and a device tree"),
        (("--backup-kernel", "uImage"), "are for --backup-by linux"),
    ],
)
def test_options_belong_together(
    words: tuple[str, ...], message: str, images: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["flash", "--dtb", images[1], "--dry-run", *words]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.slow
def test_it_is_offered_where_the_line_takes_hours(
    images: list[str], dtb: Path, tmp_path: Path, site: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """And takes a fraction of them; what is set is set again after the board's restart."""
    (tmp_path / "ubi").write_bytes(ubi_image(tmp_path, "root", 1))
    linux = ("--backup-by", "linux", "--backup-kernel", images[0], "--backup-dtb", str(dtb))

    def dry(*words: str) -> str:
        network = ("--board-ip", "192.168.1.20/24", "--server-ip", "192.168.1.1", "--site", str(site))
        assert main(["flash", "--dry-run", "--all-lines", *words, *network]) == 0
        return capsys.readouterr().out

    ubi = ("--ubi", str(tmp_path / "ubi"))
    assert "backs it up in minutes: --backup-by linux" in dry(*ubi)
    for words in (("--backup-by", "serial"), ("--no-backup", "new"), linux):
        assert "backs it up in minutes" not in dry(*ubi, *words)
    output = dry(*ubi, *linux)
    assert re.search(r"^It takes .*back up \d+ min", output, re.MULTILINE)
    typed = re.findall(r"^    => if (.*?); then", output, re.MULTILINE)
    assert sum("md.l" in line for line in typed) == 4  # the marks of tables
    started = typed.index("bootm 0x7fc0 - 0xa00000")
    settings = [line for line in typed[:started] if line.startswith("setenv")]
    assert typed[started + 1] == "version"
    assert typed[started + 2 :][: len(settings)] == settings
    assert not any("erase" in line for line in typed[:started])
