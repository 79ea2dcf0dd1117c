# SPDX-License-Identifier: GPL-3.0-or-later
"""The image of `make image-debian` with TLS (site-tls) and SNMPv3: who may connect, and the costs."""

import json
import re
import socket
import ssl
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from image.manifest import read_limits
from lab.board import ETHERNET
from lab.gateway import TESTFR_ACT, TESTFR_CON
from lab.manager import CENTRE, USERS, Manager, Receiver, free_udp_port, make_keys, receiver
from lab.raw_master import RawMaster
from nuc980.twin.linux import Kernel, Linux
from nuc980.twin.machine import INSTRUCTION_TIME
from peers.tls_gateway import VERSIONS, Pki, received

ROOT = Path(__file__).resolve().parents[2]
LIMITS = ROOT / "board/nuc980/boards/gateway/image-limits.toml"
IMAGE = ROOT / "build/system-site-tls"
SITE = Path(__file__).parent / "site-tls/config.json"
STATION, POINTS, STATION_PORT = 1001, 5000, 19998
WAITS_S = 60.0
AVAILABLE_KIB = 32 * 1024
HANDSHAKES = 10
SNMP_PORT = 161
SNMP_PSS_KIB = 6 * 1024


@dataclass(frozen=True)
class Management:
    """A manager of SNMPv3 and a receiver of notifications, on this machine."""

    manager: Manager
    received: Receiver
    keys: Path


@pytest.fixture(scope="module")
def management(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Management]:
    folder = tmp_path_factory.mktemp("management")
    sink_port = free_udp_port()
    make_keys({"snmp": snmp(sink_port)}, folder)
    with receiver(sink_port, folder / "receiver") as received:
        yield Management(Manager(free_udp_port(), folder, timeout_s=60), received, folder / "keys")


def snmp(sink_port: int) -> dict[str, Any]:
    users = [{"name": user.name, "role": role} for user, role in USERS.items()]
    sink = {"name": "nms", "address": ETHERNET[0].host, "port": sink_port, "user": CENTRE.name}
    return {"users": users, "sinks": [sink], "keys": "/data/tls/snmp.keys", "state": "/data/snmp"}


def configuration(sink_port: int) -> str:
    """The site's, with points whose device does not answer."""
    device = {"id": 1, "input_registers": [{"address": address} for address in range(POINTS)]}
    line = {"value": 1, "active": 1, "baud_rate": 115200, "data_bits": 8, "stop_bits": 1, "parity": 0}
    # In memory here: no flash wears out.
    journal = {"path": "/data/journal", "interval_s": 1, "volume_mb": 1048576}
    port = [line | {"slaves": [device]}]
    more = {"port": port, "journal": journal, "snmp": snmp(sink_port)}
    return json.dumps(json.loads(SITE.read_text()) | more)


@pytest.fixture(scope="module")
def linux(boot: Any, pki: Pki, port: int, management: Management) -> Linux:
    """The uImage as it is; over it the points, and the files that an engineer puts into /data."""
    if not (IMAGE / "uImage").exists():
        pytest.fail(f"{IMAGE}/uImage is missing: make image-debian SITE=tests/linux/site-tls", pytrace=False)
    files: dict[str, Path | str] = {
        "/etc/openrtu/gateway.json": configuration(management.received.port),
        "/keys/snmp.keys": management.keys,
        "/keys/station.pem": pki.station.certificate,
        "/keys/station.key": pki.station.key,
        "/keys/ca.pem": pki.ours.certificate,
        "/keys/crl.pem": pki.ours.revoke(),
    }
    network = ETHERNET[0].arguments({port: STATION_PORT}, {management.manager.port: SNMP_PORT})
    kernel = Kernel(IMAGE / "uImage", IMAGE / "nuc980-gateway.dtb")
    linux: Linux = boot(*network, *INSTRUCTION_TIME, kernel=kernel, files=files)
    linux.run("mkdir /data/tls && cp /keys/* /data/tls && chown 61201 /data/tls/station.key")
    linux.run("chown 61216 /data/tls/snmp.keys; chmod 400 /data/tls/station.key /data/tls/snmp.keys")
    for listens in (f"-lnt | grep -q ':{STATION_PORT} '", f"-lnu | grep -q ':{SNMP_PORT} '"):
        wait = f"until netstat {listens}; do sleep 0.1; done"
        linux.run(f'timeout {WAITS_S} sh -c "{wait}"', 2 * WAITS_S)
    return linux


@pytest.fixture(scope="module")
def on_time(linux: Linux, pki: Pki) -> Linux:
    """The board, its clock set since the certificates were made."""
    linux.run(f"date -u -s @{int(time.time()) + 1}")
    return linux


def log(linux: Linux) -> str:
    return linux.run("rtuctl log")


def greeted(port: int, context: ssl.SSLContext) -> bool:
    """Whether the station lets somebody in and answers."""
    with socket.create_connection(("127.0.0.1", port), timeout=WAITS_S) as plain:
        try:
            with context.wrap_socket(plain) as connection:
                connection.sendall(TESTFR_ACT)
                return received(connection, len(TESTFR_CON)) == TESTFR_CON
        except (ssl.SSLError, ConnectionResetError, BrokenPipeError, pytest.fail.Exception):
            return False


def processor_seconds(linux: Linux, module: str = "rtu-iec104") -> float:
    """A module's, of the board's time, in which each instruction takes the same (INSTRUCTION_TIME)."""
    stat = linux.run(f"cat /proc/$(pidof {module})/stat").rpartition(")")[2].split()
    return (int(stat[11]) + int(stat[12])) / 100


