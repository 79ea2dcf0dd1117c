#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""
page.py PROGRAM SECTION PURPOSE OUT: a man page of what PROGRAM says to --help and --version, by help2man.

help2man knows one command line a program. The commands of a program that has some stand in a section of their
own, each as it says to "PROGRAM COMMAND --help".
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

SEE_ALSO = {
    "rtud": "rtuctl(1), rtu-modbus(8), rtu-iec104(8), rtu-journal(8), rtu-logic(8)",
    "rtuctl": "rtud(8)",
    "openrtu": "rtud(8), rtuctl(1), nuc980-pins(1), nuc980-netboot(1)",
    "nuc980-pins": "nuc980-netboot(1)",
    "nuc980-netboot": "nuc980-pins(1)",
}
# A line of the list of commands, and argparse's two lines above that.
COMMAND = re.compile(
    r"(?:^positional arguments:\n  COMMAND\n)?^ {2,4}([a-z][a-z0-9-]*)(?: .*)?\n(?:^ {12,}\S.*\n)?",
    re.MULTILINE,
)
# The same list in the help of a command.
OWN_COMMANDS = re.compile(r"^  COMMAND\n(?: {4}.*\n)+", re.MULTILINE)


WIDTH = 78  # of argparse's help
UNFOLDED = 200
# What runs a program of another architecture, as qemu-aarch64 does.
WRAPPER = os.environ.get("OPENRTU_EXE_WRAPPER", "").split()


def output_of(*words: str | Path, width: int = WIDTH) -> str:
    environment = os.environ | {"COLUMNS": str(width), "LC_ALL": "C"}
    return subprocess.run(words, check=True, capture_output=True, text=True, env=environment).stdout


def said_by(program: Path, *words: str, width: int = WIDTH) -> str:
    return output_of(*WRAPPER, program, *words, width=width)


def literal(text: str) -> str:
    """Lines as they are."""
    escaped = text.replace("\\", r"\e").replace("-", r"\-")
    return ".nf\n" + re.sub(r"^(?=[.'])", r"\&", escaped.strip("\n"), flags=re.MULTILINE) + "\n.fi\n"


def commands_of(program: Path, names: list[str], *before: str) -> str:
    """Of each command its help; behind it that of its own commands. Before: the words up to the name."""
    section = ""
    for name in names:
        usage, _, rest = said_by(program, *before, name, "--help").partition("\n\n")
        usage = " ".join(usage.split())
        path = " ".join([*before, name])
        synopsis = re.sub(rf"^.*? (?={path}\b)", "", usage).replace("-", r"\-")
        section += f".SS {path}\n{synopsis}\n.PP\n{literal(rest)}"
        if own := OWN_COMMANDS.search(rest):
            operands = re.findall(
                r" ([a-z]+)(?= )", re.sub(r"\[[^]]*\]", "", usage.partition(f" {path} ")[2])
            )
            section += commands_of(program, COMMAND.findall(own[0]), *before, name, *operands)
    return section


def stand_in(folder: Path, program: Path, text: str) -> Path:
    """A program that says the help as help2man reads it: its first word is "Usage"."""
    (folder / "help").write_text(re.sub(r"^usage: ", "Usage: ", text))
    (folder / "version").write_text(said_by(program, "--version"))
    script = folder / program.name
    script.write_text(f'#!/bin/sh\ncat "{folder}/${{1#--}}"\n')
    script.chmod(0o755)
    return script


def write_page(program: Path, section: str, purpose: str, out: Path) -> None:
    text, _, examples = said_by(program, "--help", width=UNFOLDED).partition("\nexamples:\n")
    commands = commands_of(program, COMMAND.findall(text))
    more = f"[COMMANDS]\n{commands}\n" if commands else ""
    if examples:
        more += f"[EXAMPLES]\n{literal(examples)}\n"
    see_also = SEE_ALSO.get(program.name, "rtud(8), rtuctl(1)")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "more").write_text(f"{more}[SEE ALSO]\n{see_also}\n")
        shown = stand_in(folder, program, COMMAND.sub("", text))
        output_of("help2man", "--no-info", "--section", section, "--name", purpose,
             "--include", folder / "more", "--output", out, shown)  # fmt: skip
    dated = re.sub(r'^(\.TH \S+ "\d") "[^"]*"', rf'\1 "{today()}"', out.read_text(), flags=re.MULTILINE)
    out.write_text(dated)


def today() -> str:
    """As readers of man pages read it; of the source, where the build is to be reproducible."""
    seconds = int(os.environ.get("SOURCE_DATE_EPOCH", time.time()))
    return time.strftime("%Y-%m-%d", time.gmtime(seconds))


if __name__ == "__main__":
    write_page(Path(sys.argv[1]).resolve(), sys.argv[2], sys.argv[3], Path(sys.argv[4]))
