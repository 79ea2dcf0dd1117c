# SPDX-License-Identifier: GPL-3.0-or-later
"""linesim against masters that are not ours (pymodbus, mbpoll over libmodbus), and byte by byte."""

from __future__ import annotations

import fcntl
import json
import os
import random
import re
import select
import signal
import socket
import struct
import subprocess
import termios
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
import serial
from pymodbus.client import ModbusSerialClient
from pymodbus.framer.rtu import FramerRTU

from lab.linesim import LineSim, LineSimError

pytestmark = pytest.mark.slow  # as a whole

CHAPTER5 = Path(__file__).parents[1] / "fixtures" / "chapter5"
CONFIG = CHAPTER5 / "gateway.json"
VALUES = CHAPTER5 / "values.json"
QUIET_S = 0.1  # from a request's end; without a fault an answer begins after 2 ms
CHAR_19200_8N2_S = 11 / 19200
HOLDING = "holding_registers"

# The project report, figure 5.4: request, what the console says it read, answer.
FIGURE_5_4 = [
    ([67, 1, 0, 0, 0, 1, 242, 232], "67C0 = 1", [67, 1, 1, 1, 132, 48]),
    ([67, 1, 0, 1, 0, 1, 163, 40], "67C1 = 0", [67, 1, 1, 0, 69, 240]),
    ([67, 1, 0, 2, 0, 1, 83, 40], "67C2 = 1", [67, 1, 1, 1, 132, 48]),
    ([67, 1, 0, 3, 0, 1, 2, 232], "67C3 = 0", [67, 1, 1, 0, 69, 240]),
    ([67, 2, 0, 0, 0, 1, 182, 232], "67DI0 = 1", [67, 2, 1, 1, 116, 48]),
    ([67, 2, 0, 1, 0, 1, 231, 40], "67DI1 = 0", [67, 2, 1, 0, 181, 240]),
    ([67, 2, 0, 2, 0, 1, 23, 40], "67DI2 = 0", [67, 2, 1, 0, 181, 240]),
    ([67, 4, 0, 0, 0, 1, 62, 232], "67IR0 = 1495", [67, 4, 2, 5, 215, 130, 49]),
    ([67, 4, 0, 1, 0, 1, 111, 40], "67IR1 = 98", [67, 4, 2, 0, 98, 64, 214]),
    ([67, 4, 0, 2, 0, 1, 159, 40], "67IR2 = 30", [67, 4, 2, 0, 30, 65, 55]),
    ([67, 3, 0, 0, 0, 1, 139, 40], "67HR0 = 1500", [67, 3, 2, 5, 220, 194, 130]),
    ([67, 3, 0, 1, 0, 1, 218, 232], "67HR1 = 100", [67, 3, 2, 0, 100, 193, 160]),
    ([67, 3, 0, 2, 0, 1, 42, 232], "67HR2 = 0", [67, 3, 2, 0, 0, 192, 75]),
]
# Figures 5.5 and 5.8: the answer is the request.
FIGURES_OF_COMMANDS = [
    ([67, 5, 0, 3, 255, 0, 115, 24], "67C3 = 1"),
    ([67, 6, 0, 2, 0, 255, 103, 104], "67HR2 = 255"),
]


def framed(*octets: int) -> bytes:
    """The frame of these octets, with pymodbus' CRC."""
    body = bytes(octets)
    return body + FramerRTU.compute_CRC(body).to_bytes(2, "big")


class Master:
    """A master that sends and receives bytes, and judges nothing."""

    def __init__(self, path: Path, baud: int = 19200, stop_bits: float = 2) -> None:
        self.port = serial.Serial(str(path), baud, stopbits=stop_bits, timeout=2)

    def exchange(self, request: bytes, size: int) -> bytes:
        self.port.write(request)
        return self.port.read(size)

    def hears_nothing(self, seconds: float = QUIET_S) -> bool:
        self.port.timeout = seconds
        silent = self.port.read(1) == b""
        self.port.timeout = 2
        return silent


@pytest.fixture
def sim(linesim_program: Path, tmp_path: Path) -> Iterator[LineSim]:
    with LineSim(CONFIG, VALUES, tmp_path / "lines", program=linesim_program) as running:
        yield running


@pytest.fixture
def master(sim: LineSim) -> Iterator[Master]:
    one = Master(sim.line("ttyS3"))
    yield one
    one.port.close()


@pytest.fixture
def client(sim: LineSim) -> Iterator[ModbusSerialClient]:
    with ModbusSerialClient(str(sim.line("ttyS3")), baudrate=19200, stopbits=2, timeout=2, retries=0) as one:
        yield one


