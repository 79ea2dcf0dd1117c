# SPDX-License-Identifier: GPL-3.0-or-later
"""Each fault of a line by itself: which counter shows it, what the gateway does, and that it recovers."""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from test_lines import sealed

from lab.gateway import Gateway, GatewayError
from lab.linesim import LineSim
from rig.desk import Substation, everything_read, gateway_on_lines

pytestmark = pytest.mark.slow  # as a whole

PAGE = Path(__file__).parents[2] / "docs" / "faults.md"
FAULTY, ALONE, REFUSING = 1, 2, 3  # ports
PATIENT, STRICT = 1, 2  # of the devices on the first, this one is asked often before it counts as dead
EXCEPTIONS = range(1, 12)  # a device each on the third
REGISTERS = 4
RESPONSE_TIMEOUT_MS, LATE_MS = 500, 650
PERIOD_MS = 400  # in between, a line is silent
SHOWN_S, DEAD_S = 10.0, 15.0
BACK_S = 40.0  # a dead device rests for 20 times what its last request cost, and what its death did
TRIES = 4
WRITE_REGISTER = 6
ILLEGAL_FUNCTION = 1
OF_THE_MOMENT = {5, 6, 10, 11}
COUNTERS = (
    "exceptions",
    "timeouts",
    "crc_errors",
    "late_answers",
    "wrong_units",
    "wrong_functions",
    "wrong_lengths",
    "wrong_answers",
    "unasked_frames",
    "echoes",
    "noise_bytes",
    "stuck_s",
)


@dataclass(frozen=True)
class Fault:
    words: tuple[Any, ...]  # of linesim
    moves: dict[str, int]  # these counters, by so much when the device fails once
    kills: bool  # a device that fails so again and again

    @property
    def name(self) -> str:
        return str(self.words[0])


FAULTS = [
    Fault(("mute",), {"timeouts": 1}, True),
    Fault(("late", LATE_MS), {"timeouts": 1, "late_answers": 1}, True),
    Fault(("wrong-unit",), {"timeouts": 1, "wrong_units": 1}, True),
    Fault(("wrong-function",), {"timeouts": 1, "wrong_functions": 1}, True),
    Fault(("wrong-length",), {"timeouts": 1, "wrong_lengths": 1}, True),
    Fault(("corrupt",), {"crc_errors": 1}, True),
    Fault(("truncate",), {"crc_errors": 1}, True),
    Fault(("echo",), {"echoes": 1}, False),
    Fault(("noise", 20), {"noise_bytes": 20}, False),
]
each_fault = pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)


def configuration() -> dict[str, Any]:
    common = {
        "response_timeout_ms": RESPONSE_TIMEOUT_MS,
        "response_timeout_min_ms": RESPONSE_TIMEOUT_MS,  # what is counted does not depend on what was learned
        "period_ms": PERIOD_MS,
        "holding_registers": [{"address": address} for address in range(REGISTERS)],
    }
    patient, strict = {"id": PATIENT, "retries": 5, **common}, {"id": STRICT, "retries": 0, **common}
    slaves = {
        FAULTY: [patient, strict],
        ALONE: [patient],
        REFUSING: [{"id": exception, "retries": 5, **common} for exception in EXCEPTIONS],
    }
    line = {"active": 1, "baud_rate": 38400, "data_bits": 8, "stop_bits": 1, "parity": 0}
    return {"iec104": {}, "port": [{"value": port, **line, "slaves": slaves[port]} for port in slaves]}


def held(unit: int, address: int) -> int:
    """What the register of a device holds, no two of a line the same."""
    return 256 * unit + address


@dataclass
class Line:
    """One of the gateway's lines."""

    port: int
    substation: Substation

    @property
    def gateway(self) -> Gateway:
        return self.substation.gateway

    @property
    def sim(self) -> LineSim:
        return self.substation.lines

    def fault(self, unit: int, *words: Any, count: int | None = None) -> None:
        self.sim.fault(f"{self.port}.{unit}", *words, count=count)

    def qualities(self, unit: int) -> set[str]:
        """Those of a device's points. Whatever happens, what is good is what the device holds."""
        points = self.gateway.points(f"p{self.port}.{unit}.*").values()
        for point in points:
            if point["quality"] == "good" and point["value"] != held(unit, point["ioa"] - 40001):
                pytest.fail(f"a wrong value: {point}")
        return {point["quality"] for point in points}

    def wait_quality(self, unit: int, quality: str, timeout_s: float) -> None:
        self.gateway.wait_for(
            lambda: self.qualities(unit) == {quality}, timeout_s, f"all points of {unit} are {quality}"
        )

    def row(self) -> dict[str, Any]:
        return next(row for row in self.gateway.query("lines") if row["port"] == self.port)

    def counters(self) -> dict[str, int]:
        row = self.row()
        return {name: row[name] for name in COUNTERS}

    def moved(self, before: dict[str, int]) -> dict[str, int]:
        """By how much each counter has moved that did."""
        after = self.counters()
        return {name: after[name] - before[name] for name in COUNTERS if after[name] != before[name]}

    def wait_moved(self, before: dict[str, int], least: dict[str, int]) -> None:
        self.gateway.wait_for(
            lambda: all(self.moved(before).get(name, 0) >= by for name, by in least.items()),
            SHOWN_S,
            f"{least} more than {before}",
        )

    def wait_answered(self, unit: int) -> None:
        """Until the device has answered a read of all its registers, as it should."""
        self.sim.wait_frame(
            lambda f: (
                (f.port, f.unit, f.kind, f.fault) == (self.port, unit, "sent", "")
                and len(f.bytes) == 2 * REGISTERS + 5
            ),
            timeout=BACK_S,
            since=self.sim.mark(),
        )

    def recover(self) -> None:
        """Sound again, whatever was tried before."""
        devices = [device["id"] for device in self.row()["devices"]]
        for unit in devices:
            self.fault(unit, "clear")
        for unit in devices:
            self.wait_quality(unit, "good", BACK_S)
            self.wait_answered(unit)


