# SPDX-License-Identifier: GPL-3.0-or-later
"""rtud --check against the report's file, wrong files, the JSON Schema and the page that documents it."""

import copy
import json
import random
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

ROOT = Path(__file__).resolve().parent.parent
REPORT = ROOT / "tests/fixtures/report/figure-4.8-4.9.json"
EXAMPLES = [*sorted((ROOT / "docs/examples").glob("*.json")), ROOT / "tests/fixtures/chapter5/gateway.json"]
EVERY_KEY = ROOT / "docs/examples/every-key.json"
PAGE = ROOT / "docs/configuration.md"
LIMIT_PAGE = ROOT / "docs/limit.md"
SCHEMA = json.loads((ROOT / "package/openrtu/src/rtud/config.schema.json").read_text())
VALIDATOR = Draft202012Validator(SCHEMA, format_checker=Draft202012Validator.FORMAT_CHECKER)
REMOVED = object()
ENDLESS = 3e38  # beyond it a bound is that of a float

Json = dict[str, "Json"] | list["Json"] | str | float | bool | None


def check(programs: Path, path: Path, option: str = "--check") -> subprocess.CompletedProcess[str]:
    command = [programs / "rtud/rtud", option, path]
    return subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=20, check=False)


def check_document(programs: Path, directory: Path, document: Json) -> subprocess.CompletedProcess[str]:
    """What rtud says of a file of one line, without the file's name and the line."""
    path = directory / "gateway.json"
    path.write_text(json.dumps(document))
    result = check(programs, path)
    assert all(line.startswith(f"{path}:1: ") for line in result.stderr.splitlines()), result.stderr
    result.stderr = result.stderr.replace(f"{path}:1: ", "").replace(f" ({path}:1)", "")
    return result


def report_file() -> dict[str, Any]:
    """The report's file: figure 4.8 with the slave of figure 4.9 on port 3."""
    return json.loads(REPORT.read_text())


def edit(document: Json, place: str, value: Json | object) -> None:
    """Sets, appends or removes what is at a place like port[2].slaves[0].id"""
    *path, last = [int(index) if index else key for key, index in re.findall(r"([^.\[\]]+)|\[(\d+)\]", place)]
    target = document
    for step in path:
        target = target[step]
    if value is REMOVED:
        del target[last]
    elif isinstance(target, list) and last == len(target):
        target.append(value)
    else:
        target[last] = value


# ---- good files --------------------------------------------------------------------------------------------


def test_report_file_loads(programs: Path, tmp_path: Path) -> None:
    full = check(programs, REPORT)
    assert (full.returncode, full.stderr) == (0, "")
    assert full.stdout.splitlines() == [
        f"{REPORT}: good: lines 1, devices 1, points 12",
        "port 3: 19200 bit/s 8N2, 4 requests, shortest scan 73.9 ms",
    ]
    figure_4_8 = report_file()
    figure_4_8["port"][2]["slaves"] = []
    empty = check_document(programs, tmp_path, figure_4_8)
    assert (empty.returncode, empty.stderr) == (0, "")
    assert empty.stdout.splitlines() == [
        f"{tmp_path}/gateway.json: good: lines 1, devices 0, points 0",
        "port 3: 19200 bit/s 8N2, nothing to read",
    ]


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.name)
def test_examples_load(programs: Path, path: Path) -> None:
    result = check(programs, path)
    assert (result.returncode, result.stderr) == (0, "")
    assert list(VALIDATOR.iter_errors(json.loads(path.read_text()))) == []


def test_inactive_port_with_slaves_is_noted(programs: Path, tmp_path: Path) -> None:
    document = report_file()
    document["port"][2]["active"] = 0
    result = check_document(programs, tmp_path, document)
    assert result.returncode == 0
    assert result.stderr == "note: port[2]: not active, its slaves (1) are not polled and have no points\n"
    assert result.stdout.endswith("good: lines 0, devices 0, points 0\n")


