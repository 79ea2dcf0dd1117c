# SPDX-License-Identifier: GPL-3.0-or-later
"""Buffered reports of IEC 61850 over a power cut: all processes killed at once, the map gone."""

import itertools
import os
import random
import signal
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest
from test_iec61850_buffered import INVALID, Plant, check_order

from lab.gateway import free_port, remove, run_directory
from peers.mms import Client, element
from rig.desk import gateway_on_lines
from rig.journal_file import ENTRY, cause_of, events, number_of, records
from rig.power import cut_power
from rig.reports import BLOCK as BUFFERED
from rig.reports import (
    CA,
    DOMAIN,
    INPUTS,
    NO,
    NOTHING,
    YES,
    Entry,
    begin,
    configuration,
    nothing_more,
    put,
    taken,
)

SEED, KILLS = 61850, 10
ALL_TRIGGERS = element(0x84, b"\2\x64")  # dchg, qchg, GI: what a block does not begin with


@pytest.fixture
def journal() -> Iterator[Path]:
    folder = run_directory()
    yield folder / "journal"
    remove(folder)


@pytest.fixture
def plant(programs: Path, journal: Path) -> Iterator[Plant]:
    port = free_port()
    config = configuration(port)
    config["journal"] = {"path": str(journal), "interval_s": 1, "volume_mb": 1048576}
    config["port"][0]["slaves"][0]["retries"] = 5
    with gateway_on_lines(config, programs, initial={}) as (lines, gateway):
        plant = Plant(lines, gateway, port)
        plant.wait_all_good(CA)
        yield plant


def newest(journal: Path) -> int:
    """The number of the newest change for buffered reports in the journal's file."""
    return newest_of(records((journal / "events").read_bytes()))


def newest_of(all_records: Iterable[bytes]) -> int:
    found = (event for record in all_records for event in events(record))
    return max((number_of(event) for event in found if cause_of(event) == ENTRY), default=0)


def tear(journal: Path, chance: random.Random, begun: int) -> int:
    """
    The power goes before the file's last record is synchronised: a part of it is there, and nothing or zeros
    behind. Returns the newest change before it. The part ends before the zeros that a record ends with: with
    zeros behind, it would be whole. The first record is never so: it comes with the file's name.
    Nor is one before which the journal has nothing of the last start, whose first change has the number
    begun: the server knows no EntryID of a start that it has nothing of.
    """
    *synchronised, last = records((journal / "events").read_bytes())
    found = newest_of(synchronised)
    if not synchronised or found < begun:
        return newest(journal)
    part = last[: chance.randrange(len(last.rstrip(b"\0")))]
    zeros = chance.choice([b"", bytes(len(last) - len(part))])
    (journal / "events").write_bytes(b"".join([*synchronised, part, zeros]))
    return found


def wait_kept(plant: Plant, journal: Path, entry: int) -> None:
    plant.gateway.wait_for(
        lambda: (journal / "events").exists() and newest(journal) >= entry,
        30.0,
        f"entry {entry} is in the journal",
    )


def start_again(plant: Plant) -> None:
    plant.gateway.start()
    plant.wait_all_good(CA)


def of_start(entry: Entry) -> bytes:
    return entry.key[:4]


@pytest.mark.slow
def test_a_power_cut_loses_and_repeats_nothing(plant: Plant, journal: Path) -> None:
    """What was told is not told again, what was kept is told with its EntryID and time, and settings stay."""
    first = not plant.on
    with Client(plant.port) as client:
        put(
            client,
            TrgOps=ALL_TRIGGERS,
            RptID=element(0x8A, b"A name of the client, in several pieces"),
        )
        put(client, RptID=element(0x8A, b""), PurgeBuf=YES)
        begin(client)
        plant.change()
        told = taken(client, INPUTS)
        put(client, RptEna=NO)
    plant.change()
    with Client(plant.port) as client:  # to see what is kept; the block is left behind what was told
        begin(client)
        kept = taken(client, INPUTS)
        times = client.values((DOMAIN, f"{BUFFERED}$TimeofEntry"))
    wait_kept(plant, journal, kept[-1].place)
    cut_power(plant.gateway)
    start_again(plant)
    assert "changes for buffered reports restored" in plant.gateway.log(100)
    with Client(plant.port) as client:
        assert client.values((DOMAIN, f"{BUFFERED}$TrgOps")) == [(0x84, b"\2\x64")]
        put(client, TrgOps=ALL_TRIGGERS)
        begin(client, told[-1].key)
        again = taken(client, INPUTS)
        assert [entry.key for entry in again] == [entry.key for entry in kept]
        assert client.values((DOMAIN, f"{BUFFERED}$TimeofEntry")) == times
        assert nothing_more(client)  # nothing has changed meanwhile
        plant.change()
        new = taken(client, INPUTS)
        check_order(told + again + new, first)
        assert not any(entry.lost for entry in told + again + new)
        assert {of_start(entry) for entry in told + again} != {of_start(entry) for entry in new}
    wait_kept(plant, journal, new[-1].place)
    cut_power(plant.gateway)
    start_again(plant)
    with Client(plant.port) as client:  # entries of two starts before
        for behind, count in ((told[4].key, 3 * INPUTS - 5), (new[0].key, INPUTS - 1), (NOTHING, 3 * INPUTS)):
            begin(client, behind)
            assert [entry.key for entry in taken(client, count)] == [
                entry.key for entry in (told + again + new)[-count:]
            ]
            assert nothing_more(client)
            put(client, RptEna=NO)
        for wrong in (b"\1" + told[0].key[1:], new[0].key[:4] + told[0].key[4:]):
            assert client.write(DOMAIN, (f"{BUFFERED}$EntryID", element(0x89, wrong))) == [INVALID]


