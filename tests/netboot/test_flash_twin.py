# SPDX-License-Identifier: GPL-3.0-or-later
"""Flashing the emulated board: what is in its flash afterwards, byte for byte, and that it boots from it."""

import ast
import json
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import pytest

from netboot.flashbench import (
    BLOCK,
    Board,
    at_prompt,
    changed_blocks,
    copy,
    device_tree,
    noise,
    options,
    stream,
    switched_on,
    ubi_image,
    uimage,
)
from netboot.ports import free_port
from nuc980.netboot.cli import main
from nuc980.netboot.flash.backup import BySerial, ByTftp, plan_backup
from nuc980.netboot.flash.journal import FILE, Journal, newest_unfinished
from nuc980.netboot.flash.layout import TABLES
from nuc980.netboot.flash.plan import check_board, choose_way
from nuc980.netboot.flash.tables import tables_content
from nuc980.netboot.probe import probe
from nuc980.twin.nand import PAGES, NandImage

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
KERNEL, TREE, ROOT_FS = range(16, 56), range(56, 64), range(176, 208)
LAST = range(1020, 1024)  # for the tables of bad blocks
UBI_AT = ("--ubi-at", "0x1600000+0x400000")  # all of it takes a minute


def bytes_of(blocks: range, bad: set[int], nand: NandImage) -> bytes:
    """What `nand read` finds there."""
    return stream(nand, [block for block in blocks if block not in bad])


@dataclass
class Bench:
    """Images, a flash with something in it, and boards with it."""

    folder: Path
    nand: NandImage
    start: Callable[..., Board]

    @property
    def site(self) -> Path:
        return self.folder / "site"

    @property
    def files(self) -> list[str]:
        names = {"--kernel": "uImage", "--dtb": "dtb", "--ubi": "root.ubi"}
        return [word for option, name in names.items() for word in (option, str(self.folder / name))]

    def flash(self, board: Board, *arguments: str) -> int:
        return main(["flash", *arguments, *options(board, self.site, free_port())])

    def journal(self) -> Journal:
        return Journal(max(self.site.glob("flash-*")))


@pytest.fixture(scope="session")
def images(tmp_path_factory: pytest.TempPathFactory, uboot: Path, payload: Path) -> Path:
    folder = tmp_path_factory.mktemp("images")
    (folder / "uImage").write_bytes(uimage(3_000_001, 1, (payload / "uImage").read_bytes()[64:]))
    (folder / "dtb").write_bytes(device_tree(uboot))
    ubi_image(folder, "root", 1)
    return folder


@pytest.fixture
def bench(tmp_path: Path, images: Path, qemu: Path, uboot: Path) -> Iterator[Bench]:
    for file in images.iterdir():
        if file.is_file():
            (tmp_path / file.name).symlink_to(file)
    with ExitStack() as stack:

        def start(*arguments: str) -> Board:
            return stack.enter_context(switched_on(qemu, uboot, nand, *arguments))

        nand = NandImage.blank(tmp_path / "nand")
        yield Bench(tmp_path, nand, start)


def fill(board: Board, *blocks: int) -> None:
    """Something older in some blocks, with its ECC."""
    with at_prompt(board) as session:
        for block in blocks:
            board.machine.write_memory(0x1000000, noise(4096, block))
            at = block * BLOCK
            session.console.run(
                f"nand erase {at:#x} {BLOCK:#x}; nand write 0x1000000 {at:#x} 0x1000"
            ).required()


def write_tables(board: Board) -> None:
    """Of no bad block; U-Boot uses them from its next start on."""
    with at_prompt(board) as session:
        chip = check_board(probe(session.console, session.progress, flash=True))
        board.machine.write_memory(0x1000000, tables_content(chip))
        at = LAST[0] * BLOCK
        session.console.run(f"nand erase {at:#x} 0x80000; nand write 0x1000000 {at:#x} 0x80000").required()


def boots(board: Board) -> None:
    """By its own boot command, from the flash."""
    with at_prompt(board) as session:
        session.console.start("reset")
        received = b""
        deadline = time.monotonic() + 60
        while b"login: " not in received:
            assert time.monotonic() < deadline, received
            received += session.console.line.read(1.0)


# ---- written


