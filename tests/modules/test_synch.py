# SPDX-License-Identifier: GPL-3.0-or-later
"""The net: modules that wait for each other, die and hang; the coordinator too."""

import json
import os
import re
import signal
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from test_foreign import PATIENCE_S, place, program

from lab.gateway import Gateway, free_port, listening_on, remove, run_directory
from openrtu_tools.logic.binary import encode
from openrtu_tools.logic.compile import compile_text
from openrtu_tools.logic.errors import Findings
from rig.desk import gateway_on_lines, patience

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]
FIXTURES = ROOT / "tests/fixtures/synch"
PAGE = ROOT / "docs/synch.md"
COORDINATOR = "rtu-synch"
RING = ("a", "b", "c")
LIMIT_MS = 2000  # a module that a busy host lets wait is not dead


def stage(directory: Path, name: str, number: int, before: str, **more: Any) -> dict[str, Any]:
    """An entry of "modules"."""
    points = [
        {"name": f"{name}.{what}", "type": "integer", "ioa": ioa + 1}
        for ioa, what in enumerate(("number", "wrong", "scans"))
    ]
    config = {"file": str(directory / f"{name}.json"), "from": f"{before}.number"}
    if name == "a":
        config["first"] = "yes"
    return {
        "name": name,
        "program": program(directory, name, FIXTURES / "stage.py"),
        "heartbeat_limit_ms": LIMIT_MS,
        "ca": 910 + number,
        "points": points,
        "reads": [f"{before}.number"],
        "config": config,
    } | more


def ring(directory: Path, on_death: str) -> dict[str, Any]:
    """Three modules in a ring, without a period: the net alone says when they scan."""
    before = dict(zip(RING, (RING[-1], *RING), strict=False))
    return {
        "port": [],
        "modules": [stage(directory, name, i, before[name]) for i, name in enumerate(RING)],
        "synch": ["a -> b", "b -> c", "c -> a"],
        "start": ["a"],
        "net": {"modules": [{"name": name, "on_death": on_death} for name in RING]},
    }


@dataclass
class Ring:
    """A gateway with the ring, and what to tell its stages."""

    gateway: Gateway

    def say(self, name: str, **words: str) -> None:
        file = self.gateway.directory / f"{name}.json"
        fresh = file.with_suffix(".new")
        fresh.write_text(json.dumps(words))
        fresh.rename(file)

    def value(self, point: str) -> int:
        return int(self.gateway.points(point)[point]["value"] or 0)

    def wait(self, condition: Callable[[], bool], what: str) -> None:
        self.gateway.wait_for(condition, PATIENCE_S, what)

    def wait_rounds(self, rounds: int) -> None:
        target = self.value("c.number") + rounds
        self.wait(lambda: self.value("c.number") >= target, f"{rounds} rounds more")

    def restarts(self, name: str) -> int:
        return int(self.gateway.modules()[name]["restarts"])

    def pid(self, name: str) -> int:
        return int(self.gateway.modules()[name]["pid"] or 0)

    def assert_nothing_was_left_out(self) -> None:
        assert [self.value(f"{name}.wrong") for name in RING] == [0, 0, 0]


def running(programs: Path, on_death: str) -> Iterator[Ring]:
    directory = run_directory()
    try:
        place(directory, programs)
        with Gateway(listening_on(ring(directory, on_death), free_port()), directory, programs) as gateway:
            ring_of_three = Ring(gateway)
            ring_of_three.wait_rounds(3)
            yield ring_of_three
    finally:
        remove(directory)


@pytest.fixture(scope="module")
def returning(programs: Path) -> Iterator[Ring]:
    yield from running(programs, "return")


def test_number_goes_round(returning: Ring) -> None:
    returning.wait_rounds(100)
    returning.assert_nothing_was_left_out()


@pytest.mark.parametrize("phase", ["begun", "written", "any"])
@pytest.mark.parametrize("name", RING)
def test_killed_module_stops_nobody(returning: Ring, name: str, phase: str) -> None:
    """Its tokens are back, and its next process scans again what it has not ended."""
    restarts = returning.restarts(name)
    if phase == "any":
        returning.gateway.kill(name)
    else:
        returning.say(name, die=phase)
    returning.wait(lambda: returning.restarts(name) > restarts, f"{name} died")
    returning.say(name)
    returning.wait_rounds(20)
    returning.assert_nothing_was_left_out()


