# SPDX-License-Identifier: GPL-3.0-or-later
"""What is in the flash, brought to the host by a Linux out of RAM: minutes where a U-Boot has no tftpput.

U-Boot reads each piece first and tells its CRC32; what Linux sends must have the same: two drivers agree on
the bytes, and nothing changed them in between. That Linux runs a script of ours in the place of its init, out
of the device tree. It cannot write: the tree's only partition is read-only, nothing attaches UBI, and with
the tables of bad blocks in the flash, or not wanted by the tree, no driver has a reason to write them.
"""

from __future__ import annotations

import os
import re
import zlib
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import ClassVar

import libfdt

from nuc980.netboot.board import BoardReport, Nand
from nuc980.netboot.boot import (
    IN_THE_WAY,
    TREE_GROWTH,
    Addresses,
    Images,
    StartKernel,
    own_arguments,
    tree_for,
)
from nuc980.netboot.console import TRIES
from nuc980.netboot.errors import (
    BackupFailed,
    FlashNotPossible,
    PowerHookFailed,
    UnusableImage,
    WrongBytes,
)
from nuc980.netboot.flash.backup import BySerial, nand_read, read_block, reads_well
from nuc980.netboot.flash.tables import MIRROR, TABLE, tables_slot
from nuc980.netboot.linux import Goal
from nuc980.netboot.plan import Cost, SetVariable, Step
from nuc980.netboot.progress import Progress
from nuc980.netboot.session import Network, Session
from nuc980.netboot.steps import PATIENCE, Load, Slice, crc_command, ram_crc
from nuc980.netboot.tftp import Transfer

NEEDS = ("bootm", "md")
CHUNK = 8 << 20  # summed up by U-Boot at once, bytes
PIECE = 8  # blocks, after which Linux says how far it is
HELLO = "hello"  # a file that shows which port the network is at
SAYS = "backup: "  # begins each line of the script's
LABEL = "backup"  # of the partition that is all of the flash
SCRIPT = "openrtu,backup"  # the property of /chosen that has the script
BOOT = Goal(seconds=120.0)
PIECE_SECONDS = 300.0  # patience with a piece, and with the way to the first one
RESTART_SECONDS = 20.0  # forecast: Linux comes up, and U-Boot again
TABLE_MARKS = frozenset(int.from_bytes(word, "little") for word in (TABLE, MIRROR))  # as md.l shows them
# What of a tree's arguments is kept: a word more could attach UBI.
KEPT_WORDS = ("console=", "earlycon", "earlyprintk", "mem=")


@dataclass(frozen=True)
class Place:
    """A slot: the offsets of its good blocks, and the file for what is in them."""

    image: str
    blocks: tuple[int, ...]
    block: int
    file: Path

    @property
    def name(self) -> str:
        """For the transfer."""
        return self.file.stem

    @property
    def size(self) -> int:
        return len(self.blocks) * self.block


@dataclass
class Findings:
    """What U-Boot saw of the places, by image and index of a first block."""

    sums: dict[tuple[str, int], tuple[int, int]] = field(default_factory=dict)  # number of blocks, CRC32
    worn: dict[tuple[str, int], bytes] = field(default_factory=dict)  # a block beyond its ECC, as it came

    def apply(self, place: Place, content: bytearray) -> None:
        """Puts worn blocks into what Linux has sent, and compares all others. Raises BackupFailed."""
        if len(content) != place.size:
            raise BackupFailed(f"Linux sent {len(content)} bytes of the {place.image}'s {place.size}.")
        worn = {first: block for (image, first), block in self.worn.items() if image == place.image}
        sums = {first: each for (image, first), each in self.sums.items() if image == place.image}
        if len(worn) + sum(count for count, _ in sums.values()) != len(place.blocks):
            raise BackupFailed(f"U-Boot did not sum up all of the {place.image}'s place.")
        for first, block in worn.items():
            content[first * place.block : (first + 1) * place.block] = block
        for first, (count, crc32) in sums.items():
            found = zlib.crc32(content[first * place.block : (first + count) * place.block])
            if found != crc32:
                raise BackupFailed(
                    f"{count} blocks from {place.blocks[first]:#x} on ({place.image}): what Linux read has"
                    f" the CRC32 {found:08x}, what U-Boot read {crc32:08x}.",
                    cause="pages that read differently each time, or a kernel that changed the flash",
                    next_step="start again; --backup-by serial takes the other way",
                )


