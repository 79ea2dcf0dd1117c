# SPDX-License-Identifier: GPL-3.0-or-later
"""NTP on the board, by its chronyd: time that comes after the start, with TLS; a step, a leap, a loss."""

import dataclasses
import json
import re
import time
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from lab.board import ETHERNET
from lab.raw_master import RawMaster
from nuc980.twin.linux import Kernel, Linux
from peers.ntp import NtpServer
from peers.tls_gateway import Pki
from rig.cp56 import cp56

ROOT = Path(__file__).resolve().parents[2]
SYSTEM = ROOT / "build/system-site-tls.parts/initramfs.cpio"
SITE = Path(__file__).parent / "site-tls/config.json"
STATION, OWN_STATION, STATION_PORT = 1001, 65000, 19998
C_CS = 103
ACTIVATION, ACT_CON, NEGATIVE, TEST = 6, 7, 0x40, 0x80
T3_S = 1800  # a test frame would be sent, if time tags' time were asked
IV = 0x80  # in the third octet of a CP56Time2a
WAITS_S = 120.0
NEAR_S = 2.0  # a busy host delays what is measured in milliseconds
NEVER_SET = "the system's clock was never set: every certificate is refused until it is"


@pytest.fixture(scope="module")
def server() -> Iterator[NtpServer]:
    """At first it says nothing."""
    with NtpServer(silent=True) as server:
        yield server


@pytest.fixture(scope="module")
def linux(boot: Any, kernel: Kernel, pki: Pki, port: int, server: NtpServer) -> Linux:
    """The system for a site with TLS, with an NTP server besides; its clock begins in 1970."""
    if not SYSTEM.exists():
        pytest.fail(f"{SYSTEM} is not there: `make image-debian SITE=tests/linux/site-tls`", pytrace=False)
    config = json.loads(SITE.read_text()) | {"iec104": {"own_ca": OWN_STATION, "t3": T3_S}}
    files: dict[str, Path | str] = {
        "/etc/openrtu/gateway.json": json.dumps(config),
        "/etc/chrony/site.conf": f"server {ETHERNET[0].host} port {server.port} minpoll 0 maxpoll 0\n",
        "/keys/station.pem": pki.station.certificate,
        "/keys/station.key": pki.station.key,
        "/keys/ca.pem": pki.ours.certificate,
        "/keys/crl.pem": pki.ours.revoke(),
    }
    network = ETHERNET[0].arguments({port: STATION_PORT})
    linux: Linux = boot(*network, kernel=dataclasses.replace(kernel, root=SYSTEM), files=files)
    linux.run("mkdir /data/tls && cp /keys/* /data/tls && chown 61201 /data/tls/station.key")
    linux.run("chmod 400 /data/tls/station.key")
    return linux


def clock(linux: Linux) -> dict[str, Any]:
    (row,) = json.loads(linux.run("rtuctl --json clock"))
    return row


def wait_source(linux: Linux, source: str) -> dict[str, Any]:
    deadline = time.monotonic() + WAITS_S
    while (row := clock(linux))["source"] != source:
        assert time.monotonic() < deadline, f"{row}\n{linux.run('rtuctl log; tail -n 20 /var/log/messages')}"
    return row


def wait_log(linux: Linux, text: str) -> str:
    deadline = time.monotonic() + WAITS_S
    while text not in (log := linux.run("rtuctl log")):
        assert time.monotonic() < deadline, (
            f"no {text!r} in:\n{log}{linux.run('tail -n 20 /var/log/messages')}"
        )
    return log


def assert_tells_the_servers_time(linux: Linux, server: NtpServer) -> None:
    begin = server.now()
    told = datetime.fromisoformat(clock(linux)["time"]).timestamp()
    assert begin - NEAR_S < told < server.now() + NEAR_S


@pytest.fixture(scope="module")
def station_before(linux: Linux) -> str:
    """The process of the station that refused everybody in 1970."""
    wait_log(linux, NEVER_SET)
    return linux.run("pidof rtu-iec104")


@pytest.fixture(scope="module")
def synchronised(linux: Linux, server: NtpServer, station_before: str) -> Linux:
    """The server has been there for a moment, as chronyd says; the gateway is not asked."""
    server.silent = False
    deadline = time.monotonic() + WAITS_S
    while "Leap status     : Normal" not in (output := linux.run("chronyc -n tracking")):
        assert time.monotonic() < deadline, f"{output}\n{linux.run('tail -n 20 /var/log/messages')}"
    return linux


def told_time(master: RawMaster) -> bytes:
    """The station's time, as it confirms a test of a clock synchronisation."""
    master.request(C_CS, OWN_STATION, 0, cp56(datetime.now(UTC)), cause=ACTIVATION | TEST)
    answer = master.answer(C_CS)
    assert answer.cause == ACT_CON | TEST
    return answer.body[3:]


