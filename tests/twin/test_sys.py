# SPDX-License-Identifier: GPL-3.0-or-later
"""System registers: locks, resets and their causes, clocks; and what is not modelled."""

import struct
from collections.abc import Callable
from pathlib import Path

import pytest

from nuc980.twin.machine import Machine

SYS = 0xB0000000
PDID, PWRON, MISCFCR = SYS, SYS + 0x004, SYS + 0x030
AHBIPRST, APBIPRST0, APBIPRST1, RSTSTS = SYS + 0x060, SYS + 0x064, SYS + 0x068, SYS + 0x06C
GPA_MFPL, RSTDEBCTL, REGWPCTL = SYS + 0x070, SYS + 0x10C, SYS + 0x1FC
HCLKEN, PCLKEN0, DIV0, DIV8, APLLCON, UPLLCON = (
    SYS + 0x200 + r for r in (0x10, 0x18, 0x20, 0x40, 0x60, 0x64)
)
POWER_ON, BY_CHIP = 1 << 0, 1 << 3

TIMER0, TIMER1 = 0xB0050000, 0xB0050100
TIMER_CTL, TIMER_PRECNT, TIMER_CMPR, TIMER_DR = 0x00, 0x04, 0x08, 0x14
AIC_INTMSK0, AIC_INTEN0 = 0xB0042128, 0xB0042130

KEYS = (0x59, 0x16, 0x88)

# mov r0, #0xb0000000; for each key: mov r1, #key; str r1, [r0, #0x1fc];
# mov r1, #1; str r1, [r0, #0x60]; b .
RESETS_ITSELF = struct.pack(
    "<10I",
    0xE3A0020B,
    *(word for key in KEYS for word in (0xE3A01000 | key, 0xE58011FC)),
    0xE3A01001,
    0xE5801060,
    0xEAFFFFFE,
)


def unlock(bus: Machine) -> None:
    for key in KEYS:
        bus.write(REGWPCTL, key)


@pytest.fixture
def loader(tmp_path: Path) -> Path:
    """A boot loader that does nothing but reset the chip."""
    file = tmp_path / "loader.bin"
    file.write_bytes(RESETS_ITSELF)
    return file


# ---- write protection


def test_three_keys_in_turn_unlock_and_any_other_value_locks(bus: Machine) -> None:
    assert bus.read(REGWPCTL) == 0
    unlock(bus)
    assert bus.read(REGWPCTL) == 1
    bus.write(REGWPCTL, 1)
    assert bus.read(REGWPCTL) == 0


@pytest.mark.parametrize("wrong", [(0x59, 0x88, 0x16), (0x16, 0x88), (0x59, 0x16, 0x00, 0x88), (0x59, 0x16)])
def test_wrong_keys_do_not_unlock(bus: Machine, wrong: tuple[int, ...]) -> None:
    for value in wrong:
        bus.write(REGWPCTL, value)
    assert bus.read(REGWPCTL) == 0


def test_unlocking_again_ends_unlocked_as_u_boot_expects(bus: Machine) -> None:
    unlock(bus)
    unlock(bus)
    assert bus.read(REGWPCTL) == 1


def test_first_key_may_come_twice(bus: Machine) -> None:
    bus.write(REGWPCTL, 0x59)
    unlock(bus)
    assert bus.read(REGWPCTL) == 1


@pytest.mark.parametrize("register", [PWRON, MISCFCR, RSTDEBCTL])
def test_protected_register(bus: Machine, register: int) -> None:
    before = bus.read(register)
    bus.write(register, 0x10000)
    assert bus.read(register) == before
    assert f"{register - SYS:#x} = 0x10000 needs REGWPCTL's three keys first" in bus.complaints
    unlock(bus)
    bus.write(register, 0x10000)
    assert bus.read(register) == 0x10000


def test_pins_and_clock_gates_are_not_protected(bus: Machine) -> None:
    for register in (GPA_MFPL, HCLKEN, PCLKEN0):
        bus.write(register, 0x40)
        assert bus.read(register) == 0x40
    assert "three keys" not in bus.complaints


def test_product_number_can_only_be_read(bus: Machine) -> None:
    number = bus.read(PDID)
    bus.write(PDID, 0)
    assert bus.read(PDID) == number
    assert "PDID can only be read" in bus.complaints


