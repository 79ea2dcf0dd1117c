# SPDX-License-Identifier: GPL-3.0-or-later
"""Managers of SNMPv3 that others wrote: Net-SNMP's commands and its receiver of notifications."""

import contextlib
import json
import os
import re
import socket
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from lab.errors import LabError
from lab.patience import Deadline

ROOT = Path(__file__).resolve().parents[2]
MIB = ROOT / "package/openrtu/src/snmp/OPENRTU-MIB.txt"
BASE = "1.3.6.1.4.1.8072.9999.9999.104"
ENGINE = "80001f8805aabbccddeeff0011"
SINK_ENGINE = "80001f880512345678"

Value = int | bytes | str

_DEFINED = re.compile(
    r"^(\w+) (OBJECT-TYPE|OBJECT IDENTIFIER|NOTIFICATION-TYPE)\b.*?::= \{ (\w+) (\d+) \}",
    re.MULTILINE | re.DOTALL,
)
_RECORD = re.compile(r"^(\.[\d.]+) (.*?)(?=^\.[\d.]+ |\Z)", re.MULTILINE | re.DOTALL)
_REASON = re.compile(r"Reason: \(?(\w+)")


@cache
def names() -> dict[str, str]:
    """The objects and notifications of OPENRTU-MIB, with their OIDs."""
    found = {"openRtuMIB": BASE}
    for name, _, parent, number in _DEFINED.findall(MIB.read_text()):
        found[name] = f"{found[parent]}.{number}"
    return found


@cache
def columns() -> dict[str, str]:
    """What can be read, with its OID: columns and scalars, the latter with .0."""
    text = MIB.read_text()
    found = {}
    for name, access in re.findall(
        r"^(\w+) OBJECT-TYPE.*?MAX-ACCESS +([\w-]+)", text, re.MULTILINE | re.DOTALL
    ):
        if access != "not-accessible":
            found[name] = names()[name]
    return found


def oid(name: str) -> str:
    """Of "rtuCommandState.1010.1"; a number stays as it is."""
    head, _, index = name.partition(".")
    return f"{names()[head]}.{index}".rstrip(".") if head in names() else name


def named(number: str) -> str:
    """The reverse, as far as the MIB goes."""
    number = number.lstrip(".")
    fitting = [(value, key) for key, value in names().items() if f"{number}.".startswith(f"{value}.")]
    if not fitting:
        return number
    value, key = max(fitting)
    return f"{key}{number[len(value) :]}"


def value_of(text: str) -> Value:
    """A value as Net-SNMP prints it with -Oqx."""
    text = text.strip()
    if text.startswith('"'):
        return bytes.fromhex(text.strip('"').replace("\n", " "))
    return int(text) if re.fullmatch(r"-?\d+", text) else text


def free_udp_port() -> int:
    """Of 127.0.0.1, that nobody has now."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class Refused(Exception):
    """The agent answered with this error."""


class Silent(Exception):
    """The agent did not answer."""


@dataclass(frozen=True)
class User:
    name: str
    authentication: str
    encryption: str


WATCH = User("watch", "watch-authentic", "watch-encrypted")
CENTRE = User("centre", "centre-authentic", "centre-encrypted")
ENGINEER = User("engineer", "engineer-authentic", "engineer-encrypted")
USERS = {WATCH: "viewer", CENTRE: "operator", ENGINEER: "engineer"}


@dataclass
class Manager:
    """Net-SNMP's commands for one user of one agent."""

    port: int
    folder: Path
    user: User = CENTRE
    level: str = "authPriv"
    timeout_s: int = 5

    def run(self, program: str, *arguments: str, version: str = "3") -> str:
        """What a command prints. Raises Refused or Silent."""
        security = ["-v3", "-l", self.level, "-u", self.user.name]
        security += ["-a", "SHA-256", "-A", self.user.authentication]
        security += ["-x", "AES", "-X", self.user.encryption]
        if version != "3":
            security = ["-v", version, "-c", "public"]
        command = [program, *security, "-m", "", "-Onqx", "-r", "0", "-t", str(self.timeout_s)]
        command += [f"127.0.0.1:{self.port}", *arguments]
        result = subprocess.run(command, env=environment(self.folder), capture_output=True, text=True)
        if found := _REASON.search(result.stderr + result.stdout):
            raise Refused(found[1])
        if result.returncode:
            raise Silent(result.stderr)
        return result.stdout

    def rows(self, program: str, *arguments: str) -> dict[str, Value]:
        """Instances by name."""
        found = _RECORD.findall(self.run(program, *arguments))
        return {named(number): value_of(text) for number, text in found}

    def get(self, *wanted: str) -> list[Value]:
        return list(self.rows("snmpget", *map(oid, wanted)).values())

    def walk(self, name: str) -> dict[str, Value]:
        """A column's instances, by index."""
        rows = self.rows("snmpbulkwalk", "-Cr40", oid(name))
        return {key.removeprefix(f"{name}."): value for key, value in rows.items()}

    def set(self, values: Mapping[str, int | bytes | tuple[str, int]]) -> None:
        """A pair is Net-SNMP's letter of another type, and the value."""
        words = []
        for name, value in values.items():
            letter, number = value if isinstance(value, tuple) else ("i", value)
            text = ["x", number.hex()] if isinstance(number, bytes) else [letter, str(number)]
            words += [oid(name), *text]
        self.run("snmpset", *words)

    # ---- commands

    def spin(self, row: str) -> int:
        (spin,) = self.get(f"rtuCommandSpinLock.{row}")
        assert isinstance(spin, int)
        return spin

    def wish(self, row: str, state: int, spin: int | None = None, **more: int | bytes) -> None:
        """Sets a command's state with its spin lock, as a manager must."""
        values: dict[str, int | bytes] = {
            f"rtuCommandSpinLock.{row}": self.spin(row) if spin is None else spin,
            f"rtuCommandState.{row}": state,
        }
        self.set(values | {f"rtuCommand{key.capitalize()}.{row}": value for key, value in more.items()})

    def state(self, row: str) -> int:
        (state,) = self.get(f"rtuCommandState.{row}")
        assert isinstance(state, int)
        return state


