# SPDX-License-Identifier: GPL-3.0-or-later
"""Power cuts while the flash is written: U-Boot starts, nothing else has changed, the way goes on or back.

A cut is a reset of the machine, or QEMU killed and started again on the same flash. What QEMU does with one
page or one block is whole or not at all, so a page of the block in work is torn by hand.
"""

import random
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
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
from nuc980.netboot.board import Nand
from nuc980.netboot.cli import main
from nuc980.netboot.flash.journal import Journal, newest_unfinished
from nuc980.netboot.flash.tables import tables_content, tables_slot
from nuc980.twin.nand import DATA, PAGE, PAGES, NandImage

pytestmark = pytest.mark.slow

SLOTS = {"uImage": range(16, 20), "dtb": range(56, 58), "root.ubi": range(176, 180)}
BAD = {17, 178}
PLACES = ["--kernel-at", "0x200000+0x80000", "--dtb-at", "0x700000+0x40000", "--ubi-at", "0x1600000+0x80000"]
WRITTEN = {block for blocks in SLOTS.values() for block in blocks} - BAD
CHIP = Nand(1024 * BLOCK, BLOCK, DATA, tuple(block * BLOCK for block in BAD))
SEED = 980
STEPS = 40  # of the journal
ERASES = 17  # from here on the flash may change; before, variables are set and backups made


@dataclass(frozen=True)
class Cut:
    """When, and how: at the n-th step of the journal or so many seconds after the first, reset or off."""

    step: int = 0
    seconds: float = 0.0
    off: bool = False
    back: bool = False  # what follows: roll back or resume
    seed: int = 0


@dataclass
class Cutter:
    """Cuts the power of a board while a tool works with it."""

    board: Board
    cut: Cut
    begun: int = 0
    timer: threading.Timer | None = field(default=None)

    def at_event(self, event: str) -> None:
        self.begun += event == "begin"
        if self.timer is None and self.begun >= self.cut.step:
            self.timer = threading.Timer(self.cut.seconds, self._strike)
            self.timer.start()

    def _strike(self) -> None:
        if self.cut.off:
            self.board.cut()
        else:
            self.board.machine.command("system_reset")

    def wait(self) -> None:
        if self.timer:
            self.timer.join()


@dataclass
class Bench:
    folder: Path
    nand: NandImage
    before: NandImage
    power: Callable[[], Board]
    board: Board | None = None

    def tool(self, *arguments: str) -> int:
        assert self.board
        return main(["flash", *arguments, *options(self.board, self.folder / "site", free_port())])

    def begin(self) -> int:
        files = [f"--{option}={self.folder / name}" for option, name in
                 (("kernel", "uImage"), ("dtb", "dtb"), ("ubi", "root.ubi"))]  # fmt: skip
        return self.tool(*files, *PLACES)

    def content(self, name: str, nand: NandImage) -> bytes:
        return stream(nand, [block for block in SLOTS[name] if block not in BAD])


@pytest.fixture(scope="module")
def flashed(tmp_path_factory: pytest.TempPathFactory, qemu: Path, uboot: Path) -> Path:
    """A flash with something in and around the slots, bad blocks and their tables; and what to write."""
    folder = tmp_path_factory.mktemp("flashed")
    nand = NandImage.blank(folder / "nand")
    for block in BAD:
        nand.mark_bad(block)
    with switched_on(qemu, uboot, nand) as board, at_prompt(board) as session:
        run = session.console.run
        run("setenv kept yes; saveenv", 30).required()
        board.machine.write_memory(0x1000000, tables_content(CHIP))
        run(f"nand write 0x1000000 {tables_slot(CHIP).offset:#x} {4 * BLOCK:#x}", 30).required()
        for block in (0, 1, 8, 9, 16, 18, 20, 55, 56, 57, 58, 64, 175, 176, 177, 179, 180, 1000):
            at = block * BLOCK
            board.machine.write_memory(0x1000000, noise(BLOCK, block))
            run(f"nand erase {at:#x} {BLOCK:#x}; nand write 0x1000000 {at:#x} {BLOCK:#x}", 30).required()
    (folder / "uImage").write_bytes(uimage(2 * BLOCK + 77, 1))
    (folder / "dtb").write_bytes(device_tree(uboot))
    (folder / "root.ubi").write_bytes(ubi_image(folder, "whole", 1)[: 2 * BLOCK])
    return folder


