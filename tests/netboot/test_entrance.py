# SPDX-License-Identifier: GPL-3.0-or-later
"""A U-Boot that lets only some in, a Linux that is at work: what is typed, how often, and what is told."""

import getpass
import logging
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from netboot.clockwork import Board, Life, Program, PtyBoard, UBoot, VirtualLine, kernel, silent
from netboot.ports import free_port
from nuc980.netboot import arrival, host
from nuc980.netboot.arrival import KNOCK
from nuc980.netboot.cli import main
from nuc980.netboot.console import Console
from nuc980.netboot.entrance import Entrance, keys_of, read_password
from nuc980.netboot.errors import (
    AutobootKeyed,
    AutobootMissed,
    LineUnsafe,
    NetbootError,
    NotUBoot,
    PasswordNeeded,
    PasswordRefused,
    TftpError,
    UnusableInput,
)
from nuc980.netboot.tftp import FileService
from nuc980.netboot.transport import Veil

KEYED = UBoot(stop=b"nuvoton", autoboot=b'Autoboot in 3 seconds, press "nuvoton" to stop\n')
SECRET = UBoot(stop=b"s3cret", autoboot=b"Enter password - autoboot in 3 sec...\n")
LOCKED = UBoot(password=b"s3cret")
OPEN = Entrance(password=b"s3cret")


def starts_late(life: Callable[[Board], Life]) -> Callable[[Board], Life]:
    """As somebody switches it on while the tool waits."""

    def late(board: Board) -> Life:
        yield 5.0
        yield from life(board)

    return late


def reached(life: Callable[[Board], Life], entrance: Entrance, patience: float = 30.0) -> tuple[Board, bytes]:
    board = Board(starts_late(life))
    line = VirtualLine(board)
    console = Console(line, entrance=entrance)
    console.reach(patience=patience)
    assert console.run("false").status == 1
    return board, line.sent.split(b"if version")[0]


def refused(
    life: Callable[[Board], Life], entrance: Entrance, error: type[NetbootError]
) -> tuple[Board, str]:
    board = Board(starts_late(life))
    with pytest.raises(error) as raised:
        Console(VirtualLine(board), entrance=entrance).reach(patience=30.0)
    assert "s3cret" not in str(raised.value)
    return board, str(raised.value)


# ---- autoboot that wants a string


@pytest.mark.parametrize(
    ("life", "entrance"),
    [
        (KEYED, Entrance(interrupt=b"nuvoton")),
        (SECRET, OPEN),
        (UBoot(stop=b" ", autoboot=b"Press SPACE to stop autoboot in 3 seconds\n"), Entrance(interrupt=b" ")),
        (UBoot(stop=b"x", autoboot=b"Menu: press x\n"), Entrance(interrupt=b"x", autoboot="^Menu")),
        (UBoot(stop=b"\x03", autoboot=b"Press Ctrl+C to abort autoboot in 3 seconds\n"), Entrance()),
        (UBoot(), Entrance(interrupt=b"s")),
        (UBoot(), OPEN),
        (UBoot(bootcmd=False), OPEN),
        (LOCKED, OPEN),
        (replace(LOCKED, asks=b"Please input password: "), OPEN),
        (replace(LOCKED, asks=b"Who are you? "), replace(OPEN, password_prompt=r"are you\? $")),
    ],
    ids=[
        "a string", "a secret string", "space", "words of its own", "Ctrl-C by name", "any key, a string",
        "any key, a password that nobody asks for", "no bootcmd", "a password", "by other words",
        "by words that are named",
    ],
)  # fmt: skip
def test_locked_board_is_entered(life: UBoot, entrance: Entrance) -> None:
    board, sent = reached(life, entrance)
    assert [run for run in board.ran if run.startswith("try")] == (["try s3cret"] if life.password else [])
    if entrance.interrupt_keys and life.bootcmd:
        assert sent.count(entrance.interrupt_keys) <= 1


def test_nothing_comes_before_the_string() -> None:
    """With CONFIG_AUTOBOOT_ENCRYPTION all that was typed is compared, from the first key on."""
    begun: list[int] = []

    def strict(board: Board) -> Life:
        life = replace(SECRET)
        life._board = board
        real = life._is_told_the_string

        def told() -> Life:
            begun.append(len(board.fifo))
            return (yield from real())

        life._is_told_the_string = told  # type: ignore[method-assign]
        yield from life(board)

    reached(strict, OPEN)
    assert begun == [0]


@pytest.mark.parametrize("life", [KEYED, SECRET])
def test_keyed_autoboot_is_named_and_gets_no_keys(life: UBoot) -> None:
    board, said = refused(life, Entrance(), AutobootKeyed)
    assert life.autoboot.decode().strip() in said
    assert "--interrupt" in said and "--password-file" in said
    assert board.now < 8.0


def test_wrong_string_is_told_so() -> None:
    _, said = refused(KEYED, Entrance(interrupt=b"s3cret"), PasswordRefused)
    assert "did not take the stop string" in said


