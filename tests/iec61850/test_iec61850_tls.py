# SPDX-License-Identifier: GPL-3.0-or-later
"""rtu-iec61850 on TLS (IEC 62351-3 and -4): who comes in, who does not and why, what hostile peers do."""

import asyncio
import contextlib
import json
import re
import socket
import ssl
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from test_iec61850 import PATHS, TESTS

from iec61850 import FC, IedConnection, TlsConfig, TlsVersion
from lab.gateway import Gateway, free_port, listening_on, remove, run_directory
from peers import mms
from peers.authority import IEC61850_USER, Identity, give_to_station
from peers.mms import Client
from peers.tls_gateway import VERSIONS, WAITS_S, Pki, closed_by_station, public_keys, tunnel
from rig.capture import Relay
from rig.desk import wait_still

pytestmark = pytest.mark.slow

ASSOCIATIONS = 4
POINTS = 400
DEVICE = "OpenRTUCA1001"
RSA = "-newkey rsa:2048"  # in TLS 1.2 the Rust client takes no elliptic curves
HANDSHAKE_S = 10.0  # what the server grants


@dataclass
class Server:
    """A gateway without devices whose IEC 61850 is on TLS."""

    gateway: Gateway
    pki: Pki
    port: int

    @property
    def address(self) -> tuple[str, int]:
        return "127.0.0.1", self.port

    def client(self, identity: Identity | None = None, version: str | None = None, **more: Any) -> Client:
        return Client(self.port, tls=self.pki.client(identity, version), **more)

    def counter(self, name: str) -> int:
        lines = self.gateway.ctl("counters", "rtu-iec61850").splitlines()
        return int(next(line.split()[-1] for line in lines if line.split()[1:2] == [name]))

    def associations(self) -> list[dict[str, Any]]:
        return self.gateway.query("iec61850", "associations")

    def wait_log(self, pattern: str) -> None:
        wanted = re.compile(pattern, re.MULTILINE)
        self.gateway.wait_for(
            lambda: bool(wanted.search(self.gateway.log_file.read_text())), WAITS_S, pattern
        )

    def refuses(self, context: ssl.SSLContext, why: str) -> None:
        with socket.create_connection(self.address, WAITS_S) as plain:
            port = plain.getsockname()[1]
            refusals = contextlib.suppress(ssl.SSLError, ConnectionResetError, BrokenPipeError)
            with refusals, context.wrap_socket(plain) as connection:
                connection.sendall(mms.CONNECT_TRANSPORT)
                assert connection.recv(4) == b"", "came in"
        self.wait_log(rf" port {port}: refused, {re.escape(why)}$")


@contextlib.contextmanager
def server_with(pki: Pki, programs: Path, **tls: Any) -> Iterator[Server]:
    port, directory = free_port(), run_directory()
    line = {"value": 1, "active": 1, "baud_rate": 9600, "data_bits": 8, "stop_bits": 1, "parity": 0}
    device = {"id": 1, "input_registers": [{"address": address} for address in range(POINTS)]}
    server = {"address": "127.0.0.1", "port": port, "associations": ASSOCIATIONS, "max_pdu": 65000}
    config = {"iec61850": server | {"tls": pki.settings(**tls)}, "port": [line | {"slaves": [device]}]}
    try:
        with Gateway(listening_on(config, free_port()), directory, programs) as gateway:
            yield Server(gateway, pki, port)
    finally:
        remove(directory)


@pytest.fixture(scope="module")
def pki() -> Iterator[Pki]:
    folder = run_directory()
    made = public_keys(folder)
    made.station = made.ours.issue("substation 7", key=RSA, usage="serverAuth", names="IP:127.0.0.1")
    give_to_station(made.station.key, IEC61850_USER)
    yield made
    remove(folder)


@pytest.fixture(scope="module")
def server(pki: Pki, programs: Path) -> Iterator[Server]:
    with server_with(pki, programs) as server:
        yield server
        assert server.gateway.modules()["rtu-iec61850"]["restarts"] == 0


