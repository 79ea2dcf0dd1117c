# SPDX-License-Identifier: GPL-3.0-or-later
"""What stands in for Buildroot's downloads: the table, its sources, the toolchain, the programs."""

from __future__ import annotations

import hashlib
import os
import re
import subprocess
from pathlib import Path
from typing import Any

import pytest

from image import offline
from image.checks import settings
from nuc980.errors import UnusableInput

ROOT = Path(__file__).resolve().parents[2]
TABLE = offline.read_table()
PACKAGES = {each.package for each in TABLE.sources}
# Of no archive: they are in Buildroot, in the kernel's source or here.
INSIDE = re.compile(r"openrtu.*|linux-tools-.*|busybox-config-fragment-files|swupdate-config")
PROVIDED = {"openssl": "libopenssl", "zlib": "libzlib"}
SUM = "0" * 64
ROW = f'[[source]]\npackage = "jansson"\ndebian = "jansson"\nversion = "2.14-2"\nsha256 = "{SUM}"\n'


def set_symbols(defconfig: str) -> dict[str, str]:
    """With what the parts for offline say otherwise."""
    files = (ROOT / "configs" / defconfig, *sorted((ROOT / "configs/parts").glob("offline*.config")))
    return {each.symbol: each.value for file in files for each in settings(file)}


@pytest.mark.parametrize("defconfig", ["nuc980_gateway_lts_defconfig", "nuc980_uboot_defconfig"])
def test_each_package_of_a_defconfig_has_a_row(defconfig: str) -> None:
    wanted = {
        symbol.removeprefix("BR2_PACKAGE_").lower().replace("_", "-")
        for symbol, value in set_symbols(defconfig).items()
        if symbol.startswith("BR2_PACKAGE_") and value not in ("n", '""') and "OVERRIDE_FILE" not in symbol
    }
    assert not [
        name for name in wanted if not INSIDE.fullmatch(name) and name not in {*PACKAGES, *TABLE.programs}
    ]


def test_swupdate_uses_nothing_that_is_left_out() -> None:
    used = {each.symbol for each in settings(ROOT / "board/nuc980/swupdate.config") if each.value == "y"}
    assert {"json-c", "libubootenv", "libyaml"} == TABLE.left_out
    assert "CONFIG_BOOTLOADER_NONE" in used
    assert not used & {"CONFIG_UBOOT", "CONFIG_JSON", "CONFIG_SURICATTA", "CONFIG_CHANNEL_CURL"}


def test_what_the_gateway_is_linked_with_has_a_row() -> None:
    chosen = set_symbols("nuc980_gateway_lts_defconfig")
    asked, needed = "", set()
    for line in (ROOT / "package/openrtu/openrtu.mk").read_text().splitlines():
        if found := re.fullmatch(r"ifeq \(\$\((BR2_\w+)\),y\)", line):
            asked = found[1]
        elif line in ("else", "endif"):
            asked = ""
        elif (found := re.match(r"OPENRTU_DEPENDENCIES \+?= (.*)", line)) and (not asked or asked in chosen):
            needed |= {PROVIDED.get(name, name) for name in found[1].split()}
    assert {"jansson", "libopenssl", "netsnmp"} <= needed <= {*PACKAGES, *TABLE.programs}


