# SPDX-License-Identifier: GPL-3.0-or-later
"""The folder of a board's site: its MAC addresses, its saved environment, its backups."""

from __future__ import annotations

import random
import re
from pathlib import Path

from nuc980.netboot.errors import UnusableInput

MAC = re.compile(r"[0-9a-fA-F]{2}(:[0-9a-fA-F]{2}){5}")


class Site:
    """A folder, made when something is to be kept in it. The same as SITE= of `make image`."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def macs(self) -> tuple[str, str]:
        """The board's own two addresses, from the file `macs`; made up once when there is none."""
        path = self.folder / "macs"
        if not path.exists():
            self.folder.mkdir(parents=True, exist_ok=True)
            with path.open("x") as file:
                file.write("".join(f"eth{port} {_local_address()}\n" for port in (0, 1)))
        lines = dict(line.split(None, 1) for line in path.read_text().splitlines() if line.strip())
        macs = tuple(lines.get(name, "").strip() for name in ("eth0", "eth1"))
        if not all(MAC.fullmatch(mac) for mac in macs):
            raise UnusableInput(f"{path}: wanted two lines, 'eth0 XX:XX:XX:XX:XX:XX' and 'eth1 …'")
        return macs[0], macs[1]


def _local_address() -> str:
    """A random unicast address, locally administered (IEEE 802, 0x02 of the first byte)."""
    first, *rest = random.SystemRandom().randbytes(6)
    return ":".join(f"{byte:02x}" for byte in (first & 0xFC | 0x02, *rest))
