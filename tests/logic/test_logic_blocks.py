# SPDX-License-Identifier: GPL-3.0-or-later
"""The blocks of docs/blocks.md, beside closed forms and libraries that others wrote."""

import math
import os
import random
import re
import shlex
import statistics
import subprocess
import sys
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime, timedelta
from itertools import pairwise
from pathlib import Path
from types import ModuleType
from zoneinfo import ZoneInfo

import astral
import astral.sun
import pytest

from openrtu_tools.cli import main
from openrtu_tools.logic.compile import compile_text, library
from openrtu_tools.logic.desk import Desk, Value
from openrtu_tools.logic.errors import Findings

ROOT = Path(__file__).resolve().parents[2]
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
INVALID, SUBSTITUTED = 0x80, 0x20
# Those of docs/logic.md.
STANDARD = {"SR", "RS", "R_TRIG", "F_TRIG", "CTU", "CTD", "CTUD", "TON", "TOF", "TP", "COMMAND", "REQUEST"}


@pytest.fixture(autouse=True)
def machine(programs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if "OPENRTU_LOGIC_DESK" not in os.environ:
        monkeypatch.setenv("OPENRTU_LOGIC_DESK", shlex.quote(str(programs / "logic/logic-desk")))


@pytest.fixture(scope="module")
def signal() -> ModuleType:
    """Of scipy, for the worker alone that runs its tests: no other module takes so long to import."""
    from scipy import signal

    return signal


Inputs = dict[str, Value | float | bool]


def ran(
    block: str, call: str, outputs: str, rows: Iterable[Inputs], seconds: float = 0.1, reals: str = "x"
) -> list[list[Value]]:
    """Scans of `f(call)` with an instance f of the block; `outputs`: NAME:TYPE of what is read from it."""
    wanted = [one.split(":") for one in outputs.split()]
    declared = " ".join(f"o_{name} : {kind};" for name, kind in wanted)
    inputs = " ".join(f"{name} : {'BOOL' if name.isupper() else 'LREAL'};" for name in reals.split())
    text = (
        f"PROGRAM p VAR_EXTERNAL {inputs} {declared} END_VAR VAR f : {block}; END_VAR\nf({call});\n"
        + "".join(f"o_{name} := f.{name};\n" for name, _ in wanted)
        + "END_PROGRAM"
    )
    findings = Findings()
    program = compile_text(text, findings)
    assert not findings.failed, findings.sorted()
    found = []
    step = round(seconds * 1e6)
    with Desk(program) as desk:
        for n, row in enumerate(rows):
            values = {
                name: value if isinstance(value, Value) else Value(value) for name, value in row.items()
            }
            scan = desk.scan(n * step, step if n else 0, n * step, values)
            assert sum(scan.faults) == 0, (n, scan.last_fault)
            found.append([scan.outputs[f"o_{name}"] for name, _ in wanted])
    return found


def numbers(found: Sequence[Sequence[Value]], at: int = 0) -> list[float]:
    return [float(one[at].value) for one in found]


def noise(count: int, seed: int = 1) -> list[float]:
    chance = random.Random(seed)
    return [chance.uniform(-50, 50) for _ in range(count)]


# ---- control -----------------------------------------------------------------------------------------


def test_lag_is_a_first_order_system() -> None:
    found = numbers(ran("LAG", "IN := x, T := T#2s", "OUT:LREAL", [{"x": 0.0}] + [{"x": 10.0}] * 50))
    assert found == pytest.approx([10 * (1 - math.exp(-n * 0.1 / 2)) for n in range(51)])


def test_rate_of_a_slope() -> None:
    found = numbers(ran("RATE", "IN := x, T := T#0s", "OUT:LREAL", [{"x": n * 0.3} for n in range(20)]))
    assert found == pytest.approx([0.0] + [3.0] * 19)


@pytest.mark.slow
def test_biquad_is_that_of_scipy(signal: ModuleType) -> None:
    b, a = signal.butter(2, 0.2)
    values = noise(200)
    call = f"IN := x, B0 := {b[0]!r}, B1 := {b[1]!r}, B2 := {b[2]!r}, A1 := {a[1]!r}, A2 := {a[2]!r}"
    found = ran(
        "BIQUAD", re.sub(r"np\.float64\((.*?)\)", r"\1", call), "OUT:LREAL", [{"x": v} for v in values]
    )
    assert numbers(found) == pytest.approx(list(signal.lfilter(b, a, values)), rel=1e-12, abs=1e-12)


@pytest.mark.slow
@pytest.mark.sample(6)
@pytest.mark.parametrize("kind", ["butterworth", "chebyshev", "elliptic"])
@pytest.mark.parametrize(
    ("band", "edges"), [("low", "1.5"), ("high", "1.5"), ("pass", "1,2"), ("stop", "1,2")]
)
def test_designed_filter_runs_as_scipy_computes_it(
    kind: str, band: str, edges: str, signal: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["filter", kind, band, "--order", "4", "--edges", edges, "--period", "100", "--name", "f4"]
    assert main(["logic", *words]) == 0
    text = capsys.readouterr().out
    program = compile_text(
        f"{text}\nPROGRAM p VAR_EXTERNAL x, y : LREAL; END_VAR VAR f : f4; END_VAR\n"
        "f(IN := x); y := f.OUT; END_PROGRAM",
        findings := Findings(),
    )
    assert findings.sorted() == []
    values = [1.0, *noise(150)]
    with Desk(program) as desk:
        found = [desk.scan(n, 100_000, n, {"x": Value(v)}).outputs["y"].value for n, v in enumerate(values)]
    bands = {"low": "lowpass", "high": "highpass", "pass": "bandpass", "stop": "bandstop"}
    edge = [float(one) for one in edges.split(",")]
    sections = signal.iirfilter(
        4, edge if len(edge) > 1 else edge[0], rp=1, rs=40, btype=bands[band], fs=10, output="sos",
        ftype={"butterworth": "butter", "chebyshev": "cheby1", "elliptic": "ellip"}[kind],
    )  # fmt: skip
    assert found == pytest.approx(list(signal.sosfilt(sections, values)), rel=1e-9, abs=1e-9)


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["low", "--edges", "5"], "half of the scans a second"),
        (["low", "--edges", "1,2"], "one edge"),
        (["pass", "--edges", "2,1"], "a lower and an upper edge"),
        (["low", "--edges", "x"], "are no frequencies"),
    ],
)
def test_filter_that_cannot_be(words: list[str], complaint: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["logic", "filter", "butterworth", *words, "--period", "100"]) == 2
    assert complaint in capsys.readouterr().err


