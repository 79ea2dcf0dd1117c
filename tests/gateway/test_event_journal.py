# SPDX-License-Identifier: GPL-3.0-or-later
"""Events that outlive a power cut: all processes killed at once, the map gone, the file as synchronised."""

import contextlib
import datetime
import itertools
import json
import os
import random
import shlex
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from lab.gateway import remove, run_directory
from lab.raw_master import Asdu, Object, RawMaster
from lab.show import DEVICE, STATION
from rig.desk import Substation, chapter_5, everything_read, of_port, substation_of
from rig.power import cut_power, state, wait_journal
from rig.substation import IOA, MAIN, REGISTER, SOON_S, Link, count_up, empty, wait_log, wait_queue

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]
INTERVAL_S = 1
SEED, KILLS = 8, 12


def configuration(journal: Path, interval_s: int = INTERVAL_S) -> dict[str, Any]:
    """One device, a group, and a journal on a volume that bears a record a second."""
    config = chapter_5()
    line = of_port(config, 3)
    line["slaves"] = [slave | {"retries": 5} for slave in line["slaves"] if slave["id"] == 67]
    config["port"] = [line]
    config["iec104"] = {"k": 12, "w": 8, "t1": 200, "t2": 100, "t3": 300}
    config["redundancy_groups"] = [{"name": "Control centre", "masters": [MAIN]}]
    config["journal"] = {"path": str(journal), "interval_s": interval_s, "volume_mb": 1048576}
    return config


@pytest.fixture
def journal() -> Iterator[Path]:
    """A folder that the journal's user may enter."""
    folder = run_directory()
    yield folder / "journal"
    remove(folder)


@pytest.fixture
def substation(programs: Path, journal: Path) -> Iterator[Substation]:
    with substation_of(configuration(journal), programs) as substation:
        yield substation


def start_again(substation: Substation) -> None:
    gateway = substation.gateway
    gateway.start()
    gateway.wait_for(lambda: everything_read(gateway), 60.0, "every device has been read")


def counted(link: Link, count: int) -> list[Object]:
    """So many events of the counted register; those of other points, which are read anew, are passed over."""
    found: list[Object] = []
    while len(found) < count:
        found += [o for o in Asdu.parse(link.frame()[6:], 0).objects() if (o.ca, o.ioa) == (STATION, IOA)]
        link.acknowledge()
    return found


def take_all(link: Link) -> list[Object]:
    """All events of the counted register that wait, acknowledged."""
    found: list[Object] = []
    while frames := list(link.until_quiet()):
        for frame in frames:
            found += [o for o in Asdu.parse(frame[6:], 0).objects() if (o.ca, o.ioa) == (STATION, IOA)]
        link.acknowledge()
    return found


def told(objects: list[Object]) -> list[tuple[int, int, datetime.datetime | None]]:
    return [(found.value, found.quality, found.recorded_at) for found in objects]


# ---- what outlives it ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "source"), [pytest.param("Control centre", MAIN, id="group"), ("127.0.0.50", "127.0.0.50")]
)
def test_unacknowledged_events_survive_a_power_cut(substation: Substation, name: str, source: str) -> None:
    """In order, with the time they had; what was acknowledged before the last record does not come again."""
    gateway = substation.gateway
    with Link(gateway, source).start():
        pass  # an address has a queue from here on
    empty(gateway, name, source)
    empty(gateway, "Control centre", MAIN)
    with Link(gateway, source).start() as link:
        count_up(substation, range(100, 102), link)
        link.acknowledge()
        before: list[Object] = []
        for value in range(102, 105):
            substation.set_and_scan(DEVICE, "input_registers", REGISTER, [value])
            before += link.objects()
    if name != "Control centre":
        empty(gateway, "Control centre", MAIN)
    wait_journal(gateway, 3)  # without what was acknowledged: five are then these and the next two
    count_up(substation, range(105, 107))
    wait_journal(gateway, 5)
    cut_power(gateway)
    start_again(substation)
    assert "5 events restored from the journal" in gateway.log(100)
    with Link(gateway, source).start() as link:
        after = counted(link, 5)
        assert [found.value for found in after] == [102, 103, 104, 105, 106]
        assert told(after[:3]) == told(before)
        assert [found.value for found in take_all(link)] == [106]  # it was read anew
        wait_queue(gateway, name, "waiting", 0)
    empty(gateway, "Control centre", MAIN)
    wait_journal(gateway, 0)
    cut_power(gateway)
    start_again(substation)
    assert "0 events restored from the journal" in gateway.log(100)
    with Link(gateway, source).start() as link:
        assert [found.value for found in take_all(link)] == [106]


