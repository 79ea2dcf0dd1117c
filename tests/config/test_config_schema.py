# SPDX-License-Identifier: GPL-3.0-or-later
"""The rules of the configuration: schema, loader and pages say the same of each key."""

import json
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from rig.configuration import (
    ENDLESS,
    PAGE,
    REMOVED,
    ROOT,
    SCHEMA,
    VALIDATOR,
    Json,
    check_document,
    edit,
    report_file,
)

# ---- the schema and the loader say the same ----------------------------------------------------------------


@dataclass(frozen=True)
class Site:
    """An object of the file: where the schema describes it, and where it is in a small file that has it."""

    definition: str
    place: str
    forms: tuple[str, ...] = ()  # definitions that narrow down what it refers to

    def properties(self) -> dict[str, Any]:
        """Its keys; a form has none of those that it denies."""
        found: dict[str, Any] = {}
        for name in (self.definition, *self.forms):
            for key, rule in definition(name).get("properties", {}).items():
                found[key] = rule if isinstance(rule, bool) else found.get(key, {}) | rule
        return {key: rule for key, rule in found.items() if rule is not False}

    def required(self) -> set[str]:
        return {
            key for name in (self.definition, *self.forms) for key in definition(name).get("required", [])
        }

    def name(self) -> str:
        return self.forms[-1] if self.forms else self.definition


def definition(name: str) -> dict[str, Any]:
    return SCHEMA if name == "" else SCHEMA["$defs"][name]


