# SPDX-License-Identifier: GPL-3.0-or-later
"""Who comes in: passwords, how often they are guessed, and what is said of it in the audit."""

from __future__ import annotations

import asyncio
import logging
import time
from collections import OrderedDict
from collections.abc import Callable
from contextlib import suppress
from functools import partial

from openrtu_tools.centre import peers, second, users
from openrtu_tools.centre.centre import Centre
from openrtu_tools.centre.errors import RefusedError, StoreError
from openrtu_tools.centre.store import Database, Row, audit
from openrtu_tools.centre.tries import Answer, Limit, Pool, Tries
from openrtu_tools.centre.users import Session

log = logging.getLogger("centre")

# Wrong passwords that are free: of a name from a host, of a host whatever the name, of a name from all hosts
# where it did not come from before, of a session that is there.
OF_BOTH, OF_HOST, OF_NAME, OF_SESSION = 5, 20, 50, 5
OF_CODE = 5  # wrong codes of a name, from wherever they come: a code has only six digits
KNOWN_MOST = 10_000
# A hash takes 16 MiB. Whoever is in already never waits for strangers.
THREADS, PLACES = 2, 32
OWN_THREADS, OWN_PLACES = 1, 16
AUDITED_MOST, AUDITED_S = 60, 60.0  # refused logins; what is more is counted
PENDING_S = 600.0  # to read the secret into an app and to say its code
READ_ONLY_S = 3600.0  # of a session that could not be stored
READ_ONLY_MOST = 1000
CONFIRMED_S = 120.0  # after a provider's user has logged in there once more


