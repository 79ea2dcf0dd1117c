# SPDX-License-Identifier: GPL-3.0-or-later
"""The NAND flash and its controller, register by register. The parity is judged by its definition."""

import functools
import random
import struct
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from nuc980.twin.machine import ANSWER_SECONDS, Machine, MachineError
from nuc980.twin.nand import BLOCKS, DATA, PAGE, PAGES, SIZE, SPARE, NandError, NandImage

MFP_C = (0xB0000080, 0xB0000084)
AIC_RAWSTS = 0xB0042100
AHBIPRST, FMI_RESET = 0xB0000060, 1 << 20
IRQ = 1 << 28

FMI = 0xB0019000
DMACTL, DMASA, DMABCNT, DMAINTEN, DMAINTSTS = (FMI + n for n in (0x400, 0x408, 0x40C, 0x410, 0x414))
GCTL, GINTEN, GINTSTS = (FMI + n for n in (0x800, 0x804, 0x808))
NANDCTL, NANDTMCTL, INTEN, INTSTS = (FMI + n for n in (0x8A0, 0x8A4, 0x8A8, 0x8AC))
CMD, ADDR, PORT, RACTL, ECTL = (FMI + n for n in (0x8B0, 0x8B4, 0x8B8, 0x8BC, 0x8C0))
STATUS, ERROR_ADDRESS, ERROR_DATA, RA = (FMI + n for n in (0x8D0, 0x900, 0x960, 0xA00))

READ, WRITE, READ_SPARE, AUTO_WRITE = 1 << 1, 1 << 2, 1 << 3, 1 << 4
SKIP_UNUSED, PROTECT_3, PAGE_2K, ECC_ON, CS0_OFF = 1 << 7, 1 << 8, 1 << 16, 1 << 23, 1 << 25
T = {24: 1 << 18, 4: 1 << 19, 8: 1 << 20, 12: 1 << 21, 15: 1 << 22}
DMA_DONE, ECC_ERROR, READY_EDGE, READY = 1 << 0, 1 << 2, 1 << 10, 1 << 18

LAST = 1 << 31  # of the address bytes
BUFFER = 0x100000  # in RAM
READ_NS, PROGRAM_NS, ERASE_NS = 25_000, 200_000, 2_000_000
FAILED, IDLE, WRITABLE = 0x01, 0x40, 0x80  # the flash's status

WRITTEN = b"\xff\xff\0\0"  # how the vendor's drivers mark a page: bytes 2 and 3


# ---- the code, by its definition -----------------------------------------------------------------


@functools.cache
def powers() -> list[int]:
    """Of alpha, in GF(2^15) with x^15 + x + 1."""
    result = [1]
    while len(result) < 32767:
        doubled = result[-1] << 1
        result.append(doubled ^ 0x8003 if doubled >> 15 else doubled)
    return result


def product(a: int, b: int) -> int:
    """Of polynomials over GF(2)."""
    result = 0
    for shift in range(b.bit_length()):
        if b >> shift & 1:
            result ^= a << shift
    return result


def remainder(a: int, b: int) -> int:
    while a.bit_length() >= b.bit_length():
        a ^= b << (a.bit_length() - b.bit_length())
    return a


def minimal_polynomial(exponent: int) -> int:
    """The one of least degree over GF(2) with alpha^exponent as a root: degree 15, found by elimination."""
    rows: list[tuple[int, int]] = []  # (value, which powers of the root were added up)
    for degree in range(16):
        value, used = powers()[exponent * degree % 32767], 1 << degree
        for other, other_used in rows:
            if value ^ other < value:
                value, used = value ^ other, used ^ other_used
        if not value:
            return used
        rows.append((value, used))
        rows.sort(reverse=True)
    raise AssertionError("sixteen elements of a field of dimension fifteen are dependent")


@functools.cache
def generator(t: int) -> int:
    return functools.reduce(product, {minimal_polynomial(i) for i in range(1, 2 * t)})