SITES = [
    Site("", ""),
    Site("iec104", "iec104"),
    Site("commands", "commands"),
    Site("redundancy_group", "redundancy_groups[0]"),
    Site("tls", "tls"),
    Site("journal", "journal"),
    Site("gps_receiver", "gps[0]"),
    Site("geofence", "gps[0].fences[0]"),
    Site("goose", "goose"),
    Site("goose_publication", "goose.publish[0]"),
    Site("goose_subscription", "goose.subscribe[0]"),
    Site("goose_point", "goose.subscribe[0].data[0]"),
    Site("limits", "iec61850.limits[0]"),
    Site("data_set", "iec61850.data_sets[0]"),
    Site("report", "iec61850.data_sets[0].reports[0]"),
    Site("snmp", "snmp"),
    Site("snmp_user", "snmp.users[0]"),
    Site("snmp_sink", "snmp.sinks[0]"),
    Site("web", "web"),
    Site("outstations_tls", "outstations_tls"),
    Site("iec61850", "iec61850"),
    Site("iec61850_tls", "iec61850.tls"),
    Site("outstation", "outstations[0]"),
    Site("outstation_set", "outstations[0].sets[0]"),
    Site("outstation_point", "outstations[0].sets[0].points[0]"),
    Site("modbus", "modbus"),
    Site("module", "modules[0]"),
    Site("module_point", "modules[0].points[0]"),
    Site("net", "net"),
    Site("net_place", "net.places[0]"),
    Site("net_module", "net.modules[0]"),
    Site("net_point", "net.modules[0].points[0]"),
    Site("port", "port[0]"),
    Site("tcp_connection", "port[2]"),
    Site("tcp_slave", "port[2].slaves[0]"),
    Site("rs485", "port[0].rs485"),
    Site("inactive_port", "port[1]"),
    Site("pass_through", "port[0].pass_through"),
    Site("slave", "port[0].slaves[0]"),
    Site("identification", "port[0].slaves[0].identification"),
    Site("template", "templates.meter"),
    Site("object", "port[0].slaves[1].coils[0]", ("bits", "coil")),
    Site("object", "port[0].slaves[1].discrete_inputs[0]", ("bits", "discrete_input")),
    Site("object", "port[0].slaves[1].input_registers[1]", ("input_register", "register_bits")),
    Site("object", "port[0].slaves[1].input_registers[0]", ("registers", "input_register")),
    Site("object", "port[0].slaves[1].holding_registers[0]", ("registers", "holding_register")),
]
# What a key needs beside it: a type that gives it a meaning, or another key that limits it.
COMPANIONS: dict[str, dict[str, Any]] = {
    "k": {"w": 1},
    "w": {"k": 32767},
    "connections_per_address": {"max_connections": 16},
    "t1": {"t2": 1},
    "t2": {"t1": 255},
    "size_kb": {"volume_mb": 1048576},
    "interval_s": {"volume_mb": 1048576},
    "volume_mb": {"interval_s": 3600, "size_kb": 64},
    "journal.cycles": {"volume_mb": 1048576},
    "gps_receiver.device": {"gpsd": REMOVED},
    "gps_receiver.baud_rate": {"gpsd": REMOVED, "burst_octets": 40},
    "start": {"synch": ["line3 -> mixer"]},
    "net.modules": {"transitions": []},
    "gps_receiver.position_ioa": {"ioa": 1000},  # unlike those that are tried
    "retry_ms": {"retry_max_ms": 3600000},
    "retry_max_ms": {"retry_ms": 10},
    "command_ioa": {"command": True},
    "outstation.certificate": {"secure": True},
    "web.address": {"certificate": "/own.pem", "key": "/own.key"},
    "web.certificate": {"key": "/own.key"},
    "web.key": {"certificate": "/own.pem"},
    "outstation_point.select": {"command": True},
    "outstation_point.short_pulse_ms": {"command": True},
    "outstation_point.long_pulse_ms": {"command": True},
    "value": {"device": "ttyUSB0"},
    "baud_rate": {"device": "ttyUSB0"},
    "address": {"ioa": 70000},
    "pass_through.address": {},
    "register": {"address": REMOVED},
    "response_timeout_min_ms": {"response_timeout_ms": 10000},
    "bit_order": {"type": "double"},
    "word_order": {"type": "float"},
    "bits": {"ioa": 60010},
    "length": {"format": "string"},
    "decimals": {"type": "float"},
    "register_bits.bit_order": {"type": "double"},
    "counter_group": {"type": "counter"},
    "freeze_s": {"type": "counter"},
    "input_register.background_ms": {"type": "step"},
    "holding_register.background_ms": {"type": "step"},
    "module_point.select": {"command": True},
    "module_point.short_pulse_ms": {"command": True, "type": "single"},
    "module_point.long_pulse_ms": {"command": True, "type": "single"},
    "second_address": {"type": "double"},
    **{
        f"{table}.{key}": {"write_address": 40}
        for table in ("discrete_input", "input_register", "register_bits")
        for key in ("select", "read_back", "short_pulse_ms", "long_pulse_ms", "step", "min", "max")
    },
    "coil.write_values": {"write_at_return": True},
    "holding_register.write_values": {"write_at_return": True, "type": "float"},
    "input_register.write_values": {"write_address": 40, "write_at_return": True, "type": "float"},
    **{
        f"{table}.write_values": {"write_address": 40, "write_at_return": True}
        for table in ("discrete_input", "register_bits")
    },
    **{
        f"{table}.{key}": {"write_address": 40}
        for table in ("discrete_input", "input_register", "register_bits")
        for key in ("write_at_return", "write_every_ms")
    },
    "slave.id": {"identification": REMOVED},  # a broadcast address says nothing
    "quality": {"type": "normalized"},
    "step": {"type": "float", "min": -2, "max": 2},
    "min": {"step": 1, "max": 1e31},
    "max": {"step": 1, "min": -1e31},
}


# What a point of the small file can be in IEC 61850, if it is not a float.
LN_OF = {
    "data_set": "LLN0",
    "coil": "GGIO2.SPCSO1",
    "discrete_input": "Q1CSWI1.OpOpn",
    "register_bits": "Q1CSWI1.OpOpn",
}


# Object 5 of each table.
REGISTER_OF = {
    "coil": ["00006", "000006"],
    "discrete_input": ["10006", "100006"],
    "input_register": ["30006", "300006"],
    "register_bits": ["30010", "300010"],
    "holding_register": ["40006", "400006"],
}


