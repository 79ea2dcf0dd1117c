# SPDX-License-Identifier: GPL-3.0-or-later
"""The controlled station on TLS (IEC 62351-3): who comes in, who does not and why, what hostile peers do."""

import contextlib
import os
import re
import signal
import socket
import ssl
import subprocess
import time
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from lab.gateway import TESTFR_ACT, TESTFR_CON, remove, run_directory
from lab.raw_master import RawMaster
from peers.authority import DocumentedAuthority, openssl
from peers.tls_gateway import (
    POINTS,
    STATION,
    VERSIONS,
    WAITS_S,
    ApduAWake,
    Pki,
    TlsGateway,
    assert_refused,
    closed_by_station,
    connected,
    gateway_with,
    interrogate_with_lib60870,
    public_keys,
    received,
    tunnel,
)
from rig.desk import wait_still

STARTDT_ACT, STARTDT_CON = bytes.fromhex("680407000000"), bytes.fromhex("68040b000000")
HANDSHAKE_S = 10.0  # what the station grants


@pytest.fixture(scope="module")
def pki() -> Iterator[Pki]:
    folder = run_directory()  # the station's user may enter it
    yield public_keys(folder)
    remove(folder)


@pytest.fixture
def gateway(pki: Pki, programs: Path) -> Iterator[TlsGateway]:
    """Of the test's own: what others have done leaves lines of its log out."""
    with gateway_with(pki, programs) as gateway:
        yield gateway


def speak_plainly(gateway: TlsGateway, octets: bytes) -> int:
    """Sends octets that are not TLS; returns the own TCP port."""
    with socket.create_connection(gateway.address, timeout=WAITS_S) as connection:
        connection.sendall(octets)
        assert closed_by_station(connection)
        return int(connection.getsockname()[1])


# ---- who comes in ---------------------------------------------------------------------------------------


@pytest.mark.sample(2)
@pytest.mark.parametrize("version", VERSIONS)
def test_interrogation_of_5000_points(gateway: TlsGateway, version: str) -> None:
    with gateway.master(version) as master:
        objects = master.interrogate(STATION).objects
    assert [found.ioa for found in objects] == list(range(30001, 30001 + POINTS))
    gateway.wait_log(rf'TLSv{version}, "centre 1"$')


@pytest.mark.sample(2)
@pytest.mark.parametrize("version", VERSIONS)
def test_each_apdu_has_a_record(gateway: TlsGateway, version: str) -> None:
    """Also those that wait together: of two in a record, such a master would see one."""
    with gateway.master(version, ApduAWake) as master:
        assert len(master.interrogate(STATION).objects) == POINTS


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "bits"), [("ec", 256), ("rsa", 2048)])
def test_documented_certificates(programs: Path, kind: str, bits: int) -> None:
    """By the page's own commands. RSA is for masters that refuse short keys, as lib60870 in C does."""
    folder = run_directory()
    try:
        made = DocumentedAuthority(folder / "documented", kind)
        assert f"Public-Key: ({bits} bit)" in openssl(
            "x509", "-in", made.station.certificate, "-noout", "-text"
        )
        pki = Pki(made, made.station, made.centre, made.centre)
        with gateway_with(pki, programs) as gateway, gateway.master() as master:
            assert len(master.interrogate(STATION).objects) == POINTS
        lists = ["-crl_check", "-CAfile", made.certificate, "-CRLfile", made.folder / "crl.pem"]
        openssl("verify", *lists, made.station.certificate)
        with pytest.raises(AssertionError, match="certificate revoked"):
            openssl("verify", *lists, made.centre.certificate)
    finally:
        remove(folder)


@pytest.mark.slow
@pytest.mark.parametrize("version", VERSIONS)
def test_lib60870_through_tls(gateway: TlsGateway, pki: Pki, version: str) -> None:
    """In a tunnel: the TLS of c104 2.2.1 itself ends each handshake for want of a host name (-0x5d80)."""
    with tunnel(gateway.address, pki.client(version=version)) as port:
        interrogate_with_lib60870(port)


