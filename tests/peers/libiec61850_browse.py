# SPDX-License-Identifier: GPL-3.0-or-later
"""
libiec61850's client, in a process of its own: its calls hold Python's lock, which the recorder needs.
Prints all logical devices, their variables, and the values of data objects, as JSON.
"""

import json
import sys
from typing import Any

from pyiec61850 import pyiec61850 as lib

from lab.libiec61850 import check, connected, texts_of


def python_of(value: Any) -> Any:
    kind = lib.MmsValue_getType(value)
    if kind == lib.MMS_STRUCTURE:
        return [python_of(lib.MmsValue_getElement(value, i)) for i in range(lib.MmsValue_getArraySize(value))]
    if kind == lib.MMS_BOOLEAN:
        return bool(lib.MmsValue_getBoolean(value))
    if kind == lib.MMS_INTEGER:
        return lib.MmsValue_toInt64(value)
    if kind == lib.MMS_UNSIGNED:
        return lib.MmsValue_toUint32(value)
    if kind == lib.MMS_FLOAT:
        return lib.MmsValue_toFloat(value)
    if kind == lib.MMS_BIT_STRING:
        return lib.MmsValue_getBitStringAsIntegerBigEndian(value)
    if kind == lib.MMS_VISIBLE_STRING:
        return lib.MmsValue_toString(value)
    if kind == lib.MMS_OCTET_STRING:
        return lib.MmsValue_getOctetStringSize(value)
    if kind == lib.MMS_BINARY_TIME:
        return lib.MmsValue_getBinaryTimeAsUtcMs(value)
    assert kind == lib.MMS_UTC_TIME, kind
    return lib.MmsValue_getUtcTimeInMs(value)


def browse(connection: Any) -> dict[str, Any]:
    linked, error = lib.IedConnection_getLogicalDeviceList(connection)
    check(error, "logical devices")
    found: dict[str, Any] = {}
    for device in texts_of(linked):
        linked, error = lib.IedConnection_getLogicalDeviceVariables(connection, device)
        check(error, device)
        variables = texts_of(linked)
        values = {}
        for name in variables:
            node, *parts = name.split("$")
            if len(parts) != 2:
                continue
            reference, fc = f"{device}/{node}.{parts[1]}", lib.FunctionalConstraint_fromString(parts[0])
            value, error = lib.IedConnection_readObject(connection, reference, fc)
            check(error, reference)
            values[name] = python_of(value)
            _, error = lib.IedConnection_getVariableSpecification(connection, reference, fc)
            check(error, reference)
        found[device] = {"variables": variables, "values": values}
    return found


def main() -> None:
    connection = connected(int(sys.argv[1]))
    print(json.dumps(browse(connection)))
    lib.IedConnection_close(connection)
    lib.IedConnection_destroy(connection)


if __name__ == "__main__":
    main()
