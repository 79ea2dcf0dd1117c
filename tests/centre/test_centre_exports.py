# SPDX-License-Identifier: GPL-3.0-or-later
"""Files by processes of their own: what is in them, who waits, who leaves, what fails."""

import asyncio
import contextlib
import csv
import io
import json
import os
import resource
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from control_room import HANG_S
from openrtu_tools.centre import makers
from openrtu_tools.centre.database import open_store
from openrtu_tools.centre.errors import RefusedError, StoreError
from openrtu_tools.centre.exports import NICENESS, POINTS_MOST
from openrtu_tools.centre.makers import Made, Makers
from openrtu_tools.centre.store import EventRow
from postgres import Server

pytestmark = pytest.mark.slow

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
    return {"what": "events", "names": names, "cause": "", "begin": 0, "end": DAY}


async def made(files: Makers, order: dict[str, Any], owner: str = "vera") -> list[dict[str, str]]:
    new = files.begin(order, owner, "events", "events.csv")
    with files.reading(new):
        text = b"".join([piece async for piece in new.read(0)]).decode()
    assert new.state == "whole" and new.size == len(text.encode()) and new.part == 1
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


@pytest.fixture
def endless(monkeypatch: pytest.MonkeyPatch) -> None:
    """Vera's files are never whole."""
    watch = Makers._watch

    async def never(self: Makers, made: Made, *words: Any) -> None:
        if made.owner == "vera":
            await made.over.wait()
        await watch(self, made, *words)

    monkeypatch.setattr(Makers, "_watch", never)


@pytest.mark.usefixtures("endless")
def test_files_of_one_keep_nobody_else_waiting(tmp_path: Path) -> None:
    """However many, and however long they take. Who leaves before anything is made has asked for nothing."""
    database = tmp_path / "centre.db"
    with contextlib.closing(open_store(database, alone=True)):
        pass
    order = events({1: ("north", "pump")})

    async def work(files: Makers) -> None:
        most = makers.OF_ONE + makers.WAITING_OF_ONE
        many = [files.begin(order, "vera", f"{n}", "events.csv") for n in range(most)]
        with pytest.raises(RefusedError):
            files.begin(order, "vera", "more", "events.csv")
        async with asyncio.timeout(HANG_S):
            assert await made(files, order, "olga") == []
        assert [each.state for each in many] == ["made"] * makers.OF_ONE + ["waits"] * makers.WAITING_OF_ONE
        with files.reading(many[-1]):
            pass
        assert many[-1].gone and many[-1] not in files.of("vera")
        await many[-1].over.wait()
        for _ in range(most):  # at once, too
            hasty = files.begin(order, "vera", "more", "events.csv")
            with files.reading(hasty):
                pass
            await hasty.over.wait()

    with_makers(database, work)


def test_file_whose_process_was_killed_is_no_file(database: Path | str) -> None:
    """Half a file looks as if nothing more had happened."""

    async def work(files: Makers) -> None:
        await made(files, events({1: ("north", "pump")}))
        os.kill((await files._spares[0]).process.pid, signal.SIGKILL)
        await made(files, events({1: ("north", "pump")}))

    with pytest.raises(StoreError):
        with_makers(database, work)


