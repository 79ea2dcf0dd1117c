# SPDX-License-Identifier: GPL-3.0-or-later
"""When an alarm comes and goes, and of which other one it is a part: docs/control-centre.md, "Alarms"."""

from __future__ import annotations

import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable
from dataclasses import astuple, fields, replace

from openrtu_tools.centre.codes import INVALID
from openrtu_tools.centre.model import Alarm, AlarmCause, AlarmKey, Changes, Json, Model, Point
from openrtu_tools.centre.settings import AlarmClass, AlarmRules, Meaning
from openrtu_tools.centre.store import Database, inserted, put

LOST, NETWORK = "lost", "network"
NETWORK_PRIORITY = 1
ALARM_COLUMNS = [column.name for column in fields(Alarm)]
CAUSE_COLUMNS = [column.name for column in fields(AlarmCause)]
CAUSE_KEY = "kind, station, place, area"


# ---- rules ---------------------------------------------------------------------------------------


def alarming(point: Point, rules: AlarmRules, is_active: Callable[[str], bool]) -> dict[str, bool]:
    """Of each kind of alarm that its list wants, whether its value is so. A limit that was passed is left
    when the value has come back by the deadband.
    """
    meaning, value = point.meaning, point.value
    if value is None or point.quality & INVALID:
        return {}

    def back(kind: str) -> float:
        return rules.deadband(kind, meaning) if is_active(kind) else 0.0

    found = {}
    if meaning.high is not None:
        found["high"] = value > meaning.high - back("high")
    if meaning.low is not None:
        found["low"] = value < meaning.low + back("low")
    if meaning.state is not None:
        found["state"] = value == meaning.state
    return found


def of_one_fault(lost: Iterable[Alarm], network: Alarm | None, rules: AlarmRules) -> list[Alarm]:
    """Which alarms of lost stations are one fault of the network: all that came within a time before the last
    one, if they are enough; then each that comes within that time of the last that is a part of it.
    """
    found = sorted(lost, key=lambda alarm: alarm.last_ns)
    if not found or not rules.network_stations:
        return []
    within_ns = int(rules.network_s * 1e9)
    if network and network.active:
        joined, last_ns = [], network.last_ns
        for alarm in found:
            if abs(alarm.last_ns - last_ns) <= within_ns:
                joined.append(alarm)
                last_ns = max(last_ns, alarm.last_ns)
        return joined
    newest_ns = found[-1].last_ns
    together = [alarm for alarm in found if alarm.last_ns >= newest_ns - within_ns]
    return together if len(together) >= rules.network_stations else []


def seen(alarm: Alarm, is_limited: bool) -> Alarm | None:
    """Who is limited to groups sees no fault of the whole network, but each station that is lost."""
    if not is_limited:
        return alarm
    if alarm.kind == NETWORK:
        return None
    return replace(alarm, suppressed_by=None) if alarm.kind == LOST else alarm


def views(alarms: Iterable[Alarm], is_limited: bool) -> list[Json]:
    return [each.view() for alarm in alarms if (each := seen(alarm, is_limited))]


# ---- in a transaction ----------------------------------------------------------------------------


