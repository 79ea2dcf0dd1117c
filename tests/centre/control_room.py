# SPDX-License-Identifier: GPL-3.0-or-later
"""A control centre at work for a test: simulated stations, rtu-centre, the centre, and who asks it."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import sqlite3
import ssl
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Coroutine, Iterable
from functools import partial
from pathlib import Path
from typing import Any, Self
from unittest import mock

import aiohttp

from lab.centre_client import LIMIT_S, AnswerError, Client
from lab.gateway import free_port
from lab.vehicles import SPONTANEOUS, Station
from openrtu_tools.centre.database import open_store
from openrtu_tools.centre.settings import load
from openrtu_tools.centre.users import put
from postgres import Server

HANG_S = 300.0  # on a busy host PostgreSQL is asked a few times a second only, for each event
ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "build" / "centre" / "page"
PASSWORD = "correct horse battery"
USERS = {"vera": "viewer", "olga": "operator", "omar": "operator", "emil": "engineer"}

POINTS = """ca,ioa,type,command_type,name,unit,select,min,max,high,state
1,1,,,place,,,,,,
1,2,M_SP_NA_1,C_SC_NA_1,pump,,true,,,,
1,3,M_SP_NA_1,C_SC_NA_1,lamp,,,0,1,,
1,4,M_ME_NC_1,,level,m,,,,4.5,
1,5,M_SP_NA_1,,fire,,,,,,1
"""


def now_ms() -> int:
    return time.time_ns() // 1_000_000


def until(found: Callable[[], Any], what: str, pause_s: float = 0.02) -> Any:
    """What is found, once there is something. The time is for a hang only."""
    end = time.monotonic() + HANG_S
    while not (something := found()):
        assert time.monotonic() < end, f"not seen: {what}"
        time.sleep(pause_s)
    return something


class Stations:
    """Simulated stations, in a thread of their own."""

    def __init__(self) -> None:
        self.loop = asyncio.new_event_loop()
        self.thread = threading.Thread(target=self.loop.run_forever, daemon=True)
        self.thread.start()

    def do(self, work: Coroutine[Any, Any, Any]) -> Any:
        return asyncio.run_coroutine_threadsafe(work, self.loop).result(LIMIT_S)

    def station(self, **keys: Any) -> Station:
        made = Station(**keys)
        self.do(made.listen())
        return made

    def say(self, station: Station, ioa: int, type_: int, element: bytes) -> None:
        self.loop.call_soon_threadsafe(station.say, ioa, type_, element)

    def keep(self, station: Station, ioa: int, type_: int, elements: Iterable[bytes]) -> None:
        """Events that have waited for a connection: it is lost, and there is another one. They are older than
        what the station gives back to its queue."""
        self.do(station.stop())
        until(lambda: not station.is_connected, "it has no connection")
        events = [station.asdu(type_, SPONTANEOUS, ioa, element) for element in elements]
        station.queue.extendleft(reversed(events))
        self.do(station.listen())

    def close(self) -> None:
        self.loop.call_soon_threadsafe(self.loop.stop)
        self.thread.join(LIMIT_S)


class Site:
    """rtu-centre and the centre, with their file; either can be killed and started again."""

    def __init__(
        self,
        programs: Path,
        folder: Path,
        stations: list[dict[str, Any]],
        page: Path | None = None,
        users: Iterable[str] = USERS,
        server: Server | None = None,
        **keys: Any,
    ) -> None:
        """With a server its database is a new one there, else a file of SQLite."""
        self.server = server
        self.folder = folder
        self.port = free_port()
        self.file = folder / "centre.json"
        self.page = page
        self.tls: ssl.SSLContext | None = None  # with which it is asked
        self.before: list[str] = []  # starts the centre, as prlimit
        content = {"retry_ms": 50, "retry_max_ms": 200, "stations": stations, **keys}
        content["centre"] = {"port": self.port, **keys.get("centre", {})}
        if server:
            content["centre"]["database"] = server.new_database()
        self.file.write_text(json.dumps(content))
        self.environment = {
            **os.environ,
            "PYTHONPATH": str(ROOT / "scripts"),
            "OPENRTU_RTUD": str(programs / "rtud" / "rtud"),
        }
        self.program = programs / "centre" / "rtu-centre"
        self.collector: subprocess.Popen[str] | None = None
        self.centre: subprocess.Popen[str] | None = None
        for name in list(users)[:1]:
            self.run("user", name, "--role", USERS[name], stdin=PASSWORD)
        with (
            mock.patch.dict(os.environ, self.environment),
            contextlib.closing(open_store(load(self.file).database, alone=False)) as store,
        ):
            for name in list(users)[1:]:  # each would cost a process
                store.transaction(partial(put, name=name, role=USERS[name], password=PASSWORD, by="tests"))

    def run(self, *words: str, stdin: str = "") -> str:
        done = subprocess.run(
            [sys.executable, "-m", "openrtu_tools", "centre", self.file, *words],
            input=stdin, capture_output=True, text=True, env=self.environment, timeout=LIMIT_S, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        return done.stdout

    def start_collector(self) -> None:
        file = self.folder / "rtu-centre.json"
        if not file.exists():
            file.write_text(self.run("collector"))
        log = (self.folder / "collector.log").open("a")
        self.collector = subprocess.Popen([self.program, file], stderr=log, text=True)

    def start_centre(self) -> None:
        log = (self.folder / "centre.log").open("a")
        page = ("--page", str(self.page)) if self.page else ()
        serve = ("-m", "openrtu_tools", "centre", str(self.file), "serve", *page)
        command = [*self.before, sys.executable, *serve]
        self.centre = subprocess.Popen(command, stderr=log, text=True, env=self.environment)
        until(self.answers, f"the centre answers: {self.log()}")

    def rows(self, sql: str) -> list[tuple[Any, ...]]:
        """Of the database, whichever it is; asked by a program that is not the centre's."""
        if self.server:
            return self.server.rows(sql)
        with contextlib.closing(sqlite3.connect(self.folder / "centre.db")) as database:
            return list(database.execute(sql))

    def log(self) -> str:
        return (self.folder / "centre.log").read_text() if (self.folder / "centre.log").exists() else ""

    def answers(self) -> bool:
        try:
            self.client().raw("GET", "/api/me")
        except AnswerError:
            return True
        except OSError:
            assert self.centre and self.centre.poll() is None, self.log()
            return False
        return True

    def client(self, name: str = "") -> Client:
        made = Client(self.port, tls=self.tls)
        return made.login(name, PASSWORD) if name else made

    def __enter__(self) -> Self:
        self.start_collector()
        self.start_centre()
        return self

    def __exit__(self, *_: object) -> None:
        for process in (self.centre, self.collector):
            if process and process.poll() is None:
                process.send_signal(signal.SIGTERM)
                try:
                    process.wait(LIMIT_S)
                except subprocess.TimeoutExpired:
                    process.kill()
                    raise

    def kill(self, process: subprocess.Popen[str] | None) -> None:
        assert process
        process.kill()
        process.wait(LIMIT_S)


