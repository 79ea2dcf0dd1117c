# SPDX-License-Identifier: GPL-3.0-or-later
"""The processes that make files (exports.py): how many, who waits, and what is made already.

A process writes into a file without a name, at its own pace: who reads slowly holds up nobody, and whoever is
cut off takes the rest later. Once the centre ends, however it ends, nothing of them is left.
"""

from __future__ import annotations

import asyncio
import json
import os
import secrets
import sys
import tempfile
import time
from asyncio.subprocess import PIPE, Process
from collections.abc import AsyncIterator, Hashable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import IO, NamedTuple
from weakref import WeakValueDictionary

from openrtu_tools.centre.errors import RefusedError, StoreError
from openrtu_tools.centre.model import NS_PER_MS, Json

AT_ONCE, OF_ONE = 2, 1  # files that are made; of one owner: a short one waits for no other's long ones
WAITING_MOST, WAITING_OF_ONE = 32, 16
PIECE = 64 * 1024
SHORT_S = 0.5  # so long a file is made before the process of the next one starts
GROWS_S = 0.05  # between looks at a file that is being made
ALONE_S = 60.0  # so long a file is still made that nobody reads
KEPT_S = 3600.0  # so long a whole one can be taken again
KEPT_OF_ONE, KEPT_MOST = 4, 64
ENDED = "the process that makes the file was ended"


class Maker(NamedTuple):
    process: Process
    file: IO[bytes]


@dataclass(eq=False)
class Made:
    """A file, whole or not yet."""

    owner: Hashable  # who may see it
    key: str  # what was asked
    name: str
    id: str = field(default_factory=lambda: secrets.token_hex(8))
    begun_ns: int = field(default_factory=time.time_ns)
    file: IO[bytes] | None = None
    part: float = 0.0  # of its time
    fault: str = ""
    readers: int = 0
    over: asyncio.Event = field(default_factory=asyncio.Event)  # whole, or nothing will come of it
    ending: asyncio.TimerHandle | None = None
    gone: bool = False

    @property
    def tag(self) -> str:
        return f'"{self.id}"'

    @property
    def size(self) -> int:
        return os.fstat(self.file.fileno()).st_size if self.file and not self.gone else 0

    @property
    def state(self) -> str:
        if self.over.is_set():
            return "failed" if self.fault else "whole"
        return "made" if self.file else "waits"

    async def grows(self) -> None:
        """A moment."""
        with suppress(TimeoutError):
            await asyncio.wait_for(self.over.wait(), GROWS_S)

    async def read(self, at: int, end: int | None = None) -> AsyncIterator[bytes]:
        """From there on, as it grows. Raises StoreError when it does not come to its end."""
        while end is None or at < end:
            is_over = self.over.is_set()
            if self.gone:
                raise StoreError("the file is not kept any more")
            size = PIECE if end is None else min(PIECE, end - at)
            piece = await asyncio.to_thread(os.pread, self.file.fileno(), size, at) if self.file else b""
            if piece:
                at += len(piece)
                yield piece
            elif is_over:
                break
            else:
                await self.grows()
        if self.fault:
            raise StoreError(self.fault)

    def view(self) -> Json:
        return {
            "id": self.id,
            "name": self.name,
            "state": self.state,
            "octets": self.size,
            "part": round(self.part, 3),
            "begun": self.begun_ns // NS_PER_MS,
            "fault": self.fault,
        }


