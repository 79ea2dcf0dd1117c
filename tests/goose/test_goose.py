# SPDX-License-Identifier: GPL-3.0-or-later
"""GOOSE on the loopback interface, with libiec61850 as the other, tshark as the judge, and hostile frames."""

import json
import random
import re
import socket
import subprocess
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from lab.gateway import Gateway, free_port, listening_on, remove, run_directory
from lab.modules import compiled, place, program
from peers.goose_peer import Peer, peer
from rig.rights import SUPERUSER, need

pytestmark = pytest.mark.slow

FIXTURES = Path(__file__).resolve().parents[1] / "fixtures/goose"
INTERFACE = "lo"
PATIENCE_S = 20.0
OWN, OWN_APP_ID = "GW1LD0/LLN0$GO$bay", 0x1001
RELAY, RELAY_DATA, RELAY_APP_ID = "IED1LD0/LLN0$GO$trip", "IED1LD0/LLN0$trip", 0x1002
ETHERTYPE = 0x88B8
GOOD, DOUBTFUL = "0" * 13, "11" + "0" * 11

POINTS = [
    {"name": "bay.breaker", "type": "double", "ioa": 1, "command": True},
    {"name": "bay.ready", "type": "single", "ioa": 2, "command": True},
    {"name": "bay.current", "type": "float", "ioa": 3, "command": True},
    {"name": "bay.tap", "type": "scaled", "ioa": 4, "command": True},
]
NAMES = [point["name"] for point in POINTS]


def mirror(point: dict[str, Any]) -> list[Any]:
    """What is published of a point, as a subscription names it."""
    copy = {"name": point["name"].replace("bay", "copy"), "type": point["type"], "ioa": point["ioa"]}
    return [copy, "quality", "time"]


def config(directory: Path) -> dict[str, Any]:
    bay = {
        "name": "bay",
        "program": program(directory, "bay", FIXTURES / "bay.py"),
        "period_ms": 20,
        "heartbeat_limit_ms": 2000,
        "ca": 100,
        "points": POINTS,
        "config": {"file": str(directory / "bay.json")},
    }
    stream = {"control_block": OWN, "data_set": "GW1LD0/LLN0$bay", "app_id": OWN_APP_ID}
    published = stream | {"name": "bay", "conf_rev": 7, "max_ms": 500, "time": True, "points": NAMES}
    tagged = published | {"name": "tagged", "control_block": OWN + "2", "app_id": 0x1003, "vlan": 0}
    copy = stream | {"name": "copy", "ca": 200, "conf_rev": 7}
    copy["data"] = [entry for point in POINTS for entry in mirror(point)]
    relay = {"name": "relay", "control_block": RELAY, "app_id": RELAY_APP_ID, "ca": 300}
    relay |= {"destination": "01:0c:cd:01:00:02", "data_set": RELAY_DATA}
    relay["data"] = [
        {"name": "relay.trip", "type": "single", "ioa": 1},
        "quality",
        {"name": "relay.position", "type": "double", "ioa": 2},
        {"name": "relay.current", "type": "float", "ioa": 3},
        {"name": "relay.count", "type": "scaled", "ioa": 4},
    ]
    goose = {"interface": INTERFACE, "publish": [published, tagged], "subscribe": [copy, relay]}
    return {"port": [], "modules": [bay], "goose": goose}


@dataclass
class Bay:
    gateway: Gateway

    def qualities(self, **bits: int) -> None:
        fresh = self.gateway.directory / "bay.new"
        fresh.write_text(json.dumps({"quality": {f"bay.{name}": bit for name, bit in bits.items()}}))
        fresh.rename(self.gateway.directory / "bay.json")

    def wait_point(self, name: str, value: Any, quality: str = "good") -> None:
        def there() -> bool:
            point = self.gateway.points(name)[name]
            return (point["value"], point["quality"]) == (value, quality)

        self.gateway.wait_for(there, PATIENCE_S, f"{name} is {value}, {quality}")

    def wait_quality(self, name: str, quality: str) -> None:
        self.gateway.wait_for(
            lambda: self.gateway.points(name)[name]["quality"] == quality, PATIENCE_S, f"{name} is {quality}"
        )

    def wait_running(self, module: str) -> None:
        self.gateway.wait_for(
            lambda: self.gateway.modules()[module]["state"] == "running", PATIENCE_S, f"{module} runs"
        )

    def counter(self, name: str) -> int:
        rows = self.gateway.query("counters", "rtu-goose")
        return int({row["counter"]: row["value"] for row in rows}[name])

    def process(self) -> int:
        return int(self.gateway.modules()["rtu-goose"]["pid"])


