# SPDX-License-Identifier: GPL-3.0-or-later
"""
From the tree to instructions, with all checks on the way.

What is computed from a flagged value is flagged. The machine does that for data. For what a condition
decides, each statement with branches ends with SPREAD over what its branches write.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from pathlib import Path

from logic.binary import FUNCTIONS, Array, Command, Instruction, Point, Program, Routine, Slot
from logic.errors import Findings, Place, SourceError
from logic.parser import parse
from logic.syntax import (
    Argument,
    Assign,
    Binary,
    Call,
    Case,
    Expression,
    For,
    If,
    Leave,
    Literal,
    Name,
    Repeat,
    Statement,
    Unary,
    Unit,
    Variable,
    While,
)
from logic.types import ALIASES, BITS, INTEGERS, NUMBERS, RANGES, REAL_MAX, REALS, TYPES, common, pack, widens

STANDARD = Path(__file__).with_name("standard.st")
CLOCKS = {"UPTIME": "TIME", "SCAN_TIME": "TIME", "NOW": "DATE_AND_TIME"}
ARITHMETIC = {"+": "ADD", "-": "SUB", "*": "MUL", "/": "DIV", "MOD": "MOD"}
COMPARED = {
    "=": ("EQ", False),
    "<>": ("NE", False),
    "<": ("LT", False),
    "<=": ("LE", False),
    ">": ("LT", True),
    ">=": ("LE", True),
}
LETTER = {"REAL": "R", "LREAL": "D"}
# The variables that have their initial values again at each call.
FORGOTTEN = {
    "PROGRAM": ("VAR_TEMP",),
    "FUNCTION_BLOCK": ("VAR_TEMP",),
    "FUNCTION": ("VAR", "VAR_OUTPUT", "VAR_TEMP"),
}
COMMAND_PARTS = ("EXECUTE", "VALUE", "SELECT", "STATE", "RESULT")


@dataclass
class Instance:
    """Of a function block: its variables, and its routine once it was called."""

    unit: Unit
    scope: Scope
    routine: Routine | None = None


@dataclass
class Bound:
    """What a name stands for."""

    variable: Variable
    what: Slot | Array | Instance | Literal
    point: Point | None = None
    read: bool = False
    written: bool = False


@dataclass
class Scope:
    unit: Unit
    names: dict[str, Bound] = field(default_factory=dict)


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
        self.live: list[Slot] = []
        self.loops: list[Loop] = []
        self.returns: list[int] = []
        self.doubt: Slot | None = None  # of the conditions that decided about a RETURN
        self.line = scope.unit.place.line

    def emit(self, operation: str, kind: str, *operands: object) -> int:
        """The number of the new instruction, for a jump to be patched."""
        self.routine.code.append(Instruction(operation, kind, list(operands), self.line))
        return self.here - 1

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

    @contextmanager
    def temporaries(self) -> Iterator[None]:
        """Those made inside are free again behind it."""
        before = len(self.live)
        yield
        for slot in self.live[before:]:
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
    if operation == "CALL":
        return list(operands[0].writes)
    if operation in ("JUMP", "IF", "ELSIF", "CLEAN", "RETURN", "SPREAD", "BLOCK"):
        # IF writes a temporary; what SPREAD covers was written before; BLOCK's target is in the same list.
        return []
    return [operands[0]] if operands[0].variable else []


def compile_text(text: str, findings: Findings, name: str = "program") -> Program:
    """Compiles; the program is of use only if the findings have no error."""
    library = parse(STANDARD.read_text(encoding="utf-8"), Findings())
    for unit in library:
        unit.library = True
    return Compiler([*library, *parse(text, findings)], findings).program_of(name)


class Compiler:
    def __init__(self, units: list[Unit], findings: Findings) -> None:
        self.findings = findings
        self.program = Program("")
        self.units: dict[str, Unit] = {}
        self.functions: dict[str, tuple[Scope, Routine | None]] = {}
        self.scope: Scope | None = None  # in which constants are looked up
        self.body: Body | None = None
        self.open_blocks: list[str] = []
        for unit in units:
            if unit.name in self.units:
                findings.error(unit.place, f"{unit.name} is defined twice")
            self.units[unit.name] = unit

    def program_of(self, name: str) -> Program:
        own = [unit for unit in self.units.values() if not unit.library]
        programs = [unit for unit in own if unit.kind == "PROGRAM"]
        if len(programs) != 1:
            place = programs[1].place if programs else Place(1, 1)
            self.findings.error(place, f"expected one PROGRAM in the file, found {len(programs)}")
        for unit in own:  # also those that nobody calls have their mistakes found
            if unit.kind == "FUNCTION":
                self.function(unit, unit.place)
            elif unit.kind == "FUNCTION_BLOCK":
                keep, self.program = self.program, Program("")
                functions, self.functions = self.functions, {}
                self.unit(unit, self.scope_of(unit, ""))
                self.program, self.functions = keep, functions
        for unit in programs[:1]:
            self.program.name = unit.name or name
            scope = self.scope_of(unit, "")
            self.unit(unit, scope)
            self.program.points.sort(key=lambda point: point.name)
        return self.program

    # ---- units and their variables -----------------------------------------------------------------

    def unit(self, unit: Unit, scope: Scope) -> Routine:
        """The routine of a unit's text with these variables."""
        outer, outer_scope, self.scope = self.body, self.scope, scope
        muted, self.findings.muted = self.findings.muted, self.findings.muted or unit.library
        self.body = Body(self.program, scope)
        body = self.body
        body.routine.library = unit.library
        body.doubt = body.temporary("BOOL")
        returns = any(leaves(statement, "RETURN", inside_loops=True) for statement in unit.body)
        if returns:
            body.emit("AS_GOOD", "BOOL", body.doubt, body.doubt)
        self.begin_anew(scope, FORGOTTEN[unit.kind])
        self.statements(unit.body)
        for jump in body.returns:
            body.patch(jump)
        if returns:
            body.spread(body.doubt, 0)
        body.emit("RETURN", "BOOL")
        if unit.kind != "FUNCTION":
            body.routine.writes = {slot for one in body.routine.code for slot in writes(one)}
        if unit.kind == "PROGRAM" or unit.kind == "FUNCTION":
            self.report_unused(scope)
        if unit.kind == "PROGRAM":
            self.report_twice(unit)
        self.program.routines.append(body.routine)
        self.findings.muted = muted
        self.body, self.scope = outer, outer_scope
        return body.routine

    def begin_anew(self, scope: Scope, sections: Sequence[str]) -> None:
        """What remembers nothing from call to call has its initial value again."""
        for bound in scope.names.values():
            if bound.variable.section not in sections:
                continue
            if isinstance(bound.what, Slot):
                initial = self.program.initial.get(bound.what, 0)
                self.body.emit("MOVE", bound.what.type, bound.what, self.cell(bound.what.type, initial))
            elif isinstance(bound.what, Array):
                fresh = [self.program.add(Slot(bound.what.type, True)) for _ in bound.what.slots]
                for slot, own in zip(fresh, bound.what.slots, strict=True):
                    if own in self.program.initial:
                        self.program.initial[slot] = self.program.initial[own]
                self.body.emit("BLOCK", "BOOL", bound.what.slots[0], fresh[0], len(fresh))

    def report_unused(self, scope: Scope) -> None:
        """Only of a text without mistakes: a mistake hides the uses in its statement."""
        if self.findings.failed:
            return
        for bound in scope.names.values():
            if not bound.read and not bound.written:
                self.findings.warn(bound.variable.place, f"{bound.variable.spelling} is not used")

    def report_twice(self, unit: Unit) -> None:
        """A point that two statements of the same list assign: the first one does nothing."""
        seen: dict[str, Place] = {}
        for statement in unit.body:
            if not isinstance(statement, Assign) or statement.target.index is not None:
                continue
            bound = self.body.scope.names.get(statement.target.name)
            if bound is None or bound.variable.section != "VAR_EXTERNAL":
                continue
            if statement.target.name in seen:
                first = seen[statement.target.name].line
                self.findings.warn(
                    statement.place, f"{bound.variable.spelling} is written twice: here and in line {first}"
                )
            seen[statement.target.name] = statement.place

    def scope_of(self, unit: Unit, path: str) -> Scope:
        scope = Scope(unit)
        outer, self.scope = self.scope, scope
        if unit.result is not None:
            result = Variable(unit.place, unit.name, "VAR_OUTPUT", unit.result, spelling=unit.name)
            self.declare(scope, result, path)
            scope.names[unit.name].read = True
        for variable in unit.variables:
            try:
                self.declare(scope, variable, path)
            except SourceError as error:
                self.findings.error(error.place, error.text)
        self.scope = outer
        return scope

    def declare(self, scope: Scope, variable: Variable, path: str) -> None:
        if variable.name in scope.names:
            raise SourceError(variable.place, f"{variable.spelling} is declared twice")
        if variable.section == "VAR_EXTERNAL" and scope.unit.kind != "PROGRAM":
            raise SourceError(variable.place, "points belong to the PROGRAM; pass them as inputs")
        kind = ALIASES.get(variable.type, variable.type)
        block = self.units.get(kind)
        if block is not None and block.kind == "FUNCTION_BLOCK":
            scope.names[variable.name] = Bound(variable, self.instance(scope, variable, block, path))
            return
        if kind not in TYPES:
            raise SourceError(
                variable.place, f"unknown type {variable.type}{self.meant(kind, [*TYPES, *self.units])}"
            )
        if variable.constant:
            if len(variable.initial) != 1 or variable.bounds:
                raise SourceError(variable.place, f"the constant {variable.spelling} needs one value")
            value = self.constant(variable.initial[0], kind)
            scope.names[variable.name] = Bound(variable, Literal(variable.place, kind, value))
            return
        values = [self.constant(value, kind) for value in variable.initial]
        low, count = self.extent(variable)
        if len(values) > count:
            raise SourceError(variable.place, f"{len(values)} initial values for {count} elements")
        slots = [self.program.add(Slot(kind, True)) for _ in range(count)]
        self.program.initial |= {slot: pack(kind, value) for slot, value in zip(slots, values, strict=False)}
        if variable.retain and (scope.unit.kind == "FUNCTION" or variable.section == "VAR_TEMP"):
            raise SourceError(variable.place, "a FUNCTION and VAR_TEMP cannot retain a value")
        if variable.retain:
            self.program.retained.append((f"{path}{variable.name}", slots))
        bound = Bound(variable, slots[0])
        if variable.bounds:
            bound.what = Array(slots, kind, low)
            self.program.arrays.append(bound.what)
        if variable.section == "VAR_EXTERNAL":
            if variable.bounds or variable.initial:
                raise SourceError(
                    variable.place,
                    f"the point {variable.spelling} cannot be an array or have an initial value",
                )
            bound.point = Point(variable.spelling, kind, slots[0])
            self.program.points.append(bound.point)
        scope.names[variable.name] = bound

    def extent(self, variable: Variable) -> tuple[int, int]:
        if variable.bounds is None:
            return 0, 1
        if variable.section in ("VAR_INPUT", "VAR_OUTPUT", "VAR_IN_OUT"):
            raise SourceError(variable.place, "an array cannot be passed yet; pass its elements")
        low, high = (int(self.constant(bound, "DINT")) for bound in variable.bounds)
        if not low <= high < low + 30000:
            raise SourceError(variable.place, f"an array from {low} to {high}: it needs 1 to 30000 elements")
        return low, high - low + 1

    def instance(self, scope: Scope, variable: Variable, block: Unit, path: str) -> Instance:
        if variable.bounds or variable.initial or variable.constant or variable.section == "VAR_EXTERNAL":
            raise SourceError(variable.place, f"an instance of {block.name} must be a plain variable")
        if scope.unit.kind == "FUNCTION" or variable.section == "VAR_TEMP":
            raise SourceError(
                variable.place, f"{block.name} keeps a state, but a FUNCTION and VAR_TEMP keep none"
            )
        if block is scope.unit or block.name in self.open_blocks:
            raise SourceError(variable.place, f"{block.name} contains itself")
        self.open_blocks.append(block.name)
        inner = self.scope_of(block, f"{path}{variable.name}.")
        self.open_blocks.pop()
        return Instance(block, inner)

    # ---- statements --------------------------------------------------------------------------------

    def statements(self, statements: Sequence[Statement]) -> None:
        left = False
        for statement in statements:
            if left:
                self.findings.warn(statement.place, "this statement is never reached")
                left = False
            left = isinstance(statement, Leave)
            self.body.line = statement.place.line
            try:
                with self.body.temporaries():
                    self.statement(statement)
            except SourceError as error:
                self.findings.error(error.place, error.text)

    def statement(self, statement: Statement) -> None:
        match statement:
            case Assign():
                self.assign(statement)
            case Call():
                self.call_block(statement)
            case If():
                self.if_(statement.branches, statement.otherwise)
            case Case():
                self.case(statement)
            case For():
                self.for_(statement)
            case While() | Repeat():
                self.while_(statement)
            case Leave():
                self.leave(statement)

    def assign(self, statement: Assign) -> None:
        bound = self.writable(statement.target)
        if isinstance(bound.what, Array):
            if statement.target.index is None:
                raise SourceError(statement.place, f"{bound.variable.spelling} is an array; name an element")
            value = self.value(statement.value, bound.what.type)
            self.body.emit("STORE", bound.what.type, value, bound.what, self.index(statement.target.index))
        else:
            self.move(bound.what, self.value(statement.value, bound.what.type))

    def move(self, target: Slot, value: Slot) -> None:
        """The last instruction writes there at once where it has just made the value."""
        code = self.body.routine.code
        made = ("MOVE", "JUMP", "IF", "ELSIF", "CLEAN", "SPREAD", "CALL", "RETURN", "STORE", "BLOCK")
        if (
            code
            and value in self.body.live
            and code[-1].operation not in made
            and code[-1].operands[0] is value
        ):
            code[-1].operands[0] = target
        else:
            self.body.emit("MOVE", target.type, target, value)

    def writable(self, target: Name) -> Bound:
        bound = self.bound(target)
        if target.member:
            raise SourceError(target.place, f"only the block itself writes {target.name}.{target.member}")
        if isinstance(bound.what, Instance):
            raise SourceError(target.place, f"{target.name} is a block; call it: {target.name}(…)")
        if isinstance(bound.what, Literal):
            raise SourceError(target.place, f"{bound.variable.spelling} is a constant")
        if bound.variable.section == "VAR_INPUT":
            raise SourceError(
                target.place, f"{bound.variable.spelling} is an input; only the caller writes it"
            )
        bound.written = True
        if bound.point:
            bound.point.written = True
        return bound

    def if_(
        self, branches: Sequence[tuple[Expression, Sequence[Statement]]], otherwise: Sequence[Statement]
    ) -> None:
        def conditions() -> Iterator[tuple[Slot, Sequence[Statement]]]:
            for number, (condition, statements) in enumerate(branches):
                folded = self.truth(condition)
                if folded is not None:
                    rest = bool(otherwise) or number + 1 < len(branches)
                    if not folded or rest:
                        what = "the branches behind it are" if folded else "this branch is"
                        self.findings.warn(
                            condition.place,
                            f"the condition is always {str(folded).upper()}: {what} never reached",
                        )
                yield self.value(condition, "BOOL"), statements

        self.branches(conditions(), otherwise)

    def branches(
        self, conditions: Iterator[tuple[Slot, Sequence[Statement]]], otherwise: Sequence[Statement]
    ) -> None:
        body = self.body
        doubt, start, ends = body.temporary("BOOL"), body.here, []
        operation, jump, everything = "IF", 0, list(otherwise)
        for condition, statements in conditions:
            jump = body.emit(operation, "BOOL", condition, 0, doubt)
            operation = "ELSIF"
            everything += statements
            self.carry_doubt(doubt, statements)
            self.statements(statements)
            ends.append(body.emit("JUMP", "BOOL", 0))
            body.patch(jump)
        if otherwise:
            self.carry_doubt(doubt, otherwise)
            self.statements(otherwise)
        elif ends:  # the last branch needs no jump to what follows; jumps to this jump now lead there
            body.routine.code.pop(ends.pop())
            body.patch(jump)
        for end in ends:
            body.patch(end)
        self.carry_doubt(doubt, everything)  # also of what was not taken
        body.spread(doubt, start)

    def carry_doubt(self, doubt: Slot, statements: Sequence[Statement]) -> None:
        """Where a condition decides whether a loop or the unit goes on, all behind it has its doubt."""
        body = self.body
        if body.loops and any(leaves(one, "EXIT") or leaves(one, "CONTINUE") for one in statements):
            body.emit("SPREAD", "BOOL", body.loops[-1].doubt, doubt, 1)
        if body.doubt and any(leaves(one, "RETURN", inside_loops=True) for one in statements):
            body.emit("SPREAD", "BOOL", body.doubt, doubt, 1)

    def case(self, statement: Case) -> None:
        selector = self.any_value(statement.selector)
        if (selector.type or "DINT") not in INTEGERS + BITS:
            raise SourceError(statement.selector.place, "the selector of CASE must be an integer")
        selector = self.become(selector, selector.type or "DINT", statement.selector.place)
        taken: dict[int, Place] = {}

        def conditions() -> Iterator[tuple[Slot, Sequence[Statement]]]:
            for labels, statements in statement.branches:
                result = None
                for low, high in labels:
                    hit = self.label(selector, low, high, taken)
                    if result is None:
                        result = hit
                    else:
                        self.body.emit("OR", "BOOL", result, result, hit)
                if result is not None:
                    yield result, statements

        self.branches(conditions(), statement.otherwise)

    def label(
        self, selector: Slot, low: Expression, high: Expression | None, taken: dict[int, Place]
    ) -> Slot:
        first = int(self.constant(low, selector.type))
        last = int(self.constant(high, selector.type)) if high else first
        if last < first:
            raise SourceError(low.place, f"the range {first}..{last} is empty")
        again = [value for value in taken if first <= value <= last]
        if again:
            self.findings.warn(low.place, f"{again[0]} is already a case in line {taken[again[0]].line}")
        taken[first] = low.place
        hit = self.body.temporary("BOOL")
        if high is None:
            self.body.emit("EQ", selector.type, hit, selector, self.literal(selector.type, first))
            return hit
        other = self.body.temporary("BOOL")
        self.body.emit("LE", selector.type, hit, self.literal(selector.type, first), selector)
        self.body.emit("LE", selector.type, other, selector, self.literal(selector.type, last))
        self.body.emit("AND", "BOOL", hit, hit, other)
        return hit

    def for_(self, statement: For) -> None:
        """Counted beside the variable: its type may end with the last value."""
        variable = self.writable(statement.variable).what
        if not isinstance(variable, Slot) or variable.type not in INTEGERS:
            raise SourceError(statement.variable.place, "the variable of FOR must be an integer")
        step = int(self.constant(statement.step, "LINT")) if statement.step else 1
        if step == 0:
            raise SourceError(statement.place, "a loop with a step of 0 never ends")
        body = self.body
        count, last = body.temporary("LINT"), body.temporary("LINT")
        body.emit("CONVERT", "LINT", count, self.value(statement.first, variable.type))
        body.emit("CONVERT", "LINT", last, self.value(statement.last, variable.type))
        more = body.temporary("BOOL")
        loop, start = self.open_loop(), body.here
        body.emit("LE", "LINT", more, *((count, last) if step > 0 else (last, count)))
        leave = body.emit("ELSIF", "BOOL", more, 0, loop.doubt)
        self.carry_return(loop, statement.body)
        body.emit("CONVERT", variable.type, variable, count)
        self.statements(statement.body)
        for jump in loop.continues:
            body.patch(jump)
        body.line = statement.place.line
        body.emit("ADD", "LINT", count, count, self.literal("LINT", step))
        body.emit("JUMP", "BOOL", start)
        self.close_loop(loop, leave, start, statement.body)

    def while_(self, statement: While | Repeat) -> None:
        body = self.body
        loop, start = self.open_loop(), body.here
        leave = None
        if isinstance(statement, While):
            if self.truth(statement.condition) is False:
                self.findings.warn(
                    statement.condition.place, "the condition is always FALSE: the loop never runs"
                )
            with body.temporaries():
                leave = body.emit("ELSIF", "BOOL", self.value(statement.condition, "BOOL"), 0, loop.doubt)
                self.carry_return(loop, statement.body)
        self.statements(statement.body)
        for jump in loop.continues:
            body.patch(jump)
        if isinstance(statement, Repeat):
            body.line = statement.until.place.line
            condition = self.value(statement.until, "BOOL")
            body.emit("SPREAD", "BOOL", loop.doubt, condition, 1)
            self.carry_return(loop, statement.body)
            body.emit("ELSIF", "BOOL", condition, start, loop.doubt)
        else:
            body.line = statement.place.line
            body.emit("JUMP", "BOOL", start)
        self.close_loop(loop, leave, start, statement.body)

    def carry_return(self, loop: Loop, statements: Sequence[Statement]) -> None:
        """Where a RETURN is in a loop, its conditions decide whether the unit goes on."""
        if any(leaves(one, "RETURN", inside_loops=True) for one in statements):
            self.body.emit("SPREAD", "BOOL", self.body.doubt, loop.doubt, 1)

    def open_loop(self) -> Loop:
        loop = Loop(self.body.temporary("BOOL"))
        self.body.emit("AS_GOOD", "BOOL", loop.doubt, loop.doubt)
        self.body.loops.append(loop)
        return loop

    def close_loop(self, loop: Loop, leave: int | None, start: int, statements: Sequence[Statement]) -> None:
        self.body.loops.pop()
        for jump in [*loop.exits, *([] if leave is None else [leave])]:
            self.body.patch(jump)
        self.carry_return(loop, statements)
        self.body.spread(loop.doubt, start)

    def leave(self, statement: Leave) -> None:
        body = self.body
        if statement.word == "RETURN":
            body.returns.append(body.emit("JUMP", "BOOL", 0))
        elif not body.loops:
            raise SourceError(statement.place, f"{statement.word} is not in a loop")
        else:
            jumps = body.loops[-1].exits if statement.word == "EXIT" else body.loops[-1].continues
            jumps.append(body.emit("JUMP", "BOOL", 0))

    # ---- calls -------------------------------------------------------------------------------------

    def call_block(self, call: Call) -> None:
        bound = self.body.scope.names.get(call.name)
        if bound is None and self.is_function(call.name):
            raise SourceError(call.place, f"the result of {call.name} is not used")
        bound = self.bound(Name(call.place, call.name))
        if not isinstance(bound.what, Instance):
            raise SourceError(call.place, f"{call.name} is not a function block")
        bound.read = True
        instance = bound.what
        arguments = list(call.arguments)
        if instance.unit.name == "COMMAND" and instance.unit.library:
            arguments = self.bind_command(call, instance, arguments)
        self.hand_over(instance.scope, arguments, call)
        if instance.routine is None:
            instance.routine = self.unit(instance.unit, instance.scope)
        self.body.emit("CALL", "BOOL", instance.routine)
        self.fetch(instance.scope, arguments)

    def bind_command(self, call: Call, instance: Instance, arguments: list[Argument]) -> list[Argument]:
        points = [one for one in arguments if one.name == "POINT"]
        if len(points) != 1 or not isinstance(points[0].value, Name):
            raise SourceError(call.place, "COMMAND needs its point: COMMAND's instance(POINT := name, …)")
        point = self.bound(points[0].value)
        if point.point is None:
            raise SourceError(
                points[0].place, f"{points[0].value.name} is not a point; points are in VAR_EXTERNAL"
            )
        point.read = True
        if any(command.slots[0] is instance.scope.names["EXECUTE"].what for command in self.program.commands):
            raise SourceError(call.place, f"{call.name} is called twice; an instance of COMMAND has one call")
        slots = [instance.scope.names[part].what for part in COMMAND_PARTS]
        self.program.commands.append(Command(point.point.name, slots))
        return [one for one in arguments if one.name != "POINT"]

    def hand_over(self, scope: Scope, arguments: Sequence[Argument], call: Call) -> None:
        """Values into the inputs. They are all computed before the first is written."""
        inputs = [v for v in scope.unit.variables if v.section in ("VAR_INPUT", "VAR_IN_OUT")]
        given: set[str] = set()
        values = []
        for number, argument in enumerate(arguments):
            name = argument.name
            if name is None:
                if number >= len(inputs):
                    raise SourceError(argument.place, f"{call.name} has {len(inputs)} inputs")
                name = inputs[number].name
            target = scope.names.get(name)
            sections = ("VAR_OUTPUT",) if argument.output else ("VAR_INPUT", "VAR_IN_OUT")
            if target is None or target.variable.section not in sections:
                choices = [v.name for v in scope.unit.variables if v.section in sections]
                what = "output" if argument.output else "input"
                raise SourceError(
                    argument.place, f"{call.name} has no {what} {name}{self.meant(name, choices)}"
                )
            if name in given:
                raise SourceError(argument.place, f"{name} is given twice")
            given.add(name)
            target.read = True
            if not argument.output:
                values.append((target.what, self.value(argument.value, target.what.type)))
        missing = [
            v.name
            for v in inputs
            if v.name not in given and (scope.unit.kind == "FUNCTION" or v.section == "VAR_IN_OUT")
        ]
        if missing:
            raise SourceError(call.place, f"{call.name} lacks {', '.join(missing)}")
        if len(values) == 1:
            self.move(*values[0])
        else:
            for target, value in values:
                self.body.emit("MOVE", target.type, target, value)

    def fetch(self, scope: Scope, arguments: Sequence[Argument]) -> None:
        """Outputs, and what the caller lent (VAR_IN_OUT is copied in and out), to the caller's variables."""
        inputs = [v for v in scope.unit.variables if v.section in ("VAR_INPUT", "VAR_IN_OUT")]
        for number, argument in enumerate(arguments):
            source = scope.names[argument.name or inputs[number].name]
            if not argument.output and source.variable.section != "VAR_IN_OUT":
                continue
            if not isinstance(argument.value, Name):
                raise SourceError(argument.place, f"{source.variable.name} needs a variable to write to")
            bound = self.writable(argument.value)
            kind = bound.what.type
            if kind != source.what.type:
                raise SourceError(
                    argument.place, f"{source.variable.name} is {source.what.type}, the variable {kind}"
                )
            if isinstance(bound.what, Array):
                if argument.value.index is None:
                    raise SourceError(
                        argument.place, f"{bound.variable.spelling} is an array; name an element"
                    )
                self.body.emit("STORE", kind, source.what, bound.what, self.index(argument.value.index))
            else:
                self.body.emit("MOVE", kind, bound.what, source.what)

    def is_function(self, name: str) -> bool:
        unit = self.units.get(name)
        return (unit is not None and unit.kind == "FUNCTION") or name in BUILT_IN or "_TO_" in name

    def function(self, unit: Unit, place: Place) -> tuple[Scope, Routine]:
        if unit.name not in self.functions:
            scope = self.scope_of(unit, f"{unit.name}.")
            self.functions[unit.name] = (scope, None)
            self.functions[unit.name] = (scope, self.unit(unit, scope))
        scope, routine = self.functions[unit.name]
        if routine is None:
            raise SourceError(place, f"{unit.name} calls itself")
        return scope, routine

    def call_function(self, call: Call, unit: Unit) -> Slot:
        scope, routine = self.function(unit, call.place)
        self.hand_over(scope, call.arguments, call)
        result = scope.names[unit.name].what
        self.body.emit("CALL", "BOOL", routine)
        self.fetch(scope, call.arguments)
        copy = self.body.temporary(result.type)
        self.body.emit("MOVE", result.type, copy, result)
        return copy

    # ---- names and values --------------------------------------------------------------------------

    def bound(self, name: Name) -> Bound:
        scope = self.body.scope
        bound = scope.names.get(name.name)
        if bound is None:
            raise SourceError(
                name.place, f"unknown name {name.name}{self.meant(name.name, list(scope.names))}"
            )
        if name.member:
            if not isinstance(bound.what, Instance):
                raise SourceError(name.place, f"{name.name} is not a block and has no {name.member}")
            bound.read = True
            inner = bound.what.scope.names.get(name.member)
            if inner is None or inner.variable.section not in ("VAR_OUTPUT", "VAR_INPUT"):
                outputs = [v.name for v in bound.what.unit.variables if v.section == "VAR_OUTPUT"]
                raise SourceError(
                    name.place, f"{name.name} has no output {name.member}{self.meant(name.member, outputs)}"
                )
            return inner
        return bound

    @staticmethod
    def meant(name: str, choices: list[str]) -> str:
        close = get_close_matches(name, choices, 1)
        return f"; did you mean {close[0]}?" if close else ""

    def cell(self, kind: str, bits: int) -> Slot:
        return self.program.constants.setdefault((kind, bits), Slot(kind, False))

    def literal(self, kind: str, value: float) -> Slot:
        return self.cell(kind, pack(kind, value))

    def value(self, expression: Expression, kind: str) -> Slot:
        return self.become(self.any_value(expression, kind), kind, expression.place)

    def become(self, value: Slot | Literal, kind: str, place: Place) -> Slot:
        if isinstance(value, Literal):
            return self.literal(kind, fitted(value, kind, place))
        if value.type == kind:
            return value
        if not widens(value.type, kind):
            how = (
                f"; {value.type}_TO_{kind}(…) converts it" if value.type != "BOOL" and kind != "BOOL" else ""
            )
            raise SourceError(place, f"expected {kind}, found {value.type}{how}")
        return self.converted(value, kind)

    def converted(self, value: Slot, kind: str) -> Slot:
        """By value, with a fault where the type does not have it."""
        if value.type == kind:
            return value
        result = self.body.temporary(kind)
        if value.type in REALS:
            if kind in REALS:
                self.body.emit("R2D" if kind == "LREAL" else "D2R", "BOOL", result, value)
            else:
                self.body.emit("ROUND", kind, result, self.converted(value, "LREAL"))
        elif kind in REALS:
            self.body.emit("I2R" if kind == "REAL" else "I2D", "BOOL", result, value)
        else:
            self.body.emit("CONVERT", kind, result, value)
        return result

    def index(self, expression: Expression) -> Slot:
        value = self.any_value(expression)
        if isinstance(value, Literal):
            return self.literal("DINT", fitted(value, "DINT", expression.place))
        if value.type not in INTEGERS:
            raise SourceError(expression.place, f"expected an integer as index, found {value.type}")
        return value

    def any_value(self, expression: Expression, wanted: str | None = None) -> Slot | Literal:
        """wanted: what SEL, MIN, MAX and LIMIT make of numbers alone, which have no type of their own."""
        match expression:
            case Literal():
                return expression
            case Name():
                return self.name(expression)
            case Unary():
                return self.unary(expression)
            case Binary():
                return self.binary(expression)
            case Call():
                return self.call(expression, wanted)

    def name(self, name: Name) -> Slot | Literal:
        bound = self.bound(name)
        bound.read = True
        if isinstance(bound.what, Array):
            if name.index is None:
                raise SourceError(name.place, f"{bound.variable.spelling} is an array; name an element")
            index = self.index(name.index)
            result = self.body.temporary(bound.what.type)
            self.body.emit("LOAD", bound.what.type, result, bound.what, index)
            return result
        if name.index is not None:
            raise SourceError(name.place, f"{bound.variable.spelling} is not an array")
        if isinstance(bound.what, Instance):
            raise SourceError(name.place, f"{name.name} is a block; name one of its outputs")
        return bound.what

    def unary(self, expression: Unary) -> Slot | Literal:
        folded = self.folded(expression)
        if folded is not None:
            return folded
        value = self.any_value(expression.operand)
        if isinstance(value, Literal):
            value = self.literal(value.type or "DINT", value.value)
        allowed = ("BOOL", *BITS) if expression.operator == "NOT" else (*NUMBERS, "TIME")
        if value.type not in allowed:
            raise SourceError(
                expression.place, f"{expression.operator} needs {one_of(allowed)}, found {value.type}"
            )
        result = self.body.temporary(value.type)
        operation = "NOT" if expression.operator == "NOT" else f"{LETTER.get(value.type, '')}NEG"
        self.body.emit(operation, "BOOL" if value.type in REALS else value.type, result, value)
        return result

    def binary(self, expression: Binary) -> Slot | Literal:
        folded = self.folded(expression)
        if folded is not None:
            return folded
        operator, place = expression.operator, expression.place
        left, right = self.any_value(expression.left), self.any_value(expression.right)
        if operator == "**":
            return self.power(left, right, place)
        if (operator in ("+", "-", "*", "/") and "TIME" in (kind_of(left), kind_of(right))) or kind_of(
            left
        ) == "DATE_AND_TIME":
            timed = self.timed(operator, left, right, place)
            if timed is not None:
                return timed
        left, right = self.paired(left, right, place)
        kind = left.type
        if operator in COMPARED:
            return self.compared(operator, left, right, place)
        if operator in ARITHMETIC:
            if kind not in (*NUMBERS, "TIME") or (operator == "MOD" and kind in REALS):
                raise SourceError(place, f"{operator} needs numbers, found {kind}")
            operation = LETTER.get(kind, "") + ARITHMETIC[operator]
        else:
            if kind not in ("BOOL", *BITS):
                raise SourceError(place, f"{operator} needs {one_of(('BOOL', *BITS))}, found {kind}")
            operation = operator
        result = self.body.temporary(kind)
        self.body.emit(operation, "BOOL" if kind in REALS else kind, result, left, right)
        return result

    def paired(self, left: Slot | Literal, right: Slot | Literal, place: Place) -> tuple[Slot, Slot]:
        first, second = self.alike([left, right], place)
        return first, second

    def alike(self, values: Sequence[Slot | Literal], place: Place, wanted: str | None = None) -> list[Slot]:
        """All in their common type. Numbers without a type take that of the others, or the wanted one."""
        kinds = [value.type for value in values if value.type is not None]
        kind = kinds[0] if kinds else wanted or "DINT"
        for other in kinds[1:]:
            wider = common(kind, other)
            if wider is None:
                raise SourceError(place, f"{kind} and {other} have no common type; convert one of them")
            kind = wider
        fraction = any(isinstance(v, Literal) and isinstance(v.value, float) for v in values)
        if fraction and kind in INTEGERS and (kinds or wanted is None):
            kind = "LREAL"
        return [self.become(value, kind, place) for value in values]

    def compared(self, operator: str, left: Slot, right: Slot, place: Place) -> Slot:
        if left.type in REALS and operator in ("=", "<>"):
            self.findings.warn(
                place, f"two {left.type} are rarely equal; compare ABS(a - b) with a tolerance"
            )
        if left.type == "BOOL" and operator not in ("=", "<>"):
            raise SourceError(place, f"{operator} needs numbers, found BOOL")
        operation, swapped = COMPARED[operator]
        if swapped:
            left, right = right, left
        result = self.body.temporary("BOOL")
        kind = left.type
        self.body.emit(
            LETTER.get(kind, "") + operation, "BOOL" if kind in REALS else kind, result, left, right
        )
        return result

    def timed(self, operator: str, left: Slot | Literal, right: Slot | Literal, place: Place) -> Slot | None:
        """DATE_AND_TIME with TIME, and TIME times a number; None: what all other types do."""
        kinds = kind_of(left), kind_of(right)
        if kinds in {("TIME", "TIME"), ("DATE_AND_TIME", "DATE_AND_TIME")} and operator not in ("-", "+"):
            if operator in COMPARED:
                return None
            raise SourceError(place, f"{operator} is not for two of {kinds[0]}")
        if kinds == ("DATE_AND_TIME", "DATE_AND_TIME") and operator == "-":
            result = "TIME"
        elif kinds == ("DATE_AND_TIME", "TIME") and operator in ("+", "-"):
            result = "DATE_AND_TIME"
        elif kinds[0] == "TIME" and operator in ("*", "/") and (kinds[1] is None or kinds[1] in NUMBERS):
            if kinds[1] in REALS or (isinstance(right, Literal) and isinstance(right.value, float)):
                real = self.body.temporary("LREAL")
                self.body.emit(
                    "DMUL" if operator == "*" else "DDIV",
                    "BOOL",
                    real,
                    self.converted(self.become(left, "TIME", place), "LREAL"),
                    self.become(right, "LREAL", place),
                )
                return self.converted(real, "TIME")
            result = "TIME"
        else:
            return None
        first = self.converted(self.become(left, kinds[0], place), result)
        second = self.converted(self.become(right, kinds[1] or "LINT", place), result)
        slot = self.body.temporary(result)
        self.body.emit(ARITHMETIC[operator], result, slot, first, second)
        return slot

    def power(self, left: Slot | Literal, right: Slot | Literal, place: Place) -> Slot:
        kind = kind_of(left) if kind_of(left) in REALS else "LREAL"
        result = self.body.temporary("LREAL")
        self.body.emit("EXPT", "BOOL", result, self.real(left, place), self.real(right, place))
        return self.converted(result, kind)

    def real(self, value: Slot | Literal, place: Place) -> Slot:
        if not isinstance(value, Literal) and value.type not in NUMBERS:
            raise SourceError(place, f"expected a number, found {value.type}")
        return (
            self.become(value, "LREAL", place)
            if isinstance(value, Literal)
            else self.converted(value, "LREAL")
        )

    # ---- constants ---------------------------------------------------------------------------------

    def constant(self, expression: Expression, kind: str) -> bool | int | float:
        """In this type; a whole number may have been declared as another one that it fits as well."""
        folded = self.folded(expression)
        if folded is None:
            raise SourceError(expression.place, "expected a constant: numbers, names of VAR CONSTANT")
        if folded.type in INTEGERS:
            folded = replace(folded, type=None)
        return fitted(folded, kind, expression.place)

    def truth(self, expression: Expression) -> bool | None:
        folded = self.folded(expression)
        return folded.value if folded is not None and folded.type == "BOOL" else None

    def folded(self, expression: Expression) -> Literal | None:
        """The value of what has one without running: not of arithmetic with REAL, nor of bits."""
        match expression:
            case Literal():
                return expression
            case Name(index=None, member=None):
                bound = self.scope.names.get(expression.name)
                if bound is not None and isinstance(bound.what, Literal):
                    bound.read = True
                    return bound.what
                return None
            case Unary():
                return fold_one(expression, self.folded(expression.operand))
            case Binary():
                return fold(expression, self.folded(expression.left), self.folded(expression.right))
        return None

    # ---- functions of the language -----------------------------------------------------------------

    def call(self, call: Call, wanted: str | None = None) -> Slot | Literal:
        unit = self.units.get(call.name)
        if unit is not None and unit.kind == "FUNCTION":
            return self.call_function(call, unit)
        if call.name in CLOCKS:
            self.count(call, 0)
            if call.name not in self.program.clocks:
                self.program.clocks[call.name] = self.program.add(Slot(CLOCKS[call.name], True))
            return self.program.clocks[call.name]
        if call.name in ("IS_GOOD", "QUALITY", "TIME_OF", "AS_GOOD"):
            return self.attribute(call)
        source, separator, target = call.name.partition("_TO_")
        if separator:
            return self.conversion(call, ALIASES.get(source, source), ALIASES.get(target, target))
        if call.name not in BUILT_IN:
            names = [*BUILT_IN, *(name for name, unit in self.units.items() if unit.kind == "FUNCTION")]
            raise SourceError(call.place, f"unknown function {call.name}{self.meant(call.name, names)}")
        named = [argument for argument in call.arguments if argument.output]
        if named:
            raise SourceError(named[0].place, f"{call.name} has no outputs")
        return self.built_in(call, wanted)

    @staticmethod
    def count(call: Call, least: int, most: int | None = None) -> None:
        most = least if most is None else most
        if not least <= len(call.arguments) <= most:
            expected = str(least) if least == most else f"{least} or more"
            raise SourceError(
                call.place, f"{call.name} takes {expected} arguments, found {len(call.arguments)}"
            )

    def attribute(self, call: Call) -> Slot:
        self.count(call, 1)
        argument = call.arguments[0].value
        if call.name == "TIME_OF":
            bound = self.bound(argument) if isinstance(argument, Name) else None
            if bound is None or bound.point is None:
                raise SourceError(call.place, "TIME_OF needs a point: a name of VAR_EXTERNAL")
            bound.read = True
            if bound.point.time is None:
                bound.point.time = self.program.add(Slot("DATE_AND_TIME", True))
            return bound.point.time
        value = self.any_value(argument)
        if isinstance(value, Literal):
            raise SourceError(argument.place, f"{call.name} of a constant is meaningless")
        kind = {"IS_GOOD": "BOOL", "QUALITY": "BYTE"}.get(call.name, value.type)
        result = self.body.temporary(kind)
        operation = {"IS_GOOD": "GOOD", "QUALITY": "QUALITY", "AS_GOOD": "AS_GOOD"}[call.name]
        self.body.emit(operation, kind if operation == "AS_GOOD" else "BOOL", result, value)
        return result

    def conversion(self, call: Call, source: str, target: str) -> Slot:
        """By value, rounded; bits keep their low ones; TIME is counted in milliseconds."""
        if source not in TYPES or target not in TYPES or "DATE_AND_TIME" in (source, target):
            raise SourceError(call.place, f"{call.name} is not a conversion of the language")
        self.count(call, 1)
        value = self.value(call.arguments[0].value, source)
        if source == "TIME":
            if target in REALS:
                real = self.body.temporary("LREAL")
                self.body.emit(
                    "DDIV", "BOOL", real, self.converted(value, "LREAL"), self.literal("LREAL", 1000.0)
                )
                return self.converted(real, target)
            whole = self.body.temporary("LINT")
            self.body.emit("DIV", "LINT", whole, self.converted(value, "LINT"), self.literal("LINT", 1000))
            return self.converted(whole, target)
        if target == "TIME":
            if source in REALS:
                real = self.body.temporary("LREAL")
                self.body.emit(
                    "DMUL", "BOOL", real, self.converted(value, "LREAL"), self.literal("LREAL", 1000.0)
                )
                return self.converted(real, "TIME")
            result = self.body.temporary("TIME")
            self.body.emit("MUL", "TIME", result, self.converted(value, "TIME"), self.literal("TIME", 1000))
            return result
        if target == "BOOL":
            zero = self.literal(source, 0)
            result = self.body.temporary("BOOL")
            self.body.emit(
                f"{LETTER.get(source, '')}NE", "BOOL" if source in REALS else source, result, value, zero
            )
            return result
        if target in BITS and source not in REALS:
            result = self.body.temporary(target)
            self.body.emit("BITS", target, result, value)
            return result
        return self.converted(value, target)

    def built_in(self, call: Call, wanted: str | None) -> Slot:
        place = call.place
        least, most = BUILT_IN[call.name]
        self.count(call, least, most)
        if call.name in ("SEL", "MIN", "MAX", "LIMIT"):
            return self.choice(call, wanted)
        values = [self.any_value(argument.value) for argument in call.arguments]
        body = self.body
        if call.name in FUNCTIONS:
            kind = kind_of(values[0]) if kind_of(values[0]) in REALS else "LREAL"
            result = body.temporary("LREAL")
            body.emit("MATH", "BOOL", result, self.real(values[0], place), FUNCTIONS.index(call.name))
            return self.converted(result, kind)
        if call.name == "EXPT":
            return self.power(values[0], values[1], place)
        if call.name == "TRUNC":
            result = body.temporary("DINT")
            body.emit("TRUNC", "DINT", result, self.real(values[0], place))
            return result
        if call.name == "ABS":
            value = self.become(values[0], kind_of(values[0]) or "DINT", place)
            if value.type not in (*NUMBERS, "TIME"):
                raise SourceError(place, f"ABS needs a number, found {value.type}")
            result = body.temporary(value.type)
            body.emit(
                f"{LETTER.get(value.type, '')}ABS",
                "BOOL" if value.type in REALS else value.type,
                result,
                value,
            )
            return result
        if call.name in ("SHL", "SHR", "ROL", "ROR"):
            value = self.become(values[0], kind_of(values[0]) or "DWORD", place)
            if value.type not in BITS:
                raise SourceError(place, f"{call.name} needs {one_of(BITS)}, found {value.type}")
            result = body.temporary(value.type)
            body.emit(call.name, value.type, result, value, self.index(call.arguments[1].value))
            return result

    def choice(self, call: Call, wanted: str | None) -> Slot:
        """SEL, MIN, MAX, LIMIT. But for SEL each operand counts for the quality, also those that lose."""
        arguments = call.arguments[1:] if call.name == "SEL" else call.arguments
        values = self.alike([self.any_value(one.value, wanted) for one in arguments], call.place, wanted)
        if call.name == "SEL":
            condition = self.value(call.arguments[0].value, "BOOL")
            return self.chosen(condition, values[1], values[0])
        if call.name == "LIMIT":
            low, value, high = values
            return self.extreme("MIN", [self.extreme("MAX", [value, low], call.place), high], call.place)
        return self.extreme(call.name, values, call.place)

    def extreme(self, which: str, values: Sequence[Slot], place: Place) -> Slot:
        result = values[0]
        for value in values[1:]:
            smaller = self.compared("<", result, value, place)
            best = self.chosen(smaller, *((result, value) if which == "MIN" else (value, result)))
            for operand in (result, value):
                self.body.emit("SPREAD", "BOOL", best, operand, 1)
            result = best
        return result

    def chosen(self, condition: Slot, if_true: Slot, if_false: Slot) -> Slot:
        """One of two values, with its own quality and that of the condition."""
        body = self.body
        result, doubt = body.temporary(if_true.type), body.temporary("BOOL")
        jump = body.emit("IF", "BOOL", condition, 0, doubt)
        body.emit("MOVE", result.type, result, if_true)
        end = body.emit("JUMP", "BOOL", 0)
        body.patch(jump)
        body.emit("MOVE", result.type, result, if_false)
        body.patch(end)
        body.emit("SPREAD", "BOOL", result, doubt, 1)
        return result


