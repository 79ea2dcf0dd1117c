# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes the file of users of rtu-web: on the engineer's machine, so that no password ever lies on a gateway.

Adds a user to the file, or gives a new password and role to one that is there.
"""

import argparse
import base64
import getpass
import hashlib
import os
import secrets
import sys
from pathlib import Path
from urllib.parse import quote

from nuc980.errors import UnusableInput

ROLES = ("viewer", "operator", "engineer", "installer")
SHORTEST = 10  # characters of a password
# RFC 7914: 8 MiB for as long as a login takes, which a gateway with 64 MiB has.
N, R, P = 8192, 8, 1
SALT_OCTETS, HASH_OCTETS = 16, 32
SECRET_OCTETS = 20  # of a second factor: as long as SHA-1
SECRET = 8  # its word of a line
NAME_MOST = 32  # octets


class UsersError(UnusableInput):
    """What the engineer has to know: one line."""


def line_of(name: str, role: str, password: str, secret: str = "") -> str:
    """A line of the file: docs/web.md."""
    salt = secrets.token_bytes(SALT_OCTETS)
    digest = hashlib.scrypt(password.encode(), salt=salt, n=N, r=R, p=P, dklen=HASH_OCTETS)
    return f"{name} {role} scrypt {N} {R} {P} {salt.hex()} {digest.hex()} {secret}".rstrip()


def new_secret(name: str) -> str:
    """Prints it for the app that makes the codes (RFC 6238)."""
    secret = base64.b32encode(secrets.token_bytes(SECRET_OCTETS)).decode()
    print(f"otpauth://totp/OpenRTU:{quote(name)}?secret={secret}&issuer=OpenRTU")
    return secret


def ask_password(name: str) -> str:
    """From the terminal, twice; else a line of standard input."""
    if not sys.stdin.isatty():
        return sys.stdin.readline().rstrip("\n")
    password = getpass.getpass(f"password of {name}: ")
    if getpass.getpass("once more: ") != password:
        raise UsersError("the two are not the same")
    return password


def write(path: Path, lines: list[str]) -> None:
    """The whole file or none of it, for nobody else's eyes."""
    new = path.with_name(f".{path.name}.new")
    new.unlink(missing_ok=True)
    with os.fdopen(os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o400), "w") as file:
        file.write("".join(f"{line}\n" for line in lines))
    new.replace(path)


def run(parsed: argparse.Namespace) -> int:
    name, path = parsed.name, parsed.file
    try:
        lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    except UnicodeDecodeError as error:
        raise UsersError(f"{path}: this is not UTF-8 text") from error
    others = [line for line in lines if line.split()[:1] != [name]]
    before = next((line.split() for line in lines if line.split()[:1] == [name]), [])
    if not name or len(name.split()) != 1 or len(name.encode()) > NAME_MOST or name.startswith("#"):
        raise UsersError(f'"{name}": expected a name of one word, at most {NAME_MOST} octets')
    if parsed.remove:
        if others == lines:
            raise UsersError(f"{path} has no user {name}")
        write(path, others)
        return 0
    if parsed.role is None:
        raise UsersError(f"expected --role, one of {', '.join(ROLES)}")
    password = ask_password(name)
    if len(password) < SHORTEST:
        raise UsersError(f"too short: a password has at least {SHORTEST} characters")
    secret = new_secret(name) if parsed.second_factor else "".join(before[SECRET:])
    write(path, [*others, line_of(name, parsed.role, password, "" if parsed.no_second_factor else secret)])
    return 0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", type=Path, help="what the gateway gets as web.users")
    parser.add_argument("name", help="of the user, one word")
    parser.add_argument("--role", choices=ROLES)
    factor = parser.add_mutually_exclusive_group()
    factor.add_argument(
        "--second-factor", action="store_true", help="ask for a code, too, and print the secret for an app"
    )
    factor.add_argument("--no-second-factor", action="store_true", help="ask for no code any more")
    parser.add_argument("--remove", action="store_true", help="remove the user instead")