def run_on_the_desk(events: Path, points: Path, programs: Path) -> list[int]:
    """What a program that reads the counted register makes of the journal: each value that it has had."""
    (counted,) = (p["name"] for p in json.loads(points.read_text()) if (p["ca"], p["ioa"]) == (STATION, IOA))
    file = points.with_suffix(".st")
    file.write_text("PROGRAM p VAR_EXTERNAL a, b : DINT; END_VAR b := a; END_PROGRAM")
    words = ["run", file, events, "--json", "--period=1", f"--points={points}", f"--name=a={counted}"]
    machine = {"OPENRTU_LOGIC_DESK": shlex.quote(str(programs / "logic/logic-desk"))}
    done = subprocess.run(
        [ROOT / "scripts/openrtu", "logic", *words], env=os.environ | machine, capture_output=True, check=True
    )
    values = [step["outputs"]["b"]["value"] for step in json.loads(done.stdout)]
    return [value for value, _ in itertools.groupby(values)]


def test_an_orderly_stop_loses_nothing(programs: Path, journal: Path) -> None:
    """Also of what came since the last record."""
    with substation_of(configuration(journal, interval_s=3600), programs) as substation:
        gateway = substation.gateway
        empty(gateway, "Control centre", MAIN)
        count_up(substation, range(200, 205))
        points = journal.parent / "points.json"
        points.write_text(json.dumps(gateway.query("points")))
        assert gateway.stop() == 0
        assert run_on_the_desk(journal / "events", points, programs) == [*range(200, 205)]
        start_again(substation)
        with Link(gateway, MAIN).start() as link:
            assert [found.value for found in counted(link, 5)] == list(range(200, 205))


def test_time_of_a_clock_that_was_set_stays_valid(substation: Substation) -> None:
    """The clock of after the cut is not set; the events of before it were dated by one that was."""
    gateway = substation.gateway
    empty(gateway, "Control centre", MAIN)
    year_ahead = datetime.datetime.now(datetime.UTC).replace(microsecond=0) + datetime.timedelta(days=365)
    with RawMaster(*gateway.address) as master:
        master.request(103, STATION, 0, time_tag(year_ahead), cause=6)
        assert master.answer(103).cause == 7
    count_up(substation, range(300, 302))
    wait_journal(gateway, 2)
    cut_power(gateway)
    start_again(substation)
    with Link(gateway, MAIN).start() as link:
        tags: list[bytes] = []
        while len(tags) < 3:
            asdu = Asdu.parse(link.frame()[6:], 0)
            for at in range(0, len(asdu.body), 13):
                if asdu.type == 35 and int.from_bytes(asdu.body[at : at + 3], "little") == IOA:
                    tags.append(asdu.body[at + 6 : at + 13])
            link.acknowledge()
    assert [bool(tag[2] & 0x80) for tag in tags[:2]] == [False, False]
    assert [tag[6] & 0x7F for tag in tags[:2]] == [year_ahead.year % 100] * 2


def time_tag(when: datetime.datetime) -> bytes:
    """CP56Time2a."""
    milliseconds = when.second * 1000 + when.microsecond // 1000
    date = bytes([when.minute, when.hour, when.day, when.month, when.year % 100])
    return milliseconds.to_bytes(2, "little") + date


def test_killed_at_random_moments(substation: Substation) -> None:
    """Nothing that is older than a record's interval and its writing is lost, and the order holds."""
    gateway, chance = substation.gateway, random.Random(SEED)
    empty(gateway, "Control centre", MAIN)
    value, safe, received = 1000, set[int](), list[int]()
    for _ in range(KILLS):
        published: list[tuple[int, float]] = []
        end = time.monotonic() + chance.uniform(0.2, 3.5)
        while time.monotonic() < end:
            value += 1
            substation.set_and_scan(DEVICE, "input_registers", REGISTER, [value])
            published.append((value, time.monotonic()))
        cut_power(gateway)
        written = time.monotonic() - INTERVAL_S - 0.5
        safe |= {number for number, when in published if when < written}
        start_again(substation)
        if chance.random() < 0.5:
            continue  # two cuts without a controlling station between
        with Link(gateway, MAIN).start() as link:
            received += [found.value for found in take_all(link)]
        once = list(dict.fromkeys(received))
        assert once == sorted(once)
        assert safe <= set(received)
    assert safe  # else nothing was at stake; how many they are is up to the host