def test_ramp_keeps_its_limits_and_arrives() -> None:
    targets = [0.0] + [10.0] * 120 + [-3.0] * 150 + [-3.2] * 30
    call = "IN := x, UP := 2.0, DOWN := 4.0, ACCELERATION := 3.0"
    found = ran("RAMP", call, "OUT:LREAL BUSY:BOOL", [{"x": value} for value in targets])
    out = numbers(found)
    speeds = [(b - a) / 0.1 for a, b in pairwise(out)]
    assert max(speeds) == pytest.approx(2.0)
    assert min(speeds) == pytest.approx(-4.0)
    changes = [(b - a) / 0.1 for a, b in pairwise(speeds)]
    assert max(map(abs, changes)) <= 3.0 + 1e-6
    assert (out[120], out[270], out[-1]) == pytest.approx((10.0, -3.0, -3.2), abs=1e-6)
    assert max(out) <= 10.0 + 1e-9 and min(out) >= -3.2 - 1e-9  # it never goes beyond its target
    assert [found[n][1].value for n in (30, 120, 130, 270)] == [True, False, True, False]


def test_ramp_without_limits_is_its_input() -> None:
    assert numbers(ran("RAMP", "IN := x", "OUT:LREAL", [{"x": v} for v in (1.0, 7.0, -2.0)])) == [
        1.0,
        7.0,
        -2.0,
    ]


