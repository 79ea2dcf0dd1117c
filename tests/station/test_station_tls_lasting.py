# SPDX-License-Identifier: GPL-3.0-or-later
"""TLS connections that last (IEC 62351-3): new keys, new files without a restart, certificates that end."""

import contextlib
import os
import re
import select
import socket
import ssl
import subprocess
import time
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from lab.gateway import TESTFR_ACT, TESTFR_CON, remove, run_directory
from peers.authority import Authority
from peers.tls_gateway import (
    POINTS,
    STATION,
    VERSIONS,
    WAITS_S,
    Pki,
    TlsGateway,
    assert_refused,
    closed_by_station,
    connected,
    gateway_with,
    public_keys,
    received,
)

pytestmark = pytest.mark.slow

RENEWAL_S = 10  # the shortest that may be configured
FILES_S = 5.0  # how often the station looks at its files
SEEN_S = FILES_S + 5.0
REFUSED = (ssl.SSLError, ConnectionResetError, pytest.fail.Exception)


@pytest.fixture
def pki() -> Iterator[Pki]:
    """Of the test's own: it changes the files."""
    folder = run_directory()
    yield public_keys(folder)
    remove(folder)


def is_alive(connection: ssl.SSLSocket) -> bool:
    """Whether the station answers on it; after t3 of silence it has asked itself."""
    connection.sendall(TESTFR_ACT)
    while (answer := received(connection, len(TESTFR_CON))) == TESTFR_ACT:
        connection.sendall(TESTFR_CON)
    return answer == TESTFR_CON


# ---- keys -----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def renewing(programs: Path) -> Iterator[TlsGateway]:
    folder = run_directory()
    with gateway_with(public_keys(folder), programs, renewal_s=RENEWAL_S) as gateway:
        yield gateway
    remove(folder)


def renewals(gateway: TlsGateway) -> int:
    return len(re.findall(r"its keys are renewed$", gateway.log(1000), re.MULTILINE))


def test_keys_are_renewed_in_tls_1_3(renewing: TlsGateway, tmp_path: Path) -> None:
    """Both sides change theirs, twice, as s_client tells; every octet is there before, between and after."""
    messages, pki = tmp_path / "messages", renewing.pki
    command = ["openssl", "s_client", "-connect", f"127.0.0.1:{renewing.address[1]}", "-tls1_3", "-quiet"]
    command += ["-cert", pki.centre.certificate, "-key", pki.centre.key, "-CAfile", pki.ours.certificate]
    command += ["-msg", "-msgfile", messages, "-no_ign_eof"]
    pipe = subprocess.PIPE

    def updates(direction: str) -> int:
        output = messages.read_text() if messages.exists() else ""
        return len(re.findall(rf"^{direction} .*KeyUpdate", output, re.MULTILINE))

    with subprocess.Popen(command, bufsize=0, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL) as peer:
        assert peer.stdin and peer.stdout
        begun = time.monotonic()
        while updates(">>>") < 2:
            assert time.monotonic() - begun < 2 * RENEWAL_S + WAITS_S
            peer.stdin.write(TESTFR_ACT)
            assert peer.stdout.read(len(TESTFR_CON)) == TESTFR_CON
        assert time.monotonic() - begun > 2 * RENEWAL_S - 0.1
        assert updates("<<<") == 2  # the station's, each of which asked for one
        renewing.wait_for(lambda: renewals(renewing) >= 2, WAITS_S, "both are in the log")
        peer.stdin.close()


def test_interrogations_go_on_while_keys_are_renewed(renewing: TlsGateway) -> None:
    """Sequence numbers are checked by the controlling station: no frame is lost or repeated."""
    until = time.monotonic() + 1.2 * RENEWAL_S
    with renewing.master("1.3") as master:
        while time.monotonic() < until:
            assert len(master.interrogate(STATION).objects) == POINTS
    renewing.wait_log("its keys are renewed$")