@pytest.fixture
def bench(tmp_path: Path, flashed: Path, qemu: Path, uboot: Path) -> Iterator[Bench]:
    for name in SLOTS:
        (tmp_path / name).symlink_to(flashed / name)
    with ExitStack() as stack:
        nand = copy(NandImage(flashed / "nand"), tmp_path / "nand")

        def power() -> Board:
            return stack.enter_context(switched_on(qemu, uboot, nand))

        yield Bench(tmp_path, nand, NandImage(flashed / "nand"), power)
    (tmp_path / "nand").unlink()


def tear(bench: Bench, journal: Journal | None, seed: int) -> None:
    """Turns half of the bits of a page over, in the block that was in work."""
    last = journal.events[-1] if journal else {}
    if last.get("event") == "begin" and last.get("erases"):
        chance = random.Random(seed)
        page = last["offset"] // DATA + chance.randrange(PAGES)
        bits = [*range(8 * DATA), *range(8 * (DATA + 4), 8 * PAGE)]
        bench.nand.flip(page, chance.sample(bits, len(bits) // 2))


def check_only_the_slots_changed(bench: Bench) -> None:
    """Spare bytes included, and the tables of bad blocks."""
    assert changed_blocks(bench.before.path, bench.nand.path) <= WRITTEN


def check_prompt(bench: Bench) -> None:
    with at_prompt(bench.board) as session:
        assert session.console.run("echo $kept").output.strip() == "yes"


def cut_and_go_on(bench: Bench, cut: Cut, monkeypatch: pytest.MonkeyPatch) -> str:
    """One case; returns what the tool said last."""
    interrupt(bench, cut, bench.begin, monkeypatch)
    journal = newest_unfinished(bench.folder / "site")
    if journal is None:  # all was done before
        assert Journal(next((bench.folder / "site").glob("flash-*"))).is_finished
        end_as(bench, None)
        return "done"
    if cut.back:
        assert bench.tool("--roll-back") == 0
        end_as(bench, bench.before)
        return "old"
    if cut.seed % 5 == 0:
        interrupt(bench, cut, lambda: bench.tool("--resume"), monkeypatch)
    if newest_unfinished(bench.folder / "site"):
        assert bench.tool("--resume") == 0
    end_as(bench, None)
    return "new"


def interrupt(bench: Bench, cut: Cut, work: Callable[[], int], monkeypatch: pytest.MonkeyPatch) -> None:
    bench.board = bench.board or bench.power()
    cutter = Cutter(bench.board, cut)
    add = Journal.add

    def counted(journal: Journal, event: str, **facts: object) -> None:
        add(journal, event, **facts)
        cutter.at_event(event)

    with monkeypatch.context() as patch:
        patch.setattr(Journal, "add", counted)
        code = work()
    cutter.wait()
    site = bench.folder / "site"
    assert code == 0 or newest_unfinished(site), "it ended without a journal to go on from"
    if cut.off and cutter.timer:
        tear(bench, newest_unfinished(site), cut.seed)
        bench.board = bench.power()
    check_prompt(bench)
    check_only_the_slots_changed(bench)


def end_as(bench: Bench, old: NandImage | None) -> None:
    check_only_the_slots_changed(bench)
    for name in SLOTS:
        found = bench.content(name, bench.nand)
        if old:
            assert found == bench.content(name, old)
        else:
            assert found == (bench.folder / name).read_bytes().ljust(len(found), b"\xff")


def test_uncut(bench: Bench) -> None:
    bench.board = bench.power()
    assert bench.begin() == 0
    end_as(bench, None)
    journal = Journal(next((bench.folder / "site").glob("flash-*")))
    assert len(list(journal.named("begin"))) == STEPS


def often(first: int, last: int, seldom: int) -> list[object]:
    """The first ones always, the others in the soak."""
    return [pytest.param(n, marks=[pytest.mark.soak] if n >= seldom else []) for n in range(first, last)]


@pytest.mark.parametrize("step", [*often(1, ERASES, 1), *often(ERASES, STEPS + 1, STEPS + 1)])
def test_cut_at_every_step(bench: Bench, monkeypatch: pytest.MonkeyPatch, step: int) -> None:
    chance = random.Random(step)
    cut = Cut(step, chance.uniform(0, 0.02), bool(step % 2), bool(step // 2 % 2), step)
    cut_and_go_on(bench, cut, monkeypatch)


@pytest.mark.parametrize("number", often(0, 100, 2))
def test_cut_at_any_moment(bench: Bench, monkeypatch: pytest.MonkeyPatch, number: int) -> None:
    chance = random.Random(SEED * 1000 + number)
    cut = Cut(1, chance.uniform(0, 1.5), chance.random() < 0.5, chance.random() < 0.5, number)
    cut_and_go_on(bench, cut, monkeypatch)
