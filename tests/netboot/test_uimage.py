# SPDX-License-Identifier: GPL-3.0-or-later
"""What is to be booted, looked at on the host: what is wrong with it is said before anything is typed."""

import gzip
import lzma
import random
import re
import struct
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from nuc980.netboot.errors import UnusableImage
from nuc980.netboot.uimage import UImage, check_place, read_tree, read_uimage

BODY = bytes(range(256)) * 16
ROOT = Path(__file__).parents[2]
Wrapped = Callable[..., Path]


def why_no_kernel(file: Path) -> str:
    with pytest.raises(UnusableImage) as raised:
        read_uimage(file)
    assert str(file) in str(raised.value)
    assert raised.value.next_step
    return str(raised.value)


def why_no_tree(file: Path) -> str:
    with pytest.raises(UnusableImage) as raised:
        read_tree(file)
    assert str(file) in str(raised.value)
    return str(raised.value)


# ---- the kernel


def test_header_is_what_mkimage_wrote(wrapped: Wrapped) -> None:
    assert read_uimage(wrapped(BODY)) == UImage(0x8000, 0x8000, len(BODY) + 64, "Linux")


def test_bytes_behind_the_kernel_are_no_harm(wrapped: Wrapped) -> None:
    """As in a copy of a flash's partition."""
    file = wrapped(BODY)
    file.write_bytes(file.read_bytes() + b"\xff" * 100)
    assert read_uimage(file).size == len(BODY) + 164


def test_each_harmed_byte_is_found(wrapped: Wrapped) -> None:
    file = wrapped(BODY)
    whole = file.read_bytes()
    for at in (*range(4, 64), 64, 1000, len(whole) - 1):
        file.write_bytes(whole[:at] + bytes([whole[at] ^ 0x10]) + whole[at + 1 :])
        assert "is damaged: " in why_no_kernel(file), at


@pytest.mark.parametrize("left", [1, 63, 64, 1000, -1])
def test_cut_off_kernel_is_found(wrapped: Wrapped, left: int) -> None:
    file = wrapped(BODY)
    file.write_bytes(file.read_bytes()[:left])
    assert re.search("is damaged: it is cut off|is not a uImage", why_no_kernel(file))


@pytest.mark.parametrize(
    ("otherwise", "words"),
    [
        ({"A": "arm64"}, "not a Linux kernel for ARM"),
        ({"O": "u-boot"}, "not a Linux kernel for ARM"),
        ({"T": "ramdisk"}, "not a Linux kernel for ARM"),
        ({"C": "gzip"}, "compressed for U-Boot"),
        ({"C": "lzma"}, "compressed for U-Boot"),
    ],
)
def test_other_uimages_are_refused(wrapped: Wrapped, otherwise: dict[str, str], words: str) -> None:
    assert words in why_no_kernel(wrapped(BODY, **otherwise))


@pytest.mark.parametrize(
    "otherwise", [{"a": "0x208000"}, {"e": "0x8040"}, {"a": "0x40008000", "e": "0x40008000"}]
)
def test_kernel_for_another_place_is_refused(wrapped: Wrapped, otherwise: dict[str, str]) -> None:
    file = wrapped(BODY, **otherwise)
    with pytest.raises(UnusableImage, match=r"mkimage -a 0x8000 -e 0x8000.*LOADADDR=0x8000"):
        check_place(file, read_uimage(file), 0x8000)
    check_place(file, UImage(0x8000, 0x8000, 64, ""), 0x8000)


def zimage() -> bytes:
    return bytes(0x24) + struct.pack("<III", 0x016F2818, 0, 4096) + bytes(4096)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is empty"),
        (zimage(), "a zImage without U-Boot's header"),
        (gzip.compress(BODY), "a file compressed by gzip"),
        (lzma.compress(BODY), "a file compressed by xz"),
        (b"\x7fELF" + BODY, "an ELF file"),
        (b"/* board */\n/dts-v1/;\n/ {};\n", "a device tree's source"),
        (b"UBI#" + BODY, "an image for UBI"),
        (b"<html>not found</html>", "a text"),
        (bytes(0x38) + b"ARM\x64" + bytes(64), "a kernel for 64-bit ARM"),
        (b"\x00\x00\xa0\xe1" * 8 + BODY, "an Image of an ARM kernel"),
    ],
)
def test_what_is_given_instead_is_named(tmp_path: Path, content: bytes, words: str) -> None:
    file = tmp_path / "instead"
    file.write_bytes(content)
    assert words in why_no_kernel(file)
    assert words in why_no_tree(file)


def test_kernel_and_tree_the_other_way_round(wrapped: Wrapped, dtb: Path) -> None:
    assert "the kernel comes first, then the device tree" in why_no_kernel(dtb)
    assert "the kernel comes first, then the device tree" in why_no_tree(wrapped(BODY))


# ---- the device tree


def test_tree_is_read(dtb: Path) -> None:
    tree = read_tree(dtb)
    assert tree.getprop(0, "model").as_str() == "BLIIoT gateway (OpenRTU)"


def test_bytes_behind_the_tree_are_no_harm(dtb: Path, tmp_path: Path) -> None:
    (tmp_path / "longer").write_bytes(dtb.read_bytes() + b"\xff" * 100)
    assert read_tree(tmp_path / "longer").totalsize() == dtb.stat().st_size


@pytest.mark.parametrize("left", [4, 40, 1000, -1])
def test_cut_off_tree_is_found(dtb: Path, tmp_path: Path, left: int) -> None:
    (tmp_path / "cut").write_bytes(dtb.read_bytes()[:left])
    assert "is damaged: " in why_no_tree(tmp_path / "cut")


@pytest.mark.parametrize("seed", range(40))
def test_no_harmed_tree_ends_otherwise(dtb: Path, tmp_path: Path, seed: int) -> None:
    """libfdt sees what is wrong in the structure, not in a value; it must not crash."""
    some = random.Random(seed)
    harmed = bytearray(dtb.read_bytes())
    for _ in range(4):
        harmed[some.randrange(4, 400)] = some.randrange(256)
    (tmp_path / "harmed").write_bytes(harmed)
    try:
        read_tree(tmp_path / "harmed")
    except UnusableImage as error:
        assert "is damaged: " in str(error)


def test_fit_image_is_named(tmp_path: Path) -> None:
    source = tmp_path / "fit.its"
    source.write_text(
        '/dts-v1/;\n/ { description = "fit"; images { kernel { data = "none"; }; }; };\n', encoding="ascii"
    )
    subprocess.run(["dtc", "-q", "-O", "dtb", "-o", tmp_path / "fit", source], check=True)
    assert "a FIT image" in why_no_kernel(tmp_path / "fit")
    assert "a FIT image" in why_no_tree(tmp_path / "fit")
