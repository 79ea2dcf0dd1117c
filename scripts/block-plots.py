#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws what each block of docs/blocks.md does, by `openrtu logic run`: docs/figures/blocks."""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from openrtu_tools.cli import main as openrtu

FOLDER = Path(__file__).resolve().parents[1] / "docs/figures/blocks"
LICENCE = "<!-- SPDX-License-Identifier: GPL-3.0-or-later -->\n"
CELL = Callable[[float], object]


@dataclass(frozen=True)
class Plot:
    """A program of one block, and what its inputs are at each time: 120 scans by default."""

    points: str
    body: str
    inputs: dict[str, CELL]
    period_s: float = 0.5
    scans: int = 120
    variables: str = ""


def steps(*at: tuple[float, object]) -> CELL:
    """The last value whose time has come."""
    return lambda time: [value for start, value in at if start <= time][-1]


def wave(time: float) -> float:
    return round(50 + 40 * math.sin(2 * math.pi * time / 30), 2)


def rough(time: float) -> float:
    """A slow wave with a fast one on it."""
    return round(10 * math.sin(2 * math.pi * time / 30) + 4 * math.sin(2 * math.pi * time / 1.7), 2)


HOURS = """FUNCTION HOURS : LREAL
VAR_INPUT length : TIME; END_VAR
HOURS := LINT_TO_LREAL(TIME_TO_LINT(length)) / 3600000.0;
END_FUNCTION
"""
DAYS = "when : DT;"  # an hour of the calendar for each second of the plot
PLOTS = {
    "pid": Plot(
        "wanted, hand, level, valve : LREAL; manual : BOOL",
        "control(SP := wanted, PV := water.OUT, KP := 1.5, TI := T#8s, TD := T#1s, MANUAL := manual,\n"
        "  MAN_OUT := hand);\nvalve := control.OUT;\n"
        "water(IN := AS_GOOD(valve), T := T#10s);\nlevel := water.OUT;",
        {
            "wanted": steps((0, 20), (5, 60), (75, 40)),
            "manual": steps((0, 0), (40, 1), (60, 0)),
            "hand": steps((0, 30), (50, 45)),
        },
        0.5,
        240,
        "control : PID; water : LAG;",
    ),
    "autotune": Plot(
        "start, done : BOOL; level, valve, kp : LREAL",
        "tune(START := start, SP := 50.0, PV := c.OUT, BIAS := 50.0, AMOUNT := 20.0, WIDTH := 0.5);\n"
        "valve := tune.OUT; a(IN := AS_GOOD(valve), T := T#5s); b(IN := a.OUT, T := T#4s);\n"
        "c(IN := b.OUT, T := T#3s);\n"
        "level := c.OUT; done := tune.DONE; kp := tune.KP;",
        {"start": steps((0, 0), (40, 1))},
        1.0,
        200,
        "tune : AUTOTUNE; a, b, c : LAG;",
    ),
    "lag": Plot(
        "x, out : LREAL",
        "f(IN := x, T := T#5s); out := f.OUT;",
        {"x": steps((0, 0), (5, 10), (35, 2))},
        variables="f : LAG;",
    ),
    "rate": Plot(
        "x, rate : LREAL", "f(IN := x, T := T#2s); rate := f.OUT;", {"x": wave}, variables="f : RATE;"
    ),
    "ramp": Plot(
        "x, out : LREAL; busy : BOOL",
        "f(IN := x, UP := 3.0, DOWN := 6.0, ACCELERATION := 1.0); out := f.OUT; busy := f.BUSY;",
        {"x": steps((0, 0), (5, 60), (40, 10))},
        variables="f : RAMP;",
    ),
    "biquad": Plot(
        "x, out : LREAL",
        "f(IN := x, B0 := 0.0201, B1 := 0.0402, B2 := 0.0201, A1 := -1.561, A2 := 0.6414); out := f.OUT;",
        {"x": rough},
        0.25,
        160,
        "f : BIQUAD;",
    ),
    "dead_band": Plot(
        "x, beyond : LREAL", "beyond := DEAD_BAND(x, 4.0);", {"x": lambda t: round(10 * math.sin(t / 6), 2)}
    ),
    "cut_off": Plot(
        "x, flow : LREAL", "flow := CUT_OFF(x, 2.0);", {"x": lambda t: round(5 * math.sin(t / 6), 2)}
    ),
    "hysteresis": Plot(
        "x : LREAL; q : BOOL",
        "f(IN := x, LOW := 40.0, HIGH := 60.0); q := f.Q;",
        {"x": lambda t: round(wave(t) + 6 * math.sin(2.5 * t), 2)},
        variables="f : HYSTERESIS;",
    ),
    "levels": Plot(
        "x : LREAL; level : INT",
        "f(IN := x, WIDTH := 5.0, L1 := 20.0, L2 := 40.0, L3 := 60.0, L4 := 80.0); level := f.LEVEL;",
        {"x": wave},
        variables="f : LEVELS;",
    ),
    "alarm": Plot(
        "x : LREAL; ack, active, unacknowledged : BOOL",
        "f(IN := x, LEVEL := 70.0, WIDTH := 10.0, DELAY := T#3s, OFF_DELAY := T#2s, ACK := ack);\n"
        "active := f.ACTIVE; unacknowledged := f.UNACKNOWLEDGED;",
        {
            "x": steps((0, 50), (5, 80), (7, 50), (15, 80), (25, 65), (30, 50), (40, 90), (52, 50)),
            "ack": steps((0, 0), (35, 1), (37, 0), (47, 1), (49, 0)),
        },
        variables="f : ALARM;",
    ),
    "totalizer": Plot(
        "flow, total : LREAL; reset : BOOL",
        "f(IN := flow, PER := T#1m, RESET := reset); total := f.OUT;",
        {
            "flow": steps((0, 0), (5, 60), (20, 120), (30, "120!"), (35, 30)),
            "reset": steps((0, 0), (50, 1), (51, 0)),
        },
        variables="f : TOTALIZER;",
    ),
    "run_hours": Plot(
        "runs : BOOL; hours : LREAL; starts : UDINT",
        "f(IN := runs); hours := f.HOURS; starts := f.STARTS;",
        {"runs": steps((0, 0), (600, 1), (2400, 0), (4200, 1), (6600, 0))},
        60.0,
        120,
        "f : RUN_HOURS;",
    ),
    "moving": Plot(
        "x, mean, lowest, highest, deviation : LREAL",
        "f(IN := x, N := 10, PERIOD := T#1s); mean := f.MEAN; lowest := f.LOWEST; highest := f.HIGHEST;\n"
        "deviation := f.DEVIATION;",
        {"x": rough},
        1.0,
        60,
        "f : MOVING;",
    ),
    "calendar": Plot(
        "hour : LREAL; weekday, day : INT; work, night : BOOL",
        "when := DT#2026-01-29-00:00:00 + UPTIME() * 3600;\n"
        "hour := HOURS(TIME_OF_DAY(when)); weekday := WEEKDAY(when);\n"
        "parts(WHEN := when); day := parts.DAY;\n"
        "work := IN_WEEK(when, BYTE#16#1F, T#8h, T#17h); night := IN_WEEK(when, BYTE#16#7F, T#22h, T#6h);",
        {},
        1.0,
        169,
        f"parts : DATE_PARTS; {DAYS}",
    ),
    "year": Plot(
        "heating, summer : BOOL; offset : LREAL",
        "when := DT#2026-01-01-00:00:00 + UPTIME() * 86400;\n"
        "season(WHEN := when, FIRST := 1015, LAST := 430); heating := season.Q;\n"
        "zone(WHEN := when, OFFSET := T#1h, SUMMER := TRUE); summer := zone.IS_SUMMER;\n"
        "offset := HOURS(zone.OUT - when);",
        {},
        3.0,
        122,
        f"season : IN_YEAR; zone : LOCAL_TIME; {DAYS}",
    ),
    "sun": Plot(
        "sunrise, sunset, declination : LREAL",
        "when := DT#2026-01-01-12:00:00 + UPTIME() * 86400;\n"
        "s(WHEN := when, LATITUDE := 44.8, LONGITUDE := 20.5); place(WHEN := when);\n"
        "sunrise := HOURS(TIME_OF_DAY(s.SUNRISE));\n"
        "sunset := HOURS(TIME_OF_DAY(s.SUNSET)); \n"
        "declination := ASIN(place.SINE) * 57.29578;",
        {},
        3.0,
        122,
        f"s : SUN; place : SUN_PLACE; {DAYS}",
    ),
    "elevation": Plot(
        "elevation : LREAL; up : BOOL",
        "when := DT#2026-06-20-00:00:00 + UPTIME() * 3600;\n"
        "s(WHEN := when, LATITUDE := 44.8, LONGITUDE := 20.5); elevation := s.ELEVATION; up := s.UP;",
        {},
        0.5,
        97,
        f"s : SUN; {DAYS}",
    ),
}


