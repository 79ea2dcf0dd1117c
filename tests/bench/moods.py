# SPDX-License-Identifier: GPL-3.0-or-later
"""
`make bench`: for what part of the time the values of devices with moods are good: by the gateway, in its
first minute and in the next, and by the loops that people write with pymodbus and libmodbus.
What the rows mean: docs/bench.md. No time is asserted.
Exit codes: 0 done, 1 something did not work, 2 wrong usage or not built.
"""

from __future__ import annotations

import argparse
import contextlib
import ctypes
import logging
import os
import select
import socket
import struct
import sys
import threading
import time
import tty
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pymodbus.client import ModbusSerialClient, ModbusTcpClient
from pymodbus.exceptions import ModbusException
from pymodbus.framer import FramerRTU

from bench import heading
from lab.gateway import REPOSITORY, Gateway, GatewayError, free_port, listening_on, remove, run_directory

OURS, PYMODBUS, LIBMODBUS = "ours", "pymodbus", "libmodbus"
FULL_S, QUICK_S = 60.0, 3.0  # a part: the devices are learned in the first, and known in the second
SAMPLE_S = 0.1
PACE_S = 0.01  # between two requests of a loop: as often as the gateway asks
TIMEOUT_S = 0.5  # the gateway's own default
UNIT, COUNT = 1, 4
BAUD = 19200
READ_HOLDING = 3
HEADINGS = ("device", f"{OURS}, first minute", OURS, PYMODBUS, LIBMODBUS)


@dataclass(frozen=True)
class Mood:
    """What a device does beside answering; 0: it does not."""

    name: str
    period_s: float = 0.0  # it is read so often, 0: over and over
    idle_s: float = 0.0  # hangs up behind so much silence
    hangs_up: bool = False  # behind each answer
    hangs_after: int = 0  # answers of a connection
    hangs_once: bool = False  # the first connection alone
    pause_s: float = 0.0  # hears nothing so long behind its answer, or behind what it did not hear
    settle_s: float = 0.0  # does not answer so long behind a connect
    hangs_up_early: bool = False  # or hangs up then
    serial: bool = False
    before: int = 0  # zeros that its transceiver adds to an answer,
    behind: int = 0


MOODS = (
    Mood("none"),
    Mood("its session hangs once", hangs_after=300, hangs_once=True),
    Mood("hangs up when idle for 3 s, read each 10 s", period_s=10.0, idle_s=3.0),
    Mood("hangs up behind each answer", hangs_up=True),
    Mood("needs a pause of 300 ms", pause_s=0.3),
    Mood("needs a pause of 850 ms", pause_s=0.85),
    Mood("silent for 2 s behind a connect", settle_s=2.0),
    Mood("hangs up if asked within 2 s of a connect", settle_s=2.0, hangs_up_early=True),
    Mood("RTU, needs a pause of 20 ms", pause_s=0.02, serial=True),
    Mood("RTU, needs a pause of 50 ms", pause_s=0.05, serial=True),
    Mood("RTU, needs a pause of 100 ms", pause_s=0.1, serial=True),
    Mood("RTU, a zero before each answer", before=1, serial=True),
    Mood("RTU, three zeros behind each answer", behind=3, serial=True),
)


# ---- devices -------------------------------------------------------------------------------------------


def sealed(body: bytes) -> bytes:
    return body + FramerRTU.compute_CRC(body).to_bytes(2, "big")


class Device:
    """Answers reads of registers, as its mood wants it."""

    def __init__(self, mood: Mood) -> None:
        self.mood = mood
        self.connections = 0
        self._free = 0.0
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._serve)

    def __enter__(self) -> Device:
        self._begin()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

    def port(self, value: int) -> dict[str, Any]:
        """Its entry in the gateway's configuration."""
        registers = [{"address": address} for address in range(COUNT)]
        slave: dict[str, Any] = {"id": UNIT, "ca": value, "holding_registers": registers}
        if self.mood.period_s:
            slave["period_ms"] = round(1000 * self.mood.period_s)
        return {"value": value, "active": 1, **self._place(), "slaves": [slave]}

    def _begin(self) -> None: ...

    def _place(self) -> dict[str, Any]:
        raise NotImplementedError

    def _serve(self) -> None:
        raise NotImplementedError

    def _hears(self) -> bool:
        now = time.monotonic()
        heard = now >= self._free
        if not heard:
            self._free = now + self.mood.pause_s
        return heard

    def _answered(self) -> None:
        self._free = time.monotonic() + self.mood.pause_s


