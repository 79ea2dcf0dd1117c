# SPDX-License-Identifier: GPL-3.0-or-later
"""The chip's data against itself, and single pins against the project report and the vendor's sources."""

import pytest

from nuc980.pins.chip import BANKS, GPIO, gpio_number, load_chip, pin_name, pin_of_gpio, pin_order

CHIP = load_chip()


def test_size_is_what_the_sources_count() -> None:
    """104 pins; 528 names in the vendor's tool, of which 12 are SD's second name, eMMC."""
    assert len(CHIP.pins) == 104
    assert (
        sum(signal != GPIO for functions in CHIP.pins.values() for signal in functions.values()) == 528 - 12
    )


def test_pins_a_bank() -> None:
    counts = {bank: sum(pin[1] == bank for pin in CHIP.pins) for bank in BANKS}
    assert counts == {"A": 16, "B": 14, "C": 16, "D": 16, "E": 13, "F": 13, "G": 16}


def test_every_pin_can_be_gpio_and_has_each_signal_once() -> None:
    for pin, functions in CHIP.pins.items():
        assert functions[0] == GPIO, pin
        assert len(set(functions.values())) == len(functions), pin
        assert all(0 <= value <= 15 for value in functions), pin


@pytest.mark.parametrize(("package", "port_pins"), [("LQFP64", 40), ("LQFP128", 92), ("LQFP216", 104)])
def test_packages(package: str, port_pins: int) -> None:
    case = CHIP.packages[package]
    assert case.pins == int(package.removeprefix("LQFP"))
    assert len(case.bonded) == port_pins
    assert set(case.bonded) <= set(CHIP.pins)


@pytest.mark.parametrize(("letter", "package"), [("R", "LQFP64"), ("K", "LQFP128"), ("F", "LQFP216")])
def test_package_of_a_part_is_that_of_its_letter(letter: str, package: str) -> None:
    """Those of the vendor's NuWriter among them."""
    parts = [part for part in CHIP.parts if part.startswith(f"NUC980D{letter}")]
    assert {CHIP.parts[part] for part in parts} == {package}
    assert {"NUC980DR41YC", "NUC980DF61YC"} <= CHIP.parts.keys()


def test_every_signal_has_an_owner() -> None:
    """But those of no node: debug port, clock output, and two timers that the vendor's tree lacks."""
    ownerless = {signal.partition("_")[0] for signal in CHIP.signals if not CHIP.owners(signal)}
    assert ownerless == {"JTAG0", "JTAG1", "CLK", "TM4", "TM5"}


def test_every_set_names_signals_that_exist() -> None:
    for peripheral in CHIP.peripherals.values():
        for prefix, wanted in peripheral.signals.items():
            names = {*wanted.required, *wanted.some, *(name for group in wanted.together for name in group)}
            missing = {name for name in names if prefix + name not in CHIP.signals}
            # UART0 has neither RTS nor CTS on any pin.
            assert missing == ({"RTS", "CTS"} if peripheral.label == "uart0" else set()), peripheral.label


def test_peripherals_interrupts_are_known() -> None:
    for peripheral in CHIP.peripherals.values():
        assert set(peripheral.interrupts) <= CHIP.interrupts.keys(), peripheral.label


@pytest.mark.parametrize(
    ("pin", "value", "signal"),
    [("PA0", 4, "UART1_RXD"), ("PF10", 2, "UART1_TXD"), ("PE9", 1, "RMII0_MDC"), ("PG15", 4, "EINT3")],
)
def test_functions_of_the_report(pin: str, value: int, signal: str) -> None:
    assert CHIP.signal(pin, value) == signal
    assert CHIP.value(pin, signal) == value


def test_what_does_not_exist() -> None:
    assert CHIP.signal("PB14", 0) is None
    assert CHIP.signal("PB2", 3) is None  # the vendor's group i2s-PB
    assert CHIP.value("PA0", "UART1_TXD") is None


@pytest.mark.parametrize(
    ("pin", "register", "shift"),
    [("PA0", 0xB0000070, 0), ("PA8", 0xB0000074, 0), ("PF10", 0xB000009C, 8), ("PG15", 0xB00000A4, 28)],
)
def test_register(pin: str, register: int, shift: int) -> None:
    assert CHIP.register_of(pin) == (register, shift)


def test_gpio_numbers() -> None:
    assert gpio_number("PE10") == 138  # the report's keys node
    assert all(pin_of_gpio(gpio_number(pin)) == pin == pin_name(*pin_order(pin)) for pin in CHIP.pins)
    assert pin_of_gpio(20) == "P0.20"
    with pytest.raises(ValueError, match="PH0"):
        pin_order("PH0")