@pytest.mark.slow
@pytest.mark.sample(3)
@pytest.mark.parametrize(
    "suite",
    [
        "ECDHE-ECDSA-AES128-GCM-SHA256",
        "ECDHE-ECDSA-AES256-GCM-SHA384",
        "ECDHE-RSA-AES128-GCM-SHA256",
        "ECDHE-RSA-AES256-GCM-SHA384",
        "DHE-RSA-AES128-GCM-SHA256",
        "DHE-RSA-AES256-GCM-SHA384",
    ],
)
def test_suites_of_tls_1_2(pki: Pki, gateway: TlsGateway, rsa_gateway: TlsGateway, suite: str) -> None:
    context = pki.client(version="1.2")
    context.set_ciphers(suite)
    with connected(
        rsa_gateway if "RSA-AES" in suite.replace("ECDSA", "") else gateway, context
    ) as connection:
        connection.sendall(TESTFR_ACT)
        assert received(connection, 6) == TESTFR_CON
        assert (connection.cipher() or ("",))[0] == suite


@pytest.fixture(scope="module")
def rsa_gateway(pki: Pki, programs: Path) -> Iterator[TlsGateway]:
    station = pki.ours.issue_for_station("substation 8", key="-newkey rsa:2048")
    files = {"certificate": str(station.certificate), "key": str(station.key)}
    with gateway_with(pki, programs, **files) as gateway:
        yield gateway


# ---- who does not, and why ------------------------------------------------------------------------------


def test_no_certificate(gateway: TlsGateway, pki: Pki) -> None:
    for version in VERSIONS.values():
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        context.check_hostname = False
        context.load_verify_locations(pki.ours.certificate)
        context.minimum_version = context.maximum_version = version
        assert_refused(gateway, context, "shows no certificate")


@pytest.mark.sample(2)
@pytest.mark.parametrize("version", VERSIONS)
def test_unknown_ca(gateway: TlsGateway, pki: Pki, version: str) -> None:
    context = pki.client(pki.stranger, version)
    assert_refused(gateway, context, 'certificate is not from a known CA: "stranger"')


def test_expired(gateway: TlsGateway, pki: Pki) -> None:
    context = pki.client(pki.ours.issue("old centre", days=-1))
    assert_refused(gateway, context, 'certificate has expired: "old centre"')


@pytest.mark.slow
def test_weak_key(gateway: TlsGateway, pki: Pki) -> None:
    context = pki.client(pki.ours.issue("weak centre", key="-newkey rsa:1024"), weak=True)
    assert_refused(gateway, context, 'EE certificate key too weak: "weak centre"')


def test_certificate_of_a_server(gateway: TlsGateway, pki: Pki) -> None:
    context = pki.client(pki.ours.issue("substation 9", usage="serverAuth"))
    assert_refused(gateway, context, 'unsuitable certificate purpose: "substation 9"')


@pytest.mark.filterwarnings("ignore:ssl.TLSVersion:DeprecationWarning")
def test_old_version(gateway: TlsGateway, pki: Pki) -> None:
    context = pki.client(weak=True)
    context.minimum_version, context.maximum_version = ssl.TLSVersion.TLSv1, ssl.TLSVersion.TLSv1_1
    assert_refused(gateway, context, "version of TLS is not allowed")


def test_suite_without_forward_secrecy(gateway: TlsGateway, pki: Pki) -> None:
    context = pki.client(version="1.2")
    context.set_ciphers("AES128-GCM-SHA256")
    assert_refused(gateway, context, "no cipher suite is allowed")


@pytest.mark.sample(2)
@pytest.mark.parametrize("version", VERSIONS)
def test_version_that_is_not_configured(pki: Pki, programs: Path, version: str) -> None:
    other = next(key for key in VERSIONS if key != version)
    with gateway_with(pki, programs, versions=[version]) as gateway:
        assert_refused(gateway, pki.client(version=other), "version of TLS is not allowed")
        with gateway.master(version) as master:
            assert len(master.interrogate(STATION).objects) == POINTS


