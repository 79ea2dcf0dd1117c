# SPDX-License-Identifier: GPL-3.0-or-later
"""The far end of an Ethernet port's cable: a host that answers ARP and pings, and each frame as it is."""

from __future__ import annotations

import fcntl
import socket
import struct
import termios
import threading
import time
from collections.abc import Callable
from ipaddress import IPv4Address
from pathlib import Path

SECONDS = 20.0
FRAME_LIMIT = 65536

BROADCAST = b"\xff" * 6
IPV4, ARP, VLAN, GOOSE = 0x0800, 0x0806, 0x8100, 0x88B8
ICMP, UDP = 1, 17
ECHO_REPLY, ECHO_REQUEST = 0, 8
PORT_OF_NOBODY = 9  # UDP's discard


def checksum(data: bytes) -> int:
    """RFC 1071."""
    total = sum(struct.unpack(f"!{len(data + bytes(len(data) % 2)) // 2}H", data + bytes(len(data) % 2)))
    while total >> 16:
        total = (total & 0xFFFF) + (total >> 16)
    return ~total & 0xFFFF


def vlan_tag(number: int) -> bytes:
    return struct.pack("!HH", VLAN, number)


def packet(protocol: int, source: IPv4Address, to: IPv4Address, body: bytes) -> bytes:
    """An IPv4 packet."""
    head = struct.pack("!BBHHHBBH", 0x45, 0, 20 + len(body), 0, 0x4000, 64, protocol, 0)
    head += source.packed + to.packed
    return head[:10] + struct.pack("!H", checksum(head)) + head[12:] + body


def echo(kind: int, body: bytes) -> bytes:
    """An ICMP echo message: identifier, sequence number and data are the body."""
    head = struct.pack("!BBH", kind, 0, 0)
    return struct.pack("!BBH", kind, 0, checksum(head + body)) + body


def cable(number: int, near: str, far: str) -> tuple[str, ...]:
    """QEMU's arguments for the next port: the sockets that are the two ends of its cable."""
    ends = f"local.type=unix,local.path={near},remote.type=unix,remote.path={far}"
    return "-netdev", f"dgram,id=cable{number},{ends}", "-net", f"nic,netdev=cable{number}"


