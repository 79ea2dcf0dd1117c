# SPDX-License-Identifier: GPL-3.0-or-later
"""A site's MAC addresses on their way into the device tree."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

SCRIPT = Path(__file__).resolve().parents[2] / "board" / "nuc980" / "place-macs.sh"
TREE = """/dts-v1/;
/ {
	aliases { ethernet0 = "/first@1"; ethernet1 = "/second@2"; };
	chosen { bootargs = "quiet"; };
	first@1 { };
	second@2 { };
};
"""
MACS = "eth0 02:00:00:00:00:0A\neth1 02:00:00:00:00:02\n"


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    source, compiled = tmp_path / "tree.dts", tmp_path / "tree.dtb"
    source.write_text(TREE)
    subprocess.run(["dtc", "-q", "-O", "dtb", "-o", compiled, source], check=True)
    return compiled


def place(tree: Path, macs: str | None) -> subprocess.CompletedProcess[str]:
    site = tree.parent / "a site"
    site.mkdir(exist_ok=True)
    (site / "macs").write_text(macs or "")
    environment = {name: value for name, value in os.environ.items() if name != "HOST_DIR"}
    environment["OPENRTU_SITE"] = str(site) if macs is not None else ""
    return subprocess.run([SCRIPT, tree], env=environment, capture_output=True, text=True, check=False)


def value(tree: Path, *words: str) -> str:
    done = subprocess.run(
        ["fdtget", "-d", "none", *words[:-2], tree, *words[-2:]], capture_output=True, text=True
    )
    return done.stdout.strip()


def addresses(tree: Path) -> list[str]:
    return [value(tree, "-t", "bx", node, "local-mac-address") for node in ("/first@1", "/second@2")]


def test_both_kernels_find_them(tree: Path) -> None:
    assert place(tree, MACS).returncode == 0
    assert addresses(tree) == ["2 0 0 0 0 a", "2 0 0 0 0 2"]
    assert value(tree, "/chosen", "bootargs") == (
        "quiet ethaddr0=02:00:00:00:00:0A ethaddr1=02:00:00:00:00:02"
    )


def test_those_of_another_site_do_not_stay(tree: Path) -> None:
    place(tree, MACS)
    assert place(tree, None).returncode == 0
    assert addresses(tree) == ["none", "none"]
    assert value(tree, "/chosen", "bootargs") == "quiet"


@pytest.mark.parametrize(
    "macs",
    [
        "",
        "eth0 02:00:00:00:00:01\n",
        "eth0 01:00:00:00:00:01\neth1 02:00:00:00:00:02\n",
        "eth0 02:00:00:00:00:1\neth1 02:00:00:00:00:02\n",
        "eth0 02:00:00:00:00:0a\neth1 02:00:00:00:00:0A\n",
    ],
)
def test_what_no_board_may_have_is_refused_and_changes_nothing(tree: Path, macs: str) -> None:
    before = tree.read_bytes()
    done = place(tree, macs)
    assert done.returncode != 0
    assert done.stderr.startswith("macs: ")
    assert tree.read_bytes() == before
