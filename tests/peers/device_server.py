# SPDX-License-Identifier: GPL-3.0-or-later
"""A serial device server: it passes on what comes, between a connection and a line, and knows no protocol."""

import contextlib
import os
import select
import socket
import threading
from collections.abc import Iterator
from pathlib import Path

READ_SIZE = 4096


class DeviceServer:
    """It has one connection at a time: the next one takes its place, and what comes late for the first."""

    def __init__(self, device: Path) -> None:
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        self.connections = 0
        self._line = os.open(device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        self._stop, self._stopper = os.pipe()
        self._connection: socket.socket | None = None
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def hang_up(self) -> None:
        with self._lock:
            if self._connection is not None:
                self._connection.shutdown(socket.SHUT_RDWR)

    def end(self) -> None:
        os.close(self._stopper)
        self._thread.join()
        os.close(self._line)
        os.close(self._stop)

    def _serve(self) -> None:
        with self._listener:
            while True:
                sources: list[int | socket.socket] = [self._stop, self._listener, self._line]
                sources += [self._connection] if self._connection is not None else []
                ready, _, _ = select.select(sources, [], [])
                if self._stop in ready:
                    self._take(None)
                    return
                self._pass_on(ready)

    def _pass_on(self, ready: list[int | socket.socket]) -> None:
        with contextlib.suppress(OSError):
            if self._listener in ready:
                self._take(self._listener.accept()[0])
            elif self._line in ready:
                octets = os.read(self._line, READ_SIZE)
                if self._connection is not None:
                    self._connection.sendall(octets)
            elif self._connection is not None and self._connection in ready:
                if octets := self._connection.recv(READ_SIZE):
                    os.write(self._line, octets)
                else:
                    self._take(None)

    def _take(self, connection: socket.socket | None) -> None:
        with self._lock:
            if self._connection is not None:
                self._connection.close()
            self._connection = connection
        self.connections += connection is not None


@contextlib.contextmanager
def device_server(device: Path) -> Iterator[DeviceServer]:
    server = DeviceServer(device)
    try:
        yield server
    finally:
        server.end()
