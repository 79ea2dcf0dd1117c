# SPDX-License-Identifier: GPL-3.0-or-later
"""What is to be booted, looked at before anything is typed: the kernel's uImage, the device tree."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import libfdt

from nuc980.netboot.board import Partition
from nuc980.netboot.errors import UnusableImage
from nuc980.netboot.limits import ENTRY


@dataclass(frozen=True)
class UImage:
    """The header of U-Boot's legacy image (include/image.h of 2016.11 and 2023.01)."""

    LAYOUT: ClassVar = struct.Struct(">7I4B32s")
    MAGIC: ClassVar = 0x27051956
    LINUX: ClassVar = 5
    ARM: ClassVar = 2
    KERNEL: ClassVar = 2
    NOT_COMPRESSED: ClassVar = 0

    load: int
    entry: int
    size: int  # bytes, with the header
    name: str


def read_uimage(path: Path) -> UImage:
    """The header of a whole, unharmed, uncompressed Linux kernel for ARM. Raises UnusableImage."""
    data = path.read_bytes()
    if len(data) < UImage.LAYOUT.size or int.from_bytes(data[:4]) != UImage.MAGIC:
        raise _another(path, data, "a uImage")
    magic, header_crc, made, size, load, entry, data_crc, *kind, name = UImage.LAYOUT.unpack_from(data)
    held = len(data) - UImage.LAYOUT.size
    if zlib.crc32(UImage.LAYOUT.pack(magic, 0, made, size, load, entry, data_crc, *kind, name)) != header_crc:
        raise _damaged(path, "the header does not match its CRC")
    if held < size:
        raise _damaged(path, f"it is cut off: {held} bytes of {size}")
    if zlib.crc32(data[UImage.LAYOUT.size : UImage.LAYOUT.size + size]) != data_crc:
        raise _damaged(path, "the kernel in it does not match its CRC")
    _check_kind(path, *kind)
    return UImage(load, entry, len(data), name.rstrip(b"\0").decode("ascii", "replace"))


def _check_kind(path: Path, system: int, processor: int, kind: int, compression: int) -> None:
    if (system, processor, kind) != (UImage.LINUX, UImage.ARM, UImage.KERNEL):
        raise UnusableImage(
            f"{path} is not a Linux kernel for ARM: its header says system {system}, processor {processor},"
            f" type {kind}; wanted {UImage.LINUX}, {UImage.ARM}, {UImage.KERNEL}.",
            next_step="mkimage -A arm -O linux -T kernel makes one, and so does `make image-debian`",
        )
    if compression != UImage.NOT_COMPRESSED:
        raise UnusableImage(
            f"{path} is compressed for U-Boot (compression {compression} in its header).",
            cause="U-Boot would overwrite it while it unpacks: it lies where the kernel runs",
            next_step="wrap the zImage, which unpacks itself, with mkimage -C none",
        )


def check_place(path: Path, image: UImage, runs_at: int) -> None:
    """That the kernel runs where it lies: nothing is moved, nothing overwritten. Raises UnusableImage."""
    if (image.load, image.entry) != (runs_at, runs_at):
        raise UnusableImage(
            f"{path} is made to run at {image.load:#x}, entry {image.entry:#x}; it is loaded"
            f" so that it can run at {runs_at:#x}.",
            next_step=f"make it with mkimage -a {runs_at:#x} -e {runs_at:#x}; from the kernel's sources:"
            f" make LOADADDR={runs_at:#x} uImage",
        )


def read_tree(path: Path) -> libfdt.Fdt:
    """A device tree, sound in its structure. Raises UnusableImage."""
    data = path.read_bytes()
    if data[:4] != DTB_MAGIC:
        raise _another(path, data, "a device tree")
    total = int.from_bytes(data[4:8])
    if len(data) < total:
        raise _damaged(path, f"it is cut off: {len(data)} bytes of {total}")
    if error := libfdt.fdt_check_full(bytearray(data[:total]), total):
        raise _damaged(path, f"libfdt: {libfdt.strerror(error)}")
    tree = libfdt.Fdt(data[:total])
    if tree.subnode_offset(0, "images", libfdt.QUIET_NOTFOUND) >= 0:
        raise _another(path, data, "a device tree")
    return tree


