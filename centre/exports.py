# SPDX-License-Identifier: GPL-3.0-or-later
"""Files that take long, each made by a process of its own: `python -m openrtu_tools.centre.exports`.

Started ahead, it is told by its input where the database is (JSON), loads what that takes, and waits for an
order. It reads the database, and writes the file to its output, and to stderr which part is done, and what
went wrong. Its parent (makers.py) serves the file, so no page waits for one.
"""

from __future__ import annotations

import asyncio
import json
import os
import resource
import signal
import stat
import sys
import time
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

from openrtu_tools.centre.codes import INVALID
from openrtu_tools.centre.database import reader
from openrtu_tools.centre.errors import CentreError
from openrtu_tools.centre.formats import FORMATS, Place, Writer, moment, table
from openrtu_tools.centre.model import NS_PER_MS, Json, metres
from openrtu_tools.centre.store import INTEGER_MOST, Reader, Row
from openrtu_tools.centre.trends import trend
from openrtu_tools.centre.trips import Log

ROWS_AT_ONCE = 2000  # what is in memory
STRETCH_NS = 60 * 10**9
QUICK_S = 0.2  # of processor's time: what takes no more is made as fast as an answer for a page
NICENESS = 10  # of all else: values come first
ROOM = 4  # a file takes this part of what is free on its disk at most
POINTS_MOST = 1000  # so many are looked for point by point; of more, all of a time is read
TELL_S = 0.5  # between words of the progress


class Progress:
    """Tells which part is done; of several parts, one after the other."""

    def __init__(self) -> None:
        self.tell: Callable[[float], None] | None = None  # of a process of its own
        self.parts, self.done = 1, 0
        self._told = 0.0

    def at(self, part: float) -> None:
        now = time.monotonic()
        if self.tell and now - self._told > TELL_S:
            self._told = now
            self.tell((self.done + part) / self.parts)


progress = Progress()
Rows = AsyncIterator[list[Row]]
Text = AsyncIterator[str]


