# SPDX-License-Identifier: GPL-3.0-or-later
"""What changes, to one page: at most once a second, and only what its view shows."""

from __future__ import annotations

import asyncio
from typing import Any

from aiohttp import WSMsgType, web

from centre.centre import Centre
from centre.model import Changes, Json, Point
from centre.users import Session

PERIOD_S = 1.0
MESSAGE_MOST = 4096  # a page says which view it shows, and nothing else
VIEWS = ("map", "points", "alarms", "stations")


class Stream:
    """A page that watches. What it has not been told is bounded, however slow it is: ids, no messages."""

    def __init__(self, centre: Centre, socket: web.WebSocketResponse, session: Session) -> None:
        self.session = session
        self.centre = centre
        self.socket = socket
        self.view = ""
        self.station = 0
        self.whole = False
        self.waiting: dict[str, set[int]] = {kind: set() for kind in ("stations", "points")}
        self.alarms: dict[int, Json] = {}  # an alarm that ends is no longer in the model
        self.commands: dict[int, Json] = {}  # and neither is a command
        self.something = asyncio.Event()

    def sees(self, station: int) -> bool:
        known = self.centre.model.stations.get(station)
        return known is not None and self.session.sees(known)

    def sees_point(self, point: int) -> bool:
        return self.sees(self.centre.model.points[point].station)

    def shows(self, point: Point) -> bool:
        return (
            (self.view == "map" and point.is_position)
            or (self.view == "points" and point.station == self.station)
        ) and self.sees(point.station)

    def changed(self, changes: Changes, linked: set[int]) -> None:
        """Links, alarms and commands concern every view: they stand in the page's head."""
        if not self.view:
            return
        told = changes.stations.keys() if self.view == "stations" else linked
        self.waiting["stations"] |= {id_ for id_ in told if self.sees(id_)}
        self.waiting["points"] |= {id_ for id_, point in changes.points.items() if self.shows(point)}
        self.commands |= {
            id_: command.view() for id_, command in changes.commands.items() if self.sees_point(command.point)
        }
        self.alarms |= {
            id_: alarm.view() for id_, alarm in changes.alarms.items() if self.sees(alarm.station)
        }
        if (changes.stations and not linked and self.view != "stations") and not (
            self.waiting["points"] or self.alarms or self.commands
        ):
            return
        self.something.set()

    def look(self, said: Any) -> None:
        """The page shows another view: it is told all of it once."""
        if not isinstance(said, dict) or said.get("view") not in VIEWS:
            raise ValueError(f"a view is one of {', '.join(VIEWS)}")
        self.view = said["view"]
        station = said.get("station", 0)
        self.station = station if isinstance(station, int) else 0
        self.whole = True
        self.something.set()

    def message(self) -> Json:
        """What the page does not know yet."""
        model = self.centre.model
        said: Json = self.centre.state()
        if self.whole:
            said["whole"] = True
            stations = [id_ for id_ in model.stations if self.sees(id_)]
            points = [id_ for id_, point in model.points.items() if self.shows(point)]
            said["alarms"] = [alarm.view() for alarm in model.alarms.values() if self.sees(alarm.station)]
            said["commands"] = [
                command.view() for command in model.commands.values() if self.sees_point(command.point)
            ]
        else:
            stations = list(self.waiting["stations"])
            points = list(self.waiting["points"])
            said["alarms"] = list(self.alarms.values())
            said["commands"] = list(self.commands.values())
        said["stations"] = [model.stations[id_].view() for id_ in stations]
        said["points"] = [model.points[id_].view() for id_ in points]
        self.whole = False
        self.alarms = {}
        self.commands = {}
        for ids in self.waiting.values():
            ids.clear()
        return said

    async def run(self, still_allowed: Any) -> None:
        """Until the page leaves, or its session has ended."""
        sender = asyncio.create_task(self._send(still_allowed))
        self.centre.watchers.add(self)
        try:
            async for message in self.socket:
                if message.type != WSMsgType.TEXT:
                    break
                try:
                    self.look(message.json())
                except ValueError:
                    break
        finally:
            self.centre.watchers.discard(self)
            sender.cancel()

    async def _send(self, still_allowed: Any) -> None:
        while True:
            await self.something.wait()
            self.something.clear()
            if not await still_allowed():
                await self.socket.close(code=4401)
                return
            await self.socket.send_json(self.message())
            await asyncio.sleep(PERIOD_S)
