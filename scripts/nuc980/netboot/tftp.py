# SPDX-License-Identifier: GPL-3.0-or-later
"""The TFTP server of one board's files: RFC 1350 with the options of RFC 2347 to 2349, in its own thread.

Packets, contexts and states are tftpy's. tftpy's own server looks names up below a folder, believes whoever
sends to a session's port, takes any datagram for a sign of life, and ends with the first request that it
cannot decode; so what is served, who is heard, which options are agreed on, and when something is sent again
is decided here.
"""

from __future__ import annotations

import errno
import logging
import os
import re
import select
import socket
import struct
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

import psutil
from tftpy.TftpContexts import TftpContextServer
from tftpy.TftpPacketFactory import TftpPacketFactory
from tftpy.TftpPacketTypes import (
    TftpPacket,
    TftpPacketDAT,
    TftpPacketERR,
    TftpPacketInitial,
    TftpPacketRRQ,
)
from tftpy.TftpShared import TftpErrors, TftpException
from tftpy.TftpStates import TftpState

from nuc980.netboot.errors import TftpError

RETRANSMIT = 1.0  # s without an answer, unless the board asks for another time
TRIES = 10  # of one packet; U-Boot asks again after 5 s
REQUEST_LIMIT = 512  # bytes, RFC 2347
ACK = b"\0\4"
DATA = 3
HEADER = struct.Struct("!HH")  # opcode, block number
BLOCK_MIN, BLOCK_MAX = 8, 65464  # bytes, RFC 2348
TIMEOUTS = range(1, 256)  # s, RFC 2349
REFUSALS_KEPT = 32
GLANCE = 0.02  # s, how long a running transfer is all that is looked at
IP_PKTINFO = 8  # of linux/in.h; Python's socket has it from 3.12 on
TIMEVAL = struct.Struct("@ll")  # seconds, microseconds
PKTINFO = struct.Struct("@i4s4s")  # interface, local address, the datagram's destination

FACTORY = TftpPacketFactory()
Address = tuple[str, int]
Datagram = tuple[bytes, Address]

# It logs every strange datagram as an error. What matters of them is in FileService.refused.
logging.getLogger("tftpy").setLevel(logging.CRITICAL + 1)


@dataclass(frozen=True)
class Refusal:
    """A request that was not served, or not to its end."""

    address: str
    name: str
    reason: str

    def __str__(self) -> str:
        return f"{self.address}, {self.name!r}: {self.reason}"


@dataclass
class Transfer:
    """One offered or awaited file; another thread may watch it.

    moved: bytes acknowledged, or received, of the latest request. finished: the board has acknowledged the
    last block of one request, or the whole upload is on the disk. A last acknowledgement can get lost: a
    board that says that it has the file is right, whatever finished is.
    """

    name: str
    size: int
    moved: int = 0
    finished: bool = False


