# SPDX-License-Identifier: GPL-3.0-or-later
"""A serial line: devices, sockets, RFC 2217; what is wrong with a port is said; every byte is in the log."""

import errno
import os
import pty
import re
import select
import signal
import socket
import subprocess
import sys
import termios
import threading
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from unittest import mock

import pytest
import serial
import serial.rfc2217

from netboot.clockwork import Board, PtyBoard, UBoot, fastest
from nuc980 import ports
from nuc980.netboot import transport
from nuc980.netboot.console import Console
from nuc980.netboot.errors import (
    LineLost,
    NetbootError,
    NoOutput,
    NoSuchUrl,
    NotAPort,
    PortBusy,
    PortForbidden,
    PortMissing,
    PortUnreachable,
    SpeedRefused,
    UnusableInput,
)
from nuc980.netboot.progress import Progress
from nuc980.netboot.target import Target
from nuc980.netboot.transport import Line

SCRIPTS = Path(__file__).parents[2] / "scripts"
PROMPT = UBoot(at_prompt=True)


class Pty:
    def __init__(self) -> None:
        self.master, self.slave = os.openpty()
        tty.setraw(self.slave)
        self.name = os.ttyname(self.slave)

    def hear(self, size: int) -> bytes:
        heard = b""
        while len(heard) < size and select.select([self.master], [], [], 5)[0]:
            heard += os.read(self.master, 4096)
        return heard

    def close(self) -> None:
        """Each end once: its number is soon another's."""
        for end in (self.master, self.slave):
            if end >= 0:
                os.close(end)
        self.master = self.slave = -1


@pytest.fixture
def wire() -> Iterator[Pty]:
    wire = Pty()
    yield wire
    wire.close()


# ---- a device


def test_bytes_go_both_ways(wire: Pty) -> None:
    with Line(wire.name) as line:
        line.write(bytes(range(256)))
        assert wire.hear(256) == bytes(range(256))
        os.write(wire.master, bytes(range(256)))
        heard = b""
        while new := line.read(0.2):
            heard += new
        assert heard == bytes(range(256))


def test_read_ends_in_time_and_at_once(wire: Pty) -> None:
    with Line(wire.name) as line:
        taken = []
        for _ in range(100):
            start = time.monotonic()
            assert line.read(0) == b""
            taken.append(time.monotonic() - start)
        assert min(taken) < transport.POLL_SECONDS
        start = time.monotonic()
        assert line.read(0.1) == b""
        assert 0.1 <= time.monotonic() - start < 5.0
        os.write(wire.master, b"x")
        assert line.read(100) == b"x"
        assert time.monotonic() - start < 50.0


def test_speed_is_the_ports(wire: Pty) -> None:
    with Line(wire.name, 57600) as line:
        assert termios.tcgetattr(wire.master)[5] == termios.B57600
        line.baud = 38400
        assert (line.baud, termios.tcgetattr(wire.master)[5]) == (38400, termios.B38400)


def test_port_opens_again_and_again(wire: Pty) -> None:
    """glibc calls it an error to set a pty to what it has."""
    for _ in range(3):
        with Line(wire.name) as line:
            line.baud = 9600
            line.baud = 9600


def test_close_makes_no_edge_on_dtr(wire: Pty) -> None:
    with Line(wire.name):
        assert not termios.tcgetattr(wire.slave)[2] & termios.HUPCL


@pytest.mark.parametrize("seconds", [0.0, 5.0])
def test_port_that_goes_away_is_said(wire: Pty, seconds: float) -> None:
    unplugged = threading.Timer(0.05, wire.close)
    with Line(wire.name) as line:
        unplugged.start()
        with pytest.raises(LineLost, match=re.escape(wire.name)):
            while True:
                line.read(seconds)
                line.write(b"x" if not seconds else b"")
    unplugged.join()


def test_port_that_takes_nothing_is_said(wire: Pty) -> None:
    with (
        mock.patch.object(transport, "WRITE_SECONDS", 0.1),
        Line(wire.name) as line,
        pytest.raises(LineLost, match="timeout"),
    ):
        line.write(b"x" * 1_000_000)


