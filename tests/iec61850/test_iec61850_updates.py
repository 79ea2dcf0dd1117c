# SPDX-License-Identifier: GPL-3.0-or-later
"""Reports tell beside a new value: transInd of a tap changer that moves, dupd of one that stays, ranges."""

import asyncio
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from test_iec61850 import browsed

from iec61850 import FC, IedConnection
from lab.gateway import free_port
from peers import mms
from peers.mms import DONE, Client, element
from rig.desk import Substation, gateway_on_lines, patience

pytestmark = pytest.mark.slow

CA, LINE, DOMAIN = 1005, "1.5", "OpenRTUCA1005"
TAP, COUNTER = "T1YLTC1$ST$TapPos", "T1MMTR1$ST$SupWh"
YES = bytes.fromhex("8301ff")
LEVEL, LIMITS = "AnIn30001", {"high_high": 100, "high": 90, "low": 10, "low_low": 0}
DATA_CHANGE, UPDATE = 0x40, 0x10
WITH_REASON = bytes.fromhex("061000")


def configuration(port: int) -> dict[str, Any]:
    registers = [
        {"address": 0, "type": "step", "name": "tap", "ln": "T1YLTC1.TapPos"},
        {"address": 1, "type": "counter", "name": "energy", "freeze_s": 1, "ln": "T1MMTR1.SupWh"},
    ]
    level = {"address": 0, "type": "scaled", "signed": True, "name": "level", "deadband": 50}
    chosen = {"triggers": ["dchg"], "options": ["reasonCode"]}
    blocks = [{"name": "urcbRange"} | chosen, {"name": "brcbRange", "buffered": True} | chosen]
    slaves = [
        {"id": 5, **patience(), "input_registers": registers},
        {"id": 6, **patience(), "input_registers": [level]},
    ]
    pace = {"baud_rate": 38400, "data_bits": 8, "stop_bits": 1, "parity": 0}
    return {
        "iec61850": {
            "address": "127.0.0.1",
            "port": port,
            "limits": [{"point": "level", **LIMITS}],
            "data_sets": [{"name": "Range", "points": ["level[range]"], "reports": blocks}],
        },
        "port": [{"value": 1, "active": 1, **pace, "slaves": slaves}],
    }


@pytest.fixture(scope="module")
def port(programs: Path) -> Iterator[tuple[Substation, int]]:
    number = free_port()
    with gateway_on_lines(configuration(number), programs, initial={}) as (lines, gateway):
        station = Substation(lines, gateway)
        station.wait_all_good(CA)
        station.wait_all_good(1006)
        yield station, number


def members(client: Client) -> list[str]:
    tag, ((_, content),) = client.ask(element(mms.LIST_ATTRIBUTES, mms.name(DOMAIN, "LLN0$status")))
    assert tag == mms.RESPONSE
    return mms.variable_names(mms.elements(content)[1][1])


def enable(client: Client, block: str, trigger: int) -> None:
    chosen = [("OptFlds", element(0x84, WITH_REASON)), ("TrgOps", element(0x84, bytes([2, trigger])))]
    for name, value in [*chosen, ("RptEna", YES)]:
        assert client.write(DOMAIN, (f"LLN0${block}${name}", value)) == [DONE], name


def told(client: Client) -> tuple[str, int, list[tuple[int, bytes]], int]:
    """Of a report of one member: its block, which member, what, why."""
    name, options, inclusion, value, reason = client.report()
    assert options[1] == WITH_REASON
    (member,) = [i for i in range(8) if inclusion[1][1] & 0x80 >> i]
    return name[1].decode().rpartition("$")[2], member, mms.elements(value[1]), reason[1][1]


def position(client: Client) -> list[tuple[int, bytes]]:
    ((_, value),) = client.values((DOMAIN, f"{TAP}$valWTr"))
    return mms.elements(value)


def test_a_tap_changer_that_moves_is_in_transit(port: tuple[Substation, int]) -> None:
    """The transient bit is of the value: it changes alone, and that is a change of data."""
    station, number = port
    with Client(number) as client:
        at = members(client).index(TAP)
        enable(client, "RP$urcbStatus01", DATA_CHANGE)
        for octet, value, moves in ((0x85, b"\5", b"\1"), (0x05, b"\5", b"\0"), (0x7F, b"\xff", b"\0")):
            station.lines.set(LINE, "input_registers", 0, octet)
            block, member, (first, *_), reason = told(client)
            assert (block, member, reason) == ("urcbStatus01", at, DATA_CHANGE)
            assert mms.elements(first[1]) == [(0x85, value), (0x83, moves)] == position(client)


