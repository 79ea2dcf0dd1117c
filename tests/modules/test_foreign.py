# SPDX-License-Identifier: GPL-3.0-or-later
"""Modules that others wrote: in Python and C on libopenrtu, seen by a controlling station, and gone wild."""

import json
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from lab.gateway import Gateway, free_port, listening_on, remove, run_directory
from lab.master import Master, Report
from lab.modules import EXAMPLES, HEADER, PACKAGE, compiled, library, place, program
from release.version import pep440
from rig.rights import SUPERUSER, needed

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]
FIXTURES = ROOT / "tests/fixtures/foreign"
TANK, PUMP, SMOOTH, WILD, WITNESS = 901, 902, 903, 904, 905  # common addresses
STATIONS = (TANK, PUMP, SMOOTH, WILD, WITNESS)
AS_ROOT = needed(SUPERUSER, "each module has a user of its own only if rtud is root's")
PATIENCE_S = 60.0
LIMIT_MS = 2000  # a module that a busy host lets wait is not dead


def pairs() -> list[dict[str, Any]]:
    names = [f"tank.{side}-{number}" for number in range(50) for side in ("left", "right")]
    return [
        {"name": name, "type": "scaled", "ioa": 100 + place, "deadband": 30000}
        for place, name in enumerate(names)
    ]


def modules(directory: Path) -> list[dict[str, Any]]:
    tank = {
        "name": "tank",
        "program": program(directory, "tank", FIXTURES / "tank.py"),
        "period_ms": 20,
        "ca": TANK,
        "points": [{"name": "tank.level", "type": "float", "ioa": 1, "unit": "%"}, *pairs()],
        "config": {"file": str(directory / "tank.json")},
    }
    pump = {
        "name": "pump",
        "program": program(directory, "pump", EXAMPLES / "pump.py"),
        "period_ms": 50,
        "ca": PUMP,
        "points": [
            {"name": "pump", "type": "single", "ioa": 1, "description": "It shall run"},
            {"name": "pump.limit", "type": "scaled", "ioa": 2, "initial": -7},
            {"name": "pump.never-written", "type": "single", "ioa": 3},
        ],
        "reads": ["tank.level"],
        "config": {"low": 20, "high": 40},
    }
    smooth = {
        "name": "smooth",
        "program": compiled(directory, "smooth", EXAMPLES / "filter.c"),
        "period_ms": 20,
        "ca": SMOOTH,
        "points": [{"name": "tank.level-smooth", "type": "float", "ioa": 1}],
        "reads": ["tank.lev[e]l"],
    }
    counts = [
        {"name": f"wild.count-{n}", "type": "scaled", "ioa": 10 + n, "deadband": 1000} for n in range(100)
    ]
    wild = {
        "name": "wild",
        "program": program(directory, "wild", FIXTURES / "wild.py"),
        "period_ms": 10,
        "ca": WILD,
        "points": [{"name": "wild.state", "type": "single", "ioa": 1}, *counts],
        "reads": ["tank.level"],
        "config": {"file": str(directory / "wild.json"), "map": str(directory / "map")},
    }
    witness = {
        "name": "witness",
        "program": program(directory, "witness", FIXTURES / "witness.py"),
        "period_ms": 10,
        "ca": WITNESS,
        "points": [{"name": "witness.torn", "type": "scaled", "ioa": 1}],
        "reads": ["tank.left-*", "tank.right-*"],
    }
    return [module | {"heartbeat_limit_ms": LIMIT_MS} for module in (tank, pump, smooth, wild, witness)]


@dataclass
class Plant:
    """A gateway with five modules of others, and a controlling station."""

    gateway: Gateway
    master: Master

    def say(self, name: str, **words: Any) -> None:
        """In one step: a module reads the file at any time."""
        file = self.gateway.directory / f"{name}.json"
        fresh = file.with_suffix(".new")
        fresh.write_text(json.dumps(words))
        fresh.rename(file)

    def point(self, name: str) -> dict[str, Any]:
        return self.gateway.points(name)[name]

    def wait_point(self, name: str, value: Any, quality: str = "good") -> None:
        def there() -> bool:
            point = self.point(name)
            return (point["value"], point["quality"]) == (value, quality)

        self.gateway.wait_for(there, PATIENCE_S, f"{name} is {value}, {quality}")

    def wait_quality(self, name: str, quality: str) -> None:
        self.gateway.wait_for(
            lambda: self.point(name)["quality"] == quality, PATIENCE_S, f"{name} is {quality}"
        )

    def wait_log(self, text: str) -> None:
        self.gateway.wait_for(lambda: text in self.gateway.log(10_000), PATIENCE_S, f"the log has {text!r}")

    def wait_report(self, wanted: Callable[[Report], bool], since: int, what: str) -> Report:
        return self.master.wait(wanted, since=since, timeout_s=PATIENCE_S, what=what)

    def restarts(self, name: str) -> int:
        return int(self.gateway.modules()[name]["restarts"])

    def scans(self, name: str) -> int:
        """Of its counters, which rtuctl shows without knowing the module."""
        counters = {row["counter"]: row["value"] for row in self.gateway.query("counters", name)}
        assert set(counters) == {"scans", "missed periods"}
        return int(counters["scans"])

    def do(self, deed: str) -> None:
        """Lets the wild module do it, and waits until it has."""
        self.say("wild", do=deed)
        self.wait_log(f"wild info: done: {deed}")


