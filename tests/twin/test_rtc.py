# SPDX-License-Identifier: GPL-3.0-or-later
"""The real-time clock: -rtc's time in BCD, behind its lock, with alarm and ticks."""

from collections.abc import Callable

import pytest

from nuc980.twin.machine import Machine

RTC = 0xB0041000
INIT, RWEN, FREQADJ, TIME, CAL = (RTC + r for r in (0x00, 0x04, 0x08, 0x0C, 0x10))
TIMEFMT, WEEKDAY, TALM, CALM, LEAPYEAR = (RTC + r for r in (0x14, 0x18, 0x1C, 0x20, 0x24))
INTEN, INTSTS, TICK, PWRCTL, SPR0 = (RTC + r for r in (0x28, 0x2C, 0x30, 0x34, 0x40))
INIT_KEY, RWEN_KEY, OPEN = 0xA5EB1357, 0xA965, 1 << 16
ALARM, TICKS, BUSY = 1, 2, 1 << 31
ALARM_ENABLE, ANY_WEEKDAY = 1 << 3, 1 << 31
RAWSTS0 = 0xB0042100
SECOND = 1_000_000_000

WEDNESDAY, THURSDAY = 3, 4


@pytest.fixture
def clock(board: Callable[..., Machine]) -> Machine:
    """A bus whose real-time clock runs with virtual time, from two seconds before a 29th of February."""
    return board("-rtc", "base=2024-02-28T23:59:58,clock=vm", registers=True)


def write(bus: Machine, register: int, value: int) -> None:
    bus.write(RWEN, RWEN_KEY)
    bus.write(register, value)


def interrupts(bus: Machine) -> bool:
    return bool(bus.read(RAWSTS0) >> 15 & 1)


def test_time_of_the_command_line(clock: Machine) -> None:
    assert (clock.read(CAL), clock.read(TIME), clock.read(WEEKDAY)) == (0x240228, 0x235958, WEDNESDAY)
    assert (clock.read(LEAPYEAR), clock.read(TIMEFMT), clock.read(INIT)) == (1, 1, 1)


def test_leap_day(clock: Machine) -> None:
    clock.step(2 * SECOND - 1)
    assert (clock.read(CAL), clock.read(TIME)) == (0x240228, 0x235959)
    clock.step(1)
    assert (clock.read(CAL), clock.read(TIME), clock.read(WEEKDAY)) == (0x240229, 0x000000, THURSDAY)
    clock.step(24 * 3600 * SECOND)
    assert clock.read(CAL) == 0x240301


def test_year_without_a_leap_day(board: Callable[..., Machine]) -> None:
    bus = board("-rtc", "base=2026-02-28T23:59:59,clock=vm", registers=True)
    assert bus.read(LEAPYEAR) == 0
    bus.step(SECOND)
    assert bus.read(CAL) == 0x260301


def test_as_linux_sets_the_time(clock: Machine) -> None:
    clock.write(INIT, INIT_KEY)
    clock.write(RWEN, RWEN_KEY)
    assert clock.read(RWEN) & OPEN
    clock.write(CAL, 0x311231)
    clock.write(TIME, 0x235900)
    clock.write(WEEKDAY, WEDNESDAY)
    clock.step(61 * SECOND)
    assert (clock.read(CAL), clock.read(TIME), clock.read(WEEKDAY)) == (0x320101, 0x000001, THURSDAY)


@pytest.mark.parametrize(
    ("base", "dates"),
    [
        ("2026-11-29T12:00:00", (0x991231, 0x000101, 0x950301, 0x261129)),
        ("2000-01-01T00:00:00", (0x700101, 0x991231, 0x000229)),
        ("2099-12-31T00:00:00", (0x000101, 0x310807)),
    ],
)
def test_each_date_of_the_chips_century(board: Callable[..., Machine], base: str, dates: tuple[int]) -> None:
    """However far it is from that of the command line: 2^31 s are 68 years."""
    bus = board("-rtc", f"base={base},clock=vm", registers=True)
    for date in dates:
        write(bus, CAL, date)
        assert bus.read(CAL) == date


