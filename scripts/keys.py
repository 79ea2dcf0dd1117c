# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes what is made of the rules of configurations: the JSON Schema, which rtud --schema prints, and
from it the tables of docs/configuration.md, and what the tools for Modbus devices share with the gateway; the
tables of docs/centre.md from rtu-centre --schema, those of docs/control-centre.md from centre/settings.py. A
table stands below a comment that names it:

    <!-- keys: slave -->            all keys of this definition of the schema, the outermost object being file
    <!-- keys: tcp_slave.id -->     one of them; several words, one after the other
    <!-- settings: mqtt -->         an object of the control centre's file

With --check it writes nothing, prints what is old, and exits with 1."""

import argparse
import json
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from openrtu_tools.centre import settings

SCHEMA = "package/openrtu/src/rtud/config.schema.json"
PAGES = {"docs/configuration.md": "rtud/rtud", "docs/centre.md": "centre/rtu-centre"}
MADE = "scripts/openrtu_tools/modbus/made.py"
FILE = "file"
CENTRE_PAGE = "docs/control-centre.md"
QUOTES = '"""'
HEAD = "| key | values | default | meaning |\n|---|---|---|---|\n"
TABLE = re.compile(r"(<!-- keys: ([\w. ]+) -->\n\n)(?:\|.*\n)*")
SETTINGS_HEAD = "| key | default | what it says |\n|---|---|---|\n"
SETTINGS = re.compile(r"(<!-- settings: (\w+) -->\n\n)(?:\|.*\n)*")
SHOWN = 6  # values of a choice of numbers
ENDLESS = 3e38  # beyond it a bound is that of a float

Rule = dict[str, Any]


class Keys:
    """A schema, by the names of its definitions."""

    def __init__(self, text: str, page: str) -> None:
        self.schema: Rule = json.loads(text)
        self.page = Path(page).name
        self.anchors: dict[str, str] = {}  # of the definitions that the page has a table of

    def definition(self, name: str) -> Rule:
        return self.schema if name == FILE else self.schema["$defs"][name]

    def resolved(self, rule: Rule) -> Rule:
        """With what it refers to, if that is another key, or a form of texts."""
        reference = rule.get("$ref", "")
        target = self.schema
        for step in reference.removeprefix("#/").split("/"):
            target = target.get(step, {})
        return rule if "properties" in target or not reference else self.resolved(target) | rule

    def cells(self, word: str) -> Iterator[tuple[str, str, str, str]]:
        name, _, only = word.partition(".")
        definition = self.definition(name)
        required = definition.get("required", [])
        for key, rule in sorted(definition["properties"].items(), key=lambda item: item[0] not in required):
            if only in ("", key):
                rule = self.resolved(rule)
                yield key, self.values(rule), default(rule, key in required), self.meaning(rule)

    def values(self, rule: Rule) -> str:
        if "anyOf" in rule and {"format": "ipv4"} in rule["anyOf"]:
            return "IP address"
        if "enum" in rule:
            return choices(rule["enum"])
        if rule["type"] == "string":
            return f"{span(rule['minLength'], rule['maxLength'])} bytes"
        if rule["type"] in ("array", "object"):
            return self.nested(rule)
        return "`true`, `false`" if rule["type"] == "boolean" else number(rule)

    def nested(self, rule: Rule) -> str:
        words = rule.get("items", {}).get("enum")
        anchor = self.anchor(rule)
        text = rule["type"] + (f" of {choices(words)}" if words else "")
        return f"[{text}](#{anchor})" if anchor else text

    def meaning(self, rule: Rule) -> str:
        see = comment(rule, "see")
        more = f" [More]({see.removeprefix(self.page)})." if see else ""
        return (rule["description"] + more).replace("|", "\\|")

    def anchor(self, rule: Rule) -> str:
        """Of the table of its elements: the last of several forms."""
        found = ""
        for name in re.findall(r'"#/\$defs/(\w+)"', json.dumps(rule)):
            found = self.anchors.get(name) or self.anchor(self.definition(name)) or found
        return found


def comment(rule: Rule, word: str) -> str | None:
    """What rtud says there of a key: validators refuse keywords of our own."""
    match = re.search(rf"\b{word}: ([^,]+)", rule.get("$comment", ""))
    return match[1] if match else None


def span(low: float, high: float) -> str:
    return f"{low:.15g}" if low == high else f"{low:.15g} … {high:.15g}"


def choices(values: list[str | int]) -> str:
    shown = [f"`{value}`" if isinstance(value, str) else str(value) for value in values]
    if len(shown) > SHOWN and isinstance(values[0], int):
        return f"{shown[0]}, {shown[1]}, … {shown[-1]}"
    return ", ".join(shown)


def number(rule: Rule) -> str:
    if rule.get("exclusiveMinimum") == 0:
        return "number > 0"
    if rule["maximum"] > ENDLESS:
        return "number ≥ 0" if rule["minimum"] == 0 else "number"
    unit = comment(rule, "unit")
    return span(rule["minimum"], rule["maximum"]) + (f" {unit}" if unit else "")


