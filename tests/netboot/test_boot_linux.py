# SPDX-License-Identifier: GPL-3.0-or-later
"""What a kernel says while it comes up, and what is made of it; the console is a real pty."""

import os
import pty
import select
import threading
import time
import tty
from collections.abc import Callable, Iterator, Sequence

import pytest

from nuc980.netboot import linux
from nuc980.netboot.commandline import text
from nuc980.netboot.errors import (
    BoardHung,
    BoardReset,
    BootmFailed,
    KernelMute,
    KernelOops,
    KernelPanic,
    LinuxSilent,
    RootMissing,
)
from nuc980.netboot.linux import Goal, LinuxWatch
from nuc980.netboot.transport import Line

BOOTM = b"## Booting kernel from Legacy Image at 00007fc0 ...\r\n   Verifying Checksum ... OK\r\n"
TREE = BOOTM + b"   Loading Device Tree to 03b4d000, end 03b52fff ... OK\r\n"
STARTING = BOOTM + b"\r\nStarting kernel ...\r\n\r\n"
BANNER = b"Booting Linux on physical CPU 0x0\r\nLinux version 5.10.140\r\n"
LOGIN = b"\r\nWelcome to Buildroot\r\nnuc980 login: "
GOAL = Goal(seconds=20.0, bootm_seconds=20.0)
SOON = Goal(seconds=0.3, bootm_seconds=0.3)  # where nothing is to come


class Console:
    """The watch, and the far end of its line."""

    def __init__(self, board: int, watch: LinuxWatch, shown: list[str]) -> None:
        self._board, self.watch, self.shown = board, watch, shown
        self._voice: threading.Thread | None = None
        self._over = threading.Event()

    def says(self, *parts: bytes, pause: float = 0.0) -> None:
        """Says the parts, each after a pause, in a thread of its own."""
        self._voice = threading.Thread(target=self._say, args=(parts, pause))
        self._voice.start()

    def _say(self, parts: Sequence[bytes], pause: float) -> None:
        for part in parts:
            if self._over.wait(pause):
                return
            while part and not self._over.is_set():
                _, ready, _ = select.select([], [self._board], [], 0.01)
                part = part[os.write(self._board, part[:1000]) :] if ready else part

    def close(self) -> None:
        self._over.set()
        if self._voice:
            self._voice.join()

    def until_login(self, goal: Goal = GOAL) -> None:
        self.watch.until_kernel(goal)
        self.watch.until(goal)

    def until_login_soon(self) -> None:
        self.until_login(SOON)


@pytest.fixture
def console(monkeypatch: pytest.MonkeyPatch) -> Iterator[Console]:
    monkeypatch.setattr(linux, "QUIET_SECONDS", 0.6)
    board, host = pty.openpty()
    tty.setraw(board)
    os.set_blocking(board, False)
    shown: list[str] = []
    with Line(os.ttyname(host)) as line:
        console = Console(board, LinuxWatch(line, 17, shown.append), shown)
        yield console
        console.close()
    os.close(board)
    os.close(host)


def error_of(kind: type[Exception], act: Callable[[], None]) -> str:
    with pytest.raises(kind) as raised:
        act()
    assert raised.type is kind
    return str(raised.value)


def test_login_is_the_goal(console: Console) -> None:
    console.says(STARTING, BANNER, LOGIN, pause=0.01)
    console.until_login()
    assert console.shown[-5:] == [*text(BANNER).splitlines(), "", "Welcome to Buildroot", "nuc980 login: "]


def test_byte_by_byte(console: Console) -> None:
    whole = STARTING + BANNER + LOGIN
    console.says(*(whole[at : at + 1] for at in range(len(whole))), pause=0.0005)
    console.until_login()
    assert [line for line in console.shown if "login" in line] == ["nuc980 login: "]


def test_login_with_a_kernels_line_behind_it(console: Console) -> None:
    console.says(STARTING + BANNER + LOGIN + b"[   10.0] random: crng init done\r\n")
    console.until_login()


@pytest.mark.slow
def test_last_login_is_no_login(console: Console) -> None:
    console.says(STARTING + BANNER + b"the last login: Sat Nov 21\r\n")
    error_of(LinuxSilent, console.until_login_soon)


def test_goal_of_ones_own(console: Console) -> None:
    console.says(STARTING + BANNER + b"[    1.0] Run /init as init process\r\nmore\r\n")
    console.until_login(Goal(r"Run \S+ as init", 20.0, 20.0))


