# SPDX-License-Identifier: GPL-3.0-or-later
"""`openrtu read`, `write` and `poll` on devices of pymodbus and on lines where something is wrong."""

import contextlib
import csv
import io
import json
import os
import queue
import random
import re
import signal
import socket
import struct
import subprocess
import sys
import termios
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from pymodbus.client import ModbusTcpClient

from lab.gateway import Gateway, free_port, listening_on, remove, run_directory
from nuc980 import ports
from openrtu_tools.cli import main
from openrtu_tools.modbus import frames, made, registers, serial_port
from openrtu_tools.modbus.errors import EXCEPTIONS
from openrtu_tools.modbus.values import FORMAT, NUMBERS, TEXTS, Layout
from peers.device import BAUD_RATE, UNIT, Device
from peers.line import line
from peers.pymodbus_device import PymodbusDevice
from rig.desk import patience

OPENRTU = Path(__file__).resolve().parents[2] / "scripts/openrtu"
ABSENT = 3  # an address that the devices do not have
PATIENCE_S = 30  # an answer on a busy host
SHORT_S = 1.5  # of a device that does not answer, or not well
FLOAT = [0x42F6, 0xE979]  # 123.456
PYMODBUS = {kind.name for kind in ModbusTcpClient.DATATYPE}
Said = Callable[..., tuple[int, list[str], str]]


@pytest.fixture(scope="module")
def serial() -> Iterator[tuple[Device, list[str]]]:
    """A device on a line, and the words that name it."""
    directory = run_directory()
    with contextlib.ExitStack() as stack:
        stack.callback(remove, directory)
        stack.enter_context(line(directory / "ours", directory / "its"))
        device = PymodbusDevice(directory / "its")
        device.start()
        stack.callback(device.stop)
        words = [f"{directory / 'ours'}", "-u", f"{UNIT}", "--baud", f"{BAUD_RATE}", "--parity", "none"]
        yield device, words


@pytest.fixture(scope="module")
def tcp() -> Iterator[tuple[Device, list[str]]]:
    port = free_port()
    device = PymodbusDevice(port)
    device.start()
    yield device, [f"127.0.0.1:{port}", "-u", f"{UNIT}"]
    device.stop()


@pytest.fixture(params=["serial", "tcp"])
def device(request: pytest.FixtureRequest) -> tuple[Device, list[str]]:
    found: tuple[Device, list[str]] = request.getfixturevalue(request.param)
    return found


@pytest.fixture
def said(capsys: pytest.CaptureFixture[str]) -> Said:
    """Runs a command; its exit code, the lines that it printed, and what it complained of."""

    def run(*words: str | int, timeout_s: float = PATIENCE_S) -> tuple[int, list[str], str]:
        code = main([*map(str, words), "--timeout", str(timeout_s)])
        found = capsys.readouterr()
        return code, found.out.splitlines(), found.err

    return run


def cells(row: str) -> list[str]:
    return row.split()


# ---- what the gateway and the tools have in common -------------------------------------------------


def test_every_number_of_the_configuration_can_be_read() -> None:
    assert [name for name in made.FORMATS if not FORMAT.fullmatch(name)] == list(TEXTS)
    assert {Layout(name).width for name in NUMBERS} <= {1, 2, 3, 4}


GOOD_NUMBERS = ["00001", "09999", "000003", "065536", "10001", "165536", "30010", "365000", "40001", "49999"]
BAD_NUMBERS = ["40000", "400000", "465537", "4001", "4000001", "20001", "4000x", "-0001"]


def numbered(*numbers: str) -> dict[str, Any]:
    """A configuration with an object of each number."""
    tables: dict[str, list[dict[str, Any]]] = {}
    for ioa, number in enumerate(numbers, 1):
        place = made.TABLES["0134".find(number[0])] if number[0] in "0134" else "holding_registers"
        tables.setdefault(place, []).append({"register": number, "ioa": ioa})
    line_of = {"active": 1, "baud_rate": 9600, "data_bits": 8, "stop_bits": 1, "parity": 0}
    return {"port": [{"value": 1, **line_of, "slaves": [{"id": 1, **tables}]}]}


def rtud(programs: Path, folder: Path, option: str, config: dict[str, Any]) -> tuple[int, str]:
    file = folder / "gateway.json"
    file.write_text(json.dumps(config))
    done = subprocess.run(
        [programs / "rtud/rtud", *option.split(), file], capture_output=True, text=True, check=False
    )
    return done.returncode, done.stdout


