# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line of `openrtu logic`. Exit codes: 0 done, 1 found mistakes or a test failed, 2 unusable."""

from __future__ import annotations

import argparse
import csv
import json
import shlex
import sys
from dataclasses import asdict
from pathlib import Path

from openrtu_tools.logic import grammar
from openrtu_tools.logic.binary import Program, encode
from openrtu_tools.logic.compile import compile_text
from openrtu_tools.logic.desk import Desk
from openrtu_tools.logic.errors import Findings, LogicError
from openrtu_tools.logic.filters import BANDS, KINDS, Design, block
from openrtu_tools.logic.plot import svg
from openrtu_tools.logic.recorded import MAGIC, Recording, read_journal, read_vcd, vcd
from openrtu_tools.logic.table import US, Step, compared, read_table, steps
from openrtu_tools.logic.watch import View, watch

DONE, FOUND = 0, 1
DUMP = ".vcd"


def run(parsed: argparse.Namespace) -> int:
    try:
        return parsed.act(parsed)
    except UnicodeDecodeError as error:
        raise LogicError(f"{parsed.file}: this is not UTF-8 text") from error
    except RecursionError as error:
        raise LogicError(f"{parsed.file}: expressions or statements are nested too deep") from error


def add_arguments(parser: argparse.ArgumentParser) -> None:
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    def add(name: str, does: str) -> argparse.ArgumentParser:
        command = commands.add_parser(name, help=does, description=f"{does[0].upper()}{does[1:]}.")
        command.add_argument("file", type=Path, metavar="FILE", help="the program's text, .st")
        command.add_argument("--json", action="store_true", help="print JSON")
        return command

    add("check", "report all mistakes and warnings").set_defaults(act=_check)
    command = add("compile", "write the program for the virtual machine")
    command.add_argument("-o", "--output", type=Path, help="default: FILE with .rtul")
    command.set_defaults(act=_compile)
    command = add("run", "run on the desk: a table of inputs over virtual time")
    command.add_argument(
        "inputs", type=Path, metavar="INPUTS", help="a table, a dump (.vcd), or a gateway's journal"
    )
    command.add_argument(
        "-o", "--output", type=Path, help="the outputs' table, or dump (.vcd) (default: standard output)"
    )
    command.add_argument(
        "--points", type=Path, metavar="FILE", help="of a journal: what `rtuctl --json points` prints"
    )
    _add_name(command)
    command.add_argument("--plot", type=Path, metavar="SVG", help="draw inputs and outputs")
    _add_period(command)
    command.set_defaults(act=_run)
    command = add("test", "run the tests beside the program: NAME.test.csv, NAME.*.test.csv")
    _add_period(command)
    command.set_defaults(act=_test)
    command = add("watch", "show the text of a running program with its values beside it")
    command.add_argument("--once", action="store_true", help="print it once, instead of each second")
    command.add_argument(
        "--rtuctl",
        type=shlex.split,
        default=["rtuctl"],
        metavar="COMMAND",
        help="how to reach the gateway's rtuctl, as 'ssh gateway rtuctl' [rtuctl]",
    )
    _add_name(command)
    command.add_argument(
        "--program", metavar="NAME", help="its name in the configuration [that of FILE, without .st]"
    )
    command.add_argument(
        "--instance",
        default="",
        metavar="PATH",
        help="which instance to show in the text of a function block, as motor.start [the first one]",
    )
    command.set_defaults(act=_watch)
    _add_filter(commands)
    command = commands.add_parser(
        "editor",
        help="write an extension that colours Structured Text in an editor",
        description="Write an extension with a TextMate grammar, as Visual Studio Code loads it.",
    )
    command.add_argument(
        "directory", type=Path, metavar="DIRECTORY", help="as ~/.vscode/extensions/openrtu-st"
    )
    command.set_defaults(act=_editor)


def _add_name(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--name",
        type=_alias,
        action="append",
        default=[],
        metavar="NAME=POINT",
        help="what the configuration's key names says of a name of the program; may be repeated",
    )


def _add_filter(commands: argparse._SubParsersAction) -> None:
    command = commands.add_parser(
        "filter",
        help="print a digital filter as a function block",
        description="Print a digital filter as a FUNCTION_BLOCK with IN and OUT, of second-order sections.",
    )
    command.add_argument("kind", choices=tuple(KINDS))
    command.add_argument(
        "band", choices=tuple(BANDS), help="what passes (low, high, pass), or what does not (stop)"
    )
    command.add_argument("--edges", required=True, metavar="HZ[,HZ]", help="where the band ends, in Hz")
    command.add_argument("--order", type=int, default=2, choices=range(1, 9), metavar="N", help="1 to 8 [2]")
    command.add_argument(
        "--ripple", type=float, default=1.0, metavar="DB", help="in the band that passes [1]"
    )
    command.add_argument(
        "--attenuation", type=float, default=40.0, metavar="DB", help="elliptic: of what does not pass [40]"
    )
    command.add_argument("--name", default="FILTER", help="of the block [FILTER]")
    _add_period(command)
    command.set_defaults(act=_filter)


