# SPDX-License-Identifier: GPL-3.0-or-later
"""rtu-snmp: its MIB, its tables, its users and its sizes, as managers see them that others wrote."""

import asyncio
import os
import re
import struct
import subprocess
import textwrap
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from lab.gateway import free_port
from lab.manager import CENTRE, ENGINE, ENGINEER, USERS, WATCH, Refused, Silent, User, columns, oid
from lab.patience import Deadline
from openrtu_tools.codes import QUALITIES
from rig.snmp import (
    BREAKER,
    CYCLIC,
    METER,
    METER_POWER,
    ON,
    POWER_FACTOR,
    SELECT,
    SERIAL,
    Site,
    bulk,
    relayed,
    site_of,
)

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def site(programs: Path) -> Iterator[Site]:
    with site_of(programs) as site:
        yield site


# ---- the MIB -------------------------------------------------------------------------------------


@pytest.mark.slow  # `make test-quick` does not fetch the MIBs of others
def test_the_mib_is_sound(mibs: Path) -> None:
    path = ROOT / "package/openrtu/src/snmp/OPENRTU-MIB.txt"
    paths = f"{mibs}:/usr/share/snmp/mibs"
    lint = subprocess.run(
        ["smilint", "-l", "6", path], env={**os.environ, "SMIPATH": paths}, capture_output=True, text=True
    )
    assert (lint.returncode, lint.stdout + lint.stderr) == (0, "")
    command = [
        "snmptranslate",
        "-M",
        f"{mibs}:/usr/share/snmp/mibs:{path.parent}",
        "-m",
        "OPENRTU-MIB",
        "-On",
    ]
    for name, number in columns().items():
        found = subprocess.run([*command, f"OPENRTU-MIB::{name}"], capture_output=True, text=True).stdout
        assert found.strip() == f".{number}"


@pytest.mark.slow
def test_the_page_asks_with_names(site: Site, mibs: Path, tmp_path: Path) -> None:
    """Step 3 of docs/snmp.md as it stands there, but for the download, the pass phrases and the address."""
    page = (ROOT / "docs/snmp.md").read_text()
    step = page[page.index("3. Ask.") : page.index("If nothing answers")]
    (block,) = re.findall(r"^   ```sh\n(.*?)^   ```$", step, re.DOTALL | re.MULTILINE)
    download, script = textwrap.dedent(block).split("\n", 1)
    assert download == "apt-get download erlang-snmp && dpkg-deb --extract erlang-snmp_*.deb ietf"
    assert mibs.parts[-6:-2] == ("usr", "lib", "erlang", "lib")
    (tmp_path / "ietf").symlink_to(mibs.parents[5])
    for shown, ours in (
        ("-u graphs", f"-u {WATCH.name}"),
        ("-A '…'", f"-A '{WATCH.authentication}'"),
        ("-X '…'", f"-X '{WATCH.encryption}'"),
        ("192.0.2.10", f"127.0.0.1:{site.port}"),
        ("/usr/local/share/snmp/mibs", str(ROOT / "package/openrtu/src/snmp")),
    ):
        assert script.count(shown) == 1
        script = script.replace(shown, ours)
    env = os.environ | {
        "SNMP_PERSISTENT_DIR": str(tmp_path / "kept")
    }  # of net-snmp, which says that it makes it
    (tmp_path / "kept" / "cert_indexes").mkdir(parents=True)
    said = subprocess.run(["bash", "-c", script], cwd=tmp_path, env=env, capture_output=True, text=True)
    assert (said.returncode, said.stderr) == (0, "")
    answered = re.findall(r"^OPENRTU-MIB::rtuMeasuredFloat\.\S+ = ", said.stdout, re.MULTILINE)
    assert len(answered) == len(site.manager(WATCH).rows("snmpbulkwalk", oid("rtuMeasuredFloat")))


@pytest.mark.slow
def test_each_object_of_the_mib_is_there_and_nothing_else(site: Site) -> None:
    """For the operator, who may read all."""
    seen = {key.partition(".")[0] for key in site.manager().rows("snmpbulkwalk", "-Cr40", oid("openRtuMIB"))}
    assert seen == set(columns())


