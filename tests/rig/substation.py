# SPDX-License-Identifier: GPL-3.0-or-later
"""Several controlling stations on bare sockets before a gateway of several queues."""

import contextlib
import socket
import struct
from collections.abc import Iterator
from typing import Any, Self

import pytest

from lab.gateway import Gateway
from lab.raw_master import Asdu, Object
from lab.show import DEVICE, STATION
from rig.capture import RECORD, port_behind_relay
from rig.desk import Substation, chapter_5, of_port

STARTDT, STARTDT_CON = bytes.fromhex("680407000000"), bytes.fromhex("68040b000000")
STOPDT, STOPDT_CON = bytes.fromhex("680413000000"), bytes.fromhex("680423000000")
TESTFR, TESTFR_CON = bytes.fromhex("680443000000"), bytes.fromhex("680483000000")
REGISTER, IOA = 1, 30002  # the input register whose values are counted up
MAIN, STANDBY, RESERVE = "127.0.0.21", "127.0.0.22", "127.0.0.31"
SOON_S = 30.0


def configuration() -> dict[str, Any]:
    """One device, and no events but those of the tests: a busy machine makes no time-outs."""
    config = chapter_5()
    line = of_port(config, 3)
    line["slaves"] = [slave | {"retries": 5} for slave in line["slaves"] if slave["id"] == 67]
    config["port"] = [line]
    config["iec104"] = {"k": 12, "w": 8, "t1": 200, "t2": 100, "t3": 300}  # the tests take their time
    config["redundancy_groups"] = [
        {"name": "Control centre", "masters": [MAIN, STANDBY]},
        {"name": "Reserve", "masters": [RESERVE]},
    ]
    return config


class Link:
    """A controlling station's connection that acknowledges when it is told to."""

    def __init__(self, gateway: Gateway, source: str) -> None:
        self._gateway = gateway
        before = len(RECORD)
        self._socket = socket.create_connection(gateway.address, SOON_S, (source, 0))
        own = self._socket.getsockname()[1]
        gateway.wait_for(
            lambda: port_behind_relay(gateway, own, before) is not None, SOON_S, "it is connected"
        )
        self.name = f"{source} port {port_behind_relay(gateway, own, before)}"
        self.received = self.sent = 0  # V(R), V(S)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
        self._gateway.wait_for(lambda: not connection_of(self._gateway, self), SOON_S, "it is gone")

    def send(self, octets: bytes) -> None:
        self._socket.sendall(octets)

    def request(self, asdu: bytes) -> None:
        head = struct.pack("<HH", self.sent << 1, self.received << 1)
        self.send(bytes([0x68, 4 + len(asdu)]) + head + asdu)
        self.sent += 1

    def _octets(self, count: int) -> bytes:
        octets = b""
        while len(octets) < count:
            octets += self._socket.recv(count - len(octets)) or pytest.fail("closed by the station")
        return octets

    def frame(self) -> bytes:
        head = self._octets(2)
        frame = head + self._octets(head[1])
        if not frame[2] & 1:
            assert int.from_bytes(frame[2:4], "little") >> 1 == self.received
            self.received += 1
        return frame

    def start(self) -> Self:
        self.send(STARTDT)
        assert self.frame() == STARTDT_CON
        return self

    def stop(self) -> None:
        self.send(STOPDT)
        assert self.frame() == STOPDT_CON

    def objects(self) -> list[Object]:
        """Of the next frame, which has to be one of events."""
        asdu = Asdu.parse(self.frame()[6:], 0)
        assert asdu.cause == 3
        return asdu.objects()

    def values(self, count: int) -> list[int]:
        """So many values of the counted register; no other event comes between."""
        values: list[int] = []
        while len(values) < count:
            objects = self.objects()
            assert {(found.ca, found.ioa) for found in objects} == {(STATION, IOA)}, self._gateway.log()
            values += [found.value for found in objects]
        return values

    def acknowledge(self, received: int | None = None) -> None:
        number = self.received if received is None else received
        self.send(bytes([0x68, 4, 1, 0]) + struct.pack("<H", number << 1))

    def until_quiet(self) -> Iterator[bytes]:
        """The frames that come before the confirmation of a test: events that wait, up to k."""
        self.send(TESTFR)
        while (frame := self.frame()) != TESTFR_CON:
            yield frame

    def is_quiet(self) -> bool:
        return not list(self.until_quiet())

    def is_closed(self) -> bool:
        with contextlib.suppress(ConnectionResetError):
            while self._socket.recv(4096):
                pass
        return True

    def close(self) -> None:
        self._socket.close()

    def reset(self) -> None:
        """As a machine that was switched off and on again would end it."""
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        self._socket.close()


def queue(gateway: Gateway, name: str) -> dict[str, Any]:
    rows = {row["name"]: row for row in gateway.query("iec104", "queues")}
    found: dict[str, Any] = rows.get(name, {})
    return found


def wait_queue(gateway: Gateway, name: str, key: str, value: int) -> None:
    gateway.wait_for(
        lambda: queue(gateway, name)[key] == value,
        SOON_S,
        f"{key} of {name} is {value}: {queue(gateway, name)}",
    )


def wait_log(gateway: Gateway, text: str) -> None:
    gateway.wait_for(lambda: text in gateway.log(), SOON_S, f"{text} is logged")


def connection_of(gateway: Gateway, link: Link) -> dict[str, Any]:
    rows = {row["peer"]: row for row in gateway.query("iec104", "connections")}
    found: dict[str, Any] = rows.get(link.name, {})
    return found


def empty(gateway: Gateway, name: str, source: str) -> None:
    """Takes all that waits in a queue."""
    with Link(gateway, source).start() as link:
        while queue(gateway, name)["waiting"] > 0:
            list(link.until_quiet())
            link.acknowledge()


def count_up(substation: Substation, values: range, link: Link | None = None) -> None:
    """Events of the counted register, one after another; each in a frame of its own if a link takes them."""
    for value in values:
        substation.set_and_scan(DEVICE, "input_registers", REGISTER, [value])
        if link is not None:
            assert link.values(1) == [value]