class Alarms:
    """The open ones, and what may become one. Only the writer's thread calls it, within a transaction."""

    def __init__(self, model: Model, rules: AlarmRules) -> None:
        self.model = model
        self.rules = rules
        self.changes = Changes()
        self.now_ns = time.time_ns()
        self.open: dict[AlarmKey, int] = {}
        # Of the transaction under way.
        self.new: dict[AlarmKey, int] = {}
        self.came: Counter[int] = Counter()  # alarms, how often

    def load(self, database: Database) -> None:
        for row in database.execute("SELECT * FROM alarms WHERE gone_ns IS NULL OR acknowledged_ns IS NULL"):
            alarm = Alarm(**dict(row))
            self.model.alarms[alarm.id] = alarm
            self.open[alarm.key] = alarm.id
        for row in database.execute("SELECT * FROM causes"):
            cause = AlarmCause(**dict(row))
            self.model.causes[cause.key] = cause

    def begin(self, changes: Changes) -> None:
        self.changes = changes
        self.now_ns = time.time_ns()
        self.new.clear()
        self.came.clear()

    def stored(self) -> None:
        for alarm in self.changes.alarms.values():
            if alarm.open:
                self.open[alarm.key] = alarm.id
            elif self.open.get(alarm.key) == alarm.id:
                del self.open[alarm.key]

    def get(self, key: AlarmKey) -> Alarm | None:
        """The one that has not gone, or that nobody has acknowledged."""
        id_ = self.new.get(key) or self.open.get(key)
        alarm = None if id_ is None else self.changes.alarms.get(id_) or self.model.alarms[id_]
        return alarm if alarm and alarm.open else None

    def is_active(self, key: AlarmKey) -> bool:
        alarm = self.get(key)
        return alarm is not None and alarm.active

    def all(self) -> list[Alarm]:
        """As the transaction under way leaves them."""
        known = {**self.model.alarms, **self.changes.alarms}
        return [alarm for alarm in known.values() if alarm.open]

    def put(self, database: Database, alarm: Alarm) -> None:
        put(database, "alarms", ALARM_COLUMNS, astuple(alarm))
        self.changes.alarms[alarm.id] = alarm

    # ---- comes and goes ----------------------------------------------------------------------

    def raise_(
        self,
        database: Database,
        key: AlarmKey,
        priority: int,
        at_ns: int,
        point: Point | None = None,
        value: float | None = None,
    ) -> None:
        """It is so, since `at_ns` or before."""
        is_active, waiting = self.is_active(key), self._waiting(key)
        if is_active and not waiting:
            return
        kind, station, place, area = key
        ca, value = (point.ca, point.value) if point else (place, value)
        cause = AlarmCause(
            kind, station, place or 0, area or "", point and point.id, ca, priority, value, at_ns, 1
        )  # fmt: skip
        self._become(database, cause, waiting)

    def clear(self, database: Database, key: AlarmKey, at_ns: int) -> None:
        """It is not so."""
        alarm, waiting = self.get(key), self._waiting(key)
        is_active = alarm is not None and alarm.active
        if not is_active and not waiting:
            return
        if waiting and waiting.comes:
            cause = replace(waiting, at_ns=at_ns, comes=0)
        elif alarm:
            cause = AlarmCause(
                alarm.kind, alarm.station, key[2] or 0, alarm.area or "", alarm.point, alarm.ca,
                alarm.priority, alarm.value, at_ns, 0,
            )  # fmt: skip
        self._become(database, cause, waiting)

    def due(self, database: Database) -> None:
        """What has lasted long enough by now."""
        for cause in [*self.model.causes.values()]:
            if cause.due_ns <= self.now_ns:
                self.forget(database, cause.key)
                self._take(database, cause)

    def _become(self, database: Database, cause: AlarmCause, waiting: AlarmCause | None) -> None:
        """Events that waited tell by their times what lasted long enough."""
        if waiting and waiting.comes != cause.comes:
            self.forget(database, cause.key)
            if cause.at_ns - waiting.at_ns >= self._delay_ns(waiting):
                self._take(database, waiting)
            waiting = None
        if waiting or self.is_active(cause.key) == bool(cause.comes):
            return
        delay_ns = self._delay_ns(cause)
        if delay_ns:
            self._wait(database, replace(cause, due_ns=self.now_ns + delay_ns))
        else:
            self._take(database, cause)

    def _delay_ns(self, cause: AlarmCause) -> int:
        of_class = self._class(cause)
        return int((of_class.on_s if cause.comes else of_class.off_s) * 1e9)

    def _class(self, cause: AlarmCause) -> AlarmClass:
        meaning: Meaning | None = None
        if cause.kind in ("high", "low", "state") and cause.point:
            known = self.changes.points.get(cause.point) or self.model.points.get(cause.point)
            meaning = known and known.meaning
        return self.rules.of(cause.kind, meaning)

    def _waiting(self, key: AlarmKey) -> AlarmCause | None:
        changes = self.changes.causes
        return changes[key] if key in changes else self.model.causes.get(key)

    def _wait(self, database: Database, cause: AlarmCause) -> None:
        put(database, "causes", CAUSE_COLUMNS, astuple(cause), CAUSE_KEY)
        self.changes.causes[cause.key] = cause

    def forget(self, database: Database, key: AlarmKey) -> None:
        kind, station, place, area = key
        sql = "DELETE FROM causes WHERE kind = ? AND station = ? AND place = ? AND area = ?"
        database.execute(sql, (kind, station, place or 0, area or ""))
        self.changes.causes[key] = None

    def _take(self, database: Database, cause: AlarmCause) -> None:
        if cause.comes:
            self._come(database, cause)
        else:
            self._go(database, cause)

    def _come(self, database: Database, cause: AlarmCause) -> None:
        """One that comes and goes is one until somebody has acknowledged it."""
        before = self.get(cause.key)
        if before:
            self._again(database, before, cause)
            return
        place = (cause.point, cause.ca, cause.priority, cause.value, cause.at_ns, cause.at_ns)
        id_ = inserted(
            database,
            "INSERT INTO alarms (kind, station, point, ca, priority, value, since_ns, last_ns, area)"
            " VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)",
            (cause.kind, cause.station, *place, cause.area or None),
        )
        self.changes.alarms[id_] = Alarm(
            id_, cause.kind, cause.station, *place[:-1], area=cause.area or None, last_ns=cause.at_ns
        )
        self.new[cause.key] = id_
        self.came[id_] += 1

    def _again(self, database: Database, before: Alarm, cause: AlarmCause) -> None:
        if before.active:
            return
        value = before.value if cause.value is None else cause.value
        last_ns = max(cause.at_ns, before.last_ns)
        again = replace(
            before, gone_ns=None, value=value, returns=before.returns + 1, last_ns=last_ns, suppressed_by=None
        )
        self.put(database, again)
        self.came[again.id] += 1

    def _go(self, database: Database, cause: AlarmCause) -> None:
        """None ends before it came last, whatever a clock says."""
        alarm = self.get(cause.key)
        if alarm and alarm.active:
            self.put(database, replace(alarm, gone_ns=max(cause.at_ns, alarm.last_ns)))

    # ---- of which fault it is a part -----------------------------------------------------------

    def end(self, database: Database) -> None:
        """Of what the transaction has changed."""
        changed = [*self.changes.alarms.values()]
        if any(alarm.kind == LOST for alarm in changed):
            self._of_stations(database, [alarm for alarm in changed if alarm.kind == LOST])
            self._of_network(database)
        for alarm in changed:
            if alarm.kind not in (LOST, NETWORK) and alarm.id in self.came:
                lost = self.get((LOST, alarm.station, None, None))
                if lost and lost.active:
                    self.put(database, replace(alarm, suppressed_by=lost.id))
        self._count(database)

    def _of_stations(self, database: Database, lost: list[Alarm]) -> None:
        """While a station is lost, its alarms are parts of that; they are not when it is back."""
        of_station: defaultdict[int, list[Alarm]] = defaultdict(list)
        for alarm in self.all():
            if alarm.kind not in (LOST, NETWORK):
                of_station[alarm.station].append(alarm)
        for cause in lost:
            by = cause.id if cause.active else None
            for alarm in of_station[cause.station]:
                if alarm.suppressed_by != by:
                    self.put(database, replace(alarm, suppressed_by=by))

    def _of_network(self, database: Database) -> None:
        alarms = self.all()
        networks = [alarm for alarm in alarms if alarm.kind == NETWORK]
        network = next((alarm for alarm in networks if alarm.acknowledged_ns is None), None)
        alone = [
            alarm
            for alarm in alarms
            if alarm.kind == LOST and alarm.active
            and alarm.suppressed_by is None and alarm.acknowledged_ns is None
        ]  # fmt: skip
        members = of_one_fault(alone, network, self.rules)
        if members:
            parts = [*members, *(alarm for alarm in alarms if network and alarm.suppressed_by == network.id)]
            network = self._network(database, network, members, len(parts))
            for alarm in members:
                self.put(database, replace(alarm, suppressed_by=network.id))
        active = {alarm.suppressed_by for alarm in self.all() if alarm.kind == LOST and alarm.active}
        for each in networks:
            if each.active and each.id not in active:
                self.put(database, replace(each, gone_ns=max(self.now_ns, each.last_ns)))

    def _network(self, database: Database, network: Alarm | None, members: list[Alarm], most: int) -> Alarm:
        """The one that nobody has acknowledged, or a new one. Its value: how many are parts of it."""
        first, last_ns = members[0], max(alarm.last_ns for alarm in members)
        key = (NETWORK, network.station if network else first.station, None, None)
        if not network or not network.active:
            self._come(
                database,
                AlarmCause(NETWORK, key[1], 0, "", None, None, NETWORK_PRIORITY, None, first.last_ns, 1),
            )
        network = self.get(key)
        assert network
        network = replace(network, value=max(network.value or 0, most), last_ns=max(last_ns, network.last_ns))
        self.put(database, network)
        return network

    def _count(self, database: Database) -> None:
        """Each time that one came, and whether the list showed it."""
        rows = []
        for id_ in self.came.elements():
            alarm = self.changes.alarms[id_]
            is_shown = alarm.suppressed_by is None and alarm.shelved_until_ns < self.now_ns
            rows.append((id_, self.now_ns, int(is_shown)))
        database.insert("comings", ("alarm", "at_ns", "shown"), rows)
