# SPDX-License-Identifier: GPL-3.0-or-later
"""What of a world is no program of ours: the consumer of rtu-centre, and what changes in the field.

They run in the plant, under its clock, and import nothing but the standard library.
"""

import contextlib
import json
import os
import random
import select
import shutil
import signal
import socket
import struct
import sys
import time
from pathlib import Path

HEADER = struct.Struct("<4sHHQ")  # docs/centre.md
RECORD_SIZE = 48
INFORMATION = struct.Struct("<BBHIIIqqBBBB4s8s")
KIND_LINK, KIND_INFORMATION, KIND_PROGRESS = 2, 3, 5
TAGGED, LAST_OCTET = 4, 36
PROGRESS = struct.Struct("<36xBB2xQ")
COMMAND = struct.Struct("<BBHIQIiBBb5x")
ASK_COMMAND, SCALED, ORDERED = 2, 5, 40001
ACKNOWLEDGE = struct.Struct("<BBHIQ16x")
PACKET_MAX = 65536
PAUSE_S = 0.1
RESTART_S = 1.0
HEARING_PART = 0.1
IN_FORCE_S = 30.0  # from SIGHUP on, or it is no more
WATCH_NS = 10**9


def say(**fields: object) -> None:
    """A line of this part's output; `at` is plant time."""
    print(json.dumps({"at": time.clock_gettime_ns(time.CLOCK_MONOTONIC), **fields}), flush=True)


def connected(kind: socket.SocketKind, path: Path) -> socket.socket:
    """Once somebody listens there."""
    while True:
        connection = socket.socket(socket.AF_UNIX, kind)
        try:
            connection.connect(str(path))
        except OSError:
            connection.close()
            time.sleep(PAUSE_S)
        else:
            return connection


def tell_record(record: bytes) -> None:
    if record[0] == KIND_LINK:
        say(kind="link", state=record[LAST_OCTET])
    if record[0] == KIND_PROGRESS:
        state, result, order = PROGRESS.unpack(record)
        if order:  # else it is rtu-centre's own
            say(kind="progress", order=order, state=state, result=result)
    if record[0] != KIND_INFORMATION:
        return
    fields = INFORMATION.unpack(record)
    _, flags, ca, _, connection, ioa, _, tag, type_, cause, quality, _, value, _ = fields
    say(
        kind="value",
        point=f"{ca}.{ioa}",
        connection=connection,
        tag=tag if flags & TAGGED else None,
        type=type_,
        cause=cause,
        quality=quality,
        value=int.from_bytes(value, "little", signed=True),
    )


class Orders:
    """What the control room commands, each at its time or never: lines of nanoseconds, address and value."""

    def __init__(self, path: Path) -> None:
        lines = path.read_text().splitlines() if path.exists() else []
        self.waiting = [tuple(map(int, line.split())) for line in lines]

    @property
    def wait_s(self) -> float | None:
        if not self.waiting:
            return None
        return max(0, self.waiting[0][0] - time.clock_gettime_ns(time.CLOCK_MONOTONIC)) / 1e9

    def give_due(self, centre: socket.socket) -> None:
        while self.wait_s == 0:
            _, ca, value = self.waiting.pop(0)
            say(kind="order", order=value)
            centre.send(COMMAND.pack(ASK_COMMAND, SCALED, ca, 0, value, ORDERED, value, 0, 0, 0))

    def miss_due(self) -> None:
        while self.wait_s == 0:
            self.waiting.pop(0)


def take_packet(centre: socket.socket) -> bool:
    packet = centre.recv(PACKET_MAX)
    if not packet:
        return False
    _, _, count, sequence = HEADER.unpack_from(packet)
    for place in range(HEADER.size, HEADER.size + count * RECORD_SIZE, RECORD_SIZE):
        tell_record(packet[place : place + RECORD_SIZE])
    centre.send(ACKNOWLEDGE.pack(1, 0, 0, 0, sequence))
    return True


def serve(centre: socket.socket, orders: Orders) -> None:
    while True:
        readable, _, _ = select.select([centre], [], [], orders.wait_s)
        if readable and not take_packet(centre):
            return
        orders.give_due(centre)


def consume(path: Path, orders: Orders) -> None:
    """Takes and acknowledges what rtu-centre says, as often as there is one."""
    while True:
        with connected(socket.SOCK_SEQPACKET, path) as centre, contextlib.suppress(ConnectionError):
            orders.miss_due()
            serve(centre, orders)
        say(kind="centre is gone")


def writes(path: Path) -> None:
    """What masters write into the devices."""
    with connected(socket.SOCK_STREAM, path) as devices, devices.makefile() as lines:
        devices.sendall(b"trace writes\n")
        for line in lines:
            if line.startswith("{"):
                say(**json.loads(line))


def change(path: Path, script: Path) -> None:
    """Commands of linesim, each at its time: lines of nanoseconds of the plant and a command."""
    with connected(socket.SOCK_STREAM, path) as devices, devices.makefile() as answers:
        for line in script.read_text().splitlines():
            due, command = line.split(" ", 1)
            wait_ns = int(due) - time.clock_gettime_ns(time.CLOCK_MONOTONIC)
            time.sleep(max(0, wait_ns) / 1e9)
            devices.sendall(f"{command}\n".encode())
            say(command=command, answer=answers.readline().strip())