def default(rule: Rule, required: bool) -> str:
    value = rule.get("default")
    if required:
        return "required"
    if isinstance(value, str):
        return f"`{value}`"
    if isinstance(value, float):
        return f"{value:.15g}"
    return "none" if value is None else json.dumps(value)


def slug(heading: str) -> str:
    """As GitHub and the site make an anchor of it."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-")


def page(keys: Keys, text: str) -> str:
    heading = ""
    for line in text.splitlines():
        if line.startswith("#"):
            heading = slug(line.lstrip("# "))
        if match := re.fullmatch(r"<!-- keys: ([\w. ]+) -->", line):
            keys.anchors |= {name: heading for name in match[1].split() if "." not in name}

    def table(match: re.Match[str]) -> str:
        rows = (cells for word in match[2].split() for cells in keys.cells(word))
        lines = (f"| `{key}` | {' | '.join(others)} |\n" for key, *others in rows)
        return match[1] + HEAD + "".join(lines)

    return TABLE.sub(table, text)


def setting(key: str, rule: Rule, required: bool, home: type | None) -> str:
    """A row: the default is said at the sentence's end in brackets, or that of the dataclass."""
    text = rule["description"]
    bracket = None if required else re.fullmatch(r"(.*) \[([^\[\]]*)\]", text)
    value = getattr(home, key, None)
    if required:
        cell = "required"
    elif bracket:
        text, cell = bracket.groups()
    elif isinstance(value, bool | int | float):
        cell = f"{json.dumps(value) if isinstance(value, bool) else f'{value:.15g}'}"
    else:
        cell = f"`{value}`" if isinstance(value, str) and value else "none"
    return f"| `{key}` | {cell} | {text} |\n"


def control_centre(text: str) -> str:
    tables: dict[str, tuple[Rule, type | None]] = {
        "station": ({"properties": settings.STATION}, settings.StationSettings),
        "centre": ({"properties": settings.CENTRE}, settings.Settings),
        "oidc": (settings.OIDC, settings.Oidc),
        "mqtt": (settings.MQTT, settings.Mqtt),
        "notify": (settings.NOTIFY, None),
        "higher": (settings.HIGHER, None),
    }

    def table(match: re.Match[str]) -> str:
        schema, home = tables[match[2]]
        required = schema.get("required", [])
        rows = (setting(key, rule, key in required, home) for key, rule in schema["properties"].items())
        return match[1] + SETTINGS_HEAD + "".join(rows)

    return SETTINGS.sub(table, text)


def modbus(keys: Keys) -> str:
    """Tables, an identification's objects, formats, orders and manuals' numbers, as the keys have them."""
    slave, says, of_object = (
        keys.definition(name)["properties"] for name in ("slave", "identification", "object")
    )
    tables = [
        key for key, rule in slave.items() if f"{rule.get('items', {}).get('$ref', '')}s".endswith(f"/{key}")
    ]
    digits = re.match(r"\^\[(\d+)\]", of_object["register"]["pattern"])
    assert digits and len(digits[1]) == len(tables), "a first digit for each table"
    lists = {
        "TABLES": tables,
        "IDENTIFICATION": [key for key in says if key not in tables],
        "FORMATS": of_object["format"]["enum"],
        "WORD_ORDERS": of_object["word_order"]["enum"],
        "BYTE_ORDERS": of_object["byte_order"]["enum"],
    }
    lines = [
        "# SPDX-License-Identifier: GPL-3.0-or-later",
        f"{QUOTES}What the configuration says of Modbus objects.",
        f"\nMade by `make keys` from its rules; do not edit.\n{QUOTES}\n",
        *(
            f"{name} = (\n{''.join(f'    {json.dumps(word)},{chr(10)}' for word in words)})"
            for name, words in lists.items()
        ),
        f'NUMBER_DIGITS = "{digits[1]}"  # the first of a manual\'s number, by table',
        f"ADDRESS_LAST = {of_object['address']['maximum']}",
    ]
    return "\n".join(lines) + "\n"


def main() -> int:
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("--check", action="store_true", help="write nothing")
    words.add_argument("build", type=Path, help="folder of a build with -Dschema=true")
    words.add_argument("tree", nargs="?", default=".", type=Path)
    given = words.parse_args()
    made = {}
    for path, program in PAGES.items():
        run = subprocess.run([given.build / program, "--schema"], capture_output=True, text=True, check=False)
        if run.returncode != 0:
            print(run.stderr, end="", file=sys.stderr)
            return 2
        keys = Keys(run.stdout, path)
        made[path] = page(keys, (given.tree / path).read_text(encoding="utf-8"))
        if program == "rtud/rtud":
            made[SCHEMA] = run.stdout
            made[MADE] = modbus(keys)
    made[CENTRE_PAGE] = control_centre((given.tree / CENTRE_PAGE).read_text(encoding="utf-8"))
    old = [path for path, text in made.items() if (given.tree / path).read_text(encoding="utf-8") != text]
    for path in old:
        print(path)
        if not given.check:
            (given.tree / path).write_text(made[path], encoding="utf-8")
    return 1 if given.check and old else 0


if __name__ == "__main__":
    sys.exit(main())