BUILT_IN = {
    **{name: (1, 1) for name in (*FUNCTIONS, "ABS", "TRUNC")},
    **{name: (2, 2) for name in ("SHL", "SHR", "ROL", "ROR", "EXPT")},
    **{name: (3, 3) for name in ("SEL", "LIMIT")},
    **{name: (2, 16) for name in ("MIN", "MAX")},
    **{name: (0, 0) for name in CLOCKS},
    **{name: (1, 1) for name in ("IS_GOOD", "QUALITY", "TIME_OF", "AS_GOOD")},
}


def one_of(kinds: Sequence[str]) -> str:
    return f"{', '.join(kinds[:-1])} or {kinds[-1]}"


def kind_of(value: Slot | Literal) -> str | None:
    return value.type


def fitted(literal: Literal, kind: str, place: Place) -> bool | int | float:
    """The value of a literal in a type that has it."""
    value = literal.value
    if literal.type is not None and literal.type != kind and not widens(literal.type, kind):
        raise SourceError(place, f"expected {kind}, found {literal.type}")
    if isinstance(value, bool) != (kind == "BOOL") or (
        literal.type is None and kind in ("TIME", "DATE_AND_TIME")
    ):
        hint = "; write T#1.5s" if kind == "TIME" else ""
        raise SourceError(
            place, f"expected {kind}, found {str(value).upper() if isinstance(value, bool) else value}{hint}"
        )
    if kind in REALS:
        if not abs(value) <= (REAL_MAX if kind == "REAL" else 1.7976931348623157e308):
            raise SourceError(place, f"{value} overflows {kind}")
        return float(value)
    if isinstance(value, float):
        raise SourceError(place, f"expected {kind}, found the REAL number {value}")
    low, high = RANGES[kind]
    if not low <= value <= high:
        raise SourceError(place, f"{value} overflows {kind}, which is {low} to {high}")
    return value


