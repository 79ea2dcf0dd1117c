# SPDX-License-Identifier: GPL-3.0-or-later
"""
offline.py: Buildroot's image without the archives that Buildroot downloads. configs/offline.toml says what
stands in for each: a source of Debian's, taken by Buildroot's own <PACKAGE>_OVERRIDE_SRCDIR, or a program of
this machine. Exit codes: 0 done, 2 the table, a source or a program cannot be used.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import re
import shutil
import sys
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import search_path
from nuc980.errors import UnusableInput

ROOT = Path(__file__).resolve().parents[2]
TABLE = ROOT / "configs" / "offline.toml"
TOOLCHAIN = "toolchain-external-custom"
C_LIBRARY = ROOT / "build/offline/toolchain/arm-linux-gnueabi/sysroot/lib/libc.so.6"
# What Buildroot's package-generic leaves behind for each step that it has done.
STEPS = (
    "downloaded",
    "actual_downloaded",
    "extracted",
    "rsynced",
    "patched",
    "configured",
    "built",
    "staging_installed",
    "target_installed",
    "images_installed",
    "host_installed",
    "installed",
)
LISTS = ("", "-host", "-staging", "-images")
SUM = re.compile(r"[0-9a-f]{64}")


@dataclass(frozen=True)
class Source:
    package: str
    """Buildroot's name."""
    debian: str
    version: str = ""
    sha256: str = ""
    autoreconf: bool = False
    edits: Mapping[str, str] = field(default_factory=dict)
    """sed's expression for a file."""
    make: str = ""
    """Lines of Buildroot's own make."""
    folder: str = ""
    """Where it is if other targets make it: then those say which version it is."""
    target: str = ""
    """That target."""

    @property
    def made(self) -> str:
        """What make builds for it."""
        return self.target or f"build/{self.debian}/debian.dsc"

    @property
    def path(self) -> Path:
        return ROOT / (self.folder or f"build/{self.debian}/debian")

    @property
    def description(self) -> Path:
        return ROOT / f"build/{self.debian}/debian.dsc"


@dataclass(frozen=True)
class Table:
    sources: tuple[Source, ...]
    programs: Mapping[str, Sequence[str]]
    left_out: frozenset[str] = frozenset()
    """Packages that another one brings without using them."""


def read_table(file: Path = TABLE) -> Table:
    try:
        read = tomllib.loads(file.read_text(encoding="utf-8"))
        table = Table(
            tuple(Source(**row) for row in read.pop("source")),
            read.pop("programs"),
            frozenset(read.pop("left_out", ())),
        )
    except (OSError, tomllib.TOMLDecodeError, KeyError, TypeError) as error:
        raise UnusableInput(
            f"{file}: {error}", next_step="mend the line; the others show the form"
        ) from error
    names = [each.package for each in table.sources]
    wrong = [f"{name} is there twice" for name in {name for name in names if names.count(name) > 1}]
    wrong += [f"{name} is no part of the table" for name in read]
    wrong += [
        f"{each.package} needs a version and its .dsc's SHA-256"
        for each in table.sources
        if not each.folder and not (each.version and SUM.fullmatch(each.sha256))
    ]
    wrong += [
        f"{each.package} needs both a folder and the target that makes it"
        for each in table.sources
        if bool(each.folder) != bool(each.target)
    ]
    if wrong:
        raise UnusableInput(f"{file}: {'; '.join(wrong)}")
    return table


def version_of(description: Path) -> str:
    found = re.search(r"^Version: (\S+)$", description.read_text(encoding="utf-8"), re.MULTILINE)
    return found[1] if found else "no version"


def check(source: Source) -> None:
    """Is what was fetched what the table names? apt has held it against Debian's signature."""
    try:
        sha256 = hashlib.sha256(source.description.read_bytes()).hexdigest()
    except OSError as error:
        raise UnusableInput(
            f"{source.description}: {error}", next_step="make image-offline fetches it"
        ) from error
    if not source.folder and sha256 != source.sha256:
        raise UnusableInput(
            f"{source.debian}: expected {source.version}, sha256 {source.sha256}; "
            f"got {version_of(source.description)}, sha256 {sha256}",
            cause="Debian's archive has another version now, or the build has an old one",
            next_step=f"rm -r build/{source.debian} fetches it again; if the archive has moved on, "
            "enter what came in configs/offline.toml",
        )


def release(version: str) -> str:
    """
    The upstream release in a version of Debian's: what vulnerabilities are looked up by.

    >>> release("1:9.2p1-2+deb12u10"), release("3.0.20-1~deb12u2"), release("1:1.2.13.dfsg-1")
    ('9.2p1', '3.0.20', '1.2.13')
    """
    upstream = re.sub(r"^\d+:", "", version).rpartition("-")[0]
    return re.sub(r"[.+~]dfsg.*$", "", upstream)


def overrides(table: Table) -> str:
    """Buildroot's file of overrides."""
    lines = ["# Made by scripts/image/offline.py of configs/offline.toml"]
    for each in table.sources:
        name = each.package.upper().replace("-", "_")
        lines.append(f"{name}_OVERRIDE_SRCDIR = {each.path}")
        if each.autoreconf:
            lines.append(f"{name}_AUTORECONF = YES")
        if each.edits:
            lines.append(f"define {name}_OFFLINE_EDITS")
            lines += [f"\tsed -i '{expression}' $(@D)/{file}" for file, expression in each.edits.items()]
            lines += ["endef", f"{name}_POST_RSYNC_HOOKS += {name}_OFFLINE_EDITS"]
        lines += each.make.splitlines()
    return "\n".join(lines) + "\n"


def versions(table: Table) -> str:
    """What the manifest says of the sources, as image.manifest reads it."""
    return "".join(f"{each.debian} {version_of(each.description)}\n" for each in table.sources)


