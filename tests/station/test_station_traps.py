# SPDX-License-Identifier: GPL-3.0-or-later
"""What trips controlled stations up, on the wire: docs/traps.md."""

import datetime
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from lab.gateway import Gateway
from rig.bare import (
    SEQUENCE_MODULO,
    STARTDT,
    STARTDT_CON,
    STOPDT,
    STOPDT_CON,
    TESTFR,
    TESTFR_CON,
    Bare,
    i_frame,
    is_i,
    s_frame,
)
from rig.desk import Substation, chapter_5, of_port, substation_of

BIG_UNIT = 90
BIG, BIG_DEVICE = 3000 + BIG_UNIT, f"3.{BIG_UNIT}"
STATION = 3067
RELAY, RELAY_DEVICE = 1010, "1.10"
M_EI, C_SC, C_DC, C_SE_NB, C_IC, C_RD, C_CS, C_TS = 70, 45, 46, 49, 100, 102, 103, 107
REQUEST, ACT, ACT_CON, DEACT, DEACT_CON, ACT_TERM, INTROGEN = 5, 6, 7, 8, 9, 10, 20
NEGATIVE, SEQUENCE, INVALID = 0x40, 0x80, 0x80
SOLITARY = range(400, 540, 2)  # coils without neighbours
YEAR = datetime.timedelta(days=366)


def asdu(kind: int, cause: int, ca: int, ioa: int, element: bytes, originator: int = 0) -> bytes:
    """Of one object."""
    head = bytes((kind, 1, cause, originator)) + ca.to_bytes(2, "little")
    return head + ioa.to_bytes(3, "little") + element


def interrogation(ca: int, cause: int = ACT, qualifier: int = 20, originator: int = 0) -> bytes:
    return asdu(C_IC, cause, ca, 0, bytes([qualifier]), originator)


def probe(ca: int = STATION) -> bytes:
    """A test command with time tag."""
    return asdu(C_TS, ACT, ca, 0, bytes.fromhex("aa550000000001011a"))


def head(kind: int, cause: int, ca: int) -> bytes:
    """How the ASDU of one object begins."""
    return bytes((kind, 1, cause, 0)) + ca.to_bytes(2, "little")


def clock(when: datetime.datetime) -> bytes:
    milliseconds = when.second * 1000 + when.microsecond // 1000
    date = (when.minute, when.hour, when.day, when.month, when.year - 2000)
    return asdu(C_CS, ACT, STATION, 0, milliseconds.to_bytes(2, "little") + bytes(date))


def big_device() -> dict[str, Any]:
    """More points of a type than an ASDU holds, with neighbours and without."""
    coils = [{"address": address} for address in (*range(300), *SOLITARY)]
    return {
        "id": BIG_UNIT,
        "coils": coils,
        "input_registers": [{"address": a} for a in range(200)],
    }


def configuration(**settings: int) -> dict[str, Any]:
    config = chapter_5()
    of_port(config, 3)["baud_rate"] = 115200
    of_port(config, 3)["slaves"].append(big_device())
    for port in config["port"]:
        for slave in port["slaves"]:
            for register in slave["input_registers"]:
                register.pop("cyclic_ms", None)  # nothing is sent but what the test makes happen
            slave["retries"] = 5  # nor is a device dead that a busy host keeps from answering
    config["iec104"].update(settings)
    return config


def hear_initialisation(gateway: Gateway) -> None:
    """The first connection that is started is told the end of initialisation of each station."""
    with Bare(gateway.address) as first:
        first.start()
        for _ in {point["ca"] for point in gateway.points().values()}:
            assert first.asdu()[0] == M_EI
            first.acknowledge()


@pytest.fixture(scope="module")
def usual(programs: Path) -> Iterator[Substation]:
    """The usual k, w and times; the event ring is the smallest there is."""
    with substation_of(configuration() | {"event_ring": 64}, programs) as substation:
        hear_initialisation(substation.gateway)
        yield substation