@pytest.mark.parametrize(
    "bad",
    [
        pytest.param(set(), id="no bad block"),
        pytest.param({17}, id="one", marks=pytest.mark.soak),
        pytest.param({16, 20, 38, 55, 56, 60, 176, 180, 181}, id="several"),
    ],
)
def test_flash_holds_the_images_and_boots(bench: Bench, bad: set[int]) -> None:
    for block in bad:
        bench.nand.mark_bad(block)
    board = bench.start()
    fill(board, 4, 8, 16 if 16 not in bad else 18, 57, 64, 177, 200, 208)
    before = copy(bench.nand, bench.folder / "before")

    assert bench.flash(board, *bench.files, *UBI_AT) == 0

    assert changed_blocks(before.path, bench.nand.path) <= {*KERNEL, *TREE, *ROOT_FS, *LAST} - bad
    for slot, name in ((KERNEL, "uImage"), (TREE, "dtb"), (ROOT_FS, "root.ubi")):
        image = (bench.folder / name).read_bytes()
        found = bytes_of(slot, bad, bench.nand)
        assert found == image.ljust(len(found), b"\xff")
    journal = bench.journal()
    assert journal.is_finished
    for entry in journal.named("backup"):
        slot = {"kernel": KERNEL, "device tree": TREE, "UBI": ROOT_FS, TABLES: LAST}[entry["image"]]
        assert (journal.folder / entry["file"]).read_bytes() == bytes_of(slot, bad, before)
    boots(board)
    board.cut()
    with at_prompt(bench.start()) as session:
        nand = probe(session.console, session.progress, flash=True).nand
    assert nand and nand.keeps_table  # U-Boot has found the tables
    assert {offset // BLOCK for offset in nand.bad} == bad | {*LAST}


def test_last_blocks_are_kept_and_come_back(bench: Bench) -> None:
    """The factory's partition reaches to the chip's end."""
    board = bench.start()
    fill(board, 180, *LAST)
    before = copy(bench.nand, bench.folder / "before")
    assert bench.flash(board, *bench.files[4:], *UBI_AT) == 0
    kept = (bench.journal().folder / "bad-block-tables.backup").read_bytes()
    assert kept == bytes_of(LAST, set(), before)
    assert bench.flash(board, "--roll-back", str(bench.journal().folder)) == 0
    assert changed_blocks(before.path, bench.nand.path) == set()


def test_tables_that_are_there_stay(bench: Bench) -> None:
    """Also when U-Boot does not use them, as the vendor's."""
    board = bench.start()
    write_tables(board)
    assert bench.flash(board, *bench.files[4:], *UBI_AT, "--no-backup", "empty") == 0
    assert not [entry for entry in bench.journal().header["images"] if entry["image"] == TABLES]


def test_root_file_system_can_be_attached(bench: Bench) -> None:
    """Pages that UBIFS finds erased have to be so in their spare bytes too."""
    board = bench.start()
    assert bench.flash(board, *bench.files[4:], *UBI_AT, "--no-backup", "empty") == 0
    with at_prompt(board) as session:
        output = session.console.run("ubi part rootfs; ubi info l", 60).required()
    assert "attached mtd" in output
    assert re.search(r"Volume name +root|name +root", output)


def test_typed_is_what_the_dry_run_shows(bench: Bench, capsys: pytest.CaptureFixture[str]) -> None:
    board = bench.start()
    log, report = bench.folder / "log", bench.folder / "report"
    kernel = ["flash", "--kernel", str(bench.folder / "uImage"), *options(board, bench.site, free_port())]
    assert main(["probe", "--json", str(report), "--port", board.port]) == 0
    capsys.readouterr()
    bench.site.mkdir()
    (bench.site / "macs").write_text("eth0 02:00:00:00:00:01\neth1 02:00:00:00:00:02\n")
    assert main([*kernel, "--dry-run", "--all-lines", "--as", str(report)]) == 0
    shown = re.findall(r"^    => if (.*); then echo @\d+:", capsys.readouterr().out, re.MULTILINE)
    assert any("nand erase" in line for line in shown)
    assert not list(bench.site.glob("flash-*"))

    assert main([*kernel, "--log", str(log)]) == 0
    lines = re.findall(r"^ *[\d.]+ > (.*)$", log.read_text(), re.MULTILINE)
    sent = [ast.literal_eval(text) for text in lines]
    typed = re.findall(r"if ([^\r\x03]*); then echo @[^\r\x03]*\r", "".join(sent))
    assert typed == shown


# ---- blocks that fail


@pytest.mark.parametrize(
    "worn",
    [
        pytest.param((20,), id="in the kernel", marks=pytest.mark.soak),
        pytest.param((16, 17, 40), id="three"),
        pytest.param((56,), id="device tree"),
    ],
)
def test_worn_blocks_are_marked_and_left_out(bench: Bench, worn: tuple[int, ...]) -> None:
    board = bench.start()
    write_tables(board)
    board.cut()
    board = bench.start("-global", f"nand.worn-blocks={','.join(map(str, worn))}")
    files = bench.files[:4]
    assert bench.flash(board, *files) == 0
    for slot, name in ((KERNEL, "uImage"), (TREE, "dtb")):
        image = (bench.folder / name).read_bytes()
        assert bytes_of(slot, set(worn), bench.nand)[: len(image)] == image
    journal = bench.journal()
    assert sorted(entry["offset"] // BLOCK for entry in journal.named("bad")) == sorted(worn)
    with at_prompt(board) as session:
        nand = probe(session.console, session.progress, flash=True).nand
    assert nand
    assert {offset // BLOCK for offset in nand.bad} >= set(worn)
    boots(board)


def test_without_room_for_the_rest_it_stops_and_can_be_rolled_back(bench: Bench) -> None:
    (bench.folder / "large").write_bytes(uimage(0x500000, 2))
    board = bench.start()
    fill(board, *KERNEL)
    old = bytes_of(KERNEL, set(), bench.nand)
    board.cut()
    board = bench.start("-global", "nand.worn-blocks=50")
    assert bench.flash(board, "--kernel", str(bench.folder / "large")) == 1
    assert not bench.journal().is_finished
    assert bench.flash(board, "--kernel", str(bench.folder / "uImage")) == 2
    # the old one has as many blocks as the slot: it does not fit either, and that is said
    assert bench.flash(board, "--roll-back") == 2
    assert old != bytes_of(KERNEL, {50}, bench.nand)


# ---- backups


def test_backup_over_the_serial_line_is_the_same(bench: Bench) -> None:
    bench.nand.mark_bad(57)
    board = bench.start()
    fill(board, 56, 59)
    assert bench.flash(board, "--dtb", str(bench.folder / "dtb"), "--backup-by", "serial", "--dry-run") == 0
    with at_prompt(board) as session:
        report = probe(session.console, session.progress, flash=True)
        nand = check_board(report, BySerial.needs)
        assert isinstance(choose_way(report, None, nand), ByTftp)
        blocks = [block * BLOCK for block in TREE if block != 57]
        target = bench.folder / "tree.backup"
        for step in plan_backup("tree", blocks, BLOCK, 0x1000000, 4 * BLOCK, target, BySerial(BLOCK)):
            step.run(session)
    assert target.read_bytes() == bytes_of(TREE, {57}, bench.nand)


def test_block_that_cannot_be_read_is_kept_as_it_came(bench: Bench) -> None:
    board = bench.start()
    fill(board, 56, 57, 58)
    board.cut()
    bench.nand.flip(57 * PAGES + 1, range(0, 400, 3))
    board = bench.start()
    assert bench.flash(board, "--dtb", str(bench.folder / "dtb")) == 0
    backup = (bench.journal().folder / "device-tree.backup").read_bytes()
    old = noise(4096, 58)
    assert backup[2 * BLOCK : 2 * BLOCK + 4096] == old
    image = (bench.folder / "dtb").read_bytes()
    assert bytes_of(TREE, set(), bench.nand)[: len(image)] == image


def test_without_a_backup_the_reason_is_kept(bench: Bench) -> None:
    board = bench.start()
    assert bench.flash(board, "--dtb", str(bench.folder / "dtb"), "--no-backup", "the board is new") == 0
    journal = bench.journal()
    assert journal.header["no_backup"] == "the board is new"
    assert not list(journal.named("backup"))
    assert bench.flash(board, "--roll-back", str(journal.folder)) == 2


# ---- refused before anything is erased


def test_what_does_not_fit_is_refused(bench: Bench, capsys: pytest.CaptureFixture[str]) -> None:
    (bench.folder / "large").write_bytes(uimage(0x500000 - BLOCK + 1, 1))
    bench.nand.mark_bad(30)
    board = bench.start()
    with at_prompt(board) as session:
        probe(session.console, session.progress, flash=True)
    before = copy(bench.nand, bench.folder / "before")
    assert bench.flash(board, "--kernel", str(bench.folder / "large")) == 2
    assert "1 bad blocks" in capsys.readouterr().err
    assert bench.flash(board, "--bootloader", str(bench.folder / "large")) == 2
    assert (
        bench.flash(board, "--kernel", str(bench.folder / "uImage"), "--kernel-at", "0x80000+0x500000") == 2
    )
    assert bench.flash(board, "--kernel", str(bench.folder / "dtb")) == 2
    assert changed_blocks(before.path, bench.nand.path) == set()
    assert not list(bench.site.glob("flash-*"))


def test_board_without_a_flash_is_refused(
    bench: Bench, qemu: Path, uboot: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with switched_on(qemu, uboot, None) as board:
        assert bench.flash(board, "--kernel", str(bench.folder / "uImage")) == 2
    assert "no NAND" in capsys.readouterr().err


def test_boot_loader_is_written_for_who_knows(bench: Bench, uboot: Path) -> None:
    board = bench.start()
    fill(board, 8, 12)
    before = copy(bench.nand, bench.folder / "before")
    assert bench.flash(board, "--bootloader", str(uboot), "--i-know") == 0
    assert changed_blocks(before.path, bench.nand.path) <= set(range(8, 12))
    assert bytes_of(range(8, 12), set(), bench.nand)[: uboot.stat().st_size] == uboot.read_bytes()
    assert bench.flash(board, "--roll-back", str(bench.journal().folder)) == 0
    assert changed_blocks(before.path, bench.nand.path) == set()


# ---- interrupted on the host


@pytest.mark.parametrize(
    "word",
    [
        pytest.param("Back up", marks=pytest.mark.soak),
        "Load kernel",
        "erase and write",
        pytest.param("read back", marks=pytest.mark.soak),
    ],
)
def test_tool_that_is_killed_is_resumed(bench: Bench, word: str) -> None:
    board = bench.start()
    fill(board, 17, 56)
    old = bytes_of(KERNEL, set(), bench.nand)
    command = [
        sys.executable,
        "-m",
        "nuc980.netboot",
        "flash",
        *bench.files[:4],
        *options(board, bench.site, free_port()),
    ]
    with subprocess.Popen(
        command, env={"PYTHONPATH": str(ROOT / "scripts")}, stdout=subprocess.PIPE, text=True
    ) as tool:
        assert tool.stdout
        for line in tool.stdout:
            if word in line:
                break
        tool.send_signal(signal.SIGKILL)
    journal = newest_unfinished(bench.site)
    assert journal
    assert (journal.folder / FILE).read_bytes().startswith(b"{")
    assert bench.flash(board, "--resume") == 0
    image = (bench.folder / "uImage").read_bytes()
    assert bytes_of(KERNEL, set(), bench.nand)[: len(image)] == image
    assert bench.flash(board, "--roll-back", str(journal.folder)) == 0
    assert bytes_of(KERNEL, set(), bench.nand) == old


def test_what_was_begun_is_written_again_even_if_it_reads_right(bench: Bench) -> None:
    """A page whose programming was cut short can read right today, and wrong tomorrow."""
    board = bench.start()
    assert bench.flash(board, "--dtb", str(bench.folder / "dtb"), "--no-backup", "empty") == 0
    folder = bench.journal().folder

    def erases() -> int:
        return sum(entry["event"] == "begin" and "erases" in entry for entry in Journal(folder).events)

    before = erases()
    assert bench.flash(board, "--resume", str(folder)) == 0
    assert erases() == before
    Journal(folder).add("begin", image="device tree", offset=0x700000, erases=True)
    assert bench.flash(board, "--resume", str(folder)) == 0
    assert erases() == 2 * before + 1


def test_resumed_only_with_the_files_and_the_board_it_began_with(
    bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    board = bench.start()
    (bench.folder / "mine").write_bytes(uimage(300_000, 3))
    assert bench.flash(board, "--kernel", str(bench.folder / "mine")) == 0
    folder = str(bench.journal().folder)
    (bench.folder / "mine").write_bytes(uimage(300_000, 4))
    assert bench.flash(board, "--resume", folder) == 2
    assert "is not the file" in capsys.readouterr().err
    board.cut()
    lines = (bench.journal().folder / FILE).read_text().splitlines()
    header = json.loads(lines[0])
    header["nand"]["bad"] = [0x300000]
    (bench.journal().folder / FILE).write_text("\n".join([json.dumps(header), *lines[1:]]) + "\n")
    assert bench.flash(bench.start(), "--roll-back", folder) == 2
    assert "another board" in capsys.readouterr().err