def test_killed_coordinator_stops_nobody_for_long(returning: Ring) -> None:
    """The marking is in its segment: the next process goes on, whatever the last one was about to do."""
    for _ in range(8):
        restarts = returning.restarts(COORDINATOR)
        returning.gateway.kill(COORDINATOR)
        returning.wait(lambda before=restarts: returning.restarts(COORDINATOR) > before, "it died")
        returning.wait_rounds(10)
    returning.assert_nothing_was_left_out()


def test_module_killed_while_the_coordinator_is_away_stops_nobody(returning: Ring) -> None:
    restarts = returning.restarts("b")
    os.kill(returning.pid(COORDINATOR), signal.SIGSTOP)
    returning.gateway.kill("b")
    returning.wait(lambda: returning.restarts("b") > restarts, "b died")
    returning.wait(lambda: returning.gateway.modules()["b"]["alive"], "b is back")
    os.kill(returning.pid(COORDINATOR), signal.SIGCONT)
    returning.wait_rounds(20)
    returning.assert_nothing_was_left_out()


def test_hung_module_that_wakes_takes_its_place_again(returning: Ring) -> None:
    """It hangs for longer than its limit, and less than rtud has patience."""
    pid = returning.pid("b")
    os.kill(pid, signal.SIGSTOP)
    try:
        returning.wait(lambda: not returning.gateway.modules()["b"]["alive"], "b hangs")
    finally:
        os.kill(pid, signal.SIGCONT)
    returning.wait_rounds(20)
    assert returning.pid("b") == pid
    # A scan that it was in has been done again, and counts as wrong: the next process begins anew.
    returning.gateway.kill("b")
    returning.wait(lambda: returning.pid("b") not in (0, pid), "b is new")
    returning.wait_rounds(3)


def test_module_whose_scan_never_ends_is_killed_and_stops_nobody(returning: Ring) -> None:
    restarts = returning.restarts("c")
    returning.say("c", hang="begun")
    returning.wait(lambda: not returning.gateway.modules()["c"]["alive"], "c hangs")
    returning.say("c")
    os.kill(returning.pid("c"), signal.SIGKILL)  # rtud would, after some seconds more
    returning.gateway.killed += ("c",)
    returning.wait(lambda: returning.restarts("c") > restarts, "c died")
    returning.wait_rounds(20)
    returning.assert_nothing_was_left_out()


@pytest.fixture(scope="module")
def firing(programs: Path) -> Iterator[Ring]:
    yield from running(programs, "fire")


def test_ring_goes_on_without_a_dead_module_whose_scans_fire(firing: Ring) -> None:
    """The number stands, since b does not hand it on; the scans of a and c go on."""
    firing.say("b", die="begun")
    restarts = firing.restarts("b")
    firing.wait(lambda: firing.restarts("b") > restarts + 1, "b dies again and again")
    before = {name: firing.value(f"{name}.scans") for name in ("a", "c")}
    firing.wait(
        lambda: all(firing.value(f"{name}.scans") > scans + 50 for name, scans in before.items()),
        "a and c go on",
    )
    firing.say("b")
    firing.wait_rounds(5)


@pytest.fixture
def holding(programs: Path) -> Iterator[Ring]:
    yield from running(programs, "hold")


def test_held_tokens_wait_for_the_next_process(holding: Ring) -> None:
    holding.say("b", die="begun")
    restarts = holding.restarts("b")
    holding.wait(lambda: holding.restarts("b") > restarts + 2, "b dies again and again")
    stands = holding.value("a.scans")
    restarts = holding.restarts("b")
    holding.wait(lambda: holding.restarts("b") > restarts, "b dies once more")
    assert holding.value("a.scans") == stands
    holding.say("b")
    holding.wait_rounds(20)
    holding.assert_nothing_was_left_out()


# ---- points --------------------------------------------------------------------------------------


def worker(directory: Path, name: str, ca: int) -> dict[str, Any]:
    points = [
        {"name": f"{name}.{what}", "type": "integer", "ioa": ioa + 1}
        for ioa, what in enumerate(("works", "clashes"))
    ]
    return {
        "name": name,
        "program": program(directory, name, FIXTURES / "worker.py"),
        "period_ms": 3,
        "heartbeat_limit_ms": LIMIT_MS,
        "ca": ca,
        "points": points,
        "config": {"file": str(directory / "tool")},
    }


