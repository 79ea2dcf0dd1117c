# SPDX-License-Identifier: GPL-3.0-or-later
"""`openrtu scan` on devices of other makes, and on lines that others use."""

import contextlib
import fcntl
import json
import os
import re
import select
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from pymodbus import ModbusDeviceIdentification

from lab.gateway import free_port, remove, run_directory
from lab.linesim import LineSim
from nuc980.errors import UnusableInput
from openrtu_tools import devices
from openrtu_tools.cli import main
from openrtu_tools.modbus import frames, scan
from peers.device import BAUD_RATE, UNIT
from peers.libmodbus_device import LibmodbusDevice
from peers.line import line
from peers.pymodbus_device import PymodbusAsciiDevice, PymodbusDevice
from rig.configuration import check_document

PATIENCE_S = 30
TIMEOUT_S = 2.0  # of a device that answers, on a busy host
SHORT_S = 0.2  # where nobody answers
FUNCTION_AT = 7  # of a frame on TCP
IDENTIFY = b"\x2b"
READS = {1, 2, 3, 4, 43}
Scanned = tuple[int, dict[str, Any], str]


@pytest.fixture
def ends() -> Iterator[tuple[Path, Path]]:
    directory = run_directory()
    with contextlib.ExitStack() as stack:
        stack.callback(remove, directory)
        stack.enter_context(line(directory / "ours", directory / "its"))
        yield directory / "ours", directory / "its"


@pytest.fixture
def scanned(capsys: pytest.CaptureFixture[str]) -> Callable[..., Scanned]:
    """Runs a scan; its exit code, the configuration that it printed, and what it said."""

    def run(*words: str | Path, timeout_s: float = TIMEOUT_S) -> Scanned:
        code = main(["scan", *map(str, words), "--timeout", str(timeout_s)])
        said = capsys.readouterr()
        return code, json.loads(said.out) if said.out else {}, said.err

    return run


def rtu(text: str) -> bytes:
    octets = bytes.fromhex(text)
    return octets + frames.crc(octets)


class Scripted:
    """What is on the other end of a line: says what it is told to each request."""

    def __init__(self, end: Path, answer: Callable[[bytes], bytes]) -> None:
        self._port = os.open(end, os.O_RDWR | os.O_NOCTTY)
        self._answer = answer
        self._stop, self._stopper = os.pipe()
        self.requests: list[bytes] = []
        self._thread = threading.Thread(target=self._serve)

    def __enter__(self) -> "Scripted":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._stopper)
        self._thread.join(PATIENCE_S)
        os.close(self._stop)
        os.close(self._port)

    def _serve(self) -> None:
        heard = b""
        while True:
            ready, _, _ = select.select([self._port, self._stop], [], [])
            if self._stop in ready:
                return
            heard += os.read(self._port, 256)
            while len(heard) >= 8 or (heard[1:2] == IDENTIFY and len(heard) == 7):
                size = 7 if heard[1:2] == IDENTIFY else 8
                request, heard = heard[:size], heard[size:]
                self.requests.append(request)
                os.write(self._port, self._answer(request))


# ---- what is found ---------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_device_of_a_line_is_found(
    ends: tuple[Path, Path], scanned: Callable[..., Scanned], programs: Path, tmp_path: Path
) -> None:
    ours, its = ends
    device = LibmodbusDevice(its)
    device.start()
    try:
        code, found, said = scanned(
            ours, "-u", f"{UNIT},15", "--baud", "115200,9600", "--parity", "none,even"
        )
    finally:
        device.stop()
    assert code == 0
    assert "1 port with 4 settings, 2 units each: takes " in said.splitlines()[0]
    of_line = {"device": str(ours), "baud_rate": 115200, "data_bits": 8, "stop_bits": 1, "parity": 0}
    assert found == {"port": [{"value": 7, "active": 1, **of_line, "slaves": [{"id": UNIT}]}]}
    assert f"{ours}, 115200 bit/s 8N1, unit {UNIT}: knows functions 1, 2, 3, 4" in said
    assert "9600" not in said  # a line has one speed
    assert {request[0] for request in device.requests} <= READS
    found["port"][0]["slaves"][0]["holding_registers"] = [{"address": 16}]
    file = tmp_path / "gateway.json"
    file.write_text(json.dumps(found))
    checked = subprocess.run(
        [programs / "rtud/rtud", "--check", file], capture_output=True, text=True, check=False
    )
    assert checked.returncode == 0, checked.stderr


