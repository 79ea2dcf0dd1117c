# SPDX-License-Identifier: GPL-3.0-or-later
"""The Debian packages: what `make deb` makes, and installed in a minimal Debian."""

import io
import json
import os
import re
import shutil
import struct
import subprocess
import tarfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from test_installation import check_unit, files_of, run
from test_version import VERSION

from lab.gateway import free_port
from lab.manager import WATCH, Manager, free_udp_port
from lab.patience import Deadline
from peers.device import FIRST_ADDRESS, UNIT
from peers.pymodbus_device import PymodbusDevice
from release.version import debian
from rig import debian_root, packaged
from rig.debian_root import NEEDS_ROOT, DebianRoot
from rig.desk import patience
from rig.packaged import built, file_of
from rig.web import PASSWORD, Client

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]
DEBIAN_VERSION = debian(VERSION)
OLDER = "1.0.0~"  # before it the centre was in the gateway's package: Breaks
MACHINE = subprocess.run(
    ["dpkg", "--print-architecture"], capture_output=True, text=True, check=True
).stdout.strip()
ARCHITECTURES = {
    "openrtu": MACHINE,
    "libopenrtu0": MACHINE,
    "libopenrtu-dev": MACHINE,
    "openrtu-centre": MACHINE,
    "openrtu-tools": "all",
    "python3-openrtu": "all",
}
PATIENCE_S = 60.0


@pytest.fixture(scope="module")
def packages() -> Path:
    return packaged.packages()


def field(package: Path, name: str) -> str:
    return run("dpkg-deb", "--field", package, name).strip()


# ---- as they are made ------------------------------------------------------------------------------


def test_they_are_what_debian_asks_for(packages: Path) -> None:
    made = {field(file, "Package"): field(file, "Architecture") for file in packages.glob("*.deb")}
    assert made == ARCHITECTURES
    assert {field(file, "Version") for file in packages.glob("*.deb")} == {DEBIAN_VERSION}
    for library in ("libc6", "libjansson4", "libseccomp2", "libssl3"):
        assert library in field(file_of(packages, "openrtu"), "Depends")
    assert (packages / "lintian.log").read_text() == ""


def test_same_source_gives_the_same_bytes(packages: Path, tmp_path: Path) -> None:
    """In whatever folder, and at another time of another user's mask."""
    folder = tmp_path / "a folder, größer"
    before = os.umask(0o077)
    try:
        built(folder)
    finally:
        os.umask(before)
    names = sorted(file.name for file in packages.glob("*.deb"))
    assert sorted(file.name for file in folder.glob("*.deb")) == names
    assert [name for name in names if (folder / name).read_bytes() != (packages / name).read_bytes()] == []


def test_all_in_them_is_of_the_sources_date(packages: Path) -> None:
    """Whenever the tree was cloned. dpkg leaves alone what is older."""
    date = int(run(ROOT / "scripts/source-date.sh"))
    dates = set()
    for package in packages.glob("*.deb"):
        contents = subprocess.run(["dpkg-deb", "--fsys-tarfile", package], capture_output=True, check=True)
        with tarfile.open(fileobj=io.BytesIO(contents.stdout)) as archive:
            dates |= {entry.mtime for entry in archive}
    assert dates == {date}


def test_symbols_of_the_library_have_the_nodes_of_its_map() -> None:
    nodes = re.findall(r"^(OPENRTU_\d+) \{", (ROOT / "package/openrtu/src/lib/openrtu.map").read_text(), re.M)
    symbols = (ROOT / "package/openrtu/debian/libopenrtu0.symbols").read_text()
    assert re.findall(r"^ \(symver\)(\w+) ", symbols, re.M) == nodes


