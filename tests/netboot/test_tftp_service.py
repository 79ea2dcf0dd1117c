# SPDX-License-Identifier: GPL-3.0-or-later
"""The TFTP server, by datagrams: what it sends to the board, what it refuses, and what cannot end it."""

import gc
import os
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from nuc980.netboot import tftp
from nuc980.netboot.errors import TftpError
from nuc980.netboot.tftp import FileService, Refusal

BOARD, STRANGER, SERVER = "127.0.0.9", "127.0.0.8", "127.0.0.5"
RRQ, WRQ, DATA, ACK, ERROR, OACK = range(1, 7)
NOT_FOUND, NO_ACCESS, DISK_FULL, ILLEGAL, UNKNOWN_TID, EXISTS = range(1, 7)
SOON = 60.0  # s at most, for what comes at once


def request(opcode: int, name: str | bytes, mode: bytes = b"octet", **options: object) -> bytes:
    strings = [name.encode() if isinstance(name, str) else name, mode]
    for key, value in options.items():
        strings += [key.encode(), value if isinstance(value, bytes) else str(value).encode()]
    return struct.pack("!H", opcode) + b"".join(string + b"\0" for string in strings)


def block(opcode: int, number: int, data: bytes = b"") -> bytes:
    return struct.pack("!HH", opcode, number % 0x10000) + data


class Port:
    """A client's UDP port, which talks to one port of the server: the one that answers its request."""

    def __init__(self, service: FileService, address: str = BOARD, at: str = SERVER) -> None:
        self.service = (at, service.port)
        self.peer: tuple[str, int] = self.service
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind((address, 0))

    def __del__(self) -> None:
        self.socket.close()

    def ask(self, datagram: bytes) -> bytes:
        """The first answer to a request; who sent it is the peer from now on."""
        self.socket.sendto(datagram, self.service)
        self.socket.settimeout(SOON)
        answer, self.peer = self.socket.recvfrom(70_000)
        return answer

    def send(self, datagram: bytes) -> None:
        self.socket.sendto(datagram, self.peer)

    def hear(self, seconds: float = SOON) -> bytes:
        """The next datagram of the peer; b"" when none comes."""
        self.socket.settimeout(seconds)
        try:
            datagram, peer = self.socket.recvfrom(70_000)
        except (TimeoutError, BlockingIOError):
            return b""
        assert peer == self.peer
        return datagram

    def read(self, name: str, block_size: int = 512, **options: object) -> bytes:
        """A whole file."""
        if block_size != 512:
            options["blksize"] = block_size
        return self.read_on(self.ask(request(RRQ, name, **options)), block_size)

    def read_on(self, heard: bytes, block_size: int = 512) -> bytes:
        """The rest of a file, after the first answer."""
        content, number = [], 0
        if heard[1] == OACK:
            self.send(block(ACK, 0))
            heard = self.hear_after(heard)
        while True:
            number += 1
            assert heard[:4] == block(DATA, number), (number, heard[:40])
            self.send(block(ACK, number))
            content.append(heard[4:])
            if len(heard) - 4 < block_size:
                return b"".join(content)
            heard = self.hear_after(heard)

    def hear_after(self, before: bytes) -> bytes:
        """The next one that is no repetition: on a busy host the server may have lost patience."""
        while (heard := self.hear()) == before:
            pass
        return heard

    def write(self, name: str, content: bytes, block_size: int = 512) -> None:
        """A whole upload, as U-Boot does it."""
        asked = request(WRQ, name, timeout=5, tsize=len(content), blksize=block_size)
        assert self.ask(asked)[1] == OACK
        for start in range(0, len(content) + 1, block_size):
            number = start // block_size + 1
            self.send(block(DATA, number, content[start : start + block_size]))
            assert self.hear() == block(ACK, number)


def settle(service: FileService, datagrams: int = 1) -> None:
    """Until the server has taken so many datagrams sent before: it takes one of each port in turn."""
    for _ in range(datagrams + 1):
        assert Port(service).ask(request(RRQ, "nothing of this name"))[:4] == block(ERROR, NOT_FOUND)


def content_of(size: int) -> bytes:
    return bytes(number * 7 % 251 for number in range(size))


@pytest.fixture
def service() -> Iterator[FileService]:
    with FileService("", 0, BOARD) as service:
        yield service


@pytest.fixture
def uimage(tmp_path: Path) -> Path:
    """Three blocks of 512 bytes, of which the last is shorter."""
    path = tmp_path / "some file"
    path.write_bytes(content_of(1300))
    return path


@pytest.fixture
def hasty(monkeypatch: pytest.MonkeyPatch) -> float:
    """Seconds after which the server sends again, unless the client asks for more."""
    monkeypatch.setattr(tftp, "RETRANSMIT", 0.05)
    return tftp.RETRANSMIT


# ---- what is sent


