# SPDX-License-Identifier: GPL-3.0-or-later
"""U-Boot's environment: read from the board so that line noise is noticed, kept in a file, put back."""

from __future__ import annotations

import re

from nuc980.netboot.console import TRIES, Console
from nuc980.netboot.errors import LineUnsafe

VARIABLE = re.compile(r"^([!-<>-~]+)=(.*)$")


def read_environment(console: Console) -> dict[str, str]:
    """The variables in RAM. Read until two readings agree. Raises LineUnsafe when none do."""
    readings: list[dict[str, str]] = []
    for _ in range(TRIES + 1):
        readings.append(parse(console.run("printenv").required()))
        if readings[-1] in readings[:-1]:
            return readings[-1]
    raise LineUnsafe("Each reading of the environment is another.")


def parse(printed: str) -> dict[str, str]:
    """The variables in what printenv or a saved file says."""
    return dict(found.groups() for line in printed.splitlines() if (found := VARIABLE.match(line)))
