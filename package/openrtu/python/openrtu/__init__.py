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
from pathlib import Path
from typing import Any, Self

from openrtu import _library
from openrtu.codes import Level, Quality, Result, State

__all__ = [
    "AttachError",
    "Command",
    "CommandError",
    "Event",
    "Level",
    "Module",
    "Point",
    "PointError",
    "Quality",
    "Request",
    "Result",
    "Sample",
    "Selection",
    "State",
    "library_version",
]

_SELECT, _ANYWAY, _LOCAL = 1, 2, 1  # as openrtu.h has them
# In the tree a link leads to the file that it has once; a package has a copy.
VERSION = (Path(__file__).resolve().parent / "VERSION").read_text(encoding="utf-8").strip()


class AttachError(SystemExit):
    """There is no gateway to be a module of. It ends the program with its message, unless it is caught."""


class PointError(LookupError):
    """There is no such point for this module, or it may not write it."""


class CommandError(RuntimeError):
    """A command that was not sent: the last one has not ended, or the scan has read a bad input."""


@dataclass(frozen=True, slots=True)
class Command:
    """What had become of a command to another module's point when the scan began."""

    state: State
    result: Result
    exception: int  # the device's code, with Result.EXCEPTION
    ended: bool  # nothing more comes

    @property
    def executed(self) -> bool:
        """It has ended well."""
        return self.state == State.EXECUTED_COMMAND


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
class Event:
    """A change of a point that the module reads."""

    name: str
    sample: Sample
    past: bool = False  # the point is newer already, as when a station below had kept the event


@dataclass(frozen=True, slots=True)
class Point:
    """A point that the module reads or owns, as the configuration has it."""

    name: str
    type: str  # single, double, step, bitstring, normalized, scaled, float, counter
    unit: str  # "": none is given
    description: str
    own: bool  # the module may write it
    takes_commands: bool  # the module may command it: another module's
    number: int  # in the library


@dataclass(frozen=True, slots=True)
class _Asked:
    module: Module
    name: str  # of the own point
    value: bool | int | float
    pulse_ms: int  # the value for so long, then the other one; 0: it stays
    time_ns: int  # when it was requested, as time.monotonic_ns()
    local: bool  # by somebody on site
    step: int  # a regulating step, 1 higher or -1 lower, and value is what the point becomes; 0: it is none


class Request(_Asked):
    """A command of an own point, to be carried out and ended by this module, in this scan or a later one."""

    __slots__ = ()

    def confirm(self) -> None:
        """Tells whoever requested it that it has begun, and goes on."""
        self.module._confirm(self.name)

    def done(self) -> None:
        """Ends it well with this scan: the point goes out as return information."""
        self.module._end(self.name, Result.DONE)

    def refuse(self, result: Result = Result.INTERLOCK) -> None:
        """Ends it, and says why it was not done."""
        if result in (Result.NONE, Result.DONE):
            raise ValueError(f"{result!r} refuses nothing")
        self.module._end(self.name, result)


