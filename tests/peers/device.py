# SPDX-License-Identifier: GPL-3.0-or-later
"""What the tests ask of a Modbus device, whoever made its server."""

import contextlib
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TypeVar

UNIT = 17
BAUD_RATE = 115200
FIRST_ADDRESS = 16  # of all tables; pymodbus allots its bits by sixteen
LAST_ADDRESS = 65535
TABLE_SIZE = LAST_ADDRESS + 1 - FIRST_ADDRESS


class Device(ABC):
    """A Modbus server. At power-on its tables, FIRST_ADDRESS to LAST_ADDRESS, are 0.

    On a serial device it speaks RTU, 115200 8N1; on a port of 127.0.0.1, Modbus TCP.
    """

    def __init__(self, place: Path | int) -> None:
        self.place = place
        self.requests: list[bytes] = []  # the protocol data units that the server took, function first

    @abstractmethod
    def start(self) -> None:
        """Powers it on."""

    @abstractmethod
    def stop(self) -> None:
        """Takes its power: it answers no more, and forgets what it held."""

    @abstractmethod
    def get(self, table: str, address: int, count: int) -> list[int]:
        """What the server's own memory holds."""

    @abstractmethod
    def set(self, table: str, address: int, values: Sequence[int]) -> None:
        """Changes neighbouring values of the server's own memory, between two answers."""


Made = TypeVar("Made", bound=Device)


@contextlib.contextmanager
def powered(device: Made) -> Iterator[Made]:
    device.start()
    try:
        yield device
    finally:
        device.stop()
