# SPDX-License-Identifier: GPL-3.0-or-later
"""Templates, included files, the list of points, and the way back from it."""

import codecs
import csv
import io
import json
import os
import re
import subprocess
from pathlib import Path
from typing import Any

import pytest

from lab.gateway import Gateway, free_port, listening_on, remove, run_directory
from lab.linesim import LineSim
from lab.master import Master
from rig.configuration import VALIDATOR

ROOT = Path(__file__).resolve().parents[2]
PLANT = ROOT / "docs/examples/plant.json"
UNITS = 20  # of a connection
TEMPLATES = sorted((ROOT / "package/openrtu/src/templates").rglob("*.json"))
LISTED = [PLANT, ROOT / "docs/examples/every-key.json", ROOT / "tests/fixtures/chapter5/gateway.json"]
OPENRTU = ROOT / "scripts/openrtu"
LINE = {"active": 1, "baud_rate": 9600, "data_bits": 8, "stop_bits": 1, "parity": 0}
METER = {
    "input_registers": [
        {"address": 0, "name": "u", "type": "float", "unit": "V"},
        {"address": 2, "name": "fault", "bit": 3, "ioa": 7},
        {"address": 3, "name": "p", "blocked_by": "fault"},
    ]
}


def rtud(programs: Path, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
    command = [programs / "rtud/rtud", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=20, check=False)


def back(points: Path, lines: Path) -> subprocess.CompletedProcess[str]:
    command = [OPENRTU, "points", points, "--lines", lines]
    return subprocess.run(command, capture_output=True, text=True, timeout=20, check=False)


def plant_of(*slaves: dict[str, Any], **file: Any) -> dict[str, Any]:
    return {**file, "port": [{"value": 1, **LINE, "slaves": list(slaves)}]}


def write(path: Path, document: Any) -> Path:
    """One key or element a line, so that lines tell places apart."""
    path.write_text(json.dumps(document, indent=1))
    return path


def line_of(path: Path, text: str) -> int:
    return next(i for i, line in enumerate(path.read_text().splitlines(), 1) if text in line)


# ---- templates ---------------------------------------------------------------------------------------------


def test_the_plant_has_3_lines_20_devices_and_186_points(programs: Path) -> None:
    result = rtud(programs, "--check", PLANT)
    assert (result.returncode, result.stderr) == (0, "")
    assert result.stdout.splitlines()[0] == f"{PLANT}: good: lines 3, devices 20, points 186"


def test_templates_that_come_with_it_are_good(programs: Path, tmp_path: Path) -> None:
    """All at once, as templates of one file: it may include 32 others at most."""
    templates = {}
    for path in TEMPLATES:
        templates |= json.loads(path.read_text())["templates"]
    slaves = [
        {"id": 1 + i % UNITS, "template": name, "name_prefix": f"{i}/", "ca": 1 + i, "period_ms": 10000}
        for i, name in enumerate(templates)
    ]
    ports = [
        {
            "value": 7 + first // UNITS,
            "active": 1,
            "host": f"192.0.2.{1 + first}",
            "slaves": slaves[first : first + UNITS],
        }
        for first in range(0, len(slaves), UNITS)
    ]
    file = write(tmp_path / "gateway.json", {"templates": templates, "port": ports})
    result = rtud(programs, "--check", file)
    assert (result.returncode, result.stderr) == (0, "")
    assert len(TEMPLATES) > 150


def test_an_instance_overrides_leaves_out_and_adds(programs: Path, tmp_path: Path) -> None:
    two = {
        "id": 2,
        "template": "meter",
        "ca": 77,
        "name_prefix": "f2/",
        "ioa_offset": 100,
        "overrides": {"u": {"unit": "kV", "scale": 0.001}, "p": None},
        "coils": [{"address": 0, "name": "reset"}],
    }
    one = {"id": 1, "template": "meter", "ca": 77, "name_prefix": "f1/"}
    file = write(tmp_path / "gateway.json", plant_of(one, two, templates={"meter": METER}))
    listed = rtud(programs, "--points", "--markdown", file).stdout.splitlines()[2:]
    assert [[cell.strip() for cell in row.split("|")[1:-1]] for row in listed] == [
        ["77", "7", "M_SP_NA_1", "M_SP_TB_1", "", "f1/fault", "", "monitor", "", "p1.1"],
        ["77", "101", "M_SP_NA_1", "M_SP_TB_1", "C_SC_NA_1", "f2/reset", "", "both", "", "p1.2"],
        ["77", "107", "M_SP_NA_1", "M_SP_TB_1", "", "f2/fault", "", "monitor", "", "p1.2"],
        ["77", "30001", "M_ME_NC_1", "M_ME_TF_1", "", "f1/u", "V", "monitor", "", "p1.1"],
        ["77", "30004", "M_ME_NB_1", "M_ME_TE_1", "", "f1/p", "", "monitor", "", "p1.1"],
        ["77", "30101", "M_ME_NC_1", "M_ME_TF_1", "", "f2/u", "kV", "monitor", "", "p1.2"],
    ]


def test_an_instance_names_a_register_instead_of_an_address(programs: Path, tmp_path: Path) -> None:
    """And the other way round: what the slave says goes before what the template says."""
    overrides = {"u": {"register": "30101"}, "i": {"address": 200}}
    objects = [
        {"address": 0, "name": "u"},
        {"register": "30003", "name": "i"},
        {"register": "30004", "name": "p"},
    ]
    slave = {"id": 1, "template": "meter", "overrides": overrides}
    file = write(
        tmp_path / "gateway.json", plant_of(slave, templates={"meter": {"input_registers": objects}})
    )
    rows = csv.DictReader(io.StringIO(rtud(programs, "--points", "--csv", file).stdout))
    assert {row["name"]: (row["address"], row["ioa"]) for row in rows} == {
        **{"u": ("100", "30101"), "i": ("200", "30201"), "p": ("3", "30004")}
    }


def test_numbers_are_listed_with_the_fewest_digits(programs: Path, tmp_path: Path) -> None:
    objects = [
        {"address": 0, "scale": 0.1, "offset": -273.15},
        {
            "address": 1,
            "type": "float",
            "format": "uint16",
            "scale_points": [[0, 0.3], [1, 1.0000000000000002]],
        },
    ]
    file = write(tmp_path / "gateway.json", plant_of({"id": 1, "input_registers": objects}))
    first, second = csv.DictReader(io.StringIO(rtud(programs, "--points", "--csv", file).stdout))
    assert (first["scale"], first["offset"]) == ("0.1", "-273.15")
    assert second["scale_points"] == "[[0,0.3],[1,1.0000000000000002]]"


def test_errors_name_the_templates_line_and_the_slave(programs: Path, tmp_path: Path) -> None:
    broken = json.loads(json.dumps(METER))
    broken["input_registers"][0]["scale"] = 0
    included = write(tmp_path / "meter.json", {"templates": {"meter": broken}})
    slaves = [{"id": unit, "template": "meter", "name_prefix": f"{unit}/"} for unit in (1, 2)]
    file = write(tmp_path / "gateway.json", plant_of(*slaves, include=["meter.json"]))
    result = rtud(programs, "--check", file)
    assert result.returncode == 1
    assert result.stderr == (
        f"{included}:{line_of(included, 'scale')}: templates.meter.input_registers[0].scale: is 0, "
        f"expected another number; for port[0].slaves[0] ({file}:{line_of(file, 'slaves') + 1})\n"
    )


def test_a_clash_names_both_places(programs: Path, tmp_path: Path) -> None:
    slaves = [{"id": unit, "template": "meter", "name_prefix": f"{unit}/", "ca": 5} for unit in (1, 2)]
    file = write(tmp_path / "gateway.json", plant_of(slaves[0], templates={"meter": METER}))
    assert rtud(programs, "--check", file).returncode == 0
    file = write(tmp_path / "gateway.json", plant_of(*slaves, templates={"meter": METER}))
    messages = rtud(programs, "--check", file).stderr.splitlines()
    assert len(messages) == 3
    second = line_of(file, '"id": 2') - 1
    bit = f"{file}:{line_of(file, 'fault') - 2}"
    assert messages[0] == (
        f"{bit}: templates.meter.input_registers[1]: has the CA 5 and IOA 7 of "
        f"templates.meter.input_registers[1] ({bit}, for port[0].slaves[0]); "
        f"for port[0].slaves[1] ({file}:{second})"
    )


def covered(programs: Path, path: Path, *registers: dict[str, Any]) -> list[list[str]]:
    """Of each message: the objects that cover something twice."""
    file = write(path / "gateway.json", plant_of({"id": 1, "input_registers": list(registers)}))
    messages = rtud(programs, "--check", file).stderr.splitlines()
    return [re.findall(r"input_registers\[(\d)\]", message) for message in messages]


def test_a_register_is_a_value_and_fields_and_bits(programs: Path, tmp_path: Path) -> None:
    registers = [
        {"address": 5, "format": "int64"},
        {"address": 6, "ioa": 1, "bit": 1},
        {"address": 6, "ioa": 2, "bits": [1, 3]},
        {"address": 8, "ioa": 3, "bits": [0, 7]},
        {"address": 8, "ioa": 4, "bits": [8, 14]},
        {"address": 8, "ioa": 5, "bits": [15, 15], "name": "one"},
        {"address": 8, "ioa": 6, "bit": 15},
    ]
    assert covered(programs, tmp_path, *registers) == []
    table = rtud(programs, "--points", "--csv", tmp_path / "gateway.json").stdout
    assert {row["name"]: row["bits"] for row in csv.DictReader(io.StringIO(table))} == {
        "p1.1.i5": "",
        "p1.1.i6.1": "",
        "p1.1.i6.1-3": "[1,3]",
        "p1.1.i8.0-7": "[0,7]",
        "p1.1.i8.8-14": "[8,14]",
        "one": "[15,15]",
        "p1.1.i8.15": "",
    }


def test_no_bit_of_a_register_is_two_of_a_kind(programs: Path, tmp_path: Path) -> None:
    registers = [
        {"address": 5, "format": "int64"},
        {"address": 8, "ioa": 1},
        {"address": 9, "ioa": 2, "bit": 1},
        {"address": 9, "ioa": 3, "bit": 2},
        {"address": 9, "ioa": 4, "bit": 1, "type": "double"},
        {"address": 9, "ioa": 5, "bits": [0, 4]},
        {"address": 9, "ioa": 6, "bits": [4, 7]},
        {"address": 8, "ioa": 7, "bits": [0, 15]},  # the whole of it
    ]
    assert covered(programs, tmp_path, *registers) == [
        ["1", "0"],
        ["7", "1"],
        ["6", "5"],
        ["4", "2"],
        ["3", "4"],
    ]


INCLUDES = {
    "missing": ({"a.json": {"include": ["b.json"]}}, 'include[0]: "{d}/b.json" cannot be read: No such file'),
    "itself": ({"a.json": {"include": ["a.json"]}}, 'include[0]: "{d}/a.json" includes itself here'),
    "circle": (
        {"a.json": {"include": ["b.json"]}, "b.json": {"include": ["./a.json"]}},
        'include[0]: "{d}/./a.json" includes itself here',
    ),
    "no-json": ({"a.json": {"include": ["pipe"]}}, 'include[0]: "{d}/pipe" is not a regular file'),
    "port": ({"a.json": {"port": []}}, "port: unknown key, expected one of include, templates, about"),
    "number": ({"a.json": {"include": [5]}}, "include[0]: is not a file name, expected a string"),
    "name-twice": (
        {"a.json": {"templates": {"m": {}}, "include": ["b.json"]}, "b.json": {"templates": {"m": {}}}},
        "templates.m: has the name of templates.m ({d}/a.json:3)",
    ),
    "deep": (
        {f"{'abcdefghijk'[i]}.json": {"include": [f"{'abcdefghijk'[i + 1]}.json"]} for i in range(10)},
        "include[0]: is one file too many, expected at most 8, each included by the one before",
    ),
}


@pytest.mark.parametrize("name", INCLUDES)
def test_included_files_that_are_wrong(programs: Path, tmp_path: Path, name: str) -> None:
    files, message = INCLUDES[name]
    os.mkfifo(tmp_path / "pipe")
    for path, document in files.items():
        write(tmp_path / path, document)
    result = rtud(programs, "--check", write(tmp_path / "gateway.json", plant_of(include=["a.json"])))
    assert result.returncode == 1
    assert message.format(d=tmp_path) in result.stderr


def test_a_file_is_included_once_by_two(programs: Path, tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    write(tmp_path / "meter.json", {"templates": {"meter": METER}})
    write(tmp_path / "sub/a.json", {"include": ["../meter.json"]})
    slave = {"id": 1, "template": "meter"}
    file = write(tmp_path / "gateway.json", plant_of(slave, include=["sub/a.json", "meter.json"]))
    result = rtud(programs, "--check", file)
    assert (result.returncode, result.stderr) == (0, "")


def test_included_json_that_is_none_says_where(programs: Path, tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text('{\n "templates": {]\n}\n')
    result = rtud(programs, "--check", write(tmp_path / "gateway.json", plant_of(include=["a.json"])))
    assert (result.returncode, result.stderr) == (
        1,
        f"{tmp_path}/a.json:2:16: string or '}}' expected near ']'\n",
    )


@pytest.mark.parametrize(
    ("slave", "message"),
    [
        ({"template": "meters"}, "template: there is no template with this name"),
        (
            {"template": "meter", "overrides": {"v": {}}},
            "overrides.v: is not the name of an object of the template",
        ),
        ({"template": "meter", "overrides": {"u": 5}}, "overrides.u: is neither an object { }"),
        ({"overrides": {"u": {}}}, "overrides.u: is not the name of an object of the template"),
        ({"template": "meter", "name_prefix": "a b"}, "name_prefix: has a space or one of"),
        ({"template": "meter", "name_prefix": "x" * 38}, "name: is longer than 39 bytes with its slave's"),
        ({"template": "meter", "ioa_offset": 16777214}, "ioa: 16807215 is out of range with its slave's"),
        ({"template": "meter", "id": 0}, "template: has no meaning for slave 0"),
        (
            {"id": 0, "holding_registers": [{"address": 0, "scale_register": 1}]},
            "scale_register: has no meaning for slave 0: the broadcast address is never read",
        ),
        (
            {"id": 0, "holding_registers": [{"address": 0, "write_address": 1}]},
            "write_address: has no meaning for slave 0: the broadcast address is never read",
        ),
        *(
            ({"identification": {"input_registers": [[1, 2], known]}}, "[1]: is not a register's")
            for known in ([1], [1, 65536], [-1, 2], [1, 2.5], [1, "x"], 5, [1] * 34)
        ),
        ({"identification": {"holding_registers": [[1, 2]] * 17}}, "holding_registers: has 17 elements"),
    ],
)
def test_slaves_of_a_template_that_are_wrong(
    programs: Path, tmp_path: Path, slave: dict[str, Any], message: str
) -> None:
    file = write(tmp_path / "gateway.json", plant_of({"id": 1, **slave}, templates={"meter": METER}))
    result = rtud(programs, "--check", file)
    assert result.returncode == 1
    assert message in result.stderr


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"bit": 1}, "ioa: is missing: a bit of a register has no IOA by itself, expected an integer"),
        ({"bit": 15, "type": "double", "ioa": 1}, "bit: 15 is out of range for type double"),
        ({"bit": 1, "type": "scaled", "ioa": 1}, "type: bits hold no"),
        (
            {"bit": 1, "ioa": 1, "short_pulse_ms": 50},
            "short_pulse_ms: has no meaning for a bit of a register",
        ),
        ({"format": "int64", "address": 65533, "ioa": 1}, "which covers four addresses, expected 0 to 65532"),
        ({"format": "int32", "type": "bitstring"}, 'format: "int32" is not a format of type bitstring'),
        ({"format": "int16", "signed": True}, "signed: has no meaning beside format"),
        ({"format": "int16", "word_order": "big"}, "word_order: has no meaning for format int16"),
        ({"format": "float32", "unimplemented": True}, "unimplemented: has no meaning for floating point"),
        ({"type": "counter", "scale": 2}, "scale: has no meaning for a counter that wraps"),
        ({"scale_register": 0}, "scale_register: 0 is a register of the object itself, expected another"),
        ({"scale_register": 1, "type": "float"}, "scale_register: 1 is a register of the object itself"),
        ({"scale_register": 125}, "is read with 126 registers at once, which is more than max_registers"),
        ({"scale_register": 5, "type": "counter"}, "scale_register: has no meaning for a counter that wraps"),
        ({"scale_register": 5, "type": "step"}, "scale_register: has no meaning for type step"),
        ({"scale": 2, "scale_points": [[0, 0], [1, 1]]}, "scale_points: has no meaning beside scale"),
        ({"scale_points": [[0, 0]]}, "scale_points: has 1 elements, expected two pairs"),
        ({"scale_points": [[0, 5], [1, 5]]}, "scale_points: has the same value twice"),
        ({"scale_table": [[0, 0], [0, 1]]}, "scale_table[1]: has no raw value above"),
        ({"scale_table": [[0, 0], [1, "x"]]}, "scale_table[1]: is not a pair [raw, value] of numbers"),
        ({"scale_table": [[0, 0], [1, 1], [2, 0]]}, "scale_table: must rise all the way or fall all the way"),
        ({"inverted": True}, "inverted: has no meaning for type scaled"),
        ({"bits": [0, 3]}, "ioa: is missing: a bit of a register has no IOA by itself"),
        ({"bits": [0, 16], "ioa": 1}, "bits: is not the first and the last bit of a register"),
        ({"bits": [3, 0], "ioa": 1}, "bits: is not the first and the last bit of a register"),
        ({"bits": [3], "ioa": 1}, "bits: is not the first and the last bit of a register"),
        ({"bits": [0, 3], "ioa": 1, "format": "int32"}, "bits: has no meaning for format int32"),
        ({"bits": [0, 3], "ioa": 1, "signed": False}, "signed: has no meaning beside bits"),
        ({"bits": [0, 3], "ioa": 1, "type": "counter"}, "bits: has no meaning for type counter"),
        ({"bits": [0, 3], "ioa": 1, "bit": 1}, "bits: has no meaning for type single"),
        ({"bits": [0, 3], "ioa": 1, "word_order": "big"}, "word_order: has no meaning for"),
        ({"format": "string"}, "length: is missing: a text needs the number of its registers"),
        ({"length": 4}, "length: has no meaning: it is of texts, expected format string or string16"),
        ({"format": "string", "length": 33}, "length: 33 is out of range"),
        ({"format": "string", "length": 9, "address": 65528, "ioa": 1}, "covers 9 addresses, expected 0 to"),
        ({"format": "string", "length": 4, "type": "float"}, '"string" is a text, which type float does not'),
        ({"format": "string16", "length": 4, "select": True}, "select: has no meaning for a text (format"),
        ({"format": "string", "length": 4, "write_address": 9}, "write_address: has no meaning for a text"),
        ({"format": "string", "length": 4, "names": {"0": "off"}}, "names: has no meaning for a text"),
        ({"format": "string", "length": 4, "scale": 2}, "scale: has no meaning for a text (format string)"),
        ({"format": "string", "length": 4, "word_order": "big"}, "word_order: has no meaning for a text"),
        ({"page": 1}, "page: has no meaning without page_address of its slave, which says where it is"),
        ({"page": 1, "select": True}, "select: has no meaning beside page: what is on a page takes no"),
        ({"page": 1, "write_only": True}, "write_only: has no meaning beside page"),
        (
            {"read_only": True, "step": 1, "min": 0, "max": 9},
            "step: has no meaning beside read_only: it takes",
        ),
        ({"read_only": True, "write_address": 5}, "write_address: has no meaning beside read_only"),
        ({"type": "counter", "format": "fixed24_8"}, '"fixed24_8" is not a format of type counter'),
        ({"type": "counter", "format": "bcd32", "scale": 2}, "scale: has no meaning for a counter"),
        ({"format": "bcd16", "unimplemented": True}, "unimplemented: has no meaning for format bcd16"),
        ({"format": "uint48", "address": 65534, "ioa": 1}, "which covers three addresses, expected 0"),
        ({"write_address": 65535, "type": "float"}, "write_address: 65535 is out of range for type float"),
        ({"write_only": True, "write_address": 5}, "write_address: has no meaning beside write_only"),
        ({"write_only": True, "period_ms": 500}, "period_ms: has no meaning beside write_only"),
        ({"write_only": True, "step": 1, "min": 0, "max": 9}, "step: has no meaning beside write_only"),
        ({"write_only": True, "read_back": False}, "read_back: has no meaning beside write_only"),
        (
            {"write_values": [1]},
            "write_values: are never written, expected write_at_return true or write_every_ms",
        ),
        ({"write_values": [1], "write_at_return": False}, "write_values: are never written, expected"),
        ({"write_values": [], "write_every_ms": 100}, "write_values: is empty, expected at least one"),
        ({"write_values": [1, "x"], "write_every_ms": 100}, "write_values[1]: is no number"),
        (
            {"write_values": [1, 40000], "write_every_ms": 100},
            "write_values[1]: 40000 is beyond what the object can",
        ),
        (
            {"write_values": [5], "write_every_ms": 100, "min": 0, "max": 4},
            "write_values[0]: 5 is beyond what",
        ),
        ({"scale_by": "power"}, '"power" is not a number for this object, expected the name of another'),
        ({"scale_by": "p3.1.h0"}, '"p3.1.h0" is not a number for this object'),  # its own
        ({"scale_by": "a", "scale_register": 5}, "scale_by: has no meaning beside scale_register"),
        ({"factor_by": "a", "scale_table": [[0, 0], [1, 1]]}, "factor_by: has no meaning beside scale_table"),
        ({"factor_by": "a", "type": "step"}, "factor_by: has no meaning for type step"),
        ({"names": {}}, "names: has 0 names, expected 1 to 64"),
        ({"names": {"01": "a"}}, 'names.01: is no value of type scaled, expected an integer as "3"'),
        ({"names": {"40000": "a"}}, "names.40000: is no value of type scaled"),
        ({"names": {"x": "a"}}, "names.x: is no value of type scaled"),
        ({"names": {"1": ""}}, "names.1: is no name, expected a string of 1 to 31 printable bytes"),
        ({"names": {"1": 5}}, "names.1: is no name, expected a string"),
        ({"names": {"1": "a\tb"}}, "names.1: is no name, expected a string"),
        ({"names": {"1": "x" * 32}}, "names.1: is no name, expected a string"),
        ({"names": {"1": "off", "2": "off"}}, 'names.2: "off" is the name of another value'),
        ({"names": {"1": "a"}, "type": "normalized"}, "names: has no meaning for type normalized"),
        ({"bit": 1, "ioa": 1, "names": {"2": "a"}}, "names.2: is no value of type single"),
        ({"type": "counter", "write_every_ms": 100}, "write_every_ms: has no meaning for type counter"),
        (
            {"write_values": [1], "write_every_ms": 100, "scale_register": 5},
            "write_values: has no meaning beside scale_register",
        ),
        (
            {"write_only": True, "write_at_return": True},
            "holding_registers[0]: is to be written when its slave answers, which has no object that is read",
        ),
    ],
)
def test_values_that_do_not_go_together(
    programs: Path, tmp_path: Path, keys: dict[str, Any], message: str
) -> None:
    registers = [{"address": 0, **keys}]
    file = write(tmp_path / "gateway.json", plant_of({"id": 1, "holding_registers": registers}))
    result = rtud(programs, "--check", file)
    assert result.returncode == 1
    assert message in result.stderr


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"select": True}, "select: has no meaning for input_registers: they cannot be commanded"),
        ({"write_every_ms": 500}, "write_every_ms: has no meaning for input_registers: they cannot be"),
        ({"write_only": True}, "write_only: has no meaning for input_registers, which cannot be written"),
        ({"write_address": 9, "write_only": False}, "write_only: has no meaning for input_registers"),
        ({"read_only": True}, "read_only: has no meaning for input_registers, which cannot be written"),
        ({"write_address": 9, "scale_table": [[0, 0], [1, 1], [2, 0]]}, "must rise all the way"),
    ],
)
def test_what_is_only_read(programs: Path, tmp_path: Path, keys: dict[str, Any], message: str) -> None:
    registers = [{"address": 0, **keys}]
    file = write(tmp_path / "gateway.json", plant_of({"id": 1, "input_registers": registers}))
    result = rtud(programs, "--check", file)
    assert result.returncode == 1
    assert message in result.stderr


