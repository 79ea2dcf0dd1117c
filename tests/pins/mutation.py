# SPDX-License-Identifier: GPL-3.0-or-later
"""A mistake in a device tree, what is found in it, and the words to write one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from trees import GATEWAY_PINS, cells, device, gateway

from nuc980.pins.environment import Environment
from nuc980.pins.findings import Finding


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
    environment: Environment = field(default_factory=Environment)
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


def told(finding: Finding) -> str:
    return " | ".join((finding.message, finding.remedy, *map(str, finding.claimants)))


def assert_found(mutation: Mutation, findings: list[Finding]) -> None:
    """The right rule and no other, with the right words."""
    rules = {finding.rule for finding in findings}
    assert mutation.rule in rules
    assert rules == {mutation.rule, *mutation.also}
    text = "\n".join(told(finding) for finding in findings if finding.rule == mutation.rule)
    assert [words for words in mutation.says if words not in text] == [], text
