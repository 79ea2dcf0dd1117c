# SPDX-License-Identifier: GPL-3.0-or-later
"""The Python tools as pip installs them: in an environment of their own, away from the tree."""

import json
import os
import re
import shutil
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml
from test_version import VERSION

from lab.gateway import free_port
from openrtu_tools.cli import TOOLS
from rig.packaged import alone

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]


# Nothing of the tree is found by chance.
BARE = {name: value for name, value in os.environ.items() if name not in {"PYTHONPATH", "OPENRTU_BUILD"}}
LIMIT_S = 120


def environment(folder: Path, *what: str | Path) -> Path:
    """The folder of the programs of a new environment with these packages."""
    pip = [folder / "bin/pip", "install", "--quiet", "--disable-pip-version-check", *what]
    for command in ([sys.executable, "-m", "venv", folder], pip):
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
    return folder / "bin"


@pytest.fixture(scope="module")
def tools(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Installed from the tree, with what the tools of boards need."""
    return environment(tmp_path_factory.mktemp("tree") / "venv", f"{ROOT}[nuc980]")


@pytest.fixture(scope="module")
def wheels() -> list[Path]:
    quiet = {name: value for name, value in os.environ.items() if not name.startswith(("MAKE", "MFLAGS"))}
    with alone("wheels"):
        done = subprocess.run(
            ["make", "wheels"], cwd=ROOT, env=quiet, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stdout + done.stderr
    return sorted((ROOT / "build/wheels").glob("*.whl"))


@pytest.fixture(scope="module")
def both(wheels: list[Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The tools and the library for modules, from their wheels, without any extra."""
    assert [wheel.name.split("-")[0] for wheel in wheels] == ["openrtu", "openrtu_tools"]
    return environment(tmp_path_factory.mktemp("wheels") / "venv", *wheels)


@pytest.fixture
def elsewhere(tmp_path: Path) -> Path:
    """Device trees as another project has them."""
    shutil.copytree(ROOT / "dts/nuvoton", tmp_path / "dts")
    shutil.copy(ROOT / "docs/examples/sd-host-on.dts", tmp_path)
    return tmp_path


def run(
    tools: Path, cwd: Path, name: str, *words: str | Path, typed: str = "", **settings: str
) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [tools / name, *words], cwd=cwd, input=typed, env=BARE | settings, capture_output=True, text=True,
        timeout=LIMIT_S, check=False,
    )  # fmt: skip


def out(tools: Path, cwd: Path, name: str, *words: str | Path, typed: str = "", **settings: str) -> str:
    done = run(tools, cwd, name, *words, typed=typed, **settings)
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


def test_version(tools: Path, tmp_path: Path) -> None:
    for name in ("openrtu", "nuc980-pins", "nuc980-netboot"):
        assert run(tools, tmp_path, name, "--version").stdout == f"{name} (OpenRTU) {VERSION}\n"


def test_pins_finds_what_it_finds_in_the_tree(tools: Path, elsewhere: Path) -> None:
    good = run(tools, elsewhere, "nuc980-pins", "check", "dts/nuc980-gateway.dts")
    assert (good.returncode, good.stdout) == (0, "dts/nuc980-gateway.dts: no findings\n")
    bad = run(tools, elsewhere, "nuc980-pins", "check", "--chip-only", "-I", "dts", "sd-host-on.dts")
    assert bad.returncode == 1
    assert "pin-conflict: sdh and emac1 both have PF0 to PF6" in bad.stdout


def test_pins_has_its_templates_and_tables(tools: Path, elsewhere: Path) -> None:
    """Of each file that comes with the package, something that needs it."""
    assert "unknown-property" in run(tools, elsewhere, "nuc980-pins", "explain", "rules").stdout
    assert "LQFP128 116 (this board)" in run(tools, elsewhere, "nuc980-pins", "explain", "PE11").stdout
    done = run(tools, elsewhere, "nuc980-pins", "map", "-o", "pins.html")
    assert (done.returncode, done.stderr) == (0, "")
    assert (elsewhere / "pins.html").stat().st_size > 10_000


def test_pins_generates_in_a_clone_only(tools: Path, elsewhere: Path) -> None:
    done = run(tools, elsewhere, "nuc980-pins", "generate")
    assert (done.returncode, done.stdout) == (2, "")
    assert "run scripts/nuc980-pins there" in done.stderr


