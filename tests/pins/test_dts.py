# SPDX-License-Identifier: GPL-3.0-or-later
"""The board's device tree: generated, compiled and checked, with each setting of its switches."""

import itertools
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest
from trees import ROOT, TABLE

from nuc980.boards import board_names, pin_table
from nuc980.pins.board import load_board
from nuc980.pins.chip import load_chip
from nuc980.pins.claims import claims
from nuc980.pins.dtb import read_dtb
from nuc980.pins.generate import LINUX_FILE, ROUTING_FILE, SOC_FILE, generated, pins_file, stale, write
from nuc980.pins.rules import check
from nuc980.pins.source import read_source
from nuc980.pins.tree import Tree

CHIP = load_chip()
BOARD = load_board(TABLE, CHIP)
BOARDS = {name: load_board(pin_table(name), CHIP) for name in board_names()}
PINS_FILE = pins_file("gateway")
DTS = ROOT / "dts" / "nuvoton" / "nuc980-gateway.dts"
BUILD = ROOT / "scripts" / "build-dtb.sh"
PORTS = ("uart1", "uart2", "uart3", "uart4", "uart6", "uart8")
SETTINGS = list(itertools.product((0, 1), repeat=2))


def build(dtb: Path, *switches: str, source: Path = DTS) -> subprocess.CompletedProcess[str]:
    return subprocess.run([BUILD, source, dtb, *switches], capture_output=True, text=True, check=False)


