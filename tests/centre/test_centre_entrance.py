# SPDX-License-Identifier: GPL-3.0-or-later
"""The control centre's port: half requests, crowds, slow bodies, and what is nonsense."""

import contextlib
import http.client
import json
import resource
import socket
import ssl
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from control_room import PASSWORD, Site, Stations, described, until
from lab.centre_client import LIMIT_S, AnswerError, Client
from lab.vehicles import Station
from openrtu_tools.centre.api import ROUTES
from openrtu_tools.centre.entrance import HEAD_S, OF_HOST
from openrtu_tools.centre.wire import BODY_S

pytestmark = pytest.mark.slow

FILES = 200
HALF = b"GET / HTTP/1.1\r\nHost: x\r\nX-a: "


@pytest.fixture(scope="module")
def site(of_north: Callable[..., Site]) -> Iterator[Site]:
    """A service that may open few files."""
    made = of_north()
    made.before = ["prlimit", f"--nofile={FILES // 2}:{FILES}"]
    with made:
        yield made


def connect(site: Site, source: str) -> socket.socket:
    return socket.create_connection(("127.0.0.1", site.port), LIMIT_S, source_address=(source, 0))


def is_served(site: Site, source: str = "127.0.0.1") -> bool:
    with pytest.raises(AnswerError) as refused:
        Client(site.port, source=source).get("/api/me")
    return refused.value.status == 401


@pytest.mark.parametrize("hosts", [1, 100])
def test_half_requests_shut_out_nobody(site: Site, hosts: int) -> None:
    """More than the service has files: of one address, or of many."""
    with contextlib.ExitStack() as held:
        for number in range(3 * FILES):
            connection = held.enter_context(connect(site, f"127.0.4.{number % hosts + 1}"))
            with contextlib.suppress(ConnectionError):
                connection.sendall(HALF)
        assert is_served(site)
        assert is_served(site, "127.0.4.1")
    assert "Traceback" not in site.log()


def test_half_requests_end_no_session(site: Site) -> None:
    """A page that watches stays connected."""
    client = Client(site.port, source="127.0.4.250").login("vera", PASSWORD)
    with connect(site, "127.0.4.250") as watching, contextlib.ExitStack() as held:
        key = "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n"
        watching.sendall(
            b"GET /api/stream HTTP/1.1\r\nHost: 127.0.0.1\r\n"
            + f"Upgrade: websocket\r\nConnection: Upgrade\r\n{key}"
            f"Cookie: {client.headers['Cookie']}\r\n\r\n".encode()
        )
        assert b"101 Switching" in watching.recv(4096)
        for _ in range(2 * FILES):
            connection = held.enter_context(connect(site, "127.0.4.250"))
            with contextlib.suppress(ConnectionError):
                connection.sendall(HALF)
        assert is_served(site, "127.0.4.250")
        watching.sendall(bytes([0x89, 0x80, 0, 0, 0, 0]))  # a ping
        until(lambda: b"\x8a\x00" in watching.recv(4096), "its pong")


def test_service_takes_the_files_that_it_may(site: Site) -> None:
    assert site.centre
    soft, hard = resource.prlimit(site.centre.pid, resource.RLIMIT_NOFILE)
    assert (soft, hard) == (FILES, FILES)


def test_what_cannot_be_accepted_is_a_line_a_second(site: Site) -> None:
    """Other files of the process, as those of exports, have taken them all."""
    assert site.centre
    before = len(site.log().splitlines())
    now = len(list(Path(f"/proc/{site.centre.pid}/fd").iterdir()))
    begun = time.monotonic()
    resource.prlimit(site.centre.pid, resource.RLIMIT_NOFILE, (now, FILES))
    try:
        with contextlib.ExitStack() as held:
            for _ in range(100):
                held.enter_context(connect(site, "127.0.0.1"))
            until(
                lambda: site.log().count("no connection can be accepted") >= 3, "it says so each second", 0.1
            )
    finally:
        resource.prlimit(site.centre.pid, resource.RLIMIT_NOFILE, (FILES, FILES))
    lines = site.log().splitlines()[before:]
    assert len(lines) <= time.monotonic() - begun + 2, lines
    until(lambda: is_served(site), "it accepts again")