class FileService:
    """Serves one board, one transfer at a time, from `with` to its end.

    address: of this host, "" for all. port: UDP; 0 for any, and then .port is the one it has. board: the only
    client that gets an answer. refused: each refusal once, the latest last. Raises TftpError at `with`.
    """

    def __init__(self, address: str, port: int, board: str) -> None:
        self.port = port
        self.refused: list[Refusal] = []
        self._address, self._board = address, board
        self._offered: dict[str, _Offered] = {}
        self._awaited: dict[str, _Awaited] = {}
        self._session: _Session | None = None  # only the server's thread sets it
        self._lock = threading.Lock()  # nothing is withdrawn while a session begins with it
        self._running = False

    def __enter__(self) -> Self:
        self._socket = _server_socket(self._address, self.port)
        self.port = self._socket.getsockname()[1]
        self._wake = os.eventfd(0)
        self._events = select.epoll()
        self._events.register(self._socket, select.EPOLLIN)
        self._events.register(self._wake, select.EPOLLIN)
        self._running = True
        self._thread = threading.Thread(target=self._serve, name="tftp", daemon=True)
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._running = False
        os.eventfd_write(self._wake, 1)
        self._thread.join()
        self._events.close()
        os.close(self._wake)
        self._socket.close()

    @contextmanager
    def offer(self, name: str, source: Path, start: int = 0, size: int | None = None) -> Iterator[Transfer]:
        """Serves a file's bytes, as they are now, under this name; size None: to the file's end."""
        with source.open("rb") as file:
            file.seek(start)
            content = file.read() if size is None else file.read(size)
        offered = _Offered(Transfer(name, len(content)), content)
        with self._listed(offered, self._offered):
            yield offered.transfer

    @contextmanager
    def accept(self, name: str, target: Path, size: int) -> Iterator[Transfer]:
        """Takes one upload of this name, of exactly so many bytes, into a new file.

        A file that is not finished at the end is removed. Raises FileExistsError, for a symbolic link too.
        """
        descriptor = os.open(target, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o666)
        awaited = _Awaited(Transfer(name, size), descriptor)
        try:
            with self._listed(awaited, self._awaited):
                yield awaited.transfer
        finally:
            os.close(descriptor)
            if not awaited.transfer.finished:
                target.unlink(missing_ok=True)

    @contextmanager
    def _listed(self, file: _File, files: dict[str, _File]) -> Iterator[None]:
        name = file.transfer.name
        with self._lock:
            if name in files:
                raise ValueError(f"{name} is there already")
            files[name] = file
        try:
            yield
        finally:
            with self._lock:
                del files[name]
                session = self._session
            if session and session.transfer is file.transfer:
                session.withdrawn = True
                session.over.wait()

    # ---- the server's thread

    def _serve(self) -> None:
        try:
            while self._running:
                if self._session:
                    self._go_on(self._session)
                for descriptor, _ in self._events.poll(0 if self._session else None):
                    if descriptor == self._socket.fileno():
                        self._take_request()
        finally:
            if self._session:
                self._session.abort()
            self._replace_session(None)

    def _go_on(self, session: _Session) -> None:
        try:
            session.cycle()
        except _RefusedError as refused:
            self._note(session.host, session.transfer.name, refused)
            session.state.sendError(refused.code)
            session.state = None
        except TftpException:
            session.state = None
        if session.state is None:
            self._replace_session(None)

    def _replace_session(self, new: _Session | None) -> None:
        old, self._session = self._session, new
        if old:
            old.end()

    def _take_request(self) -> None:
        with suppress(OSError):  # as good as lost: the board asks again
            datagram, ancillary, _, peer = self._socket.recvmsg(
                REQUEST_LIMIT + 1, socket.CMSG_SPACE(PKTINFO.size)
            )
            _, local, destination = PKTINFO.unpack(ancillary[0][2])
            if len(datagram) <= REQUEST_LIMIT and local == destination:  # no answer to broadcasts: RFC 1123
                self._answer(datagram, peer, local)

    def _answer(self, datagram: bytes, peer: Address, local: bytes) -> None:
        request = _parsed(datagram)
        try:
            with self._lock:
                file = self._file_for(request, peer)
                if not self._is_repeated(datagram, peer):
                    self._open(file, request, _Session(file.transfer, datagram, peer, local))
        except _RefusedError as refused:
            self._note(peer[0], getattr(request, "filename", ""), refused)
            if peer[0] == self._board and not _is_error(datagram):
                source = (socket.IPPROTO_IP, IP_PKTINFO, PKTINFO.pack(0, local, bytes(4)))
                self._socket.sendmsg([_error(refused.code)], [source], 0, peer)

    def _file_for(self, request: TftpPacket | None, peer: Address) -> _File:
        if peer[0] != self._board:
            raise _RefusedError(TftpErrors.AccessViolation, f"the board is {self._board}")
        if not isinstance(request, TftpPacketInitial):
            raise _RefusedError(TftpErrors.IllegalTftpOp, "not a request of TFTP")
        if request.mode != "octet":
            raise _RefusedError(TftpErrors.IllegalTftpOp, f"mode {request.mode!r}, not octet")
        if isinstance(request, TftpPacketRRQ):
            if request.filename not in self._offered:
                raise _RefusedError(TftpErrors.FileNotFound, "not offered")
            return self._offered[request.filename]
        if request.filename not in self._awaited:
            raise _RefusedError(TftpErrors.AccessViolation, "no upload of this name is awaited")
        return self._awaited[request.filename]

    def _is_repeated(self, datagram: bytes, peer: Address) -> bool:
        """Whether the running session is the answer to this request already; it answers again if need be."""
        session = self._session
        return session is not None and session.request == (datagram, peer) and session.answers_again()

    def _open(self, file: _File, request: TftpPacketInitial, session: _Session) -> None:
        """Goes over to a new session. U-Boot does one transfer at a time: the one before is forgotten."""
        try:
            file.begin(session, {name.lower(): value for name, value in request.options.items()})
            session.begun()
        except BaseException:
            session.end()
            raise
        self._replace_session(session)

    def _note(self, address: str, name: str, refused: _RefusedError) -> None:
        new = Refusal(address, name, str(refused))
        self.refused = [*(old for old in self.refused if old != new), new][-REFUSALS_KEPT:]


