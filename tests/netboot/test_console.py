# SPDX-License-Identifier: GPL-3.0-or-later
"""U-Boot's command line: reached from anywhere, typed so that nothing else runs, and its status is true.

Most boards here are clockwork: their time runs as fast as it is looked at.
"""

import os
import re
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Self
from unittest import mock

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from netboot.clockwork import (
    BANNER,
    COMMANDS,
    STREAMS,
    Board,
    Life,
    Noise,
    PtyBoard,
    UBoot,
    VirtualLine,
    at_speed,
    fastest,
    hiss,
    kernel,
    login,
    shell,
    silent,
)
from nuc980.netboot import console
from nuc980.netboot.arrival import CTRL_C, KNOCK, SPEEDS
from nuc980.netboot.commandline import COMMAND_ROOM, LINE_ROOM, typed
from nuc980.netboot.console import Console
from nuc980.netboot.errors import (
    AutobootMissed,
    BoardHung,
    BoardReset,
    CommandFailed,
    Garbage,
    LineTooLong,
    LineUnsafe,
    NetbootError,
    NoOutput,
    NoStatus,
    NotUBoot,
    PowerHookFailed,
    StuckConsole,
)
from nuc980.netboot.power import PowerHook
from nuc980.netboot.transport import Line
from nuc980.twin.nand import NandImage

PROMPT = UBoot(at_prompt=True)


class Bench:
    """A clockwork board with a console on it, and what the console told."""

    def __init__(self, life: Callable[[Board], Life], **board: int) -> None:
        self.board = Board(life, **board)
        self.line = VirtualLine(self.board)
        self.told: list[str] = []
        self.console = Console(self.line, self.told.append)

    def reached(self) -> Console:
        self.console.reach()
        self.board.ran.clear()
        self.line.sent = b""
        return self.console

    @property
    def entered(self) -> list[str]:
        """The lines that were sent with an Enter, without those given up by Ctrl-C."""
        lines = self.line.sent.split(b"\r")[:-1]
        return [re.sub(rb".*\x03|[\x01\x05]", b"", line).decode() for line in lines]


# ---- to the prompt


@pytest.mark.parametrize(
    "board",
    [
        UBoot(),
        UBoot(end=b"\r\n"),
        UBoot(delay=0),
        UBoot(bootcmd=False),
        UBoot(prompt=b"U-Boot> "),
        UBoot(prompt=b"nuc980# "),
        UBoot(editing=False),
        UBoot(before=b"\xff\x00\xfe\xfe\x80\xff\x00\xff\x00\x00\xe0\xff"),
        UBoot(at_prompt=True),
        UBoot(at_prompt=True, prompt=b"nuc980# "),
        UBoot(at_prompt=True, typed=b"nand erase 0x2000"),
        UBoot(at_prompt=True, unfinished="if true"),
        UBoot(running="sleep 100"),
        UBoot(running="erase 7"),
        UBoot(running="unended ==> "),
        UBoot(prompts=lambda count: (1.5 if count in (1, 2) else 0.0, b"")),
    ],
    ids=[
        "power-up", "right line ends", "bootdelay 0", "no bootcmd", "U-Boot>", "nuc980#", "no line editor",
        "noise before the banner", "at the prompt", "at nuc980#", "half a line typed", "an if not ended",
        "in a command", "in a deaf command", "after what looks like a prompt",
        "late prompts",
    ],
)  # fmt: skip
def test_prompt_is_reached(board: UBoot) -> None:
    bench = Bench(board)
    before = [board.running] if board.running else []
    bench.console.reach()
    assert bench.console.prompt == board.prompt
    assert bench.board.ran == [*before, "version"]
    assert b"\r" not in bench.line.sent.split(b"if version")[0]
    assert bench.console.run("echo hello").output == "hello\n"


def test_what_the_board_said_comes_back() -> None:
    output = Bench(UBoot()).console.reach()
    assert (BANNER + STREAMS).decode() in output
    assert "\r" not in output


