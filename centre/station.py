# SPDX-License-Identifier: GPL-3.0-or-later
"""The centre as a controlled station of a higher one: a module of a gateway, whose rtu-iec104 serves that.

rtud starts it (centre/run-station). It asks the centre as any program does; what its points are is in
centre/higher.py. docs/control-centre.md, "A higher centre".
"""

from __future__ import annotations

import asyncio
import ssl
import threading
import time
from collections import defaultdict, deque
from contextlib import suppress
from pathlib import Path
from typing import Any

import aiohttp
from openrtu import Level, Module, Quality, Request, Result

from openrtu_tools.centre import codes
from openrtu_tools.centre.codes import Link, State
from openrtu_tools.centre.higher import COMMAND_S, RELEASE_S
from openrtu_tools.centre.model import NS_PER_MS, Json
from openrtu_tools.centre.records import ENDED

AGAIN_S = 1.0  # until the next attempt to reach the centre
ASK_S = 0.1  # between two looks at a command
ANSWER_S = 10.0
UNTOLD = Quality.INVALID | Quality.NOT_TOPICAL
# What the centre refuses before anything was sent, by its code; all else is not for us to command.
REFUSALS = {"busy": Result.INTERLOCK, "out_of_range": Result.OUT_OF_RANGE}
RESULTS = {
    codes.Result.DONE: Result.DONE,
    codes.Result.EXCEPTION: Result.EXCEPTION,
    codes.Result.TIMEOUT: Result.TIMEOUT,
    codes.Result.OUT_OF_RANGE: Result.OUT_OF_RANGE,
    codes.Result.UNKNOWN_FATE: Result.UNKNOWN_FATE,
    codes.Result.BUSY: Result.INTERLOCK,
}

Place = tuple[str, int, int]  # of an object: station, common address, IOA
Linked = tuple[str, bool, int]  # a station, whether it has a link, since when


class RefusedError(Exception):
    """The centre says no, and nothing was sent."""


class Below:
    """What the centre says, by and by: in a thread of its own, for the scans."""

    def __init__(self, config: Json) -> None:
        self.url = config["url"].rstrip("/")
        token = Path(config["token_file"]).read_text().strip()
        self.headers = {"Authorization": f"Bearer {token}"}
        self.tls = ssl.create_default_context(cafile=config["tls_ca"]) if "tls_ca" in config else None
        self.news: deque[tuple[list[tuple[Place, Json]], list[Linked], bool, str]] = (
            deque()
        )  # as _take has it
        self.ends: deque[tuple[Request, Result]] = deque()
        self.ids: dict[Place, int] = {}  # points of the centre
        self.loop = asyncio.new_event_loop()
        self.session: aiohttp.ClientSession | None = None

    def start(self) -> None:
        threading.Thread(target=lambda: self.loop.run_until_complete(self._run()), daemon=True).start()

    async def _run(self) -> None:
        """For ever: what ends it is the end of the process."""
        last_reason = ""
        timeout = aiohttp.ClientTimeout(total=ANSWER_S)
        async with aiohttp.ClientSession(headers=self.headers, timeout=timeout) as self.session:
            while True:
                why = "it has ended the connection"
                try:
                    await self._watch()
                    last_reason = ""
                except (OSError, aiohttp.ClientError, TimeoutError, ValueError) as error:
                    why = str(error)
                self.news.append(([], [], False, "" if why == last_reason else why))
                last_reason = why
                await asyncio.sleep(AGAIN_S)

    async def _watch(self) -> None:
        assert self.session
        names: dict[int, str] = {}
        places: dict[int, Place] = {}
        async with self.session.ws_connect(
            f"{self.url}/api/stream", ssl=self.tls or True, heartbeat=ANSWER_S, max_msg_size=0
        ) as socket:
            await socket.send_json({"view": "values"})
            async for message in socket:
                if message.type != aiohttp.WSMsgType.TEXT:
                    break
                state = message.json()
                names |= {each["id"]: each["name"] for each in state["stations"]}
                for point in state["points"]:
                    places[point["id"]] = place = names[point["station"]], point["ca"], point["ioa"]
                    self.ids[place] = point["id"]
                values = [
                    (places[value["id"]], value)
                    for value in state["points"] + state["values"]
                    if value["received"]
                ]
                links = [
                    (each["name"], each["link"] == Link.UP, each["since"] or 0) for each in state["stations"]
                ]
                self.news.append((values, links, state["collects"], ""))

    # ---- commands ------------------------------------------------------------------------------

    def command(self, request: Request, place: Place, value: float) -> None:
        asyncio.run_coroutine_threadsafe(self._carry_out(request, place, value), self.loop)

    async def _carry_out(self, request: Request, place: Place, value: float) -> None:
        """Until it has ended: what is told is what became of it at the station."""
        sent = False
        try:
            if self._is_old(request, COMMAND_S) or place not in self.ids:
                result = Result.TOO_OLD if place in self.ids else Result.NOT_COMMANDABLE
            else:
                body = {"point": self.ids[place], "value": value}
                try:
                    command = await self._ask("POST", "commands", body)
                except aiohttp.ClientConnectorError:
                    raise RefusedError("gone") from None  # the centre is: it was asked nothing
                sent = True
                result = await self._follow(request, command)
        except RefusedError as refused:
            result = Result.UNKNOWN_FATE if sent else REFUSALS.get(str(refused), Result.NOT_COMMANDABLE)
        except (OSError, aiohttp.ClientError, TimeoutError, ValueError):
            result = Result.UNKNOWN_FATE
        self.ends.append((request, result))

    async def _follow(self, request: Request, command: Json) -> Result:
        """A command of two persons is told to have begun when it waits for the second, who is here."""
        followed = False
        patience_s = RELEASE_S if command["release"] else COMMAND_S
        while command["state"] not in ENDED:
            if command["state"] == State.ACCEPTED_SELECTION and not followed:
                if self._is_old(request, patience_s):  # whoever asked has given it up
                    await self._ask("POST", f"commands/{command['id']}/cancel", {})
                    return Result.TOO_OLD
                if command["release"]:
                    self.ends.append((request, Result.NONE))
                else:
                    followed = True
                    await self._ask("POST", f"commands/{command['id']}/execute", {})
            elif command["state"] == State.EXECUTING:
                self.ends.append((request, Result.NONE))
            await asyncio.sleep(ASK_S)
            command = await self._ask("GET", f"commands/{command['id']}")
        if command["state"] == State.INTERRUPTED_SELECTION:  # somebody here does not want it
            return Result.INTERLOCK
        return RESULTS.get(command["result"], Result.NOT_COMMANDABLE)

    @staticmethod
    def _is_old(request: Request, patience_s: float) -> bool:
        return time.monotonic_ns() - request.time_ns > patience_s * 10**9

    async def _ask(self, method: str, path: str, body: Json | None = None) -> Any:
        assert self.session
        url = f"{self.url}/api/{path}"
        async with self.session.request(method, url, json=body, ssl=self.tls or True) as response:
            answer = await response.json()
        if response.status >= 400:
            raise RefusedError(answer.get("code", ""))
        return answer


