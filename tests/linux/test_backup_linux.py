# SPDX-License-Identifier: GPL-3.0-or-later
"""A backup by a Linux out of RAM: it is the flash, byte for byte, and nothing is written meanwhile."""

import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from netboot.flashbench import (
    BLOCK,
    Board,
    at_prompt,
    changed_blocks,
    copy,
    noise,
    options,
    stream,
    switched_on,
    ubi_image,
)
from netboot.ports import free_port
from nuc980.netboot.cli import main
from nuc980.netboot.flash.journal import Journal
from nuc980.netboot.probe import probe
from nuc980.twin.nand import PAGES, NandImage

ROOT = Path(__file__).parents[2]
SYSTEM = ROOT / "build/system"
TREE, UBI = range(56, 64), range(176, 204)  # blocks
PLACES = {blocks: f"{blocks.start * BLOCK:#x}+{len(blocks) * BLOCK:#x}" for blocks in (TREE, UBI)}
BAD, WORN, FILLED = {57, 180, 181}, 178, (*range(56, 60), *range(176, 184), 199, 200)


def table() -> bytes:
    """A table of bad blocks behind its name, as Linux makes it: the version, two bits for each block."""
    bits = bytearray(b"\xff" * 256)
    for block in BAD:
        bits[block // 4] &= ~(3 << 2 * (block % 4))
    return b"\x01" + bits


@pytest.fixture
def board(tmp_path: Path, qemu: Path, uboot: Path) -> Iterator[Board]:
    """Its flash has bad blocks, something in others, and the tables of bad blocks; one block is worn."""
    nand = NandImage.blank(tmp_path / "nand")
    for block in BAD:
        nand.mark_bad(block)
    with switched_on(qemu, uboot, nand) as board, at_prompt(board) as session:
        contents = {block: noise(BLOCK, block) for block in set(FILLED) - BAD}
        found = probe(session.console, session.progress, flash=True).nand
        if found and not found.tables:
            contents |= {1022: b"1tbB" + table(), 1023: b"Bbt0" + table()}
        for block, content in contents.items():
            board.machine.write_memory(0x1000000, content.ljust(BLOCK, b"\xff"))
            at = f"{block * BLOCK:#x} {BLOCK:#x}"
            session.console.run(f"nand erase {at}; nand write 0x1000000 {at}").required()
    nand.flip(WORN * PAGES + 1, range(0, 400, 3))
    with switched_on(qemu, uboot, nand) as board:
        yield board


def test_backup_is_the_flash_also_after_the_first_was_killed(
    board: Board, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The tool dies while Linux sends: nothing is written, nothing is a backup, and the board comes back."""
    kernel, tree = SYSTEM / "uImage", SYSTEM / "nuc980-gateway.dtb"
    if not kernel.exists():
        pytest.fail(f"{kernel} is not there: `make image-debian`", pytrace=False)
    (tmp_path / "root.ubi").write_bytes(ubi_image(tmp_path, "root", 1))
    before = copy(NandImage(tmp_path / "nand"), tmp_path / "before")
    common = [
        *("--backup-by", "linux", "--backup-kernel", str(kernel), "--backup-dtb", str(tree)),
        *options(board, tmp_path / "site", free_port()),
    ]
    new = [
        *("--dtb", str(tree), "--dtb-at", PLACES[TREE]),
        *("--ubi", str(tmp_path / "root.ubi"), "--ubi-at", PLACES[UBI]),
    ]
    with subprocess.Popen(
        [sys.executable, "-m", "nuc980.netboot", "flash", *new, *common],
        env={"PYTHONPATH": str(ROOT / "scripts")},
        stdout=subprocess.PIPE,
        text=True,
    ) as tool:
        assert tool.stdout
        assert any(line.startswith("  ubi: ") for line in tool.stdout)
        tool.send_signal(signal.SIGKILL)
    (folder,) = (tmp_path / "site").glob("flash-*")
    assert not list(Journal(folder).named("backup")) and not list(folder.glob("*.backup"))
    assert changed_blocks(before.path, tmp_path / "nand") == set()

    assert main(["flash", "--resume", *common]) == 0
    output = capsys.readouterr().out
    assert Journal(folder).is_finished
    for name, blocks in (("device-tree.backup", TREE), ("ubi.backup", UBI)):
        assert (folder / name).read_bytes() == stream(before, [block for block in blocks if block not in BAD])
    assert changed_blocks(before.path, tmp_path / "nand") <= {*TREE, *UBI} - BAD
    assert f"The block at {WORN * BLOCK:#x} cannot be read" in output
    assert "Start a Linux that sends" in output