def test_keys_wait_for_a_peer_that_does_not_read(renewing: TlsGateway) -> None:
    """A record that is half written when its keys are too old is finished with the old ones."""
    context = renewing.pki.client(version="1.3")
    with socket.socket() as plain:
        plain.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 8192)
        plain.connect(renewing.address)
        port = plain.getsockname()[1]
        slow = context.wrap_socket(plain)
        sent, until = 0, time.monotonic() + RENEWAL_S + 3
        slow.settimeout(0.3)
        with contextlib.suppress(TimeoutError):
            while True:  # ends when neither side has room for more
                sent += slow.send(TESTFR_ACT * 2000)
        time.sleep(max(0.0, until - time.monotonic()))
        assert f"port {port}: its keys" not in renewing.log(1000)
        slow.settimeout(WAITS_S)
        assert received(slow, sent) == TESTFR_CON * (sent // 6)
        renewing.wait_log(rf"port {port}: its keys are renewed$")
        assert is_alive(slow)
        slow.close()


def test_connection_of_tls_1_2_is_closed_in_order_and_resumed(renewing: TlsGateway) -> None:
    context = renewing.pki.client(version="1.2")
    begun = time.monotonic()
    with connected(renewing, context) as first:
        port = first.getsockname()[1]
        assert is_alive(first)
        first.settimeout(RENEWAL_S + WAITS_S)
        assert first.recv(1) == b""  # close_notify: without it, ssl.SSLEOFError
        assert RENEWAL_S - 0.1 < time.monotonic() - begun < RENEWAL_S + 3
        counters = {row["counter"]: row["value"] for row in renewing.query("iec104", "counters")}
        assert counters["closed_not_secure"] >= 1
        renewing.wait_log(rf"port {port}: its keys are as old as renewal_s$")
        renewing.wait_log(rf"port {port}: connection ends: its keys or its certificate are no longer good$")
        with connected(renewing, context, first.session) as second:
            assert second.session_reused
            assert is_alive(second)


# ---- files ----------------------------------------------------------------------------------------------


def place(content: bytes, file: Path) -> None:
    """As one who keeps a file whole does: written beside it, then moved over it."""
    beside = file.with_suffix(".new")
    beside.write_bytes(content)
    beside.chmod(file.stat().st_mode)
    if os.geteuid() == 0:
        os.chown(beside, file.stat().st_uid, file.stat().st_gid)
    beside.rename(file)


@pytest.mark.parametrize("version", VERSIONS)
def test_revoked_while_connected(pki: Pki, programs: Path, version: str) -> None:
    lost = pki.ours.issue("lost centre")
    revoked = pki.ours.revoke()
    with gateway_with(pki, programs, crl=str(revoked)) as gateway, contextlib.ExitStack() as stack:
        context = pki.client(lost, version)
        leaving = stack.enter_context(connected(gateway, context))
        staying = stack.enter_context(connected(gateway, pki.client(version=version)))
        assert is_alive(leaving) and is_alive(staying)
        session, port = leaving.session, leaving.getsockname()[1]

        place(b"what is this?\n", revoked)
        gateway.wait_for(lambda: "not in force: the crl" in gateway.log(), SEEN_S, "the broken list is seen")
        assert is_alive(leaving) and is_alive(staying)
        with connected(gateway, context) as another:
            assert is_alive(another)

        pki.ours.revoke(lost)
        leaving.settimeout(SEEN_S)
        assert closed_by_station(leaving)
        gateway.wait_log(rf'port {port}: no longer admitted: certificate revoked: "lost centre"$')
        gateway.wait_log(rf"port {port}: connection ends: its keys or its certificate are no longer good$")
        gateway.wait_log("TLS, its files have changed and are in force$")
        assert_refused(gateway, context, 'certificate revoked: "lost centre"')
        with pytest.raises(REFUSED), connected(gateway, context, session) as again:  # nor resumed
            is_alive(again)
        assert is_alive(staying)


def test_outdated_list_lets_nobody_in_and_ends_nobody(pki: Pki, programs: Path) -> None:
    crl, context = str(pki.ours.revoke(seconds=4)), pki.client(version="1.3")
    with (
        gateway_with(pki, programs, crl=crl, renewal_s=RENEWAL_S) as gateway,
        contextlib.ExitStack() as stack,
    ):
        staying = stack.enter_context(connected(gateway, context))
        gateway.wait_for(lambda: "a list in crl expired on" in gateway.log(), SEEN_S, "it is outdated")
        assert_refused(gateway, context, 'CRL has expired: "centre 1"')
        gateway.wait_for(lambda: "its keys are renewed" in gateway.log(), SEEN_S, "its certificate too")
        assert is_alive(staying)
        pki.ours.revoke()
        gateway.wait_for(lambda: "have changed and are in force" in gateway.log(), SEEN_S, "the new list")
        new = stack.enter_context(connected(gateway, context))
        assert is_alive(new) and is_alive(staying)


def test_own_certificate_is_exchanged(pki: Pki, programs: Path) -> None:
    """The key a look later than the certificate: what does not fit together is not in force."""
    new = pki.ours.issue_for_station("substation 7 anew", days=300)
    with gateway_with(pki, programs) as gateway, connected(gateway, pki.client()) as staying:
        place(new.certificate.read_bytes(), pki.station.certificate)
        gateway.wait_for(lambda: "does not belong to the certificate" in gateway.log(), SEEN_S, "half a pair")
        with connected(gateway, pki.client()) as former:
            assert "substation 7'" in str(former.getpeercert())
        place(new.key.read_bytes(), pki.station.key)
        gateway.wait_for(lambda: "have changed and are in force" in gateway.log(), SEEN_S, "the pair")
        gateway.wait_log('own certificate until .*: "substation 7 anew"$')
        with connected(gateway, pki.client()) as later:
            assert "substation 7 anew'" in str(later.getpeercert())
        assert is_alive(staying)


def test_chain_of_a_resumed_connection_is_still_known(pki: Pki, programs: Path) -> None:
    """A resumption shows no certificates; the second look is at those of the session's beginning."""
    region = Authority(pki.ours.folder / "region", "Region CA", above=pki.ours)
    centre = region.issue("centre of the region")
    with centre.certificate.open("a") as chain:
        chain.write(region.certificate.read_text())
    with gateway_with(pki, programs) as gateway, contextlib.ExitStack() as stack:
        resumed = []
        for version in VERSIONS:
            context = pki.client(centre, version)
            with connected(gateway, context) as first:
                assert is_alive(first)
                session = first.session
            resumed.append(stack.enter_context(connected(gateway, context, session)))
            assert resumed[-1].session_reused
        os.utime(pki.ours.certificate)
        gateway.wait_for(lambda: "have changed and are in force" in gateway.log(), SEEN_S, "a second look")
        assert all(is_alive(connection) for connection in resumed)


# ---- dates ----------------------------------------------------------------------------------------------


def test_certificate_that_expires_while_connected(pki: Pki, programs: Path) -> None:
    until = datetime.now(UTC).replace(microsecond=0) + timedelta(seconds=6)
    short = pki.ours.issue("short centre", until=until)
    with gateway_with(pki, programs) as gateway, contextlib.ExitStack() as stack:
        leaving = stack.enter_context(connected(gateway, pki.client(short)))
        staying = stack.enter_context(connected(gateway, pki.client()))
        assert is_alive(leaving)
        assert closed_by_station(leaving)
        assert until < datetime.now(UTC) < until + timedelta(seconds=3)
        gateway.wait_log('no longer admitted: certificate has expired: "short centre"$')
        assert is_alive(staying)


def test_own_certificate_that_ends_soon_is_said(pki: Pki, programs: Path) -> None:
    station = pki.ours.issue_for_station("substation 14", days=29)
    files = {"certificate": str(station.certificate), "key": str(station.key)}
    with gateway_with(pki, programs, **files) as gateway:
        gateway.wait_log(r'own certificate expires on \d{4}-\d\d-\d\d, in (28|29) days: "substation 14"$')
        with connected(gateway, pki.client()) as connection:
            assert is_alive(connection)


def test_certificate_of_tomorrow_tells_whose_clock_is_wrong(pki: Pki, programs: Path) -> None:
    tomorrow = datetime.now(UTC) + timedelta(days=1)
    early = pki.ours.issue("early centre", since=tomorrow, until=tomorrow + timedelta(days=1))
    with gateway_with(pki, programs) as gateway:
        today = f"{datetime.now(UTC):%Y-%m-%d}"
        why = f'certificate is not yet valid, by our clock it is {today}: "early centre"'
        assert_refused(gateway, pki.client(early), why)


# ---- cost -----------------------------------------------------------------------------------------------


def test_looking_at_files_takes_no_time(pki: Pki, programs: Path) -> None:
    crl = str(pki.ours.revoke())
    with gateway_with(pki, programs, crl=crl) as gateway, connected(gateway, pki.client()) as connection:
        assert is_alive(connection)
        before = gateway.processor_seconds()
        assert (
            select.select([connection], [], [], FILES_S + 1)[0] == []
        )  # a time that is measured, of silence
        assert gateway.processor_seconds() - before < 0.05
