# SPDX-License-Identifier: GPL-3.0-or-later
"""How often alarms came, as EEMUA 191 counts them, and which come again and again."""

from __future__ import annotations

import json
from collections.abc import Iterable

from openrtu_tools.centre.alarms import LOST, NETWORK
from openrtu_tools.centre.model import NS_PER_MS, Alarm, Json
from openrtu_tools.centre.store import Row, Store

MINUTE_NS = 60 * 10**9
BUCKET_NS = 10 * MINUTE_NS  # of a bar
HOUR_NS, DAY_NS = 60 * MINUTE_NS, 24 * 60 * MINUTE_NS
TOP = 10
CHATTERS, CHATTERS_NS = 3, MINUTE_NS  # so often within such a time (ISA-18.2)
CHATTERING_MOST = 100
ONE_CAUSE = "alarms.kind, alarms.station, alarms.point, alarms.ca, alarms.area"


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


class Rates:
    """Of the last 24 hours, of these stations."""

    def __init__(self, store: Store, now_ns: int, stations: list[int], is_limited: bool) -> None:
        self.store = store
        self.now_ns = now_ns
        self.since_ns = now_ns - DAY_NS
        self.stations = json.dumps(stations)
        all_of = (
            "FROM comings JOIN alarms ON alarms.id = comings.alarm"
            f" WHERE comings.at_ns >= ? AND alarms.station {store.among}"
        )
        # As alarms.seen says: who is limited is shown each station that is lost, and no fault of the network.
        lost = f" AND (comings.shown = 1 OR alarms.kind = '{LOST}')"
        self.every = f"{all_of} AND alarms.kind <> '{NETWORK}'"
        self.shown = f"{self.every}{lost}" if is_limited else f"{all_of} AND comings.shown = 1"

    async def _bars(self) -> list[int]:
        """By ten minutes, the oldest first; the last one is of now."""
        rows = await self.store.read(
            f"SELECT (comings.at_ns - ?) / {BUCKET_NS} AS bar, count(*) AS n {self.shown} GROUP BY 1",
            self.since_ns, self.since_ns, self.stations,
        )  # fmt: skip
        bars = [0] * (DAY_NS // BUCKET_NS)
        for row in rows:
            bars[min(int(row["bar"]), len(bars) - 1)] += int(row["n"])
        return bars

    async def _top(self) -> list[Row]:
        return await self.store.read(
            f"SELECT {ONE_CAUSE}, count(*) AS n, max(comings.at_ns) / {NS_PER_MS} AS last {self.shown}"
            f" GROUP BY {ONE_CAUSE} ORDER BY n DESC, last DESC LIMIT {TOP}",
            self.since_ns, self.stations,
        )  # fmt: skip

    async def _chattering(self) -> list[Row]:
        """Those that came so often within such a time, with how often in all, shown or not."""
        before = f"lag(comings.at_ns, {CHATTERS - 1}) OVER (PARTITION BY {ONE_CAUSE} ORDER BY comings.at_ns)"
        return await self.store.read(
            f"SELECT kind, station, point, ca, area, count(*) AS n, max(at_ns) / {NS_PER_MS} AS last"
            f" FROM (SELECT {ONE_CAUSE}, comings.at_ns AS at_ns, {before} AS before_ns {self.every}) AS one"
            " GROUP BY kind, station, point, ca, area"
            f" HAVING max(CASE WHEN at_ns - before_ns <= {CHATTERS_NS} THEN 1 ELSE 0 END) = 1"
            f" ORDER BY n DESC, last DESC LIMIT {CHATTERING_MOST}",
            self.since_ns, self.stations,
        )  # fmt: skip

    async def told(self, alarms: Iterable[Alarm]) -> Json:
        """With how many there are now."""
        bars = await self._bars()
        return {
            "now": self.now_ns // NS_PER_MS,
            "bars": bars,
            "last_10_min": bars[-1],
            "last_hour": sum(bars[-HOUR_NS // BUCKET_NS :]),
            "day": sum(bars),
            "peak": max(bars),
            **standing(alarms, self.now_ns),
            "top": await self._top(),
            "chattering": await self._chattering(),
        }
