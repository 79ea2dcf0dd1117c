# SPDX-License-Identifier: GPL-3.0-or-later
"""Random events, and what IEC 60870-5-104, IEC 61850 and SNMPv3 tell: one value, one time, one quality."""

import json
import struct
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import pytest

from lab.gateway import Gateway, free_port, listening_on, remove, run_directory
from lab.manager import (
    CENTRE,
    USERS,
    Manager,
    Receiver,
    free_udp_port,
    make_keys,
    oid,
    receiver,
    value_of,
)
from lab.master import Monitor, Report
from lab.modules import place, program
from lab.patience import Deadline
from peers import mms
from rig.qualities import (
    BLOCKED,
    CA,
    CHANCE,
    DEVICE,
    INVALID,
    NOT_TOPICAL,
    OVERFLOW,
    SUBSTITUTED,
    TYPES,
    quality_of_iec61850,
)

pytestmark = pytest.mark.slow

BLOCKS = {"LLN0$status": "LLN0$BR$brcbStatus01", "LLN0$measured": "LLN0$BR$brcbMeasured01"}
OF_A_TYPE = 6
BATCH = 500  # what waits for a reader meanwhile has room
PATIENCE_S = 20.0
NS_PER_S, NS_PER_MS = 1_000_000_000, 1_000_000
ANGLES_PER_DEGREE = 10_000_000
YES = bytes.fromhex("8301ff")
WORDS = {
    "Invalid": INVALID,
    "NonTopical": NOT_TOPICAL,
    "Substituted": SUBSTITUTED,
    "Blocked": BLOCKED,
    "Overflow": OVERFLOW,
}
SET_BY_A_MASTER = 0x1F  # time quality (8-1, 8.1.3.7): synchronised, of no stated accuracy

# A value as its protocol has it, a quality likewise, and a time in the protocol's resolution.
Told = tuple[float, int, int]
Events = dict[int, list[Told]]  # of each point, by its IOA


def float32(value: float) -> float:
    found: float = struct.unpack("f", struct.pack("f", value))[0]
    return found


# ---- what was published ----------------------------------------------------------------------------


@dataclass(frozen=True)
class Event:
    ioa: int
    type: str
    value: float
    quality: int
    wall_ns: int

    @classmethod
    def of(cls, line: str, points: dict[str, dict[str, Any]]) -> Self:
        name, value, quality, wall_ns = json.loads(line)
        return cls(points[name]["ioa"], points[name]["type"], value, quality, wall_ns)

    def by_iec104(self) -> Told:
        """An angle is a short float of degrees, an integer a bitstring, two's complement."""
        value = self.value
        if self.type == "angle":
            value = float32(value / ANGLES_PER_DEGREE)
        elif self.type == "integer":
            value = int(value) & 0xFFFFFFFF
        return value, self.quality, self.wall_ns // NS_PER_MS

    def by_iec61850(self) -> Told:
        """A bitstring is an INT32 of the same bits."""
        value = self.value
        if self.type == "angle":
            value = float32(value / ANGLES_PER_DEGREE)
        elif self.type == "normalized":
            value = value / 2**15
        elif self.type == "bitstring":
            value = value - 2**32 if value >= 2**31 else value
        seconds, ns = divmod(self.wall_ns, NS_PER_S)
        return value, quality_of_iec61850(self.quality), seconds << 24 | (ns << 24) // NS_PER_S

    def by_snmp(self) -> Told:
        return self.value, self.quality, self.wall_ns // NS_PER_MS


# ---- what was told ---------------------------------------------------------------------------------


def of_iec104(report: Report) -> Told:
    value = report.value
    if isinstance(value, str):
        value = ("INTERMEDIATE", "OFF", "ON", "INDETERMINATE").index(value)
    elif report.type == "M_ME_TD_1":
        value = round(value * 2**15)
    quality = 0 if report.good else sum(WORDS[word] for word in report.quality.split("+"))
    assert report.recorded_at is not None
    return value, quality, round(report.recorded_at.timestamp() * 1000)


