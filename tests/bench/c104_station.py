# SPDX-License-Identifier: GPL-3.0-or-later
"""
The same station with c104, which is lib60870: arguments PORT CA, then type and addresses of its points from
standard input. A line "RATE" there makes so many events in a second, EVENTS_MAX at most.
"""

import json
import sys
import time

import c104

EVENTS_MAX = 100_000
TYPES = {"single": c104.Type.M_SP_NA_1, "scaled": c104.Type.M_ME_NB_1}


def main() -> None:
    port, ca = map(int, sys.argv[1:3])
    server = c104.Server(ip="127.0.0.1", port=port, tick_rate_ms=50, max_connections=16)
    station = server.add_station(common_address=ca)
    assert station is not None
    for kind, addresses in json.loads(sys.stdin.readline()).items():
        for address in addresses:
            station.add_point(io_address=address, type=TYPES[kind])
    # For c104 an event with a time tag is of another point, and one address has one point: theirs go without.
    first, count = json.loads(sys.stdin.readline())
    registers = [station.get_point(address) for address in range(first, first + count)]
    server.start()
    print("ready", flush=True)
    for line in sys.stdin:
        rate, begun = int(line), time.monotonic()
        for made in range(min(EVENTS_MAX, rate)):
            while made > (time.monotonic() - begun) * rate:
                time.sleep(0.001)
            point = registers[made % count]
            point.value = c104.Int16((made + 1 + 0x8000) % 0x10000 - 0x8000)
            point.transmit(cause=c104.Cot.SPONTANEOUS)


if __name__ == "__main__":
    main()