# ---- the shortest scan -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Planned:
    """A row of rtud --plan."""

    unit: int
    function: int
    address: int
    count: int
    octets: int
    ms: float


def plan(programs: Path, directory: Path, document: Json) -> tuple[list[str], list[Planned]]:
    """The lines of text of rtud --plan, and its rows."""
    path = directory / "gateway.json"
    path.write_text(json.dumps(document))
    result = check(programs, path, "--plan")
    assert (result.returncode, result.stderr) == (0, "")
    lines = result.stdout.splitlines()
    rows = [line.split() for line in lines if re.fullmatch(r"[ \d.]+", line)]
    return lines, [Planned(*map(int, row[:5]), float(row[5])) for row in rows]


def test_plan_is_the_one_on_the_page(programs: Path, tmp_path: Path) -> None:
    block = re.search(r"```text\n(.*?)```", LIMIT_PAGE.read_text(), re.DOTALL)
    assert block is not None
    lines, _ = plan(programs, tmp_path, report_file())
    assert "\n".join(lines) + "\n" == block[1].replace("gateway.json", f"{tmp_path}/gateway.json")


@pytest.mark.parametrize("parity", [0, 1, 2])
@pytest.mark.parametrize("stop_bits", [1, 2])
@pytest.mark.parametrize("baud", [1200, 9600, 19200, 38400, 460800])
def test_limit_is_characters_silences_and_reactions(
    programs: Path, tmp_path: Path, baud: int, stop_bits: int, parity: int
) -> None:
    document = report_file()
    document["port"][2] |= {"baud_rate": baud, "stop_bits": stop_bits, "parity": parity}
    slave = document["port"][2]["slaves"][0]
    slave["coils"] = [{"address": address} for address in range(0, 2400, 3)]
    slave["input_registers"] = [{"address": address} for address in range(200)]
    lines, rows = plan(programs, tmp_path, document)
    character_ms = (1 + 8 + (parity > 0) + stop_bits) / baud * 1000
    silence_ms = 1.75 if baud > 19200 else 3.5 * character_ms
    shortest_ms = 0.0
    for row in rows:
        data = (row.count + 7) // 8 if row.function <= 2 else 2 * row.count
        assert row.octets == 8 + 5 + data
        ms = row.octets * character_ms + 2 * silence_ms + 5
        assert row.ms == pytest.approx(ms, abs=0.011)
        shortest_ms += ms
    assert lines[1] == (
        f"port 3: {baud} bit/s 8{'NOE'[parity]}{stop_bits}, {len(rows)} requests, "
        f"shortest scan {shortest_ms:.1f} ms"
    )
    assert [(row.function, row.address, row.count) for row in rows] == [
        (1, 0, 1999),
        (1, 2001, 397),
        (2, 0, 3),
        (3, 0, 3),
        (4, 0, 125),
        (4, 125, 75),
    ]


def test_each_device_has_its_share_and_the_broadcast_none(programs: Path, tmp_path: Path) -> None:
    document = report_file()
    slaves = document["port"][2]["slaves"]
    slaves.append({"id": 0, "coils": [{"address": 0}]})
    slaves.append({"id": 36, "description": "Meter", "input_registers": [{"address": 0}, {"address": 9000}]})
    lines, rows = plan(programs, tmp_path, document)
    assert {row.unit for row in rows} == {35, 36}
    shares = [line for line in lines if line.endswith("reacts in 5.0 ms (assumed)")]
    assert shares == [
        "    35  Temperature sensor: 4 requests, 73.9 ms, 68 %, reacts in 5.0 ms (assumed)",
        "    36  Meter: 2 requests, 35.2 ms, 32 %, reacts in 5.0 ms (assumed)",
    ]


