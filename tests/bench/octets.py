# SPDX-License-Identifier: GPL-3.0-or-later
"""
`make bench-polls`: the octets of one position on the wire, by type 201, by the standard types, as JSON by
MQTT and as GPX by HTTP, counted by the kernel on real connections. What the rows mean: docs/bench.md.
Exit codes: 0 done, 1 something did not work, 2 wrong usage.
"""

from __future__ import annotations

import argparse
import contextlib
import datetime
import http.client
import http.server
import socket
import socketserver
import struct
import sys
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import paho.mqtt.client as mqtt

from lab.gateway import REPOSITORY, Gateway, GatewayError, free_port, listening_on, remove, run_directory
from lab.raw_master import STARTDT_ACT
from lab.receiver import Receiver, burst

CA, POSITION = 3067, 200
MIRROR = (1, 2, 3, 8, 9)  # latitude, longitude, altitude, fix and satellites: what type 201 has
PLACE = (52.2190650, 21.0108517)
POSITIONS = 20
SILENCE_S = 0.3  # after which a fix is told
METRES = 1e-4  # degrees, so that each fix is sent
LIMIT_S = 30.0  # for a hang only
# Where struct tcp_info of the kernel has bytes_acked, bytes_received, segs_out and segs_in.
TCP_INFO, TCP_INFO_SIZE = struct.Struct("<QQII"), 144
TCP_INFO_AT = 120
GPX = (
    '<?xml version="1.0" encoding="UTF-8"?><gpx version="1.1" creator="rtu"'
    ' xmlns="http://www.topografix.com/GPX/1/1"><wpt lat="52.2190650" lon="21.0108517"><ele>137.2</ele>'
    "<time>2005-03-16T09:38:02.250Z</time><fix>dgps</fix><sat>10</sat></wpt></gpx>\r\n\r\n"
)
JSON = '{"lat":52.2190650,"lon":21.0108517,"alt":137.2,"fix":2,"sat":10,"q":0,"t":1110965882.250}'
HEADINGS = ("one position by", "octets there", "octets back", "segments", "of type 201")


@dataclass(frozen=True)
class Count:
    """Of a connection, from the side of who asks or listens: what it took and what it gave."""

    took: int
    gave: int
    segments: int

    @classmethod
    def of(cls, connection: socket.socket) -> Count:
        told = connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, TCP_INFO_SIZE)
        acked, received, out, into = TCP_INFO.unpack_from(told, TCP_INFO_AT)
        return cls(received, acked, out + into)

    def since(self, before: Count) -> Count:
        return Count(self.took - before.took, self.gave - before.gave, self.segments - before.segments)


@dataclass(frozen=True)
class Row:
    way: str
    count: Count
    positions: int

    @property
    def each(self) -> float:
        return (self.count.took + self.count.gave) / self.positions


# ---- IEC 60870-5-104 -----------------------------------------------------------------------------------


class Asking:
    """A controlling station that knows nothing but its numbers."""

    def __init__(self, address: tuple[str, int]) -> None:
        self.socket = socket.create_connection(address, LIMIT_S)
        self.sent = self.received = 0
        self.socket.sendall(bytes((0x68, 4, STARTDT_ACT, 0, 0, 0)))
        self.silence()

    def frame(self) -> bytes:
        head = self._exactly(2)
        octets = self._exactly(head[1])
        self.received += not octets[0] & 1
        return octets

    def _exactly(self, size: int) -> bytes:
        octets = b""
        while len(octets) < size:
            more = self.socket.recv(size - len(octets))
            if not more:
                raise OSError("the station has closed the connection")
            octets += more
        return octets

    def silence(self) -> None:
        """All that it says now, acknowledged."""
        before = self.received
        with contextlib.suppress(TimeoutError):
            self.socket.settimeout(SILENCE_S)
            while True:
                self.frame()
        self.socket.settimeout(LIMIT_S)
        if self.received != before:
            self.socket.sendall(struct.pack("<BBHH", 0x68, 4, 1, self.received << 1))

    def read(self, ioa: int) -> None:
        asdu = bytes((102, 1, 5, 0)) + CA.to_bytes(2, "little") + ioa.to_bytes(3, "little")
        numbers = struct.pack("<HH", self.sent << 1, self.received << 1)
        self.socket.sendall(bytes((0x68, 4 + len(asdu))) + numbers + asdu)
        self.sent += 1
        while self.frame()[6] != 5:
            pass


class Rtu:
    """A gateway whose receiver has said where it is."""

    def __init__(self, gateway: Gateway, receiver: Receiver) -> None:
        self.gateway, self.receiver = gateway, receiver
        self.at = datetime.datetime(2027, 3, 16, 9, 38, tzinfo=datetime.UTC)
        self.moved = 0
        self.gateway.wait_for(lambda: self.row()["open"], LIMIT_S, "the receiver's line is open")
        self.move()

    def row(self) -> dict[str, int]:
        return dict(self.gateway.query("gps")[0])

    def move(self) -> None:
        before = self.row()["fixes"]
        self.at += datetime.timedelta(seconds=1)
        self.moved += 1
        self.receiver.say(burst(self.at, PLACE[0] + self.moved * METRES, PLACE[1] + self.moved * METRES))
        self.gateway.wait_for(lambda: self.row()["fixes"] != before, LIMIT_S, "the burst is a fix")


