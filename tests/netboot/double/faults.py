# SPDX-License-Identifier: GPL-3.0-or-later
"""What can go wrong on a bench. A fault is asked at its moment, and counts for itself."""

from __future__ import annotations

import random
import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .board import Board


class Reset(Exception):
    """The board starts again: a brown-out, a watchdog."""


class Fault:
    """Nothing goes wrong. link: what the PHY says of the cable."""

    link = True

    def received(self, data: bytes) -> bytes:
        """What of the tool's bytes arrives."""
        return data

    def sent(self, data: bytes) -> bytes:
        """What of the board's bytes arrives."""
        return data

    def echo(self, board: Board, key: str) -> str:
        """What an echoed character becomes."""
        return key

    def prompt(self, board: Board) -> None:
        """Before the prompt."""

    def command(self, board: Board, words: list[str]) -> None:
        """Before a command runs."""

    def output(self, board: Board, words: list[str], text: str) -> str:
        """What a command's text becomes; asked piece by piece."""
        return text

    def network(self, board: Board) -> str | None:
        """What the network says instead of working."""
        return None

    def request(self, name: str) -> str:
        """The file that the board asks for."""
        return name

    def acknowledge(self, board: Board, block: int) -> int:
        """How often an ACK is sent."""
        return 1

    def hears(self, block: int) -> bool:
        """Whether a TFTP block arrives at all."""
        return True

    def arrived(self, board: Board, block: int, data: bytes) -> bytes | None:
        """What of a TFTP block arrives; None: the transfer ends here, and U-Boot takes it for whole."""
        return data

    def loaded(self, board: Board, address: int, size: int) -> None:
        """After a file has come."""

    def erases(self, board: Board, block: int) -> bool:
        """Whether the block can be erased."""
        return True

    def programs(self, board: Board, address: int, data: bytes) -> bytes | None:
        """What is programmed, within one block; None: it fails."""
        return data

    def written(self, board: Board, address: int, size: int) -> None:
        """After a write that U-Boot has verified."""


class Counted(Fault):
    """Strikes from the `at`-th time on, `times` times (0: for ever)."""

    def __init__(self, at: int = 1, times: int = 1) -> None:
        self.at, self.times = at, times
        self.seen = 0

    def strikes(self) -> bool:
        self.seen += 1
        late = self.seen - self.at
        return late >= 0 and (self.times == 0 or late < self.times)


# ---- the line


class DropsReceived(Fault):
    """Every n-th byte of the tool's is lost, up to `times` of them."""

    def __init__(self, every: int, times: int = 1_000_000) -> None:
        self.every, self.left = every, times
        self.seen = 0

    def received(self, data: bytes) -> bytes:
        kept = bytearray()
        for byte in data:
            self.seen += 1
            if self.left and self.seen % self.every == 0:
                self.left -= 1
            else:
                kept.append(byte)
        return bytes(kept)


class OverrunsFifo(Fault):
    """Of bytes that come at once only the FIFO's 16 arrive."""

    def received(self, data: bytes) -> bytes:
        return data[:16]


class DropsEcho(Counted):
    """Echoed characters are lost."""

    def echo(self, board: Board, key: str) -> str:
        return "" if self.strikes() else key


class WrongEcho(Counted):
    """Echoed characters are others."""

    def echo(self, board: Board, key: str) -> str:
        return chr(ord(key) ^ 4) if self.strikes() else key


class Noise(Fault):
    """A bit of a byte changes on the line, both ways, at a rate. enters: even of an Enter, or into one."""

    def __init__(self, rate: float, seed: int = 980, enters: bool = True) -> None:
        self.rate, self.random, self.enters = rate, random.Random(seed), enters

    def received(self, data: bytes) -> bytes:
        return self._noisy(data)

    def sent(self, data: bytes) -> bytes:
        return self._noisy(data)

    def _noisy(self, data: bytes) -> bytes:
        return bytes(self._byte(byte) if self.random.random() < self.rate else byte for byte in data)

    def _byte(self, byte: int) -> int:
        other = byte ^ 1 << self.random.randrange(8)
        spared = not self.enters and (byte in b"\r\n" or other in b"\r\n")
        return byte if spared else other