@pytest.mark.slow
def test_only_listed_masters(pki: Pki, programs: Path) -> None:
    second, third = pki.ours.issue("centre 2"), pki.ours.issue("centre 3")
    with gateway_with(pki, programs, masters=["centre 1", second.fingerprint]) as gateway:
        for identity in (pki.centre, second):
            with RawMaster(*gateway.address, tls=pki.client(identity)):
                pass
        for version in VERSIONS:
            context = pki.client(third, version)
            assert_refused(gateway, context, 'not in the list of masters: "centre 3"')


@pytest.mark.slow
def test_revoked(pki: Pki, programs: Path) -> None:
    lost = pki.ours.issue("lost centre")
    with gateway_with(pki, programs, crl=str(pki.ours.revoke(lost))) as gateway:
        assert_refused(gateway, pki.client(lost), 'certificate revoked: "lost centre"')


@pytest.mark.parametrize("octets", [STARTDT_ACT, b"GET / HTTP/1.0\r\n\r\n"])
def test_plain_text(gateway: TlsGateway, octets: bytes) -> None:
    gateway.wait_log(rf" port {speak_plainly(gateway, octets)}: refused, does not speak TLS$")


def s_client(gateway: TlsGateway, *options: str) -> subprocess.Popen[bytes]:
    """What Python's ssl cannot do; it takes commands, a letter a line."""
    pki = gateway.pki
    command = ["openssl", "s_client", "-connect", f"127.0.0.1:{gateway.address[1]}", *options]
    command += ["-cert", pki.centre.certificate, "-key", pki.centre.key, "-CAfile", pki.ours.certificate]
    pipe = subprocess.PIPE
    return subprocess.Popen(command, bufsize=0, stdin=pipe, stdout=pipe, stderr=pipe)


def test_renegotiation_is_refused(gateway: TlsGateway, pki: Pki) -> None:
    with s_client(gateway, "-tls1_2") as peer:
        assert peer.stdin and peer.stderr
        peer.stdin.write(b"R\n")
        gateway.wait_log("renegotiation is refused$")
        peer.stdin.close()
        assert b"no renegotiation" in peer.stderr.read()


def test_keys_are_changed_on_request(gateway: TlsGateway) -> None:
    """TLS 1.3: the peer changes its own and asks for the station's, which answers under the new ones."""
    with s_client(gateway, "-tls1_3", "-quiet", "-no_ign_eof") as peer:
        assert peer.stdin and peer.stdout and peer.stderr
        for _ in range(5):
            peer.stdin.write(b"K\n")
            while b"KEYUPDATE" not in (output := peer.stderr.read(4096)):
                assert output, "closed"
            peer.stdin.write(TESTFR_ACT)
            assert peer.stdout.read(len(TESTFR_CON)) == TESTFR_CON
        peer.stdin.close()


@pytest.mark.slow
def test_refusals_cannot_flood_the_log(pki: Pki, programs: Path) -> None:
    peers = 1000
    with gateway_with(pki, programs) as gateway:
        before = gateway.log_file.stat().st_size
        for _ in range(peers):
            speak_plainly(gateway, STARTDT_ACT)
        size = gateway.log_file.stat().st_size
        gateway.wait_for(
            lambda: speak_plainly(gateway, STARTDT_ACT) and "are left out" in gateway.log(),
            WAITS_S,
            "what was left out",
        )
        assert (size - before) / peers < 40  # a line has more than 80 octets


# ---- sessions -------------------------------------------------------------------------------------------


def session_of(gateway: TlsGateway, context: ssl.SSLContext, former: ssl.SSLSession | None = None) -> Any:
    """What a connection leaves, and whether it was a resumption."""
    with connected(gateway, context, former) as connection:
        connection.sendall(TESTFR_ACT)
        assert received(connection, 6) == TESTFR_CON
        return connection.session, connection.session_reused


