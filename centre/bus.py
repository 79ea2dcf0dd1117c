# SPDX-License-Identifier: GPL-3.0-or-later
"""What changes, as JSON on MQTT: docs/control-centre.md, "MQTT"."""

from __future__ import annotations

import asyncio
import json
import logging
import math
import ssl
import time
from collections import defaultdict, deque
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import paho.mqtt.client as mqtt
from paho.mqtt.enums import CallbackAPIVersion
from paho.mqtt.properties import Properties
from paho.mqtt.subscribeoptions import SubscribeOptions

from openrtu_tools.centre.centre import Centre
from openrtu_tools.centre.errors import CentreError, RefusedError
from openrtu_tools.centre.model import NS_PER_MS, Changes, Json
from openrtu_tools.centre.settings import Mqtt
from openrtu_tools.centre.store import Database
from openrtu_tools.centre.users import BUS

log = logging.getLogger("centre")

KEEPALIVE_S = 15  # a broker tells of our death after one and a half of these
RETRY_S, RETRY_MOST_S = 1, 30
AT_ONCE = 500  # messages that the broker has not confirmed
REST_S = 0.01
COMMAND_OCTETS = 4096
LEAST_ONCE = 1  # quality of service
OFFLINE = json.dumps({"online": False})


def _segment(name: str) -> str:
    """A name as one level of a topic."""
    return "".join(f"%{ord(each):02X}" if each in "/+#%" or each < " " else each for each in name)


@dataclass
class Waiting:
    """By id, what the broker has not been told."""

    stations: set[int] = field(default_factory=set)
    births: set[int] = field(default_factory=set)  # of stations, or deaths
    points: set[int] = field(default_factory=set)


