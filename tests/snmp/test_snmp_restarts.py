# SPDX-License-Identifier: GPL-3.0-or-later
"""rtu-snmp, killed or with another configuration: nothing is repeated, left open or told twice."""

import asyncio
import json
import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from lab.manager import SINK_ENGINE, Silent
from rig.desk import everything_read
from rig.snmp import (
    ACCEPTED,
    BREAKER,
    EXECUTE,
    EXECUTED,
    EXECUTING,
    INACTIVE,
    INTERRUPT,
    INTERRUPTED,
    LAMP,
    OFF,
    ON,
    REFUSED,
    REFUSED_SELECTION,
    SELECT,
    UNKNOWN_FATE,
    Site,
    bulk,
    end_commands,
    relayed,
    site_of,
)


@pytest.fixture(scope="module")
def site(programs: Path) -> Iterator[Site]:
    with site_of(
        programs, lasting_s=10
    ) as site:  # a state is there until its test kills, on a busy host, too
        yield site


@pytest.fixture(autouse=True)
def nothing_under_way(site: Site) -> Iterator[None]:
    yield
    end_commands(site)


def restarted(site: Site) -> None:
    """rtu-snmp is killed, and runs again."""
    gateway = site.desk.gateway
    before = gateway.modules()["rtu-snmp"]["restarts"]
    gateway.kill("rtu-snmp")
    gateway.wait_for(lambda: gateway.modules()["rtu-snmp"]["restarts"] > before, 20.0, "it was restarted")


@pytest.mark.slow
def test_a_killed_agent_goes_on(site: Site) -> None:
    """Its numbers, its boots, and what a sink has not confirmed."""
    manager = site.manager()
    boots, last = manager.get("1.3.6.1.6.3.10.2.1.2.0", "rtuEventLast.0")
    gateway = site.desk.gateway
    restarted(site)
    gateway.wait_for(lambda: gateway.modules()["rtu-snmp"]["alive"], 20.0, "it runs again")
    again, later = manager.get("1.3.6.1.6.3.10.2.1.2.0", "rtuEventLast.0")
    assert again == boots + 1
    assert later >= last
    site.desk.gateway.wait_for(lambda: later in site.received.numbers(), 20.0, "the sink has all events")
    numbers = sorted(set(site.received.numbers()))
    assert numbers == list(range(1, numbers[-1] + 1))


@pytest.mark.slow
def test_each_of_20_kills_is_a_boot(site: Site) -> None:
    """Its number is on the disk before anybody gets an answer."""
    gateway, manager, file = site.desk.gateway, site.manager(), site.folder / "state/boots"
    for _ in range(20):
        before = int(file.read_text())
        restarted(site)
        gateway.wait_for(lambda: gateway.modules()["rtu-snmp"]["alive"], 20.0, "it runs again")
        assert manager.get("1.3.6.1.6.3.10.2.1.2.0") == [before + 1]
        assert int(file.read_text()) == before + 1


@pytest.mark.slow
@pytest.mark.parametrize("left", [b"", b"1", b"2147483648\n"], ids=["empty", "cut", "too great"])
def test_a_damaged_number_of_boots_keeps_the_agent_down(site: Site, left: bytes) -> None:
    """Time would begin anew for whoever has kept old messages. The log says what to do."""
    gateway, file = site.desk.gateway, site.folder / "state/boots"
    whole = file.read_bytes()
    file.write_bytes(left)
    before = gateway.ctl("log").count("boots is damaged")
    restarted(site)
    line = f"{file.parent}/boots is damaged: give the gateway another engine ID"
    gateway.wait_for(lambda: gateway.ctl("log").count(line) > before, 20.0, "it says so")
    with pytest.raises(Silent):
        site.manager(timeout_s=1).get("rtuStationName.0")
    file.write_bytes(whole)
    gateway.wait_for(lambda: gateway.modules()["rtu-snmp"]["alive"], 60.0, "it runs again")
    assert site.manager().get("1.3.6.1.6.3.10.2.1.2.0") == [int(whole) + 1]