# ---- what is wrong with a port


@contextmanager
def other_program(deed: str, port: str) -> Iterator[int]:
    """A program that has done this to the port; its process number."""
    program = f"import fcntl, os, sys, time; {deed}; print(flush=True); time.sleep(60)"
    with subprocess.Popen([sys.executable, "-c", program, port], stdout=subprocess.PIPE) as other:
        try:
            assert other.stdout and other.stdout.readline()
            yield other.pid
        finally:
            other.kill()


def refused(url: str, error: type[UnusableInput], baud: int = 115200) -> UnusableInput:
    with pytest.raises(error) as raised:
        Line(url, baud)
    assert type(raised.value) is error
    assert url in raised.value.what
    assert raised.value.exit_code == 2
    assert raised.value.cause and raised.value.next_step
    return raised.value


def test_missing_port_names_those_that_are_there() -> None:
    there = mock.Mock(device="/dev/ttyUSB7")
    with mock.patch("serial.tools.list_ports.comports", return_value=[there]):
        assert "/dev/ttyUSB7" in refused("/dev/ttyNOWHERE", PortMissing).next_step
    with mock.patch("serial.tools.list_ports.comports", return_value=[]):
        assert "plug the adapter in" in refused("/dev/ttyNOWHERE", PortMissing).next_step


@pytest.mark.parametrize("name", ["folder", "file", "/dev/null", "folder/../folder"])
def test_what_is_no_port_is_refused(tmp_path: Path, name: str) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").touch()
    refused(str(tmp_path / name), NotAPort)


@pytest.mark.parametrize(
    ("group", "advice"), [("dialout", "usermod -aG dialout $USER"), ("root", "a udev rule")]
)
def test_port_without_permission_says_how_to_get_it(wire: Pty, group: str, advice: str) -> None:
    def forbidden(*arguments: object) -> int:
        raise PermissionError(errno.EACCES, "Permission denied")

    with mock.patch("os.open", forbidden), mock.patch.object(Path, "group", return_value=group):
        assert advice in refused(wire.name, PortForbidden).next_step


def test_port_that_another_program_has_names_it(wire: Pty) -> None:
    with other_program("port = open(sys.argv[1]); fcntl.flock(port, fcntl.LOCK_EX)", wire.name) as number:
        error = refused(wire.name, PortBusy)
        assert re.search(rf"it is open in python\S* \({number}\)", error.cause)


def test_second_line_on_a_port_is_refused(wire: Pty) -> None:
    with Line(wire.name):
        refused(wire.name, PortBusy)
    with Line(wire.name):
        pass


def test_programs_that_share_a_port_are_known(wire: Pty) -> None:
    with Line(wire.name) as line:
        assert line.shared_with() == []
        with other_program("os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)", wire.name) as number:
            assert [name.split()[-1] for name in line.shared_with()] == [f"({number})"]


def test_programs_may_end_while_they_are_asked(wire: Pty, monkeypatch: pytest.MonkeyPatch) -> None:
    scan = os.scandir
    with Line(wire.name) as line, subprocess.Popen(["cat"], stdin=subprocess.PIPE) as ending:

        def end_and_scan(path: object) -> object:
            if str(path) == f"/proc/{ending.pid}/fd":
                ending.communicate()
            return scan(path)

        monkeypatch.setattr(os, "scandir", end_and_scan)
        assert line.shared_with() == []
        assert ending.returncode == 0


@pytest.mark.slow
def test_program_that_reads_along_is_told_at_the_start() -> None:
    """Locks keep only those out that ask for one, as `cat` does not."""
    told: list[str] = []
    with PtyBoard(Board(PROMPT)) as board, Line(board.port) as line:
        with other_program("os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)", board.port) as number:
            progress = mock.Mock(Progress, note=told.append, phase=lambda name: nullcontext())
            with Target(board.port).session(line, progress):
                pass
        assert re.search(rf"Beware: the port is open in python\S* \({number}\) too.* Close", told[0])
        told.clear()
        with Target(board.port).session(line, progress):
            pass
        assert told == []


