# SPDX-License-Identifier: GPL-3.0-or-later
"""
Every frame between controlling stations and the gateway, recorded on the way and read by tshark at the end.
Without rights nobody may capture packets, so the tests' masters connect to a relay, and what it carried is
written as the packets it could have been.
"""

import contextlib
import ipaddress
import itertools
import os
import socket
import struct
import subprocess
import threading
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from lab.gateway import Rtu

PORT = 2404
MASTERS_PORT = 40000
START, APDU_LEAST = 0x68, 4
NEGATIVE = 0x40  # P/N beside the cause
TLS_HANDSHAKE = b"\x16\x03"
FIRST_MASTER = 0x0A000001  # of their IP addresses
PAYLOAD_MAX = 2048  # of a packet: tshark takes no more than some hundred PDUs in one
LINKTYPE_RAW = 101  # an IP packet without anything before it
PCAP_HEAD = struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 262144, LINKTYPE_RAW)
FIELDS = ("frame.number", "frame.protocols", "_ws.malformed", "_ws.expert.message")


@dataclass
class Connection:
    """What one carried: the pieces in order, whether each is the station's."""

    test: str
    pieces: list[tuple[bool, bytes]] = field(default_factory=list)
    closed_by_station: bool | None = None  # None: it is open
    master_port: int = 0  # the master's, as it sees itself,
    station_port: int = 0  # and as the station sees it, behind the relay

    @property
    def encrypted(self) -> bool:
        return bool(self.pieces) and self.pieces[0][1].startswith(TLS_HANDSHAKE)

    def frames(self) -> Iterator[tuple[bool, bytes]]:
        """Whose, and its octets. What has an impossible beginning is one frame, what is cut off is none."""
        waiting = {True: b"", False: b""}
        for by_station, piece in self.pieces:
            stream = waiting[by_station] + piece
            while len(stream) >= 2 and len(stream) >= (size := _size(stream)):
                yield by_station, stream[:size]
                stream = stream[size:]
            waiting[by_station] = stream


def _size(stream: bytes) -> int:
    return 2 + stream[1] if stream[0] == START and stream[1] >= APDU_LEAST else len(stream)


