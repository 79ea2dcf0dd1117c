# SPDX-License-Identifier: GPL-3.0-or-later
"""A serial line to a board: bytes out and in, each with its time in the log."""

from __future__ import annotations

import errno
import os
import socket
import termios
import time
from collections.abc import Callable
from contextlib import suppress
from datetime import datetime
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Self, TextIO
from urllib.parse import urlsplit

import serial
from serial.tools import list_ports

from nuc980.netboot.errors import (
    LineLost,
    NoSuchUrl,
    NotAPort,
    PortBusy,
    PortForbidden,
    PortMissing,
    PortUnreachable,
    SpeedRefused,
    UnusableInput,
)
from nuc980.ports import holders_of, how_to_be_allowed, is_pty

# UART0 of the board, docs/netboot.md
BAUD = 115200

# A read looks this often whether its time is over: to give pyserial another time-out is slow, since it sets
# the whole port up again (with a round trip or two for rfc2217://).
POLL_SECONDS = 0.02
WRITE_SECONDS = 5.0
VEIL_SECONDS = 1.0  # an echo comes whole within
READ_MOST = 4096

SCHEMES = ("socket", "rfc2217")

BROKEN = (serial.SerialException, OSError, termios.error)


class Line:
    """A serial port, by its device or a URL of pyserial's: socket://HOST:PORT, rfc2217://HOST:PORT.

    baud: bit/s, 8N1; a port behind socket:// has its own. log: a file that gets every byte, as lines
    `SECONDS < 'text'` (from the board), `SECONDS > 'text'` (to it), `SECONDS = note`; each is in the file at
    once, also when this program is killed.
    DTR and RTS are raised and stay so when the port is closed: the second opening makes no edge that an
    adapter could pass on as a reset. (At the first one the kernel raises both, whoever opens the port.)
    """

    def __init__(self, url: str, baud: int = BAUD, log: Path | None = None) -> None:
        self.url = url
        self._start = time.monotonic()
        self._log = _opened(log) if log else None
        self._log_error: OSError | None = None
        self._veil: Veil | None = None
        try:
            self._port = _port(url, baud)
        except BaseException:
            self._close_log()
            raise
        self._pty = is_pty(url)
        self._socket: socket.socket | None = getattr(self._port, "_socket", None)
        if self._socket:
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._note(f"{datetime.now().astimezone().isoformat(timespec='seconds')} {url} {baud} bit/s")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
        if self._log_error and not error:
            name, why = self._log_error.filename, self._log_error.strerror
            raise UnusableInput(f"{name}: {why}; the log ends early, everything else was done")

    def now(self) -> float:
        """Seconds since the line was opened, as in the log."""
        return time.monotonic() - self._start

    @property
    def baud(self) -> int:
        """Speed in bit/s. To set it raises SpeedRefused, LineLost."""
        return self._port.baudrate

    @baud.setter
    def baud(self, speed: int) -> None:
        before = self._port.baudrate
        self._note(f"{speed} bit/s")
        try:
            self._port.baudrate = _possible(speed)
        except (ValueError, *BROKEN) as error:
            with suppress(ValueError, *BROKEN):
                self._port.baudrate = before
            raise SpeedRefused(f"{self.url} does not run at {speed} bit/s: {error}") from error

    @property
    def has_speed(self) -> bool:
        """Whether `baud` means anything: behind socket:// it is set elsewhere, and a pty has none."""
        return not self._pty and not self.url.startswith("socket://")

    def write(self, data: bytes, *, secret: bool = False) -> None:
        """Sends bytes. Raises LineLost.

        secret: the log does not get them, and nobody gets their echo, until reveal().
        """
        if secret:
            self._veil = Veil(data.rstrip(b"\r"))
            self._note("(a secret)", ">")
        else:
            self._keep(">", data)
        try:
            self._port.write(data)
        except BROKEN as error:
            raise LineLost(f"{self.url}: {error}") from error

    def read(self, seconds: float) -> bytes:
        """What comes within the time, at once when something does; b"" when nothing does. Raises LineLost."""
        deadline = time.monotonic() + seconds
        data = b""
        try:
            while not data and (self._port.in_waiting or time.monotonic() < deadline):
                data = self._port.read(1)
            while len(data) < READ_MOST and (waiting := data and self._port.in_waiting):
                data += self._port.read(min(waiting, READ_MOST - len(data)))
        except BROKEN as error:
            raise LineLost(f"{self.url}: {error}") from error
        if data:
            self._acknowledge()
        if self._veil:
            data = self._veil.over(data, self.now())
        if data:
            self._keep("<", data)
        return data

    def reveal(self) -> None:
        """No echo of a secret is to come any more."""
        self._veil = None

    def shared_with(self) -> list[str]:
        """The other programs that have the device open, as far as this user may know: `name (pid)`."""
        return holders_of(self.url)

    def other_readers(self) -> str:
        """What is to be said of those, or an empty text: no lock keeps a program out that asks for none."""
        others = ", ".join(self.shared_with())
        return others and f"the port is open in {others} too, which may take what the board says"

    def close(self) -> None:
        """Closes the port and the log."""
        self._port.close()
        self._close_log()

    def _acknowledge(self) -> None:
        """At once: many serial servers send byte by byte, and hold the next one until then (Nagle)."""
        if self._socket:
            with suppress(OSError):
                self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_QUICKACK, 1)

    def _keep(self, direction: str, data: bytes) -> None:
        self._note(ascii(data.decode("latin-1")), direction)

    def _note(self, text: str, sign: str = "=") -> None:
        if self._log and not self._log_error:
            try:
                self._log.write(f"{self.now():10.4f} {sign} {text}\n")
            except OSError as error:  # a full disk must not end a work on the board
                error.filename = self._log.name
                self._log_error = error

    def _close_log(self) -> None:
        if self._log:
            with suppress(OSError):
                self._log.close()


