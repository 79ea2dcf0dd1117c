# SPDX-License-Identifier: GPL-3.0-or-later
"""The report of vulnerabilities, with a stand-in for Buildroot's cve-check; git is the real one."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import pytest

from image import cves

# Of the NVD it makes what the true one makes of it: vulnerabilities in CycloneDX, in the bill.
CVE_CHECK = """\
#!/usr/bin/env python3
import argparse, json, pathlib
parser = argparse.ArgumentParser()
parser.add_argument("--in-file", type=argparse.FileType("r"))
parser.add_argument("--nvd-path", type=pathlib.Path)
parser.add_argument("--no-nvd-update", action="store_true", required=True)
words = parser.parse_args()
bill = json.load(words.in_file)
found = [json.loads(file.read_text()) for file in (words.nvd_path / "git").rglob("CVE-*.json")]
print(json.dumps(bill | {"vulnerabilities": bill["vulnerabilities"] + found}))
"""
PATCHED = {
    "id": "CVE-2022-1",
    "analysis": {"state": "resolved_with_pedigree"},
    "affects": [{"ref": "busybox"}, {"ref": "virtual"}],
}
BILL = {
    "components": [
        {
            "bom-ref": "linux",
            "version": "d366b39",
            "cpe": "cpe:2.3:o:linux:linux_kernel:5.10.140:-:*:*:*:*:*:*",
        },
        {"bom-ref": "busybox", "version": "1.37.0", "cpe": "cpe:2.3:a:busybox:busybox:1.37.0:-:*:*:*:*:*:*"},
        {"bom-ref": "openrtu", "version": "1.0.0"},
        {"bom-ref": "host-flex", "version": "2.6.4", "properties": [{"name": "BR_TYPE", "value": "host"}]},
    ],
    "vulnerabilities": [PATCHED],
}


def vulnerability(name: str, ref: str, state: str = "exploitable", **rating: object) -> dict[str, Any]:
    return {"id": name, "ratings": [rating], "analysis": {"state": state}, "affects": [{"ref": ref}]}


class Desk:
    """A folder with Buildroot, a bill of materials and what is known of it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.bill = folder / "sbom.cdx.json"
        self.bill.write_text(json.dumps(BILL))
        self.nvd = folder / "nvd"
        self.tool = folder / "buildroot/support/scripts/cve-check"
        self.tool.parent.mkdir(parents=True)
        self.tool.write_text(CVE_CHECK)
        self.tool.chmod(0o755)
        self.origin = folder / "origin"
        (self.tool.parent / "cve.py").write_text(f'NVD_BASE_URL = "file://{self.origin}"\n')

    def knows(self, *known: dict[str, Any], below: str = "nvd/git") -> None:
        for each in known:
            file = self.folder / below / "CVE-2025/CVE-2025-00xx" / f"{each['id']}.json"
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(json.dumps(each))

    def publishes(self, *known: dict[str, Any], day: str) -> None:
        """Where it is fetched from."""
        self.knows(*known, below="origin")
        git(self.origin, "init", "--quiet")
        git(self.origin, "add", ".")
        git(self.origin, "commit", "--quiet", "-m", day, f"--date={day}T12:00", day=day)

    def report(self, *words: str) -> int:
        return cves.main([str(self.folder / "buildroot"), str(self.bill), str(self.nvd), *words])


def git(folder: Path, *words: str, day: str = "2026-01-01") -> None:
    author = ["-c", "user.name=x", "-c", "user.email=x@example.org", "-c", "commit.gpgsign=false"]
    environment = {"GIT_COMMITTER_DATE": f"{day}T12:00", "PATH": "/usr/bin:/bin"}
    subprocess.run(["git", *author, *words], cwd=folder, check=True, env=environment)


@pytest.fixture
def desk(tmp_path: Path) -> Desk:
    return Desk(tmp_path)


