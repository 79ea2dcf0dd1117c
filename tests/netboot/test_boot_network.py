# SPDX-License-Identifier: GPL-3.0-or-later
"""Loading a file: who the board is and who serves it, what is tried again, what U-Boot's words mean."""

import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from ipaddress import IPv4Address, IPv4Interface
from pathlib import Path

import pytest

from nuc980.netboot import host
from nuc980.netboot.console import Answer
from nuc980.netboot.errors import (
    FileRefused,
    HostAmbiguous,
    LinkDown,
    NoAnswer,
    NoEthernet,
    NoHostAddress,
    NoMac,
    TftpTimeout,
    TransferBroken,
    TransferFailed,
    UnusableInput,
    WrongBytes,
)
from nuc980.netboot.progress import Progress
from nuc980.netboot.session import Network, Session, board_address, server_address
from nuc980.netboot.site import Site
from nuc980.netboot.steps import Load, Slice, why_not_loaded
from nuc980.netboot.tftp import Refusal, Transfer

BOARD = IPv4Interface("192.168.1.20/24")
CONTENT = b"a kernel"
LOADED = f"Bytes transferred = {len(CONTENT)} (8 hex)\n"

# As the vendor's 2016.11 and our 2023.01 print them.
USING = (
    "Using emac device\nTFTP from server 192.168.1.2; our IP address is 192.168.1.20\nFilename 'uImage'.\n"
)
LOADING = f"{USING}Filename 'uImage'.\nLoad address: 0x7fc0\nLoading: *\x08"
SILENT = f"{LOADING}T T T T \nRetry count exceeded; starting again\n"
NO_LINK = "emac0 Waiting for PHY auto negotiation to complete......... TIMEOUT !\nemac0: no link\n"


class Files:
    """In the place of a FileService: how much of a file it moved, whom it refused."""

    def __init__(self, moved: int = 0, port: int = 69, refused: tuple[Refusal, ...] = ()) -> None:
        self.moved, self.port, self.refused = moved, port, list(refused)

    @contextmanager
    def offer(self, name: str, source: Path, start: int, size: int) -> Iterator[Transfer]:
        yield Transfer(name, size, self.moved)


class Answers:
    """In the place of a Console: the answers, one after the other."""

    def __init__(self, *answers: tuple[int, str]) -> None:
        self.answers = list(answers)

    def run(self, command: str, seconds: float = 0, watch: Callable[[str], None] = print) -> Answer:
        return Answer(command, *self.answers.pop(0))


def session(*answers: tuple[int, str], files: Files | None = None) -> Session:
    network = Network(BOARD, IPv4Address("192.168.1.2"))
    return Session(Answers(*answers), Progress(), network, files or Files())  # type: ignore[arg-type]


@pytest.fixture
def load(tmp_path: Path) -> Load:
    (tmp_path / "kernel").write_bytes(CONTENT)
    return Load("uImage", Slice.of(tmp_path / "kernel"), 0x7FC0)


def crc(of: int) -> tuple[int, str]:
    return 0, f"crc32 for 00007fc0 ... 00007fc7 ==> {of:08x}\n"


# ---- what is tried again


def test_loaded_at_the_first_try(load: Load) -> None:
    load.run(session((0, LOADED), crc(load.content.crc32)))


@pytest.mark.parametrize(
    "failed",
    [
        [(0, LOADED), crc(0)],
        [(0, LOADED.replace("8 (8", "7 (7"))],
        [(1, NO_LINK)],
        [(1, SILENT)],
    ],
    ids=["another sum", "another size", "no link yet", "broken off"],
)
def test_what_may_pass_is_tried_again(load: Load, failed: list[tuple[int, str]]) -> None:
    good = [(0, LOADED), crc(load.content.crc32)]
    at = session(*failed, *failed, *good, files=Files(moved=5))
    load.run(at)
    assert at.console.answers == []  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("answer", "kind", "tries"),
    [
        ((0, LOADED.replace("8 (8", "7 (7")), WrongBytes, 3),
        ((1, NO_LINK), LinkDown, 3),
        ((1, SILENT), TftpTimeout, 1),
        ((1, "No ethernet found.\n"), NoEthernet, 1),
        ((1, "TFTP error: 'File not found' (1)\nNot retrying...\n"), FileRefused, 1),
    ],
)
def test_in_the_end_it_fails(load: Load, answer: tuple[int, str], kind: type[Exception], tries: int) -> None:
    at = session(*[answer] * 5)
    with pytest.raises(kind):
        load.run(at)
    assert len(at.console.answers) == 5 - tries  # type: ignore[attr-defined]


