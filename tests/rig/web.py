# SPDX-License-Identifier: GPL-3.0-or-later
"""A gateway with its page, and who asks it over HTTP without a browser."""

from __future__ import annotations

import contextlib
import http.client
import json
import ssl
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lab.gateway import free_port, run_directory
from peers.authority import give_to_station, openssl
from rig.desk import Substation, gateway_on_lines, patience

ROOT = Path(__file__).resolve().parents[2]
WEB_USER = 61218  # rtu-web's, if rtud is root's
PASSWORD = "correct horse battery"
DEVICE = "1.10"
HOSTILE = "<svg/onload=document.title='X'>"  # a point's name has no space, and no character of a pattern
INITIAL = {
    DEVICE: {"coils": {"0": 0, "1": 0}, "input_registers": {"0": 50, "1": 60}, "holding_registers": {"0": 40}}
}
WAIT_S = 60.0
# A connection that was idle and gave way, or the module is another.
GONE = (http.client.HTTPException, ConnectionError, ssl.SSLEOFError)


def make_user(file: Path, name: str, role: str, password: str = PASSWORD) -> None:
    subprocess.run(
        [ROOT / "scripts/openrtu", "web-users", file, name, "--role", role],
        input=f"{password}\n",
        text=True,
        check=True,
    )


def configuration(folder: Path, port: int, *, secure: bool = True, **keys: Any) -> dict[str, Any]:
    slave = {
        "id": 10,
        **patience(),
        "probe_max_s": 1,
        "coils": [
            {"address": 0, "name": "breaker", "type": "single", "select": True},
            {"address": 1, "name": "lamp", "type": "single"},
        ],
        "input_registers": [
            {"address": 0, "name": "level", "type": "scaled"},
            {"address": 1, "name": HOSTILE, "type": "scaled"},
        ],
        "holding_registers": [
            {
                "address": 0,
                "name": "setpoint",
                "type": "scaled",
                "unit": "kW",
                "step": 5,
                "min": 0,
                "max": 100,
            }
        ],
    }
    pace = {"baud_rate": 19200, "data_bits": 8, "stop_bits": 1, "parity": 0}
    web = {"port": port, "users": str(folder / "web.users"), "station": "Substation 7", **keys}
    if secure:
        web |= {"certificate": str(folder / "web.pem"), "key": str(folder / "web.key")}
    return {"port": [{"value": 1, "active": 1, **pace, "slaves": [slave]}], "web": web}


def make_certificate(folder: Path) -> None:
    """And its key."""
    openssl(
        *("req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-days", "2"),
        *("-keyout", folder / "web.key", "-out", folder / "web.pem", "-subj", "/CN=substation-7"),
        *("-addext", "subjectAltName=IP:127.0.0.1"),
    )
    give_to_station(folder / "web.key", WEB_USER)


def make_files(folder: Path) -> None:
    """As an engineer brings them."""
    make_certificate(folder)
    for role in ("viewer", "operator", "engineer"):
        make_user(folder / "web.users", role, role)


@dataclass
class Answer:
    status: int
    headers: http.client.HTTPMessage
    text: bytes

    def json(self) -> Any:
        return json.loads(self.text)


@dataclass
class Client:
    """Who asks as a browser does: one connection, a cookie, the token of its session."""

    port: int
    trusted: Path | None = None
    source: str = "127.0.0.1"
    cookie: str = ""
    csrf: str = ""
    connection: http.client.HTTPConnection = field(init=False)

    def __post_init__(self) -> None:
        more: dict[str, Any] = {"timeout": WAIT_S, "source_address": (self.source, 0)}
        if self.trusted is None:
            self.connection = http.client.HTTPConnection("127.0.0.1", self.port, **more)
        else:
            context = ssl.create_default_context(cafile=str(self.trusted))
            self.connection = http.client.HTTPSConnection("127.0.0.1", self.port, context=context, **more)

    def ask(self, path: str, body: Any = None, method: str = "", **headers: str) -> Answer:
        text = None if body is None else json.dumps(body)
        return self.ask_text(path, text, method, **headers)

    def ask_text(self, path: str, body: str | None, method: str = "", **headers: str) -> Answer:
        sent = {"Cookie": self.cookie} if self.cookie else {}
        if body is not None:
            sent |= {"Content-Type": "application/json", "X-CSRF-Token": self.csrf}
        sent |= {name.replace("_", "-"): text for name, text in headers.items()}
        method = method or ("GET" if body is None else "POST")
        try:
            self.connection.request(method, path, body, sent)
            answer = self.connection.getresponse()
        except GONE:
            self.connection.close()
            self.connection.request(method, path, body, sent)
            answer = self.connection.getresponse()
        return Answer(answer.status, answer.headers, answer.read())

    def rows(self, path: str) -> list[dict[str, Any]]:
        answer = self.ask(path)
        assert answer.status == 200, answer.text
        rows: list[dict[str, Any]] = answer.json()["rows"]
        return rows

    def log_in(self, name: str, password: str = PASSWORD) -> Answer:
        answer = self.ask("/api/login", {"name": name, "password": password})
        if answer.status == 200:
            self.cookie = answer.headers["Set-Cookie"].split(";")[0]
            self.csrf = answer.json()["csrf"]
        return answer


@dataclass
class Page(Substation):
    port: int
    folder: Path
    addresses: Iterator[str] = field(default_factory=lambda: (f"127.0.1.{last}" for last in range(1, 255)))
    homes: dict[str, str] = field(default_factory=dict)

    def client(self, name: str = "") -> Client:
        """A name logs in from one address, where the page knows it: only so many strangers may at once.

        Who has no name yet has another address each time: guesses are counted by address.
        """
        address = self.homes.get(name) or next(self.addresses)
        made = Client(self.port, self.folder / "web.pem", address)
        if name:
            self.homes[name] = address
            answer = made.log_in(name)
            assert answer.status == 200, answer.text
        return made


@contextlib.contextmanager
def page_of(programs: Path, **keys: Any) -> Iterator[Page]:
    """The gateway on simulated devices, everything read, its page on TLS."""
    folder = run_directory()  # where rtu-web's user gets
    folder.chmod(0o755)
    make_files(folder)
    port = free_port()
    with gateway_on_lines(configuration(folder, port, **keys), programs, INITIAL) as (lines, gateway):
        gateway.wait_for(
            lambda: gateway.points()["level"]["quality"] == "good", WAIT_S, "the device has been read"
        )
        yield Page(lines, gateway, port, folder)
