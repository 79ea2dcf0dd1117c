# SPDX-License-Identifier: GPL-3.0-or-later
"""A gateway with its SNMP agent, and the managers that ask it."""

import asyncio
import contextlib
import socket
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pysnmp.hlapi.v3arch.asyncio import (
    USM_AUTH_HMAC192_SHA256,
    USM_PRIV_CFB128_AES,
    ContextData,
    ObjectIdentity,
    ObjectType,
    SnmpEngine,
    UdpTransportTarget,
    UsmUserData,
    bulk_cmd,
    get_cmd,
    set_cmd,
)
from pysnmp.proto.rfc1902 import Integer32, Null, ObjectName

from lab.gateway import remove, run_directory
from lab.manager import (
    CENTRE,
    ENGINEER,
    USERS,
    Manager,
    Receiver,
    Refused,
    User,
    free_udp_port,
    make_keys,
    oid,
    receiver,
)
from rig.desk import Desk, chapter_5, desk_of, of_port, patience

BREAKER, LAMP = "1010.1", "1010.101"  # a double point with selection; a single one without
OFF, ON = 2, 3  # of a double point
(
    INACTIVE,
    SELECT,
    ACCEPTED,
    REFUSED_SELECTION,
    INTERRUPT,
    INTERRUPTED,
    EXECUTE,
    EXECUTING,
    REFUSED,
    EXECUTED,
) = range(1, 11)
DONE, NOT_SELECTED, UNKNOWN_FATE = 2, 6, 10  # of a command
COMMAND, CYCLIC = 5, 9  # of rtuEventKind
INCONSISTENT = 12  # of RFC 3416's errors
NO_BITS = b"\0"
METER_POWER, POWER_FACTOR = "2020.30015", "2020.30007"
PERIOD_MS = 400
METER, FIRST, AT_ONCE = "4.40", 100, 20  # registers that change together
SERIAL = 500  # of it, a text
SINK_TIMEOUT_S = 0.5


@dataclass
class Site:
    """A gateway with its devices, a controlling station, managers and a receiver of notifications."""

    desk: Desk
    folder: Path
    port: int
    received: Receiver

    def manager(self, user: User = CENTRE, level: str = "authPriv", timeout_s: int = 5) -> Manager:
        return Manager(self.port, self.folder, user, level, timeout_s)

    def last(self) -> int:
        (number,) = self.manager().get("rtuEventLast.0")
        assert isinstance(number, int)
        return number

    def states_told(self, after: int, count: int) -> list[int]:
        """The states of a command that were told by notifications behind this number."""
        told = self.received.wait_for("rtuCommandChanged", count, after)
        return [int(each.value("rtuCommandState")) for each in told]

    def wait_state(self, row: str, state: int) -> None:
        manager = self.manager()
        self.desk.gateway.wait_for(lambda: manager.state(row) == state, 60.0, f"{row} has the state {state}")

    def is_released(self, row: str) -> bool:
        """Returns it to inactive, if that is possible now."""
        for user in (CENTRE, ENGINEER):
            with contextlib.suppress(Refused):
                self.manager(user).wish(row, INACTIVE)
        return self.manager().state(row) == INACTIVE

    def writes(self, since: int, unit: int = 10) -> int:
        """How many times a device was told to write."""
        self.desk.lines.get("1.10", "coils", 0)
        frames = self.desk.lines.frames(since)
        return sum(f.kind == "received" and f.unit == unit and f.bytes[1] in (5, 6, 15, 16) for f in frames)


def with_units(config: dict[str, Any]) -> dict[str, Any]:
    """Two points of a meter are sent of themselves; one has a unit, one other decimals than usual."""
    meter = config["port"][1]["slaves"][0]["input_registers"]
    by_address = {object_["address"]: object_ for object_ in meter}
    by_address[14] |= {"cyclic_ms": PERIOD_MS, "unit": "kW"}
    by_address[12]["background_ms"] = 86_400_000
    by_address[6]["decimals"] = 5
    registers = [{"address": FIRST + i, "type": "scaled"} for i in range(AT_ONCE)]
    text = {"address": SERIAL, "format": "string", "length": 4, "name": "serial", "period_ms": PERIOD_MS}
    config["port"][3]["slaves"][0]["input_registers"] += [*registers, text]
    return config


