# SPDX-License-Identifier: GPL-3.0-or-later
"""Commands by IEC 61850: all control models, devices that answer or do not, other protocols in between."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from lab.gateway import free_port
from lab.linesim import Frame
from lab.operator import operate
from lab.raw_master import RawMaster
from peers import mms
from peers.mms import CHECK, Client, command, element
from rig.desk import Substation, gateway_on_lines, patience

CA, DEVICE, DOMAIN = 1005, "1.5", "OpenRTUCA1005"
LAMP, BREAKER, LEVEL, LEVELS = "SPCSO1", "DPCSO3", "AnOut40001", "GGIO1$MX$AnOut40001$mxVal$f"
ON, OFF = bytes.fromhex("8301ff"), bytes.fromhex("830100")
DENIED, DONE, MISFIT = (0x80, b"\3"), mms.DONE, (0x80, b"\7")
C_SC, C_DC, SELECT, ACT_CON, NEGATIVE = 45, 46, 0x80, 7, 0x40
# AddCause
NOT_SUPPORTED, BY_MODE, BY_PROCESS, IN_EXECUTION, TOO_LATE = 1, 8, 9, 12, 16
NOT_SELECTED, NO_ACCESS, LOST, INCONSISTENT, LOCKED = 18, 20, 23, 26, 27


COMMAND_S = 30
SELECT_S = 30  # a client on a busy host may take its time between selection and execution


def configuration(port: int) -> dict[str, Any]:
    coils = [{"address": 0}, {"address": 2, "type": "double", "select": True}, {"address": 5}]
    registers = [{"address": 0, "step": 10, "min": -20, "max": 35}, {"address": 4, "type": "bitstring"}]
    slave = {"id": 5, **patience(1000), "coils": coils, "holding_registers": registers}
    pace = {"baud_rate": 38400, "data_bits": 8, "stop_bits": 1, "parity": 0}
    seen = [f"p{DEVICE}.c2[stVal]", f"p{DEVICE}.c2"]
    blocks = [{"name": "brcbSeen", "buffered": True}, {"name": "urcbSeen"}]
    reports = [block | {"triggers": ["dchg"], "options": ["reasonCode"]} for block in blocks]
    return {
        "iec104": {"connections_per_address": 8},
        "commands": {"select_timeout": SELECT_S, "command_timeout": COMMAND_S},
        "iec61850": {
            "address": "127.0.0.1",
            "port": port,
            "controllers": ["127.0.0.1"],
            "data_sets": [{"name": "Seen", "points": seen, "reports": reports}],
        },
        "port": [{"value": 1, "active": 1, **pace, "slaves": [slave]}],
    }


@dataclass
class Plant(Substation):
    """The gateway, its one device, and the port of its server."""

    port: int

    def client(self, source: str = "127.0.0.1") -> Client:
        return Client(self.port, source=source)

    def coil(self, address: int) -> int:
        return self.lines.get(DEVICE, "coils", address)

    def writes(self, since: int) -> list[Frame]:
        """What the device was sent."""
        self.coil(0)  # its answer comes behind the frames so far
        frames = self.lines.frames(since)
        return [f for f in frames if f.kind == "received" and f.bytes[1] in (5, 6, 15, 16)]

    def states(self) -> set[str]:
        return {row["state"] for row in self.gateway.query("commands")}

    def end_selections_after(self, seconds: int) -> None:
        """Those that begin from now on."""
        config = self.gateway.configuration()
        config["commands"]["select_timeout"] = seconds
        self.gateway.ctl("reload", self.gateway.put(config))

    def kill_server(self) -> None:
        """Its next process runs."""
        before = self.gateway.modules()["rtu-iec61850"]["pid"]
        self.gateway.kill("rtu-iec61850")

        def runs() -> bool:
            module = self.gateway.modules()["rtu-iec61850"]
            return module["state"] == "running" and module["pid"] not in (0, before)

        self.gateway.wait_for(runs, 60.0, "it runs again")

    def is_over(self) -> bool:
        """Nothing is selected or under way; who has asked may be gone, and the end still be shown."""
        return not self.states() & {"accepted selection", "executing command"}

    def is_free(self) -> bool:
        return self.states() <= {"inactive command", "interrupted selection"}


@pytest.fixture(scope="module")
def running(programs: Path) -> Iterator[Plant]:
    port = free_port()
    with gateway_on_lines(configuration(port), programs, initial={}) as (lines, gateway):
        plant = Plant(lines, gateway, port)
        plant.wait_all_good(CA)
        yield plant


@pytest.fixture
def plant(running: Plant) -> Iterator[Plant]:
    """The device as it is switched on, and no command."""
    running.lines.set(DEVICE, "coils", 0, 0)
    running.lines.set(DEVICE, "coils", 2, 1, 0)
    running.gateway.wait_for(running.is_free, 60.0, "no command is under way")
    yield running
    running.lines.fault(DEVICE, "clear")
    running.wait_all_good(CA)


def act(client: Client, service: str, what: str, value: bytes = ON, **more: Any) -> tuple[int, bytes]:
    """One service of a command, and its answer."""
    parts = command(value, **more) + ([] if service == "Cancel" else [CHECK])
    (result,) = client.write(DOMAIN, (f"GGIO1$CO${what}${service}", element(0xA2, *parts)))
    return result


def cause(client: Client, what: str, service: str = "Oper") -> int:
    """AddCause of the LastApplError that has come."""
    names, ((_, content),) = client.information.pop(0)
    assert names == ["LastApplError"]
    (_, name), _, (_, origin), (_, number), (_, add_cause) = mms.elements(content)
    assert name.decode() == f"{DOMAIN}/GGIO1$CO${what}${service}"
    assert (mms.elements(origin), number) == ([(0x85, b"\2"), (0x89, b"tests")], b"\1")
    return add_cause[0]


def ended(client: Client, what: str) -> int:
    """How a command with enhanced security ended: 0, or AddCause."""
    names, values = client.termination()
    assert names[-1] == f"GGIO1$CO${what}$Oper"
    assert len(mms.elements(values[-1][1])) == 6
    return mms.elements(values[0][1])[4][1][0] if names[0] == "LastApplError" else 0


def foreign(plant: Plant, what: str, value: str, *actions: str) -> dict[str, Any]:
    return operate(plant.port, f"{DOMAIN}/GGIO1.{what}", value, *actions)


WELL = {"done": True, "error": 0, "cause": 0}


# ---- enhanced security --------------------------------------------------------------------------------


@pytest.mark.slow
def test_libiec61850_operates_a_breaker(plant: Plant) -> None:
    answers = foreign(plant, BREAKER, "true", "select", "operate")
    terminations = [{"error": 0, "cause": 0}]
    assert answers == {"model": 4, "select": WELL, "operate": WELL, "terminations": terminations}
    assert (plant.coil(2), plant.coil(3)) == (0, 1)
    answers = foreign(plant, BREAKER, "false", "select", "cancel", "operate")
    assert (answers["select"], answers["cancel"]) == (WELL, WELL)
    assert answers["operate"] == {"done": False, "error": 1, "cause": NOT_SELECTED}


def test_the_value_is_there_before_the_termination(plant: Plant) -> None:
    """Three kinds of values, and what is read behind the end of each."""
    with plant.client() as client:
        assert act(client, "Oper", LAMP) == DONE
        assert ended(client, LAMP) == 0
        assert client.values((DOMAIN, f"GGIO1$ST${LAMP}$stVal")) == [(0x83, b"\1")]
        value = element(0xA2, bytes.fromhex("87050841a00000"))  # 20
        assert act(client, "Oper", LEVEL, value) == DONE
        assert ended(client, LEVEL) == 0
        assert client.values((DOMAIN, LEVELS)) == [(0x87, bytes.fromhex("0841a00000"))]
        assert act(client, "Oper", "ISCSO40005", bytes.fromhex("8502ff00")) == DONE
        assert ended(client, "ISCSO40005") == 0
        assert plant.lines.get(DEVICE, "holding_registers", 5) & 0xFFFF == 0xFF00


def test_a_selection_is_good_for_one_execution_as_selected(plant: Plant) -> None:
    mark = plant.lines.mark()
    with plant.client() as client:
        assert act(client, "Oper", BREAKER) == DENIED
        assert cause(client, BREAKER) == NOT_SELECTED
        assert act(client, "SBOw", BREAKER) == DONE
        assert act(client, "SBOw", BREAKER) == DONE
        for more in ({"value": OFF}, {"number": 2}, {"who": b"others"}):
            assert act(client, "SBOw", BREAKER) == DONE
            assert act(client, "Oper", BREAKER, **{"value": ON, **more}) == DENIED
            names, ((_, content),) = client.information.pop()
            assert (names, mms.elements(content)[4][1]) == (["LastApplError"], bytes([INCONSISTENT]))
            assert act(client, "Oper", BREAKER) == DENIED
            assert cause(client, BREAKER) == NOT_SELECTED
        assert plant.writes(mark) == []
        assert act(client, "SBOw", BREAKER) == DONE
        assert act(client, "Oper", BREAKER) == DONE
        assert ended(client, BREAKER) == 0
        assert act(client, "Cancel", BREAKER) == DENIED
        assert cause(client, BREAKER, "Cancel") == NOT_SELECTED
    assert len(plant.writes(mark)) == 1


def test_stseld_shows_a_selection_of_any_protocol(plant: Plant) -> None:
    """And sboTimeout and operTimeout are those of all protocols."""
    names = (f"ST${BREAKER}$stSeld", f"CF${BREAKER}$sboTimeout", f"CF${BREAKER}$operTimeout")

    def seen() -> list[int]:
        answers = client.values(*[(DOMAIN, f"GGIO1${name}") for name in names])
        return [int.from_bytes(content, "big") for _, content in answers]

    with plant.client() as client, RawMaster(*plant.gateway.address) as master:
        assert seen() == [0, SELECT_S * 1000, COMMAND_S * 1000]
        assert act(client, "SBOw", BREAKER) == DONE
        assert seen()[0] == 1
        assert act(client, "Cancel", BREAKER) == DONE
        assert seen()[0] == 0
        plant.gateway.wait_for(plant.is_free, 60.0, "the selection is over")
        master.request(C_DC, CA, 3, bytes([SELECT | 2]))
        assert master.answer(C_DC).cause == ACT_CON
        assert seen()[0] == 1
        master.request(C_DC, CA, 3, bytes([2]))
        assert master.answer(C_DC).cause == ACT_CON
        assert seen()[0] == 0


@pytest.mark.slow
@pytest.mark.parametrize("block", ["LLN0$RP$urcbSeen01", "LLN0$BR$brcbSeen01"])
def test_a_change_of_stseld_is_told(plant: Plant, block: str) -> None:
    """7-3: its trigger is dchg. Of the data object and the attribute, not of the value; whoever selects."""
    names = [f"GGIO1$ST${BREAKER}$stVal", f"GGIO1$ST${BREAKER}", f"GGIO1$ST${BREAKER}$stSeld"]
    chosen = {"OptFlds": "8403061000", "TrgOps": "84020240", "RptEna": "8301ff"}
    with plant.client() as client, RawMaster(*plant.gateway.address) as master:
        off = [(0x84, b"\6\x40")]
        plant.gateway.wait_for(lambda: client.values((DOMAIN, names[0])) == off, 60.0, "the value is at rest")
        if "RP" in block:
            listed = [element(mms.SEQUENCE, element(0xA0, mms.name(DOMAIN, name))) for name in names]
            made = element(mms.LIST_DEFINE, mms.name(DOMAIN, "LLN0$All"), element(0xA0, *listed))
            assert client.ask(made)[0] == mms.RESPONSE
            chosen = {"DatSet": element(0x8A, f"{DOMAIN}/LLN0$All".encode()).hex()} | chosen
        else:
            chosen = {"PurgeBuf": "8301ff"} | chosen
        for name, octets in chosen.items():
            assert client.write(DOMAIN, (f"{block}${name}", bytes.fromhex(octets))) == [DONE], name

        def told(wanted: int) -> None:
            """The value comes first, then the data object, which ends with stSeld; a client adds that."""
            _, _, inclusion, *rest = client.report()
            values = rest[: len(rest) // 2]
            assert inclusion[1][1] == (0b0110_0000 if "RP" in block else 0b0100_0000)
            assert mms.elements(values[0][1])[-1] == (0x83, bytes([wanted]))
            assert values[1:] == ([(0x83, bytes([wanted]))] if "RP" in block else [])
            assert {reason[1][1] for reason in rest[len(values) :]} == {0x40}

        for _ in range(2):
            assert act(client, "SBOw", BREAKER) == DONE
            told(1)
            assert act(client, "Cancel", BREAKER) == DONE
            told(0)
        plant.gateway.wait_for(plant.is_free, 60.0, "the selection is over")
        master.request(C_DC, CA, 3, bytes([SELECT | 2]))
        assert master.answer(C_DC).cause == ACT_CON
        told(1)
        master.request(C_DC, CA, 3, bytes([SELECT | 2]), 8)  # deactivation
        told(0)
        assert client.reports == []


def test_a_selection_of_one_protocol_blocks_the_others(plant: Plant) -> None:
    with plant.client() as client, plant.client() as other, RawMaster(*plant.gateway.address) as master:
        master.request(C_DC, CA, 3, bytes([SELECT | 2]))
        assert master.answer(C_DC).cause == ACT_CON
        assert act(client, "SBOw", BREAKER) == DENIED
        assert cause(client, BREAKER, "SBOw") == LOCKED
        master.request(C_DC, CA, 3, bytes([2]))
        assert master.answer(C_DC).cause == ACT_CON
        plant.gateway.wait_for(plant.is_free, 60.0, "the station has ended its command")
        assert act(client, "SBOw", BREAKER) == DONE
        for _ in range(2):
            master.request(C_DC, CA, 3, bytes([SELECT | 2]))
            while (answer := master.answer(C_DC).cause) & 0x3F != ACT_CON:
                pass
            assert answer == ACT_CON | NEGATIVE
        assert act(other, "SBOw", BREAKER) == DENIED
        assert cause(other, BREAKER, "SBOw") == LOCKED
        assert act(client, "Cancel", BREAKER) == DONE
        assert act(other, "SBOw", BREAKER) == DONE
    plant.gateway.wait_for(plant.is_free, 60.0, "a client that went has left no selection")
    assert "interrupted selection" not in plant.states()  # it did not have to end by itself


@pytest.mark.slow
def test_a_selection_ends_by_itself(plant: Plant) -> None:
    plant.end_selections_after(1)
    with plant.client() as client:
        assert act(client, "SBOw", BREAKER) == DONE
        plant.gateway.wait_for(plant.is_free, 60.0, "the selection is over")
        assert act(client, "Oper", BREAKER) == DENIED
        assert cause(client, BREAKER) == NOT_SELECTED
    plant.end_selections_after(SELECT_S)


@pytest.mark.slow
def test_what_a_device_answers_is_the_reason(plant: Plant) -> None:
    with plant.client() as client:
        plant.lines.fault(DEVICE, "exception", 4, 5)
        assert act(client, "Oper", LAMP) == DENIED
        assert cause(client, LAMP) == BY_PROCESS
        plant.lines.fault(DEVICE, "mute")
        mark = plant.lines.mark()
        assert act(client, "Oper", LAMP) == DENIED
        assert cause(client, LAMP) == TOO_LATE
        assert len(plant.writes(mark)) <= 1


@pytest.mark.slow
def test_an_owner_that_dies_leaves_an_unknown_fate(plant: Plant) -> None:
    """A mute device keeps the command open. Negative, once; nothing is repeated."""
    plant.lines.fault(DEVICE, "mute")
    mark = plant.lines.mark()
    with plant.client() as client:
        client.number += 1
        oper = element(0xA2, *command(ON), CHECK)
        item = mms.element(mms.SEQUENCE, element(0xA0, mms.name(DOMAIN, f"GGIO1$CO${LAMP}$Oper")))
        write = element(mms.WRITE, element(0xA0, item), element(0xA0, oper))
        client.send(mms.tpkt(mms.data(mms.request(client.number, write))))
        plant.lines.wait_frame(lambda f: f.kind == "received" and f.unit == 5 and f.bytes[1] == 5, since=mark)
        plant.gateway.kill("rtu-modbus-1")
        tag, pdu = client.mms()
        assert tag == mms.REPORT
        client.keep(pdu)
        assert cause(client, LAMP) in (LOST, TOO_LATE)
        tag, pdu = client.mms()
        assert (tag, mms.elements(mms.elements(pdu)[1][1])) == (mms.RESPONSE, [DENIED])
        assert "executing command" not in plant.states()
        plant.lines.fault(DEVICE, "clear")
        plant.wait_all_good(CA)
        plant.gateway.wait_for(plant.is_free, 60.0, "the next process has released it")
        assert plant.coil(0) == 0
        assert act(client, "Oper", LAMP) == DONE  # the number of the request before is not answered again


@pytest.mark.slow
def test_what_the_device_has_confirmed_is_done(plant: Plant) -> None:
    """Its value is not read back before the line's process dies: the command ends all the same, at once."""
    with plant.client() as client:
        client.socket.settimeout(30.0)  # half of what an owner that says nothing is given
        assert act(client, "Oper", LAMP) == DONE
        plant.lines.fault(DEVICE, "mute")
        plant.gateway.kill("rtu-modbus-1")
        assert ended(client, LAMP) in (0, TOO_LATE)  # the read-back may have found the device mute
        assert "executing command" not in plant.states()
        plant.lines.fault(DEVICE, "clear")
        plant.gateway.wait_for(plant.is_free, 60.0, "the next process has released it")


