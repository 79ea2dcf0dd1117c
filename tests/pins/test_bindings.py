# SPDX-License-Identifier: GPL-3.0-or-later
"""The bindings: right in themselves, quiet on our device tree, and loud on the faults they are there for."""

import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow  # as a whole: `make dtb` validates the tree itself

ROOT = Path(__file__).resolve().parents[2]
BINDINGS = ROOT / "dts" / "bindings"
GATEWAY = ROOT / "dts" / "nuvoton" / "nuc980-gateway.dts"
FAULTY = "faults.dtb"
SWITCHES = [(f"GATEWAY_PDMA={pdma}", f"GATEWAY_RTC={rtc}") for pdma in (0, 1) for rtc in (0, 1)]


@dataclass(frozen=True)
class Fault:
    """A fault on top of the gateway's source, the node to be blamed, and what the finding is to name."""

    source: str
    node: str
    names: str


# No two of them are about one property of one node, so that all can be in one tree and none hides another.
FAULTS = {
    "unknown board": Fault('/ { compatible = "openrtu,gateway", "nuvoton,nuc980"; };', "/", "compatible"),
    "uart: typo": Fault("&uart1 { pdma-enabel = <0>; };", "/apb/serial@b0071000", "pdma-enabel"),
    "uart: no map-addr": Fault("&uart2 { /delete-property/ map-addr; };", "/apb/serial@b0072000", "map-addr"),
    "uart: no port-number": Fault(
        "&uart6 { /delete-property/ port-number; };", "/apb/serial@b0076000", "port-number"
    ),
    "uart: no pdma-enable": Fault(
        "&uart8 { /delete-property/ pdma-enable; };", "/apb/serial@b0078000", "pdma-enable"
    ),
    "uart: pdma-enable 2": Fault("&uart3 { pdma-enable = <2>; };", "/apb/serial@b0073000", "pdma-enable"),
    "uart: tenth": Fault("&uart4 { port-number = <10>; };", "/apb/serial@b0074000", "port-number"),
    "uart: physical map-addr": Fault(
        "&uart5 { map-addr = <0xb0075000>; };", "/apb/serial@b0075000", "map-addr"
    ),
    "emac: one interrupt": Fault("&emac0 { interrupts = <21 4 1>; };", "/ahb/emac0@b0012000", "interrupts"),
    "emac: gigabit": Fault(
        "&emac1 { fixed-link { speed = <1000>; }; };", "/ahb/emac1@b0022000", "fixed-link:speed"
    ),
    "emac: unknown property": Fault(
        "&emac1 { mac-address-from = <0>; };", "/ahb/emac1@b0022000", "mac-address-from"
    ),
    "dma: one interrupt": Fault("&dma { interrupts = <25 4 1>; };", "/ahb/dma@b0008000", "interrupts"),
    "wdt: a property that no driver reads": Fault(
        "&wdt { timeout-secs = <8>; };", "/apb/wdt@b0040000", "timeout-secs"
    ),
    "rtc: typo, in a node off": Fault("&rtc { wakeup-enabel; };", "/apb/rtc@b0041000", "wakeup-enabel"),
    "pins: three cells": Fault(
        "&uart0_pins { nuvoton,pins = <5 11 1>, <5 12 1>; };",
        "/apb/pinctrl@b0000000",
        "uart0:uart0-pins:nuvoton,pins",
    ),
    "pins: bank H": Fault(
        "&uart1_pins { nuvoton,pins = <7 0 4 0>; };",
        "/apb/pinctrl@b0000000",
        "uart1:uart1-pins:nuvoton,pins:0:0",
    ),
    "pins: pin 16": Fault(
        "&uart2_pins { nuvoton,pins = <0 16 2 0>; };",
        "/apb/pinctrl@b0000000",
        "uart2:uart2-pins:nuvoton,pins:0:1",
    ),
    "pins: function 9": Fault(
        "&uart3_pins { nuvoton,pins = <3 3 9 0>; };",
        "/apb/pinctrl@b0000000",
        "uart3:uart3-pins:nuvoton,pins:0:2",
    ),
    "pins: typo": Fault("&uart4_pins { nuvoton,pin; };", "/apb/pinctrl@b0000000", "nuvoton,pin'"),
    "pins: group without pins": Fault(
        "&pinctrl { uart9 { uart9-pins { }; }; };", "/apb/pinctrl@b0000000", "uart9:uart9-pins"
    ),
    "gpio: three cells": Fault("&gpio { #gpio-cells = <3>; };", "/apb/gpio@b0004000", "#gpio-cells"),
    "gpio: no such EINT3 pin": Fault(
        "&gpio { eint3-config = <1 3 0>; };", "/apb/gpio@b0004000", "eint3-config"
    ),
    "gpio: EINT0 in two cells": Fault(
        "&gpio { eint0-config = <1 0>; };", "/apb/gpio@b0004000", "eint0-config"
    ),
    "nand: 10 bits": Fault("&fmi { nand-ecc-strength = <10>; };", "/ahb/fmi@b0019000", "nand-ecc-strength"),
    "nand: no step": Fault(
        "&fmi { /delete-property/ nand-ecc-step-size; };", "/ahb/fmi@b0019000", "nand-ecc-step-size"
    ),
    "partition: typo": Fault(
        "&fmi { partitions { partition@0 { read-onyl; }; }; };",
        "/ahb/fmi@b0019000/partitions",
        "partition@0:'read-onyl'",
    ),
    "partition: no name": Fault(
        "&fmi { partitions { partition@200000 { /delete-property/ label; }; }; };",
        "/ahb/fmi@b0019000/partitions",
        "partition@200000:'label'",
    ),
    "spi: three chip selects": Fault("&spi0 { num_cs = <3>; };", "/apb/spi@b0061000", "num_cs"),
    "spi: property of no driver": Fault("&spi1 { txnum = <0>; };", "/apb/spi@b0062000", "txnum"),
    "i2c: the kernel's word for bus_freq": Fault(
        "&i2c0 { clock-frequency = <100000>; };", "/apb/i2c0@b0080000", "clock-frequency"
    ),
    "i2c: eleven bits": Fault(
        "&i2c1 { clock@400 { reg = <0x400>; }; };", "/apb/i2c1@b0081000", "clock@400:reg"
    ),
    "pwm: the other's channels": Fault("&pwm1 { id = <0>; };", "/apb/pwm@b0059000", "id"),
    "smart card: level 3": Fault("&sc0 { cdlvl = <3>; };", "/apb/sc@b0090000", "cdlvl"),
    "usb: half of the compatible": Fault(
        '&usbh_lite0 { compatible = "nuvoton,nuc980-usbh-lite0"; };',
        "/ahb/usbh_lite0@b0017000",
        "compatible",
    ),
    "keys: no codes": Fault(
        '&keys { key-matrix = <1 1>; gpio-keys-rows = <138>; status = "okay"; };', "/keys", "key-code"
    ),
    "sdh: no such compatible": Fault(
        '&sdh { compatible = "nuvoton,nuc980-shd"; };', "/ahb/sdh@b0018000", "nuvoton,nuc980-shd"
    ),
}

