# SPDX-License-Identifier: GPL-3.0-or-later
"""What is this board? Asked at U-Boot's prompt; nothing is changed."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from nuc980.netboot.console import Console
from nuc980.netboot.environment import read_environment
from nuc980.netboot.progress import Progress


@dataclass(frozen=True)
class Nand:
    """The flash as U-Boot sees it; sizes and offsets in bytes."""

    size: int
    block: int
    page: int
    bad: tuple[int, ...]  # offsets of the bad blocks


@dataclass(frozen=True)
class BoardReport:
    """What a board's U-Boot said of it."""

    version: str
    commands: frozenset[str]
    environment: dict[str, str] = field(hash=False)
    ram: tuple[tuple[int, int], ...]  # banks: start, size
    ram_end: int  # below here nothing of U-Boot's own lies
    nand: Nand | None = None

    def knows(self, command: str) -> bool:
        """Whether this U-Boot has a command."""
        return command in self.commands


def probe(console: Console, progress: Progress, *, flash: bool) -> BoardReport:
    """Asks the board. flash: also its NAND (on the first access U-Boot may write a bad-block table there)."""
    with progress.phase("probe"):
        version = console.run("version").required()
        commands = console.run("help").required()
        banks = console.run("bdinfo").required()
        environment = read_environment(console)
    names = frozenset(re.findall(r"^(\S+?) *- ", commands, re.MULTILINE))
    starts = [int(number, 16) for number in re.findall(r"-> start +=\s*(0x[0-9a-fA-F]+)", banks)]
    sizes = [int(number, 16) for number in re.findall(r"-> size +=\s*(0x[0-9a-fA-F]+)", banks)]
    ram = tuple(zip(starts, sizes, strict=True))
    return BoardReport(
        version=version.strip().splitlines()[0],
        commands=names,
        environment=environment,
        ram=tuple(bank for bank in ram if bank[1]),
        ram_end=_below_uboot(banks),
        nand=probe_nand(console) if flash and "nand" in names else None,
    )


def _below_uboot(banks: str) -> int:
    """The lowest of what bdinfo says U-Boot itself uses: its code, its stack."""
    own = [
        int(number, 16)
        for number in re.findall(r"(?:relocaddr|irq_sp|sp start) +=\s*(0x[0-9a-fA-F]+)", banks)
    ]
    return min(own, default=0)


def probe_nand(console: Console) -> Nand | None:
    """Geometry and bad blocks, or None when U-Boot finds no flash."""
    info = console.run("nand info", 30).output
    found = re.search(r"sector size (\d+) KiB", info)
    page = re.search(r"Page size +(\d+) b", info)
    if not found or not page:
        return None
    bad = re.findall(r"^ +([0-9a-f]{8})", console.run("nand bad", 30).required(), re.MULTILINE)
    return Nand(
        size=_nand_size(console),
        block=int(found[1]) << 10,
        page=int(page[1]),
        bad=tuple(int(offset, 16) for offset in bad),
    )


def _nand_size(console: Console) -> int:
    """No command prints it; reading nothing fails from the flash's end on. A power of two, 8 GiB at most."""
    size = 1 << 20
    while (
        size < 1 << 33 and "exceeds device limit" not in console.run(f"nand read 0x100000 {size:#x} 0").output
    ):
        size <<= 1
    return size
