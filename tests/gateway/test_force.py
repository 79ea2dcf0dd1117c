# SPDX-License-Identifier: GPL-3.0-or-later
"""Forced points: what readers and a controlling station see, and that no death leaves a force for ever."""

import json
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from lab.gateway import Gateway
from lab.master import Master
from rig.desk import Desk, gateway_on_lines, patience

DEVICE, CA = "1.10", 1010
LEVEL_IOA, OTHER_IOA = 30001, 30002
WAIT_S = 60.0


def configuration(force_max_s: int | None) -> dict[str, Any]:
    slave = {
        "id": 10,
        **patience(),
        "probe_max_s": 1,
        "input_registers": [
            {"address": 0, "name": "level", "type": "scaled"},
            {"address": 1, "name": "other", "type": "scaled"},
            {"address": 2, "name": "energy", "type": "counter"},
        ],
    }
    pace = {"baud_rate": 19200, "data_bits": 8, "stop_bits": 1, "parity": 0}
    config: dict[str, Any] = {"port": [{"value": 1, "active": 1, **pace, "slaves": [slave]}]}
    return config if force_max_s is None else {**config, "force_max_s": force_max_s}


INITIAL = {DEVICE: {"input_registers": {"0": 50, "1": 60, "2": 7}}}


@pytest.fixture(scope="module")
def running(programs: Path) -> Iterator[Desk]:
    with gateway_on_lines(configuration(3600), programs, INITIAL) as (lines, gateway):
        gateway.wait_for(lambda: shown(gateway, "energy")[1] == "good", WAIT_S, "all is read")
        with Master(*gateway.address) as master:
            master.synchronise_clock(CA)
            yield Desk(lines, gateway, master)


@pytest.fixture
def desk(running: Desk) -> Desk:
    for name in forced(running.gateway):
        running.gateway.ctl("unforce", name)
    running.set_and_scan(DEVICE, "input_registers", 0, [50, 60])
    return running


def forced(gateway: Gateway) -> dict[str, dict[str, Any]]:
    return {row["name"]: row for row in gateway.query("forces")}


def shown(gateway: Gateway, name: str) -> tuple[Any, str]:
    point = gateway.points(name)[name]
    return point["value"], point["quality"]


