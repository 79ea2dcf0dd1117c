# SPDX-License-Identifier: GPL-3.0-or-later
"""The commands and options that the pages name are those that the programs have."""

import argparse
import os
import re
import subprocess
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import pytest
from test_tree import PAGES, ROOT, code_of

import nuc980.netboot.cli
import nuc980.pins.cli
from lab.gateway import free_port, remove, run_directory
from openrtu_tools.cli import command_line

OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]*")


def output_of(*command: str | Path) -> str:
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout


def lines_with(program: str) -> list[tuple[Path, str]]:
    """The commands of all pages that start this program, up to a pipe or the end of the command."""
    found = re.compile(rf"(?<![\w.-])(?:\S*/)?{program} ([^|;&#\n]*)")
    pages = [(page, code_of(page).replace("\\\n", " ")) for page in PAGES]
    return [(page, arguments) for page, code in pages for arguments in found.findall(code)]


def unknown_options(program: str, known: str) -> list[str]:
    return [
        f"{page}: {program} {arguments}"
        for page, arguments in lines_with(program)
        if set(OPTION.findall(arguments)) - set(OPTION.findall(known))
    ]


def test_options_of_rtud(programs: Path) -> None:
    assert lines_with("rtud")
    assert unknown_options("rtud", output_of(programs / "rtud/rtud", "--help")) == []


def test_commands_and_options_of_rtuctl(programs: Path) -> None:
    rtuctl = programs / "rtuctl/rtuctl"
    general = output_of(rtuctl, "--help")
    commands = set(re.findall(r"^  ([a-z][a-z0-9]*) ", general, re.MULTILINE))
    named = {(page, line.split()[0]) for page, line in lines_with("rtuctl") if re.match(r"[a-z]", line)}
    assert {command for _, command in named} <= commands
    helps = general + "".join(output_of(rtuctl, command, "--help") for command in commands)
    assert unknown_options("rtuctl", helps) == []


TOOLS: dict[str, Callable[[Sequence[str]], int]] = {
    "nuc980-pins": nuc980.pins.cli.main,
    "nuc980-netboot": nuc980.netboot.cli.main,
}


@pytest.mark.parametrize("tool", TOOLS)
def test_options_of_the_tools(tool: str, capsys: pytest.CaptureFixture[str]) -> None:
    def help_of(*subcommand: str) -> str:
        with pytest.raises(SystemExit):
            TOOLS[tool]([*subcommand, "--help"])
        return capsys.readouterr().out

    general = help_of()
    subcommands = re.findall(r"^    ([a-z-]+)(?=  |$)", general, re.MULTILINE)
    assert subcommands
    helps = general + "".join(help_of(name) for name in subcommands)
    assert lines_with(tool)
    assert unknown_options(tool, helps) == []


