# SPDX-License-Identifier: GPL-3.0-or-later
"""The HTTP server: who may, what is asked, and the page. The routes are in api.py."""

from __future__ import annotations

import asyncio
import json
import logging
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import jsonschema
from aiohttp import web

from openrtu_tools.centre import users
from openrtu_tools.centre.centre import Centre
from openrtu_tools.centre.errors import RefusedError, StoreError
from openrtu_tools.centre.model import Point, Station
from openrtu_tools.centre.stream import MESSAGE_MOST, Stream
from openrtu_tools.centre.users import Session

log = logging.getLogger("centre")

COOKIE = "openrtu_session"
CSRF = "X-CSRF-Token"
BODY_MOST = 64 * 1024
GUESSES, GUESSES_S = 5, 60.0  # so many wrong passwords of a name, and it waits so long
GUESSED_NAMES = 10_000
HASHES_AT_ONCE = 2  # each takes 16 MiB
HEADERS = {
    # maplibre draws its symbols from blobs; all code is ours.
    "Content-Security-Policy": "default-src 'self'; img-src 'self' data: blob:; worker-src 'self' blob:;"
    " object-src 'none'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "geolocation=(), camera=(), microphone=()",
}

Json = dict[str, Any]
Handler = Callable[["Asked"], Awaitable[Any]]


@dataclass(frozen=True)
class Asked:
    """A request of somebody who may, its parameters and body checked."""

    centre: Centre
    session: Session
    request: web.Request
    path: dict[str, str]
    query: dict[str, str]
    body: Json

    # What the user sees. Whatever else there is, is not there for the user.

    def stations(self) -> dict[int, Station]:
        return {id_: each for id_, each in self.centre.model.stations.items() if self.session.sees(each)}

    def sees(self, station: int) -> bool:
        return self.session.sees(self.centre.model.stations[station])

    def points(self) -> list[Point]:
        stations = self.stations()
        return [point for point in self.centre.model.points.values() if point.station in stations]

    def station(self, id_: int) -> Station:
        station = self.centre.station(id_)
        if not self.session.sees(station):
            raise RefusedError(404, "unknown", f"there is no station {id_}")
        return station

    def point(self, id_: int) -> Point:
        point = self.centre.point(id_)
        if not self.sees(point.station):
            raise RefusedError(404, "unknown", f"there is no point {id_}")
        return point


@dataclass(frozen=True)
class Route:
    method: str
    path: str
    role: str
    summary: str
    handler: Handler
    query: dict[str, Json] = field(default_factory=dict)
    body: Json | None = None
    answer: str = "application/json"
    confirms: bool = False  # who asks says the own password again, as `own_password` of the body


