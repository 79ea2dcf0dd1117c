# SPDX-License-Identifier: GPL-3.0-or-later
"""
`make bench`: the control centre on a history of ten million rows. What a trend of years takes, a day of a
station as a file, and a page's question beside 16 files.
What the rows mean: docs/bench.md. No time is asserted.
Exit codes: 0 done, 1 something did not work.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import datetime
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import aiohttp
from polls import PollError
from store import PASSWORD, USER, log_in, told

from bench import machine
from lab.gateway import REPOSITORY, free_port

sys.path.insert(0, str(REPOSITORY))
from openrtu_tools.centre import postgres
from openrtu_tools.centre.database import open_store
from openrtu_tools.centre.errors import CentreError
from openrtu_tools.centre.rollup import Rollup
from openrtu_tools.centre.store import Database, Store

if TYPE_CHECKING:
    from postgres import Server

YEARS = 3
YEAR_NS = 31_557_600 * 10**9
STATIONS, POINTS = 10, 10  # of each; the first point of the first has half of all rows
FILES = 16
ASKED_S = 30.0
PAUSE_S = 0.02  # between a page's questions
ROWS_AT_ONCE = 500_000
TRIES = 9

FILL = """
    INSERT INTO history (point, at_ns, received_ns, value, quality, cause, tagged)
    WITH RECURSIVE numbers(n) AS (
        SELECT CAST({first} AS BIGINT) UNION ALL SELECT n + 1 FROM numbers WHERE n < {last}
    )
    SELECT CASE n % 2 WHEN 0 THEN 1 ELSE 2 + n / 2 % {others} END, {begin} + n * {step}, {begin} + n * {step},
        n * 7919 % 10007 / 10.0, CASE WHEN n / 50000 % 10 = 9 THEN 128 ELSE 0 END, 3, 1
    FROM numbers ORDER BY n