# ---- what U-Boot's words mean


@pytest.mark.parametrize(
    ("output", "kind"),
    [
        ("No ethernet found.\n", NoEthernet),
        ("Error: emac0 address not set.\nNo ethernet found.\n", NoMac),
        ("Error: emac address not set.\n", NoMac),
        (NO_LINK, LinkDown),
        ("Reset phy failed\n", LinkDown),
        (f"{USING}\nARP Retry count exceeded; starting again\n", NoAnswer),
        (f"{NO_LINK}{USING}\nARP Retry count exceeded; starting again\n", NoAnswer),
        (f"{LOADING}\nTFTP error: 'File not found' (1)\nNot retrying...\n", FileRefused),
        (SILENT, TftpTimeout),
        (f"{LOADING}\nTFTP server died; starting again\n", TftpTimeout),
        ("*** ERROR: `serverip' not set\n", TransferFailed),
        ("Abort\n", TransferFailed),
        ("", TransferFailed),
    ],
)
def test_uboots_words(output: str, kind: type[TransferFailed]) -> None:
    error = why_not_loaded(output, Transfer("uImage", 1000), session())
    assert type(error) is kind
    assert error.cause and error.next_step
    assert (output.replace("*\b", "").strip().splitlines() or [""])[-1] in error.what
    assert "\b" not in error.what


def test_transfer_that_began_broke_off() -> None:
    error = why_not_loaded(SILENT, Transfer("uImage", 1000, moved=512), session())
    assert type(error) is TransferBroken
    assert "after 512 of 1000 bytes" in str(error)


def test_another_address_that_asks_is_named() -> None:
    files = Files(refused=(Refusal("192.168.1.99", "uImage", "the board is 192.168.1.20"),))
    error = why_not_loaded(SILENT, Transfer("uImage", 1000), session(files=files))
    assert "192.168.1.99, 'uImage': the board is 192.168.1.20" in str(error)
    assert "--seen-as" in str(error)


def test_another_port_may_not_be_known_to_uboot() -> None:
    error = why_not_loaded(SILENT, Transfer("uImage", 1000), session(files=Files(port=6969)))
    assert "does not know tftpdstp" in str(error)


def test_hosts_own_addresses_are_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    mine = host.HostAddress("eth7", IPv4Address("192.168.1.2"), 24, True)
    monkeypatch.setattr(host, "addresses", lambda: (mine,))
    for output in (SILENT, "ARP Retry count exceeded; starting again\n"):
        assert "eth7 (192.168.1.2/24) is in the board's network" in str(
            why_not_loaded(output, Transfer("uImage", 1000), session())
        )


# ---- who is who


def test_boards_address_is_the_one_given_then_the_sites_then_uboots(tmp_path: Path) -> None:
    site = Site(tmp_path)
    environment = {"ipaddr": "10.0.0.7", "netmask": "255.255.0.0"}
    assert board_address(None, site, environment) == IPv4Interface("10.0.0.7/16")
    (tmp_path / "board-ip").write_text("10.0.0.8/24\n")
    assert board_address(None, site, environment) == IPv4Interface("10.0.0.8/24")
    assert board_address(BOARD, site, environment) == BOARD


