# SPDX-License-Identifier: GPL-3.0-or-later
"""The numbers that C shares with Python, JavaScript, the MIB and docs/centre.md: C's are the source.

codes.py [--check] [TREE]: writes what is made from them into the tree, and names each file that changed.
With --check it writes nothing, and ends with 1 if a file is not as it would be made.
"""

from __future__ import annotations

import argparse
import ast
import json
import re
import sys
import textwrap
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

SRC = "package/openrtu/src/"
CODES, RECORDS, ASDU = SRC + "map/codes.h", SRC + "centre/records.h", SRC + "iec104/asdu.h"
INFORMATION, SESSION = SRC + "iec104/information.h", SRC + "iec104/session.h"
MADE = "Made by `make codes` from the headers of C; do not edit."

ROW = re.compile(r'ROW\((\w+), (?:(\w+), )?"([^"]*)"(?:, "([^"]*)")?')
WHY = re.compile(r"/\* (.*?) \*/")
ENUMERATOR = re.compile(r"(\w+)(?: = ([^,/]+))?,? *(?:/\* (.*?) \*/)?")
MIB_WORDS = {
    "timeout": "timeOut",
    "float": "shortFloat",
    "clock": "clockSet",
}  # by the word that its name would give
MIB_WIDTH, MIB_INDENT = 72, 20
BCR_BITS = {"carry": 0x04, "adjusted": 0x02}  # of a counter's reading: RtuQuality has them, too


@dataclass(frozen=True)
class Code:
    name: str  # without what all of its table begin with
    number: int
    words: str = ""
    why: str = ""
    letters: str = ""  # of a quality, as the standard has them


Table = list[Code]
POSITION = Code("POSITION", 100)  # the centre's own content: a record of that kind


class Tree:
    """Reads C, and writes what is made from it."""

    def __init__(self, root: Path) -> None:
        self.root = root

    def read(self, path: str) -> str:
        return (self.root / path).read_text(encoding="utf-8")

    def has(self, path: str, text: str) -> bool:
        file = self.root / path
        return file.exists() and file.read_text(encoding="utf-8") == text

    def write(self, path: str, text: str) -> None:
        (self.root / path).write_text(text, encoding="utf-8")

    def rows(self, macro: str, prefix: str = "MAP_") -> Table:
        """Of codes.h; a row without a number has that of its place."""
        begin = self.read(CODES).split(f"#define {macro}(ROW)")[1].split("\n\n")[0]
        table: Table = []
        for part in begin.split("\tROW")[1:]:
            found, why = ROW.match("ROW" + part), WHY.search(part)
            if not found:
                raise SystemExit(f"{CODES}: {macro}: this row is none: {part.strip()}")
            name, number, words, letters = found.groups()
            value = int(number, 0) if number else len(table)
            table.append(Code(name.removeprefix(prefix), value, words, why[1] if why else "", letters))
        return table

    def types(self) -> Table:
        own, standard = self.rows("MAP_OWN_TYPES"), self.rows("MAP_STANDARD_TYPES")
        return [*standard, *(replace(code, number=len(standard) + code.number) for code in own)]

    def enumeration(self, path: str, enum: str, prefix: str) -> Table:
        body = re.search(rf"enum {enum} \{{\n(.*?)\n\}};", self.read(path), re.DOTALL)
        if not body:
            raise SystemExit(f"{path}: no enum {enum}")
        table: Table = []
        for line in body[1].splitlines():
            found = ENUMERATOR.match(line.strip())
            if found:
                name, value, why = found.groups()
                number = _number(value) if value else table[-1].number + 1 if table else 0
                table.append(Code(name.removeprefix(prefix), number, why=why or ""))
        return table

    def constant(self, path: str, name: str) -> Any:
        """What a module of Python gives a name."""
        for node in ast.parse(self.read(path)).body:
            if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == name:
                return ast.literal_eval(node.value)
        raise SystemExit(f"{path}: no {name}")


def _replaced(text: str, pattern: str, made: str, count: int = 1) -> str:
    """What the pattern finds behind its first group is another; 0: as often as it is there."""
    text, found = re.subn(pattern, lambda here: here[1] + made, text, count=count, flags=re.DOTALL)
    if not found:
        raise SystemExit(f"there is no place for {made.splitlines()[0]} …: nothing is like {pattern}")
    return text


def _number(text: str) -> int:
    """8, 0x08 and 1u << 3."""
    base, _, shift = text.replace("u", "").partition("<<")
    return int(base, 0) << int(shift or "0", 0)


