# SPDX-License-Identifier: GPL-3.0-or-later
"""libiec61850's client, as a process: copies a data set, for all and for itself, and deletes the copies."""

import json
import sys
from typing import Any

from pyiec61850 import pyiec61850 as lib

from lab.libiec61850 import check, connected, texts_of


def directory(connection: Any, reference: str) -> Any:
    linked, error, *_ = lib.IedConnection_getDataSetDirectory(connection, reference, None)
    check(error, reference)
    return linked


def main() -> None:
    connection, original = connected(int(sys.argv[1])), sys.argv[2]
    linked = directory(connection, original)
    found = {original: texts_of(linked)}
    for copy in sys.argv[3:]:
        _, error = lib.IedConnection_createDataSet(connection, copy, linked)
        check(error, f"creation of {copy}")
        found[copy] = texts_of(directory(connection, copy))
    for copy in sys.argv[3:]:
        deleted, error = lib.IedConnection_deleteDataSet(connection, copy)
        check(error, f"deletion of {copy}")
        assert deleted
    lib.IedConnection_close(connection)
    lib.IedConnection_destroy(connection)
    print(json.dumps(found))


if __name__ == "__main__":
    main()