def test_hysteresis() -> None:
    found = ran(
        "HYSTERESIS",
        "IN := x, LOW := 2.0, HIGH := 5.0",
        "Q:BOOL",
        [{"x": float(v)} for v in (3, 6, 3, 2, 1, 3, 6)],
    )
    assert [one[0].value for one in found] == [False, True, True, True, False, False, True]


def test_levels() -> None:
    rows = [{"x": v} for v in (0.0, 11.0, 35.0, 29.5, 28.0, 19.5, -5.0)]
    found = ran("LEVELS", "IN := x, WIDTH := 1.0, L1 := 10.0, L2 := 20.0, L3 := 30.0", "LEVEL:INT", rows)
    assert numbers(found) == [0, 1, 3, 3, 2, 2, 0]
    ten = ", ".join(f"L{n} := {n}.0" for n in range(1, 11))
    rows = [{"x": v} for v in (0.5, 4.5, 11.0, 9.95, 9.85, 2.0, 0.8)]
    found = ran("LEVELS", f"IN := x, WIDTH := 0.1, {ten}", "LEVEL:INT", rows)
    assert numbers(found) == [0, 4, 10, 10, 9, 2, 0]


def test_alarm_waits_and_is_acknowledged() -> None:
    trace = [(0, 0), (9, 0), (9, 0), (9, 0), (7.5, 0), (6, 0), (6, 0), (6, 0), (6, 1), (9, 1), (6, 0)]
    found = ran(
        "ALARM", "IN := x, LEVEL := 8.0, WIDTH := 1.0, DELAY := T#150ms, OFF_DELAY := T#150ms, ACK := A",
        "ACTIVE:BOOL UNACKNOWLEDGED:BOOL", [{"x": float(x), "A": bool(a)} for x, a in trace], reals="x A",
    )  # fmt: skip
    assert "".join(str(int(one[0].value)) for one in found) == "00011110000"
    assert "".join(str(int(one[1].value)) for one in found) == "00011111000"


PID = "SP := sp, PV := pv, MANUAL := M, MAN_OUT := man, KP := 2.0, TI := T#5s, LOW := 0.0, HIGH := 100.0"


def controlled(
    call: str, seconds: float, sp: float = 50.0, disturb: float = 0.0, gain: float = 1.0
) -> tuple[list[float], list[float]]:
    """A first-order plant with a time constant of 10 s, in closed loop on the machine."""
    text = (
        "PROGRAM p VAR_EXTERNAL pv, sp, out : LREAL; END_VAR VAR f : PID; END_VAR\n"
        f"f({call}); out := f.OUT; END_PROGRAM"
    )
    program = compile_text(text, findings := Findings())
    assert not findings.failed, findings.sorted()
    pv, pvs, outs = 0.0, [], []
    with Desk(program) as desk:
        for n in range(round(seconds / 0.1)):
            scan = desk.scan(n * 100_000, 100_000, n, {"pv": Value(pv), "sp": Value(sp)})
            out = float(scan.outputs["out"].value)
            pv += (gain * out + disturb - pv) * (1 - math.exp(-0.1 / 10))
            pvs.append(pv)
            outs.append(out)
    return pvs, outs


@pytest.mark.slow
def test_pid_settles_as_its_transfer_function_says(signal: ModuleType) -> None:
    """PI with KP 2 and TI 5 s on 1 / (1 + 10 s): the closed loop is (10 s + 2) / (50 s^2 + 15 s + 2)."""
    pvs, _ = controlled("SP := sp, PV := pv, KP := 2.0, TI := T#5s, HIGH := 1000.0", 60)
    times = [0.1 * (n + 1) for n in range(600)]
    _, expected = signal.step(signal.TransferFunction([10, 2], [50, 15, 2]), T=[0.0, *times])
    assert pvs == pytest.approx([50 * float(v) for v in expected[1:]], abs=0.6)  # sampled at 100 ms
    assert pvs[-1] == pytest.approx(50, abs=0.05)