def test_a_number_is_what_the_gateway_takes_it_for(programs: Path, tmp_path: Path) -> None:
    code, listed = rtud(programs, tmp_path, "--points --csv", numbered(*GOOD_NUMBERS))
    assert code == 0
    known = {row["ioa"]: (row["table"], row["address"]) for row in csv.DictReader(io.StringIO(listed))}
    for ioa, number in enumerate(GOOD_NUMBERS, 1):
        place = registers.place(number)
        assert known[str(ioa)] == (place.table, str(place.address)), number


@pytest.mark.parametrize("number", BAD_NUMBERS)
def test_no_number_for_the_gateway_is_none_here(programs: Path, tmp_path: Path, number: str) -> None:
    assert rtud(programs, tmp_path, "--check", numbered(number))[0] != 0
    with pytest.raises(ValueError, match=re.escape(f'"{number}"')):
        registers.place(number)


@pytest.mark.parametrize("table", made.TABLES)
@pytest.mark.parametrize("address", [0, 9998, 9999, 65535])
def test_a_place_is_shown_as_it_may_be_typed(table: str, address: int) -> None:
    place = registers.Place(table, address)
    assert registers.place(place.number) == place
    assert registers.place(f"{place.letter}{address}") == place
    assert registers.place(f"{place.letter.upper()}0x{address:X}") == place


@pytest.mark.parametrize("word_order", made.WORD_ORDERS)
@pytest.mark.parametrize("name", [name for name in NUMBERS if name.upper() in PYMODBUS])
def test_a_format_is_that_of_pymodbus(name: str, word_order: Any) -> None:
    """Random registers, so each bit counts; what it makes of them becomes the same registers again."""
    kind = getattr(ModbusTcpClient.DATATYPE, name.upper())
    layout = Layout(name, word_order)
    choice = random.Random(f"{name} {word_order}")
    for _ in range(50):
        words = [choice.getrandbits(16) for _ in range(layout.width)]
        theirs = ModbusTcpClient.convert_from_registers(words, kind, word_order=word_order)
        if theirs == theirs:  # no NaN
            assert layout.number(words) == theirs
            if "float" not in name or abs(theirs) < float("inf"):
                assert layout.words(layout.text(words)) == words


@pytest.mark.parametrize(
    ("name", "number", "words"),
    [
        ("int48", "-2", [0xFFFF, 0xFFFF, 0xFFFE]),
        ("uint48", "0x123456789ABC", [0x1234, 0x5678, 0x9ABC]),
        ("bcd16", "9876", [0x9876]),
        ("bcd48", "12", [0, 0, 0x12]),
        ("bcd64", "1234567890123456", [0x1234, 0x5678, 0x9012, 0x3456]),
        ("mod10_32", "12345678", [1234, 5678]),
        ("mod10_32", "-20003", [0xFFFE, 0xFFFD]),
        ("mod10_48", "100000000", [1, 0, 0]),
        ("mod10_64", "0", [0, 0, 0, 0]),
        ("fixed24_8", "-1.5", [0xFFFF, 0xFE80]),
    ],
)
def test_formats_that_pymodbus_has_not(name: str, number: str, words: list[int]) -> None:
    layout = Layout(name)
    assert layout.words(number) == words
    assert layout.number(words) == (float(number) if "fixed" in name else int(number, 0))
    swapped = Layout(name, "little", "little")
    assert swapped.number(swapped.words(number)) == layout.number(words)


@pytest.mark.parametrize(
    ("name", "words"), [("bcd16", [0x00A0]), ("mod10_32", [0, 10_000]), ("mod10_32", [0x8000, 0])]
)
def test_registers_that_hold_no_number(name: str, words: list[int]) -> None:
    assert Layout(name).number(words) is None
    assert Layout(name).text(words) == "no number"


@pytest.mark.parametrize(
    ("name", "number"),
    [
        ("bcd16", "10000"),
        ("bcd16", "-1"),
        ("mod10_32", "100000000"),
        ("fixed24_8", "8388608"),
        ("uint48", "-1"),
    ],
)
def test_numbers_that_a_format_has_not(name: str, number: str) -> None:
    with pytest.raises(ValueError, match="is out of the range of"):
        Layout(name).words(number)


def test_octets_of_a_register_may_be_swapped() -> None:
    assert Layout("float32", "little", "big").words("1") == [0, 0x3F80]
    assert Layout("float32", "little", "little").words("1") == [0, 0x803F]
    assert Layout("uint16", byte_order="little").number([0x0102]) == 0x0201


# ---- read ------------------------------------------------------------------------------------------


