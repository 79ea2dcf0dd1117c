# SPDX-License-Identifier: GPL-3.0-or-later
"""Files of the configuration: the report's, the examples; changed at a place, and given to rtud --check."""

import json
import re
import subprocess
from pathlib import Path
from typing import Any

from jsonschema import Draft202012Validator

ROOT = Path(__file__).resolve().parents[2]
REPORT = ROOT / "tests/fixtures/report/figure-4.8-4.9.json"
EXAMPLES = [*sorted((ROOT / "docs/examples").glob("*.json")), ROOT / "tests/fixtures/chapter5/gateway.json"]
EVERY_KEY = ROOT / "docs/examples/every-key.json"
PAGE = ROOT / "docs/configuration.md"
LIMIT_PAGE = ROOT / "docs/limit.md"
SCHEMA = json.loads((ROOT / "package/openrtu/src/rtud/config.schema.json").read_text())
VALIDATOR = Draft202012Validator(SCHEMA, format_checker=Draft202012Validator.FORMAT_CHECKER)
REMOVED = object()
ENDLESS = 3e38  # beyond it a bound is that of a float

Json = dict[str, "Json"] | list["Json"] | str | float | bool | None


def check(programs: Path, path: Path, option: str = "--check") -> subprocess.CompletedProcess[str]:
    command = [programs / "rtud/rtud", option, path]
    return subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=20, check=False)


def check_document(programs: Path, directory: Path, document: Json) -> subprocess.CompletedProcess[str]:
    """What rtud says of a file of one line, without the file's name and the line."""
    path = directory / "gateway.json"
    path.write_text(json.dumps(document))
    result = check(programs, path)
    assert all(line.startswith(f"{path}:1: ") for line in result.stderr.splitlines()), result.stderr
    result.stderr = result.stderr.replace(f"{path}:1: ", "").replace(f" ({path}:1)", "")
    return result


def report_file() -> dict[str, Any]:
    """The report's file: figure 4.8 with the slave of figure 4.9 on port 3."""
    return json.loads(REPORT.read_text())


def edit(document: Json, place: str, value: Json | object) -> None:
    """Sets, appends or removes what is at a place like port[2].slaves[0].id"""
    *path, last = [int(index) if index else key for key, index in re.findall(r"([^.\[\]]+)|\[(\d+)\]", place)]
    target = document
    for step in path:
        target = target[step]
    if value is REMOVED:
        del target[last]
    elif isinstance(target, list) and last == len(target):
        target.append(value)
    else:
        target[last] = value
