# SPDX-License-Identifier: GPL-3.0-or-later
"""Functions to pins from wishes: a plan that the chip can have, or wishes that fight, and why."""

from __future__ import annotations

import random
import re
from itertools import combinations
from pathlib import Path

import pytest
from program import DONE, UNUSABLE, run
from trees import CHIP, ROOT, TABLE

from nuc980.errors import UnusableInput
from nuc980.pins.board import load_board
from nuc980.pins.planning import KINDS, Plan, Wish, plan_board, read_wishes

PART = "NUC980DK61YC"


def assert_can_be(plan: Plan, folder: Path) -> None:
    """The table is one that load_board takes: every signal where it can be, no pin twice, all brought out."""
    table = folder / "plan.yml"
    table.write_text(plan.table(folder))
    board = load_board(table, CHIP)
    assert {label: device.pins for label, device in board.devices.items()} == plan.devices
    assert board.gpios == plan.gpios


def test_six_uarts_with_rts_two_rmii_one_can(tmp_path: Path) -> None:
    plan = plan_board(CHIP, PART, read_wishes(["six UARTs with RTS, two RMII, one CAN"]))
    assert_can_be(plan, tmp_path)
    kinds = [label.rstrip("0123456789") for label in plan.devices]
    assert (kinds.count("uart"), kinds.count("emac"), kinds.count("can")) == (6, 2, 1)
    for label, pins in plan.devices.items():
        needed = CHIP.peripherals[label].signals
        prefix, signals = next(
            (one, {*rules.required}) for one, rules in needed.items() if f"{one}" in min(pins)
        )
        assert {prefix + name for name in signals | ({"RTS"} if "uart" in label else set())} == pins.keys()


@pytest.mark.parametrize("seed", range(12))
def test_any_wishes_have_a_plan_or_a_core_that_is_the_least(seed: int, tmp_path: Path) -> None:
    choose = random.Random(seed)
    kinds = [
        "uart",
        "uart with RTS",
        "rmii",
        "can",
        "i2c",
        "spi",
        "sd",
        "nand",
        "camera",
        "ebi",
        "gpio",
        "sdh",
        "i2s",
    ]
    wishes = read_wishes(choose.choices(kinds, k=choose.randint(1, 9)))
    try:
        assert_can_be(plan_board(CHIP, PART, wishes), tmp_path)
    except UnusableInput as error:
        core = read_wishes(
            [re.sub(" and (?=[0-9a-z]+( |$))", ", ", str(error).partition(" cannot be had")[0])]
        )
        assert set(core) <= set(wishes)
        with pytest.raises(UnusableInput, match="cannot be had"):
            plan_board(CHIP, PART, core)
        for fewer in combinations(core, len(core) - 1):
            if fewer:
                plan_board(CHIP, PART, fewer)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("wishes", "why"),
    [
        ("two rmii, sdh, 3 uart", "sdh and 2 rmii cannot be had together: PF0 is all that"),
        ("5 can, uart", "5 can cannot be had together: only can0, can1, can2 and can3 could serve"),
        (
            "uart0 with RTS",
            "uart0 with RTS cannot be had: no free pin of the LQFP128 can be UART0_RTS (uart0)",
        ),
        ("uart1 on PA0 PA1, gpio on PA0", "PA0 is all that"),
        ("nand, sd on PC5", "sd on PC5 cannot be had: no free pin"),
        ("urat", "urat: no such kind or device; did you mean uart"),
        ("uart on PH1", "the chip has no pin PH1"),
        ("many uart", "many is no number; write it with digits"),
        ("uart!", "'uart!' is no wish; write [NUMBER] KIND"),
        ("500 gpio", "500 wishes"),
        ("uart with RTS, CTS", "'CTS' is no wish: a comma ends one; write: with RTS and CTS"),
        ("uart on PF11, PF12", "'PF12' is no wish: a comma ends one"),
        ("2 rmii, sdh, 11 uart", "sdh and 2 rmii cannot be had together"),
        ("gpio with RTS", "gpio with RTS: a gpio has no signals; write gpio on PIN"),
        ("103 gpio", "cannot be had together: the LQFP128 has 92 free pins"),
        ("3 smartcard", "3 smartcard cannot be had together: sc0, sc1"),
        (" , ", "no wish; write such as"),
    ],
)
def test_what_cannot_be_is_told_with_why(wishes: str, why: str) -> None:
    done = run("plan", wishes)
    assert (done.returncode, done.stdout) == (UNUSABLE, "")
    assert why in done.stderr


