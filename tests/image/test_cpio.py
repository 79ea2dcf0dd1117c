# SPDX-License-Identifier: GPL-3.0-or-later
"""The archive of a root file system, read back by GNU cpio."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from image.cpio import Entry, archive, entries_of

SCRIPTS = Path(__file__).resolve().parents[2] / "scripts"


@pytest.fixture
def root(tmp_path: Path) -> Path:
    folder = tmp_path / "root"
    (folder / "bin").mkdir(parents=True)
    (folder / "bin/odd").write_bytes(b"abc")
    (folder / "bin/odd").chmod(0o750)
    (folder / "bin").chmod(0o755)
    (folder / "bin.conf").write_text("sorted between bin and bin/odd as text, not as a path")
    (folder / "dev").mkdir()
    (folder / "sh").symlink_to("bin/odd")
    return folder


def packed(root: Path) -> bytes:
    return archive(entries_of(root))


def test_all_is_there_and_belongs_to_root(root: Path) -> None:
    names = subprocess.run(["cpio", "-t", "--quiet"], input=packed(root), capture_output=True, check=True)
    assert names.stdout.decode().split() == [".", "dev", "dev/console", "bin", "bin/odd", "bin.conf", "sh"]
    text = subprocess.run(
        ["cpio", "-tv", "-n", "--quiet"], input=packed(root), capture_output=True, check=True
    ).stdout.decode()
    rows = {line.split()[-1]: line.split() for line in text.splitlines() if " -> " not in line}
    assert {tuple(row[2:4]) for row in rows.values()} == {("0", "0")}
    assert rows["dev/console"][0] == "crw-------"
    assert [word.strip(",") for word in rows["dev/console"][4:6]] == ["5", "1"]
    assert (rows["bin"][0], rows["bin/odd"][0], rows["bin/odd"][4]) == ("drwxr-xr-x", "-rwxr-x---", "3")
    assert " sh -> bin/odd" in text


def test_content_comes_back(root: Path, tmp_path: Path) -> None:
    back = tmp_path / "back"
    back.mkdir()
    without_device = archive(entry for entry in entries_of(root) if entry.device == (0, 0))
    subprocess.run(["cpio", "-i", "--quiet"], cwd=back, input=without_device, check=True)
    assert subprocess.run(["diff", "-r", root, back], check=False).returncode == 0


def test_same_content_is_the_same_bytes(root: Path, tmp_path: Path) -> None:
    first = packed(root)
    again = tmp_path / "again"
    subprocess.run(["cp", "-r", root, again], check=True)
    (again / "bin/odd").unlink()
    (again / "bin/odd").write_bytes(b"abc")
    (again / "bin/odd").chmod(0o750)
    os.utime(again / "bin.conf", (1, 1))
    assert packed(again) == first
    (again / "bin/odd").write_bytes(b"abd")
    assert packed(again) != first


def test_two_archives_in_a_row_are_one_to_the_kernel(root: Path) -> None:
    """Each ends on a block, where the kernel looks for the next magic."""
    assert len(packed(root)) % 512 == 0
    assert len(archive([Entry.file("a", "b")])) % 512 == 0


def test_what_cannot_be_packed_is_said(root: Path, tmp_path: Path) -> None:
    os.mkfifo(root / "pipe")
    for folder in (root, tmp_path / "nowhere"):
        done = subprocess.run(
            [sys.executable, "-m", "image.cpio", folder, tmp_path / "x"],
            cwd=SCRIPTS,
            capture_output=True,
            text=True,
            check=False,
        )
        assert (done.returncode, done.stderr[:6]) == (2, "cpio: ")
