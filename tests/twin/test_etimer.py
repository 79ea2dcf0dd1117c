# SPDX-License-Identifier: GPL-3.0-or-later
"""The timers: exact to the nanosecond of virtual time, also after a long run, in every mode."""

from collections.abc import Callable

import pytest

from nuc980.twin.machine import Machine

TIMERS = {0xB0050000: 16, 0xB0050100: 17, 0xB0051000: 30, 0xB0051100: 31, 0xB0052000: 32, 0xB0052100: 34}
CTL, PRECNT, CMPR, IER, ISR, DR, TCAP, ECTL = 0x00, 0x04, 0x08, 0x0C, 0x10, 0x14, 0x18, 0x20
ENABLE, RESET, ACTIVE = 1, 2, 0x80
ONE_SHOT, PERIODIC, TOGGLE, CONTINUOUS = 0x00, 0x10, 0x20, 0x30

TIMER0 = 0xB0050000
CLK_DIV8 = 0xB0000240
RAWSTS = 0xB0042100

MICROSECOND, MILLISECOND, SECOND = 1_000, 1_000_000, 1_000_000_000
WRAP = 1 << 24


def start(bus: Machine, mode: int, compare: int, prescaler: int = 12, timer: int = TIMER0) -> None:
    """Interrupts are on; a tick is a microsecond unless another prescaler is given."""
    bus.write(timer + PRECNT, prescaler - 1)
    bus.write(timer + CMPR, compare)
    bus.write(timer + IER, 1)
    bus.write(timer + CTL, mode | ENABLE)


