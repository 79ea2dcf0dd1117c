# SPDX-License-Identifier: GPL-3.0-or-later
"""A control centre at work for a test: simulated stations, rtu-centre, the centre, and who asks it."""

from __future__ import annotations

import asyncio
import http.client
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any, Self

from lab.gateway import free_port
from lab.vehicles import Station

ROOT = Path(__file__).resolve().parents[2]
LIMIT_S = 60.0  # for a hang only
PASSWORD = "correct horse battery"
USERS = {"vera": "viewer", "olga": "operator", "omar": "operator", "emil": "engineer"}


class AnswerError(AssertionError):
    """The centre refused."""

    def __init__(self, status: int, said: Any) -> None:
        super().__init__(f"{status}: {said}")
        self.status = status
        self.code = said.get("code") if isinstance(said, dict) else None


def until(found: Callable[[], Any], what: str) -> Any:
    """What is found, once there is something. The time is for a hang only."""
    end = time.monotonic() + LIMIT_S
    while not (something := found()):
        assert time.monotonic() < end, f"not seen: {what}"
        time.sleep(0.02)
    return something


class Client:
    """Asks over HTTP, as a browser or, with a token, as a program."""

    def __init__(self, port: int, token: str = "") -> None:
        self.port = port
        self.headers: dict[str, str] = {"Authorization": f"Bearer {token}"} if token else {}

    def login(self, name: str, password: str = PASSWORD) -> Self:
        self.headers = {}
        response, _ = self.raw("POST", "/api/login", {"name": name, "password": password})
        self.headers["Cookie"] = (response.getheader("Set-Cookie") or "").partition(";")[0]
        self.headers["X-CSRF-Token"] = self.get("/api/me")["csrf"]
        return self

    def raw(
        self, method: str, path: str, body: Any = None, **headers: str
    ) -> tuple[http.client.HTTPResponse, bytes]:
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=LIMIT_S)
        said = {"Content-Type": "application/json"} if method != "GET" else {}
        content = json.dumps(body or {}) if method != "GET" else None
        connection.request(method, path, content, {**said, **self.headers, **headers})
        response = connection.getresponse()
        octets = response.read()
        connection.close()
        if response.status >= 400:
            raise AnswerError(response.status, json.loads(octets))
        return response, octets

    def get(self, path: str) -> Any:
        return json.loads(self.raw("GET", path)[1])

    def post(self, path: str, body: Any = None) -> Any:
        return json.loads(self.raw("POST", path, body)[1])


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
        **keys: Any,
    ) -> None:
        self.folder = folder
        self.port = free_port()
        self.file = folder / "centre.json"
        self.page = page
        content = {"retry_ms": 50, "retry_max_ms": 200, "stations": stations, **keys}
        content["centre"] = {"port": self.port, **keys.get("centre", {})}
        self.file.write_text(json.dumps(content))
        self.environment = {
            **os.environ,
            "PYTHONPATH": str(ROOT),
            "OPENRTU_RTUD": str(programs / "rtud" / "rtud"),
        }
        self.program = programs / "centre" / "rtu-centre"
        self.collector: subprocess.Popen[str] | None = None
        self.centre: subprocess.Popen[str] | None = None
        for name, role in USERS.items():
            self.run("user", name, "--role", role, stdin=PASSWORD)

    def run(self, *words: str, stdin: str = "") -> str:
        done = subprocess.run(
            [sys.executable, "-m", "centre", self.file, *words],
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
        command = [sys.executable, "-m", "centre", str(self.file), "serve", *page]
        self.centre = subprocess.Popen(command, stderr=log, text=True, env=self.environment)
        until(self.answers, f"the centre answers: {self.log()}")

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
        made = Client(self.port)
        return made.login(name) if name else made

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
