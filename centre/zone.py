# SPDX-License-Identifier: GPL-3.0-or-later
"""The site's time zone: where its operators' clocks hang."""

from __future__ import annotations

import os
from pathlib import Path
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

from openrtu_tools.centre.errors import CentreError

LOCAL = Path("/etc/localtime")  # a link into the folder of all zones
FOLDER = "zoneinfo/"


def of_machine() -> str:
    """Its name; without one, UTC."""
    name = os.environ.get("TZ", "").lstrip(":") or (str(LOCAL.readlink()) if LOCAL.is_symlink() else "")
    name = name.rpartition(FOLDER)[2]
    return name if _is_known(name) else "UTC"


def read(wanted: str | None) -> str:
    """What the file says, else the machine's. Raises CentreError."""
    if wanted is not None and not _is_known(wanted):
        raise CentreError(f"centre.zone: no zone is named {wanted}: give one as Europe/Belgrade, or UTC")
    return wanted or of_machine()


def _is_known(name: str) -> bool:
    try:
        ZoneInfo(name)
    except (ZoneInfoNotFoundError, ValueError, OSError):  # also a path, or a folder of zones
        return False
    return True
