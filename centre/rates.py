# SPDX-License-Identifier: GPL-3.0-or-later
"""How often alarms came, as EEMUA 191 counts them, and which come again and again."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any

from openrtu_tools.centre.model import NS_PER_MS, Alarm, Json
from openrtu_tools.centre.store import Row, Store

MINUTE_NS = 60 * 10**9
BUCKET_NS = 10 * MINUTE_NS  # of a bar
HOUR_NS, DAY_NS = 60 * MINUTE_NS, 24 * 60 * MINUTE_NS
TOP = 10
CHATTERS, CHATTERS_NS = 3, MINUTE_NS  # so often within such a time (ISA-18.2)
ONE_CAUSE = "alarms.kind, alarms.station, alarms.point, alarms.ca, alarms.area"


def _source(store: Store) -> str:
    """What the list has shown of these stations since a time."""
    return (
        "FROM comings JOIN alarms ON alarms.id = comings.alarm"
        f" WHERE comings.at_ns >= ? AND comings.shown = 1 AND alarms.station {store.among}"
    )


async def _bars(store: Store, since_ns: int, stations: str) -> list[int]:
    """By ten minutes, the oldest first; the last one is of now."""
    rows = await store.read(
        f"SELECT (comings.at_ns - ?) / {BUCKET_NS} AS bar, count(*) AS n {_source(store)} GROUP BY 1",
        since_ns, since_ns, stations,
    )  # fmt: skip
    bars = [0] * (DAY_NS // BUCKET_NS)
    for row in rows:
        bars[min(int(row["bar"]), len(bars) - 1)] += int(row["n"])
    return bars


async def _top(store: Store, since_ns: int, stations: str) -> list[Row]:
    return await store.read(
        f"SELECT {ONE_CAUSE}, count(*) AS n, max(comings.at_ns) / {NS_PER_MS} AS last {_source(store)}"
        f" GROUP BY {ONE_CAUSE} ORDER BY n DESC, last DESC LIMIT {TOP}",
        since_ns, stations,
    )  # fmt: skip


async def _chattering(store: Store, since_ns: int, stations: str) -> list[Row]:
    """Those that came so often within such a time, with how often in all. Suppressed ones chatter, too."""
    source = _source(store).replace(" AND comings.shown = 1", "")
    before = f"lag(comings.at_ns, {CHATTERS - 1}) OVER (PARTITION BY {ONE_CAUSE} ORDER BY comings.at_ns)"
    return await store.read(
        f"SELECT kind, station, point, ca, area, count(*) AS n, max(at_ns) / {NS_PER_MS} AS last"
        f" FROM (SELECT {ONE_CAUSE}, comings.at_ns AS at_ns, {before} AS before_ns {source}) AS each_coming"
        f" GROUP BY kind, station, point, ca, area"
        f" HAVING max(CASE WHEN at_ns - before_ns <= {CHATTERS_NS} THEN 1 ELSE 0 END) = 1"
        " ORDER BY n DESC, last DESC LIMIT 100",
        since_ns, stations,
    )  # fmt: skip


def standing(alarms: Iterable[Alarm], now_ns: int) -> Json:
    """What there is now: active and in the list, put aside, a part of another one."""
    counts = {"standing": 0, "unacknowledged": 0, "shelved": 0, "suppressed": 0}
    for alarm in alarms:
        if alarm.suppressed_by is not None:
            counts["suppressed"] += 1
        elif alarm.shelved_until_ns > now_ns:
            counts["shelved"] += 1
        else:
            counts["standing"] += alarm.active
            counts["unacknowledged"] += alarm.acknowledged_ns is None
    return counts


async def rates(store: Store, now_ns: int, seen: list[int], alarms: Iterable[Alarm]) -> Json:
    """Of the last 24 hours."""
    stations: Any = json.dumps(seen)
    since_ns = now_ns - DAY_NS
    bars = await _bars(store, since_ns, stations)
    return {
        "now": now_ns // NS_PER_MS,
        "bars": bars,
        "last_10_min": bars[-1],
        "last_hour": sum(bars[-HOUR_NS // BUCKET_NS :]),
        "day": sum(bars),
        "peak": max(bars),
        **standing(alarms, now_ns),
        "top": await _top(store, since_ns, stations),
        "chattering": await _chattering(store, since_ns, stations),
    }
