# SPDX-License-Identifier: GPL-3.0-or-later
"""Texts in registers: from a device to rtuctl, its events, a reload and a controlling station."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from lab.gateway import GatewayError
from lab.master import Master
from rig.configuration import VALIDATOR
from rig.desk import Substation, everything_read, gateway_on_lines, patience

DEVICE, INPUT, HOLDING = "1.5", "input_registers", "holding_registers"
WAIT_S = 60.0
CA, SERIAL, VERSION, MAKER, MOUNTED = 1005, 100, 200, 300, 400
TEXTS = {"serial": "A-17", "version": "4.2", "maker": "Müller & Söhne", "mounted": "?[2J"}


def registers(first: int, text: str, count: int, order: str = "big") -> dict[str, int]:
    octets = text.encode("latin-1").ljust(2 * count, b"\0")
    return {
        str(first + i): int.from_bytes(octets[2 * i : 2 * i + 2], "little" if order == "little" else "big")
        for i in range(count)
    }


def configuration() -> dict[str, Any]:
    pace = {"baud_rate": 115200, "data_bits": 8, "stop_bits": 1, "parity": 0}
    serial = {"address": SERIAL, "name": "serial", "format": "string", "length": 8, "period_ms": 100}
    version = {"address": VERSION, "name": "version", "format": "string16", "length": 4, "type": "bitstring"}
    maker = {"address": MAKER, "name": "maker", "format": "string", "length": 32, "byte_order": "little"}
    mounted = {"address": MOUNTED, "name": "mounted", "format": "string", "length": 2}
    tables = {INPUT: [serial, version, {"address": 0, "name": "level"}], HOLDING: [maker, mounted]}
    slave = {"id": 5, **patience(), "period_ms": 300, **tables}
    return {"iec104": {}, "force_max_s": 60, "port": [{"value": 1, "active": 1, **pace, "slaves": [slave]}]}


@pytest.fixture(scope="module")
def running(programs: Path) -> Iterator[Substation]:
    version = {str(VERSION + i): ord(letter) for i, letter in enumerate(TEXTS["version"])}
    inputs = registers(SERIAL, TEXTS["serial"], 8) | version
    holding = registers(MAKER, TEXTS["maker"], 32, "little") | registers(MOUNTED, "\x1b[2J", 2)
    assert VALIDATOR.is_valid(configuration())
    with gateway_on_lines(configuration(), programs, {DEVICE: {INPUT: inputs, HOLDING: holding}}) as (
        lines,
        gateway,
    ):
        gateway.wait_for(lambda: everything_read(gateway), WAIT_S, "all has been read")
        yield Substation(lines, gateway)


def shown(running: Substation) -> dict[str, Any]:
    return {name: point["value"] for name, point in running.gateway.points().items() if name != "level"}


def test_texts_are_values_with_quality_and_time(running: Substation) -> None:
    assert shown(running) == TEXTS
    serial = running.gateway.points()["serial"]
    assert (serial["type"], serial["quality"]) == ("text", "good")
    assert serial["age_s"] is not None
    assert "Müller & Söhne" in running.gateway.ctl("points")


def test_nobody_commands_or_forces_a_text(running: Substation) -> None:
    assert [row["name"] for row in running.gateway.query("commands")] == []
    with pytest.raises(GatewayError, match="maker cannot be forced: it is a text"):
        running.gateway.ctl("force", "maker", "7", "--for", "10s")
    assert running.gateway.points()["maker"]["forced"] is None


def test_texts_are_read_seldom(running: Substation) -> None:
    """Those without a period of their own once, though their slave has one of 300 ms."""
    since = running.lines.frames(0)
    reads = [frame.bytes for frame in since if frame.kind == "received"]
    assert [int.from_bytes(read[2:4]) for read in reads].count(MAKER) == 1


def test_another_text_is_an_event(running: Substation) -> None:
    with Master(*running.gateway.address) as master:
        (before,) = [report.value for report in master.interrogate(CA) if report.ioa == 30001 + SERIAL]
        mark = master.mark()
        running.lines.set(DEVICE, INPUT, SERIAL, int.from_bytes(b"B-"))
        told = master.wait(lambda report: report.ioa == 30001 + SERIAL and report.value != before, mark)
        assert told.good
    running.gateway.wait_for(lambda: shown(running)["serial"] == "B-17", WAIT_S, "the other text is read")
    rows = [json.loads(row) for row in running.gateway.ctl("events", "--json").splitlines()]
    assert [row["value"] for row in rows if row.get("name") == "serial"][-2:] == ["A-17", "B-17"]


def test_texts_outlive_a_reload_and_the_process_of_their_line(running: Substation) -> None:
    gateway = running.gateway
    before = shown(running)
    changed = json.loads(gateway.config_file.read_text())
    changed["port"][0]["slaves"][0][INPUT].append({"address": 1, "name": "another"})
    gateway.config_file.write_text(json.dumps(changed))
    assert "nothing changes" not in gateway.ctl("reload")
    assert {name: value for name, value in shown(running).items() if name != "another"} == before
