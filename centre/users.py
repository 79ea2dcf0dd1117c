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
from openrtu_tools.centre.roles import ROLES, SCOPES
from openrtu_tools.centre.store import Database, Row, audit

PASSWORD_LEAST = 10
# RFC 7914; 16 MiB and some 50 ms: too dear to guess with.
SCRYPT = {"n": 2**14, "r": 8, "p": 1}
NAME_MOST = 64
PROVIDED = "oidc:"  # begins the name of a provider's user, and of nobody else
BUS = "mqtt"  # who commands by the broker, and no user

SESSIONS_MOST = 50  # of a user, and as many tokens


@dataclass(frozen=True)
class Session:
    user: str
    role: str
    csrf: str
    label: str  # of a token; "" of a browser
    groups: frozenset[str] = frozenset()  # whose stations alone are seen; none: all
    id: str = ""
    provided: bool = False  # of a provider's user, who has no password here

    def sees(self, station: Station) -> bool:
        return not self.groups or station.settings.group in self.groups

    def may(self, role: str) -> bool:
        return ROLES.index(self.role) >= ROLES.index(role)

    def still(self, database: Database) -> None:
        """Raises RefusedError unless it is there yet, with its role: it may have ended since."""
        rows = database.execute(
            "SELECT sessions.hash, role FROM sessions JOIN users ON users.name = sessions.user"
            ' WHERE sessions."user" = ? AND expires_s > ? AND disabled = 0',
            (self.user, now_s()),
        )
        if not any(id_of(row["hash"]) == self.id and _least(row["role"], self.role) for row in rows):
            raise RefusedError(401, "session", "log in: there is no such session, or it has ended")


def _hash(password: str, salt: bytes) -> bytes:
    return hashlib.scrypt(password.encode(), salt=salt, **SCRYPT)


def hash_secret(secret: str) -> bytes:
    """A secret of 256 random bits needs no slow hash."""
    return hashlib.sha256(secret.encode()).digest()


def _check_password(password: str) -> None:
    if len(password) < PASSWORD_LEAST:
        raise RefusedError(400, "password", f"a password has at least {PASSWORD_LEAST} characters")


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
    if not name.strip() or len(name) > NAME_MOST or not name.isprintable():
        raise RefusedError(400, "name", f"a name has 1 to {NAME_MOST} characters that can be printed")
    before = row_of(database, name)
    if name == BUS and not before:
        raise RefusedError(400, "name", f"{BUS} is who commands by the broker: choose another name")
    if password is not None:
        _check_password(password)
    if wanted and role == ROLES[-1]:
        # Who manages users could give itself all stations.
        raise RefusedError(400, "groups", f"the role {role} sees all stations: give no groups")
    if any(not group or "\n" in group for group in wanted):
        raise RefusedError(400, "groups", "a group is a word of the centre's file")
    if before["subject"] if before else name.startswith(PROVIDED):
        as_before = before and (role, "\n".join(wanted)) == (before["role"], before["groups"])
        if password is not None or not as_before:
            raise RefusedError(
                409, "provided", f"{name} is a provider's user: it says all but who is disabled"
            )
    salt = secrets.token_bytes(16)
    if password is not None:
        hashed = _hash(password, salt)
    elif before:
        salt, hashed = before["salt"], before["hash"]
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


def fresh(password: str) -> tuple[bytes, bytes]:
    """Its salt and hash. Raises RefusedError."""
    _check_password(password)
    salt = secrets.token_bytes(16)
    return salt, _hash(password, salt)


def change_password(database: Database, session: Session, salt: bytes, hashed: bytes) -> None:
    """One's own. Ends all other sessions and tokens of the user: who knew the old one is out."""
    session.still(database)
    database.execute("UPDATE users SET salt = ?, hash = ? WHERE name = ?", (salt, hashed, session.user))
    for row in _of_user(database, session.user):
        if id_of(row["hash"]) != session.id:
            database.execute("DELETE FROM sessions WHERE hash = ?", (row["hash"],))
    audit(database, time.time_ns(), session.user, "password")