def test_device_takes_the_time_that_it_is_known_to_take(programs: Path, tmp_path: Path) -> None:
    document = report_file()
    document["port"][2]["slaves"][0]["reaction_ms"] = 20
    lines, rows = plan(programs, tmp_path, document)
    assert lines[1].endswith("shortest scan 133.9 ms")
    assert lines[-1] == "    35  Temperature sensor: 4 requests, 133.9 ms, 100 %, reacts in 20.0 ms"
    assert rows[0].ms == 32.03


def test_connection_counts_requests_and_no_characters(programs: Path, tmp_path: Path) -> None:
    lines, rows = plan(programs, tmp_path, json.loads(EVERY_KEY.read_text()))
    head = next(line for line in lines if line.startswith("port 8:"))
    assert head in LIMIT_PAGE.read_text().splitlines()
    meter = rows[-1]
    assert (meter.unit, meter.count, meter.octets, meter.ms) == (12, 1, 12 + 11, 10.0)
    assert "   255         4        0      2      25    10.00  every 1000 ms" in lines


@dataclass(frozen=True)
class Periods:
    """Periods in the report's file, and what rtud says of its line."""

    name: str
    summary: str
    note: str
    slave_ms: int | None = None
    coil_ms: int | None = None


PERIODS = [
    Periods("held", ", periods take 17 %, the rest is read every 89.0 ms", "", coil_ms=100),
    Periods(
        "blocked",
        ", periods take 68 %, the rest is read every 231.7 ms",
        "note: port[2]: a period of 25 ms is missed when a request of 19.9 ms is under way\n",
        coil_ms=25,
    ),
    Periods(
        "more-than-the-line",
        ", periods take 106 %",
        "note: port[2]: its periods need 106 % of the line's time, its devices' reactions included, "
        "and some will be missed\n",
        slave_ms=70,
    ),
    Periods("all", ", periods take 74 %", "", slave_ms=100),
    Periods("one-of-all", ", periods take 82 %", "", slave_ms=100, coil_ms=200),
]


def on_the_page(note: str) -> bool:
    """With a file and a line before it, as rtud prints it."""
    return re.search(rf"gateway\.json:\d+: {re.escape(note.strip())}", LIMIT_PAGE.read_text()) is not None


@pytest.mark.parametrize("case", PERIODS, ids=lambda case: case.name)
def test_periods_are_summed_up(programs: Path, tmp_path: Path, case: Periods) -> None:
    document = report_file()
    slave = document["port"][2]["slaves"][0]
    if case.slave_ms is not None:
        slave["period_ms"] = case.slave_ms
    if case.coil_ms is not None:
        slave["coils"][0]["period_ms"] = case.coil_ms
    result = check_document(programs, tmp_path, document)
    assert (result.returncode, result.stderr) == (0, case.note)
    assert result.stdout.endswith(f" ms{case.summary}\n")
    if case.note:
        assert on_the_page(case.note)


def test_cost_of_early_probes_is_noted(programs: Path, tmp_path: Path) -> None:
    document = report_file()
    slaves = document["port"][2]["slaves"]
    slaves[0]["probe_max_s"] = 2
    assert check_document(programs, tmp_path, document).stderr == ""  # nobody else waits
    slaves.append({"id": 2, "coils": [{"address": 0}], "probe_max_s": 10})  # 10 s are more than 19 time-outs
    noted = check_document(programs, tmp_path, document)
    assert noted.returncode == 0
    assert noted.stderr.startswith("note: port[2].slaves[0].probe_max_s: ")
    assert noted.stderr.count("\n") == 1
    assert on_the_page(noted.stderr)


# ---- wrong files -------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Wrong:
    """A change to the report's file, and what rtud says of it."""

    name: str
    messages: list[str]
    set: dict[str, Json] = field(default_factory=dict)
    remove: list[str] = field(default_factory=list)
    schema_sees: bool = True  # a schema compares no two values


WRONG = [Wrong(**case) for case in json.loads((ROOT / "tests/fixtures/config/wrong.json").read_text())]


