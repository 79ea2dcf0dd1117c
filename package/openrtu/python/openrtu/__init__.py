# SPDX-License-Identifier: GPL-3.0-or-later
"""A module of the OpenRTU gateway: reads points of others, computes, and publishes points of its own.

    from openrtu import Module

    with Module() as module:
        for _ in module.scans():
            module["pump"] = module["tank.level"].value < 20

rtud starts the program, as an entry of "modules" in the configuration says. Inputs are frozen while a
scan runs; what it writes is published when it ends. An output is as bad as the worst input that its scan
has read until then, unless `write` says another quality.
"""

from __future__ import annotations

import ctypes
import errno
import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import Any, Self

from openrtu import _library

__all__ = ["AttachError", "Level", "Module", "Point", "PointError", "Quality", "Sample", "library_version"]

VERSION = "0.1.0"  # as package/openrtu/src/VERSION


class AttachError(SystemExit):
    """There is no gateway to be a module of. It ends the program with its message, unless it is caught."""


class PointError(LookupError):
    """There is no such point for this module, or it may not write it."""


class Quality(IntFlag):
    """What is wrong with a value; the bits of IEC 60870-5-101, 7.2.6.3. 0 is good."""

    GOOD = 0x00
    OVERFLOW = 0x01
    BLOCKED = 0x10
    SUBSTITUTED = 0x20
    NOT_TOPICAL = 0x40
    INVALID = 0x80


class Level(IntEnum):
    """How bad a line of the log is."""

    ERROR = 0
    WARNING = 1
    INFO = 2
    DEBUG = 3


@dataclass(frozen=True, slots=True)
class Sample:
    """A value of a point. The value is the last one that was known, whatever its quality."""

    value: bool | int | float  # of a single point, a float, any other
    quality: Quality
    time_ns: int  # when it was acquired, as time.monotonic_ns()

    @property
    def good(self) -> bool:
        """Nothing is wrong with it."""
        return self.quality == Quality.GOOD

    @property
    def valid(self) -> bool:
        """It may be substituted or old, but is a value."""
        return not self.quality & Quality.INVALID


@dataclass(frozen=True, slots=True)
class Point:
    """A point that the module reads or owns, as the configuration has it."""

    name: str
    type: str  # single, double, step, bitstring, normalized, scaled, float, counter
    unit: str  # "": none is given
    description: str
    own: bool  # the module may write it
    number: int  # in the library


def library_version() -> str:
    """The version of libopenrtu. Raises AttachError when there is none on this machine."""
    version: bytes = _loaded().openrtu_version()
    return version.decode()


class Module:
    """This program as a module of the gateway, from the command line that rtud gave it."""

    def __init__(self, argv: list[str] | None = None) -> None:
        """Attaches. argv: of the program, sys.argv unless it is given. Raises AttachError."""
        self._library = _loaded()
        count, words = _library.arguments_of(sys.argv if argv is None else argv)
        self._handle = self._library.openrtu_attach(count, words)
        if not self._handle:
            raise AttachError(f"{words[0].decode()}: {self._library.openrtu_error().decode()}")
        self.name: str = self._library.openrtu_name(self._handle).decode()
        self.config: dict[str, Any] = json.loads(self._library.openrtu_config(self._handle))
        self.period_s: float = self._library.openrtu_period_ms(self._handle) / 1000
        numbers = range(self._library.openrtu_point_count(self._handle))
        self.points: dict[str, Point] = {point.name: point for point in map(self._point, numbers)}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Detaches: its points turn invalid when the program ends."""
        if self._handle:
            self._library.openrtu_detach(self._handle)
        self._handle = None

    def scans(self) -> Iterator[int]:
        """A scan each period, numbered from 0, until the module shall end.

        What its body writes is published when the body ends; a body that raises publishes nothing.
        """
        number = 0
        while self._library.openrtu_wait(self._handle):
            self._library.openrtu_scan_begin(self._handle)
            yield number
            self._library.openrtu_scan_end(self._handle)
            number += 1

    def __getitem__(self, name: str) -> Sample:
        """A point as it was when the scan began. Raises PointError."""
        point = self._find(name)
        raw = _library.RawSample()
        self._library.openrtu_read(self._handle, point.number, ctypes.byref(raw))
        return Sample(_value(point.type, raw.value), Quality(raw.quality), raw.time_ns)

    def __setitem__(self, name: str, value: float) -> None:
        """Writes an own point, as good as the inputs read so far. Raises PointError, ValueError."""
        self.write(name, value)

    def write(self, name: str, value: float, quality: Quality | None = None) -> None:
        """Writes an own point; None: as good as the inputs read so far.

        Raises PointError, and ValueError for what the point cannot hold: it is then invalid.
        """
        point = self._find(name)
        if quality is None:
            result = self._library.openrtu_write(self._handle, point.number, value)
        else:
            result = self._library.openrtu_write_quality(self._handle, point.number, value, quality)
        if result == -errno.EPERM:
            raise PointError(f'"{name}" is a point of another module: this one may only read it')
        if result < 0:
            raise ValueError(f'{value} is no value of "{name}", of type {point.type}')

    def synch(self, point: str, *, wait: bool = True) -> bool:
        """Fires a synchronisation point of the net within a scan, when the net lets it.

        wait=False: now or not at all. Returns whether it has fired; with wait, False means that the module
        shall end, or was taken for dead and the net has gone on without this scan.
        Raises PointError if the net has no such point of this module.
        """
        result: int = self._library.openrtu_synch(self._handle, point.encode(), wait)
        if result == -errno.ENOENT:
            raise PointError(f'no synchronisation point "{point}" of {self.name} in the "net"')
        return result == 1

    def log(self, text: str, level: Level = Level.INFO) -> None:
        """A line in the gateway's log; 111 octets of it are kept."""
        self._library.openrtu_log(self._handle, level, text.encode())

    def wall_ns(self, time_ns: int) -> int:
        """A sample's time as ns since 1970 UTC, by the gateway's clock."""
        wall: int = self._library.openrtu_wall_ns(self._handle, time_ns)
        return wall

    def _find(self, name: str) -> Point:
        if self._handle is None:
            raise PointError(f'"{name}": the module is closed')
        try:
            return self.points[name]
        except KeyError:
            raise PointError(
                f'no point "{name}": the module {self.name} needs it in its "points" or "reads"'
            ) from None

    def _point(self, number: int) -> Point:
        def text(function: str) -> str:
            found: bytes = getattr(self._library, function)(self._handle, number)
            return found.decode()

        return Point(
            name=text("openrtu_point_name"),
            type=text("openrtu_point_type"),
            unit=text("openrtu_point_unit"),
            description=text("openrtu_point_description"),
            own=self._library.openrtu_point_is_own(self._handle, number),
            number=number,
        )


def _loaded() -> ctypes.CDLL:
    try:
        return _library.load()
    except OSError as error:
        raise AttachError(
            f"{error}: install libopenrtu (make install), or name it in {_library.NAMED_BY}"
        ) from None


def _value(type_name: str, value: float) -> bool | int | float:
    if type_name == "single":
        return bool(value)
    return value if type_name == "float" else int(value)
