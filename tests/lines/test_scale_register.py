# SPDX-License-Identifier: GPL-3.0-or-later
"""Powers of ten that a device says in its registers, as SunSpec's inverters do: read and written."""

import contextlib
import json
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

ROOT = Path(__file__).resolve().parents[2]
SUNSPEC = ROOT / "package/openrtu/src/templates/sunspec.json"
CA = 600
PATIENCE_MS = 1500  # a device of Python on a busy host is not dead
NONE = 0x8000  # "not implemented"
HOLDING = "holding_registers"

# Model 103 from its first value at 40071 on; each kind has another factor.
A, V, W, HZ = 40071, 40076, 40083, 40085
REGISTERS: dict[int, list[int]] = {
    A: [217, 56, 83, 77, 0x10000 - 2],
    V: [3965, 3953, 3963, 2288, 2284, 2285, 0x10000 - 1],
    W: [0x10000 - 150, 1],
    HZ: [4998, 0x10000 - 2],
    40089: [25, 0],
    40093: [60, 8980, 3],
    40098: [16, 0x10000 - 10],
    40102: [0x10000 - 5, 0, 0, 0, 0],
    40107: [4],
}
# IOA, value
EXPECTED = {
    1: 2.17,
    2: 0.56,
    3: 0.83,
    4: 0.77,
    9: 228.8,
    10: 228.4,
    11: 228.5,
    13: -1500.0,
    15: 49.98,
    19: 25.0,
    23: (60 * 65536 + 8980) * 1000.0,
    28: 16e-10,
    32: -5.0,
    37: 4,
}
IOA_A, IOA_W = 1, 13
SETPOINT, SETPOINT_SF, IOA_SETPOINT = 100, 90, 900
LIMIT, IOA_LIMIT = 110, 901


@dataclass
class Bench:
    """An inverter, the gateway, a controlling station."""

    device: PymodbusDevice
    gateway: Gateway
    master: Master

    def sees(self, ioa: int, since: int, value: float) -> Report:
        return self.master.wait(
            lambda r: r.ioa == ioa and r.good and r.value == pytest.approx(value, rel=1e-6), since
        )

    def sees_invalid(self, ioa: int, since: int) -> None:
        self.master.wait(lambda r: r.ioa == ioa and "Invalid" in r.quality, since)


def configuration(port: int) -> dict[str, Any]:
    inverter = {
        "id": UNIT,
        "ca": CA,
        "template": "sunspec-103",
        "overrides": {"W": {"deadband": 5}},
        "period_ms": 100,
        **patience(PATIENCE_MS),
        HOLDING: [
            {"address": SETPOINT, "type": "float", "format": "int16", "scale_register": SETPOINT_SF}
            | {"ioa": IOA_SETPOINT, "name": "setpoint"},
            {"address": LIMIT, "scale_register": LIMIT + 1, "ioa": IOA_LIMIT, "name": "limit"}
            | {"step": 5, "min": 0, "max": 100},
        ],
    }
    line = {"value": 7, "active": 1, "host": "127.0.0.1", "tcp_port": port, "slaves": [inverter]}
    return {"include": [str(SUNSPEC)], "port": [line]}


@pytest.fixture(scope="module")
def bench(programs: Path) -> Iterator[Bench]:
    directory = run_directory()
    (directory / "dev").mkdir()
    with contextlib.ExitStack() as stack:
        stack.callback(remove, directory)
        device = PymodbusDevice(free_port())
        device.start()
        stack.callback(device.stop)
        power_on(device)
        gateway = Gateway(
            listening_on(configuration(int(str(device.place))), free_port()), directory, programs
        )
        stack.enter_context(gateway)
        stack.enter_context(recorded(gateway))
        master = stack.enter_context(Master(*gateway.address))
        gateway.wait_for(lambda: all_good(gateway), 15.0, "the inverter is read")
        yield Bench(device, gateway, master)


def power_on(device: PymodbusDevice) -> None:
    for address, values in REGISTERS.items():
        device.set(HOLDING, address, values)


def all_good(gateway: Gateway) -> bool:
    return all(point["quality"] == "good" for point in gateway.points().values())


def test_the_shipped_template_takes_the_factors_of_the_device(bench: Bench) -> None:
    values = {report.ioa: report.value for report in bench.master.interrogate(CA)}
    assert {ioa: values[ioa] for ioa in EXPECTED} == pytest.approx(EXPECTED, rel=1e-6)


@pytest.mark.slow
def test_each_request_for_a_value_brings_its_factor(bench: Bench) -> None:
    begin = len(bench.device.requests)
    bench.gateway.wait_for(lambda: len(bench.device.requests) > begin + 200, 30.0, "200 requests")
    reads = [
        (int.from_bytes(request[1:3], "big"), int.from_bytes(request[3:5], "big"))
        for request in bench.device.requests[begin:]
        if request[0] == 3
    ]
    factors = {
        one["address"]: one["scale_register"]
        for one in json.loads(SUNSPEC.read_text())["templates"]["sunspec-103"][HOLDING]
        if "scale_register" in one
    }
    assert len(factors) == 13
    for value, factor in factors.items():
        spans = [(first, first + count) for first, count in reads if first <= value < first + count]
        assert spans and all(first <= factor < end for first, end in spans), (value, spans)


@pytest.mark.slow
def test_a_factor_that_changes_with_the_power_never_meets_another_value(bench: Bench) -> None:
    since = bench.master.mark()
    for turn in range(40):
        watt = 1234.0 + turn
        bench.device.set(HOLDING, W, [1234 + turn, 0])
        bench.sees(IOA_W, since, watt)
        bench.device.set(HOLDING, W, [50 + turn, 0x10000 - 2])
        bench.sees(IOA_W, since, (50 + turn) / 100)
    seen = {round(report.value, 2) for report in bench.master.reports_since(since) if report.ioa == IOA_W}
    possible = {1234.0 + turn for turn in range(40)} | {round(0.5 + turn / 100, 2) for turn in range(40)}
    assert seen <= possible | {-1500.0}


