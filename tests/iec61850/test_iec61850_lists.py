# SPDX-License-Identifier: GPL-3.0-or-later
"""Data sets that clients make, and those of attributes: what is in them, who has them, when they are told."""

import asyncio
import json
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from test_iec61850 import PATHS, TESTS

from iec61850 import FC, IedConnection
from lab.gateway import free_port
from peers import mms
from peers.mms import DONE, Client, element
from rig.capture import Connection, Relay, dissect_mms
from rig.desk import Substation, gateway_on_lines, patience

CA, LINE, DOMAIN, OTHER = 1005, "1.5", "OpenRTUCA1005", "OpenRTUCA1006"
OWN = "LLN0$Parts"
YES, NO = bytes.fromhex("8301ff"), bytes.fromhex("830100")
DATA_CHANGE, QUALITY_CHANGE, GENERAL = 0x40, 0x20, 0x04
UNDEFINED, EXISTS, INCONSISTENT = (0x82, b"\1"), (0x82, b"\5"), (0x82, b"\6")
NO_ROOM, NO_ACCESS, NOT_THERE = (0x83, b"\1"), (0x87, b"\1"), (0x87, b"\2")
WRONG = (0x80, b"\x0b")
LISTS, MEMBERS = 16, 64


def configuration(port: int) -> dict[str, Any]:
    slaves = [
        {
            "id": number,
            **patience(),
            "discrete_inputs": [{"address": i, "name": f"in{number}.{i}"} for i in range(70)],
        }
        for number in (5, 6)
    ]
    parts = ["in5.0[stVal]", "in5.0[q]", "in5.0[t]", "in5.1"]
    triggers = ["dchg", "qchg", "gi"]
    blocks = [{"name": "brcbParts", "buffered": True}, {"name": "urcbParts", "instances": 2}]
    reports = [block | {"triggers": triggers, "options": ["reasonCode"]} for block in blocks]
    pace = {"baud_rate": 38400, "data_bits": 8, "stop_bits": 1, "parity": 0}
    return {
        "iec61850": {
            "address": "127.0.0.1",
            "port": port,
            "data_sets": [{"name": "Parts", "points": parts, "reports": reports}],
        },
        "port": [{"value": 1, "active": 1, **pace, "slaves": slaves}],
    }


@dataclass
class Plant(Substation):
    port: int

    def client(self) -> Client:
        return Client(self.port)


@pytest.fixture(scope="module")
def plant(programs: Path) -> Iterator[Plant]:
    port = free_port()
    with gateway_on_lines(configuration(port), programs, initial={}) as (lines, gateway):
        plant = Plant(lines, gateway, port)
        plant.wait_all_good(CA)
        yield plant
        assert gateway.modules()["rtu-iec61850"]["restarts"] == 0


# ---- requests ---------------------------------------------------------------------------------------


def named(name: str) -> bytes:
    """Of a logical device; @: of the association."""
    return element(0x82, name[1:].encode()) if name[0] == "@" else mms.name(DOMAIN, name)


def definition(name: str, *members: str, domain: str = DOMAIN) -> bytes:
    listed = [element(mms.SEQUENCE, element(0xA0, mms.name(domain, member))) for member in members]
    return element(mms.LIST_DEFINE, named(name), element(0xA0, *listed))


def define(client: Client, name: str, *members: str) -> None:
    assert client.ask(definition(name, *members)) == (mms.RESPONSE, [(0x8B, b"")])


def deleted(client: Client, *names: str) -> tuple[int, ...]:
    """How many there were, and how many are not there any more."""
    asked = element(mms.LIST_DELETE, element(0xA1, *[named(name) for name in names]))
    tag, ((_, content),) = client.ask(asked)
    assert tag == mms.RESPONSE
    return tuple(int.from_bytes(number, "big") for _, number in mms.elements(content))


def members(client: Client, name: str) -> tuple[bool, list[str]]:
    """Whether a client may delete the data set, and what is in it."""
    tag, ((_, content),) = client.ask(element(mms.LIST_ATTRIBUTES, named(name)))
    assert tag == mms.RESPONSE
    (_, deletable), (_, listed) = mms.elements(content)
    return deletable != b"\0", mms.variable_names(listed)