# ---- points --------------------------------------------------------------------------------------

VALUES = {
    "single": ("rtuSingle", lambda value: {"off": 1, "on": 2}[value]),
    "double": ("rtuDouble", lambda value: {"intermediate": 1, "off": 2, "on": 3, "indeterminate": 4}[value]),
    "step": ("rtuStep", int),
    "bitstring": ("rtuBitstring", int),
    "normalized": ("rtuMeasured", lambda value: round(value * 32768)),
    "scaled": ("rtuMeasured", int),
    "float": ("rtuMeasured", None),
    "counter": ("rtuTotal", int),
    "text": ("rtuText", str.encode),
}


@pytest.mark.slow
def test_every_point_is_as_rtuctl_says(site: Site) -> None:
    manager = site.manager(WATCH)
    points = site.desk.gateway.points()
    by_address = {f"{point['ca']}.{point['ioa']}": (name, point) for name, point in points.items()}
    texts = {index: name.decode() for index, name in manager.walk("rtuPointName").items()}
    assert texts == {index: name for index, (name, _) in by_address.items()}
    columns_of = {
        base: (manager.walk(f"{base}Value"), manager.walk(f"{base}Quality"))
        for base in {base for base, _ in VALUES.values()}
    }
    for index, (name, point) in by_address.items():
        base, shown = VALUES[point["type"]]
        values, qualities = columns_of[base]
        quality = sum(QUALITIES[word] for word in point["quality"].split(",") if word != "good")
        assert qualities[index] == bytes([quality]), name
        if not quality and shown is not None:
            assert values[index] == shown(point["value"]), name


def test_a_text_is_told_as_it_is(site: Site) -> None:
    for place, octets in enumerate((b"SN", b"\xb51", b"7\x1b")):
        site.desk.lines.set(METER, "input_registers", SERIAL + place, int.from_bytes(octets))
    site.desk.gateway.wait_for(
        lambda: site.desk.gateway.points()["serial"]["value"] == "SNµ17?", 60.0, "the text is read"
    )
    (index, text), *others = site.manager(WATCH).walk("rtuTextValue").items()
    assert (text, others) == ("SNµ17?".encode(), [])
    assert index in site.manager(WATCH).walk("rtuBitstringValue")


def test_a_float_has_the_decimals_that_it_is_given(site: Site) -> None:
    manager = site.manager(WATCH)
    values, decimals = manager.walk("rtuMeasuredValue"), manager.walk("rtuMeasuredPrecision")
    assert decimals[POWER_FACTOR] == 5
    for point in site.desk.gateway.points().values():
        index = f"{point['ca']}.{point['ioa']}"
        if point["type"] == "float" and point["quality"] == "good":
            assert decimals[index] == (5 if index == POWER_FACTOR else 3)
            assert values[index] == round(point["value"] * 10 ** decimals[index])


@pytest.mark.slow
def test_a_point_has_a_unit_and_limits(site: Site) -> None:
    manager = site.manager(WATCH)
    units = manager.walk("rtuPointUnit")
    assert {index: unit for index, unit in units.items() if unit} == {METER_POWER: b"kW"}
    ends = [manager.walk(f"rtuPoint{end}") for end in ("Low", "High")]
    limits = {index: tuple(struct.unpack(">f", each[index])[0] for each in ends) for index in units}
    assert limits["1010.30003"] == (-32768, 32767)  # scaled
    assert limits[BREAKER] == (0, 3)


# ---- initialisation, cyclic data, polling --------------------------------------------------------


@pytest.mark.slow
def test_the_station_tells_its_start_and_each_end_of_initialisation(site: Site) -> None:
    (started,) = site.received.wait_for("rtuStarted")
    assert started.value("rtuStationStarts") == 1
    assert [each.numbers for each in site.received.wait_for("1.3.6.1.6.3.1.1.5.1")] == [
        [started.numbers[0] - 1]
    ]
    stations = {point["ca"] for point in site.desk.gateway.points().values()}
    told = site.received.wait_for("rtuStationInitialised", len(stations))
    causes = {each.value("rtuEventCommonAddress"): each.value("rtuEventValue") for each in told}
    assert causes == dict.fromkeys(stations, 0)
    assert len(told) == len(stations)
    assert site.manager().walk("rtuInitialised") == dict.fromkeys(map(str, sorted(stations)), 1)


