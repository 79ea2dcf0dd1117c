# SPDX-License-Identifier: GPL-3.0-or-later
"""Units and statements: from the tree to instructions, with all checks on the way."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

from openrtu_tools.logic.binary import Command, Point, Program, Request, Routine, Slot, String
from openrtu_tools.logic.debug import debug_of
from openrtu_tools.logic.declare import Declarations
from openrtu_tools.logic.errors import Findings, Place, SourceError
from openrtu_tools.logic.layout import Characters, Enumeration, Stored, is_single, name_of
from openrtu_tools.logic.parser import parse
from openrtu_tools.logic.routine import Body, Bound, Instance, Instances, Loop, Scope, writes
from openrtu_tools.logic.syntax import (
    Argument,
    Assign,
    Call,
    Case,
    Declared,
    Expression,
    For,
    If,
    Leave,
    Literal,
    Name,
    Repeat,
    Statement,
    Text,
    Unit,
    While,
)
from openrtu_tools.logic.types import BITS, INTEGERS
from openrtu_tools.logic.values import BUILT_IN, COPY_MAX, OF_TEXTS, Reference

# The standard's function blocks, and those of docs/blocks.md.
BLOCKS = Path(__file__).with_name("blocks")
# The variables that have their initial values again at each call.
FORGOTTEN = {
    "PROGRAM": ("VAR_TEMP",),
    "FUNCTION_BLOCK": ("VAR_TEMP",),
    "FUNCTION": ("VAR", "VAR_OUTPUT", "VAR_TEMP"),
}
# The variables of the blocks that the machine's host serves, in the order of format.h.
COMMAND_PARTS = ("EXECUTE", "VALUE", "SELECT", "STATE", "RESULT")
REQUEST_PARTS = ("ACTIVE", "VALUE", "REFUSE", "STATE", "RESULT")
MESSAGE_VALUES = 8  # LOGIC_MESSAGE_VALUES
MESSAGE_OCTETS = 111  # MAP_LOG_TEXT_SIZE, without the end


def compile_text(text: str, findings: Findings, name: str = "program") -> Program:
    """Compiles; the program is of use only if the findings have no error."""
    units, types = parse(text, findings)
    return Compiler([*library(), *units], types, findings).program_of(name)


@cache
def library() -> tuple[Unit, ...]:
    """What each program may use without defining it."""
    findings = Findings()
    units = [
        unit
        for file in sorted(BLOCKS.glob("*.st"))
        for unit in parse(file.read_text(encoding="utf-8"), findings)[0]
    ]
    assert not findings.failed, findings.sorted()
    for unit in units:
        unit.library = True
    return tuple(units)


class Compiler(Declarations):
    def __init__(self, units: Sequence[Unit], types: Sequence[Declared], findings: Findings) -> None:
        super().__init__(units, types, findings)
        self.functions: dict[str, tuple[Scope, Routine | None]] = {}

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
            functions = [scope for scope, _ in self.functions.values() if not scope.unit.library]
            self.program.debug = debug_of(scope, functions, own, self.types.values())
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
            elif isinstance(bound.what, Stored):
                own = bound.what.slots
                fresh = [self.program.add(Slot(slot.type, True)) for slot in own]
                for slot, source in zip(fresh, own, strict=True):
                    if source in self.program.initial:
                        self.program.initial[slot] = self.program.initial[source]
                self.body.block(own, fresh[0])

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
            if not isinstance(statement, Assign) or statement.target.path:
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
        target = self.writable(statement.target)
        if is_single(target.type):
            self.store(target, self.value(statement.value, name_of(target.type)))
        elif isinstance(target.type, Characters):
            self.store_text(target, self.text(statement.value))
        else:
            self.copy(target, self.source(statement.value, target.type, statement.value.place))

    def writable(self, target: Name) -> Reference:
        target = self.block_in(target)
        bound = self.bound(target)
        if isinstance(bound.what, Instance | Instances):
            raise SourceError(target.place, f"{target.name} is a block; call it: {target.name}(…)")
        if bound.variable is not self.body.scope.names[target.name].variable:
            raise SourceError(
                target.place, f"only the block itself writes {target.name}.{bound.variable.name}"
            )
        if isinstance(bound.what, Literal) or bound.variable.constant:
            raise SourceError(target.place, f"{bound.variable.spelling} is a constant")
        if bound.variable.section == "VAR_INPUT":
            raise SourceError(
                target.place, f"{bound.variable.spelling} is an input; only the caller writes it"
            )
        bound.written = True
        if bound.point:
            bound.point.written = True
        return self.reference(target)

    def if_(
        self, branches: Sequence[tuple[Expression, Sequence[Statement]]], otherwise: Sequence[Statement]
    ) -> None:
        def conditions() -> Iterator[tuple[Slot, Sequence[Statement]]]:
            for number, (condition, statements) in enumerate(branches):
                folded = self.truth(condition)
                if folded is not None:
                    rest = bool(otherwise) or number + 1 < len(branches)
                    if not folded or rest:
                        what = "the branches after it are" if folded else "this branch is"
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
        if (selector.type or "DINT") not in (*INTEGERS, *BITS, *self.types):
            raise SourceError(
                statement.selector.place, "the selector of CASE must be an integer or an enumeration"
            )
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
        kind = self.types.get(selector.type)
        if isinstance(kind, Enumeration) and not statement.otherwise:
            lacking = [name for name, number in kind.values.items() if number not in taken]
            if lacking:
                self.findings.warn(
                    statement.place, f"this CASE has neither ELSE nor {', '.join(lacking)} of {kind.name}"
                )

    def label(
        self, selector: Slot, low: Expression, high: Expression | None, taken: dict[int, Place]
    ) -> Slot:
        first = int(self.constant(low, selector.type))
        last = int(self.constant(high, selector.type)) if high else first
        if last < first:
            raise SourceError(low.place, f"the range {first}..{last} is empty")
        again = [value for value in taken if first <= value <= last]
        kind = self.types.get(selector.type)
        if isinstance(kind, Enumeration) and high:
            raise SourceError(low.place, f"{kind.name} has no ranges; write its values with ',' between them")
        if again:
            shown = kind.shown(first) if isinstance(kind, Enumeration) else again[0]
            self.findings.warn(low.place, f"{shown} is already a case in line {taken[again[0]].line}")
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
        variable = self.writable(statement.variable).bound.what
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
        named = self.block_in(Name(call.place, call.name, call.path))
        call = replace(call, name=named.name, path=named.path)
        bound = self.body.scope.names.get(call.name)
        if bound is None and call.name == "MESSAGE":
            self.message(call)
            return
        if bound is None and self.is_function(call.name):
            raise SourceError(call.place, f"the result of {call.name} is not used")
        if bound is not None and isinstance(bound.what, Instances):
            self.call_one(call, bound.what)
            return
        bound = self.bound(Name(call.place, call.name))
        if not isinstance(bound.what, Instance) or call.path:
            raise SourceError(call.place, f"{call.name} is not a function block")
        bound.read = True
        instance = bound.what
        arguments = list(call.arguments)
        if instance.unit.name == "COMMAND" and instance.unit.library:
            point = self.served_point(call, instance, arguments)
            self.program.commands.append(Command(point.name, parts_of(instance, COMMAND_PARTS)))
        elif instance.unit.name == "REQUEST" and instance.unit.library:
            point = self.served_point(call, instance, arguments)
            if any(request.name == point.name for request in self.program.requests):
                raise SourceError(call.place, f"{point.name} has two REQUEST; one decides about its commands")
            self.program.requests.append(Request(point.name, parts_of(instance, REQUEST_PARTS)))
        if instance.unit.library and instance.unit.name in ("COMMAND", "REQUEST"):
            arguments = [one for one in arguments if one.name != "POINT"]
        self.work(instance, arguments, call)
        self.fetch(instance.scope, arguments)

    def work(self, instance: Instance, arguments: Sequence[Argument], call: Call) -> None:
        self.hand_over(instance.scope, arguments, call)
        if instance.routine is None:
            instance.routine = self.unit(instance.unit, instance.scope)
        self.body.emit("CALL", "BOOL", instance.routine)

    def call_one(self, call: Call, blocks: Instances) -> None:
        """What a block of an array remembers goes to where it works, and back."""
        found, steps = self.block_at(Name(call.place, call.name, call.path), blocks)
        if steps < len(call.path):
            raise SourceError(call.place, f"{call.name}[…] is a block; call it: {call.name}[…](…)")
        at, working = self.settle(found), blocks.working
        if all(isinstance(index, int) for index in at):
            one = self.chosen_block(blocks, at)
            self.body.block(working.slots, one.slots[0])
            self.work(working, call.arguments, call)
            self.body.block(one.slots, working.slots[0])
        else:
            if len(working.slots) > COPY_MAX:
                raise SourceError(
                    call.place,
                    f"{working.unit.name} has {len(working.slots)} values; with an index that is no constant "
                    f"a block of an array has {COPY_MAX} at most",
                )
            for slot, leaf in zip(working.slots, blocks.leaves, strict=True):
                with self.body.temporaries():
                    self.body.emit("LOAD", slot.type, slot, *self.element(leaf, at))
            self.work(working, call.arguments, call)
            for slot, leaf in zip(working.slots, blocks.leaves, strict=True):
                with self.body.temporaries():
                    self.body.emit("STORE", slot.type, slot, *self.element(leaf, at))
        self.fetch(working.scope, call.arguments)

    def message(self, call: Call) -> None:
        """The machine notes that it was said; the host makes the text, of the values in these variables."""
        text = call.arguments[0].value if call.arguments else None
        given = call.arguments[1:]
        alone = text is not None and not isinstance(text, Text) and not given
        if alone:  # a STRING
            text, given = Text(call.place, "{}"), call.arguments
        expected = SourceError(call.place, "expected MESSAGE('a text with {}', a value for each {})")
        if not isinstance(text, Text) or any(one.name for one in call.arguments):
            raise expected
        places = text.text.count("{}")
        if places != len(given) or places > MESSAGE_VALUES:
            raise SourceError(
                text.place, f"{places} {{}} in the text, {len(given)} values; {MESSAGE_VALUES} at most"
            )
        octets = len(text.text.encode())
        if octets > MESSAGE_OCTETS:
            raise SourceError(
                text.place, f"{octets} octets are too many; a line of the log has {MESSAGE_OCTETS}"
            )
        values: list[Slot | String] = []
        for argument in given:
            value = self.any_value(argument.value)
            if alone and not isinstance(value, String):
                raise expected
            if isinstance(value, Literal) or isinstance(argument.value, Text):
                raise SourceError(argument.place, "a constant can stand in the text itself")
            if value.type == "DATE_AND_TIME":
                raise SourceError(argument.place, "a message has no DATE_AND_TIME; the log has the time")
            values.append(value)
        pieces = text.text.split("{}")
        placed = pieces[0] + "".join(
            self.placed(value) + piece for value, piece in zip(values, pieces[1:], strict=True)
        )
        slots = self.copies(values)
        first = slots[0] if slots else self.body.doubt
        self.body.emit("MESSAGE", "BOOL", placed, first, len(slots))

    def served_point(self, call: Call, instance: Instance, arguments: list[Argument]) -> Point:
        block = instance.unit.name
        points = [one for one in arguments if one.name == "POINT"]
        if len(points) != 1 or not isinstance(points[0].value, Name):
            raise SourceError(call.place, f"{block} needs its point: {block}'s instance(POINT := name, …)")
        point = self.bound(points[0].value)
        if point.point is None:
            raise SourceError(
                points[0].place, f"{points[0].value.name} is not a point; points are in VAR_EXTERNAL"
            )
        point.read = True
        value = instance.scope.names["VALUE"].what
        if any(value in served.slots for served in (*self.program.commands, *self.program.requests)):
            raise SourceError(call.place, f"{call.name} is called twice; an instance of {block} has one call")
        return point.point

    def hand_over(self, scope: Scope, arguments: Sequence[Argument], call: Call) -> None:
        """Values into the inputs. They are all computed before the first is written."""
        inputs = [v for v in scope.unit.variables if v.section in ("VAR_INPUT", "VAR_IN_OUT")]
        given: set[str] = set()
        values: list[tuple[Slot, Slot]] = []
        copies: list[tuple[Reference, Reference]] = []
        texts: list[tuple[Reference, String]] = []
        for number, argument in enumerate(arguments):
            name = argument.name
            if name is None:
                if number >= len(inputs):
                    raise SourceError(argument.place, f"{call.name} has {len(inputs)} inputs")
                name = inputs[number].name
            if name in scope.broken:
                raise scope.broken[name]
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
            if argument.output:
                continue
            if isinstance(target.what, Stored) and isinstance(target.what.type, Characters):
                texts.append((whole(target, argument.place), self.text(argument.value)))
            elif isinstance(target.what, Stored):
                source = self.source(argument.value, target.what.type, argument.place)
                self.settle(source)
                copies.append((whole(target, argument.place), source))
            else:
                values.append((target.what, self.value(argument.value, target.what.type)))
        missing = [
            v.name
            for v in inputs
            if v.name not in given and (scope.unit.kind == "FUNCTION" or v.section == "VAR_IN_OUT")
        ]
        if missing:
            raise SourceError(call.place, f"{call.name} lacks {', '.join(missing)}")
        if len(values) == 1 and not copies and not texts:
            self.move(*values[0])
        else:
            for target, value in values:
                self.body.emit("MOVE", target.type, target, value)
        for target, source in copies:
            self.copy(target, source)
        for target, text in texts:
            self.store_text(target, text)

    def fetch(self, scope: Scope, arguments: Sequence[Argument]) -> None:
        """Outputs, and what the caller lent (VAR_IN_OUT is copied in and out), to the caller's variables."""
        inputs = [v for v in scope.unit.variables if v.section in ("VAR_INPUT", "VAR_IN_OUT")]
        for number, argument in enumerate(arguments):
            source = scope.names[argument.name or inputs[number].name]
            if not argument.output and source.variable.section != "VAR_IN_OUT":
                continue
            if not isinstance(argument.value, Name):
                raise SourceError(argument.place, f"{source.variable.name} needs a variable to write to")
            target, of = self.writable(argument.value), whole(source, argument.place)
            if isinstance(target.type, Characters) and isinstance(of.type, Characters):
                self.store_text(target, self.characters_at(of))
                continue
            if name_of(target.type) != name_of(of.type):
                raise SourceError(
                    argument.place,
                    f"{source.variable.name} is {name_of(of.type)}, the variable {name_of(target.type)}",
                )
            if is_single(target.type):
                self.store(target, source.what)
            else:
                self.copy(target, of)

    def is_function(self, name: str) -> bool:
        unit = self.units.get(name)
        return (
            (unit is not None and unit.kind == "FUNCTION")
            or name in BUILT_IN
            or name in OF_TEXTS
            or "_TO_" in name
        )

    def function(self, unit: Unit, place: Place) -> tuple[Scope, Routine]:
        if unit.name not in self.functions:
            scope = self.scope_of(unit, f"{unit.name}.")
            self.functions[unit.name] = (scope, None)
            self.functions[unit.name] = (scope, self.unit(unit, scope))
        scope, routine = self.functions[unit.name]
        if routine is None:
            raise SourceError(place, f"{unit.name} calls itself")
        return scope, routine

    def call_function(self, call: Call, unit: Unit) -> Slot | String:
        scope, routine = self.function(unit, call.place)
        if unit.name in scope.broken:
            raise scope.broken[unit.name]
        self.hand_over(scope, call.arguments, call)
        result = scope.names[unit.name]
        self.body.emit("CALL", "BOOL", routine)
        self.fetch(scope, call.arguments)
        if isinstance(result.what, Stored):
            return self.copied(self.characters_at(whole(result, call.place)))
        return self.copied(result.what)


def whole(bound: Bound, place: Place) -> Reference:
    return Reference(bound, place, bound.variable.spelling, bound.what.type)


def parts_of(instance: Instance, parts: Sequence[str]) -> list[Slot]:
    return [instance.scope.names[part].what for part in parts]


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
