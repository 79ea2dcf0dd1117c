# SPDX-License-Identifier: GPL-3.0-or-later
"""Which store it is."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from openrtu_tools.centre.sqlite import SqliteStore
from openrtu_tools.centre.store import Reader, Store


def open_store(where: Path | str, alone: bool) -> Store:
    """Of a file, or of the address of a server. `alone`: it is the centre's own, for as long as it runs."""
    if isinstance(where, Path):
        return SqliteStore(where)
    from openrtu_tools.centre.postgres import PostgresStore  # who has no server needs no asyncpg

    return PostgresStore(where, alone)


def reader(where: Path | str) -> Callable[[], Reader]:
    """Opens it for one who only reads. What that takes is loaded already."""
    if isinstance(where, Path):
        return partial(SqliteStore, where)
    from openrtu_tools.centre.postgres import PostgresReader

    return partial(PostgresReader, where)
