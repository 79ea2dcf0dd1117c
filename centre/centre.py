# SPDX-License-Identifier: GPL-3.0-or-later
"""The parts together: the collector's socket, the database, and who watches what changes."""

from __future__ import annotations

import asyncio
import logging
import socket
import time
from collections.abc import Awaitable, Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from itertools import count
from typing import Any, Protocol, TypeVar

from openrtu_tools.centre import records, users
from openrtu_tools.centre.alarms import NETWORK
from openrtu_tools.centre.codes import Ask, Kind, Result, State
from openrtu_tools.centre.database import open_store
from openrtu_tools.centre.errors import CentreError, RefusedError, StoreError
from openrtu_tools.centre.intake import Intake
from openrtu_tools.centre.keep import Keeper
from openrtu_tools.centre.makers import Makers
from openrtu_tools.centre.model import Alarm, Changes, Command, Json, Model, Point, Station
from openrtu_tools.centre.pictures import Pictures
from openrtu_tools.centre.records import ENDED
from openrtu_tools.centre.settings import Keep, Settings
from openrtu_tools.centre.store import Database, audit
from openrtu_tools.centre.trace import STATIONS_MOST, Trace

Answer = TypeVar("Answer")
log = logging.getLogger("centre")

SLOW_S = 5.0  # a database that takes longer is said to be at fault
AGAIN_S = 1.0  # until the next attempt: to connect, to store
DUE_EVERY_S = 0.5  # looks for what has lasted long enough for an alarm
KEEP_EVERY_S, KEEP_REST_S = 3600.0, 0.02  # between rounds, and between steps that are full
ROLL_EVERY_S = 30.0
RELEASE_S = 60.0  # a command that nothing was sent of waits so long for the second person
PACKETS_MOST = 4  # in one transaction: no more can be in flight
REQUEST_IDS = 1 << 48  # of what is no command
DOUBT_S, DOUBT_AGAIN_S = 1.0, 10.0  # until the first interrogation, and the next one
DOUBT_TRIES = 90  # looks for its end: rtu-centre waits 10 s for its confirmation and 60 s for its end


class Watcher(Protocol):
    """Is told what was stored."""

    def changed(self, changes: Changes, linked: set[int]) -> None: ...


class Actor(Protocol):
    """Who does something: a session, or a program that the file lets in."""

    @property
    def user(self) -> str: ...

    def still(self, database: Database) -> None:
        """Raises RefusedError unless it may yet: part of the transaction that does it."""


