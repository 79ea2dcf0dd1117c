# SPDX-License-Identifier: GPL-3.0-or-later
"""The commands that pip installs beside openrtu. What each imports, an extra brings."""

import sys
from importlib import import_module

from openrtu_tools.missing import what_to_type


def pins() -> int:
    return _program("nuc980-pins", "nuc980.pins.__main__", "program", "nuc980")


def netboot() -> int:
    return _program("nuc980-netboot", "nuc980.netboot.cli", "main", "nuc980")


def station() -> int:
    """rtud starts it, as a module of the gateway that a higher centre polls."""
    return _program("openrtu-centre-station", "openrtu_tools.centre.station", "main", "centre")


def _program(name: str, module: str, function: str, extra: str) -> int:
    try:
        program = getattr(import_module(module), function)
    except ModuleNotFoundError as error:
        print(f"{name}: {what_to_type(error, extra)}", file=sys.stderr)
        return 2
    return program()
