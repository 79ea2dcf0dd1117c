# SPDX-License-Identifier: GPL-3.0-or-later
"""Each control model of IEC 61850 with each way that a command can go, a station of 104 among them."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from test_iec61850_control import (
    ACT_CON,
    BREAKER,
    BY_PROCESS,
    C_DC,
    C_SC,
    CA,
    DENIED,
    DEVICE,
    DOMAIN,
    DONE,
    IN_EXECUTION,
    LAMP,
    LOCKED,
    LOST,
    NEGATIVE,
    NOT_SELECTED,
    ON,
    SELECT,
    SELECT_S,
    TOO_LATE,
    Plant,
    act,
    cause,
    configuration,
    ended,
)

from lab.gateway import free_port
from lab.raw_master import RawMaster
from peers import mms
from peers.mms import CHECK, Client, command, element
from rig.desk import gateway_on_lines

MODELS = {
    "direct-with-normal-security": (1, "normal", LAMP),
    "sbo-with-normal-security": (2, "normal", BREAKER),
    "direct-with-enhanced-security": (3, "enhanced", LAMP),
    "sbo-with-enhanced-security": (4, "enhanced", BREAKER),
}
FUNCTIONS = {LAMP: 5, BREAKER: 15}  # of Modbus, that write it
NON_EXISTENT = (0x80, b"\x0a")


@pytest.fixture(scope="module", params=["enhanced", "normal"])
def running(request: pytest.FixtureRequest, programs: Path) -> Iterator[tuple[Plant, str]]:
    port = free_port()
    config = configuration(port)
    config["iec61850"]["control_security"] = request.param
    with gateway_on_lines(config, programs, initial={}) as (lines, gateway):
        plant = Plant(lines, gateway, port)
        plant.wait_all_good(CA)
        yield plant, request.param


class Try:
    """A point of one control model, off, and a client that commands it."""

    def __init__(self, plant: Plant, client: Client, model: str) -> None:
        self.plant, self.client = plant, client
        self.number, self.security, self.point = MODELS[model]
        self.selects, self.mark = self.point == BREAKER, plant.lines.mark()

    def select(self, client: Client | None = None) -> bool:
        client = client or self.client
        if self.security == "enhanced":
            return act(client, "SBOw", self.point) == DONE
        ((_, answer),) = client.values((DOMAIN, f"GGIO1$CO${self.point}$SBO"))
        return answer != b""

    def select_if_needed(self) -> None:
        assert not self.selects or self.select()

    def is_on(self) -> bool:
        return self.plant.coil(3 if self.point == BREAKER else 0) == 1

    def refused(self, why: int, client: Client | None = None) -> None:
        client = client or self.client
        assert act(client, "Oper", self.point) == DENIED
        assert cause(client, self.point) == why

    def begin(self) -> None:
        """Oper, which the device takes and does not answer."""
        self.plant.lines.fault(DEVICE, "mute")
        self.client.number += 1
        item = element(mms.SEQUENCE, element(0xA0, mms.name(DOMAIN, f"GGIO1$CO${self.point}$Oper")))
        oper = element(0xA2, *command(ON), CHECK)
        write = element(mms.WRITE, element(0xA0, item), element(0xA0, oper))
        self.client.send(mms.tpkt(mms.data(mms.request(self.client.number, write))))
        self.plant.lines.wait_frame(
            lambda f: f.kind == "received" and f.bytes[1] == FUNCTIONS[self.point], since=self.mark
        )

    def end(self) -> int:
        """AddCause of the Oper that has begun."""
        answer = self.client.mms()
        while answer[0] == mms.REPORT:
            self.client.keep(answer[1])
            answer = self.client.mms()
        assert mms.elements(mms.elements(answer[1])[1][1]) == [DENIED]
        return cause(self.client, self.point)

    def ask_104(self, master: RawMaster, value: int) -> int:
        """A station commands the point. The cause of what confirms or refuses it."""
        kind, ioa, content = (C_DC, 3, value + 1) if self.selects else (C_SC, 1, value)
        master.request(kind, CA, ioa, bytes([content]))
        return master.answer(kind).cause

    def station_is_kept_out(self) -> None:
        """While a client has the point."""
        with RawMaster(*self.plant.gateway.address) as master:
            assert self.ask_104(master, 0) == ACT_CON | NEGATIVE

    def station_is_next(self) -> None:
        """Nothing of the client's command is left: a station commands the point."""
        with RawMaster(*self.plant.gateway.address) as master:
            if self.selects:
                assert self.ask_104(master, SELECT | 1) == ACT_CON
            assert self.ask_104(master, 1) == ACT_CON
            self.plant.gateway.wait_for(self.plant.is_free, 60.0, "the station's command is over")


def success(case: Try) -> None:
    case.select_if_needed()
    if case.selects:
        case.station_is_kept_out()
    assert act(case.client, "Oper", case.point) == DONE
    if case.security == "enhanced":
        assert ended(case.client, case.point) == 0
    case.plant.gateway.wait_for(case.plant.is_free, 60.0, "the value was read back")
    assert case.is_on() and len(case.plant.writes(case.mark)) == 1 and case.client.information == []


