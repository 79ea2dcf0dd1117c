# SPDX-License-Identifier: GPL-3.0-or-later
"""
version.py FORM [--build NUMBER]: this tree's version as others write it, so that a candidate for a release
sorts before the release wherever versions are compared. FORM: pep440 (1.0.0rc1), debian (1.0.0~rc1),
swupdate (1.0.0-rc.1); with the number of a build, swupdate is 1.0.0-rc.1.7.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

FILE = Path(__file__).resolve().parents[2] / "package" / "openrtu" / "src" / "VERSION"
SUMMARY = "Say this tree's version as others write it."
# What VERSION holds: the version itself, and what programs say to --version.
FORM = re.compile(r"(?P<numbers>\d+\.\d+\.\d+)(?:-rc(?P<candidate>\d+))?")


def tree_version() -> str:
    return FILE.read_text(encoding="utf-8").strip()


def _written(version: str, mark: str) -> str:
    """With `mark` between the numbers and the candidate's number. Raises ValueError."""
    if not (found := FORM.fullmatch(version)):
        raise ValueError(f"{version!r} is no version of this tree: 1.2.3, or 1.2.3-rc1 before it")
    return found["numbers"] + (f"{mark}{found['candidate']}" if found["candidate"] else "")


def pep440(version: str) -> str:
    return _written(version, "rc")


def debian(version: str) -> str:
    return _written(version, "~rc")


BUILDS = range(1, 1 << 16)  # SWUpdate 2022.12 ignores the fourth number of a version with a larger one


def swupdate(version: str, build: int | None = None) -> str:
    """
    For the boards. SWUpdate compares versions of numbers and dots by up to four numbers, and others as
    semantic versions, where a part that is a number is compared as one: so there is a dot before the
    candidate's. The number of a build can follow both: 1.0.0-rc.1.7 and 1.0.0.7 sort between their
    neighbours. Raises ValueError.
    """
    if build is not None and build not in BUILDS:
        raise ValueError(f"{build} is no number of a build: {BUILDS.start} to {BUILDS[-1]}")
    return _written(version, "-rc.") + (f".{build}" if build is not None else "")


FORMS: dict[str, Callable[[str], str]] = {"pep440": pep440, "debian": debian, "swupdate": swupdate}


def main(words: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="version", description=SUMMARY)
    parser.add_argument("form", choices=FORMS)
    parser.add_argument("--build", type=int, metavar="NUMBER", help="with swupdate: that of an image")
    given = parser.parse_args(words)
    if given.build is not None and given.form != "swupdate":
        parser.error("--build is for swupdate")
    try:
        version = tree_version()
        print(FORMS[given.form](version) if given.build is None else swupdate(version, given.build))
    except (OSError, ValueError) as error:
        print(f"version: {FILE}: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
