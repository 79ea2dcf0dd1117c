# SPDX-License-Identifier: GPL-3.0-or-later
"""A gateway whose station speaks TLS, and who asks it."""

from __future__ import annotations

import contextlib
import os
import re
import select
import signal
import socket
import ssl
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from lab.gateway import TESTFR_ACT, TESTFR_CON, Gateway, free_port, remove, run_directory
from lab.master import Monitor
from lab.raw_master import RawMaster
from peers.authority import Authority, Identity

POINTS = 5000
VERSIONS = {"1.2": ssl.TLSVersion.TLSv1_2, "1.3": ssl.TLSVersion.TLSv1_3}
WAITS_S = 10.0
STATION = 1001


@dataclass
class Pki:
    """The certificates of a control centre, a substation, and a few that are not right."""

    ours: Authority
    station: Identity
    centre: Identity
    stranger: Identity

    def settings(self, **more: Any) -> dict[str, Any]:
        files = {
            "certificate": self.station.certificate,
            "key": self.station.key,
            "ca": self.ours.certificate,
        }
        return {name: str(path) for name, path in files.items()} | more

    def client(
        self, identity: Identity | None = None, version: str | None = None, weak: bool = False
    ) -> ssl.SSLContext:
        """A controlling station's side; by default the centre's, in every version."""
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        context.check_hostname = False
        if weak:
            context.set_ciphers("DEFAULT@SECLEVEL=0")
        context.load_verify_locations(self.ours.certificate)
        identity = identity or self.centre
        context.load_cert_chain(identity.certificate, identity.key)
        if version:
            context.minimum_version = context.maximum_version = VERSIONS[version]
        return context


def public_keys(folder: Path) -> Pki:
    """In a folder that the station's user may enter."""
    ours, theirs = Authority(folder / "ours"), Authority(folder / "theirs", "Other CA")
    return Pki(ours, ours.issue_for_station(), ours.issue("centre 1"), theirs.issue("stranger"))


class TlsGateway(Gateway):
    """It is up when its station answers one who may ask."""

    def __init__(self, pki: Pki, directory: Path, build: Path, **tls: Any) -> None:
        line = {"value": 1, "active": 1, "baud_rate": 9600, "data_bits": 8, "stop_bits": 1, "parity": 0}
        device = {"id": 1, "input_registers": [{"address": address} for address in range(POINTS)]}
        config = {
            "iec104": {"address": "127.0.0.1", "port": free_port()},
            "tls": pki.settings(**tls),
            "port": [line | {"slaves": [device]}],
        }
        self.pki = pki
        self.asked_by = pki.client()
        super().__init__(config, directory, build)

    def _station_answers(self) -> bool:
        try:
            with connected(self, self.asked_by) as connection:
                connection.sendall(TESTFR_ACT)
                return connection.recv(len(TESTFR_CON)) == TESTFR_CON
        except OSError:
            return False

    def master(self, version: str | None = None, kind: type[RawMaster] = RawMaster) -> RawMaster:
        return kind(*self.address, tls=self.pki.client(version=version))

    def wait_log(self, pattern: str) -> None:
        """Until the pattern is in a line of the log."""
        wanted = re.compile(pattern, re.MULTILINE)
        self.wait_for(lambda: bool(wanted.search(self.log_file.read_text())), WAITS_S, pattern)

    def restart_station(self, number: signal.Signals) -> None:
        former = self.modules()["rtu-iec104"]["pid"]
        os.kill(former, number)
        self.wait_for(
            lambda: self.modules()["rtu-iec104"]["pid"] not in (0, former) and self._station_answers(),
            WAITS_S,
            "the station is back",
        )

    def processor_seconds(self) -> float:
        stat = Path(f"/proc/{self.modules()['rtu-iec104']['pid']}/stat").read_text()
        return sum(map(int, stat.rpartition(")")[2].split()[11:13])) / os.sysconf("SC_CLK_TCK")


class ApduAWake(RawMaster):
    """
    Reads one APDU each time its socket is readable and never asks what TLS holds back, as lib60870 in C does:
    of two APDUs in a record, the second waits until something else comes.
    """

    def _receive(self, deadline: float) -> bytes | None:
        connected = self._connected
        while select.select([connected], [], [], max(0.0, deadline - time.monotonic()))[0]:
            with contextlib.suppress(ssl.SSLWantReadError):  # a record of TLS may hold nothing for us
                connected.setblocking(False)
                head = connected.recv(2)
                return head + connected.recv(head[1]) if head else head
        return None


@contextlib.contextmanager
def gateway_with(pki: Pki, programs: Path, **tls: Any) -> Iterator[TlsGateway]:
    directory = run_directory()
    try:
        with TlsGateway(pki, directory, programs, **tls) as gateway:
            yield gateway
    finally:
        remove(directory)


def connected(
    gateway: Gateway, context: ssl.SSLContext, session: ssl.SSLSession | None = None
) -> ssl.SSLSocket:
    plain = socket.create_connection(gateway.address, timeout=WAITS_S)
    try:
        return context.wrap_socket(plain, session=session)
    except BaseException:
        plain.close()
        raise


@contextlib.contextmanager
def tunnel(address: tuple[str, int], context: ssl.SSLContext) -> Iterator[int]:
    """A TCP port that leads to a server through TLS, for one connection."""
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def carry() -> None:
            plain, _ = listener.accept()
            with plain, context.wrap_socket(socket.create_connection(address, WAITS_S)) as secured:
                while True:
                    ready = [secured] if secured.pending() else select.select([plain, secured], [], [])[0]
                    for side in ready:
                        side.setblocking(False)
                        with contextlib.suppress(ssl.SSLWantReadError):  # a ticket is not for the other side
                            octets = side.recv(65536)
                            if not octets:
                                return
                            other = plain if side is secured else secured
                            other.settimeout(WAITS_S)
                            other.sendall(octets)

        thread = threading.Thread(target=carry, daemon=True)
        thread.start()
        yield int(listener.getsockname()[1])
        thread.join(WAITS_S)
        assert not thread.is_alive()


def received(connection: socket.socket, count: int) -> bytes:
    octets = bytearray()
    while len(octets) < count:
        octets += connection.recv(count - len(octets)) or pytest.fail("closed by the station")
    return bytes(octets)


def closed_by_station(connection: socket.socket) -> bool:
    with contextlib.suppress(ConnectionResetError):
        while connection.recv(4096):
            pass
    return True


def knock(gateway: TlsGateway, context: ssl.SSLContext) -> int:
    """Tries to come in; returns the own TCP port. TLS 1.3 refuses after the client's end of the handshake."""
    with socket.create_connection(gateway.address, timeout=WAITS_S) as plain:
        port = int(plain.getsockname()[1])
        refusals = contextlib.suppress(ssl.SSLError, ConnectionResetError, BrokenPipeError)
        with refusals, context.wrap_socket(plain) as connection:
            connection.sendall(TESTFR_ACT)
            assert connection.recv(6) != TESTFR_CON, "came in"
        return port


def assert_refused(gateway: TlsGateway, context: ssl.SSLContext, why: str) -> None:
    gateway.wait_log(rf" port {knock(gateway, context)}: refused, {re.escape(why)}$")


def interrogate_with_lib60870(port: int) -> None:
    """By c104, which speaks plain TCP to a tunnel's port of 127.0.0.1."""
    with Monitor("127.0.0.1", port) as monitor:
        assert monitor.interrogate(STATION)