class Bus:
    """Watches the centre, and tells a broker.

    What the broker has not been told is bounded, however slow it is or gone: ids, no messages. With each
    connection it is told all.
    """

    user = BUS  # in the audit

    def __init__(self, centre: Centre, settings: Mqtt) -> None:
        self.centre = centre
        self.settings = settings
        self.prefix = settings.prefix
        self.waiting = Waiting()
        self.points_of: defaultdict[int, set[int]] = defaultdict(set)  # by station, as it was born with them
        self.alarms: dict[int, Json] = {}  # one that ends is no longer in the model
        self.commands: dict[int, Json] = {}
        self.something = asyncio.Event()
        self.born = 0  # while there is a connection: since when, in ms
        self._known: set[str] = set()  # topics, at its begin
        self._sent: deque[mqtt.MQTTMessageInfo] = deque()
        self._loop = asyncio.get_running_loop()
        self._tasks: set[asyncio.Task[None]] = set()
        self.client = self._client()

    def _client(self) -> mqtt.Client:
        made = mqtt.Client(CallbackAPIVersion.VERSION2, protocol=mqtt.MQTTv5)
        made.on_connect = self._connected
        made.on_disconnect = self._disconnected
        made.on_message = self._on_message
        made.reconnect_delay_set(RETRY_S, RETRY_MOST_S)
        made.max_inflight_messages_set(AT_ONCE)
        made.will_set(self.topic("centre"), OFFLINE, LEAST_ONCE, retain=True)
        if self.settings.user:
            made.username_pw_set(self.settings.user, self.settings.password())
        tls = self.settings.tls
        if tls:
            try:
                context = ssl.create_default_context(cafile=tls.ca)
                if tls.certificate:
                    context.load_cert_chain(tls.certificate, tls.key)
            except OSError as error:
                raise CentreError(f"mqtt: tls: {error}; are the files there, readable and in PEM?") from error
            made.tls_set_context(context)
        return made

    def topic(self, *levels: str | int) -> str:
        return "/".join([self.prefix, *map(str, levels)])

    def station_topic(self, id_: int) -> str:
        return self.topic("station", _segment(self.centre.model.stations[id_].settings.name))

    def point_topic(self, id_: int) -> str:
        point = self.centre.model.points[id_]
        return f"{self.station_topic(point.station)}/point/{point.ca}/{point.ioa}"

    # ---- what the centre says ----------------------------------------------------------------

    def changed(self, changes: Changes, linked: set[int]) -> None:
        """A station is told of when its link changes; how often it was heard is nobody's news."""
        if not self.born:
            return
        self.waiting.stations |= linked
        self.waiting.births |= linked
        self.waiting.points |= changes.points.keys()
        for point in changes.points.values():
            if point.id not in self.points_of[point.station]:
                self.points_of[point.station].add(point.id)
                self.waiting.births.add(point.station)
        self.alarms |= {id_: alarm.view() for id_, alarm in changes.alarms.items()}
        self.commands |= {id_: command.view() for id_, command in changes.commands.items()}
        self.something.set()

    async def run(self) -> None:
        """Until it is cancelled; then the broker is told that it is by intention."""
        settings = self.settings
        self.client.connect_async(settings.host, settings.port, KEEPALIVE_S, clean_start=True)
        self.client.loop_start()
        self.centre.watchers.add(self)
        try:
            while True:
                await self.something.wait()
                self.something.clear()
                for message in self._messages():
                    await self._publish(*message)
        finally:
            self.centre.watchers.discard(self)
            await asyncio.to_thread(self._leave)

    def _leave(self) -> None:
        """A disconnection that is asked for raises no last will, so the broker is told here."""
        if self.born:
            last = self.client.publish(self.topic("centre"), OFFLINE, LEAST_ONCE, retain=True)
            with suppress(ValueError, RuntimeError):  # the connection has ended meanwhile
                last.wait_for_publish(RETRY_S)
        self.client.disconnect()
        self.client.loop_stop()

    def _messages(self) -> Iterable[tuple[str, Json | None, bool]]:
        """Topic, content, whether the broker keeps it. The last value counts: it is read when it is sent."""
        model = self.centre.model
        waiting, alarms, commands = self.waiting, self.alarms, self.commands
        self.waiting, self.alarms, self.commands = Waiting(), {}, {}
        for id_ in waiting.stations:
            yield self.station_topic(id_), model.stations[id_].view(), True
        for id_ in waiting.births:
            yield f"{self.station_topic(id_)}/birth", self._station_birth(id_), True
        for id_ in waiting.points:
            station = model.stations[model.points[id_].station].settings.name
            yield self.point_topic(id_), {**model.points[id_].view(), "station": station}, True
        for id_, view in alarms.items():
            view["station"] = model.stations[view["station"]].settings.name
            is_open = view["gone"] is None or view["acknowledged"] is None
            yield self.topic("alarm", id_), view, is_open
            if not is_open:
                yield self.topic("alarm", id_), None, True
        for id_, view in commands.items():
            yield self.topic("command", id_), view, False

    def _station_birth(self, id_: int) -> Json:
        """With its points; or that it has died."""
        station = self.centre.model.stations[id_]
        if not station.up:
            return {"online": False}
        points = [self.centre.model.points[point].listed() for point in sorted(self.points_of[id_])]
        return {"online": True, "since": station.since_ns // NS_PER_MS, "points": points}

    async def _publish(self, topic: str, content: Json | None, keep: bool) -> None:
        """Waits while too much is not confirmed: meanwhile values change, and the last one counts."""
        while len(self._sent) >= AT_ONCE:
            while self._sent and self._sent[0].is_published():
                self._sent.popleft()
            if len(self._sent) >= AT_ONCE:
                await asyncio.sleep(REST_S)
        octets = b"" if content is None else json.dumps(content).encode()
        self._sent.append(self.client.publish(topic, octets, LEAST_ONCE, retain=keep))

    def still(self, database: Database) -> None:
        """The file lets it command, as long as the centre runs."""

    # ---- what the broker says: in paho's thread -------------------------------------------------

    def _in_loop(self, work: Callable[..., Any], *values: Any) -> None:
        self._loop.call_soon_threadsafe(work, *values)

    def _connected(self, client: mqtt.Client, _: Any, __: Any, reason: Any, ___: Properties | None) -> None:
        if reason.is_failure:
            log.warning("mqtt at %s: %s; trying again", self.settings.host, reason)
            return
        self._in_loop(self._birth)
        wanted = [(self.topic("station", "#"), SubscribeOptions(LEAST_ONCE, noLocal=True)),
                  (self.topic("alarm", "+"), SubscribeOptions(LEAST_ONCE, noLocal=True)),
                  (self.topic("centre"), SubscribeOptions(LEAST_ONCE, noLocal=True))]  # fmt: skip
        if self.settings.commands:
            wanted.append((self.topic("do"), SubscribeOptions(0, noLocal=True)))
        client.subscribe(wanted)

    def _disconnected(self, _: Any, __: Any, ___: Any, reason: Any, ____: Any) -> None:
        self._in_loop(self._death, str(reason))

    def _on_message(self, _: Any, __: Any, message: mqtt.MQTTMessage) -> None:
        if message.topic == self.topic("do"):
            if not message.retain:  # what the broker has kept was meant for another time
                self._in_loop(self._do, message.payload)
        elif message.topic == self.topic("centre"):
            if not message.retain and message.payload == OFFLINE.encode():
                self._in_loop(self._said_dead)
        elif message.retain and message.payload:
            self._in_loop(self._kept, message.topic)

    # ---- and in ours ---------------------------------------------------------------------------

    def _birth(self) -> None:
        """All is told once more: the broker may be another one, and what it kept may be old."""
        log.info("mqtt at %s is connected", self.settings.host)
        model = self.centre.model
        self.born = time.time_ns() // NS_PER_MS
        self._say_birth()
        self.points_of.clear()
        for point in model.points.values():
            self.points_of[point.station].add(point.id)
        stations = set(model.stations)
        self.waiting = Waiting(stations, set(stations), set(model.points))
        self.alarms = {id_: alarm.view() for id_, alarm in model.alarms.items()}
        self.commands = {id_: command.view() for id_, command in model.commands.items()}
        self._known = {self.topic("alarm", id_) for id_ in self.alarms}
        self._known |= {*map(self.station_topic, model.stations), *map(self.point_topic, model.points)}
        self._known |= {f"{self.station_topic(id_)}/birth" for id_ in model.stations}
        self.something.set()

    def _say_birth(self) -> None:
        birth = {"online": True, "since": self.born}
        self.client.publish(self.topic("centre"), json.dumps(birth), LEAST_ONCE, retain=True)

    def _said_dead(self) -> None:
        """By the last will of a connection that the broker gives up after the birth of this one."""
        if self.born:
            self._say_birth()

    def _death(self, reason: str) -> None:
        if self.born:
            log.warning("mqtt at %s: %s; trying again", self.settings.host, reason)
        self.born = 0

    def _kept(self, topic: str) -> None:
        """What is no more, the broker shall forget."""
        if topic not in self._known:
            self.client.publish(topic, b"", LEAST_ONCE, retain=True)

    def _do(self, octets: bytes) -> None:
        task = asyncio.create_task(self._command(octets))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _command(self, octets: bytes) -> None:
        """A selection or a command, or what follows. The answer names it, or says why there is none."""
        asked: Any = None
        try:
            request = _object(octets)
            asked = request.get("id")
            for action in ("execute", "cancel"):
                if action in request:
                    await self._follow(request[action], action == "execute")
                    answer: Json = {"command": request[action]}
                    break
            else:
                value = request.get("value")
                if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
                    raise RefusedError(400, "form", "value: a finite number is needed")
                answer = {"command": (await self.centre.command(self, self._point(request), float(value))).id}
        except CentreError as error:
            answer = {"code": error.code if isinstance(error, RefusedError) else "store", "error": str(error)}
        await self._publish(self.topic("answer"), {"id": asked, **answer}, False)

    async def _follow(self, id_: Any, execute: bool) -> None:
        """Only its own: it is no second person for those of others."""
        command = self.centre.model.commands.get(id_) if isinstance(id_, int) else None
        if not command or command.user != self.user:
            raise RefusedError(403, "not_yours", f"{id_} is no open command of the bus")
        await self.centre.follow(self, command.id, execute)

    def _point(self, request: Json) -> int:
        model = self.centre.model
        for point in model.points.values():
            name = model.stations[point.station].settings.name
            if (name, point.ca, point.ioa) == (request.get("station"), request.get("ca"), request.get("ioa")):
                return point.id
        raise RefusedError(404, "unknown", "station, ca and ioa: there is no such point")


def _object(octets: bytes) -> Json:
    try:
        decoded = json.loads(octets) if len(octets) <= COMMAND_OCTETS else None
    except (ValueError, RecursionError):
        decoded = None
    if not isinstance(decoded, dict):
        raise RefusedError(400, "form", f"a command is an object of JSON, of at most {COMMAND_OCTETS} octets")
    return decoded
