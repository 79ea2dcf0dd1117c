# SPDX-License-Identifier: GPL-3.0-or-later
"""
One routine while it is made: what its names stand for, its instructions, temporaries and open loops.

What is computed from a flagged value is flagged. The machine does that for data. For what a condition
decides, each statement with branches ends with SPREAD over what its branches write.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

from openrtu_tools.logic.binary import Instruction, Point, Program, Routine, Slot, String
from openrtu_tools.logic.errors import SourceError
from openrtu_tools.logic.layout import Bounds, Leaf, Stored
from openrtu_tools.logic.syntax import (
    Literal,
    Unit,
    Variable,
)


@dataclass
class Instance:
    """Of a function block: its variables, and its routine once it was called."""

    unit: Unit
    scope: Scope
    slots: list[Slot]  # all that it remembers
    routine: Routine | None = None


@dataclass
class Instances:
    """An array of blocks. One of them works at a time, in a place of its own: the routine is there once."""

    bounds: tuple[Bounds, ...]
    places: list[str]  # of each element, behind the variable's name
    elements: list[Instance]
    working: Instance
    leaves: list[Leaf] = field(default_factory=list)  # of each slot, those of all elements

    @property
    def unit(self) -> Unit:
        return self.working.unit


@dataclass
class Bound:
    """What a name stands for."""

    variable: Variable
    what: Slot | Stored | Instance | Instances | Literal
    point: Point | None = None
    read: bool = False
    written: bool = False


@dataclass
class Scope:
    unit: Unit
    names: dict[str, Bound] = field(default_factory=dict)
    broken: dict[str, SourceError] = field(default_factory=dict)  # what is wrong with a declaration


@dataclass
class Loop:
    doubt: Slot
    exits: list[int] = field(default_factory=list)  # jumps to patch
    continues: list[int] = field(default_factory=list)


class Body:
    """One routine while it is made: its temporaries, its open loops."""

    def __init__(self, program: Program, scope: Scope) -> None:
        self.program = program
        self.scope = scope
        self.routine = Routine()
        self.free: dict[str, list[Slot]] = {}
        self.free_texts: dict[int, list[String]] = {}
        self.live: list[Slot | String] = []
        self.loops: list[Loop] = []
        self.returns: list[int] = []
        self.doubt: Slot | None = None  # of the conditions that decided about a RETURN
        self.line = scope.unit.place.line

    def emit(self, operation: str, kind: str, *operands: object) -> int:
        """The number of the new instruction, for a jump to be patched."""
        self.routine.code.append(Instruction(operation, kind, list(operands), self.line))
        return self.here - 1

    def block(self, target: Sequence[Slot], source: Slot) -> None:
        """Copies as many as the target has, from the source on."""
        operation, kind = ("MOVE", target[0].type) if len(target) == 1 else ("BLOCK", "BOOL")
        operands = [target[0], source, *([] if len(target) == 1 else [len(target)])]
        self.routine.code.append(Instruction(operation, kind, operands, self.line, list(target)))

    @property
    def here(self) -> int:
        return len(self.routine.code)

    def patch(self, jump: int) -> None:
        instruction = self.routine.code[jump]
        instruction.operands[0 if instruction.operation == "JUMP" else 1] = self.here

    def temporary(self, kind: str) -> Slot:
        pool = self.free.setdefault(kind, [])
        slot = pool.pop() if pool else self.program.add(Slot(kind, False))
        self.live.append(slot)
        return slot

    def text(self, octets: int) -> String:
        """A temporary STRING, with room for so many at least."""
        octets = min(255, (octets + 7) // 8 * 8)
        pool = self.free_texts.setdefault(octets, [])
        if pool:
            text = pool.pop()
        else:
            text = String(
                [self.program.add(Slot("LINT", False)) for _ in range(1 + (octets + 7) // 8)], octets
            )
        self.live.append(text)
        return text

    @contextmanager
    def temporaries(self) -> Iterator[None]:
        """Those made inside are free again behind it."""
        before = len(self.live)
        yield
        for slot in self.live[before:]:
            if isinstance(slot, String):
                self.free_texts[slot.octets].append(slot)
            else:
                self.free[slot.type].append(slot)
        del self.live[before:]

    def spread(self, doubt: Slot, start: int) -> None:
        """What the instructions from start on may write takes the doubt's quality: it might differ."""
        written = {slot for instruction in self.routine.code[start:] for slot in writes(instruction)}
        ordered = sorted(written, key=lambda slot: slot.number)
        if not ordered:
            return
        jump = self.emit("CLEAN", "BOOL", doubt, 0)
        first = 0
        for last, slot in enumerate(ordered):
            if last + 1 == len(ordered) or ordered[last + 1].number != slot.number + 1:
                self.emit("SPREAD", "BOOL", ordered[first], doubt, last + 1 - first)
                first = last + 1
        self.patch(jump)


def writes(instruction: Instruction) -> list[Slot]:
    """The variables that an instruction may write."""
    operation, operands = instruction.operation, instruction.operands
    if operation == "STORE":
        return operands[1].slots
    if operation == "BLOCK":
        return instruction.covers
    if operation == "CALL":
        return list(operands[0].writes)
    if operation in ("JUMP", "IF", "ELSIF", "CLEAN", "RETURN", "SPREAD", "MESSAGE"):
        # IF writes a temporary; what SPREAD covers was written before.
        return []
    written = operands[0].slots if isinstance(operands[0], String) else operands[:1]
    return [slot for slot in written if slot.variable]
