# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes what a show needs, one target after the other: a line for each, and where its log is.

python -m lab.build LOGS TARGET...: a target may have settings, as "system SITE=folder". Exit code: make's.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

from lab.gateway import REPOSITORY

REDRAW_SECONDS = 1.0
SHOWN_AT_ONCE = 2.0  # seconds that a target with nothing to do has
TAIL = 20


def build(target: str, log: Path) -> int:
    """Makes a target; its output goes to the log. Returns make's exit code."""
    start = time.monotonic()
    with log.open("wb") as output:
        process = subprocess.Popen(
            ["make", "--no-print-directory", *target.split()],
            cwd=REPOSITORY,
            env={name: value for name, value in os.environ.items() if name not in ("MAKELEVEL", "MAKEFLAGS")},
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
        )
        told = False
        try:
            while process.poll() is None:
                told = watched(process, target, log, start, told)
        except BaseException:
            process.terminate()
            process.wait()
            raise
    seconds = time.monotonic() - start
    if process.returncode:
        say(f"   * {target}: failed after {seconds:.0f} s; the end of {log}:")
        say("\n".join(f"     {line}" for line in log.read_text(errors="replace").splitlines()[-TAIL:]))
    else:
        say(f"   * {target}: {f'built in {seconds:.0f} s' if told else 'is there'}")
    return process.returncode


def watched(process: subprocess.Popen[bytes], target: str, log: Path, start: float, told: bool) -> bool:
    """Waits a while for the end; what is still built then is told, on a terminal with its latest line."""
    try:
        process.wait(REDRAW_SECONDS)
        return told
    except subprocess.TimeoutExpired:
        seconds = time.monotonic() - start
    if seconds < SHOWN_AT_ONCE:
        return told
    if not told:
        say(f"   * {target}: is built, some minutes the first time; log: {log}")
    if sys.stdout.isatty():
        print(f"\r\033[K     {seconds:4.0f} s  {latest(log)[:60]}", end="\r", flush=True)
    return True


def latest(log: Path) -> str:
    """The latest line of a log that says anything."""
    with log.open("rb") as file:
        file.seek(-min(log.stat().st_size, 2000), os.SEEK_END)
        lines = file.read().decode(errors="replace").replace("\r", "\n").split("\n")
    return next((line.strip() for line in reversed(lines) if line.strip()), "")


def say(text: str) -> None:
    print(f"\033[K{text}" if sys.stdout.isatty() else text, flush=True)


def main(arguments: list[str]) -> int:
    logs = Path(arguments[0])
    logs.mkdir(parents=True, exist_ok=True)
    for target in arguments[1:]:
        if code := build(target, logs / f"{target.split()[0]}.log"):
            return code
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main(sys.argv[1:]))
    except KeyboardInterrupt:
        sys.exit(130)