def environment(folder: Path) -> dict[str, str]:
    """Nothing of this machine's own Net-SNMP."""
    return {**os.environ, "SNMPCONFPATH": str(folder), "SNMP_PERSISTENT_DIR": str(folder), "MIBS": ""}


def make_keys(config: dict[str, Any], folder: Path) -> None:
    """As the engineer does, for a configuration with one sink."""
    (folder / "gateway.json").write_text(json.dumps(config))
    lines = [f"{user.name} {user.authentication} {user.encryption}" for user in USERS]
    (folder / "passphrases").write_text("\n".join(lines))
    command = [
        ROOT / "scripts/openrtu",
        "snmp-keys",
        folder / "gateway.json",
        folder / "keys",
    ]
    command += ["--engine-id", ENGINE, "--passphrases", folder / "passphrases"]
    command += ["--sink", f"{config['snmp']['sinks'][0]['name']}={SINK_ENGINE}"]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


# ---- notifications -------------------------------------------------------------------------------


@dataclass
class Notification:
    name: str
    objects: dict[str, Value] = field(default_factory=dict)

    @property
    def numbers(self) -> list[int]:
        """Of the events that it tells."""
        return [int(key.partition(".")[2]) for key in self.objects if key.startswith("rtuEventKind.")]

    def value(self, column: str) -> Value:
        """Of the only instance of a column."""
        (value,) = (value for key, value in self.objects.items() if key.partition(".")[0] == column)
        return value


@dataclass
class Receiver:
    """snmptrapd, and what it has received so far."""

    port: int
    log: Path
    command: list[str]
    environment: dict[str, str]
    process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        with self.log.open("ab") as output:
            self.process = subprocess.Popen(self.command, env=self.environment, stdout=output, stderr=output)

    def stop(self) -> None:
        """It confirms nothing any more."""
        assert self.process is not None
        self.process.kill()
        self.process.wait()

    def notifications(self) -> list[Notification]:
        found = []
        for line in self.log.read_text().splitlines():
            if not line.startswith(".1.3.6.1.2.1.1.3.0 "):
                continue
            fields = [each.partition(" ") for each in line.split("\t") if each]
            kind = named(fields[1][2].strip())
            found.append(Notification(kind, {named(n): value_of(text) for n, _, text in fields[2:]}))
        return found

    def numbers(self) -> list[int]:
        return [number for each in self.notifications() for number in each.numbers]

    def wait_for(self, name: str, count: int = 1, after: int = 0) -> list[Notification]:
        """That many of this kind with numbers behind after."""
        return self._wait(name, count, lambda each: (each.numbers or [0])[0] > after)

    def wait_until(self, name: str, wanted: Callable[[Notification], bool]) -> Notification:
        """The first one of this kind that is wanted."""
        return self._wait(name, 1, wanted)[0]

    def _wait(self, name: str, count: int, wanted: Callable[[Notification], bool]) -> list[Notification]:
        deadline = Deadline(20)
        while True:
            fitting = [each for each in self.notifications() if each.name == name and wanted(each)]
            if len(fitting) >= count:
                return fitting
            if deadline.over:
                raise LabError(f"{len(fitting)} of {count} {name}", late=True)
            time.sleep(0.02)


@contextlib.contextmanager
def receiver(port: int, folder: Path) -> Iterator[Receiver]:
    """snmptrapd listens at the port; what it says goes behind what it has said in this folder."""
    folder.mkdir(exist_ok=True)
    lines = [
        f"createUser -e 0x{SINK_ENGINE} {CENTRE.name} "
        f"SHA-256 {CENTRE.authentication} AES {CENTRE.encryption}",
        f"authUser log {CENTRE.name} priv",
        f"exactEngineID 0x{SINK_ENGINE}",
    ]
    (folder / "receiver.conf").write_text("\n".join(lines) + "\n")
    log = folder / "received"
    command = ["snmptrapd", "-C", "-c", str(folder / "receiver.conf"), "-f", "-Lo", "-n", "-m", ""]
    command += ["-Onqx", "-F", "%v\n", f"udp:127.0.0.1:{port}"]
    received = Receiver(port, log, command, environment(folder))
    received.start()
    try:
        yield received
    finally:
        received.stop()
