# SPDX-License-Identifier: GPL-3.0-or-later
"""A key of the configuration, added to a copy of the tree: its reader changes, and what is made of rules."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]
SRC = "package/openrtu/src/"
READER, RECORD = SRC + "modbus/config_part.c", SRC + "modbus/config.h"
MADE = {SRC + "rtud/config.schema.json", "docs/configuration.md"}
CHEAP = ("-Dtests=disabled", "-Doptimization=0", "-Ddebug=false", "-Dwerror=true", "-Dschema=true")
SENTENCE = "Milliseconds that a line rests after a broadcast."
ROW = f"""    [MODBUS_REST] = {{"rest_ms", CONFIG_INTEGER, .low = 0, .high = 500, .fallback = 7,
        CONFIG_SAYS("{SENTENCE}")}},
}};
CONFIG_TABLE(modbus_table,"""


def replace(root: Path, path: str, old: str, new: str) -> None:
    text = (root / path).read_text(encoding="utf-8")
    assert old in text, f"{path} has no longer the place where one is added"
    (root / path).write_text(text.replace(old, new, 1), encoding="utf-8")


def add_key(root: Path) -> set[str]:
    """The row, its reader, and where the value is kept."""
    replace(
        root,
        READER,
        "MODBUS_HEARTBEAT_LIMIT, MODBUS_KEYS",
        "MODBUS_HEARTBEAT_LIMIT, MODBUS_REST, MODBUS_KEYS",
    )
    replace(root, READER, "};\nCONFIG_TABLE(modbus_table,", ROW)
    heartbeat = "\tsettings->heartbeat_limit_ms = "
    replace(
        root, READER, heartbeat, f"\tsettings->rest_ms = (uint16_t)values[MODBUS_REST].integer;\n{heartbeat}"
    )
    limit = "\tuint16_t heartbeat_limit_ms;"
    replace(root, RECORD, limit, f"\tuint16_t rest_ms;\n{limit}")
    return {READER, RECORD}


def said(command: list[str | Path], code: int = 0) -> str:
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert run.returncode == code, run.stdout + run.stderr
    return run.stdout + run.stderr


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    for folder in ("docs", "package/openrtu", "scripts/openrtu_tools/modbus"):
        shutil.copytree(ROOT / folder, tmp_path / folder, symlinks=True)
    return tmp_path


def test_a_key_touches_its_reader_and_what_is_made(copy: Path) -> None:
    touched = add_key(copy)
    assert len(touched) <= 2
    page = (ROOT / "docs/development.md").read_text().partition("\n## Add a key\n")[2].partition("\n## ")[0]
    assert "CONFIG_SAYS" in page and "make keys" in page
    assert [path for path in MADE if Path(path).name not in page] == []
    build = copy / "build"
    said(["meson", "setup", build, copy / SRC, *CHEAP])
    said(["ninja", "-C", build, "rtud/rtud", "centre/rtu-centre"])
    rtud = build / "rtud/rtud"
    assert set(said([sys.executable, ROOT / "scripts/keys.py", build, copy]).split()) == MADE
    check_made(copy)
    check_rtud(rtud, copy)


def check_made(root: Path) -> None:
    schema = json.loads((root / SRC / "rtud/config.schema.json").read_text())
    rule = {"type": "integer", "minimum": 0, "maximum": 500, "$comment": "unit: ms", "default": 7}
    assert schema["$defs"]["modbus"]["properties"]["rest_ms"] == {"description": SENTENCE} | rule
    page = (root / "docs/configuration.md").read_text()
    assert f"| `rest_ms` | 0 … 500 ms | 7 | {SENTENCE} |" in page
    assert len(re.findall("`rest_ms`", page)) == 1


def check_rtud(rtud: Path, directory: Path) -> None:
    """It takes the key, and names what is wrong with it."""
    path = directory / "gateway.json"
    for value, code, message in (
        (500, 0, "good: lines 0"),
        (501, 1, "modbus.rest_ms: 501 is out of range, expected 0 to 500"),
        ("1", 1, "modbus.rest_ms: is a string, expected an integer from 0 to 500"),
    ):
        path.write_text(json.dumps({"port": [], "modbus": {"rest_ms": value}}))
        assert message in said([rtud, "--check", path], code)


def test_a_build_without_sentences_says_so(tmp_path: Path) -> None:
    """As that of a board is: no sentence is in it, and --schema says why it cannot."""
    build = tmp_path / "build"
    said(["meson", "setup", build, ROOT / SRC, *CHEAP[:-1]])
    said(["ninja", "-C", build, "rtud/rtud"])
    rtud = build / "rtud/rtud"
    assert said([rtud, "--schema"], 2) == "rtud: --schema needs -Dschema=true, which no board has\n"
    sentences = json.loads((ROOT / SRC / "rtud/config.schema.json").read_text())["$defs"]["slave"][
        "properties"
    ]
    program = rtud.read_bytes()
    assert [key for key, rule in sentences.items() if rule["description"][:40].encode() in program] == []
