# SPDX-License-Identifier: GPL-3.0-or-later
"""Reading a pin table: the board's own, and every mistake one can make in one."""

from pathlib import Path

import pytest

from nuc980.errors import UnusableInput
from nuc980.pins.board import load_board
from nuc980.pins.chip import load_chip
from nuc980.pins.limits import Area

CHIP = load_chip()
TABLE = Path(__file__).resolve().parents[2] / "board/nuc980/boards/gateway/pins.yml"


def test_the_boards_table_is_table_2_1() -> None:
    board = load_board(TABLE, CHIP)
    found = {
        label: (device.pins[f"{label.upper()}_RXD"], device.pins[f"{label.upper()}_TXD"])
        for label, device in board.devices.items()
        if "RS-485" in device.purpose
    }
    assert found == {
        "uart1": ("PA0", "PF10"),
        "uart2": ("PA9", "PA10"),
        "uart3": ("PD3", "PD2"),
        "uart4": ("PD13", "PD12"),
        "uart6": ("PA4", "PA5"),
        "uart8": ("PA11", "PA12"),
    }
    assert all(len(device.pins) == 2 for label, device in board.devices.items() if label.startswith("uart"))


def table(tmp_path: Path, text: str) -> Path:
    file = tmp_path / "pins.yml"
    file.write_text(text)
    return file


def test_who_has_a_pin(tmp_path: Path) -> None:
    text = "part: NUC980DK61YC\ndevices: {uart1: {pins: {RXD: PA0, TXD: PF10}}}\ngpios: {PE11: LED}\n"
    board = load_board(table(tmp_path, text), CHIP)
    assert board.use_of("PF10") == ("uart1", "UART1_TXD")
    assert board.use_of("PE11") == ("gpios", "GPIO")
    assert board.use_of("PA1") is None
    assert (board.name, board.package.name) == ("pins", "LQFP128")


PART = "part: NUC980DK61YC\n"


@pytest.mark.parametrize(
    ("text", "mistakes"),
    [
        ("", ["part is missing"]),
        ("[]", ["must be a mapping, not []"]),
        (
            PART + "devices: {uart1: {pins: {RXD: PA0, UART1_RXD: PF9}}}",
            ["uart1: UART1_RXD is on two pins, PA0 and PF9"],
        ),
        ("part: NUC970", ["part NUC970; known parts are NUC980DR61YC"]),
        ("part: [x]", ["part ['x']; known parts are"]),
        (PART + "port: {}", ["port: no such key; known keys are accepted, board"]),
        (PART + "devices: [uart1]", ["devices: must be a mapping, not ['uart1']"]),
        (PART + "devices: {uart11: {}}", ["uart11: the chip has no such device; did you mean uart1"]),
        (PART + "devices: {uart1: {rx: PA0}}", ["uart1: rx: no such key; known keys are for and pins"]),
        (
            PART + "devices: {uart1: {pins: {RX: PA0}}}",
            ["uart1: RX is not one of its signals; they begin with UART1_"],
        ),
        (PART + "devices: {uart1: {pins: {UART2_RXD: PA9}}}", ["uart1: UART2_RXD is not one of its signals"]),
        (
            PART + "devices: {uart1: {pins: {RXD: PA1}}}",
            ["PA1 cannot be UART1_RXD; that is on PA0, PC6, PF9"],
        ),
        (PART + "devices: {uart1: {pins: {RXD: PH1}}}", ["uart1: RXD: PH1: the chip has no such pin"]),
        (PART + "devices: {uart1: {pins: {RXD: [PA0]}}}", ["['PA0']: the chip has no such pin"]),
        (PART + "devices: {uart1: {pins: {RXD: PB14}}}", ["PB14: the chip has no such pin; did you mean"]),
        (PART + "devices: {fmi: {pins: {DATA0: PC8}}}", ["fmi: DATA0 is not one of its signals"]),
        (PART + "devices: {uart7: {pins: {RXD: PA14}}}", ["PA14 is not brought out by the package LQFP128"]),
        (
            PART + "devices: {uart1: {pins: {RXD: PA0}}, can3: {pins: {RXD: PA0}}}",
            ["PA0 is used twice: uart1 UART1_RXD and can3 CAN3_RXD"],
        ),
        (
            PART + "devices: {uart1: {pins: {RXD: PA0}}}\ngpios: {PA0: LED}\nnot_connected: [PA0]",
            ["PA0 is used twice: uart1 UART1_RXD and gpios", "and not_connected"],
        ),
        (PART + "limits: [x]", ["limits: must be the name of a file beside the table"]),
        (
            PART + "devices: {uart1: {}}\nconsole: uart2",
            ["console: uart2 is not under devices; did you mean uart1?"],
        ),
        (PART + "console: [uart1]", ["console: ['uart1'] is not under devices"]),
        (PART + "flash: fmi", ["flash: fmi is not under devices"]),
        (PART + "ethernet: emac0", ["ethernet: must be a list of devices"]),
        (PART + "devices: {emac0: {}}\nethernet: [emac0, emac1]", ["ethernet: emac1 is not under devices"]),
        (PART + "gpios: {PB15: LED}", ["gpios: PB15: the chip has no such pin"]),
        (PART + "not_connected: PA1", ["not_connected: must be a list of pins"]),
        (PART + "accepted: {}", ["accepted: must be a list of {rule, node, reason}"]),
        (PART + "accepted: [{rule: pin-conflict, node: /x}]", ["needs rule, node and reason"]),
        (PART + "accepted: [{rule: pin-conflict, node: /x, reason: ' '}]", ["none of them empty"]),
        ("a: b: c", ["not YAML: mapping values are not allowed"]),
        ("[" * 5000, ["not YAML"]),
        ("? [a, b]\n: c", ["not YAML"]),
    ],
)
def test_mistakes_are_told(tmp_path: Path, text: str, mistakes: list[str]) -> None:
    file = table(tmp_path, text)
    with pytest.raises(UnusableInput) as raised:
        load_board(file, CHIP)
    assert str(raised.value).startswith(str(file))
    assert [mistake for mistake in mistakes if mistake not in str(raised.value)] == []


