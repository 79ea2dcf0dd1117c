# SPDX-License-Identifier: GPL-3.0-or-later
"""The rules, and the check of a device tree by all of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from nuc980.pins.board import Board
from nuc980.pins.chip import Chip, Package
from nuc980.pins.environment import Environment
from nuc980.pins.findings import Finding
from nuc980.pins.rules import (
    addresses,
    boot,
    command_line,
    devices,
    flash,
    groups,
    interrupts,
    pins,
    properties,
    schemas,
    serial_buses,
    sets,
    table,
    values,
)
from nuc980.pins.rules.context import Context, Rule
from nuc980.pins.tree import Tree

THEMES = (
    pins,
    groups,
    sets,
    addresses,
    interrupts,
    devices,
    properties,
    values,
    serial_buses,
    flash,
    boot,
    command_line,
    table,
    schemas,
)
RULES: dict[str, Rule] = {rule.name: rule for theme in THEMES for rule in theme.RULES}


def check(
    tree: Tree,
    chip: Chip,
    board: Board | None = None,
    package: Package | None = None,
    environment: Environment | None = None,
    validated: Sequence[Finding] = (),
) -> list[Finding]:
    """
    Everything that a tree does wrong, in the order of its places: against the chip, with a board against its
    pin table as well, with a package against what that brings out, and together with what is said beside it.
    What the pin table accepts comes with the reason.
    """
    context = Context(tree, chip, board, package, environment or Environment(), validated)
    found = (finding for rule in RULES.values() for finding in rule.find(context))
    return sorted(_accept(dict.fromkeys(found), board), key=_position)


def _accept(findings: Iterable[Finding], board: Board | None) -> list[Finding]:
    reasons = {(entry.rule, entry.node): entry.reason for entry in board.accepted} if board else {}
    return [replace(finding, accepted=reasons.get((finding.rule, finding.node))) for finding in findings]


def _position(finding: Finding) -> tuple[bool, str, int, str]:
    """At one place the order of the rules stays, which is that of their weight."""
    place = finding.place
    return place is None, place.file if place else "", place.line if place else 0, finding.node