# ---- what there is to transfer


@dataclass(frozen=True)
class _Offered:
    transfer: Transfer
    content: bytes

    def begin(self, session: _Session, asked: dict[str, str]) -> None:
        """Sends the options that are agreed on, which are acknowledged as block 0, else block 1."""
        session.agree(asked, tsize=len(self.content))
        state = session.state = _Sending(session, self.content)
        if session.options:
            state.sendOACK()
        else:
            state.send_block()


@dataclass(frozen=True)
class _Awaited:
    transfer: Transfer
    descriptor: int

    def begin(self, session: _Session, asked: dict[str, str]) -> None:
        """Acknowledges the request by the options that are agreed on, else as block 0."""
        if self.transfer.finished:
            raise _RefusedError(TftpErrors.FileAlreadyExists, "is here already")
        announced = _number(asked.get("tsize", "0"))
        if announced > self.transfer.size:
            raise _RefusedError(TftpErrors.DiskFull, f"{announced} bytes, {self.transfer.size} are awaited")
        session.agree(asked, tsize=announced)
        state = session.state = _Receiving(session, self.descriptor)
        if session.options:
            state.sendOACK()
        else:
            state.sendACK(0)


_File = _Offered | _Awaited


# ---- one transfer under way


class _Session(TftpContextServer):
    """A transfer with one port of the board, and the request that it answers."""

    def __init__(self, transfer: Transfer, datagram: bytes, peer: Address, local: bytes) -> None:
        super().__init__(*peer, RETRANSMIT, root="", flock=False)
        self.sock.close()
        self.sock = _Socket()
        self.sock.bind((socket.inet_ntoa(local), 0))  # the board expects the answer from where it asked
        self.tidport = self.port
        self.peer = peer
        self.request = (datagram, peer)
        self.transfer = transfer
        self.withdrawn = False  # set by another thread: there is no more to come
        self.over = threading.Event()

    def agree(self, asked: dict[str, str], tsize: int) -> None:
        """Of the options asked for, takes what can be done; the others stay unanswered (RFC 2347)."""
        self.options = {}
        for name, value in asked.items():
            number = _number(value)
            match name:
                case "blksize" if number >= BLOCK_MIN:
                    self.options["blksize"] = min(number, BLOCK_MAX)
                case "timeout" if number in TIMEOUTS:
                    self.options["timeout"] = number
                    self.timeout = float(number)
                case "tsize" if number >= 0:
                    self.options["tsize"] = tsize
        self.longest = HEADER.size + self.getBlocksize() + 1

    def begun(self) -> None:
        if self.last_pkt:
            self.sent = self.last_pkt.buffer
        self.first_answer = self.sent
        self.advance(0)

    def cycle(self) -> None:
        """Takes what comes within GLANCE, and does what is due.

        A datagram that is not the board's, or none of TFTP, is as if it had not come.
        """
        received = self.state.receive()
        if received:
            datagram, peer = received
            if peer == self.peer:
                packet = _parsed(datagram)
                self.state = self.state.handle(packet, *peer) if packet else self.state
            elif not _is_error(datagram):
                self.sock.sendto(_error(TftpErrors.UnknownTID), peer)
        if self.withdrawn:
            self.abort()
        elif self.state and not self.patience():
            self._lose_patience()

    def receive(self) -> Datagram | None:
        """The next datagram; None when there is none within GLANCE."""
        try:
            return self.sock.recvfrom(self.longest)
        except OSError:
            return None

    def advance(self, moved: int) -> None:
        """The board has moved the transfer on; nothing else is a sign of life."""
        self.transfer.moved = moved
        self.last_update = time.monotonic()
        self.retry_count = 0

    def patience(self) -> float:
        """Seconds left for the board to answer."""
        return max(0.0, self.last_update + self.timeout - time.monotonic())

    def _lose_patience(self) -> None:
        """Sends the last packet again, and gives up in the end."""
        self.last_update = time.monotonic()
        self.retry_count += 1
        if self.retry_count == TRIES:
            self.state = None
        else:
            self.state.resendLast()

    def resend(self) -> None:
        self.sock.sendto(self.sent, self.peer)

    def answers_again(self) -> bool:
        """Whether the request that has come once more is this session's business.

        As long as nothing came back, the first answer is lost. Soon after a sign of life the request is a
        duplicate. Later the board starts anew from the same port, as U-Boot always does with tftpsrcp.
        """
        if self.sent is self.first_answer:
            self.resend()
            return True
        return time.monotonic() - self.last_update < RETRANSMIT

    def abort(self) -> None:
        """Tells the board, if it is in the middle, that there is no more to come."""
        if self.state and self.transfer.moved < self.transfer.size:
            self.state.sendError(TftpErrors.AccessViolation)
        self.state = None

    def end(self) -> None:
        super().end()
        self.over.set()


