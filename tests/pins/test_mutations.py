# SPDX-License-Identifier: GPL-3.0-or-later
"""
Each mistake that a device tree of the gateway can hold, made in the good one: found, by the right rule, and
by no other. No row is another row with another number only.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest
from mutation import Mutation, assert_found
from mutations_boot import BOOT, BOOT_MUTATIONS
from mutations_boot import RIGHT as RIGHT_BOOT
from mutations_devices import DEVICE_MUTATIONS
from mutations_pins import PIN_MUTATIONS
from mutations_properties import PROPERTY_MUTATIONS
from mutations_properties import RIGHT as RIGHT_PROPERTIES
from mutations_table import TABLE_MUTATIONS
from trees import CHIP, ROOT, TABLE, gateway, read

from nuc980.pins.board import Device, load_board
from nuc980.pins.rules import RULES, check
from nuc980.pins.source import read_source
from nuc980.pins.tree import Tree

BOARD = load_board(TABLE, CHIP)
DTS = ROOT / "dts" / "nuvoton" / "nuc980-gateway.dts"
CHIP_MUTATIONS = PIN_MUTATIONS + DEVICE_MUTATIONS + PROPERTY_MUTATIONS


@pytest.mark.sample(12)
@pytest.mark.parametrize("mutation", CHIP_MUTATIONS, ids=str)
def test_mistake_against_the_chip(mutation: Mutation, tmp_path: Path) -> None:
    tree = read(tmp_path, mutation.good + mutation.more, mutation.soc)
    assert_found(mutation, check(tree, CHIP, package=CHIP.packages["LQFP128"]))
    # The rules of the pin table may add theirs and take nothing away.
    with_table = {finding.rule for finding in check(tree, CHIP, BOARD, BOARD.package)}
    assert {mutation.rule, *mutation.also} <= with_table


@pytest.mark.sample(12)
@pytest.mark.parametrize("mutation", TABLE_MUTATIONS + BOOT_MUTATIONS, ids=str)
def test_mistake_against_the_pin_table(mutation: Mutation, tmp_path: Path) -> None:
    tree = read(tmp_path, mutation.good + mutation.more, mutation.soc)
    table = replace(BOARD, devices=BOARD.devices | more_pins(mutation.table))
    assert_found(mutation, check(tree, CHIP, table, BOARD.package, mutation.environment))


def more_pins(pins: Mapping[str, Mapping[str, str]]) -> dict[str, Device]:
    return {
        label: replace(BOARD.devices[label], pins=BOARD.devices[label].pins | more)
        for label, more in pins.items()
    }


def good_trees(folder: Path) -> list[Tree]:
    return [read(folder, gateway()), read_source(DTS)]


def test_good_trees_have_no_findings(tmp_path: Path) -> None:
    for tree in good_trees(tmp_path):
        assert check(tree, CHIP) == []
        assert check(tree, CHIP, BOARD, BOARD.package) == []


@pytest.mark.parametrize("more", RIGHT_PROPERTIES.values(), ids=RIGHT_PROPERTIES)
def test_what_only_looks_wrong_has_no_finding(more: str, tmp_path: Path) -> None:
    assert check(read(tmp_path, gateway(more)), CHIP) == []


@pytest.mark.sample(4)
@pytest.mark.parametrize("more", RIGHT_BOOT.values(), ids=RIGHT_BOOT)
def test_what_boots_has_no_finding(more: str, tmp_path: Path) -> None:
    assert check(read(tmp_path, gateway(BOOT + more)), CHIP, BOARD, BOARD.package) == []


@pytest.mark.slow
def test_every_rule_has_a_mistake_and_every_mistake_its_own_name() -> None:
    mutations = CHIP_MUTATIONS + TABLE_MUTATIONS + BOOT_MUTATIONS
    assert {mutation.rule for mutation in mutations} == {*RULES} - {
        "schema"
    }  # of the kernel: test_schemas.py
    assert [name for name, count in Counter(map(str, mutations)).items() if count > 1] == []
    assert len(mutations) >= 60