# ---- Python --------------------------------------------------------------------------------------


def _shown(code: Code, hexadecimal: bool) -> str:
    return f"0x{code.number:02X}" if hexadecimal else str(code.number)


def _class(name: str, text: str, table: Table, base: str = "IntEnum") -> str:
    lines = [f"class {name}({base}):", f'    """{text}"""', ""]
    for code in table:
        line = f"    {code.name} = {_shown(code, base == 'IntFlag')}"
        lines.append(f"{line}  # {code.why}" if code.why else line)
    return "\n".join(lines) + "\n"


def _constants(text: str, table: Table) -> str:
    return f"# {text}\n" + "".join(f"{code.name} = {_shown(code, True)}\n" for code in table)


def _without_why(table: Table) -> Table:
    return [replace(code, why="") for code in table]


def _letters(tree: Tree) -> str:
    lines = "".join(f'    {code.name}: "{code.letters}",\n' for code in reversed(tree.rows("MAP_QUALITIES")))
    return f"# As IEC 60870-5-101, 7.2.6.3 has them.\nLETTERS = {{\n{lines}}}\n"


def _contents(tree: Tree) -> Table:
    return [*_without_why(tree.enumeration(INFORMATION, "iec104_content", "IEC104_")), POSITION]


def _python(text: str, bases: str, parts: list[str]) -> str:
    head = (
        f'# SPDX-License-Identifier: GPL-3.0-or-later\n"""{text}\n\n{MADE}\n"""\n\nfrom enum import {bases}\n'
    )
    return head + ("\n" if parts[0].startswith("#") else "\n\n") + "\n\n".join(parts)


def library(tree: Tree) -> str:
    """openrtu/codes.py: of a module in Python."""
    qualities = [Code("GOOD", 0), *_without_why(tree.rows("MAP_QUALITIES"))[::-1]]
    return _python(
        "The numbers of a module: qualities, states and results of commands, levels of the log.",
        "IntEnum, IntFlag",
        [
            _class(
                "Quality",
                "What is wrong with a value; the bits of IEC 60870-5-101, 7.2.6.3. 0 is good.",
                qualities,
                "IntFlag",
            ),
            _class("Level", "How bad a line of the log is.", tree.rows("MAP_LOG_LEVELS", "MAP_LOG_")),
            _class("State", "The ten states of a command.", tree.rows("MAP_COMMAND_STATES")),
            _class(
                "Result",
                "Why a command is in its state.",
                tree.rows("MAP_COMMAND_RESULTS", "MAP_RESULT_"),
            ),
        ],
    )


def tools(tree: Tree) -> str:
    """openrtu_tools/codes.py: by the words that people read."""

    def words(text: str, name: str, table: Table, hexadecimal: bool) -> str:
        lines = "".join(f'    "{code.words}": {_shown(code, hexadecimal)},\n' for code in table)
        return f"# {text}\n{name} = {{\n{lines}}}\n"

    qualities = words(
        "A value's qualities, the worst first: bits.", "QUALITIES", tree.rows("MAP_QUALITIES"), True
    )
    types = words("Types of points.", "TYPES", tree.types(), False)
    head = f'# SPDX-License-Identifier: GPL-3.0-or-later\n"""Numbers by their words.\n\n{MADE}\n"""\n'
    return f"{head}\n{qualities}\n{types}"


def centre(tree: Tree) -> str:
    """centre/codes.py: of what rtu-centre says."""

    def enumeration(name: str, text: str, path: str, enum: str, prefix: str) -> str:
        return _class(name, text, _without_why(tree.enumeration(path, enum, prefix)))

    results = tree.rows("MAP_COMMAND_RESULTS", "MAP_RESULT_")
    own = tree.enumeration(RECORDS, "centre_result", "CENTRE_")
    flags = _constants("Flags of a record.", tree.enumeration(RECORDS, "centre_flag", "CENTRE_"))
    asked = _constants("Flags of a command.", tree.enumeration(RECORDS, "centre_request_flag", "CENTRE_"))
    qualities = _constants("What is wrong with a value: bits.", tree.rows("MAP_QUALITIES"))
    return _python(
        "The numbers of what rtu-centre says and is asked: docs/centre.md.",
        "IntEnum",
        [
            f"{flags}\n{asked}\n{qualities}\n{_letters(tree)}",
            enumeration("Kind", "Of a record.", RECORDS, "centre_kind", "CENTRE_"),
            enumeration("Link", "Of a station.", RECORDS, "centre_link", "CENTRE_"),
            _class("State", "The ten states of a command.", tree.rows("MAP_COMMAND_STATES")),
            _class("Result", "Why a command has its state.", _without_why([*results, *own])),
            enumeration("Ask", "What rtu-centre is asked.", RECORDS, "centre_request_kind", "CENTRE_"),
            _class("Content", "Of an object, or a place.", _contents(tree)),
            enumeration("Cause", "Of transmission.", ASDU, "iec104_cause", "IEC104_"),
        ],
    )