def in_peace(line: Line, scenario: Callable[[], None]) -> None:
    """A busy host tears a frame now and then, which moves counters, too: one of some tries is undisturbed."""
    for _ in range(TRIES - 1):
        line.recover()
        try:
            scenario()
        except (AssertionError, GatewayError):
            continue
        return
    line.recover()
    scenario()


@pytest.fixture(scope="module")
def substation(programs: Path) -> Iterator[Substation]:
    config = configuration()
    devices = {
        f"{port['value']}.{slave['id']}": {
            "holding_registers": {str(address): held(slave["id"], address) for address in range(REGISTERS)}
        }
        for port in config["port"]
        for slave in port["slaves"]
    }
    with gateway_on_lines(config, programs, devices) as (lines, gateway):
        gateway.wait_for(lambda: everything_read(gateway), 60.0, "every device has been read")
        yield Substation(lines, gateway)


@pytest.fixture
def faulty(substation: Substation) -> Line:
    return Line(FAULTY, substation)


@pytest.fixture
def alone(substation: Substation) -> Line:
    return Line(ALONE, substation)


# ---- answers that are spoilt ------------------------------------------------------------------------


@each_fault
def test_once(faulty: Line, fault: Fault) -> None:
    """One spoilt answer moves its counters and no other, and costs no value its quality."""

    def spoil_one() -> None:
        before = faulty.counters()
        faulty.fault(PATIENT, *fault.words, count=1)
        faulty.wait_moved(before, fault.moves)
        assert faulty.qualities(PATIENT) == {"good"}
        for unit in (PATIENT, STRICT, PATIENT, STRICT):
            faulty.wait_answered(unit)
        assert faulty.moved(before) == fault.moves
        assert faulty.qualities(PATIENT) == {"good"}

    in_peace(faulty, spoil_one)


@each_fault
def test_for_ever(faulty: Line, fault: Fault) -> None:
    """A device that always fails is invalid, unless its answer can be found; cured, it is good again."""

    def spoil_all() -> None:
        before = faulty.counters()
        faulty.fault(STRICT, *fault.words)
        if fault.kills:
            faulty.wait_quality(STRICT, "invalid", DEAD_S)
        else:
            faulty.wait_moved(before, {name: 3 * by for name, by in fault.moves.items()})
            assert faulty.qualities(STRICT) == {"good"}
        assert faulty.qualities(PATIENT) == {"good"}
        faulty.fault(STRICT, "clear")
        faulty.wait_quality(STRICT, "good", BACK_S)
        faulty.wait_answered(STRICT)
        assert set(faulty.moved(before)) == set(fault.moves)

    in_peace(faulty, spoil_all)


def test_confirmation_of_another_write(faulty: Line) -> None:
    point, value = f"p{FAULTY}.{PATIENT}.h0", str(held(PATIENT, 0))

    def writes() -> int:
        return int(faulty.sim.stats()[str(FAULTY)]["slaves"][str(PATIENT)]["writes"])

    def confirm_another() -> None:
        before, written = faulty.counters(), writes()
        faulty.fault(PATIENT, "wrong-echo", count=1)
        with pytest.raises(GatewayError, match="time-out"):
            faulty.gateway.ctl("set", point, value)
        faulty.wait_answered(PATIENT)
        assert writes() == written + 1
        assert faulty.moved(before) == {"timeouts": 1, "wrong_answers": 1}
        faulty.gateway.ctl("set", point, value)

    in_peace(faulty, confirm_another)


# ---- exceptions -------------------------------------------------------------------------------------


