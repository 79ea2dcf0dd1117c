# SPDX-License-Identifier: GPL-3.0-or-later
"""docs/conformance-61850.md and the figures say what is: against wire, source and schema."""

import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from test_iec61850_scl import DEVICE, site_gateway

from lab.gateway import free_port, remove, run_directory
from peers import mms

ROOT = Path(__file__).parents[2]
STATEMENT = (ROOT / "docs/conformance-61850.md").read_text()
SOURCE = (ROOT / "package/openrtu/src/iec61850/ln_class.c").read_text()
SCHEMA = json.loads((ROOT / "package/openrtu/src/rtud/config.schema.json").read_text())["$defs"]


def rows(heading: str) -> list[list[str]]:
    """The first table below a heading, without its head."""
    lines = STATEMENT.partition(f"# {heading}\n")[2].splitlines()
    table = [line for line in lines[: lines.index("", lines.index("") + 2)] if line.startswith("|")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in table[2:]]


@pytest.fixture(scope="module")
def port(programs: Path) -> Iterator[int]:
    directory, port = run_directory(), free_port()
    try:
        with site_gateway(port, directory, programs):
            yield port
    finally:
        remove(directory)


def asked(tag: bytes) -> bytes:
    """A request of a service, with what it needs."""
    variable = mms.element(mms.SEQUENCE, mms.element(0xA0, mms.name(DEVICE, "Q0XCBR1$ST$Pos")))
    whole = {
        b"\xab": mms.element(mms.LIST_DEFINE, mms.name(DEVICE, "LLN0$Mine"), mms.element(0xA0, variable)),
        b"\xad": mms.element(mms.LIST_DELETE, mms.element(0xA1, mms.name(DEVICE, "LLN0$Mine"))),
        b"\xbf\x48": mms.file_open("OpenRTU.cid"),
        b"\x9f\x49": mms.element(mms.FILE_READ, b"\1"),
        b"\x9f\x4a": mms.element(mms.FILE_CLOSE, b"\1"),
        b"\xa1": mms.name_list(9),
        b"\xa4": mms.read((DEVICE, "LLN0")),
        b"\xa6": mms.element(mms.TYPE, mms.element(0xA0, mms.name(DEVICE, "LLN0"))),
        b"\xac": mms.element(mms.LIST_ATTRIBUTES, mms.name(DEVICE, "LLN0$status")),
        b"\xa5": mms.element(
            mms.WRITE,
            mms.element(0xA0, mms.element(mms.SEQUENCE, mms.element(0xA0, mms.name(DEVICE, "LLN0")))),
            mms.element(0xA0, bytes.fromhex("830100")),
        ),
    }
    return whole.get(tag, tag + b"\0")


def test_services_are_answered_as_stated(port: int) -> None:
    services = rows("MMS")
    assert len({row[0] for row in services}) == 2
    with mms.Client(port) as client:
        for stated, service, tag in services:
            client.number += 1
            request = mms.request(client.number, asked(bytes.fromhex(tag)))
            client.send(mms.tpkt(mms.data(request)))
            assert client.mms()[0] == (mms.RESPONSE if stated == "X" else mms.REJECT), service


def test_classes_are_those_of_the_source() -> None:
    nodes = re.findall(r'CLASS\("(\w+)"', SOURCE)
    names = SOURCE.partition("iec61850_cdc_names")[2].partition(";")[0]
    assert [name for (name,) in rows("Logical nodes")] == nodes
    assert [name for (name,) in rows("Common data classes")] == list(
        dict.fromkeys(re.findall(r'"(\w+)"', names))
    )


def test_the_figure_of_groups_has_the_classes_of_the_source() -> None:
    figure = (ROOT / "docs/figures/iec61850-groups.svg").read_text()
    shown = re.findall(r'class="code left">([^<]+)<', figure)
    assert sorted(" ".join(shown).split()) == sorted(re.findall(r'CLASS\("(\w+)"', SOURCE))
    assert f"{len(' '.join(shown).split())} classes in {len(shown)} groups" in figure


def test_the_figure_of_repetitions_has_the_defaults() -> None:
    figure = (ROOT / "docs/figures/goose-repetition.svg").read_text()
    keys = SCHEMA["goose_publication"]["properties"]
    interval, most = (keys[name]["default"] for name in ("min_ms", "max_ms"))
    due = [most]  # of the state before
    while interval < most:
        due.append(interval)
        interval *= 2
    assert [int(ms) for ms in re.findall(r'class="note small">(\d+)<', figure)] == [*due, most, most]
    assert f"timeAllowedtoLive: {3 * most} ms" in figure


def test_numbers_are_those_of_the_schema() -> None:
    numbers = rows("PIXIT: what tests have to know")
    assert len(numbers) > 8
    for what, value, key in numbers:
        of, name, rule = re.fullmatch(r"`(\w+)\.(\w+)` (\w+)", key).groups()
        assert SCHEMA[of]["properties"][name][rule] == int(value), what
