# SPDX-License-Identifier: GPL-3.0-or-later
"""Findings as people and machines read them: text, JSON, SARIF 2.1.0, GitHub's workflow commands."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

from nuc980.errors import printable
from nuc980.pins.findings import Claimant, Finding
from nuc980.pins.rules import RULES
from nuc980.pins.tree import Place

SARIF_SCHEMA = "https://json.schemastore.org/sarif-2.1.0.json"


@dataclass(frozen=True)
class Checked:
    """A file, and what was found in it."""

    file: Path
    findings: tuple[Finding, ...]  # those that the pin table accepts as well
    from_source: bool = False
    behind: tuple[Path, ...] = ()  # the overlays without which this one does not fit the base

    @property
    def open(self) -> list[Finding]:
        """What nobody has accepted."""
        return [finding for finding in self.findings if finding.accepted is None]

    @property
    def accepted(self) -> list[Finding]:
        return [finding for finding in self.findings if finding.accepted is not None]


# ---- text ----------------------------------------------------------------------------------------


def as_text(checked: Sequence[Checked]) -> str:
    """A paragraph a finding, a line a file."""
    return "\n".join(printable(line, "\t") for one in checked for line in _text_of(one))


def _text_of(checked: Checked) -> list[str]:
    lines = []
    for finding in checked.open:
        lines.append(f"{_where(checked, finding)}: {finding.rule}: {finding.message}")
        lines += [f"    {claimant}" for claimant in finding.claimants]
        lines += [f"    To do: {finding.remedy}", ""]
    for finding in checked.accepted:
        lines.append(f"{_where(checked, finding)}: {finding.rule}: accepted: {finding.accepted}")
    count = f"{_count(len(checked.open), 'finding')}{_accepted_count(checked)}"
    lines.append(f"{checked.file}{_behind(checked)}: {count}")
    return lines


def _behind(checked: Checked) -> str:
    return f" (behind {', '.join(map(str, checked.behind))})" if checked.behind else ""


def _where(checked: Checked, finding: Finding) -> str:
    return str(finding.place) if finding.place else f"{checked.file}: {finding.node}"


def _count(number: int, what: str) -> str:
    return f"{number or 'no'} {what}{'' if number == 1 else 's'}"


def _accepted_count(checked: Checked) -> str:
    return f", {len(checked.accepted)} accepted" if checked.accepted else ""


# ---- JSON ----------------------------------------------------------------------------------------


def as_json(checked: Sequence[Checked]) -> str:
    """One object: a list of files, each with its findings."""
    files = [
        {"file": str(one.file), "findings": [_plain(finding) for finding in one.findings]} for one in checked
    ]
    return json.dumps({"files": files}, indent=2)


def _plain(finding: Finding) -> dict[str, Any]:
    return {
        "rule": finding.rule,
        "node": finding.node,
        "place": _plain_place(finding.place),
        "message": finding.message,
        "remedy": finding.remedy,
        "pins": list(finding.pins),
        "claimants": [
            {"node": claimant.node, "wants": claimant.wants, "place": _plain_place(claimant.place)}
            for claimant in finding.claimants
        ],
        "accepted": finding.accepted,
    }


def _plain_place(place: Place | None) -> dict[str, Any] | None:
    return {"file": place.file, "line": place.line} if place else None


# ---- SARIF ---------------------------------------------------------------------------------------


def as_sarif(checked: Sequence[Checked]) -> str:
    """A run of the static analysis interchange format: what code hosts and editors show."""
    driver = {
        "name": "nuc980-pins",
        "rules": [
            {
                "id": rule.name,
                "shortDescription": {"text": rule.what},
                "fullDescription": {"text": rule.why},
            }
            for rule in RULES.values()
        ],
    }
    results = [_sarif_result(one, finding) for one in checked for finding in one.findings]
    run = {"tool": {"driver": driver}, "columnKind": "unicodeCodePoints", "results": results}
    return json.dumps({"$schema": SARIF_SCHEMA, "version": "2.1.0", "runs": [run]}, indent=2)


def _sarif_result(checked: Checked, finding: Finding) -> dict[str, Any]:
    result = {
        "ruleId": finding.rule,
        "level": "error",
        "message": {"text": f"{finding.message}. {finding.remedy}."},
        "locations": [_sarif_location(checked, finding.node, finding.place)],
        "relatedLocations": [_sarif_claimant(checked, claimant) for claimant in finding.claimants],
    }
    if finding.accepted is not None:
        result["suppressions"] = [{"kind": "external", "justification": finding.accepted}]
    return result


def _sarif_claimant(checked: Checked, claimant: Claimant) -> dict[str, Any]:
    return _sarif_location(checked, claimant.node, claimant.place) | {"message": {"text": claimant.wants}}


def _sarif_location(checked: Checked, node: str, place: Place | None) -> dict[str, Any]:
    physical: dict[str, Any] = {
        "artifactLocation": {"uri": _uri(Path(place.file if place else checked.file))}
    }
    if place:
        physical["region"] = {"startLine": place.line}
    return {
        "physicalLocation": physical,
        "logicalLocations": [{"fullyQualifiedName": node, "kind": "member"}],
    }


def _uri(file: Path) -> str:
    """A URI reference (SARIF 2.1.0, 3.4.3): what is relative stays so, as the tree lies elsewhere."""
    return file.as_uri() if file.is_absolute() else quote(file.as_posix())


# ---- GitHub --------------------------------------------------------------------------------------


def as_github(checked: Sequence[Checked]) -> str:
    """Workflow commands: an annotation in the diff for each finding; accepted ones are notices."""
    return "\n".join(_github_line(one, finding) for one in checked for finding in one.findings)


def _github_line(checked: Checked, finding: Finding) -> str:
    command, text = "error", f"{finding.message}. {finding.remedy}."
    if finding.accepted is not None:
        command, text = "notice", f"{finding.message}. Accepted: {finding.accepted}"
    file = finding.place.file if finding.place else str(checked.file)
    line = f",line={finding.place.line}" if finding.place else ""
    title = _github_property(f"{finding.rule} at {finding.node}")
    return f"::{command} file={_github_property(file)}{line},title={title}::{_github_data(text)}"


def _github_data(text: str) -> str:
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _github_property(text: str) -> str:
    return _github_data(text).replace(":", "%3A").replace(",", "%2C")


FORMATS: dict[str, Callable[[Sequence[Checked]], str]] = {
    "text": as_text,
    "json": as_json,
    "sarif": as_sarif,
    "github": as_github,
}