@pytest.mark.parametrize(
    ("own", "others", "said"),
    [
        ({}, {}, ""),
        ({}, {"period_ms": 1000}, ""),
        ({"period_ms": 1000}, {"period_ms": 500}, ""),
        (
            {"period_ms": 1000},
            {"period_ms": 1000},
            '"places" is not read before this object, expected one with',
        ),
        (
            {"period_ms": 1000},
            {},
            '"places" is not read before this object, expected one with a shorter period',
        ),
    ],
)
def test_what_scales_is_read_before(
    programs: Path, tmp_path: Path, own: dict[str, Any], others: dict[str, Any], said: str
) -> None:
    scaled, places = {"address": 0, "scale_by": "places"} | own, {"address": 0, "name": "places"} | others
    slave = {"id": 1, "holding_registers": [scaled], "input_registers": [places]}
    result = rtud(programs, "--check", write(tmp_path / "gateway.json", plant_of(slave)))
    assert said in result.stderr
    assert result.returncode == (1 if said else 0)


@pytest.mark.parametrize(
    ("address", "slave", "said"),
    [
        (1, {}, ""),
        (9, {"holes": False}, '"places" is not read before this object'),
        (9, {}, ""),
        (1, {"max_registers": 1}, '"places" is not read before this object'),
    ],
    ids=["neighbours", "apart", "over a hole", "one at a time"],
)
def test_what_scales_is_read_with_it(
    programs: Path, tmp_path: Path, address: int, slave: dict[str, Any], said: str
) -> None:
    registers = [{"address": address, "name": "places"}, {"address": 0, "scale_by": "places"}]
    every = {"id": 1, "period_ms": 1000, "holding_registers": registers} | slave
    result = rtud(programs, "--check", write(tmp_path / "gateway.json", plant_of(every)))
    assert said in result.stderr
    assert result.returncode == (1 if said else 0)


