# SPDX-License-Identifier: GPL-3.0-or-later
"""Builds that leave a module out, or have one more: what they install, what they refuse and what they run."""

import json
import os
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from lab.gateway import Gateway, free_port, listening_on, remove, run_directory
from lab.linesim import LineSim
from rig.desk import CHAPTER_5, chapter_5, errors_of, everything_read

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]
SOURCES = ROOT / "package/openrtu/src"
EVERYWHERE = {
    "rtud",
    "rtuctl",
    "rtuctl.bash",
    "rtu-goose",
    "rtu-gps",
    "rtu-iec61850",
    "rtu-logic",
    "rtu-synch",
    *(path.name for path in (SOURCES / "templates").rglob("*.json")),
}
LIBRARY = {"libopenrtu.so", "libopenrtu.so.0", "openrtu.h", "openrtu.pc"}
EVERYWHERE |= LIBRARY
LINES = ("rtu-modbus-1", "rtu-modbus-2")
NO_IEC104 = (
    "iec104: this build has no rtu-iec104: remove the key, or build with -Diec104=true, in Buildroot "
    "BR2_PACKAGE_OPENRTU_IEC104\n"
)
NO_MODBUS = (
    "port: this build has no rtu-modbus: make no port active, or build with -Dmodbus=true, in Buildroot "
    "BR2_PACKAGE_OPENRTU_MODBUS\n"
)
NO_TLS = (
    "tls: this build has no rtu-iec104-tls: remove the object, or build with -Dtls=true, in Buildroot "
    "BR2_PACKAGE_OPENRTU_TLS\n"
)

NO_IEC61850_TLS = NO_TLS.replace(
    "tls: this build has no rtu-iec104-tls", "iec61850.tls: this build has no rtu-iec61850-tls"
)

CHEAP = ("-Dtests=disabled", "-Doptimization=0", "-Ddebug=false")  # a third of the compiler's time


def built(folder: Path, *options: str) -> Path:
    for command in (
        ["meson", "setup", folder, SOURCES, *CHEAP, *options],
        ["meson", "install", "-C", folder, "--destdir", folder / "installed"],
    ):
        run = subprocess.run(command, capture_output=True, text=True, check=False)
        assert run.returncode == 0, run.stdout + run.stderr
    return folder


