# SPDX-License-Identifier: GPL-3.0-or-later
"""The centre's file: that of rtu-centre, and what the centre alone wants to know of each station."""

from __future__ import annotations

import csv
import io
import json
import subprocess
from dataclasses import dataclass, field
from ipaddress import ip_network
from pathlib import Path
from typing import Any

import jsonschema

from openrtu_tools.centre import zone
from openrtu_tools.centre.areas import Area
from openrtu_tools.centre.codes import Content
from openrtu_tools.centre.errors import CentreError
from openrtu_tools.centre.peers import Network
from openrtu_tools.centre.roles import ROLES
from openrtu_tools.programs import command

Json = dict[str, Any]


def says(text: str, rule: Json) -> Json:
    """A key with what docs/control-centre.md says of it: `make keys` writes the page's tables."""
    return {"description": text, **rule}


# Of a station; of a common address: its points, its time tags; of a point; of a vehicle and an area; of many
# stations at once.
ALARM_KINDS = ("lost", "quality", "clock", "high", "low", "state", "inside", "outside", "network")

# Of an alarm of a point: limits of a value, or the state that is one.
ALARM = {
    "type": "object",
    "additionalProperties": False,
    "properties": {
        "low": {"type": "number"},
        "high": {"type": "number"},
        "state": {"type": "integer"},
        "priority": {"type": "integer", "minimum": 1, "maximum": 3},
        "deadband": {"type": "number", "minimum": 0},
        "class": {"type": "string"},
    },
}
SECONDS = {"type": "number", "minimum": 0, "maximum": 86400}
ALARMS = {
    "type": "object",
    "additionalProperties": False,
    "properties": {
        "network_stations": {"type": "integer", "minimum": 0},
        "network_s": {"type": "number", "exclusiveMinimum": 0, "maximum": 3600},
        "classes": {
            "type": "object",
            "additionalProperties": {
                "type": "object",
                "additionalProperties": False,
                "properties": {
                    "on_s": SECONDS,
                    "off_s": SECONDS,
                    "deadband": {"type": "number", "minimum": 0},
                },
            },
        },
    },
}
STATION = {
    "location": says(
        "latitude and longitude of a station that stays where it is; a vehicle says its own place",
        {
            "type": "array",
            "prefixItems": [
                {"type": "number", "minimum": -90, "maximum": 90},
                {"type": "number", "minimum": -180, "maximum": 180},
            ],
            "minItems": 2,
            "maxItems": 2,
        },
    ),
    "group": says(
        "a word to find stations by; a [user](#users) and an area can be of groups",
        {"type": "string", "maxLength": 64},
    ),
    "points": says(
        "its list of points: a gateway's configuration (`.json`, read by `rtud --points`), or a "
        "table (`.csv`) with at least the columns `ca` and `ioa`. The columns are those of `rtud "
        "--points FILE --csv`, and `low`, `high`, `state`, `priority`, `deadband`, `class` of an "
        "alarm. Without a list, points are named by their addresses and take no commands",
        {"type": "string"},
    ),
    "release": says("a second person executes each command of this station", {"type": "boolean"}),
    "higher": says(
        "what of it [a higher centre](#a-higher-centre) sees: by common address, what is added to"
        " the addresses of its objects",
        {
            "type": "object",
            "additionalProperties": False,
            "patternProperties": {"^[0-9]{1,5}$": {"type": "integer", "minimum": 0, "maximum": 13_000_000}},
        },
    ),
    "higher_ca": says(
        "the common address by which that sees it [that of all]",
        {"type": "integer", "minimum": 1, "maximum": 65534},
    ),
    "alarms": says(
        "by a point's name: above `high`, below `low`, or in a `state`; `priority` 1 (highest) to"
        " 3 [2]; `deadband` and `class`: [below](#alarm-rules)",
        {"type": "object", "additionalProperties": ALARM},
    ),
}
PLACE = STATION["location"]
AREA = {
    "type": "object",
    "additionalProperties": False,
    "required": ["name"],
    "oneOf": [{"required": ["circle"]}, {"required": ["polygon"]}],
    "properties": {
        "name": {"type": "string", "minLength": 1, "maxLength": 64},
        "circle": {
            "type": "object",
            "additionalProperties": False,
            "required": ["middle", "radius_m"],
            "properties": {"middle": PLACE, "radius_m": {"type": "number", "exclusiveMinimum": 0}},
        },
        "polygon": {"type": "array", "items": PLACE, "minItems": 3, "maxItems": 1000},
        "alarm": {"enum": ["inside", "outside"]},
        "group": {"type": "string", "maxLength": 64},
        "priority": {"type": "integer", "minimum": 1, "maximum": 3},
    },
}
DAYS = {"type": "number", "exclusiveMinimum": 0}
KEEP = {
    "type": "object",
    "additionalProperties": False,
    "properties": {
        "events_days": DAYS,
        "tracks_days": DAYS,
        "alarms_days": DAYS,
        "audit_days": DAYS,
        "thin_m": {"type": "number", "exclusiveMinimum": 0},
        "thin_after_days": {"type": "number", "minimum": 0},
    },
}
TLS = {
    "type": "object",
    "additionalProperties": False,
    "required": ["certificate", "key"],
    "properties": {"certificate": {"type": "string"}, "key": {"type": "string"}},
}
MQTT = {
    "type": "object",
    "additionalProperties": False,
    "required": ["host"],
    "dependentRequired": {"user": ["password_file"], "password_file": ["user"]},
    "properties": {
        "host": says("the broker, MQTT 5", {"type": "string", "minLength": 1}),
        "port": says(
            "its TCP port [1883, with `tls` 8883]", {"type": "integer", "minimum": 1, "maximum": 65535}
        ),
        "prefix": says("before each topic", {"type": "string", "pattern": "^[^+#$][^+#]*[^+#/]$"}),
        "user": says("who the centre is", {"type": "string"}),
        "password_file": says(
            "a file whose first line is the password; nobody else may read it", {"type": "string"}
        ),
        "tls": says(
            "an object: TLS. `ca` a file [those of the system], `certificate` and `key` of the centre itself",
            {
                "type": "object",
                "additionalProperties": False,
                "dependentRequired": {"certificate": ["key"], "key": ["certificate"]},
                "properties": {key: {"type": "string"} for key in ("ca", "certificate", "key")},
            },
        ),
        "commands": says("takes commands from the bus", {"type": "boolean"}),
    },
}
PUSH = {
    "type": "object",
    "additionalProperties": False,
    "required": ["url"],
    "properties": {
        "url": {"type": "string", "pattern": "^https?://"},
        "period_s": {"type": "number", "minimum": 1},
        "token_file": {"type": "string"},
        "ca": {"type": "string"},
    },
}
ADDRESS = {"type": "string", "pattern": "^[^\\s@<>,;:]+@[^\\s@<>,;:]+$"}
NOTIFY = {
    "type": "object",
    "additionalProperties": False,
    "required": ["targets", "rules"],
    "properties": {
        "mail": says(
            "the server that takes mails, over TLS only: `host`, `port` [465, with `starttls` 587], "
            "`starttls` [false], `from`, `user`, `password_file`, `ca`",
            {
                "type": "object",
                "additionalProperties": False,
                "required": ["host", "from"],
                "dependentRequired": {"user": ["password_file"], "password_file": ["user"]},
                "properties": {
                    "host": {"type": "string", "minLength": 1},
                    "port": {"type": "integer", "minimum": 1, "maximum": 65535},
                    "starttls": {"type": "boolean"},
                    "from": ADDRESS,
                    "user": {"type": "string"},
                    "password_file": {"type": "string"},
                    "ca": {"type": "string"},
                },
            },
        ),
        "targets": says(
            "by name: a `mail` address, or a `webhook` (HTTPS) with `token_file` (`Authorization: "
            "Bearer`) and `ca` [those of the system]; `gone`: it is told, too, when an alarm of which"
            " it was told has gone [false]",
            {
                "type": "object",
                "additionalProperties": {
                    "type": "object",
                    "additionalProperties": False,
                    "oneOf": [{"required": ["mail"]}, {"required": ["webhook"]}],
                    "dependentRequired": {"token_file": ["webhook"], "ca": ["webhook"]},
                    "properties": {
                        "mail": ADDRESS,
                        "webhook": {"type": "string", "pattern": "^https://[^/@\\s]+(/\\S*)?$"},
                        "token_file": {"type": "string"},
                        "ca": {"type": "string"},
                        "gone": {"type": "boolean"},
                    },
                },
            },
        ),
        "rules": says(
            "`to`: names of targets. Of which alarms: of this `priority` or a higher one [3], of "
            "these `kinds` [all], of stations of this `group` [all]; a fault of the network is of "
            "all. `after_s`: nobody has acknowledged it so long after it came [0]",
            {
                "type": "array",
                "items": {
                    "type": "object",
                    "additionalProperties": False,
                    "required": ["to"],
                    "properties": {
                        "to": {"type": "array", "items": {"type": "string"}, "minItems": 1},
                        "priority": {"type": "integer", "minimum": 1, "maximum": 3},
                        "kinds": {"type": "array", "items": {"enum": list(ALARM_KINDS)}},
                        "group": {"type": "string"},
                        "after_s": {"type": "number", "minimum": 0},
                    },
                },
            },
        ),
    },
}
HIGHER = {
    "type": "object",
    "additionalProperties": False,
    "required": ["ca", "token_file"],
    "properties": {
        "ca": says(
            "the common address by which the city sees all",
            {"type": "integer", "minimum": 1, "maximum": 65534},
        ),
        "token_file": says(
            "what the module shows to this centre; its user alone may read the file", {"type": "string"}
        ),
        "url": says("where this centre is reached [here]", {"type": "string", "pattern": "^https?://"}),
        "tls_ca": says("the CA of its certificate [those of the system]", {"type": "string"}),
        "gateway": says(
            "all else of the gateway's [configuration](configuration.md): `iec104` with `address`, "
            "`port` and `tls`, `journal`, …",
            {"type": "object"},
        ),
    },
}
OIDC = {
    "type": "object",
    "additionalProperties": False,
    "required": ["issuer", "client_id", "url", "claim", "roles"],
    "properties": {
        # Without TLS on the machine itself alone: a code, a secret or a key can be read else, or exchanged.
        "issuer": says(
            "the provider, exactly as it calls itself: by https, or by http on this machine",
            {"type": "string", "pattern": "^(https://|http://(127.0.0.1|localhost)[:/])[^?#]+$"},
        ),
        "url": says(
            "the centre as browsers reach it. Register there `URL/api/oidc/callback`, and for back-"
            "channel logout `URL/api/oidc/logout`",
            {"type": "string", "pattern": "^(https://|http://(127.0.0.1|localhost)[:/])[^?#]+[^?#/]$"},
        ),
        "client_id": says("the centre's name there", {"type": "string", "minLength": 1}),
        "secret_file": says(
            "a file whose first line is its secret; nobody else may read it. Without a file it is a "
            "public client",
            {"type": "string"},
        ),
        "ca": says("who has signed its certificate [the system's]", {"type": "string"}),
        "label": says("what the page's button calls it", {"type": "string", "minLength": 1, "maxLength": 64}),
        "scope": says("what the provider is asked for", {"type": "string", "pattern": "^openid( |$)"}),
        "name": says(
            "the claim that names a user [`preferred_username`, else `sub`]",
            {"type": "string", "minLength": 1},
        ),
        "claim": says(
            "a claim of the ID token, a text or a list, of whose values `roles` speaks",
            {"type": "string", "minLength": 1},
        ),
        "session_h": says(
            "how long a login by it lasts, whatever its token says [that of `centre`]",
            {"type": "number", "exclusiveMinimum": 0},
        ),
        "userinfo": says(
            "claims that the ID token has not are asked for at the provider's userinfo end point",
            {"type": "boolean"},
        ),
        "logout": says(
            "*Log out* leads to the provider's own logout; register there `URL/` as where it leads back",
            {"type": "boolean"},
        ),
        "roles": says(
            "what the claim's values let a user do, in which groups of stations. The first one that "
            "fits counts. No value that fits: no entry. Nobody is an engineer whom the list does not "
            "make one",
            {
                "type": "array",
                "minItems": 1,
                "items": {
                    "type": "object",
                    "additionalProperties": False,
                    "required": ["value", "role"],
                    "properties": {
                        "value": {"type": "string", "minLength": 1},
                        "role": {"enum": list(ROLES)},
                        "groups": {"type": "array", "items": {"type": "string", "pattern": "^[^\n]+$"}},
                    },
                },
            },
        ),
    },
}
CENTRE = {
    "address": says("the address at which it serves", {"type": "string"}),
    "port": says("its TCP port", {"type": "integer", "minimum": 1, "maximum": 65535}),
    "database": says(
        "the file of SQLite, or the address of a [PostgreSQL](#postgresql) server: `postgresql://…`"
        " [`centre.db` beside the file]",
        {"type": "string"},
    ),
    "gap_s": says("a track is cut where nothing came for so long", {"type": "number", "exclusiveMinimum": 0}),
    "session_h": says("how long a login lasts", {"type": "number", "exclusiveMinimum": 0}),
    "secure": says(
        "browsers reach it by HTTPS only: the cookie says so [true with `tls`, else false]",
        {"type": "boolean"},
    ),
    "zone": says("the site's time zone, as `Europe/Belgrade` [the machine's]", {"type": "string"}),
    "proxies": says(
        "addresses and networks of reverse proxies before it: their `X-Forwarded-For` says who asks [none]",
        {"type": "array", "items": {"type": "string"}},
    ),
    "map": says(
        "a map of your own, below [`map.pmtiles` beside the file, when it is there]", {"type": "string"}
    ),
    "pictures": says(
        "the folder of [process pictures](process-pictures.md) [`pictures` beside the file, when "
        "it is there]",
        {"type": "string"},
    ),
    "tls": says(
        '`{"certificate": …, "key": …}`, files in PEM: it serves HTTPS by itself. A key that '
        "others may read is refused. A new pair is in force within seconds",
        TLS,
    ),
    "areas": says("areas of the map: below", {"type": "array", "items": AREA}),
    "alarms": says("classes of alarms, and when lost stations are one fault: [below](#alarm-rules)", ALARMS),
    "keep": says("how long what is stored is kept: below [for ever]", KEEP),
    "mqtt": says("a broker that is told what changes: [below](#mqtt)", MQTT),
    "higher": says("how [a higher centre](#a-higher-centre) sees this one", HIGHER),
    "push": says("a service that is told positions: [below](#positions-to-a-service)", PUSH),
    "oidc": says("a provider of OpenID Connect whose users come in: [below](#users-of-a-provider)", OIDC),
    "notify": says("who is told of alarms: [below](#notifications)", NOTIFY),
}
SCHEMA = {
    "type": "object",
    "required": ["stations"],
    "properties": {
        "socket": {"type": "string"},
        "shards": {"type": "integer", "minimum": 1, "maximum": 64},
        "stations": {
            "type": "array",
            "items": {
                "type": "object",
                "required": ["name"],
                "properties": {"name": {"type": "string"}, **STATION},
            },
        },
        "centre": {"type": "object", "additionalProperties": False, "properties": CENTRE},
    },
}
POSTGRESQL = ("postgresql://", "postgres://")
PMTILES = b"PMTiles\x03"  # how a file begins
TYPES = {"SC": "single", "DC": "double", "RC": "step", "BO": "bits"}
SET_POINTS = {
    "NA": "normalized",
    "TA": "normalized",
    "NB": "scaled",
    "TB": "scaled",
    "NC": "float",
    "TC": "float",
}
POSITIONS = ("private", "position")  # as rtud's list has it, or who writes one
CONTENTS = {
    "SP": Content.SINGLE, "DP": Content.DOUBLE, "ST": Content.STEP, "BO": Content.BITS, "IT": Content.TOTAL,
    "ME_NA": Content.NORMALIZED, "ME_ND": Content.NORMALIZED, "ME_NB": Content.SCALED, "ME_NC": Content.FLOAT,
}  # fmt: skip


