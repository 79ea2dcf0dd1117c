# SPDX-License-Identifier: GPL-3.0-or-later
"""GOOSE on either of two interfaces, libiec61850 at the other end of the cable: pulled, storm, flood."""

import itertools
import os
import random
import re
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import pytest

from lab.gateway import Gateway
from lab.linesim import LineSim
from lab.master import Monitor
from peers.goose_peer import Peer, peer
from rig.desk import gateway_on_lines, patience
from rig.rights import SUPERUSER, needed

pytestmark = [
    pytest.mark.slow,
    needed(SUPERUSER, "interfaces and sockets on their frames are root's"),
]

CA, DEVICE, INPUTS = 1005, "1.5", 4
POINTS = [f"p{DEVICE}.d{number}" for number in range(INPUTS)]
FIRST_IOA = 10001
OWN, OWN_APP_ID = "GW1LD0/LLN0$GO$bay", 0x1001
RELAY, RELAY_DATA, RELAY_APP_ID = "IED1LD0/LLN0$GO$trip", "IED1LD0/LLN0$trip", 0x1002
OTHER, OTHER_DATA, OTHER_APP_ID = "IED2LD0/LLN0$GO$trip", "IED2LD0/LLN0$trip", 0x1003
ETHERTYPE = 0x88B8
GOOD = "0" * 13
PATIENCE_S = 30.0
ALIVE_MS = 2000
AT_ONCE, PAUSE_S = 60, 0.01  # of a storm: some thousands a second
CHANGES, FRAMES = 10, 1000  # of the line, and of the storm, at least
BURST, FLOODS = 32, 10  # that an APPID is listened to at once, and that a flood lasts


def configuration(interface: str) -> dict[str, Any]:
    inputs = [{"address": number} for number in range(INPUTS)]
    slave = {"id": 5, **patience(), "discrete_inputs": inputs}
    pace = {"baud_rate": 115200, "data_bits": 8, "stop_bits": 1, "parity": 0}
    bay = {"name": "bay", "control_block": OWN, "data_set": "GW1LD0/LLN0$bay", "app_id": OWN_APP_ID}
    relay = subscription("relay", RELAY, RELAY_DATA, RELAY_APP_ID, 300)
    other = subscription("other", OTHER, OTHER_DATA, OTHER_APP_ID, 301)
    goose = {"interface": interface, "publish": [bay | {"points": POINTS, "max_ms": 300}]}
    return {
        "port": [{"value": 1, "active": 1, **pace, "slaves": [slave]}],
        "goose": goose | {"subscribe": [relay, other]},
    }


def subscription(name: str, control: str, data_set: str, app_id: int, ca: int) -> dict[str, Any]:
    of = {"name": name, "control_block": control, "data_set": data_set, "app_id": app_id, "ca": ca}
    data = [{"name": f"{name}.trip", "type": "single", "ioa": 1}, "quality"]
    return of | {"destination": "01:0c:cd:01:00:02", "data": data}


@dataclass
class Cable:
    """Two interfaces of this machine: the gateway's, and its partners'."""

    near: str
    far: str

    def plug(self, into: bool) -> None:
        subprocess.run(["ip", "link", "set", self.far, "up" if into else "down"], check=True)


@pytest.fixture(scope="module")
def cables() -> Iterator[list[Cable]]:
    """Of the gateway's two interfaces."""
    found = []
    for number in range(2):
        cable = Cable(*(f"{end}{number}-{os.getpid()}" for end in ("emac", "far")))
        command = ["ip", "link", "add", cable.near, "type", "veth", "peer", "name", cable.far]
        subprocess.run(command, check=True)
        found.append(cable)
        for end in (cable.near, cable.far):
            subprocess.run(["ip", "link", "set", end, "up"], check=True)
    yield found
    for cable in found:
        subprocess.run(["ip", "link", "del", cable.near], check=True)