def test_registers_are_read(device: tuple[Device, list[str]], said: Said) -> None:
    peer, words = device
    peer.set("input_registers", 20, [7, 0xFFFE, 0x8000])
    code, rows, complaints = said("read", *words, "30021", "-n", 3)
    assert (code, complaints) == (0, "")
    assert [cells(row) for row in rows] == [
        ["30021", "i20", "0x0007", "7"],
        ["30022", "i21", "0xFFFE", "65534", "(-2)"],
        ["30023", "i22", "0x8000", "32768", "(-32768)"],
    ]


def test_each_table_is_read(device: tuple[Device, list[str]], said: Said) -> None:
    peer, words = device
    peer.set("coils", 100, [1])
    peer.set("discrete_inputs", 101, [1])
    peer.set("input_registers", 102, [102])
    peer.set("holding_registers", 65535, [103])
    code, rows, _ = said("read", *words, "c100", "10102", "I0x66", "465536")
    assert code == 0
    assert [cells(row)[0::3] for row in rows[2:]] == [["30103", "102"], ["465536", "103"]]
    assert [cells(row) for row in rows[:2]] == [["00101", "c100", "1"], ["10102", "d101", "1"]]


def test_a_float_is_shown_as_it_was_meant(tcp: tuple[Device, list[str]], said: Said) -> None:
    peer, words = tcp
    peer.set("holding_registers", 200, [*FLOAT, FLOAT[1], FLOAT[0]])
    assert cells(said("read", *words, "h200", "--format", "float32")[1][0])[-1] == "123.456"
    swapped = said("read", *words, "h202", "--format", "float32", "--word-order", "little", "--json")[1]
    record = json.loads(swapped[0])
    assert record["value"] == struct.unpack(">f", bytes.fromhex("42f6e979"))[0]
    assert (record["register"], record["address"], record["raw"]) == ("40203", 202, FLOAT[::-1])


def test_a_number_that_is_none_is_null_in_json(tcp: tuple[Device, list[str]], said: Said) -> None:
    peer, words = tcp
    peer.set("holding_registers", 210, [0x7FC0, 0])
    assert json.loads(said("read", *words, "h210", "--format", "float32", "--json")[1][0])["value"] is None
    assert cells(said("read", *words, "h210", "--format", "float32")[1][0])[-1] == "nan"


def test_more_than_a_request_takes_is_read_in_several(tcp: tuple[Device, list[str]], said: Said) -> None:
    peer, words = tcp
    peer.set("holding_registers", 1000, range(300))
    peer.requests.clear()
    _, rows, _ = said("read", *words, "h1000", "-n", 300)
    assert [int(cells(row)[3]) for row in rows] == list(range(300))
    assert [request[3:] for request in peer.requests] == [b"\0\x7d", b"\0\x7d", b"\0\x32"]
    assert len(said("read", *words, "c1000", "-n", 2001)[1]) == 2001
    assert len(said("read", *words, "h1000", "-n", 63, "--format", "float32")[1]) == 63


def test_an_exception_has_its_name_and_what_to_do(device: tuple[Device, list[str]], said: Said) -> None:
    peer, words = device
    peer.set("holding_registers", 20, [5])
    code, rows, complaints = said("read", *words, f"h{ABSENT}", "h20")
    assert code == 1
    assert [cells(row)[1] for row in rows] == ["h20"]  # the next one is asked for
    assert (
        f"unit {UNIT} refuses the read of holding register {ABSENT}: exception 2, illegal data" in complaints
    )
    assert f"next step: {EXCEPTIONS[2][1]}" in complaints


