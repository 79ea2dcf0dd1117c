# SPDX-License-Identifier: GPL-3.0-or-later
"""libopenrtu by ctypes: its functions as openrtu.h declares them."""

from __future__ import annotations

import ctypes
import os
from functools import cache

NAME = "libopenrtu.so.0"
NAMED_BY = "OPENRTU_LIBRARY"


class RawSample(ctypes.Structure):
    """struct openrtu_sample."""

    _fields_ = (
        ("value", ctypes.c_double),
        ("time_ns", ctypes.c_int64),
        ("quality", ctypes.c_uint32),
        ("reserved", ctypes.c_uint32),
    )


class RawEvent(ctypes.Structure):
    """struct openrtu_event."""

    _fields_ = (("point", ctypes.c_int32), ("past", ctypes.c_uint32), ("sample", RawSample))


class RawRequest(ctypes.Structure):
    """struct openrtu_request."""

    _fields_ = (
        ("point", ctypes.c_int32),
        ("pulse_ms", ctypes.c_uint32),
        ("value", ctypes.c_double),
        ("time_ns", ctypes.c_int64),
        ("flags", ctypes.c_uint32),
        ("step", ctypes.c_int32),
    )


class RawCommand(ctypes.Structure):
    """struct openrtu_command."""

    _fields_ = (
        ("state", ctypes.c_uint32),
        ("result", ctypes.c_uint32),
        ("detail", ctypes.c_uint32),
        ("ended", ctypes.c_uint32),
    )


_HANDLE = ctypes.c_void_p
_ARGUMENTS = ctypes.POINTER(ctypes.c_char_p)
# By function: what it returns, what it takes.
_FUNCTIONS: dict[str, tuple[object, list[object]]] = {
    "openrtu_attach": (_HANDLE, [ctypes.c_int, _ARGUMENTS]),
    "openrtu_error": (ctypes.c_char_p, []),
    "openrtu_detach": (None, [_HANDLE]),
    "openrtu_name": (ctypes.c_char_p, [_HANDLE]),
    "openrtu_config": (ctypes.c_char_p, [_HANDLE]),
    "openrtu_period_ms": (ctypes.c_uint32, [_HANDLE]),
    "openrtu_point_count": (ctypes.c_int, [_HANDLE]),
    "openrtu_point_name": (ctypes.c_char_p, [_HANDLE, ctypes.c_int]),
    "openrtu_point_type": (ctypes.c_char_p, [_HANDLE, ctypes.c_int]),
    "openrtu_point_unit": (ctypes.c_char_p, [_HANDLE, ctypes.c_int]),
    "openrtu_point_description": (ctypes.c_char_p, [_HANDLE, ctypes.c_int]),
    "openrtu_point_is_own": (ctypes.c_bool, [_HANDLE, ctypes.c_int]),
    "openrtu_point_takes_commands": (ctypes.c_bool, [_HANDLE, ctypes.c_int]),
    "openrtu_wait": (ctypes.c_bool, [_HANDLE]),
    "openrtu_scan_begin": (None, [_HANDLE]),
    "openrtu_scan_end": (None, [_HANDLE]),
    "openrtu_read": (ctypes.c_int, [_HANDLE, ctypes.c_int, ctypes.POINTER(RawSample)]),
    "openrtu_write": (ctypes.c_int, [_HANDLE, ctypes.c_int, ctypes.c_double]),
    "openrtu_write_quality": (ctypes.c_int, [_HANDLE, ctypes.c_int, ctypes.c_double, ctypes.c_uint32]),
    "openrtu_write_at": (
        ctypes.c_int,
        [_HANDLE, ctypes.c_int, ctypes.c_double, ctypes.c_uint32, ctypes.c_int64],
    ),
    "openrtu_event_next": (ctypes.c_bool, [_HANDLE, ctypes.POINTER(RawEvent)]),
    "openrtu_events_lost": (ctypes.c_uint32, [_HANDLE]),
    "openrtu_request_next": (ctypes.c_bool, [_HANDLE, ctypes.POINTER(RawRequest)]),
    "openrtu_request_confirm": (ctypes.c_int, [_HANDLE, ctypes.c_int]),
    "openrtu_request_end": (ctypes.c_int, [_HANDLE, ctypes.c_int, ctypes.c_int]),
    "openrtu_selection_next": (ctypes.c_bool, [_HANDLE, ctypes.POINTER(RawRequest)]),
    "openrtu_selection_refuse": (ctypes.c_int, [_HANDLE, ctypes.c_int, ctypes.c_int]),
    "openrtu_command": (ctypes.c_int, [_HANDLE, ctypes.c_int, ctypes.c_double, ctypes.c_uint32]),
    "openrtu_command_read": (ctypes.c_int, [_HANDLE, ctypes.c_int, ctypes.POINTER(RawCommand)]),
    "openrtu_synch": (ctypes.c_int, [_HANDLE, ctypes.c_char_p, ctypes.c_bool]),
    "openrtu_log": (None, [_HANDLE, ctypes.c_int, ctypes.c_char_p]),
    "openrtu_wall_ns": (ctypes.c_int64, [_HANDLE, ctypes.c_int64]),
    "openrtu_version": (ctypes.c_char_p, []),
}


@cache
def load() -> ctypes.CDLL:
    """The library that OPENRTU_LIBRARY names, or the installed one. Raises OSError."""
    library = ctypes.CDLL(os.environ.get(NAMED_BY, NAME))
    for name, (result, arguments) in _FUNCTIONS.items():
        function = getattr(library, name)
        function.restype = result
        function.argtypes = arguments
    return library


def arguments_of(argv: list[str]) -> tuple[int, ctypes.Array[ctypes.c_char_p]]:
    """argc and argv as main() gets them."""
    words = [os.fsencode(word) for word in argv]
    return len(words), (ctypes.c_char_p * (len(words) + 1))(*words, None)
