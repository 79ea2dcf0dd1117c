# SPDX-License-Identifier: GPL-3.0-or-later
"""The gateway on Modbus devices of other makes: of C, Python and Node, on lines and TCP."""

import contextlib
import random
import struct
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import c104
import pytest

from lab.gateway import Gateway, free_port, listening_on, remove, run_directory
from lab.master import Master, Report
from peers.device import BAUD_RATE, FIRST_ADDRESS, UNIT, Device, powered
from peers.device_server import device_server
from peers.libmodbus_device import LibmodbusDevice
from peers.line import line
from peers.npm_device import JsmodbusDevice, NpmDevice
from peers.pymodbus_device import PymodbusAsciiDevice, PymodbusDevice, PymodbusRtuDevice
from peers.umodbus_device import UmodbusDevice
from rig.capture import recorded
from rig.desk import patience

pytestmark = pytest.mark.slow  # four devices in Python; those of the quick tests are linesim's

MAKES: dict[str, type[Device]] = {"pymodbus": PymodbusDevice, "libmodbus": LibmodbusDevice}
SERIAL_PORTS = dict(zip(MAKES, (1, 2), strict=True))  # ttyS1 and ttyS2
TCP_PORTS = dict(zip(MAKES, (7, 8), strict=True))
RTU_PORTS = {
    "pymodbus-rtu": 9,
    "libmodbus-server": 10,
}  # RTU over TCP: the one itself, the other behind a device server
TCP_ALONE: dict[str, tuple[int, type[Device]]] = {
    "umodbus": (11, UmodbusDevice),
    "modbus-serial": (12, NpmDevice),
}
ASCII, ASCII_PORT = "pymodbus-ascii", 3  # ttyS3
PEERS = [*MAKES, *(f"{make}-tcp" for make in MAKES), *RTU_PORTS, *TCP_ALONE, ASCII]

PATIENCE_MS = 1500  # a device of Python on a busy host is not dead
MISSING = FIRST_ADDRESS - 1  # configured in every table, and no address of the devices
WRITE_ONLY = 30  # a holding register that is never read
NEVER_GOOD = {f"h{WRITE_ONLY}", *(f"{letter}{MISSING}" for letter in "cdih")}  # names behind the device's
MANY_BITS = range(2000, 4000)  # MODBUS Application Protocol V1.1b3, 6.2: 2000 in one request
MANY_REGISTERS = range(1000, 1125)  # 6.4: 125
DOUBLE_STATES = {(0, 0): "INTERMEDIATE", (1, 0): "OFF", (0, 1): "ON", (1, 1): "INDETERMINATE"}

OBJECTS: dict[str, list[dict[str, Any]]] = {
    "coils": [
        {"address": MISSING},
        {"address": 16},
        {"address": 17, "type": "double"},
        {"address": 65534, "type": "double", "ioa": 65535},
    ],
    "discrete_inputs": [
        {"address": MISSING, "type": "double"},  # its second bit is there
        {"address": 17},
        {"address": 18, "type": "double"},
        {"address": 20, "type": "double", "bit_order": "on_off"},
        {"address": 22, "write_address": 40},
        *({"address": address, "type": "double"} for address in MANY_BITS[::2]),
        {"address": 65535, "ioa": 165536},
    ],
    "input_registers": [
        {"address": MISSING, "type": "float"},  # its second register is there
        {"address": 17, "type": "normalized"},
        {"address": 18, "type": "scaled"},
        {"address": 19, "type": "scaled", "signed": False, "scale": 0.1, "offset": -40},
        {"address": 20, "type": "step"},
        {"address": 21, "type": "float"},
        {"address": 23, "type": "float", "word_order": "little"},
        {"address": 25, "type": "float", "byte_order": "little"},
        {"address": 27, "type": "float", "word_order": "little", "byte_order": "little"},
        {"address": 29, "type": "counter"},
        {"address": 31, "type": "bitstring"},
        {"address": 33, "type": "float", "write_address": 40},
        *({"address": address} for address in MANY_REGISTERS),
        {"address": 65534, "type": "float", "ioa": 365535},
    ],
    "holding_registers": [
        {"address": MISSING},
        {"address": 16},
        {"address": 17, "type": "float"},
        {"address": WRITE_ONLY, "write_only": True},
        {"address": 65535, "ioa": 465536},
    ],
}