def test_century_begins_anew(board: Callable[..., Machine]) -> None:
    bus = board("-rtc", "base=2099-12-31T23:59:59,clock=vm", registers=True)
    assert (bus.read(CAL), bus.read(WEEKDAY)) == (0x991231, 4)
    bus.step(SECOND)
    assert (bus.read(CAL), bus.read(TIME), bus.read(LEAPYEAR)) == (0x000101, 0x000000, 1)


@pytest.mark.parametrize(("register", "value"), [(RWEN, RWEN_KEY), (TIMEFMT, 1), (INTSTS, ALARM)])
def test_a_write_takes_two_clocks(clock: Machine, register: int, value: int) -> None:
    assert not clock.read(INTSTS) & BUSY
    clock.write(register, value)
    clock.step(2 * SECOND // 32768 - 1)
    assert clock.read(INTSTS) & BUSY
    clock.step(1)
    assert not clock.read(INTSTS) & BUSY


@pytest.mark.parametrize("register", [TIME, CAL, WEEKDAY, TALM, CALM, TICK, PWRCTL, SPR0])
def test_without_the_key_nothing_is_written(clock: Machine, register: int) -> None:
    before = clock.read(register)
    clock.write(register, before ^ 1)
    assert clock.read(register) == before
    assert f"{register - RTC:#x} = {before ^ 1:#x} needs RWEN's key first" in clock.complaints


def test_key_holds_for_1024_clocks(clock: Machine) -> None:
    clock.write(RWEN, RWEN_KEY)
    clock.step(1024 * SECOND // 32768 - 1)
    assert clock.read(RWEN) == OPEN
    clock.step(1)
    assert clock.read(RWEN) == 0
    clock.write(RWEN, RWEN_KEY)
    clock.write(RWEN, 0)
    assert clock.read(RWEN) == 0


def test_interrupts_and_format_need_no_key_as_in_linux(clock: Machine) -> None:
    clock.write(INTEN, 3)
    clock.write(TIMEFMT, 0)
    assert (clock.read(INTEN), clock.read(TIMEFMT), clock.complaints) == (3, 0, "")


@pytest.mark.parametrize(
    ("hour", "half_day"),
    [(0x00, 0x12), (0x01, 0x01), (0x11, 0x11), (0x12, 0x32), (0x13, 0x21), (0x23, 0x31)],
)
def test_twelve_hour_clock_counts_the_afternoon_from_21(clock: Machine, hour: int, half_day: int) -> None:
    clock.step(3600 * SECOND)  # the host's time is another
    write(clock, TIME, hour << 16)
    clock.write(TIMEFMT, 0)
    assert clock.read(TIME) == half_day << 16
    write(clock, TIME, half_day << 16 | 0x30)
    clock.write(TIMEFMT, 1)
    assert clock.read(TIME) == hour << 16 | 0x30


@pytest.mark.parametrize(
    ("register", "value"),
    [(TIME, 0x240000), (TIME, 0x006000), (TIME, 0x00000A), (CAL, 0x241301), (CAL, 0x240100), (CAL, 0x240132)],
)
def test_impossible_time_is_refused(clock: Machine, register: int, value: int) -> None:
    before = clock.read(register)
    write(clock, register, value)
    assert clock.read(register) == before
    assert "nuc980-rtc: no such time or date" in clock.complaints


@pytest.mark.parametrize("power", range(8))
def test_tick_interrupts_every_part_of_a_second(clock: Machine, power: int) -> None:
    write(clock, TICK, power)
    clock.write(INTEN, TICKS)
    for _ in range(3):
        clock.step((SECOND >> power) - 1)
        assert not interrupts(clock)
        clock.step(1)
        assert interrupts(clock)
        clock.write(INTSTS, TICKS)
        clock.step((SECOND >> power) - 1)
        assert not interrupts(clock)
        clock.step(1)
        clock.write(INTSTS, TICKS)


def test_tick_can_be_polled(clock: Machine) -> None:
    assert not clock.read(INTSTS) & TICKS
    clock.step(SECOND)
    assert clock.read(INTSTS) & TICKS
    clock.write(INTSTS, TICKS)
    assert not clock.read(INTSTS) & TICKS
    assert not interrupts(clock)


def set_alarm(bus: Machine, date: int, time: int) -> None:
    """As the vendor's Linux driver does."""
    write(bus, CALM, date)
    write(bus, TALM, time)
    write(bus, PWRCTL, ALARM_ENABLE)
    bus.write(INTEN, ALARM)


def test_alarm_comes_as_its_second_begins(clock: Machine) -> None:
    set_alarm(clock, 0x240229 | ANY_WEEKDAY, 0x000003)
    clock.step(5 * SECOND - 1)
    assert not interrupts(clock)
    clock.step(1)
    assert (interrupts(clock), clock.read(INTSTS) & ALARM) == (True, ALARM)
    clock.write(INTSTS, ALARM)
    assert not interrupts(clock)
    clock.step(100 * SECOND)
    assert not interrupts(clock)


@pytest.mark.parametrize(("weekday", "comes"), [(THURSDAY, True), (WEDNESDAY, False)])
def test_alarm_on_a_weekday(clock: Machine, weekday: int, comes: bool) -> None:
    set_alarm(clock, 0x240229 | weekday << 24, 0x000003)
    clock.step(10 * SECOND)
    assert interrupts(clock) == comes


@pytest.mark.parametrize(("date", "time"), [(0x240228, 0x235957), (0x240227, 0x235959), (0, 0)])
def test_past_or_no_alarm_never_comes(clock: Machine, date: int, time: int) -> None:
    set_alarm(clock, date | ANY_WEEKDAY, time)
    clock.step(1000 * SECOND)
    assert not interrupts(clock)


def test_alarm_that_is_not_enabled_does_not_come(clock: Machine) -> None:
    set_alarm(clock, 0x240229 | ANY_WEEKDAY, 0x000003)
    write(clock, PWRCTL, 0)
    clock.step(1000 * SECOND)
    assert not clock.read(INTSTS) & ALARM


def test_setting_the_clock_brings_the_alarm_nearer(clock: Machine) -> None:
    set_alarm(clock, 0x240301 | ANY_WEEKDAY, 0x120000)
    write(clock, CAL, 0x240301)
    write(clock, TIME, 0x115955)
    clock.step(5 * SECOND - 1)
    assert not interrupts(clock)
    clock.step(1)
    assert interrupts(clock)


def test_battery_keeps_time_and_spare_registers_over_a_reset(clock: Machine) -> None:
    write(clock, CAL, 0x300115)
    write(clock, SPR0 + 60, 0xCAFE)
    clock.write(INTEN, 3)
    clock.command("system_reset")
    clock.wait_for_event("RESET")
    assert (clock.read(CAL), clock.read(SPR0 + 60)) == (0x300115, 0xCAFE)
    assert (clock.read(INTEN), interrupts(clock)) == (0, False)


def test_without_a_battery_it_waits_for_its_key(
    board: Callable[..., Machine], reborn: Callable[[Machine], Machine]
) -> None:
    bus = board("-global", "nuc980-rtc.battery=off", registers=True)
    assert bus.read(INIT) == 0
    bus.write(INIT, INIT_KEY - 1)
    assert bus.read(INIT) == 0
    bus.write(INIT, INIT_KEY)
    assert bus.read(INIT) == 1
    assert reborn(bus).read(INIT) == 1


@pytest.mark.parametrize(
    ("register", "value"), [(FREQADJ, 1), (TALM, 1 << 28), (CALM, 1 << 30), (PWRCTL, 1 << 4)]
)
def test_bits_without_effect_are_told_once(clock: Machine, register: int, value: int) -> None:
    for _ in range(2):
        write(clock, register, value)
    assert clock.complaints.count(f"nuc980-rtc: register {register - RTC:#x} is not modelled") == 1


def test_time_and_alarm_are_saved(clock: Machine, reborn: Callable[[Machine], Machine]) -> None:
    write(clock, TIME, 0x120000)
    set_alarm(clock, 0x240228 | ANY_WEEKDAY, 0x120005)
    new = reborn(clock)
    assert (new.read(CAL), new.read(TIME)) == (0x240228, 0x120000)
    new.step(5 * SECOND - 1)
    assert not interrupts(new)
    new.step(1)
    assert (new.read(TIME), interrupts(new)) == (0x120005, True)
