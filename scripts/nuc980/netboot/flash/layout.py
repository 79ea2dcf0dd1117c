# SPDX-License-Identifier: GPL-3.0-or-later
"""Where things are in a board's flash: as its own boot command reads them, else as one says it explicitly."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

from nuc980.netboot.board import TABLE_BLOCKS, Nand, Partition
from nuc980.netboot.errors import DoesNotFit, LayoutUnknown
from nuc980.netboot.limits import ROOT_OFFSET, ROOT_SIZE

# U-Boot's own: in front of 0x200000 lie the SPL, the environment (0x80000) and U-Boot (0x100000), of which
# the vendor's SPL reads 500 KiB (mtdparts and CONFIG_SYS_NAND_U_BOOT_SIZE of its headers).
OWN_END = 0x200000
LOADER_OFFSET, LOADER_ROOM = 0x100000, 500 * 1024

_OTHER = "read at "
KERNEL, DEVICE_TREE, UBI, LOADER = "kernel", "device tree", "UBI", "boot loader"
TABLES = "bad-block tables"
# Of a board with slots, by the slot's name.
KERNELS = {name: f"kernel {name.upper()}" for name in "ab"}
DEVICE_TREES = {name: f"device tree {name.upper()}" for name in "ab"}
MARKS = ("base mark 1", "base mark 2", "trial mark")
ONE_SLOT = tuple(
    {KERNELS[name], DEVICE_TREES[name]} for name in KERNELS
)  # boards boot the other one meanwhile
ALL_KERNELS, ALL_DEVICE_TREES = (KERNEL, *KERNELS.values()), (DEVICE_TREE, *DEVICE_TREES.values())
UBI_PARTITIONS = ("rootfs", "user")
DEPTH = 8  # of `run` in `run`
WITHOUT_FLASH = "nuc980-netboot boot starts a kernel over the network"

SPLIT = re.compile(r"&&|;|\n")
VARIABLE = re.compile(r"\$\{(\w+)\}|\$(\w+)")
HARMLESS = re.compile(
    r"(echo|sleep|printenv|env print)( .*)?|nand (info|bad|device( 0)?)|mtdparts( default)?", re.DOTALL
)


@dataclass(frozen=True)
class Slot:
    """A place for one image. Bytes; [offset, end) is all that may be erased, room what is read of it.

    limit: for a read by partition name, how many bytes it wants and where the partition ends: when bad blocks
    push it beyond, U-Boot reads nothing at all ("Size of read exceeds partition"). address: in RAM, if known.
    """

    name: str
    offset: int
    end: int
    room: int
    limit: tuple[int, int] | None = None
    address: int | None = None

    def blocks(self, nand: Nand) -> tuple[int, ...]:
        """The offsets of its good blocks, in the order in which `nand read` takes them."""
        return tuple(at for at in range(self.offset, self.end, nand.block) if at not in nand.bad)

    def usable(self, nand: Nand) -> int:
        """How large an image may be with this flash's bad blocks."""
        return min(self.room, len(self.blocks(nand)) * nand.block)

    def check_fits(self, size: int, nand: Nand) -> None:
        """Raises DoesNotFit."""
        usable = self.usable(nand)
        if self.limit:
            wanted, end = self.limit
            good = sum(at not in nand.bad for at in range(self.offset, end, nand.block))
            if good * nand.block < wanted:
                raise DoesNotFit(
                    f"The boot command wants {wanted} bytes of the {self.name}'s partition, which has only"
                    f" {good} good blocks: U-Boot reads nothing then, whatever is written there.",
                    next_step=WITHOUT_FLASH,
                )
        if size > usable:
            bad = (self.end - self.offset) // nand.block - len(self.blocks(nand))
            raise DoesNotFit(
                f"The {self.name} image has {size} bytes; its place at {self.offset:#x} takes {usable}"
                f" ({self.room} are read there; {bad} bad blocks in {self.offset:#x}..{self.end:#x}).",
                next_step=f"a smaller image (docs/image-buildroot.md); {WITHOUT_FLASH}",
            )


