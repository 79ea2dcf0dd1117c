# SPDX-License-Identifier: GPL-3.0-or-later
"""
contents.py: what a root file system holds, whichever tools made it: users and groups, and each file, folder
and link with its owner and mode. A start script's place in the order is its name. `list` reads a folder or an
initramfs; `compare` says where two images differ and board/nuc980/differences.toml does not say so, and which
of its rows speak of no difference. Exit codes: 0 none, 1 some, 2 unusable input.

Nothing but the standard library: Buildroot runs `list` with whatever python3 it has on its path.
"""

from __future__ import annotations

import argparse
import fnmatch
import hashlib
import json
import os
import stat
import sys
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from image.cpio import MAGIC, TRAILER, WORD
from nuc980.errors import UnusableInput

ROOT = Path(__file__).resolve().parents[2]
TABLE = ROOT / "board" / "nuc980" / "differences.toml"
DEBIAN, BUILDROOT, BOTH = "debian", "buildroot", "both"
# Compared by what they say of each user.
ACCOUNTS = ("etc/passwd", "etc/group", "etc/shadow")
FIELDS, FIELD, HEADER = 13, 8, 110
Facts = dict[str, str]


@dataclass(frozen=True)
class Found:
    """What lies at a path; `content` of a link is its target."""

    mode: int
    owner: int
    group: int
    content: bytes = b""

    @property
    def kind(self) -> str:
        if stat.S_ISDIR(self.mode):
            return "folder"
        if stat.S_ISLNK(self.mode):
            return "link"
        if stat.S_ISREG(self.mode):
            # A word of its own, so that no row for files speaks for it.
            return "setuid" if self.mode & (stat.S_ISUID | stat.S_ISGID) else "file"
        return "device"


# ---- reading -------------------------------------------------------------------------------------


def in_folder(root: Path) -> Iterator[tuple[str, Found]]:
    for file in sorted(root.rglob("*")):
        seen = file.lstat()
        content = b""
        if stat.S_ISLNK(seen.st_mode):
            content = os.fsencode(file.readlink())
        elif stat.S_ISREG(seen.st_mode):
            content = file.read_bytes()
        yield str(file.relative_to(root)), Found(seen.st_mode, seen.st_uid, seen.st_gid, content)


def in_archive(packed: bytes) -> Iterator[tuple[str, Found]]:
    """Of the format that image/cpio.py writes."""
    at = 0
    while True:
        header = packed[at : at + HEADER]
        if len(header) < HEADER or not header.startswith(MAGIC):
            raise UnusableInput(f"at byte {at} there is no entry of a cpio archive")
        start = len(MAGIC)
        fields = [int(header[start + FIELD * i : start + FIELD * (i + 1)], 16) for i in range(FIELDS)]
        _, mode, owner, group, _, _, size, _, _, _, _, name_size, _ = fields
        name = packed[at + HEADER : at + HEADER + name_size - 1].decode()
        content = _aligned(at + HEADER + name_size)
        if name == TRAILER:
            return
        if name != ".":
            yield name, Found(mode, owner, group, packed[content : content + size])
        at = _aligned(content + size)


def _aligned(position: int) -> int:
    return position + -position % WORD


def users_in(accounts: dict[str, str]) -> Iterator[tuple[str, str]]:
    passwords = {row[0]: row[1] for row in _rows(accounts, "etc/shadow")}
    groups = {row[2]: row[0] for row in _rows(accounts, "etc/group")}
    for name, _, uid, gid, _, home, shell in _rows(accounts, "etc/passwd"):
        password = passwords.get(name, "")
        locked = "locked" if password[:1] in ("*", "!") else "with a password" if password else "open"
        yield f"user {name}", f"{uid}, group {groups.get(gid, gid)}, home {home}, shell {shell}, {locked}"
    for name, _, gid, members in _rows(accounts, "etc/group"):
        yield f"group {name}", ", ".join([gid, *sorted(filter(None, members.split(",")))])


def _rows(accounts: dict[str, str], file: str) -> list[list[str]]:
    return [line.split(":") for line in accounts.get(file, "").splitlines() if line and line[0] != "#"]