@functools.cache
def parity(t: int, message: bytes) -> bytes:
    bits = generator(t).bit_length() - 1
    size = -(-bits // 8)
    rest = remainder(int.from_bytes(message, "big") << bits, generator(t))
    return (rest << (8 * size - bits)).to_bytes(size, "big")


def test_code_is_the_one_of_the_vendor() -> None:
    assert {t: generator(t).bit_length() - 1 for t in T} == {t: 15 * t for t in T}


def field_size(t: int) -> int:
    return 1024 if t == 24 else 512


def message(t: int, page: bytes, spare: bytes, field: int) -> bytes:
    """What is protected: a field, the first with the first three spare bytes; zeros before the parity."""
    size = field_size(t)
    data = page[field * size : (field + 1) * size] + (spare[:3] if field == 0 else b"")
    return data.ljust(size + size // 16 - len(parity(t, b"")), b"\0")


def parities(t: int, page: bytes, spare: bytes) -> bytes:
    return b"".join(parity(t, message(t, page, spare, n)) for n in range(len(page) // field_size(t)))


# ---- a driver ------------------------------------------------------------------------------------


class Flash:
    """Does what the vendor's drivers do, on a machine without a processor."""

    def __init__(self, machine: Machine, t: int = 8) -> None:
        self.bus = machine
        self.t = t
        self.parity = len(parity(t, b"")) * DATA // field_size(t)
        self.spare = max(SPARE, -(-(4 + self.parity) // 4) * 4)
        self.control = PAGE_2K | T[t] | ECC_ON | AUTO_WRITE | PROTECT_3
        machine.write(MFP_C[0], 0x33333330)
        machine.write(MFP_C[1], 0x33333333)
        machine.write(GCTL, 1 << 3)
        machine.write(NANDCTL, self.control)
        machine.write(RACTL, self.spare)
        machine.write(ECTL, 1)
        machine.write(DMACTL, 3)
        self.command(0xFF)

    def command(self, command: int, *address: int) -> None:
        self.bus.write(CMD, command)
        for byte in address[:-1]:
            self.bus.write(ADDR, byte)
        if address:
            self.bus.write(ADDR, address[-1] | LAST)

    def wait(self, nanoseconds: int) -> None:
        assert not self.bus.read(INTSTS) & READY
        self.bus.step(nanoseconds)
        assert self.bus.read(INTSTS) & (READY | READY_EDGE) == READY | READY_EDGE
        self.bus.write(INTSTS, READY_EDGE)

    def get(self, size: int) -> bytes:
        return bytes(self.bus.read(PORT) for _ in range(size))

    def status(self) -> int:
        self.command(0x70)
        return self.bus.read(PORT)

    def erase(self, block: int) -> int:
        page = block * PAGES
        self.command(0x60, page & 0xFF, page >> 8)
        self.command(0xD0)
        self.wait(ERASE_NS)
        return self.status()

    def program(self, page: int, data: bytes, spare: bytes = WRITTEN) -> int:
        """By DMA; returns the status, and leaves the parity in the buffer."""
        self.bus.write_memory(BUFFER, data)
        self.bus.write_memory(RA, spare.ljust(self.spare, b"\xff"))
        self.command(0x80, 0, 0, page & 0xFF, page >> 8)
        self.transfer(WRITE)
        self.command(0x10)
        self.wait(PROGRAM_NS)
        return self.status()

    def transfer(self, way: int) -> None:
        self.bus.write(INTSTS, DMA_DONE | ECC_ERROR)
        self.bus.write(DMASA, BUFFER)
        self.bus.write(NANDCTL, self.control | way)

    def seek(self, page: int, column: int = 0) -> None:
        self.command(0x00, column & 0xFF, column >> 8, page & 0xFF, page >> 8)
        self.command(0x30)
        self.wait(READ_NS)

    def start_read(self, page: int) -> None:
        """The spare first, by the port, for the parity is in it; then the data by DMA."""
        self.seek(page, DATA)
        self.bus.write_memory(RA, self.get(SPARE))
        self.seek(page)
        self.transfer(READ)

    def read(self, page: int) -> tuple[bytes, list[int]]:
        """The data, corrected; how many bytes were wrong in each field, -1 for more than can be corrected."""
        self.start_read(page)
        return self.finish_read()

    def finish_read(self) -> tuple[bytes, list[int]]:
        wrong = [0] * (DATA // field_size(self.t))
        while self.bus.read(INTSTS) & ECC_ERROR:
            status = self.bus.read(STATUS)
            (field,) = (n for n in range(4) if status >> 8 * n & 3)
            wrong[field] = self.correct(field) if status >> 8 * field & 3 == 1 else -1
            self.bus.write(INTSTS, ECC_ERROR)
        assert self.bus.read(INTSTS) & DMA_DONE
        assert not self.bus.read(NANDCTL) & (READ | WRITE)
        return self.bus.read_memory(BUFFER, DATA), wrong

    def correct(self, field: int) -> int:
        """As the vendor's drivers reckon an error's place."""
        size = field_size(self.t)
        one = self.parity // (DATA // size)
        count = self.bus.read(STATUS) >> 8 * field + 2 & 0x1F
        for n in range(count):
            place = self.bus.read(ERROR_ADDRESS + n // 2 * 4) >> 16 * (n % 2) & 0x7FF
            flips = self.bus.read(ERROR_DATA + n // 4 * 4) >> 8 * (n % 4) & 0xFF
            if place < size:
                address = BUFFER + field * size + place
            elif place < size + 3:
                address = RA + place - size
            else:
                address = RA + self.spare - self.parity + field * one + place - (size + size // 16 - one)
            self.bus.write_byte(address, self.bus.read_byte(address) ^ flips)
        return count


@pytest.fixture(scope="module")
def image(tmp_path_factory: pytest.TempPathFactory) -> NandImage:
    """One flash for all tests; each has blocks of its own in it."""
    return NandImage.blank(tmp_path_factory.mktemp("nand") / "nand.img")


@pytest.fixture
def machine(board: Callable[..., Machine], image: NandImage) -> Callable[..., Machine]:
    def start(*arguments: str) -> Machine:
        return board("-drive", f"if=mtd,format=raw,file={image.path}", *arguments, registers=True)

    return start


@pytest.fixture
def flash(machine: Callable[..., Machine]) -> Flash:
    return Flash(machine())


def some_page(seed: int) -> bytes:
    return random.Random(seed).randbytes(DATA)


def turned(content: bytes, bits: list[int]) -> bytes:
    result = bytearray(content)
    for bit in bits:
        result[bit // 8] ^= 0x80 >> bit % 8
    return bytes(result)


# ---- the flash -----------------------------------------------------------------------------------


def test_identification(flash: Flash) -> None:
    flash.command(0x90, 0)
    maker, device, _, geometry = flash.get(4)
    assert (maker, device) == (0xEF, 0xF1)  # Winbond, 1 Gbit, 8 bits
    assert 1024 << (geometry & 3) == DATA
    assert (8 << (geometry >> 2 & 1)) * (DATA // 512) == SPARE
    assert (64 << (geometry >> 4 & 3)) * 1024 == PAGES * DATA


def test_each_page_is_at_its_place_in_the_image(flash: Flash, image: NandImage) -> None:
    # The eight places that a page's start can have in a sector, and the flash's last page.
    pages = [*range(1 * PAGES, 1 * PAGES + 9), PAGES * BLOCKS - 1]
    for page in pages:
        assert flash.program(page, some_page(page)) == IDLE | WRITABLE
        assert flash.read(page) == (some_page(page), [0, 0, 0, 0])
        spare = WRITTEN + parities(8, some_page(page), WRITTEN)
        assert image.read(page) == some_page(page) + spare
    assert image.read(pages[0] - 1) == image.read(pages[-2] + 1) == b"\xff" * PAGE


def test_program_only_clears_bits(flash: Flash, image: NandImage) -> None:
    page = 2 * PAGES
    flash.control &= ~ECC_ON
    flash.program(page, b"\x0f" * DATA, b"\xff\xff\x0f\xff")
    flash.program(page, b"\x3c" * DATA, b"\xff\xff\x3c\xff")
    assert image.read(page) == b"\x0c" * DATA + b"\xff\xff\x0c".ljust(SPARE, b"\xff")


def test_erase_takes_its_block_and_no_other(flash: Flash, image: NandImage) -> None:
    for page in (4 * PAGES - 1, 4 * PAGES, 5 * PAGES - 1, 5 * PAGES):
        flash.program(page, some_page(1))
    assert flash.erase(4) == IDLE | WRITABLE
    assert {image.read(page) for page in range(4 * PAGES, 5 * PAGES)} == {b"\xff" * PAGE}
    for page in (4 * PAGES - 1, 5 * PAGES):
        assert flash.read(page) == (some_page(1), [0, 0, 0, 0])


def test_erase_of_the_last_block(flash: Flash, image: NandImage) -> None:
    page = BLOCKS * PAGES - 2
    flash.program(page, some_page(2))
    flash.erase(BLOCKS - 1)
    assert image.read(page) == b"\xff" * PAGE


def test_program_through_the_port_ends_with_the_page(flash: Flash, image: NandImage) -> None:
    page = 6 * PAGES + 1
    flash.command(0x80, DATA & 0xFF, DATA >> 8, page & 0xFF, page >> 8)
    for byte in range(SPARE + 2):
        flash.bus.write(PORT, byte)
    flash.command(0x10)
    flash.wait(PROGRAM_NS)
    assert image.read(page) == b"\xff" * DATA + bytes(range(SPARE))
    assert image.read(page + 1) == b"\xff" * PAGE


def test_random_read(flash: Flash) -> None:
    page = 7 * PAGES + 1
    flash.program(page, some_page(3))
    flash.seek(page)
    assert flash.get(2) == some_page(3)[:2]
    flash.command(0x05, 1000 & 0xFF, 1000 >> 8)
    flash.command(0xE0)
    assert flash.get(2) == some_page(3)[1000:1002]


@pytest.mark.parametrize(
    ("commands", "nanoseconds"),
    [((0x00, 0x30), READ_NS), ((0x80, 0x10), PROGRAM_NS), ((0x60, 0xD0), ERASE_NS)],
    ids=["read", "program", "erase"],
)
def test_busy_as_long_as_a_flash_is(flash: Flash, commands: tuple[int, int], nanoseconds: int) -> None:
    bus = flash.bus
    row = (8 * PAGES & 0xFF, 8 * PAGES >> 8)
    bus.write(INTEN, READY_EDGE)
    bus.write(INTSTS, READY_EDGE)
    flash.command(commands[0], *(row if commands[0] == 0x60 else (0, 0, *row)))
    assert bus.read(INTSTS) & (READY | READY_EDGE) == READY
    flash.command(commands[1])
    assert flash.status() == WRITABLE
    bus.step(nanoseconds - 1)
    assert bus.read(INTSTS) & (READY | READY_EDGE) == 0
    assert not bus.read(AIC_RAWSTS) & IRQ
    bus.step(1)
    assert bus.read(AIC_RAWSTS) & IRQ
    assert bus.read(INTSTS) & (READY | READY_EDGE) == READY | READY_EDGE
    assert flash.status() == WRITABLE | IDLE
    bus.write(INTSTS, READY_EDGE)
    assert not bus.read(AIC_RAWSTS) & IRQ


def test_busy_flash_hears_only_status_and_reset(flash: Flash) -> None:
    flash.command(0x60, 0, 0)
    flash.command(0xD0)
    flash.command(0x90, 0)
    assert flash.bus.read(PORT) == 0xFF
    assert "command 0x90 to a busy flash" in flash.bus.complaints
    flash.bus.write(INTSTS, READY_EDGE)
    flash.command(0xFF)
    assert flash.bus.read(INTSTS) & (READY | READY_EDGE) == READY | READY_EDGE
    flash.command(0x90, 0)
    assert flash.bus.read(PORT) == 0xEF


def test_write_protected(flash: Flash, image: NandImage) -> None:
    page = 9 * PAGES
    flash.program(page, some_page(4))
    flash.bus.write(ECTL, 0)
    assert flash.program(page + 1, some_page(4)) == IDLE
    assert flash.erase(9) == IDLE
    assert image.read(page)[:DATA] == some_page(4)
    assert image.read(page + 1) == b"\xff" * PAGE


def test_worn_block_fails_and_keeps_what_it_has(machine: Callable[..., Machine], image: NandImage) -> None:
    flash = Flash(machine("-global", "nand.worn-blocks=10,12-13"))
    for block, worn in ((10, True), (11, False), (12, True), (13, True), (14, False)):
        assert flash.program(block * PAGES, some_page(5)) == IDLE | WRITABLE | (FAILED if worn else 0)
        assert (image.read(block * PAGES) == b"\xff" * PAGE) == worn
        assert flash.erase(block) == IDLE | WRITABLE | (FAILED if worn else 0)
    flash.command(0xFF)
    assert flash.erase(11) == IDLE | WRITABLE


@pytest.mark.parametrize(
    ("register", "value"),
    [(MFP_C[0], 0x33333300), (GCTL, 0), (NANDCTL, CS0_OFF)],
    ids=["a pin elsewhere", "not enabled", "not selected"],
)
def test_flash_out_of_reach_answers_nothing(flash: Flash, register: int, value: int) -> None:
    before = flash.bus.read(register)
    flash.bus.write(register, value)
    flash.command(0x90, 0)
    assert flash.get(2) == b"\xff\xff"
    assert flash.bus.read(INTSTS) & READY
    flash.bus.write(register, before)
    flash.command(0x90, 0)
    assert flash.get(2) == b"\xef\xf1"


def test_without_a_flash(bus: Machine) -> None:
    flash = Flash(bus)
    flash.command(0x90, 0)
    assert flash.get(2) == b"\xff\xff"
    assert bus.read(INTSTS) & READY


# ---- the controller ------------------------------------------------------------------------------


def test_reset_values(bus: Machine) -> None:
    assert bus.read(NANDCTL) == 0x1E880090
    for register in (DMACTL, DMASA, DMABCNT, DMAINTEN, DMAINTSTS, GCTL, GINTEN, GINTSTS, INTEN, ECTL):
        assert bus.read(register) == 0
    assert bus.read(INTSTS) == READY


def test_page_size_brings_its_spare_size(bus: Machine) -> None:
    for code, spare in ((1, 64), (2, 128), (3, 256), (0, 16)):
        bus.write(NANDCTL, code << 16)
        assert bus.read(RACTL) == spare
    bus.write(RACTL, 20)
    bus.write(NANDCTL, 0)
    assert bus.read(RACTL) == 20


def test_spare_buffer_is_bytes(bus: Machine) -> None:
    bus.write_byte(RA + 2, 0x12)
    bus.write_byte(RA + 3, 0x34)
    assert bus.read(RA) == 0x3412FFFF
    bus.write(RA + 468, 0x01020304)
    assert bus.read_byte(RA + 471) == 1
    bus.write(NANDCTL, 1 << 9)
    assert (bus.read(RA), bus.read(RA + 468), bus.read(NANDCTL)) == (0xFFFFFFFF, 0x01020304, 0)


def test_ports_take_bytes(flash: Flash) -> None:
    flash.bus.write_byte(CMD, 0x90)
    flash.bus.write_byte(ADDR, 0)
    assert flash.bus.read_byte(PORT) == 0xEF


def test_spare_is_read_on_request(flash: Flash) -> None:
    page = 15 * PAGES
    flash.program(page, some_page(6))
    expected = flash.bus.read_memory(RA, SPARE)
    flash.bus.write_memory(RA, bytes(SPARE))
    flash.seek(page, DATA)
    flash.bus.write(NANDCTL, flash.control | READ_SPARE)
    assert flash.bus.read(NANDCTL) == flash.control
    assert flash.bus.read_memory(RA, SPARE) == expected == WRITTEN + parities(8, some_page(6), WRITTEN)


def test_spare_is_written_only_if_asked(flash: Flash, image: NandImage) -> None:
    page = 15 * PAGES + 1
    flash.control &= ~AUTO_WRITE
    flash.program(page, some_page(6))
    assert image.read(page) == some_page(6) + b"\xff" * SPARE
    assert flash.bus.read_memory(RA + 4, 60) == parities(8, some_page(6), WRITTEN)


def test_dma_waits_for_its_engine(flash: Flash) -> None:
    flash.seek(16 * PAGES)
    flash.control &= ~ECC_ON
    flash.bus.write(DMACTL, 0)
    flash.transfer(READ)
    assert not flash.bus.read(INTSTS) & DMA_DONE
    assert flash.bus.read(NANDCTL) & READ
    flash.bus.write(DMACTL, 1)
    assert flash.bus.read(INTSTS) & DMA_DONE
    assert not flash.bus.read(NANDCTL) & READ


def test_dma_done_interrupts(flash: Flash) -> None:
    flash.control &= ~ECC_ON
    flash.seek(16 * PAGES)
    flash.bus.write(INTEN, DMA_DONE)
    assert not flash.bus.read(AIC_RAWSTS) & IRQ
    flash.transfer(READ)
    assert flash.bus.read(AIC_RAWSTS) & IRQ
    flash.bus.write(INTSTS, DMA_DONE)
    assert not flash.bus.read(AIC_RAWSTS) & IRQ


def test_reset_of_the_controller_ends_its_interrupt(flash: Flash) -> None:
    flash.control &= ~ECC_ON
    flash.seek(16 * PAGES)
    flash.bus.write(INTEN, DMA_DONE)
    flash.transfer(READ)
    assert flash.bus.read(AIC_RAWSTS) & IRQ
    flash.bus.write(AHBIPRST, FMI_RESET)
    assert not flash.bus.read(AIC_RAWSTS) & IRQ


@pytest.mark.parametrize("way", [READ, WRITE], ids=["read", "write"])
@pytest.mark.parametrize(("enable", "flag"), [(DMAINTEN, DMAINTSTS), (GINTEN, GINTSTS)])
def test_bus_error_aborts(flash: Flash, way: int, enable: int, flag: int) -> None:
    bus = flash.bus
    bus.write(enable, 1)
    flash.seek(16 * PAGES)
    bus.write(DMASA, 0x90000000)
    bus.write(NANDCTL, flash.control | way)
    assert (bus.read(DMAINTSTS), bus.read(GINTSTS)) == (1, 1)
    assert bus.read(DMACTL) == 0
    assert not bus.read(NANDCTL) & way
    assert not bus.read(INTSTS) & DMA_DONE
    assert bus.read(AIC_RAWSTS) & IRQ
    bus.write(flag, 1)
    assert not bus.read(AIC_RAWSTS) & IRQ
    bus.write(DMACTL, 3)
    assert bus.read(DMACTL) == 1
    assert flash.read(16 * PAGES)[0] == b"\xff" * DATA


def test_what_is_not_modelled_is_logged_once(bus: Machine) -> None:
    for _ in range(2):
        bus.read(FMI + 0x820)
        bus.write(FMI, 1)
        bus.write(GCTL, 1 << 1)
    assert bus.complaints.count("0x820 is not modelled") == 1
    assert bus.complaints.count("0x0 is not modelled") == 1
    assert bus.complaints.count("0x800: bits 0x00000002 are not modelled") == 1


# ---- error correction ----------------------------------------------------------------------------


@pytest.mark.parametrize("t", sorted(T))
def test_parity_is_the_codes(machine: Callable[..., Machine], t: int) -> None:
    flash = Flash(machine(), t)
    data, spare = some_page(t), b"\xff\xa5\0\0"
    flash.program((20 + t) * PAGES, data, spare)
    made = RA + flash.spare - flash.parity
    assert flash.bus.read_memory(made, flash.parity) == parities(t, data, spare)
    flash.control &= ~PROTECT_3
    flash.program((20 + t) * PAGES + 1, data, spare)
    assert flash.bus.read_memory(made, flash.parity) == parities(t, data, bytes(3))


@pytest.mark.parametrize("t", sorted(T))
def test_every_kind_of_error_is_found(machine: Callable[..., Machine], t: int) -> None:
    """In the data, in the three bytes, in the parity, up to t bits; one more is reported."""
    flash = Flash(machine(), t)
    size = field_size(t)
    data, spare = some_page(100 + t), WRITTEN.ljust(flash.spare - flash.parity, b"\xff")
    spare += parities(t, data, spare)
    chance = random.Random(t)
    check = 8 * (DATA + flash.spare - flash.parity)
    first_field = [*range(8 * size), *range(8 * DATA, 8 * DATA + 24), *range(check, check + 15 * t)]
    last_field = range(8 * (DATA - size), 8 * DATA)
    cases = [
        [0],
        [8 * size - 1],
        [8 * DATA + 23],
        [check],
        [check + 15 * t - 1],
        chance.sample(first_field, t),
        chance.sample(last_field, t),
        chance.sample(first_field, t + 1),
    ]
    for number, bits in enumerate(cases):
        page = (50 + t) * PAGES + number
        wrong = turned(data + spare, bits)
        flash.program(page, wrong[:DATA])
        flash.bus.write_memory(RA, wrong[DATA:])
        flash.seek(page)
        flash.transfer(READ)
        corrected, errors = flash.finish_read()
        field = len(errors) - 1 if bits[0] in last_field else 0
        others = [0] * (len(errors) - 1)
        if len(bits) > t:
            assert errors[field] == -1
        else:
            assert errors.pop(field) == len({bit // 8 for bit in bits})
            assert errors == others
            assert corrected + flash.bus.read_memory(RA, flash.spare) == data + spare


def test_flips_in_the_image_up_to_eight_a_field(board: Callable[..., Machine], image: NandImage) -> None:
    drive = ("-drive", f"if=mtd,format=raw,file={image.path}")
    chance = random.Random(7)
    first = board(*drive, registers=True)
    flash = Flash(first)
    for bits in range(10):
        flash.program(80 * PAGES + bits, some_page(bits))
    first.close()
    flipped = {}
    for bits in range(10):
        # As many bits as said, in as many bytes, in the second field; and one in the fourth.
        flipped[bits] = [8 * byte + chance.randrange(8) for byte in chance.sample(range(512, 1024), bits)]
        image.flip(80 * PAGES + bits, [*flipped[bits], 8 * 1600])
    flash = Flash(board(*drive, registers=True))
    for bits in range(9):
        assert flash.read(80 * PAGES + bits) == (some_page(bits), [0, bits, 0, 1])
    data, errors = flash.read(80 * PAGES + 9)
    assert errors == [0, -1, 0, 1]
    assert data == turned(some_page(9), flipped[9])


def test_an_error_holds_the_transfer(flash: Flash) -> None:
    """Until its flag is cleared; then the next field's comes, with registers of its own."""
    bus, page = flash.bus, 81 * PAGES
    flash.control &= ~PROTECT_3
    flash.program(page, some_page(8))
    good = bus.read_memory(RA, SPARE)
    flash.program(page + 1, turned(some_page(8), [8 * 600, 8 * 600 + 7, 8 * 2047 + 6]))
    bus.write_memory(RA, good)
    bus.write(INTEN, DMA_DONE | ECC_ERROR)
    flash.seek(page + 1)
    flash.transfer(READ)
    assert bus.read(INTSTS) & (DMA_DONE | ECC_ERROR) == ECC_ERROR
    assert bus.read(NANDCTL) & READ
    assert bus.read(DMACTL) == 0x201
    assert bus.read(DMABCNT) == 1024
    assert bus.read(STATUS) == (1 << 2 | 1) << 8
    assert (bus.read(ERROR_ADDRESS), bus.read(ERROR_DATA)) == (600 - 512, 0x81)
    assert bus.read(AIC_RAWSTS) & IRQ
    bus.write(INTSTS, ECC_ERROR)
    assert bus.read(INTSTS) & (DMA_DONE | ECC_ERROR) == ECC_ERROR
    assert bus.read(STATUS) == (1 << 2 | 1) << 24
    assert (bus.read(ERROR_ADDRESS), bus.read(ERROR_DATA)) == (2047 - 1536, 0x02)
    bus.write(INTSTS, ECC_ERROR)
    assert bus.read(INTSTS) & (DMA_DONE | ECC_ERROR) == DMA_DONE
    assert (bus.read(STATUS), bus.read(DMACTL), bus.read(DMABCNT)) == (0, 1, 0)


def test_reset_ends_a_held_transfer(flash: Flash) -> None:
    """As the vendor's drivers do after an uncorrectable error, in Linux's order."""
    bus = flash.bus
    flash.program(82 * PAGES, some_page(9))
    flash.seek(82 * PAGES)
    bus.write_memory(RA, bytes(SPARE))
    flash.transfer(READ)
    assert bus.read(STATUS) & 3 == 2
    bus.write(DMACTL, 3)
    bus.write(NANDCTL, bus.read(NANDCTL) | 1)
    bus.write(INTSTS, ECC_ERROR)
    assert bus.read(INTSTS) & (DMA_DONE | ECC_ERROR) == 0
    assert bus.read(DMACTL) == 1
    assert flash.read(82 * PAGES) == (some_page(9), [0, 0, 0, 0])


def test_unused_page_is_no_error_if_so_asked(flash: Flash) -> None:
    page = 83 * PAGES
    assert flash.read(page) == (b"\xff" * DATA, [-1, -1, -1, -1])
    flash.control |= SKIP_UNUSED
    assert flash.read(page) == (b"\xff" * DATA, [0, 0, 0, 0])
    flash.program(page, turned(some_page(1), [5]))
    flash.start_read(page)
    flash.finish_read()
    spare = flash.bus.read_memory(RA, SPARE)
    for marker, unused in ((b"\0\xff", False), (b"\x01\xff", True)):
        flash.bus.write_memory(RA, spare[:2] + marker + bytes(60))
        flash.seek(page)
        flash.transfer(READ)
        assert (flash.finish_read()[1] == [0, 0, 0, 0]) == unused


def test_without_ecc(flash: Flash, image: NandImage) -> None:
    page = 84 * PAGES
    flash.control &= ~ECC_ON
    flash.program(page, some_page(1), WRITTEN + b"\x55" * 60)
    assert image.read(page) == some_page(1) + WRITTEN.ljust(SPARE, b"\xff")
    assert flash.read(page) == (some_page(1), [0, 0, 0, 0])


def test_parity_without_room_is_refused(flash: Flash) -> None:
    flash.control = flash.control & ~T[8] | T[15]
    flash.program(85 * PAGES, some_page(1))
    assert "asks for a parity that 2048 bytes with 64 spare cannot have" in flash.bus.complaints


# ---- a hostile guest -----------------------------------------------------------------------------


def test_copy_back_stays_within_the_page(flash: Flash) -> None:
    flash.seek(88 * PAGES)
    flash.get(1)  # the whole page is there
    for column in range(0x400, PAGE, 0x40):
        flash.command(0x85, column & 0xFF, column >> 8, 0, 88)
        for _ in range(PAGE - column + 1):
            flash.bus.write(PORT, 0x5A)
    flash.command(0x10)
    flash.wait(PROGRAM_NS)
    flash.command(0x90, 0)
    assert flash.get(2) == b"\xef\xf1"


def test_what_goes_in_is_not_read_beyond_the_buffer(flash: Flash) -> None:
    flash.seek(88 * PAGES)
    flash.get(PAGE - 1)
    flash.command(0x80)
    for _ in range(PAGE):
        flash.bus.write(PORT, 0)
    assert flash.get(PAGE) == bytes(PAGE)


def test_address_cycles_that_are_too_many_do_nothing(flash: Flash) -> None:
    page = 89 * PAGES
    flash.program(page, some_page(1))
    flash.command(0x00, 0, 0, page & 0xFF, page >> 8, 0, *[7] * 8)
    flash.command(0x30)
    flash.wait(READ_NS)
    assert flash.get(16) == some_page(1)[:16]


# ---- a snapshot ----------------------------------------------------------------------------------


def test_saved_while_the_flash_is_busy(flash: Flash, reborn: Callable[[Machine], Machine]) -> None:
    flash.bus.write(INTEN, READY_EDGE)
    flash.bus.write(INTSTS, READY_EDGE)
    flash.command(0x60, 86 * PAGES & 0xFF, 86 * PAGES >> 8)
    flash.command(0xD0)
    flash.bus.step(ERASE_NS // 2)
    flash.bus = reborn(flash.bus)
    assert flash.status() == WRITABLE
    flash.bus.step(ERASE_NS // 2 - 1)
    assert flash.status() == WRITABLE
    assert not flash.bus.read(AIC_RAWSTS) & IRQ
    flash.bus.step(1)
    assert flash.bus.read(AIC_RAWSTS) & IRQ
    assert flash.status() == WRITABLE | IDLE


def test_saved_while_an_error_holds_a_transfer(flash: Flash, reborn: Callable[[Machine], Machine]) -> None:
    page = 87 * PAGES
    flash.program(page, some_page(1))
    good = flash.bus.read_memory(RA, SPARE)
    flash.program(page + 1, turned(some_page(1), [8 * 600, 8 * 1600]))
    flash.bus.write_memory(RA, good)
    flash.seek(page + 1)
    flash.transfer(READ)
    flash.bus = reborn(flash.bus)
    assert flash.finish_read() == (some_page(1), [0, 1, 0, 1])
    assert flash.bus.read_memory(RA, SPARE) == good
    flash.command(0x90, 0)
    assert flash.get(2) == b"\xef\xf1"


# ---- the image -----------------------------------------------------------------------------------


def test_image_outlives_the_machine(board: Callable[..., Machine], image: NandImage, qemu: Path) -> None:
    """Also in an overlay, whose base stays as it is."""
    overlay = image.path.with_suffix(".qcow2")
    subprocess.run(
        [qemu.with_name("qemu-img"), "create", "-q", "-f", "qcow2", "-F", "raw", "-b", image.path, overlay],
        check=True,
    )
    page = 90 * PAGES + 1
    for drive in (f"format=qcow2,file={overlay}", f"format=raw,file={image.path}"):
        first = board("-drive", f"if=mtd,{drive}", registers=True)
        assert Flash(first).program(page, some_page(2)) == IDLE | WRITABLE
        assert (image.read(page) == b"\xff" * PAGE) == ("qcow2" in drive)
        first.process.terminate()  # not kill: a qcow2's tables are written at the end
        first.process.wait()
        first.close()
        again = board("-drive", f"if=mtd,{drive}", registers=True)
        assert Flash(again).read(page) == (some_page(2), [0, 0, 0, 0])
        again.close()


@pytest.mark.parametrize("size", [0, DATA * PAGES * BLOCKS, SIZE - 512, SIZE + 512])
def test_image_of_another_size_is_refused(board: Callable[..., Machine], tmp_path: Path, size: int) -> None:
    path = tmp_path / "nand.img"
    with path.open("wb") as file:
        file.truncate(size)
    with pytest.raises(MachineError, match=f"has {size} bytes instead of {SIZE}, which are 65536 pages"):
        board("-drive", f"if=mtd,format=raw,file={path}", registers=True)
    with pytest.raises(NandError, match=f"has {size} bytes: a raw image has {SIZE}"):
        NandImage(path)


def test_image_of_zeros_is_refused(board: Callable[..., Machine], tmp_path: Path) -> None:
    path = tmp_path / "nand.img"
    with path.open("wb") as file:
        file.truncate(SIZE)
    with pytest.raises(MachineError, match="full of zeros: an erased NAND is full of 0xff"):
        board("-drive", f"if=mtd,format=raw,file={path}", registers=True)


def test_marked_blocks(flash: Flash, image: NandImage) -> None:
    image.mark_bad(95)
    assert image.bad_blocks() == [95]
    for block, mark in ((94, 0xFF), (95, 0)):
        flash.seek(block * PAGES, DATA)
        assert flash.get(1)[0] == mark
    image.write(95 * PAGES, b"\xff", start=DATA)


def test_places_outside_the_image(image: NandImage) -> None:
    for page in (-1, PAGES * BLOCKS):
        with pytest.raises(NandError, match="the flash has pages 0 to 65535"):
            image.read(page)
    with pytest.raises(NandError, match="a page has 2112"):
        image.write(0, b"ab", start=PAGE - 1)
    with pytest.raises(NandError, match="a page has 16896"):
        image.flip(0, [8 * PAGE])
    with pytest.raises(NandError, match="is not there"):
        NandImage(image.path.with_name("none"))


# ---- the boot ROM --------------------------------------------------------------------------------

ENTRY = 0x200
DDR_VALUES = bytes.fromhex("55aa55aa 02000000 002000b0 01000000 042000b0 02000000".replace(" ", ""))
# ldr r0, =RESULT; ldr r1, =magic; str r1, [r0]; b .
RESULT, MAGIC = 0x8000, 0x600DB007
PROGRAM = struct.pack("<6I", 0xE59F0008, 0xE59F1008, 0xE5801000, 0xEAFFFFFE, RESULT, MAGIC)


def boot_image(program: bytes, values: bytes = DDR_VALUES, size: int | None = None) -> bytes:
    """As NuWriter writes it: header, values for the DDR controller, filled to 16 bytes, code."""
    header = struct.pack("<4s3I16x", b" TVN", ENTRY, size or len(program), 0xFFFFFFFF)
    return header + values.ljust(-(-len(values) // 16) * 16, b"\0") + program


def put_boot_image(image: NandImage, block: int, content: bytes) -> None:
    for number in range(0, len(content), DATA):
        data = content[number : number + DATA].ljust(DATA, b"\xff")
        image.write(block * PAGES + number // DATA, data + WRITTEN + parities(8, data, WRITTEN))


@pytest.fixture
def boot(board: Callable[..., Machine], image: NandImage) -> Iterator[Callable[[], Machine]]:
    def start() -> Machine:
        drive = f"if=mtd,format=raw,file={image.path}"
        return board("-drive", drive, options="boot-source=nand", uarts=())

    yield start
    for page in range(4 * PAGES):
        image.write(page, b"\xff" * PAGE)


def wait_for_result(machine: Machine) -> None:
    deadline = time.monotonic() + ANSWER_SECONDS
    while machine.read(RESULT) != MAGIC:
        assert time.monotonic() < deadline, machine.info("registers")


def test_boot_from_nand(boot: Callable[[], Machine], image: NandImage) -> None:
    """Code of more than a page, with wrong bits in it."""
    put_boot_image(image, 0, boot_image(PROGRAM + some_page(1) + some_page(2)))
    image.flip(0, [8 * 70, 8 * 600, 8 * 2100])
    image.flip(1, range(0, 800, 100))
    machine = boot()
    wait_for_result(machine)
    start = ENTRY + len(PROGRAM)
    assert machine.read_memory(start, 2 * DATA) == some_page(1) + some_page(2)
    machine.write(RESULT, 0)
    machine.command("system_reset")
    wait_for_result(machine)


def test_boot_from_the_first_good_block(boot: Callable[[], Machine], image: NandImage) -> None:
    wrong = b"\xfe\xff\xff\xea" * 600  # b .
    put_boot_image(image, 0, boot_image(wrong))
    image.flip(1, range(0, 90, 10))
    put_boot_image(image, 1, b"no header".ljust(DATA))
    put_boot_image(image, 2, boot_image(wrong * 60, size=PAGES * DATA)[: PAGES * DATA])  # to beyond its end
    put_boot_image(image, 3, boot_image(PROGRAM, values=b""))
    wait_for_result(boot())


def test_nothing_to_boot(boot: Callable[[], Machine]) -> None:
    machine = boot()
    assert "blocks 0 to 3 have no code to boot" in machine.output


@pytest.mark.parametrize(
    ("arguments", "options", "words"),
    [
        ([], "boot-source=nand", "needs a NAND image"),
        (["-kernel", "none"], "boot-source=nand", "cannot go with -kernel or -bios"),
        ([], "boot-source=usb", "is nand or none, not usb"),
    ],
)
def test_boot_source_that_cannot_be(
    board: Callable[..., Machine], arguments: list[str], options: str, words: str
) -> None:
    with pytest.raises(MachineError, match=words):
        board(*arguments, options=options, registers=True)
