# SPDX-License-Identifier: GPL-3.0-or-later
"""The store in one file of SQLite: no server. A transaction is on the disk when it ends."""

from __future__ import annotations

import asyncio
import logging
import os
import sqlite3
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any

from openrtu_tools.centre.errors import CentreError, StoreError
from openrtu_tools.centre.store import READERS, Answer, Database, EventRow, Row, Store

log = logging.getLogger("centre")

BUSY_S = 30.0
CACHE_KIB = 16 * 1024

# What brings a file from each version to the next. Only ever add to its end.
MIGRATIONS = (
    """
    CREATE TABLE stations (
        id INTEGER PRIMARY KEY,
        name TEXT NOT NULL UNIQUE,
        link INTEGER NOT NULL DEFAULT 0,
        reason INTEGER NOT NULL DEFAULT 0,
        error INTEGER NOT NULL DEFAULT 0,
        since_ns INTEGER NOT NULL DEFAULT 0,
        heard_ns INTEGER NOT NULL DEFAULT 0,
        sessions INTEGER NOT NULL DEFAULT 0,
        records INTEGER NOT NULL DEFAULT 0
    );
    CREATE TABLE points (
        id INTEGER PRIMARY KEY,
        station INTEGER NOT NULL REFERENCES stations,
        ca INTEGER NOT NULL,
        ioa INTEGER NOT NULL,
        content INTEGER,
        value REAL,
        quality INTEGER NOT NULL DEFAULT 0,
        cause INTEGER NOT NULL DEFAULT 0,
        at_ns INTEGER NOT NULL DEFAULT 0,
        received_ns INTEGER NOT NULL DEFAULT 0,
        tagged INTEGER NOT NULL DEFAULT 0,
        latitude INTEGER, longitude INTEGER, altitude INTEGER, detail INTEGER NOT NULL DEFAULT 0,
        UNIQUE (station, ca, ioa)
    );
    CREATE TABLE history (
        id INTEGER PRIMARY KEY,
        point INTEGER NOT NULL REFERENCES points,
        at_ns INTEGER NOT NULL,
        received_ns INTEGER NOT NULL,
        value REAL NOT NULL,
        quality INTEGER NOT NULL,
        cause INTEGER NOT NULL,
        tagged INTEGER NOT NULL
    );
    -- A station sends again what it knows not to be acknowledged; the time tag tells that it is the same.
    CREATE UNIQUE INDEX history_once ON history (point, at_ns, value, quality) WHERE tagged;
    CREATE INDEX history_point ON history (point, at_ns);
    CREATE INDEX history_at ON history (at_ns);
    CREATE TABLE track (
        point INTEGER NOT NULL REFERENCES points,
        at_ns INTEGER NOT NULL,
        latitude INTEGER NOT NULL, longitude INTEGER NOT NULL, altitude INTEGER NOT NULL,
        quality INTEGER NOT NULL, detail INTEGER NOT NULL,
        PRIMARY KEY (point, at_ns)
    ) WITHOUT ROWID;
    CREATE TABLE alarms (
        id INTEGER PRIMARY KEY,
        kind TEXT NOT NULL,
        station INTEGER NOT NULL REFERENCES stations,
        point INTEGER REFERENCES points,
        ca INTEGER,
        priority INTEGER NOT NULL,
        value REAL,
        since_ns INTEGER NOT NULL,
        gone_ns INTEGER,
        acknowledged_ns INTEGER,
        acknowledged_by TEXT,
        shelved_until_ns INTEGER NOT NULL DEFAULT 0
    );
    CREATE INDEX alarms_open ON alarms (id) WHERE gone_ns IS NULL OR acknowledged_ns IS NULL;
    CREATE TABLE commands (
        id INTEGER PRIMARY KEY AUTOINCREMENT,
        user TEXT NOT NULL,
        point INTEGER NOT NULL REFERENCES points,
        value REAL NOT NULL,
        selects INTEGER NOT NULL,
        state INTEGER NOT NULL,
        result INTEGER NOT NULL DEFAULT 0,
        cause INTEGER NOT NULL DEFAULT 0,
        begun_ns INTEGER NOT NULL,
        changed_ns INTEGER NOT NULL
    );
    CREATE TABLE users (
        name TEXT PRIMARY KEY,
        role TEXT NOT NULL CHECK (role IN ('viewer', 'operator', 'engineer')),
        salt BLOB NOT NULL,
        hash BLOB NOT NULL
    ) WITHOUT ROWID;
    -- Of a browser and of a program (label): what is stored is a hash of the secret.
    CREATE TABLE sessions (
        hash BLOB PRIMARY KEY,
        user TEXT NOT NULL REFERENCES users ON DELETE CASCADE,
        csrf TEXT NOT NULL,
        label TEXT NOT NULL,
        expires_s INTEGER NOT NULL
    ) WITHOUT ROWID;
    CREATE TABLE audit (
        id INTEGER PRIMARY KEY,
        at_ns INTEGER NOT NULL,
        user TEXT NOT NULL,
        action TEXT NOT NULL,
        detail TEXT NOT NULL
    );
    """,
    """
    ALTER TABLE alarms ADD COLUMN area TEXT;
    ALTER TABLE users ADD COLUMN groups TEXT NOT NULL DEFAULT ''; -- of stations, one a line; none: all
    CREATE TABLE thinned (point INTEGER PRIMARY KEY REFERENCES points, until_ns INTEGER NOT NULL);
    """,
    "ALTER TABLE commands ADD COLUMN release INTEGER NOT NULL DEFAULT 0;",
    """
    ALTER TABLE audit ADD COLUMN station INTEGER REFERENCES stations;
    ALTER TABLE users ADD COLUMN disabled INTEGER NOT NULL DEFAULT 0;
    """,
    """
    ALTER TABLE points ADD COLUMN placed_ns INTEGER NOT NULL DEFAULT 0;
    UPDATE points SET latitude = NULL, longitude = NULL, altitude = NULL
        WHERE quality >= 128 AND latitude = 0 AND longitude = 0; -- of a receiver that had lost its place
    UPDATE points SET placed_ns = at_ns WHERE latitude IS NOT NULL;
    ALTER TABLE history ADD COLUMN tag_ns INTEGER;
    -- By which an event is known that comes again, though its clock is not believed.
    CREATE TABLE odd_tags (
        point INTEGER NOT NULL REFERENCES points,
        tag_ns INTEGER NOT NULL,
        value REAL NOT NULL,
        quality INTEGER NOT NULL,
        received_ns INTEGER NOT NULL,
        PRIMARY KEY (point, tag_ns, value, quality)
    ) WITHOUT ROWID;
    """,
    """
    -- What a token may at most; the tokens of before may what their users may.
    ALTER TABLE sessions ADD COLUMN scope TEXT NOT NULL DEFAULT 'engineer';
    ALTER TABLE sessions ADD COLUMN begun_s INTEGER NOT NULL DEFAULT 0;
    ALTER TABLE sessions ADD COLUMN seen_s INTEGER NOT NULL DEFAULT 0;
    ALTER TABLE sessions ADD COLUMN address TEXT NOT NULL DEFAULT '';
    """,
    """
    ALTER TABLE users ADD COLUMN totp TEXT NOT NULL DEFAULT ''; -- the secret; empty: no second factor
    ALTER TABLE users ADD COLUMN totp_step INTEGER NOT NULL DEFAULT 0; -- of the last code that was used
    ALTER TABLE users ADD COLUMN recovery TEXT NOT NULL DEFAULT ''; -- hashes of codes, one a line
    """,
    """
    ALTER TABLE alarms ADD COLUMN returns INTEGER NOT NULL DEFAULT 0;
    ALTER TABLE alarms ADD COLUMN last_ns INTEGER NOT NULL DEFAULT 0;
    UPDATE alarms SET last_ns = since_ns;
    ALTER TABLE alarms ADD COLUMN shelved_why TEXT NOT NULL DEFAULT '';
    """,
    """
    ALTER TABLE users ADD COLUMN subject TEXT NOT NULL DEFAULT ''; -- of a provider's user
    CREATE UNIQUE INDEX users_subject ON users (subject) WHERE subject <> '';
    ALTER TABLE sessions ADD COLUMN sid TEXT NOT NULL DEFAULT ''; -- the provider's session
    """,
    """
    -- What the history was in slots of time; and of which slots that is not known yet (rollup.py).
    CREATE TABLE rollup (
        point INTEGER NOT NULL,
        shift INTEGER NOT NULL,
        slot INTEGER NOT NULL,
        low REAL, high REAL,
        number INTEGER NOT NULL,
        quality INTEGER NOT NULL,
        last_value REAL NOT NULL, last_quality INTEGER NOT NULL,
        PRIMARY KEY (point, shift, slot)
    ) WITHOUT ROWID;
    CREATE TABLE unrolled (
        point INTEGER NOT NULL, slot INTEGER NOT NULL,
        PRIMARY KEY (point, slot)
    ) WITHOUT ROWID;
    CREATE INDEX unrolled_slot ON unrolled (slot);
    INSERT INTO unrolled SELECT DISTINCT point, at_ns >> 44 FROM history;
    """,
    """
    ALTER TABLE alarms ADD COLUMN suppressed_by INTEGER;
    CREATE INDEX alarms_members ON alarms (suppressed_by) WHERE suppressed_by IS NOT NULL;
    -- Each time that an alarm came; shown: neither suppressed nor shelved.
    CREATE TABLE comings (alarm INTEGER NOT NULL, at_ns INTEGER NOT NULL, shown INTEGER NOT NULL);
    CREATE INDEX comings_at ON comings (at_ns);
    CREATE INDEX comings_alarm ON comings (alarm);
    -- What has not lasted long enough yet to raise an alarm, or to end it.
    CREATE TABLE causes (
        kind TEXT NOT NULL,
        station INTEGER NOT NULL,
        place INTEGER NOT NULL,
        area TEXT NOT NULL,
        point INTEGER,
        ca INTEGER,
        priority INTEGER NOT NULL,
        value REAL,
        at_ns INTEGER NOT NULL,
        comes INTEGER NOT NULL,
        due_ns INTEGER NOT NULL,
        PRIMARY KEY (kind, station, place, area)
    ) WITHOUT ROWID;
    """,
    """
    -- Messages of alarms to targets; ended: taken by the target, or given up.
    CREATE TABLE outbox (
        id INTEGER PRIMARY KEY,
        uid TEXT NOT NULL,
        target TEXT NOT NULL,
        body TEXT NOT NULL,
        made_ns INTEGER NOT NULL,
        tries INTEGER NOT NULL DEFAULT 0,
        next_ns INTEGER NOT NULL,
        error TEXT NOT NULL DEFAULT '',
        ended_ns INTEGER,
        taken INTEGER NOT NULL DEFAULT 0
    );
    CREATE INDEX outbox_waiting ON outbox (target) WHERE ended_ns IS NULL;
    CREATE TABLE told (
        alarm INTEGER NOT NULL, target TEXT NOT NULL, PRIMARY KEY (alarm, target)
    ) WITHOUT ROWID;
    """,
    """
    -- Whether the target was told last that the alarm has gone.
    ALTER TABLE told ADD COLUMN gone INTEGER NOT NULL DEFAULT 0;
    """,
)


