# SPDX-License-Identifier: GPL-3.0-or-later
"""Expressions: from the tree to instructions, with all checks of types on the way."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from itertools import product
from typing import TypeGuard

from openrtu_tools.logic.binary import FUNCTIONS, Array, Program, Slot, String
from openrtu_tools.logic.constants import ARITHMETIC, COMPARED, fitted, fold, fold_one
from openrtu_tools.logic.errors import Findings, Place, SourceError
from openrtu_tools.logic.layout import (
    ArrayOf,
    Bounds,
    Characters,
    Enumeration,
    Leaf,
    Stored,
    Structure,
    Type,
    blocks_of,
    inner,
    is_single,
    name_of,
    size_of,
)
from openrtu_tools.logic.routine import Body, Bound, Instance, Instances, Scope
from openrtu_tools.logic.syntax import (
    Binary,
    Call,
    Enumerated,
    Expression,
    Indexed,
    Literal,
    Member,
    Name,
    Text,
    Unary,
    Unit,
)
from openrtu_tools.logic.types import ALIASES, BITS, INTEGERS, NUMBERS, REALS, TYPES, common, pack, widens

CLOCKS = {"UPTIME": "TIME", "SCAN_TIME": "TIME", "NOW": "DATE_AND_TIME"}
LETTER = {"REAL": "R", "LREAL": "D"}
# Functions that are operators; the first ones take many arguments.
OPERATORS = {"ADD": "+", "MUL": "*", "AND": "AND", "OR": "OR", "XOR": "XOR"}
EXTENSIBLE = tuple(OPERATORS)
OPERATORS |= {"SUB": "-", "DIV": "/", "MOD": "MOD"}
OPERATORS |= {"GT": ">", "GE": ">=", "EQ": "=", "LE": "<=", "LT": "<", "NE": "<>"}
BUILT_IN = {
    **{name: (2, 16 if name in EXTENSIBLE else 2) for name in OPERATORS},
    "MOVE": (1, 1),
    **{name: (1, 1) for name in (*FUNCTIONS, "ABS", "TRUNC")},
    **{name: (2, 2) for name in ("SHL", "SHR", "ROL", "ROR", "EXPT")},
    **{name: (3, 3) for name in ("SEL", "LIMIT")},
    **{name: (2, 16) for name in ("MIN", "MAX", "MUX")},
    **{name: (0, 0) for name in CLOCKS},
    **{name: (1, 1) for name in ("IS_GOOD", "QUALITY", "TIME_OF", "AS_GOOD")},
    "DOUBTFUL_AS": (2, 2),
}
OF_TEXTS = {
    "LEN": (1, 1),
    **{name: (2, 2) for name in ("LEFT", "RIGHT", "FIND")},
    "CONCAT": (2, 16),
    **{name: (3, 3) for name in ("MID", "INSERT", "DELETE")},
    "REPLACE": (4, 4),
}


# A copy at an index that is no constant is one of value after value.
COPY_MAX = 256


@dataclass
class Reference:
    """A variable, a member of it, an element: what a name and the path behind it denote."""

    bound: Bound
    place: Place
    shown: str
    type: Type
    path: str = ""  # of the members
    indices: list[tuple[Expression, Bounds]] = field(default_factory=list)
    at: list[int | Slot] | None = None  # the values of the indices, once they are computed


class Values:
    """Expressions: their types, and the instructions that compute them."""

    def __init__(self, findings: Findings) -> None:
        self.findings = findings
        self.program = Program("")
        self.units: dict[str, Unit] = {}
        self.types: dict[str, Type] = {}  # that the text declares
        self.scope: Scope | None = None  # in which constants are looked up
        self.body: Body | None = None

    def call_function(self, call: Call, unit: Unit) -> Slot:
        """A function of the text: its statements are the Compiler's."""
        raise NotImplementedError

    # What Texts does with a STRING.

    def text_constant(self, text: Text) -> String:
        raise NotImplementedError

    def text_function(self, call: Call) -> Slot | String:
        raise NotImplementedError

    def text_of_value(self, call: Call, source: str) -> String:
        raise NotImplementedError

    def characters_at(self, reference: Reference) -> String:
        raise NotImplementedError

    def compared_texts(self, left: String, right: String) -> tuple[Slot, Slot]:
        raise NotImplementedError

    def copied(self, value: Slot | String) -> Slot | String:
        raise NotImplementedError

    # ---- names and values --------------------------------------------------------------------------

    def bound(self, name: Name) -> Bound:
        """The variable of a name; of a block's instance its output."""
        return self.head(name)[0]

    def head(self, name: Name) -> tuple[Bound, tuple[Indexed | Member, ...]]:
        """The variable of a name, and what of the path leads on from there."""
        scope = self.body.scope
        name = self.block_in(name)
        bound = scope.names.get(name.name)
        if bound is None and name.name in scope.broken:
            raise scope.broken[name.name]  # once more: a finding counts once
        if bound is None:
            choices = [*scope.names, *(value for one in self.enumerations for value in one.values)]
            raise SourceError(name.place, f"unknown name {name.name}{self.meant(name.name, choices)}")
        if isinstance(bound.what, Instances):
            return self.output_of_one(name, bound.what)
        if not isinstance(bound.what, Instance) or not name.path:
            return bound, name.path
        step = name.path[0]
        if isinstance(step, Indexed):
            raise SourceError(step.place, f"{name.name} is a block, not an array")
        bound.read = True
        return self.output(name, bound.what, step), name.path[1:]

    def block_in(self, name: Name) -> Name:
        """Of a path into a block of a structure: the block's own name, and the indices on the way."""
        found, indices = name.name, []
        for number, step in enumerate(name.path):
            if isinstance(step, Indexed):
                indices.append(step)
                continue
            found += f".{step.name}"
            if found in self.body.scope.names:
                self.body.scope.names[name.name].read = True
                return Name(name.place, found, (*indices, *name.path[number + 1 :]))
        return name

    def output(self, name: Name, instance: Instance, step: Member) -> Bound:
        inner = instance.scope.names.get(step.name)
        if inner is None or inner.variable.section not in ("VAR_OUTPUT", "VAR_INPUT"):
            outputs = [v.name for v in instance.unit.variables if v.section == "VAR_OUTPUT"]
            raise SourceError(
                step.place, f"{name.name} has no output {step.name}{self.meant(step.name, outputs)}"
            )
        return inner

    def block_at(self, name: Name, blocks: Instances) -> tuple[Reference, int]:
        """Which one of an array of blocks; and how many steps of the path say so."""
        shape = ArrayOf("", blocks.bounds)
        found = Reference(self.body.scope.names[name.name], name.place, name.name, shape)
        steps = 0
        while isinstance(found.type, ArrayOf) and steps < len(name.path):
            step = name.path[steps]
            if not isinstance(step, Indexed):
                break
            self.step_into(found, step)
            steps += 1
        if isinstance(found.type, ArrayOf):
            one = re.sub(r"\[[^]]*]", "[…]", f"{found.bound.variable.name}{blocks.places[0]}")
            raise SourceError(name.place, f"{name.name} is an array of blocks; name one: {one}")
        found.bound.read = True
        return found, steps

    def output_of_one(self, name: Name, blocks: Instances) -> tuple[Bound, tuple[Indexed | Member, ...]]:
        """Of a block of an array. With an index that is no constant, an element of an array of outputs."""
        found, steps = self.block_at(name, blocks)
        step = name.path[steps] if steps < len(name.path) else None
        if not isinstance(step, Member):
            raise SourceError(name.place, f"{name.name}[…] is a block; name one of its outputs")
        if all(self.folded(index) is not None for index, _ in found.indices):
            block = self.chosen_block(blocks, self.settle(found))
            return self.output(name, block, step), name.path[steps + 1 :]
        one = self.output(name, blocks.working, step)
        if not isinstance(one.what, Slot):
            raise SourceError(step.place, f"{step.name} is not one value; it needs a constant as index")
        leaf = blocks.leaves[blocks.working.slots.index(one.what)]
        stored = Stored(ArrayOf(leaf.kind, leaf.bounds), {"": leaf})
        return Bound(one.variable, stored, read=True), (*name.path[:steps], *name.path[steps + 1 :])

    @staticmethod
    def chosen_block(blocks: Instances, at: Sequence[int]) -> Instance:
        shape = blocks.leaves[0]
        steps = zip(at, shape.bounds, shape.steps, strict=True)
        return blocks.elements[sum((index - low) * step for index, (low, _), step in steps)]

    def kind_of_slot(self, slot: Slot) -> str | Enumeration:
        kind = self.types.get(slot.type)
        return kind if is_enumeration(kind) else slot.type

    def reference(self, name: Name) -> Reference:
        name = self.block_in(name)
        bound, path = self.head(name)
        if isinstance(bound.what, Instance):
            raise SourceError(name.place, f"{name.name} is a block; name one of its outputs")
        kind: Type = bound.what.type or ""
        kind = self.types.get(kind, kind) if isinstance(kind, str) else kind
        found = Reference(bound, name.place, bound.variable.spelling, kind)
        for step in path:
            if isinstance(step, Indexed):
                self.step_into(found, step)
                continue
            if not isinstance(found.type, Structure):
                what = "an array; name an element" if isinstance(found.type, ArrayOf) else "no structure"
                raise SourceError(step.place, f"{found.shown} is {what} before .{step.name}")
            if step.name not in found.type.members:
                close = self.meant(step.name, list(found.type.members))
                raise SourceError(step.place, f"{found.type.name} has no member {step.name}{close}")
            found.type = found.type.members[step.name]
            found.path += f".{step.name}"
            found.shown += f".{step.name}"
        return found

    @staticmethod
    def step_into(found: Reference, step: Indexed) -> None:
        if not isinstance(found.type, ArrayOf):
            raise SourceError(step.place, f"{found.shown} is not an array")
        bounds = found.type.bounds
        if len(step.indices) > len(bounds):
            raise SourceError(
                step.place,
                f"{found.shown} has {len(bounds)} dimension{'s' if len(bounds) > 1 else ''}, "
                f"found {len(step.indices)} indices",
            )
        found.indices += zip(step.indices, bounds, strict=False)
        rest = bounds[len(step.indices) :]
        found.type = replace(found.type, bounds=rest) if rest else found.type.element
        found.shown += "[…]"

    @property
    def enumerations(self) -> list[Enumeration]:
        return [kind for name, kind in self.types.items() if is_enumeration(kind) and kind.name == name]

    def enumerated(self, expression: Name | Enumerated) -> Literal | None:
        """A value of an enumeration: MODE#AUTO, or AUTO where only one enumeration has it."""
        if isinstance(expression, Enumerated):
            kind = self.types.get(expression.type)
            if not is_enumeration(kind):
                close = self.meant(expression.type, [*TYPES, *self.types])
                raise SourceError(expression.place, f"{expression.type} is not a type with values{close}")
            if expression.name not in kind.values:
                close = self.meant(expression.name, list(kind.values))
                raise SourceError(expression.place, f"{kind.name} has no value {expression.name}{close}")
            return Literal(expression.place, kind.name, kind.values[expression.name])
        having = [kind for kind in self.enumerations if expression.name in kind.values]
        if len(having) > 1:
            choices = " or ".join(f"{kind.name}#{expression.name}" for kind in having)
            raise SourceError(expression.place, f"{expression.name} is of several types; write {choices}")
        return (
            Literal(expression.place, having[0].name, having[0].values[expression.name]) if having else None
        )

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
            if kind == "STRING":
                raise SourceError(place, f"expected STRING, found {value.value}; write it as '…'")
            return self.literal(kind, fitted(value, kind, place))
        if value.type == kind:
            return value
        if not widens(value.type, kind):
            how = (
                f"; {value.type}_TO_{kind}(…) converts it"
                if value.type not in ("BOOL", "STRING") and kind in NUMBERS + BITS
                else ""
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

    # ---- members and elements ----------------------------------------------------------------------

    def settle(self, reference: Reference) -> list[int | Slot]:
        """Computes the indices, once."""
        if reference.at is None:
            reference.at = [self.settled(index, bounds) for index, bounds in reference.indices]
            varied = [slot for slot in reference.at if isinstance(slot, Slot)]
            if len(varied) > 1 and any(slot.type == "LINT" for slot in varied):
                raise SourceError(  # what is computed of them shall not overflow
                    reference.place, "one of several indices cannot be a LINT; LINT_TO_DINT(…) converts it"
                )
        return reference.at

    def settled(self, index: Expression, bounds: Bounds) -> int | Slot:
        folded = self.folded(index)
        if folded is not None:
            value = int(fitted(folded, "LINT", index.place))
            if not bounds[0] <= value <= bounds[1]:
                raise SourceError(index.place, f"the index {value} is outside of {bounds[0]}..{bounds[1]}")
            return value
        return self.index(index)

    def element(self, leaf: Leaf, at: Sequence[int | Slot]) -> Slot | tuple[Array, Slot]:
        """One of the leaf's variables, or an array and an index, which the machine checks."""
        steps = list(zip(at, leaf.bounds, leaf.steps, strict=True))
        first = sum((index - low) * step for index, (low, _), step in steps if isinstance(index, int))
        varied = [number for number, index in enumerate(at) if isinstance(index, Slot)]
        if not varied:
            return leaf.slots[first]
        begin = varied[0]
        index, (low, high), step = steps[begin]
        if len(varied) == 1:
            return self.array(leaf, first, high - low + 1, step, low), index
        first = sum((index - low) * step for index, (low, _), step in steps[:begin])
        count = step * (high - low + 1)
        return self.array(leaf, first, count, 1, 1), self.computed(steps[begin:])

    def array(self, leaf: Leaf, first: int, count: int, step: int, low: int) -> Array:
        key = (first, count, step, low)
        if key not in leaf.arrays:
            slots = leaf.slots[first : first + count * step : step]
            leaf.arrays[key] = Array(slots, name_of(leaf.kind), low)
            self.program.arrays.append(leaf.arrays[key])
        return leaf.arrays[key]

    def computed(self, steps: Sequence[tuple[int | Slot, Bounds, int]]) -> Slot:
        """
        One index of several, counted from 1.

        Where another than the first is wrong it becomes 0, which is outside as well: one fault.
        """
        first, total, right = 1, None, None
        for number, (index, (low, high), step) in enumerate(steps):
            if isinstance(index, int):
                first += (index - low) * step
                continue
            first -= low * step
            wide = self.converted(index, "LINT")
            if number:
                for pair in ((self.literal("LINT", low), wide), (wide, self.literal("LINT", high))):
                    hit = self.joined("LE", "LINT", *pair, "BOOL")
                    right = hit if right is None else self.joined("AND", "BOOL", right, hit)
            if step > 1:
                wide = self.joined("MUL", "LINT", wide, self.literal("LINT", step))
            total = wide if total is None else self.joined("ADD", "LINT", total, wide)
        if first:
            total = self.joined("ADD", "LINT", total, self.literal("LINT", first))
        return self.joined("MUL", "LINT", total, self.converted(right, "LINT"))

    def joined(self, operation: str, kind: str, left: Slot, right: Slot, result: str | None = None) -> Slot:
        slot = self.body.temporary(result or kind)
        self.body.emit(operation, kind, slot, left, right)
        return slot

    def load(self, reference: Reference) -> Slot | Literal:
        what = reference.bound.what
        if not isinstance(what, Stored):
            return what
        if not is_single(reference.type):
            how = (
                "an array; name an element"
                if isinstance(reference.type, ArrayOf)
                else "a structure; name a member"
            )
            raise SourceError(reference.place, f"{reference.shown} is {how}")
        return self.load_from(what.leaves[reference.path], self.settle(reference))

    def load_from(self, leaf: Leaf, at: Sequence[int | Slot]) -> Slot:
        found = self.element(leaf, at)
        if isinstance(found, Slot):
            return found
        result = self.body.temporary(name_of(leaf.kind))
        self.body.emit("LOAD", result.type, result, *found)
        return result

    def store(self, reference: Reference, value: Slot) -> None:
        """Of the reference's type, which is a single one."""
        what = reference.bound.what
        if isinstance(what, Stored):
            self.store_to(what.leaves[reference.path], self.settle(reference), value)
        else:
            self.move(what, value)

    def store_to(self, leaf: Leaf, at: Sequence[int | Slot], value: Slot) -> None:
        found = self.element(leaf, at)
        if isinstance(found, Slot):
            self.move(found, value)
        else:
            self.body.emit("STORE", value.type, value, *found)

    def source(self, expression: Expression, kind: Type, place: Place) -> Reference:
        """A variable of this structure or array, to be copied."""
        if not isinstance(expression, Name):
            raise SourceError(place, f"expected a variable of {name_of(kind)}")
        found = self.reference(expression)
        if found.type != kind:
            raise SourceError(place, f"expected {name_of(kind)}, found {name_of(found.type) or 'a number'}")
        found.bound.read = True
        return found

    def copy(self, target: Reference, source: Reference) -> None:
        """A structure or an array. At an index that is no constant each of its values is assigned."""
        for _, block in blocks_of(target.type):
            raise SourceError(
                target.place, f"{target.shown} has a {block.name} in it; copy its other members one by one"
            )
        to, of = self.settle(target), self.settle(source)
        pairs = list(
            zip(target.bound.what.below(target.path), source.bound.what.below(source.path), strict=True)
        )
        if all(isinstance(index, int) for index in (*to, *of)):
            self.copy_runs([(inner(leaf, to), inner(other, of)) for leaf, other in pairs])
            return
        if size_of(target.type) > COPY_MAX:
            raise SourceError(
                target.place, f"{size_of(target.type)} values are too many for a copy; copy them in a loop"
            )
        for leaf, other in pairs:
            tails = list(product(*(range(low, high + 1) for low, high in leaf.bounds[len(to) :])))
            for tail in tails:
                with self.body.temporaries():
                    self.store_to(leaf, [*to, *tail], self.load_from(other, [*of, *tail]))

    def copy_runs(self, runs: Sequence[tuple[list[Slot], list[Slot]]]) -> None:
        """Leaves that lie behind each other at once."""
        whole_target: list[Slot] = []
        whole_source: list[Slot] = []
        for target, source in runs:
            if whole_target and not (follows(whole_target, target) and follows(whole_source, source)):
                self.body.block(whole_target, whole_source[0])
                whole_target, whole_source = [], []
            whole_target, whole_source = whole_target + target, whole_source + source
        self.body.block(whole_target, whole_source[0])

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

    # ---- expressions -------------------------------------------------------------------------------

    def any_value(self, expression: Expression, wanted: str | None = None) -> Slot | Literal:
        """wanted: what SEL, MIN, MAX and LIMIT make of numbers alone, which have no type of their own."""
        match expression:
            case Literal():
                return expression
            case Name():
                return self.name(expression)
            case Enumerated():
                return self.enumerated(expression)
            case Text():
                return self.text_constant(expression)
            case Unary():
                return self.unary(expression)
            case Binary():
                return self.binary(expression)
            case Call():
                return self.call(expression, wanted)

    def name(self, name: Name) -> Slot | Literal:
        if not name.path and name.name not in self.body.scope.names:
            value = self.enumerated(name)
            if value is not None:
                return value
        reference = self.reference(name)
        reference.bound.read = True
        if isinstance(reference.type, Characters):
            return self.characters_at(reference)
        return self.load(reference)

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
        if (left.type == "BOOL" or left.type in self.types) and operator not in ("=", "<>"):
            raise SourceError(place, f"{operator} needs numbers, found {left.type}")
        if isinstance(left, String):
            left, right = self.compared_texts(left, right)
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
            case Name(path=()):
                bound = self.scope.names.get(expression.name)
                if bound is None:
                    return self.enumerated(expression)
                if isinstance(bound.what, Literal):
                    bound.read = True
                    return bound.what
                return None
            case Enumerated():
                return self.enumerated(expression)
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
        if call.name == "DOUBTFUL_AS":
            return self.doubtful(call)
        if call.name in ("IS_GOOD", "QUALITY", "TIME_OF", "AS_GOOD"):
            return self.attribute(call)
        source, separator, target = call.name.partition("_TO_")
        if separator:
            return self.conversion(call, ALIASES.get(source, source), ALIASES.get(target, target))
        if call.name in OF_TEXTS:
            self.count(call, *OF_TEXTS[call.name])
            return self.text_function(call)
        if call.name not in BUILT_IN:
            names = [
                *BUILT_IN,
                *OF_TEXTS,
                *(name for name, unit in self.units.items() if unit.kind == "FUNCTION"),
            ]
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
        if isinstance(value, String) and call.name == "AS_GOOD":
            text = self.copied(value)
            self.body.emit("AS_GOOD", "LINT", flagged(text), flagged(text))
            return text
        value = flagged(value)
        kind = {"IS_GOOD": "BOOL", "QUALITY": "BYTE"}.get(call.name, value.type)
        result = self.body.temporary(kind)
        operation = {"IS_GOOD": "GOOD", "QUALITY": "QUALITY", "AS_GOOD": "AS_GOOD"}[call.name]
        self.body.emit(operation, kind if operation == "AS_GOOD" else "BOOL", result, value)
        return result

    def doubtful(self, call: Call) -> Slot:
        """The value of the first, with the flags of both."""
        self.count(call, 2)
        first, second = (argument.value for argument in call.arguments)
        value, other = self.any_value(first), self.any_value(second)
        if isinstance(value, Literal) or isinstance(other, Literal):
            raise SourceError(call.place, "DOUBTFUL_AS needs two values that can be doubtful, not a constant")
        result = self.copied(value)
        self.body.emit("SPREAD", "BOOL", flagged(result), flagged(other), 1)
        return result

    def conversion(self, call: Call, source: str, target: str) -> Slot:
        """By value, rounded; bits keep their low ones; TIME is counted in milliseconds."""
        if target == "STRING":
            return self.text_of_value(call, source)
        if is_enumeration(self.types.get(source)) and target in INTEGERS:
            self.count(call, 1)
            return self.converted(self.value(call.arguments[0].value, source), target)
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
        if call.name in OPERATORS or call.name == "MOVE":
            first, *others = (argument.value for argument in call.arguments)
            for other in others:
                first = Binary(place, OPERATORS[call.name], first, other)
            return self.any_value(first, wanted)
        if call.name in ("SEL", "MIN", "MAX", "LIMIT"):
            return self.choice(call, wanted)
        if call.name == "MUX":
            return self.multiplexed(call, wanted)
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

    def multiplexed(self, call: Call, wanted: str | None) -> Slot:
        """One of many, counted from 0, with the flags of that one and of the number."""
        given = [self.any_value(one.value, wanted) for one in call.arguments[1:]]
        values = self.alike(given, call.place, wanted)
        kind = values[0].type
        if kind == "STRING":
            raise SourceError(call.place, "MUX has no STRING; an array of them has")
        slots = [self.program.add(Slot(kind, True)) for _ in values]
        for slot, value in zip(slots, values, strict=True):
            self.body.emit("MOVE", kind, slot, value)
        array = Array(slots, kind, 0)
        self.program.arrays.append(array)
        result = self.body.temporary(kind)
        self.body.emit("LOAD", kind, result, array, self.index(call.arguments[0].value))
        return result

    def extreme(self, which: str, values: Sequence[Slot], place: Place) -> Slot:
        result = values[0]
        for value in values[1:]:
            smaller = self.compared("<", result, value, place)
            best = self.chosen(smaller, *((result, value) if which == "MIN" else (value, result)))
            for operand in (result, value):
                self.body.emit("SPREAD", "BOOL", flagged(best), flagged(operand), 1)
            result = best
        return result

    def chosen(self, condition: Slot, if_true: Slot, if_false: Slot) -> Slot:
        """One of two values, with its own quality and that of the condition."""
        body = self.body
        doubt = body.temporary("BOOL")
        if isinstance(if_true, String):
            operation, kind, result = "TEXT", "BOOL", body.text(max(if_true.octets, if_false.octets))
        else:
            operation, kind, result = "MOVE", if_true.type, body.temporary(if_true.type)
        jump = body.emit("IF", "BOOL", condition, 0, doubt)
        body.emit(operation, kind, result, if_true)
        end = body.emit("JUMP", "BOOL", 0)
        body.patch(jump)
        body.emit(operation, kind, result, if_false)
        body.patch(end)
        body.emit("SPREAD", "BOOL", flagged(result), doubt, 1)
        return result


def is_enumeration(kind: Type | None) -> TypeGuard[Enumeration]:
    return isinstance(kind, Enumeration)


def flagged(value: Slot | String) -> Slot:
    """What has the value's quality."""
    return value.slots[0] if isinstance(value, String) else value


def follows(before: Sequence[Slot], after: Sequence[Slot]) -> bool:
    return before[-1].number + 1 == after[0].number


def one_of(kinds: Sequence[str]) -> str:
    return f"{', '.join(kinds[:-1])} or {kinds[-1]}"


def kind_of(value: Slot | Literal) -> str | None:
    return value.type
