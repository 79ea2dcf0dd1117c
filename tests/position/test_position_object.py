# SPDX-License-Identifier: GPL-3.0-or-later
"""A position as one object: from the receiver through the gateway to controlling stations, and its mirror."""

import socket
import struct
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from test_gps import ALTITUDE, CA, DEPOT, FIX, LATITUDE, LONGITUDE, METRE, Drive, config, driving, now

from lab.gateway import Gateway, remove, run_directory
from lab.master import Master
from lab.raw_master import STARTDT_ACT, STARTDT_CON, RawMaster
from lab.receiver import Receiver, burst
from openrtu_tools.centre.codes import Kind
from peers.centre_consumer import Record
from rig.asking import Asking
from rig.centre import Centre
from rig.dissector import FIELDS, dissected

pytestmark = pytest.mark.slow

POSITION = 200
REQUEST, SPONTANEOUS, INTERROGATED = 5, 3, 20
POSITION_TYPE, READ = 201, 102
NO_ALTITUDE_DM, OVERFLOW, INVALID = -(2**23), 0x01, 0x80  # docs/positioning.md
FAR = (DEPOT[0] + 60 * METRE, DEPOT[1] - 60 * METRE)


def octets_of(place: tuple[float, float]) -> tuple[int, int]:
    """In 1e-7 degree."""
    return round(place[0] * 1e7), round(place[1] * 1e7)


def is_near(position: tuple[int, int], place: tuple[float, float]) -> bool:
    """Each minute has five digits on the line: 1.7e-7 degree."""
    return all(abs(one - other) <= 2 for one, other in zip(position, octets_of(place), strict=True))


@pytest.fixture
def directory() -> Iterator[Path]:
    directory = run_directory()
    (directory / "dev").mkdir()
    yield directory
    remove(directory)


@pytest.fixture
def drive(programs: Path, directory: Path) -> Iterator[Drive]:
    with (
        Receiver(directory / "dev/gps1") as receiver,
        Gateway(config({"device": "gps1", "position_ioa": POSITION}), directory, programs) as gateway,
    ):
        drive = Drive(gateway, receiver)
        gateway.wait_for(lambda: drive.row()["open"], 30.0, "the receiver's line is open")
        drive.say(DEPOT)
        yield drive


@pytest.fixture
def asking(programs: Path, drive: Drive) -> Iterator[Asking]:
    asking = Asking(programs, drive.gateway.address[1], 20_000, 20_000)
    asking.until(lambda seen: "started" in seen)
    yield asking
    asking.close()


def is_position(seen: dict[str, Any], cause: int) -> bool:
    return (seen.get("type"), seen.get("cause")) == (201, cause)


def test_our_station_asks_for_it(drive: Drive, asking: Asking) -> None:
    asking.ask(f"read {CA} {POSITION}")
    seen = asking.until(lambda seen: is_position(seen, REQUEST))
    assert (seen["ca"], seen["ioa"]) == (CA, POSITION)
    assert is_near((seen["latitude"], seen["longitude"]), DEPOT)
    assert asking.result(f"interrogate {CA} 20")["state"] == "executed command"
    found = {seen["ioa"]: seen for seen in asking.information() if seen["cause"] == INTERROGATED}
    assert found[POSITION]["type"] == 201
    assert {LATITUDE, LONGITUDE, ALTITUDE, FIX} < found.keys()
    drive.say(FAR)
    seen = asking.until(lambda seen: is_position(seen, SPONTANEOUS))
    assert is_near((seen["latitude"], seen["longitude"]), FAR)
    seen = asking.until(lambda seen: (seen.get("ioa"), seen.get("cause")) == (LONGITUDE, SPONTANEOUS))
    assert seen["type"] == 36  # its mirror, a short float


def test_tshark_reads_the_gateways_octets(drive: Drive, tmp_path: Path) -> None:
    """Asked by a bare socket."""
    with socket.create_connection(drive.gateway.address) as connection:
        stream = connection.makefile("rb")
        connection.sendall(bytes((0x68, 4, STARTDT_ACT, 0, 0, 0)))
        assert stream.read(6)[2] == STARTDT_CON
        read = bytes((102, 1, REQUEST, 0)) + CA.to_bytes(2, "little") + POSITION.to_bytes(3, "little")
        connection.sendall(bytes((0x68, 4 + len(read), 0, 0, 0, 0)) + read)
        apdu = stream.read(35)
        while apdu[6] != 201:  # M_EI_NA_1 before it
            apdu = apdu[2 + apdu[1] :] + stream.read(2 + apdu[1])
    ((ioa, *values, wrong),) = dissected(apdu, tmp_path)
    found = dict(zip(FIELDS, values, strict=True))
    assert (ioa, wrong) == (str(POSITION), "")
    place = float(found["latitude"]), float(found["longitude"])
    assert is_near(octets_of(place), DEPOT)
    assert (found["altitude"], found["fix"], found["satellites"]) == ("137.2", "1", "7")
    assert (found["invalid"], found["overflow"]) == ("0", "0")


