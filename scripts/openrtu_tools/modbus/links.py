# SPDX-License-Identifier: GPL-3.0-or-later
"""A request out, its answer in: RTU on a serial port or through a serial server, and Modbus TCP.

Of our own, because the libraries drop what is not the answer: a damaged frame, another unit's and another
master's all become "no answer" there.
"""

from __future__ import annotations

import os
import select
import socket
import sys
import time
from abc import ABC, abstractmethod
from contextlib import suppress
from datetime import datetime
from typing import Self

from openrtu_tools.modbus import frames, serial_port
from openrtu_tools.modbus.errors import (
    Damaged,
    ForeignTraffic,
    HungUp,
    LinkLost,
    ModbusError,
    NoAnswer,
    NotAsked,
    OnlyEcho,
    OtherUnit,
    Unreachable,
    exceptional,
)
from openrtu_tools.modbus.frames import Request
from openrtu_tools.modbus.serial_port import Settings

SILENCE_CHARACTERS = 3.5
SILENCE_LEAST_S = 0.00175  # MODBUS over Serial Line V1.02, 2.5.1.1: above 19200 bit/s
QUIET_S = 0.1  # behind octets that are no answer: adapters on USB hand over theirs up to 16 ms late
NOISE_MOST = 3  # octets before an answer, from a transceiver that turns round
READ_SIZE = 512
REQUEST_LENGTH = 8  # of a read
UNREADABLE = 1024  # more octets than any answer has
SHOWN = 32  # octets of what was no answer
PREFIX = 6  # of a TCP frame, before the unit
FRAME_MOST = 1 + frames.PDU_MOST


class Stream(ABC):
    """Octets, of a serial port or a connection. Traced, it prints what goes out and comes in."""

    name: str
    traced = False
    characters = 1  # of the line, that an octet takes
    check = "CRC"  # that a frame ends in

    def send(self, octets: bytes) -> None:
        self._trace(">", octets)
        self._send(octets)

    def receive(self, seconds: float) -> bytes:
        """What comes within this time; nothing: nothing came. Raises LinkLost."""
        octets = self._receive(seconds)
        self._trace("<", octets)
        return octets

    def configure(self, settings: Settings) -> None:
        raise AssertionError(f"{self.name} has no settings")

    @abstractmethod
    def close(self) -> None: ...

    @abstractmethod
    def _send(self, octets: bytes) -> None: ...

    @abstractmethod
    def _receive(self, seconds: float) -> bytes: ...

    def _trace(self, direction: str, octets: bytes) -> None:
        if self.traced and octets:
            print(f"{time_of_day()} {direction} {octets.hex(' ')}", file=sys.stderr, flush=True)


def time_of_day() -> str:
    return datetime.now().strftime("%H:%M:%S.%f")


class SerialStream(Stream):
    def __init__(self, device: str, settings: Settings) -> None:
        self.name = device
        self._port = serial_port.opened(device, settings)

    def configure(self, settings: Settings) -> None:
        serial_port.configure(self.name, self._port, settings)

    def _send(self, octets: bytes) -> None:
        try:
            while octets:
                select.select([], [self._port], [])
                octets = octets[os.write(self._port, octets) :]
        except OSError as error:
            raise LinkLost(f"{self.name}: {error.strerror}", cause="the adapter was unplugged") from error

    def _receive(self, seconds: float) -> bytes:
        try:
            if not select.select([self._port], [], [], max(seconds, 0))[0]:
                return b""
            found = os.read(self._port, READ_SIZE)
        except OSError as error:
            raise LinkLost(f"{self.name}: {error.strerror}", cause="the adapter was unplugged") from error
        if not found:
            raise LinkLost(f"{self.name} hung up", cause="the adapter was unplugged")
        return found

    def close(self) -> None:
        os.close(self._port)


def network_name(host: str, port: int, udp: bool) -> str:
    return f"{host} port {port}{' (UDP)' if udp else ''}"


class NetworkStream(Stream):
    """To a host."""

    _socket: socket.socket

    @property
    def address(self) -> str:
        """Of the host, without its name."""
        found: str = self._socket.getpeername()[0]
        return found

    def close(self) -> None:
        self._socket.close()


