# SPDX-License-Identifier: GPL-3.0-or-later
"""Steps that more than one plan takes."""

from __future__ import annotations

import re
import zlib
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from nuc980.netboot import host
from nuc980.netboot.console import TRIES
from nuc980.netboot.errors import (
    FileRefused,
    LinkDown,
    NoAnswer,
    NoEthernet,
    NoMac,
    TftpTimeout,
    TransferBroken,
    TransferFailed,
    WrongBytes,
)
from nuc980.netboot.plan import Cost, Step
from nuc980.netboot.session import TFTP_PORT, Session
from nuc980.netboot.tftp import Transfer

# What the slowest transfer seen needs: 10 time-outs of 5 s (CONFIG_TFTP_TIMEOUT), and 20 kB/s.
PATIENCE = 60.0
SLOWEST = 20_000  # bytes/s
CRC_SLOWEST = 1_000_000  # bytes/s, a 300 MHz ARM926 without caches

# What may go well when it is done once more: a lost packet, a link that was not up yet.
PASSING = (TransferBroken, WrongBytes, LinkDown)


@dataclass(frozen=True)
class Slice:
    """Some bytes of a file on the host, as they were when the plan was made."""

    path: Path
    start: int
    size: int
    crc32: int

    @classmethod
    def of(cls, path: Path, start: int = 0, size: int | None = None) -> Self:
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
    phase: str = "load"

    def title(self) -> str:
        return f"Load {self.name}, {self.content.size} bytes, to {self.address:#x}."

    def commands(self) -> tuple[str, ...]:
        return (
            f"tftpboot {self.address:#x} {self.name}",
            crc_command(self.address, self.content.size),
        )

    def cost(self) -> Cost:
        return Cost(network=self.content.size, summed=self.content.size)

    def run(self, session: Session) -> None:
        """Up to TRIES times. Raises TransferFailed."""
        for _ in range(TRIES - 1):
            try:
                return self._load(session)
            except PASSING as error:
                session.progress.note(f"{error.what} Once more.")
        return self._load(session)

    def _load(self, session: Session) -> None:
        transfer, _ = self.commands()
        content = self.content
        assert session.files is not None
        offer = session.files.offer(self.name, content.path, content.start, content.size)
        with offer as moving, session.progress.bar(self.name, content.size) as bar:
            answer = session.console.run(
                transfer, PATIENCE + content.size / SLOWEST, lambda _: bar.at(moving.moved)
            )
            bar.at(moving.moved)
            if answer.status:
                raise why_not_loaded(answer.output, moving, session)
        if f"Bytes transferred = {content.size} " not in answer.output:
            raise self._wrong(
                f"{self.name} has {content.size} bytes; U-Boot says: {answer.output.strip()[-200:]}"
            )
        found = ram_crc(session, self.address, content.size)
        if found != content.crc32:
            raise self._wrong(
                f"{self.name}: CRC32 {found:08x} in the board's RAM, {content.crc32:08x} in the file."
            )

    def _wrong(self, what: str) -> WrongBytes:
        if Slice.of(self.content.path, self.content.start, self.content.size) == self.content:
            return WrongBytes(what)
        return WrongBytes(
            what,
            cause=f"{self.content.path} changed while the board was worked with",
            next_step="wait until the file is whole, and start again",
        )


def crc_command(address: int, size: int) -> str:
    """What asks for the CRC32 of some of the board's RAM."""
    return f"crc32 {address:#x} {size:#x}"


def ram_crc(session: Session, address: int, size: int) -> int:
    """The CRC32 of some of the board's RAM. Raises WrongBytes when U-Boot prints none."""
    received = session.console.run(crc_command(address, size), PATIENCE + size / CRC_SLOWEST).required()
    found = re.search(r"==> ([0-9a-f]{8})$", received, re.MULTILINE)
    if not found:
        raise WrongBytes(f"U-Boot's crc32 printed no sum: {received.strip()!r}")
    return int(found[1], 16)


def ram_has(session: Session, address: int, content: bytes) -> bool:
    """Whether some of the board's RAM has the CRC32 of this; see ram_has_crc."""
    return ram_has_crc(session, address, len(content), zlib.crc32(content))


def ram_has_crc(session: Session, address: int, size: int, crc32: int) -> bool:
    """Whether some of the board's RAM has this CRC32. A wrong sum may be the line's: it is asked again."""
    for _ in range(TRIES):
        with suppress(WrongBytes):  # no sum at all
            if ram_crc(session, address, size) == crc32:
                return True
    return False


# What U-Boot prints when a transfer fails, 2016.11 with the vendor's driver and 2023.01 with ours. The first
# that fits decides: what comes last comes first here, since U-Boot may have tried another port before.
WORDS: tuple[tuple[str, type[TransferFailed]], ...] = (
    (r"TFTP error: ", FileRefused),
    (r"ARP Retry count exceeded", NoAnswer),
    (r"address not set|illegal value", NoMac),
    (r"no link|[Ll]ink is down|No link|AN failed|Reset phy failed|auto negotiation .*TIMEOUT", LinkDown),
    (r"No ethernet found|Net Initialization Skipped", NoEthernet),
    (r"Retry count exceeded|TFTP server died", TftpTimeout),  # the latter: the server's port is closed
)


def why_not_loaded(output: str, transfer: Transfer, session: Session) -> TransferFailed:
    """The error for what U-Boot said when a transfer failed, and what the server saw of it."""
    kind = next((kind for words, kind in WORDS if re.search(words, output)), TransferFailed)
    lines = output.replace("*\b", "").strip().splitlines()
    received = "\n".join(f"  {line}" for line in lines[-6:])
    what = f"{transfer.name} was not loaded. U-Boot says:\n{received}"
    if kind is NoAnswer:
        return NoAnswer(what, next_step=f"{_host_advice(session)} The other port is chosen with --ethact.")
    if kind is not TftpTimeout:
        return kind(what)
    if transfer.moved:
        return TransferBroken(f"{transfer.name} broke off after {transfer.moved} of {transfer.size} bytes.")
    return _why_silent(what, session)


def _host_advice(session: Session) -> str:
    assert session.network is not None
    return host.advice(session.network.board.ip, host.addresses())


def _why_silent(what: str, session: Session) -> TftpTimeout:
    assert session.files is not None
    if session.files.refused:
        seen = "; ".join(str(refusal) for refusal in session.files.refused[-3:])
        return TftpTimeout(
            f"{what}\nThe server refused the request: {seen}",
            cause="another address than the board's: a NAT between them, or a second board",
            next_step="--seen-as ADDRESS names the board as the server sees it",
        )
    if session.files.port != TFTP_PORT:
        return TftpTimeout(
            what,
            cause=f"this U-Boot does not know tftpdstp and asks at port {TFTP_PORT}, or a firewall drops UDP",
            next_step=f"take port {TFTP_PORT} (no --tftp-port); let the board's UDP in",
        )
    return TftpTimeout(what, next_step=_host_advice(session))
