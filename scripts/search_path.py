# SPDX-License-Identifier: GPL-3.0-or-later
"""Where Debian puts programs: the PATH of its users lacks the folders of those that are mostly for root."""

from __future__ import annotations

import os

# snmptrapd, ubinize, mkfs.ubifs, sysctl and others, which any user may run.
FOR_ROOT = ("/usr/local/sbin", "/usr/sbin", "/sbin")


def complete(path: str) -> str:
    """A PATH with these folders at its end, where it lacks them."""
    folders = [folder for folder in path.split(os.pathsep) if folder]
    return os.pathsep.join([*folders, *(folder for folder in FOR_ROOT if folder not in folders)])


def complete_own() -> None:
    """Lets this process, and all that it starts, find the programs that Debian's packages bring."""
    os.environ["PATH"] = complete(os.environ.get("PATH", os.defpath))
