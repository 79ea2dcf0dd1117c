# SPDX-License-Identifier: GPL-3.0-or-later
"""
python3 -m image.bill MANIFEST OUT [SOURCE...]: the bill of materials of an image from Debian's packages, in
CycloneDX, from its manifest, dated SOURCE_DATE_EPOCH. SOURCE names what was compiled from Debian's sources;
the rest are its packages for armel. Buildroot writes that of its own images (sbom.py). Exit codes: 0 done,
2 no manifest.
"""

from __future__ import annotations

import json
import os
import sys
import uuid
from collections.abc import Collection, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from urllib.parse import quote

RELEASE = "debian-12"


def component(name: str, version: str, architecture: str) -> dict[str, Any]:
    """By its package URL, which the lists of Debian's security team and OSV know."""
    purl = f"pkg:deb/debian/{name}@{quote(version, safe='')}?arch={architecture}&distro={RELEASE}"
    return {
        "type": "library",
        "bom-ref": purl,
        "name": name,
        "version": version,
        "purl": purl,
        "supplier": {"name": "Debian"},
    }


def bill_of(manifest: Mapping[str, Any], sources: Collection[str], now: datetime) -> dict[str, Any]:
    """All that the image has files of; what it is made for depends on each."""
    sources_of_image = manifest["sources"]
    own = sources_of_image["openrtu"]
    image = {
        "type": "firmware",
        "bom-ref": "image",
        "name": manifest["configuration"],
        "version": manifest["version"] or own["version"],
    }
    gateway = {
        "type": "application",
        "bom-ref": "openrtu",
        "name": "openrtu",
        "version": own["version"],
        "supplier": {"name": "OpenRTU"},
        "licenses": [{"license": {"id": "GPL-3.0-or-later"}}],
    }
    taken = [
        component(name, version, "source" if name in sources else "armel")
        for name, version in sorted(sources_of_image["debian"].items())
    ]
    components = [gateway, *taken]
    bill: dict[str, Any] = {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {
            "timestamp": now.isoformat(timespec="seconds"),
            "authors": [{"name": "OpenRTU"}],
            "component": image,
        },
        "components": components,
        "dependencies": [
            {"ref": "image", "dependsOn": [each["bom-ref"] for each in components]},
            *({"ref": each["bom-ref"], "dependsOn": []} for each in components),
        ],
    }
    content = json.dumps(bill, sort_keys=True)
    return bill | {"serialNumber": f"urn:uuid:{uuid.uuid5(uuid.NAMESPACE_OID, content)}"}


def main(words: list[str]) -> int:
    manifest, out, *sources = words
    try:
        read = json.loads(Path(manifest).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        print(f"bill: {manifest}: {error}; make image-debian writes it", file=sys.stderr)
        return 2
    made = datetime.fromtimestamp(int(os.environ["SOURCE_DATE_EPOCH"]), UTC)
    Path(out).write_text(json.dumps(bill_of(read, sources, made), indent=2) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
