# SPDX-License-Identifier: GPL-3.0-or-later
"""
sbom.py: completes an image's bill of materials, and says what is wrong with it. Buildroot writes it without
what the toolchain brings into the image, and without who, when and which. Then: it follows CycloneDX's
schema, each reference in it leads to one component, and the versions are those that vulnerabilities are
looked up by. Exit codes: 0 all well, 1 findings, 2 no bill of materials.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import re
import sys
import uuid
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from cyclonedx.schema import SchemaVersion
from cyclonedx.validation.json import JsonStrictValidator

ROOT = Path(__file__).resolve().parents[2]
VERSION = ROOT / "package" / "openrtu" / "src" / "VERSION"
LINUX_CPE = re.compile(r"cpe:2\.3:o:linux:linux_kernel:\d+\.\d+(\.\d+)?:.*")


AUTHOR = {"name": "OpenRTU"}
# An image that has one has a root file system, and in it the C library.
ROOT_HAS = "busybox"
C_LIBRARY = "lib/libc.so.6"
GCC_LIBRARY = "lib/libgcc_s.so.1"
GLIBC = re.compile(rb"GNU C Library \([^)]*\)(?: stable)? release version (\d+(?:\.\d+)+)")
GCC = re.compile(rb"Compiled by GNU CC version (\d+(?:\.\d+)+)")
SOURCE_SUM = re.compile(r"^sha256\s+([0-9a-f]{64})\s+(\S+)$", re.MULTILINE)


# ---- what Buildroot leaves out


def complete(
    bill: dict[str, Any], packages: Mapping[str, Any], buildroot: Path, target: Path, now: datetime
) -> None:
    """
    Adds serial number, time, author, the hashes of the packages' sources, the libraries of the toolchain.
    packages: of show-info; target: the root file system, as a folder.
    """
    metadata = bill["metadata"]
    metadata["timestamp"] = now.isoformat(timespec="seconds")
    metadata["authors"] = [AUTHOR]
    for component in bill["components"]:
        if sums := [*_sums(packages.get(component["bom-ref"], {}), buildroot)]:
            component["hashes"] = [{"alg": "SHA-256", "content": content} for content in sums]
    _add_toolchain(bill, target)
    content = json.dumps(bill, sort_keys=True)
    bill["serialNumber"] = f"urn:uuid:{uuid.uuid5(uuid.NAMESPACE_OID, content)}"


def _sums(package: Mapping[str, Any], buildroot: Path) -> Iterator[str]:
    """Of the archives that a package is built from."""
    archives = {download.get("source") for download in package.get("downloads", ())}
    for name in package.get("hashes", ()):
        file = buildroot / name
        for content, archive in SOURCE_SUM.findall(file.read_text() if file.exists() else ""):
            if archive in archives:
                yield content


def _add_toolchain(bill: dict[str, Any], target: Path) -> None:
    known = {component.get("name") for component in bill["components"]}
    new = [each for each in _toolchain(target) if each["name"] not in known]
    bill["components"] += new
    bill["dependencies"] += [{"ref": each["bom-ref"], "dependsOn": []} for each in new]
    image = bill["metadata"]["component"]["bom-ref"]
    for dependency in bill["dependencies"]:
        if dependency["ref"] == image:
            dependency["dependsOn"] = sorted({*dependency["dependsOn"], *(each["bom-ref"] for each in new)})


def _toolchain(target: Path) -> Iterator[dict[str, Any]]:
    """The C library says its release, and that of the compiler, which libgcc is a part of."""
    library = target / C_LIBRARY
    if not library.exists():
        return
    content = library.read_bytes()
    for name, product, release, file, licence in (
        ("glibc", "glibc", GLIBC.search(content), library, {"license": {"id": "LGPL-2.1-or-later"}}),
        (
            "libgcc",
            "gcc",
            GCC.search(content),
            target / GCC_LIBRARY,
            {"expression": "GPL-3.0-or-later WITH GCC-exception-3.1"},
        ),
    ):
        if release and file.exists():
            version = release[1].decode()
            yield {
                "bom-ref": name,
                "type": "library",
                "name": name,
                "version": version,
                "licenses": [licence],
                "cpe": f"cpe:2.3:a:gnu:{product}:{version}:*:*:*:*:*:*:*",
                "hashes": [{"alg": "SHA-256", "content": hashlib.sha256(file.read_bytes()).hexdigest()}],
                "properties": [{"name": "BR_TYPE", "value": "target"}],
            }


# ---- what is wrong with it


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
        yield from _minimum(bill)


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


def _minimum(bill: dict[str, Any]) -> Iterator[str]:
    """The NTIA's minimum elements that a whole bill has, and the toolchain's part of the image."""
    if "serialNumber" not in bill:
        yield "it has no serial number"
    yield from (f"it has no {what}" for what in ("timestamp", "authors") if not bill["metadata"].get(what))
    names = {component.get("name"): component for component in bill["components"]}
    for name in ("glibc", "libgcc"):
        if ROOT_HAS in names and not (names.get(name, {}).get("version") and names[name].get("cpe")):
            yield f"{name} of the toolchain is not in it, so no CVE of it is looked up: build the image first"


def main(words: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        prog="sbom", description="Complete and check an image's bill of materials."
    )
    parser.add_argument("bill", type=Path, help="the file, CycloneDX in JSON")
    parser.add_argument("--packages", type=Path, metavar="FILE", help="complete it, by Buildroot's show-info")
    parser.add_argument("--buildroot", type=Path, default=Path(), metavar="DIR", help="its checkout")
    parser.add_argument("--target", type=Path, default=Path(), metavar="DIR", help="the root file system")
    given = parser.parse_args(words)
    bill = given.bill
    try:
        if given.packages:
            made = json.loads(bill.read_text(encoding="utf-8"))
            packages = json.loads(given.packages.read_text(encoding="utf-8"))
            complete(made, packages, given.buildroot, given.target, datetime.now(UTC))
            bill.write_text(json.dumps(made, indent=2) + "\n", encoding="utf-8")
        found = list(findings(bill.read_text(encoding="utf-8"), VERSION.read_text(encoding="utf-8").strip()))
    except (OSError, ValueError, KeyError, TypeError) as error:
        print(f"sbom: {bill}: {error}; make sbom writes it", file=sys.stderr)
        return 2
    for line in found:
        print(f"sbom: {bill}: {line}", file=sys.stderr)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
