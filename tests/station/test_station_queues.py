# SPDX-License-Identifier: GPL-3.0-or-later
"""Several controlling stations on bare sockets: which events survive what, who is sent them, who may ask."""

import contextlib
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from lab.gateway import Gateway
from lab.raw_master import Asdu, Object, RawMaster, new_source
from lab.show import DEVICE, STATION
from rig.capture import unrecorded
from rig.desk import Substation, processor_seconds, substation_of
from rig.substation import (
    MAIN,
    REGISTER,
    RESERVE,
    SOON_S,
    STANDBY,
    TESTFR,
    Link,
    configuration,
    connection_of,
    count_up,
    empty,
    queue,
    wait_log,
    wait_queue,
)

TITLES = ["PEER", "QUEUE", "SINCE", "STARTED", "N(S)", "N(R)", "UNACKED", "K", "OWED", "W"]


@pytest.fixture(scope="module")
def substation(programs: Path) -> Iterator[Substation]:
    with substation_of(configuration(), programs) as substation:
        yield substation


def counters(gateway: Gateway) -> dict[str, int]:
    return {row["counter"]: row["value"] for row in gateway.query("iec104", "counters")}


# ---- what survives ----------------------------------------------------------------------------------


def close(link: Link, gateway: Gateway) -> None:
    assert connection_of(gateway, link)
    link.close()


def reset(link: Link, gateway: Gateway) -> None:
    assert connection_of(gateway, link)
    link.reset()


def kill_station(_: Link, gateway: Gateway) -> None:
    former = gateway.modules()["rtu-iec104"]["pid"]
    gateway.kill("rtu-iec104")

    def is_back() -> bool:
        module = gateway.modules()["rtu-iec104"]
        return module["pid"] not in (0, former, None) and module["state"] == "running"

    gateway.wait_for(is_back, SOON_S, "the station is back")


@pytest.mark.sample(3)
@pytest.mark.parametrize("interrupt", [close, reset, kill_station])
@pytest.mark.parametrize(
    ("name", "source"), [pytest.param("Control centre", MAIN, id="group"), ("127.0.0.50", "127.0.0.50")]
)
def test_unacknowledged_events_survive(
    substation: Substation, interrupt: Callable[[Link, Gateway], None], name: str, source: str
) -> None:
    """Exactly: what was acknowledged is not repeated, all else comes once more, in order."""
    gateway = substation.gateway
    with Link(gateway, source).start():
        pass  # an address has a queue from here on
    empty(gateway, name, source)
    with Link(gateway, source).start() as link:
        count_up(substation, range(100, 105), link)
        link.acknowledge(2)
        wait_queue(gateway, name, "waiting", 3)
        assert queue(gateway, name)["unacknowledged"] == 3
        interrupt(link, gateway)
    count_up(substation, range(105, 107))
    assert queue(gateway, name)["unacknowledged"] == 0
    with Link(gateway, source).start() as link:
        assert link.values(5) == [102, 103, 104, 105, 106]
        link.acknowledge()
        wait_queue(gateway, name, "waiting", 0)
        interrupt(link, gateway)
    with Link(gateway, source).start() as link:
        assert link.is_quiet()
        count_up(substation, range(107, 108), link)
        link.acknowledge()
        wait_queue(gateway, name, "waiting", 0)
    assert queue(gateway, name)["lost"] == 0


@pytest.mark.slow
def test_reconnection_at_once_finds_its_queue(substation: Substation) -> None:
    """The former one's last frame, its end and the next STARTDT may be there at the same time."""
    gateway, source = substation.gateway, "127.0.0.70"
    with unrecorded(gateway), Link(gateway, source).start() as link:
        for value in range(150, 170):
            count_up(substation, range(value, value + 1), link)
            link.acknowledge()
            link.close()
            link = Link(gateway, source).start()
        assert link.is_quiet()
    names = [row["name"] for row in gateway.query("iec104", "queues")]
    assert names.count(source) == 1


def test_group_has_events_from_before_its_first_connection(substation: Substation) -> None:
    """The first value of every point was an event. Without a group, events begin with STARTDT."""
    gateway = substation.gateway
    points = {(p["ca"], p["ioa"]) for p in gateway.points().values() if not p["never_read"]}
    with Link(gateway, new_source("127.0.0.1")).start() as stranger:
        assert stranger.is_quiet()
    seen: set[tuple[int, int]] = set()
    with Link(gateway, RESERVE).start() as link:
        waiting = queue(gateway, "Reserve")["waiting"]
        assert waiting >= len(points)
        while queue(gateway, "Reserve")["waiting"] > 0:
            for frame in link.until_quiet():
                seen |= information(frame)
            link.acknowledge()
    assert seen == points


