# SPDX-License-Identifier: GPL-3.0-or-later
"""What can be asked over HTTP; the table of routes is also the OpenAPI document."""

from __future__ import annotations

import asyncio
import json
import logging
import math
import re
import time
from collections import Counter
from collections.abc import AsyncIterator, Hashable
from typing import Any

from aiohttp import web

from openrtu_tools.centre import accounts, exports, formats, outbox, pictures, rates
from openrtu_tools.centre.alarms import NETWORK, seen, views
from openrtu_tools.centre.codes import Cause
from openrtu_tools.centre.drawing import Drawing
from openrtu_tools.centre.errors import RefusedError, StoreError
from openrtu_tools.centre.exports import STRETCH_NS
from openrtu_tools.centre.formats import Writer
from openrtu_tools.centre.intake import COMMAND_COLUMNS
from openrtu_tools.centre.makers import Made
from openrtu_tools.centre.model import NS_PER_MS, Alarm, Command, Json
from openrtu_tools.centre.settings import ALARM_KINDS
from openrtu_tools.centre.store import INTEGER_MOST, Row, audit
from openrtu_tools.centre.trends import trend
from openrtu_tools.centre.web import HEADERS, Asked, Route
from openrtu_tools.centre.wire import described

log = logging.getLogger("centre")

COMMANDS = ", ".join(f'"{column}"' for column in COMMAND_COLUMNS)
ROWS = 500  # of a page
TREND_COLUMNS, TREND_RANGE, TRENDS_MOST = 1000, range(10, 4001), 12
CHART_ROWS = 5000  # of a chart
TRIP_FORMATS = {"json": "application/json", "csv": "text/csv"}
READ_S = 600.0  # for a piece of 64 KiB
IDS_MOST = 5000  # of alarms
MARKS_AT_ONCE = 200  # of a file
DAY_S = 86400.0
AUDIT_S = 30 * DAY_S
# What the audit's actions are.
AUDITED = {
    "commands": ("select", "command", "execute", "release", "cancel", "command refused"),
    "alarms": ("acknowledge", "shelve"),
    "stations": ("interrogate", "trace"),
    "exports": ("export",),
    "logins": (
        "login",
        "login refused",
        "session ended",
        "token",
        "token ended",
        "password",
        "second factor",
        "recovery code",
    ),
    "users": ("user", "user removed"),
}
# Of an event, what its cause of transmission says.
CAUSES = {
    "spontaneous": "SPONTANEOUS",
    "requested": "REQUEST",
    "remote": "RETURN_REMOTE",
    "local": "RETURN_LOCAL",
    "interrogated": "INTERROGATED",
}
TIME_MOST = 9 * 10**12  # milliseconds, some 285 years: nanoseconds still have 64 bits


# ---- what is asked -------------------------------------------------------------------------------


def _number(text: str, name: str) -> int:
    if not re.fullmatch(r"-?[0-9]{1,19}", text) or abs(int(text)) > INTEGER_MOST:
        raise RefusedError(400, "form", f"{name}: {text} is no number")
    return int(text)


def _id(asked: Asked) -> int:
    return _number(asked.path["id"], "id")


def _asked(asked: Asked, name: str, otherwise: int) -> int:
    return _number(asked.query[name], name) if name in asked.query else otherwise


def _span(asked: Asked, seconds: float) -> tuple[int, int]:
    """From and to in nanoseconds; the last `seconds` unless asked for."""
    now_ms = time.time_ns() // 1_000_000
    end = _asked(asked, "to", now_ms + 60_000)
    begin = _asked(asked, "from", min(end, now_ms) - int(seconds * 1000))
    if abs(begin) > TIME_MOST or abs(end) > TIME_MOST:
        raise RefusedError(400, "form", "from and to are milliseconds since 1970")
    return begin * 1_000_000, end * 1_000_000