# ---- U-Boot's part


@pytest.mark.parametrize(
    ("printed", "cause"),
    [
        (b"Wrong Image Format for bootm command\r\nERROR: can't get kernel image!\r\n", "no uImage"),
        (
            BOOTM + b"   Verifying Checksum ... Bad Data CRC\r\nERROR: can't get kernel image!\r\n",
            "has changed",
        ),
        (b"Bad Header Checksum\r\n", "has changed"),
        (BOOTM + b"ERROR: Did not find a cmdline Flattened Device Tree\r\n", "no device tree"),
        (b"ERROR: FDT image overlaps OS image (OS=0x8000..0xb00000)\r\n", "beside each other"),
        (b"Unsupported Architecture 0x16\r\n", "another processor"),
        (b"something else\r\n", "another kind of image"),
    ],
)
def test_bootm_comes_back(console: Console, printed: bytes, cause: str) -> None:
    console.says(printed + b"@17:failed\r\n=> ")
    error = error_of(BootmFailed, console.until_login)
    assert cause in error
    assert printed.decode().split("\r\n")[-2] in error


def test_bootm_resets_the_board(console: Console) -> None:
    words = b"ERROR: fdt move failed - must RESET the board to recover.\r\nresetting ...\r\n"
    console.says(BOOTM + words)
    assert "U-Boot did not start the kernel" in error_of(BootmFailed, console.until_login)


def test_board_is_reset_in_bootm(console: Console) -> None:
    console.says(BOOTM + b"\r\n\r\nU-Boot 2016.11 (Nov 06 2018 - 10:00:00)\r\n")
    error = error_of(BoardReset, console.until_login)
    assert "restarted in bootm, after '   Verifying Checksum ... OK'" in error and "supply" in error


def test_bootm_gives_up_for_ever(console: Console) -> None:
    console.says(TREE + b"FDT creation failed! hanging...### ERROR ### Please RESET the board ###\r\n")
    error = error_of(BoardHung, console.until_login)
    assert "FDT creation failed!" in error and "switch the board off and on" in error


@pytest.mark.slow
def test_bootm_hangs(console: Console) -> None:
    console.says(BOOTM)
    assert "bootm did not end within 0.3 s" in error_of(BootmFailed, console.until_login_soon)


def test_marker_of_another_command_says_nothing(console: Console) -> None:
    console.says(b"@16:failed\r\n" + STARTING + BANNER + LOGIN)
    console.until_login()


def test_echo_of_the_command_says_nothing(console: Console) -> None:
    console.says(
        b"if bootm 0x7fc0 - 0xa00000; then echo @17:ok; else echo @17:failed; fi\r\n"
        + STARTING
        + BANNER
        + LOGIN
    )
    console.until_login()


# ---- where U-Boot's part ends: it may take the pins away before its last words are out

FDT = b"Working FDT set to 3b4d000\r\n"  # 2023.01
NEWER = BOOTM + FDT + b"   XIP Kernel Image\r\n" + TREE + FDT
LAST_WORDS = {"2016.11": b"\n\rStarting kernel ...\n\r\n\r", "2023.01": b"\r\nStarting kernel ...\r\n\r\n"}
FIRST_WORDS = {
    "times": b"[    0.000000] Booting Linux on physical CPU 0x0\r\n[    0.000000] Linux version 5.10.140\r\n",
    "callers": b"[    0.000000][    T0] Booting Linux on physical CPU 0x0\r\n",
    "no times": b"Booting Linux on physical CPU 0x0\r\n",
    "decompressor": b"Uncompressing Linux... done, booting the kernel.\r\n",
    "quiet until init": b"Starting syslogd: OK\r\n",
    "quiet until the login's greeting": b"\r\nOpenRTU\r\n",
    "quiet until the login": b"",
}


class Said:
    """In the place of a Line: what has come, in pieces of a size."""

    def __init__(self, printed: bytes, size: int) -> None:
        self._pieces = [printed[at : at + size] for at in range(0, len(printed), size)]

    def read(self, seconds: float) -> bytes:
        if self._pieces:
            return self._pieces.pop(0)
        time.sleep(max(seconds, 0))
        return b""

    def other_readers(self) -> str:
        return ""


