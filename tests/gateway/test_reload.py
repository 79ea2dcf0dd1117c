# SPDX-License-Identifier: GPL-3.0-or-later
"""A configuration that changes while the gateway runs: what did not change does not notice."""

import contextlib
import copy
import csv
import io
import itertools
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from lab.gateway import Gateway, free_port, listening_on, remove, run_directory
from lab.linesim import LineSim
from lab.manager import CENTRE, USERS, free_udp_port, make_keys
from lab.master import Master, Report
from rig.desk import Substation, chapter_5, everything_read, values_of
from rig.web import make_user

ROOT = Path(__file__).resolve().parents[2]
PYTHON = "/usr/bin/python3" if Path("/usr/bin/python3").exists() else sys.executable
STEADY, CHANGED, ADDED = "rtu-modbus-2", "rtu-modbus-1", "rtu-modbus-3"
STEADY_CA, STEADY_DEVICE = 4040, "4.40"
CHANGED_CA, CHANGED_DEVICE = 3035, "3.35"
NEW_CA = 3067  # on the line of CHANGED_DEVICE
OWN_LINE_CA = 2020  # on a line of its own
RELOAD_S = 60.0
PULSE_MS = 1500
KILLS = 6
RELOADS = 8  # of random configurations

Config = dict[str, Any]


def whole() -> Config:
    """Lines 2, 3 and 4 of chapter 5, in three processes."""
    config = chapter_5()
    processes = {2: 3, 3: 1, 4: 2}
    config["port"] = [
        port | {"process": processes[port["value"]]} for port in config["port"] if port["value"] in processes
    ]
    return config


def reduced(config: Config, *devices: str) -> Config:
    """With these devices alone; a line without devices is left out."""
    left = copy.deepcopy(config)
    for port in left["port"]:
        port["slaves"] = [slave for slave in port["slaves"] if f"{port['value']}.{slave['id']}" in devices]
    left["port"] = [port for port in left["port"] if port["slaves"]]
    return left


SMALL = (STEADY_DEVICE, CHANGED_DEVICE)


@dataclass
class Site(Substation):
    """Devices of which the gateway knows some."""

    config: Config  # of all devices

    def file_of(self, config: Config, name: str = "next.json") -> Path:
        path = self.gateway.directory / name
        path.write_text(json.dumps(config))
        return path

    def begin(self, config: Config, *options: str) -> subprocess.Popen[str]:
        command = [*self.gateway.rtuctl, "reload", str(self.file_of(config)), *options]
        return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    def reload(self, config: Config, *options: str) -> tuple[int, str, str]:
        process = self.begin(config, *options)
        output, errors = process.communicate(timeout=RELOAD_S)
        return process.returncode, without_notes(output), without_notes(errors)


def without_notes(text: str) -> str:
    return "".join(line for line in text.splitlines(keepends=True) if ": note: " not in line)


@contextlib.contextmanager
def site_of(build: Path, *devices: str, more: Config | None = None) -> Iterator[Site]:
    directory = run_directory()
    config = listening_on(whole(), free_port()) | (more or {})
    with contextlib.ExitStack() as stack:
        stack.callback(remove, directory)
        lines_file, values_file = directory / "linesim.json", directory / "values.json"
        lines_file.write_text(json.dumps(config))
        values_file.write_text(json.dumps(values_of(config)))
        lines = stack.enter_context(LineSim(lines_file, values_file, directory / "dev"))
        gateway = stack.enter_context(Gateway(reduced(config, *devices), directory, build))
        gateway.wait_for(lambda: everything_read(gateway), 60.0, "every device has been read")
        yield Site(lines, gateway, config)


@pytest.fixture
def site(programs: Path) -> Iterator[Site]:
    with site_of(programs, *SMALL) as site:
        yield site


@pytest.fixture
def master(site: Site) -> Iterator[Master]:
    with Master(*site.gateway.address) as master:
        master.synchronise_clock(STEADY_CA)
        yield master