class Wire:
    """A cable from a port of the board to a host of the test's own.

    arguments: QEMU's, for this port. echoes: the pings that the board answered, and with what. goose: the
    frames with GOOSE that it has sent.
    """

    def __init__(self, folder: Path, number: int, host: str, board: str) -> None:
        self.host, self.board = IPv4Address(host), IPv4Address(board)
        self.mac = bytes((2, 0, 0, 0, 0xEE, number))
        self.board_mac = b""  # as it was last seen
        self.name = f"nuc980-emac.{number}"
        self.echoes: dict[bytes, bytes] = {}  # by identifier and sequence number
        self.goose: list[bytes] = []
        self._asked = 0
        self._board = f"{folder}/board{number}"
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(f"{folder}/host{number}")
        self.arguments = cable(number, self._board, f"{folder}/host{number}")
        self._news = threading.Condition()
        self._host = threading.Thread(target=self._be_host, daemon=True)
        self._host.start()

    def close(self) -> None:
        self._socket.shutdown(socket.SHUT_RD)
        self._host.join()
        self._socket.close()

    # ---- to the board

    def send(self, frame: bytes) -> None:
        """A frame as it is; waits while the board takes no more."""
        self._socket.sendto(frame, self._board)

    def taken(self) -> None:
        """Waits until the board's port has got all that was sent."""
        unread = bytearray(4)

        def empty() -> bool:
            return fcntl.ioctl(self._socket, termios.TIOCOUTQ, unread) == 0 and not any(unread)

        deadline = time.monotonic() + SECONDS
        while not empty():
            assert time.monotonic() < deadline, "the port takes nothing"
            time.sleep(0.001)

    def frame(self, kind: int, body: bytes, to: bytes | None = None, tag: bytes = b"") -> bytes:
        """A frame to the board, or another address; of at least 60 bytes."""
        return ((to or self.board_mac) + self.mac + tag + struct.pack("!H", kind) + body).ljust(60, b"\0")

    def udp(self, body: bytes, port: int = PORT_OF_NOBODY) -> bytes:
        """A frame with an UDP datagram to the board; without a checksum, which UDP allows."""
        datagram = struct.pack("!HHHH", 9999, port, 8 + len(body), 0) + body
        return self.frame(IPV4, packet(UDP, self.host, self.board, datagram))

    def ask_mac(self, seconds: float = SECONDS) -> bytes:
        """The board's address, by ARP."""
        self.board_mac = b""
        request = struct.pack("!HHBBH", 1, IPV4, 6, 4, 1) + self.mac + self.host.packed + bytes(6)
        deadline = time.monotonic() + seconds
        while not self.board_mac:
            self.send(self.frame(ARP, request + self.board.packed, BROADCAST))
            self._wait(lambda: bool(self.board_mac), min(1.0, deadline - time.monotonic()))
            assert time.monotonic() < deadline, f"{self.board} does not answer to ARP"
        return self.board_mac

    def ping(self, number: int, data: bytes, to: bytes | None = None, tag: bytes = b"") -> None:
        """Sends one ping; number: 0 to 65535."""
        body = echo(ECHO_REQUEST, struct.pack("!HH", 980, number) + data)
        self.send(self.frame(IPV4, packet(ICMP, self.host, self.board, body), to, tag))

    def pong(self, number: int, seconds: float = SECONDS) -> bytes | None:
        """The data of its reply; None when there is none within the time."""
        key = struct.pack("!HH", 980, number)
        self._wait(lambda: key in self.echoes, seconds)
        return self.echoes.pop(key, None)

    def answers(self, seconds: float = SECONDS) -> bool:
        """Whether the board answers a ping; with a number of its own, from 32768 on."""
        self._asked += 1
        self.ping(0x8000 + self._asked, b"are you there")
        return self.pong(0x8000 + self._asked, seconds) == b"are you there"

    def hears_goose(self, octets: bytes, since: int, seconds: float) -> bool:
        """Whether the board sends a frame with these octets, behind so many."""
        self._wait(lambda: any(octets in frame for frame in self.goose[since:]), seconds)
        return any(octets in frame for frame in self.goose[since:])

    def _wait(self, condition: Callable[[], bool], seconds: float) -> None:
        with self._news:
            self._news.wait_for(condition, max(seconds, 0.0))

    # ---- from the board

    def _be_host(self) -> None:
        while frame := self._socket.recv(FRAME_LIMIT):
            tag = frame[12:16] if frame[12:14] == struct.pack("!H", VLAN) else b""
            start = 14 + len(tag)
            kind, body = int.from_bytes(frame[start - 2 : start], "big"), frame[start:]
            with self._news:
                if kind == ARP:
                    self._arp(body, tag)
                elif kind == IPV4:
                    self._icmp(body, tag)
                elif kind == GOOSE:
                    self.goose.append(frame)
                self._news.notify_all()

    def _arp(self, body: bytes, tag: bytes) -> None:
        operation, sender, target = body[6:8], body[8:18], IPv4Address(body[24:28])
        if target != self.host:
            return
        self.board_mac = sender[:6]
        if operation == b"\0\1":
            head = struct.pack("!HHBBH", 1, IPV4, 6, 4, 2)
            reply = head + self.mac + self.host.packed + sender
            self.send(self.frame(ARP, reply, sender[:6], tag))

    def _icmp(self, body: bytes, tag: bytes) -> None:
        length = int.from_bytes(body[2:4], "big")
        message = body[20:length]
        if body[9] != ICMP or IPv4Address(body[16:20]) != self.host:
            return
        if message[0] == ECHO_REPLY:
            assert checksum(message) == 0
            self.echoes[message[4:8]] = message[8:]
        elif message[0] == ECHO_REQUEST:
            reply = packet(ICMP, self.host, IPv4Address(body[12:16]), echo(ECHO_REPLY, message[4:]))
            self.send(self.frame(IPV4, reply, self.board_mac, tag))