@pytest.fixture(scope="module")
def narrow(programs: Path) -> Iterator[Substation]:
    """k = w = 1, and the shortest times."""
    with substation_of(configuration(k=1, w=1, t1=3, t2=1, t3=2, select_timeout=1), programs) as substation:
        hear_initialisation(substation.gateway)
        yield substation


@pytest.fixture
def master(usual: Substation) -> Iterator[Bare]:
    with Bare(usual.gateway.address) as master:
        yield master.start()


@pytest.fixture
def slow_master(narrow: Substation) -> Iterator[Bare]:
    with Bare(narrow.gateway.address) as master:
        yield master.start()


# ---- 1 to 5: the session ----------------------------------------------------------------------------


@pytest.mark.slow
def test_sequence_numbers_wrap(master: Bare) -> None:
    """More than 40 000 I frames each way, w of them at a time."""
    for _ in range(41_000 // 8):
        master.ask(*[probe()] * 8)
        for _ in range(8):
            assert master.asdu()[2] == ACT_CON
    assert master.taken == master.sent == 41_000 > SEQUENCE_MODULO


def test_repeated_acknowledgement_is_none(master: Bare) -> None:
    master.ask(probe())
    master.asdu()
    master.send(s_frame(1) * 3)
    master.ask(probe())
    assert master.asdu()[0] == C_TS


def test_acknowledgement_that_goes_back_closes(master: Bare) -> None:
    master.ask(probe())
    master.asdu()
    master.send(s_frame(1) + s_frame(0))
    master.closed()


@pytest.mark.parametrize("number", [1, 3, SEQUENCE_MODULO - 1])
def test_wrong_send_number_closes(master: Bare, number: int) -> None:
    master.send(i_frame(number, 0, probe()))
    master.closed()


@pytest.mark.slow
def test_stop_waits_for_acknowledgements_and_bears_a_late_one(master: Bare) -> None:
    master.ask(probe(), probe())
    master.asdu(), master.asdu()
    master.send(STOPDT)
    master.nothing_for(0.2)  # both were acknowledged to us by the answers
    master.send(s_frame(1))
    master.nothing_for(0.2)
    master.send(s_frame(2))
    assert master.frame() == STOPDT_CON
    master.send(s_frame(2) + TESTFR)
    assert master.frame() == TESTFR_CON
    master.send(i_frame(2, 2, probe()))
    master.closed()


@pytest.mark.slow
def test_one_frame_at_a_time(slow_master: Bare) -> None:
    """k = w = 1: the station waits for each acknowledgement, gives each at once, and does not close."""
    slow_master.ask(interrogation(STATION))
    kinds = []
    while not (answer := slow_master.asdu()).startswith(head(C_IC, ACT_TERM, STATION)):
        kinds.append(answer[0])
        slow_master.nothing_for(0.05)
        slow_master.acknowledge()
    assert kinds == [C_IC, 1, 1, 11, 11]
    slow_master.ask(probe())
    assert is_i(slow_master.frame())  # which acknowledges
    slow_master.ask(asdu(C_SC, ACT, STATION, 1, b"\x01"))  # has no answer yet, and changes nothing
    assert slow_master.frame() == s_frame(slow_master.sent)


@pytest.mark.slow
def test_silent_connection_is_tested_and_given_up(narrow: Substation) -> None:
    """t3, then t1, also while stopped; a TESTFR con that was not asked for is passed over."""
    with Bare(narrow.gateway.address) as master:
        begun = time.monotonic()
        master.send(TESTFR_CON)
        assert master.frame() == TESTFR
        answered = time.monotonic()
        assert answered - begun >= 2.0  # t3
        master.send(TESTFR_CON)
        assert master.frame() == TESTFR
        assert master.closed() - answered >= 2.0 + 3.0  # t3 and t1


@pytest.mark.slow
def test_unacknowledged_frame_ends_the_connection(slow_master: Bare) -> None:
    """t1 of an own I frame, which TESTFR does not put off."""
    asked = time.monotonic()
    slow_master.ask(probe())
    slow_master.asdu()
    slow_master.send(TESTFR)
    assert slow_master.frame() == TESTFR_CON
    assert slow_master.closed() - asked >= 3.0


@pytest.mark.slow
def test_steps_of_the_clock_fire_no_timer(slow_master: Bare) -> None:
    """A year on and two years back: nothing is tested and nothing closed before t1, t3 say so.

    Data may come: a busy host lets devices look dead.
    """
    now = datetime.datetime.now(datetime.UTC)
    for when in (now + YEAR, now - YEAR, now):
        slow_master.ask(clock(when))
        assert slow_master.asdu()[2] == ACT_CON
        frame = b""
        while frame != TESTFR:
            assert frame == b"" or is_i(frame)
            acknowledged = time.monotonic()
            slow_master.acknowledge()
            frame = slow_master.frame()
        assert time.monotonic() - acknowledged >= 2.0
        slow_master.send(TESTFR_CON)


SPLIT = STARTDT + TESTFR + i_frame(0, 0, probe()) + s_frame(0) + i_frame(1, 0, probe())


@pytest.mark.parametrize("cut", range(1, len(SPLIT)))
def test_segments_split_anywhere(usual: Substation, cut: int) -> None:
    with Bare(usual.gateway.address) as master:
        master.send(SPLIT[:cut])
        if cut >= len(STARTDT):
            assert master.frame() == STARTDT_CON  # what is whole is answered before the rest comes
        master.send(SPLIT[cut:])
        if cut < len(STARTDT):
            assert master.frame() == STARTDT_CON
        assert master.frame() == TESTFR_CON
        assert [master.asdu()[2], master.asdu()[2]] == [ACT_CON, ACT_CON]


@pytest.mark.parametrize(
    "octets", [bytes((0x68, length)) for length in (0, 1, 2, 3, 254, 255)] + [b"\x67\x04", b"\x16"]
)
def test_impossible_beginnings_close(master: Bare, octets: bytes) -> None:
    master.send(octets)
    master.closed()


# ---- 6: interrogation -------------------------------------------------------------------------------


def objects_of(asdus: list[bytes]) -> list[tuple[int, bool, int, int]]:
    """Type, SQ, number of objects and first address of each."""
    return [(a[0], bool(a[1] & SEQUENCE), a[1] & 0x7F, int.from_bytes(a[6:9], "little")) for a in asdus]


def test_interrogation_is_packed_to_the_limits(master: Bare) -> None:
    """Sequences of 127 objects or 249 octets, and 60 objects with their addresses."""
    master.ask(interrogation(BIG))
    confirmation, *data, end = master.asdus_until(head(C_IC, ACT_TERM, BIG))
    assert (confirmation, end) == (interrogation(BIG, ACT_CON), interrogation(BIG, ACT_TERM))
    assert sorted(objects_of(data)) == sorted(
        [
            *((1, True, count, first) for first, count in ((1, 127), (128, 127), (255, 46))),
            *((1, False, count, first) for first, count in ((401, 60), (521, 10))),
            *((11, True, count, first) for first, count in ((30001, 80), (30081, 80), (30161, 40))),
        ]
    )
    assert {a[2:6] for a in data} == {bytes((INTROGEN, 0)) + BIG.to_bytes(2, "little")}
    assert max(map(len, data)) == 249


def test_interrogation_has_no_time_tags_and_no_counters(usual: Substation, master: Bare) -> None:
    """Of all stations: each confirms and terminates for itself, and is done before the next."""
    master.ask(interrogation(0xFFFF))
    stations = list(dict.fromkeys(point["ca"] for point in usual.gateway.points().values()))
    asdus: list[bytes] = []
    while sum(a[0] == C_IC and a[2] == ACT_TERM for a in asdus) < len(stations):
        asdus.append(master.asdu())
        master.acknowledge()
    image = [a for a in asdus if a[0] == C_IC or a[2] == INTROGEN]
    assert {a[0] for a in image} == {1, 3, 5, 7, 9, 11, 13, C_IC}
    order = [int.from_bytes(a[4:6], "little") for a in image]
    assert [ca for n, ca in enumerate(order) if n == 0 or order[n - 1] != ca] == stations
    assert [a[2] for a in image if a[0] == C_IC] == [ACT_CON, ACT_TERM] * len(stations)


def test_second_interrogation_is_refused_while_one_runs(usual: Substation) -> None:
    with Bare(usual.gateway.address) as master:
        master.start()
        master.ask(interrogation(0xFFFF), interrogation(BIG, originator=1), interrogation(BIG, originator=2))
        refusals = 0
        done = False
        while not done:
            answer = master.asdu()
            master.acknowledge()
            refusals += answer == interrogation(BIG, ACT_CON | NEGATIVE, originator=2)
            done = answer == interrogation(BIG, ACT_TERM, originator=1)
        assert refusals == 1


def test_stop_ends_an_interrogation(master: Bare) -> None:
    master.ask(interrogation(0xFFFF))
    for _ in range(12):
        master.asdu()
    master.send(STOPDT)
    master.nothing_for(0.1)
    master.acknowledge()
    assert master.frame() == STOPDT_CON
    master.send(STARTDT)
    assert master.frame() == STARTDT_CON
    master.ask(probe())
    assert until_answer(master, C_TS)[2] == ACT_CON  # no rest of the image before it


def until_answer(master: Bare, kind: int) -> bytes:
    """Passes over what is spontaneous or periodic, and over nothing else."""
    while (answer := master.asdu())[2] in (1, 2, 3):
        master.acknowledge()
    assert answer[0] == kind
    return answer


def test_connection_lost_in_an_interrogation(usual: Substation) -> None:
    for taken in range(13):
        with Bare(usual.gateway.address) as leaving:
            leaving.start().ask(interrogation(0xFFFF))
            for _ in range(min(taken, 12)):
                leaving.asdu()
        with Bare(usual.gateway.address) as master:
            master.start().ask(interrogation(STATION))
            assert until_answer(master, C_IC) == interrogation(STATION, ACT_CON)
            assert len(master.asdus_until(head(C_IC, ACT_TERM, STATION))) == 5


# ---- 7 to 9: requests and commands ------------------------------------------------------------------


@pytest.mark.parametrize(
    ("request_asdu", "cause"),
    [
        pytest.param(asdu(101, ACT, 2020, 1, b"\x05"), 47, id="counters with an address"),
        pytest.param(asdu(C_CS, ACT, STATION, 1, probe()[-7:]), 47, id="clock with an address"),
        pytest.param(asdu(C_TS, ACT, STATION, 9, probe()[-9:]), 47, id="test with an address"),
        pytest.param(probe(0xFFFF), 46, id="test of all stations"),
        pytest.param(asdu(C_SC, ACT, 0xFFFF, 4, b"\x01"), 46, id="command to all stations"),
        pytest.param(asdu(C_RD, REQUEST, 0xFFFF, 4, b""), 46, id="read of all stations"),
        pytest.param(asdu(C_RD, ACT, STATION, 4, b""), 45, id="read with a wrong cause"),
        pytest.param(asdu(201, ACT, STATION, 4, b"\x01\x02"), 44, id="private type"),
    ],
)
def test_refused_with_one_reply(master: Bare, request_asdu: bytes, cause: int) -> None:
    master.ask(request_asdu, probe())
    assert until_answer(master, request_asdu[0]) == (
        request_asdu[:2] + bytes((cause | NEGATIVE,)) + request_asdu[3:]
    )
    assert until_answer(master, C_TS)[2] == ACT_CON  # no second reply before it


def test_read_is_answered_with_data_alone(usual: Substation, master: Bare) -> None:
    master.ask(asdu(C_RD, REQUEST, STATION, 30001, b"", originator=9), probe())
    value = usual.lines.get("3.67", "input_registers", 0)
    expected = asdu(11, REQUEST, STATION, 30001, value.to_bytes(2, "little") + b"\x00", originator=9)
    assert until_answer(master, 11) == expected
    assert until_answer(master, C_TS)[2] == ACT_CON


@pytest.mark.slow
def test_originator_is_not_in_spontaneous_data(usual: Substation, master: Bare) -> None:
    master.ask(asdu(C_RD, REQUEST, STATION, 30002, b"", originator=9))
    assert until_answer(master, 11)[3] == 9
    usual.lines.set("3.67", "input_registers", 1, 4000)
    event = b""
    while not (event.startswith(bytes((35,))) and event[4:6] == STATION.to_bytes(2, "little")):
        event = master.asdu()
        master.acknowledge()
        assert event[2:4] in (b"\x01\x00", b"\x02\x00", b"\x03\x00")


def breaker(state: int, select: bool = False, cause: int = ACT, originator: int = 0) -> bytes:
    """An object that is to be selected first."""
    return asdu(C_DC, cause, RELAY, 1, bytes([state | (0x80 if select else 0)]), originator)


def answer_to_breaker(master: Bare, command: bytes) -> int:
    """The cause of the first answer."""
    master.ask(command)
    while (answer := master.asdu())[0] != C_DC:
        master.acknowledge()
    master.acknowledge()
    return answer[2]


def test_execute_of_another_value_or_originator_is_refused(usual: Substation, master: Bare) -> None:
    mark = usual.lines.mark()
    assert answer_to_breaker(master, breaker(2, select=True)) == ACT_CON
    assert answer_to_breaker(master, breaker(2, originator=5)) == ACT_CON | NEGATIVE
    assert answer_to_breaker(master, breaker(1)) == ACT_CON | NEGATIVE
    assert answer_to_breaker(master, breaker(2)) == ACT_CON | NEGATIVE  # the wrong value ended the selection
    usual.wait_scan(RELAY_DEVICE)
    assert not [f for f in usual.lines.frames(mark) if f.unit == 10 and f.bytes and f.bytes[1] in (5, 15)]


@pytest.mark.slow
def test_selection_ends_after_its_time(narrow: Substation, slow_master: Bare) -> None:
    """Another may select when the time is over, and not before; the first can no longer execute."""
    assert answer_to_breaker(slow_master, breaker(2, select=True)) == ACT_CON
    selected = time.monotonic()
    with Bare(narrow.gateway.address) as other:
        other.start()
        while answer_to_breaker(other, breaker(2, select=True)) != ACT_CON:
            assert time.monotonic() - selected < 5.0
        assert time.monotonic() - selected >= 0.95  # less what the confirmation was under way
        assert answer_to_breaker(slow_master, breaker(2)) == ACT_CON | NEGATIVE
        while answer_to_breaker(other, breaker(2, select=True, cause=DEACT)) != DEACT_CON:
            assert time.monotonic() - selected < 60.0  # a busy host: its own time was over too
            answer_to_breaker(other, breaker(2, select=True))


# ---- 11: values -------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("raw", [0x8000, 0x4000, 0x7FFF, 0xFFFF, 0])
def test_normalized_value_is_the_register(usual: Substation, master: Bare, raw: int) -> None:
    """-1.0, 0.5, the largest, the smallest negative, zero (101, 7.2.6.6)."""
    usual.set_and_scan(RELAY_DEVICE, "input_registers", 0, [raw])
    expected = raw.to_bytes(2, "little") + b"\x00"

    def read() -> bytes:
        master.ask(asdu(C_RD, REQUEST, RELAY, 30001, b""))
        answer = until_answer(master, 9)
        master.acknowledge()
        return answer[9:]

    usual.gateway.wait_for(lambda: read() == expected, 60.0, "the register's new value")


@pytest.mark.slow
@pytest.mark.sample(3)
@pytest.mark.parametrize(
    "border",
    [
        datetime.datetime(2027, 12, 31, 23, 59, 59, 900_000),
        datetime.datetime(2028, 2, 28, 23, 59, 59, 900_000),
        datetime.datetime(2027, 2, 28, 23, 59, 59, 900_000),
    ],
)
def test_time_tags_over_a_border(usual: Substation, master: Bare, border: datetime.datetime) -> None:
    """An event of the next moment is of the next day, month, year."""
    try:
        master.ask(clock(border))
        assert until_answer(master, C_CS)[2] == ACT_CON
        time.sleep(0.15)  # over the border
        changed = 4000 + border.microsecond // 1000 + border.year + border.month
        usual.lines.set("3.67", "input_registers", 2, changed)
        event = b""
        while event[6:11] != (30003).to_bytes(3, "little") + changed.to_bytes(2, "little"):
            event = master.asdu()
            master.acknowledge()
        next_day = border + datetime.timedelta(days=1)
        assert tuple(event[-4:]) == (0, next_day.day, next_day.month, next_day.year - 2000)
    finally:
        master.ask(clock(datetime.datetime.now(datetime.UTC)))
        assert until_answer(master, C_CS)[2] == ACT_CON


# ---- 12: the queue, and silence ---------------------------------------------------------------------


def image(asdus: list[bytes]) -> dict[int, bytes]:
    """The last value of each single point and scaled value by address, without its time."""
    known: dict[int, bytes] = {}
    for data in asdus:
        if data[0] not in (1, 11, 30, 35):
            continue
        size, value = {1: (1, 1), 11: (3, 3), 30: (8, 1), 35: (10, 3)}[data[0]]
        at = 6
        ioa = 0
        for n in range(data[1] & 0x7F):
            ioa += 1
            if n == 0 or not data[1] & SEQUENCE:
                ioa = int.from_bytes(data[at : at + 3], "little")
                at += 3
            known[ioa] = data[at : at + value]
            at += size
    return known


@pytest.mark.slow
def test_lost_events_leave_no_stale_value(usual: Substation, master: Bare) -> None:
    """A master that takes nothing while more happens than the ring holds knows the truth afterwards."""
    points = 300 + len(SOLITARY) + 200
    big = BIG.to_bytes(2, "little")
    usual.lines.fault(BIG_DEVICE, "mute")
    try:
        usual.gateway.wait_for(
            lambda: {p["quality"] for p in usual.gateway.points().values() if p["ca"] == BIG} == {"invalid"},
            20.0,
            "the device is dead",
        )
    finally:
        usual.lines.fault(BIG_DEVICE, "clear")
    usual.lines.set(BIG_DEVICE, "input_registers", 7, 777)
    usual.wait_all_good(BIG)
    asdus: list[bytes] = []
    deadline = time.monotonic() + 60
    while True:
        assert time.monotonic() < deadline
        data = master.asdu()
        master.acknowledge()
        if data[4:6] == big:
            asdus.append(data)
            known = image(asdus)
            good = [ioa for ioa, value in known.items() if not value[-1] & INVALID]
            if len(good) == points and known[30008] == b"\x09\x03\x00":
                break


def voluntary_switches(pid: int) -> int:
    status = Path(f"/proc/{pid}/status").read_text()
    return int(status.partition("\nvoluntary_ctxt_switches:")[2].split()[0])


@pytest.mark.slow
def test_nothing_happens_and_nothing_is_done(programs: Path) -> None:
    """With open connections, the station wakes for its heartbeat to rtud alone, four times a second."""
    seconds = 3.0
    with substation_of(configuration(), programs) as substation:
        station = substation.gateway.modules()["rtu-iec104"]["pid"]
        with Bare(substation.gateway.address) as one, Bare(substation.gateway.address) as other:
            one.start(), other.start()
            one.ask(interrogation(STATION))
            one.asdus_until(head(C_IC, ACT_TERM, STATION))
            before = voluntary_switches(station)
            one.nothing_for(seconds)
            assert (voluntary_switches(station) - before) / seconds < 8
