# SPDX-License-Identifier: GPL-3.0-or-later
"""Device trees for the tests: a SoC from the chip's data, and boards written on top of it."""

from __future__ import annotations

import copy
import functools
import subprocess
from collections.abc import Mapping
from pathlib import Path

from nuc980.pins.chip import Chip, Peripheral, load_chip, pin_order
from nuc980.pins.claims import PINS, pin_controller
from nuc980.pins.dtb import parse_dtb
from nuc980.pins.source import read_source
from nuc980.pins.tree import Node, Property, Tree

CHIP = load_chip()
ROOT = Path(__file__).resolve().parents[2]
TABLE = ROOT / "board/nuc980/boards/gateway/pins.yml"

MORE = {
    "aic": "interrupt-controller; #interrupt-cells = <3>;",
    "gpio": "gpio-controller; #gpio-cells = <2>; interrupt-controller; #interrupt-cells = <2>;",
    "pinctrl": "",
    "fmi": """nand-ecc-mode = "hw_oob_first"; nand-ecc-strength = <8>; nand-ecc-step-size = <512>;
            partitions { compatible = "fixed-partitions"; #address-cells = <1>; #size-cells = <1>;
                partition@200000 { label = "kernel"; reg = <0x200000 0x500000>; };
                partition@700000 { label = "device-tree"; reg = <0x700000 0x100000>; };
                partition@1600000 { label = "rootfs"; reg = <0x1600000 0x6480000>; }; };""",
}
ALWAYS_ON = ("aic", "pinctrl", "gpio")

# The gateway as the project report has it in figure 3.5, with two pins a channel, as its table 2.1 says.
GATEWAY_PINS: dict[str, dict[str, str]] = {
    "uart0": {"UART0_RXD": "PF11", "UART0_TXD": "PF12"},
    "uart1": {"UART1_RXD": "PA0", "UART1_TXD": "PF10"},
    "uart2": {"UART2_RXD": "PA9", "UART2_TXD": "PA10"},
    "uart3": {"UART3_RXD": "PD3", "UART3_TXD": "PD2"},
    "uart4": {"UART4_RXD": "PD13", "UART4_TXD": "PD12"},
    "uart6": {"UART6_RXD": "PA4", "UART6_TXD": "PA5"},
    "uart8": {"UART8_RXD": "PA11", "UART8_TXD": "PA12"},
    "emac0": {
        f"RMII0_{name}": f"PE{number}"
        for number, name in enumerate(
            ("RXERR", "CRSDV", "RXD1", "RXD0", "REFCLK", "TXEN", "TXD1", "TXD0", "MDIO", "MDC")
        )
    },
    "emac1": {
        f"RMII1_{name}": f"PF{number}"
        for number, name in enumerate(
            ("RXERR", "CRSDV", "RXD1", "RXD0", "REFCLK", "TXEN", "TXD1", "TXD0", "MDIO", "MDC")
        )
    },
    "fmi": {
        "NAND_nCS0": "PC1",
        "NAND_nWP": "PC2",
        "NAND_ALE": "PC3",
        "NAND_CLE": "PC4",
        "NAND_nWE": "PC5",
        "NAND_nRE": "PC6",
        "NAND_RDY0": "PC7",
        **{f"NAND_DATA{bit}": f"PC{8 + bit}" for bit in range(8)},
    },
}


def soc(chip: Chip = CHIP) -> str:
    """A SoC file: every peripheral of the chip, off but for the controllers."""
    buses = {bus: [one for one in chip.peripherals.values() if one.bus == bus] for bus in ("apb", "ahb")}
    body = "\n".join(
        f'    {bus} {{ compatible = "simple-bus"; #address-cells = <1>; #size-cells = <1>; ranges;\n'
        + "\n".join(map(_node, ones))
        + "\n    };"
        for bus, ones in buses.items()
    )
    return f"/ {{ #address-cells = <1>; #size-cells = <1>; interrupt-parent = <&aic>;\n{body}\n}};\n"


