# SPDX-License-Identifier: GPL-3.0-or-later
"""
Each mistake that a device tree of the gateway can hold, made in the good one: found, by the right rule, and
by no other. No row is another row with another number only.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest
from trees import CHIP, GATEWAY_PINS, ROOT, TABLE, board, cells, device, gateway, read

from nuc980.pins.board import Device, load_board
from nuc980.pins.findings import Finding
from nuc980.pins.rules import RULES, check
from nuc980.pins.source import read_source
from nuc980.pins.tree import Tree

BOARD = load_board(TABLE, CHIP)
DTS = ROOT / "dts" / "nuvoton" / "nuc980-gateway.dts"


@dataclass(frozen=True)
class Mutation:
    """A mistake: what is written behind the good tree, and what is found."""

    rule: str
    name: str
    more: str = ""  # behind the board file
    says: tuple[str, ...] = ()  # words of the finding: message, remedy or claimants
    soc: str = ""  # behind the SoC file
    also: tuple[str, ...] = ()  # rules that rightly find the same mistake
    good: str = gateway()
    table: Mapping[str, Mapping[str, str]] = field(default_factory=dict)  # pins that the table has besides

    def __str__(self) -> str:
        return f"{self.rule}: {self.name}"


def on(label: str, more: str = "") -> str:
    return f'&{label} {{ status = "okay"; {more} }};\n'


def pins(group: str, text: str) -> str:
    return f"&pinctrl_{group} {{ nuvoton,pins = {text}; }};\n"


def root(text: str) -> str:
    return f"/ {{ {text} }};\n"


def led(line: str, name: str = "leds") -> str:
    return root(f'{name} {{ compatible = "gpio-leds"; led-0 {{ gpios = <{line}>; }}; }};')


def spi_bus(pins: dict[str, str] | None = None, label: str = "spi0") -> str:
    default = {"SPI0_CLK": "PD9", "SPI0_MOSI": "PD10", "SPI0_MISO": "PD11", "SPI0_SS0": "PD8"}
    return device(label, pins or default)


def without(label: str, *signals: str) -> str:
    """A group of the gateway's without some of its signals."""
    return pins(label, cells({key: pin for key, pin in GATEWAY_PINS[label].items() if key not in signals}))


I2C0 = {"I2C0_SDA": "PE10", "I2C0_SCL": "PE12"}
SPI1 = {"SPI1_CLK": "PG12", "SPI1_MOSI": "PG13", "SPI1_MISO": "PG14", "SPI1_SS0": "PG11"}
SDH = {
    "SD1_nCD": "PF6",
    "SD1_CMD": "PF0",
    "SD1_CLK": "PF1",
    **{f"SD1_DATA{bit}": f"PF{2 + bit}" for bit in range(4)},
}
QSPI0 = {"QSPI0_SS0": "PD2", "QSPI0_CLK": "PD3", "QSPI0_MOSI0": "PD4", "QSPI0_MISO0": "PD5"}
OFF = 'status = "disabled";'
UART3_OFF = f"&uart3 {{ {OFF} }};\n"
EMAC1_OFF = f"&emac1 {{ {OFF} }};\n"
FMI_OFF = f"&fmi {{ {OFF} }};\n"
UART6_OFF = f"&uart6 {{ {OFF} }};\n"
I2S = {"I2S_LRCK": "PA2", "I2S_BCLK": "PA3", "I2S_DI": "PA4", "I2S_DO": "PA5", "I2S_MCLK": "PA6"}
CAMERA = {
    "VCAP0_CLKO": "PC3",
    "VCAP0_PCLK": "PC4",
    "VCAP0_HSYNC": "PC5",
    "VCAP0_VSYNC": "PC6",
    **{f"VCAP0_DATA{bit}": f"PC{8 + bit}" for bit in range(8)},
}
EBI = {
    "EBI_nCS0": "PA9",
    "EBI_nRE": "PA8",
    "EBI_nWE": "PA7",
    **{f"EBI_DATA{bit}": f"PC{bit}" for bit in range(8)},
}


def less(signals: dict[str, str], *names: str) -> dict[str, str]:
    return {key: pin for key, pin in signals.items() if key not in names}