def test_program_is_built_on_the_library_alone(packages: Path, tmp_path: Path) -> None:
    for name in ("libopenrtu0", "libopenrtu-dev"):
        run("dpkg-deb", "--extract", file_of(packages, name), tmp_path)
    (folder,) = tmp_path.glob("usr/lib/*/pkgconfig")
    settings = {"PKG_CONFIG_LIBDIR": str(folder), "PKG_CONFIG_SYSROOT_DIR": str(tmp_path)}
    flags = run("pkg-config", "--cflags", "--libs", "openrtu", settings=settings).split()
    example = tmp_path / "usr/share/doc/libopenrtu-dev/examples/filter.c"
    run("cc", "-o", tmp_path / "filter", example, *flags)
    assert "libopenrtu.so.0" in run("readelf", "--dynamic", tmp_path / "filter")


@pytest.mark.parametrize(("architecture", "qemu"), [("arm64", "qemu-aarch64"), ("armhf", "qemu-arm")])
def test_programs_of_another_architecture_run(architecture: str, qemu: str, tmp_path: Path) -> None:
    """All of them, on the libraries that they were linked with."""
    made = [*(ROOT / "build/deb").glob(f"*_{architecture}.deb")]
    if not made:
        pytest.skip(
            f"there are no packages of it: make deb DEB_ARCHS={architecture} takes a quarter of an hour"
        )
    for package in made:
        run("dpkg-deb", "--extract", package, tmp_path)
    folders = [tmp_path / "usr" / name for name in ("bin", "sbin", "libexec/openrtu")]
    programs = {path.name: path for folder in folders for path in folder.glob("rtu*")}
    assert {"rtud", "rtuctl", "rtu-centre", "rtu-modbus"} <= set(programs)
    for name, program in programs.items():
        said = run(qemu, "-L", ROOT / "build/deb-roots" / architecture, program, "--version")
        assert said == f"{name} (OpenRTU) {VERSION}\n"
    assert (tmp_path / "usr/share/man/man8/rtud.8.gz").exists()


# ---- the gateway's package in a folder: without root and network -----------------------------------


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A root of its own for dpkg, with its database."""
    for folder in ("etc", "var/lib/dpkg/info", "var/lib/dpkg/updates", "var/lib/dpkg/triggers"):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / "var/lib/dpkg/status").touch()
    return tmp_path


def dpkg(root: Path, *words: str | Path) -> None:
    """Scripts of the package run outside, and are told of the root. What it depends on is this machine's."""
    run("dpkg", f"--root={root}", "--force-script-chrootless", "--force-depends", *words)


def test_gateway_is_installed_used_and_removed(packages: Path, root: Path) -> None:
    package = file_of(packages, "openrtu")
    before = {"etc/.pwd.lock", "etc/group", "etc/gshadow", "etc/passwd", "etc/shadow"}
    dpkg(root, "--install", package)
    assert "openrtu-1:x:61201:61200:" in (root / "etc/passwd").read_text()
    config = root / "etc/openrtu/gateway.json"
    assert run(root / "usr/sbin/rtud", "--check", config) == f"{config}: good: lines 0, devices 0, points 0\n"
    assert run(root / "usr/bin/rtuctl", "--version") == f"rtuctl (OpenRTU) {VERSION}\n"
    check_unit(root / "lib/systemd/system/rtud.service", root / "usr/sbin/rtud", root)

    config.write_text("mine")
    dpkg(root, "--install", package)
    assert config.read_text() == "mine"
    dpkg(root, "--remove", "openrtu")
    assert config.read_text() == "mine"
    dpkg(root, "--purge", "openrtu")
    assert {name for name in files_of(root) if not name.startswith(("var/", "rtud.service"))} == before


# ---- installed -------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def older(packages: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same as a former version."""
    folder = tmp_path_factory.mktemp("older")
    for package in packages.glob("*.deb"):
        contents = folder / package.stem
        run("dpkg-deb", "--raw-extract", package, contents)
        control = contents / "DEBIAN/control"
        control.write_text(control.read_text().replace(f"{DEBIAN_VERSION}", OLDER))
        run("dpkg-deb", "--build", "--root-owner-group", contents, folder / package.name)
        shutil.rmtree(contents)
    return folder