# Valid, but refused once: what the kernel's own bindings describe, and what its core reads for our drivers.
VALID = """
/ {
	buttons {
		compatible = "gpio-keys";

		button {
			label = "reset";
			linux,code = <0x198>;
			debounce-interval = <20>;
			gpios = <&gpio 139 1>;
		};
	};

	regulator-sim {
		compatible = "regulator-fixed";
		regulator-name = "sim";
		regulator-min-microvolt = <3300000>;
		regulator-max-microvolt = <3300000>;
		startup-delay-us = <1000>;
		gpios = <&gpio 197 0>;
	};
};

&pinctrl {
	spi0 {
		spi0_pins: spi0-pins {
			nuvoton,pins = <3 9 1 0>, <3 10 1 0>, <3 11 1 0>;
		};
	};
};

&uart2_pins {
	nuvoton,pins = <0 9 2 0>, <0 10 2 0>, <0 8 2 0>, <0 7 2 0>;
};

&uart2 {
	linux,rs485-enabled-at-boot-time;
	rs485-rts-active-low;
	rs485-rts-delay = <0 1>;
};

&emac0 {
	local-mac-address = [02 00 00 00 00 01];
};

&spi0 {
	pinctrl-names = "default";
	pinctrl-0 = <&spi0_pins>;
	cs-gpios = <&gpio 104 1>;
	status = "okay";

	dac@0 {
		compatible = "ti,dac7612";
		reg = <0>;
		spi-max-frequency = <1000000>;
	};
};
"""


