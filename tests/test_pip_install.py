# SPDX-License-Identifier: GPL-3.0-or-later
"""The Python tools as pip installs them: in an environment of their own, away from the tree."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from test_version import VERSION

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="module")
def tools(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the installed programs."""
    environment = tmp_path_factory.mktemp("pip") / "venv"
    for command in (
        [sys.executable, "-m", "venv", environment],
        [environment / "bin/pip", "install", "--quiet", "--disable-pip-version-check", f"{ROOT}[nuc980]"],
    ):
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
    return environment / "bin"


@pytest.fixture
def elsewhere(tmp_path: Path) -> Path:
    """Device trees as another project has them."""
    shutil.copytree(ROOT / "dts/nuvoton", tmp_path / "dts")
    shutil.copy(ROOT / "docs/examples/sd-host-on.dts", tmp_path)
    return tmp_path


def run(tools: Path, cwd: Path, name: str, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [tools / name, *words], cwd=cwd, capture_output=True, text=True, timeout=120, check=False
    )


def test_version(tools: Path, tmp_path: Path) -> None:
    for name in ("openrtu", "nuc980-pins", "nuc980-netboot"):
        assert run(tools, tmp_path, name, "--version").stdout == f"{name} (OpenRTU) {VERSION}\n"


def test_pins_finds_what_it_finds_in_the_tree(tools: Path, elsewhere: Path) -> None:
    good = run(tools, elsewhere, "nuc980-pins", "check", "dts/nuc980-gateway.dts")
    assert (good.returncode, good.stdout) == (0, "dts/nuc980-gateway.dts: no findings\n")
    bad = run(tools, elsewhere, "nuc980-pins", "check", "--chip-only", "-I", "dts", "sd-host-on.dts")
    assert bad.returncode == 1
    assert "pin-conflict: sdh and emac1 both have PF0 to PF6" in bad.stdout


def test_pins_has_its_templates_and_tables(tools: Path, elsewhere: Path) -> None:
    """Of each file that comes with the package, something that needs it."""
    assert "unknown-property" in run(tools, elsewhere, "nuc980-pins", "explain", "rules").stdout
    assert "LQFP128 116 (this board)" in run(tools, elsewhere, "nuc980-pins", "explain", "PE11").stdout
    for words in (("map", "-o", "pins.html"), ("generate", "--linux", "pins.h")):
        done = run(tools, elsewhere, "nuc980-pins", *words)
        assert (done.returncode, done.stderr) == (0, "")
        assert (elsewhere / words[2]).stat().st_size > 10_000


def test_pins_generates_in_a_clone_only(tools: Path, elsewhere: Path) -> None:
    done = run(tools, elsewhere, "nuc980-pins", "generate")
    assert (done.returncode, done.stdout) == (2, "")
    assert "run scripts/nuc980-pins there" in done.stderr


def test_netboot_plans_a_boot(tools: Path, elsewhere: Path) -> None:
    """A plan needs the board's limits, libfdt and the images' readers."""
    subprocess.run(
        ["mkimage", "-A", "arm", "-O", "linux", "-T", "kernel", "-C", "none", "-a", "0x8000", "-e", "0x8000",
         "-d", "sd-host-on.dts", "uImage"],
        cwd=elsewhere, check=True, capture_output=True,
    )  # fmt: skip
    with (elsewhere / "board.dtb").open("wb") as out:
        source = '/dts-v1/; / { memory { reg = <0 0x4000000>; }; chosen { bootargs = "console=ttyS0"; }; };'
        subprocess.run(["dtc", "-q", "-O", "dtb"], input=source.encode(), stdout=out, check=True)
    addresses = ["--board-ip", "192.168.1.20/24", "--server-ip", "192.168.1.1"]
    nat = ["--listen", "127.0.0.1", "--seen-as", "127.0.0.1"]
    words = ["boot", "--dry-run", *addresses, *nat, "uImage", "board.dtb"]
    done = run(tools, elsewhere, "nuc980-netboot", *words)
    in_tree = run(ROOT / "scripts", elsewhere, "nuc980-netboot", *words)
    assert (done.returncode, done.stderr) == (0, "")
    assert "bootm" in done.stdout
    mac = re.compile(r"(?:[0-9a-f]{2}:){5}[0-9a-f]{2}")  # made up for a board without one
    assert mac.sub("MAC", done.stdout) == mac.sub("MAC", in_tree.stdout)


def test_hooks_are_the_tools_own_commands(tools: Path, elsewhere: Path) -> None:
    """What pre-commit runs: each hook's entry, and the files it names, on a tree elsewhere."""
    for hook in yaml.safe_load((ROOT / ".pre-commit-hooks.yaml").read_text()):
        done = run(tools, elsewhere, *hook["entry"].split(), *hook.get("args", []), "dts/nuc980-gateway.dts")
        assert done.returncode == 0, done.stdout + done.stderr
