# SPDX-License-Identifier: GPL-3.0-or-later
"""docs/netboot.md: its table of symptoms is errors.py's, its example runs, its commands and options exist."""

import argparse
import importlib
import pkgutil
import re
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path

import pytest

import nuc980.netboot
from netboot.double import Double
from nuc980.netboot.board import BoardReport, Nand
from nuc980.netboot.cli import _parser
from nuc980.netboot.errors import NetbootError
from nuc980.netboot.fixture import OPTIONS
from nuc980.netboot.site import Site

PAGE = (Path(__file__).parents[2] / "docs/netboot.md").read_text()
HERE = "see the message"


def kinds(base: type[NetbootError] = NetbootError) -> Iterator[type[NetbootError]]:
    """What a user may meet of the tool; a worker may have imported the errors of others before."""
    for module in pkgutil.walk_packages(nuc980.netboot.__path__, "nuc980.netboot."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
    for kind in base.__subclasses__():
        if kind.__module__.startswith("nuc980."):
            yield kind
        yield from kinds(kind)


def row(kind: type[NetbootError]) -> str:
    seen = " ".join((kind.__doc__ or "").split("\n\n")[0].split())
    cells = (f"`{kind.__name__}`", seen, kind.cause or HERE, kind.next_step or HERE)
    return "| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |"


def test_table_of_symptoms_is_that_of_the_errors() -> None:
    wanted = [row(kind) for kind in kinds()]
    found = re.findall(r"^\| `[A-Z]\w+` \|.*\|$", PAGE, re.MULTILINE)
    assert found == wanted, "the rows are to be:\n" + "\n".join(wanted)


@pytest.mark.slow
def test_example_runs(
    images: list[str],
    site: Path,
    udp_port: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (example,) = (text for text in re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL) if "Target(" in text)
    assert 8 <= len(example.splitlines()) <= 10
    monkeypatch.chdir(tmp_path)
    assert Site(Path("site")).macs({})[0] == "02:00:00:00:00:01"
    with Double("factory", tftp=("127.0.0.1", udp_port)) as double:
        program = example.replace("nuc980-gateway.dtb", "board.dtb").replace("/dev/ttyUSB0", double.port)
        here = ", ".join(f'{name}="127.0.0.1"' for name in ("server_ip", "listen", "seen_as"))
        program = program.replace('site="site"', f'site="site", tftp_port={udp_port}, {here}')
        exec(compile(program, "docs/netboot.md", "exec"), {})
    assert double.kernels_started == 1
    assert "bootcmd=nand read" in capsys.readouterr().out


def test_commands_and_options_exist() -> None:
    (commands,) = (each for each in _parser()._actions if isinstance(each, argparse._SubParsersAction))
    known = {name: set(parser._option_string_actions) for name, parser in commands.choices.items()}
    typed = re.findall(r"scripts/nuc980-netboot ([a-z-]+) ((?:[^`\n]|\\\n)*)", PAGE)
    assert {name for name, _ in typed} == set(known)
    for name, words in typed:
        options = set(re.findall(r"(?<=\s)--[\w-]+", f" {words}"))
        assert options <= known[name], name
    everywhere = set(re.findall(r"`(--(?!nuc980)[\w-]+)", PAGE))
    assert everywhere <= set.union(*known.values())
    assert set(re.findall(r"--nuc980-([\w-]+)", PAGE)) <= set(OPTIONS)


def test_each_field_of_the_json_is_described() -> None:
    table = PAGE[PAGE.index("| `--json` |") :]
    names = [field.name for kind in (BoardReport, Nand) for field in fields(kind)]
    assert [name for name in names if f"`{name}`" not in table] == []


def test_picture_is_there() -> None:
    (figure,) = re.findall(r"\((figures/.*?)\)", PAGE)
    assert (Path(__file__).parents[2] / "docs" / figure).read_text().count("PF11") == 3