def small_file() -> dict[str, Any]:
    """No value here is at a bound of its key."""
    line = {"baud_rate": 115200, "data_bits": 8, "stop_bits": 1, "parity": 0}
    tables = ("coils", "discrete_inputs", "input_registers", "holding_registers")
    device: dict[str, Any] = {"id": 2, "page_address": 900} | {table: [{"address": 5}] for table in tables}
    device["discrete_inputs"].append({"address": 700})
    device["holding_registers"].append({"address": 77})
    device["input_registers"].append({"address": 9, "bit": 3, "ioa": 60003})
    slaves = [{"id": 1, "identification": {}}, device]
    tool = {"address": "192.0.2.1", "tcp_port": 5020, "units": [2]}
    ports = [
        {"value": 3, "active": 1, **line, "rs485": {}, "pass_through": tool, "slaves": slaves},
        {"value": 5, "active": 0},
        {"value": 9, "active": 1, "host": "192.0.2.9", "tcp_port": 503, "slaves": [{"id": 2}]},
    ]
    tls = {"certificate": "/own.pem", "key": "/own.key", "ca": "/ca.pem"}
    groups = [{"name": "centre", "masters": ["192.0.2.1"]}]
    town = {"ca": 7003, "points": [{"type": "single", "ioa": 1000}]}
    fence = {"name": "depot", "centre": [44.8125, 20.4612], "radius_m": 200}
    trip = {"name": "trip", "type": "float", "ioa": 70}
    others = {
        "iec104": {},
        "tls": tls,
        "journal": {},
        "gps": [{"name": "bus", "gpsd": "192.0.2.3", "ca": 7001, "fences": [fence]}],
        "goose": {
            "interface": "eth1",
            "publish": [
                {"name": "a", "control_block": "A", "data_set": "B", "app_id": 7, "points": ["speed"]}
            ],
            "subscribe": [{"name": "b", "control_block": "C", "app_id": 8, "ca": 7005, "data": [trip]}],
        },
        "snmp": {
            "users": [{"name": "graphs", "role": "viewer"}, {"name": "centre", "role": "operator"}],
            "sinks": [{"name": "nms", "address": "192.0.2.4", "user": "centre"}],
        },
        "iec61850": {
            "address": "127.0.0.1",
            "tls": dict(tls),
            "limits": [{"point": "speed", "high_high": 95, "high": 90, "low": 10, "low_low": 5}],
            "data_sets": [{"name": "Bay", "points": ["speed"], "reports": [{"name": "urcbBay"}]}],
        },
        "web": {"address": "127.0.0.1"},
        "outstations": [{"name": "town", "addresses": ["192.0.2.4"], "sets": [town]}],
        "outstations_tls": dict(tls),
        "modbus": {},
        "commands": {},
        "event_ring": 65536,
        "redundancy_groups": groups,
        "modules": [
            {
                "name": "pump",
                "program": "/pump.py",
                "ca": 9,
                "points": [{"name": "p", "type": "float", "ioa": 5}],
            },
            {
                "name": "mixer",
                "program": "/mixer.py",
                "ca": 11,
                "points": [{"name": "speed", "type": "float", "ioa": 5}],
            },
        ],
        "net": {
            "places": [{"name": "free"}],
            "transitions": ["begin", "end", "half"],
            "modules": [
                {
                    "name": "mixer",
                    "scan_begin": "begin",
                    "scan_end": "end",
                    "points": [{"name": "at-half", "transition": "half"}],
                }
            ],
        },
        "templates": {"meter": {}},
    }
    return {"port": ports, **others}


# A section that another one needs.
BESIDE = {
    "outstations": "outstations_tls",
    "outstations_tls": "outstations",
    "port": "templates",
    "redundancy_groups": "event_ring",
}


