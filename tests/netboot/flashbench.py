# SPDX-License-Identifier: GPL-3.0-or-later
"""A board with a flash on a desk: the twin with our U-Boot, its console on a pty, power that can be cut."""

import os
import pty
import random
import select
import shutil
import struct
import subprocess
import threading
import tty
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from ipaddress import IPv4Address, IPv4Interface
from pathlib import Path

from netboot import images
from nuc980.netboot.console import Console
from nuc980.netboot.errors import AutobootMissed
from nuc980.netboot.progress import Progress
from nuc980.netboot.session import Network, Session
from nuc980.netboot.transport import Line
from nuc980.twin.machine import Machine
from nuc980.twin.nand import DATA, PAGE, PAGES, NandImage

BLOCK = PAGES * DATA
OWN = range(0x200000 // BLOCK)  # blocks of SPL, environment and U-Boot
TABLES = range(1020, 1024)


class Board:
    """The twin, switched on until cut()."""

    def __init__(self, qemu: Path, uboot: Path, nand: NandImage | None, *arguments: str) -> None:
        drive = ("-drive", f"if=mtd,format=raw,file={nand.path}") if nand else ()
        nics = ("-nic", "user", "-nic", "user")
        self.machine = Machine(qemu, "-bios", uboot, *nics, *drive, *arguments, options="pace=off")
        self._master, slave = pty.openpty()
        tty.setraw(slave)
        self.port = os.ttyname(slave)
        self._slave = slave
        self._powered = True
        self._wires = [threading.Thread(target=wire, daemon=True) for wire in (self._to_host, self._to_board)]
        for wire in self._wires:
            wire.start()

    def _to_host(self) -> None:
        with suppress(OSError):
            while self._powered:
                data = self.machine.uarts[0].receive(0.05)
                while data:
                    data = data[os.write(self._master, data) :]

    def _to_board(self) -> None:
        with suppress(OSError):
            while self._powered:
                if select.select([self._master], [], [], 0.05)[0]:
                    self.machine.uarts[0].send(os.read(self._master, 4096))

    def cut(self) -> None:
        """Takes the power away, and the cable."""
        self.machine.process.kill()
        self._powered = False
        for wire in self._wires:
            wire.join()
        os.close(self._master)
        os.close(self._slave)
        self.machine.close()


@contextmanager
def switched_on(qemu: Path, uboot: Path, nand: NandImage | None, *arguments: str) -> Iterator[Board]:
    board = Board(qemu, uboot, nand, *arguments)
    try:
        yield board
    finally:
        with suppress(OSError):
            board.cut()


# ---- what is in a flash


def stream(nand: NandImage, blocks: Sequence[int], size: int | None = None) -> bytes:
    """The data of blocks, one after the other, without the spare bytes."""
    content = b"".join(block_data(nand, block) for block in blocks)
    return content[:size]


def block_data(nand: NandImage, block: int) -> bytes:
    raw = block_raw(nand, block)
    return b"".join(raw[at : at + DATA] for at in range(0, len(raw), PAGE))


def block_raw(nand: NandImage, block: int) -> bytes:
    """A block's pages with their spare bytes."""
    with nand.path.open("rb") as file:
        file.seek(block * PAGES * PAGE)
        return file.read(PAGES * PAGE)


def changed_blocks(one: Path, other: Path) -> set[int]:
    """The blocks that differ between two images, spare bytes included."""
    size = PAGES * PAGE
    with one.open("rb") as first, other.open("rb") as second:
        return {
            number for number in range(one.stat().st_size // size) if first.read(size) != second.read(size)
        }


# ---- files to write


def uimage(size: int, seed: int, program: bytes = b"", load: int = 0x8000) -> bytes:
    """A kernel of so many bytes that begins with a program."""
    return images.uimage(program + noise(size - 64 - len(program), seed), load)


def noise(size: int, seed: int) -> bytes:
    return random.Random(seed).randbytes(size)


def device_tree(uboot: Path, extra: int = 0) -> bytes:
    """The board's, with unused bytes at its end so that two differ."""
    tree = bytearray(uboot.with_suffix(".dtb").read_bytes() + bytes([extra]) * (4 * extra))
    struct.pack_into(">I", tree, 4, len(tree))
    return bytes(tree)


def ubi_image(folder: Path, name: str, seed: int, size: int = 300_000) -> bytes:
    """A UBI image with a UBIFS volume, made by mtd-utils."""
    content = folder / f"{name}.root"
    content.mkdir()
    (content / "file").write_bytes(noise(size, seed))
    ubifs, ini, ubi = (folder / f"{name}.{kind}" for kind in ("ubifs", "ini", "ubi"))
    run = {"check": True, "capture_output": True}
    subprocess.run(
        ["mkfs.ubifs", "-r", content, "-m", "2048", "-e", "126976", "-c", "700", "-o", ubifs], **run
    )
    ini.write_text(
        f"[root]\nmode=ubi\nimage={ubifs}\nvol_id=0\nvol_type=dynamic\nvol_name=root\nvol_flags=autoresize\n"
    )
    subprocess.run(["ubinize", "-o", ubi, "-m", "2048", "-p", "128KiB", ini], **run)
    return ubi.read_bytes()


# ---- at the tool's end


def network(device: str | None = None) -> Network:
    """QEMU's user network: the board sees the host as 10.0.2.2, the host sees the board as itself."""
    return Network(
        IPv4Interface("10.0.2.15/24"),
        IPv4Address("10.0.2.2"),
        0,
        device,
        IPv4Address("127.0.0.1"),
        IPv4Address("127.0.0.1"),
    )


def options(board: Board, site: Path, tftp_port: int = 0) -> list[str]:
    """The command line's for this bench."""
    return [
        "--port", board.port, "--site", str(site), "--board-ip", "10.0.2.15/24", "--server-ip", "10.0.2.2",
        "--listen", "127.0.0.1", "--seen-as", "127.0.0.1", "--tftp-port", str(tftp_port),
    ]  # fmt: skip


@contextmanager
def at_prompt(board: Board) -> Iterator[Session]:
    """A session at the board's U-Boot, for whose only look at the keys a busy host may be late."""
    with Line(board.port) as line:
        console = Console(line)
        try:
            console.reach()
        except AutobootMissed:
            console.reach(lambda: board.machine.command("system_reset"))
        with Path(os.devnull).open("w") as nowhere:
            yield Session(console, Progress(nowhere))


@contextmanager
def stopped(qemu: Path, uboot: Path, nand: NandImage) -> Iterator[Board]:
    """Switched on, and at its prompt: what is tried there does not depend on being quick at a start."""
    with switched_on(qemu, uboot, nand) as board:
        with at_prompt(board):
            pass
        yield board


def copy(image: NandImage, target: Path) -> NandImage:
    shutil.copyfile(image.path, target)
    return NandImage(target)
