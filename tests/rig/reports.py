# SPDX-License-Identifier: GPL-3.0-or-later
"""A gateway with buffered reports of IEC 61850, and a client that takes them."""

from dataclasses import dataclass
from typing import Any

from peers import mms
from peers.mms import DONE, Client, element
from rig.desk import patience

CA, DEVICE, DOMAIN, BLOCK = 1005, "1.5", "OpenRTUCA1005", "LLN0$BR$brcbStatus01"
INPUTS, KEPT = 20, 128
YES, NO, NOTHING = bytes.fromhex("8301ff"), bytes.fromhex("830100"), bytes(8)


def configuration(port: int) -> dict[str, Any]:
    slave = {"id": 5, **patience(), "discrete_inputs": [{"address": i} for i in range(INPUTS)]}
    pace = {"baud_rate": 38400, "data_bits": 8, "stop_bits": 1, "parity": 0}
    return {
        "iec61850": {"address": "127.0.0.1", "port": port, "report_buffer": KEPT},
        "port": [{"value": 1, "active": 1, **pace, "slaves": [slave]}],
    }


@dataclass
class Entry:
    """A report of one change."""

    number: int  # SqNum
    lost: bool  # BufOvfl
    key: bytes  # EntryID
    member: int
    on: bool
    good: bool
    reason: int

    @property
    def place(self) -> int:
        return int.from_bytes(self.key[4:], "big")


def put(client: Client, **attributes: bytes) -> None:
    for name, value in attributes.items():
        assert client.write(DOMAIN, (f"{BLOCK}${name}", value)) == [DONE], name


def begin(client: Client, key: bytes | None = None) -> None:
    """Reports go on, behind this entry."""
    if key is not None:
        put(client, EntryID=element(0x89, key))
    put(client, RptEna=YES)


def taken(client: Client, count: int) -> list[Entry]:
    found = []
    for _ in range(count):
        name, options, number, _, lost, key, included, value, reason = client.report()
        assert (name[1], options[1]) == (f"{DOMAIN}/{BLOCK}".encode(), b"\6\x73\0")
        (member,) = [i for i in range(INPUTS) if included[1][1 + i // 8] & 0x80 >> i % 8]
        state, quality, _ = mms.elements(value[1])
        found.append(
            Entry(
                int.from_bytes(number[1], "big"),
                lost[1] != b"\0",
                key[1],
                member,
                state[1] != b"\0",
                quality[1][1] & 0xC0 == 0,
                reason[1][1],
            )
        )
    return found


def nothing_more(client: Client) -> bool:
    client.values((DOMAIN, "LLN0$ST$Beh$stVal"))
    return client.reports == []