@pytest.mark.slow
def test_a_lost_number_of_boots_begins_beyond_all_before(site: Site) -> None:
    """Not at 1, where what somebody has kept of a former time would be new. The log says so."""
    gateway, file = site.desk.gateway, site.folder / "state/boots"
    (before,) = site.manager().get("1.3.6.1.6.3.10.2.1.2.0")
    assert isinstance(before, int)
    # The tests before have started it more often than once a second.
    gateway.wait_for(lambda: time.time() - 1577836800 > before + 1, 60.0, "the clock is beyond the number")
    file.unlink()
    restarted(site)
    gateway.wait_for(lambda: gateway.modules()["rtu-snmp"]["alive"], 20.0, "it runs again")
    (after,) = site.manager().get("1.3.6.1.6.3.10.2.1.2.0")
    assert isinstance(after, int)
    assert after > before
    assert abs(after - (time.time() - 1577836800)) < 600
    assert f"{file} is not there: it begins with {after}, by the clock" in gateway.ctl("log")


def begin_with(site: Site, boots: int) -> None:
    """The receiver of informs starts again, with another number of its boots."""
    site.received.stop()
    file = site.received.log.parent / "receiver.conf"
    words = ("oldEngineID", "engineBoots")
    kept = [line for line in file.read_text().splitlines() if not line.startswith(words)]
    kept += [f"oldEngineID 0x{SINK_ENGINE}", f"engineBoots {boots}"]
    file.write_text("\n".join(kept) + "\n")
    site.received.start()


@pytest.mark.slow
def test_a_receiver_that_lost_its_boots_is_discovered_anew(site: Site) -> None:
    """RFC 3414, 3.2, 7 b lets its reports be refused for ever; the log says what is seen."""
    for boots, value in ((40, 0), (1, 1)):
        begin_with(site, boots)
        before = site.last()
        site.desk.set_and_scan("1.10", "discrete_inputs", 4, [value])
        site.desk.set_and_scan("1.10", "discrete_inputs", 4, [1 - value])
        site.received.wait_for("rtuPointChanged", 1, before)
    line = "the sink nms answers with other boots or another time than it had: it is discovered anew"
    assert line in site.desk.gateway.ctl("log")


@pytest.mark.slow
def test_a_line_that_dies_leaves_no_command_open(site: Site) -> None:
    """Its fate is unknown, and nothing is repeated."""
    manager, before = site.manager(), site.last()
    manager.wish(BREAKER, SELECT, value=ON)
    site.wait_state(BREAKER, ACCEPTED)
    site.desk.gateway.kill("rtu-modbus-1")
    assert site.states_told(before, 2)[-1] == INTERRUPTED
    site.desk.wait_all_good(1010)


# ---- kill -9 in each of the ten states -----------------------------------------------------------

LINE = "rtu-modbus-1"
WISHES = {SELECT: (BREAKER, INACTIVE), INTERRUPT: (BREAKER, ACCEPTED), EXECUTE: (LAMP, INACTIVE)}


def reach(site: Site, state: int) -> str:
    """The row of a command that has this state. Of a wish the line's process is stopped: it stays one."""
    manager = site.manager()
    if state in WISHES:
        row, before = WISHES[state]
        if before == ACCEPTED:
            reach(site, ACCEPTED)
        os.kill(site.desk.gateway.modules()[LINE]["pid"], signal.SIGSTOP)
        value = {} if before == ACCEPTED else {"value": 2}
        manager.wish(row, state, **value)
        return row
    row = LAMP if state in (EXECUTING, EXECUTED) else BREAKER
    if state == EXECUTING:
        site.desk.lines.fault("1.10", "mute")
    if state in (ACCEPTED, INTERRUPTED):
        manager.wish(row, SELECT, value=OFF)
        site.wait_state(row, ACCEPTED)
    if state == INTERRUPTED:
        manager.wish(row, INTERRUPT)
    elif state == REFUSED_SELECTION:
        manager.wish(row, SELECT, value=OFF, issued=(int(time.time() * 1000) - 60_000).to_bytes(8, "big"))
    elif state in (REFUSED, EXECUTING, EXECUTED):
        manager.wish(row, EXECUTE, value=2)
    site.wait_state(row, state)
    return row


