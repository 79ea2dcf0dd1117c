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
class Finding:
    """One thing that is wrong."""

    rule: str
    node: str  # path of the node to look at
    message: str  # one sentence, without full stop
    remedy: str  # what to do, an imperative
    place: Place | None = None
    claimants: tuple[Claimant, ...] = ()
    pins: tuple[str, ...] = ()
    accepted: str | None = None  # the reason, for one that the pin table accepts


def at(node: Node, name: str | None = None) -> dict[str, str | Place | None]:
    """The arguments node and place of a finding at a node, or at one of its properties."""
    return {"node": node.path, "place": node.place_of(name)}