@pytest.mark.parametrize("environment", [{}, {"ipaddr": "10.0.0.7"}, {"netmask": "255.0.0.0"}])
def test_board_without_an_address_needs_one(tmp_path: Path, environment: dict[str, str]) -> None:
    with pytest.raises(UnusableInput, match=r"--board-ip ADDRESS/PREFIX, or write it into .*board-ip"):
        board_address(None, Site(tmp_path), environment)


def test_nonsense_in_uboots_address_is_told(tmp_path: Path) -> None:
    with pytest.raises(UnusableInput, match=r"U-Boot's ipaddr and netmask: '10\.0\.0\.7/1\.2\.3\.4' is no"):
        board_address(None, Site(tmp_path), {"ipaddr": "10.0.0.7", "netmask": "1.2.3.4"})


def test_host_serves_from_its_address_in_the_boards_network(monkeypatch: pytest.MonkeyPatch) -> None:
    addresses = (
        host.HostAddress("eth0", IPv4Address("10.1.1.1"), 8, True),
        host.HostAddress("eth1", IPv4Address("192.168.1.2"), 24, True),
    )
    monkeypatch.setattr(host, "addresses", lambda: addresses)
    assert server_address(BOARD) == IPv4Address("192.168.1.2")
    with pytest.raises(NoHostAddress, match=r"sudo ip address add 172\.16\.0\."):
        server_address(IPv4Interface("172.16.0.50/24"))


def test_choice_of_the_hosts_address_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    addresses = (
        host.HostAddress("eth1", IPv4Address("192.168.1.2"), 24, True),
        host.HostAddress("eth1", IPv4Address("192.168.1.3"), 24, True),
    )
    monkeypatch.setattr(host, "addresses", lambda: addresses)
    server = server_address(BOARD)
    told = str(Network(BOARD, server))
    assert told == (
        "files by TFTP at UDP port 69 of 192.168.1.2 (eth1), to 192.168.1.20 alone;"
        " --server-ip chooses another: 192.168.1.3/24 (eth1)"
    )
    monkeypatch.setattr(host, "addresses", lambda: addresses[:1])
    assert str(Network(BOARD, server)).endswith("192.168.1.2 (eth1), to 192.168.1.20 alone")


@pytest.mark.parametrize("up", [True, False])
def test_choice_that_cannot_be_made_is_refused(monkeypatch: pytest.MonkeyPatch, up: bool) -> None:
    addresses = (
        host.HostAddress("eth1", IPv4Address("192.168.1.2"), 24, up),
        host.HostAddress("wlan0", IPv4Address("192.168.1.77"), 24, True),
    )
    monkeypatch.setattr(host, "addresses", lambda: addresses)
    with pytest.raises(HostAmbiguous, match=r"192\.168\.1\.77/24 \(wlan0\)") as raised:
        server_address(BOARD)
    assert "192.168.1.2/24 (eth1" in raised.value.what
    assert "--server-ip ADDRESS" in raised.value.next_step


def test_port_without_a_link_is_still_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    """A board at the other end of a cable gives no link before its U-Boot wakes its PHY."""
    down = host.HostAddress("eth1", IPv4Address("192.168.1.2"), 24, False)
    monkeypatch.setattr(host, "addresses", lambda: (down,))
    assert server_address(BOARD) == IPv4Address("192.168.1.2")


@pytest.mark.parametrize(("seen_as", "board"), [(None, BOARD.ip), ("10.0.0.1", "10.0.0.1")])
def test_service_is_for_the_board_as_it_is_seen(seen_as: str | None, board: IPv4Address | str) -> None:
    network = Network(
        BOARD,
        IPv4Address("192.168.1.2"),
        0,
        listen=IPv4Address("127.0.0.1"),
        seen_as=IPv4Address(seen_as) if seen_as else None,
    )
    with network.service() as files, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        client.sendto(b"\0\1uImage\0octet\0", ("127.0.0.1", files.port))
        client.settimeout(0.1)
        with pytest.raises(TimeoutError):  # this is not the board
            client.recv(100)
        (refusal,) = files.refused
    assert (refusal.address, refusal.reason) == ("127.0.0.1", f"the board is {board}")
