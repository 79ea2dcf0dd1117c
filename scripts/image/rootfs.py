# SPDX-License-Identifier: GPL-3.0-or-later
"""
rootfs.py: the root file system of `make image-debian`, put together in a folder: Debian's files and the
libraries they need, BusyBox, the gateway, the board's own files, the gateway's users.

Nothing but the standard library; `readelf` says which libraries a program names.
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from image.gateway import TLS, needed, read_configuration
from nuc980.errors import UnusableInput

ROOT = Path(__file__).resolve().parents[2]
BOARD = ROOT / "board" / "nuc980"
PACKAGE = ROOT / "package" / "openrtu"
TABLE = BOARD / "system.toml"
# What Buildroot's images take too: users beside the gateway's own, and what the system is called.
USERS = BOARD / "users"
SETTINGS = ROOT / "configs" / "parts" / "system.config"
LIBRARY_FOLDERS = ("lib/arm-linux-gnueabi", "usr/lib/arm-linux-gnueabi")
ELF = b"\x7fELF"
WITH_OPENSSL = ("rtu-snmp", "rtu-web")


@dataclass(frozen=True)
class Table:
    """board/nuc980/system.toml."""

    programs: dict[str, list[str]]
    library_packages: list[str]
    tls_packages: list[str]
    update_packages: list[str]
    pull_programs: dict[str, list[str]]
    pull_packages: list[str]
    more_libraries: list[str]
    folders: dict[str, int]
    links: dict[str, str]

    def packages(self, tls: bool, update: bool, pull: bool) -> list[str]:
        names = {*self.programs, *self.library_packages}
        names |= {*(self.tls_packages if tls else []), *(self.update_packages if update else [])}
        names |= {*self.pull_programs, *self.pull_packages} if pull else set()
        return sorted(names)


def read_table(file: Path) -> Table:
    try:
        table = tomllib.loads(file.read_text(encoding="utf-8"))
        return Table(
            programs=table["programs"],
            library_packages=table["libraries"]["packages"],
            tls_packages=table["tls"]["packages"],
            update_packages=table["update"]["packages"],
            pull_programs=table["pull"]["programs"],
            pull_packages=table["pull"]["libraries"]["packages"],
            more_libraries=table["libraries"]["also"],
            folders=table["folders"],
            links=table["links"],
        )
    except (tomllib.TOMLDecodeError, KeyError, TypeError) as error:
        raise UnusableInput(
            f"{file}: {error!r}; it must be a table as board/nuc980/system.toml is"
        ) from error


# ---- users ---------------------------------------------------------------------------------------

# Buildroot's syntax: name, uid, group, gid, password, home, shell, further groups, comment.
USER = re.compile(r"^\t?([a-z][\w-]*) (\d+) ([a-z][\w-]*) (\d+) \* (-|/\S+) - (\S+) (.+)$", re.MULTILINE)


@dataclass(frozen=True)
class User:
    name: str
    uid: int
    group: str
    gid: int
    home: str
    more_group: str | None
    comment: str

    @property
    def passwd(self) -> str:
        return f"{self.name}:x:{self.uid}:{self.gid}:{self.comment}:{self.home}:/bin/false"


def users_of(file: Path) -> list[User]:
    """The users of a table or of a Buildroot package; without one UnusableInput is raised."""
    users = [
        User(
            name,
            int(uid),
            group,
            int(gid),
            home.removeprefix("-") or "/",
            more.removeprefix("-") or None,
            comment,
        )
        for name, uid, group, gid, home, more, comment in USER.findall(file.read_text(encoding="utf-8"))
    ]
    if not users:
        raise UnusableInput(f"{file} has no line of a user, as Buildroot's manual describes it")
    return users


def add_users(etc: Path, users: Sequence[User]) -> None:
    append(etc / "passwd", (user.passwd for user in users))
    append(etc / "shadow", (f"{user.name}:*:::::::" for user in users))
    append(
        etc / "group", (f"{name}:x:{gid}:" for name, gid in {user.group: user.gid for user in users}.items())
    )
    for user in users:
        if user.more_group:
            join(etc / "group", user.more_group, user.name)


def append(file: Path, lines: Iterable[str]) -> None:
    with file.open("a", encoding="utf-8") as out:
        out.writelines(f"{line}\n" for line in lines)


def join(groups: Path, group: str, name: str) -> None:
    text, found = re.subn(
        rf"^({group}:.*:)(.*)$",
        lambda line: f"{line[1]}{','.join(filter(None, [line[2], name]))}",
        groups.read_text(encoding="utf-8"),
        flags=re.MULTILINE,
    )
    if not found:
        raise UnusableInput(f"{groups} has no group {group}, which {name} is to be in")
    groups.write_text(text, encoding="utf-8")


def setting(name: str) -> str:
    """Of Buildroot's images."""
    found = re.search(rf'^{name}="(.+)"$', SETTINGS.read_text(encoding="utf-8"), re.MULTILINE)
    if not found:
        raise UnusableInput(f"{SETTINGS} has no {name}")
    return found[1]


