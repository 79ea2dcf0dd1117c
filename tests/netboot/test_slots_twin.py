# SPDX-License-Identifier: GPL-3.0-or-later
"""A board with two slots on the twin, with our U-Boot: what boots after each thing that can happen to them.

Kernels are the payload, which says what it was started with; a tree tells it how to end. Pages are put into
the flash as U-Boot has once written them, so with their ECC, whole or torn.
"""

import random
import re
import shutil
import struct
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path

import libfdt
import pytest

from netboot.flashbench import (
    BLOCK,
    at_prompt,
    changed_blocks,
    copy,
    options,
    stopped,
    switched_on,
    uimage,
)
from netboot.ports import free_port
from nuc980.netboot.cli import main
from nuc980.netboot.environment import read_environment
from nuc980.netboot.flash.journal import Journal, newest_unfinished
from nuc980.netboot.limits import PAGE as DATA
from nuc980.netboot.plan import SetVariable
from nuc980.netboot.probe import probe_nand
from nuc980.netboot.slots.command import wrapped
from nuc980.netboot.slots.layout import BASE, PLACES, TRIAL
from nuc980.netboot.slots.marks import (
    BASE_WORD,
    TRIAL_WORD,
    USED_WORD,
    Marks,
    page,
    plan_base,
    read_marks,
)
from nuc980.twin.machine import INSTRUCTION_TIME, Machine, MachineError
from nuc980.twin.nand import PAGE, PAGES, NandImage

pytestmark = pytest.mark.slow

STARTED = re.compile(rb"Kernel command line: [^\n]*openrtu\.slot=(\w)( openrtu\.trial)?")
# What the boot command does in less time: the watchdog's 2^16 ticks, 2.8 s, and as much as the payload needs.
QUICKER = (("rtu_watch", "0x882", "0x682"), ("rtu_boot", "0x880000", "0x80000"))
ERASED = b"\xff" * PAGE
SEED = 980
PATIENCE = 180.0  # s, with a host that has much else to do
# Where the palette keeps pages, in the partition for UBI: a block each.
PALETTE = 0x2000000 // DATA


def often(always: Iterable[object], values: Iterable[object]) -> list[object]:
    """Some always, the others in the soak."""
    kept = [*always]
    return [pytest.param(each, marks=[] if each in kept else [pytest.mark.soak]) for each in values]


def page_at(offset: int) -> int:
    return offset // DATA


