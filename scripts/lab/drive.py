# SPDX-License-Identifier: GPL-3.0-or-later
"""
A boat's GPS receiver on a line of the gateway, and `rtu-centre`, which polls its position.

What it says is recorded: two minutes of a chart plotter on the IJsselmeer. boat.nmea says by whom.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import re
import socket
import struct
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Self

from lab.errors import LabError
from lab.gateway import default_build
from lab.patience import Deadline

PORT, DEVICE, BAUD_RATE = 6, "ttyS8", 9600
CA, IOA = 9001, 200
RECEIVER = {
    "name": "boat",
    "device": DEVICE,
    "baud_rate": BAUD_RATE,
    "ca": CA,
    "position_ioa": IOA,
    "topical_s": 60,
}
FIXES = 3  # different ones, that the show waits for
ANSWER_S = 60.0
ROUNDED = 1.1e-7  # degree

RECORDING = Path(__file__).parent / "boat.nmea"
BURST = re.compile(rb"\$GPGGA,")  # each second's first line
PLACE = re.compile(rb"\$GPGGA,[\d.]*,(\d\d)([\d.]+),N,(\d{3})([\d.]+),E,")

# docs/centre.md: a packet's header, a record's begin, a position's end.
HEADER = struct.Struct("<4sHHQ")
PACKET_MAX = 65536
POSITION, QUALITY = 4, 34
ACKNOWLEDGE = struct.Struct("<B7xQ16x")


def instead_of_devices(config: dict[str, Any]) -> dict[str, Any]:
    """The configuration with the receiver on that line."""
    lines = [port for port in config["port"] if port["value"] != PORT]
    return config | {"port": lines, "gps": [RECEIVER]}


def bursts() -> list[bytes]:
    """What the receiver said, second by second."""
    lines = [line for line in RECORDING.read_bytes().splitlines(keepends=True) if line.startswith(b"$")]
    begins = [number for number, line in enumerate(lines) if BURST.match(line)]
    return [b"".join(lines[begin:end]) for begin, end in itertools.pairwise([*begins, len(lines)])]


def is_recorded(latitude: float, longitude: float) -> bool:
    """One of the recording's places, to 1e-7 degree."""
    for found in filter(None, map(PLACE.match, bursts())):
        north, minutes_north, east, minutes_east = map(float, found.groups())
        if (
            abs(north + minutes_north / 60 - latitude) < ROUNDED
            and abs(east + minutes_east / 60 - longitude) < ROUNDED
        ):
            return True
    return False


class Drive:
    """The receiver says each second what it said then."""

    def __init__(self, say: Callable[[bytes], None]) -> None:
        self.say = say
        self.bursts = bursts()
        self.ended = threading.Event()
        self.thread = threading.Thread(target=self._go)

    def __enter__(self) -> Self:
        self.thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.ended.set()
        self.thread.join()

    def _go(self) -> None:
        for burst in itertools.cycle(self.bursts):
            self.say(burst)
            if self.ended.wait(1.0):
                return


@contextlib.contextmanager
def _centre(directory: Path, address: tuple[str, int]) -> Iterator[socket.socket]:
    """The socket of its consumer."""
    reads = [{"common_address": CA, "ioa": IOA, "period_ms": 250}]
    host, port = address
    one = {"name": "boat", "address": host, "port": port, "common_addresses": [CA], "reads": reads}
    file, path = directory / "centre.json", directory / "consumer"
    file.write_text(json.dumps({"stations": [one | {"interrogate_at_start": False}]}))
    command = [default_build() / "centre" / "rtu-centre", "--socket", path, file]
    with subprocess.Popen(command, stderr=subprocess.DEVNULL) as process:
        try:
            with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as consumer:
                consumer.settimeout(ANSWER_S)
                deadline = Deadline(ANSWER_S)
                while consumer.connect_ex(str(path)) != 0:
                    if process.poll() is not None or deadline.over:
                        raise LabError("rtu-centre does not take its consumer", late=deadline.over)
                    time.sleep(0.05)
                yield consumer
        finally:
            process.terminate()


def _records(consumer: socket.socket) -> Iterator[bytes]:
    """Each acknowledged as soon as it came."""
    while packet := consumer.recv(PACKET_MAX):
        _, size, count, sequence = HEADER.unpack_from(packet)
        yield from (packet[at : at + size] for at in range(HEADER.size, HEADER.size + count * size, size))
        consumer.send(ACKNOWLEDGE.pack(1, sequence))


def polled(directory: Path, address: tuple[str, int]) -> Iterator[tuple[float, float, float]]:
    """Good positions, each another one: latitude, longitude, altitude in m."""
    last = None
    with _centre(directory, address) as consumer:
        for record in _records(consumer):
            if record[0] != POSITION or record[QUALITY]:
                continue  # the receiver has said nothing yet
            latitude, longitude, altitude = struct.unpack_from("<iii", record, 36)
            if (latitude, longitude) != last:
                last = latitude, longitude
                yield latitude / 1e7, longitude / 1e7, altitude / 10
    raise LabError("rtu-centre ended")
