# SPDX-License-Identifier: GPL-3.0-or-later
"""
Types that a text declares, and where the machine keeps variables of them.

The machine has elementary variables, and arrays of them with one dimension. A structure is its members, one
behind the other. An array of structures is an array of each member, its dimensions before the member's.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import product
from math import prod
from operator import mul

from openrtu_tools.logic.binary import Array, Slot, String
from openrtu_tools.logic.syntax import Initial

Bounds = tuple[int, int]
# The first one counts; what it leaves out of a structure the others say.
Initials = tuple[Initial, ...]
ELEMENTS_MAX = 30000


@dataclass(frozen=True)
class Enumeration:
    """A variable of it is a DINT of the machine, whose type is this one's name."""

    name: str
    values: dict[str, int] = field(hash=False)

    def shown(self, number: float) -> str:
        return next(f"{self.name}#{name}" for name, its in self.values.items() if its == number)


@dataclass(frozen=True)
class Structure:
    name: str
    members: dict[str, Type] = field(hash=False)
    defaults: dict[str, Initials] = field(hash=False, compare=False)

    @cached_property
    def size(self) -> int:
        return sum(size_of(member) for member in self.members.values())


@dataclass(frozen=True)
class Characters:
    """A STRING of so many at most: an array of LINT of the machine, the first of which counts them."""

    octets: int

    @property
    def name(self) -> str:
        return f"STRING({self.octets})"

    @property
    def size(self) -> int:
        return 1 + (self.octets + 7) // 8


@dataclass(frozen=True)
class BlockOf:
    """A function block in a structure: its instance lies beside the structure's variable (blocks_of)."""

    name: str


@dataclass(frozen=True)
class ArrayOf:
    element: str | Enumeration | Structure | Characters | BlockOf
    bounds: tuple[Bounds, ...]
    default: Initials = field(default=(), compare=False)  # of each element

    @property
    def count(self) -> int:
        return prod(high - low + 1 for low, high in self.bounds)

    @property
    def name(self) -> str:
        inside = ", ".join(f"{low}..{high}" for low, high in self.bounds)
        return f"ARRAY[{inside}] OF {name_of(self.element)}"


Type = str | Enumeration | Structure | Characters | ArrayOf | BlockOf


def name_of(kind: Type) -> str:
    """Of an elementary type and an enumeration: what a Slot has as its type."""
    return kind if isinstance(kind, str) else kind.name


def is_single(kind: Type) -> bool:
    """Whether one variable of the machine holds it."""
    return isinstance(kind, str | Enumeration)


@dataclass(eq=False)
class Leaf:
    """One elementary variable, or an array of them: what stands behind a path of members."""

    kind: str | Enumeration
    bounds: tuple[Bounds, ...]
    octets: int = 0  # of a STRING
    slots: list[Slot] = field(default_factory=list)
    arrays: dict[tuple[int, int, int, int], Array] = field(default_factory=dict)

    @property
    def steps(self) -> list[int]:
        """How many slots an index of each dimension moves on."""
        sizes = [high - low + 1 for low, high in self.bounds]
        return [prod(sizes[number + 1 :]) for number in range(len(sizes))]

    @property
    def size(self) -> int:
        return prod(high - low + 1 for low, high in self.bounds)


@dataclass(eq=False)
class Stored:
    """A variable of a structure, an array or a STRING: its leaves lie one behind the other."""

    type: Structure | ArrayOf | Characters
    leaves: dict[str, Leaf]  # by the path of members, such as ".LIMIT.HIGH"

    @property
    def slots(self) -> list[Slot]:
        return [slot for leaf in self.leaves.values() for slot in leaf.slots]

    def below(self, path: str) -> list[Leaf]:
        """The leaves of a member, or the member's own."""
        return [leaf for name, leaf in self.leaves.items() if name == path or name.startswith(f"{path}.")]


def leaves_of(kind: Type, path: str = "", bounds: tuple[Bounds, ...] = ()) -> Iterator[tuple[str, Leaf]]:
    if isinstance(kind, ArrayOf):
        yield from leaves_of(kind.element, path, bounds + kind.bounds)
    elif isinstance(kind, Structure):
        for name, member in kind.members.items():
            yield from leaves_of(member, f"{path}.{name}", bounds)
    elif isinstance(kind, BlockOf):
        return
    elif isinstance(kind, Characters):
        yield path, Leaf("LINT", (*bounds, (0, kind.size - 1)), kind.octets)
    else:
        yield path, Leaf(kind, bounds)