class Centre:
    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.store = open_store(settings.database, alone=True)
        self.intake: Intake = self.store.transaction(
            lambda database: Intake(database, settings.stations, settings.areas, settings.alarms)
        )
        self.intake.stored()
        self.model = Model()  # the loop's own: the intake's belongs to the writer
        for kind in ("stations", "points", "alarms", "commands", "causes"):
            getattr(self.model, kind).update(getattr(self.intake.model, kind))
        self.watchers: set[Watcher] = set()
        self.fault = ""  # why nothing can be stored now
        self.ending = False  # nothing more is stored: what is stranded then, the next start ends
        self.makers = Makers(settings.database)
        self.pictures = Pictures(settings.pictures)
        self._sockets: dict[int, socket.socket] = {}  # by shard of rtu-centre
        self._ids = count(REQUEST_IDS)
        self._tasks: set[asyncio.Task[None]] = set()
        self.traces: dict[int, Trace] = {}  # by station
        self._doubts: dict[tuple[int, int], asyncio.Task[None]] = {}  # by station and common address

    def close(self) -> None:
        self.store.close()

    @property
    def collects(self) -> bool:
        return len(self._sockets) == len(self.settings.sockets)

    # ---- the database ------------------------------------------------------------------------

    async def change(self, work: Callable[[Database], Answer]) -> Answer:
        """Work in a transaction; then all who watch are told. Nothing is told that is not on the disk."""

        def whole() -> tuple[Answer, Changes]:
            self.intake.begin()
            answer = self.store.transaction(work)
            return answer, self.intake.stored()

        answer, changes = await self._patiently(self.store.in_writer(whole))
        linked = {
            id_
            for id_, station in changes.stations.items()
            if id_ not in self.model.stations or self.model.stations[id_].link != station.link
        }
        self.model.take(changes)
        for id_, command in changes.commands.items():
            if command.state in ENDED:
                self.model.commands.pop(id_, None)
        for address in changes.doubts - self._doubts.keys():
            self._doubts[address] = asyncio.create_task(self._resolve(address))
        if changes.any:
            for watcher in self.watchers:
                watcher.changed(changes, linked)
        return answer

    async def _patiently(self, storing: Awaitable[Answer]) -> Answer:
        """A database that does not answer is a fault, too, though what was asked may be done yet."""
        task = asyncio.ensure_future(storing)
        done, _ = await asyncio.wait({task}, timeout=SLOW_S)
        slow = f"it has not answered for {SLOW_S:g} s"
        if not done and not self.fault:
            self._say(slow)
        try:
            return await task
        finally:  # a refusal is an answer, too
            if self.fault == slow:
                self._say("")

    def _say(self, fault: str) -> None:
        if fault and fault != self.fault:
            log.error("the database: %s; nothing is acknowledged until it works again", fault)
        elif self.fault and not fault:
            log.info("the database works again")
        changed = fault != self.fault
        self.fault = fault
        if changed:
            self._notify()

    async def _store(self, work: Callable[[Database], None]) -> None:
        """Until it is stored: what is not acknowledged the stations keep."""
        while True:
            try:
                await self.change(work)
            except StoreError as error:
                self._say(str(error))
                await asyncio.sleep(AGAIN_S)
            else:
                self._say("")
                return

    async def _resolve(self, address: tuple[int, int]) -> None:
        """Old events came of an address: it is interrogated until none is left that is in doubt.

        First its queue shall be empty; and a clock that is behind shall not have it asked without a pause.
        """
        pause_s = DOUBT_S
        try:
            while self.intake.doubted.get(address):
                await asyncio.sleep(pause_s)
                pause_s = DOUBT_AGAIN_S
                with suppress(RefusedError):
                    await self._ask_again(*address)
        finally:
            del self._doubts[address]

    async def _ask_again(self, station_id: int, ca: int) -> None:
        """Until rtu-centre has said how the interrogation ended, or is gone and says nothing."""
        station, id_ = self.station(station_id), next(self._ids)
        self.intake.asked[id_] = station_id, ca
        try:
            await self._send(station, records.request(Ask.INTERROGATE, station.place, ca, id_, 20))
            for _ in range(DOUBT_TRIES):
                if id_ not in self.intake.asked:
                    break
                await asyncio.sleep(DOUBT_S)
        finally:
            self.intake.asked.pop(id_, None)

    def _notify(self) -> None:
        """The state of the centre itself has changed."""
        for watcher in self.watchers:
            watcher.changed(Changes(), set())

    async def raise_due(self) -> None:
        """Alarms whose causes have lasted long enough, for ever."""
        while True:
            await asyncio.sleep(DUE_EVERY_S)
            now_ns = time.time_ns()
            if any(cause.due_ns <= now_ns for cause in self.model.causes.values()):
                with suppress(StoreError):  # the next record says what is wrong
                    await self.change(self.intake.due)

    async def keep(self) -> None:
        """Lets go of what is too old, for ever."""
        while self.settings.keep != Keep():
            keeper = Keeper(self.settings.keep, self.settings.gap_s, drop_weeks=self.store.drop_weeks)
            steps: list[Callable[[Database], bool]] = [keeper.old_rows]
            for point in list(self.model.points.values()):
                if point.is_position:
                    steps.append(partial(keeper.track, point=point.id))
            for step in steps:
                try:
                    while await self.store.write(step):
                        await asyncio.sleep(KEEP_REST_S)
                except StoreError as error:
                    log.warning("what is too old stays for now: %s", error)
                    break
                await asyncio.sleep(0)
            await asyncio.sleep(KEEP_EVERY_S)

    async def roll_up(self) -> None:
        """Sums up what is over, for ever."""
        while True:
            try:
                while await self.store.write(self.intake.rollup.step):
                    await asyncio.sleep(KEEP_REST_S)
            except StoreError as error:
                log.warning("trends are read from the history for now: %s", error)
            await asyncio.sleep(ROLL_EVERY_S)

    # ---- the collector -----------------------------------------------------------------------

    async def collect(self) -> None:
        """Takes what rtu-centre hands over, for ever."""
        async with asyncio.TaskGroup() as shards:
            for shard in range(len(self.settings.sockets)):
                shards.create_task(self._collect(shard))

    async def _collect(self, shard: int) -> None:
        last_error = ""
        while True:
            try:
                await self._session(shard)
            except (OSError, CentreError) as error:
                if str(error) != last_error:
                    last_error = str(error)
                    log.warning("rtu-centre at %s: %s; trying again", self.settings.sockets[shard], error)
            await asyncio.sleep(AGAIN_S)

    async def _session(self, shard: int) -> None:
        loop = asyncio.get_running_loop()
        path = self.settings.sockets[shard]

        def polled(station: Station) -> bool:
            return self.settings.shard(station.place) == shard

        with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as connection:
            connection.setblocking(False)
            await loop.sock_connect(connection, str(path))
            log.info("rtu-centre at %s is connected", path)
            self._sockets[shard] = connection
            self._notify()
            try:
                while octets := await loop.sock_recv(connection, records.PACKET_MAX):
                    sequence, batch = records.read_batch(octets)
                    for octets in self._more(connection):
                        sequence, more = records.read_batch(octets)
                        batch += more
                    await self._store(lambda database, batch=batch: self.intake.take(database, batch))
                    self._trace(batch)
                    await loop.sock_sendall(connection, records.acknowledgement(sequence))
            finally:
                del self._sockets[shard]
                self.traces = {
                    id_: trace for id_, trace in self.traces.items() if not polled(self.model.stations[id_])
                }
                if not self.ending:
                    await self._store(lambda database: self.intake.stranded(database, polled))
                    self._notify()
        raise CentreError("it has ended, or has another consumer")

    @staticmethod
    def _more(connection: socket.socket) -> list[bytes]:
        found = []
        with suppress(BlockingIOError):
            while len(found) < PACKETS_MOST - 1 and (octets := connection.recv(records.PACKET_MAX)):
                found.append(octets)
        return found

    def _socket_of(self, station: Station) -> socket.socket:
        connection = self._sockets.get(self.settings.shard(station.place))
        if connection is None:
            raise RefusedError(503, "no_collector", "rtu-centre does not run: nothing can be sent")
        return connection

    async def _send(self, station: Station, octets: bytes) -> None:
        connection = self._socket_of(station)
        try:
            await asyncio.get_running_loop().sock_sendall(connection, octets)
        except OSError as error:
            raise RefusedError(503, "no_collector", f"rtu-centre does not take it: {error}") from error

    # ---- what users do -----------------------------------------------------------------------

    def point(self, id_: int) -> Point:
        if id_ not in self.model.points:
            raise RefusedError(404, "unknown", f"there is no point {id_}")
        return self.model.points[id_]

    def station(self, id_: int) -> Station:
        if id_ not in self.model.stations:
            raise RefusedError(404, "unknown", f"there is no station {id_}")
        return self.model.stations[id_]

    def _check_up(self, station: Station) -> None:
        self._socket_of(station)
        if not station.up:
            raise RefusedError(409, "not_up", f"{station.settings.name} is not connected: nothing was sent")

    async def command(self, by: Actor, point_id: int, value: float) -> Command:
        """Stores and sends a selection, or the command of a point that has none. Never later than now."""
        point = self.point(point_id)
        meaning = point.meaning
        station = self.station(point.station)
        try:
            if not meaning.command:
                raise RefusedError(409, "no_command", f"{meaning.name} takes no commands")
            low, high = meaning.minimum, meaning.maximum
            if (low is not None and value < low) or (high is not None and value > high):
                raise RefusedError(409, "out_of_range", f"{meaning.name} takes {low} to {high}")
            self._check_up(station)
            address = (station.place, point.ca, point.ioa)
            try:
                records.command(*address, 1, meaning.command, value, meaning.selects)
            except (CentreError, ValueError, OverflowError) as error:
                raise RefusedError(409, "out_of_range", str(error)) from error
        except RefusedError as error:
            await self._refuse(by.user, point, value, error)
            raise
        release = station.settings.release
        state = State.SELECTION_REQUEST if meaning.selects else State.EXECUTION_REQUEST
        if release and not meaning.selects:
            state = State.ACCEPTED_SELECTION  # by the centre: nothing is sent until somebody releases it
        now_ns = time.time_ns()
        new = Command(
            0,
            by.user,
            point.id,
            value,
            int(meaning.selects),
            state,
            Result.NONE,
            0,
            now_ns,
            now_ns,
            int(release),
        )

        def add(database: Database) -> Command:
            """One transaction looks and stores: of two that come at once, one is refused."""
            by.still(database)
            if self.intake.is_commanded(point.id):
                raise RefusedError(409, "busy", f"another command of {meaning.name} is not ended")
            audit(
                database,
                now_ns,
                by.user,
                "select" if meaning.selects else "command",
                f"{meaning.name} = {value:g}",
                station.id,
            )
            return self.intake.add_command(database, new)

        try:
            command = await self.change(add)
        except RefusedError as error:
            await self._refuse(by.user, point, value, error)
            raise
        if command.held:
            task = asyncio.create_task(self._expire(command.id))
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)
        else:
            await self._send_command(
                station,
                command.id,
                records.command(*address, command.id, meaning.command, value, meaning.selects),
            )
        return command

    async def _refuse(self, user: str, point: Point, value: float, error: RefusedError) -> None:
        """Nothing is sent; the audit says so."""
        text = f"{point.meaning.name} = {value:g}: {error}"
        await self.store.write(
            lambda database: audit(database, time.time_ns(), user, "command refused", text, point.station)
        )

    async def _expire(self, id_: int) -> None:
        """Nobody has released it. Of a selection at a station the station itself sees to that."""
        await asyncio.sleep(RELEASE_S)

        def end(database: Database) -> None:
            now = self.intake.model.commands.get(id_)
            if now and now.state == State.ACCEPTED_SELECTION:
                self.intake.end_command(database, id_, State.INTERRUPTED_SELECTION, Result.NONE)

        await self._store(end)

    async def _send_command(self, station: Station, id_: int, octets: bytes) -> None:
        try:
            await self._send(station, octets)
        except RefusedError:
            await self.change(
                lambda database: self.intake.end_command(database, id_, State.REFUSED_COMMAND, Result.NOT_UP)
            )
            raise

    async def follow(self, by: Actor, id_: int, execute: bool) -> Command:
        """Executes or cancels what is selected. Only who selected may; to release it, only somebody else."""
        command = self.model.commands.get(id_)
        if not command or command.state != State.ACCEPTED_SELECTION:
            raise RefusedError(
                409, "not_selected", f"command {id_} is not selected: it ended, or was executed"
            )
        if command.release and execute and command.user == by.user:
            raise RefusedError(403, "second", f"command {id_} is yours: a second person must release it")
        if not command.release and command.user != by.user:
            raise RefusedError(403, "not_yours", f"command {id_} was selected by {command.user}")
        point = self.point(command.point)
        station = self.station(point.station)
        if execute:
            self._check_up(station)
        action = ("release" if command.release else "execute") if execute else "cancel"
        state = State.EXECUTION_REQUEST if execute else State.INTERRUPTION_REQUEST
        if command.held and not execute:
            state = State.INTERRUPTED_SELECTION

        def put(database: Database) -> Command:
            by.still(database)
            now = self.intake.model.commands.get(id_)
            if not now or now.state != State.ACCEPTED_SELECTION:
                raise RefusedError(409, "not_selected", f"command {id_} is not selected any more")
            if execute and now.release:
                self._check_may(database, now.user, station)
            text = f"{point.meaning.name} = {command.value:g}"
            audit(database, time.time_ns(), by.user, action, text, station.id)
            following = replace(now, state=state, changed_ns=time.time_ns())
            self.intake.put_command(database, following)
            return following

        following = await self.change(put)
        kind = Ask.EXECUTE if execute else Ask.CANCEL
        if not command.held:
            await self._send_command(station, id_, records.request(kind, station.place, point.ca, id_))
        elif execute:
            await self._send_command(
                station,
                id_,
                records.command(
                    station.place, point.ca, point.ioa, id_, point.meaning.command, command.value, False
                ),
            )
        return following

    def _check_may(self, database: Database, user: str, station: Station) -> None:
        """Who asked for a command may have been removed since, or limited."""
        by_bus = user == users.BUS and self.settings.mqtt and self.settings.mqtt.commands
        if not by_bus and not users.may_command(database, user, station):
            raise RefusedError(409, "withdrawn", f"{user} may not command it any more: cancel it")

    async def interrogate(self, by: Actor, station_id: int) -> list[int]:
        """A general interrogation of each common address that is known of the station."""
        station = self.station(station_id)
        self._check_up(station)
        addresses = sorted({point.ca for point in self.model.points.values() if point.station == station_id})

        def note(database: Database) -> None:
            by.still(database)
            audit(database, time.time_ns(), by.user, "interrogate", station=station_id)

        await self.store.write(note)
        for ca in addresses:
            await self._send(
                station, records.request(Ask.INTERROGATE, station.place, ca, next(self._ids), 20)
            )
        return addresses

    async def trace(self, by: Actor, station_id: int, after: int) -> list[Json]:
        """The frames of a station; it is traced from now on, as long as somebody asks."""
        station = self.station(station_id)
        for id_, other in list(self.traces.items()):
            if other.left and id_ != station_id:
                await self._end_trace(id_)
        trace = self.traces.get(station_id) or await self._begin_trace(by, station)
        return trace.after(after)

    async def _begin_trace(self, by: Actor, station: Station) -> Trace:
        """Its place is taken before anything is awaited; no frame comes before the audit has it."""
        if len(self.traces) >= STATIONS_MOST:
            raise RefusedError(409, "busy", f"{STATIONS_MOST} stations are traced already")

        def note(database: Database) -> None:
            by.still(database)
            audit(database, time.time_ns(), by.user, "trace", station=station.id)

        trace = self.traces[station.id] = Trace(asked_s=time.monotonic())
        try:
            await self.store.write(note)
            await self._send(station, records.trace(station.place, next(self._ids), True))
        except BaseException:
            self.traces.pop(station.id, None)
            raise
        task = asyncio.create_task(self._watch_trace(station.id))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return trace

    async def _watch_trace(self, station_id: int) -> None:
        while station_id in self.traces and not self.traces[station_id].left:
            await asyncio.sleep(AGAIN_S)
        await self._end_trace(station_id)

    async def _end_trace(self, station_id: int) -> None:
        if self.traces.pop(station_id, None):
            station = self.station(station_id)
            with suppress(RefusedError):  # without rtu-centre there is none
                await self._send(station, records.trace(station.place, next(self._ids), False))

    def _trace(self, batch: list[records.Record]) -> None:
        """What was stored, and now is looked at."""
        if not self.traces:
            return
        by_place = {self.model.stations[id_].place: trace for id_, trace in self.traces.items()}
        for record in batch:
            if record.kind == Kind.OCTETS and record.station in by_place:
                by_place[record.station].take(record)

    async def acknowledge(self, by: Actor, id_: int) -> Alarm:
        """Who comes second is told who came first."""

        def put(database: Database) -> Alarm:
            by.still(database)
            return self._acknowledge(database, by.user, id_)

        return await self.change(put)

    async def acknowledge_many(self, by: Actor, ids: list[int]) -> list[int]:
        """Those of them that nobody had acknowledged before. One transaction, however many."""

        def put(database: Database) -> list[int]:
            by.still(database)
            done = []
            for id_ in dict.fromkeys(ids):
                with suppress(RefusedError):
                    done.append(self._acknowledge(database, by.user, id_).id)
            return done

        return await self.change(put)

    def _acknowledge(self, database: Database, user: str, id_: int) -> Alarm:
        """Raises RefusedError."""
        alarm = self._open_alarm(id_)
        if alarm.acknowledged_ns is not None:
            raise RefusedError(409, "acknowledged", f"{alarm.acknowledged_by} has acknowledged it")
        audit(database, time.time_ns(), user, "acknowledge", f"alarm {id_}: {alarm.kind}", alarm.station)
        alarm = replace(alarm, acknowledged_ns=time.time_ns(), acknowledged_by=user)
        self.intake.alarms.put(database, alarm)
        if alarm.kind == NETWORK:
            self._acknowledge_parts(database, alarm)
        return alarm

    def _acknowledge_parts(self, database: Database, network: Alarm) -> None:
        """Who acknowledges a fault of the network acknowledges each station that is lost by it."""
        for part in [*self.intake.model.alarms.values()]:
            if part.suppressed_by == network.id and part.acknowledged_ns is None:
                assert network.acknowledged_by
                self._acknowledge(database, network.acknowledged_by, part.id)

    async def shelve(self, by: Actor, id_: int, minutes: float, why: str) -> Alarm:
        """Out of sight for a time; 0 brings it back."""

        def put(database: Database) -> Alarm:
            by.still(database)
            until_ns = time.time_ns() + int(minutes * 60e9) if minutes else 0
            alarm = replace(
                self._open_alarm(id_), shelved_until_ns=until_ns, shelved_why=why if minutes else ""
            )
            text = f"alarm {id_}: {alarm.kind}, {minutes:g} min{': ' if why else ''}{why}"
            audit(database, time.time_ns(), by.user, "shelve", text, alarm.station)
            self.intake.alarms.put(database, alarm)
            return alarm

        return await self.change(put)

    def _open_alarm(self, id_: int) -> Alarm:
        """In the writer's thread. One that has ended since was acknowledged by somebody."""
        alarm = self.intake.changes.alarms.get(id_) or self.intake.model.alarms.get(id_)
        if not alarm:
            raise RefusedError(409, "gone", f"alarm {id_} is gone and acknowledged, or there is none")
        return alarm

    def state(self) -> dict[str, Any]:
        """Of the centre itself."""
        return {"collects": self.collects, "fault": self.fault, "now": time.time_ns() // 1_000_000}
