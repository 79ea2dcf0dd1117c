# SPDX-License-Identifier: GPL-3.0-or-later
"""IF-MIB and HOST-RESOURCES-MIB, as managers read them that others wrote; `ip` says what is right."""

import asyncio
import contextlib
import json
import os
import re
import shutil
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pysnmp.hlapi.v3arch.asyncio import (
    ContextData,
    ObjectIdentity,
    ObjectType,
    SnmpEngine,
    UdpTransportTarget,
    bulk_walk_cmd,
)

from lab.manager import USERS, WATCH, Manager, Silent
from rig.rights import SUPERUSER, needed
from rig.snmp import Site, secrets_of, site_of

INTERFACES, EXTRAS, HOST = "1.3.6.1.2.1.2", "1.3.6.1.2.1.31.1.1.1", "1.3.6.1.2.1.25"
ENTRY, STORAGE = f"{INTERFACES}.2.1", f"{HOST}.2.3.1"
DESCRIPTION, TYPE, MTU, SPEED, ADDRESS, ADMIN, OPERATION, CHANGED, IN, OUT = 2, 3, 4, 5, 6, 7, 8, 9, 10, 16
NAME, LONG_IN, LONG_OUT, HIGH_SPEED, CONNECTOR, ALIAS, DISCONTINUITY = 1, 6, 10, 15, 17, 18, 19
UP, DOWN, LOWER_DOWN = 1, 2, 7
ETHERNET, LOOPBACK = 6, 24
TRAPS, LINK_DOWN, LINK_UP, ENABLED = "1.3.6.1.6.3.1.1.5", 3, 4, 1
PAIR = [f"rtu{end}{os.getpid()}" for end in "ab"]
PATIENCE_S = 20.0
ours = needed(SUPERUSER, "interfaces are root's to make")


@pytest.fixture(scope="module")
def site(programs: Path) -> Iterator[Site]:
    with site_of(programs) as site:
        yield site


def ip(*words: str) -> None:
    subprocess.run(["ip", "link", *words], check=True)


def links() -> dict[str, Any]:
    """As the kernel has them now."""
    command = ["ip", "-details", "-statistics", "-json", "link", "show"]
    return {link["ifname"]: link for link in json.loads(subprocess.check_output(command))}


@contextlib.contextmanager
def pair() -> Iterator[tuple[str, str]]:
    """Two interfaces with a cable between."""
    near, far = PAIR
    ip("add", near, "type", "veth", "peer", "name", far)
    try:
        yield near, far
    finally:
        if near in links():
            ip("del", near)


def column(manager: Manager, number: int, entry: str = ENTRY) -> dict[int, Any]:
    return {int(index): value for index, value in manager.walk(f"{entry}.{number}").items()}


def ticks(manager: Manager, *names: str) -> list[int]:
    """TimeTicks, which Net-SNMP prints as days, hours, minutes and seconds."""
    found = []
    for text in manager.get(*names):
        days, hours, minutes, seconds = str(text).split(":")
        found.append(((int(days) * 24 + int(hours)) * 60 + int(minutes)) * 6000 + round(float(seconds) * 100))
    return found


def number_of(manager: Manager, name: str) -> int:
    (number,) = (index for index, value in column(manager, DESCRIPTION).items() if value == name.encode())
    return number


def wait_gone(site: Site, manager: Manager, name: str) -> None:
    site.desk.gateway.wait_for(
        lambda: name.encode() not in column(manager, DESCRIPTION).values(), PATIENCE_S, f"{name} is gone"
    )


def fresh(site: Site, manager: Manager, number: int, which: int, value: int) -> None:
    """The agent looks again after a second."""
    site.desk.gateway.wait_for(
        lambda: manager.get(f"{ENTRY}.{which}.{number}") == [value], PATIENCE_S, f"{which} is {value}"
    )


# ---- interfaces ----------------------------------------------------------------------------------


