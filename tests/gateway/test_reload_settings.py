# SPDX-License-Identifier: GPL-3.0-or-later
"""A reload of what is no line: settings of the station, programs; and what passes over with them."""

import copy
import json
import socket
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import c104
import pytest
from test_reload import OWN_LINE_CA, SMALL, STEADY_CA, Config, Site, pids, reduced, site_of

from lab.gateway import Gateway, free_port, remove, run_directory
from lab.master import Master
from lab.raw_master import RawMaster, StationError
from openrtu_tools.logic.binary import encode
from openrtu_tools.logic.compile import compile_text
from openrtu_tools.logic.errors import Findings
from rig.desk import Desk, gateway_on_lines
from rig.plant_programs import CA as PROGRAM_CA
from rig.plant_programs import (
    DEVICE,
    FILLING,
    INITIAL,
    LEVEL,
    PUMP,
    compiled,
    configuration,
    settled,
    wait_idle,
)

WAIT_S = 60.0
M_EI, INITIALISED, CHANGED_HERE = 70, 4, 0x81
ABROAD = "192.0.2.1"  # of nobody here

pytestmark = pytest.mark.slow


@pytest.fixture
def site(programs: Path) -> Iterator[Site]:
    with site_of(programs, *SMALL) as site:
        yield site


def with_settings(config: Config, **settings: Any) -> Config:
    return config | {"iec104": config.get("iec104", {}) | settings}


# ---- the station's settings -------------------------------------------------------------------------


def test_a_new_master_is_let_in_and_the_others_stay(site: Site) -> None:
    few = reduced(site.config, *SMALL) | {"masters": ["127.0.0.1"]}
    more = few | {"masters": [ABROAD, "127.0.0.1"]}
    assert site.reload(few)[0] == 0
    before = pids(site)
    with Master(*site.gateway.address) as master:
        master.synchronise_clock(STEADY_CA)
        here = site.gateway.query("iec104", "connections")
        code, report, errors = site.reload(with_settings(more, t3=33, clock_masters=[ABROAD]))
        assert code == 0, errors
        assert "rtu-iec104 takes the change as it runs\n" in report
        assert pids(site) == before
        now = site.gateway.query("iec104", "connections")
        assert [row["peer"] for row in now] == [row["peer"] for row in here]
        assert master.interrogate(STEADY_CA)


def test_a_master_that_is_not_listed_any_more_is_sent_away(site: Site) -> None:
    with RawMaster(*site.gateway.address) as master:
        master.answer(M_EI)
        assert site.reload(reduced(site.config, *SMALL) | {"masters": [ABROAD]})[0] == 0
        site.gateway.wait_for(
            lambda: site.gateway.query("iec104", "connections") == [], WAIT_S, "its connection ends"
        )
    counters = {c["counter"]: c["value"] for c in site.gateway.query("iec104", "counters")}
    assert counters["closed_not_as_before"] == 1


def test_another_port_starts_the_station_again(site: Site) -> None:
    before, port = pids(site), free_port()
    code, report, errors = site.reload(with_settings(reduced(site.config, *SMALL), port=port, k=20, w=13))
    assert code == 0, errors
    assert "rtu-iec104 is started again\n" in report
    after = pids(site)
    assert after["rtu-iec104"] != before["rtu-iec104"]
    assert {name: pid for name, pid in after.items() if name != "rtu-iec104"} == {
        name: pid for name, pid in before.items() if name != "rtu-iec104"
    }
    with Master(site.gateway.address[0], port) as master:
        assert master.interrogate(STEADY_CA)


def test_a_port_that_another_has_brings_the_former_one_back(site: Site) -> None:
    with socket.create_server(("0.0.0.0", 0)) as other:
        config = with_settings(reduced(site.config, *SMALL), port=other.getsockname()[1])
        code, _, errors = site.reload(config)
    assert code == 1
    assert "rtu-iec104 does not work: the former configuration comes back\n" in errors
    with Master(*site.gateway.address) as master:
        assert master.interrogate(STEADY_CA)


def test_a_new_station_says_that_it_is_initialised(site: Site) -> None:
    """And no other one does again: IEC 60870-5-101, 7.4.3, after a change of local parameters."""
    with RawMaster(*site.gateway.address) as master:
        known = {point["ca"] for point in site.gateway.points().values()}
        assert {master.answer(M_EI).ca for _ in known} == known
        assert site.reload(reduced(site.config, *SMALL, "2.20"))[0] == 0
        end = master.answer(M_EI)
        assert (end.ca, end.cause, end.body) == (OWN_LINE_CA, INITIALISED, bytes([0, 0, 0, CHANGED_HERE]))
        with pytest.raises(StationError, match="answer of type 70"):
            master.answer(M_EI, timeout_s=0.5)


# ---- programs ---------------------------------------------------------------------------------------

AGED = FILLING.replace("rises : R_TRIG;", "rises : R_TRIG; age : TON;").replace(
    "half := level / 2;", "age(IN := TRUE, PT := T#1h); half := level / 2;"
)
TWICE = AGED.replace("half := level / 2", "half := level * 2").replace("VAR above", "VAR new : TON; above")
LINE = "rtu-modbus-1"