@pytest.mark.parametrize("version", VERSIONS)
def test_session_is_resumed(gateway: TlsGateway, pki: Pki, version: str) -> None:
    context = pki.client(version=version)
    session, reused = session_of(gateway, context)
    assert not reused
    for _ in range(2):
        session, reused = session_of(gateway, context, session)
        assert reused
    gateway.wait_log(rf'TLSv{version} resumed, "centre 1"$')


@pytest.mark.slow
@pytest.mark.parametrize("version", VERSIONS)
def test_session_is_not_resumed_when_it_is_too_old(pki: Pki, programs: Path, version: str) -> None:
    context = pki.client(version=version)
    with gateway_with(pki, programs, resumption_s=1) as gateway:
        session, _ = session_of(gateway, context)
        time.sleep(2.1)  # a session's age has a resolution of 1 s
        assert not session_of(gateway, context, session)[1]
    with gateway_with(pki, programs, resumption_s=0) as gateway:
        session, _ = session_of(gateway, context)
        assert not session_of(gateway, context, session)[1]


@pytest.mark.slow
@pytest.mark.parametrize("version", VERSIONS)
def test_session_ends_with_its_certificate(gateway: TlsGateway, pki: Pki, version: str) -> None:
    until = datetime.now(UTC).replace(microsecond=0) + timedelta(seconds=3)
    context = pki.client(pki.ours.issue(f"short centre {version}", until=until), version)
    session, _ = session_of(gateway, context)
    time.sleep((until - datetime.now(UTC)).total_seconds() + 1)
    with pytest.raises((ssl.SSLError, ConnectionResetError, pytest.fail.Exception)):
        session_of(gateway, context, session)
    gateway.wait_log(rf'refused, certificate has expired: "short centre {version}"$')


def test_killed_station_comes_back_without_its_sessions(gateway: TlsGateway, pki: Pki) -> None:
    context = pki.client()
    session, _ = session_of(gateway, context)
    gateway.restart_station(signal.SIGKILL)
    assert not session_of(gateway, context, session)[1]
    with gateway.master() as master:
        assert len(master.interrogate(STATION).objects) == POINTS


# ---- peers that do no good ------------------------------------------------------------------------------


def client_hello(context: ssl.SSLContext) -> bytes:
    incoming, outgoing = ssl.MemoryBIO(), ssl.MemoryBIO()
    with contextlib.suppress(ssl.SSLWantReadError):
        context.wrap_bio(incoming, outgoing).do_handshake()
    return outgoing.read()


@pytest.mark.slow
def test_peers_that_hang_in_the_handshake(gateway: TlsGateway, pki: Pki) -> None:
    """They take no connection from anybody, nor time; and they are gone after a while."""
    hello = client_hello(pki.client())
    with gateway.master() as master, contextlib.ExitStack() as stack:
        begun = time.monotonic()
        silent, halfway, cut = [
            stack.enter_context(socket.create_connection(gateway.address, WAITS_S)) for _ in range(3)
        ]
        halfway.sendall(hello)
        cut.sendall(hello[:100])
        assert len(master.interrogate(STATION).objects) == POINTS
        with gateway.master():
            pass
        assert time.monotonic() - begun < HANDSHAKE_S / 2
        for peer in (silent, halfway, cut):
            peer.settimeout(2 * HANDSHAKE_S)
            assert closed_by_station(peer)
            gateway.wait_log(rf" port {peer.getsockname()[1]}: refused, its handshake takes too long$")
        assert HANDSHAKE_S - 0.5 < time.monotonic() - begun < HANDSHAKE_S + 2
        assert len(master.interrogate(STATION).objects) == POINTS


