# SPDX-License-Identifier: GPL-3.0-or-later
"""rtu-iec61850, as clients of others see it, libiec61850's and one in Rust, and as who means harm does."""

import asyncio
import json
import os
import socket
import struct
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from iec61850 import FC, ClientReport, IedConnection, RcbWriteMask, ReportOptFlds, TriggerOptions
from lab.gateway import free_port
from peers import mms
from peers.mms import Client
from rig.capture import Connection, dissect_mms
from rig.capture import Relay as Recorder
from rig.desk import Desk, chapter_5, desk_of

ASSOCIATIONS = 8
DOUBLES = ("intermediate", "off", "on", "indeterminate")
TESTS = Path(__file__).resolve().parents[1]
PATHS = os.environ | {"PYTHONPATH": str(TESTS.parent / "scripts")}


@dataclass
class Site:
    """A gateway, and the relay that records what its clients and it say."""

    desk: Desk
    port: int
    recorder: Recorder
    record: list[Connection]

    def client(self, max_pdu: int = 65000) -> Client:
        return Client(self.port, max_pdu)

    def counter(self, name: str) -> int:
        lines = self.desk.gateway.ctl("counters", "rtu-iec61850").splitlines()
        return int(next(line.split()[-1] for line in lines if line.split()[1:2] == [name]))

    def restarts(self) -> int:
        return int(self.desk.gateway.modules()["rtu-iec61850"]["restarts"])


@pytest.fixture(scope="module")
def site(programs: Path) -> Iterator[Site]:
    port = free_port()
    config = chapter_5() | {
        "iec61850": {
            "address": "127.0.0.1",
            "port": port,
            "associations": ASSOCIATIONS,
            "max_pdu": 2000,
            "controllers": ["127.0.0.1"],
        }
    }
    with desk_of(config, programs) as desk:
        record: list[Connection] = []
        recorder = Recorder(("127.0.0.1", port), record)
        yield Site(desk, port, recorder, record)
        recorder.close()
        assert desk.gateway.modules()["rtu-iec61850"]["restarts"] == 0


# ---- foreign clients --------------------------------------------------------------------------------


def browsed(port: int) -> dict[str, Any]:
    """What libiec61850's client finds."""
    command = [sys.executable, "-m", "peers.libiec61850_browse", str(port)]
    run = subprocess.run(
        command, cwd=TESTS, env=PATHS, capture_output=True, text=True, timeout=120, check=False
    )
    assert run.returncode == 0, run.stderr + run.stdout
    found: dict[str, Any] = json.loads(run.stdout)
    return found


def expected(point: dict[str, Any]) -> Any:
    """A point's value, as the first attribute of its data object has it."""
    kind, value = point["type"], point["value"]
    if kind == "single":
        return value == "on"
    if kind == "double":
        return DOUBLES.index(value)
    if kind == "bitstring":
        return value - 2**32 if value >= 2**31 else value  # an INT32 of the same bits
    if kind in ("step", "integer", "counter"):
        return int(value)
    return [pytest.approx(value, rel=1e-6)]


def objects_of(names: list[str]) -> dict[int, str]:
    """The data objects of points, by their IOA."""
    found = {}
    for name in names:
        node, *parts = name.split("$")
        if node == "GGIO1" and len(parts) == 2 and parts[0] in ("ST", "MX") and parts[1] != "Beh":
            found[int(parts[1].lstrip("ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz"))] = name
    return found


def check_point(point: dict[str, Any], name: str, value: list[Any]) -> None:
    shown, quality, time_ms, *selected = value
    assert selected in ([], [False])
    if point["quality"] == "good":
        assert shown == expected(point), (point, name)
        assert quality == 0 and time_ms > 1.6e12, (point, name)
    else:
        assert quality >> 11 in (1, 3), (point, name, quality)