def _inserting(table: str, columns: Sequence[str]) -> str:
    places = ", ".join("?" * len(columns))
    return f"INSERT INTO {table} ({', '.join(columns)}) VALUES ({places}) ON CONFLICT DO NOTHING"


INSERT_EVENT = _inserting("history", EventRow._fields)


class Session(sqlite3.Connection):
    """No server is asked, so a statement for each row costs little."""

    def insert(self, table: str, columns: Sequence[str], rows: Sequence[Sequence[Any]]) -> None:
        self.executemany(_inserting(table, columns), rows)

    def insert_events(self, rows: Sequence[EventRow]) -> list[bool]:
        return [self.execute(INSERT_EVENT, row).rowcount == 1 for row in rows]

    def update(self, table: str, columns: Sequence[str], rows: Sequence[Sequence[Any]]) -> None:
        following = ", ".join(f"{column} = ?" for column in columns)
        self.executemany(f"UPDATE {table} SET {following} WHERE id = ?", rows)


class SqliteStore(Store):
    """An open file. Raises CentreError when it cannot be opened."""

    among = "IN (SELECT value FROM json_each(?))"
    wanted = "(SELECT value AS number FROM json_each(?)) AS wanted"

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.path = path
        self._readers = ThreadPoolExecutor(READERS, "store-reader")
        self._reading = threading.local()
        self._opened: list[Session] = []
        try:
            self._keep_private()
            self.database = self._connect()
            self.database.execute("PRAGMA journal_mode = WAL")
            self.database.execute("PRAGMA synchronous = FULL")  # what is acknowledged survives a power cut
            self._migrate()
        except (OSError, sqlite3.Error) as error:
            raise CentreError(
                f"{path}: {error}; is its folder there and writable, and no other centre at work on it?"
            ) from error

    def _keep_private(self) -> None:
        """Hashes of passwords are in it. SQLite gives the files beside it the same mode."""
        os.close(os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600))
        for path in (self.path, *(Path(f"{self.path}-{end}") for end in ("wal", "shm"))):
            with suppress(FileNotFoundError):
                if path.stat().st_mode & 0o077:
                    path.chmod(0o600)
                    log.warning("%s was for others to read: it is not any more", path)

    def _connect(self) -> Session:
        database = sqlite3.connect(
            self.path, timeout=BUSY_S, isolation_level=None, check_same_thread=False, factory=Session
        )
        database.row_factory = sqlite3.Row
        database.execute(f"PRAGMA cache_size = -{CACHE_KIB}")
        database.execute("PRAGMA foreign_keys = ON")
        self._opened.append(database)
        return database

    def _migrate(self) -> None:
        version = self.database.execute("PRAGMA user_version").fetchone()[0]
        if version > len(MIGRATIONS):
            raise CentreError(f"{self.path} is of a newer centre: start that one, or restore a backup")
        for number, script in enumerate(MIGRATIONS[version:], version + 1):
            self.database.executescript(f"BEGIN; {script}; PRAGMA user_version = {number}; COMMIT;")

    def close(self) -> None:
        super().close()
        self._readers.shutdown()
        for database in self._opened:
            database.close()

    def _transaction(self, work: Callable[[Database], Answer]) -> Answer:
        try:
            self.database.execute("BEGIN IMMEDIATE")
            try:
                answer = work(self.database)
                self.database.execute("COMMIT")
            except BaseException:
                if self.database.in_transaction:
                    self.database.execute("ROLLBACK")
                raise
        except sqlite3.Error as error:
            raise StoreError(str(error)) from error
        return answer

    async def read(self, sql: str, *values: Any) -> list[Row]:
        return await asyncio.get_running_loop().run_in_executor(self._readers, self._read, sql, values)

    def _read(self, sql: str, values: tuple[Any, ...]) -> list[Row]:
        try:
            if not hasattr(self._reading, "database"):
                self._reading.database = self._connect()
                self._reading.database.execute("PRAGMA query_only = ON")
            return [dict(row) for row in self._reading.database.execute(sql, values)]
        except sqlite3.Error as error:
            raise StoreError(str(error)) from error