def test_straps_choose_the_nand_by_its_own_id(bus: Machine) -> None:
    """[7:6] page size and [9:8] error correction: 3, as the NAND says."""
    assert bus.read(PWRON) >> 6 & 0xF == 0xF


# ---- resets


def test_power_on_is_the_first_cause(bus: Machine) -> None:
    assert bus.read(RSTSTS) == POWER_ON
    bus.write(RSTSTS, POWER_ON)
    assert bus.read(RSTSTS) == 0


def test_guest_resets_the_chip_only_when_unlocked(bus: Machine) -> None:
    bus.write(AHBIPRST, 1)
    assert not bus.events("RESET")
    unlock(bus)
    bus.write(AHBIPRST, 1)
    assert bus.wait_for_event("RESET") == {"guest": True, "reason": "guest-reset"}


def test_cause_of_a_chip_reset_survives_it(bus: Machine) -> None:
    bus.write(RSTSTS, POWER_ON)
    bus.write(GPA_MFPL, 0x44)
    unlock(bus)
    bus.write(AHBIPRST, 1)
    bus.wait_for_event("RESET")
    assert bus.read(RSTSTS) == BY_CHIP
    assert (bus.read(GPA_MFPL), bus.read(REGWPCTL), bus.read(AHBIPRST)) == (0, 0, 0)


def test_reset_from_outside_counts_as_power_on(bus: Machine) -> None:
    unlock(bus)
    bus.write(AHBIPRST, 1)
    bus.wait_for_event("RESET")
    bus.command("system_reset")
    assert bus.wait_for_event("RESET")["guest"] is False
    assert bus.read(RSTSTS) == POWER_ON


def test_program_that_resets_the_chip_starts_again(board: Callable[..., Machine], loader: Path) -> None:
    machine = board("-bios", loader)
    for _ in range(3):
        assert machine.wait_for_event("RESET")["reason"] == "guest-reset"
    machine.command("stop")
    assert machine.read(RSTSTS) == POWER_ON | BY_CHIP


def test_no_reboot_ends_the_run(board: Callable[..., Machine], loader: Path) -> None:
    machine = board("-bios", loader, "-no-reboot", "-no-shutdown")
    assert machine.wait_for_event("SHUTDOWN")["reason"] == "guest-reset"


def test_reset_bit_of_a_timer_resets_that_timer_only(bus: Machine) -> None:
    for timer in (TIMER0, TIMER1):
        bus.write(timer + TIMER_CMPR, 0x1234)
    bus.write(APBIPRST0, 1 << 8)
    bus.write(APBIPRST0, 0)
    assert (bus.read(TIMER0 + TIMER_CMPR), bus.read(TIMER1 + TIMER_CMPR)) == (0, 0x1234)


def test_block_is_reset_as_its_bit_rises(bus: Machine) -> None:
    bus.write(APBIPRST0, 1 << 4)
    bus.write(AIC_INTEN0, 0xFE)
    bus.write(APBIPRST0, 1 << 4)
    assert bus.read(AIC_INTMSK0) == 0xFE
    bus.write(APBIPRST0, 0)
    assert bus.read(AIC_INTMSK0) == 0xFE
    bus.write(APBIPRST0, 1 << 4)
    assert (bus.read(AIC_INTMSK0), bus.read(APBIPRST0)) == (0, 1 << 4)


@pytest.mark.parametrize(
    ("register", "bits"),
    [
        (AHBIPRST, [4, 5, 6, 7, 16, 17, 20]),
        (APBIPRST0, [4, *range(8, 14), *range(16, 26)]),
        (APBIPRST1, [4, 5, 6]),
    ],
)
def test_every_modelled_block_survives_its_reset(bus: Machine, register: int, bits: list[int]) -> None:
    for bit in bits:
        bus.write(register, 1 << bit)
        bus.write(register, 0)
    assert bus.read(register) == 0


# ---- clocks


def measure(bus: Machine, prescaler: int) -> int:
    """Ticks of ETIMER0 in a second, from HCLK."""
    bus.write(DIV8, 1 << 16)
    bus.write(TIMER0 + TIMER_PRECNT, prescaler - 1)
    bus.write(TIMER0 + TIMER_CTL, 0x31)
    bus.step(1_000_000_000)
    return bus.read(TIMER0 + TIMER_DR)


