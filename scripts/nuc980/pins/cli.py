# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line of nuc980-pins. Exit codes: 0 done, 1 found or different, 2 unusable."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from nuc980 import PIN_TABLE, VERSION
from nuc980.boards import GATEWAY, board_names, pin_table
from nuc980.errors import UnusableInput, printable
from nuc980.pins.board import Board, load_board
from nuc980.pins.checking import Checker
from nuc980.pins.chip import Chip, Package, load_chip
from nuc980.pins.claims import claims
from nuc980.pins.diffing import format_diff, pin_diff
from nuc980.pins.environment import Environment, read_environment
from nuc980.pins.explain import explain
from nuc980.pins.report import FORMATS, Checked
from nuc980.pins.schemas import Schemas
from nuc980.pins.source import read_tree

ROOT = Path(__file__).resolve().parents[3]  # of the tree, for what is generated
DONE, FOUND, UNUSABLE = 0, 1, 2
LINES = "\n\t"  # what a text for a terminal has beside its letters
PART = "NUC980DK61YC"  # whose table is planned or imported, if nobody says another


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs one subcommand; returns the exit code."""
    parsed = _parser().parse_args(arguments)
    try:
        return parsed.run(parsed)
    except UnusableInput as error:
        _tell(error)
    except OSError as error:
        print(f"nuc980-pins: {error.filename}: {error.strerror}", file=sys.stderr)
    return UNUSABLE


def _tell(error: UnusableInput) -> None:
    print(f"nuc980-pins: {printable(str(error), LINES)}", file=sys.stderr)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="nuc980-pins", description="From the pin table of a NUC980 board to a checked device tree."
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s (OpenRTU) {VERSION}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    def add(name: str, does: str) -> argparse.ArgumentParser:
        return commands.add_parser(name, help=does, description=f"{does[0].upper()}{does[1:]}.")

    command = add("generate", "write the files that come from chip data and pin table")
    command.add_argument(
        "--check", action="store_true", help="write nothing; exit 1 when a file is out of date"
    )
    command.set_defaults(run=_generate)

    command = add("check", "check device trees, source or compiled, against chip and pin table")
    command.add_argument("files", nargs="+", type=Path, metavar="FILE", help="a .dts or .dtb file")
    command.add_argument(
        "--overlay",
        action="store_true",
        help="the first FILE is a base, the others are overlays: check each on the base, and all together",
    )
    command.add_argument(
        "--fix", action="store_true", help="show as a diff what has one right answer in a line of the source"
    )
    command.add_argument("--write", action="store_true", help="with --fix: write it into the source")
    command.add_argument("--format", choices=FORMATS, default="text", help="default: text")
    _add_knowledge(command)
    command.set_defaults(run=_check)

    command = add("lsp", "serve an editor: findings while typing, hover, completion (needs pygls)")
    _add_knowledge(command)
    command.set_defaults(run=_lsp)

    command = add("map", "draw the pins: of the pin table, or of a device tree")
    command.add_argument(
        "file", nargs="?", type=Path, metavar="FILE", help="a .dts or .dtb file; default: the pin table"
    )
    command.add_argument(
        "-o", "--output", type=Path, required=True, help="the picture, .svg, or the page, .html"
    )
    command.add_argument(
        "--part", help="for another board: the chip's part number, which tells the package to draw"
    )
    _add_table(command)
    _add_source_options(command)
    command.set_defaults(run=_map)

    command = add("explain", "explain a pin, a signal, a device, a setting or a rule")
    command.add_argument(
        "words",
        nargs="+",
        metavar="WORD",
        help="PA0, UART8_TXD, uart8, '<4 7 1 0>', 'gpio 138', 0xb0000070, pin-conflict, rules",
    )
    _add_table(command)
    command.set_defaults(run=_explain)

    command = add("diff", "show what changes at the pins from one device tree to another")
    command.add_argument("before", type=Path, metavar="A")
    command.add_argument("after", type=Path, metavar="B")
    _add_source_options(command)
    command.set_defaults(run=_diff)

    command = add("plan", "assign functions to pins from wishes, or say which of them cannot be had together")
    command.add_argument(
        "wishes",
        nargs="*",
        metavar="WISH",
        help="'six uart with RTS, two rmii, one can, uart0 on PF11 PF12, 3 gpio'",
    )
    command.add_argument(
        "--wishes",
        dest="file",
        type=Path,
        metavar="FILE",
        help="a file with wishes, one a line; # begins a comment",
    )
    command.add_argument("--part", help=f"the chip's part number (default: {PART})")
    command.add_argument("--keep", type=Path, metavar="TABLE", help="a pin table whose devices and pins stay")
    command.add_argument("-o", "--output", type=Path, help="the pin table; an existing file is kept")
    command.add_argument("--map", type=Path, metavar="PICTURE", help="the picture, .svg, or the page, .html")
    command.set_defaults(run=_plan)

    command = add("import", "write a pin table from an existing device tree")
    command.add_argument("file", type=Path, metavar="FILE", help="a .dts or .dtb file")
    command.add_argument("--part", default=PART, help="the chip's part number (default: %(default)s)")
    command.add_argument(
        "-o", "--output", type=Path, help="default: standard output; an existing file is kept"
    )
    _add_source_options(command)
    command.set_defaults(run=_import)
    return parser


def _add_knowledge(command: argparse.ArgumentParser) -> None:
    """What a tree is held against."""
    command.add_argument(
        "--chip-only", action="store_true", help="for another board's tree: do not use the pin table"
    )
    command.add_argument(
        "--part", help="with --chip-only: the chip's part number, which tells the pins of its package"
    )
    command.add_argument(
        "--command-line",
        default="",
        metavar="TEXT",
        help="the kernel's, beside what the tree has: CONFIG_CMDLINE",
    )
    command.add_argument(
        "--environment",
        type=Path,
        metavar="FILE",
        help="U-Boot's, as printenv prints it: checked with the tree",
    )
    command.add_argument(
        "--schemas",
        type=Path,
        metavar="FILE",
        help="check against the kernel's bindings too, as make schemas makes them",
    )
    _add_table(command)
    _add_source_options(command)


def _add_table(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--board",
        default=GATEWAY,
        metavar="NAME",
        help=f"the board whose pin table counts: {', '.join(board_names())} (default: %(default)s)",
    )
    command.add_argument("--table", type=Path, help="a pin table of your own instead")


def _add_source_options(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "-I",
        dest="include",
        action="append",
        type=Path,
        default=[],
        metavar="FOLDER",
        help="where a source finds its #include files",
    )
    command.add_argument(
        "-D", dest="defines", action="append", default=[], metavar="NAME=VALUE", help="a macro for a source"
    )


def _generate(parsed: argparse.Namespace) -> int:
    # jinja2 takes longer to load than a check to run.
    from nuc980.pins.generate import generated, stale, write

    if PIN_TABLE != ROOT / "board" / "nuc980" / "boards" / "gateway" / "pins.yml":
        raise UnusableInput("generate writes into a clone of OpenRTU: run scripts/nuc980-pins there")
    chip = load_chip()
    files = generated(chip, {name: load_board(pin_table(name), chip) for name in board_names()})
    if not parsed.check:
        for path in write(files, ROOT):
            print(f"{path}: written")
        return DONE
    out_of_date = stale(files, ROOT)
    for path in out_of_date:
        print(f"{path}: differs from chip data and pin table; type: make dtb, or nuc980-pins generate")
    return FOUND if out_of_date else DONE


def _check(parsed: argparse.Namespace) -> int:
    if parsed.write and not parsed.fix:
        raise UnusableInput("--write goes with --fix")
    if parsed.fix and (parsed.overlay or parsed.format != "text"):
        raise UnusableInput("--fix shows a diff: it goes without --overlay and without --format")
    checker = _checker(parsed)
    checked, unusable = [], 0
    if parsed.overlay:
        checked = checker.overlays(parsed.files[0], parsed.files[1:])
    for file in () if parsed.overlay else parsed.files:
        try:
            one = checker.file(file)
            checked.append(_fix(one, checker, parsed.write) if parsed.fix else one)
        except UnusableInput as error:
            unusable += 1
            _tell(error)
    report = FORMATS[parsed.format](checked) if checked else ""
    if report:
        print(report)
    if unusable:
        return UNUSABLE
    return FOUND if any(one.open for one in checked) else DONE


def _checker(parsed: argparse.Namespace) -> Checker:
    chip = load_chip()
    board = None if parsed.chip_only else _board(parsed, chip)
    if parsed.part and board:
        raise UnusableInput("--part goes with --chip-only: a pin table names the part itself")
    package = board.package if board else _package(parsed.part, chip)
    schemas = Schemas(parsed.schemas) if parsed.schemas else None
    return Checker(chip, board, package, _environment(parsed), parsed.include, parsed.defines, schemas)


def _environment(parsed: argparse.Namespace) -> Environment:
    told = read_environment(parsed.environment) if parsed.environment else Environment()
    return replace(told, words=(*told.words, *parsed.command_line.split()))


def _fix(checked: Checked, checker: Checker, write: bool) -> Checked:
    """Shows what --fix makes of a source; if that is written, what is left then is what counts."""
    found = checker.mended(checked)
    print(found.diff(), end="")
    if not write or found.before == found.after:
        return checked
    found.write()
    return checker.file(checked.file)


def _lsp(parsed: argparse.Namespace) -> int:
    try:
        from nuc980.pins.lsp import serve
    except ModuleNotFoundError as error:
        raise UnusableInput(
            f"the Python package {error.name} is missing; type: {sys.executable} -m pip install 'pygls>=2,<3'"
        ) from error
    serve(_checker(parsed))
    return DONE


def _board(parsed: argparse.Namespace, chip: Chip) -> Board:
    return load_board(parsed.table or pin_table(parsed.board), chip)


def _package(part: str | None, chip: Chip) -> Package | None:
    if part is None:
        return None
    if part not in chip.parts:
        raise UnusableInput(f"--part {part}: known parts are {', '.join(chip.parts)}")
    return chip.packages[chip.parts[part]]


def _plan(parsed: argparse.Namespace) -> int:
    from nuc980.pins.planning import plan_board, read_wishes

    chip = load_chip()
    _package(parsed.part, chip)
    if parsed.part and parsed.keep:
        raise UnusableInput("--part goes without --keep: a pin table names the part itself")
    kept = load_board(parsed.keep, chip) if parsed.keep else None
    part = kept.part if kept else parsed.part or PART
    draw = _drawing(parsed.map) if parsed.map else None
    written = _lines_of_wishes(parsed.file) if parsed.file else []
    plan = plan_board(chip, part, read_wishes([*parsed.wishes, *written]), kept)
    if parsed.output:
        _refuse_existing(parsed.output)
    print("\n".join(plan.lines()))
    if draw:
        _write(parsed.map, draw(chip, chip.packages[chip.parts[part]], plan.uses(), "The plan"))
    if parsed.output:
        _write_new(parsed.output, plan.table(parsed.output.parent))
    return DONE


def _lines_of_wishes(file: Path) -> list[str]:
    try:
        lines = file.read_text("utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise UnusableInput(f"{file} is no text in UTF-8 (byte {error.start}); save it as UTF-8") from error
    return [line.partition("#")[0] for line in lines]


def _drawing(file: Path) -> Callable[..., str]:
    """What draws a file of this ending."""
    from nuc980.pins.page import draw_page
    from nuc980.pins.picture import draw_map

    draw = {".svg": draw_map, ".html": draw_page}.get(file.suffix.lower())
    if draw is None:
        raise UnusableInput(f"{file}: the name must end in .svg or .html")
    return draw


def _map(parsed: argparse.Namespace) -> int:
    from nuc980.pins.picture import uses_of_board, uses_of_claims

    draw = _drawing(parsed.output)
    chip = load_chip()
    board = _board(parsed, chip)
    if parsed.file:
        tree = read_tree(parsed.file, parsed.include, parsed.defines)
        uses, title = uses_of_claims(claims(tree, chip), chip), parsed.file.name
    else:
        uses, title = uses_of_board(board), board.name
    package = _package(parsed.part, chip) or board.package
    _write(parsed.output, draw(chip, package, uses, title))
    return DONE


def _explain(parsed: argparse.Namespace) -> int:
    chip = load_chip()
    board = _board(parsed, chip)
    print("\n\n".join("\n".join(explain(word, chip, board)) for word in parsed.words))
    return DONE


def _diff(parsed: argparse.Namespace) -> int:
    chip = load_chip()
    before, after = (
        read_tree(file, parsed.include, parsed.defines) for file in (parsed.before, parsed.after)
    )
    changes = pin_diff(before, after, chip)
    for line in format_diff(changes):
        print(printable(line))
    return FOUND if changes else DONE


def _import(parsed: argparse.Namespace) -> int:
    from nuc980.pins.importing import import_board

    chip = load_chip()
    _package(parsed.part, chip)
    text = import_board(read_tree(parsed.file, parsed.include, parsed.defines), chip, parsed.part)
    if parsed.output is None:
        print(text, end="")
        return DONE
    _write_new(parsed.output, text)
    return DONE


def _write_new(file: Path, text: str) -> None:
    _refuse_existing(file)
    _write(file, text)


def _refuse_existing(file: Path) -> None:
    if file.exists():
        raise UnusableInput(f"{file} exists already and is not overwritten; name another file")


def _write(file: Path, text: str) -> None:
    try:
        file.write_text(text, encoding="utf-8")
    except OSError as error:
        raise UnusableInput(f"{file}: {error.strerror}; name another file") from error