def watched(printed: bytes, size: int = 4096, goal: Goal = GOAL) -> list[str]:
    """Watches it to its end; what was shown."""
    shown: list[str] = []
    watch = LinuxWatch(Said(printed, size), 17, shown.append)  # type: ignore[arg-type]
    watch.until_kernel(goal)
    watch.until(goal)
    return shown


def cuts() -> Iterator[bytes]:
    """bootm's words, its last ones cut off at each character, with what a switched pin may add."""
    for words in LAST_WORDS.values():
        for kept in range(len(words) + 1):
            for glitch in (b"", b"\0", b"\xf8"):
                yield TREE + words[:kept] + glitch
                yield NEWER + words[:kept] + glitch


@pytest.mark.slow
@pytest.mark.sample(7)
@pytest.mark.parametrize("size", [1, 4096])
@pytest.mark.parametrize("first", FIRST_WORDS.values(), ids=FIRST_WORDS)
def test_cut_line_is_no_failure(first: bytes, size: int) -> None:
    for printed in cuts():
        assert "login: " in watched(printed + first + b"gateway login: ", size)[-1], printed


@pytest.mark.slow
@pytest.mark.sample(2)
@pytest.mark.parametrize("size", [1, 4096])
def test_panic_behind_a_cut_line_is_a_panic(size: int) -> None:
    for printed in cuts():
        error = error_of(KernelPanic, lambda printed=printed: watched(printed + PANIC + TRACE + END, size))
        assert "Attempted to kill init" in error, printed


def test_reset_behind_a_cut_line_is_a_reset() -> None:
    banner = b"\n\r\n\rU-Boot 2016.11 (Nov 06 2018 - 10:00:00)\n\r"
    for printed in cuts():
        assert "while Linux came up" in error_of(
            BoardReset, lambda printed=printed: watched(printed + banner)
        ), printed


@pytest.mark.parametrize("kept", [0, 1, 9, 21, 25])
@pytest.mark.parametrize("before", [TREE, NEWER])
def test_silence_behind_a_cut_line_is_the_kernels(before: bytes, kept: int) -> None:
    printed = before + LAST_WORDS["2016.11"][:kept]
    soon = Goal(seconds=0.05, bootm_seconds=0.02)
    assert "within 0.05 s" in error_of(KernelMute, lambda: watched(printed, goal=soon))


def test_quiet_kernel_is_waited_for(console: Console) -> None:
    console.says(STARTING)
    quiet = threading.Timer(0.2, console.says, [LOGIN])
    quiet.start()
    console.until_login(Goal(seconds=20.0, bootm_seconds=0.1))
    quiet.join()


@pytest.mark.parametrize("pattern", ["Linux", "Kernel Image", "OK", "."])
def test_goal_is_not_found_in_uboots_words(pattern: str) -> None:
    printed = b"   Image Name:   Linux version 5.10\r\n   Image Type:   ARM Linux Kernel Image\r\n" + TREE
    error_of(KernelMute, lambda: watched(printed, goal=Goal(pattern, 0.05, 0.02)))


def test_goal_that_begins_as_uboots_last_words_do() -> None:
    goal = Goal("^Starting syslogd", 0.05, 0.02)
    assert watched(TREE + b"\r\nStarting syslogd: OK\r\n", goal=goal)[-1] == "Starting syslogd: OK"


# ---- the kernel's part


def test_line_that_comes_in_parts_is_seen_once() -> None:
    """Its beginning is enough, and is not found again in front of the next."""
    shown: list[str] = []
    watch = LinuxWatch(Said(b"backup: 1;\r\nbackup: 2;\r\n", 10), 17, shown.append)  # type: ignore[arg-type]
    goal = Goal(r"^backup: \d;", 5.0)
    for _ in range(2):
        watch.until(goal)
    assert [line for line in shown if line] == ["backup: 1;", "backup: 2;"]


@pytest.mark.slow
def test_not_a_word(console: Console) -> None:
    console.says(STARTING)
    assert "console=ttyS0,115200n8" in error_of(KernelMute, console.until_login_soon)


@pytest.mark.slow
def test_unpacked_and_not_a_word(console: Console) -> None:
    console.says(STARTING + b"Uncompressing Linux... done, booting the kernel.\r\n")
    error_of(KernelMute, console.until_login_soon)