def gateway_config(listening: dict[str, int]) -> dict[str, Any]:
    """The same device on each port. listening: the TCP ports of 127.0.0.1, by make or name."""
    serial = {"active": 1, "baud_rate": BAUD_RATE, "data_bits": 8, "stop_bits": 1, "parity": 0}
    slaves = [{"id": UNIT, "identify": True, **patience(PATIENCE_MS), **OBJECTS}]
    ports = [{"value": port, **serial, "slaves": slaves} for port in SERIAL_PORTS.values()]
    text = {"framing": "ascii", "data_bits": 7, "parity": 2}
    ports.append({"value": ASCII_PORT, **serial, **text, "slaves": slaves})
    for make, port in (TCP_PORTS | {make: port for make, (port, _) in TCP_ALONE.items()}).items():
        host = {"host": "127.0.0.1", "tcp_port": listening[make]}
        ports.append({"value": port, "active": 1, **host, "slaves": slaves})
    for name, port in RTU_PORTS.items():
        host = {"host": "127.0.0.1", "tcp_port": listening[name], "framing": "rtu"}
        ports.append({"value": port, "active": 1, **host, "slaves": slaves})
    return {"port": ports}


@dataclass
class Peer:
    """A device of another make, seen from both sides of the gateway."""

    ca: int
    device: Device
    gateway: Gateway
    master: Master

    def points(self) -> dict[str, dict[str, Any]]:
        """The gateway's points of the device, named as p1.17.c16, by what follows the device's name."""
        own = f"p{self.ca // 1000}.{UNIT}."
        return {name.removeprefix(own): point for name, point in self.gateway.points(own + "*").items()}

    def invalid(self) -> set[str]:
        return {name for name, point in self.points().items() if point["quality"] == "invalid"}

    def wait_until_read(self) -> None:
        self.gateway.wait_for(
            lambda: self.invalid() == NEVER_GOOD, 60.0, f"what the device of CA {self.ca} has is read"
        )

    def interrogate(self) -> dict[int, Report]:
        return {report.ioa: report for report in self.master.interrogate(self.ca)}

    def wait_report(self, ioa: int, value: object, since: int) -> Report:
        return self.master.wait(lambda r: (r.ca, r.ioa, r.value) == (self.ca, ioa, value), since)

    def command(self, ioa: int, kind: str, info: Any) -> bool:
        return self.master.command(self.ca, ioa, kind, info)


@pytest.fixture(scope="module")
def peers(programs: Path) -> Iterator[dict[str, Peer]]:
    """All devices, powered on and read, by their names."""
    directory = run_directory()
    (directory / "dev").mkdir()
    with contextlib.ExitStack() as stack:
        stack.callback(remove, directory)
        stack.enter_context(line(directory / "server", directory / "behind"))
        server = stack.enter_context(device_server(directory / "server"))
        listening = {name: free_port() for name in (*MAKES, *TCP_ALONE, "pymodbus-rtu")} | {
            "libmodbus-server": server.port
        }
        config = listening_on(gateway_config(listening), free_port())
        made = {
            "pymodbus-rtu": PymodbusRtuDevice(listening["pymodbus-rtu"]),
            "libmodbus-server": LibmodbusDevice(directory / "behind"),
        }
        devices: dict[str, tuple[int, Device]] = {
            name: (RTU_PORTS[name], stack.enter_context(powered(device))) for name, device in made.items()
        }
        for name, (port, make) in TCP_ALONE.items():
            devices[name] = port, stack.enter_context(powered(make(listening[name])))
        for name, make in MAKES.items():
            end = directory / name
            stack.enter_context(line(directory / "dev" / f"ttyS{SERIAL_PORTS[name]}", end))
            devices[name] = SERIAL_PORTS[name], stack.enter_context(powered(make(end)))
            served = stack.enter_context(powered(make(listening[name])))
            devices[f"{name}-tcp"] = TCP_PORTS[name], served
        stack.enter_context(line(directory / "dev" / f"ttyS{ASCII_PORT}", directory / ASCII))
        devices[ASCII] = ASCII_PORT, stack.enter_context(powered(PymodbusAsciiDevice(directory / ASCII)))
        gateway = stack.enter_context(Gateway(config, directory, programs))
        stack.enter_context(recorded(gateway))
        master = stack.enter_context(Master(*gateway.address))
        peers = {
            name: Peer(1000 * port + UNIT, device, gateway, master)
            for name, (port, device) in devices.items()
        }
        for peer in peers.values():
            peer.wait_until_read()
        yield peers


