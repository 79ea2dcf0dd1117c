# SPDX-License-Identifier: GPL-3.0-or-later
"""
libiec61850 as a publisher and a subscriber of GOOSE, in a process of its own: `python -m peers.goose hear …`
prints what it receives, a line of JSON each; `say …` publishes each line of JSON that it reads.
"""

from __future__ import annotations

import argparse
import ctypes
import importlib.util
import json
import sys
import threading
from ctypes import (
    POINTER,
    Structure,
    byref,
    c_bool,
    c_char_p,
    c_float,
    c_int,
    c_uint8,
    c_uint16,
    c_uint32,
    c_void_p,
)
from pathlib import Path
from typing import Any

QUALITY_BITS = 13
TEXT_SIZE = 4096


class Address(Structure):
    """CommParameters of libiec61850."""

    _fields_ = [
        ("vlan_priority", c_uint8),
        ("vlan", c_uint16),
        ("app_id", c_uint16),
        ("destination", c_uint8 * 6),
    ]


def library() -> ctypes.CDLL:
    """That of the package pyiec61850-ng."""
    package = importlib.util.find_spec("pyiec61850")
    assert package is not None and package.submodule_search_locations
    found = ctypes.CDLL(str(Path(package.submodule_search_locations[0]) / "libiec61850.so"))
    for name in ("GooseReceiver_create", "GooseSubscriber_create", "GooseSubscriber_getDataSetValues"):
        getattr(found, name).restype = c_void_p
    for name in ("GoosePublisher_createEx", "LinkedList_create", "MmsValue_newBoolean", "MmsValue_newFloat"):
        getattr(found, name).restype = c_void_p
    for name in ("MmsValue_newBitString", "MmsValue_newIntegerFromInt32", "MmsValue_newUnsignedFromUint32"):
        getattr(found, name).restype = c_void_p
    found.MmsValue_printToBuffer.restype = c_char_p
    found.MmsValue_newFloat.argtypes = [c_float]
    found.GoosePublisher_createEx.argtypes = [POINTER(Address), c_char_p, c_bool]
    for name in ("GooseSubscriber_getStNum", "GooseSubscriber_getSqNum", "GooseSubscriber_getConfRev"):
        getattr(found, name).restype = c_uint32
    found.GooseSubscriber_isValid.restype = c_bool
    return found


# ---- hear ----------------------------------------------------------------------------------------


def hear(interface: str, control: str, app_id: int) -> None:
    """Prints each message that it takes, until it is killed."""
    stack = library()
    subscriber = c_void_p(stack.GooseSubscriber_create(control.encode(), None))
    stack.GooseSubscriber_setAppId(subscriber, c_uint16(app_id))

    @ctypes.CFUNCTYPE(None, c_void_p, c_void_p)
    def heard(source: int, _: int) -> None:
        text = ctypes.create_string_buffer(TEXT_SIZE)
        values = c_void_p(stack.GooseSubscriber_getDataSetValues(c_void_p(source)))
        printed = stack.MmsValue_printToBuffer(values, text, c_int(TEXT_SIZE))
        message = {
            "state": stack.GooseSubscriber_getStNum(c_void_p(source)),
            "sequence": stack.GooseSubscriber_getSqNum(c_void_p(source)),
            "valid": stack.GooseSubscriber_isValid(c_void_p(source)),
            "revision": stack.GooseSubscriber_getConfRev(c_void_p(source)),
            "values": printed.decode(),
        }
        print(json.dumps(message), flush=True)

    stack.GooseSubscriber_setListener(subscriber, heard, None)
    receiver = c_void_p(stack.GooseReceiver_create())
    stack.GooseReceiver_setInterfaceId(receiver, interface.encode())
    stack.GooseReceiver_addSubscriber(receiver, subscriber)
    stack.GooseReceiver_start(receiver)
    threading.Event().wait()


# ---- say -----------------------------------------------------------------------------------------


def value_of(stack: ctypes.CDLL, value: Any) -> c_void_p:
    """A bool, an int, a float; a text of 0 and 1 is a bit string, the first is bit 0."""
    if isinstance(value, bool):
        return c_void_p(stack.MmsValue_newBoolean(c_bool(value)))
    if isinstance(value, int):
        return c_void_p(stack.MmsValue_newIntegerFromInt32(c_int(value)))
    if isinstance(value, float):
        return c_void_p(stack.MmsValue_newFloat(value))
    bits = c_void_p(stack.MmsValue_newBitString(c_int(len(value))))
    for place, bit in enumerate(value):
        stack.MmsValue_setBitStringBit(bits, c_int(place), c_bool(bit == "1"))
    return bits


def say(interface: str, control: str, data_set: str, app_id: int, alive_ms: int) -> None:
    """Publishes each line of standard input, a list, as a new state; null repeats the last. Prints "sent"."""
    stack = library()
    destination = (c_uint8 * 6)(0x01, 0x0C, 0xCD, 0x01, 0x00, 0x02)
    address = Address(vlan_priority=4, vlan=0, app_id=app_id, destination=destination)
    publisher = c_void_p(stack.GoosePublisher_createEx(byref(address), interface.encode(), False))
    stack.GoosePublisher_setGoCbRef(publisher, control.encode())
    stack.GoosePublisher_setDataSetRef(publisher, data_set.encode())
    stack.GoosePublisher_setConfRev(publisher, c_uint32(1))
    stack.GoosePublisher_setTimeAllowedToLive(publisher, c_uint32(alive_ms))
    values = c_void_p()
    for line in sys.stdin:
        state = json.loads(line)
        if state is not None:
            values = c_void_p(stack.LinkedList_create())
            for value in state:
                stack.LinkedList_add(values, value_of(stack, value))
            stack.GoosePublisher_increaseStNum(publisher)
        stack.GoosePublisher_publish(publisher, values)
        print("sent", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("deed", choices=("hear", "say"))
    parser.add_argument("interface")
    parser.add_argument("control")
    parser.add_argument("app_id", type=int)
    parser.add_argument("--data-set", default="")
    parser.add_argument("--alive-ms", type=int, default=1000)
    options = parser.parse_args()
    if options.deed == "hear":
        hear(options.interface, options.control, options.app_id)
    else:
        say(options.interface, options.control, options.data_set, options.app_id, options.alive_ms)


if __name__ == "__main__":
    main()