@dataclass(frozen=True)
class Meaning:
    """What a list of points says of one."""

    name: str
    unit: str = ""
    device: str = ""
    content: Content | None = None
    command: str = ""  # a type of points; bits: a bitstring
    selects: bool = False
    readable: bool = True
    minimum: float | None = None
    maximum: float | None = None
    low: float | None = None
    high: float | None = None
    state: int | None = None
    priority: int = 2
    deadband: float | None = None  # None: its class says it
    alarm_class: str = ""  # of limits and a state; empty: each kind is a class


@dataclass(frozen=True)
class AlarmClass:
    """What must last, and how long, before an alarm comes or goes; and how far a value must come back."""

    on_s: float = 0.0
    off_s: float = 0.0
    deadband: float = 0.0


@dataclass(frozen=True)
class AlarmRules:
    """So many stations that are lost within a time are one fault of the network; 0: never."""

    classes: dict[str, AlarmClass] = field(default_factory=dict)
    network_stations: int = 10
    network_s: float = 60.0

    def of(self, kind: str, meaning: Meaning | None = None) -> AlarmClass:
        name = (meaning and meaning.alarm_class) or kind
        return self.classes.get(name, AlarmClass())

    def deadband(self, kind: str, meaning: Meaning) -> float:
        return self.of(kind, meaning).deadband if meaning.deadband is None else meaning.deadband


