# SPDX-License-Identifier: GPL-3.0-or-later
"""Rules on what a kernel is told at boot: memory, console, the names of ports, MAC addresses."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from nuc980.pins.environment import bytes_of
from nuc980.pins.findings import Claimant, Finding, added, at, valued
from nuc980.pins.rules.context import Context, grouped, listed, off, rule, switched_off
from nuc980.pins.rules.properties import is_one_off
from nuc980.pins.tree import Node

MEMORY_WORD = re.compile(r"mem=(?P<size>(?:0[xX][0-9a-fA-F]+|\d+)[KkMmGg]?)(?:@.*)?")
CONSOLE_WORD = re.compile(r"console=(?P<tty>[A-Za-z]+\d*)(?:,.*)?")
FOREIGN_TTY = re.compile(r"tty(AMA|mxc|O|SAC|PS|HS|STM|LP|MV|UL|SC|AS|MSM|LXU|FIQ|CPM)\d+")
SERIAL = re.compile(r"serial(\d+)")
ETHERNET = re.compile(r"ethernet(\d+)")
INITRD = ("linux,initrd-start", "linux,initrd-end")
NODES = ("chosen", "aliases", "memory", "reserved-memory", "cpus")
MAC = ("mac-address", "local-mac-address")
LEAST_MEMORY = 8 << 20


# ---- memory --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Told:
    """What a place in the tree says that memory is."""

    node: Node
    property: str
    text: str
    end: int  # the first address behind it


def _memory(context: Context) -> list[Told]:
    found = [
        Told(node, "reg", f"{node.path} ends at {start + size:#x}", start + size)
        for node in context.tree.root
        if node.enabled and (node.base_name == "memory" or "memory" in node.strings("device_type"))
        for start, size in _pairs(node)
    ]
    for word in context.command_line:
        told = MEMORY_WORD.fullmatch(word)
        if told:
            size = bytes_of(told["size"])
            found.append(Told(context.chosen, "bootargs", f"the command line has {word}", size))
    return found


def _pairs(node: Node) -> list[tuple[int, int]]:
    """Start and size of each region of reg."""
    cells = node.cells("reg")
    return list(zip(cells[::2], cells[1::2], strict=False))


@rule(
    "too-much-memory",
    "The tree tells the kernel of more memory than the board has.",
    "The kernel uses memory that does not exist, or uses the same memory twice. It dies at once, or long "
    "after its start, when the rest of the memory is full.",
)
def too_much_memory(context: Context) -> Iterator[Finding]:
    limits = context.board.limits if context.board else None
    for told in _memory(context) if limits else ():
        if told.end > limits.memory:
            yield Finding(
                "too-much-memory",
                **at(told.node, told.property),
                message=f"{told.text}; the board has {limits.memory:#x} bytes ({limits.memory >> 20} MiB)",
                remedy=f"Write {limits.memory:#x} ({limits.memory >> 20}M), or correct {limits.file.name}",
            )


@rule(
    "reserved-outside",
    "A reserved region lies outside the board's memory.",
    "The kernel reserves nothing there. Whoever uses the region reads and writes memory that does not exist.",
)
def reserved_outside(context: Context) -> Iterator[Finding]:
    ends = [told.end for told in _memory(context)]
    if context.board and context.board.limits:
        ends.append(context.board.limits.memory)
    for node in context.tree.find("/reserved-memory") or () if ends else ():
        for start, size in _pairs(node):
            if node.enabled and start + size > min(ends):
                yield Finding(
                    "reserved-outside",
                    **at(node, "reg"),
                    message=f"{node.path} reserves up to {start + size:#x}; memory ends at {min(ends):#x}",
                    remedy=f"Set reg of {node.name} to a region that ends by {min(ends):#x}",
                )


@rule(
    "too-little-memory",
    "The tree tells the kernel of less memory than any kernel needs.",
    "A size on the command line without its unit is in bytes. The kernel dies before its first message.",
)
def too_little_memory(context: Context) -> Iterator[Finding]:
    for told in _memory(context):
        if told.end < LEAST_MEMORY:
            yield Finding(
                "too-little-memory",
                **at(told.node, told.property),
                message=f"{told.text}, which is {told.end} bytes",
                remedy="Write the size in bytes, or on the command line with its unit, as in mem=64M",
            )


@rule(
    "untyped-memory",
    "A memory node does not say that it is one.",
    'The kernel takes its memory from nodes with device_type = "memory" alone. It finds none, and dies '
    "before its first message, unless the boot loader writes what is missing.",
)
def untyped_memory(context: Context) -> Iterator[Finding]:
    for node in context.tree.root:
        if node.enabled and node.base_name == "memory" and node.strings("device_type") != ["memory"]:
            yield Finding(
                "untyped-memory",
                **at(node, "device_type"),
                message=f'{node.path} has no device_type = "memory"',
                remedy=f'Set device_type = "memory" in {node.path}',
                fix=valued("device_type", '"memory"')
                if "device_type" in node.properties
                else added('device_type = "memory";', node),
            )


@rule(
    "reserved-over-boot",
    "A reserved region lies where the boot loader puts the kernel or the device tree.",
    "The kernel runs from there, or reads the tree there, before it knows of the region. It dies without a "
    "message, or whoever has the region overwrites it.",
)
def reserved_over_boot(context: Context) -> Iterator[Finding]:
    limits = context.board.limits if context.board else None
    for node in context.tree.find("/reserved-memory") or () if limits else ():
        for start, size in _pairs(node):
            for what, place in limits.loaded.items():
                if node.enabled and start < place.stop and place.start < start + size:
                    yield Finding(
                        "reserved-over-boot",
                        **at(node, "reg"),
                        message=f"{node.path} reserves {start:#x} to {start + size:#x}; {what} is at "
                        f"{place.start:#x} to {place.stop:#x}",
                        remedy=f"Set reg of {node.name} to a region behind {place.stop:#x}, or correct "
                        f"{limits.file.name}",
                    )


@rule(
    "wrong-initrd",
    "The tree tells the kernel of an initial RAM disk that cannot be.",
    "The kernel ignores it and finds no root file system, or reads memory that does not exist.",
)
def wrong_initrd(context: Context) -> Iterator[Finding]:
    chosen = context.tree.find("/chosen")
    told = [name for name in INITRD if chosen and name in chosen.properties]
    if not told:
        return
    start, end = (
        int.from_bytes(chosen.properties[name].raw, "big") if name in told else None for name in INITRD
    )
    memory = max((told.end for told in _memory(context) if told.property == "reg"), default=0)
    if start is None or end is None:
        fault = f"{told[0]} is there alone"
    elif end <= start:
        fault = f"{INITRD[1]} ({end:#x}) is not behind {INITRD[0]} ({start:#x})"
    elif memory and end > memory:
        fault = f"it ends at {end:#x}; memory ends at {memory:#x}"
    else:
        return
    yield Finding(
        "wrong-initrd",
        **at(chosen, told[-1]),
        message=f"of the initial RAM disk {fault}",
        remedy=f"Write where it begins and ends, or delete {listed(told)}: a boot loader writes them",
    )


@rule(
    "unknown-node",
    "A node of the root is called nearly as one that the kernel looks for by its name.",
    "Nothing reads it: a kernel without its command line, its memory or its aliases, and no message.",
)
def unknown_node(context: Context) -> Iterator[Finding]:
    for node in context.tree.root:
        nearest = [name for name in NODES if is_one_off(node.base_name, name)]
        if nearest and "compatible" not in node.properties:
            yield Finding(
                "unknown-node",
                **at(node),
                message=f"{node.path} is read by nothing; it probably means {nearest[0]}",
                remedy=f"Call it {nearest[0]}, or delete it",
            )


@rule(
    "reserved-unread",
    "The node of reserved regions is not written as the kernel reads it.",
    "The kernel wants ranges, and #address-cells and #size-cells as the root has them. Else it reserves "
    "nothing, and uses the regions as any memory.",
)
def reserved_unread(context: Context) -> Iterator[Finding]:
    node = context.tree.find("/reserved-memory")
    if node is None or not any(child.enabled for child in node):
        return
    wanted = {name: context.tree.root.cells(name) or [1] for name in ("#address-cells", "#size-cells")}
    lacks = [f"{name} = <{cells[0]}>" for name, cells in wanted.items() if node.cells(name) != cells]
    lacks += [] if "ranges" in node.properties else ["an empty ranges"]
    if lacks:
        yield Finding(
            "reserved-unread",
            **at(node),
            message=f"{node.path} has no {listed(lacks)}",
            remedy=f"Add {listed(lacks)} to {node.path}",
        )


# ---- console -------------------------------------------------------------------------------------


@rule(
    "wrong-console",
    "The console is a disabled port, or not the port that the board has for it.",
    "The kernel starts, but nobody sees its messages. nuc980-netboot waits for them and reports that the "
    "board is dead.",
)
def wrong_console(context: Context) -> Iterator[Finding]:
    for name, told, node, fault in _consoles(context):
        fault = fault or _port_fault(context, node)
        if fault:
            yield Finding(
                "wrong-console",
                **at(context.chosen, name),
                message=f"{told} is {fault}",
                remedy=_right_console(context, node),
            )


def _consoles(context: Context) -> Iterator[tuple[str, str, Node | None, str]]:
    """Each console that the tree names: the property, what it says, its port, what is wrong with the name."""
    chosen = context.tree.find("/chosen")
    for value in chosen.strings("stdout-path")[:1] if chosen else ():
        port, fault = _by_path(context, value.partition(":")[0])
        yield "stdout-path", f'stdout-path = "{value}"', port, fault
    # Of several, the last is /dev/console.
    for word in [found for word in context.command_line if (found := CONSOLE_WORD.fullmatch(word))][-1:]:
        tty = word["tty"]
        if tty.startswith("ttyS"):
            port = _port(context, tty.removeprefix("ttyS"))
            yield "bootargs", word[0], port, "" if port else "not a port of this tree"
        elif FOREIGN_TTY.fullmatch(tty):
            yield "bootargs", word[0], None, "a port of another chip: those of the NUC980 are ttyS0 to ttyS9"


def _by_path(context: Context, name: str) -> tuple[Node | None, str]:
    """The node of a path, or of an alias; and what is wrong with it."""
    aliases = context.tree.find("/aliases")
    path = name
    if not name.startswith("/"):
        path = next(iter(aliases.strings(name) if aliases else ()), "")
        if not path:
            return None, "not an alias of this tree"
    node = context.tree.find(path)
    return node, "" if node else "not a node of this tree"


def _port(context: Context, number: str) -> Node | None:
    """The UART of this number: the drivers go by port-number."""
    label = f"uart{number}"
    return next((node for node, one in context.peripherals.items() if one.label == label), None)


def _port_fault(context: Context, node: Node) -> str:
    if not node.enabled:
        return f"{context.name(node)}, which {off(node)}"
    peripheral = context.peripherals.get(node)
    if peripheral is None or "port-number" not in peripheral.properties:
        return f"{context.name(node)}, which is not a serial port"
    right = context.board.console if context.board else None
    if right and peripheral.label != right:
        purpose = context.board.devices[right].purpose
        return f"{peripheral.label}; the console of the board is {right} ({purpose})"
    return ""


def _right_console(context: Context, named: Node | None) -> str:
    right = context.board.console if context.board else None
    if right is None:
        return "Name an enabled port"
    if named and not named.enabled and context.name(named) == right:
        return f'Set status = "okay" in {context.name(switched_off(named))}'
    number = context.chip.peripherals[right].properties.get("port-number")
    return f"Name the console's port: console=ttyS{number}, and {right} in stdout-path"


# ---- aliases -------------------------------------------------------------------------------------


@rule(
    "wrong-alias",
    "The number of an alias is not the number of its port, or the alias is of no node.",
    "ttyS1 is the UART with port-number 1, whatever serial1 says; stdout-path and people follow the alias "
    "to another port. U-Boot writes the MAC addresses to ethernet0 and ethernet1; if the two are exchanged, "
    "each port gets the other's address.",
)
def wrong_alias(context: Context) -> Iterator[Finding]:
    aliases = context.tree.find("/aliases")
    for name in aliases.properties if aliases else ():
        path = next(iter(aliases.strings(name)), "")
        right = _right_label(context, name)
        node = context.tree.find(path) if path.startswith("/") else None
        peripheral = context.peripherals.get(node) if node else None
        if node and (right is None or (peripheral and peripheral.label == right)):
            continue
        has = context.name(node) if node else f"{path!r} (not a node)"
        yield Finding(
            "wrong-alias",
            **at(aliases, name),
            message=f"{name} is {has}" + (f", not {right}" if right else ""),
            remedy=f"Write {name} = &{right or 'LABEL'}, or delete {name}",
        )


def _right_label(context: Context, name: str) -> str | None:
    """The device that an alias of this name is for; None: any, or nobody knows."""
    if found := SERIAL.fullmatch(name):
        label = f"uart{found[1]}"
        return label if label in context.chip.peripherals else None
    found = ETHERNET.fullmatch(name)
    order = context.board.ethernet if context.board else ()
    return order[int(found[1])] if found and int(found[1]) < len(order) else None


@rule(
    "bad-mac",
    "A port has a group's MAC address, or the address of another port.",
    "The kernel refuses a group's address and takes a random one. If two ports have the same address, each "
    "takes the other's frames.",
)
def bad_mac(context: Context) -> Iterator[Finding]:
    has = {
        node: (name, node.properties[name].raw)
        for node in context.devices
        for name in MAC
        if name in node.properties and any(node.properties[name].raw)  # zeros are for U-Boot to fill in
    }
    for node, (name, mac) in has.items():
        if len(mac) != 6 or mac[0] & 1:
            yield Finding(
                "bad-mac",
                **at(node, name),
                message=f"{name} of {context.name(node)} is {mac.hex(':')}, "
                + ("not six bytes" if len(mac) != 6 else "the address of a group: the first byte is odd"),
                remedy=f"Write the port's own address, or delete {name}",
            )
    for mac, same in grouped(has, lambda node: has[node][1]).items():
        if len(same) > 1:
            yield Finding(
                "bad-mac",
                **at(same[-1], has[same[-1]][0]),
                message=f"{listed(map(context.name, same))} all have the MAC address {mac.hex(':')}",
                remedy="Give each port an address of its own",
                claimants=tuple(
                    Claimant(node.path, mac.hex(":"), node.place_of(has[node][0])) for node in same
                ),
            )


RULES = (
    too_much_memory,
    too_little_memory,
    untyped_memory,
    reserved_outside,
    reserved_over_boot,
    reserved_unread,
    wrong_initrd,
    unknown_node,
    wrong_console,
    wrong_alias,
    bad_mac,
)
