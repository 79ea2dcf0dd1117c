# SPDX-License-Identifier: GPL-3.0-or-later
"""Which alarm is told to whom, and what nobody has taken yet: in the database, so that a kill loses none."""

from __future__ import annotations

import json
import time
import uuid
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from openrtu_tools.centre.alarms import NETWORK
from openrtu_tools.centre.model import NS_PER_MS, Alarm, Json, Model, milliseconds
from openrtu_tools.centre.settings import Notify, NotifyRule, Target
from openrtu_tools.centre.store import Database, Store, inserted

ALARMS_MOST = 100  # that a message names; it counts the rest
WAITING_MOST = 50  # messages of a target; then its alarms wait until there is room
AGAIN_S, AGAIN_MOST_S = 5.0, 600.0
GIVE_UP_NS = 3 * 86400 * 10**9
SHOWN_MOST = 200
KEPT_NS = 30 * 86400 * 10**9  # a message that was taken or given up
COLUMNS = "id, uid, target, body, made_ns, tries, next_ns, error"

Told = tuple[int, str]  # an alarm, a target


@dataclass(frozen=True, slots=True)
class Message:
    """One for a target, with all alarms that are told it at this moment."""

    id: int
    uid: str  # by which a receiver knows it again
    target: str
    body: str  # JSON
    made_ns: int
    tries: int
    next_ns: int
    error: str


def pause_s(tries: int) -> float:
    """Until the next attempt.

    >>> [pause_s(tries) for tries in (1, 2, 3, 8, 100)]
    [5.0, 10.0, 20.0, 600.0, 600.0]
    """
    return min(AGAIN_S * 2 ** min(tries - 1, 16), AGAIN_MOST_S)


def fits(rule: NotifyRule, alarm: Alarm, group: str) -> bool:
    """The alarm is of those that the rule tells. A fault of the network is of all groups."""
    return (
        alarm.priority <= rule.priority
        and (not rule.kinds or alarm.kind in rule.kinds)
        and (not rule.group or rule.group == group or alarm.kind == NETWORK)
    )


def described(alarm: Alarm, model: Model) -> Json:
    """With names, and in words: whoever is told has no page beside it."""
    station = model.stations[alarm.station].settings
    meaning = model.points[alarm.point].meaning if alarm.point else None
    value = "" if alarm.value is None else f"{alarm.value:g}"
    name = meaning.name if meaning else ""
    unit = f" {meaning.unit}" if meaning and meaning.unit else ""
    texts = {
        "lost": "station lost",
        NETWORK: f"{value} stations lost at once",
        "quality": f"invalid points of CA {alarm.ca}: {value}",
        "clock": f"clock of CA {alarm.ca} is wrong by {value} s",
        "high": f"{name} is too high: {value}{unit}",
        "low": f"{name} is too low: {value}{unit}",
        "state": f"{name}: {value}",
        "inside": f"is in the area {alarm.area}",
        "outside": f"has left the area {alarm.area}",
    }
    return {
        "id": alarm.id, "kind": alarm.kind, "priority": alarm.priority, "text": texts[alarm.kind],
        "station": "" if alarm.kind == NETWORK else station.name, "group": station.group,
        "point": name, "ca": alarm.ca, "value": alarm.value, "area": alarm.area,
        "since": milliseconds(alarm.since_ns), "gone": milliseconds(alarm.gone_ns),
        "returns": alarm.returns,
    }  # fmt: skip


def due(
    settings: Notify, came: dict[int, int], model: Model, told: Mapping[Told, bool], now_ns: int
) -> dict[str, list[Alarm]]:
    """By target, what it has not been told yet, or that has come again since it was told of its end. `came`:
    alarms that nobody has acknowledged, and when. `told`: whether the last word was of its end.
    """
    found: defaultdict[str, dict[int, Alarm]] = defaultdict(dict)
    for id_, came_ns in came.items():
        alarm = model.alarms.get(id_)
        if not alarm or alarm.acknowledged_ns is not None:
            continue
        if alarm.suppressed_by is not None or alarm.shelved_until_ns > now_ns:
            continue
        group = model.stations[alarm.station].settings.group
        for rule in settings.rules:
            if now_ns >= came_ns + int(rule.after_s * 1e9) and fits(rule, alarm, group):
                for target in rule.to:
                    of_its_end = told.get((id_, target))
                    if of_its_end is None or (of_its_end and alarm.active):
                        found[target][id_] = alarm
    return {target: list(alarms.values()) for target, alarms in found.items()}


def ended(settings: Notify, told: Mapping[Told, bool], alarms: Mapping[int, Alarm]) -> dict[str, list[Alarm]]:
    """By target that wants it, what has gone since it was told of it."""
    found: defaultdict[str, list[Alarm]] = defaultdict(list)
    for (id_, target), of_its_end in told.items():
        alarm = alarms.get(id_)
        if settings.targets[target].gone and not of_its_end and alarm and not alarm.active:
            found[target].append(alarm)
    return dict(found)


def names(message: Message) -> set[int]:
    """The alarms that it names."""
    return {alarm["id"] for alarm in json.loads(message.body)["alarms"]}


# ---- in the database -----------------------------------------------------------------------------