@pytest.fixture
def bare(packages: Path, tmp_path: Path) -> DebianRoot:
    debian = DebianRoot(debian_root.unpacked(tmp_path / "root"))
    debian.apt("update")
    return debian


@pytest.fixture
def debian(bare: DebianRoot, packages: Path) -> DebianRoot:
    """What the packages need of Debian is there already, so that what is new is theirs."""
    needs = [field(file, "Depends").split(", ") for file in packages.glob("*.deb")]
    others = sorted({need for row in needs for need in row if need.split()[0] not in ARCHITECTURES})
    bare.apt("satisfy", *others)
    return bare


def install(debian: DebianRoot, folder: Path, *names: str) -> None:
    """With what they need."""
    there = debian.folder / "srv"
    shutil.copytree(folder, there, dirs_exist_ok=True)
    debian.apt("install", *(f"/srv/{file_of(folder, name).name}" for name in names))


def versions(debian: DebianRoot) -> set[str]:
    shown = debian.run("dpkg-query", "--show", "--showformat=${Package} ${Version}\\n", *ARCHITECTURES)
    return set(shown.splitlines())


def users_of(debian: DebianRoot) -> set[str]:
    return {line.partition(":")[0] for line in (debian.folder / "etc/passwd").read_text().splitlines()}


def check_services(debian: DebianRoot) -> None:
    """systemd finds no fault where they lie, misses no program, and starts them with the machine."""
    for name in ("rtud", "openrtu-centre", "openrtu-centre-collector"):
        unit = f"/lib/systemd/system/{name}.service"
        assert debian.run("systemd-analyze", "verify", "--man=no", unit) == ""
        enabled = debian.folder / f"etc/systemd/system/multi-user.target.wants/{name}.service"
        assert str(enabled.readlink()) == unit


@NEEDS_ROOT
def test_installed_upgraded_removed_and_purged(debian: DebianRoot, packages: Path, older: Path) -> None:
    before = debian.files()
    install(debian, older, *ARCHITECTURES)
    assert versions(debian) == {f"{name} {OLDER}" for name in ARCHITECTURES}
    assert {"openrtu-1", "openrtu-32", "openrtu-centre"} <= users_of(debian)
    config = debian.folder / "etc/openrtu/gateway.json"
    assert "good" in debian.run("rtud", "--check", "/etc/openrtu/gateway.json")
    config.write_text(config.read_text() + "\n\n")
    mine = config.read_text()

    install(debian, packages, *ARCHITECTURES)
    assert versions(debian) == {f"{name} {DEBIAN_VERSION}" for name in ARCHITECTURES}
    assert config.read_text() == mine
    assert debian.run("dpkg", "--audit") == ""
    assert debian.run("rtuctl", "--version") == f"rtuctl (OpenRTU) {VERSION}\n"
    check_services(debian)

    kept = [debian.folder / "var/lib" / name for name in ("openrtu/journal/0", "openrtu-centre/centre.db")]
    for file in kept:
        file.parent.mkdir(parents=True)
        file.touch()
    debian.apt("remove", *ARCHITECTURES)
    assert config.read_text() == mine and all(file.exists() for file in kept)
    debian.apt("purge", "openrtu", "openrtu-centre")  # apt knows nothing any more of the others
    # Debian keeps the users that a package has made: what is somebody's stays somebody's.
    users = {
        f"etc/{name}{backup}" for name in ("passwd", "group", "shadow", "gshadow") for backup in ("", "-")
    }
    assert debian.files() - users == before - users
    assert {"openrtu-1", "openrtu-centre"} <= users_of(debian)


@contextmanager
def gateway(debian: DebianRoot) -> Iterator[None]:
    with debian.running("rtud", "/etc/openrtu/gateway.json") as rtud:
        yield
        assert rtud.poll() is None, (debian.folder / "running.log").read_text()


