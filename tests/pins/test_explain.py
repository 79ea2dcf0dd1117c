# SPDX-License-Identifier: GPL-3.0-or-later
"""What explain tells of pins, signals, devices, settings, GPIOs, registers and rules."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from nuc980.errors import UnusableInput
from nuc980.pins.board import load_board
from nuc980.pins.chip import load_chip, pin_order
from nuc980.pins.explain import explain
from nuc980.pins.rules import RULES

CHIP = load_chip()
BOARD = load_board(Path(__file__).resolve().parents[2] / "board/nuc980/boards/gateway/pins.yml", CHIP)


def explained(word: str) -> str:
    return "\n".join(explain(word, CHIP, BOARD))


def line(word: str, start: str) -> str:
    """The line of an answer that begins so, its columns one space apart."""
    lines = (re.sub(r"\s+", " ", text).strip() for text in explain(word, CHIP, BOARD))
    return next(text for text in lines if text.startswith(start))


def test_each_pin_with_all_its_functions_and_how_to_write_them() -> None:
    for pin, functions in CHIP.pins.items():
        bank, index = pin_order(pin)
        rows = [row.replace("*", " ").split() for row in explain(pin, CHIP, BOARD)]
        for value, signal in functions.items():
            cells = f"<{bank} {index} {value} 0>".split()
            assert [str(value), signal, *cells] in [row[:6] for row in rows], pin
        for name, package in CHIP.packages.items():
            assert f"{name} {package.bonded.get(pin, 'not brought out')}" in explained(pin)
        assert explain(pin.lower(), CHIP, BOARD) == explain(pin, CHIP, BOARD)


def test_a_pin_of_the_table() -> None:
    assert explained("PA0").startswith("PA0: GPIO 0,")
    assert line("PA0", "register") == "register 0xb0000070, bits 3..0; the pin table makes it 4"
    assert line("PA0", "pin table") == "pin table UART1_RXD of uart1, RS-485, /dev/ttyS1"
    assert line("PA0", "interrupt") == "interrupt EINT0 with function 5; second cell of eint0-config: 0"
    assert line("PA0", "*") == "* 4 UART1_RXD <0 0 4 0> uart1"
    assert line("PF10", "register") == "register 0xb000009c, bits 11..8; the pin table makes it 2"


def test_a_pin_as_the_report_writes_it() -> None:
    assert explained("F10") == explained("PF10")


@pytest.mark.parametrize(
    ("pin", "who"),
    [
        ("PG0", "reserved: boot strap"),
        ("PA1", "free, wiring unknown"),
        ("PB9", "not brought out by the LQFP128"),
    ],
)
def test_a_pin_that_no_device_of_the_table_has(pin: str, who: str) -> None:
    assert line(pin, "pin table").startswith(f"pin table {who}")
    assert "*" not in explained(pin)


def test_gpios_and_unconnected_pins_of_a_table(tmp_path: Path) -> None:
    file = tmp_path / "pins.yml"
    file.write_text("part: NUC980DK61YC\ngpios: {PE10: reset of the PHY}\nnot_connected: [PE12]\n")
    board = load_board(file, CHIP)
    assert "  pin table    GPIO of gpios, reset of the PHY" in explain("PE10", CHIP, board)
    assert "  pin table    not connected" in explain("PE12", CHIP, board)


def test_without_a_table_nobody_is_named() -> None:
    for word in ("PA0", "UART8_TXD", "uart8", "<4 7 1 0>", "0xb0000070"):
        text = "\n".join(explain(word, CHIP, None))
        assert "pin table" not in text
        assert "ttyS" not in text


def test_a_signal_with_all_places_and_who_is_there() -> None:
    assert explained("UART8_TXD").startswith("UART8_TXD: signal of uart8")
    assert line("UART8_TXD", "* PA12") == (
        "* PA12 <0 12 2 0> LQFP128 19 UART8_TXD of uart8, RS-485, /dev/ttyS8"
    )
    assert line("UART8_TXD", "PB8") == "PB8 <1 8 4 0> LQFP128 42 free, wiring unknown"
    assert line("uart8_txd", "PC12").endswith("LQFP128 56 NAND_DATA4 of fmi, NAND flash, 128 MiB")
    assert line("UART3_TXD", "PB9") == "PB9 <1 9 1 0> not in LQFP128"
    assert "signal of sc0 or scuart0" in explained("SC0_DAT")


def test_each_signal_is_explained() -> None:
    for signal, places in CHIP.signals.items():
        assert [pin for pin, _ in places] == re.findall(r"P[A-G]\d+(?= +<)", explained(signal)), signal


def test_a_device() -> None:
    assert explained("uart8").startswith("uart8: /apb/serial@b0078000")
    assert line("UART8", "compatible") == "compatible nuvoton,nuc980-uart"
    assert line("uart8", "registers") == "registers 0xb0078000, 0x1000 bytes"
    assert line("uart8", "interrupts") == "interrupts 41 (UART8)"
    assert line("uart8", "pin table") == "pin table RS-485, /dev/ttyS8"
    assert line("uart8", "UART8_TXD") == "UART8_TXD PA12 <0 12 2 0>*, PB8 <1 8 4 0>, PC12 <2 12 7 0>"
    assert "PB9 <1 9 1 0> (not brought out)" in line("uart3", "UART3_TXD")
    assert line("spi0", "pin table") == "pin table not used"


def test_each_device_is_explained_with_all_its_signals() -> None:
    for label, device in CHIP.peripherals.items():
        assert {signal for signal in CHIP.signals if device.owns(signal)} == {
            words[0] for words in map(str.split, explain(label, CHIP, BOARD)) if words[0] in CHIP.signals
        }, label


@pytest.mark.parametrize("word", ["<4 7 1 0>", "4 7 1 0", "0x4 0x7 0x1 0x0", " < 4  7 1 0 > "])
def test_a_setting(word: str) -> None:
    assert explained(word).startswith("<4 7 1 0>: PE7 as RMII0_TXD0 of emac0")
    assert line(word, "fourth cell") == (
        "fourth cell 0: pin configuration; the vendor's driver stores it and never uses it"
    )
    assert line(word, "pin table").endswith("Ethernet port 1, eth0: this one")


def test_settings_that_disagree_or_cannot_be() -> None:
    assert line("<5 0xa 8 0>", "pin table") == "pin table UART1_TXD of uart1, RS-485, /dev/ttyS1: another one"
    assert line("<5 0xb 3 0>", "function") == "function 3: PF11 has 0 GPIO, 1 UART0_RXD"
    assert "PF11 as no function that it has" in explained("<5 0xb 3 0>")
    assert "P9.1 does not exist" in explained("<9 1 2 0>")
    assert "PB14 does not exist" in explained("<1 14 0 0>")


def test_a_group_of_settings() -> None:
    starts = [text for text in explain("<0 0 4 0 5 0xa 2 0>", CHIP, BOARD) if text.startswith("<")]
    assert starts == ["<0 0 4 0>: PA0 as UART1_RXD of uart1", "<5 10 2 0>: PF10 as UART1_TXD of uart1"]


@pytest.mark.parametrize("word", ["gpio 138", "GPIO 0x8a", "<&gpio 138 1>"])
def test_a_gpio(word: str) -> None:
    first, *rest = explain(word, CHIP, BOARD)
    assert first == "GPIO 138 is PE10: 32 x 4 (bank E) + 10"
    assert rest == explain("PE10", CHIP, BOARD)


def test_a_register() -> None:
    text = explained("0xB0000070")
    assert text.startswith("0xb0000070: multi-function register of PA0 to PA7")
    assert line("0xb0000070", "PA4") == (
        "PA4 bits 19..16; the pin table makes it 1 UART6_RXD of uart6, RS-485, /dev/ttyS6"
    )
    assert explained("0xb0078000") == explained("uart8")


@pytest.mark.parametrize("name", RULES)
def test_a_rule(name: str) -> None:
    first, *why = explain(name, CHIP, BOARD)
    assert first == f"{name}: {RULES[name].what}"
    assert " ".join(map(str.strip, why)) == " ".join(RULES[name].why.split())


def test_list_of_the_rules() -> None:
    assert [row.split()[0] for row in explain("rules", CHIP, BOARD)] == list(RULES)


@pytest.mark.parametrize(
    ("word", "hint"),
    [
        ("PB14", "bank B has PB0 to PB13"),
        ("PA99", "bank A has PA0 to PA15"),
        ("UART8_TX", "did you mean UART8_TXD"),
        ("usart3", "did you mean uart3"),
        ("pin-conflit", "did you mean pin-conflict"),
        ("4 7 1", "four for each pin"),
        ("138", "write gpio before the number"),
        ("gpio 31", "no pin has this number"),
        ("gpio 4000000000", "no pin has this number"),
        ("0xdeadbeef", "neither a multi-function register"),
        ("", "explain takes PA0"),
        ("4 f 1 0", "explain takes PA0"),
        ("9" * 5000, "explain takes PA0"),
        ("<&gpio>", "explain takes PA0"),
    ],
)
def test_what_is_unknown_gets_a_hint(word: str, hint: str) -> None:
    with pytest.raises(UnusableInput, match=hint):
        explain(word, CHIP, BOARD)