def information(frame: bytes) -> set[tuple[int, int]]:
    """Station and address of each object of a frame with single objects (SQ = 0)."""
    count, ca = frame[7] & 0x7F, int.from_bytes(frame[10:12], "little")
    size = (len(frame) - 12) // count
    assert frame[8] == 3 and count * size == len(frame) - 12
    begins = range(12, len(frame), size)
    return {(ca, int.from_bytes(frame[begin : begin + 3], "little")) for begin in begins}


# ---- redundancy groups --------------------------------------------------------------------------------


def test_switch_over_after_a_silent_failure(substation: Substation) -> None:
    """The first link is not closed by its controlling station: the second STARTDT does it."""
    gateway = substation.gateway
    empty(gateway, "Control centre", MAIN)
    before = counters(gateway)
    with Link(gateway, STANDBY) as standby, Link(gateway, MAIN).start() as main:
        assert standby.is_quiet()
        count_up(substation, range(200, 203), main)
        main.acknowledge(1)
        wait_queue(gateway, "Control centre", "waiting", 2)
        assert standby.is_quiet()
        assert not connection_of(gateway, standby)["started"]
        standby.start()
        assert standby.values(2) == [201, 202]
        assert main.is_closed()
        count_up(substation, range(203, 204), standby)
        standby.acknowledge()
        wait_queue(gateway, "Control centre", "waiting", 0)
        with Link(gateway, MAIN).start() as back:
            assert back.is_quiet()
            assert standby.is_closed()
            count_up(substation, range(204, 205), back)
            back.acknowledge()
            wait_queue(gateway, "Control centre", "waiting", 0)
    assert counters(gateway)["closed_taken_over"] == before["closed_taken_over"] + 2


@pytest.mark.slow
def test_orderly_switch_over(substation: Substation) -> None:
    """STOPDT on one connection, STARTDT on another, over and over: both stay, each event comes once."""
    gateway = substation.gateway
    empty(gateway, "Control centre", MAIN)
    with Link(gateway, MAIN) as main, Link(gateway, STANDBY) as standby:
        value = 300
        for link in (main, standby) * 3:
            link.start()
            if value > 300:
                assert link.values(1) == [value]
            count_up(substation, range(value + 1, value + 3), link)
            link.acknowledge()
            link.stop()
            count_up(substation, range(value + 3, value + 4))
            value += 3
        assert main.is_quiet() and standby.is_quiet()
        main.start()
        assert main.values(1) == [value]
        main.acknowledge()
        wait_queue(gateway, "Control centre", "waiting", 0)


def test_connections_of_one_address_without_a_group_are_controlling_stations_of_their_own(
    substation: Substation,
) -> None:
    """Or one whose first link failed in silence: what was not acknowledged there comes here too."""
    gateway, source = substation.gateway, "127.0.0.60"
    with Link(gateway, source).start() as first, Link(gateway, source) as second:
        count_up(substation, range(397, 400), first)
        first.acknowledge(2)
        wait_queue(gateway, source, "waiting", 1)
        second.start()
        assert second.values(1) == [399]
        for link in (first, second):
            assert link.is_quiet()
        substation.set_and_scan(DEVICE, "input_registers", REGISTER, [400])
        assert first.values(1) == second.values(1) == [400]
        first.acknowledge()
        second.acknowledge()
        assert first.is_quiet() and second.is_quiet()


# ---- too many events -----------------------------------------------------------------------------------


@pytest.mark.slow
def test_overflow_is_counted_and_all_values_follow(programs: Path) -> None:
    limit, changes = 100, 70
    config = configuration()
    config["event_ring"] = 256
    config["redundancy_groups"][0]["queue"] = limit
    with substation_of(config, programs) as substation:
        gateway = substation.gateway
        empty(gateway, "Control centre", MAIN)
        before = queue(gateway, "Reserve")["waiting"]
        for value in range(501, 501 + changes):  # three registers
            substation.set_and_scan(DEVICE, "input_registers", 0, [value, value, value])
        gateway.wait_for(
            lambda: [p["value"] for p in gateway.points().values() if p["ioa"] == 30003] == [500 + changes],
            SOON_S,
            "the last change is in the map",
        )
        wait_queue(gateway, "Control centre", "waiting", limit)
        events = queue(gateway, "Reserve")["waiting"] - before  # this one has room for all
        assert events > 2 * limit - 20
        wait_queue(gateway, "Control centre", "lost", events - limit)
        with Link(gateway, MAIN).start() as link:
            objects: list[Object] = []
            while frames := list(link.until_quiet()):
                for frame in frames:
                    objects += Asdu.parse(frame[6:], 0).objects()
                link.acknowledge()
        kept = [found.value for found in objects if found.ca == STATION and found.ioa in range(30001, 30004)]
        assert kept[0] > 501
        assert kept[: limit - 1] == sorted(kept[: limit - 1])
        refreshed = {(found.ca, found.ioa) for found in objects[limit:]}
        assert refreshed >= {(p["ca"], p["ioa"]) for p in gateway.points("p3.67.*").values()}
        lines = [line for line in gateway.log(1000).splitlines() if "the oldest are lost" in line]
        assert len([line for line in lines if f"Control centre: more than {limit} events wait" in line]) == 1
        assert gateway.modules()["rtu-iec104"]["lost_events"] == events - limit
        with Link(gateway, MAIN).start() as main, Link(gateway, STANDBY).start() as standby:
            wait_log(gateway, f"{main.name}: {standby.name} takes over")


