# SPDX-License-Identifier: GPL-3.0-or-later
"""Newer releases of Linux and Buildroot, from a server and a repository of this machine."""

from __future__ import annotations

import shutil
import subprocess
import threading
from collections.abc import Callable, Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from image.checks import CHECKS
from image.newer import KAS, LTS, main

ROOT = Path(__file__).resolve().parents[2]
OLD, NEW = "6.1.141", "6.1.150"
A, B, C, D = (letter * 64 for letter in "abcd")
CHANGES = """commit 0123456789abcdef0123456789abcdef01234567
Author: Somebody <somebody@example.net>
Date:   Thu Jan 1 00:00:00 2026 +0000

    {subject}

    commit 76543210 upstream.

"""


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    for name in ("configs", "patches", "docs", "board", "br2-external", "package", "mk", "Makefile"):
        source = ROOT / name
        if source.is_dir():
            ignored = shutil.ignore_patterns("src", "figures")
            shutil.copytree(source, tmp_path / "tree" / name, symlinks=True, ignore=ignored)
        else:
            shutil.copy(source, tmp_path / "tree" / name)
    return tmp_path / "tree"


def listed(sums: dict[str, str], kind: str) -> str:
    return "".join(f"{sha}  {name}.{kind}.xz\n" for name, sha in sums.items())


@pytest.fixture
def kernel_org(tmp_path: Path) -> Iterator[str]:
    """6.1.151 has no patch, the patch for 6.1.152 no archive; 150 is the newest with both."""
    pub = tmp_path / "pub"
    texts = {
        "v6.x/sha256sums.asc": listed({f"linux-{NEW}": A, "linux-6.1.151": B, f"linux-{OLD}": B}, "tar"),
        "projects/rt/6.1/sha256sums.asc": listed({f"patch-{NEW}-rt60": C, "patch-6.1.152-rt61": B}, "patch"),
        "projects/rt/6.1/older/sha256sums.asc": listed(
            {f"patch-{OLD}-rt52": B, f"patch-{NEW}-rt59": D, f"patch-{NEW}-rt60": C}, "patch"
        ),
    }
    for patch in range(142, 151):
        subject = "mtd: rawnand: wait long enough" if patch == 142 else "drm/amdgpu: shine brighter"
        texts[f"v6.x/ChangeLog-6.1.{patch}"] = CHANGES.format(subject=subject)
    for name, text in texts.items():
        (pub / name).parent.mkdir(parents=True, exist_ok=True)
        (pub / name).write_text(text)

    class Quiet(SimpleHTTPRequestHandler):
        def log_message(self, *_: object) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(pub))) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02})
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()
        thread.join()


Commit = Callable[[str], str]


@pytest.fixture
def buildroot(tmp_path: Path) -> tuple[Path, Commit]:
    """A repository with a release of another series, and what tags a commit of it."""
    folder = tmp_path / "buildroot"

    def git(*words: str) -> str:
        user = ("-c", "user.name=a", "-c", "user.email=a@example.net")
        done = subprocess.run(
            ["git", "-C", folder, *user, *words], check=True, capture_output=True, text=True
        )
        return done.stdout.strip()

    def release(tag: str) -> str:
        git("commit", "--quiet", "--allow-empty", "--message", tag)
        git("tag", "--annotate", "--message", tag, tag)
        return git("rev-parse", "HEAD")

    subprocess.run(["git", "init", "--quiet", folder], check=True)
    for tag in ("2026.02.3", "2026.05.1", "2026.02.10-rc1"):
        release(tag)
    return folder, release


def run(tree: Path, kernel_org: str, buildroot: Path, *words: str) -> int:
    return main(["--kernel-org", kernel_org, "--buildroot", str(buildroot), *words], tree)


def test_what_is_newer_is_said_and_nothing_is_changed(
    tree: Path, kernel_org: str, buildroot: tuple[Path, Commit], capsys: pytest.CaptureFixture[str]
) -> None:
    before = {file: file.read_bytes() for file in tree.rglob("*") if file.is_file()}
    commit = buildroot[1]("2026.02.11")
    assert run(tree, kernel_org, buildroot[0]) == 1
    output = capsys.readouterr().out
    assert f"patch-{OLD}-rt52.patch.xz, newest patch-{NEW}-rt60.patch.xz" in output
    assert "Linux 6.1.142: 1 commits, 1 of them near the board:\n  mtd: rawnand: wait long enough\n" in output
    assert "amdgpu" not in output
    assert f"Buildroot 2026.02.11 is {commit}" in output
    assert {file: file.read_bytes() for file in tree.rglob("*") if file.is_file()} == before


def test_tree_that_moved_is_sound(
    tree: Path, kernel_org: str, buildroot: tuple[Path, Commit], capsys: pytest.CaptureFixture[str]
) -> None:
    commit = buildroot[1]("2026.02.11")
    assert run(tree, kernel_org, buildroot[0], "--write") == 0
    patch = f"{kernel_org}/projects/rt/6.1/older/patch-{NEW}-rt60.patch.xz"
    assert f'BR2_LINUX_KERNEL_CUSTOM_VERSION_VALUE="{NEW}"' in (tree / LTS).read_text()
    assert f'BR2_LINUX_KERNEL_PATCH="{patch}"' in (tree / LTS).read_text()
    hashes = (tree / "patches/linux" / NEW / "linux.hash").read_text()
    assert f"sha256  {A}  linux-{NEW}.tar.xz\nsha256  {C}  patch-{NEW}-rt60.patch.xz\n" in hashes
    assert "NixOS" not in hashes
    assert not (tree / "patches/linux" / OLD).is_symlink()
    assert f'tag: "2026.02.11"\n    commit: {commit}\n' in (tree / KAS).read_text()
    for check in CHECKS:
        if check.__name__ in ("check_pinned", "check_explained", "check_parts"):
            assert check(tree) == []
    assert run(tree, kernel_org, buildroot[0]) == 0, "nothing is newer now"


def test_nothing_newer(tree: Path, kernel_org: str, buildroot: tuple[Path, Commit], tmp_path: Path) -> None:
    for file in tmp_path.glob("pub/projects/rt/6.1/**/sha256sums.asc"):
        file.write_text(f"{B}  patch-{OLD}-rt52.patch.xz\n")
    assert run(tree, kernel_org, buildroot[0]) == 0


def test_server_that_is_not_there(
    tree: Path, buildroot: tuple[Path, Commit], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(tree, "http://127.0.0.1:1", buildroot[0]) == 2
    assert "check the network and the proxy" in capsys.readouterr().err


def test_listing_without_releases(
    tree: Path,
    kernel_org: str,
    buildroot: tuple[Path, Commit],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "pub/v6.x/sha256sums.asc").write_text("<html>not here</html>")
    assert run(tree, kernel_org, buildroot[0], "--write") == 2
    assert "lists no PREEMPT_RT patch" in capsys.readouterr().err