@pytest.mark.slow
def test_libiec61850_reads_every_point_as_rtuctl_has_it(site: Site) -> None:
    gateway = site.desk.gateway
    for device in {1010, 2020}:
        site.desk.wait_all_good(device)
    seen = {}
    for device, found in browsed(site.recorder.address[1]).items():
        for ioa, name in objects_of(found["variables"]).items():
            seen[int(device.removeprefix("OpenRTUCA")), ioa] = name, found["values"][name]
    points = {(point["ca"], point["ioa"]): point for point in gateway.points().values()}
    assert seen.keys() == points.keys()
    assert {"good", "invalid"} <= {point["quality"] for point in points.values()}
    for key, (name, value) in seen.items():
        check_point(points[key], name, value)


def test_the_rust_client_browses_and_reads(site: Site) -> None:
    async def browse() -> tuple[list[str], dict[str, Any]]:
        connection = await IedConnection.connect(f"127.0.0.1:{site.recorder.address[1]}")
        devices = await connection.get_server_directory()
        model = await connection.get_device_model()
        breaker = await connection.read("OpenRTUCA1010/GGIO1.DPCSO1.stVal", FC.ST)
        name = await connection.read_string("OpenRTUCA1010/GGIO1.DPCSO1.d", FC.DC)
        await connection.disconnect()
        return devices, {"model": model, "breaker": breaker, "name": name}

    site.desk.wait_all_good(1010)
    devices, seen = asyncio.run(browse())
    with site.client() as client:
        assert devices == client.names(9)
        for device in seen["model"]["logical_devices"]:
            assert device["variables"] == client.names(0, device["name"])
    points = site.desk.gateway.points()
    assert (points[seen["name"]]["ca"], points[seen["name"]]["ioa"]) == (1010, 1)
    assert DOUBLES[seen["breaker"][0] >> 6] == points[seen["name"]]["value"]  # the bit string's octet


def command_once(client: Client) -> None:
    """A selection, its end, what is refused then, and a command to its termination."""
    cancel = mms.command(YES)
    for what, service in (("DPCSO1", "SBOw"), ("DPCSO1", "Cancel"), ("DPCSO1", "Oper"), ("SPCSO101", "Oper")):
        parts = cancel if service == "Cancel" else [*cancel, mms.CHECK]
        client.write(DEVICE, (f"GGIO1$CO${what}${service}", mms.element(0xA2, *parts)))
    assert client.termination()[0] == ["LastApplError"]
    assert client.termination()[0] == ["GGIO1$CO$SPCSO101$Oper"]


@pytest.mark.slow
def test_tshark_understands_every_frame(site: Site, tmp_path: Path) -> None:
    browsed(site.recorder.address[1])
    with Client(site.recorder.address[1], 1000) as client:
        client.names(0, "OpenRTUCA1010")
        client.ask(bytes([mms.STATUS, 1, 0]))
        client.ask(bytes([mms.IDENTIFY, 0]))
        client.values(("OpenRTUCA1010", "GGIO1$ST"), ("OpenRTUCA1010", "GGIO1$ST$None"))
        client.ask(mms.element(mms.TYPE, mms.element(0xA0, mms.name("OpenRTUCA1010", "LLN0"))))
        client.ask(mms.element(mms.TYPE, mms.element(0xA0, mms.name("OpenRTUCA1010", "XCBR1"))))
        client.ask(bytes([0xBF, 0x41, 0]))
        members(client, "LLN0$status")
        enable(client, 0x7CC0, "dchg", "qchg", "gi")
        client.write(DEVICE, (f"{BLOCK}$GI", YES))
        while client.report()[7][1] != b"\0":
            pass
        command_once(client)
        assert client.write(DEVICE, ("LLN0$BR$brcbStatus01$RptEna", YES)) == [mms.DONE]
        client.report()
        assert client.write(DEVICE, ("LLN0$BR$brcbStatus01$RptEna", NO)) == [mms.DONE]
        client.send(mms.tpkt(mms.data(bytes([mms.CONCLUDE, 0]))))
        while client.mms()[0] == mms.REPORT:
            pass
    answered, findings = dissect_mms(site.record, tmp_path / "mms.pcap")
    assert findings == []
    assert len(answered) > 50


# ---- names and types --------------------------------------------------------------------------------


