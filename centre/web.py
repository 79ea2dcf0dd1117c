# SPDX-License-Identifier: GPL-3.0-or-later
"""The HTTP server: who may, what is asked, and the page. The routes are in api.py."""

from __future__ import annotations

import asyncio
import logging
import math
import mimetypes
import os
import stat
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from aiohttp import web
from aiohttp.abc import AbstractStreamWriter

from openrtu_tools.centre import peers, users
from openrtu_tools.centre.centre import Centre
from openrtu_tools.centre.errors import CentreError, RefusedError, StoreError
from openrtu_tools.centre.login import Login
from openrtu_tools.centre.model import Point, Station
from openrtu_tools.centre.settings import Oidc
from openrtu_tools.centre.stream import MESSAGE_MOST, Stream
from openrtu_tools.centre.users import Session
from openrtu_tools.centre.wire import Json, check, check_text, read_body
from openrtu_tools.missing import what_to_type

if TYPE_CHECKING:
    from openrtu_tools.centre.oidc import Logins

log = logging.getLogger("centre")

COOKIE = "openrtu_session"
CSRF = "X-CSRF-Token"
BODY_MOST = 64 * 1024
SEEN_S, SEEN_AGAIN_S = 60, 5.0  # how exactly is kept when a session was used last
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

Handler = Callable[["Asked"], Awaitable[Any]]


@dataclass(frozen=True)
class Asked:
    """A request of somebody who may, its parameters and body checked."""

    centre: Centre
    session: Session
    login: Login
    address: str  # where it comes from
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
    token: bool = True  # a program may, too


class File(web.FileResponse):
    """What is open is sent: its tag and its octets are of one file, whatever is put in its place meanwhile.

    A range of it, if If-Range has its very tag; else all of it. aiohttp looks at no tag, and takes a file
    that is older than a date for the same one.
    """

    def __init__(self, file: IO[bytes], kind: str, cache: str) -> None:
        """Of a file that is open, and is closed then."""
        super().__init__(
            f"/proc/self/fd/{file.fileno()}", headers={"Cache-Control": cache, "Content-Type": kind}
        )
        self.file = file

    async def prepare(self, request: web.BaseRequest) -> AbstractStreamWriter | None:
        with self.file:
            known = request.headers.get("If-Range")
            if known is not None:
                headers = request.headers.copy()
                del headers["If-Range"]
                if known != self._tag():
                    headers.popall("Range", None)
                request = request.clone(headers=headers)
            return await super().prepare(request)

    def _tag(self) -> str:
        """As aiohttp has it."""
        found = os.fstat(self.file.fileno())
        return f'"{found.st_mtime_ns:x}-{found.st_size:x}"'


def _open(path: Path) -> IO[bytes]:
    """Raises OSError, too, if it is no file."""
    number = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        if not stat.S_ISREG(os.fstat(number).st_mode):
            raise IsADirectoryError(path)
        return os.fdopen(number, "rb")
    except OSError:
        os.close(number)
        raise


async def opened(path: Path, cache: str = "no-cache") -> File:
    kind = mimetypes.guess_type(path.name)[0] or "application/octet-stream"
    try:
        return File(await asyncio.to_thread(_open, path), kind, cache)
    except OSError as error:
        raise web.HTTPNotFound(reason="there is no such file") from error