@pytest.fixture(scope="module", params=SETTINGS, ids=lambda values: "pdma={} rtc={}".format(*values))
def setting(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[int, int, Tree]:
    """PDMA, RTC, and the compiled tree."""
    pdma, rtc = request.param
    dtb = tmp_path_factory.mktemp("dtb") / "gateway.dtb"
    done = build(dtb, f"GATEWAY_PDMA={pdma}", f"GATEWAY_RTC={rtc}")
    assert (done.returncode, done.stderr) == (0, "")
    return pdma, rtc, read_dtb(dtb)


# ---- generated -----------------------------------------------------------------------------------


def test_generated_files_are_fresh() -> None:
    assert stale(generated(CHIP, BOARDS), ROOT) == [], "run: make dtb"


def test_write_touches_only_what_changed(tmp_path: Path) -> None:
    files = generated(CHIP, {"gateway": BOARD})
    for path in files:
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
    assert write(files, tmp_path) == list(files) == [SOC_FILE, PINS_FILE, ROUTING_FILE, LINUX_FILE]
    assert write(files, tmp_path) == []
    (tmp_path / PINS_FILE).write_text("/* somebody's own */")
    assert stale(files, tmp_path) == [PINS_FILE]
    assert write(files, tmp_path) == [PINS_FILE]


def test_reserved_pins_reach_the_emulator_as_strings_of_c() -> None:
    board = replace(BOARD, reserved={"PG0": 'a "strap" of the boot\n' + "and more " * 20})
    lines = generated(CHIP, {"gateway": board})[ROUTING_FILE].splitlines()
    line = next(line for line in lines if "reserved" in line)
    assert line.startswith('            [6][0] = "reserved: a \\"strap\\" of the boot and more')
    assert line.endswith('more ...",')
    assert len(line) <= 80


def test_soc_file_has_every_device_off(tmp_path: Path) -> None:
    """With a driver: the vendor's crypto_raw has none, and is left out."""
    file = tmp_path / "soc.dts"
    file.write_text('/dts-v1/;\n/include/ "nuc980.dtsi"\n')
    tree = read_source(file, [ROOT / "dts" / "nuvoton"])
    labelled = {label: node for node in tree.root.walk() for label in node.labels}
    assert set(labelled) == {one.label for one in CHIP.peripherals.values() if one.has_driver}
    assert {label for label, node in labelled.items() if node.enabled} == {"aic", "pinctrl", "gpio"}
    assert claims(tree, CHIP) == []


# ---- compiled ------------------------------------------------------------------------------------


def test_no_finding(setting: tuple[int, int, Tree]) -> None:
    *_, tree = setting
    assert check(tree, CHIP, BOARD, BOARD.package) == []


def test_source_has_no_finding() -> None:
    assert check(read_source(DTS), CHIP, BOARD, BOARD.package) == []


def test_pins_are_those_of_the_table(setting: tuple[int, int, Tree]) -> None:
    *_, tree = setting
    muxed = {(claim.node.path, claim.signal, claim.pin) for claim in claims(tree, CHIP)}
    assert muxed == {
        (device.peripheral.path, signal, pin)
        for device in BOARD.devices.values()
        for signal, pin in device.pins.items()
    }


def test_what_is_on(setting: tuple[int, int, Tree]) -> None:
    """Figure 3.5's ports, both Ethernets, debug UART, NAND, watchdog, PDMA; everything else is off."""
    _, rtc, tree = setting
    by_path = {one.path: one.label for one in CHIP.peripherals.values()}
    on = {by_path[node.path] for node in tree.root.walk() if node.path in by_path and node.enabled}
    expected = {"aic", "pinctrl", "gpio", "uart0", *PORTS, "emac0", "emac1", "fmi", "wdt", "dma"}
    assert on == expected | ({"rtc"} if rtc else set())


def test_pdma_is_the_switchs(setting: tuple[int, int, Tree]) -> None:
    pdma, _, tree = setting
    nodes = [tree.find(CHIP.peripherals[label].path) for label in PORTS]
    assert [node.cells("pdma-enable") for node in nodes if node] == [[pdma]] * len(PORTS)


def test_partitions_cover_what_the_factory_reads(setting: tuple[int, int, Tree]) -> None:
    """nand read 0x200000 0x500000, nand read 0x700000 0x100000; in order, none past the end."""
    *_, tree = setting
    partitions = tree.find("/ahb/fmi@b0019000/partitions")
    assert partitions is not None
    areas = {node.strings("label")[0]: node.cells("reg") for node in partitions}
    assert (areas["kernel"], areas["device-tree"]) == ([0x200000, 0x500000], [0x700000, 0x100000])
    assert (areas["rootfs"][0], "read-only" in partitions.children[0].properties) == (0x1600000, True)
    ends = [0, *(offset + size for offset, size in areas.values())]
    assert all(offset >= end for (offset, _), end in zip(areas.values(), ends, strict=False))
    assert ends[-1] <= 0x8000000
    assert all(value % 0x20000 == 0 for area in areas.values() for value in area)  # whole blocks


@pytest.mark.parametrize("switch", ["GATEWAY_PMDA=1", "GATEWAY_RTC=yes", "GATEWAY_PDMA=2", "GATEWAY_PDMA"])
def test_wrong_switch_is_refused(tmp_path: Path, switch: str) -> None:
    done = build(tmp_path / "bad.dtb", switch)
    assert (done.returncode, done.stdout, list(tmp_path.iterdir())) == (2, "", [])
    assert f"{switch}: {DTS} has the switches GATEWAY_PDMA GATEWAY_RTC" in done.stderr


def test_each_warning_of_dtc_is_an_error(tmp_path: Path) -> None:
    source = tmp_path / "bad.dts"
    source.write_text("/dts-v1/;\n/ { node@1 { }; };\n")
    done = build(tmp_path / "bad.dtb", source=source)
    assert done.returncode == 1
    assert "unit_address_vs_reg" in done.stderr
    assert list(tmp_path.iterdir()) == [source]


@pytest.mark.slow
def test_failed_build_leaves_the_last_good_file(tmp_path: Path) -> None:
    source, dtb = tmp_path / "board.dts", tmp_path / "board.dtb"
    source.write_text("/dts-v1/;\n/ { };\n")
    assert build(dtb, source=source).returncode == 0
    good = dtb.read_bytes()
    for mistake in ("/ { broken", '#include "none.dtsi"', "#warning old"):
        source.write_text(f"/dts-v1/;\n{mistake}\n")
        assert build(dtb, source=source).returncode == 1
    assert dtb.read_bytes() == good


def test_a_board_may_be_called_anything() -> None:
    files = generated(CHIP, {"gateway": replace(BOARD, name="A*/ #error\nB")})
    head = files[PINS_FILE].splitlines()[2]
    assert head == " * Pin groups: A* / #error B (NUC980DK61YC)"
