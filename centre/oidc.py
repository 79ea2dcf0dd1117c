# SPDX-License-Identifier: GPL-3.0-or-later
"""Users of a provider of OpenID Connect come in, say once more who they are, and are sent out.

A login under way is nowhere but in its browser's cookie, sealed: whoever begins many fills nothing here, and
an answer that another browser was sent is worth nothing.
"""

from __future__ import annotations

import asyncio
import hashlib
import hmac
import json
import logging
import secrets
import time
from base64 import urlsafe_b64decode, urlsafe_b64encode
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING
from urllib.parse import parse_qs

from aiohttp import web

from openrtu_tools.centre import peers, users
from openrtu_tools.centre.errors import RefusedError, StoreError
from openrtu_tools.centre.login import OF_HOST
from openrtu_tools.centre.provider import Provider
from openrtu_tools.centre.settings import Oidc
from openrtu_tools.centre.store import Database
from openrtu_tools.centre.tries import Limit
from openrtu_tools.centre.wire import BODY_S, Json, check_text

if TYPE_CHECKING:
    from openrtu_tools.centre.web import Server

log = logging.getLogger("centre")

FLOW_S = 600  # from the page to the provider and back
AT_ONCE = 8  # that the provider is asked for; nobody else waits for them
USED_MOST = 10_000
TEXT_MOST = 255
BODY_MOST = 64 * 1024
HINT_MOST, HINTS_MOST = 4096, 2000  # characters that an address of the web may have; and how many are kept
LEAVE_S = 3.0  # who has logged out waits so long to learn where to go


@dataclass(frozen=True)
class Flow:
    """A login under way. What the provider is told of it is derived: nobody reads one from the other."""

    secret: str
    begun_s: int
    again: str  # the session that says once more who it is; "" of a new one

    def value(self, what: str) -> str:
        return _plain(hmac.digest(self.secret.encode(), what.encode(), "sha256"))


def _plain(octets: bytes) -> str:
    return urlsafe_b64encode(octets).decode().rstrip("=")


