# SPDX-License-Identifier: GPL-3.0-or-later
"""The test program iec104-ask, and what it has seen."""

import json
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

LIMIT_S = 60  # for a hang only
Seen = dict[str, Any]


class Asking:
    """iec104-ask on a port: a line in, lines of JSON out."""

    def __init__(self, programs: Path, port: int, confirmation_ms: int, termination_ms: int) -> None:
        command = [programs / "iec104" / "iec104-ask", str(port), str(confirmation_ms), str(termination_ms)]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.seen: list[Seen] = []

    def until(self, fits: Callable[[Seen], bool]) -> Seen:
        """Reads on until a line fits; the lines before it stay in seen."""
        assert self.process.stdout
        for line in self.process.stdout:
            self.seen.append(json.loads(line))
            if fits(self.seen[-1]):
                return self.seen[-1]
        raise AssertionError(f"it ended: {self.seen}")

    def ask(self, line: str) -> int:
        assert self.process.stdin
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()
        return int(self.until(lambda seen: "asked" in seen)["asked"])

    def state(self, request: int, *states: str) -> Seen:
        return self.until(lambda seen: seen.get("request") == request and seen["state"] in states)

    def result(self, line: str) -> Seen:
        """How a request ends."""
        request = self.ask(line)
        assert request, f"not sent: {line}"
        return self.state(request, "executed command", "refused command", "refused selection")

    def information(self) -> list[Seen]:
        return [seen for seen in self.seen if "ioa" in seen]

    def close(self) -> None:
        self.process.kill()
        self.process.communicate(timeout=LIMIT_S)