def test_names_come_in_as_many_answers_as_they_need(site: Site) -> None:
    with site.client(1000) as narrow, site.client() as wide:
        for device in wide.names(9):
            whole = narrow.names(0, device)
            assert whole == wide.names(0, device)
            assert len(set(whole)) == len(whole)
        before = narrow.number
        narrow.names(0, "OpenRTUCA1010")
        assert narrow.number - before > 3
        tag, ((_, _error),) = narrow.ask(mms.name_list(0, "OpenRTUCA1010", "GGIO1$ST$None"))
        assert tag == mms.ERROR
        assert narrow.names(2, "OpenRTUCA1010") == ["LLN0$measured", "LLN0$status"]


@pytest.mark.slow
def test_a_value_is_what_its_type_says(site: Site) -> None:
    """Each variable's value has the shape of its type: as many parts in the same order, of the same tags."""

    def shape_of_type(octets: bytes) -> Any:
        ((tag, content),) = elements_of(octets)
        if tag != 0xA2:
            return 0x87 if tag == 0xA7 else tag
        ((_, components),) = elements_of(content)
        parts = []
        for _, component in elements_of(components):
            (_, name), (_, kind) = elements_of(component)
            assert name
            parts.append(shape_of_type(kind))
        return parts

    def shape_of_value(tag: int, content: bytes) -> Any:
        return [shape_of_value(*part) for part in elements_of(content)] if tag == 0xA2 else tag

    elements_of = mms.elements
    with site.client() as client:
        for device in client.names(9):
            for name in client.names(0, device):
                tag, ((_, content),) = client.ask(
                    mms.element(mms.TYPE, mms.element(0xA0, mms.name(device, name)))
                )
                value = client.ask(mms.read((device, name)))
                if mms.ERROR in (tag, value[0]):  # longer than a PDU
                    assert name.count("$") < 2
                    continue
                _, (_, kind) = elements_of(content)
                ((_, results),) = elements_of(value[1][0][1])
                assert shape_of_value(*elements_of(results)[0]) == shape_of_type(kind), name


def test_what_is_not_there_is_said_so(site: Site) -> None:
    non_existent, denied = (0x80, b"\x0a"), (0x80, b"\3")
    with site.client() as client:
        assert (
            client.values(
                ("OpenRTUCA1010", "GGIO1$ST$DPCSO1$stVal"),
                ("OpenRTUCA1010", "GGIO1$ST$DPCSO01"),
                ("OpenRTUCA1010", "GGIO1$MX$DPCSO1"),
                ("OpenRTUCA1010", "GGIO1$ST$DPCSO1$stVal$x"),
                ("OpenRTUCA1", "GGIO1"),
                ("", ""),
            )[1:]
            == [non_existent] * 5
        )
        variable = mms.element(
            mms.SEQUENCE, mms.element(0xA0, mms.name("OpenRTUCA1010", "GGIO1$ST$DPCSO1$stVal"))
        )
        write = mms.element(
            mms.WRITE, mms.element(0xA0, variable), mms.element(0xA0, bytes.fromhex("84020640"))
        )
        tag, ((_, results),) = client.ask(write)
        assert (tag, mms.elements(results)) == (mms.RESPONSE, [denied])


# ---- data sets and reports --------------------------------------------------------------------------

DEVICE, BLOCK = "OpenRTUCA1010", "LLN0$RP$urcbStatus01"
YES, NO = bytes.fromhex("8301ff"), bytes.fromhex("830100")
TRIGGERS = {"dchg": 0x40, "qchg": 0x20, "integrity": 0x08, "gi": 0x04}
TRANSIENT = (0x80, b"\2")  # temporarily unavailable
INVALID = (0x80, b"\x0b")  # the value


def bits(value: int, count: int) -> bytes:
    octets = (count + 7) // 8
    return mms.element(0x84, bytes([8 * octets - count]), value.to_bytes(octets, "big"))


def number(value: int) -> bytes:
    return mms.element(0x86, value.to_bytes(5, "big").lstrip(b"\0") or b"\0")


def enable(client: Client, options: int, *triggers: str, block: str = BLOCK, **more: int) -> None:
    """more: BufTm, IntgPd."""
    wanted = [(f"{block}${name}", number(value)) for name, value in more.items()]
    chosen = bits(sum(TRIGGERS[trigger] for trigger in triggers), 6)
    wanted += [(f"{block}$OptFlds", bits(options, 10)), (f"{block}$TrgOps", chosen), (f"{block}$RptEna", YES)]
    assert client.write(DEVICE, *wanted) == [mms.DONE] * len(wanted)


