# SPDX-License-Identifier: GPL-3.0-or-later
"""rtu-snmp: commands, totals, parameters, clock and groups, as managers see them that others wrote."""

import asyncio
import struct
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import c104
import pytest

from lab.manager import CENTRE, ENGINEER, WATCH, Refused, User, oid
from lab.patience import Deadline
from rig.snmp import (
    ACCEPTED,
    BREAKER,
    COMMAND,
    DONE,
    EXECUTE,
    EXECUTED,
    EXECUTING,
    INACTIVE,
    INTERRUPT,
    INTERRUPTED,
    LAMP,
    NO_BITS,
    NOT_SELECTED,
    OFF,
    ON,
    REFUSED,
    REFUSED_SELECTION,
    SELECT,
    Quick,
    Site,
    end_commands,
    site_of,
)

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def site(programs: Path) -> Iterator[Site]:
    with site_of(programs) as site:
        yield site


@pytest.fixture(scope="module")
def quick(site: Site) -> Iterator[Quick]:
    managers = Quick(site.port)
    yield managers
    managers.close()


@pytest.fixture(autouse=True)
def nothing_under_way(site: Site) -> Iterator[None]:
    yield
    end_commands(site)


# ---- commands: figures 2 to 6 of the paper -------------------------------------------------------


def test_select_and_execute(site: Site) -> None:
    """Figure 2."""
    manager, before, mark = site.manager(), site.last(), site.desk.lines.mark()
    assert manager.state(BREAKER) == INACTIVE
    manager.wish(BREAKER, SELECT, value=ON)
    assert site.states_told(before, 1) == [ACCEPTED]
    manager.wish(BREAKER, EXECUTE)
    assert site.states_told(before, 3) == [ACCEPTED, EXECUTING, EXECUTED]
    assert manager.get(f"rtuCommandOwner.{BREAKER}", f"rtuCommandResult.{BREAKER}") == [b"centre", DONE]
    manager.wish(BREAKER, INACTIVE)
    assert manager.state(BREAKER) == INACTIVE
    assert site.writes(mark) == 1
    assert site.desk.lines.get("1.10", "coils", 0) == 0 or site.desk.lines.get("1.10", "coils", 1) == 1


def test_an_interrupted_selection(site: Site) -> None:
    """Figure 3."""
    manager, before, mark = site.manager(), site.last(), site.desk.lines.mark()
    manager.wish(BREAKER, SELECT, value=OFF)
    assert site.states_told(before, 1) == [ACCEPTED]
    manager.wish(BREAKER, INTERRUPT)
    assert site.states_told(before, 2) == [ACCEPTED, INTERRUPTED]
    manager.wish(BREAKER, INACTIVE)
    assert manager.state(BREAKER) == INACTIVE
    assert site.writes(mark) == 0


def test_a_refused_selection(site: Site) -> None:
    """Figure 4: a command from long ago."""
    manager, before = site.manager(), site.last()
    long_ago = (int(time.time() * 1000) - 60_000).to_bytes(8, "big")
    manager.wish(BREAKER, SELECT, value=OFF, issued=long_ago)
    (told,) = site.received.wait_for("rtuCommandChanged", 1, before)
    assert (told.value("rtuCommandState"), told.value("rtuCommandResult")) == (REFUSED_SELECTION, 5)
    manager.wish(BREAKER, INACTIVE)
    assert manager.state(BREAKER) == INACTIVE


def test_a_direct_command(site: Site) -> None:
    """Figure 5."""
    manager, before, mark = site.manager(), site.last(), site.desk.lines.mark()
    manager.wish(LAMP, EXECUTE, value=2)
    assert site.states_told(before, 2) == [EXECUTING, EXECUTED]
    manager.wish(LAMP, INACTIVE)
    assert manager.state(LAMP) == INACTIVE
    assert site.writes(mark) == 1


def test_a_refused_command(site: Site) -> None:
    """Figure 6: one that needs a selection."""
    manager, before, mark = site.manager(), site.last(), site.desk.lines.mark()
    manager.wish(BREAKER, EXECUTE, value=ON)
    (told,) = site.received.wait_for("rtuCommandChanged", 1, before)
    assert (told.value("rtuCommandState"), told.value("rtuCommandResult")) == (REFUSED, NOT_SELECTED)
    manager.wish(BREAKER, INACTIVE)
    assert manager.state(BREAKER) == INACTIVE
    assert site.writes(mark) == 0


def test_a_repeated_request_acts_once(site: Site) -> None:
    manager, mark = site.manager(), site.desk.lines.mark()
    spin = manager.spin(LAMP)
    manager.wish(LAMP, EXECUTE, spin=spin, value=2)
    with pytest.raises(Refused, match="inconsistentValue"):
        manager.wish(LAMP, EXECUTE, spin=spin, value=2)
    site.wait_state(LAMP, EXECUTED)
    with pytest.raises(Refused, match="inconsistentValue"):
        manager.wish(LAMP, EXECUTE, value=2)  # of an executed command only inactive may follow
    manager.wish(LAMP, INACTIVE)
    assert site.writes(mark) == 1