def subcommands_of(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    return next(
        (action.choices for action in parser._actions if isinstance(action, argparse._SubParsersAction)), {}
    )


@pytest.mark.slow
def test_commands_and_options_of_openrtu() -> None:
    """Of each line that begins with it: its subcommand, that one's own, and the options of these."""
    line = re.compile(r"^\s*(?:\S*/)?openrtu ([^|;&#\n]*)", re.MULTILINE)
    typed = [(page, words) for page in PAGES for words in line.findall(code_of(page).replace("\\\n", " "))]
    assert typed
    wrong = []
    for page, words in typed:
        parser, known = command_line(), set[str]()
        for word in words.split():
            known |= set(parser._option_string_actions)
            parser = subcommands_of(parser).get(word, parser)
        known |= set(parser._option_string_actions)
        if (parser.prog == "openrtu" and "--" not in words) or set(OPTION.findall(words)) - known:
            wrong.append(f"{page}: openrtu {words}")
    assert wrong == []


# ---- the tutorial of logic, word for word ------------------------------------------------------------

BLOCK = re.compile(r"(?:as\s`([\w.-]+)`:\n\n)?^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
PATIENCE_S = 60.0


@pytest.fixture
def folder() -> Iterator[Path]:
    """One that modules, which are of other users, can reach."""
    folder = run_directory()
    yield folder
    remove(folder)


@pytest.mark.slow
def test_an_empty_file_becomes_a_tested_interlock(programs: Path, folder: Path) -> None:
    """Files are saved, commands typed, and what they print is what the page shows."""
    page = (ROOT / "docs/logic.md").read_text()
    chapter = page[page.index("## From an empty file") : page.index("## Check, test, run")]
    begin, *blocks = BLOCK.findall(chapter)
    assert "cd ~/interlock" in begin[2]
    tools = ("scripts", "build/native/rtud", "build/native/rtuctl")
    assert f"`export PATH={':'.join(f'$PWD/{tool}' for tool in tools)}:$PATH`" in chapter
    path = f"{ROOT}/scripts:{programs}/rtud:{programs}/rtuctl:{os.environ['PATH']}"
    script = ["exec 2>&1", f"cd {folder}"]
    wanted = ""
    for file, kind, text in blocks:
        if kind == "text":
            wanted += text
        elif kind == "sh":
            script.append(
                text.replace("--map map gateway", f"--map map --modules {programs}/modules gateway")
            )
            if "rtud --map map" in text:
                runs = "until rtuctl --map map points 2>&1 | grep -q locked.*good; do sleep 0.1; done"
                script.append(f"trap 'kill %1; wait' EXIT; timeout {PATIENCE_S} sh -c '{runs}'")
        else:
            assert file, f"nothing says what to do with:\n{text}"
            script.append(
                f"cat > {file} <<'END OF FILE'\n{text.replace('2404', str(free_port()))}END OF FILE"
            )
    done = subprocess.run(
        ["bash", "-c", "\n".join(script)],
        env=os.environ | {"PATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout == wanted


# ---- the first device, word for word -----------------------------------------------------------------

FIRST = "docs/first-device.md"


def without_ages(text: str) -> list[list[str]]:
    """The words of each line; the age of a value is that of the moment."""
    return [re.sub(r"\d+(\.\d+)? (ms|s)\b", "AGE", line).split() for line in text.splitlines()]


@pytest.mark.slow
def test_a_first_device_is_seen_as_its_page_says(programs: Path, linesim_program: Path, folder: Path) -> None:
    """With the simulated meter: files are saved, commands typed, and what they print is shown."""
    page = (ROOT / FIRST).read_text()
    example, values = re.findall(r"as `[\w.-]+`:\n\n```json\n(.*?)^```$", page, re.DOTALL | re.MULTILINE)
    assert example == (ROOT / "docs/examples/first-device.json").read_text()
    begin, check, simulate = re.findall(r"^```sh\n(.*?)^```$", page, re.DOTALL | re.MULTILINE)
    assert "build/native/rtud:$PWD/build/native/rtuctl:$PWD/build/linesim:" in begin
    by_hand = re.findall(r"^\$ (.*)$", page, re.MULTILINE)
    start, look = by_hand[-2:]
    assert start.replace("--map map", "--map map --dev dev") + " &" in simulate  # but for the device
    good, points = re.findall(r"^```text\n(.*?)^```$", page, re.DOTALL | re.MULTILINE)
    (folder / "first-device.json").write_text(example.replace("2404", str(free_port())))
    (folder / "values.json").write_text(values)
    is_read = f"until {look} 2>&1 | grep -q power.*good; do sleep 0.1; done"
    script = [
        "set -e",
        check,
        "{",  # whatever these say, it is not what the page shows
        simulate.replace("$OPENRTU/build/native", str(programs)),
        "} > log 2>&1",
        "trap 'kill %1 %2; wait' EXIT",
        f"timeout {PATIENCE_S} sh -c '{is_read}'",
        look,
    ]
    path = f"{programs}/rtud:{programs}/rtuctl:{linesim_program.parent}:{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-c", "\n".join(script)],
        cwd=folder,
        env=os.environ | {"PATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    assert without_ages(done.stdout) == without_ages(good + points), done.stderr