# Against the chip, and what its LQFP128 brings out.
CHIP_MUTATIONS = [
    Mutation(
        "pin-conflict",
        "SD host on the second Ethernet port",
        device("sdh", SDH),
        ("PF0 to PF6", "emac1", "sdh"),
    ),
    Mutation(
        "pin-conflict",
        "SPI flash left on by the SoC file",
        device("qspi0", QSPI0).replace('    status = "okay";\n', ""),
        ("PD2 and PD3", "qspi0 is on only by default, ", "soc.dtsi:"),
        soc=on("qspi0"),
    ),
    Mutation(
        "pin-conflict", "CAN on a UART", device("can2", {"CAN2_RXD": "PD12", "CAN2_TXD": "PD13"}), ("uart4",)
    ),
    Mutation(
        "pin-conflict",
        "three on one pin",
        device("i2c0", {"I2C0_SDA": "PA0", "I2C0_SCL": "PA1"})
        + device("can3", {"CAN3_RXD": "PA0", "CAN3_TXD": "PA1"}),
        ("uart1, can3 and i2c0 all have PA0",),
    ),
    Mutation(
        "pin-conflict",
        "external bus on the NAND",
        device("ebi", EBI) + f"&uart2 {{ {OFF} }};",
        ("PC1 to PC7", "NAND_ALE", "EBI_DATA3"),
    ),
    Mutation(
        "pin-conflict",
        "smart card UART on a UART",
        device("scuart0", {"SC0_DAT": "PA4", "SC0_CLK": "PA5"}),
        ("scuart0", "SC0_DAT", "uart6"),
    ),
    Mutation(
        "pin-conflict",
        "sleep state of a device on another's pin",
        "&pinctrl { uart1 { uart1_sleep: uart1-sleep { nuvoton,pins = <0 9 0 0>; }; }; };"
        '&uart1 { pinctrl-names = "default", "sleep"; pinctrl-1 = <&uart1_sleep>; };',
        ("PA9", "pinctrl-1", "uart2"),
    ),
    Mutation(
        "pin-conflict",
        "one group for two USB hosts",
        device("usbh_ehci", {"USBH_PWREN": "PE12", "USB_OVC": "PE10"}, "usbh")
        + on("usbh_ohci", 'pinctrl-names = "default"; pinctrl-0 = <&pinctrl_usbh>;'),
        ("usbh_ehci and usbh_ohci both",),
    ),
    Mutation(
        "pin-conflict",
        "two nodes that both switch a pin to GPIO",
        "&pinctrl { lamps { lamps: lamps { nuvoton,pins = <0 6 0 0>; }; }; };"
        + root('a { compatible = "gpio-leds"; pinctrl-names = "default"; pinctrl-0 = <&lamps>; };')
        + root('b { compatible = "gpio-leds"; pinctrl-names = "default"; pinctrl-0 = <&lamps>; };'),
        ("/a and /b both have PA6",),
    ),
    Mutation(
        "pin-conflict",
        "a pin that the pin controller takes for itself",
        '&pinctrl { pinctrl-names = "default"; pinctrl-0 = <&pinctrl_uart1>; };',
        ("pinctrl", "uart1", "PA0 and PF10"),
    ),
    Mutation(
        "mux-and-gpio",
        "PHY reset on a pin of its own MAC",
        on("emac0", "reset-gpios = <&gpio 128 1>;"),
        ("PE0",),
    ),
    Mutation("mux-and-gpio", "LED on a UART", led("&gpio 9 0"), ("/leds/led-0", "PA9", "UART2_RXD")),
    Mutation(
        "mux-and-gpio",
        "key on the console",
        root('buttons { compatible = "gpio-keys"; reset { gpios = <&gpio 172 1>; linux,code = <1>; }; };'),
        ("/buttons/reset", "PF12", "uart0"),
    ),
    Mutation(
        "mux-and-gpio",
        "row of the vendor's keys",
        on("keys", "key-matrix = <1 1>; gpio-keys-rows = <11>; key-code = <1>;"),
        ("PA11", "gpio-keys-rows", "UART8_RXD"),
    ),
    Mutation(
        "mux-and-gpio",
        "column of the vendor's keys",
        on("keys", "key-matrix = <1 2>; gpio-keys-rows = <6>; gpio-keys-cols = <7 12>; key-code = <1 2>;"),
        ("PA12", "gpio-keys-cols"),
    ),
    Mutation(
        "mux-and-gpio",
        "hog",
        "&gpio { hold { gpio-hog; gpios = <5 0>; output-high; }; };",
        ("PA5", "/hold", "uart6"),
    ),
    Mutation(
        "mux-and-gpio",
        "regulator: the power of a SIM card",
        root('sim { compatible = "regulator-fixed"; gpio = <&gpio 99 0>; };'),
        ("PD3", "gpio of /sim"),
    ),
    Mutation(
        "mux-and-gpio",
        "I2C by GPIO",
        root('i2c-9 { compatible = "i2c-gpio"; sda-gpios = <&gpio 4 6>; scl-gpios = <&gpio 6 6>; };'),
        ("PA4", "sda-gpios"),
    ),
    Mutation(
        "mux-and-gpio",
        "chip select as signal and as GPIO",
        spi_bus() + on("spi0", "cs-gpios = <&gpio 104 1>;"),
        ("PD8", "SPI0_SS0"),
    ),
    Mutation(
        "mux-and-gpio",
        "device on an SPI bus",
        spi_bus()
        + '&spi0 { lcd@0 { compatible = "ilitek,ili9341"; reg = <0>; dc-gpios = <&gpio 169 0>; }; };',
        ("lcd@0", "PF9", "RMII1_MDC"),
    ),
    Mutation(
        "mux-and-gpio",
        "interrupt of a device on an I2C bus",
        device("i2c0", I2C0)
        + '&i2c0 { rtc@68 { compatible = "maxim,ds3231"; reg = <0x68>; interrupt-parent = <&gpio>;'
        " interrupts = <65 2>; }; };",
        ("rtc@68", "PC1", "its interrupts", "NAND_nCS0"),
    ),
    Mutation(
        "mux-and-gpio",
        "second of two lines",
        spi_bus(less({"SPI0_CLK": "PD9", "SPI0_MOSI": "PD10", "SPI0_MISO": "PD11", "SPI0_SS0": "PD8"}))
        + on("spi0", "cs-gpios = <0>, <&gpio 6 1>, <&gpio 10 1>;"),
        ("PA10",),
    ),
    Mutation(
        "gpio-conflict",
        "two LEDs",
        root('leds { compatible = "gpio-leds"; a { gpios = <&gpio 6 0>; }; b { gpios = <&gpio 6 1>; }; };'),
        ("PA6", "/leds/a (gpios)", "/leds/b (gpios)"),
    ),
    Mutation(
        "gpio-conflict",
        "LED and hog",
        led("&gpio 6 0") + "&gpio { hold { gpio-hog; gpios = <6 0>; input; }; };",
        ("hold", "led-0"),
    ),
    Mutation(
        "gpio-conflict",
        "vendor's keys and a PHY reset",
        on("keys", "key-matrix = <2 1>; gpio-keys-rows = <6 7>; key-code = <1 2>;")
        + on("emac0", "reset-gpios = <&gpio 7 1>;"),
        ("PA7", "keys (gpio-keys-rows)", "emac0 (reset-gpios)"),
    ),
    Mutation(
        "gpio-conflict",
        "one device, two purposes",
        on("emac0", "reset-gpios = <&gpio 7 1>; enable-gpios = <&gpio 7 0>;"),
        ("emac0 (reset-gpios) and emac0 (enable-gpios)",),
    ),
    Mutation(
        "no-such-pin", "bank B beyond PB13", pins("uart2", "<0 9 2 0>, <1 14 2 0>"), ("PB14", "uart2-pins")
    ),
    Mutation("no-such-pin", "eighth bank", pins("uart2", "<0 9 2 0>, <7 0 2 0>"), ("P7.0",)),
    Mutation("no-such-pin", "pin 16", pins("uart2", "<0 9 2 0>, <0 16 2 0>"), ("P0.16",)),
    Mutation("no-such-pin", "LED on PE13", led("&gpio 141 0"), ("PE13", "32 * bank + pin")),
    Mutation("no-such-pin", "GPIO counted with 16 a bank", led("&gpio 26 0"), ("P0.26",)),
    Mutation("no-such-pin", "GPIO number beyond all banks", led("&gpio 224 0"), ("P7.0",)),
    Mutation(
        "no-such-function",
        "value between others",
        pins("uart1", "<0 0 4 0>, <5 10 1 0>"),
        ("PF10", "2 UART1_TXD"),
    ),
    Mutation(
        "no-such-function",
        "value above all",
        pins("uart1", "<0 0 15 0>, <5 10 2 0>"),
        ("function 15 of PA0",),
    ),
    Mutation(
        "no-such-function",
        "value wider than the field",
        pins("uart1", "<0 0 20 0>, <5 10 2 0>"),
        ("function 20",),
    ),
    Mutation(
        "no-such-function",
        "second and third cell exchanged",
        pins("uart2", "<0 9 2 0>, <0 2 10 0>"),
        ("function 10 of PA2",),
    ),
    Mutation(
        "foreign-function",
        "another UART's signals",
        pins("uart3", "<6 6 2 0>, <6 7 2 0>"),
        ("PG6 as UART5_RXD", "can be no signal of uart3"),
    ),
    Mutation(
        "foreign-function",
        "another kind of device",
        pins("uart1", "<0 0 3 0>, <5 10 2 0>"),
        ("I2C0_SDA", "<0 0 4 0> for UART1_RXD"),
    ),
    Mutation(
        "foreign-function",
        "a group of another device",
        device("uart5", {"UART5_RXD": "PG6", "UART5_TXD": "PG7"})
        + f"&uart5 {{ {OFF} }}; &uart3 {{ pinctrl-0 = <&pinctrl_uart5>; }};",
        ("UART5_TXD", "uart3 takes"),
    ),
    Mutation(
        "pin-twice",
        "in one group",
        pins("uart1", "<0 0 4 0>, <5 10 2 0>, <0 0 3 0>"),
        ("PA0 as UART1_RXD (4) and I2C0_SDA (3)",),
    ),
    Mutation(
        "pin-twice",
        "in two groups of one state",
        "&pinctrl { more { more: more { nuvoton,pins = <0 0 0 0>; }; }; };"
        "&uart1 { pinctrl-0 = <&pinctrl_uart1>, <&more>; };",
        ("GPIO (0)", "uart1-pins and more"),
    ),
    Mutation(
        "signal-twice",
        "one output on two pins",
        pins("uart1", "<0 0 4 0>, <5 10 2 0>, <0 1 4 0>"),
        ("UART1_TXD on PA1 and PF10",),
    ),
    Mutation(
        "signal-twice",
        "two RTS, no CTS",
        pins("uart2", "<0 9 2 0>, <0 10 2 0>, <0 8 2 0>, <6 3 2 0>"),
        ("UART2_RTS on PA8 and PG3",),
        also=("half-set",),
    ),
    Mutation(
        "half-set",
        "RTS without CTS",
        pins("uart2", "<0 9 2 0>, <0 10 2 0>, <0 8 2 0>"),
        ("UART2_RTS without UART2_CTS", "say rs485-rts-active-high"),
    ),
    Mutation(
        "half-set",
        "CTS without RTS, said to be RS-485",
        pins("uart2", "<0 9 2 0>, <0 10 2 0>, <0 7 2 0>") + on("uart2", "rs485-rts-active-high;"),
        ("UART2_CTS",),
    ),
    Mutation(
        "half-set",
        "three wires of quad SPI",
        UART3_OFF + device("qspi0", QSPI0 | {"QSPI0_MOSI1": "PD6"}),
        ("QSPI0_MISO1",),
    ),
    Mutation(
        "half-set",
        "SD card with two data lines",
        EMAC1_OFF + device("sdh", less(SDH, "SD1_DATA2", "SD1_DATA3")),
        ("SD1_DATA2 and SD1_DATA3",),
    ),
    Mutation("incomplete-set", "UART that cannot send", without("uart1", "UART1_TXD"), ("PF10 <5 10 2 0>",)),
    Mutation(
        "incomplete-set", "UART that cannot receive", without("uart1", "UART1_RXD"), ("UART1_RXD", "PC6")
    ),
    Mutation("incomplete-set", "Ethernet without clock", without("emac0", "RMII0_REFCLK"), ("RMII0_REFCLK",)),
    Mutation(
        "incomplete-set",
        "Ethernet without its PHY's registers",
        without("emac0", "RMII0_MDC", "RMII0_MDIO"),
        ("RMII0_MDIO and RMII0_MDC",),
    ),
    Mutation("incomplete-set", "NAND that is never ready", without("fmi", "NAND_RDY0"), ("NAND_RDY0",)),
    Mutation("incomplete-set", "NAND with seven data lines", without("fmi", "NAND_DATA7"), ("NAND_DATA7",)),
    Mutation("incomplete-set", "CAN that only listens", device("can0", {"CAN0_RXD": "PG11"}), ("CAN0_TXD",)),
    Mutation(
        "incomplete-set", "I2C without clock", device("i2c0", less(I2C0, "I2C0_SCL")), ("I2C0_SCL", "PE12")
    ),
    Mutation(
        "incomplete-set",
        "SPI without chip select",
        device("spi1", less(SPI1, "SPI1_SS0")),
        ("one of SPI1_SS0, SPI1_SS1",),
    ),
    Mutation("incomplete-set", "SPI without clock", device("spi1", less(SPI1, "SPI1_CLK")), ("SPI1_CLK",)),
    Mutation(
        "incomplete-set",
        "QSPI without data",
        UART3_OFF + device("qspi0", less(QSPI0, "QSPI0_MISO0")),
        ("QSPI0_MISO0",),
    ),
    Mutation(
        "incomplete-set",
        "SD card without command line",
        EMAC1_OFF + device("sdh", less(SDH, "SD1_CMD")),
        ("SD1_CMD",),
    ),
    Mutation(
        "incomplete-set",
        "sound without master clock",
        UART6_OFF + device("i2s", less(I2S, "I2S_MCLK")),
        ("I2S_MCLK",),
    ),
    Mutation(
        "incomplete-set",
        "sound without data",
        UART6_OFF + device("i2s", less(I2S, "I2S_DI", "I2S_DO")),
        ("one of I2S_DI, I2S_DO",),
    ),
    Mutation(
        "incomplete-set", "USB port with one wire", device("usbh_lite0", {"USBHL0_DP": "PB4"}), ("USBHL0_DM",)
    ),
    Mutation(
        "incomplete-set",
        "smart card without reset",
        UART6_OFF + device("sc0", {"SC0_CD": "PA2", "SC0_PWR": "PA3", "SC0_DAT": "PA4", "SC0_CLK": "PA5"}),
        ("SC0_RST",),
    ),
    Mutation(
        "incomplete-set",
        "camera without pixel clock",
        FMI_OFF + device("ccap0", less(CAMERA, "VCAP0_PCLK")),
        ("VCAP0_PCLK",),
    ),
    Mutation(
        "incomplete-set",
        "external bus without chip select",
        FMI_OFF + device("ebi", less(EBI, "EBI_nCS0")),
        ("one of EBI_nCS0",),
    ),
    Mutation(
        "not-bonded",
        "UART on pins without a leg",
        device("uart5", {"UART5_TXD": "PD0", "UART5_RXD": "PD1"}),
        ("PD0 and PD1", "LQFP128", "PG6"),
    ),
    Mutation("not-bonded", "LED on a pin without a leg", led("&gpio 194 0"), ("PG2",)),
    Mutation(
        "cell-count",
        "three cells a pin",
        pins("uart1", "<0 0 4>, <5 10 2>"),
        ("6 cells", "bank, pin, function, 0"),
    ),
    Mutation("cell-count", "bytes", pins("uart1", "[00 01 02 03 04 05]"), ("6 bytes",)),
    Mutation(
        "cell-count",
        "in a group that nobody uses",
        "&pinctrl { idle { idle { nuvoton,pins = <0 0 4 0 0>; }; }; };",
        ("5 cells",),
    ),
    Mutation("cell-count", "GPIO without flags", led("&gpio 6"), ("/leds/led-0", "wants 2 cells")),
    Mutation(
        "cell-count",
        "GPIO with bank and pin",
        led("&gpio 2 6 1"),
        ("a cell that should refer to a GPIO controller",),
    ),
    Mutation("cell-count", "GPIO without controller", led("6 0"), ("GPIO controller",)),
    Mutation(
        "cell-count",
        "hog with controller",
        "&gpio { hold { gpio-hog; gpios = <&gpio 6 0>; input; }; };",
        ("hold",),
    ),
    Mutation(
        "cell-count",
        "GPIO list of bytes",
        root('leds { compatible = "gpio-leds"; a { gpios = [01 02 03]; }; };'),
        ("four bytes",),
    ),
    Mutation(
        "group-name-twice",
        "in two functions",
        "&pinctrl { uart5 { uart1-pins { nuvoton,pins = <6 6 2 0>, <6 7 2 0>; }; }; };",
        ("2 groups are called uart1-pins", "/apb/pinctrl@b0000000/uart5/uart1-pins"),
    ),
    Mutation(
        "group-name-twice",
        "apart by unit addresses",
        "&pinctrl { uart5 { pins@0 { nuvoton,pins = <6 6 2 0>; };pins@1 { nuvoton,pins = <6 7 2 0>; }; }; };",
        ("2 groups are called pins", "pins@1"),
    ),
    Mutation(
        "group-name-twice",
        "two functions",
        "&pinctrl { f@0 { a { nuvoton,pins = <6 6 2 0>; }; }; f@1 { b { nuvoton,pins = <6 7 2 0>; }; }; };",
        ("2 functions are called f",),
    ),
    Mutation(
        "group-missing",
        "reference to no node",
        "&uart1 { pinctrl-0 = <77>; };",
        ("a node that is not there", "uart1"),
    ),
    Mutation(
        "group-missing",
        "label that does not exist",
        "&uart1 { pinctrl-0 = <&pinctrl_uart1_PA>; };",
        ("a node that is not there",),
    ),
    Mutation(
        "group-missing",
        "reference to a device",
        "&uart1 { pinctrl-0 = <&uart2>; };",
        ("serial@b0072000, which is no pin group",),
    ),
    Mutation(
        "group-missing",
        "reference to a function",
        "&pinctrl { all: uart1 { }; }; &uart1 { pinctrl-0 = <&all>; };",
        ("/apb/pinctrl@b0000000/uart1, which is no pin group",),
    ),
    Mutation(
        "group-missing",
        "one of two references",
        "&uart1 { pinctrl-0 = <&pinctrl_uart1>, <77>; };",
        ("pinctrl-0 of uart1",),
    ),
    Mutation(
        "group-missing",
        "group without pins",
        "&pinctrl { idle { idle { }; }; };",
        ("the group idle has no nuvoton,pins",),
    ),
    Mutation(
        "group-missing",
        "group of no cells",
        "&pinctrl { idle { idle { nuvoton,pins = <>; }; }; };",
        ("the group idle",),
    ),
    Mutation(
        "group-missing",
        "function without groups",
        "&pinctrl { idle { }; };",
        ("the function idle has no groups",),
    ),
    Mutation(
        "group-missing",
        "pin controller off",
        f"&pinctrl {{ {OFF} }};",
        ("/apb/pinctrl@b0000000, which is off",),
    ),
    Mutation(
        "no-default-state",
        "states without names",
        "&uart1 { /delete-property/ pinctrl-names; };",
        ("no pinctrl-names",),
    ),
    Mutation("no-default-state", "another name", '&uart1 { pinctrl-names = "sleep"; };', ("only sleep",)),
    Mutation(
        "no-pins",
        "no state",
        "&uart1 { /delete-property/ pinctrl-0; };",
        ("uart1 is on and has no pins", "UART1_"),
    ),
    Mutation("no-pins", "empty state", "&uart1 { pinctrl-0 = <>; };", ("uart1",)),
    Mutation("no-pins", "switched on, no more", on("can0"), ("can0", "CAN0_")),
    Mutation(
        "no-pins",
        "counted from one",
        "&uart1 { /delete-property/ pinctrl-0; pinctrl-1 = <&pinctrl_uart1>; };",
        ("uart1",),
    ),
    Mutation(
        "wrong-address",
        "another UART's",
        "&uart1 { reg = <0xb0075000 0x1000>; };",
        ("where uart5 is", "<0xb0071000 0x1000>"),
    ),
    Mutation("wrong-address", "no block's", "&emac0 { reg = <0xb0099000 0x1000>; };", ("0xb0012000",)),
    Mutation("wrong-address", "none", "&uart1 { /delete-property/ reg; };", ("has no reg",)),
    Mutation("wrong-address", "the virtual one", "&uart1 { reg = <0xf0071000 0x1000>; };", ("0xf0071000",)),
    Mutation(
        "unit-address",
        "a device by the name of another's address",
        '/delete-node/ &wdt; / { apb { wdt@b0041000 { compatible = "nuvoton,nuc980-wdt";'
        "reg = <0xb0040000 0x100>; interrupts = <1 4 1>; }; }; };",
        ("the address of rtc", "wdt@b0040000"),
    ),
    Mutation(
        "unit-address",
        "device that the chip does not have",
        root('apb { fpga@b00c0000 { compatible = "acme,fpga"; reg = <0xb00d0000 0x100>; }; };'),
        ("fpga@b00d0000",),
    ),
    Mutation(
        "wrong-interrupt",
        "another device's",
        "&uart1 { interrupts = <38 4 1>; };",
        ("38 (UART2)", "37 (UART1)"),
    ),
    Mutation(
        "wrong-interrupt",
        "receiver before transmitter",
        "&emac0 { interrupts = <19 4 1>, <21 4 1>; };",
        ("<21 4 1>, <19 4 1>",),
    ),
    Mutation("wrong-interrupt", "one of two", "&emac0 { interrupts = <21 4 1>; };", ("19 (EMC0_RX)",)),
    Mutation("wrong-interrupt", "none", "&uart1 { /delete-property/ interrupts; };", ("no interrupts",)),
    Mutation("wrong-interrupt", "two cells", "&uart1 { interrupts = <37 4>; };", ("2 cells",)),
    Mutation("wrong-interrupt", "no source", "&uart1 { interrupts = <13 4 1>; };", ("13 (no source)",)),
    Mutation(
        "wrong-interrupt", "in a device that is off", "&uart5 { interrupts = <37 4 1>; };", ("44 (UART5)",)
    ),
    Mutation(
        "wrong-compatible",
        "standard UART",
        '&uart1 { compatible = "ns16550a"; };',
        ("'ns16550a'", '"nuvoton,nuc980-uart"'),
    ),
    Mutation(
        "wrong-compatible",
        "instance of another",
        '&emac0 { compatible = "nuvoton,nuc980-emac1"; };',
        ("emac0 by its address",),
    ),
    Mutation(
        "wrong-compatible",
        "other device of the chip",
        '&uart1 { compatible = "nuvoton,nuc980-scuart"; };',
        ("uart1",),
    ),
    Mutation("wrong-compatible", "empty", '&uart1 { compatible = ""; };', ("uart1 by its address",)),
    Mutation(
        "wrong-compatible",
        "device without a driver",
        on("crypto_raw"),
        ("crypto_raw is on", "no kernel of the vendor"),
    ),
    Mutation(
        "address-twice",
        "smart card and its UART",
        UART6_OFF
        + FMI_OFF
        + device(
            "sc0", {"SC0_CD": "PA2", "SC0_PWR": "PA3", "SC0_DAT": "PA4", "SC0_CLK": "PA5", "SC0_RST": "PA6"}
        )
        + device("scuart0", {"SC0_DAT": "PC13", "SC0_CLK": "PC12"}),
        ("/apb/sc@b0090000 and /apb/serial@b0090000",),
    ),
    Mutation(
        "address-twice",
        "two drivers for the converter",
        device("nadc", {"ADC_AIN0": "PB0"})
        + root(
            'apb { adc0@b0043000 { compatible = "nuvoton,nuc980-adc"; reg = <0xb0043000 0x100>;'
            ' interrupts = <18 4 1>; pinctrl-names = "default"; pinctrl-0 = <&adc>; }; };'
        )
        + "&pinctrl { adc { adc: adc { nuvoton,pins = <1 2 8 0>; }; }; };",
        ("adc0@b0043000", "nadc@b0043000"),
    ),
    Mutation(
        "stale-node",
        "old name",
        root(f"ahb {{ cap0@b0024000 {{ {OFF} }}; }};"),
        ("/ahb/ccap0@b0024000", "Call the node ccap0@b0024000"),
    ),
    Mutation(
        "stale-node",
        "wrong unit address",
        root('apb { serial@b0071001 { status = "okay"; }; };'),
        ("serial@b0071000",),
    ),
    Mutation(
        "stale-node", "letter for digit", root(f"ahb {{ sdh@b00180O0 {{ {OFF} }}; }};"), ("sdh@b0018000",)
    ),
    Mutation(
        "stale-node", "without unit address", root(f"ahb {{ crypto-prng {{ {OFF} }}; }};"), ("crypto_prng",)
    ),
    Mutation("stale-node", "like nothing", root(f"ahb {{ flux@0 {{ {OFF} }}; }};"), ("Delete /ahb/flux@0",)),
    Mutation(
        "bus-num-twice",
        "two SPI",
        spi_bus() + device("spi1", SPI1) + "&spi1 { bus_num = <1>; };",
        ("spi0 and spi1 are spi bus 1",),
    ),
    Mutation(
        "bus-num-twice",
        "SPI and quad SPI",
        UART3_OFF + spi_bus() + device("qspi0", QSPI0) + "&spi0 { bus_num = <0>; };",
        ("qspi0 and spi0",),
    ),
    Mutation(
        "bus-num-twice",
        "two I2C",
        device("i2c0", I2C0)
        + device("i2c3", {"I2C3_SDA": "PD15", "I2C3_SCL": "PD14"})
        + "&i2c3 { bus_num = <0>; };",
        ("i2c bus 0",),
    ),
    Mutation(
        "pdma-without-dma",
        "as the report sets it",
        on("uart1", "pdma-enable = <1>;"),
        ("uart1", "/ahb/dma@b0008000"),
    ),
    Mutation(
        "missing-property",
        "pdma-enable",
        "&uart1 { /delete-property/ pdma-enable; };",
        ("pdma-enable = <0>",),
    ),
    Mutation(
        "missing-property",
        "port-number",
        "&uart6 { /delete-property/ port-number; };",
        ("port-number = <6>",),
    ),
    Mutation(
        "missing-property",
        "cells of a bus",
        device("i2c3", {"I2C3_SDA": "PD15", "I2C3_SCL": "PD14"})
        + "&i2c3 { /delete-property/ #address-cells; /delete-property/ #size-cells;"
        ' eeprom@50 { compatible = "atmel,24c02"; reg = <0x50>; }; };',
        ("#address-cells = <1> and #size-cells = <0>", "i2c3"),
    ),
    Mutation("eint", "on without its pin", on("gpio", "eint3-config = <1 2 1>;"), ("PG15", "<6 15 4 0>")),
    Mutation(
        "eint",
        "on for another pin",
        device("gpio", {"EINT3": "PE12"}) + on("gpio", "eint3-config = <1 2 1>;"),
        ("PG15", "PE12 as EINT3"),
    ),
    Mutation(
        "eint",
        "unknown pin",
        device("gpio", {"EINT3": "PG15"}) + on("gpio", "eint3-config = <1 3 1>;"),
        ("names pin 3", "takes PG15"),
    ),
    Mutation("eint", "two cells", on("gpio", "eint0-config = <0 0>;"), ("eint0-config has 2 cells",)),
    Mutation(
        "eint",
        "pin for an interrupt that another has",
        device("gpio", {"EINT3": "PE12"}),
        ("PE12", "<1 1 TRIGGER>"),
    ),
    Mutation(
        "eint",
        "two pins",
        device("gpio", {"EINT3": "PG15"})
        + pins("gpio", "<6 15 4 0>, <4 12 5 0>")
        + on("gpio", "eint3-config = <1 2 1>;"),
        ("makes PE12 EINT3",),
        also=("signal-twice",),
    ),
    Mutation(
        "eint",
        "pin without any setting",
        device("gpio", {"EINT3": "PG15"}) + "&gpio { /delete-property/ eint3-config; };",
        ("PG15",),
    ),
    Mutation(
        "wrong-interrupt",
        "through the GPIO controller",
        "&uart1 { interrupt-parent = <&gpio>; };",
        ("interrupts of 3 cells, no multiple of 2",),
    ),
    Mutation(
        "wrong-interrupt",
        "a line of the GPIO controller",
        "&uart1 { interrupt-parent = <&gpio>; interrupts = <6 4>; };",
        ("interrupts of gpio, not of the AIC",),
    ),
    Mutation(
        "wrong-interrupt",
        "no controller at all",
        "/ { /delete-property/ interrupt-parent; };",
        ("uart1 has interrupts of no interrupt controller",),
    ),
    Mutation(
        "wrong-interrupt",
        "another device's, in the longer property",
        "&uart1 { interrupts-extended = <&aic 38 4 1>; };",
        ("38 (UART2)",),
    ),
    Mutation(
        "wrong-interrupt", "controller of one cell", "&aic { #interrupt-cells = <1>; };", ("1 cells by",)
    ),
    Mutation("controller-off", "AIC", f"&aic {{ {OFF} }};", ("aic is off", "uart1", "emac1")),
    Mutation(
        "controller-off",
        "GPIO controller of a LED",
        led("&gpio 6 0") + f"&gpio {{ {OFF} }};",
        ("gpio is off, but /leds/led-0 uses it",),
    ),
    Mutation(
        "controller-off",
        "expander on a bus that is off",
        root('k { compatible = "gpio-keys"; b { interrupts-extended = <&expander 1 1>; }; };')
        + '&i2c3 { expander: e@20 { compatible = "nxp,pca9555"; reg = <0x20>; interrupt-controller;'
        " #interrupt-cells = <2>; }; };",
        ("/k/b",),
    ),
    Mutation(
        "no-bus",
        "bus of another kind",
        root('apb { compatible = "acme,apb"; };'),
        ("/apb is no simple-bus", "more"),
        also=("wrong-interrupt",),  # the AIC is there too
    ),
    Mutation(
        "no-bus", "without ranges", "/ { ahb { /delete-property/ ranges; }; };", ("/ahb has no ranges",)
    ),
    Mutation(
        "no-bus", "ranges that move", root("ahb { ranges = <0 0xb0000000 0x100000>; };"), ("move addresses",)
    ),
    Mutation("no-bus", "wide addresses", root("ahb { #address-cells = <2>; };"), ("#address-cells = <2>",)),
    Mutation(
        "no-bus",
        "device in a node of no kind",
        root('soc { rtc@b0041000 { compatible = "nuvoton,nuc980-rtc"; reg = <0xb0041000 0x1000>; }; };'),
        ("/soc is no simple-bus",),
    ),
    Mutation("unknown-status", "enabled", '&can0 { status = "enabled"; };', ('can0 is "enabled"',)),
    Mutation("unknown-status", "capital letter", '&can0 { status = "Okay"; };', ('"Okay"',)),
    Mutation("unknown-status", "two words", '&can0 { status = "okay", "ok"; };', ('"okay", "ok"',)),
    Mutation("unknown-status", "number", "&can0 { status = <1>; };", ("no string",)),
    Mutation("wrong-number", "port of another UART", on("uart1", "port-number = <2>;"), ("its own is 1",)),
    Mutation(
        "wrong-number",
        "registers of another UART",
        on("uart1", "map-addr = <0xf0072000>;"),
        ("map-addr = <0xf0072000>; its own is 0xf0071000",),
    ),
    Mutation(
        "wrong-number",
        "timer's",
        device("etimer1", {"TM1_TGL": "PG11"}) + "&etimer1 { port-number = <0>; };",
        ("etimer1", "its own is 1"),
    ),
    Mutation(
        "mux-and-gpio",
        "interrupt line in the longer property",
        root('touch { compatible = "acme"; interrupts-extended = <&gpio 9 1>; };'),
        ("/touch", "PA9", "its interrupts"),
    ),
    Mutation(
        "mux-and-gpio",
        "interrupt line of a node under the controller",
        '&gpio { wake { compatible = "acme"; interrupts = <9 1>; }; };',
        ("PA9", "its interrupts"),
    ),
    Mutation(
        "mux-and-gpio",
        "old names of a bit-banged SPI",
        root('spi { compatible = "spi-gpio"; gpio-sck = <&gpio 9 0>; gpio-mosi = <&gpio 10 0>; };'),
        ("gpio-sck", "PA9"),
    ),
    Mutation(
        "cell-count",
        "interrupt line without flags",
        root('touch { compatible = "acme"; interrupt-parent = <&gpio>; interrupts = <6>; };'),
        ("/touch has interrupts of 1 cells, no multiple of 2",),
    ),
    Mutation(
        "cell-count",
        "interrupt of a node that is no controller",
        root('touch { compatible = "acme"; interrupts-extended = <0x7777 6 1>; };'),
        ("of no interrupt controller",),
    ),
    Mutation(
        "cell-count",
        "fewer rows than the key matrix has",
        on("keys", "key-matrix = <3 1>; gpio-keys-rows = <6 7>; key-code = <1 2 3>;"),
        ("gpio-keys-rows with 3 cells",),
    ),
    Mutation(
        "cell-count",
        "keys without codes",
        on("keys", "key-matrix = <2 1>; gpio-keys-rows = <6 7>;"),
        ("key-code with 2 cells",),
    ),
    Mutation(
        "cell-count",
        "keys without matrix",
        on("keys", "gpio-keys-rows = <6>; key-code = <1>;"),
        ("key-matrix",),
    ),
    Mutation(
        "cell-count",
        "nine rows of keys",
        on(
            "keys",
            "key-matrix = <9 1>; gpio-keys-rows = <6 197 198 199 200 201 37 38 39>;"
            " key-code = <1 2 3 4 5 6 7 8 9>;",
        ),
        ("at most 8",),
    ),
    Mutation(
        "bus-num-twice",
        "by default",
        device("i2c0", I2C0)
        + device("i2c3", {"I2C3_SDA": "PD15", "I2C3_SCL": "PD14"})
        + "&i2c3 { /delete-property/ bus_num; };",
        ("i2c0 and i2c3 are i2c bus 0",),
    ),
    Mutation(
        "missing-property",
        "speed of an I2C bus",
        device("i2c3", {"I2C3_SDA": "PD15", "I2C3_SCL": "PD14"}) + "&i2c3 { /delete-property/ bus_freq; };",
        ("bus_freq",),
    ),
    Mutation("missing-property", "empty pdma-enable", "&uart1 { pdma-enable; };", ("no pdma-enable",)),
    Mutation(
        "missing-property",
        "over-current of the USB host",
        on("usbh_ehci", "/delete-property/ ov_active;"),
        ("ov_active",),
    ),
    Mutation(
        "missing-property",
        "number of a timer",
        on("etimer1", "/delete-property/ port-number;"),
        ("port-number = <1>",),
    ),
    Mutation(
        "wrong-address",
        "no size",
        "&uart1 { reg = <0xb0071000 0>; };",
        ("has a reg without size; uart1 is at",),
    ),
    Mutation(
        "gpio-conflict",
        "supply and LED",
        led("&gpio 6 0") + root('supply { compatible = "regulator-fixed"; gpio = <&gpio 6 0>; };'),
        ("/leds/led-0 (gpios) and /supply (gpio)",),
    ),
    Mutation(
        "wrong-address",
        "second pin controller",
        root(
            'apb { pins { compatible = "nuvoton,nuc980-pinctrl"; a { a { nuvoton,pins = <0 6 0 0>; }; };'
            " }; };"
        ),
        ("/apb/pins has no reg",),
    ),
    Mutation(
        "no-pins",
        "all of them GPIO",
        pins("uart1", "<0 0 0 0>, <5 10 0 0>"),
        ("uart1 is on and has no pins",),
    ),
    Mutation("no-pins", "USB device without its VBUS", on("usbdev"), ("usbdev", "USB0_")),
    Mutation(
        "eint",
        "settings that the driver never reaches",
        device("gpio", {"EINT3": "PG15"})
        + on("gpio", "eint3-config = <1 2 1>; /delete-property/ eint0-config;"),
        ("eint3-config is never read, for eint0-config",),
    ),
    Mutation(
        "eint",
        "trigger that does not exist",
        device("gpio", {"EINT3": "PG15"}) + on("gpio", "eint3-config = <1 2 5>;"),
        ("trigger 5",),
    ),
    Mutation(
        "label-misleads",
        "name of another group",
        "&pinctrl { uart5 { uart1_pins: uart5-pins { nuvoton,pins = <6 6 2 0>; }; }; };",
        ("names the group uart1-pins",),
    ),
    Mutation(
        "label-misleads",
        "another port",
        "&pinctrl { uart5 { pinctrl_uart5_PD: uart5-PG { nuvoton,pins = <6 6 2 0>; }; }; };",
        ("names port D", "on G"),
    ),
]

