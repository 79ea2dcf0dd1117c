# SPDX-License-Identifier: GPL-3.0-or-later
"""`make run-native`: a new user's first command, as a process of its own."""

import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest

from lab.gateway import free_port
from lab.master import Master
from lab.picture import draw
from lab.show import NATIVE_STEPS

ROOT = Path(__file__).resolve().parents[2]
ENDS_S = 180.0  # at most


Start = Callable[..., subprocess.Popen[str]]


@pytest.fixture
def start(programs: Path) -> Iterator[Start]:
    """Starts shows; what they leave behind fails the test."""
    shows: list[subprocess.Popen[str]] = []

    def run(*arguments: str) -> subprocess.Popen[str]:
        environment = os.environ | {"PYTHONPATH": str(ROOT / "scripts")}
        command = [sys.executable, "-m", "lab", *arguments]
        pipe = subprocess.PIPE
        shows.append(
            subprocess.Popen(command, cwd=ROOT, env=environment, text=True, stdout=pipe, stderr=pipe)
        )
        return shows[-1]

    yield run
    assert shows
    for show in shows:
        assert list(Path("/dev/shm").glob(f"openrtu-{show.pid}-*")) == []


@pytest.mark.slow
def test_all_of_it_is_seen(start: Start) -> None:
    show = start("--port", str(free_port()))
    out, err = show.communicate(timeout=180)
    assert (show.returncode, err) == (0, "")
    assert out.count("\n\n") == len(NATIVE_STEPS) + 1
    assert "Modbus frame received: [67 5 0 3 255 0 115 24]" in out
    assert "Modbus frame received: [67 6 0 2 0 255 103 104]" in out
    assert f"All {len(NATIVE_STEPS)} steps succeeded." in out


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_who_ends_it_ends_all_that_it_started(start: Start, number: int) -> None:
    show = start("--port", str(free_port()))
    assert show.stdout is not None
    for line in show.stdout:
        if "1. " in line:
            break
    show.send_signal(number)
    _, err = show.communicate(timeout=ENDS_S)
    assert (show.returncode, "Traceback" in err) == (1, False), err
    deadline = time.monotonic() + ENDS_S
    while left := running(show.pid):  # a command that was being started ends by itself
        assert time.monotonic() < deadline, left
        time.sleep(0.05)


def running(pid: int) -> str:
    """What is in the folder of this show, or reads from there."""
    command = ["pgrep", "-a", "-f", f"openrtu-{pid}-"]
    return subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False).stdout


def three_lines(err: str) -> dict[str, str]:
    """What a show that fails says: three lines, nothing else."""
    lines = err.strip().splitlines()
    assert len(lines) == 3, err
    verdict = dict(re.split(": +", line, maxsplit=1) for line in lines)
    assert list(verdict) == ["expected", "seen", "probably"]
    return verdict


@pytest.mark.slow
def test_who_has_the_port_is_named_and_gets_no_octet(start: Start) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        show = start("--port", str(port))
        out, err = show.communicate(timeout=60)
        other.setblocking(False)
        with pytest.raises(BlockingIOError):
            other.accept()
    assert (show.returncode, out) == (1, "")
    verdict = three_lines(err)
    assert verdict["expected"].startswith(f"TCP port {port} of 127.0.0.1 free")
    assert re.fullmatch(rf".+ \(pid {os.getpid()}\) listens there", verdict["seen"])
    assert re.search(r"make run-native PORT=\d+", verdict["probably"])


@pytest.mark.slow
@pytest.mark.sample(5)
@pytest.mark.parametrize("port", ["0", "65536", "-1", "2404x", "http"])
def test_port_that_is_none_is_wrong_usage(start: Start, port: str) -> None:
    show = start(f"--port={port}")
    out, err = show.communicate(timeout=60)
    assert (show.returncode, out) == (2, "")
    assert f"{port} is not a TCP port" in err


@pytest.mark.slow
def test_failed_show_says_three_lines_and_the_rest_in_a_file(start: Start) -> None:
    show = start("--port", str(free_port()))
    assert show.stdout is not None
    for line in show.stdout:
        if "1. " in line:
            break
    subprocess.run(["pkill", "-KILL", "-f", f"linesim .*openrtu-{show.pid}-"], check=True)
    _, err = show.communicate(timeout=60)
    assert show.returncode == 1
    verdict = three_lines(err)
    assert verdict["expected"].startswith("step ")
    assert "linesim" in verdict["seen"]
    assert verdict["probably"].startswith("linesim ended with exit code -9")
    file = re.search(r"\(details: (.+)\)$", verdict["probably"])
    assert file is not None
    kept = (ROOT / file[1]).read_text()
    for title in (
        "rtud's log",
        "rtuctl modules",
        "rtuctl points",
        "the last frames on the lines",
        "the error",
    ):
        assert f"\n==== {title}\n" in kept
    assert "rtu-iec104" in kept and "Traceback" in kept


@pytest.mark.slow
def test_keep_stays_up_for_the_users_own_master(start: Start) -> None:
    port = free_port()
    show = start("--port", str(port), "--keep")
    assert show.stdout is not None
    printed = []
    for line in show.stdout:
        printed.append(line)
        if "Ctrl-C" in line:
            break
    else:
        pytest.fail(f"it ended instead: {show.communicate()}")
    ours = psutil.Process(show.pid).net_connections("tcp4")
    assert [each for each in ours if each.raddr and each.raddr.port == port] == []  # its master has left
    with Master("127.0.0.1", port) as master:
        assert len(master.interrogate(3067)) == 13
    commands = [line.strip() for line in printed if line.startswith("  scripts/")]
    assert len(commands) == 7
    for command in commands:
        assert len(command) < 80
        if " watch" not in command:
            subprocess.run(command, shell=True, cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    wrong = f"scripts/kept --port {port} linesim nonsense"
    refused = subprocess.run(wrong, shell=True, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=False)
    assert refused.returncode == 1 and refused.stdout.startswith("error unknown command")
    show.send_signal(signal.SIGINT)
    _, err = show.communicate(timeout=20)
    assert (show.returncode, err) == (0, "")
    gone = subprocess.run(commands[0], shell=True, cwd=ROOT, stderr=subprocess.PIPE, text=True, check=False)
    assert gone.returncode == 2
    assert f"no show runs on TCP port {port}; type: make run-native KEEP=1 PORT={port}" in gone.stderr


def test_picture_of_the_readme_has_these_steps() -> None:
    """Drawn by scripts/lab/picture.py from a recorded run: record it again when the steps change."""
    picture = (ROOT / "docs/figures/run-native.svg").read_text()
    missing = [step.__doc__ for step in NATIVE_STEPS if f". {step.__doc__}</tspan>" not in picture]
    assert missing == []


def test_picture_shortens_tables_and_escapes() -> None:
    rows = [f"     000000{number}   3067     1 on  M_SP_NA_1   <cause>  good" for number in range(1, 7)]
    drawn = draw("\n".join(["     Address    CA", *rows, "", " 2. Next"]))
    assert drawn.count("&lt;cause&gt;") == 4
    assert '<tspan class="quiet">     …</tspan>' in drawn
    assert '<tspan class="step"> 2. Next</tspan>' in drawn
