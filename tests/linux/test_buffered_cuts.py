# SPDX-License-Identifier: GPL-3.0-or-later
"""Buffered reports of IEC 61850 over power cuts of the emulated board: QEMU ends at once, its flash stays."""

import itertools
import json
import random
import re
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from test_data_volume import kernel as kernel  # with a small partition for data
from test_data_volume import with_flash

from lab.board import ETHERNET, SILENCE_US, lines_at
from lab.linesim import LineSim
from nuc980.twin.linux import Kernel, Linux
from nuc980.twin.machine import INSTRUCTION_TIME
from nuc980.twin.nand import NandImage
from peers.mms import Client
from rig.journal_file import ENTRY, cause_of, events, number_of, records
from rig.reports import DEVICE, INPUTS, NO, Entry, begin, configuration, nothing_more, put, taken

MMS_PORT, SEED = 102, 61850
HANG_S = 300.0  # what does not come by then never comes
SHOW = "hexdump -v -e '1/1 \"%02x\"' /data/openrtu/journal/events"


def board_configuration() -> dict[str, object]:
    config = configuration(MMS_PORT)
    config["iec61850"]["address"] = ETHERNET[0].address
    port = config["port"][0]
    port["baud_rate"] = 9600
    port["slaves"][0] |= {"retries": 5, "response_timeout_ms": 5000}
    return config | {"journal": {"interval_s": 1, "volume_mb": 1_000_000}}


def check_sequence(entries: list[Entry], kept: dict[bytes, int]) -> None:
    """In order, each once; a gap is told, and is never of what was kept. kept: numbers, by their starts."""
    assert len({entry.key for entry in entries}) == len(entries)
    for before, after in itertools.pairwise(entries):
        goes_on = after.place == before.place + 1
        if before.key[:4] == after.key[:4]:
            assert goes_on and not after.lost
        else:
            assert after.lost is not goes_on
            assert after.place > kept[before.key[:4]]


@dataclass
class Site:
    """The board's flash, the inputs of its one device, and what the client has been told."""

    power: Callable[[], Linux]
    lines: LineSim
    port: int
    on: bool = False
    entries: list[Entry] = field(default_factory=list)
    kept: dict[bytes, int] = field(default_factory=dict)  # by start

    def change(self) -> None:
        self.on = not self.on
        self.lines.set(DEVICE, "discrete_inputs", 0, *[int(self.on)] * INPUTS)

    @contextmanager
    def client(self) -> Iterator[Client]:
        """As soon as the server answers: QEMU's network takes a connection before the board does."""
        deadline = time.monotonic() + HANG_S
        with ExitStack() as stack:
            while True:
                try:
                    client = stack.enter_context(Client(self.port, timeout_s=HANG_S))
                    break
                except (OSError, EOFError):
                    assert time.monotonic() < deadline, "the server does not answer"
                    time.sleep(1)
            yield client

    def take(self, client: Client, count: int) -> None:
        self.entries += taken(client, count)

    def take_all(self, client: Client) -> None:
        """Until the client knows each input as it is."""

        def known() -> dict[int, tuple[bool, bool]]:
            return {entry.member: (entry.on, entry.good) for entry in self.entries}

        while known() != dict.fromkeys(range(INPUTS), (self.on, True)) or not nothing_more(client):
            self.take(client, 1)

    def wait_kept(self, linux: Linux, number: int) -> None:
        deadline = time.monotonic() + HANG_S
        while newest_in(linux.run(f"{SHOW} || true", HANG_S)) < number:
            assert time.monotonic() < deadline, f"entry {number} is not in the journal"
        self.kept[self.entries[-1].key[:4]] = number

    def live(self, linux: Linux, chance: random.Random) -> None:
        """Changes are told; others are kept untold; others are on their way as the power is cut."""
        with self.client() as client:
            begin(client, self.entries[-1].key)
            self.take_all(client)
            self.change()
            self.take_all(client)
            put(client, RptEna=NO)
        self.change()
        self.wait_kept(linux, self.entries[-1].place + INPUTS)
        with self.client() as client:
            begin(client, self.entries[-1].key)
            self.change()
            self.take(client, chance.randrange(1, 2 * INPUTS))
            linux.close()  # SIGKILL: nothing is synchronised


def newest_in(shown: str) -> int:
    """The number of the newest change for buffered reports in a journal that a console shows."""
    found = re.findall(r"[0-9a-f]{96,}", shown)
    file = bytes.fromhex(found[-1]) if found and len(found[-1]) % 2 == 0 else b""
    pieces = (event for record in records(file) for event in events(record))
    return max((number_of(event) for event in pieces if cause_of(event) == ENTRY), default=0)


@pytest.fixture
def site(
    boot: Callable[..., Linux], folder: Path, port: int, linesim_program: Path, kernel: Kernel, tmp_path: Path
) -> Iterator[Site]:
    nand = NandImage.blank(tmp_path / "nand")
    config = board_configuration()
    file, values = folder / "linesim.json", folder / "values.json"
    file.write_text(json.dumps(config))
    values.write_text("{}")
    with LineSim(file, values, folder / "dev", silence_us=SILENCE_US, program=linesim_program) as lines:

        def power() -> Linux:
            return boot(
                *with_flash(nand), *ETHERNET[0].arguments({port: MMS_PORT}), *INSTRUCTION_TIME,
                kernel=kernel, chardevs={1: lines_at(lines.directory)[1]},
                files={"/etc/openrtu/gateway.json": json.dumps(config)},
            )  # fmt: skip

        yield Site(power, lines, port)


@pytest.mark.parametrize("cuts", [1, pytest.param(100, marks=pytest.mark.soak)])
def test_power_cuts_lose_nothing_that_was_kept(site: Site, cuts: int) -> None:
    chance = random.Random(SEED)
    linux = site.power()
    linux.run("/etc/init.d/S80rtud stop; rtu-data create && umount /data && rtu-data mount", HANG_S)
    linux.run("/etc/init.d/S80rtud start", HANG_S)
    with site.client() as client:  # an input that was good before the server came up is told by a change only
        begin(client)
        site.change()
        site.take_all(client)
    for _ in range(cuts):
        site.live(linux, chance)
        linux = site.power()
    with site.client() as client:
        begin(client, site.entries[-1].key)
        site.take_all(client)
    check_sequence(site.entries, site.kept)
    assert len({entry.key[:4] for entry in site.entries}) == 1 + cuts
