# SPDX-License-Identifier: GPL-3.0-or-later
"""Debian's gpsd, from its unpacked package, with receivers on ptys."""

import contextlib
import os
import pty
import socket
import subprocess
import time
import tty
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from lab.gateway import free_port
from lab.patience import Deadline


@dataclass
class Daemon:
    port: int  # of its clients, at 127.0.0.1
    receivers: list[int]  # what is written there is said to gpsd by a receiver
    devices: list[str]  # their names
    process: subprocess.Popen[bytes]


@contextlib.contextmanager
def gpsd_daemon(gpsd: Path, receivers: int = 1) -> Iterator[Daemon]:
    """It runs, and takes clients. `gpsd` is the folder of `build/gpsd/done`."""
    packages = gpsd / "packages"
    libraries = {str(file.parent) for file in packages.rglob("lib*.so.*")}
    lines = [pty.openpty() for _ in range(receivers)]
    for _, side in lines:
        tty.setraw(side)
    devices = [os.ttyname(side) for _, side in lines]
    port = free_port()
    command = [packages / "usr/sbin/gpsd", "-N", "-n", "-b", "-s", "38400", "-S", str(port), *devices]
    environment = {**os.environ, "LD_LIBRARY_PATH": ":".join(sorted(libraries))}
    process = subprocess.Popen(command, env=environment, stderr=subprocess.DEVNULL)
    try:
        wait_for_clients(process, port)
        yield Daemon(port, [receiver for receiver, _ in lines], devices, process)
    finally:
        process.terminate()
        process.wait()
        for end in (end for line in lines for end in line):
            os.close(end)


def wait_for_clients(process: subprocess.Popen[bytes], port: int) -> None:
    deadline = Deadline(30)
    while True:
        try:
            socket.create_connection(("127.0.0.1", port)).close()
            return
        except OSError:
            assert process.poll() is None, "gpsd ended"
            assert not deadline.over, "gpsd takes no client"
            time.sleep(0.05)
