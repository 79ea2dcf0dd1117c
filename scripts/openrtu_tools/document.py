# SPDX-License-Identifier: GPL-3.0-or-later
"""A user's JSON files, and whether they are what a tool takes them for."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from nuc980.errors import UnusableInput

Json = dict[str, Any]


def read(path: Path) -> Json:
    """A file's JSON object."""
    try:
        document = json.loads(path.read_text(encoding="utf-8-sig"))
    except UnicodeDecodeError as error:
        raise UnusableInput(f"{path}: this is not UTF-8 text") from error
    except RecursionError as error:
        raise UnusableInput(f"{path}: is nested too deep") from error
    except json.JSONDecodeError as error:
        raise UnusableInput(f"{path}:{error.lineno}: {error.msg}") from error
    if not isinstance(document, dict):
        raise UnusableInput(f"{path}: is not a JSON object")
    return document


def objects(holder: Json, key: str, where: str) -> list[Json]:
    """An array of objects, which may be missing. Where: what comes before the key in a message."""
    found = holder.get(key, [])
    if not isinstance(found, list) or not all(isinstance(one, dict) for one in found):
        raise UnusableInput(f"{where}{key}: is not an array of objects")
    return found


def text(holder: Json, key: str, where: str) -> str:
    """A text that has to be there."""
    found = holder.get(key)
    if not isinstance(found, str):
        raise UnusableInput(f"{where}{key}: is missing, or is no text")
    return found
