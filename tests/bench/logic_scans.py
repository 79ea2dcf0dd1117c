# SPDX-License-Identifier: GPL-3.0-or-later
"""
`make bench`: a scan of 1 000 statements in rtu-logic's machine, beside the same program in C and in Python.

CPU here, instructions on ARM, memory; and the jitter of a scan each 10 ms beside six busy lines.
What the rows mean: docs/bench.md. No time is asserted.
Exit codes: 0 done, 1 something did not work, 2 not built.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stopwatch import Spread

import lines
from bench import machine
from lab.gateway import REPOSITORY, Gateway, GatewayError, default_build, remove, run_directory
from openrtu_tools.logic.binary import encode
from openrtu_tools.logic.compile import compile_text
from openrtu_tools.logic.errors import Findings

SOURCE = REPOSITORY / "package/openrtu/src"
DRIVER = REPOSITORY / "tests/bench/scan_cost.c"
MACHINE = [
    SOURCE / "logic" / f"{name}.c" for name in ("load", "message", "range", "real", "run", "serve", "text")
]
AS_BUILT = "-fno-crossjumping"  # logic/meson.build
OPTIONS = ["-O2", "-std=gnu11", "-D_GNU_SOURCE", "-ffp-contract=off", f"-I{SOURCE}"]
NATIVE = ["cc"]
ARM = ["arm-linux-gnueabi-gcc", "-march=armv5te", "-mfloat-abi=soft", "-marm", "-static"]
# Each instruction is a block of its own, and each block a line of the log.
COUNTING = ["qemu-arm", "-cpu", "arm926", "-singlestep", "-d", "exec,nochain"]
PARTS = 50  # of 20 statements each
PART = """b1_{i} := s1 AND NOT s2 OR b0_{i};
b2_{i} := b1_{i} AND (n1_{i} > 100);
n1_{i} := n1_{i} + 1;
IF n1_{i} > 1000 THEN
  n1_{i} := 0;
END_IF;
n2_{i} := (n1_{i} * 3 + 7) / 2;
r1_{i} := r1_{i} + (x - r1_{i}) * 0.125;
r2_{i} := r1_{i} * 1.8 + 32.0;
b3_{i} := r2_{i} > 100.0 OR b1_{i};
CASE n2_{i} MOD 3 OF
  0: m_{i} := 1;
  1: m_{i} := 2;
  ELSE m_{i} := 3;
