# SPDX-License-Identifier: GPL-3.0-or-later
"""A serial line to a board: bytes out and in, each with its time in the log."""

from __future__ import annotations

import time
from pathlib import Path
from types import TracebackType
from typing import Self

import serial

from nuc980.netboot.errors import LineLost, UnusableInput

# UART0 of the board, docs/netboot.md
BAUD = 115200


class Line:
    """A serial port, by its device or a URL of pyserial's: socket://HOST:PORT, rfc2217://HOST:PORT.

    log: a file that gets every byte, as lines `SECONDS < 'text'` (from the board), `SECONDS > 'text'` (to it).
    """

    def __init__(self, url: str, baud: int = BAUD, log: Path | None = None) -> None:
        self.url = url
        self._start = time.monotonic()
        try:
            self._log = log.open("w", encoding="ascii") if log else None
        except OSError as error:
            raise UnusableInput(f"{log}: {error.strerror}") from error
        try:
            self._port = serial.serial_for_url(url, baud, timeout=0, **_only_ours(url))
        except (serial.SerialException, ValueError) as error:
            raise UnusableInput(
                f"the serial port {url} cannot be opened: {error}",
                cause="another name, no permission (group dialout), or another program has it open",
                next_step="look at /dev/serial/by-id for the ports there are",
            ) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def baud(self) -> int:
        """Speed in bit/s."""
        return self._port.baudrate

    @baud.setter
    def baud(self, speed: int) -> None:
        self._port.baudrate = speed

    def write(self, data: bytes) -> None:
        """Sends bytes. Raises LineLost."""
        self._keep(">", data)
        try:
            self._port.write(data)
            self._port.flush()
        except (serial.SerialException, OSError) as error:
            raise LineLost(f"{self.url}: {error}") from error

    def read(self, seconds: float) -> bytes:
        """What comes within the time, at once when something does; b"" when nothing does. Raises LineLost."""
        try:
            self._port.timeout = max(seconds, 0)
            data = self._port.read(1)
            if data:
                self._port.timeout = 0
                data += self._port.read(4096)
        except (serial.SerialException, OSError) as error:
            raise LineLost(f"{self.url}: {error}") from error
        if data:
            self._keep("<", data)
        return data

    def close(self) -> None:
        """Closes the port and the log."""
        self._port.close()
        if self._log:
            self._log.close()

    def _keep(self, direction: str, data: bytes) -> None:
        if self._log:
            text = ascii(data.decode("latin-1"))
            self._log.write(f"{time.monotonic() - self._start:10.4f} {direction} {text}\n")
            self._log.flush()


def _only_ours(url: str) -> dict[str, bool]:
    """A device is locked against other programs; a network port has no lock."""
    return {} if "://" in url else {"exclusive": True}