def test_netboot_plans_a_boot(tools: Path, elsewhere: Path) -> None:
    """A plan needs the board's limits, libfdt and the images' readers."""
    subprocess.run(
        ["mkimage", "-A", "arm", "-O", "linux", "-T", "kernel", "-C", "none", "-a", "0x8000", "-e", "0x8000",
         "-d", "sd-host-on.dts", "uImage"],
        cwd=elsewhere, check=True, capture_output=True,
    )  # fmt: skip
    with (elsewhere / "board.dtb").open("wb") as out:
        source = '/dts-v1/; / { memory { reg = <0 0x4000000>; }; chosen { bootargs = "console=ttyS0"; }; };'
        subprocess.run(["dtc", "-q", "-O", "dtb"], input=source.encode(), stdout=out, check=True)
    addresses = ["--board-ip", "192.168.1.20/24", "--server-ip", "192.168.1.1"]
    nat = ["--listen", "127.0.0.1", "--seen-as", "127.0.0.1"]
    words = ["boot", "--dry-run", *addresses, *nat, "uImage", "board.dtb"]
    done = run(tools, elsewhere, "nuc980-netboot", *words)
    in_tree = run(ROOT / "scripts", elsewhere, "nuc980-netboot", *words)
    assert (done.returncode, done.stderr) == (0, "")
    assert "bootm" in done.stdout
    mac = re.compile(r"(?:[0-9a-f]{2}:){5}[0-9a-f]{2}")  # made up for a board without one
    assert mac.sub("MAC", done.stdout) == mac.sub("MAC", in_tree.stdout)


def test_hooks_are_the_tools_own_commands(tools: Path, elsewhere: Path) -> None:
    """What pre-commit runs: each hook's entry, and the files it names, on a tree elsewhere."""
    for hook in yaml.safe_load((ROOT / ".pre-commit-hooks.yaml").read_text()):
        done = run(tools, elsewhere, *hook["entry"].split(), *hook.get("args", []), "dts/nuc980-gateway.dts")
        assert done.returncode == 0, done.stdout + done.stderr


# ---- from the wheels alone -------------------------------------------------------------------------


def test_the_wheels_bring_no_name_that_is_not_ours(both: Path, tmp_path: Path) -> None:
    listed = out(both, tmp_path, "pip", "list", "--format=json")
    assert {one["name"] for one in json.loads(listed)} - {"pip", "setuptools"} == {
        "openrtu", "openrtu-tools", "shtab",
    }  # fmt: skip
    program = (
        "import importlib.metadata as m, openrtu, openrtu_tools, sys\n"
        "files = [f.parts[0] for d in ('openrtu', 'openrtu-tools') for f in m.files(d)]\n"
        "print(*sorted({f for f in files if not f.endswith('.dist-info') and f != '..'}))\n"
        "print(*(module.__file__ for module in (openrtu, openrtu_tools)))"
    )
    names, files = out(both, tmp_path, "python", "-c", program).splitlines()
    assert names.split() == ["nuc980", "openrtu", "openrtu_tools"]
    assert all(Path(file).is_relative_to(both.parent) for file in files.split())


@pytest.mark.parametrize("tool", TOOLS)
def test_each_subcommand_has_its_help_without_any_extra(both: Path, tmp_path: Path, tool: str) -> None:
    assert out(both, tmp_path, "openrtu", tool, "--help").startswith(f"usage: openrtu {tool} ")


def test_help_imports_no_subcommand(both: Path, tmp_path: Path) -> None:
    done = run(both, tmp_path, "python", "-X", "importtime", "-m", "openrtu_tools", "--help")
    loaded = set(re.findall(r"openrtu_tools[\w.]*", done.stderr))
    assert {"openrtu_tools", "openrtu_tools.cli"} <= loaded
    assert loaded & {tool.module for tool in TOOLS.values()} == set()
    assert all(f"  {tool} " in done.stdout or f"  {tool}\n" in done.stdout for tool in TOOLS)