def workshop(directory: Path) -> dict[str, Any]:
    """Two workers with one tool."""
    names = ("left", "right")
    does = ("take", "give", "never")
    net = {
        "places": [{"name": "tool", "tokens": 1}, {"name": "empty"}],
        "transitions": [f"{name}.{what}" for name in names for what in does],
        "arcs": [
            arc
            for name in names
            for arc in (f"tool -> {name}.take", f"{name}.give -> tool", f"empty -> {name}.never")
        ],
        "modules": [
            {"name": name, "points": [{"name": what, "transition": f"{name}.{what}"} for what in does]}
            for name in names
        ],
    }
    modules = [worker(directory, name, 920 + i) for i, name in enumerate(names)]
    return {"port": [], "modules": modules, "net": net}


def test_tool_of_two_comes_back_from_the_dead(programs: Path) -> None:
    directory = run_directory()
    try:
        place(directory, programs)
        (directory / "tool").touch()
        (directory / "tool").chmod(0o666)
        with Gateway(listening_on(workshop(directory), free_port()), directory, programs) as gateway:
            shop = Ring(gateway)
            for kill in ("", "left", "right", "left", "right"):
                if kill:
                    restarts = shop.restarts(kill)
                    gateway.kill(kill)
                    shop.wait(lambda k=kill, r=restarts: shop.restarts(k) > r, f"{kill} died")
                for name in ("left", "right"):
                    works = shop.value(f"{name}.works") if name != kill else 0
                    shop.wait(lambda n=name, w=works: shop.value(f"{n}.works") > w + 10, f"{name} works")
                assert [shop.value(f"{name}.clashes") for name in ("left", "right")] == [0, 0]
            assert 'no synchronisation point "nothing" of left in the "net"' in gateway.log(1000)
    finally:
        remove(directory)


# ---- a line, a module and a program of logic -----------------------------------------------------

COUNTER = """PROGRAM counter
VAR_EXTERNAL times : DINT; END_VAR
times := times + 1;
END_PROGRAM
"""


def compiled(text: str, folder: Path, name: str) -> str:
    findings = Findings()
    written = compile_text(text, findings)
    assert not findings.failed, findings.sorted()
    file = folder / f"{name}.rtul"
    file.write_bytes(encode(written))
    return str(file)


def chain(directory: Path) -> dict[str, Any]:
    """line1 -> watcher, watcher -(2)-> counter."""
    slave = {
        "id": 10,
        **patience(),
        "probe_max_s": 1,
        "input_registers": [{"address": 0, "name": "level.number", "type": "scaled"}],
    }
    pace = {"baud_rate": 115200, "data_bits": 8, "stop_bits": 1, "parity": 0}
    return {
        "port": [{"value": 1, "active": 1, **pace, "slaves": [slave]}],
        "modules": [stage(directory, "watcher", 9, "level")],
        "logic": [
            {
                "name": "counter",
                "program": compiled(COUNTER, directory, "counter"),
                "ca": 7000,
                "points": [{"name": "times", "ioa": 1, "type": "integer"}],
            }
        ],
        "synch": ["line1 -> watcher", "watcher -(2)-> counter"],
    }


LEVEL = {"1.10": {"input_registers": {"0": 50}}}