@pytest.mark.parametrize("block_size", [8, 512, 1468])
@pytest.mark.parametrize("size", [0, 1, 7, 8, 512, 1024, 1468, 14_680, 14_681])
def test_a_file_comes_whole(service: FileService, tmp_path: Path, size: int, block_size: int) -> None:
    (tmp_path / "file").write_bytes(content_of(size))
    with service.offer("uImage", tmp_path / "file") as transfer:
        assert Port(service).read("uImage", block_size) == content_of(size)
        settle(service)
        assert (transfer.name, transfer.size, transfer.moved, transfer.finished) == (
            "uImage",
            size,
            size,
            True,
        )


def test_a_part_of_a_file(service: FileService, uimage: Path) -> None:
    with service.offer("part", uimage, start=100, size=700) as transfer:
        assert transfer.size == 700
        assert Port(service).read("part") == content_of(1300)[100:800]
    with service.offer("rest", uimage, start=1000) as transfer:
        assert transfer.size == 300
        assert Port(service).read("rest", tsize=0) == content_of(1300)[1000:]


def test_the_bytes_are_those_of_the_offer(service: FileService, uimage: Path) -> None:
    with service.offer("uImage", uimage):
        uimage.write_bytes(b"a build went on")
        assert Port(service).read("uImage") == content_of(1300)


def test_no_file_is_no_offer(service: FileService, tmp_path: Path) -> None:
    for path in (tmp_path / "nothing", tmp_path):
        with pytest.raises(OSError, match=str(tmp_path)), service.offer("uImage", path):
            pass


def test_progress_is_what_was_acknowledged(service: FileService, uimage: Path) -> None:
    board = Port(service)
    with service.offer("uImage", uimage) as transfer:
        board.ask(request(RRQ, "uImage"))
        seen = []
        for number in (1, 2, 3):
            seen.append((transfer.moved, transfer.finished))
            board.send(block(ACK, number))
            settle(service)
        seen.append((transfer.moved, transfer.finished))
        assert seen == [(0, False), (512, False), (1024, False), (1300, True)]


@pytest.mark.parametrize("address", ["", SERVER])
def test_the_answer_comes_from_where_was_asked(uimage: Path, address: str) -> None:
    with FileService(address, 0, BOARD) as service, service.offer("uImage", uimage):
        board = Port(service, at=SERVER)
        board.ask(request(RRQ, "uImage"))
        assert board.peer[0] == SERVER
        assert board.peer[1] != service.port  # RFC 1350: a port of its own for each transfer
        refused = Port(service, at=SERVER)
        refused.ask(request(RRQ, "other"))
        assert refused.peer[0] == SERVER


BLOCK_1 = block(DATA, 1, content_of(512))


@pytest.mark.parametrize(
    ("asked", "answer"),
    [
        ({}, BLOCK_1),
        ({"blksize": 1468}, b"\0\6blksize\x001468\0"),
        ({"BlkSize": 1468}, b"\0\6blksize\x001468\0"),
        ({"blksize": 8}, b"\0\6blksize\x008\0"),
        ({"blksize": 65464}, b"\0\6blksize\x0065464\0"),
        ({"blksize": 65465}, b"\0\6blksize\x0065464\0"),
        ({"blksize": "9" * 400}, b"\0\6blksize\x0065464\0"),
        ({"blksize": 7}, BLOCK_1),
        ({"blksize": 0}, BLOCK_1),
        ({"blksize": -512}, BLOCK_1),
        ({"blksize": "abc"}, BLOCK_1),
        ({"blksize": "1_468"}, BLOCK_1),
        ({"blksize": " 1468"}, BLOCK_1),
        ({"blksize": "0x200"}, BLOCK_1),
        ({"tsize": 0}, b"\0\6tsize\x001300\0"),
        ({"tsize": 4711}, b"\0\6tsize\x001300\0"),  # U-Boot sends the size of the file before
        ({"tsize": "much"}, BLOCK_1),
        ({"timeout": 5}, b"\0\6timeout\x005\0"),
        ({"timeout": 255}, b"\0\6timeout\x00255\0"),
        ({"timeout": 0}, BLOCK_1),
        ({"timeout": 256}, BLOCK_1),
        ({"timeout": -1}, BLOCK_1),
        ({"windowsize": 4}, BLOCK_1),
        ({"windowsize": 4, "tsize": 0, "rollover": 1}, b"\0\6tsize\x001300\0"),
        (
            {"timeout": 5, "tsize": 0, "blksize": 1468},  # U-Boot 2023.01
            b"\0\6timeout\x005\0tsize\x001300\0blksize\x001468\0",
        ),
    ],
)
def test_options(service: FileService, uimage: Path, asked: dict[str, object], answer: bytes) -> None:
    """The answer has what was asked for and can be done, and nothing else: RFC 2347."""
    with service.offer("uImage", uimage):
        assert Port(service).ask(request(RRQ, "uImage", **asked)) == answer


def test_block_size_that_was_not_agreed_on_is_512(service: FileService, uimage: Path) -> None:
    with service.offer("uImage", uimage):
        board = Port(service)
        assert board.read_on(board.ask(request(RRQ, "uImage", tsize=0, blksize="abc"))) == content_of(1300)