@pytest.mark.slow
def test_cyclic_data_waits_for_each_manager_until_it_has_taken_it(site: Site) -> None:
    """It is told when it waits, and not again until somebody has taken it. Nobody takes another's."""
    manager, other = site.manager(), site.manager(ENGINEER)
    mine, others = (list(USERS).index(user) + 1 for user in (CENTRE, ENGINEER))
    base, wait_for = oid("rtuCyclicFloat"), site.desk.gateway.wait_for

    def taken(number: int) -> None:
        manager.set({f"rtuPollCyclicTaken.{mine}": ("u", number)})

    def number_of(name: str) -> int:
        (number,) = manager.get(name)
        assert isinstance(number, int)
        return number

    def waiting(row: int) -> int:
        return number_of(f"rtuPollCyclicWaiting.{row}")

    def turns(count: int) -> None:
        last = number_of("rtuCyclicLast.0")
        wait_for(lambda: number_of("rtuCyclicLast.0") >= last + count, 20.0, f"{count} more turns")

    def tells() -> int:
        return list(manager.walk("rtuEventKind").values()).count(CYCLIC)

    wait_for(lambda: waiting(mine) > 0, 20.0, "cyclic data waits")
    before, told = site.last(), tells()
    rows = manager.rows("snmpbulkwalk", "-Cr40", base)
    found = {row.split(".", 2)[2]: (int(row.split(".")[1]), value) for row, value in rows.items()}
    turn, value = found[METER_POWER]
    assert manager.get(f"rtuMeasuredFloat.{METER_POWER}") == [value]
    deadline = Deadline(30)
    while tells() == told:  # a turn can end before what was the last one is taken
        assert not deadline.over
        taken(number_of("rtuCyclicLast.0"))
    ready = site.received.wait_for("rtuCyclicReady", 1, before)
    assert int(ready[0].value("rtuCyclicLast")) > turn
    turns(1)
    told = tells()
    turns(2)
    assert tells() == told
    assert waiting(others) >= waiting(mine) > 0
    (newer,) = manager.rows("snmpgetnext", f"{base}.{turn}.65535.16777215")
    assert int(newer.split(".")[1]) > turn
    last = number_of("rtuCyclicLast.0")
    for number, user, reason in ((last + 1000, manager, "wrongValue"), (1, other, "noAccess")):
        with pytest.raises(Refused, match=reason):
            user.set({f"rtuPollCyclicTaken.{mine}": ("u", number)})
    with pytest.raises(Refused, match="wrongType"):
        manager.set({f"rtuPollCyclicTaken.{mine}": 1})


@pytest.mark.slow
def test_class_1_is_polled_by_number(site: Site) -> None:
    manager, row = site.manager(), list(USERS).index(CENTRE) + 1
    last = site.last()
    manager.set({f"rtuPollEventTaken.{row}": ("u", last)})
    site.desk.set_and_scan("6.247", "coils", 0, [0])
    site.desk.set_and_scan("6.247", "coils", 0, [1])
    waiting, newest = manager.get(f"rtuPollEventsWaiting.{row}", "rtuEventLast.0")
    assert isinstance(newest, int) and newest > last
    assert waiting == newest - last
    (first,) = manager.rows("snmpgetnext", f"{oid('rtuEventKind')}.{last}")
    assert first == f"rtuEventKind.{last + 1}"


def test_a_float_is_told_whole(site: Site) -> None:
    octets = site.manager().walk("rtuMeasuredFloat")
    for name, point in site.desk.gateway.points().items():
        if point["type"] == "float" and point["quality"] == "good":
            (number,) = struct.unpack(">f", octets[f"{point['ca']}.{point['ioa']}"])
            assert number == pytest.approx(point["value"], rel=1e-6), name


