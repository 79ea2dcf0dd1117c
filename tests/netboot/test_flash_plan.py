# SPDX-License-Identifier: GPL-3.0-or-later
"""The plan of a flash, as a value: what it types and in which order; and what is refused before."""

import random
import re
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import pytest

from netboot.flashbench import noise, ubi_image, uimage
from netboot.images import device_tree
from nuc980.netboot.board import BoardReport, Nand
from nuc980.netboot.console import Answer
from nuc980.netboot.errors import (
    BoardReset,
    DoesNotFit,
    FlashNotPossible,
    LineUnsafe,
    UnusableImage,
    WrongBytes,
)
from nuc980.netboot.flash.backup import BySerial, ByTftp
from nuc980.netboot.flash.images import Image, check_image
from nuc980.netboot.flash.layout import DEVICE_TREE, KERNEL, LOADER, UBI, Slot
from nuc980.netboot.flash.plan import (
    Work,
    check_board,
    choose_way,
    in_order,
    plan_backups,
    plan_flash,
    plan_ram,
    warning,
)
from nuc980.netboot.flash.resume import without_free_blocks
from nuc980.netboot.flash.steps import BlockFailed, CheckRam, ReadBack, WriteBlock

BLOCK = 0x20000
NOISE = noise(BLOCK, 1)
FREE_RAM = range(0x100000, 0x3A00000)
SLOTS = {
    KERNEL: Slot(KERNEL, 0x200000, 0x700000, 0x500000, address=0x7FC0),
    DEVICE_TREE: Slot(DEVICE_TREE, 0x700000, 0x800000, 0x100000),
    UBI: Slot(UBI, 0x1600000, 0x7A80000, 0x6480000),
    LOADER: Slot(LOADER, 0x100000, 0x180000, 500 * 1024),
}
PLACES = {name: slot for name, slot in SLOTS.items() if name != LOADER}
COMMANDS = frozenset(("nand", "crc32", "mw", "md", "tftpboot", "tftpput"))


def board(*bad: int, commands: frozenset[str] = COMMANDS, nand: bool = True) -> BoardReport:
    flash = Nand(0x8000000, BLOCK, 2048, bad) if nand else None
    return BoardReport("U-Boot", commands, {}, ((0, 0x4000000),), 0x3B00000, flash)


