# SPDX-License-Identifier: GPL-3.0-or-later
"""`openrtu devices`: the templates of devices that come with OpenRTU: lists, searches and shows them.

docs/toolbox.md. Exit codes: 0 done, 1 no template fits, 2 the templates are not there or unusable.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from nuc980.errors import UnusableInput
from openrtu_tools import document
from openrtu_tools.document import Json
from openrtu_tools.missing import CLONE, in_clone
from openrtu_tools.modbus.made import ADDRESS_LAST, TABLES
from openrtu_tools.modbus.registers import Place
from openrtu_tools.modbus.values import NUMBERS, Layout

INSTALLED = [Path(prefix) / "share/openrtu/templates" for prefix in ("/usr/local", "/usr")]
NAMES_SHOWN = 4
HOLDING = "holding_registers"
SUNSPEC_AT = 40069  # where the files of the models have their IDs
WITHOUT_FORMAT = "float32"  # as wide as all that a model's object without one may be


@dataclass(frozen=True)
class Device:
    """A template, and what its file says about it."""

    name: str
    file: Path
    about: Json
    template: Json

    def objects(self) -> Iterator[tuple[str, Json]]:
        """Each with its table."""
        for table in TABLES:
            for one in document.objects(self.template, table, f"{self.file}: {self.name}."):
                yield table, one

    def count(self) -> int:
        return sum(1 for _ in self.objects())

    def says(self, key: str) -> str:
        return str(self.about.get(key, ""))

    def fits(self, words: Sequence[str]) -> bool:
        """Whether each word is in its name, maker, kind or device."""
        text = " ".join([self.name, *map(self.says, ("maker", "device", "kind"))]).casefold()
        return all(word.casefold() in text for word in words)

    def summary(self) -> Json:
        return {
            "template": self.name,
            "kind": self.says("kind"),
            "maker": self.says("maker"),
            "device": self.says("device"),
            "objects": self.count(),
            "untried": bool(self.about.get("untried", True)),
            "file": str(self.file),
        }


def folder() -> Path:
    """Where the templates are: in the clone, or where the gateway is installed. Raises UnusableInput."""
    if in_clone():
        return CLONE / "package/openrtu/src/templates"
    found = next((path for path in INSTALLED if path.is_dir()), None)
    if found is None:
        raise UnusableInput(
            "the templates come with the gateway: install it, or name their folder (--folder)"
        )
    return found


def read(path: Path) -> list[Device]:
    """All templates of a folder, by kind and name. Raises UnusableInput."""
    found = []
    for file in sorted(path.rglob("*.json")):
        content = document.read(file)
        about = content.get("about")
        templates = content.get("templates", {})
        if not isinstance(templates, dict) or not all(isinstance(one, dict) for one in templates.values()):
            raise UnusableInput(f"{file}: templates: is not an object of objects")
        own = about if isinstance(about, dict) else {"device": about or ""}
        found += [Device(name, file, own, template) for name, template in templates.items()]
    if not found:
        raise UnusableInput(f"{path}: has no templates")
    return sorted(found, key=lambda device: (device.says("kind"), device.name))


# ---- what is printed -------------------------------------------------------------------------------


def table_of(rows: Sequence[Sequence[str]]) -> str:
    """In columns; the last is not padded."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    padded = ([cell.ljust(width) for cell, width in zip(row, widths, strict=True)] for row in rows)
    return "\n".join("  ".join(cells).rstrip() for cells in padded)


def listed(devices: Sequence[Device]) -> str:
    head = ("KIND", "TEMPLATE", "OBJECTS", "MAKER", "DEVICE")
    rows = [
        (device.says("kind"), device.name, str(device.count()), device.says("maker"), device.says("device"))
        for device in devices
    ]
    return table_of([head, *rows])


def value_of(one: Json) -> str:
    """What the registers hold, and what becomes of it."""
    if "bit" in one:
        return f"bit {one['bit']}"
    parts = [str(one.get("format") or one.get("type") or "bit")]
    if "bits" in one:
        parts.append(f"bits {one['bits'][0]} to {one['bits'][1]}")
    parts += [f"{key} {one[key]}" for key in ("word_order", "byte_order") if key in one]
    parts += [f"* {one['scale']:g}"] if "scale" in one else []
    parts += [f"{one['offset']:+g}"] if "offset" in one else []
    parts += [f"* 10^h{one['scale_register']}"] if "scale_register" in one else []
    parts += [f"by {one[key]}" for key in ("scale_by", "factor_by") if key in one]
    return " ".join(parts)


def command_of(one: Json) -> str:
    """What is said of its commands."""
    parts = [f"{one['min']:g} … {one['max']:g}"] if "min" in one else []
    if names := one.get("names"):
        shown = [f"{number} {name}" for number, name in names.items()]
        more = ", …" if len(shown) > NAMES_SHOWN else ""
        parts.append(", ".join(shown[:NAMES_SHOWN]) + more)
    parts += [f"written at {one['write_address']}"] if "write_address" in one else []
    parts += [key.replace("_", " ") for key in ("read_only", "write_only", "select") if one.get(key)]
    parts += [f"written every {one['write_every_ms'] / 1000:g} s"] if "write_every_ms" in one else []
    return "; ".join(parts)


def place_of(table: str, one: Json) -> str:
    return f"{Place(table, 0).letter}{one.get('address', one.get('register', ''))}"