class TcpDevice(Device):
    def _begin(self) -> None:
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.address: tuple[str, int] = self.listener.getsockname()

    def _place(self) -> dict[str, Any]:
        return {"host": self.address[0], "tcp_port": self.address[1]}

    def _serve(self) -> None:
        with self.listener:
            while not self._stop.is_set():
                if not select.select([self.listener], [], [], 0.05)[0]:
                    continue
                connection, _ = self.listener.accept()
                self.connections += 1
                with connection, contextlib.suppress(OSError):
                    self._talk(connection)

    def _talk(self, connection: socket.socket) -> None:
        begun = last = time.monotonic()
        answers = 0
        mood = self.mood
        may_hang = not mood.hangs_once or self.connections == 1
        while not self._stop.is_set():
            if not select.select([connection, self.listener], [], [], 0.05)[0]:
                if mood.idle_s and time.monotonic() - last >= mood.idle_s:
                    return
                continue
            if not select.select([connection], [], [], 0)[0]:
                if may_hang and mood.hangs_after and answers >= mood.hangs_after:
                    return  # it hangs, and takes another connection
                time.sleep(0.001)
                continue
            frame = connection.recv(4096)
            if not frame:
                return
            last = time.monotonic()
            if last - begun < mood.settle_s:
                if mood.hangs_up_early:
                    return
                continue
            if (may_hang and mood.hangs_after and answers >= mood.hangs_after) or not self._hears():
                continue
            transaction, _, _, unit, function, _, count = struct.unpack(">HHHBBHH", frame[:12].ljust(12))
            if function == READ_HOLDING:
                head = struct.pack(">HHHBBB", transaction, 0, 3 + 2 * count, unit, function, 2 * count)
                connection.sendall(head + bytes(2 * count))
            else:
                connection.sendall(struct.pack(">HHHBBB", transaction, 0, 3, unit, function | 0x80, 1))
            answers += 1
            self._answered()
            if mood.hangs_up:
                return


class SerialDevice(Device):
    """On a pseudo-terminal, whose bytes take no time: its moods are the pause and what it adds."""

    def _begin(self) -> None:
        self.end, other = os.openpty()
        tty.setraw(other)
        self.path = os.ttyname(other)
        Path(self.path).chmod(0o666)  # the gateway's module is a user of its own
        self._other = other  # open, so that the pair outlives its reader

    def _place(self) -> dict[str, Any]:
        return {"device": self.path, "baud_rate": BAUD, "data_bits": 8, "stop_bits": 1, "parity": 0}

    def _serve(self) -> None:
        came = b""
        while not self._stop.is_set():
            if not select.select([self.end], [], [], 0.05)[0]:
                came = b""
                continue
            came += os.read(self.end, 256)
            if len(came) < 8:
                continue
            request, came = came[:8], b""
            if request != sealed(request[:6]) or not self._hears():
                continue
            count = int.from_bytes(request[4:6], "big")
            answer = bytes([UNIT, request[1], 2 * count]) + bytes(2 * count)
            os.write(self.end, bytes(self.mood.before) + sealed(answer) + bytes(self.mood.behind))
            self._answered()
        os.close(self.end)
        os.close(self._other)


def device_of(mood: Mood) -> Device:
    return SerialDevice(mood) if mood.serial else TcpDevice(mood)


# ---- loops ---------------------------------------------------------------------------------------------


class Loop:
    """Reads a device over and over; its values are good while the last read was answered."""

    def __init__(self, device: Device) -> None:
        self.device = device
        self.good = False
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def __enter__(self) -> Loop:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        read = self._reader()
        while not self._stop.is_set():
            self.good = read()
            self._stop.wait(self.device.mood.period_s or PACE_S)

    def _reader(self) -> Callable[[], bool]:
        raise NotImplementedError


class PymodbusLoop(Loop):
    def _reader(self) -> Callable[[], bool]:
        logging.getLogger("pymodbus").setLevel(logging.CRITICAL)  # what fails is what is measured
        client: ModbusTcpClient | ModbusSerialClient
        if isinstance(self.device, TcpDevice):
            host, port = self.device.address
            client = ModbusTcpClient(host, port=port, timeout=TIMEOUT_S, retries=1)
        else:
            assert isinstance(self.device, SerialDevice)
            client = ModbusSerialClient(self.device.path, baudrate=BAUD, timeout=TIMEOUT_S, retries=1)
        client.connect()

        def read() -> bool:
            try:
                return not client.read_holding_registers(0, count=COUNT, device_id=UNIT).isError()
            except (ModbusException, OSError):
                return False

        return read