FLASH = "nuvoton,nuc980-fmi"  # compatible with


def flash_nodes(tree: libfdt.Fdt) -> Iterator[int]:
    """The offsets of the flash's controllers; what is written into one moves only those behind it."""
    node, depth = 0, 0
    while node >= 0 and depth >= 0:
        if tree.hasprop(node, "compatible") and FLASH in tree.getprop(node, "compatible").as_stringlist():
            yield node
        node, depth = tree.next_node(node, depth, libfdt.QUIET_NOTFOUND)


def partitions_of(tree: libfdt.Fdt) -> tuple[Partition, ...]:
    """Linux' partitions of the flash: beside each other in the controller's node, or in one of their own."""
    return tuple(
        Partition(tree.getprop(node, "label").as_str(), *tree.getprop(node, "reg").as_uint32_list())
        for controller in flash_nodes(tree)
        for node in _below(tree, controller)
        if tree.hasprop(node, "label") and tree.hasprop(node, "reg") and len(tree.getprop(node, "reg")) == 8
    )


def _below(tree: libfdt.Fdt, parent: int) -> Iterator[int]:
    node, depth = tree.next_node(parent, 0, libfdt.QUIET_NOTFOUND)
    while node >= 0 and depth > 0:
        yield node
        node, depth = tree.next_node(node, depth, libfdt.QUIET_NOTFOUND)


# ---- what else it may be

DTB_MAGIC = b"\xd0\x0d\xfe\xed"
WRAP = (
    f"wrap the zImage: mkimage -A arm -O linux -T kernel -C none -a {ENTRY:#x} -e {ENTRY:#x} -n Linux"
    " -d zImage uImage"
)
UNPACK = "unpack it first"
ORDER = "the kernel comes first, then the device tree"

# What a file may be, how it is known, and what to do. The first that fits.
KINDS: tuple[tuple[str, Callable[[bytes], bool], str], ...] = (
    ("a U-Boot image, as the kernel is one", lambda data: int.from_bytes(data[:4]) == UImage.MAGIC, ORDER),
    (
        "a FIT image, for another way of booting",
        lambda data: data[:4] == DTB_MAGIC and b"\1images\0" in data,
        "give kernel and device tree as files of their own",
    ),
    ("a device tree", lambda data: data[:4] == DTB_MAGIC, ORDER),
    ("a zImage without U-Boot's header", lambda data: data[0x24:0x28] == b"\x18\x28\x6f\x01", WRAP),
    ("a kernel for 64-bit ARM", lambda data: data[0x38:0x3C] == b"ARM\x64", "the board's is ARMv5, 32 bits"),
    ("an ELF file, as vmlinux is one", lambda data: data[:4] == b"\x7fELF", WRAP),
    ("a file compressed by gzip", lambda data: data[:2] == b"\x1f\x8b", UNPACK),
    ("a file compressed by xz", lambda data: data[:6] == b"\xfd7zXZ\0", UNPACK),
    ("an image for UBI", lambda data: data[:4] == b"UBI#", "nuc980-netboot flash writes it"),
    (
        "a device tree's source",
        lambda data: b"/dts-v1/" in data[:4096],
        "compile it: make dtb, or dtc -O dtb",
    ),
    (
        "a text",
        lambda data: data[:4096].isascii() and b"\0" not in data[:4096],
        "give the file that was built",
    ),
    ("an Image of an ARM kernel, or something else without a mark", lambda data: True, WRAP),
)


def _another(path: Path, data: bytes, wanted: str) -> UnusableImage:
    if not data:
        return UnusableImage(f"{path} is empty.", next_step="build or copy it again")
    name, advice = next((name, advice) for name, fits, advice in KINDS if fits(data))
    return UnusableImage(f"{path} is not {wanted}; it looks like {name}.", next_step=advice)


def _damaged(path: Path, how: str) -> UnusableImage:
    return UnusableImage(f"{path} is damaged: {how}.", next_step="build or copy it again")