def around(site: Site) -> dict[str, Any]:
    """The small file without what the site does not need: the schema takes its time for all of it."""
    document = small_file()
    ports = document["port"]
    if "synch" in site.properties():
        return document  # which names a line
    section = re.split(r"[.\[]", site.place)[0]
    if section != "iec61850":
        del document["iec61850"]  # whose names have no room for every IOA
    if section:
        kept = ("port", "modules", section, BESIDE.get(section))
        document = {key: value for key, value in document.items() if key in kept}
    for number, port in enumerate(ports):
        if f"port[{number}]" not in site.place:
            ports[number] = {"value": port["value"], "active": 0}
    _, _, table = site.place.partition(".slaves[1].")
    if table:
        device = ports[0]["slaves"][1]
        its = (
            "id",
            "page_address",
            "discrete_inputs",
            "holding_registers",
            table.partition("[")[0],
        )  # other keys name these
        ports[0]["slaves"][1] = {key: device[key] for key in its}
    return document


def with_key(site: Site, key: str, value: Json | object) -> dict[str, Any]:
    document = around(site)
    prefix = f"{site.place}." if site.place else ""
    companions = COMPANIONS.get(key, {}) | COMPANIONS.get(f"{site.name()}.{key}", {})
    for companion, companion_value in companions.items():
        if companion in site.properties():
            edit(document, prefix + companion, companion_value)
    edit(document, prefix + key, value)
    return document


def resolved(rule: Json) -> dict[str, Any]:
    if not isinstance(rule, dict):
        return {}
    if "$ref" not in rule:
        return rule
    target: Any = SCHEMA
    for step in rule["$ref"].removeprefix("#/").split("/"):
        target = target[step]
    return target | rule


def accepted_values(key: str, rule: dict[str, Any]) -> list[Any]:
    if key in ("address", "gpsd") and "maxLength" in rule:
        return ["127.0.0.1", "::"]
    if "examples" in rule:
        return rule["examples"]
    if "const" in rule:
        return [rule["const"]]
    if key == "second_address":
        return [0, 4, 6, 1029]  # the first is 5
    if key == "scale_register":
        return [0, 4, 6, 129]  # one answer has at most 125, from 5 on
    if key == "format":
        return [name for name in rule["enum"] if not name.startswith("string")]  # which need a length
    if "enum" in rule:
        return rule["enum"]
    if rule.get("type") == "boolean":
        return [False, True]
    if "maxLength" in rule and isinstance(default := rule.get("default"), str):
        return [default]
    if "maxLength" in rule:
        first = "/" if rule.get("pattern", "").startswith("^/") else "x"
        return [first + "x" * (length - 1) for length in (max(rule["minLength"], 1), rule["maxLength"])]
    if rule.get("type") == "number":
        least = 0.5 if "exclusiveMinimum" in rule else rule["minimum"]
        return [-1.5 if least < -ENDLESS else least, 2, 1e30]
    return [rule[bound] for bound in ("minimum", "maximum") if bound in rule]


KINDS = {
    "boolean": ("true or false", [(1, "an integer"), (None, "null")]),
    "array": ("an array [ ]", [({}, "an object"), (None, "null")]),
    "object": ("an object {{ }}", [(5, "an integer"), ([], "an array")]),
    "integer": (
        "an integer from {minimum:.0f} to {maximum:.0f}",
        [("1", "a string"), (1.5, "a decimal number")],
    ),
    "number": ("a number from {minimum:g} to {maximum:g}", [("1", "a string"), (None, "null")]),
    "string": ("a string of {minLength} to {maxLength} bytes", [(5, "an integer"), (True, "a boolean")]),
}
OWN_WORDS = ("data_bits",)  # whose rule has room for what is refused with a reason
SHORT = 512  # arrays that are tried with an element too many


def expected(rule: dict[str, Any]) -> str:
    """As rtud says it of a value of another kind, or of none."""
    return KINDS[rule["type"]][0].format(**rule) if "type" in rule else "one of " + ", ".join(rule["enum"])


