# SPDX-License-Identifier: GPL-3.0-or-later
"""import: what a tree has comes back as a pin table that loads, and what does not fit is told in there."""

import random
from collections.abc import Mapping
from pathlib import Path

import pytest
from trees import CHIP, GATEWAY_PINS, TABLE, board, gateway, read

from nuc980.pins.board import Board, load_board
from nuc980.pins.chip import GPIO
from nuc980.pins.claims import claims
from nuc980.pins.importing import import_board

PART = "NUC980DK61YC"
UART1 = "/apb/serial@b0071000"
Pins = Mapping[str, str]  # signal, in full: pin
RXD = {"uart1": {"UART1_RXD": "PA0"}}


def imported(text: str, folder: Path, part: str = PART) -> tuple[str, Board]:
    """The imported table, which must load, as text and read."""
    table = import_board(read(folder, text), CHIP, part)
    file = folder / "pins.yml"
    file.write_text(table, encoding="utf-8")
    return table, load_board(file, CHIP)


def comments(table: str) -> list[str]:
    return [line.strip() for line in table.splitlines() if line.strip().startswith("# /")]


def pins_of(found: Board) -> dict[str, Pins]:
    return {label: device.pins for label, device in found.devices.items()}


def test_devices_and_head(tmp_path: Path) -> None:
    devices = {
        "uart1": {"UART1_RXD": "PA0", "UART1_TXD": "PF10"},
        "fmi": {"NAND_nCS0": "PC1", "NAND_ALE": "PC3"},
    }
    table, found = imported(board(devices), tmp_path)
    lines = table.splitlines()
    assert lines[0] == "# SPDX-License-Identifier: GPL-3.0-or-later"
    assert "board.dts" in lines[1]
    assert "    pins: {RXD: PA0, TXD: PF10}" in lines
    assert "    pins: {NAND_nCS0: PC1, NAND_ALE: PC3}" in lines
    assert (found.name, found.part, pins_of(found)) == ("board", PART, devices)
    assert not comments(table)


def random_devices(dice: random.Random) -> dict[str, Pins]:
    """Devices with some of their signals, no pin twice."""
    free = set(CHIP.packages[CHIP.parts[PART]].bonded)
    signals = [(signal, pin) for signal, where in CHIP.signals.items() for pin, _ in where]
    devices: dict[str, dict[str, str]] = {}
    for signal, pin in dice.sample(signals, 60):
        owner = next((owner.label for owner in CHIP.owners(signal)), "")
        if pin in free and owner and signal not in devices.get(owner, {}):
            free.remove(pin)
            devices.setdefault(owner, {})[signal] = pin
    return devices


@pytest.mark.slow
def test_random_assignments_come_back(tmp_path: Path) -> None:
    dice = random.Random(980)
    for _ in range(15):
        devices = random_devices(dice)
        table, found = imported(board(devices), tmp_path)
        assert pins_of(found) == devices
        assert not comments(table)


@pytest.mark.slow
def test_no_claim_of_random_cells_is_dropped(tmp_path: Path) -> None:
    dice = random.Random(980)
    for _ in range(15):
        text = board(RXD | {"can3": {"CAN3_TXD": "PA1"}})
        cells = " ".join(
            f"{dice.randrange(8)} {dice.randrange(17)} {dice.randrange(10)} 0" for _ in range(20)
        )
        text = text.replace("<0 0 4 0>", f"<0 0 4 0 {cells}>")
        text += f"&can3 {{ a-gpios = <&gpio {dice.randrange(256)} 0 &gpio {dice.randrange(256)} 0>; }};"
        tree = read(tmp_path, text)
        table, found = imported(text, tmp_path)
        placed = {pin: signal for pins in pins_of(found).values() for signal, pin in pins.items()}
        for claim in claims(tree, CHIP):
            has_line = claim.signal == GPIO and claim.pin in found.gpios
            told = f"{claim.pin} as {claim.signal or f'function {claim.value}'} ({claim.property}): " in table
            assert told or has_line or placed.get(claim.pin) == claim.signal


def test_devices_that_are_off_have_no_pins(tmp_path: Path) -> None:
    table, found = imported(board(RXD) + '&uart1 { status = "disabled"; };', tmp_path)
    assert not found.devices and "PA0" not in table


def test_lines_and_what_they_are_for(tmp_path: Path) -> None:
    more = """/ {
        leds { compatible = "gpio-leds"; one { label = "run"; gpios = <&gpio 33 0>; }; };
        phy { compatible = "x"; reset-gpios = <&gpio 34 1>; };
    };
    &gpio { sim { gpio-hog; gpios = <35 0>; output-high; line-name = "SIM power"; }; };
    """
    table, found = imported(board({}, more), tmp_path)
    assert found.gpios == {"PB1": "leds, run", "PB2": "phy, reset-gpios", "PB3": "gpio, SIM power"}
    assert not comments(table)


def test_line_that_a_group_prepares_is_its_user_s(tmp_path: Path) -> None:
    led = '/ { leds { compatible = "gpio-leds"; run { gpios = <&gpio 0 0>; }; }; };'
    devices = {"uart1": {"UART1_RXD": "PF9", GPIO: "PA0"}}
    table, found = imported(board(devices, led), tmp_path)
    assert found.gpios == {"PA0": "leds, run"} and not comments(table)
    key = '/ { keys { compatible = "gpio-keys"; stop { gpios = <&gpio 0 0>; }; }; };'
    table, _ = imported(board(devices, led + key), tmp_path)
    assert comments(table) == ["# /keys/stop: PA0 as GPIO (gpios): /leds/run has the pin as GPIO"]


