# SPDX-License-Identifier: GPL-3.0-or-later
"""Files by processes of their own: what is in them, who waits, who leaves, what fails."""

import asyncio
import contextlib
import csv
import io
import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from openrtu_tools.centre import makers
from openrtu_tools.centre.database import open_store
from openrtu_tools.centre.errors import RefusedError, StoreError
from openrtu_tools.centre.exports import POINTS_MOST
from openrtu_tools.centre.makers import Makers
from openrtu_tools.centre.store import EventRow
from postgres import Server

S = 10**9
DAY = 86400 * S
ROWS = 5000  # more than are read at once


@pytest.fixture
def database(server: Server | None, tmp_path: Path) -> Iterator[Path | str]:
    """Two points that change by turns, every 10 s."""
    where = server.new_database() if server else tmp_path / "centre.db"
    with contextlib.closing(open_store(where, alone=True)) as store:
        store.transaction(lambda database: database.insert("stations", ["name"], [("north",)]))
        points = [(1, 1, ioa) for ioa in (1, 2)]
        store.transaction(lambda database: database.insert("points", ["station", "ca", "ioa"], points))
        rows = [EventRow(1 + n % 2, 10 * n * S, n / 2, 0, 10 * n * S, 3, 1) for n in range(ROWS)]
        store.transaction(lambda database: database.insert("history", EventRow._fields, rows))
    yield where


def events(names: dict[int, tuple[str, str]]) -> dict[str, Any]:
    return {"what": "events", "names": names, "begin": 0, "end": DAY}


async def made(files: Makers, order: dict[str, Any]) -> list[dict[str, str]]:
    async with files.make(order) as pieces:
        text = b"".join([piece async for piece in pieces]).decode()
    return list(csv.DictReader(io.StringIO(text)))


def with_makers(database: Path | str, work: Any) -> Any:
    async def whole() -> Any:
        files = Makers(database)
        try:
            return await work(files)
        finally:
            await files.close()

    return asyncio.run(whole())


@pytest.mark.parametrize("others", [0, POINTS_MOST])
def test_file_has_the_points_that_are_asked_for_in_order(database: Path | str, others: int) -> None:
    """However few they are, and whichever way they are looked for."""
    names = {1: ("north", "pump"), **{1000 + n: ("far", "x") for n in range(others)}}
    rows = with_makers(database, lambda files: made(files, events(names)))
    assert len(rows) == ROWS // 2
    assert {(row["station"], row["point"]) for row in rows} == {("north", "pump")}
    times = [row["time"] for row in rows]
    assert times == sorted(times) and times[1] == "1970-01-01T00:00:20.000Z"
    assert [float(row["value"]) for row in rows[:3]] == [0, 1, 2]


def test_files_wait_for_their_turn_and_too_many_are_refused(
    database: Path | str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(makers, "WAITING_MOST", 4)

    async def work(files: Makers) -> list[Any]:
        order = events({1: ("north", "pump")})
        asked = [made(files, order) for _ in range(makers.AT_ONCE + 6)]
        return list(await asyncio.gather(*asked, return_exceptions=True))

    answers = with_makers(database, work)
    refused = [each for each in answers if isinstance(each, RefusedError)]
    assert [each.status for each in refused] == [429, 429]
    assert [len(each) for each in answers if isinstance(each, list)] == [ROWS // 2] * (makers.AT_ONCE + 4)


def test_file_whose_process_was_killed_is_no_file(database: Path | str) -> None:
    """Half a file looks as if nothing more had happened."""

    async def work(files: Makers) -> None:
        await made(files, events({1: ("north", "pump")}))
        assert files._spare
        os.kill((await files._spare).pid, signal.SIGKILL)
        await made(files, events({1: ("north", "pump")}))

    with pytest.raises(StoreError):
        with_makers(database, work)


def test_who_leaves_ends_the_process(database: Path | str) -> None:
    async def work(files: Makers) -> int | None:
        await made(files, events({1: ("north", "pump")}))
        assert files._spare
        process = await files._spare
        async with files.make(events({1: ("north", "pump")})) as pieces:
            async for _ in pieces:
                break
        return process.returncode

    assert with_makers(database, work) is not None


def test_database_that_is_gone_is_named(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="folder"):
        with_makers(tmp_path / "no" / "centre.db", lambda files: made(files, events({1: ("a", "b")})))