@pytest.mark.slow
def test_each_interface_is_as_the_kernel_has_it(site: Site) -> None:
    """Others come and go on this machine meanwhile: of all that were there before and are there after."""
    manager = site.manager(WATCH)
    before = links()
    found = {number: column(manager, number) for number in (DESCRIPTION, TYPE, MTU, ADDRESS, ADMIN, IN, OUT)}
    names = column(manager, NAME, EXTRAS)
    long_in = column(manager, LONG_IN, EXTRAS)
    after = links()
    told = {value.decode(): index for index, value in found[DESCRIPTION].items()}
    assert set(before) & set(after) <= set(told) <= set(before) | set(after)
    assert "lo" in told
    for name in set(before) & set(after):
        link, index = before[name], told[name]
        assert names[index] == name.encode()
        if not link.get("linkinfo"):
            assert found[TYPE][index] == {"loopback": LOOPBACK, "ether": ETHERNET}[link["link_type"]]
        assert found[MTU][index] == link["mtu"]
        if link["link_type"] in ("loopback", "ether"):
            address = "" if name == "lo" else link["address"]
            assert found[ADDRESS][index].hex(":") == address
        assert found[ADMIN][index] == (UP if "UP" in link["flags"] else DOWN)
        assert long_in[index] <= after[name]["stats64"]["rx"]["bytes"]
    (count,) = manager.get(f"{INTERFACES}.1.0")
    assert count == len(column(manager, 1))
    loopback, octets = told["lo"], after["lo"]["stats64"]["rx"]["bytes"]
    site.desk.gateway.wait_for(
        lambda: manager.get(f"{EXTRAS}.{LONG_IN}.{loopback}")[0] >= octets, PATIENCE_S, "it looks again"
    )
    assert manager.get(f"{ENTRY}.{IN}.{loopback}")[0] < 2**32


@ours
def test_an_interface_has_what_others_graph(site: Site) -> None:
    manager = site.manager(WATCH)
    with pair() as (near, far):
        ip("set", near, "alias", "to the process bus")
        number = number_of(manager, near)
        assert manager.get(f"{ENTRY}.{ADMIN}.{number}", f"{ENTRY}.{OPERATION}.{number}") == [DOWN, DOWN]
        ip("set", near, "up")
        fresh(site, manager, number, OPERATION, LOWER_DOWN)
        ip("set", far, "up")
        fresh(site, manager, number, OPERATION, UP)
        # A pair says that it has 10 Gbit/s, which ifSpeed cannot say: RFC 2863.
        said = manager.get(
            f"{ENTRY}.{SPEED}.{number}",
            *(f"{EXTRAS}.{each}.{number}" for each in (HIGH_SPEED, CONNECTOR, ALIAS)),
        )
        assert said == [2**32 - 1, 10_000, DOWN, b"to the process bus"]


@pytest.mark.slow
@ours
def test_times_are_of_the_moment(site: Site) -> None:
    """ifLastChange and its like are sysUpTime then, though nobody asked meanwhile."""
    manager = site.manager(WATCH)
    changed, table, came = f"{ENTRY}.{CHANGED}", "1.3.6.1.2.1.31.1.5.0", f"{EXTRAS}.{DISCONTINUITY}"

    def up_time() -> int:
        return ticks(manager, "1.3.6.1.2.1.1.3.0")[0]

    first = column(manager, DESCRIPTION)
    loopback = number_of(manager, "lo")
    assert ticks(manager, f"{changed}.{loopback}", f"{came}.{loopback}") == [0, 0]
    start = up_time()
    with pair() as (near, far):
        ip("set", near, "up")
        ip("set", far, "up")
        made = up_time()
        site.desk.gateway.wait_for(lambda: up_time() > made + 20, PATIENCE_S, "time passes")
        number = number_of(manager, near)
        times = ticks(manager, f"{changed}.{number}", f"{came}.{number}")
        assert number not in first
        assert all(start <= each <= made for each in times), (start, times, made)
        (last,) = ticks(manager, table)
        assert last >= start


