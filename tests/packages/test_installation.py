# SPDX-License-Identifier: GPL-3.0-or-later
"""The gateway on a Linux machine: `make install`, the unit of systemd, man pages."""

import os
import re
import shutil
import subprocess
import sysconfig
from collections.abc import Mapping
from pathlib import Path

import pytest
from test_version import VERSION

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]
MODULES = {
    "rtu-modbus",
    "rtu-iec104",
    "rtu-iec104-tls",
    "rtu-journal",
    "rtu-goose",
    "rtu-gps",
    "rtu-logic",
    "rtu-104m",
    "rtu-104m-tls",
    "rtu-snmp",
    "rtu-iec61850",
    "rtu-iec61850-tls",
    "rtu-synch",
    "rtu-web",
}
DESK = {"logic-desk", "journal-events"}
TEMPLATES = {
    str(path.relative_to(ROOT / "package/openrtu/src/templates"))
    for path in (ROOT / "package/openrtu/src/templates").rglob("*.json")
}
PAGES = {"rtuctl.1", "rtu-centre.1", "rtud.8", *(f"{name}.8" for name in MODULES)}
TOOLS_PAGES = {"openrtu.1", "nuc980-pins.1", "nuc980-netboot.1"}
# libopenrtu, where this machine's architecture has its libraries.
LIBRARIES = Path("usr/local/lib") / (sysconfig.get_config_var("MULTIARCH") or "")
LIBRARY = {"libopenrtu.so", "libopenrtu.so.0", "pkgconfig/openrtu.pc"}
EXPOSURE = 40  # of 100 at most, as systemd-analyze sees the unit: 37 with the capabilities that rtud needs


# What is looked at is what lands where. The compiler's time is for the builds that run.
QUICK = {"CFLAGS": "-O0 -g0"}


def run(*words: str | Path, code: int = 0, settings: Mapping[str, str] | None = None) -> str:
    environment = {
        name: value for name, value in os.environ.items() if not name.startswith(("MAKE", "MFLAGS"))
    } | dict(settings or {})
    done = subprocess.run(
        words,
        cwd=ROOT,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    assert done.returncode == code, done.stdout
    return done.stdout


def make(*words: str) -> None:
    """In a build of its own: what a user installs is built as release."""
    run("make", *words, "INSTALLED=build/installed-tested", settings=QUICK)


def files_of(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if not path.is_dir()}


def check_unit(unit: Path, rtud: Path, folder: Path) -> None:
    """systemd-analyze finds no fault in it, with the program where it is here, and sees it confined."""
    here = folder / "rtud.service"
    text = re.sub(r"(?m)^ExecStart=\S+", f"ExecStart={rtud}", unit.read_text())
    here.write_text(text)
    assert run("systemd-analyze", "verify", "--man=no", here) == ""
    run("systemd-analyze", "security", "--offline=true", f"--threshold={EXPOSURE}", "--no-pager", here)


# ---- make install ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("install")
    make("install", f"DESTDIR={folder}")
    return folder


def test_install_puts_everything_in_its_place(installed: Path) -> None:
    assert files_of(installed) == {
        "etc/openrtu/gateway.json",
        "usr/local/bin/rtu-centre",
        "usr/local/bin/rtuctl",
        "usr/local/lib/systemd/system/rtud.service",
        "usr/local/lib/sysusers.d/openrtu.conf",
        "usr/local/sbin/rtud",
        "usr/local/include/openrtu.h",
        *(f"{LIBRARIES}/{name}" for name in LIBRARY),
        *(f"usr/local/libexec/openrtu/{name}" for name in MODULES | DESK),
        *(f"usr/local/share/openrtu/templates/{name}" for name in TEMPLATES),
        *(f"usr/local/share/man/man{page[-1]}/{page}" for page in PAGES),
        "usr/local/share/openrtu/wireshark/asdu201.lua",
        "usr/local/share/snmp/mibs/OPENRTU-MIB.txt",
        "usr/local/share/bash-completion/completions/rtuctl.bash",
    }
    check_unit(
        installed / "usr/local/lib/systemd/system/rtud.service", installed / "usr/local/sbin/rtud", installed
    )


def test_install_keeps_what_was_configured(installed: Path) -> None:
    file = installed / "etc/openrtu/gateway.json"
    file.write_text("mine")
    make("install", f"DESTDIR={installed}")
    assert file.read_text() == "mine"


def test_each_module_number_has_its_user(tmp_path: Path) -> None:
    """rtud counts from 61200: the own modules first, then those of others, as many as a map has."""
    (tmp_path / "etc").mkdir()
    run("systemd-sysusers", f"--root={tmp_path}", ROOT / "package/openrtu/src/systemd/openrtu.sysusers")
    rows = [line.split(":") for line in (tmp_path / "etc/passwd").read_text().splitlines()]
    header = (ROOT / "package/openrtu/src/map/config.h").read_text()
    most = re.search(r"#define MAP_MODULES_MAX\s+(\d+)", header)
    assert most is not None
    users = {int(row[2]): int(row[3]) for row in rows if row[0].startswith("openrtu")}
    assert users == {61200 + number: 61200 for number in range(1, 2 * int(most[1]) + 1)}


# ---- man pages -------------------------------------------------------------------------------------


def test_man_pages_are_of_every_program_and_without_faults() -> None:
    folder = ROOT / "build/man"
    shutil.rmtree(folder, ignore_errors=True)
    make("man")
    assert {page.name for page in folder.iterdir()} == PAGES | TOOLS_PAGES
    for page in folder.iterdir():
        assert run("mandoc", "-T", "lint", "-W", "warning", page) == ""
        shown = run("man", "--local-file", "--encoding=ascii", page)
        assert "NAME" in shown and f"OpenRTU {VERSION}" in shown


def test_man_pages_hold_what_help_says(programs: Path) -> None:
    page = run("man", "--local-file", "--encoding=ascii", ROOT / "build/man/rtuctl.1")
    words = re.findall(r"^  ([a-z][a-z0-9]+) ", run(programs / "rtuctl/rtuctl", "--help"), re.MULTILINE)
    assert "points" in words
    assert [word for word in words if not re.search(rf"^   {word}$", page, re.MULTILINE)] == []
    pins = run("man", "--local-file", "--encoding=ascii", ROOT / "build/man/nuc980-pins.1")
    assert "--chip-only" in pins and "COMMANDS" in pins
    tools = run("man", "--local-file", "--encoding=ascii", ROOT / "build/man/openrtu.1")
    assert re.findall(r"^   (logic test|centre file user|snmp-keys)$", tools, re.MULTILINE) == [
        "logic test", "snmp-keys", "centre file user",
    ]  # fmt: skip