# ---- write -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "table", "address", "becomes", "function"),
    [
        (["h300", "4711"], "holding_registers", 300, [4711], 6),
        (["40301", "-2"], "holding_registers", 300, [0xFFFE], 6),
        (["h300", "0x12", "--multiple"], "holding_registers", 300, [0x12], 16),
        (["h300", "1", "2", "3"], "holding_registers", 300, [1, 2, 3], 16),
        (["h300", "123.456", "--format", "float32"], "holding_registers", 300, FLOAT, 16),
        (["h300", "-2", "--format", "int64"], "holding_registers", 300, [0xFFFF] * 3 + [0xFFFE], 16),
        (["c300", "on"], "coils", 300, [1], 5),
        (["00301", "off"], "coils", 300, [0], 5),
        (["c300", "1", "--multiple"], "coils", 300, [1], 15),
        (["c300", *["on", "off"] * 5], "coils", 300, [1, 0] * 5, 15),
    ],
)  # fmt: skip
def test_what_is_written_is_there_and_read_back(
    device: tuple[Device, list[str]],
    said: Said,
    words: list[str],
    table: str,
    address: int,
    becomes: list[int],
    function: int,
) -> None:
    peer, where = device
    peer.set(table, address, [1 - value if table == "coils" else 9 for value in becomes])
    peer.requests.clear()
    code, rows, complaints = said("write", *where, *words)
    assert (code, complaints) == (0, "")
    assert all(row.endswith("  as written") for row in rows)
    assert peer.get(table, address, len(becomes)) == becomes
    assert [request[0] for request in peer.requests] == [function, {"coils": 1}.get(table, 3)]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["d5", "1"], "discrete inputs cannot be written"),
        (["i5", "1"], "input registers cannot be written"),
        (["c5", "2"], '"2" is no state of a coil'),
        (["h5", "x"], '"x" is no integer, which uint16 needs'),
        (["h5", "65536"], '"65536" is out of the range of uint16'),
        (["h5", "-32769"], '"-32769" is out of the range of int16'),
        (["h5", "1e99", "--format", "float32"], '"1e99" is out of the range of float32'),
        (["h5", "nan", "--format", "float32"], '"nan" is no number that can be written'),
        (["h65535", "1", "2"], "go beyond address 65535"),
        (["h5", *["1"] * 124], "one request writes at most 123"),
    ],
)
def test_what_cannot_be_written_is_not_sent(
    tcp: tuple[Device, list[str]], said: Said, words: list[str], says: str
) -> None:
    peer, where = tcp
    peer.requests.clear()
    code, rows, complaints = said("write", *where, *words)
    assert (code, rows) == (2, [])
    assert says in complaints
    assert peer.requests == []


# ---- lines where something is wrong ----------------------------------------------------------------


class Strange:
    """What answers each request with what it is told, on a serial server of 127.0.0.1."""

    def __init__(self, *answers: bytes) -> None:
        self._answers = list(answers)
        self.requests: list[bytes] = []
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.place = f"127.0.0.1:{self._listener.getsockname()[1]}"
        self._thread = threading.Thread(target=self._serve)

    def __enter__(self) -> "Strange":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._listener.close()
        self._thread.join(PATIENCE_S)

    def _serve(self) -> None:
        with contextlib.suppress(OSError):
            peer, _ = self._listener.accept()
            with peer:
                while request := peer.recv(300):
                    self.requests.append(request)
                    peer.sendall(self._answers.pop(0) if self._answers else b"")


def rtu(text: str) -> bytes:
    octets = bytes.fromhex(text)
    return octets + frames.crc(octets)


REQUEST = rtu("05 03 0010 0001")
ANSWER = rtu("05 03 02 1234")


def read_from(strange: Strange, said: Said, timeout_s: float = PATIENCE_S) -> tuple[int, list[str], str]:
    return said("read", strange.place, "--rtu", "-u", 5, "h16", timeout_s=timeout_s)


@pytest.mark.parametrize(
    "answer",
    [ANSWER, REQUEST + ANSWER, b"\0" + ANSWER, b"\xff\0" + ANSWER],
    ids=["plain", "echo", "0", "ff0"],
)
def test_an_answer_is_found_behind_an_echo_and_noise(said: Said, answer: bytes) -> None:
    with Strange(answer) as strange:
        code, rows, complaints = read_from(strange, said)
    assert (code, complaints) == (0, "")
    assert cells(rows[0])[2] == "0x1234"
    assert strange.requests == [REQUEST]


def test_an_answer_may_come_octet_by_octet(said: Said) -> None:
    """As adapters and serial servers give it; here behind a 0, and before another."""
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def serve() -> None:
            peer, _ = listener.accept()
            with peer:
                peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                peer.recv(300)
                for octet in b"\0" + ANSWER + b"\0":
                    with contextlib.suppress(OSError):  # who has the answer leaves
                        peer.sendall(bytes([octet]))

        thread = threading.Thread(target=serve)
        thread.start()
        code, rows, _ = said("read", f"127.0.0.1:{listener.getsockname()[1]}", "--rtu", "-u", 5, "h16")
        thread.join(PATIENCE_S)
    assert (code, cells(rows[0])[2]) == (0, "0x1234")


# MODBUS over Serial Line V1.02, 2.5.2.1: a colon, digits, the LRC, CR and LF.


