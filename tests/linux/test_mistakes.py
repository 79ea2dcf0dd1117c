# SPDX-License-Identifier: GPL-3.0-or-later
"""
Mistakes in the device tree that still boots, one at a time: `nuc980-pins check` finds each by its rule, and
the emulated board shows what the rule predicts: a dumb or deaf line, no link, a driver refused, a device that
is not there. The rules are the checker's own list: one without a case here has its reason here.
"""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import pytest
from gateway_trees import gateway_dtb

from nuc980.pins.board import load_board
from nuc980.pins.chip import load_chip
from nuc980.pins.dtb import read_dtb
from nuc980.pins.rules import RULES, check
from nuc980.twin.linux import TROUBLE, Kernel, Linux

CHIP = load_chip()
ROOT = Path(__file__).resolve().parents[2]
BOARD = load_board(ROOT / "board/nuc980/boards/gateway/pins.yml", CHIP)

OFF = 'status = "disabled";'
LEDS = '/ {{ leds {{ compatible = "gpio-leds"; led-0 {{ label = "lamp"; gpios = <{}>; }}; }}; }};'
LAMP = "/sys/class/leds/lamp"
EMAC0 = "/sys/bus/platform/devices/b0012000.emac0/driver"
UART5_PINS = (
    "&pinctrl {{ uart5 {{ uart5_pins: uart5-pins {{ nuvoton,pins = {}; }}; }}; }};"
    '&uart5 {{ pinctrl-names = "default"; pinctrl-0 = <&uart5_pins>; status = "okay"; }};'
)


@dataclass(frozen=True)
class Symptom:
    """What the board shows. A good board shows none of it, but talks and hears."""

    says: str = ""  # a pattern, of the kernel's log
    missing: tuple[str, ...] = ()  # files that a good board has
    there: tuple[str, ...] = ()  # files that it does not have
    port: int = 1
    talks: bool | None = None  # what is written to ttyS of the port comes out; None: not looked at
    hears: bool | None = None  # what comes in is read from it


@dataclass(frozen=True)
class Mistake:
    rule: str
    name: str
    more: str  # behind the gateway's device tree
    symptom: Symptom

    def __str__(self) -> str:
        return f"{self.rule}: {self.name}"


def no_port(number: int, says: str = "") -> Symptom:
    return Symptom(says, missing=(f"/dev/ttyS{number}",))


DEAF = Symptom(talks=True, hears=False)
DUMB = Symptom(talks=False, hears=True)
DEAF_AND_DUMB = Symptom(talks=False, hears=False)

