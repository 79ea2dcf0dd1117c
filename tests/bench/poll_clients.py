# SPDX-License-Identifier: GPL-3.0-or-later
"""For polls.py: rounds of polls by c104, asyncio or asyncio on uvloop, told as poll_rounds.c tells its own.

poll_clients.py c104|asyncio|uvloop turn|together COUNT ROUNDS WAIT_MS PORT
"""

from __future__ import annotations

import asyncio
import resource
import struct
import sys
import time

import c104
import uvloop

STARTDT_ACT = bytes.fromhex("680407000000")
POLL = bytes.fromhex("660105000100010000")  # C_RD_NA_1, CA 1, IOA 1
POSITION = 201
ANSWER_S = 60.0
MISSED_MS = 200  # some of c104's reads have no answer though it came


def address(number: int) -> str:
    """As centre-rtus has it."""
    return f"127.1.{number // 250}.{1 + number % 250}"


def begin() -> None:
    print("ready", flush=True)
    sys.stdin.readline()


def end() -> None:
    used = resource.getrusage(resource.RUSAGE_SELF)
    print(round((used.ru_utime + used.ru_stime) * 1e6), file=sys.stderr)


class Station:
    """Of asyncio."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.reader, self.writer = reader, writer
        self.ns = self.nr = 0

    async def frame(self) -> bytes:
        head = await self.reader.readexactly(2)
        return await self.reader.readexactly(head[1])

    async def poll(self) -> None:
        self.writer.write(struct.pack("<BBHH", 0x68, 4 + len(POLL), self.ns << 1, self.nr << 1) + POLL)
        self.ns = (self.ns + 1) % 0x8000
        while True:
            frame = await self.frame()
            self.nr = (self.nr + (not frame[0] & 1)) % 0x8000
            if frame[4] == POSITION:
                return


async def by_asyncio(together: bool, count: int, rounds: int, wait_s: float, port: int) -> None:
    stations = [Station(*await asyncio.open_connection(address(number), port)) for number in range(count)]
    for station in stations:
        station.writer.write(STARTDT_ACT)
        await station.frame()
    begin()
    for _ in range(rounds):
        begun = time.monotonic_ns()
        if together:
            await asyncio.gather(*(station.poll() for station in stations))
        else:
            for station in stations:
                await station.poll()
        print(time.monotonic_ns() - begun)
        await asyncio.sleep(wait_s)
    end()
    for station in stations:
        station.writer.close()


def by_c104(count: int, rounds: int, wait_s: float, port: int) -> None:
    """In turn: its read waits for the answer."""
    client = c104.Client(command_timeout_ms=MISSED_MS)
    points = []
    for number in range(count):
        connection = client.add_connection(ip=address(number), port=port, init=c104.Init.NONE)
        station = connection.add_station(common_address=1)
        points.append(station.add_point(io_address=1, type=c104.Type.M_ME_NC_1))
    client.start()
    deadline = time.monotonic() + ANSWER_S
    while not all(connection.is_connected and not connection.is_muted for connection in client.connections):
        if time.monotonic() > deadline:
            raise SystemExit("c104 does not start data transfer with all stations")
        time.sleep(0.05)
    begin()
    missed = 0
    for _ in range(rounds):
        begun = time.monotonic_ns()
        missed += sum(not point.read() for point in points)
        print(time.monotonic_ns() - begun, flush=True)
        time.sleep(wait_s)
    if missed > rounds * count / 20:
        raise SystemExit(f"{missed} reads of c104 had no answer")
    end()
    client.stop()


def main() -> None:
    who, mode, count, rounds, wait_ms, port = sys.argv[1:]
    amounts = int(count), int(rounds), int(wait_ms) / 1000, int(port)
    if who == "c104":
        by_c104(*amounts)
    else:
        run = uvloop.run if who == "uvloop" else asyncio.run
        run(by_asyncio(mode == "together", *amounts))


main()
