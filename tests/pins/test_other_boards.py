# SPDX-License-Identifier: GPL-3.0-or-later
"""
30 mistakes, thought of with two public NUC980 boards in hand and before the rules were read: a sensor node
with CAN and an SPI flash (C), and an IoT board with an SPI NAND and sound (G). Both are written here anew,
with the same devices and pins. The rules of that time found 13 of the 30.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import pytest
from trees import CHIP, device, read

from nuc980.pins.board import Board
from nuc980.pins.findings import Finding
from nuc980.pins.limits import Limits
from nuc980.pins.rules import check
from nuc980.pins.tree import Tree

Pins = Mapping[str, Mapping[str, str]]

RMII = ("RXERR", "CRSDV", "RXD1", "RXD0", "REFCLK", "TXEN", "TXD1", "TXD0", "MDIO", "MDC")
QSPI = {"QSPI0_SS0": "PD2", "QSPI0_CLK": "PD3", "QSPI0_MOSI0": "PD4", "QSPI0_MISO0": "PD5"}
CONSOLE = {"UART0_RXD": "PF11", "UART0_TXD": "PF12"}

NODE_PINS: Pins = {
    "uart0": CONSOLE,
    "uart4": {"UART4_TXD": "PC9", "UART4_RXD": "PC10"},
    "uart8": {"UART8_TXD": "PC12", "UART8_RXD": "PC13", "UART8_RTS": "PC14", "UART8_CTS": "PC15"},
    "can3": {"CAN3_RXD": "PA0", "CAN3_TXD": "PA1"},
    "emac1": {f"RMII1_{name}": f"PF{number}" for number, name in enumerate(RMII)},
    "qspi0": QSPI,
}
NODE_MORE = """
/ { chosen { bootargs = "root=/dev/ram0 console=ttyS0,115200n8 mem=64M"; }; };
&qspi0 {
    flash: flash@0 {
        compatible = "w25q256"; reg = <0>; #address-cells = <1>; #size-cells = <1>;
        spi-max-frequency = <30000000>;
        partition@0 { label = "uboot"; reg = <0x0 0x40000>; read-only; };
        kernel: partition@1 { label = "kernel"; reg = <0x200000 0xc00000>; };
        partition@2 { label = "dtb"; reg = <0xe00000 0x10000>; };
        rootfs: partition@3 { label = "rootfs"; reg = <0xe10000 0x11f0000>; };
    };
};
"""

IOT_PINS: Pins = {
    "uart0": CONSOLE,
    "uart1": {"UART1_RXD": "PF9", "UART1_TXD": "PF10", "UART1_RTS": "PF8", "UART1_CTS": "PF7"},
    "emac0": {f"RMII0_{name}": f"PE{number}" for number, name in enumerate(RMII)},
    "qspi0": QSPI | {"QSPI0_MOSI1": "PD6", "QSPI0_MISO1": "PD7"},
    "spi0": {"SPI0_SS0": "PD8", "SPI0_CLK": "PD9", "SPI0_MOSI": "PD10", "SPI0_MISO": "PD11"},
    "i2c0": {"I2C0_SDA": "PA0", "I2C0_SCL": "PA1"},
    "i2c2": {"I2C2_SDA": "PB7", "I2C2_SCL": "PB5"},
    "i2s": {"I2S_LRCK": "PA2", "I2S_BCLK": "PA3", "I2S_DI": "PA4", "I2S_DO": "PA5", "I2S_MCLK": "PA6"},
}
IOT_MORE = """
/ { chosen { bootargs = "root=/dev/ram0 console=ttyS0,115200n8 mem=128M"; }; };
&i2c0 { nau8822@1a { compatible = "nuvoton,nau8822"; reg = <0x1a>; }; };
&qspi0 {
    flash@0 {
        compatible = "spi-nand"; reg = <0>; #address-cells = <1>; #size-cells = <1>;
        spi-max-frequency = <30000000>; spi-rx-bus-width = <4>; spi-tx-bus-width = <1>;
        partition@0 { label = "u-boot"; reg = <0x0 0x200000>; read-only; };
        partition@1 { label = "kernel"; reg = <0x200000 0x1600000>; };
        user: partition@2 { label = "user"; reg = <0x1800000 0x6800000>; };
    };
};
"""
LED = '/ {{ leds {{ compatible = "gpio-leds"; run {{ label = "run"; gpios = <{}>; }}; }}; }};'


def table(name: str, part: str, memory: int, flash: int, block: int) -> Board:
    """What is known of such a board beside its pins, which are not looked at here."""
    limits = Limits(Path(f"{name}.toml"), memory, flash, block, None, None, None, None)
    package = CHIP.packages[CHIP.parts[part]]
    return Board(Path(f"{name}.yml"), name, part, package, {}, limits=limits, flash="qspi0")


def source(pins: Pins, more: str) -> str:
    return '/dts-v1/;\n#include "soc.dtsi"\n' + "".join(device(*each) for each in pins.items()) + more


BOARDS = {
    "C": (source(NODE_PINS, NODE_MORE), table("node", "NUC980DR61YC", 64 << 20, 32 << 20, 64 << 10)),
    "G": (source(IOT_PINS, IOT_MORE), table("iot", "NUC980DF71YC", 128 << 20, 128 << 20, 128 << 10)),
}


@dataclass(frozen=True)
class Mistake:
    """What is written behind a board's file, the rule that finds it, and a word that it says."""

    id: str
    more: str
    rule: str
    says: str


def memory(text: str) -> str:
    return f"/ {{ chosen {{ bootargs = {text}; }}; }};"


