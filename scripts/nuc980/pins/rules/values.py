# SPDX-License-Identifier: GPL-3.0-or-later
"""Rules on values: those that a driver does not know, and those that contradict each other."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from nuc980.pins.findings import Finding, at
from nuc980.pins.rules.context import Context, rule
from nuc980.pins.tree import Node


@dataclass(frozen=True)
class Choice:
    """The values that a driver knows, of a property of some nodes."""

    name: str
    values: tuple[str | int, ...]
    why: str = ""
    device: str = ""  # beginning of its label; empty: any node
    below: str = ""  # of the node of this name in it

    def nodes(self, context: Context) -> Iterator[Node]:
        for node in context.enabled:
            owner = node.parent if self.below else node
            if self.below and node.base_name != self.below:
                continue
            label = context.devices[owner].label if owner in context.devices else ""
            if self.name in node.properties and label.startswith(self.device):
                yield node


CHOICES = (
    Choice("default-state", ("on", "off", "keep")),
    Choice("dr_mode", ("host", "peripheral", "otg")),
    Choice("phy-mode", ("rmii",), "the chip has RMII alone", device="emac"),
    Choice("phy-connection-type", ("rmii",), "the chip has RMII alone", device="emac"),
    Choice("speed", (10, 100), "RMII has 100 Mbit/s", device="emac", below="fixed-link"),
    Choice("max-speed", (10, 100), "RMII has 100 Mbit/s", device="emac"),
    Choice("bus-width", (1, 4), "the host has four data lines", device="sdh"),
    Choice("nand-bus-width", (8,), "the controller has eight data lines", device="fmi"),
    Choice("#gpio-cells", (2,), "its driver takes a line and its flags", device="gpio"),
    Choice("spi-rx-bus-width", (0, 1, 2, 4)),
    Choice("spi-tx-bus-width", (0, 1, 2, 4)),
)
ORDERED = (("regulator-min-microvolt", "regulator-max-microvolt"),)


@rule(
    "wrong-value",
    "The value of a property is none that its driver knows, or contradicts another.",
    "The driver takes its default without a word, or refuses the device.",
)
def wrong_value(context: Context) -> Iterator[Finding]:
    for choice in CHOICES:
        for node in choice.nodes(context):
            has = node.strings(choice.name) if isinstance(choice.values[0], str) else node.cells(choice.name)
            if len(has) != 1 or has[0] not in choice.values:
                yield _unknown(context, node, choice, has)
    for node in context.enabled:
        for least, most in ORDERED:
            lower, upper = node.cells(least)[:1], node.cells(most)[:1]
            if lower and upper and lower > upper:
                yield Finding(
                    "wrong-value",
                    **at(node, least),
                    message=f"{least} of {context.name(node)} is {lower[0]}, above {most}, {upper[0]}",
                    remedy=f"Exchange {least} and {most} of {context.name(node)}, or correct one",
                )


def _unknown(context: Context, node: Node, choice: Choice, has: list) -> Finding:
    known = ", ".join(f'"{value}"' if isinstance(value, str) else f"<{value}>" for value in choice.values)
    told = ", ".join(str(value) for value in has) or "empty"
    return Finding(
        "wrong-value",
        **at(node, choice.name),
        message=f"{choice.name} of {context.name(node)} is {told}"
        + (f"; {choice.why}" if choice.why else ""),
        remedy=f"Write {known}" if len(choice.values) == 1 else f"Write one of {known}",
    )


RULES = (wrong_value,)