class Points:
    """The module's points, and the scans."""

    def __init__(self, module: Module) -> None:
        self.module = module
        self.below = Below(module.config)
        self.names: defaultdict[Place, list[tuple[str, str]]] = defaultdict(list)  # and the part of the value
        for name, (station, ca, ioa, part) in module.config["points"].items():
            self.names[station, ca, ioa].append((name, part))
        self.place_of = {name: place for place, names in self.names.items() for name, _ in names}
        self.last: dict[Place, Json] = {}  # as it was told
        self.up: dict[str, bool] = {}
        self.since: dict[str, int] = {}
        self.rest: deque[tuple[Place, Json, bool]] = deque()  # to be written yet, and whether it counts

    def scan(self) -> None:
        """A point is written once in a scan: what else is told of it waits: each change is an event."""
        for selection in self.module.selections():
            if not self._can(selection.name):
                selection.refuse(Result.NOT_COMMANDABLE)
        for request in self.module.requests():
            if not self._can(request.name):
                request.refuse(Result.NOT_COMMANDABLE)
            elif self.module.points[request.name].type == "step" and not request.step:
                request.refuse(Result.OUT_OF_RANGE)  # the station takes steps, no positions
            else:
                value = request.step or float(request.value)
                self.below.command(request, self.place_of[request.name], value)
        written: set[Place] = set()
        while self.rest or self.below.news:
            if not self.rest:
                self._take(*self.below.news.popleft())
            while self.rest and self.rest[0][0] not in written:
                written.add(self.rest[0][0])
                self._write(*self.rest.popleft())
            if self.rest:
                break
        self._end_commands()

    def _can(self, name: str) -> bool:
        """Now, or not at all: a command does not wait for a station."""
        return self.up.get(self.place_of[name][0], False)

    def _end_commands(self) -> None:
        with suppress(IndexError):
            while True:
                request, result = self.below.ends.popleft()
                if result == Result.NONE:
                    request.confirm()
                elif result == Result.DONE:
                    request.done()
                else:
                    request.refuse(result)

    def _take(self, values: list[tuple[Place, Json]], links: list[Linked], collects: bool, lost: str) -> None:
        """A value counts if it came since the station's link is up; until then it is an old one."""
        if lost:
            self.module.log(f"the centre: {lost}; its points are invalid", Level.WARNING)
        before = dict(self.up)
        since = dict(self.since)
        for name, is_up, at in links:
            self.up[name], self.since[name] = is_up, at
        if not collects:
            self.up = dict.fromkeys(self.up, False)
        fallen = {name for name, was_up in before.items() if was_up and not self.up[name]}
        for place, value in values:
            if place in self.names:
                began = (since if place[0] in fallen else self.since).get(place[0], 0)
                counts = (self.up.get(place[0], False) or place[0] in fallen) and value["received"] >= began
                self.last[place] = value
                self.rest.append((place, value, counts))
        changed = {
            name
            for name in self.up
            if self.up[name] != before.get(name) or self.since[name] != since.get(name)
        }
        for place in self.names:
            value = self.last.get(place, {})
            if place[0] in changed and not (
                self.up[place[0]] and value.get("received", 0) >= self.since[place[0]]
            ):
                self.rest.append((place, value, False))

    def _write(self, place: Place, value: Json, counts: bool) -> None:
        behind = time.time_ns() - value.get("at", 0) * NS_PER_MS
        for name, part in self.names[place]:
            number = value.get(part) if counts else None
            if number is None:  # or an object of another type than the list says
                self.module.write(name, self.module[name].value, UNTOLD)
            else:
                with suppress(ValueError):  # beyond the type: it is invalid now
                    self.module.write(name, number, Quality(value["quality"]), time.monotonic_ns() - behind)


def main() -> None:
    with Module() as module:
        try:
            points = Points(module)
        except (OSError, KeyError) as error:
            raise SystemExit(
                f"centre.station: {error!r}: the configuration is not that of `openrtu centre FILE station`"
            ) from None
        points.below.start()
        for _ in module.scans():
            points.scan()


if __name__ == "__main__":
    main()