def exception(case: Try) -> None:
    case.plant.lines.fault(DEVICE, "exception", 4, FUNCTIONS[case.point])
    case.select_if_needed()
    case.refused(BY_PROCESS)
    assert not case.is_on()


def silence(case: Try) -> None:
    case.select_if_needed()
    case.begin()
    case.station_is_kept_out()
    assert case.end() == TOO_LATE
    assert len(case.plant.writes(case.mark)) == 1


def cancel(case: Try) -> None:
    """Of a selection; what is under way goes on."""
    if not case.selects:
        assert act(case.client, "Cancel", case.point) == NON_EXISTENT
        return
    assert case.select()
    assert act(case.client, "Cancel", case.point) == DONE
    case.refused(NOT_SELECTED)
    assert case.plant.writes(case.mark) == []
    assert case.select()
    case.begin()
    assert act(case.client, "Cancel", case.point) == DENIED
    assert cause(case.client, case.point, "Cancel") == IN_EXECUTION
    assert case.end() == TOO_LATE
    assert len(case.plant.writes(case.mark)) == 1


def other_client(case: Try) -> None:
    with case.plant.client() as other:
        if case.selects:
            assert case.select(other) and not case.select()
            case.client.information.clear()
            case.refused(LOCKED)
        else:
            case.begin()
            case.refused(IN_EXECUTION, other)
            assert case.end() == TOO_LATE
    assert len(case.plant.writes(case.mark)) <= 1


def station_104(case: Try) -> None:
    """Its selection, or its command under way, keeps clients out."""
    with RawMaster(*case.plant.gateway.address) as master:
        if case.selects:
            assert case.ask_104(master, SELECT | 1) == ACT_CON
            assert not case.select()
            case.client.information.clear()
            case.refused(LOCKED)
        else:
            case.plant.lines.fault(DEVICE, "mute")
            master.request(C_SC, CA, 1, b"\1")
            case.plant.lines.wait_frame(
                lambda f: f.kind == "received" and f.bytes[1] == FUNCTIONS[case.point], since=case.mark
            )
            case.refused(IN_EXECUTION)
    assert len(case.plant.writes(case.mark)) <= 1


def time_out(case: Try) -> None:
    """Of a selection; of an execution it is silence."""
    if case.selects:
        case.plant.end_selections_after(1)
        assert case.select()
        case.plant.gateway.wait_for(case.plant.is_free, 60.0, "the selection is over")
        case.refused(NOT_SELECTED)
        case.plant.end_selections_after(SELECT_S)


def kill(case: Try) -> None:
    case.select_if_needed()
    case.begin()
    case.station_is_kept_out()
    case.plant.gateway.kill("rtu-modbus-1")
    assert case.end() in (LOST, TOO_LATE)
    case.plant.lines.fault(DEVICE, "clear")
    case.plant.wait_all_good(CA)
    assert not case.is_on() and len(case.plant.writes(case.mark)) <= 1
    case.mark = case.plant.lines.mark()
    success(case)  # the next one is not the former


def kill_of_the_server(case: Try) -> None:
    """What it had selected is nobody's; what it had under way is refused, and not repeated."""
    if case.selects:
        assert case.select()
        case.plant.kill_server()
        assert case.client.is_closed()
        case.plant.gateway.wait_for(case.plant.is_over, 60.0, "its selection is over")
        assert case.plant.writes(case.mark) == []
    with case.plant.client() as case.client:
        case.select_if_needed()
        case.begin()
        case.plant.kill_server()
        assert case.client.is_closed()
    case.plant.gateway.wait_for(case.plant.is_over, 60.0, "its command is over")
    left = [row for row in case.plant.gateway.query("commands") if row["state"] == "refused command"]
    assert [row["result"] for row in left] == ["time-out"]  # nobody has released it
    case.plant.lines.fault(DEVICE, "clear")
    case.plant.wait_all_good(CA)
    assert len(case.plant.writes(case.mark)) == 1 and not case.is_on()
    with case.plant.client() as case.client:
        case.mark = case.plant.lines.mark()
        success(case)


WAYS = [success, exception, silence, cancel, other_client, station_104, time_out, kill, kill_of_the_server]


@pytest.mark.slow
@pytest.mark.parametrize("way", WAYS, ids=lambda way: way.__name__)
def test_a_command_goes_every_way(running: tuple[Plant, str], way: Callable[[Try], None]) -> None:
    plant, security = running
    for model in (name for name, (_, of, _) in MODELS.items() if of == security):
        plant.lines.set(DEVICE, "coils", 0, 0)
        plant.lines.set(DEVICE, "coils", 2, 1, 0)
        with plant.client() as client:
            case = Try(plant, client, model)
            ((_, shown),) = client.values((DOMAIN, f"GGIO1$CF${case.point}$ctlModel"))
            assert shown == bytes([case.number])
            try:
                way(case)
            except AssertionError as error:
                raise AssertionError(f"{model}: {error}") from error
            finally:
                plant.lines.fault(DEVICE, "clear")
        plant.gateway.wait_for(plant.is_free, 60.0, "no command is under way")
        plant.wait_all_good(CA)
        case.station_is_next()
