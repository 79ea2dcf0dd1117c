# SPDX-License-Identifier: GPL-3.0-or-later
"""A gateway's configuration from a list of points: the way back from `rtud --points --csv`.

docs/configuration.md, "The list of points". Needs Python alone, so that it runs where the list was edited.
Exit codes: 0 done, 1 the list has errors, each printed with file and line, 2 an unusable file.
"""

import argparse
import codecs
import csv
import io
import json
import re
import sys
from dataclasses import dataclass, field
from pathlib import Path

from nuc980.errors import UnusableInput
from openrtu_tools import document
from openrtu_tools.document import Json
from openrtu_tools.modbus.made import TABLES

TYPES = {
    "M_SP_NA_1": {"type": "single"},
    "M_DP_NA_1": {"type": "double"},
    "M_ST_NA_1": {"type": "step"},
    "M_BO_NA_1": {"type": "bitstring"},
    "M_ME_NA_1": {"type": "normalized"},
    "M_ME_NB_1": {"type": "scaled"},
    "M_ME_NC_1": {"type": "float"},
    "M_ME_ND_1": {"type": "normalized", "quality": False},
    "M_IT_NA_1": {"type": "counter"},
}
NEEDED = ("ca", "ioa", "type", "name", "port", "id", "table")
ADDRESSES = ("address", "register")  # either
DERIVED = ("ca", "type", "event_type", "command_type", "direction", "device", "port", "id", "table")
TEXTS = ("register", "name", "unit", "ln", "format", "word_order", "byte_order", "bit_order")
TEXTS += ("blocked_by", "substituted_by", "not_topical_by", "scale_by", "factor_by")
OF_OBJECTS = (*TABLES, "template", "overrides", "name_prefix", "ioa_offset", "ca")
IN_ROWS = (*OF_OBJECTS, "period_ms", "read_back")  # what each point of the list has itself

# What spreadsheets save as "Unicode text" and "CSV UTF-8"; the longer mark first.
MARKS = {codecs.BOM_UTF8: "utf-8-sig", codecs.BOM_UTF16_LE: "utf-16", codecs.BOM_UTF16_BE: "utf-16"}
DELIMITERS = {",": "commas", ";": "semicolons", "\t": "tabs"}
DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+([eE][+-]?\d+)?")
REGISTER_DIGITS = 5  # of "00001", whose noughts a spreadsheet drops


class PointsError(UnusableInput):
    """A file that is not what it should be; its text says why, and where."""


@dataclass
class Slaves:
    """The slaves of a configuration, by port and id, and what is wrong with the points for them."""

    config: Json
    source: Path
    decimal_comma: bool = False
    errors: list[str] = field(default_factory=list)
    missing: set[int] = field(default_factory=set)

    def error(self, line: int, message: str) -> None:
        self.errors.append(f"{self.source}:{line}: {message}")

    def find(self, port: int, unit: int, device: str, line: int) -> Json | None:
        """The slave, made where there is none; None without such a port."""
        found = next((one for one in self.config["port"] if one.get("value") == port), None)
        if found is None:
            if port not in self.missing:
                self.error(line, f"there is no port {port} in the file of lines")
            self.missing.add(port)
            return None
        slaves: list[Json] = found.setdefault("slaves", [])
        slave = next((one for one in slaves if one.get("id") == unit), None)
        if slave is None:
            slave = {"id": unit, "description": device} if device else {"id": unit}
            slaves.append(slave)
        elif device:
            slave["description"] = device
        return slave

    def add(self, row: dict[str, str], line: int) -> None:
        """Adds the row's point to its slave."""
        if row["table"] not in TABLES:
            self.error(line, f'table: "{row["table"]}" is not known, expected one of {", ".join(TABLES)}')
        if row["type"] not in TYPES:
            self.error(line, f'type: "{row["type"]}" is not known, expected one of {", ".join(TYPES)}')
        numbers = {key: self.integer(row, key, line) for key in ("port", "id", "ca")}
        point = self.point(row, line)
        if row["table"] not in TABLES or row["type"] not in TYPES or None in numbers.values():
            return
        slave = self.find(numbers["port"] or 0, numbers["id"] or 0, row.get("device", ""), line)
        if slave is None:
            return
        if slave.setdefault("ca", numbers["ca"]) != numbers["ca"]:
            self.error(line, f"ca: {row['ca']} is not that of the slave's other points, {slave['ca']}")
        slave.setdefault(row["table"], []).append(point)

    def integer(self, row: dict[str, str], key: str, line: int) -> int | None:
        try:
            return int(row[key])
        except ValueError:
            self.error(line, f'{key}: "{row[key]}" is not an integer')
            return None

    def point(self, row: dict[str, str], line: int) -> Json:
        """An object of the configuration, of the cells that are not empty."""
        point: Json = {}
        for key, cell in row.items():
            if key in DERIVED or cell == "":
                continue
            if key == "register":
                point[key] = cell.zfill(REGISTER_DIGITS)
            elif key in TEXTS:
                point[key] = cell
            else:
                self.set_value(point, key, cell, line)
        return point | TYPES.get(row["type"], {})

    def set_value(self, point: Json, key: str, cell: str, line: int) -> None:
        """A number, a truth value or an array, as a spreadsheet writes it."""
        plain = cell.strip()
        if DECIMAL_COMMA.fullmatch(plain):
            if not self.decimal_comma:  # it may be a thousand and more
                self.error(line, f'{key}: "{cell}" has a comma: write the number with a point, or without it')
                return
            plain = plain.replace(",", ".")
        if plain in ("TRUE", "FALSE"):
            plain = plain.lower()
        try:
            point[key] = json.loads(plain)
        except ValueError:
            self.error(line, f'{key}: "{cell}" is not a number, truth value or array')