@pytest.mark.parametrize("case", WRONG, ids=lambda case: case.name)
def test_wrong_file(programs: Path, tmp_path: Path, case: Wrong) -> None:
    document = report_file()
    for place, value in case.set.items():
        edit(document, place, value)
    for place in case.remove:
        edit(document, place, REMOVED)
    result = check_document(programs, tmp_path, document)
    assert result.stderr.splitlines() == case.messages
    assert (result.returncode, result.stdout) == (1, "")
    assert VALIDATOR.is_valid(document) is not case.schema_sees


def test_limits_of_a_set_point_need_no_step(programs: Path, tmp_path: Path) -> None:
    document = report_file()
    edit(document, "port[2].slaves[0].holding_registers[0]", {"address": 0, "min": 0, "max": 100})
    result = check_document(programs, tmp_path, document)
    assert (result.returncode, result.stderr) == (0, "")
    assert VALIDATOR.is_valid(document)


def test_description_may_be_longer_than_a_name(programs: Path, tmp_path: Path) -> None:
    """As the report's program takes it; the name is as many whole characters as there is room for."""
    document = report_file()
    edit(document, "port[2].slaves[0].description", "12345678901234567890123456789012345678č" + "x" * 23)
    result = check_document(programs, tmp_path, document)
    assert (result.returncode, result.stderr) == (0, "")
    assert VALIDATOR.is_valid(document)
    listed = subprocess.run(
        [programs / "rtud/rtud", "--plan", tmp_path / "gateway.json"], capture_output=True, check=True
    ).stdout.decode()
    assert "12345678901234567890123456789012345678" in listed
    assert "č" not in listed


def test_more_than_there_is_room_for(programs: Path, tmp_path: Path) -> None:
    document = report_file()
    document["port"] += [{"value": 1, "active": 0}] * 62
    result = check_document(programs, tmp_path, document)
    assert (result.returncode, result.stderr) == (1, "port: has 65 elements, expected at most 64\n")
    assert not VALIDATOR.is_valid(document)
    document = report_file()
    document["port"][2]["slaves"] = [{"id": unit % 248} for unit in range(249)]
    result = check_document(programs, tmp_path, document)
    assert (result.returncode, result.stderr) == (
        1,
        "port[2].slaves: has 249 elements, expected at most 248\n",
    )
    assert not VALIDATOR.is_valid(document)


def test_more_points_than_the_map_holds(programs: Path, tmp_path: Path) -> None:
    document = report_file()
    slave = document["port"][2]["slaves"][0]
    slave["coils"] = [{"address": address, "ioa": 100000 + address} for address in range(32768)]
    slave["input_registers"] = [{"address": address, "ioa": 200000 + address} for address in range(32768)]
    result = check_document(programs, tmp_path, document)
    assert (result.returncode, result.stderr) == (1, "port: has 65542 objects, expected at most 65535\n")


@dataclass(frozen=True)
class Unusable:
    name: str
    content: bytes
    code: int
    message: str  # after the file's name