# Against the board's pin table.
TABLE_MUTATIONS = [
    Mutation(
        "table-missing",
        "device off",
        f"&uart8 {{ {OFF} }};",
        ("uart8 (RS-485, /dev/ttyS8)", 'status = "okay"'),
    ),
    Mutation(
        "table-missing",
        "device never switched on",
        good=board(less(GATEWAY_PINS, "emac1")),
        says=("emac1", "Ethernet port 2"),
    ),
    Mutation(
        "table-missing",
        "device not there",
        "/delete-node/ &emac1;",
        ("not in the tree", "/ahb/emac1@b0022000"),
    ),
    Mutation("table-missing", "bus off", f"&uart8 {{ {OFF} }}; / {{ ahb {{ {OFF} }}; }};", ("emac0",)),
    Mutation(
        "table-disagrees",
        "other pins",
        pins("uart2", "<3 7 2 0>, <3 6 2 0>"),
        ("UART2_RXD on PD7 instead of PA9", "<0 9 2 0 0 10 2 0>"),
    ),
    Mutation(
        "table-disagrees",
        "one other pin",
        pins("uart1", "<0 0 4 0>, <0 1 4 0>"),
        ("UART1_TXD on PA1 instead of PF10",),
    ),
    Mutation(
        "table-disagrees",
        "the vendor's group with RTS and CTS",
        pins("uart2", "<0 7 2 0>, <0 8 2 0>, <0 9 2 0>, <0 10 2 0>"),
        ("UART2_CTS on PA7 and UART2_RTS on PA8, which the pin table does not have",),
    ),
    Mutation(
        "table-disagrees",
        "a signal that the table has and the device can do without",
        "",
        ("no UART2_RTS on PA8",),
        table={"uart2": {"UART2_RTS": "PA8", "UART2_CTS": "PA7"}},
    ),
    Mutation(
        "table-disagrees",
        "SD card where the NAND is",
        pins("fmi", cells({"SD0_CMD": "PC5", "SD0_CLK": "PC6", "SD0_DATA0": "PC7"})),
        ("SD0_CMD",),
    ),
    Mutation(
        "left-on",
        "pins of unknown wiring",
        device("usbdev", {"USB0_VBUSVLD": "PE11"}),
        ("usbdev is on (by ", "PE11 of unknown wiring"),
    ),
    Mutation(
        "left-on",
        "pins of a device of the table",
        device("qspi0", QSPI0).replace('    status = "okay";\n', ""),
        ("soc.dtsi", "PD2 and PD3 of uart3 and PD4 and PD5 of unknown wiring"),
        soc=on("qspi0"),
        also=("pin-conflict",),
    ),
    Mutation(
        "left-on",
        "without status",
        device("nadc", {"ADC_AIN0": "PB0"}) + "&nadc { /delete-property/ status; };",
        ("it has no status",),
    ),
    Mutation(
        "left-on",
        "interrupt pin of the GPIO controller",
        device("gpio", {"EINT3": "PG15"}),
        ("Delete pinctrl-0 of gpio",),
    ),
    Mutation(
        "left-on",
        "camera, which is no peripheral",
        root('camera { compatible = "himax,hm1055"; pinctrl-names = "default"; pinctrl-0 = <&cam>; };')
        + "&pinctrl { cam { cam: cam { nuvoton,pins = <4 10 7 0>; }; }; };",
        ("/camera", "PE10"),
    ),
    Mutation(
        "table-gpio",
        "line that the table does not know",
        led("&gpio 197 0"),
        ("PG5 of unknown wiring", "under gpios in pins.yml"),
    ),
    Mutation("reserved-pin", "boot strap as a GPIO", led("&gpio 192 0"), ("PG0", "boot strap")),
    Mutation(
        "reserved-pin",
        "boot strap as a signal",
        pins("uart2", "<6 0 2 0>, <6 1 2 0>"),
        ("PG0 and PG1", "uart2"),
    ),
]


