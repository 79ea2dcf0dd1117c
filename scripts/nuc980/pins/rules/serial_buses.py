# SPDX-License-Identifier: GPL-3.0-or-later
"""Rules on what is on an I2C or SPI bus."""

from __future__ import annotations

from collections.abc import Iterator

from nuc980.pins.findings import Claimant, Finding, at
from nuc980.pins.rules.context import Context, grouped, listed, rule
from nuc980.pins.rules.identity import address_of
from nuc980.pins.tree import Node

LAST_ADDRESS = (
    0x7F  # of I2C; ten bits have a mark above (dt-bindings/i2c/i2c.h), and the controllers have seven
)
GPIO_CELLS = 3  # controller, number, flags
SPI_CLOCK = 150_000_000  # Hz: PCLK with the 300 MHz of the boot ROM; the driver's first divider is 1


@rule(
    "chip-address",
    "A device on an I2C or SPI bus has an address or chip select that does not exist, or that another "
    "device has.",
    "The kernel refuses the device (-EINVAL, -EBUSY), with one line in its log. Data sheets often count the "
    "read bit in the I2C address: 0xa0 is 0x50.",
)
def chip_address(context: Context) -> Iterator[Finding]:
    for bus, kind in context.serial_buses.items():
        devices = [node for node in bus if node.enabled and "compatible" in node.properties]
        selects = _selects(bus)
        for node in devices:
            fault = _address_fault(kind, address_of(node), selects)
            if fault:
                message, remedy = fault
                yield Finding(
                    "chip-address", **at(node, "reg"), message=f"{node.path} {message}", remedy=remedy
                )
        for address, same in grouped(devices, address_of).items():
            if address is not None and len(same) > 1:
                yield _at_one_address(context, bus, address, same)


def _selects(bus: Node) -> int:
    """Chip selects of an SPI controller: its own, two by the drivers' default, or as many as cs-gpios has."""
    own = (bus.cells("num_cs") or bus.cells("num-chipselects") or [2])[0]
    cells, lines = bus.cells("cs-gpios"), 0
    while cells:
        lines += 1
        del cells[: GPIO_CELLS if cells[0] else 1]  # <0>: one of the controller's own
    return max(own, lines)


def _address_fault(kind: str, address: int | None, selects: int) -> tuple[str, str] | None:
    """What is wrong with an address alone, and what to do; None: nothing."""
    if address is None:
        return "has no reg", "Set reg to its I2C address" if kind == "i2c" else "Set reg to its chip select"
    if kind == "i2c" and address > LAST_ADDRESS:
        return (
            f"has reg {address:#x}, but I2C addresses end at {LAST_ADDRESS:#x}",
            f"Write the address without the read bit, {address >> 1:#x}, in reg and in the node's name",
        )
    if kind == "spi" and address >= selects:
        return (
            f"has chip select {address}, but the controller has only {selects}, counted from 0",
            "Set reg to its chip select, or add a GPIO line for it to cs-gpios of the controller",
        )
    return None


def _at_one_address(context: Context, bus: Node, address: int, nodes: list[Node]) -> Finding:
    return Finding(
        "chip-address",
        **at(nodes[-1], "reg"),
        message=f"{listed(node.name for node in nodes)} are all at {address:#x} on {context.name(bus)}",
        remedy='Correct reg, or set status = "disabled" in all of them but the one that the board has',
        claimants=tuple(Claimant(node.path, f"{address:#x}", node.place_of("reg")) for node in nodes),
    )


@rule(
    "spi-too-fast",
    "A device on an SPI bus is set to run faster than the controller's clock.",
    "The driver divides 150 MHz, and uses them undivided for every higher value. Few parts take that; "
    "usually there is a zero too many.",
)
def spi_too_fast(context: Context) -> Iterator[Finding]:
    for bus, kind in context.serial_buses.items():
        for node in bus if kind == "spi" else ():
            speed = next(iter(node.cells("spi-max-frequency")), 0)
            if node.enabled and speed > SPI_CLOCK:
                yield Finding(
                    "spi-too-fast",
                    **at(node, "spi-max-frequency"),
                    message=f"{node.path} has spi-max-frequency = <{speed}>; the controller's clock is "
                    f"{SPI_CLOCK} Hz",
                    remedy="Set spi-max-frequency to what the part's data sheet allows, in Hz",
                )


RULES = (chip_address, spi_too_fast)
