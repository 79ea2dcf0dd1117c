# SPDX-License-Identifier: GPL-3.0-or-later
"""
gateway.py SITE ROOT: the programs of modules that a site's configuration needs and a root file system lacks,
one a line. Exit codes: 0 none, 1 some, 2 unusable input.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from nuc980.errors import UnusableInput

MODULES = Path("usr/libexec/openrtu")
# The key of a configuration that a program runs for; docs/architecture.md has the programs.
FOR_KEY = {
    "port": "rtu-modbus",
    "modbus": "rtu-modbus",
    "iec104": "rtu-iec104",
    "outstations": "rtu-104m",
    "gps": "rtu-gps",
    "goose": "rtu-goose",
    "snmp": "rtu-snmp",
    "iec61850": "rtu-iec61850",
    "web": "rtu-web",
    "logic": "rtu-logic",
    "journal": "rtu-journal",
    "net": "rtu-synch",
    "synch": "rtu-synch",
}
TLS = "-tls"


def read_configuration(site: Path) -> dict[str, Any]:
    """A site's config.json; empty without one. What else is wrong with it rtud says. Raises UnusableInput."""
    file = site / "config.json"
    if not file.exists():
        return {}
    try:
        configuration = json.loads(file.read_bytes())
    except ValueError as error:
        raise UnusableInput(f"{file} is not JSON: {error}") from error
    return configuration if isinstance(configuration, dict) else {}


def needed(configuration: dict[str, Any]) -> set[str]:
    """The programs that rtud starts for it."""
    server = configuration.get("iec61850")
    on_tls = {
        "iec104": "tls" in configuration,
        "outstations": "outstations_tls" in configuration,
        "iec61850": isinstance(server, dict) and "tls" in server,
    }
    return {
        program + (TLS if on_tls.get(key) else "")
        for key, program in FOR_KEY.items()
        if configuration.get(key) not in (None, [], False) and (key != "port" or _polls(configuration[key]))
    }


def _polls(ports: Any) -> bool:
    return any(not isinstance(port, dict) or port.get("active", True) for port in ports)


def programs_of(root: Path) -> Iterator[str]:
    """Those of modules that a root file system has."""
    return (file.name for file in sorted((root / MODULES).glob("rtu-*")))


def main(words: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="gateway", description="Say what an image's gateway cannot do.")
    parser.add_argument("site", type=Path, help="the folder with its settings")
    parser.add_argument("root", type=Path, help="the root file system, as a folder")
    given = parser.parse_args(words)
    try:
        lacks = sorted(needed(read_configuration(given.site)) - {*programs_of(given.root)})
    except (UnusableInput, OSError) as error:
        print(f"gateway: {error}", file=sys.stderr)
        return 2
    print(*lacks, sep="\n", end="\n" if lacks else "")
    return 1 if lacks else 0


if __name__ == "__main__":
    sys.exit(main())