def _add_period(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--period", type=_milliseconds, default=100, metavar="MS", help="a scan each MS ms (default: 100)"
    )


def _milliseconds(text: str) -> int:
    if not text.isdecimal() or not 1 <= int(text) <= 3_600_000:
        raise argparse.ArgumentTypeError(f"{text} is not a number of milliseconds from 1 to 3600000")
    return int(text)


def _alias(text: str) -> tuple[str, str]:
    name, equals, point = text.partition("=")
    if not (name and equals and point):
        raise argparse.ArgumentTypeError(f"{text} is not NAME=POINT, as earthed=bay1.earthed")
    return name, point


def _compiled(parsed: argparse.Namespace) -> Program | None:
    """The program, after its findings are printed; None if it has mistakes."""
    findings = Findings()
    program = compile_text(parsed.file.read_text(encoding="utf-8"), findings)
    if parsed.json and (findings.failed or parsed.act is _check):
        shown = {"file": str(parsed.file), "findings": [asdict(one) for one in findings.sorted()]}
        print(json.dumps(shown, indent=2))
    elif not parsed.json:
        for finding in findings.sorted():
            print(finding.shown(str(parsed.file)), file=sys.stderr)
    return None if findings.failed else program


def _filter(parsed: argparse.Namespace) -> int:
    try:
        edges = tuple(float(one) for one in parsed.edges.split(","))
    except ValueError:
        raise LogicError(f"--edges {parsed.edges} are no frequencies: --edges 1.5, or --edges 1,2") from None
    design = Design(
        parsed.kind, parsed.band, parsed.order, edges, parsed.period, parsed.ripple, parsed.attenuation
    )
    print(block(design, parsed.name), end="")
    return DONE


def _check(parsed: argparse.Namespace) -> int:
    program = _compiled(parsed)
    if program is not None:
        encode(program)
    return FOUND if program is None else DONE


def _compile(parsed: argparse.Namespace) -> int:
    program = _compiled(parsed)
    if program is None:
        return FOUND
    octets = encode(program)
    output = parsed.output or parsed.file.with_suffix(".rtul")
    output.write_bytes(octets)
    facts = {
        "output": str(output),
        "octets": len(octets),
        "instructions": len(program.instructions),
        "variables": len(program.slots),
        "reads": [point.name for point in program.points if not point.written],
        "writes": [point.name for point in program.points if point.written],
    }
    if parsed.json:
        print(json.dumps(facts, indent=2))
    else:
        print(f"{output}: {facts['octets']} octets, {facts['instructions']} instructions")
    return DONE


def _run(parsed: argparse.Namespace) -> int:
    program = _compiled(parsed)
    if program is None:
        return FOUND
    recording = _inputs(parsed, program)
    with Desk(program) as desk:
        done = list(steps(desk, recording.rows, parsed.period * 1000, recording.start_us))
    names = [point.name for point in desk.outputs]
    if parsed.plot:
        parsed.plot.write_text(_picture(desk, done), encoding="utf-8")
    if parsed.json:
        print(json.dumps([_record(step) for step in done]))
    elif parsed.output and parsed.output.suffix == DUMP:
        outputs = [(point.name, point.type) for point in desk.outputs]
        lines = vcd(outputs, ((step.time_us, step.scan.outputs) for step in done))
        parsed.output.write_text("\n".join([*lines, ""]), encoding="utf-8")
    else:
        file = parsed.output.open("w", newline="", encoding="utf-8") if parsed.output else sys.stdout
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["time", *names])
        for step in done:
            writer.writerow([f"{step.time_us / US:g}", *(step.scan.outputs[name].shown() for name in names)])
        if parsed.output:
            file.close()
    for step in done:
        for line, text in step.scan.messages:
            print(f"{parsed.file}:{line}: at {step.time_us / US:g} s: {text}", file=sys.stderr)
    _report_faults(parsed, done[-1])
    return DONE