END_CASE;
tab_{i}[m_{i}] := n2_{i};
n3_{i} := tab_{i}[1] + tab_{i}[2] - tab_{i}[3];
t_{i}(IN := b3_{i}, PT := T#1s);
b4_{i} := t_{i}.Q XOR b2_{i};
n4_{i} := MIN(n3_{i}, 5000);
b0_{i} := NOT b4_{i};
total := total + n4_{i};
"""
C_PART = """b1_{i} = (s1 && !s2) || b0_{i};
b2_{i} = b1_{i} && n1_{i} > 100;
n1_{i} = n1_{i} + 1;
if (n1_{i} > 1000)
  n1_{i} = 0;
n2_{i} = (n1_{i} * 3 + 7) / 2;
r1_{i} = r1_{i} + (x - r1_{i}) * 0.125f;
r2_{i} = r1_{i} * 1.8f + 32.0f;
b3_{i} = r2_{i} > 100.0f || b1_{i};
switch (n2_{i} % 3) {{
case 0: m_{i} = 1; break;
case 1: m_{i} = 2; break;
default: m_{i} = 3;
}}
tab_{i}[m_{i}] = n2_{i};
n3_{i} = tab_{i}[1] + tab_{i}[2] - tab_{i}[3];
ton(&t_{i}, b3_{i}, 1000000);
b4_{i} = t_{i}.q != b2_{i};
n4_{i} = n3_{i} < 5000 ? n3_{i} : 5000;
b0_{i} = !b4_{i};
total = total + n4_{i};
"""
C_HEAD = """#include <inttypes.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
struct ton { bool q, running; int64_t start, et; };
static int64_t uptime;
static void ton(struct ton *t, bool in, int64_t pt)
{
  if (!in) { t->running = false; t->start = 0; t->et = 0; }
  else if (!t->running) { t->running = true; t->start = uptime; t->et = 0; }
  else t->et = uptime - t->start < pt ? uptime - t->start : pt;
  t->q = in && t->et >= pt;
}
static volatile bool s1, s2;
static volatile float x;
static int32_t total;
"""
C_MAIN = """
static int64_t cpu_ns(void)
{
  struct timespec now;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return now.tv_sec * INT64_C(1000000000) + now.tv_nsec;
}
int main(int argc, char **argv)
{
  int64_t begun = cpu_ns();
  for (int64_t n = 0; n < atol(argv[argc - 1]); n++) {
    uptime = n * 10000; s1 = n / 4 % 2; s2 = n / 5 % 2; x = (float)(n * 7 % 100);
    scan();
  }
  printf("%" PRId64 " 0 %.9g %" PRId32 "\\n", cpu_ns() - begun, (double)r2_0, total);
}
"""
PYTHON_PART = """self.b1_{i} = s1 and not s2 or self.b0_{i}
self.b2_{i} = self.b1_{i} and self.n1_{i} > 100
self.n1_{i} = self.n1_{i} + 1
if self.n1_{i} > 1000:
  self.n1_{i} = 0
self.n2_{i} = (self.n1_{i} * 3 + 7) // 2
self.r1_{i} = self.r1_{i} + (x - self.r1_{i}) * 0.125
self.r2_{i} = self.r1_{i} * 1.8 + 32.0
self.b3_{i} = self.r2_{i} > 100.0 or self.b1_{i}
rest = self.n2_{i} % 3
if rest == 0:
  self.m_{i} = 1
elif rest == 1:
  self.m_{i} = 2
else:
  self.m_{i} = 3
self.tab_{i}[self.m_{i}] = self.n2_{i}
self.n3_{i} = self.tab_{i}[1] + self.tab_{i}[2] - self.tab_{i}[3]
self.t_{i}(self.uptime, self.b3_{i}, 1000000)
self.b4_{i} = self.t_{i}.q != self.b2_{i}
self.n4_{i} = min(self.n3_{i}, 5000)
self.b0_{i} = not self.b4_{i}
self.total = self.total + self.n4_{i}
"""
BOOLS, INTEGERS, NUMBERS = ("b0", "b1", "b2", "b3", "b4"), ("n1", "n2", "n3", "n4", "m"), ("r1", "r2")
# A program that measures when its own scans begin.
PERIOD_MS, JITTER_S = 10, 20.0
JITTER = """PROGRAM jitter
VAR_EXTERNAL longest, shortest : REAL; scans, late1, late5 : DINT; END_VAR
VAR apart : REAL; seen : DINT; END_VAR
seen := seen + 1;
apart := LREAL_TO_REAL(DINT_TO_LREAL(LINT_TO_DINT(TIME_TO_LINT(SCAN_TIME() * 1000))) / 1000.0);
IF seen = 50 THEN (* all has started *)
  longest := 10.0; shortest := 10.0;
ELSIF seen > 50 THEN
  scans := scans + 1;
  longest := MAX(longest, apart); shortest := MIN(shortest, apart);
  IF apart > 11.0 THEN late1 := late1 + 1; END_IF;
  IF apart > 15.0 THEN late5 := late5 + 1; END_IF;
END_IF;
END_PROGRAM
"""


class BenchError(Exception):
    """Something did not work."""


@dataclass(frozen=True)
class Amounts:
    turns: int
    scans: int  # of the machine and of C; Python has a tenth
    seconds: float  # beside the lines


FULL, QUICK = Amounts(7, 20_000, JITTER_S), Amounts(2, 500, 3.0)


# ---- the program -----------------------------------------------------------------------------------


def text() -> str:
    def all_of(names: tuple[str, ...]) -> str:
        return ", ".join(f"{name}_{i}" for i in range(PARTS) for name in names)

    return (
        "PROGRAM statements VAR_EXTERNAL s1, s2 : BOOL; x, last : REAL; sum : DINT; END_VAR\n"
        f"VAR {all_of(BOOLS)} : BOOL; {all_of(INTEGERS)}, total : DINT; {all_of(NUMBERS)} : REAL;\n"
        f"{all_of(('tab',))} : ARRAY[1..3] OF DINT; {all_of(('t',))} : TON; END_VAR\n"
        f"total := 0;\n{''.join(PART.format(i=i) for i in range(PARTS))}"
        "last := r2_0; sum := total;\nEND_PROGRAM\n"
    )


def compiled(source: str) -> bytes:
    findings = Findings()
    program = compile_text(source, findings)
    if findings.failed:
        raise BenchError(str(findings.sorted()[0]))
    return encode(program)


def c_text() -> str:
    declared = "".join(
        "".join(f"static bool {name}_{i};\n" for name in BOOLS)
        + "".join(f"static int32_t {name}_{i};\n" for name in INTEGERS)
        + "".join(f"static float {name}_{i};\n" for name in NUMBERS)
        + f"static int32_t tab_{i}[4];\nstatic struct ton t_{i};\n"
        for i in range(PARTS)
    )
    parts = "".join(C_PART.format(i=i) for i in range(PARTS))
    # The compiler must not make one loop of it, nor leave out what nobody reads.
    return (
        f"{C_HEAD}{declared}__attribute__((noinline)) static void scan(void)\n"
        f"{{\ntotal = 0;\n{parts}}}\n{C_MAIN}"
    )


class Ton:
    def __init__(self) -> None:
        self.q, self.running, self.start, self.et = False, False, 0, 0

    def __call__(self, uptime: int, on: bool, pt: int) -> None:
        if not on:
            self.running, self.start, self.et = False, 0, 0
        elif not self.running:
            self.running, self.start, self.et = True, uptime, 0
        else:
            self.et = min(uptime - self.start, pt)
        self.q = on and self.et >= pt


def python_scan() -> Callable[[Any, bool, bool, float], None]:
    body = "".join(PYTHON_PART.format(i=i) for i in range(PARTS)).replace("\n", "\n ")
    found: dict[str, Any] = {}
    exec(f"def scan(self, s1, s2, x):\n self.total = 0\n {body}", found)
    return found["scan"]


class State:
    def __init__(self) -> None:
        self.uptime = self.total = 0
        for i in range(PARTS):
            vars(self).update({f"{name}_{i}": False for name in BOOLS})
            vars(self).update({f"{name}_{i}": 0 for name in INTEGERS})
            vars(self).update({f"{name}_{i}": 0.0 for name in NUMBERS})
            vars(self).update({f"tab_{i}": [0, 0, 0, 0], f"t_{i}": Ton()})


# ---- what a scan costs ----------------------------------------------------------------------------


@dataclass(frozen=True)
class Run:
    cost: float  # nanoseconds of CPU, or instructions, of all scans
    memory: int
    number: float
    total: int


COMPILERS = {"native": NATIVE, "arm": ARM}


def built(directory: Path, machines: Sequence[str] = tuple(COMPILERS)) -> dict[str, Path]:
    """Both programs, for each machine."""
    (directory / "statements.rtul").write_bytes(compiled(text()))
    (directory / "plain.c").write_text(c_text())
    programs = {}
    for name in machines:
        for what, sources in (("machine", [AS_BUILT, DRIVER, *MACHINE]), ("plain", [directory / "plain.c"])):
            programs[f"{what} {name}"] = directory / f"{what}-{name}"
            command = [*COMPILERS[name], *OPTIONS, *sources, "-o", programs[f"{what} {name}"]]
            subprocess.run(command, check=True)
    return programs


def words_of(program: Path, scans: int) -> list[str]:
    return [str(program), str(program.parent / "statements.rtul"), str(scans)]


def run_of(words: list[str], output: str, cost: float | None = None) -> Run:
    ns, memory, number, total = output.split()
    return Run(float(ns) if cost is None else cost, int(memory), float(number), int(total))


def timed(program: Path, scans: int) -> Run:
    words = words_of(program, scans)
    return run_of(words, subprocess.run(words, capture_output=True, text=True, check=True).stdout)


def counted(program: Path, scans: int) -> Run:
    """The instructions of all of it, from the first one of the process."""
    with tempfile.TemporaryFile("w+") as output:
        words = words_of(program, scans)
        with subprocess.Popen([*COUNTING, *words], stdout=output, stderr=subprocess.PIPE) as process:
            assert process.stderr is not None
            count = sum(block.count(b"\n") for block in iter(lambda: process.stderr.read(1 << 20), b""))
        if process.returncode != 0:
            raise BenchError(f"{' '.join(COUNTING)} ended with {process.returncode}")
        output.seek(0)
        return run_of(words, output.read(), count)


def instructions(program: Path, scans: int = 2) -> float:
    """Of a scan, without the start of the process and the verification of the program."""
    return (counted(program, 2 * scans).cost - counted(program, scans).cost) / scans


def in_python(scans: int) -> Run:
    state, scan = State(), python_scan()
    begun_ns = time.process_time_ns()
    for n in range(scans):
        state.uptime = n * 10_000
        scan(state, bool(n // 4 % 2), bool(n // 5 % 2), float(n * 7 % 100))
    return Run(time.process_time_ns() - begun_ns, 0, state.r2_0, state.total)


def agree(runs: list[Run]) -> None:
    first = runs[0]
    for run in runs[1:]:
        if run.total != first.total or abs(run.number - first.number) > 1e-3:
            raise BenchError(f"the programs are not the same: {first} and {run}")


# ---- jitter ------------------------------------------------------------------------------------------


def scanned(gateway: Gateway) -> int:
    return int(gateway.points("scans")["scans"]["value"] or 0)


def jitter(seconds: float, busy: bool) -> dict[str, float]:
    """What a program with a scan each 10 ms has seen of its own scans."""
    directory = run_directory()
    try:
        program = directory / "jitter.rtul"
        program.write_bytes(compiled(JITTER))
        names = ("longest", "shortest", "scans", "late1", "late5")
        points = [
            {"name": name, "ioa": ioa, "type": "float" if name.endswith("est") else "integer"}
            for ioa, name in enumerate(names, 1)
        ]
        own = {
            "name": "jitter",
            "program": str(program),
            "period_ms": PERIOD_MS,
            "ca": 7000,
            "points": points,
        }
        config = lines.configuration(lines.alike(115200))
        config |= {} if busy else {"port": []}
        with (
            lines.devices(lines.alike(115200), directory),
            Gateway(config | {"logic": [own]}, directory) as gateway,
        ):
            gateway.wait_for(lambda: scanned(gateway) > 0, 60.0, "the program scans")
            wanted = seconds * 1000 / PERIOD_MS
            gateway.wait_for(lambda: scanned(gateway) >= wanted, 20 * seconds, f"{wanted:.0f} scans are done")
            found = gateway.points()
            return {name: float(found[name]["value"] or 0) for name in names}
    finally:
        remove(directory)


# ---- rows ------------------------------------------------------------------------------------------


def cpu_rows(programs: dict[str, Path], amounts: Amounts) -> Iterator[tuple[str, list[str]]]:
    scans = amounts.scans
    agree([timed(programs["machine native"], 300), timed(programs["plain native"], 300), in_python(300)])
    turns = [
        (
            timed(programs["machine native"], scans).cost / scans / 1000,
            timed(programs["plain native"], scans).cost / scans / 1000,
            in_python(scans // 10).cost / (scans // 10) / 1000,
        )
        for _ in range(amounts.turns)
    ]
    spreads = [Spread("µs", list(values)) for values in zip(*turns, strict=True)]
    ours, plain, python = (spread.middle for spread in spreads)
    ratios = [f"{ours / plain:.1f}", f"1/{python / ours:.0f}"]
    yield "CPU of a scan, this machine", [*map(str, spreads), *ratios]
    machine_, plain_ = (instructions(programs[f"{what} arm"]) for what in ("machine", "plain"))
    yield (
        "instructions of a scan, ARMv5, soft float",
        [f"{machine_:.0f}", f"{plain_:.0f}", "", f"{machine_ / plain_:.1f}", ""],
    )
    share = [f"{cpi * machine_ / 300_000:.2f} ms" for cpi in (1, 2)]
    yield "the same at 300 MHz, with 1 and 2 cycles each", [" to ".join(share), "", "", "", ""]
    memory = timed(programs["machine native"], 1).memory
    yield "memory of the program, with its file", [f"{memory / 1024:.1f} KiB", "", "", "", ""]


def jitter_rows(amounts: Amounts) -> Iterator[tuple[str, list[str]]]:
    for what, busy in (("no line", False), ("six lines at 115200 bit/s", True)):
        seen = jitter(amounts.seconds, busy)
        yield (
            f"a scan each 10 ms, beside {what}",
            [
                f"{seen['shortest']:.2f} to {seen['longest']:.2f} ms apart; of {seen['scans']:.0f}, "
                f"{seen['late1']:.0f} more than 1 ms late, {seen['late5']:.0f} more than 5 ms"
            ]
            + [""] * 4,
        )


def main() -> int:
    parser = argparse.ArgumentParser(description="Measures a scan of 1 000 statements.")
    parser.add_argument("--quick", action="store_true", help="a try of some thirty seconds")
    amounts = QUICK if parser.parse_args().quick else FULL
    rtud = default_build() / "rtud" / "rtud"
    if not rtud.exists():
        print(f"not built: {rtud}; type `make bench`, which builds it", file=sys.stderr)
        return 2
    head = f"{machine()}. Median (minimum..maximum) of {amounts.turns} turns of {amounts.scans} scans."
    try:
        with tempfile.TemporaryDirectory() as directory:
            found = [*cpu_rows(built(Path(directory)), amounts), *jitter_rows(amounts)]
    except (BenchError, GatewayError, OSError, subprocess.CalledProcessError) as error:
        print(f"the bench ended early: {error}", file=sys.stderr)
        return 1
    print(f"\n{head}\n\n| 1 000 statements | rtu-logic | C | Python | / C | / Python |\n{'|---' * 6}|")
    for what, cells in found:
        print(f"| {what} | {' | '.join(cells)} |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