@pytest.fixture
def work(tmp_path: Path) -> Callable[..., Work]:
    def make(*bad: int, **sizes: int) -> Work:
        images = []
        for name, slot in SLOTS.items():
            if size := sizes.get(name.split()[0], 0):
                path = tmp_path / name
                path.write_bytes((NOISE * (size // BLOCK + 1))[:size])
                images.append(Image.of(slot, path))
        report = board(*bad)
        assert report.nand
        return Work(in_order(images), report.nand, plan_ram(report, images, report.nand))

    return make


def typed(work: Work, folder: Path) -> list[str]:
    steps = (*plan_backups(work, folder, ByTftp()), *plan_flash(work))
    return [command for step in steps for command in step.commands()]


def numbers(command: str) -> list[int]:
    return [int(word, 16) for word in command.split() if re.fullmatch(r"0x[0-9a-f]+", word)]


BAD = (0x200000, 0x240000, 0x720000, 0x1600000, 0x1660000)


@pytest.mark.slow
@pytest.mark.parametrize("ubi", [20 * BLOCK, 400 * BLOCK], ids=["UBI in RAM", "UBI by pieces"])
def test_nothing_is_erased_before_it_is_backed_up_and_its_content_compared(
    work: Callable[..., Work], tmp_path: Path, ubi: int
) -> None:
    plan = work(*BAD, kernel=3_000_001, device=20_000, UBI=ubi)
    backed_up: set[int] = set()
    compared: set[int] = set()
    for command in typed(plan, tmp_path):
        match command.split()[:2]:
            case ["nand", "read"]:
                _, offset, size = numbers(command)
                blocks = [at for at in range(offset, 0x8000000, BLOCK) if at not in BAD]
                backed_up |= set(blocks[: size // BLOCK])
            case ["crc32", _]:
                address, size = numbers(command)
                compared |= set(range(address // 2048, (address + size) // 2048))
            case ["tftpboot" | "mw.b", _]:
                compared -= set(range(numbers(command)[0] // 2048, (numbers(command)[0] + (8 << 20)) // 2048))
            case ["printenv", _] if "nand erase" in command:
                offset, size = numbers(command)
                assert size == BLOCK
                assert offset in backed_up
            case ["printenv", _]:
                address, _, size = numbers(command)
                assert compared >= set(range(address // 2048, (address + size) // 2048))


@pytest.mark.slow
def test_only_good_blocks_of_the_slots_are_touched_each_once(
    work: Callable[..., Work], tmp_path: Path
) -> None:
    plan = work(*BAD, kernel=3_000_001, device=20_000, UBI=20 * BLOCK)
    commands = typed(plan, tmp_path)
    erased = [numbers(command)[0] for command in commands if "nand erase" in command]
    assert len(set(erased)) == len(erased)
    assert set(erased) == {
        at for slot in PLACES.values() for at in range(slot.offset, slot.end, BLOCK) if at not in BAD
    }
    assert not [command for command in commands if "scrub" in command or "markbad" in command]
    for command in commands:
        if "nand write" in command:
            _, offset, size = numbers(command)
            assert offset in erased
            assert 0 < size <= BLOCK
            assert size % 2048 == 0


@pytest.mark.slow
def test_kernel_comes_last_and_all_is_read_back(work: Callable[..., Work], tmp_path: Path) -> None:
    plan = work(kernel=3_000_000, device=20_000, UBI=20 * BLOCK)
    steps = plan_flash(plan)
    order = [step.image for step in steps if isinstance(step, WriteBlock)]
    assert [name for at, name in enumerate(order) if order[at - 1 : at] != [name]] == [
        UBI,
        DEVICE_TREE,
        KERNEL,
    ]
    for image in plan.images:
        read = b"".join(
            image.content(s.first * BLOCK, s.size)
            for s in steps
            if isinstance(s, ReadBack) and s.image == image.name
        )
        assert len(read) == image.slot.end - image.slot.offset
        assert read.rstrip(b"\xff") == image.path.read_bytes().rstrip(b"\xff")


@pytest.mark.slow
def test_pages_behind_an_image_stay_erased(work: Callable[..., Work], tmp_path: Path) -> None:
    plan = work(UBI=2 * BLOCK)
    path = plan.images[0].path
    path.write_bytes(noise(4096 + 1, 1) + b"\xff" * (BLOCK - 4097) + b"\xff" * BLOCK)
    image = Image.of(SLOTS[UBI], path)
    steps = plan_flash(Work((image,), plan.nand, plan.ram))
    assert [s.size for s in steps if isinstance(s, WriteBlock)][:3] == [3 * 2048, 0, 0]


@pytest.mark.parametrize("ubi", [BLOCK, 200 * BLOCK, 800 * BLOCK])
def test_ram_of_images_does_not_overlap(ubi: int) -> None:
    sizes = {KERNEL: 0x500000, DEVICE_TREE: 0x100000, UBI: ubi}
    images = [Image(SLOTS[name], Path("file"), size, 0, "") for name, size in sizes.items()]
    ram = plan_ram(board(), images, board().nand)
    areas = [(ram.scratch, 8 << 20), (ram.pieces, 8 << 20)]
    areas += [(at, -(-i.size // BLOCK) * BLOCK) for i in images if (at := ram.loads[i.name])]
    areas.sort()
    assert all(start + size <= after for (start, size), (after, _) in pairwise(areas))
    assert areas[0][0] in FREE_RAM
    assert sum(areas[-1]) in FREE_RAM


def test_too_little_ram_is_said() -> None:
    small = BoardReport("U-Boot", COMMANDS, {}, ((0, 0x1000000),), 0xF00000, board().nand)
    with pytest.raises(FlashNotPossible, match="RAM"):
        plan_ram(small, [], small.nand)


def test_warning_names_the_way_out(work: Callable[..., Work]) -> None:
    text = warning(work(kernel=3_000_000))
    assert re.search(r"about \d+ s", text)
    for words in ("cannot boot", "nuc980-netboot boot", "--resume", "--roll-back"):
        assert words in text


def test_ubi_of_all_blocks_is_restored_when_one_has_died(tmp_path: Path) -> None:
    """What has its erase counter only is free; what holds data, and the order, stay."""
    counter = b"UBI#" + noise(60, 1) + bytes(2048 - 64)
    used, free = counter + NOISE[2048:], counter + b"\xff" * (BLOCK - 2048)
    path = tmp_path / "ubi.backup"
    path.write_bytes(used + free + used[::-1] + free + used)
    slot = Slot(UBI, 0x1600000, 0x1600000 + 5 * BLOCK, 5 * BLOCK)

    def left(*bad: int) -> bytes:
        return without_free_blocks(path, slot, Nand(0x8000000, BLOCK, 2048, bad)).read_bytes()

    assert left() == path.read_bytes()
    assert left(0x1600000) == used + free + used[::-1] + used
    assert left(0x1600000, 0x1620000) == used + used[::-1] + used
    assert left(0x1600000, 0x1620000, 0x1640000) == used + used[::-1] + used  # and does not fit


# ---- what is refused


@pytest.mark.parametrize("missing", ["nand", "crc32", "mw", "tftpboot", "tftpput"])
def test_uboot_must_know_the_commands(missing: str) -> None:
    with pytest.raises(FlashNotPossible, match=missing):
        check_board(board(commands=COMMANDS - {missing}), ByTftp.needs)


def test_board_without_a_flash() -> None:
    with pytest.raises(FlashNotPossible, match="no NAND"):
        check_board(board(nand=False))


def test_backup_goes_over_the_line_where_there_is_no_tftpput() -> None:
    without = board(commands=COMMANDS - {"tftpput"})
    assert isinstance(choose_way(without, None, without.nand), BySerial)
    assert isinstance(choose_way(board(), None, board().nand), ByTftp)
    assert isinstance(choose_way(board(), "serial", board().nand), BySerial)


def check(name: str, content: bytes, folder: Path, nand: Nand | None = None) -> None:
    path = folder / "image"
    path.write_bytes(content)
    check_image(Image.of(SLOTS[name], path), nand or board().nand)


def spoiled(content: bytes, at: int) -> bytes:
    return content[:at] + bytes([content[at] ^ 1]) + content[at + 1 :]


def test_kernel_is_a_whole_uimage_that_runs_where_the_boot_command_loads_it(tmp_path: Path) -> None:
    check(KERNEL, uimage(10_000, 1), tmp_path)
    for wrong in (spoiled(uimage(10_000, 1), 9_999), uimage(10_000, 1)[:-1], b""):
        with pytest.raises(UnusableImage):
            check(KERNEL, wrong, tmp_path)
    with pytest.raises(UnusableImage, match="0x8000"):
        check(KERNEL, uimage(10_000, 1, load=0x9000), tmp_path)


def test_device_tree_is_one(tmp_path: Path) -> None:
    tree = device_tree(random.Random(1))
    check(DEVICE_TREE, tree, tmp_path)
    for wrong in (tree[:-1], bytes(100), uimage(10_000, 1)):
        with pytest.raises(UnusableImage):
            check(DEVICE_TREE, wrong, tmp_path)


def test_ubi_image_is_for_this_flash(tmp_path: Path) -> None:
    content = ubi_image(tmp_path, "root", 1)
    check(UBI, content, tmp_path)
    for wrong in (content[:-1], spoiled(content, BLOCK + 20), spoiled(content, 0), b""):
        with pytest.raises(UnusableImage):
            check(UBI, wrong, tmp_path)
    with pytest.raises(UnusableImage, match="page size"):
        check(UBI, content, tmp_path, Nand(0x8000000, BLOCK, 4096, ()))


@pytest.mark.slow
def test_boot_loader_begins_as_one_and_fits_what_the_spl_reads(tmp_path: Path, uboot: Path) -> None:
    check(LOADER, uboot.read_bytes(), tmp_path)
    with pytest.raises(UnusableImage):
        check(LOADER, uimage(10_000, 1), tmp_path)
    with pytest.raises(DoesNotFit):
        check(LOADER, uboot.read_bytes().ljust(500 * 1024 + 1), tmp_path)


# ---- what U-Boot answers


@dataclass
class Scripted:
    """A console with answers at hand; the last one stays."""

    answers: dict[str, list[tuple[int, str] | Exception]]
    typed: list[str] = field(default_factory=list)

    def run(self, command: str, *_: object, repeatable: bool = True) -> Answer:
        self.typed.append(command)
        assert not (repeatable and "nand write" in command), "no page is programmed twice between two erases"
        command = command.removeprefix("printenv flashing && ")
        name = " ".join(command.split()[:2]) if command.startswith("nand") else command.split()[0]
        script = self.answers[name]
        answer = script.pop(0) if len(script) > 1 else script[0]
        if isinstance(answer, Exception):
            raise answer
        return Answer(command, *answer)


@dataclass
class OnlyConsole:
    console: Scripted


# cmd/nand.c and nand_util.c of 2016.11 and 2023.01, which say the same
IN_WORK = "flashing=yes\n"
RANGE = "device 0 offset 0x240000, size 0x20000\n"
ERASED = (0, f"{IN_WORK}\nNAND erase: {RANGE}\rErasing at 0x240000 -- 100% complete.\nOK\n")
NOT_ERASED = (0, f"{IN_WORK}\nNAND erase: {RANGE}\nnand0: MTD Erase failure: -5\n\nOK\n")
SKIPPED = (0, f"{IN_WORK}\nNAND erase: {RANGE}\rSkipping bad block at  0x00240000{' ' * 42}\n\nOK\n")
QUIET = (0, f"{IN_WORK}\nNAND erase: {RANGE}OK\n")
REFUSED = (1, f"{IN_WORK}\nNAND erase: Size exceeds partition or device limit\n")
WRITTEN = (0, f"{IN_WORK}\nNAND write: {RANGE} 131072 bytes written: OK\n")
NOT_WRITTEN = (
    1,
    f"{IN_WORK}\nNAND write: {RANGE}NAND write to offset 240000 failed -5\n 0 bytes written: ERROR\n",
)
SKIPPED_WRITE = (0, f"{IN_WORK}\nNAND write: {RANGE}Skip bad block 0x00240000\n 131072 bytes written: OK\n")
WRITE = WriteBlock(KERNEL, 2, 0x240000, BLOCK, 0x1000000, BLOCK)


def at(**answers: object) -> OnlyConsole:
    answers = {"printenv": (0, IN_WORK), **answers}
    named = {
        name.replace("_", " "): value if isinstance(value, list) else [value]
        for name, value in answers.items()
    }
    return OnlyConsole(Scripted(named))


def test_block_is_erased_and_written() -> None:
    session = at(nand_erase=ERASED, nand_write=WRITTEN)
    WRITE.run(session)
    assert session.console.typed == list(WRITE.commands())


@pytest.mark.parametrize("answer", [NOT_ERASED, SKIPPED, REFUSED])
def test_nothing_is_written_where_nothing_was_erased(answer: tuple[int, str]) -> None:
    """U-Boot ends with OK and status 0 when an erase fails."""
    session = at(nand_erase=answer, nand_write=WRITTEN)
    with pytest.raises(BlockFailed) as failed:
        WRITE.run(session)
    assert (failed.value.index, failed.value.offset) == (2, 0x240000)
    assert not any("write" in command for command in session.console.typed)


@pytest.mark.parametrize("answer", [NOT_WRITTEN, SKIPPED_WRITE, (1, IN_WORK)])
def test_write_must_say_that_it_wrote_all(answer: tuple[int, str]) -> None:
    with pytest.raises(BlockFailed):
        WRITE.run(at(nand_erase=ERASED, nand_write=answer))


def noisy(answer: tuple[int, str], word: str) -> tuple[int, str]:
    return answer[0], answer[1].replace(word, "~" * len(word))


@pytest.mark.parametrize(
    ("erase", "write"),
    [(noisy(ERASED, "100%"), WRITTEN), (QUIET, WRITTEN), (ERASED, noisy(WRITTEN, "OK"))],
    ids=["erase", "erase in silence", "write"],
)
def test_noise_in_an_answer_does_not_make_a_block_bad(erase: tuple[int, str], write: tuple[int, str]) -> None:
    """Only U-Boot's own words do: a block is marked as bad for ever."""
    session = at(nand_erase=[erase, ERASED], nand_write=[write, WRITTEN])
    WRITE.run(session)
    with pytest.raises(LineUnsafe):
        WRITE.run(at(nand_erase=erase, nand_write=write))


def test_noise_in_what_a_read_says_is_no_worn_block() -> None:
    session = at(nand_read=[noisy(read(2 * BLOCK), "bytes"), read(2 * BLOCK)], crc32=RIGHT)
    session.console.answers["mw.l"] = [(0, "")]
    READ.run(session)


def test_board_that_was_reset_is_not_written_any_more() -> None:
    """The variable is gone, and with it the trust in what was loaded."""
    lost = (1, '## Error: "flashing" not defined\n')
    with pytest.raises(BoardReset):
        WRITE.run(at(nand_erase=ERASED, nand_write=lost, printenv=lost))
    with pytest.raises(BoardReset):
        WRITE.run(at(nand_erase=lost, nand_write=WRITTEN, printenv=lost))
    assert all(command.startswith("printenv flashing && nand ") for command in WRITE.commands())


def test_ram_that_changed_ends_it_before_the_erase() -> None:
    with pytest.raises(WrongBytes):
        CheckRam(KERNEL, 0x1000000, BLOCK, 0x1234).run(at(crc32=(0, "... ==> 00001235\n")))


def test_write_whose_answer_is_lost_starts_with_the_erase_again() -> None:
    session = at(nand_erase=ERASED, nand_write=[LineUnsafe("lost"), WRITTEN])
    WRITE.run(session)
    assert [command.split()[4] for command in session.console.typed] == ["erase", "write"] * 2


READ = ReadBack(
    KERNEL, 0x200000, 0, (0x200000, 0x220000), BLOCK, 0x100000,
    (zlib.crc32(b"a"), zlib.crc32(b"b")), zlib.crc32(b"ab"),
)  # fmt: skip
RIGHT = (0, f"CRC32 for 00100000 ... 0013ffff ==> {zlib.crc32(b'ab'):08x}\n")


def read(size: int, text: str = "OK", status: int = 0) -> tuple[int, str]:
    return status, f"\nNAND read: {RANGE} {size} bytes read: {text}\n"


def test_reading_back_starts_from_ram_that_holds_something_else() -> None:
    session = at(mw_l=(0, ""), nand_read=read(2 * BLOCK), crc32=RIGHT)
    session.console.answers["mw.l"] = [(0, "")]
    READ.run(session)
    assert [command.split()[0] for command in session.console.typed] == ["mw.l", "nand", "crc32"]


@pytest.mark.parametrize(
    "answers",
    [
        {"nand_read": read(2 * BLOCK, "ERROR", 1), "crc32": RIGHT},
        {"nand_read": read(BLOCK), "crc32": RIGHT},
        {"nand_read": read(2 * BLOCK), "crc32": (0, "... ==> 00000000\n")},
    ],
    ids=["not corrected", "too short", "other bytes"],
)
def test_what_does_not_read_back_is_a_failed_block(answers: dict[str, tuple[int, str]]) -> None:
    session = at(**answers)
    session.console.answers["mw.l"] = [(0, "")]
    with pytest.raises(BlockFailed) as failed:
        READ.run(session)
    assert failed.value.offset == 0x200000
