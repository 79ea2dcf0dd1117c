# SPDX-License-Identifier: GPL-3.0-or-later
"""Information objects as a controlling station reads them, out of what lib60870's server (c104) sends."""

import datetime
import json
import socket
import struct
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import c104
import pytest

from lab.gateway import free_port

CA = 47
STARTDT_ACT = bytes((0x68, 4, 0x07, 0, 0, 0))
AT = datetime.datetime(2005, 3, 16, 9, 38, 2, 250_000, tzinfo=datetime.UTC)
AT_NS = 1_110_965_882_250_000_000
BAD = c104.Quality.Invalid | c104.Quality.NonTopical
BAD_BITS = 0xC0
EVENT_ON = 2

Object = dict[str, Any]


def bits_of(value: float) -> int:
    return struct.unpack("<I", struct.pack("<f", value))[0]


# Of each kind: the name without time tag and with one, c104's information, what is decoded of it.
KINDS: list[tuple[str, str, Any, Object]] = [
    ("M_SP_NA_1", "M_SP_TB_1", lambda **t: c104.SingleInfo(True, BAD, **t), {"u": 1, "quality": BAD_BITS}),
    (
        "M_DP_NA_1",
        "M_DP_TB_1",
        lambda **t: c104.DoubleInfo(c104.Double.ON, BAD, **t),
        {"u": 2, "quality": BAD_BITS},
    ),
    (
        "M_ST_NA_1",
        "M_ST_TB_1",
        lambda **t: c104.StepInfo(c104.Int7(-40), True, BAD, **t),
        {"i": -40, "detail": 1, "quality": BAD_BITS},
    ),
    (
        "M_BO_NA_1",
        "M_BO_TB_1",
        lambda **t: c104.BinaryInfo(c104.Byte32(0x92345678), BAD, **t),
        {"u": 0x92345678, "quality": 0},  # c104 2.2.1 sends a bit string's quality as good
    ),
    (
        "M_ME_NA_1",
        "M_ME_TD_1",
        lambda **t: c104.NormalizedInfo(c104.NormalizedFloat(-0.5), BAD, **t),
        {"i": -16384, "quality": BAD_BITS},
    ),
    (
        "M_ME_NB_1",
        "M_ME_TE_1",
        lambda **t: c104.ScaledInfo(c104.Int16(-1495), BAD, **t),
        {"i": -1495, "quality": BAD_BITS},
    ),
    (
        "M_ME_NC_1",
        "M_ME_TF_1",
        lambda **t: c104.ShortInfo(1.5, BAD, **t),
        {"u": bits_of(1.5), "quality": BAD_BITS},
    ),
    (
        "M_IT_NA_1",
        "M_IT_TB_1",
        lambda **t: c104.BinaryCounterInfo(-123456, c104.UInt5(17), c104.BinaryCounterQuality.Invalid, **t),
        {"i": -123456, "detail": 17, "quality": 0x80},
    ),
    (
        "M_ME_ND_1",
        "",
        lambda **t: c104.NormalizedInfo(c104.NormalizedFloat(0.25), **t),
        {"i": 8192, "quality": 0},
    ),
    (
        "",
        "M_EP_TD_1",
        lambda **t: c104.ProtectionEventInfo(c104.EventState.ON, c104.UInt16(1234), BAD, **t),
        {"u": EVENT_ON, "elapsed_ms": 1234, "quality": BAD_BITS},
    ),
    (
        "",
        "M_EP_TE_1",
        lambda **t: c104.ProtectionStartInfo(
            c104.StartEvents.General | c104.StartEvents.PhaseL3, c104.UInt16(77), BAD, **t
        ),
        {"u": 0b1001, "elapsed_ms": 77, "quality": BAD_BITS},
    ),
    (
        "",
        "M_EP_TF_1",
        lambda **t: c104.ProtectionCircuitInfo(c104.OutputCircuits.PhaseL1, c104.UInt16(9), BAD, **t),
        {"u": 0b0010, "elapsed_ms": 9, "quality": BAD_BITS},
    ),
]
CASES = [
    (name, make, tag, expected)
    for plain, tagged, make, expected in KINDS
    for name, tag in ((plain, {}), (tagged, {"recorded_at": AT}))
    if name
]


def asdus_of(connection: socket.socket, count: int) -> list[bytes]:
    """The ASDUs of the first I frames."""
    stream, found, deadline = b"", [], time.monotonic() + 60
    while len(found) < count:
        assert time.monotonic() < deadline, found
        while len(stream) >= 2 and len(stream) >= stream[1] + 2:
            frame, stream = stream[: stream[1] + 2], stream[stream[1] + 2 :]
            if not frame[2] & 1:
                found.append(frame[6:])
                connection.sendall(struct.pack("<BBHH", 0x68, 4, 1, len(found) << 1))
        if len(found) < count:
            received = connection.recv(4096)
            assert received, "the server closed"
            stream += received
    return found


@pytest.fixture(scope="module")
def objects(programs: Path) -> Iterator[dict[int, Object]]:
    """What our decoder makes of what the server sends, by address: the number of the case."""
    port = free_port()
    server = c104.Server(ip="127.0.0.1", port=port, tick_rate_ms=100)
    station = server.add_station(common_address=CA)
    points = [
        station.add_point(io_address=number, type=getattr(c104.Type, name))
        for number, (name, *_) in enumerate(CASES, 1)
    ]
    server.start()
    try:
        with socket.create_connection(("127.0.0.1", port), 30) as connection:
            connection.settimeout(30)
            connection.sendall(STARTDT_ACT)
            assert connection.recv(6)[2] == 0x0B  # STARTDT con
            asdus = []
            for point, (_, make, tag, _) in zip(points, CASES, strict=True):
                point.info = make(**tag)
                assert point.transmit(cause=c104.Cot.SPONTANEOUS)
            asdus = asdus_of(connection, len(CASES))
    finally:
        server.stop()
    command = [programs / "iec104" / "iec104-decode", str(AT_NS)]
    octets = b"".join(b"%d\n" % len(asdu) + asdu for asdu in asdus)
    done = subprocess.run(command, input=octets, capture_output=True, check=True)
    yield {found["ioa"]: found for found in map(json.loads, done.stdout.splitlines())}


@pytest.mark.parametrize("number", range(1, len(CASES) + 1), ids=[case[0] for case in CASES])
def test_what_the_server_says(objects: dict[int, Object], number: int) -> None:
    name, _, tag, expected = CASES[number - 1]
    found = objects[number]
    assert {key: found[key] for key in expected} == expected
    assert found["type"] == int(getattr(c104.Type, name).value)
    assert bool(found["tagged"]) == bool(tag)
    assert found["wall_ns"] == (AT_NS if tag else 0)
    assert not found["time_invalid"]