def of_iec61850(data: list[tuple[int, bytes]]) -> Told:
    """stVal or mag, q, t."""
    (tag, value), (_, quality), (_, time) = data
    assert time[7] == SET_BY_A_MASTER
    return plain(tag, value), int.from_bytes(quality[1:], "big") >> 3, int.from_bytes(time[:7], "big")


def plain(tag: int, content: bytes) -> float:
    if tag == 0xA2:  # mag
        ((_, content),) = mms.elements(content)
        found: float = struct.unpack(">f", content[1:])[0]
        return found
    if tag == 0x83:
        return int(content != b"\0")
    if tag == 0x84:  # a double point
        return content[1] >> 6
    return int.from_bytes(content, "big", signed=True)


def of_snmp(row: dict[str, Any], kind: str) -> Told:
    value = row["rtuEventValue"]
    if kind == "float":
        value = struct.unpack(">f", row["rtuEventFloat"])[0]
    elif kind in ("single", "double"):
        value -= 1
    elif kind == "bitstring":
        value &= 0xFFFFFFFF
    assert row["rtuEventTimeValid"] == 1
    return value, row["rtuEventQuality"][0], int.from_bytes(row["rtuEventTime"], "big")


@dataclass
class Site:
    """The gateway, and who hears of its events."""

    gateway: Gateway
    monitor: Monitor
    client: mms.Client
    received: Receiver
    points: dict[str, dict[str, Any]]  # of the file, without the one that is commanded
    members: dict[str, list[int]] = field(default_factory=dict)  # of each block, the points' IOAs
    heard_104: int = 0  # reports that were taken
    heard_snmp: int = 0  # octets of the receiver's log that were taken
    written: int = 0  # lines that were taken

    def publish(self, count: int) -> list[Event]:
        """So many random events at least; returns them when all are published."""
        self.gateway.ctl("set", "chance.wanted", str(count))
        file = self.gateway.directory / "chance.txt"

        def lines() -> list[str]:
            return file.read_text().splitlines()[self.written :]

        self.gateway.wait_for(lambda: len(lines()) >= count, PATIENCE_S, f"{count} events are published")
        found = lines()
        self.written += len(found)
        return [Event.of(line, self.points) for line in found]

    def told(self, count: int, take: Callable[[Events], None], by: str) -> Events:
        """Until there are so many, of points that are compared."""
        events: Events = defaultdict(list)
        deadline, before = Deadline(PATIENCE_S), -1
        while (found := sum(map(len, events.values()))) < count:
            assert not deadline.over, f"{found} of {count} events are told by {by}"
            if found == before:
                time.sleep(0.01)
            before = found
            take(events)
        return events

    def take_iec104(self, events: Events) -> None:
        fresh = self.monitor.reports_since(self.heard_104)
        self.heard_104 += len(fresh)
        for report in fresh:
            if report.ioa in self.types:
                events[report.ioa].append(of_iec104(report))

    def take_iec61850(self, events: Events) -> None:
        """The next report: of one change."""
        name, *_, included, value, _reason = self.client.report()
        members = self.members[name[1].decode().partition("/")[2]]
        (member,) = [i for i in range(len(members)) if included[1][1 + i // 8] & 0x80 >> i % 8]
        if members[member] in self.types:
            events[members[member]].append(of_iec61850(mms.elements(value[1])))

    def take_snmp(self, events: Events) -> None:
        """The instances of a notification end with the numbers of the events that it tells."""
        with self.received.log.open() as log:
            log.seek(self.heard_snmp)
            text = log.read()
        whole = text[: text.rfind("\n") + 1]
        self.heard_snmp += len(whole)
        rows: dict[str, dict[str, Any]] = defaultdict(dict)
        for line in whole.splitlines():
            for cell in line.split("\t"):
                place, _, value = cell.strip().partition(" ")
                column, _, number = place.removeprefix(".").rpartition(".")
                if column in COLUMNS:
                    rows[number][COLUMNS[column]] = value_of(value)
        for row in rows.values():
            ioa = row.get("rtuEventObjectAddress")
            if ioa in self.types:
                events[ioa].append(of_snmp(row, self.types[ioa]))

    @property
    def types(self) -> dict[int, str]:
        return {point["ioa"]: point["type"] for point in self.points.values()}

    def enable(self) -> None:
        for data_set, block in BLOCKS.items():
            names = self.client.members(DEVICE, data_set)
            self.members[block] = [int(name.rpartition("$")[2].lstrip(LETTERS)) for name in names]
            for attribute in ("PurgeBuf", "RptEna"):
                assert self.client.write(DEVICE, (f"{block}${attribute}", YES)) == [mms.DONE]


LETTERS = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz"
COLUMNS = {
    oid(name): name
    for name in (
        "rtuEventObjectAddress",
        "rtuEventValue",
        "rtuEventFloat",
        "rtuEventQuality",
        "rtuEventTime",
        "rtuEventTimeValid",
    )
}


def points() -> list[dict[str, Any]]:
    return [
        {"name": f"chance.{kind}-{number}", "type": kind, "ioa": 10 * place + number}
        for place, kind in enumerate(TYPES, start=1)
        for number in range(OF_A_TYPE)
    ]


def configuration(folder: Path, port: int, agent: int, sink: int) -> dict[str, Any]:
    chance = {
        "name": "chance",
        "program": program(folder, "chance", CHANCE),
        "period_ms": 20,
        "heartbeat_limit_ms": 5000,
        "ca": CA,
        "points": [{"name": "chance.wanted", "type": "scaled", "ioa": 1, "command": True}, *points()],
        "config": {"file": str(folder / "chance.txt"), "seed": 61850},
    }
    users = [{"name": user.name, "role": role} for user, role in USERS.items()]
    nms = {"name": "nms", "address": "127.0.0.1", "port": sink, "user": CENTRE.name, "window": 16}
    snmp = {"address": "127.0.0.1", "port": agent, "users": users, "sinks": [nms], "rate": 100000}
    return {
        "port": [],
        "modules": [chance],
        "iec61850": {"address": "127.0.0.1", "port": port, "report_buffer": 4096},
        "snmp": snmp | {"keys": str(folder / "keys"), "state": str(folder / "state")},
    }


@pytest.fixture(scope="module")
def site(programs: Path) -> Iterator[Site]:
    folder = run_directory()
    port, agent, sink = free_port(), free_udp_port(), free_udp_port()
    try:
        place(folder, programs)
        (folder / "chance.txt").touch()
        (folder / "chance.txt").chmod(0o666)
        config = listening_on(configuration(folder, port, agent, sink), free_port())
        make_keys(config, folder)
        with (
            receiver(sink, folder / "receiver") as received,
            Gateway(config, folder, programs) as gateway,
            Monitor(*gateway.address) as monitor,
            mms.Client(port, timeout_s=PATIENCE_S) as client,
        ):
            monitor.synchronise_clock(CA)
            for module in ("chance", "rtu-snmp"):
                gateway.wait_for(
                    lambda module=module: gateway.modules()[module]["alive"], PATIENCE_S, f"{module} runs"
                )
            manager = Manager(agent, folder)
            gateway.wait_for(lambda: manager.get("rtuSinkState.1") == [2], PATIENCE_S, "the sink is informed")
            of_file = {point["name"]: point for point in points()}
            site = Site(gateway, monitor, client, received, of_file)
            site.enable()
            yield site
            assert all(module["restarts"] == 0 for module in gateway.modules().values())
    finally:
        remove(folder)


@pytest.mark.parametrize("count", [BATCH, pytest.param(10_000, marks=pytest.mark.soak)])
def test_each_event_is_the_same_by_all_protocols(site: Site, count: int) -> None:
    """Batch by batch. Of a point they are told in the order in which they happened, none twice."""
    for _ in range(count // BATCH):
        published = site.publish(BATCH)
        assert {event.type for event in published} == set(TYPES)
        for by, take, expected in (
            ("IEC 61850", site.take_iec61850, Event.by_iec61850),
            ("IEC 60870-5-104", site.take_iec104, Event.by_iec104),
            ("SNMPv3", site.take_snmp, Event.by_snmp),
        ):
            told = site.told(len(published), take, by)
            for ioa, kind in site.types.items():
                wanted = [expected(event) for event in published if event.ioa == ioa]
                assert told[ioa] == wanted, (by, kind)
