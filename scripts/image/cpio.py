# SPDX-License-Identifier: GPL-3.0-or-later
"""
python3 -m image.cpio FOLDER ARCHIVE: packs a root file system as the initramfs of a kernel, without root.

The format is "newc" (the kernel's Documentation/driver-api/early-userspace/buffer-format.rst). All belongs to
root, no time is kept and the order is that of the names: the same content is the same bytes.
"""

from __future__ import annotations

import stat
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from nuc980.errors import UnusableInput

MAGIC = b"070701"
TRAILER = "TRAILER!!!"
# The kernel reads words of 4 bytes; an archive that ends on a block of 512 can have another behind it.
WORD, BLOCK = 4, 512


@dataclass(frozen=True)
class Entry:
    """A file, folder, link or device. `path` has no slash in front; `mode` is that of stat()."""

    path: str
    mode: int
    content: bytes = b""
    device: tuple[int, int] = (0, 0)

    @staticmethod
    def folder(path: str, permissions: int = 0o755) -> Entry:
        return Entry(path, stat.S_IFDIR | permissions)

    @staticmethod
    def file(path: str, content: bytes | str, permissions: int = 0o644) -> Entry:
        data = content.encode() if isinstance(content, str) else content
        return Entry(path, stat.S_IFREG | permissions, data)

    @staticmethod
    def link(path: str, to: str) -> Entry:
        return Entry(path, stat.S_IFLNK | 0o777, to.encode())

    @staticmethod
    def character_device(path: str, major: int, minor: int, permissions: int = 0o600) -> Entry:
        return Entry(path, stat.S_IFCHR | permissions, device=(major, minor))


# What a root must have. The root folder: all may write to the kernel's own. Input and output of the first
# process: the kernel opens it before anything is mounted.
FOUNDATION = (Entry.folder("."), Entry.folder("dev"), Entry.character_device("dev/console", 5, 1))


def archive(entries: Iterable[Entry]) -> bytes:
    """The entries in their order. A folder must come before what is in it: the kernel makes none."""
    packed = bytearray()
    for number, entry in enumerate(entries, 1):
        packed += _packed(number, entry)
    packed += _packed(0, Entry(TRAILER, 0))
    return bytes(packed) + bytes(-len(packed) % BLOCK)


def _packed(number: int, entry: Entry) -> bytes:
    name = entry.path.encode() + b"\0"
    links = 2 if stat.S_ISDIR(entry.mode) else 1
    fields = [number, entry.mode, 0, 0, links, 0, len(entry.content), 0, 0, *entry.device, len(name), 0]
    header = MAGIC + b"".join(b"%08X" % field for field in fields) + name
    return b"".join(part + bytes(-len(part) % WORD) for part in (header, entry.content))


def entries_of(folder: Path) -> Iterator[Entry]:
    """All that is in a folder, by name, behind FOUNDATION. Raises UnusableInput for pipes and the like."""
    yield from FOUNDATION
    for file in sorted(folder.rglob("*"), key=lambda each: each.relative_to(folder).parts):
        path, mode = str(file.relative_to(folder)), file.lstat().st_mode
        if path in (each.path for each in FOUNDATION):
            continue
        if stat.S_ISLNK(mode):
            yield Entry.link(path, str(file.readlink()))
        elif stat.S_ISDIR(mode):
            yield Entry.folder(path, stat.S_IMODE(mode))
        elif stat.S_ISREG(mode):
            yield Entry.file(path, file.read_bytes(), stat.S_IMODE(mode))
        else:
            raise UnusableInput(f"{file} is not a file, folder or link; remove it: /dev fills itself at boot")


def main(words: list[str]) -> int:
    if len(words) != 2:
        print("usage: python3 -m image.cpio FOLDER ARCHIVE", file=sys.stderr)
        return 2
    folder, target = map(Path, words)
    try:
        if not folder.is_dir():
            raise UnusableInput(f"{folder} is not a folder")
        target.write_bytes(archive(entries_of(folder)))
    except UnusableInput as error:
        print(f"cpio: {error}", file=sys.stderr)
        return 2
    except OSError as error:
        print(f"cpio: {error.filename}: {error.strerror}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