def values(client: Client, name: str) -> list[tuple[int, bytes]]:
    tag, ((_, content),) = client.ask(element(mms.READ, element(0xA1, element(0xA1, named(name)))))
    assert tag == mms.RESPONSE
    ((_, results),) = mms.elements(content)
    return mms.elements(results)


def own_names(client: Client) -> list[str]:
    """The association's own data sets."""
    asked = element(mms.NAME_LIST, element(0xA0, element(0x80, b"\2")), element(0xA1, element(0x82)))
    tag, ((_, content),) = client.ask(asked)
    assert tag == mms.RESPONSE
    return [text.decode() for _, text in mms.elements(mms.elements(content)[0][1])]


def put(client: Client, block: str, **attributes: bytes) -> list[tuple[int, bytes]]:
    return client.write(DOMAIN, *[(f"LLN0${block}${name}", value) for name, value in attributes.items()])


def text(value: str) -> bytes:
    return element(0x8A, value.encode())


def told(client: Client) -> tuple[list[int], list[tuple[int, bytes]], list[int]]:
    """Which members a report has, their values, and why."""
    _, _, inclusion, *rest = client.report()
    included = [i for i in range(8 * (len(inclusion[1]) - 1)) if inclusion[1][1 + i // 8] & 0x80 >> i % 8]
    return included, rest[: len(included)], [reason[1][1] for reason in rest[len(included) :]]


# ---- who makes them ---------------------------------------------------------------------------------


def wait_same_values(plant: Plant, client: Client, name: str, wanted: list[str]) -> None:
    """What the data set has is what its members have, as soon as the server has the first events."""
    variables = [(DOMAIN, member) for member in wanted]
    plant.gateway.wait_for(
        lambda: values(client, name) == client.values(*variables), 20.0, f"{name}'s values"
    )


def test_a_client_makes_one_for_all(plant: Plant) -> None:
    wanted = ["GGIO1$ST$Ind10001", "GGIO1$ST$Ind10002$stVal", "GGIO1$ST$Ind10002$q"]
    with plant.client() as client, plant.client() as other:
        define(client, "LLN0$Mine", *wanted)
        for each in (client, other):
            assert each.names(2, DOMAIN) == [OWN, "LLN0$Mine"]
            assert members(each, "LLN0$Mine") == (True, wanted)
            wait_same_values(plant, each, "LLN0$Mine", wanted)
        assert members(client, OWN)[0] is False
        assert mms.refusal(client.ask(definition("LLN0$Mine", *wanted))) == EXISTS
        assert mms.refusal(client.ask(definition(OWN, *wanted))) == EXISTS
        assert deleted(other, "LLN0$Mine", "LLN0$Lost", OWN) == (2, 1)
        assert client.names(2, DOMAIN) == [OWN]
        assert mms.refusal(client.ask(element(mms.LIST_ATTRIBUTES, named("LLN0$Mine")))) == NOT_THERE
        define(client, "GGIO1$Mine", *wanted)
    with plant.client() as later:  # it outlives its client
        assert deleted(later, "GGIO1$Mine") == (1, 1)


def test_a_client_makes_one_for_itself(plant: Plant) -> None:
    with plant.client() as other:
        for _ in range(LISTS + 1):  # it ends with its client
            with plant.client() as client:
                define(client, "@Own", "GGIO1$ST$Ind10001")
                assert own_names(client) == ["Own"] and own_names(other) == []
                assert members(client, "@Own") == (True, ["GGIO1$ST$Ind10001"])
                assert mms.refusal(other.ask(element(mms.LIST_ATTRIBUTES, named("@Own")))) == NOT_THERE
                assert deleted(other, "@Own") == (0, 0)
                assert client.names(2, DOMAIN) == [OWN]


def test_there_is_room_for_some(plant: Plant) -> None:
    names = [f"LLN0$Set{i}" for i in range(LISTS)]
    many = [f"GGIO1$ST$Ind{10001 + i}" for i in range(MEMBERS + 1)]
    with plant.client() as client:
        assert mms.refusal(client.ask(definition(names[0], *many))) == NO_ROOM
        for name in names:
            define(client, name, *many[:MEMBERS])
        assert mms.refusal(client.ask(definition("LLN0$More", *many[:1]))) == NO_ROOM
        assert mms.refusal(client.ask(definition("@More", *many[:1]))) == NO_ROOM
        assert client.names(2, DOMAIN) == [OWN, *names]
        assert deleted(client, *names) == (LISTS, LISTS)


def test_what_cannot_be_in_one_is_refused(plant: Plant) -> None:
    good = "GGIO1$ST$Ind10001"
    with plant.client() as client:
        for name, listed, why in (
            ("LLN0$X", (good, "GGIO1$ST$Ind99"), UNDEFINED),
            ("LLN0$X", (good, "LLN0$RP$urcbParts01"), INCONSISTENT),
            ("LLN0$X", (good, "LLN0$ST$Health"), INCONSISTENT),
            ("LLN0$X", (good, "GGIO1$DC$Ind10001$d"), INCONSISTENT),
            ("LLN0$X", (good, "GGIO1$ST"), INCONSISTENT),
            ("LLN0$X", (good, "GGIO1"), INCONSISTENT),
            ("LLN0$X", (), INCONSISTENT),
            ("LLN0$", (good,), INCONSISTENT),
            ("LLN0", (good,), INCONSISTENT),
            ("$", (good,), INCONSISTENT),
            ("GGIO9$X", (good,), INCONSISTENT),
            ("LLN0$X$Y", (good,), INCONSISTENT),
            ("LLN0$" + 33 * "X", (good,), INCONSISTENT),
            ("@" + 33 * "X", (good,), INCONSISTENT),
            ("@1X", (good,), INCONSISTENT),
        ):
            assert mms.refusal(client.ask(definition(name, *listed))) == why, (name, listed)
        assert mms.refusal(client.ask(definition("LLN0$X", good, domain=OTHER))) == INCONSISTENT
        part = element(mms.SEQUENCE, element(0xA0, mms.name(DOMAIN, good)), element(0xA5))
        for listed, tag in ((part, mms.ERROR), (element(0x31), mms.REJECT), (b"\x30\x7f", mms.REJECT)):
            asked = element(mms.LIST_DEFINE, named("LLN0$X"), element(0xA0, listed))
            assert client.ask(asked)[0] == tag
        for broken in (b"", named("LLN0$X"), element(0xA0)):
            assert client.ask(element(mms.LIST_DEFINE, broken))[0] in (mms.ERROR, mms.REJECT)
        for broken in (b"", element(0x80, b"\0"), element(0xA1, b"\xa1\x7f")):
            assert client.ask(element(mms.LIST_DELETE, broken))[0] == mms.REJECT
        assert mms.refusal(client.ask(element(mms.LIST_DELETE, element(0x80, b"\2")))) == NO_ACCESS
        assert client.names(2, DOMAIN) == [OWN] and own_names(client) == []


# ---- reports ----------------------------------------------------------------------------------------


def test_an_unbuffered_block_takes_it(plant: Plant) -> None:
    """Its ConfRev is another one then, and nobody deletes what a block has."""
    block = "RP$urcbParts01"
    wanted = ["GGIO1$ST$Ind10003$stVal", "GGIO1$ST$Ind10002"]
    with plant.client() as client:
        define(client, "GGIO1$Mine", *wanted)
        (before,) = client.values((DOMAIN, f"LLN0${block}$ConfRev"))
        assert put(client, block, DatSet=text(f"{DOMAIN}/GGIO1$Mine")) == [DONE]
        of, now = client.values(*[(DOMAIN, f"LLN0${block}${name}") for name in ("DatSet", "ConfRev")])
        assert of[1].decode() == f"{DOMAIN}/GGIO1$Mine" and now != before
        assert deleted(client, "GGIO1$Mine") == (1, 0)
        assert put(client, block, RptEna=YES, GI=YES) == [DONE, DONE]
        included, shown, reasons = told(client)
        assert (included, reasons) == ([0, 1], [GENERAL] * 2)
        assert [shown[0], mms.elements(shown[1][1])[0]] == [(0x83, b"\0")] * 2
        plant.lines.set(LINE, "discrete_inputs", 1, 1)
        included, (value,), reasons = told(client)
        assert (included, mms.elements(value[1])[0], reasons) == ([1], (0x83, b"\1"), [DATA_CHANGE])
        plant.lines.set(LINE, "discrete_inputs", 2, 1)
        assert told(client) == ([0], [(0x83, b"\1")], [DATA_CHANGE])
        assert put(client, block, DatSet=text(f"{DOMAIN}/{OWN}")) == [(0x80, b"\2")]  # it is enabled
        assert put(client, block, RptEna=NO, DatSet=text(f"{DOMAIN}/{OWN}")) == [DONE, DONE]
        assert deleted(client, "GGIO1$Mine") == (1, 1)
        assert put(client, block, DatSet=text(f"{DOMAIN}/GGIO1$Mine")) == [WRONG]


def test_a_buffered_block_keeps_its_own(plant: Plant) -> None:
    with plant.client() as client:
        define(client, "@Own", "GGIO1$ST$Ind10001")
        assert put(client, "BR$brcbParts01", DatSet=text("@Own")) == [WRONG]
        assert put(client, "BR$brcbParts01", DatSet=text(f"{DOMAIN}/{OWN}")) == [DONE]


@pytest.mark.parametrize("given_back", [True, False])
def test_what_was_an_associations_own_is_nobody_elses(plant: Plant, given_back: bool) -> None:
    """A block that had it has its own data set again, whether its client gave it back or is just gone."""
    block, own = "RP$urcbParts02", text(f"{DOMAIN}/{OWN}")
    with plant.client() as other:
        with plant.client() as client:
            define(client, "@Own", "GGIO1$ST$Ind10001")
            assert put(client, block, Resv=YES, DatSet=text("@Own"), RptEna=YES) == [DONE] * 3
            assert client.values((DOMAIN, f"LLN0${block}$DatSet")) == [(0x8A, b"@Own")]
            assert deleted(client, "@Own") == (1, 0)
            if given_back:
                assert put(client, block, RptEna=NO, Resv=NO) == [DONE] * 2
                assert put(other, block, DatSet=text("@Own")) == [WRONG]
                assert other.values((DOMAIN, f"LLN0${block}$DatSet")) == [(own[0], own[2:])]
                assert put(other, block, Resv=NO) == [DONE]
        shown = (DOMAIN, f"LLN0${block}$DatSet")
        plant.gateway.wait_for(lambda: other.values(shown) == [(own[0], own[2:])], 20, "its client is gone")
        assert put(other, block, RptEna=YES, GI=YES) == [DONE] * 2
        assert told(other)[0] == [0, 1, 2, 3]
        assert put(other, block, RptEna=NO, Resv=NO) == [DONE] * 2


@pytest.mark.parametrize("block", ["RP$urcbParts01", "BR$brcbParts01"])
def test_an_attribute_is_told_for_its_own_reason(plant: Plant, block: str) -> None:
    """A value when it changes, a quality when that does, a time with neither; a data object with each."""
    first = 1 - plant.lines.get(LINE, "discrete_inputs", 0)
    with plant.client() as client:
        if block[0] == "B":
            assert put(client, block, PurgeBuf=YES) == [DONE]
        assert put(client, block, RptEna=YES) == [DONE]
        plant.lines.set(LINE, "discrete_inputs", 0, first)
        assert told(client) == ([0], [(0x83, bytes([first]))], [DATA_CHANGE])
        plant.gateway.kill("rtu-modbus-1")
        seen: list[tuple[int, int]] = []
        while {member for member, _ in seen} != {1, 3}:
            included, _, reasons = told(client)
            seen += list(zip(included, reasons, strict=True))
        assert {reason for _, reason in seen} == {QUALITY_CHANGE}
        plant.wait_all_good(CA)


def test_a_time_is_that_of_the_last_change(plant: Plant) -> None:
    """IEC 61850-7-3: of a value that the gateway reads again and again, as reports, GI and clients see it."""
    block, changed = "RP$urcbParts01", 1 - plant.lines.get(LINE, "discrete_inputs", 0)
    times = []
    with plant.client() as client:
        assert put(client, block, RptEna=YES) == [DONE]
        plant.set_and_scan(LINE, "discrete_inputs", 0, [changed])
        assert told(client) == ([0], [(0x83, bytes([changed]))], [DATA_CHANGE])
        for _ in range(3):
            assert put(client, block, GI=YES) == [DONE]
            included, (value, _, moment, _), _ = told(client)
            assert (included, value) == ([0, 1, 2, 3], (0x83, bytes([changed])))
            times += [moment, *client.values((DOMAIN, "GGIO1$ST$Ind10001$t"))]
            plant.set_and_scan(LINE, "discrete_inputs", 0, [changed])
        assert len(set(times)) == 1
        plant.set_and_scan(LINE, "discrete_inputs", 0, [1 - changed])
        assert told(client)[0] == [0]
        (later,) = client.values((DOMAIN, "GGIO1$ST$Ind10001$t"))
    assert later[1] > times[0][1]


# ---- foreign clients --------------------------------------------------------------------------------


@pytest.mark.slow
def test_libiec61850_makes_and_deletes_some(plant: Plant, tmp_path: Path) -> None:
    """And tshark understands each frame."""
    record: list[Connection] = []
    relay = Relay(("127.0.0.1", plant.port), record)
    references = [f"{DOMAIN}/LLN0.Parts", f"{DOMAIN}/LLN0.Copy", f"{DOMAIN}/GGIO1.Copy", "@Copy"]
    command = [sys.executable, "-m", "peers.libiec61850_lists", str(relay.address[1]), *references]
    run = subprocess.run(
        command, cwd=TESTS, env=PATHS, capture_output=True, text=True, timeout=120, check=False
    )
    relay.close()
    assert run.returncode == 0, run.stderr + run.stdout
    parts = [".stVal", ".q", ".t"]
    wanted = [f"{DOMAIN}/GGIO1.Ind10001{part}[ST]" for part in parts] + [f"{DOMAIN}/GGIO1.Ind10002[ST]"]
    assert json.loads(run.stdout) == {reference: wanted for reference in references}
    answered, findings = dissect_mms(record, tmp_path / "mms.pcap")
    assert findings == []
    assert {"11", "12", "13"} <= set(answered)


def test_the_rust_client_reads_and_deletes_one(plant: Plant) -> None:
    """It makes none: it takes 8b, the tag of the answer's NULL, for a wrong one."""
    reference = f"{DOMAIN}/LLN0.Rust"

    async def use() -> tuple[Any, list[Any], bool, bool]:
        connection = await IedConnection.connect(f"127.0.0.1:{plant.port}")
        found = await connection.get_data_set_directory(reference)
        read = await connection.get_data_set_values(reference)
        gone = await connection.delete_data_set(reference)
        fixed = await connection.delete_data_set(f"{DOMAIN}/LLN0.Parts")
        await connection.disconnect()
        return found, read, gone, fixed

    with plant.client() as client:
        define(client, "LLN0$Rust", "GGIO1$ST$Ind10001", "GGIO1$ST$Ind10002$stVal")
    found, read, gone, fixed = asyncio.run(asyncio.wait_for(use(), 20))
    assert [(member.object_ref, member.fc) for member in found.members] == [
        (f"{DOMAIN}/GGIO1.Ind10001", FC.ST),
        (f"{DOMAIN}/GGIO1.Ind10002.stVal", FC.ST),
    ]
    assert len(read) == 2 and isinstance(read[1], bool)
    assert (gone, fixed) == (True, False)
