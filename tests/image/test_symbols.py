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


def test_list_is_written(source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (source / "Config.in").write_text("config B\nconfig A\n")
    monkeypatch.setattr(symbols, "CONFIGS", tmp_path)
    assert symbols.main([str(source)]) == 0
    lines = (tmp_path / "buildroot-symbols.txt").read_text().splitlines()
    assert "Buildroot 2026.02.3" in lines[1]
    assert lines[2:] == ["A", "B"]


@pytest.mark.parametrize("words", [[], ["--help"], ["a", "b", "c"], ["/nowhere"]])
def test_unusable_words_are_said(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert symbols.main(words) == 2
    assert "symbols" in capsys.readouterr().err


def test_missing_file_is_said(source: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (source / "sub" / "Config.in").unlink()
    assert symbols.main([str(source)]) == 2
    assert "name a whole source tree" in capsys.readouterr().err
