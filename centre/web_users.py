# SPDX-License-Identifier: GPL-3.0-or-later
"""The centre's users as a gateway's page has them: package/openrtu/src/web/users.h, docs/web.md."""

from __future__ import annotations

from openrtu_tools.centre.errors import CentreError
from openrtu_tools.centre.settings import Settings
from openrtu_tools.centre.store import Database, Row
from openrtu_tools.centre.users import SCRYPT
from openrtu_tools.web_users import HASH_OCTETS, NAME_MOST


def users_of(database: Database, what: Settings, station: str) -> tuple[list[str], list[str]]:
    """Lines of its file, and who is left out with the reason. Hashes alone: nobody needs a new password."""
    if station not in what.stations:
        raise CentreError(f"there is no station {station}")
    group = what.stations[station].group
    lines, left_out = [], []
    for row in map(dict, database.execute("SELECT * FROM users ORDER BY name")):
        reason = _unfit(row, group)
        if reason:
            left_out.append(f"{row['name']}: {reason}")
        else:
            lines.append(_line(row))
    return lines, left_out


def _unfit(row: Row, group: str) -> str:
    """ "" if it fits."""
    name = row["name"]
    if row["subject"]:
        return "a provider's user has no password"
    if row["disabled"]:
        return "disabled"
    if row["groups"] and group not in row["groups"].split("\n"):
        return "does not see this station"
    if len(name.split()) != 1 or len(name.encode()) > NAME_MOST or name.startswith("#"):
        return f"a name there is one word, of at most {NAME_MOST} octets"
    return ""


def _line(row: Row) -> str:
    """Of the hash the first octets: what scrypt makes of one length begins what it makes of a longer one."""
    digest = bytes(row["hash"])[:HASH_OCTETS].hex()
    words = [
        row["name"],
        row["role"],
        "scrypt",
        *SCRYPT.values(),
        bytes(row["salt"]).hex(),
        digest,
        row["totp"],
    ]
    return " ".join(map(str, words)).rstrip()