class Logins:
    """By the provider."""

    def __init__(self, server: Server, settings: Oidc) -> None:
        self.server = server
        self.settings = settings
        self.provider = Provider(settings)
        self.redirect = f"{settings.url}/api/oidc/callback"
        secure = server.centre.settings.secure
        # With this prefix no other host of the site puts a cookie of its own in its place.
        self.cookie = f"{'__Host-' if secure else ''}openrtu_oidc"
        self._key = secrets.token_bytes(32)
        self._used: dict[str, float] = {}  # logins that are done, until when they would be good
        self._asking = 0
        self._hints: dict[str, str] = {}  # by session, the ID token

    def add_routes(self, router: web.UrlDispatcher) -> None:
        router.add_get("/api/oidc/begin", self.begin)
        router.add_get("/api/oidc/callback", self.callback)
        router.add_post("/api/oidc/logout", self.logout)

    # ---- the cookie --------------------------------------------------------------------------

    def _seal(self, flow: Flow) -> str:
        octets = json.dumps([flow.secret, flow.begun_s, flow.again]).encode()
        return f"{_plain(octets)}.{_plain(hmac.digest(self._key, octets, 'sha256'))}"

    def _open(self, sealed: str) -> Flow | None:
        """None: it is none of ours, or too old, or done."""
        text, _, seal = sealed.partition(".")
        try:
            octets = urlsafe_b64decode(text + "==")
        except ValueError:
            return None
        right = _plain(hmac.digest(self._key, octets, "sha256"))
        if not hmac.compare_digest(right.encode(), seal.encode()):
            return None
        flow = Flow(*json.loads(octets))
        return flow if 0 <= time.time() - flow.begun_s <= FLOW_S and flow.secret not in self._used else None

    def _flow(self, request: web.Request) -> Flow:
        flow = self._open(request.cookies.get(self.cookie, ""))
        state = request.query.get("state", "")
        if not flow or not hmac.compare_digest(flow.value("state").encode(), state.encode()):
            raise RefusedError(403, "state", "this login did not begin in this browser, or is over")
        return flow

    # ---- the browser's way -------------------------------------------------------------------

    async def begin(self, request: web.Request) -> web.Response:
        """To the provider. With `again`, who is in says once more who it is."""
        flow, more = Flow(secrets.token_urlsafe(32), int(time.time()), ""), {}
        if "again" in request.query:
            session = await self.server.session(request)
            if not session.provided:
                raise RefusedError(409, "provided", "you say your own password instead")
            flow, more = Flow(flow.secret, flow.begun_s, session.id), {"prompt": "login", "max_age": "0"}
        try:
            where = await self.provider.authorization(
                self.redirect, flow.value("state"), flow.value("nonce"), flow.value("verifier"), **more
            )
        except RefusedError as error:
            return self._back(error.code)
        response = web.Response(status=303, headers={"Location": where})
        # Lax: the provider's page leads back to us. It is worth nothing without what that page brings.
        response.set_cookie(
            self.cookie, self._seal(flow), max_age=FLOW_S, httponly=True, samesite="Lax",
            secure=self.server.centre.settings.secure, path="/",
        )  # fmt: skip
        return response

    async def callback(self, request: web.Request) -> web.Response:
        """Back from the provider."""
        address = self.server.source(request)
        try:
            flow = self._flow(request)
            secret = await self._entered(request, flow, address)
        except RefusedError as error:
            log.warning("a login by the provider from %s is refused: %s", address, error)
            response = self._back(error.code)
        except StoreError as error:
            log.error("a login by the provider cannot be stored: %s", error)
            response = self._back("store")
        else:
            response = self._back("again" if flow.again else "")
            if secret:
                self.server.give_session(response, secret, self.settings.session_h)
        response.del_cookie(self.cookie, path="/")
        return response

    def _back(self, said: str) -> web.Response:
        """To our page and nowhere else, with a word that it knows."""
        return web.Response(
            status=303, headers={"Location": f"{self.settings.url}/{said and f'#login/{said}'}"}
        )

    async def _entered(self, request: web.Request, flow: Flow, address: str) -> str:
        """The secret of a new session; "" if it was one that says again who it is."""
        if "error" in request.query:
            raise RefusedError(403, "cancelled", f"the provider says {request.query['error'][:TEXT_MOST]!r}")
        code, issuer = request.query.get("code", ""), request.query.get("iss")
        limit = Limit(("host", peers.host(address)), OF_HOST)
        self.server.login.tries.begin([limit])
        if self._asking >= AT_ONCE:
            self.server.login.tries.undo([limit])
            raise RefusedError(429, "logins", "too many log in at this moment")
        self._asking += 1
        try:
            if issuer != self.settings.issuer and (issuer is not None or await self.provider.says_issuer()):
                raise RefusedError(403, "token", "the answer is another provider's")
            answer = await self.provider.redeem(self.redirect, code, flow.value("verifier"))
            claims = await self.provider.identity(answer, flow.value("nonce"), flow.begun_s, bool(flow.again))
            if self.settings.userinfo:
                claims = await self.provider.userinfo(answer, claims)
        except RefusedError as error:
            if error.code == "provider":
                self.server.login.tries.undo([limit])
            raise
        finally:
            self._asking -= 1
        self.server.login.tries.undo([limit])
        self._use(flow)
        secret = await self._let_in(claims, flow, address)
        if self.settings.logout and secret:
            self._keep_hint(users.id_of(users.hash_secret(secret)), answer["id_token"])
        return secret

    def _keep_hint(self, session: str, token: str) -> None:
        """By which the provider knows who logs out. The oldest gives way: then it asks."""
        if len(token) <= HINT_MOST:
            self._hints[session] = token
        while len(self._hints) > HINTS_MOST:
            del self._hints[next(iter(self._hints))]

    async def leaving(self, session: users.Session) -> str:
        """Where a session that has ended here ends at the provider, too; "" if nobody can say so now."""
        hint = self._hints.pop(session.id, "")
        if not self.settings.logout or not session.provided:
            return ""
        try:
            async with asyncio.timeout(LEAVE_S):
                return await self.provider.leaving(f"{self.settings.url}/", hint)
        except (TimeoutError, RefusedError):
            return ""

    def _use(self, flow: Flow) -> None:
        """Once: between here and where it was looked at, another answer may have been under way."""
        now_s = time.time()
        if flow.secret in self._used:
            raise RefusedError(403, "state", "this login is done already")
        self._used = {secret: until_s for secret, until_s in self._used.items() if until_s > now_s}
        if len(self._used) >= USED_MOST:
            raise RefusedError(429, "logins", "too many have logged in since")
        self._used[flow.secret] = flow.begun_s + FLOW_S + 1

    async def _let_in(self, claims: Json, flow: Flow, address: str) -> str:
        try:
            who = self._described(claims)
        except RefusedError as error:
            self.server.login.say("", f"from {address}: {error}")
            raise
        if flow.again:
            rows = await self.server.centre.store.read(users.LIST_OF_SUBJECT, who.subject, users.now_s())
            if not any(users.id_of(row["hash"]) == flow.again for row in rows):
                raise RefusedError(403, "somebody_else", "somebody else has logged in, or the session ended")
            self.server.login.confirm_provided(flow.again)
            return ""
        wanted = users.Wanted(
            self.settings.session_h * 3600,
            address,
            how=f"by {self.settings.issuer}",
            sid=_text(claims, "sid"),
        )

        def begin(database: Database) -> str:
            return users.begin(database, users.enter(database, who), wanted)

        try:
            return await self.server.centre.store.write(begin)
        except RefusedError as error:
            self.server.login.say("", f"from {address}: {who.name}: {error}")
            raise

    def _described(self, claims: Json) -> users.Provided:
        """Who it is, and may what: as the file says of the claim, and nothing else."""
        said = claims.get(self.settings.claim)
        values = [said] if isinstance(said, str) else said if isinstance(said, list) else []
        name = f"{users.PROVIDED}{_text(claims, self.settings.name) or _text(claims, 'sub')}"
        granted = next((each for each in self.settings.roles if each.value in values), None)
        if not granted:
            raise RefusedError(403, "no_role", f"{name[: users.NAME_MOST]}: the provider gives no role")
        return users.Provided(name, self._digest(claims["sub"]), granted.role, granted.groups)

    def _digest(self, subject: str) -> str:
        """By which a user is known: nothing else of the provider's stays the same, or is one user's alone."""
        return hashlib.sha256(json.dumps([self.settings.issuer, subject]).encode()).hexdigest()

    # ---- the provider's way ------------------------------------------------------------------

    async def logout(self, request: web.Request) -> web.Response:
        """It has sent somebody out (OpenID Connect Back-Channel Logout 1.0)."""
        try:
            async with asyncio.timeout(BODY_S):
                form = parse_qs((await request.read()).decode())
        except (TimeoutError, ValueError) as error:
            raise RefusedError(400, "form", "the body is no form") from error
        subject, sid = await self.provider.logged_out(form.get("logout_token", [""])[0])
        check_text(sid)
        digest = self._digest(subject) if subject else ""
        await self.server.centre.store.write(partial(users.sent_out, subject=digest, sid=sid))
        return web.Response()


def _text(claims: Json, key: str) -> str:
    found = claims.get(key)
    if not isinstance(found, str):
        return ""
    check_text(found)
    return found