def test_a_pulse_that_is_overwritten_is_noted(programs: Path, tmp_path: Path) -> None:
    coil = {"address": 0, "short_pulse_ms": 500, "write_values": [0]}
    for keys, noted in (({"write_every_ms": 1000}, True), ({"write_at_return": True}, False)):
        file = write(tmp_path / "gateway.json", plant_of({"id": 1, "coils": [coil | keys]}))
        result = rtud(programs, "--check", file)
        assert result.returncode == 0
        said = "coils[0].write_every_ms: what is written each 1000 ms overwrites a commanded pulse"
        assert (said in result.stderr) == noted


@pytest.mark.parametrize(
    ("key", "text", "type_", "fits"),
    [
        ("32767", "top", "scaled", True),
        ("32768", "top", "scaled", False),
        ("-32768", "least", "scaled", True),
        ("2147483647", "top", "float", True),
        ("2147483648", "top", "float", False),
        ("-2147483648", "least", "float", True),
        ("2147479999", "high", "float", True),
        ("-1", "none", "bitstring", False),
        ("-64", "low", "step", True),
        ("64", "high", "step", False),
        ("1", "1e3", "scaled", False),
        ("1", "0x1f", "scaled", False),
        ("1", "nan", "scaled", False),
        ("1", "Infinity", "scaled", False),
        ("1", "infinite", "scaled", True),
        ("1", "3 phases", "scaled", True),
        ("1", "a\tb", "scaled", False),
    ],
)
def test_schema_and_rtud_take_the_same_names(
    programs: Path, tmp_path: Path, key: str, text: str, type_: str, fits: bool
) -> None:
    register = {"address": 0, "type": type_, "names": {key: text}}
    plant = plant_of({"id": 1, "holding_registers": [register]})
    result = rtud(programs, "--check", write(tmp_path / "gateway.json", plant))
    assert (result.returncode == 0) == fits
    assert VALIDATOR.is_valid(plant) == fits


