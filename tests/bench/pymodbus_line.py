# SPDX-License-Identifier: GPL-3.0-or-later
"""
Reads blocks on one line over and over, by pymodbus' ordinary client calls: line_loop.c's counterpart.

    pymodbus_line.py DEVICE BAUD STOP_BITS UNIT:FUNCTION:ADDRESS:COUNT ...
"""

from __future__ import annotations

import contextlib
import logging
import sys

from pymodbus.client import ModbusSerialClient
from pymodbus.exceptions import ModbusException


def main() -> int:
    device, baud, stop_bits, *texts = sys.argv[1:]
    logging.getLogger("pymodbus").setLevel(logging.CRITICAL)  # a dead device is what is measured
    client = ModbusSerialClient(device, baudrate=int(baud), stopbits=int(stop_bits))
    if not client.connect():
        print(f"{device} cannot be opened", file=sys.stderr)
        return 1
    calls = {
        1: client.read_coils,
        2: client.read_discrete_inputs,
        3: client.read_holding_registers,
        4: client.read_input_registers,
    }
    blocks = [tuple(map(int, text.split(":"))) for text in texts]
    print("ready", flush=True)
    while True:
        for unit, function, address, count in blocks:
            with contextlib.suppress(ModbusException):
                calls[function](address, count=count, device_id=unit)


if __name__ == "__main__":
    sys.exit(main())