def interrupts(bus: Machine, source: int = 16) -> bool:
    return bool(bus.read(RAWSTS + 4 * (source // 32)) >> source % 32 & 1)


def clear(bus: Machine, timer: int = TIMER0) -> None:
    bus.write(timer + ISR, 1)


@pytest.mark.parametrize(("timer", "source"), TIMERS.items())
def test_each_timer_interrupts_its_source(bus: Machine, timer: int, source: int) -> None:
    start(bus, ONE_SHOT, 10, timer=timer)
    bus.step(10 * MICROSECOND)
    assert [n for n in TIMERS.values() if interrupts(bus, n)] == [source]
    clear(bus, timer)
    assert not interrupts(bus, source)


def test_one_shot_matches_once_and_stops_at_zero(bus: Machine) -> None:
    start(bus, ONE_SHOT, 100)
    assert bus.read(TIMER0 + CTL) == ENABLE | ACTIVE
    bus.step(100 * MICROSECOND - 1)
    assert (bus.read(TIMER0 + DR), bus.read(TIMER0 + ISR), interrupts(bus)) == (99, 0, False)
    bus.step(1)
    assert (bus.read(TIMER0 + DR), bus.read(TIMER0 + ISR), interrupts(bus)) == (0, 1, True)
    assert bus.read(TIMER0 + CTL) == 0
    clear(bus)
    bus.step(SECOND)
    assert (bus.read(TIMER0 + DR), bus.read(TIMER0 + ISR)) == (0, 0)


def test_one_shot_stops_also_without_an_interrupt(bus: Machine) -> None:
    bus.write(TIMER0 + CMPR, 12)
    bus.write(TIMER0 + CTL, ENABLE)
    bus.step(MICROSECOND)
    assert (bus.read(TIMER0 + CTL), bus.read(TIMER0 + ISR), interrupts(bus)) == (0, 1, False)
    bus.write(TIMER0 + IER, 1)
    assert interrupts(bus)


@pytest.mark.parametrize("mode", [PERIODIC, TOGGLE])
def test_periodic_starts_anew_at_each_match(bus: Machine, mode: int) -> None:
    start(bus, mode, 100)
    for _ in range(3):
        bus.step(99 * MICROSECOND)
        assert (bus.read(TIMER0 + DR), interrupts(bus)) == (99, False)
        bus.step(MICROSECOND)
        assert (bus.read(TIMER0 + DR), interrupts(bus)) == (0, True)
        clear(bus)
        assert not interrupts(bus)


def test_continuous_goes_on_after_the_match_and_wraps(bus: Machine) -> None:
    start(bus, CONTINUOUS, 100)
    bus.step(100 * MICROSECOND)
    assert (bus.read(TIMER0 + DR), interrupts(bus)) == (100, True)
    clear(bus)
    bus.step((WRAP - 1) * MICROSECOND)
    assert (bus.read(TIMER0 + DR), interrupts(bus)) == (99, False)
    bus.step(MICROSECOND)
    assert (bus.read(TIMER0 + DR), interrupts(bus)) == (100, True)


@pytest.mark.parametrize(("prescaler", "compare"), [(1, 120_000), (7, 12_345), (100, 1_200), (256, 2)])
def test_interrupt_comes_to_the_microsecond_after_a_thousand_seconds(
    bus: Machine, prescaler: int, compare: int
) -> None:
    start(bus, PERIODIC, compare, prescaler)
    period = prescaler * compare  # in ticks of 12 MHz
    matches = 12_000_000 * 1000 // period
    at = -(-matches * period * SECOND // 12_000_000)
    bus.step(at - MICROSECOND)
    clear(bus)
    assert not interrupts(bus)
    bus.step(2 * MICROSECOND)
    assert interrupts(bus)


def test_clearing_late_a_hundred_thousand_times_moves_nothing(bus: Machine) -> None:
    """The guest's latency is no part of the period."""
    start(bus, PERIODIC, 1000, timer=TIMER0)
    for late in range(1, 200):
        bus.step(MILLISECOND + (late % 7 - 3) * 50 * MICROSECOND)
        clear(bus)
    now = sum(MILLISECOND + (late % 7 - 3) * 50 * MICROSECOND for late in range(1, 200))
    assert bus.read(TIMER0 + DR) == now // MICROSECOND % 1000


def test_as_linux_sets_the_next_event(bus: Machine) -> None:
    """Stop, new compare value, wait for 0, enable: for seconds of such events."""
    bus.write(TIMER0 + IER, 1)
    for ticks in (12, 120_000, 0xFFFFFF, 5_000):
        bus.write(TIMER0 + CTL, 0)
        bus.write(TIMER0 + CMPR, ticks)
        assert bus.read(TIMER0 + DR) == 0
        bus.write(TIMER0 + CTL, bus.read(TIMER0 + CTL) | ENABLE)
        bus.step(-(-ticks * 1000 // 12) - 100)
        assert not interrupts(bus)
        bus.step(100)
        assert interrupts(bus)
        clear(bus)


def test_as_linux_reads_its_clock(bus: Machine) -> None:
    """CMPR of 32 ones, 120 kHz: 24 bits, and no interrupt."""
    bus.write(TIMER0 + CMPR, 0xFFFFFFFF)
    bus.write(TIMER0 + PRECNT, 0x63)
    bus.write(TIMER0 + CTL, PERIODIC | ENABLE)
    assert bus.read(TIMER0 + CMPR) == 0xFFFFFF
    bus.step(10 * SECOND)
    assert bus.read(TIMER0 + DR) == 1_200_000
    bus.step(130 * SECOND)
    assert bus.read(TIMER0 + DR) == 140 * 120_000 - 0xFFFFFF
    assert not interrupts(bus)


def test_stopped_counter_keeps_its_value(bus: Machine) -> None:
    start(bus, PERIODIC, 1000)
    bus.step(300 * MICROSECOND)
    bus.write(TIMER0 + CTL, PERIODIC)
    bus.step(SECOND)
    assert (bus.read(TIMER0 + DR), bus.read(TIMER0 + CTL)) == (300, PERIODIC)
    bus.write(TIMER0 + CTL, PERIODIC | ENABLE)
    bus.step(700 * MICROSECOND)
    assert (bus.read(TIMER0 + DR), interrupts(bus)) == (0, True)


def test_reset_bit_stops_and_clears(bus: Machine) -> None:
    start(bus, PERIODIC, 1000)
    bus.step(300 * MICROSECOND)
    bus.write(TIMER0 + CTL, PERIODIC | ENABLE | RESET)
    assert (bus.read(TIMER0 + DR), bus.read(TIMER0 + CTL)) == (0, PERIODIC)


def test_new_compare_value_restarts_but_in_continuous_mode(bus: Machine) -> None:
    start(bus, PERIODIC, 1000)
    bus.step(300 * MICROSECOND)
    bus.write(TIMER0 + CMPR, 500)
    assert bus.read(TIMER0 + DR) == 0
    start(bus, CONTINUOUS, 1000)
    bus.step(300 * MICROSECOND)
    bus.write(TIMER0 + CMPR, 500)
    assert bus.read(TIMER0 + DR) == 300
    bus.step(200 * MICROSECOND)
    assert interrupts(bus)


def test_compare_value_below_the_counter_matches_after_the_wrap(bus: Machine) -> None:
    start(bus, CONTINUOUS, 1000)
    bus.step(300 * MICROSECOND)
    bus.write(TIMER0 + CMPR, 200)
    bus.step((WRAP - 101) * MICROSECOND)
    assert (bus.read(TIMER0 + DR), interrupts(bus)) == (199, False)
    bus.step(MICROSECOND)
    assert interrupts(bus)


def test_moving_the_compare_value_does_not_move_the_counter(bus: Machine) -> None:
    """A thousand new compare values at odd times: no nanosecond is lost."""
    start(bus, CONTINUOUS, 1000)
    elapsed = 0
    for _ in range(300):
        bus.step(1_337)
        elapsed += 1_337
        bus.write(TIMER0 + CMPR, (bus.read(TIMER0 + DR) + 50) % WRAP)
    assert bus.read(TIMER0 + DR) == elapsed // MICROSECOND


def test_counter_above_the_compare_value_in_periodic_mode_wraps_first(bus: Machine) -> None:
    start(bus, CONTINUOUS, 100)
    bus.step(300 * MICROSECOND)
    clear(bus)
    bus.write(TIMER0 + CTL, PERIODIC | ENABLE)
    assert bus.read(TIMER0 + DR) == 300
    bus.step((WRAP - 200) * MICROSECOND - 1)
    assert not interrupts(bus)
    bus.step(1)
    assert (bus.read(TIMER0 + DR), interrupts(bus)) == (0, True)


def test_prescaler_changes_on_the_run(bus: Machine) -> None:
    start(bus, PERIODIC, 1000)
    bus.step(400 * MICROSECOND)
    bus.write(TIMER0 + PRECNT, 23)
    assert bus.read(TIMER0 + DR) == 400
    bus.step(600 * 2 * MICROSECOND - 1)
    assert (bus.read(TIMER0 + DR), interrupts(bus)) == (999, False)
    bus.step(1)
    assert interrupts(bus)


@pytest.mark.parametrize(
    ("source", "hertz"), [(0, 12_000_000), (1, 6_000_000), (2, 6_000_000 / 4096), (3, 32_768)]
)
def test_clock_sources(bus: Machine, source: int, hertz: float) -> None:
    """After power-on the system runs from the crystal: HCLK is half of it."""
    bus.write(CLK_DIV8, source << 16)
    start(bus, CONTINUOUS, 0xFFFFFF, prescaler=1)
    bus.step(SECOND)
    assert bus.read(TIMER0 + DR) == int(hertz)


def test_clock_changes_on_the_run(bus: Machine) -> None:
    start(bus, PERIODIC, 1_000_000, prescaler=1)
    bus.step(50 * MILLISECOND)
    bus.write(CLK_DIV8, 3 << 16)
    assert bus.read(TIMER0 + DR) == 600_000
    bus.step(10 * SECOND)
    assert (bus.read(TIMER0 + DR), interrupts(bus)) == (600_000 + 327_680, False)
    bus.step(-(-(1_000_000 - 927_680) * SECOND // 32_768))
    assert interrupts(bus)


def test_registers_keep_their_bits(bus: Machine) -> None:
    bus.write(TIMER0 + PRECNT, 0xFFFFFFFF)
    bus.write(TIMER0 + IER, 0xFFFFFFFF)
    bus.write(TIMER0 + CMPR, 0xFF123456)
    assert [bus.read(TIMER0 + r) for r in (PRECNT, IER, CMPR)] == [0xFF, 3, 0x123456]


@pytest.mark.parametrize("compare", [0, 1])
def test_forbidden_compare_value_is_told_and_does_no_harm(bus: Machine, compare: int) -> None:
    start(bus, PERIODIC, compare)
    bus.step(SECOND)
    assert f"nuc980-etimer: a compare value of {compare} is not allowed" in bus.complaints


@pytest.mark.parametrize("register", [TCAP, ECTL])
def test_capture_registers_are_told_once(bus: Machine, register: int) -> None:
    for _ in range(3):
        bus.write(TIMER0 + register, 1)
        assert bus.read(TIMER0 + register) == 0
    assert bus.complaints.count(f"nuc980-etimer: register {register:#x} is not modelled") == 1


def test_capture_and_event_bits_are_told_once(bus: Machine) -> None:
    for _ in range(3):
        bus.write(TIMER0 + CTL, 0x10000)
    assert bus.complaints.count("nuc980-etimer: register 0x0 is not modelled") == 1


@pytest.mark.parametrize(("mode", "again"), [(PERIODIC, 1000), (CONTINUOUS, WRAP)])
def test_running_counter_is_saved_to_the_nanosecond(
    bus: Machine, reborn: Callable[[Machine], Machine], mode: int, again: int
) -> None:
    start(bus, mode, 1000)
    bus.step(1_300 * MICROSECOND + 333)
    clear(bus)
    new = reborn(bus)
    now, left = (300, 700) if mode == PERIODIC else (1300, again - 300)
    assert (new.read(TIMER0 + DR), interrupts(new)) == (now, False)
    new.step(left * MICROSECOND - 334)
    assert not interrupts(new)
    new.step(1)
    assert interrupts(new)


def test_clock_source_can_be_changed_after_a_restart(
    bus: Machine, reborn: Callable[[Machine], Machine]
) -> None:
    bus.write(CLK_DIV8, 3 << 16)
    start(bus, CONTINUOUS, 0xFFFFFF, prescaler=1)
    new = reborn(bus)
    new.write(CLK_DIV8, 0)
    new.step(MILLISECOND)
    assert new.read(TIMER0 + DR) == 12_000
