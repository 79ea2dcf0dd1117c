# SPDX-License-Identifier: GPL-3.0-or-later
"""The database: a file of SQLite, or a server of PostgreSQL. One thread writes; no reader waits for it."""

from __future__ import annotations

import asyncio
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple, Protocol, TypeVar

Answer = TypeVar("Answer")
Row = dict[str, Any]

READERS = 2
INTEGER_MOST = 2**63 - 1  # of a column


class EventRow(NamedTuple):
    """A row of history. The first four say which event it is, if it has a time tag."""

    point: int
    at_ns: int
    value: float
    quality: int
    received_ns: int
    cause: int
    tagged: int
    tag_ns: int | None = None  # that was not believed: at_ns is when it came


class Answered(Protocol):
    """What a statement has answered: sqlite3's cursor, as far as both stores have it."""

    @property
    def rowcount(self) -> int: ...

    def fetchone(self) -> Any: ...

    def __iter__(self) -> Iterator[Any]: ...


class Database(Protocol):
    """A transaction under way, in SQL that both understand. A row is read by place and by name.

    Values stand as `?`; a word that is PostgreSQL's own, as "user", is quoted.
    """

    def execute(self, sql: str, parameters: Sequence[Any] = ..., /) -> Answered: ...

    def executemany(self, sql: str, parameters: Iterable[Sequence[Any]], /) -> Any: ...

    def insert(self, table: str, columns: Sequence[str], rows: Sequence[Sequence[Any]], /) -> None:
        """All at once; a row that is there already is left out."""

    def insert_events(self, rows: Sequence[EventRow], /) -> list[bool]:
        """All at once; of each, whether it was not there already."""

    def update(self, table: str, columns: Sequence[str], rows: Sequence[Sequence[Any]], /) -> None:
        """All at once, each by its id, which stands behind the columns."""


class Reader(ABC):
    """An open database. What goes wrong with it is a StoreError, and can be tried again."""

    among = ""  # a condition: one of the list of numbers that is given as JSON
    wanted = ""  # a table of these numbers, as `wanted.number`

    @abstractmethod
    async def read(self, sql: str, *values: Any) -> list[Row]:
        """The rows, as they were last stored."""

    @abstractmethod
    def close(self) -> None:
        """Ends what is under way and closes the database."""


class Store(Reader):
    """One that is written, too."""

    # Lets go of what is older in a table that is kept by weeks; None: its rows are deleted.
    drop_weeks: Callable[[Database, str, int], None] | None = None

    def __init__(self) -> None:
        self._here = threading.local()  # is the writer's thread
        self._writer = ThreadPoolExecutor(1, "store-writer", lambda: setattr(self._here, "writes", True))

    @abstractmethod
    def _transaction(self, work: Callable[[Database], Answer]) -> Answer:
        """In the writer's thread."""

    def close(self) -> None:
        self._writer.shutdown()

    def transaction(self, work: Callable[[Database], Answer]) -> Answer:
        """From any thread, which waits: work, and it is on the disk; or an exception, and nothing is."""
        if getattr(self._here, "writes", False):
            return self._transaction(work)
        return self._writer.submit(self._transaction, work).result()

    async def write(self, work: Callable[[Database], Answer]) -> Answer:
        """A transaction in the writer's thread."""
        return await self.in_writer(lambda: self._transaction(work))

    async def in_writer(self, work: Callable[[], Answer]) -> Answer:
        """What belongs to the writer's thread; one after the other."""
        return await asyncio.get_running_loop().run_in_executor(self._writer, work)


def inserted(database: Database, sql: str, values: Sequence[Any]) -> int:
    """Executes an INSERT; the row's id."""
    [(id_,)] = list(database.execute(f"{sql} RETURNING id", values))
    return int(id_)


def put(
    database: Database, table: str, columns: Sequence[str], values: Sequence[Any], key: str = "id"
) -> None:
    """The whole row, whether it is there or not."""
    names = [f'"{column}"' for column in columns]
    following = ", ".join(f"{name} = excluded.{name}" for name in names)
    database.execute(
        f"INSERT INTO {table} ({', '.join(names)}) VALUES ({', '.join('?' * len(names))})"
        f" ON CONFLICT ({key}) DO UPDATE SET {following}",
        values,
    )


def audit(
    database: Database, at_ns: int, user: str, action: str, detail: str = "", station: int | None = None
) -> None:
    """Who did what, and to which station. It is part of the transaction that does it."""
    database.execute(
        'INSERT INTO audit (at_ns, "user", action, detail, station) VALUES (?, ?, ?, ?, ?)',
        (at_ns, user, action, detail, station),
    )
