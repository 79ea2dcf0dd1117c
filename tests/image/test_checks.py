# SPDX-License-Identifier: GPL-3.0-or-later
"""The image's configuration is in order, and each check finds the fault planted in a copy of the tree."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from image.checks import CHECKS, defconfigs, fragments, value_of
from image.parts import completed

ROOT = Path(__file__).resolve().parents[2]
PARTS = ["Makefile", "mk", ".github", "board", "br2-external", "configs", "docs", "dts", "package", "patches"]
NOT_READ = shutil.ignore_patterns("src", "qemu", "figures", "examples", "*.patch")
GATEWAY = "configs/nuc980_gateway_defconfig"
LTS = "configs/nuc980_gateway_lts_defconfig"
LINUX = "board/nuc980/linux"
BY_NAME = {check.__name__.removeprefix("check_"): check for check in CHECKS}


@pytest.mark.parametrize("name", BY_NAME)
def test_tree_is_in_order(name: str) -> None:
    assert BY_NAME[name](ROOT) == []


def test_every_system_knows_the_time_after_2038() -> None:
    systems = [file for file in defconfigs(ROOT) if value_of(file, "BR2_LINUX_KERNEL") == "y"]
    assert [value_of(file, "BR2_TIME_BITS_64") for file in systems] == ["y"] * 3


def test_there_is_something_to_check() -> None:
    assert [file.name for file in defconfigs(ROOT)] == [
        "nuc980_gateway_defconfig",
        "nuc980_gateway_lts_defconfig",
        "nuc980_netboot_defconfig",
        "nuc980_uboot_defconfig",
    ]
    assert len(fragments(ROOT)) > 5


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    for name in PARTS:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, tmp_path / name, symlinks=True, ignore=NOT_READ)
        else:
            shutil.copy(ROOT / name, tmp_path / name)
    return tmp_path


Plant = Callable[[Path], None]


def append(name: str, text: str) -> Plant:
    def plant(tree: Path) -> None:
        with (tree / name).open("a", encoding="utf-8") as file:
            file.write(text)

    return plant


def replace(name: str, pattern: str, new: str) -> Plant:
    """The first place; that there is one is part of the test."""

    def plant(tree: Path) -> None:
        file = tree / name
        text, count = re.subn(pattern, new, file.read_text(encoding="utf-8"), count=1, flags=re.MULTILINE)
        assert count == 1, f"{name} has no {pattern}"
        file.write_text(text, encoding="utf-8")

    return plant


def in_two(text: str) -> Plant:
    def plant(tree: Path) -> None:
        for name in (GATEWAY, LTS):
            append(name, text)(tree)

    return plant


def relink(name: str, target: str | None) -> Plant:
    def plant(tree: Path) -> None:
        link = tree / "br2-external" / "configs" / name
        link.unlink(missing_ok=True)
        if target is not None:
            link.symlink_to(target)

    return plant


def link_folder(tree: Path) -> None:
    shutil.rmtree(tree / "br2-external" / "configs")
    (tree / "br2-external" / "configs").symlink_to("../configs")


def copy_for_link(tree: Path) -> None:
    link = tree / "br2-external" / "configs" / "nuc980_gateway_defconfig"
    text = link.read_text()
    link.unlink()
    link.write_text(text)


def remove(name: str) -> Plant:
    return lambda tree: (tree / name).unlink()


def package(name: str, text: str) -> Plant:
    def plant(tree: Path) -> None:
        folder = tree / "package" / "other"
        folder.mkdir()
        (folder / name).write_text(text)

    return plant


BAR = "#" * 80
HEADER = f"{BAR}\n#\n# other\n#\n{BAR}\n\n"
COMMIT = "0123456789abcdef0123456789abcdef01234567"
MK = "package/openrtu/openrtu.mk"
CONFIG_IN = "package/openrtu/Config.in"
WORKFLOW = ".github/workflows/ci.yml"

# Check, the fault, and what the finding must say.
FAULTS: list[tuple[str, Plant, str]] = [
    ("form", append(f"{LINUX}/rt.fragment", "+CONFIG_HZ_100=y\n"), "malformed: +CONFIG_HZ_100=y"),
    ("form", append(f"{LINUX}/rt.fragment", " CONFIG_HZ_100=y\n"), "malformed"),
    ("form", append(f"{LINUX}/rt.fragment", "CONFIG_HZ_100 = y\n"), "malformed"),
    ("form", append(f"{LINUX}/rt.fragment", "CONFIG_HZ_100=yes\n"), "malformed"),
    ("form", append(f"{LINUX}/rt.fragment", "CONFIG_HZ_100\n"), "malformed"),
    ("form", append(f"{LINUX}/rt.fragment", '-CONFIG_HZ_100="\n'), "malformed"),
    ("form", append(f"{LINUX}/rt.fragment", "#CONFIG_HZ_100 is not set\n"), "commented out"),
    ("form", append(f"{LINUX}/rt.fragment", "# CONFIG_HZ_100=y\n"), "commented out"),
    ("form", append(f"{LINUX}/rt.fragment", "# CONFIG_HZ_100 is not set.\n"), "commented out"),
    ("form", append(GATEWAY, "BR2_PACKAGE_STRACE=y # why\n"), "malformed"),
    ("form", append(GATEWAY, "BR2_PACKAGE_STRACE='y'\n"), "malformed"),
    ("once", append(GATEWAY, 'BR2_TARGET_GENERIC_HOSTNAME="other"\n'), "already has"),
    ("once", append(GATEWAY, "# BR2_CCACHE is not set\n"), "already has BR2_CCACHE=y"),
    ("once", append(f"{LINUX}/rt.fragment", "# CONFIG_PREEMPT_RT is not set\n"), "CONFIG_PREEMPT_RT"),
    ("once", append(f"{LINUX}/serial.fragment", "CONFIG_PREEMPT_RT=y\n"), "rt.fragment"),
    (
        "known",
        append(GATEWAY, "BR2_PACKAGE_OPENSSSH=y\n"),
        "BR2_PACKAGE_OPENSSSH is not in buildroot-symbols.txt",
    ),
    (
        "known",
        append(GATEWAY, "# BR2_PACKAGE_OPENRTUX is not set\n"),
        "BR2_PACKAGE_OPENRTUX is not in buildroot-symbols.txt",
    ),
    (
        "known",
        append(f"{LINUX}/serial.fragment", "CONFIG_NUC980_UART0=y\n"),
        "CONFIG_NUC980_UART0 is not in linux-symbols.txt",
    ),
    ("known", append(f"{LINUX}/rt.fragment", "CONFIG_X86=y\n"), "CONFIG_X86 is not in linux-symbols.txt"),
    ("named_files", replace(GATEWAY, r"rt\.fragment", "real-time.fragment"), "there is no"),
    ("named_files", remove("board/nuc980/post-build.sh"), "post-build.sh"),
    ("named_files", lambda tree: (tree / LINUX / "idle.fragment").touch(), "nothing uses"),
    ("links", relink("nuc980_gateway_defconfig", None), "no link to nuc980_gateway_defconfig"),
    ("links", relink("nuc980_gateway_defconfig", "../../configs/nuc980_netboot_defconfig"), "must be a link"),
    ("links", relink("nuc980_gateway_defconfig", "../../configs/nowhere"), "must be a link"),
    ("links", relink("old_defconfig", "../../configs/old_defconfig"), "links to no defconfig"),
    ("links", copy_for_link, "must be a link"),
    ("links", link_folder, "must be a folder"),
    ("common_part", append(GATEWAY, "BR2_PACKAGE_STRACE=y\n"), "BR2_PACKAGE_STRACE=y is not in every"),
    ("common_part", replace(GATEWAY, "^BR2_CCACHE=y\n", ""), "BR2_CCACHE=y is not in every"),
    (
        "known",
        append("configs/parts/development.config", "BR2_PACKAGE_GBD=y\n"),
        "BR2_PACKAGE_GBD is not in buildroot-symbols.txt",
    ),
    ("known", append("configs/linux-symbols.txt", "X86\n"), "linux-symbols.txt:1: nothing sets X86"),
    ("form", append("configs/parts/system.config", "BR2_PACKAGE_GDB\n"), "malformed"),
    (
        "parts",
        replace(GATEWAY, "^BR2_CCACHE=y\n", ""),
        "common.config:6: nuc980_gateway_defconfig lacks BR2_CCACHE=y",
    ),
    ("parts", append("configs/parts/system.config", "BR2_PACKAGE_STRACE=y\n"), "lacks BR2_PACKAGE_STRACE=y"),
    ("parts", replace(GATEWAY, "^# Parts: .*\n", ""), "which its head does not name"),
    ("parts", replace(GATEWAY, "^(# Parts: .*)", r"\1 other"), "there is no"),
    ("parts", in_two("BR2_PACKAGE_STRACE=y\n"), "it belongs into a part"),
    ("explained", append(GATEWAY, "BR2_PACKAGE_STRACE=y\n"), "does not explain BR2_PACKAGE_STRACE=y"),
    ("explained", replace(GATEWAY, "^BR2_CCACHE=y\n", ""), "explains BR2_CCACHE=y"),
    ("explained", replace(GATEWAY, "^BR2_CCACHE=y$", "# BR2_CCACHE is not set"), "explains BR2_CCACHE=y"),
    (
        "explained",
        replace("docs/defconfig.md", r"^\| `BR2_CCACHE=y` \|.*", "| `BR2_CCACHE=y` | |"),
        "BR2_CCACHE=y",
    ),
    (
        "explained",
        append("docs/defconfig.md", "\n## Again\n| `BR2_CCACHE=y` | so |\n"),
        "twice: BR2_CCACHE=y",
    ),
    ("pinned", replace(GATEWAY, "_REPO_VERSION=.*", '_REPO_VERSION="master"'), "master is not a commit"),
    ("pinned", replace(GATEWAY, "_REPO_VERSION=.*", f'_REPO_VERSION="{COMMIT}"'), "no hash in patches/"),
    ("pinned", replace(GATEWAY, r"rt73\.patch", "rt74.patch"), "no hash in patches/ for https://"),
    ("pinned", replace(LTS, '"6.1.141"', '"6.1.142"'), "no hash in patches/ for the archive of 6.1.142"),
    ("pinned", replace(GATEWAY, "^BR2_DOWNLOAD_FORCE_CHECK_HASHES=y\n", ""), "FORCE_CHECK_HASHES is not set"),
    ("pinned", replace("configs/kas.yml", "^ *commit:.*\n", ""), "buildroot is pinned by no commit"),
    (
        "pinned",
        replace("configs/kas.yml", "commit: .*", "commit: master"),
        "buildroot is pinned by no commit",
    ),
    ("pinned", remove("package/openrtu/openrtu.hash"), "no openrtu.hash"),
    (
        "pinned",
        package("other.mk", f"{HEADER}OTHER_VERSION = 1.0\nOTHER_SITE = https://a.b\n"),
        "no other.hash",
    ),
    (
        "pinned",
        package("other.mk", f"{HEADER}OTHER_VERSION = main\nOTHER_SITE_METHOD = git\n"),
        "is not a commit",
    ),
    ("workflows", append(WORKFLOW, "  x: [\n"), "not a workflow"),
    ("workflows", replace(WORKFLOW, "@[0-9a-f]{40} # .*", "@v4"), "pin by commit"),
    ("workflows", replace(WORKFLOW, "(@[0-9a-f]{40}) # .*", r"\1"), "pin by commit"),
    ("workflows", replace(WORKFLOW, "run: make test$", "run: make tests"), "there is no target tests"),
    ("workflows", replace("mk/image-buildroot.mk", "^checkout:", "bring:"), "no target checkout"),
    ("style", append(MK, "OPENRTU_A = b \n"), "white space"),
    ("style", append(MK, "\n\n# end\n"), "two empty lines"),
    ("style", append(MK, "\n"), "empty line at the end"),
    ("style", append(MK, "# end"), "no end of line"),
    ("style", append(MK, "# Größe\n"), "not ASCII"),
    ("style", append(MK, "ifdef OPENRTU_A\nendif\n"), "not ifdef"),
    ("style", append(MK, "OPENRTU_A = a${B}\n"), "$(NAME)"),
    ("style", append(MK, "OPENRTU_A = b  \\\n\tc\n"), "one space before"),
    ("style", append(MK, "RTU_CONF_OPTS = b\n"), "does not begin with OPENRTU_"),
    ("style", replace(MK, "^#{80}", "#" * 79), "header"),
    ("style", append(CONFIG_IN, f"\nconfig A\n\tbool\n\thelp\n\t  {'a' * 63}\n"), "62 characters"),
    ("style", append(CONFIG_IN, "\nconfig A\n  bool\n"), "one tab"),
    ("style", append(CONFIG_IN, "\nconfig A\n\tbool\n\tdefault n\n"), "n is the default"),
    ("style", append("package/openrtu/openrtu.hash", f"sha256 {'a' * 64} b\n"), "the form is"),
    ("style", append("package/openrtu/openrtu.hash", f"sha256  {'a' * 63}  b\n"), "the form is"),
]


@pytest.mark.sample(6)
@pytest.mark.parametrize("number", range(len(FAULTS)), ids=lambda at: f"{FAULTS[at][0]}-{at}")
def test_planted_fault_is_found(tree: Path, number: int) -> None:
    name, plant, expected = FAULTS[number]
    assert BY_NAME[name](tree) == []
    plant(tree)
    found = BY_NAME[name](tree)
    assert any(expected in finding for finding in found), found


def test_every_check_has_its_fault() -> None:
    assert {name for name, _, _ in FAULTS} == set(BY_NAME)


def test_parts_complete_the_defconfigs(tree: Path) -> None:
    """A new line comes behind its neighbour, a new value in place of the old one."""
    gateway = tree / GATEWAY
    whole = gateway.read_text()
    assert completed(gateway) == whole.splitlines()
    replace(GATEWAY, "^BR2_CCACHE=y\n", "")(tree)
    assert completed(gateway) == whole.splitlines()
    replace("configs/parts/common.config", "^BR2_CCACHE=y$", "# BR2_CCACHE is not set")(tree)
    assert "# BR2_CCACHE is not set" in completed(gateway)
    gateway.write_text(whole)
    assert "BR2_CCACHE=y" not in completed(gateway)
