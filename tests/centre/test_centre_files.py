# SPDX-License-Identifier: GPL-3.0-or-later
"""Files over HTTP: one that was cut off is taken on where it was; nothing is left of a killed centre."""

import asyncio
import contextlib
import doctest
import http.client
import os
import subprocess
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
from aiohttp import web
from aiohttp.test_utils import TestClient, TestServer

from control_room import Site, Stations, described, until
from lab.centre_client import AnswerError, Client
from lab.vehicles import Station
from openrtu_tools.centre import api
from openrtu_tools.centre.database import open_store
from openrtu_tools.centre.settings import load
from openrtu_tools.centre.store import Database, EventRow
from openrtu_tools.centre.web import opened

pytestmark = pytest.mark.slow

S = 10**9
ROWS = 10_000  # a file of many pieces
FILE = f"/api/events?format=csv&from=0&to={ROWS * 1000}"
GROWING = f"/api/events?format=csv&from={(ROWS - 1000) * 1000}&to={ROWS * 2000}"  # up to what is there later
OF_CURL = FILE.replace("from=0", "from=-1")
MAP, MAGIC = "/map/own.pmtiles", b"PMTiles\x03"


def seed(database: Database) -> None:
    database.execute("INSERT INTO stations (name) VALUES ('north')")
    database.insert("points", ["id", "station", "ca", "ioa"], [(1, 1, 1, 4)])
    rows = [EventRow(1, n * S, n, 0, n * S, 3, 1) for n in range(ROWS)]
    database.insert("history", EventRow._fields, rows)


@pytest.fixture(scope="module")
def site(
    programs: Path, stations: Stations, north: Station, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Site]:
    folder = tmp_path_factory.mktemp("files")
    (folder / "map.pmtiles").write_bytes(MAGIC)
    made = Site(programs, folder, [described(north, folder, group="water")])
    with contextlib.closing(open_store(load(made.file).database, alone=True)) as store:
        store.transaction(seed)
    with made:
        yield made


def asked(client: Client, path: str = FILE, **headers: str) -> tuple[http.client.HTTPResponse, bytes]:
    names = {name.replace("_", "-"): value for name, value in headers.items()}
    return client.raw("GET", path, **names)


def files(client: Client) -> list[dict[str, Any]]:
    return list(client.get("/api/files"))


def cut_off(site: Site, client: Client, octets: int, path: str = FILE) -> tuple[str, bytes]:
    """A reader that takes so many octets and leaves."""
    connection = http.client.HTTPConnection("127.0.0.1", site.port, timeout=60)
    connection.request("GET", path, headers=client.headers)
    response = connection.getresponse()
    begun = response.read(octets)
    tag = response.getheader("ETag") or ""
    connection.close()
    return tag, begun


def test_rest_of_a_file_that_was_cut_off(site: Site) -> None:
    client = site.client("vera")
    tag, begun = cut_off(site, client, 10_000)
    response, rest = asked(client, Range="bytes=10000-", If_Range=tag)
    assert response.status == 206 and response.getheader("ETag") == tag
    whole = begun + rest
    assert response.getheader("Content-Range") == f"bytes 10000-{len(whole) - 1}/{len(whole)}"
    assert whole.count(b"\r\n") == ROWS + 1 and whole.endswith(f",{ROWS - 1}.0,0,3\r\n".encode())
    response, part = asked(client, Range="bytes=5-9")
    assert (response.status, part) == (206, whole[5:10])
    [last] = [each for each in files(client) if f'"{each["id"]}"' == tag]
    assert (last["state"], last["octets"], last["part"]) == ("whole", len(whole), 1)


def test_another_file_is_whole(site: Site) -> None:
    """Of a tag that is not its own, of what somebody else had, and of a range that is none."""
    client = site.client("vera")
    tag, _ = cut_off(site, client, 100)
    response, whole = asked(client, Range="bytes=100-", If_Range='"another"')
    assert response.status == 200 and response.getheader("ETag") != tag
    assert whole.count(b"\r\n") == ROWS + 1
    for who, wanted in (("olga", "bytes=100-"), ("vera", "bytes=1-2,5-6")):
        response, octets = asked(site.client(who), Range=wanted)
        assert (response.status, octets) == (200, whole), (who, wanted)
    tag = response.getheader("ETag") or ""
    with pytest.raises(AnswerError) as refused:
        asked(client, Range=f"bytes={len(whole)}-", If_Range=tag)
    assert refused.value.status == 416


def test_range_is_understood_or_none() -> None:
    assert doctest.testmod(api).failed == 0


def test_rest_is_of_the_file_that_was_begun(site: Site) -> None:
    """There are two of one question, and an event more in the second."""
    client, path = site.client("vera"), GROWING
    first, begun = cut_off(site, client, 10_000, path)
    _, rest = asked(client, path, Range="bytes=10000-", If_Range=first)
    late = EventRow(1, 2 * ROWS * S, 0.25, 0, 2 * ROWS * S, 3, 1)
    with contextlib.closing(open_store(load(site.file).database, alone=False)) as store:
        store.transaction(lambda database: database.insert_events([late]))
    second, _ = cut_off(site, client, 100, path)
    assert second != first
    response, again = asked(client, path, Range="bytes=10000-", If_Range=first)
    assert (response.status, response.getheader("ETag"), again) == (206, first, rest)
    response, more = asked(client, path, Range="bytes=10000-", If_Range=second)
    assert (response.status, response.getheader("ETag")) == (206, second)
    assert len(more) > len(rest)
    response, whole = asked(client, path, Range="bytes=10000-")  # of which one, nobody knows
    assert (response.status, whole) == (200, begun + more)