def test_the_image_says_what_the_tables_say(site: Site) -> None:
    """An interrogation in few octets."""
    manager = site.manager()
    found = {}
    for index, data in manager.walk("rtuImageData").items():
        ca = index.split(".")[0]
        assert len(data) % 12 == 0
        for at in range(0, len(data), 12):
            ioa, kind = int.from_bytes(data[at : at + 3], "big"), data[at + 3]
            found[f"{ca}.{ioa}"] = (kind, data[at + 4 : at + 8], data[at + 8])
    assert {index: kind for index, (kind, _, _) in found.items()} == manager.walk("rtuPointType")
    for index, value in manager.walk("rtuMeasuredFloat").items():
        kind, octets, _ = found[index]
        number = struct.unpack(">f" if kind == 7 else ">i", octets)[0]
        assert number == struct.unpack(">f", value)[0], index


# ---- who may what --------------------------------------------------------------------------------


@pytest.mark.slow
def test_versions_without_security_have_no_answer(site: Site) -> None:
    for version in ("1", "2c"):
        with pytest.raises(Silent):
            site.manager(timeout_s=1).run("snmpget", oid("rtuStationName.0"), version=version)


@pytest.mark.sample(2)
@pytest.mark.parametrize("level", ["noAuthNoPriv", "authNoPriv"])
def test_without_encryption_nothing_is_told(site: Site, level: str) -> None:
    with pytest.raises(Refused, match="authorizationError"):
        site.manager(level=level).get("rtuStationName.0")


@pytest.mark.parametrize(
    "user",
    [User("nobody", CENTRE.authentication, CENTRE.encryption), User("centre", "wrong-authentic", "x" * 8)],
)
def test_a_stranger_has_no_answer(site: Site, user: User) -> None:
    with pytest.raises((Silent, Refused)):
        site.manager(user, timeout_s=1).get("rtuStationName.0")


def test_a_viewer_only_views(site: Site) -> None:
    viewer = site.manager(WATCH)
    with pytest.raises(Refused, match="noAccess"):
        viewer.wish(BREAKER, SELECT, value=ON)
    assert not viewer.rows("snmpbulkwalk", oid("rtuSinkTable")) or "No Such" in viewer.run(
        "snmpget", oid("rtuSinkName.1")
    )
    assert "No Such" in viewer.run("snmpget", oid("rtuSinkName.1"))


@pytest.mark.parametrize(
    ("options", "report", "said"),
    [
        (["-n", "other"], "1.3.6.1.6.3.12.1.5.0", "Bad context"),
        (["-E", "8000000001020304"], "1.3.6.1.6.3.11.2.1.3.0", "Bad version"),  # Net-SNMP's word for it
    ],
)
def test_an_unknown_context_is_reported(site: Site, options: list[str], report: str, said: str) -> None:
    """RFC 3413, 3.2: snmpUnknownContexts. RFC 3412, 4.2.2.1.2: snmpUnknownPDUHandlers, of another engine."""
    manager = site.manager()
    (before,) = manager.get(report)
    with pytest.raises(Silent, match=said):
        manager.run("snmpget", *options, oid("rtuStationName.0"))
    assert manager.get(report, "rtuStationName.0") == [before + 1, b"OpenRTU"]


@pytest.mark.slow
def test_what_is_no_object_is_told_apart_from_what_has_no_instance(site: Site) -> None:
    """RFC 3416, 4.2.1."""
    table = oid("rtuCommandTable")
    for names, words in (
        (("rtuStationName.1", "rtuStationName", f"{table}.1.2.1.1", "1.3.6.1.2.1.1.4"), "Instance"),
        ((f"{table}.1.77.1.1", f"{table}.2", "1.3.6.1.2.1.1.99.0", "1.3.6.1.6.3.15.1.2.2.1.3.0"), "Object"),
    ):
        for name in names:
            assert f"No Such {words}" in site.manager().run("snmpget", oid(name)), name
    assert "No Such Object" in site.manager(WATCH).run("snmpget", oid("rtuSinkName.1"))


