# SPDX-License-Identifier: GPL-3.0-or-later
"""
`make bench`: the control centre with all at once. RTUs polled at 1 Hz, pages at the map, files of tracks that
are made one after the other, and what a page's question takes meanwhile. Who watches, who takes files and who
asks are processes of their own: none measures another one's work.
Exit codes: 0 done, 1 something did not work, 2 not built.
"""

from __future__ import annotations

import argparse
import asyncio
import datetime
import multiprocessing
import os
import sqlite3
import sys
import tempfile
import time
from concurrent.futures import Future, ProcessPoolExecutor
from pathlib import Path

import aiohttp
from history import page, timed
from polls import PROGRAM, RTUS, PollError
from store import Seen, running, watch

from bench import machine
from lab.gateway import REPOSITORY, free_port

PAUSE_S = 0.02  # between a page's questions
PATHS = ("/api/me", "/api/stations", "/api/points?station=1", "/api/alarms")


def watching(port: int, count: int, seconds: float, pages: int) -> list[tuple[Seen, int, int]]:
    async def all_of_them() -> list[tuple[Seen, int, int]]:
        return list(await asyncio.gather(*(watch(port, count, seconds) for _ in range(pages))))

    return asyncio.run(all_of_them())


def taking(port: int, over: Path, files: int) -> tuple[int, int]:
    """Whole files, and octets, until that is there."""

    async def take(session: aiohttp.ClientSession) -> tuple[int, int]:
        whole = octets = 0
        while not over.exists():
            now_s = time.time()
            path = f"/api/tracks?format=csv&from={int(now_s - 3600) * 1000}&to={int(now_s) * 1000}"
            async with session.get(path) as response:
                response.raise_for_status()
                async for piece in response.content.iter_any():
                    octets += len(piece)
                    if over.exists():
                        return whole, octets
            whole += 1
        return whole, octets

    async def all_of_them() -> tuple[int, int]:
        async with page(f"http://127.0.0.1:{port}") as session:
            taken = await asyncio.gather(*(take(session) for _ in range(files)))
        return sum(each[0] for each in taken), sum(each[1] for each in taken)

    return asyncio.run(all_of_them())


async def ask(port: int, watching: Future[list[tuple[Seen, int, int]]]) -> dict[str, list[float]]:
    """Until the pages have seen enough."""
    took: dict[str, list[float]] = {path: [] for path in PATHS}
    async with page(f"http://127.0.0.1:{port}") as session:
        while not watching.done():
            for path in PATHS:
                took[path].append((await timed(session, path))[0] * 1e3)
                await asyncio.sleep(PAUSE_S)
    return took


def middle_and_last(all_ms: list[float]) -> str:
    ordered = sorted(all_ms)
    return f"{ordered[len(ordered) // 2]:.0f} ms (median), {ordered[len(ordered) * 99 // 100]:.0f} ms (p99)"


def whole(count: int, seconds: float, pages: int, files: int) -> list[str]:
    fresh = multiprocessing.get_context("spawn")  # a fork would hold the simulated RTUs' input open
    with (
        tempfile.TemporaryDirectory(prefix="beside-") as name,
        ProcessPoolExecutor(2, mp_context=fresh) as pool,
    ):
        folder, port = Path(name), free_port()
        with running(count, port, folder):
            seen = pool.submit(watching, port, count, seconds, pages)
            taken = pool.submit(taking, port, folder / "over", files)
            try:
                took = asyncio.run(ask(port, seen))
            finally:
                (folder / "over").touch()
            of_pages, (done, octets) = seen.result(), taken.result()
        begun, ended = min(each[1] for each in of_pages), max(each[2] for each in of_pages)
        with sqlite3.connect(folder / "centre.db") as database:
            sql = "SELECT count(*) FROM track WHERE at_ns BETWEEN ? AND ?"
            stored = database.execute(sql, (begun, ended)).fetchone()[0]
    span = (ended - begun) / 1e9
    ages = [age for each in of_pages for age in each[0].ages_ms]
    told = sum(each[0].octets for each in of_pages) / span / 1024
    return [
        f"{count} RTUs polled at 1 Hz for {span:.0f} s, {pages} pages at the map, {files} files of tracks at"
        f" a time: {stored / span:.0f} positions a second stored; wire to page {middle_and_last(ages)};"
        f" {told:.0f} KiB/s to the pages; {done} files, {octets / 2**20:.0f} MiB",
        *(f"{path}: {middle_and_last(all_)} of {len(all_)}" for path, all_ in took.items()),
    ]


def main() -> int:
    parser = argparse.ArgumentParser(description="The control centre with all at once.")
    parser.add_argument("--rtus", type=int, default=10_000)
    parser.add_argument("--pages", type=int, default=4)
    parser.add_argument("--files", type=int, default=4)
    parser.add_argument("--seconds", type=float, default=60)
    parser.add_argument("--output", type=Path, default=REPOSITORY / "build", help="folder for the text")
    arguments = parser.parse_args()
    missing = [str(program) for program in (RTUS, PROGRAM) if not program.exists()]
    if missing:
        print(f"not built: {', '.join(missing)}; type `make bench`, which builds them", file=sys.stderr)
        return 2
    lines = [f"{machine()}; load {os.getloadavg()[0]:.1f}; {datetime.date.today()}."]
    print(lines[0], flush=True)
    try:
        lines += whole(arguments.rtus, arguments.seconds, arguments.pages, arguments.files)
    except (PollError, OSError, sqlite3.Error, aiohttp.ClientError, TimeoutError) as error:
        print(f"the bench ended early: {error}", file=sys.stderr)
        return 1
    print("\n".join(lines[1:]), flush=True)
    arguments.output.mkdir(parents=True, exist_ok=True)
    (arguments.output / "beside.txt").write_text("\n\n".join(lines) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