class Makers:
    def __init__(self, database: Path | str) -> None:
        self._where = _line({"database": str(database), "is_file": isinstance(database, Path)})
        self.folder = database.parent if isinstance(database, Path) else None
        self.made: dict[str, Made] = {}
        self._turn = asyncio.Semaphore(AT_ONCE)
        self._turns: WeakValueDictionary[Hashable, asyncio.Semaphore] = WeakValueDictionary()  # of owners
        self._making: dict[Made, asyncio.Task[None]] = {}
        self._spares: list[asyncio.Task[Maker]] = []

    # ---- for who asks ------------------------------------------------------------------------

    def begin(self, order: Json, owner: Hashable, key: str, name: str) -> Made:
        """Raises RefusedError when too many wait."""
        own = sum(made.owner == owner for made in self._making)
        if own >= OF_ONE + WAITING_OF_ONE or len(self._making) >= AT_ONCE + WAITING_MOST:
            raise RefusedError(429, "files", "too many files are being made: ask again in a minute")
        made = Made(owner, key, name)
        self.made[made.id] = made
        self._making[made] = asyncio.create_task(self._make(made, order))
        self._making[made].add_done_callback(partial(self._is_over, made))
        self._leave_alone(made)
        self._let_go(owner)
        return made

    def find(self, owner: Hashable, key: str, tag: str | None = None) -> Made | None:
        """By its tag; without one, the only one of the key: of several nobody knows which is meant."""
        found = [made for made in self.of(owner) if made.key == key and tag in (None, made.tag)]
        return found[0] if len(found) == 1 and found[0].state != "failed" else None

    def of(self, owner: Hashable) -> list[Made]:
        return [made for made in self.made.values() if made.owner == owner]

    @contextmanager
    def reading(self, made: Made) -> Iterator[None]:
        """Meanwhile it is not ended. Whoever leaves has some time to come back, if it has begun."""
        made.readers += 1
        try:
            yield
        finally:
            made.readers -= 1
            if made.state == "waits" and not made.readers:
                self.end(made)
            else:
                self._leave_alone(made)

    def end(self, made: Made) -> None:
        """It is not wanted any more."""
        if making := self._making.get(made):
            making.cancel()
        self.made.pop(made.id, None)
        made.gone = True
        self._close(made)

    async def close(self) -> None:
        making = list(self._making.values())
        for made in list(self.made.values()):
            self.end(made)
        await asyncio.gather(*making, return_exceptions=True)
        for spare in self._spares:
            with suppress(StoreError):
                await _end(await spare)

    # ---- how long it is kept -----------------------------------------------------------------

    def _leave_alone(self, made: Made) -> None:
        """Whole or not, it has its time; who still reads then has more."""
        if made.ending:
            made.ending.cancel()
        if made.gone:
            self._close(made)
            return
        seconds = KEPT_S if made.over.is_set() else ALONE_S
        made.ending = asyncio.get_running_loop().call_later(seconds, self._time_is_over, made)

    def _time_is_over(self, made: Made) -> None:
        if made.readers and not made.over.is_set():
            self._leave_alone(made)
        else:
            self.end(made)

    def _let_go(self, owner: Hashable) -> None:
        """The oldest that nobody reads."""
        for all_, most in ((self.of(owner), KEPT_OF_ONE), (list(self.made.values()), KEPT_MOST)):
            old = [made for made in all_ if made.over.is_set() and not made.readers]
            for made in old[: max(0, len(all_) - most)]:
                self.end(made)

    @staticmethod
    def _close(made: Made) -> None:
        """Its number would be that of another file: who reads must have left."""
        if made.ending:
            made.ending.cancel()
        if made.file and not made.readers:
            made.file.close()

    # ---- making ------------------------------------------------------------------------------

    async def _start(self) -> Maker:
        path = os.pathsep.join(filter(None, sys.path))  # of a clone, as ours is
        try:
            file = tempfile.TemporaryFile(dir=self.folder)  # noqa: SIM115  # as long as it is kept
        except OSError as error:
            raise StoreError(f"{error}; is the folder there and writable?") from error
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "openrtu_tools.centre.exports",
            stdin=PIPE, stdout=file, stderr=PIPE, env={**os.environ, "PYTHONPATH": path},
        )  # fmt: skip
        assert process.stdin
        process.stdin.write(self._where)
        return Maker(process, file)

    def _start_spare(self) -> None:
        """To start takes longer than many a file does, and would take its processor."""
        if not self._spares:
            self._spares.append(asyncio.create_task(self._start()))

    async def _take(self) -> Maker:
        """One that is started already, if there is one."""
        starting = self._spares.pop() if self._spares else asyncio.create_task(self._start())
        try:
            return await asyncio.shield(starting)
        except asyncio.CancelledError:
            self._spares.append(starting)  # for the next one
            raise

    async def _make(self, made: Made, order: Json) -> None:
        own = self._turns.setdefault(made.owner, asyncio.Semaphore(OF_ONE))
        try:
            async with own, self._turn:
                maker = await self._take()
                made.file = maker.file
                next_one = asyncio.get_running_loop().call_later(SHORT_S, self._start_spare)
                try:
                    await self._watch(made, maker.process, order)
                finally:
                    next_one.cancel()
                    self._start_spare()
                    await _end(maker, keep=True)
        except StoreError as error:
            made.fault = str(error)

    def _is_over(self, made: Made, making: asyncio.Task[None]) -> None:
        """Whatever became of it: it may have ended before its first step."""
        if making.cancelled():
            made.fault = ENDED
        elif error := making.exception():
            made.fault = repr(error)
        del self._making[made]
        made.over.set()
        self._leave_alone(made)

    async def _watch(self, made: Made, process: Process, order: Json) -> None:
        """Raises StoreError when it could not be made to its end."""
        assert process.stdin and process.stderr
        with suppress(ConnectionError):  # of one that has ended: it says why
            process.stdin.write(_line(order))
            await process.stdin.drain()
            process.stdin.close()
        said = ""
        async for line in process.stderr:
            try:
                made.part = float(line)
            except ValueError:
                said = line.decode(errors="replace").strip() or said
        if await process.wait():
            raise StoreError(said or ENDED)
        made.part = 1.0


def _line(said: Json) -> bytes:
    return json.dumps(said).encode() + b"\n"


async def _end(maker: Maker, keep: bool = False) -> None:
    if maker.process.returncode is None:
        with suppress(ProcessLookupError):
            maker.process.kill()
        await maker.process.wait()
    if not keep:
        maker.file.close()