def test_keys_come_from_the_first_words_on_and_not_before() -> None:
    """What a boot ROM or an SPL sees is one key a second."""

    def late(board: Board) -> Life:
        yield 10.0
        yield from UBoot(delay=0)(board)

    bench = Bench(late)
    bench.console.reach()
    assert bench.told[0].startswith("Waiting for the board")
    silent_keys = bench.line.sent.split(b"if version")[0].count(CTRL_C)
    assert silent_keys < 10 + len(SPEEDS) + 10


@pytest.mark.parametrize("speed", [speed for speed in SPEEDS if speed != 921600])
@pytest.mark.parametrize("board", [PROMPT, UBoot()], ids=["at the prompt", "power-up"])
def test_speed_is_found(board: UBoot, speed: int) -> None:
    bench = Bench(board, baud=speed)
    bench.console.reach()
    assert bench.line.baud == speed
    assert speed == 115200 or bench.told[-1] == f"The board's console has {speed} bit/s, not 115200."


def test_poke_at_a_wrong_speed_is_no_enter() -> None:
    for sent in SPEEDS:
        for read in SPEEDS:
            for resync in (True, False):
                for keys in (CTRL_C, CTRL_C * 3, KNOCK):
                    heard = at_speed(keys, sent, read, resync)
                    assert not set(heard) & set(b"\r\n"), (sent, read, heard)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("board", "error"),
    [
        (silent, NoOutput),
        (hiss, Garbage),
        (login, NotUBoot),
        (shell, NotUBoot),
        (kernel, AutobootMissed),
        (UBoot(running="hang"), NoOutput),
        (UBoot(running="chatter"), NotUBoot),
        (UBoot(at_prompt=True, hush=False), NoStatus),
    ],
    ids=["dead", "hiss", "login", "shell", "kernel", "hangs", "chatters", "no hush"],
)
def test_error_says_what_is_there(board: Callable[[Board], Life], error: type[NetbootError]) -> None:
    bench = Bench(board)
    with pytest.raises(error) as raised:
        bench.console.reach(patience=12.0)
    assert raised.value.cause
    assert raised.value.next_step
    assert bench.board.now < 16.0


def gives_up(board: Board) -> Life:
    """U-Boot's hang(), as it comes to it by a start that fails."""
    yield 10.0
    yield BANNER + b"initcall sequence 03f9b6c4 failed\n\r### ERROR ### Please RESET the board ###\n\r"
    yield from silent(board)


@pytest.mark.parametrize("hook", [False, True])
def test_board_that_gives_up_is_named_at_once(hook: bool) -> None:
    bench = Bench(gives_up)
    with pytest.raises(BoardHung, match="initcall sequence 03f9b6c4 failed") as raised:
        bench.console.reach(bench.board.power_cycle if hook else None, patience=60.0)
    assert "switch the board off and on" in raised.value.next_step
    assert bench.board.now < 12.0


def test_board_that_gave_up_may_be_started_anew() -> None:
    def at_last(board: Board) -> Life:
        yield from UBoot()(board) if board.power_ups else gives_up(board)

    bench = Bench(at_last)
    with pytest.raises(BoardHung):
        bench.console.reach()
    bench.console.reach(bench.board.power_cycle)


def test_kernel_is_known_by_a_cut_line() -> None:
    """The vendor's U-Boot leaves so much of its last words; a kernel that is quiet then says no more."""

    def boots(board: Board) -> Life:
        yield b"Starti[    0.000000] Booting Linux on physical CPU 0x0\r\n"
        yield from silent(board)

    with pytest.raises(AutobootMissed):
        Bench(boots).console.reach(patience=12.0)


@pytest.mark.parametrize("board", [silent, hiss])
def test_error_names_who_else_reads_the_port(board: Callable[[Board], Life]) -> None:
    bench = Bench(board)
    with (
        mock.patch.object(bench.line, "other_readers", return_value="the port is open in minicom (42) too"),
        pytest.raises(NetbootError) as raised,
    ):
        bench.console.reach(patience=5.0)
    assert "the port is open in minicom (42) too" in raised.value.cause