def described(packages: Mapping[str, Mapping[str, Any]], table: Table) -> dict[str, Mapping[str, Any]]:
    """What show-info says, for a bill of materials: of Debian's sources, without this machine's programs."""
    machines = {name for name, package in packages.items() if stands_in(name, package, table)}
    sources = {each.package: each for each in table.sources}
    return {
        name: package
        | {"dependencies": [each for each in package.get("dependencies", ()) if each not in machines]}
        | (of_debian(package, sources[name]) if name in sources else {})
        | (c_library(C_LIBRARY.read_bytes()) if name == TOOLCHAIN else {})
        for name, package in packages.items()
        if name not in machines
    }


def of_debian(package: Mapping[str, Any], source: Source) -> dict[str, Any]:
    """Buildroot's patches are not in it, so neither are the CVEs mended that they mend."""
    version = release(version_of(source.description))
    row: dict[str, Any] = {
        "version": version,
        "downloads": [],
        "hashes": [],
        "patches": [],
        "ignore_cves": [],
    }
    if "cpe-id" in package:
        number, update = re.fullmatch(r"(.*?)(p\d+)?", version).groups()
        words = package["cpe-id"].split(":")
        words[5:7] = number, update or "-"
        row["cpe-id"] = ":".join(words)
    return row


def c_library(content: bytes) -> dict[str, str]:
    """
    What the toolchain brings into the image: of it Buildroot knows no release.

    >>> c_library(b"GNU C Library (Debian GLIBC 2.36-9+deb12u14) stable release version 2.36.")["version"]
    '2.36'
    """
    found = re.search(rb"GNU C Library \([^)]*\) stable release version ([\d.]+)\.", content)
    if found is None:
        raise UnusableInput(f"{C_LIBRARY} names no release of the GNU C Library")
    release = found[1].decode()
    return {
        "name": "glibc",
        "version": release,
        "licenses": "LGPL-2.1+",
        "cpe-id": f"cpe:2.3:a:gnu:glibc:{release}:-:*:*:*:*:*:*",
    }


def stands_in(name: str, package: Mapping[str, Any], table: Table) -> bool:
    """Whether this machine's programs do, for a host package that Buildroot would download, or nothing."""
    if name in table.left_out:
        return True
    replaced = {each.package for each in table.sources}
    return package["type"] == "host" and bool(package.get("downloads")) and name not in replaced


def find_program(name: str) -> str:
    path = shutil.which(name, path=search_path.complete("/usr/local/bin:/usr/bin:/bin"))
    if path is None:
        raise UnusableInput(
            f"this machine has no {name}", next_step="make setup, or see scripts/packages-offline.txt"
        )
    return path


def not_covered(packages: Mapping[str, Mapping[str, Any]], table: Table) -> Iterator[str]:
    """What Buildroot would download all the same."""
    known = {each.package for each in table.sources} | table.left_out | {"openrtu"}
    for name, package in packages.items():
        if package["type"] == "target" and package.get("downloads") and name not in known:
            yield name


def seed(output: Path, packages: Mapping[str, Mapping[str, Any]], table: Table) -> None:
    """
    Marks in Buildroot's output as installed what this machine has, and what is left out. Links are where its
    packages look.
    """
    for name, package in packages.items():
        if not stands_in(name, package, table):
            continue
        build = output / package["stamp_dir"]
        host = output / "per-package" / name / "host"
        for folder in (build, host / "bin", host / "share" / "aclocal", host.parent / "target"):
            folder.mkdir(parents=True, exist_ok=True)
        for program in table.programs.get(name, ()):
            for folder in (host / "bin", host / "sbin"):
                folder.mkdir(exist_ok=True)
                link = folder / program
                link.unlink(missing_ok=True)
                link.symlink_to(find_program(program))
        for kind in LISTS:
            (build / f".files-list{kind}.txt").touch()
        for step in STEPS:
            stamp = build / f".stamp_{step}"
            if not stamp.exists():
                stamp.touch()


def main(words: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="offline", description="What make image-offline needs beside Buildroot."
    )
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("targets", help="print what make must build first")
    command = commands.add_parser("overrides", help="check the sources, write Buildroot's file of overrides")
    command.add_argument("file", type=Path)
    command = commands.add_parser("seed", help="mark as installed what this machine has")
    command.add_argument("output", type=Path, help="Buildroot's folder O")
    command.add_argument("packages", type=Path, help="what Buildroot's show-info says of it")
    command = commands.add_parser("describe", help="make a file of show-info say what was built")
    command.add_argument("packages", type=Path, help="the file")
    arguments = parser.parse_args(words)
    try:
        table = read_table()
        if arguments.command == "targets":
            print(*(each.made for each in table.sources))
        elif arguments.command == "overrides":
            for each in table.sources:
                check(each)
            arguments.file.parent.mkdir(parents=True, exist_ok=True)
            arguments.file.write_text(overrides(table), encoding="utf-8")
            arguments.file.with_name("versions").write_text(versions(table), encoding="utf-8")
        elif arguments.command == "describe":
            packages = json.loads(arguments.packages.read_text(encoding="utf-8"))
            arguments.packages.write_text(json.dumps(described(packages, table)), encoding="utf-8")
        else:
            packages = json.loads(arguments.packages.read_text(encoding="utf-8"))
            if missing := sorted(not_covered(packages, table)):
                raise UnusableInput(
                    f"configs/offline.toml has nothing for {', '.join(missing)}",
                    next_step="add a row, or turn it off in configs/parts/offline-system.config",
                )
            seed(arguments.output, packages, table)
    except UnusableInput as error:
        print(f"offline: {error}", file=sys.stderr)
        return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main())
