# SPDX-License-Identifier: GPL-3.0-or-later
"""A GPS receiver on a pty, which says what it is told to, in NMEA 0183."""

import datetime
import functools
import operator
import os
import pty
import tty
from pathlib import Path
from typing import Self


def sentence(body: str) -> bytes:
    """With its checksum."""
    return f"${body}*{functools.reduce(operator.xor, body.encode(), 0):02X}\r\n".encode()


def angle(degrees: float, digits: int, hemispheres: str) -> str:
    """As ddmm.mmmmm,N."""
    minutes = round(abs(degrees) * 60, 5)
    whole, rest = divmod(minutes, 60)
    return f"{int(whole):0{digits}d}{rest:08.5f},{hemispheres[degrees < 0]}"


def burst(
    at: datetime.datetime,
    latitude: float,
    longitude: float,
    *,
    method: int = 1,
    speed_knots: float = 0.0,
    course: float = 90.0,
    altitude_m: float = 137.2,
    satellites: int = 7,
    rmc_ms: int = 0,
) -> bytes:
    """GGA, GSA, GSV and RMC of one moment, RMC some ms later. Method 0: no fix. satellites: as GGA says."""
    time = f"{at:%H%M%S.%f}"[:-4]
    later = at + datetime.timedelta(milliseconds=rmc_ms)
    place = f"{angle(latitude, 2, 'NS')},{angle(longitude, 3, 'EW')}" if method else ",,,"
    found = f"{place},{method},{satellites:02d},1.2,{altitude_m:.1f},M,39.1,M,,"
    if not method:
        found = f"{place},0,00,,,M,,M,,"
    moving = f"A,{place},{speed_knots:.1f},{course:05.1f}" if method else f"V,{place},,"
    return b"".join(
        sentence(body)
        for body in (
            f"GPGGA,{time},{found}",
            f"GPGSA,A,{3 if method else 1},04,05,09,12,24,25,29,,,,,,1.8,1.2,1.3",
            "GPGSV,1,1,04,04,77,045,42,05,30,180,38,09,10,270,,12,05,359,25",
            f"GPRMC,{later:%H%M%S.%f}"[:-4] + f",{moving},{later:%d%m%y},,",
        )
    )


class Receiver:
    """Its line is `path`. A process that lost the line finds it again there."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.plug()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.unplug()

    def plug(self) -> None:
        """A new pty, behind the same name."""
        self.side, line = pty.openpty()
        tty.setraw(line)
        Path(os.ttyname(line)).chmod(0o666)  # rtu-gps is a user of its own
        self.path.symlink_to(os.ttyname(line))
        os.close(line)

    def unplug(self) -> None:
        """Who has the line open reads that it is over.

        The name goes first: the pty's number will soon be that of another process's pty.
        """
        self.path.unlink()
        os.close(self.side)

    def say(self, octets: bytes) -> None:
        """Without waiting: what a full line cannot take is lost, as on a wire."""
        os.set_blocking(self.side, False)
        try:
            os.write(self.side, octets)
        except BlockingIOError:
            return
