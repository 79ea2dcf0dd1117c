# SPDX-License-Identifier: GPL-3.0-or-later
"""Programs of Structured Text in a running gateway, between simulated devices and a controlling station."""

import json
import re
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import c104
import pytest

from lab.gateway import Gateway, free_port, listening_on, remove, run_directory
from lab.master import Master
from lab.raw_master import ACTIVATION_CON, ACTIVATION_TERM, TIME_TAGGED, RawMaster
from openrtu_tools.logic.binary import encode
from openrtu_tools.logic.compile import compile_text
from openrtu_tools.logic.errors import Findings
from rig.desk import Desk, gateway_on_lines
from rig.plant_programs import (
    BREAKER,
    CA,
    DEVICE,
    EARTHED,
    ENDLESS,
    FILLING,
    INITIAL,
    INTERLOCK,
    LEVEL,
    PUMP,
    ROOT,
    SPIN,
    WAIT_S,
    compiled,
    configuration,
    settled,
    shown,
    wait_idle,
    wait_value,
)

pytestmark = pytest.mark.slow  # as a whole

RETURN_REMOTE = 11
VALUES = [b"\x50\0\0", b"\x46\0\0"]  # scaled 80 and 70


@pytest.fixture(scope="module")
def running(programs: Path) -> Iterator[Desk]:
    folder = run_directory()
    try:
        with gateway_on_lines(configuration(folder), programs, INITIAL) as (lines, gateway):
            gateway.wait_for(lambda: settled(gateway), WAIT_S, "all but the order is valid")
            with Master(*gateway.address) as master:
                yield Desk(lines, gateway, master)
    finally:
        remove(folder)


@pytest.fixture
def desk(running: Desk) -> Desk:
    running.lines.fault(DEVICE, "clear")
    running.set_and_scan(DEVICE, "discrete_inputs", EARTHED, [1, 0])
    running.set_and_scan(DEVICE, "input_registers", LEVEL, [50])
    running.gateway.wait_for(lambda: settled(running.gateway), WAIT_S, "all is valid again")
    wait_value(running, "locked", "on")
    wait_value(running, "half", 25)
    return running


def order(desk: Desk, on: bool) -> bool:
    return desk.master.command(CA["interlock"], 1, "C_SC_NA_1", c104.SingleCmd(on))


def kill(desk: Desk, name: str) -> None:
    """Ends a module's process; returns when the next one lives."""
    former = desk.gateway.modules()[name]["pid"]
    desk.gateway.kill(name)

    def is_back() -> bool:
        module = desk.gateway.modules()[name]
        return module["alive"] and module["pid"] != former

    desk.gateway.wait_for(is_back, WAIT_S, f"rtud has started {name} anew")


# ---- the interlock ---------------------------------------------------------------------------------


def test_an_interlock_refuses_a_masters_command_with_the_reason(desk: Desk) -> None:
    desk.lines.set(DEVICE, "coils", BREAKER, 0)
    assert not order(desk, True)
    assert desk.lines.get(DEVICE, "coils", BREAKER) == 0
    refused = "rtu-logic-interlock warning: a command of order was refused: interlock"
    desk.gateway.wait_for(lambda: refused in desk.gateway.log(), WAIT_S, refused)
    answer = json.loads(desk.gateway.ctl("--json", "set", "order", "on", check=False))
    assert (answer["state"], answer["result"]) == ("refused command", "interlock")


def test_a_command_that_the_interlock_lets_through_is_the_devices_answer(desk: Desk) -> None:
    desk.set_and_scan(DEVICE, "discrete_inputs", EARTHED, [0])
    wait_value(desk, "locked", "off")
    mark = desk.master.mark()
    assert order(desk, True)
    assert desk.lines.get(DEVICE, "coils", BREAKER) == 1
    told = desk.master.wait(
        lambda report: (report.ca, report.ioa, report.cause) == (CA["interlock"], 1, "RETURN_INFO_REMOTE"),
        since=mark,
    )
    assert (told.value, told.good) == (True, True)
    assert order(desk, False)
    assert desk.lines.get(DEVICE, "coils", BREAKER) == 0
    wait_idle(desk)
    desk.lines.fault(DEVICE, "exception", 4, 5)
    answer = json.loads(desk.gateway.ctl("--json", "set", "order", "on", check=False))
    desk.lines.fault(DEVICE, "clear")
    assert (answer["state"], answer["result"]) == ("refused command", "exception")