def start(program: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([str(program), *arguments], capture_output=True, text=True, timeout=10, check=False)


def waiting_bytes(descriptor: int) -> int:
    return struct.unpack("i", fcntl.ioctl(descriptor, termios.FIONREAD, bytes(4)))[0]


def wait_until(condition: Callable[[], bool], timeout: float = 20.0) -> None:
    deadline = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < deadline, "it did not happen in time"
        time.sleep(0.005)


def test_an_answer_comes_at_once_if_it_shall(linesim_program: Path, tmp_path: Path) -> None:
    request, _, answer = FIGURE_5_4[0]
    with LineSim(CONFIG, VALUES, tmp_path / "lines", whole=True, program=linesim_program) as sim:
        port = Master(sim.line("ttyS3")).port
        port.write(bytes(request))
        select.select([port.fileno()], [], [])
        assert list(os.read(port.fileno(), 300)) == answer
        port.close()


def send_and_hear_nothing(sim: LineSim, master: Master, frame: bytes) -> None:
    """Silence counts from when linesim has the whole frame."""
    mark = sim.mark()
    master.port.write(frame)
    sim.wait_frame(lambda taken: taken.kind in ("received", "crc_error"), since=mark)
    assert master.hears_nothing()


def run_mbpoll(line: Path, *options: str, write: tuple[int, ...] = ()) -> subprocess.CompletedProcess[str]:
    serial_options = ["-m", "rtu", "-b", "19200", "-d", "8", "-s", "2", "-P", "none", "-0", "-1", "-q"]
    return start(Path("mbpoll"), *serial_options, *options, str(line), *(str(value) for value in write))


# ---- the report's figures -----------------------------------------------------------------


@pytest.mark.parametrize(("request_octets", "reading", "answer"), FIGURE_5_4)
def test_figure_5_4(
    sim: LineSim, master: Master, request_octets: list[int], reading: str, answer: list[int]
) -> None:
    assert list(master.exchange(bytes(request_octets), len(answer))) == answer
    sim.wait_frame(lambda frame: frame.kind == "sent")
    assert [frame.text for frame in sim.frames()] == [
        f"Modbus frame received: {str(request_octets).replace(',', '')}",
        f"Reading value: {reading}",
        f"Modbus frame sent: {str(answer).replace(',', '')}",
    ]


@pytest.mark.parametrize(("octets", "writing"), FIGURES_OF_COMMANDS)
def test_figures_5_5_and_5_8(sim: LineSim, master: Master, octets: list[int], writing: str) -> None:
    assert list(master.exchange(bytes(octets), 8)) == octets
    sim.wait_frame(lambda frame: frame.kind == "sent")
    numbers = str(octets).replace(",", "")
    assert [frame.text for frame in sim.frames()] == [
        f"Modbus frame received: {numbers}",
        f"Writing value: {writing}",
        f"Modbus frame sent: {numbers}",
    ]


def test_log_on_standard_output_is_that_of_the_figures(linesim_program: Path, tmp_path: Path) -> None:
    arguments = ["--config", str(CONFIG), "--values", str(VALUES), "--dir", str(tmp_path), "--trace"]
    with subprocess.Popen([str(linesim_program), *arguments], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        Master(tmp_path / "ttyS3").exchange(bytes(FIGURE_5_4[0][0]), 6)
        lines = [process.stdout.readline() for _ in range(3)]
        process.terminate()
    stamp = r"\d{4}/\d\d/\d\d \d\d:\d\d:\d\d\.\d{3} - INFO: "
    for line, text in zip(
        lines,
        [
            "Modbus frame received: [67 1 0 0 0 1 242 232]",
            "Reading value: 67C0 = 1",
            "Modbus frame sent: [67 1 1 1 132 48]",
        ],
        strict=True,
    ):
        assert re.fullmatch(stamp + re.escape(text) + "\n", line), line


# ---- independent masters ------------------------------------------------------------------


def test_pymodbus_reads_all_tables(client: ModbusSerialClient) -> None:
    assert client.read_coils(0, count=4, device_id=67).bits[:4] == [True, False, True, False]
    assert client.read_discrete_inputs(0, count=3, device_id=155).bits[:3] == [True, False, False]
    assert client.read_input_registers(0, count=3, device_id=155).registers == [1150, 1200, 300]
    assert client.read_holding_registers(0, count=3, device_id=201).registers == [200, 50, 0]


def test_pymodbus_writes_with_each_function(sim: LineSim, client: ModbusSerialClient) -> None:
    assert not client.write_coil(1, True, device_id=35).isError()
    assert not client.write_register(0, 65535, device_id=35).isError()
    assert not client.write_coils(0, [False, True, True], device_id=201).isError()
    assert not client.write_registers(1, [258, 772], device_id=201).isError()
    assert sim.get("3.35", "coils", 1) == 1
    assert sim.get("3.35", "holding_registers", 0) == 65535
    assert [sim.get("3.201", "coils", address) for address in range(3)] == [0, 1, 1]
    assert [sim.get("3.201", "holding_registers", address) for address in range(3)] == [200, 258, 772]
    assert sim.stats()["3"]["writes"] == 4


def test_pymodbus_writes_bits_of_a_register(sim: LineSim, client: ModbusSerialClient) -> None:
    sim.set("3.35", "holding_registers", 0, 0xF0F1)
    answer = client.mask_write_register(address=0, and_mask=0xFF0F, or_mask=0x0025, device_id=35)
    assert not answer.isError()
    assert sim.get("3.35", "holding_registers", 0) & 0xFFFF == 0xF021
    sim.wait_frame(lambda frame: (frame.kind, frame.table, frame.value) == ("writing", HOLDING, 0xF021))


def test_an_object_has_the_registers_of_its_format(linesim_program: Path, tmp_path: Path) -> None:
    objects = [
        {"address": 0, "format": "int64"},
        {"address": 10, "type": "counter", "format": "uint16"},
        {"address": 20, "type": "float", "format": "int16", "scale_register": 23},
        {"address": 30, "type": "double", "bit": 3, "ioa": 1},
        {"register": "40032"},
        {"address": 34, "format": "bcd48"},
        {"address": 40, "format": "mod10_64"},
        {"address": 46, "type": "float", "format": "fixed24_8"},
        {"address": 50, "type": "float", "bits": [0, 3], "ioa": 2},
    ]
    port = {"value": 1, "active": 1, "baud_rate": 9600, "data_bits": 8, "stop_bits": 1, "parity": 0}
    config = {"port": [{**port, "slaves": [{"id": 1, HOLDING: objects}]}, {"active": 1, "host": "192.0.2.1"}]}
    file = tmp_path / "gateway.json"
    file.write_text(json.dumps(config))
    there = {0, 1, 2, 3, 10, 20, 21, 22, 23, 30, 31, 34, 35, 36, 40, 41, 42, 43, 46, 47, 50}
    with LineSim(file, None, tmp_path / "dev", program=linesim_program) as sim:
        for address in range(52):
            if address in there:
                sim.set("1.1", HOLDING, address, 1)
            else:
                with pytest.raises(LineSimError, match="has no address"):
                    sim.set("1.1", HOLDING, address, 1)


def test_pymodbus_gets_exception_2_for_an_address_that_is_not_there(client: ModbusSerialClient) -> None:
    answer = client.read_coils(3, count=2, device_id=67)
    assert answer.isError()
    assert answer.exception_code == 2


def test_mbpoll_reads(sim: LineSim) -> None:
    result = run_mbpoll(sim.line("ttyS3"), "-a", "67", "-t", "3", "-r", "0", "-c", "3")
    assert result.returncode == 0, result.stdout + result.stderr
    assert re.findall(r"\[(\d)\]:\s+(\d+)", result.stdout) == [("0", "1495"), ("1", "98"), ("2", "30")]


def test_mbpoll_writes(sim: LineSim) -> None:
    result = run_mbpoll(sim.line("ttyS3"), "-a", "67", "-t", "4", "-r", "1", write=(321, 17))
    assert result.returncode == 0, result.stdout + result.stderr
    assert [sim.get("3.67", "holding_registers", address) for address in range(3)] == [1500, 321, 17]


def test_every_line_answers_at_its_own_pace(sim: LineSim) -> None:
    for name, unit, baud in [
        ("ttyS1", 10, 9600),
        ("ttyS2", 20, 38400),
        ("ttyS4", 40, 115200),
        ("ttyS6", 50, 4800),
        ("ttyS8", 1, 9600),
    ]:
        with ModbusSerialClient(str(sim.line(name)), baudrate=baud, timeout=2, retries=0) as one:
            assert not one.read_discrete_inputs(0, count=1, device_id=unit).isError(), name


# ---- the slave ----------------------------------------------------------------------------

ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE = 1, 2, 3


@pytest.mark.parametrize(
    ("unit", "pdu", "code"),
    [
        (67, [7], ILLEGAL_FUNCTION),
        (67, [0], ILLEGAL_FUNCTION),
        (67, [0x17, 0, 0, 0, 1, 0, 0, 0, 1, 2, 0, 0], ILLEGAL_FUNCTION),
        (67, [1, 0, 0, 0, 0], ILLEGAL_VALUE),
        (67, [1, 0, 0, 0x07, 0xD1], ILLEGAL_VALUE),  # 2001 coils
        (67, [3, 0, 0, 0, 126], ILLEGAL_VALUE),
        (67, [3, 0, 0, 0], ILLEGAL_VALUE),  # too short
        (67, [3, 0, 0, 0, 1, 0], ILLEGAL_VALUE),  # too long
        (67, [3, 0, 3, 0, 1], ILLEGAL_ADDRESS),
        (67, [3, 0xFF, 0xFF, 0, 2], ILLEGAL_ADDRESS),  # beyond the last address
        (67, [1, 0, 0, 0, 5], ILLEGAL_ADDRESS),
        (67, [5, 0, 3, 0x12, 0x34], ILLEGAL_VALUE),
        (67, [5, 0, 4, 0xFF, 0], ILLEGAL_ADDRESS),
        (67, [6, 0, 9, 0, 0], ILLEGAL_ADDRESS),
        (67, [15, 0, 0, 0, 3, 2, 1, 0], ILLEGAL_VALUE),  # byte count is not the quantity's
        (67, [15, 0, 0, 0, 3], ILLEGAL_VALUE),
        (67, [15, 0, 0, 0, 5, 1, 0], ILLEGAL_ADDRESS),
        (67, [16, 0, 0, 0, 2, 4, 0, 1, 0], ILLEGAL_VALUE),  # a byte is missing
        (67, [16, 0, 0, 0, 0, 0], ILLEGAL_VALUE),
        (67, [16, 0, 0, 0, 124, 248, *[0] * 244], ILLEGAL_VALUE),
        (67, [16, 0, 2, 0, 2, 4, 0, 1, 0, 1], ILLEGAL_ADDRESS),
    ],
)
def test_exceptions(sim: LineSim, master: Master, unit: int, pdu: list[int], code: int) -> None:
    assert master.exchange(framed(unit, *pdu), 5) == framed(unit, pdu[0] | 0x80, code)
    sim.wait_frame(lambda frame: frame.kind == "sent")
    assert sim.stats()["3"]["slaves"]["67"] == {"requests": 1, "answers": 1, "exceptions": 1, "writes": 0}


def test_refused_write_changes_nothing(sim: LineSim, master: Master) -> None:
    master.exchange(framed(67, 16, 0, 2, 0, 2, 4, 0, 1, 0, 1), 5)
    assert sim.get("3.67", "holding_registers", 2) == 0


def test_hole_in_the_register_map_is_exception_2(sim: LineSim) -> None:
    plc = Master(sim.line("ttyS6"), 4800, 1)
    assert plc.exchange(framed(50, 4, 0, 0, 0, 7), 5) == framed(50, 0x84, 2)
    assert plc.exchange(framed(50, 4, 0, 5, 0, 2), 9) == framed(50, 4, 4, 1, 164, 0, 17)


def test_two_register_types_cover_two_addresses(sim: LineSim) -> None:
    plc = Master(sim.line("ttyS6"), 4800, 1)
    assert plc.exchange(framed(51, 3, 0x2E, 0xE0, 0, 2), 9) == framed(51, 3, 4, 0xBF, 0xC0, 0, 0)
    assert plc.exchange(framed(51, 4, 0xFF, 0xFF, 0, 1), 7) == framed(51, 4, 2, 0xFF, 0xFF)


@pytest.mark.parametrize(
    ("frame", "counter"),
    [
        (bytes([67, 1, 0, 0, 0, 1, 242, 233]), "crc_errors"),
        (bytes([67, 1, 0]), "crc_errors"),
        (framed(67, 16, *[0] * 253), "crc_errors"),  # sound, but longer than a frame may be
        (framed(68, 1, 0, 0, 0, 1), "foreign"),
        (framed(255, 1, 0, 0, 0, 1), "foreign"),
    ],
)
def test_silent_to_what_is_not_for_it(sim: LineSim, master: Master, frame: bytes, counter: str) -> None:
    send_and_hear_nothing(sim, master, frame)
    stats = sim.stats()["3"]
    assert (stats[counter], stats["requests"], stats["answers"]) == (1, 0, 0)
    assert list(master.exchange(bytes(FIGURE_5_4[0][0]), 6)) == FIGURE_5_4[0][2]


def test_broadcast_is_executed_by_all_and_answered_by_none(sim: LineSim, master: Master) -> None:
    send_and_hear_nothing(sim, master, framed(0, 6, 0, 2, 0, 77))
    assert [sim.get(f"3.{unit}", "holding_registers", 2) for unit in (35, 67, 155, 201)] == [77] * 4
    assert [frame.text for frame in sim.frames() if frame.kind == "writing"] == [
        f"Writing value: {unit}HR2 = 77" for unit in (35, 67, 155, 201)
    ]


def test_broadcast_reaches_the_broadcast_device(sim: LineSim) -> None:
    line = Master(sim.line("ttyS1"), 9600, 1)
    send_and_hear_nothing(sim, line, framed(0, 5, 0, 100, 0xFF, 0))
    assert (sim.get("1.0", "coils", 100), sim.get("1.10", "coils", 100)) == (1, 1)


# ---- time ---------------------------------------------------------------------------------


def test_transaction_takes_at_least_its_wire_time(sim: LineSim, master: Master) -> None:
    begin = time.monotonic()
    master.exchange(bytes(FIGURE_5_4[7][0]), 7)
    took = time.monotonic() - begin
    assert took >= (8 + 3.5 + 7) * CHAR_19200_8N2_S + 0.002
    assert sim.stats()["3"]["busy_ns"] == (8 + 7) * (11 * 10**9 // 19200)


def test_answer_comes_byte_by_byte(sim: LineSim) -> None:
    """A reader that looks as often as it can sees an answer of 200 ms grow, not appear."""
    line = Master(sim.line("ttyS6"), 4800, 1)
    sim.fault("5.50", "noise", 90)
    line.port.write(framed(50, 2, 0, 0, 0, 1))
    sizes: list[int] = []
    while sum(sizes) < 96:
        sizes.append(len(line.port.read(line.port.in_waiting or 1)))
        assert sizes[-1], f"the line fell silent after {sum(sizes)} of 96 bytes"
    assert len(sizes) > 10


def test_request_may_come_in_pieces(sim: LineSim) -> None:
    """The second piece comes within the first one's wire time of 200 ms: no silence lies between them."""
    line = Master(sim.line("ttyS6"), 4800, 1)
    request = framed(50, 16, 0, 0, 0, 50, 100, *[0] * 100)
    line.port.write(request[:100])
    line.port.write(request[100:])
    assert line.port.read(5) == framed(50, 0x90, ILLEGAL_ADDRESS)
    assert sim.stats()["5"]["crc_errors"] == 0


def test_latency_is_configurable(linesim_program: Path, tmp_path: Path) -> None:
    with LineSim(CONFIG, VALUES, tmp_path, latency_us=120_000, program=linesim_program) as slow:
        begin = time.monotonic()
        Master(slow.line("ttyS3")).exchange(bytes(FIGURE_5_4[0][0]), 6)
        assert time.monotonic() - begin >= 0.12


def test_shorter_silence_than_said_ends_no_request(linesim_program: Path, tmp_path: Path) -> None:
    request = bytes(FIGURE_5_4[0][0])
    with LineSim(CONFIG, VALUES, tmp_path, silence_us=500_000, program=linesim_program) as patient:
        line = Master(patient.line("ttyS3"))
        line.port.write(request[:3])
        assert line.hears_nothing(0.05)
        assert line.exchange(request[3:], 6)
        assert patient.stats()["3"]["crc_errors"] == 0


def test_unfinished_request_waits_fifty_times_as_long(linesim_program: Path, tmp_path: Path) -> None:
    """A busy host may stop an emulator between two bytes; a request that follows is taken without them."""
    request = bytes(FIGURE_5_4[0][0])
    with LineSim(CONFIG, VALUES, tmp_path, silence_us=100_000, program=linesim_program) as patient:
        line = Master(patient.line("ttyS3"))
        line.port.write(request[:3])
        assert line.hears_nothing(0.4)
        assert line.exchange(request[3:], 6)
        assert patient.stats()["3"]["crc_errors"] == 0
        line.port.write(request[:3])
        assert line.hears_nothing(0.4)
        assert line.exchange(request, 6)
        patient.wait_frame(lambda frame: frame.kind == "crc_error" and frame.bytes == request[:3])
        assert patient.stats()["3"]["crc_errors"] == 1


def test_speaking_into_an_answer_spoils_both(sim: LineSim) -> None:
    line = Master(sim.line("ttyS6"), 4800, 1)
    request, answer = framed(50, 2, 0, 0, 0, 1), framed(50, 2, 1, 0)
    sim.fault("5.50", "noise", 90, count=1)  # an answer of 200 ms
    line.port.write(request)
    assert len(line.port.read(1)) == 1  # it has begun
    line.port.write(request)
    rest = line.port.read(95)
    assert len(rest) == 95
    assert not rest.endswith(answer)
    sim.wait_frame(lambda frame: frame.kind == "collision" and frame.bytes == request)
    assert line.hears_nothing()
    stats = sim.stats()["5"]
    assert (stats["collisions"], stats["requests"], stats["crc_errors"]) == (1, 1, 0)
    assert line.exchange(request, 6) == answer


# ---- faults -------------------------------------------------------------------------------

REQUEST = bytes(FIGURE_5_4[7][0])
ANSWER = bytes(FIGURE_5_4[7][2])


def assert_healthy(master: Master) -> None:
    assert master.exchange(REQUEST, 7) == ANSWER


def test_mute_executes_nothing(sim: LineSim, master: Master) -> None:
    sim.fault("3.67", "mute")
    send_and_hear_nothing(sim, master, framed(67, 6, 0, 2, 0, 255))
    send_and_hear_nothing(sim, master, framed(0, 6, 0, 2, 0, 255))
    assert sim.get("3.67", "holding_registers", 2) == 0
    sim.fault("3.67", "clear")
    assert_healthy(master)


def test_count_ends_a_fault(sim: LineSim, master: Master) -> None:
    sim.fault("3.67", "mute", count=2)
    for _ in range(2):
        send_and_hear_nothing(sim, master, REQUEST)
    assert_healthy(master)


def test_fault_is_of_one_slave(sim: LineSim, master: Master) -> None:
    sim.fault("3.35", "mute")
    assert_healthy(master)


def test_corrupt_has_a_wrong_crc(sim: LineSim, master: Master) -> None:
    sim.fault("3.67", "corrupt", count=1)
    answer = master.exchange(REQUEST, 7)
    assert (answer[:5], len(answer)) == (ANSWER[:5], 7)
    assert answer[5:] != ANSWER[5:]
    assert_healthy(master)


def test_corrupt_write_is_executed(sim: LineSim, master: Master) -> None:
    sim.fault("3.67", "corrupt", count=1)
    master.exchange(framed(67, 6, 0, 2, 0, 255), 8)
    assert sim.get("3.67", "holding_registers", 2) == 255


def test_truncate_sends_the_first_half(sim: LineSim, master: Master) -> None:
    sim.fault("3.67", "truncate", count=1)
    assert master.exchange(REQUEST, 3) == ANSWER[:3]
    assert master.hears_nothing()
    assert_healthy(master)


def test_wrong_unit_is_a_sound_answer_of_another(sim: LineSim, master: Master) -> None:
    sim.fault("3.67", "wrong-unit", count=1)
    assert master.exchange(REQUEST, 7) == framed(68, *ANSWER[1:5])
    assert_healthy(master)


def test_wrong_function_is_a_sound_answer(sim: LineSim, master: Master) -> None:
    sim.fault("3.67", "wrong-function", count=1)
    assert master.exchange(REQUEST, 7) == framed(67, 5, *ANSWER[2:5])
    assert_healthy(master)


def test_wrong_length_is_a_sound_answer(sim: LineSim, master: Master) -> None:
    sim.fault("3.67", "wrong-length", count=1)
    assert master.exchange(REQUEST, 8) == framed(67, 4, 3, *ANSWER[3:5], 0)
    assert_healthy(master)


def test_wrong_echo_confirms_another_value(sim: LineSim, master: Master) -> None:
    sim.fault("3.67", "wrong-echo", count=2)
    assert master.exchange(framed(67, 6, 0, 2, 0, 255), 8) == framed(67, 6, 0, 2, 0, 254)
    assert sim.get("3.67", "holding_registers", 2) == 255
    assert_healthy(master)  # only writes


def test_override_writes_behind_a_write(sim: LineSim, master: Master) -> None:
    sim.fault("3.67", "override", 1234)
    assert_healthy(master)
    write = framed(67, 6, 0, 2, 0, 255)
    assert master.exchange(write, 8) == write
    assert sim.get("3.67", "holding_registers", 2) == 1234
    master.exchange(bytes(FIGURES_OF_COMMANDS[0][0]), 8)
    assert sim.get("3.67", "coils", 3) == 1


def test_echo_comes_before_the_answer(sim: LineSim, master: Master) -> None:
    sim.fault("3.67", "echo", count=1)
    assert master.exchange(REQUEST, 15) == REQUEST + ANSWER
    assert_healthy(master)


@pytest.mark.parametrize("size", [1, 256])
def test_noise_comes_before_the_answer(sim: LineSim, master: Master, size: int) -> None:
    sim.fault("3.67", "noise", size, count=1)
    heard = master.exchange(REQUEST, size + 7)
    assert len(heard) == size + 7
    assert heard.endswith(ANSWER)
    assert_healthy(master)


def test_exception_instead_of_executing(sim: LineSim, master: Master) -> None:
    sim.fault("3.67", "exception", 4, count=1)
    assert master.exchange(framed(67, 6, 0, 2, 0, 255), 5) == framed(67, 0x86, 4)
    assert sim.get("3.67", "holding_registers", 2) == 0
    assert_healthy(master)


def test_exception_for_one_function_counts_only_that(sim: LineSim, master: Master) -> None:
    sim.fault("3.67", "exception", 6, 5, count=1)
    assert_healthy(master)
    assert master.exchange(bytes(FIGURES_OF_COMMANDS[0][0]), 5) == framed(67, 0x85, 6)
    assert list(master.exchange(bytes(FIGURES_OF_COMMANDS[0][0]), 8)) == FIGURES_OF_COMMANDS[0][0]


def test_limit_of_a_read(sim: LineSim, master: Master) -> None:
    sim.fault("3.67", "limit", 2)
    assert master.exchange(framed(67, 3, 0, 0, 0, 3), 5) == framed(67, 0x83, 3)
    assert master.exchange(framed(67, 3, 0, 0, 0, 2), 9)[:3] == bytes((67, 3, 4))
    assert_healthy(master)


def test_delay(sim: LineSim, master: Master) -> None:
    sim.fault("3.67", "delay", 100, count=1)
    begin = time.monotonic()
    assert_healthy(master)
    assert time.monotonic() - begin >= 0.1


def test_delayed_answer_is_given_up_when_the_master_speaks(sim: LineSim, master: Master) -> None:
    sim.fault("3.67", "delay", 500, count=1)
    master.port.write(REQUEST)
    sim.wait_frame(lambda frame: frame.kind == "reading")
    assert master.exchange(framed(35, 1, 0, 0, 0, 3), 6) == framed(35, 1, 1, 5)
    sim.wait_frame(lambda frame: frame.kind == "sent")
    assert master.hears_nothing(0.6)  # beyond the delay
    assert sim.stats()["3"]["dropped"] == 1


def test_a_deaf_device_hears_nothing_behind_its_answer(sim: LineSim, master: Master) -> None:
    sim.fault("3.67", "deaf", 60_000)
    assert_healthy(master)
    master.port.write(REQUEST)
    assert master.hears_nothing(0.1)
    sim.fault("3.67", "clear")
    assert_healthy(master)


def test_late_answer_comes_after_the_next_transaction(sim: LineSim, master: Master) -> None:
    sim.fault("3.67", "late", 500, count=1)
    master.port.write(REQUEST)
    sim.wait_frame(lambda frame: frame.kind == "reading")
    assert master.exchange(framed(35, 1, 0, 0, 0, 3), 6) == framed(35, 1, 1, 5)
    assert master.port.read(7) == ANSWER
    assert [frame.unit for frame in sim.frames() if frame.kind == "sent"] in ([35, 67], [35])


def test_nothing_overtakes_a_late_answer_of_its_device(sim: LineSim, master: Master) -> None:
    sim.fault("3.67", "late", 300, count=1)
    master.port.write(REQUEST)
    sim.wait_frame(lambda frame: frame.kind == "reading")
    assert master.exchange(framed(67, 1, 0, 0, 0, 1), 13) == ANSWER + framed(67, 1, 1, 1)


def test_late_answer_into_a_request_spoils_both(linesim_program: Path, tmp_path: Path) -> None:
    """At 1200 bit/s a busy host has a second for the next request, which then lasts 1.7 s."""
    config = json.loads(CONFIG.read_text())
    next(port for port in config["port"] if port["value"] == 5)["baud_rate"] = 1200
    slow = tmp_path / "gateway.json"
    slow.write_text(json.dumps(config))
    with LineSim(slow, VALUES, tmp_path / "lines", program=linesim_program) as sim:
        line = Master(sim.line("ttyS6"), 1200, 1)
        line.port.timeout = 30
        sim.fault("5.50", "late", 1000, count=1)
        line.port.write(framed(50, 2, 0, 0, 0, 1))
        sim.wait_frame(lambda frame: frame.kind == "reading")
        line.port.write(framed(50, 16, 0, 0, 0, 100, 200, *[0] * 200))
        answer = line.port.read(6)
        assert len(answer) == 6
        assert answer != framed(50, 2, 1, 0)
        sim.wait_frame(lambda frame: frame.kind == "collision" and len(frame.bytes) == 209)
        stats = sim.stats()["5"]
        assert (stats["collisions"], stats["writes"]) == (1, 0)


def test_more_late_answers_than_there_is_room_for_are_dropped(sim: LineSim, master: Master) -> None:
    sim.fault("3.67", "late", 60000)
    for _ in range(9):
        mark = sim.mark()
        master.port.write(REQUEST)
        sim.wait_frame(lambda frame: frame.kind == "reading", since=mark)
    stats = sim.stats()["3"]
    assert (stats["requests"], stats["answers"], stats["dropped"]) == (9, 0, 1)


def test_unplugged_line_is_dead_both_ways(sim: LineSim, master: Master) -> None:
    sim.unplug(3)
    master.port.write(framed(67, 6, 0, 2, 0, 255))
    assert master.hears_nothing()
    stats = sim.stats()["3"]
    assert (stats["plugged"], stats["requests"], stats["crc_errors"]) == (False, 0, 0)
    other = Master(sim.line("ttyS1"), 9600, 1)
    assert other.exchange(framed(10, 2, 0, 5, 0, 1), 6) == framed(10, 2, 1, 0)
    sim.plug(3)
    assert sim.get("3.67", "holding_registers", 2) == 0
    assert_healthy(master)


def test_unplugging_cuts_an_answer_that_waits(sim: LineSim, master: Master) -> None:
    sim.fault("3.67", "late", 100, count=1)
    master.port.write(REQUEST)
    sim.wait_frame(lambda frame: frame.kind == "reading")
    sim.unplug(3)
    sim.plug(3)
    assert master.hears_nothing(0.3)


def test_jammed_line_is_never_silent(sim: LineSim, master: Master) -> None:
    sim.command("jam 3")
    begin = time.monotonic()
    assert len(master.port.read(500)) == 500
    assert time.monotonic() - begin >= 450 * CHAR_19200_8N2_S  # not faster than the line
    master.port.write(framed(67, 6, 0, 2, 0, 255))
    wait_until(lambda: sim.stats()["3"]["collisions"] > 0)
    sim.command("unjam 3")
    assert sim.get("3.67", "holding_registers", 2) == 0
    master.port.reset_input_buffer()
    assert_healthy(master)


def test_somebody_else_says_something(sim: LineSim, master: Master) -> None:
    sim.command("say 3 1 2 255")
    assert master.port.read(3) == bytes([1, 2, 255])
    assert sim.stats()["3"]["answers"] == 0
    assert_healthy(master)


# ---- control ------------------------------------------------------------------------------


def test_set_changes_what_the_line_reads(sim: LineSim, master: Master) -> None:
    sim.set("3.67", "input_registers", 0, -2)
    assert sim.get("3.67", "input_registers", 0) == 65534
    assert master.exchange(REQUEST, 7) == framed(67, 4, 2, 0xFF, 0xFE)


def test_set_of_neighbours_is_all_or_nothing(sim: LineSim) -> None:
    sim.set("2.20", "input_registers", 0, 1, 2, 3, 4)
    assert [sim.get("2.20", "input_registers", address) for address in range(4)] == [1, 2, 3, 4]
    with pytest.raises(LineSimError, match="no value"):
        sim.set("2.20", "input_registers", 0, 5, 65536)
    assert sim.get("2.20", "input_registers", 0) == 1


@pytest.mark.parametrize(
    ("command", "reason"),
    [
        ("", "empty command"),
        ("sett 3.67 coils 0 1", 'unknown command "sett"'),
        ("set 3.67 coils 0", "usage: set PORT.UNIT TABLE ADDRESS VALUE..."),
        ("set 3.67 coils 0 " + "1 " * 33, "usage: set"),
        ("set 3.67 coils 0 2", '"2" is no value of coils, expected 0 or 1'),
        ("set 3.67 coils 0 one", '"one" is no value of coils'),
        ("set 3.67 holding_registers 0 70000", "expected -32768 to 65535"),
        ("set 3.67 holding_registers 2 1 2", "has no address 3 in holding_registers"),
        ("get 3.67 coils 4", 'has no address "4" in coils'),
        ("get 3.67 coils x", 'has no address "x"'),
        ("get 3.67 coil 0", 'unknown table "coil"'),
        ("get 3.68 coils 0", 'no slave "3.68"'),
        ("get 3 coils 0", 'no slave "3"'),
        ("get 99999999999.67 coils 0", "no slave"),
        ("get 3.67 coils 0 0", "usage: get"),
        ("fault 3.67", "usage: fault"),
        ("fault 3.67 deaf", "usage: fault"),
        ("fault 3.67 delay", "usage: fault"),
        ("fault 3.67 delay 60001", "usage: fault"),
        ("fault 3.67 noise 0", "usage: fault"),
        ("fault 3.67 noise 257", "usage: fault"),
        ("fault 3.67 mute 3", "usage: fault"),
        ("fault 3.67 limit 0", "usage: fault"),
        ("fault 3.67 limit 2001", "usage: fault"),
        ("fault 3.67 exception 256", "usage: fault"),
        ("fault 3.67 exception 2 128", "usage: fault"),
        ("fault 3.67 mute count", "usage: fault"),
        ("fault 3.67 mute count 0", "usage: fault"),
        ("unplug", "usage: unplug"),
        ("unplug 7", 'no active port "7"'),
        ("jam 7", 'no active port "7"'),
        ("say 3", "usage: say"),
        ("say 3 256", "usage: say"),
        ("fault 3.67 override 65536", "usage: fault"),
        ("stats all", "usage: stats"),
        ("trace maybe", "usage: trace"),
        ("x" * 2100, "at most 2047 characters"),
    ],
)
def test_wrong_commands_are_told_why(sim: LineSim, command: str, reason: str) -> None:
    with pytest.raises(LineSimError) as refused:
        sim.command(command)
    assert reason in str(refused.value)


def connect(sim: LineSim) -> socket.socket:
    one = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    one.settimeout(2)
    one.connect(str(sim.directory / "control"))
    return one


def test_clients_beyond_the_eighth_are_refused(sim: LineSim) -> None:
    clients = [connect(sim) for _ in range(7)]
    with connect(sim) as ninth:
        assert ninth.recv(100) == b"error too many clients\n"
    clients[0].close()
    clients[1].sendall(b"get 3.67 coils 0\n")
    assert clients[1].recv(100) == b"ok 1\n"
    for one in clients:
        one.close()


def test_client_that_never_reads_harms_nobody(sim: LineSim, master: Master) -> None:
    with connect(sim) as deaf:
        deaf.sendall(b"trace on\n" + b"stats\n" * 2000)
        assert_healthy(master)
        assert sim.get("3.67", "coils", 0) == 1


def test_quit_ends_it(linesim_program: Path, tmp_path: Path) -> None:
    sim = LineSim(CONFIG, None, tmp_path, program=linesim_program)
    sim.start()
    sim.command("quit")
    sim.stop()
    assert list(tmp_path.iterdir()) == []


def test_hostile_bytes_on_the_control_socket(sim: LineSim) -> None:
    chance = random.Random(67)
    words = [
        b"fault",
        b"3.67",
        b"set",
        b"coils",
        b"count",
        b"9" * 20,
        b"-1",
        b"\0",
        b"\xff%s%n",
        b"trace",
        b"on",
    ]
    with connect(sim) as client:
        for _ in range(200):
            client.sendall(b" ".join(chance.choices(words, k=chance.randrange(1, 40))) + b"\n")
        client.sendall(chance.randbytes(5000))
    assert sim.get("3.35", "coils", 0) == 1


def test_hostile_bytes_on_a_line(sim: LineSim) -> None:
    line = Master(sim.line("ttyS4"), 115200, 1)
    chance = random.Random(40)
    for _ in range(50):
        mark = sim.mark()
        line.port.write(chance.randbytes(chance.randrange(1, 600)))
        sim.wait_frame(lambda frame: frame.kind == "crc_error", since=mark)
        mark = sim.mark()
        line.port.write(framed(40, *chance.randbytes(chance.randrange(1, 250))))
        sent = sim.wait_frame(lambda frame: frame.kind == "sent", since=mark)
        assert line.port.read(len(sent.bytes)) == sent.bytes
    assert line.exchange(framed(40, 2, 0, 0, 0, 2), 6) == framed(40, 2, 1, 0)


# ---- start, stop, files -------------------------------------------------------------------


def test_stopping_removes_the_lines(linesim_program: Path, tmp_path: Path) -> None:
    with LineSim(CONFIG, VALUES, tmp_path, program=linesim_program):
        names = {path.name for path in tmp_path.iterdir()}
    assert names == {"control", "ttyS1", "ttyS2", "ttyS3", "ttyS4", "ttyS6", "ttyS8"}
    assert list(tmp_path.iterdir()) == []


def test_starts_over_what_a_killed_one_left(linesim_program: Path, tmp_path: Path) -> None:
    killed = LineSim(CONFIG, VALUES, tmp_path, program=linesim_program)
    killed.start()
    os.kill(killed.pid, signal.SIGKILL)
    with pytest.raises(LineSimError, match="exit code -9"):
        killed.stop()
    assert (tmp_path / "control").exists()
    with LineSim(CONFIG, VALUES, tmp_path, program=linesim_program) as sim:
        assert sim.get("3.67", "coils", 0) == 1


def test_second_one_in_the_same_directory_is_refused(sim: LineSim, linesim_program: Path) -> None:
    second = LineSim(CONFIG, VALUES, sim.directory, program=linesim_program)
    with pytest.raises(LineSimError, match="another linesim runs here"):
        second.start()
    assert sim.get("3.67", "coils", 0) == 1


def test_file_of_a_users_is_not_replaced_by_a_line(linesim_program: Path, tmp_path: Path) -> None:
    (tmp_path / "ttyS3").write_text("mine")
    result = start(linesim_program, "--config", str(CONFIG), "--dir", str(tmp_path))
    assert (result.returncode, result.stderr) == (1, "linesim: ttyS3: File exists\n")
    assert [path.name for path in tmp_path.iterdir()] == ["ttyS3"]
    assert (tmp_path / "ttyS3").read_text() == "mine"


def test_missing_program_is_told(tmp_path: Path) -> None:
    with pytest.raises(LineSimError, match="make build"):
        LineSim(CONFIG, None, tmp_path, program=tmp_path / "linesim").start()


ACTIVE = {"value": 3, "active": 1, "baud_rate": 19200, "data_bits": 8, "stop_bits": 2, "parity": 0}
SLAVE = {"id": 67, "coils": [{"address": 0}]}


@pytest.mark.parametrize(
    ("config", "values", "message"),
    [
        ("[", {}, "line 1: ']' expected near end of file"),
        ({}, {}, "port: expected an array"),
        ({"port": [{}]}, {}, "port[0].active: expected an integer 0 to 1"),
        ({"port": [ACTIVE | {"baud_rate": 0}]}, {}, "port[0].baud_rate: expected an integer 300 to 4000000"),
        ({"port": [ACTIVE | {"data_bits": 7}]}, {}, "port[0].data_bits: expected an integer 8 to 8"),
        ({"port": [ACTIVE, ACTIVE]}, {}, "port[1].value: port 3 is there already"),
        ({"port": [ACTIVE | {"value": 9}]}, {}, "port[0].device: port 9 is not one of the board's"),
        ({"port": [ACTIVE | {"device": "/dev/.."}]}, {}, "does not end in the name of a device"),
        (
            {"port": [ACTIVE, ACTIVE | {"value": 2, "device": "ttyS3"}]},
            {},
            "port[1].device: ttyS3 is port 3's already",
        ),
        (
            {"port": [ACTIVE | {"slaves": [{"id": 248}]}]},
            {},
            "port[0].slaves[0].id: expected an integer 0 to 247",
        ),
        (
            {"port": [ACTIVE | {"slaves": [SLAVE, SLAVE]}]},
            {},
            "slaves[1].id: slave 67 is on this line already",
        ),
        (
            {"port": [ACTIVE | {"slaves": [{"id": 1, "coils": [{"address": 65535, "type": "double"}]}]}]},
            {},
            "port[0].slaves[0].coils[0].address: expected an integer 0 to 65534",
        ),
        ({"port": [ACTIVE | {"slaves": [SLAVE]}]}, "{", "line 1:"),
        ({"port": [ACTIVE | {"slaves": [SLAVE]}]}, [], "expected an object with a member for each slave"),
        ({"port": [ACTIVE | {"slaves": [SLAVE]}]}, {"3.68": {}}, 'no slave "3.68"'),
        ({"port": [ACTIVE | {"slaves": [SLAVE]}]}, {"3.67": {"coil": {}}}, '3.67: unknown table "coil"'),
        (
            {"port": [ACTIVE | {"slaves": [SLAVE]}]},
            {"3.67": {"coils": {"1": 1}}},
            '3.67.coils: the configuration has no address "1" there',
        ),
        (
            {"port": [ACTIVE | {"slaves": [SLAVE]}]},
            {"3.67": {"coils": {"0": 2}}},
            "3.67.coils.0: expected an integer 0 or 1",
        ),
    ],
)
def test_unusable_files_are_told(
    linesim_program: Path, tmp_path: Path, config: object, values: object, message: str
) -> None:
    for name, content in (("config", config), ("values", values)):
        text = content if isinstance(content, str) else json.dumps(content)
        (tmp_path / f"{name}.json").write_text(text)
    arguments = ["--config", str(tmp_path / "config.json"), "--values", str(tmp_path / "values.json")]
    result = start(linesim_program, *arguments, "--dir", str(tmp_path))
    assert result.returncode == 2, result
    assert message in result.stderr
    assert result.stderr.startswith(f"linesim: {tmp_path}/")


@pytest.mark.parametrize(
    "arguments", [[], ["--config", "x"], ["--nonsense"], ["--latency", "x"], ["--silence", "x"]]
)
def test_wrong_usage(linesim_program: Path, arguments: list[str]) -> None:
    result = start(linesim_program, *arguments)
    assert (result.returncode, result.stdout) == (2, "")
    assert result.stderr != ""


@contextmanager
def unprivileged() -> Iterator[None]:
    """As the gateway's modules: root may open a port that another has for itself."""
    user = os.geteuid()
    if user == 0:
        os.seteuid(65534)
    try:
        yield
    finally:
        os.seteuid(user)


def opened(path: Path) -> int:
    """As one of the gateway's modules opens it, once linesim has seen that it was closed before."""
    descriptors: list[int] = []

    def is_free() -> bool:
        with unprivileged(), suppress(OSError):
            descriptors.append(os.open(path, os.O_RDWR | os.O_NOCTTY))
        return descriptors != []

    wait_until(is_free)
    return descriptors[0]


def test_closed_port_is_exclusive_no_longer(sim: LineSim) -> None:
    """As with a serial port: closing, which SIGKILL does too, is enough."""
    path = sim.line("ttyS3").readlink()
    for _ in range(2):
        descriptor = opened(path)
        fcntl.ioctl(descriptor, termios.TIOCEXCL)
        with unprivileged(), pytest.raises(OSError, match="busy"):
            os.open(path, os.O_RDWR | os.O_NOCTTY)
        os.close(descriptor)


def test_answer_that_nobody_read_is_gone_when_the_port_is_opened_again(sim: LineSim) -> None:
    first = os.open(sim.line("ttyS3"), os.O_RDWR | os.O_NOCTTY)
    os.write(first, REQUEST)
    wait_until(lambda: waiting_bytes(first) == len(ANSWER))
    os.close(first)
    assert sim.get("3.67", "coils", 0) == 1  # linesim has seen the closing before it answers this
    again = os.open(sim.line("ttyS3"), os.O_RDWR | os.O_NOCTTY)
    assert waiting_bytes(again) == 0
    os.close(again)


# ---- the fixtures -------------------------------------------------------------------------


def test_chapter5_has_every_type_of_table_4_1() -> None:
    objects = [
        item
        for port in json.loads(CONFIG.read_text())["port"]
        for slave in port["slaves"]
        for table in ("coils", "discrete_inputs", "input_registers", "holding_registers")
        for item in slave[table]
    ]
    named = {item["type"] for item in objects if "type" in item}
    assert named | {"single"} == {
        "single",
        "double",
        "step",
        "bitstring",
        "normalized",
        "scaled",
        "float",
        "counter",
    }


def test_gateway_accepts_the_fixtures(programs: Path) -> None:
    for path in (CONFIG, CHAPTER5.parent / "report" / "figure-4.8-4.9.json"):
        result = start(programs / "rtud" / "rtud", "--check", str(path))
        assert result.returncode == 0, result.stderr
