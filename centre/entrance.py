# SPDX-License-Identifier: GPL-3.0-or-later
"""The centre's port: who comes, how many of a host, and how long somebody may take to say what is wanted.

It accepts by itself: a connection is counted before its TLS handshake, and what cannot be accepted costs
one line of the log a second.
"""

from __future__ import annotations

import asyncio
import logging
import resource
import socket
import ssl
from collections import OrderedDict
from collections.abc import Iterable, Sequence
from typing import Any

from aiohttp import web
from aiohttp.http_exceptions import HttpProcessingError

from openrtu_tools.centre import peers

log = logging.getLogger("centre")

OF_HOST = 256  # a page has one connection that stays, and six while it loads
MOST = 8192
OTHER_FILES = 64  # that the process may have open beside
FILES = 16_384
HANDSHAKE_S = 10.0
HEAD_S = 10.0  # from the connection, or the end of its handshake, to the end of the first request's head
IDLE_S = 60.0  # between two requests
LINGER_S = 2.0
AGAIN_S = 1.0  # until the next attempt, when none could be accepted
BACKLOG = 256


def raise_file_limit() -> int:
    """As far as the service allows it; how many connections that makes."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = FILES if hard == resource.RLIM_INFINITY else min(FILES, hard)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
        soft = wanted
    files = FILES if soft == resource.RLIM_INFINITY else soft
    return max(min(files - OTHER_FILES, MOST), files // 2)


class Place:
    """A connection's. `busy`: a request is answered; `member`: of somebody who is logged in."""

    def __init__(self, entrance: Entrance, host: str) -> None:
        self.entrance = entrance
        self.host = host
        self.opening: asyncio.Task[None] | None = None
        self.transport: asyncio.BaseTransport | None = None
        self.busy = self.member = False
        self.late: asyncio.TimerHandle | None = None

    def opened(self, transport: asyncio.BaseTransport) -> None:
        self.transport = transport
        self.late = asyncio.get_running_loop().call_later(HEAD_S, self.end)

    def begin(self) -> None:
        """A request's head is there."""
        if self.late:
            self.late.cancel()
        self.busy = True

    def done(self) -> None:
        self.busy = self.member = False
        self.entrance.idle(self)

    def end(self) -> None:
        if isinstance(self.transport, asyncio.WriteTransport):
            self.transport.abort()
        elif self.opening:
            self.opening.cancel()
        self.gone()

    def gone(self) -> None:
        if self.late:
            self.late.cancel()
        self.entrance.leave(self)


class Watched(web.RequestHandler):
    """aiohttp's, which says when it begins and ends."""

    __slots__ = ("place",)
    place: Place

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.place.opened(transport)
        super().connection_made(transport)

    def connection_lost(self, error: BaseException | None) -> None:
        self.place.gone()
        super().connection_lost(error)

    def log_exception(self, *said: Any, **more: Any) -> None:
        """What is no HTTP has its answer; a stranger does not fill the log with it."""
        if not isinstance(more.get("exc_info"), HttpProcessingError | web.RequestPayloadError):
            super().log_exception(*said, **more)


class Entrance(web.BaseSite):
    __slots__ = (
        "_address",
        "_listeners",
        "_loops",
        "_most",
        "_places",
        "_port",
        "_proxies",
        "_said_s",
        "_tls",
    )

    def __init__(
        self,
        runner: web.AppRunner,
        address: str,
        port: int,
        tls: ssl.SSLContext | None,
        proxies: tuple[peers.Network, ...] = (),
    ) -> None:
        super().__init__(runner, shutdown_timeout=1)
        self._address, self._port, self._tls, self._proxies = address, port, tls, proxies
        self._most = raise_file_limit()
        # By host, and in each the one that is idle for longest first.
        self._places: dict[str, OrderedDict[Place, None]] = {}
        self._listeners: list[socket.socket] = []
        self._loops: list[asyncio.Task[None]] = []
        self._said_s = -AGAIN_S

    @property
    def name(self) -> str:
        return f"http{'s' if self._tls else ''}://{self._address}:{self._port}"

    async def start(self) -> None:
        await super().start()
        loop = asyncio.get_running_loop()
        found = await loop.getaddrinfo(
            self._address, self._port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )
        for family, kind, protocol, _, where in dict.fromkeys(found):
            listener = socket.socket(family, kind, protocol)
            self._listeners.append(listener)
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            if family == socket.AF_INET6:
                listener.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
            listener.setblocking(False)
            listener.bind(where)
            listener.listen(BACKLOG)
            self._loops.append(loop.create_task(self._accept(listener)))

    async def stop(self) -> None:
        for task in self._loops:
            task.cancel()
        await asyncio.gather(*self._loops, return_exceptions=True)
        for listener in self._listeners:
            listener.close()
        await super().stop()

    async def _accept(self, listener: socket.socket) -> None:
        loop = asyncio.get_running_loop()
        while True:
            try:
                connection, peer = await loop.sock_accept(listener)
            except ConnectionError:
                continue
            except OSError as error:
                if loop.time() >= self._said_s + AGAIN_S:
                    self._said_s = loop.time()
                    log.error("no connection can be accepted: %s", error.strerror)
                await asyncio.sleep(AGAIN_S)
                continue
            self._enter(connection, peer)
            await asyncio.sleep(0)  # whoever gave way is closed meanwhile: it had a file

    # ---- places ------------------------------------------------------------------------------

    def _enter(self, connection: socket.socket, peer: Sequence[Any]) -> None:
        host = peers.host(peer[0])
        if not self._has_room(host, peer[0]):
            connection.close()
            return
        place = Place(self, host)
        self._places.setdefault(host, OrderedDict())[place] = None
        place.opening = asyncio.get_running_loop().create_task(self._open(place, connection))

    async def _open(self, place: Place, connection: socket.socket) -> None:
        loop = asyncio.get_running_loop()
        times = {"keepalive_timeout": IDLE_S, "lingering_time": LINGER_S}

        def handler() -> Watched:
            made = Watched(self._runner.server, loop=loop, access_log=None, **times)
            made.place = place
            return made

        handshake = {"ssl": self._tls, "ssl_handshake_timeout": HANDSHAKE_S} if self._tls else {}
        try:
            await loop.connect_accepted_socket(handler, connection, **handshake)
        except OSError:  # a failed handshake is one, and one that was too slow
            pass
        finally:
            if place.transport is None:
                place.gone()
                connection.close()

    def _has_room(self, host: str, peer: str) -> bool:
        """The newest comes before those who say nothing, and those before whoever is logged in and asks."""
        of_host = self._places.get(host, OrderedDict())
        address = peers.read(peer)
        forwards = address is not None and peers.is_in(address, self._proxies)
        if len(of_host) >= min(OF_HOST, self._most // 2) and not forwards:
            return self._give_way(of_host)
        if sum(map(len, self._places.values())) >= self._most:
            largest = max(self._places.values(), key=len)
            return self._give_way([*largest, *(each for some in self._places.values() for each in some)])
        return True

    @staticmethod
    def _give_way(places: Iterable[Place]) -> bool:
        """Whether one did."""
        places = list(places)
        for least in (lambda place: not place.busy), (lambda place: not place.member):
            for place in filter(least, places):
                place.end()
                return True
        return False

    def idle(self, place: Place) -> None:
        if place in (of_host := self._places.get(place.host, OrderedDict())):
            of_host.move_to_end(place)

    def leave(self, place: Place) -> None:
        of_host = self._places.get(place.host, OrderedDict())
        of_host.pop(place, None)
        if not of_host:
            self._places.pop(place.host, None)