MISTAKES = [
    Mistake(
        "pin-conflict",
        "a port on pins of an Ethernet port",
        "&uart6_pins { nuvoton,pins = <4 8 5 0>, <4 9 5 0>; };",
        Symptom(r"pin PE8 already requested by b0076000\.serial; cannot claim for b0012000\.emac0", (EMAC0,)),
    ),
    Mistake(
        "mux-and-gpio",
        "LED on a port's pin",
        LEDS.format("&gpio 9 0"),
        Symptom(r"pin PA9 already requested by b0072000\.serial; cannot claim for b0004000\.gpio:\d+"),
    ),
    Mistake(
        "gpio-conflict",
        "two LEDs on one line",
        '/ { leds { compatible = "gpio-leds"; a { gpios = <&gpio 6 0>; }; b { gpios = <&gpio 6 1>; }; }; };',
        Symptom("leds-gpio: probe of leds failed with error -16"),
    ),
    Mistake(
        "no-such-pin",
        "bank B beyond PB13",
        "&uart2_pins { nuvoton,pins = <0 9 2 0>, <1 14 2 0>; };",
        no_port(2, r"uart2-pins: there is no pin <1 14>"),
    ),
    Mistake(
        "no-such-pin",
        "LED on a line without a pin",
        LEDS.format("&gpio 141 0"),
        Symptom("leds-gpio: probe of leds failed with error -22"),
    ),
    Mistake(
        "no-such-function",
        "value between others",
        "&uart1_pins { nuvoton,pins = <0 0 4 0>, <5 10 1 0>; };",
        no_port(1, "PF10 has no function 1"),
    ),
    Mistake(
        "foreign-function",
        "another device's signal",
        "&uart1_pins { nuvoton,pins = <0 0 3 0>, <5 10 2 0>; };",
        DEAF,
    ),
    Mistake(
        "pin-twice",
        "the later setting stays",
        "&uart1_pins { nuvoton,pins = <0 0 4 0>, <5 10 2 0>, <5 10 4 0>; };",
        DUMB,
    ),
    Mistake(
        "not-bonded",
        "a port on pins without a leg",
        "&uart3_pins { nuvoton,pins = <1 10 1 0>, <1 9 1 0>; };",
        replace(DEAF_AND_DUMB, port=3),
    ),
    Mistake(
        "cell-count",
        "three cells a pin",
        "&uart1_pins { nuvoton,pins = <0 0 4>, <5 10 2>; };",
        no_port(1, "uart1-pins: no nuvoton,pins with 4 cells for each"),
    ),
    Mistake(
        "cell-count", "GPIO without flags", LEDS.format("&gpio 6"), Symptom("leds-gpio: probe of leds failed")
    ),
    Mistake("group-missing", "reference to no node", "&uart1 { pinctrl-0 = <0x7777>; };", no_port(1)),
    Mistake("no-default-state", "another name", '&uart1 { pinctrl-names = "sleep"; };', DEAF_AND_DUMB),
    Mistake("no-pins", "no state", "&uart1 { /delete-property/ pinctrl-0; };", DEAF_AND_DUMB),
    Mistake("incomplete-set", "no TXD", "&uart1_pins { nuvoton,pins = <0 0 4 0>; };", DUMB),
    Mistake("incomplete-set", "no RXD", "&uart1_pins { nuvoton,pins = <5 10 2 0>; };", DEAF),
    Mistake("wrong-address", "another port's", "&uart1 { reg = <0xb0075000 0x1000>; };", DEAF_AND_DUMB),
    Mistake("wrong-address", "none", "&uart1 { /delete-property/ reg; };", no_port(1)),
    Mistake("wrong-interrupt", "another port's", "&uart1 { interrupts = <44 4 1>; };", DEAF),
    Mistake("wrong-interrupt", "none", "&uart1 { /delete-property/ interrupts; };", no_port(1)),
    Mistake(
        "controller-off",
        "GPIO controller of a LED",
        LEDS.format("&gpio 6 0") + f"&gpio {{ {OFF} }};",
        Symptom(missing=("/dev/gpiochip0",)),
    ),
    Mistake(
        "no-bus", "without ranges", "/ { ahb { /delete-property/ ranges; }; };", Symptom(missing=(EMAC0,))
    ),
    Mistake("unknown-status", "enabled", '&uart1 { status = "enabled"; };', no_port(1)),
    Mistake("wrong-number", "of another port", "&uart1 { port-number = <2>; };", no_port(1)),
    Mistake("wrong-compatible", "standard UART", '&uart1 { compatible = "ns16550a"; };', no_port(1)),
    Mistake(
        "address-twice",
        "a second node for a port",
        '/ { apb { copy@b0078000 { compatible = "nuvoton,nuc980-uart"; reg = <0xb0078000 0x1000>;'
        " interrupts = <41 4 1>; port-number = <9>; map-addr = <0xf0078000>; pdma-enable = <0>; }; }; };",
        Symptom("can't request region for resource"),
    ),
    Mistake(
        "stale-node",
        "letter for digit: nothing is switched off",
        f'&uart5 {{ status = "okay"; }}; / {{ apb {{ serial@b00750O0 {{ {OFF} }}; }}; }};',
        Symptom(there=("/dev/ttyS5",)),
    ),
    Mistake("missing-property", "port-number", "&uart6 { /delete-property/ port-number; };", no_port(6)),
    Mistake("table-missing", "device off", f"&uart8 {{ {OFF} }};", no_port(8)),
    Mistake(
        "table-disagrees",
        "pins that the board does not wire",
        "&uart2_pins { nuvoton,pins = <3 7 2 0>, <3 6 2 0>; };",
        replace(DEAF_AND_DUMB, port=2),
    ),
    Mistake(
        "left-on",
        "a port that nobody asked for",
        UART5_PINS.format("<6 6 2 0>, <6 7 2 0>"),
        Symptom(there=("/dev/ttyS5",)),
    ),
    Mistake(
        "table-gpio", "LED on a pin of unknown wiring", LEDS.format("&gpio 197 0"), Symptom(there=(LAMP,))
    ),
    Mistake("reserved-pin", "LED on a boot strap", LEDS.format("&gpio 192 0"), Symptom(there=(LAMP,))),
    Mistake(
        "reg-overlap",
        "a port with the registers of the next",
        "&uart1 { reg = <0xb0071000 0x2000>; };",
        no_port(2, r"b0072000\.serial failed with error -16"),
    ),
    Mistake(
        "unknown-property",
        "the pins of a port, mistyped",
        "&uart1 { /delete-property/ pinctrl-0; pinctl-0 = <&uart1_pins>; };",
        DEAF_AND_DUMB,
    ),
]

