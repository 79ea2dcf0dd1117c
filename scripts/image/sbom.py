# SPDX-License-Identifier: GPL-3.0-or-later
"""
sbom.py: is an image's bill of materials valid, and of use? It follows CycloneDX's schema, each reference in
it leads to one component, and the versions are those that vulnerabilities are looked up by. Exit codes: 0 all
well, 1 findings, 2 no bill of materials.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from cyclonedx.schema import SchemaVersion
from cyclonedx.validation.json import JsonStrictValidator

ROOT = Path(__file__).resolve().parents[2]
VERSION = ROOT / "package" / "openrtu" / "src" / "VERSION"
LINUX_CPE = re.compile(r"cpe:2\.3:o:linux:linux_kernel:\d+\.\d+(\.\d+)?:.*")


def findings(text: str, version: str) -> Iterator[str]:
    """What is wrong with a bill in JSON of an image of `version`. Raises ValueError where it is no JSON."""
    bill = json.loads(text)
    try:
        schema = SchemaVersion.from_version(str(bill["specVersion"]))
    except (KeyError, TypeError, ValueError):
        yield 'it has no "specVersion" of CycloneDX that is known here'
        return
    wrong = list(JsonStrictValidator(schema).validate_str(text, all_errors=True) or ())
    yield from (
        f"CycloneDX {schema.to_version()}: {error.data.json_path}: {error.data.message}" for error in wrong
    )
    if not wrong:
        yield from _references(bill)
        yield from _versions(bill, version)


def _references(bill: dict[str, Any]) -> Iterator[str]:
    components = [bill["metadata"]["component"], *bill["components"]]
    known = Counter(component["bom-ref"] for component in components)
    yield from (f'{count} components have the bom-ref "{ref}"' for ref, count in known.items() if count > 1)
    for dependency in bill["dependencies"]:
        for ref in (dependency["ref"], *dependency["dependsOn"]):
            if ref not in known:
                yield f'"{dependency["ref"]}" depends on "{ref}", which is not a component'


def _versions(bill: dict[str, Any], version: str) -> Iterator[str]:
    image = bill["metadata"]["component"]
    if image["version"] != version:
        version_file = VERSION.relative_to(ROOT)
        yield f'the image has the version "{image["version"]}", and {version_file} says {version}'
    for component in bill["components"]:
        if component["bom-ref"] == "linux" and not LINUX_CPE.fullmatch(component.get("cpe", "")):
            yield f'the CPE of Linux names no release, so no CVE fits it: "{component.get("cpe", "")}"'


def main(words: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="sbom", description="Check an image's bill of materials.")
    parser.add_argument("bill", type=Path, help="the file, CycloneDX in JSON")
    bill = parser.parse_args(words).bill
    try:
        found = list(findings(bill.read_text(encoding="utf-8"), VERSION.read_text(encoding="utf-8").strip()))
    except (OSError, ValueError) as error:
        print(f"sbom: {bill}: {error}; make sbom writes it", file=sys.stderr)
        return 2
    for line in found:
        print(f"sbom: {bill}: {line}", file=sys.stderr)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
