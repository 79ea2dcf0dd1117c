# SPDX-License-Identifier: GPL-3.0-or-later
"""U-Boot's environment: read from the board so that line noise is noticed, kept in a file, put back."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import ClassVar

from nuc980.netboot.commandline import quoted
from nuc980.netboot.console import TRIES, Console
from nuc980.netboot.errors import CommandFailed, LineTooLong, LineUnsafe, UnusableInput
from nuc980.netboot.plan import Plan, SetVariable, Step
from nuc980.netboot.session import Session

# A value's line ends and back-slashes have a back-slash before them (lib/hashtable.c, hexport_r).
VARIABLE = re.compile(r"([^=\n]+)=((?:[^\\\n]|\\.)*)\n", re.DOTALL)
SIZE = re.compile(r"\nEnvironment size: (\d+)/(\d+) bytes\s*$")

# U-Boot writes them itself: at its start, and when a command has loaded a file or looked at the flash.
MADE_BY_UBOOT = {
    *("stdin", "stdout", "stderr", "ver", "fdtcontroladdr", "fdtaddr", "fileaddr", "filesize"),
    *("partition", "mtddevnum", "mtddevname", "nand_erasesize", "nand_oobsize", "nand_writesize"),
}
# Not set either: another baudrate is taken at once, and the line is lost.
LEFT_ALONE = MADE_BY_UBOOT | {"baudrate"}
# Set, but not removed: U-Boot puts in the port that it uses, and its partitions when it is asked for them.
NEVER_REMOVED = LEFT_ALONE | {"ethact", "mtdids", "mtdparts"}

# Set as long as a flash is at work; never kept, or a board that was reset in the middle would have it too.
IN_WORK = "flashing"

WRITE_SECONDS = 30.0


@dataclass(frozen=True)
class Environment:
    """What printenv shows. room: how many bytes the variables may have, 0 when it is not known."""

    variables: Mapping[str, str]
    room: int = 0


def read_environment(console: Console) -> Environment:
    """The variables in RAM. Read until two readings agree that are as long as U-Boot says they are.

    Raises LineUnsafe when none do, or when a value has characters that a line of text does not carry.
    """
    readings: list[Environment] = []
    wrong: UnusableInput | None = None
    for _ in range(TRIES + 1):
        printed = console.run("printenv").required()
        try:
            readings.append(parse(printed if printed.endswith("\n") else printed + "\n", whole=True))
        except UnusableInput as error:
            wrong = error
            continue
        if readings[-1] in readings[:-1]:
            return readings[-1]
    if wrong and not readings:
        raise LineUnsafe(
            f"The environment cannot be read: {wrong.what}",
            cause="the line loses characters, or a value is not printable ASCII",
        )
    raise LineUnsafe("Each reading of the environment gives another result.")


def parse(printed: str, *, whole: bool = False) -> Environment:
    """What printenv or a saved file says; whole: it must end with the line that tells its size.

    Lines that begin with # may stand before the first variable. Raises UnusableInput for anything else that
    is no variable, and when the size is another than that line says.
    """
    listed = re.sub(r"\A(#.*\n|\s)*", "", printed)
    size = SIZE.search(listed)
    if size:
        listed = listed[: size.start()] + "\n" * (not listed[: size.start()].endswith("\n"))
    elif whole:
        raise UnusableInput("no 'Environment size' at its end")
    variables: dict[str, str] = {}
    at = 0
    while at < len(listed.rstrip("\n")):
        found = VARIABLE.match(listed, at)
        if not found:
            raise UnusableInput(f"no variable: {listed[at:].splitlines()[0]!r}")
        variables[found[1]] = re.sub(r"\\(.)", r"\1", found[2], flags=re.DOTALL)
        at = found.end()
    if size and int(size[1]) not in _sizes(variables):
        raise UnusableInput(f"{_sizes(variables)[0]} bytes, and its own count says {size[1]}")
    return Environment(variables, int(size[2]) if size else 0)


def printed(environment: Environment) -> str:
    """The text of printenv; without the line of its size when the room is not known."""
    listed = _listed(environment.variables)
    if not environment.room:
        return listed
    return f"{listed}\nEnvironment size: {len(listed) + 1}/{environment.room} bytes\n"


def _listed(variables: Mapping[str, str]) -> str:
    return "".join(f"{name}={_escaped(value)}\n" for name, value in sorted(variables.items()))


def _escaped(value: str) -> str:
    return value.replace("\\", "\\\\").replace("\n", "\\\n")


def _sizes(variables: Mapping[str, str]) -> tuple[int, int]:
    """What U-Boot may call its size: with a zero byte; 2016.11 counts two bytes more for each variable."""
    size = len(_listed(variables).encode()) + 1
    return size, size + 2 * len(variables)


# ---- kept in the folder of the site


def keep(folder: Path, environment: Environment, version: str, port: str) -> Path | None:
    """Saves it as environment.txt; when that is another one, as environment-TIME.txt.

    Returns the file, None when a saved one has the same. No file is ever overwritten.
    """
    environment = replace(environment, variables=kept(environment.variables))
    if any(_same(environment, path) for path in folder.glob("environment*.txt")):
        return None
    now = datetime.now(UTC)
    head = f"# saved by nuc980-netboot at {now:%Y-%m-%d %H:%M:%S} UTC from {port}\n# {version}\n"
    folder.mkdir(parents=True, exist_ok=True)
    stem = f"environment-{now:%Y%m%dT%H%M%S}"
    for name in ("environment.txt", f"{stem}.txt", *(f"{stem}.{number}.txt" for number in range(2, 10))):
        try:
            file = (folder / name).open("x", encoding="utf-8", newline="\n")
        except FileExistsError:
            continue
        with file:
            file.write(head + printed(environment))
            file.flush()
            os.fsync(file.fileno())
        return folder / name
    raise UnusableInput(f"{folder}: ten environments in one second")


def kept(variables: Mapping[str, str]) -> dict[str, str]:
    """What is worth keeping of an environment in RAM."""
    return {name: value for name, value in variables.items() if name != IN_WORK}


def load(path: Path) -> Environment:
    """A saved environment, or one written by hand. Raises UnusableInput."""
    try:
        return parse(path.read_text(encoding="utf-8") + "\n")
    except UnicodeDecodeError as error:
        raise UnusableInput(f"{path}: not text: {error}") from error
    except UnusableInput as error:
        raise UnusableInput(
            f"{path}: {error.what}",
            cause="the file was cut, or changed by hand",
            next_step="when the change is meant, remove its last line, 'Environment size: …'",
        ) from error


def _same(environment: Environment, path: Path) -> bool:
    try:
        return _own(load(path).variables) == _own(environment.variables)
    except UnusableInput:
        return False


def _own(variables: Mapping[str, str]) -> dict[str, str]:
    return {name: value for name, value in variables.items() if name not in MADE_BY_UBOOT}


# ---- put back


@dataclass(frozen=True)
class Difference:
    """A variable that is another one on the board: None is not there."""

    name: str
    here: str | None
    wanted: str | None

    @property
    def left_alone(self) -> bool:
        """Whether it is U-Boot's own, or would lose the line."""
        return self.name in (NEVER_REMOVED if self.wanted is None else LEFT_ALONE)

    def __str__(self) -> str:
        """One line for each side."""
        if self.left_alone:
            return f"  {self.name} is left to U-Boot: {self.here if self.here is not None else 'not set'}"
        lines = [("-", self.here), ("+", self.wanted)]
        return "\n".join(f"{sign} {self.name}={value}" for sign, value in lines if value is not None)


