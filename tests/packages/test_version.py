# SPDX-License-Identifier: GPL-3.0-or-later
"""One version: what programs, tools and packages say is the file that all of them take it from."""

import itertools
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from packaging.version import Version

from release.version import FORM, FORMS, debian, pep440, swupdate
from rig.versions import IN_ORDER

ROOT = Path(__file__).resolve().parents[2]
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


def test_version_has_the_form_that_the_others_are_made_of() -> None:
    assert FORM.fullmatch(VERSION)


@pytest.mark.parametrize(
    ("form", "candidate"), [("pep440", "1.0.0rc1"), ("debian", "1.0.0~rc1"), ("swupdate", "1.0.0-rc.1")]
)
def test_each_form(form: str, candidate: str) -> None:
    assert FORMS[form]("1.0.0-rc1") == candidate
    assert FORMS[form]("1.0.0") == "1.0.0"
    said = subprocess.run(
        [sys.executable, "-m", "release.version", form], cwd=ROOT / "scripts", capture_output=True, text=True
    )
    assert (said.returncode, said.stdout, said.stderr) == (0, f"{FORMS[form](VERSION)}\n", "")


def test_number_of_a_build_follows_swupdates() -> None:
    assert swupdate("1.0.0-rc1", 7) == "1.0.0-rc.1.7"
    assert swupdate("1.0.0", 65535) == "1.0.0.65535"
    for number in (0, -1, 65536):
        with pytest.raises(ValueError, match="no number of a build"):
            swupdate("1.0.0", number)


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["swupdate", "--build", "7"], 0, f"{swupdate(VERSION, 7)}\n"),
        (["swupdate", "--build", "65536"], 2, ""),
        (["debian", "--build", "7"], 2, ""),
    ],
)
def test_number_of_a_build_by_command(words: list[str], code: int, said: str) -> None:
    command = [sys.executable, "-m", "release.version", *words]
    done = subprocess.run(command, cwd=ROOT / "scripts", capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (code, said)
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("version", ["", "1.0", "1.0.0rc1", "1.0.0-rc", "1.0.0-beta1", "1.0.0-rc1\n"])
def test_what_is_no_version(version: str) -> None:
    for written in FORMS.values():
        with pytest.raises(ValueError, match="is no version of this tree"):
            written(version)


def test_candidates_sort_before_the_release_for_pip_and_dpkg() -> None:
    """By their own rules; by SWUpdate's: tests/linux/test_update_versions.py."""
    assert [str(Version(pep440(version))) for version in IN_ORDER] == list(map(pep440, IN_ORDER))
    for older, newer in itertools.pairwise(IN_ORDER):
        assert Version(pep440(older)) < Version(pep440(newer))
        subprocess.run(["dpkg", "--compare-versions", debian(older), "lt", debian(newer)], check=True)


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
    for package in ("package/openrtu/python/openrtu", "scripts/nuc980"):
        link = ROOT / package / "VERSION"
        assert link.is_symlink() and link.samefile(ROOT / "package/openrtu/src/VERSION")
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