class SocketStream(NetworkStream):
    def __init__(self, host: str, port: int, timeout_s: float) -> None:
        self.name = network_name(host, port, udp=False)
        try:
            self._socket = socket.create_connection((host, port), timeout_s)
        except TimeoutError as error:
            raise Unreachable(f"{self.name} does not answer a connection within {timeout_s:g} s") from error
        except ConnectionRefusedError as error:
            raise Unreachable(
                f"{self.name} refuses the connection",
                cause="the device is there, and serves no Modbus TCP on this port",
            ) from error
        except (OSError, UnicodeError) as error:
            why = getattr(error, "strerror", None) or error
            raise Unreachable(f"{self.name} cannot be reached: {why}") from error
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def _send(self, octets: bytes) -> None:
        try:
            self._socket.sendall(octets)
        except OSError as error:
            raise HungUp(f"{self.name} closed the connection") from error

    def _receive(self, seconds: float) -> bytes:
        if not select.select([self._socket], [], [], max(seconds, 0))[0]:
            return b""
        found = b""
        with suppress(OSError):  # a reset
            found = self._socket.recv(READ_SIZE)
        if not found:
            raise HungUp(f"{self.name} closed the connection without an answer")
        return found


class DatagramStream(NetworkStream):
    """Each piece is a datagram of UDP, to and from one address."""

    def __init__(self, host: str, port: int) -> None:
        self.name = network_name(host, port, udp=True)
        try:
            family, kind, protocol, _, where = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
            self._socket = socket.socket(family, kind, protocol)
            self._socket.connect(where)
        except (OSError, UnicodeError) as error:
            why = getattr(error, "strerror", None) or error
            raise Unreachable(f"{self.name} cannot be reached: {why}") from error

    def _send(self, octets: bytes) -> None:
        try:
            self._socket.send(octets)
        except OSError as error:
            raise self._lost(error) from error

    def _receive(self, seconds: float) -> bytes:
        end = time.monotonic() + seconds
        while select.select([self._socket], [], [], max(end - time.monotonic(), 0))[0]:
            try:
                found = self._socket.recv(READ_SIZE)
            except OSError as error:
                raise self._lost(error) from error
            if found:
                return found
        return b""

    def _lost(self, error: OSError) -> LinkLost:
        return LinkLost(
            f"{self.name}: {error.strerror}",
            cause="the host is there, and serves no Modbus by UDP on this port",
            next_step="try another port, or without --udp",
        )


class Link(ABC):
    """A line or a connection, with its stream."""

    def __init__(self, stream: Stream, timeout_s: float) -> None:
        self.stream = stream
        self.timeout_s = timeout_s

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stream.close()

    def ask(self, request: Request) -> bytes:
        """The answer without what the link puts around it. Raises a ModbusError."""
        pdu = self._exchange(request)
        if pdu[0] & frames.EXCEPTION_BIT:
            raise exceptional(f"unit {request.unit}", request.what, pdu[1])
        return pdu

    @abstractmethod
    def tell(self, request: Request) -> None:
        """A broadcast, which nobody answers."""

    @abstractmethod
    def _exchange(self, request: Request) -> bytes: ...

    @abstractmethod
    def set(self) -> str:
        """What a message says of the link's settings."""

    def _silence(self, request: Request) -> NoAnswer:
        return NoAnswer(
            f"unit {request.unit} on {self.stream.name} did not answer {request.what} within "
            f"{self.timeout_s:g} s",
            cause=f"another unit, {self.set()}, or a device that needs longer",
        )


# ---- RTU -----------------------------------------------------------------------------------------


def framed(request: Request) -> bytes:
    body = bytes([request.unit]) + request.pdu
    return body + frames.crc(body)


def frame_at(octets: bytes, start: int) -> bytes | None:
    """The whole frame with its own CRC that begins there, without the CRC."""
    length = frames.answer_length(octets[start + 1 :])
    if not length:
        return None
    end = start + 1 + length
    body = octets[start:end]
    return body if octets[end : end + 2] == frames.crc(body) else None


def request_in(octets: bytes) -> bytes | None:
    """A request of a read, or of a write of one, with its own CRC."""
    for start in range(len(octets) - REQUEST_LENGTH + 1):
        frame = octets[start : start + REQUEST_LENGTH]
        if 1 <= frame[1] <= frames.WRITE_REGISTER and frames.crc(frame[:-2]) == frame[-2:]:
            return frame
    return None


