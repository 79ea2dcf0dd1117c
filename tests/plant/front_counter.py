# SPDX-License-Identifier: GPL-3.0-or-later
"""A counter that the gateway freezes, and that stands still: each freeze is an event that changes nothing."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from plant_world import Front, World

ADDRESS, FREEZE_S = 10, 2
OBJECT = 30001 + ADDRESS


@dataclass(frozen=True)
class Counter(Front):
    """Of the first device of the first line, whatever configuration is in force."""

    def configure(self, world: World, config: dict[str, Any], folder: Path) -> None:
        registers = config["port"][0]["slaves"][0]["input_registers"]
        registers.append({"address": ADDRESS, "type": "counter", "freeze_s": FREEZE_S})

    @property
    def points(self) -> tuple[str, ...]:
        return (f"1001.{OBJECT}",)

    @property
    def counters(self) -> tuple[str, ...]:
        return self.points
