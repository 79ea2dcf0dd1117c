# SPDX-License-Identifier: GPL-3.0-or-later
"""The lists of symbols: what Kconfig would read, and nothing else."""

from __future__ import annotations

from pathlib import Path

import pytest

from image import symbols

TOP = (
    'config FIRST\n\tbool "config NOT_THIS"\n\thelp\n\t  config NOT_IN_HELP\n\t  source "missing-in-help"\n'
    "menuconfig SECOND\n\tbool\n"
    "if SECOND\n  config INDENTED\n\tbool\nendif\n"
    'source "sub/Config.in"\n'
    'source "$BASE/.br2-external.in.menus"\n'
    'source "arch/$(SRCARCH)/Kconfig"\n'
    'source "Config.in.legacy"\n'
)


@pytest.fixture
def source(tmp_path: Path) -> Path:
    files = {
        "Config.in": TOP,
        "sub/Config.in": 'config SUB # why\nsource "Config.in"\n',
        "arch/arm/Kconfig": "config OURS\n",
        "arch/x86/Kconfig": "config THEIRS\n",
        "Config.in.legacy": "config LEGACY\n",
        "unread/Config.in": "config UNREAD\n",
        "Makefile": "export BR2_VERSION := 2026.02.3\n",
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    return tmp_path


def test_names_are_what_kconfig_reads(source: Path) -> None:
    found = symbols.names(source, "Config.in", {"SRCARCH": "arm"})
    assert found == {"FIRST", "SECOND", "INDENTED", "SUB", "OURS"}


def test_what_is_set_and_known_is_listed(
    source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (source / "Config.in").write_text("config BR2_B\nconfig BR2_A\nconfig BR2_NOT_SET\n")
    configs = tmp_path / "configs"
    configs.mkdir()
    (configs / "board_defconfig").write_text("BR2_A=y\n# BR2_B is not set\nBR2_MISSPELT=y\n")
    monkeypatch.setattr(symbols, "ROOT", tmp_path)
    assert symbols.main([str(source)]) == 0
    lines = (configs / "buildroot-symbols.txt").read_text().splitlines()
    assert "Buildroot 2026.02.3" in lines[1]
    assert lines[2:] == ["BR2_A", "BR2_B"]


@pytest.mark.parametrize("words", [[], ["--help"], ["a", "b", "c"], ["/nowhere"]])
def test_unusable_words_are_said(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert symbols.main(words) == 2
    assert "symbols" in capsys.readouterr().err


def test_missing_file_is_said(source: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (source / "sub" / "Config.in").unlink()
    assert symbols.main([str(source)]) == 2
    assert "name a whole source tree" in capsys.readouterr().err