class Selection(_Asked):
    """A selection of an own point. It is accepted when the scan ends, unless the module refuses it."""

    __slots__ = ()

    def refuse(self, result: Result = Result.INTERLOCK) -> None:
        """Says why a command with this value would not be done."""
        if result in (Result.NONE, Result.DONE):
            raise ValueError(f"{result!r} refuses nothing")
        self.module._refuse_selection(self.name, result)


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
        self._by_number = [self._point(number) for number in numbers]
        self.points: dict[str, Point] = {point.name: point for point in self._by_number}

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
        if self._library.openrtu_read(self._handle, point.number, ctypes.byref(raw)) < 0:
            raise PointError(f'"{name}" is not among the "reads" of the module {self.name}')
        return _sample(point.type, raw)

    def __setitem__(self, name: str, value: float) -> None:
        """Writes an own point, as good as the inputs read so far. Raises PointError, ValueError."""
        self.write(name, value)

    def write(
        self, name: str, value: float, quality: Quality | None = None, time_ns: int | None = None
    ) -> None:
        """Writes an own point; no quality: as good as the inputs read so far.

        time_ns: when what comes from elsewhere was acquired, as time.monotonic_ns(); with a quality only.
        Raises PointError, and ValueError for what the point cannot hold: it is then invalid.
        """
        point = self._find(name)
        if quality is None:
            result = self._library.openrtu_write(self._handle, point.number, value)
        elif time_ns is not None:
            result = self._library.openrtu_write_at(self._handle, point.number, value, quality, time_ns)
        else:
            result = self._library.openrtu_write_quality(self._handle, point.number, value, quality)
        if result == -errno.EPERM:
            raise PointError(f'"{name}" is a point of another module: this one may only read it')
        if result < 0:
            raise ValueError(f'{value} is no value of "{name}", of type {point.type}')

    def events(self) -> Iterator[Event]:
        """The events of what the module reads, each once; they may be newer than the frozen inputs."""
        raw = _library.RawEvent()
        while self._library.openrtu_event_next(self._handle, ctypes.byref(raw)):
            point = self._by_number[raw.point]
            yield Event(point.name, _sample(point.type, raw.sample), bool(raw.past))

    @property
    def events_lost(self) -> int:
        """How many events of the gateway were overwritten before this module has read on."""
        lost: int = self._library.openrtu_events_lost(self._handle)
        return lost

    def requests(self) -> Iterator[Request]:
        """The commands of own points that had come when the scan began, each once."""
        raw = _library.RawRequest()
        while self._library.openrtu_request_next(self._handle, ctypes.byref(raw)):
            yield Request(self, *self._asked(raw))

    def selections(self) -> Iterator[Selection]:
        """The selections of own points that had come when the scan began, each once."""
        raw = _library.RawRequest()
        while self._library.openrtu_selection_next(self._handle, ctypes.byref(raw)):
            yield Selection(self, *self._asked(raw))

    def command(self, name: str, value: float, *, select: bool = False, anyway: bool = False) -> None:
        """Commands another module's point that "commands" name; `commanded` tells what becomes of it.

        select: selects it first. anyway: although this scan has read an input that is no good.
        Raises PointError, ValueError for what the point cannot hold, CommandError if nothing was sent.
        """
        point = self._find(name)
        flags = _SELECT * select | _ANYWAY * anyway
        result = self._library.openrtu_command(self._handle, point.number, value, flags)
        if result == -errno.EPERM:
            raise PointError(f'"{name}" is not among the "commands" of the module {self.name}')
        if result == -errno.EBUSY:
            raise CommandError(f'the last command of "{name}" has not ended')
        if result == -errno.ENODATA:
            raise CommandError(f'"{name}" is not commanded: this scan has read an input that is no good')
        if result < 0:
            raise ValueError(f'{value} is no value of "{name}", of type {point.type}')

    def commanded(self, name: str) -> Command:
        """What had become of the module's command of a point when the scan began. Raises PointError."""
        raw = _library.RawCommand()
        if self._library.openrtu_command_read(self._handle, self._find(name).number, ctypes.byref(raw)) < 0:
            raise PointError(f'"{name}" is not among the "commands" of the module {self.name}')
        return Command(State(raw.state), Result(raw.result), raw.detail, bool(raw.ended))

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

    def _asked(self, raw: _library.RawRequest) -> tuple[str, bool | int | float, int, int, bool, int]:
        point = self._by_number[raw.point]
        value = _value(point.type, raw.value)
        return point.name, value, raw.pulse_ms, raw.time_ns, bool(raw.flags & _LOCAL), raw.step

    def _confirm(self, name: str) -> None:
        self._library.openrtu_request_confirm(self._handle, self._find(name).number)

    def _end(self, name: str, result: Result) -> None:
        self._library.openrtu_request_end(self._handle, self._find(name).number, result)

    def _refuse_selection(self, name: str, result: Result) -> None:
        self._library.openrtu_selection_refuse(self._handle, self._find(name).number, result)

    def _find(self, name: str) -> Point:
        if self._handle is None:
            raise PointError(f'"{name}": the module is closed')
        try:
            return self.points[name]
        except KeyError:
            raise PointError(
                f'no point "{name}": the module {self.name} needs it in its "points", "reads" or "commands"'
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
            takes_commands=self._library.openrtu_point_takes_commands(self._handle, number),
            number=number,
        )


def _loaded() -> ctypes.CDLL:
    try:
        return _library.load()
    except OSError as error:
        raise AttachError(
            f"{error}: install libopenrtu (make install), or name it in {_library.NAMED_BY}"
        ) from None


def _sample(type_name: str, raw: _library.RawSample) -> Sample:
    return Sample(_value(type_name, raw.value), Quality(raw.quality), raw.time_ns)


def _value(type_name: str, value: float) -> bool | int | float:
    if type_name == "single":
        return bool(value)
    return value if type_name in ("float", "angle") else int(value)