# Rules whose mistakes have no boot here, each with why.
WITHOUT_SYMPTOM = {
    "signal-twice": "an output comes out on both pins, and the board has wires at one of them",
    "group-name-twice": "our driver finds a group by its node: test_pinctrl has such a tree",
    "label-misleads": "labels are gone when a tree is compiled",
    "half-set": "two wires work; only flow control stops, and then on the vendor's driver",
    "eint": "our driver takes interrupts of any line and has no use for eintN-config",
    "unit-address": "the kernel takes the address from reg, and the name from that",
    "bus-num-twice": "of SPI and I2C, for which our port has no drivers yet",
    "pdma-without-dma": "our driver of the ports goes on without PDMA",
    "bank-and-pin": "the line of that number works, only another is meant",
    "no-rts": "the transceivers of the emulated lines turn round by themselves",
    "outside-bus": "the kernel takes the device: it is its second node that hurts (address-twice)",
    "wrong-trigger": "the port is there until somebody opens it",
    "wrong-reference": "our drivers have their clocks without the tree, and go on with a line in the log",
    "chip-address": "of SPI and I2C, for which our port has no drivers yet",
    "spi-too-fast": "the same",
    "quad-without-lines": "the same",
    "partition-overlap": "nothing until somebody writes",
    "partition-label-twice": "the same",
    "partition-bounds": "the board boots from memory here",
    "partition-moved": "the same",
    "boot-writable": "nothing until somebody writes",
    "no-ecc": "these boards have no chip at the NAND's pins",
    "too-little-memory": "the tests give the kernel a command line of their own, and the node's size is true",
    "untyped-memory": "QEMU writes the node's type",
    "reserved-unread": "nobody uses the region",
    "partition-missing": "the board boots from memory here",
    "partitions-unread": "the board boots from memory here",
    "unknown-partition": "the tests give the kernel a command line of their own",
    "bad-block-table": "the flash of these boots is empty: there is nothing to destroy",
    "wrong-unit": "of I2C, SPI and supplies, for which our port has no drivers yet",
    "hog-without-direction": "the kernel says so in its log, and nobody hears the line",
    "pwm-without-pin": "our port has no driver of the PWM yet",
    "too-much-memory": "U-Boot writes the true size into the node, and the tests boot without it",
    "reserved-outside": "nobody uses the region",
    "wrong-console": "the tests give the kernel a command line of their own",
    "wrong-alias": "U-Boot's, which these boots are without",
    "bad-mac": "a random address serves as well",
    "schema": "what a binding says has the symptom of a rule above, or none here",
    "wrong-value": "the driver goes on with its default",
    "unknown-node": "the tests give the kernel a command line of their own, and QEMU its memory",
    "cut-command-line": "the tests give the kernel a command line of their own",
    "unknown-parameter": "the same",
    "wrong-root": "the same",
    "mtdparts-moved": "the same",
    "reserved-over-boot": "these boots are without U-Boot, which puts the kernel there",
    "wrong-boot-command": "U-Boot's, which these boots are without",
    "expander-line": "of I2C, for which our port has no drivers yet",
    "ecc-beyond-spare": "these boards have no chip at the NAND's pins",
    "wrong-initrd": "the board boots from memory here: QEMU writes where the RAM disk is",
}

# Whether what is written comes out, and what comes in is read: within its time, from one opening.
LINE = """#!/bin/sh
exec 3<>/dev/ttyS$1 || exit 1
stty raw -echo 115200 <&3
printf talk >&3
rm -f /tmp/open /tmp/heard /tmp/done
touch /tmp/open
timeout 1 head -c 4 <&3 >/tmp/heard
touch /tmp/done
"""
PORTS = (0, 1, 2, 3)