class RtuLink(Link):
    """settings: of a serial line; None: of a serial server, whose line has its own."""

    def __init__(self, stream: Stream, timeout_s: float, settings: Settings | None) -> None:
        super().__init__(stream, timeout_s)
        self._settings = settings
        self._quiet_at = 0.0  # when the silence since the last octet is long enough
        self._unanswered: Request | None = None
        self._late_until = 0.0
        self._sent_s = 0.0

    def configure(self, settings: Settings) -> None:
        """Goes on with other settings."""
        self.stream.configure(settings)
        self._settings = settings
        self._unanswered = None

    def set(self) -> str:
        return f"another speed or parity than {self._settings}" if self._settings else "another line"

    def tell(self, request: Request) -> None:
        self._send(request)
        time.sleep(self.timeout_s)  # the devices act, and would not hear what comes next

    def listen(self, seconds: float) -> bytes:
        """What others say, until it is as long as a frame or the time is over."""
        end, heard = time.monotonic() + seconds, b""
        while len(heard) < FRAME_MOST and (left := end - time.monotonic()) > 0:
            heard += self.stream.receive(left)
        return heard

    def _exchange(self, request: Request) -> bytes:
        self._drop_what_is_late(request)
        self._send(request)
        self._unanswered = request
        self._late_until = time.monotonic() + self._sent_s + 2 * self.timeout_s
        pdu = self._answer(request)
        self._unanswered = None
        return pdu

    def _drop_what_is_late(self, request: Request) -> None:
        """What came between two requests: the last one's answer, too late, or somebody else's."""
        late = b""
        while octets := self.stream.receive(self._guard_s(request) or (QUIET_S if late else 0)):
            late += octets
            self._heard()
            if len(late) > UNREADABLE:
                raise ForeignTraffic(f"{self.stream.name} does not fall silent")
        if late:
            self.overheard(late)

    def _guard_s(self, request: Request) -> float:
        """How long an answer to the last request may still come that would pass for one to this."""
        last = self._unanswered
        if last is None or (last.unit, last.function) != (request.unit, request.function):
            return 0
        return max(self._late_until - time.monotonic(), 0)

    def overheard(self, octets: bytes) -> None:
        """Octets that come between two requests: not of whom this one asks."""

    def _send(self, request: Request) -> None:
        wait = self._quiet_at - time.monotonic()
        if wait > 0:
            time.sleep(wait)
        octets = framed(request)
        self.stream.send(octets)
        self._sent_s = (
            len(octets) * self.stream.characters * self._settings.character_s if self._settings else 0.0
        )
        self._heard(self._sent_s)

    def _heard(self, later_s: float = 0.0) -> None:
        silence = SILENCE_CHARACTERS * self._settings.character_s if self._settings else 0.0
        self._quiet_at = time.monotonic() + later_s + max(silence, SILENCE_LEAST_S)

    def _answer(self, request: Request) -> bytes:
        octets = b""
        wait = self._sent_s + self.timeout_s
        while more := self.stream.receive(wait):
            self._heard()
            octets += more
            body = self._found(request, octets)
            if body is not None:
                return body[1:]
            whole = self._is_whole(request, octets)
            wait = QUIET_S if whole else self.timeout_s
            if len(octets) > UNREADABLE:
                break
        raise self._failure(request, octets)

    def _found(self, request: Request, octets: bytes) -> bytes | None:
        """The answer in what has come: behind an adapter's echo, or some noise."""
        echo = framed(request)
        if echo.startswith(octets) and request.function not in frames.ECHOES:
            return None
        heard = octets.removeprefix(echo) if request.function not in frames.ECHOES else octets
        for start in range(NOISE_MOST + 1):
            body = frame_at(heard, start)
            if body and body[0] == request.unit and frames.fits(request, body[1:]):
                return body
        return None

    def _is_whole(self, request: Request, octets: bytes) -> bool:
        """Whether what has come is no beginning of an answer any more."""
        echo = framed(request)
        if echo.startswith(octets):
            return False
        heard = octets.removeprefix(echo)
        length = frames.answer_length(heard[1:])
        return length == 0 or (length is not None and len(heard) >= 1 + length + 2)

    def _failure(self, request: Request, octets: bytes) -> ModbusError:
        if not octets:
            return self._silence(request)
        if framed(request) == octets:
            return OnlyEcho(f"only the request itself came back from {self.stream.name}")
        body = frame_at(octets, 0)
        if other := request_in(octets.removeprefix(framed(request))):
            return ForeignTraffic(
                f"somebody asked unit {other[0]} something when unit {request.unit} was to answer: "
                f"{shown(octets)}"
            )
        if body and body[0] != request.unit:
            return OtherUnit(f"unit {body[0]} answered, not unit {request.unit}: {shown(octets)}", body[0])
        if body:
            return NotAsked(
                f"unit {request.unit} answered something else than {request.what}: {shown(octets)}"
            )
        whole = self._is_whole(request, octets)
        wrong = f"an answer with a wrong {self.stream.check}" if whole else "no whole answer"
        return Damaged(f"{wrong} came to {request.what} of unit {request.unit}: {shown(octets)}")


