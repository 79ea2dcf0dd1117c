# SPDX-License-Identifier: GPL-3.0-or-later
"""libiec61850's client: its calls hold Python's lock, so it runs in a process of its own."""

import sys
from typing import Any

from pyiec61850 import pyiec61850 as lib

TRIES = 10


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
    for _ in range(TRIES):
        connection = lib.IedConnection_create()
        check(lib.IedConnection_connect(connection, "127.0.0.1", port)[1], "connection")
        if lib.IedConnection_getLogicalDeviceList(connection)[1] != lib.IED_ERROR_CONNECTION_LOST:
            return connection
        lib.IedConnection_destroy(connection)
    sys.exit("no association takes a request")
