# SPDX-License-Identifier: GPL-3.0-or-later
"""rtu-gps: a receiver's fixes as points, their quality, their events, up to a controlling station."""

import contextlib
import datetime
import itertools
import json
import os
import pwd
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from lab.gateway import REPOSITORY, Gateway, free_port, listening_on, remove, run_directory
from lab.master import Master
from lab.receiver import Receiver, burst, sentence
from peers.gpsd import gpsd_daemon
from peers.hangs_up import hangs_up

CA = 7001
LATITUDE, LONGITUDE, ALTITUDE, SPEED, COURSE, HDOP, ERROR, FIX, SATELLITES, IN_DEPOT = (*range(1, 10), 101)
DEPOT = (44.8125000, 20.4612000)
METRE = 1 / 111_195  # degrees of latitude
OUTSIDE = (DEPOT[0] + 45 * METRE, DEPOT[1])  # nearer than what a jump is
BEGIN = datetime.datetime(2027, 3, 16, 9, 38, tzinfo=datetime.UTC)


def config(receiver: dict[str, Any]) -> dict[str, Any]:
    """A gateway with one receiver and no line."""
    fence = {"name": "depot", "centre": DEPOT, "radius_m": 30}
    defaults = {"name": "bus", "ca": CA, "topical_s": 2, "max_speed_km_h": 3600, "fences": [fence]}
    return listening_on({"port": [], "gps": [defaults | receiver]}, free_port())


def now() -> datetime.datetime:
    """The receiver's time goes on as the gateway's does, however busy the host is."""
    return BEGIN + datetime.timedelta(seconds=time.monotonic())


@dataclass
class Drive:
    """A gateway, its receiver, and the receiver's time."""

    gateway: Gateway
    receiver: Receiver

    def say(self, place: tuple[float, float], method: int = 1, speed_knots: float = 0.0) -> None:
        """The burst of this moment, and its silence."""
        before = self.row()["fixes"]
        self.receiver.say(burst(now(), *place, method=method, speed_knots=speed_knots))
        self.gateway.wait_for(lambda: self.row()["fixes"] != before, 30.0, "the burst is a fix")

    def row(self) -> dict[str, Any]:
        """What `rtuctl gps` says."""
        (row,) = self.gateway.query("gps")
        return row  # type: ignore[no-any-return]

    def point(self, name: str) -> dict[str, Any]:
        return self.gateway.points(f"bus.{name}")[f"bus.{name}"]

    def wait_point(self, name: str, wanted: Callable[[dict[str, Any]], bool], what: str) -> None:
        self.gateway.wait_for(lambda: wanted(self.point(name)), 30.0, what)


@pytest.fixture
def directory() -> Iterator[Path]:
    directory = run_directory()
    (directory / "dev").mkdir()
    yield directory
    remove(directory)


@contextlib.contextmanager
def driving(programs: Path, directory: Path, **keys: Any) -> Iterator[Drive]:
    with (
        Receiver(directory / "dev/gps1") as receiver,
        Gateway(config({"device": "gps1"} | keys), directory, programs) as gateway,
    ):
        drive = Drive(gateway, receiver)
        gateway.wait_for(lambda: drive.row()["open"], 30.0, "the receiver's line is open")
        yield drive


@pytest.fixture
def drive(programs: Path, directory: Path) -> Iterator[Drive]:
    with driving(programs, directory) as drive:
        yield drive


def test_position_reaches_the_control_centre(drive: Drive) -> None:
    drive.say(DEPOT, speed_knots=10)
    with Master(*drive.gateway.address) as master:
        reports = {report.ioa: report for report in master.interrogate(CA)}
    assert all(report.good or report.ioa in (ERROR,) for report in reports.values()), reports
    assert reports[ERROR].quality != "good"  # this receiver does not say it
    assert reports[LATITUDE].value == pytest.approx(DEPOT[0], abs=4e-6)  # a short float
    assert reports[LONGITUDE].value == pytest.approx(DEPOT[1], abs=2e-6)
    assert reports[ALTITUDE].value == pytest.approx(137.2, abs=0.01)
    assert reports[SPEED].value == pytest.approx(10 * 1852 / 3600, abs=0.002)
    assert (reports[COURSE].value, reports[HDOP].value) == (pytest.approx(90.0), pytest.approx(1.2))
    assert (reports[FIX].value, reports[SATELLITES].value, reports[IN_DEPOT].value) == (1, 7, True)
    # The map holds it whole.
    assert (drive.point("latitude")["value"], drive.point("longitude")["value"]) == DEPOT