def objects_of(device: Device) -> str:
    rows = [
        (
            place_of(table, one),
            str(one.get("name", "")),
            value_of(one),
            str(one.get("unit", "")),
            command_of(one),
        )
        for table, one in device.objects()
    ]
    return table_of([("ADDRESS", "NAME", "REGISTERS", "UNIT", "VALUES"), *rows])


def sources_of(device: Device) -> Iterator[str]:
    if manual := device.says("manual"):
        yield f"the maker's document, as the sources name it: {manual}"
    for source in device.about.get("sources", []):
        lacks = source.get("lacks", [])
        yield source["what"] + (f" (without {', '.join(lacks)})" if lacks else "")


def use_of(device: Device) -> str:
    """A configuration with it."""
    line: Json = {"value": 1, "active": 1}
    if device.says("connection").startswith("Modbus TCP"):
        line = {"value": 7, "active": 1, "host": "192.0.2.20"}
    else:
        line |= {"baud_rate": 9600, "data_bits": 8, "stop_bits": 1, "parity": 0}
    slave = {"id": 1, "template": device.name, "name_prefix": "device1/"}
    text = json.dumps({"include": [str(device.file)], "port": [line | {"slaves": [slave]}]}, indent=2)
    how = (
        "In a configuration (docs/configuration.md, Templates), with the line's and the device's own numbers:"
    )
    return f"{how}\n{text}"


def shown(device: Device) -> str:
    keys = {key: value for key, value in device.template.items() if key not in TABLES}
    words = [device.says("maker"), device.says("device"), f"({device.says('kind')})"]
    head = [" ".join([f"{device.name}:", *filter(None, words)])]
    head += [f"Connection: {device.says('connection')}"] if device.says("connection") else []
    if device.about.get("untried"):
        head.append("Untried: nobody of OpenRTU has read such a device with it.")
    head += [f"Note: {note}" for note in device.about.get("notes", [])]
    tail = [
        "Keys of the device: " + json.dumps(keys, ensure_ascii=False),
        *(f"Source: {source}" for source in sources_of(device)),
        *(f"Compared: {text}" for text in device.about.get("compared", [])),
    ]
    return "\n\n".join(["\n".join(head), objects_of(device), "\n".join(tail), use_of(device)])


# ---- a device of several models ---------------------------------------------------------------------


def moved(one: Json, by: int, prefix: str) -> Json:
    """An object of a model that stands elsewhere. Objects that others name are of the same model."""
    changed = {key: one[key] + by for key in ("address", "scale_register") if key in one}
    changed["ioa"] = changed["address"] + 1
    names = {key: prefix + one[key] for key in ("name", "scale_by") if key in one}
    return one | changed | names


def last_register(one: Json) -> int:
    """That the object needs."""
    layout = one.get("format", WITHOUT_FORMAT)
    width = Layout(layout).width if layout in NUMBERS else 1
    return max(int(one["address"]) + width - 1, int(one.get("scale_register", 0)))


def sunspec(devices: Sequence[Device], words: Sequence[str]) -> Json:
    """A file with one template, of all models that a device has. Raises UnusableInput."""
    models = {device.about["model"]: device for device in devices if "model" in device.about}
    template: Json = {"description": "SunSpec", "period_ms": 1000, HOLDING: []}
    for word in words:
        number, _, address = word.partition("@")
        if not (number.isdigit() and address.isdigit() and int(address) <= ADDRESS_LAST):
            raise UnusableInput(f"{word}: is no model and its address, as 103@40069")
        if int(number) not in models:
            raise UnusableInput(f"{word}: there is no template of model {number}")
        device = models[int(number)]
        by = int(address) - SUNSPEC_AT
        rows = [moved(one, by, f"m{number}/") for _, one in device.objects()]
        if any(last_register(one) > ADDRESS_LAST for one in rows):
            raise UnusableInput(f"{word}: its registers go beyond address {ADDRESS_LAST}")
        if {one["ioa"] for one in rows} & {one["ioa"] for one in template[HOLDING]}:
            raise UnusableInput(f"{word}: its registers are another model's, too")
        template[HOLDING] += rows
    about = {"device": f"SunSpec models {', '.join(words)}", "untried": True}
    return {"about": about, "templates": {"sunspec-device": template}}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "words",
        nargs="*",
        metavar="WORD",
        help="in the template's name, maker, kind or device; one that fits is shown",
    )
    parser.add_argument("--folder", type=Path, help="where the templates are [those of this OpenRTU]")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument(
        "--sunspec",
        nargs="+",
        metavar="MODEL@ADDRESS",
        help="print a file with one template of these SunSpec models, as 103@40069: where each one's ID is",
    )


def run(parsed: argparse.Namespace) -> int:
    devices = read(parsed.folder or folder())
    if parsed.sunspec:
        print(json.dumps(sunspec(devices, parsed.sunspec), indent=2, ensure_ascii=False))
        return 0
    found: list[Device] = [device for device in devices if [device.name] == parsed.words]
    found = found or [device for device in devices if device.fits(parsed.words)]
    if not found:
        print(
            f"openrtu devices: none of {len(devices)} templates fits {' '.join(parsed.words)}",
            file=sys.stderr,
        )
        return 1
    alone = len(found) == 1
    if parsed.json:
        content: Any = [device.summary() for device in found]
        if alone:
            content[0] |= {"about": found[0].about, "keys": found[0].template}
        print(json.dumps(content, indent=2, ensure_ascii=False))
    else:
        print(shown(found[0]) if alone else listed(found))
    return 0
