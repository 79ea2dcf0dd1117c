# SPDX-License-Identifier: GPL-3.0-or-later
"""A site's MAC addresses on their way into the device tree: for our kernel, and for the vendor's."""

import os
import shutil
import subprocess
from pathlib import Path

import libfdt
import pytest

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = ROOT / "board/nuc980/place-macs.sh"
MACS = ("02:00:00:00:00:0A", "02:00:00:00:00:0b")
FILE = f"eth0 {MACS[0]}\neth1 {MACS[1]}\n"


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    tree = tmp_path_factory.mktemp("dtb") / "board.dtb"
    source = ROOT / "dts/nuvoton/nuc980-gateway.dts"
    subprocess.run([ROOT / "scripts/build-dtb.sh", source, tree], check=True, capture_output=True)
    return tree


@pytest.fixture
def tree(compiled: Path, tmp_path: Path) -> Path:
    return Path(shutil.copy(compiled, tmp_path))


def place(tree: Path, macs: str | None) -> subprocess.CompletedProcess[str]:
    """Runs the script for a site that has this file; for no site when there is none."""
    site = tree.parent / "a site"
    site.mkdir(exist_ok=True)
    if macs is not None:
        (site / "macs").write_text(macs)
    environment = {**os.environ, "SITE_SETTINGS": "" if macs is None else str(site)}
    environment.pop("HOST_DIR", None)
    return subprocess.run([SCRIPT, tree], env=environment, capture_output=True, text=True, check=False)


def arguments(tree: Path) -> str | None:
    fdt = libfdt.Fdt(tree.read_bytes())
    chosen = fdt.path_offset("/chosen")
    return fdt.getprop(chosen, "bootargs").as_str() if fdt.hasprop(chosen, "bootargs") else None


def addresses(tree: Path, ports: int = 2) -> list[bytes | None]:
    """What the ports' nodes have."""
    fdt = libfdt.Fdt(tree.read_bytes())
    nodes = [fdt.path_offset(fdt.get_alias(f"ethernet{n}")) for n in range(ports)]
    name = "local-mac-address"
    return [bytes(fdt.getprop(node, name)) if fdt.hasprop(node, name) else None for node in nodes]


def test_both_kernels_find_them(tree: Path) -> None:
    assert place(tree, FILE).stderr == ""
    assert arguments(tree) == f"ethaddr0={MACS[0]} ethaddr1={MACS[1]}"
    assert addresses(tree) == [bytes.fromhex(mac.replace(":", "")) for mac in MACS]


def test_another_site_and_none(tree: Path) -> None:
    """What was there before goes, and only that."""
    subprocess.run(["fdtput", "-t", "s", tree, "/chosen", "bootargs", "quiet mem=64M"], check=True)
    place(tree, FILE)
    place(tree, FILE.replace(":0A", ":1A").replace(":0b", ":1b"))
    assert arguments(tree) == "quiet mem=64M ethaddr0=02:00:00:00:00:1A ethaddr1=02:00:00:00:00:1b"
    assert addresses(tree)[1] == bytes.fromhex("02000000001b")
    (tree.parent / "a site/macs").unlink()
    assert place(tree, None).returncode == 0
    assert (arguments(tree), addresses(tree)) == ("quiet mem=64M", [None, None])


def test_board_with_one_port(tmp_path: Path) -> None:
    tree = tmp_path / "board.dtb"
    source = ROOT / "dts/nuvoton/nuc980-numaker.dts"
    subprocess.run([ROOT / "scripts/build-dtb.sh", source, tree], check=True, capture_output=True)
    assert (place(tree, FILE).returncode, place(tree, FILE).stderr) == (0, "")
    assert addresses(tree, 1) == [bytes.fromhex(MACS[0].replace(":", ""))]
    (tree.parent / "a site/macs").unlink()
    assert (place(tree, None).returncode, place(tree, None).stderr) == (0, "")
    assert addresses(tree, 1) == [None]


@pytest.mark.parametrize(
    ("macs", "why"),
    [
        ("eth0 02:00:00:00:00:01\n", 'no line "eth1 XX'),
        (FILE.replace("0b", "0a"), "gives both ports"),
        (FILE.replace("0b", "b"), 'it is "02:00:00:00:00:b"'),
        (FILE.replace("02:", "03:"), 'it is "03:'),  # a group's
        ("", 'no line "eth0 XX'),
    ],
)
def test_unusable_addresses_change_nothing(tree: Path, macs: str, why: str) -> None:
    before = tree.read_bytes()
    done = place(tree, macs)
    assert done.returncode != 0
    assert why in done.stderr
    assert tree.read_bytes() == before