def _node(peripheral: Peripheral) -> str:
    lines = [f"compatible = {', '.join(map(_quoted, peripheral.compatible))};"]
    if peripheral.address is not None:
        lines.append(f"reg = <{peripheral.address:#x} {peripheral.size:#x}>;")
    if peripheral.interrupts:
        sources = ", ".join(f"<{CHIP.interrupts[name]} 4 1>" for name in peripheral.interrupts)
        lines.append(f"interrupts = {sources};")
    if "bus_num" in peripheral.properties:
        lines.append("#address-cells = <1>; #size-cells = <0>;")
    for name, value in peripheral.properties.items():
        cells = value if isinstance(value, list) else [value]
        lines.append(f"{name} = <{' '.join(map(str, cells))}>;")
    lines.append(f"status = {_quoted('okay' if peripheral.label in ALWAYS_ON else 'disabled')};")
    lines.append(MORE.get(peripheral.label, ""))
    inner = "\n".join(f"            {line}" for line in lines if line)
    return f"        {peripheral.label}: {peripheral.full_node} {{\n{inner}\n        }};"


def _quoted(word: str) -> str:
    return f'"{word}"'


def cells(pins: Mapping[str, str]) -> str:
    """The cells of a group: signal: pin."""
    return ", ".join(
        "<{} {} {} 0>".format(*pin_order(pin), CHIP.value(pin, signal)) for signal, pin in pins.items()
    )


def device(label: str, pins: Mapping[str, str], group: str | None = None) -> str:
    """A device switched on with one group, called after it or as said; label of the group: pinctrl_uart1."""
    name = group or label
    return (
        f"&pinctrl {{ {label} {{ pinctrl_{name.replace('-', '_')}: {name}-pins {{\n"
        f"    nuvoton,pins = {cells(pins)};\n"
        f"}}; }}; }};\n"
        f"&{label} {{\n"
        f'    pinctrl-names = "default";\n'
        f"    pinctrl-0 = <&pinctrl_{name.replace('-', '_')}>;\n"
        f'    status = "okay";\n'
        f"}};\n"
    )


def board(devices: Mapping[str, Mapping[str, str]], more: str = "") -> str:
    """A board file on top of soc.dtsi."""
    body = "".join(device(label, pins) for label, pins in devices.items())
    return f'/dts-v1/;\n#include "soc.dtsi"\n{body}{more}'


def gateway(more: str = "") -> str:
    """The good board, and what a test makes of it."""
    return board(GATEWAY_PINS, more)


def read(folder: Path, text: str, soc_more: str = "") -> Tree:
    """The tree of a board file's text, and of what a test adds to the SoC file."""
    (folder / "soc.dtsi").write_text(soc() + soc_more, encoding="utf-8")
    file = folder / "board.dts"
    file.write_text(text, encoding="utf-8")
    return read_source(file)


def content(node: Node) -> dict[str, dict[str, bytes]]:
    """All of a tree, dtc's notes as well, in any order."""
    own = {node.path: {name: found.raw for name, found in node.properties.items()}}
    return own | {path: values for child in node for path, values in content(child).items()}


# ---- trees in memory, for tests that make hundreds ---------------------------------------------------


@functools.cache
def _soc_root() -> Node:
    source = "/dts-v1/;\n" + soc()
    done = subprocess.run(
        ["dtc", "-q", "-I", "dts", "-O", "dtb"], input=source.encode(), capture_output=True, check=True
    )
    return parse_dtb(done.stdout, Path("soc.dtb")).root


def built(devices: Mapping[str, Mapping[str, str]]) -> Tree:
    """The SoC with these devices on, each with a group of its own, as read from a DTB."""
    root = copy.deepcopy(_soc_root())
    tree = Tree(Path("built.dtb"), root, from_source=False)
    controller = pin_controller(tree)
    for number, (label, pins) in enumerate(devices.items()):
        function = child(controller, label)
        group = child(function, f"{label}-pins")
        settings = [(*pin_order(pin), CHIP.value(pin, signal), 0) for signal, pin in pins.items()]
        set_cells(group, PINS, *(cell for setting in settings for cell in setting))
        set_cells(group, "phandle", 0x1000 + number)
        node = tree.find(CHIP.peripherals[label].path)
        set_cells(node, "pinctrl-0", 0x1000 + number)
        set_string(node, "pinctrl-names", "default")
        set_string(node, "status", "okay")
    return Tree(tree.file, root, from_source=False)


def child(parent: Node, name: str) -> Node:
    """A new node."""
    node = Node(name, parent)
    parent.children.append(node)
    return node


def set_cells(node: Node, name: str, *values: int) -> None:
    node.properties[name] = Property(name, b"".join(value.to_bytes(4, "big") for value in values))


def set_string(node: Node, name: str, value: str) -> None:
    node.properties[name] = Property(name, value.encode() + b"\0")
