# SPDX-License-Identifier: GPL-3.0-or-later
"""An emulated board on a pty, for the tool under test. Run as a program it is the board's power switch."""

from __future__ import annotations

import os
import re
import socket
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).parents[2]


class Emulated:
    """A QEMU whose debug UART is a pty; off until it is power-cycled.

    prefix: how a program is run where the board's network is.
    """

    def __init__(self, command: Sequence[str | Path], folder: Path) -> None:
        self._monitor = folder / "monitor"
        self.prefix: tuple[str, ...] = ()
        self.process = subprocess.Popen(
            [
                *(*command, "-S", "-display", "none", "-nodefaults", "-serial", "pty"),
                *("-monitor", f"unix:{self._monitor},server=on,wait=off"),
            ],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        found = re.search(r"/dev/pts/\d+", line)
        if not found:
            raise RuntimeError(line)
        self.port = found[0]

    @property
    def power_cycle(self) -> str:
        """The command that switches it off and on."""
        return f"{sys.executable} {__file__} {self._monitor}"

    def monitor(self, *commands: str) -> None:
        """Commands of QEMU's monitor."""
        tell_monitor(self._monitor, *commands)

    def netboot(self, *arguments: str | Path, seconds: float = 180) -> subprocess.CompletedProcess[str]:
        """The tool, on this board's port; its output is standard output and error as one sees them."""
        return subprocess.run(
            [*self.prefix, sys.executable, "-m", "nuc980.netboot", *arguments, "--port", self.port],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            text=True,
            timeout=seconds,
            env={**os.environ, "PYTHONPATH": str(ROOT / "scripts")},
        )

    def close(self) -> None:
        self.process.kill()
        self.process.communicate()


def tell_monitor(monitor: Path, *commands: str) -> None:
    """Each command when the one before it is done."""
    with socket.socket(socket.AF_UNIX) as connection:
        connection.connect(str(monitor))
        for command in (*commands, None):
            heard = b""
            while not heard.endswith(b"(qemu) "):
                heard += connection.recv(4096)
            if command:
                connection.sendall(f"{command}\n".encode())


if __name__ == "__main__":
    tell_monitor(Path(sys.argv[1]), "system_reset", "cont")