class Burst(Counted):
    """A few bytes of noise before a prompt."""

    def __init__(self, at: int = 1, times: int = 1, noise: bytes = b"\xff\xfe\x80~\x00\xf8") -> None:
        super().__init__(at, times)
        self.noise = noise

    def prompt(self, board: Board) -> None:
        if self.strikes():
            board.wire.puts(self.noise)


class SlowPrompt(Counted):
    """The prompt comes late."""

    def __init__(self, seconds: float, at: int = 1, times: int = 1) -> None:
        super().__init__(at, times)
        self.seconds = seconds

    def prompt(self, board: Board) -> None:
        if self.strikes():
            board.wire.pause(self.seconds)


class SlowEcho(Counted):
    """Echoed characters come late."""

    def __init__(self, seconds: float, at: int = 1, times: int = 20) -> None:
        super().__init__(at, times)
        self.seconds = seconds

    def echo(self, board: Board, key: str) -> str:
        if self.strikes():
            board.wire.pause(self.seconds)
        return key


class Unsolicited(Counted):
    """Somebody else writes on the console, before a command runs, or in the middle of its echo."""

    def __init__(self, text: str, at: int = 1, times: int = 1, within_echo: bool = False) -> None:
        super().__init__(at, times)
        self.text, self.within_echo = text, within_echo

    def command(self, board: Board, words: list[str]) -> None:
        if not self.within_echo and self.strikes():
            board.wire.puts(self.text)

    def echo(self, board: Board, key: str) -> str:
        if self.within_echo and self.strikes():
            board.wire.puts(self.text)
        return key


class Unplugged(Counted):
    """The port disappears before a command runs."""

    def command(self, board: Board, words: list[str]) -> None:
        if self.strikes():
            board.wire.unplug()


# ---- the board


class ResetsAt(Counted):
    """Starts again: before a `command`, at an `echo`, at a `tftp` block, in an `erase`, in a `program`."""

    def __init__(self, moment: str, at: int = 1) -> None:
        super().__init__(at)
        self.moment = moment

    def command(self, board: Board, words: list[str]) -> None:
        self._reset("command")

    def echo(self, board: Board, key: str) -> str:
        self._reset("echo")
        return key

    def arrived(self, board: Board, block: int, data: bytes) -> bytes | None:
        self._reset("tftp")
        return data

    def erases(self, board: Board, block: int) -> bool:
        """The block is half erased: its pages fit no ECC."""
        if self.moment == "erase" and self.strikes():
            board.nand.erase(block)
            board.nand.spoil(block * 0x20000)
            raise Reset
        return True

    def programs(self, board: Board, address: int, data: bytes) -> bytes | None:
        """The block's first page is half programmed, the rest not at all."""
        if self.moment == "program" and self.strikes():
            board.nand.program(address, data, good=False)
            raise Reset
        return data

    def _reset(self, moment: str) -> None:
        if self.moment == moment and self.strikes():
            raise Reset


class HangsAt(Counted):
    """Says no more, but for its last words, at a command whose line matches, until the supply goes off."""

    def __init__(self, pattern: str, at: int = 1, last: str = "") -> None:
        super().__init__(at)
        self.pattern, self.last = pattern, last

    def command(self, board: Board, words: list[str]) -> None:
        if re.search(self.pattern, " ".join(words)) and self.strikes():
            board.wire.puts(self.last)
            board.wire.deaf()


class Refuses(Counted):
    """A command says something else and fails: `Refuses("nand read", "** out of memory\\n")`."""

    def __init__(self, pattern: str, text: str, at: int = 1, times: int = 1) -> None:
        super().__init__(at, times)
        self.pattern, self.text = pattern, text

    def command(self, board: Board, words: list[str]) -> None:
        if re.search(self.pattern, " ".join(words)) and self.strikes():
            raise Refused(self.text)


class Refused(Exception):
    """A command's text in its place; it fails."""


class Misprints(Counted):
    """A command's text is noisy: `pattern` becomes `noise` in it, whatever command `of` matches."""

    def __init__(self, of: str, pattern: str, noise: str, at: int = 1, times: int = 1) -> None:
        super().__init__(at, times)
        self.of, self.pattern, self.noise = of, pattern, noise

    def output(self, board: Board, words: list[str], text: str) -> str:
        if re.search(self.of, " ".join(words)) and re.search(self.pattern, text) and self.strikes():
            return re.sub(self.pattern, self.noise, text, count=1)
        return text