def test_clock_that_was_never_set_is_said(linux: Linux, pki: Pki, port: int) -> None:
    """Nobody comes in, and the log tells why; once it is set, all do, without a restart."""
    assert not greeted(port, pki.client())
    output = log(linux)
    assert "the system's clock was never set: every certificate is refused until it is" in output
    assert 'refused, CRL is not yet valid, by our clock it is 1970-01-01: "centre 1"' in output


@pytest.mark.parametrize("version", VERSIONS)
def test_interrogation(on_time: Linux, pki: Pki, port: int, version: str) -> None:
    with RawMaster("127.0.0.1", port, tls=pki.client(version=version)) as master:
        assert len(master.interrogate(STATION).objects) == POINTS
    assert f'TLSv{version}, "centre 1"' in log(on_time)


def test_a_manager_interrogates_by_snmp(on_time: Linux, management: Management) -> None:
    """From outside, over the emulated Ethernet; and the station tells its start."""
    before = processor_seconds(on_time, "rtu-snmp")
    image = management.manager.walk("rtuImageData")
    seconds = processor_seconds(on_time, "rtu-snmp") - before
    assert sum(len(data) for data in image.values()) == 12 * POINTS
    assert management.manager.get("rtuStationPoints.0") == [POINTS]
    assert management.received.wait_for("rtuStarted")
    pss = int(re.findall(r"(\d+) kB", on_time.run("grep ^Pss: /proc/$(pidof rtu-snmp)/smaps_rollup"))[0])
    print(
        f"rtu-snmp with {POINTS} points: {pss} KiB; interrogated by image: {seconds:.2f} s of CPU on the twin"
    )
    assert pss <= SNMP_PSS_KIB


def test_modules_have_their_filters_and_make_no_other_call(on_time: Linux, pki: Pki, port: int) -> None:
    """What TLS and the journal ask of this kernel and glibc; the plain gateway has a test of its own."""
    assert greeted(port, pki.client())
    on_time.run("cp /data/tls/crl.pem /data/tls/again.pem && mv /data/tls/again.pem /data/tls/crl.pem")
    wait = "until rtuctl log | grep -q 'TLS, its files have changed and are in force'; do sleep 0.2; done"
    on_time.run(f'timeout {WAITS_S} sh -c "{wait}"', 2 * WAITS_S)
    for program in ("rtu-iec104", "rtu-modbus", "rtu-journal", "rtu-snmp"):
        status = on_time.run(f"cat /proc/$(pidof {program})/status")
        assert re.search(r"^Seccomp:\s+2$", status, re.MULTILINE), program
        assert re.search(r"^CapBnd:\s+0+$", status, re.MULTILINE), program
    modules = json.loads(on_time.run("rtuctl --json modules"))
    (journal,) = (module for module in modules if "journal" in module)
    assert journal["journal"]["records"] > 0
    assert "a system call that is not its own" not in log(on_time)


def test_time_of_a_handshake(on_time: Linux, pki: Pki, port: int) -> None:
    for version in VERSIONS:
        before = processor_seconds(on_time)
        for _ in range(HANDSHAKES):
            assert greeted(port, pki.client(version=version))
        seconds = (processor_seconds(on_time) - before) / HANDSHAKES
        print(f"TLS {version}: {seconds:.3f} s of CPU on the twin for a handshake, an answer and the end")
        assert 0 < seconds < 2


def test_random_numbers_are_there_in_time(linux: Linux) -> None:
    ready = re.search(r"\[ *(\d+\.\d+)\] random: crng init done", linux.run("dmesg"))
    assert ready
    print(f"random numbers {ready[1]} s after the kernel's start")
    assert float(ready[1]) < 10


def test_memory_and_size(on_time: Linux, pki: Pki, port: int) -> None:
    with RawMaster("127.0.0.1", port, tls=pki.client()) as master:
        assert len(master.interrogate(STATION).objects) == POINTS
        pss = on_time.run(
            "for each in $(pidof rtud rtu-iec104 rtu-modbus); do grep ^Pss: /proc/$each/smaps_rollup; done"
        )
        module = on_time.run("grep -E '^(Pss|Private_Dirty):' /proc/$(pidof rtu-iec104)/smaps_rollup")
        available = int(re.findall(r"MemAvailable: +(\d+)", on_time.run("cat /proc/meminfo"))[0])
    gateway = sum(map(int, re.findall(r"(\d+) kB", pss)))
    size, limit = (IMAGE / "uImage").stat().st_size, read_limits(LIMITS).memory_room
    print(
        f"gateway {gateway} KiB, available {available} KiB; uImage {size} of {limit}; rtu-iec104-tls:", module
    )
    assert available >= AVAILABLE_KIB
    assert size <= limit


def test_plain_image_has_no_openssl() -> None:
    def names(parts: Path) -> set[str]:
        return {file.name for file in (parts / "root").rglob("*")}

    only_with_tls = {
        "rtu-iec104-tls",
        "rtu-104m-tls",
        "rtu-snmp",
        "libssl.so.3",
        "libcrypto.so.3",
        "libatomic.so.1",
    }
    assert only_with_tls <= names(IMAGE.with_name(f"{IMAGE.name}.parts"))
    assert not only_with_tls & names(ROOT / "build/system.parts")
    assert "net-snmp " in (ROOT / "build/system-site-tls.parts/versions").read_text()
    assert "libssl3 " in (ROOT / "build/system-site-tls.parts/versions").read_text()
    assert "libssl3 " not in (ROOT / "build/system.parts/versions").read_text()