def name_system(etc: Path) -> None:
    """As Buildroot does it."""
    hostname, issue = (setting(f"BR2_TARGET_GENERIC_{name}") for name in ("HOSTNAME", "ISSUE"))
    (etc / "hostname").write_text(f"{hostname}\n", encoding="utf-8")
    (etc / "issue").write_text(f"{issue}\n", encoding="utf-8")
    append(etc / "hosts", [f"127.0.1.1\t{hostname}"])


# ---- files ---------------------------------------------------------------------------------------


def copy(source: Path, target: Path) -> None:
    """A file's content under this name; for all to read, to be run by all if its owner runs it."""
    if not source.is_file():
        raise UnusableInput(f"{source} is not there")
    target.parent.mkdir(parents=True, exist_ok=True)
    target.unlink(missing_ok=True)
    shutil.copyfile(source, target)
    target.chmod(0o755 if source.stat().st_mode & 0o100 else 0o644)


def copy_tree(source: Path, target: Path) -> None:
    for file in sorted(source.rglob("*")):
        if not file.is_dir():
            copy(file, target / file.relative_to(source))


def link(target: Path, to: str) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    target.unlink(missing_ok=True)
    target.symlink_to(to)


def add_busybox(busybox: Path, root: Path) -> None:
    """The program and a link for each applet, the folders being those that BusyBox names."""
    copy(busybox / "busybox", root / "bin/busybox")
    for applet in (busybox / "busybox.links").read_text(encoding="utf-8").split():
        link(root / applet.lstrip("/"), "/bin/busybox")


# ---- libraries -----------------------------------------------------------------------------------


def libraries_of(program: Path) -> list[str]:
    """The libraries that an ELF file names."""
    done = subprocess.run(["readelf", "--dynamic", "--wide", program], capture_output=True, text=True)
    if done.returncode:
        raise UnusableInput(f"readelf cannot read {program}: {done.stderr.strip()}")
    return re.findall(r"\(NEEDED\).*\[(.+)\]", done.stdout)


def programs_in(root: Path) -> Iterator[Path]:
    for file in sorted(root.rglob("*")):
        if file.is_file() and not file.is_symlink():
            with file.open("rb") as opened:
                if opened.read(len(ELF)) == ELF:
                    yield file


def add_libraries(root: Path, packages: Path, more: Sequence[str]) -> None:
    """Those that programs of the root name, those that these name, and so on."""
    waiting = {name: "system.toml" for name in more}
    waiting |= {name: str(file) for file in programs_in(root) for name in libraries_of(file)}
    done: set[str] = set()
    while waiting:
        name, wanted_by = waiting.popitem()
        if name in done:
            continue
        done.add(name)
        library = _find_library(name, packages, wanted_by)
        copy(packages / library, root / library)
        (root / library).chmod(0o755)
        waiting |= {each: name for each in libraries_of(root / library)}


def _find_library(name: str, packages: Path, wanted_by: str) -> str:
    for folder in LIBRARY_FOLDERS:
        if (packages / folder / name).exists():
            return f"{folder}/{name}"
    raise UnusableInput(
        f"{wanted_by} needs {name}, and no package has it: name its package in {TABLE.relative_to(ROOT)}, "
        "[libraries]"
    )