def fits(password: str, row: Row | None) -> bool:
    """As slow for a name that is not there, or is disabled: nobody learns names by time."""
    salt = row["salt"] if row else bytes(16)
    same = hmac.compare_digest(_hash(password, salt), row["hash"] if row else bytes(64))
    return same and row is not None and not row["disabled"] and not row["subject"]


def row_of(database: Database, name: str) -> Row | None:
    row = database.execute("SELECT * FROM users WHERE name = ?", (name,)).fetchone()
    return dict(row) if row else None


def may_command(database: Database, name: str, station: Station) -> bool:
    """Now, whatever it was when something began."""
    row = row_of(database, name)
    if not row or row["disabled"] or not _least(row["role"], "operator"):
        return False
    return not row["groups"] or station.settings.group in row["groups"].split("\n")


# ---- users of a provider -------------------------------------------------------------------------


@dataclass(frozen=True)
class Provided:
    """As the provider describes it now."""

    name: str
    subject: str  # a hash of provider and subject: it alone says which user it is
    role: str
    groups: tuple[str, ...]


def enter(database: Database, who: Provided) -> str:
    """Its name here, which it keeps. Raises RefusedError: a name is nobody else's, whoever has it."""
    row = database.execute("SELECT * FROM users WHERE subject = ?", (who.subject,)).fetchone()
    groups = "\n".join(sorted(who.groups))
    if row and row["disabled"]:
        raise RefusedError(403, "disabled", "this user is disabled here")
    if row and (row["role"], row["groups"]) == (who.role, groups):
        return str(row["name"])
    if row:
        database.execute(
            "UPDATE users SET role = ?, groups = ? WHERE subject = ?", (who.role, groups, who.subject)
        )
    else:
        if not who.name.isprintable() or len(who.name) > NAME_MOST:
            raise RefusedError(403, "name", f"the name has more than {NAME_MOST} characters, or odd ones")
        if row_of(database, who.name):
            raise RefusedError(403, "name_taken", "another user has this name")
        database.execute(
            "INSERT INTO users (name, role, salt, hash, groups, subject) VALUES (?, ?, ?, ?, ?, ?)",
            (who.name, who.role, b"", b"", groups, who.subject),
        )
    name = str(row["name"] if row else who.name)
    more = [*(f"of {group}" for group in sorted(who.groups))]
    audit(database, time.time_ns(), name, "user", f"{name}: {', '.join([who.role, *more])}, by the provider")
    return name


def sent_out(database: Database, subject: str, sid: str) -> None:
    """Ends a session of the provider's, or all of a user."""
    rows = database.execute(
        'SELECT sessions.hash, sessions."user" FROM sessions JOIN users ON users.name = sessions."user"'
        " WHERE users.subject <> '' AND (? = '' OR users.subject = ?) AND (? = '' OR sessions.sid = ?)",
        (subject, subject, sid, sid),
    )
    for row in list(rows):
        database.execute("DELETE FROM sessions WHERE hash = ?", (row["hash"],))
        audit(database, time.time_ns(), row["user"], "session ended", "by the provider")


# ---- sessions and tokens -------------------------------------------------------------------------


@dataclass(frozen=True)
class Wanted:
    """A new session, or a token."""

    seconds: float
    address: str = ""
    label: str = ""
    scope: str = "engineer"  # no less than the user may
    how: str = ""  # somebody logged in
    sid: str = ""  # the provider's session


def now_s() -> int:
    return int(time.time())


def id_of(hashed: bytes) -> str:
    """By which it is named to its user: nobody gets in with a part of a hash."""
    return hashed.hex()[:16]


def unchanged(database: Database, row: Row) -> Row:
    """The user, whose password was compared before. Raises RefusedError if it is another one meanwhile."""
    now = row_of(database, row["name"])
    if not now or now["disabled"] or now["hash"] != row["hash"] or now["totp"] != row["totp"]:
        raise RefusedError(401, "password", "the user was changed meanwhile: log in again")
    return now


