# SPDX-License-Identifier: GPL-3.0-or-later
"""Formats, bits and scales between a device of another make, pymodbus, and a master of another make, c104."""

import contextlib
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import c104
import pytest

from lab.gateway import Gateway, free_port, listening_on, remove, run_directory
from lab.master import Master, Report
from peers.device import UNIT
from peers.pymodbus_device import PymodbusDevice
from rig.capture import recorded
from rig.desk import patience

CA = 500  # of both devices
OFFSET = 1000  # of the second one's objects
PATIENCE_MS = 1500  # a device of Python on a busy host is not dead


def register(ioa: int, address: int, kind: str, form: str, **keys: Any) -> dict[str, Any]:
    return {"ioa": ioa, "address": address, "type": kind, "format": form, **keys}


TABLE = [[100, -10], [1000, 0], [2000, 50]]
OBJECTS: dict[str, list[dict[str, Any]]] = {
    "coils": [{"ioa": 1, "address": 16, "inverted": True}],
    "discrete_inputs": [{"ioa": 2, "address": 16, "inverted": True}],
    "input_registers": [
        {"ioa": 11, "address": 16, "bit": 0},
        {"ioa": 12, "address": 16, "bit": 15, "inverted": True},
        {"ioa": 13, "address": 16, "bit": 4, "type": "double"},
        register(14, 17, "float", "int32"),
        register(15, 19, "float", "uint32", word_order="little"),
        register(16, 21, "scaled", "int32", scale=0.001),
        register(17, 23, "float", "int64"),
        register(18, 27, "float", "float64"),
        register(19, 31, "float", "uint64", word_order="little"),
        register(20, 35, "float", "uint16", scale_points=[[4000, 0], [20000, 400]]),
        register(21, 36, "float", "uint16", scale_table=TABLE),
        register(22, 37, "float", "int16", unimplemented=True),
        register(23, 38, "counter", "uint16"),
        register(41, 39, "bitstring", "uint16"),  # and its parts
        {"ioa": 42, "address": 39, "bit": 0},
        {"ioa": 43, "address": 39, "bits": [8, 15]},
        {"ioa": 44, "address": 39, "bits": [4, 7], "format": "int16"},
        register(45, 40, "float", "int48"),
        register(46, 43, "float", "uint48", word_order="little"),
        register(47, 46, "scaled", "bcd16"),
        register(48, 47, "float", "bcd32"),
        register(49, 49, "float", "mod10_32"),
        register(50, 51, "float", "mod10_64", word_order="little"),
        register(51, 55, "float", "fixed24_8"),
        register(52, 57, "counter", "bcd48"),
    ],
    "holding_registers": [
        {"ioa": 31, "address": 16, "bit": 3},
        {"ioa": 32, "address": 16, "bit": 8, "type": "double"},
        register(33, 17, "float", "int32", word_order="little"),
        register(34, 19, "float", "float64"),
        register(35, 23, "float", "uint16", scale_table=TABLE),
        register(61, 24, "scaled", "uint16"),  # and its octets
        {"ioa": 62, "address": 24, "bits": [8, 15]},
        {"ioa": 63, "address": 24, "bits": [0, 7], "format": "bcd16"},
        register(64, 25, "float", "int48"),
        register(65, 28, "float", "bcd32", scale=0.1),
        register(66, 30, "float", "mod10_48"),
        register(67, 33, "float", "fixed24_8"),
    ],
}


@dataclass
class Bench:
    """Both devices, the gateway between, the master in front of it."""

    devices: list[PymodbusDevice]
    gateway: Gateway
    master: Master

    def report(self, ioa: int, since: int, quality: str, value: object) -> Report:
        return self.master.wait(
            lambda r: (r.ca, r.ioa, r.quality, r.value) == (CA, ioa, quality, value), since
        )


@pytest.fixture(scope="module")
def bench(programs: Path) -> Iterator[Bench]:
    directory = run_directory()
    (directory / "dev").mkdir()
    ports = [free_port(), free_port()]
    config: dict[str, Any] = {"port": []}
    for i, port in enumerate(ports):
        slave = {
            "id": UNIT,
            "ca": CA,
            "ioa_offset": i * OFFSET,
            **patience(PATIENCE_MS),
            **OBJECTS,
        }
        tcp = {"value": 7 + i, "active": 1, "host": "127.0.0.1", "tcp_port": port}
        config["port"].append({**tcp, "slaves": [slave]})
    with contextlib.ExitStack() as stack:
        stack.callback(remove, directory)
        devices = [PymodbusDevice(port) for port in ports]
        for device in devices:
            device.start()
            stack.callback(device.stop)
            # No value is out of its table, and no double point indeterminate.
            device.set("input_registers", 35, [4000, 1000])
            device.set("holding_registers", 23, [1000])
        gateway = stack.enter_context(Gateway(listening_on(config, free_port()), directory, programs))
        stack.enter_context(recorded(gateway))
        master = stack.enter_context(Master(*gateway.address))
        gateway.wait_for(
            lambda: all(point["quality"] == "good" for point in gateway.points("*").values()),
            15.0,
            "both devices are read",
        )
        yield Bench(devices, gateway, master)


