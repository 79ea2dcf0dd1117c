# SPDX-License-Identifier: GPL-3.0-or-later
"""Positions of type 201 in the queues of redundancy groups, and in the journal over a power cut."""

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from test_gps import CA, DEPOT, METRE, Drive, config
from test_position_object import POSITION, is_near

from lab.gateway import Gateway, remove, run_directory
from lab.receiver import Receiver
from rig.power import cut_power, wait_journal
from rig.substation import Link, empty

pytestmark = pytest.mark.slow

MAIN, SPARE, OTHER = "127.0.0.21", "127.0.0.22", "127.0.0.31"
GROUPS = [{"name": "centre", "masters": [MAIN, SPARE]}, {"name": "dispatch", "masters": [OTHER]}]
PLACES = [(DEPOT[0] + 60 * times * METRE, DEPOT[1] - 60 * times * METRE) for times in range(1, 4)]
HEAD = 15  # octets of the APDU before the element


def settings(journal: Path | None) -> dict[str, Any]:
    wanted = config({"device": "gps1", "position_ioa": POSITION, "topical_s": 300}) | {
        "redundancy_groups": GROUPS
    }
    if journal:
        wanted["journal"] = {"path": str(journal), "interval_s": 1, "volume_mb": 1048576}
    return wanted


def waiting(gateway: Gateway) -> list[int]:
    return [row["waiting"] for row in gateway.query("iec104", "queues")]


@pytest.fixture
def started(programs: Path) -> Iterator[Any]:
    with ExitStack() as ends:

        def start(with_journal: bool) -> Drive:
            directory, folder = run_directory(), run_directory()
            ends.callback(remove, directory)
            ends.callback(remove, folder)
            (directory / "dev").mkdir()
            receiver = ends.enter_context(Receiver(directory / "dev/gps1"))
            wanted = settings(folder / "journal" if with_journal else None)
            gateway = ends.enter_context(Gateway(wanted, directory, programs))
            drive = Drive(gateway, receiver)
            gateway.wait_for(lambda: drive.row()["open"], 30.0, "the receiver's line is open")
            drive.say(DEPOT)
            gateway.wait_for(lambda: all(waiting(gateway)), 30.0, "the first place waits in each queue")
            return drive

        yield start


def positions(link: Link) -> list[bytes]:
    """The elements of type 201 among the events that wait, at most k frames; nothing is acknowledged."""
    frames = [frame for frame in link.until_quiet() if frame[6] == 201]
    for frame in frames:
        assert len(frame) == 35 and frame[7:9] == b"\x01\x03"
        assert frame[10:HEAD] == CA.to_bytes(2, "little") + POSITION.to_bytes(3, "little")
    return [frame[HEAD:] for frame in frames]


def place(element: bytes) -> tuple[int, int]:
    latitude, longitude = (int.from_bytes(element[at : at + 4], "little", signed=True) for at in (0, 4))
    return latitude, longitude


def drive_on(drive: Drive) -> None:
    for where in PLACES:
        drive.say(where)


def assert_the_places(elements: list[bytes]) -> None:
    assert len(elements) == len(PLACES)
    assert all(is_near(place(element), where) for element, where in zip(elements, PLACES, strict=True))


def test_each_group_has_them_and_a_standby_takes_over(started: Any) -> None:
    drive = started(False)
    for name, source in (("centre", MAIN), ("dispatch", OTHER)):
        empty(drive.gateway, name, source)
    with Link(drive.gateway, MAIN).start() as link:
        drive_on(drive)
        seen = positions(link)
        assert_the_places(seen)
    with Link(drive.gateway, SPARE).start() as link:  # what the other has not acknowledged
        assert positions(link) == seen
        link.acknowledge()
    with Link(drive.gateway, MAIN).start() as link:
        assert positions(link) == []
    with Link(drive.gateway, OTHER).start() as link:
        assert positions(link) == seen


def test_they_survive_a_power_cut_as_they_were(started: Any) -> None:
    drive = started(True)
    for name, source in (("centre", MAIN), ("dispatch", OTHER)):
        empty(drive.gateway, name, source)
    with Link(drive.gateway, MAIN).start() as link:
        drive_on(drive)
        seen = positions(link)
        assert_the_places(seen)
    wait_journal(drive.gateway, max(waiting(drive.gateway)))
    cut_power(drive.gateway)
    drive.gateway.start()
    with Link(drive.gateway, SPARE).start() as link:
        assert positions(link) == seen