@pytest.mark.sample(6)
@pytest.mark.parametrize(
    ("state", "more", "reason"),
    [
        (ACCEPTED, {"value": ON}, "wrongValue"),
        (EXECUTED, {"value": ON}, "wrongValue"),
        (11, {"value": ON}, "wrongValue"),
        (SELECT, {"value": 1}, "wrongValue"),
        (SELECT, {"value": ON, "qualifier": 2}, "wrongValue"),
        (SELECT, {"value": ON, "issued": b"\0" * 7}, "wrongLength"),
        (SELECT, {"value": b"\0"}, "wrongType"),
        (SELECT, {}, "inconsistentValue"),
        (INTERRUPT, {}, "inconsistentValue"),
        (INACTIVE, {}, "inconsistentValue"),
        (SELECT, {"value": ON, "number": 3}, "notWritable"),
    ],
)
def test_a_request_that_cannot_be(site: Site, state: int, more: dict[str, Any], reason: str) -> None:
    manager = site.manager()
    with pytest.raises(Refused, match=reason):
        manager.wish(BREAKER, state, **more)
    assert manager.state(BREAKER) == INACTIVE


def test_all_of_a_request_or_nothing(site: Site) -> None:
    manager, mark = site.manager(), site.desk.lines.mark()
    with pytest.raises(Refused, match="wrongValue"):
        manager.set(
            {
                f"rtuCommandSpinLock.{LAMP}": manager.spin(LAMP),
                f"rtuCommandState.{LAMP}": EXECUTE,
                f"rtuCommandValue.{LAMP}": 2,
                f"rtuCommandSpinLock.{BREAKER}": manager.spin(BREAKER),
                f"rtuCommandState.{BREAKER}": EXECUTED,
            }
        )
    assert (manager.state(LAMP), site.writes(mark)) == (INACTIVE, 0)


def test_another_user_has_no_part_in_a_selection(site: Site) -> None:
    manager, other = site.manager(), site.manager(ENGINEER)
    manager.wish(BREAKER, SELECT, value=ON)
    site.wait_state(BREAKER, ACCEPTED)
    for state in (EXECUTE, INTERRUPT, INACTIVE, SELECT):
        with pytest.raises(Refused, match="inconsistentValue"):
            other.wish(BREAKER, state)
    manager.wish(BREAKER, INTERRUPT)
    site.wait_state(BREAKER, INTERRUPTED)


def test_a_selection_ends_by_itself_and_is_released(site: Site) -> None:
    """In rtuctl, too."""
    manager, before = site.manager(), site.last()
    manager.wish(BREAKER, SELECT, value=ON)
    assert site.states_told(before, 2) == [ACCEPTED, INTERRUPTED]
    (row,) = site.desk.gateway.query("commands", "feeder10.breaker-command")
    assert row["state"] == "interrupted selection"
    site.wait_state(BREAKER, INACTIVE)


@pytest.mark.parametrize("races", [10, pytest.param(1000, marks=pytest.mark.soak)])
def test_of_several_managers_one_acts(site: Site, quick: Quick, races: int) -> None:
    """Two users of SNMP and a controlling station of IEC 60870-5-104 at a time: a write for each who acts."""
    ca, ioa = map(int, LAMP.split("."))
    row = [f"rtuCommand{name}.{LAMP}" for name in ("SpinLock", "State")]

    async def state_of(*wanted: int) -> list[int]:
        deadline = Deadline(20)
        while (found := await quick.get(CENTRE, *row))[1] not in wanted:
            assert not deadline.over, found
            await asyncio.sleep(0.01)
        return found

    async def told(number: int) -> int:
        """The state of the lamp's command that an event tells; 0: it tells something else."""
        columns = ("Kind", "CommonAddress", "ObjectAddress", "Value")
        *what, state = await quick.get(CENTRE, *(f"rtuEvent{column}.{number}" for column in columns))
        return state if what == [COMMAND, ca, ioa] else 0

    async def race() -> None:
        mark = site.desk.lines.mark()
        spin, *_ = await state_of(INACTIVE)
        (seen,) = await quick.get(CENTRE, "rtuEventLast.0")
        confirming = asyncio.to_thread(site.desk.master.command, ca, ioa, "C_SC_NA_1", c104.SingleCmd(True))
        wishes = [quick.wish(user, LAMP, spin, EXECUTE, 2) for user in (CENTRE, ENGINEER)]
        first, second, confirmed = await asyncio.gather(*wishes, confirming)
        assert not (first and second)
        if first or second:
            spin, _ = await state_of(REFUSED, EXECUTED)
            assert await quick.wish(CENTRE if first else ENGINEER, LAMP, spin, INACTIVE)
        await state_of(INACTIVE)
        # A busy host may let a device miss a request, or its answer: a command is refused then, not repeated.
        states: list[int] = []
        deadline = Deadline(20)

        def all_told() -> bool:
            done, refused, begun = (states.count(state) for state in (EXECUTED, REFUSED, EXECUTING))
            return 0 < begun <= done + refused and done <= site.writes(mark) <= begun

        while not all_told():
            assert not deadline.over, (states, site.desk.lines.frames(mark))
            (last,) = await quick.get(CENTRE, "rtuEventLast.0")
            states += [state for number in range(seen + 1, last + 1) if (state := await told(number))]
            seen = last
        assert states.count(EXECUTED) >= confirmed

    for _ in range(races):
        quick.loop.run_until_complete(race())


