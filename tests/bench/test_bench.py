# SPDX-License-Identifier: GPL-3.0-or-later
"""The stop-watch: what the raw controlling station makes of bytes, and the bench of readings."""

import datetime
import json
import os
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from bare_client import BenchError
from station_contenders import lib60870
from stopwatch import Memory, Spread, age_ms, readings_of

from bench import Row, table
from lab.gateway import REPOSITORY
from lab.linesim import Frame
from lab.raw_master import Asdu, Object, RawMaster, StationError

STARTDT_CON = "68 04 0b 00 00 00"
ACT_CON = "68 0e 00 00 02 00 64 01 07 00 fb 0b 00 00 00 14"
SINGLE_POINTS = "68 12 02 00 02 00 01 02 14 00 fb 0b 01 00 00 01 11 27 00 80"  # 1 on, 10001 off, invalid
SCALED_SEQUENCE = "68 13 04 00 02 00 0b 82 14 00 fb 0b 31 75 00 d7 05 00 ff ff 01"  # 30001, 30002 (overflow)
EVENT = "68 15 06 00 02 00 1e 01 03 00 fb 0b 04 00 00 01 00 00 0d 0d 13 02 19"
ACT_TERM = "68 0e 08 00 02 00 64 01 0a 00 fb 0b 00 00 00 14"
REFUSAL = "68 0e 00 00 02 00 64 01 47 00 fb 0b 00 00 00 14"


class ScriptedStation:
    """Confirms STARTDT, answers the first request with given bytes, and keeps what it is sent."""

    def __init__(self, answer: bytes) -> None:
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.address = self._listener.getsockname()
        self._answer = answer
        self.received = b""
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def _serve(self) -> None:
        connection, _ = self._listener.accept()
        with connection:
            self.received += connection.recv(6, socket.MSG_WAITALL)
            connection.sendall(bytes.fromhex(STARTDT_CON))
            self.received += connection.recv(16, socket.MSG_WAITALL)
            connection.sendall(self._answer)
            while chunk := connection.recv(64):
                self.received += chunk

    def end(self) -> None:
        """After the controlling station has left."""
        self._thread.join(timeout=10)
        self._listener.close()


def test_interrogation() -> None:
    answer = " ".join((ACT_CON, SINGLE_POINTS, SCALED_SEQUENCE, EVENT, ACT_TERM))
    station = ScriptedStation(bytes.fromhex(answer))
    with RawMaster(*station.address) as master:
        interrogation = master.interrogate(3067)
    station.end()
    brought = [(found.ioa, found.value, found.quality) for found in interrogation.objects]
    assert brought == [(1, 1, 0), (10001, 0, 0x80), (30001, 1495, 0), (30002, -1, 1)]
    assert all(found.ca == 3067 for found in interrogation.objects)
    assert interrogation.begun_ns < interrogation.objects[0].arrived_ns <= interrogation.ended_ns
    sent = "68 04 07 00 00 00  68 0e 00 00 00 00 64 01 06 00 fb 0b 00 00 00 14  68 04 01 00 0a 00"
    assert station.received == bytes.fromhex(sent)


def test_refused_interrogation() -> None:
    station = ScriptedStation(bytes.fromhex(REFUSAL))
    with RawMaster(*station.address) as master, pytest.raises(StationError, match="CA 3067 refused"):
        master.interrogate(3067)
    station.end()


def test_lost_i_frame() -> None:
    station = ScriptedStation(bytes.fromhex(ACT_CON + SCALED_SEQUENCE))
    with RawMaster(*station.address) as master, pytest.raises(StationError, match="I frame 2 instead of 1"):
        master.interrogate(3067)
    station.end()


def test_event() -> None:
    (found,) = Asdu.parse(bytes.fromhex(EVENT)[6:], arrived_ns=5).objects()
    recorded_at = datetime.datetime(2025, 2, 19, 13, 13, tzinfo=datetime.UTC)
    assert found == Object(
        type=30, cause=3, ca=3067, ioa=4, value=1, quality=0, arrived_ns=5, recorded_at=recorded_at
    )


def test_objects_that_do_not_fill_their_asdu() -> None:
    with pytest.raises(StationError, match="type 11 with 2 objects in 8 octets"):
        Asdu.parse(bytes.fromhex(SCALED_SEQUENCE)[6:-1], arrived_ns=0).objects()


# ---- the age of data -----------------------------------------------------------------------------


def scan(first_ns: int, value: int) -> Iterator[Frame]:
    """A request of input register 0, and its answer 10 ms later."""
    common = {"number": 0, "time": "", "port": 3, "unit": 67, "text": ""}
    yield Frame(**common, kind="received", monotonic_ns=first_ns)
    yield Frame(
        **common, kind="reading", monotonic_ns=first_ns, table="input_registers", address=0, value=value
    )
    yield Frame(**common, kind="sent", monotonic_ns=first_ns + 10_000_000)


def arrived(value: int, arrived_ns: int) -> Object:
    return Object(type=11, cause=20, ca=3067, ioa=30001, value=value, quality=0, arrived_ns=arrived_ns)


READINGS = readings_of([*scan(100_000_000, 7), *scan(200_000_000, 0xFFFF), *scan(300_000_000, 0xFFFF)])[30001]


