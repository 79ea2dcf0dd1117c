# SPDX-License-Identifier: GPL-3.0-or-later
"""Pin control under Linux: the registers are as the device tree says, and what cannot be is refused."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from gateway_trees import gateway_dtb

from nuc980.pins.chip import load_chip, pin_order
from nuc980.pins.claims import Claim, claims
from nuc980.pins.dtb import read_dtb
from nuc980.twin.linux import Kernel, Linux
from nuc980.twin.nand import NandImage

CHIP = load_chip()
PINCTRL = "/sys/kernel/debug/pinctrl/b0000000.pinctrl-nuc980-pinctrl"
DEBUGFS = "[ -e /sys/kernel/debug/pinctrl ] || mount -t debugfs none /sys/kernel/debug"
# The sixth port on the pins of the first Ethernet port's PHY.
UART6_ON_EMAC0 = "&uart6_pins { nuvoton,pins = <4 8 5 0>, <4 9 5 0>; };"

Boot = Callable[..., Linux]
BootTree = Callable[[str], Linux]


@pytest.fixture(scope="module")
def board_arguments(tmp_path_factory: pytest.TempPathFactory) -> tuple[str | Path, ...]:
    """With its flash: a device that does not probe gives its pins back."""
    nand = NandImage.blank(tmp_path_factory.mktemp("nand") / "nand")
    return "-drive", f"if=mtd,format=raw,file={nand.path}"


@pytest.fixture
def boot_tree(boot: Boot, kernel: Kernel, tmp_path: Path) -> BootTree:
    """Boots the gateway's device tree with more behind it; the kernel keeps its lines for dmesg."""

    def start(more: str) -> Linux:
        linux = boot(kernel=replace(kernel, dtb=gateway_dtb(tmp_path, more)))
        linux.run("dmesg -n 1")
        return linux

    return start


def muxed(dtb: Path) -> dict[str, Claim]:
    """The pins that enabled devices of a tree take, and as what."""
    return {claim.pin: claim for claim in claims(read_dtb(dtb), CHIP) if claim.muxed}


def fields(linux: Linux) -> dict[str, int]:
    """The multi-function field of each pin, over the bus."""
    values = {}
    for pin in CHIP.pins:
        address, shift = CHIP.register_of(pin)
        values[pin] = linux.machine.read(address) >> shift & 0xF
    return values


def test_the_registers_are_as_the_tree_says(linux: Linux, kernel: Kernel) -> None:
    wanted = muxed(kernel.dtb)
    assert len(wanted) >= 40
    assert fields(linux) == {
        pin: CHIP.value(pin, wanted[pin].signal) if pin in wanted else 0 for pin in CHIP.pins
    }


def test_the_board_sees_the_same(linux: Linux, kernel: Kernel) -> None:
    view = linux.machine.command("qom-get", path="/machine/soc/pins", property="view")
    functions = {pin["pin"]: pin["function"] for pin in view["pins"]}
    assert {pin: functions[pin] for pin in muxed(kernel.dtb)} == {
        pin: claim.signal for pin, claim in muxed(kernel.dtb).items()
    }
    assert [pin for pin in view["pins"] if "conflict" in pin] == []


def test_debugfs_says_who_has_a_pin_and_as_what(linux: Linux, kernel: Kernel) -> None:
    linux.run(DEBUGFS)
    signals = re.findall(
        r"^pin (\d+) \((P\w+)\) \S+ (\S+) \((\d+)\)$", linux.run(f"cat {PINCTRL}/pins"), re.M
    )
    wanted = muxed(kernel.dtb)
    assert {pin: (signal, int(value)) for _, pin, signal, value in signals} == {
        pin: (wanted[pin].signal, CHIP.value(pin, wanted[pin].signal)) if pin in wanted else ("GPIO", 0)
        for pin in CHIP.pins
    }
    for number, pin, _, _ in signals:
        bank, index = pin_order(pin)
        assert int(number) == 16 * bank + index
    owners = re.findall(
        r"^pin \d+ \((P\w+)\): device (\w+)\.\w+ function (\w+) group (\S+)$",
        linux.run(f"cat {PINCTRL}/pinmux-pins"),
        re.M,
    )
    assert {pin: (int(address, 16), function) for pin, address, function, _ in owners} == {
        pin: (CHIP.peripherals[function].address, function)
        for pin, claim in wanted.items()
        for function in [claim.group.parent.name]
    }