@pytest.mark.slow
def test_quality_says_what_is_known(drive: Drive) -> None:
    assert drive.point("latitude")["quality"] == "invalid"
    drive.say(DEPOT)
    assert drive.point("latitude")["quality"] == "good"
    drive.say(DEPOT, method=6)
    assert drive.point("latitude")["quality"] == "substituted"
    drive.say(DEPOT, method=0)
    # Its last place stays, and that it was in the depot: nobody vouches for it.
    assert (drive.point("latitude")["value"], drive.point("latitude")["quality"]) == (DEPOT[0], "invalid")
    assert (drive.point("longitude")["value"], drive.point("longitude")["quality"]) == (DEPOT[1], "invalid")
    assert (drive.point("in-depot")["value"], drive.point("in-depot")["quality"]) == ("on", "invalid")
    assert (drive.point("fix")["value"], drive.point("fix")["quality"]) == (0, "good")
    drive.say(DEPOT)
    assert drive.point("latitude")["quality"] == "good"
    drive.wait_point("latitude", lambda p: p["quality"] == "not topical", "silence is not topical")
    assert drive.point("fix")["quality"] == "not topical"
    assert drive.point("latitude")["value"] == DEPOT[0]
    drive.say(DEPOT)
    assert drive.point("latitude")["quality"] == "good"


@pytest.mark.slow
def test_events_are_of_fixes_and_not_of_coordinates(programs: Path, directory: Path) -> None:
    """
    One that stands makes no event, though each coordinate trembles; one that drives does each 50 m. Nor does
    one that a busy host lets speak late.
    """
    with driving(programs, directory, topical_s=60) as drive:
        for second in range(6):
            drive.say((DEPOT[0] + second % 2 * 3 * METRE, DEPOT[1]))
        assert drive.row()["events"] == 1  # the first
        for metres in range(20, 120, 20):
            drive.say((DEPOT[0] + metres * METRE, DEPOT[1]))
        assert drive.row()["events"] == 2  # at 60 m; the next at 110
        drive.say((DEPOT[0] + 120 * METRE, DEPOT[1]))
        assert drive.row()["events"] == 3
        kept = [
            event for event in drive.gateway.ctl("--json", "events").splitlines() if "bus.latitude" in event
        ]
        assert len(kept) == 3


@pytest.mark.slow
def test_sentences_some_milliseconds_apart_are_one_fix_and_one_event(programs: Path, directory: Path) -> None:
    """As of a receiver whose RMC is of 20 ms after its GGA, and has no altitude."""
    with driving(programs, directory, topical_s=60) as drive:
        for fixes in range(1, 5):
            drive.receiver.say(burst(now(), *DEPOT, rmc_ms=20))
            drive.gateway.wait_for(lambda of=fixes: drive.row()["fixes"] >= of, 30.0, "the burst is a fix")
            assert (drive.row()["fixes"], drive.row()["events"]) == (fixes, 1)


@pytest.mark.slow
def test_geofence_is_an_event_of_its_own(drive: Drive) -> None:
    drive.say(DEPOT)
    with Master(*drive.gateway.address) as master:
        master.interrogate(CA)
        mark = master.mark()
        drive.say(OUTSIDE)
        left = master.wait(
            lambda r: (r.ca, r.ioa, r.cause, r.value) == (CA, IN_DEPOT, "SPONTANEOUS", False),
            since=mark,
            what="it left",
        )
    assert left.good


