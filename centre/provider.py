# SPDX-License-Identifier: GPL-3.0-or-later
"""A provider of OpenID Connect: where it is asked, with which keys it signs, and whether it has signed this.

Authlib knows the protocol; aiohttp asks: for a provider that hangs waits only who logs in by it.
"""

from __future__ import annotations

import asyncio
import json
import logging
import ssl
import time
from collections.abc import Awaitable, Callable
from typing import Any
from urllib.parse import quote

import aiohttp
from authlib.common.urls import add_params_to_uri
from authlib.oauth2.auth import ClientAuth
from authlib.oauth2.claims import JWTClaims
from authlib.oauth2.rfc6749.parameters import prepare_grant_uri, prepare_token_request
from authlib.oauth2.rfc7636 import create_s256_code_challenge
from authlib.oidc.core import CodeIDToken
from authlib.oidc.discovery import get_well_known_url
from joserfc import jwt
from joserfc.errors import BadSignatureError, InvalidKeyIdError, JoseError
from joserfc.jwk import JWKRegistry, KeySet
from joserfc.jws import JWSRegistry

from openrtu_tools.centre.errors import RefusedError
from openrtu_tools.centre.settings import Oidc
from openrtu_tools.centre.wire import Json

log = logging.getLogger("centre")

# Whatever a token's header or the provider says: no "none", and no HMAC, by which the client signs as well.
ALGORITHMS = frozenset(f"{kind}{bits}" for kind in ("RS", "PS", "ES") for bits in (256, 384, 512)) | {
    "EdDSA",
    "Ed25519",
}
KEY_TYPES = ("RSA", "EC", "OKP")
LEEWAY_S = 60  # that its clock and ours may differ
ANSWER_S = 10.0
OCTETS_MOST = 256 * 1024
GOOD_S = 600.0  # of what it says of itself, and of its keys
AGAIN_S = 30.0  # between two looks for a key that is not known
FAILED_S = 5.0  # after a failure nobody waits for another one
LOGOUT_S = 120  # that the word of a logout may be under way
LOGOUT = "http://schemas.openid.net/event/backchannel-logout"
TEXT_MOST = 255


class Kept:
    """What the provider says, for a while. Those who want it at once wait for one answer."""

    def __init__(self, fetch: Callable[[], Awaitable[Any]]) -> None:
        self._fetch = fetch
        self._lock = asyncio.Lock()
        self._value: Any = None
        self._until_s = self._failed_s = self._forced_s = float("-inf")

    async def get(self) -> Any:
        async with self._lock:
            if time.monotonic() >= self._until_s:
                await self._get()
            return self._value

    async def again(self) -> Any:
        """As it is now; but strangers do not have it asked as often as they like."""
        async with self._lock:
            if time.monotonic() >= self._forced_s + AGAIN_S:
                self._forced_s = time.monotonic()
                await self._get()
            return self._value

    async def _get(self) -> None:
        if time.monotonic() < self._failed_s + FAILED_S:
            raise RefusedError(503, "provider", "the provider did not answer a moment ago")
        try:
            self._value = await self._fetch()
        except RefusedError:
            self._failed_s = time.monotonic()
            raise
        self._until_s = time.monotonic() + GOOD_S