def test_file_that_nobody_reads_any_more_is_ended(
    database: Path | str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With its process; until then whoever was cut off may come back."""
    monkeypatch.setattr(makers, "ALONE_S", 0.05)
    order = events({1: ("north", "pump")})

    async def work(files: Makers) -> None:
        await made(files, order)
        process = (await files._spares[0]).process
        process.send_signal(signal.SIGSTOP)  # it would be done at once
        new = files.begin(order, "vera", "other", "events.csv")
        with files.reading(new):
            while new.state == "waits":
                await asyncio.sleep(0)
            assert files.find("vera", "other") is new
            await asyncio.sleep(3 * makers.ALONE_S)
            assert not new.over.is_set()
        await new.over.wait()
        assert new.fault and files.find("vera", "other") is None
        await process.wait()
        with pytest.raises(StoreError):
            _ = [piece async for piece in new.read(0)]
        await made(files, order)  # its turn is free

    with_makers(database, work)


def test_slow_reader_keeps_nobody_waiting(database: Path | str, monkeypatch: pytest.MonkeyPatch) -> None:
    """More of them than files are made at once; each gets its own to the end."""
    monkeypatch.setattr(makers, "PIECE", 100)
    order = events({1: ("north", "pump")})

    async def work(files: Makers) -> None:
        slow = [files.begin(order, "vera", f"{n}", "events.csv") for n in range(makers.AT_ONCE + 1)]
        with contextlib.ExitStack() as all_:
            for each in slow:
                all_.enter_context(files.reading(each))
            readers = [each.read(0) for each in slow]
            begun = [await anext(reader) for reader in readers]
            assert len(await made(files, order)) == ROWS // 2
            for first, reader in zip(begun, readers, strict=True):
                rest = b"".join([piece async for piece in reader])
                assert (first + rest).count(b"pump") == ROWS // 2

    with_makers(database, work)


def test_files_are_kept_for_a_time_and_few_of_one(
    database: Path | str, monkeypatch: pytest.MonkeyPatch
) -> None:
    order = events({1: ("north", "pump")})

    async def work(files: Makers) -> None:
        for _ in range(makers.KEPT_OF_ONE + 2):
            await made(files, order)
        assert len(files.of("vera")) == makers.KEPT_OF_ONE
        last = files.of("vera")[-1]
        assert files.find("vera", "events", last.tag) is last
        assert files.find("vera", "events") is None  # which one, nobody knows
        assert files.find("olga", "events", last.tag) is None
        monkeypatch.setattr(makers, "KEPT_S", 0)
        with files.reading(last):  # once more, for the last time
            pass
        while files.find("vera", "events", last.tag) is last:
            await asyncio.sleep(0)
        assert last.file and last.file.closed

    with_makers(database, work)


def test_file_leaves_room_on_the_disk(database: Path | str, monkeypatch: pytest.MonkeyPatch) -> None:
    """It shares the disk with the database. Half a file is none, whether Python has a buffer or not."""
    monkeypatch.setenv("PYTHONPATH", "")
    monkeypatch.setenv("PYTHONUNBUFFERED", "1")
    order = events({1: ("north", "pump")})

    async def work(files: Makers) -> str:
        await made(files, order)
        pid = (await files._spares[0]).process.pid
        resource.prlimit(pid, resource.RLIMIT_FSIZE, (50_000, 50_000))
        new = files.begin(order, "vera", "events", "events.csv")
        await new.over.wait()
        assert files.find("vera", "events", new.tag) is None
        return new.fault

    assert "no room" in with_makers(database, work)


MAKER = """
import asyncio, os, signal, sys, time
from openrtu_tools.centre import exports

def nicenesses():
    return {os.getpriority(os.PRIO_PROCESS, int(thread)) for thread in os.listdir("/proc/self/task")}

async def work(store, order):
    await store.read("SELECT 1")
    begun = nicenesses()
    yield f"{begun}, "
    while nicenesses() == begun and time.process_time() < 20 * exports.QUICK_S:
        await asyncio.sleep(0)
    yield f"{nicenesses()}"

async def nothing(store, order):
    yield "none"

exports.MAKERS["long"], exports.MAKERS["short"] = work, nothing
exports.main()
print(signal.getitimer(signal.ITIMER_PROF)[0], file=sys.stderr)
"""


def maker(folder: Path, what: str) -> subprocess.CompletedProcess[str]:
    where = {"database": str(folder / "centre.db"), "is_file": True}
    said = "".join(json.dumps(each) + "\n" for each in (where, {"what": what}))
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    return subprocess.run(
        [sys.executable, "-c", MAKER], input=said, capture_output=True, text=True, env=environment, check=True
    )


def test_file_that_takes_longer_steps_back_with_all_its_threads(tmp_path: Path) -> None:
    """A short one is made as fast as a page is answered, beside whatever is at work."""
    done = maker(tmp_path, "long")
    mine = os.getpriority(os.PRIO_PROCESS, 0)
    assert done.stdout == f"{{{mine}}}, {{{min(19, mine + NICENESS)}}}", done.stderr


def test_no_timer_ends_a_file_that_is_whole(tmp_path: Path) -> None:
    done = maker(tmp_path, "short")
    assert (done.stdout, float(done.stderr)) == ("none", 0)


def test_database_that_is_gone_is_named(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="folder"):
        with_makers(tmp_path / "no" / "centre.db", lambda files: made(files, events({1: ("a", "b")})))
