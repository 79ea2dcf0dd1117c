# SPDX-License-Identifier: GPL-3.0-or-later
"""What changes at the pins from one device tree to another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from nuc980.pins.chip import Chip
from nuc980.pins.claims import Claim, claims
from nuc980.pins.rules.context import in_order
from nuc980.pins.rules.identity import identify
from nuc980.pins.tree import Tree

NOBODY = "-"


@dataclass(frozen=True)
class PinChange:
    """A pin with other users than before; several are a conflict, or states that take turns."""

    pin: str
    before: tuple[str, ...]  # "uart1 UART1_RXD", "/leds/run GPIO (gpios)"; empty: nobody
    after: tuple[str, ...]


def pin_diff(a: Tree, b: Tree, chip: Chip) -> list[PinChange]:
    """Pins that enabled nodes of `b` use otherwise than those of `a`, PA0 first: also by a node on or off."""
    before, after = _users(a, chip), _users(b, chip)
    changes = [PinChange(pin, before.get(pin, ()), after.get(pin, ())) for pin in in_order({*before, *after})]
    return [change for change in changes if change.before != change.after]


def format_diff(changes: Sequence[PinChange]) -> list[str]:
    """A line for each change, in columns: "PA0   uart1 UART1_RXD  ->  can3 CAN3_RXD"."""
    rows = [(change.pin, _listed(change.before), _listed(change.after)) for change in changes]
    width = max((len(before) for _, before, _ in rows), default=0)
    return [f"{pin:<5} {before:<{width}}  ->  {after}" for pin, before, after in rows]


def _users(tree: Tree, chip: Chip) -> dict[str, tuple[str, ...]]:
    users: dict[str, set[str]] = {}
    for claim in claims(tree, chip):
        users.setdefault(claim.pin, set()).add(_user(claim, chip))
    return {pin: tuple(sorted(its)) for pin, its in users.items()}


def _user(claim: Claim, chip: Chip) -> str:
    """Without labels: a source has them, and the DTB made from it not."""
    peripheral = identify(claim.node, chip)
    owner = peripheral.label if peripheral else claim.node.path
    signal = claim.signal or f"function {claim.value}"
    return f"{owner} {signal}" + ("" if claim.property == "pinctrl-0" else f" ({claim.property})")


def _listed(users: Sequence[str]) -> str:
    return ", ".join(users) or NOBODY