def test_list_of_points_has_every_key_of_an_object(programs: Path) -> None:
    head = rtud(programs, "--points", "--csv", ROOT / "docs/examples/every-key.json").stdout.splitlines()[0]
    schema = json.loads(rtud(programs, "--schema").stdout)
    said_elsewhere = {"register", "quality"}  # as its address, as its type
    assert set(schema["$defs"]["object"]["properties"]) - said_elsewhere <= set(head.split(","))


def test_messages_without_end_are_counted(programs: Path, tmp_path: Path) -> None:
    slave = {"id": 1, "coils": [{"address": -1}] * 1000}
    file = write(tmp_path / "gateway.json", plant_of(slave))
    messages = rtud(programs, "--check", file).stderr.splitlines()
    assert len(messages) == 201
    assert messages[-1] == f"{file}: 800 more messages are not shown"


# ---- the list of points ------------------------------------------------------------------------------------


def test_csv_says_what_a_control_centre_asks_for(programs: Path) -> None:
    head, *rows = rtud(programs, "--points", "--csv", PLANT).stdout.splitlines()
    assert head.startswith(
        "ca,ioa,type,event_type,command_type,name,unit,direction,group,device,port,id,table,"
    )
    assert len(rows) == 186
    addresses = [tuple(map(int, row.split(",")[:2])) for row in rows]
    assert addresses == sorted(set(addresses))
    assert (
        "11,40301,M_ME_NC_1,M_ME_TF_1,C_SE_NC_1,11/feeder1/limit,A,both,,Feeder 11.1,1,11,holding_registers,0"
        in "\n".join(rows)
    )


