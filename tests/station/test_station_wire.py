# SPDX-License-Identifier: GPL-3.0-or-later
"""The controlled station octet by octet, on bare sockets: what c104 does not show or does not send."""

import contextlib
import datetime
import socket
import struct
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from lab.raw_master import RawMaster, StationError, new_source
from lab.show import DEVICE, FIGURE_5_5, STATION
from rig.bare import Bare
from rig.cp56 import cp56
from rig.desk import Desk, chapter_5, desk_of, gateway_on_lines, processor_seconds, wait_still

C_SC, C_DC, C_RD, C_CS, C_TS = 45, 46, 102, 103, 107
ACT_CON, DEACT, DEACT_CON, ACT_TERM = 7, 8, 9, 10
NEGATIVE, TEST = 0x40, 0x80
ON, SELECT = b"\x01", 0x80
LATE_S = 60.0  # an answer on a busy host


@pytest.fixture
def master(desk: Desk) -> Iterator[RawMaster]:
    with RawMaster(*desk.gateway.address) as master:
        yield master


def writes(desk: Desk, since: int) -> list[bytes]:
    """What the lines were asked to write."""
    return [
        f.bytes for f in desk.lines.frames(since) if f.kind == "received" and f.bytes[1] in (5, 6, 15, 16)
    ]


def assert_silent(master: RawMaster, kind: int) -> None:
    """No second reply: the next of the station's answers is to the next request."""
    master.request(C_TS, STATION, 0, b"\xaa\x55" + cp56(datetime.datetime(2026, 1, 1)))
    with pytest.raises(StationError, match=f"answer of type {kind}"):
        master.answer(kind, timeout_s=0.2)


# ---- commands -------------------------------------------------------------------------------------


def test_command_is_confirmed_after_the_device_and_terminated(desk: Desk, master: RawMaster) -> None:
    mark = desk.lines.mark()
    master.request(C_SC, STATION, 4, ON, originator=7)
    confirmation, end = master.answer(C_SC), master.answer(C_SC)
    answered = desk.lines.wait_frame(lambda f: f.kind == "sent" and f.bytes == FIGURE_5_5, since=mark)
    assert answered.monotonic_ns < confirmation.arrived_ns
    assert [(a.cause, a.originator, a.ca, a.body) for a in (confirmation, end)] == [
        (ACT_CON, 7, STATION, b"\x04\x00\x00\x01"),
        (ACT_TERM, 7, STATION, b"\x04\x00\x00\x01"),
    ]


def test_select_before_operate(desk: Desk, master: RawMaster) -> None:
    on = bytes([2])
    master.request(C_DC, 1010, 1, on)
    assert master.answer(C_DC).cause == ACT_CON | NEGATIVE  # not selected
    master.request(C_DC, 1010, 1, bytes([SELECT | 2]))
    selected = master.answer(C_DC)
    assert (selected.cause, selected.body[3]) == (ACT_CON, SELECT | 2)
    with RawMaster(*desk.gateway.address) as stranger:
        stranger.request(C_DC, 1010, 1, on)
        assert stranger.answer(C_DC).cause == ACT_CON | NEGATIVE
    master.request(C_DC, 1010, 1, on)
    assert [master.answer(C_DC).cause, master.answer(C_DC).cause] == [ACT_CON, ACT_TERM]
    assert [desk.lines.get("1.10", "coils", address) for address in (0, 1)] == [0, 1]


def test_selection_is_deactivated(desk: Desk, master: RawMaster) -> None:
    mark = desk.lines.mark()
    master.request(C_DC, 1010, 1, bytes([SELECT | 1]))
    assert master.answer(C_DC).cause == ACT_CON
    master.request(C_DC, 1010, 1, bytes([SELECT | 1]), cause=DEACT)
    assert master.answer(C_DC).cause == DEACT_CON
    master.request(C_DC, 1010, 1, bytes([1]))
    assert master.answer(C_DC).cause == ACT_CON | NEGATIVE
    assert not writes(desk, mark)


def test_selection_ends_with_its_connection(desk: Desk, master: RawMaster) -> None:
    with RawMaster(*desk.gateway.address) as leaving:
        leaving.request(C_DC, 1010, 1, bytes([SELECT | 1]))
        assert leaving.answer(C_DC).cause == ACT_CON
        master.request(C_DC, 1010, 1, bytes([SELECT | 1]))
        assert master.answer(C_DC).cause == ACT_CON | NEGATIVE

    def selected() -> bool:
        master.request(C_DC, 1010, 1, bytes([SELECT | 1]))
        return master.answer(C_DC).cause == ACT_CON

    desk.gateway.wait_for(selected, 60.0, "the point can be selected again")
    master.request(C_DC, 1010, 1, bytes([SELECT | 1]), cause=DEACT)
    assert master.answer(C_DC).cause == DEACT_CON