def fold_one(expression: Unary, operand: Literal | None) -> Literal | None:
    if operand is None or operand.type in BITS:
        return None
    if expression.operator == "NOT":
        value = not operand.value if operand.type == "BOOL" else None
    else:
        value = -operand.value if operand.type not in ("BOOL", "DATE_AND_TIME") else None
    return None if value is None else checked(expression.place, operand.type, value)


def fold(expression: Binary, left: Literal | None, right: Literal | None) -> Literal | None:
    """Of whole numbers, of BOOL, of times."""
    if left is None or right is None or isinstance(left.value, float) or isinstance(right.value, float):
        return None
    operator = expression.operator
    kind = folded_type(operator, left.type, right.type)
    if kind == "none" or (operator in ("/", "MOD") and right.value == 0):
        return None
    if operator in ("/", "MOD"):
        quotient = abs(left.value) // abs(right.value) * (1 if (left.value < 0) == (right.value < 0) else -1)
        value = quotient if operator == "/" else left.value - quotient * right.value
    else:
        value = FOLDED[operator](left.value, right.value)
    return checked(expression.place, kind, value)


FOLDED: dict[str, Callable[[int, int], int]] = {
    "+": int.__add__,
    "-": int.__sub__,
    "*": int.__mul__,
    "AND": lambda left, right: left and right,
    "OR": lambda left, right: left or right,
    "XOR": lambda left, right: left != right,
    "=": lambda left, right: left == right,
    "<>": lambda left, right: left != right,
    "<": int.__lt__,
    "<=": int.__le__,
    ">": int.__gt__,
    ">=": int.__ge__,
}