@dataclass(frozen=True)
class StationSettings:
    name: str
    location: tuple[float, float] | None = None
    group: str = ""
    points: dict[tuple[int, int], Meaning] = field(default_factory=dict)  # by common address and IOA
    release: bool = False  # a second person executes its commands
    higher: dict[int, int] = field(
        default_factory=dict
    )  # for a higher centre, by common address: added to an IOA
    higher_ca: int | None = None  # by which it sees this station; None: as all


@dataclass(frozen=True)
class Keep:
    """How long what is stored is kept; None: for ever. Tracks are thinned by distance when they are old."""

    events_days: float | None = None
    tracks_days: float | None = None
    alarms_days: float | None = None
    audit_days: float | None = None
    thin_m: float | None = None
    thin_after_days: float = 7.0


@dataclass(frozen=True)
class Tls:
    certificate: Path
    key: Path


@dataclass(frozen=True)
class ClientTls:
    """Of a client: without a CA those of the system count."""

    ca: Path | None = None
    certificate: Path | None = None
    key: Path | None = None


@dataclass(frozen=True)
class Mqtt:
    host: str
    port: int
    prefix: str = "openrtu"
    user: str = ""
    password_file: Path | None = None
    tls: ClientTls | None = None
    commands: bool = False

    def password(self) -> str:
        return _secret(self.password_file, "mqtt")