def test_garbage_from_a_serial_server_is_the_servers_speed() -> None:
    bench = Bench(hiss)
    bench.line.has_speed = False
    with pytest.raises(Garbage) as raised:
        bench.console.reach(patience=5.0)
    assert "a serial server or a pty's other end" in raised.value.next_step
    assert bench.line.baud == 115200


@pytest.mark.slow
@pytest.mark.parametrize("board", [login, shell, kernel])
def test_linux_gets_few_keys_and_no_enter(board: Callable[[Board], Life]) -> None:
    bench = Bench(board)
    with pytest.raises(NetbootError):
        bench.console.reach(patience=20.0)
    assert bench.line.sent.replace(KNOCK, b"") in (b"", CTRL_C, CTRL_C * 2)
    assert bench.told and "switch it off and on" in bench.told[-1]


def test_somebody_may_switch_a_board_that_runs_linux() -> None:
    def switched(board: Board) -> Life:
        yield b"[    9.000000] eth0: link up\r\n\r\nopenrtu login: "
        yield 20.0
        yield from UBoot()(board)

    bench = Bench(switched)
    bench.console.reach()
    assert bench.console.run("false").status == 1


# ---- power hooks, in real time


@contextmanager
def pty(board: Board) -> Iterator[tuple[Console, list[str]]]:
    told: list[str] = []
    with PtyBoard(board) as port, Line(port.port) as line:
        yield Console(line, told.append), told


@pytest.mark.slow
def test_hook_starts_a_board() -> None:
    board = Board(lambda board: UBoot()(board) if board.power_ups else login(board))
    with pty(board) as (at, _):
        at.reach(board.power_cycle)
        assert at.run("false").status == 1
    assert board.power_ups == 1


@pytest.mark.slow
def test_hook_that_lasts_longer_than_autoboot_does_not_miss_it() -> None:
    def slow() -> None:
        board.power_cycle()
        time.sleep(1.0)

    board = Board(lambda board: UBoot(delay=0)(board) if board.power_ups else PROMPT(board))
    with pty(board) as (at, _):
        at.reach(slow, patience=0.9)
        assert at.run("true").status == 0
    assert board.power_ups == 1


@pytest.mark.slow
def test_hook_is_tried_three_times_when_autoboot_is_missed() -> None:
    def third(board: Board) -> Life:
        yield from (UBoot(delay=60) if board.power_ups == 3 else deaf)(board)

    def deaf(board: Board) -> Life:
        yield BANNER
        yield from kernel(board)

    board = Board(third)
    with pty(board) as (at, told):
        at.reach(board.power_cycle, patience=60.0)
    assert board.power_ups == 3
    assert sum("Once more" in text for text in told) == 2

    board = Board(deaf)
    with pty(board) as (at, _), pytest.raises(AutobootMissed):
        at.reach(board.power_cycle, patience=60.0)
    assert board.power_ups == 3


@pytest.mark.slow
def test_hook_that_switches_another_board_is_found_out() -> None:
    with pty(Board(PROMPT)) as (at, _), pytest.raises(PowerHookFailed, match="did not restart"):
        at.reach(lambda: None, patience=1.0)


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ("sh -c 'echo no relay >&2; exit 3'", "ended with 3: no relay"),
        ("sh -c 'echo on stdout; exit 3'", "on stdout"),
        ("/nowhere/relay", "cannot be started: No such file"),
    ],
)
def test_hook_that_fails_says_why(command: str, message: str) -> None:
    with pty(Board(silent)) as (at, _), pytest.raises(PowerHookFailed, match=message):
        at.reach(PowerHook(command), patience=5.0)


# ---- commands


def test_status_and_output_are_the_commands() -> None:
    at = Bench(PROMPT).reached()
    assert at.run("true") == console.Answer("true", 0, "")
    assert at.run("false").status == 1
    assert at.run("nonsense").output == "Unknown command 'nonsense' - try 'help'\n"
    assert at.run("nonsense").status == 1
    assert at.run("unended no line feed").output == "no line feed"
    assert at.run("true; false").status == 1
    with pytest.raises(CommandFailed, match="'false' failed: it printed nothing"):
        at.run("false").required()