def pids(site: Site) -> dict[str, int]:
    return {name: row["pid"] for name, row in site.gateway.modules().items()}


def connections(site: Site) -> list[tuple[str, bool]]:
    return [(row["peer"], row["started"]) for row in site.gateway.query("iec104", "connections")]


def polls(site: Site, port: int, since: int) -> list[int]:
    """When the line was asked."""
    return [
        frame.monotonic_ns
        for frame in site.lines.frames(since)
        if (frame.kind, frame.port) == ("received", port)
    ]


def changes(reports: list[Report], ca: int, ioa: int) -> list[Any]:
    return [r.value for r in reports if (r.ca, r.ioa, r.cause) == (ca, ioa, "SPONTANEOUS")]


# ---- what is said before --------------------------------------------------------------------------


def test_dry_run_says_what_would_change_and_changes_nothing(site: Site) -> None:
    before = site.gateway.points(), pids(site)
    code, output, _ = site.reload(reduced(site.config, CHANGED_DEVICE, "2.20"), "--dry-run")
    lines = output.splitlines()
    assert code == 0
    assert lines[:4] == [
        "rtu-iec104 is not touched",
        f"{CHANGED} is not touched",
        f"{STEADY} is removed",
        f"{ADDED} is added",
    ]
    assert {line.split(", CA ")[1].split(",")[0] for line in lines if line.startswith("  - ")} == {
        str(STEADY_CA)
    }
    assert {line.split(", CA ")[1].split(",")[0] for line in lines if line.startswith("  + ")} == {
        str(OWN_LINE_CA)
    }
    assert (set(site.gateway.points()), pids(site)) == (set(before[0]), before[1])