# ---- totals, parameters, the clock, groups -------------------------------------------------------

METERS, REGISTER = "2020", "2020.30009"
FREEZE, FREEZE_AND_RESET = 1, 2
VOLTAGES = ("2020.30001", "2020.30003")
WRONG, LIMITS = struct.pack(">f", -1.0), (struct.pack(">f", 10.0), struct.pack(">f", 500.0))


def freeze(site: Site, row: str, action: int, **more: int) -> None:
    """Raises Refused. Waits for all that read the totals."""
    manager = site.manager()
    (spin,) = manager.get(f"rtuFreezeSpinLock.{row}")
    assert isinstance(spin, int)
    values: dict[str, int | bytes] = {f"rtuFreezeSpinLock.{row}": spin, f"rtuFreezeAction.{row}": action}
    manager.set(values | {f"rtuFreeze{key.capitalize()}.{row}": value for key, value in more.items()})
    site.desk.gateway.wait_for(
        lambda: manager.get(f"rtuFreezeState.{row}") != [EXECUTING], 20.0, "the totals are frozen"
    )
    assert manager.get(f"rtuFreezeState.{row}", f"rtuFreezeResult.{row}") == [EXECUTED, DONE]


def test_a_manager_freezes_what_a_counter_interrogation_reads(site: Site) -> None:
    """And resets it: in both, and not in the meter."""
    manager = site.manager()
    site.desk.set_and_scan("2.20", "input_registers", 8, [19, 5])
    (number,) = manager.get(f"rtuTotalFrozenNumber.{REGISTER}")
    freeze(site, METERS, FREEZE)
    frozen, again = manager.get(f"rtuTotalFrozen.{REGISTER}", f"rtuTotalFrozenNumber.{REGISTER}")
    assert (frozen, again) == ((19 << 16) + 5, (number + 1) % 32)
    by_station = {report.ioa: report.value for report in site.desk.master.interrogate_counters(2020)}
    assert by_station[30009] == frozen
    freeze(site, "65535", FREEZE_AND_RESET)
    assert manager.get(f"rtuTotalValue.{REGISTER}", f"rtuTotalFrozen.{REGISTER}") == [0, frozen]
    assert site.desk.lines.get("2.20", "input_registers", 9) == 5
    for action, group, reason in ((4, 0, "wrongValue"), (0, 0, "wrongValue"), (1, 5, "wrongValue")):
        with pytest.raises(Refused, match=reason):
            freeze(site, METERS, action, group=group)


def load(site: Site, user: User, values: dict[str, int | bytes]) -> None:
    """Parameters with the spin locks of their rows. Raises Refused."""
    manager = site.manager(user)
    rows = {key.partition(".")[2] for key in values}
    spins = {f"rtuParameterSpinLock.{row}": manager.get(f"rtuParameterSpinLock.{row}")[0] for row in rows}
    manager.set(spins | values)


def test_parameters_of_a_request_are_in_force_together_or_not_at_all(site: Site) -> None:
    manager, before = site.manager(ENGINEER), site.last()
    low, high = LIMITS
    wanted: dict[str, int | bytes] = {f"rtuParameterLowLimit.{row}": low for row in VOLTAGES}
    wanted |= {f"rtuParameterHighLimit.{row}": high for row in VOLTAGES}
    for name, wrong, reason in (
        ("rtuParameterThreshold", WRONG, "wrongValue"),
        ("rtuParameterThreshold", struct.pack(">f", float("nan")), "wrongValue"),
        ("rtuParameterHighLimit", struct.pack(">f", 9.0), "inconsistentValue"),
        ("rtuParameterHighLimit", b"\0" * 3, "wrongLength"),
        ("rtuParameterCyclic", 1, "inconsistentValue"),
        ("rtuParameterLoaded", b"\0", "notWritable"),
    ):
        with pytest.raises(Refused, match=reason):
            load(site, ENGINEER, wanted | {f"{name}.{VOLTAGES[1]}": wrong})
    with pytest.raises(Refused, match="noAccess"):
        load(site, CENTRE, wanted)
    assert all(manager.get(f"rtuParameterLoaded.{row}") == [NO_BITS] for row in VOLTAGES)
    load(site, ENGINEER, wanted)
    told = site.received.wait_for("rtuParameterChanged", 2, before)
    assert {each.value("rtuParameterHighLimit") for each in told} == {high}
    for row in VOLTAGES:
        state = manager.get(*(f"rtuParameter{name}.{row}" for name in ("LowLimit", "Loaded", "Result")))
        assert state == [low, b"\x30", DONE]