OWN_CA, LOSING, LOST = 900, 1, 101  # of the first group; M_SP_TB_1 and M_BO_TB_1


def until_own(master: RawMaster, kind: int, ioa: int, value: bytes) -> None:
    """The object's next event in the gateway's own station, its time tag apart."""
    deadline = time.monotonic() + SOON_S
    while True:
        asdu = master.next_asdu(deadline)
        size = {30: 3 + 1 + 7, 33: 3 + 5 + 7}[asdu.type] if asdu.ca == OWN_CA and asdu.type != 70 else 1
        objects = [asdu.body[begin : begin + size] for begin in range(0, len(asdu.body), size)]
        found = [octets[3:-7] for octets in objects if octets[:3] == ioa.to_bytes(3, "little")]
        if asdu.ca == OWN_CA and asdu.type == kind and found:
            assert (asdu.cause, found) == (3, [value])
            return


def own_objects(master: RawMaster) -> list[tuple[int, bytes]]:
    """Of an interrogation of the gateway's own station."""
    master.request(100, OWN_CA, 0, bytes([20]))
    assert master.answer(100).cause == 7
    found: list[tuple[int, bytes]] = []
    while (asdu := master.next_asdu(time.monotonic() + SOON_S)).type != 100:
        found += [(asdu.type, asdu.body)] if asdu.cause == 20 else []
    return found


@pytest.mark.slow
def test_losses_are_points_of_the_gateway_itself(programs: Path) -> None:
    """Another control centre is told when it begins and when it is over."""
    config = configuration()
    config["event_ring"] = 256
    config["redundancy_groups"][0]["queue"] = 100
    config["iec104"]["own_ca"] = OWN_CA
    with substation_of(config, programs) as substation:
        gateway = substation.gateway
        empty(gateway, "Control centre", MAIN)
        empty(gateway, "Reserve", RESERVE)
        with RawMaster(*gateway.address, source=RESERVE) as reserve:
            for value in range(501, 541):  # three registers
                substation.set_and_scan(DEVICE, "input_registers", 0, [value, value, value])
            until_own(reserve, 30, LOSING, b"\x01")
            assert gateway.points()["gateway.queue-1.losing"]["value"] == "on"
            empty(gateway, "Control centre", MAIN)
            until_own(reserve, 30, LOSING, b"\x00")
            lost = queue(gateway, "Control centre")["lost"]
            assert lost > 10
            count = lost.to_bytes(4, "little") + b"\x00"
            until_own(reserve, 33, LOST, count)
            told = own_objects(reserve)
            assert told == [  # of two groups and all others, neighbours together
                (1, bytes.fromhex("010000 00 00")),
                (1, bytes.fromhex("090000 00")),
                (7, b"\x65\x00\x00" + count + bytes(5)),
                (7, b"\x6d\x00\x00" + bytes(5)),
            ]
            reserve.request(45, OWN_CA, LOSING, b"\x01")  # nobody commands it
            assert reserve.answer(45).cause == 47 | 0x40
        former = gateway.modules()["rtu-iec104"]["pid"]
        gateway.kill("rtu-iec104")
        gateway.wait_for(
            lambda: (
                gateway.modules()["rtu-iec104"]["pid"] not in (former, 0)
                and {p["quality"] for p in gateway.points("gateway.*").values()} == {"good"}
            ),
            SOON_S,
            "its points are good again",
        )
        assert [(port["port"], len(port["devices"])) for port in gateway.query("lines")] == [(3, 1)]
        assert [port["port"] for port in gateway.query("lines", "--histogram")] == [3]
        with RawMaster(*gateway.address, source=RESERVE) as reserve:
            assert own_objects(reserve) == told
        assert not [line for line in gateway.log(1000).splitlines() if "Reserve: more than" in line]


# ---- who may connect, who may command -------------------------------------------------------------------


