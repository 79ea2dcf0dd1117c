# SPDX-License-Identifier: GPL-3.0-or-later
"""libiec61850's client: its calls hold Python's lock, so it runs in a process of its own."""

import ctypes
import sys
from typing import Any

from pyiec61850 import pyiec61850 as lib

from lab.patience import slowness

TRIES = 10
ANSWER_MS = 10_000  # on an idle machine, for a connection and for each request


def check(error: int, what: str) -> None:
    if error != lib.IED_ERROR_OK:
        sys.exit(f"{what}: error {error}")


def texts_of(linked: Any) -> list[str]:
    """A list of libiec61850's."""
    found, each = [], lib.LinkedList_getNext(linked)
    while each:
        found.append(lib.toCharP(lib.LinkedList_getData(each)))
        each = lib.LinkedList_getNext(each)
    return found


def connected(port: int) -> Any:
    """An association. Some take no request: two threads of libiec61850 have overtaken each other."""
    patience_ms = int(ANSWER_MS * slowness())
    for _ in range(TRIES):
        connection = lib.IedConnection_create()
        lib.IedConnection_setConnectTimeout(connection, patience_ms)
        lib.IedConnection_setRequestTimeout(connection, patience_ms)
        check(lib.IedConnection_connect(connection, "127.0.0.1", port)[1], "connection")
        if lib.IedConnection_getLogicalDeviceList(connection)[1] != lib.IED_ERROR_CONNECTION_LOST:
            return connection
        lib.IedConnection_destroy(connection)
    sys.exit("no association takes a request")


def close(connection: Any) -> None:
    """While Python's lock is free: a report that comes now takes it, and the closing waits for the report."""
    library = ctypes.CDLL(lib._pyiec61850.__file__)
    library.IedConnection_close(ctypes.c_void_p(int(connection)))