MISTAKES = [
    Mistake("C1", device("i2c0", IOT_PINS["i2c0"]), "pin-conflict", "can3"),
    Mistake(
        "C2", "&uart4 { linux,rs485-enabled-at-boot-time; rs485-rts-delay = <0 0>; };", "no-rts", "UART4_RTS"
    ),
    Mistake("C3", memory('"console=ttyS0,115200n8 mem=128M"'), "too-much-memory", "64 MiB"),
    Mistake("C4", "&rootfs { reg = <0xe10000 0x1200000>; };", "partition-bounds", "beyond the flash"),
    Mistake("C5", "&kernel { reg = <0x200000 0xd00000>; };", "partition-overlap", "reaches into dtb"),
    Mistake("C6", LED.format("&gpio 74 1"), "mux-and-gpio", "PC10"),
    Mistake("C7", "&uart8 { interrupts = <39 4 1>; };", "wrong-interrupt", "41 (UART8)"),
    Mistake(
        "C8", '&uart9 { reg = <0xb0078000 0x1000>; status = "okay"; };', "wrong-address", "where uart8 is"
    ),
    Mistake("C9", LED.format("&gpio 1 10 0"), "bank-and-pin", "it probably means PB10"),
    Mistake("C10", "&emac1 { interrupts = <20 4 1>, <22 4 1>; };", "wrong-interrupt", "EMC1_TX"),
    Mistake("C11", memory('"console=ttyS1,115200n8 mem=64M"'), "wrong-console", "uart1, which is disabled"),
    Mistake("C12", '&uart6 { status = "enabled"; };', "unknown-status", "enabled"),
    Mistake("C13", '&uart4 { pinctrl-names = "defualt"; };', "no-default-state", "defualt"),
    Mistake("C14", "&flash { spi-max-frequency = <300000000>; };", "spi-too-fast", "300000000"),
    Mistake(
        "C15", "&pinctrl_uart4 { nuvoton,pins = <2 9 7 0>, <2 10 6 0>; };", "foreign-function", "SD0_DATA3"
    ),
    Mistake("G1", '&user { label = "kernel"; };', "partition-label-twice", "kernel"),
    Mistake("G2", "&user { reg = <0x1810800 0x6000000>; };", "partition-bounds", "inside an erase block"),
    Mistake("G3", '&i2c0 { eeprom@1a { compatible = "x"; reg = <0x1a>; }; };', "chip-address", "nau8822@1a"),
    Mistake("G4", '&i2c2 { eeprom@50 { compatible = "x"; reg = <0x51>; }; };', "unit-address", "says 50"),
    Mistake("G5", '&i2c2 { eeprom@a0 { compatible = "x"; reg = <0xa0>; }; };', "chip-address", "0xa0"),
    Mistake("G6", LED.format("&gpio 143 0"), "no-such-pin", "PE15"),
    Mistake("G7", '&spi0 { dac@2 { compatible = "x"; reg = <2>; }; };', "chip-address", "chip select 2"),
    Mistake(
        "G8",
        "&pinctrl { uart4 { four: uart4-PD { nuvoton,pins = <3 12 1 0>, <3 13 1 0>; }; }; };"
        '&uart5 { pinctrl-names = "default"; pinctrl-0 = <&four>; status = "okay"; };',
        "foreign-function",
        "UART4_TXD",
    ),
    Mistake("G9", "&emac0 { local-mac-address = [01 23 45 67 89 ab]; };", "bad-mac", "a group"),
    Mistake(
        "G10", "/ { aliases { serial0 = &uart1; serial1 = &uart0; }; };", "wrong-alias", "uart1, not uart0"
    ),
    Mistake(
        "G11",
        "/ { reserved-memory { #address-cells = <1>; #size-cells = <1>; ranges;"
        " log@8000000 { reg = <0x8000000 0x100000>; no-map; }; }; };",
        "reserved-outside",
        "0x8100000",
    ),
    Mistake("G12", "&uart1 { interrupts = <37 4>; };", "wrong-interrupt", "2 cells"),
    Mistake("G13", '&wdt { compatible = "nuvoton,nuc980-wtd"; };', "wrong-compatible", "the address of wdt"),
    Mistake(
        "G14",
        "&uart1 { uart-has-rtscts; }; &pinctrl_uart1 { nuvoton,pins = <5 9 2 0>, <5 10 2 0>; };",
        "no-rts",
        "UART1_RTS and UART1_CTS",
    ),
    Mistake(
        "G15",
        "&pinctrl_qspi0 { nuvoton,pins = <3 2 1 0>, <3 3 1 0>, <3 4 1 0>, <3 5 1 0>; };",
        "quad-without-lines",
        "QSPI0_MOSI1",
    ),
]


def found(tree: Tree, board: Board) -> list[Finding]:
    """But for what the pin table would know of the pins: it is empty here."""
    about_pins = {"left-on", "table-gpio"}
    return [one for one in check(tree, CHIP, board, board.package) if one.rule not in about_pins]


@pytest.mark.parametrize("name", BOARDS)
def test_board_as_it_is(name: str, tmp_path: Path) -> None:
    text, board = BOARDS[name]
    assert found(read(tmp_path, text), board) == []


@pytest.mark.sample(6)
@pytest.mark.parametrize("mistake", MISTAKES, ids=lambda mistake: mistake.id)
def test_mistake(mistake: Mistake, tmp_path: Path) -> None:
    text, board = BOARDS[mistake.id[0]]
    findings = found(read(tmp_path, text + mistake.more), board)
    assert any(one.rule == mistake.rule and mistake.says in one.message for one in findings), findings