@dataclass
class Kept:
    """What the database knows when the centre starts."""

    came: dict[int, int]  # alarms that nobody has acknowledged: when they came
    told: dict[Told, bool]  # whether the last word was of its end
    closed: dict[int, Alarm]  # gone and acknowledged, and not everybody was told of the end
    messages: list[Message]


def load(database: Database, targets: Mapping[str, Target]) -> Kept:
    """What waits for a target that the file has no more is given up."""
    came = {
        row[0]: row[1]
        for row in database.execute(
            "SELECT id, coalesce((SELECT min(at_ns) FROM comings WHERE alarm = id), since_ns)"
            " FROM alarms WHERE acknowledged_ns IS NULL"
        )
    }
    rows = database.execute(f"SELECT {COLUMNS} FROM outbox WHERE ended_ns IS NULL ORDER BY id")
    messages = [Message(*row) for row in rows]
    for message in messages:
        if message.target not in targets:
            end(database, replace(message, error="there is no such target any more"), False)
    told, closed = _load_told(database, targets)
    return Kept(came, told, closed, [message for message in messages if message.target in targets])


def _load_told(
    database: Database, targets: Mapping[str, Target]
) -> tuple[dict[Told, bool], dict[int, Alarm]]:
    """What nobody is to be told any more goes."""
    database.execute("DELETE FROM told WHERE alarm NOT IN (SELECT id FROM alarms)")
    is_closed = "gone_ns IS NOT NULL AND acknowledged_ns IS NOT NULL"
    rows = database.execute(f"SELECT * FROM alarms WHERE {is_closed} AND id IN (SELECT alarm FROM told)")
    closed = {row["id"]: Alarm(**dict(row)) for row in rows}
    told = {
        (row[0], row[1]): bool(row[2]) for row in database.execute("SELECT alarm, target, gone FROM told")
    }
    over = [
        key
        for key, of_its_end in told.items()
        if key[1] not in targets or (key[0] in closed and (of_its_end or not targets[key[1]].gone))
    ]
    database.executemany("DELETE FROM told WHERE alarm = ? AND target = ?", over)
    for key in over:
        del told[key]
    return told, {id_: alarm for id_, alarm in closed.items() if any(id_ == key[0] for key in told)}


def add(
    database: Database, target: str, alarms: list[Alarm], model: Model, now_ns: int, gone: bool = False
) -> Message:
    """One message of all of them, that they came or have gone; and what is long past goes."""
    first = sorted(alarms, key=lambda alarm: alarm.priority)[:ALARMS_MOST]
    named = [described(alarm, model) for alarm in first]
    body = json.dumps({"gone": gone, "alarms": named, "more": len(alarms) - len(named)})
    uid = uuid.uuid4().hex
    id_ = inserted(
        database,
        "INSERT INTO outbox (uid, target, body, made_ns, next_ns) VALUES (?, ?, ?, ?, ?)",
        (uid, target, body, now_ns, now_ns),
    )
    pairs = [(alarm.id, target) for alarm in alarms]
    database.executemany("DELETE FROM told WHERE alarm = ? AND target = ?", pairs)
    database.insert("told", ("alarm", "target", "gone"), [(*pair, int(gone)) for pair in pairs])
    database.execute("DELETE FROM outbox WHERE ended_ns < ?", (now_ns - KEPT_NS,))
    return Message(id_, uid, target, body, now_ns, 0, now_ns, "")


def put_off(database: Database, messages: Iterable[Message]) -> None:
    rows = [(each.tries, each.next_ns, each.error, each.id) for each in messages]
    database.update("outbox", ("tries", "next_ns", "error"), rows)


def end(database: Database, message: Message, taken: bool) -> None:
    database.execute(
        "UPDATE outbox SET tries = ?, error = ?, ended_ns = ?, taken = ? WHERE id = ?",
        (message.tries, message.error, time.time_ns(), int(taken), message.id),
    )


async def told_of(store: Store, settings: Notify) -> Json:
    """The last messages, newest first, without what they say; and how it stands with each target."""
    rows = await store.read(
        f"SELECT id, target, made_ns / {NS_PER_MS} AS made, tries, next_ns / {NS_PER_MS} AS next, error,"
        f" ended_ns / {NS_PER_MS} AS ended, taken FROM outbox ORDER BY id DESC LIMIT {SHOWN_MOST}"
    )
    states = await store.read(
        "SELECT target, sum(CASE WHEN ended_ns IS NULL THEN 1 ELSE 0 END) AS waiting,"
        f" max(CASE WHEN taken = 1 THEN ended_ns END) / {NS_PER_MS} AS last FROM outbox GROUP BY target"
    )
    by_target = {state["target"]: state for state in states}
    targets = []
    for name, target in settings.targets.items():
        state = by_target.get(name, {"waiting": 0, "last": None})
        errors = [row["error"] for row in rows if row["target"] == name and row["ended"] is None]
        targets.append(
            {
                "name": name,
                "by": "mail" if target.mail else "webhook",
                "waiting": int(state["waiting"]),
                "last": state["last"],
                "error": next(filter(None, errors), ""),
            }
        )
    return {"targets": targets, "messages": [{**row, "taken": bool(row["taken"])} for row in rows]}
