# SPDX-License-Identifier: GPL-3.0-or-later
"""The library and the pytest plug-in: a double that boots, and a real shell behind a login."""

import os
import pty
import select
import subprocess
import sys
import threading
import tty
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from netboot.double import Double
from nuc980.netboot.errors import CommandFailed, LinuxSilent
from nuc980.netboot.target import Linux
from nuc980.netboot.transport import Line

SCRIPTS = Path(__file__).parents[2] / "scripts"
LOGIN = r"""
stty -echo; printf 'gateway login: '; read user; export user; stty echo
if [ "$user" = locked ]; then
    stty -echo; printf 'Password: '; read password; echo
    [ "$password" = secret ] || { echo 'Login incorrect'; exit; }
fi
PS1='# ' exec sh -i
"""


class Getty:
    """A login and a real shell on a terminal of their own, as a board's serial port has them."""

    def __init__(self) -> None:
        self._outside, slave = pty.openpty()
        tty.setraw(slave)
        self._slave = slave
        self.port = os.ttyname(slave)

    def start(self) -> None:
        """Once somebody listens: a line that is opened drops what is in it."""
        self._child, self._inside = pty.fork()
        if self._child == 0:
            os.execvp("sh", ["sh", "-c", LOGIN])
        self._ends = False
        self._wire = threading.Thread(target=self._carry, daemon=True)
        self._wire.start()

    def _carry(self) -> None:
        other = {self._outside: self._inside, self._inside: self._outside}
        while not self._ends:
            for end in select.select(list(other), [], [], 0.05)[0]:
                try:
                    os.write(other[end], os.read(end, 4096))
                except OSError:  # the shell has ended
                    return

    def close(self) -> None:
        self._ends = True
        self._wire.join()
        os.close(self._inside)
        os.waitpid(self._child, 0)
        for end in (self._outside, self._slave):
            os.close(end)


@pytest.fixture
def linux() -> Iterator[Linux]:
    getty = Getty()
    try:
        with Line(getty.port) as line:
            linux = Linux(line)
            getty.start()
            linux.expect("login: $")
            yield linux
    finally:
        getty.close()


def test_shell_after_a_login(linux: Linux) -> None:
    linux.login("root")
    assert linux.run("echo one; echo two") == "one\ntwo\n"
    assert linux.run("printf '%s' \"$0\"; echo") == "sh\n"
    assert linux.run("true") == ""
    assert linux.run("printf unfinished") == "unfinished"
    with pytest.raises(CommandFailed, match="'sh -c \"echo why; exit 7\"' ended with 7: why"):
        linux.run('sh -c "echo why; exit 7"')
    assert linux.run("seq 2000").split() == [str(number) for number in range(1, 2001)]


def test_password(linux: Linux) -> None:
    linux.login("locked", "secret")
    assert linux.run("echo $user") == "locked\n"


def test_wrong_password(linux: Linux) -> None:
    with pytest.raises(CommandFailed, match="refuses locked"):
        linux.login("locked", "guess")


@pytest.mark.slow
def test_silence(linux: Linux) -> None:
    linux.login("root")
    with pytest.raises(LinuxSilent, match=r"within 0\.3 s"):
        linux.run("sleep 2", seconds=0.3)


# ---- the plug-in


TESTS = """
import pytest
from nuc980.netboot.errors import NetbootError

def test_prompt(nuc980_uboot):
    assert "bootcmd=nand read" in nuc980_uboot.run("printenv bootcmd")

def test_boot(nuc980_boot):
    linux = nuc980_boot("uImage", "board.dtb")
    linux.send("root")
    linux.expect("Password: $")
"""


def pytest_of_its_own(folder: Path, options: Sequence[str]) -> subprocess.CompletedProcess[str]:
    (folder / "test_board.py").write_text(TESTS)
    return subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "nuc980.netboot.fixture", "-c", os.devnull,
         "--rootdir", str(folder), "-p", "no:cacheprovider", *options, "test_board.py"],
        cwd=folder, env={**os.environ, "PYTHONPATH": str(SCRIPTS)}, capture_output=True, text=True,
    )  # fmt: skip


@pytest.mark.slow
def test_without_a_board_its_tests_are_skipped(tmp_path: Path) -> None:
    ran = pytest_of_its_own(tmp_path, [])
    assert ran.returncode == 0 and "2 skipped" in ran.stdout, ran


@pytest.mark.slow
def test_a_board_in_tests(images: list[str], site: Path, udp_port: int, tmp_path: Path) -> None:
    assert [Path(path).name for path in images] == ["uImage", "board.dtb"]
    with Double("factory", tftp=("127.0.0.1", udp_port)) as double:
        options = [
            f"--nuc980-port={double.port}", f"--nuc980-site={site}", f"--nuc980-tftp-port={udp_port}",
            *(f"--nuc980-{name}=127.0.0.1" for name in ("server-ip", "listen", "seen-as")),
        ]  # fmt: skip
        ran = pytest_of_its_own(tmp_path, options)
    assert ran.returncode == 0 and "2 passed" in ran.stdout, ran.stdout + ran.stderr
    assert double.kernels_started == 1


@pytest.mark.slow
def test_a_dead_board_fails_without_a_traceback(site: Path, tmp_path: Path) -> None:
    ran = pytest_of_its_own(tmp_path, ["--nuc980-port=/dev/no-such-port", f"--nuc980-site={site}"])
    assert ran.returncode == 1
    assert "/dev/no-such-port" in ran.stdout and "Traceback" not in ran.stdout + ran.stderr
    assert "next step:" in ran.stdout