@dataclass(frozen=True)
class Layout:
    """The slots of a board. One that is not known is None, and `unknown` says why."""

    kernel: Slot | None
    device_tree: Slot | None
    ubi: Slot | None
    unknown: str = ""
    notes: tuple[str, ...] = ()

    def slot(self, name: str) -> Slot:
        """Raises LayoutUnknown."""
        slot = {KERNEL: self.kernel, DEVICE_TREE: self.device_tree, UBI: self.ubi}[name]
        if slot is None:
            raise LayoutUnknown(f"The place of this board's {name} is unknown: {self.unknown}")
        return slot


@dataclass(frozen=True)
class Read:
    """One `nand read` of a boot command. Bytes; end: where it must stop, because a partition does."""

    address: int
    offset: int
    size: int
    end: int | None


def loader_slot(nand: Nand) -> Slot:
    """U-Boot's own place. Raises LayoutUnknown when a block of it is bad: the SPL does not skip it."""
    end = LOADER_OFFSET + -(-LOADER_ROOM // nand.block) * nand.block
    slot = Slot(LOADER, LOADER_OFFSET, end, LOADER_ROOM)
    if len(slot.blocks(nand)) * nand.block != end - LOADER_OFFSET:
        raise LayoutUnknown("A block of the boot loader's place is bad, and how the SPL goes on is unknown.")
    return slot


def layout_of(
    environment: Mapping[str, str],
    nand: Nand,
    explicit: Mapping[str, tuple[int, int]] | None = None,
    linux: Sequence[Partition] = (),
) -> Layout:
    """The slots of a board with this environment.

    explicit: offset and size of slots, by name. linux: the partitions of the device tree that is to be
    written. Raises LayoutUnknown for slots that overlap each other or U-Boot's own, and when U-Boot and that
    tree do not agree on the place of UBI.
    """
    explicit = explicit or {}
    slots: dict[str, Slot] = {}
    unknown, notes = "", []
    try:
        slots = _boot_slots(environment, nand)
    except LayoutUnknown as error:
        unknown = error.what
    else:
        if UBI not in explicit:
            slots[UBI] = _ubi_slot(nand, linux)
    slots |= {name: Slot(name, at, at + size, size) for name, (at, size) in explicit.items()}
    for name in (KERNEL, DEVICE_TREE, UBI):
        if name in slots:
            _check_place(slots[name], nand)
    slots = _not_into_the_next(slots, nand)
    for slot in (slots[name] for name in (KERNEL, DEVICE_TREE) if name in slots):
        bad = [at for at in nand.bad if slot.offset <= at < slot.end]
        if bad:
            notes.append(
                f"{len(bad)} bad blocks in the {slot.name}'s place: `nand read` skips them, and reads as many"
                f" beyond {slot.end:#x}; an image of up to {slot.usable(nand)} bytes lies before that."
            )
    return Layout(slots.get(KERNEL), slots.get(DEVICE_TREE), slots.get(UBI), unknown, tuple(notes))


def _check_place(slot: Slot, nand: Nand) -> None:
    if slot.offset % nand.block or slot.end % nand.block:
        raise LayoutUnknown(f"The {slot.name}'s place {_range(slot)} does not begin and end with a block.")
    if slot.offset < OWN_END:
        raise LayoutUnknown(
            f"The {slot.name}'s place {_range(slot)} is the boot loader's, below {OWN_END:#x}."
        )
    if slot.end > nand.size - TABLE_BLOCKS * nand.block:
        raise LayoutUnknown(
            f"The {slot.name}'s place {_range(slot)} reaches the tables of bad blocks at the end."
        )


def _not_into_the_next(slots: dict[str, Slot], nand: Nand) -> dict[str, Slot]:
    """Each slot ends where the next begins."""
    order = sorted(slots.values(), key=lambda slot: slot.offset)
    for at, following in enumerate(order[1:]):
        slot = order[at]
        if slot.offset == following.offset:
            raise LayoutUnknown(f"{slot.name} and {following.name} have the same place, {slot.offset:#x}.")
        if slot.end > following.offset and {slot.name, following.name} != {KERNEL, DEVICE_TREE}:
            raise LayoutUnknown(
                f"{slot.name} {_range(slot)} and {following.name} {_range(following)} overlap."
            )
        end = min(slot.end, following.offset)
        order[at] = replace(slot, end=end, room=min(slot.room, end - slot.offset))
    return {slot.name: slot for slot in order}


def _range(slot: Slot) -> str:
    return f"{slot.offset:#x}..{slot.end:#x}"


# ---- the boot command


def _boot_slots(environment: Mapping[str, str], nand: Nand) -> dict[str, Slot]:
    reads = parse_bootcmd(environment, nand)
    kernel, tree = reads.kernel, reads.tree
    slots = {
        other.name: other for other in (_slot_of(f"{_OTHER}{r.offset:#x}", r, nand) for r in reads.others)
    }
    slots[KERNEL] = _slot_of(KERNEL, kernel, nand)
    if tree:
        slots[DEVICE_TREE] = _slot_of(DEVICE_TREE, tree, nand)
        if kernel.address < tree.address:
            room = min(slots[KERNEL].room, tree.address - kernel.address)
            slots[KERNEL] = replace(slots[KERNEL], room=room)
    return slots


def _slot_of(name: str, read: Read, nand: Nand) -> Slot:
    end = read.offset + -(-read.size // nand.block) * nand.block
    limit = (read.size, read.end) if read.end is not None else None
    return Slot(name, read.offset, end, read.size, limit, read.address)


@dataclass(frozen=True)
class BootReads:
    """What a boot command reads of the flash."""

    kernel: Read
    tree: Read | None
    others: tuple[Read, ...]


def parse_bootcmd(environment: Mapping[str, str], nand: Nand) -> BootReads:
    """Which reads are the kernel's and the device tree's. Raises LayoutUnknown, with the reason."""
    if not environment.get("bootcmd"):
        raise LayoutUnknown("there is no bootcmd")
    command = _BootCommand(environment, nand)
    command.follow("bootcmd", DEPTH)
    if command.booted is None:
        raise LayoutUnknown("the boot command has no bootm")
    return BootReads(*command.booted, tuple(read for read in command.reads if read not in command.booted))


class _BootCommand:
    """What a boot command's words mean, one after the other; anything not understood ends it."""

    def __init__(self, environment: Mapping[str, str], nand: Nand) -> None:
        self.variables = dict(environment)
        self.partitions = {partition.name: partition for partition in nand.partitions}
        self.nand = nand
        self.reads: list[Read] = []
        self.booted: tuple[Read, Read | None] | None = None

    def follow(self, variable: str, depth: int) -> None:
        if depth == 0:
            raise LayoutUnknown(f"{variable} runs itself")
        for command in SPLIT.split(self.variables.get(variable, "")):
            if self.booted is None and command.strip():
                self._take(command.strip(), depth)
            elif re.match(r"\s*(nand\s+read|run)\b", command):  # when bootm fails: a place to stay away from
                with suppress(LayoutUnknown):
                    self._take(command.strip(), depth)

    def _take(self, command: str, depth: int) -> None:
        words = self._expanded(command).split()
        match words:
            case []:
                pass
            case ["run", *names]:
                for name in names:
                    if name not in self.variables:
                        raise LayoutUnknown(f"'{command}': there is no variable {name}")
                    self.follow(name, depth - 1)
            case ["setenv", name, *value]:
                self.variables[name] = " ".join(value)
            case ["nand", "read" | "read.e" | "read.i" | "read.jffs2", address, *place] if len(place) in (
                1,
                2,
            ):
                self.reads.append(self._read(_hex(address), place))
            case ["bootm", kernel]:
                self._boot(self._read_to(kernel), None)
            case ["bootm", kernel, "-", tree]:
                self._boot(self._read_to(kernel), self._read_to(tree))
            case _ if HARMLESS.fullmatch(" ".join(words)):
                pass
            case _:
                raise LayoutUnknown(f"'{command}' of the boot command is not understood")

    def _expanded(self, command: str) -> str:
        if re.search(r"[|`<>()]", command) or "'" in command or '"' in command:
            raise LayoutUnknown(f"'{command}' of the boot command is not understood")
        return VARIABLE.sub(lambda found: self.variables.get(found[1] or found[2], ""), command)

    def _read(self, address: int, place: list[str]) -> Read:
        try:
            offset, end = _hex(place[0]), None
        except LayoutUnknown:
            partition = self.partitions.get(place[0].removeprefix("nand0,"))
            if partition is None:
                raise LayoutUnknown(f"nothing says where the partition {place[0]} is") from None
            offset, end = partition.offset, partition.offset + partition.size
        if len(place) == 2:
            return Read(address, offset, _hex(place[1]), end)
        last = self.nand.size if end is None else end
        return Read(address, offset, last - offset, None)  # of which U-Boot leaves out the bad blocks

    def _read_to(self, word: str) -> Read:
        address = _hex(word)
        for read in reversed(self.reads):
            if read.address == address:
                return read
        raise LayoutUnknown(f"bootm takes {word}, where nothing of the flash was read to")

    def _boot(self, kernel: Read, tree: Read | None) -> None:
        self.booted = kernel, tree
        self._check_ram(kernel, tree)

    def _check_ram(self, kernel: Read, tree: Read | None) -> None:
        """That what is started is still there whole then."""
        for booted in (kernel, tree):
            if booted is None:
                continue
            for later in self.reads[self.reads.index(booted) + 1 :]:
                over_its_tail = (booted, later) == (kernel, tree) and later.address > booted.address
                if _overlap(booted, later) and not over_its_tail:
                    raise LayoutUnknown("the boot command reads one thing over another")


def _overlap(one: Read, other: Read) -> bool:
    return one.address < other.address + other.size and other.address < one.address + one.size


def _hex(word: str) -> int:
    """A number as U-Boot takes it: hexadecimal with or without 0x."""
    if not re.fullmatch(r"(0[xX])?[0-9a-fA-F]+", word):
        raise LayoutUnknown(f"'{word}' is not a number")
    return int(word, 16)


# ---- UBI


def _ubi_partition(partitions: Sequence[Partition], last: int) -> Partition | None:
    """Up to the tables of bad blocks."""
    for partition in partitions:
        if partition.name in UBI_PARTITIONS:
            return replace(partition, size=min(partition.size, last - partition.offset))
    return None


def _ubi_slot(nand: Nand, linux: Sequence[Partition]) -> Slot:
    """The partition for UBI of the new device tree, else of U-Boot, else of the gateway.

    Raises LayoutUnknown when U-Boot's is not there, or shorter: nothing tells what lies behind it.
    """
    last = nand.size - TABLE_BLOCKS * nand.block
    named, ours = (_ubi_partition(partitions, last) for partitions in (nand.partitions, linux))
    if named and ours and (named.offset != ours.offset or named.size < ours.size):
        raise LayoutUnknown(
            f"U-Boot's partition {named.name} has {named.size:#x} bytes at {named.offset:#x}, the device"
            f" tree's partition {ours.name} {ours.size:#x} at {ours.offset:#x}.",
            next_step="--ubi-at OFFSET+SIZE says where Linux will look for it",
        )
    found = ours or named or Partition(UBI, ROOT_OFFSET, min(ROOT_SIZE, last - ROOT_OFFSET))
    return Slot(UBI, found.offset, found.offset + found.size, found.size)
