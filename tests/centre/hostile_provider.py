# SPDX-License-Identifier: GPL-3.0-or-later
"""A provider of OpenID Connect that says and signs what a test wants."""

from __future__ import annotations

import base64
import hashlib
import hmac
import http.server
import json
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Self
from urllib.parse import parse_qs

from joserfc import jws, jwt
from joserfc.jwk import RSAKey

from lab.gateway import free_port

CLIENT, SECRET = "openrtu centre", "a secret: 100 %"
Json = dict[str, Any]


def b64(octets: bytes) -> str:
    return base64.urlsafe_b64encode(octets).decode().rstrip("=")


class Hostile:
    """By default it is none: each part can be made so."""

    def __init__(self) -> None:
        self.port = free_port()
        self.issuer = f"http://127.0.0.1:{self.port}/realm"
        self.key = RSAKey.generate_key(2048, {"kid": "one"})
        self.shown: list[Json] = [self.key.as_dict(private=False)]
        self.description: Json = {}  # more of it, or other
        self.token: Callable[[Json], str] = self.sign  # of the claims that it gives
        self.claims: Json = {}  # the same
        self.userinfo: Json = {}
        self.nonce = ""  # of the login that is under way
        self.asked: list[tuple[str, Json, str]] = []  # path, form, authorization
        self.late = threading.Event()  # until it is set, it answers nothing that is in `hangs`
        self.hangs: set[str] = set()
        self.redirects: dict[str, str] = {}
        self.answers: dict[str, bytes] = {}  # instead of what it would
        provider = self

        class Handler(http.server.BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                provider.answer(self)

            def do_POST(self) -> None:
                provider.answer(self)

            def log_message(self, *_: object) -> None:
                pass

        self.server = http.server.ThreadingHTTPServer(("127.0.0.1", self.port), Handler)
        self.thread = threading.Thread(target=self.server.serve_forever, daemon=True)

    def __enter__(self) -> Self:
        self.thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.late.set()
        self.server.shutdown()
        self.server.server_close()

    def answer(self, request: http.server.BaseHTTPRequestHandler) -> None:
        body = request.rfile.read(int(request.headers.get("Content-Length", 0)))
        form = {key: value[0] for key, value in parse_qs(body.decode()).items()}
        self.asked.append((request.path, form, request.headers.get("Authorization", "")))
        if request.path in self.hangs:
            self.late.wait()
        content = self.answers.get(request.path) or json.dumps(self.said(request.path)).encode()
        where = self.redirects.get(request.path)
        request.send_response(302 if where else 200)
        if where:
            request.send_header("Location", where)
        request.send_header("Content-Type", "application/json")
        request.send_header("Content-Length", str(len(content)))
        request.end_headers()
        with suppress(ConnectionError):  # whoever has waited long enough
            request.wfile.write(content)

    def said(self, path: str) -> Json:
        if path == "/realm/.well-known/openid-configuration":
            return {
                "issuer": self.issuer,
                "authorization_endpoint": f"{self.issuer}/auth?tenant=1",
                "token_endpoint": f"{self.issuer}/token",
                "jwks_uri": f"{self.issuer}/keys",
                # It invites to be believed; the centre has a list of its own.
                "id_token_signing_alg_values_supported": ["none", "HS256", "RS256"],
                **self.description,
            }
        if path == "/realm/keys":
            return {"keys": self.shown}
        if path == "/realm/userinfo":
            return self.userinfo
        return {"access_token": "access", "token_type": "Bearer", "id_token": self.token(self.all_claims())}

    def all_claims(self) -> Json:
        now_s = int(time.time())
        claims = {
            "iss": self.issuer,
            "aud": CLIENT,
            "sub": "1001",
            "preferred_username": "anna",
            "groups": ["staff", "ops"],
            "sid": "provider session",
            "nonce": self.nonce,
            "iat": now_s,
            "auth_time": now_s,
            "exp": now_s + 300,
            **self.claims,
        }
        return {key: value for key, value in claims.items() if value is not None}

    # ---- signatures, and what is none --------------------------------------------------------

    def sign(self, claims: Json, **header: str) -> str:
        head = {"alg": "RS256", "kid": self.key.kid, **header}
        return jws.serialize_compact(head, json.dumps(claims).encode(), self.key)

    def logout_token(self, **claims: Any) -> str:
        now_s = int(time.time())
        event = {"http://schemas.openid.net/event/backchannel-logout": {}}
        said = {
            "iss": self.issuer,
            "aud": CLIENT,
            "iat": now_s,
            "exp": now_s + 60,
            "jti": "1",
            "events": event,
        }
        said |= claims
        return self.sign({key: value for key, value in said.items() if value is not None}, typ="logout+jwt")

    def by_none(self, claims: Json) -> str:
        return f"{_head('none')}.{_body(claims)}."

    def by_hmac(self, claims: Json) -> str:
        """The public key as the secret: whoever looks at the header alone takes it."""
        text = f"{_head('HS256', self.key.kid)}.{_body(claims)}"
        return f"{text}.{b64(hmac.digest(self.key.as_pem(private=False), text.encode(), 'sha256'))}"

    def by_secret(self, claims: Json) -> str:
        """The client's secret, which the provider knows, and whoever has read the file."""
        text = f"{_head('HS256', self.key.kid)}.{_body(claims)}"
        return f"{text}.{b64(hmac.digest(SECRET.encode(), text.encode(), 'sha256'))}"

    def by_another(self, claims: Json) -> str:
        other = RSAKey.generate_key(2048, {"kid": self.key.kid})
        return jwt.encode({"alg": "RS256", "kid": self.key.kid}, claims, other)

    def by_own_key(self, claims: Json) -> str:
        """With the key beside it, in the header."""
        other = RSAKey.generate_key(2048, {"kid": "mine"})
        header = {"alg": "RS256", "kid": "mine", "jwk": other.as_dict(private=False)}
        return jwt.encode(header, claims, other)

    def altered(self, claims: Json) -> str:
        head, _, signature = self.sign(claims).split(".")
        return f"{head}.{_body({**claims, 'groups': ['chiefs']})}.{signature}"


def _head(algorithm: str, kid: str | None = None) -> str:
    return b64(json.dumps({"alg": algorithm, **({"kid": kid} if kid else {})}).encode())


def _body(claims: Json) -> str:
    return b64(json.dumps(claims).encode())


def challenge(verifier: str) -> str:
    return b64(hashlib.sha256(verifier.encode()).digest())