@pytest.fixture(params=PEERS)
def peer(peers: dict[str, Peer], request: pytest.FixtureRequest) -> Peer:
    return peers[request.param]


# ---- reading -----------------------------------------------------------------------------------------

EVENTS = [  # table, address, raw, IOA, type, value
    ("coils", 16, [1], 17, "M_SP_TB_1", True),
    ("coils", 17, [0, 1], 18, "M_DP_TB_1", "ON"),
    ("coils", 65534, [1, 0], 65535, "M_DP_TB_1", "OFF"),
    ("discrete_inputs", 17, [1], 10018, "M_SP_TB_1", True),
    ("discrete_inputs", 18, [1, 0], 10019, "M_DP_TB_1", "OFF"),
    ("discrete_inputs", 20, [1, 0], 10021, "M_DP_TB_1", "ON"),
    ("discrete_inputs", 65535, [1], 165536, "M_SP_TB_1", True),
    ("input_registers", 17, [0xC000], 30018, "M_ME_TD_1", -0.5),
    ("input_registers", 18, [0xFFFE], 30019, "M_ME_TE_1", -2),
    ("input_registers", 19, [40000], 30020, "M_ME_TE_1", 3960),
    ("input_registers", 20, [0x00BF], 30021, "M_ST_TB_1", 63),
    ("input_registers", 21, [0xBFC0, 0x0000], 30022, "M_ME_TF_1", -1.5),
    ("input_registers", 23, [0x0000, 0x4010], 30024, "M_ME_TF_1", 2.25),
    ("input_registers", 25, [0x1841, 0x0000], 30026, "M_ME_TF_1", 9.5),
    ("input_registers", 27, [0x0000, 0x003E], 30028, "M_ME_TF_1", 0.125),
    ("input_registers", 29, [0xFFFF, 0xFFFE], 30030, "M_IT_TB_1", -2),
    ("input_registers", 31, [0x1234, 0x5678], 30032, "M_BO_TB_1", 0x12345678),
    ("input_registers", 65534, [0x4049, 0x0000], 365535, "M_ME_TF_1", 3.140625),
    ("holding_registers", 16, [0x8000], 40017, "M_ME_TE_1", -32768),
    ("holding_registers", 17, [0x42F6, 0x0000], 40018, "M_ME_TF_1", 123.0),
    ("holding_registers", 65535, [4711], 465536, "M_ME_TE_1", 4711),
]


def test_every_table_and_type_arrives(peer: Peer) -> None:
    since = peer.master.mark()
    for table, address, raw, *_ in EVENTS:
        peer.device.set(table, address, raw)
    for _, _, _, ioa, kind, value in EVENTS:
        report = peer.wait_report(ioa, value, since)
        assert (report.type, report.cause, report.quality) == (kind, "SPONTANEOUS", "good")


def test_2000_bits_and_125_registers_come_in_one_answer(peer: Peer) -> None:
    bits = random.Random(2000).choices([0, 1], k=len(MANY_BITS))
    words = random.Random(125).choices(range(65536), k=len(MANY_REGISTERS))
    peer.device.set("discrete_inputs", MANY_BITS.start, bits)
    peer.device.set("input_registers", MANY_REGISTERS.start, words)
    mark = len(peer.device.requests)
    wholes = [struct.pack(">BHH", 2, 2000, 2000), struct.pack(">BHH", 4, 1000, 125)]
    # When the second of each comes, the first was answered and published.
    peer.gateway.wait_for(
        lambda: all(peer.device.requests[mark:].count(whole) >= 2 for whole in wholes), 60.0, "both are read"
    )
    reports = peer.interrogate()
    states = [DOUBLE_STATES[pair] for pair in zip(bits[::2], bits[1::2], strict=True)]
    assert [reports[10001 + address].value for address in MANY_BITS[::2]] == states
    assert [reports[30001 + address].value & 0xFFFF for address in MANY_REGISTERS] == words


