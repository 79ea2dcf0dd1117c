# SPDX-License-Identifier: GPL-3.0-or-later
"""libiec61850's client, as a process: prints sizes and times of the server's files, and takes all of them."""

import json
import sys

from pyiec61850 import pyiec61850 as lib

from lab.libiec61850 import check, connected


def main() -> None:
    connection = connected(int(sys.argv[1]))
    linked, error = lib.IedConnection_getFileDirectory(connection, "/")
    check(error, "directory")
    found, each = {}, lib.LinkedList_getNext(linked)
    while each:
        entry = lib.toFileDirectoryEntry(lib.LinkedList_getData(each))
        name = lib.FileDirectoryEntry_getFileName(entry)
        found[name] = [
            lib.FileDirectoryEntry_getFileSize(entry),
            lib.FileDirectoryEntry_getLastModified(entry),
        ]
        each = lib.LinkedList_getNext(each)
    mms = lib.IedConnection_getMmsConnection(connection)
    for name in found:
        error = lib.MmsError_create()
        assert lib.MmsConnection_downloadFile(mms, error, name, f"{sys.argv[2]}/{name}"), (
            lib.MmsError_getValue(error)
        )
    lib.IedConnection_close(connection)
    lib.IedConnection_destroy(connection)
    print(json.dumps(found))


if __name__ == "__main__":
    main()
