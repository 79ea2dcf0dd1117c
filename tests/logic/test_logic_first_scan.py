# SPDX-License-Identifier: GPL-3.0-or-later
"""A program's first scan waits for its inputs: its values do not depend on who started first."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from lab.gateway import Gateway, free_port, listening_on, remove, run_directory
from lab.modules import place, program
from openrtu_tools.logic.binary import encode
from openrtu_tools.logic.compile import compile_text
from openrtu_tools.logic.errors import Findings

pytestmark = pytest.mark.slow

LATE = """import time
from openrtu import Module
begun = time.monotonic()
with Module() as module:
    for _ in module.scans():
        if time.monotonic() > begun + {wait}:
            module["late.load"] = 1.0
"""
COUNTS = """PROGRAM counts
VAR_EXTERNAL load : REAL; n, m : DINT; END_VAR
VAR c : DINT; k : CTU; END_VAR
IF load > 0.5 THEN c := c + 1; END_IF;
k(CU := load > 0.5, PV := 9);
n := c;
m := k.CV;
END_PROGRAM
"""
RELAY = """PROGRAM relay
VAR_EXTERNAL theirs, mine : DINT; END_VAR
VAR c : DINT; END_VAR
c := c + 1;
mine := c + 0 * theirs;
END_PROGRAM
"""


@pytest.fixture
def directory() -> Iterator[Path]:
    made = run_directory()
    yield made
    remove(made)


def late(directory: Path, programs: Path, wait_s: float) -> dict[str, Any]:
    """A module that takes so long before it tells its point."""
    place(directory, programs)
    (directory / "source").mkdir()
    script = directory / "source/late.py"
    script.write_text(LATE.format(wait=wait_s))
    return {
        "name": "late",
        "program": program(directory, "late", script),
        "period_ms": 200,
        "heartbeat_limit_ms": 5000,
        "ca": 900,
        "points": [{"name": "late.load", "type": "float", "ioa": 1}],
    }


def logic(directory: Path, text: str, name: str, names: dict[str, str], *own: str) -> dict[str, Any]:
    findings = Findings()
    image = compile_text(text, findings)
    assert not findings.failed, findings.sorted()
    file = directory / f"{name}.rtul"
    file.write_bytes(encode(image))
    return {
        "name": name,
        "program": str(file),
        "period_ms": 50,
        "ca": 7000 + len(list(directory.glob("*.rtul"))),
        "names": names,
        "points": [{"name": point, "ioa": ioa} for ioa, point in enumerate(own, 1)],
    }


def config(*programs: dict[str, Any], **keys: Any) -> dict[str, Any]:
    return listening_on({"port": [], "logic": list(programs)}, free_port()) | keys


def test_what_comes_late_spoils_nothing(programs: Path, directory: Path) -> None:
    module = late(directory, programs, 2.0)
    counts = logic(directory, COUNTS, "counts", {"load": "late.load"}, "n", "m")
    with Gateway(config(counts, modules=[module]), directory, programs) as gateway:
        gateway.wait_for(lambda: (gateway.points()["n"]["value"] or 0) > 2, 60.0, "the program counts")
        points = gateway.points()
    assert {name: points[name]["quality"] for name in ("n", "m")} == {"n": "good", "m": "good"}
    assert points["m"]["value"] == 1


def test_what_never_comes_holds_it_up_for_a_limited_time(programs: Path, directory: Path) -> None:
    """And the library's blocks are good as soon as it is there."""
    module = late(directory, programs, 13.0)
    counts = logic(directory, COUNTS, "counts", {"load": "late.load"}, "n", "m")
    with Gateway(config(counts, modules=[module]), directory, programs) as gateway:
        said = "begins without late.load, which has not been read for 10 s; inputs that are missing: 1"
        gateway.wait_for(lambda: said in gateway.log(), 60.0, said)
        assert gateway.points()["m"]["quality"] == "invalid"
        gateway.wait_for(lambda: gateway.points()["m"]["quality"] == "good", 60.0, "it counts")


def test_programs_that_read_each_other_begin_at_once(programs: Path, directory: Path) -> None:
    text = RELAY.replace("mine", "{0}").replace("theirs", "{1}")
    pair = [
        logic(directory, text.format(mine, theirs), mine, {}, mine)
        for mine, theirs in (("one", "two"), ("two", "one"))
    ]
    with Gateway(config(*pair), directory, programs) as gateway:
        gateway.wait_for(lambda: (gateway.points()["one"]["value"] or 0) > 0, 60.0, "it runs")
        assert "begins without" not in gateway.log()