def test_a_package_without_the_pins() -> None:
    """LQFP64 does not bring out the NAND's pins."""
    assert "cannot be had" in run("plan", "--part", "NUC980DR61YC", "nand, two rmii").stderr


def test_what_a_table_has_stays(tmp_path: Path) -> None:
    kept = load_board(TABLE, CHIP)
    plan = plan_board(CHIP, PART, read_wishes(["can", "2 gpio", "i2c"]), kept)
    assert_can_be(plan, tmp_path)
    assert {label: plan.devices[label] for label in kept.devices} == {
        label: device.pins for label, device in kept.devices.items()
    }
    assert not {*kept.reserved} & {*plan.gpios}
    with pytest.raises(UnusableInput, match="what could serve is in use"):
        plan_board(CHIP, PART, read_wishes(["nand"]), kept)


def test_a_table_made_of_another_keeps_its_keys(tmp_path: Path) -> None:
    folder = tmp_path / "other"
    folder.mkdir()
    kept = tmp_path / "kept.yml"
    (tmp_path / "limits.toml").write_text(load_board(TABLE, CHIP).limits.file.read_text())
    table = re.sub("(?m)^(not_connected|accepted):.*\n", "", TABLE.read_text()).replace(
        "image-limits", "limits"
    )
    own = "\nnot_connected: [PG5, PG6, PG7]\naccepted: [{rule: no-pins, node: /a, reason: it's so}]\n"
    kept.write_text(table + own)
    assert run("plan", "can", "--keep", kept, "-o", folder / "new.yml").returncode == DONE
    before, after = (load_board(file, CHIP) for file in (kept, folder / "new.yml"))
    for key in ("console", "ethernet", "flash", "not_connected", "reserved", "accepted", "name", "part"):
        assert getattr(after, key) == getattr(before, key), key
    assert before.limits and after.limits and after.limits.file.samefile(before.limits.file)
    assert "--part goes without --keep" in run("plan", "can", "--keep", kept, "--part", PART).stderr


def test_a_file_of_wishes_in_another_coding(tmp_path: Path) -> None:
    wishes = tmp_path / "wishes"
    wishes.write_bytes(b"can # caf\xe9\n")
    done = run("plan", "--wishes", wishes)
    assert (done.returncode, f"{wishes} is no text in UTF-8 (byte 9); save" in done.stderr) == (
        UNUSABLE,
        True,
    )
    wishes.write_bytes("\ufeffcan\n".encode())
    assert run("plan", "--wishes", wishes).returncode == DONE


def test_nothing_is_written_if_the_table_exists(tmp_path: Path) -> None:
    table, page = tmp_path / "pins.yml", tmp_path / "pins.html"
    table.write_text("mine")
    page.write_text("mine")
    assert run("plan", "can", "-o", table, "--map", page).returncode == UNUSABLE
    assert (table.read_text(), page.read_text()) == ("mine", "mine")
    done = run("plan", "can", "--map", tmp_path / "none" / "x.svg")
    assert (done.returncode, done.stderr.rstrip().endswith("; name another file")) == (UNUSABLE, True)


def test_files(tmp_path: Path) -> None:
    wishes = tmp_path / "wishes"
    wishes.write_text("uart0 on PF11 PF12 # the console\n# a comment\n2 rmii\n")
    table, page = tmp_path / "pins.yml", tmp_path / "pins.svg"
    done = run("plan", "--wishes", wishes, "-o", table, "--map", page)
    assert (done.returncode, done.stderr) == (DONE, "")
    assert done.stdout.splitlines()[-1] == "uart0: UART0_RXD PF11, UART0_TXD PF12"
    assert load_board(table, CHIP).devices["uart0"].pins == {"UART0_RXD": "PF11", "UART0_TXD": "PF12"}
    assert "UART0_TXD" in page.read_text()
    assert "not overwritten" in run("plan", "can", "-o", table).stderr
    assert "must end in .svg or .html" in run("plan", "can", "--map", tmp_path / "x.pdf").stderr
    assert "No such file" in run("plan", "--wishes", tmp_path / "none").stderr


def test_each_kind_can_be_had() -> None:
    for kind in KINDS:
        assert plan_board(CHIP, "NUC980DF61YC", [Wish(kind, kind)]).devices, kind


def test_documentation_shows_what_is_said() -> None:
    page = (ROOT / "docs/device-tree.md").read_text()
    [(wishes, said)] = re.findall(r"\$ scripts/nuc980-pins plan '([^']*)'\n(nuc980-pins: .*)", page)
    assert run("plan", wishes).stderr.strip() == said
