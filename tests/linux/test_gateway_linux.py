# SPDX-License-Identifier: GPL-3.0-or-later
"""The gateway on the emulated board: simulated devices at its six lines, masters on its two networks."""

import contextlib
import dataclasses
import datetime
import json
import os
import shutil
import subprocess
import termios
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import c104
import pytest

from lab.board import (
    ETHERNET,
    PORTS,
    SILENCE_US,
    SSH_PORT,
    STATION_PORT,
    Board,
    Ssh,
    configuration,
    lines_at,
    macs_file,
    stations,
)
from lab.gateway import GatewayError, free_port
from lab.linesim import LineSim
from lab.master import Master
from lab.raw_master import RawMaster
from lab.show import DEVICE, FIGURE_5_3, STATION
from nuc980.twin.linux import Kernel, Linux
from nuc980.twin.machine import INSTRUCTION_TIME
from rig.desk import CHAPTER_5, everything_read

ROOT = Path(__file__).resolve().parents[2]
READ_SECONDS = 120.0
CONFIG = "/etc/openrtu/gateway.json"
# So that a dead link is noticed within a test: a test frame after 8 s, the end 10 s after that.
LINK_TIMES = {"t1": 10, "t2": 5, "t3": 8}
PARITIES = {"none": 0, "odd": 1, "even": 2}

ANSWERS = 60
TORN = 20  # one request of so many may be torn by a pause of a busy host
TRIES = 4
SPEEDS = (9600, 19200, 38400, 57600, 115200, 9600)
TERMIOS_SPEEDS = {getattr(termios, f"B{speed}"): speed for speed in SPEEDS}
# Of a UART: UART_LINE, with parity on and even.
UART, UART_STEP = 0xB0070000, 0x1000
LINE = 0x0C
LINE_PBE, LINE_EPE = 1 << 3, 1 << 4
# The stations of each line process; 1000 is only written.
STATIONS = {
    "rtu-modbus-1": (1010, 2020, 3035, 3067, 3155, 3201),
    "rtu-modbus-2": (4040, 5050, 5051, 6001, 6247),
}


def timed() -> dict[str, Any]:
    """The configuration with the short link times."""
    config = configuration()
    config["iec104"] |= LINK_TIMES
    return config


@dataclass(frozen=True)
class Bench:
    """The board, the devices at its lines, the addresses of its two Ethernet ports on this machine."""

    linux: Linux
    lines: LineSim
    ssh: Ssh
    board: Board
    addresses: tuple[tuple[str, int], ...]

    def start_with(self, config: dict[str, Any]) -> None:
        """The gateway anew, with another configuration; returns when every device has been read."""
        self.ssh.run("mount -o remount,rw /")
        self.ssh.run(f"cat > {CONFIG}", send=json.dumps(config))
        self.linux.run("/etc/init.d/S80rtud restart")
        self.wait_all_read()

    def wait_all_read(self) -> None:
        def read() -> bool:
            with contextlib.suppress(GatewayError):
                return everything_read(self.board)
            return False

        self.board.wait_for(read, READ_SECONDS, "every device has been read")


@pytest.fixture(scope="module")
def kernel(kernel: Kernel, folder: Path) -> Kernel:
    """With MAC addresses, as netboot gives them: QEMU's network loses a board that makes up new ones."""
    dtb = Path(shutil.copy(kernel.dtb, folder))
    (folder / "macs").write_text(macs_file())
    environment = os.environ | {"SITE_SETTINGS": str(folder)}
    subprocess.run([ROOT / "board/nuc980/place-macs.sh", dtb], env=environment, check=True)
    return dataclasses.replace(kernel, dtb=dtb)


@pytest.fixture(scope="module")
def lines(folder: Path, linesim_program: Path) -> Iterator[LineSim]:
    """Devices that speak at 9600 bit/s, whatever the gateway does: a pty has no speed of its own."""
    config = timed()
    for port in config["port"]:
        port.update(baud_rate=9600, parity=0, stop_bits=1)
    file = folder / "linesim.json"
    file.write_text(json.dumps(config))
    values, silence_us = CHAPTER_5 / "values.json", SILENCE_US
    with LineSim(file, values, folder / "dev", silence_us=silence_us, program=linesim_program) as lines:
        yield lines


@pytest.fixture(scope="module")
def station_ports() -> tuple[int, int]:
    return free_port(), free_port()


@pytest.fixture(scope="module")
def board_arguments(station_ports: tuple[int, int], ssh: Ssh) -> tuple[str | Path, ...]:
    first, second = station_ports
    return (
        *INSTRUCTION_TIME,
        *ETHERNET[0].arguments({first: STATION_PORT, ssh.port: SSH_PORT}),
        *ETHERNET[1].arguments({second: STATION_PORT}),
    )


@pytest.fixture(scope="module")
def board_chardevs(lines: LineSim) -> dict[int, str]:
    return lines_at(lines.directory)


@pytest.fixture(scope="module")
def extra_files(ssh: Ssh) -> dict[str, Path | str]:
    return {CONFIG: json.dumps(timed()), "/root/.ssh/authorized_keys": ssh.key.with_suffix(".pub")}


