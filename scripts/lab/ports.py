# SPDX-License-Identifier: GPL-3.0-or-later
"""Who listens on a TCP port of this machine, as /proc has it."""

from __future__ import annotations

import errno
import socket
from collections.abc import Iterable
from pathlib import Path

from lab.errors import LabError

LOOPBACK = "127.0.0.1"
STATION = 2404  # IEC 60870-5-104
LISTEN = "0A"
PROC = Path("/proc")

Place = tuple[str, int]  # IPv4 address and TCP port


class PortError(LabError):
    """The TCP port is not the show's to have."""


def check_free(port: int, command: str) -> None:
    """Raises PortError when 127.0.0.1 has somebody at this port already. Nothing is sent to them."""
    try:
        with socket.create_server((LOOPBACK, port)):
            return
    except OSError as error:
        expected = f"TCP port {port} of {LOOPBACK} free for the controlled station"
        other = f"type: {command} PORT={another_port()}"
        if error.errno == errno.EADDRINUSE:
            taken = f"{holders((LOOPBACK, port)) or 'another program'} listens there"
            raise PortError(
                f"TCP port {port}: {taken}",
                expected=expected,
                seen=taken,
                advice=f"another show or station is up: end it, or {other}",
            ) from None
        raise PortError(
            f"TCP port {port}: {error.strerror}",
            expected=expected,
            seen=error.strerror or str(error),
            advice=f"this user may not use that port; {other}",
        ) from None


def another_port() -> int:
    """The first one behind the station's usual one that nobody listens on."""
    return next(port for port in range(STATION + 1, 65536) if not sockets_at((LOOPBACK, port)))


def is_listened_on_by(place: Place, pids: Iterable[int]) -> bool:
    """Whether every socket that a connection to this place may reach is one of these processes'."""
    sockets = sockets_at(place)
    return bool(sockets) and sockets <= {inode for pid in pids for inode in sockets_of(pid)}


def holders(place: Place) -> str:
    """The processes that listen at this place, as "rtud (pid 17)", as far as this user may know."""
    sockets = sockets_at(place)
    pids = sorted(int(folder.name) for folder in PROC.iterdir() if folder.name.isdigit())
    return ", ".join(f"{program(pid)} (pid {pid})" for pid in pids if sockets & sockets_of(pid))


def sockets_at(place: Place) -> set[int]:
    """The inodes of the sockets that listen at this place, or at its port of all addresses."""
    address, port = place
    own = socket.inet_aton(address)[::-1].hex().upper()  # as /proc has it on a little-endian machine
    listening = {f"{each}:{port:04X}" for each in (own, "0" * 8, "0" * 16 + "FFFF0000" + own, "0" * 32)}
    tables = (PROC / "net" / name for name in ("tcp", "tcp6"))
    rows = [row.split() for table in tables if table.exists() for row in table.read_text().splitlines()]
    return {int(row[9]) for row in rows if row[3] == LISTEN and row[1] in listening}


def sockets_of(pid: int) -> set[int]:
    """The inodes of a process's sockets; none when it has gone, or is another user's."""
    found = set()
    try:
        for link in (PROC / str(pid) / "fd").iterdir():
            target = str(link.readlink())
            if target.startswith("socket:["):
                found.add(int(target[8:-1]))
    except OSError:
        pass
    return found


def program(pid: int) -> str:
    """The name of a process's program."""
    try:
        return (PROC / str(pid) / "comm").read_text().strip()
    except OSError:
        return "a process"