def test_what_managers_find_a_device_by(site: Site) -> None:
    """sysContact, sysServices and sysLocation, and what is counted of messages by USM."""
    manager = site.manager()
    system = [manager.get(f"1.3.6.1.2.1.1.{number}.0")[0] for number in (4, 6, 7)]
    assert system == [b"control room", b"cabinet 2", 72]
    before = manager.get(*(f"1.3.6.1.6.3.15.1.1.{number}.0" for number in range(1, 7)))
    with pytest.raises((Silent, Refused)):
        site.manager(User("nobody", CENTRE.authentication, CENTRE.encryption), timeout_s=1).get(
            "rtuStationName.0"
        )
    with pytest.raises((Silent, Refused)):
        site.manager(User("centre", "wrong-authentic", "x" * 8), timeout_s=1).get("rtuStationName.0")
    after = manager.get(*(f"1.3.6.1.6.3.15.1.1.{number}.0" for number in range(1, 7)))
    assert [new > old for new, old in zip(after, before, strict=True)] == [
        False,
        False,
        True,
        True,
        True,
        False,
    ]
    messages = manager.rows("snmpbulkwalk", "1.3.6.1.2.1.11")
    assert [int(name.split(".")[-2]) for name in messages] == [1, 3, 4, 5, 6, 30, 31, 32]


@pytest.mark.slow
def test_the_agent_names_the_modules_of_its_objects(site: Site) -> None:
    """sysORTable (RFC 3418). Of SNMPv2-MIB and IF-MIB the name lies elsewhere than the objects."""
    manager = site.manager(WATCH)
    ids, texts, times = (manager.walk(f"1.3.6.1.2.1.1.9.1.{column}") for column in (2, 3, 4))
    named = {bytes(text).split()[0].decode(): str(ids[index]).lstrip(".") for index, text in texts.items()}
    objects = {"SNMPv2-MIB": "1.3.6.1.2.1.11", "IF-MIB": "1.3.6.1.2.1.2"}
    assert len(named) == 8
    assert named["OPENRTU-MIB"] == oid("openRtuMIB")
    for name, number in named.items():
        (found,) = manager.rows("snmpgetnext", objects.get(name, number))
        assert f"{oid(found)}.".startswith(f"{objects.get(name, number)}."), name
    assert set(times.values()) == set(manager.get("1.3.6.1.2.1.1.8.0")) == {"0:0:00:00.00"}


def test_the_tables_of_users_and_views_are_not_there(site: Site) -> None:
    for table in ("1.3.6.1.6.3.15.1.2", "1.3.6.1.6.3.16"):
        assert "No Such" in site.manager(ENGINEER).run("snmpget", f"{table}.2.1.3.0")
    with pytest.raises(Refused, match="noCreation"):
        site.manager(ENGINEER).set({"1.3.6.1.6.3.15.1.2.1.0": 1})


# ---- sizes ---------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.sample(3)
@pytest.mark.parametrize("most", [484, 1472, 65507])
def test_an_answer_is_no_longer_than_its_asker_takes(site: Site, most: int) -> None:
    """However much is asked for: through a relay that measures."""
    messages: list[bytes] = []
    with relayed(site.port, messages) as port:
        asked = asyncio.run(bulk(port, most))
    assert len(asked) > 4
    assert min(most, 1472) - 120 < max(map(len, messages)) <= min(most, 1472)


@pytest.mark.parametrize("repeaters", [65, 1500])
def test_a_bulk_of_many_repeaters_is_told_in_their_order(site: Site, repeaters: int) -> None:
    """RFC 3416, 4.2.3: the whole first repetition before the second. A full answer ends where it is full."""
    system = "1.3.6.1.2.1.1"
    asked = [f"{system}.1", *["2.100"] * (repeaters - 2), f"{system}.2"]
    text = site.manager().run("snmpbulkget", "-Cn0", "-Cr2", *asked)
    told = re.findall(r"^\.(\S+) ", text, re.MULTILINE)
    first = [f"{system}.1.0", *["2.100"] * (repeaters - 2), f"{system}.2.0"]
    second = [f"{system}.2.0", *["2.100"] * (repeaters - 2), f"{system}.3.0"]
    assert told == (first + second)[: len(told)]
    assert len(told) == 2 * repeaters if repeaters < 80 else 100 < len(told) < repeaters