# ---- what is lost, late or twice


@pytest.mark.slow
def test_a_block_is_sent_again_until_it_is_too_often(
    service: FileService, uimage: Path, hasty: float
) -> None:
    board = Port(service)
    with service.offer("uImage", uimage) as transfer:
        times, heard = [time.monotonic()], [board.ask(request(RRQ, "uImage"))]
        while again := board.hear(10 * hasty):
            times.append(time.monotonic())
            heard.append(again)
        assert heard == [BLOCK_1] * 10
        assert times[-1] - times[0] > 9 * hasty * 0.9
        board.send(block(ACK, 1))
        assert board.hear(hasty) == b""  # the session is over
        assert not transfer.finished


@pytest.mark.slow
def test_it_waits_as_long_as_was_asked_for(service: FileService, uimage: Path, hasty: float) -> None:
    board = Port(service)
    with service.offer("uImage", uimage):
        answer = board.ask(request(RRQ, "uImage", timeout=1))
        begin = time.monotonic()
        assert board.hear() == answer
        assert 0.9 < time.monotonic() - begin < 5


@pytest.mark.slow
def test_each_try_counts_anew_after_progress(service: FileService, uimage: Path, hasty: float) -> None:
    board = Port(service)
    with service.offer("uImage", uimage) as transfer:
        board.ask(request(RRQ, "uImage"))
        for number in (1, 2, 3):
            for _ in range(8):
                assert board.hear()[:4] == block(DATA, number)
            board.send(block(ACK, number))
            while number < 3 and board.socket.recv(4, socket.MSG_PEEK)[:4] == block(DATA, number):
                board.hear()
            if number < 3:
                assert board.hear()[:4] == block(DATA, number + 1)
        settle(service)
        assert transfer.finished


@pytest.mark.slow
def test_repeated_acknowledgements_double_nothing(service: FileService, uimage: Path) -> None:
    """The sorcerer's apprentice: RFC 1123, 4.2.3.1. More often than tftpy forgives, too."""
    board = Port(service)
    with service.offer("uImage", uimage):
        heard = [board.ask(request(RRQ, "uImage", timeout=255))]  # it does not lose patience meanwhile
        for number, times in ((0, 25), (1, 3), (2, 3)):
            for _ in range(times):
                board.send(block(ACK, number))
            heard.append(board.hear())
            settle(service, times)
        board.send(block(ACK, 3))
        settle(service)
        assert board.hear(0) == b""
        assert [packet[:4] for packet in heard[1:]] == [block(DATA, number) for number in (1, 2, 3)]


def test_repeated_acknowledgements_do_not_keep_a_block_back(
    service: FileService, uimage: Path, hasty: float
) -> None:
    """As U-Boot asks for a lost block, and as often as it can."""
    board = Port(service)
    with service.offer("uImage", uimage):
        board.ask(request(RRQ, "uImage"))
        board.send(block(ACK, 1))
        lost = board.hear()
        deadline = time.monotonic() + SOON
        while not (again := board.hear(hasty / 10)) and time.monotonic() < deadline:
            board.send(block(ACK, 1))
        assert again == lost


@pytest.mark.parametrize("number", [0, 2, 3, 0xFFFF])
def test_acknowledgement_of_another_block_moves_nothing(
    service: FileService, uimage: Path, number: int
) -> None:
    board = Port(service)
    with service.offer("uImage", uimage) as transfer:
        first = board.ask(request(RRQ, "uImage"))
        board.send(block(ACK, number))
        settle(service)
        assert transfer.moved == 0
        assert board.read_on(first) == content_of(1300)


def test_repeated_request_is_answered_by_the_same_session(service: FileService, uimage: Path) -> None:
    """U-Boot repeats its request when the answer is lost."""
    board = Port(service)
    asked = request(RRQ, "uImage", timeout=200)
    with service.offer("uImage", uimage):
        answer = board.ask(asked)
        peer = board.peer
        assert board.ask(asked) == answer
        assert board.peer == peer
        assert board.read_on(answer) == content_of(1300)


def test_request_that_comes_late_does_not_disturb(service: FileService, uimage: Path) -> None:
    board = Port(service)
    asked = request(RRQ, "uImage", blksize=512)
    with service.offer("uImage", uimage):
        board.ask(asked)
        board.send(block(ACK, 0))
        first = board.hear()
        board.socket.sendto(asked, board.service)
        settle(service)
        assert board.read_on(first) == content_of(1300)  # from the same port, as hear() looks


def test_board_that_starts_anew_from_the_same_port(service: FileService, uimage: Path, hasty: float) -> None:
    """Reset in the middle: the request is the same, long after the last sign of life."""
    board = Port(service)
    asked = request(RRQ, "uImage", timeout=2)
    with service.offer("uImage", uimage):
        board.ask(asked)
        board.send(block(ACK, 0))
        board.hear()
        before = board.peer
        time.sleep(2 * hasty)
        answer = board.ask(asked)
        assert board.peer != before
        assert board.read_on(answer) == content_of(1300)


