# SPDX-License-Identifier: GPL-3.0-or-later
"""
NMEA 0183 and gpsd's JSON against gpsd itself: the recordings of real receivers in Debian's source package
of gpsd (BSD licence), each beside what gpsd made of it, and the daemon on a pty.
"""

import json
import math
import os
import random
import re
import socket
import subprocess
import time
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from peers.gpsd import Daemon, gpsd_daemon

POSITION, TIME, ALTITUDE, SPEED = 1, 2, 4, 8  # of enum gps_known
CONTRADICTS = 1  # GPS_CONTRADICTS of enum gps_mark
MOMENT_MS = 50  # gpsd answers to each of the times of one moment
BUILT_DAYS, ERA_DAYS = 12_000, 7168  # 2002-11-09: most recordings are of some time from there on
HALF_A_UNIT = 0.5001  # of 1e-7 degree: ours are rounded

# gpsd answers with the position of the sentence that came last, which has fewer digits than the one that we
# take; on a ship's network it has that of an instrument whose clock is a second off: 3 m at her speed.
LAST_SENTENCE = {"ac12": 20, "ac12_binary": 20, "tcp-test": 20, "udp-test": 20, "bundg_zeus_9": 400}
# No line has a checksum; a receiver says a differential fix of 0 satellites.
WE_REFUSE = {"hp58534a": 1, "foretrex-201": 3}

# A first fix that RMC and three satellites of GSA vouch for, with 00 in GGA: later versions of gpsd have it.
GPSD_REFUSES = {("garmin25lp", 43_406_000)}

# gpsd computes the speed from positions.
COMPUTED_SPEED = {"hemi", "humminbird-M37"}

Fix = dict[str, Any]


@dataclass
class Answers:
    """What gpsd said of a recording: by the time of day in ms, the positions and the rest; None: no fix."""

    positions: dict[int, set[tuple[float, float]]] = field(default_factory=lambda: defaultdict(set))
    undated: set[tuple[float, float]] = field(default_factory=set)
    reports: dict[int, list[Fix]] = field(default_factory=lambda: defaultdict(list))


@pytest.fixture(scope="module")
def recordings(gpsd: Path) -> Path:
    return gpsd / "debian" / "test" / "daemon"


@pytest.fixture(scope="module")
def replay(programs: Path) -> Path:
    return programs / "gps" / "gps-replay"


def replayed(
    replay: Path, inputs: list[bytes], protocol: str = "nmea", built_days: int = BUILT_DAYS
) -> list[tuple[list[Fix], Fix]]:
    """Of each input the fixes, and what was counted."""
    octets = b"".join(b"%d\n" % len(text) + text for text in inputs)
    command = [replay, protocol, str(built_days)]
    output = subprocess.run(command, input=octets, capture_output=True, check=True).stdout
    runs: list[tuple[list[Fix], Fix]] = []
    fixes: list[Fix] = []
    for line in map(json.loads, output.splitlines()):
        if "taken" in line:
            runs.append((fixes, line))
            fixes = []
        else:
            fixes.append(line)
    assert len(runs) == len(inputs)
    return runs


def day_ms(stamp: str) -> int:
    hours, minutes, seconds = stamp[11:-1].split(":")
    return (int(hours) * 60 + int(minutes)) * 60_000 + round(float(seconds) * 1000)


def answers_of(recording: Path) -> Answers:
    answers = Answers()
    text = recording.with_name(recording.name + ".chk").read_bytes().decode("latin-1")
    for line in text.splitlines():
        if not line.startswith('{"class":"TPV"'):
            continue
        report = json.loads(line)
        place = (report["lat"], report["lon"]) if report["mode"] >= 2 and "lat" in report else None
        if "time" not in report:
            answers.undated.update([place] if place else [])
            continue
        answers.reports[day_ms(report["time"])].append(report)
        if place:
            answers.positions[day_ms(report["time"])].add(place)
    return answers