@pytest.mark.slow
@ours
def test_a_link_that_changes_is_told(site: Site) -> None:
    """linkDown and linkUp with their three objects (RFC 2863), and the number of the event."""
    manager = site.manager(WATCH)

    def told(kind: int) -> list[Any]:
        told = site.received.wait_until(
            f"{TRAPS}.{kind}", lambda each: each.objects.get(f"{ENTRY}.1.{number}") == number
        )
        assert told.numbers
        return [told.objects[f"{ENTRY}.{column}.{number}"] for column in (1, ADMIN, OPERATION)]

    with pair() as (near, far):
        ip("set", far, "up")
        number = number_of(manager, near)
        assert manager.get(f"{EXTRAS}.14.{number}") == [ENABLED]
        ip("set", near, "up")
        assert told(LINK_UP) in ([number, UP, UP], [number, UP, LOWER_DOWN])  # no more than not down
        ip("del", near)
        assert told(LINK_DOWN) == [number, DOWN, DOWN]


@ours
def test_an_interface_that_comes_again_keeps_its_number(site: Site) -> None:
    """As a modem does each day: also over a kill of the agent. Meanwhile nobody else has the number."""
    manager, gateway = site.manager(WATCH), site.desk.gateway
    with pair() as (near, _):
        number = number_of(manager, near)
        kernel = links()[near]["ifindex"]
        ip("del", near)
        wait_gone(site, manager, near)
    with pair():
        assert links()[near]["ifindex"] > kernel
        assert number_of(manager, near) == number
        ip("del", near)
        wait_gone(site, manager, near)
    before = gateway.modules()["rtu-snmp"]["restarts"]
    numbers = {value: index for index, value in column(manager, DESCRIPTION).items()}
    gateway.kill("rtu-snmp")
    gateway.wait_for(
        lambda: gateway.modules()["rtu-snmp"]["restarts"] > before, PATIENCE_S, "it was restarted"
    )
    gateway.wait_for(lambda: gateway.modules()["rtu-snmp"]["alive"], PATIENCE_S, "it runs again")
    with pair():
        again = {value: index for index, value in column(manager, DESCRIPTION).items()}
        assert again[near.encode()] == number
        assert all(again.get(name, index) == index for name, index in numbers.items())


@pytest.mark.slow
@ours
def test_a_number_outlives_a_changed_configuration(site: Site) -> None:
    """The agent starts anew with it."""
    manager, gateway = site.manager(WATCH), site.desk.gateway
    with pair() as (near, _):
        number = number_of(manager, near)
        ip("del", near)
        wait_gone(site, manager, near)
    config = gateway.configuration()
    config["snmp"]["contact"] = "another room"
    gateway.ctl("reload", gateway.put(config))

    def is_in_force() -> bool:
        with contextlib.suppress(Silent):
            return manager.get("1.3.6.1.2.1.1.4.0") == [b"another room"]
        return False

    gateway.wait_for(is_in_force, 3 * PATIENCE_S, "the new contact")
    with pair():
        assert number_of(manager, near) == number


@ours
def test_a_renamed_interface_keeps_its_number(site: Site) -> None:
    manager = site.manager(WATCH)
    with pair() as (near, far):
        number = number_of(manager, far)
        other = f"{far[:-1]}x"
        ip("set", far, "name", other)
        site.desk.gateway.wait_for(
            lambda: column(manager, DESCRIPTION).get(number) == other.encode(), PATIENCE_S, "it is renamed"
        )
        assert number_of(manager, near) != number


# ---- memory, file systems ------------------------------------------------------------------------


def test_memory_and_uptime_are_the_machines(site: Site) -> None:
    manager = site.manager(WATCH)
    total = int(re.search(r"MemTotal: +(\d+)", Path("/proc/meminfo").read_text())[1])  # type: ignore[index]
    before = time.clock_gettime(time.CLOCK_BOOTTIME)
    (up,) = ticks(manager, f"{HOST}.1.1.0")
    size, unit, ram, used = manager.get(f"{HOST}.2.2.0", f"{STORAGE}.4.1", f"{STORAGE}.5.1", f"{STORAGE}.6.1")
    after = time.clock_gettime(time.CLOCK_BOOTTIME)
    assert int(before * 100) <= up <= int(after * 100)
    assert (size, unit, ram) == (total, 1024, total)
    assert 0 < used < total
    kinds = [
        each.rpartition(".")[2] for each in manager.walk(f"{STORAGE}.2").values() if isinstance(each, str)
    ]
    assert kinds[0] == "2"  # hrStorageRam
    assert "No Such Object" in manager.run("snmpget", f"{HOST}.3.2.1.3.1")


