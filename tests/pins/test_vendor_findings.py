# SPDX-License-Identifier: GPL-3.0-or-later
"""
What is wrong in the vendor's device trees and in the report's, each rebuilt as a case of our own: the entries
of `lint` and `disagreements` in the project's collected facts that a device tree can show, by their names.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest
from trees import CHIP, GATEWAY_PINS, TABLE, board, device, gateway, read

from nuc980.pins.board import load_board
from nuc980.pins.rules import check

BOARD = load_board(TABLE, CHIP)

I2S = {"I2S_LRCK": "PA2", "I2S_BCLK": "PA3", "I2S_DI": "PA4", "I2S_DO": "PA5", "I2S_MCLK": "PA6"}
I2S_PB = device("i2s", {"I2S_LRCK": "PB6", "I2S_BCLK": "PB4", "I2S_DI": "PB7", "I2S_DO": "PB5"})
UART8_PC = device(
    "uart8", {"UART8_TXD": "PC12", "UART8_RXD": "PC13", "UART8_RTS": "PC14", "UART8_CTS": "PC15"}
)
UART9 = device("uart9", {"UART9_TXD": "PB1", "UART9_RXD": "PB3", "UART9_RTS": "PB2"})
NAND = device("fmi", GATEWAY_PINS["fmi"])
SDH = device(
    "sdh",
    {"SD1_nCD": "PF6", "SD1_CMD": "PF0", "SD1_CLK": "PF1"}
    | {f"SD1_DATA{bit}": f"PF{2 + bit}" for bit in range(4)},
)
EMAC1 = device("emac1", GATEWAY_PINS["emac1"])
EBI = device(
    "ebi",
    {"EBI_nCS0": "PA9", "EBI_nRE": "PA8", "EBI_nWE": "PA7"}
    | {f"EBI_DATA{bit}": f"PC{bit}" for bit in range(16)},
)
QSPI = {"QSPI0_SS0": "PD2", "QSPI0_CLK": "PD3", "QSPI0_MOSI0": "PD4", "QSPI0_MISO0": "PD5"}
SPI0 = {"SPI0_SS0": "PD8", "SPI0_CLK": "PD9", "SPI0_MOSI": "PD10", "SPI0_MISO": "PD11"}
SPI1 = {"SPI1_SS0": "PB9", "SPI1_CLK": "PB10", "SPI1_MOSI": "PB11", "SPI1_MISO": "PB12"}
TIMERS = {
    0: {"TM0_ECNT": "PD6", "TM0_TGL": "PB9", "TM0_EXT": "PB10"},
    1: {"TM1_ECNT": "PD7", "TM1_TGL": "PD0", "TM1_EXT": "PD1"},
    2: {"TM2_ECNT": "PA2", "TM2_TGL": "PB12", "TM2_EXT": "PB11"},
    3: {"TM3_ECNT": "PA3", "TM3_TGL": "PD14", "TM3_EXT": "PD15"},
}
CONVERTER = device("nadc", {"ADC_AIN0": "PB0"})
KEY_ROWS = '&keys {{ status = "okay"; key-matrix = <{} 1>; gpio-keys-rows = <{}>; key-code = <1 2 3 4>; }};'
OFF = 'status = "disabled";'


def timer(number: int) -> str:
    return device(f"etimer{number}", TIMERS[number])


def fresh(node: str) -> str:
    """A node of its own at the apb bus."""
    return f"/ {{ apb {{ {node} }}; }};"


def group(name: str, label: str, cells: str) -> str:
    return f"&pinctrl {{ some {{ {label}: {name} {{ nuvoton,pins = <{cells}>; }}; }}; }};"


@dataclass(frozen=True)
class Case:
    """A piece of a device tree, and what is found in it: rule, pins or words of the message."""

    id: str
    more: str
    found: tuple[tuple[str, str], ...] = ()
    package: str | None = None
    good: str = board({})
    table: bool = False


CASES = [
    # lint, groups_same_in_5_10_and_6_6
    Case(
        "signal-twice uart9-PB-PE",
        device("uart9", {"UART9_TXD": "PB1", "UART9_RXD": "PB3"})
        + "&pinctrl_uart9 { nuvoton,pins = <1 1 7 0 1 2 7 0 1 3 7 0 4 5 5 0>; };",
        (("signal-twice", "UART9_RTS on PB2 and PE5"), ("half-set", "UART9_RTS without UART9_CTS")),
    ),
    Case("flow-control-half uart9", UART9, (("half-set", "UART9_RTS without UART9_CTS"),)),
    Case(
        "no-such-function i2s-PB",
        I2S_PB + "&pinctrl_i2s { nuvoton,pins = <1 6 3 0 1 4 3 0 1 7 3 0 1 5 3 0 1 2 3 0>; };",
        (("no-such-function", "function 3 of PB2"),),
    ),
    Case("signal-missing i2s-PB", I2S_PB, (("incomplete-set", "I2S_MCLK"),)),
    # lint, label_and_node_name_differ: none of them misleads
    Case("label pinctrl_i2c2_PC_PB", group("i2c2-PB-PC", "pinctrl_i2c2_PC_PB", "1 8 2 0 2 0 2 0")),
    Case("label pinctrl_usbd", group("usbd-vbusvld", "pinctrl_usbd", "4 11 1 0")),
    Case("label pinctrl_gpio", group("gpio-eint", "pinctrl_gpio", "6 15 4 0")),
    Case(
        "labels pinctrl_ebi*_16bit, _8bit",
        "".join(
            group(f"ebi-{bits}bit-{2 * bank}", f"pinctrl_ebi{bank}_{bits}bit", "0 8 1 0")
            for bank in range(3)
            for bits in (8, 16)
        ),
    ),
    Case(
        "labels pinctrl_pwm00, pinctrl_pwm10",
        group("pwm0", "pinctrl_pwm00", "6 0 6 0") + group("pwm1", "pinctrl_pwm10", "1 12 2 0"),
    ),
    Case(
        "a label that does mislead",
        group("uart2-PA", "pinctrl_uart2_PG", "0 9 2 0 0 10 2 0"),
        (("label-misleads", "names port G"),),
    ),
    # lint, nodes_against_bsp
    Case(
        "unit-address interrupt-controller@b0004000",
        "/delete-node/ &aic;"
        + fresh(
            'interrupt-controller@b0004000 { phandle = <0x99>; compatible = "nuvoton,nuc980-aic";'
            " reg = <0xb0042000 0x1000>;"
            " interrupt-controller; #interrupt-cells = <3>; };"
        )
        + "/ { interrupt-parent = <0x99>; };",
        (("unit-address", "the address of gpio"),),
    ),
    Case("irq gpio@b0004000 57", "&gpio { interrupts = <57 4 1>; };"),
    Case("irq gpio@b0004000 GPA=8", "&gpio { interrupts = <8 4 1>; };"),
    # lint, boards_5_10
    Case("nuc980-chili pin_clashes", UART8_PC + KEY_ROWS.format(1, 79), (("mux-and-gpio", "PC15"),)),
    Case(
        "nuc980-chili pins_not_bonded",
        "".join(map(timer, TIMERS)) + device("gpio", {"EINT3": "PG15"}),
        (
            ("not-bonded", "PB9, PB10 and PD6"),
            ("not-bonded", "PD0, PD1 and PD7"),
            ("not-bonded", "PB11 and PB12"),
            ("not-bonded", "PD14 and PD15"),
            ("not-bonded", "PG15"),
        ),
        package="LQFP64",
    ),
    Case(
        "nuc980-dev-v1.0 pin_clashes",
        device("i2s", I2S) + timer(2) + timer(3),
        (
            ("pin-conflict", "etimer2 and i2s both have PA2"),
            ("pin-conflict", "etimer3 and i2s both have PA3"),
        ),
    ),
    Case("nuc980-eth2uart pin_clashes", EMAC1 + SDH, (("pin-conflict", "PF0 to PF6"),)),
    Case("nuc980-eth2uart same_spi_bus_num: both off", "&spi0 { bus_num = <1>; }; &spi1 { bus_num = <1>; };"),
    Case(
        "the same with both on",
        device("spi0", SPI0) + device("spi1", SPI1) + "&spi1 { bus_num = <1>; };",
        (("bus-num-twice", "spi0 and spi1 are spi bus 1"),),
    ),
    Case(
        "nodes_made_by_a_stale_name cap0, cap1",
        f"/ {{ ahb {{ cap0@b0024000 {{ {OFF} }}; cap1@b0014000 {{ {OFF} }}; }}; }};",
        (
            ("stale-node", "it probably means /ahb/ccap0@b0024000"),
            ("stale-node", "it probably means /ahb/ccap1@b0014000"),
        ),
    ),
    Case(
        "nuc980-usb8p nodes_made_by_a_stale_name",
        fresh(f"adc0@b0043000 {{ {OFF} }};"),
        (("stale-node", "/apb/nadc@b0043000"),),
    ),
    Case(
        "nuc980-iot-g2d adc0 beside nadc, which is off",
        fresh(
            'adc0@b0043000 { compatible = "nuvoton,nuc980-adc"; reg = <0xb0043000 0x100>;'
            " interrupts = <18 4 1>;"
            ' pinctrl-names = "default"; pinctrl-0 = <&adc0>; };'
        )
        + group("adc0", "adc0", "1 4 8 0 1 5 8 0 1 6 8 0 1 7 8 0"),
    ),
    Case("nuc980-lorag pin_clashes ebi, fmi", NAND + EBI, (("pin-conflict", "PC1 to PC15"),)),
    Case(
        "nuc980-lorag pin_clashes usbh_ehci, keys",
        device("usbh_ehci", {"USB_OVC": "PE10", "USBH_PWREN": "PE12"}) + KEY_ROWS.format(2, "138 140"),
        (("mux-and-gpio", "PE10 and PE12"),),
    ),
    # lint, boards_6_6
    Case(
        "6.6 nuc980-chili pin_clashes",
        NAND + UART8_PC + device("uart4", {"UART4_TXD": "PC9", "UART4_RXD": "PC10"}) + KEY_ROWS.format(1, 79),
        (
            ("pin-conflict", "uart4 and fmi both have PC9 and PC10"),
            ("pin-conflict", "uart8 and fmi both have PC12 to PC15"),
            ("mux-and-gpio", "the pin group of uart8"),
            ("mux-and-gpio", "the pin group of fmi"),
        ),
    ),
    Case(
        "6.6 nuc980-eth2uart pin_clashes",
        NAND + device("uart3", {"UART3_TXD": "PC3", "UART3_RXD": "PC4"}),
        (("pin-conflict", "uart3 and fmi both have PC3 and PC4"),),
    ),
    Case(
        "6.6 same_spi_bus_num, spi-bus-num-66",
        device("qspi0", QSPI)
        + device("spi0", SPI0)
        + device("spi1", SPI1)
        + "&spi0 { bus_num = <0>; }; &spi1 { bus_num = <0>; };",
        (("bus-num-twice", "qspi0, spi0 and spi1 are spi bus 0"),),
    ),
    # lint, by_reading
    Case("aic-unit-address: emptied of its mistake", "&aic { reg = <0xb0042000 0x1000>; };"),
    Case(
        "i2c3-cells: without devices",
        "&i2c3 { /delete-property/ #address-cells; /delete-property/ #size-cells; };",
    ),
    Case(
        "i2c3-cells: with a device",
        device("i2c3", {"I2C3_SDA": "PB1", "I2C3_SCL": "PB3"})
        + "&i2c3 { /delete-property/ #address-cells; /delete-property/ #size-cells;"
        ' eeprom@50 { compatible = "atmel,24c02"; reg = <0x50>; }; };',
        (("missing-property", "i2c3 has no #address-cells"),),
    ),
    Case(
        "crypto-raw",
        '&crypto_raw { status = "okay"; };',
        (("wrong-compatible", "nuvoton,nuc980-crypto-raw"),),
    ),
    Case("rng-66: a driver in 5.10", '&crypto_prng { status = "okay"; };'),
    Case(
        "keys-address: no reg, no block",
        "/delete-node/ &keys;"
        + fresh(
            'keys@b000b000 { compatible = "nuvoton,nuc980-keys"; key-matrix = <1 1>;'
            " gpio-keys-rows = <6>; key-code = <1>; };"
        ),
    ),
    Case(
        "etimer4-66",
        fresh(
            'etimer@b0052000 { compatible = "nuvoton,nuc980-clksrc"; reg = <0xb0052000 0x100>;'
            " interrupts = <32 4 1>; };"
        ),
    ),
    Case("fmi-two-drivers: NAND", NAND),
    Case("fmi-two-drivers: SD card", device("fmi", {"SD0_CMD": "PC5", "SD0_CLK": "PC6", "SD0_DATA0": "PC7"})),
    Case(
        "fmi-two-drivers: both at once",
        device("fmi", GATEWAY_PINS["fmi"])
        + group("sd0", "sd0", "2 5 6 0 2 6 6 0 2 7 6 0")
        + "&fmi { pinctrl-0 = <&pinctrl_fmi>, <&sd0>; };",
        (("pin-twice", "PC5"), ("pin-twice", "PC6"), ("pin-twice", "PC7")),
    ),
    Case(
        "sx1301: on by default",
        "".join((device("qspi0", QSPI), device("usbdev", {"USB0_VBUSVLD": "PE11"}))),
        (
            ("left-on", "PD2 and PD3 of uart3"),
            ("left-on", "PE11 of unknown wiring"),
            ("pin-conflict", "PD2 and PD3"),
        ),
        good=gateway(),
        table=True,
    ),
    Case(
        "serial-pdma-msg",
        "&uart1 { /delete-property/ pdma-enable; };" + device("uart1", GATEWAY_PINS["uart1"]),
        (("missing-property", "pdma-enable"),),
    ),
    Case(
        "serial-rs485-rts",
        device("uart2", {"UART2_RXD": "PA9", "UART2_TXD": "PA10", "UART2_RTS": "PA8"})
        + "&uart2 { rs485-rts-active-low; };",
    ),
    Case(
        "gpio-request-mfp",
        device("uart2", GATEWAY_PINS["uart2"])
        + '/ { led { compatible = "acme"; x-gpios = <&gpio 9 0>; }; };',
        (("mux-and-gpio", "PA9"),),
    ),
    Case(
        "gpio-xlate-bound",
        '/ { led { compatible = "acme"; x-gpios = <&gpio 300 0>; }; };',
        (("no-such-pin", "P9.12"),),
    ),
    Case(
        "emac-hardwired: TX, then RX",
        EMAC1 + "&emac1 { interrupts = <20 4 1>, <22 4 1>; };",
        (("wrong-interrupt", "22 (EMC1_TX) and 20 (EMC1_RX)"),),
    ),
    # disagreements
    Case("sdh-emac1", SDH, (("pin-conflict", "PF0 to PF6"),), good=gateway()),
    Case(
        "rts-cts-claimed",
        "&pinctrl_uart2 { nuvoton,pins = <0 7 2 0 0 8 2 0 0 9 2 0 0 10 2 0>; };",
        (("table-disagrees", "UART2_RTS on PA8"),),
        good=gateway(),
        table=True,
    ),
    Case("emac1-status", '&emac1 { status = "okay"; };', good=gateway(), table=True),
    Case(
        "fig31-32-agree",
        device("emac0", GATEWAY_PINS["emac0"])
        + EMAC1
        + device(
            "uart1", {"UART1_CTS": "PF7", "UART1_RTS": "PF8", "UART1_RXD": "PF9", "UART1_TXD": "PF10"}
        ).split("&uart1")[0]
        + device("uart1", {"UART1_RXD": "PA0", "UART1_TXD": "PA1"}, "uart1-PA"),
    ),
    Case(
        "sixteen-pins",
        "&pinctrl_uart2 { nuvoton,pins = <0 9 2 0 1 14 2 0>; };",
        (("no-such-pin", "PB14"),),
        good=gateway(),
    ),
    Case(
        "fourth-cell",
        "&pinctrl_uart2 { nuvoton,pins = <0 9 2 1 0 10 2 0x80000000>; };",
        good=gateway(),
        table=True,
    ),
    Case(
        "cap-nodes",
        f"/ {{ ahb {{ cap0@b0024000 {{ {OFF} }}; }}; }};",
        (("stale-node", "ccap0"),),
        good=gateway(),
        table=True,
    ),
]


@pytest.mark.sample(6)
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.id)
def test_vendor_finding(case: Case, tmp_path: Path) -> None:
    tree = read(tmp_path, case.good + case.more)
    package = CHIP.packages[case.package] if case.package else None
    findings = check(tree, CHIP, BOARD, BOARD.package) if case.table else check(tree, CHIP, package=package)
    assert sorted(finding.rule for finding in findings) == sorted(rule for rule, _ in case.found)
    for rule, words in case.found:
        assert any(words in finding.message for finding in findings if finding.rule == rule), (rule, words)
