# SPDX-License-Identifier: GPL-3.0-or-later
"""tftpboot and tftpput with a TFTP client of their own over UDP: net/tftp.c and net/net.c; ping and mii."""

from __future__ import annotations

import socket
import struct
import time
from typing import TYPE_CHECKING

from .text import size_text, whole_number

if TYPE_CHECKING:
    from .board import Board

RRQ, WRQ, DATA, ACK, ERROR, OACK = range(1, 7)
HASHES_PER_LINE = 65
NO_DEVICE = "MII devices: \n"
PHY, LINK_UP = 1, 0x786D  # its address; its status register
PHY_INFO = "PHY 0x01: OUI = 0x90C3, Model = 0x05, Rev = 0x04, 100baseT, FDX\n"
IP_RECVERR = 11  # of <linux/in.h>: "port unreachable" becomes ECONNREFUSED


class Failed(Exception):
    """The transfer is over; the text has been printed."""


def tftpboot(board: Board, words: list[str], repeat: bool) -> int:
    if len(words) == 2:
        address = whole_number(words[1])
        if address is None:
            board.boot_file = words[1]
        else:
            board.load_address = address
    elif len(words) == 3:
        board.load_address, board.boot_file = board.number(words[1]), words[2]
    return _transfer(board, None)


def tftpput(board: Board, words: list[str], repeat: bool) -> int:
    if len(words) != 4:
        return board.usage("tftpput")
    board.boot_file = words[3]
    return _transfer(board, (board.number(words[1]), board.number(words[2])))


def ping(board: Board, words: list[str], repeat: bool) -> int:
    if len(words) < 2:
        return board.usage("ping")
    if not _ready(board, server=False):
        return 1
    board.puts(f"Using {board.port_name} device\nhost {words[1]} is alive\n")
    return 0


def net(board: Board, words: list[str], repeat: bool) -> int:
    if words[1:] != ["list"]:
        return board.usage("net")
    current = _start_port(board)
    for number, name in enumerate(board.variant.ports):
        address = board.variables.get(f"eth{number or ''}addr", "00:00:00:00:00:00")
        board.puts(f"eth{number} : {name} {address} {'active' if name == current else ''}\n")
    return 0


def mii(board: Board, words: list[str], repeat: bool) -> int:
    current = _start_port(board, quiet=True)
    match words[1:]:
        case ["device"]:
            board.puts(f"MII devices: '{current}' \nCurrent device: '{current}'\n" if current else NO_DEVICE)
            return 0
        case ["info"]:
            board.puts(PHY_INFO if current else "NULL device name!\nNo such device: <NULL>\n" * 32)
            return 0
        case ["read", address, register]:
            phy, number = board.number(address), board.number(register)
            if not current:
                board.puts("NULL device name!\nNo such device: <NULL>\n")
                board.puts(f"Error reading from the PHY addr={phy:02x} reg={number:02x}\n")
                return 1
            link = all(fault.link for fault in board.faults)
            status = LINK_UP if link else LINK_UP & ~4
            board.puts(f"{status if (phy, number) == (PHY, 1) else 0xFFFF:04X}\n")
            return 0
    return board.usage("mii")


def current_port(board: Board) -> str:
    """What 2023.01's bdinfo says of the port: without an address there is none."""
    name = _start_port(board)
    return f"current eth = {name or 'unknown'}"


def _start_port(board: Board, quiet: bool = False) -> str:
    """The port that an address makes usable, "" without one, and then the words of that."""
    if board.variables.get("ethaddr"):
        return board.variant.ports[0]
    if not quiet and board.variant.name == "ours":
        board.puts("\nError: emac0 address not set.\n" * 2)
    return ""


def _address(board: Board) -> str:
    port = board.variant.ports.index(board.port_name)
    return board.variables.get("ethaddr" if port == 0 else f"eth{port}addr", "")