@dataclass(frozen=True)
class Push:
    """A service of the web that is told positions."""

    url: str
    period_s: float = 10.0
    token_file: Path | None = None
    ca: Path | None = None

    def token(self) -> str:
        return _secret(self.token_file, "push")


@dataclass(frozen=True)
class Mail:
    """A server that takes mails, over TLS only."""

    host: str
    port: int
    starttls: bool
    sender: str
    user: str = ""
    password_file: Path | None = None
    ca: Path | None = None

    def password(self) -> str:
        return _secret(self.password_file, "notify")


@dataclass(frozen=True)
class Target:
    """Who is told of alarms: an address of mail, or of the web."""

    mail: str = ""
    webhook: str = ""
    token_file: Path | None = None
    ca: Path | None = None
    gone: bool = False  # it is told of their end, too

    def token(self) -> str:
        return _secret(self.token_file, "notify")


@dataclass(frozen=True)
class NotifyRule:
    """Whom to tell of which alarms: that have this priority or a higher one, and that nobody has acknowledged
    so long after they came.
    """

    to: tuple[str, ...]
    priority: int = 3
    kinds: tuple[str, ...] = ()  # none: all
    group: str = ""  # empty: all
    after_s: float = 0.0


@dataclass(frozen=True)
class Notify:
    targets: dict[str, Target]
    rules: tuple[NotifyRule, ...]
    mail: Mail | None = None