async def _answered(
    asked: Asked, pieces: AsyncIterator[bytes], kind: str, name: str, status: int = 200, **headers: str
) -> web.StreamResponse:
    """As it comes. What fails on the way ends the connection: half a file is no file."""
    response = web.StreamResponse(
        status=status,
        headers={
            **HEADERS,
            "Cache-Control": "no-store",
            "Content-Disposition": f'attachment; filename="{name}"',
            **headers,
        },
    )
    response.content_type, response.charset = kind, "utf-8"
    await response.prepare(asked.request)
    try:
        async for piece in pieces:
            if piece:
                async with asyncio.timeout(READ_S):  # who is slower than that comes again for the rest
                    await response.write(piece)
    except (StoreError, TimeoutError) as error:
        log.error("%s ends before its end: %s", name, error or "it is read too slowly")
        if asked.request.transport:
            asked.request.transport.abort()
    else:
        await response.write_eof()
    return response


def _range(text: str) -> tuple[int, int | None] | None:
    """Of octets, the first and the one behind the last; None: all. Several ranges are none.

    >>> [_range(text) for text in ("bytes=5-9", "bytes=5-", "bytes=-5", "octets=1-", "bytes=1-2,5-6", "")]
    [(5, 10), (5, None), None, None, None, None]
    """
    found = re.fullmatch(r"bytes=([0-9]{1,18})-([0-9]{0,18})", text)
    return found and (int(found[1]), int(found[2]) + 1 if found[2] else None)


def _owner(asked: Asked) -> Hashable:
    """Nobody gets a file of before who may see less now."""
    return asked.session.user, asked.session.role, asked.session.groups


async def _made(asked: Asked, order: Json, kind: str, name: str) -> web.StreamResponse:
    """A file that may be long: by a process of its own. Who was cut off takes the rest of the same one."""
    makers, owner, key = asked.centre.makers, _owner(asked), asked.request.path_qs
    wanted = _range(asked.request.headers.get("Range", ""))
    made = makers.find(owner, key, asked.request.headers.get("If-Range")) if wanted else None
    if made:
        with makers.reading(made):
            await _until(asked, made, whole=True)
            if not made.fault:
                return await _rest(asked, made, kind, wanted or (0, None))
    made = makers.begin(order, owner, key, name)
    with makers.reading(made):
        await _until(asked, made)
        if made.fault and not made.size:
            raise StoreError(made.fault)
        headers = {"ETag": made.tag, "Accept-Ranges": "bytes"}
        if made.state == "whole":
            headers["Content-Length"] = str(made.size)
        return await _answered(asked, made.read(0), kind, name, **headers)


async def _until(asked: Asked, made: Made, whole: bool = False) -> None:
    """Something is there of it, or all."""
    while not made.over.is_set() and (whole or not made.size):
        if asked.request.transport is None or asked.request.transport.is_closing():
            raise ConnectionResetError
        await made.grows()


async def _rest(asked: Asked, made: Made, kind: str, wanted: tuple[int, int | None]) -> web.StreamResponse:
    size = made.size
    begin, end = wanted[0], min(size, wanted[1] or size)
    headers = {"ETag": made.tag, "Accept-Ranges": "bytes"}
    if begin >= end:
        said = {"code": "range", "error": f"the file has {size} octets"}
        headers |= {"Content-Range": f"bytes */{size}"}
        return web.json_response(said, status=416, headers=headers)
    headers |= {"Content-Range": f"bytes {begin}-{end - 1}/{size}", "Content-Length": str(end - begin)}
    return await _answered(asked, made.read(begin, end), kind, made.name, 206, **headers)


async def files(asked: Asked) -> list[Json]:
    """Of the user, oldest first."""
    return [made.view() for made in asked.centre.makers.of(_owner(asked))]


async def end_file(asked: Asked) -> Json:
    for made in asked.centre.makers.of(_owner(asked)):
        if made.id == asked.path["id"]:
            asked.centre.makers.end(made)
            return {}
    raise RefusedError(404, "unknown", f"there is no file {asked.path['id']}")


async def _newest(asked: Asked, sql: str, at: str, begin: int, end: int, *values: Any) -> list[Row]:
    """The last rows of a time, newest first, by stretches for the same reason."""
    found: list[Row] = []
    stretch = STRETCH_NS
    while end >= begin and len(found) < ROWS:
        since = max(begin, end - stretch)
        found += await asked.centre.store.read(
            f"{sql} AND {at} BETWEEN ? AND ? ORDER BY {at} DESC LIMIT ?",
            *values, since, end, ROWS - len(found),
        )  # fmt: skip
        end, stretch = since - 1, stretch * 4
    return found


