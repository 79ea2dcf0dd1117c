# SPDX-License-Identifier: GPL-3.0-or-later
"""The nand command and saveenv: cmd/nand.c, drivers/mtd/nand/nand_util.c and common/env_nand.c."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from . import environment
from .nand import BLOCK, PAGE, SIZE
from .text import whole_number

if TYPE_CHECKING:
    from .board import Board

EIO, EBADMSG, EINVAL = -5, -74, -22
LIMIT = "Size exceeds partition or device limit\n"


def nand(board: Board, words: list[str], repeat: bool) -> int:
    if len(words) < 2:
        return board.usage("nand")
    if repeat:
        return 0
    name, _, suffix = words[1].partition(".")
    match name, suffix:
        case "info", "":
            _info(board)
            return 0
        case "device", "":
            if len(words) == 2:
                _info(board)
            elif words[2] != "0":
                board.puts("No such device\n")
            return 0
        case "bad", "":
            board.puts("\nDevice 0 bad blocks:\n")
            for block in sorted(board.bad_blocks):
                board.puts(f"  {block * BLOCK:08x}\n")
            return 0
        case "erase", "" | "part" | "chip" | "spread":
            return _erase(board, words, suffix)
        case ("read" | "write", "" | "e" | "i" | "jffs2") | ("write", "trimffs"):
            return _move(board, words) if len(words) > 3 else board.usage("nand")
        case "markbad", "":
            return _mark(board, words[2:]) if len(words) > 2 else board.usage("nand")
    return board.usage("nand")


def mtdparts(board: Board, words: list[str], repeat: bool) -> int:
    parts = partitions(board)
    board.puts(f"\ndevice nand0 <nand0>, # parts = {len(parts)}\n")
    board.puts(" #: name\t\tsize\t\toffset\t\tmask_flags\n")
    for number, (name, (offset, size)) in enumerate(parts.items()):
        board.puts(f"{number:2}: {name:<20}0x{size:08x}\t0x{offset:08x}\t0\n")
    _choose_first(board, parts)
    name, (offset, size) = next(iter(parts.items()))
    board.puts(f"\nactive partition: nand0,0 - ({name}) 0x{size:08x} @ 0x{offset:08x}\n")
    board.puts(f"\ndefaults:\nmtdids  : nand0=nand0\nmtdparts: {board.variant.mtdparts}\n")
    return 0


def _choose_first(board: Board, parts: dict[str, tuple[int, int]]) -> None:
    """The variables that the first look at the partitions leaves."""
    board.variables |= {"mtddevname": next(iter(parts)), "mtddevnum": "0", "partition": "nand0,0"}
    board.variables |= {
        "mtdids": "nand0=nand0",
        "mtdparts": board.variables.get("mtdparts") or board.variant.mtdparts,
    }


def partitions(board: Board) -> dict[str, tuple[int, int]]:
    """Offset and size by name, of the environment's mtdparts or the build's."""
    found: dict[str, tuple[int, int]] = {}
    end = 0
    text = board.variables.get("mtdparts") or board.variant.mtdparts
    for size, offset, name in re.findall(r"[:,](-|0x\w+)(?:@(0x\w+))?\(([^)]*)\)", text):
        start = int(offset, 16) if offset else end
        length = SIZE - start if size == "-" else int(size, 16)
        found[name] = (start, length)
        end = start + length
    return found


def saveenv(board: Board, words: list[str], repeat: bool) -> int:
    try:
        stored = environment.packed(board.variables, board.variant.env_size)
    except OverflowError:
        board.puts("## Error: Cannot export environment: errno = 22\n")
        return 1
    board.puts(board.variant.saving)
    _erase_range(board, environment.OFFSET, environment.RANGE * BLOCK)
    board.puts("Writing to NAND... ")
    first = environment.OFFSET // BLOCK
    good = [block for block in range(first, first + environment.RANGE) if block not in board.bad_blocks]
    ours = board.variant.name == "ours"
    if not good or _program(board, good[0] * BLOCK, stored):
        board.puts("FAILED!\n" + ("Failed (1)\n" if ours else ""))
        return 1
    board.puts("OK\n" + ("OK\n" if ours else ""))
    return 0


def stored_environment(board: Board) -> dict[str, str] | None:
    """What the boot finds in the flash."""
    first = environment.OFFSET // BLOCK
    for block in range(first, first + environment.RANGE):
        if block not in board.bad_blocks:
            if not board.nand.fits(block * BLOCK, board.variant.env_size):
                return None
            return environment.unpacked(board.nand.content(block * BLOCK, board.variant.env_size))
    return None


def _info(board: Board) -> None:
    board.puts("\nDevice 0: nand0, sector size 128 KiB\n")
    board.puts(board.variant.nand_info)
    board.variables |= {"nand_writesize": f"{PAGE:x}", "nand_oobsize": "40", "nand_erasesize": f"{BLOCK:x}"}


def _range(board: Board, arguments: list[str]) -> tuple[int, int, int] | None:
    """Offset, size, and how much may be used: mtd_arg_off_size. None: refused, and said so."""
    if not arguments:
        offset, size, most = 0, SIZE, SIZE
    else:
        start = whole_number(arguments[0])
        if start is None:
            parts = partitions(board)
            _choose_first(board, parts)
            if arguments[0] not in parts:
                board.puts(f"incorrect device type in {arguments[0]}\n")
                return None
            offset, size = parts[arguments[0]]
            most = size
        elif start >= SIZE:
            board.puts("Offset exceeds device limit\n")
            return None
        else:
            offset, size, most = start, SIZE - start, SIZE - start
    if len(arguments) > 1:
        wanted = whole_number(arguments[1])
        if wanted is None:
            board.puts(f"'{arguments[1]}' is not a number\n")
            return None
        size = wanted
    if size > most:
        board.puts(LIMIT)
        return None
    board.puts("device 0 ")
    board.puts("whole chip\n" if size == SIZE else f"offset 0x{offset:x}, size 0x{size:x}\n")
    return offset, size, most


def _erase(board: Board, words: list[str], suffix: str) -> int:
    if len(words) != 2 + {"": 2, "spread": 2, "part": 1, "chip": 0}[suffix]:
        return board.usage("nand")
    board.puts(f"\nNAND {words[1]}: ")
    found = _range(board, words[2:])
    if found is None:
        return 1
    offset, size, _ = found
    if offset % BLOCK:
        board.puts("Attempt to erase non block-aligned data\nERROR\n")
        return 1
    _erase_range(board, offset, size, spread=suffix == "spread")
    board.puts("OK\n")
    return 0


def _erase_range(board: Board, offset: int, size: int, spread: bool = False) -> None:
    """A block that cannot be erased is told and passed over: the whole is "OK" all the same."""
    wanted = (size + BLOCK - 1) // BLOCK
    done, shown, block = 0, -1, offset // BLOCK
    while done < wanted and block < SIZE // BLOCK:
        if block in board.bad_blocks:
            board.puts(f"\rSkipping bad block at  0x{block * BLOCK:08x}{' ' * 42}\n")
            done += not spread
        else:
            done += 1
            good = all([fault.erases(board, block) for fault in board.faults])
            board.nand.erase(block, good)
            percent = done * 100 // wanted
            if not good:
                board.puts(f"\nnand0: MTD Erase failure: {EIO}\n")
            elif percent != shown:
                shown = percent
                board.puts(f"\rErasing at 0x{block * BLOCK:x} -- {percent:3}% complete.")
        block += 1
    board.puts("\n")


def _move(board: Board, words: list[str]) -> int:
    reads = words[1].startswith("read")
    board.puts(f"\nNAND {'read' if reads else 'write'}: ")
    found = _range(board, words[3:])
    if found is None:
        return 1
    offset, size, most = found
    if len(words) < 5:
        bad = sum(block in board.bad_blocks for block in range(offset // BLOCK, (offset + size) // BLOCK))
        if bad:
            size -= bad * BLOCK
            board.puts(f"size adjusted to 0x{size:x} ({bad} bad blocks)\n")
    trims = words[1].endswith(".trimffs")
    if trims and not board.variant.trims:
        board.puts("Unknown nand command suffix '.trimffs'.\n")
        return 1
    moved, error = _skip_bad(board, board.number(words[2]), offset, size, most, reads, trims)
    done = "read" if reads else "written"
    board.puts(f" {moved} bytes {done}: {'ERROR' if error else 'OK'}\n")
    return 1 if error else 0


def _skip_bad(
    board: Board, address: int, offset: int, size: int, most: int, reads: bool, trims: bool
) -> tuple[int, int]:
    """nand_read_skip_bad and nand_write_skip_bad: how many bytes, and the error."""
    verb = "read" if reads else "write"
    if offset % PAGE:
        board.puts(f"Attempt to {verb} non page-aligned data\n")
        return 0, EINVAL
    used, bad = _used(board, offset, size)
    if used is None:
        board.puts(f"Attempt to {verb} outside the flash area\n")
        return 0, EINVAL
    if used > most:
        board.puts(f"Size of {verb} exceeds partition or device limit\n")
        return 0, EINVAL
    left = size
    while left > 0:
        block, within = divmod(offset, BLOCK)
        if block in board.bad_blocks:
            board.puts(f"{'Skipping' if reads else 'Skip'} bad block 0x{block * BLOCK:08x}\n")
            offset += BLOCK - within
            continue
        part = min(left, BLOCK - within) if bad or trims else left
        if reads:
            error = _read(board, offset, part, address)
        else:
            error = _write(board, offset, _without_ones(board, address, part) if trims else part, address)
        if error:
            board.puts(f"NAND {verb} {'from' if reads else 'to'} offset {offset:x} failed {error}\n")
            return (size - left if bad or trims else 0), error
        left, offset, address = left - part, offset + part, address + part
    return size, 0


def _without_ones(board: Board, address: int, size: int) -> int:
    """drop_ffs: without the erased pages at the end."""
    used = len(board.memory(address, size).rstrip(b"\xff"))
    return min(size, -(-used // PAGE) * PAGE)


def _used(board: Board, offset: int, size: int) -> tuple[int | None, bool]:
    """check_skip_len: how much of the flash the size takes, and whether there are bad blocks in it."""
    start, good, bad = offset, 0, False
    while good < size:
        if offset >= SIZE:
            return None, bad
        length = BLOCK - offset % BLOCK
        if offset // BLOCK in board.bad_blocks:
            bad = True
        else:
            good += length
        offset += length
    return offset - start - max(0, good - size), bad


def _read(board: Board, offset: int, size: int, address: int) -> int:
    board.store(address, board.nand.content(offset, size))
    return 0 if board.nand.fits(offset, size) else EBADMSG


def _write(board: Board, offset: int, size: int, address: int) -> int:
    """With U-Boot's own check of what it has written."""
    data = board.memory(address, size)
    if _program(board, offset, data) or not board.nand.fits(offset, size):
        return EIO
    if board.nand.content(offset, size) != data:
        return EIO
    for fault in board.faults:
        fault.written(board, offset, size)
    return 0


def _program(board: Board, offset: int, data: bytes) -> int:
    """Whole pages: an incomplete one is filled with ones."""
    data += b"\xff" * (-len(data) % PAGE)
    at = 0
    while at < len(data):
        address = offset + at
        part = data[at : at + BLOCK - address % BLOCK]
        wanted: bytes | None = part
        for fault in board.faults:
            wanted = fault.programs(board, address, wanted) if wanted is not None else None
        board.nand.program(address, part if wanted is None else wanted, good=wanted is not None)
        if wanted is None:
            return EIO
        at += len(part)
    return 0


def _mark(board: Board, offsets: list[str]) -> int:
    for text in offsets:
        offset = board.number(text)
        board.nand.bad.add(offset // BLOCK)
        board.puts(f"block 0x{offset:08x} successfully marked as bad\n")
    return 0