def test_the_same_value_with_another_factor_is_no_event(bench: Bench) -> None:
    bench.device.set(HOLDING, W, [100, 1])
    since = bench.master.mark()
    bench.sees(IOA_W, 0, 1000.0)
    bench.device.set(HOLDING, W, [10000, 0x10000 - 1])
    bench.device.set(HOLDING, W, [1004, 0])  # within its deadband of 5, in W
    bench.device.set(HOLDING, W, [2000, 0])
    bench.sees(IOA_W, since, 2000.0)
    events = [report.value for report in bench.master.reports_since(since) if report.ioa == IOA_W]
    assert set(events) <= {1000.0, 2000.0}


@pytest.mark.parametrize("factor", [NONE, 11, 0x10000 - 11, 0x7FFF])
def test_a_factor_that_is_none_makes_its_values_invalid_and_no_others(bench: Bench, factor: int) -> None:
    since = bench.master.mark()
    bench.device.set(HOLDING, A + 4, [factor])
    bench.sees_invalid(IOA_A, since)
    points = bench.gateway.points()
    bench.gateway.wait_for(
        lambda: all(
            bench.gateway.points()[name]["quality"] == "invalid" for name in ("AphA", "AphB", "AphC")
        ),
        10.0,
        "all phases are invalid",
    )
    assert points["W"]["quality"] == points["Hz"]["quality"] == "good"
    since = bench.master.mark()
    bench.device.set(HOLDING, A + 4, [0x10000 - 2])
    bench.sees(IOA_A, since, 2.17)
    bench.gateway.wait_for(lambda: all_good(bench.gateway), 10.0, "all are good again")


@pytest.mark.slow
def test_a_command_is_written_with_the_factor_that_was_read(bench: Bench) -> None:
    for factor, value, written in ((0, 12.0, 12), (0x10000 - 2, 12.34, 1234), (2, -1200.0, 0x10000 - 12)):
        since = bench.master.mark()
        bench.device.set(HOLDING, SETPOINT, [7])
        bench.device.set(HOLDING, SETPOINT_SF, [factor])
        power = factor - (factor & 0x8000) * 2
        bench.gateway.wait_for(
            lambda power=power: bench.gateway.points()["setpoint"]["value"] == pytest.approx(7 * 10.0**power),
            10.0,
            "the factor is read",
        )
        assert bench.master.command(CA, IOA_SETPOINT, "C_SE_NC_1", c104.ShortCmd(value))
        assert bench.device.get(HOLDING, SETPOINT, 1) == [written]
        bench.sees(IOA_SETPOINT, since, value)
    bench.device.set(HOLDING, SETPOINT_SF, [0x10000 - 10])
    bench.gateway.wait_for(
        lambda: abs(bench.gateway.points()["setpoint"]["value"]) < 1e-6, 10.0, "the factor is read"
    )
    assert not bench.master.command(CA, IOA_SETPOINT, "C_SE_NC_1", c104.ShortCmd(1.0))  # 16 bits cannot


def test_steps_and_limits_are_in_the_unit_of_the_value(bench: Bench) -> None:
    bench.device.set(HOLDING, LIMIT, [200, 0x10000 - 1])
    bench.gateway.wait_for(lambda: bench.gateway.points()["limit"]["value"] == 20, 10.0, "20 %")
    assert bench.master.command(CA, IOA_LIMIT, "C_RC_NA_1", c104.StepCmd(c104.Step.HIGHER))
    assert bench.device.get(HOLDING, LIMIT, 1) == [250]
    assert not bench.master.command(CA, IOA_LIMIT, "C_SE_NB_1", c104.ScaledCmd(c104.Int16(101)))


def test_a_command_without_a_factor_is_refused_and_says_why(bench: Bench) -> None:
    bench.device.set(HOLDING, SETPOINT_SF, [NONE])
    bench.gateway.wait_for(
        lambda: bench.gateway.points()["setpoint"]["quality"] == "invalid", 10.0, "it is invalid"
    )
    before = bench.device.get(HOLDING, SETPOINT, 1)
    assert not bench.master.command(CA, IOA_SETPOINT, "C_SE_NC_1", c104.ShortCmd(5.0))
    with pytest.raises(Exception, match="no power of ten"):
        bench.gateway.ctl("set", "setpoint", "5")
    assert bench.device.get(HOLDING, SETPOINT, 1) == before
    bench.device.set(HOLDING, SETPOINT_SF, [0])
    bench.gateway.wait_for(
        lambda: bench.gateway.points()["setpoint"]["quality"] == "good", 10.0, "it is good again"
    )


@pytest.mark.slow
def test_a_device_that_was_away_is_not_written_with_its_old_factor(bench: Bench) -> None:
    bench.device.stop()
    bench.gateway.wait_for(
        lambda: bench.gateway.points()["setpoint"]["quality"] == "invalid", 20.0, "it is invalid"
    )
    with pytest.raises(Exception, match="no power of ten"):
        bench.gateway.ctl("set", "setpoint", "5")
    bench.device.start()
    power_on(bench.device)
    bench.gateway.wait_for(lambda: all_good(bench.gateway), 60.0, "the inverter is read again")
    assert bench.master.command(CA, IOA_SETPOINT, "C_SE_NC_1", c104.ShortCmd(5.0))


def test_rtuctl_shows_the_scale_register(bench: Bench) -> None:
    assert bench.gateway.query("show", "W")["scale_register"] == 40084
    assert bench.gateway.query("show", "St")["scale_register"] is None
