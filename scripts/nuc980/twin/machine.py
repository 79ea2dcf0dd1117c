# SPDX-License-Identifier: GPL-3.0-or-later
"""One run of the emulated board: its process, its monitor, its serial lines, and its bus as qtest sees it."""

from __future__ import annotations

import select
import socket
import subprocess
import tempfile
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from qemu.qmp import QMPError
from qemu.qmp.legacy import QEMUMonitorProtocol

ANSWER_SECONDS = 60.0
# QEMU's arguments that count the board's time in instructions, of 8 ns each. A busy host then makes the board
# late; in the host's time it would be overloaded, and lose characters and deadlines that no board loses.
INSTRUCTION_TIME = ("-icount", "shift=3")


class MachineError(Exception):
    """QEMU ended, refused a command, or kept silent; the text has what it said."""


class SerialLine:
    """The far end of a UART's wires, or of the bus that its transceiver drives."""

    def __init__(self, sock: socket.socket) -> None:
        self._socket = sock
        self.seen = b""  # what has come since the last wait_for

    def send(self, data: bytes) -> None:
        """Puts bytes on the line."""
        self._socket.sendall(data)

    def receive(self, seconds: float) -> bytes:
        """What comes within the time, at once when something is there; b"" when nothing does."""
        ready, _, _ = select.select([self._socket], [], [], seconds)
        data = self._socket.recv(65536) if ready else b""
        self.seen += data
        return data

    def wait_for(self, text: bytes, seconds: float = ANSWER_SECONDS) -> bytes:
        """Reads until text has come after the last wait_for; returns all up to its end."""
        deadline = time.monotonic() + seconds
        while text not in self.seen:
            left = deadline - time.monotonic()
            if left <= 0 or not self.receive(left):
                raise MachineError(f"no {text!r} within {seconds} s; the line said {self.seen[-2000:]!r}")
        end = self.seen.index(text) + len(text)
        before, self.seen = self.seen[:end], self.seen[end:]
        return before

    def close(self) -> None:
        self._socket.close()


