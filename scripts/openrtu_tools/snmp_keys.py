# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes the keys of rtu-snmp: on the engineer's machine, so that no pass phrase ever comes to a gateway.

The pass phrases come from a file of lines "NAME AUTHENTICATION ENCRYPTION", or are asked for. What is
written holds keys that are localized to one engine (RFC 3414, 2.6): of one gateway, or of one sink.
"""

import argparse
import hashlib
import os
import secrets
from dataclasses import dataclass
from pathlib import Path

from nuc980.asked import secret
from nuc980.errors import UnusableInput
from openrtu_tools import document
from openrtu_tools.document import Json

MEBIOCTET = 1 << 20
NO_TERMINAL = "write them into a file: --passphrases FILE"
SHORTEST = 8  # characters of a pass phrase: RFC 3414, 11.2
PRIVATE_ENTERPRISE = 8072  # Net-SNMP's: random engine IDs of its format 5 (RFC 3411, SnmpEngineID)
AUTHENTICATIONS = {"SHA-256": "sha256", "SHA-384": "sha384", "SHA-512": "sha512"}
ENCRYPTIONS = {"AES-128": 16, "AES-192": 24, "AES-256": 32}


class KeysError(UnusableInput):
    """What the engineer has to know: one line."""


@dataclass
class Passphrases:
    """Of one user."""

    authentication: str
    encryption: str


def localized(passphrase: str, engine: bytes, algorithm: str) -> bytes:
    """The key of RFC 3414, A.2, with the hash of RFC 7860.

    >>> localized("maplesyrup", bytes.fromhex("000000000000000000000002"), "sha1").hex()
    '6695febc9288e36282235fc7151f128497b38f3f'
    """
    octets = passphrase.encode()
    stretched = (octets * (MEBIOCTET // len(octets) + 1))[:MEBIOCTET]
    key = hashlib.new(algorithm, stretched).digest()
    return hashlib.new(algorithm, key + engine + key).digest()


def extended(key: bytes, engine: bytes, size: int, algorithm: str) -> bytes:
    """A key of at least so many octets, as Net-SNMP and others do it (draft-blumenthal-aes-usm-04)."""
    while len(key) < size:
        key += hashlib.new(algorithm, key).digest()
    return key[:size]


def keys_of(passphrases: Passphrases, engine: bytes, arguments: argparse.Namespace) -> str:
    """A record's last four words."""
    algorithm = AUTHENTICATIONS[arguments.authentication]
    size = ENCRYPTIONS[arguments.encryption]
    auth = localized(passphrases.authentication, engine, algorithm)
    priv = extended(localized(passphrases.encryption, engine, algorithm), engine, size, algorithm)
    return f"{arguments.authentication} {auth.hex()} {arguments.encryption} {priv.hex()}"


def new_engine_id() -> bytes:
    """A random one: an engine ID must be no other gateway's."""
    return (PRIVATE_ENTERPRISE | 0x80000000).to_bytes(4, "big") + b"\x05" + secrets.token_bytes(8)


def read_passphrases(path: Path) -> dict[str, Passphrases]:
    """A file of lines with three words."""
    found = {}
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except UnicodeDecodeError as error:
        raise KeysError(f"{path}: this is not UTF-8 text") from error
    for number, line in enumerate(lines, 1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        if len(words) != 3:
            raise KeysError(f"{path}:{number}: expected NAME AUTHENTICATION ENCRYPTION")
        found[words[0]] = Passphrases(*words[1:])
    return found


def asked(user: str, purpose: str) -> str:
    """Twice, as nobody sees what is typed: a slip would lock the user out of the gateway."""
    first = secret(f"{user}: pass phrase of {purpose}: ", NO_TERMINAL)
    if secret(f"{user}: the same once more: ", NO_TERMINAL) != first:
        raise KeysError(f"{user}: the two pass phrases of {purpose} differ; nothing is written")
    return first


def passphrases_of(user: str, known: dict[str, Passphrases]) -> Passphrases:
    """From the file, or else from the terminal."""
    if user not in known:
        known[user] = Passphrases(asked(user, "authentication"), asked(user, "encryption"))
    if min(len(known[user].authentication), len(known[user].encryption)) < SHORTEST:
        raise KeysError(f"{user}: a pass phrase has fewer than {SHORTEST} characters")
    return known[user]


def lines_of(snmp: Json, arguments: argparse.Namespace) -> list[str]:
    """The file of keys for a configuration's object "snmp"."""
    known = read_passphrases(arguments.passphrases) if arguments.passphrases else {}
    engine = arguments.engine_id or new_engine_id()
    engines = dict(arguments.sink)
    where = f"{arguments.configuration}: snmp."
    lines = [f"engine {engine.hex()}"]
    for number, user in enumerate(document.objects(snmp, "users", where)):
        name = document.text(user, "name", f"{where}users[{number}].")
        lines.append(f"user {name} {keys_of(passphrases_of(name, known), engine, arguments)}")
    for number, sink in enumerate(document.objects(snmp, "sinks", where)):
        if sink.get("kind", "inform") == "trap":
            continue
        name, user = (document.text(sink, key, f"{where}sinks[{number}].") for key in ("name", "user"))
        if name not in engines:
            raise KeysError(f"the engine ID of the sink {name} is missing: --sink {name}=ID")
        keys = keys_of(passphrases_of(user, known), engines[name], arguments)
        lines.append(f"sink {name} {engines[name].hex()} {keys}")
    return lines


def write(path: Path, lines: list[str]) -> None:
    """Readable by its owner alone, from its first octet on."""
    path.unlink(missing_ok=True)
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o400), "w") as file:
        file.write("\n".join(lines) + "\n")


def engine_id(text: str) -> bytes:
    """Of the command line, in hexadecimal (RFC 3411, SnmpEngineID)."""
    try:
        octets = bytes.fromhex(text)
    except ValueError:
        octets = b""
    if not 5 <= len(octets) <= 32 or set(octets) in ({0}, {0xFF}):
        raise argparse.ArgumentTypeError(
            f'"{text}" is no engine ID, 5 to 32 octets in hexadecimal, not all 00 or ff'
        )
    return octets


def sink_engine(text: str) -> tuple[str, bytes]:
    name, equals, engine = text.partition("=")
    if not name or not equals:
        raise argparse.ArgumentTypeError(f'"{text}" is not NAME=ID')
    return name, engine_id(engine)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("configuration", type=Path, help='a file of the gateway with the object "snmp"')
    parser.add_argument("keys", type=Path, help="the file to write")
    parser.add_argument(
        "--engine-id",
        type=engine_id,
        metavar="ID",
        help="of the gateway, one that it has had [random]",
    )
    parser.add_argument(
        "--passphrases", type=Path, help="a file with NAME AUTHENTICATION ENCRYPTION in each line"
    )
    parser.add_argument(
        "--sink", type=sink_engine, metavar="NAME=ID", action="append", default=[], help="a sink's engine ID"
    )
    parser.add_argument("--authentication", choices=AUTHENTICATIONS, default="SHA-256")
    parser.add_argument("--encryption", choices=ENCRYPTIONS, default="AES-128")


def run(parsed: argparse.Namespace) -> int:
    snmp = document.read(parsed.configuration).get("snmp")
    if not isinstance(snmp, dict):
        raise KeysError(f'{parsed.configuration} has no object "snmp"')
    lines = lines_of(snmp, parsed)
    write(parsed.keys, lines)
    print(f"the engine ID of the gateway is {lines[0].split()[1]}; {parsed.keys} goes to the gateway")
    return 0