def test_file_systems_are_as_df_has_them(site: Site) -> None:
    manager = site.manager(WATCH)
    texts = {index: text.decode() for index, text in manager.walk(f"{STORAGE}.3").items()}
    units, sizes = manager.walk(f"{STORAGE}.4"), manager.walk(f"{STORAGE}.5")
    places = {text: index for index, text in texts.items() if text.startswith("/")}
    mounts = {line.split()[4] for line in Path("/proc/self/mountinfo").read_text().splitlines()}
    assert places and ("/" in places) == ("/" in mounts)  # a chroot's root need not be a mount
    for place, index in places.items():
        total = shutil.disk_usage(place).total
        assert total - units[index] < units[index] * sizes[index] <= total, place


# ---- what others make of it ----------------------------------------------------------------------


@pytest.mark.slow
def test_net_snmp_prints_interfaces_and_disks(site: Site, tmp_path: Path) -> None:
    """snmpnetstat and snmpdf. Debian has no text of HOST-RESOURCES-MIB; snmpdf needs its names alone."""
    table = "org(3) dod(6) internet(1) mgmt(2) mib-2(1) host(25) storage(2) 3 1"
    names = "hrStorageIndex hrStorageType hrStorageDescr hrStorageAllocationUnits hrStorageSize hrStorageUsed"
    nodes = [("hrStorageEntry", f"iso {table}")]
    nodes += [(name, f"hrStorageEntry {number}") for number, name in enumerate(names.split(), 1)]
    lines = [f"{name} OBJECT IDENTIFIER ::= {{ {place} }}" for name, place in nodes]
    text = "\n".join(["HOST-RESOURCES-MIB DEFINITIONS ::= BEGIN", *lines, "END\n"])
    (tmp_path / "HOST-RESOURCES-MIB.txt").write_text(text)
    manager = site.manager(WATCH)
    assert re.search(r"^lo +65536 ", manager.run("snmpnetstat", "-Ci"), re.MULTILINE)
    disks = manager.run("snmpdf", "-M", str(tmp_path), "-m", "HOST-RESOURCES-MIB")
    size = shutil.disk_usage("/").total // 1024
    (told,) = re.findall(r"^/ +(\d+) ", disks, re.MULTILINE)
    assert abs(int(told) - size) * 10000 < size
    assert re.search(r"^Physical memory +\d+ ", disks, re.MULTILINE)


@pytest.mark.slow
def test_pysnmp_walks_the_same(site: Site) -> None:
    """Another decoder, of 64-bit counters too; no name comes twice, and all are in order."""

    async def walk(start: str) -> list[tuple[tuple[int, ...], Any]]:
        engine = SnmpEngine()
        target = await UdpTransportTarget.create(("127.0.0.1", site.port), timeout=5, retries=0)
        rows = []
        async for failure, status, _, binds in bulk_walk_cmd(
            engine,
            secrets_of(WATCH),
            target,
            ContextData(),
            0,
            20,
            ObjectType(ObjectIdentity(start)),
            lookupMib=False,
            lexicographicMode=False,
        ):
            assert (str(failure), int(status)) == ("None", 0)
            rows += [(tuple(name), value) for name, value in binds]
        engine.close_dispatcher()
        return rows

    for start in ("1.3.6.1.2.1.2", "1.3.6.1.2.1.25", "1.3.6.1.2.1.31"):
        rows = asyncio.run(walk(start))
        names = [name for name, _ in rows]
        assert names == sorted(set(names))
        theirs = site.manager(WATCH).rows("snmpbulkwalk", start)
        assert abs(len(theirs) - len(rows)) < 100
    kinds = {
        type(value).__name__ for name, value in rows if name[:11] == (1, 3, 6, 1, 2, 1, 31, 1, 1, 1, LONG_IN)
    }
    assert kinds == {"Counter64"}


@pytest.mark.slow
def test_all_roles_see_the_machine(site: Site) -> None:
    for user in USERS:
        assert site.manager(user).get(f"{INTERFACES}.1.0") != []