def told(finding: Finding) -> str:
    return " | ".join((finding.message, finding.remedy, *map(str, finding.claimants)))


def assert_found(mutation: Mutation, findings: list[Finding]) -> None:
    rules = {finding.rule for finding in findings}
    assert mutation.rule in rules
    assert rules == {mutation.rule, *mutation.also}
    text = "\n".join(told(finding) for finding in findings if finding.rule == mutation.rule)
    assert [words for words in mutation.says if words not in text] == [], text


@pytest.mark.parametrize("mutation", CHIP_MUTATIONS, ids=str)
def test_mistake_against_the_chip(mutation: Mutation, tmp_path: Path) -> None:
    tree = read(tmp_path, mutation.good + mutation.more, mutation.soc)
    assert_found(mutation, check(tree, CHIP, package=CHIP.packages["LQFP128"]))
    # The rules of the pin table may add theirs and take nothing away.
    with_table = {finding.rule for finding in check(tree, CHIP, BOARD, BOARD.package)}
    assert {mutation.rule, *mutation.also} <= with_table


@pytest.mark.parametrize("mutation", TABLE_MUTATIONS, ids=str)
def test_mistake_against_the_pin_table(mutation: Mutation, tmp_path: Path) -> None:
    tree = read(tmp_path, mutation.good + mutation.more, mutation.soc)
    table = replace(BOARD, devices=BOARD.devices | more_pins(mutation.table))
    assert_found(mutation, check(tree, CHIP, table, BOARD.package))


def more_pins(pins: Mapping[str, Mapping[str, str]]) -> dict[str, Device]:
    return {
        label: replace(BOARD.devices[label], pins=BOARD.devices[label].pins | more)
        for label, more in pins.items()
    }


def good_trees(folder: Path) -> list[Tree]:
    return [read(folder, gateway()), read_source(DTS)]


def test_good_trees_have_no_findings(tmp_path: Path) -> None:
    for tree in good_trees(tmp_path):
        assert check(tree, CHIP) == []
        assert check(tree, CHIP, BOARD, BOARD.package) == []


def test_every_rule_has_a_mistake_and_every_mistake_its_own_name() -> None:
    mutations = CHIP_MUTATIONS + TABLE_MUTATIONS
    assert {mutation.rule for mutation in mutations} == set(RULES)
    assert [name for name, count in Counter(map(str, mutations)).items() if count > 1] == []
    assert len(mutations) >= 60