# ---- who may, and what ----------------------------------------------------------------------------------


def test_only_a_controller_commands(plant: Plant) -> None:
    mark = plant.lines.mark()
    with plant.client("127.0.0.2") as client:
        assert act(client, "Oper", LAMP) == DENIED
        assert cause(client, LAMP) == NO_ACCESS
        assert act(client, "SBOw", BREAKER) == DENIED
        assert cause(client, BREAKER, "SBOw") == NO_ACCESS
        assert client.values((DOMAIN, f"GGIO1$ST${LAMP}$stVal"))[0][0] == 0x83
    assert plant.writes(mark) == []


def test_what_is_no_command_is_refused(plant: Plant) -> None:
    mark = plant.lines.mark()
    number = bytes.fromhex("8501ff")
    whole = [*command(ON), CHECK]
    with plant.client() as client:
        item = f"GGIO1$CO${LAMP}$Oper"
        wrong = [whole[:at] + whole[at + 1 :] for at in range(6)] + [[*whole, ON]]
        wrong += [[number, *whole[1:]], [*command(ON, who=bytes(65)), CHECK], [*command(number), CHECK]]
        for parts in wrong:
            assert client.write(DOMAIN, (item, element(0xA2, *parts))) == [MISFIT]
        assert client.write(DOMAIN, (item, ON)) == [MISFIT]
        assert client.write(DOMAIN, (f"{item}$ctlVal", ON)) == [DENIED]
        both = client.write(DOMAIN, (item, element(0xA2, *whole)), (item, element(0xA2, *whole)))
        assert both == [(0x80, b"\x09")] * 2
        assert client.information == []
        assert act(client, "Oper", LAMP, test=True) == DENIED
        assert cause(client, LAMP) == BY_MODE
        for octets in ("8705087f800000", "87050842c80000", "87050847c35000"):  # infinite, 100, 100000
            assert act(client, "Oper", LEVEL, element(0xA2, bytes.fromhex(octets))) == DENIED
            assert cause(client, LEVEL) == NOT_SUPPORTED
    assert plant.writes(mark) == []