# ---- who comes in ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("version", VERSIONS)
def test_rtuctl_shows_whose_certificate_a_client_has(server: Server, version: str) -> None:
    with server.client(version=version) as client:
        assert client.names(9) == [DEVICE]
        server.gateway.wait_for(
            lambda: (
                [row["certificate"] for row in server.associations() if row["associated"]] == ["centre 1"]
            ),
            WAITS_S,
            "rtuctl shows it",
        )
    server.wait_log(rf'TLSv{version}, "centre 1"$')


@pytest.mark.parametrize("version", [TlsVersion.TLS_1_2, TlsVersion.TLS_1_3])
def test_the_rust_client_reads_by_its_own_tls(server: Server, version: TlsVersion) -> None:
    """rustls, which looks for the address in the certificate, whatever verify_hostname says."""
    pki = server.pki
    config = TlsConfig(
        ca_pem=pki.ours.certificate.read_bytes(),
        client_cert_pem=pki.centre.certificate.read_bytes(),
        client_key_pem=pki.centre.key.read_bytes(),
        min_version=version,
        max_version=version,
    )

    async def read() -> tuple[list[str], str]:
        connection = await IedConnection.connect_tls(f"127.0.0.1:{server.port}", config, "127.0.0.1")
        devices = await connection.get_server_directory()
        name = await connection.read_string(f"{DEVICE}/GGIO1.AnIn30001.d", FC.DC)
        await connection.disconnect()
        return devices, name

    devices, name = asyncio.run(asyncio.wait_for(read(), 60))
    assert devices == [DEVICE]
    assert server.gateway.points()[name]["ioa"] == 30001


@pytest.mark.parametrize("version", VERSIONS)
def test_libiec61850_browses_through_tls(server: Server, version: str) -> None:
    """In a tunnel: its Python package is built without TLS."""
    with tunnel(server.address, server.pki.client(version=version)) as port:
        command = [sys.executable, "-m", "peers.libiec61850_browse", str(port)]
        run = subprocess.run(
            command, cwd=TESTS, env=PATHS, capture_output=True, text=True, timeout=120, check=True
        )
    assert len(json.loads(run.stdout)[DEVICE]["variables"]) > POINTS