def draw(name: str, target: Path) -> None:
    plot = PLOTS[name]
    with tempfile.TemporaryDirectory() as directory:
        program, table = Path(directory) / f"{name}.st", Path(directory) / "inputs.csv"
        declared = f"VAR_EXTERNAL {plot.points}; END_VAR" + (
            f" VAR {plot.variables} END_VAR" if plot.variables else ""
        )
        program.write_text(f"{HOURS}PROGRAM plotted\n{declared}\n{plot.body}\nEND_PROGRAM\n")
        times = [round(number * plot.period_s, 3) for number in range(plot.scans)]
        rows = [[time, *(cell(time) for cell in plot.inputs.values())] for time in times]
        table.write_text("\n".join(",".join(map(str, row)) for row in [["time", *plot.inputs], *rows]) + "\n")
        words = ["run", str(program), str(table), "--period", f"{plot.period_s * 1000:.0f}"]
        if openrtu(["logic", *words, "-o", str(Path(directory) / "out.csv"), "--plot", str(target)]) != 0:
            raise SystemExit(f"{name}: see above")
    target.write_text(LICENCE + target.read_text())


def main() -> int:
    parser = argparse.ArgumentParser(description="Draws what each block of the library does.")
    parser.add_argument("--into", type=Path, default=FOLDER, metavar="FOLDER", help=f"default: {FOLDER}")
    folder = parser.parse_args().into
    folder.mkdir(parents=True, exist_ok=True)
    for name in PLOTS:
        draw(name, folder / f"{name}.svg")
    return 0


if __name__ == "__main__":
    sys.exit(main())
