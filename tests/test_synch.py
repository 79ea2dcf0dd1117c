# SPDX-License-Identifier: GPL-3.0-or-later
"""The net: modules that wait for each other, die and hang; the coordinator too."""

import json
import os
import signal
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from lab.gateway import Gateway, free_port, listening_on, remove, run_directory
from test_foreign import PATIENCE_S, place, program

pytestmark = pytest.mark.slow

FIXTURES = Path(__file__).resolve().parent / "fixtures/synch"
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
        return int(self.gateway.modules()[name]["pid"])

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