@pytest.mark.slow
def test_file_with_errors_changes_nothing_and_is_explained(site: Site) -> None:
    wrong = reduced(site.config, *SMALL)
    wrong["port"][0]["baud_rate"] = "fast"
    before = pids(site)
    code, _, errors = site.reload(wrong)
    assert code == 1
    check = subprocess.run(
        [site.gateway.build / "rtud" / "rtud", "--check", site.file_of(wrong)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert errors == without_notes(check.stderr) + "the configuration stays as it was\n"
    code, _, errors = site.reload(reduced(site.config, *SMALL) | {"port": 7})
    assert code == 1
    assert pids(site) == before


def test_what_needs_a_restart_says_why(site: Site) -> None:
    config = reduced(site.config, *SMALL, "2.20")
    config["iec104"] = config.get("iec104", {}) | {"own_ca": 9}
    before = pids(site)
    code, _, errors = site.reload(config)
    message = "iec104.own_ca has changed: this needs a restart of rtud, because the process that has"
    assert (code, message in errors) == (1, True), errors
    assert pids(site) == before
    assert not [name for name in site.gateway.map.iterdir() if "+1" in name.name]


# ---- what does not notice -------------------------------------------------------------------------


def change_often(site: Site, device: str, process: subprocess.Popen[str]) -> list[int]:
    """New values at a device, each read by the gateway, until a process ends and some more."""
    sent, more = [], 3
    while more > 0:
        sent.append(1000 + len(sent))
        site.set_and_scan(device, "input_registers", first_input(site, device), [sent[-1]])
        more -= process.poll() is not None
    return sent


def first_input(site: Site, device: str) -> int:
    port, unit = map(int, device.split("."))
    slaves = next(p for p in site.config["port"] if p["value"] == port)["slaves"]
    slave = next(s for s in slaves if s["id"] == unit)
    return next(o["address"] for o in slave["input_registers"] if "type" not in o or o["type"] == "scaled")


@pytest.mark.slow
def test_added_line_is_noticed_by_nobody(site: Site, master: Master) -> None:
    """Values of an unchanged device during the reload: each is one event. Its line is polled on."""
    before, here = pids(site), connections(site)
    ioa = 30001 + first_input(site, STEADY_DEVICE)
    mark, frame = master.mark(), site.lines.mark()
    process = site.begin(reduced(site.config, *SMALL, "2.20"))
    sent = change_often(site, STEADY_DEVICE, process)
    assert process.returncode == 0, process.stderr
    assert [row.value for row in master.interrogate(OWN_LINE_CA)]
    master.wait(lambda r: (r.ca, r.ioa, r.value) == (STEADY_CA, ioa, sent[-1]), mark)
    assert changes(master.reports_since(mark), STEADY_CA, ioa) == sent
    after = pids(site)
    assert {name: after[name] for name in before} == before
    assert after[ADDED]
    assert connections(site) == here
    times = polls(site, 4, frame)
    assert max(b - a for a, b in pairwise(times)) < 1_000_000_000, "a poll was missed"


@pytest.mark.slow
def test_changed_line_goes_on_where_it_was(site: Site, master: Master) -> None:
    """A device is added to it: no event of the other is lost, told twice, or made up."""
    before, here = site.gateway.points(), connections(site)
    frozen = {name: row for name, row in before.items() if row["ca"] == CHANGED_CA}
    ioa = 30001 + first_input(site, CHANGED_DEVICE)
    mark = master.mark()
    process = site.begin(reduced(site.config, *SMALL, "3.67"))
    sent = change_often(site, CHANGED_DEVICE, process)
    assert process.returncode == 0, process.stderr
    master.wait(lambda r: (r.ca, r.ioa, r.value) == (CHANGED_CA, ioa, sent[-1]), mark)
    told = [r for r in master.reports_since(mark) if r.ca == CHANGED_CA]
    assert changes(told, CHANGED_CA, ioa) == sent
    assert {r.ioa for r in told} == {ioa}, "what did not change is no event"
    after = site.gateway.points()
    assert all(after[name]["value"] == row["value"] for name, row in frozen.items() if row["ioa"] != ioa)
    assert connections(site) == here
    site.gateway.wait_for(lambda: everything_read(site.gateway), 30.0, "the new device is read")
    news = {row["ioa"] for row in after.values() if row["ca"] == NEW_CA}
    assert {r.ioa for r in master.interrogate(NEW_CA)} == news
    assert {r.ioa for r in master.reports_since(mark) if r.ca == NEW_CA and r.cause == "SPONTANEOUS"} == news


@pytest.mark.slow
def test_removed_device_is_invalid_and_then_unknown(site: Site, master: Master) -> None:
    everything = reduced(site.config, *SMALL, "3.67", "2.20")
    assert site.reload(everything)[0] == 0
    site.gateway.wait_for(lambda: everything_read(site.gateway), 30.0, "the new devices are read")
    gone = {
        (row["ca"], row["ioa"])
        for row in site.gateway.points().values()
        if row["ca"] in (NEW_CA, OWN_LINE_CA)
    }
    mark, here = master.mark(), connections(site)
    assert site.reload(reduced(site.config, *SMALL))[0] == 0
    for ca in (NEW_CA, OWN_LINE_CA):
        master.wait(lambda r, ca=ca: r.ca == ca and not r.good, mark)
        assert master.is_refused(ca)
    told = {(r.ca, r.ioa) for r in master.reports_since(mark) if not r.good}
    assert told == gone
    assert not {row["ca"] for row in site.gateway.points().values()} & {NEW_CA, OWN_LINE_CA}
    assert ADDED not in site.gateway.modules()
    mark = master.mark()
    assert site.reload(everything)[0] == 0  # the same names again
    master.wait(lambda r: r.ca == OWN_LINE_CA and r.good, mark)
    assert master.interrogate(NEW_CA)
    assert connections(site) == here


@pytest.mark.slow
def test_events_wait_for_a_master_that_is_away(site: Site) -> None:
    """Its queue has events of both lines from before, during and after."""
    with Master(*site.gateway.address) as master:
        master.synchronise_clock(STEADY_CA)
    mine = {d: 30001 + first_input(site, d) for d in SMALL}
    for value in (11, 12):
        for device in SMALL:
            site.set_and_scan(device, "input_registers", first_input(site, device), [value])
    assert site.reload(reduced(site.config, *SMALL, "3.67", "2.20"))[0] == 0
    for device in SMALL:
        site.set_and_scan(device, "input_registers", first_input(site, device), [13])
    with Master(*site.gateway.address) as master:
        for device, ioa in mine.items():
            ca = site.ca(device)
            master.wait(lambda r, ca=ca, ioa=ioa: (r.ca, r.ioa, r.value) == (ca, ioa, 13))
            assert changes(master.reports_since(0), ca, ioa) == [11, 12, 13]


def pulsed(config: Config) -> Config:
    config = copy.deepcopy(config)
    coil(config)["long_pulse_ms"] = PULSE_MS
    return config


def coil(config: Config) -> dict[str, Any]:
    line = next(port for port in config["port"] if port["value"] == 3)
    found: dict[str, Any] = next(slave for slave in line["slaves"] if slave["id"] == 35)["coils"][0]
    return found


def written(site: Site, address: int, since: int) -> list[int]:
    return [
        frame.value
        for frame in site.lines.frames(since)
        if (frame.kind, frame.port, frame.unit, frame.table, frame.address)
        == ("writing", 3, 35, "coils", address)
    ]


@pytest.mark.slow
def test_pulse_under_way_ends_before_its_line_is_exchanged(site: Site) -> None:
    """Nothing is written twice, and whoever commanded is told."""
    config, address = pulsed(site.config), coil(site.config)["address"]
    assert site.reload(reduced(config, *SMALL))[0] == 0
    (name,) = [
        name
        for name, row in site.gateway.points().items()
        if (row["ca"], row["ioa"]) == (CHANGED_CA, 1 + address)
    ]
    mark = site.lines.mark()
    command = [*site.gateway.rtuctl, "set", name, "on", "--pulse", "long"]
    pulse = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    site.gateway.wait_for(lambda: written(site, address, mark) == [1], 30.0, "the pulse begins")
    before = pids(site)
    site.gateway.config_file.write_text(json.dumps(reduced(config, *SMALL, "3.67")))
    assert site.gateway.process
    site.gateway.process.send_signal(signal.SIGHUP)  # rtuctl waits for its command
    assert pulse.wait(30) == 0
    site.gateway.wait_for(lambda: pids(site)[CHANGED] != before[CHANGED], 30.0, "the line is exchanged")
    site.gateway.wait_for(lambda: everything_read(site.gateway), 30.0, "the new device is read")
    assert written(site, address, mark) == [1, 0]


@pytest.mark.slow
def test_who_watches_sees_what_comes(site: Site) -> None:
    """`rtuctl watch` follows a changed line, whose segment is another, and an added one."""
    told = site.gateway.directory / "watched"
    ioa = 30001 + first_input(site, CHANGED_DEVICE)
    before = site.gateway.points()
    (name,) = [n for n, row in before.items() if (row["ca"], row["ioa"]) == (CHANGED_CA, ioa)]

    def is_told() -> bool:
        rows = [
            json.loads(line) for line in told.read_text().splitlines(keepends=True) if line.endswith("\n")
        ]
        news = {row["name"] for row in rows} - set(before)
        return {"p3.67.c0", "meter.alarms"} <= news and any(
            (row["name"], row.get("value")) == (name, 77) for row in rows
        )

    with told.open("w") as output:
        watch = subprocess.Popen([*site.gateway.rtuctl, "--json", "watch"], stdout=output)
        assert site.reload(reduced(site.config, *SMALL, "2.20", "3.67"))[0] == 0
        site.set_and_scan(CHANGED_DEVICE, "input_registers", ioa - 30001, [77])
        site.gateway.wait_for(is_told, 30.0, "the changed line's event, and those of new points")
        watch.terminate()
        watch.wait()


# ---- what breaks ------------------------------------------------------------------------------------


def foreign(site: Site, script: str) -> Config:
    """A module of others that is this script."""
    directory = site.gateway.directory
    shutil.copy((site.gateway.build / "lib/libopenrtu.so.0").resolve(), directory / "libopenrtu.so.0")
    if not (directory / "openrtu").exists():
        shutil.copytree(ROOT / "package/openrtu/python/openrtu", directory / "openrtu")
    program = directory / "module"
    (directory / "module.py").write_text(script)
    program.write_text(
        f"#!/bin/sh\nexport OPENRTU_LIBRARY={directory}/libopenrtu.so.0 PYTHONPATH={directory} "
        f'PYTHONDONTWRITEBYTECODE=1\nexec {PYTHON} {directory}/module.py "$@"\n'
    )
    program.chmod(0o755)
    return {
        "name": "other",
        "program": str(program),
        "period_ms": 50,
        "ca": 900,
        "points": [{"name": "other.value", "type": "scaled", "ioa": 1}],
    }


@pytest.mark.slow
@pytest.mark.parametrize(
    ("script", "message"),
    [
        ("raise SystemExit(3)\n", "other does not come up: the configuration stays as it was\n"),
        (
            "from openrtu import Module\nwith Module():\n    raise SystemExit(3)\n",
            "other does not work: the former configuration comes back\n",
        ),
    ],
    ids=["never attaches", "ends at once"],
)
def test_module_that_does_not_come_up_takes_the_change_back(site: Site, script: str, message: str) -> None:
    before, points = pids(site), set(site.gateway.points())
    broken = reduced(site.config, *SMALL, "2.20") | {"modules": [foreign(site, script)]}
    code, _, errors = site.reload(broken)
    assert (code, message in errors) == (1, True), errors
    after = pids(site)
    assert {name: after[name] for name in before} == before
    assert set(site.gateway.points()) == points
    assert site.reload(reduced(site.config, *SMALL, "2.20"))[0] == 0


def listed(gateway: Gateway, file: Path) -> set[tuple[str, int, int]]:
    """What `rtud --points` says of a file."""
    command = [gateway.build / "rtud" / "rtud", "--points", file]
    text = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    return {(row["name"], int(row["ca"]), int(row["ioa"])) for row in csv.DictReader(io.StringIO(text))}


def running(gateway: Gateway) -> set[tuple[str, int, int]]:
    return {(name, row["ca"], row["ioa"]) for name, row in gateway.points().items()}


OPTIONAL = {"snmp": "rtu-snmp", "iec61850": "rtu-iec61850", "web": "rtu-web", "journal": "rtu-journal"}


def of_all_kinds(site: Site, chance: random.Random) -> Iterator[Config]:
    """Endless: modules that command, the journal, settings of all and devices come, change and go."""
    folder = site.gateway.directory
    ports = [free_udp_port(), free_port(), free_port()]
    users = [{"name": user.name, "role": role} for user, role in USERS.items()]
    sink = {"name": "nms", "address": "127.0.0.1", "port": free_udp_port(), "user": CENTRE.name}
    snmp = {"address": "127.0.0.1", "port": ports[0], "users": users, "sinks": [sink]}
    snmp |= {"keys": str(folder / "keys"), "state": str(folder / "state")}
    server = {"address": "127.0.0.1", "port": ports[1], "controllers": ["127.0.0.1"]}
    page = {"address": "127.0.0.1", "port": ports[2], "users": str(folder / "web.users")}
    make_keys(site.config | {"snmp": snmp}, folder)
    make_user(folder / "web.users", "operator", "operator")
    groups = [{"name": name, "masters": [f"192.0.2.{i}"]} for i, name in enumerate("abcd", 1)]
    values: dict[str, list[Any]] = {
        "snmp": [snmp, snmp | {"rate": 500}, None],
        "iec61850": [server, server | {"report_buffer": 512}, None],
        "web": [page, page | {"commands": True}, None],
        "journal": [{"path": str(folder / "first")}, {"path": str(folder / "second")}, None],
        "force_max_s": [600, None],
        "timezone": ["CET-1", None],
        "clock": ["gateway", "masters", None],
        "commands": [{"select_timeout": 5}, None],
        "event_ring": [256, 2048, None],
        "redundancy_groups": [groups[:2], groups[1:], None],
    }
    devices = [SMALL, (STEADY_DEVICE, "3.67", "2.20")]
    while True:
        chosen = {key: chance.choice(choices) for key, choices in values.items()}
        extra = {key: value for key, value in chosen.items() if value is not None}
        yield reduced(site.config, *chance.choice(devices)) | extra


def is_whole(gateway: Gateway, config: Config) -> bool:
    """What runs is this configuration, all of it and nothing else."""
    modules = gateway.modules()
    wanted = {module for key, module in OPTIONAL.items() if key in config}
    groups = {row["name"] for row in gateway.query("iec104", "queues") if row["group"]}
    assert set(modules) & set(OPTIONAL.values()) == wanted
    assert groups == {group["name"] for group in config.get("redundancy_groups", [])}
    assert running(gateway) == listed(gateway, gateway.config_file)
    return everything_read(gateway) and all(modules[name]["alive"] for name in wanted)


@pytest.mark.slow
@pytest.mark.parametrize("kills", [KILLS, pytest.param(200, marks=pytest.mark.soak)])
def test_killed_rtud_leaves_the_old_or_the_new_whole(site: Site, kills: int) -> None:
    """SIGKILL at any moment of a reload: the next start has all of its file, and nothing of the other one."""
    gateway, chance = site.gateway, random.Random(24)
    moments = []
    for config in itertools.islice(of_all_kinds(site, chance), kills):
        new = gateway.directory / "new.json"
        new.write_text(json.dumps(listening_on(config, gateway.address[1])))
        new.replace(gateway.config_file)
        assert gateway.process
        begun = time.monotonic()
        gateway.process.send_signal(signal.SIGHUP)
        time.sleep(chance.choice([0.12, 0.4]) * chance.random())  # the moment that is tried
        os.kill(child_of(gateway), signal.SIGKILL)
        moments.append(time.monotonic() - begun)
        gateway.process.wait()
        gateway.start()
        gateway.wait_for(lambda config=config: is_whole(gateway, config), 60.0, "all of it runs")
        assert not [
            file for file in gateway.map.iterdir() if "+" in file.name and file.name != "rtud+0.config"
        ]
    print("killed after", [f"{moment:.3f} s" for moment in moments])


def child_of(gateway: Gateway) -> int:
    """setpriv has become rtud."""
    assert gateway.process
    return gateway.process.pid


def some(config: Config, chance: random.Random) -> Config:
    """Some of its devices, in any order, and some of their objects."""
    devices = [f"{port['value']}.{slave['id']}" for port in config["port"] for slave in port["slaves"]]
    left = reduced(config, *chance.sample(devices, chance.randint(1, len(devices))))
    chance.shuffle(left["port"])
    for port in left["port"]:
        chance.shuffle(port["slaves"])
        for slave in port["slaves"]:
            for table in ("coils", "discrete_inputs", "input_registers", "holding_registers"):
                objects = slave.get(table, [])
                if chance.random() < 0.3 and objects and not slave.get("no"):
                    slave[table] = chance.sample(objects, chance.randint(1, len(objects)))
    return left


@pytest.mark.slow
def test_random_reloads_end_as_a_fresh_start_of_the_last_file(site: Site, master: Master) -> None:
    chance, gateway, here = random.Random(42), site.gateway, connections(site)
    for _ in range(RELOADS):
        config = some(site.config, chance)
        code, _, errors = site.reload(config)
        if code != 0:
            assert ": " in errors, errors  # a status bit that was left out is an error of the file
            continue
        file = site.file_of(config)
        assert running(gateway) == listed(gateway, file)
        for ca in {row["ca"] for row in gateway.points().values()}:
            told = {r.ioa for r in master.interrogate(ca)}
            known = {row["ioa"] for row in gateway.points().values() if row["ca"] == ca}
            assert told <= known, ca
        gateway.wait_for(lambda: everything_read(gateway), 30.0, "every device has been read")
        assert connections(site) == here
