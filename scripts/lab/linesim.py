# SPDX-License-Identifier: GPL-3.0-or-later
"""Starts and steers linesim, the simulator of Modbus devices on virtual lines (tests/linesim)."""

from __future__ import annotations

import contextlib
import json
import os
import queue
import socket
import subprocess
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from lab.errors import LabError
from lab.patience import LOOK_S, Deadline

REPOSITORY = Path(__file__).resolve().parents[2]
START_TIMEOUT_S = 60.0
ANSWER_TIMEOUT_S = 30.0
FRAMES_KEPT = 20_000
PRIORITY = 50  # above the line processes', which a device does not wait for either


class LineSimError(LabError):
    """linesim does not run, or refused a command; the text says why."""


@dataclass(frozen=True)
class Frame:
    """One record of the frame log."""

    number: int  # counts from 1
    time: str  # wall time, as in the report's figures
    monotonic_ns: int
    port: int
    unit: int
    kind: str  # received, sent, reading, writing, crc_error, collision
    text: str  # in the words of the report's figures
    bytes: bytes = b""
    fault: str = ""  # what linesim did to a sent frame on purpose
    table: str = ""  # reading, writing
    address: int = 0
    value: int = 0


@dataclass
class Record:
    """A frame as linesim wrote it, decoded when somebody looks at it: at most frames nobody does."""

    number: int
    line: str

    @cached_property
    def frame(self) -> Frame:
        fields = json.loads(self.line)
        return Frame(number=self.number, **fields | {"bytes": bytes(fields.get("bytes", ()))})


def default_program() -> Path:
    """The program that `make build` makes, or the one that OPENRTU_LINESIM names."""
    return Path(os.environ.get("OPENRTU_LINESIM", REPOSITORY / "build" / "linesim" / "linesim"))