class Machine:
    """The board under QEMU, from `with` to its end.

    registers: only the bus, no processor runs, and time stands still but for step(). Else the machine runs,
    and the bus can be looked at beside it.
    uarts: the numbers whose far ends are wanted, as .uarts[n].
    chardevs: what other UARTs' far ends are, as for -chardev without an id: "pty", "serial,path=/dev/pts/3".
    incoming: does not start, but waits for the state of another: reborn().
    """

    def __init__(
        self,
        program: Path,
        *arguments: str | Path,
        options: str = "",
        registers: bool = False,
        uarts: Sequence[int] = (0,),
        chardevs: Mapping[int, str] | None = None,
        incoming: bool = False,
    ) -> None:
        chardevs = chardevs or {}
        self._again = partial(
            Machine, program, *arguments, options=options, registers=registers, uarts=uarts,
            chardevs=chardevs, incoming=True,
        )  # fmt: skip
        self._now = 0  # virtual time in nanoseconds, while only step() moves it
        self._folder = tempfile.TemporaryDirectory(prefix="twin-")
        folder = Path(self._folder.name)
        self.log = folder / "qemu.log"
        self.uarts: dict[int, SerialLine] = {}
        listeners = {name: _listen(folder / name) for name in ("qtest", *(f"uart{n}" for n in uarts))}
        command: list[str | Path] = [
            program, "-M", f"nuc980{options and ','}{options}", "-nodefaults", "-display", "none",
            "-qmp", f"unix:{folder}/qmp,server=off", "-qtest", f"unix:{folder}/qtest", "-qtest-log", "none",
            "-d", "guest_errors,unimp", "-D", self.log, "-accel", "qtest" if registers else "tcg", "-S",
        ]  # fmt: skip
        if incoming:
            command += ["-incoming", "defer"]
        for number in uarts:
            command += ["-chardev", f"socket,id=uart{number},path={folder}/uart{number}"]
        for number, far_end in chardevs.items():
            backend, _, settings = far_end.partition(",")
            command += ["-chardev", f"{backend},id=uart{number}{settings and ','}{settings}"]
        command += ["-serial", "chardev:uart0" if 0 in {*uarts, *chardevs} else "none"]
        self._qmp = QEMUMonitorProtocol(f"{folder}/qmp", server=True)
        with (folder / "output").open("wb") as output:
            self.process = subprocess.Popen(
                [*command, *arguments], stdin=subprocess.DEVNULL, stdout=output, stderr=output
            )
        try:
            self._qtest = self._accept(listeners["qtest"])
            self.uarts = {n: SerialLine(self._accept(listeners[f"uart{n}"])) for n in uarts}
            self._negotiate()
        except BaseException:
            self.close()
            raise
        finally:
            for listener in listeners.values():
                listener.close()
        self._answers = self._qtest.makefile("r", encoding="ascii")
        if not incoming:
            self.command("cont")  # only now: nothing that the guest does is missed

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Ends the run and removes its files."""
        self.process.kill()
        self.process.wait()
        with suppress(EOFError, OSError, QMPError):  # QEMU may have ended by itself
            self._qmp.close()
        for line in self.uarts.values():
            line.close()
        self._folder.cleanup()

    @property
    def output(self) -> str:
        """What QEMU itself has written to its standard output and error."""
        return (Path(self._folder.name) / "output").read_text(errors="replace")

    @property
    def complaints(self) -> str:
        """What the guest did wrong, and what is not modelled, as QEMU has logged it so far."""
        return self.log.read_text(errors="replace") if self.log.exists() else ""

    # ---- monitor

    def command(self, name: str, /, **arguments: Any) -> Any:
        """A QMP command's result."""
        return self._qmp.cmd(name, **arguments)

    def info(self, what: str) -> str:
        """What the human monitor answers to `info what`."""
        return self.monitor(f"info {what}")

    def monitor(self, line: str) -> str:
        """What the human monitor answers."""
        return self.command("human-monitor-command", **{"command-line": line})

    def events(self, name: str) -> list[dict[str, Any]]:
        """The data of the QMP events of this name that have come till now; others are dropped."""
        self.command("query-status")  # its answer comes after all events before it
        return [event["data"] for event in self._qmp.get_events() if event["event"] == name]

    def wait_for_event(self, name: str) -> dict[str, Any]:
        """The data of the next QMP event of this name; what came before it is dropped."""
        deadline = time.monotonic() + ANSWER_SECONDS
        while True:
            try:
                event = self._qmp.pull_event(wait=max(deadline - time.monotonic(), 0.001))
            except TimeoutError as error:
                raise MachineError(f"no event {name} within {ANSWER_SECONDS} s") from error
            if event and event["event"] == name:
                return event["data"]

    def pty(self, number: int) -> str:
        """The pseudo-terminal at a UART whose far end is one."""
        (found,) = (each for each in self.command("query-chardev") if each["label"] == f"uart{number}")
        return found["filename"].removeprefix("pty:")

    # ---- bus

    def read(self, address: int) -> int:
        """A register's 32 bits."""
        return int(self._ask(f"readl {address:#x}"), 16)

    def write(self, address: int, value: int) -> None:
        """Sets a register's 32 bits."""
        self._ask(f"writel {address:#x} {value:#x}")

    def read_byte(self, address: int) -> int:
        return int(self._ask(f"readb {address:#x}"), 16)

    def write_byte(self, address: int, value: int) -> None:
        self._ask(f"writeb {address:#x} {value:#x}")

    def read_memory(self, address: int, size: int) -> bytes:
        """Memory's bytes, also those of a register block."""
        return bytes.fromhex(self._ask(f"read {address:#x} {size:#x}")[2:])

    def write_memory(self, address: int, data: bytes) -> None:
        self._ask(f"write {address:#x} {len(data):#x} 0x{data.hex()}")

    def step(self, nanoseconds: int) -> None:
        """Lets virtual time pass (registers only); due timers run on the way, each at its time."""
        self._now = int(self._ask(f"clock_step {nanoseconds}"))

    def set_line(self, device: str, name: str, level: int, number: int = 0) -> None:
        """Sets a device's named input line, whoever drives it; device is its path below /machine/soc."""
        self._ask(f"set_irq_in /machine/soc/{device} {name} {number} {level}")

    # ---- snapshots

    def reborn(self) -> Machine:
        """A new machine that goes on where this one stops: a migration through a file."""
        state = Path(self._folder.name) / "state"
        self.save(state)
        new = self._again()
        try:
            if self._now:
                new._ask(f"clock_set {self._now}")  # qtest's time is not part of the state
                new._now = self._now
            new.load(state)
        except BaseException:
            new.close()
            raise
        return new

    def save(self, state: Path) -> None:
        """Stops, and writes the state to a file."""
        self.command("stop")
        self.command("migrate", uri=f"exec:cat > {state}")
        self._wait_until("query-migrate", "completed")

    def load(self, state: Path) -> None:
        """Goes on from a file's state; QEMU ends if it refuses it."""
        self.command("migrate-incoming", uri=f"exec:cat {state}")
        self._wait_until("query-migrate", "completed")
        self.command("cont")

    def _wait_until(self, query: str, status: str) -> None:
        deadline = time.monotonic() + ANSWER_SECONDS
        while (answer := self.command(query)).get("status") != status:
            if answer.get("status") == "failed" or time.monotonic() > deadline:
                raise MachineError(f"{query} says {answer}, not {status}: {self.output}")
            time.sleep(0.005)

    def _ask(self, line: str) -> str:
        self._qtest.sendall(line.encode() + b"\n")
        while True:
            answer = self._answers.readline().split()
            if not answer:
                raise MachineError(f"QEMU ended at '{line}': {self.output}")
            if answer[0] == "OK":
                return answer[1] if len(answer) > 1 else ""
            if answer[0] != "IRQ":
                raise MachineError(f"'{line}': {' '.join(answer)}")

    def _negotiate(self) -> None:
        try:
            self._qmp.accept(ANSWER_SECONDS)
        except QMPError as error:
            self.process.wait(ANSWER_SECONDS)
            raise MachineError(f"QEMU ended with {self.process.returncode}: {self.output}") from error

    def _accept(self, listener: socket.socket) -> socket.socket:
        while True:
            ready, _, _ = select.select([listener], [], [], 0.1)
            if ready:
                connection, _ = listener.accept()
                connection.settimeout(ANSWER_SECONDS)
                return connection
            if self.process.poll() is not None:
                raise MachineError(f"QEMU ended with {self.process.returncode}: {self.output}")


def _listen(path: Path) -> socket.socket:
    listener = socket.socket(socket.AF_UNIX)
    listener.bind(str(path))
    listener.listen(1)
    return listener
