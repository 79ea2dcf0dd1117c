# SPDX-License-Identifier: GPL-3.0-or-later
"""Claims, and what the rules make of them: what is found, what is rightly not, and how it is told."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

import pytest
from trees import CHIP, GATEWAY_PINS, TABLE, board, built, cells, device, gateway, read, set_cells

from nuc980.pins.board import Accepted, load_board
from nuc980.pins.chip import GPIO
from nuc980.pins.claims import claims
from nuc980.pins.dtb import read_dtb
from nuc980.pins.findings import Finding
from nuc980.pins.rules import RULES, check
from nuc980.pins.tree import Tree

BOARD = load_board(TABLE, CHIP)
LABELS = {peripheral.path: label for label, peripheral in CHIP.peripherals.items()}


def wanted(tree: Tree) -> set[tuple[str, str, str | None]]:
    return {
        (LABELS.get(claim.node.path, claim.node.path), claim.pin, claim.signal)
        for claim in claims(tree, CHIP)
    }


def flat(pins: Mapping[str, str]) -> str:
    """As the vendor writes a group: all cells in one list."""
    return cells(pins).replace(">, <", " ").strip("<>")


def rules_of(findings: list[Finding]) -> set[str]:
    return {finding.rule for finding in findings}


# ---- claims --------------------------------------------------------------------------------------


def test_the_gateway_claims_what_its_groups_say(tmp_path: Path) -> None:
    tree = read(tmp_path, gateway())
    assert wanted(tree) == {
        (label, pin, signal) for label, pins in GATEWAY_PINS.items() for signal, pin in pins.items()
    }


def test_a_claim_names_its_group_value_property_and_line(tmp_path: Path) -> None:
    text = gateway()
    tree = read(tmp_path, text)
    claim = next(claim for claim in claims(tree, CHIP) if claim.pin == "PF10")
    assert (claim.signal, claim.value, claim.property) == ("UART1_TXD", 2, "pinctrl-0")
    assert claim.group is not None and claim.group.name == "uart1-pins"
    line = text.splitlines().index("    pinctrl-0 = <&pinctrl_uart1>;") + 1
    assert claim.place is not None and (Path(claim.place.file).name, claim.place.line) == ("board.dts", line)


ACME = '/ { s { compatible = "acme"; %s }; };'
KEYS_ON = '&keys { status = "okay"; %s };'


@pytest.mark.parametrize(
    ("more", "claimed"),
    [
        ("&gpio { led { gpio-hog; gpios = <6 0 7 1>; output-low; }; };", {"PA6", "PA7"}),
        (ACME % "a { gpios = <&gpio 6 1>; }; b { gpios = <&gpio 7 1>; };", {"PA6", "PA7"}),
        (ACME % "x-gpios = <0>, <&gpio 6 0>;", {"PA6"}),
        (ACME % "gpio = <&gpio 6 0>; nr-gpios = <3>;", {"PA6"}),
        (ACME % 'status = "disabled"; x-gpios = <&gpio 6 0>;', set()),
        (ACME % 'status = "fail"; a { x-gpios = <&gpio 6 0>; };', set()),
        ("/ { apb { s { x-gpios = <&gpio 6 0>; }; }; };", set()),  # no compatible: the kernel makes no device
        (
            ACME % "x-gpios = <&e 3>, <&gpio 6 0>;"
            + '/ { e: expander { compatible = "nxp,pca9554"; gpio-controller; #gpio-cells = <1>; }; };',
            {"PA6"},
        ),
        (KEYS_ON % "key-matrix = <2 1>; gpio-keys-rows = <6 7>; gpio-keys-cols = <8>;", {"PA6", "PA7"}),
        (
            KEYS_ON % "key-matrix = <1 2>; gpio-keys-rows = <6 7>; gpio-keys-cols = <8 197>;",
            {"PA6", "PA8", "PG5"},
        ),
        ("&keys { key-matrix = <1 1>; gpio-keys-rows = <6>; };", set()),
        (ACME % "interrupt-parent = <&gpio>; interrupts = <6 1 7 1>;", {"PA6", "PA7"}),
        (ACME % "interrupts = <36 4 1>;", set()),
    ],
)
def test_gpio_lines(more: str, claimed: set[str], tmp_path: Path) -> None:
    tree = read(tmp_path, board({}, more))
    assert {claim.pin for claim in claims(tree, CHIP)} == claimed
    assert all(claim.signal == GPIO and not claim.muxed for claim in claims(tree, CHIP))


def test_states_end_at_the_first_number_that_is_missing(tmp_path: Path) -> None:
    more = device("uart5", {"UART5_RXD": "PG6", "UART5_TXD": "PG7"}).split("&uart5")[0]
    more += "&uart1 { pinctrl-2 = <&pinctrl_uart5>; };"
    assert ("uart1", "PG6", "UART5_RXD") not in wanted(read(tmp_path, gateway(more)))


# ---- what is no mistake --------------------------------------------------------------------------

I2C_FREED = """
&pinctrl { free { i2c_free: i2c-free { nuvoton,pins = <4 10 0 0>, <4 12 0 0>; }; }; };
&i2c0 { pinctrl-names = "default", "gpio"; pinctrl-1 = <&i2c_free>;
        sda-gpios = <&gpio 138 6>; scl-gpios = <&gpio 140 6>; };