def test_prompt_is_not_looked_for_in_the_output() -> None:
    answer = Bench(PROMPT).reached().run("crc32 0 10")
    assert answer.output == "crc32 for 00000000 ... 0000000f ==> bcda9946\n"
    assert Bench(PROMPT).reached().run("unended => ").output == "=>"


def test_output_is_seen_as_it_comes() -> None:
    seen: list[str] = []
    Bench(PROMPT).reached().run("crc32 0 10", watch=seen.append)
    assert any(text.endswith("==> ") for text in seen)


def test_what_is_typed_is_what_typed_says() -> None:
    bench = Bench(PROMPT)
    at = bench.reached()
    at.run("write 1")
    at.run("true")
    assert bench.entered == [typed("write 1", 2), typed("true", 3)]


def test_line_that_does_not_fit_is_not_begun() -> None:
    bench = Bench(PROMPT)
    at = bench.reached()
    assert at.run("echo " + "x" * (COMMAND_ROOM - 5)).status == 0
    assert len(bench.entered[0]) < LINE_ROOM
    bench.line.sent = b""
    for wrong in ("x" * LINE_ROOM, "setenv name Müller", "echo a\rreset", "echo \x03"):
        with pytest.raises(LineTooLong):
            at.run(wrong)
    assert bench.line.sent == b""
    at.run("true")
    assert bench.entered == [typed("true", 3)]


def once(at: int, what: bytes) -> Callable[[int, bytes], bytes]:
    return lambda count, byte: what if count == at else byte


@pytest.mark.parametrize(
    "echo",
    [
        once(80, b""),
        once(80, b"x"),
        once(80, b"ee"),
        once(80, b"e\r\nlink is up\r\n"),
        once(50, b""),
    ],
    ids=["lost", "changed", "twice", "somebody writes", "lost in the first line"],
)
def test_echo_that_is_wrong_is_typed_again(echo: Callable[[int, bytes], bytes]) -> None:
    bench = Bench(replace(PROMPT, echo=echo))
    bench.console.reach()
    assert bench.console.run("write 1").status == 0
    assert bench.console.run("false").status == 1
    assert bench.board.ran == ["version", "write 1", "false"]


def test_echo_that_stays_wrong_is_an_error() -> None:
    bench = Bench(replace(PROMPT, echo=lambda count, byte: b"" if count > 60 else byte))
    at = bench.reached()
    with pytest.raises(LineUnsafe, match="does not come back as typed"):
        at.run("write 1")
    assert bench.board.ran == []


class Cut(VirtualLine):
    """Loses what a pattern finds in the bytes to the board or back, so many times."""

    def __init__(self, board: Board, to: bytes = b"", back: bytes = b"", times: int = 1) -> None:
        super().__init__(board)
        self._to, self._back, self._times = to, back, times

    def write(self, data: bytes, *, secret: bool = False) -> None:
        super().write(self._cut(self._to, data))

    def read(self, seconds: float) -> bytes:
        return self._cut(self._back, super().read(seconds))

    def _cut(self, pattern: bytes, data: bytes) -> bytes:
        if pattern and self._times:
            data, count = re.subn(pattern, b"", data, count=1)
            self._times -= count
        return data


def cut(life: UBoot, **what: bytes | int) -> tuple[Console, Board]:
    board = Board(life)
    at = Console(VirtualLine(board))
    at.reach()
    board.ran.clear()
    at.line = Cut(board, **what)  # type: ignore[assignment,arg-type]
    return at, board


LOST = {
    "a byte of the command": {"to": rb"(?<=i)f"},
    "Enter": {"to": rb"\r"},
    "the key before the line is read back": {"to": rb"\x01"},
    "the marker": {"back": rb"@\d+:ok\r?\n?"},
    "a byte of the marker": {"back": rb"(?<=@\d:)o"},
    "the prompt": {"back": rb"=> $"},
    "the marker and the prompt": {"back": rb"@\d+:ok[^$]*=> $"},
}