# The members on the way to a block, each with the bounds of its own: of p[1..2].t it is ("", 1..2), (".T", ).
Way = tuple[tuple[str, tuple[Bounds, ...]], ...]


def blocks_of(kind: Type, way: Way = (("", ()),)) -> Iterator[tuple[Way, BlockOf]]:
    """The function blocks in a structure, in its order."""
    if isinstance(kind, ArrayOf):
        member, bounds = way[-1]
        yield from blocks_of(kind.element, (*way[:-1], (member, bounds + kind.bounds)))
    elif isinstance(kind, Structure):
        for name, member_kind in kind.members.items():
            yield from blocks_of(member_kind, (*way, (f".{name}", ())))
    elif isinstance(kind, BlockOf):
        yield way, kind


def places_on(way: Way) -> Iterator[str]:
    """What stands behind the variable's name, of each element: `[1].T`, `[2].T`."""
    indices = product(*(range(low, high + 1) for _, bounds in way for low, high in bounds))
    for index in indices:
        shown, rest = "", list(index)
        for member, bounds in way:
            own, rest = rest[: len(bounds)], rest[len(bounds) :]
            shown += member + (f"[{','.join(map(str, own))}]" if own else "")
        yield shown


def elements_of(stored: Stored) -> Iterator[tuple[str, Slot | String]]:
    """The elementary variables, by what stands behind the variable's name: `[3].HIGH`, `[1,2]`."""

    def below(
        kind: Type, shown: str, path: str, index: tuple[int, ...]
    ) -> Iterator[tuple[str, Slot | String]]:
        if isinstance(kind, ArrayOf):
            for place in product(*(range(low, high + 1) for low, high in kind.bounds)):
                moved = tuple(at - low for at, (low, _) in zip(place, kind.bounds, strict=True))
                yield from below(kind.element, f"{shown}[{','.join(map(str, place))}]", path, index + moved)
        elif isinstance(kind, Structure):
            for name, member in kind.members.items():
                yield from below(member, f"{shown}.{name}", f"{path}.{name}", index)
        elif isinstance(kind, BlockOf):
            return
        else:
            leaf = stored.leaves[path]
            if isinstance(kind, Characters):
                first = sum(map(mul, index, leaf.steps))
                yield shown, String(leaf.slots[first : first + kind.size], kind.octets)
                return
            yield shown, leaf.slots[sum(map(mul, index, leaf.steps))]

    return below(stored.type, "", "", ())


def size_of(kind: Type) -> int:
    """How many variables of the machine hold it."""
    if isinstance(kind, ArrayOf):
        return kind.count * size_of(kind.element)
    if isinstance(kind, BlockOf):
        return 0  # of the structure's variable
    return kind.size if isinstance(kind, Structure | Characters) else 1


def retained_name(path: str, leaf: Leaf) -> str:
    """What has another shape or other values has another name: a value is carried to its like only."""
    shape = f"[{','.join(f'{low}..{high}' for low, high in leaf.bounds)}]" if len(leaf.bounds) > 1 else ""
    values = ""
    if isinstance(leaf.kind, Enumeration):
        values = f"({','.join(f'{name}={number}' for name, number in leaf.kind.values.items())})"
    text = f"'{leaf.octets}" if leaf.octets else ""
    return path + shape + values + text


def inner(leaf: Leaf, at: Sequence[int]) -> list[Slot]:
    """What an element of the first dimensions holds."""
    first = sum(
        (index - low) * step for index, (low, _), step in zip(at, leaf.bounds, leaf.steps, strict=False)
    )
    return leaf.slots[first : first + (leaf.steps[len(at) - 1] if at else leaf.size)]


def words_of(text: str, octets: int) -> list[int]:
    """The cells of a STRING of so many at most, with this text."""
    filled = text.encode("ascii").ljust((octets + 7) // 8 * 8, b"\0")
    return [len(text), *(int.from_bytes(filled[at : at + 8], "little") for at in range(0, len(filled), 8))]
