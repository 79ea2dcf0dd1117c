# SPDX-License-Identifier: GPL-3.0-or-later
"""The kernel's own bindings: what dt-validate of dtschema finds with them, as findings of ours."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from nuc980.errors import UnusableInput, printable
from nuc980.pins.findings import Finding, at
from nuc980.pins.tree import Node, Tree

RULE = "schema"
PROGRAM = "dt-validate"
PATIENCE = 120  # seconds
# Of a property whose type no binding tells: its bytes are held against dt-core.yaml.
UNTYPED = re.compile(r"b(['\"]).*\1 is not of type .*", re.DOTALL)
# A single cell, where bindings give one name two types (sleep: powerpc/sleep.yaml): no DTB tells them apart.
ONE_CELL = re.compile(r"\[\[\d+\]\] is not of type 'integer'")
WRONG_SIZE = re.compile(r"(?P<name>[\w#,.+-]+): size \((?P<size>\d+)\) error for type")
LONGEST = 200  # characters of a message


@dataclass(frozen=True)
class Schemas:
    """Bindings that dt-mk-schema has processed into one file."""

    file: Path

    def findings(self, tree: Tree, compiled: bytes) -> list[Finding]:
        """Of a tree and its DTB. Raises UnusableInput if dtschema is missing, or the file none of its own."""
        with tempfile.TemporaryDirectory() as folder:
            dtb, told = Path(folder) / "tree.dtb", Path(folder) / "told.json"
            dtb.write_bytes(compiled)
            done = self._run(dtb, told)
            if not told.exists():
                last = (done.stderr.strip().splitlines() or ["nothing said"])[-1]
                raise UnusableInput(
                    f"{self.file}: {PROGRAM} ends with {last!r}; "
                    "make the file again: dt-mk-schema -j BINDINGS > FILE, or make schemas"
                )
            return list(dict.fromkeys(_findings(tree, json.loads(told.read_text("utf-8")))))

    def _run(self, dtb: Path, told: Path) -> subprocess.CompletedProcess[str]:
        program = shutil.which(PROGRAM, path=str(Path(sys.executable).parent)) or shutil.which(PROGRAM)
        if program is None:
            raise UnusableInput(
                f"{PROGRAM} is missing; install dtschema: pip install 'openrtu-tools[schemas]'"
            )
        if not self.file.is_file():
            raise UnusableInput(
                f"{self.file}: no such file; make it of the kernel's bindings: "
                "dt-mk-schema -j linux/Documentation/devicetree/bindings > FILE, or make schemas"
            )
        try:
            return subprocess.run(
                [program, "-s", self.file, "--json-output", told, dtb],
                capture_output=True,
                text=True,
                errors="replace",
                timeout=PATIENCE,
            )
        except subprocess.TimeoutExpired as error:
            raise UnusableInput(f"{PROGRAM} did not end within {PATIENCE} s; check {self.file}") from error


def _findings(tree: Tree, diagnostics: list[dict[str, Any]]) -> Iterator[Finding]:
    """One for each fault, though several bindings may tell it."""
    told: set[tuple[Node, str | None, str]] = set()
    for one in diagnostics:
        message = " ".join(str(one.get("message", "")).split())
        if UNTYPED.fullmatch(message) or ONE_CELL.fullmatch(message):
            continue
        for node, name in _places(tree, one, message):
            if (node, name, message) not in told:
                told.add((node, name, message))
                yield _finding(node, name, message, one)


def _places(tree: Tree, one: dict[str, Any], message: str) -> Iterator[tuple[Node, str | None]]:
    """The node and property that a diagnostic is about; of a value of a wrong size, all that have it."""
    if size := WRONG_SIZE.search(message):
        for node in tree.root.walk():
            if size["name"] in node.properties and len(node.properties[size["name"]].raw) == int(
                size["size"]
            ):
                yield node, size["name"]
        return
    node = tree.find(one.get("node") or "/") or tree.root
    yield node, next((part for part in one.get("property_path", ())[:1] if part in node.properties), None)


def _finding(node: Node, name: str | None, message: str, one: dict[str, Any]) -> Finding:
    binding = str(one.get("schema") or "").rpartition("/schemas/")[2].rstrip("#")
    return Finding(
        RULE,
        **at(node, name),
        message=f"{node.path}: {name + ': ' if name else ''}{_shown(message)}",
        remedy=f"Write it as the binding says: {binding}"
        if binding
        else "Write it with the type of its binding",
    )


def _shown(message: str) -> str:
    text = printable(message)
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}…"