def test_limits_move_in_either_direction(site: Site) -> None:
    """The owner takes one after the other; the low one is never above the high one."""
    row = "2020.30005"
    for low, high in ((100.0, 200.0), (300.0, 400.0), (1.0, 2.0)):
        octets = [struct.pack(">f", low), struct.pack(">f", high)]
        load(
            site,
            ENGINEER,
            {f"rtuParameterLowLimit.{row}": octets[0], f"rtuParameterHighLimit.{row}": octets[1]},
        )
        wanted = [*octets, DONE]
        names = [f"rtuParameter{name}.{row}" for name in ("LowLimit", "HighLimit", "Result")]
        site.desk.gateway.wait_for(
            lambda names=names, wanted=wanted: site.manager().get(*names) == wanted, 20.0, f"{low} to {high}"
        )


def set_clock(site: Site, time_ms: int, user: User = CENTRE, **more: int) -> None:
    manager = site.manager(user)
    (spin,) = manager.get("rtuClockSpinLock.0")
    assert isinstance(spin, int)
    values: dict[str, int | bytes] = {
        "rtuClockSpinLock.0": spin,
        "rtuClockSet.0": time_ms.to_bytes(8, "big"),
    }
    manager.set(values | {f"rtuClock{key.capitalize()}.0": value for key, value in more.items()})
    site.desk.gateway.wait_for(lambda: manager.get("rtuClockResult.0") == [DONE], 20.0, "the clock is set")


def clock_ms(site: Site) -> int:
    (octets,) = site.manager().get("rtuClockTime.0")
    assert isinstance(octets, bytes)
    return int.from_bytes(octets, "big")


def test_a_manager_sets_the_clock(site: Site) -> None:
    """With what its message was under way; an old message finds another number, and a viewer is refused."""
    before, hour = site.last(), 946_684_800_000 + 3_600_000  # in 2000
    began = time.monotonic()
    set_clock(site, hour, delay=5000)
    shown = clock_ms(site) - hour
    assert 5000 <= shown <= 5000 + (time.monotonic() - began) * 1000 + 1
    assert site.received.wait_for("rtuClockChanged", 1, before)[0].value("rtuClockState") == 2
    manager = site.manager()
    (spin,) = manager.get("rtuClockSpinLock.0")
    assert isinstance(spin, int)
    old = {"rtuClockSpinLock.0": spin - 1, "rtuClockSet.0": hour.to_bytes(8, "big")}
    with pytest.raises(Refused, match="inconsistentValue"):
        manager.set(old)
    with pytest.raises(Refused, match="noAccess"):
        set_clock(site, hour, WATCH)
    with pytest.raises(Refused, match="wrongValue"):
        set_clock(site, hour, delay=60_001)
    for beyond in (hour - 2 * 3_600_000, 8_204_716_800_000):  # in 1999 and 2230, which CP56Time2a has not
        with pytest.raises(Refused, match="wrongValue"):
            set_clock(site, beyond)
    set_clock(site, int(time.time() * 1000))


def test_a_group_is_interrogated_as_iec104_does(site: Site) -> None:
    for group, ca in ((1, 1010), (2, 1010), (3, 2020)):
        rows = site.manager().rows("snmpbulkwalk", "-Cr40", f"{oid('rtuGroupData')}.{group}")
        packed = b"".join(rows.values())
        seen = {int.from_bytes(packed[at : at + 3], "big") for at in range(0, len(packed), 12)}
        assert seen == {report.ioa for report in site.desk.master.interrogate(ca, group)}


def test_a_manager_sees_what_a_controlling_station_commands(site: Site) -> None:
    before = site.last()
    ca, ioa = map(int, LAMP.split("."))
    assert site.desk.master.command(ca, ioa, "C_SC_NA_1", c104.SingleCmd(False))
    told = site.received.wait_for("rtuCommandChanged", 2, before)
    assert [each.value("rtuCommandState") for each in told] == [EXECUTING, EXECUTED]
    assert {(each.value("rtuCommandOwner"), each.value("rtuCommandProtocol")) for each in told} == {
        (b"rtu-iec104", 3)
    }