def facts_of(root: Path) -> Facts:
    """Of a folder or an archive. Raises UnusableInput."""
    entries = dict(in_folder(root) if root.is_dir() else in_archive(root.read_bytes()))
    facts = {}
    for path, found in entries.items():
        facts[f"mode {path}"] = f"{stat.S_IMODE(found.mode):o} {found.owner}:{found.group}"
        if found.kind == "link":
            del facts[f"mode {path}"]
            facts[f"link {path}"] = os.path.normpath(Path("/", path).parent / found.content.decode())
        elif path in ACCOUNTS or not found.content:
            facts[f"{found.kind} {path}"] = ""
        else:
            facts[f"{found.kind} {path}"] = hashlib.sha256(found.content).hexdigest()
    accounts = {path: entries[path].content.decode() for path in ACCOUNTS if path in entries}
    return facts | dict(users_in(accounts))


def read_list(file: Path) -> Facts:
    """What `list` wrote, or of a folder or an archive."""
    if file.suffix != ".json":
        return facts_of(file)
    try:
        facts = json.loads(file.read_bytes())
    except ValueError as error:
        raise UnusableInput(f"{file} is not JSON: {error}") from error
    if not isinstance(facts, dict) or not all(isinstance(value, str) for value in facts.values()):
        raise UnusableInput(f"{file} is no list of contents")
    return facts


# ---- comparing -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Row:
    """Facts that are in one image alone, or in both and otherwise."""

    facts: tuple[str, ...]
    where: str
    why: str

    def covers(self, fact: str, where: str) -> bool:
        return where == self.where and any(fnmatch.fnmatchcase(fact, pattern) for pattern in self.facts)


def read_table(file: Path) -> list[Row]:
    try:
        rows = [
            Row(tuple(row["facts"]), row["in"], row["why"])
            for row in tomllib.loads(file.read_text(encoding="utf-8"))["difference"]
        ]
    except (tomllib.TOMLDecodeError, KeyError, TypeError) as error:
        raise UnusableInput(
            f"{file}: {error!r}; it must be a table as {TABLE.relative_to(ROOT)} is"
        ) from error
    for row in rows:
        if row.where not in (DEBIAN, BUILDROOT, BOTH) or not row.why:
            raise UnusableInput(
                f'{file}: {", ".join(row.facts)}: "in" is debian, buildroot or both, with a "why"'
            )
    return rows


def differences(debian: Facts, buildroot: Facts) -> Iterator[tuple[str, str]]:
    """Each fact that differs, and where it is. A mode is compared where both have the path."""
    for fact in sorted({*debian, *buildroot}):
        if fact not in buildroot:
            where = DEBIAN
        elif fact not in debian:
            where = BUILDROOT
        elif debian[fact] != buildroot[fact]:
            where = BOTH
        else:
            continue
        if where == BOTH or not fact.startswith("mode "):
            yield fact, where


def findings(debian: Facts, buildroot: Facts, rows: Sequence[Row]) -> Iterator[str]:
    unused = {(row, pattern) for row in rows for pattern in row.facts}
    for fact, where in differences(debian, buildroot):
        covering = [row for row in rows if row.covers(fact, where)]
        unused -= {(row, each) for row in covering for each in row.facts if fnmatch.fnmatchcase(fact, each)}
        if not covering and where == BOTH:
            yield f"{fact}: debian has {debian[fact]}, buildroot has {buildroot[fact]}"
        elif not covering:
            yield f"{fact}: only {where} has it: {(debian | buildroot)[fact]}"
    for row, pattern in sorted(unused, key=lambda each: (each[0].where, each[1])):
        yield f'the row "{pattern}", in {row.where}, speaks of no difference'


def main(words: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="contents", description="Say what root file systems hold.")
    commands = parser.add_subparsers(dest="command", required=True)
    listing = commands.add_parser("list", help="print a root's contents as JSON")
    listing.add_argument("root", type=Path, help="a folder, or the archive of an initramfs")
    comparing = commands.add_parser("compare", help="say where two images differ without a reason")
    comparing.add_argument("debian", type=Path, help="of make image-debian: a list, a folder or an archive")
    comparing.add_argument("buildroot", type=Path, help="the same of an image that Buildroot made")
    comparing.add_argument("--table", type=Path, default=TABLE, help="the differences with a reason")
    given = parser.parse_args(words)
    try:
        if given.command == "list":
            print(json.dumps(facts_of(given.root), indent=1, sort_keys=True))
            return 0
        found = list(findings(read_list(given.debian), read_list(given.buildroot), read_table(given.table)))
    except UnusableInput as error:
        print(f"contents: {error}", file=sys.stderr)
        return 2
    except OSError as error:
        print(f"contents: {error.filename}: {error.strerror}", file=sys.stderr)
        return 2
    print(*found, sep="\n", end="\n" if found else "")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