# ---- the file is something else ---------------------------------------------------------------------------


def tear(file: Path) -> None:
    file.write_bytes(file.read_bytes()[:-9])


def flip(file: Path) -> None:
    octets = bytearray(file.read_bytes())
    octets[len(octets) - 40] ^= 4
    file.write_bytes(octets)


def cut_head(file: Path) -> None:
    file.write_bytes(file.read_bytes()[1:])


def clear(file: Path) -> None:
    file.write_bytes(b"")


def exchange(file: Path) -> None:
    file.write_bytes(random.Random(SEED).randbytes(100_000))


def inflate(file: Path) -> None:
    """Larger than any journal, behind records that are good."""
    os.truncate(file, 1 << 40)


def make_folder(file: Path) -> None:
    file.unlink()
    file.mkdir()


def make_pipe(file: Path) -> None:
    file.unlink()
    os.mkfifo(file)


def link_elsewhere(file: Path) -> None:
    file.unlink()
    file.symlink_to("/etc/passwd")


SOME, ALL, NONE = range(3)  # of the events that the file held


@pytest.mark.parametrize(
    ("spoil", "message", "left"),
    [
        (tear, "incomplete or damaged", SOME),
        (flip, "incomplete or damaged", SOME),
        (cut_head, "incomplete or damaged: nothing can be read", NONE),
        (clear, "0 events restored", NONE),
        (exchange, "incomplete or damaged: nothing can be read", NONE),
        (inflate, "incomplete or damaged", ALL),
        (make_folder, "cannot be read: Is a directory", NONE),
        (make_pipe, "cannot be read: Invalid argument", NONE),
        (link_elsewhere, "cannot be read: Too many levels of symbolic links", NONE),
    ],
)
def test_file_that_is_broken(
    substation: Substation, journal: Path, spoil: Callable[[Path], None], message: str, left: int
) -> None:
    """The gateway runs on with what it can read, says why it is not all, and the journal works again."""
    gateway, file = substation.gateway, journal / "events"
    empty(gateway, "Control centre", MAIN)
    for values in (range(400, 403), range(403, 406)):
        count_up(substation, values)
        wait_journal(gateway, values.stop - 400)
    cut_power(gateway)
    spoil(file)
    spoiled = file.read_bytes() if spoil in (cut_head, exchange) else None
    start_again(substation)
    wait_log(gateway, message)
    kept = file.with_suffix(".unread")
    assert (kept.read_bytes() if kept.exists() else None) == spoiled
    kept.unlink(missing_ok=True)
    expected = {SOME: range(400, 403), ALL: range(400, 406), NONE: range(0)}[left]
    if spoil is make_folder:
        wait_log(gateway, f"cannot write in {journal}: Is a directory")
        assert state(gateway)["failing"] and state(gateway)["failures"] > 0
        file.rmdir()
        wait_log(gateway, f"writes again in {journal}")
    with Link(gateway, MAIN).start() as link:
        values = [found.value for found in take_all(link)]
        assert set(expected) <= set(values)
        assert values == sorted(values) and len(set(values)) >= len(expected)
        wait_queue(gateway, "Control centre", "waiting", 0)
    wait_journal(gateway, 0)
    count_up(substation, range(500, 503))
    wait_journal(gateway, 3)
    cut_power(gateway)
    start_again(substation)
    with Link(gateway, MAIN).start() as link:
        assert [found.value for found in counted(link, 3)] == [500, 501, 502]


def test_folder_that_cannot_be(programs: Path, journal: Path) -> None:
    """A file in the folder's place: the gateway runs, and says that a power cut would lose events."""
    journal.write_text("")
    with substation_of(configuration(journal), programs) as substation:
        gateway = substation.gateway
        wait_log(gateway, f"no journal: {journal}: Not a directory")
        wait_log(gateway, f"cannot write in {journal}: Not a directory; a power cut would lose events")
        assert "journal: FAILS, " in gateway.ctl("modules")
        with Link(gateway, MAIN).start() as link:
            take_all(link)
            count_up(substation, range(600, 602), link)


@pytest.fixture
def volume(journal: Path) -> Iterator[Path]:
    """The journal on a file system of its own, of which the tests may make anything."""
    journal.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=256k,mode=755", "tmpfs", journal]
    if subprocess.run(command, capture_output=True, check=False).returncode != 0:
        pytest.skip("needs the right to mount")
    yield journal
    subprocess.run(["umount", "-l", journal], check=True)