# ---- the steps


@dataclass(frozen=True)
class FindTables(Step):
    """That Linux finds the tables of bad blocks, which some kernels would write whatever the tree says."""

    nand: Nand
    address: int
    phase: ClassVar[str] = "back up"

    def title(self) -> str:
        return "Look for the tables of bad blocks."

    def commands(self) -> tuple[str, ...]:
        return tuple(command for pair in self._pairs() for command in pair)

    def _pairs(self) -> Iterator[tuple[str, str]]:
        for offset in tables_slot(self.nand).blocks(self.nand):
            yield nand_read(self.address, offset, self.nand.page), f"md.l {self.address:#x} 1"

    def run(self, session: Session) -> None:
        marks = set()
        for read, show in self._pairs():
            if session.console.run(read, PATIENCE).status == 0:
                received = session.console.run_twice(show).required()
                marks |= {int(word, 16) for word in re.findall(r": ([0-9a-f]{8}) ", received)}
        if not marks >= TABLE_MARKS:
            raise FlashNotPossible(
                "The flash has no tables of bad blocks: some kernels would write them into its last blocks.",
                cause="Linux has not run on this board yet",
                next_step="--backup-by serial",
            )


@dataclass(frozen=True)
class SumUp(Step):
    """U-Boot's reading of some of a place's blocks, from its block number `first` on."""

    place: Place
    first: int
    count: int
    address: int
    found: Findings = field(compare=False)
    phase: ClassVar[str] = "back up"

    @property
    def _blocks(self) -> tuple[int, ...]:
        return self.place.blocks[self.first : self.first + self.count]

    @property
    def _size(self) -> int:
        return self.count * self.place.block

    def title(self) -> str:
        return f"Sum up {self._size} bytes of the {self.place.image}'s place from {self._blocks[0]:#x}."

    def commands(self) -> tuple[str, ...]:
        crc32 = crc_command(self.address, self._size)
        return nand_read(self.address, self._blocks[0], self._size), crc32, crc32

    def cost(self) -> Cost:
        return Cost(read=self._size, summed=2 * self._size)

    def run(self, session: Session) -> None:
        image, block = self.place.image, self.place.block
        if reads_well(session, self.address, self._blocks[0], self._size):
            self.found.sums[image, self.first] = self.count, _sum(session, self.address, self._size)
            return
        for index, offset in enumerate(self._blocks, self.first):
            if read_block(session, self.address, offset, block):
                self.found.sums[image, index] = 1, _sum(session, self.address, block)
            else:  # each reading is another: this one counts, and comes over the serial line
                self.found.worn[image, index] = BySerial(block).content(session, self.address)


def _sum(session: Session, address: int, size: int) -> int:
    """The CRC32, when it came twice the same. Raises WrongBytes."""
    seen = set()
    for _ in range(2 * TRIES):
        with suppress(WrongBytes):
            crc32 = ram_crc(session, address, size)
            if crc32 in seen:
                return crc32
            seen.add(crc32)
    raise WrongBytes(f"Each CRC32 of {size} bytes at {address:#x} is another.")


