# SPDX-License-Identifier: GPL-3.0-or-later
"""A type of points and a bit of the quality, added to a copy of the tree: few files, and all name them."""

import json
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from codes import CODES, SRC
from lab.gateway import Gateway, free_port, listening_on, remove, run_directory
from lab.modules import place, program

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]
COPIED = ("centre", "docs", "package/openrtu", "scripts/openrtu_tools")
LEFT = shutil.ignore_patterns("__pycache__")
CHEAP = ("-Dtests=disabled", "-Doptimization=0", "-Ddebug=false", "-Dwerror=true", "-Dschema=true")
PATIENCE_S = 60.0
ANGLE = '"degrees from -180 to 180") /* a float would be a metre coarse */'
DURATION = (
    '\\\n\tROW(MAP_DURATION, "duration", 32, MEASURED, SIGNED, 0, INT32_MAX, MAP_BITSTRING, "milliseconds")'
)
MODULE = """
from openrtu import Module, Quality

with Module() as module:
    for _ in module.scans():
        module.write("pause", 16777217, Quality.SUSPECT)
"""


@dataclass
class Copy:
    root: Path
    touched: set[str] = field(default_factory=set)  # by hand

    def replace(self, path: str, old: str, new: str) -> None:
        text = (self.root / path).read_text(encoding="utf-8")
        assert old in text, f"{path} has no longer the place where one is added"
        (self.root / path).write_text(text.replace(old, new, 1), encoding="utf-8")
        self.touched.add(path)


@pytest.fixture
def directory() -> Iterator[Path]:
    made = run_directory()
    yield made
    remove(made)


@pytest.fixture
def copy(tmp_path: Path) -> Copy:
    for folder in COPIED:
        shutil.copytree(ROOT / folder, tmp_path / folder, symlinks=True, ignore=LEFT)
    return Copy(tmp_path)


def add_type(copy: Copy) -> None:
    copy.replace(CODES, ANGLE, ANGLE + DURATION)


def add_bit(copy: Copy) -> None:
    last = "\tROW(MAP_OVERFLOW, 0x01,"
    copy.replace(
        CODES, last, f'\tROW(MAP_SUSPECT, 0x08, "suspect", "SU") /* its source doubts it */ \\\n{last}'
    )
    blocked = "\tq |= quality & MAP_BLOCKED ?"
    suspect = "\tq |= quality & MAP_SUSPECT ? QUALITY_QUESTIONABLE : 0;\n"
    copy.replace(SRC + "quality/quality.c", blocked, suspect + blocked)
    copy.replace("centre/page/lang/en.json", '"good": "good",', '"good": "good", "suspect": "suspect",')


def test_a_type_and_a_bit_touch_few_files(copy: Copy, directory: Path) -> None:
    add_type(copy)
    assert len(copy.touched) <= 4
    copy.touched.clear()
    add_bit(copy)
    assert len(copy.touched) <= 3
    page = (
        (ROOT / "docs/development.md").read_text().partition("\n## Add a number\n")[2].partition("\n## ")[0]
    )
    assert [path for path in copy.touched if path.removeprefix(SRC) not in page] == []
    said([sys.executable, ROOT / "scripts" / "codes.py", copy.root])
    build = built(copy.root)
    said([sys.executable, ROOT / "scripts" / "keys.py", build, copy.root])
    check_made(copy.root)
    check_gateway(copy.root, build, directory)


def built(root: Path) -> Path:
    build = root / "build"
    for command in (["meson", "setup", build, root / SRC, *CHEAP], ["ninja", "-C", build]):
        run = subprocess.run(command, capture_output=True, text=True, check=False)
        assert run.returncode == 0, run.stdout + run.stderr
    return build


def check_made(root: Path) -> None:
    """What Python, the page, the MIB, the schema and the pages call them."""
    script = (
        "import sys; sys.path[:0] = sys.argv[1:]; from openrtu.codes import Quality; import codes; "
        "print(int(Quality.SUSPECT), codes.QUALITIES['suspect'], codes.TYPES['duration'])"
    )
    packages = [root / "package/openrtu/python", root / "scripts/openrtu_tools"]
    assert said([sys.executable, "-c", script, *packages]) == "8 8 10\n"
    page = (root / "centre/page/js/codes.js").as_uri()
    script = f'import("{page}").then(({{ QUALITY }}) => console.log(QUALITY.SUSPECT))'
    assert said(["node", "--input-type=module", "-e", script]) == "8\n"
    mib = (root / SRC / "snmp/OPENRTU-MIB.txt").read_text()
    assert "duration(11)" in mib and "suspect(4)" in mib
    assert "OPENRTU_SUSPECT" in (root / SRC / "lib/openrtu.h").read_text()
    types = json.loads((root / SRC / "rtud/config.schema.json").read_text())["$defs"]["module_point"][
        "properties"
    ]["type"]
    assert types["enum"][-2:] == ["angle", "duration"]
    assert "`angle`, `duration` |" in (root / "docs/configuration.md").read_text()
    assert "8 suspect" in (root / "docs/centre.md").read_text()


def check_gateway(root: Path, build: Path, directory: Path) -> None:
    """A module publishes one of that type with that quality; rtuctl names both."""
    script = root / "probe.py"
    script.write_text(MODULE)
    module = {
        "name": "probe",
        "program": program(directory, "probe", script),
        "period_ms": 50,
        "ca": 9,
        "points": [{"name": "pause", "type": "duration", "ioa": 1}],
    }
    place(directory, build)
    shutil.rmtree(directory / "openrtu", ignore_errors=True)
    shutil.copytree(root / "package/openrtu/python/openrtu", directory / "openrtu")
    config = listening_on({"port": [], "modules": [module]}, free_port())
    with Gateway(config, directory, build) as gateway:

        def there() -> bool:
            point = gateway.points("pause")["pause"]
            return (point["value"], point["type"], point["quality"]) == (16777217, "duration", "suspect")

        gateway.wait_for(there, PATIENCE_S, "rtuctl names both")


def said(command: list[str | Path]) -> str:
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert run.returncode == 0, json.dumps(run.stderr)
    return run.stdout