def wrong_crc(at: int = 1, times: int = 1) -> Misprints:
    """crc32 says a wrong number."""
    return Misprints("^crc32", r"(?<===> )[0-9a-f]{8}", "deadbeef", at, times)


def noisy_dump(at: int = 1, times: int = 1) -> Misprints:
    """md prints a byte that is not there."""
    return Misprints("^md", r"(?<=: )[0-9a-f]{2}", "!Z", at, times)


# ---- the network


class NetworkSays(Counted):
    """A network command fails with these words: see below."""

    def __init__(self, text: str, at: int = 1, times: int = 0) -> None:
        super().__init__(at, times)
        self.text = text

    def network(self, board: Board) -> str | None:
        return self.text if self.strikes() else None


NO_ETHERNET = "No ethernet found.\n"
BAD_ADDRESS = "\nError: emac address 01:02:03:04:05:06 illegal value\nNo ethernet found.\n"


class NoLink(Counted):
    """No cable: 2023.01 says so, the vendor's driver waits for an answer that nobody gives."""

    link = False

    def __init__(self, at: int = 1, times: int = 0) -> None:
        super().__init__(at, times)

    def network(self, board: Board) -> str | None:
        if not self.strikes():
            return None
        if board.variant.name == "ours":
            return "emac0 Waiting for PHY auto negotiation to complete......... TIMEOUT !\nemac0: no link\n"
        return "AN failed. Set to 100 FULL\n"


class ArpFails(Counted):
    """Nobody answers for the server's address."""

    def __init__(self, at: int = 1, times: int = 0) -> None:
        super().__init__(at, times)

    def network(self, board: Board) -> str | None:
        return "\nARP Retry count exceeded; starting again\n" if self.strikes() else None


class AsksFor(Fault):
    """Another file: what a server says to it is its own."""

    def __init__(self, name: str) -> None:
        self.name = name

    def request(self, name: str) -> str:
        return self.name


class LosesAcks(Counted):
    """ACKs get lost: after the time-out they are sent again."""

    def acknowledge(self, board: Board, block: int) -> int:
        return 0 if self.strikes() else 1


class DuplicatesAcks(Counted):
    """ACKs come twice: the sorcerer's apprentice."""

    def acknowledge(self, board: Board, block: int) -> int:
        return 2 if self.strikes() else 1


class EndsEarly(Counted):
    """U-Boot takes a block for the last: a truncated file."""

    def arrived(self, board: Board, block: int, data: bytes) -> bytes | None:
        return None if self.strikes() else data


class StopsHearing(Fault):
    """From a block on no datagram arrives: in every transfer, or in the first `times` that get so far."""

    def __init__(self, block: int, times: int = 0) -> None:
        self.block, self.times = block, times
        self.transfers = 0

    def request(self, name: str) -> str:
        self.transfers += 1
        return name

    def hears(self, block: int) -> bool:
        return block < self.block or bool(self.times and self.transfers > self.times)


class FlipsInRam(Counted):
    """A bit is wrong in what a load has left in the RAM."""

    def __init__(self, offset: int = 100, at: int = 1, times: int = 1) -> None:
        super().__init__(at, times)
        self.offset = offset

    def loaded(self, board: Board, address: int, size: int) -> None:
        if self.strikes():
            board.ram[address + self.offset] ^= 0x10


# ---- the flash


class CannotErase(Fault):
    """A block whose erase fails: `nand erase` says so, and OK at its end."""

    def __init__(self, *blocks: int) -> None:
        self.blocks = blocks

    def erases(self, board: Board, block: int) -> bool:
        return block not in self.blocks


class CannotProgram(Fault):
    """A block whose program fails."""

    def __init__(self, *blocks: int) -> None:
        self.blocks = blocks

    def programs(self, board: Board, address: int, data: bytes) -> bytes | None:
        return None if address // 0x20000 in self.blocks else data


class ForgetsAfterWrite(Counted):
    """A byte of a block is another one after U-Boot's own check; its ECC sees nothing."""

    def written(self, board: Board, address: int, size: int) -> None:
        if self.strikes():
            board.nand.wear(address + 7)