def causes_of(master: RawMaster, ca: int, ioa: int, kind: int, element: bytes) -> list[int]:
    """Of what the station says of commands and events of this common address, to the command's end."""
    master.request(kind, ca, ioa, element)
    deadline, causes = time.monotonic() + WAIT_S, []
    while causes[-1:] != [ACTIVATION_TERM]:
        asdu = master.next_asdu(deadline)
        if asdu.ca == ca and asdu.type in (kind, *TIME_TAGGED):
            causes.append(asdu.cause)
    return causes


@pytest.mark.parametrize(
    ("ca", "kind", "values"), [("interlock", 45, [b"\1", b"\0"]), ("filling", 49, VALUES)]
)
def test_return_information_is_told_between_confirmation_and_termination(
    desk: Desk, ca: str, kind: int, values: list[bytes]
) -> None:
    """IEC 60870-5-5, 6.8: ACT_CON, return information, ACT_TERM. The owner confirms before it publishes."""
    desk.set_and_scan(DEVICE, "discrete_inputs", EARTHED, [0])
    wait_value(desk, "locked", "off")
    with RawMaster(*desk.gateway.address) as master:
        for value in values * 10:
            assert causes_of(master, CA[ca], 1, kind, value) == [
                ACTIVATION_CON,
                RETURN_REMOTE,
                ACTIVATION_TERM,
            ]


def test_nobody_knows_whether_it_is_earthed_so_it_stays_open(desk: Desk) -> None:
    desk.set_and_scan(DEVICE, "discrete_inputs", EARTHED, [0])
    wait_value(desk, "locked", "off")
    desk.lines.fault(DEVICE, "mute")
    wait_value(desk, "locked", "on")
    assert not order(desk, True)
    desk.lines.fault(DEVICE, "clear")


# ---- sequences, set points, quality -------------------------------------------------------------------


def test_a_sequence_starts_a_pump_at_the_limit_that_a_master_set(desk: Desk) -> None:
    desk.lines.set(DEVICE, "coils", PUMP, 0)
    assert desk.master.command(CA["filling"], 1, "C_SE_NB_1", c104.ScaledCmd(c104.Int16(80)))
    wait_value(desk, "limit", 80)
    before, _ = shown(desk, "starts")
    desk.set_and_scan(DEVICE, "input_registers", LEVEL, [75])
    wait_value(desk, "half", 37)
    assert desk.lines.get(DEVICE, "coils", PUMP) == 0
    assert desk.master.command(CA["filling"], 1, "C_SE_NB_1", c104.ScaledCmd(c104.Int16(70)))
    wait_value(desk, "limit", 70)
    wait_value(desk, "pump", "on")
    wait_value(desk, "starts", before + 1)
    line = f"rtu-logic-filling info: start {before + 1} of the pump at 75\n"
    desk.gateway.wait_for(lambda: line in desk.gateway.log(), WAIT_S, line)
    desk.set_and_scan(DEVICE, "input_registers", LEVEL, [10])
    wait_value(desk, "pump", "off")
    assert desk.lines.get(DEVICE, "coils", PUMP) == 0


def test_what_is_computed_from_a_dead_device_is_invalid(desk: Desk) -> None:
    mark = desk.master.mark()
    desk.lines.fault(DEVICE, "mute")
    wait_value(desk, "half", None, "invalid")
    desk.master.wait(
        lambda report: (report.ca, report.ioa) == (CA["filling"], 2) and not report.good, since=mark
    )
    desk.lines.fault(DEVICE, "clear")
    wait_value(desk, "half", 25)


def test_the_text_is_seen_with_live_values_and_what_an_input_is_forced_to(desk: Desk) -> None:
    def page() -> str:
        command = [
            ROOT / "scripts/openrtu",
            "logic",
            "watch",
            INTERLOCK,
            "--once",
            "--name=earthed=bay1.earthed",
        ]
        command.append(f"--rtuctl={desk.gateway.build}/rtuctl/rtuctl --map {desk.gateway.map}")
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout

    beside = {line.split("|")[1].strip() for line in page().splitlines() if "locked := earthed;" in line}
    assert beside == {"locked=on  earthed=on"}
    desk.gateway.ctl("force", "bay1.earthed", "off")
    wait_value(desk, "locked", "off", "substituted")
    assert "locked=off (substituted)  earthed=off (substituted, forced)" in page()
    desk.gateway.ctl("unforce", "bay1.earthed")
    wait_value(desk, "locked", "on")


