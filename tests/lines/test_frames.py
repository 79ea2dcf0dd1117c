# SPDX-License-Identifier: GPL-3.0-or-later
"""rtuctl frames: what went over a line, as the device saw it, in words, and as Wireshark reads it."""

import json
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from test_modbus_tcp import Server, gateway_of, slave, tcp_port, wait_good

from lab.linesim import Frame
from rig.desk import Substation, everything_read, gateway_on_lines, patience

pytestmark = pytest.mark.slow  # as a whole

DEVICE = "1.5"
WAIT_S = 60.0
PACE = {"baud_rate": 19200, "data_bits": 8, "stop_bits": 1, "parity": 0}
SENT, RECEIVED = "sent", "received"
TCP_ADDRESS, TCP_UNIT = 7, 3


def configuration() -> dict[str, Any]:
    objects = {"coils": [{"address": 3}], "holding_registers": [{"address": 107}]}
    slaves = [{"id": 5, **patience(), "period_ms": 300, **objects}]
    return {"iec104": {}, "port": [{"value": 1, "active": 1, **PACE, "slaves": slaves}]}


@pytest.fixture(scope="module")
def running(programs: Path) -> Iterator[Substation]:
    with gateway_on_lines(configuration(), programs, {}) as (lines, gateway):
        gateway.wait_for(lambda: everything_read(gateway), WAIT_S, "all that is read has been read")
        yield Substation(lines, gateway)


def rtuctl(running: Substation, *words: str) -> subprocess.CompletedProcess[bytes]:
    program = running.gateway.build / "rtuctl/rtuctl"
    command = [program, "--map", running.gateway.map, *words]
    return subprocess.run(command, capture_output=True, timeout=WAIT_S, check=False)


def frames(running: Substation, *words: str) -> list[dict[str, Any]]:
    done = rtuctl(running, "--json", "frames", *words)
    assert (done.returncode, done.stderr) == (0, b"")
    return [json.loads(line) for line in done.stdout.splitlines()]


def octets_of(rows: list[dict[str, Any]], direction: str) -> list[bytes]:
    return [bytes.fromhex(row["octets"]) for row in rows if row["direction"] == direction]


def test_frames_are_those_that_the_device_saw(running: Substation) -> None:
    seen: list[Frame] = running.lines.frames(0)
    asked = [frame.bytes for frame in seen if frame.kind == RECEIVED]
    answered = [frame.bytes for frame in seen if frame.kind == SENT]
    rows = frames(running, "1")
    assert len(asked) > 3
    assert octets_of(rows, SENT)[: len(asked)] == asked
    assert octets_of(rows, RECEIVED)[: len(answered)] == answered
    assert [row["time"] for row in rows] == sorted(row["time"] for row in rows)
    assert {row["port"] for row in rows} == {1}


def test_a_command_stands_there_in_words(running: Substation) -> None:
    running.gateway.ctl("set", f"p{DEVICE}.c3", "on")
    texts = [row["text"] for row in frames(running)]
    assert texts.index("unit 5: write coil 3 on") < texts.index("unit 5: has written coil 3 on")
    assert "unit 5: read 1 holding register from 107" in texts
    assert "unit 5: holding register 0" in texts


def test_the_table_has_the_newest(running: Substation) -> None:
    lines = rtuctl(running, "frames", "--count", "2").stdout.decode().splitlines()
    assert len(lines) == 2
    time, port, direction, *octets = lines[0].split()
    assert (len(time), port, direction in "<>", octets[0]) == (27, "1", True, "05")


def test_following_ends_with_the_count(running: Substation) -> None:
    before = len(frames(running))
    rows = frames(running, "--follow", "--count", str(before + 4))
    assert len(rows) == before + 4
    assert len({(row["time"], row["octets"]) for row in rows}) == before + 4  # none twice


def test_a_device_that_is_silent_is_asked_and_does_not_answer(running: Substation) -> None:
    running.lines.fault(DEVICE, "mute")
    gateway = running.gateway
    gateway.wait_for(lambda: not everything_read(gateway), WAIT_S, "the device is lost")
    assert [row["direction"] for row in frames(running, "--count", "2")] == [SENT, SENT]
    running.lines.fault(DEVICE, "clear")
    gateway.wait_for(lambda: everything_read(gateway), WAIT_S, "the device is back")


# ---- Wireshark ----------------------------------------------------------------------------------------


def as_tshark_reads(file: Path, *fields: str) -> list[list[str]]:
    chosen = [word for field in fields for word in ("-e", field)]
    command = ["tshark", "-r", file, "-o", "mbrtu.crc_verification:TRUE", "-T", "fields", *chosen]
    done = subprocess.run(command, capture_output=True, text=True, timeout=WAIT_S, check=True)
    return [line.split("\t") for line in done.stdout.splitlines()]


def test_wireshark_reads_them(running: Substation, tmp_path: Path) -> None:
    file = tmp_path / "line.pcapng"
    done = rtuctl(running, "frames", "--pcapng", str(file))
    assert (done.returncode, done.stdout, done.stderr) == (0, b"", b"")
    read = as_tshark_reads(
        file, "frame.interface_name", "mbrtu.crc16.status", "mbrtu.unit_id", "modbus.func_code"
    )
    good_crc, read_registers = "1", "3"
    sound = [fields for fields in read if fields[1] == good_crc]
    assert {fields[0] for fields in read} == {"port 1"}
    assert {fields[2] for fields in sound} == {"5"}
    assert len(sound) > len(read) / 2  # a starved host cuts a frame now and then
    assert read_registers in {fields[3] for fields in sound}
    # A request has an address and a count, an answer the number of its octets.
    fields = as_tshark_reads(file, "modbus.reference_num", "modbus.word_cnt", "modbus.byte_cnt")
    assert ["107", "1", ""] in fields
    assert ["", "", "2"] in fields or ["107", "", "2"] in fields


def test_wireshark_reads_those_of_a_connection(programs: Path, tmp_path: Path) -> None:
    file = tmp_path / "lines.pcapng"
    with (
        Server() as server,
        gateway_of(programs, tcp_port(7, server, [slave(TCP_UNIT, TCP_ADDRESS)])) as gateway,
    ):
        wait_good(gateway, f"p7.{TCP_UNIT}.*")
        gateway.ctl("frames", "--pcapng", str(file))
    read = as_tshark_reads(file, "frame.interface_name", "frame.protocols", "mbtcp.trans_id")
    protocols = {name: chain.split(":")[1] for name, chain, _ in read}
    assert protocols == {"port 1": "mbrtu", "port 7": "mbtcp"}
    numbers = [int(fields[2]) for fields in read if fields[2]]
    assert numbers[:2] == [1, 1]


# ---- mistakes -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["frames", "9"], 1, 'no line has port 9: "rtuctl lines" lists them'),
        (["frames", "--pcapng", "/nowhere/file"], 2, "/nowhere/file: No such file or directory"),
        (["frames", "--pcapng", "/dev/full"], 1, "/dev/full: No space left on device"),
        (["--json", "frames", "--pcapng", "x"], 2, "frames takes --pcapng or --json, not both"),
        (["lines", "--follow"], 2, "lines takes no --follow"),
        (["points", "--pcapng", "x"], 2, "points takes no --pcapng"),
    ],
)
def test_mistakes(running: Substation, words: list[str], code: int, said: str) -> None:
    done = rtuctl(running, *words)
    assert (done.returncode, done.stdout) == (code, b"")
    assert said in done.stderr.decode()