def test_a_head_and_a_body_have_their_time(site: Site) -> None:
    vera = Client(site.port).login("vera", PASSWORD)
    body = "Content-Type: application/json\r\nContent-Length: 20\r\n"
    cookie = f"Cookie: {vera.headers['Cookie']}\r\nX-CSRF-Token: {vera.headers['X-CSRF-Token']}\r\n"
    asks = {
        HALF: HEAD_S,
        f"POST /api/login HTTP/1.1\r\nHost: x\r\n{body}\r\n".encode(): BODY_S,
        f"POST /api/password HTTP/1.1\r\nHost: x\r\n{cookie}{body}\r\n".encode(): BODY_S,
    }
    for ask, least in asks.items():
        begun = time.monotonic()
        with connect(site, "127.0.4.200") as slow:
            slow.sendall(ask)
            slow.settimeout(1)
            answer = b""
            ended = False
            while not ended and time.monotonic() < begun + LIMIT_S:
                try:
                    slow.sendall(b" ")
                    piece = slow.recv(4096)
                    answer, ended = answer + piece, not piece
                except TimeoutError:
                    continue
                except ConnectionError:
                    ended = True
        assert ended
        assert time.monotonic() - begun > least - 2
        assert ask is HALF or b" 408 " in answer


def test_half_handshakes_shut_out_nobody(
    programs: Path, stations: Stations, north: Station, tmp_path: Path
) -> None:
    subprocess.run(
        ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes",
         "-days", "2", "-keyout", "key.pem", "-out", "certificate.pem", "-subj", "/CN=centre",
         "-addext", "subjectAltName=IP:127.0.0.1"],
        cwd=tmp_path, check=True, capture_output=True,
    )  # fmt: skip
    tls = {"certificate": "certificate.pem", "key": "key.pem"}
    made = Site(programs, tmp_path, [described(north, tmp_path)], users=("vera",), centre={"tls": tls})
    made.before = ["prlimit", f"--nofile={FILES}:{FILES}"]
    made.tls = ssl.create_default_context(cafile=str(tmp_path / "certificate.pem"))
    with made, contextlib.ExitStack() as held:
        for _ in range(2 * FILES):
            connection = held.enter_context(connect(made, "127.0.4.1"))
            with contextlib.suppress(ConnectionError):
                connection.sendall(b"\x16\x03\x01")
        assert made.client("vera").get("/api/stations")
        assert "Traceback" not in made.log()


def test_units_allow_enough_files() -> None:
    """Of systemd: its soft limit is 1 024."""
    folder = Path(__file__).resolve().parents[2] / "centre" / "systemd"
    for unit in folder.glob("*.service"):
        assert "LimitNOFILE=16384" in unit.read_text(), unit
    assert OF_HOST < FILES * 2


# ---- nonsense ------------------------------------------------------------------------------------

LONG = "9" * 400
HALF_LETTER = '"\\ud800"'
PATHS = [
    "/%00", "/%0a", "/js/%00.js", f"/{'a' * 300}", f"/{'a' * 5000}", f"/{'a/' * 2000}", "/%ff%fe",
    "/%ed%a0%80",
    "/api/points/%00/history", f"/api/points/{LONG}/history", "/api/points/1%00/history",
    "/api/points?search=%00", "/api/points?search=%ed%a0%80", "/api/points?search=%ff", "/api/audit?user=%00",
    "/api/events?from=-99999999999999", "/api/events?to=99999999999999&from=-99999999999999",
    "/api/events?format=csv&from=-99999999999999&to=-9999999999999",
    "/api/events?format=csv&from=-8999999999999&to=-8999999990000",
    "/api/tracks?from=-99999999999999", "/api/tracks?format=gpx&from=-8999999999999&to=-8999999990000",
    "/api/tracks?step=-1", "/api/audit?from=-99999999999999", "/api/sessions?user=%00",
]  # fmt: skip
BODIES = [
    ("/api/commands", '{"point": 1, "value": NaN}'),
    ("/api/commands", '{"point": 1, "value": 1e999}'),
    ("/api/commands", '{"point": 1, "value": -Infinity}'),
    ("/api/commands", f'{{"point": 1, "value": {LONG}}}'),
    ("/api/commands", f'{{"point": 1, "value": {"9" * 5000}}}'),
    ("/api/commands", f'{{"point": {LONG}, "value": 1}}'),
    ("/api/commands", '{"point": 1e400, "value": 1}'),
    ("/api/commands", "[" * 100_000),
    ("/api/commands", '{"a":' * 20_000),
    ("/api/commands", b"\xff\xfe"),
    ("/api/alarms/1/shelve", '{"minutes": NaN}'),
    ("/api/alarms/%00/acknowledge", "{}"),
    (f"/api/alarms/{LONG}/acknowledge", "{}"),
    ("/api/users/%00/remove", f'{{"own_password": "{PASSWORD}"}}'),
    ("/api/users", f'{{"name": {HALF_LETTER}, "role": "viewer", "own_password": "{PASSWORD}"}}'),
    ("/api/users", f'{{"name": "a\\u0000b", "role": "viewer", "own_password": "{PASSWORD}"}}'),
    (
        "/api/users",
        f'{{"name": "b\\n", "role": "viewer", "password": "{PASSWORD}", "own_password": "{PASSWORD}"}}',
    ),
    ("/api/users", f'{{"name": "u", "role": "viewer", "groups": ["\\u0000"], "own_password": "{PASSWORD}"}}'),
    ("/api/tokens", f'{{"label": {HALF_LETTER}, "days": 1, "scope": "read", "own_password": "{PASSWORD}"}}'),
    ("/api/tokens", f'{{"label": "a", "days": NaN, "scope": "read", "own_password": "{PASSWORD}"}}'),
    ("/api/login", f'{{"name": {HALF_LETTER}, "password": "x"}}'),
    ("/api/login", f'{{"name": "olga", "password": {HALF_LETTER}}}'),
    ("/api/login", '{"name": "olga", "password": "\\u0000"}'),
    ("/api/login", '{"\\ud800": 1}'),
    ("/api/password", f'{{"password": {HALF_LETTER}, "own_password": "{PASSWORD}"}}'),
]


