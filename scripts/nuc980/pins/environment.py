# SPDX-License-Identifier: GPL-3.0-or-later
"""What a boot loader or an image says beside the tree: the command line, and what is read from the flash."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from nuc980.errors import UnusableInput
from nuc980.pins.source import refuse_pipe

LARGEST = 1 << 20
VARIABLE = re.compile(r"\$\{(\w+)\}|\$(\w+)")
UNITS = {"k": 10, "m": 20, "g": 30}
DEEPEST = 8  # expansions of a variable by others
HEX = r"(?:0x)?([0-9a-fA-F]+)"
RUN = re.compile(r"\brun((?:[ \t]+[\w.-]+)+)")
READ = re.compile(rf"\bnand read(?:\.\w+)? {HEX} {HEX} {HEX}")  # to memory, from the flash, bytes


@dataclass(frozen=True)
class FlashRead:
    """A part of the flash that the boot command reads; bytes."""

    offset: int
    size: int

    @property
    def end(self) -> int:
        return self.offset + self.size


@dataclass(frozen=True)
class Environment:
    """What is said beside the tree."""

    source: str = ""  # the file, or the option
    words: tuple[str, ...] = ()  # of the command line
    reads: tuple[FlashRead, ...] = ()


def read_environment(file: Path) -> Environment:
    """Of a text as U-Boot's printenv prints it. Raises UnusableInput for what is none."""
    refuse_pipe(file)
    try:
        with file.open("rb") as stream:
            text = stream.read(LARGEST).decode(errors="replace")
    except OSError as error:
        raise UnusableInput(f"{file}: {error.strerror}; name what printenv of U-Boot has printed") from error
    rows = (line.strip().partition("=") for line in text.splitlines())
    variables = {name: value for name, equals, value in rows if equals and re.fullmatch(r"[\w.-]+", name)}
    if not {"bootargs", "bootcmd", "mtdparts"} & variables.keys():
        raise UnusableInput(
            f"{file} has none of bootargs, bootcmd and mtdparts; write NAME=VALUE a line, as printenv prints"
        )
    expanded = {name: _expanded(value, variables) for name, value in variables.items()}
    words = expanded.get("bootargs", "").split()
    if "mtdparts" in expanded and not any(word.startswith("mtdparts=") for word in words):
        words.append(f"mtdparts={expanded['mtdparts'].removeprefix('mtdparts=')}")
    reads = (
        FlashRead(int(found[2], 16), int(found[3], 16))
        for name in _run_by("bootcmd", expanded)
        for found in READ.finditer(expanded[name])
    )
    return Environment(str(file), tuple(words), tuple(dict.fromkeys(reads)))


def _run_by(command: str, variables: dict[str, str]) -> list[str]:
    """The variable with a command, and those that it runs."""
    names = [command] if command in variables else []
    for name in names:
        ran = (one for found in RUN.finditer(variables[name]) for one in found[1].split())
        names += [one for one in dict.fromkeys(ran) if one in variables and one not in names]
    return names


def bytes_of(text: str) -> int:
    """A number as the kernel reads it (memparse): 0x40, 010 with base 8, 64M."""
    digits = text.rstrip("kKmMgG")
    base = 16 if digits[:2].lower() == "0x" else 8 if re.fullmatch("0[0-7]+", digits) else 10
    return int(digits, base) << UNITS.get(text[-1].lower(), 0)


def _expanded(value: str, variables: dict[str, str]) -> str:
    for _ in range(DEEPEST):
        value = VARIABLE.sub(lambda found: variables.get(found[1] or found[2], ""), value)[:LARGEST]
    return value