@pytest.mark.parametrize("version", VERSIONS)
def test_long_answers_and_piped_requests(server: Server, version: str) -> None:
    """Answers of many records, asked for by one record and octet by octet."""
    service = mms.read((DEVICE, "GGIO1$MX"))
    whole = b"".join(mms.tpkt(mms.data(mms.request(i, service))) for i in range(20))
    with server.client(version=version) as client:
        client.send(whole)
        answers = [client.mms() for _ in range(20)]
        assert [int.from_bytes(mms.elements(pdu)[0][1], "big") for _, pdu in answers] == list(range(20))
        assert len(answers[0][1]) > 2 * 4096 and {tag for tag, _ in answers} == {mms.RESPONSE}
        for i in range(len(whole) // 20):
            client.send(whole[i : i + 1])
        assert client.mms()[1][4:] == answers[0][1][4:]


# ---- who does not, and why ------------------------------------------------------------------------------


def test_who_is_refused(server: Server) -> None:
    """Wrong CA, expired, of a server, none; each is in the log, and counted."""
    pki, before = server.pki, server.counter("handshakes_refused")
    naked = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    naked.check_hostname = False
    naked.load_verify_locations(pki.ours.certificate)
    for version in VERSIONS:
        server.refuses(pki.client(pki.stranger, version), 'certificate is not from a known CA: "stranger"')
    server.refuses(pki.client(pki.ours.issue("old", days=-1)), 'certificate has expired: "old"')
    usage = pki.ours.issue("substation 9", usage="serverAuth")
    server.refuses(pki.client(usage), 'unsuitable certificate purpose: "substation 9"')
    server.refuses(naked, "shows no certificate")
    with socket.create_connection(server.address, WAITS_S) as plain:
        plain.sendall(mms.CONNECT_TRANSPORT)
        assert closed_by_station(plain)
        server.wait_log(rf" port {plain.getsockname()[1]}: refused, does not speak TLS$")
    server.gateway.wait_for(
        lambda: server.counter("handshakes_refused") == before + 6, WAITS_S, "each is counted once"
    )
    with server.client() as client:
        assert client.names(9)


def test_only_listed_clients_and_nobody_revoked(pki: Pki, programs: Path) -> None:
    listed, lost, other = (pki.ours.issue(name) for name in ("listed", "lost", "other"))
    crl = str(pki.ours.revoke(lost))
    with server_with(pki, programs, clients=["listed", lost.fingerprint], crl=crl) as server:
        with server.client(listed) as client:
            assert client.names(9)
        server.refuses(pki.client(other), 'not in the list of clients: "other"')
        server.refuses(pki.client(lost), 'certificate revoked: "lost"')


def test_a_reload_lets_others_in(pki: Pki, programs: Path) -> None:
    """Then the process is another, with what the file names; without tls, it is of another program."""
    with server_with(pki, programs, clients=["nobody"]) as server:
        server.refuses(pki.client(), 'not in the list of clients: "centre 1"')
        config = server.gateway.configuration()
        config["iec61850"]["tls"]["clients"] = ["centre 1"]
        server.gateway.ctl("reload", server.gateway.put(config))
        with server.client() as client:
            assert client.names(9)
        del config["iec61850"]["tls"]
        server.gateway.ctl("reload", server.gateway.put(config))
        with Client(server.port) as client:
            assert client.names(9)


def test_a_key_that_others_may_read_is_refused(pki: Pki, programs: Path) -> None:
    station = pki.ours.issue_for_station("substation 8")
    give_to_station(station.key, IEC61850_USER)
    files = {"certificate": str(station.certificate), "key": str(station.key)}
    with server_with(pki, programs, **files) as server:
        station.key.chmod(0o404)
        server.gateway.kill("rtu-iec61850")
        server.wait_log(
            r"rtu-iec61850 error: the key .*: other users may read it: type chmod o= for it\n"
            r"(.*\n)*.*rtu-iec61850 exited with code 1"
        )
        station.key.chmod(0o400)
        server.wait_log(r"rtu-iec61850 exited with code 1(.*\n)*.*rtu-iec61850 info: listening on")
        with server.client() as client:
            assert client.names(9)


def test_refusals_cannot_flood_the_log(pki: Pki, programs: Path) -> None:
    peers = 400
    with server_with(pki, programs) as server:

        def speak_plainly() -> None:
            with socket.create_connection(server.address, WAITS_S) as plain:
                plain.sendall(mms.CONNECT_TRANSPORT)
                assert closed_by_station(plain)

        before = server.gateway.log_file.stat().st_size
        for _ in range(peers):
            speak_plainly()
        assert (
            server.gateway.log_file.stat().st_size - before
        ) / peers < 40  # a line has more than 80 octets
        server.gateway.wait_for(
            lambda: speak_plainly() is None and "are left out" in server.gateway.log(),
            WAITS_S,
            "what was left out",
        )


# ---- peers that do no good ------------------------------------------------------------------------------


def processor_seconds(server: Server) -> float:
    stat = Path(f"/proc/{server.gateway.modules()['rtu-iec61850']['pid']}/stat").read_text()
    return sum(map(int, stat.rpartition(")")[2].split()[11:13])) / 100


def test_many_that_hang_in_the_handshake_take_no_place(pki: Pki, programs: Path) -> None:
    """Of associations, nor the processor's time. A client of another address comes in meanwhile."""
    with server_with(pki, programs) as server, contextlib.ExitStack() as stack:
        clients = [stack.enter_context(server.client()) for _ in range(ASSOCIATIONS - 1)]
        hanging = [
            stack.enter_context(socket.create_connection(server.address, WAITS_S, ("127.0.0.2", 0)))
            for _ in range(40)
        ]
        clients.append(stack.enter_context(server.client()))
        assert all(client.names(9) for client in clients)
        server.gateway.wait_for(
            lambda: len(server.associations()) == ASSOCIATIONS, WAITS_S, "all have their places"
        )
        assert closed_by_station(hanging[0])
        wait_still(lambda: processor_seconds(server), 0.1)


def test_a_handshake_that_does_not_end_is_ended(server: Server) -> None:
    incoming, outgoing = ssl.MemoryBIO(), ssl.MemoryBIO()
    with contextlib.suppress(ssl.SSLWantReadError):
        server.pki.client().wrap_bio(incoming, outgoing).do_handshake()
    hello = outgoing.read()
    with contextlib.ExitStack() as stack:
        peers = [stack.enter_context(socket.create_connection(server.address, WAITS_S)) for _ in range(3)]
        peers[1].sendall(hello)
        peers[2].sendall(hello[:100])
        for peer in peers:
            peer.settimeout(4 * HANDSHAKE_S)
            assert closed_by_station(peer)
            server.wait_log(rf" port {peer.getsockname()[1]}: refused, its handshake takes too long$")


def test_a_client_that_never_associates_is_ended(server: Server) -> None:
    """Behind its handshake it has a place, and no longer than one without TLS."""
    with server.pki.client().wrap_socket(socket.create_connection(server.address, 4 * HANDSHAKE_S)) as silent:
        assert closed_by_station(silent)
    server.wait_log("has not associated$")


def test_renegotiation_is_refused_and_the_connection_goes_on(server: Server) -> None:
    """openssl's client begins anew at R. What it has sent before is answered behind it."""
    pki = server.pki
    command = ["openssl", "s_client", "-connect", f"127.0.0.1:{server.port}", "-tls1_2"]
    command += ["-cert", str(pki.centre.certificate), "-key", str(pki.centre.key)]
    command += ["-CAfile", str(pki.ours.certificate)]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL) as peer:
        assert peer.stdin and peer.stdout
        while b"Verify return code" not in peer.stdout.readline():
            pass
        peer.stdin.write(b"R\n")
        peer.stdin.flush()
        server.wait_log("renegotiation is refused$")
        peer.kill()
    with server.client() as client:
        assert client.names(9)