def test_only_listed_masters_connect(programs: Path) -> None:
    config = configuration()
    config["masters"] = ["127.0.0.1", "127.0.0.41"]  # the first one is the laboratory's
    del config["redundancy_groups"]
    with substation_of(config, programs) as substation:
        gateway = substation.gateway
        with Link(gateway, "127.0.0.41") as listed, Link(gateway, "127.0.0.42") as stranger:
            assert listed.is_quiet()
            with contextlib.suppress(ConnectionResetError, BrokenPipeError):
                stranger.send(TESTFR)
            assert stranger.is_closed()
            assert listed.is_quiet()
            wait_log(gateway, f'{stranger.name}: refused, its address is not in "masters"')
        assert counters(gateway)["refused_address_not_listed"] == 1


def test_other_originators_are_refused(programs: Path) -> None:
    config = configuration()
    config["originators"] = [5, 255]
    with substation_of(config, programs) as substation, RawMaster(*substation.gateway.address) as master:
        mark = substation.lines.mark()
        for originator, cause in ((0, 7 | 0x40), (4, 7 | 0x40), (5, 7), (255, 7)):
            master.request(45, STATION, 4, b"\x01", originator=originator)
            confirmation = master.answer(45)
            assert (confirmation.cause, confirmation.originator) == (cause, originator)
            if cause == 7:
                assert master.answer(45).cause == 10
        for kind, element, asked, answered in (
            (100, b"\x14", 6, 7 | 0x40),
            (101, b"\x05", 6, 7 | 0x40),
            (103, bytes(7), 6, 7 | 0x40),
            (107, b"\xaa\x55" + bytes(7), 6, 7 | 0x40),
            (45, b"\x01", 8, 9 | 0x40),
        ):
            master.request(kind, STATION, 4 if kind == 45 else 0, element, cause=asked)
            assert master.answer(kind).cause == answered
        master.request(102, STATION, 4, b"", cause=5)
        assert master.answer(102).cause == 5 | 0x40
        writes = [f for f in substation.lines.frames(mark) if f.kind == "received" and f.bytes[1] == 5]
        assert len(writes) == 2
        assert counters(substation.gateway)["refused_originator"] == 8


# ---- rtuctl ---------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_rtuctl_shows_what_was_on_the_wire(substation: Substation) -> None:
    gateway = substation.gateway
    empty(gateway, "Control centre", MAIN)
    before = counters(gateway)
    with Link(gateway, MAIN).start() as link:
        count_up(substation, range(600, 603), link)
        link.acknowledge(1)
        link.request(bytes.fromhex("630106 00 fb0b 000000 00"))  # type 99
        link.frame()
        link.request(bytes.fromhex("2d0106 00 fb0b 4d0000 01"))  # an unknown object
        link.frame()
        assert link.is_quiet()
        row = connection_of(gateway, link)
        assert (row["queue"], row["started"], row["k"], row["w"]) == ("Control centre", True, 12, 8)
        assert (row["ns"], row["nr"], row["unacknowledged"], row["owed"]) == (5, 2, 1, 0)
        assert 0 <= row["since_s"] < 60
        table = gateway.ctl("iec104", "connections").splitlines()
        assert table[0].split() == TITLES
        assert [line for line in table if line.startswith(link.name) and line.endswith(" 1  12     0  8")]
        link.acknowledge(1)
        assert link.is_closed()
        gateway.wait_for(lambda: not connection_of(gateway, link), SOON_S, "the connection is gone")
    after = counters(gateway)
    assert {name: after[name] - before[name] for name in after if after[name] != before[name]} == {
        "connections_accepted": 1,
        "startdt_act_in": 1,
        "startdt_con_out": 1,
        "testfr_act_in": 1,
        "testfr_con_out": 1,
        "i_frames_in": 2,
        "i_frames_out": 5,
        "s_frames_in": 2,
        "events_sent": 3,
        "refused_44_unknown_type": 1,
        "refused_47_unknown_ioa": 1,
        "closed_bad_nr": 1,
    }
    whole = gateway.ctl("iec104")
    assert whole.startswith("PEER ") and "\n\nQUEUE " in whole and "\n\nCOUNTER " in whole
    [every] = gateway.query("iec104")
    assert set(every) == {"connections", "queues", "counters"}


@pytest.mark.slow
def test_waiting_costs_no_time(substation: Substation) -> None:
    """Events that wait for an acknowledgement, and a group that nobody has started."""
    gateway = substation.gateway
    station = gateway.modules()["rtu-iec104"]["pid"]
    with Link(gateway, new_source("127.0.0.1")).start() as link:
        count_up(substation, range(700, 703), link)
        gateway.wait_for(lambda: queue(gateway, "Reserve")["waiting"] >= 3, SOON_S, "events wait")
        before = processor_seconds(station)
        time.sleep(3)  # the time that is measured
        assert processor_seconds(station) - before <= 0.03
