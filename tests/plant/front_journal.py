# SPDX-License-Identifier: GPL-3.0-or-later
"""A journal: events are kept while rtud is killed."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from plant_world import JOURNAL, Front, World

INTERVAL_S = 1  # what waited for that long is kept
FLASH_MB = 1 << 20  # as large as a journal with such an interval needs it


@dataclass(frozen=True)
class Journal(Front):
    def configure(self, world: World, config: dict[str, Any], folder: Path) -> None:
        config["journal"] = {
            "path": f"{folder}/journal",
            "interval_s": INTERVAL_S,
            "volume_mb": FLASH_MB,
        }

    @property
    def processes(self) -> tuple[str, ...]:
        return (JOURNAL,)
