# SPDX-License-Identifier: GPL-3.0-or-later
"""One version: what programs, tools and packages say is the file that all of them take it from."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
VERSION = (ROOT / "package/openrtu/src/VERSION").read_text().strip()
MODULES = (
    "rtu-modbus",
    "rtu-iec104",
    "rtu-iec104-tls",
    "rtu-104m-tls",
    "rtu-iec61850-tls",
    "rtu-journal",
    "rtu-logic",
    "rtu-synch",
)


def output_of(*command: str | Path) -> str:
    done = subprocess.run(
        [*command, "--version"], cwd=ROOT / "scripts", capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


def test_version_is_one_that_packages_can_have() -> None:
    """Debian, PyPI and Buildroot take three numbers."""
    assert re.fullmatch(r"\d+\.\d+\.\d+", VERSION)


@pytest.mark.parametrize(
    "program", ["rtud/rtud", "rtuctl/rtuctl", "centre/rtu-centre", *(f"modules/{name}" for name in MODULES)]
)
def test_programs_of_the_gateway(programs: Path, program: str) -> None:
    assert output_of(programs / program) == f"{Path(program).name} (OpenRTU) {VERSION}\n"


def test_simulated_devices(linesim_program: Path) -> None:
    assert output_of(linesim_program) == f"linesim (OpenRTU) {VERSION}\n"


@pytest.mark.sample(3)
@pytest.mark.parametrize("tool", ["nuc980-pins", "nuc980-netboot", "openrtu"])
def test_python_tools(tool: str) -> None:
    assert output_of(ROOT / "scripts" / tool) == f"{tool} (OpenRTU) {VERSION}\n"


def test_show_of_the_emulated_board() -> None:
    assert output_of(sys.executable, "-m", "lab.twin_show") == f"make twin (OpenRTU) {VERSION}\n"


def test_packages_take_it_from_the_file() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    assert project["tool"]["setuptools"]["dynamic"]["version"] == {"file": "package/openrtu/src/VERSION"}
    package = (ROOT / "package/openrtu/python/openrtu/__init__.py").read_text()
    assert f'\nVERSION = "{VERSION}"  #' in package
    buildroot = (ROOT / "package/openrtu/openrtu.mk").read_text()
    assert "OPENRTU_VERSION = $(shell cat $(OPENRTU_SITE)/VERSION)\n" in buildroot


@pytest.mark.sample(4)
@pytest.mark.parametrize("module", MODULES)
def test_modules_say_who_starts_them(programs: Path, module: str) -> None:
    asked = subprocess.run(
        [programs / "modules" / module, "--help"], capture_output=True, text=True, check=False
    )
    wrong = subprocess.run([programs / "modules" / module], capture_output=True, text=True, check=False)
    assert (asked.returncode, asked.stderr) == (0, "")
    assert asked.stdout.startswith(f"usage: {module} ") and "rtud starts" in asked.stdout
    assert (wrong.returncode, wrong.stdout, wrong.stderr) == (2, "", asked.stdout)