def test_a_device_of_an_ascii_line_is_found_and_says_who_it_is(
    ends: tuple[Path, Path], scanned: Callable[..., Scanned]
) -> None:
    ours, its = ends
    device = PymodbusAsciiDevice(its)
    device.start()
    try:
        code, found, said = scanned(ours, "-u", f"{UNIT}", "--ascii", "--baud", BAUD_RATE)
    finally:
        device.stop()
    assert code == 0
    of_line = {"device": str(ours), "baud_rate": BAUD_RATE, "data_bits": 7, "stop_bits": 1, "parity": 2}
    slave = {"id": UNIT, "description": "pymodbus peer"}
    assert found == {"port": [{"value": 7, "active": 1, **of_line, "framing": "ascii", "slaves": [slave]}]}
    assert f"{ours}, {BAUD_RATE} bit/s 7E1 ASCII, unit {UNIT}: knows functions 1, 2, 3, 4; " in said
    assert "; pymodbus, peer, 1.0; " in said
    assert {request[0] for request in device.requests} == READS


def test_ascii_goes_not_with_addresses(scanned: Callable[..., Scanned]) -> None:
    code, _, said = scanned("192.0.2.1", "-u", "1", "--ascii")
    assert code == 2
    assert "--ascii: a scan of addresses asks by Modbus TCP alone" in said


def test_a_device_on_tcp_says_who_it_is(scanned: Callable[..., Scanned]) -> None:
    device = PymodbusDevice(free_port())
    device.identity = ModbusDeviceIdentification(
        info_name={"VendorName": "Acme", "ProductCode": "P-7", "MajorMinorRevision": "1.2"}
    )
    device.start()
    try:
        code, found, said = scanned(f"127.0.0.1-3:{device.place}", "-u", f"{UNIT}")
    finally:
        device.stop()
    assert code == 0
    assert "3 addresses, 1 unit each" in said
    assert f"127.0.0.1 port {device.place}, unit {UNIT}: knows functions 1, 2, 3, 4; " in said
    assert "; Acme, P-7, 1.2; fits no template" in said
    (port,) = found["port"]
    assert port == {
        "value": 7, "active": 1, "host": "127.0.0.1", "tcp_port": device.place,
        "slaves": [{"id": UNIT, "description": "Acme P-7"}],
    }  # fmt: skip
    assert {request[0] for request in device.requests} <= READS
    assert any(request[0] == 43 for request in device.requests)


@contextlib.contextmanager
def serving(answer: Callable[[bytes], bytes | None]) -> Iterator[int]:
    """Modbus TCP with an answer's body to each request's; None: it hangs up."""
    listener = socket.create_server(("127.0.0.1", 0))

    def serve() -> None:
        with contextlib.suppress(OSError):
            while True:
                peer, _ = listener.accept()
                with peer:
                    while request := peer.recv(300):
                        body = answer(request[6:])
                        if body is None:
                            break
                        if body:
                            peer.sendall(request[:4] + len(body).to_bytes(2) + body)

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    yield listener.getsockname()[1]
    listener.shutdown(socket.SHUT_RDWR)
    listener.close()
    thread.join(PATIENCE_S)


def answer_to(request: bytes, unit: int) -> bytes:
    """Registers or a bit that are 0; identification is unknown."""
    function = request[1]
    if function == 43:
        return bytes([unit, 0xAB, 1])
    size = 2 * request[5] if function in (3, 4) else 1
    return bytes([unit, function, size]) + bytes(size)


def units_of(found: dict[str, Any]) -> list[int]:
    return [slave["id"] for port in found.get("port", []) for slave in port["slaves"]]


def test_behind_a_gateway_a_missing_unit_is_missing(scanned: Callable[..., Scanned]) -> None:
    def answer(request: bytes) -> bytes:
        unit = request[0]
        return answer_to(request, unit) if unit == 3 else bytes([unit, request[1] | 0x80, 10 + unit % 2])

    with serving(answer) as port:
        code, found, _ = scanned(f"127.0.0.1:{port}", "-u", "1-5")
    assert (code, units_of(found)) == (0, [3])


def test_a_unit_of_which_all_is_refused_may_be_none(scanned: Callable[..., Scanned]) -> None:
    """The servers of pymodbus and uModbus answer for all units."""

    def answer(request: bytes) -> bytes:
        return bytes([request[0], request[1] | 0x80, 1 if request[1] in (1, 43) else 2])

    with serving(answer) as port:
        code, found, said = scanned(f"127.0.0.1:{port}", "-u", "9")
    assert (code, units_of(found)) == (0, [9])
    assert (
        "unit 9: knows functions 2, 3, 4; refuses address 0 of each (exception 2), as some servers do" in said
    )