@dataclass
class Site:
    """A gateway between a line, a controlling station, and partners at the other end of a cable."""

    lines: LineSim
    gateway: Gateway
    monitor: Monitor
    cable: Cable
    hearer: Peer
    speaker: Peer
    other: Peer
    on: bool = False

    def change(self) -> None:
        """All inputs of the device; the controlling station has heard of each."""
        self.on = not self.on
        mark = self.monitor.mark()
        self.lines.set(DEVICE, "discrete_inputs", 0, *[int(self.on)] * INPUTS)
        for number in range(INPUTS):
            self.monitor.wait(
                lambda r, ioa=FIRST_IOA + number: (r.ioa, r.value, r.good) == (ioa, self.on, True),
                mark,
                PATIENCE_S,
                f"input {number} changes",
            )

    def hear(self) -> dict[str, Any]:
        """The next message that says what the device has now."""
        wanted = [str(self.on).lower(), GOOD] * INPUTS
        return self.hearer.wait(lambda m: re.findall(r"[^,{}]+", m["values"]) == wanted, f"{wanted}")

    def tell(self, on: bool, name: str = "relay") -> None:
        """The relay says it, or the other one, again and again, until the gateway has it."""
        speaker = self.speaker if name == "relay" else self.other
        speaker.say([on, GOOD])

        def there() -> bool:
            speaker.say(None)
            return self.relay(name) == ("on" if on else "off", "good")

        self.gateway.wait_for(there, PATIENCE_S, f"the {name} is {on}")

    def relay(self, name: str = "relay") -> tuple[Any, str]:
        point = self.gateway.points(f"{name}.trip")[f"{name}.trip"]
        return point["value"], point["quality"]

    def counters(self) -> dict[str, int]:
        return {row["counter"]: row["value"] for row in self.gateway.query("counters", "rtu-goose")}


@pytest.fixture(scope="module", params=[0, 1], ids=["eth0", "eth1"])
def site(programs: Any, cables: list[Cable], request: pytest.FixtureRequest) -> Iterator[Site]:
    cable = cables[request.param]
    hearer = peer("hear", cable.far, OWN, str(OWN_APP_ID))
    alive = ["--alive-ms", str(ALIVE_MS)]
    speaker = peer("say", cable.far, RELAY, str(RELAY_APP_ID), "--data-set", RELAY_DATA, *alive)
    other = peer("say", cable.far, OTHER, str(OTHER_APP_ID), "--data-set", OTHER_DATA, *alive)
    try:
        with (
            gateway_on_lines(configuration(cable.near), programs, initial={}) as (lines, gateway),
            Monitor(*gateway.address) as monitor,
        ):
            yield Site(lines, gateway, monitor, cable, hearer, speaker, other)
            assert all(module["restarts"] == 0 for module in gateway.modules().values())
    finally:
        for process in (hearer.process, speaker.process, other.process):
            process.kill()
            process.wait()


def test_each_end_hears_the_other(site: Site) -> None:
    site.change()
    before = site.hear()
    site.change()
    assert site.hear()["state"] > before["state"]
    site.tell(True)
    site.tell(False)


def test_a_pulled_cable_costs_what_is_behind_it_and_no_more(site: Site) -> None:
    """What the relay said is invalid in time; the line goes on. Plugged in again, both ends hear the news."""
    site.tell(True)
    site.change()
    before = site.hear()
    expired = site.counters()["relay.expired"]
    site.cable.plug(False)
    try:
        site.gateway.wait_for(lambda: site.relay() == ("on", "invalid"), PATIENCE_S, "the relay is silent")
        site.change()
    finally:
        site.cable.plug(True)
    assert site.counters()["relay.expired"] == expired + 1
    assert site.hear()["state"] > before["state"]
    site.tell(False)


