# SPDX-License-Identifier: GPL-3.0-or-later
"""A host that takes each connection and hangs up, as one does that has no further connection to give."""

import contextlib
import socket
import threading
from collections.abc import Iterator


class HangsUp:
    def __init__(self, answer: bytes) -> None:
        self._answer = answer
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        self.connections = 0
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                connection, _ = self._listener.accept()
                self.connections += 1
                with connection, contextlib.suppress(OSError):
                    if self._answer and connection.recv(4096):
                        connection.sendall(self._answer)

    def end(self) -> None:
        self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self._thread.join()


@contextlib.contextmanager
def hangs_up(answer: bytes = b"") -> Iterator[HangsUp]:
    """answer: to what it is told first."""
    host = HangsUp(answer)
    try:
        yield host
    finally:
        host.end()