"""


def fill(store: Store, rows: int, begin_ns: int) -> None:
    """As if the centre had stored them by and by; nothing is summed up yet."""
    step = YEARS * YEAR_NS // rows

    def names(database: Database) -> None:
        database.insert("stations", ["id", "name"], [(n, f"rtu{n}") for n in range(1, STATIONS + 1)])
        points = [(1 + n // POINTS, 1, 1 + n % POINTS) for n in range(STATIONS * POINTS)]
        database.insert("points", ["station", "ca", "ioa"], points)

    store.transaction(names)
    for first in range(0, rows, ROWS_AT_ONCE):
        last = min(first + ROWS_AT_ONCE, rows) - 1
        sql = FILL.format(first=first, last=last, begin=begin_ns, step=step, others=STATIONS * POINTS - 1)
        store.transaction(lambda database, sql=sql: database.execute(sql))
    sql = "INSERT INTO unrolled SELECT DISTINCT point, at_ns >> 44 FROM history"  # as of an older database
    store.transaction(lambda database: database.execute(sql))


def sum_up(store: Store) -> tuple[float, float]:
    """How long it takes all in all, and the longest step."""
    summed, begun, longest, more = Rollup(), time.monotonic(), 0.0, True
    while more:
        step = time.monotonic()
        more = store.transaction(lambda database: summed.step(database))
        longest = max(longest, time.monotonic() - step)
    return time.monotonic() - begun, longest


# ---- who asks ------------------------------------------------------------------------------------


@contextlib.contextmanager
def serving(file: Path) -> Iterator[None]:
    command = [sys.executable, "-m", "openrtu_tools", "centre", file, "serve"]
    centre = subprocess.Popen(command, cwd=REPOSITORY / "scripts", stderr=subprocess.DEVNULL)
    try:
        yield
    finally:
        centre.terminate()
        centre.wait()


@contextlib.asynccontextmanager
async def page(address: str) -> AsyncIterator[aiohttp.ClientSession]:
    whole = aiohttp.ClientTimeout(total=None)
    async with aiohttp.ClientSession(
        address, cookie_jar=aiohttp.CookieJar(unsafe=True), timeout=whole
    ) as session:
        await log_in(session, "")
        yield session


async def timed(session: aiohttp.ClientSession, path: str) -> tuple[float, int]:
    """Seconds and octets."""
    begun = time.monotonic()
    async with session.get(path) as response:
        response.raise_for_status()
        size = len(await response.read())
    return time.monotonic() - begun, size


async def fastest_and_middle(session: aiohttp.ClientSession, path: str) -> str:
    took = sorted([(await timed(session, path))[0] * 1e3 for _ in range(TRIES)])
    return f"{took[TRIES // 2]:.0f} ms (median of {TRIES}), {took[0]:.0f} to {took[-1]:.0f}"


async def beside_files(session: aiohttp.ClientSession, now_ms: int, seconds: float) -> str:
    """What `me` takes beside whole histories as files, which are broken off then."""
    octets = [0] * FILES

    async def take(number: int) -> None:
        path = f"/api/events?format=csv&from={now_ms - YEARS * YEAR_NS // 10**6}&to={now_ms}"
        async with session.get(path) as response:
            async for piece in response.content.iter_any():
                octets[number] += len(piece)

    alone = [(await timed(session, "/api/me"))[0] for _ in range(100)]
    files = [asyncio.create_task(take(number)) for number in range(FILES)]
    took, end = [], time.monotonic() + seconds
    while time.monotonic() < end:
        took.append((await timed(session, "/api/me"))[0])
        await asyncio.sleep(PAUSE_S)
    for task in files:
        task.cancel()
    await asyncio.gather(*files, return_exceptions=True)

    def said(all_: list[float]) -> str:
        ordered = sorted(each * 1e3 for each in all_)
        middle, last = ordered[len(ordered) // 2], ordered[len(ordered) * 99 // 100]
        return f"{middle:.1f} ms (median), {last:.1f} ms (p99)"

    begun = sum(1 for each in octets if each)
    return (
        f"/api/me alone {said(alone)}; beside {FILES} files of the whole history {said(took)} of {len(took)};"
        f" {begun} files had begun, {sum(octets) / seconds / 2**20:.1f} MiB/s"
    )


async def ask(port: int, now_ms: int, seconds: float, say: Any) -> None:
    async with page(f"http://127.0.0.1:{port}") as session:
        year_ms = YEAR_NS // 10**6
        for what, points, span in (
            ("3 years of the point with half of all rows", "1", 3 * year_ms),
            ("3 years of 8 points", "1,2,3,4,5,6,7,8", 3 * year_ms),
            ("a month of that point", "1", year_ms // 12),
            ("a day of that point", "1", year_ms // 365),
        ):
            path = f"/api/trends?points={points}&from={now_ms - span}&to={now_ms}&columns=1000"
            say(f"trend, {what}: {await fastest_and_middle(session, path)}")
        day = f"from={now_ms - 86_400_000}&to={now_ms}"
        for station, what in ((2, "10 points"), (1, "10 points, one with half of all rows")):
            path = f"/api/events?station={station}&format=csv&{day}"
            size = (await timed(session, path))[1]
            say(f"a station's day as CSV ({what}, {size} octets): {await fastest_and_middle(session, path)}")
        say(await beside_files(session, now_ms, seconds))


def started() -> Server:
    sys.path.insert(0, str(REPOSITORY / "tests" / "centre"))
    from postgres import Server  # of the tests

    return Server()


def octets(server: Server | None, folder: Path) -> int:
    if not server:
        return (folder / "centre.db").stat().st_size
    return int(server.rows("SELECT pg_database_size(current_database())")[0][0])


def main() -> int:
    parser = argparse.ArgumentParser(description="The control centre on a long history.")
    parser.add_argument("--rows", type=int, default=10_000_000, help="of the history (default %(default)s)")
    parser.add_argument("--output", type=Path, default=REPOSITORY / "build", help="folder for the text")
    parser.add_argument("--postgresql", action="store_true", help="on a server of its own [SQLite]")
    arguments = parser.parse_args()
    rows = arguments.rows
    lines: list[str] = []

    def say(line: str) -> None:
        lines.append(line)
        print(line, flush=True)

    say(f"{machine()}; load {os.getloadavg()[0]:.1f}; {datetime.date.today()}.")
    try:
        with contextlib.ExitStack() as held:
            folder, port = (
                Path(held.enter_context(tempfile.TemporaryDirectory(prefix="history-"))),
                free_port(),
            )
            server = held.enter_context(started()) if arguments.postgresql else None
            where = server.new_database() if server else folder / "centre.db"
            file = folder / "centre.json"
            of_one = {"name": "rtu1", "address": "127.0.0.1", "common_addresses": [1]}
            centre = {"port": port, "database": str(where)}
            file.write_text(json.dumps({"stations": [of_one], "centre": centre}))
            told(file, "user", USER, stdin=PASSWORD)
            now_ns = time.time_ns()
            postgres.WEEKS_BACK = YEARS * 53  # as if it had run since then
            with contextlib.closing(open_store(where, alone=True)) as store:
                begun = time.monotonic()
                fill(store, rows, now_ns - YEARS * YEAR_NS)
                filled = time.monotonic() - begun
                if server:
                    server.rows("ANALYZE")  # as its own processes do by and by
                whole, longest = sum_up(store)
                if server:
                    server.rows("VACUUM ANALYZE")  # likewise
            size = octets(server, folder) / 2**20
            say(
                f"{rows} rows in {filled:.0f} s, {size:.0f} MiB; summed up from nothing in {whole:.0f} s,"
                f" {longest * 1e3:.0f} ms at a time"
            )
            with serving(file):
                asyncio.run(ask(port, now_ns // 10**6, ASKED_S, say))
    except (OSError, PollError, CentreError, aiohttp.ClientError, TimeoutError) as error:
        print(f"the bench ended early: {error}", file=sys.stderr)
        return 1
    arguments.output.mkdir(parents=True, exist_ok=True)
    name = "history-postgresql.txt" if arguments.postgresql else "history.txt"
    (arguments.output / name).write_text("\n\n".join(lines) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
