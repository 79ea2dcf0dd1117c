# SPDX-License-Identifier: GPL-3.0-or-later
"""What changes, to one page: at most once a second, and only what its view shows."""

from __future__ import annotations

import asyncio
import math
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from aiohttp import WSMsgType, web

from openrtu_tools.centre.alarms import views
from openrtu_tools.centre.centre import Centre
from openrtu_tools.centre.model import Alarm, Changes, Json, Point, Station
from openrtu_tools.centre.users import Session

PERIOD_S = 1.0
QUIET_S = 5.0
MESSAGE_MOST = 4096  # a page says which view it shows, and nothing else
VALUES_PERIOD_S = 0.1  # of a program that watches values
VALUES_MOST = 20_000  # that wait for it
VIEWS = ("map", "points", "alarms", "stations", "values", "pictures")
LISTS = ("stations", "points", "gone", "alarms", "commands", "values")
SEARCH_MOST = 64  # characters


@dataclass(frozen=True)
class View:
    """What a page shows: of the map a part, one that is followed, and those whose name has a text."""

    name: str = ""  # "values": a program is told of each value of all points, in order, and not only the last
    station: int = 0  # of the view "points"
    bounds: tuple[float, float, float, float] | None = None  # south, west, north, east
    chosen: int = 0  # a point
    search: str = ""
    picture: str = ""  # of the view "pictures"

    @classmethod
    def read(cls, message: Any) -> View:
        """Raises ValueError."""
        if not isinstance(message, dict) or message.get("view") not in VIEWS:
            raise ValueError(f"a view is one of {', '.join(VIEWS)}")
        numbers = [message.get(key, 0) for key in ("station", "chosen")]
        bounds, search = message.get("bounds"), message.get("search", "")
        picture = message.get("picture", "")
        if not all(isinstance(number, int) for number in numbers) or not all(
            isinstance(text, str) for text in (search, picture)
        ):
            raise ValueError("station and chosen are numbers, search and picture are texts")
        if bounds is not None and not (
            isinstance(bounds, list)
            and len(bounds) == 4
            and all(isinstance(each, int | float) and math.isfinite(each) for each in bounds)
        ):
            raise ValueError("bounds are south, west, north and east")
        where = None if bounds is None else tuple(map(float, bounds))
        return cls(message["view"], numbers[0], where, numbers[1], search[:SEARCH_MOST].casefold(), picture)

    def has(self, latitude: float, longitude: float) -> bool:
        """The map goes round: west may be less than -180, and east more than 180.

        >>> [View("map", 0, (0, 170, 10, 190)).has(5, longitude) for longitude in (169, 175, -175, -169)]
        [False, True, True, False]
        """
        if self.bounds is None:
            return True
        south, west, north, east = self.bounds
        return south <= latitude <= north and (east - west >= 360 or (longitude - west) % 360 <= east - west)


