# SPDX-License-Identifier: GPL-3.0-or-later
"""Programs on the library of the package pyiec61850-ng, which has no headers, made when they are needed."""

from __future__ import annotations

import importlib.util
import os
import subprocess
from functools import cache
from pathlib import Path

from plant_world import BUILD, PlantError


def library() -> Path:
    """Raises PlantError."""
    package = importlib.util.find_spec("pyiec61850")
    if package is None or not package.submodule_search_locations:
        raise PlantError("the package pyiec61850-ng is not installed; type make setup")
    return Path(package.submodule_search_locations[0]) / "libiec61850.so"


@cache
def program(name: str) -> Path:
    """Of the source of this name; made anew when that or the library is another. Raises PlantError."""
    made, made_of = BUILD / name, (Path(__file__).with_name(f"{name}.c"), library())
    newest = max(path.stat().st_mtime for path in (*made_of, Path(__file__).with_name("libiec61850.h")))
    if made.exists() and made.stat().st_mtime > newest:
        return made
    fresh = made.with_suffix(f".{os.getpid()}")
    command = ["cc", "-O2", f"-Wl,-rpath,{library().parent}", "-o", fresh, *made_of]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    if result.returncode != 0:
        raise PlantError(result.stderr)
    return fresh.rename(made)
