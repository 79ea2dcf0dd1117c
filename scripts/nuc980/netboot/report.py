# SPDX-License-Identifier: GPL-3.0-or-later
"""How a run ended, for those who were not there: times per phase, JUnit XML, JSON."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from nuc980.netboot.board import SCHEMA, BoardReport
from nuc980.netboot.errors import UnusableInput

# What XML 1.0 cannot carry, not even escaped.
NO_XML = re.compile(r"[^\t\n\r\x20-\uD7FF\uE000-\uFFFD\U00010000-\U0010FFFF]")
BEFORE = "prepare"  # the phase of what fails before there is one


@dataclass
class Report:
    """One run of a command; filled while it runs."""

    command: str
    started: datetime = field(default_factory=lambda: datetime.now(UTC))
    phases: Mapping[str, float] = field(default_factory=dict)
    board: BoardReport | None = None
    failed: str | None = None  # the phase
    error: BaseException | None = None

    def times(self) -> str:
        """Seconds per phase, as lines."""
        rows = [*self.phases.items(), ("together", sum(self.phases.values()))]
        return "\n".join(f"{seconds:8.2f} s  {name}" for name, seconds in rows)

    def junit(self) -> bytes:
        """A test suite with a test case per phase, as Jenkins and GitLab read it."""
        phases = dict(self.phases)
        if self.error is not None:
            phases.setdefault(self.failed or BEFORE, 0.0)
        suite = ElementTree.Element(
            "testsuite",
            name=f"nuc980-netboot {self.command}",
            tests=str(len(phases)),
            failures=str(int(self.error is not None)),
            errors="0",
            skipped="0",
            time=f"{sum(phases.values()):.3f}",
            timestamp=self.started.strftime("%Y-%m-%dT%H:%M:%S"),
        )
        if self.board:
            properties = ElementTree.SubElement(suite, "properties")
            ElementTree.SubElement(properties, "property", name="U-Boot", value=_clean(self.board.version))
        for name, seconds in phases.items():
            case = ElementTree.SubElement(
                suite,
                "testcase",
                classname=f"nuc980-netboot.{self.command}",
                name=name,
                time=f"{seconds:.3f}",
            )
            if self.error is not None and name == (self.failed or BEFORE):
                failure = ElementTree.SubElement(
                    case,
                    "failure",
                    type=type(self.error).__name__,
                    message=_clean(self._error_text()).split("\n")[0],
                )
                failure.text = _clean(self._error_text())
        suites = ElementTree.Element("testsuites")
        suites.append(suite)
        ElementTree.indent(suites)
        return ElementTree.tostring(suites, encoding="utf-8", xml_declaration=True) + b"\n"

    def as_json(self) -> dict[str, Any]:
        """For json.dumps; docs/netboot.md describes it."""
        error = None
        if self.error is not None:
            error = {
                "kind": type(self.error).__name__,
                "phase": self.failed or BEFORE,
                "text": self._error_text(),
            }
        return {
            "schema": SCHEMA,
            "command": self.command,
            "started": self.started.isoformat(timespec="seconds"),
            "phases": dict(self.phases),
            "error": error,
            "board": self.board.as_json() if self.board else None,
        }

    def _error_text(self) -> str:
        return str(self.error) or type(self.error).__name__

    def write(self, junit: Path | None, as_json: Path | None) -> None:
        """Writes the files that are wanted."""
        if junit:
            _replace(junit, self.junit())
        if as_json:
            _replace(as_json, json.dumps(self.as_json(), indent=2).encode() + b"\n")


def board_of(path: Path) -> BoardReport:
    """The board of a report that was written as JSON. Raises UnusableInput."""
    try:
        report = json.loads(path.read_bytes())
        return BoardReport.from_json(report["board"])
    except (ValueError, KeyError, TypeError) as error:
        raise UnusableInput(f"{path}: not a report of nuc980-netboot probe --json: {error}") from error
    except UnusableInput as error:
        raise UnusableInput(f"{path}: {error.what}") from error


def _replace(path: Path, content: bytes) -> None:
    """All of it or nothing; into what is no plain file, as /dev/stdout, and not in its place."""
    if path.is_symlink() or (path.exists() and not path.is_file()):
        path.write_bytes(content)
        return
    new = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        new.write_bytes(content)
        new.replace(path)
    finally:
        new.unlink(missing_ok=True)


def _clean(text: str) -> str:
    return NO_XML.sub("\N{REPLACEMENT CHARACTER}", text)