@pytest.mark.slow
def test_a_client_has_eight_commands_at_a_time(plant: Plant) -> None:
    """Piped, to a device that says nothing: one is under way, others are refused, the ninth has no place."""
    plant.lines.fault(DEVICE, "mute")
    item = element(mms.SEQUENCE, element(0xA0, mms.name(DOMAIN, f"GGIO1$CO${LAMP}$Oper")))
    write = element(mms.WRITE, element(0xA0, item), element(0xA0, element(0xA2, *command(ON), CHECK)))
    with plant.client() as client:
        client.send(b"".join(mms.tpkt(mms.data(mms.request(i, write))) for i in range(10)))
        answers: dict[int, list[tuple[int, bytes]]] = {}
        while len(answers) < 10:
            tag, pdu = client.mms()
            if tag == mms.REPORT:
                client.keep(pdu)
                continue
            (_, number), (_, results) = mms.elements(pdu)
            answers[int.from_bytes(number, "big")] = mms.elements(results)
        assert {tuple(answer) for answer in answers.values()} <= {(DENIED,), ((0x80, b"\2"),)}
        assert cause(client, LAMP) == IN_EXECUTION


# ---- normal security ------------------------------------------------------------------------------------


@pytest.mark.slow
def test_normal_security_has_no_termination(plant: Plant) -> None:
    """The last test here: the configuration stays another."""
    changed = json.loads(plant.gateway.config_file.read_text())
    changed["iec61850"]["control_security"] = "normal"
    plant.gateway.stop()
    plant.gateway.config_file.write_text(json.dumps(changed))
    plant.gateway.start()
    plant.wait_all_good(CA)
    with plant.client() as client:
        model = (DOMAIN, f"GGIO1$CF${BREAKER}$ctlModel")
        assert client.values(model) == [(0x85, b"\2")]
        assert act(client, "Oper", LAMP) == DONE
        sbo = (DOMAIN, f"GGIO1$CO${BREAKER}$SBO")
        assert client.values(sbo) == [(0x8A, f"{DOMAIN}/GGIO1$CO${BREAKER}".encode())]
        with plant.client() as other:
            assert other.values(sbo) == [(0x8A, b"")]
            assert act(other, "Oper", BREAKER) == DENIED
            assert cause(other, BREAKER) == LOCKED
        assert act(client, "Oper", BREAKER) == DONE
        plant.gateway.wait_for(plant.is_free, 60.0, "the breaker was read back")
        assert act(client, "Oper", BREAKER) == DENIED
        assert cause(client, BREAKER) == NOT_SELECTED
        assert client.information == []
    answers = foreign(plant, BREAKER, "false", "select", "operate")
    assert answers == {"model": 2, "select": WELL, "operate": WELL, "terminations": []}
    plant.gateway.wait_for(lambda: (plant.coil(2), plant.coil(3)) == (1, 0), 60.0, "the breaker is off")