class Provider:
    def __init__(self, settings: Oidc) -> None:
        self.settings = settings
        self._auth = self._client_auth(settings.secret())
        self._tls = ssl.create_default_context(cafile=settings.ca)
        self._description = Kept(self._describe)
        self._keys = Kept(self._fetch_keys)

    def _client_auth(self, secret: str) -> ClientAuth:
        """The secret as RFC 6749, 2.3.1 wants it: name and secret are encoded before they are joined."""
        if not secret:
            return ClientAuth(self.settings.client_id, "", "none")
        return ClientAuth(quote(self.settings.client_id, ""), quote(secret, ""), "client_secret_basic")

    # ---- asking it ---------------------------------------------------------------------------

    async def authorization(self, redirect: str, state: str, nonce: str, verifier: str, **more: str) -> str:
        """Where a browser logs in."""
        description = await self._description.get()
        return prepare_grant_uri(
            description["authorization_endpoint"],
            client_id=self.settings.client_id,
            response_type="code",
            redirect_uri=redirect,
            scope=self.settings.scope,
            state=state,
            nonce=nonce,
            code_challenge=create_s256_code_challenge(verifier),
            code_challenge_method="S256",
            **more,
        )

    async def says_issuer(self) -> bool:
        """Whether each of its answers names it (RFC 9207)."""
        description = await self._description.get()
        return description.get("authorization_response_iss_parameter_supported") is True

    async def redeem(self, redirect: str, code: str, verifier: str) -> Json:
        """What it gives for a code. It takes each once."""
        description = await self._description.get()
        body = prepare_token_request(
            "authorization_code", redirect_uri=redirect, code=code, code_verifier=verifier
        )
        headers = {"Content-Type": "application/x-www-form-urlencoded", "Accept": "application/json"}
        url, headers, body = self._auth.prepare("POST", description["token_endpoint"], headers, body)
        return await self._ask("POST", url, headers=headers, data=body)

    async def userinfo(self, answer: Json, claims: Json) -> Json:
        """What it says there of the same user, and the ID token does not: what is signed counts."""
        description, token = await self._description.get(), answer.get("access_token")
        if not isinstance(token, str):
            raise _wrong("there is none for the userinfo end point")
        headers = {"Authorization": f"Bearer {token}", "Accept": "application/json"}
        more = await self._ask("GET", description["userinfo_endpoint"], headers=headers)
        if more.get("sub") != claims["sub"]:
            raise _wrong("the userinfo end point tells of somebody else")
        return {**more, **claims}

    async def leaving(self, back: str, hint: str) -> str:
        """Where a browser logs out there (RP-Initiated Logout 1.0); "" if it has no such place."""
        description = await self._description.get()
        if not self._is_address(url := description.get("end_session_endpoint")):
            return ""
        told = [("client_id", self.settings.client_id), ("post_logout_redirect_uri", back)]
        return add_params_to_uri(url, [*told, *([("id_token_hint", hint)] if hint else [])])

    async def _describe(self) -> Json:
        description = await self._ask("GET", get_well_known_url(self.settings.issuer, external=True))
        if description.get("issuer") != self.settings.issuer:
            raise _failed(f"it calls itself {str(description.get('issuer'))[:TEXT_MOST]}")
        wanted = ["authorization_endpoint", "token_endpoint", "jwks_uri"]
        if self.settings.userinfo:
            wanted.append("userinfo_endpoint")
        for key in wanted:
            if not self._is_address(description.get(key)):
                raise _failed(f"its {key} is no address by https")
        return description

    def _is_address(self, url: Any) -> bool:
        plain = self.settings.issuer.startswith("http://")
        return isinstance(url, str) and url.startswith(("https://", "http://") if plain else "https://")

    async def _fetch_keys(self) -> KeySet:
        """Its public keys that sign. One of a kind that nobody here knows is left out."""
        keys = (await self._ask("GET", (await self._description.get())["jwks_uri"])).get("keys")
        usable = []
        for key in keys if isinstance(keys, list) else []:
            try:
                if key["kty"] in KEY_TYPES and key.get("use", "sig") == "sig":
                    usable.append(JWKRegistry.import_key(key))
            except (JoseError, ValueError, TypeError, KeyError, AttributeError):
                continue
        if not usable:
            raise _failed("it has no key that signs")
        return KeySet(usable)

    async def _ask(self, method: str, url: str, **more: Any) -> Json:
        """It leads nowhere else, says no more than so much, and says it in time."""
        try:
            async with (
                asyncio.timeout(ANSWER_S),
                aiohttp.ClientSession() as session,
                session.request(method, url, allow_redirects=False, ssl=self._tls, **more) as response,
            ):
                octets = b""
                async for piece in response.content.iter_chunked(65536):
                    octets += piece
                    if len(octets) > OCTETS_MOST:
                        raise _failed("its answer is too long")
                if response.status != 200:
                    said = octets[:TEXT_MOST].decode(errors="replace")
                    log.warning("the provider: %s answers %s: %r", url, response.status, said)
                    if 400 <= response.status < 500 and method == "POST":
                        raise RefusedError(403, "token", "the provider does not take this code")
                    raise _failed(f"it answers {response.status}")
                answer = json.loads(octets)
        except (
            aiohttp.ClientError,
            OSError,
            ValueError,
            RecursionError,
        ) as error:  # a time-out is an OSError
            raise _failed(str(error) or type(error).__name__) from error
        if not isinstance(answer, dict):
            raise _failed("its answer is no object of JSON")
        return answer

    # ---- what it has signed ------------------------------------------------------------------

    async def identity(self, answer: Json, nonce: str, begun_s: int, again: bool) -> Json:
        """The claims of the ID token of a login that began then. Raises RefusedError."""
        token = answer.get("id_token")
        claims, header = await self._signed(token)
        options = {**self._ours(), "sub": {"essential": True}, "nonce": {"essential": True, "value": nonce}}
        params = {
            "nonce": nonce,
            "client_id": self.settings.client_id,
            "access_token": answer.get("access_token"),
            "max_age": "0" if again else "",  # then it says when somebody logged in
        }
        _valid(CodeIDToken(claims, header, options, params))
        if claims["iat"] < begun_s - LEEWAY_S:
            raise _wrong("it was signed before this login began")
        if again and claims["auth_time"] < begun_s - LEEWAY_S:
            raise _wrong("nobody has logged in for it")
        return claims

    async def logged_out(self, token: str) -> tuple[str, str]:
        """Subject and session of whom it has logged out (Back-Channel Logout 1.0, 2.6); one may be empty."""
        claims, header = await self._signed(token)
        _valid(JWTClaims(claims, header, {**self._ours(), "iat": {"essential": True}}))
        events = claims.get("events")
        if not isinstance(events, dict) or not isinstance(events.get(LOGOUT), dict) or "nonce" in claims:
            raise _wrong("it is no word of a logout")
        if claims["iat"] < time.time() - LOGOUT_S - LEEWAY_S:
            raise _wrong("it is too old")
        subject, session = claims.get("sub", ""), claims.get("sid", "")
        if not isinstance(subject, str) or not isinstance(session, str) or not (subject or session):
            raise _wrong("it does not say who")
        return subject, session

    def _ours(self) -> Json:
        return {
            "iss": {"essential": True, "value": self.settings.issuer},
            "aud": {"essential": True, "value": self.settings.client_id, "validate": self._alone},
        }

    def _alone(self, _: Any, audience: Any) -> bool:
        """For nobody else, too: who else has it would come in with it."""
        return audience in (self.settings.client_id, [self.settings.client_id])

    async def _signed(self, token: Any) -> tuple[Json, Json]:
        """Claims and header. With a key that is not known, it may have new ones."""
        if not isinstance(token, str):
            raise _wrong("there is none")
        try:
            return _verify(token, await self._keys.get())
        except (InvalidKeyIdError, BadSignatureError):
            keys = await self._keys.again()
        try:
            return _verify(token, keys)
        except JoseError as error:
            raise _wrong(str(error)) from error


def _verify(token: str, keys: KeySet) -> tuple[Json, Json]:
    try:
        read = jwt.decode(token, keys, registry=JWSRegistry(algorithms=ALGORITHMS, strict_check_header=False))
    except (InvalidKeyIdError, BadSignatureError):
        raise
    except (JoseError, ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise _wrong(str(error)) from error
    return read.claims, read.header


def _valid(claims: JWTClaims) -> None:
    try:
        claims.validate(leeway=LEEWAY_S)
    except (JoseError, ValueError, TypeError, KeyError, AttributeError) as error:
        raise _wrong(str(error)) from error


def _failed(why: str) -> RefusedError:
    log.warning("the provider: %s", why)
    return RefusedError(503, "provider", f"the provider: {why}")


def _wrong(why: str) -> RefusedError:
    log.warning("a token of the provider: %s", why)
    return RefusedError(403, "token", f"the provider's token: {why}")
