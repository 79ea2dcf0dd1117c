# SPDX-License-Identifier: GPL-3.0-or-later
"""GPIO: modes, pulls, masks, and the interrupts of ports and of EINT0 to EINT3."""

from collections.abc import Callable

import pytest

from nuc980.pins.chip import GPIO, load_chip, pin_order
from nuc980.twin.machine import Machine

CHIP = load_chip()
GPIO_BASE = 0xB0004000
MODE, DINOFF, DOUT, DATMSK, PIN, DBEN = 0x00, 0x04, 0x08, 0x0C, 0x10, 0x14
INTTYPE, INTEN, INTSRC, SMTEN, SLEWCTL, PUSEL = 0x18, 0x1C, 0x20, 0x24, 0x28, 0x30
DBCTL = GPIO_BASE + 0x440
PDIO = GPIO_BASE + 0x800
INPUT, OUTPUT, OPEN_DRAIN, QUASI = range(4)
PULL_UP, PULL_DOWN = 1, 2
RISING, FALLING = 1 << 16, 1
RAW_STATUS = (0xB0042100, 0xB0042104)
PORT_SOURCES = {
    "A": "GPA", "B": "GPB", "C": "GPC", "D": "GPD", "E": "GPE", "F": "GPF", "G": "GPG",
}  # fmt: skip


def register(pin: str, offset: int) -> int:
    return GPIO_BASE + 0x40 * pin_order(pin)[0] + offset


def field(machine: Machine, pin: str, offset: int, value: int) -> None:
    """Sets the two bits of a pin."""
    address, shift = register(pin, offset), 2 * pin_order(pin)[1]
    machine.write(address, machine.read(address) & ~(3 << shift) | value << shift)


def bit(machine: Machine, pin: str, offset: int, value: bool) -> None:
    address, mask = register(pin, offset), 1 << pin_order(pin)[1]
    machine.write(address, machine.read(address) & ~mask | (mask if value else 0))


def reads(machine: Machine, pin: str) -> bool:
    return bool(machine.read(register(pin, PIN)) >> pin_order(pin)[1] & 1)


def press(machine: Machine, pin: str, level: bool) -> None:
    machine.command("qom-set", path="/machine/soc/gpio", property=pin, value=level)


def level(machine: Machine, pin: str) -> bool:
    return machine.command("qom-get", path="/machine/soc/gpio", property=pin)


def pdio(pin: str) -> int:
    bank, index = pin_order(pin)
    return PDIO + 0x40 * bank + 4 * index


def switch(machine: Machine, pin: str, signal: str) -> None:
    address, shift = CHIP.register_of(pin)
    machine.write(address, machine.read(address) & ~(0xF << shift) | CHIP.value(pin, signal) << shift)


def interrupts(machine: Machine) -> set[str]:
    """What the GPIO block asks of the interrupt controller, by the names of its sources."""
    low, high = (machine.read(address) for address in RAW_STATUS)
    names = {*PORT_SOURCES.values(), "EXTI0", "EXTI1", "EXTI2", "EXTI3"}
    return {name for name in names if (high << 32 | low) >> CHIP.interrupts[name] & 1}


# ---- levels


@pytest.mark.parametrize(
    ("mode", "out", "outside", "pull", "expected"),
    [
        (INPUT, True, None, 0, False),
        (INPUT, False, None, PULL_UP, True),
        (INPUT, True, None, PULL_DOWN, False),
        (INPUT, False, True, PULL_DOWN, True),
        (INPUT, True, False, PULL_UP, False),
        (OUTPUT, True, None, 0, True),
        (OUTPUT, False, None, PULL_UP, False),
        (OUTPUT, True, False, 0, True),
        (OPEN_DRAIN, False, True, PULL_UP, False),
        (OPEN_DRAIN, True, None, 0, False),
        (OPEN_DRAIN, True, None, PULL_UP, True),
        (OPEN_DRAIN, True, False, PULL_UP, False),
        (QUASI, True, None, 0, True),
        (QUASI, True, False, 0, False),
        (QUASI, False, True, 0, False),
    ],
)
def test_mode(bus: Machine, mode: int, out: bool, outside: bool | None, pull: int, expected: bool) -> None:
    for pin in ("PA3", "PE12"):
        field(bus, pin, MODE, mode)
        field(bus, pin, PUSEL, pull)
        bit(bus, pin, DOUT, out)
        if outside is not None:
            press(bus, pin, outside)
        assert (reads(bus, pin), level(bus, pin), bus.read(pdio(pin))) == (expected, expected, expected)