@pytest.mark.slow
def test_time_of_a_fix_is_the_receivers_where_the_clocks_agree(programs: Path, directory: Path) -> None:
    with (
        Receiver(directory / "dev/gps1") as receiver,
        Gateway(config({"device": "gps1"}) | {"clock": "masters"}, directory, programs) as gateway,
        Master(*gateway.address) as master,
    ):
        drive = Drive(gateway, receiver)
        gateway.wait_for(lambda: drive.row()["open"], 30.0, "the receiver's line is open")
        master.interrogate(CA)
        master.synchronise_clock(CA)
        places = itertools.cycle([DEPOT, (DEPOT[0] + 60 * METRE, DEPOT[1])])

        def tag_of(at: datetime.datetime) -> datetime.datetime | None:
            mark = master.mark()
            receiver.say(burst(at, *next(places)))
            return master.wait(
                lambda r: (r.ca, r.ioa, r.cause) == (CA, LATITUDE, "SPONTANEOUS"), mark, 30.0
            ).recorded_at

        def is_the_receivers() -> bool:
            second_ago = datetime.datetime.now(datetime.UTC) - datetime.timedelta(seconds=1)
            at = second_ago.replace(microsecond=120_000)
            return tag_of(at) == at

        gateway.wait_for(is_the_receivers, 60.0, "a burst is not late")
        begun = datetime.datetime.now(datetime.UTC)
        tag = tag_of(begun - datetime.timedelta(hours=1))
        assert tag is not None
        assert tag > begun - datetime.timedelta(minutes=1)  # of its arrival


@pytest.mark.slow
def test_receivers_of_one_process(programs: Path, directory: Path) -> None:
    """Each has its place and its fences; what cannot be is marked, and not dropped."""
    square = [[59.9, 10.7], [59.9, 10.8], [60.0, 10.8], [60.0, 10.7]]
    file = config({"device": "gps1"})
    tram = {"name": "tram", "device": "gps2", "ca": CA + 1, "fences": [{"name": "city", "corners": square}]}
    file["gps"].append(tram)
    oslo, bergen = (59.95, 10.75), (60.39, 5.32)
    with (
        Receiver(directory / "dev/gps1") as first,
        Receiver(directory / "dev/gps2") as second,
        Gateway(file, directory, programs) as gateway,
    ):
        gateway.wait_for(lambda: all(row["open"] for row in gateway.query("gps")), 30.0, "both are open")

        def wait_latitude(name: str, wanted: tuple[float, str]) -> None:
            def is_there() -> bool:
                point = gateway.points(f"{name}.latitude")[f"{name}.latitude"]
                return (point["value"], point["quality"]) == wanted

            gateway.wait_for(is_there, 30.0, f"the latitude of {name}")

        first.say(burst(now(), *DEPOT))
        second.say(burst(now(), *oslo))
        wait_latitude("bus", (DEPOT[0], "good"))
        wait_latitude("tram", (oslo[0], "good"))
        assert gateway.points("tram.in-city")["tram.in-city"]["value"] == "on"
        second.say(burst(now(), *bergen))
        wait_latitude("tram", (bergen[0], "invalid"))
        assert gateway.points("tram.in-city")["tram.in-city"]["value"] == "off"
        assert [(row["name"], row["jumps"]) for row in gateway.query("gps")] == [("bus", 0), ("tram", 1)]


@pytest.mark.slow
def test_damaged_lines_cost_themselves(drive: Drive) -> None:
    drive.say(DEPOT)
    drive.receiver.say(b"\xff\x00noise" + sentence("PGRMT,GPS 17N,,,,,,,,")[:-4] + b"\r\n$GPGGA,1,2,3\r\n")
    drive.gateway.wait_for(lambda: drive.row()["damaged"] >= 2, 30.0, "damage is counted")
    drive.say(DEPOT)
    assert drive.point("latitude")["quality"] == "good"
    assert drive.row()["stray"] > 0


@pytest.mark.slow
def test_line_that_is_lost_comes_back(drive: Drive) -> None:
    drive.say(DEPOT)
    drive.receiver.unplug()
    drive.gateway.wait_for(lambda: not drive.row()["open"], 30.0, "the loss is seen")
    drive.wait_point("latitude", lambda p: p["quality"] == "not topical", "its position is old")
    assert "bus: " in drive.gateway.log() and "hung up" in drive.gateway.log()
    drive.receiver.plug()
    drive.gateway.wait_for(lambda: drive.row()["open"], 30.0, "it is open again")
    drive.say(DEPOT)
    assert drive.point("latitude")["quality"] == "good"


