# SPDX-License-Identifier: GPL-3.0-or-later
"""SPI controllers: FIFOs, flags, interrupts, and a flash chip on the bus."""

from collections.abc import Callable

import pytest

from nuc980.twin.machine import Machine

QSPI0, SPI0, SPI1 = 0xB0060000, 0xB0061000, 0xB0062000
SOURCES = {QSPI0: 51, SPI0: 52, SPI1: 50}
CTL, CLKDIV, SSCTL, PDMACTL, FIFOCTL, STATUS, TX, RX = 0x00, 0x04, 0x08, 0x0C, 0x10, 0x14, 0x20, 0x30
SPIEN, UNITIEN, SLAVE, REORDER, DATDIR, QUADIOEN = 1, 1 << 17, 1 << 18, 1 << 19, 1 << 20, 1 << 22
BUSY, UNITIF, RXEMPTY, RXFULL, RXTHIF, RXOVIF = 1, 1 << 1, 1 << 8, 1 << 9, 1 << 10, 1 << 11
SPIENSTS, TXEMPTY, TXFULL, TXTHIF = 1 << 15, 1 << 16, 1 << 17, 1 << 18
RXRST, TXRST, RXTHIEN, TXTHIEN, RXOVIEN, RXFBCLR, TXFBCLR = 1, 2, 1 << 2, 1 << 3, 1 << 5, 1 << 8, 1 << 9
SS0, SS1, SSACTPOL, AUTOSS = 1, 2, 4, 8
DEPTH = 8
W25Q64 = [0xEF, 0x40, 0x17]  # its JEDEC identification
READ_ID = 0x9F


def width(bits: int) -> int:
    return (bits % 32) << 8


def counts(bus: Machine) -> tuple[int, int]:
    status = bus.read(SPI0 + STATUS)
    return status >> 28, status >> 24 & 0xF


def interrupt(bus: Machine, base: int = SPI0) -> bool:
    return bool(bus.read(0xB0042104) >> SOURCES[base] - 32 & 1)


@pytest.mark.parametrize("base", SOURCES)
def test_empty_bus_reads_ones(bus: Machine, base: int) -> None:
    """What the vendor's U-Boot does before it says that there is no flash."""
    bus.write(base + CTL, width(8) | 5)
    bus.write(base + FIFOCTL, bus.read(base + FIFOCTL) | RXRST | TXRST)
    assert bus.read(base + STATUS) & (SPIENSTS | RXEMPTY | TXFULL | BUSY) == SPIENSTS | RXEMPTY
    bus.write(base + SSCTL, 1)
    for _ in range(20):
        bus.write(base + TX, READ_ID)
        assert not bus.read(base + STATUS) & RXEMPTY
        assert bus.read(base + RX) == 0xFF
    assert bus.read(base + STATUS) & BUSY == 0


@pytest.mark.parametrize(("bits", "ones"), [(8, 0xFF), (12, 0xFFF), (16, 0xFFFF), (32, 0xFFFFFFFF)])
def test_unit_has_the_programmed_width(bus: Machine, bits: int, ones: int) -> None:
    bus.write(SPI0 + CTL, width(bits) | SPIEN)
    bus.write(SPI0 + TX, 0)
    assert bus.read(SPI0 + RX) == ones


def test_units_wait_until_the_controller_is_on(bus: Machine) -> None:
    assert bus.read(SPI0 + STATUS) & (TXEMPTY | RXEMPTY | SPIENSTS | BUSY) == TXEMPTY | RXEMPTY
    bus.write(SPI0 + CTL, width(8))
    for sent in range(1, DEPTH + 1):
        bus.write(SPI0 + TX, sent)
        assert counts(bus) == (sent, 0)
    assert bus.read(SPI0 + STATUS) & (TXEMPTY | TXFULL | BUSY) == TXFULL
    bus.write(SPI0 + TX, 0)
    assert "TX written while full" in bus.complaints
    bus.write(SPI0 + CTL, width(8) | SPIEN)
    assert counts(bus) == (0, DEPTH)
    assert bus.read(SPI0 + STATUS) & (TXEMPTY | RXFULL | RXOVIF | UNITIF) == TXEMPTY | RXFULL | UNITIF


def test_receive_overrun(bus: Machine) -> None:
    bus.write(SPI0 + CTL, width(8) | SPIEN)
    for _ in range(DEPTH + 1):
        bus.write(SPI0 + TX, 0)
    assert bus.read(SPI0 + STATUS) & RXOVIF
    bus.write(SPI0 + STATUS, UNITIF)
    assert bus.read(SPI0 + STATUS) & (RXOVIF | UNITIF) == RXOVIF
    bus.write(SPI0 + STATUS, RXOVIF)
    assert bus.read(SPI0 + STATUS) & RXOVIF == 0
    for left in range(DEPTH, 0, -1):
        assert counts(bus) == (0, left)
        bus.read(SPI0 + RX)
    bus.read(SPI0 + RX)
    assert "RX read while empty" in bus.complaints


@pytest.mark.parametrize(
    ("clear", "left"),
    [(RXRST, (2, 0)), (TXRST, (0, 2)), (RXFBCLR, (2, 0)), (TXFBCLR, (0, 2)), (RXRST | TXRST, (0, 0))],
)
def test_fifos_are_cleared(bus: Machine, clear: int, left: tuple[int, int]) -> None:
    bus.write(SPI0 + CTL, width(8) | SPIEN)
    for _ in range(2):
        bus.write(SPI0 + TX, 0)
    bus.write(SPI0 + CTL, width(8))
    for _ in range(2):
        bus.write(SPI0 + TX, 0)
    assert counts(bus) == (2, 2)
    bus.write(SPI0 + FIFOCTL, clear)
    assert counts(bus) == left
    assert bus.read(SPI0 + FIFOCTL) == 0