class LibmodbusLoop(Loop):
    """With its own recovery of links and of the protocol."""

    def _reader(self) -> Callable[[], bool]:
        library = ctypes.CDLL("libmodbus.so.5", use_errno=True)
        library.modbus_new_tcp.restype = library.modbus_new_rtu.restype = ctypes.c_void_p
        library.modbus_new_tcp.argtypes = [ctypes.c_char_p, ctypes.c_int]
        library.modbus_new_rtu.argtypes = [
            ctypes.c_char_p,
            ctypes.c_int,
            ctypes.c_char,
            ctypes.c_int,
            ctypes.c_int,
        ]
        library.modbus_set_response_timeout.argtypes = [ctypes.c_void_p, ctypes.c_uint32, ctypes.c_uint32]
        library.modbus_set_error_recovery.argtypes = [ctypes.c_void_p, ctypes.c_int]
        library.modbus_set_slave.argtypes = [ctypes.c_void_p, ctypes.c_int]
        library.modbus_connect.argtypes = [ctypes.c_void_p]
        library.modbus_read_registers.argtypes = [
            ctypes.c_void_p,
            ctypes.c_int,
            ctypes.c_int,
            ctypes.c_void_p,
        ]
        if isinstance(self.device, TcpDevice):
            host, port = self.device.address
            context = library.modbus_new_tcp(host.encode(), port)
        else:
            assert isinstance(self.device, SerialDevice)
            context = library.modbus_new_rtu(self.device.path.encode(), BAUD, b"N", 8, 1)
        library.modbus_set_slave(context, UNIT)
        library.modbus_set_response_timeout(context, 0, round(TIMEOUT_S * 1e6))
        library.modbus_set_error_recovery(context, 2 | 4)
        library.modbus_connect(context)
        registers = (ctypes.c_uint16 * COUNT)()

        def read() -> bool:
            return bool(library.modbus_read_registers(context, 0, COUNT, registers) == COUNT)

        return read


# ---- measuring -----------------------------------------------------------------------------------------


def share(sample: Callable[[], Sequence[bool]], seconds: float) -> list[float]:
    """The part of the time in which each was good."""
    sums: list[int] = []
    taken, end = 0, time.monotonic() + seconds
    while time.monotonic() < end:
        found = sample()
        sums = [before + good for before, good in zip(sums or [0] * len(found), found, strict=True)]
        taken += 1
        time.sleep(SAMPLE_S)
    return [good / taken for good in sums]


@contextlib.contextmanager
def devices(moods: Sequence[Mood]) -> Iterator[list[Device]]:
    with contextlib.ExitStack() as stack:
        yield [stack.enter_context(device_of(mood)) for mood in moods]


def by_gateway(moods: Sequence[Mood], seconds: float) -> list[list[float]]:
    """In the first part, and in the second."""
    with contextlib.ExitStack() as stack:
        found = stack.enter_context(devices(moods))
        directory = run_directory()
        stack.callback(remove, directory)
        (directory / "dev").mkdir()
        ports = [device.port(7 + i) for i, device in enumerate(found)]
        config = listening_on({"modbus": {"heartbeat_limit_ms": 3000}, "port": ports}, free_port())
        gateway = stack.enter_context(Gateway(config, directory))

        def sample() -> list[bool]:
            points = gateway.points()
            return [
                all(
                    point["quality"] == "good"
                    for name, point in points.items()
                    if name.startswith(f"p{7 + i}.")
                )
                for i in range(len(moods))
            ]

        return [share(sample, seconds), share(sample, seconds)]


def by_loop(kind: type[Loop], moods: Sequence[Mood], seconds: float) -> list[float]:
    """Behind as much time as the gateway has had to learn."""
    with contextlib.ExitStack() as stack:
        loops = [stack.enter_context(kind(device)) for device in stack.enter_context(devices(moods))]
        time.sleep(seconds)
        return share(lambda: [loop.good for loop in loops], seconds)


def table(moods: Sequence[Mood], columns: Sequence[Sequence[float]]) -> str:
    rows = [
        HEADINGS,
        *(
            (mood.name, *(f"{100 * part:.1f} %" for part in parts))
            for mood, *parts in zip(moods, *columns, strict=True)
        ),
    ]
    widths = [max(len(row[i]) for row in rows) for i in range(len(HEADINGS))]
    lines = [
        "| " + " | ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) + " |"
        for row in rows
    ]
    lines.insert(1, "|" + "|".join("-" * (width + 2) for width in widths) + "|")
    return "\n".join(lines)


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="a first try, some seconds long")
    seconds = QUICK_S if parser.parse_args().quick else FULL_S
    try:
        head = heading()
        columns = [
            *by_gateway(MOODS, seconds),
            by_loop(PymodbusLoop, MOODS, seconds),
            by_loop(LibmodbusLoop, MOODS, seconds),
        ]
    except (GatewayError, OSError) as error:
        print(f"moods: {error}", file=sys.stderr)
        return 1
    text = f"{head}\n\n{table(MOODS, columns)}\n"
    (REPOSITORY / "build" / "moods.txt").write_text(text)
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