def test_test_bit_is_confirmed_and_nothing_is_executed(desk: Desk, master: RawMaster) -> None:
    mark = desk.lines.mark()
    master.request(C_SC, STATION, 4, ON, cause=6 | TEST)
    assert master.answer(C_SC).cause == ACT_CON | TEST
    desk.wait_scan(DEVICE)
    assert not writes(desk, mark)


@pytest.mark.parametrize(
    ("kind", "ca", "ioa", "element", "cause", "reply"),
    [
        pytest.param(99, STATION, 1, b"\x00", 6, 44, id="unknown type"),
        pytest.param(C_SC, STATION, 4, ON, 5, 45, id="unknown cause"),
        pytest.param(C_SC, 3068, 4, ON, 6, 46, id="unknown station"),
        pytest.param(C_SC, STATION, 77, ON, 6, 47, id="unknown object"),
        pytest.param(C_RD, STATION, 77, b"", 5, 47, id="read of an unknown object"),
        pytest.param(100, STATION, 1, b"\x14", 6, 47, id="interrogation with an address"),
    ],
)
def test_refusal_is_one_mirrored_reply(
    master: RawMaster, kind: int, ca: int, ioa: int, element: bytes, cause: int, reply: int
) -> None:
    master.request(kind, ca, ioa, element, cause=cause, originator=3)
    refusal = master.answer(kind)
    assert (refusal.cause, refusal.originator, refusal.ca) == (reply | NEGATIVE, 3, ca)
    assert refusal.body == ioa.to_bytes(3, "little") + element
    assert_silent(master, kind)


@pytest.mark.parametrize(
    ("request_", "reply"),
    [
        pytest.param("2d 01 06 00 fb0b 040000 01 aa", "2d 01 47 00 fb0b 040000 01", id="an octet too many"),
        pytest.param("2d 81 06 00 fb0b 040000 01", "2d 81 47 00 fb0b 040000 01", id="SQ = 1"),
        pytest.param(
            "2d 02 06 00 fb0b 040000 01 040000 00", "2d 02 47 00 fb0b 040000 01 040000 00", id="two objects"
        ),
    ],
)
def test_command_of_other_than_one_object_is_refused(desk: Desk, request_: str, reply: str) -> None:
    mark = desk.lines.mark()
    with Bare(desk.gateway.address) as master:
        master.start()
        master.ask(bytes.fromhex(request_))
        assert master.asdus_until(b"\x2d")[-1] == bytes.fromhex(reply)
        master.ask(bytes.fromhex("2d 01 06 00 fb0b 040000 01"))  # the connection goes on
        assert master.asdus_until(b"\x2d")[-1][2] == ACT_CON
        assert len(writes(desk, mark)) == 1


def test_double_command_without_a_state_is_refused(desk: Desk, master: RawMaster) -> None:
    mark = desk.lines.mark()
    for state in (0, 3):
        master.request(C_DC, 1010, 1, bytes([state]))
        assert master.answer(C_DC).cause == ACT_CON | NEGATIVE
    assert not writes(desk, mark)


# ---- the clock --------------------------------------------------------------------------------------


def test_clock_synchronisation_dates_events_and_nothing_else(desk: Desk, master: RawMaster) -> None:
    system = time.time() - time.monotonic()
    future = datetime.datetime(2035, 2, 28, 23, 59, 30)
    try:
        master.request(C_CS, STATION, 0, cp56(future))
        assert master.answer(C_CS).cause == ACT_CON
        since = desk.master.mark()
        desk.set_and_scan(DEVICE, "input_registers", 1, [4321])
        report = desk.master.wait(lambda r: (r.ioa, r.value) == (30002, 4321), since)
        assert report.recorded_at is not None
        passed = report.recorded_at.replace(tzinfo=None) - future
        assert datetime.timedelta(0) <= passed < datetime.timedelta(seconds=20)
        assert abs(time.time() - time.monotonic() - system) < 0.05
    finally:
        desk.master.synchronise_clock(STATION)


@pytest.mark.parametrize(
    "octets", [b"\x60\xea\x00\x00\x01\x01\x1a", b"\x00\x00\x80\x00\x01\x01\x1a", b"\x00" * 7]
)
def test_impossible_time_is_refused(master: RawMaster, octets: bytes) -> None:
    master.request(C_CS, STATION, 0, octets)
    assert master.answer(C_CS).cause & NEGATIVE