"""
CAMERA = """
&pinctrl { cam { cam: cam { nuvoton,pins = <4 12 7 0>, <5 10 7 0>, <4 0 7 0>, <4 1 7 0>, <4 2 7 0>, <4 3 7 0>,
  <4 4 7 0>, <4 5 7 0>, <4 6 7 0>, <4 7 7 0>, <4 8 7 0>, <4 9 7 0>; }; }; };
&ccap1 { status = "okay"; };
/ { i2c-9 { compatible = "i2c-gpio"; sda-gpios = <&gpio 39 6>; scl-gpios = <&gpio 37 6>; #address-cells = <1>;
    #size-cells = <0>;
    camera@24 { compatible = "himax,hm1055"; reg = <0x24>;
      pinctrl-names = "default"; pinctrl-0 = <&cam>; }; }; };
"""
LED_WITH_GROUP = """
&pinctrl { leds { lamps: lamps { nuvoton,pins = <0 6 0 0>; }; }; };
/ { leds { compatible = "gpio-leds"; pinctrl-names = "default"; pinctrl-0 = <&lamps>;
    a { gpios = <&gpio 6 0>; }; }; };
"""
I2C = device("i2c0", {"I2C0_SDA": "PE10", "I2C0_SCL": "PE12"})
TOUCH = """&i2c0 { touch@38 { compatible = "edt,edt-ft5406"; reg = <0x38>; interrupt-parent = <&gpio>;
  interrupts = <6 2>; irq-gpios = <&gpio 6 0>; }; };"""
USB_HOST = (
    '&usbh_ohci { status = "okay"; };'
    + device("usbh_lite0", {"USBHL0_DP": "PB4", "USBHL0_DM": "PB6"})
    + device("usbh_lite1", {"USBHL1_DP": "PE1", "USBHL1_DM": "PE0"})
)
RS485 = device("uart2", {"UART2_RXD": "PA9", "UART2_TXD": "PA10", "UART2_RTS": "PA8"})
QUIET = {
    "a bus that another state frees": I2C + I2C_FREED,
    "camera pins in the camera's node": CAMERA,
    "group that makes an LED's pin GPIO": LED_WITH_GROUP,
    "interrupt that is read as well": I2C + TOUCH,
    "USB host's ports at one address": USB_HOST,
    "RTS that turns an RS-485 driver": RS485 + "&uart2 { linux,rs485-enabled-at-boot-time; };",
    "interrupt pin that is ready and off": device("gpio", {"EINT3": "PG15"}),
    "interrupt pin that is on": device("gpio", {"EINT3": "PG15"}) + "&gpio { eint3-config = <1 2 1>; };",
    "uart0, which has no PDMA": device("uart0", {"UART0_RXD": "PF11", "UART0_TXD": "PF12"})
    + "&uart0 { pdma-enable = <1>; };",
    "chip select that is a GPIO line": device(
        "spi1", {"SPI1_CLK": "PG12", "SPI1_MOSI": "PG13", "SPI1_MISO": "PG14"}
    )
    + "&spi1 { cs-gpios = <&gpio 203 1>; };",
    "timer that only counts its clock": '&etimer0 { status = "okay"; };',
    "interrupt in the longer property": RS485.replace(", <0 8 2 0>", "")
    + "&uart2 { interrupts-extended = <&aic 38 4 1>; };",
    "interrupt of the longer property that is read as well": I2C
    + TOUCH.replace("interrupt-parent = <&gpio>;", "").replace(
        "interrupts = <6 2>", "interrupts-extended = <&gpio 6 2>"
    ),
    "keys behind an expander": I2C
    + """&i2c0 { e: e@20 { compatible = "nxp,pca9555"; reg = <0x20>; gpio-controller; #gpio-cells = <2>;
      interrupt-controller; #interrupt-cells = <2>; interrupt-parent = <&gpio>; interrupts = <6 2>; }; };
    / { k { compatible = "gpio-keys";
      b { linux,code = <2>; interrupt-parent = <&e>; interrupts = <9 1>; gpios = <&e 3 0>; }; }; };""",
    "what the specification knows besides okay": '&uart5 { status = "fail-fuse"; };'
    '&wwdt { status = "reserved"; };',
    "two supplies that one line switches": "/ { "
    + " ".join(
        f'supply{number} {{ compatible = "regulator-fixed"; regulator-name = "s"; gpio = <&gpio 6 0>; }};'
        for number in (1, 2)
    )
    + " };",
    "PDMA with its controller": RS485.replace(", <0 8 2 0>", "")
    + '&uart2 { pdma-enable = <1>; }; &dma { status = "okay"; };',
    "name of the 6.6 kernel": device(
        "spi0", {"SPI0_CLK": "PD9", "SPI0_MOSI": "PD10", "SPI0_MISO": "PD11", "SPI0_SS0": "PD8"}
    )
    + '&spi0 { compatible = "nuvoton,nuc980-spi"; };',
    "name of the other converter driver": device("nadc", {"ADC_AIN0": "PB0"})
    + '&nadc { compatible = "nuvoton,nuc980-adc"; };',
    "NAND with a second name": device("fmi", GATEWAY_PINS["fmi"])
    + '&fmi { compatible = "nuvoton,nuc980-fmi", "nand"; };',
    "pin controller without reg": "&pinctrl { /delete-property/ reg; };",
    "clock for a PHY, which is nobody's signal": device("emac0", GATEWAY_PINS["emac0"])
    + "&pinctrl { clock { clock: clock { nuvoton,pins = <6 0 3 0>; }; }; };"
    "&emac0 { pinctrl-0 = <&pinctrl_emac0>, <&clock>; };",
    "fourth cell, which no driver reads": RS485.replace(", <0 8 2 0>", "").replace("0 9 2 0", "0 9 2 7"),
    "two devices of one bus_num, one of them off": "&spi0 { bus_num = <0>; }; &spi1 { bus_num = <0>; };",
    "devices that are off with the same pins": device("uart1", {"UART1_RXD": "PA0", "UART1_TXD": "PA1"})
    + device("can3", {"CAN3_RXD": "PA0", "CAN3_TXD": "PA1"})
    + '&can3 { status = "disabled"; };',
    "GPIO controller by either of its sources": "&gpio { interrupts = <8 4 1>; };",
    "names of nodes that read like lists of lines": "/ { aliases { gpio = &gpio; status-gpios = &gpio; }; };",
    "interrupt controller at the root": "/delete-node/ &aic; / { interrupt-parent = <&aic>; "
    'aic: interrupt-controller@b0042000 { compatible = "nuvoton,nuc980-aic"; reg = <0xb0042000 0x1000>; '
    "interrupt-controller; #interrupt-cells = <3>; }; };",
    "no pin controller, a device that the chip does not have": "/delete-node/ &pinctrl;"
    '/ { apb { fpga@c0000000 { compatible = "acme,fpga"; reg = <0xc0000000 4>; }; }; };',
}


@pytest.mark.sample(5)
@pytest.mark.parametrize("more", QUIET.values(), ids=QUIET)
def test_no_mistake(more: str, tmp_path: Path) -> None:
    findings = check(read(tmp_path, board({}, more)), CHIP)
    assert [finding.message for finding in findings] == []


# ---- the report's own tree -----------------------------------------------------------------------

# What the report's nuc980.dtsi has, of which figures 3.1 to 3.4 show a part: groups with RTS and CTS, both
# EMACs on.
REPORT_GROUPS = {
    "uart0": ("uart0-PF", GATEWAY_PINS["uart0"]),
    "uart2": ("uart2-PA", {"UART2_CTS": "PA7", "UART2_RTS": "PA8", "UART2_RXD": "PA9", "UART2_TXD": "PA10"}),
    "uart3": ("uart3-PD", {"UART3_TXD": "PD2", "UART3_RXD": "PD3", "UART3_RTS": "PD4", "UART3_CTS": "PD5"}),
    "uart4": (
        "uart4-PD",
        {"UART4_TXD": "PD12", "UART4_RXD": "PD13", "UART4_RTS": "PD14", "UART4_CTS": "PD15"},
    ),
    "uart6": ("uart6-PA", {"UART6_CTS": "PA2", "UART6_RTS": "PA3", "UART6_RXD": "PA4", "UART6_TXD": "PA5"}),
    "uart8": (
        "uart8-PA-PG",
        {"UART8_RXD": "PA11", "UART8_TXD": "PA12", "UART8_RTS": "PG8", "UART8_CTS": "PG9"},
    ),
    "emac0": ("emac0", GATEWAY_PINS["emac0"]),
    "emac1": ("emac1", GATEWAY_PINS["emac1"]),
    "sdh": (
        "sdh",
        {"SD1_nCD": "PF6", "SD1_CMD": "PF0", "SD1_CLK": "PF1"}
        | {f"SD1_DATA{bit}": f"PF{2 + bit}" for bit in range(4)},
    ),
}


def group_label(group: str) -> str:
    return f"pinctrl_{group.replace('-', '_')}"


REPORT_SOC = "".join(
    f"&pinctrl {{ {label} {{ {group_label(group)}: {group} {{ nuvoton,pins = <{flat(pins)}>; }}; }}; }};\n"
    f'&{label} {{ pinctrl-names = "default"; pinctrl-0 = <&{group_label(group)}>; }};\n'
    for label, (group, pins) in REPORT_GROUPS.items()
) + "".join(f'&{label} {{ status = "okay"; }};\n' for label in ("uart0", "emac0", "emac1"))
REPORT_UARTS = "\n".join(
    f"""        uart{port}: serial@b007{port}000 {{
            pinctrl-names = "default";
            pinctrl-0 = <&{group_label(group)}>;
            pdma-enable = <1>;
            status = "okay";
        }};"""
    for port, group in (
        (1, "uart1-PA-PF"),
        *((port, REPORT_GROUPS[f"uart{port}"][0]) for port in (2, 3, 4, 6, 8)),
    )
)
# Figure 3.5, and the lines behind it: DMA on, SD host on.
REPORT = """/dts-v1/;
#include "soc.dtsi"
/ {
    apb {
        pinctrl: pinctrl@b0000000 {
            uart1 {
                pinctrl_uart1_PA_PF: uart1-PA-PF {
                    nuvoton,pins =
                        <0 0 4 0
                         5 0xa 2 0>;
                };
            };
        };
UARTS
    };
    ahb {
        dma@b0008000 { status = "okay"; };
        sdh@b0018000 { status = "okay"; };
    };
};
""".replace("UARTS", REPORT_UARTS)


def test_the_reports_tree_has_its_conflict(tmp_path: Path) -> None:
    (finding,) = check(read(tmp_path, REPORT, REPORT_SOC), CHIP)
    assert finding.rule == "pin-conflict"
    assert finding.pins == ("PF0", "PF1", "PF2", "PF3", "PF4", "PF5", "PF6")
    assert {claimant.node for claimant in finding.claimants} == {"/ahb/sdh@b0018000", "/ahb/emac1@b0022000"}


def test_the_pin_table_says_whose_fault_it_is(tmp_path: Path) -> None:
    findings = check(read(tmp_path, REPORT, REPORT_SOC), CHIP, BOARD, BOARD.package)
    conflict = next(finding for finding in findings if finding.rule == "pin-conflict")
    assert conflict.node == "/ahb/sdh@b0018000"
    assert conflict.remedy.startswith('Set status = "disabled" in sdh, which is not in the pin table')
    rts = {finding.node for finding in findings if finding.rule == "table-disagrees"}
    assert rts == {CHIP.peripherals[f"uart{port}"].path for port in (2, 3, 4, 6, 8)}
    assert rules_of(findings) == {"pin-conflict", "left-on", "table-disagrees", "table-missing"}


def test_source_and_dtb_have_the_same_findings(tmp_path: Path) -> None:
    tree = read(tmp_path, REPORT, REPORT_SOC)
    dtb = tmp_path / "board.dtb"
    source = REPORT.replace('#include "soc.dtsi"', '/include/ "soc.dtsi"')
    subprocess.run(["dtc", "-q", "-i", tmp_path, "-o", dtb], input=source.encode(), check=True)

    def told(findings: list[Finding]) -> set[tuple[str, tuple[str, ...], frozenset[str]]]:
        return {
            (finding.rule, finding.pins, frozenset(claimant.node for claimant in finding.claimants))
            for finding in findings
        }

    from_dtb = check(read_dtb(dtb), CHIP, BOARD, BOARD.package)
    assert told(from_dtb) == told(check(tree, CHIP, BOARD, BOARD.package)) != set()
    assert [finding.place for finding in from_dtb if finding.place] == []


def test_symbols_of_an_overlays_base_are_no_devices(tmp_path: Path) -> None:
    """dtc -@ names each label there, gpio too."""
    dtb = tmp_path / "board.dtb"
    read(tmp_path, gateway())
    source = gateway().replace('#include "soc.dtsi"', '/include/ "soc.dtsi"')
    subprocess.run(["dtc", "-q", "-@", "-i", tmp_path, "-o", dtb], input=source.encode(), check=True)
    tree = read_dtb(dtb)
    symbols = tree.find("/__symbols__")
    assert symbols
    assert "gpio" in symbols.properties
    assert check(tree, CHIP) == []


# ---- how it is told ------------------------------------------------------------------------------


def test_an_accepted_finding_carries_the_reason(tmp_path: Path) -> None:
    tree = read(tmp_path, REPORT, REPORT_SOC)
    accepted = dataclasses.replace(
        BOARD, accepted=(Accepted("pin-conflict", "/ahb/sdh@b0018000", "no card is ever put in"),)
    )
    findings = check(tree, CHIP, accepted, BOARD.package)
    reasons = {finding.rule: finding.accepted for finding in findings}
    assert reasons["pin-conflict"] == "no card is ever put in"
    assert [reason for rule, reason in reasons.items() if rule != "pin-conflict"] == [None] * (
        len(reasons) - 1
    )


def test_findings_come_in_the_order_of_the_files(tmp_path: Path) -> None:
    findings = check(read(tmp_path, REPORT, REPORT_SOC), CHIP, BOARD, BOARD.package)
    places = [finding.place for finding in findings if finding.place]
    assert len(places) > 3 and places == sorted(places)


def test_every_rule_can_be_read(tmp_path: Path) -> None:
    for name, rule in RULES.items():
        assert rule.name == name and name == name.lower() and " " not in name
        assert rule.what.endswith(".") and rule.what.count(". ") == 0
        assert rule.why.endswith(".")


def test_without_table_and_package_their_rules_are_silent(tmp_path: Path) -> None:
    more = ACME % "a-gpios = <&gpio 194 0>; b-gpios = <&gpio 192 0>;"
    tree = read(tmp_path, gateway(more))
    assert check(tree, CHIP) == []
    assert rules_of(check(tree, CHIP, package=BOARD.package)) == {"not-bonded"}
    assert rules_of(check(tree, CHIP, BOARD)) == {"table-gpio", "reserved-pin"}


def test_a_check_of_a_board_takes_few_steps(tmp_path: Path) -> None:
    """An editor has it made at each pause of who types. A call takes a fraction of a microsecond."""
    tree = read(tmp_path, REPORT, REPORT_SOC)
    calls: Counter[str] = Counter()
    sys.setprofile(lambda frame, event, argument: calls.update([event]))
    try:
        check(tree, CHIP, BOARD, BOARD.package)
    finally:
        sys.setprofile(None)
    assert calls["call"] + calls["c_call"] < 100_000


@pytest.mark.slow
def test_interrupt_parents_in_a_circle_come_to_an_end() -> None:
    tree = built(GATEWAY_PINS)
    uart = tree.find("/apb/serial@b0071000")
    assert uart is not None
    set_cells(uart, "phandle", 0x900)
    set_cells(uart, "interrupt-parent", 0x900)
    findings = check(Tree(tree.file, tree.root, tree.from_source), CHIP)
    assert [(finding.rule, finding.node) for finding in findings] == [("wrong-interrupt", uart.path)]
    assert "belong to no interrupt controller" in findings[0].message
