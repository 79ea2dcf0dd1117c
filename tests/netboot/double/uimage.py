# SPDX-License-Identifier: GPL-3.0-or-later
"""bootm: what boot/bootm.c checks of a legacy image and a device tree, and what it says."""

from __future__ import annotations

import struct
import zlib
from typing import TYPE_CHECKING

from . import linux
from .text import size_text

if TYPE_CHECKING:
    from .board import Board

HEADER = struct.Struct(">7I4B32s")
FDT = 0xD00DFEED


def bootm(board: Board, words: list[str], repeat: bool) -> int:
    """Comes back only when something is wrong."""
    kernel = board.number(words[1]) if len(words) > 1 else board.load_address
    tree = board.number(words[3]) if len(words) > 3 else None
    if not _kernel_is_good(board, kernel):
        board.puts("ERROR: can't get kernel image!\n")
        return 1
    if tree is not None and not _tree_is_good(board, tree):
        return 1
    _, _, _, size, load, _, _, *_ = HEADER.unpack(board.memory(kernel, HEADER.size))
    if load == kernel + HEADER.size:
        board.puts(board.variant.xip)
    else:
        board.puts("   Loading Kernel Image" + board.variant.xip.removeprefix("   XIP Kernel Image"))
        board.store(load, board.memory(kernel + HEADER.size, size))
    if tree is not None:
        _, total = struct.unpack(">2I", board.memory(tree, 8))
        if struct.unpack(">I", board.memory(tree, 4)) != (FDT,):
            board.puts("ERROR: image is not a fdt - must RESET the board to recover.\n")
            return 1
        high = 0x3B53000 - (total + 0x3FFF & ~0xFFF)
        board.puts(f"   Loading Device Tree to {high:08x}, end {high + total + 0x2FFF:08x} ... OK\n")
        if board.variant.working_fdt:
            board.puts(f"Working FDT set to {high:x}\n")
    board.wire.puts("\nStarting kernel ...\n\n", board.cuts)
    board.kernels_started += 1
    linux.run(board.wire, board.ending)
    raise AssertionError("a kernel does not come back")


def iminfo(board: Board, words: list[str], repeat: bool) -> int:
    address = board.number(words[1]) if len(words) > 1 else board.load_address
    board.puts(f"\n## Checking Image at {address:08x} ...\n")
    if struct.unpack(">I", board.memory(address, 4))[0] != 0x27051956:
        board.puts("Unknown image format!\n")
        return 1
    board.puts("   Legacy image found\n")
    if not _header_is_good(board, address):
        board.puts("   Bad Magic Number\n")
        return 1
    _print_header(board, address)
    if not _data_is_good(board, address):
        board.puts("   Bad Data CRC\n")
        return 1
    return 0


def _kernel_is_good(board: Board, address: int) -> bool:
    if struct.unpack(">I", board.memory(address, 4))[0] != 0x27051956:
        board.puts("Wrong Image Format for bootm command\n")
        return False
    board.puts(f"## Booting kernel from Legacy Image at {address:08x} ...\n")
    if not _header_is_good(board, address):
        board.puts("Bad Header Checksum\n")
        return False
    _print_header(board, address)
    if not _data_is_good(board, address):
        board.puts("Bad Data CRC\n")
        return False
    fields = HEADER.unpack(board.memory(address, HEADER.size))
    if fields[8] != 2:
        board.puts(f"Unsupported Architecture 0x{fields[8]:x}\n")
        return False
    if fields[9] != 2:
        board.puts("Wrong Image Type for bootm command\n")
        return False
    return True


def _header_is_good(board: Board, address: int) -> bool:
    header = bytearray(board.memory(address, HEADER.size))
    (crc,) = struct.unpack_from(">I", header, 4)
    header[4:8] = bytes(4)
    return zlib.crc32(header) == crc


def _data_is_good(board: Board, address: int) -> bool:
    _, _, _, size, _, _, crc, *_ = HEADER.unpack(board.memory(address, HEADER.size))
    board.puts("   Verifying Checksum ... ")
    good = size <= len(board.ram) - address and zlib.crc32(board.memory(address + HEADER.size, size)) == crc
    if good:
        board.puts("OK\n")
    return good


def _print_header(board: Board, address: int) -> None:
    _, _, _, size, load, entry, _, _, _, _, compression, name = HEADER.unpack(
        board.memory(address, HEADER.size)
    )
    packing = {0: "uncompressed", 1: "gzip compressed"}.get(compression, "unknown compression")
    title = name.split(b"\0")[0].decode("latin-1")
    board.puts(f"   Image Name:   {title}\n")
    board.puts(f"   Image Type:   ARM Linux Kernel Image ({packing})\n")
    board.puts(f"   Data Size:    {size} Bytes = {size_text(size)}\n")
    board.puts(f"   Load Address: {load:08x}\n   Entry Point:  {entry:08x}\n")


def _tree_is_good(board: Board, address: int) -> bool:
    magic, _ = struct.unpack(">2I", board.memory(address, 8))
    if magic != FDT:
        board.puts(
            "ERROR: Did not find a cmdline Flattened Device Tree\nCould not find a valid device tree\n"
        )
        return False
    board.puts(f"## Flattened Device Tree blob at {address:08x}\n")
    board.puts(f"   Booting using the fdt blob at 0x{address:06x}\n")
    if board.variant.working_fdt:
        board.puts(f"Working FDT set to {address:x}\n")
    return True