@pytest.mark.slow
def test_it_stops_in_the_middle(console: Console) -> None:
    console.says(STARTING + BANNER + b"[    1.0] nand: half a li")
    assert "the last one: '[    1.0] nand: half a li'" in error_of(LinuxSilent, console.until_login_soon)


class Talker:
    """In the place of a Line that always has something."""

    def __init__(self) -> None:
        self.end = time.monotonic() + 5

    def read(self, seconds: float) -> bytes:
        assert time.monotonic() < self.end
        return b"again and again\r\n"

    def other_readers(self) -> str:
        return ""


@pytest.mark.slow
def test_it_never_ends_talking() -> None:
    watch = LinuxWatch(Talker(), 17, len)  # type: ignore[arg-type]
    error_of(LinuxSilent, lambda: watch.until(SOON))


PANIC = b"[    1.1] Kernel panic - not syncing: Attempted to kill init! exitcode=0x0000000b\r\n"
TRACE = b"[    1.1] CPU: 0 PID: 1 Comm: init\r\n[    1.1] [<c0010>] (panic) from [<c0020>] (do_exit)\r\n"
END = b"[    1.2] ---[ end Kernel panic - not syncing: Attempted to kill init! ]---\r\n"


def test_panic_is_told_whole(console: Console) -> None:
    console.says(STARTING + BANNER, PANIC, TRACE, END, b"[  10.0] Rebooting\r\n" * 3, pause=0.05)
    error = error_of(KernelPanic, console.until_login)
    assert "(panic) from" in error
    assert error.index("Attempted to kill init") < error.index("end Kernel panic")
    assert "Linux version" not in error and "Rebooting" not in error


@pytest.mark.slow
def test_panic_without_an_end_ends_with_silence(console: Console) -> None:
    console.says(STARTING + BANNER, PANIC, TRACE, pause=0.05)
    assert "(panic) from" in error_of(KernelPanic, console.until_login)


def test_panic_that_never_ends_is_bounded(console: Console) -> None:
    console.says(STARTING + BANNER + PANIC + b"[    1.1] and more\r\n" * 5000)
    error = error_of(KernelPanic, console.until_login)
    assert error.count("\n") <= linux.LINES_KEPT + 3


@pytest.mark.slow
@pytest.mark.parametrize(
    "line",
    [
        b"Kernel panic - not syncing: VFS: Unable to mount root fs on unknown-block(31,4)\r\n",
        b'VFS: Cannot open root device "ubi0:rootfs" or unknown-block(0,0): error -19\r\n' + PANIC,
        b"Waiting for root device /dev/mmcblk0p2...\r\n",
    ],
)
def test_missing_root_is_told(console: Console, line: bytes) -> None:
    console.says(STARTING + BANNER + line)
    assert "ubi.mtd=" in error_of(RootMissing, console.until_login_soon)


@pytest.mark.slow
def test_oops_is_no_success(console: Console) -> None:
    oops = b"[    1.0] Unable to handle kernel NULL pointer dereference at virtual address 00000000\r\n"
    console.says(STARTING + BANNER + oops + b"[    1.0] Internal error: Oops: 5 [#1] ARM\r\n" + TRACE + LOGIN)
    error = error_of(KernelOops, console.until_login)
    assert "NULL pointer" in error and "do_exit" in error


def test_panic_after_an_oops_is_a_panic(console: Console) -> None:
    console.says(STARTING + BANNER + b"Internal error: Oops: 17 [#1] ARM\r\n" + TRACE + PANIC + END)
    assert "Oops: 17" in error_of(KernelPanic, console.until_login)


def test_board_that_starts_anew(console: Console) -> None:
    console.says(
        STARTING + BANNER + b"[    1.0] wdt: bites\r\n\r\nU-Boot 2016.11 (Nov 06 2018 - 10:00:00)\r\n"
    )
    error = error_of(BoardReset, console.until_login)
    assert "after '[    1.0] wdt: bites'" in error and "watchdog" in error


def test_line_without_an_end_does_not_fill_the_memory(console: Console) -> None:
    console.says(STARTING + BANNER + b"x" * 100_000 + LOGIN)
    console.until_login()
    assert max(map(len, console.shown)) <= 2 * linux.LINE_LIMIT


def test_bytes_that_are_no_text_are_no_harm(console: Console) -> None:
    console.says(STARTING + BANNER + bytes(range(128, 256)) + b"\0\x1b[0m" + LOGIN)
    console.until_login()