@pytest.mark.slow
def test_program_that_may_have_taken_the_answer_is_named(wire: Pty) -> None:
    with (
        Line(wire.name) as line,
        other_program("os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)", wire.name) as number,
        pytest.raises(NoOutput) as raised,
    ):
        Console(line).reach(patience=0.2)
    assert f"({number}) too, which may take what the board says" in raised.value.cause


def test_pty_has_no_speed(wire: Pty) -> None:
    with Line(wire.name) as line:
        assert not line.has_speed
    with mock.patch.object(ports, "PTYS", ()), Line(wire.name) as line:
        assert line.has_speed


@pytest.mark.parametrize("baud", [0, -1])
def test_speed_that_no_port_has_is_refused(wire: Pty, baud: int) -> None:
    refused(wire.name, SpeedRefused, baud)


def test_speed_that_the_port_refuses_leaves_the_old_one(wire: Pty) -> None:
    with Line(wire.name) as line:
        refusal = termios.error(22, "Invalid argument")
        with mock.patch("termios.tcsetattr", side_effect=refusal), pytest.raises(SpeedRefused):
            line.baud = 9600
        line.baud = 57600
        assert line.baud == 57600


@pytest.mark.parametrize(
    "url",
    [
        "foo://x",
        "sockets://host:1",
        "socket://127.0.0.1",
        "socket://127.0.0.1:port",
        "rfc2217://:1",
        "://",
        "socket://[",
    ],
)
def test_url_that_is_none_is_told_which_there_are(url: str) -> None:
    advice = refused(url, NoSuchUrl).next_step
    assert "socket://HOST:PORT" in advice and "rfc2217://HOST:PORT" in advice


@pytest.mark.parametrize("scheme", ["socket", "rfc2217"])
def test_server_that_is_not_there_is_said(scheme: str) -> None:
    assert "ser2net" in refused(f"{scheme}://127.0.0.1:1", PortUnreachable).cause


@pytest.mark.slow
def test_server_without_rfc2217_is_refused() -> None:
    with server(lambda connection: connection.recv(1) and time.sleep(5)) as port:
        assert "socket://" in refused(f"rfc2217://127.0.0.1:{port}?timeout=0.2", PortUnreachable).next_step


# ---- over a network


@contextmanager
def server(serve: Callable[[socket.socket], object]) -> Iterator[int]:
    """A TCP server for one client, in a thread."""
    listener = socket.create_server(("127.0.0.1", 0))

    def run() -> None:
        with suppress(OSError):
            connection, _ = listener.accept()
            with connection:
                serve(connection)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        yield listener.getsockname()[1]
    finally:
        listener.close()


def bridge(port: str, delay: float = 0.0) -> Callable[[socket.socket], None]:
    """A serial server at its worst: a segment for each byte. delay: of the network, each way, in seconds."""

    def serve(connection: socket.socket) -> None:
        device = os.open(port, os.O_RDWR | os.O_NOCTTY)
        try:
            while True:
                ready, _, _ = select.select([device, connection], [], [])
                time.sleep(delay)
                if connection in ready:
                    if not (data := connection.recv(4096)):
                        return
                    os.write(device, data)
                if device in ready:
                    for byte in os.read(device, 4096):
                        connection.send(bytes([byte]))
        except OSError:
            return
        finally:
            os.close(device)

    return serve


def rfc2217(port: str) -> Callable[[socket.socket], None]:
    """A server as pyserial's documentation has it: a PortManager on a port."""

    class NoModem(serial.Serial):
        cts = dsr = ri = cd = dtr = rts = False  # a pty has none of them

    def serve(connection: socket.socket) -> None:
        with NoModem(port, timeout=0) as device:
            manager = serial.rfc2217.PortManager(device, mock.Mock(write=connection.sendall))
            while True:
                ready, _, _ = select.select([device.fileno(), connection], [], [], 0.1)
                if connection in ready:
                    if not (data := connection.recv(1024)):
                        return
                    device.write(b"".join(manager.filter(data)))
                if device.fileno() in ready:
                    connection.sendall(b"".join(manager.escape(device.read(1024))))

    return serve


