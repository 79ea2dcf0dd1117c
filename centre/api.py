# SPDX-License-Identifier: GPL-3.0-or-later
"""What can be asked over HTTP; the table of routes is also the OpenAPI document."""

from __future__ import annotations

import math
import re
import time
from typing import Any

from aiohttp import web

from centre import formats, users
from centre.errors import RefusedError
from centre.formats import Place, Track, moment
from centre.intake import COMMAND_COLUMNS
from centre.model import Alarm, Command, Json
from centre.store import audit
from centre.web import Asked, Route

ROWS_MOST = 100_000  # of an export
ROWS = 500  # of a page
DAY_S = 86400.0
TOKEN_DAYS_MOST = 366
INTEGER_MOST = 2**63 - 1


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
    if abs(begin) > 10**14 or abs(end) > 10**14:
        raise RefusedError(400, "form", "from and to are milliseconds since 1970")
    return begin * 1_000_000, end * 1_000_000


def _file(content: bytes, kind: str, name: str) -> web.Response:
    return web.Response(
        body=content, content_type=kind, headers={"Content-Disposition": f'attachment; filename="{name}"'}
    )


async def _export(asked: Asked, what: str) -> None:
    await asked.centre.store.write(
        lambda database: audit(database, time.time_ns(), asked.session.user, "export", what)
    )


# ---- what is answered ----------------------------------------------------------------------------


async def me(asked: Asked) -> Json:
    session = asked.session
    return {"user": session.user, "role": session.role, "csrf": session.csrf, **asked.centre.state()}


async def stations(asked: Asked) -> list[Json]:
    return [station.view() for station in asked.centre.model.stations.values()]


async def points(asked: Asked) -> list[Json]:
    station = _asked(asked, "station", 0)
    search = asked.query.get("search", "").casefold()
    return [
        point.view()
        for point in list(asked.centre.model.points.values())
        if (not station or point.station == station) and search in point.meaning.name.casefold()
    ]


async def history(asked: Asked) -> Any:
    point = asked.centre.point(_id(asked))
    begin, end = _span(asked, 3600)
    as_file = asked.query.get("format") == "csv"
    rows = await asked.centre.store.read(
        "SELECT at_ns / 1000000 AS at, value, quality, cause FROM history"
        " WHERE point = ? AND at_ns BETWEEN ? AND ? ORDER BY at_ns DESC LIMIT ?",
        point.id, begin, end, ROWS_MOST if as_file else ROWS * 10,
    )  # fmt: skip
    rows.reverse()
    if not as_file:
        return rows
    await _export(asked, f"history of {point.meaning.name}")
    columns = ["time", "value", "quality", "cause"]
    lines = ((moment(row["at"]), row["value"], row["quality"], row["cause"]) for row in rows)
    return _file(formats.table(columns, lines), "text/csv", f"point-{point.id}.csv")


async def events(asked: Asked) -> Any:
    """Newest first."""
    begin, end = _span(asked, DAY_S)
    as_file = asked.query.get("format") == "csv"
    station = _asked(asked, "station", 0)
    rows = await asked.centre.store.read(
        "SELECT history.id, history.at_ns / 1000000 AS at, points.station, history.point, history.value,"
        " history.quality, history.cause FROM history JOIN points ON points.id = history.point"
        " WHERE history.at_ns BETWEEN ? AND ? AND (? = 0 OR points.station = ?)"
        " ORDER BY history.at_ns DESC LIMIT ?",
        begin, end, station, station, ROWS_MOST if as_file else ROWS,
    )  # fmt: skip
    if not as_file:
        return rows
    await _export(asked, "events")
    model = asked.centre.model
    lines = (
        (
            moment(row["at"]),
            model.stations[row["station"]].settings.name,
            model.points[row["point"]].meaning.name,
            row["value"],
            row["quality"],
            row["cause"],
        )
        for row in rows
    )
    columns = ["time", "station", "point", "value", "quality", "cause"]
    return _file(formats.table(columns, lines), "text/csv", "events.csv")


def _names(asked: Asked) -> dict[int, str]:
    """Of the points that are places: the station's, with the object's address where it has several."""
    model = asked.centre.model
    places = [point for point in model.points.values() if point.is_position]
    several = [point.station for point in places]
    return {
        point.id: model.stations[point.station].settings.name
        + (f" {point.ca}.{point.ioa}" if several.count(point.station) > 1 else "")
        for point in places
    }


