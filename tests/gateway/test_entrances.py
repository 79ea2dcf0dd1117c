# SPDX-License-Identifier: GPL-3.0-or-later
"""docs/security.md says which ports listen; here a gateway with every module is looked at from outside."""

import json
import re
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest

from lab.gateway import Gateway, free_port, remove, run_directory
from lab.manager import free_udp_port, make_keys
from rig import snmp, web
from rig.desk import gateway_on_lines
from rig.outstation import outstation
from rig.rights import SUPERUSER, needed

pytestmark = [
    pytest.mark.slow,
    needed(SUPERUSER, "frames of an interface, and what others have open, are root's"),
]

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs/security.md").read_text()
FIXTURES = ROOT / "tests/fixtures"
LISTENS = "0A"  # proc(5), /proc/net/tcp


def table(heading: str) -> list[list[str]]:
    """The rows of the first table below a heading of the page, without its head."""
    section = PAGE.split(f"\n{heading}\n")[1]
    found = re.search(r"^\|.*?(?=\n\n)", section, re.MULTILINE | re.DOTALL)
    assert found
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in found[0].splitlines()[2:]]


def everything(folder: Path) -> dict[str, Any]:
    """A configuration with each protocol; what needs a peer finds none."""
    port = free_udp_port()
    config = web.configuration(folder, free_port())
    web.make_files(folder)
    agent = snmp.configuration(folder, port, free_udp_port())["snmp"]
    item = {"name": "bay", "control_block": "GW/LLN0$GO$bay", "data_set": "GW/LLN0$bay", "app_id": 1}
    item |= {"destination": "01:0c:cd:01:00:01", "conf_rev": 1, "points": ["level"]}
    there = {"ca": 900, "remote_ca": 1, "points": [{"name": "town.lamp", "type": "single", "ioa": 1}]}
    config |= {
        "snmp": agent,
        "iec61850": {"address": "127.0.0.1", "port": free_port()},
        "goose": {"interface": "lo", "publish": [item]},
        "gps": [{"name": "van", "gpsd": "127.0.0.1", "gpsd_port": free_port(), "ca": 901, "ioa": 1}],
        "outstations": [outstation(free_port()) | {"sets": [there]}],
        "journal": {"path": str(folder / "journal")},
    }
    line = next(port for port in config["port"] if port["active"])
    line["pass_through"] = {
        "address": "127.0.0.1",
        "tcp_port": free_port(),
        "units": [line["slaves"][0]["id"]],
    }
    make_keys(config, folder)
    return config


@pytest.fixture(scope="module")
def gateway(programs: Path) -> Iterator[Gateway]:
    folder = run_directory()
    with gateway_on_lines(everything(folder), programs, web.INITIAL) as (_, running):
        yield running
    remove(folder)


def sockets() -> dict[str, str]:
    """Of each socket that takes what a stranger sends, by its inode: TCP that listens, UDP, frames."""
    found = {}
    for kind, inode, state in (("tcp", 9, 3), ("udp", 9, 3), ("packet", 8, None)):
        for name in (kind, f"{kind}6"):
            if not (file := Path("/proc/net", name)).exists():
                continue
            for row in (line.split() for line in file.read_text().splitlines()[1:]):
                if kind != "tcp" or row[state] == LISTENS:
                    found[row[inode]] = kind
    return found


def opened(gateway: Gateway) -> dict[str, set[str]]:
    """What rtud and each of its modules has open, by the module's program."""
    assert gateway.process
    known = sockets()
    found: dict[str, set[str]] = defaultdict(set)
    top = psutil.Process(gateway.process.pid)
    for process in (top, *top.children(recursive=True)):
        program = Path(process.cmdline()[0]).name
        found[program] |= set()
        for link in Path(f"/proc/{process.pid}/fd").iterdir():
            if target := re.fullmatch(r"socket:\[(\d+)\]", str(link.readlink())):
                found[program] |= {known[target[1]]} & set(known.values()) if target[1] in known else set()
    return found


# What the page says that each program takes, and at which port if nothing is configured.
TAKES = {"TCP": "tcp", "UDP": "udp", "frames of EtherType 88b8": "packet", "nothing": None}
ROWS = [
    (program, TAKES[takes], port)
    for programs, takes, port, _ in table("## What listens")
    for program in re.findall(r"`([\w-]+)`", programs)
]
# They would need programs; their filter lets them open no socket (test_supervise.py).
NOT_HERE = {"rtu-logic", "rtu-synch"}


def test_the_table_has_each_program_once(programs: Path) -> None:
    built = {file.name for file in (programs / "modules").glob("rtu-*") if file.is_file()}
    assert sorted(program for program, _, _ in ROWS) == sorted(built - {"rtu-logic-dies"} | {"rtud"})


def test_ports_of_the_table_are_those_of_the_configuration() -> None:
    schema = json.loads((ROOT / "package/openrtu/src/rtud/config.schema.json").read_text())["$defs"]
    ports = {program: port for program, _, port in ROWS}
    for key in ("iec104", "iec61850", "web", "snmp"):
        assert schema[key]["properties"]["port"]["default"] == int(ports[f"rtu-{key}"])


def test_a_gateway_with_everything_has_open_what_the_table_says(gateway: Gateway) -> None:
    said = {program: {kind} - {None} for program, kind, _ in ROWS}
    found = opened(gateway)
    assert found == {program: said[program] for program in found}
    assert set(said) - set(found) == {name for name in said if name.endswith("-tls")} | NOT_HERE