class _Sending(TftpState):
    """A block is on its way to the board, and the one after it is ready."""

    def __init__(self, session: _Session, content: bytes) -> None:
        super().__init__(session)
        self._content, self._block_size = content, session.getBlocksize()
        self._number = 0  # of the block on its way, counted beyond 65535; the options are number 0
        self._awaited = (ACK + bytes(2), session.peer)
        self._ready = self._block(1)

    def _block(self, number: int) -> bytes:
        """The last one is shorter than the others, and can be empty; b"" beyond it."""
        start = (number - 1) * self._block_size
        if start > len(self._content):
            return b""
        return HEADER.pack(DATA, number & 0xFFFF) + self._content[start : start + self._block_size]

    def send_block(self) -> None:
        """Sends what is ready; the next block is made while the board takes this one."""
        session, ready = self.context, self._ready
        session.sock.sendto(ready, session.peer)
        session.sent = ready
        self._awaited = (ACK + ready[2:4], session.peer)
        self._number += 1
        self._ready = self._block(self._number + 1)

    def receive(self) -> Datagram | None:
        """Sends block after block as they are acknowledged; returns, within GLANCE, what is something else.

        An acknowledgement that comes again is something else: it moves nothing (RFC 1123, 4.2.3.1).
        """
        session = self.context
        until = time.monotonic() + GLANCE
        while (received := session.receive()) == self._awaited:
            if not self._ready:
                session.advance(len(self._content))
                session.transfer.finished = True
                session.state = None
                return None
            self.send_block()
            session.advance((self._number - 1) * self._block_size)
            if session.last_update > until:
                return None
        return received

    def handle(self, packet: TftpPacket, address: str, port: int) -> _Sending:
        """All but the acknowledgement that is awaited: of no account, unless the board gives up."""
        if isinstance(packet, TftpPacketERR):
            raise TftpException("the board gave up")
        return self

    def resendLast(self) -> None:
        self.context.resend()


class _Receiving(TftpState):
    """A block is awaited from the board; after the last one, whether its acknowledgement has arrived."""

    def __init__(self, session: _Session, descriptor: int) -> None:
        super().__init__(session)
        self._descriptor = descriptor
        self._content = bytearray()
        session.next_block = 1

    def receive(self) -> Datagram | None:
        return self.context.receive()

    def handle(self, packet: TftpPacket, address: str, port: int) -> _Receiving:
        """Takes the next block; acknowledges the one before it again."""
        session = self.context
        if isinstance(packet, TftpPacketERR):
            raise TftpException("the board gave up")
        if not isinstance(packet, TftpPacketDAT) or len(packet.data) > session.getBlocksize():
            return self
        if packet.blocknumber == session.next_block and not session.transfer.finished:
            self._take(packet.data)
            self.sendACK()
            session.next_block += 1
        elif (packet.blocknumber + 1) % 0x10000 == session.next_block:
            self.sendACK(packet.blocknumber)
        return self

    def _take(self, data: bytes) -> None:
        transfer = self.context.transfer
        is_last = len(data) < self.context.getBlocksize()
        self._content += data
        if len(self._content) > transfer.size:
            raise _RefusedError(TftpErrors.DiskFull, f"more than {transfer.size} bytes")
        if is_last:
            self._save()
        self.context.advance(len(self._content))
        transfer.finished = is_last

    def _save(self) -> None:
        size = self.context.transfer.size
        if len(self._content) < size:
            raise _RefusedError(TftpErrors.DiskFull, f"{len(self._content)} bytes, {size} are awaited")
        try:
            with open(self._descriptor, "wb", closefd=False) as file:
                file.seek(0)  # a disk that was full may have taken a part
                file.write(self._content)
                file.flush()
                os.fsync(self._descriptor)
        except OSError as error:
            raise _RefusedError(TftpErrors.DiskFull, str(error.strerror)) from error

    def resendLast(self) -> None:
        """Leaves it to the board: after its last block, U-Boot takes any acknowledgement for that block's."""


