# SPDX-License-Identifier: GPL-3.0-or-later
"""rtu-snmp: events, as Net-SNMP's snmptrapd and pysnmp get them, and a receiver that is dead."""

import re
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from lab.manager import CENTRE, oid
from rig.snmp import AT_ONCE, FIRST, METER, SINK_TIMEOUT_S, Quick, Site, site_of

pytestmark = pytest.mark.slow

GET_S = 0.05


@pytest.fixture(scope="module")
def site(programs: Path) -> Iterator[Site]:
    with site_of(programs) as site:
        yield site


@pytest.fixture(scope="module")
def quick(site: Site) -> Iterator[Quick]:
    managers = Quick(site.port)
    yield managers
    managers.close()


def test_a_change_is_told_with_its_number(site: Site) -> None:
    before = site.last()
    site.desk.set_and_scan("6.247", "coils", 0, [0])
    site.desk.set_and_scan("6.247", "coils", 0, [1])
    changed = [
        (number, each.objects[f"rtuEventValue.{number}"])
        for each in site.received.wait_for("rtuPointChanged", 1, before)
        for number in each.numbers
        if each.objects[f"rtuEventCommonAddress.{number}"] == 6247
    ]
    assert changed[-1][1] in (1, 2)
    rows = site.manager().rows("snmpbulkwalk", "-Cr40", oid("rtuEventValue"))
    assert rows[f"rtuEventValue.{changed[0][0]}"] == changed[0][1]


def test_no_number_is_left_out_or_told_twice_by_an_informed_sink(site: Site) -> None:
    last = site.last()
    site.desk.gateway.wait_for(lambda: last in site.received.numbers(), 20.0, "the sink has all events")
    numbers = sorted(set(site.received.numbers()))
    assert numbers == list(range(1, numbers[-1] + 1))


def waited_s(pid: int | str) -> float:
    """How long a process was ready to run and had no processor: what is the host's doing, not its own."""
    return int(Path(f"/proc/{pid}/schedstat").read_text().split()[1]) / 1e9


@pytest.mark.parametrize("seconds", [2, pytest.param(60, marks=pytest.mark.soak)])
def test_a_sink_that_is_killed_gets_all_later_and_disturbs_nobody(
    site: Site, quick: Quick, seconds: int
) -> None:
    """100 events a second go on, memory does not grow with them, and no answer waits for the sink."""
    agent = site.desk.gateway.modules()["rtu-snmp"]["pid"]
    times: list[float] = []

    def memory_kib() -> int:
        status = Path(f"/proc/{agent}/status").read_text()
        return int(re.findall(r"^RssAnon:\s+(\d+) kB", status, re.MULTILINE)[0])

    def last_event() -> int:
        waited, begun = waited_s(agent) + waited_s("thread-self"), time.perf_counter()
        (last,) = quick.loop.run_until_complete(quick.get(CENTRE, "rtuEventLast.0"))
        elapsed = time.perf_counter() - begun
        times.append(elapsed - (waited_s(agent) + waited_s("thread-self") - waited))
        return last

    def make_events(seconds: int, first: int) -> int:
        """Each fifth of a second all registers of a meter change, or as often as its line is read."""
        last = last_event()
        for step in range(5 * seconds):
            again = time.monotonic() + 0.2
            site.desk.lines.set(METER, "input_registers", FIRST, *[first + step] * AT_ONCE)
            site.desk.gateway.wait_for(lambda last=last: last_event() >= last + AT_ONCE, 60.0, "events")
            last = last_event()
            time.sleep(max(0.0, again - time.monotonic()))
        return last

    before = make_events(2, 1)
    kib, after = memory_kib(), len(times)
    site.received.stop()
    last = make_events(seconds, 1000)
    grown, found = memory_kib() - kib, sorted(times[after:])
    site.received.start()
    assert last >= before + 100 * seconds
    # A machine that others use stops now and then; who waits for a sink waits for its timeout, at the least.
    assert found[len(found) * 9 // 10] < GET_S
    assert found[-1] < SINK_TIMEOUT_S
    assert grown <= 512
    site.desk.gateway.wait_for(lambda: last in site.received.numbers(), 120.0, "the sink has all events")
    numbers = sorted(set(site.received.numbers()))
    assert numbers == list(range(1, numbers[-1] + 1))
    print(
        f"{last - before} events, {grown} KiB more, {len(found)} GETs, "
        f"half of them below {found[len(found) // 2] * 1e3:.1f} ms, the slowest {found[-1] * 1e3:.1f} ms"
    )
