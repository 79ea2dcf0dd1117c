# SPDX-License-Identifier: GPL-3.0-or-later
"""What is in a slot of the flash, brought to the host before anything is erased."""

from __future__ import annotations

import os
import re
import shutil
import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Protocol

from nuc980.netboot.console import TRIES, Answer
from nuc980.netboot.errors import BackupFailed, LineUnsafe
from nuc980.netboot.plan import Cost, Step
from nuc980.netboot.session import Session
from nuc980.netboot.steps import CRC_SLOWEST, PATIENCE, SLOWEST, crc_command, ram_crc, ram_has

MD_BYTES = 4096  # a command's worth of md.l: 17 kB of text, 1.5 s
MD_PRINTS = 67  # characters for 16 bytes
MD_LINE = re.compile(r"^([0-9a-f]{8}): ((?:[0-9a-f]{8} ){1,4})", re.MULTILINE)
UNCORRECTABLE = "failed -74"  # EBADMSG, of which U-Boot gives the bytes all the same


class Way(Protocol):
    """How bytes get from the board's RAM into a file. needs: the commands for it."""

    needs: ClassVar[tuple[str, ...]]

    def commands(self, address: int, size: int, name: str) -> tuple[str, ...]: ...

    def cost(self, size: int) -> Cost: ...

    def fetch(self, session: Session, address: int, size: int, name: str, target: Path) -> None:
        """Into a new file. Raises BackupFailed."""


class ByTftp:
    """With tftpput: what the U-Boot has it for."""

    needs: ClassVar[tuple[str, ...]] = ("tftpput",)

    def commands(self, address: int, size: int, name: str) -> tuple[str, ...]:
        return (f"tftpput {address:#x} {size:#x} {name}",)

    def cost(self, size: int) -> Cost:
        return Cost(network=size)

    def fetch(self, session: Session, address: int, size: int, name: str, target: Path) -> None:
        assert session.files is not None
        (command,) = self.commands(address, size, name)
        target.unlink(missing_ok=True)
        with session.files.accept(name, target, size) as moving, session.progress.bar(name, size) as bar:
            answer = session.console.run(command, PATIENCE + size / SLOWEST, lambda _: bar.at(moving.moved))
            bar.at(moving.moved)
        if answer.status or not target.exists():
            raise BackupFailed(f"{name} did not reach the host. U-Boot: {answer.output.strip()[-300:]}")