# ---- JavaScript ----------------------------------------------------------------------------------


def page(tree: Tree) -> str:
    """centre/page/js/codes.js: the same, and what the centre's own modules say."""
    results = tree.rows("MAP_COMMAND_RESULTS", "MAP_RESULT_")
    tables = {
        "QUALITY": tree.rows("MAP_QUALITIES"),
        "LINK": tree.enumeration(RECORDS, "centre_link", "CENTRE_"),
        "CLOSING": tree.enumeration(SESSION, "iec104_closing", "IEC104_"),
        "CONTENT": _contents(tree),
        "CAUSE": tree.enumeration(ASDU, "iec104_cause", "IEC104_"),
        "STATE": tree.rows("MAP_COMMAND_STATES"),
        "RESULT": [*results, *tree.enumeration(RECORDS, "centre_result", "CENTRE_")],
    }
    constants = {
        "ALARM_KINDS": tree.constant("centre/settings.py", "ALARM_KINDS"),
        "AUDITED": list(tree.constant("centre/api.py", "AUDITED")),
        "ROLES": tree.constant("centre/roles.py", "ROLES"),
        "SCOPES": tree.constant("centre/roles.py", "SCOPES"),
        "EVENT_CAUSES": list(tree.constant("centre/api.py", "CAUSES")),
        "IDS_MOST": tree.constant("centre/api.py", "IDS_MOST"),
        "CHART_ROWS": tree.constant("centre/api.py", "CHART_ROWS"),
        "FRAMES_MOST": tree.constant("centre/trace.py", "FRAMES_MOST"),
        "TOKEN_DAYS_MOST": tree.constant("centre/accounts.py", "TOKEN_DAYS_MOST"),
    }
    lines = [
        "// SPDX-License-Identifier: GPL-3.0-or-later",
        f"// {MADE}",
        "// Of a quality, the worst bit comes first.",
    ]
    for name, table in tables.items():
        lines += [f"export const {name} = {{", *(f"  {code.name}: {code.number}," for code in table), "};"]
    lines.append("// Of the centre's own modules.")
    lines += [f"export const {name} = {json.dumps(value)};" for name, value in constants.items()]
    return "\n".join(lines) + "\n"


# ---- the MIB -------------------------------------------------------------------------------------


def _mib_word(name: str) -> str:
    first, *others = name.lower().split("_")
    word = first + "".join(other.capitalize() for other in others)
    return MIB_WORDS.get(word, word)


def _mib_quality(qualities: Table) -> list[tuple[str, int]]:
    words = {code.number: _mib_word(code.name) for code in qualities}
    words |= {bit: word for word, bit in BCR_BITS.items()}
    return [(words.get(0x80 >> place, "reserved"), place) for place in range(8)]


def mib(tree: Tree) -> str:
    text = tree.read(SRC + "snmp/OPENRTU-MIB.txt")

    def numbered(table: Table) -> list[tuple[str, int]]:
        return [(_mib_word(code.name), code.number + 1) for code in table]

    def own(path: str, enum: str, prefix: str) -> list[tuple[str, int]]:
        return [(_mib_word(code.name), code.number) for code in tree.enumeration(path, enum, prefix)]

    syntaxes = {
        "RtuInformationType": ("INTEGER", numbered(tree.types())),
        "RtuQuality": ("BITS", _mib_quality(tree.rows("MAP_QUALITIES"))),
        "RtuCommandPhase": ("INTEGER", numbered(tree.rows("MAP_COMMAND_STATES"))),
        "RtuCommandReason": ("INTEGER", numbered(tree.rows("MAP_COMMAND_RESULTS", "MAP_RESULT_"))),
        "RtuProcessState": ("INTEGER", numbered(tree.rows("MAP_MODULE_STATES", "MAP_MODULE_"))),
        "rtuEventCause": ("INTEGER", numbered(tree.rows("MAP_CAUSES"))),
        "rtuEventKind": ("INTEGER", own(SRC + "snmp/shared.h", "snmp_event_kind", "SNMP_EVENT_")),
        "rtuCommandProtocol": ("INTEGER", own(SRC + "snmp/agent.h", "snmp_protocol", "SNMP_BY_")),
    }
    for name, (syntax, words) in syntaxes.items():
        listed = ", ".join(f"{word}({number})" for word, number in words)
        wrapped = textwrap.fill(
            f"SYNTAX      {syntax} {{ {listed} }}",
            MIB_WIDTH,
            initial_indent=" " * 4,
            subsequent_indent=" " * MIB_INDENT,
        )
        head = rf"({name} (?:::= TEXTUAL-CONVENTION|OBJECT-TYPE)\n(?:.*?\n)??)"
        text = _replaced(text, rf"{head}    SYNTAX[^}}]*}}", wrapped)
    most = re.search(r"#define MAP_MODULES_MAX +(\d+)", tree.read(SRC + "map/config.h"))
    assert most, "map/config.h says how many modules there are at most"
    return _replaced(text, r"(rtuModuleIndex OBJECT-TYPE\n    SYNTAX      Unsigned32 \(1\.\.)\d+", most[1])