def pass_until(debian: DebianRoot, name: str, holds: Callable[[dict[str, Any]], bool]) -> None:
    """Until a point is as it should be."""
    deadline = Deadline(PATIENCE_S)
    point: dict[str, Any] = {}
    while not (point and holds(point)):
        assert deadline.left > 0, ((debian.folder / "running.log").read_text(), point)
        done = subprocess.run(
            debian.command("rtuctl", "--json", "points", name), capture_output=True, check=False
        )
        (point,) = json.loads(done.stdout) if done.returncode == 0 else ({},)
        time.sleep(0.2)


TANK = """#!/usr/bin/env python3
from openrtu import Module

with Module() as module:
    for _ in module.scans():
        module["tank.level"] = 60
"""


def ten_lines() -> str:
    """The module and its entry, as the page has them."""
    page = (ROOT / "docs/writing-a-module.md").read_text()
    entry = re.search(r'^```json\n("modules": \[.*?^\])\n```', page, re.M | re.S)
    assert entry is not None
    return entry[1]


@NEEDS_ROOT
def test_module_in_ten_lines_runs_on_the_packages_alone(bare: DebianRoot, packages: Path) -> None:
    debian = bare
    install(debian, packages, "openrtu", "libopenrtu0", "python3-openrtu")
    programs = debian.folder / "usr/local/lib/openrtu"
    programs.mkdir(parents=True)
    debian.run("cp", "/usr/share/doc/python3-openrtu/examples/pump.py", "/usr/local/lib/openrtu")
    (programs / "tank.py").write_text(TANK)
    for program in programs.iterdir():
        program.chmod(0o755)
    config = json.loads(f"{{{ten_lines()}}}") | {
        "iec104": {"address": "127.0.0.1", "port": free_port()},
        "port": [],
    }
    tank = {
        "name": "tank", "program": "/usr/local/lib/openrtu/tank.py", "period_ms": 500, "ca": 909,
        "points": [{"name": "tank.level", "type": "float", "ioa": 1}],
    }  # fmt: skip
    config["modules"].append(tank)
    (debian.folder / "etc/openrtu/gateway.json").write_text(json.dumps(config))
    with gateway(debian):
        pass_until(debian, "pump", lambda pump: bool(pump["value"]) and pump["quality"] == "good")


# What a spreadsheet with a decimal comma saves.
POINTS = f"""ca;ioa;type;name;port;id;table;register;format;scale;unit
7017;1;M_ME_NC_1;level;7;{UNIT};input_registers;30017;uint16;0,1;%
7017;2;M_SP_NA_1;door_open;7;{UNIT};discrete_inputs;10017;;;
"""
RAW_LEVEL, LEVEL = 905, 90.5


def lines_of_station(device: int, page: int, agent: int) -> dict[str, Any]:
    """Without points: these are in the list."""
    return {
        "iec104": {"address": "127.0.0.1", "port": free_port()},
        "port": [
            {"value": 7, "active": 1, "host": "127.0.0.1", "tcp_port": device,
             "slaves": [{"id": UNIT, **patience()}]}
        ],
        "web": {"port": page, "users": "/etc/openrtu/web.users"},
        "snmp": {
            "address": "127.0.0.1", "port": agent, "keys": "/etc/openrtu/snmp.keys",
            "state": "/var/lib/openrtu/snmp", "users": [{"name": WATCH.name, "role": "viewer"}],
        },
        "logic": [
            {"name": "pump", "program": "pump.rtul", "ca": 7100,
             "points": [{"name": "pump", "ioa": 1}, {"name": "starts", "ioa": 2}]}
        ],
    }  # fmt: skip


def tools_of_their_package(debian: DebianRoot, packages: Path) -> str:
    install(debian, packages, "openrtu-tools")
    return "openrtu"


def tools_of_their_wheel(debian: DebianRoot, _packages: Path) -> str:
    """As install.md has it for all users."""
    debian.apt("install", "python3-venv")
    packaged.wheels_with_needs(debian.folder / "srv/wheels")
    debian.run("python3", "-m", "venv", "/opt/openrtu")
    debian.run("/opt/openrtu/bin/pip", "install", "--no-index", "--find-links=/srv/wheels", "openrtu-tools")
    return "/opt/openrtu/bin/openrtu"