def wrong_values(rule: dict[str, Any]) -> Iterator[tuple[Any, str]]:
    """One of each kind, and what rtud says of it."""
    if "type" not in rule:
        yield "nothing", f'"nothing" is not known, expected {expected(rule)}'
        yield 1, f"is an integer, expected {expected(rule)}"
        return
    for value, name in KINDS[rule["type"]][1]:
        yield value, f"is {name}, expected {expected(rule)}"
    if rule["type"] in ("integer", "number"):
        form = "{:.0f}" if rule["type"] == "integer" else "{:g}"
        low, high = rule["minimum"], rule["maximum"]
        tried = (low - 1, high + 1) if high < ENDLESS else (-1,) if low == 0 else ()
        for value in tried:
            yield (
                value,
                f"{form.format(value)} is out of range, expected {form.format(low)} to {form.format(high)}",
            )
    elif rule["type"] == "string":
        sizes = f"expected {rule['minLength']} to {rule['maxLength']} bytes"
        yield "x" * (rule["maxLength"] + 1), f"is {rule['maxLength'] + 1} bytes long, {sizes}"
        if rule["minLength"] > 0:
            yield "", f"is 0 bytes long, {sizes}"
        yield "\n" + "x" * (max(rule["minLength"], 2) - 1), "has a control character, expected printable text"
    elif rule["type"] == "array" and rule["maxItems"] <= SHORT:
        count = rule["maxItems"] + 1
        yield [0] * count, f"has {count} elements, expected at most {count - 1}"


@pytest.mark.sample(15)
@pytest.mark.parametrize("site", SITES, ids=lambda site: site.name() or "file")
def test_schema_and_loader_agree_on_values(programs: Path, tmp_path: Path, site: Site) -> None:
    for key, rule in ((key, resolved(rule)) for key, rule in site.properties().items()):
        values = accepted_values(key, rule)
        if key in ("ln", "register", "data_bits"):
            values = {
                "ln": [LN_OF.get(site.name(), "MMXU1.TotW")],
                "register": REGISTER_OF.get(site.name()),
                "data_bits": [8],  # 7 takes ASCII
            }[key]
        for value in values:
            document = with_key(site, key, value)
            assert [error.message for error in VALIDATOR.iter_errors(document)] == [], (key, value)
            result = check_document(programs, tmp_path, document)
            assert result.returncode == 0, (key, value, result.stderr)


READ_ONLY = [{}, {"select": True}, {"write_address": 9}, {"write_only": False}, {"deadband": 1.0}]
TEXT = {"format": "string", "length": 4}
WITH_TEXTS: list[dict[str, Any]] = [
    *({"word_order": "big"}, {"select": True}, {"write_address": 9}, {"names": {"0": "off"}}, {"scale": 2.0}),
    *({"bits": [0, 3]}, {"background_ms": 1000}, {"deadband": 1.0}, {"unit": "V"}, {"write_only": True}),
]
REGISTERS = [  # of holding registers: some are wrong
    *({"read_only": is_so} | keys for is_so in (True, False) for keys in READ_ONLY),
    {"format": "string", "length": 32},
    {"format": "string16", "length": 1, "type": "bitstring", "byte_order": "little", "period_ms": 1000},
    {"format": "string"},
    {"length": 4},
    TEXT | {"type": "float"},
    *(TEXT | keys for keys in WITH_TEXTS),
]


@pytest.mark.parametrize("keys", REGISTERS, ids=str)
def test_schema_and_loader_agree_on_registers(programs: Path, tmp_path: Path, keys: dict[str, Any]) -> None:
    document = small_file()
    document["port"][0]["slaves"][1]["holding_registers"].append({"address": 300, "ioa": 300} | keys)
    result = check_document(programs, tmp_path, document)
    assert VALIDATOR.is_valid(document) == (result.returncode == 0), result.stderr