@dataclass(frozen=True)
class SendByLinux(Step):
    """Starts the kernel, takes what it sends, compares it; in the end the board is at its prompt again."""

    places: tuple[Place, ...]
    start: StartKernel
    served: Path  # any file: for `hello`
    found: Findings = field(compare=False)
    phase: ClassVar[str] = "back up"

    @property
    def _size(self) -> int:
        return sum(place.size for place in self.places)

    def title(self) -> str:
        return f"Start a Linux that sends {self._size} bytes of the flash, and U-Boot again."

    def commands(self) -> tuple[str, ...]:
        return (*self.start.commands(), "version")  # the latter by Console.reach()

    def cost(self) -> Cost:
        return Cost(network=self._size, seconds=RESTART_SECONDS)

    def run(self, session: Session) -> None:
        files = session.files
        assert files is not None
        with ExitStack() as stack:
            stack.enter_context(files.offer(HELLO, self.served, 0, 1))
            moving = [
                stack.enter_context(files.accept(place.name, _fresh(place), place.size))
                for place in self.places
            ]
            self.start.run(session)
            assert session.linux is not None
            session.linux.show = partial(_show, session.progress)
            for place, transfer in zip(self.places, moving, strict=True):
                self._receive(session, place, transfer)
        self._return(session)
        for place in self.places:
            self._keep(place)

    def _return(self, session: Session) -> None:
        """To U-Boot; at once, before it boots what the flash holds."""
        session.linux = None
        try:
            session.console.reach(lambda: None)  # who starts the board anew is Linux
        except PowerHookFailed as failed:
            raise BackupFailed(
                "The Linux on the board did not restart it.",
                cause="this kernel cannot restart the board",
                next_step="switch the board off and on, and start again with --backup-by serial",
            ) from failed

    def _receive(self, session: Session, place: Place, transfer: Transfer) -> None:
        linux = session.linux
        assert linux is not None
        goal = Goal(rf"^{SAYS}(failed: .*|{place.name} (piece \d+|ended));", PIECE_SECONDS)
        with session.progress.bar(place.name, place.size) as bar:
            while (received := linux.until(goal).removeprefix(SAYS)).startswith(f"{place.name} piece"):
                bar.at(transfer.moved)
            if not transfer.finished:
                raise BackupFailed(f"The Linux on the board says of the {place.image}'s place: {received}")
            bar.at(place.size)

    def _keep(self, place: Place) -> None:
        """The whole backup, or none of this name."""
        part = _part(place)
        content = bytearray(part.read_bytes())
        self.found.apply(place, content)
        with part.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        part.rename(place.file)


def _part(place: Place) -> Path:
    return place.file.with_suffix(".part")


def _fresh(place: Place) -> Path:
    _part(place).unlink(missing_ok=True)
    return _part(place)


def _show(progress: Progress, line: str) -> None:
    """A bar tells what the script says."""
    if line and not line.startswith(SAYS):
        progress.note(f"  | {line}")


# ---- the plan


def checked(kernel: Path, tree: Path, board: BoardReport) -> Images:
    """Files for this board. Raises UnusableImage, DoesNotFit."""
    images = Images.read(kernel, tree)
    images.check(board, Addresses.of(board))
    _flash_node(images.tree)
    return images


def plan_linux(
    board: BoardReport,
    network: Network,
    macs: Sequence[str],
    kernel: Path,
    tree: Path,
    places: Sequence[Place],
    scratch: int,
    folder: Path,
) -> tuple[Step, ...]:
    """All places at once. scratch: CHUNK bytes of RAM; folder: for the tree that is made here."""
    assert board.nand is not None
    images, addresses = checked(kernel, tree, board), Addresses.of(board)
    served = folder / "backup.dtb"
    served.write_bytes(tree_of(images.tree, board.nand, network, macs, places))
    found = Findings()
    count = CHUNK // board.nand.block
    sums = (
        SumUp(place, first, min(count, len(place.blocks) - first), scratch, found)
        for place in places
        for first in range(0, len(place.blocks), count)
    )
    return (
        *(() if board.nand.tables else (FindTables(board.nand, scratch),)),
        *sums,
        *(SetVariable(name, "") for name in IN_THE_WAY if name in board.environment),
        Load("uImage", Slice.of(kernel), addresses.uimage, "back up"),
        Load("nuc980.dtb", Slice.of(served), addresses.dtb, "back up"),
        SendByLinux(tuple(places), StartKernel(addresses, BOOT), served, found),
    )


# ---- what Linux is started with


def tree_of(
    tree: libfdt.Fdt, nand: Nand, network: Network, macs: Sequence[str], places: Sequence[Place]
) -> bytes:
    """The board's tree, in which all of the flash is one partition that nobody can write; and the script."""
    script = script_for(network, nand.block, places).encode()
    own = libfdt.Fdt(bytearray(tree_for(tree, arguments_of(own_arguments(tree), macs), macs)))
    own.resize(own.totalsize() + len(script) + TREE_GROWTH)
    own.setprop(own.path_offset("/chosen"), SCRIPT, script)
    flash = _flash_node(own)
    while (child := own.first_subnode(flash, libfdt.QUIET_NOTFOUND)) >= 0:
        own.del_node(child)
    if own.hasprop(flash, "nand-on-flash-bbt"):
        own.delprop(flash, "nand-on-flash-bbt")
    own.setprop_str(flash, "status", "okay")
    partitions = own.add_subnode(flash, "partitions")
    own.setprop_str(partitions, "compatible", "fixed-partitions")
    own.setprop_u32(partitions, "#address-cells", 1)
    own.setprop_u32(partitions, "#size-cells", 1)
    partition = own.add_subnode(partitions, "partition@0")
    own.setprop_str(partition, "label", LABEL)
    own.setprop(partition, "reg", bytes(4) + nand.size.to_bytes(4))
    own.setprop(partition, "read-only", b"")
    own.pack()
    return bytes(own.as_bytearray())