@pytest.mark.slow
def test_console_over_a_socket_is_quick() -> None:
    """Nagle at the other end and delayed acknowledgements here make 40 ms of a byte."""
    with (
        PtyBoard(Board(PROMPT)) as board,
        server(bridge(board.port)) as port,
        Line(f"socket://127.0.0.1:{port}") as line,
    ):
        assert not line.has_speed
        at = Console(line)
        at.reach()
        assert at.run("false").status == 1
        assert fastest(lambda: at.run("false"), 10) < 0.1


@pytest.mark.slow
def test_console_over_a_slow_network() -> None:
    with (
        PtyBoard(Board(PROMPT)) as board,
        server(bridge(board.port, delay=0.15)) as port,
        Line(f"socket://127.0.0.1:{port}") as line,
    ):
        at = Console(line)
        at.reach()
        assert at.run("false").status == 1
        assert at.run("crc32 0 10").output.endswith("bcda9946\n")


@pytest.mark.slow
def test_socket_that_closes_is_said() -> None:
    with (
        server(lambda connection: connection.sendall(b"last")) as port,
        Line(f"socket://127.0.0.1:{port}") as line,
        pytest.raises(LineLost, match="disconnected"),
    ):
        while True:
            line.read(1.0)


@pytest.mark.slow
def test_console_over_rfc2217(wire: Pty) -> None:
    with (
        PtyBoard(Board(PROMPT)) as board,
        server(rfc2217(board.port)) as port,
        Line(f"rfc2217://127.0.0.1:{port}") as line,
    ):
        assert line.has_speed
        line.baud = 57600
        line.baud = 115200
        at = Console(line)
        at.reach()
        assert at.run("false").status == 1
        # Each change of a time-out would be a round trip and 50 ms.
        assert fastest(lambda: at.run("false"), 3) < 1.0


# ---- the log


def test_log_has_every_byte_with_its_time(wire: Pty, tmp_path: Path) -> None:
    log = tmp_path / "log"
    with Line(wire.name, log=log) as line:
        line.write(b"version\r")
        os.write(wire.master, b"U-Boot \xff'\n")
        line.read(1)
        line.baud = 9600
        kept = log.read_text().splitlines()
    assert re.fullmatch(rf" +0\.\d{{4}} = \d{{4}}-\d\d-\d\dT\S+ {wire.name} 115200 bit/s", kept[0])
    assert re.fullmatch(r" +0\.\d{4} > 'version\\r'", kept[1])
    assert re.fullmatch(r""" +0\.\d{4} < "U-Boot \\xff'\\n\"""", kept[2])
    assert re.fullmatch(r" +0\.\d{4} = 9600 bit/s", kept[3])


def test_log_of_a_program_that_is_killed_is_whole(wire: Pty, tmp_path: Path) -> None:
    log = tmp_path / "log"
    program = (
        "import sys; from pathlib import Path; from nuc980.netboot.transport import Line\n"
        "line = Line(sys.argv[1], log=Path(sys.argv[2])); line.write(b'last words')\n"
        "while True: line.read(1)"
    )
    with subprocess.Popen(
        [sys.executable, "-c", program, wire.name, log], env={**os.environ, "PYTHONPATH": str(SCRIPTS)}
    ) as other:
        assert wire.hear(10) == b"last words"
        other.kill()
    assert log.read_text().endswith("> 'last words'\n")


def test_log_that_cannot_be_written_is_refused_before_the_port_is_opened(tmp_path: Path) -> None:
    with (
        pytest.raises(UnusableInput, match="No such file"),
        mock.patch("os.open", side_effect=AssertionError),
    ):
        Line("/dev/ttyNOWHERE", log=tmp_path / "folder" / "log")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_full_disk_does_not_end_the_work(wire: Pty) -> None:
    with (
        pytest.raises(UnusableInput, match="/dev/full: No space left"),
        Line(wire.name, log=Path("/dev/full")) as line,
    ):
        line.write(b"goes on")
        assert wire.hear(7) == b"goes on"


# ---- handed over to a person