def watched(desk: Desk, text: str, program: str, tmp_path: Path) -> str:
    file = tmp_path / "watched.st"
    file.write_text(text)
    rtuctl = f"--rtuctl={desk.gateway.build}/rtuctl/rtuctl --map {desk.gateway.map}"
    command = [ROOT / "scripts/openrtu", "logic", "watch", file, "--once", f"--program={program}", rtuctl]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


def test_inner_variables_of_the_running_program_are_seen(desk: Desk, tmp_path: Path) -> None:
    seen = watched(desk, FILLING, "filling", tmp_path)
    starts = shown(desk, "starts")[0]
    assert f"count={starts}" in seen and "above.Q=FALSE  above.ET=T#0s  level=50  limit=" in seen
    assert "start.STATE=0" in seen
    other = watched(desk, FILLING.replace("level < 20", "level < 21"), "filling", tmp_path)
    assert other.startswith("Only points are shown: filling runs another text") and "level=50" in other
    assert "there is no such program" in watched(desk, FILLING, "filing", tmp_path)


def test_variables_are_those_of_one_moment(desk: Desk) -> None:
    """A look at a program that is half of its time in a scan waits for its end: n and m are the same then."""
    program = compile_text(ENDLESS, Findings())
    encode(program)
    desk.set_and_scan(DEVICE, "discrete_inputs", SPIN, [1])
    wait_value(desk, "out", None, "invalid")
    seen: list[str] = []

    def look() -> bool:
        (row,) = desk.gateway.query("logic", "endless")
        n, m = (row["cells"][program.debug.variables[name].number].split(":")[0] for name in "NM")
        assert n == m
        seen.append(n)
        return len(seen) >= 30 and len(set(seen)) > 1

    desk.gateway.wait_for(look, WAIT_S, "a look at another scan")
    desk.set_and_scan(DEVICE, "discrete_inputs", SPIN, [0])
    wait_value(desk, "out", 7)


# ---- faults ------------------------------------------------------------------------------------------


def test_an_endless_loop_invalidates_the_outputs_and_names_the_line(desk: Desk) -> None:
    wait_value(desk, "out", 7)
    desk.set_and_scan(DEVICE, "discrete_inputs", SPIN, [1])
    wait_value(desk, "out", None, "invalid")
    line = "rtu-logic-endless warning: line 4: too many instructions"
    desk.gateway.wait_for(lambda: line in desk.gateway.log(), WAIT_S, line)
    counted = {
        counter["counter"]: counter["value"]
        for counter in desk.gateway.query("counters", "rtu-logic-endless")
    }
    assert counted["faults_budget"] > 0 and counted["scans"] >= counted["faults_budget"]
    rows = {row["name"]: row for row in desk.gateway.query("modules", "--histogram")}
    assert sum(rows["rtu-logic-endless"]["wakeups"]["counts"]) >= counted["scans"]
    assert rows["rtu-logic-endless"]["scans"]["longest_us"] > 0
    wait_value(desk, "half", 25)  # others go on
    desk.set_and_scan(DEVICE, "discrete_inputs", SPIN, [0])
    wait_value(desk, "out", 7)


def test_a_module_that_is_killed_in_a_scan_comes_back(desk: Desk) -> None:
    desk.set_and_scan(DEVICE, "discrete_inputs", SPIN, [1])
    wait_value(desk, "out", None, "invalid")  # half of its time is a scan
    for _ in range(3):
        kill(desk, "rtu-logic-endless")
    desk.set_and_scan(DEVICE, "discrete_inputs", SPIN, [0])
    wait_value(desk, "out", 7)


def test_what_is_retained_and_what_a_master_set_outlive_the_process(desk: Desk) -> None:
    assert desk.master.command(CA["filling"], 1, "C_SE_NB_1", c104.ScaledCmd(c104.Int16(65)))
    desk.set_and_scan(DEVICE, "input_registers", LEVEL, [66])
    wait_value(desk, "pump", "on")
    desk.set_and_scan(DEVICE, "input_registers", LEVEL, [10])
    wait_value(desk, "pump", "off")
    starts, _ = shown(desk, "starts")
    assert starts > 0
    kill(desk, "rtu-logic-filling")
    wait_value(desk, "limit", 65)
    wait_value(desk, "starts", starts)


def reload(desk: Desk, name: str) -> None:
    """A changed period is a changed module."""
    config = json.loads(desk.gateway.config_file.read_text())
    program = next(one for one in config["logic"] if f"rtu-logic-{one['name']}" == name)
    program["period_ms"] += 1
    desk.gateway.config_file.write_text(json.dumps(config))
    assert f"{name} gets a new process\n" in desk.gateway.ctl("reload", str(desk.gateway.config_file))


