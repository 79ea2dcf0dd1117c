# SPDX-License-Identifier: GPL-3.0-or-later
"""The bench of moods: each contender finds a device without moods good, and a device is as its mood says."""

import socket
import time

import pytest
from moods import (
    HEADINGS,
    MOODS,
    LibmodbusLoop,
    Loop,
    Mood,
    PymodbusLoop,
    TcpDevice,
    by_gateway,
    by_loop,
    sealed,
    table,
)

READ = bytes.fromhex("000100000006010300000004")
PLAIN = (Mood("none"), Mood("RTU", serial=True))


@pytest.mark.parametrize("kind", [PymodbusLoop, LibmodbusLoop])
def test_a_loop_reads_what_has_no_moods(kind: type[Loop]) -> None:
    assert min(by_loop(kind, PLAIN, 1.0)) > 0


def test_the_gateway_reads_what_has_no_moods(programs: None) -> None:
    assert min(by_gateway(PLAIN, 3.0)[1]) > 0


def test_a_device_is_as_its_mood_says() -> None:
    with TcpDevice(Mood("pause", pause_s=5.0)) as device, socket.create_connection(device.address) as client:
        client.settimeout(30.0)
        client.sendall(READ)
        assert len(client.recv(64)) == 17
        client.settimeout(0.3)
        client.sendall(READ)
        with pytest.raises(TimeoutError):
            client.recv(64)
    with TcpDevice(Mood("idle", idle_s=0.2)) as device, socket.create_connection(device.address) as client:
        client.settimeout(30.0)
        begun = time.monotonic()
        assert client.recv(64) == b""
        assert time.monotonic() - begun >= 0.15


def test_the_table_has_a_row_for_each_mood() -> None:
    lines = table(MOODS, [[0.5] * len(MOODS)] * (len(HEADINGS) - 1)).splitlines()
    assert len(lines) == 2 + len(MOODS)
    assert len({len(line) for line in lines}) == 1


def test_crc_is_that_of_the_standard() -> None:
    assert sealed(bytes.fromhex("010300000004")) == bytes.fromhex("0103000000044409")