@pytest.mark.parametrize(
    ("words", "extra"),
    [
        (("openrtu", "centre", "centre.json", "serve"), "centre"),
        (("openrtu", "logic", "filter", "butterworth", "low", "--edges", "1"), "logic"),
        (("nuc980-pins", "--version"), "nuc980"),
        (("nuc980-netboot", "--version"), "nuc980"),
        (("openrtu-centre-station",), "centre"),
    ],
)
def test_a_missing_extra_says_what_to_type(
    both: Path, tmp_path: Path, words: tuple[str, ...], extra: str
) -> None:
    done = run(both, tmp_path, *words)
    assert (done.returncode, done.stdout) == (2, "")
    typed = re.fullmatch(r".*: the Python package \w+ is missing; type: (.*)\n", done.stderr)
    assert typed
    assert re.fullmatch(rf"{both}/python[\d.]* -m pip install 'openrtu-tools\[{extra}\]'", typed[1])


def test_points_of_a_csv(both: Path, programs: Path, tmp_path: Path) -> None:
    plant = ROOT / "docs/examples/plant.json"
    listed = out(programs / "rtud", tmp_path, "rtud", "--points", "--csv", plant)
    (tmp_path / "points.csv").write_text(listed)
    (tmp_path / "new.json").write_text(
        out(both, tmp_path, "openrtu", "points", "points.csv", "--lines", plant)
    )
    assert out(programs / "rtud", tmp_path, "rtud", "--points", "--csv", "new.json") == listed


def test_a_cid_of_a_tool(both: Path, programs: Path, tmp_path: Path) -> None:
    point = {"name": "q0.power", "type": "float", "ioa": 1}
    module = {"name": "bay", "program": "/bin/false", "ca": 7, "points": [point]}
    config = {"port": [], "iec61850": {"address": "192.0.2.1"}, "modules": [module]}
    (tmp_path / "gateway.json").write_text(json.dumps(config))
    own = out(programs / "rtud", tmp_path, "rtud", "--scl", "--cid", "gateway.json")
    (tmp_path / "own.cid").write_text(own)
    (tmp_path / "tool.cid").write_text(own.replace("OpenRTU", "Feeder7"))
    done = run(both, tmp_path, "openrtu", "scl", "gateway.json", "tool.cid", "--own", "own.cid")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["iec61850"]["ied"] == "Feeder7"


def test_keys_and_users(both: Path, tmp_path: Path) -> None:
    (tmp_path / "gateway.json").write_text('{"snmp": {"users": [{"name": "graphs", "role": "viewer"}]}}')
    (tmp_path / "phrases").write_text("graphs correct-horse battery-staple\n")
    words = ("gateway.json", "snmp.keys", "--passphrases", "phrases")
    assert "snmp.keys goes to the gateway" in out(both, tmp_path, "openrtu", "snmp-keys", *words)
    assert re.search(
        r"^user graphs SHA-256 \w{64} AES-128 \w{32}$", (tmp_path / "snmp.keys").read_text(), re.M
    )
    out(both, tmp_path, "openrtu", "web-users", "web.users", "anna", "--role=viewer", typed="correct horse\n")
    assert (tmp_path / "web.users").read_text().startswith("anna viewer scrypt ")


def test_a_program_of_logic(both: Path, programs: Path, tmp_path: Path) -> None:
    for name in ("interlock.st", "interlock.test.csv"):
        shutil.copy(ROOT / "docs/examples/logic" / name, tmp_path)
    assert out(both, tmp_path, "openrtu", "logic", "check", "interlock.st") == ""
    assert "instructions" in out(both, tmp_path, "openrtu", "logic", "compile", "interlock.st")
    path = f"{programs}/logic:{BARE['PATH']}"
    assert ", 0 failed; " in out(both, tmp_path, "openrtu", "logic", "test", "interlock.st", PATH=path)


def test_a_missing_program_of_the_gateway_is_said(both: Path, tmp_path: Path) -> None:
    """One machine may have it installed: then another name is looked for."""
    (tmp_path / "p.st").write_text("PROGRAM p\nVAR_EXTERNAL a : BOOL; END_VAR\na := TRUE;\nEND_PROGRAM\n")
    (tmp_path / "p.test.csv").write_text("time,= a\n0,1\n")
    program = (
        "import sys; from openrtu_tools import programs; programs.INSTALLED.clear()\n"
        "from openrtu_tools.cli import main; sys.exit(main(['logic', 'test', 'p.st']))"
    )
    done = run(both, tmp_path, "python", "-c", program, PATH="/usr/bin:/bin")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == (
        "openrtu logic: logic-desk, a program of the gateway, is missing: "
        "install the gateway (docs/install.md), or set OPENRTU_LOGIC_DESK\n"
    )


