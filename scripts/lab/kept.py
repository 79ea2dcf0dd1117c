# SPDX-License-Identifier: GPL-3.0-or-later
"""kept: rtuctl and the simulated devices of a show that stays up (make run-native KEEP=1, make run KEEP=1).

Exit codes: those of rtuctl; linesim's: 0 done, 1 refused; 2 wrong usage, or no show is kept up.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import shlex
import socket
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NoReturn

from lab.gateway import REPOSITORY, Rtu
from lab.linesim import LineSim
from lab.ports import STATION


def record(port: int) -> Path:
    """Where a show that is kept up says how it is reached."""
    return REPOSITORY / "build" / "kept" / f"{port}.json"


@contextlib.contextmanager
def known(port: int, gateway: Rtu, lines: LineSim) -> Iterator[None]:
    """A show that can be reached by this program."""
    ways = {
        "rtuctl": gateway.rtuctl,
        "by_shell": gateway.by_shell,
        "linesim": f"{lines.directory / 'control'}",
    }
    record(port).parent.mkdir(parents=True, exist_ok=True)
    record(port).write_text(json.dumps(ways))
    try:
        yield
    finally:
        record(port).unlink(missing_ok=True)


def run_rtuctl(command: list[str], by_shell: bool, words: list[str]) -> NoReturn:
    """Becomes rtuctl, or the ssh that runs it, where Ctrl-C at a terminal ends rtuctl, too."""
    if by_shell:
        command[1:1] = ["-t"] if sys.stdin.isatty() else []
        words = [shlex.quote(word) for word in words]
    os.execvp(command[0], [*command, *words])


def tell_linesim(control: str, words: list[str]) -> int:
    """One command of linesim's control socket; prints the answer."""
    with socket.socket(socket.AF_UNIX) as connection:
        connection.connect(control)
        connection.sendall(f"{' '.join(words)}\n".encode())
        with connection.makefile(encoding="ascii") as answers:
            answer = answers.readline().strip()
    print(answer)
    return 0 if answer.split()[:1] == ["ok"] else 1


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(prog="scripts/kept", description=__doc__.partition("\n\n")[0])
    parser.add_argument("--port", type=int, default=STATION, help="TCP port of the show's station [2404]")
    parser.add_argument("program", choices=("rtuctl", "linesim"), help="the program to use")
    parser.add_argument(
        "words", nargs=argparse.REMAINDER, help="its arguments; for linesim see tests/linesim/README.md"
    )
    arguments = parser.parse_args()
    try:
        ways = json.loads(record(arguments.port).read_text())
        if arguments.program == "rtuctl":
            run_rtuctl(ways["rtuctl"], ways["by_shell"], arguments.words)
        return tell_linesim(ways["linesim"], arguments.words)
    except OSError:
        port = "" if arguments.port == STATION else f" PORT={arguments.port}"
        print(
            f"kept: no show runs on TCP port {arguments.port}; type: make run-native KEEP=1{port}",
            file=sys.stderr,
        )
        return 2


if __name__ == "__main__":
    sys.exit(main())
