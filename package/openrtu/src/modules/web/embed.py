#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes the files of the page as C. Of the schema of configurations, the page has what it may change."""

import gzip
import json
import sys
from pathlib import Path
from typing import Any

TYPES = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
    ".json": "application/json",
}
KEYS = "keys.json"
# What the editor calls a place of the file, and the definitions whose keys it has there.
PLACES = {
    "line": ("port", "tcp_connection"),
    "rs485": ("rs485",),
    "device": ("slave",),
    "identification": ("identification",),
    "object": ("object",),
}
CHANGES = "page: changes it"


def values_of(rule: dict[str, Any]) -> str:
    """What a key may hold, in words."""
    if "enum" in rule:
        return ", ".join(map(str, rule["enum"]))
    if "minimum" in rule and "maximum" in rule:
        return f"{rule['minimum']:.6g} … {rule['maximum']:.10g}"
    return {"boolean": "true, false", "string": "text", "array": "[ ]", "object": "{ }"}.get(
        rule.get("type", ""), "{ }" if "$ref" in rule else ""
    )


def keys_of(schema: dict[str, Any]) -> dict[str, dict[str, dict[str, Any]]]:
    """By place and key: what it means, what it may hold, its default."""
    found: dict[str, dict[str, dict[str, Any]]] = {}
    for place, names in PLACES.items():
        rules = {key: rule for name in names for key, rule in schema["$defs"][name]["properties"].items()}
        found[place] = {
            key: {"says": rule["description"], "values": values_of(rule)}
            | ({"default": rule["default"]} if "default" in rule else {})
            for key, rule in rules.items()
            if CHANGES in rule.get("$comment", "")
        }
    return found


def octets_of(path: Path) -> tuple[str, bytes, str]:
    """Its name on the page, what it holds, and how that is packed."""
    if path.suffix != ".json":
        return path.name, path.read_bytes(), ""
    keys = json.dumps(keys_of(json.loads(path.read_text(encoding="utf-8"))), ensure_ascii=False)
    return KEYS, gzip.compress(keys.encode(), mtime=0), "gzip"


def main(out: str, *names: str) -> None:
    parts = ['#include "modules/web/files.h"', "#include <string.h>"]
    rows = []
    for number, path in enumerate(map(Path, names)):
        name, octets, packed = octets_of(path)
        parts.append(
            f"static const unsigned char file_{number}[] = {{{','.join(str(octet) for octet in octets)}}};"
        )
        served = "/" if name == "index.html" else f"/{name}"
        encoding = f'"{packed}"' if packed else "NULL"
        rows.append(
            f'{{"{served}", "{TYPES[path.suffix]}", {encoding}, file_{number}, sizeof(file_{number})}},'
        )
    parts += ["static const struct web_file files[] = {", *rows, "};"]
    parts += [
        "const struct web_file *web_file_find(const char *path) {",
        "for (size_t i = 0; i < sizeof(files) / sizeof(files[0]); i++)",
        "if (strcmp(files[i].path, path) == 0) return &files[i];",
        "return NULL; }",
    ]
    Path(out).write_text("\n".join(parts) + "\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
