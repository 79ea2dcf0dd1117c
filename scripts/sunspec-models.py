# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes package/openrtu/src/templates/sunspec of the SunSpec Alliance's model definitions.

For a person, when the definitions have changed: `pip download --no-deps pysunspec2==1.3.7`, then
`scripts/sunspec-models.py pysunspec2-1.3.7-py3-none-any.whl`. The definitions are under the Apache License
2.0, and so is what is made of them. Each model is taken to stand behind the common model with 65 registers
at 40002.
"""

from __future__ import annotations

import json
import sys
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

Json = dict[str, Any]
FOLDER = Path(__file__).resolve().parents[1] / "package/openrtu/src/templates/sunspec"
MODELS = "sunspec2/models/json/model_"
BEGIN = 40069  # of the model's ID, behind the common model
MARK = ((40000, 0x5375), (40001, 0x6E53))  # "SunS"
COMMON = 1  # of which a device has none behind the common model
IOA_BASE = 40000
REQUEST_MOST = 125
GROUP_MOST, NAME_MOST = 10, 31  # letters
SLOW_MS, PERIOD_MS, FACTOR_MS = 10000, 1000, 500  # a factor is read before what it scales
# A type of SunSpec: registers, type and format of an object. What is not here is no number.
NUMBERS = {
    "int16": (1, "float", "int16"),
    **{name: (1, "float", "uint16") for name in ("uint16", "acc16", "count")},
    **{"int32": (2, "float", "int32"), "uint32": (2, "float", "uint32"), "acc32": (2, "float", "uint32")},
    **{"int64": (4, "float", "int64"), "uint64": (4, "float", "uint64"), "acc64": (4, "float", "uint64")},
    **{"float32": (2, "float", ""), "float64": (4, "float", "float64"), "sunssf": (1, "scaled", "")},
    **{"enum16": (1, "scaled", "uint16"), "enum32": (2, "float", "uint32")},
    **{"bitfield16": (1, "bitstring", "uint16"), "bitfield32": (2, "bitstring", "uint32")},
}
MARKED = ("int16", "int32", "int64", "uint16", "uint32", "uint64", "enum16", "enum32")  # not implemented
SAME = ("A", "V", "W", "VA", "var", "Wh", "VAh", "varh", "Hz", "kWh", "Ah", "mm", "m/s", "deg")
UNITS = {unit: unit for unit in SAME} | {
    **{"C": "°C", "Pct": "%", "Secs": "s", "Sec": "s", "mSecs": "ms", "Degrees": "deg", "Var": "var"},
    **{"Varh": "varh", "WH": "Wh", "AH": "Ah", "W/m2": "W/m²", "W/m^2": "W/m²", "mps": "m/s"},
    **{"ohms": "ohm", "HPa": "hPa", "meters": "m"},
}
DEADBANDS = {"V": 1, "A": 0.1, "W": 10, "var": 10, "VA": 10, "Hz": 0.02, "°C": 0.2, "%": 0.5}
ENERGIES = ("Wh", "VAh", "varh", "kWh", "Ah")


@dataclass
class Model:
    """Its objects, and where they begin."""

    objects: list[Json] = field(default_factory=list)
    address: int = BEGIN
    more: bool = False  # it repeats a group as often as the device says

    def group(self, group: Json, prefix: str, factors: dict[str, int]) -> None:
        own = dict(factors)
        at = self.address
        for point in group["points"]:
            if point["type"] == "sunssf":
                own[point["name"]] = at
            at += int(point["size"])
        for point in group["points"]:
            self.point(point, prefix, own)
            self.address += int(point["size"])
        for inner in group.get("groups", []):
            count = inner.get("count", 1)
            self.more |= not isinstance(count, int) or count == 0
            times = count if isinstance(count, int) and count else 1
            for number in range(1, times + 1):
                self.group(inner, f"{prefix}{short(inner['name'])}{number if count != 1 else ''}/", own)

    def point(self, point: Json, prefix: str, factors: dict[str, int]) -> None:
        kind = point["type"]
        if kind not in NUMBERS or kind == "sunssf" or (not prefix and point["name"] in ("ID", "L")):
            return
        size, type_, format_ = NUMBERS[kind]
        one: Json = {"address": self.address, "name": prefix + point["name"]}
        one |= {"type": type_} if type_ != "scaled" else {}
        one |= {"format": format_} if format_ else {}
        one |= self._scale(point, size, factors)
        one |= {"unimplemented": True} if kind in MARKED else {}
        unit = "%" if point.get("units", "").strip().startswith("%") else UNITS.get(point.get("units", ""))
        one |= {"unit": unit} if unit else {}
        one |= {"deadband": DEADBANDS[unit]} if type_ == "float" and unit in DEADBANDS else {}
        one |= {"period_ms": SLOW_MS} if unit in ENERGIES else {}
        one |= {"names": names_of(point)} if kind == "enum16" and point.get("symbols") else {}
        one |= {"read_only": True} if point.get("access") != "RW" else {}
        self.objects.append(one | {"ioa": self.address - IOA_BASE})

    def _scale(self, point: Json, size: int, factors: dict[str, int]) -> Json:
        factor = point.get("sf")
        if factor is None or point["type"] not in NUMBERS:
            return {}
        if not isinstance(factor, str):
            return {"scale": round(10.0**factor, 10)} if factor else {}
        place = factors[factor]
        if max(self.address + size, place + 1) - min(self.address, place) <= REQUEST_MOST:
            return {"scale_register": place}
        name = f"{factor}.{place}"
        if all(one["name"] != name for one in self.objects):
            self.objects.append(
                {"address": place, "name": name, "period_ms": FACTOR_MS, "read_only": True}
                | {"ioa": place - IOA_BASE}
            )
        return {"scale_by": name}


def short(group: str) -> str:
    """Its name, or the first letters of a long one's words: a point's name has 39 octets at most."""
    return group if len(group) <= GROUP_MOST else "".join(word[0] for word in group.split("_"))


def names_of(point: Json) -> Json:
    """Of the values that a scaled one of an IEC 60870-5-104 station can have."""
    return {
        str(symbol["value"]): symbol["name"].lower().replace("_", "-")[:NAME_MOST]
        for symbol in sorted(point["symbols"], key=lambda symbol: int(symbol["value"]))
        if int(symbol["value"]) < 1 << 15
    }


def about(number: int, group: Json, source: str, more: bool) -> Json:
    elsewhere = f"openrtu devices --sunspec {number}@ADDRESS has it elsewhere"
    notes = [f"The model's ID is taken to be at {BEGIN}; {elsewhere}."]
    if more:
        notes.append("A group that a device repeats as often as it says is here once.")
    return {
        "maker": "SunSpec Alliance",
        "device": f"model {number}: {group.get('label') or group['name']}",
        "kind": "SunSpec",
        "connection": "Modbus TCP, port 502, or RTU",
        "untried": True,
        "model": number,
        "license": "Apache License 2.0, as the definitions",
        "sources": [
            {"what": f"{source}, json/model_{number}.json; strings and addresses of networks left out"}
        ],
        "notes": notes,
    }


def dumped(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False)


def identification(number: int) -> str:
    """The line of a template with what tells a device that has the model there."""
    if number == COMMON:
        return ""
    known = {"holding_registers": [*MARK, (BEGIN, number)]}
    return f'      "identification": {dumped(known)},\n'


def text_of(number: int, group: Json, source: str, model: Model) -> str:
    """One object a line, as the templates that people write."""
    rows = ",\n".join(
        f"        {dumped(one)}" for one in sorted(model.objects, key=lambda one: one["address"])
    )
    keys = ",\n".join(
        f"    {dumped(key)}: {dumped(value)}"
        for key, value in about(number, group, source, model.more).items()
    )
    return (
        f'{{\n  "about": {{\n{keys}\n  }},\n  "templates": {{\n    "sunspec-model-{number}": {{\n'
        f'      "description": "SunSpec {number}",\n      "period_ms": {PERIOD_MS},\n'
        f'{identification(number)}      "holding_registers": [\n{rows}\n      ]\n    }}\n  }}\n}}\n'
    )


def models_of(wheel: Path) -> Iterator[tuple[int, Json]]:
    with zipfile.ZipFile(wheel) as archive:
        for name in sorted(archive.namelist()):
            if name.startswith(MODELS) and name.endswith(".json"):
                content = json.loads(archive.read(name))
                yield int(content["id"]), content["group"]


def main(words: list[str]) -> int:
    if len(words) != 1 or not Path(words[0]).is_file():
        print(f"sunspec-models.py: {__doc__}", file=sys.stderr)
        return 2
    source = "SunSpec Alliance, model definitions of " + " ".join(Path(words[0]).name.split("-")[:2])
    FOLDER.mkdir(exist_ok=True)
    for number, group in models_of(Path(words[0])):
        model = Model()
        model.group(group, "", {})
        if model.objects:
            (FOLDER / f"model-{number}.json").write_text(
                text_of(number, group, source, model), encoding="utf-8"
            )
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
