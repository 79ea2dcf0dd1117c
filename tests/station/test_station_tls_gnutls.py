# SPDX-License-Identifier: GPL-3.0-or-later
"""The station's TLS against another implementation than its own: GnuTLS, and lib60870 through it."""

import contextlib
import select
import socket
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from lab.gateway import TESTFR_ACT, TESTFR_CON, remove, run_directory
from peers.authority import Identity
from peers.gnutls import GnuTls, GnuTlsError
from peers.tls_gateway import WAITS_S, TlsGateway, gateway_with, interrogate_with_lib60870, public_keys

pytestmark = pytest.mark.slow

RENEWAL_S = 10
VERSIONS = {"1.2": "NORMAL:-VERS-ALL:+VERS-TLS1.2", "1.3": "NORMAL:-VERS-ALL:+VERS-TLS1.3"}


@contextlib.contextmanager
def started(programs: Path, **keys: int) -> Iterator[TlsGateway]:
    folder = run_directory()
    with gateway_with(public_keys(folder), programs, **keys) as gateway:
        yield gateway
    remove(folder)


@pytest.fixture
def gateway(programs: Path) -> Iterator[TlsGateway]:
    """Of the test's own: what others have done leaves lines of its log out."""
    with started(programs) as gateway:
        yield gateway


@pytest.fixture
def renewing(programs: Path) -> Iterator[TlsGateway]:
    """One that asks for new keys so often that TLS 1.2 ends within a slow test."""
    with started(programs, renewal_s=RENEWAL_S) as gateway:
        yield gateway


def connected(
    gateway: TlsGateway, priority: str, former: bytes | None = None, identity: Identity | None = None
) -> GnuTls:
    plain = socket.create_connection(gateway.address, timeout=WAITS_S)
    pki = gateway.pki
    return GnuTls(plain, str(pki.ours.certificate), identity or pki.centre, priority, former)


def is_alive(connection: GnuTls) -> bool:
    connection.send(TESTFR_ACT)
    while (answer := connection.receive(len(TESTFR_CON))) == TESTFR_ACT:
        connection.send(TESTFR_CON)
    return answer == TESTFR_CON


@pytest.mark.sample(2)
@pytest.mark.parametrize("version", VERSIONS)
def test_comes_in(gateway: TlsGateway, version: str) -> None:
    with connected(gateway, VERSIONS[version]) as connection:
        assert connection.version == f"TLS{version}"
        assert is_alive(connection)
    gateway.wait_log(rf'TLSv{version}, "centre 1"$')


@pytest.mark.sample(5)
@pytest.mark.parametrize(
    "suite",
    [
        "+VERS-TLS1.2:+ECDHE-ECDSA:+AES-128-GCM",
        "+VERS-TLS1.2:+ECDHE-ECDSA:+AES-256-GCM",
        "+VERS-TLS1.3:+AES-128-GCM",
        "+VERS-TLS1.3:+AES-256-GCM",
        "+VERS-TLS1.3:+CHACHA20-POLY1305",
    ],
)
def test_suites(gateway: TlsGateway, suite: str) -> None:
    with connected(gateway, f"NONE:{suite}:+AEAD:+COMP-NULL:+SIGN-ALL:+GROUP-ALL:+CTYPE-X509") as connection:
        assert is_alive(connection)


@pytest.mark.sample(2)
@pytest.mark.parametrize("suite", ["+ECDHE-ECDSA:+AES-128-CBC:+SHA1", "+ECDHE-ECDSA:+AES-128-CCM:+AEAD"])
def test_suites_that_are_not_allowed(gateway: TlsGateway, suite: str) -> None:
    with pytest.raises(GnuTlsError, match="fatal alert"):
        connected(gateway, f"NONE:+VERS-TLS1.2:{suite}:+COMP-NULL:+SIGN-ALL:+GROUP-ALL:+CTYPE-X509")
    gateway.wait_log("refused, no cipher suite is allowed$")


@contextlib.contextmanager
def tunnel(secured: GnuTls) -> Iterator[int]:
    """A TCP port that leads to the station, for one connection."""
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def carry() -> None:
            plain, _ = listener.accept()
            with plain, secured:
                while True:
                    ready = (
                        [secured.plain]
                        if secured.pending
                        else select.select([plain, secured.plain], [], [])[0]
                    )
                    if plain in ready:
                        if not (octets := plain.recv(65536)):
                            return
                        secured.send(octets)
                    if secured.plain in ready:
                        came = secured.recv()
                        if came == b"":
                            return
                        plain.sendall(came or b"")

        thread = threading.Thread(target=carry, daemon=True)
        thread.start()
        yield int(listener.getsockname()[1])
        thread.join(WAITS_S)
        assert not thread.is_alive()


@pytest.mark.slow  # test_station_tls.py does the same with its own TLS, and the suites here meet GnuTLS
@pytest.mark.parametrize("version", VERSIONS)
def test_lib60870_through_gnutls(gateway: TlsGateway, version: str) -> None:
    with tunnel(connected(gateway, VERSIONS[version])) as port:
        interrogate_with_lib60870(port)


@pytest.mark.sample(2)
@pytest.mark.parametrize("version", VERSIONS)
def test_session_is_resumed(gateway: TlsGateway, version: str) -> None:
    with connected(gateway, VERSIONS[version]) as first:
        assert is_alive(first) and not first.is_resumed
        session = first.session()
    with connected(gateway, VERSIONS[version], session) as second:
        assert second.is_resumed
        assert is_alive(second)
    gateway.wait_log(rf'TLSv{version} resumed, "centre 1"$')


def test_stranger_is_refused(gateway: TlsGateway) -> None:
    """GnuTLS shows no certificate that the station's CAs have not given; TLS 1.2 tells at once."""
    with pytest.raises(GnuTlsError, match=r"alert|terminated"):
        connected(gateway, VERSIONS["1.2"], identity=gateway.pki.stranger)
    gateway.wait_log("refused, shows no certificate$")


def test_keys_are_renewed_by_both(renewing: TlsGateway) -> None:
    """By GnuTLS when it likes, by the station in its time; every octet is there."""
    with connected(renewing, VERSIONS["1.3"]) as connection:
        port = connection.plain.getsockname()[1]
        for _ in range(5):
            connection.renew_keys()
            assert is_alive(connection)
        renewing.wait_for(
            lambda: is_alive(connection) and f"port {port}: its keys are renewed" in renewing.log(),
            RENEWAL_S + WAITS_S,
            "the station's turn",
        )
        connection.renew_keys()
        assert is_alive(connection)