Boot = Callable[..., Linux]


@pytest.fixture(scope="module")
def kernel(kernel: Kernel) -> Kernel:
    return kernel.without_services()


@pytest.fixture
def boot_tree(
    boot: Boot, booted: list[Linux], kernel: Kernel, tmp_path: Path
) -> Iterator[Callable[..., Linux]]:
    """Boots a device tree; the board ends with the test."""

    def start(dtb: Path = kernel.dtb) -> Linux:
        linux = boot(kernel=replace(kernel, dtb=dtb), uarts=PORTS, files={"/line": LINE}, options="pace=off")
        linux.run("dmesg -n 1")  # the kernel's lines would come between the shell's
        return linux

    yield start
    for linux in booted:
        linux.close()


def wait_for(path: str) -> str:
    return f"until [ -e {path} ]; do sleep 0.01; done"


def line(linux: Linux, port: int) -> tuple[bool, bool]:
    """Whether a port talks and hears."""
    linux.run(
        f"rm -f /tmp/open /tmp/done; /line {port} < /dev/null > /dev/null 2>&1 &\n{wait_for('/tmp/open')}"
    )
    linux.machine.uarts[port].send(b"hear")
    heard = linux.run(f"{wait_for('/tmp/done')}; cat /tmp/heard")
    while linux.machine.uarts[port].receive(0.0):
        pass
    return b"talk" in linux.machine.uarts[port].seen, "hear" in heard


def there(linux: Linux, paths: tuple[str, ...]) -> tuple[bool, ...]:
    return tuple(linux.try_to(f"[ -e {path} ]")[0] == 0 for path in paths)


def kernel_log(linux: Linux) -> str:
    """What the kernel said, none of it trouble: a mistake is told as one, and breaks nothing."""
    log = linux.run("dmesg")
    assert TROUBLE.findall(log) == []
    return log


def shown(linux: Linux, symptom: Symptom) -> dict[str, object]:
    """What of a symptom a board shows."""
    log = kernel_log(linux)
    talks, hears = line(linux, symptom.port) if symptom.talks is not None else (None, None)
    return {
        "says": bool(re.search(symptom.says, log)) if symptom.says else None,
        "missing": tuple(not one for one in there(linux, symptom.missing)),
        "there": there(linux, symptom.there),
        "talks": talks,
        "hears": hears,
    }


def expected(symptom: Symptom) -> dict[str, object]:
    return {
        "says": True if symptom.says else None,
        "missing": (True,) * len(symptom.missing),
        "there": (True,) * len(symptom.there),
        "talks": symptom.talks,
        "hears": symptom.hears,
    }


@pytest.mark.parametrize("mistake", MISTAKES, ids=str)
def test_the_board_shows_what_the_checker_predicts(
    mistake: Mistake, boot_tree: Callable[..., Linux], tmp_path: Path
) -> None:
    dtb = gateway_dtb(tmp_path, mistake.more)
    found = check(read_dtb(dtb), CHIP, BOARD, BOARD.package)
    assert mistake.rule in {finding.rule for finding in found}
    assert shown(boot_tree(dtb), mistake.symptom) == expected(mistake.symptom)


def test_a_good_board_shows_none_of_it(boot_tree: Callable[..., Linux]) -> None:
    linux = boot_tree()
    log = kernel_log(linux)
    symptoms = [mistake.symptom for mistake in MISTAKES]
    assert [symptom.says for symptom in symptoms if symptom.says and re.search(symptom.says, log)] == []
    missing = tuple({path for symptom in symptoms for path in symptom.missing})
    assert dict(zip(missing, there(linux, missing), strict=True)) == dict.fromkeys(missing, True)
    strange = tuple({path for symptom in symptoms for path in symptom.there})
    assert dict(zip(strange, there(linux, strange), strict=True)) == dict.fromkeys(strange, False)
    assert {port: line(linux, port) for port in PORTS[1:]} == dict.fromkeys(PORTS[1:], (True, True))


def test_every_rule_has_a_case_or_a_reason() -> None:
    cases = {mistake.rule for mistake in MISTAKES}
    assert cases | WITHOUT_SYMPTOM.keys() == RULES.keys()
    assert cases & WITHOUT_SYMPTOM.keys() == set()