def test_line_leads_a_module_and_that_a_program(programs: Path, tmp_path: Path) -> None:
    directory = run_directory()
    try:
        place(directory, programs)
        with gateway_on_lines(chain(directory), programs, LEVEL) as (_, gateway):
            line = Ring(gateway)
            line.wait(lambda: line.value("times") >= 20, "the program has scanned")
            net = gateway.query("synch")[0]
            firings = {row["name"]: row["firings"] for row in net["transitions"]}
            places = {row["name"]: row for row in net["places"]}
            # What has been given is there, was taken or had no room.
            given = firings["line1.scan_end"]
            taken = firings["watcher.scan_begin"]
            lost, left = places["line1 -> watcher"]["lost"], places["line1 -> watcher"]["tokens"]
            assert abs(given - taken - lost - left) <= 2  # the numbers are read one by one
            assert abs(firings["watcher.scan_end"] - 2 * firings["counter.scan_begin"]) <= 4
            assert firings["counter.scan_begin"] >= 19
            picture = tmp_path / "net.svg"
            gateway.ctl("synch", "--svg", str(picture))
            drawn = picture.read_text()
            assert len(re.findall("<rect", drawn)) == 1 + 3 + 4  # the ground, the frames, the transitions
            for word in ("line1", "watcher", "counter", "line1 -&gt; watcher (1)", "scan_begin"):
                assert f">{word}</text>" in drawn
            restarts = line.restarts("rtu-modbus-1")
            gateway.kill("rtu-modbus-1")
            line.wait(lambda: line.restarts("rtu-modbus-1") > restarts, "the line died")
            before = line.value("times")
            line.wait(lambda: line.value("times") > before + 3, "it leads again")
            restarts = line.restarts("rtu-logic-counter")
            gateway.kill("rtu-logic-counter")
            line.wait(lambda: line.restarts("rtu-logic-counter") > restarts, "the program died")
            line.wait(lambda: line.value("times") > 3, "it counts again")
            file = directory / "changed.json"
            arrows = ["line1 -> watcher", "watcher -(3)-> counter"]
            file.write_text(json.dumps(gateway.configuration() | {"synch": arrows}))
            report = gateway.ctl("reload", str(file))
            for name in ("rtu-modbus-1", "watcher", "rtu-logic-counter"):
                assert f"{name} gets a new process" in report
            before = line.value("times")
            line.wait(lambda: line.value("times") > before + 3, "it counts by the new net")
    finally:
        remove(directory)


def test_waiting_module_is_shown(holding: Ring) -> None:
    holding.say("b", die="begun")
    holding.wait(
        lambda: any(
            row["name"] == "c" and row["waits_for"] == "c.scan_begin" and row["waits_s"] > 0.5
            for row in holding.gateway.query("synch", "modules")
        ),
        "c waits for b",
    )
    assert "c.scan_begin" in holding.gateway.ctl("synch")
    holding.say("b")
    holding.wait_rounds(3)


def test_net_of_the_page_is_good(programs: Path, tmp_path: Path) -> None:
    """MatPLC's example, as the page has it."""
    blocks = re.findall(r"^```text\n(.*?)^```", PAGE.read_text(), re.MULTILINE | re.DOTALL)
    net = next(block for block in blocks if block.startswith('"net"'))
    names = ("one", "two", "three")
    modules = [{"name": name, "program": f"/{name}"} for name in names]
    file = tmp_path / "gateway.json"
    file.write_text(json.dumps({"port": [], "modules": modules} | json.loads(f"{{{net}}}")))
    done = subprocess.run(
        [programs / "rtud/rtud", "--check", file], capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines()[1:] == [
        "net: 3 participants, 2 places, 3 transitions; all 4 markings looked at",
        "net: bounded: at most 1 token in a place",
        "net: no deadlock",
    ]


def test_net_begins_anew_when_anything_in_it_changes(returning: Ring) -> None:
    """Another pace and one more in it, and back: whoever stands in it begins with its first marking."""
    gateway, directory = returning.gateway, returning.gateway.directory
    begun = json.loads(gateway.config_file.read_text())
    file = directory / "changed.json"

    def take(**more: Any) -> str:
        file.write_text(json.dumps(begun | more))
        return gateway.ctl("reload", str(file))

    wider = [begun["modules"][0] | {"period_ms": 3}, begun["modules"][1]]
    wider += [stage(directory, "c", 2, "d"), stage(directory, "d", 3, "b")]
    arrows = ["a -> b", "b -> d", "d -> c", "c -> a"]
    everybody = [COORDINATOR, *RING]
    for more in ({"modules": wider, "synch": arrows}, {}):
        pids = {name: returning.pid(name) for name in everybody}
        report = take(**more)
        assert all(f"{name} gets a new process" in report for name in everybody), report
        assert all(returning.pid(name) not in (0, pid) for name, pid in pids.items())
        returning.wait_rounds(10)
        returning.assert_nothing_was_left_out()
    assert "d" not in gateway.modules()
    pids = {name: returning.pid(name) for name in everybody}
    take(modules=[*begun["modules"], stage(directory, "d", 9, "c")])  # beside it: the ring does not notice
    returning.wait(lambda: returning.value("d.scans") > 0, "d scans")
    assert {name: returning.pid(name) for name in everybody} == pids
    returning.wait_rounds(10)
    returning.assert_nothing_was_left_out()
