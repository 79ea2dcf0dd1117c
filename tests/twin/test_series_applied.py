# SPDX-License-Identifier: GPL-3.0-or-later
"""`make series` for QEMU and U-Boot: their own checks are quiet, and git makes of it what we build."""

import re
import subprocess
from pathlib import Path

import pytest

from rig import git_am
from series import series_of

_, *QEMU = series_of("qemu").mails(0)
_, *UBOOT = series_of("uboot").mails(0)


def checkpatch(source: Path, folder: Path, mail: tuple[str, str], *options: str) -> list[str]:
    """What a project's own check says of a patch as it would be sent.

    Not that MAINTAINERS might need an entry for each new file: one patch adds patterns for all.
    """
    name, text = mail
    (folder / name).write_text(text)
    ran = subprocess.run(
        ["perl", "scripts/checkpatch.pl", "--terse", "--no-summary", *options, folder / name],
        cwd=source, capture_output=True, text=True,
    )  # fmt: skip
    assert ran.returncode in (0, 1), ran.stderr
    return [line for line in ran.stdout.splitlines() if not line.endswith("does MAINTAINERS need updating?")]


@pytest.mark.parametrize("mail", QEMU, ids=lambda mail: mail[0][:4])
def test_qemus_check_says_nothing(qemu_source: Path, tmp_path: Path, mail: tuple[str, str]) -> None:
    assert checkpatch(qemu_source, tmp_path, mail) == []


@pytest.mark.parametrize("mail", UBOOT, ids=lambda mail: mail[0][:4])
def test_uboots_check_says_nothing(uboot_source: Path, tmp_path: Path, mail: tuple[str, str]) -> None:
    """But of the device trees, whose comments name the sources of the pin table: docs/upstreaming.md."""
    said = checkpatch(uboot_source, tmp_path, mail, "--strict")
    of_trees = re.compile(r"WARNING: line length of \d+ exceeds 100 columns$")
    assert [line for line in said if "-arm-dts-" not in line or not of_trees.search(line)] == []


def test_a_check_would_speak(qemu_source: Path, uboot_source: Path, tmp_path: Path) -> None:
    for source, (name, text) in ((qemu_source, QEMU[-1]), (uboot_source, UBOOT[-1])):
        faulty = name, text.replace("Signed-off-by", "Signed-of-by")
        assert any("Missing Signed-off-by" in line for line in checkpatch(source, tmp_path, faulty))


def test_qemu_takes_its_series(qemu_source: Path, tmp_path: Path) -> None:
    series = series_of("qemu")
    repository = git_am.applied(tmp_path, series, qemu_source.parent / "debian")
    git_am.check(repository, series, qemu_source)


def test_uboot_takes_its_series(uboot_source: Path, tmp_path: Path) -> None:
    series = series_of("uboot")
    repository = git_am.applied(tmp_path, series, uboot_source.parent / "debian")
    git_am.check(repository, series, uboot_source)
