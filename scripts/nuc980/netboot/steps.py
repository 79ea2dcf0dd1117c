# SPDX-License-Identifier: GPL-3.0-or-later
"""Steps that more than one plan takes."""

from __future__ import annotations

import re
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from nuc980.netboot.errors import (
    FileRefused,
    LinkDown,
    NetbootError,
    NoAnswer,
    NoEthernet,
    TftpTimeout,
    WrongBytes,
)
from nuc980.netboot.plan import Step
from nuc980.netboot.session import Session

# What the slowest transfer seen needs: 10 time-outs of 5 s (CONFIG_TFTP_TIMEOUT), and 20 kB/s.
PATIENCE = 60.0
SLOWEST = 20_000  # bytes/s
CRC_SLOWEST = 1_000_000  # bytes/s, a 300 MHz ARM926 without caches


@dataclass(frozen=True)
class Slice:
    """Some bytes of a file on the host, as they were when the plan was made."""

    path: Path
    start: int
    size: int
    crc32: int

    @classmethod
    def of(cls, path: Path, start: int = 0, size: int | None = None) -> Slice:
        """Reads the file's bytes from start on; size None: to its end."""
        with path.open("rb") as file:
            file.seek(start)
            content = file.read() if size is None else file.read(size)
        return cls(path, start, len(content), zlib.crc32(content))


@dataclass(frozen=True)
class Load(Step):
    """Brings bytes into the board's RAM by TFTP, and compares size and CRC32 there with the file's."""

    name: str  # as the board asks for it
    content: Slice
    address: int
    phase: ClassVar[str] = "load"

    def title(self) -> str:
        return f"Load {self.name}, {self.content.size} bytes, to {self.address:#x}."

    def commands(self) -> tuple[str, ...]:
        return (
            f"tftpboot {self.address:#x} {self.name}",
            f"crc32 {self.address:#x} {self.content.size:#x}",
        )

    def run(self, session: Session) -> None:
        transfer, check = self.commands()
        content = self.content
        assert session.files is not None
        offer = session.files.offer(self.name, content.path, content.start, content.size)
        with offer as moving, session.progress.bar(self.name, content.size) as bar:
            answer = session.console.run(
                transfer, PATIENCE + content.size / SLOWEST, lambda _: bar.at(moving.moved)
            )
            bar.at(moving.moved)
        if answer.status:
            raise why_not_loaded(answer.output, self.name, session)
        if f"Bytes transferred = {content.size} " not in answer.output:
            raise WrongBytes(
                f"{self.name} has {content.size} bytes; U-Boot says: {answer.output.strip()[-200:]}"
            )
        found = crc_of(session.console.run(check, PATIENCE + content.size / CRC_SLOWEST).required())
        if found != content.crc32:
            raise WrongBytes(
                f"{self.name}: CRC32 {found:08x} in the board's RAM, {content.crc32:08x} in the file."
            )


def crc_of(output: str) -> int:
    """The number in what `crc32` prints: `… ==> 1a2b3c4d`. Raises WrongBytes when there is none."""
    found = re.search(r"==> ([0-9a-f]{8})$", output, re.MULTILINE)
    if not found:
        raise WrongBytes(f"U-Boot's crc32 printed no sum: {output.strip()!r}")
    return int(found[1], 16)


def why_not_loaded(output: str, name: str, session: Session) -> NetbootError:
    """The error for what U-Boot said when a transfer failed, and what the server saw of it."""
    said = f"{name} was not loaded. U-Boot: {output.strip()[-300:]}"
    if "No ethernet found" in output or "address not set" in output:
        return NoEthernet(said)
    if "TFTP error" in output:
        return FileRefused(said)
    if re.search(r"link (is )?down|[Nn]o link|not established", output):
        return LinkDown(said)
    if "ARP Retry count exceeded" in output:
        return NoAnswer(said)
    return TftpTimeout(said)