class Login:
    def __init__(self, centre: Centre) -> None:
        self.centre = centre
        self.tries = Tries()
        self.strangers = Pool(THREADS, PLACES)
        self.own = Pool(OWN_THREADS, OWN_PLACES)
        self.known: OrderedDict[tuple[str, str], None] = OrderedDict()  # a name, and a host it came from
        self.kept: dict[bytes, tuple[float, Session, Row]] = {}  # could not be stored; until when it is good
        self.steps: dict[str, int] = {}  # of codes that were used while nothing could be stored
        self.pending: dict[str, tuple[float, str]] = {}  # by session: a second factor that is being set up
        self.confirmed: dict[str, float] = {}  # by session: until when its user need not log in once more
        self.refused: asyncio.Queue[tuple[str, str]] = asyncio.Queue()
        self.said, self.said_since_s, self.unsaid = 0, 0.0, 0

    # ---- a password --------------------------------------------------------------------------

    async def row_of(self, name: str, password: str, address: str) -> Row:
        """The user's. Raises RefusedError."""
        host = peers.host(address)
        both = Limit(("both", name, host), OF_BOTH)
        limits = [both, Limit(("host", host), OF_HOST)]
        if (name, host) not in self.known:
            limits.append(Limit(("name", name), OF_NAME))
        row, right = await self._looked(self.strangers, limits, name, password)
        if not right:
            self._say_wrong(name if row else "", address)
            raise RefusedError(401, "password", "the name or the password is wrong")
        assert row
        self.tries.forget(both)
        self.known[name, host] = None
        self.known.move_to_end((name, host))
        if len(self.known) > KNOWN_MOST:
            self.known.popitem(last=False)
        return row

    async def confirm(self, session: Session, password: str, address: str) -> None:
        """Who is in already says the own password again. What strangers guess does not count for it."""
        if session.provided:
            if time.monotonic() >= self.confirmed.get(session.id, 0.0):
                raise RefusedError(403, "again", "log in by your provider once more, then do it within 2 min")
            return
        limit = Limit(("session", session.id), OF_SESSION)
        _, right = await self._looked(self.own, [limit], session.user, password)
        if not right:
            self._say_wrong(session.user, address)
            raise RefusedError(403, "own_password", "your own password is wrong")
        self.tries.forget(limit)

    def confirm_provided(self, session: str) -> None:
        """Its user has logged in at the provider once more."""
        now_s = time.monotonic()
        self.confirmed = {id_: until_s for id_, until_s in self.confirmed.items() if until_s > now_s}
        self.confirmed[session] = now_s + CONFIRMED_S

    async def _looked(
        self, pool: Pool, limits: list[Limit], name: str, password: str
    ) -> tuple[Row | None, bool]:
        """All is counted before anything is awaited."""
        pool.take()
        try:
            self.tries.begin(limits)
            try:
                rows = await self.centre.store.read("SELECT * FROM users WHERE name = ?", name)
                row = rows[0] if rows else None
                right = await pool.do(partial(users.fits, password, row))
            except BaseException:
                self.tries.undo(limits)
                raise
        finally:
            pool.give_back()
        if right:
            self.tries.undo(limits)
        return row, right

    # ---- the audit ---------------------------------------------------------------------------

    def _say_wrong(self, name: str, address: str) -> None:
        """A name that nobody has is left out: many a password was typed in its place."""
        log.warning("a wrong password or name from %s", address)
        self.say(name, f"from {address}{'' if name else ', unknown name'}")

    def say(self, name: str, detail: str) -> None:
        """In the audit, soon."""
        now_s = time.monotonic()
        if now_s >= self.said_since_s + AUDITED_S:
            self.said, self.said_since_s = 0, now_s
        if self.said < AUDITED_MOST:
            self.said += 1
            self.refused.put_nowait((name, detail))
        else:
            self.unsaid += 1

    async def audit_refused(self) -> None:
        """Stores what was refused, for ever; so many in a time, that nobody fills the disk with it."""
        while True:
            said = []
            with suppress(TimeoutError):
                async with asyncio.timeout(AUDITED_S):
                    said.append(await self.refused.get())
            while not self.refused.empty():
                said.append(self.refused.get_nowait())
            unsaid, self.unsaid = self.unsaid, 0
            if not said and not unsaid:
                continue
            try:
                await self.centre.store.write(partial(_audit_refused, said=said, unsaid=unsaid))
            except StoreError:
                self.unsaid += unsaid + len(said)

    # ---- a session ---------------------------------------------------------------------------

    async def begin(self, row: Row, address: str, code: str) -> str:
        """Its secret. While nothing can be stored, one that only reads, and that this process alone knows."""
        limits = [Limit(("code", row["name"]), OF_CODE)]
        if row["totp"]:
            if not code:
                raise RefusedError(401, "code", "a code of your second factor is needed, too")
            self.tries.begin(limits)
        try:
            secret = await self._begin(row, address, code)
        except RefusedError as error:
            if error.code == "wrong_code":
                self._say_wrong(row["name"], address)
            raise
        self.tries.forget(limits[0])
        return secret

    async def _begin(self, row: Row, address: str, code: str) -> str:
        seconds = self.centre.settings.session_h * 3600

        def begin(database: Database) -> str:
            now = users.unchanged(database, row)
            if now["totp"]:
                second.use(database, now, code)
            return users.begin(database, row["name"], users.Wanted(seconds, address))

        if not self.centre.fault:
            try:
                return await self.centre.store.write(begin)
            except StoreError as error:
                log.error("a login of %s cannot be stored, it only reads: %s", row["name"], error)
        if row["totp"]:
            self._use_unstored(row, code)
        return self._keep(row, seconds)

    def _use_unstored(self, row: Row, code: str) -> None:
        """A recovery code, which is good once, is good for nothing while that cannot be stored."""
        after = max(row["totp_step"], self.steps.get(row["name"], 0))
        step = second.step_of(row["totp"], code.strip(), after)
        if not step:
            raise RefusedError(401, "wrong_code", second.WRONG)
        self.steps[row["name"]] = step

    def _keep(self, row: Row, seconds: float) -> str:
        now_s = time.monotonic()
        self.kept = {hashed: each for hashed, each in self.kept.items() if each[0] > now_s}
        if len(self.kept) >= READ_ONLY_MOST:
            raise RefusedError(503, "store", "nothing can be stored, and too many have logged in since")
        secret, session = users.unstored(row)
        self.kept[users.hash_secret(secret)] = now_s + min(seconds, READ_ONLY_S), session, row
        return secret

    # ---- a second factor ---------------------------------------------------------------------

    def offer(self, session: Session) -> str:
        """A new secret, which is in force when one of its codes comes back."""
        now_s = time.monotonic()
        self.pending = {id_: each for id_, each in self.pending.items() if each[0] > now_s}
        secret = second.new_secret()
        self.pending[session.id] = now_s + PENDING_S, secret
        return secret

    def offered(self, session: Session) -> str:
        until_s, secret = self.pending.get(session.id, (0.0, ""))
        if time.monotonic() >= until_s:
            raise RefusedError(409, "unknown", "begin again: no second factor is being set up")
        return secret

    async def confirm_code(self, session: Session, work: Callable[[Database], Answer]) -> Answer:
        """A transaction that looks at a code."""
        limit = Limit(("code", session.user), OF_CODE)
        self.tries.begin([limit])
        answer = await self.centre.store.write(work)
        self.tries.forget(limit)
        return answer

    async def find_kept(self, secret: str) -> Session | None:
        """It ends with a change of its user, as all others do."""
        until_s, session, before = self.kept.get(users.hash_secret(secret), (0.0, None, None))
        if not session or time.monotonic() >= until_s:
            return None
        rows = await self.centre.store.read("SELECT * FROM users WHERE name = ?", session.user)
        return session if rows and rows[0] == before else None

    async def end(self, secret: str) -> None:
        if self.kept.pop(users.hash_secret(secret), None) is None:
            await self.centre.store.write(lambda database: users.end(database, secret))


def _audit_refused(database: Database, said: list[tuple[str, str]], unsaid: int) -> None:
    now_ns = time.time_ns()
    for name, detail in said:
        audit(database, now_ns, name, "login refused", detail)
    if unsaid:
        audit(database, now_ns, "", "login refused", f"{unsaid} more")