class LineSim:
    """A running linesim. Lines are links in `directory`; a device is named "port.unit", as "3.67"."""

    def __init__(
        self,
        config: Path,
        values: Path | None,
        directory: Path,
        *,
        latency_us: int | None = None,
        silence_us: int | None = None,
        trace: bool = True,
        serves_tcp: bool = False,
        whole: bool = False,
        program: Path | None = None,
    ) -> None:
        self.directory = directory
        self._program = program or default_program()
        self._arguments = ["--config", str(config), "--dir", str(directory)]
        if values is not None:
            self._arguments += ["--values", str(values)]
        if latency_us is not None:
            self._arguments += ["--latency", str(latency_us)]
        if silence_us is not None:
            self._arguments += ["--silence", str(silence_us)]
        self._arguments += [*(["--tcp"] if serves_tcp else []), *(["--whole"] if whole else [])]
        self._trace = trace
        self._process: subprocess.Popen[str] | None = None
        self._socket: socket.socket | None = None
        self._reader: threading.Thread | None = None
        self._answers: queue.Queue[str | None] = queue.Queue()
        self._asking = threading.Lock()  # an answer is of the command before it, whichever thread asked
        self._records: deque[Record] = deque(maxlen=FRAMES_KEPT)
        self._news = threading.Condition()
        self._last_number = 0
        self._gone = False

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    def start(self) -> None:
        """Starts the process; returns when all lines are there."""
        if not self._program.exists():
            raise LineSimError(f"{self._program} does not exist; type make build, or set OPENRTU_LINESIM")
        self.directory.mkdir(parents=True, exist_ok=True)
        self._process = subprocess.Popen(
            [str(self._program), *self._arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        # A device does not slow down with this machine. Who lacks the right has devices that do.
        with contextlib.suppress(PermissionError):
            os.sched_setscheduler(self._process.pid, os.SCHED_RR, os.sched_param(PRIORITY))
        try:
            self._wait_ready(self._process)
            self._connect()
        except BaseException:
            self.stop()
            raise

    def stop(self) -> None:
        """Ends the process, which removes the lines. Raises LineSimError when it had crashed."""
        if self._socket is not None:
            with contextlib.suppress(OSError):  # it is not connected any more when linesim is gone
                self._socket.shutdown(socket.SHUT_RDWR)
            self._socket.close()
            self._socket = None
        if self._reader is not None:
            self._reader.join()
            self._reader = None
        process, self._process = self._process, None
        if process is not None:
            process.terminate()
            watchdog = threading.Timer(ANSWER_TIMEOUT_S, process.kill)
            watchdog.start()
            _, messages = process.communicate()
            watchdog.cancel()
            if process.returncode != 0:
                raise LineSimError(f"linesim ended with exit code {process.returncode}: {messages.strip()}")

    def check_up(self) -> None:
        """Raises LineSimError when it has ended by itself."""
        if self._gone and self._process is not None:
            code = self._process.wait(ANSWER_TIMEOUT_S)
            raise LineSimError(f"linesim ended with exit code {code}")

    @property
    def pid(self) -> int:
        if self._process is None:
            raise LineSimError("linesim is not running: call start() first")
        return self._process.pid

    def line(self, name: str) -> Path:
        """The link to a line's pty, by the device's base name, as "ttyS3"."""
        return self.directory / name

    # ---- commands ------------------------------------------------------------------------

    def command(self, text: str) -> str:
        """Sends one command of the control socket; returns what stands behind "ok"."""
        if self._socket is None:
            raise LineSimError("linesim is not running: call start() first")
        try:
            with self._asking:
                self._socket.sendall(text.encode() + b"\n")
                answer = self._answers.get(timeout=ANSWER_TIMEOUT_S)
        except (OSError, queue.Empty) as error:
            raise LineSimError(
                f"no answer to `{text}`: linesim hangs or is gone ({error!r})",
                late=isinstance(error, queue.Empty),
            ) from error
        if answer is None:
            raise LineSimError(f"no answer to `{text}`: linesim closed the control socket")
        word, _, rest = answer.partition(" ")
        if word != "ok":
            raise LineSimError(f"linesim refused `{text}`: {rest}")
        return rest

    def set(self, device: str, table: str, address: int, *values: int) -> None:
        """Changes neighbouring values in one step."""
        self.command(f"set {device} {table} {address} {' '.join(str(value) for value in values)}")

    def get(self, device: str, table: str, address: int) -> int:
        return int(self.command(f"get {device} {table} {address}"))

    def fault(self, device: str, kind: str, *arguments: int, count: int | None = None) -> None:
        """Replaces the device's fault: kind and arguments as in tests/linesim/README.md, "clear" ends it."""
        words = ["fault", device, kind, *(str(argument) for argument in arguments)]
        if count is not None:
            words += ["count", str(count)]
        self.command(" ".join(words))

    def say(self, port: int, octets: bytes) -> None:
        """Somebody who is no device of this line sends these octets."""
        self.command(f"say {port} {' '.join(map(str, octets))}")

    def plug(self, port: int) -> None:
        self.command(f"plug {port}")

    def unplug(self, port: int) -> None:
        self.command(f"unplug {port}")

    def stats(self) -> dict[str, Any]:
        """Counters by port, each with its "slaves" by unit."""
        report: dict[str, Any] = json.loads(self.command("stats"))
        return report

    # ---- the frame log -------------------------------------------------------------------

    def mark(self) -> int:
        """The number of the newest frame: wait_frame(…, since=mark) looks only at later ones."""
        self._hear_of_all()
        with self._news:
            return self._last_number

    def _hear_of_all(self) -> None:
        """Frames come between the answers: those of before this one are here."""
        if self._trace and self._socket is not None and not self._gone:
            self.command("trace on")

    def frames(self, since: int = 0) -> list[Frame]:
        self._hear_of_all()
        with self._news:
            return self._behind(since)

    def wait_frame(self, predicate: Callable[[Frame], bool], timeout: float = 30.0, since: int = 0) -> Frame:
        """The oldest frame behind `since` that the predicate accepts, as soon as there is one.

        timeout: seconds on an idle machine (lab.patience).
        """
        deadline = Deadline(timeout)
        with self._news:
            while True:
                for frame in self._behind(since):
                    if predicate(frame):
                        return frame
                since = self._last_number
                if self._gone:
                    raise LineSimError("linesim has ended: it closed the control socket")
                if deadline.over:
                    last = self._records[-1].frame.text if self._records else "none"
                    raise LineSimError(
                        f"no such frame within {deadline.waited:.0f} s; the last one was: {last}", late=True
                    )
                self._news.wait(min(LOOK_S, deadline.left))

    # ---- inside --------------------------------------------------------------------------

    def _behind(self, number: int) -> list[Frame]:
        """The frames behind this number, of those that are kept."""
        newest = list(islice(reversed(self._records), self._last_number - number))
        return [record.frame for record in reversed(newest)]

    def _wait_ready(self, process: subprocess.Popen[str]) -> None:
        assert process.stdout is not None
        watchdog = threading.Timer(START_TIMEOUT_S, process.kill)
        watchdog.start()
        ready = process.stdout.readline().strip()
        watchdog.cancel()
        if ready != "ready":
            self._process = None
            _, messages = process.communicate()
            raise LineSimError(
                f"linesim did not start: {messages.strip() or f'exit code {process.returncode}'}"
            )

    def _connect(self) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._socket.connect(str(self.directory / "control"))
        self._gone = False
        self._reader = threading.Thread(target=self._read, args=(self._socket,), daemon=True)
        self._reader.start()
        if self._trace:
            self.command("trace on")

    def _read(self, connection: socket.socket) -> None:
        with connection.makefile(encoding="ascii") as lines, contextlib.suppress(OSError):
            for line in lines:
                if not line.endswith("\n"):
                    break  # it was ended while it wrote
                if line.startswith("{"):
                    self._keep(line)
                else:
                    self._answers.put(line.rstrip("\n"))
        self._answers.put(None)
        with self._news:
            self._gone = True
            self._news.notify_all()

    def _keep(self, line: str) -> None:
        with self._news:
            self._last_number += 1
            self._records.append(Record(self._last_number, line))
            self._news.notify_all()
