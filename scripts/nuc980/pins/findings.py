# SPDX-License-Identifier: GPL-3.0-or-later
"""What a check found: the rule, the place, who claims what, and what to do."""

from __future__ import annotations

from dataclasses import dataclass

from nuc980.pins.tree import Node, Place


@dataclass(frozen=True)
class Claimant:
    """A node that wants something, and where it says so."""

    node: str  # path
    wants: str  # "PF0 as RMII1_RXERR, group emac1"
    place: Place | None = None

    def __str__(self) -> str:
        where = f" ({self.place})" if self.place else ""
        return f"{self.node}{where}: {self.wants}"


@dataclass(frozen=True)
class Fix:
    """The one right answer to a finding, as a change of its line."""

    name: str | None  # of the property that changes; None: a statement comes into the node
    becomes: str  # 'status = "okay";', "read-only;", nothing; its right name, if the value is kept
    keeps_value: bool = False
    place: Place | None = None  # where it is, if not at the finding's place


def renamed(name: str, right: str) -> Fix:
    return Fix(name, right, keeps_value=True)


def valued(name: str, value: str) -> Fix:
    return Fix(name, f"{name} = {value};")


def deleted(name: str) -> Fix:
    return Fix(name, "")


def added(statement: str, node: Node) -> Fix:
    """Into the node, where it begins: the finding may be at a property."""
    return Fix(None, statement, place=node.place_of())


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong."""

    rule: str
    node: str  # path of the node to look at
    message: str  # one sentence, without full stop
    remedy: str  # what to do, an imperative
    place: Place | None = None
    claimants: tuple[Claimant, ...] = ()
    pins: tuple[str, ...] = ()
    fix: Fix | None = None  # None: several answers are possible, or only a person knows it
    accepted: str | None = None  # the reason, for one that the pin table accepts


def at(node: Node, name: str | None = None) -> dict[str, str | Place | None]:
    """The arguments node and place of a finding at a node, or at one of its properties."""
    return {"node": node.path, "place": node.place_of(name)}