def fill(volume: Path) -> None:
    with contextlib.suppress(OSError), (volume / "filler").open("wb", buffering=0) as filler:
        while True:
            filler.write(bytes(4096))


def empty_again(volume: Path) -> None:
    (volume / "filler").unlink()


def forbid(volume: Path) -> None:
    subprocess.run(["mount", "-o", "remount,ro", volume], check=True)


def allow(volume: Path) -> None:
    subprocess.run(["mount", "-o", "remount,rw", volume], check=True)


@pytest.mark.parametrize(
    ("spoil", "repair", "message"),
    [(fill, empty_again, "No space left on device"), (forbid, allow, "Read-only file system")],
)
def test_file_system_that_cannot_be_written(
    programs: Path, volume: Path, spoil: Callable[[Path], None], repair: Callable[[Path], None], message: str
) -> None:
    """What was written before it is safe all the time; what came meanwhile, once it can be written again."""
    with substation_of(configuration(volume), programs) as substation:
        gateway = substation.gateway
        empty(gateway, "Control centre", MAIN)
        count_up(substation, range(800, 803))
        wait_journal(gateway, 3)
        gateway.stop()  # its file has to be begun anew at the next start, which needs room
        spoil(volume)
        gateway.start()
        wait_log(gateway, "3 events restored from the journal")
        wait_log(gateway, f"cannot write in {volume}: {message}; a power cut would lose events")
        cut_power(gateway)
        gateway.start()
        wait_log(gateway, f"cannot write in {volume}: {message}; a power cut would lose events")
        count_up(substation, range(803, 806))
        repair(volume)
        wait_log(gateway, f"writes again in {volume}")
        gateway.wait_for(lambda: not state(gateway)["failing"], SOON_S, "it does not fail any more")
        cut_power(gateway)
        start_again(substation)
        with Link(gateway, MAIN).start() as link:
            values = [found.value for found in take_all(link)]
        assert list(dict.fromkeys(values)) == list(range(800, 806))


# ---- what it costs ----------------------------------------------------------------------------------------


def test_nothing_is_written_while_all_is_acknowledged(substation: Substation, journal: Path) -> None:
    gateway = substation.gateway
    with Link(gateway, MAIN).start() as link:
        take_all(link)
        wait_queue(gateway, "Control centre", "waiting", 0)
        wait_journal(gateway, 0)
        time.sleep(2 * INTERVAL_S)  # the time that is measured begins with the next record
        records = state(gateway)["records"]
        changed = (journal / "events").stat().st_mtime_ns
        time.sleep(3 * INTERVAL_S)
        assert state(gateway)["records"] == records
        assert (journal / "events").stat().st_mtime_ns == changed


def test_file_stays_within_its_size(programs: Path, journal: Path) -> None:
    """Records come until the file is full; then another one takes its place, with the newest that wait."""
    config = configuration(journal)
    config["journal"]["size_kb"] = 64
    [device] = config["port"][0]["slaves"]
    device["input_registers"] = [{"address": address} for address in range(32)]
    with substation_of(config, programs) as substation:
        gateway, sizes, inodes = substation.gateway, [0], set[int]()
        while len(inodes) < 3:  # the first is of the start
            substation.set_and_scan(DEVICE, "input_registers", 0, [len(sizes)] * 32)
            file = (journal / "events").stat()
            sizes.append(file.st_size)
            inodes.add(file.st_ino)
        assert 32 * 1024 < max(sizes) <= 64 * 1024
        assert state(gateway)["left_out"] > 0
        wait_log(gateway, "have no room: increase size_kb")
        table = gateway.ctl("modules")
        assert "journal: " in table and " events not acknowledged; " in table
        cut_power(gateway)
        start_again(substation)
        with Link(gateway, MAIN).start() as link:
            values = [found.value for found in take_all(link)]
        assert len(values) > 3
        assert values == sorted(values)


def test_the_bound_is_told(programs: Path, tmp_path: Path) -> None:
    """rtud --check prints what docs/telecontrol.md derives."""
    file = tmp_path / "gateway.json"
    file.write_text(json.dumps(chapter_5() | {"journal": {}}))
    command = [programs / "rtud/rtud", "--check", file]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    a_day = 2 * (384 * 1024 // 4 + 16 * 1024) * 86400 // 30
    years = 47 * 2**20 * 60000 / a_day / 365.25
    assert years > 10
    assert done.stdout.splitlines()[1] == (
        f"journal: at most {a_day / 2**20:.1f} MiB a day reach the flash, "
        f"which 47 MiB with 60000 cycles can take for {years:.0f} years"
    )