@pytest.fixture(scope="module")
def running(programs: Path) -> Iterator[Bay]:
    need(SUPERUSER, "a socket on an interface's frames is root's")
    directory = run_directory()
    try:
        place(directory, programs)
        (directory / "bay.json").write_text("{}")
        with Gateway(listening_on(config(directory), free_port()), directory, programs) as gateway:
            bay = Bay(gateway)
            bay.wait_running("bay")
            bay.wait_running("rtu-goose")
            yield bay
    finally:
        remove(directory)


@pytest.fixture
def bay(running: Bay) -> Bay:
    """All points good, and known to whoever hears them."""
    running.qualities()
    for name, value in zip(NAMES, ("off", "off", "1.5", "7"), strict=True):
        running.gateway.ctl("set", name, value)
    running.wait_point("copy.tap", 7)
    return running


@pytest.fixture(scope="module")
def hearer(running: Bay) -> Iterator[Peer]:
    other = peer("hear", INTERFACE, OWN, str(OWN_APP_ID))
    yield other
    other.process.kill()


@pytest.fixture(scope="module")
def speaker() -> Iterator[Peer]:
    other = peer("say", INTERFACE, RELAY, str(RELAY_APP_ID), "--data-set", RELAY_DATA, "--alive-ms", "3000")
    yield other
    other.process.kill()


# ---- what is published -----------------------------------------------------------------------------


def values(message: dict[str, Any]) -> list[str]:
    """Value and quality of each point, without the times."""
    entries = re.findall(r"[^,{}]+", message["values"])
    return [entry for place, entry in enumerate(entries) if place % 3 != 2]


def test_what_libiec61850_hears(bay: Bay, hearer: Peer) -> None:
    bay.gateway.ctl("set", "bay.breaker", "on")
    bay.gateway.ctl("set", "bay.current", "-2.5")
    heard = hearer.wait(lambda m: values(m)[0] == "10" and values(m)[4].startswith("-2.5"), "the change")
    assert values(heard)[1::2] == [GOOD] * 4
    assert values(heard)[2] == "false"
    assert values(heard)[6] == "7"
    assert (heard["valid"], heard["revision"]) == (True, 7)


def test_each_change_is_a_state_of_its_own(bay: Bay, hearer: Peer) -> None:
    before = hearer.wait(lambda m: values(m)[2] == "false" and m["sequence"] > 0, "rest")["state"]
    for value in ("on", "off", "on"):
        bay.gateway.ctl("set", "bay.ready", value)
    after = hearer.wait(lambda m: values(m)[2] == "true" and m["state"] >= before + 3, "three changes")
    assert after["state"] == before + 3


def test_quality_is_told(bay: Bay, hearer: Peer) -> None:
    bay.qualities(current=0x40)
    heard = hearer.wait(lambda m: values(m)[5] != GOOD, "a doubtful current")
    assert values(heard)[5] == "1100000100000"
    bay.wait_quality("copy.current", "not topical")
    bay.qualities(current=0x80)
    hearer.wait(lambda m: values(m)[5] == "0100001000000", "an invalid current")


def test_dead_owner_is_invalid(bay: Bay, hearer: Peer) -> None:
    bay.gateway.kill("bay")
    hearer.wait(lambda m: values(m)[1::2] == ["0100001000000"] * 4, "all of it invalid")
    bay.wait_quality("copy.tap", "invalid")
    bay.wait_running("bay")


def test_another_process_goes_on(bay: Bay, hearer: Peer) -> None:
    before = hearer.wait(lambda m: True, "a message")["state"]
    bay.gateway.kill("rtu-goose")
    after = hearer.wait(lambda m: m["state"] > before, "a newer state")
    assert after["state"] <= before + 2  # what it read may have come in two steps
    bay.wait_point("copy.tap", 7)