@pytest.mark.parametrize("base", SOURCES)
def test_unit_interrupt(bus: Machine, base: int) -> None:
    bus.write(base + CTL, width(8) | SPIEN)
    bus.write(base + TX, 0)
    assert not interrupt(bus, base)
    bus.write(base + CTL, width(8) | SPIEN | UNITIEN)
    assert interrupt(bus, base)
    bus.write(base + STATUS, UNITIF)
    assert not interrupt(bus, base)


def test_threshold_interrupts(bus: Machine) -> None:
    bus.write(SPI0 + FIFOCTL, 2 << 28 | 1 << 24)
    bus.write(SPI0 + CTL, width(8) | SPIEN)
    for received in range(1, 4):
        bus.write(SPI0 + TX, 0)
        assert bool(bus.read(SPI0 + STATUS) & RXTHIF) == (received > 1)
        bus.write(SPI0 + FIFOCTL, 2 << 28 | 1 << 24 | RXTHIEN)
        assert interrupt(bus) == (received > 1)
    bus.write(SPI0 + CTL, width(8))
    for waiting in range(5):
        bus.write(SPI0 + FIFOCTL, 2 << 28 | 1 << 24 | TXTHIEN)
        assert bool(bus.read(SPI0 + STATUS) & TXTHIF) == interrupt(bus) == (waiting <= 2)
        bus.write(SPI0 + TX, 0)


def test_overrun_interrupt(bus: Machine) -> None:
    bus.write(SPI0 + FIFOCTL, RXOVIEN)
    bus.write(SPI0 + CTL, width(8) | SPIEN)
    for sent in range(DEPTH + 1):
        assert not interrupt(bus), sent
        bus.write(SPI0 + TX, 0)
    assert interrupt(bus)


def test_nothing_comes_in_while_quad_data_go_out(bus: Machine) -> None:
    bus.write(SPI0 + CTL, width(8) | SPIEN | QUADIOEN | DATDIR)
    bus.write(SPI0 + TX, 0)
    assert counts(bus) == (0, 0)
    bus.write(SPI0 + CTL, width(8) | SPIEN | QUADIOEN)
    bus.write(SPI0 + TX, 0)
    assert counts(bus) == (0, 1)


def test_what_is_not_modelled_is_told_once(bus: Machine) -> None:
    for _ in range(2):
        bus.write(SPI0 + CTL, SLAVE)
        bus.write(SPI0 + PDMACTL, 3)
        bus.read(SPI0 + 0x18)
        bus.write(SPI1 + PDMACTL, 1)
    told = [line.split() for line in bus.complaints.splitlines() if "ssi." in line]
    assert [(line[0].rstrip(":"), line[2]) for line in told] == [
        ("ssi.1", "0x0"), ("ssi.1", "0xc"), ("ssi.1", "0x18"), ("ssi.2", "0xc")
    ]  # fmt: skip


# ---- a flash chip


@pytest.fixture
def flash(board: Callable[..., Machine]) -> Machine:
    return board("-device", "w25q64,bus=ssi.1", registers=True)


def exchange(machine: Machine, *data: int) -> list[int]:
    answers = []
    for byte in data:
        machine.write(SPI0 + TX, byte)
        answers.append(machine.read(SPI0 + RX))
    return answers


def test_flash_says_who_it_is(flash: Machine) -> None:
    flash.write(SPI0 + CTL, width(8) | SPIEN)
    for _ in range(2):
        flash.write(SPI0 + SSCTL, SS0)
        assert exchange(flash, READ_ID, 0, 0, 0)[1:] == W25Q64
        flash.write(SPI0 + SSCTL, 0)


@pytest.mark.parametrize("select", [0, SS1, SSACTPOL | SS0])
def test_flash_that_is_not_selected_is_silent(flash: Machine, select: int) -> None:
    flash.write(SPI0 + CTL, width(8) | SPIEN)
    flash.write(SPI0 + SSCTL, select)
    assert exchange(flash, READ_ID, 0, 0, 0) == [0, 0, 0, 0]


@pytest.mark.parametrize(("reorder", "answer"), [(0, 0x00EF4017), (REORDER, 0x1740EF00)])
def test_wide_unit_goes_by_bytes_selected_by_itself(flash: Machine, reorder: int, answer: int) -> None:
    flash.write(SPI0 + SSCTL, AUTOSS | SS0)
    flash.write(SPI0 + CTL, width(32) | reorder | SPIEN)
    for _ in range(2):  # between the two the flash is released
        flash.write(SPI0 + TX, READ_ID if reorder else READ_ID << 24)
        assert flash.read(SPI0 + RX) == answer


def test_state_is_saved(flash: Machine, reborn: Callable[[Machine], Machine]) -> None:
    flash.write(SPI0 + CTL, width(8) | SPIEN | UNITIEN)
    flash.write(SPI0 + SSCTL, SS0)
    for byte in (READ_ID, 0, 0):
        flash.write(SPI0 + TX, byte)
    new = reborn(flash)
    assert counts(new) == (0, 3)
    assert interrupt(new)
    new.write(SPI0 + TX, 0)
    assert [new.read(SPI0 + RX) for _ in range(4)] == [0, *W25Q64]
    new.write(SPI0 + STATUS, UNITIF)
    assert not interrupt(new)