@pytest.mark.parametrize("lost", LOST.values(), ids=LOST)
def test_what_is_lost_once_is_made_good(lost: dict[str, bytes]) -> None:
    at, board = cut(PROMPT, **lost)
    assert at.run("write 1").status == 0
    assert at.run("false").status == 1
    assert set(board.ran) == {"write 1", "false"}
    if lost != LOST["the marker and the prompt"]:  # which look like a command that runs on
        assert board.now < 9.0


@pytest.mark.parametrize("lost", LOST.values(), ids=LOST)
def test_what_is_not_repeatable_is_entered_once(lost: dict[str, bytes]) -> None:
    at, board = cut(PROMPT, **lost)
    with mock.patch.object(at, "start", wraps=at.start) as start:
        try:
            assert at.run("write 1", repeatable=False).status == 0
        except LineUnsafe:
            assert board.ran.count("write 1") <= 1
        assert start.call_count == 1
    assert board.ran.count("write 1") <= 1


def test_answers_that_stay_lost_are_an_error() -> None:
    at, board = cut(PROMPT, back=rb"@\d+:ok[\r\n]+", times=99)
    with pytest.raises(LineUnsafe, match="The answer to 'write 1' was lost"):
        at.run("write 1")
    assert board.ran == ["write 1"] * 3


def test_late_and_noisy_prompts_are_waited_for() -> None:
    late = {2: (2.5, b""), 3: (0.0, b"\xff\xfe=\x80"), 4: (5.0, b"")}
    bench = Bench(replace(PROMPT, prompts=lambda count: late.get(count, (0.0, b""))))
    bench.console.reach()
    for _ in range(5):
        assert bench.console.run("write 1").status == 0
    assert bench.board.ran == ["version", *["write 1"] * 5]


def test_command_that_takes_too_long_is_ended() -> None:
    bench = Bench(PROMPT)
    at = bench.reached()
    with pytest.raises(StuckConsole, match="did not end within 10 s; Ctrl-C ended it"):
        at.run("sleep 100")
    assert bench.board.ran == ["sleep 100"]
    assert at.run("false").status == 1


def test_command_that_ends_a_little_late_has_its_status() -> None:
    at = Bench(PROMPT).reached()
    assert at.run("erase 12", seconds=10).status == 0


@pytest.mark.parametrize("command", ["hang", "chatter"])
def test_command_that_never_ends_is_an_error(command: str) -> None:
    bench = Bench(PROMPT)
    at = bench.reached()
    with pytest.raises(StuckConsole, match="Ctrl-C brings no prompt"):
        at.run(command)
    assert bench.board.now < 60


def test_reset_is_seen_while_a_command_runs() -> None:
    bench = Bench(PROMPT)
    at = bench.reached()
    with pytest.raises(BoardReset):
        at.run("reset")
    at.reach()
    assert at.run("false").status == 1


def test_reset_is_seen_while_a_line_is_typed() -> None:
    board = Board(PROMPT)
    at = Console(VirtualLine(board))
    at.reach()
    write = at.line.write
    cycles = iter([False, False, True])

    def cut_off(data: bytes) -> None:
        if next(cycles, False):
            board.power_cycle()
        write(data)

    at.line.write = cut_off  # type: ignore[method-assign]
    with pytest.raises(BoardReset):
        at.run("write 1")
    assert "write 1" not in board.ran


def test_started_command_is_left_running() -> None:
    bench = Bench(PROMPT)
    at = bench.reached()
    assert at.start("chatter") == 2
    assert b"link is up" in bench.line.read(1.0) + bench.line.read(1.0)


def test_version_command_is_no_reset() -> None:
    at = Bench(PROMPT).reached()
    assert "U-Boot 2016.11" in at.run("version").output


# ---- noise

