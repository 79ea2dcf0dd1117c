# SPDX-License-Identifier: GPL-3.0-or-later
"""diff: the pins that change hands, and nothing else."""

from pathlib import Path

import pytest
from trees import CHIP, board, gateway, read

from nuc980.pins.diffing import PinChange, format_diff, pin_diff

UART1 = {"uart1": {"UART1_RXD": "PA0", "UART1_TXD": "PF10"}}
CAN3 = {"can3": {"CAN3_RXD": "PA0", "CAN3_TXD": "PA1"}}


def changes(folder: Path, before: str, after: str) -> list[PinChange]:
    return pin_diff(read(folder, before), read(folder, after), CHIP)


def test_a_tree_and_itself(tmp_path: Path) -> None:
    assert changes(tmp_path, gateway(), gateway('/ { model = "other"; };')) == []
    assert format_diff([]) == []


def test_pins_that_change_hands(tmp_path: Path) -> None:
    assert changes(tmp_path, board(UART1), board(CAN3)) == [
        PinChange("PA0", ("uart1 UART1_RXD",), ("can3 CAN3_RXD",)),
        PinChange("PA1", (), ("can3 CAN3_TXD",)),
        PinChange("PF10", ("uart1 UART1_TXD",), ()),
    ]


def test_other_function_for_the_same_device(tmp_path: Path) -> None:
    before, after = {"uart1": {"UART1_RXD": "PF9"}}, {"uart1": {"UART1_RXD": "PC6"}}
    assert [change.pin for change in changes(tmp_path, board(before), board(after))] == ["PC6", "PF9"]


@pytest.mark.slow
@pytest.mark.parametrize(
    "off",
    ['&emac1 { status = "disabled"; };', "/delete-node/ &emac1;", "&emac1 { /delete-property/ pinctrl-0; };"],
)
def test_device_that_goes_off(off: str, tmp_path: Path) -> None:
    found = changes(tmp_path, gateway(), gateway(off))
    assert [change.pin for change in found] == [f"PF{number}" for number in range(10)]
    assert found[3] == PinChange("PF3", ("emac1 RMII1_RXD0",), ())
    assert changes(tmp_path, gateway(off), gateway())[3] == PinChange("PF3", (), ("emac1 RMII1_RXD0",))


def test_conflict_names_both(tmp_path: Path) -> None:
    found = changes(tmp_path, board(UART1), board(UART1 | CAN3))
    assert found[0] == PinChange("PA0", ("uart1 UART1_RXD",), ("can3 CAN3_RXD", "uart1 UART1_RXD"))


@pytest.mark.slow
def test_lines_and_their_properties(tmp_path: Path) -> None:
    phy = '/ {{ phy {{ compatible = "x"; {}-gpios = <&gpio {} 1>; }}; }};'
    found = changes(tmp_path, gateway(phy.format("reset", 34)), gateway(phy.format("power", 34)))
    assert found == [PinChange("PB2", ("/phy GPIO (reset-gpios)",), ("/phy GPIO (power-gpios)",))]
    assert changes(tmp_path, gateway(), gateway(phy.format("reset", 255)))[0].pin == "P7.31"


def test_labels_are_no_change(tmp_path: Path) -> None:
    led = '/ {{ leds {{ compatible = "gpio-leds"; {}run {{ gpios = <&gpio 34 0>; }}; }}; }};'
    assert changes(tmp_path, gateway(led.format("")), gateway(led.format("lamp: "))) == []


def test_lines_of_text() -> None:
    found = [
        PinChange("PA0", ("uart1 UART1_RXD",), ("can3 CAN3_RXD",)),
        PinChange("PF10", (), ("a B", "c D")),
    ]
    assert format_diff(found) == [
        "PA0   uart1 UART1_RXD  ->  can3 CAN3_RXD",
        "PF10  -                ->  a B, c D",
    ]
