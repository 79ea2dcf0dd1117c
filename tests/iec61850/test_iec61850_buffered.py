# SPDX-License-Identifier: GPL-3.0-or-later
"""Buffered reports of IEC 61850: each change once, in order, whatever becomes of client and module."""

import asyncio
import json
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from iec61850 import ClientReport, IedConnection, RcbWriteMask, TriggerOptions
from lab.gateway import Gateway, free_port, listening_on, remove, run_directory
from peers import mms
from peers.mms import DONE, Client, element
from peers.outstation import INTERROGATED, Outstation, asdu, time56
from rig.desk import Substation, gateway_on_lines
from rig.reports import (
    BLOCK,
    CA,
    DEVICE,
    DOMAIN,
    INPUTS,
    KEPT,
    NO,
    NOTHING,
    YES,
    Entry,
    begin,
    configuration,
    nothing_more,
    put,
    taken,
)

INVALID, BUSY = (0x80, b"\x0b"), (0x80, b"\2")


@dataclass
class Plant(Substation):
    """The gateway, its one device, and the port of its server."""

    port: int
    on: bool = False

    def change(self) -> None:
        """All inputs together, and the gateway has read them."""
        self.on = not self.on
        self.lines.set(DEVICE, "discrete_inputs", 0, *[int(self.on)] * INPUTS)
        wanted = ["off", "on"][self.on]

        def read() -> bool:
            return all(point["value"] == wanted for point in self.gateway.points().values())

        self.gateway.wait_for(read, 60.0, f"all inputs are {wanted}")

    def restart(self, change: bool = False) -> None:
        """Kills the module. change: while it does not run."""
        before = self.gateway.modules()["rtu-iec61850"]["pid"]
        self.gateway.kill("rtu-iec61850")
        if change:
            self.change()

        def runs() -> bool:
            module = self.gateway.modules()["rtu-iec61850"]
            return module["state"] == "running" and module["pid"] not in (0, before)

        self.gateway.wait_for(runs, 60.0, "it runs again")


@pytest.fixture(scope="module")
def running(programs: Path) -> Iterator[Plant]:
    port = free_port()
    with gateway_on_lines(configuration(port), programs, initial={}) as (lines, gateway):
        plant = Plant(lines, gateway, port)
        plant.wait_all_good(CA)
        yield plant


@pytest.fixture
def plant(running: Plant) -> Plant:
    """Nothing is kept for the block."""
    with Client(running.port) as client:
        put(client, PurgeBuf=YES)
    return running


def check_order(entries: list[Entry], first: bool) -> None:
    """No entry is missing or there twice; each input goes on and off in turn."""
    assert [entry.place - entries[0].place for entry in entries] == list(range(len(entries)))
    for member in range(INPUTS):
        states = [entry.on for entry in entries if entry.member == member]
        assert states == [first ^ bool(i % 2) for i in range(len(states))]


def test_what_happens_without_a_client_is_kept(plant: Plant) -> None:
    first = not plant.on
    plant.change()
    plant.change()
    with Client(plant.port) as client:
        begin(client)
        entries = taken(client, 2 * INPUTS)
        check_order(entries, first)
        assert [entry.number for entry in entries] == list(range(2 * INPUTS))
        assert not any(entry.lost for entry in entries)
        assert {entry.reason for entry in entries} == {0x40}
        assert nothing_more(client)
        plant.change()
        live = taken(client, INPUTS)
        check_order(entries + live, first)
        assert client.values((DOMAIN, f"{BLOCK}$EntryID")) == [(0x89, live[-1].key)]
    with Client(plant.port) as client:  # what was told is not told again, but for who asks
        begin(client)
        assert nothing_more(client)
        put(client, RptEna=NO)
        begin(client, entries[4].key)
        again = taken(client, 3 * INPUTS - 5)
        assert [entry.key for entry in again] == [entry.key for entry in (entries + live)[5:]]
        put(client, RptEna=NO)
        begin(client, NOTHING)
        assert [entry.key for entry in taken(client, 3 * INPUTS)] == [entry.key for entry in entries + live]
        assert nothing_more(client)


def test_an_event_of_before_is_told_and_then_the_state_again(programs: Path) -> None:
    """An outstation that tells what it had kept; a client that keeps the last report has the state."""
    port, directory = free_port(), run_directory()
    point = {"type": "single", "ioa": 1, "name": "breaker"}
    with Outstation() as town:
        town.interrogated = [asdu(1, INTERROGATED, 1, (1, b"\x01"))]
        station = {
            "name": "town",
            "addresses": ["127.0.0.1"],
            "port": town.port,
            "sets": [{"ca": 501, "remote_ca": 1, "points": [point]}],
        }
        config = listening_on({"port": [], "outstations": [station]}, free_port())
        config["iec61850"] = {"address": "127.0.0.1", "port": port}
        with Gateway(config, directory, programs) as gateway, Client(port) as client:
            gateway.wait_for(lambda: gateway.points()["breaker"]["quality"] == "good", 60.0, "it is known")
            domain, block = "OpenRTUCA501", "LLN0$BR$brcbStatus01"
            for name, value in (("PurgeBuf", YES), ("RptEna", YES)):
                assert client.write(domain, (f"{block}${name}", value)) == [DONE]
            old = datetime.now(UTC) - timedelta(seconds=60)
            town.say(30, 1, (1, b"\x00" + time56(old)))
            values = [mms.elements(client.report()[7][1]) for _ in range(2)]
    remove(directory)
    assert [state[1] != b"\0" for state, _, _ in values] == [False, True]
    first, second = (int.from_bytes(moment[1][:4], "big") for _, _, moment in values)
    assert first == int(old.timestamp()) and second >= first + 50