def shown(octets: bytes) -> str:
    """In hexadecimal, the beginning."""
    return octets[:SHOWN].hex(" ") + (f" … ({len(octets)} octets)" if len(octets) > SHOWN else "")


# ---- TCP -----------------------------------------------------------------------------------------


class TcpLink(Link):
    stream: NetworkStream

    def __init__(self, stream: NetworkStream, timeout_s: float) -> None:
        super().__init__(stream, timeout_s)
        self._transaction = 0
        self._octets = b""

    def set(self) -> str:
        return "another port"

    def tell(self, request: Request) -> None:
        raise AssertionError("Modbus TCP has no broadcast")

    def _exchange(self, request: Request) -> bytes:
        self._transaction = self._transaction % 0xFFFF + 1
        body = bytes([request.unit]) + request.pdu
        self.stream.send(self._transaction.to_bytes(2) + bytes(2) + len(body).to_bytes(2) + body)
        end = time.monotonic() + self.timeout_s
        while True:
            transaction, body = self._next(request, end)
            if transaction != self._transaction:
                continue  # the answer to one before, which came too late
            if body[0] != request.unit:
                raise OtherUnit(
                    f"{self.stream.name} answers as unit {body[0]}, not {request.unit}",
                    body[0],
                    cause="the device has its own unit, whichever is asked",
                    next_step=f"ask it with --unit {body[0]}",
                )
            if not frames.fits(request, body[1:]):
                raise NotAsked(
                    f"{self.stream.name} answered something else than {request.what}: {shown(body)}"
                )
            return body[1:]

    def _next(self, request: Request, end: float) -> tuple[int, bytes]:
        """A frame: its transaction, and its body."""
        while True:
            length = int.from_bytes(self._octets[4:PREFIX]) if len(self._octets) >= PREFIX else None
            if length is not None and (self._octets[2:4] != bytes(2) or not 3 <= length <= FRAME_MOST):
                raise Damaged(
                    f"{self.stream.name} does not speak Modbus TCP: {shown(self._octets)}",
                    cause="another service, or a serial server",
                    next_step="try --rtu, or another port",
                )
            if length is not None and len(self._octets) >= PREFIX + length:
                frame, self._octets = self._octets[: PREFIX + length], self._octets[PREFIX + length :]
                return int.from_bytes(frame[:2]), frame[PREFIX:]
            octets = self.stream.receive(end - time.monotonic())
            if not octets:
                raise self._silence(request)
            self._octets += octets


# ---- UDP -----------------------------------------------------------------------------------------


class UdpLink(TcpLink):
    """A frame of Modbus TCP in each datagram."""

    def _next(self, request: Request, end: float) -> tuple[int, bytes]:
        while octets := self.stream.receive(end - time.monotonic()):
            body = octets[PREFIX:]
            if octets[2:PREFIX] == bytes(2) + len(body).to_bytes(2) and 3 <= len(body) <= FRAME_MOST:
                return int.from_bytes(octets[:2]), body
        raise self._silence(request)


def network_link(host: str, port: int, timeout_s: float, udp: bool) -> TcpLink:
    """Opened. Raises Unreachable."""
    if udp:
        return UdpLink(DatagramStream(host, port), timeout_s)
    return TcpLink(SocketStream(host, port, timeout_s), timeout_s)