def watch(path: Path) -> None:
    """How many requests each device has answered, once a second."""
    due_ns = time.clock_gettime_ns(time.CLOCK_MONOTONIC)
    with connected(socket.SOCK_STREAM, path) as devices, devices.makefile() as answers:
        while True:
            devices.sendall(b"stats\n")
            lines = json.loads(answers.readline().removeprefix("ok "))
            counts = {
                f"{line}.{unit}": counted["answers"]
                for line, stats in lines.items()
                for unit, counted in stats["slaves"].items()
            }
            say(answers=counts)
            due_ns += WATCH_NS
            time.sleep(max(0, due_ns - time.clock_gettime_ns(time.CLOCK_MONOTONIC)) / 1e9)


def reload(map_: str, folder: Path, rtuctl: str) -> None:
    """Puts another configuration in the place of rtud's own and lets it be read, until it is in force."""
    for line in (folder / "reloads").read_text().splitlines():
        due, number, way = line.split()
        time.sleep(max(0, int(due) - time.clock_gettime_ns(time.CLOCK_MONOTONIC)) / 1e9)
        say(kind="asked", configuration=int(number))
        file = folder / "gateway.json"
        file.with_suffix(".new").write_text((folder / f"gateway-{number}.json").read_text())
        file.with_suffix(".new").rename(file)
        asks = [rtuctl, "--map", map_, "reload"] if way == "rtuctl" else None
        while code := ended_with(*asks) if asks else signalled(folder):
            say(kind="refused", code=code)
            time.sleep(RESTART_S)
        say(kind="in force", configuration=int(number))


def signalled(folder: Path) -> int:
    """Nobody is told but the log; 0: the configuration is in force, maybe since rtud has begun anew."""
    log, process = folder / "gateway.log", int((folder / "gateway.pid").read_text())
    begun = log.stat().st_size
    with contextlib.suppress(ProcessLookupError):
        os.kill(process, signal.SIGHUP)
    for _ in range(round(IN_FORCE_S / PAUSE_S)):
        time.sleep(PAUSE_S)
        lines = log.read_bytes()[begun:].decode(errors="replace").splitlines()
        if any(line.endswith(("is in force", "nothing changes")) or "; map in " in line for line in lines):
            return 0
        if any(
            line.endswith(("stays as it was", "is ignored: a configuration is being changed"))
            for line in lines
        ):
            return 1
    return 1


def ended_with(program: str, *arguments: str) -> int:
    pid = os.fork()
    if pid == 0:
        os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
        os.execve(program, [program, *arguments], os.environ)
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])


STARTDT = bytes((0x68, 4, 7, 0, 0, 0))
WORDS = (
    b"",
    STARTDT,
    STARTDT[:3],
    b"GET / HTTP/1.1\r\n\r\n",
    bytes(300),
    STARTDT + bytes((0x68, 14, 2, 0, 0, 0)),
)


def strangers(port: int, seed: int) -> None:
    """Who connects, says something, may hear something, and goes."""
    chance = random.Random(seed)
    while True:
        with socket.socket() as peer, contextlib.suppress(OSError):
            peer.settimeout(1.0)
            peer.connect(("127.0.0.1", port))
            peer.sendall(chance.choice(WORDS))
            if chance.random() < HEARING_PART:
                peer.recv(PACKET_MAX)
        time.sleep(chance.uniform(0.02, 0.3))


def keep(program: str, *arguments: str) -> None:
    """What the init system of a machine does: starts a program again when it has ended."""
    while True:
        pid = os.fork()
        if pid == 0:
            os.execve(program, [program, *arguments], os.environ)
        Path(arguments[-1]).with_suffix(".pid").write_text(f"{pid}")
        os.waitpid(pid, 0)
        time.sleep(RESTART_S)


def keep_machine(disk: Path, map_: Path, program: str, *arguments: str) -> None:
    """The same, of a machine that may lose its power: its memory is gone then, its disk as it was left."""
    sys.path.append(str(Path(__file__).parent))
    from plant_disk import restore_after_a_power_cut

    while True:
        pid = os.fork()
        if pid == 0:
            os.execve(program, [program, *arguments], os.environ)
        os.waitpid(pid, 0)
        if restore_after_a_power_cut(disk):
            shutil.rmtree(map_, ignore_errors=True)
            say(kind="power is back")
        time.sleep(RESTART_S)


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["consume", path, orders]:
            consume(Path(path), Orders(Path(orders)))
        case ["writes", path]:
            writes(Path(path))
        case ["change", path, script]:
            change(Path(path), Path(script))
        case ["watch", path]:
            watch(Path(path))
        case ["reload", map_, folder, rtuctl]:
            reload(map_, Path(folder), rtuctl)
        case ["strangers", port, seed]:
            strangers(int(port), int(seed))
        case ["keep-machine", disk, map_, *words]:
            keep_machine(Path(disk), Path(map_), *words)
        case ["keep", *words]:
            keep(*words)