def test_a_device_says_what_it_is_or_is_left_alone(peers: dict[str, Peer]) -> None:
    """Others do not know function 43: libmodbus says nothing on a line; all of them refuse on TCP."""
    for name, peer in peers.items():

        def row(peer: Peer = peer) -> dict[str, Any]:
            devices = [row for line in peer.gateway.query("lines") for row in line["devices"]]
            return next(row for row in devices if row["port"] == peer.ca // 1000)

        def is_asked(row: Callable[[], dict[str, Any]] = row) -> bool:
            return row()["identification_state"] != "not asked yet"

        peer.gateway.wait_for(is_asked, 60.0, f"{name} was asked")
        said = row()
        assert said["alive"]
        if name.startswith("pymodbus"):
            assert said["identified"] == "pymodbus peer 1.0"
        else:
            assert said["identification_state"] in ("refused", "no answer")
            assert said["identification"] == {}


# ---- what the device does not have ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("function", "first", "count"),
    [(1, MISSING, 4), (2, MISSING, 8), (3, MISSING, 4), (4, MISSING, 20)],
)
def test_refused_read_is_taken_apart(peer: Peer, function: int, first: int, count: int) -> None:
    """The whole was asked for, and refused; now the object that the device lacks is asked for alone."""
    width = 2 if function in (2, 4) else 1
    assert struct.pack(">BHH", function, first, count) in peer.device.requests
    assert struct.pack(">BHH", function, MISSING, width) in peer.device.requests
    unit = f"p{peer.ca // 1000}.{UNIT}"
    assert f"{unit}: exception 2 to function {function}, address {MISSING}" in peer.gateway.log(200)


def test_missing_objects_are_invalid_and_their_neighbours_good(peer: Peer) -> None:
    assert peer.invalid() == NEVER_GOOD
    invalid = {ioa for ioa, report in peer.interrogate().items() if not report.good}
    missing = {1 + MISSING, 10001 + MISSING, 30001 + MISSING, 40001 + MISSING}
    assert invalid == missing | {40001 + WRITE_ONLY}


# ---- commands -------------------------------------------------------------------------------------------


def scaled(value: int) -> c104.ScaledCmd:
    return c104.ScaledCmd(c104.Int16(value))


ON, OFF = c104.SingleCmd(on=True), c104.SingleCmd(on=False)
DOUBLE_ON, DOUBLE_OFF = c104.DoubleCmd(state=c104.Double.ON), c104.DoubleCmd(state=c104.Double.OFF)
SHORT = c104.ShortCmd(target=-1.5)

COMMANDS = [  # name, IOA, type, value, request, table, address, values
    ("FC 5 on", 17, "C_SC_NA_1", ON, "05 0010 ff00", "coils", 16, [1]),
    ("FC 5 off", 17, "C_SC_NA_1", OFF, "05 0010 0000", "coils", 16, [0]),
    ("FC 15 on", 18, "C_DC_NA_1", DOUBLE_ON, "0f 0011 0002 01 02", "coils", 17, [0, 1]),
    ("FC 15 at 65534", 65535, "C_DC_NA_1", DOUBLE_OFF, "0f fffe 0002 01 01", "coils", 65534, [1, 0]),
    ("FC 6", 40017, "C_SE_NB_1", scaled(-2), "06 0010 fffe", "holding_registers", 16, [0xFFFE]),
    ("FC 6 at 65535", 465536, "C_SE_NB_1", scaled(255), "06 ffff 00ff", "holding_registers", 65535, [255]),
    ("FC 16", 40018, "C_SE_NC_1", SHORT, "10 0011 0002 04 bfc00000", "holding_registers", 17, [0xBFC0, 0]),
    ("coil of an input", 10023, "C_SC_NA_1", ON, "05 0028 ff00", "coils", 40, [1]),
    (
        "holding registers of input registers",
        *(30034, "C_SE_NC_1", SHORT, "10 0028 0002 04 bfc00000", "holding_registers", 40, [0xBFC0, 0]),
    ),
    ("write only", 40001 + WRITE_ONLY, "C_SE_NB_1", scaled(7), "06 001e 0007", "holding_registers", 30, [7]),
]