def test_two_devices_that_want_one_pin(boot_tree: BootTree) -> None:
    linux = boot_tree(UART6_ON_EMAC0)
    output = linux.run("dmesg")
    found = re.search(r"pin PE8 already requested by (\S+); cannot claim for (\S+)\n", output)
    assert found
    assert set(found.groups()) == {"b0076000.serial", "b0012000.emac0"}
    refused = found[2]
    bound = linux.run("ls -d /sys/bus/platform/devices/*/driver")
    assert f"/{refused}/" not in bound
    assert f"/{found[1]}/" in bound
    # Not one of the other pins is left with the one that was refused.
    value = CHIP.value("PE8", "UART6_RXD" if found[1].endswith("serial") else "RMII0_MDIO")
    assert fields(linux)["PE8"] == value
    linux.run(DEBUGFS)
    assert refused not in linux.run(f"cat {PINCTRL}/pinmux-pins")


def test_a_function_that_the_pin_does_not_have(boot_tree: BootTree) -> None:
    linux = boot_tree("&uart1_pins { nuvoton,pins = <0 0 4 0>, <5 10 1 0>; };")
    assert "nuc980-pinctrl b0000000.pinctrl: uart1.uart1-pins: PF10 has no function 1\n" in linux.run("dmesg")
    assert linux.try_to("ls /dev/ttyS1")[0] != 0
    assert fields(linux)["PA0"] == 0, "half a group was written"


def test_a_function_wider_than_its_field(boot_tree: BootTree) -> None:
    linux = boot_tree("&uart1_pins { nuvoton,pins = <0 0 20 0>, <5 10 2 0>; };")
    assert "uart1.uart1-pins: PA0 has no function 20\n" in linux.run("dmesg")
    assert fields(linux)["PA1"] == 0, "the neighbour got what was too much"


def test_a_pin_that_the_chip_does_not_have(boot_tree: BootTree) -> None:
    linux = boot_tree("&uart2_pins { nuvoton,pins = <0 9 2 0>, <0xfffffff1 9 2 0>; };")
    assert "uart2-pins: there is no pin <4294967281 9>\n" in linux.run("dmesg")
    assert linux.run("ls /dev/ttyS[0-9]").split() == [f"/dev/ttyS{n}" for n in (0, 1, 3, 4, 6, 8)]


def test_two_groups_of_one_name_are_two(boot_tree: BootTree) -> None:
    """The vendor's driver takes the first of that name, whoever asks."""
    linux = boot_tree(
        "&pinctrl { early { uart1-pins { nuvoton,pins = <6 6 2 0>, <6 7 2 0>; }; }; };\n"
        "&uart1_pins { nuvoton,pins = <0 0 4 0>, <5 10 2 0>; };"
    )
    assert [fields(linux)[pin] for pin in ("PA0", "PF10", "PG6", "PG7")] == [4, 2, 0, 0]


def test_a_gpio_of_a_device_on_a_pin_of_another(boot_tree: BootTree) -> None:
    linux = boot_tree('/ { leds { compatible = "gpio-leds"; led-0 { gpios = <&gpio 9 0>; }; }; };')
    output = linux.run("dmesg")
    assert re.search(
        r"pin PA9 already requested by (b0072000\.serial; cannot claim for b0004000\.gpio:\d+"
        r"|b0004000\.gpio:\d+; cannot claim for b0072000\.serial)\n",
        output,
    )