def set_clock(master: RawMaster, when: datetime) -> int:
    master.request(C_CS, OWN_STATION, 0, cp56(when))
    return master.answer(C_CS).cause


def test_before_the_server_answers_nothing_is_believed(linux: Linux, server: NtpServer) -> None:
    """In 1970: tags are invalid, nobody comes in on TLS, and the log says why. Nothing listens for NTP."""
    wait_log(linux, NEVER_SET)
    assert "the clock starts with the system's, 1970-01-01T" in wait_log(linux, "time tags are invalid")
    row = clock(linux)
    assert (row["source"], row["valid"], row["time"][:10]) == ("none", False, "1970-01-01")
    assert not server.silent or server.asked > 0
    chronyd = linux.run("cat /proc/$(pidof chronyd)/status")
    assert re.search(r"^Uid:\t123\t123\t123\t123$", chronyd, re.MULTILINE)
    assert int(re.findall(r"^CapEff:\t(\w+)$", chronyd, re.MULTILINE)[0], 16) == 1 << 25  # CAP_SYS_TIME
    listening = linux.run("netstat -lnu; netstat -lnt")
    assert not re.search(r":(123|323) ", listening)


def test_with_the_server_the_gateway_has_its_time(synchronised: Linux, server: NtpServer) -> None:
    wait_source(synchronised, "system, synchronised")
    assert_tells_the_servers_time(synchronised, server)
    row = clock(synchronised)
    assert row["valid"]
    assert 0 < row["error_s"] < 16
    log = wait_log(synchronised, "the system's clock is synchronised to ")
    assert re.search(r"the clock follows it, moved by \d{10}\.\d{3} s", log)


def test_tls_lets_masters_in_without_a_restart(
    station_before: str, synchronised: Linux, pki: Pki, port: int
) -> None:
    assert synchronised.run("pidof rtu-iec104") == station_before
    deadline = time.monotonic() + WAITS_S
    with RawMaster("127.0.0.1", port, tls=pki.client()) as master:
        while (told := told_time(master))[2] & IV:
            assert time.monotonic() < deadline, "time tags are still invalid"
        assert told[6] == datetime.now(UTC).year % 100


def test_masters_do_not_overrule_it_and_a_step_ends_no_connection(
    synchronised: Linux, server: NtpServer, pki: Pki, port: int
) -> None:
    """In the hour that was left out a test frame would have been due, and t1 over."""
    with RawMaster("127.0.0.1", port, tls=pki.client()) as master:
        assert set_clock(master, datetime.now(UTC) - timedelta(days=1)) == ACT_CON | NEGATIVE
        server.ahead_s = 3600
        wait_log(synchronised, "the clock follows the system's, moved by 3")
        assert_tells_the_servers_time(synchronised, server)
        assert set_clock(master, datetime.now(UTC)) == ACT_CON | NEGATIVE


def test_lost_synchronisation_is_held_and_a_master_may_set_the_clock(
    synchronised: Linux, server: NtpServer, pki: Pki, port: int
) -> None:
    """Somebody stops chronyd and sets the system's clock by hand: no tag is off by half a day."""
    synchronised.run("/etc/init.d/S45chronyd stop")
    before = clock(synchronised)
    assert before["source"] == "system, synchronised"  # the kernel's word, for as long as its bound holds
    synchronised.run(f"date -u -s @{int(server.now()) + 86400 // 2}")
    row = wait_source(synchronised, "system, no longer synchronised")
    assert row["valid"]
    assert 3600 < row["left_s"] < 9 * 3600  # less than 8.9 h by what the kernel knew of its error
    assert_tells_the_servers_time(synchronised, server)
    with RawMaster("127.0.0.1", port, tls=pki.client()) as master:
        assert set_clock(master, datetime.fromtimestamp(server.now(), UTC)) == ACT_CON
    assert clock(synchronised)["source"] == "controlling station"
    synchronised.run("/etc/init.d/S45chronyd start")
    wait_source(synchronised, "system, synchronised")
    assert_tells_the_servers_time(synchronised, server)


def test_leap_second(synchronised: Linux, server: NtpServer) -> None:
    """The kernel inserts it at the end of a half-year's last day."""
    end = datetime(2028, 1, 1, tzinfo=UTC)
    server.tell(end - timedelta(minutes=1), leap=end)
    wait_log(synchronised, "a leap second is inserted at the end of this day, UTC")
    assert clock(synchronised)["leap_second"] == "inserted"
    wait_log(synchronised, "a leap second was inserted")
    assert_tells_the_servers_time(synchronised, server)