class Server:
    """The application of aiohttp."""

    def __init__(self, centre: Centre, routes: list[Route], page: Path) -> None:
        self.centre = centre
        self.page = page
        self.login = Login(centre)
        self.seen: dict[bytes, int] = {}  # since when it is not stored yet that a session was used
        self.application = web.Application(middlewares=[self.guard], client_max_size=BODY_MOST)
        self.application.cleanup_ctx.append(self.keep_notes)
        router = self.application.router
        router.add_post("/api/login", self.log_in)
        router.add_post("/api/logout", self.log_out)
        router.add_get("/api/stream", self.stream)
        router.add_get("/api/oidc", self.provider)
        self.logins = provided(self, centre.settings.oidc) if centre.settings.oidc else None
        if self.logins:
            self.logins.add_routes(router)
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
        place = getattr(request.protocol, "place", None)
        if place:
            place.begin()
        try:
            response = await self.answered(request, handler)
        finally:
            if place:
                place.done()
        return response

    async def answered(
        self, request: web.Request, handler: Callable[[web.Request], Awaitable[web.StreamResponse]]
    ) -> web.StreamResponse:
        try:
            response = await handler(request)
        except RefusedError as error:
            response = refusal(error)
        except web.HTTPException as error:
            response = web.json_response({"code": "http", "error": error.reason}, status=error.status)
        except ConnectionError:  # whoever asked has left meanwhile
            response = web.Response(status=408)
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
            session = await self.allowed(request, route)
            for text in (*request.query.keys(), *request.query.values(), *request.match_info.values()):
                check_text(text)
            check(
                {
                    "type": "object",
                    "properties": {name: {} for name in route.query},
                    "additionalProperties": False,
                },
                dict(request.query),
            )
            body: Json = {}
            if route.body:
                body = await read_body(request, route.body)
                session = await self.allowed(request, route)  # which may have ended while the body came
            address = self.source(request)
            if route.confirms:
                await self.login.confirm(session, body["own_password"], address)
            asked = Asked(
                self.centre, session, self.login, address, request,
                dict(request.match_info), dict(request.query), body,
            )  # fmt: skip
            result = await route.handler(asked)
            return result if isinstance(result, web.StreamResponse) else web.json_response(result)

        return answer

    async def allowed(self, request: web.Request, route: Route) -> Session:
        session = await self.session(request)
        if session.label and not route.token:
            raise RefusedError(403, "token", "a token does not do this: log in")
        if not session.may(route.role):
            raise RefusedError(403, "role", f"this needs the role {route.role}")
        return session

    def source(self, request: web.Request) -> str:
        forwarded = request.headers.getall("X-Forwarded-For", [])
        return peers.source(request.remote or "", forwarded, self.centre.settings.proxies)

    async def session(self, request: web.Request) -> Session:
        """Raises RefusedError. A browser sends the cookie by itself: what changes something needs more."""
        kind, _, token = request.headers.get("Authorization", "").partition(" ")
        by_token = kind == "Bearer"
        secret = token if by_token else request.cookies.get(COOKIE, "")
        session = await self.known(secret) if secret else None
        if not session or bool(session.label) != by_token:
            raise RefusedError(401, "session", "log in: there is no such session, or it has ended")
        if request.method != "GET" and not by_token and request.headers.get(CSRF) != session.csrf:
            raise RefusedError(403, "csrf", f"the header {CSRF} is missing or wrong: load the page again")
        if place := getattr(request.protocol, "place", None):
            place.member = True
        return session

    async def known(self, secret: str) -> Session | None:
        check_text(secret)
        if session := await self.login.find_kept(secret):
            return session
        rows = await self.centre.store.read(users.FIND, *users.find_values(secret))
        if not rows:
            return None
        now_s = int(time.time())
        if now_s - rows[0]["seen_s"] >= SEEN_S:
            self.seen[rows[0]["hash"]] = now_s
        return users.found(rows[0])

    async def keep_notes(self, _: web.Application) -> AsyncIterator[None]:
        """Beside all requests: when sessions were used, and what was refused."""
        noting = [asyncio.create_task(self.note_seen()), asyncio.create_task(self.login.audit_refused())]
        yield
        for task in noting:
            task.cancel()
        await asyncio.gather(*noting, return_exceptions=True)

    async def note_seen(self) -> None:
        """All in one transaction. That it cannot be stored stops nobody."""
        while True:
            await asyncio.sleep(SEEN_AGAIN_S)
            seen, self.seen = self.seen, {}
            if seen:
                with suppress(StoreError):
                    await self.centre.store.write(lambda database, seen=seen: users.seen(database, seen))

    # ---- sessions ----------------------------------------------------------------------------

    async def log_in(self, request: web.Request) -> web.Response:
        text = {"type": "string", "maxLength": 256}
        schema = {
            "type": "object",
            "required": ["name", "password"],
            "properties": {"name": text, "password": text, "code": {"type": "string", "maxLength": 32}},
        }
        check_origin(request)
        body = await read_body(request, schema)
        address = self.source(request)
        row = await self.login.row_of(body["name"], body["password"], address)
        secret = await self.login.begin(row, address, body.get("code", ""))
        response = web.json_response({})
        self.give_session(response, secret, self.centre.settings.session_h)
        return response

    def give_session(self, response: web.Response, secret: str, hours: float) -> None:
        response.set_cookie(
            COOKIE, secret, max_age=int(hours * 3600), httponly=True, samesite="Strict",
            secure=self.centre.settings.secure, path="/",
        )  # fmt: skip

    async def provider(self, request: web.Request) -> web.Response:
        """What the page calls it; "" if users come from nowhere else."""
        oidc = self.centre.settings.oidc
        return web.json_response({"label": oidc.label if oidc else ""})

    async def log_out(self, request: web.Request) -> web.Response:
        """Here in any case; then the page is told where the provider ends it, too."""
        session = await self.session(request)
        await self.login.end(request.cookies.get(COOKIE, ""))
        response = web.json_response({"provider": await self.logins.leaving(session) if self.logins else ""})
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
        """A map of one's own, of which the page asks ranges. What Chromium stores of one it asks for with
        If-Range: of another one all of it would come, and the page takes a piece only."""
        await self.session(request)
        path = self.centre.settings.tiles
        if not path:
            raise web.HTTPNotFound(reason="there is no map of one's own")
        return await opened(path, "no-store")

    async def file(self, request: web.Request) -> web.StreamResponse:
        """What was built, and nothing else."""
        name = request.match_info["file"] or "index.html"
        check_text(name)
        try:
            path = (self.page / name).resolve()
            found = path.is_relative_to(self.page.resolve())
        except (OSError, RuntimeError):  # no file can be called so
            found = False
        if not found:
            raise web.HTTPNotFound(reason="there is no such file")
        return await opened(path)


def provided(server: Server, settings: Oidc) -> Logins:
    try:
        from openrtu_tools.centre.oidc import Logins  # who has no provider needs no Authlib
    except ModuleNotFoundError as error:
        raise CentreError(what_to_type(error, "oidc")) from error
    return Logins(server, settings)


def refusal(error: RefusedError) -> web.Response:
    answer: Json = {"code": error.code, "error": str(error)}
    headers = {}
    if error.wait_s:
        answer["wait_s"] = math.ceil(error.wait_s)
        headers["Retry-After"] = str(answer["wait_s"])
    return web.json_response(answer, status=error.status, headers=headers)


def check_origin(request: web.Request) -> None:
    """A page of elsewhere is sent away; a program names no origin."""
    origin = request.headers.get("Origin")
    if origin and origin.partition("://")[2] != request.host:
        raise RefusedError(403, "origin", f"{origin} is another site")
