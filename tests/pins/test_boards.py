# SPDX-License-Identifier: GPL-3.0-or-later
"""Each board of the tree: its table, its device tree, and how a user names it."""

import subprocess
from pathlib import Path

import pytest
from trees import ROOT

from nuc980.boards import GATEWAY, board_names, pin_table
from nuc980.pins.cli import main

OTHERS = [name for name in board_names() if name != GATEWAY]


def source_of(board: str) -> Path:
    return ROOT / f"dts/nuvoton/nuc980-{board}.dts"


def test_there_is_a_second_board() -> None:
    assert board_names() == ["gateway", *sorted(OTHERS)]
    assert OTHERS


@pytest.mark.parametrize("board", board_names())
def test_source_and_compiled_tree_have_no_findings(
    board: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    dtb = tmp_path / "board.dtb"
    subprocess.run([ROOT / "scripts/build-dtb.sh", source_of(board), dtb], check=True, capture_output=True)
    assert main(["check", "--board", board, str(source_of(board)), str(dtb)]) == 0
    assert capsys.readouterr().out.count("no findings") == 2


@pytest.mark.slow  # `make dtb` validates the board's tree itself
@pytest.mark.parametrize("board", board_names())
def test_compiled_tree_fits_the_bindings(board: str, tmp_path: Path) -> None:
    dtb = tmp_path / "board.dtb"
    subprocess.run([ROOT / "scripts/build-dtb.sh", source_of(board), dtb], check=True, capture_output=True)
    subprocess.run([ROOT / "scripts/validate-dtb.sh", dtb], check=True, capture_output=True)


@pytest.mark.parametrize("board", OTHERS)
def test_a_tree_is_held_against_the_table_of_the_board_that_is_named(
    board: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", str(source_of(board))]) == 1
    assert "table-missing: uart1 (RS-485, /dev/ttyS1) is in the pin table and is disabled" in (
        capsys.readouterr().out
    )


def test_explain_and_map_know_the_board(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explain", "--board", "numaker", "PA0"]) == 0
    assert "I2C0_SDA of i2c0" in capsys.readouterr().out
    picture = tmp_path / "pins.svg"
    assert main(["map", "--board", "numaker", "-o", str(picture)]) == 0
    assert "NuMaker NUC980 DEV" in picture.read_text()


def test_an_unknown_board_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "--board", "../gateway", "x.dts"]) == 2
    assert "there is no board ../gateway; boards are gateway, numaker" in capsys.readouterr().err


def test_a_table_of_ones_own_comes_before_the_board(capsys: pytest.CaptureFixture[str]) -> None:
    table = str(pin_table("numaker"))
    assert main(["check", "--table", table, str(source_of("numaker"))]) == 0
    assert "no findings" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (("dtb", "BOARD=nope"), "BOARD=nope: there is no such board; boards are gateway numaker"),
        (("image-debian", "BOARD=nope"), "BOARD=nope: there is no such board; boards are gateway numaker"),
        (("run", "BOARD=numaker"), "make run knows the gateway board only"),
    ],
)
def test_make_refuses_before_it_builds(words: tuple[str, ...], reason: str) -> None:
    done = subprocess.run(["make", "-n", *words], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert reason in done.stderr


def test_image_of_another_board_has_its_tree_and_a_folder_of_its_own() -> None:
    words = ["netboot", "BOARD=numaker", "PORT=/dev/null"]
    done = subprocess.run(["make", "-n", *words], cwd=ROOT, capture_output=True, text=True, check=True)
    folder = "build/boards/numaker/system"
    assert f"scripts/build-system.sh {folder} gateway" in done.stdout
    assert done.stdout.endswith(f"--console {folder}/uImage {folder}/nuc980-numaker.dtb\n")
