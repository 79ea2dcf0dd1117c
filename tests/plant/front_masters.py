# SPDX-License-Identifier: GPL-3.0-or-later
"""A second controlling station at rtu-iec104: it is told everything, by the rules of the first."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from plant_history import History, Master, Violation
from plant_judge import judge_master
from plant_world import Front, Programs, World, part

PROCESS, CONSUMER, ADDRESS = "rtu-centre-2", "consumer-2", "127.0.0.2"
SECOND = Master(PROCESS, CONSUMER)


@dataclass(frozen=True)
class SecondMaster(Front):
    """At an address of its own; with groups, each of the two has a queue from the gateway's start on."""

    groups: bool = False

    def configure(self, world: World, config: dict[str, Any], folder: Path) -> None:
        if self.groups:
            config["redundancy_groups"] = [
                {"name": "first", "masters": ["127.0.0.1"]},
                {"name": "second", "masters": [ADDRESS]},
            ]

    def lay_out(self, world: World, folder: Path, gateway: Path) -> None:
        """The name of its program is what faults are called by."""
        (folder / PROCESS).symlink_to(gateway / "centre" / "rtu-centre")
        (folder / "centre-2.json").write_text(json.dumps(world.centre))

    def programs(self, world: World, folder: Path, gateway: Path) -> Programs:
        socket = f"{folder}/{CONSUMER}"
        centre = [f"{folder}/{PROCESS}", "--socket", socket, f"{folder}/centre-2.json"]
        return {
            "centre-2": (1.2, part("keep", *centre)),
            CONSUMER: (1.5, part("consume", socket, f"{folder}/no-orders")),
        }

    @property
    def processes(self) -> tuple[str, ...]:
        return (PROCESS,)

    @property
    def hosts(self) -> dict[str, str]:
        return {PROCESS: ADDRESS}

    def judge(self, history: History) -> Iterator[Violation]:
        for violation in judge_master(History(history.run, SECOND)):
            yield dataclasses.replace(violation, text=f"the second master: {violation.text}")