def test_altitude_that_is_not_known(programs: Path, directory: Path) -> None:
    """Of a receiver that says RMC alone, and without a fix: in its events, as it is read, and as a point."""
    nothing = (False, NO_ALTITUDE_DM, 0x00, INVALID | OVERFLOW)
    with (
        driving(programs, directory, position_ioa=POSITION, topical_s=60) as drive,
        RawMaster(*drive.gateway.address) as master,
    ):

        def told(cause: int) -> tuple[bool, int, int, int]:
            """Whether it is FAR; the altitude; fix and satellites; the quality."""
            answer = master.answer(POSITION_TYPE)
            assert answer.cause == cause
            latitude, longitude = struct.unpack_from("<ii", answer.body, 3)
            altitude = int.from_bytes(answer.body[11:14], "little", signed=True)
            return is_near((latitude, longitude), FAR), altitude, answer.body[14], answer.body[15]

        def read() -> tuple[bool, int, int, int]:
            master.request(READ, CA, POSITION, b"", cause=REQUEST)
            return told(REQUEST)

        rmc = next(line for line in burst(now(), *FAR).splitlines(keepends=True) if b"RMC" in line)
        assert read() == nothing
        drive.receiver.say(rmc)
        assert told(SPONTANEOUS) == read() == (True, NO_ALTITUDE_DM, 0x01, OVERFLOW)
        points = {name: drive.point(name)["quality"] for name in ("latitude", "altitude", "satellites")}
        assert points == {"latitude": "good", "altitude": "invalid", "satellites": "invalid"}
        drive.say(FAR, method=0)
        lost = (True, NO_ALTITUDE_DM, 0x00, INVALID | OVERFLOW)  # the last place
        assert told(SPONTANEOUS) == read() == lost
        assert drive.point("satellites")["quality"] == "good"


def test_who_does_not_know_the_type_has_the_mirror(drive: Drive) -> None:
    """c104 drops 201 in silence."""
    with Master(*drive.gateway.address) as master:
        reports = {report.ioa: report for report in master.interrogate(CA)}
        assert reports[LATITUDE].value == pytest.approx(DEPOT[0], abs=4e-6)
        assert POSITION not in reports
        mark = master.mark()
        drive.say(FAR)
        moved = master.wait(lambda r: (r.ca, r.ioa) == (CA, LATITUDE), since=mark, what="it moved")
        assert moved.value == pytest.approx(FAR[0], abs=4e-6)


def test_quality_and_lost_fix(drive: Drive, asking: Asking) -> None:
    """A fix that is lost is an event of it, with the fix kind 0; so is the one that is found."""
    drive.say(DEPOT, method=0)
    asking.until(lambda seen: is_position(seen, SPONTANEOUS))
    assert drive.point("position")["quality"] == "invalid"
    drive.say(DEPOT)
    seen = asking.until(lambda seen: is_position(seen, SPONTANEOUS))
    assert is_near((seen["latitude"], seen["longitude"]), DEPOT)
    asking.until(lambda seen: is_position(seen, SPONTANEOUS))  # after topical_s
    assert drive.point("position")["quality"] == "not topical"


def test_our_centre_sees_it_move(drive: Drive, programs: Path, tmp_path: Path) -> None:
    host, port = drive.gateway.address
    reads = [{"common_address": CA, "ioa": POSITION, "period_ms": 50}]
    one = {"name": "bus", "address": host, "port": port, "common_addresses": [CA], "reads": reads}
    centre = Centre(programs / "centre" / "rtu-centre", tmp_path, [one])
    consumer = centre.consumer()

    def polled(place: tuple[float, float]) -> Record:
        return consumer.until(
            lambda r: (r.kind, r.cause) == (Kind.POSITION, REQUEST) and is_near(r.position[:2], place)
        )

    assert (polled(DEPOT).ioa, polled(DEPOT).detail) == (POSITION, 0x71)
    drive.say(FAR)
    assert polled(FAR).position[2] == 1372
    consumer.close()
    assert centre.stop() == 0


@pytest.mark.soak
def test_10_000_stops_tear_no_position(programs: Path) -> None:
    """Of its owner, and of its reader; the suite has 100 of each."""
    subprocess.run([programs / "iec104" / "test_iec104_positions_torn", "10000"], check=True)