@NEEDS_ROOT
@pytest.mark.parametrize("tools", [tools_of_their_package, tools_of_their_wheel])
def test_station_of_five_parts_is_made_without_a_clone(
    bare: DebianRoot, packages: Path, tmp_path: Path, tools: Callable[[DebianRoot, Path], str]
) -> None:
    """A Modbus device, its points by a list, a program of logic, users of the page, keys of SNMP."""
    install(bare, packages, "openrtu")
    openrtu = tools(bare, packages)
    etc = bare.folder / "etc/openrtu"
    device, page, agent = free_port(), free_port(), free_udp_port()
    (etc / "points.csv").write_text(POINTS)
    (etc / "lines.json").write_text(json.dumps(lines_of_station(device, page, agent)))
    for name in ("pump.st", "pump.test.csv"):
        shutil.copy(ROOT / "docs/examples/logic" / name, etc)
    (etc / "phrases").write_text(f"{WATCH.name} {WATCH.authentication} {WATCH.encryption}\n")

    made = bare.run(openrtu, "points", "/etc/openrtu/points.csv", "--lines", "/etc/openrtu/lines.json")
    (etc / "gateway.json").write_text(made)
    assert ", 0 failed; " in bare.run(openrtu, "logic", "test", "/etc/openrtu/pump.st")
    bare.run(openrtu, "logic", "compile", "/etc/openrtu/pump.st", "-o", "/etc/openrtu/pump.rtul")
    words = ("web-users", "/etc/openrtu/web.users", "anna", "--role=viewer")
    bare.run(openrtu, *words, typed=f"{PASSWORD}\n")
    keys = ("/etc/openrtu/gateway.json", "/etc/openrtu/snmp.keys", "--passphrases=/etc/openrtu/phrases")
    bare.run(openrtu, "snmp-keys", *keys)
    assert "good: lines 1, devices 1, points 4" in bare.run("rtud", "--check", "/etc/openrtu/gateway.json")

    meter = PymodbusDevice(device)
    meter.start()
    try:
        meter.set("input_registers", FIRST_ADDRESS, [RAW_LEVEL])
        with gateway(bare):
            pass_until(bare, "level", lambda point: point["value"] == LEVEL and point["quality"] == "good")
            pass_until(bare, "pump", lambda point: bool(point["value"]) and point["quality"] == "good")
            client = Client(page)
            assert client.log_in("anna").status == 200
            assert {row["name"]: row["value"] for row in client.rows("/api/points")}["level"] == LEVEL
            octets = struct.pack(">f", LEVEL)
            assert Manager(agent, tmp_path, WATCH).get("rtuMeasuredFloat.7017.1") == [octets]
    finally:
        meter.stop()


@NEEDS_ROOT
def test_tools_need_no_more_than_their_package_says(bare: DebianRoot, packages: Path) -> None:
    install(bare, packages, "openrtu-tools")
    bare.apt("install", "device-tree-compiler", "cpp")
    for name in ("openrtu", "nuc980-pins", "nuc980-netboot"):
        assert bare.run(name, "--version") == f"{name} (OpenRTU) {VERSION}\n"
        assert bare.run(name, "--help").startswith("usage: ")
    shutil.copytree(ROOT / "dts/nuvoton", bare.folder / "srv/dts")
    tree = "/srv/dts/nuc980-gateway.dts"
    assert bare.run("nuc980-pins", "check", tree) == f"{tree}: no findings\n"
    (bare.folder / "srv/half.st").write_text(
        "PROGRAM half\nVAR x : REAL; END_VAR\nx := x / 2.0;\nEND_PROGRAM\n"
    )
    bare.run("openrtu", "logic", "compile", "/srv/half.st")
    assert "apt install python3-aiohttp" in bare.run("openrtu", "centre", "/srv/centre.json", "serve", code=2)
