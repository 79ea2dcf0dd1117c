# SPDX-License-Identifier: GPL-3.0-or-later
"""A guest, or a saved state, that means harm: whatever it does, QEMU lives."""

import random
import re
import struct
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest
from qemu.qmp import QMPError

from nuc980.twin.machine import Machine
from nuc980.twin.nand import SIZE

Start = Callable[..., Machine]
Reborn = Callable[[Machine], Machine]

# ---- a random walk over all registers ------------------------------------------------------------

STEPS = 20000
RINGS = 0x100000  # where descriptors lie
RAM_END = 0x04000000

# Where something happens, in windows that are mostly empty
BUSY = {
    "nuc980-pdma": (*range(0, 0xA0, 4), *range(0x400, 0x48C, 4)),
    "nuc980-emac": (0x00, 0x04, 0x88, 0x8C, 0x90, 0x94, 0x98, 0xA0, 0xA4, 0xAC, 0xB0),
    "nuc980-fmi": (0x400, 0x408, 0x800, 0x8A0, 0x8A8, 0x8AC, 0x8B0, 0x8B4, 0x8B8, 0x8BC, 0x8C0, 0xA00),
}
KEYS = (0x59, 0x16, 0x88, 0x5AA5, 0xA965)  # of the write protection, the watchdogs, the RTC
FLASH = (0x00, 0x30, 0x80, 0x85, 0x10, 0x60, 0xD0, 0x90, 0xFF)  # commands

PINS = {
    0xB000009C: 0x11000,  # UART0
    0xB0000080: 0x33333330,  # NAND
    0xB0000084: 0x33333333,
    **dict.fromkeys((0xB0000090, 0xB0000098), 0x11111111),  # both EMACs
}


def windows(machine: Machine) -> list[tuple[str, int, int]]:
    """Name, address and size of each device's registers, as QEMU has them."""
    lines = re.findall(
        r"([0-9a-f]{16})-([0-9a-f]{16}) \(prio \d+, i/o\): (nuc980-\S+)", machine.info("mtree -f")
    )
    return [(name, int(first, 16), int(last, 16) + 1 - int(first, 16)) for first, last, name in lines]


class Guest:
    def __init__(self, seed: int) -> None:
        self.random = random.Random(seed)

    def value(self) -> int:
        pick = self.random
        return pick.choice(
            (
                0,
                1,
                0xFFFFFFFF,
                1 << pick.randrange(32),
                1 << pick.randrange(32) | 1 << pick.randrange(32) | pick.randrange(16),
                RINGS + 16 * pick.randrange(64),
                RAM_END - pick.choice((0, 4, 16, 64, 2048)),
                0xB0000000 + 4 * pick.randrange(0x2C000),
                pick.choice(KEYS),
                pick.choice(FLASH),
                pick.randrange(256),
                pick.getrandbits(32),
            )
        )

    def rings(self) -> bytes:
        """Words that can be descriptors: half of them belong to the device."""
        owners = (self.value() | self.random.choice((0, 1 << 31)) for _ in range(64))
        return b"".join(struct.pack("<4I", owner, *(self.value() for _ in range(3))) for owner in owners)

    def address(self, name: str, first: int, size: int) -> int:
        if name in BUSY and self.random.random() < 0.8:
            return first + self.random.choice(BUSY[name])
        return first + self.random.randrange(size) // 4 * 4

    def walk(self, machine: Machine) -> None:
        blocks = windows(machine)
        assert len({name for name, _, _ in blocks}) > 12
        for step in range(STEPS):
            if step % 500 == 0:
                machine.write_memory(RINGS, self.rings())
                machine.uarts[0].send(bytes(64))
                for register, value in PINS.items():
                    machine.write(register, value)
            address = self.address(*self.random.choice(blocks))
            match self.random.randrange(10):
                case 0 | 1 | 2:
                    machine.read(address)
                case 3:
                    machine.write_byte(address, self.value() & 0xFF)
                case 4:
                    machine.step(self.random.choice((1, 1000, 100_000)))
                case _:
                    machine.write(address, self.value())


@pytest.mark.parametrize("seed", range(4))
def test_random_walk(board: Start, reborn: Reborn, tmp_path: Path, seed: int) -> None:
    flash = tmp_path / "nand"
    with flash.open("wb") as file:
        file.write(b"\xff")
        file.truncate(SIZE)
    machine = board(
        "-drive", f"if=mtd,format=raw,file={flash}", "-nic", "user,restrict=on",
        "-device", "w25q64,bus=ssi.1", registers=True,
    )  # fmt: skip
    Guest(seed).walk(machine)
    again = reborn(machine)  # what a guest can get to can also be saved
    assert again.command("query-status")["status"] == "running"
    assert again.read(0xB0000000) == 0x1030D016