@pytest.mark.parametrize(
    ("answer", "found"),
    [
        (b":0503021234B0\r\n", "0x1234"),
        (b":050300100001E7\r\n:0503021234B0\r\n", "0x1234"),  # an echo
        (b"x\xff:0503:0503021234B0\r\n", "0x1234"),  # noise, and a frame that was begun anew
    ],
    ids=["plain", "echo", "noise"],
)
def test_ascii_is_read(said: Said, answer: bytes, found: str) -> None:
    with Strange(answer) as strange:
        code, rows, complaints = said("read", strange.place, "--ascii", "-u", 5, "h16")
    assert (code, complaints) == (0, "")
    assert cells(rows[0])[2] == found
    assert strange.requests == [b":050300100001E7\r\n"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--rtu", "--ascii"), "--rtu and --ascii: a line speaks one of them"),
        (("--data-bits", 7), "--data-bits 7: RTU sends whole octets"),
    ],
)
def test_ascii_goes_not_with_everything(said: Said, words: tuple[object, ...], message: str) -> None:
    code, _, complaints = said("read", "/dev/none", *words, "-u", 5, "h16")
    assert code == 2
    assert message in complaints


def test_ascii_with_a_wrong_lrc_is_damaged(said: Said) -> None:
    with Strange(b":0503021234B1\r\n") as strange:
        code, rows, complaints = said("read", strange.place, "--ascii", "-u", 5, "h16", timeout_s=PATIENCE_S)
    assert (code, rows) == (1, [])
    assert "an answer with a wrong LRC came" in complaints


def test_octets_are_printed_with_their_times(said: Said) -> None:
    with Strange(ANSWER) as strange:
        code, rows, complaints = said("read", strange.place, "--rtu", "-u", 5, "h16", "--octets")
    assert (code, len(rows)) == (0, 1)
    time_of_day = r"\d\d:\d\d:\d\d\.\d{6}"
    shown = f"{time_of_day} > {REQUEST.hex(' ')}\n{time_of_day} < {ANSWER.hex(' ')}\n"
    assert re.fullmatch(shown, complaints)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("answer", "says"),
    [
        (b"", "unit 5 on 127.0.0.1 port "),
        (REQUEST, "only the request itself came back"),
        (ANSWER[:-1] + bytes([ANSWER[-1] ^ 1]), "an answer with a wrong CRC came"),
        (ANSWER[:4], "no whole answer came"),
        (rtu("09 03 0000 0001"), "somebody asked unit 9 something when unit 5 was to answer"),
        (b"\x7f" * 30, "came to the read of holding register 16 of unit 5: 7f 7f"),
        (rtu("06 03 02 1234"), "unit 6 answered, not unit 5: 06 03 02 12 34"),
        (rtu("05 03 04 1234 5678"), "unit 5 answered something else than the read of holding register 16"),
        (rtu("05 83 0b"), "exception 11, gateway target device failed to respond"),
        (rtu("05 83 63"), "exception 99, not in the standard"),
    ],
    ids=["silence", "echo", "crc", "short", "master", "noise", "unit", "length", "exception", "unknown"],
)
def test_what_is_wrong_is_said(said: Said, answer: bytes, says: str) -> None:
    with Strange(answer) as strange:
        code, rows, complaints = read_from(strange, said, SHORT_S)
    assert (code, rows) == (1, [])
    assert says in complaints
    assert complaints.startswith("openrtu read: ")


@pytest.mark.slow
def test_a_write_that_is_not_answered_may_have_been_done(said: Said) -> None:
    with Strange() as strange:
        code, rows, complaints = said("write", strange.place, "--rtu", "-u", 5, "h16", 7, timeout_s=SHORT_S)
    assert (code, rows) == (1, [])
    assert "the device may or may not have done it" in complaints
    assert strange.requests == [rtu("05 06 0010 0007")]  # and it is not repeated


def test_a_write_of_which_something_else_comes_back_is_said(said: Said) -> None:
    with Strange(rtu("05 06 0010 0007"), rtu("05 03 02 0006")) as strange:
        code, rows, _ = said("write", strange.place, "--rtu", "-u", 5, "h16", 7)
    assert code == 1
    assert rows[0].endswith("6  but 7 was written")


def test_a_write_that_cannot_be_read_back_was_confirmed(said: Said) -> None:
    with Strange(rtu("05 06 0010 0007"), rtu("05 83 02")) as strange:
        code, _, complaints = said("write", strange.place, "--rtu", "-u", 5, "h16", 7)
    assert code == 1
    assert "the device confirmed the write, but: unit 5 refuses the read" in complaints


@pytest.mark.slow
def test_a_broadcast_is_sent_and_nobody_is_waited_for(said: Said) -> None:
    with Strange() as strange:
        code, rows, _ = said("write", strange.place, "--rtu", "-u", 0, "h16", 7, timeout_s=SHORT_S)
    assert code == 0
    assert rows == ["sent to all units; nobody answers, so nobody knows who did it"]
    assert strange.requests == [rtu("00 06 0010 0007")]