@dataclass
class Flash:
    """A board's flash with two slots, of which nothing runs."""

    nand: NandImage
    palette: dict[str, list[bytes]]
    qemu: Path
    uboot: Path

    def put(self, offset: int, name: str) -> None:
        """What the palette has of this name."""
        for number, content in enumerate(self.palette[name]):
            self.nand.write(page_at(offset) + number, content)

    def erase(self, offset: int) -> None:
        for number in range(PAGES):
            self.nand.write(page_at(offset) + number, ERASED)

    def base(self, slot: str, copies: Sequence[int] = (0, 1)) -> None:
        for number in copies:
            self.put(BASE[number].offset, f"base {slot}")

    def trial(self, slot: str, ending: str) -> None:
        """Marked, with a tree that lets the kernel end so."""
        self.put(TRIAL.offset, f"trial {slot}")
        self.put(PLACES[slot].device_tree.offset, ending)

    def tear(self, offset: int, share: float, seed: int = SEED) -> None:
        """A page whose programming was cut: so many of its zeros are not there yet."""
        self._drift(page_at(offset), share, seed)

    def half_erase(self, offset: int, share: float) -> None:
        """A block whose erase was cut: so many of its zeros are ones already."""
        for number in range(PAGES):
            self._drift(page_at(offset) + number, share, number)

    def _drift(self, number: int, share: float, seed: int) -> None:
        chance = random.Random(seed)
        content = self.nand.read(number)
        zeros = [bit for bit in range(8 * PAGE) if not content[bit // 8] & 0x80 >> bit % 8]
        self.nand.flip(number, chance.sample(zeros, int(share * len(zeros))))

    def machine(self) -> Machine:
        """Its time is counted in instructions: the watchdog is not early on a busy host."""
        drive = ("-drive", f"if=mtd,format=raw,file={self.nand.path}")
        return Machine(self.qemu, "-bios", self.uboot, *INSTRUCTION_TIME, *drive, options="pace=off")

    def starts(self) -> str:
        """The slots of the kernels up to the first that is not on trial, as `Ba`: capitals are on trial."""
        with self.machine() as machine:
            received = b""
            while not slots_in(received)[-1:].islower():
                received += machine.uarts[0].wait_for(b"Kernel command line: ", PATIENCE)
                received += machine.uarts[0].wait_for(b"\n", PATIENCE)
        return slots_in(received)


def slots_in(received: bytes) -> str:
    return "".join(
        slot.decode().upper() if trial else slot.decode() for slot, trial in STARTED.findall(received)
    )


def tree_that(ending: str, uboot: Path) -> bytes:
    tree = libfdt.Fdt(bytearray(uboot.with_suffix(".dtb").read_bytes()))
    tree.resize(tree.totalsize() + 256)
    tree.setprop_str(tree.path_offset("/chosen"), "payload", f"payload={ending}")
    tree.pack()
    return wrapped(bytes(tree.as_bytearray()))


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory, uboot: Path, payload: Path) -> Path:
    folder = tmp_path_factory.mktemp("files")
    (folder / "uImage").write_bytes(uimage(300_001, 1, (payload / "uImage").read_bytes()[64:]))
    (folder / "dtb").write_bytes(uboot.with_suffix(".dtb").read_bytes())
    return folder


@pytest.fixture(scope="module")
def installed(
    tmp_path_factory: pytest.TempPathFactory, qemu: Path, uboot: Path, files: Path
) -> tuple[Path, dict[str, list[bytes]]]:
    """A flash after `install`, and what tests put into it."""
    folder = tmp_path_factory.mktemp("installed")
    nand = NandImage.blank(folder / "nand")
    contents = {
        **{f"base {slot}": page(BASE_WORD, slot) for slot in PLACES},
        **{f"trial {slot}": page(TRIAL_WORD, slot) for slot in PLACES},
        "used": struct.pack("<I", USED_WORD) * (DATA // 4),
        **{ending: tree_that(ending, uboot) for ending in ("reset", "hang", "panic")},
    }
    contents = {
        name: content.ljust(-(-len(content) // DATA) * DATA, b"\xff") for name, content in contents.items()
    }
    with switched_on(qemu, uboot, nand) as board:
        with at_prompt(board) as session:
            session.console.run("setenv bootdelay 0; setenv kept yes; saveenv", 30).required()
        assert install(board, files, folder / "site") == 0
        with at_prompt(board) as session:
            environment = read_environment(session.console).variables
            for name, long, short in QUICKER:
                assert long in environment[name]
                SetVariable(name, environment[name].replace(long, short)).run(session)
            session.console.run("saveenv", 30).required()
            for number, content in enumerate(contents.values()):
                board.machine.write_memory(0x1000000, content)
                at = (PALETTE + number * PAGES) * DATA
                session.console.run(f"nand write 0x1000000 {at:#x} {len(content):#x}", 30).required()
    palette = {
        name: [nand.read(PALETTE + number * PAGES + at) for at in range(len(content) // DATA)]
        for number, (name, content) in enumerate(contents.items())
    }
    return nand.path, palette


def install(board: object, files: Path, site: Path, *more: str) -> int:
    images = [str(files / "uImage"), str(files / "dtb")]
    return main(
        ["install", *images, "--no-backup", "a blank flash", *more, *options(board, site, free_port())]
    )


@pytest.fixture
def flash(
    tmp_path: Path, installed: tuple[Path, dict[str, list[bytes]]], qemu: Path, uboot: Path
) -> Iterator[Flash]:
    path, palette = installed
    nand = copy(NandImage(path), tmp_path / "nand")
    yield Flash(nand, palette, qemu, uboot)
    nand.path.unlink()


# ---- the base


@pytest.mark.parametrize(
    ("happened", "boots"),
    [
        (lambda flash: None, "a"),
        (lambda flash: flash.base("b"), "b"),
        (lambda flash: flash.base("b", [0]), "b"),  # a cut between the copies
        (lambda flash: [flash.base("b"), flash.tear(BASE[0].offset, 0.5)], "b"),
        (lambda flash: [flash.base("b"), flash.erase(BASE[0].offset)], "b"),
        (lambda flash: [flash.base("b"), flash.half_erase(BASE[0].offset, 0.5)], "b"),
        (lambda flash: [flash.base("b", [1]), flash.half_erase(BASE[0].offset, 0.02)], "a"),
        (lambda flash: [flash.tear(area.offset, 0.5) for area in BASE], "a"),
        (lambda flash: [flash.base("b"), flash.nand.mark_bad(BASE[0].offset // BLOCK)], "b"),
    ],
    ids=[
        "as installed", "B", "one copy is B's", "the first is torn", "the first is erased",
        "the first is half erased", "the first reads as before", "both are torn", "the first has gone bad",
    ],
)  # fmt: skip
def test_base(flash: Flash, happened: Callable[[Flash], object], boots: str) -> None:
    happened(flash)
    assert flash.starts() == boots


@pytest.mark.parametrize(("base", "boots"), [("a", "b"), ("b", "a")])
@pytest.mark.parametrize("what", ["kernel", "device_tree"])
@pytest.mark.parametrize("how", often(["torn"], ["torn", "erased"]))
def test_slot_that_does_not_load_is_passed_over(
    flash: Flash, base: str, boots: str, what: str, how: str
) -> None:
    flash.base(base)
    offset = getattr(PLACES[base], what).offset
    if how == "torn":
        flash.tear(offset + 2 * DATA, 0.5)
    else:
        flash.erase(offset)
    assert flash.starts() == boots


def test_slot_with_a_bad_block_is_read_within_its_place(flash: Flash) -> None:
    """Behind B's device tree is the mark of the base, which cannot be read here."""
    flash.trial("b", "reset")
    place = PLACES["b"].device_tree
    flash.nand.mark_bad(place.offset // BLOCK)
    flash.put(place.offset + BLOCK, "reset")
    flash.half_erase(BASE[0].offset, 0.125)
    assert flash.starts() == "BBBa"


def test_kernel_with_a_wrong_byte_is_passed_over(flash: Flash) -> None:
    """Bytes with a right ECC that are not the image's, as of an update that ended early."""
    flash.nand.write(page_at(PLACES["a"].kernel.offset) + 100, flash.palette["used"][0])
    assert flash.starts() == "b"


# ---- a trial


@pytest.mark.parametrize("ending", often(["reset", "hang"], ["reset", "hang", "panic"]))
def test_trial_ends_after_three_attempts(flash: Flash, ending: str) -> None:
    """With nobody at the board: it is reset by its kernel, or by the watchdog that U-Boot has armed."""
    flash.trial("b", ending)
    assert flash.starts() == "BBBa"
    assert flash.starts() == "a"


def test_trial_of_a_slot_that_does_not_load(flash: Flash) -> None:
    """The same start goes on to the base; no watchdog and no word of the trial is left for it."""
    flash.put(TRIAL.offset, "trial b")
    flash.erase(PLACES["b"].kernel.offset)
    assert flash.starts() == "a"


@pytest.mark.parametrize("share", often([0.5], [0.02, 0.5, 0.98]))
@pytest.mark.parametrize("attempt", often([1], [1, 2, 3]))
def test_attempt_that_was_torn(flash: Flash, attempt: int, share: float) -> None:
    """Power was lost while its page was programmed. It counts, or reads as erased and is used once more."""
    flash.trial("b", "reset")
    for number in range(1, attempt + 1):
        flash.put(TRIAL.offset + number * DATA, "used")
    flash.tear(TRIAL.offset + attempt * DATA, share)
    left = "B" * (3 - attempt)
    assert flash.starts() in (f"{left}a", f"B{left}a")


@pytest.mark.parametrize(
    "happened",
    [
        lambda flash: flash.tear(TRIAL.offset, 0.5),
        lambda flash: flash.half_erase(TRIAL.offset, 0.5),
        lambda flash: flash.erase(TRIAL.offset),
        lambda flash: flash.nand.mark_bad(TRIAL.offset // BLOCK),
    ],
    ids=["torn", "half erased", "erased", "gone bad"],
)
def test_trial_mark_that_is_not_whole_is_none(flash: Flash, happened: Callable[[Flash], object]) -> None:
    flash.trial("b", "reset")
    happened(flash)
    assert flash.starts() == "a"


def test_environment_is_not_written_by_a_boot(flash: Flash) -> None:
    flash.put(TRIAL.offset, "trial b")
    flash.erase(PLACES["b"].kernel.offset)
    before = [flash.nand.read(number) for number in range(page_at(0x80000), page_at(0x100000))]
    flash.starts()
    assert before == [flash.nand.read(number) for number in range(page_at(0x80000), page_at(0x100000))]


# ---- power cuts at any moment


@pytest.mark.parametrize("number", often(range(2), range(500)))
def test_cut_at_any_moment_of_a_trial(flash: Flash, number: int) -> None:
    """Cuts without end while B is on trial: B at most three times, then A, and A from then on."""
    chance = random.Random(SEED * 1000 + number)
    flash.trial("b", chance.choice(["reset", "hang"]))
    seen = ""
    for _ in range(chance.randrange(1, 6)):
        seen += cut_after(flash, chance.uniform(0.2, 2.5))
    tried = "".join(takewhile(lambda slot: slot == "B", seen))
    assert len(tried) <= 3
    assert set(seen[len(tried) :]) <= {"a"}
    assert re.fullmatch("B{0,3}a+", seen + flash.starts())


def cut_after(flash: Flash, seconds: float) -> str:
    """What started before the power was cut, at any instruction of U-Boot or of the kernel."""
    with flash.machine() as machine:
        received, end = b"", time.monotonic() + seconds
        with suppress(MachineError):
            while (left := end - time.monotonic()) > 0:
                received += machine.uarts[0].receive(left)
    return slots_in(received)


# ---- the tool


def test_marks_are_written_and_read(flash: Flash, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    with stopped(flash.qemu, flash.uboot, flash.nand) as board:
        tool = ["--port", board.port, "--site", str(tmp_path / "site")]
        assert main(["slots", "--try", "b", *tool]) == 0
        assert "B, 3 attempts left" in capsys.readouterr().out
        assert main(["slots", "--base", "b", *tool]) == 0
        shown = capsys.readouterr().out
        assert "base    B (its copies: B, B)" in shown
        assert "trial   none" in shown
    assert flash.starts() == "b"


def test_update_of_the_other_slot(flash: Flash, files: Path, tmp_path: Path) -> None:
    """It ends a trial that is left over, and leaves alone the slot that boots."""
    flash.trial("b", "reset")
    site = tmp_path / "site"
    with stopped(flash.qemu, flash.uboot, flash.nand) as board:
        before = copy(flash.nand, tmp_path / "before")  # a busy host may have begun the trial
        assert install(board, files, site, "--slot", "a") == 2
        assert changed_blocks(before.path, flash.nand.path) == set()
        assert install(board, files, site, "--slot", "b") == 0
        assert main(["slots", "--base", "b", "--port", board.port, "--site", str(site)]) == 0
    places = [PLACES["b"].kernel, PLACES["b"].device_tree, *BASE, TRIAL]
    written = {block for area in places for block in range(area.offset // BLOCK, area.end // BLOCK)}
    assert changed_blocks(before.path, flash.nand.path) <= written
    assert flash.starts() == "b"


def test_slot_that_would_not_boot_is_not_marked(
    flash: Flash, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    flash.nand.write(page_at(PLACES["b"].kernel.offset) + 100, flash.palette["used"][0])
    before = copy(flash.nand, tmp_path / "before")
    with stopped(flash.qemu, flash.uboot, flash.nand) as board:
        for option in ("--try", "--base"):
            assert main(["slots", option, "b", "--port", board.port, "--site", str(tmp_path / "site")]) == 1
            assert "it has no whole kernel" in capsys.readouterr().err
    assert changed_blocks(before.path, flash.nand.path) == set()


def test_board_without_slots(
    qemu: Path, uboot: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    nand = NandImage.blank(tmp_path / "nand")
    with switched_on(qemu, uboot, nand) as board:
        assert main(["slots", "--port", board.port, "--site", str(tmp_path / "site")]) == 2
    assert "nuc980-netboot install makes them" in capsys.readouterr().err
    nand.path.unlink()


@pytest.mark.parametrize("step", often([1, 2], range(5)))
def test_cut_while_the_base_changes(flash: Flash, step: int) -> None:
    """After each command that writes: what boots is A, or B once its first copy is whole."""
    with switched_on(flash.qemu, flash.uboot, flash.nand) as board, at_prompt(board) as session:
        chip = probe_nand(session.console)
        assert chip
        commands = [command for each in plan_base(chip, "b").steps for command in each.commands()]
        writing = [
            number
            for number, command in enumerate(commands)
            if command.startswith(("nand erase", "nand write"))
        ]
        last = writing[step] if step < len(writing) else len(commands) - 1
        for command in commands[: last + 1]:
            session.console.run(command, 30).required()
        marks = read_marks(session.console, chip)
    assert marks.base in {("a", "a"), (None, "a"), ("b", "a"), ("b", None), ("b", "b")}
    assert flash.starts().lower()[0] == marks.order[0]


def test_order() -> None:
    assert Marks((None, None), None, 3).order == ("a", "b")
    assert Marks((None, "b"), "a", 2).order == ("a", "a", "b", "a")
    assert Marks(("a", "b"), "b", 0).order == ("a", "b")


# ---- the installation


def test_bad_blocks_in_each_place(
    qemu: Path, uboot: Path, files: Path, installed: tuple[Path, dict[str, list[bytes]]], tmp_path: Path
) -> None:
    nand = NandImage.blank(tmp_path / "nand")
    places = [area for slot in PLACES.values() for area in (slot.kernel, slot.device_tree)]
    for area in (*places, *BASE, TRIAL):
        nand.mark_bad(area.offset // BLOCK)
    with switched_on(qemu, uboot, nand) as board:
        with at_prompt(board) as session:
            session.console.run("setenv bootdelay 0").required()
        assert install(board, files, tmp_path / "site") == 0
        assert main(["slots", "--try", "b", "--port", board.port, "--site", str(tmp_path / "site")]) == 0
    flash = Flash(nand, installed[1], qemu, uboot)
    flash.put(PLACES["b"].device_tree.offset + BLOCK, "reset")
    assert flash.starts() == "BBBa"
    nand.path.unlink()


@pytest.mark.parametrize("event", often(["end"], ["end", "begin"]))
def test_cut_while_the_environment_is_written(
    qemu: Path, uboot: Path, files: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, event: str
) -> None:
    """saveenv erases what the board would start with. `flash --resume` has all of it in the journal."""
    nand = NandImage.blank(tmp_path / "nand")
    site = tmp_path / "site"
    add = Journal.add

    def cut(journal: Journal, name: str, **facts: object) -> None:
        add(journal, name, **facts)
        if name == event and "Write the environment" in str(facts.get("step")):
            raise KeyboardInterrupt

    with switched_on(qemu, uboot, nand) as board:
        with at_prompt(board) as session:
            session.console.run("setenv bootdelay 0; setenv kept yes; saveenv", 30).required()
        with monkeypatch.context() as patch:
            patch.setattr(Journal, "add", cut)
            assert install(board, files, site) == 1
    for number in range(page_at(0x80000), page_at(0x100000)):
        nand.write(number, ERASED)
    assert newest_unfinished(site)
    with switched_on(qemu, uboot, nand) as board:
        assert main(["flash", "--resume", *options(board, site, free_port())]) == 0
        with at_prompt(board) as session:
            assert session.console.run("echo $kept").output.strip() == "yes"
    assert newest_unfinished(site) is None
    assert Flash(nand, {}, qemu, uboot).starts() == "a"
    shutil.rmtree(site)
    nand.path.unlink()