class Stream:
    """A page that watches. What it has not been told is bounded, however slow it is: ids, no messages."""

    def __init__(self, centre: Centre, socket: web.WebSocketResponse, session: Session) -> None:
        self.session = session
        self.centre = centre
        self.socket = socket
        self.view = View()
        self.bound: frozenset[int] = frozenset()  # the points of the picture that it shows
        self.whole = False  # it shows another view, and knows nothing of it
        self.looked = False  # it shows another part of the view
        self.waiting: dict[str, set[int]] = {kind: set() for kind in ("stations", "points")}
        self.shown: dict[str, set[int]] = {kind: set() for kind in ("stations", "points")}  # what it knows
        self.alarms: dict[int, Json] = {}  # an alarm that ends is no longer in the model
        self.commands: dict[int, Json] = {}  # and neither is a command
        self.values: list[Point] = []
        self.something = asyncio.Event()

    def sees(self, station: int) -> bool:
        known = self.centre.model.stations.get(station)
        return known is not None and self.session.sees(known)

    def sees_point(self, point: int) -> bool:
        return self.sees(self.centre.model.points[point].station)

    def shows(self, point: Point) -> bool:
        view = self.view
        if view.name == "values":
            shown = True
        elif view.name == "points":
            shown = point.station == view.station
        elif view.name == "pictures":
            shown = point.id in self.bound
        else:
            shown = view.name == "map" and point.is_position and self._on_map(point)
        return shown and self.sees(point.station)

    def _on_map(self, point: Point) -> bool:
        """A text is searched everywhere."""
        view = self.view
        if point.id == view.chosen:
            return True
        if view.search:
            name = self.centre.model.stations[point.station].settings.name
            return view.search in name.casefold() or self._is_inside(point)
        return self._is_inside(point)

    def _is_inside(self, point: Point) -> bool:
        return point.place is not None and self.view.has(*point.place)

    def shows_station(self, station: Station, with_points: set[int]) -> bool:
        """On the map those that have a place there, and those of what is shown; of a picture these alone."""
        if not self.session.sees(station):
            return False
        if self.view.name not in ("map", "pictures") or station.id in with_points:
            return True
        if self.view.name == "pictures":
            return False
        place = station.settings.location
        return place is not None and (
            self.view.has(*place)
            or bool(self.view.search and self.view.search in station.settings.name.casefold())
        )

    def changed(self, changes: Changes, linked: set[int]) -> None:
        """Links, alarms and commands concern every view: they stand in the page's head."""
        view = self.view.name
        if not view:
            return
        if view == "stations":
            self.waiting["stations"] |= changes.stations.keys()
        else:
            self.waiting["stations"] |= linked
        if view in ("map", "points", "pictures"):
            self.waiting["points"] |= changes.points.keys()
        elif view == "values":
            self._take_values(changes)
        self.commands |= {
            id_: command.view() for id_, command in changes.commands.items() if self.sees_point(command.point)
        }
        self.alarms |= {view["id"]: view for view in self._views(changes.alarms)}
        self.something.set()

    def _views(self, alarms: dict[int, Alarm]) -> list[Json]:
        own = (alarm for alarm in alarms.values() if self.sees(alarm.station))
        return views(own, bool(self.session.groups))

    def _take_values(self, changes: Changes) -> None:
        """Who is too slow for them is told the last ones."""
        self.waiting["points"] |= changes.points.keys() - self.shown["points"]
        self.values += [point for point in changes.values if self.sees(point.station)]
        if len(self.values) > VALUES_MOST:
            self.values = []
            self.whole = self.looked = True

    def look(self, message: Any) -> None:
        """The page shows another view, and is told all of it once; or another part: what is new of it."""
        view = View.read(message)
        if (view.name, view.station, view.picture) != (self.view.name, self.view.station, self.view.picture):
            self.whole = True
        self.view = view
        self.bound = self.centre.pictures.points(view.picture, self.centre.model)
        self.looked = True
        self.something.set()

    def message(self) -> Json:
        """What the page does not know, whole; of what it knows, what changes; and what it shall forget."""
        model = self.centre.model
        message: Json = self.centre.state()
        known, waiting = self.shown, self.waiting
        if self.whole:
            message["whole"] = True
            for ids in known.values():
                ids.clear()
            message["alarms"] = self._views(model.alarms)
            message["commands"] = [
                command.view() for command in model.commands.values() if self.sees_point(command.point)
            ]
            self.values = []
        else:
            message["alarms"] = list(self.alarms.values())
            message["commands"] = list(self.commands.values())
        candidates = model.points if self.looked else waiting["points"]
        shown = {id_ for id_ in candidates if self.shows(model.points[id_])}
        gone = {id_ for id_ in candidates if id_ in known["points"]} - shown
        fresh = shown - known["points"]
        message["points"] = [model.points[id_].view() for id_ in fresh]
        message["points"] += [model.points[id_].news() for id_ in shown & known["points"] & waiting["points"]]
        message["gone"] = list(gone)
        known["points"] = (known["points"] | fresh) - gone
        owners = {model.points[id_].station for id_ in fresh}
        stations = model.stations if self.looked else waiting["stations"] | owners
        concerned = owners | known["stations"]
        visible = {id_ for id_ in stations if self.shows_station(model.stations[id_], concerned)}
        changed = {id_ for id_ in visible if id_ not in known["stations"] or id_ in waiting["stations"]}
        message["stations"] = [model.stations[id_].view() for id_ in changed]
        known["stations"] |= changed
        if self.looked and self.view.name == "map":
            message |= self._extent()
        self.whole = self.looked = False
        if self.view.name == "values":
            message["values"] = [point.as_received() for point in self.values if point.id not in fresh]
            self.values = []
        self.alarms, self.commands = {}, {}
        self.waiting = {kind: set() for kind in waiting}
        return message

    def _extent(self) -> Json:
        """How many have a place, and where all of them are: south, west, north, east."""
        model = self.centre.model
        places = [
            station.settings.location
            for station in model.stations.values()
            if station.settings.location and self.session.sees(station)
        ]
        vehicles = [
            point.place for point in model.points.values() if point.place and self.sees(point.station)
        ]
        places += vehicles
        if not places:
            return {"vehicles": 0, "extent": None}
        latitudes, longitudes = zip(*places, strict=True)
        extent = [min(latitudes), min(longitudes), max(latitudes), max(longitudes)]
        return {"vehicles": len(vehicles), "extent": extent}

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
                except (ValueError, RecursionError):
                    break
        finally:
            self.centre.watchers.discard(self)
            sender.cancel()

    async def _send(self, still_allowed: Any) -> None:
        before: tuple[bool, str] | None = None  # the centre itself, as it was last told
        while True:
            with suppress(TimeoutError):  # a session that ended is noticed, too, while nothing changes
                async with asyncio.timeout(QUIET_S):
                    await self.something.wait()
            if not await still_allowed():
                await self.socket.close(code=4401)
                return
            if not self.something.is_set():
                continue
            self.something.clear()
            message = self.message()
            state = message["collects"], message["fault"]
            if (
                state != before
                or message.keys() & {"whole", "extent"}
                or any(message.get(kind) for kind in LISTS)
            ):
                await self.socket.send_json(message)
            before = state
            await asyncio.sleep(VALUES_PERIOD_S if self.view.name == "values" else PERIOD_S)