@pytest.mark.slow
def test_what_the_journal_has_not_is_told_as_lost(plant: Plant, journal: Path) -> None:
    """A client that was told more than was written goes on behind the gap, and hears of it once."""
    with Client(plant.port) as client:
        put(client, PurgeBuf=YES)
        begin(client)
        plant.change()
        kept = taken(client, INPUTS)
        wait_kept(plant, journal, kept[-1].place)
        os.kill(plant.gateway.modules()["rtu-journal"]["pid"], signal.SIGSTOP)
        plant.change()
        more = taken(client, INPUTS)
    cut_power(plant.gateway)
    assert newest(journal) == kept[-1].place
    start_again(plant)
    with Client(plant.port) as client:
        begin(client, more[-1].key)
        # Against what is kept the inputs have changed.
        entries = taken(client, INPUTS)
        assert [entry.lost for entry in entries] == [True] + (INPUTS - 1) * [False]
        assert {entry.on for entry in entries} == {plant.on}
        assert of_start(entries[0]) != of_start(more[0])
        plant.change()
        assert not any(entry.lost for entry in taken(client, INPUTS))


def check_sequence(entries: list[Entry], written: dict[bytes, int]) -> None:
    """In order, each once; what is missing was not written when the power was cut. written: by start."""
    for before, after in itertools.pairwise(entries):
        if of_start(before) == of_start(after):
            assert after.place == before.place + 1 and not after.lost
        else:
            end = written[of_start(before)]
            assert after.place == end + 1
            assert before.place == end or (before.place > end and after.lost)


@pytest.mark.parametrize(
    "cuts", [pytest.param(1, marks=pytest.mark.slow), pytest.param(100, marks=pytest.mark.soak)]
)
def test_kills_and_cuts_at_any_moment(plant: Plant, journal: Path, cuts: int) -> None:
    """
    Ten kills of the module to a cut, as reports are on their way; the client goes on behind its last. Of what
    the journal wrote last, a part is lost with the power.
    """
    chance = random.Random(SEED)
    entries: list[Entry] = []
    written: dict[bytes, int] = {}
    checked = 0
    with Client(plant.port) as client:
        put(client, PurgeBuf=YES)
    for _ in range(cuts):
        for kill in range(1 + KILLS):
            plant.change()
            with Client(plant.port) as client:
                begin(client, entries[-1].key if entries else None)
                entries += taken(client, chance.randrange(1, INPUTS))
                if kill < KILLS:
                    plant.restart()
            with Client(plant.port) as client:
                begin(client, entries[-1].key)
                entries += taken(client, 1)
                while not nothing_more(client):
                    entries += taken(client, len(client.reports))
        start = of_start(entries[-1])
        begun = next(entry.place for entry in entries if of_start(entry) == start)
        wait_kept(plant, journal, begun)
        plant.change()
        cut_power(plant.gateway)
        written[start] = tear(journal, chance, begun)
        check_sequence(entries[checked:], written)
        checked = len(entries) - 1
        start_again(plant)
    plant.change()
    with Client(plant.port) as client:
        begin(client, entries[-1].key)
        entries += taken(client, INPUTS)
    check_sequence(entries[checked:], written)
    assert len(entries) >= cuts * KILLS * INPUTS