def test_only_the_newest_request_is_served(service: FileService, uimage: Path, hasty: float) -> None:
    """U-Boot takes a new port when it starts again; the old one hears nothing more."""
    old, new = Port(service), Port(service)
    with service.offer("uImage", uimage), service.offer("dtb", uimage, size=100):
        old.ask(request(RRQ, "uImage"))
        assert new.ask(request(RRQ, "dtb"))[4:] == content_of(100)
        while old.hear(0):  # what was sent before
            pass
        assert old.hear(3 * hasty) == b""
        assert new.hear() == block(DATA, 1, content_of(100))


def test_refused_request_does_not_disturb(service: FileService, uimage: Path) -> None:
    board = Port(service)
    with service.offer("uImage", uimage):
        first = board.ask(request(RRQ, "uImage"))
        settle(service)
        assert board.read_on(first) == content_of(1300)


@pytest.mark.slow
@pytest.mark.parametrize("extra", [0, 5])
def test_block_numbers_roll_over(service: FileService, tmp_path: Path, extra: int) -> None:
    content = os.urandom(8 * (0x10000 + 100) + extra)
    (tmp_path / "file").write_bytes(content)
    with service.offer("uImage", tmp_path / "file"):
        assert Port(service).read("uImage", 8) == content
    with service.accept("backup", tmp_path / "backup", len(content)):
        Port(service).write("backup", content, 8)
    assert (tmp_path / "backup").read_bytes() == content


@pytest.mark.slow
def test_more_than_96_mb(service: FileService, tmp_path: Path) -> None:
    content = os.urandom(1468) * (0x10000 + 3)
    (tmp_path / "file").write_bytes(content)
    with service.offer("uImage", tmp_path / "file"):
        assert Port(service).read("uImage", 1468) == content


# ---- what is refused


def test_only_the_board_is_answered(service: FileService, uimage: Path) -> None:
    stranger, board = Port(service, STRANGER), Port(service)
    with service.offer("uImage", uimage):
        for name in ("uImage", "other"):
            stranger.socket.sendto(request(RRQ, name), stranger.service)
        settle(service, 2)
        assert stranger.hear(0) == b""
        assert service.refused[:2] == [
            Refusal(STRANGER, name, f"the board is {BOARD}") for name in ("uImage", "other")
        ]
        assert board.read("uImage") == content_of(1300)


NAMES = [
    b"", b".", b"..", b"/", b"some file", b"./uImage", b"/uImage", b"uimage", b"uImage ", b"uImage/..",
    b"uImage/", b"x/../uImage", b"../../../../../../etc/passwd", b"/etc/passwd", b"..\\uImage", b"link",
    b"folder", b"%2e%2e", b"uImage\n", b"\x1b[2J", b"x" * 400, b"\xff\xfe", b"\xd0\xaf",
]  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("opcode", [RRQ, WRQ])
def test_no_other_name_is_served(
    service: FileService, uimage: Path, monkeypatch: pytest.MonkeyPatch, opcode: int, name: bytes
) -> None:
    """Not what is in the folder of the file, or in the server's own, where these names mean something."""
    monkeypatch.chdir(uimage.parent)
    Path("link").symlink_to("/etc/passwd")
    Path("folder").mkdir()
    before = sorted(uimage.parent.iterdir())
    with service.offer("uImage", uimage):
        answer = Port(service).ask(request(opcode, name))
        expected = NOT_FOUND if opcode == RRQ else NO_ACCESS
        assert answer[:4] == block(ERROR, expected if name.isascii() else ILLEGAL)
        assert len(service.refused) == 1
        assert str(service.refused[0]).isprintable()
    assert sorted(uimage.parent.iterdir()) == before


def test_name_ends_at_its_nul(service: FileService, uimage: Path) -> None:
    with service.offer("uImage", uimage):
        answer = Port(service).ask(b"\0\1uImage\0../../etc/passwd\0octet\0")
        assert answer[:4] == block(ERROR, ILLEGAL)  # the name is right, the mode is no mode


def test_absolute_path_of_the_file_is_no_name(service: FileService, uimage: Path) -> None:
    with service.offer("uImage", uimage):
        assert Port(service).ask(request(RRQ, str(uimage)))[:4] == block(ERROR, NOT_FOUND)


@pytest.mark.parametrize("mode", [b"netascii", b"mail", b""])
def test_only_octet(service: FileService, uimage: Path, mode: bytes) -> None:
    with service.offer("uImage", uimage):
        assert Port(service).ask(request(RRQ, "uImage", mode))[:4] == block(ERROR, ILLEGAL)
        assert Port(service).ask(request(RRQ, "uImage", b"OcTeT")) == BLOCK_1


def test_request_has_512_bytes_at_most(service: FileService, uimage: Path) -> None:
    """What is cut there could still be read."""
    most = request(RRQ, "uImage") + b"aa\0b\0" + 123 * b"c\0d\0"
    more = request(RRQ, "uImage") + b"aaa\0b\0" + 124 * b"c\0d\0"
    assert len(most) == 512
    with service.offer("uImage", uimage):
        board = Port(service)
        board.send(more)
        settle(service)
        assert board.hear(0) == b""
        assert board.ask(most) == BLOCK_1


