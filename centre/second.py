# SPDX-License-Identifier: GPL-3.0-or-later
"""A second factor: codes by time (RFC 6238), and recovery codes, each of which is good once."""

from __future__ import annotations

import hashlib
import hmac
import secrets
import time
from collections.abc import Callable

import pyotp

from openrtu_tools.centre.errors import RefusedError
from openrtu_tools.centre.store import Database, Row, audit
from openrtu_tools.centre.users import Session

STEP_S = 30
AROUND = 1  # steps that a telephone's clock may be off
RECOVERY, LETTERS = 10, 16  # so many codes; of 80 random bits, which need no slow hash
ISSUER = "OpenRTU"
WRONG = "the code is wrong, or was used already"


def new_secret() -> str:
    return pyotp.random_base32()


def uri(secret: str, user: str) -> str:
    """For the app that makes the codes."""
    return pyotp.TOTP(secret).provisioning_uri(name=user, issuer_name=ISSUER)


def step_of(secret: str, code: str, after: int, clock: Callable[[], float] = time.time) -> int:
    """The step that this code is of, if it is of one behind `after`; else 0. A code is good once.

    >>> secret, clock = "GEZDGNBVGY3TQOJQGEZDGNBVGY3TQOJQ", lambda: 59.0  # RFC 6238, appendix B
    >>> [step_of(secret, code, after, clock) for code, after in (("287082", 0), ("287082", 1), ("287083", 0))]
    [1, 0, 0]
    """
    now = int(clock()) // STEP_S
    for step in range(now - AROUND, now + AROUND + 1):
        right = pyotp.HOTP(secret).at(step)
        if step > after and hmac.compare_digest(right.encode(), code.encode()):
            return step
    return 0


def _plain(code: str) -> str:
    return code.replace("-", "").replace(" ", "").upper()


def _hash(code: str) -> str:
    return hashlib.sha256(_plain(code).encode()).hexdigest()


def is_recovery(code: str) -> bool:
    return len(_plain(code)) == LETTERS


def use(database: Database, row: Row, code: str) -> None:
    """Whether it is right and that it is used up are one transaction. Raises RefusedError."""
    user = row["name"]
    if is_recovery(code):
        left = row["recovery"].split()
        if _hash(code) not in left:
            raise RefusedError(401, "wrong_code", WRONG)
        left.remove(_hash(code))
        database.execute("UPDATE users SET recovery = ? WHERE name = ?", ("\n".join(left), user))
        audit(database, time.time_ns(), user, "recovery code", f"{len(left)} left")
        return
    step = step_of(row["totp"], code.strip(), row["totp_step"])
    if not step:
        raise RefusedError(401, "wrong_code", WRONG)
    database.execute("UPDATE users SET totp_step = ? WHERE name = ?", (step, user))


def begin(database: Database, session: Session, secret: str, code: str) -> list[str]:
    """From now on it is asked for. Recovery codes, which nobody can read again."""
    session.still(database)
    if database.execute("SELECT 1 FROM users WHERE name = ? AND totp <> ''", (session.user,)).fetchone():
        raise RefusedError(409, "second_factor", "you have a second factor already: end it first")
    step = step_of(secret, code.strip(), 0)
    if not step:
        raise RefusedError(401, "wrong_code", WRONG)
    letters = "ABCDEFGHIJKLMNOPQRSTUVWXYZ234567"
    codes = ["".join(secrets.choice(letters) for _ in range(LETTERS)) for _ in range(RECOVERY)]
    database.execute(
        "UPDATE users SET totp = ?, totp_step = ?, recovery = ? WHERE name = ?",
        (secret, step, "\n".join(map(_hash, codes)), session.user),
    )
    audit(database, time.time_ns(), session.user, "second factor", "on")
    return ["-".join(code[i : i + 4] for i in range(0, LETTERS, 4)) for code in codes]


def end(database: Database, user: str, by: str) -> None:
    """No code is asked for any more."""
    changed = database.execute(
        "UPDATE users SET totp = '', totp_step = 0, recovery = '' WHERE name = ? AND totp <> ''", (user,)
    )
    if not changed.rowcount:
        raise RefusedError(404, "unknown", f"{user} has no second factor")
    audit(database, time.time_ns(), by, "second factor", f"{user}: off")