def _ready(board: Board, server: bool = True) -> bool:
    """As eth_init and net_check_prereq; 2023.01 wants an address to start the port at all."""
    board.port_name = board.variables.get("ethact", board.variant.ports[0])
    if board.port_name not in board.variant.ports:
        board.port_name = board.variant.ports[0]
    for fault in board.faults:
        if (text := fault.network(board)) is not None:
            board.puts(text)
            return False
    if board.variant.name == "ours" and not _address(board):
        board.puts(("\nError: emac0 address not set.\n" * 8) + "No ethernet found.\n")
        board.puts("\nError: emac0 address not set.\n" * 2)
        return False
    if server and not board.variables.get("serverip"):
        board.puts("*** ERROR: `serverip' not set\n")
        return False
    if not board.variables.get("ipaddr"):
        board.puts("*** ERROR: `ipaddr' not set\n")
        return False
    if not _address(board):
        board.puts("*** ERROR: `ethaddr' not set\n")
        return False
    board.variables.setdefault("ethact", board.port_name)
    return True


def _transfer(board: Board, saved: tuple[int, int] | None) -> int:
    for _ in range(1 + _retries(board)):
        if not _ready(board):
            return 1
        with Transfer(board, saved) as transfer:
            try:
                size = transfer.run()
            except Failed:
                if transfer.final:
                    return 1
                continue
        if size:
            board.puts(f"Bytes transferred = {size} ({size:x} hex)\n")
            board.variables["filesize"] = f"{size:x}"
            board.variables["fileaddr"] = f"{board.load_address:x}"
        if saved is None:
            for fault in board.faults:
                fault.loaded(board, board.load_address, size)
        return 0
    return 1


def _retries(board: Board) -> int:
    """netretry: without it "starting again" is said and not done."""
    value = board.variables.get("netretry", "no")
    known = {"no": 0, "once": 1, "yes": 1_000_000}
    return known[value] if value in known else max(0, int(value) - 1)