def _run(tool: str, *arguments: object) -> str:
    """What a tool of dtschema says: dt-validate exits with 0 whatever it finds."""
    # Beside the interpreter: a virtual environment need not be activated.
    command = [Path(sys.executable).with_name(tool), *arguments]
    run = subprocess.run(list(map(str, command)), capture_output=True, text=True, timeout=60)
    return run.stdout + run.stderr


def _compile(source: Path, dtb: Path, *switches: str) -> Path:
    subprocess.run(
        [ROOT / "scripts" / "build-dtb.sh", source, dtb, *switches], check=True, capture_output=True
    )
    return dtb


def _validate(dtbs: list[Path], report: Path) -> dict[str, dict[str, list[str]]]:
    """Name of the DTB: node: what is said of it, as path of the property and message."""
    _run("dt-validate", "--show-unmatched", "--schema", BINDINGS, "--json-output", report, *dtbs)
    found: dict[str, dict[str, list[str]]] = {dtb.name: {} for dtb in dtbs}
    for one in json.loads(report.read_text()):
        text = ":".join([*map(str, one.get("property_path", [])), one["message"]])
        found[Path(one["file"]).name].setdefault(one.get("node", ""), []).append(text)
    return found


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, list[str]]]:
    """The gateway with each setting of its switches, and with all faults: one run, for reading takes long."""
    folder = tmp_path_factory.mktemp("dtbs")
    source = folder / "faults.dts"
    source.write_text("\n".join([f'#include "{GATEWAY}"', *(fault.source for fault in FAULTS.values())]))
    dtbs = [_compile(GATEWAY, folder / f"{'-'.join(switches)}.dtb", *switches) for switches in SWITCHES]
    return _validate([*dtbs, _compile(source, folder / FAULTY)], folder / "report.json")


def test_bindings_are_valid() -> None:
    assert _run("dt-doc-validate", BINDINGS) == ""


def test_gateway_has_no_finding_and_no_node_without_binding(found: dict[str, dict[str, list[str]]]) -> None:
    gateways = {name: nodes for name, nodes in found.items() if name != FAULTY}
    assert not any(gateways.values()), gateways


@pytest.mark.parametrize("fault", FAULTS.values(), ids=FAULTS)
def test_fault_is_found(fault: Fault, found: dict[str, dict[str, list[str]]]) -> None:
    messages = found[FAULTY].get(fault.node, [])
    assert any(fault.names in text for text in messages), messages


def test_nothing_is_found_where_nothing_is_wrong(found: dict[str, dict[str, list[str]]]) -> None:
    assert set(found[FAULTY]) == {fault.node for fault in FAULTS.values()}


@pytest.fixture
def script(tmp_path: Path) -> Callable[[str], subprocess.CompletedProcess[str]]:
    """What `make dtb` says of the gateway with something added."""

    def validate(more: str) -> subprocess.CompletedProcess[str]:
        source = tmp_path / "board.dts"
        source.write_text(f'#include "{GATEWAY}"\n{more}')
        command = [ROOT / "scripts" / "validate-dtb.sh", _compile(source, tmp_path / "board.dtb")]
        return subprocess.run(command, capture_output=True, text=True, check=False)

    return validate


def test_script_takes_what_the_kernel_describes(
    script: Callable[[str], subprocess.CompletedProcess[str]],
) -> None:
    done = script(VALID)
    assert (done.returncode, done.stderr) == (0, "")


def test_script_refuses_a_fault(script: Callable[[str], subprocess.CompletedProcess[str]]) -> None:
    done = script(FAULTS["uart: typo"].source + FAULTS["sdh: no such compatible"].source)
    assert done.returncode == 1
    assert "pdma-enabel" in done.stderr
    assert "nuvoton,nuc980-shd" in done.stderr


def test_examples_are_valid(tmp_path: Path) -> None:
    dtbs = []
    for binding in BINDINGS.rglob("*.yaml"):
        dtb = tmp_path / f"{binding.stem}.dtb"
        example = _run("dt-extract-example", binding)
        subprocess.run(["dtc", "-q", "-O", "dtb", "-o", dtb, "-"], input=example, text=True, check=True)
        dtbs.append(dtb)
    assert _run("dt-validate", "--schema", BINDINGS, *dtbs) == ""
