# SPDX-License-Identifier: GPL-3.0-or-later
"""A device tree in memory: nodes, properties as raw bytes; of one read from source also the lines."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

CELL = 4
NOTES = ("__symbols__", "__fixups__", "__local_fixups__")  # of dtc at the root, for overlays: no devices
BODY = "__overlay__"  # of a fragment of an overlay: what it changes


@dataclass(frozen=True, order=True)
class Place:
    """A line of a source file."""

    file: str
    line: int

    def __str__(self) -> str:
        return f"{self.file}:{self.line}"


@dataclass
class Property:
    """
    A property. Its type is known to whoever reads it, from the binding: the bytes alone do not tell
    (pyfdt's guess is wrong for <0x61626300>).
    """

    name: str
    raw: bytes
    place: Place | None = None  # the last line that set it

    @cached_property
    def cells(self) -> list[int] | None:
        """32-bit cells, None when the length is no multiple of four."""
        if len(self.raw) % CELL:
            return None
        return [int.from_bytes(self.raw[i : i + CELL], "big") for i in range(0, len(self.raw), CELL)]

    def cell(self, offset: int) -> int:
        """The value of the cell that begins there."""
        return int.from_bytes(self.raw[offset : offset + CELL], "big")

    def set_cell(self, offset: int, value: int) -> None:
        """Another value in the cell that begins there."""
        self.raw = self.raw[:offset] + (value % (1 << 32)).to_bytes(CELL, "big") + self.raw[offset + CELL :]
        self.__dict__.pop("cells", None)
        self.__dict__.pop("strings", None)

    @cached_property
    def strings(self) -> list[str] | None:
        """Strings, None when the bytes are no list of terminated UTF-8 strings."""
        if not self.raw.endswith(b"\0"):
            return None
        try:
            return [part.decode() for part in self.raw[:-1].split(b"\0")]
        except UnicodeDecodeError:
            return None


@dataclass(eq=False)  # a node is itself: comparing all below and above it would never end
class Node:
    """A node. Iterating gives its children."""

    name: str  # with the unit address; "" for the root
    parent: Node | None = None
    properties: dict[str, Property] = field(default_factory=dict)
    children: list[Node] = field(default_factory=list)
    places: tuple[Place, ...] = ()  # every line where its body begins: several for a merged node
    labels: tuple[str, ...] = ()

    def __iter__(self) -> Iterator[Node]:
        return iter(self.children)

    @property
    def path(self) -> str:
        """As in the tree: "/apb/serial@b0071000"; the root's is "/"."""
        if self.parent is None:
            return "/"
        return f"{self.parent.path.rstrip('/')}/{self.name}"

    @property
    def base_name(self) -> str:
        """The name without unit address: what the kernel calls np->name."""
        return self.name.partition("@")[0]

    @property
    def unit_address(self) -> str | None:
        """Behind the @, None without one."""
        _, at, unit = self.name.partition("@")
        return unit if at else None

    @property
    def enabled(self) -> bool:
        """Whether it and all nodes above it are on: a missing status is on, "ok" is on too (v0.4, 2.3.4)."""
        status = self.properties.get("status")
        on = status is None or status.strings in (["okay"], ["ok"])
        return on and (self.parent is None or self.parent.enabled)

    def cells(self, name: str) -> list[int]:
        """The cells of a property; none when it is missing or has no whole cells."""
        found = self.properties.get(name)
        return list(found.cells or ()) if found else []

    def strings(self, name: str) -> list[str]:
        """The strings of a property; none when it is missing or has none."""
        found = self.properties.get(name)
        return list(found.strings or ()) if found else []

    def place_of(self, name: str | None = None) -> Place | None:
        """Where a property was set last, or where the node begins."""
        if name is not None and name in self.properties:
            return self.properties[name].place
        return self.places[-1] if self.places else None

    @property
    def is_note(self) -> bool:
        return self.name in NOTES and self.parent is not None and self.parent.parent is None

    def walk(self) -> Iterator[Node]:
        """This node and all below it, in file order, but for dtc's notes."""
        yield self
        for child in self.children:
            if not child.is_note:
                yield from child.walk()


@dataclass
class Tree:
    """A device tree, and the file it came from."""

    file: Path
    root: Node
    from_source: bool  # places and labels are known
    by_phandle: dict[int, Node] = field(init=False)

    def __post_init__(self) -> None:
        self.by_phandle = {}
        for node in self.root.walk():
            for phandle in node.cells("phandle") or node.cells("linux,phandle"):
                self.by_phandle.setdefault(phandle, node)

    def find(self, path: str) -> Node | None:
        """The node of a path, None when there is none."""
        node: Node | None = self.root
        for name in filter(None, path.split("/")):
            node = next((child for child in node if child.name == name), None) if node else None
        return node
