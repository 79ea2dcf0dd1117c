# SPDX-License-Identifier: GPL-3.0-or-later
"""libiec61850 as a publisher or a subscriber of GOOSE: what a test has of its process."""

import json
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from queue import Empty, Queue
from threading import Thread
from typing import Any

PATIENCE_S = 20.0


@dataclass
class Peer:
    """libiec61850, in a process of its own."""

    process: subprocess.Popen[str]
    lines: Queue[str] = field(default_factory=Queue)

    def __post_init__(self) -> None:
        Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.lines.put(line)

    def say(self, state: list[Any] | None) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps(state) + "\n")
        self.process.stdin.flush()
        assert self.lines.get(timeout=PATIENCE_S) == "sent\n"

    def wait(self, wanted: Callable[[dict[str, Any]], bool], what: str) -> dict[str, Any]:
        """The first message from now on that is as wanted."""
        end = time.monotonic() + PATIENCE_S
        last: dict[str, Any] = {}
        while True:
            try:
                last = json.loads(self.lines.get(timeout=end - time.monotonic()))
            except (Empty, ValueError):
                raise AssertionError(f"{what} was not heard; last: {last}") from None
            if wanted(last):
                return last


def peer(deed: str, interface: str, *arguments: str) -> Peer:
    command = [sys.executable, "-m", "peers.goose", deed, interface, *arguments]
    return Peer(
        subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=Path(__file__).resolve().parents[1],
        )
    )