@pytest.mark.slow
def test_killed_module_has_no_position(drive: Drive) -> None:
    drive.say(DEPOT)
    pid = drive.gateway.modules()["rtu-gps"]["pid"]
    os.kill(pid, signal.SIGKILL)
    drive.wait_point("latitude", lambda p: p["quality"] != "good", "nobody vouches for it")
    drive.gateway.wait_for(
        lambda: drive.gateway.modules()["rtu-gps"]["pid"] not in (0, None, pid), 30.0, "it is started again"
    )
    drive.gateway.wait_for(lambda: drive.row()["open"], 30.0, "the line is open again")
    drive.say(DEPOT)
    assert drive.point("latitude")["quality"] == "good"


def test_no_line_is_open_in_a_process_that_was_stopped(drive: Drive) -> None:
    assert drive.row()["open"]
    drive.gateway.ctl("module", "rtu-gps", "stop")
    assert not drive.row()["open"]
    drive.gateway.ctl("module", "rtu-gps", "start")
    drive.gateway.wait_for(lambda: drive.row()["open"], 30.0, "the line is open again")


@pytest.mark.slow
def test_position_that_a_reload_took_over_gets_old(drive: Drive) -> None:
    drive.say(DEPOT)
    pid = drive.gateway.modules()["rtu-gps"]["pid"]
    changed = json.loads(drive.gateway.config_file.read_text())
    changed["gps"][0]["distance_m"] = 70
    drive.gateway.ctl("reload", drive.gateway.put(changed))
    assert drive.gateway.modules()["rtu-gps"]["pid"] != pid
    drive.wait_point("latitude", lambda point: point["quality"] == "not topical", "an old position")
    assert drive.point("latitude")["value"] == DEPOT[0]


def test_the_sky_is_drawn(drive: Drive) -> None:
    drive.say(DEPOT)
    picture = drive.gateway.ctl("gps", "bus").splitlines()
    assert len({len(line) for line in picture[-15:]}) == 1
    rows = {
        name: row for row, line in enumerate(picture[-15:]) for name in ("P4*", "P5*", "P9*") if name in line
    }
    assert set(rows) == {"P4*", "P5*", "P9*"}
    assert rows["P4*"] < rows["P9*"] < rows["P5*"]  # near the zenith and north of it, west, south
    assert {s["number"]: s["snr"] for s in drive.row()["sky"]} == {4: 42, 5: 38, 9: 0, 12: 25}


def test_unknown_receiver_is_said(drive: Drive) -> None:
    run = subprocess.run([*drive.gateway.rtuctl, "gps", "tram"], capture_output=True, text=True, check=False)
    assert run.returncode == 1
    assert run.stderr == 'rtuctl: there is no such receiver: "gps" in the configuration names them\n'


@pytest.mark.slow
def test_gpsd_that_hangs_up_is_no_flood_in_the_log(programs: Path, directory: Path) -> None:
    """It is tried less and less often; a line of the log counts several failures."""
    with hangs_up() as gpsd:
        source = {"gpsd": "127.0.0.1", "gpsd_port": gpsd.port}
        with Gateway(config(source), directory, programs) as gateway:
            gateway.wait_for(lambda: gpsd.connections >= 5, 60.0, "it was tried five times")
            lines = [line for line in gateway.log(1000).splitlines() if f"port {gpsd.port}" in line]
            assert len(lines) < gpsd.connections, lines
            assert sum("is open" in line for line in lines) <= 1  # a first connection, before it is lost
            # Hung up, or reset: what it was told, it had not read.
            assert next(line for line in lines if "is open" not in line).endswith("; trying again in 1 s")
            assert gateway.query("gps")[0]["failures"] >= 4


@pytest.mark.slow
def test_receiver_behind_gpsd(programs: Path, directory: Path, gpsd: Path) -> None:
    """Debian's gpsd says what the receiver said; when it ends, the position is old."""
    with gpsd_daemon(gpsd) as daemon:
        source = {"gpsd": "127.0.0.1", "gpsd_port": daemon.port}
        with Gateway(config(source), directory, programs) as gateway:

            def has_position() -> bool:
                os.write(daemon.receivers[0], burst(now(), *DEPOT))
                return bool(gateway.points("bus.latitude")["bus.latitude"]["quality"] == "good")

            gateway.wait_for(has_position, 60.0, "gpsd's position is the gateway's")
            points = gateway.points("bus.*")
            assert points["bus.latitude"]["value"] == pytest.approx(DEPOT[0], abs=2e-7)
            assert points["bus.longitude"]["value"] == pytest.approx(DEPOT[1], abs=2e-7)
            daemon.process.terminate()
            gateway.wait_for(lambda: not gateway.query("gps")[0]["open"], 30.0, "gpsd has gone")
            gateway.wait_for(
                lambda: gateway.points("bus.latitude")["bus.latitude"]["quality"] == "not topical",
                30.0,
                "its position is old",
            )
            assert gateway.modules()["rtu-gps"]["restarts"] == 0


