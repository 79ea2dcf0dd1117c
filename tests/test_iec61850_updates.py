# SPDX-License-Identifier: GPL-3.0-or-later
"""What reports tell beside a new value: transInd of a tap changer that moves, dupd of a value that stays."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from desk import Substation, gateway_on_lines
from lab.gateway import free_port
from peers import mms
from peers.mms import DONE, Client, element

CA, LINE, DOMAIN = 1005, "1.5", "OpenRTUCA1005"
TAP, COUNTER = "T1YLTC1$ST$TapPos", "T1MMTR1$ST$SupWh"
YES = bytes.fromhex("8301ff")
DATA_CHANGE, UPDATE = 0x40, 0x10
WITH_REASON = bytes.fromhex("061000")


def configuration(port: int) -> dict[str, Any]:
    registers = [
        {"address": 0, "type": "step", "name": "tap", "ln": "T1YLTC1.TapPos"},
        {"address": 1, "type": "counter", "name": "energy", "freeze_s": 1, "ln": "T1MMTR1.SupWh"},
    ]
    slave = {"id": 5, "input_registers": registers}
    pace = {"baud_rate": 38400, "data_bits": 8, "stop_bits": 1, "parity": 0}
    return {
        "iec61850": {"address": "127.0.0.1", "port": port},
        "port": [{"value": 1, "active": 1, **pace, "slaves": [slave]}],
    }


@pytest.fixture(scope="module")
def port(programs: Path) -> Iterator[tuple[Substation, int]]:
    number = free_port()
    with gateway_on_lines(configuration(number), programs, initial={}) as (lines, gateway):
        station = Substation(lines, gateway)
        station.wait_all_good(CA)
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