class Veil:
    """Makes asterisks of a secret's echo. What could be its beginning waits for what comes next."""

    def __init__(self, secret: bytes) -> None:
        self._secret = secret
        self._held = b""
        self._since = 0.0

    def over(self, data: bytes, now: float) -> bytes:
        """What may be seen of what came, and of what came before."""
        data = (self._held + data).replace(self._secret, b"*" * len(self._secret))
        if len(data) > len(self._held):
            self._since = now
        sizes = range(min(len(self._secret) - 1, len(data)), 0, -1)
        held = next((size for size in sizes if self._secret.startswith(data[-size:])), 0)
        if now - self._since >= VEIL_SECONDS:
            held = 0
        self._held = data[len(data) - held :]
        return data[: len(data) - held]


def _opened(log: Path) -> TextIO:
    try:
        return log.open("w", encoding="ascii", errors="backslashreplace", buffering=1)
    except OSError as error:
        raise UnusableInput(f"{log}: {error.strerror}") from error


def _possible(speed: int) -> int:
    """0 would hang up."""
    if speed <= 0:
        raise ValueError(f"{speed} is not a speed")
    return speed


def _port(url: str, baud: int) -> serial.SerialBase:
    device = "://" not in url
    if not device:
        _check_url(url)
    try:
        _possible(baud)
        if device:
            port = serial.Serial(url, baud, timeout=POLL_SECONDS, write_timeout=WRITE_SECONDS, exclusive=True)
            _keep_dtr_when_closed(port.fileno())
        else:
            port = serial.serial_for_url(url, baud, timeout=POLL_SECONDS)
    except ValueError as error:
        raise SpeedRefused(f"The serial port {url} cannot be opened: {error}") from error
    except BROKEN as error:
        why = _why_no_device(url, error) if device else PortUnreachable
        reason = os.strerror(error.errno) if isinstance(error, OSError) and error.errno else error
        raise why(f"The serial port {url} cannot be opened: {reason}") from error
    return port


def _check_url(url: str) -> None:
    """Raises NoSuchUrl."""
    try:
        found = urlsplit(url)
        whole = found.scheme in SCHEMES and found.hostname and found.port
    except ValueError as error:
        raise NoSuchUrl(f"--port {url}: {error}") from error
    if not whole:
        raise NoSuchUrl(f"--port {url} names no port.")


def _keep_dtr_when_closed(port: int) -> None:
    settings = termios.tcgetattr(port)
    settings[2] &= ~termios.HUPCL
    with suppress(termios.error):  # a pty, where this changes nothing, which glibc calls an error
        termios.tcsetattr(port, termios.TCSANOW, settings)


def _why_no_device(device: str, error: Exception) -> Callable[[str], UnusableInput]:
    match getattr(error, "errno", None):
        case errno.ENOENT | errno.ENODEV | errno.ENXIO:
            return partial(PortMissing, next_step=_ports_there())
        case errno.EACCES | errno.EPERM:
            return partial(PortForbidden, next_step=how_to_be_allowed(device))
        case errno.EAGAIN | errno.EBUSY:
            holders = ", ".join(holders_of(device))
            return partial(PortBusy, cause=holders and f"it is open in {holders}")
        case _:
            return NotAPort


def _ports_there() -> str:
    ports = ", ".join(sorted(port.device for port in list_ports.comports()))
    return f"name one that is there: {ports}" if ports else "plug the adapter in: no serial port is there"
