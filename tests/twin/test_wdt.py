# SPDX-License-Identifier: GPL-3.0-or-later
"""The watchdogs: when they interrupt, when they reset, and who may change them."""

from collections.abc import Callable

import pytest

from nuc980.twin.machine import Machine

CTL, ALTCTL, RSTCNT = 0xB0040000, 0xB0040004, 0xB0040008
RESET_ENABLE, RESET_FLAG, FLAG, INTERRUPT, ENABLE = 1 << 1, 1 << 2, 1 << 3, 1 << 6, 1 << 7
RLDCNT, WWDT_CTL, STATUS, CNT = 0xB0040100, 0xB0040104, 0xB0040108, 0xB004010C
WWDT_ENABLE, WWDT_INTERRUPT, WWDT_FLAG, WWDT_RESET_FLAG = 1, 2, 1, 2
KEY = 0x5AA5

REGWPCTL, RSTSTS = 0xB00001FC, 0xB000006C
DIV0, DIV8, UPLLCON = 0xB0000220, 0xB0000240, 0xB0000264
RAWSTS0 = 0xB0042100
POWER_ON, BY_WATCHDOG = 1 << 0, 1 << 5
XIN, XIN_512, PCLK_4096, X32K = range(4)
HERTZ = {XIN: 12_000_000, XIN_512: 12_000_000 / 512, PCLK_4096: 3_000_000 // 4096, X32K: 32_768}
SECOND = 1_000_000_000


def unlock(bus: Machine) -> None:
    for key in (0x59, 0x16, 0x88):
        bus.write(REGWPCTL, key)


def start(bus: Machine, interval: int, settings: int, delay: int = 0, clock: int = X32K) -> None:
    bus.write(DIV8, clock << 8 | clock << 10)
    unlock(bus)
    bus.write(ALTCTL, delay)
    bus.write(CTL, interval << 8 | ENABLE | settings)
    bus.write(REGWPCTL, 0)


def ticks(count: int, clock: int = X32K) -> int:
    """The nanoseconds after which a clock has made so many ticks."""
    return -(-count * SECOND * 512 // int(HERTZ[clock] * 512))


def interrupts(bus: Machine, source: int) -> bool:
    return bool(bus.read(RAWSTS0) >> source & 1)


def resets(bus: Machine) -> bool:
    return bool(bus.events("RESET"))


@pytest.mark.parametrize("interval", range(9))
def test_interrupt_comes_after_the_interval(bus: Machine, interval: int) -> None:
    start(bus, interval, INTERRUPT)
    at = ticks(1 << 4 + 2 * interval)
    bus.step(at - 1)
    assert not interrupts(bus, 1)
    bus.step(1)
    assert interrupts(bus, 1)
    assert bus.read(CTL) & FLAG
    unlock(bus)
    bus.write(CTL, bus.read(CTL))
    assert not interrupts(bus, 1)
    assert not bus.read(CTL) & FLAG


def test_intervals_follow_each_other_without_a_reset(bus: Machine) -> None:
    start(bus, 5, INTERRUPT)
    unlock(bus)
    for n in range(1, 5):
        bus.step(ticks(n << 14) - ticks((n - 1) << 14))
        assert interrupts(bus, 1)
        bus.write(CTL, bus.read(CTL))


@pytest.mark.parametrize(("clock", "seconds"), [(XIN_512, 0.743), (X32K, 0.531), (PCLK_4096, 23.78)])
def test_clock_sources(bus: Machine, clock: int, seconds: float) -> None:
    """2^14 + 1026 ticks: with XIN/512 what the vendor's Linux driver sets, there called 0.7 s."""
    start(bus, 5, RESET_ENABLE, clock=clock)
    bus.step(int((seconds - 0.005) * SECOND))
    assert not resets(bus)
    bus.step(int(0.01 * SECOND))
    assert resets(bus)


@pytest.mark.parametrize(("delay", "count"), [(0, 1026), (1, 130), (2, 18), (3, 3)])
def test_reset_comes_after_interval_and_delay(bus: Machine, delay: int, count: int) -> None:
    start(bus, 3, RESET_ENABLE, delay)
    bus.step(ticks((1 << 10) + count) - 1)
    assert bus.read(CTL) & FLAG
    assert not resets(bus)
    bus.step(1)
    assert bus.wait_for_event("WATCHDOG") == {"action": "reset"}
    assert bus.wait_for_event("RESET") == {"guest": True, "reason": "guest-reset"}


def test_cause_of_the_reset_is_told(bus: Machine) -> None:
    bus.write(RSTSTS, POWER_ON)
    start(bus, 0, RESET_ENABLE, delay=3)
    bus.step(SECOND)
    assert resets(bus)
    assert bus.read(RSTSTS) == BY_WATCHDOG
    assert bus.read(CTL) == 0x700 | RESET_FLAG
    unlock(bus)
    bus.write(CTL, RESET_FLAG)
    assert bus.read(CTL) == 0


def test_other_reset_stops_the_watchdog_and_is_not_its_own(bus: Machine) -> None:
    start(bus, 0, RESET_ENABLE)
    bus.command("system_reset")
    bus.wait_for_event("RESET")
    bus.step(SECOND)
    assert not resets(bus)
    assert (bus.read(CTL), bus.read(RSTSTS)) == (0x700, POWER_ON)


@pytest.mark.parametrize("share", [0.5, 0.99])
def test_restart_keeps_it_quiet(bus: Machine, share: float) -> None:
    start(bus, 5, RESET_ENABLE | INTERRUPT)
    for _ in range(5):
        bus.step(int(ticks(1 << 14) * share))
        bus.write(RSTCNT, KEY)
    assert not interrupts(bus, 1)
    assert not resets(bus)


def test_restart_in_the_delay_still_saves(bus: Machine) -> None:
    start(bus, 5, RESET_ENABLE)
    bus.step(ticks((1 << 14) + 1000))
    bus.write(RSTCNT, KEY)
    unlock(bus)
    bus.write(CTL, bus.read(CTL))  # which clears the flag
    bus.step(ticks(1 << 14))
    assert bus.read(CTL) & FLAG
    assert not resets(bus)
    bus.step(ticks(1026))
    assert resets(bus)


def test_wrong_key_does_not_restart(bus: Machine) -> None:
    start(bus, 5, RESET_ENABLE)
    bus.step(ticks(1 << 14))
    bus.write(RSTCNT, 0x5AA4)
    bus.step(ticks(1026))
    assert resets(bus)


def test_settings_are_protected(bus: Machine) -> None:
    for register in (CTL, ALTCTL):
        before = bus.read(register)
        bus.write(register, 0x3)
        assert bus.read(register) == before
    assert bus.complaints.count("needs REGWPCTL's three keys first") == 2


def test_it_can_be_stopped_and_starts_from_zero(bus: Machine) -> None:
    start(bus, 5, RESET_ENABLE)
    bus.step(ticks(1 << 13))
    unlock(bus)
    bus.write(CTL, 5 << 8 | RESET_ENABLE)
    bus.step(SECOND)
    assert not resets(bus)
    bus.write(CTL, 5 << 8 | RESET_ENABLE | ENABLE)
    bus.step(ticks(1 << 14))
    assert not resets(bus)


def test_action_none_is_respected_and_leaves_no_cause(board: Callable[..., Machine]) -> None:
    bus = board("-watchdog-action", "none", registers=True)
    start(bus, 0, RESET_ENABLE, delay=3)
    bus.step(ticks(19))
    assert bus.wait_for_event("WATCHDOG") == {"action": "none"}
    assert not resets(bus)
    bus.command("system_reset")
    bus.wait_for_event("RESET")
    assert (bus.read(RSTSTS), bus.read(CTL) & RESET_FLAG) == (POWER_ON, 0)


def test_wake_up_is_told_once(bus: Machine) -> None:
    for _ in range(2):
        start(bus, 5, 1 << 4)
    assert bus.complaints.count("nuc980-wdt: register 0x0 is not modelled") == 1


def test_clock_below_a_hertz_stands_still(bus: Machine) -> None:
    """The slowest PLL, halved: PCLK2/4096 is 0.7 Hz, which is none here."""
    bus.write(UPLLCON, 7 << 13 | 63 << 7)
    bus.write(DIV0, 3 << 3 | 1 << 8)
    start(bus, 0, RESET_ENABLE, delay=3, clock=PCLK_4096)
    bus.step(1000 * SECOND)
    assert not bus.read(CTL) & FLAG
    bus.write(DIV8, X32K << 8)
    bus.step(SECOND)
    assert resets(bus)


# ---- window watchdog


def start_window(bus: Machine, compare: int, prescaler: int = 5) -> None:
    """A tick is 32 of the 32 kHz clock's: 1/1024 s."""
    bus.write(DIV8, X32K << 10)
    bus.write(WWDT_CTL, compare << 16 | prescaler << 8 | WWDT_INTERRUPT | WWDT_ENABLE)


def test_window_opens_with_an_interrupt(bus: Machine) -> None:
    assert bus.read(CNT) == 63
    start_window(bus, 20)
    bus.step(ticks(43 * 32) - 1)
    assert (bus.read(CNT), interrupts(bus, 2)) == (21, False)
    bus.step(1)
    assert (bus.read(CNT), bus.read(STATUS), interrupts(bus, 2)) == (20, WWDT_FLAG, True)
    bus.write(STATUS, WWDT_FLAG)
    assert not interrupts(bus, 2)


def test_restart_in_the_window(bus: Machine) -> None:
    start_window(bus, 20)
    for _ in range(3):
        bus.step(ticks(50 * 32))
        bus.write(RLDCNT, KEY)
        assert bus.read(CNT) == 63
    assert not resets(bus)


def test_restart_before_the_window_resets(bus: Machine) -> None:
    start_window(bus, 20)
    bus.step(ticks(10 * 32))
    bus.write(RLDCNT, KEY)
    assert resets(bus)
    assert (bus.read(STATUS), bus.read(RSTSTS)) == (WWDT_RESET_FLAG, POWER_ON | BY_WATCHDOG)


def test_no_restart_resets_at_zero(bus: Machine) -> None:
    start_window(bus, 20)
    bus.step(ticks(63 * 32) - 1)
    assert not resets(bus)
    bus.step(1)
    assert resets(bus)


def test_wrong_key_is_no_restart(bus: Machine) -> None:
    start_window(bus, 20)
    bus.step(ticks(10 * 32))
    bus.write(RLDCNT, 0)
    assert (bus.read(CNT), resets(bus)) == (53, False)


def test_control_is_fixed_while_it_runs(bus: Machine) -> None:
    start_window(bus, 20)
    before = bus.read(WWDT_CTL)
    bus.write(WWDT_CTL, 0)
    assert bus.read(WWDT_CTL) == before
    assert "nuc980-wwdt: CTL is fixed while it runs" in bus.complaints


# ---- snapshot


def test_delay_is_saved(bus: Machine, reborn: Callable[[Machine], Machine]) -> None:
    start(bus, 5, RESET_ENABLE)
    bus.step(ticks((1 << 14) + 1000))
    new = reborn(bus)
    new.step(ticks((1 << 14) + 1026) - ticks((1 << 14) + 1000) - 1)
    assert not resets(new)
    new.step(1)
    assert resets(new)


def test_lock_is_saved(bus: Machine, reborn: Callable[[Machine], Machine]) -> None:
    unlock(bus)
    new = reborn(bus)
    new.write(ALTCTL, 2)
    assert new.read(ALTCTL) == 2


def test_window_is_saved(bus: Machine, reborn: Callable[[Machine], Machine]) -> None:
    start_window(bus, 20)
    bus.step(ticks(50 * 32))
    new = reborn(bus)
    assert (new.read(CNT), interrupts(new, 2)) == (13, True)
    new.step(ticks(63 * 32) - ticks(50 * 32))
    assert resets(new)