async def _export(asked: Asked, what: str, station: int | None = None) -> None:
    await asked.centre.store.write(
        lambda database: audit(database, time.time_ns(), asked.session.user, "export", what, station)
    )


# ---- what is answered ----------------------------------------------------------------------------


async def me(asked: Asked) -> Json:
    session = asked.session
    return {
        "user": session.user,
        "role": session.role,
        "csrf": session.csrf,
        "provided": session.provided,
        "gap_s": asked.centre.settings.gap_s,
        "zone": asked.centre.settings.zone,
        "tiles": asked.centre.settings.tiles is not None,
        "pictures": asked.centre.settings.pictures is not None,
        **asked.centre.state(),
    }


async def areas(asked: Asked) -> Json:
    """As GeoJSON; a circle is a place and a radius."""
    groups = asked.session.groups
    features = []
    for area in asked.centre.settings.areas:
        if groups and area.group and area.group not in groups:
            continue
        ring = [[longitude, latitude] for latitude, longitude in area.corners]
        geometry: Json = (
            {"type": "Point", "coordinates": ring[0]}
            if area.radius_m
            else {"type": "Polygon", "coordinates": [[*ring, ring[0]]]}
        )
        properties = {"name": area.name, "alarm": area.alarm, "group": area.group, "radius_m": area.radius_m}
        features.append({"type": "Feature", "properties": properties, "geometry": geometry})
    return {"type": "FeatureCollection", "features": features}


async def stations(asked: Asked) -> list[Json]:
    return [station.view() for station in asked.stations().values()]


async def points(asked: Asked) -> list[Json]:
    station = _asked(asked, "station", 0)
    search = asked.query.get("search", "").casefold()
    return [
        point.view()
        for point in asked.points()
        if (not station or point.station == station) and search in point.meaning.name.casefold()
    ]


async def history(asked: Asked) -> Any:
    point = asked.point(_id(asked))
    begin, end = _span(asked, 3600)
    if asked.query.get("format") == "csv":
        await _export(asked, f"history of {point.meaning.name}", point.station)
        order = {"what": "history", "point": point.id, "begin": begin, "end": end}
        return await _made(asked, order, "text/csv", f"point-{point.id}.csv")
    rows = await asked.centre.store.read(
        "SELECT at_ns / 1000000 AS at, value, quality, cause FROM history"
        " WHERE point = ? AND at_ns BETWEEN ? AND ? ORDER BY at_ns DESC LIMIT ?",
        point.id, begin, end, CHART_ROWS,
    )  # fmt: skip
    rows.reverse()
    return rows