@pytest.fixture(scope="module")
def engineer(site: Site) -> Client:
    return site.client("emil")


def status(client: Client, method: str, path: str, body: Any = None, **headers: str) -> int:
    connection = http.client.HTTPConnection("127.0.0.1", client.port, timeout=LIMIT_S)
    with contextlib.closing(connection):
        media = {"Content-Type": "application/json"} if body is not None else {}
        connection.request(method, path, body, {**media, **client.headers, **headers})
        return connection.getresponse().status


def test_nonsense_is_refused(site: Site, engineer: Client) -> None:
    """Logged in and not; nothing of it is a fault of the centre."""
    before = site.log()
    for client in engineer, site.client():
        for path in PATHS:
            assert status(client, "GET", path) < 500, path
        for path, body in BODIES:
            answered = status(client, "POST", path, body)
            assert 400 <= answered < 500, (path, body[:60], answered)
    for headers in (
        {"Content-Type": "application/json; charset=klingon"},
        {"Cookie": "openrtu_session=\xff"},
    ):
        assert 400 <= status(engineer, "POST", "/api/commands", b'{"a": "\xe9"}', **headers) < 500
    assert "Traceback" not in site.log()[len(before) :]


LOGIN = b"POST /api/login HTTP/1.1\r\nHost: x\r\nContent-Type: application/json\r\n"
NO_HTTP = [
    b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03\r\n\r\n",
    b"GET / HTTP/1.1\r\nbroken\r\n\r\n",
    b"GET /api/me?\xff\x00 HTTP/1.1\r\nHost: x\r\n\r\n",
    b"GET / HTTP/1.1\r\nHost: x\r\nA: " + b"a" * 20_000 + b"\r\n\r\n",
    b"GET / HTTP/1.1\r\nHost: x\r\nContent-Length: -1\r\n\r\n",
    LOGIN + b"Transfer-Encoding: chunked\r\nContent-Length: 2\r\n\r\n2\r\n{}\r\n0\r\n\r\n",
    LOGIN + b"Transfer-Encoding: chunked\r\n\r\nzz\r\n",
    LOGIN + b"Transfer-Encoding: chunked\r\n\r\n2\r\n{}\r\nzz",
    LOGIN + b"Content-Encoding: gzip\r\nContent-Length: 4\r\n\r\nabcd",
    LOGIN + b"Content-Encoding: deflate\r\nContent-Length: 4\r\n\r\nabcd",
    LOGIN + b"Content-Encoding: br\r\nContent-Length: 4\r\n\r\nabcd",
]


@pytest.mark.parametrize("octets", NO_HTTP)
def test_what_is_no_http_is_refused_without_a_word(site: Site, octets: bytes) -> None:
    """A stranger says as much of it as he likes: the log has other things to tell."""
    before = site.log()
    for _ in range(3):
        with connect(site, "127.0.0.1") as stranger:
            stranger.sendall(octets)
            answer = stranger.recv(4096)
        assert answer.split(b" ", 2)[1] in (b"400", b"415"), answer
    assert is_served(site)
    assert site.log() == before


def test_every_route_that_takes_a_body_describes_it() -> None:
    """What the generator of nonsense reads."""
    for route in ROUTES:
        assert not route.confirms or "own_password" in json.dumps(route.body), route.path