TERMINAL = (
    "import sys; from nuc980.netboot.transport import Line; from nuc980.netboot.terminal import hand_over\n"
    "from nuc980.netboot.errors import NetbootError\n"
    "try:\n"
    "    with Line(sys.argv[1]) as line: hand_over(line)\n"
    "except NetbootError as error: sys.exit(str(error))\n"
)


class Person:
    """A program on a terminal, and who sits at it."""

    def __init__(self, port: str) -> None:
        self.terminal = Pty()
        termios.tcsetattr(self.terminal.slave, termios.TCSANOW, pty_in_order())
        self.before = termios.tcgetattr(self.terminal.slave)
        slave = self.terminal.slave
        self.program = subprocess.Popen(
            [sys.executable, "-c", TERMINAL, port],
            env={**os.environ, "PYTHONPATH": str(SCRIPTS)},
            stdin=slave, stdout=slave, stderr=slave,
        )  # fmt: skip

    def sees(self, text: bytes) -> bytes:
        seen = b""
        deadline = time.monotonic() + 10
        while text not in seen and time.monotonic() < deadline:
            if select.select([self.terminal.master], [], [], 0.1)[0]:
                seen += os.read(self.terminal.master, 4096)
        assert text in seen
        return seen

    def types(self, keys: bytes) -> None:
        os.write(self.terminal.master, keys)

    def leaves_it_as_it_was(self) -> int:
        code = self.program.wait(10)
        assert termios.tcgetattr(self.terminal.slave) == self.before
        return code


def pty_in_order() -> list:
    """The settings of a fresh terminal."""
    master, slave = pty.openpty()
    settings = termios.tcgetattr(slave)
    os.close(master)
    os.close(slave)
    return settings


@pytest.fixture
def person(wire: Pty) -> Iterator[Person]:
    person = Person(wire.name)
    yield person
    person.program.kill()
    person.program.wait()
    person.terminal.close()


def test_terminal_passes_keys_and_is_left_with_its_key(wire: Pty, person: Person) -> None:
    assert b"Ctrl-]" in person.sees(b"go to the board")
    os.write(wire.master, b"\x1b[1mlogin:\x1b[0m ")
    person.sees(b"\x1b[1mlogin:\x1b[0m ")
    person.types(b"root\r\x03\x04")
    assert wire.hear(7) == b"root\r\x03\x04"
    person.types(b"last\x1dlost")
    assert wire.hear(4) == b"last"
    person.sees(b"yours again")
    assert person.leaves_it_as_it_was() == 0


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_terminal_is_put_right_when_it_is_ended(person: Person, number: int) -> None:
    person.sees(b"go to the board")
    time_of_raw = time.monotonic() + 5
    while termios.tcgetattr(person.terminal.slave) == person.before and time.monotonic() < time_of_raw:
        time.sleep(0.01)
    person.program.send_signal(number)
    assert person.leaves_it_as_it_was() == 128 + number


@pytest.mark.slow
def test_terminal_is_put_right_when_the_line_is_lost(wire: Pty, person: Person) -> None:
    person.sees(b"go to the board")
    wire.close()
    assert b"likely cause: the adapter was unplugged" in person.sees(b"next step")
    assert person.leaves_it_as_it_was() == 1


def test_terminal_needs_a_terminal(wire: Pty) -> None:
    ran = subprocess.run(
        [sys.executable, "-c", TERMINAL, wire.name],
        env={**os.environ, "PYTHONPATH": str(SCRIPTS)},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
    )
    assert ran.returncode == 1
    assert "--console needs a terminal" in ran.stderr


@pytest.mark.slow
def test_every_error_of_the_line_says_cause_and_next_step() -> None:
    def below(kind: type[NetbootError]) -> Iterator[type[NetbootError]]:
        for child in kind.__subclasses__():
            if child.__module__.startswith("nuc980."):
                yield child
            yield from below(child)

    assert [
        kind for kind in below(UnusableInput) if kind.__name__.startswith("Port") and not kind.next_step
    ] == []
    assert [
        kind for kind in below(NetbootError) if kind.exit_code == 1 and not (kind.cause and kind.next_step)
    ] == []