def test_unit_0_of_tcp_is_one_like_others(said: Said) -> None:
    with Strange(mbap(1, "00 03 02 1234")) as strange:
        code, rows, _ = said("read", strange.place, "-u", 0, "h16")
    assert (code, cells(rows[0])[2]) == (0, "0x1234")


def test_the_other_function_is_named_where_one_is_unknown(said: Said) -> None:
    with Strange(rtu("05 86 01")) as strange:
        code, _, complaints = said("write", strange.place, "--rtu", "-u", 5, "h16", 7)
    assert code == 1
    assert "exception 1, illegal function" in complaints
    assert "try --multiple" in complaints


def mbap(transaction: int, body: str) -> bytes:
    octets = bytes.fromhex(body)
    return transaction.to_bytes(2) + bytes(2) + len(octets).to_bytes(2) + octets


@pytest.mark.slow
@pytest.mark.parametrize(
    ("answer", "says"),
    [
        (mbap(1, "ff 03 02 1234"), "answers as unit 255, not 5"),
        (b"SSH-2.0-OpenSSH_9\r\n", "does not speak Modbus TCP"),
        (ANSWER, "does not speak Modbus TCP"),
        (mbap(7, "05 03 02 1234"), "did not answer"),
        (mbap(1, "05 04 02 1234"), "something else than the read of holding register 16"),
    ],
    ids=["unit", "ssh", "rtu", "transaction", "function"],
)
def test_what_is_wrong_on_tcp_is_said(said: Said, answer: bytes, says: str) -> None:
    with Strange(answer) as strange:
        code, rows, complaints = said("read", strange.place, "-u", 5, "h16", timeout_s=SHORT_S)
    assert (code, rows) == (1, [])
    assert says in complaints


def test_an_answer_that_is_late_is_nobody_elses_on_tcp(said: Said) -> None:
    with Strange(mbap(9, "05 03 02 aaaa") + mbap(1, "05 03 02 1234")) as strange:
        code, rows, _ = said("read", strange.place, "-u", 5, "h16")
    assert (code, cells(rows[0])[2]) == (0, "0x1234")


def test_a_peer_that_hangs_up_is_said(said: Said) -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def serve() -> None:
            listener.accept()[0].close()

        thread = threading.Thread(target=serve)
        thread.start()
        code, _, complaints = said("read", f"127.0.0.1:{listener.getsockname()[1]}", "-u", 5, "h16")
        thread.join()
    assert code == 1
    assert "closed the connection" in complaints


def test_nobody_is_asked_what_the_words_already_forbid(said: Said) -> None:
    assert said("read", "127.0.0.1:1", "-u", 5, "h16")[0] == 2
    assert "refuses the connection" in said("read", "127.0.0.1:1", "-u", 5, "h16")[2]
    assert "no serial port" in said("read", "/dev/null", "-u", 5, "h16")[2]
    assert "cannot be opened: No such file" in said("read", "/dev/ttyNONE9", "-u", 5, "h16")[2]
    assert "nobody answers" in said("read", "/dev/null", "-u", 0, "h16")[2]
    assert "nobody answers" in said("read", "127.0.0.1:1", "--rtu", "-u", 0, "h16")[2]
    assert "1 to 247" in said("read", "/dev/null", "-u", 248, "h16")[2]
    assert "beyond address 65535" in said("read", "127.0.0.1:1", "-u", 5, "h65535", "-n", 2)[2]
    assert "no HOST or HOST:PORT" in said("read", "127.0.0.1:x", "-u", 5, "h1")[2]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["100"], "for Modbus address 100 write h100"),
        (["x"], "expected a number as manuals print it"),
        (["h1", "--baud", "12345"], "is no speed of a serial port"),
        (["h1", "--format", "int12"], "invalid choice"),
    ],
)
def test_words_that_are_none(capsys: pytest.CaptureFixture[str], words: list[str], says: str) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["read", "127.0.0.1", "-u", "5", *words])
    assert ended.value.code == 2
    assert says in capsys.readouterr().err


