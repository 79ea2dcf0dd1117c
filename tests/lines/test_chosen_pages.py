# SPDX-License-Identifier: GPL-3.0-or-later
"""What a register of another make's device chooses, pymodbus', is read behind that choice."""

import contextlib
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from pymodbus.pdu import ModbusPDU

from lab.gateway import Gateway, free_port, listening_on, remove, run_directory
from peers.device import UNIT, powered
from peers.pymodbus_device import PymodbusDevice
from rig.configuration import VALIDATOR
from rig.desk import patience

WAIT_S = 60.0
CHOICE, FIRST, PLAIN = 900, 100, 50
CHANNELS = {1: [11, 12], 2: [21, 22], 7: [71, 72]}
WRITE, READ = 6, 3


class PagedDevice(PymodbusDevice):
    """A meter of several channels, of which one at a time is at its addresses."""

    def _trace(self, sending: bool, pdu: ModbusPDU) -> ModbusPDU:
        if sending and pdu.function_code == WRITE:
            words = CHANNELS[int.from_bytes(self.requests[-1][3:5])]
            coroutine = self._server.async_setValues(UNIT, READ, FIRST, words)
            with contextlib.suppress(StopIteration):
                coroutine.send(None)
        return super()._trace(sending, pdu)


def configuration(port: int) -> dict[str, Any]:
    objects: list[dict[str, Any]] = [{"address": PLAIN, "name": "plain"}]
    for page in CHANNELS:
        for place in range(2):
            ioa = 1000 * page + place
            objects.append(
                {"address": FIRST + place, "page": page, "ioa": ioa, "name": f"channel{page}.{place}"}
            )
    slave = {"id": UNIT, "page_address": CHOICE, **patience(), "holding_registers": objects}
    return {"port": [{"value": 7, "active": 1, "host": "127.0.0.1", "tcp_port": port, "slaves": [slave]}]}


@dataclass
class Bench:
    device: PagedDevice
    gateway: Gateway


@pytest.fixture(scope="module")
def bench(programs: Path) -> Iterator[Bench]:
    directory = run_directory()
    (directory / "dev").mkdir()
    port = free_port()
    assert [error.message for error in VALIDATOR.iter_errors(configuration(port))] == []
    with contextlib.ExitStack() as stack:
        stack.callback(remove, directory)
        device = stack.enter_context(powered(PagedDevice(port)))
        config = listening_on(configuration(port), free_port())
        gateway = stack.enter_context(Gateway(config, directory, programs))
        gateway.wait_for(
            lambda: all(point["quality"] == "good" for point in gateway.points("*").values()), WAIT_S, "read"
        )
        yield Bench(device, gateway)


def test_each_channel_has_its_own_values(bench: Bench) -> None:
    found = {name: point["value"] for name, point in bench.gateway.points("channel*").items()}
    assert found == {
        f"channel{page}.{place}": value
        for page, values in CHANNELS.items()
        for place, value in enumerate(values)
    }


def test_a_read_of_a_page_follows_its_choice(bench: Bench) -> None:
    asked = list(bench.device.requests)
    of_pages = [i for i, pdu in enumerate(asked) if pdu[:3] == bytes([READ]) + FIRST.to_bytes(2)]
    assert of_pages
    for i in of_pages[1:]:
        assert asked[i - 1][:3] == bytes([WRITE]) + CHOICE.to_bytes(2)
        assert asked[i][3:5] == (2).to_bytes(2)  # both objects of it


def test_the_log_and_the_plan_tell_the_write(bench: Bench, programs: Path) -> None:
    assert f"register {CHOICE} is written before each read of its 3 pages" in bench.gateway.ctl("log")
    command = [programs / "rtud/rtud", "--plan", bench.gateway.config_file]
    plan = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert f"behind a write of 7 to register {CHOICE}" in plan


def test_a_reload_takes_another_register_of_the_choice(bench: Bench) -> None:
    """The line's process wrote the former one before: it is exchanged."""
    config = bench.gateway.configuration()
    config["port"][0]["slaves"][0]["page_address"] = CHOICE + 1
    said = bench.gateway.ctl("reload", "--dry-run", bench.gateway.put(config))
    assert "rtu-modbus-1 gets a new process" in said