@pytest.mark.slow
@pytest.mark.sample(15)
@pytest.mark.parametrize("site", SITES, ids=lambda site: site.name() or "file")
def test_wrong_value_of_each_kind_is_named(programs: Path, tmp_path: Path, site: Site) -> None:
    """And the schema refuses it."""
    place = f"{site.place}." if site.place else ""
    for key in site.properties():
        rule = resolved(definition(site.definition)["properties"][key])
        if rule.keys() <= {"$comment"} or key in OWN_WORDS:
            continue
        for value, message in wrong_values(rule):
            document = with_key(site, key, value)
            assert not VALIDATOR.is_valid(document), (key, value)
            result = check_document(programs, tmp_path, document)
            assert f"{place}{key}: {message}" in result.stderr.splitlines(), (key, value, result.stderr)
            assert result.returncode == 1


@pytest.mark.parametrize("site", SITES, ids=lambda site: site.name() or "file")
def test_schema_and_loader_know_the_same_keys(programs: Path, tmp_path: Path, site: Site) -> None:
    document = with_key(site, "zzzzzzzzzz", 0)
    assert not VALIDATOR.is_valid(document)
    message = check_document(programs, tmp_path, document).stderr
    known = set(message.strip().partition("expected one of ")[2].split(", "))
    assert known == set(definition(site.definition)["properties"])


@pytest.mark.sample(6)
@pytest.mark.parametrize("site", SITES, ids=lambda site: site.name() or "file")
def test_schema_and_loader_require_the_same_keys(programs: Path, tmp_path: Path, site: Site) -> None:
    required = site.required()
    if site.definition == "object":
        required.add("address")  # or register
    target = f"{site.place}." if site.place else ""
    for key in set(site.properties()) - {"active", "length"}:  # this one a format needs
        document = with_key(site, key, 0)
        edit(document, target + key, REMOVED)
        message = f"{target}{key}: is missing"
        if key in definition(site.definition).get("required", []) and key not in OWN_WORDS:
            message += f", expected {expected(resolved(definition(site.definition)['properties'][key]))}"
        assert (message in check_document(programs, tmp_path, document).stderr) == (key in required), key


def tables() -> Iterator[str]:
    """The definitions that are objects with keys; the others narrow one down."""
    yield ""
    yield from (name for name, rule in SCHEMA["$defs"].items() if rule.get("additionalProperties") is False)


def described() -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Every key of the schema: the definition it is in, its name, its rule."""
    for name in tables():
        for key, rule in definition(name)["properties"].items():
            yield name, key, resolved(rule)


def test_every_key_is_described() -> None:
    undescribed = [
        f"{name}.{key}"
        for name, key, rule in described()
        if name != "inactive_port" and not rule["description"].endswith(".")
    ]
    assert undescribed == []


def test_every_table_is_tried() -> None:
    """But for what needs files of its own."""
    assert set(tables()) - {site.definition for site in SITES} == {"program", "program_point"}


def schemas(rule: Json) -> Iterator[dict[str, Any]]:
    """A schema, and those in it."""
    if not isinstance(rule, dict):
        return
    yield rule
    for word, value in rule.items():
        if word in ("properties", "$defs"):
            parts = list(value.values())
        elif word in ("anyOf", "allOf", "oneOf"):
            parts = value
        else:
            parts = [value] if word in ("if", "then", "else", "not", "items", "additionalProperties") else []
        for part in parts:
            yield from schemas(part)


def test_schema_has_no_keyword_of_its_own() -> None:
    """Validators that are strict, as editors' may be, refuse a schema with such."""
    core = {
        "$schema",
        "$defs",
        "$ref",
        "$comment",
        "title",
        "description",
        "default",
        "examples",
        "type",
        "enum",
        "const",
    }
    applied = {
        "propertyNames",
        "properties",
        "additionalProperties",
        "items",
        "if",
        "then",
        "else",
        "not",
        "anyOf",
        "allOf",
        "oneOf",
    }
    asserted = {
        "required",
        "dependentRequired",
        "format",
        "pattern",
        "minLength",
        "maxLength",
        "minItems",
        "maxItems",
    }
    numbers = {"minimum", "maximum", "exclusiveMinimum", "multipleOf", "minProperties", "maxProperties"}
    used = {word for rule in schemas(SCHEMA) for word in rule}
    assert used <= core | applied | asserted | numbers


