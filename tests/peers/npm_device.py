# SPDX-License-Identifier: GPL-3.0-or-later
"""Servers of npm's packages, modbus-serial and jsmodbus, each in a process of Node."""

import json
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from peers.device import FIRST_ADDRESS, UNIT, Device
from rig.configuration import ROOT

PROGRAM = Path(__file__).parent / "npm" / "device.cjs"
PACKAGES = ROOT / "build" / "modbus-peers"  # make test-lines installs them


class NpmDevice(Device):
    maker = "modbus-serial"

    def start(self) -> None:
        words = [PACKAGES, self.maker, self.place, FIRST_ADDRESS, UNIT]
        self._process = subprocess.Popen(
            ["node", PROGRAM, *map(str, words)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self._known: list[bytes] = []
        assert self._answer() == "listening"

    def stop(self) -> None:
        self._process.kill()
        self._process.communicate()

    @property
    def requests(self) -> list[bytes]:
        self._known += map(bytes.fromhex, self._ask("requests", len(self._known)))
        return self._known

    @requests.setter
    def requests(self, _: list[bytes]) -> None:
        """It keeps them itself."""

    def get(self, table: str, address: int, count: int) -> list[int]:
        values: list[int] = self._ask("get", table, address, count)
        return values

    def set(self, table: str, address: int, values: Sequence[int]) -> None:
        self._ask("set", table, address, list(values))

    def _ask(self, *words: Any) -> Any:
        assert self._process.stdin
        self._process.stdin.write(json.dumps(words) + "\n")
        self._process.stdin.flush()
        return self._answer()

    def _answer(self) -> Any:
        assert self._process.stdout
        line = self._process.stdout.readline()
        if not line:
            raise OSError(f"{self.maker} has ended")
        return json.loads(line)


class JsmodbusDevice(NpmDevice):
    """It has all addresses, says nothing to a function that it does not know, and knows no unit."""

    maker = "jsmodbus"

    def set_register(self, address: int, value: int) -> None:
        """Holding registers and input registers are the same."""
        self._ask("register", address, value)