def folded_type(operator: str, left: str | None, right: str | None) -> str | None:
    """Of the result; None: a number without a type; "none": this is not folded."""
    numbers = whole(left) and whole(right)
    if operator in COMPARED:
        equal = left == right and left in ("BOOL", "TIME", "DATE_AND_TIME")
        ordered = left != "BOOL" or operator in ("=", "<>")
        return "BOOL" if numbers or (equal and ordered) else "none"
    if operator in ("AND", "OR", "XOR"):
        return "BOOL" if left == right == "BOOL" else "none"
    if operator not in ARITHMETIC:
        return "none"
    if numbers:
        return (common(left, right) or "none") if left and right else left or right
    if operator in ("+", "-") and right == "TIME" and left in ("TIME", "DATE_AND_TIME"):
        return left
    if operator == "-" and left == right == "DATE_AND_TIME":
        return "TIME"
    return "TIME" if operator in ("*", "/") and left == "TIME" and whole(right) else "none"


def whole(kind: str | None) -> bool:
    return kind is None or kind in INTEGERS


def checked(place: Place, kind: str | None, value: float) -> Literal:
    """A folded value; its type must have it, as the type of what is computed while running must."""
    if kind in RANGES and not RANGES[kind][0] <= value <= RANGES[kind][1]:
        raise SourceError(place, f"{value} overflows {kind}")
    return Literal(place, kind, value)


def leaves(statement: Statement, word: str, inside_loops: bool = False) -> bool:
    """Whether the statement holds such a word that leads out of it."""
    match statement:
        case Leave():
            return statement.word == word
        case If():
            parts = [*(body for _, body in statement.branches), statement.otherwise]
        case Case():
            parts = [*(body for _, body in statement.branches), statement.otherwise]
        case For() | While() | Repeat() if inside_loops:
            parts = [statement.body]
        case _:
            return False
    return any(leaves(one, word, inside_loops) for part in parts for one in part)