@pytest.mark.sample(3)
@pytest.mark.parametrize("path", LISTED, ids=lambda path: path.name)
def test_from_csv_and_back_is_the_same(programs: Path, tmp_path: Path, path: Path) -> None:
    listed = rtud(programs, "--points", "--csv", path).stdout
    points = tmp_path / "points.csv"
    points.write_text(listed)
    made = back(points, path)
    assert (made.returncode, made.stderr) == (0, "")
    file = tmp_path / "made.json"
    file.write_text(made.stdout)
    assert rtud(programs, "--points", "--csv", file).stdout == listed
    points.write_text("\ufeff" + listed.replace(",", ";")) if '"' not in listed else None
    again = back(points, path)
    assert (again.returncode, again.stdout) == (0, made.stdout)


def test_from_csv_a_device_keeps_what_its_template_says_of_it(programs: Path, tmp_path: Path) -> None:
    meter = {"max_registers": 2, "retries": 3, "period_ms": 500, **METER}
    write(tmp_path / "meter.json", {"include": ["more.json"], "templates": {"meter": meter}})
    write(tmp_path / "more.json", {"templates": {"other": {"holes": False}}})
    slaves = [
        {"id": 1, "template": "meter", "retries": 5},
        {"id": 2, "template": "other", "coils": [{"address": 0}]},
    ]
    file = write(tmp_path / "gateway.json", plant_of(*slaves, include=["meter.json"]))
    points = tmp_path / "points.csv"
    points.write_text(rtud(programs, "--points", "--csv", file).stdout)
    made = json.loads(back(points, file).stdout)["port"][0]["slaves"]
    assert [
        {key: slave.get(key) for key in ("max_registers", "retries", "holes", "template")} for slave in made
    ] == [
        {"max_registers": 2, "retries": 5, "holes": None, "template": None},
        {"max_registers": None, "retries": None, "holes": False, "template": None},
    ]