def _secret(file: Path | None, whose: str) -> str:
    """A file's first line."""
    if not file:
        return ""
    try:
        if file.stat().st_mode & 0o077:
            raise CentreError(f"{whose}: {file}: others may read it: chmod 600")
        return file.read_text().partition("\n")[0]
    except OSError as error:
        raise CentreError(f"{whose}: {file}: {error.strerror}") from error


@dataclass(frozen=True)
class Granted:
    """What a value of the claim lets a user do."""

    value: str
    role: str
    groups: tuple[str, ...] = ()


@dataclass(frozen=True)
class Oidc:
    """A provider of users: OpenID Connect."""

    issuer: str
    client_id: str
    url: str  # by which browsers reach the centre
    claim: str
    roles: tuple[Granted, ...]  # the first one counts
    secret_file: Path | None = None
    ca: Path | None = None
    label: str = "OpenID Connect"
    scope: str = "openid profile"
    name: str = "preferred_username"
    session_h: float = 12.0
    userinfo: bool = False  # claims that the ID token has not are asked for there
    logout: bool = False  # who logs out here is sent to log out there

    def secret(self) -> str:
        return _secret(self.secret_file, "oidc")


@dataclass(frozen=True)
class Higher:
    """How a higher centre sees this one: centre/higher.py."""

    ca: int
    reached: Json  # how the gateway's module reaches us
    gateway: Json  # all else of the gateway's configuration


