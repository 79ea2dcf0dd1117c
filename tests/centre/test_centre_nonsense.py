# SPDX-License-Identifier: GPL-3.0-or-later
"""Schemathesis asks whatever the OpenAPI document of the centre allows and forbids, logged in and not."""

import asyncio
from collections.abc import Callable, Iterator
from typing import Any

import aiohttp
import hypothesis
import pytest
import schemathesis
from hypothesis import strategies as st

from control_room import PASSWORD, Site
from lab.centre_client import Client
from openrtu_tools.centre.api import document
from postgres import Server

pytestmark = pytest.mark.slow

OPERATIONS = list(schemathesis.openapi.from_dict(document()).get_all_operations())
EXAMPLES = 25
# What generators seldom come to, and what made 500 of it before.
TEXTS = ["\0", "a" * 300, "٣", "%00", "' OR 1=1 --", "-99999999999999", "99999999999999", "-9999999999999"]
TEXTS += [str(2**63 - 1), str(2**63), "9" * 400, "1e400", "NaN", "-1", "", "2147483648"]
VALUES = [*TEXTS, "\ud800", 2**63, 10**400, -1, 1e308, 0.1, [], {}, None, True, ["\0"], {"\ud800": 1}]


@pytest.fixture(scope="module")
def site(of_north: Callable[..., Site], server: Server | None) -> Iterator[Site]:
    with of_north(server=server) as started:
        yield started


@pytest.fixture(scope="module")
def engineer(site: Site) -> Client:
    return site.client("emil")


def confirm(case: schemathesis.Case) -> None:
    """So that what comes behind the password is reached; the password stays what it is."""
    body = case.body
    if isinstance(body, dict) and isinstance(body.get("own_password"), str):
        body["own_password"] = PASSWORD
        if case.path.endswith("/password"):
            body["password"] = PASSWORD


def spoil(case: schemathesis.Case, asks: list[str], draw: Callable[[st.SearchStrategy[Any]], Any]) -> None:
    """One of its parts, or what may be asked besides, or nothing."""
    query = dict.fromkeys(asks, "") | dict(case.query or {})
    parts: list[tuple[Any, list[Any]]] = [(query, TEXTS), (case.path_parameters, TEXTS), (case.body, VALUES)]
    places = [(part, key, values) for part, values in parts if isinstance(part, dict) for key in part]
    if places and draw(st.integers(0, 3)):
        part, key, values = draw(st.sampled_from(places))
        part[key] = draw(st.sampled_from(values))
        if part is query:
            case.query = {key: part[key]}  # all else is right, or it is refused for that


@pytest.mark.parametrize("mode", schemathesis.GenerationMode)
@pytest.mark.parametrize("operation", OPERATIONS, ids=lambda found: found.ok().label)
def test_no_nonsense_is_a_fault_of_the_centre(
    site: Site, engineer: Client, operation: Any, mode: schemathesis.GenerationMode
) -> None:
    before = len(site.log())
    asks = [each.name for each in operation.ok().query]
    root = f"http://127.0.0.1:{site.port}"

    @hypothesis.settings(
        max_examples=EXAMPLES, deadline=None, derandomize=True, database=None,
        suppress_health_check=list(hypothesis.HealthCheck),
    )  # fmt: skip
    @hypothesis.given(operation.ok().as_strategy(generation_mode=mode), st.data())
    def ask(case: schemathesis.Case, more: st.DataObject) -> None:
        spoil(case, asks, more.draw)
        confirm(case)
        for logged_in in False, True:
            # The document names tokens: one that is none is generated, which counts before a cookie.
            own = {**engineer.headers, "Authorization": ""} if logged_in else {}
            answer = case.call(base_url=root, headers={**(case.headers or {}), **own})
            assert answer.status_code < 500, (answer.text, case.as_curl_command())
            assert not (logged_in and '"session"' in answer.text)
            assert logged_in or answer.status_code >= 400

    ask()
    assert "Traceback" not in site.log()[before:]


def test_no_nonsense_on_the_stream_is_one(site: Site, engineer: Client) -> None:
    """It ends the stream, or nothing."""
    before = len(site.log())
    said = [
        '{"view": "map", "bounds": [NaN, 1, 2, 1e999]}',
        '{"view": "\\ud800"}',
        "[" * 50_000,
        "nothing",
        "{}",
    ]
    said += [
        '{"view": "points", "station": 1e400}',
        f'{{"view": "points", "station": {"9" * 5000}}}',
        '{"view": []}',
    ]
    said += [
        '{"view": "map", "search": "\\u0000"}',
        '{"view": "map", "bounds": {"a": 1}}',
        "null",
        '"\\ud800"',
    ]

    async def say(text: str) -> None:
        async with (
            aiohttp.ClientSession(headers=engineer.headers) as session,
            session.ws_connect(f"http://127.0.0.1:{site.port}/api/stream") as socket,
        ):
            await socket.send_str(text)
            await socket.receive()

    for text in said:
        asyncio.run(say(text))
    assert "Traceback" not in site.log()[before:]
    assert engineer.get("/api/me")
