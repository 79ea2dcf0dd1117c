# SPDX-License-Identifier: GPL-3.0-or-later
"""What a power cut leaves on the disk of a plant: made of the log that libplant.so writes (disk.c).

What was synchronised is there. Of a folder's entries that were not, some first ones are; of what was written
into a file, each part is there, or not, or torn. It runs in the plant, and imports but the standard library.
"""

import random
import shutil
from dataclasses import dataclass, field
from pathlib import Path

PIECE = 4096


@dataclass
class File:
    """What is on the disk, and what was done since."""

    octets: bytearray = field(default_factory=bytearray)
    waiting: list[tuple[int, bytes | None]] = field(default_factory=list)  # None: cut off there

    def synchronise(self) -> None:
        for at, octets in self.waiting:
            put(self.octets, at, octets)
        self.waiting.clear()

    def lose_power(self, chance: random.Random) -> None:
        for at, octets in self.waiting:
            if octets is None and chance.random() < 0.5:
                put(self.octets, at, None)
            for begin in range(0, len(octets or b""), PIECE):
                put_torn(self.octets, at + begin, (octets or b"")[begin : begin + PIECE], chance)
        self.waiting.clear()


def put(octets: bytearray, at: int, new: bytes | None) -> None:
    if new is None:
        del octets[at:]
    octets.extend(bytes(max(0, at - len(octets))))
    octets[at : at + len(new or b"")] = new or b""


def put_torn(octets: bytearray, at: int, new: bytes, chance: random.Random) -> None:
    there = chance.randrange(len(new))
    match chance.randrange(5):
        case 0:
            put(octets, at, new)
        case 1:
            put(octets, at, new[:there])
        case 2:  # the file's new size, and nothing there yet
            put(octets, at, bytes(len(new)))
        case 3:
            put(octets, at, new[:there] + bytes(len(new) - there))


Entries = dict[str, int | None]  # what a call changed: a name is of a file, of a folder (0), or gone (None)


class Log:
    """Of a disk: how it was in the beginning, and what was done since."""

    def __init__(self, root: Path) -> None:
        self.root, self.base = root, root.with_suffix(".base")
        self.files: dict[int, File] = {}
        self.names: dict[str, int] = {}
        self.seen: dict[str, int] = {}  # by the programs
        self.waiting: list[Entries] = []

    def load(self, log: bytes) -> int | None:
        """Returns the number of the power cut at its end; None: there is none."""
        at = 0
        while at < len(log):
            end = log.index(b"\n", at)
            kind, rest = log[at:end].decode().split(" ", 1)
            at = end + 1
            size = int(rest.split()[2]) if kind == "write" else 0
            if kind == "power":
                return int(rest)
            self.take(kind, rest, log[at : at + size])
            at += size
        return None

    def take(self, kind: str, rest: str, octets: bytes) -> None:
        match kind:
            case "base":
                self.begin(*rest.split(" ", 1))
            case "create":
                number, path = rest.split(" ", 1)
                self.files[int(number)] = File()
                self.enter({path: int(number)})
            case "folder":
                self.enter({rest: 0})
            case "remove":
                self.enter({rest: None})
            case "rename":
                old, new = rest.split("\t")
                self.enter({old: None, new: self.seen[old]})
            case "link":
                old, new = rest.split("\t")
                self.enter({new: self.seen[old]})
            case "write":
                number, at, _ = rest.split()
                self.files[int(number)].waiting.append((int(at), octets))
            case "truncate":
                number, size = rest.split()
                self.files[int(number)].waiting.append((int(size), None))
            case "sync":
                number, path = rest.split(" ", 1)
                self.synchronise(int(number), path)

    def begin(self, number: str, path: str) -> None:
        self.names[path] = self.seen[path] = int(number)
        if int(number):
            octets = (self.base / Path(path).relative_to(self.root)).read_bytes()
            self.files[int(number)] = File(bytearray(octets))

    def enter(self, entries: Entries) -> None:
        self.waiting.append(entries)
        settle(self.seen, entries)

    def synchronise(self, number: int, path: str) -> None:
        if number in self.files:
            self.files[number].synchronise()
            return
        for entries in [one for one in self.waiting if str(Path(next(iter(one))).parent) == path]:
            settle(self.names, entries)
            self.waiting.remove(entries)

    def lose_power(self, number: int) -> None:
        """One of the states that there may be then."""
        chance = random.Random(number)
        for entries in self.waiting[: chance.randrange(len(self.waiting) + 1)]:
            settle(self.names, entries)
        for file in self.files.values():
            file.lose_power(chance)

    def write(self) -> list[str]:
        """In the place of what the programs saw. Returns how the next log begins."""
        for folder in (self.root, self.base):
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir()
        lines = []
        for path, number in sorted(self.names.items()):
            place = Path(path)
            if not place.parent.exists():
                continue  # it is gone with its folder
            for here in (place, self.base / place.relative_to(self.root)):
                if number == 0:
                    here.mkdir()
                else:
                    here.write_bytes(self.files[number].octets)
            lines.append(f"base {place.stat().st_ino if number else 0} {path}\n")
        return lines


def settle(names: dict[str, int], entries: Entries) -> None:
    for path, number in entries.items():
        if number is None:
            names.pop(path, None)
        else:
            names[path] = number


def restore_after_a_power_cut(root: Path) -> bool:
    """False: there was none."""
    path = root.with_suffix(".log")
    log = Log(root)
    number = log.load(path.read_bytes()) if path.exists() else None
    if number is None:
        return False
    log.lose_power(number)
    path.write_text("".join(log.write()))
    return True