def test_served_only_meanwhile(service: FileService, uimage: Path) -> None:
    board = Port(service)
    with service.offer("uImage", uimage):
        board.ask(request(RRQ, "uImage", timeout=255))
    assert board.hear(0)[:4] == block(ERROR, NO_ACCESS)  # at once, and U-Boot does not ask again
    assert Port(service).ask(request(RRQ, "uImage"))[:4] == block(ERROR, NOT_FOUND)
    with service.offer("uImage", uimage):
        assert Port(service).read("uImage") == content_of(1300)


@pytest.mark.slow
def test_a_quick_board_does_not_take_all_attention(
    service: FileService, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Others are heard while block after block is acknowledged, and the end comes when it is wanted."""
    monkeypatch.setattr(tftp, "GLANCE", 0.3)  # or a busy host's pauses would do
    (tmp_path / "file").write_bytes(bytes(4_000_000))  # in blocks of 8 bytes half a minute and more
    board = Port(service)
    last = b""

    def read() -> None:
        nonlocal last
        last = board.ask(request(RRQ, "uImage", blksize=8))
        while last[1] != ERROR:
            board.send(block(ACK, 0)[:2] + (last[2:4] if last[1] == DATA else bytes(2)))
            last = board.hear()

    with service.offer("uImage", tmp_path / "file") as transfer:
        reader = threading.Thread(target=read)
        reader.start()
        while not transfer.moved:
            settle(service)
        settle(service)
        assert transfer.moved < transfer.size
    reader.join(SOON)
    assert last[:4] == block(ERROR, NO_ACCESS)
    assert 0 < transfer.moved < transfer.size


def test_one_name_one_file(service: FileService, uimage: Path) -> None:
    with service.offer("uImage", uimage):
        with pytest.raises(ValueError, match="uImage"), service.offer("uImage", uimage):
            pass
        assert Port(service).read("uImage") == content_of(1300)


def test_refusals_are_kept_once_and_not_for_ever(service: FileService) -> None:
    for number in range(100):
        for _ in range(2):
            Port(service).ask(request(RRQ, f"file{number}"))
    kept = [refusal.name for refusal in service.refused]
    assert kept == [f"file{number}" for number in range(100 - len(kept), 100)]
    assert 10 < len(kept) < 100


# ---- uploads


@pytest.mark.parametrize("size", [0, 1, 511, 512, 2048, 5000])
def test_an_upload_comes_whole(service: FileService, tmp_path: Path, size: int) -> None:
    target = tmp_path / "backup"
    with service.accept("backup", target, size) as transfer:
        Port(service).write("backup", content_of(size))
        assert (transfer.moved, transfer.finished) == (size, True)
        assert target.read_bytes() == content_of(size)
    assert target.read_bytes() == content_of(size)


def test_upload_without_options(service: FileService, tmp_path: Path) -> None:
    board = Port(service)
    with service.accept("backup", tmp_path / "backup", 700):
        assert board.ask(request(WRQ, "backup")) == block(ACK, 0)
        for number, start in ((1, 0), (2, 512)):
            board.send(block(DATA, number, content_of(700)[start : start + 512]))
            assert board.hear() == block(ACK, number)
    assert (tmp_path / "backup").read_bytes() == content_of(700)


def test_names_of_uploads_and_of_files_are_apart(service: FileService, uimage: Path) -> None:
    target = uimage.with_name("backup")
    with service.offer("uImage", uimage), service.accept("backup", target, 10):
        assert Port(service).ask(request(WRQ, "uImage"))[:4] == block(ERROR, NO_ACCESS)
        assert Port(service).ask(request(RRQ, "backup"))[:4] == block(ERROR, NOT_FOUND)
    assert uimage.read_bytes() == content_of(1300)
    assert not target.exists()


@pytest.mark.parametrize("make", [Path.touch, lambda path: path.symlink_to("other"), Path.mkdir])
def test_nothing_is_overwritten(service: FileService, tmp_path: Path, make: object) -> None:
    target = tmp_path / "backup"
    make(target)
    with pytest.raises(FileExistsError), service.accept("backup", target, 10):
        pass
    assert list(tmp_path.iterdir()) == [target]


def test_upload_that_announces_too_much(service: FileService, tmp_path: Path) -> None:
    with service.accept("backup", tmp_path / "backup", 1000):
        assert Port(service).ask(request(WRQ, "backup", tsize=1001))[:4] == block(ERROR, DISK_FULL)
        assert "1001" in service.refused[-1].reason
        assert Port(service).ask(request(WRQ, "backup", TSIZE=1001))[:4] == block(ERROR, DISK_FULL)
        assert Port(service).ask(request(WRQ, "backup", tsize=1000)) == b"\0\6tsize\x001000\0"


@pytest.mark.parametrize("size", [1023, 1025, 2000, 100])
def test_upload_of_another_size_is_refused_and_removed(
    service: FileService, tmp_path: Path, size: int
) -> None:
    board = Port(service)
    with service.accept("backup", tmp_path / "backup", 1024) as transfer:
        board.ask(request(WRQ, "backup"))
        for number in range(1, size // 512 + 2):
            board.send(block(DATA, number, content_of(size)[512 * number - 512 : 512 * number]))
            heard = board.hear()
            if heard[1] == ERROR:
                break
        assert heard[:4] == block(ERROR, DISK_FULL)
        assert not transfer.finished
        assert service.refused[-1].name == "backup"
    assert list(tmp_path.iterdir()) == []


def test_upload_that_stops_is_removed(service: FileService, tmp_path: Path) -> None:
    board = Port(service)
    with service.accept("backup", tmp_path / "backup", 1024) as transfer:
        board.ask(request(WRQ, "backup"))
        board.send(block(DATA, 1, bytes(512)))
        assert board.hear() == block(ACK, 1)
        assert (transfer.moved, transfer.finished) == (512, False)
    assert board.hear()[:4] == block(ERROR, NO_ACCESS)
    assert list(tmp_path.iterdir()) == []


def test_upload_that_the_board_gives_up_may_start_again(service: FileService, tmp_path: Path) -> None:
    board = Port(service)
    with service.accept("backup", tmp_path / "backup", 600):
        board.ask(request(WRQ, "backup"))
        board.send(block(DATA, 1, b"x" * 512))
        board.hear()
        board.send(block(ERROR, 0, b"interrupted\0"))
        Port(service).write("backup", content_of(600))
    assert (tmp_path / "backup").read_bytes() == content_of(600)


def test_upload_comes_once(service: FileService, tmp_path: Path) -> None:
    with service.accept("backup", tmp_path / "backup", 600) as transfer:
        Port(service).write("backup", content_of(600))
        assert Port(service).ask(request(WRQ, "backup"))[:4] == block(ERROR, EXISTS)
        assert (transfer.moved, transfer.finished) == (600, True)
    assert (tmp_path / "backup").read_bytes() == content_of(600)


def test_repeated_blocks_are_acknowledged_and_not_kept(service: FileService, tmp_path: Path) -> None:
    """The last one too: its acknowledgement may be lost. More often than tftpy forgives."""
    board = Port(service)
    with service.accept("backup", tmp_path / "backup", 1300):
        board.ask(request(WRQ, "backup"))
        for number in (1, 2, 3):
            for _ in range(30):
                board.send(block(DATA, number, content_of(1300)[512 * number - 512 : 512 * number]))
                assert board.hear() == block(ACK, number)
    assert (tmp_path / "backup").read_bytes() == content_of(1300)


@pytest.mark.parametrize(
    "datagram",
    [block(DATA, 0, bytes(512)), block(DATA, 2, bytes(512)), block(DATA, 0xFFFF), block(DATA, 1, bytes(513)),
     block(ACK, 0), block(ACK, 1), request(WRQ, "x"), b"\0\3\0", b"\0\6tsize\x001\0"],
)  # fmt: skip
def test_wrong_block_moves_no_upload(service: FileService, tmp_path: Path, datagram: bytes) -> None:
    board = Port(service)
    with service.accept("backup", tmp_path / "backup", 600) as transfer:
        board.ask(request(WRQ, "backup", blksize=512))
        board.send(datagram)
        settle(service)
        assert transfer.moved == 0
        assert board.hear(0) in (b"", block(ACK, 0))
        for number, start in ((1, 0), (2, 512)):
            board.send(block(DATA, number, content_of(600)[start : start + 512]))
            assert board.hear() == block(ACK, number)
    assert (tmp_path / "backup").read_bytes() == content_of(600)


def test_no_acknowledgement_is_sent_unasked(service: FileService, tmp_path: Path, hasty: float) -> None:
    """After its last block U-Boot takes any for that block's, and says that it is done."""
    board = Port(service)
    with service.accept("backup", tmp_path / "backup", 600) as transfer:
        board.ask(request(WRQ, "backup"))
        board.send(block(DATA, 1, content_of(512)))
        assert board.hear() == block(ACK, 1)
        assert board.hear(4 * hasty) == b""
        board.send(block(DATA, 2, content_of(600)[512:]))
        assert board.hear() == block(ACK, 2)
        assert transfer.finished


def test_full_disk(service: FileService, tmp_path: Path) -> None:
    """/dev/full in the place of the file that the service has opened; then there is room again."""
    target = tmp_path / "backup"
    with service.accept("backup", target, 10) as transfer:
        opened = [entry for entry in Path("/proc/self/fd").iterdir() if entry.resolve() == target]
        descriptor = int(opened[0].name)
        with Path("/dev/full").open("wb") as full, target.open("r+b") as file:
            os.dup2(full.fileno(), descriptor)
            board = Port(service)
            board.ask(request(WRQ, "backup"))
            board.send(block(DATA, 1, bytes(10)))
            assert board.hear()[:4] == block(ERROR, DISK_FULL)
            assert not transfer.finished
            assert "No space left" in service.refused[-1].reason
            os.write(file.fileno(), b"a part")
            os.dup2(file.fileno(), descriptor)
        Port(service).write("backup", content_of(10))
    assert target.read_bytes() == content_of(10)


# ---- what is hostile


STRAY = [
    block(ACK, 1), block(ACK, 2), block(DATA, 1, b"x"), block(DATA, 2, bytes(512)), request(RRQ, "uImage"),
    b"\0\6blksize\x008\0", b"\0", b"\xff" * 9, bytes(60_000),
]  # fmt: skip


@pytest.mark.parametrize("address", [BOARD, STRANGER])
@pytest.mark.parametrize("datagram", STRAY)
def test_stray_datagram_moves_no_download(
    service: FileService, uimage: Path, datagram: bytes, address: str
) -> None:
    """From another port, or address: RFC 1350 has error 5 for it, and the transfer goes on."""
    board, other = Port(service), Port(service, address)
    with service.offer("uImage", uimage) as transfer:
        first = board.ask(request(RRQ, "uImage"))
        other.peer = board.peer
        other.send(datagram)
        assert other.hear()[:4] == block(ERROR, UNKNOWN_TID)
        assert transfer.moved == 0
        assert board.read_on(first) == content_of(1300)


@pytest.mark.parametrize("address", [BOARD, STRANGER])
@pytest.mark.parametrize("datagram", STRAY)
def test_stray_datagram_moves_no_upload(
    service: FileService, tmp_path: Path, datagram: bytes, address: str
) -> None:
    board, other = Port(service), Port(service, address)
    with service.accept("backup", tmp_path / "backup", 5) as transfer:
        board.ask(request(WRQ, "backup"))
        other.peer = board.peer
        other.send(datagram)
        assert other.hear()[:4] == block(ERROR, UNKNOWN_TID)
        assert transfer.moved == 0
        board.send(block(DATA, 1, b"hello"))
        assert board.hear() == block(ACK, 1)
    assert (tmp_path / "backup").read_bytes() == b"hello"


def test_stray_error_is_neither_believed_nor_answered(service: FileService, uimage: Path) -> None:
    board, other = Port(service), Port(service)
    with service.offer("uImage", uimage):
        first = board.ask(request(RRQ, "uImage"))
        for peer in (board.peer, board.service):
            other.peer = peer
            for datagram in (block(ERROR, 5, b"unknown\0"), b"\0\5", b"\0\5\0"):
                other.send(datagram)
        settle(service, 6)
        assert other.hear(0) == b""
        assert board.read_on(first) == content_of(1300)


def test_error_of_the_board_ends_the_transfer(service: FileService, uimage: Path, hasty: float) -> None:
    board = Port(service)
    with service.offer("uImage", uimage) as transfer:
        board.ask(request(RRQ, "uImage"))
        board.send(block(ERROR, 3, b"File too large\0"))
        settle(service)
        while board.hear(0):  # what was sent before
            pass
        board.send(block(ACK, 1))
        assert board.hear(3 * hasty) == b""
        assert not transfer.finished


HOSTILE = [
    b"", b"\0", b"\0\0", b"\0\1", b"\0\1\0", b"\0\1\0\0", b"\0\1uImage", b"\0\1uImage\0",
    b"\0\1uImage\0octet", b"\0\1uImage\0octet\0blksize", b"\0\1uImage\0octet\0blksize\0",
    b"\0\1uImage\0octet\0\0\0", b"\0\1uImage\0octet\0a\0b\0c\0", b"\0\1\xff\xfe\0octet\0",
    b"\0\1uImage\0\xff\0", b"\0\1uImage\0octet\0\xff\0\xff\0", b"\0\2", b"\0\2x\0octet\0", b"\0\3",
    b"\0\3\0", b"\0\3\0\1", b"\0\4", b"\0\4\0", b"\0\4\0\1", b"\0\4\0\1\0\0\0", b"\0\5", b"\0\5\0",
    b"\0\5\0\1", b"\0\5\0\1x", b"\0\5\xff\xff\xff\0", b"\0\6", b"\0\6\0", b"\0\6blksize\0abc\0",
    b"\0\6blksize\0", b"\0\7\0\0", b"\xff\xff", b"\1\0uImage\0octet\0", bytes(65_000), b"\xff" * 65_000,
    b"\0\1" + b"x" * 65_000, b"\0\1" + b"x\0" * 32_000, b"\0\3\0\1" + bytes(65_000),
]  # fmt: skip


@pytest.mark.parametrize("address", [BOARD, STRANGER])
def test_hostile_datagrams_end_nothing(
    service: FileService, uimage: Path, caplog: pytest.LogCaptureFixture, address: str
) -> None:
    """Each of them, at the server's port and at the session's, between any two blocks."""
    other = Port(service, address)
    with service.offer("uImage", uimage):
        for datagram in HOSTILE:
            board = Port(service)  # from that of the transfer before it may be its request once more
            first = board.ask(request(RRQ, "uImage", blksize=512))
            for peer in (board.peer, board.service):
                other.peer = peer
                other.send(datagram)
            assert board.read_on(first) == content_of(1300), datagram[:40]
    assert caplog.records == []


def test_hostile_datagrams_of_the_board_itself(service: FileService, uimage: Path) -> None:
    """From the port of its transfer. Its own errors do end that, and its acknowledgements move it."""
    with service.offer("uImage", uimage):
        for datagram in HOSTILE:
            if not datagram.startswith((b"\0\5", b"\0\4\0\1")):
                board = Port(service)
                first = board.ask(request(RRQ, "uImage"))
                board.send(datagram)
                assert board.read_on(first) == content_of(1300), datagram[:40]


@pytest.fixture(scope="module")
def fuzzed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[FileService]:
    path = tmp_path_factory.mktemp("fuzzed") / "file"
    path.write_bytes(content_of(1300))
    with FileService("", 0, BOARD) as service, service.offer("uImage", path):
        yield service


ANYTHING = st.one_of(
    st.binary(max_size=600),
    st.builds(block, st.integers(0, 7), st.integers(0, 0xFFFF), st.binary(max_size=80)),
    st.builds(
        request,
        st.sampled_from([RRQ, WRQ]),
        st.binary(max_size=20).filter(lambda name: not name.startswith(b"uImage")),
        st.sampled_from([b"octet", b"netascii", b"\xff"]),
        blksize=st.one_of(st.integers(), st.binary(max_size=5)),
        tsize=st.one_of(st.integers(), st.binary(max_size=5)),
        timeout=st.one_of(st.integers(), st.binary(max_size=5)),
    ),
)  # fmt: skip


@pytest.mark.slow
@settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(storm=st.lists(st.tuples(ANYTHING, st.booleans(), st.sampled_from([BOARD, STRANGER])), max_size=12))
def test_transfer_survives_anything(fuzzed: FileService, storm: list[tuple[bytes, bool, str]]) -> None:
    others = {address: Port(fuzzed, address) for address in (BOARD, STRANGER)}
    board = Port(fuzzed)
    first = board.ask(request(RRQ, "uImage", blksize=512))
    for datagram, at_session, address in storm:
        others[address].socket.sendto(datagram, board.peer if at_session else board.service)
    assert board.read_on(first) == content_of(1300)


# ---- start and end


@pytest.mark.slow
def test_nothing_is_left(uimage: Path) -> None:
    def held() -> tuple[int, int]:
        return threading.active_count(), len(list(Path("/proc/self/fd").iterdir()))

    gc.collect()
    before = held()
    for number in range(50):
        with FileService("127.0.0.1", 0, BOARD) as service, service.offer("uImage", uimage):
            if number % 5 == 0:
                Port(service, at="127.0.0.1").ask(request(RRQ, "uImage"))  # and left in the middle
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as port:
            port.bind(("127.0.0.1", service.port))
    gc.collect()
    assert held() == before


def test_stops_at_once_and_says_so(uimage: Path) -> None:
    with FileService("", 0, BOARD) as service, service.offer("uImage", uimage):
        board = Port(service)
        board.ask(request(RRQ, "uImage", timeout=200))
        begin = time.monotonic()
        service.__exit__(None, None, None)
        assert time.monotonic() - begin < 20
        assert board.hear()[:4] == block(ERROR, NO_ACCESS)
        service.__enter__()


def test_service_can_be_left_before_its_files(uimage: Path) -> None:
    service = FileService("", 0, BOARD)
    offer = service.offer("uImage", uimage)
    with service:
        offer.__enter__()
    offer.__exit__(None, None, None)


def test_port_in_use() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        port = other.getsockname()[1]
        with pytest.raises(TftpError) as caught, FileService("127.0.0.1", port, BOARD):
            pass
        assert str(port) in str(caught.value)
        assert f"(process {os.getpid()})" in caught.value.cause


def test_address_of_another_host() -> None:
    with pytest.raises(TftpError, match=r"192\.0\.2\.77"), FileService("192.0.2.77", 0, BOARD):
        pass


def test_port_69_is_not_for_everyone() -> None:
    """The message is a program's own, who has no rights."""
    program = """
import os
from nuc980.netboot.errors import TftpError
from nuc980.netboot.tftp import FileService
if os.geteuid() == 0:
    os.setgroups([]), os.setgid(65534), os.setuid(65534)
try:
    FileService("127.0.0.1", 69, "127.0.0.9").__enter__()
except TftpError as error:
    print(error)
"""
    if int(Path("/proc/sys/net/ipv4/ip_unprivileged_port_start").read_text()) <= 69:
        pytest.skip("net.ipv4.ip_unprivileged_port_start lets everybody have port 69 here")
    environment = os.environ | {"PYTHONPATH": str(Path(tftp.__file__).parents[2])}
    done = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
    )
    for part in (
        "UDP port 69",
        "sudo sysctl net.ipv4.ip_unprivileged_port_start=69",
        "--tftp-port",
        "tftpdstp",
    ):
        assert part in done.stdout