@dataclass(frozen=True)
class BySerial:
    """With md, block by block, each against its CRC32; what is all 0xFF is known by that and not sent."""

    block: int
    needs: ClassVar[tuple[str, ...]] = ("md",)

    def commands(self, address: int, size: int, name: str) -> tuple[str, ...]:
        """As for blocks of which none is erased."""
        return tuple(
            command
            for block in range(address, address + size, self.block)
            for command in (
                crc_command(block, self.block),
                *(_md(at) for at in range(block, block + self.block, MD_BYTES)),
            )
        )

    def cost(self, size: int) -> Cost:
        """The same."""
        return Cost(summed=size, printed=size // 16 * MD_PRINTS)

    def fetch(self, session: Session, address: int, size: int, name: str, target: Path) -> None:
        with target.open("wb") as file, session.progress.bar(name, size) as bar:
            for block in range(address, address + size, self.block):
                file.write(self.content(session, block))
                bar.at(file.tell())

    def content(self, session: Session, address: int) -> bytes:
        """Of a block that lies in the board's RAM. Raises BackupFailed."""
        wanted = ram_crc(session, address, self.block)
        erased = b"\xff" * self.block
        if wanted == zlib.crc32(erased):
            return erased
        for _ in range(TRIES):
            pieces = (_md_piece(session, at) for at in range(address, address + self.block, MD_BYTES))
            content = b"".join(pieces)
            if zlib.crc32(content) == wanted or ram_has(session, address, content):
                return content
        raise BackupFailed(
            f"What md shows of {address:#x} never has the CRC32 {wanted:08x} of the board's RAM."
        )


def _md(address: int) -> str:
    return f"md.l {address:#x} {MD_BYTES // 4:#x}"


def _md_piece(session: Session, address: int) -> bytes:
    """MD_BYTES of RAM; read again when a line is missing or is none."""
    for _ in range(TRIES):
        lines = MD_LINE.findall(session.console.run(_md(address), PATIENCE).required())
        if [int(at, 16) for at, _ in lines] == list(range(address, address + MD_BYTES, 16)):
            words = [int(word, 16) for _, text in lines for word in text.split()]
            if len(words) == MD_BYTES // 4:
                return struct.pack(f"<{len(words)}I", *words)
    raise LineUnsafe(f"md does not show {address:#x} whole.")


def nand_read(address: int, offset: int, size: int) -> str:
    """The command."""
    return f"nand read {address:#x} {offset:#x} {size:#x}"


def reads_well(session: Session, address: int, offset: int, size: int) -> bool:
    """Whether U-Boot says that it has read all, with nothing beyond its error correction.

    Asked again when it says neither: noise in its words is no worn block.
    """
    for _ in range(TRIES):
        answer = _read(session, address, offset, size)
        if answer.status or _is_whole(answer, size):
            return not answer.status
    return False


def read_block(session: Session, address: int, offset: int, block: int) -> bool:
    """Whether a block reads well; False for one beyond its correction, as it came. Raises BackupFailed."""
    for _ in range(TRIES):  # a driver that gave up once, or noise in its words, is no worn block
        answer = _read(session, address, offset, block)
        if _is_whole(answer, block):
            return True
        if UNCORRECTABLE in answer.output:
            session.progress.note(f"  The block at {offset:#x} cannot be read; it is kept as it came.")
            return False
    raise BackupFailed(  # nothing of the flash came
        f"The block at {offset:#x} cannot be read. U-Boot: {answer.output.strip()[-300:]}",
        cause="the flash or its driver, not a worn page",
    )


def _read(session: Session, address: int, offset: int, size: int) -> Answer:
    return session.console.run(nand_read(address, offset, size), PATIENCE + size / CRC_SLOWEST)


def _is_whole(answer: Answer, size: int) -> bool:
    return answer.status == 0 and f" {size} bytes read: OK" in answer.output


@dataclass(frozen=True)
class BackUp(Step):
    """Some good blocks of a slot, one after the other, appended to the slot's backup file."""

    image: str  # the slot's name
    blocks: tuple[int, ...]  # offsets
    block: int
    address: int  # in RAM
    file: Path
    is_first: bool
    way: Way
    phase: ClassVar[str] = "back up"

    @property
    def size(self) -> int:
        return len(self.blocks) * self.block

    @property
    def name(self) -> str:
        """For the transfer."""
        return f"{self.file.stem}-{self.blocks[0]:x}"

    def title(self) -> str:
        return (
            f"Back up {self.size} bytes of the {self.image}'s place from {self.blocks[0]:#x} to {self.file}."
        )

    def commands(self) -> tuple[str, ...]:
        return (
            nand_read(self.address, self.blocks[0], self.size),
            crc_command(self.address, self.size),
            *self.way.commands(self.address, self.size, self.name),
        )

    def cost(self) -> Cost:
        return Cost(read=self.size, summed=self.size) + self.way.cost(self.size)

    def run(self, session: Session) -> None:
        if not reads_well(session, self.address, self.blocks[0], self.size):
            self._read_by_block(session)
        wanted = ram_crc(session, self.address, self.size)
        part = self.file.with_suffix(".part")
        self.way.fetch(session, self.address, self.size, self.name, part)
        content = part.read_bytes()
        is_same = zlib.crc32(content) == wanted or ram_has(session, self.address, content)
        if len(content) != self.size or not is_same:
            raise BackupFailed(
                f"{part}: {len(content)} bytes with the CRC32 {zlib.crc32(content):08x};"
                f" the board has {self.size} with {wanted:08x}."
            )
        with self.file.open("wb" if self.is_first else "ab") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        part.unlink()

    def _read_by_block(self, session: Session) -> None:
        """A page that cannot be corrected ends a read over bad blocks: each block for itself, as it comes."""
        for number, offset in enumerate(self.blocks):
            read_block(session, self.address + number * self.block, offset, self.block)


def plan_backup(
    image: str, blocks: Sequence[int], block: int, address: int, chunk: int, file: Path, way: Way
) -> tuple[BackUp, ...]:
    """The steps for a slot's good blocks. chunk: how many bytes of RAM may be used from the address on."""
    count = chunk // block
    return tuple(
        BackUp(image, tuple(blocks[at : at + count]), block, address, file, at == 0, way)
        for at in range(0, len(blocks), count)
    )


def check_room(folder: Path, size: int) -> None:
    """Raises BackupFailed when the host's disk cannot hold so many bytes."""
    free = shutil.disk_usage(folder).free
    if free < size:
        raise BackupFailed(
            f"{folder} has {free} bytes free; the backup needs {size}.", cause="the disk is full"
        )