@dataclass(frozen=True)
class Settings:
    collector: Json  # rtu-centre's file
    socket: Path
    database: Path | str  # a file of SQLite; the address of a server of PostgreSQL
    address: str = "127.0.0.1"
    port: int = 8104
    gap_s: float = 120.0
    session_h: float = 12.0
    secure: bool = False
    stations: dict[str, StationSettings] = field(default_factory=dict)
    tls: Tls | None = None
    areas: tuple[Area, ...] = ()
    keep: Keep = field(default_factory=Keep)
    tiles: Path | None = None  # a map of one's own
    shards: int = 1
    mqtt: Mqtt | None = None
    higher: Higher | None = None
    push: Push | None = None
    proxies: tuple[Network, ...] = ()  # whose X-Forwarded-For is believed
    oidc: Oidc | None = None
    zone: str = "UTC"
    alarms: AlarmRules = field(default_factory=AlarmRules)
    notify: Notify | None = None
    pictures: Path | None = None  # the folder of process pictures

    @property
    def sockets(self) -> list[Path]:
        """Of rtu-centre's shards: docs/centre.md, "A shard a core"."""
        if self.shards == 1:
            return [self.socket]
        return [self.socket.with_name(f"{self.socket.name}.{shard}") for shard in range(self.shards)]

    def shard(self, place: int) -> int:
        """Whose station is at this place of the file."""
        return place % self.shards


def load(path: Path) -> Settings:
    """Reads the file. Raises CentreError with all its mistakes that rtu-centre does not see."""
    try:
        content = json.loads(path.read_text())
    except OSError as error:
        raise CentreError(f"{path}: {error.strerror}") from error
    except ValueError as error:
        raise CentreError(f"{path}: {error}") from error
    mistakes = [
        f"{path}: {'.'.join(map(str, each.absolute_path)) or 'the file'}: {each.message}"
        for each in jsonschema.Draft202012Validator(SCHEMA).iter_errors(content)
    ]
    if mistakes:
        raise CentreError("\n".join(mistakes))
    own = content.get("centre", {})
    collector = {key: value for key, value in content.items() if key != "centre"}
    collector["stations"] = [
        {key: value for key, value in station.items() if key not in STATION}
        for station in content["stations"]
    ]
    folder = path.resolve().parent
    alarms = _alarms(own.get("alarms", {}))
    database = own.get("database", "centre.db")
    return Settings(
        collector,
        folder / content.get("socket", "consumer"),
        database if database.startswith(POSTGRESQL) else folder / database,
        own.get("address", Settings.address),
        own.get("port", Settings.port),
        own.get("gap_s", Settings.gap_s),
        own.get("session_h", Settings.session_h),
        own.get("secure", "tls" in own),
        {station["name"]: _station(station, folder, alarms) for station in content["stations"]},
        Tls(folder / own["tls"]["certificate"], folder / own["tls"]["key"]) if "tls" in own else None,
        _areas(own.get("areas", [])),
        Keep(**own.get("keep", {})),
        _tiles(own.get("map"), folder),
        content.get("shards", Settings.shards),
        _mqtt(own["mqtt"], folder) if "mqtt" in own else None,
        _higher(own, folder) if "higher" in own else None,
        _push(own["push"], folder) if "push" in own else None,
        _proxies(own.get("proxies", [])),
        _oidc(own, folder) if "oidc" in own else None,
        zone.read(own.get("zone")),
        alarms,
        _notify(own["notify"], folder) if "notify" in own else None,
        _pictures(own.get("pictures"), folder),
    )