@pytest.mark.parametrize(
    ("ioa", "kind", "info", "pdu", "table", "address", "values"),
    [pytest.param(*case[1:], id=case[0]) for case in COMMANDS],
)
def test_command_changes_the_devices_memory(
    peer: Peer,
    ioa: int,
    kind: str,
    info: c104.Information,
    pdu: str,
    table: str,
    address: int,
    values: Sequence[int],
) -> None:
    peer.device.set(table, address, [value ^ 1 for value in values])
    mark = len(peer.device.requests)
    assert peer.command(ioa, kind, info)
    assert peer.device.get(table, address, len(values)) == values
    assert peer.device.requests[mark:].count(bytes.fromhex(pdu)) == 1


@pytest.mark.parametrize(
    ("ioa", "kind", "info", "pdu"),
    [
        pytest.param(1 + MISSING, "C_SC_NA_1", ON, "05 000f ff00", id="coil"),
        pytest.param(40001 + MISSING, "C_SE_NB_1", scaled(7), "06 000f 0007", id="register"),
    ],
)
def test_command_that_the_device_refuses_is_negative(
    peer: Peer, ioa: int, kind: str, info: c104.Information, pdu: str
) -> None:
    mark = len(peer.device.requests)
    assert not peer.command(ioa, kind, info)
    assert peer.device.requests[mark:].count(bytes.fromhex(pdu)) == 1


# ---- power -----------------------------------------------------------------------------------------------


def test_device_without_power_is_invalid_until_it_has_it_again(peer: Peer, peers: dict[str, Peer]) -> None:
    others = [candidate for candidate in peers.values() if candidate is not peer]
    everything = set(peer.points())
    since = peer.master.mark()
    peer.device.set("holding_registers", 16, [1234])
    peer.wait_report(40017, 1234, since)
    peer.device.stop()
    try:
        peer.gateway.wait_for(lambda: peer.invalid() == everything, 60.0, "all points are invalid")
        assert {report.good for report in peer.interrogate().values()} == {False}
        for other in others:
            since = peer.master.mark()
            other.device.set("holding_registers", 16, [4321])
            assert other.wait_report(40017, 4321, since).good
            other.device.set("holding_registers", 16, [0])
            assert other.invalid() == NEVER_GOOD
    finally:
        since = peer.master.mark()
        peer.device.start()
    peer.wait_until_read()
    assert peer.wait_report(40017, 0, since).good


# ---- a device that says nothing to what it does not know -------------------------------------------------


@pytest.fixture
def jsmodbus(programs: Path) -> Iterator[Peer]:
    with contextlib.ExitStack() as stack:
        device = stack.enter_context(powered(JsmodbusDevice(free_port())))
        directory = run_directory()
        stack.callback(remove, directory)
        registers = [{"address": 0}, {"address": 1, "bits": [0, 3], "ioa": 40002}]
        slave = {"id": UNIT, **patience(300), "holding_registers": registers}
        port = {"value": 7, "active": 1, "host": "127.0.0.1", "tcp_port": device.place, "slaves": [slave]}
        gateway = stack.enter_context(
            Gateway(listening_on({"port": [port]}, free_port()), directory, programs)
        )
        stack.enter_context(recorded(gateway))
        yield Peer(7000 + UNIT, device, gateway, stack.enter_context(Master(*gateway.address)))


def test_a_device_that_hangs_behind_function_22_is_read_again(jsmodbus: Peer) -> None:
    """The write is nobody's success, and is not sent again."""
    device = jsmodbus.device
    assert isinstance(device, JsmodbusDevice)
    since = jsmodbus.master.mark()
    device.set_register(0, 1234)
    jsmodbus.wait_report(40001, 1234, since)
    assert not jsmodbus.command(40002, "C_SE_NB_1", scaled(5))
    since = jsmodbus.master.mark()
    device.set_register(0, 4321)
    assert jsmodbus.wait_report(40001, 4321, since).good
    assert [pdu for pdu in device.requests if pdu[0] == 22] == [bytes.fromhex("16 0001 fff0 0005")]