def test_all_mistakes_at_once(tmp_path: Path) -> None:
    text = PART + "devices: {uart1: {pins: {RX: PA0}}, uart11: {}}\ngpios: {PH1: LED}\n"
    with pytest.raises(UnusableInput) as raised:
        load_board(table(tmp_path, text), CHIP)
    assert len(str(raised.value).splitlines()) == 1 + 3


def test_missing_and_unreadable_files(tmp_path: Path) -> None:
    with pytest.raises(UnusableInput, match="No such file or directory; name another pin table"):
        load_board(tmp_path / "none.yml", CHIP)
    with pytest.raises(UnusableInput, match="Is a directory"):
        load_board(tmp_path, CHIP)
    (tmp_path / "binary.yml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(UnusableInput, match="not YAML"):
        load_board(tmp_path / "binary.yml", CHIP)


@pytest.mark.parametrize(
    "text",
    [
        "devices: {uart1: {pins: {RXD: PA0, TXD: PF10}}, uart1: {}}",
        "gpios: {PE11: LED, PE11: buzzer}",
        "devices: {uart1: {pins: {RXD: PA0, RXD: PF9}}}",
    ],
)
def test_what_is_there_twice_is_told_and_not_lost(tmp_path: Path, text: str) -> None:
    with pytest.raises(UnusableInput, match=r"(uart1|PE11|RXD) appears twice(.|\n)* line 2"):
        load_board(table(tmp_path, PART + text), CHIP)


LIMITS = """
[memory]
size = 0x4000000
[flash]
size = 0x8000000
block = 0x20000
[flash.boot]
label = "u-boot"
offset = 0
size = 0x200000
"""


def test_memory_and_flash_are_those_of_the_image(tmp_path: Path) -> None:
    limits = load_board(TABLE, CHIP).limits
    assert (limits.memory, limits.flash, limits.block) == (64 << 20, 128 << 20, 128 << 10)
    assert limits.kernel == Area("kernel", 0x200000, 0x500000)
    (tmp_path / "limits.toml").write_text(LIMITS)
    limits = load_board(table(tmp_path, PART + "limits: limits.toml"), CHIP).limits
    assert (limits.boot, limits.kernel, limits.root) == (Area("u-boot", 0, 0x200000), None, None)


@pytest.mark.parametrize(
    ("before", "after", "says"),
    [
        ("size = 0x4000000", "", "KeyError('size')"),
        ("size = 0x4000000", "size = '64M'", "no size in bytes: '64M'"),
        ("block = 0x20000", "block = 0", "no size in bytes: 0"),
        ('label = "u-boot"', "label = 1", "no label and offset"),
        ("offset = 0", "offset = -1", "no label and offset"),
        ("[memory]", "memory = 1", "TypeError"),
        ("[memory]", "[memory", "TOMLDecodeError"),
    ],
)
def test_mistakes_in_the_limits_are_told(tmp_path: Path, before: str, after: str, says: str) -> None:
    (tmp_path / "limits.toml").write_text(LIMITS.replace(before, after, 1))
    with pytest.raises(UnusableInput, match=r"as board/nuc980/boards/gateway/image-limits\.toml") as raised:
        load_board(table(tmp_path, PART + "limits: limits.toml"), CHIP)
    assert says in str(raised.value)


def test_limits_that_are_not_there(tmp_path: Path) -> None:
    with pytest.raises(UnusableInput, match=r"none\.toml: No such file.*the pin table names it under limits"):
        load_board(table(tmp_path, PART + "limits: none.toml"), CHIP)
