# SPDX-License-Identifier: GPL-3.0-or-later
"""A compiled program in the virtual machine, on the desk: logic-desk, one line for each scan."""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from types import TracebackType

from openrtu_tools.logic.binary import Program, encode
from openrtu_tools.logic.errors import LogicError
from openrtu_tools.logic.types import pack, unpack
from openrtu_tools.programs import command

FAULTS = (
    "division by zero",
    "out of its type's range",
    "index out of bounds",
    "outside of a function's domain",
    "too many instructions",
)
DECISIONS = ("pending", "confirmed", "executed", "refused")  # enum logic_decision
BUDGET = 200_000  # LOGIC_BUDGET_DEFAULT
INVALID, NOT_GOOD = 0x80, 0xC1


@dataclass(frozen=True)
class Value:
    value: bool | int | float
    quality: int = 0
    time_us: int = 0

    def shown(self) -> str:
        text = str(int(self.value)) if isinstance(self.value, bool) else repr(self.value)
        return text + ("!" if self.quality & NOT_GOOD else "")


@dataclass(frozen=True)
class Scan:
    """What a scan left."""

    outputs: dict[str, Value]
    commands: list[tuple[Value, float, bool]]  # execute, value, select
    verdicts: list[tuple[str, int]]  # of each request: a word of DECISIONS, and the result
    faults: tuple[int, ...]
    last_fault: str
    last_line: int
    messages: tuple[tuple[int, str], ...] = ()  # of a line


def desk_command() -> list[str]:
    return command("logic-desk", "logic")


def says(program: Program) -> bool:
    return any(instruction.operation == "MESSAGE" for instruction in program.instructions)


class Desk:
    """Runs one program, scan by scan, in virtual time."""

    def __init__(self, program: Program, budget: int = BUDGET) -> None:
        self.program = program
        self._says = says(program)
        self.budget = budget
        self.inputs = [point for point in program.points if not point.written]
        self.outputs = [point for point in program.points if point.written]
        self._file = tempfile.NamedTemporaryFile(suffix=".rtul")  # noqa: SIM115 - it lives as long as this
        self._file.write(encode(program))
        self._file.flush()
        self._process = subprocess.Popen(
            [*desk_command(), self._file.name],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def __enter__(self) -> Desk:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._process.communicate()
        self._file.close()

    def _ask(self, line: str) -> str:
        try:
            self._process.stdin.write(line + "\n")
            self._process.stdin.flush()
            answer = self._process.stdout.readline()
        except BrokenPipeError:
            answer = ""
        if not answer:
            reason = self._process.stderr.read().strip()
            raise LogicError(f"the virtual machine ended: {reason or self._process.wait()}")
        return answer

    def scan(
        self,
        uptime_us: int,
        elapsed_us: int,
        now_us: int,
        values: dict[str, Value],
        answers: Sequence[tuple[int, int]] = (),
        requested: Sequence[float | None] = (),
    ) -> Scan:
        """One scan; an input without a value is 0 and invalid. Answers: state and result of each command.

        Requested: the value that a master commands at the point of each request; None: nothing is.
        """
        words = ["scan", str(uptime_us), str(elapsed_us), str(now_us), str(self.budget)]
        for point in self.inputs:
            value = values.get(point.name, Value(0, INVALID))
            words.append(f"{pack(point.type, value.value):x}:{value.quality:x}:{value.time_us}")
        words += [f"{state:x}:{result:x}" for state, result in answers]
        words += ["0:0"] * (len(self.program.commands) - len(answers))
        words += [f"{value is not None:d}:{pack('LREAL', value or 0.0):x}" for value in requested]
        words += ["0:0"] * (len(self.program.requests) - len(requested))
        fields = self._ask(" ".join(words)).split()
        outputs = {}
        for point, word in zip(self.outputs, fields, strict=False):
            bits, quality = (int(part, 16) for part in word.split(":"))
            outputs[point.name] = Value(unpack(point.type, bits), quality)
        commands = []
        for word in fields[len(self.outputs) : len(self.outputs) + len(self.program.commands)]:
            execute, quality, value, select = (int(part, 16) for part in word.split(":"))
            commands.append((Value(bool(execute), quality), float(unpack("LREAL", value)), bool(select)))
        verdicts = []
        for word in fields[-len(FAULTS) - 2 - len(self.program.requests) : -len(FAULTS) - 2]:
            decision, result = (int(part, 16) for part in word.split(":"))
            verdicts.append((DECISIONS[decision], result))
        counts = [int(word) for word in fields[-len(FAULTS) - 2 :]]
        faults, last_fault, last_line = tuple(counts[:-2]), FAULTS[counts[-2]], counts[-1]
        return Scan(outputs, commands, verdicts, faults, last_fault, last_line, self._messages())

    def _messages(self) -> tuple[tuple[int, str], ...]:
        if not self._says:
            return ()
        *words, _ = self._ask("messages").split()
        pairs = (word.split(":") for word in words)
        return tuple((int(line), bytes.fromhex(text).decode(errors="replace")) for line, text in pairs)

    def reload(self, program: Program) -> int:
        """Replaces the program; returns how many retained variables the new one takes over."""
        with tempfile.NamedTemporaryFile(suffix=".rtul") as file:
            file.write(encode(program))
            file.flush()
            carried = int(self._ask(f"reload {file.name}"))
        self.program = program
        self._says = says(program)
        self.inputs = [point for point in program.points if not point.written]
        self.outputs = [point for point in program.points if point.written]
        return carried

    def coverage(self) -> list[int]:
        """Of each instruction: 1 it ran, + 2 its condition held, + 4 it did not."""
        return [int(digit) for digit in self._ask("coverage").strip()]
