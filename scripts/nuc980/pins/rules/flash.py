# SPDX-License-Identifier: GPL-3.0-or-later
"""Rules on the flash: its partitions, its error correction, its data lines."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

from nuc980.pins.environment import bytes_of
from nuc980.pins.findings import Claimant, Finding, added, at, deleted
from nuc980.pins.limits import Area, Limits
from nuc980.pins.rules.context import Context, grouped, listed, rule
from nuc980.pins.tree import Node

CONTAINER = "fixed-partitions"
OLD_STYLE = "partition"  # the name of partitions that are in the flash's node itself
ECC = {"nand-ecc-mode": '"hw_oob_first"', "nand-ecc-strength": "<8>", "nand-ecc-step-size": "<512>"}
BBT = "nand-on-flash-bbt"
# A UBI device by its partition's label or number, and a root that is a partition.
PARTITION_WORD = re.compile(
    r"ubi\.mtd=(?:(?P<number>\d+)|(?P<name>[^/,][^,]*))(?:,.*)?|root=/dev/mtdblock(?P<block>\d+)"
)
MTDPART = re.compile(
    r"(?P<size>-|(?:0[xX][0-9a-fA-F]+|\d+)[kKmMgG]?)(?:@(?P<offset>(?:0[xX][0-9a-fA-F]+|\d+)[kKmMgG]?))?"
    r"(?:\((?P<label>[^)]*)\))?(?:ro|lk)*"
)
# Bits that the controller corrects in a step: bytes of parity, 15 bits for each (in our driver 15 bytes).
ECC_BYTES = {bits: (15 * bits + 7) // 8 for bits in (4, 8, 12, 15, 24)}
OUR_ECC = 8  # bits, of our driver and the factory's U-Boot
SPARE_SHARE = 32  # of a page's bytes one is spare, at least
MARKS = 4  # bytes of the spare: bad block, and whether the page is written
QUAD = ("QSPI0_MOSI1", "QSPI0_MISO1")  # data lines 2 and 3


@dataclass(frozen=True)
class Partition:
    """A part of a flash, as a node has it; bytes."""

    node: Node
    offset: int
    size: int

    @property
    def end(self) -> int:
        return self.offset + self.size

    @cached_property
    def label(self) -> str:
        """As the kernel calls it (ofpart.c)."""
        return next(iter(self.node.strings("label")), self.node.base_name)

    @property
    def read_only(self) -> bool:
        return "read-only" in self.node.properties

    def overlaps(self, other: Partition | Area) -> bool:
        return self.offset < other.end and other.offset < self.end

    def __str__(self) -> str:
        return f"{self.label} ({self.offset:#x} to {self.end:#x})"

    def claimant(self) -> Claimant:
        return Claimant(self.node.path, f"{self.offset:#x} to {self.end:#x}", self.node.place_of("reg"))


def _tables(context: Context) -> Iterator[tuple[Node, list[Partition]]]:
    """Each flash that is on, or the node with its partitions: those, by their place."""
    for parent in context.enabled:
        in_container = CONTAINER in parent.strings("compatible")
        found = [
            Partition(node, *node.cells("reg"))
            for node in parent
            if len(node.cells("reg")) == 2 and (in_container or node.base_name == OLD_STYLE)
        ]
        if found:
            yield parent, sorted(found, key=lambda one: (one.offset, one.size))


def _boards_partitions(context: Context) -> Iterator[tuple[Limits, Partition]]:
    """Each partition of the flash that the pin table knows."""
    board = context.board
    if board is None or board.limits is None:
        return
    for parent, partitions in _tables(context):
        above: Node | None = parent
        while above:
            if above in context.devices and context.devices[above].label == board.flash:
                yield from ((board.limits, one) for one in partitions)
            above = above.parent


@rule(
    "partition-overlap",
    "Two partitions of a flash overlap.",
    "The kernel creates both and reports nothing. Writing or erasing one destroys the other, such as the "
    "device tree behind a kernel that has grown.",
)
def partition_overlap(context: Context) -> Iterator[Finding]:
    for _, partitions in _tables(context):
        for first, second in itertools.combinations(partitions, 2):
            if first.overlaps(second):
                yield Finding(
                    "partition-overlap",
                    **at(first.node, "reg"),
                    message=f"the partition {first} reaches into {second}",
                    remedy=f"End {first.label} at {second.offset:#x}, or begin {second.label} at "
                    f"{first.end:#x}",
                    claimants=(first.claimant(), second.claimant()),
                )


@rule(
    "partition-label-twice",
    "Two partitions of a flash have the same label.",
    "Whoever asks for a partition by its label, as ubi.mtd= and mtd_info do, gets the first one.",
)
def partition_label_twice(context: Context) -> Iterator[Finding]:
    for _, partitions in _tables(context):
        for label, same in grouped(partitions, lambda one: one.label).items():
            if len(same) > 1:
                yield Finding(
                    "partition-label-twice",
                    **at(same[-1].node, "label"),
                    message=f"{listed(f'{one.node.name} ({one.offset:#x})' for one in same)} are all called "
                    f"{label}",
                    remedy=f"Give {listed(one.node.name for one in same[1:])} a label that no other has",
                    claimants=tuple(one.claimant() for one in same),
                )


@rule(
    "partition-bounds",
    "A partition extends beyond the flash, or is not aligned to its erase blocks.",
    "The kernel cuts or drops what lies beyond the flash. It makes a partition read-only that begins or "
    "ends inside a block: nothing can be written there, and UBI does not attach.",
)
def partition_bounds(context: Context) -> Iterator[Finding]:
    for limits, one in _boards_partitions(context):
        faults = []
        if one.end > limits.flash:
            faults.append(f"ends beyond the flash, which has {limits.flash:#x} bytes")
        odd = [f"{what} at {value:#x}" for what, value in (("begins", one.offset), ("ends", one.end))
               if value % limits.block]  # fmt: skip
        if odd:
            faults.append(f"{listed(odd)}, inside an erase block of {limits.block:#x} bytes")
        if faults:
            yield Finding(
                "partition-bounds",
                **at(one.node, "reg"),
                message=f"the partition {one} {listed(faults)}",
                remedy=f"Set reg of {one.label} to multiples of {limits.block:#x} that end by "
                f"{limits.flash:#x}, or correct {limits.file.name}",
            )


@rule(
    "partition-moved",
    "A partition is not where the factory's boot command or the image expects it.",
    "The boot loader reads the kernel and the device tree from fixed addresses, and the image's root file "
    "system lies at a fixed address too. When a partition has moved, nobody reads what is written to it, "
    "and the boot loader reads something else.",
)
def partition_moved(context: Context) -> Iterator[Finding]:
    for limits, one in _boards_partitions(context):
        for area in filter(None, (limits.kernel, limits.device_tree, limits.root)):
            if one.label.casefold() != area.label:
                continue
            if one.offset != area.offset or one.size < area.size:
                yield Finding(
                    "partition-moved",
                    **at(one.node, "reg"),
                    message=f"the partition {one} should begin at {area.offset:#x} and have "
                    f"{area.size:#x} bytes",
                    remedy=f"Set reg = <{area.offset:#x} {area.size:#x}> in {one.label}, or correct "
                    f"{limits.file.name}",
                )


def _told_parts(context: Context) -> Iterator[tuple[str, int, int | None]]:
    """Label, offset and size (None: the rest) of each partition of mtdparts= on the command line."""
    for word in context.command_line:
        name, _, text = word.partition("=")
        _, colon, parts = text.partition(":")
        if name != "mtdparts" or not colon or ";" in parts:
            continue
        end = 0
        for told in map(MTDPART.fullmatch, parts.split(",")):
            if told is None:
                return
            offset = bytes_of(told["offset"]) if told["offset"] else end
            size = None if told["size"] == "-" else bytes_of(told["size"])
            yield told["label"] or "", offset, size
            end = offset + (size or 0)


@rule(
    "mtdparts-moved",
    "mtdparts= on the command line puts a partition elsewhere than the factory's boot command or the image.",
    "It counts before the tree's partitions. What Linux writes to the kernel's partition is then not what "
    "the boot loader reads, and the boot loader itself may lie in a partition that Linux writes.",
)
def mtdparts_moved(context: Context) -> Iterator[Finding]:
    limits = context.board.limits if context.board else None
    for label, offset, size in _told_parts(context) if limits else ():
        area = next((area for area in limits.areas if area.label == label.casefold()), None)
        end = limits.flash if size is None else offset + size
        if area and (offset != area.offset or end < area.end):
            yield Finding(
                "mtdparts-moved",
                **at(context.chosen, "bootargs"),
                message=f"the command line has {label} from {offset:#x} to {end:#x}; it is from "
                f"{area.offset:#x} to {area.end:#x}",
                remedy=f"Delete mtdparts= (the tree has the partitions), or correct it or {limits.file.name}",
            )


@rule(
    "wrong-boot-command",
    "The boot command reads what is no partition of the flash.",
    "Whoever writes the kernel into its partition writes it where the boot loader does not look, or the boot "
    "loader reads beyond it: the board starts the old kernel, or none.",
)
def wrong_boot_command(context: Context) -> Iterator[Finding]:
    parts = [one for _, partitions in _tables(context) for one in partitions]
    for read in context.environment.reads if parts else ():
        inside = next((one for one in parts if one.offset == read.offset), None)
        if inside and read.end <= inside.end:
            continue
        yield Finding(
            "wrong-boot-command",
            **at(parts[0].node.parent),
            message=f"{context.environment.source} reads {read.size:#x} bytes at {read.offset:#x}; "
            + (f"the partition {inside} ends before" if inside else "no partition begins there"),
            remedy=f"Read a partition: {', '.join(map(str, parts))}",
        )


@rule(
    "partition-missing",
    "The flash has no partition of a name that the image, or whoever writes it, looks for.",
    "Nobody finds the place by its label: a root file system is not mounted, an update has nowhere to go.",
)
def partition_missing(context: Context) -> Iterator[Finding]:
    board = context.board
    if board is None or board.limits is None:
        return
    has = [one.label.casefold() for _, one in _boards_partitions(context)]
    areas = filter(None, (board.limits.kernel, board.limits.device_tree, board.limits.root))
    lacks = [area for area in areas if area.label not in has]
    for node in [node for node, one in context.devices.items() if one.label == board.flash and lacks]:
        yield Finding(
            "partition-missing",
            **at(node),
            message=f"{context.name(node)} has no partition called "
            + " or ".join(f"{area.label} ({area.offset:#x})" for area in lacks),
            remedy=f"Add the partitions, or correct {board.limits.file.name}",
        )


@rule(
    "boot-writable",
    "A partition lets Linux overwrite the boot loader.",
    "After one mistyped flash_erase the board starts only from USB, if its boot straps can be reached at "
    "all.",
)
def boot_writable(context: Context) -> Iterator[Finding]:
    for limits, one in _boards_partitions(context):
        if limits.boot and one.overlaps(limits.boot) and not one.read_only:
            yield Finding(
                "boot-writable",
                **at(one.node, "reg"),
                message=f"the partition {one} is writable and contains the boot loader, which ends at "
                f"{limits.boot.end:#x}",
                remedy=f"Add read-only; to {one.label}, or begin it at {limits.boot.end:#x}",
                fix=added("read-only;", one.node) if one.label.casefold() == limits.boot.label else None,
            )


@rule(
    "partitions-unread",
    "Partitions are in a node that the kernel does not read, or not as it reads them.",
    "Linux takes partitions from a node that is compatible with fixed-partitions. Without that the flash is "
    "one piece, and what is looked for by its label is not there. A partition without a size goes to the end "
    "of the flash, over those behind it; one with a cell too many has another size, or is left out.",
)
def partitions_unread(context: Context) -> Iterator[Finding]:
    for node in context.enabled:
        for child, fault in _unread(node):
            yield Finding(
                "partitions-unread",
                **at(child, "reg"),
                message=f"reg of {child.path} {fault}",
                remedy=f"Write the offset and the size of {child.name} into its reg, a cell each",
            )
        parts = [child for child in node if child.cells("reg") and "label" in child.properties]
        if node.name == "partitions" and parts and not node.strings("compatible"):
            yield Finding(
                "partitions-unread",
                **at(node),
                message=f"{node.path} has {len(parts)} partition{'s' * (len(parts) > 1)}, and no compatible",
                remedy=f'Set compatible = "{CONTAINER}" in {node.path}',
                fix=None if "compatible" in node.properties else added(f'compatible = "{CONTAINER}";', node),
            )


def _unread(container: Node) -> Iterator[tuple[Node, str]]:
    """Partitions of which the kernel reads no size, or another one."""
    if CONTAINER not in container.strings("compatible"):
        return
    wide = sum(next(iter(container.cells(name)), 1) for name in ("#address-cells", "#size-cells"))
    for child in container:
        cells = child.cells("reg")
        if "reg" in child.properties and len(cells) != wide:
            yield child, f"has {len(cells)} cells, not {wide}"
        elif cells and not any(cells[next(iter(container.cells("#address-cells")), 1) :]):
            yield child, "has size 0, which means up to the end of the flash"


@rule(
    "unknown-partition",
    "The command line names a partition that the flash does not have, or that no UBI can be in.",
    "The kernel waits for its root file system, or panics: the board does not come up.",
)
def unknown_partition(context: Context) -> Iterator[Finding]:
    parts = [one for _, partitions in _tables(context) for one in partitions]
    labels = [one.label for one in parts]
    limits = context.board.limits if context.board else None
    areas = (limits.boot, limits.kernel, limits.device_tree) if limits else ()
    closed = {area.label for area in areas if area} | {one.label for one in parts if one.read_only}
    if not labels or any(word.startswith("mtdparts=") for word in context.command_line):
        return
    for word in context.command_line:
        told = PARTITION_WORD.fullmatch(word)
        if not told:
            continue
        number, name = told["number"] or told["block"], told["name"]
        label = labels[int(number)] if number and int(number) < len(labels) else name
        if label not in labels:
            fault = f"the partitions are {listed(labels)}"
        elif label in closed and word.startswith("ubi.mtd="):
            fault = f"nothing of UBI is in {label}"
        else:
            continue
        yield Finding(
            "unknown-partition",
            **at(context.chosen, "bootargs"),
            message=f"the command line has {word}; {fault}",
            remedy=f"Name one of {', '.join(one for one in labels if one not in closed)}",
        )


@rule(
    "bad-block-table",
    "The kernel is to keep a table of bad blocks in the board's flash.",
    "A kernel that finds no table erases the last four blocks of the chip for it. What the factory's "
    "software has there, such as the end of its UBI, is destroyed by the first boot.",
)
def bad_block_table(context: Context) -> Iterator[Finding]:
    flash = context.board.flash if context.board else None
    for node, peripheral in context.devices.items():
        if peripheral.label == flash and BBT in node.properties:
            yield Finding(
                "bad-block-table",
                **at(node, BBT),
                message=f"{context.name(node)} has {BBT}",
                remedy=f"Delete {BBT}: without it the kernel reads the marks in the blocks",
                fix=deleted(BBT),
            )


@rule(
    "no-ecc",
    "A NAND has no error correction.",
    "Without mode, strength and step the vendor's driver fails, and its error path ends in a panic that "
    "nobody sees. Our driver refuses the chip, so there is no flash.",
)
def no_ecc(context: Context) -> Iterator[Finding]:
    for node, peripheral in context.devices.items():
        is_nand = any((claim.signal or "").startswith("NAND_") for claim in context.working_claims(node))
        lacks = [name for name in ECC if name not in node.properties]
        if peripheral.label == "fmi" and is_nand and lacks:
            yield Finding(
                "no-ecc",
                **at(node),
                message=f"{context.name(node)} has a NAND but no {listed(lacks)}",
                remedy=f"Set {listed(f'{name} = {ECC[name]}' for name in lacks)} in {context.name(node)}",
            )


@rule(
    "ecc-beyond-spare",
    "The error correction of a NAND needs more spare bytes than a page has, or the chip does not have it.",
    "The controller writes the parity at the end of the spare area, over what is there. The driver refuses "
    "the chip, or the first page that is written cannot be read.",
)
def ecc_beyond_spare(context: Context) -> Iterator[Finding]:
    limits = context.board.limits if context.board else None
    for node, peripheral in context.devices.items():
        strength, step = (next(iter(node.cells(f"nand-ecc-{what}")), 0) for what in ("strength", "step-size"))
        if peripheral.label != "fmi" or not strength or not step:
            continue
        fault = "" if strength in ECC_BYTES else f"the chip corrects {listed(map(str, ECC_BYTES))} bits"
        if not fault and limits and limits.page:
            parity, spare = ECC_BYTES[strength] * (limits.page // step), limits.page // SPARE_SHARE - MARKS
            fault = f"needs {parity} bytes of a page's spare, which has {spare}" if parity > spare else ""
        if not fault and context.board and strength != OUR_ECC:
            fault = f"U-Boot writes with {OUR_ECC}, and our driver has no other"
        if fault:
            yield Finding(
                "ecc-beyond-spare",
                **at(node, "nand-ecc-strength"),
                message=f"nand-ecc-strength = <{strength}> of {context.name(node)}: {fault}",
                remedy=f"Set nand-ecc-strength = {ECC['nand-ecc-strength']}, as the boot loader writes",
            )


@rule(
    "quad-without-lines",
    "A flash is set to use four data lines, but two of them have no pin.",
    "The driver follows spi-rx-bus-width and does not look at the pins. Half of the bits that it reads are "
    "noise.",
)
def quad_without_lines(context: Context) -> Iterator[Finding]:
    for node, peripheral in context.devices.items():
        wide = [
            (child, name)
            for child in node
            for name in ("spi-rx-bus-width", "spi-tx-bus-width")
            if child.enabled and child.cells(name) == [4]
        ]
        has = {claim.signal for claim in context.working_claims(node)}
        lacks = [signal for signal in QUAD if signal not in has]
        if peripheral.label == "qspi0" and wide and lacks and context.is_readable(node):
            child, name = wide[0]
            yield Finding(
                "quad-without-lines",
                **at(child, name),
                message=f"{child.path} has {name} = <4>, but {context.name(node)} has no {listed(lacks)}",
                remedy=f"Give {context.name(node)} a group with {listed(lacks)}, or set {name} = <1>",
            )


RULES = (
    partition_overlap,
    partition_label_twice,
    partition_bounds,
    partition_moved,
    mtdparts_moved,
    wrong_boot_command,
    partition_missing,
    boot_writable,
    partitions_unread,
    unknown_partition,
    bad_block_table,
    no_ecc,
    ecc_beyond_spare,
    quad_without_lines,
)
