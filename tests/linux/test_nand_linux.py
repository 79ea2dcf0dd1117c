# SPDX-License-Identifier: GPL-3.0-or-later
"""The flash under Linux: what U-Boot writes it reads and the reverse, wrong bits, worn blocks, power cuts."""

import hashlib
import os
import random
import re
import shutil
import subprocess
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from nuc980.netboot.board import Nand
from nuc980.netboot.flash.tables import tables_content, tables_slot
from nuc980.twin.linux import TROUBLE, Kernel, Linux
from nuc980.twin.machine import Machine
from nuc980.twin.nand import BLOCKS, DATA, PAGE, PAGES, SPARE, NandImage
from nuc980.twin.uboot import Console

HERE = Path(__file__).parent
BLOCK = PAGES * DATA
STEP, STEPS, PARITY = 512, DATA // 512, 15
STRENGTH = 8
WRITTEN = b"\xff\xff\0\0"  # how a page's spare begins that was written through the ECC
SPARE_AT, ROOT_AT = 0x800000, 0x1600000  # partitions
ROOT_SIZE = 0x6480000
U_BOOT, KERNEL, OTHER, ROOT = "/dev/mtd0", "/dev/mtd1", "/dev/mtd3", "/dev/mtd4"
BAD = {17, 66, 180, 1019}  # blocks, one of them behind all partitions
CHIP = Nand(BLOCKS * BLOCK, BLOCK, DATA, tuple(block * BLOCK for block in BAD))
IN_RAM = 0x1000000
SEED = 980
REPLACED_IN, FILES = 4, 7  # as flashwork.c has them

Boot = Callable[..., Linux]
UBootAt = Callable[[NandImage], Machine]


def some(size: int, seed: int) -> bytes:
    return random.Random(seed).randbytes(size)


FROM_U_BOOT, CONTENT = some(4 * BLOCK, 1), some(3 * BLOCK, 2)


def copied(nand: NandImage, folder: Path) -> NandImage:
    return NandImage(Path(shutil.copy(nand.path, folder / "nand")))


def drive(nand: NandImage) -> tuple[str, str]:
    return "-drive", f"if=mtd,format=raw,file={nand.path}"


def with_flash(nand: NandImage) -> tuple[str, ...]:
    """The board's time goes by its instructions and leaps over its waits: a busy machine changes nothing."""
    return *drive(nand), "-icount", "shift=3,sleep=off"