def described(
    station: Station, folder: Path, name: str = "north", points: str = POINTS, **keys: Any
) -> dict[str, Any]:
    """It in the centre's file, with a list of points."""
    (folder / f"{station.port}.csv").write_text(points)
    address = {"address": "127.0.0.1", "port": station.port, "common_addresses": [station.ca]}
    return {"name": name, **address, "points": f"{station.port}.csv", **keys}


class Watch:
    """A page that watches, without a browser: all that it is told, in a thread of the stations'."""

    def __init__(self, stations: Stations, client: Client, view: dict[str, Any]) -> None:
        self.messages: list[dict[str, Any]] = []
        self.client = client
        self.socket: aiohttp.ClientWebSocketResponse | None = None
        self.stations = stations
        self.listening = asyncio.run_coroutine_threadsafe(self._listen(view), stations.loop)

    async def _listen(self, view: dict[str, Any]) -> None:
        async with (
            aiohttp.ClientSession(headers=self.client.headers) as session,
            session.ws_connect(f"http://127.0.0.1:{self.client.port}/api/stream") as self.socket,
        ):
            await self.socket.send_json(view)
            async for message in self.socket:
                self.messages.append(message.json())

    def look(self, view: dict[str, Any]) -> None:
        assert self.socket
        self.stations.do(self.socket.send_json(view))

    @property
    def fault(self) -> str:
        return str(self.messages[-1]["fault"]) if self.messages else ""

    def __enter__(self) -> Self:
        until(lambda: self.messages, "the page is told all once")
        return self

    def __exit__(self, *_: object) -> None:
        self.listening.cancel()