@pytest.mark.parametrize("asks", [b"Password: ", b"Please input password: ", b"enter Password: "])
def test_password_prompt_is_named_and_uses_up_no_tries(asks: bytes) -> None:
    """But for the keys that were under way when autoboot was stopped."""
    board, said = refused(replace(LOCKED, asks=asks), Entrance(), PasswordNeeded)
    assert asks.decode().strip() in said and "--password-file" in said
    assert len(board.ran) <= 16


def test_wrong_password_is_typed_once() -> None:
    board, said = refused(replace(LOCKED, password=b"another"), OPEN, PasswordRefused)
    assert board.ran == ["try s3cret"]
    assert "asks again" in said


def test_prompt_of_a_u_boot_that_says_nothing_to_ctrl_c() -> None:
    class Mute(UBoot):
        def _say(self, octets: bytes) -> Life:
            yield from super()._say(b"\n" if octets == b"<INTERRUPT>\n" else octets)

    reached(Mute(prompt=b"board> "), Entrance(prompt="board> "))


# ---- secrets


class Echoes(UBoot):
    """Shows the string that it is told, one character after the other."""

    def _is_told_the_string(self) -> Life:
        stopped = yield from super()._is_told_the_string()
        for key in self.stop:
            yield bytes([key])
            yield 0.001
        yield from self._say(b"\n")
        return stopped


