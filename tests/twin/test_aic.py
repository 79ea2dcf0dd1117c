# SPDX-License-Identifier: GPL-3.0-or-later
"""The interrupt controller: which source comes first, and how each is masked, taken and told."""

from collections.abc import Callable

import pytest

from nuc980.twin.machine import Machine

AIC = 0xB0042000
SRCCTL = AIC
RAWSTS, ACTSTS, INTSTS = AIC + 0x100, AIC + 0x108, AIC + 0x110
IRQNUM, FIQNUM = AIC + 0x120, AIC + 0x124
INTMSK, INTEN, INTDIS = AIC + 0x128, AIC + 0x130, AIC + 0x138
EOIS, EOFS = AIC + 0x150, AIC + 0x154

LOW, HIGH, FALLING, RISING = 0x00, 0x40, 0x80, 0xC0


def drive(bus: Machine, source: int, level: int) -> None:
    bus.set_line("aic", "unnamed-gpio-in", level, number=source)


def write_bit(bus: Machine, register: int, source: int) -> None:
    bus.write(register + 4 * (source // 32), 1 << source % 32)


def bit(bus: Machine, register: int, source: int) -> int:
    return bus.read(register + 4 * (source // 32)) >> source % 32 & 1


def control(bus: Machine, source: int, value: int) -> None:
    register, shift = SRCCTL + source // 4 * 4, source % 4 * 8
    bus.write(register, bus.read(register) & ~(0xFF << shift) | value << shift)


@pytest.mark.parametrize("register", range(16))
def test_after_reset_all_are_level_high_of_the_last_priority(bus: Machine, register: int) -> None:
    assert bus.read(SRCCTL + 4 * register) == 0x47474747


def test_after_reset_nothing_is_enabled(bus: Machine) -> None:
    drive(bus, 36, 1)
    assert bus.read(INTMSK) == bus.read(INTMSK + 4) == bus.read(IRQNUM) == 0
    assert bit(bus, RAWSTS, 36) == bit(bus, ACTSTS, 36) == 1
    assert bit(bus, INTSTS, 36) == 0


@pytest.mark.parametrize("source", [1, 31, 32, 63])
def test_enabled_source_is_told_until_its_line_falls(bus: Machine, source: int) -> None:
    write_bit(bus, INTEN, source)
    assert bit(bus, INTMSK, source) == 1
    drive(bus, source, 1)
    assert bit(bus, INTSTS, source) == 1
    assert [bus.read(IRQNUM) for _ in range(2)] == [source, source]
    assert bus.read(FIQNUM) == 0
    drive(bus, source, 0)
    assert bus.read(IRQNUM) == 0


def test_source_zero_does_not_exist(bus: Machine) -> None:
    write_bit(bus, INTEN, 0)
    drive(bus, 0, 1)
    control(bus, 0, HIGH | 1)
    assert bus.read(ACTSTS) == bus.read(INTSTS) == bus.read(IRQNUM) == 0


def test_enabling_and_disabling_touch_only_the_bits_that_are_set(bus: Machine) -> None:
    for register in (INTEN, INTEN + 4):
        bus.write(register, 0xF0)
        bus.write(register, 0x0F)
    bus.write(INTDIS, 0x3C)
    bus.write(INTDIS + 4, 0xFFFFFFFF)
    assert (bus.read(INTMSK), bus.read(INTMSK + 4)) == (0xC3, 0)


def test_of_equal_priority_the_lowest_comes_first(bus: Machine) -> None:
    for source in (40, 16, 50):
        write_bit(bus, INTEN, source)
        drive(bus, source, 1)
    assert bus.read(IRQNUM) == 16


def test_as_linux_does_mask_acknowledge_and_ask_for_the_next(bus: Machine) -> None:
    for source in (32, 36, 19):
        write_bit(bus, INTEN, source)
        drive(bus, source, 1)
    seen = []
    while source := bus.read(IRQNUM):
        write_bit(bus, INTDIS, source)
        bus.write(EOIS, 1)
        seen.append(source)
    assert seen == [19, 32, 36]


@pytest.mark.parametrize(("of_20", "of_10", "first"), [(1, 7, 20), (7, 1, 10), (3, 3, 10), (2, 3, 20)])
def test_the_smaller_priority_comes_first(bus: Machine, of_20: int, of_10: int, first: int) -> None:
    for source, priority in ((20, of_20), (10, of_10)):
        control(bus, source, HIGH | priority)
        write_bit(bus, INTEN, source)
        drive(bus, source, 1)
    assert bus.read(IRQNUM) == first


def test_priority_zero_is_the_fast_interrupt(bus: Machine) -> None:
    control(bus, 33, HIGH | 0)
    for source in (33, 34):
        write_bit(bus, INTEN, source)
        drive(bus, source, 1)
    assert (bus.read(FIQNUM), bus.read(IRQNUM)) == (33, 34)
    bus.write(EOFS, 1)
    drive(bus, 33, 0)
    assert (bus.read(FIQNUM), bus.read(IRQNUM)) == (0, 34)


def test_low_level(bus: Machine) -> None:
    control(bus, 5, LOW | 7)
    write_bit(bus, INTEN, 5)
    assert (bit(bus, RAWSTS, 5), bus.read(IRQNUM)) == (0, 5)
    drive(bus, 5, 1)
    assert (bit(bus, RAWSTS, 5), bus.read(IRQNUM)) == (1, 0)


@pytest.mark.parametrize(("kind", "away", "to"), [(RISING, 0, 1), (FALLING, 1, 0)])
def test_edge_is_kept_until_its_number_is_read(bus: Machine, kind: int, away: int, to: int) -> None:
    drive(bus, 44, away)
    control(bus, 44, kind | 7)
    write_bit(bus, INTEN, 44)
    assert bit(bus, INTSTS, 44) == 0
    drive(bus, 44, to)
    drive(bus, 44, away)
    assert bit(bus, INTSTS, 44) == 1
    assert [bus.read(IRQNUM) for _ in range(2)] == [44, 0]


def test_edge_while_disabled_waits(bus: Machine) -> None:
    control(bus, 44, RISING | 7)
    drive(bus, 44, 1)
    assert bus.read(IRQNUM) == 0
    write_bit(bus, INTEN, 44)
    assert bus.read(IRQNUM) == 44


def test_edge_is_forgotten_when_the_source_becomes_a_level(bus: Machine) -> None:
    control(bus, 44, RISING | 7)
    drive(bus, 44, 1)
    drive(bus, 44, 0)
    control(bus, 44, HIGH | 7)
    control(bus, 44, RISING | 7)
    assert bit(bus, ACTSTS, 44) == 0


def test_wrong_accesses_are_told(bus: Machine) -> None:
    bus.write(IRQNUM, 5)
    bus.read(INTEN)
    assert "nuc980-aic: 0x120 can only be read" in bus.complaints
    assert "nuc980-aic: 0x130 can only be written" in bus.complaints


def test_register_without_a_name_is_logged_once(bus: Machine) -> None:
    for _ in range(3):
        assert bus.read(AIC + 0x140) == 0
    assert bus.complaints.count("nuc980-aic: register 0x140 is not modelled") == 1


def test_edge_priority_and_mask_are_saved(bus: Machine, reborn: Callable[[Machine], Machine]) -> None:
    control(bus, 44, RISING | 3)
    write_bit(bus, INTEN, 44)
    drive(bus, 44, 1)
    drive(bus, 44, 0)
    new = reborn(bus)
    assert bit(new, RAWSTS, 44) == 0
    assert [new.read(IRQNUM) for _ in range(2)] == [44, 0]
    drive(new, 44, 1)
    assert new.read(IRQNUM) == 44
