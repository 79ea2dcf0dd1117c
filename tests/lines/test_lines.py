# SPDX-License-Identifier: GPL-3.0-or-later
"""Serial ports that fail, as the whole gateway sees them: one line goes wrong, the others do not notice."""

import contextlib
import json
import os
import select
import termios
import threading
import time
import tty
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import c104
import pytest

from lab.gateway import Gateway, free_port, listening_on, remove, run_directory
from lab.linesim import LineSim
from lab.master import Master
from rig.capture import recorded
from rig.desk import CHAPTER_5, chapter_5, of_port

pytestmark = pytest.mark.slow  # as a whole

WILD = "ttyS9"  # port 6, which linesim does not serve here
WILD_POINT = "wild.register"
WILD_UNIT = 9
BROADCAST_CA, NEIGHBOUR = 6000, 3067
READ_HOLDING_REGISTERS = 3
REQUEST_LENGTH = 8
NOTICE_S = 0.5  # a lost port is noticed within
BABBLE_S = 3.0  # a line that is never silent is given up within
REOPEN_S = 15.0  # a port is tried again after 10 s at most, and then has to answer
FLOOD_S = 3.0
FRESH_S = FLOOD_S / 2  # a neighbour that the flood holds up is older


def sealed(frame: bytes) -> bytes:
    """MODBUS over Serial Line, 6.2.2."""
    crc = 0xFFFF
    for octet in frame:
        crc ^= octet
        for _ in range(8):
            crc = (crc >> 1) ^ (0xA001 if crc & 1 else 0)
    return frame + crc.to_bytes(2, "little")


class WildPort:
    """The other side of port 6 in the test's hands: one device, which gives zeros for holding registers."""

    def __init__(self, folder: Path) -> None:
        self._link = folder / WILD
        self._master = -1
        self._thread: threading.Thread | None = None
        self._gone = threading.Event()
        self.flooding = False

    def plug(self) -> None:
        self._master, slave = os.openpty()
        tty.setraw(slave)
        device = Path(os.ttyname(slave))
        device.chmod(0o666)
        os.set_blocking(self._master, False)
        self._gone.clear()
        self._thread = threading.Thread(target=self._serve, args=(slave,))
        self._thread.start()
        self._link.symlink_to(device)

    def unplug(self) -> None:
        """The gateway's side of the pseudo-terminal hangs up. Its number may be another process's next."""
        self._link.unlink(missing_ok=True)
        self._gone.set()
        if self._thread is not None:
            self._thread.join()
        self._thread = None

    def _serve(self, slave: int) -> None:
        while not self._gone.is_set():
            with contextlib.suppress(BlockingIOError):
                if self.flooding:
                    os.write(self._master, bytes(4096))
                elif select.select([self._master], [], [], 0.02)[0]:
                    self._answer(os.read(self._master, 256))
        os.close(slave)
        os.close(self._master)

    def _answer(self, request: bytes) -> None:
        if len(request) == REQUEST_LENGTH and request[:2] == bytes([WILD_UNIT, READ_HOLDING_REGISTERS]):
            size = 2 * request[5]
            os.write(self._master, sealed(request[:2] + bytes([size]) + bytes(size)))

    @contextlib.contextmanager
    def stuck(self) -> Iterator[None]:
        """As if the other side had stopped the flow: the port takes no byte."""
        port = os.open(self._link, os.O_RDWR | os.O_NOCTTY)
        try:
            termios.tcflow(port, termios.TCOOFF)
            yield
        finally:
            termios.tcflow(port, termios.TCOON)
            os.close(port)


@dataclass
class Lines:
    gateway: Gateway
    master: Master
    wild: WildPort

    def wait_quality(self, quality: str, timeout_s: float) -> None:
        self.gateway.wait_for(
            lambda: self.gateway.points(WILD_POINT)[WILD_POINT]["quality"] == quality,
            timeout_s,
            f"{WILD_POINT} is {quality}",
        )

    def neighbours(self) -> list[dict[str, Any]]:
        return [point for point in self.gateway.points().values() if point["ca"] == NEIGHBOUR]

    def assert_neighbours_are_fresh(self) -> None:
        assert {point["quality"] for point in self.neighbours()} == {"good"}
        assert max(point["age_s"] for point in self.neighbours()) < FRESH_S