@pytest.mark.slow
def test_many_that_hang_keep_nobody_out(pki: Pki, programs: Path) -> None:
    with gateway_with(pki, programs) as gateway, contextlib.ExitStack() as stack:
        begun = time.monotonic()
        peers = [stack.enter_context(socket.create_connection(gateway.address, WAITS_S)) for _ in range(40)]
        with gateway.master() as master:
            assert len(master.interrogate(STATION).objects) == POINTS
        assert time.monotonic() - begun < HANDSHAKE_S / 2
        assert closed_by_station(peers[0])
        wait_still(gateway.processor_seconds, 0.1)
        with pytest.raises(TimeoutError):
            peers[-1].settimeout(0.1)
            peers[-1].recv(1)


def test_flood_of_one_address_keeps_no_other_from_its_handshake(pki: Pki, programs: Path) -> None:
    with gateway_with(pki, programs) as gateway, contextlib.ExitStack() as stack:

        def come(source: str) -> socket.socket:
            return stack.enter_context(socket.create_connection(gateway.address, WAITS_S, (source, 0)))

        slow = come("127.0.0.2")
        flood = [come("127.0.0.3") for _ in range(40)]
        assert closed_by_station(flood[0])
        connection = stack.enter_context(pki.client().wrap_socket(slow))
        connection.sendall(TESTFR_ACT)
        assert received(connection, 6) == TESTFR_CON


