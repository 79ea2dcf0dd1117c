# SPDX-License-Identifier: GPL-3.0-or-later
"""nuc980-pins and nuc980-netboot, as pip installs them."""

import sys

from openrtu_tools.missing import what_to_type

EXTRA = "nuc980"


def pins() -> int:
    try:
        from nuc980.pins.__main__ import program
    except ModuleNotFoundError as error:
        return _missing("nuc980-pins", error)
    return program()


def netboot() -> int:
    try:
        from nuc980.netboot.cli import main
    except ModuleNotFoundError as error:
        return _missing("nuc980-netboot", error)
    return main()


def _missing(program: str, error: ModuleNotFoundError) -> int:
    print(f"{program}: {what_to_type(error, EXTRA)}", file=sys.stderr)
    return 2
