# SPDX-License-Identifier: GPL-3.0-or-later
"""br2-external/external.mk changes what Buildroot does for our boards, and for no other."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
# What Buildroot has set by when it reads external.mk.
BEFORE = """\
qstrip = $(strip $(subst ",,$(1)))
LINUX_VERSION = 6.6.1
LINUX_CPE_ID_VERSION = $(LINUX_VERSION)
BUSYBOX_PERMISSIONS = /bin/busybox f 4755 0 0
LINUX_TARGET_BUILD = linux-built
"""
PRINT = "print:\n\t@echo '$(LINUX_CPE_ID_VERSION)|$(BUSYBOX_PERMISSIONS)|$(LINUX_PRE_BUILD_HOOKS)'\n"
OVERLAY = 'BR2_ROOTFS_OVERLAY = "$(BR2_EXTERNAL_OPENRTU_PATH)/../board/nuc980/rootfs-overlay{}"\n'
PATCH = "LINUX_PATCHES = https://example.net/a-b/patch-5.10.140-rt73.patch\n"
OTHERS = 'BR2_ROOTFS_OVERLAY = "board/other/rootfs-overlay"\n'
BUSYBOX = "/bin/busybox f 4755 0 0"


@pytest.mark.parametrize(
    ("config", "said"),
    [
        ("", f"6.6.1|{BUSYBOX}|"),
        ("BR2_PACKAGE_OPENRTU = y\n" + OTHERS, f"6.6.1|{BUSYBOX}|"),
        (OTHERS + PATCH, f"6.6.1|{BUSYBOX}|"),
        (OVERLAY.format("") + PATCH, "5.10.140||OPENRTU_LINUX_IMAGE_FOLDER"),
        (OVERLAY.format(" /a/site/overlay") + PATCH, "5.10.140||OPENRTU_LINUX_IMAGE_FOLDER"),
        (OVERLAY.format(""), "6.6.1||OPENRTU_LINUX_IMAGE_FOLDER"),
    ],
    ids=["another board", "our gateway", "another's patch", "ours", "and an overlay more", "without RT"],
)
def test_for_our_boards_alone(tmp_path: Path, config: str, said: str) -> None:
    external = tmp_path / "br2-external"  # make includes no path with a space
    external.symlink_to(ROOT / "br2-external")
    makefile = tmp_path / "Makefile"
    names = f"BR2_EXTERNAL_OPENRTU_PATH = {external}\n"
    makefile.write_text(f"{names}{config}{BEFORE}all: print\ninclude {external}/external.mk\n{PRINT}")
    command = ["make", "-s", "-f", makefile, "print"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, f"{said}\n"), done.stderr


PATCHES = 'BR2_GLOBAL_PATCH_DIR = "{}/other $(BR2_EXTERNAL_OPENRTU_PATH)/../patches"\n'
# Buildroot calls a package's hooks with its folder as the target's.
HOOKS = """
all:
source/{name}:
	mkdir -p $(@D)
	$(foreach hook,$({package}_POST_PATCH_HOOKS),$(call $(hook)))
	$(foreach hook,$({package}_POST_LEGAL_INFO_HOOKS),$(call $(hook)))
	touch $@
source/.stamp_built: source/.stamp_patched
	$(foreach hook,$({package}_PRE_BUILD_HOOKS),$(call $(hook)))
	touch $@
"""
PORTS = ("board/nuc980/linux", "board/nuc980/u-boot")
VENDOR = next(each.name for each in (ROOT / "patches/linux").iterdir() if len(each.name) == 40)


def laid_over(folder: Path, config: str, package: str) -> dict[str, set[str]]:
    """What a package's source and the sources of legal-info get: their files."""
    for name in ("br2-external", *PORTS, "patches"):  # a copy: Buildroot takes no path with a blank
        shutil.copytree(ROOT / name, folder / "tree" / name, symlinks=True)
    (folder / "tree/package/openrtu").mkdir(parents=True)
    external = folder / "tree/br2-external"
    built = f"{package}_REDIST_SOURCES_DIR = legal\n{package}_TARGET_BUILD = source/.stamp_built\n"
    makefile = folder / "Makefile"
    makefile.write_text(
        f"{BEFORE}{built}BR2_EXTERNAL_OPENRTU_PATH = {external}\n{config}"
        f"include {external}/external.mk\n{HOOKS.format(name='.stamp_patched', package=package)}"
    )
    make(folder, "source/.stamp_built")
    return {name: files_of(folder / name) for name in ("source", "legal")}


def make(folder: Path, *words: str) -> str:
    done = subprocess.run(["make", *words], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def files_of(folder: Path) -> set[str]:
    """Without the stamps."""
    return {str(path.relative_to(folder)) for path in folder.rglob("[!.]*") if path.is_file()}


LINUX = {each for each in files_of(ROOT / "board/nuc980/linux") if "/" in each}


@pytest.mark.parametrize(
    ("config", "files"),
    [
        (PATCHES.format("/a") + "LINUX_VERSION = 6.1.141\n", LINUX),
        (PATCHES.format("/a") + f"LINUX_VERSION = {VENDOR}\n", set()),
        ('BR2_GLOBAL_PATCH_DIR = "/a/other"\nLINUX_VERSION = 6.1.141\n', set()),
    ],
    ids=["ours", "the vendor's kernel", "another's patches"],
)
def test_our_linux_is_laid_over_what_has_our_patches(tmp_path: Path, config: str, files: set[str]) -> None:
    given = laid_over(tmp_path, config, "LINUX")
    assert given["source"] == files
    assert given["legal"] == {f"nuc980/{each}" for each in files}


UBOOT = files_of(ROOT / "board/nuc980/u-boot")


@pytest.mark.parametrize(
    ("config", "files"),
    [(PATCHES.format("/a"), UBOOT), ('BR2_GLOBAL_PATCH_DIR = "/a/other"\n', set())],
    ids=["ours", "another's patches"],
)
def test_our_uboot_is_laid_over_what_has_our_patches(tmp_path: Path, config: str, files: set[str]) -> None:
    given = laid_over(tmp_path, config, "UBOOT")
    assert given["source"] == files
    assert given["legal"] == {f"nuc980/{each}" for each in files}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("package", "folder", "driver"),
    [("LINUX", "linux", "drivers/irqchip/irq-nuc980.c"), ("UBOOT", "u-boot", "drivers/net/nuc980_emac.c")],
)
def test_a_driver_that_changes_is_built_again(tmp_path: Path, package: str, folder: str, driver: str) -> None:
    """And no other: what is as it was keeps its time."""
    laid_over(tmp_path, PATCHES.format("/a") + "LINUX_VERSION = 6.1.141\n", package)
    assert "up to date" in make(tmp_path, "source/.stamp_built")
    source = tmp_path / "source"
    (source / driver).write_text("int old;\n")
    files = [path for path in source.rglob("[!.]*") if path.is_file()]
    for path in files:
        os.utime(path, (1, 1))
    ours = tmp_path / "tree/board/nuc980" / folder / driver
    make(tmp_path, "--what-if", str(ours), "source/.stamp_built")
    assert [str(path.relative_to(source)) for path in files if path.stat().st_mtime != 1] == [driver]
    assert (source / driver).read_text() == ours.read_text()