def is_one_of(fix: Fix, places: set[tuple[float, float]], units: float) -> bool:
    return any(
        abs(fix["latitude"] - latitude * 1e7) <= units and abs(fix["longitude"] - longitude * 1e7) <= units
        for latitude, longitude in places
    )


def with_nmea(recordings: Path) -> list[Path]:
    sentence = re.compile(rb"^\$(?:..RMC|..GGA|..GLL|PGRMF)", re.MULTILINE)
    return [file for file in sorted(recordings.glob("*.log")) if sentence.search(file.read_bytes())]


# ---- recordings ----------------------------------------------------------------------------------


@pytest.mark.slow
def test_positions_are_gpsds_own(recordings: Path, replay: Path) -> None:
    """Equal to 1e-7 degree, a fix where gpsd has one, none where it has none."""
    files = with_nmea(recordings)
    runs = replayed(replay, [file.read_bytes() for file in files])
    compared, wrong, lacking = 0, [], {}
    for file, (fixes, _) in zip(files, runs, strict=True):
        answers = answers_of(file)
        units = LAST_SENTENCE.get(file.stem, HALF_A_UNIT)
        found = {fix["day_ms"]: fix for fix in fixes if fix["known"] & POSITION}
        for at, fix in found.items():
            if at not in answers.reports:
                continue  # before gpsd knew the receiver, or the date
            if (file.stem, at) in GPSD_REFUSES and at not in answers.positions:
                continue
            compared += 1
            if not is_one_of(fix, answers.positions.get(at, set()), units) or fix["marks"] & CONTRADICTS:
                wrong.append((file.stem, fix))
        if missing := [at for at in answers.positions if all(abs(at - ours) >= MOMENT_MS for ours in found)]:
            lacking[file.stem] = len(missing)
    assert wrong == []
    assert lacking == WE_REFUSE
    assert len(files) >= 90
    assert compared >= 2500


@pytest.mark.slow
def test_altitudes_and_speeds_are_gpsds_own(recordings: Path, replay: Path) -> None:
    """Of what gpsd says of that time at all; a receiver gives its speed in knots and in km/h, to 0.1."""
    compared, wrong = 0, []
    other = {*LAST_SENTENCE, *COMPUTED_SPEED}
    files = [file for file in with_nmea(recordings) if file.stem not in other]
    runs = replayed(replay, [file.read_bytes() for file in files])
    for file, (fixes, _) in zip(files, runs, strict=True):
        answers = answers_of(file)
        for fix in fixes:
            for known, ours, theirs, limit in (
                (ALTITUDE, "altitude_mm", "altMSL", 1.01),
                (SPEED, "speed_mm_s", "speed", 60),
            ):
                reference = {
                    report[theirs] for report in answers.reports.get(fix["day_ms"], []) if theirs in report
                }
                if not fix["known"] & known or not reference:
                    continue
                compared += 1
                if all(abs(fix[ours] - value * 1000) > limit for value in reference):
                    wrong.append((file.stem, fix["day_ms"], theirs, fix[ours], reference))
    assert wrong == []
    assert compared > 4000


@pytest.mark.slow
def test_gpsds_json_is_read_as_it_is(recordings: Path, replay: Path) -> None:
    """Each TPV of gpsd's own answers, of all 154 recordings: the same fix, or none."""
    files = sorted(recordings.glob("*.log.chk"))
    lines = [[line for line in file.read_bytes().split(b"\n") if line.startswith(b"{")] for file in files]
    runs = replayed(replay, [b"\n".join([*some, b""]) for some in lines], "gpsd")
    compared = 0
    for file, some, (fixes, counted) in zip(files, lines, runs, strict=True):
        reports = [json.loads(line) for line in some]
        assert counted["damaged"] == 0, file
        fixed = [report for report in reports if report["class"] == "TPV"]
        assert len(fixed) == len(fixes), file
        for report, fix in zip(fixed, fixes, strict=True):
            has_fix = report.get("mode", 0) >= 2 and "lat" in report and "lon" in report
            assert bool(fix["known"] & POSITION) == has_fix, file
            assert fix["day_ms"] == (day_ms(report["time"]) if "time" in report else -1) or not has_fix
            if has_fix:
                compared += 1
                assert is_one_of(fix, {(report["lat"], report["lon"])}, HALF_A_UNIT), file
    assert compared > 5000