def begin(database: Database, user: str, wanted: Wanted) -> str:
    """Its secret, which nobody can read again."""
    secret = secrets.token_urlsafe(32)
    begun_s = now_s()
    row = row_of(database, user)
    if wanted.label and row and row["subject"]:
        raise RefusedError(409, "provided", "a program has a user of its own, not a provider's")
    database.execute("DELETE FROM sessions WHERE expires_s <= ?", (begun_s,))
    same = [each for each in _of_user(database, user) if bool(each["label"]) == bool(wanted.label)]
    if len(same) >= SESSIONS_MOST and wanted.label:
        raise RefusedError(409, "tokens", f"you have {SESSIONS_MOST} tokens: end one of them first")
    for each in same[: len(same) - SESSIONS_MOST + 1] if len(same) >= SESSIONS_MOST else ():
        database.execute("DELETE FROM sessions WHERE hash = ?", (each["hash"],))
    database.execute(
        'INSERT INTO sessions (hash, "user", csrf, label, expires_s, scope, begun_s, seen_s, address, sid)'
        " VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
        (
            hash_secret(secret),
            user,
            secrets.token_urlsafe(24),
            wanted.label,
            begun_s + int(wanted.seconds),
            wanted.scope,
            begun_s,
            begun_s,
            wanted.address,
            wanted.sid,
        ),
    )
    done = ("token", f"{wanted.label}: {wanted.scope}") if wanted.label else ("login", wanted.how)
    audit(database, time.time_ns(), user, *done)
    return secret


def unstored(row: Row) -> tuple[str, Session]:
    """A session that only looks; it lives as long as somebody keeps it in mind."""
    groups = frozenset(row["groups"].split("\n")) - {""}
    return secrets.token_urlsafe(32), Session(row["name"], ROLES[0], secrets.token_urlsafe(24), "", groups)


def end(database: Database, secret: str) -> None:
    database.execute("DELETE FROM sessions WHERE hash = ?", (hash_secret(secret),))


def end_one(database: Database, user: str, id_: str, by: Session) -> None:
    by.still(database)
    for row in _of_user(database, user):
        if id_of(row["hash"]) == id_:
            database.execute("DELETE FROM sessions WHERE hash = ?", (row["hash"],))
            detail = f"{user}: {row['label']}" if row["label"] else user
            audit(
                database, time.time_ns(), by.user, "token ended" if row["label"] else "session ended", detail
            )
            return
    raise RefusedError(404, "unknown", "there is no such session or token, or it has ended")


def _least(role: str, wanted: str) -> bool:
    return ROLES.index(role) >= ROLES.index(wanted)


def _of_user(database: Database, user: str) -> list[Row]:
    """The oldest first."""
    sql = 'SELECT hash, label FROM sessions WHERE "user" = ? ORDER BY begun_s, expires_s'
    return [dict(row) for row in database.execute(sql, (user,))]


def seen(database: Database, when_s: dict[bytes, int]) -> None:
    """When each was used last."""
    for hashed, second in when_s.items():
        database.execute("UPDATE sessions SET seen_s = ? WHERE hash = ?", (second, hashed))


FIND = (
    'SELECT users.name AS "user", role, csrf, label, groups, scope, sessions.hash, seen_s, subject'
    ' FROM sessions JOIN users ON users.name = sessions."user"'
    " WHERE sessions.hash = ? AND expires_s > ? AND disabled = 0"
)
LIST_OF_SUBJECT = (
    'SELECT sessions.hash FROM sessions JOIN users ON users.name = sessions."user"'
    " WHERE subject = ? AND expires_s > ?"
)
LIST = (
    "SELECT hash, label, scope, begun_s, seen_s, expires_s, address FROM sessions"
    ' WHERE "user" = ? AND expires_s > ? ORDER BY begun_s DESC, hash'
)


def found(row: Row) -> Session:
    """What FIND has found. A token may no more than its user, and than its scope says."""
    role = min(row["role"], SCOPES[row["scope"]], key=ROLES.index)
    groups = frozenset(row["groups"].split("\n")) - {""}
    return Session(
        row["user"], role, row["csrf"], row["label"], groups, id_of(row["hash"]), bool(row["subject"])
    )


def find_values(secret: str) -> tuple[bytes, int]:
    """What FIND is asked with."""
    return hash_secret(secret), now_s()