async def positions(asked: Asked) -> Any:
    """The last one of each, as in figure 7 of the positioning paper."""
    names = _names(asked)
    model = asked.centre.model
    marks = []
    for id_, name in names.items():
        view = model.points[id_].view()
        place = Place(view["at"] or 0, view["latitude"], view["longitude"], view["altitude"],
                      view["quality"], view["fix"], view["satellites"])  # fmt: skip
        marks.append((name, place))
    return await _places(asked, "positions", marks, [])


async def tracks(asked: Asked) -> Any:
    names = _names(asked)
    chosen = _asked(asked, "point", 0)
    if chosen and chosen not in names:
        raise RefusedError(404, "unknown", f"point {chosen} is no place")
    begin, end = _span(asked, 3600)
    found = []
    for id_ in [chosen] if chosen else list(names):
        rows = await asked.centre.store.read(
            "SELECT * FROM track WHERE point = ? AND at_ns BETWEEN ? AND ? ORDER BY at_ns LIMIT ?",
            id_, begin, end, ROWS_MOST,
        )  # fmt: skip
        places = (
            Place(row["at_ns"] // 1_000_000, row["latitude"] / 1e7, row["longitude"] / 1e7,
                  row["altitude"] / 10, row["quality"], row["detail"] & 15, row["detail"] >> 4)
            for row in rows
        )  # fmt: skip
        found.append(Track(names[id_], formats.segments(places, asked.centre.settings.gap_s)))
    return await _places(asked, "tracks", [], found)


async def _places(
    asked: Asked, what: str, marks: list[tuple[str, Place]], found: list[Track]
) -> web.Response:
    form = asked.query.get("format", "geojson")
    if form not in formats.FORMATS:
        raise RefusedError(400, "form", f"{form} is no format: {', '.join(formats.FORMATS)}")
    kind, write = formats.FORMATS[form]
    if "format" in asked.query:
        await _export(asked, f"{what} as {form}")
    return _file(write(marks, found), kind, f"{what}.{form}")


async def alarms(asked: Asked) -> list[Json]:
    """Open ones; with from or to, all of that time, newest first."""
    if not {"from", "to"} & asked.query.keys():
        return [alarm.view() for alarm in asked.centre.model.alarms.values()]
    begin, end = _span(asked, DAY_S)
    rows = await asked.centre.store.read(
        "SELECT * FROM alarms WHERE since_ns BETWEEN ? AND ? ORDER BY since_ns DESC LIMIT ?", begin, end, ROWS
    )
    return [Alarm(**row).view() for row in rows]


async def acknowledge(asked: Asked) -> Json:
    return (await asked.centre.acknowledge(asked.session.user, _id(asked))).view()


async def shelve(asked: Asked) -> Json:
    return (await asked.centre.shelve(asked.session.user, _id(asked), asked.body["minutes"])).view()


async def commands(asked: Asked) -> list[Json]:
    """Newest first."""
    rows = await asked.centre.store.read(
        f"SELECT {', '.join(COMMAND_COLUMNS)} FROM commands ORDER BY id DESC LIMIT ?", ROWS
    )
    return [Command(**row).view() for row in rows]


async def one_command(asked: Asked) -> Json:
    rows = await asked.centre.store.read(
        f"SELECT {', '.join(COMMAND_COLUMNS)} FROM commands WHERE id = ?", _id(asked)
    )
    if not rows:
        raise RefusedError(404, "unknown", f"there is no command {asked.path['id']}")
    return Command(**rows[0]).view()


async def command(asked: Asked) -> Json:
    value = asked.body["value"]
    if not math.isfinite(value):
        raise RefusedError(400, "form", "value: a finite number is needed")
    return (await asked.centre.command(asked.session.user, asked.body["point"], value)).view()


async def execute(asked: Asked) -> Json:
    return (await asked.centre.follow(asked.session.user, _id(asked), True)).view()


async def cancel(asked: Asked) -> Json:
    return (await asked.centre.follow(asked.session.user, _id(asked), False)).view()


async def interrogate(asked: Asked) -> Json:
    return {"common_addresses": await asked.centre.interrogate(asked.session.user, _id(asked))}


async def audited(asked: Asked) -> list[Json]:
    """Newest first."""
    return await asked.centre.store.read(
        "SELECT id, at_ns / 1000000 AS at, user, action, detail FROM audit ORDER BY id DESC LIMIT ?", ROWS
    )


async def all_users(asked: Asked) -> list[Json]:
    return await asked.centre.store.read("SELECT name, role FROM users ORDER BY name")