@pytest.mark.slow
def test_only_listed_masters_set_the_clock(programs: Path) -> None:
    config = chapter_5()
    config["iec104"]["clock_masters"] = ["192.0.2.1"]
    now = cp56(datetime.datetime.now(datetime.UTC))
    # desk_of synchronises the clock, which is refused here.
    with pytest.raises(Exception, match="refused the clock synchronisation"), desk_of(config, programs):
        pass
    config["iec104"]["clock_masters"].append("127.0.0.1")
    with (
        desk_of(config, programs) as desk,
        RawMaster(*desk.gateway.address, source="127.0.0.1") as master,
    ):
        master.request(C_CS, STATION, 0, now)
        assert master.answer(C_CS).cause == ACT_CON


# ---- the session ------------------------------------------------------------------------------------


@pytest.fixture
def connection(desk: Desk) -> Iterator[socket.socket]:
    source = (new_source(desk.gateway.address[0]), 0)
    with socket.create_connection(desk.gateway.address, LATE_S, source) as connection:
        yield connection


def received(connection: socket.socket, count: int) -> bytes:
    octets = b""
    while len(octets) < count:
        octets += connection.recv(count - len(octets)) or pytest.fail("closed by the station")
    return octets


def closes(connection: socket.socket) -> bool:
    try:
        while connection.recv(4096):
            pass
    except ConnectionResetError:
        pass
    return True


STARTDT = bytes.fromhex("680407000000")
STARTDT_CON = bytes.fromhex("68040b000000")
STOPDT, STOPDT_CON = bytes.fromhex("680413000000"), bytes.fromhex("680423000000")
TESTFR, TESTFR_CON = bytes.fromhex("680443000000"), bytes.fromhex("680483000000")


def i_frame(sent: int, received: int, asdu: bytes) -> bytes:
    return bytes([0x68, 4 + len(asdu)]) + struct.pack("<HH", sent << 1, received << 1) + asdu


def is_information(frame: bytes) -> bool:
    return frame[2] & 1 == 0


def acknowledge(connection: socket.socket, frame: bytes) -> None:
    """That I frame, and those before it."""
    (sent,) = struct.unpack_from("<H", frame, 2)
    connection.sendall(bytes.fromhex("68040100") + struct.pack("<H", sent + 2))


GI_ALL = bytes.fromhex("640106 00 ffff 000000 14")


def test_control_functions_are_confirmed(connection: socket.socket) -> None:
    """Once transfer is started, events may come before a confirmation, on a busy machine up to k."""

    def is_answered(frames: list[bytes]) -> bool:
        if frames and is_information(frames[-1]):
            acknowledge(connection, frames[-1])
        return confirmation in frames

    for request, confirmation in ((TESTFR, TESTFR_CON), (STARTDT, STARTDT_CON)):
        connection.sendall(request)
        assert received(connection, 6) == confirmation
    for request, confirmation in ((TESTFR, TESTFR_CON), (STOPDT, STOPDT_CON)):
        connection.sendall(request)
        *events, answer = collect_frames(connection, is_answered)
        assert answer == confirmation
        assert all(map(is_information, events))


def test_frames_may_come_octet_by_octet(connection: socket.socket) -> None:
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    for octet in TESTFR + STARTDT:
        connection.sendall(bytes([octet]))
    assert received(connection, 12) == TESTFR_CON + STARTDT_CON


@pytest.mark.slow
@pytest.mark.parametrize(
    "octets",
    [
        pytest.param(b"\x69\x04\x07\x00\x00\x00", id="wrong start"),
        pytest.param(b"\x68\x03\x07\x00\x00", id="too short"),
        pytest.param(b"\x68\xfe" + bytes(254), id="too long"),
        pytest.param(i_frame(0, 0, GI_ALL), id="I frame while stopped"),
        pytest.param(STARTDT + i_frame(5, 0, GI_ALL), id="wrong N(S)"),
        pytest.param(STARTDT + bytes.fromhex("680401000400"), id="N(R) of frames never sent"),
    ],
)
def test_protocol_errors_close_the_connection(desk: Desk, connection: socket.socket, octets: bytes) -> None:
    connection.sendall(octets)
    assert closes(connection)
    assert len(desk.master.interrogate(STATION)) == 13  # the others stay