def wait_scans(desk: Desk, name: str) -> None:
    def count() -> int:
        return desk.gateway.query("logic", name)[0]["scans"]

    before = count()
    desk.gateway.wait_for(lambda: count() >= before + 3, WAIT_S, f"{name} has scanned three times")


@pytest.mark.parametrize("exchange", [kill, reload])
def test_a_new_process_does_not_repeat_a_command(desk: Desk, exchange: Callable[[Desk, str], None]) -> None:
    """EXECUTE of `stop` is true all the time; somebody at the plant has switched the pump on meanwhile."""
    desk.set_and_scan(DEVICE, "input_registers", LEVEL, [10])
    wait_value(desk, "half", 5)
    wait_scans(desk, "filling")
    wait_idle(desk)
    desk.set_and_scan(DEVICE, "coils", PUMP, [1])
    exchange(desk, "rtu-logic-filling")
    wait_scans(desk, "filling")
    wait_idle(desk)
    assert desk.lines.get(DEVICE, "coils", PUMP) == 1
    desk.set_and_scan(DEVICE, "input_registers", LEVEL, [50])
    wait_value(desk, "half", 25)
    desk.set_and_scan(DEVICE, "input_registers", LEVEL, [10])
    wait_value(desk, "pump", "off")


# ---- each phase of a scan ----------------------------------------------------------------------------

COUNTS = """PROGRAM counts
VAR_EXTERNAL n, limit, over : DINT; END_VAR VAR RETAIN a, b : DINT; END_VAR
a := a + 1; n := a; over := a - limit; b := b + 1;
END_PROGRAM
"""
PHASES, LIFE = 9, 60  # modules/logic/dies.c


def test_a_death_in_any_phase_of_a_scan_loses_no_more_than_that_scan(programs: Path) -> None:
    """What was published never goes back, what is retained is of one scan, what a master set stays."""
    directory = run_directory()
    build = directory / "build"
    (build / "modules").mkdir(parents=True)
    for name in ("rtud", "rtuctl"):
        (build / name).symlink_to(programs / name)
    for name in ("rtu-modbus", "rtu-iec104"):
        (build / "modules" / name).symlink_to(programs / "modules" / name)
    (build / "modules/rtu-logic").symlink_to(programs / "modules/rtu-logic-dies")
    names = enumerate(("n", "limit", "over"), 1)
    points = [{"name": name, "ioa": ioa, "type": "integer"} for ioa, name in names]
    program = {
        "name": "counts",
        "program": compiled(COUNTS, directory, "counts"),
        "period_ms": 20,
        "ca": 7000,
        "points": points,
    }
    table = compile_text(COUNTS, Findings())
    encode(table)
    places = [table.debug.variables[name].number for name in "AB"]
    try:
        with Gateway(
            listening_on({"port": [], "logic": [program]}, free_port()), directory, build
        ) as gateway:
            gateway.killed += ("rtu-logic-counts",)
            gateway.wait_for(lambda: "limit" in gateway.points(), WAIT_S, "it runs")
            gateway.ctl("set", "limit", "5")
            newest = 0

            def died_in_all() -> bool:
                nonlocal newest
                point = gateway.points("n")["n"]
                if point["quality"] == "good":
                    assert point["value"] >= newest
                    newest = point["value"]
                return gateway.modules()["rtu-logic-counts"]["restarts"] > PHASES

            gateway.wait_for(died_in_all, WAIT_S, "it has died in each phase")
            (row,) = gateway.query("logic", "counts")
            assert row["scans"] >= PHASES * LIFE
            a, b = (int(row["cells"][place].split(":")[0], 16) for place in places)
            assert a == b and a >= newest and a >= row["scans"] - 1
            gateway.wait_for(lambda: gateway.points("over")["over"]["quality"] == "good", WAIT_S, "good")
            found = gateway.points()
            assert found["limit"]["value"] == 5
    finally:
        remove(directory)


def test_a_program_that_says_the_same_in_each_scan_does_not_fill_the_log(desk: Desk) -> None:
    """Ten lines in ten seconds; the fixture's gateway has run for longer, or does so soon."""
    left_out = re.compile(r"rtu-logic-endless warning: (\d+) messages of the program were left out\n")
    desk.gateway.wait_for(lambda: left_out.search(desk.gateway.log()), WAIT_S, "the messages left out")
    log = desk.gateway.log()
    begun = 1 + 3 + len(left_out.findall(log))  # three more processes: those that were killed
    assert 0 < log.count("rtu-logic-endless info: out is 7") <= 10 * begun