def words(form: str, value: float) -> list[int]:
    packed = struct.pack(form, value)
    return list(struct.unpack(f">{len(packed) // 2}H", packed))


# IOA, table, address, what is set there, value, quality
READ: list[tuple[int, str, int, list[int], object, str]] = [
    (1, "coils", 16, [1], False, "good"),
    (2, "discrete_inputs", 16, [1], False, "good"),
    (11, "input_registers", 16, [0x8011], True, "good"),
    (12, "input_registers", 16, [0x8011], False, "good"),
    (13, "input_registers", 16, [0x8011], "OFF", "good"),
    (14, "input_registers", 17, words(">i", -70000), -70000.0, "good"),
    (15, "input_registers", 19, words(">I", 2**31 + 256)[::-1], 2.0**31 + 256, "good"),
    (16, "input_registers", 21, words(">i", -123456), -123, "good"),
    (17, "input_registers", 23, words(">q", -(2**40)), -(2.0**40), "good"),
    (18, "input_registers", 27, words(">d", 2.5), 2.5, "good"),
    (19, "input_registers", 31, words(">Q", 2**63)[::-1], 2.0**63, "good"),
    (20, "input_registers", 35, [12000], 200.0, "good"),
    (21, "input_registers", 36, [1500], 25.0, "good"),
    (42, "input_registers", 39, [0x9AF1], True, "good"),
    (43, "input_registers", 39, [0x9AF1], 0x9A, "good"),
    (44, "input_registers", 39, [0x9AF1], -1, "good"),
    (45, "input_registers", 40, words(">q", -(2**40))[1:], -(2.0**40), "good"),
    (46, "input_registers", 43, [0, 0, 0x8000], 2.0**47, "good"),
    (47, "input_registers", 46, [0x9876], 9876, "good"),
    (48, "input_registers", 47, [0x0012, 0x3456], 123456.0, "good"),
    (49, "input_registers", 49, [12, 3456], 123456.0, "good"),
    (50, "input_registers", 51, [5000, 0, 1, 0], 100005000.0, "good"),
    (51, "input_registers", 55, [0xFFFF, 0xFF40], -0.75, "good"),
    (52, "input_registers", 57, [0, 0x1234, 0x5678], 12345678, "good"),
]


def test_every_format_arrives_of_both_devices(bench: Bench) -> None:
    since = bench.master.mark()
    for i, device in enumerate(bench.devices):
        for _, table, address, raw, *_ in READ:
            device.set(table, address, raw)
        for ioa, _, _, _, value, quality in READ:
            bench.report(ioa + i * OFFSET, since, quality, value)


def test_what_cannot_be_represented_says_so(bench: Bench) -> None:
    device, since = bench.devices[0], bench.master.mark()
    device.set("input_registers", 21, words(">i", 40_000_000))
    device.set("input_registers", 27, words(">d", 1e300))
    device.set("input_registers", 36, [2001])
    device.set("input_registers", 37, [0x8000])
    greatest: float = struct.unpack(">f", b"\x7f\x7f\xff\xff")[0]
    overflow = [(16, 32767), (18, greatest), (21, 50.0)]
    for ioa, value in overflow:
        report = bench.master.wait(lambda r, ioa=ioa, value=value: (r.ioa, r.value) == (ioa, value), since)
        assert "Overflow" in report.quality
    device.set("input_registers", 46, [0x000A])  # no decimal digit
    device.set("input_registers", 49, [0, 10000])
    for ioa in (22, 47, 49):
        invalid = bench.master.wait(lambda r, ioa=ioa: r.ioa == ioa and not r.good, since)
        assert "Invalid" in invalid.quality
    device.set("input_registers", 37, [7])
    device.set("input_registers", 46, [0x0010])
    device.set("input_registers", 49, [1, 1])
    for ioa, number in ((22, 7.0), (47, 10), (49, 10001.0)):
        bench.report(ioa, since, "good", number)


