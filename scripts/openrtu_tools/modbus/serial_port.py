# SPDX-License-Identifier: GPL-3.0-or-later
"""A serial port of this machine, for us alone."""

from __future__ import annotations

import errno
import fcntl
import os
import termios
from contextlib import suppress
from dataclasses import dataclass

from nuc980.ports import holders_of, how_to_be_allowed, is_pty
from openrtu_tools.modbus.errors import PortHeld, PortUnusable

PARITIES = {"none": 0, "odd": 1, "even": 2}  # by their words, the numbers of the key `parity`
SPEEDS = {
    int(name[1:]): getattr(termios, name) for name in dir(termios) if name[0] == "B" and name[1:].isdigit()
}
CHECKED = termios.CSIZE | termios.PARENB | termios.PARODD | termios.CSTOPB
DATA_BITS = 8
OF_THE_GATEWAY = "rtu-modbus"


@dataclass(frozen=True)
class Settings:
    baud: int
    parity: str
    stop_bits: int
    data_bits: int = DATA_BITS

    def __str__(self) -> str:
        return f"{self.baud} bit/s {self.data_bits}{self.parity[0].upper()}{self.stop_bits}"

    @property
    def character_s(self) -> float:
        return (1 + self.data_bits + (self.parity != "none") + self.stop_bits) / self.baud


def opened(device: str, settings: Settings) -> int:
    """Its descriptor: locked as the gateway locks its lines, raw, with these settings."""
    try:
        port = os.open(device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError as error:
        raise _why(device, error) from error
    try:
        _seize(device, port)
        configure(device, port, settings)
    except BaseException:
        os.close(port)
        raise
    return port


def configure(device: str, port: int, settings: Settings) -> None:
    """May be done again, with other settings; forgets what has come."""
    pty = is_pty(device)
    flags = termios.CREAD | termios.CLOCAL
    flags |= termios.CS7 if settings.data_bits == 7 and not pty else termios.CS8
    if settings.parity != "none" and not pty:  # which has none to carry
        flags |= termios.PARENB | (termios.PARODD if settings.parity == "odd" else 0)
    if settings.stop_bits == 2 and not pty:
        flags |= termios.CSTOPB
    speed = SPEEDS[settings.baud]
    try:
        controls = termios.tcgetattr(port)[6]
        wanted = [termios.IGNBRK | termios.INPCK, 0, flags, 0, speed, speed, controls]
        termios.tcsetattr(port, termios.TCSANOW, wanted)
        got = termios.tcgetattr(port)
        termios.tcflush(port, termios.TCIOFLUSH)
    except termios.error as error:
        raise PortUnusable(
            f"{device} is no serial port, or does not take {settings}: {error.args[-1]}"
        ) from error
    if (got[2] ^ flags) & CHECKED or got[4:6] != [speed, speed]:
        raise PortUnusable(f"{device} does not take {settings}", next_step="give another speed or parity")


def _seize(device: str, port: int) -> None:
    try:
        fcntl.flock(port, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        raise held(device) from error
    if not is_pty(device):  # on one, it would outlive us
        with suppress(OSError):
            fcntl.ioctl(port, termios.TIOCEXCL)


def held(device: str) -> PortHeld:
    holders = holders_of(device)
    if any(holder.startswith(OF_THE_GATEWAY) for holder in holders):
        return PortHeld(
            f"{device} is a line of the gateway: {', '.join(holders)} has locked it",
            next_step='ask the gateway (rtuctl show), or HOST:PORT of the "pass_through" of its port, '
            'or free the line: "active": 0 at its port, and reload',
        )
    whose = ", ".join(holders) or "another process"
    return PortHeld(f"{device} is used by {whose}", next_step="close that program")


def _why(device: str, error: OSError) -> PortUnusable:
    what = f"{device} cannot be opened: {error.strerror}"
    if error.errno == errno.EACCES:
        return PortUnusable(what, next_step=how_to_be_allowed(device))
    if error.errno == errno.EBUSY:
        return held(device)
    return PortUnusable(what)
