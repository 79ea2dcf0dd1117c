# SPDX-License-Identifier: GPL-3.0-or-later
"""rtu-centre as a process, and what it tells its consumer."""

import json
import subprocess
from pathlib import Path

from peers.centre_consumer import Consumer

LIMIT_S = 60.0  # for a hang only


class Centre:
    """A running rtu-centre; `log` is what it says."""

    def __init__(
        self, program: Path, folder: Path, stations: list[dict[str, object]], **keys: object
    ) -> None:
        self.socket = folder / "consumer"
        file = folder / "centre.json"
        file.write_text(json.dumps({"retry_ms": 50, "retry_max_ms": 200, **keys, "stations": stations}))
        self.process = subprocess.Popen(
            [program, "--socket", self.socket, file], stderr=subprocess.PIPE, text=True
        )
        self.wait_logged("waits for a consumer")

    def wait_logged(self, words: str) -> str:
        assert self.process.stderr
        for line in self.process.stderr:
            if words in line:
                return line
        raise AssertionError(f"it ended and did not say: {words}")

    def consumer(self, acknowledges: bool = True) -> Consumer:
        made = Consumer(self.socket, acknowledges)
        self.wait_logged("consumer connected")
        return made

    def stop(self) -> int:
        self.process.terminate()
        self.process.communicate(timeout=LIMIT_S)
        return self.process.returncode