def members(client: Client, list_name: str) -> list[str]:
    return client.members(DEVICE, list_name)


def included(report: list[tuple[int, bytes]], at: int) -> list[int]:
    content = report[at][1]
    return [i for i in range(8 * (len(content) - 1)) if content[1 + i // 8] & 0x80 >> i % 8]


def test_a_data_set_is_read_as_a_whole(site: Site) -> None:
    site.desk.wait_all_good(1010)
    with site.client() as client:
        for list_name, constraint in (("LLN0$status", "ST"), ("LLN0$measured", "MX")):
            names = members(client, list_name)
            wanted = [name for name in client.names(0, DEVICE) if name.count("$") == 2]
            assert names == [
                name
                for name in wanted
                if name.startswith(f"GGIO1${constraint}$") and not name.endswith("$Beh")
            ]
            asked = mms.element(mms.READ, mms.element(0xA1, mms.element(0xA1, mms.name(DEVICE, list_name))))
            tag, ((_, content),) = client.ask(asked)
            assert tag == mms.RESPONSE
            ((_, results),) = mms.elements(content)
            assert len(mms.elements(results)) == len(names)


def told_of(client: Client, at: int, position: str) -> tuple[list[tuple[int, bytes]], int]:
    """
    The report that has the member where it is now, and why. On a busy host the device may be late meanwhile:
    then others are told of qualities, or one of several members at once.
    """
    wanted = (0x84, bytes([6, DOUBLES.index(position) << 6]))
    while True:
        report = client.report()
        chosen = included(report, 6)
        if at not in chosen:
            continue
        value, reason = report[7 + chosen.index(at)], report[7 + len(chosen) + chosen.index(at)]
        if mms.elements(value[1])[0] == wanted and reason[1][1] != TRIGGERS["qchg"]:
            return report, reason[1][1]


def test_a_change_is_reported_with_its_reason(site: Site) -> None:
    """A breaker moves: a report has its member, where it is now, and why. Then all, when asked for."""
    desk = site.desk
    desk.wait_all_good(1010)
    point = next(p for p in desk.gateway.points().values() if (p["ca"], p["ioa"]) == (1010, 1))
    with site.client() as client:
        at = members(client, "LLN0$status").index("GGIO1$ST$DPCSO1")
        enable(client, 0x7880, "dchg", "qchg", "gi")
        for position in ("off", "on") if point["value"] == "on" else ("on", "off"):
            desk.gateway.ctl("set", point["name"], position, "--select")
            report, reason = told_of(client, at, position)
            reference, options, _, entry, data_set, *_ = report
            assert reference[1].decode() == f"{DEVICE}/{BLOCK}"
            assert options[1] == b"\6\x78\x80" and len(entry[1]) == 6
            assert data_set[1].decode() == f"{DEVICE}/LLN0$status"
            assert reason & TRIGGERS["dchg"]
        assert client.write(DEVICE, (f"{BLOCK}$GI", YES)) == [mms.DONE]
        count = len(members(client, "LLN0$status"))
        while len(included(report := client.report(), 6)) != count:
            pass
        assert all(content[1] & TRIGGERS["gi"] for _, content in report[-count:])


def test_the_rust_client_takes_reports(site: Site) -> None:
    reference = f"{DEVICE}/LLN0.RP.urcbMeasured01"

    async def interrogate() -> ClientReport:
        connection = await IedConnection.connect(f"127.0.0.1:{site.port}")
        block = await connection.get_rcb_values(reference)
        reports: asyncio.Queue[ClientReport] = asyncio.Queue()
        await connection.install_report_handler(reference, reports.put_nowait, rpt_id=block.rpt_id)
        block.resv = block.rpt_ena = True
        block.trigger_options = TriggerOptions(data_change=True, general_interrogation=True)
        block.opt_flds = ReportOptFlds(sequence_number=True, dataset_name=True, data_reference=True)
        await connection.set_rcb_values(
            block, RcbWriteMask.fields("resv", "trigger_options", "opt_flds", "rpt_ena")
        )
        await connection.trigger_gi(reference)
        while reports.empty():
            await connection.poll_reports(100)
        await connection.disconnect()
        return reports.get_nowait()

    report = asyncio.run(asyncio.wait_for(interrogate(), 20))
    with site.client() as client:
        wanted = members(client, "LLN0$measured")
    assert report.dataset_name == f"{DEVICE}/LLN0$measured"
    assert [entry.ref for entry in report.entries] == [f"{DEVICE}/{name}" for name in wanted]


def test_a_dead_line_is_a_change_of_quality(site: Site) -> None:
    site.desk.wait_all_good(1010)
    with site.client() as client:
        enable(client, 0x1000, "qchg", block="LLN0$RP$urcbMeasured02")
        site.desk.gateway.kill("rtu-modbus-1")
        report = client.report()
        chosen = included(report, 2)
        values = report[3 : 3 + len(chosen)]
        assert chosen
        for _, value in values:
            assert mms.elements(value)[1][1][1] & 0xC0 == 0x40  # invalid
    site.desk.wait_all_good(1010)


@pytest.mark.slow
def test_integrity_reports_come_by_themselves_in_segments(site: Site) -> None:
    """A PDU of 1000 octets has not room for all: the segments together have each member once."""
    with site.client(1000) as client:
        count = len(members(client, "LLN0$status"))
        enable(client, 0x4440, "integrity", IntgPd=300, BufTm=100)
        seen: list[int] = []
        for round_ in range(2):
            for segment in range(100):
                report = client.report()
                assert int.from_bytes(report[2][1], "big") == round_
                assert int.from_bytes(report[3][1], "big") == segment
                seen += included(report, 5)
                if report[4][1] == b"\0":
                    break
        assert seen == 2 * list(range(count))


def test_integrity_has_a_shortest_period(site: Site) -> None:
    """A client that wishes a report each millisecond must not take the processor from the others."""
    with site.client() as client:
        for period, answer in ((1, INVALID), (99, INVALID), (100, mms.DONE), (0, mms.DONE)):
            assert client.write(DEVICE, (f"{BLOCK}$IntgPd", number(period))) == [answer]


def test_a_block_is_one_clients(site: Site) -> None:
    with site.client() as other:
        with site.client() as client:
            enable(client, 0x4000, "gi")
            for attribute, value in (("RptEna", NO), ("Resv", YES), ("GI", YES), ("TrgOps", bits(4, 6))):
                assert other.write(DEVICE, (f"{BLOCK}${attribute}", value)) == [TRANSIENT]
            assert client.write(DEVICE, (f"{BLOCK}$TrgOps", bits(4, 6))) == [TRANSIENT]
            assert client.write(DEVICE, (f"{BLOCK}$ConfRev", number(1)))[0][0] == 0x80
        site.desk.gateway.wait_for(
            lambda: other.write(DEVICE, (f"{BLOCK}$Resv", YES)) == [mms.DONE], 20, "the block is free"
        )
        wrong = [("RptEna", number(1)), ("OptFlds", YES), ("DatSet", mms.element(0x8A, b"x")), ("RptID", YES)]
        for attribute, value in wrong:
            assert other.write(DEVICE, (f"{BLOCK}${attribute}", value))[0][0] == 0x80
        assert other.write(DEVICE, (f"{BLOCK}$RptID", mms.element(0x8A, b"mine"))) == [mms.DONE]
        enable(other, 0, "gi")
        assert other.write(DEVICE, (f"{BLOCK}$GI", YES)) == [mms.DONE]
        assert other.report()[0] == (0x8A, b"mine")
        assert other.write(DEVICE, (f"{BLOCK}$RptEna", NO)) == [mms.DONE]
        assert other.write(DEVICE, (f"{BLOCK}$RptID", mms.element(0x8A))) == [mms.DONE]


# ---- who means harm ---------------------------------------------------------------------------------


def test_a_message_may_come_octet_by_octet(site: Site) -> None:
    message = mms.tpkt(mms.data(mms.request(7, mms.read(("OpenRTUCA1010", "LLN0$ST$Beh$stVal")))))
    with site.client() as client:
        for cut in range(1, len(message)):
            client.send(message[:cut])
            client.send(message[cut:])
            assert client.mms()[0] == mms.RESPONSE
        for i in range(len(message)):
            client.send(message[i : i + 1])
        assert client.mms()[0] == mms.RESPONSE
        whole = mms.data(mms.request(8, bytes([mms.IDENTIFY, 0])))
        client.send(b"".join(mms.tpkt(whole[i : i + 1], i + 1 == len(whole)) for i in range(len(whole))))
        assert client.mms()[0] == mms.RESPONSE


def test_an_association_may_come_octet_by_octet(site: Site) -> None:
    client = site.client()
    with client.socket:
        for octet in mms.CONNECT_TRANSPORT:
            client.send(bytes([octet]))
        assert client.packet()[5] == 0xD0
        for octet in mms.tpkt(mms.associate(mms.initiate())):
            client.send(bytes([octet]))
        assert client.message()[0] == 14
        assert client.names(9)


def refused_initiate(site: Site, initiate: bytes) -> bytes:
    """The answer's Initiate-ErrorPDU: behind REFUSE (12), CPR-type and an AARE that rejects for ever."""
    client = site.client()
    with client.socket:
        client.send(mms.CONNECT_TRANSPORT)
        client.packet()
        client.send(mms.tpkt(mms.associate(initiate)))
        refuse = client.message()
        assert refuse[:3] == bytes([12, len(refuse) - 2, 0x32])
        assert refuse[3:5] == bytes([len(refuse) - 4, 2])
        ((tag, parameters),) = mms.elements(refuse[5:])
        assert tag == mms.SEQUENCE
        ((_, aare),) = mms.elements(
            mms.elements(mms.elements(dict(mms.elements(parameters))[0x61])[0][1])[1][1]
        )
        fields = dict(mms.elements(aare))
        assert fields[0xA2] == mms.element(mms.INTEGER, b"\1")
        ((_, external),) = mms.elements(fields[0xBE])
        assert client.is_closed()
        return dict(mms.elements(external))[0xA0]


def test_an_initiate_that_wants_too_little_is_refused(site: Site) -> None:
    """ISO 9506-2: class initiate, other, and max-services-outstanding-called-insufficient."""
    for octets in (0, 1, 999):
        assert refused_initiate(site, mms.initiate(octets)) == bytes.fromhex("aa05a003880100")
    none_called = mms.initiate().replace(bytes.fromhex("820105"), bytes.fromhex("820100"), 1)
    assert refused_initiate(site, none_called) == bytes.fromhex("aa05a003880103")
    with site.client(1000) as client:
        assert client.names(9)


def test_no_more_is_agreed_on_than_was_proposed(site: Site) -> None:
    """Octets of a PDU, services of either side, levels of a type."""
    for proposed, agreed in (((1000, 0, 3, 4), (1000, 0, 3, 4)), ((65000, 9, 99, 99), (2000, 1, 16, 10))):
        tags = range(0x80, 0x84)
        parts = [
            mms.element(tag, b"\0" + number.to_bytes(2, "big"))
            for tag, number in zip(tags, proposed, strict=True)
        ]
        client = site.client()
        with client.socket:
            client.send(mms.CONNECT_TRANSPORT)
            client.packet()
            client.send(mms.tpkt(mms.associate(mms.element(0xA8, *parts))))
            answer = client.message()
            (response,) = mms.elements(answer[answer.index(b"\xa9") :])
            fields = dict(mms.elements(response[1]))
            assert tuple(int.from_bytes(fields[tag], "big") for tag in tags) == agreed


def test_requests_may_be_piped(site: Site) -> None:
    """Four with one number, then two hundred: each is answered, in order."""
    with site.client() as client:
        service = mms.read(("OpenRTUCA1010", "GGIO1$ST"))
        client.send(4 * mms.tpkt(mms.data(mms.request(1, service))))
        answers = [client.mms() for _ in range(4)]
        assert {tag for tag, _ in answers} == {mms.RESPONSE}
        client.send(b"".join(mms.tpkt(mms.data(mms.request(i, service))) for i in range(200)))
        numbers = [int.from_bytes(mms.elements(client.mms()[1])[0][1], "big") for _ in range(200)]
        assert numbers == list(range(200))


DAMAGED = {
    "no TPKT": b"GET / HTTP/1.1\r\n\r\n",
    "TPKT too short": bytes.fromhex("03000004"),
    "TPKT too long": bytes.fromhex("0300ffff"),
    "data before a connection": mms.tpkt(mms.data(bytes([mms.CONCLUDE, 0]))),
    "class 4": bytes.fromhex("0300000b06e00000000140"),
    "parameter beyond the end": bytes.fromhex("0300000d08e00000000100c0ff"),
}


@pytest.mark.parametrize("octets", DAMAGED.values(), ids=DAMAGED.keys())
def test_what_is_no_transport_ends_the_connection(site: Site, octets: bytes) -> None:
    client = site.client()
    client.send(octets)
    assert client.is_closed()


def test_damaged_associations_end_the_connection_alone(site: Site) -> None:
    whole = mms.associate(mms.initiate())
    for at in range(0, len(whole), 3):
        client = site.client()
        client.send(mms.CONNECT_TRANSPORT)
        client.packet()
        client.send(mms.tpkt(whole[:at] + bytes([whole[at] ^ 0xFF]) + whole[at + 1 :]))
        client.socket.shutdown(socket.SHUT_WR)
        assert client.is_closed()
    with site.client() as client:
        assert client.names(9)


def test_damaged_requests_are_answered_or_end_the_connection(site: Site) -> None:
    """Every other octet of a request: a length too long, none, of the indefinite form."""
    whole = mms.data(mms.request(5, mms.read(("OpenRTUCA1010", "GGIO1$ST$DPCSO1"))))
    for at in range(0, len(whole), 2):
        for octet in (0x00, 0x7F, 0x80, 0x84, 0xFF):
            with site.client() as client:
                client.send(mms.tpkt(whole[:at] + bytes([octet]) + whole[at + 1 :]))
                client.socket.shutdown(socket.SHUT_WR)
                assert client.is_closed()
    assert site.restarts() == 0


def test_a_message_longer_than_agreed_ends_the_connection(site: Site) -> None:
    with site.client() as client:
        client.send(mms.tpkt(bytes(4000), end=False))
        assert client.is_closed()


@pytest.mark.slow
def test_a_client_that_never_reads_does_not_hold_up_others(site: Site) -> None:
    with site.client() as deaf, site.client() as other:
        deaf.socket.settimeout(2)
        ask = mms.tpkt(mms.data(mms.request(1, mms.read(("OpenRTUCA1010", "GGIO1$ST")))))
        try:
            for _ in range(20000):
                deaf.send(ask)
        except TimeoutError:
            pass
        assert other.names(9)


@pytest.mark.slow
def test_a_hundred_connections_take_no_place_of_a_client(site: Site) -> None:
    refused = site.counter("connections_refused")
    with site.client() as client:
        crowd = [socket.create_connection(("127.0.0.1", site.port), 20) for _ in range(100)]
        assert client.names(9)
        assert site.counter("connections_refused") > refused or site.counter("connections_dropped") > 50
        for each in crowd:
            each.close()
        assert client.names(9)
    with site.client() as client:
        assert client.names(9)


def test_a_reset_frees_the_place(site: Site) -> None:
    for _ in range(3 * ASSOCIATIONS):
        with site.client() as client:
            client.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    with site.client() as client:
        assert client.names(9)


# ---- configuration ----------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_name_of_no_ied_is_refused(programs: Path, tmp_path: Path) -> None:
    file = tmp_path / "gateway.json"
    file.write_text(json.dumps(chapter_5() | {"iec61850": {"address": "127.0.0.1", "ied": "7-up"}}))
    check = [programs / "rtud/rtud", "--check", file]
    result = subprocess.run(check, capture_output=True, text=True, check=False)
    assert result.returncode != 0
    assert 'iec61850.ied: "7-up" is no name of an IED' in result.stderr