def test_pid_recovers_from_its_limit_at_once() -> None:
    """Without a stop of the integral it would stay at the limit for as long as it had been wound up."""
    rows = [{"sp": 90.0, "pv": 10.0, "man": 0.0, "M": False}] * 300 + [
        {"sp": 90.0, "pv": 85.0, "man": 0.0, "M": False}
    ] * 40
    found = ran("PID", PID, "OUT:LREAL LIMITED:BOOL", rows, reals="sp pv man M")
    assert (found[299][0].value, found[299][1].value) == (100.0, True)
    assert found[300][0].value < 100.0
    assert not found[300][1].value


def test_pid_does_not_jump_when_a_hand_takes_over_or_lets_go() -> None:
    def row(manual: bool, man: float) -> Inputs:
        return {"sp": 50.0, "pv": 45.0, "man": man, "M": manual}

    rows = [row(False, 7.0)] * 20 + [row(True, 7.0)] * 5 + [row(True, 30.0)] * 5 + [row(False, 30.0)] * 5
    out = numbers(ran("PID", PID, "OUT:LREAL", rows, reals="sp pv man M"))
    assert out[20:25] == [out[19]] * 5  # into manual, with whatever stood in MAN_OUT
    assert out[25:30] == [30.0] * 5  # the hand moves it
    assert out[30] == pytest.approx(
        30.0 + 2.0 * 5.0 * 0.1 / 5.0
    )  # and goes on from there: one step of the integral


def test_pid_derives_the_process_value_not_the_set_point() -> None:
    call = "SP := sp, PV := pv, KP := 1.0, TD := T#4s, LOW := -1000.0, HIGH := 1000.0"
    rows = [{"sp": 0.0, "pv": 0.0}] * 3 + [{"sp": 10.0, "pv": 0.0}] * 3 + [{"sp": 10.0, "pv": 1.0}] * 60
    out = numbers(ran("PID", call, "OUT:LREAL", rows, reals="sp pv"))
    assert out[3] == 10.0
    assert out[6] == pytest.approx(9.0 - 8.0 * math.exp(-0.1 / 0.5))
    assert out[-1] == pytest.approx(9.0, abs=1e-3)


def test_autotune_finds_parameters_that_hold_the_plant() -> None:
    """A plant with three lags of 4 s each; its critical gain is 8, its period 2 pi 4 / sqrt(3)."""
    text = """PROGRAM p VAR_EXTERNAL pv, out, kp, ti, td : LREAL; done : BOOL; END_VAR
VAR t : AUTOTUNE; END_VAR
t(START := TRUE, SP := 50.0, PV := pv, BIAS := 50.0, AMOUNT := 20.0, WIDTH := 0.05);
out := t.OUT; done := t.DONE; kp := t.KP; ti := TIME_TO_LREAL(t.TI); td := TIME_TO_LREAL(t.TD); END_PROGRAM"""
    program = compile_text(text, findings := Findings())
    assert not findings.failed, findings.sorted()
    lags, share = [49.0, 49.0, 49.0], 1 - math.exp(-0.05 / 4)
    with Desk(program) as desk:
        for n in range(6000):
            outputs = desk.scan(n * 50_000, 50_000, n, {"pv": Value(lags[2])}).outputs
            if outputs["done"].value:
                break
            before = float(outputs["out"].value)
            for i in range(3):
                lags[i] += (before - lags[i]) * share
                before = lags[i]
    assert outputs["done"].value
    period = 2 * math.pi * 4 / math.sqrt(3)
    assert float(outputs["kp"].value) == pytest.approx(8 / 2.2, rel=0.15)
    assert float(outputs["ti"].value) == pytest.approx(2200 * period, rel=0.1)
    assert float(outputs["td"].value) == pytest.approx(1000 * period / 6.3, rel=0.1)


# ---- what an invalid input leaves --------------------------------------------------------------------

