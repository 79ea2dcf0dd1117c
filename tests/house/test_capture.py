# SPDX-License-Identifier: GPL-3.0-or-later
"""The recorder: what it carries unchanged, and that what it does not understand is found."""

import socket
import threading
from pathlib import Path

import pytest

from rig.bare import STARTDT, STARTDT_CON, TESTFR, s_frame
from rig.capture import Connection, Relay, dissect

SOUND = bytes.fromhex("68 0e 00 00 00 00 01 01 03 00 fb 0b 04 00 00 01")
TWO_OBJECTS_OF_WHICH_ONE_IS_THERE = bytes.fromhex("68 0e 02 00 00 00 01 02 03 00 fb 0b 04 00 00 01")


def recorded_talk(answer: bytes, request: bytes = STARTDT) -> list[Connection]:
    """A master sends a request octet by octet; a station answers in one piece, and closes."""
    record: list[Connection] = []
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def serve() -> None:
            station, _ = listener.accept()
            with station:
                assert station.recv(len(request), socket.MSG_WAITALL) == request
                station.sendall(answer)

        station = threading.Thread(target=serve)
        station.start()
        relay = Relay(listener.getsockname(), record)
        with socket.create_connection(relay.address, 5) as master:
            for octet in request:
                master.sendall(bytes([octet]))
            received = b""
            while piece := master.recv(4096):
                received += piece
        station.join()
        relay.close()
    assert received == answer
    return record


@pytest.mark.slow
def test_sound_frames(tmp_path: Path) -> None:
    record = recorded_talk(STARTDT_CON + SOUND + TESTFR, STARTDT + s_frame(0))
    assert dissect(record, tmp_path / "pcap") == (5, [])
    assert record[0].closed_by_station


@pytest.mark.slow
@pytest.mark.parametrize("frame", [TWO_OBJECTS_OF_WHICH_ONE_IS_THERE, b"\x67\x04\x01\x00\x00\x00"])
def test_wrong_frame_of_the_station(tmp_path: Path, frame: bytes) -> None:
    count, findings = dissect(recorded_talk(SOUND + frame), tmp_path / "pcap")
    assert count == 3
    assert [(f.by_station, f.allowed, f.frame) for f in findings] == [(True, False, frame)]


@pytest.mark.slow
def test_wrong_frame_of_the_master_that_is_answered_by_closing(tmp_path: Path) -> None:
    _, findings = dissect(recorded_talk(b"", TWO_OBJECTS_OF_WHICH_ONE_IS_THERE), tmp_path / "pcap")
    assert [(f.by_station, f.allowed) for f in findings] == [(False, True)]


@pytest.mark.slow
def test_wrong_frame_of_the_master_that_is_refused(tmp_path: Path) -> None:
    request = bytes.fromhex("68 0f 00 00 00 00 2d 01 06 00 fb 0b 04 00 00 01 aa")
    refusal = bytes.fromhex("68 0e 00 00 02 00 2d 01 47 00 fb 0b 04 00 00 01")
    connection = Connection("a test", [(False, request), (True, refusal)])
    _, findings = dissect([connection], tmp_path / "pcap")
    assert [(f.by_station, f.allowed) for f in findings] == [(False, True)]
    confirmation = refusal.replace(b"\x47", b"\x07")
    _, findings = dissect([Connection("a test", [(False, request), (True, confirmation)])], tmp_path / "pcap")
    assert [(f.by_station, f.allowed) for f in findings] == [(False, False)]


@pytest.mark.slow
def test_wrong_frame_of_the_master_that_is_borne(tmp_path: Path) -> None:
    connection = Connection("a test", [(False, TWO_OBJECTS_OF_WHICH_ONE_IS_THERE), (True, STARTDT_CON)])
    _, findings = dissect([connection], tmp_path / "pcap")
    assert [(f.by_station, f.allowed) for f in findings] == [(False, False)]


def test_connection_that_the_master_closes() -> None:
    record: list[Connection] = []
    with socket.create_server(("127.0.0.1", 0)) as listener:
        relay = Relay(listener.getsockname(), record)
        with socket.create_connection(relay.address, 5) as master:
            station, _ = listener.accept()
            master.sendall(STARTDT)
            assert station.recv(len(STARTDT), socket.MSG_WAITALL) == STARTDT
        assert station.recv(1) == b""
        station.close()
        relay.close()
    assert record[0].closed_by_station is False


@pytest.mark.slow
def test_encrypted_connection_is_left_out(tmp_path: Path) -> None:
    assert dissect([Connection("a test", [(False, b"\x16\x03\x01\x00\x05hello")])], tmp_path / "pcap") == (
        0,
        [],
    )