@pytest.mark.slow
@pytest.mark.parametrize("state", range(INACTIVE, EXECUTED + 1))
@pytest.mark.parametrize("victim", ["rtu-snmp", LINE])
def test_nothing_is_repeated_or_open_after_a_kill(site: Site, state: int, victim: str) -> None:
    """The device is written to once at most; in the end the row is inactive."""
    gateway, mark = site.desk.gateway, site.desk.lines.mark()
    row = reach(site, state)
    assert site.manager().state(row) == state
    line, before = gateway.modules()[LINE]["pid"], gateway.modules()[victim]["restarts"]
    gateway.kill(victim)
    if victim != LINE and state in WISHES:
        os.kill(line, signal.SIGCONT)
    gateway.wait_for(lambda: gateway.modules()[victim]["restarts"] > before, 30.0, "it was restarted")
    gateway.wait_for(lambda: gateway.modules()[victim]["alive"], 30.0, "it runs again")
    if victim == LINE and state in (ACCEPTED, *WISHES, EXECUTING):
        gateway.wait_for(
            lambda: site.manager().get(f"rtuCommandResult.{row}") == [UNKNOWN_FATE],
            10.0,
            "its fate is unknown",
        )
    site.desk.lines.fault("1.10", "clear")
    gateway.wait_for(lambda: site.is_released(row), 60.0, f"{row} is released")
    site.desk.wait_all_good(1010)
    writes = site.writes(mark)
    executes = state in (EXECUTE, EXECUTING, EXECUTED)
    assert writes <= 1 if executes else writes == 0


# ---- a changed configuration ---------------------------------------------------------------------


@pytest.mark.slow
def test_the_agent_starts_again_with_a_changed_configuration(site: Site) -> None:
    """It knows points by their numbers, which a change moves. Events go on, with the addresses they had."""
    gateway, manager = site.desk.gateway, site.manager()
    running = gateway.config_file.read_text()

    def reload(config: dict[str, Any]) -> str:
        (site.folder / "changed.json").write_text(json.dumps(config))
        return gateway.ctl("reload", str(site.folder / "changed.json"))

    def told() -> list[dict[str, Any]]:
        names = ("CommonAddress", "ObjectAddress", "Type", "Value", "Kind")
        return [
            {index: value for index, value in manager.walk(f"rtuEvent{name}").items() if int(index) <= last}
            for name in names
        ]

    site.desk.set_and_scan("1.10", "discrete_inputs", 4, [0])
    site.desk.set_and_scan("1.10", "discrete_inputs", 4, [1])
    boots, epoch, last = manager.get("1.3.6.1.6.3.10.2.1.2.0", "rtuEventEpoch.0", "rtuEventLast.0")
    before = told()
    assert 1010 in before[0].values()
    count = len(manager.walk("rtuPointName"))
    config = json.loads(running)
    assert "nothing changes" in reload(config)
    config["snmp"]["max_message"] = 65507
    assert "rtu-snmp is started again\n" in reload(config)
    messages: list[bytes] = []
    with relayed(site.port, messages) as port:
        asyncio.run(bulk(port, 65507))
    assert 1472 < max(map(len, messages)) <= 65507
    assert manager.get("1.3.6.1.6.3.10.2.1.2.0") == [boots + 1]
    config["port"][0]["slaves"].pop()
    assert "rtu-snmp is started again\n" in reload(config)
    assert len(manager.walk("rtuPointName")) < count
    assert told() == before
    assert "rtu-snmp is started again\n" in reload(json.loads(running))
    site.desk.gateway.wait_for(lambda: everything_read(gateway), 60.0, "every device is read")
    manager.wish(LAMP, EXECUTE, value=1)
    site.wait_state(LAMP, EXECUTED)
    assert manager.get("1.3.6.1.6.3.10.2.1.2.0") == [boots + 3]
    assert (manager.get("rtuEventEpoch.0"), told()) == ([epoch], before)
    (came,) = site.received.wait_for("rtuStationInitialised", 1, int(last))
    assert (came.value("rtuEventCommonAddress"), came.value("rtuEventValue")) == (1010, 129)
    assert len(site.received.wait_for("rtuStarted", 2, int(last))) == 2
    newest = site.last()
    gateway.wait_for(lambda: newest in site.received.numbers(), 20.0, "the sink has all events")
    assert sorted(set(site.received.numbers())) == list(range(1, max(site.received.numbers()) + 1))