def test_octets_that_are_no_record_end_one_connection(server: Server) -> None:
    with server.client() as stays:
        for octets in (b"\x16\x03\x03\xff\xff", b"\0" * 100, b"\x17\x03\x03\0\x20" + bytes(32)):
            with server.client() as client:
                plain = socket.socket(fileno=client.socket.detach())
                with plain:
                    plain.settimeout(WAITS_S)
                    plain.sendall(octets)
                    assert closed_by_station(plain)
        assert stays.names(9)


@pytest.mark.parametrize("version", VERSIONS)
def test_keys_are_renewed_or_the_connection_is(pki: Pki, programs: Path, version: str) -> None:
    with server_with(pki, programs, renewal_s=10) as server, server.client(version=version) as client:
        if version == "1.3":
            until = time.monotonic() + 60
            while "its keys are renewed" not in server.gateway.log(1000):
                assert client.names(9) == [DEVICE] and time.monotonic() < until
                time.sleep(0.2)
            assert client.names(9) == [DEVICE]
        else:
            client.socket.settimeout(60)
            assert client.socket.recv(1) == b""  # close_notify: without it, ssl.SSLEOFError
            server.wait_log("its keys or its certificate are no longer good$")
            assert server.counter("connections_dropped") == 1


def test_no_octet_of_mms_is_on_the_wire(server: Server) -> None:
    """What a relay sees holds no name that the client has read."""
    record: list[Any] = []
    relay = Relay(server.address, record)
    try:
        with Client(relay.address[1], tls=server.pki.client()) as client:
            assert client.names(9) == [DEVICE]
    finally:
        relay.close()
    octets = b"".join(piece for connection in record for _, piece in connection.pieces)
    assert len(octets) > 1000 and DEVICE.encode() not in octets
