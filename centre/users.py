# SPDX-License-Identifier: GPL-3.0-or-later
"""Users, their sessions and tokens. The database has hashes only."""

from __future__ import annotations

import hashlib
import hmac
import secrets
import time
from collections.abc import Iterable
from dataclasses import dataclass

from openrtu_tools.centre.errors import RefusedError
from openrtu_tools.centre.model import Station
from openrtu_tools.centre.roles import ROLES
from openrtu_tools.centre.store import Database, Row, audit

PASSWORD_LEAST = 10
# RFC 7914; 16 MiB and some 50 ms: too dear to guess with.
SCRYPT = {"n": 2**14, "r": 8, "p": 1}
NAME_MOST = 64


@dataclass(frozen=True)
class Session:
    user: str
    role: str
    csrf: str
    label: str  # of a token; "" of a browser
    groups: frozenset[str] = frozenset()  # whose stations alone are seen; none: all

    def sees(self, station: Station) -> bool:
        return not self.groups or station.settings.group in self.groups

    def may(self, role: str) -> bool:
        return ROLES.index(self.role) >= ROLES.index(role)


def _hash(password: str, salt: bytes) -> bytes:
    return hashlib.scrypt(password.encode(), salt=salt, **SCRYPT)


def _hash_secret(secret: str) -> bytes:
    """A secret of 256 random bits needs no slow hash."""
    return hashlib.sha256(secret.encode()).digest()


def put(
    database: Database,
    name: str,
    role: str,
    password: str | None,
    by: str,
    groups: Iterable[str] = (),
    disabled: bool = False,
) -> None:
    """Adds a user, or changes one, who keeps the password without a new one. Ends the user's sessions."""
    wanted = sorted({*groups})
    if role not in ROLES:
        raise RefusedError(400, "role", f"{role} is no role: {', '.join(ROLES)}")
    if not name.strip() or len(name) > NAME_MOST:
        raise RefusedError(400, "name", f"a name has 1 to {NAME_MOST} characters")
    if password is not None and len(password) < PASSWORD_LEAST:
        raise RefusedError(400, "password", f"a password has at least {PASSWORD_LEAST} characters")
    if wanted and role == ROLES[-1]:
        # Who manages users could give itself all stations.
        raise RefusedError(400, "groups", f"the role {role} sees all stations: give no groups")
    if any(not group or "\n" in group for group in wanted):
        raise RefusedError(400, "groups", "a group is a word of the centre's file")
    salt = secrets.token_bytes(16)
    if password is not None:
        hashed = _hash(password, salt)
    elif row := database.execute("SELECT salt, hash FROM users WHERE name = ?", (name,)).fetchone():
        salt, hashed = row["salt"], row["hash"]
    else:
        raise RefusedError(400, "password", f"there is no user {name}: a new one needs a password")
    database.execute('DELETE FROM sessions WHERE "user" = ?', (name,))
    database.execute(
        "INSERT INTO users (name, role, salt, hash, groups, disabled) VALUES (?1, ?2, ?3, ?4, ?5, ?6)"
        " ON CONFLICT (name) DO UPDATE SET role = ?2, salt = ?3, hash = ?4, groups = ?5, disabled = ?6",
        (name, role, salt, hashed, "\n".join(wanted), int(disabled)),
    )
    more = [*(f"of {group}" for group in wanted)]
    more += ["new password"] if password is not None else []
    more += ["disabled"] if disabled else []
    audit(database, time.time_ns(), by, "user", f"{name}: {', '.join([role, *more])}")


def remove(database: Database, name: str, by: str) -> None:
    if not database.execute("DELETE FROM users WHERE name = ?", (name,)).rowcount:
        raise RefusedError(404, "unknown", f"there is no user {name}")
    audit(database, time.time_ns(), by, "user removed", name)


def fits(password: str, row: Row | None) -> bool:
    """As slow for a name that is not there, or is disabled: nobody learns names by time."""
    salt = row["salt"] if row else bytes(16)
    same = hmac.compare_digest(_hash(password, salt), row["hash"] if row else bytes(64))
    return same and row is not None and not row["disabled"]


def exists(database: Database, name: str) -> bool:
    return database.execute("SELECT 1 FROM users WHERE name = ?", (name,)).fetchone() is not None


def begin(database: Database, user: str, label: str, seconds: float) -> str:
    """A new session or token; its secret, which nobody can read again."""
    secret = secrets.token_urlsafe(32)
    now_s = int(time.time())
    database.execute("DELETE FROM sessions WHERE expires_s <= ?", (now_s,))
    database.execute(
        'INSERT INTO sessions (hash, "user", csrf, label, expires_s) VALUES (?, ?, ?, ?, ?)',
        (_hash_secret(secret), user, secrets.token_urlsafe(24), label, now_s + int(seconds)),
    )
    audit(database, time.time_ns(), user, "token" if label else "login", label)
    return secret


def end(database: Database, secret: str) -> None:
    database.execute("DELETE FROM sessions WHERE hash = ?", (_hash_secret(secret),))


FIND = (
    'SELECT users.name AS "user", role, csrf, label, groups FROM sessions'
    " JOIN users ON users.name = sessions.user WHERE sessions.hash = ? AND expires_s > ? AND disabled = 0"
)


def found(row: Row) -> Session:
    """What FIND has found."""
    return Session(**{**row, "groups": frozenset(row["groups"].split("\n")) - {""}})


def find_values(secret: str) -> tuple[bytes, int]:
    """What FIND is asked with."""
    return _hash_secret(secret), int(time.time())