def _notify(wanted: Json, folder: Path) -> Notify:
    def files(keys: Json) -> Json:
        return {key: folder / text if key in ("ca", "token_file") else text for key, text in keys.items()}

    targets = {name: Target(**files(keys)) for name, keys in wanted["targets"].items()}
    rules = [
        NotifyRule(**{**rule, "to": tuple(rule["to"]), "kinds": tuple(rule.get("kinds", ()))})
        for rule in wanted["rules"]
    ]
    if unknown := {name for rule in rules for name in rule.to} - targets.keys():
        raise CentreError(f"notify: rules: there is no target {', '.join(sorted(unknown))}")
    mail = wanted.get("mail")
    if not mail and any(target.mail for target in targets.values()):
        raise CentreError("notify: a target is an address of mail: `mail` must say which server takes it")
    return Notify(targets, tuple(rules), _mail(mail, folder) if mail else None)


def _mail(wanted: Json, folder: Path) -> Mail:
    starttls = wanted.get("starttls", False)
    return Mail(
        wanted["host"],
        wanted.get("port", 587 if starttls else 465),
        starttls,
        wanted["from"],
        wanted.get("user", ""),
        folder / wanted["password_file"] if "password_file" in wanted else None,
        folder / wanted["ca"] if "ca" in wanted else None,
    )


def _alarms(wanted: Json) -> AlarmRules:
    classes = {name: AlarmClass(**keys) for name, keys in wanted.get("classes", {}).items()}
    return AlarmRules(**{**wanted, "classes": classes})


def _oidc(own: Json, folder: Path) -> Oidc:
    wanted = dict(own["oidc"])
    roles = [
        Granted(each["value"], each["role"], tuple(each.get("groups", ()))) for each in wanted.pop("roles")
    ]
    if any(each.groups and each.role == ROLES[-1] for each in roles):
        raise CentreError(f"oidc: the role {ROLES[-1]} sees all stations: give no groups")
    if wanted["url"].startswith("https://") and not own.get("secure", "tls" in own):
        raise CentreError("oidc: url begins with https://: say that it is `secure`, for the cookies")
    files = {key: folder / wanted.pop(key) for key in ("secret_file", "ca") if key in wanted}
    hours = wanted.pop("session_h", own.get("session_h", Settings.session_h))
    return Oidc(**wanted, **files, roles=tuple(roles), session_h=hours)


def _proxies(wanted: list[str]) -> tuple[Network, ...]:
    try:
        return tuple(ip_network(text) for text in wanted)
    except ValueError as error:
        raise CentreError(f"proxies: {error}: give addresses or networks, as 192.0.2.0/24") from error


def _push(wanted: Json, folder: Path) -> Push:
    files = {key: folder / wanted[key] for key in ("token_file", "ca") if key in wanted}
    return Push(wanted["url"], wanted.get("period_s", Push.period_s), **files)


def _higher(own: Json, folder: Path) -> Higher:
    wanted = own["higher"]
    address, port = own.get("address", Settings.address), own.get("port", Settings.port)
    reached = {
        "url": wanted.get("url", f"http{'s' if 'tls' in own else ''}://{address}:{port}"),
        "token_file": str(folder / wanted["token_file"]),
    }
    if "tls_ca" in wanted:
        reached["tls_ca"] = str(folder / wanted["tls_ca"])
    return Higher(wanted["ca"], reached, wanted.get("gateway", {}))


def _mqtt(wanted: Json, folder: Path) -> Mqtt:
    tls = wanted.get("tls")
    return Mqtt(
        wanted["host"],
        wanted.get("port", 1883 if tls is None else 8883),
        wanted.get("prefix", Mqtt.prefix),
        wanted.get("user", ""),
        folder / wanted["password_file"] if "password_file" in wanted else None,
        None if tls is None else ClientTls(**{key: folder / name for key, name in tls.items()}),
        wanted.get("commands", Mqtt.commands),
    )


def _tiles(wanted: str | None, folder: Path) -> Path | None:
    """What the file names must be there; map.pmtiles beside it is taken when it is."""
    path = folder / (wanted or "map.pmtiles")
    try:
        with path.open("rb") as file:
            begin = file.read(len(PMTILES))
    except OSError as error:
        if wanted:
            raise CentreError(f"map: {path}: {error.strerror}") from error
        return None
    if begin != PMTILES:
        raise CentreError(f"map: {path} is no PMTiles file of version 3: convert it with `pmtiles convert`")
    return path


