# SPDX-License-Identifier: GPL-3.0-or-later
"""Positions to a service of the web, as GPX: docs/control-centre.md, "Positions to a service"."""

from __future__ import annotations

import asyncio
import logging
import ssl
from collections import Counter

import aiohttp

from openrtu_tools.centre.centre import Centre
from openrtu_tools.centre.errors import CentreError
from openrtu_tools.centre.formats import FORMATS, last_place
from openrtu_tools.centre.model import Changes
from openrtu_tools.centre.settings import Push

log = logging.getLogger("centre")

ANSWER_S = 30.0
PLACES_MOST = 1000  # of a request; what is more goes with the next one
RETRY_MOST_S = 60.0


class Pusher:
    """Watches the centre, and posts where vehicles are now.

    What waits is ids, one a vehicle, however slow the service is or gone: the last place counts. One request
    is under way at a time, in no one's way.
    """

    def __init__(self, centre: Centre, settings: Push) -> None:
        self.centre = centre
        self.settings = settings
        self.waiting: dict[int, None] = {}  # points, the longest first
        try:
            self.token = settings.token()
            self.tls = ssl.create_default_context(cafile=settings.ca) if settings.ca else True
        except OSError as error:
            raise CentreError(f"push: {error}; are the files there, readable and in PEM?") from error

    def changed(self, changes: Changes, linked: set[int]) -> None:
        self.waiting |= {id_: None for id_, point in changes.points.items() if point.is_position}

    async def run(self) -> None:
        """Until it is cancelled."""
        headers = {"Content-Type": "application/gpx+xml"}
        if self.token:
            headers["Authorization"] = f"Bearer {self.token}"
        timeout = aiohttp.ClientTimeout(total=ANSWER_S)
        last_error, pause_s = "", self.settings.period_s
        self.centre.watchers.add(self)
        try:
            async with aiohttp.ClientSession(headers=headers, timeout=timeout) as session:
                while True:
                    await asyncio.sleep(pause_s)
                    taken = list(self.waiting)[:PLACES_MOST]
                    content = self._content(taken)
                    for id_ in taken:
                        del self.waiting[id_]
                    try:
                        if content:
                            await self._post(session, content)
                    except (OSError, aiohttp.ClientError, TimeoutError) as error:
                        self.waiting = {**dict.fromkeys(taken), **self.waiting}
                        if str(error) != last_error:
                            last_error = str(error)
                            log.warning("positions to %s: %s; trying again", self.settings.url, error)
                        pause_s = min(2 * pause_s, max(RETRY_MOST_S, self.settings.period_s))
                    else:
                        last_error, pause_s = "", self.settings.period_s
        finally:
            self.centre.watchers.discard(self)

    async def _post(self, session: aiohttp.ClientSession, content: str) -> None:
        """Not to another address than the one of the file."""
        url = self.settings.url
        async with session.post(url, data=content.encode(), ssl=self.tls, allow_redirects=False) as response:
            if not 200 <= response.status < 300:
                raise aiohttp.ClientError(f"it answers {response.status} {response.reason}")

    def _content(self, ids: list[int]) -> str:
        """A waypoint for each that knows where it is; nothing if there is none."""
        model = self.centre.model
        writer = FORMATS["gpx"](self.centre.settings.gap_s)
        marks = []
        several = Counter(point.station for point in model.points.values() if point.is_position)
        for id_ in ids:
            point = model.points[id_]
            place = last_place(point)
            if not place or not place.is_valid:
                continue
            name = model.stations[point.station].settings.name
            if several[point.station] > 1:
                name += f" {point.ca}.{point.ioa}"
            marks.append(writer.mark(name, place))
        return "".join([writer.begin(), *marks, writer.end()]) if marks else ""