REMEMBER = {
    "LAG": ("IN := x, T := T#1s", "OUT:LREAL"),
    "RATE": ("IN := x, T := T#1s", "OUT:LREAL"),
    "BIQUAD": ("IN := x, B0 := 0.5, A1 := -0.5", "OUT:LREAL"),
    "RAMP": ("IN := x, UP := 1.0, DOWN := 1.0, ACCELERATION := 1.0", "OUT:LREAL"),
    "HYSTERESIS": ("IN := x, LOW := 1.0, HIGH := 3.0", "Q:BOOL"),
    "LEVELS": ("IN := x, L1 := 1.0", "LEVEL:INT"),
    "ALARM": ("IN := x, LEVEL := 1.0", "ACTIVE:BOOL"),
    "PID": ("SP := 5.0, PV := x, TI := T#5s, TD := T#1s", "OUT:LREAL"),
    "AUTOTUNE": ("START := TRUE, SP := 5.0, PV := x, AMOUNT := 1.0", "OUT:LREAL"),
    "TOTALIZER": ("IN := x", "OUT:LREAL"),
    "RUN_HOURS": ("IN := x > 1.0", "HOURS:LREAL STARTS:UDINT"),
    "MOVING": ("IN := x, N := 5", "MEAN:LREAL LOWEST:LREAL HIGHEST:LREAL DEVIATION:LREAL"),
}


@pytest.mark.parametrize("block", REMEMBER)
def test_an_invalid_input_makes_the_output_invalid_for_as_long_as_it_lasts(block: str) -> None:
    call, outputs = REMEMBER[block]
    rows: list[Inputs] = [{"x": 2.0}, {"x": 2.5}, {"x": Value(9e9, INVALID)}, {"x": 2.5}, {"x": 2.6}]
    found = ran(block, call, outputs, rows)
    for at in range(len(found[0])):
        assert [one[at].quality for one in found] == [0, 0, INVALID, 0, 0]
        assert found[2][at].value == found[1][at].value  # held


@pytest.mark.parametrize("block", REMEMBER)
def test_a_substituted_input_does_not_stick(block: str) -> None:
    call, outputs = REMEMBER[block]
    found = ran(block, call, outputs, [{"x": 2.0}, {"x": Value(2.5, SUBSTITUTED)}, {"x": 2.5}])
    for at in range(len(found[0])):
        assert [one[at].quality for one in found] == [0, SUBSTITUTED, 0]


def test_each_block_that_remembers_is_held_to_it() -> None:
    stateless = {"DATE_PARTS", "LOCAL_TIME", "IN_YEAR", "SUN", "SUN_PLACE"}
    blocks = {unit.name for unit in library() if unit.kind == "FUNCTION_BLOCK"}
    assert blocks - STANDARD - stateless == set(REMEMBER)


# ---- counting ----------------------------------------------------------------------------------------


def test_totalizer() -> None:
    found = numbers(
        ran(
            "TOTALIZER",
            "IN := x, PER := T#1h, RESET := R",
            "OUT:LREAL",
            [{"x": 36.0, "R": n == 90} for n in range(101)],
            1.0,
            "x R",
        )
    )
    assert (found[89], found[90], found[100]) == pytest.approx((0.89, 0.0, 0.1))


def test_run_hours() -> None:
    rows = [{"R": n % 10 < 5} for n in range(100)]
    found = ran("RUN_HOURS", "IN := R", "HOURS:LREAL STARTS:UDINT", rows, 36.0, "R")
    assert found[-1][0].value == pytest.approx(0.49)  # the first scan has no time
    assert found[-1][1].value == 10


def test_moving_statistics_are_those_of_python() -> None:
    values = noise(40)
    found = ran(
        "MOVING",
        "IN := x, N := 7",
        "MEAN:LREAL LOWEST:LREAL HIGHEST:LREAL DEVIATION:LREAL COUNT:INT",
        [{"x": v} for v in values],
    )
    for n, one in enumerate(found):
        window = values[max(0, n - 6) : n + 1]
        expected = (
            statistics.fmean(window),
            min(window),
            max(window),
            statistics.pstdev(window),
            len(window),
        )
        assert [float(each.value) for each in one] == pytest.approx(list(expected))