@pytest.fixture(scope="module")
def running(programs: Path) -> Iterator[Plant]:
    directory = run_directory()
    try:
        place(directory, programs)
        (directory / "tank.json").write_text('{"value": 10}')
        (directory / "wild.json").write_text('{"do": ""}')
        config = listening_on({"port": [], "modules": modules(directory)}, free_port())
        with Gateway(config, directory, programs) as gateway, Master(*gateway.address) as master:
            master.synchronise_clock(TANK)
            yield Plant(gateway, master)
    finally:
        remove(directory)


@pytest.fixture
def plant(running: Plant) -> Plant:
    """A low level, and all modules alive."""
    plant = running
    plant.say("tank", value=10)
    plant.say("wild", do="")
    plant.wait_point("pump", "on")
    plant.wait_quality("wild.count-0", "good")
    return plant


# ---- points and quality --------------------------------------------------------------------------


def test_pages_show_the_ten_lines() -> None:
    ten = (EXAMPLES / "pump.py").read_text()
    assert len(ten.splitlines()) == 10
    for page in ("README.md", "docs/writing-a-module.md"):
        assert f"```python\n{ten}```\n" in (ROOT / page).read_text()


def test_page_shows_the_guard() -> None:
    guard = (EXAMPLES / "guard.py").read_text()
    assert f"```python\n{guard}```\n" in (ROOT / "docs/writing-a-module.md").read_text()