@pytest.mark.sample(3)
@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("M_SP_NA_1", "M_XX_NA_1", 'type: "M_XX_NA_1" is not known'),
        ("coils", "coil", 'table: "coil" is not known, expected one of coils'),
        (",p3.67,3,", ",p3.67,x,", 'port: "x" is not an integer'),
        (",p3.67,3,", ",p3.67,5,", "there is no port 5 in the file of lines"),
        ("3067,1,", "3068,1,", "ca: 3067 is not that of the slave's other points, 3068"),
        (",coils,0", ",coils,a", 'address: "a" is not a number, truth value or array'),
        (",coils,0", ",coils,0,1", "has another number of cells than the first line"),
    ],
)
def test_wrong_csv_says_file_and_line(tmp_path: Path, old: str, new: str, message: str) -> None:
    head = "ca,ioa,type,event_type,command_type,name,unit,direction,group,device,port,id,table,address\n"
    rows = "3067,1,M_SP_NA_1,,,a,,,,p3.67,3,67,coils,0\n3067,2,M_SP_NA_1,,,b,,,,p3.67,3,67,coils,1\n"
    points = tmp_path / "points.csv"
    points.write_text(head + rows.replace(old, new, 1))
    lines = write(tmp_path / "lines.json", {"port": [{"value": 3, **LINE, "slaves": []}]})
    result = back(points, lines)
    assert (result.returncode, result.stdout) == (1, "")
    assert re.fullmatch(
        rf"{re.escape(str(points))}:[23]: {re.escape(message)}.*", result.stderr.splitlines()[0]
    )