class Transfer:
    """One transfer: a socket, a block number, a time-out. final: what failed is not tried again."""

    def __init__(self, board: Board, saved: tuple[int, int] | None) -> None:
        self.board, self.saved = board, saved
        self.final = False
        variables = board.variables
        self.server = variables["serverip"]
        self.name = board.boot_file or _default_name(variables["ipaddr"])
        if ":" in self.name:
            self.server, _, self.name = self.name.partition(":")
        for fault in board.faults:
            self.name = fault.request(self.name)
        self.block_size = 512
        self.timeout = max(1000, int(variables.get("tftptimeout", "5000")))
        self.patience = int(variables.get("tftptimeoutcountmax", "10"))
        self.peer = board.server(self.server)
        self.started = False
        self.wraps = 0
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind((variables["ipaddr"] if variables["ipaddr"].startswith("127.") else "", 0))
        if board.variant.port_unreachable:
            self.socket.setsockopt(socket.IPPROTO_IP, IP_RECVERR, 1)

    def __enter__(self) -> Transfer:
        return self

    def __exit__(self, *_: object) -> None:
        self.socket.close()

    def run(self) -> int:
        """The bytes transferred."""
        board = self.board
        way = "from" if self.saved is None else "to"
        board.puts(f"Using {board.port_name} device\n")
        board.puts(f"TFTP {way} server {self.server}; our IP address is {board.variables['ipaddr']}\n")
        board.puts(f"Filename '{self.name}'.\n")
        size = self._load() if self.saved is None else self._save(*self.saved)
        rate = size // max(1, size >> 12) * 1000  # as if a millisecond took 4 KiB
        board.puts((f"\n\t {size_text(rate)}/s" if size >> 12 else "") + "\ndone\n")
        return size

    def _load(self) -> int:
        board = self.board
        if board.variant.guards_itself and board.load_address >= board.own_memory:
            board.puts("\nTFTP error: trying to overwrite reserved memory...\n")
            self.final = True
            raise Failed
        board.puts(f"Load address: 0x{board.load_address:x}\nLoading: *\b")
        request = self._request(RRQ)
        send, size, last = request, 0, 0
        while True:
            kind, number, content = self._answer(send, last)
            if kind == OACK:
                send = self._acknowledge(0)
                continue
            if kind != DATA or (number == last and self.started):
                continue
            if not self.started and number != 1:
                board.puts(f"\nTFTP error: First block is not block 1 ({number})\nStarting again\n\n")
                raise Failed
            self.started = True
            if number == 0 and last:
                self.wraps += 1
            else:
                self._mark(number)
            arrived = self._arrived(number, content)
            end = arrived is None
            content = content[: self.block_size // 2] if arrived is None else arrived
            offset = ((self.wraps << 16) + number - 1) * self.block_size
            board.store(board.load_address + offset, content)
            size, last = max(size, offset + len(content)), number
            send = self._acknowledge(number)
            if end or len(content) < self.block_size:
                return size

    def _save(self, address: int, size: int) -> int:
        board = self.board
        board.puts(f"Save address: 0x{address:x}\nSave size:    0x{size:x}\nSaving: *\b")
        send, block = self._request(WRQ), 0
        while True:
            kind, number, _ = self._answer(send, block)
            if kind == ACK and number != block & 0xFFFF:
                continue
            if kind not in (ACK, OACK):
                continue
            if block and (block - 1) * self.block_size + self.block_size > size:
                return size
            block += 1
            self._mark(block & 0xFFFF)
            start = (block - 1) * self.block_size
            content = board.memory(address + start, max(0, min(self.block_size, size - start)))
            send = struct.pack(">HH", DATA, block & 0xFFFF) + content
            self._send(send)

    def _request(self, opcode: int) -> bytes:
        strings = (
            self.name,
            "octet",
            "timeout",
            str(self.timeout // 1000),
            "blksize",
            self.board.variables.get("tftpblocksize", "1468"),
        )
        request = struct.pack(">H", opcode) + b"".join(text.encode() + b"\0" for text in strings)
        self._send(request)
        return request

    def _acknowledge(self, number: int) -> bytes:
        acknowledgement = struct.pack(">HH", ACK, number)
        times = 1
        for fault in self.board.faults:
            times = min(times, 1) * fault.acknowledge(self.board, number) if times else 0
        for _ in range(times):
            self._send(acknowledgement)
        return acknowledgement

    def _arrived(self, number: int, content: bytes) -> bytes | None:
        for fault in self.board.faults:
            arrived = fault.arrived(self.board, number, content)
            if arrived is None:
                return None
            content = arrived
        return content

    def _send(self, datagram: bytes) -> None:
        try:
            self.socket.sendto(datagram, self.peer)
        except ConnectionRefusedError:
            self._died()
        except OSError:  # no route: as if nobody had answered the ARP request
            self.board.puts("\nARP Retry count exceeded; starting again\n")
            raise Failed from None

    def _answer(self, again: bytes, last: int) -> tuple[int, int, bytes]:
        """The next datagram of the server's; what is unanswered is sent again at each time-out."""
        board, count = self.board, 0
        deadline = time.monotonic() + self.timeout / 1000 * board.second
        while True:
            if board.wire.tstc() and board.wire.getc() == 3:
                board.puts("\nAbort\n")
                self.final = True
                raise Failed
            self.socket.settimeout(max(0.001, min(0.05, deadline - time.monotonic())))
            try:
                datagram, source = self.socket.recvfrom(65536)
            except ConnectionRefusedError:
                self._died()
            except TimeoutError:
                if time.monotonic() < deadline:
                    continue
                count += 1
                if count > self.patience:
                    board.puts("\nRetry count exceeded; starting again\n")
                    raise Failed from None
                board.puts("T ")
                self._send(again)
                deadline = time.monotonic() + self.timeout / 1000 * board.second
                continue
            if len(datagram) < 4 or (self.started and source != self.peer):
                continue
            kind, number = struct.unpack(">HH", datagram[:4])
            if kind == ERROR:
                self._error(number, datagram[4:])
            if kind == OACK:
                self._options(datagram[2:])
                number = 0
            if not all(fault.hears(number) for fault in board.faults):
                continue
            self.peer = source
            return kind, number, datagram[4:]

    def _options(self, data: bytes) -> None:
        strings = data.split(b"\0")
        for name, value in zip(strings[::2], strings[1::2], strict=False):
            if name.lower() == b"blksize":
                self.block_size = int(value)

    def _error(self, code: int, text: bytes) -> None:
        message = text.split(b"\0")[0].decode("latin-1")
        self.board.puts(f"\nTFTP error: '{message}' ({code})\n")
        self.final = code in (1, 2)
        self.board.puts("Not retrying...\n" if self.final else "Starting again\n\n")
        raise Failed

    def _died(self) -> None:
        self.board.puts("\nTFTP server died; starting again\n")
        raise Failed

    def _mark(self, number: int) -> None:
        if (number - 1) % 10 == 0:
            self.board.puts("#")
        elif number % (10 * HASHES_PER_LINE) == 0:
            self.board.puts("\n\t ")


def _default_name(address: str) -> str:
    return "".join(f"{int(part):02X}" for part in address.split(".")) + ".img"
