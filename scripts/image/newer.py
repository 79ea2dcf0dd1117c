# SPDX-License-Identifier: GPL-3.0-or-later
"""
newer.py: newer patch releases of what the images are made of: Linux 6.1 with its PREEMPT_RT patch, and
Buildroot within its series. Says what changed; with --write also moves the tree to them, with commits and
hashes.

The hashes are those that kernel.org publishes, fetched over TLS; gpg is not asked. Exit codes: 0 nothing
newer, or written; 1 something is newer; 2 a server or the tree cannot be read.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import urllib.error
import urllib.request
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from image.checks import value_of
from nuc980.errors import UnusableInput

ROOT = Path(__file__).resolve().parents[2]
KERNEL_ORG = "https://cdn.kernel.org/pub/linux/kernel"
SERIES = "6.1"
LTS = Path("configs/nuc980_gateway_lts_defconfig")
KAS = Path("configs/kas.yml")
HASHES = Path(f"patches/linux/{SERIES}/linux.hash")
PAGE = Path("docs/defconfig.md")
SECONDS = 60
SUM = re.compile(r"^([0-9a-f]{64})  (\S+)$", re.MULTILINE)
RT = re.compile(rf"patch-({re.escape(SERIES)}\.(\d+)-rt(\d+))\.patch\.xz")
# Subjects of commits that reach what the board has: its core, flash, network, lines, watchdog, clock.
OURS = re.compile(
    r"(arm|mtd|ubi|ubifs|net|ipv4|ipv6|tcp|serial|tty|watchdog|rtc|pinctrl|gpio|dmaengine|sched|timers?|"
    r"hrtimer|locking|futex|rcu|seccomp|ext4|tmpfs|mm)\b",
    re.IGNORECASE,
)


@dataclass(frozen=True)
class Linux:
    """A release, its PREEMPT_RT patch, their hashes."""

    version: str
    patch: str  # its URL
    archive_sum: str
    patch_sum: str


@dataclass(frozen=True)
class Buildroot:
    tag: str
    commit: str


def fetch(url: str) -> str:
    try:
        with urllib.request.urlopen(url, timeout=SECONDS) as answer:
            return answer.read().decode("utf-8", errors="replace")
    except (urllib.error.URLError, TimeoutError, OSError) as error:
        raise UnusableInput(
            f"{url}: {error}", next_step="check the network and the proxy (https_proxy)"
        ) from error


def number(version: str) -> tuple[int, ...]:
    """
    >>> number("6.1.141-rt52") > number("6.1.99-rt60")
    True
    """
    return tuple(map(int, re.findall(r"\d+", version)))


# ---- what there is


def newest_linux(kernel_org: str) -> Linux:
    """The newest release that has both a PREEMPT_RT patch and an archive with published hashes."""
    archives = {name: sha for sha, name in SUM.findall(fetch(f"{kernel_org}/v6.x/sha256sums.asc"))}
    found = []
    for folder in (f"{kernel_org}/projects/rt/{SERIES}", f"{kernel_org}/projects/rt/{SERIES}/older"):
        for sha, name in SUM.findall(fetch(f"{folder}/sha256sums.asc")):
            archive = f"linux-{SERIES}.{match[2]}.tar.xz" if (match := RT.fullmatch(name)) else ""
            if match and archive in archives:
                linux = Linux(f"{SERIES}.{match[2]}", f"{folder}/{name}", archives[archive], sha)
                found.append((number(match[1]), linux))
    if not found:
        raise UnusableInput(f"{kernel_org} lists no PREEMPT_RT patch for a release of {SERIES}")
    # The last is in both folders: that in older stays where it is.
    return max(found, key=lambda each: (each[0], "older" in each[1].patch))[1]


def newest_buildroot(repository: str, series: str) -> Buildroot:
    done = subprocess.run(
        ["git", "ls-remote", "--tags", repository, f"{series}*"], capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise UnusableInput(
            f"{repository}: {done.stderr.strip()}", next_step="check the network and git's proxy (http.proxy)"
        )
    # Of an annotated tag the second line, with ^{}, has the commit.
    tags = dict(line.split("\trefs/tags/")[::-1] for line in done.stdout.splitlines())
    releases = [tag for tag in tags if re.fullmatch(rf"{re.escape(series)}(\.\d+)?", tag)]
    if not releases:
        raise UnusableInput(f"{repository} has no release of {series}")
    tag = max(releases, key=number)
    return Buildroot(tag, tags.get(f"{tag}^{{}}", tags[tag]))


# ---- what the tree has


def _found(root: Path, file: Path, pattern: str) -> str:
    match = re.search(pattern, (root / file).read_text(encoding="utf-8"), re.MULTILINE)
    if not match:
        raise UnusableInput(f"{file} has no line as {pattern}")
    return match[1]


def present_linux(root: Path) -> tuple[str, str]:
    """Its release, and the URL of its patch."""
    version, patch = (
        value_of(root / LTS, symbol)
        for symbol in ("BR2_LINUX_KERNEL_CUSTOM_VERSION_VALUE", "BR2_LINUX_KERNEL_PATCH")
    )
    return version, patch


def present_buildroot(root: Path) -> tuple[str, Buildroot]:
    """Its repository, and what is pinned."""
    url, tag, commit = (
        _found(root, KAS, pattern)
        for pattern in (r"^ *url: (\S+)$", r"^ *tag: \"?([\d.]+)\"?$", r"^ *commit: (\w+)$")
    )
    return url, Buildroot(tag, commit)


# ---- what changed


def linux_changes(kernel_org: str, old: str, new: str) -> Iterator[str]:
    first, last = number(old)[2], number(new)[2]
    for patch in range(first + 1, last + 1):
        text = fetch(f"{kernel_org}/v6.x/ChangeLog-{SERIES}.{patch}")
        subjects = re.findall(r"^commit [0-9a-f]{40}\n(?:[A-Z].*\n)+\n    (.+)$", text, re.MULTILINE)
        ours = [subject for subject in subjects if OURS.match(subject)]
        yield f"Linux {SERIES}.{patch}: {len(subjects)} commits, {len(ours)} of them near the board:"
        yield from (f"  {subject}" for subject in ours)


# ---- the tree moved


def replaced(root: Path, file: Path, *pairs: tuple[str, str]) -> None:
    text = (root / file).read_text(encoding="utf-8")
    for old, new in pairs:
        if old not in text:
            raise UnusableInput(f"{file} has no {old}; nothing in it was changed")
        text = text.replace(old, new)
    (root / file).write_text(text, encoding="utf-8")


def write_linux(root: Path, new: Linux) -> None:
    version, patch = present_linux(root)
    before, name = patch.rpartition("/")[2], new.patch.rpartition("/")[2]
    sums = {
        file: sha for sha, file in re.findall(r"^sha256  (\w{64})  (\S+)$", (root / HASHES).read_text(), re.M)
    }
    archive = f"linux-{version}.tar.xz"
    if archive not in sums or before not in sums:
        raise UnusableInput(f"{HASHES} has no hash of {archive} and {before}: nothing was changed")
    origin = _found(root, HASHES, r"^((?:# (?!SPDX).*\n)+)sha256")
    replaced(
        root,
        HASHES,
        (origin, "# kernel.org's Linux and its PREEMPT_RT patch; the hashes are of its sha256sums.asc.\n"),
        (sums[archive], new.archive_sum),
        (sums[before], new.patch_sum),
        (archive, f"linux-{new.version}.tar.xz"),
        (before, name),
    )
    replaced(root, LTS, (f'"{version}"', f'"{new.version}"'), (patch, new.patch))
    replaced(root, PAGE, (patch, new.patch), (version, new.version))
    link = root / "patches/linux" / version
    link.unlink(missing_ok=True)
    (root / "patches/linux" / new.version).symlink_to(SERIES)


def main(words: Sequence[str] | None = None, root: Path = ROOT) -> int:
    parser = argparse.ArgumentParser(prog="newer", description="Find newer patch releases, and move to them.")
    parser.add_argument("--write", action="store_true", help="change configs, hashes and pages")
    parser.add_argument("--kernel-org", default=KERNEL_ORG, metavar="URL", help=f"[{KERNEL_ORG}]")
    parser.add_argument("--buildroot", metavar="URL", help="its repository [that of configs/kas.yml]")
    given = parser.parse_args(words)
    try:
        return _run(root, given)
    except UnusableInput as error:
        print(f"newer: {error}", file=sys.stderr)
        return 2


def _run(root: Path, given: argparse.Namespace) -> int:
    version, patch = present_linux(root)
    linux = newest_linux(given.kernel_org)
    repository, pinned = present_buildroot(root)
    buildroot = newest_buildroot(given.buildroot or repository, ".".join(pinned.tag.split(".")[:2]))
    newer_linux = number(linux.patch.rpartition("/")[2]) > number(patch.rpartition("/")[2])
    newer_buildroot = number(buildroot.tag) > number(pinned.tag)
    print(f"Linux with PREEMPT_RT: {patch.rpartition('/')[2]}, newest {linux.patch.rpartition('/')[2]}")
    print(f"Buildroot: {pinned.tag}, newest {buildroot.tag}")
    if newer_linux:
        for line in linux_changes(given.kernel_org, version, linux.version):
            print(line)
    if newer_buildroot:
        print(f"Buildroot {buildroot.tag} is {buildroot.commit}; its file CHANGES says what is new.")
    if not given.write:
        return int(newer_linux or newer_buildroot)
    if newer_linux:
        write_linux(root, linux)
        print(f"{LTS}, {HASHES}, {PAGE} and the link in patches/linux are for {linux.version} now.")
    if newer_buildroot:
        replaced(root, KAS, (pinned.commit, buildroot.commit), (f'"{pinned.tag}"', f'"{buildroot.tag}"'))
        print(f'{KAS} is for {buildroot.tag} now. Go on with docs/image-buildroot.md, "Update Buildroot".')
    return 0


if __name__ == "__main__":
    sys.exit(main())