@pytest.mark.slow
def test_a_port_that_is_missing_is_named_once(tmp_path: Path) -> None:
    points = tmp_path / "points.csv"
    head = "ca,ioa,type,event_type,command_type,name,unit,direction,group,device,port,id,table,address\n"
    points.write_text(
        head
        + "".join(
            f"3067,{ioa},M_SP_NA_1,,,n{ioa},,,,d,{port},67,coils,{ioa}\n"
            for ioa, port in ((1, 1), (2, 1), (3, 2))
        )
    )
    lines = write(tmp_path / "lines.json", {"port": [{"value": 3, **LINE, "slaves": []}]})
    said = [
        f"{points}:{line}: there is no port {port} in the file of lines" for line, port in ((2, 1), (4, 2))
    ]
    assert back(points, lines).stderr.splitlines() == said


def as_in_excel(listed: str, delimiter: str, *, decimal_comma: bool) -> str:
    """The CSV as a spreadsheet saves it: delimiter, decimals, truth values, empty cells."""
    out = io.StringIO(newline="")
    writer = csv.writer(out, delimiter=delimiter, lineterminator="\r\n")
    for row in csv.reader(io.StringIO(listed)):
        cells = [cell.upper() if cell in ("true", "false") else cell for cell in row]
        if decimal_comma:
            cells = [re.sub(r"^(-?\d+)\.(\d+)$", r"\1,\2", cell) for cell in cells]
        writer.writerow([*cells, ""])
    return out.getvalue()


