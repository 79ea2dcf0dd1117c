# SPDX-License-Identifier: GPL-3.0-or-later
"""Asks a control centre over HTTP."""

from __future__ import annotations

import http.client
import json
import ssl
from collections.abc import Mapping
from typing import Any, Self

LIMIT_S = 60.0  # for a hang only


class AnswerError(AssertionError):
    """The centre refused."""

    def __init__(self, status: int, answer: Any, headers: Mapping[str, str]) -> None:
        super().__init__(f"{status}: {answer}")
        self.status = status
        self.answer = answer
        self.headers = headers
        self.code = answer.get("code") if isinstance(answer, dict) else None


class Client:
    """Asks over HTTP, as a browser or, with a token, as a program."""

    def __init__(
        self, port: int, token: str = "", tls: ssl.SSLContext | None = None, source: str = "127.0.0.1"
    ) -> None:
        self.port = port
        self.tls = tls
        self.source = source
        self.headers: dict[str, str] = {"Authorization": f"Bearer {token}"} if token else {}

    def login(self, name: str, password: str) -> Self:
        self.headers = {}
        response, _ = self.raw("POST", "/api/login", {"name": name, "password": password})
        self.headers["Cookie"] = (response.getheader("Set-Cookie") or "").partition(";")[0]
        self.headers["X-CSRF-Token"] = self.get("/api/me")["csrf"]
        return self

    def raw(
        self, method: str, path: str, body: Any = None, **headers: str
    ) -> tuple[http.client.HTTPResponse, bytes]:
        if self.tls:
            connection: http.client.HTTPConnection = http.client.HTTPSConnection(
                "127.0.0.1", self.port, timeout=LIMIT_S, source_address=(self.source, 0), context=self.tls
            )
        else:
            connection = http.client.HTTPConnection(
                "127.0.0.1", self.port, timeout=LIMIT_S, source_address=(self.source, 0)
            )
        media = {"Content-Type": "application/json"} if method != "GET" else {}
        content = json.dumps(body or {}) if method != "GET" else None
        connection.request(method, path, content, {**media, **self.headers, **headers})
        response = connection.getresponse()
        octets = response.read()
        connection.close()
        if response.status >= 400:
            raise AnswerError(response.status, json.loads(octets), response.headers)
        return response, octets

    def get(self, path: str) -> Any:
        return json.loads(self.raw("GET", path)[1])

    def post(self, path: str, body: Any = None) -> Any:
        return json.loads(self.raw("POST", path, body)[1])