def _inputs(parsed: argparse.Namespace, program: Program) -> Recording:
    if parsed.inputs.suffix == DUMP:
        return read_vcd(parsed.inputs, program)
    with parsed.inputs.open("rb") as file:
        if file.read(len(MAGIC)) == MAGIC:
            return read_journal(parsed.inputs, program, parsed.points, dict(parsed.name))
    if parsed.points:
        raise LogicError(f"--points is for a journal, but {parsed.inputs} is none")
    return Recording(read_table(parsed.inputs, program))


def _watch(parsed: argparse.Namespace) -> int:
    if parsed.json:
        raise LogicError("watch prints no JSON, but `rtuctl --json points` does")
    if not parsed.rtuctl:
        raise LogicError("--rtuctl is empty: it is a command, as 'ssh gateway rtuctl'")
    program = _compiled(parsed)
    if program is None:
        return FOUND
    view = View(
        parsed.file.read_text(encoding="utf-8"),
        program,
        parsed.rtuctl,
        parsed.program or parsed.file.stem,
        dict(parsed.name),
        parsed.instance,
    )
    watch(view, parsed.once)
    return DONE


def _editor(parsed: argparse.Namespace) -> int:
    for file in grammar.write(parsed.directory):
        print(file)
    return DONE


def _picture(desk: Desk, done: list[Step]) -> str:
    inputs = [p.name for p in desk.inputs if all(p.name in step.inputs for step in done)]
    traces = {name: [step.inputs[name] for step in done] for name in inputs}
    traces |= {point.name: [step.scan.outputs[point.name] for step in done] for point in desk.outputs}
    return svg([step.time_us / US for step in done], traces)


def _record(step: Step) -> dict[str, object]:
    return {
        "time": step.time_us / US,
        "outputs": {name: {"value": v.value, "quality": v.quality} for name, v in step.scan.outputs.items()},
    }


def _report_faults(parsed: argparse.Namespace, last: Step) -> None:
    total = sum(last.scan.faults)
    if total:
        print(
            f"{parsed.file}:{last.scan.last_line}: {total} faults; the last one: {last.scan.last_fault}",
            file=sys.stderr,
        )


def _test(parsed: argparse.Namespace) -> int:
    program = _compiled(parsed)
    if program is None:
        return FOUND
    stem = parsed.file.stem
    tables = sorted(
        [*parsed.file.parent.glob(f"{stem}.test.csv"), *parsed.file.parent.glob(f"{stem}.*.test.csv")]
    )
    if not tables:
        raise LogicError(f"{parsed.file} has no tests; write {stem}.test.csv beside it")
    failures, checks, covered = [], 0, [0] * len(program.instructions)
    for table in tables:
        rows = read_table(table, program)
        with Desk(program) as desk:
            for step in steps(desk, rows, parsed.period * 1000):
                for name, expected, found in compared(step):
                    checks += 1
                    if expected != found:
                        where = f"{table}:{step.row.line}: {name} at {step.time_us / US:g} s"
                        failures.append(f"{where}: expected {expected}, found {found}")
            covered = [old | new for old, new in zip(covered, desk.coverage(), strict=True)]
    lines, branches = _coverage(program, covered)
    result = {"checks": checks, "failures": failures, "lines": lines, "branches": branches}
    if parsed.json:
        print(json.dumps(result, indent=2))
    else:
        for failure in failures:
            print(failure)
        print(f"{checks} checks, {len(failures)} failed; lines {_share(lines)}, branches {_share(branches)}")
        if lines["missed"] or branches["missed"]:
            missed = sorted({*lines["missed"], *branches["missed"]})
            print(f"not covered: line {', '.join(map(str, missed))}")
    return FOUND if failures else DONE


def _coverage(program: Program, covered: list[int]) -> tuple[dict, dict]:
    """Of the program's own lines, and of its conditions both ways."""
    ran: dict[int, bool] = {}
    ways: list[tuple[int, bool]] = []
    library = {id(one) for routine in program.routines if routine.library for one in routine.code}
    for instruction, seen in zip(program.instructions, covered, strict=True):
        if id(instruction) in library:
            continue
        if instruction.operation not in ("CLEAN", "SPREAD", "RETURN"):
            ran[instruction.line] = ran.get(instruction.line, False) or bool(seen & 1)
        if instruction.operation in ("IF", "ELSIF"):
            ways += [(instruction.line, bool(seen & 2)), (instruction.line, bool(seen & 4))]
    return (
        {
            "all": len(ran),
            "covered": sum(ran.values()),
            "missed": [line for line, was in ran.items() if not was],
        },
        {
            "all": len(ways),
            "covered": sum(was for _, was in ways),
            "missed": sorted({line for line, was in ways if not was}),
        },
    )


def _share(part: dict) -> str:
    return f"{part['covered']} of {part['all']}"