MEANT = {"write 0x1234 0x2000": 0, "false": 1, "write 0x5678": 0, "crc32 0 10": 0}
NOISES = st.builds(
    Noise,
    drop=st.sampled_from([0.0, 0.0005, 0.005]),
    change=st.sampled_from([0.0, 0.0005, 0.005]),
    insert=st.sampled_from([0.0, 0.0005, 0.005]),
    double=st.sampled_from([0.0, 0.005]),
)


def wrong_deeds(to: Noise, back: Noise, seed: int, editing: bool = True) -> list[str]:
    """What happened on a noisy line that must never happen."""
    board = Board(replace(PROMPT, editing=editing))
    line = VirtualLine(board, seed=seed)
    at = Console(line)
    at.reach()
    board.ran.clear()
    line.to, line.back = to, back
    wrong = []
    for command, status in MEANT.items():
        repeatable = command != "write 0x5678"
        before = board.ran.count(command)
        with mock.patch.object(at, "start", wraps=at.start) as start:
            try:
                answer = at.run(command, repeatable=repeatable)
            except NetbootError:
                answer = None
        if answer and answer.status != status:
            wrong.append(f"{command}: {answer}")
        if answer and board.ran.count(command) == before:
            wrong.append(f"{command} was not run: {answer}")
        if not repeatable and start.call_count > 1:
            wrong.append(f"{command} was entered {start.call_count} times")
    others = [command for command in board.ran if command not in MEANT]
    # An Enter of noise within the first two letters leaves a word that U-Boot does not know.
    return wrong + [f"{command!r} was run" for command in others if command.split()[0] in COMMANDS]


# The same lines each time: one in many thousand has two faults that fit together (a key for the last line of
# the history, and an Enter).
@pytest.mark.slow
@settings(max_examples=60, deadline=None, derandomize=True)
@given(NOISES, NOISES, st.integers(0, 1 << 32))
def test_noise_makes_no_other_command_run(to: Noise, back: Noise, seed: int) -> None:
    assert wrong_deeds(to, back, seed) == []


@pytest.mark.soak
def test_noise_makes_no_other_command_run_in_thousands_of_sessions() -> None:
    loud = Noise(drop=0.003, change=0.003, insert=0.003, double=0.003)
    assert [wrong for seed in range(2000) for wrong in wrong_deeds(loud, loud, seed)] == []


@pytest.mark.slow
def test_noise_on_a_board_without_line_editor() -> None:
    loud = Noise(drop=0.002, change=0.002, insert=0.002)
    assert [wrong for seed in range(500) for wrong in wrong_deeds(loud, Noise(), seed, editing=False)] == []


def careless_typed(command: str, number: int) -> str:
    return f"{command}; echo @{number}:ok;"


LOUD = Noise(drop=0.02, change=0.02, insert=0.02, double=0.02)
FLAWS: dict[str, tuple[Noise, Noise, list[tuple[object, str, object]]]] = {
    "no look at echo and line": (LOUD, LOUD, [(Console, "_type", lambda self, line: self.line.write(line))]),
    "an echo only": (
        Noise(insert=0.02),
        Noise(drop=0.02),
        [(Console, "_read_back", lambda self, line: True)],
    ),
    "no if": (LOUD, LOUD, [(console, "typed", careless_typed), (console, "IF", b"")]),
}


@pytest.mark.slow
@pytest.mark.parametrize(("to", "back", "flaws"), FLAWS.values(), ids=FLAWS)
def test_noise_would_find_a_careless_console(
    to: Noise, back: Noise, flaws: list[tuple[object, str, object]]
) -> None:
    with ExitStack() as patches:
        for place, name, flaw in flaws:
            patches.enter_context(mock.patch.object(place, name, flaw))
        assert any("was run" in wrong for seed in range(400) for wrong in wrong_deeds(to, back, seed))


# ---- real ones

DEBIAN = ("qemu-system-arm", "-M", "virt", "-bios", "/usr/lib/u-boot/qemu_arm/u-boot.bin")