@pytest.fixture(scope="module")
def bench(linux: Linux, lines: LineSim, ssh: Ssh, station_ports: tuple[int, int]) -> Bench:
    addresses = tuple(("127.0.0.1", port) for port in station_ports)
    bench = Bench(linux, lines, ssh, Board(linux.machine, ssh.run, addresses[0]), addresses)
    bench.wait_all_read()
    return bench


@pytest.fixture
def master(bench: Bench) -> Iterator[Master]:
    bench.wait_all_read()
    with Master(*bench.board.address) as master:
        master.synchronise_clock(STATION)
        yield master


# ---- lines


def speed_of(line: Path) -> int:
    """What QEMU has set the line's pty to, from the registers of the UART behind it."""
    port = os.open(line, os.O_RDONLY | os.O_NOCTTY)
    try:
        return TERMIOS_SPEEDS[termios.tcgetattr(port)[5]]
    finally:
        os.close(port)


def parity_of(bench: Bench, uart: int) -> str:
    """A pty has none: what the chip's UART has."""
    register = bench.linux.machine.read(UART + uart * UART_STEP + LINE)
    return "none" if not register & LINE_PBE else "even" if register & LINE_EPE else "odd"


def torn_ports(bench: Bench) -> list[str]:
    """Those whose devices did not understand too many of the requests, of ANSWERS that each answered."""
    before = bench.lines.stats()

    def asked_on() -> bool:
        now = bench.lines.stats()
        return all(now[port]["answers"] >= before[port]["answers"] + ANSWERS for port in before)

    bench.board.wait_for(asked_on, READ_SECONDS, "all lines are asked on and on")
    after = bench.lines.stats()

    def grown(port: str, counter: str) -> int:
        return int(after[port][counter] - before[port][counter])

    return [port for port in after if grown(port, "crc_errors") > grown(port, "requests") // TORN]


@pytest.mark.parametrize("turn", range(3))
def test_six_lines_at_all_speeds_with_parity(bench: Bench, turn: int) -> None:
    """Each line with each parity and at three of the speeds, in turn."""
    config = timed()
    wanted = {}
    for at, (uart, port) in enumerate(zip(PORTS, config["port"], strict=True)):
        speed, parity = SPEEDS[(at + 2 * turn) % len(SPEEDS)], tuple(PARITIES)[(at + turn) % len(PARITIES)]
        wanted[uart] = (speed, parity)
        port.update(baud_rate=speed, parity=PARITIES[parity], stop_bits=1)
    bench.start_with(config)
    found = {uart: (speed_of(bench.lines.line(f"ttyS{uart}")), parity_of(bench, uart)) for uart in PORTS}
    assert found == wanted
    # A busy host tears frames here and there; a port that is not as it should be does so each time.
    torn = set(bench.lines.stats())
    for _ in range(TRIES):
        torn.intersection_update(torn_ports(bench) if torn else ())
    assert torn == set()


def test_the_first_configuration_again(bench: Bench) -> None:
    bench.start_with(timed())


# ---- from outside


def test_both_ethernets_lead_to_the_station(bench: Bench) -> None:
    seen = []
    for address in bench.addresses:
        with Master(*address) as master:
            reports = [report for ca in stations() for report in master.interrogate(ca)]
            seen.append({(report.ca, report.ioa): report.value for report in reports})
    assert len(seen[0]) > 50
    assert seen[0] == seen[1]


def test_interrogation_has_what_the_devices_have(master: Master) -> None:
    reports = master.interrogate(STATION)
    assert {report.ioa: int(report.value) for report in reports} == FIGURE_5_3
    assert all(report.good for report in reports)


HOLDING = "holding_registers"
COMMANDS = {
    "coil 4 of 3.67": (STATION, 4, "C_SC_NA_1", c104.SingleCmd(on=True), ("coils", 3, 1)),
    "register 3 of 3.67": (
        STATION,
        40003,
        "C_SE_NB_1",
        c104.ScaledCmd(c104.Int16(255)),
        ("holding_registers", 2, 255),
    ),
}


@pytest.mark.parametrize("name", COMMANDS)
def test_command_reaches_the_device(bench: Bench, master: Master, name: str) -> None:
    ca, ioa, kind, info, (table, address, value) = COMMANDS[name]
    device = f"{ca // 1000}.{ca % 1000}"
    assert bench.lines.get(device, table, address) != value
    assert master.command(ca, ioa, kind, info)
    assert bench.lines.get(device, table, address) == value


def test_command_that_the_device_refuses_is_negative(bench: Bench, master: Master) -> None:
    before = bench.lines.get(DEVICE, "holding_registers", 0)
    bench.lines.fault(DEVICE, "exception", 4, 6)
    assert not master.command(STATION, 40001, "C_SE_NB_1", c104.ScaledCmd(c104.Int16(before + 1)))
    bench.lines.fault(DEVICE, "clear")
    assert bench.lines.get(DEVICE, "holding_registers", 0) == before


def test_change_arrives_with_its_time(bench: Bench, master: Master) -> None:
    since, before = master.mark(), datetime.datetime.now(datetime.UTC)
    bench.lines.set(DEVICE, "input_registers", 0, 1511)
    report = master.wait(lambda r: (r.ca, r.ioa, r.value) == (STATION, 30001, 1511), since)
    assert report.cause == "SPONTANEOUS"
    assert report.recorded_at is not None
    assert abs(report.recorded_at - before) < datetime.timedelta(seconds=5)


# ---- what fails, and comes back


def invalid_since(master: Master, since: int) -> set[int]:
    """The stations that have sent an invalid object."""
    return {report.ca for report in master.reports_since(since) if "Invalid" in report.quality}


def test_silent_device_turns_invalid_and_no_other(bench: Bench, master: Master) -> None:
    since = master.mark()
    bench.lines.fault(DEVICE, "mute")
    for ioa in FIGURE_5_3:
        master.wait(
            lambda r, i=ioa: r.ca == STATION and r.ioa == i and "Invalid" in r.quality, since, READ_SECONDS
        )
    assert invalid_since(master, since) == {STATION}
    since = master.mark()
    bench.lines.fault(DEVICE, "clear")
    for ioa in FIGURE_5_3:
        master.wait(lambda r, i=ioa: r.ca == STATION and r.ioa == i and r.good, since, READ_SECONDS)


@pytest.mark.parametrize("name", ["rtu-modbus-1", "rtu-modbus-2"])
def test_killed_lines_turn_invalid_and_come_back(bench: Bench, master: Master, name: str) -> None:
    """The master stays connected, and points of the other process stay good."""
    before = bench.board.modules()[name]
    others = {ca for other, stations in STATIONS.items() if other != name for ca in stations}
    since = master.mark()
    bench.board.kill(name)
    for ca in STATIONS[name]:
        master.wait(lambda r, c=ca: r.ca == c and "Invalid" in r.quality, since, READ_SECONDS)
    for ca in STATIONS[name]:
        master.wait(lambda r, c=ca: r.ca == c and r.good and r.cause == "SPONTANEOUS", since, READ_SECONDS)
    assert not invalid_since(master, since) & others
    bench.wait_all_read()
    after = bench.board.modules()[name]
    assert (after["restarts"], after["pid"] != before["pid"]) == (before["restarts"] + 1, True)
    assert master.connection.is_connected


def test_killed_station_is_there_again(bench: Bench, master: Master) -> None:
    before = bench.board.modules()["rtu-iec104"]
    bench.board.kill("rtu-iec104")

    def restarted() -> bool:
        module = bench.board.modules()["rtu-iec104"]
        return module["state"] == "running" and module["pid"] not in (0, before["pid"])

    bench.board.wait_for(restarted, READ_SECONDS, "rtu-iec104 runs again")
    with RawMaster(*bench.board.address) as other:
        assert len(other.interrogate(STATION).objects) == len(FIGURE_5_3)


def test_killed_rtud_takes_all_with_it_and_all_come_back(bench: Bench) -> None:
    before = {name: module["pid"] for name, module in bench.board.modules().items() if module["pid"]}
    bench.linux.run("kill -9 $(pidof rtud)")

    def anew() -> bool:
        with contextlib.suppress(GatewayError):
            modules = bench.board.modules()
            return all(modules[name]["pid"] not in (0, pid) for name, pid in before.items())
        return False

    bench.board.wait_for(anew, READ_SECONDS, "rtud and its modules run again")
    bench.wait_all_read()
    running = bench.linux.run("pidof rtud rtu-iec104 rtu-modbus").split()
    assert len(running) == len(before), "a module of the rtud before is left"


def test_dead_link_ends_the_connection_and_no_more(bench: Bench) -> None:
    """The cable is pulled: the station gives the connection up after t3 + t1; later all is as before."""
    machine = bench.linux.machine
    connected = "grep -c ':0964 [0-9A-F:]* 01 ' /proc/net/tcp || true"  # established, at our port 2404
    with Master(*bench.board.address) as master:
        master.interrogate(STATION)
        assert bench.linux.run(connected) != "0"
        machine.command("set_link", name=ETHERNET[0].name, up=False)
        bench.board.wait_for(
            lambda: bench.linux.run(connected) == "0", READ_SECONDS, "the station has given the connection up"
        )
    machine.command("set_link", name=ETHERNET[0].name, up=True)
    bench.board.wait_for(
        lambda: bench.linux.run("cat /sys/class/net/eth0/carrier") == "1", READ_SECONDS, "the link is back"
    )
    with Master(*bench.board.address) as master:
        assert len(master.interrogate(STATION)) == len(FIGURE_5_3)


def test_reboot_ends_in_the_same_state(bench: Bench) -> None:
    bench.linux.machine.events("RESET")
    bench.linux.type("reboot\n<run 0>\n")
    bench.linux.wait_for_shell()
    bench.ssh.close()
    assert [event["guest"] for event in bench.linux.machine.events("RESET")] == [True]
    bench.wait_all_read()
    with Master(*bench.board.address) as master:
        reports = [report for ca in stations() for report in master.interrogate(ca)]
    assert [report for report in reports if "Invalid" in report.quality] == []
    assert {module["restarts"] for module in bench.board.modules().values()} == {0}