def test_pins_do_not_touch_each_other(bus: Machine) -> None:
    for pin in CHIP.pins:
        press(bus, pin, True)
        assert [other for other in CHIP.pins if reads(bus, other)] == [pin]
        press(bus, pin, False)


def test_level_from_the_human_monitor(bus: Machine) -> None:
    bus.monitor("qom-set /machine/soc/gpio PC3 true")
    assert reads(bus, "PC3")
    assert bus.monitor("qom-get /machine/soc/gpio PC3").strip() == "true"


def test_level_from_outside_stays_through_a_reset(bus: Machine) -> None:
    field(bus, "PB4", MODE, OUTPUT)
    press(bus, "PB4", True)
    bus.command("system_reset")
    assert bus.read(register("PB4", MODE)) == 0
    assert reads(bus, "PB4")


def test_pdio_sets_one_bit_of_dout(bus: Machine) -> None:
    bus.write(register("PD0", DOUT), 0x00F0)
    field(bus, "PD8", MODE, OUTPUT)
    bus.write(pdio("PD8"), 1)
    bus.write(pdio("PD4"), 0)
    assert bus.read(register("PD0", DOUT)) == 0x01E0
    assert reads(bus, "PD8")


def test_datmsk_protects_dout_but_not_from_pdio(bus: Machine) -> None:
    bus.write(register("PA0", DOUT), 0x0F0F)
    bus.write(register("PA0", DATMSK), 0x00FF)
    bus.write(register("PA0", DOUT), 0xF0F0)
    assert bus.read(register("PA0", DOUT)) == 0xF00F
    bus.write(pdio("PA0"), 0)
    assert bus.read(register("PA0", DOUT)) == 0xF00E


def test_dinoff_ties_the_input_low(bus: Machine) -> None:
    press(bus, "PF5", True)
    bus.write(register("PF5", DINOFF), 1 << 16 + 5)
    assert (reads(bus, "PF5"), level(bus, "PF5")) == (False, True)
    bus.write(register("PF5", DINOFF), 0)
    assert reads(bus, "PF5")


def test_pin_of_a_peripheral_does_not_follow_dout(bus: Machine) -> None:
    field(bus, "PA4", MODE, OUTPUT)
    bit(bus, "PA4", DOUT, True)
    assert reads(bus, "PA4")
    switch(bus, "PA4", "UART6_RXD")
    assert not reads(bus, "PA4")
    bit(bus, "PA4", DOUT, False)
    assert "output on PA4, which a peripheral has" in bus.complaints
    switch(bus, "PA4", GPIO)
    bit(bus, "PA4", DOUT, True)
    assert reads(bus, "PA4")


# ---- interrupts


@pytest.mark.parametrize("port", PORT_SOURCES)
def test_each_port_has_its_interrupt(bus: Machine, port: str) -> None:
    pin = f"P{port}6"
    bus.write(register(pin, INTEN), RISING << 6)
    press(bus, pin, True)
    assert bus.read(register(pin, INTSRC)) == 1 << 6
    assert interrupts(bus) == {PORT_SOURCES[port]}
    bus.write(register(pin, INTSRC), 1 << 5)
    assert interrupts(bus) == {PORT_SOURCES[port]}
    bus.write(register(pin, INTSRC), 1 << 6)
    assert interrupts(bus) == set()


@pytest.mark.parametrize(
    ("enable", "on_rising", "on_falling"),
    [(RISING, True, False), (FALLING, False, True), (RISING | FALLING, True, True), (0, False, False)],
)
def test_edges(bus: Machine, enable: int, on_rising: bool, on_falling: bool) -> None:
    bus.write(register("PC9", INTEN), enable << 9)
    assert interrupts(bus) == set()
    for value, expected in ((True, on_rising), (False, on_falling)):
        press(bus, "PC9", value)
        assert interrupts(bus) == ({"GPC"} if expected else set())
        bus.write(register("PC9", INTSRC), 0xFFFF)
        press(bus, "PC9", value)  # no edge
        assert interrupts(bus) == set()


@pytest.mark.parametrize(("enable", "active"), [(RISING, True), (FALLING, False)])
def test_level_holds_the_interrupt(bus: Machine, enable: int, active: bool) -> None:
    press(bus, "PE10", not active)
    bus.write(register("PE10", INTTYPE), 1 << 10)
    bus.write(register("PE10", INTEN), enable << 10)
    assert interrupts(bus) == set()
    press(bus, "PE10", active)
    bus.write(register("PE10", INTSRC), 1 << 10)  # still there: the level is
    assert interrupts(bus) == {"GPE"}
    press(bus, "PE10", not active)
    assert interrupts(bus) == {"GPE"}
    bus.write(register("PE10", INTSRC), 1 << 10)
    assert interrupts(bus) == set()