def replace(path: Path, octets: bytes, at_ns: int) -> None:
    new = path.with_suffix(".new")
    new.write_bytes(octets)
    os.utime(new, ns=(at_ns, at_ns))
    new.replace(path)


def test_rest_of_a_map_is_of_no_other_one(site: Site) -> None:
    client, path = site.client("vera"), site.folder / "map.pmtiles"
    before, after = (MAGIC + word * 100 for word in (b"old ", b"new "))
    replace(path, before, 1000 * S)
    response, _ = asked(client, MAP)
    tag, date = response.getheader("ETag") or "", response.getheader("Last-Modified") or ""
    assert response.getheader("Cache-Control") == "no-store"  # or a browser says If-Range for the page
    response, rest = asked(client, MAP, Range="bytes=10-19", If_Range=tag)
    assert (response.status, response.getheader("ETag"), rest) == (206, tag, before[10:20])
    for at_ns in (2000 * S, 500 * S):  # an older one may come back
        replace(path, after, at_ns)
        for known in (tag, f"W/{tag}", date, "nonsense", ""):
            response, whole = asked(client, MAP, Range="bytes=10-19", If_Range=known)
            assert (response.status, whole) == (200, after), (at_ns, known)
            assert response.getheader("Content-Range") is None
        response, rest = asked(client, MAP, Range="bytes=10-19")
        assert (response.status, rest) == (206, after[10:20])


@pytest.mark.parametrize("headers", [{}, {"Range": "bytes=3-8"}], ids=["whole", "range"])
def test_file_that_is_exchanged_while_it_is_served_is_one_file(
    tmp_path: Path, headers: dict[str, str]
) -> None:
    """Its tag says which."""
    path, before, after = tmp_path / "map.json", b"the old one", b"another one, which is longer"

    async def serve(_: web.Request) -> web.StreamResponse:
        served = await opened(path)
        replace(path, after, 2000 * S)
        return served

    async def ask() -> tuple[Mapping[str, str], bytes]:
        application = web.Application()
        application.router.add_get("/", serve)
        async with TestClient(TestServer(application)) as client:
            response = await client.get("/", headers=headers)
            return response.headers, await response.read()

    replace(path, before, 1000 * S)
    tag = f'"{1000 * S:x}-{len(before):x}"'
    told, octets = asyncio.run(ask())
    assert (told["ETag"], told["Content-Type"]) == (tag, "application/json")
    assert octets == (before[3:9] if headers else before)
    replace(path, before, 1000 * S)
    headers |= {"If-Range": tag}
    assert asyncio.run(ask())[1] == octets


def test_curl_goes_on_where_it_was(site: Site, tmp_path: Path) -> None:
    client = site.client("vera")
    target = tmp_path / "events.csv"
    cookie = client.headers["Cookie"]
    address = f"http://127.0.0.1:{site.port}{OF_CURL}"
    curl = ["curl", "-sS", "--fail", "-b", cookie, "-o", target, address]
    subprocess.run(curl, check=True, timeout=120)
    whole = target.read_bytes()
    assert whole.count(b"\r\n") == ROWS + 1
    for there in (1, 60_000, len(whole) - 1):
        target.write_bytes(whole[:there])
        subprocess.run([*curl, "-C", "-"], check=True, timeout=120)
        assert target.read_bytes() == whole


def test_user_sees_and_ends_only_the_own(site: Site) -> None:
    client, other = site.client("vera"), site.client("olga")
    asked(client)
    newest = files(client)[-1]["id"]
    assert newest not in [each["id"] for each in files(other)]
    with pytest.raises(AnswerError, match="404"):
        other.post(f"/api/files/{newest}/end")
    client.post(f"/api/files/{newest}/end")
    assert newest not in [each["id"] for each in files(client)]
    response, _ = asked(client, Range="bytes=5-9")
    assert response.status in (200, 206)  # of an earlier one, or anew


def runs(pid: str) -> bool:
    """A container without an init process keeps those that have ended, without a command."""
    with contextlib.suppress(FileNotFoundError):
        return Path(f"/proc/{pid}/cmdline").read_bytes() != b""
    return False


def test_nothing_is_left_of_a_centre_that_was_killed(site: Site) -> None:
    asked(site.client("vera"))
    assert site.centre
    held = [
        Path(f"/proc/{site.centre.pid}/fd/{each.name}")
        for each in Path(f"/proc/{site.centre.pid}/fd").iterdir()
    ]
    children = Path(f"/proc/{site.centre.pid}/task/{site.centre.pid}/children").read_text().split()
    assert any("deleted" in str(each.readlink()) for each in held if each.is_symlink())
    assert children  # one waits for the next file
    site.kill(site.centre)
    assert {each.name for each in site.folder.iterdir() if each.name.startswith("tmp")} == set()
    until(lambda: not any(map(runs, children)), "no process is left")
    site.start_centre()
    assert files(site.client("vera")) == []
