# SPDX-License-Identifier: GPL-3.0-or-later
"""Device trees as compiled: read with pyfdt, behind libfdt's check."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import libfdt
from pyfdt.pyfdt import FDT_BEGIN_NODE, FDT_END_NODE, FDT_PROP, FdtBlobParse

from nuc980.errors import UnusableInput
from nuc980.pins.tree import CELL, Node, Property, Tree

MAGIC = bytes.fromhex("d00dfeed")
HEADER = 40  # bytes, version 17 (devicetree specification v0.4, 5.2)
VERSION = 17
LARGEST = 1 << 20  # bytes: thirty times a NUC980's tree
LONGEST_NAME = 127  # characters: the specification allows 31
DEEPEST = 64  # nodes

# A property as pyfdt read it, before it guesses a type for the value.
Tag = tuple[int, str | tuple[str, bytes]]


def read_dtb(file: Path) -> Tree:
    """The tree of a DTB file. Raises UnusableInput for whatever is none."""
    try:
        with file.open("rb") as stream:
            data = stream.read(LARGEST + 1)
    except OSError as error:
        raise UnusableInput(f"{file}: {error.strerror}; name a device tree that can be read") from error
    return parse_dtb(data, file)


def parse_dtb(data: bytes, file: Path) -> Tree:
    """
    The tree of a DTB's bytes: nodes and properties in their order, labels from __symbols__ if it was compiled
    with dtc -@. Raises UnusableInput, which names `file`, for whatever is none.
    """
    try:
        _refuse_malformed(data)
        # pyfdt raises TypeError, struct.error, UnicodeDecodeError and plain Exception.
        root = _root_of(FdtBlobParse(BytesIO(data)).fdt_dt_tags)
    except Exception as error:
        raise UnusableInput(
            f"{file} is not a usable device tree: {error}; compile it again with dtc, or copy it again"
        ) from error
    tree = Tree(file, root, from_source=False)
    _label(tree)
    return tree


def _refuse_malformed(data: bytes) -> None:
    """What pyfdt does not look at: it accepts lengths past the end, for one."""
    if len(data) > LARGEST:
        raise ValueError(f"larger than {LARGEST} bytes")
    if not data.startswith(MAGIC):
        raise ValueError("it does not begin with d00dfeed" if data else "the file is empty")
    if len(data) < HEADER:
        raise ValueError("cut off in the header")
    if (version := _header(data, 5)) != VERSION:
        raise ValueError(f"format version {version}, not {VERSION}")
    strings = data[_header(data, 3) :][: _header(data, 8)]
    # Both libraries read a name anew for each property: a long one would keep them busy for minutes.
    if max(map(len, strings.split(b"\0"))) > LONGEST_NAME:
        raise ValueError(f"a property's name is longer than {LONGEST_NAME} characters")
    if error := libfdt.fdt_check_full(bytearray(data), len(data)):
        raise ValueError(f"libfdt says {libfdt.fdt_strerror(error)}")


def _header(data: bytes, field: int) -> int:
    return int.from_bytes(data[CELL * field : CELL * (field + 1)], "big")


def _root_of(tags: list[Tag]) -> Node:
    """
    The root, from pyfdt's tags, which have the bytes of a property. In its tree of classes they are a guessed
    type, and to_raw() raises TypeError.
    """
    above = Node("outside")
    node, depth = above, 0
    for tag, content in tags:
        if tag == FDT_BEGIN_NODE:
            node, depth = _new_child(node, content, depth), depth + 1
        elif tag == FDT_END_NODE:
            node, depth = node.parent or above, depth - 1
        elif tag == FDT_PROP:
            _set_property(node, *content)
    if len(above.children) != 1 or above.properties:
        raise ValueError("it does not have exactly one root node")
    root = above.children[0]
    root.name, root.parent = "", None
    for node in root.walk():
        if len({child.name for child in node}) < len(node.children):
            raise ValueError(f"two children of {node.path} have the same name")
    return root


def _new_child(parent: Node, name: str, depth: int) -> Node:
    if depth == DEEPEST:
        raise ValueError(f"its nodes are nested deeper than {DEEPEST}")
    if depth and "/" in name:
        raise ValueError("a node's name is empty or has a slash")
    _refuse_unprintable(name)
    child = Node(name, parent)
    parent.children.append(child)
    return child


def _set_property(node: Node, name: str, raw: bytes) -> None:
    _refuse_unprintable(name)
    if name in node.properties:
        raise ValueError(f"two properties {name} in node {node.name}")
    node.properties[name] = Property(name, raw)


def _refuse_unprintable(name: str) -> None:
    """Names go to terminals."""
    if not name or not name.isprintable():
        raise ValueError(f"a name that cannot be printed, {name!r}")


def flattened(tree: Tree) -> bytes:
    """The bytes of a DTB with this tree: of one in memory, as with overlays on it."""
    writer = libfdt.FdtSw()
    writer.finish_reservemap()

    def put(node: Node) -> None:
        with writer.add_node(node.name):
            for name, found in node.properties.items():
                writer.property(name, found.raw)
            for child in node:
                put(child)

    put(tree.root)
    return bytes(writer.as_fdt().as_bytearray())


def _label(tree: Tree) -> None:
    symbols = tree.find("/__symbols__")
    if symbols is None:
        return
    labels: dict[str, list[str]] = {}
    for label in symbols.properties:
        for path in symbols.strings(label)[:1]:
            labels.setdefault(path, []).append(label)
    for node in tree.root.walk():
        node.labels = tuple(labels.get(node.path, ()))
