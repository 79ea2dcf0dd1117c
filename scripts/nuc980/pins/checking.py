# SPDX-License-Identifier: GPL-3.0-or-later
"""A check of files, with all that is known beside them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from nuc980.errors import UnusableInput
from nuc980.pins.board import Board
from nuc980.pins.chip import Chip, Package
from nuc980.pins.dtb import flattened
from nuc980.pins.environment import Environment
from nuc980.pins.findings import Finding
from nuc980.pins.fixing import Mended, mended
from nuc980.pins.overlays import check_overlays
from nuc980.pins.report import Checked
from nuc980.pins.rules import check
from nuc980.pins.schemas import Schemas
from nuc980.pins.source import read_any, read_tree
from nuc980.pins.tree import Tree


@dataclass(frozen=True)
class Checker:
    """What trees are held against, and where a source finds its parts."""

    chip: Chip
    board: Board | None  # None: the rules of the pin table do not run
    package: Package | None
    environment: Environment = field(default_factory=Environment)
    include: Sequence[Path] = ()
    defines: Sequence[str] = ()
    schemas: Schemas | None = None  # None: without the kernel's bindings, in a tenth of the time

    def findings(self, tree: Tree) -> list[Finding]:
        validated = self.schemas.findings(tree, flattened(tree)) if self.schemas else ()
        return check(tree, self.chip, self.board, self.package, self.environment, validated)

    def file(self, file: Path) -> Checked:
        tree = read_tree(file, self.include, self.defines)
        return Checked(file, tuple(self.findings(tree)), tree.from_source)

    def overlays(self, base: Path, overlays: Sequence[Path]) -> list[Checked]:
        if not overlays:
            raise UnusableInput(f"--overlay: {base} is the base; name the overlays behind it")
        return check_overlays(
            read_tree(base, self.include, self.defines, symbols=True),
            [read_any(file, self.include, self.defines, symbols=True) for file in overlays],
            self.findings,
        )

    def mended(self, checked: Checked) -> Mended:
        """A source, with what has one right answer."""
        if not checked.from_source:
            raise UnusableInput(f"{checked.file} is compiled: --fix changes sources; name the .dts")
        elsewhere = replace(self, include=[checked.file.parent, *self.include])
        return mended(checked.file, checked.findings, lambda copy: elsewhere.file(copy).findings)