def test_a_peer_that_hangs_up_on_an_unknown_unit_is_asked_for_the_others(
    scanned: Callable[..., Scanned],
) -> None:
    with serving(lambda request: answer_to(request, 3) if request[0] == 3 else None) as port:
        code, found, _ = scanned(f"127.0.0.1:{port}", "-u", "1-5")
    assert (code, units_of(found)) == (0, [3])


def test_a_peer_with_one_unit_for_all_is_one_device(scanned: Callable[..., Scanned]) -> None:
    with serving(lambda request: answer_to(request, 255)) as port:
        code, found, _ = scanned(f"127.0.0.1:{port}", "-u", "1-5")
    assert (code, units_of(found)) == (0, [255])


def test_what_speaks_no_modbus_is_said(scanned: Callable[..., Scanned]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def serve() -> None:
            peer, _ = listener.accept()
            with peer:
                peer.sendall(b"SSH-2.0-OpenSSH_9\r\n")
                while peer.recv(300):
                    pass

        thread = threading.Thread(target=serve)
        thread.start()
        code, found, said = scanned(f"127.0.0.1:{listener.getsockname()[1]}", "-u", "1-5")
        thread.join(PATIENCE_S)
    assert (code, found) == (1, {})
    assert "does not speak Modbus TCP" in said
    assert said.endswith("nothing answered\n")


@pytest.mark.slow
def test_nobody_is_there(ends: tuple[Path, Path], scanned: Callable[..., Scanned]) -> None:
    ours, its = ends
    with Scripted(its, lambda _: b"") as nobody:
        code, found, said = scanned(ours, "-u", "1-3", "--parity", "even,none", timeout_s=SHORT_S)
    assert (code, found) == (1, {})
    assert [request[:2] for request in nobody.requests] == [bytes([unit, 3]) for unit in (1, 2, 3)] * 2
    assert said.endswith("nothing answered\n")


# ---- which template fits ----------------------------------------------------------------------------


KNOWN_BY_REGISTERS = [
    "abb-b23",
    "datakom-d500",
    "deif-agc150",
    "dse-gencomm",
    "em24-e1",
    "sungrow-sh",
    "victron-evcs",
]
TEMPLATES = {template.name: template for template in devices.read(devices.folder())}
COIL = {"coils": [{"address": 0}]}
ACME = {"vendor_name": "Acme", "product_code": "P-7"}


@contextlib.contextmanager
def simulated(program: Path, folder: Path, slaves: list[dict[str, Any]]) -> Iterator[int]:
    """Devices behind one address, units from 1 on; its port."""
    port = free_port()
    own = [slave | {"id": unit} for unit, slave in enumerate(slaves, 1)]
    line = {"value": 7, "active": 1, "host": "127.0.0.1", "tcp_port": port, "slaves": own}
    (folder / "devices.json").write_text(json.dumps({"port": [line]}))
    with LineSim(folder / "devices.json", None, folder / "lines", serves_tcp=True, program=program) as lines:
        yield port
        asked = {frame.bytes[FUNCTION_AT] for frame in lines.frames(0) if frame.kind == "received"}
        assert asked <= READS


def test_the_template_that_fits_is_named_and_used(
    linesim_program: Path, programs: Path, scanned: Callable[..., Scanned], tmp_path: Path
) -> None:
    slaves = [TEMPLATES[name].template for name in KNOWN_BY_REGISTERS]
    with simulated(linesim_program, tmp_path, [*slaves, COIL]) as port:
        code, found, said = scanned(f"127.0.0.1:{port}", "-u", f"1-{len(slaves) + 1}", "--function", "1")
    lines = [line.rpartition("; ")[2] for line in said.splitlines() if ", unit " in line]
    assert lines == [
        *(f"fits {name}" for name in KNOWN_BY_REGISTERS), "fits no template that says how its device is known"
    ]  # fmt: skip
    used = [slave.get("template") for slave in found["port"][0]["slaves"]]
    assert (code, used) == (0, [*KNOWN_BY_REGISTERS, None])
    assert found["include"] == sorted(str(TEMPLATES[name].file) for name in KNOWN_BY_REGISTERS)
    found["port"][0]["slaves"].pop()  # which has no objects yet
    checked = check_document(programs, tmp_path, found)
    assert checked.returncode == 0, checked.stderr


def test_models_of_sunspec_are_named_where_they_are(
    linesim_program: Path, scanned: Callable[..., Scanned], tmp_path: Path
) -> None:
    def sunspec(*heads: tuple[int, int]) -> dict[str, Any]:
        """A device of models with these numbers and lengths."""
        known, address = [[40000, 0x5375], [40001, 0x6E53]], 40002
        for number, length in [*heads, (0xFFFF, 0)]:
            known += [[address, number], [address + 1, length]]
            address += 2 + length
        return COIL | {"identification": {"holding_registers": known}}

    usual, padded = sunspec((1, 65), (103, 50)), sunspec((1, 66), (103, 50), (64999, 4))
    with simulated(linesim_program, tmp_path, [usual, padded]) as port:
        code, found, said = scanned(f"127.0.0.1:{port}", "-u", "1-2", "--function", "1")
    first, second = (line for line in said.splitlines() if ", unit " in line)
    assert first.endswith("--sunspec 1@40002 103@40069; fits sunspec-model-103, sunspec-103")
    assert "--sunspec 1@40002 103@40070; fits no template" in second  # another maker's model has none
    assert (code, "include" in found) == (0, False)  # the user chooses among two


def test_a_folder_of_ones_own_is_compared_by_identification(
    linesim_program: Path, scanned: Callable[..., Scanned], tmp_path: Path
) -> None:
    templates = {"m1": COIL | {"identification": ACME | {"product_code": "P-8"}}}
    templates["m2"] = COIL | {"identification": ACME}
    (tmp_path / "own").mkdir()
    (tmp_path / "own/m.json").write_text(json.dumps({"templates": templates}))
    slaves = [templates["m2"], COIL | {"identification": ACME | {"vendor_name": "Other"}}]
    with simulated(linesim_program, tmp_path, slaves) as port:
        words = (f"127.0.0.1:{port}", "-u", "1-2", "--function", "1", "--folder", tmp_path / "own")
        code, found, said = scanned(*words)
    assert code == 0
    assert "unit 1: " in said and "; Acme, P-7; fits m2\n" in said
    assert "; Other, P-7; fits no template" in said
    assert [slave.get("template") for slave in found["port"][0]["slaves"]] == ["m2", None]


def test_a_device_that_hangs_up_at_a_register_is_found(scanned: Callable[..., Scanned]) -> None:
    def answer(request: bytes) -> bytes | None:
        return None if request[2:4] != bytes(2) and request[1] == 3 else answer_to(request, request[0])

    with serving(answer) as port:
        code, found, _ = scanned(f"127.0.0.1:{port}", "-u", "1-2")
    assert (code, units_of(found)) == (0, [1, 2])


def test_without_templates_it_says_so(
    scanned: Callable[..., Scanned], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(devices, "in_clone", lambda: False)
    monkeypatch.setattr(devices, "INSTALLED", [])
    with serving(lambda request: answer_to(request, request[0])) as port:
        code, _, said = scanned(f"127.0.0.1:{port}", "-u", "1")
    assert code == 0
    assert "looks for no template that fits: the templates come with the gateway" in said
    assert "fits" not in said.splitlines()[-1]


# ---- a line that others use ------------------------------------------------------------------------


@pytest.mark.slow
def test_nothing_is_sent_where_another_master_speaks(
    ends: tuple[Path, Path], scanned: Callable[..., Scanned]
) -> None:
    ours, its = ends
    stop = threading.Event()
    heard: list[bytes] = []

    def another() -> None:
        port = os.open(its, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        while not stop.is_set():
            os.write(port, rtu("09 03 0000 0001"))
            time.sleep(0.02)
            with contextlib.suppress(BlockingIOError):
                heard.append(os.read(port, 256))
        os.close(port)

    thread = threading.Thread(target=another)
    thread.start()
    code, found, said = scanned(ours, "-u", "1-5")
    stop.set()
    thread.join(PATIENCE_S)
    assert (code, found, heard) == (1, {}, [])
    assert f"somebody else speaks on {ours}: 09 03 00 00" in said
    assert "likely cause: another master is on the line" in said


@pytest.mark.slow
@pytest.mark.parametrize("strange", [rtu("c8 03 02 0000"), rtu("09 03 0000 0001") + rtu("09 03 02 0000")])
def test_a_scan_ends_when_another_master_begins(
    ends: tuple[Path, Path], scanned: Callable[..., Scanned], strange: bytes
) -> None:
    """By an answer of a unit that was not asked, or by a request to it."""
    ours, its = ends
    with Scripted(its, lambda _: strange) as peer:
        code, found, said = scanned(ours, "-u", "1-9")
    assert (code, found) == (1, {})
    assert "likely cause: another master is on the line" in said
    assert len(peer.requests) < 9


@pytest.mark.slow
def test_a_slow_device_is_found_though_it_answers_late(
    ends: tuple[Path, Path], scanned: Callable[..., Scanned]
) -> None:
    """Its answer comes while the next unit is asked, which is then asked again."""
    ours, its = ends
    late = [rtu("05 03 02 0000")]

    with Scripted(its, lambda request: late.pop() if request[0] == 6 and late else b"") as peer:
        code, found, said = scanned(ours, "-u", "5-6")
    assert (code, units_of(found)) == (0, [5])
    assert "unit 5: answers late: look at it again with a longer --timeout" in said
    assert {request[0] for request in peer.requests} == {5, 6}


@pytest.mark.slow
def test_what_is_damaged_is_said_and_the_scan_goes_on(
    ends: tuple[Path, Path], scanned: Callable[..., Scanned]
) -> None:
    ours, its = ends

    def answer(request: bytes) -> bytes:
        if request[0] == 2:
            return rtu("02 03 02 0000")[:-1] + b"\x55"
        return answer_to(request, 3) + frames.crc(answer_to(request, 3)) if request[0] == 3 else b""

    with Scripted(its, answer):
        code, found, said = scanned(ours, "-u", "2-3")
    assert (code, units_of(found)) == (0, [3])
    assert "an answer with a wrong CRC came to the read of holding register 0 of unit 2" in said


def test_a_line_that_is_locked_is_refused(ends: tuple[Path, Path], scanned: Callable[..., Scanned]) -> None:
    ours, _ = ends
    with ours.open() as port:
        fcntl.flock(port, fcntl.LOCK_EX)
        code, found, said = scanned(ours, "-u", "1")
    assert (code, found) == (2, {})
    assert f"{ours} is used by another process" in said


# ---- what is asked for -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "first", "last", "count"),
    [
        ("192.0.2.20", ("192.0.2.20", 502), ("192.0.2.20", 502), 1),
        ("192.0.2.10-20", ("192.0.2.10", 502), ("192.0.2.20", 502), 11),
        ("192.0.2.250-192.0.3.5:1502", ("192.0.2.250", 1502), ("192.0.3.5", 1502), 12),
        ("192.0.2.0/28", ("192.0.2.1", 502), ("192.0.2.14", 502), 14),
        ("meter-3.example:503", ("meter-3.example", 503), ("meter-3.example", 503), 1),
        ("2001:db8::1", ("2001:db8::1", 502), ("2001:db8::1", 502), 1),
        ("[2001:db8::1]:1502", ("2001:db8::1", 1502), ("2001:db8::1", 1502), 1),
    ],
)
def test_hosts(text: str, first: tuple[str, int], last: tuple[str, int], count: int) -> None:
    found = scan.hosts(text)
    assert (found[0], found[-1], len(found)) == (first, last, count)


@pytest.mark.parametrize(
    "text", ["192.0.2.20-10", "10.0.0.0/8", "10.0.0.0-10.255.0.0", "192.0.2.0/99", "x/y", "192.0.2.1:0", ":5"]
)
def test_hosts_that_are_none(text: str) -> None:
    with pytest.raises(UnusableInput):
        scan.hosts(text)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["127.0.0.1", "-u", "1-256"], "some beyond 255"),
        (["127.0.0.1", "-u", "5-1"], "has no units"),
        (["127.0.0.1", "-u", "x"], "is no list as 1-10,20"),
        (["127.0.0.1", "-u", "1", "--baud", "9600,9601"], '"9601" is no speed'),
        (["127.0.0.1", "-u", "1", "--parity", "none,mark"], "is no list of none, odd, even"),
    ],
)
def test_words_that_are_none(capsys: pytest.CaptureFixture[str], words: list[str], says: str) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["scan", *words])
    assert ended.value.code == 2
    assert says in capsys.readouterr().err


def test_units_that_a_line_has_not(scanned: Callable[..., Scanned]) -> None:
    assert "are 1 to 247" in scanned("/dev/null", "-u", "0-5")[2]
    assert "are 1 to 247" in scanned("/dev/null", "-u", "248")[2]


def test_the_time_is_said_before() -> None:
    settings = [scan.Settings(9600, parity, 1) for parity in ("none", "even")]
    plan = scan.Plan(["/dev/ttyUSB0"], settings, [], list(range(1, 248)), 3, 0.5)
    exact = 2 + 247 * (2 * 0.5 + 8 * (10 + 11) / 9600)
    assert plan.longest_s() == pytest.approx(exact)
    assert re.fullmatch(r"1 port with 2 settings, 247 units each: takes 4 min 13 s at most", plan.text())