UNUSABLE = [
    Unusable("empty", b" \n", 2, ":1:1: is empty, expected an object { }"),
    Unusable("scalar", b"5\n", 2, ":1:1: '[' or '{' expected near '5'"),
    Unusable("excerpt-of-figure-4.9", b'{\n  "port": []\n},\n', 2, ":3:2: end of file expected near ','"),
    Unusable(
        "trailing-comma", b'{"port": [],\n}', 2, ":1:12: is a comma behind the last entry of { }: delete it"
    ),
    Unusable(
        "trailing-comma-of-an-array",
        '{"\u00e4": [1, 2 , ]}'.encode(),
        2,
        ":1:13: is a comma behind the last element of [ ]: delete it",
    ),
    Unusable("comment", b"{\n  // mine\n}", 2, ":2:3: is a comment, which JSON does not have: delete it"),
    Unusable(
        "comment-behind", b"{} /* mine */", 2, ":1:4: is a comment, which JSON does not have: delete it"
    ),
    Unusable(
        "comment-of-a-shell", b"# mine\n{}", 2, ":1:1: is a comment, which JSON does not have: delete it"
    ),
    Unusable(
        "bom",
        b'\xef\xbb\xbf{"port": []}',
        2,
        ":1:1: begins with a byte order mark (BOM): save it as UTF-8 without BOM",
    ),
    Unusable(
        "utf-16", '\ufeff{"port": []}'.encode("utf-16-le"), 2, ':1:1: is UTF-16 ("Unicode"): save it as UTF-8'
    ),
    Unusable(
        "single-quotes",
        b"{'port': []}",
        2,
        ':1:2: is a single quotation mark: write names and texts as "name"',
    ),
    Unusable("no-comma", b'{"port": []\n "tls": {}}', 2, ":2:2: is the next entry: write a comma before it"),
    Unusable("not-utf8", b'{"port": "\xff"}', 2, ":1:10: unable to decode byte 0xff near '\"'"),
    Unusable("cut", b'{"port": [{"value": 1', 2, ":1:21: '}' expected near end of file"),
    Unusable(
        "huge-integer",
        b'{"port": 99999999999999999999}',
        2,
        ":1:29: too big integer near '99999999999999999999'",
    ),
    Unusable("too-large", b" " * (4 * 1024 * 1024 + 1), 2, ": is too large, expected at most 4194304 bytes"),
    Unusable("deep", b"[" * 100000, 2, ":1:2049: maximum parsing depth reached near '['"),
]


@pytest.mark.parametrize("case", UNUSABLE, ids=lambda case: case.name)
def test_not_json(programs: Path, tmp_path: Path, case: Unusable) -> None:
    path = tmp_path / "gateway.json"
    path.write_bytes(case.content)
    result = check(programs, path)
    assert (result.returncode, result.stdout, result.stderr) == (case.code, "", f"{path}{case.message}\n")


def test_key_given_twice_hides_no_other_error(programs: Path, tmp_path: Path) -> None:
    path = tmp_path / "gateway.json"
    path.write_text('{\n "port": [],\n "event_ring": 5,\n "port": []\n}\n')
    result = check(programs, path)
    assert result.returncode == 1
    assert result.stderr.splitlines() == [
        f"{path}:4:7: duplicate object key near '\"port\"'",
        f"{path}:3: event_ring: 5 is out of range, expected 64 to 65536",
    ]


def test_root_is_an_array(programs: Path, tmp_path: Path) -> None:
    result = check_document(programs, tmp_path, [])
    assert (result.returncode, result.stderr) == (1, "the file: is an array, expected an object { }\n")


@pytest.mark.parametrize(
    ("words", "message"),
    [((), "the configuration FILE is missing"), (("a.json", "b.json"), "one argument too many: b.json")],
)
def test_wrong_usage_is_named(programs: Path, words: tuple[str, ...], message: str) -> None:
    result = subprocess.run(
        [programs / "rtud/rtud", "--check", *words], capture_output=True, text=True, check=False
    )
    assert (result.returncode, result.stdout) == (2, "")
    assert result.stderr == f'rtud: {message}\nrtud: try "rtud --help"\n'