def test_entry_on_the_page_is_good(programs: Path, tmp_path: Path) -> None:
    entry = re.search(r"```json\n(.*?)```", (ROOT / "docs/writing-a-module.md").read_text(), re.DOTALL)
    assert entry is not None
    tank = {"name": "tank", "program": "/tank", "ca": 1}
    tank["points"] = [{"name": "tank.level", "type": "float", "ioa": 1}]
    config = {"port": []} | json.loads(f"{{{entry[1]}}}")
    config["modules"].append(tank)
    file = tmp_path / "gateway.json"
    file.write_text(json.dumps(config))
    done = subprocess.run(
        [programs / "rtud/rtud", "--check", file], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_ten_lines_switch_a_pump_by_a_level(plant: Plant) -> None:
    for level, state in ((30, "on"), (50, "off"), (30, "off"), (10, "on")):
        since = plant.master.mark()
        before = plant.point("pump")["value"]
        plant.say("tank", value=level)
        plant.wait_point("tank.level", level)
        plant.wait_point("pump", state)
        if state != before:
            event = (PUMP, 1, "M_SP_TB_1", state == "on", "good")
            plant.wait_report(
                lambda r, event=event: (r.ca, r.ioa, r.type, r.value, r.quality) == event, since, "its event"
            )


def test_interrogation_has_points_of_every_module(plant: Plant) -> None:
    def smooth() -> bool:
        return bool(plant.point("tank.level-smooth")["value"] == pytest.approx(10, abs=0.01))

    plant.gateway.wait_for(smooth, PATIENCE_S, "the filter is at 10")
    objects = {(r.ca, r.ioa): r for r in plant.master.interrogate_all(*STATIONS)}
    assert objects[TANK, 1].value == 10
    assert objects[PUMP, 1].value is True
    assert objects[SMOOTH, 1].value == pytest.approx(10, abs=0.01)
    assert all(objects[ca, ioa].good for ca, ioa in ((TANK, 1), (PUMP, 1), (SMOOTH, 1)))


def test_initial_value_is_good_and_none_is_invalid(plant: Plant) -> None:
    limit, never = plant.point("pump.limit"), plant.point("pump.never-written")
    assert (limit["value"], limit["quality"]) == (-7, "good")
    assert never["quality"] == "invalid"


@pytest.mark.parametrize(
    ("quality", "inherited"),
    [(0x80, "invalid"), (0x40, "not topical"), (0x20, "substituted"), (0x10, "blocked"), (0x01, "invalid")],
)
def test_output_is_as_bad_as_its_input(plant: Plant, quality: int, inherited: str) -> None:
    """What cannot be said of a single point, an overflow, makes it invalid."""
    since = plant.master.mark()
    plant.say("tank", value=10, quality=quality)
    plant.wait_quality("pump", inherited)
    plant.wait_report(lambda r: (r.ca, r.ioa) == (PUMP, 1) and not r.good, since, "the pump's bad quality")
    plant.wait_quality("tank.level-smooth", inherited)  # in C as well
    plant.say("tank", value=10)
    plant.wait_point("pump", "on")


def test_value_that_a_point_cannot_hold_makes_it_invalid(plant: Plant) -> None:
    plant.do("out-of-range")
    plant.wait_log('value: 7 is no value of "wild.state", of type single')
    assert plant.point("wild.state")["quality"] == "invalid"


# ---- modules that die, hang, flood and lie -------------------------------------------------------


@pytest.mark.parametrize("phase", ["begun", "written", "any"])
def test_killed_module_is_invalid_and_comes_back(plant: Plant, phase: str) -> None:
    """In each phase of a scan: it has written nothing, or published nothing, or anything."""
    restarts, since = plant.restarts("tank"), plant.master.mark()
    for death in range(1, 2 if phase != "any" else 6):
        plant.wait_quality("tank.level", "good")
        if phase == "any":
            plant.gateway.kill("tank")
        else:
            plant.say("tank", value=10, die=phase)
        died = restarts + death
        plant.gateway.wait_for(lambda died=died: plant.restarts("tank") >= died, PATIENCE_S, "the tank died")
    plant.wait_report(
        lambda r: (r.ca, r.ioa) == (TANK, 1) and "INVALID" in r.quality.upper(), since, "the level is invalid"
    )
    plant.wait_report(
        lambda r: (r.ca, r.ioa) == (PUMP, 1) and "INVALID" in r.quality.upper(), since, "the pump is invalid"
    )
    plant.say("tank", value=11)
    plant.wait_point("tank.level", 11)
    plant.wait_point("pump", "on")
    scans = plant.scans("witness")
    plant.gateway.wait_for(lambda: plant.scans("witness") > scans + 10, PATIENCE_S, "the witness scans")
    plant.wait_point("witness.torn", 0)


def test_hung_module_is_invalid_and_is_started_again(plant: Plant) -> None:
    restarts, since = plant.restarts("wild"), plant.master.mark()
    plant.say("wild", do="hang")
    plant.wait_report(
        lambda r: (r.ca, r.ioa) == (WILD, 10) and "INVALID" in r.quality.upper(), since, "it is invalid"
    )
    plant.wait_point("pump", "on")
    plant.say("wild", do="")
    plant.gateway.wait_for(lambda: plant.restarts("wild") > restarts, PATIENCE_S, "rtud has killed it")
    plant.wait_quality("wild.count-0", "good")


@pytest.mark.parametrize(
    "deed", ["flood-log", "flood-events", "flood-bells", "eat-memory", pytest.param("fork", marks=AS_ROOT)]
)
def test_flood_reaches_nobody_else(plant: Plant, deed: str) -> None:
    before = {name: plant.restarts(name) for name in ("rtu-iec104", "tank", "pump", "smooth")}
    if deed == "flood-log":
        plant.say("wild", do=deed)
        plant.wait_log(" lines are left out: it wrote too many at once")
    else:
        plant.do(deed)
    plant.say("tank", value=50)
    plant.wait_point("pump", "off")
    objects = {(r.ca, r.ioa): r.value for r in plant.master.interrogate_all(*STATIONS)}
    assert objects[PUMP, 1] is False
    assert {name: plant.restarts(name) for name in before} == before


@AS_ROOT
def test_lying_module_is_refused(plant: Plant) -> None:
    plant.do("lie")
    plant.wait_log('wild info: library: "tank.level" is a point of another module')
    for name in ("tank", "rtu-iec104", "rtud"):
        plant.wait_log(f"wild info: kernel: {name} is refused")
    assert "is mine" not in plant.gateway.log(10_000)


def test_module_counts_its_scans(plant: Plant) -> None:
    before = plant.scans("pump")
    assert before > 0
    plant.gateway.wait_for(lambda: plant.scans("pump") > before, PATIENCE_S, "the pump scans")


def test_unit_and_description_are_shown(plant: Plant) -> None:
    assert plant.gateway.query("show", "tank.level")["unit"] == "%"
    shown = plant.gateway.query("show", "pump")
    assert (shown["description"], shown["retain"]) == ("It shall run", False)
    assert "unit" not in shown
    assert re.search(r"^description +It shall run$", plant.gateway.ctl("show", "pump"), re.MULTILINE)


def test_histogram_shows_how_punctual_modules_are(plant: Plant) -> None:
    """In Python and C: each scan is in it once."""

    def rows() -> dict[str, dict[str, Any]]:
        return {row["name"]: row for row in plant.gateway.query("modules", "--histogram")}

    def missing(row: dict[str, Any], key: str) -> int:
        return row["count"] - sum(row[key]["counts"])

    def is_whole() -> bool:
        """But one under way, and one of each process that was killed."""
        of = rows()
        return all(
            0 <= missing(of[name], key) <= 1 + plant.restarts(name) and of[name][key]["longest_us"] > 0
            for name in ("tank", "pump", "smooth")
            for key in ("wakeups", "scans")
        )

    assert set(rows()) == {"tank", "pump", "smooth", "wild", "witness"}
    plant.gateway.wait_for(is_whole, PATIENCE_S, "each scan is in the histograms")
    table = plant.gateway.ctl("modules", "--histogram").splitlines()
    title = next(at for at, text in enumerate(table) if text.startswith("pump: longest wake-up "))
    assert table[title + 1].split() == ["BELOW", "US", "WAKE-UPS", "SCANS"]


@AS_ROOT
def test_module_runs_without_rights(plant: Plant) -> None:
    users = set()
    for name in ("tank", "pump", "smooth", "wild"):
        status = Path(f"/proc/{plant.gateway.modules()[name]['pid']}/status").read_text()
        users |= set(re.findall(r"^Uid:\t(\d+)\t\1\t\1\t\1$", status, re.MULTILINE))
        assert re.search(r"^CapBnd:\t0+$", status, re.MULTILINE)
        assert re.search(r"^NoNewPrivs:\t1$", status, re.MULTILINE)
        assert re.search(r"^Groups:\t *$", status, re.MULTILINE)
    assert users == {"61221", "61222", "61223", "61224"}


def test_module_ends_when_it_is_asked_to(programs: Path) -> None:
    directory = run_directory()
    try:
        place(directory, programs)
        (directory / "tank.json").write_text('{"value": 1}')
        gateway = Gateway(
            listening_on({"port": [], "modules": modules(directory)[:1]}, free_port()), directory, programs
        )
        with gateway:
            gateway.wait_for(
                lambda: gateway.points("tank.level")["tank.level"]["value"] == 1, PATIENCE_S, "the tank runs"
            )
            assert gateway.stop() == 0
        assert "tank info: the tank ends" in gateway.log()
        assert "tank was ended" not in gateway.log()
    finally:
        remove(directory)


def test_program_that_is_not_there_stops_nobody(programs: Path) -> None:
    directory = run_directory()
    missing = {"name": "missing", "program": str(directory / "missing")}
    try:
        with Gateway(
            listening_on({"port": [], "modules": [missing]}, free_port()), directory, programs
        ) as gateway:
            gateway.wait_for(
                lambda: f"cannot start missing from {directory}/missing: No such file" in gateway.log(),
                PATIENCE_S,
                "the log says what is missing",
            )
            assert gateway.modules()["rtu-iec104"]["state"] == "running"
    finally:
        remove(directory)


# ---- the library and the package -----------------------------------------------------------------

# A symbol never leaves: programs that were linked with it would not start any more.
SYMBOLS = [
    "attach",
    "command",
    "command_read",
    "config",
    "detach",
    "error",
    "event_next",
    "events_lost",
    "log",
    "name",
    "period_ms",
    "point",
    "point_count",
    "point_description",
    "point_is_own",
    "point_name",
    "point_takes_commands",
    "point_type",
    "point_unit",
    "read",
    "request_confirm",
    "request_end",
    "request_next",
    "scan_begin",
    "scan_end",
    "selection_next",
    "selection_refuse",
    "synch",
    "version",
    "wait",
    "wall_ns",
    "write",
    "write_quality",
]
SINCE_1 = ["write_at"]  # what came later has a version of its own: older modules run with a newer library


def test_library_shows_its_interface_and_nothing_else(programs: Path) -> None:
    shown = subprocess.run(
        ["nm", "-D", "--defined-only", library(programs)], capture_output=True, text=True, check=True
    ).stdout
    symbols = sorted(re.findall(r" T (\w+@@\w+)$", shown, re.MULTILINE))
    others = [
        line for line in shown.splitlines() if " T " not in line and not re.search(" A OPENRTU_[01]$", line)
    ]
    versions = {"OPENRTU_0": SYMBOLS, "OPENRTU_1": SINCE_1}
    assert symbols == sorted(
        f"openrtu_{name}@@{version}" for version in versions for name in versions[version]
    )
    assert others == []
    declared = re.findall(r"^[a-z].*?\b(openrtu_\w+)\(", HEADER.read_text(), re.MULTILINE)
    assert sorted(declared) == sorted(symbol.partition("@")[0] for symbol in symbols)
    dynamic = subprocess.run(
        ["readelf", "-d", library(programs)], capture_output=True, text=True, check=True
    ).stdout
    assert "soname: [libopenrtu.so.0]" in dynamic


def test_header_is_for_c_and_cplusplus(tmp_path: Path) -> None:
    for language, standard in (("c", "c11"), ("c++", "c++11")):
        source = tmp_path / f"use.{language}"
        source.write_text("#include <openrtu.h>\n")
        command = ["cc", "-x", language, f"-std={standard}", "-pedantic-errors", "-Wall", "-Werror"]
        command += ["-fsyntax-only", f"-I{HEADER.parent}", str(source)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr


def test_wheel_is_installed_and_finds_the_library(programs: Path, tmp_path: Path) -> None:
    source, target = tmp_path / "source", tmp_path / "target"
    shutil.copytree(PACKAGE, source)
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    done = subprocess.run([*command, "--target", target, source], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    asked = (
        "import importlib.metadata as m, openrtu;"
        "print(openrtu.library_version(), openrtu.VERSION, m.version('openrtu'))"
    )
    for named, output, code in (
        (str(library(programs)), f"{version()} {version()} {pep440(version())}\n", 0),
        ("libopenrtu-missing.so", "", 1),
    ):
        done = subprocess.run(
            [sys.executable, "-c", asked],
            env={"PYTHONPATH": str(target), "OPENRTU_LIBRARY": named},
            capture_output=True,
            text=True,
            check=False,
        )
        assert (done.returncode, done.stdout) == (code, output)
        assert "Traceback" not in done.stderr
    assert "install libopenrtu (make install), or name it in OPENRTU_LIBRARY" in done.stderr


def test_the_page_installs_the_package_beside_debians_python(programs: Path, tmp_path: Path) -> None:
    """Debian's Python takes nothing from pip (PEP 668): the page's lines, and the ten lines with them."""
    page = (ROOT / "docs/writing-a-module.md").read_text()
    block = re.search(r"```sh\n(   ldconfig\n.*?)   ```", page, re.DOTALL)
    assert block is not None
    (shebang,) = re.findall(r"`#!(/usr/local/lib/openrtu/\S+)`", page)
    lines = block[1].replace("ldconfig\n", "\n").replace("/usr/local/lib/openrtu", str(tmp_path / "place"))
    lines = lines.replace("./package/openrtu/python", str(tmp_path / "source"))
    shutil.copytree(PACKAGE, tmp_path / "source")
    environment = {"PATH": "/usr/bin:/bin", "OPENRTU_LIBRARY": str(library(programs))}
    done = subprocess.run(
        ["bash", "-e", "-c", lines], env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    module = tmp_path / "pump.py"
    text = (EXAMPLES / "pump.py").read_text().split("\n", 1)[1]
    module.write_text(f"#!{shebang.replace('/usr/local/lib/openrtu', str(tmp_path / 'place'))}\n{text}")
    module.chmod(0o755)
    started = subprocess.run([module], env=environment, capture_output=True, text=True, check=False)
    assert "a module is started by rtud" in started.stderr


def version() -> str:
    return (ROOT / "package/openrtu/src/VERSION").read_text().strip()


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ([], "a module is started by rtud: --map DIR and --module NAME are missing"),
        (
            ["--map", "/nowhere", "--module", "pump"],
            "/nowhere: no map in /nowhere: No such file",
        ),
        (["--map", "/nowhere", "--module", "rtud"], "rtud is a module of the gateway itself"),
    ],
)
def test_module_started_by_hand_says_what_it_needs(programs: Path, words: list[str], says: str) -> None:
    done = subprocess.run(
        [sys.executable, EXAMPLES / "pump.py", *words],
        env={"PYTHONPATH": str(PACKAGE), "OPENRTU_LIBRARY": str(library(programs))},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    assert says in done.stderr
    assert "Traceback" not in done.stderr