@pytest.mark.sample(2)
@pytest.mark.parametrize(("block", "reading"), [("RP$urcbStatus01", 100), ("BR$brcbStatus01", 200)])
def test_an_update_without_a_change_is_dupd(port: tuple[Substation, int], block: str, reading: int) -> None:
    """A counter is frozen each second: who wants dupd hears of it; who wants dchg, of a change alone."""
    station, number = port
    with Client(number) as client:
        at = members(client).index(COUNTER)
        enable(client, f"{block[:-2]}02", DATA_CHANGE)
        enable(client, block, UPDATE)
        for _ in range(8):  # the first freeze, and what is kept of before, are changes
            name, member, _, reason = told(client)
            if reason == UPDATE:
                break
        assert (name, member, reason) == (block[3:], at, UPDATE)
        station.lines.set(LINE, "input_registers", 2, reading)
        seen = [told(client) for _ in range(4)]
        (value,) = [value for _, _, value, reason in seen if reason == DATA_CHANGE]
        assert int.from_bytes(value[0][1], "big") == reading
        told_by = {(name, reason) for name, _, _, reason in seen}
        assert told_by == {(block[3:], UPDATE), (f"{block[3:-2]}02", DATA_CHANGE)}


# ---- ranges -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("block", ["RP$urcbRange01", "BR$brcbRange01"])
def test_a_range_is_told_when_it_is_another_one(port: tuple[Substation, int], block: str) -> None:
    """Within the deadband too; another value of the same range is none of its changes."""
    station, number = port
    station.set_and_scan("1.6", "input_registers", 0, [50])
    with Client(number) as client:
        for name in ("PurgeBuf", "RptEna") if block[0] == "B" else ("RptEna",):
            assert client.write("OpenRTUCA1006", (f"LLN0${block}${name}", YES)) == [DONE], name
        for level in (91, 100, 101, 100, 90, 60, 0xFFFF, 0xFF00, 0, 10, 12, 90, 50):
            station.set_and_scan("1.6", "input_registers", 0, [level])
        reports = [client.report() for _ in range(7)]
    told = [(value[1][0], reason[1][1]) for _, _, _, value, reason in reports]
    assert told == [(number, DATA_CHANGE) for number in (1, 3, 1, 0, 4, 2, 0)]


def test_foreign_clients_read_range_and_limits(port: tuple[Substation, int]) -> None:
    station, number = port
    station.set_and_scan("1.6", "input_registers", 0, [5])
    values = browsed(number)["OpenRTUCA1006"]["values"]
    least, most = (pytest.approx(sign * 3.4028235e38) for sign in (-1, 1))
    limits = [[100], [90], [10], [0], [least], [most]]
    assert values[f"GGIO1$MX${LEVEL}"][:2] == [[5], 2]
    assert values[f"GGIO1$CF${LEVEL}"] == [100_000, 50, limits]

    async def read() -> list[Any]:
        connection = await IedConnection.connect(f"127.0.0.1:{number}")
        of = f"OpenRTUCA1006/GGIO1.{LEVEL}"
        found = [await connection.read(f"{of}.range", FC.MX), await connection.read(f"{of}.rangeC", FC.CF)]
        await connection.disconnect()
        return found

    assert asyncio.run(asyncio.wait_for(read(), 20)) == [2, limits]


def test_another_limit_is_in_force_after_a_reload(port: tuple[Substation, int]) -> None:
    """For clients, and for the owner of the point, who tells that it is crossed."""
    station, number = port
    config = station.gateway.configuration()
    config["iec61850"]["limits"] = [{"point": "level", **LIMITS, "high": 60}]
    station.gateway.ctl("reload", station.gateway.put(config))

    def limit() -> float:
        try:
            with Client(number) as client:
                ((_, octets),) = client.values(("OpenRTUCA1006", f"GGIO1$CF${LEVEL}$rangeC$hLim$f"))
                return float(struct.unpack(">f", octets[1:])[0])
        except (OSError, AssertionError, ValueError):
            return 0  # it ends, or has not begun

    station.gateway.wait_for(lambda: limit() == 60, 20, "the other limit is there")
    station.wait_all_good(1006)
    for level in (200, 50):  # beyond the deadband, then the value of the last event
        station.set_and_scan("1.6", "input_registers", 0, [level])
    with Client(number) as client:
        assert client.write("OpenRTUCA1006", ("LLN0$RP$urcbRange01$RptEna", YES)) == [DONE]
        station.set_and_scan("1.6", "input_registers", 0, [61])
        _, _, _, value, _ = client.report()
    assert value == (0x85, b"\1")