@pytest.mark.parametrize(
    ("value", "arrived_ns", "expected_ms"),
    [
        (7, 150_000_000, 50),
        (7, 250_000_000, 150),  # the gateway had not taken the next one yet
        (-1, 305_000_000, 105),  # the third answer is not yet on the line
        (-1, 311_000_000, 11),
        (7, 105_000_000, 5),  # its sending was noted too late
    ],
)
def test_age_counts_from_the_reading(value: int, arrived_ns: int, expected_ms: float) -> None:
    assert age_ms(arrived(value, arrived_ns), READINGS) == expected_ms


def test_value_that_was_never_read() -> None:
    with pytest.raises(StationError, match="IOA 30001 = 8"):
        age_ms(arrived(8, 250_000_000), READINGS)


# ---- the table -----------------------------------------------------------------------------------


def test_table() -> None:
    rows = [
        Row("time", Spread("ms", [0.25, 0.5, 1.25]), Spread("ms", [200, 100])),
        Row("memory", Memory(rss=30, pss=20, private=10), None),
    ]
    assert table(rows).splitlines() == [
        "| measured | n     | ours                            | report's method   | ours / report's |",
        "|----------|-------|---------------------------------|-------------------|-----------------|",
        "| time     | 3 / 2 | 0.5 ms (0.25..1.25)             | 150 ms (100..200) | 0.0033          |",
        "| memory   |       | PSS 20 KiB (RSS 30, private 10) |                   |                 |",
    ]


@pytest.mark.slow
def test_the_bench_runs_through(programs: Path, tmp_path: Path) -> None:
    """Every row is measured on both sides; how fast is no test's business."""
    bench = [sys.executable, Path(__file__).with_name("bench.py"), "--quick", "--output", tmp_path]
    environment = os.environ | {"PYTHONPATH": str(REPOSITORY / "scripts")}
    run = subprocess.run(bench, env=environment, capture_output=True, text=True, timeout=120, check=False)
    assert (run.returncode, run.stderr) == (0, "")
    rows = json.loads((tmp_path / "bench.json").read_text())["rows"]
    assert {row["measured"][:3] for row in rows} == {"(a)", "(b)", "(c)", "(d)"}
    assert (tmp_path / "bench.md").read_text().count("\n| (") == len(rows)


@pytest.mark.slow
def test_the_bench_of_stations_runs_through(programs: Path) -> None:
    """No cell is empty: no frame was lost on either side, at the lowest rate."""
    bench = [sys.executable, Path(__file__).with_name("stations.py"), "--quick"]
    environment = os.environ | {"PYTHONPATH": str(REPOSITORY / "scripts"), "OPENRTU_BUILD": str(programs)}
    run = subprocess.run(bench, env=environment, capture_output=True, text=True, timeout=120, check=False)
    assert (run.returncode, run.stderr) == (0, "")
    rows = [line.strip("|").split("|") for line in run.stdout.splitlines() if line.startswith("| ")][2:]
    assert len(rows) == 16
    (kept,) = (row for row in rows if "master that is away" in row[0])
    assert kept[1].strip() == "10000"
    assert all(cell.strip() for row in rows[:9] for cell in row)


def test_lib60870_must_be_there_and_built(programs: Path, tmp_path: Path) -> None:
    """It is on no registry: whoever names a folder is told what is wrong with it."""
    with pytest.raises(BenchError, match=f"{tmp_path} is no checkout of lib60870"):
        lib60870(tmp_path, tmp_path)
    (tmp_path / "lib60870-C" / "src" / "inc" / "api").mkdir(parents=True)
    with pytest.raises(BenchError, match=r"has no library in build: type `cmake -S"):
        lib60870(tmp_path, tmp_path)
    library = tmp_path / "lib60870-C" / "build" / "src" / "liblib60870.a"
    library.parent.mkdir(parents=True)
    library.write_bytes(b"!<arch>\n")
    with pytest.raises(BenchError, match=r"lib60870_station.c cannot be built with .*liblib60870.a"):
        lib60870(tmp_path, tmp_path)


@pytest.mark.slow
def test_the_bench_of_a_reload_runs_through(programs: Path) -> None:
    bench = [sys.executable, Path(__file__).with_name("reload.py"), "--quick"]
    environment = os.environ | {"PYTHONPATH": str(REPOSITORY / "scripts"), "OPENRTU_BUILD": str(programs)}
    run = subprocess.run(bench, env=environment, capture_output=True, text=True, timeout=180, check=False)
    assert run.returncode == 0, run.stderr
    rows = [line.strip("|").split("|") for line in run.stdout.splitlines() if line.startswith("| ")][1:]
    assert [len(row) for row in rows] == [2] * 5
    assert all(cell.strip() for row in rows for cell in row)


@pytest.mark.slow
def test_the_bench_of_lines_runs_through(programs: Path) -> None:
    """No cell is empty: all who poll have their answers."""
    bench = [sys.executable, Path(__file__).with_name("lines.py"), "--quick"]
    environment = os.environ | {"PYTHONPATH": str(REPOSITORY / "scripts"), "OPENRTU_BUILD": str(programs)}
    run = subprocess.run(bench, env=environment, capture_output=True, text=True, timeout=180, check=False)
    assert run.returncode == 0, run.stderr
    rows = [line.strip("|").split("|") for line in run.stdout.splitlines() if line.startswith("| ")][1:]
    assert [len(row) for row in rows] == [6] * 8
    assert all(cell.strip() for row in rows for cell in row)