@dataclass
class Plant:
    desk: Desk
    config: Config
    folder: Path

    def reload(self, config: Config, *options: str) -> str:
        file = self.folder / "next.json"
        running = json.loads(self.desk.gateway.config_file.read_text())
        kept = {key: value for key, value in running.items() if key not in ("logic", "port")}
        file.write_text(json.dumps(config | kept))
        return self.desk.gateway.ctl("reload", str(file), *options)

    def wait(self, name: str, value: Any) -> None:
        def there() -> bool:
            point = self.desk.gateway.points(name)[name]
            return (point["value"], point["quality"]) == (value, "good")

        self.desk.gateway.wait_for(there, WAIT_S, f"{name} is {value}")


@pytest.fixture
def plant(programs: Path) -> Iterator[Plant]:
    folder = run_directory()
    config = configuration(folder)
    config["logic"] = [program for program in config["logic"] if program["name"] == "filling"]
    config["logic"][0]["program"] = compiled(AGED, folder, "aged")
    try:
        with gateway_on_lines(config, programs, INITIAL) as (lines, gateway):
            gateway.wait_for(lambda: settled(gateway), WAIT_S, "all is valid")
            with Master(*gateway.address) as master:
                yield Plant(Desk(lines, gateway, master), config, folder)
    finally:
        remove(folder)


def age_s(gateway: Gateway, text: str) -> float:
    """Of the program, as its timer says."""
    program = compile_text(text, Findings())
    encode(program)
    cell = gateway.query("logic", "filling")[0]["cells"][program.debug.variables["AGE.ET"].number]
    return int(cell.split(":")[0], 16) / 1e6


def test_another_program_goes_on_with_what_both_retain(plant: Plant) -> None:
    """A master's set point too; and the line that it commands goes on, without an event of its own."""
    desk = plant.desk
    assert desk.master.command(PROGRAM_CA["filling"], 1, "C_SE_NB_1", c104.ScaledCmd(c104.Int16(65)))
    desk.set_and_scan(DEVICE, "input_registers", LEVEL, [66])
    plant.wait("pump", "on")
    desk.set_and_scan(DEVICE, "input_registers", LEVEL, [10])
    plant.wait("pump", "off")
    desk.set_and_scan(DEVICE, "input_registers", LEVEL, [50])  # neither of its commands is to be given
    plant.wait("half", 25)
    starts = desk.gateway.points("starts")["starts"]["value"]
    scans = counter_of(desk.gateway, "rtu-logic-filling", "scans")
    changed = copy.deepcopy(plant.config)
    changed["logic"][0]["program"] = compiled(TWICE, plant.folder, "twice")
    changed["logic"][0]["points"][0]["value"] = 70  # not for a limit that a master has set
    wait_idle(desk)
    assert desk.master.interrogate(desk.gateway.points("pump")["pump"]["ca"])  # behind what was told before
    mark, age = desk.master.mark(), age_s(desk.gateway, AGED)
    assert "rtu-logic-filling gets a new process\n" in plant.reload(changed)
    assert age_s(desk.gateway, TWICE) >= age + 1.0  # in which the new processes had to live
    plant.wait("half", 100)
    plant.wait("limit", 65)
    plant.wait("starts", starts)
    assert starts > 0
    assert counter_of(desk.gateway, "rtu-logic-filling", "scans") >= scans
    reports = desk.master.reports_since(mark)
    assert {(r.ca, r.ioa) for r in reports} == {(PROGRAM_CA["filling"], 2)}, reports
    desk.set_and_scan(DEVICE, "input_registers", LEVEL, [66])  # it commands the line as before
    plant.wait("pump", "on")
    plant.wait("starts", starts + 1)


def test_a_program_is_added_and_removed_and_gets_another_limit(plant: Plant) -> None:
    desk = plant.desk
    without = copy.deepcopy(plant.config)
    del without["logic"]
    assert "rtu-logic-filling is removed\n" in plant.reload(without)
    assert "half" not in desk.gateway.points()
    assert "rtu-logic-filling is added\n" in plant.reload(plant.config)
    plant.wait("half", 25)
    desk.set_and_scan(DEVICE, "input_registers", LEVEL, [75])
    plant.wait("limit", 80)
    assert desk.lines.get(DEVICE, "coils", PUMP) == 0
    changed = copy.deepcopy(plant.config)
    changed["logic"][0]["points"][0]["value"] = 70
    plant.reload(changed)  # no master has set the limit
    plant.wait("limit", 70)
    plant.wait("pump", "on")
    assert desk.lines.get(DEVICE, "coils", PUMP) == 1


def test_a_line_that_a_program_reads_and_commands_changes(plant: Plant) -> None:
    desk = plant.desk
    changed = copy.deepcopy(plant.config)
    slave = changed["port"][0]["slaves"][0]
    slave["coils"].insert(0, slave["coils"].pop())  # other numbers of all
    slave["input_registers"][0]["group"] = 3
    report = plant.reload(changed)
    assert f"{LINE} gets a new process\n" in report
    assert "rtu-logic-filling gets a new process\n" in report
    ca = desk.gateway.points("level")["level"]["ca"]
    assert [r.ioa for r in desk.master.interrogate(ca, 3)] == [30001 + LEVEL]
    desk.set_and_scan(DEVICE, "input_registers", LEVEL, [90])
    plant.wait("pump", "on")
    assert desk.lines.get(DEVICE, "coils", PUMP) == 1


def counter_of(gateway: Gateway, module: str, name: str) -> int:
    counters = {row["counter"]: row["value"] for row in gateway.query("counters", module)}
    return int(counters[name])