def test_an_interface_that_is_down_is_said_once(site: Site) -> None:
    """The gateway's own end: each message fails and is counted; a line of the log says so, one its end."""
    site.change()
    site.hear()
    before = site.gateway.log(10_000).count(f"the interface {site.cable.near}: ")
    failures = site.counters()["failures"]
    subprocess.run(["ip", "link", "set", site.cable.near, "down"], check=True)
    try:
        site.gateway.wait_for(lambda: site.counters()["failures"] >= failures + 3, PATIENCE_S, "failures")
        site.change()
    finally:
        subprocess.run(["ip", "link", "set", site.cable.near, "up"], check=True)
    site.hear()
    site.tell(True)
    up = f"the interface {site.cable.near} is up again"
    site.gateway.wait_for(lambda: up in site.gateway.log(10_000), PATIENCE_S, up)
    assert site.gateway.log(10_000).count(f"the interface {site.cable.near}: ") == before + 1


def of_others(chance: random.Random) -> bytes:
    """A message of an APPID that nobody has subscribed to."""
    return frame(chance.randbytes(chance.randrange(20, 200)), 0x2000)


def damaged(chance: random.Random) -> bytes:
    return frame(b"\x61" + chance.randbytes(chance.randrange(20, 200)), RELAY_APP_ID)


def frame(octets: bytes, app_id: int) -> bytes:
    head = bytes.fromhex("010ccd010002 020000000001") + ETHERTYPE.to_bytes(2, "big")
    return head + app_id.to_bytes(2, "big") + (len(octets) + 8).to_bytes(2, "big") + bytes(4) + octets


@dataclass
class Storm:
    """Frames of the same EtherType, thousands a second."""

    interface: str
    kinds: list[Callable[[random.Random], bytes]]
    sent: int = 0

    def __post_init__(self) -> None:
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._blow)

    def __enter__(self) -> "Storm":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()

    def _blow(self) -> None:
        chance = random.Random(1)
        with socket.socket(socket.AF_PACKET, socket.SOCK_RAW, 0) as wire:
            wire.bind((self.interface, 0))
            while not self._over.wait(PAUSE_S):
                for kind in self.kinds * (AT_ONCE // len(self.kinds)):
                    wire.send(kind(chance))
                    self.sent += 1


def test_a_storm_of_others_disturbs_nobody(site: Site) -> None:
    """Each change of the line still comes to the controlling station and the partner, and the relay's do."""
    site.tell(True)
    before = site.counters()
    with Storm(site.cable.far, [of_others]) as storm:
        for number in itertools.count():
            site.change()
            site.hear()
            site.tell(number % 2 == 0)
            if number >= CHANGES and storm.sent > FRAMES:
                break
    after = site.counters()
    assert {name for name in after if after[name] != before[name]} <= {
        *(f"bay.{name}" for name in ("messages", "states")),
        *(f"relay.{name}" for name in ("states", "repeated")),
        *("frames", "other.expired", "other.holds"),
    }


def test_a_flood_of_one_appid_costs_that_one_alone(site: Site) -> None:
    """Copies of the relay's last message and damaged ones: a few are taken. The other relay is heard."""
    with socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(ETHERTYPE)) as wire:
        wire.bind((site.cable.near, ETHERTYPE))
        site.tell(True)
        while (old := wire.recv(2048))[14:16] != RELAY_APP_ID.to_bytes(2, "big"):
            pass
    site.tell(True, "other")
    began, before = time.monotonic(), site.counters()
    with Storm(site.cable.far, [damaged, lambda _: old]):
        for number in itertools.count():
            site.change()
            site.hear()
            site.tell(number % 2 == 0, "other")
            counted = {name: value - before[name] for name, value in site.counters().items()}
            if number >= CHANGES and counted["relay.floods"] >= FLOODS:
                break
        flooded = counted["damaged"] + counted["relay.out_of_order"]
        assert flooded <= BURST + (time.monotonic() - began) * 1000
        site.gateway.wait_for(lambda: site.relay()[1] == "invalid", PATIENCE_S, "the relay is silent")
    assert counted["other.floods"] == 0
    assert counted["other.missed"] <= counted["overrun"]
    site.tell(False)
    assert "a flood of messages of APPID 1002" in site.gateway.log(10_000)
