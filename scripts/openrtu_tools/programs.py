# SPDX-License-Identifier: GPL-3.0-or-later
"""The programs of the gateway that a tool starts."""

from __future__ import annotations

import os
import shlex
import shutil
from pathlib import Path

from nuc980.errors import UnusableInput
from openrtu_tools.missing import CLONE, in_clone

# Of `make install` and of the Debian packages. PATH lacks the folders of what is mostly for root.
INSTALLED = [
    Path(prefix) / folder
    for prefix in ("/usr/local", "/usr")
    for folder in ("libexec/openrtu", "bin", "sbin")
]


def command(name: str, room: str) -> list[str]:
    """What starts a program: of the clone's build, on PATH, or where the gateway is installed.

    OPENRTU_ and its name in capitals names another one, or the words that run it: `qemu-arm -L … logic-desk`.
    """
    variable = f"OPENRTU_{name.upper().replace('-', '_')}"
    if other := os.environ.get(variable):
        return [other] if Path(other).is_file() else shlex.split(other)
    folders = [CLONE / "build/native" / room, os.environ.get("PATH", os.defpath), *INSTALLED]
    found = shutil.which(name, path=os.pathsep.join(map(str, folders)))
    if found:
        return [found]
    remedy = "type `make build`" if in_clone() else "install the gateway (docs/install.md)"
    raise UnusableInput(f"{name}, a program of the gateway, is missing: {remedy}, or set {variable}")