class Server:
    """The application of aiohttp."""

    def __init__(self, centre: Centre, routes: list[Route], page: Path) -> None:
        self.centre = centre
        self.page = page
        self.guesses: dict[str, tuple[int, float]] = {}
        self.hashing = asyncio.Semaphore(HASHES_AT_ONCE)
        self.application = web.Application(middlewares=[self.guard], client_max_size=BODY_MOST)
        router = self.application.router
        router.add_post("/api/login", self.login)
        router.add_post("/api/logout", self.logout)
        router.add_get("/api/stream", self.stream)
        for route in routes:
            router.add_route(route.method, route.path, self.answering(route))
        router.add_get("/map/own.pmtiles", self.tiles)
        router.add_get("/{file:.*}", self.file)

    # ---- each request ------------------------------------------------------------------------

    @web.middleware
    async def guard(
        self, request: web.Request, handler: Callable[[web.Request], Awaitable[web.StreamResponse]]
    ) -> web.StreamResponse:
        """Errors as JSON, and the headers that keep a browser from running what is not ours."""
        try:
            response = await handler(request)
        except RefusedError as error:
            response = web.json_response({"code": error.code, "error": str(error)}, status=error.status)
        except web.HTTPException as error:
            response = web.json_response({"code": "http", "error": error.reason}, status=error.status)
        except StoreError as error:
            log.error("%s %s: %s", request.method, request.path, error)
            response = web.json_response({"code": "store", "error": f"the database: {error}"}, status=503)
        if not response.prepared:
            response.headers.update(HEADERS)
            if request.path.startswith("/api/"):
                response.headers["Cache-Control"] = "no-store"
        return response

    def answering(self, route: Route) -> Callable[[web.Request], Awaitable[web.StreamResponse]]:
        async def answer(request: web.Request) -> web.StreamResponse:
            session = await self.session(request)
            if not session.may(route.role):
                raise RefusedError(403, "role", f"this needs the role {route.role}")
            query = dict(request.query)
            check(
                {
                    "type": "object",
                    "properties": {name: {} for name in route.query},
                    "additionalProperties": False,
                },
                query,
            )
            body = await read_body(request, route.body) if route.body else {}
            if route.confirms and not await self.fits(session.user, body["own_password"], request.remote):
                raise RefusedError(403, "own_password", "your own password is wrong")
            asked = Asked(self.centre, session, request, dict(request.match_info), query, body)
            result = await route.handler(asked)
            return result if isinstance(result, web.StreamResponse) else web.json_response(result)

        return answer

    async def session(self, request: web.Request) -> Session:
        """Raises RefusedError. A browser sends the cookie by itself: what changes something needs more."""
        kind, _, token = request.headers.get("Authorization", "").partition(" ")
        by_token = kind == "Bearer"
        secret = token if by_token else request.cookies.get(COOKIE, "")
        rows = await self.centre.store.read(users.FIND, *users.find_values(secret)) if secret else []
        if not rows or bool(rows[0]["label"]) != by_token:
            raise RefusedError(401, "session", "log in: there is no such session, or it has ended")
        session = users.found(rows[0])
        if request.method != "GET" and not by_token and request.headers.get(CSRF) != session.csrf:
            raise RefusedError(403, "csrf", f"the header {CSRF} is missing or wrong: load the page again")
        return session

    # ---- sessions ----------------------------------------------------------------------------

    async def login(self, request: web.Request) -> web.Response:
        text = {"type": "string", "maxLength": 256}
        schema = {
            "type": "object",
            "required": ["name", "password"],
            "properties": {"name": text, "password": text},
        }
        check_origin(request)
        body = await read_body(request, schema)
        name = body["name"]
        if not await self.fits(name, body["password"], request.remote):
            raise RefusedError(401, "password", "the name or the password is wrong")
        seconds = self.centre.settings.session_h * 3600
        secret = await self.centre.store.write(lambda database: users.begin(database, name, "", seconds))
        response = web.json_response({})
        response.set_cookie(
            COOKIE, secret, max_age=int(seconds), httponly=True, samesite="Strict",
            secure=self.centre.settings.secure, path="/",
        )  # fmt: skip
        return response

    async def fits(self, name: str, password: str, remote: str | None) -> bool:
        """Whether it is the user's. Raises RefusedError after too many that are not."""
        wrong, until = self.guesses.get(name, (0, 0.0))
        if wrong >= GUESSES and time.monotonic() < until:
            raise RefusedError(429, "guesses", "too many wrong passwords: wait a minute")
        rows = await self.centre.store.read("SELECT * FROM users WHERE name = ?", name)
        async with self.hashing:
            fits = await asyncio.to_thread(users.fits, password, rows[0] if rows else None)
        if fits:
            self.guesses.pop(name, None)
        else:
            if len(self.guesses) >= GUESSED_NAMES:
                self.guesses.clear()
            self.guesses[name] = (wrong % GUESSES + 1, time.monotonic() + GUESSES_S)
            log.warning("a wrong password or name from %s", remote)
        return fits

    async def logout(self, request: web.Request) -> web.Response:
        await self.session(request)
        secret = request.cookies.get(COOKIE, "")
        await self.centre.store.write(lambda database: users.end(database, secret))
        response = web.json_response({})
        response.del_cookie(COOKIE, path="/")
        return response

    async def stream(self, request: web.Request) -> web.StreamResponse:
        """A browser lets any page open a WebSocket, with our cookie: the origin tells."""
        session = await self.session(request)
        check_origin(request)
        socket = web.WebSocketResponse(heartbeat=20, max_msg_size=MESSAGE_MOST, compress=True)
        await socket.prepare(request)

        async def still_allowed() -> bool:
            try:
                await self.session(request)
            except RefusedError:
                return False
            except StoreError:
                pass  # nobody can say; and while nothing is stored, nothing but that is told
            return True

        await Stream(self.centre, socket, session).run(still_allowed)
        return socket

    # ---- the page ----------------------------------------------------------------------------

    async def tiles(self, request: web.Request) -> web.StreamResponse:
        """A map of one's own, of which the page asks ranges."""
        await self.session(request)
        path = self.centre.settings.tiles
        if not path or not path.is_file():
            raise web.HTTPNotFound(reason="there is no map of one's own")
        return web.FileResponse(path, headers={"Cache-Control": "no-cache"})

    async def file(self, request: web.Request) -> web.StreamResponse:
        """What was built, and nothing else."""
        name = request.match_info["file"] or "index.html"
        path = (self.page / name).resolve()
        if not path.is_relative_to(self.page.resolve()) or not path.is_file():
            raise web.HTTPNotFound(reason=f"there is no {name}")
        return web.FileResponse(path, headers={"Cache-Control": "no-cache"})


def check(schema: Json, value: Any) -> None:
    """Raises RefusedError with the first mistake."""
    error = next(iter(jsonschema.Draft202012Validator(schema).iter_errors(value)), None)
    if error:
        place = ".".join(map(str, error.absolute_path))
        raise RefusedError(400, "form", f"{place + ': ' if place else ''}{error.message}")


def check_origin(request: web.Request) -> None:
    """A page of elsewhere is sent away; a program names no origin."""
    origin = request.headers.get("Origin")
    if origin and origin.partition("://")[2] != request.host:
        raise RefusedError(403, "origin", f"{origin} is another site")


async def read_body(request: web.Request, schema: Json) -> Json:
    if request.content_type != "application/json":
        raise RefusedError(415, "form", "the body must be application/json")
    try:
        body = json.loads(await request.text() or "{}")
    except (ValueError, RecursionError) as error:
        raise RefusedError(400, "form", f"the body is not JSON: {error}") from error
    check({**schema, "additionalProperties": False}, body)
    return body