def test_both_levels_are_no_setting(bus: Machine) -> None:
    bus.write(register("PE10", INTTYPE), 1 << 10)
    bus.write(register("PE10", INTEN), (RISING | FALLING) << 10)
    press(bus, "PE10", True)
    press(bus, "PE10", False)
    assert bus.read(register("PE10", INTSRC)) == 0


def test_an_output_can_interrupt_too(bus: Machine) -> None:
    field(bus, "PG9", MODE, OUTPUT)
    bit(bus, "PG9", DOUT, False)
    bus.write(register("PG9", INTEN), RISING << 9)
    bit(bus, "PG9", DOUT, True)
    assert interrupts(bus) == {"GPG"}


@pytest.mark.parametrize(("eint", "pin"), [(eint, pin) for eint, pins in CHIP.eint.items() for pin in pins])
def test_external_interrupt(bus: Machine, eint: str, pin: str) -> None:
    bank, index = pin_order(pin)
    switch(bus, pin, eint.upper())
    bus.write(register(pin, INTEN), FALLING << index)
    press(bus, pin, True)
    assert interrupts(bus) == set()
    press(bus, pin, False)
    assert interrupts(bus) == {f"EXTI{eint[-1]}"}
    switch(bus, pin, GPIO)
    assert interrupts(bus) == {PORT_SOURCES["ABCDEFG"[bank]]}
    switch(bus, pin, eint.upper())
    bus.write(register(pin, INTSRC), 1 << index)
    assert interrupts(bus) == set()


# ---- registers


def test_registers_keep_their_bits(bus: Machine) -> None:
    kept = {
        MODE: 0xFFFFFFFF, DINOFF: 0xFFFF0000, DATMSK: 0xFFFF, DBEN: 0xFFFF, INTTYPE: 0xFFFF,
        SMTEN: 0xFFFF, SLEWCTL: 0xFFFFFFFF, PUSEL: 0xFFFFFFFF,
    }  # fmt: skip
    for port in PORT_SOURCES:
        for offset, mask in kept.items():
            bus.write(register(f"P{port}0", offset), 0xFFFFFFFF)
            assert bus.read(register(f"P{port}0", offset)) == mask
    bus.write(DBCTL, 0xFFFFFFFF)
    assert bus.read(DBCTL) == 0x3F


def test_what_is_not_modelled_is_told_once(bus: Machine) -> None:
    for _ in range(2):
        bus.write(register("PB0", DBEN), 1)
        bus.read(GPIO_BASE + 0x1C0)  # port H: of the header, not of the chip
        bus.read(GPIO_BASE + 0x2C)
    told = [line for line in bus.complaints.splitlines() if "nuc980-gpio" in line]
    assert [line.split("0x")[1].split()[0] for line in told] == ["54", "1c0", "2c"]
    bus.write(register("PB0", PIN), 1)
    assert "write to PIN of port B" in bus.complaints


def test_state_is_saved(bus: Machine, reborn: Callable[[Machine], Machine]) -> None:
    switch(bus, "PE10", "EINT2")
    switch(bus, "PA4", "UART6_RXD")
    bus.write(register("PA0", INTEN), RISING << 3 | RISING << 7)
    bus.write(register("PE10", INTEN), FALLING << 10)
    for pin, value in (("PA3", True), ("PA7", True), ("PE10", True), ("PE10", False)):
        press(bus, pin, value)
    bus.write(register("PA0", INTSRC), 1 << 7)
    field(bus, "PA4", MODE, OUTPUT)
    field(bus, "PB2", MODE, QUASI)
    new = reborn(bus)
    assert interrupts(new) == {"GPA", "EXTI2"}
    assert new.read(register("PA0", INTSRC)) == 1 << 3  # PA7 has not risen again
    assert new.read(register("PA0", PIN)) == 1 << 3 | 1 << 7  # PA4 is still the UART's
    assert new.read(register("PB0", PIN)) == 1 << 2
    new.write(register("PE10", INTSRC), 1 << 10)
    press(new, "PE10", True)
    assert interrupts(new) == {"GPA"}
    press(new, "PE10", False)
    assert interrupts(new) == {"GPA", "EXTI2"}
