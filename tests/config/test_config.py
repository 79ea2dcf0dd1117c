# SPDX-License-Identifier: GPL-3.0-or-later
"""rtud --check against the report's file, good ones, wrong ones, and hostile ones."""

import copy
import json
import random
import re
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from rig.configuration import (
    EVERY_KEY,
    EXAMPLES,
    LIMIT_PAGE,
    REMOVED,
    REPORT,
    ROOT,
    VALIDATOR,
    Json,
    check,
    check_document,
    edit,
    report_file,
)

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


@pytest.mark.sample(6)
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


@pytest.mark.sample(6)
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


@pytest.mark.slow
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
