# SPDX-License-Identifier: GPL-3.0-or-later
"""Debian's gpsd, from its unpacked package, with a receiver on a pty."""

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
    receiver: int  # what is written here is said to gpsd by a receiver
    process: subprocess.Popen[bytes]


@contextlib.contextmanager
def gpsd_daemon(gpsd: Path) -> Iterator[Daemon]:
    """It runs, and takes clients. `gpsd` is the folder of `build/gpsd/done`."""
    packages = gpsd / "packages"
    libraries = {str(file.parent) for file in packages.rglob("lib*.so.*")}
    receiver, side = pty.openpty()
    tty.setraw(side)
    port = free_port()
    command = [packages / "usr/sbin/gpsd", "-N", "-n", "-b", "-s", "38400", "-S", str(port), os.ttyname(side)]
    environment = {**os.environ, "LD_LIBRARY_PATH": ":".join(sorted(libraries))}
    process = subprocess.Popen(command, env=environment, stderr=subprocess.DEVNULL)
    try:
        wait_for_clients(process, port)
        yield Daemon(port, receiver, process)
    finally:
        process.terminate()
        process.wait()
        os.close(receiver)
        os.close(side)


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
