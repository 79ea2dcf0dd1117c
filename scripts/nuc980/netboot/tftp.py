# SPDX-License-Identifier: GPL-3.0-or-later
"""The TFTP server of one board's files. (First cut: the hardened one replaces it.)"""

from __future__ import annotations

import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import IO, Self

import tftpy


class Transfer:
    def __init__(self, name: str, size: int) -> None:
        self.name, self.size, self.moved, self.finished = name, size, 0, False


class FileService:
    def __init__(self, address: str, port: int, board: str) -> None:
        self._server = tftpy.TftpServer("/var/empty", dyn_file_func=self._open, upload_open=lambda p, c: None)
        self._address, self.port, self.board = address, port, board
        self._offers: dict[str, bytes] = {}
        self.refused: list[tuple[str, str, str]] = []

    def _open(self, name: str, raddress: str, rport: int) -> IO[bytes] | None:
        if name not in self._offers:
            return None
        file = tempfile.NamedTemporaryFile()  # noqa: SIM115
        file.write(self._offers[name])
        file.seek(0)
        return file

    def __enter__(self) -> Self:
        self._thread = threading.Thread(
            target=self._server.listen, args=(self._address, self.port), kwargs={"timeout": 1}, daemon=True
        )
        self._thread.start()
        self._server.is_running.wait(5)
        self.port = self._server.listenport
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._server.stop(now=True)
        self._thread.join()

    @contextmanager
    def offer(self, name: str, source: Path, start: int = 0, size: int | None = None) -> Iterator[Transfer]:
        content = source.read_bytes()[start:]
        self._offers[name] = content[: len(content) if size is None else size]
        yield Transfer(name, len(self._offers[name]))
        del self._offers[name]