def _flash_node(tree: libfdt.Fdt) -> int:
    """The NAND's. Raises UnusableImage."""
    node, depth = tree.next_node(0, 0, libfdt.QUIET_NOTFOUND)
    while node >= 0 and depth > 0:
        if any(tree.hasprop(node, name) for name in ("nand-on-flash-bbt", "nand-ecc-mode")):
            return node
        node, depth = tree.next_node(node, depth, libfdt.QUIET_NOTFOUND)
    raise UnusableImage("The device tree for the backup has no NAND flash.", next_step="take the board's own")


def arguments_of(own: str, macs: Sequence[str]) -> str:
    """The kernel's: a shell in the place of init, which takes its script out of the tree."""
    kept = [word for word in own.split() if word.startswith(KEPT_WORDS)]
    ports = (f"ethaddr{port}={mac}" for port, mac in enumerate(macs))  # the vendor's driver wants them here
    shell = f"mount -t proc proc /proc; mount -t sysfs sysfs /sys; . /proc/device-tree/chosen/{SCRIPT}"
    return " ".join((*kept, *ports, "panic=10", "rdinit=/bin/sh", "--", "-c", f'"{shell}"'))


def script_for(network: Network, block: int, places: Sequence[Place]) -> str:
    """For BusyBox, as process 1: finds the network, sends each place, restarts the board whatever happens."""
    sends = "\n".join(f"send {place.name} {' '.join(runs(place.blocks, block))}" for place in places)
    return f"""\
echo 1 > /proc/sys/kernel/printk
mount -t devtmpfs dev /dev
say() {{ echo "{SAYS}$*;"; }}
over() {{ sleep 1; reboot -f; while :; do sleep 60; done; }}
fail() {{ say failed: "$*"; over; }}
while read -r dev rest; do
	case $rest in *'"{LABEL}"') flash=/dev/${{dev%:}} ;; esac
done < /proc/mtd
[ -c "$flash" ] || fail no flash
hello() {{ tftp -g -r {HELLO} -l /hello {network.server} {network.port} 2> /dev/null; }}
up() {{
	ip link set "$1" up
	ip address add {network.board} dev "$1"
	for second in 1 2 3 4 5 6 7 8; do
		[ "$(cat "/sys/class/net/$1/carrier" 2> /dev/null)" = 1 ] && break
		sleep 1
	done
	hello && return
	ip address flush dev "$1"
	ip link set "$1" down
	return 1
}}
for try in 1 2; do
	for port in /sys/class/net/eth*; do
		up "${{port##*/}}" && break 2
	done
done
[ -s /hello ] || fail no TFTP server at {network.server}, port {network.port}
pieces() {{
	name=$1
	shift
	number=0
	for run; do
		block=${{run%+*}}
		end=$((block + ${{run#*+}}))
		while [ $block -lt $end ]; do
			dd if="$flash" bs={block} skip=$block count=1 2> /dev/null || fail block $block >&2
			block=$((block + 1))
			number=$((number + 1))
			[ $((number % {PIECE})) = 0 ] && say "$name" piece $((number / {PIECE})) >&2
		done
	done
}}
send() {{
	pieces "$@" | tftp -p -b 1428 -l - -r "$1" {network.server} {network.port} || fail "$1" was not taken
	say "$1" ended
}}
{sends}
over
"""


def runs(blocks: Sequence[int], block: int) -> list[str]:
    """Blocks that follow each other, as NUMBER+COUNT."""
    numbers = [offset // block for offset in blocks]
    starts = [at for at, (before, number) in enumerate(pairwise([-2, *numbers])) if number != before + 1]
    return [f"{numbers[start]}+{end - start}" for start, end in pairwise([*starts, len(numbers)])]