@pytest.mark.slow
def test_one_interrogation_brings_all_devices_of_an_address(bench: Bench) -> None:
    ioas = [report.ioa for report in bench.master.interrogate(CA)]
    objects = [one for table in OBJECTS.values() for one in table]
    expected = [one["ioa"] for one in objects if one.get("type") != "counter"]
    assert sorted(ioas) == sorted([*expected, *(ioa + OFFSET for ioa in expected)])


@pytest.mark.slow
def test_broadcast_interrogation_asks_the_station_once(bench: Bench) -> None:
    ioas = [report.ioa for report in bench.master.interrogate_all(CA)]
    assert len(ioas) == len(set(ioas)) > OFFSET // 100


@pytest.mark.slow
def test_a_counter_of_one_register_goes_round(bench: Bench) -> None:
    device, since = bench.devices[1], bench.master.mark()
    for value in (30000, 60000, 24464, 54464, 18928):
        device.set("input_registers", 38, [value])
        total = {30000: 30000, 60000: 60000, 24464: 90000, 54464: 120000, 18928: 150000}[value]
        bench.master.wait(lambda r, total=total: (r.ioa, r.value) == (23 + OFFSET, total), since)
    readings = {report.ioa: report.value for report in bench.master.interrogate_counters(CA)}
    assert [readings[23], readings[23 + OFFSET]] == [0, 150000]


# IOA, command, table, address, what was there, what is there then
COMMANDS: list[tuple[int, str, Any, str, int, list[int], list[int]]] = [
    (1, "C_SC_NA_1", c104.SingleCmd(True), "coils", 16, [1], [0]),
    (1, "C_SC_NA_1", c104.SingleCmd(False), "coils", 16, [0], [1]),
    (31, "C_SC_NA_1", c104.SingleCmd(True), "holding_registers", 16, [0xF0F0], [0xF0F8]),
    (31, "C_SC_NA_1", c104.SingleCmd(False), "holding_registers", 16, [0xFFFF], [0xFFF7]),
    (32, "C_DC_NA_1", c104.DoubleCmd(c104.Double.ON), "holding_registers", 16, [0xF1F0], [0xF2F0]),
    (33, "C_SE_NC_1", c104.ShortCmd(-70000.0), "holding_registers", 17, [0, 0], words(">i", -70000)[::-1]),
    (34, "C_SE_NC_1", c104.ShortCmd(-0.75), "holding_registers", 19, [0] * 4, words(">d", -0.75)),
    (35, "C_SE_NC_1", c104.ShortCmd(-5.0), "holding_registers", 23, [1000], [550]),
    (62, "C_SE_NB_1", c104.ScaledCmd(c104.Int16(0xAB)), "holding_registers", 24, [0x1234], [0xAB34]),
    (63, "C_SE_NB_1", c104.ScaledCmd(c104.Int16(59)), "holding_registers", 24, [0x1234], [0x1259]),
    (64, "C_SE_NC_1", c104.ShortCmd(-2.0), "holding_registers", 25, [0] * 3, [0xFFFF, 0xFFFF, 0xFFFE]),
    (65, "C_SE_NC_1", c104.ShortCmd(12345.5), "holding_registers", 28, [0, 0], [0x0012, 0x3455]),
    (66, "C_SE_NC_1", c104.ShortCmd(-10002.0), "holding_registers", 30, [0] * 3, [0, 0xFFFF, 0xFFFE]),
    (67, "C_SE_NC_1", c104.ShortCmd(-0.75), "holding_registers", 33, [0, 0], [0xFFFF, 0xFF40]),
]


@pytest.mark.parametrize("case", COMMANDS, ids=lambda case: f"{case[0]}-{case[1]}-{case[5]}")
def test_commands_go_the_same_way_back(bench: Bench, case: Any) -> None:
    ioa, kind, info, table, address, before, after = case
    device = bench.devices[0]
    device.set(table, address, before)
    assert bench.master.command(CA, ioa, kind, info)
    bench.gateway.wait_for(lambda: device.get(table, address, len(after)) == after, 10.0, f"{after}")


@pytest.mark.slow
def test_a_set_point_beyond_the_table_is_refused(bench: Bench) -> None:
    assert not bench.master.command(CA, 35, "C_SE_NC_1", c104.ShortCmd(51.0))


@pytest.mark.slow
def test_a_set_point_beyond_its_bits_is_refused(bench: Bench) -> None:
    assert not bench.master.command(CA, 62, "C_SE_NB_1", c104.ScaledCmd(c104.Int16(256)))
    assert not bench.master.command(CA, 63, "C_SE_NB_1", c104.ScaledCmd(c104.Int16(100)))