@pytest.fixture(scope="module")
def without_iec104(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return built(tmp_path_factory.mktemp("build") / "without-iec104", "-Diec104=false")


@pytest.fixture(scope="module")
def without_modbus(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return built(tmp_path_factory.mktemp("build") / "without-modbus", "-Dmodbus=false")


@pytest.fixture
def directory() -> Iterator[Path]:
    directory = run_directory()
    yield directory
    remove(directory)


def installed(build: Path) -> set[str]:
    return {path.name for path in (build / "installed").rglob("*") if path.is_file()}


def lines_only() -> dict[str, Any]:
    """Chapter 5 without its IEC 60870-5-104 side."""
    config = chapter_5()
    del config["iec104"]
    return config


def station_only() -> dict[str, Any]:
    """Chapter 5 with no port active."""
    config = chapter_5()
    for port in config["port"]:
        port["active"] = 0
    return listening_on(config, free_port())


def refused(build: Path, directory: Path, config: dict[str, Any] | None = None) -> str:
    """What rtud says of a configuration, chapter 5, when asked to check it and when started with it."""
    file, segments = directory / "refused.json", directory / "map"
    file.write_text(json.dumps(config or chapter_5()))
    messages = set()
    for options in (["--check"], ["--map", segments, "--modules", build / "modules"]):
        command = [build / "rtud" / "rtud", *options, file]
        run = subprocess.run(command, capture_output=True, text=True, timeout=10, check=False)
        assert (run.returncode, run.stdout) == (2, "")
        messages.add(errors_of(run.stderr))
    assert not segments.exists()
    assert len(messages) == 1
    return messages.pop().replace(f"{file}:1: ", "")


def test_left_out_is_not_installed(without_iec104: Path, without_modbus: Path) -> None:
    assert installed(without_iec104) == EVERYWHERE | {"rtu-modbus"}
    assert installed(without_modbus) == EVERYWHERE | {"rtu-104m", "rtu-iec104", "rtu-journal", "rtu-centre"}


def test_configuration_that_needs_what_is_left_out_is_refused(
    without_iec104: Path, without_modbus: Path, directory: Path
) -> None:
    assert refused(without_iec104, directory) == NO_IEC104
    assert refused(without_iec104, directory, lines_only() | {"journal": {}}) == NO_IEC104.replace(
        "iec104:", "journal:", 1
    )
    assert refused(without_modbus, directory) == NO_MODBUS
    files = {"certificate": "/own.pem", "key": "/own.key", "ca": "/ca.pem"}
    assert refused(without_modbus, directory, station_only() | {"tls": files}).endswith(NO_TLS)
    server = {"iec61850": {"address": "127.0.0.1", "tls": files}}
    assert refused(without_modbus, directory, station_only() | server).endswith(NO_IEC61850_TLS)


def test_lines_run_without_the_station(without_iec104: Path, directory: Path) -> None:
    gateway = Gateway(lines_only(), directory, without_iec104)
    command = [gateway.build / "rtud" / "rtud", "--map", gateway.map, "--dev", gateway.dev]
    command += ["--modules", gateway.build / "modules", gateway.config_file]
    with (
        LineSim(gateway.config_file, CHAPTER_5 / "values.json", gateway.dev),
        gateway.log_file.open("wb") as log,
        subprocess.Popen(command, stdin=subprocess.DEVNULL, stderr=log) as gateway.process,
    ):
        try:
            gateway.wait_for(lambda: gateway.ctl("modules", check=False) != "", 60.0, "there is a map")
            gateway.wait_for(lambda: everything_read(gateway), 60.0, "every device has been read")
            modules = gateway.modules()
            assert {name: modules[name]["state"] for name in ("rtu-iec104", *LINES)} == {
                "rtu-iec104": "stopped",
                LINES[0]: "running",
                LINES[1]: "running",
            }
            assert [module["restarts"] for module in modules.values()] == [0] * len(modules)
            if os.geteuid() == 0:  # the numbers are those of a build with both
                users = [Path(f"/proc/{modules[name]['pid']}").stat().st_uid for name in LINES]
                assert users == [61203, 61204]
        finally:
            assert gateway.stop() == 0


def test_station_runs_without_the_lines(without_modbus: Path, directory: Path) -> None:
    with Gateway(station_only(), directory, without_modbus) as gateway:  # up: the station has answered
        modules = gateway.modules()
    assert set(modules) == {"rtud", "rtu-iec104", "rtuctl"}
    assert modules["rtu-iec104"]["restarts"] == 0


# ---- one more ------------------------------------------------------------------------------------

# Beside its folder: one line of the table, the build files (and its page in docs).
TOUCHED = {
    "rtud/kinds.c": ("\tKIND(rtuctl) ", "\tKIND(rtuctl) KIND(probe) "),
    "rtud/meson.build": (
        "'../modules/modbus/kind.c',",
        "'../modules/modbus/kind.c', '../modules/probe/kind.c',",
    ),
    "modules/meson.build": (
        "\nif cmocka.found()",
        "\nexecutable('rtu-probe', 'probe/main.c', dependencies: module_dep)\nif cmocka.found()",
    ),
}


@pytest.fixture
def with_probe(tmp_path: Path) -> Path:
    """A build with a kind of module that this tree does not have."""
    sources, build = tmp_path / "src", tmp_path / "build"
    shutil.copytree(SOURCES, sources)
    shutil.copytree(ROOT / "tests/fixtures/probe", sources / "modules/probe")
    for name, (old, new) in TOUCHED.items():
        text = (sources / name).read_text()
        assert old in text, f"{name} has no longer the place where a kind is added"
        (sources / name).write_text(text.replace(old, new, 1))
    for command in (
        ["meson", "setup", build, sources, *CHEAP, "-Diec104=false", "-Dmodbus=false"],
        ["ninja", "-C", build, "rtud/rtud", "rtuctl/rtuctl", "modules/rtu-probe"],
    ):
        run = subprocess.run(command, capture_output=True, text=True, check=False)
        assert run.returncode == 0, run.stdout + run.stderr
    return build


def counters_of(gateway: Gateway, module: str) -> dict[str, int]:
    rows = json.loads(gateway.ctl("--json", "counters", module))
    return {row["counter"]: row["value"] for row in rows}


def checked(build: Path, directory: Path, config: dict[str, Any]) -> str:
    """What rtud says of a configuration that is wrong."""
    file = directory / "wrong.json"
    file.write_text(json.dumps(config))
    command = [build / "rtud" / "rtud", "--check", file]
    run = subprocess.run(command, capture_output=True, text=True, timeout=10, check=False)
    assert run.returncode == 1
    return run.stderr


def test_a_new_kind_touches_its_folder_one_line_and_the_build(with_probe: Path, directory: Path) -> None:
    wrong = checked(with_probe, directory, {"port": [], "probe": {"period": 200}})
    assert wrong.endswith('wrong.json:1: probe.period: unknown key, did you mean "period_ms"?\n')
    gateway = Gateway({"port": [], "probe": {"period_ms": 200}}, directory, with_probe)
    command = [gateway.build / "rtud" / "rtud", "--map", gateway.map]
    command += ["--modules", gateway.build / "modules", gateway.config_file]
    with (
        gateway.log_file.open("wb") as log,
        subprocess.Popen(command, stdin=subprocess.DEVNULL, stderr=log) as gateway.process,
    ):
        try:
            gateway.wait_for(lambda: gateway.ctl("modules", check=False) != "", 60.0, "there is a map")
            gateway.wait_for(lambda: gateway.modules()["rtu-probe"]["alive"], 60.0, "the new module lives")
            assert gateway.modules()["rtu-probe"]["kind"] == "probe"
            begun = "rtu-probe info: probes every 200 ms"
            gateway.wait_for(lambda: begun in gateway.log(), 10.0, "its log is rtud's")
            gateway.wait_for(lambda: counters_of(gateway, "rtu-probe")["probes"] > 1, 60.0, "it counts")
        finally:
            gateway.process.terminate()