# ---- saved states --------------------------------------------------------------------------------

UART, SPI, ETIMER, RTC, FMI = 0xB0070000, 0xB0060000, 0xB0050000, 0xB0041000, 0xB0019000
Change = Callable[[bytes], bytes]


@pytest.fixture
def refuses(board: Start, tmp_path: Path) -> Callable[..., None]:
    """Saves a machine's state, replaces one place of it, and sees that it is not loaded."""

    def check(machine: Machine, place: bytes, wrong: bytes, *arguments: str | Path) -> None:
        assert len(place) == len(wrong)
        state = tmp_path / "state"
        machine.save(state)
        content = state.read_bytes()
        assert content.count(place) == 1
        state.write_bytes(content.replace(place, wrong))
        machine.close()
        new = board(*arguments, registers=True, incoming=True)
        with suppress(EOFError, OSError, QMPError):  # it ends
            new.load(state)
        assert new.process.wait(20) == 1
        assert "Invalid argument" in new.output

    return check


def words(*values: int) -> bytes:
    return struct.pack(f">{len(values)}I", *values)


@pytest.mark.parametrize(("head", "count"), [(16, 1), (0, 17), (0xFFFFFFFF, 16)])
def test_uart_fifo(bus: Machine, refuses: Callable[..., None], head: int, count: int) -> None:
    for char in b"sixteen letters!":
        bus.write(UART, char)  # the first one leaves the FIFO
    place = b"sixteen letters!"
    refuses(bus, place + words(1, 15), place + words(head, count))


def test_uart_line_that_receives_nothing(bus: Machine, refuses: Callable[..., None]) -> None:
    bus.write(0xB000009C, 0x11000)
    bus.write(UART + 0x24, 0x30000066)
    bus.uarts[0].send(b"QRS")
    for _ in range(1000):  # qtest's words and the line's are not in step
        if not bus.read(UART + 0x18) >> 29 & 1:
            break
    wire = b"\0Q\0R\0S".ljust(2 * 1024, b"\0")
    refuses(bus, wire + words(0, 3), wire + words(0, 0))


@pytest.mark.parametrize(("head", "count"), [(32, 4), (0, 36), (1, 32), (0, 30)])
def test_spi_fifo(bus: Machine, refuses: Callable[..., None], head: int, count: int) -> None:
    sent = range(0x13579B00, 0x13579B08)
    for word in sent:
        bus.write(SPI + 0x20, word)
    place = struct.pack("<8I", *sent)
    refuses(bus, place + words(0, 32), place + words(head, count))


def test_etimer_prescaler(bus: Machine, refuses: Callable[..., None]) -> None:
    bus.write(ETIMER + 4, 0xA5)
    bus.write(ETIMER + 8, 0x123456)
    refuses(bus, words(0xA5, 0x123456), words(0xFFFFFFFF, 0x123456))


def test_rtc_tick(bus: Machine, refuses: Callable[..., None]) -> None:
    bus.write(RTC + 4, 0xA965)
    bus.write(RTC + 0x20, 0x80123456)
    bus.write(RTC + 0x30, 5)
    refuses(bus, words(0x80123456, 0, 0, 5), words(0x80123456, 0, 0, 30))


@pytest.mark.parametrize(("length", "cycles"), [(-1, 4), (2113, 4), (0x7FFFFFFF, 4), (0x71D, 6), (0x71D, -1)])
def test_nand_page(
    board: Start, refuses: Callable[..., None], tmp_path: Path, length: int, cycles: int
) -> None:
    flash = tmp_path / "nand"
    with flash.open("wb") as file:
        file.write(b"\xff")
        file.truncate(SIZE)
    drive = ("-drive", f"if=mtd,format=raw,file={flash},file.locking=off")
    machine = board(*drive, registers=True)
    for register, value in PINS.items():
        machine.write(register, value)
    machine.write(FMI + 0x800, 8)
    machine.write(FMI + 0x8A0, 0x10000)
    machine.write(FMI + 0x8B0, 0x00)
    for byte in (0x23, 0x01, 0, 0):
        machine.write(FMI + 0x8B4, byte)
    machine.write(FMI + 0x8B0, 0x30)
    machine.step(1_000_000)
    machine.read(FMI + 0x8B8)

    def place(left: int, addrlen: int) -> bytes:
        return struct.pack(">IiIQi", 0x124, left, 0, 0x124, addrlen)

    refuses(machine, place(2112 - 0x124, 4), place(length, cycles), *drive)