@pytest.mark.slow
@pytest.mark.parametrize("version", VERSIONS)
def test_slow_reader(gateway: TlsGateway, pki: Pki, version: str) -> None:
    """Nothing is lost of what waits for it, nobody else waits, and waiting costs no time."""
    with socket.socket() as plain, gateway.master() as other:
        plain.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 8192)
        plain.connect(gateway.address)
        slow = pki.client(version=version).wrap_socket(plain)
        sent = 0
        slow.settimeout(0.3)
        with contextlib.suppress(TimeoutError):
            while True:  # ends when neither side has room for more
                sent += slow.send(TESTFR_ACT * 2000)
        assert len(other.interrogate(STATION).objects) == POINTS
        wait_still(gateway.processor_seconds, 0.1)
        slow.settimeout(WAITS_S)
        assert received(slow, sent) == TESTFR_CON * (sent // 6)
        slow.sendall(STARTDT_ACT)
        assert received(slow, 6) == STARTDT_CON
        slow.close()


@pytest.mark.sample(2)
@pytest.mark.parametrize("version", VERSIONS)
def test_records_of_every_size(gateway: TlsGateway, pki: Pki, version: str) -> None:
    """Many APDUs in a record, more than the station takes at once; and an APDU in many records."""
    with connected(gateway, pki.client(version=version)) as connection:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.settimeout(2.0)
        for count in (1, 340, 341, 342, 683, 2730):  # the last fills a record of 16 KiB
            connection.sendall(TESTFR_ACT * count)
            assert received(connection, 6 * count) == TESTFR_CON * count
        for octet in TESTFR_ACT + STARTDT_ACT:
            connection.sendall(bytes([octet]))
        assert received(connection, 12) == TESTFR_CON + STARTDT_CON


def test_broken_record_ends_the_connection(gateway: TlsGateway, pki: Pki) -> None:
    with socket.create_connection(gateway.address, timeout=WAITS_S) as plain:
        connection = pki.client(version="1.2").wrap_socket(os_duplicate(plain))
        connection.sendall(TESTFR_ACT)
        assert received(connection, 6) == TESTFR_CON
        plain.sendall(bytes.fromhex("170303 0020") + bytes(32))
        gateway.wait_log(rf" port {plain.getsockname()[1]}: TLS fails: ")
        with contextlib.suppress(ssl.SSLError):
            assert closed_by_station(connection)
        connection.close()


def os_duplicate(connection: socket.socket) -> socket.socket:
    return socket.socket(fileno=os.dup(connection.fileno()))


# ---- the program without TLS ----------------------------------------------------------------------------


def test_plain_station_is_not_linked_with_openssl(programs: Path) -> None:
    """It would cost it three times its memory."""

    def needed(program: str) -> set[str]:
        command = ["readelf", "--dynamic", programs / "modules" / program]
        output = subprocess.run(command, capture_output=True, text=True, check=True).stdout
        return set(re.findall(r"NEEDED.*\[(lib(?:ssl|crypto))", output))

    assert needed("rtu-iec104") == set()
    assert needed("rtu-iec104-tls") == {"libssl", "libcrypto"}


# ---- files that do not do -------------------------------------------------------------------------------


@contextlib.contextmanager
def not_up(pki: Pki, programs: Path, **tls: Any) -> Iterator[TlsGateway]:
    """A gateway whose station does not start."""
    directory = run_directory()
    gateway = TlsGateway(pki, directory, programs, **tls)
    command = [programs / "rtud/rtud", "--map", gateway.map, "--modules", programs / "modules"]
    with gateway.log_file.open("wb") as log:
        gateway.process = subprocess.Popen([*command, gateway.config_file], stderr=log)
    try:
        yield gateway
    finally:
        gateway.stop()
        remove(directory)


def test_key_that_others_may_read(pki: Pki, programs: Path) -> None:
    station = pki.ours.issue_for_station("substation 10")
    station.key.chmod(0o644)
    files = {"certificate": str(station.certificate), "key": str(station.key)}
    with not_up(pki, programs, **files) as gateway:
        gateway.wait_log(
            rf"rtu-iec104-tls: the key {station.key}: other users may read it: type chmod o= for it$"
        )


def test_key_of_another_certificate(pki: Pki, programs: Path) -> None:
    other = pki.ours.issue_for_station("substation 11")
    with not_up(pki, programs, key=str(other.key)) as gateway:
        gateway.wait_log("the key .*: does not belong to the certificate$")


@pytest.mark.sample(4)
@pytest.mark.parametrize("name", ["certificate", "key", "ca", "crl"])
def test_file_that_is_not_there(pki: Pki, programs: Path, name: str) -> None:
    with not_up(pki, programs, **{name: "/nowhere/file.pem"}) as gateway:
        gateway.wait_log(f"rtu-iec104-tls: the {name} /nowhere/file.pem: No such file or directory$")


@pytest.mark.sample(4)
@pytest.mark.parametrize("name", ["certificate", "key", "ca", "crl"])
def test_file_with_something_else(pki: Pki, programs: Path, name: str, tmp_path: Path) -> None:
    folder = run_directory()
    try:
        file = folder / "file.pem"
        file.write_text("what is this?\n")
        file.chmod(0o600 if name == "key" else 0o644)
        if os.geteuid() == 0:
            os.chown(file, 61201, 61201)
        with not_up(pki, programs, **{name: str(file)}) as gateway:
            gateway.wait_log(f"the {name} {file}: [a-z]")
    finally:
        remove(folder)


@pytest.mark.slow
def test_key_with_a_passphrase(pki: Pki, programs: Path) -> None:
    station = pki.ours.issue_for_station("substation 12")
    station.key.chmod(0o600)
    openssl("ec", "-in", station.key, "-aes128", "-passout", "pass:secret", "-out", station.key)
    files = {"certificate": str(station.certificate), "key": str(station.key)}
    with not_up(pki, programs, **files) as gateway:
        gateway.wait_log("the key .*: [a-z]")


@pytest.mark.slow
def test_own_certificate_that_has_expired_is_said(pki: Pki, programs: Path) -> None:
    """The masters refuse it; the station's clock may be the one that is wrong."""
    station = pki.ours.issue_for_station("substation 13", days=-1)
    files = {"certificate": str(station.certificate), "key": str(station.key)}
    with not_up(pki, programs, **files) as gateway:
        gateway.wait_log('own certificate expired on .*: "substation 13"$')
        gateway.wait_log("listening on")
        with pytest.raises(ssl.SSLCertVerificationError, match="expired"):
            connected(gateway, pki.client())
        gateway.wait_log("refused, considers our certificate expired$")