@pytest.fixture(scope="module")
def with_centre(both: Path) -> Path:
    """As the tool itself says to install its extra: the wheel's name is on no index."""
    done = run(both, both, "openrtu", "centre", "centre.json", "serve")
    command = done.stderr.partition("type: ")[2]
    typed = subprocess.run(["sh", "-c", command], env=BARE, capture_output=True, text=True, check=False)
    assert typed.returncode == 0, typed.stdout + typed.stderr
    return both


@pytest.fixture
def centre(with_centre: Path, tmp_path: Path) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    port = free_port()
    (tmp_path / "centre.json").write_text(json.dumps({"stations": [], "centre": {"port": port}}))
    command = [with_centre / "openrtu", "centre", "centre.json", "serve"]
    with subprocess.Popen(command, cwd=tmp_path, env=BARE, stderr=subprocess.PIPE, text=True) as process:
        yield f"http://127.0.0.1:{port}", process
        process.terminate()


def test_the_centre_serves_its_page_without_a_clone(centre: tuple[str, subprocess.Popen[str]]) -> None:
    address, process = centre
    end = time.monotonic() + LIMIT_S
    while True:
        try:
            page = urllib.request.urlopen(address).read().decode()
            break
        except urllib.error.URLError as error:
            assert process.poll() is None, process.communicate()
            assert time.monotonic() < end, error
            time.sleep(0.1)
    for file in re.findall(r'(?:src|href)="([^":]+)"', page):
        assert urllib.request.urlopen(f"{address}/{file.lstrip('/')}").status == 200
    assert "js/main.js" in page


def test_the_centre_knows_its_users_and_its_collector(
    with_centre: Path, programs: Path, tmp_path: Path
) -> None:
    file = {"stations": [{"name": "a", "address": "127.0.0.1", "common_addresses": [1]}]}
    (tmp_path / "centre.json").write_text(json.dumps(file))
    words = ("openrtu", "centre", "centre.json")
    out(with_centre, tmp_path, *words, "user", "anna", "--role", "engineer", typed="correct horse\n")
    assert len(out(with_centre, tmp_path, *words, "token", "anna")) > 20
    (tmp_path / "rtu-centre.json").write_text(out(with_centre, tmp_path, *words, "collector"))
    out(programs / "centre", tmp_path, "rtu-centre", "--check", "rtu-centre.json")


def test_the_centre_starts_its_collector(with_centre: Path, programs: Path, tmp_path: Path) -> None:
    one = {"name": "a", "address": "127.0.0.1", "port": free_port(), "common_addresses": [1]}
    (tmp_path / "centre.json").write_text(json.dumps({"stations": [one]}))
    command = [with_centre / "openrtu", "centre", "centre.json", "collector", "--start"]
    named = BARE | {"OPENRTU_RTU_CENTRE": str(programs / "centre/rtu-centre")}
    with subprocess.Popen(command, cwd=tmp_path, env=named, stderr=subprocess.PIPE, text=True) as collector:
        end = time.monotonic() + LIMIT_S
        while not (tmp_path / "consumer").exists():
            assert collector.poll() is None, collector.communicate()
            assert time.monotonic() < end
            time.sleep(0.1)
        collector.terminate()
    assert collector.returncode == 0


def test_the_station_of_a_higher_centre_is_a_program_that_is_there(with_centre: Path, tmp_path: Path) -> None:
    (tmp_path / "points.csv").write_text("ca,ioa,type,name\n1,1,M_SP_NA_1,pump\n")
    (tmp_path / "token").write_text("secret\n")
    one = {"name": "a", "address": "192.0.2.1", "common_addresses": [1], "points": "points.csv"}
    higher = {"ca": 500, "token_file": "token"}
    (tmp_path / "centre.json").write_text(
        json.dumps({"stations": [one | {"higher": {"1": 0}}], "centre": {"higher": higher}})
    )
    (module,) = json.loads(out(with_centre, tmp_path, "openrtu", "centre", "centre.json", "station"))[
        "modules"
    ]
    assert module["program"] == str(with_centre / "openrtu-centre-station")
    assert os.access(module["program"], os.X_OK)