@contextlib.contextmanager
def rtu(position_ioa: int | None) -> Iterator[Rtu]:
    directory = run_directory()
    (directory / "dev").mkdir()
    receiver = {"name": "van", "device": "gps1", "ca": CA, "distance_m": 1} | (
        {"position_ioa": position_ioa} if position_ioa else {}
    )
    try:
        with (
            Receiver(directory / "dev/gps1") as line,
            Gateway(listening_on({"port": [], "gps": [receiver]}, free_port()), directory) as gateway,
        ):
            yield Rtu(gateway, line)
    finally:
        remove(directory)


def counted(way: str, connection: socket.socket, one: Callable[[], None], positions: int = POSITIONS) -> Row:
    before = Count.of(connection)
    for _ in range(positions):
        one()
    return Row(way, Count.of(connection).since(before), positions)


def iec104_rows() -> Iterator[Row]:
    with rtu(POSITION) as van:
        asking = Asking(van.gateway.address)
        yield counted("type 201, polled", asking.socket, lambda: asking.read(POSITION))
        yield counted(
            "standard types, polled", asking.socket, lambda: [asking.read(ioa) for ioa in MIRROR] and None
        )
        yield counted(
            "type 201 and its mirror, spontaneous", asking.socket, lambda: (van.move(), asking.silence())[1]
        )
    with rtu(None) as van:
        asking = Asking(van.gateway.address)
        yield counted("standard types, spontaneous", asking.socket, lambda: (van.move(), asking.silence())[1])


# ---- the others ----------------------------------------------------------------------------------------


class Taking(http.server.BaseHTTPRequestHandler):
    """Takes a GPX file, as little as it says."""

    protocol_version = "HTTP/1.1"

    def do_POST(self) -> None:
        self.rfile.read(int(self.headers["Content-Length"]))
        self.send_response_only(204)
        self.end_headers()

    def log_message(self, format: str, *_: object) -> None:
        pass


def http_row() -> Row:
    with socketserver.ThreadingTCPServer(("127.0.0.1", 0), Taking) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        client = http.client.HTTPConnection(*server.server_address[:2], timeout=LIMIT_S)
        client.connect()

        def post() -> None:
            client.request("POST", f"/stations/{CA}", GPX, {"Content-Type": "application/gpx+xml"})
            client.getresponse().read()

        found = counted("GPX by HTTP", client.sock, post)
        client.close()
        server.shutdown()
    return found


class Broker(socketserver.StreamRequestHandler):
    """What any broker of MQTT 3.1.1 answers, octet by octet: CONNACK, and PUBACK of each message."""

    def handle(self) -> None:
        while head := self.rfile.read(2):
            body = self.rfile.read(head[1])  # less than 128 octets: one of length
            if head[0] == 0x10:
                self.wfile.write(bytes((0x20, 2, 0, 0)))
            elif head[0] & 0xF0 == 0x30:
                topic = int.from_bytes(body[:2])
                self.wfile.write(bytes((0x40, 2)) + body[2 + topic : 4 + topic])


def mqtt_row() -> Row:
    with socketserver.ThreadingTCPServer(("127.0.0.1", 0), Broker) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        client = mqtt.Client(mqtt.CallbackAPIVersion.VERSION2)
        client.connect("127.0.0.1", server.server_address[1])
        client.loop_start()
        client.publish(f"stations/{CA}", JSON, qos=1).wait_for_publish(LIMIT_S)  # it is connected
        connection = client.socket()
        assert isinstance(connection, socket.socket)
        found = counted(
            "JSON by MQTT, QoS 1",
            connection,
            lambda: client.publish(f"stations/{CA}", JSON, qos=1).wait_for_publish(LIMIT_S),
        )
        client.disconnect()
        client.loop_stop()
        server.shutdown()
    return found


# ---- the table -----------------------------------------------------------------------------------------


def table(found: list[Row]) -> str:
    cells = [HEADINGS]
    for row in found:
        asks = "HTTP" in row.way or "MQTT" in row.way  # there: from the RTU, whoever opened the connection
        there, back = (row.count.gave, row.count.took) if asks else (row.count.took, row.count.gave)
        cells.append(
            (
                row.way,
                f"{there / row.positions:.1f}",
                f"{back / row.positions:.1f}",
                f"{row.count.segments / row.positions:.1f}",
                f"{row.each / found[0].each:.2f}",
            )
        )
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    lines = ["| " + " | ".join(map(str.ljust, line, widths)) + " |" for line in cells]
    lines.insert(1, "|" + "|".join("-" * (width + 2) for width in widths) + "|")
    return "\n".join(lines)


def main() -> int:
    parser = argparse.ArgumentParser(description="Counts the octets of a position by several protocols.")
    parser.add_argument("--output", type=Path, default=REPOSITORY / "build", help="folder for the table")
    arguments = parser.parse_args()
    try:
        text = table([*iec104_rows(), mqtt_row(), http_row()])
    except (GatewayError, OSError) as error:
        print(f"the bench ended early: {error}", file=sys.stderr)
        return 1
    arguments.output.mkdir(parents=True, exist_ok=True)
    (arguments.output / "octets.txt").write_text(text + "\n")
    print(f"{text}\n\nAlso in {arguments.output}/octets.txt.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
