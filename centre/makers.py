# SPDX-License-Identifier: GPL-3.0-or-later
"""The processes that make files (exports.py): how many, who waits, and one that is started already."""

from __future__ import annotations

import asyncio
import json
import os
import sys
from asyncio.subprocess import PIPE, Process
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path

from openrtu_tools.centre.errors import RefusedError, StoreError
from openrtu_tools.centre.model import Json

AT_ONCE = 2  # files that are made
WAITING_MOST = 32
PIECE = 64 * 1024


class Makers:
    def __init__(self, database: Path | str) -> None:
        self.database = database
        self._turn = asyncio.Semaphore(AT_ONCE)
        self._asked = 0
        self._spare: asyncio.Task[Process] | None = None

    async def _start(self) -> Process:
        path = os.pathsep.join(filter(None, sys.path))  # of a clone, as ours is
        return await asyncio.create_subprocess_exec(
            sys.executable, "-m", "openrtu_tools.centre.exports",
            stdin=PIPE, stdout=PIPE, stderr=PIPE, env={**os.environ, "PYTHONPATH": path},
        )  # fmt: skip

    @asynccontextmanager
    async def make(self, order: Json) -> AsyncIterator[AsyncIterator[bytes]]:
        """The file's octets. Who leaves ends the process. Raises RefusedError when too many wait."""
        if self._asked >= AT_ONCE + WAITING_MOST:
            raise RefusedError(429, "files", "too many files are being made: ask again in a minute")
        self._asked += 1
        try:
            async with self._turn:
                spare, self._spare = self._spare, None
                process = await (spare or self._start())
                self._spare = asyncio.create_task(self._start())  # a start takes longer than many a file
                try:
                    yield self._octets(process, order)
                finally:
                    await _end(process)
        finally:
            self._asked -= 1

    async def _octets(self, process: Process, order: Json) -> AsyncIterator[bytes]:
        """Raises StoreError when it could not be made to its end."""
        assert process.stdin and process.stdout and process.stderr
        whole = {**order, "database": str(self.database), "is_file": isinstance(self.database, Path)}
        with suppress(ConnectionError):  # of one that has ended: it says why
            process.stdin.write(json.dumps(whole).encode() + b"\n")
            await process.stdin.drain()
            process.stdin.close()
        while piece := await process.stdout.read(PIECE):
            yield piece
        said = (await process.stderr.read()).decode(errors="replace").strip()
        if await process.wait():
            raise StoreError(said.rpartition("\n")[2] or "the process that makes the file was ended")

    async def close(self) -> None:
        if self._spare:
            await _end(await self._spare)


async def _end(process: Process) -> None:
    if process.returncode is None:
        with suppress(ProcessLookupError):
            process.kill()
        await process.wait()
