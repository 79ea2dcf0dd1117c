# SPDX-License-Identifier: GPL-3.0-or-later
"""The settings of the site of `make run`: chapter 5's points, who may log in, the board's MAC addresses.

python -m lab.site FOLDER: FOLDER/lab for `make image-debian SITE=`; FOLDER/key opens that board.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

from lab.board import configuration, macs_file


def write_site(folder: Path) -> None:
    """Writes what has changed, so that what is built of it is built again only then."""
    key, site = folder / "key", folder / "lab"
    site.mkdir(parents=True, exist_ok=True)
    if not key.exists():
        subprocess.run(
            ["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-C", "make run", "-f", key], check=True
        )
    for name, text in {
        "config.json": json.dumps(configuration(), indent=2) + "\n",
        "authorized_keys": key.with_suffix(".pub").read_text(),
        "macs": macs_file(),
    }.items():
        file = site / name
        if not file.exists() or file.read_text() != text:
            file.write_text(text)


if __name__ == "__main__":
    write_site(Path(sys.argv[1]))