async def put_user(asked: Asked) -> Json:
    body = asked.body
    by = asked.session.user
    await asked.centre.store.write(
        lambda database: users.put(database, body["name"], body["role"], body["password"], by)
    )
    return {}


async def remove_user(asked: Asked) -> Json:
    name, by = asked.path["name"], asked.session.user
    if name == by:
        raise RefusedError(409, "yourself", "another engineer must remove you")
    await asked.centre.store.write(lambda database: users.remove(database, name, by))
    return {}


async def token(asked: Asked) -> Json:
    body, user = asked.body, asked.session.user
    seconds = body["days"] * DAY_S
    return {
        "token": await asked.centre.store.write(
            lambda database: users.begin(database, user, body["label"], seconds)
        )
    }


async def openapi(asked: Asked) -> Json:
    return document()


# ---- the table -----------------------------------------------------------------------------------


def _object(required: list[str], **properties: Json) -> Json:
    return {"type": "object", "required": required, "properties": properties}


MILLISECONDS = {"type": "integer", "description": "milliseconds since 1970, UTC"}
SPAN: dict[str, Json] = {"from": MILLISECONDS, "to": MILLISECONDS}
STATION: dict[str, Json] = {"station": {"type": "integer", "description": "only of this one"}}
CSV: dict[str, Json] = {"format": {"type": "string", "enum": ["csv"]}}
FORMAT: dict[str, Json] = {"format": {"type": "string", "enum": list(formats.FORMATS)}}
NAME = {"type": "string", "minLength": 1, "maxLength": users.NAME_MOST}
NUMBER = {"type": "number"}

ROUTES = [
    Route("GET", "/api/openapi.json", "viewer", "this document", openapi),
    Route("GET", "/api/me", "viewer", "who is logged in, and the token that changes need", me),
    Route("GET", "/api/stations", "viewer", "all stations", stations),
    Route("GET", "/api/points", "viewer", "points with their last values", points,
          {**STATION, "search": {"type": "string", "description": "a part of the name"}}),
    Route("GET", "/api/points/{id}/history", "viewer", "values of a point, the last hour unless asked for",
          history, {**SPAN, **CSV}),
    Route("GET", "/api/events", "viewer", "changes of all points, the last day unless asked for", events,
          {**SPAN, **STATION, **CSV}),
    Route("GET", "/api/positions", "viewer", "the last position of each vehicle", positions, FORMAT,
          answer="application/geo+json"),
    Route("GET", "/api/tracks", "viewer", "ways of vehicles; a gap begins a new segment", tracks,
          {**SPAN, **FORMAT, "point": {"type": "integer"}}, answer="application/geo+json"),
    Route("GET", "/api/alarms", "viewer", "open alarms, or all of a time", alarms, SPAN),
    Route("POST", "/api/alarms/{id}/acknowledge", "operator", "acknowledge an alarm", acknowledge),
    Route("POST", "/api/alarms/{id}/shelve", "operator", "put an alarm aside for minutes; 0 brings it back",
          shelve, body=_object(["minutes"], minutes={"type": "number", "minimum": 0, "maximum": 10080})),
    Route("GET", "/api/commands", "viewer", "the last commands", commands),
    Route("GET", "/api/commands/{id}", "viewer", "one command", one_command),
    Route("POST", "/api/commands", "operator", "select, or command where nothing is selected", command,
          body=_object(["point", "value"], point={"type": "integer"}, value=NUMBER)),
    Route("POST", "/api/commands/{id}/execute", "operator", "execute what is selected", execute),
    Route("POST", "/api/commands/{id}/cancel", "operator", "cancel what is selected", cancel),
    Route("POST", "/api/stations/{id}/interrogate", "operator", "a general interrogation", interrogate),
    Route("GET", "/api/audit", "engineer", "who did what", audited),
    Route("GET", "/api/users", "engineer", "all users", all_users),
    Route("POST", "/api/users", "engineer", "add a user, or give a new role and password", put_user,
          body=_object(["name", "role", "password"], name=NAME, role={"enum": list(users.ROLES)},
                       password={"type": "string", "maxLength": 256})),
    Route("DELETE", "/api/users/{name}", "engineer", "remove a user", remove_user),
    Route("POST", "/api/tokens", "viewer", "a token of one's own, for a program", token,
          body=_object(["label", "days"], label=NAME,
                       days={"type": "number", "exclusiveMinimum": 0, "maximum": TOKEN_DAYS_MOST})),
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