class Qemu:
    """A machine with its UART on a pty, and a switch."""

    def __init__(self, *command: str | Path) -> None:
        serial = (
            "-chardev",
            "pty,id=uart",
            "-serial",
            "chardev:uart",
            "-monitor",
            "stdio",
            "-display",
            "none",
        )
        self._process = subprocess.Popen(
            [*command, *serial], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
        )
        received = b""
        while not (found := re.search(rb"redirected to (\S+)", received)):
            new = os.read(self._process.stdout.fileno(), 4096)  # type: ignore[union-attr]
            assert new, received
            received += new
        self.port = found[1].decode()

    def power_cycle(self) -> None:
        os.write(self._process.stdin.fileno(), b"system_reset\n")  # type: ignore[union-attr]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.communicate()


@pytest.fixture(params=["ours on the twin", "Debian's on virt"])
def machine(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Qemu]:
    if request.param == "Debian's on virt":
        command = DEBIAN
    else:
        nand = NandImage.blank(tmp_path / "nand").path
        command = (
            *(request.getfixturevalue("qemu"), "-M", "nuc980", "-bios", request.getfixturevalue("uboot")),
            *("-drive", f"if=mtd,format=raw,file={nand}"),
        )
    with Qemu(*command) as machine:
        yield machine


@pytest.mark.slow
def test_autoboot_of_a_real_uboot_is_stopped_each_time(machine: Qemu) -> None:
    with Line(machine.port) as line:
        at = Console(line)
        for _ in range(20):
            output = at.reach(machine.power_cycle, patience=20.0)
            assert "stop autoboot" in output
            assert at.run("false").status == 1


@pytest.mark.slow
def test_real_uboot_is_what_the_clockwork_is(machine: Qemu) -> None:
    """Each answer that the console relies on."""
    with Line(machine.port) as line:
        at = Console(line)
        at.reach()
        assert at.prompt == b"=> "
        assert at._edits
        line.write(b"nand era")
        at.reach()
        line.write(b"if echo not run\r; echo nor this\r")
        assert "not run\r\n> " in heard(line)
        assert "\nnot run" not in at.reach()
        for command, status in {
            "true": 0, "false": 1, "true; false": 1, "false; true": 0, "true && false": 1, "false || true": 0,
            "nonsense": 1, "crc32": 1, "setenv a 'b; c'": 0, "if true; then false; fi": 1,
        }.items():  # fmt: skip
            assert at.run(command).status == status, command
        assert at.run("printenv a").output == "a=b; c\n"
        assert at.run("echo " + "x" * (COMMAND_ROOM - 5)).output == "x" * (COMMAND_ROOM - 5) + "\n"
        with pytest.raises(StuckConsole, match="Ctrl-C ended it"):
            at.run("sleep 60", seconds=2.0)
        with pytest.raises(BoardReset):
            at.run("reset")
        at.reach()
        assert at.run("false").status == 1


@pytest.mark.slow
def test_without_a_delay_autoboot_is_stopped_mostly(qemu: Path, uboot: Path, tmp_path: Path) -> None:
    nand = NandImage.blank(tmp_path / "nand").path
    with (
        Qemu(qemu, "-M", "nuc980", "-bios", uboot, "-drive", f"if=mtd,format=raw,file={nand}") as machine,
        Line(machine.port) as line,
    ):
        at = Console(line)
        at.reach()
        at.run("setenv bootdelay 0; setenv bootcmd echo too late", 10).required()
        at.run("saveenv", 30).required()
        starts = [at.reach(machine.power_cycle, patience=20.0) for _ in range(20)]
        assert all("stop autoboot:  0" in start for start in starts)
        # The board looks once, some 20 ms after its UART is ready; a busy host may sleep meanwhile.
        assert sum("too late" not in start for start in starts) >= 15


@pytest.mark.slow
def test_overhead_of_a_command_is_small() -> None:
    """On a pty, with a board that answers at once."""
    with pty(Board(PROMPT)) as (at, _):
        at.reach()
        assert fastest(lambda: at.run("true"), 50) < 0.04


def heard(line: Line) -> str:
    received = b""
    while new := line.read(0.5):
        received += new
    return received.decode()
