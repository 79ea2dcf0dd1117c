# SPDX-License-Identifier: GPL-3.0-or-later
"""What `make coverage` says of a room that its tests reach less of than they are to."""

import tomllib

import pytest

from covered import FLOORS, ROOT, SOURCE, Count, room_of_c, room_of_python, table, verdict

ROOM = Count(lines=80, all_lines=100, branches=30, all_branches=60)


@pytest.mark.parametrize(
    ("floors", "said"),
    [
        ({"map": [80, 50]}, []),
        ({"map": [81, 50]}, ["map: the tests reach 80.0 % of its lines, and are to reach 81 %"]),
        ({"map": [80, 51]}, ["map: the tests reach 50.0 % of its branches, and are to reach 51 %"]),
        ({}, ["map has no floor: write '\"map\" = [80, 50]' into coverage.toml"]),
        (
            {"map": [80, 50], "wheel": [1, 1]},
            ["wheel is no room any more: take its floor out of coverage.toml"],
        ),
    ],
)
def test_what_is_wrong_is_said_of_its_room(floors: dict[str, list[int]], said: list[str]) -> None:
    assert list(verdict({"map": ROOM}, floors)) == said


def test_all_of_it_is_the_last_line() -> None:
    last = list(table({"map": ROOM, "ber": Count(20, 100, 0, 0)}))[-1]
    assert last.split() == ["all", "50.0%", "200", "50.0%", "60"]


def test_a_room_without_branches_has_reached_them() -> None:
    assert Count(lines=1, all_lines=2).percent == (50.0, 100.0)


@pytest.mark.parametrize(
    ("room", "file"),
    [
        (room_of_c("map/bell.c"), "map"),
        (room_of_c("modules/gps/main.c"), "modules/gps"),
        (room_of_python("centre/a.py"), "centre"),
        (room_of_python("scripts/image/a.py"), "scripts/image"),
        (room_of_python("scripts/nuc980/pins/rules/a.py"), "scripts/nuc980/pins"),
        (room_of_python("scripts/openrtu_tools/a.py"), "scripts/openrtu_tools"),
        (room_of_python("scripts/openrtu_tools/logic/a.py"), "scripts/openrtu_tools/logic"),
    ],
)
def test_a_files_room_is_its_folder(room: str, file: str) -> None:
    assert room == file


def test_each_floor_is_of_a_folder_and_can_be_reached() -> None:
    for room, floor in tomllib.loads(FLOORS.read_text()).items():
        assert (SOURCE / room).is_dir() or (ROOT / room).is_dir(), room
        assert all(0 <= percent <= 100 for percent in floor), room