@pytest.mark.slow
@pytest.mark.parametrize("wanted", [None, 1])
def test_of_two_receivers_behind_gpsd_one_counts(
    programs: Path, directory: Path, gpsd: Path, wanted: int | None
) -> None:
    """Otherwise its place would go to and fro between them, and be good."""
    with gpsd_daemon(gpsd, receivers=2) as daemon:
        source: dict[str, Any] = {"gpsd": "127.0.0.1", "gpsd_port": daemon.port, "distance_m": 5}
        if wanted is not None:
            source["gpsd_device"] = daemon.devices[wanted]
        places: dict[int, float] = {0: DEPOT[0], 1: DEPOT[0] + 0.0001}  # eleven metres apart
        with Gateway(config(source), directory, programs) as gateway:

            def latitude() -> float | None:
                for number, place in places.items():
                    os.write(daemon.receivers[number], burst(now(), place, DEPOT[1]))
                point = gateway.points("bus.latitude")["bus.latitude"]
                return float(point["value"]) if point["quality"] == "good" else None

            gateway.wait_for(lambda: latitude() is not None, 60.0, "there is a position")
            warning = "has several receivers"
            if wanted is None:
                gateway.wait_for(
                    lambda: latitude() is not None and warning in gateway.log(50), 60.0, "it says so"
                )
            fixes = gateway.query("gps")[0]["fixes"]
            gateway.wait_for(
                lambda: latitude() is not None and gateway.query("gps")[0]["fixes"] >= fixes + 5,
                60.0,
                "it goes on",
            )
            rows = [json.loads(line) for line in gateway.ctl("--json", "events").splitlines()]
            events = [row for row in rows if row.get("name") == "bus.latitude"]
            seen = {row["value"] for row in events if row["quality"] == "good"}
            assert len(seen) == 1, seen
            assert wanted is None or seen.pop() == pytest.approx(places[wanted], abs=2e-7)
            assert (warning in gateway.log(50)) == (wanted is None)


@pytest.mark.parametrize(
    ("receiver", "message"),
    [
        ({}, "gps[0]: has no source, expected device of a serial port or gpsd, an IP address"),
        (
            {"device": "gps1", "baud_rate": 4800},
            "gps[0]: a burst of 750 octets takes 1.56 s at 4800 bit/s, longer than its period of 1.00 s: "
            "expected a higher baud_rate, a longer period_ms, or burst_octets as it really is",
        ),
        (
            {"device": "gps1", "fences": [{"name": "a", "centre": [91, 0], "radius_m": 5}]},
            "gps[0].fences[0].centre: is not a place, expected [latitude, longitude] in degrees, as "
            "[44.8125, 20.4612]",
        ),
        (
            {"device": "gps1", "fences": [{"name": "a", "corners": [[0, 0], [1, 1]]}]},
            "gps[0].fences[0]: cannot be used: it needs 3 to 64 corners",
        ),
        (
            {"device": "gps1", "fences": [{"name": "a", "centre": [0, 0]}]},
            "gps[0].fences[0]: needs one shape, expected centre and radius_m, or corners",
        ),
    ],
)
def test_mistakes_in_the_file(programs: Path, tmp_path: Path, receiver: dict[str, Any], message: str) -> None:
    file = tmp_path / "gateway.json"
    file.write_text(json.dumps(config(receiver)))
    run = subprocess.run(
        [programs / "rtud/rtud", "--check", file], capture_output=True, text=True, check=False
    )
    assert run.returncode == 1
    assert run.stderr == f"{file}:1: {message}\n"