async def rows_of_time(store: Reader, sql: str, key: str, begin: int, end: int, *values: Any) -> Rows:
    """Rows of a time by and by, oldest first. `sql` ends with a condition; `key` is unique for a time.

    A stretch at a time: a store that knows but roughly where a time lies sorts what is in the stretch.
    """
    after: tuple[int, int] = (begin - 1, INTEGER_MOST)
    stretch = STRETCH_NS
    while after[0] < end:
        until = min(after[0] + stretch, end)
        rows = await store.read(
            f"{sql} AND (at_ns, {key}) > (?, ?) AND at_ns BETWEEN ? AND ? ORDER BY at_ns, {key} LIMIT ?",
            *values, *after, after[0], until, ROWS_AT_ONCE,
        )  # fmt: skip
        if rows:
            yield rows
        if len(rows) == ROWS_AT_ONCE:
            after = rows[-1]["at_ns"], rows[-1]["key"]
            stretch = max(stretch // 2, STRETCH_NS)
        else:
            after = until, INTEGER_MOST
            stretch *= 4
        progress.at((after[0] - begin) / max(1, end - begin))


async def track(store: Reader, point: int, begin: int, end: int, step_ns: int) -> AsyncIterator[list[Place]]:
    """The places of a time by and by; with a step, the last one of each."""
    sql = "SELECT *, point AS key FROM track WHERE point = ?"
    last: Row | None = None
    async for rows in rows_of_time(store, sql, "point", begin, end, point):
        if not step_ns:
            yield [_place(row) for row in rows]
            continue
        thinned = []
        for row in rows:
            # A place that is not valid cuts the track: it stays, and so does the one before it.
            cut = last and (last["quality"] | row["quality"]) & INVALID
            if last and (cut or last["at_ns"] // step_ns != row["at_ns"] // step_ns):
                thinned.append(_place(last))
            last = row
        yield thinned
    if last:
        yield [_place(last)]


def _place(row: Row) -> Place:
    return Place(
        row["at_ns"] // NS_PER_MS, row["latitude"] / 1e7, row["longitude"] / 1e7, metres(row["altitude"]),
        row["quality"], row["detail"] & 15, row["detail"] >> 4,
    )  # fmt: skip


async def tracks(
    store: Reader, writer: Writer, names: dict[int, str], begin: int, end: int, step_ns: int
) -> Text:
    """A whole file of the ways of vehicles."""
    yield writer.begin()
    for number, (id_, name) in enumerate(names.items()):
        progress.parts, progress.done = len(names), number
        yield writer.track(name, id_)
        async for places in track(store, id_, begin, end, step_ns):
            yield writer.places(places)
        yield writer.end_track()
    yield writer.end()


# ---- by what is ordered --------------------------------------------------------------------------


async def _tracks(store: Reader, order: Json) -> Text:
    names = {int(id_): name for id_, name in order["names"].items()}
    writer = FORMATS[order["format"]](order["gap_s"])
    async for text in tracks(store, writer, names, order["begin"], order["end"], order["step_ns"]):
        yield text


async def _history(store: Reader, order: Json) -> Text:
    yield table([["time", "value", "quality", "cause"]])
    sql = "SELECT at_ns, id AS key, value, quality, cause FROM history WHERE point = ?"
    async for rows in rows_of_time(store, sql, "id", order["begin"], order["end"], order["point"]):
        yield table(
            (moment(row["at_ns"] // NS_PER_MS), row["value"], row["quality"], row["cause"]) for row in rows
        )


async def _events(store: Reader, order: Json) -> Text:
    """Of the points in `names`: by id, the station's name and the point's."""
    yield table([["time", "station", "point", "value", "quality", "cause"]])
    names = {int(id_): name for id_, name in order["names"].items()}
    if len(names) <= POINTS_MOST:  # SQLite takes the tables of a CROSS JOIN in this order: each point's index
        source, values = f"{store.wanted} CROSS JOIN history WHERE point = number", [json.dumps(list(names))]
    else:
        source, values = "history WHERE TRUE", []
    sql = f"SELECT at_ns, id AS key, point, value, quality, cause FROM {source}{order['cause']}"
    async for rows in rows_of_time(store, sql, "id", order["begin"], order["end"], *values):
        yield table(
            (
                moment(row["at_ns"] // NS_PER_MS),
                *names[row["point"]],
                row["value"],
                row["quality"],
                row["cause"],
            )
            for row in rows
            if row["point"] in names
        )


async def _audit(store: Reader, order: Json) -> Text:
    """`where` and its values as api.audited has made them; `names` of stations, by id."""
    yield table([["time", "user", "action", "station", "detail"]])
    sql = f'SELECT at_ns, id AS key, "user", action, station, detail FROM audit WHERE TRUE{order["where"]}'
    async for rows in rows_of_time(store, sql, "id", order["begin"], order["end"], *order["values"]):
        yield table(
            (
                moment(row["at_ns"] // NS_PER_MS),
                row["user"],
                row["action"],
                order["names"].get(str(row["station"]), ""),
                row["detail"],
            )
            for row in rows
        )


async def _trends(store: Reader, order: Json) -> Text:
    """What the page draws: of each point its columns, or its changes where there are few."""
    yield table([["time", "station", "point", "unit", "low", "high", "last", "quality", "rows", "exact"]])
    for id_, station, name, unit in order["points"]:
        seen = await trend(store, id_, order["begin"], order["end"], order["columns"])
        yield table(
            (
                moment(each.at_ns // NS_PER_MS), station, name, unit, each.low, each.high, each.last,
                each.quality, each.number, int(seen.exact),
            )
            for each in seen.columns
        )  # fmt: skip


async def _trips(store: Reader, order: Json) -> Text:
    """As JSON or CSV; the speeds of trips are in JSON."""
    log = Log(order["gap_s"])
    async for places in track(store, order["point"], order["begin"], order["end"], 0):
        log.add(places)
    views = [each.view() for each in log.end()]
    if order["format"] == "json":
        yield json.dumps(views)
        return
    columns = ["kind", "from", "to", "metres", "unknown_m", "mean", "most", "latitude", "longitude"]
    yield table([columns])
    for view in views:
        yield table([[moment(view[key]) if key in ("from", "to") else view.get(key, "") for key in columns]])


MAKERS: dict[str, Callable[[Reader, Json], Text]] = {
    "tracks": _tracks,
    "history": _history,
    "events": _events,
    "audit": _audit,
    "trends": _trends,
    "trips": _trips,
}


async def _write(opens: Callable[[], Reader], order: Json, file: IO[bytes]) -> None:
    store = opens()
    try:
        async for text in MAKERS[order["what"]](store, order):
            file.write(text.encode())
        file.flush()
    finally:
        store.close()


def _leave_room() -> None:
    """The database may be on the same disk, and comes first."""
    file = sys.stdout.fileno()
    if stat.S_ISREG(os.fstat(file).st_mode):
        disk = os.fstatvfs(file)
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)  # it is told as an error
        most, allowed = disk.f_bavail * disk.f_frsize // ROOM, resource.getrlimit(resource.RLIMIT_FSIZE)[0]
        if allowed == resource.RLIM_INFINITY or allowed > most:
            resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))


def _read() -> Json | None:
    line = sys.stdin.buffer.readline()
    return json.loads(line) if line else None


@contextmanager
def stepping_back() -> Iterator[None]:
    """What takes longer has a lower priority from then on. A timer that is left kills Python as it ends."""
    signal.signal(signal.SIGPROF, _step_back)
    signal.setitimer(signal.ITIMER_PROF, QUICK_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)


def _step_back(*_: object) -> None:
    """Each thread has a niceness of its own."""
    for thread in Path("/proc/self/task").iterdir():
        with suppress(ProcessLookupError):
            nice = os.getpriority(os.PRIO_PROCESS, int(thread.name)) + NICENESS
            os.setpriority(os.PRIO_PROCESS, int(thread.name), nice)


def _tell(part: float) -> None:
    print(f"{part:.4f}", file=sys.stderr, flush=True)


def main() -> int:
    where = _read()
    opens = reader(Path(where["database"]) if where["is_file"] else where["database"]) if where else None
    order = _read()
    if not opens or not order:
        return 0  # nobody needed it
    _leave_room()
    progress.tell = _tell
    try:
        # stdout itself has no buffer where the environment says so, and then writes a part and says nothing.
        with stepping_back():
            asyncio.run(_write(opens, order, os.fdopen(sys.stdout.fileno(), "wb", closefd=False)))
    except BrokenPipeError:
        os._exit(1)  # who asked has left; Python would try once more to write
    except CentreError as error:
        print(error, file=sys.stderr)
        return 1
    except OSError as error:
        print(f"no room for the file: {error}", file=sys.stderr, flush=True)
        os._exit(1)  # for the same reason
    return 0


if __name__ == "__main__":
    sys.exit(main())