@pytest.mark.slow
def test_weeks_that_rolled_over(recordings: Path, replay: Path) -> None:
    """A date before the program was built is a multiple of 1 024 weeks too early, or none."""
    log = (recordings / "garmin17n.log").read_bytes()
    (then, counted), (now, corrected), (much_later, refused) = (
        replayed(replay, [log], built_days=days)[0]
        for days in (12_784, 20_000, 20_454)  # 2005, 2024, 2026
    )
    recorded = 1_110_965_882  # 2005-03-16 09:38:02, as the recording's head says
    assert [fix["time_ns"] // 10**9 for fix in then] == [recorded, recorded + 1]
    assert (counted["corrected"], counted["refused"]) == (0, 0)
    later = ERA_DAYS * 86_400
    assert [fix["time_ns"] // 10**9 for fix in now] == [recorded + later, recorded + 1 + later]
    assert (corrected["corrected"], corrected["refused"]) == (2, 0)
    # 2044 is farther from 2026 than from its own era's begin.
    assert all(fix["known"] & POSITION and not fix["known"] & TIME for fix in much_later)
    assert (refused["corrected"], refused["refused"]) == (0, 2)


@pytest.mark.slow
def test_all_recordings_are_moved_by_whole_eras(recordings: Path, replay: Path) -> None:
    """For a program built an era later: the same time of day, and a date an era later, if that is near."""
    logs = [file.read_bytes() for file in with_nmea(recordings)]
    day_ns = 86_400 * 10**9
    built = BUILT_DAYS + ERA_DAYS
    moved, too_far = 0, 0
    for (then, _), (now, _) in zip(
        replayed(replay, logs), replayed(replay, logs, built_days=built), strict=True
    ):
        for one, other in zip(then, now, strict=True):
            assert one["day_ms"] == other["day_ms"]
            if not one["known"] & TIME:
                continue
            if one["time_ns"] // day_ns + ERA_DAYS < built + ERA_DAYS // 2:
                assert other["time_ns"] == one["time_ns"] + ERA_DAYS * day_ns
                moved += 1
            else:
                assert not other["known"] & TIME
                too_far += 1
    assert moved > 500
    assert too_far > 1500


# ---- damage --------------------------------------------------------------------------------------


def sealed(body: bytes) -> bytes:
    total = 0
    for octet in body:
        total ^= octet
    return b"$%b*%02X\r\n" % (body, total)


STATUS = sealed(b"PGRMT,GPS 17-HVS VER 3.20,P,P,R,R,P,,23,R")


@pytest.fixture(scope="module")
def garmin(recordings: Path) -> bytes:
    lines = (recordings / "garmin17n.log").read_bytes().splitlines()
    return b"".join(line + b"\r\n" for line in lines if line.startswith(b"$"))


# Of another place each second, so that a torn position would be seen.
def drive() -> tuple[bytes, dict[int, tuple[int, int]]]:
    octets, places = b"", {}
    for second in range(4):
        latitude, longitude = 13 + 11 * second, 40 - 9 * second
        place = b"52%02d.1439,N,021%02d.6511,E" % (latitude, longitude)
        at = b"0938%02d" % second
        octets += sealed(b"GPRMC,%b,A,%b,010.0,226.0,160305,004.2,E,D" % (at, place))
        octets += sealed(b"GPGGA,%b,%b,2,10,0.9,137.2,M,36.2,M,," % (at, place))
        octets += sealed(b"GPGSA,A,3,03,06,15,16,18,19,21,22,,27,29,,1.6,0.9,1.3")
        octets += sealed(b"GPGLL,%b,%b,A,D" % (place, at))
        octets += sealed(b"PGRMM,WGS 84")
        degrees = 52 + (latitude + 0.1439) / 60, 21 + (longitude + 0.6511) / 60
        places[(9 * 60 + 38) * 60_000 + second * 1000] = (round(degrees[0] * 1e7), round(degrees[1] * 1e7))
    return octets, places


def check_places(runs: list[tuple[list[Fix], Fix]], places: dict[int, tuple[int, int]]) -> int:
    """Each position is the one of its time. Returns how many there were."""
    positions = [fix for fixes, _ in runs for fix in fixes if fix["known"] & POSITION]
    assert [fix for fix in positions if places[fix["day_ms"]] != (fix["latitude"], fix["longitude"])] == []
    assert [fix for fix in positions if fix["marks"]] == []
    return len(positions)


def test_a_status_line_at_every_octet(replay: Path) -> None:
    """It costs the line that it is put into, and no position: each is said three times."""
    octets, places = drive()
    runs = replayed(replay, [octets[:at] + STATUS + octets[at:] for at in range(len(octets) + 1)])
    assert check_places(runs, places) == 4 * (len(octets) + 1)
    assert max(counted["damaged"] + counted["stray"] for _, counted in runs) <= 2
    assert min(counted["taken"] for _, counted in runs) == 4 * 5 + 1 - 1


def test_cut_at_every_octet(replay: Path) -> None:
    octets, places = drive()
    heads = [octets[:at] for at in range(len(octets) + 1)]
    tails = [octets[at:] for at in range(len(octets) + 1)]
    assert check_places(replayed(replay, heads + tails), places) > len(octets)


@pytest.mark.slow
def test_each_octet_damaged_and_lost(replay: Path) -> None:
    octets, places = drive()
    damaged = [
        octets[:at] + bytes([octets[at] ^ change]) + octets[at + 1 :]
        for at in range(len(octets))
        for change in (0x01, 0x08, 0x10, 0x80, 0xFF)
    ]
    lost = [octets[:at] + octets[at + 1 :] for at in range(len(octets))]
    check_places(replayed(replay, damaged), places)
    # Of lost octets a checksum of eight bits misses one in hundreds: that is contradicted, or marked.
    for fixes, _ in replayed(replay, lost):
        for fix in fixes:
            known = places.get(fix["day_ms"])
            assert not fix["known"] & POSITION or known == (fix["latitude"], fix["longitude"]) or fix["marks"]


@pytest.mark.slow
def test_a_status_line_at_every_octet_of_a_recording(garmin: bytes, replay: Path) -> None:
    runs = replayed(replay, [garmin[:at] + STATUS + garmin[at:] for at in range(len(garmin) + 1)])
    for fixes, counted in runs:
        assert {(fix["latitude"], fix["longitude"]) for fix in fixes} == {(522190650, 210108517)}
        assert len(fixes) == 2
        assert counted["taken"] >= 22


@pytest.mark.slow
def test_recordings_among_noise(recordings: Path, replay: Path) -> None:
    """Lines lost and doubled, octets thrown in: each position is one of the sound recording at that time."""
    chance = random.Random(104)
    small = [file for file in with_nmea(recordings) if file.stat().st_size < 30_000]
    files = [file for file in small if file.stem not in WE_REFUSE]  # a line that is lost denies nothing
    texts = [file.read_bytes() for file in files]
    sound = replayed(replay, texts)
    noisy = []
    for text in texts:
        lines = []
        for line in text.splitlines(keepends=True):
            lines += {
                0: [],
                1: [line, line],
                2: [chance.randbytes(3), line],
                3: [line[: len(line) // 2]],
            }.get(chance.randrange(20), [line])
        noisy.append(b"".join(lines))
    for file, (before, _), (after, _) in zip(files, sound, replayed(replay, noisy), strict=True):
        for fix in after:
            if not fix["known"] & POSITION or fix["marks"]:
                continue
            same_time = [old for old in before if old["day_ms"] == fix["day_ms"]]
            assert same_time, (file, fix)
            near = {(old["latitude"] / 1e7, old["longitude"] / 1e7) for old in same_time}
            # without its best sentence, a moment has the digits of another
            assert is_one_of(fix, near, 100), (file, fix)


# ---- distances -----------------------------------------------------------------------------------


def haversine_mm(a: float, b: float, c: float, d: float) -> float:
    phi, psi = math.radians(a), math.radians(c)
    half = math.sin((psi - phi) / 2) ** 2
    half += math.cos(phi) * math.cos(psi) * math.sin(math.radians(d - b) / 2) ** 2
    return 2 * 6_371_009_000 * math.atan2(math.sqrt(half), math.sqrt(max(0.0, 1 - half)))


def test_distances_are_within_30_mm(replay: Path) -> None:
    chance = random.Random(104)
    pairs = []
    for exponent in range(11):
        for _ in range(300):
            latitude, longitude = (
                chance.randint(-900_000_000, 900_000_000),
                chance.randint(-(18 * 10**8), 18 * 10**8),
            )
            step = 10**exponent
            other = latitude + chance.randint(-step, step), longitude + chance.randint(-step, step)
            pairs.append(
                (
                    latitude,
                    longitude,
                    max(-900_000_000, min(900_000_000, other[0])),
                    max(-(18 * 10**8), min(18 * 10**8, other[1])),
                )
            )
    pairs += [
        (0, 0, 0, 18 * 10**8),
        (9 * 10**8, 0, -9 * 10**8, 0),
        (0, 1799999999, 0, -1799999999),
        (5, 5, 5, 5),
    ]
    text = "".join(" ".join(map(str, pair)) + "\n" for pair in pairs)
    done = subprocess.run([replay, "distance", "0"], input=text, capture_output=True, text=True, check=True)
    errors = [
        abs(int(ours) - haversine_mm(*(value / 1e7 for value in pair)))
        for pair, ours in zip(pairs, done.stdout.split(), strict=True)
    ]
    assert max(errors) < 30


# ---- the daemon ----------------------------------------------------------------------------------


@pytest.fixture
def daemon(gpsd: Path) -> Iterator[Daemon]:
    with gpsd_daemon(gpsd) as daemon:
        yield daemon


@pytest.mark.slow
def test_what_gpsd_says_is_what_we_read_ourselves(daemon: Daemon, recordings: Path, replay: Path) -> None:
    log = (recordings / "ublox-lea-5h.log").read_bytes()
    lines = [line + b"\n" for line in log.split(b"\n") if line.startswith(b"$")]
    ours = {fix["day_ms"]: fix for fix in replayed(replay, [log])[0][0] if fix["known"] & POSITION}
    client = socket.create_connection(("127.0.0.1", daemon.port), timeout=0.01)
    client.sendall(b'?WATCH={"enable":true,"json":true};\n')
    received, deadline = b"", time.monotonic() + 60
    fixes: list[Fix] = []
    while len({fix["day_ms"] for fix in fixes}) < 10:
        assert time.monotonic() < deadline, received[-1000:]
        for line in lines:
            os.write(daemon.receivers[0], line)
            try:
                received += client.recv(65536)
            except TimeoutError:
                continue
        whole = received[: received.rfind(b"\n") + 1]
        ((found, counted),) = replayed(replay, [whole], "gpsd")
        assert counted["damaged"] == 0
        fixes = [fix for fix in found if fix["known"] & POSITION and fix["day_ms"] >= 0]
    for fix in fixes:
        same = ours[fix["day_ms"]]
        assert (fix["latitude"], fix["longitude"]) == (same["latitude"], same["longitude"])
    client.close()
