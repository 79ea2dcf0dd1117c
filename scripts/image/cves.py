# SPDX-License-Identifier: GPL-3.0-or-later
"""
cves.py: the vulnerabilities that are known of an image. Buildroot's own cve-check looks the components of its
bill of materials up in the CVEs of the NVD; this shows what it found, the open ones first. Exit codes: 0 none
is open, 1 some are, 2 no report.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any

from nuc980.errors import UnusableInput

OPEN = "open"
# CycloneDX's words, as Buildroot uses them: what its packages ignore, and what a patch says that it mends.
STATES = {"exploitable": OPEN, "in_triage": "ignored by Buildroot", "resolved_with_pedigree": "patched"}
NONE_OPEN, SOME_OPEN = 0, 1


@dataclass(frozen=True)
class Row:
    component: str
    version: str
    cve: str
    severity: str
    score: float
    state: str


TITLES = ("component", "version", "CVE", "severity", "score", "state")


# ---- the NVD -------------------------------------------------------------------------------------


def fetch(buildroot: Path, nvd: Path) -> None:
    """From where cve-check would fetch it, which takes its whole history, and says nothing of it."""
    mirror = nvd / "git"
    if (mirror / ".git").is_dir():
        words = [*of_repository(mirror), "pull", "--quiet", "--ff-only"]
        next_step = f"make cves NVD={nvd} takes those that are there; without {mirror} all are fetched again"
    else:
        words = ["clone", "--depth=1", address(buildroot), str(mirror)]
        next_step = "make cves NVD=folder takes those of a folder; docs/security.md says how to make one"
    if subprocess.run(["git", *words]).returncode:
        raise UnusableInput(
            f"the CVEs of the NVD cannot be fetched into {mirror}; git says why above", next_step=next_step
        )


def of_repository(mirror: Path) -> list[str]:
    """Never of the one around it."""
    return [f"--git-dir={mirror / '.git'}", f"--work-tree={mirror}"]


def address(buildroot: Path) -> str:
    code = buildroot / "support/scripts/cve.py"
    found = re.search(r'^NVD_BASE_URL = "(\S+)"$', read(code), re.MULTILINE)
    if found is None:
        raise UnusableInput(f"{code} names no NVD_BASE_URL", next_step="make cves NVD=folder")
    return found[1]


def day(nvd: Path) -> str:
    """Of its newest commit."""
    mirror = nvd / "git"
    log = ["git", *of_repository(mirror), "log", "-1", "--format=%cs"]
    return subprocess.run(log, capture_output=True, text=True).stdout.strip() or "an unknown day"


# ---- the report ----------------------------------------------------------------------------------


def look_up(buildroot: Path, bill: Path, nvd: Path) -> dict[str, Any]:
    """The bill with what cve-check adds to it."""
    if not any((nvd / "git").glob("CVE-*/*/*.json")):
        raise UnusableInput(
            f"{nvd} has no CVEs of the NVD, such as git/CVE-2026/CVE-2026-00xx/CVE-2026-0001.json",
            next_step=f"git clone --depth=1 {address(buildroot)} {nvd}/git",
        )
    tool = buildroot / "support/scripts/cve-check"
    words = ["--in-file", str(bill), "--nvd-path", str(nvd), "--no-nvd-update"]
    try:
        done = subprocess.run([tool, *words], capture_output=True, text=True)
    except OSError as error:
        raise UnusableInput(
            f"{tool}: {error.strerror}", next_step="name a checkout of Buildroot that has it"
        ) from error
    if done.returncode:
        raise UnusableInput(f"{tool} failed: {(done.stderr.splitlines() or ['it says nothing'])[-1]}")
    return json.loads(done.stdout)


def rows(bill: Mapping[str, Any]) -> Iterator[Row]:
    """Each CVE of each component of the image."""
    components = {each["bom-ref"]: each for each in of_image(bill)}
    for cve in bill["vulnerabilities"]:
        score, severity = worst(cve.get("ratings", ()))
        state = cve["analysis"]["state"]
        for ref in (each["ref"] for each in cve["affects"]):
            if ref in components:
                version = version_of(components[ref])
                yield Row(ref, version, cve["id"], severity, score, STATES.get(state, state))


def of_image(bill: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
    """Without the tools that built it."""
    host = {"name": "BR_TYPE", "value": "host"}
    return (each for each in bill["components"] if host not in each.get("properties", ()))


def version_of(component: Mapping[str, Any]) -> str:
    """That it is looked up by: of Linux it may have a commit, and in its CPE the release."""
    return component["cpe"].split(":")[5] if "cpe" in component else component.get("version", "")


def worst(ratings: Sequence[Mapping[str, Any]]) -> tuple[float, str]:
    """
    The highest of CVSS; its version 2 has no word for it.

    >>> worst([{"method": "CVSSv2", "score": 7.2}, {"score": 7.8, "severity": "high"}])
    (7.8, 'high')
    >>> worst([])
    (0.0, '-')
    """
    scores = [(each["score"], each.get("severity", "-")) for each in ratings if "score" in each]
    return max(scores, default=(0.0, "-"))


def table(found: Sequence[Row]) -> Iterator[str]:
    ordered = sorted(found, key=lambda row: (row.state != OPEN, -row.score, row.component, row.cve))
    cells = [TITLES, *([str(cell or "-") for cell in astuple(row)] for row in ordered)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    for line in cells:
        yield "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip()


def summary(bill: Mapping[str, Any], found: Sequence[Row], date: str) -> Iterator[str]:
    opened = Counter(row.component for row in found if row.state == OPEN)
    of_each = f": {', '.join(f'{name} {count}' for name, count in opened.most_common())}" if opened else ""
    yield f"{opened.total()} open, by the NVD of {date}{of_each}"
    unknown = [each["bom-ref"] for each in of_image(bill) if not (each.get("cpe") and each.get("version"))]
    if unknown:
        yield f"not looked up, for want of a CPE or a version: {', '.join(unknown)}"


def read(file: Path) -> str:
    try:
        return file.read_text(encoding="utf-8")
    except OSError as error:
        raise UnusableInput(
            f"{file}: {error.strerror}", next_step="name a checkout of Buildroot that has it"
        ) from error


def run(arguments: argparse.Namespace) -> int:
    if arguments.fetch:
        fetch(arguments.buildroot, arguments.nvd)
    bill = look_up(arguments.buildroot, arguments.bill, arguments.nvd)
    arguments.bill.with_name("cves.cdx.json").write_text(json.dumps(bill, indent=2) + "\n", encoding="utf-8")
    found = list(rows(bill))
    for line in (*table(found), "", *summary(bill, found, day(arguments.nvd))):
        print(line)
    return SOME_OPEN if any(row.state == OPEN for row in found) else NONE_OPEN


def main(words: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="cves", description="Show the known vulnerabilities of an image.")
    parser.add_argument("buildroot", type=Path, help="Buildroot's checkout")
    parser.add_argument("bill", type=Path, help="the image's bill of materials; make sbom writes it")
    parser.add_argument("nvd", type=Path, help="a folder with the CVEs of the NVD in its folder git")
    parser.add_argument("--fetch", action="store_true", help="fetch them, or those that came since")
    try:
        return run(parser.parse_args(words))
    except UnusableInput as error:
        print(f"cves: {error}", file=sys.stderr)
        return error.exit_code


if __name__ == "__main__":
    sys.exit(main())