# ---- all of it -----------------------------------------------------------------------------------


def make_root(
    table: Table,
    packages: Path,
    busybox: Path,
    chrony: Path,
    gateway: Path,
    root: Path,
    swupdate: Path | None = None,
    curl: Path | None = None,
) -> None:
    """Fills `root`, which must be empty, with everything but a site's settings (post-build.sh)."""
    for path, permissions in table.folders.items():
        (root / path).mkdir(parents=True, exist_ok=True)
        (root / path).chmod(permissions)
    copy_tree(BOARD / "skeleton", root)
    copy_tree(BOARD / "rootfs-overlay", root)
    copy(PACKAGE / "S80rtud", root / "etc/init.d/S80rtud")
    (root / "etc/init.d/S80rtud").chmod(0o755)
    add_busybox(busybox, root)
    copy_tree(chrony / "root", root)
    copy_tree(gateway, root)
    if swupdate:
        copy_tree(swupdate / "root", root)
    if curl:
        copy_tree(curl / "root", root)
    for files in (table.programs | (table.pull_programs if curl else {})).values():
        for file in files:
            copy(packages / file, root / file)
    for path, to in table.links.items():
        link(root / path, to)
    add_libraries(root, packages, table.more_libraries)
    name_system(root / "etc")
    add_users(root / "etc", [*users_of(USERS), *users_of(PACKAGE / "openrtu.mk")])
    (root / "etc/shadow").chmod(0o600)


# ---- what a site asks for ------------------------------------------------------------------------


def needs_openssl(site: Path) -> bool:
    """Whether its gateway does, for TLS, SNMPv3 or the page."""
    configuration = read_configuration(site)
    programs = needed(configuration)
    keys = {"tls", "outstations_tls"}
    return not keys.isdisjoint(configuration) or any(
        each.endswith(TLS) or each in WITH_OPENSSL for each in programs
    )


def main(words: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="rootfs", description="Put the root file system together.")
    commands = parser.add_subparsers(dest="command", required=True)
    packages = commands.add_parser("packages", help="print the Debian packages that it takes files of")
    packages.add_argument("--without-tls", action="store_true", help="for a gateway without OpenSSL")
    packages.add_argument("--without-update", action="store_true", help="for an image without SWUpdate")
    packages.add_argument("--without-pull", action="store_true", help="for an image that asks no server")
    gateway = commands.add_parser("gateway", help="print which gateway a site needs: gateway or gateway-tls")
    gateway.add_argument("site", type=Path, help="the folder with its settings")
    make = commands.add_parser("make", help="fill an empty folder")
    make.add_argument("--packages", type=Path, required=True, metavar="DIR", help="the packages, unpacked")
    make.add_argument(
        "--busybox", type=Path, required=True, metavar="DIR", help="busybox of build-for-board.sh"
    )
    make.add_argument(
        "--chrony", type=Path, required=True, metavar="DIR", help="chrony of build-for-board.sh"
    )
    make.add_argument("--gateway", type=Path, required=True, metavar="DIR", help="where it was installed to")
    make.add_argument("--swupdate", type=Path, metavar="DIR", help="swupdate of build-for-board.sh")
    make.add_argument("--curl", type=Path, metavar="DIR", help="curl of build-for-board.sh")
    make.add_argument("root", type=Path, help="the folder")
    arguments = parser.parse_args(words)
    try:
        table = read_table(TABLE)
        if arguments.command == "packages":
            without = arguments.without_tls, arguments.without_update, arguments.without_pull
            print(*table.packages(*(not each for each in without)))
        elif arguments.command == "gateway":
            print("gateway-tls" if needs_openssl(arguments.site) else "gateway")
        else:
            make_root(
                table,
                arguments.packages,
                arguments.busybox,
                arguments.chrony,
                arguments.gateway,
                arguments.root,
                arguments.swupdate,
                arguments.curl,
            )
    except UnusableInput as error:
        print(f"rootfs: {error}", file=sys.stderr)
        return 2
    except OSError as error:
        print(f"rootfs: {error.filename}: {error.strerror}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