class Quick:
    """Managers in this process, by pysnmp: what is asked at a time is under way at a time."""

    def __init__(self, port: int) -> None:
        self.loop = asyncio.new_event_loop()
        self.port = port
        self.engines = {user: SnmpEngine() for user in USERS}

    def close(self) -> None:
        for engine in self.engines.values():
            engine.close_dispatcher()
        self.loop.run_until_complete(asyncio.sleep(0))
        self.loop.close()

    async def ask(self, command: Any, user: User, pairs: list[tuple[str, Any]]) -> tuple[int, list[Any]]:
        """The error's number, and the values."""
        target = await UdpTransportTarget.create(("127.0.0.1", self.port), timeout=5, retries=0)
        wanted = [(ObjectName(oid(name)), value) for name, value in pairs]
        failure, status, _, found = await command(
            self.engines[user], secrets_of(user), target, ContextData(), *wanted, lookupMib=False
        )
        assert failure is None, failure
        return int(status), [int(value) for _, value in found]

    async def get(self, user: User, *names: str) -> list[int]:
        status, values = await self.ask(get_cmd, user, [(name, Null("")) for name in names])
        assert status == 0
        return values

    async def wish(self, user: User, row: str, spin: int, state: int, value: int | None = None) -> bool:
        """False: it was inconsistentValue."""
        numbers = {"SpinLock": spin, "State": state} | ({} if value is None else {"Value": value})
        pairs = [(f"rtuCommand{name}.{row}", Integer32(number)) for name, number in numbers.items()]
        status, _ = await self.ask(set_cmd, user, pairs)
        assert status in (0, INCONSISTENT), status
        return status == 0


def secrets_of(user: User) -> UsmUserData:
    return UsmUserData(
        user.name,
        user.authentication,
        user.encryption,
        authProtocol=USM_AUTH_HMAC192_SHA256,
        privProtocol=USM_PRIV_CFB128_AES,
    )


def configuration(folder: Path, port: int, sink_port: int, **more: Any) -> dict[str, Any]:
    users = [{"name": user.name, "role": role} for user, role in USERS.items()]
    sink = {"name": "nms", "address": "127.0.0.1", "port": sink_port, "user": CENTRE.name}
    sink["timeout_ms"] = int(SINK_TIMEOUT_S * 1000)
    snmp = {"address": "127.0.0.1", "port": port, "users": users, "sinks": [sink], "rate": 100000}
    snmp |= {"contact": "control room", "location": "cabinet 2"}
    return with_units(chapter_5()) | {
        "snmp": snmp | {"keys": str(folder / "keys"), "state": str(folder / "state")} | more
    }


@contextlib.contextmanager
def site_of(programs: Path, lasting_s: int = 0) -> Iterator[Site]:
    """With lasting_s a selection, and the wait for a device of port 1, end by themselves after so long."""
    folder = run_directory()
    port, sink_port = free_udp_port(), free_udp_port()
    config = configuration(folder, port, sink_port, release_time=15)
    config["commands"] = {"select_timeout": lasting_s or 2, "command_timeout": lasting_s or 10}
    if lasting_s:
        for slave in of_port(config, 1)["slaves"]:
            slave |= patience(lasting_s * 1000)
    make_keys(config, folder)
    with receiver(sink_port, folder / "receiver") as received, desk_of(config, programs) as desk:
        yield Site(desk, folder, port, received)
    remove(folder)


def end_commands(site: Site) -> None:
    """What a test has left of its commands ends by itself."""
    for row in (BREAKER, LAMP):
        site.desk.gateway.wait_for(lambda row=row: site.is_released(row), 60.0, f"{row} is released")


async def bulk(port: int, most: int) -> list[Any]:
    """By pysnmp: 2^31 - 1 repetitions, of a manager that takes messages of that size."""
    engine = SnmpEngine()
    (size,) = engine.get_mib_builder().import_symbols("__SNMP-FRAMEWORK-MIB", "snmpEngineMaxMessageSize")
    size.syntax = size.syntax.clone(most)
    target = await UdpTransportTarget.create(("127.0.0.1", port), timeout=5, retries=0)
    names = [ObjectType(ObjectIdentity(oid(name))) for name in ("rtuPointName", "rtuPointType")]
    failure, status, _, rows = await bulk_cmd(
        engine, secrets_of(CENTRE), target, ContextData(), 0, 2**31 - 1, *names
    )
    engine.close_dispatcher()
    assert (str(failure), int(status)) == ("None", 0)
    return list(rows)


@contextlib.contextmanager
def relayed(port: int, messages: list[bytes]) -> Iterator[int]:
    """A port before the agent's; what passes it is kept."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as relay:
        relay.bind(("127.0.0.1", 0))
        relay.settimeout(0.1)
        done = threading.Event()
        thread = threading.Thread(target=pass_on, args=(relay, port, messages, done))
        thread.start()
        try:
            yield relay.getsockname()[1]
        finally:
            done.set()
            thread.join()


def pass_on(relay: socket.socket, port: int, messages: list[bytes], done: threading.Event) -> None:
    asker = None
    while not done.is_set():
        try:
            octets, source = relay.recvfrom(65535)
        except TimeoutError:
            continue
        messages.append(octets)
        if source[1] == port:
            relay.sendto(octets, asker)
        else:
            asker = source
            relay.sendto(octets, ("127.0.0.1", port))