# ---- calendar ----------------------------------------------------------------------------------------


def at_times(text: str, times: Sequence[datetime]) -> list[dict[str, Value]]:
    """Scans of a program's statements with NOW() at these times."""
    program = compile_text(text, findings := Findings())
    assert not findings.failed, findings.sorted()
    with Desk(program) as desk:
        return [
            desk.scan(n, 1, (when - EPOCH) // timedelta(microseconds=1), {}).outputs
            for n, when in enumerate(times)
        ]


def moments(first: int, last: int, count: int = 200) -> list[datetime]:
    chance = random.Random(7)
    span = datetime(last, 1, 1, tzinfo=UTC) - datetime(first, 1, 1, tzinfo=UTC)
    return [
        datetime(first, 1, 1, tzinfo=UTC) + timedelta(seconds=chance.randrange(round(span.total_seconds())))
        for _ in range(count)
    ]


def test_dates_are_those_of_python() -> None:
    text = """PROGRAM p VAR_EXTERNAL year, month, day, weekday_ : INT; at : LREAL; END_VAR
VAR d : DATE_PARTS; END_VAR
d(WHEN := NOW()); year := d.YEAR; month := d.MONTH; day := d.DAY; weekday_ := WEEKDAY(NOW());
at := TIME_TO_LREAL(TIME_OF_DAY(NOW())) / 1000.0; END_PROGRAM"""
    times = [*moments(1905, 2199), datetime(2000, 2, 29, tzinfo=UTC), datetime(2100, 3, 1, tzinfo=UTC), EPOCH]
    for when, found in zip(times, at_times(text, times), strict=True):
        assert [found[name].value for name in ("year", "month", "day", "weekday_")] == [
            when.year, when.month, when.day, when.isoweekday(),
        ]  # fmt: skip
        assert found["at"].value == when.hour * 3600 + when.minute * 60 + when.second


def test_summer_time_is_that_of_the_zone_database() -> None:
    text = """PROGRAM p VAR_EXTERNAL ahead : LREAL; END_VAR VAR l : LOCAL_TIME; END_VAR
l(WHEN := NOW(), OFFSET := T#1h, SUMMER := TRUE); ahead := TIME_TO_LREAL(l.OUT - NOW()) / 3600000.0;
END_PROGRAM"""
    zone = ZoneInfo("Europe/Belgrade")
    changes = [
        datetime(year, month, day, 1, tzinfo=UTC) + timedelta(seconds=second)
        for year in range(2020, 2036)
        for month in (3, 10)
        for day in range(24, 32)
        for second in (-1, 0)
    ]
    times = [*moments(1997, 2037), *changes]
    for when, found in zip(times, at_times(text, times), strict=True):
        offset = when.astimezone(zone).utcoffset()
        assert offset is not None
        assert found["ahead"].value == offset.total_seconds() / 3600, when


def test_weeks_and_years() -> None:
    text = """PROGRAM p VAR_EXTERNAL work, night, winter : BOOL; END_VAR VAR y : IN_YEAR; END_VAR
work := IN_WEEK(NOW(), BYTE#16#1F, T#7h, T#17h30m);
night := IN_WEEK(NOW(), BYTE#16#10, T#22h, T#6h);
y(WHEN := NOW(), FIRST := 1015, LAST := 415); winter := y.Q; END_PROGRAM"""
    times = moments(2020, 2030, 300)
    for when, found in zip(times, at_times(text, times), strict=True):
        clock, day = when.hour + when.minute / 60 + when.second / 3600, when.weekday()
        assert found["work"].value == (day < 5 and 7 <= clock < 17.5)
        assert found["night"].value == ((day == 4 and clock >= 22) or (day == 5 and clock < 6))
        assert found["winter"].value == (
            (when.month, when.day) >= (10, 15) or (when.month, when.day) <= (4, 15)
        )


@pytest.mark.parametrize(
    ("latitude", "longitude"), [(44.82, 20.46), (-33.9, 18.4), (0.0, -78.5), (59.9, 10.7)]
)
def test_sunrise_is_that_of_astral(latitude: float, longitude: float) -> None:
    text = f"""PROGRAM p VAR_EXTERNAL rise, set_, height : LREAL; up, rises : BOOL; END_VAR
VAR s : SUN; END_VAR
s(WHEN := NOW(), LATITUDE := {latitude}, LONGITUDE := {longitude});
rise := TIME_TO_LREAL(s.SUNRISE - NOW()) / 1000.0; set_ := TIME_TO_LREAL(s.SUNSET - NOW()) / 1000.0;
height := s.ELEVATION; up := s.UP; rises := s.RISES; END_PROGRAM"""
    place = astral.Observer(latitude, longitude)
    times = [datetime(2026, 1, 3, 12, tzinfo=UTC) + timedelta(days=9 * n, hours=n % 7) for n in range(40)]
    for when, found in zip(times, at_times(text, times), strict=True):
        sun = astral.sun.sun(place, when.date())
        for name, mine in (("sunrise", "rise"), ("sunset", "set_")):
            computed = when + timedelta(seconds=float(found[mine].value))
            error = (computed - sun[name] + timedelta(hours=12)) % timedelta(days=1) - timedelta(hours=12)
            assert abs(error) < timedelta(minutes=3), (when, name, error)
        height = astral.sun.elevation(place, when, with_refraction=False)
        assert float(found["height"].value) == pytest.approx(height, abs=0.1)
        assert found["rises"].value and found["up"].value == (height > -0.8333)


def test_a_day_without_sunset() -> None:
    text = """PROGRAM p VAR_EXTERNAL up, rises : BOOL; END_VAR VAR s : SUN; END_VAR
s(WHEN := NOW(), LATITUDE := 69.6, LONGITUDE := 18.9); up := s.UP; rises := s.RISES; END_PROGRAM"""
    summer, winter = at_times(
        text, [datetime(2026, 6, 21, tzinfo=UTC), datetime(2026, 12, 21, 12, tzinfo=UTC)]
    )
    assert (summer["rises"].value, summer["up"].value) == (False, True)
    assert (winter["rises"].value, winter["up"].value) == (False, False)


# ---- the library itself ------------------------------------------------------------------------------


def test_a_name_of_the_library_is_taken() -> None:
    compile_text("FUNCTION_BLOCK PID END_FUNCTION_BLOCK PROGRAM p END_PROGRAM", findings := Findings())
    assert [one.text for one in findings.sorted() if one.severity == "error"] == [
        "PID is a block of the library; give yours another name"
    ]


def test_the_page_has_each_block() -> None:
    page = (ROOT / "docs/blocks.md").read_text()
    for unit in library():
        assert f"`{unit.name}" in page or unit.name in STANDARD, unit.name


@pytest.mark.slow
def test_each_plot_is_what_its_block_does(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, ROOT / "scripts/block-plots.py", "--into", tmp_path],
        env=os.environ | {"PYTHONPATH": str(ROOT / "scripts")},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stderr == ""
    kept = {file.name: file.read_text() for file in (ROOT / "docs/figures/blocks").iterdir()}
    assert {file.name: file.read_text() for file in tmp_path.iterdir()} == kept
    page = (ROOT / "docs/blocks.md").read_text()
    assert set(re.findall(r"\(figures/blocks/(.*?)\)", page)) == set(kept)
    assert max(map(len, kept.values())) < 8192


@pytest.mark.slow
def test_the_picture_is_what_the_example_does(tmp_path: Path) -> None:
    example, plot = ROOT / "docs/examples/logic/tank.st", tmp_path / "blocks.svg"
    words = ["run", str(example), str(example.with_suffix(".test.csv")), "-o", str(tmp_path / "out.csv")]
    assert main(["logic", *words, "--plot", str(plot)]) == 0
    licence, _, picture = (ROOT / "docs/figures/blocks.svg").read_text().partition("\n")
    assert licence == "<!-- SPDX-License-Identifier: GPL-3.0-or-later -->"
    assert plot.read_text() == picture