@pytest.mark.slow  # Node.js comes with what builds the centre's page
def test_patterns_are_regular_expressions_of_javascript() -> None:
    """With the flag u, which JSON Schema wants: it refuses escapes that mean nothing."""
    patterns = sorted({rule["pattern"] for rule in schemas(SCHEMA) if "pattern" in rule})
    script = "JSON.parse(process.argv[1]).forEach((pattern) => new RegExp(pattern, 'u'));"
    run = subprocess.run(
        ["node", "-e", script, json.dumps(patterns)], capture_output=True, text=True, check=False
    )
    assert len(patterns) > 10
    assert (run.returncode, run.stderr) == (0, "")


# ---- what is made of the rules -----------------------------------------------------------------------------


CENTRE_PLACES = {
    "": "",
    "tls": "tls.",
    "defaults": "defaults.",
    "station": "stations[0].",
    "read": "stations[0].reads[0].",
}


def centre_file() -> dict[str, Any]:
    reads = [{"common_address": 1, "ioa": 1, "period_ms": 1000}]
    tls = {"certificate": "/own.pem", "key": "/own.key", "ca": "/ca.pem"}
    station = {"name": "town", "address": "192.0.2.1", "common_addresses": [1], "reads": reads}
    return {"tls": tls, "defaults": {}, "stations": [station]}


@pytest.mark.slow
def test_rtu_centre_names_a_wrong_value_of_each_kind(programs: Path, tmp_path: Path) -> None:
    """And its schema refuses it."""
    program = programs / "centre/rtu-centre"
    run = subprocess.run([program, "--schema"], capture_output=True, text=True, check=True)
    schema = json.loads(run.stdout)
    validator = Draft202012Validator(schema, format_checker=Draft202012Validator.FORMAT_CHECKER)
    assert validator.is_valid(centre_file())
    assert {"", *schema["$defs"]} == set(CENTRE_PLACES)
    path = tmp_path / "centre.json"
    for name, place in CENTRE_PLACES.items():
        table = schema["$defs"][name] if name else schema
        for key, rule in table["properties"].items():
            whole = schema["$defs"]["station"]["properties"][key] if name == "defaults" else rule
            for value, message in wrong_values(whole):
                document = centre_file()
                edit(document, place + key, value)
                assert not validator.is_valid(document), (key, value)
                path.write_text(json.dumps(document))
                result = subprocess.run(
                    [program, "--check", path], capture_output=True, text=True, check=False
                )
                assert f"{path}:1: {place}{key}: {message}" in result.stderr.splitlines(), (key, value)
                assert result.returncode == 1


def test_schema_and_page_are_made_of_the_rules(programs: Path) -> None:
    command = [sys.executable, ROOT / "scripts/keys.py", "--check", programs, ROOT]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (run.returncode, run.stdout, run.stderr) == (0, "", ""), "make keys, and commit what it names"


def test_page_has_every_key() -> None:
    shown = re.findall(r"^<!-- keys: ([\w. ]+) -->$", PAGE.read_text(), re.MULTILINE)
    names = {word for words in shown for word in words.split()}
    same = {
        "inactive_port",
        "template",
        "tcp_slave",
        "iec61850_tls",
        "outstations_tls",
    }  # but for what is shown
    assert {name or "file" for name in tables()} - names == same


def test_page_shows_the_examples() -> None:
    blocks = re.findall(r"^```json\n(.*?)^```", PAGE.read_text(), re.MULTILINE | re.DOTALL)
    templates, report = map(json.loads, blocks)
    assert report == report_file()
    assert list(VALIDATOR.iter_errors(templates)) == []