@pytest.mark.slow
def test_time_reaches_chrony(programs: Path, directory: Path, chrony: Path) -> None:
    """As a source that chronyd uses, 2 s behind its clock, which it does not touch."""
    socket_ = directory / "clock"
    settings = directory / "chrony.conf"
    settings.write_text(
        f"refclock SOCK {socket_} refid GPS poll 0 filter 1 delay 0.5\npidfile {directory}/chronyd.pid\n"
        f"port 0\ncmdport 0\nbindcmdaddress {directory}/asked/socket\n"
    )
    (directory / "asked").mkdir(mode=0o770)
    command: list[str | Path] = [
        chrony / "sbin/chronyd",
        "-x",
        "-d",
        "-U",
        "-u",
        pwd.getpwuid(os.geteuid()).pw_name,
    ]
    with (
        Receiver(directory / "dev/gps1") as receiver,
        Gateway(config({"device": "gps1", "clock_socket": str(socket_)}), directory, programs) as gateway,
        (directory / "chrony.log").open("w") as log,
        subprocess.Popen([*command, "-f", settings], stdout=log, stderr=log) as chronyd,
    ):
        try:
            gateway.wait_for(socket_.exists, 30.0, "chronyd has its socket")
            socket_.chmod(0o666)  # on the board the folder's group says who may

            def told() -> list[str]:
                query = [chrony / "bin/chronyc", "-c", "-h", directory / "asked/socket", "sources"]
                done = subprocess.run(query, capture_output=True, text=True, check=False)
                return done.stdout.strip().split(",")

            def says(method: int, day: datetime.date | None = None, only: bytes = b"") -> None:
                """Of 2 s ago, on that day; without one, today. Of the burst, only the lines of a kind."""
                before = gateway.query("gps")[0]["fixes"]
                at = datetime.datetime.now(datetime.UTC) - datetime.timedelta(seconds=2)
                if day:
                    at = datetime.datetime.combine(day, at.timetz())
                lines = burst(at, *DEPOT, method=method).splitlines(keepends=True)
                receiver.say(b"".join(line for line in lines if only in line))
                gateway.wait_for(
                    lambda: gateway.query("gps")[0]["fixes"] != before, 30.0, "the burst is a fix"
                )

            gateway.wait_for(lambda: gateway.query("gps")[0]["open"], 30.0, "the line is open")
            says(7)  # typed
            says(1, only=b"RMC")  # a letter alone stands for it
            for day in ((1980, 1, 6), (2000, 1, 1), (2079, 1, 1)):
                says(1, datetime.date(*day))
                assert gateway.points("bus.latitude")["bus.latitude"]["quality"] == "good"
            assert gateway.query("gps")[0]["dates_refused"] == 3
            assert told()[2:6] == ["GPS", "0", "0", "0"]

            def reached() -> bool:
                says(1)
                return told()[5] != "0"

            gateway.wait_for(reached, 60.0, "chronyd has samples of it")
            assert float(told()[8]) == pytest.approx(2, abs=1.5)
        finally:
            chronyd.terminate()


def test_day_that_dates_the_program(tmp_path: Path) -> None:
    """The tree's; outside of it SOURCE_DATE_EPOCH, or VERSION's time. A header that has it is left alone."""
    script = Path("modules/gps/built.sh")
    source, header = REPOSITORY / "package/openrtu/src", tmp_path / "built.h"
    alone = tmp_path / "src"
    (alone / script).parent.mkdir(parents=True)
    shutil.copy(source / script, alone / script)
    (alone / "VERSION").touch()
    os.utime(alone / "VERSION", (90_000, 90_000))
    outside = {name: value for name, value in os.environ.items() if name != "SOURCE_DATE_EPOCH"}
    dated = {**outside, "SOURCE_DATE_EPOCH": f"{20_000 * 86_400 + 1}"}

    def day(folder: Path, environment: dict[str, str]) -> int:
        subprocess.run([folder / script, header], env=environment, check=True)
        return int(header.read_text().removeprefix("#define BUILT_DAYS "))

    seconds = subprocess.run(
        [REPOSITORY / "scripts/source-date.sh"], env=outside, capture_output=True, text=True, check=True
    ).stdout
    assert day(source, outside) == int(seconds) // 86_400
    assert day(alone, outside) == 1
    assert day(source, dated) == day(alone, dated) == 20_000
    os.utime(header, (1, 1))
    assert day(alone, dated) == 20_000
    assert header.stat().st_mtime == 1