@pytest.mark.slow
def test_sender_waits_at_k_and_goes_on_after_an_acknowledgement(
    desk: Desk, connection: socket.socket
) -> None:
    connection.sendall(STARTDT + i_frame(0, 0, GI_ALL))
    frames = collect_frames(connection, until=lambda frames: len(frames) == 1 + 12)
    connection.settimeout(0.3)
    with pytest.raises(TimeoutError):
        connection.recv(1)  # k = 12 are out, the interrogation needs more
    connection.settimeout(LATE_S)
    taken = 12
    while not any(frame[6:9] == bytes([100, 1, 10]) and frame[10:12] == b"\x67\x18" for frame in frames):
        connection.sendall(bytes([0x68, 4, 1, 0]) + struct.pack("<H", taken << 1))
        more = collect_frames(connection, until=lambda frames: len(frames) >= 1)
        taken += len([frame for frame in more if not frame[2] & 1])
        frames += more


def collect_frames(connection: socket.socket, until: Callable[[list[bytes]], bool]) -> list[bytes]:
    frames: list[bytes] = []
    while not until(frames):
        head = received(connection, 2)
        frames.append(head + received(connection, head[1]))
    return frames


# ---- hostile peers ----------------------------------------------------------------------------------


@pytest.mark.slow
def test_peer_cannot_flood_the_log(desk: Desk, connection: socket.socket) -> None:
    before = desk.gateway.log_file.stat().st_size
    starts = 10_000
    for _ in range(starts // 100):
        connection.sendall((STARTDT + STOPDT) * 100)
        collect_frames(connection, until=lambda frames: frames.count(STOPDT_CON) == 100)
    desk.wait_scan(DEVICE)
    assert desk.gateway.log_file.stat().st_size - before < 10 * starts  # a line for each is some 60 octets


def allow_descriptors(pid: int, count: int) -> None:
    """As its own user: root without CAP_SYS_RESOURCE may not."""
    status = Path(f"/proc/{pid}/stat").stat()
    user = ("setpriv", f"--reuid={status.st_uid}", f"--regid={status.st_gid}", "--clear-groups")
    subprocess.run([*user, "prlimit", f"--pid={pid}", f"--nofile={count}:{count}"], check=True)


@pytest.mark.slow
def test_connections_wait_without_work_when_descriptors_run_out(programs: Path) -> None:
    """What cannot be accepted must not wake the station again and again, and is accepted when it can be."""
    config = chapter_5()
    config["iec104"] |= {"max_connections": 16, "connections_per_address": 16}
    with gateway_on_lines(config, programs) as (_, gateway), contextlib.ExitStack() as stack:
        station = gateway.modules()["rtu-iec104"]["pid"]
        allow_descriptors(station, len(list(Path(f"/proc/{station}/fd").iterdir())) + 8)
        peers = [stack.enter_context(socket.create_connection(gateway.address, LATE_S)) for _ in range(16)]
        for peer in peers:
            peer.sendall(TESTFR)
        assert received(peers[0], 6) == TESTFR_CON
        wait_still(lambda: processor_seconds(station), 0.1)
        with pytest.raises(TimeoutError):
            peers[-1].settimeout(0.1)
            peers[-1].recv(1)
        for peer in peers[:8]:
            peer.close()
        peers[-1].settimeout(LATE_S)
        assert received(peers[-1], 6) == TESTFR_CON


# ---- tshark -------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_tshark_finds_nothing_malformed(desk: Desk, connection: socket.socket, tmp_path: Path) -> None:
    """A GI of all stations and the events of a dying device, as an independent dissector reads them."""
    connection.sendall(STARTDT + i_frame(0, 0, GI_ALL))
    desk.lines.fault(DEVICE, "mute")
    frames: list[bytes] = []
    seen_event = False
    try:
        while not seen_event:
            more = collect_frames(connection, until=lambda frames: len(frames) >= 1)
            frames += more
            information = len([frame for frame in frames if not frame[2] & 1])
            connection.sendall(bytes([0x68, 4, 1, 0]) + struct.pack("<H", information << 1))
            seen_event = any(
                frame[6] == 35 and frame[10:12] == b"\xfb\x0b" for frame in frames if len(frame) > 12
            )
    finally:
        desk.lines.fault(DEVICE, "clear")
        desk.wait_all_good(STATION)
    dump = "\n".join("000000 " + frame.hex(" ") for frame in frames)
    pcap = tmp_path / "station.pcap"
    subprocess.run(["text2pcap", "-q", "-T", "2404,40000", "-", pcap], input=dump, text=True, check=True)
    fields = ["-e", "iec60870_asdu.typeid", "-e", "_ws.malformed", "-e", "_ws.expert"]
    command = ["tshark", "-r", pcap, "-T", "fields", *fields]
    lines = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    assert len(lines) == len(frames)
    assert {line.split("\t")[0] for line in lines} >= {"1", "3", "5", "7", "9", "11", "13", "30", "35", "100"}
    assert not [line for line in lines if "".join(line.split("\t")[1:])]