@pytest.mark.slow
@pytest.mark.parametrize("life", [LOCKED, Echoes(stop=b"s3cret", autoboot=b"Password? autoboot in 3 sec\n")])
def test_secret_is_in_no_log_and_no_output(
    life: UBoot, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(arrival, "LISTEN_SECONDS", 0.1)
    logging.getLogger().setLevel(logging.DEBUG)
    (tmp_path / "password").write_text("s3cret\n")
    log = tmp_path / "log"
    board = Board(silent)
    with PtyBoard(board) as port:
        board._birth = life
        board.born()
        main(["probe", "--no-flash", "--port", port.port, "--log", str(log), "--site", str(tmp_path / "site"),
              "--password-file", str(tmp_path / "password"), "--json", str(tmp_path / "json")])  # fmt: skip
    assert "version" in board.ran
    told = "".join(capsys.readouterr()) + log.read_text() + (tmp_path / "json").read_text()
    assert "s3cret" not in told and "s3cret" not in told.replace("'\n", "")
    assert "(a secret)" in told


def test_echo_is_veiled_however_it_comes() -> None:
    for size in (1, 2, 3, 50):
        veil = Veil(b"s3cret")
        text = b"\r\nPassword: s3cret\r\n=> "
        shown = b"".join(veil.over(text[at : at + size], at / 100) for at in range(0, len(text), size))
        assert shown == b"\r\nPassword: ******\r\n=> ", size


def test_what_only_looks_like_its_beginning_comes_late() -> None:
    veil = Veil(b" secret")
    assert veil.over(b"=> ", 1.0) == b"=>"
    assert veil.over(b"", 1.5) == b""
    assert veil.over(b"", 2.1) == b" "


def test_password_is_a_line_of_a_file(tmp_path: Path) -> None:
    file = tmp_path / "password"
    file.write_bytes(b"a word\r\nmore\n")
    assert read_password(file) == b"a word"
    for wrong in (b"", b"\n", b"\x03\n", "Müller\n".encode(), b"\xff\n"):
        file.write_bytes(wrong)
        with pytest.raises(UnusableInput):
            read_password(file)
    with pytest.raises(UnusableInput, match="No such file"):
        read_password(tmp_path / "nowhere")
    assert "a word" not in repr(Entrance(password=b"a word", interrupt=b"a word"))


def test_password_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(getpass, "getpass", lambda prompt: "a word")
    assert read_password(Path("-")) == b"a word"
    monkeypatch.setattr(getpass, "getpass", getpass.fallback_getpass)  # where there is no terminal
    with pytest.raises(UnusableInput, match="no terminal to type at"):
        read_password(Path("-"))


@pytest.mark.parametrize(
    ("text", "keys"), [("nuvoton", b"nuvoton"), (r"\x1b", b"\x1b"), (r"a\\b\r", b"a\\b\r"), (" ", b" ")]
)
def test_keys_of_a_text(text: str, keys: bytes) -> None:
    assert keys_of(text) == keys


@pytest.mark.parametrize("text", ["", "\\", r"\q", r"\x1", "č", r"\xff"])
def test_text_that_is_no_keys(text: str) -> None:
    with pytest.raises(ValueError, match=r"."):
        keys_of(text)


# ---- Linux at work


@pytest.mark.parametrize(
    "program",
    [
        Program(),
        Program(echo=True),
        Program(period=1e9, echo=True),
        Program(says=b"|", period=0.05),
        Program(says=b"Enter choice: ", period=1e9, echo=True),
    ],
    ids=["talks", "talks at a terminal", "is silent at a terminal", "draws", "asks"],
)
def test_program_is_not_ended(program: Program) -> None:
    board = Board(program)
    line = VirtualLine(board)
    told: list[str] = []
    with pytest.raises(NotUBoot):
        Console(line, told.append).reach(patience=20.0)
    assert board.ran == []
    assert line.sent in (b"", KNOCK)
    assert "switch" in told[-1]


def test_board_may_be_switched_on_while_a_program_is_seen() -> None:
    def switched(board: Board) -> Life:
        yield b"Writing kernel: 10%\r\n"
        yield 10.0
        yield from UBoot()(board)

    board = Board(switched)
    Console(VirtualLine(board)).reach(patience=30.0)
    assert board.ran == ["version"]


def test_countdown_that_has_begun_is_stopped() -> None:
    def counts(board: Board) -> Life:
        for left in (2, 1, 0):
            yield b"\b\b\b%2d " % left
            for _ in range(100):
                yield 0.01
                if board.fifo:
                    yield b"\r\n"
                    yield from UBoot(at_prompt=True)(board)
        yield from kernel(board)

    board = Board(counts)
    Console(VirtualLine(board)).reach(patience=30.0)


def test_u_boot_that_loads_is_interrupted() -> None:
    """It may try for ever to reach a server."""

    def loads(board: Board) -> Life:
        yield b"Using emac device\r\nTFTP from server 192.168.1.2\r\nLoading: "
        while not board.fifo:
            yield b"T "
            yield 1.0
        board.fifo.popleft()
        yield b"\r\nAbort\r\n=> "
        yield from UBoot(at_prompt=True)(board)

    board = Board(loads)
    Console(VirtualLine(board)).reach(patience=30.0)


# ---- a busy host


@pytest.mark.parametrize("seconds", [0.3, 0.5, 0.9])
def test_flood_of_keys_is_waited_for(seconds: float) -> None:
    """A board whose host is busy answers the keys of its start while the first command would be typed."""
    board = Board(starts_late(UBoot(key_seconds=seconds)))
    console = Console(VirtualLine(board))
    console.reach(patience=60.0)
    assert board.ran == ["version"]
    assert console.run("false").status == 1


@pytest.mark.parametrize("seconds", [1.2, 2.0])
def test_line_that_becomes_slow_is_measured(seconds: float) -> None:
    """An echo that takes longer than usual is no broken wire."""
    life = UBoot(at_prompt=True)
    board = Board(life)
    console = Console(VirtualLine(board))
    console.reach()
    life.key_seconds = seconds
    assert console.run("write 1", seconds=60.0).status == 0
    assert console.run("false", seconds=60.0).status == 1
    assert board.ran == ["version", "write 1", "false"]


@pytest.fixture
def load(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(host.os, "getloadavg", lambda: (48.0, 40.0, 30.0))
    monkeypatch.setattr(host.os, "cpu_count", lambda: 2)


@pytest.mark.slow
@pytest.mark.usefixtures("load")
def test_load_of_the_host_is_named() -> None:
    assert host.busy() == "this host is busy (load 48 on 2 processors), and serves the line late"
    _, said = refused(deaf, Entrance(), AutobootMissed)
    assert "load 48 on 2 processors" in said


def deaf(board: Board) -> Life:
    yield b"U-Boot 2016.11\r\n"
    yield from kernel(board)


@pytest.mark.usefixtures("load")
def test_load_is_named_beside_a_line_that_changes_what_is_typed() -> None:
    board = Board(UBoot(at_prompt=True, echo=lambda count, byte: b"" if count > 80 else byte))
    console = Console(VirtualLine(board))
    console.reach()
    with pytest.raises(LineUnsafe) as raised:
        console.run("write 1")
    assert "load 48 on 2 processors" in raised.value.cause


def test_idle_host_is_not_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(host.os, "getloadavg", lambda: (1.0, 1.0, 1.0))
    assert host.busy() == ""


# ---- another nuc980-netboot


@contextmanager
def serving(program: str, port: int) -> Iterator[int]:
    """A process of this name that has the port."""
    code = (
        "import socket, sys; s = socket.socket(type=socket.SOCK_DGRAM);"
        " s.bind(('127.0.0.1', int(sys.argv[1]))); print(flush=True); sys.stdin.read()"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code, str(port), program], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        assert process.stdin and process.stdout
        process.stdout.readline()
        yield process.pid
        process.stdin.close()


@pytest.mark.parametrize("program", ["nuc980.netboot", "scripts/nuc980-netboot"])
def test_second_netboot_on_one_address_is_named(program: str) -> None:
    port = free_port()
    with (
        serving(program, port) as pid,
        pytest.raises(TftpError) as raised,
        FileService("127.0.0.1", port, "127.0.0.1"),
    ):
        pass
    assert raised.value.cause == f"another nuc980-netboot (process {pid}) serves its board there"
    assert "--server-ip" in raised.value.next_step


def test_other_server_is_named_by_its_program() -> None:
    port = free_port()
    with (
        serving("tftpd", port) as pid,
        pytest.raises(TftpError) as raised,
        FileService("127.0.0.1", port, "127.0.0.1"),
    ):
        pass
    assert f"(process {pid}) has the port" in raised.value.cause
