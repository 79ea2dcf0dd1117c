# SPDX-License-Identifier: GPL-3.0-or-later
"""Users, and what each may do with the own account: password, sessions, tokens."""

from __future__ import annotations

from functools import partial

from openrtu_tools.centre import second, users
from openrtu_tools.centre.errors import RefusedError
from openrtu_tools.centre.roles import ROLES, SCOPES
from openrtu_tools.centre.store import Database
from openrtu_tools.centre.web import Asked, Route
from openrtu_tools.centre.wire import Json, described

DAY_S = 86400.0
TOKEN_DAYS_MOST = 366


async def all_users(asked: Asked) -> list[Json]:
    sql = "SELECT name, role, groups, disabled, totp, subject FROM users ORDER BY name"
    return [
        {
            "name": row["name"],
            "role": row["role"],
            "groups": row["groups"].split("\n") if row["groups"] else [],
            "disabled": bool(row["disabled"]),
            "second_factor": bool(row["totp"]),
            "provided": bool(row["subject"]),
        }
        for row in await asked.centre.store.read(sql)
    ]


async def put_user(asked: Asked) -> Json:
    """Whoever manages users stays one: so there is always one."""
    body, by = asked.body, asked.session.user
    name, role, disabled = body["name"], body["role"], body.get("disabled", False)
    if name == by and (disabled or role != ROLES[-1]):
        raise RefusedError(409, "yourself", "another engineer must take your role")
    password, groups = body.get("password"), body.get("groups", [])

    def put(database: Database) -> None:
        asked.session.still(database)
        users.put(database, name, role, password, by, groups, disabled)

    await asked.centre.store.write(put)
    return {}


async def remove_user(asked: Asked) -> Json:
    name, by = asked.path["name"], asked.session.user
    if name == by:
        raise RefusedError(409, "yourself", "another engineer must remove you")

    def remove(database: Database) -> None:
        """Of two who remove each other one stays."""
        asked.session.still(database)
        users.remove(database, name, by)

    await asked.centre.store.write(remove)
    return {}


def _own_password(asked: Asked) -> None:
    """What belongs to a password has no user of a provider."""
    if asked.session.provided:
        raise RefusedError(409, "provided", "your provider keeps your password and second factor")


async def change_password(asked: Asked) -> Json:
    _own_password(asked)
    salt, hashed = await asked.login.own.do(partial(users.fresh, asked.body["password"]))
    await asked.centre.store.write(
        lambda database: users.change_password(database, asked.session, salt, hashed)
    )
    return {}


async def sessions(asked: Asked) -> list[Json]:
    """The newest first; a token has a label."""
    rows = await asked.centre.store.read(users.LIST, _whose(asked), users.now_s())
    return [
        {
            "id": users.id_of(row["hash"]),
            "label": row["label"],
            "scope": row["scope"] if row["label"] else "",
            "begun": row["begun_s"] * 1000,
            "seen": row["seen_s"] * 1000,
            "expires": row["expires_s"] * 1000,
            "address": row["address"],
            "own": users.id_of(row["hash"]) == asked.session.id,
        }
        for row in rows
    ]


async def end_session(asked: Asked) -> Json:
    """One that is gone meanwhile is a refusal: whoever ends it wants to know."""
    user = _whose(asked)
    await asked.centre.store.write(
        lambda database: users.end_one(database, user, asked.path["id"], asked.session)
    )
    return {}


def _whose(asked: Asked) -> str:
    user = asked.query.get("user", asked.session.user)
    if user != asked.session.user and not asked.session.may(ROLES[-1]):
        raise RefusedError(403, "role", f"this needs the role {ROLES[-1]}")
    return user


async def token(asked: Asked) -> Json:
    body = asked.body
    if not asked.session.may(SCOPES[body["scope"]]):
        raise RefusedError(403, "role", f"this needs the role {SCOPES[body['scope']]}")
    wanted = users.Wanted(body["days"] * DAY_S, asked.address, body["label"], body["scope"])

    def begin(database: Database) -> str:
        asked.session.still(database)
        return users.begin(database, asked.session.user, wanted)

    return {"token": await asked.centre.store.write(begin)}


