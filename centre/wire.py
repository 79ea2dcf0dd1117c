# SPDX-License-Identifier: GPL-3.0-or-later
"""What comes over HTTP as text: whatever no database, hash or file takes is refused here, once."""

from __future__ import annotations

import asyncio
import json
from typing import Any

import jsonschema
from aiohttp import web
from aiohttp.http_exceptions import HttpProcessingError

from openrtu_tools.centre.errors import RefusedError
from openrtu_tools.centre.store import INTEGER_MOST

Json = dict[str, Any]
BODY_S = 15.0


def check(schema: Json, value: Any) -> None:
    """Raises RefusedError with the first mistake."""
    error = next(iter(jsonschema.Draft202012Validator(schema).iter_errors(value)), None)
    if error:
        place = ".".join(map(str, error.absolute_path))
        raise RefusedError(400, "form", f"{place + ': ' if place else ''}{error.message[:500]}")


def check_text(text: str) -> None:
    """What a page sends has neither; SQLite, PostgreSQL, UTF-8 or a path stumbles over one of them."""
    if any(letter == "\0" or "\ud800" <= letter <= "\udfff" for letter in text):
        raise RefusedError(400, "form", "a text has a NUL or half a character")


def _integer(text: str) -> int:
    """Of 20 digits at most: Python itself refuses to read 4 301."""
    if len(text) > 20 or abs(int(text)) > INTEGER_MOST:
        raise ValueError(f"{text[:20]}… is too large")
    return int(text)


def _float(text: str) -> float:
    number = float(text)
    if abs(number) == float("inf"):
        raise ValueError(f"{text[:20]} is too large")
    return number


def _constant(text: str) -> None:
    raise ValueError(f"{text} is no number")


def read_json(text: str) -> Any:
    """Raises RefusedError."""
    try:
        value = json.loads(text, parse_int=_integer, parse_float=_float, parse_constant=_constant)
        _check_texts(value)
    except (ValueError, RecursionError) as error:
        raise RefusedError(400, "form", f"this is no JSON: {str(error)[:200]}") from error
    return value


def _check_texts(value: Any) -> None:
    if isinstance(value, str):
        check_text(value)
    elif isinstance(value, list):
        for each in value:
            _check_texts(each)
    elif isinstance(value, dict):
        for key, each in value.items():
            check_text(key)
            _check_texts(each)


def described(required: list[str], **properties: Json) -> Json:
    """The schema of a body."""
    return {"type": "object", "required": required, "properties": properties}


async def read_body(request: web.Request, schema: Json) -> Json:
    if request.content_type != "application/json":
        raise RefusedError(415, "form", "the body must be application/json")
    try:
        async with asyncio.timeout(BODY_S):
            text = await request.text()
    except TimeoutError as error:
        raise RefusedError(408, "slow", f"the body was not there within {BODY_S:g} s") from error
    except (ValueError, LookupError, web.RequestPayloadError, HttpProcessingError) as error:
        # What it says of its own letters, chunks or compression is wrong, or unknown.
        raise RefusedError(400, "form", f"the body is no text: {str(error)[:200]}") from error
    body = read_json(text or "{}")
    check({**schema, "additionalProperties": False}, body)
    return body