SPREADSHEETS = {
    "Unicode text": ("utf-16", "\t", True),
    "CSV UTF-8 of Germany": ("utf-8-sig", ";", True),
    "CSV of Germany": ("cp1252", ";", True),
    "CSV UTF-8": ("utf-8-sig", ",", False),
    "CSV": ("cp1252", ",", False),
    "UTF-16, big end first": ("utf-16-be", ";", True),
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", SPREADSHEETS)
def test_what_spreadsheets_write_is_read(programs: Path, tmp_path: Path, kind: str) -> None:
    encoding, delimiter, decimal_comma = SPREADSHEETS[kind]
    listed = rtud(programs, "--points", "--csv", ROOT / "docs/examples/every-key.json").stdout
    lines = ROOT / "docs/examples/every-key.json"
    points = tmp_path / "points.csv"
    points.write_text(listed)
    expected = json.loads(back(points, lines).stdout)
    saved = as_in_excel(listed, delimiter, decimal_comma=decimal_comma)
    assert not decimal_comma or "0,1" in saved
    assert "°C" in saved
    mark = codecs.BOM_UTF16_BE if encoding == "utf-16-be" else b""
    points.write_bytes(mark + saved.encode(encoding))
    made = back(points, lines)
    assert (made.returncode, made.stderr) == (0, "")
    assert json.loads(made.stdout) == expected


HEAD = "ca,ioa,type,name,port,id,table,register"


def test_a_manuals_number_keeps_its_noughts(tmp_path: Path) -> None:
    points = tmp_path / "points.csv"
    points.write_text(
        f"{HEAD}\n3067,1,M_SP_NA_1,a,3,67,coils,1\n3067,2,M_ME_NB_1,b,3,67,holding_registers,400001\n"
    )
    made = back(points, write(tmp_path / "lines.json", {"port": [{"value": 3, **LINE}]}))
    slave = json.loads(made.stdout)["port"][0]["slaves"][0]
    assert (slave["coils"][0]["register"], slave["holding_registers"][0]["register"]) == ("00001", "400001")


def test_a_comma_that_may_be_thousands_is_refused(tmp_path: Path) -> None:
    points = tmp_path / "points.csv"
    points.write_text(f'{HEAD},scale\n3067,1,M_ME_NB_1,a,3,67,holding_registers,40001,"1,234"\n')
    result = back(points, write(tmp_path / "lines.json", {"port": [{"value": 3, **LINE}]}))
    said = f'{points}:2: scale: "1,234" has a comma: write the number with a point, or without it\n'
    assert (result.returncode, result.stderr) == (1, said)


UNUSABLE = {
    "neither": (
        b"ca,ioa\n1,\x81",
        ':2: has a character that is neither UTF-8 nor Windows-1252: save it as "CSV UTF-8"',
    ),
    "workbook": (b"PK\x03\x04\0", ': is a workbook: save the sheet as "CSV UTF-8"'),
    "half a character": ("ca".encode("utf-16") + b"x", ': is cut or damaged: save it again as "CSV UTF-8"'),
    "UTF-16 without a mark": ("ca;ioa".encode("utf-16-le"), ': is no text: save it as "CSV UTF-8"'),
    "columns": (
        b"ca;ioa\n",
        ":1: has no column type, name, port, id, table, address or register; "
        "its first line has 2 cells parted by semicolons",
    ),
}


@pytest.mark.parametrize("kind", UNUSABLE)
def test_unusable_files(tmp_path: Path, kind: str) -> None:
    content, message = UNUSABLE[kind]
    points = tmp_path / "points.csv"
    points.write_bytes(content)
    result = back(points, write(tmp_path / "lines.json", {"port": []}))
    assert (result.returncode, result.stderr) == (2, f"openrtu points: {points}{message}\n")


@pytest.mark.slow
def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    points, lines = tmp_path / "points.csv", write(tmp_path / "lines.json", {"port": []})
    assert back(points, lines).returncode == 2
    points.write_text(HEAD)
    assert back(points, write(lines, [])).returncode == 2


# ---- on simulated devices ----------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_plant_of_templates_runs_without_devices(programs: Path, tmp_path: Path) -> None:
    """As docs/configuration.md says, "Try it without devices"."""
    directory = run_directory()
    plant = json.loads(PLANT.read_text())
    plant["include"] = [str((PLANT.parent / name).resolve()) for name in plant["include"]]
    plant["templates"]["feeder"]["response_timeout_ms"] = 2000
    for port in plant["port"]:
        port["active"] = int("host" not in port)
        if port["active"]:
            port["baud_rate"] = 115200
    file = write(tmp_path / "plant.json", plant)
    points, flat = tmp_path / "points.csv", tmp_path / "flat.json"
    points.write_text(rtud(programs, "--points", "--csv", file).stdout)
    flat.write_text(back(points, file).stdout)
    try:
        with (
            LineSim(flat, None, directory / "dev") as lines,
            Gateway(listening_on(plant, free_port()), directory, programs) as gateway,
        ):
            gateway.wait_for(
                lambda: all(point["quality"] != "invalid" for point in gateway.points().values()),
                60.0,
                "every device is read",
            )
            with Master(*gateway.address) as master:
                since = master.mark()
                lines.set("2.14", "input_registers", 0, 0x0002)  # its breaker is ON
                lines.set("1.3", "input_registers", 52, 0x447A, 0)  # 1000.0
                master.wait(lambda r: (r.ca, r.ioa, r.value) == (12, 601, "ON"), since)
                master.wait(lambda r: (r.ca, r.ioa, r.value) == (11, 30253, 1000.0), since)
                assert {ca: len(master.interrogate(ca)) for ca in (11, 12)} == {11: 72, 12: 72}
                assert len(master.interrogate_counters(11)) == 6
    finally:
        remove(directory)


def test_linesim_says_that_it_reads_no_templates(linesim_program: Path, tmp_path: Path) -> None:
    file = write(tmp_path / "gateway.json", plant_of({"id": 1, "template": "meter"}))
    command = [linesim_program, "--config", file, "--dir", tmp_path]
    result = subprocess.run(command, capture_output=True, text=True, timeout=20, check=False)
    assert result.returncode == 2
    assert "port[0].slaves[0].template: templates are not read here" in result.stderr