def test_exceptions(substation: Substation) -> None:
    """1 to 11, a device each: what it refuses is invalid, or not topical if it may have it a moment later."""
    line = Line(REFUSING, substation)

    def exceptions() -> dict[int, int]:
        return {device["id"]: device["exceptions"] for device in line.row()["devices"]}

    def refuse() -> None:
        moved, before = line.counters(), exceptions()
        for exception in EXCEPTIONS:
            line.fault(exception, "exception", exception)
        for exception in EXCEPTIONS:
            line.wait_quality(exception, "not topical" if exception in OF_THE_MOMENT else "invalid", DEAD_S)
        line.gateway.wait_for(
            lambda: all(now > before[unit] for unit, now in exceptions().items()), SHOWN_S, "all are counted"
        )
        assert all(device["alive"] for device in line.row()["devices"])
        line.recover()  # whole again, also what was read piece by piece
        assert set(line.moved(moved)) == {"exceptions"}

    in_peace(line, refuse)


@pytest.mark.parametrize("exception", EXCEPTIONS[1:])
def test_exception_to_a_command(substation: Substation, exception: int) -> None:
    line = Line(REFUSING, substation)
    line.fault(exception, "exception", exception, WRITE_REGISTER, count=1)
    with pytest.raises(GatewayError, match=f"exception {exception}"):
        line.gateway.ctl("set", f"p{REFUSING}.{exception}.h0", "1")
    line.wait_answered(exception)
    assert line.qualities(exception) == {"good"}


def test_a_device_that_does_not_know_the_function_is_written_by_the_other(substation: Substation) -> None:
    line, device = Line(REFUSING, substation), EXCEPTIONS[0]
    line.fault(device, "exception", ILLEGAL_FUNCTION, WRITE_REGISTER, count=1)
    line.gateway.ctl("set", f"p{REFUSING}.{device}.h0", str(held(device, 0)))
    line.wait_answered(device)
    assert line.qualities(device) == {"good"}
    assert f"does not know function {WRITE_REGISTER}" in line.gateway.log(1000)


# ---- the line itself --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("octets", "moves"),
    [
        pytest.param(sealed(bytes([99, 3, 0, 0, 0, 1])), {"unasked_frames": 1}, id="frame"),
        pytest.param(bytes(range(170, 180)), {"noise_bytes": 10}, id="noise"),
    ],
)
def test_unasked(alone: Line, octets: bytes, moves: dict[str, int]) -> None:
    """Another master on the line, or noise, while nobody is asked."""

    def speak() -> None:
        before = alone.counters()
        alone.wait_answered(PATIENT)
        alone.sim.command(f"say {ALONE} {' '.join(map(str, octets))}")
        alone.wait_answered(PATIENT)
        alone.wait_answered(PATIENT)
        assert alone.moved(before) == moves
        assert alone.qualities(PATIENT) == {"good"}

    in_peace(alone, speak)


def test_stuck_line(alone: Line, faulty: Line) -> None:
    """Never silent: its devices are invalid as long as it lasts; the other lines do not notice."""

    def jam() -> None:
        before, others = alone.counters(), faulty.counters()
        alone.sim.command(f"jam {ALONE}")
        try:
            alone.wait_quality(PATIENT, "invalid", DEAD_S)
            alone.wait_moved(before, {"stuck_s": 2, "noise_bytes": 1000})
            assert alone.qualities(PATIENT) == {"invalid"}
            assert faulty.qualities(PATIENT) == {"good"}
        finally:
            alone.sim.command(f"unjam {ALONE}")
        alone.wait_quality(PATIENT, "good", BACK_S)
        assert set(alone.moved(before)) <= {"stuck_s", "noise_bytes", "timeouts"}
        assert faulty.moved(others) == {}

    faulty.recover()
    in_peace(alone, jam)


def test_cut_line(alone: Line) -> None:
    def cut() -> None:
        before = alone.counters()
        alone.sim.unplug(ALONE)
        try:
            alone.wait_quality(PATIENT, "invalid", DEAD_S)
        finally:
            alone.sim.plug(ALONE)
        alone.wait_quality(PATIENT, "good", BACK_S)
        assert set(alone.moved(before)) == {"timeouts"}

    in_peace(alone, cut)


# ---- what is written of it --------------------------------------------------------------------------


def rows() -> list[list[str]]:
    """Of the page's first table: what happens, its counters, the reaction, the test."""
    lines = [line for line in PAGE.read_text().splitlines() if line.startswith("| ")]
    return [[cell.strip() for cell in line.strip("|").split(" | ")] for line in lines]


def test_page_says_what_is_tested() -> None:
    documented = {
        row[3].strip("`"): set(re.findall(r"`(\w+)`", row[1]))
        for row in rows()
        if row[-1].startswith("`test_")
    }
    for fault in FAULTS:
        assert documented.pop(f"test_once[{fault.name}]") == set(fault.moves)
    assert set().union(*documented.values()) <= set(COUNTERS)
    assert all(name.partition("[")[0] in globals() for name in documented)