@pytest.mark.parametrize(
    ("parity", "stop_bits", "flags"),
    [
        ("none", 1, 0),
        ("none", 2, termios.CSTOPB),
        ("odd", 1, termios.PARENB | termios.PARODD),
        ("even", 1, termios.PARENB),
    ],
)
def test_a_port_is_set_as_it_is_said(
    serial: tuple[Device, list[str]], monkeypatch: pytest.MonkeyPatch, parity: str, stop_bits: int, flags: int
) -> None:
    """What a UART is told; a pseudo-terminal carries no parity."""
    _, words = serial
    told: list[list[Any]] = []
    monkeypatch.setattr(serial_port, "is_pty", lambda _: False)
    monkeypatch.setattr(termios, "tcsetattr", lambda _, __, settings: told.append(settings))
    known = termios.tcgetattr
    monkeypatch.setattr(termios, "tcgetattr", lambda port: told[-1] if told else known(port))
    port = os.open(words[0], os.O_RDWR | os.O_NOCTTY)
    try:
        serial_port.configure(words[0], port, serial_port.Settings(9600, parity, stop_bits))
    finally:
        os.close(port)
    (settings,) = told
    assert settings[2] == termios.CS8 | termios.CREAD | termios.CLOCAL | flags
    assert settings[4:6] == [termios.B9600, termios.B9600]


# ---- who has the line ------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_line_of_the_gateway_is_refused(programs: Path, said: Said) -> None:
    """And is free again when it has ended."""
    directory = run_directory()
    (directory / "dev").mkdir()
    ours = directory / "dev/ttyS1"
    of_line = {"active": 1, "baud_rate": BAUD_RATE, "data_bits": 8, "stop_bits": 1, "parity": 0}
    slave = {"id": UNIT, **patience(), "holding_registers": [{"address": 16}]}
    config = listening_on({"port": [{"value": 1, **of_line, "slaves": [slave]}]}, free_port())
    words = ["read", f"{ours}", "-u", f"{UNIT}", "--baud", f"{BAUD_RATE}", "--parity", "none", "h16"]
    with contextlib.ExitStack() as stack:
        stack.callback(remove, directory)
        stack.enter_context(line(ours, directory / "its"))
        device = PymodbusDevice(directory / "its")
        device.start()
        stack.callback(device.stop)
        with Gateway(config, directory, programs) as gateway:
            good = {"quality": "good"}.items()
            gateway.wait_for(
                lambda: all(good <= point.items() for point in gateway.points("p1.*").values()),
                60.0,
                "the device is read",
            )
            code, rows, complaints = said(*words)
            assert (code, rows) == (2, [])
            assert re.search(rf"{ours} is a line of the gateway: rtu-modbus-1 \(\d+\) has", complaints)
            assert "next step: " in complaints
        assert said(*words)[0] == 0


@pytest.mark.parametrize("hidden", [False, True], ids=["seen", "of another user"])
def test_a_port_of_another_program_is_refused(
    serial: tuple[Device, list[str]], said: Said, monkeypatch: pytest.MonkeyPatch, hidden: bool
) -> None:
    """It is named by what it has open, or by its lock alone."""
    if hidden:
        monkeypatch.setattr(ports, "_has_open", lambda *_: False)
    _, words = serial
    hold = "import fcntl, sys; port = open(sys.argv[1]); fcntl.flock(port, fcntl.LOCK_EX); print(); input()"
    with subprocess.Popen(
        [sys.executable, "-c", hold, words[0]], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdin and other.stdout
        other.stdout.readline()
        code, _, complaints = said("read", *words, "h16")
        other.stdin.close()
    assert code == 2
    assert re.search(rf"is used by python\S* \({other.pid}\)", complaints)


@pytest.mark.parametrize(
    ("group", "advice"), [("dialout", "usermod -aG dialout $USER"), ("root", "udev rule")]
)
def test_a_port_that_is_denied_names_its_group(
    serial: tuple[Device, list[str]], said: Said, monkeypatch: pytest.MonkeyPatch, group: str, advice: str
) -> None:
    _, words = serial

    def denied(*_: object) -> int:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("openrtu_tools.modbus.serial_port.os.open", denied)
    monkeypatch.setattr(Path, "group", lambda _: group)
    code, _, complaints = said("read", *words, "h16")
    assert code == 2
    assert "cannot be opened: Permission denied" in complaints
    assert advice in complaints


# ---- poll ------------------------------------------------------------------------------------------


def reader(stream: Any) -> Callable[[], str]:
    """Its next line, which must come; at the end, an empty one."""
    lines: queue.Queue[str] = queue.Queue()

    def collect() -> None:
        for text in stream:
            lines.put(text)
        lines.put("")

    threading.Thread(target=collect, daemon=True).start()
    return lambda: lines.get(timeout=PATIENCE_S)


@contextlib.contextmanager
def polling(*words: str) -> Iterator[subprocess.Popen[str]]:
    command = [OPENRTU, "poll", *words, "--timeout", str(PATIENCE_S)]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, bufsize=1, start_new_session=True
    ) as process:
        try:
            yield process
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)