async def trends(asked: Asked) -> Any:
    """Of points together, in so many columns at most."""
    ids = [_number(text, "points") for text in asked.query.get("points", "").split(",") if text]
    columns = _asked(asked, "columns", TREND_COLUMNS)
    if not ids or len(ids) > TRENDS_MOST or columns not in TREND_RANGE:
        raise RefusedError(
            400,
            "form",
            f"1 to {TRENDS_MOST} points, and {TREND_RANGE[0]} to {TREND_RANGE[-1]} columns",
        )
    found = [asked.point(id_) for id_ in dict.fromkeys(ids)]
    begin, end = _span(asked, 3600)
    if begin > end:
        raise RefusedError(400, "form", "from is after to")
    names = {point.id: asked.station(point.station).settings.name for point in found}
    if asked.query.get("format") == "csv":
        await _export(asked, f"trends of {', '.join(point.meaning.name for point in found)}")
        described_points = [
            (point.id, names[point.id], point.meaning.name, point.meaning.unit) for point in found
        ]
        order = {"what": "trends", "points": described_points, "begin": begin, "end": end, "columns": columns}
        return await _made(asked, order, "text/csv", "trends.csv")
    answered = []
    for point in found:
        drawn = await trend(asked.centre.store, point.id, begin, end, columns)
        listed = {
            "point": point.id,
            "station": point.station,
            "station_name": names[point.id],
            **point.listed(),
        }
        answered.append({**listed, **drawn.view()})
    return {"from": begin // NS_PER_MS, "to": end // NS_PER_MS, "trends": answered}


def _found(asked: Asked) -> tuple[set[int], set[int] | None]:
    """The stations that are asked for; and of a text, the points whose names, or stations' names, have it."""
    station, text = _asked(asked, "station", 0), asked.query.get("text", "").casefold()
    stations = {id_ for id_ in asked.stations() if not station or id_ == station}
    if not text:
        return stations, None
    model = asked.centre.model
    named = {id_ for id_ in stations if text in model.stations[id_].settings.name.casefold()}
    points = {
        point.id
        for point in asked.points()
        if point.station in named or (point.station in stations and text in point.meaning.name.casefold())
    }
    return stations, points


def _cause(asked: Asked) -> str:
    """A condition."""
    cause = asked.query.get("cause", "")
    if cause and cause not in CAUSES:
        raise RefusedError(400, "form", f"{cause} is no cause: {', '.join(CAUSES)}")
    return f" AND history.cause = {int(Cause[CAUSES[cause]])}" if cause else ""


async def events(asked: Asked) -> Any:
    """Newest first; as a file, oldest first."""
    begin, end = _span(asked, DAY_S)
    stations, points = _found(asked)
    cause = _cause(asked)
    if asked.query.get("format") == "csv":
        await _export(asked, "events")
        model = asked.centre.model
        names = {
            point.id: (model.stations[point.station].settings.name, point.meaning.name)
            for point in model.points.values()
            if point.station in stations and (points is None or point.id in points)
        }
        order = {"what": "events", "names": names, "cause": cause, "begin": begin, "end": end}
        return await _made(asked, order, "text/csv", "events.csv")
    if points is None and "station" in asked.query:
        points = {point.id for point in asked.points() if point.station in stations}
    store = asked.centre.store
    if points is None:
        source = f"history JOIN points ON points.id = history.point WHERE station {store.among}"
        wanted = stations
    elif len(points) <= exports.POINTS_MOST:  # by the index of each
        source, wanted = f"{store.wanted} CROSS JOIN history WHERE history.point = number", points
    else:
        source, wanted = f"history WHERE history.point {store.among}", points
    sql = (
        "SELECT history.id, history.at_ns / 1000000 AS at, history.point, history.value, history.quality,"
        f" history.cause FROM {source}{cause}"
    )
    rows = await _newest(asked, sql, "history.at_ns", begin, end, json.dumps(list(wanted)))
    for row in rows:
        row["station"] = asked.centre.model.points[row["point"]].station
    return rows


def _names(asked: Asked) -> dict[int, str]:
    """Of the points that are places: the station's, with the object's address where it has several."""
    model = asked.centre.model
    places = [point for point in asked.points() if point.is_position]
    several = Counter(point.station for point in places)
    return {
        point.id: model.stations[point.station].settings.name
        + (f" {point.ca}.{point.ioa}" if several[point.station] > 1 else "")
        for point in places
    }


def _writer(asked: Asked) -> Writer:
    form = asked.query.get("format", "geojson")
    if form not in formats.FORMATS:
        raise RefusedError(400, "form", f"{form} is no format: {', '.join(formats.FORMATS)}")
    return formats.FORMATS[form](asked.centre.settings.gap_s)


async def positions(asked: Asked) -> Any:
    """The last one of each, as in figure 7 of the positioning paper."""
    writer = _writer(asked)
    form = asked.query.get("format", "geojson")
    if "format" in asked.query:
        await _export(asked, f"positions as {form}")

    async def pieces() -> AsyncIterator[bytes]:
        yield writer.begin().encode()
        for number, (id_, name) in enumerate(_names(asked).items()):
            if place := formats.last_place(asked.centre.model.points[id_]):
                yield writer.mark(name, place).encode()
            if number % MARKS_AT_ONCE == 0:
                await asyncio.sleep(0)  # others have their turn
        yield writer.end().encode()

    return await _answered(asked, pieces(), writer.kind, f"positions.{form}")


async def tracks(asked: Asked) -> Any:
    names = _names(asked)
    chosen = _asked(asked, "point", 0)
    if chosen and chosen not in names:
        raise RefusedError(404, "unknown", f"point {chosen} is no place")
    begin, end = _span(asked, 3600)
    step_ms = _asked(asked, "step", 0)
    if not 0 <= step_ms <= asked.centre.settings.gap_s * 500:
        raise RefusedError(400, "form", "step: from 0 to half of gap_s, in milliseconds")
    writer = _writer(asked)
    if chosen:
        names = {chosen: names[chosen]}
    step_ns = step_ms * NS_PER_MS
    if "format" not in asked.query:  # the page's own: what it draws is short
        texts = exports.tracks(asked.centre.store, writer, names, begin, end, step_ns)
        return await _answered(asked, (text.encode() async for text in texts), writer.kind, "tracks.geojson")
    form = asked.query["format"]
    await _export(asked, f"tracks as {form}", asked.centre.model.points[chosen].station if chosen else None)
    order = {
        "what": "tracks", "format": form, "gap_s": asked.centre.settings.gap_s, "names": names,
        "begin": begin, "end": end, "step_ns": step_ns,
    }  # fmt: skip
    return await _made(asked, order, writer.kind, f"tracks.{form}")


async def trips(asked: Asked) -> Any:
    """By a process, too: a year has millions of places."""
    point = asked.point(_asked(asked, "point", 0))
    if not point.is_position:
        raise RefusedError(404, "unknown", f"point {point.id} is no place")
    begin, end = _span(asked, DAY_S)
    form = asked.query.get("format", "json")
    if form not in TRIP_FORMATS:
        raise RefusedError(400, "form", f"{form} is no format: {', '.join(TRIP_FORMATS)}")
    if "format" in asked.query:
        await _export(asked, "trips", point.station)
    order = {
        "what": "trips", "format": form, "point": point.id, "gap_s": asked.centre.settings.gap_s,
        "begin": begin, "end": end,
    }  # fmt: skip
    return await _made(asked, order, TRIP_FORMATS[form], f"trips.{form}")


async def alarms(asked: Asked) -> list[Json]:
    """Open ones; with from, to or part_of, all that came in that time or are its parts, newest first."""
    if {"from", "to", "part_of"} & asked.query.keys():
        found = await _past_alarms(asked)
    else:
        stations, points = _found(asked)
        kind, text = _kind(asked), asked.query.get("text", "").casefold()
        found = [
            alarm
            for alarm in asked.centre.model.alarms.values()
            if alarm.station in stations
            and kind in ("", alarm.kind)
            and (points is None or _tells(asked, alarm, points, text))
        ]
    return views(found, bool(asked.session.groups))


def _kind(asked: Asked) -> str:
    kind = asked.query.get("kind", "")
    if kind and kind not in ALARM_KINDS:
        raise RefusedError(400, "form", f"{kind} is no kind: {', '.join(ALARM_KINDS)}")
    return kind


def _tells(asked: Asked, alarm: Alarm, points: set[int], text: str) -> bool:
    """As _past_alarms looks for it."""
    station = asked.centre.model.stations[alarm.station].settings.name
    told = (station, alarm.area or "", alarm.shelved_why, alarm.acknowledged_by or "")
    return alarm.point in points or any(text in each.casefold() for each in told)


async def _past_alarms(asked: Asked) -> list[Alarm]:
    stations, points = _found(asked)
    kind, text, store = _kind(asked), asked.query.get("text", "").casefold(), asked.centre.store
    sql = f"SELECT * FROM alarms WHERE station {store.among}"
    values: list[Any] = [json.dumps(list(stations))]
    if {"from", "to"} & asked.query.keys():
        sql, values = f"{sql} AND since_ns BETWEEN ? AND ?", [*values, *_span(asked, DAY_S)]
    if "part_of" in asked.query:
        sql, values = f"{sql} AND suppressed_by = ?", [*values, _asked(asked, "part_of", 0)]
    if kind:
        sql, values = f"{sql} AND kind = ?", [*values, kind]
    if points is not None:
        names = {id_: asked.centre.model.stations[id_].settings.name.casefold() for id_ in stations}
        named = [id_ for id_, name in names.items() if text in name]
        words = "lower(coalesce(area, '') || ' ' || shelved_why || ' ' || coalesce(acknowledged_by, ''))"
        sql += f" AND (station {store.among} OR point {store.among} OR {words} LIKE ? ESCAPE '!')"
        like = re.sub("([!%_])", r"!\1", text)
        values += [json.dumps(named), json.dumps(list(points)), f"%{like}%"]
    if asked.session.groups:  # LIMIT counts what is shown
        sql, values = f"{sql} AND kind <> ?", [*values, NETWORK]
    rows = await store.read(f"{sql} ORDER BY since_ns DESC LIMIT ?", *values, ROWS)
    return [Alarm(**row) for row in rows]


async def alarm_rates(asked: Asked) -> Json:
    """Of the last 24 hours."""
    stations, limited = asked.stations(), bool(asked.session.groups)
    own = [alarm for alarm in asked.centre.model.alarms.values() if alarm.station in stations]
    alarms = [each for alarm in own if (each := seen(alarm, limited))]
    return await rates.Rates(asked.centre.store, time.time_ns(), list(stations), limited).told(alarms)


def _is_for(asked: Asked, alarm: Alarm) -> bool:
    return asked.sees(alarm.station) and seen(alarm, bool(asked.session.groups)) is not None


def _alarm_id(asked: Asked) -> int:
    """Of an alarm that is not there the centre says so itself."""
    id_ = _id(asked)
    alarm = asked.centre.model.alarms.get(id_)
    if alarm and not _is_for(asked, alarm):
        raise RefusedError(409, "gone", f"alarm {id_} is gone and acknowledged, or there is none")
    return id_


async def acknowledge(asked: Asked) -> Json:
    return (await asked.centre.acknowledge(asked.session, _alarm_id(asked))).view()


async def acknowledge_many(asked: Asked) -> Json:
    """Of those that somebody else was first with, or that are not there for the user, nothing is said."""
    known = asked.centre.model.alarms
    ids = [id_ for id_ in asked.body["ids"] if id_ in known and _is_for(asked, known[id_])]
    return {"acknowledged": await asked.centre.acknowledge_many(asked.session, ids)}


async def shelve(asked: Asked) -> Json:
    minutes, why = asked.body["minutes"], asked.body.get("why", "")
    return (await asked.centre.shelve(asked.session, _alarm_id(asked), minutes, why)).view()


async def notifications(asked: Asked) -> Json:
    settings = asked.centre.settings.notify
    return await outbox.told_of(asked.centre.store, settings) if settings else {"targets": [], "messages": []}


async def commands(asked: Asked) -> list[Json]:
    """Newest first."""
    rows = await asked.centre.store.read(
        f"SELECT {COMMANDS} FROM commands WHERE point IN"
        f" (SELECT id FROM points WHERE station {asked.centre.store.among}) ORDER BY id DESC LIMIT ?",
        json.dumps(list(asked.stations())), ROWS,
    )  # fmt: skip
    return [Command(**row).view() for row in rows]


async def one_command(asked: Asked) -> Json:
    rows = await asked.centre.store.read(f"SELECT {COMMANDS} FROM commands WHERE id = ?", _id(asked))
    if not rows or not asked.sees(asked.centre.model.points[rows[0]["point"]].station):
        raise RefusedError(404, "unknown", f"there is no command {asked.path['id']}")
    return Command(**rows[0]).view()


async def command(asked: Asked) -> Json:
    value = asked.body["value"]
    if not math.isfinite(value):
        raise RefusedError(400, "form", "value: a finite number is needed")
    point = asked.point(asked.body["point"])
    return (await asked.centre.command(asked.session, point.id, value)).view()


async def _follow(asked: Asked, execute: bool) -> Json:
    """A second person may be anybody, of those who see the station."""
    id_ = _id(asked)
    command = asked.centre.model.commands.get(id_)
    if command:
        asked.point(command.point)
    return (await asked.centre.follow(asked.session, id_, execute)).view()


async def execute(asked: Asked) -> Json:
    return await _follow(asked, True)


async def cancel(asked: Asked) -> Json:
    return await _follow(asked, False)


async def interrogate(asked: Asked) -> Json:
    station = asked.station(_id(asked))
    return {"common_addresses": await asked.centre.interrogate(asked.session, station.id)}


async def trace(asked: Asked) -> Any:
    station = asked.station(_id(asked))
    return await asked.centre.trace(asked.session, station.id, _asked(asked, "after", 0))


async def audited(asked: Asked) -> Any:
    """Newest first; as a file, oldest first."""
    begin, end = _span(asked, AUDIT_S)
    where, values = _audit_filter(asked)
    if asked.query.get("format") == "csv":
        await _export(asked, "audit")
        names = {id_: station.settings.name for id_, station in asked.stations().items()}
        order = {
            "what": "audit", "where": where, "values": values, "names": names, "begin": begin, "end": end,
        }  # fmt: skip
        return await _made(asked, order, "text/csv", "audit.csv")
    return await asked.centre.store.read(
        'SELECT id, at_ns / 1000000 AS at, "user", action, station, detail FROM audit'
        f" WHERE at_ns BETWEEN ? AND ?{where} ORDER BY id DESC LIMIT ?",
        begin, end, *values, ROWS,
    )  # fmt: skip


def _audit_filter(asked: Asked) -> tuple[str, list[Any]]:
    """Conditions, and their values."""
    where, values = "", []
    if "user" in asked.query:
        where += ' AND "user" = ?'
        values.append(asked.query["user"])
    if "station" in asked.query:
        where += " AND station = ?"
        values.append(_asked(asked, "station", 0))
    if kind := asked.query.get("kind"):
        if kind not in AUDITED:
            raise RefusedError(400, "form", f"{kind} is no kind: {', '.join(AUDITED)}")
        where += f" AND action IN ({', '.join('?' * len(AUDITED[kind]))})"
        values += AUDITED[kind]
    return where, values


def _drawn(asked: Asked, name: str, drawing: Drawing) -> Json | None:
    """Who does not see all its stations does not see a picture: its lines would tell of them."""
    names = pictures.resolve(drawing, asked.centre.model)
    if all(asked.sees(station) for station in names.stations):
        return pictures.view(name, drawing, names)
    return None


async def drawings(asked: Asked) -> list[Json]:
    found = await asyncio.to_thread(asked.centre.pictures.drawings)
    drawn = [_drawn(asked, name, drawing) for name, drawing in found.items()]
    return [{key: each[key] for key in ("name", "title", "version")} for each in drawn if each]


async def drawing(asked: Asked) -> Json:
    name = asked.path["name"]
    found = await asyncio.to_thread(asked.centre.pictures.drawing, name)
    drawn = _drawn(asked, name, found) if found else None
    if not drawn:
        raise RefusedError(404, "unknown", f"there is no picture {name}")
    return drawn


async def openapi(asked: Asked) -> Json:
    return document()


# ---- the table -----------------------------------------------------------------------------------


MILLISECONDS = {"type": "integer", "description": "milliseconds since 1970, UTC"}
SPAN: dict[str, Json] = {"from": MILLISECONDS, "to": MILLISECONDS}
STATION: dict[str, Json] = {"station": {"type": "integer", "description": "only of this one"}}
TEXT: dict[str, Json] = {"text": {"type": "string", "description": "a part of a name"}}
CSV: dict[str, Json] = {"format": {"type": "string", "enum": ["csv"]}}
FORMAT: dict[str, Json] = {"format": {"type": "string", "enum": list(formats.FORMATS)}}
STEP = {"type": "integer", "description": "milliseconds: only the last place of each such time"}
NUMBER = {"type": "number"}

ROUTES = [
    Route("GET", "/api/openapi.json", "viewer", "this document", openapi),
    Route("GET", "/api/me", "viewer", "who is logged in, and the token that changes need", me),
    Route("GET", "/api/stations", "viewer", "all stations", stations),
    Route("GET", "/api/points", "viewer", "points with their last values", points,
          {**STATION, "search": {"type": "string", "description": "a part of the name"}}),
    Route("GET", "/api/points/{id}/history", "viewer", "values of a point, the last hour unless asked for",
          history, {**SPAN, **CSV}),
    Route("GET", "/api/trends", "viewer",
          "points over a time, in columns: begin, lowest, highest, last, quality, how many", trends,
          {**SPAN, **CSV, "points": {"type": "string", "description": "ids, with commas"},
           "columns": {"type": "integer", "description": "at most; fewer changes come as they were"}}),
    Route("GET", "/api/events", "viewer", "changes of all points, the last day unless asked for", events,
          {**SPAN, **STATION, **TEXT, **CSV, "cause": {"type": "string", "enum": list(CAUSES)}}),
    Route("GET", "/api/positions", "viewer", "the last position of each vehicle", positions, FORMAT,
          answer="application/geo+json"),
    Route("GET", "/api/tracks", "viewer", "ways of vehicles; a gap begins a new segment", tracks,
          {**SPAN, **FORMAT, "point": {"type": "integer"}, "step": STEP}, answer="application/geo+json"),
    Route("GET", "/api/pictures", "viewer", "the process pictures", drawings),
    Route("GET", "/api/pictures/{name}", "viewer", "one: its SVG, what its elements are bound to", drawing),
    Route("GET", "/api/trips", "viewer", "trips and stops of a vehicle, the last day unless asked for", trips,
          {**SPAN, "point": {"type": "integer"}, "format": {"type": "string", "enum": list(TRIP_FORMATS)}}),
    Route("GET", "/api/areas", "viewer", "the areas of the map", areas),
    Route("GET", "/api/files", "viewer", "the user's files, made or kept, and how far they are", files),
    Route("POST", "/api/files/{id}/end", "viewer", "such a file is not wanted any more", end_file),
    Route("GET", "/api/alarms", "viewer", "open alarms, or all that came in a time", alarms,
          {**SPAN, **STATION, **TEXT, "kind": {"type": "string", "enum": list(ALARM_KINDS)},
           "part_of": {"type": "integer", "description": "only of the fault that is this alarm"}}),
    Route("GET", "/api/alarms/rates", "viewer", "how often alarms came in the last 24 hours, and which",
          alarm_rates),
    Route("POST", "/api/alarms/acknowledge", "operator", "acknowledge many alarms", acknowledge_many,
          body=described(["ids"], ids={"type": "array", "items": {"type": "integer"}, "maxItems": IDS_MOST})),
    Route("POST", "/api/alarms/{id}/acknowledge", "operator", "acknowledge an alarm", acknowledge),
    Route("POST", "/api/alarms/{id}/shelve", "operator", "put an alarm aside for minutes; 0 brings it back",
          shelve, body=described(["minutes"], minutes={"type": "number", "minimum": 0, "maximum": 10080},
                         why={"type": "string", "maxLength": 200})),
    Route("GET", "/api/notifications", "operator", "who was told of alarms, and what waits", notifications),
    Route("GET", "/api/commands", "viewer", "the last commands", commands),
    Route("GET", "/api/commands/{id}", "viewer", "one command", one_command),
    Route("POST", "/api/commands", "operator", "select, or command where nothing is selected", command,
          body=described(["point", "value"], point={"type": "integer"}, value=NUMBER)),
    Route("POST", "/api/commands/{id}/execute", "operator", "execute what is selected", execute),
    Route("POST", "/api/commands/{id}/cancel", "operator", "cancel what is selected", cancel),
    Route("POST", "/api/stations/{id}/interrogate", "operator", "a general interrogation", interrogate),
    Route("GET", "/api/stations/{id}/trace", "engineer",
          "the last frames of a station, in words; it is traced as long as somebody asks",
          trace, {"after": {"type": "integer", "description": "only frames behind this number"}}),
    Route("GET", "/api/audit", "engineer", "who did what, the last 30 days unless asked for", audited,
          {**SPAN, **STATION, **CSV, "user": {"type": "string", "description": "only of this one"},
           "kind": {"type": "string", "enum": list(AUDITED)}}),
    *accounts.ROUTES,
]  # fmt: skip


def document() -> Json:
    """OpenAPI 3.1."""
    paths: dict[str, Json] = {}
    for route in ROUTES:
        parameters: list[Json] = [
            {"name": name, "in": "path", "required": True, "schema": {"type": "string"}}
            for name in re.findall(r"{(\w+)}", route.path)
        ]
        parameters += [
            {"name": name, "in": "query", "schema": schema} for name, schema in route.query.items()
        ]
        operation: Json = {
            "summary": route.summary,
            "description": f"Needs the role {route.role}.",
            "operationId": route.handler.__name__,
            "parameters": parameters,
            "responses": {
                "200": {"description": "done", "content": {route.answer: {}}},
                "default": {"description": "refused: code and error"},
            },
        }
        if route.body:
            operation["requestBody"] = {
                "required": True,
                "content": {"application/json": {"schema": route.body}},
            }
        paths.setdefault(route.path, {})[route.method.lower()] = operation
    return {
        "openapi": "3.1.0",
        "info": {"title": "OpenRTU control centre", "version": "1"},
        "paths": paths,
        "components": {"securitySchemes": {"token": {"type": "http", "scheme": "bearer"}}},
        "security": [{"token": []}],
    }
