# SPDX-License-Identifier: GPL-3.0-or-later
"""Strangers who connect to the gateway and go: the centre notices nothing of them, the log does not fill."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from plant_world import PORT, Front, Programs, World, part

ADDRESS = "127.0.0.9"


LINES = 290  # docs/telecontrol.md: four a second about peers, and forty at once


@dataclass(frozen=True)
class Strangers(Front):
    @property
    def lines(self) -> dict[str, int]:
        return {"rtu-iec104": LINES}

    def programs(self, world: World, folder: Path, gateway: Path) -> Programs:
        return {"strangers": (3.0, part("strangers", f"{PORT}", f"{world.seed}"))}

    @property
    def hosts(self) -> dict[str, str]:
        return {"strangers": ADDRESS}