def _pictures(wanted: str | None, folder: Path) -> Path | None:
    """What the file names must be there; the folder pictures beside it is taken when it is."""
    path = folder / (wanted or "pictures")
    if path.is_dir():
        return path
    if wanted:
        raise CentreError(f"pictures: {path} is no folder")
    return None


def _areas(wanted: list[Json]) -> tuple[Area, ...]:
    areas = []
    for each in wanted:
        circle = each.get("circle")
        corners = [circle["middle"]] if circle else each["polygon"]
        areas.append(
            Area(
                each["name"],
                tuple((float(latitude), float(longitude)) for latitude, longitude in corners),
                circle["radius_m"] if circle else 0.0,
                each.get("alarm", ""),
                each.get("group", ""),
                each.get("priority", 2),
            )
        )
    names = [area.name for area in areas]
    for name in names:
        if names.count(name) > 1:
            raise CentreError(f"areas: {name} is there twice: an alarm is of one area, by its name")
    return tuple(areas)


def _station(station: Json, folder: Path, rules: AlarmRules) -> StationSettings:
    points = read_points(folder / station["points"]) if "points" in station else {}
    alarms = station.get("alarms", {})
    unknown = set(alarms) - {meaning.name for meaning in points.values()}
    if unknown:
        raise CentreError(
            f"station {station['name']}: alarms: no point in its list is called {', '.join(sorted(unknown))}"
        )
    for key, meaning in points.items():
        if meaning.name in alarms:
            wanted = dict(alarms[meaning.name])
            wanted["alarm_class"] = wanted.pop("class", meaning.alarm_class)
            points[key] = Meaning(**{**vars(meaning), **wanted})
    for meaning in points.values():
        if meaning.alarm_class and meaning.alarm_class not in rules.classes:
            raise CentreError(
                f"station {station['name']}: alarms: {meaning.name}: class: there is no {meaning.alarm_class}"
                " in centre.alarms.classes"
            )
    location = tuple(station["location"]) if "location" in station else None
    return StationSettings(
        station["name"],
        location,
        station.get("group", ""),
        points,
        station.get("release", StationSettings.release),
        {int(ca): added for ca, added in station.get("higher", {}).items()},
        station.get("higher_ca"),
    )


def read_points(path: Path) -> dict[tuple[int, int], Meaning]:
    """A gateway's configuration (.json), or a list of points with at least the columns ca and ioa (.csv)."""
    try:
        text = _listed(path) if path.suffix == ".json" else path.read_text()
    except OSError as error:
        raise CentreError(f"{path}: {error.strerror}") from error
    rows = csv.DictReader(io.StringIO(text))
    if not {"ca", "ioa"} <= set(rows.fieldnames or ()):
        raise CentreError(f"{path}: a list of points needs the columns ca and ioa in its first line")
    points = {}
    for row in rows:
        try:
            points[int(row["ca"]), int(row["ioa"])] = _meaning(row)
        except (ValueError, KeyError, TypeError) as error:
            raise CentreError(f"{path}:{rows.line_num}: {error}") from error
    return points


def _listed(path: Path) -> str:
    lists = [*command("rtud", "rtud"), "--points", path, "--csv"]
    done = subprocess.run(lists, capture_output=True, text=True, check=False)
    if done.returncode:
        raise CentreError(f"{path}: rtud --points says: {done.stderr.strip()}")
    return done.stdout


def _meaning(row: dict[str, str]) -> Meaning:
    def number(key: str) -> float | None:
        return float(row[key]) if row.get(key) else None

    kind = row.get("type") or ""
    listed = Content.POSITION if kind in POSITIONS else CONTENTS.get(kind[2:4], CONTENTS.get(kind[2:7]))
    taken = (row.get("command_type") or "").split()  # a register that takes steps has two
    command = taken[0].split("_") if taken else []
    return Meaning(
        row.get("name") or f"{row['ca']}.{row['ioa']}",
        row.get("unit") or "",
        row.get("device") or "",
        listed,
        "" if len(command) != 4 else SET_POINTS[command[2]] if command[1] == "SE" else TYPES[command[1]],
        (row.get("select") or "") == "true",
        (row.get("direction") or "both") != "control",
        number("min"),
        number("max"),
        number("low"),
        number("high"),
        int(row["state"]) if row.get("state") else None,
        int(row.get("priority") or 2),
        number("deadband"),
        row.get("class") or "",
    )