def test_what_tshark_reads(bay: Bay, tmp_path: Path) -> None:
    capture = tmp_path / "goose.pcapng"
    command = ["tshark", "-i", INTERFACE, "-f", "ether proto 0x88b8 or vlan", "-c", "12", "-w", str(capture)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as tshark:
        assert tshark.stderr is not None
        for line in tshark.stderr:
            if "Capturing" in line:
                break
        bay.gateway.ctl("set", "bay.tap", "-300")
        assert tshark.wait(PATIENCE_S) == 0
    fields = ("goose.gocbRef", "goose.datSet", "goose.stNum", "goose.confRev", "goose.numDatSetEntries",
              "goose.appid", "vlan.priority", "_ws.malformed", "_ws.expert.message")  # fmt: skip
    command = [
        "tshark",
        "-r",
        str(capture),
        "-T",
        "fields",
        *(part for name in fields for part in ("-e", name)),
    ]
    read = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    rows = [dict(zip(fields, line.split("\t"), strict=True)) for line in read.splitlines()]
    assert len(rows) == 12
    assert {row["_ws.malformed"] + row["_ws.expert.message"] for row in rows} == {""}
    assert {(row["goose.confRev"], row["goose.numDatSetEntries"]) for row in rows} == {("7", "12")}
    assert {(row["goose.gocbRef"], row["goose.appid"]) for row in rows} == {
        (OWN, "0x1001"),
        (OWN + "2", "0x1003"),
    }


def test_a_rush_of_changes_is_a_bounded_number_of_messages(programs: Path) -> None:
    """Some of 900 changes in a row are merged into the next; the last one is told."""
    need(SUPERUSER, "a socket on an interface's frames is root's")
    directory = run_directory()
    rush = {"control_block": "RUSHLD0/LLN0$GO$rush", "data_set": "RUSHLD0/LLN0$rush", "app_id": 0x1004}
    hearer = peer("hear", INTERFACE, rush["control_block"], str(rush["app_id"]))
    try:
        place(directory, programs)
        module = {
            "name": "rush",
            "program": compiled(directory, "rush", FIXTURES / "rush.c"),
            "period_ms": 100,
            "heartbeat_limit_ms": 5000,
            "ca": 100,
            "points": [{"name": "rush.count", "type": "integer", "ioa": 1, "command": True}],
        }
        told = rush | {"name": "rush", "max_ms": 200, "points": ["rush.count"]}
        site = {"port": [], "modules": [module], "goose": {"interface": INTERFACE, "publish": [told]}}
        began = time.monotonic()
        with Gateway(listening_on(site, free_port()), directory, programs) as gateway:
            hearer.wait(lambda m: True, "rtu-goose runs")
            gateway.ctl("set", "rush.count", "900")
            hearer.wait(lambda m: m["values"].startswith("{900,"), "the last change")
            counters = {row["counter"]: row["value"] for row in gateway.query("counters", "rtu-goose")}
            assert counters["rush.merged"] > 0
            assert counters["rush.messages"] <= 32 + (time.monotonic() - began) * 1000
    finally:
        hearer.process.kill()
        remove(directory)


# ---- what is subscribed to -------------------------------------------------------------------------


def tell(bay: Bay, speaker: Peer, state: list[Any], name: str, value: Any, quality: str = "good") -> None:
    """Says it, and again while a busy host does not look before its time is over."""
    speaker.say(state)

    def there() -> bool:
        speaker.say(None)
        point = bay.gateway.points(name)[name]
        return (point["value"], point["quality"]) == (value, quality)

    bay.gateway.wait_for(there, PATIENCE_S, f"{name} is {value}, {quality}")


def test_what_libiec61850_says(bay: Bay, speaker: Peer) -> None:
    state = [True, GOOD, "10", 12.25, -5]
    tell(bay, speaker, state, "relay.trip", "on")
    tell(bay, speaker, state, "relay.position", "on")
    tell(bay, speaker, state, "relay.current", 12.25)
    tell(bay, speaker, state, "relay.count", -5)
    state = [False, DOUBTFUL, "01", 0.0, 1]
    tell(bay, speaker, state, "relay.trip", "off", "not topical")
    tell(bay, speaker, state, "relay.position", "off")


def test_silence_is_invalid(bay: Bay, speaker: Peer) -> None:
    tell(bay, speaker, [True, GOOD, "10", 1.0, 1], "relay.trip", "on")
    bay.wait_quality("relay.trip", "invalid")
    assert bay.counter("relay.expired") > 0
    assert bay.counter("relay.holds") == 0
    assert bay.gateway.points("relay.trip")["relay.trip"]["value"] == "on"


@pytest.mark.parametrize(
    "wrong", [[True, GOOD, "10", 1.0], [True, GOOD, "10", 1.0, 40000], [1, GOOD, "10", 1.0, 1]]
)
def test_other_data_than_agreed_is_invalid(bay: Bay, speaker: Peer, wrong: list[Any]) -> None:
    tell(bay, speaker, [True, GOOD, "10", 1.0, 1], "relay.trip", "on")
    before = bay.counter("relay.mismatched")
    tell(bay, speaker, wrong, "relay.trip", "on", "invalid")
    assert bay.counter("relay.mismatched") > before


# ---- a changed configuration ----------------------------------------------------------------------


def test_changed_publication_goes_on(bay: Bay, hearer: Peer) -> None:
    """A data set without its times, in another revision: the copy, which expects them, is invalid."""
    gateway = bay.gateway
    before = json.loads(gateway.config_file.read_text())
    after = json.loads(gateway.config_file.read_text())
    after["goose"]["publish"][0] |= {"time": False, "conf_rev": 8}
    gateway.ctl("reload", gateway.put(after))
    heard = hearer.wait(lambda m: m["revision"] == 8, "the other revision")
    assert len(re.findall(r"[^,{}]+", heard["values"])) == 8
    bay.wait_quality("copy.tap", "invalid")
    gateway.ctl("reload", gateway.put(before))
    hearer.wait(lambda m: m["revision"] == 7, "the former revision")
    bay.wait_point("copy.tap", 7)


# ---- hostile ---------------------------------------------------------------------------------------


def frame(octets: bytes, app_id: int = OWN_APP_ID, destination: str = "010ccd010000") -> bytes:
    head = bytes.fromhex(f"{destination} 020000000001") + ETHERTYPE.to_bytes(2, "big")
    return head + app_id.to_bytes(2, "big") + (len(octets) + 8).to_bytes(2, "big") + bytes(4) + octets


def test_storm_of_wrong_frames_changes_nothing(bay: Bay) -> None:
    """Those of no subscription do not reach the process: the kernel drops them."""
    chance = random.Random(1)
    damaged = bay.counter("damaged")
    pid = bay.process()
    with socket.socket(socket.AF_PACKET, socket.SOCK_RAW, 0) as wire:
        wire.bind((INTERFACE, 0))
        for number in range(20_000):
            octets = chance.randbytes(chance.randrange(0, 200))
            wire.send(frame(b"\x61" + octets if number % 2 else octets, OWN_APP_ID if number % 4 else 0x2000))
    bay.gateway.wait_for(lambda: bay.counter("damaged") > damaged, PATIENCE_S, "damaged frames are counted")
    bay.gateway.ctl("set", "bay.tap", "9")
    bay.wait_point("copy.tap", 9)
    assert bay.process() == pid
    assert bay.counter("unknown") == 0


def tlv(tag: int, content: bytes) -> bytes:
    length = len(content).to_bytes(2, "big")
    return bytes([tag, 0x82]) + length + content


def number(value: int) -> bytes:
    return value.to_bytes(5, "big")


def relays(state: int, sequence: int, on: bool, *, revision: int = 1, alive_ms: int = 60_000) -> bytes:
    """A message as the relay sends it now."""
    now = time.time()
    fraction = int(now % 1 * 2**24).to_bytes(3, "big")
    values = tlv(0x83, bytes([on])) + tlv(0x84, b"\3\0\0") + tlv(0x84, b"\6\x40")
    values += tlv(0x87, b"\x08\x3f\x80\0\0") + tlv(0x85, b"\x01")
    fields = [RELAY.encode(), number(alive_ms), RELAY_DATA.encode(), b"trip"]
    fields += [int(now).to_bytes(4, "big") + fraction + b"\x0a", number(state), number(sequence), b"\0"]
    fields += [number(revision), b"\0", b"\5"]
    pdu = b"".join(tlv(0x80 + place, field) for place, field in enumerate(fields)) + tlv(0xAB, values)
    return frame(tlv(0x61, pdu), RELAY_APP_ID, "010ccd010002")


def test_only_what_follows_or_starts_anew_is_believed(bay: Bay) -> None:
    """Not a recorded message behind one of another revision, nor a state from far ahead."""
    counted = bay.counter
    recorded = relays(5, 0, True)

    def send(octets: bytes, counter: str) -> None:
        before = counted(f"relay.{counter}")
        wire.send(octets)
        bay.gateway.wait_for(
            lambda: counted(f"relay.{counter}") > before, PATIENCE_S, f"one more of {counter}"
        )

    with socket.socket(socket.AF_PACKET, socket.SOCK_RAW, 0) as wire:
        wire.bind((INTERFACE, 0))
        bay.wait_quality("relay.trip", "invalid")
        send(relays(1, 0, False), "states")
        bay.wait_point("relay.trip", "off")
        send(relays(20, 0, False), "states")
        send(relays(20, 1, False, revision=9), "mismatched")
        bay.wait_quality("relay.trip", "invalid")
        send(recorded, "out_of_order")
        assert bay.gateway.points("relay.trip")["relay.trip"]["value"] == "off"
        send(relays(20, 2, False), "states")
        bay.wait_point("relay.trip", "off")
        missed = counted("relay.missed")
        send(relays(2**31 - 5, 0, True, alive_ms=600_000), "jumps")
        send(relays(21, 0, True), "states")
        bay.wait_point("relay.trip", "on")
        assert counted("relay.missed") == missed
        send(relays(22, 0, False, alive_ms=1), "expired")
        send(recorded, "jumps")
        point = bay.gateway.points("relay.trip")["relay.trip"]
        assert (point["value"], point["quality"]) == ("off", "invalid")
    said = "relay: stNum 2147483643, sqNum 0 do not follow 20, 2 and are not believed"
    bay.gateway.wait_for(lambda: said in bay.gateway.log(10_000), PATIENCE_S, "it is said")


def test_process_has_no_rights(bay: Bay) -> None:
    status = Path(f"/proc/{bay.process()}/status").read_text()
    assert re.search(r"^CapEff:\t0+$", status, re.MULTILINE)
    assert re.search(r"^Uid:\t61219\t", status, re.MULTILINE)
    assert re.search(r"^Seccomp:\t2$", status, re.MULTILINE)


# ---- the configuration -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"interface": "a-name-that-is-too-long"}, "goose.interface"),
        ({"publish": [], "subscribe": []}, "has nothing to do"),
        ({"publish": [{"points": ["bay.nothing"]}]}, "is the name of no point"),
        ({"publish": [{"points": []}]}, "publishes no point"),
        ({"publish": [{"points": NAMES * 20}]}, "does not fit into one message"),
        ({"publish": [{"destination": "00:0c:cd:01:00:01"}]}, "is no address of a group"),
        ({"publish": [{"min_ms": 900, "max_ms": 100}]}, "min_ms greater than max_ms"),
        ({"subscribe": [{"data": ["quality"]}]}, "has no point"),
        (
            {"subscribe": [{"data": [{"name": "x", "type": "single", "ioa": 1}, "other"]}]},
            "no entry of a data set",
        ),
        (
            {"subscribe": [{"data": ["time", {"name": "x", "type": "single", "ioa": 1}]}]},
            "no point before it",
        ),
        ({"publish": [{"app_id": 16384}]}, "app_id"),
    ],
)
def test_mistakes_are_named(programs: Path, tmp_path: Path, change: dict[str, Any], message: str) -> None:
    good = config(tmp_path)
    for key, value in change.items():
        if isinstance(value, list) and value:
            value = [good["goose"][key][0] | value[0]]
        good["goose"][key] = value
    file = tmp_path / "gateway.json"
    file.write_text(json.dumps(good))
    done = subprocess.run(
        [programs / "rtud/rtud", "--check", file], capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    assert message in done.stderr