@pytest.fixture(scope="session")
def flashwork(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """flashwork.c for the board."""
    program = tmp_path_factory.mktemp("flashwork") / "flashwork"
    subprocess.run(
        ["arm-linux-gnueabi-gcc", "-std=c11", "-D_GNU_SOURCE", "-O2", "-static", "-march=armv5te", "-marm",
         "-Wall", "-Wextra", "-Werror", "-o", program, HERE / "programs" / "flashwork.c"], check=True
    )  # fmt: skip
    return program


@pytest.fixture(scope="module")
def kernel(kernel: Kernel) -> Kernel:
    return kernel.without_services()


@pytest.fixture(scope="module")
def uboot_at(qemu: Path, uboot: Path) -> UBootAt:
    def start(nand: NandImage) -> Machine:
        return Machine(qemu, "-bios", uboot, *drive(nand), options="pace=off")

    return start


@pytest.fixture(scope="module")
def nand(tmp_path_factory: pytest.TempPathFactory, uboot_at: UBootAt) -> NandImage:
    """A flash with bad blocks and their tables, and something of U-Boot's in `kernel`."""
    nand = NandImage.blank(tmp_path_factory.mktemp("nand") / "nand")
    for block in BAD:
        nand.mark_bad(block)
    with uboot_at(nand) as machine:
        console = Console(machine)
        machine.write_memory(IN_RAM, FROM_U_BOOT)
        assert "OK" in console.run(f"nand erase 0x200000 {5 * BLOCK:#x}")
        assert "OK" in console.run(f"nand write {IN_RAM:#x} 0x200000 {4 * BLOCK:#x}")
        machine.write_memory(IN_RAM, tables_content(CHIP))
        assert "OK" in console.run(f"nand write {IN_RAM:#x} {tables_slot(CHIP).offset:#x} {4 * BLOCK:#x}")
    return nand


@pytest.fixture(scope="module")
def board_arguments(nand: NandImage) -> tuple[str | Path, ...]:
    return with_flash(nand)


@pytest.fixture(autouse=True)
def module_board_stands_still(request: pytest.FixtureRequest, booted: list[Linux]) -> Iterator[None]:
    """While others run: its time leaps over its waits, so it uses a processor even when it does nothing."""
    idle = [linux.machine for linux in booted if linux.machine.process.poll() is None]
    if "linux" in request.fixturenames:
        idle = []
    for machine in idle:
        machine.command("stop")
    yield
    for machine in idle:
        machine.command("cont")


@pytest.fixture(scope="module")
def extra_files(flashwork: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path | str]:
    content = tmp_path_factory.mktemp("content") / "content"
    content.write_bytes(CONTENT)
    return {"/bin/flashwork": flashwork, "/content": content}


@dataclass(frozen=True)
class Read:
    """What Linux says of a page that it has read."""

    failed: int
    corrected: int
    worst: int  # of the page's steps
    result: str
    data: bytes
    spare: bytes


def read(linux: Linux, device: str, offset: int, mode: str = "") -> Read:
    failed, corrected, worst, result, content = linux.run(
        f"flashwork read {device} {offset:#x} {mode}"
    ).split()
    page = bytes.fromhex(content)
    return Read(int(failed), int(corrected), int(worst), result, page[:DATA], page[DATA:])


def page_of(start: int, offset: int) -> int:
    """Of a partition that begins at start."""
    return (start + offset) // DATA


# ---- the geometry and the tables


def test_partitions_are_those_of_the_device_tree(linux: Linux) -> None:
    lines = linux.run("cat /proc/mtd").splitlines()[1:]
    assert [line.split()[1:] for line in lines] == [
        ["00200000", "00020000", '"u-boot"'],
        ["00500000", "00020000", '"kernel"'],
        ["00100000", "00020000", '"device-tree"'],
        ["00e00000", "00020000", '"spare"'],
        ["06480000", "00020000", '"rootfs"'],
    ]


def test_ecc_and_pages_as_the_images_want_them(linux: Linux) -> None:
    names = "writesize oobsize oobavail subpagesize ecc_strength ecc_step_size bitflip_threshold"
    values = linux.run(f"cd /sys/class/mtd/mtd4; for name in {names}; do cat $name; done").split()
    assert dict(zip(names.split(), map(int, values), strict=True)) == {
        "writesize": DATA,
        "oobsize": SPARE,
        "oobavail": 0,
        "subpagesize": DATA,  # what UBI takes for the place of its second header
        "ecc_strength": STRENGTH,
        "ecc_step_size": STEP,
        "bitflip_threshold": 6,
    }


def test_tables_of_bad_blocks_are_found(linux: Linux, nand: NandImage) -> None:
    assert len(re.findall("Bad block table found", linux.run("dmesg"))) == 2
    per_partition = linux.run("cat /sys/class/mtd/mtd[0-4]/bad_blocks").split()
    assert per_partition == ["0", "1", "0", "1", "1"]


def test_flash_without_tables_is_not_written(boot: Boot, uboot_at: UBootAt, tmp_path: Path) -> None:
    """Its last blocks hold something else, as the factory's data does."""
    flash = NandImage.blank(tmp_path / "factory")
    for block in range(BLOCKS - 8, BLOCKS):
        flash.write(block * PAGES, some(PAGE - SPARE, block) + WRITTEN)
    for block in BAD:
        flash.mark_bad(block)
    before = hashlib.sha256(flash.path.read_bytes()).hexdigest()
    with uboot_at(flash) as machine:
        bad = Console(machine).run("nand bad")
    assert {int(line, 16) // BLOCK for line in re.findall(r"^\s+([0-9a-f]+)", bad, re.M)} == BAD
    assert hashlib.sha256(flash.path.read_bytes()).hexdigest() == before, "U-Boot has written"
    with boot(*with_flash(flash)) as linux:
        assert linux.run("cat /sys/class/mtd/mtd[0-4]/bad_blocks").split() == ["0", "1", "0", "1", "1"]
    assert hashlib.sha256(flash.path.read_bytes()).hexdigest() == before, "Linux has written"


# ---- from U-Boot to Linux and back


def test_linux_reads_what_u_boot_wrote(linux: Linux) -> None:
    # Around the bad block 17, the second of the partition.
    good = "dd if=/dev/mtd1ro bs=128k count=1; dd if=/dev/mtd1ro bs=128k skip=2 count=3"
    found = linux.run(f"({good}) 2>/dev/null | sha256sum").split()[0]
    assert found == hashlib.sha256(FROM_U_BOOT).hexdigest()
    assert linux.run("cat /sys/class/mtd/mtd1/corrected_bits /sys/class/mtd/mtd1/ecc_failures").split() == [
        "0",
        "0",
    ]


def test_u_boot_reads_what_linux_wrote(
    linux: Linux, nand: NandImage, uboot_at: UBootAt, tmp_path: Path
) -> None:
    """The bad block 66, the third of `spare`, is stepped over by who writes and by who reads."""
    for block, part in ((0, 0), (1, 1), (3, 2)):
        linux.run(f"flashwork erase {OTHER} {block * BLOCK:#x}")
        linux.run(f"dd if=/content bs=128k skip={part} count=1 of={OTHER} seek={block} conv=notrunc")
    image = copied(nand, tmp_path)
    with uboot_at(image) as machine:
        console = Console(machine)
        assert "OK" in console.run(f"nand read {IN_RAM:#x} {SPARE_AT:#x} {3 * BLOCK:#x}")
        assert machine.read_memory(IN_RAM, 3 * BLOCK) == CONTENT
        # And written by U-Boot, the pages have the same spare bytes, parity among them.
        assert "OK" in console.run(f"nand erase {SPARE_AT:#x} {BLOCK:#x}")
        assert "OK" in console.run(f"nand write {IN_RAM:#x} {SPARE_AT:#x} {BLOCK:#x}")
    first = SPARE_AT // DATA
    assert [image.read(page) for page in range(first, first + PAGES)] == [
        nand.read(page) for page in range(first, first + PAGES)
    ]
    assert image.read(first)[DATA : DATA + 4] == WRITTEN


def test_what_u_boot_is_in_cannot_be_written(linux: Linux, nand: NandImage) -> None:
    before = nand.read(0)
    assert linux.try_to(f"dd if=/content of={U_BOOT} bs=2048 count=1 conv=notrunc")[0]
    status, output = linux.try_to(f"flashwork erase {U_BOOT} 0")
    assert status
    assert "Permission denied" in output
    assert nand.read(0) == before


# ---- wrong bits


@pytest.fixture
def page(linux: Linux, nand: NandImage, request: pytest.FixtureRequest) -> int:
    """The number of a page that Linux has written, in a block of `spare` that was erased."""
    linux.run(f"flashwork erase {OTHER} {8 * BLOCK:#x}")
    linux.run(f"dd if=/content of={OTHER} bs=2048 count=1 seek={8 * PAGES} conv=notrunc")
    return page_of(SPARE_AT, 8 * BLOCK)


def step_bits(step: int) -> list[int]:
    """The bits of a step in a page: its data, and its parity."""
    data = range(8 * step * STEP, 8 * (step + 1) * STEP)
    parity = 8 * (PAGE - (STEPS - step) * PARITY)
    return [*data, *range(parity, parity + 8 * PARITY)]


@pytest.mark.parametrize("count", range(1, STRENGTH + 1))
def test_wrong_bits_are_corrected_and_counted(linux: Linux, nand: NandImage, page: int, count: int) -> None:
    for step in range(STEPS):
        nand.flip(page, random.Random(count * STEPS + step).sample(step_bits(step), count - step % 2))
    wrong = sum(count - step % 2 for step in range(STEPS))
    before = int(linux.run("cat /sys/class/mtd/mtd3/corrected_bits"))
    found = read(linux, OTHER, 8 * BLOCK)
    assert found.data == CONTENT[:DATA]
    assert (found.failed, found.corrected, found.worst) == (0, wrong, count)
    assert int(linux.run("cat /sys/class/mtd/mtd3/corrected_bits")) == before + wrong


def test_eight_wrong_bits_of_one_byte(linux: Linux, nand: NandImage, page: int) -> None:
    nand.flip(page, range(8 * 700, 8 * 701))
    found = read(linux, OTHER, 8 * BLOCK)
    assert (found.data, found.corrected, found.worst) == (CONTENT[:DATA], 8, 8)


@pytest.mark.parametrize("step", range(STEPS))
def test_one_wrong_bit_too_many_is_refused(linux: Linux, nand: NandImage, page: int, step: int) -> None:
    flips = random.Random(step).sample(range(8 * step * STEP, 8 * (step + 1) * STEP), STRENGTH + 1)
    nand.flip(page, flips)
    found = read(linux, OTHER, 8 * BLOCK)
    assert (found.failed, found.result) == (1, "EBADMSG")
    assert found.data == nand.read(page)[:DATA], "not the page as it is"
    # The controller has recovered.
    nand.flip(page, flips)
    assert read(linux, OTHER, 8 * BLOCK).data == CONTENT[:DATA]


def test_wrong_bits_in_the_mark_of_a_written_page(linux: Linux, nand: NandImage, page: int) -> None:
    """Byte 2 is covered by the parity, byte 3 by nothing."""
    nand.flip(page, [8 * (DATA + 2) + 1, 8 * (DATA + 3) + 5, 8 * (DATA + 3) + 6])
    found = read(linux, OTHER, 8 * BLOCK)
    assert (found.data, found.failed) == (CONTENT[:DATA], 0)


# ---- pages that were never written, or not to their end


@pytest.fixture
def erased(linux: Linux) -> int:
    """The number of an erased page."""
    linux.run(f"flashwork erase {OTHER} {9 * BLOCK:#x}")
    return page_of(SPARE_AT, 9 * BLOCK)


def test_erased_page_is_all_ones(linux: Linux, erased: int) -> None:
    assert read(linux, OTHER, 9 * BLOCK) == Read(0, 0, 0, "good", b"\xff" * DATA, b"\xff" * SPARE)


def test_wrong_bits_of_an_erased_page_are_ones_again_and_counted(
    linux: Linux, nand: NandImage, erased: int
) -> None:
    for step in range(STEPS):
        nand.flip(erased, random.Random(step).sample(step_bits(step), STRENGTH - step))
    found = read(linux, OTHER, 9 * BLOCK)
    assert found.data == b"\xff" * DATA
    assert (found.failed, found.corrected, found.worst) == (0, 8 + 7 + 6 + 5, 8)


def test_page_whose_writing_was_cut_off_is_not_taken_for_erased(
    linux: Linux, nand: NandImage, erased: int
) -> None:
    """The vendor's kernel says all ones to this one, and the next write to it would spoil what it writes."""
    nand.flip(erased, random.Random(7).sample(range(8 * DATA), 100))
    found = read(linux, OTHER, 9 * BLOCK)
    assert found.result == "EBADMSG"
    assert found.failed == STEPS


# ---- raw


def test_raw_read_is_the_page_as_it_is(linux: Linux, nand: NandImage, page: int) -> None:
    nand.flip(page, random.Random(3).sample(range(8 * PAGE), 40))
    found = read(linux, OTHER, 8 * BLOCK, "raw")
    assert found.data + found.spare == nand.read(page)
    assert (found.failed, found.corrected) == (0, 0)


def test_raw_write_is_the_page_as_given(linux: Linux, nand: NandImage, erased: int) -> None:
    linux.run(f"head -c {PAGE} /content | flashwork write {OTHER} {9 * BLOCK:#x} raw")
    assert nand.read(erased) == CONTENT[:PAGE]


# ---- late ticks


def test_time_out_is_not_over_before_its_time(
    boot: Boot, extra_files: dict[str, Path | str], tmp_path: Path
) -> None:
    """The host's disk takes longer for a block than the erasure may; meanwhile the board gets no tick."""
    flash = NandImage.blank(tmp_path / "nand")
    with boot("-drive", f"if=mtd,format=raw,id=flash,file={flash.path}", files=extra_files) as linux:
        unlimited = dict.fromkeys(("bps", "bps_rd", "bps_wr", "iops", "iops_rd"), 0)
        linux.machine.command("block_set_io_throttle", device="flash", iops_wr=10, **unlimited)
        blocks = " ".join(str(block * BLOCK) for block in range(40))
        linux.run(f"for at in {blocks}; do flashwork erase {OTHER} $at || exit 1; done", 120)


# ---- UBI and UBIFS


ATTACH = "ubiattach -m 4 /dev/ubi_ctrl"
MOUNT = "mkdir -p /tmp/mnt && mount -t ubifs ubi0:work /tmp/mnt"
# Until each block has its header, as on a flash that has run before: then UBI's thread rests.
UNTIL_FORMATTED = """\
status=/proc/$(pidof ubi_bgt0d)/status
until [ "$(grep ctxt $status)" = "$last" ]; do last=$(grep ctxt $status); sleep 1; done
"""
BIG = f"{ATTACH}; {MOUNT} && for n in 1 2 3 4 5; do cat /content; done > /tmp/mnt/big && sync"


@pytest.fixture(scope="module")
def formatted(
    boot: Boot, nand: NandImage, extra_files: dict[str, Path | str], tmp_path_factory: pytest.TempPathFactory
) -> NandImage:
    """A flash with an empty UBIFS volume `work` in the partition `rootfs`."""
    image = copied(nand, tmp_path_factory.mktemp("formatted"))
    with boot(*with_flash(image), files=extra_files) as linux:
        linux.run(f"{ATTACH}; ubimkvol /dev/ubi0 -N work -s 8MiB; {MOUNT} && umount /tmp/mnt", 120)
        linux.run(UNTIL_FORMATTED, 300)
        linux.run("ubidetach -d 0 /dev/ubi_ctrl")
    return image


def test_ubi_has_its_second_header_where_the_images_have_it(formatted: NandImage) -> None:
    blocks = set(range(ROOT_AT // BLOCK, (ROOT_AT + ROOT_SIZE) // BLOCK)) - BAD
    pages = [block * PAGES for block in blocks]
    firsts = [formatted.read(page)[:DATA] for page in pages]
    assert {(first[:4], int.from_bytes(first[16:20], "big")) for first in firsts} == {(b"UBI#", DATA)}
    seconds = {formatted.read(page + 1)[:4] for page in pages}
    assert seconds == {b"UBI!", b"\xff\xff\xff\xff"}  # of blocks with something in them, and of the others


def test_files_come_back_after_a_restart(
    boot: Boot, formatted: NandImage, extra_files: dict[str, Path | str], tmp_path: Path
) -> None:
    image = copied(formatted, tmp_path)
    with boot(*with_flash(image), files=extra_files) as linux:
        linux.run(f"{ATTACH}; {MOUNT} && cp /content /tmp/mnt/ && umount /tmp/mnt", 60)
    with boot(*with_flash(image), files=extra_files) as linux:
        linux.run(f"{ATTACH}; {MOUNT}", 60)
        assert linux.run("sha256sum /tmp/mnt/content").split()[0] == hashlib.sha256(CONTENT).hexdigest()
        assert linux.run("cat /sys/class/mtd/mtd4/ecc_failures") == "0"


def test_worn_blocks_are_retired(
    boot: Boot, formatted: NandImage, extra_files: dict[str, Path | str], tmp_path: Path
) -> None:
    """They take neither data nor a mark. The same work on a good flash shows which blocks it takes."""
    good = copied(formatted, tmp_path)
    with boot(*with_flash(good), files=extra_files) as linux:
        linux.run(BIG, 60)
    worn = sorted(block for block in changed_blocks(formatted, good) if is_free(formatted, block))[:3]
    good.path.unlink()

    image = copied(formatted, tmp_path)
    arguments = ("-global", f"nand.worn-blocks={','.join(map(str, worn))}")
    with boot(*with_flash(image), *arguments, files=extra_files) as linux:
        linux.run("dmesg -n 1")  # UBI says it at length
        linux.run(BIG, 60)
        found = linux.run(
            "umount /tmp/mnt && mount -t ubifs ubi0:work /tmp/mnt && sha256sum /tmp/mnt/big", 60
        ).split()[0]
        assert found == hashlib.sha256(5 * CONTENT).hexdigest()
        assert linux.run("cat /sys/class/ubi/ubi0/ro_mode") == "0"
        assert TROUBLE.findall(linux.run("dmesg")) == []
    retired = bad_by_the_tables(image) - bad_by_the_tables(formatted)
    assert retired, f"UBI met none of {worn}"
    assert retired <= set(worn)


def changed_blocks(one: NandImage, other: NandImage) -> set[int]:
    size = PAGES * PAGE
    with one.path.open("rb") as first, other.path.open("rb") as second:
        return {block for block in range(BLOCKS) if first.read(size) != second.read(size)}


def is_free(image: NandImage, block: int) -> bool:
    """Of UBI's: a header that counts erasures, and nothing else."""
    pages = [image.read(block * PAGES + page)[:DATA] for page in range(2)]
    return pages[0][:4] == b"UBI#" and pages[1] == b"\xff" * DATA


def bad_by_the_tables(image: NandImage) -> set[int]:
    """What the newest of the tables says: two bits a block, both of them 1 where it is good."""
    found = [image.read(block * PAGES)[:DATA] for block in range(BLOCKS - 4, BLOCKS)]
    newest = max((table for table in found if table[:4] in (b"Bbt0", b"1tbB")), key=lambda table: table[4])
    return {block for block in range(BLOCKS - 4) if newest[5 + block // 4] >> 2 * (block % 4) & 3 != 3}


# ---- power cuts


class Flashlight:
    """Sees each of the machine's writes to the controller, and takes the power away at a chosen one.

    QEMU's trace goes through a pipe, so the machine is never far ahead of who reads it.
    """

    REGISTER = re.compile(r"nuc980_fmi_write.*?0x([0-9a-f]+).*?0x([0-9a-f]+)")
    COMMAND, ADDRESS = 0x8B0, 0x8B4
    PROGRAM, ERASE = 0x10, 0xD0

    def __init__(self, folder: Path) -> None:
        self.pipe = folder / "trace"
        os.mkfifo(self.pipe)
        self.machine: Machine | None = None
        self.left = 0  # programmed pages and erased blocks until the power goes; 0: it stays
        self.command = 0
        self.addresses: list[int] = []
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    @property
    def arguments(self) -> tuple[str | Path, ...]:
        return "-D", self.pipe, "-trace", "nuc980_fmi_write"

    def cut_after(self, machine: Machine, count: int) -> None:
        self.machine = machine
        self.left = count

    def wait(self) -> None:
        """Until the machine has ended."""
        self._thread.join()

    def _read(self) -> None:
        with self.pipe.open() as lines:
            for line in lines:
                if found := self.REGISTER.search(line):
                    self._note(int(found[1], 16), int(found[2], 16))

    def _note(self, register: int, value: int) -> None:
        if register == self.ADDRESS:
            self.addresses.append(value & 0xFF)
        elif register == self.COMMAND:
            self.command = value
            if value in (self.PROGRAM, self.ERASE):
                self._count()
            else:
                self.addresses.clear()

    def _count(self) -> None:
        if self.left and self.machine:
            self.left -= 1
            if not self.left:
                self.machine.process.kill()

    def tear(self, nand: NandImage, chance: random.Random) -> str:
        """Leaves what was in work when the power went half done; says what that was."""
        if self.command not in (self.PROGRAM, self.ERASE):
            return "nothing"
        row = self.addresses[-2] | self.addresses[-1] << 8
        if self.command == self.PROGRAM:
            half = int.from_bytes(nand.read(row), "big") | chance.getrandbits(8 * PAGE)
            nand.write(row, half.to_bytes(PAGE, "big"))
            return "a page"
        for page in range(row, row + PAGES):
            nand.write(page, chance.randbytes(PAGE))
        return "a block"


def kept(log: str) -> int:
    """The last record that the board has said to be safe."""
    return max((int(number) for number in re.findall(r"kept (\d+)\.", log)), default=0)


def check_records(linux: Linux, last: int) -> None:
    """All that was said to be safe is there: in the journal each one, in each file the newest or a newer."""
    found = dict(line.split() for line in linux.run("cd /tmp/mnt/work && flashwork check", 60).splitlines())
    assert "broken" not in found.values()
    in_journal = [number for number in range(1, last + 1) if number % REPLACED_IN]
    assert int(found.pop("journal")) > max(in_journal, default=0)
    for number in range(REPLACED_IN, last + 1, REPLACED_IN):
        assert int(found[f"file{number % FILES}"]) >= number


@pytest.mark.parametrize("cuts", [3, pytest.param(100, marks=pytest.mark.soak)])
def test_what_was_synced_survives_power_cuts(
    boot: Boot, formatted: NandImage, extra_files: dict[str, Path | str], tmp_path: Path, cuts: int
) -> None:
    image = copied(formatted, tmp_path)
    chance = random.Random(SEED + cuts)
    last, torn = 0, []
    for number in range(cuts + 1):
        folder = tmp_path / str(number)
        folder.mkdir()
        light = Flashlight(folder)
        with boot(*with_flash(image), *light.arguments, files=extra_files) as linux:
            linux.run("dmesg -n 1")  # UBI says at length what it cannot read, and recovers
            linux.run(f"{ATTACH}; {MOUNT}", 60)
            if last:
                check_records(linux, last)
            assert TROUBLE.findall(linux.run("dmesg")) == []
            if number == cuts:
                break
            linux.run("rm -rf /tmp/mnt/work && mkdir /tmp/mnt/work && sync", 60)
            linux.run("cd /tmp/mnt/work; flashwork record > /dev/ttyS0 &")
            linux.wait_for("kept 1.", 60)
            light.cut_after(linux.machine, chance.randrange(1, 400))
            light.wait()
            last = kept(linux.log)
        torn.append(light.tear(image, chance))
    assert "a page" in torn, f"no cut came while a page was written: {torn}"
