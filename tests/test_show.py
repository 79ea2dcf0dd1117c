# SPDX-License-Identifier: GPL-3.0-or-later
"""`make run-native`: the newcomer's first command, as a process of its own."""

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from lab.gateway import free_port
from lab.master import Master
from lab.show import STEPS

ROOT = Path(__file__).resolve().parent.parent


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


def test_all_of_it_is_seen(start: Start) -> None:
    show = start("--port", str(free_port()))
    out, err = show.communicate(timeout=60)
    assert (show.returncode, err) == (0, "")
    assert out.count("\n\n") == len(STEPS) + 1
    assert "Modbus frame received: [67 5 0 3 255 0 115 24]" in out
    assert "Modbus frame received: [67 6 0 2 0 255 103 104]" in out
    assert f"All {len(STEPS)} steps were seen." in out


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_who_ends_it_ends_all_that_it_started(start: Start, number: int) -> None:
    show = start("--port", str(free_port()))
    assert show.stdout is not None
    for line in show.stdout:
        if "1. " in line:
            break
    show.send_signal(number)
    _, err = show.communicate(timeout=60)
    assert show.returncode == 1
    assert "Traceback" not in err
    left = subprocess.run(["pgrep", "-f", f"openrtu-{show.pid}-"], stdout=subprocess.PIPE, check=False)
    assert left.stdout == b""


def test_a_port_in_use_is_a_reason(start: Start) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        show = start("--port", str(other.getsockname()[1]))
        out, err = show.communicate(timeout=60)
    assert show.returncode == 1
    assert "seen." not in out
    assert "make run-native: not seen:" in err
    assert "Address already in use" in err
    assert "Traceback" not in err


@pytest.mark.slow
def test_keep_stays_up_for_the_users_own_master(start: Start) -> None:
    port = free_port()
    show = start("--port", str(port), "--keep")
    assert show.stdout is not None
    for line in show.stdout:
        if "Ctrl-C" in line:
            break
    else:
        pytest.fail(f"it ended instead: {show.communicate()}")
    with Master("127.0.0.1", port) as master:
        assert len(master.interrogate(3067)) == 13
    show.send_signal(signal.SIGINT)
    _, err = show.communicate(timeout=20)
    assert (show.returncode, err) == (0, "")