def differences(here: Mapping[str, str], wanted: Mapping[str, str]) -> Iterator[Difference]:
    """In the order of the names."""
    for name in sorted({*here, *wanted}):
        difference = Difference(name, here.get(name), wanted.get(name) or None)
        if difference.here != difference.wanted:
            yield difference


@dataclass(frozen=True)
class Verify(Step):
    """Reads the environment back and compares."""

    wanted: Mapping[str, str]
    phase: ClassVar[str] = "verify"

    def title(self) -> str:
        return "Read the environment back."

    def commands(self) -> tuple[str, ...]:
        return ("printenv", "printenv")

    def run(self, session: Session) -> None:
        here = read_environment(session.console).variables
        wrong = [each.name for each in differences(here, self.wanted) if not each.left_alone]
        if wrong:
            raise CommandFailed(f"The environment differs from what was written: {', '.join(wrong)}.")


@dataclass(frozen=True)
class Save(Step):
    """Writes the environment to the flash."""

    phase: ClassVar[str] = "save"

    def title(self) -> str:
        return (
            "Write the environment to the flash. It has one copy: a board that loses power now starts with"
            " U-Boot's own defaults, until restore-env --save is done once more."
        )

    def commands(self) -> tuple[str, ...]:
        return ("saveenv",)

    def run(self, session: Session) -> None:
        (command,) = self.commands()
        received = session.console.run(command, WRITE_SECONDS, repeatable=False).required()
        if re.search(r"fail|error|can't", received, re.IGNORECASE):
            raise CommandFailed(f"saveenv: {received.strip()}")


def plan_restore(here: Mapping[str, str], wanted: Mapping[str, str], *, save: bool) -> Plan:
    """Sets what differs, removes what is not wanted, reads it back; save: writes it to the flash.

    Raises UnusableInput for a value that cannot be typed.
    """
    changes = [each for each in differences(here, wanted) if not each.left_alone]
    for change in changes:
        try:
            quoted(change.wanted or "")
        except LineTooLong as error:
            raise UnusableInput(f"{change.name}: {error.what}") from error
    sets = [SetVariable(change.name, change.wanted or "") for change in changes]
    return Plan((*sets, *([Verify(wanted)] if sets else []), *([Save()] if save else [])))
