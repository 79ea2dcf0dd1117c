# SPDX-License-Identifier: GPL-3.0-or-later
"""br2-external/external.mk changes what Buildroot does for our boards, and for no other."""

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
"""
VENDOR = next(each.name for each in (ROOT / "patches/linux").iterdir() if len(each.name) == 40)


def laid_over(folder: Path, config: str, package: str) -> dict[str, set[str]]:
    """What a package's source and the sources of legal-info get: their files."""
    external = folder / "br2-external"
    external.symlink_to(ROOT / "br2-external")
    makefile = folder / "Makefile"
    makefile.write_text(
        f"{BEFORE}{package}_REDIST_SOURCES_DIR = legal\nBR2_EXTERNAL_OPENRTU_PATH = {external}\n{config}"
        f"include {external}/external.mk\n{HOOKS.format(name='.stamp_patched', package=package)}"
    )
    command = ["make", "-f", makefile, "source/.stamp_patched"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return {
        name: {str(each.relative_to(folder / name)) for each in (folder / name).rglob("*") if each.is_file()}
        for name in ("source", "legal")
    }


def files_of(*folders: Path) -> set[str]:
    return {str(each.relative_to(top.parent)) for top in folders for each in top.rglob("*") if each.is_file()}


OURS = ROOT / "board/nuc980/linux"
LINUX = files_of(OURS / "arch", OURS / "drivers", OURS / "include")


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


UBOOT = {path[len("u-boot/") :] for path in files_of(ROOT / "board/nuc980/u-boot")}


@pytest.mark.parametrize(
    ("config", "files"),
    [(PATCHES.format("/a"), UBOOT), ('BR2_GLOBAL_PATCH_DIR = "/a/other"\n', set())],
    ids=["ours", "another's patches"],
)
def test_our_uboot_is_laid_over_what_has_our_patches(tmp_path: Path, config: str, files: set[str]) -> None:
    given = laid_over(tmp_path, config, "UBOOT")
    assert given["source"] == files
    assert given["legal"] == {f"nuc980/{each}" for each in files}