@pytest.mark.slow
def test_kills_lose_and_repeat_nothing(plant: Plant) -> None:
    """The module dies between changes, and while it tells them; the client goes on behind what it has."""
    first = not plant.on
    entries: list[Entry] = []
    for round_ in range(3):
        plant.change()
        with Client(plant.port) as client:
            begin(client, entries[-1].key if entries else None)
            entries += taken(client, 7 + round_)
            plant.restart()
            assert client.is_closed()
        plant.restart(change=True)
    with Client(plant.port) as client:
        begin(client, entries[-1].key)
        entries += taken(client, 6 * INPUTS - len(entries))
        assert nothing_more(client)
    check_order(entries, first)
    assert not any(entry.lost for entry in entries)


@pytest.mark.slow
def test_rtuctl_shows_what_waits(plant: Plant) -> None:
    """The queue of a block stays when its client has gone, until all was told."""

    def queue() -> dict[str, Any]:
        (found,) = plant.gateway.query("iec61850")
        return next((row for row in found["queues"] if row["block"] == f"{DOMAIN}/{BLOCK}"), {})

    def shown(**wanted: object) -> dict[str, Any]:
        plant.gateway.wait_for(lambda: wanted.items() <= queue().items(), 10, f"the queue has {wanted}")
        return queue()

    told = {"waiting": 0, "oldest_s": None, "overflow": False, "limit": KEPT}
    with Client(plant.port) as client:
        begin(client)
        shown(**told, peer="127.0.0.1", enabled=True)
    shown(**told, peer="", enabled=False)
    plant.change()
    first = shown(waiting=INPUTS, overflow=False)
    assert first["oldest_s"] > 0 and INPUTS <= first["kept"] <= KEPT
    plant.restart()
    assert shown(waiting=INPUTS, overflow=False, peer="")["oldest_s"] > first["oldest_s"]
    for _ in range(KEPT // INPUTS):
        plant.change()
    shown(waiting=KEPT, overflow=True, kept=KEPT)
    assert f"{DOMAIN}/{BLOCK}" in plant.gateway.ctl("iec61850", "queues")
    with Client(plant.port) as client:
        begin(client)
        taken(client, KEPT)
        shown(**told, peer="127.0.0.1", enabled=True, kept=KEPT)


def test_an_overflow_is_told_once(plant: Plant) -> None:
    plant.change()
    with Client(plant.port) as client:
        begin(client)
        old = taken(client, INPUTS)[0]
    for _ in range(1 + KEPT // INPUTS):
        plant.change()
    with Client(plant.port) as client:
        assert client.write(DOMAIN, (f"{BLOCK}$EntryID", element(0x89, old.key))) == [INVALID]
        begin(client)
        entries = taken(client, KEPT)
        assert [entry.lost for entry in entries] == [True] + (KEPT - 1) * [False]
        assert nothing_more(client)


def test_a_purge_and_other_settings_empty_the_block(plant: Plant) -> None:
    def bits(value: int) -> bytes:
        return element(0x84, bytes([2, value]))

    with Client(plant.port) as client:
        plant.change()
        put(client, TrgOps=bits(0x60), BufTm=bytes.fromhex("860100"))  # as they are
        begin(client)
        key = taken(client, INPUTS)[-1].key
        for attribute, value in (("PurgeBuf", YES), ("EntryID", element(0x89, key)), ("TrgOps", bits(0x40))):
            assert client.write(DOMAIN, (f"{BLOCK}${attribute}", value)) == [BUSY]
        put(client, RptEna=NO)
        for name, value in (("PurgeBuf", YES), ("TrgOps", bits(0x20)), ("TrgOps", bits(0x60))):
            plant.change()
            put(client, **{name: value})
            begin(client)
            assert nothing_more(client)
            put(client, RptEna=NO)
        ahead = key[:4] + b"\x7f\xff\xff\xff"
        for wrong in (key, b"\1" + key[1:], ahead):
            assert client.write(DOMAIN, (f"{BLOCK}$EntryID", element(0x89, wrong))) == [INVALID]
        for wrong in (key[:7], key + b"\0"):
            assert client.write(DOMAIN, (f"{BLOCK}$EntryID", element(0x89, wrong)))[0][0] == 0x80


def test_a_dead_line_is_kept_and_asked_for(plant: Plant) -> None:
    """What is not valid any more is a change of quality. GI comes behind what is kept, and has all."""
    with Client(plant.port) as client:
        put(client, TrgOps=element(0x84, b"\2\x64"))
        plant.gateway.kill("rtu-modbus-1")
        plant.wait_all_good(CA)
        begin(client)
        entries = taken(client, 2 * INPUTS)
        assert [entry.good for entry in entries] == INPUTS * [False] + INPUTS * [True]
        assert {entry.reason for entry in entries[:INPUTS]} == {0x20}
        put(client, GI=YES)
        *_, key, included, _, _ = client.report()[: -2 * (INPUTS - 1)]
        assert (key[1], included[1][1:]) == (entries[-1].key, b"\xff\xff\xf0")
        put(client, RptEna=NO, TrgOps=element(0x84, b"\2\x60"))


@pytest.mark.slow
def test_other_points_begin_anew(plant: Plant) -> None:
    """Two inputs leave the configuration and come back: what a client knew of the points is no more true."""
    plant.change()
    running = plant.gateway.configuration()
    fewer = json.loads(json.dumps(running))
    del fewer["port"][0]["slaves"][0]["discrete_inputs"][-2:]
    with Client(plant.port) as client:
        begin(client)
        key = taken(client, INPUTS)[-1].key
        plant.gateway.ctl("reload", plant.gateway.put(fewer))
        assert client.is_closed()
    plant.gateway.ctl("reload", plant.gateway.put(running))
    plant.wait_all_good(CA)
    with Client(plant.port) as client:
        assert client.write(DOMAIN, (f"{BLOCK}$EntryID", element(0x89, key))) == [INVALID]


def test_the_rust_client_takes_buffered_reports(plant: Plant) -> None:
    reference = f"{DOMAIN}/LLN0.BR.brcbStatus02"
    plant.change()

    async def reports_of(count: int) -> list[ClientReport]:
        connection = await IedConnection.connect(f"127.0.0.1:{plant.port}")
        block = await connection.get_rcb_values(reference)
        reports: asyncio.Queue[ClientReport] = asyncio.Queue()
        await connection.install_report_handler(reference, reports.put_nowait, rpt_id=block.rpt_id)
        block.rpt_ena = True
        await connection.set_rcb_values(block, RcbWriteMask.fields("rpt_ena"))
        while reports.qsize() < count:
            await connection.poll_reports(100)
        await connection.disconnect()
        return [reports.get_nowait() for _ in range(count)]

    reports = asyncio.run(asyncio.wait_for(reports_of(INPUTS), 20))
    keys = [bytes(report.entry_id) for report in reports]
    numbers = [int.from_bytes(key[4:], "big") for key in keys]
    assert numbers == list(range(numbers[0], numbers[0] + INPUTS))


@pytest.mark.slow
def test_the_rust_client_interrogates_a_buffered_block(plant: Plant) -> None:
    """GI and integrity reports have all members; the block is the client's for a while after it has gone."""
    reference = f"{DOMAIN}/LLN0.BR.brcbStatus02"

    async def reports_of() -> tuple[list[ClientReport], bytes, int]:
        connection = await IedConnection.connect(f"127.0.0.1:{plant.port}")
        block = await connection.get_rcb_values(reference)
        reports: asyncio.Queue[ClientReport] = asyncio.Queue()
        await connection.install_report_handler(reference, reports.put_nowait, rpt_id=block.rpt_id)
        block.resv_tms = 1
        await connection.set_rcb_values(block, RcbWriteMask.fields("resv_tms"))
        block.trigger_options = TriggerOptions(integrity=True, general_interrogation=True)
        block.integrity_period_ms = 100
        await connection.set_rcb_values(block, RcbWriteMask.fields("trigger_options", "integrity_period"))
        block.rpt_ena = block.gi = True
        await connection.set_rcb_values(block, RcbWriteMask.fields("rpt_ena"))
        await connection.set_rcb_values(block, RcbWriteMask.fields("gi"))
        while reports.qsize() < 3:
            await connection.poll_reports(100)
        shown = await connection.get_rcb_values(reference)
        await connection.disconnect()
        return [reports.get_nowait() for _ in range(3)], bytes(shown.owner), shown.resv_tms

    reports, owner, reserved = asyncio.run(asyncio.wait_for(reports_of(), 20))
    assert (owner, reserved) == (bytes([127, 0, 0, 1]), 1)
    assert [len(report.entries) for report in reports] == 3 * [INPUTS]
    reasons = [entry.reason for report in reports for entry in report.entries]
    assert all(reason.integrity or reason.general_interrogation for reason in reasons)
    assert any(reason.integrity for reason in reasons)
    assert any(reason.general_interrogation for reason in reasons)
    assert not any(reason.data_change or reason.quality_change for reason in reasons)