class Relay:
    """Listens in the place of a controlled station."""

    def __init__(self, station: tuple[str, int], record: list[Connection]) -> None:
        self._station, self._record = station, record
        self._listener = socket.create_server((station[0], 0), backlog=64)
        self.address: tuple[str, int] = self._listener.getsockname()[:2]
        self._thread = threading.Thread(target=self._accept, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._listener.shutdown(socket.SHUT_RDWR)
        self._thread.join()
        self._listener.close()

    def _accept(self) -> None:
        while True:
            try:
                master, (host, port, *_) = self._listener.accept()
            except OSError:
                return
            try:  # a station may ask who its master is
                station = socket.create_connection(self._station, 5, source_address=(host, 0))
            except OSError:
                master.close()
                continue
            test = os.environ.get("PYTEST_CURRENT_TEST", "?")
            connection = Connection(test, master_port=port, station_port=station.getsockname()[1])
            self._record.append(connection)
            for ends in ((master, station, False), (station, master, True)):
                ends[0].settimeout(None)
                ends[0].setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                threading.Thread(target=_carry, args=(*ends, connection), daemon=True).start()


def _carry(source: socket.socket, sink: socket.socket, by_station: bool, connection: Connection) -> None:
    """Until one end closes, which closes the other."""
    with contextlib.suppress(OSError):
        while piece := source.recv(65536):
            connection.pieces.append((by_station, piece))
            sink.sendall(piece)
    if connection.closed_by_station is None:
        connection.closed_by_station = by_station
    for end in (source, sink):
        with contextlib.suppress(OSError):
            end.shutdown(socket.SHUT_RDWR)
    source.close()


RECORD: list[Connection] = []  # of this process, for the session's last fixture
STATIONS: dict[tuple[str, int], tuple[str, int]] = {}  # behind the relays


def port_behind_relay(gateway: Rtu, master_port: int, since: int) -> int | None:
    """
    The port by which the station knows a master; None: the relay has not connected it yet. since: the length
    of RECORD before it connected, for a long run of tests uses ports again.
    """
    if gateway.address not in STATIONS:
        return master_port
    return next((end.station_port for end in RECORD[since:] if end.master_port == master_port), None)


@contextlib.contextmanager
def recorded(gateway: Rtu) -> Iterator[None]:
    """What connects to gateway.address from now on is recorded."""
    address, relay = gateway.address, Relay(gateway.address, RECORD)
    gateway.address = relay.address
    STATIONS[relay.address] = address
    try:
        yield
    finally:
        gateway.address = address
        relay.close()


@contextlib.contextmanager
def unrecorded(gateway: Rtu) -> Iterator[None]:
    """Without the relay, which may carry the end of a connection after the beginning of the next."""
    relay = gateway.address
    gateway.address = STATIONS[relay]
    try:
        yield
    finally:
        gateway.address = relay


# ---- as packets -------------------------------------------------------------------------------------


def packet_of(by_station: bool, connection: int, sequence: int, acknowledged: int, payload: bytes) -> bytes:
    """IPv4 and TCP, without the checksums, which tshark does not look at; a master each connection."""
    master, station = struct.pack(">I", FIRST_MASTER + connection), bytes((192, 0, 2, 1))
    addresses = station + master if by_station else master + station
    ports = (PORT, MASTERS_PORT) if by_station else (MASTERS_PORT, PORT)
    ip = struct.pack(">BBHHHBBH", 0x45, 0, 40 + len(payload), 0, 0, 64, 6, 0) + addresses
    tcp = struct.pack(">HHIIBBHHH", *ports, sequence, acknowledged, 0x50, 0x18, 65535, 0, 0)
    return ip + tcp + payload


def record_of(packet: bytes, second: int) -> bytes:
    """As it stands in a pcap file, behind PCAP_HEAD."""
    return struct.pack("<IIII", second, 0, len(packet), len(packet)) + packet


def write_pcap(file: BinaryIO, connections: list[Connection]) -> list[tuple[Connection, bool, bytes]]:
    """A packet for each frame; returns the frames, in order."""
    file.write(PCAP_HEAD)
    frames = []
    for number, connection in enumerate(connections):
        sent = {True: 1, False: 1}
        for by_station, frame in connection.frames():
            packet = packet_of(by_station, number, sent[by_station], sent[not by_station], frame)
            file.write(record_of(packet, len(frames)))
            sent[by_station] = (sent[by_station] + len(frame)) % 2**32
            frames.append((connection, by_station, frame))
    return frames


# ---- as tshark sees it ------------------------------------------------------------------------------


@dataclass(frozen=True)
class Finding:
    """A frame that the dissector does not understand."""

    test: str
    by_station: bool
    allowed: bool  # the master's, and the station refused it or closed the connection
    frame: bytes
    text: str

    def __str__(self) -> str:
        sender = "station" if self.by_station else "master"
        return f"{self.test}: {sender}: {self.frame.hex(' ')}: {self.text}"


def _is_apdu(frame: bytes) -> bool:
    """The dissector passes over what stands before a start octet."""
    return len(frame) >= 6 and frame[0] == START


def _is_refused(request: bytes, replies: Iterable[bytes]) -> bool:
    """Of the replies one mirrors the request, with P/N = 1."""
    asdus = (reply[6:] for reply in replies if _is_apdu(reply) and not reply[2] & 1)
    return any(asdu[:1] == request[6:7] and asdu[2] & NEGATIVE for asdu in asdus)


def dissect(connections: list[Connection], pcap: Path) -> tuple[int, list[Finding]]:
    """How many frames there are, and what tshark finds wrong."""
    plain = [connection for connection in connections if not connection.encrypted]
    with pcap.open("wb") as file:
        frames = write_pcap(file, plain)
    options = [word for name in FIELDS for word in ("-e", name)]
    command = ["tshark", "-r", pcap, "-d", f"tcp.port=={PORT},iec60870_104", "-T", "fields", *options]
    output = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    assert len(output) == len(frames)
    findings = []
    for number, (line, (connection, by_station, frame)) in enumerate(zip(output, frames, strict=True)):
        _, protocols, malformed, messages = line.split("\t")
        understood = _is_apdu(frame) and (frame[2] & 1 or "iec60870_asdu" in protocols)
        if understood and not malformed and not messages:
            continue
        text = messages or malformed or f"dissected as {protocols} only"
        replies = (reply for end, is_reply, reply in frames[number:] if end is connection and is_reply)
        allowed = not by_station and (connection.closed_by_station is True or _is_refused(frame, replies))
        findings.append(Finding(connection.test, by_station, allowed, frame, text))
    return len(frames), findings


# ---- MMS -------------------------------------------------------------------------------------------


def _joined(pieces: list[tuple[bool, bytes]]) -> Iterator[tuple[bool, bytes]]:
    """Those of one sender that follow each other, as large as packets are."""
    for by_server, group in itertools.groupby(pieces, key=lambda piece: piece[0]):
        octets = b"".join(piece for _, piece in group)
        for at in range(0, len(octets), PAYLOAD_MAX):
            yield by_server, octets[at : at + PAYLOAD_MAX]


def dissect_mms(connections: list[Connection], pcap: Path) -> tuple[list[str], list[str]]:
    """What MMS servers have answered, "" for a report, and what tshark finds wrong in what they have sent."""
    count = 0
    with pcap.open("wb") as file:
        file.write(PCAP_HEAD)
        for number, connection in enumerate(connections):
            sent = {True: 1, False: 1}
            for by_server, piece in _joined(list(connection.pieces)):
                packet = packet_of(by_server, number, sent[by_server], sent[not by_server], piece)
                file.write(record_of(packet, count))
                sent[by_server] += len(piece)
                count += 1
    fields = ["ip.dst", "mms.confirmedServiceResponse", *FIELDS]
    options = [word for name in fields for word in ("-e", name)]
    command = ["tshark", "-r", pcap, "-d", f"tcp.port=={PORT},tpkt", "-Y", f"tcp.srcport == {PORT}"]
    command += ["-T", "fields", *options]
    rows = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    answered, findings = [], []
    for row in rows:
        client, service, frame, protocols, malformed, messages = row.split("\t")
        if "mms" in protocols:
            answered += service.split(",")
        if malformed or messages:
            number = int(ipaddress.ip_address(client)) - FIRST_MASTER
            findings.append(f"{connections[number].test}: frame {frame}: {messages or malformed}")
    return answered, findings
