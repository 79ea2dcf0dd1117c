# SPDX-License-Identifier: GPL-3.0-or-later
"""
Types that a text declares, and where the machine keeps variables of them.

The machine has elementary variables, and arrays of them with one dimension. A structure is its members, one
behind the other. An array of structures is an array of each member, its dimensions before the member's.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from itertools import product
from math import prod
from operator import mul

from logic.binary import Array, Slot
from logic.syntax import Initial

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
class ArrayOf:
    element: str | Enumeration | Structure
    bounds: tuple[Bounds, ...]
    default: Initials = field(default=(), compare=False)  # of each element

    @property
    def count(self) -> int:
        return prod(high - low + 1 for low, high in self.bounds)

    @property
    def name(self) -> str:
        inside = ", ".join(f"{low}..{high}" for low, high in self.bounds)
        return f"ARRAY[{inside}] OF {name_of(self.element)}"


Type = str | Enumeration | Structure | ArrayOf


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
    """A variable of a structure or an array: its leaves lie one behind the other."""

    type: Structure | ArrayOf
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
    else:
        yield path, Leaf(kind, bounds)


def elements_of(stored: Stored) -> Iterator[tuple[str, Slot]]:
    """The elementary variables, by what stands behind the variable's name: `[3].HIGH`, `[1,2]`."""

    def below(kind: Type, shown: str, path: str, index: tuple[int, ...]) -> Iterator[tuple[str, Slot]]:
        if isinstance(kind, ArrayOf):
            for place in product(*(range(low, high + 1) for low, high in kind.bounds)):
                moved = tuple(at - low for at, (low, _) in zip(place, kind.bounds, strict=True))
                yield from below(kind.element, f"{shown}[{','.join(map(str, place))}]", path, index + moved)
        elif isinstance(kind, Structure):
            for name, member in kind.members.items():
                yield from below(member, f"{shown}.{name}", f"{path}.{name}", index)
        else:
            leaf = stored.leaves[path]
            yield shown, leaf.slots[sum(map(mul, index, leaf.steps))]

    return below(stored.type, "", "", ())


def size_of(kind: Type) -> int:
    """How many variables of the machine hold it."""
    if isinstance(kind, ArrayOf):
        return kind.count * size_of(kind.element)
    return kind.size if isinstance(kind, Structure) else 1


def retained_name(path: str, leaf: Leaf) -> str:
    """What has another shape or other values has another name: a value is carried to its like only."""
    shape = f"[{','.join(f'{low}..{high}' for low, high in leaf.bounds)}]" if len(leaf.bounds) > 1 else ""
    values = ""
    if isinstance(leaf.kind, Enumeration):
        values = f"({','.join(f'{name}={number}' for name, number in leaf.kind.values.items())})"
    return path + shape + values