async def second_factor(asked: Asked) -> Json:
    [row] = await asked.centre.store.read(
        "SELECT totp, recovery FROM users WHERE name = ?", asked.session.user
    )
    return {"on": bool(row["totp"]), "recovery_codes": len(row["recovery"].split())}


async def offer_second_factor(asked: Asked) -> Json:
    _own_password(asked)
    secret = asked.login.offer(asked.session)
    return {"secret": secret, "uri": second.uri(secret, asked.session.user)}


async def begin_second_factor(asked: Asked) -> Json:
    secret, code = asked.login.offered(asked.session), asked.body["code"]
    codes = await asked.login.confirm_code(
        asked.session, lambda database: second.begin(database, asked.session, secret, code)
    )
    return {"recovery_codes": codes}


async def end_second_factor(asked: Asked) -> Json:
    """With the password and a code: a session that was left open does not do it."""
    user = asked.session.user

    def end(database: Database) -> None:
        asked.session.still(database)
        row = users.row_of(database, user)
        assert row
        if row["totp"]:
            second.use(database, row, asked.body["code"])
        second.end(database, user, user)

    await asked.login.confirm_code(asked.session, end)
    return {}


async def drop_second_factor(asked: Asked) -> Json:
    """Of somebody who has lost it."""
    name, by = asked.path["name"], asked.session.user
    if name == by:
        raise RefusedError(409, "yourself", "another engineer must do that")

    def drop(database: Database) -> None:
        asked.session.still(database)
        second.end(database, name, by)

    await asked.centre.store.write(drop)
    return {}


NAME = {"type": "string", "minLength": 1, "maxLength": users.NAME_MOST}
PASSWORD = {"type": "string", "maxLength": 256}
CODE = {"type": "string", "maxLength": 32}
OF_USER: dict[str, Json] = {"user": {"type": "string", "description": "whose; of others an engineer asks"}}

ROUTES = [
    Route("GET", "/api/users", "engineer", "all users", all_users),
    Route("POST", "/api/users", "engineer", "add a user, or change one, who may keep the password", put_user,
          confirms=True,
          body=described(["name", "role", "own_password"], name=NAME, role={"enum": list(ROLES)},
                         password=PASSWORD, own_password=PASSWORD, disabled={"type": "boolean"},
                         groups={"type": "array", "items": {"type": "string", "maxLength": 64}})),
    Route("POST", "/api/users/{name}/remove", "engineer", "remove a user", remove_user, confirms=True,
          body=described(["own_password"], own_password=PASSWORD)),
    Route("POST", "/api/password", "viewer", "another password of one's own; ends all else that one has open",
          change_password, confirms=True, token=False,
          body=described(["password", "own_password"], password=PASSWORD, own_password=PASSWORD)),
    Route("POST", "/api/users/{name}/second_factor/end", "engineer", "ask a user for no second factor again",
          drop_second_factor, confirms=True, body=described(["own_password"], own_password=PASSWORD)),
    Route("GET", "/api/second_factor", "viewer", "whether one has a second factor", second_factor,
          token=False),
    Route("POST", "/api/second_factor/offer", "viewer", "a secret for an app that makes codes",
          offer_second_factor, confirms=True, token=False,
          body=described(["own_password"], own_password=PASSWORD)),
    Route("POST", "/api/second_factor/begin", "viewer", "ask for codes of the secret that was offered last",
          begin_second_factor, token=False, body=described(["code"], code=CODE)),
    Route("POST", "/api/second_factor/end", "viewer", "ask for no code any more", end_second_factor,
          confirms=True, token=False,
          body=described(["own_password", "code"], own_password=PASSWORD, code=CODE)),
    Route("GET", "/api/sessions", "viewer", "one's sessions and tokens", sessions, OF_USER, token=False),
    Route("POST", "/api/sessions/{id}/end", "viewer", "end a session or a token", end_session, OF_USER,
          token=False),
    Route("POST", "/api/tokens", "viewer", "a token of one's own, for a program", token,
          confirms=True, token=False,
          body=described(["label", "days", "scope", "own_password"], label=NAME,
                         days={"type": "number", "exclusiveMinimum": 0, "maximum": TOKEN_DAYS_MOST},
                         scope={"enum": list(SCOPES)}, own_password=PASSWORD)),
]  # fmt: skip
