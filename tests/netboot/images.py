# SPDX-License-Identifier: GPL-3.0-or-later
"""Files to boot and to flash, made by hand: what is in them counts only as far as it is looked at."""

import random
import struct
import zlib

from netboot.double import BLOCK, PAGE


def uimage(payload: bytes, load: int = 0x8000, processor: int = 2, kind: int = 2) -> bytes:
    """A legacy image of an uncompressed kernel."""

    def head(crc: int) -> bytes:
        fields = (0x27051956, crc, 0, len(payload), load, load, zlib.crc32(payload))
        return struct.pack(">7I4B32s", *fields, 5, processor, kind, 0, b"Linux")

    return head(zlib.crc32(head(0))) + payload


def device_tree(chance: random.Random, size: int = 20_000) -> bytes:
    """A tree with one property of random bytes."""
    node = struct.pack(">5I", 1, 0, 3, size, 0) + chance.randbytes(size) + struct.pack(">2I", 2, 9)
    names = b"bytes\0"
    total = 56 + len(node) + len(names)
    head = (0xD00DFEED, total, 56, 56 + len(node), 40, 17, 16, 0, len(names), len(node))
    return struct.pack(">10I", *head) + bytes(16) + node + names


def ubi_image(chance: random.Random, blocks: int) -> bytes:
    """Erase-counter headers, each with a block of random bytes."""

    def header() -> bytes:
        fields = b"UBI#" + struct.pack(">B3xQIII32x", 1, 0, PAGE, 2 * PAGE, 1)
        return fields + struct.pack(">I", zlib.crc32(fields) ^ 0xFFFFFFFF)

    return b"".join(
        header().ljust(2 * PAGE, b"\xff") + chance.randbytes(BLOCK - 2 * PAGE) for _ in range(blocks)
    )