def refusal(gateway: Gateway, *arguments: str) -> tuple[int, str]:
    command = [gateway.build / "rtuctl" / "rtuctl", "--map", gateway.map, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    return done.returncode, done.stderr


def test_all_see_the_force_and_the_device_goes_on_below(desk: Desk) -> None:
    gateway, mark = desk.gateway, desk.master.mark()
    assert "level" in gateway.ctl("force", "level", "77", "--for", "10m")
    assert shown(gateway, "level") == (77, "substituted")
    told = desk.master.wait(lambda report: (report.ca, report.ioa) == (CA, LEVEL_IOA), since=mark)
    assert (told.value, told.quality, told.cause) == (77, "Substituted", "SPONTANEOUS")
    desk.lines.set(DEVICE, "input_registers", 0, 51, 61)
    told = desk.master.wait(lambda report: (report.ca, report.ioa) == (CA, OTHER_IOA), since=mark)
    assert told.value == 61
    gateway.wait_for(lambda: forced(gateway)["level"]["below"] == 51, WAIT_S, "51 is below")
    reports = {report.ioa: report for report in desk.master.interrogate(CA)}
    assert (reports[LEVEL_IOA].value, reports[LEVEL_IOA].quality) == (77, "Substituted")
    assert [report.value for report in desk.master.reports_since(mark) if report.ioa == LEVEL_IOA] == [77, 77]
    mark = desk.master.mark()
    gateway.ctl("unforce", "level")
    assert shown(gateway, "level") == (51, "good")
    told = desk.master.wait(lambda report: (report.ca, report.ioa) == (CA, LEVEL_IOA), since=mark)
    assert (told.value, told.quality) == (51, "good")


@pytest.mark.slow
def test_it_is_listed_at_every_look_and_logged(desk: Desk) -> None:
    gateway = desk.gateway
    gateway.ctl("force", "level", "78", "--for", "90s")
    for look in (("points", "other"), ("top", "--once", "other"), ("forces",)):
        lines = [line.split() for line in gateway.ctl(*look).splitlines()]
        assert any(line[:3] == ["level", "78", "50"] for line in lines), look
    row = json.loads(gateway.ctl("--json", "show", "level"))
    assert (row["forced"]["value"], row["forced"]["below"]) == (78, 50)
    assert 0 < row["forced"]["left_s"] <= 90
    assert "level is forced by rtuctl for 90 s" in gateway.log()
    gateway.ctl("unforce", "level")
    gateway.wait_for(lambda: "level is no longer forced: rtuctl asked" in gateway.log(), WAIT_S, "the log")
    gateway.wait_for(lambda: shown(gateway, "other") == (60, "good"), WAIT_S, "the other is as it was")


@pytest.mark.slow
def test_it_ends_by_its_time(desk: Desk) -> None:
    desk.gateway.ctl("force", "level", "79", "--for", "1s")
    desk.gateway.wait_for(lambda: shown(desk.gateway, "level") == (50, "good"), WAIT_S, "the force is over")
    over = "level is no longer forced: its time is over"
    desk.gateway.wait_for(lambda: over in desk.gateway.log(), WAIT_S, over)
    assert forced(desk.gateway) == {}


def test_it_survives_its_owner_and_a_dead_device(desk: Desk) -> None:
    gateway = desk.gateway
    gateway.ctl("force", "level", "80")
    former = gateway.modules()["rtu-modbus-1"]["pid"]
    gateway.kill("rtu-modbus-1")
    gateway.wait_for(
        lambda: (
            gateway.modules()["rtu-modbus-1"]["pid"] not in (former, None)
            and shown(gateway, "level") == (80, "substituted")
        ),
        WAIT_S,
        "the next process shows it",
    )
    desk.lines.fault(DEVICE, "mute")
    gateway.wait_for(lambda: "invalid" in shown(gateway, "other")[1], WAIT_S, "the device is dead")
    assert shown(gateway, "level") == (80, "substituted")
    assert forced(gateway)["level"]["below_quality"] == "invalid"
    desk.lines.fault(DEVICE, "clear")
    gateway.wait_for(lambda: forced(gateway)["level"]["below_quality"] == "good", WAIT_S, "it is back")


@pytest.mark.slow
def test_what_ends_while_its_owner_is_stopped_is_over(desk: Desk) -> None:
    gateway = desk.gateway
    gateway.ctl("force", "level", "81", "--for", "1s")
    gateway.ctl("module", "rtu-modbus-1", "stop")
    gateway.wait_for(lambda: forced(gateway) == {}, WAIT_S, "its time is over")
    gateway.ctl("module", "rtu-modbus-1", "start")
    gateway.wait_for(lambda: shown(gateway, "level") == (50, "good"), WAIT_S, "it is what the device says")


def test_what_is_refused_says_why(desk: Desk) -> None:
    gateway = desk.gateway
    code, error = refusal(gateway, "force", "energy", "1")
    assert code == 1 and "energy cannot be forced: it is a counter" in error
    code, error = refusal(gateway, "force", "level", "1", "--for", "2h")
    assert code == 1 and "force_max_s is 3600 s" in error
    code, error = refusal(gateway, "force", "level", "1", "--for", "soon")
    assert code == 2 and "expected one like 90s, 10m or 2h" in error
    code, error = refusal(gateway, "force", "level", "100000")
    assert code == 2 and "an integer from -32768 to 32767" in error
    assert refusal(gateway, "unforce", "level") == (
        1,
        'rtuctl: level is not forced: "rtuctl forces" lists what is\n',
    )
    assert forced(gateway) == {}


def test_a_configuration_without_the_key_allows_none(programs: Path) -> None:
    with gateway_on_lines(configuration(None), programs, INITIAL) as (_, gateway):
        code, error = refusal(gateway, "force", "level", "1")
        assert code == 1 and "the configuration allows no forcing" in error


@pytest.mark.slow
def test_nothing_is_forced_after_rtud_was_killed(programs: Path) -> None:
    with gateway_on_lines(configuration(3600), programs, INITIAL) as (_, gateway):
        gateway.wait_for(lambda: shown(gateway, "level") == (50, "good"), WAIT_S, "the level is read")
        gateway.ctl("force", "level", "82")
        assert gateway.process is not None
        gateway.process.kill()
        gateway.process.wait()
        gateway.start()
        gateway.wait_for(
            lambda: shown(gateway, "level") == (50, "good"), WAIT_S, "it is what the device says"
        )
        assert forced(gateway) == {}