@pytest.mark.slow
def test_tshark_with_the_keys_reads_it(site: Site, tmp_path: Path) -> None:
    """A request and its answer, authentic by tshark's own reckoning, decrypted and decoded."""
    messages: list[bytes] = []
    with relayed(site.port, messages) as port:
        name, number = replace(site.manager(), port=port).get(f"rtuPointName.{BREAKER}", "rtuEventLast.0")
    assert isinstance(name, bytes)
    dump, packets = tmp_path / "dump", tmp_path / "packets"
    # Each octet has its line: text2pcap wants no more than the offset.
    lines = ("".join(f"{at:06x} {octet:02x}\n" for at, octet in enumerate(each)) for each in messages)
    dump.write_text("\n".join(lines))
    subprocess.run(["text2pcap", "-q", "-u", "40000,161", dump, packets], check=True)
    words = (CENTRE.name, "SHA2-256", CENTRE.authentication, "AES", CENTRE.encryption)
    users = ",".join([ENGINE, *(f'"{word}"' for word in words)])
    wanted = ("snmp.authentication_ok", "snmp.name", "snmp.value.octets", "snmp.value.g32")
    read = subprocess.run(
        ["tshark", "-r", packets, "-o", f"uat:snmp_users:{users}", "-T", "fields"]
        + [word for field in wanted for word in ("-e", field)],
        capture_output=True,
        text=True,
        check=True,
    )
    names = f"{oid(f'rtuPointName.{BREAKER}')},{oid('rtuEventLast.0')}"
    *_, request, answer = (line.split("\t") for line in read.stdout.splitlines())
    assert request[1] == names
    assert answer[1:] == [names, name.hex(), str(number)]
    assert request[0] and answer[0]


# ---- what others make of it ----------------------------------------------------------------------


@pytest.mark.slow
def test_prometheus_graphs_it(site: Site, mibs: Path, exporter: Path, tmp_path: Path) -> None:
    """Debian's exporter, with what its generator makes of our example."""
    example = (ROOT / "docs/examples/snmp/generator.yml").read_text()
    for shipped, ours in (
        ("username: graphs", f"username: {WATCH.name}"),
        (" password: changed-by-you", f" password: {WATCH.authentication}"),
        ("changed-by-you-too", WATCH.encryption),
    ):
        assert example.count(f"{shipped}\n") == 1
        example = example.replace(f"{shipped}\n", f"{ours}\n")
    (tmp_path / "generator.yml").write_text(example)
    paths = {"MIBDIRS": f"{mibs}:/usr/share/snmp/mibs:{ROOT / 'package/openrtu/src/snmp'}"}
    generate = [exporter / "prometheus-snmp-generator", "generate"]
    subprocess.run(generate, cwd=tmp_path, env=os.environ | paths, check=True, capture_output=True)
    port = free_port()
    command = [
        exporter / "prometheus-snmp-exporter",
        "--config.file=snmp.yml",
        f"--web.listen-address=127.0.0.1:{port}",
    ]
    with subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.DEVNULL) as server:
        try:
            page = f"http://127.0.0.1:{port}/snmp?target=127.0.0.1:{site.port}&module=openrtu"
            text = fetched(page)
        finally:
            server.kill()
    values = dict(re.findall(r'^rtuMeasuredValue\{.*rtuPointName="([^"]+)".*\} (\S+)$', text, re.MULTILINE))
    for name, point in site.desk.gateway.points().items():
        if point["type"] == "scaled" and point["quality"] == "good":
            assert float(values[name]) == point["value"], name
    assert re.search(r'^rtuCounterValue\{rtuCounterIndex="1",rtuCounterName="', text, re.MULTILINE)


def fetched(page: str) -> str:
    """Waits until somebody listens there."""
    deadline = Deadline(30)
    while True:
        try:
            with urllib.request.urlopen(page, timeout=30) as answer:
                text = answer.read().decode()
                assert isinstance(text, str)
                return text
        except urllib.error.URLError:
            assert not deadline.over, page
            time.sleep(0.05)