def read_templates(path: Path, config: Json) -> Json:
    """The templates of a file and of those that it includes, by name."""
    templates: Json = {}
    waiting, read = [(path, config)], set[Path]()
    while waiting:
        source, file = waiting.pop()
        read.add(source.resolve())
        own, includes = file.get("templates", {}), file.get("include", [])
        if not isinstance(own, dict) or not all(isinstance(one, dict) for one in own.values()):
            raise PointsError(f"{source}: templates: is not an object of objects")
        if not isinstance(includes, list) or not all(isinstance(name, str) for name in includes):
            raise PointsError(f"{source}: include: is not an array of names of files")
        templates |= own
        for included in (source.parent / name for name in includes):
            if included.resolve() not in read:
                waiting.append((included, document.read(included)))
    return templates


def read_lines(path: Path) -> Json:
    """The configuration that says what the lines are, without the objects of its slaves."""
    config = document.read(path)
    if not isinstance(config.get("port"), list):
        raise PointsError(f"{path}: is not a configuration: an object with an array port")
    templates = read_templates(path, config)
    config.pop("include", None)
    config.pop("templates", None)
    for number, port in enumerate(document.objects(config, "port", f"{path}: ")):
        slaves = document.objects(port, "slaves", f"{path}: port[{number}].")
        port["slaves"] = [without_objects(slave, templates) for slave in slaves]
    return config


def without_objects(slave: Json, templates: Json) -> Json:
    """A slave with what its template says of the device, such as the registers that one request may read."""
    template: Json = templates.get(str(slave.get("template", "")), {})
    own = {key: value for key, value in slave.items() if key not in OF_OBJECTS}
    return {key: value for key, value in template.items() if key not in (*IN_ROWS, "id")} | own


def decoded(path: Path, octets: bytes) -> str:
    """The text of a CSV in any of the encodings that spreadsheets save."""
    if octets.startswith(b"PK\x03\x04"):
        raise PointsError(f'{path}: is a workbook: save the sheet as "CSV UTF-8"')
    encoding = next((name for mark, name in MARKS.items() if octets.startswith(mark)), "utf-8")
    try:
        return octets.decode(encoding)
    except UnicodeDecodeError as error:
        if encoding != "utf-8":
            raise PointsError(f'{path}: is cut or damaged: save it again as "CSV UTF-8"') from error
    try:
        return octets.decode("cp1252")
    except UnicodeDecodeError as error:
        line = octets.count(b"\n", 0, error.start) + 1
        raise PointsError(
            f'{path}:{line}: has a character that is neither UTF-8 nor Windows-1252: save it as "CSV UTF-8"'
        ) from error


def read_table(path: Path) -> tuple[str, "csv.DictReader[str]"]:
    """What parts the cells of a CSV, and its rows."""
    try:
        text = decoded(path, path.read_bytes())
    except OSError as error:
        raise PointsError(f"{path}: {error.strerror}") from error
    if "\0" in text:
        raise PointsError(f'{path}: is no text: save it as "CSV UTF-8"')
    head = text.partition("\n")[0]
    delimiter = max(DELIMITERS, key=head.count)
    reader = csv.DictReader(io.StringIO(text, newline=""), delimiter=delimiter)
    columns = [name.strip().lower() for name in reader.fieldnames or []]
    reader.fieldnames = columns
    missing = [key for key in NEEDED if key not in columns]
    if not set(columns) & set(ADDRESSES):
        missing.append(" or ".join(ADDRESSES))
    if missing:
        found = f"its first line has {len(columns)} cells parted by {DELIMITERS[delimiter]}"
        raise PointsError(f"{path}:1: has no column {', '.join(missing)}; {found}")
    return delimiter, reader


def read_points(path: Path, slaves: Slaves) -> None:
    """Adds the points of a CSV."""
    delimiter, reader = read_table(path)
    slaves.decimal_comma = delimiter != ","
    try:
        for row in reader:
            more = row.pop(None, [])  # type: ignore[call-overload]
            if any(more) or None in row.values():
                slaves.error(reader.line_num, "has another number of cells than the first line")
            elif row["port"] != "":  # the gateway's own station has none: own_ca makes it
                slaves.add(row, reader.line_num)
    except csv.Error as error:
        raise PointsError(f"{path}:{reader.line_num + 1}: {error}") from error


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("points", type=Path, help="CSV with the columns of rtud --points --csv")
    parser.add_argument(
        "--lines", type=Path, required=True, help="configuration that says what the lines are"
    )


def run(parsed: argparse.Namespace) -> int:
    slaves = Slaves(read_lines(parsed.lines), parsed.points)
    read_points(parsed.points, slaves)
    if slaves.errors:
        print("\n".join(slaves.errors), file=sys.stderr)
        return 1
    json.dump(slaves.config, sys.stdout, indent=2, ensure_ascii=False)
    print()
    return 0