def test_what_no_symbol_names_has_a_row() -> None:
    assert {"busybox", "linux", "uboot"} <= PACKAGES


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (ROW.replace(SUM, "12") + "[programs]\n", "jansson needs a version and its .dsc's SHA-256"),
        (ROW.replace('version = "2.14-2"\n', "") + "[programs]\n", "jansson needs a version"),
        (ROW + ROW + "[programs]\n", "jansson is there twice"),
        (
            ROW + 'folder = "build/a"\n[programs]\n',
            "jansson needs both a folder and the target that makes it",
        ),
        (ROW + 'colour = "red"\n[programs]\n', "colour"),
        (ROW + "[programs]\n[tools]\n", "tools is no part of the table"),
        (ROW, "programs"),
        ("[[source]", "Expected"),
    ],
)
def test_table_that_is_wrong_is_refused(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "offline.toml"
    file.write_text(text)
    with pytest.raises(UnusableInput, match=re.escape(message)):
        offline.read_table(file)


@pytest.fixture
def fetched(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> offline.Source:
    """A source in a tree of its own, as `make` leaves it there, with a row that is right."""
    monkeypatch.setattr(offline, "ROOT", tmp_path)
    text = "Source: libmodbus\nVersion: 1:3.1.6-2.1\n"
    file = tmp_path / "build/libmodbus/debian.dsc"
    file.parent.mkdir(parents=True)
    file.write_text(text)
    sha256 = hashlib.sha256(text.encode()).hexdigest()
    edits = {"a.h": "/one/a two"}
    lines = "override LIBMODBUS_INSTALL_CMDS = true\n"
    return offline.Source(
        "libmodbus", "libmodbus", "1:3.1.6-2.1", sha256, autoreconf=True, edits=edits, make=lines
    )


def test_overrides_name_source_and_release(fetched: offline.Source, tmp_path: Path) -> None:
    offline.check(fetched)
    assert offline.overrides(offline.Table((fetched,), {})).splitlines()[1:] == [
        f"LIBMODBUS_OVERRIDE_SRCDIR = {tmp_path}/build/libmodbus/debian",
        "LIBMODBUS_AUTORECONF = YES",
        "define LIBMODBUS_OFFLINE_EDITS",
        "\tsed -i '/one/a two' $(@D)/a.h",
        "endef",
        "LIBMODBUS_POST_RSYNC_HOOKS += LIBMODBUS_OFFLINE_EDITS",
        "override LIBMODBUS_INSTALL_CMDS = true",
    ]


def test_another_version_than_the_tables_is_refused_with_both(fetched: offline.Source) -> None:
    fetched.description.write_text("Version: 3.1.7-1\n")
    with pytest.raises(UnusableInput) as refused:
        offline.check(fetched)
    assert f"expected 1:3.1.6-2.1, sha256 {fetched.sha256}; got 3.1.7-1, sha256" in str(refused.value)
    assert "enter what came in configs/offline.toml" in str(refused.value)


@pytest.mark.parametrize(
    ("version", "release"),
    [
        ("1:9.2p1-2+deb12u10", "9.2p1"),
        ("3.0.20-1~deb12u2", "3.0.20"),
        ("1:1.2.13.dfsg-1", "1.2.13"),
        ("5.9.3+dfsg-2+deb12u1", "5.9.3"),
        ("2023.01+dfsg-2+deb12u3", "2023.01"),
    ],
)
def test_release_in_a_version_of_debians(version: str, release: str) -> None:
    assert offline.release(version) == release


def package(kind: str, name: str, *, archive: bool = True) -> dict[str, Any]:
    downloads = [{"source": f"{name}-1.tar.xz"}] if archive else []
    return {"type": kind, "stamp_dir": f"build/{name}-1", "downloads": downloads}


def test_bill_has_debians_release_and_nothing_that_buildroot_would_patch(fetched: offline.Source) -> None:
    table = offline.Table((fetched,), {})
    patched = {
        "version": "3.1.11",
        "cpe-id": "cpe:2.3:a:libmodbus:libmodbus:3.1.11:-:*:*:*:*:*:*",
        "patches": ["package/libmodbus/0001-mends.patch"],
        "ignore_cves": ["CVE-2026-1"],
        "dependencies": ["host-libtool", "toolchain"],
    }
    packages = {
        "libmodbus": package("target", "libmodbus") | patched,
        "host-libtool": package("host", "host-libtool"),
        "rootfs-ubi": {"type": "rootfs", "dependencies": ["host-libtool", "libmodbus"]},
    }
    bill = offline.described(packages, table)
    assert set(bill) == {"libmodbus", "rootfs-ubi"}
    library = bill["libmodbus"]
    assert library["version"] == "3.1.6"
    assert library["cpe-id"] == "cpe:2.3:a:libmodbus:libmodbus:3.1.6:-:*:*:*:*:*:*"
    assert not any(library[name] for name in ("patches", "ignore_cves", "downloads", "hashes"))
    assert [each["dependencies"] for each in bill.values()] == [["toolchain"], ["libmodbus"]]


def test_bill_has_the_c_library(
    fetched: offline.Source, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """CVEs of it concern the image, and Buildroot knows it as a toolchain without a version."""
    library = tmp_path / "libc.so.6"
    library.write_bytes(b"\0GNU C Library (Debian GLIBC 2.36-9+deb12u14) stable release version 2.36.\n\0")
    monkeypatch.setattr(offline, "C_LIBRARY", library)
    toolchain = {"toolchain-external-custom": package("target", "toolchain", archive=False)}
    (row,) = offline.described(toolchain, offline.Table((fetched,), {})).values()
    assert (row["name"], row["version"]) == ("glibc", "2.36")
    assert row["cpe-id"] == "cpe:2.3:a:gnu:glibc:2.36:-:*:*:*:*:*:*"
    library.write_bytes(b"another one")
    with pytest.raises(UnusableInput, match="names no release"):
        offline.described(toolchain, offline.Table((fetched,), {}))


def test_portable_openssh_is_known_by_release_and_update(fetched: offline.Source) -> None:
    fetched.description.write_text("Version: 1:9.2p1-2+deb12u10\n")
    known = {"cpe-id": "cpe:2.3:a:openbsd:openssh:10.2:p2:*:*:*:*:*:*"}
    assert offline.of_debian(known, fetched)["cpe-id"] == "cpe:2.3:a:openbsd:openssh:9.2:p1:*:*:*:*:*:*"


def test_manifest_gets_each_source(fetched: offline.Source) -> None:
    assert offline.versions(offline.Table((fetched,), {})) == "libmodbus 1:3.1.6-2.1\n"


def test_only_what_would_be_downloaded_for_the_host_is_marked(tmp_path: Path) -> None:
    packages = {
        "host-python3": package("host", "host-python3"),
        "host-gmp": package("host", "host-gmp"),
        "host-makedevs": package("host", "host-makedevs", archive=False),
        "host-pkgconf": package("host", "host-pkgconf"),  # which has a row
        "busybox": package("target", "busybox"),
    }
    offline.seed(tmp_path, packages, TABLE)
    assert sorted(folder.name for folder in (tmp_path / "build").iterdir()) == [
        "host-gmp-1",
        "host-python3-1",
    ]
    assert (tmp_path / "build/host-python3-1/.stamp_installed").exists()
    link = tmp_path / "per-package/host-python3/host/bin/python3"
    assert os.access(link, os.X_OK)
    before = (tmp_path / "build/host-python3-1/.stamp_installed").stat().st_mtime_ns
    offline.seed(tmp_path, packages, TABLE)  # a changed defconfig builds nothing again for it
    assert (tmp_path / "build/host-python3-1/.stamp_installed").stat().st_mtime_ns == before


def test_program_that_is_not_there_is_named(tmp_path: Path) -> None:
    table = offline.Table((), {"host-m4": ["no-such-program"]})
    with pytest.raises(UnusableInput, match="this machine has no no-such-program"):
        offline.seed(tmp_path, {"host-m4": package("host", "host-m4")}, table)


def test_what_is_left_out_is_marked_and_in_no_bill(tmp_path: Path) -> None:
    table = offline.Table((), {}, frozenset({"libubootenv"}))
    packages = {
        "libubootenv": package("target", "libubootenv"),
        "swupdate": {"type": "target", "dependencies": ["libubootenv", "toolchain"]},
    }
    assert list(offline.not_covered(packages, table)) == []
    offline.seed(tmp_path, packages, table)
    assert [folder.name for folder in (tmp_path / "build").iterdir()] == ["libubootenv-1"]
    assert (tmp_path / "build/libubootenv-1/.stamp_target_installed").exists()
    bill = offline.described(packages, table)
    assert {name: each["dependencies"] for name, each in bill.items()} == {"swupdate": ["toolchain"]}


def test_target_package_without_a_row_is_named() -> None:
    packages = {name: package("target", name) for name in ("busybox", "openrtu", "dropbear")}
    assert list(offline.not_covered(packages, TABLE)) == ["dropbear"]


@pytest.fixture(scope="module")
def armel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of Debian's own C library for armel, what tells it from the cross package's."""
    folder = tmp_path_factory.mktemp("armel")
    for file in ("lib/arm-linux-gnueabi/libnsl.so.1", "usr/lib/arm-linux-gnueabi/libg.a"):
        (folder / file).parent.mkdir(parents=True)
        (folder / file).write_text("mended since")
    return folder


@pytest.fixture(scope="module")
def toolchain(tmp_path_factory: pytest.TempPathFactory, armel: Path) -> Path:
    folder = tmp_path_factory.mktemp("offline") / "toolchain"
    subprocess.run([ROOT / "scripts/offline-toolchain.sh", folder, armel], check=True)
    return folder


@pytest.mark.slow
def test_toolchain_is_one_that_buildroot_takes(toolchain: Path) -> None:
    gcc = toolchain / "bin/arm-linux-gnueabi-gcc"
    version = subprocess.run([gcc, "-v"], capture_output=True, text=True, check=True).stderr
    assert "gcc version 12" in version
    assert "--with-sysroot=/ " not in version  # what Buildroot knows a distribution's compiler by
    library = subprocess.run(
        [gcc, "-print-file-name=libc.a"], capture_output=True, text=True, check=True
    ).stdout
    sysroot = toolchain / "arm-linux-gnueabi/sysroot"
    assert Path(library.strip()).resolve() == (sysroot / "usr/lib/libc.a").resolve()
    assert (sysroot / "lib/ld-linux.so.3").exists()
    assert not [link for link in sysroot.rglob("*") if link.is_symlink() and not link.exists()]


@pytest.mark.slow
def test_toolchain_knows_nothing_of_the_machines_libraries(toolchain: Path, tmp_path: Path) -> None:
    source = tmp_path / "time.c"
    source.write_text("#include <time.h>\n#include <math.h>\nint main(void) { return (int)sin(time(0)); }\n")
    gcc = toolchain / "bin/arm-linux-gnueabi-gcc"
    words = [gcc, "-H", "-Wl,--trace", "-o", tmp_path / "time", source, "-lm"]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    opened = [line.lstrip(". ") for line in (done.stderr + done.stdout).splitlines() if "/" in line]
    assert len(opened) > 10
    foreign = [line for line in opened if str(toolchain) not in line and "/tmp" not in line]
    assert not foreign
    sysroot = toolchain / "arm-linux-gnueabi/sysroot"
    assert subprocess.run(["qemu-arm", "-L", sysroot, tmp_path / "time"], check=False).returncode in range(
        256
    )


@pytest.mark.slow
def test_toolchain_has_the_c_library_as_it_was_mended(toolchain: Path) -> None:
    sysroot = toolchain / "arm-linux-gnueabi/sysroot"
    for file in ("lib/libnsl.so.1", "usr/lib/libg.a"):
        assert (sysroot / file).read_text() == "mended since"


@pytest.mark.slow
def test_ccache_knows_the_compiler_again(toolchain: Path) -> None:
    """By its time, which is Debian's."""
    times = {(toolchain / "bin" / f"arm-linux-gnueabi-{name}").stat().st_mtime for name in ("cc", "gcc")}
    assert times == {Path("/usr/bin/arm-linux-gnueabi-gcc-12").stat().st_mtime}


def test_container_has_what_is_copied_into_it() -> None:
    """Nothing here can build it."""
    lines = (ROOT / "scripts/Containerfile").read_text().splitlines()
    copied = [word for line in lines if line.startswith("COPY ") for word in line.split()[1:-1]]
    assert all(list(ROOT.glob(word)) for word in copied)
    lists = {file for word in copied for file in ROOT.glob(word) if file.name.startswith("packages")}
    assert lists == set((ROOT / "scripts").glob("packages*.txt"))


def test_machine_without_the_compiler_is_told_what_to_do(tmp_path: Path) -> None:
    words = [ROOT / "scripts/offline-toolchain.sh", tmp_path / "toolchain", tmp_path]
    done = subprocess.run(
        words, env={**os.environ, "DEBIAN_ROOT": str(tmp_path)}, capture_output=True, text=True
    )
    assert done.returncode == 2
    assert "no gcc-12-arm-linux-gnueabi with libc6-dev-armel-cross; make setup brings both" in done.stderr
