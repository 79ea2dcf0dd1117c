# SPDX-License-Identifier: GPL-3.0-or-later
"""A process that takes over the lines of another, in the plant (docs/plant.md), as found by seed 2009."""

from pathlib import Path

from plant_history import History
from plant_judge import judge
from plant_run import story
from plant_seeds import FAR_LINES
from plant_trials import run_world
from plant_world import Fault, World

SILENT_S, RELOADED_S, INVALID_WITHIN_S = 20.75, 20.8, 5.0
SILENT = ("1.2", "7.2")


def test_who_falls_silent_as_a_configuration_is_loaded_is_told_invalid(
    programs: Path, linesim_program: Path, folder: Path
) -> None:
    silences = tuple(Fault(SILENT_S, "silent", device, for_s=8.0) for device in SILENT)
    faults = (*silences, Fault(RELOADED_S, "reload", "5"))
    ran = run_world(World(1, 60.0, (), faults, lines=FAR_LINES), folder / "silent")
    violations = judge(ran)
    assert not violations, story(ran, violations)
    for device in SILENT:
        line, unit = map(int, device.split("."))
        events = History(ran).events[f"{line * 1000 + unit}.30001"]
        tags = [event.tag_s or 0.0 for event in events if not event.good]
        assert any(SILENT_S < tag_s < RELOADED_S + INVALID_WITHIN_S for tag_s in tags), story(ran, [])