# ---- openrtu.h -----------------------------------------------------------------------------------


def _aligned(lines: list[tuple[str, str]]) -> list[str]:
    """Each with its comment; those of neighbours begin in one column, as clang-format has it."""
    made: list[str] = []
    for number, (line, why) in enumerate(lines):
        run = [line]
        for step in (-1, 1):
            at = number + step
            while 0 <= at < len(lines) and lines[at][1]:
                run.append(lines[at][0])
                at += step
        made.append(f"{line.ljust(max(map(len, run)))} /* {why} */" if why else line)
    return made


def _enum(name: str, table: Table) -> str:
    last = table[-1]
    lines = [(f"\tOPENRTU_{code.name}{'' if code is last else ','}", code.why) for code in table]
    return f"enum {name} {{\n" + "\n".join(_aligned(lines)) + "\n};"


def header(tree: Tree) -> str:
    text = tree.read(SRC + "lib/openrtu.h")
    qualities = [Code("GOOD", 0), *tree.rows("MAP_QUALITIES")[::-1]]
    width = max(len(code.name) for code in qualities)
    lines = [(f"#define OPENRTU_{code.name:{width}} 0x{code.number:02x}u", code.why) for code in qualities]
    defines = "\n".join(_aligned(lines)) + "\n"
    text = _replaced(text, r"()#define OPENRTU_GOOD .*?\n(?=\n)", defines)
    for name, table in {
        "openrtu_state": tree.rows("MAP_COMMAND_STATES"),
        "openrtu_result": tree.rows("MAP_COMMAND_RESULTS", "MAP_RESULT_"),
    }.items():
        text = _replaced(text, rf"()enum {name} \{{\n.*?\n\}};", _enum(name, table))
    return text


# ---- the page ------------------------------------------------------------------------------------


def consumer(tree: Tree) -> str:
    """docs/centre.md: what begins with the first number of a table and its word, and goes on so."""
    text = tree.read("docs/centre.md")
    for table in (
        tree.enumeration(RECORDS, "centre_kind", "CENTRE_"),
        tree.enumeration(RECORDS, "centre_request_kind", "CENTRE_"),
        sorted(tree.rows("MAP_QUALITIES"), key=lambda code: code.number),
    ):
        words = [f"{code.number} {code.name.lower().replace('_', ' ')}" for code in table]
        text = _replaced(text, rf"(: ){words[0]}(?:, \d+ [a-z]+(?: [a-z]+)*)+", ", ".join(words))
    return text


MAKERS: dict[str, Callable[[Tree], str]] = {
    "package/openrtu/python/openrtu/codes.py": library,
    "scripts/openrtu_tools/codes.py": tools,
    "centre/codes.py": centre,
    "centre/page/js/codes.js": page,
    SRC + "snmp/OPENRTU-MIB.txt": mib,
    SRC + "lib/openrtu.h": header,
    "docs/centre.md": consumer,
}


def main() -> int:
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("--check", action="store_true", help="write nothing")
    words.add_argument("tree", nargs="?", default=".", type=Path)
    given = words.parse_args()
    tree = Tree(given.tree)
    old = 0
    for path, maker in MAKERS.items():
        text = maker(tree)
        if not tree.has(path, text):
            old += 1
            print(path)
            if not given.check:
                tree.write(path, text)
    return 1 if given.check and old else 0


if __name__ == "__main__":
    sys.exit(main())