def test_open_ones_are_first_and_the_worst_of_them(desk: Desk, capsys: pytest.CaptureFixture[str]) -> None:
    desk.knows(
        vulnerability("CVE-2025-1", "linux", score=4.9),
        vulnerability("CVE-2025-2", "linux"),
        vulnerability("CVE-2025-3", "busybox", score=9.8, severity="critical"),
        vulnerability("CVE-2025-4", "busybox", state="in_triage", score=10, severity="critical"),
        vulnerability("CVE-2025-5", "host-flex", score=10, severity="critical"),
    )
    assert desk.report() == 1
    assert capsys.readouterr().out.splitlines() == [
        "component  version   CVE         severity  score  state",
        "busybox    1.37.0    CVE-2025-3  critical  9.8    open",
        "linux      5.10.140  CVE-2025-1  -         4.9    open",
        "linux      5.10.140  CVE-2025-2  -         -      open",
        "busybox    1.37.0    CVE-2025-4  critical  10     ignored by Buildroot",
        "busybox    1.37.0    CVE-2022-1  -         -      patched",
        "",
        "3 open, by the NVD of an unknown day: linux 2, busybox 1",
        "not looked up, for want of a CPE or a version: openrtu",
    ]
    written = json.loads((desk.folder / "cves.cdx.json").read_text())
    assert len(written["vulnerabilities"]) == 6


def test_none_open_is_0(desk: Desk, capsys: pytest.CaptureFixture[str]) -> None:
    desk.knows(vulnerability("CVE-2025-4", "linux", state="in_triage"))
    assert desk.report() == 0
    assert "0 open, by the NVD of an unknown day\n" in capsys.readouterr().out


def test_no_cves_is_no_report(desk: Desk, capsys: pytest.CaptureFixture[str]) -> None:
    (desk.nvd / "git/CVE-2025").mkdir(parents=True)
    assert desk.report() == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert f"next step: git clone --depth=1 file://{desk.origin} {desk.nvd}/git" in said.err


@pytest.mark.slow
def test_they_are_fetched_once_and_then_what_came_since(
    desk: Desk, capsys: pytest.CaptureFixture[str]
) -> None:
    desk.publishes(vulnerability("CVE-2025-1", "linux"), day="2026-11-20")
    assert desk.report("--fetch") == 1
    assert "1 open, by the NVD of 2026-11-20: linux 1" in capsys.readouterr().out
    desk.publishes(vulnerability("CVE-2025-2", "linux"), day="2026-11-21")
    assert desk.report("--fetch") == 1
    assert "2 open, by the NVD of 2026-11-21: linux 2" in capsys.readouterr().out


@pytest.mark.slow
def test_out_of_reach_says_how_without_network(desk: Desk, capfd: pytest.CaptureFixture[str]) -> None:
    assert desk.report("--fetch") == 2
    assert "next step: make cves NVD=folder takes those of a folder" in capfd.readouterr().err
    desk.publishes(vulnerability("CVE-2025-1", "linux"), day="2026-11-20")
    assert desk.report("--fetch") == 1
    desk.origin.rename(desk.folder / "gone")
    assert desk.report("--fetch") == 2
    assert f"next step: make cves NVD={desk.nvd} takes those that are there" in capfd.readouterr().err
    assert desk.report() == 1


def test_broken_copy_leaves_the_repository_around_it_alone(
    desk: Desk, capfd: pytest.CaptureFixture[str]
) -> None:
    desk.publishes(vulnerability("CVE-2025-1", "linux"), day="2026-11-20")
    tree = desk.folder / "tree"
    git(desk.folder, "clone", "--quiet", str(desk.origin), str(tree))
    desk.publishes(vulnerability("CVE-2025-2", "linux"), day="2026-11-21")
    desk.nvd = tree / "dl"
    (desk.nvd / "git/.git").mkdir(parents=True)
    assert desk.report("--fetch") == 2
    assert "git says why above" in capfd.readouterr().err
    assert not list(tree.rglob("CVE-2025-2.json"))


@pytest.mark.slow
def test_what_cve_check_fails_of_is_said(desk: Desk, capsys: pytest.CaptureFixture[str]) -> None:
    desk.knows(vulnerability("CVE-2025-1", "linux"))
    desk.bill.unlink()
    assert desk.report() == 2
    assert "cve-check failed: " in (said := capsys.readouterr().err)
    assert "No such file or directory" in said
    desk.tool.unlink()
    assert desk.report() == 2
    assert "name a checkout of Buildroot that has it" in capsys.readouterr().err
