# SPDX-License-Identifier: GPL-3.0-or-later
"""
python3 -m image.symbols BUILDROOT_DIR [LINUX_DIR]: writes configs/buildroot-symbols.txt and, if LINUX_DIR is
given, configs/linux-symbols.txt: what our defconfigs, their parts and the kernel fragments set and the pinned
release knows. By them `make test` finds, without a checkout, what is misspelt or gone from a new release.

A name is known if Kconfig would read it: the files are followed from the top through their `source` lines,
for this processor. Legacy symbols are left out: Buildroot refuses to build with one.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path

from image.checks import (
    Setting,
    buildroot_list,
    buildroot_settings,
    linux_list,
    linux_settings,
    name_of,
)
from nuc980.errors import UnusableInput

ROOT = Path(__file__).resolve().parents[2]
# Where Buildroot has written of our own packages and its list of toolchains; Config.in.legacy is not for use.
NOT_ITS_OWN = re.compile(r"\.br2-external\.|Config\.in\.legacy")
LINE = re.compile(
    r"^\s*(?:(?:menu)?config\s+(?P<name>\w+)|o?r?source\s+\"?(?P<file>[^\"\s]+)\"?)\s*(?:#.*)?$"
)
DEFINED_IN_HELP = re.compile(r"^\s*(?:---)?help(?:---)?\s*$")


def names(folder: Path, top: str, variables: dict[str, str]) -> set[str]:
    """The symbols that Kconfig reads from `top` on, with $(NAME) and $NAME in file names replaced."""
    found: set[str] = set()
    waiting, seen = [top], set()
    while waiting:
        name = waiting.pop()
        if name in seen or NOT_ITS_OWN.search(name):
            continue
        seen.add(name)
        for symbol, source in _lines(folder / name):
            if symbol:
                found.add(symbol)
            else:
                waiting.append(_replaced(source, variables))
    return found


def _lines(file: Path) -> Iterator[tuple[str | None, str | None]]:
    """Name or file name of each `config` and `source` line; what a help text says is none."""
    try:
        text = file.read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        raise UnusableInput(f"{file}: {error.strerror}; name a whole source tree") from error
    help_indent: int | None = None
    for line in text.expandtabs().splitlines():
        indent = len(line) - len(line.lstrip())
        if help_indent is not None and (not line.strip() or indent > help_indent):
            continue
        help_indent = indent if DEFINED_IN_HELP.match(line) else None
        if found := LINE.match(line):
            yield found["name"], found["file"]


def _replaced(name: str, variables: dict[str, str]) -> str:
    return re.sub(r"\$\(?(\w+)\)?", lambda found: variables.get(found[1], ""), name).lstrip("/")


def write(file: Path, origin: str, known: set[str], used: list[Setting]) -> None:
    kept = known & {name_of(each) for each in used}
    head = (
        "# SPDX-License-Identifier: GPL-3.0-or-later\n"
        f"# What is set here and {origin} knows; written by scripts/image/symbols.py.\n"
    )
    file.write_text(head + "".join(f"{name}\n" for name in sorted(kept)), encoding="utf-8")
    print(f"{file}: {len(kept)} of {len(known)} symbols of {origin}")


def makefile_value(folder: Path, expression: str) -> str:
    makefile = folder / "Makefile"
    found = re.search(expression, makefile.read_text() if makefile.is_file() else "", re.MULTILINE)
    if found is None:
        raise UnusableInput(
            f"{folder} is not the source tree that it should be: its Makefile has no line {expression}"
        )
    return ".".join(found.groups())


def main(words: list[str]) -> int:
    if len(words) not in (1, 2) or words[0].startswith("-"):
        print(__doc__.strip().split("\n\n")[0] if __doc__ else "", file=sys.stderr)
        return 2
    try:
        buildroot = Path(words[0])
        release = makefile_value(buildroot, r"^export BR2_VERSION := (\S+)$")
        known = names(buildroot, "Config.in", {})
        write(buildroot_list(ROOT), f"Buildroot {release}", known, buildroot_settings(ROOT))
        if len(words) == 2:
            linux = Path(words[1])
            version = makefile_value(linux, r"^VERSION = (\d+)\nPATCHLEVEL = (\d+)\nSUBLEVEL = (\d+)$")
            known = names(linux, "Kconfig", {"SRCARCH": "arm", "HEADER_ARCH": "arm"})
            write(linux_list(ROOT), f"the vendor's Linux {version}", known, linux_settings(ROOT))
    except UnusableInput as error:
        print(f"symbols: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