def test_poll_prints_what_changes_and_ends_with_statistics(tcp: tuple[Device, list[str]]) -> None:
    peer, words = tcp
    peer.set("holding_registers", 400, [1, 2])
    with polling(*words, "h400", "-n", "2", "--period", "0.05") as process:
        next_line = reader(process.stdout)
        stamp = r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d\.\d{3}  "
        assert re.fullmatch(stamp + r"40401  h400 +0x0001  1\n", next_line())
        assert next_line().endswith("  2\n")
        peer.set("holding_registers", 401, [3])  # and the other one is not printed again
        assert re.fullmatch(stamp + r"40402  h401 +0x0003  3\n", next_line())
        os.kill(process.pid, signal.SIGINT)
        assert process.wait(PATIENCE_S) == 0
        assert next_line() == ""
        assert process.stderr
        last = process.stderr.read()
    found = re.fullmatch(
        r"(\d+) requests in [\d.]+ s: (\d+) answered; answers took ([\d.]+) ms at least, "
        r"([\d.]+) on average, ([\d.]+) at most\n",
        last,
    )
    assert found, last
    assert int(found[1]) >= int(found[2]) >= 2
    assert float(found[3]) <= float(found[4]) <= float(found[5])


@pytest.mark.slow
def test_poll_goes_on_when_a_device_comes_back(said: Said) -> None:
    port = free_port()
    device = PymodbusDevice(port)
    device.start()
    with polling(f"127.0.0.1:{port}", "-u", f"{UNIT}", "h16", "--period", "0.05", "--json") as process:
        out, complaints = reader(process.stdout), reader(process.stderr)
        assert json.loads(out())["value"] == 0
        device.stop()
        assert "closed the connection" in complaints() or "refuses the connection" in complaints()
        device = PymodbusDevice(port)
        device.start()
        device.set("holding_registers", 16, [77])
        while (value := json.loads(out())["value"]) != 77:
            assert value == 0
        os.kill(process.pid, signal.SIGINT)
        assert process.wait(PATIENCE_S) == 0
    device.stop()


@pytest.mark.slow
def test_poll_leaves_a_connection_that_hangs(said: Said) -> None:
    """It answers nothing any more, and a new one works."""
    listener = socket.create_server(("127.0.0.1", 0))
    served: list[int] = []

    def serve() -> None:
        for answers in (False, True):
            peer, _ = listener.accept()
            served.append(0)
            with peer:
                while request := peer.recv(300):
                    served[-1] += 1
                    if answers:
                        peer.sendall(mbap(int.from_bytes(request[:2]), "05 03 02 1234"))

    thread = threading.Thread(target=serve)
    thread.start()
    place = f"127.0.0.1:{listener.getsockname()[1]}"
    code, rows, complaints = said(
        "poll", place, "-u", 5, "h16", "--times", 6, "--period", 0, timeout_s=SHORT_S
    )
    thread.join(PATIENCE_S)
    listener.close()
    assert (code, len(rows), served[0]) == (0, 1, 3)
    assert "6 requests in" in complaints


@pytest.mark.slow
def test_poll_ends_by_itself_and_says_that_nothing_was_answered(said: Said) -> None:
    with Strange() as strange:
        words = [strange.place, "--rtu", "-u", 5, "h16", "--times", 2, "--period", 0]
        code, rows, complaints = said("poll", *words, timeout_s=0.1)
    assert (code, rows) == (1, [])
    assert complaints.count("did not answer") == 1  # once, until something else comes of it
    assert "2 requests in " in complaints
    assert "2 not answered" in complaints


@pytest.mark.slow
def test_a_late_answer_is_not_the_next_ones(said: Said) -> None:
    """The second request waits until no answer to the first can come."""
    listener = socket.create_server(("127.0.0.1", 0))
    asked: list[bytes] = []

    def serve() -> None:
        peer, _ = listener.accept()
        with peer:
            asked.append(peer.recv(300))
            peer.settimeout(PATIENCE_S)
            late = threading.Timer(SHORT_S + 0.5, peer.sendall, [rtu("05 03 02 0001")])
            late.start()
            asked.append(peer.recv(300))
            late.join()
            peer.sendall(rtu("05 03 02 0002"))
            peer.recv(300)

    thread = threading.Thread(target=serve)
    thread.start()
    place = f"127.0.0.1:{listener.getsockname()[1]}"
    words = [place, "--rtu", "-u", 5, "h16", "--times", 2, "--period", 0]
    code, rows, complaints = said("poll", *words, timeout_s=SHORT_S)
    thread.join(PATIENCE_S)
    listener.close()
    assert len(asked) == 2
    assert code == 0 and "1 not answered" in complaints
    assert [row.split()[-1] for row in rows] == ["2"]
