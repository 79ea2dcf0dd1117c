# SPDX-License-Identifier: GPL-3.0-or-later
"""The environment in the flash: CRC32, then NAME=VALUE strings, each with a NUL, and one more NUL."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping

OFFSET = 0x80000
RANGE = 4  # blocks, of which the first good ones are taken


def packed(variables: Mapping[str, str], size: int) -> bytes:
    """As env_export has it; OverflowError when they do not fit."""
    strings = b"".join(f"{name}={variables[name]}\0".encode() for name in sorted(variables)) + b"\0"
    if len(strings) > size - 4:
        raise OverflowError
    data = strings.ljust(size - 4, b"\0")
    return struct.pack("<I", zlib.crc32(data)) + data


def unpacked(stored: bytes) -> dict[str, str] | None:
    """None when the CRC is wrong."""
    (crc,) = struct.unpack("<I", stored[:4])
    if zlib.crc32(stored[4:]) != crc:
        return None
    strings = stored[4:].split(b"\0\0", 1)[0].split(b"\0")
    pairs = (string.decode("latin-1").partition("=") for string in strings if string)
    return {name: value for name, _, value in pairs}


def listed(variables: Mapping[str, str]) -> str:
    """As printenv shows all of it: line ends and back-slashes are escaped, unlike in a single one's value."""
    lines = (f"{name}={variables[name]}" for name in sorted(variables))
    return "".join(line.replace("\\", "\\\\").replace("\n", "\\\n") + "\n" for line in lines)