@pytest.mark.parametrize(
    ("source", "register", "value", "megahertz"),
    [
        (0, UPLLCON, 0, 12),
        (2, APLLCON, 0x50000015, 264),
        (3, UPLLCON, 0xD0000018, 300),
        (3, UPLLCON, 0xD0000000 | 1 << 13 | 2 << 7 | 49, 100),
    ],
)
def test_system_clock(bus: Machine, source: int, register: int, value: int, megahertz: int) -> None:
    """12 MHz * N / (M * P); HCLK is half of the system's clock."""
    bus.write(register, value)
    bus.write(DIV0, source << 3)
    assert measure(bus, 250) == megahertz * 1_000_000 // 2 // 250


def test_system_clock_divider(bus: Machine) -> None:
    bus.write(UPLLCON, 0xD0000018)
    bus.write(DIV0, 3 << 3 | 1 << 8)
    assert measure(bus, 250) == 75_000_000 // 250


def test_clock_gates_are_kept_but_stop_nothing(bus: Machine) -> None:
    bus.write(PCLKEN0, 0)
    assert measure(bus, 250) == 6_000_000 // 250


def test_after_a_boot_loader_the_system_runs_at_300_mhz(board: Callable[..., Machine], loader: Path) -> None:
    bus = board("-bios", loader, registers=True)
    assert bus.read(HCLKEN) >> 11 & 1 == 1
    assert bus.read(PCLKEN0) & 0x10100 == 0x10100
    assert measure(bus, 250) == 150_000_000 // 250


# ---- what is not modelled


@pytest.mark.parametrize(
    ("address", "name"),
    [
        (0xB0010000, "nuc980-ebi"),
        (0xB0014004, "nuc980-ccap1"),
        (0xB0015020, "nuc980-ehci"),
        (0xB0016000, "nuc980-usbd"),
        (0xB0017000, "nuc980-ohci"),
        (0xB0018820, "nuc980-sdh"),
        (0xB001C000, "nuc980-crypto"),
        (0xB0020000, "nuc980-i2s"),
        (0xB0024000, "nuc980-ccap0"),
        (0xB0043000, "nuc980-adc"),
        (0xB0058000, "nuc980-pwm0"),
        (0xB0059FFC, "nuc980-pwm1"),
        (0xB0080000, "nuc980-i2c0"),
        (0xB0083000, "nuc980-i2c3"),
        (0xB0090000, "nuc980-sc0"),
        (0xB00A0000, "nuc980-can0"),
        (0xB00A3000, "nuc980-can3"),
    ],
)
def test_block_that_is_not_modelled_names_itself_once_for_each_register(
    bus: Machine, address: int, name: str
) -> None:
    for _ in range(3):
        bus.write(address, 0xFFFFFFFF)
        assert bus.read(address) == 0
    assert bus.complaints == f"{name}: register {address % 0x1000:#x} is not modelled\n"
    bus.read(address ^ 8)
    assert bus.complaints.count("\n") == 2


def test_address_without_a_block_is_told_too(bus: Machine) -> None:
    assert bus.read(0xB00F0000) == bus.read(0xB00F0000) == 0
    assert bus.complaints == "nuc980: register 0xf0000 is not modelled\n"


@pytest.mark.parametrize("address", [0xB0000008, 0xB0000020, 0xB0000040, 0xB0000050, 0xB0000100, 0xB0002000])
def test_system_register_without_effect_is_told_once(bus: Machine, address: int) -> None:
    for _ in range(2):
        bus.write(address, 1)
        bus.read(address)
    assert bus.complaints.count("is not modelled") == 1


# ---- snapshot


def test_keys_and_cause_are_saved(bus: Machine, reborn: Callable[[Machine], Machine]) -> None:
    unlock(bus)
    bus.write(AHBIPRST, 1)
    bus.wait_for_event("RESET")
    for key in KEYS[:2]:
        bus.write(REGWPCTL, key)
    new = reborn(bus)
    assert (new.read(RSTSTS), new.read(REGWPCTL)) == (POWER_ON | BY_CHIP, 0)
    new.write(REGWPCTL, KEYS[2])
    assert new.read(REGWPCTL) == 1