def test_pin_that_only_a_group_makes_a_line(tmp_path: Path) -> None:
    _, found = imported(board({"uart1": {GPIO: "PA0"}}), tmp_path)
    assert found.gpios == {"PA0": f"group uart1-pins of {UART1}"}


def test_states_of_one_device_share_a_pin(tmp_path: Path) -> None:
    states = '&uart1 { pinctrl-names = "default", "sleep"; pinctrl-1 = <&pinctrl_uart1>; };'
    table, found = imported(board(RXD, states), tmp_path)
    assert pins_of(found) == RXD and not comments(table)


@pytest.mark.parametrize(
    ("cells", "told"),
    [
        ("9 0 1 0", "P9.0 as function 1 (pinctrl-0): the chip has no such pin"),
        ("0 1 9 0", "PA1 as function 9 (pinctrl-0): the pin has no such function"),
        ("0 9 2 0", "PA9 as UART2_RXD (pinctrl-0): not a signal of this node"),
        ("5 9 2 0", "PF9 as UART1_RXD (pinctrl-0): the signal is on PA0"),
        ("0 0 7 0", "PA0 as CAN3_RXD (pinctrl-0): not a signal of this node"),
        ("0 0 0 0", f"PA0 as GPIO (pinctrl-0): {UART1} has the pin as UART1_RXD"),
    ],
)
def test_pins_that_do_not_fit_are_told_at_their_device(cells: str, told: str, tmp_path: Path) -> None:
    table, found = imported(board(RXD).replace("<0 0 4 0>", f"<0 0 4 0 {cells}>"), tmp_path)
    assert comments(table) == [f"# {UART1}: {told}"]
    assert pins_of(found) == RXD
    lines = table.splitlines()
    assert lines.index("    pins: {RXD: PA0}") + 1 == lines.index(f"    # {UART1}: {told}")


def test_pin_of_two_devices_is_the_first_s(tmp_path: Path) -> None:
    table, found = imported(board(RXD | {"can3": {"CAN3_RXD": "PA0"}}), tmp_path)
    assert pins_of(found) == RXD
    assert comments(table) == [
        f"# /apb/can@b00a3000: PA0 as CAN3_RXD (pinctrl-0): {UART1} has the pin as UART1_RXD"
    ]


def test_pin_that_the_package_does_not_bring_out(tmp_path: Path) -> None:
    key = '/ { key { compatible = "x"; key-gpios = <&gpio 103 0>; }; };'
    table, found = imported(board({"uart2": {"UART2_RXD": "PD7"}}, key), tmp_path, "NUC980DR61YC")
    assert comments(table) == [
        "# /apb/serial@b0072000: PD7 as UART2_RXD (pinctrl-0): LQFP64 does not bring it out",
        "# /key: PD7 as GPIO (key-gpios): LQFP64 does not bring it out",
    ]
    assert not found.devices and not found.gpios


@pytest.mark.parametrize(
    ("good", "bad", "told"),
    [
        ("<0 0 4 0>", "<0 0 4>", "pinctrl@b0000000/uart1/uart1-pins does not have four cells for each pin"),
        ("<&pinctrl_uart1>", "<&gpio>", "pinctrl-0 refers to something that is not a pin group"),
        ("<&pinctrl_uart1>", "<&pinctrl_gone>", "pinctrl-0 refers to something that is not a pin group"),
        ("pinctrl-0", "cts-gpios = <0x777 1 0>; pinctrl-0", "cts-gpios: a cell that should refer to a GPIO"),
    ],
)
def test_what_cannot_be_read_is_told(good: str, bad: str, told: str, tmp_path: Path) -> None:
    table, _ = imported(board(RXD).replace(good, bad), tmp_path)
    assert len(comments(table)) == 1 and told in table


def test_strings_of_a_stranger(tmp_path: Path) -> None:
    label = r'"x\n  PB1: # \x1b[2J: [\xc3\xa9"'
    led = f'/ {{ leds {{ compatible = "gpio-leds"; a {{ label = {label}; gpios = <&gpio 0 0>; }}; }}; }};'
    table, found = imported(board({}, led + '/ { model = "123"; };'), tmp_path)
    assert found.name == "123"
    assert found.gpios == {"PA0": "leds, x?  PB1: # ?[2J: [é"}
    assert "\x1b" not in table


def test_long_lists_are_wrapped_between_pins(tmp_path: Path) -> None:
    emac = {"emac1": GATEWAY_PINS["emac1"]}
    table, found = imported(board(emac), tmp_path)
    assert pins_of(found) == emac
    assert max(map(len, table.splitlines())) <= 110
    assert not any(line.endswith(":") and "{" in line for line in table.splitlines())


def test_gateway_s_own_tree_gives_its_pin_table(tmp_path: Path) -> None:
    _, found = imported(gateway(), tmp_path)
    assert pins_of(found) == pins_of(load_board(TABLE, CHIP))


def test_an_interrupt_line_that_cannot_be_read_is_told(tmp_path: Path) -> None:
    touch = '/ { touch { compatible = "acme"; interrupt-parent = <&gpio>; interrupts = <6>; }; };'
    table, found = imported(board(RXD, touch), tmp_path)
    assert (pins_of(found), found.gpios) == (RXD, {})
    assert comments(table) == ["# /touch: interrupts of 1 cells, not a multiple of 2"]