def test_unreadable(programs: Path, tmp_path: Path) -> None:
    missing = tmp_path / "missing.json"
    result = check(programs, missing)
    assert (result.returncode, result.stderr) == (
        2,
        f"{missing}: cannot be read: No such file or directory\n",
    )
    result = check(programs, tmp_path)
    assert (result.returncode, result.stderr) == (2, f"{tmp_path}: cannot be read: Is a directory\n")


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
    Site("slave", "port[0].slaves[0]"),
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
    "register": {"address": REMOVED},
    "response_timeout_min_ms": {"response_timeout_ms": 10000},
    "bit_order": {"type": "double"},
    "word_order": {"type": "float"},
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
    device: dict[str, Any] = {"id": 2} | {table: [{"address": 5}] for table in tables}
    device["discrete_inputs"].append({"address": 700})
    device["input_registers"].append({"address": 9, "bit": 3, "ioa": 60003})
    slaves = [{"id": 1}, device]
    ports = [
        {"value": 3, "active": 1, **line, "rs485": {}, "slaves": slaves},
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
        its = ("id", "discrete_inputs", table.partition("[")[0])  # blocked_by names a discrete input
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
        if key in ("ln", "register"):
            values = {
                "ln": [LN_OF.get(site.name(), "MMXU1.TotW")],
                "register": REGISTER_OF.get(site.name()),
            }[key]
        for value in values:
            document = with_key(site, key, value)
            assert [error.message for error in VALIDATOR.iter_errors(document)] == [], (key, value)
            result = check_document(programs, tmp_path, document)
            assert result.returncode == 0, (key, value, result.stderr)


@pytest.mark.sample(15)
@pytest.mark.parametrize("site", SITES, ids=lambda site: site.name() or "file")
def test_wrong_value_of_each_kind_is_named(programs: Path, tmp_path: Path, site: Site) -> None:
    """And the schema refuses it."""
    place = f"{site.place}." if site.place else ""
    for key in site.properties():
        rule = resolved(definition(site.definition)["properties"][key])
        if rule == {} or key in OWN_WORDS:
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


@pytest.mark.parametrize("site", SITES, ids=lambda site: site.name() or "file")
def test_schema_and_loader_require_the_same_keys(programs: Path, tmp_path: Path, site: Site) -> None:
    required = site.required()
    if site.definition == "object":
        required.add("address")  # or register
    target = f"{site.place}." if site.place else ""
    for key in set(site.properties()) - {"active"}:
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
    numbers = {"minimum", "maximum", "exclusiveMinimum", "multipleOf", "maxProperties"}
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


# ---- hostile files -----------------------------------------------------------------------------------------

ODD_VALUES = [None, True, -1, 0, 2**31, 2**63 - 1, 1e308, "", "x" * 300, "\n", [], {}, [[]], {"": 0}]


def places(document: Json, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    children = document.items() if isinstance(document, dict) else enumerate(document)
    for key, child in children:
        yield (*path, key)
        if isinstance(child, dict | list):
            yield from places(child, (*path, key))


def mutate_document(random_source: random.Random, document: Json) -> bytes:
    """Puts odd values, or parts of the file itself, at some places."""
    result = copy.deepcopy(document)
    for _ in range(random_source.randint(1, 4)):
        *path, last = random_source.choice(list(places(result)))
        target = result
        for step in path:
            target = target[step]
        target[last] = copy.deepcopy(random_source.choice([*ODD_VALUES, document["port"], target]))
    return json.dumps(result).encode()


def mutate_bytes(random_source: random.Random, content: bytes) -> bytes:
    result = bytearray(content)
    for _ in range(random_source.randint(1, 6)):
        at = random_source.randrange(len(result))
        result[at : at + random_source.choice([0, 1, 20])] = random_source.randbytes(
            random_source.randint(0, 3)
        )
    return bytes(result)


@pytest.mark.slow
def test_fuzz(asan_programs: Path, tmp_path: Path) -> None:
    content = EVERY_KEY.read_bytes()
    document = json.loads(content)
    path = tmp_path / "gateway.json"
    for seed in range(200):
        random_source = random.Random(seed)
        mutants = [mutate_document(random_source, document), mutate_bytes(random_source, content)]
        path.write_bytes(mutants[seed % 2])
        result = check(asan_programs, path)
        assert result.returncode in (0, 1, 2), (seed, result.stderr)
        assert "ERROR: AddressSanitizer" not in result.stderr, (seed, result.stderr)
        assert "runtime error" not in result.stderr, (seed, result.stderr)