def configuration() -> dict[str, Any]:
    """Chapter 5, all lines in one process; behind port 6 are the wild device and a broadcast address."""
    config = listening_on(chapter_5(), free_port())
    for port in config["port"]:
        port.pop("process", None)
    register = {"address": 0, "name": WILD_POINT}
    wild = {"id": WILD_UNIT, "response_timeout_ms": 300, "holding_registers": [register]}
    of_port(config, 6).update(
        device=WILD, slaves=[{"id": 0, "coils": [{"address": 0, "name": "wild.lamps"}]}, wild]
    )
    return config


@pytest.fixture(scope="module")
def lines(programs: Path) -> Iterator[Lines]:
    config, directory = configuration(), run_directory()
    with contextlib.ExitStack() as stack:
        stack.callback(remove, directory)
        simulated = {**config, "port": [port for port in config["port"] if port["value"] != 6]}
        file = directory / "linesim.json"
        file.write_text(json.dumps(simulated))
        values = json.loads((CHAPTER_5 / "values.json").read_text())
        known = directory / "values.json"
        known.write_text(json.dumps({name: v for name, v in values.items() if not name.startswith("6.")}))
        stack.enter_context(LineSim(file, known, directory / "dev"))
        wild = WildPort(directory / "dev")
        wild.plug()
        stack.callback(wild.unplug)
        gateway = stack.enter_context(Gateway(config, directory, programs))
        stack.enter_context(recorded(gateway))
        master = stack.enter_context(Master(*gateway.address))
        lines = Lines(gateway, master, wild)
        gateway.wait_for(
            lambda: {point["quality"] for point in lines.neighbours()} == {"good"}, 60.0, "port 3 was read"
        )
        lines.wait_quality("good", REOPEN_S)
        yield lines


def test_port_that_goes_away_and_comes_back(lines: Lines) -> None:
    for _ in range(3):
        lines.wild.unplug()
        lines.wait_quality("invalid", NOTICE_S)
        lines.assert_neighbours_are_fresh()
        lines.wild.plug()
        lines.wait_quality("good", REOPEN_S)


def test_flooded_port_is_given_up_and_delays_nobody(lines: Lines) -> None:
    lines.wild.flooding = True
    try:
        lines.wait_quality("invalid", BABBLE_S)
        begin = time.monotonic()
        while time.monotonic() - begin < FLOOD_S:
            lines.assert_neighbours_are_fresh()
    finally:
        lines.wild.flooding = False
    lines.wait_quality("good", REOPEN_S)


def test_broadcast_that_the_port_does_not_take_is_not_confirmed(lines: Lines) -> None:
    assert lines.master.command(BROADCAST_CA, 1, "C_SC_NA_1", c104.SingleCmd(on=True))
    with lines.wild.stuck():
        lines.wait_quality("invalid", REOPEN_S)
        assert not lines.master.command(BROADCAST_CA, 1, "C_SC_NA_1", c104.SingleCmd(on=True))
        lines.assert_neighbours_are_fresh()
    lines.wait_quality("good", REOPEN_S)
    assert lines.master.command(BROADCAST_CA, 1, "C_SC_NA_1", c104.SingleCmd(on=True))


def test_pseudo_terminal_that_carries_no_parity_is_told_once(lines: Lines) -> None:
    lines.wild.unplug()
    lines.wait_quality("invalid", NOTICE_S)
    lines.wild.plug()
    lines.wait_quality("good", REOPEN_S)
    log = [json.loads(line)["text"] for line in lines.gateway.ctl("--json", "log").splitlines()]
    assert sum("is open" in text and "port 6" in text for text in log) > 1
    told = [text for text in log if "carries no parity" in text]
    assert len(told) == 1
    assert told[0].startswith("port 6: ")
