# SPDX-License-Identifier: GPL-3.0-or-later
"""scripts/logged.sh: what a step of a build says, and what goes to its log."""

import os
import pty
import re
import signal
import subprocess
import time
from pathlib import Path

import pytest

SCRIPT = Path(__file__).resolve().parents[2] / "scripts/logged.sh"


def logged(folder: Path, shell: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Runs a step that is a line of shell, without a terminal."""
    known = {name: value for name, value in os.environ.items() if name != "CI"} | environment
    command = [SCRIPT, "step", "bash", "-c", shell]
    return subprocess.run(command, cwd=folder, env=known, capture_output=True, text=True, check=False)


def test_output_goes_to_the_log(tmp_path: Path) -> None:
    done = logged(tmp_path, "echo out; echo err >&2")
    assert (done.returncode, done.stdout, done.stderr) == (0, "   * step: done\n", "")
    assert (tmp_path / "build/log/step.log").read_text() == "out\nerr\n"


def test_failure_has_the_commands_code_and_the_end_of_the_log(tmp_path: Path) -> None:
    done = logged(tmp_path, "seq 100; exit 3")
    assert (done.returncode, done.stdout) == (3, "")
    head, *tail = done.stderr.splitlines()
    assert re.fullmatch(r"   \* step: failed after \d+ s; the end of build/log/step\.log:", head)
    assert tail == [f"     | {number}" for number in range(61, 101)]


def test_continuous_integration_gets_more_of_the_log(tmp_path: Path) -> None:
    assert len(logged(tmp_path, "seq 300; false", CI="true").stderr.splitlines()) == 201


@pytest.mark.parametrize(
    ("log", "progress"),
    [
        ("[1/318] Compiling C object a.o\n[317/318] Linking target rtud", "317 of 318 objects"),
        ("  CC      init/main.o\n  HOSTCC  scripts/x\n  AS      a.o\n  LD      vmlinux", "3 objects"),
        (
            "0 upgraded, 12 newly installed, 0 to remove\nSetting up gcc (4:12.2) ...\nSetting up libc6 ...",
            "2 of 12 packages",
        ),
        (  # as apt writes it in another root, several times
            "0 upgraded, 3 newly installed, 0\nSetting up a (1) ...\r\n0 upgraded, 2 newly installed, 0\r\n"
            "Setting up gcc (4:12.2) ...\r\n",
            "1 of 2 packages",
        ),
        ("Collecting c104==2.2.1\nDownloading c104.whl\nCollecting pytest", "2 packages"),
        (" 1/47 map OK  0.02s\n46/47 line OK 0.10s", "46 of 47 tests"),
        ("\033[7m>>> busybox 1.36.1 Building\033[27m\n  CC x.o", "busybox 1.36.1 Building"),
        ("what no one knows", ""),
    ],
)
def test_progress_is_read_from_the_log(tmp_path: Path, log: str, progress: str) -> None:
    done = logged(tmp_path, f"printf '%b' {log!r}")
    shown = re.sub(r", \d+ s$", "", done.stdout.rstrip("\n"))  # which a busy host takes for it
    assert shown == f"   * step: done{', ' if progress else ''}{progress}"


@pytest.mark.slow
@pytest.mark.parametrize("terminal", [False, True])
def test_long_step_shows_how_far_it_is(tmp_path: Path, terminal: bool) -> None:
    shell = "echo '[7/9] Compiling'; sleep 12"
    if not terminal:
        assert re.fullmatch(
            r"   \* step: started; log: build/log/step\.log\n"
            r" +1\d s  step: 7 of 9 objects\n"
            r"   \* step: done, 7 of 9 objects, 1\d s\n",
            logged(tmp_path, shell).stdout,
        )
        return
    own, theirs = pty.openpty()
    known = {name: value for name, value in os.environ.items() if name != "CI"}
    subprocess.run([SCRIPT, "step", "bash", "-c", "echo '[7/9] Compiling'; sleep 5"], cwd=tmp_path, env=known,
                   stdout=theirs, check=True)  # fmt: skip
    os.close(theirs)
    received = ""
    while "done" not in received:
        received += os.read(own, 10_000).decode()
    os.close(own)
    assert re.search(r"\r\x1b\[K +\d s  7 of 9 objects\r\x1b\[K", received)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_who_ends_it_ends_the_command(tmp_path: Path, number: int) -> None:
    step = subprocess.Popen(
        [SCRIPT, "step", "bash", "-c", "echo $$; sleep 1000; true"],
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip
    log = tmp_path / "build/log/step.log"
    while not (log.exists() and log.read_text().endswith("\n")):
        assert step.poll() is None
        time.sleep(0.01)
    step.send_signal(number)
    out, _ = step.communicate(timeout=60)
    assert step.returncode > 128
    assert "failed" not in out
    assert not Path(f"/proc/{int(log.read_text())}").exists()
