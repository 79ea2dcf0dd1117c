#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes the files of the page as C."""

import sys
from pathlib import Path

TYPES = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
}


def main(out: str, *names: str) -> None:
    parts = ['#include "modules/web/files.h"', "#include <string.h>"]
    rows = []
    for number, path in enumerate(map(Path, names)):
        octets = path.read_bytes()
        parts.append(
            f"static const unsigned char file_{number}[] = {{{','.join(str(octet) for octet in octets)}}};"
        )
        served = "/" if path.name == "index.html" else f"/{path.name}"
        rows.append(f'{{"{served}", "{TYPES[path.suffix]}", file_{number}, sizeof(file_{number})}},')
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