class _Socket(socket.socket):
    """What cannot be sent now is as good as lost on the way: there are retransmissions."""

    def __init__(self) -> None:
        super().__init__(socket.AF_INET, socket.SOCK_DGRAM)
        for timeout in (socket.SO_RCVTIMEO, socket.SO_SNDTIMEO):  # the kernel's own: one system call less
            self.setsockopt(socket.SOL_SOCKET, timeout, TIMEVAL.pack(0, round(GLANCE * 1e6)))

    def sendto(self, data: bytes, address: Address) -> int:
        try:
            return super().sendto(data, address)
        except OSError:
            return 0


class _RefusedError(TftpException):
    """A request that is not served, by a TFTP error code, and why."""

    def __init__(self, code: int, reason: str) -> None:
        super().__init__(reason)
        self.code = code


def _parsed(datagram: bytes) -> TftpPacket | None:
    """None: it is no packet of TFTP."""
    try:
        return FACTORY.parse(datagram)
    except (TftpException, ValueError, struct.error):
        return None


def _is_error(datagram: bytes) -> bool:
    """Whether it must not be answered with an error: two servers might go on for ever."""
    return datagram[:2] == b"\0\5"


def _error(code: int) -> bytes:
    packet = TftpPacketERR()
    packet.errorcode = code
    return packet.encode().buffer


def _number(text: str) -> int:
    """-1: it is none."""
    return int(text) if text.isdecimal() else -1


# ---- the port


def _server_socket(address: str, port: int) -> socket.socket:
    server = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        server.setblocking(False)
        server.setsockopt(socket.IPPROTO_IP, IP_PKTINFO, 1)
        server.bind((address, port))
    except OSError as error:
        server.close()
        raise _why_not_bound(error, address, port) from error
    return server


def _why_not_bound(error: OSError, address: str, port: int) -> TftpError:
    what = f"No TFTP server at UDP port {port} of {address or 'this host'}: {error.strerror}."
    if error.errno == errno.EACCES:
        return TftpError(
            what,
            cause="Linux leaves ports below net.ipv4.ip_unprivileged_port_start to root",
            next_step=f"sudo sysctl net.ipv4.ip_unprivileged_port_start={port}; or --tftp-port 6969, if the"
            " board's U-Boot knows the variable tftpdstp (CONFIG_TFTP_PORT)",
        )
    if error.errno == errno.EADDRINUSE and (other := _other_netboot(port)):
        return TftpError(
            what,
            cause=f"another nuc980-netboot (process {other}) serves its board there",
            next_step="wait for it, or name another address of this host for this board: --server-ip ADDRESS",
        )
    if error.errno == errno.EADDRINUSE:
        return TftpError(
            what,
            cause=f"{_owners(port) or 'another program'} has the port",
            next_step="stop it (sudo systemctl stop tftpd-hpa, for one); sudo ss -lunp shows who has what",
        )
    if error.errno == errno.EADDRNOTAVAIL:
        return TftpError(
            what, cause="the address is none of this host's", next_step="ip address shows which ones it has"
        )
    return TftpError(what)


def _other_netboot(port: int) -> int | None:
    for process in _owning(port):
        with suppress(psutil.Error):
            if any(re.search(r"nuc980[-.]netboot", word) for word in process.cmdline()):
                return process.pid
    return None


def _owners(port: int) -> str:
    """Which processes have a UDP port, as far as this user may see them."""
    owners = set()
    for process in _owning(port):
        with suppress(psutil.Error):
            owners.add(f"{process.name()} (process {process.pid})")
    return ", ".join(sorted(owners))


def _owning(port: int) -> Iterator[psutil.Process]:
    with suppress(psutil.Error):
        for connection in psutil.net_connections("udp"):
            if connection.laddr and connection.laddr.port == port and connection.pid:
                yield psutil.Process(connection.pid)
