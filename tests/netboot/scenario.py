# SPDX-License-Identifier: GPL-3.0-or-later
"""A scenario: a board that has something wrong with it, a command of nuc980-netboot, and how that ends."""

from __future__ import annotations

import copy
import json
import random
import socket
import struct
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from netboot.double import BLOCK, Double, Operation
from netboot.double.faults import Fault
from nuc980.netboot.cli import main
from nuc980.netboot.errors import NetbootError

BOARD, SERVER = "127.0.0.5", "127.0.0.1"
OWN = range(0, 0x200000)  # SPL, environment and U-Boot
ENVIRONMENT = range(0x80000, 0x100000)
KERNEL_SLOT, TREE_SLOT = range(0x200000, 0x700000), range(0x700000, 0x800000)


@dataclass(frozen=True)
class Scenario:
    """name: tells it. board: settings of the double. prepare: what is done to it before, and to the files.

    command: the subcommand and its own words. error: the class it ends with, None for success; says: words of
    its text. may_write: the bytes of the flash that may be erased and programmed.
    """

    name: str
    command: tuple[str, ...]
    faults: Sequence[Fault] = ()
    board: Mapping[str, object] = field(default_factory=dict)
    prepare: Callable[[Bench], None] = lambda bench: None
    error: type[NetbootError] | None = None
    says: tuple[str, ...] = ()
    may_write: Sequence[range] = ()
    then: Callable[[Bench], None] = lambda bench: None
    slow: bool = False

    @property
    def exit_code(self) -> int:
        return self.error.exit_code if self.error else 0


class Bench:
    """A double, and the host's files. Every operation on the flash is judged as it comes."""

    def __init__(self, folder: Path, scenario: Scenario) -> None:
        self.folder = folder
        self.site = folder / "site"
        self.site.mkdir()
        (self.site / "macs").write_text("eth0 02:00:00:00:00:01\neth1 02:00:00:00:00:02\n")
        self.random = random.Random(980)
        self.files = {"kernel": uimage(self.random.randbytes(300_000)), "tree": device_tree(self.random)}
        self.port = free_port()
        settings = {"tftp": (SERVER, self.port), "faults": copy.deepcopy(list(scenario.faults))}
        self.double = Double(**settings | dict(scenario.board))
        self.sins: list[str] = []
        self._scenario = scenario
        self._fill_flash()
        scenario.prepare(self)
        for name, content in self.files.items():
            (folder / name).write_bytes(content)
        self.before = {
            place: self.double.nand.content(place.start, len(place)) for place in (OWN, ENVIRONMENT)
        }
        self.double.nand.witness = self._judge

    def _fill_flash(self) -> None:
        """As the factory leaves it: SPL, U-Boot, a kernel, a device tree, a root file system."""
        for address in (0, 0x100000):
            self.double.nand.load(address, self.random.randbytes(3 * BLOCK))
        self.old = {
            KERNEL_SLOT: uimage(self.random.randbytes(200_000)),
            TREE_SLOT: device_tree(self.random),
        }
        for place, content in self.old.items():
            self.double.nand.load(place.start, content)
        self.double.nand.load(0x1600000, self.random.randbytes(2 * BLOCK))

    def run(self, *more: str) -> int:
        """The exit code of the scenario's command, in this process."""
        command, *words = self._scenario.command
        words = [str(self.folder / word[1:]) if word.startswith("%") else word for word in words]
        return main([command, *words, *self._line(), *more])

    def _line(self) -> list[str]:
        return [
            *("--port", self.double.port, "--board-ip", f"{BOARD}/8", "--server-ip", SERVER),
            *("--tftp-port", str(self.port), "--site", str(self.site)),
        ]

    # ---- the invariants

    def _judge(self, operation: Operation) -> None:
        span = range(operation.address, operation.address + operation.size)
        if not any(inside(span, place) for place in self._scenario.may_write):
            self.sins.append(f"{operation} is outside of what may be written")
        elif operation.kind == "erase" and not inside(span, ENVIRONMENT):
            self._judge_erase(operation)

    def _judge_erase(self, operation: Operation) -> None:
        content = self.double.nand.content(operation.address, operation.size)
        if content.strip(b"\xff") and not any(content in kept for kept in self._kept()):
            self.sins.append(f"{operation}: no file of the host has what is there")
        if not any(self._mentions(path, operation) for path in self.site.rglob("journal.jsonl")):
            self.sins.append(f"{operation}: no journal tells it")

    def _kept(self) -> list[bytes]:
        return [path.read_bytes() for path in self.site.rglob("*") if path.is_file()]

    @staticmethod
    def _mentions(path: Path, operation: Operation) -> bool:
        events = [json.loads(line) for line in path.read_text().splitlines()]
        return any(operation.address in event.get("erases", ()) for event in events)

    def check(self) -> None:
        """What holds after every scenario, whatever went wrong."""
        assert self.sins == []
        for place, content in self.before.items():
            if not any(inside(place, allowed) for allowed in self._scenario.may_write):
                assert self.double.nand.content(place.start, len(place)) == content


def inside(one: range, other: range) -> bool:
    return other.start <= one.start and one.stop <= other.stop


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind((SERVER, 0))
        return taken.getsockname()[1]


# ---- files


def uimage(payload: bytes, load: int = 0x8000, arch: int = 2) -> bytes:
    """A legacy image of an uncompressed kernel."""

    def head(crc: int) -> bytes:
        fields = (0x27051956, crc, 0, len(payload), load, load, zlib.crc32(payload))
        return struct.pack(">7I4B32s", *fields, 5, arch, 2, 0, b"Linux")

    return head(zlib.crc32(head(0))) + payload


def device_tree(chance: random.Random, size: int = 20_000) -> bytes:
    """A tree with one property of random bytes."""
    strings = b"bytes\0"
    struct_size = 8 + 12 + size + 8
    total = 40 + 16 + struct_size + len(strings)
    header = struct.pack(
        ">10I", 0xD00DFEED, total, 56, 56 + struct_size, 40, 17, 16, 0, len(strings), struct_size
    )
    node = struct.pack(">II", 1, 0) + struct.pack(">III", 3, size, 0) + chance.randbytes(size)
    return header + bytes(16) + node + struct.pack(">II", 2, 9) + strings
