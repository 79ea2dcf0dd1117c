# SPDX-License-Identifier: GPL-3.0-or-later
"""Declarations: from types and variables of the text to the machine's variables and their initial values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from openrtu_tools.logic.binary import Point, Slot
from openrtu_tools.logic.errors import Findings, Place, SourceError
from openrtu_tools.logic.layout import (
    ELEMENTS_MAX,
    ArrayOf,
    BlockOf,
    Bounds,
    Characters,
    Enumeration,
    Initials,
    Leaf,
    Stored,
    Structure,
    Type,
    Way,
    blocks_of,
    is_single,
    leaves_of,
    name_of,
    places_on,
    retained_name,
    size_of,
    words_of,
)
from openrtu_tools.logic.routine import Bound, Instance, Instances, Scope
from openrtu_tools.logic.syntax import (
    Choice,
    Declared,
    Expression,
    Filled,
    Initial,
    Listed,
    Literal,
    Spelled,
    Text,
    Unit,
    Variable,
)
from openrtu_tools.logic.texts import OCTETS_MAX, Texts
from openrtu_tools.logic.types import ALIASES, TYPES, pack

STRING_OCTETS = 80  # of a STRING without a length


class Declarations(Texts):
    def __init__(self, units: Sequence[Unit], types: Sequence[Declared], findings: Findings) -> None:
        super().__init__(findings)
        self.declared: dict[str, Declared] = {}
        self.defaults: dict[str, Initials] = {}  # of each type that the text declares
        self.open_types: list[str] = []
        self.open_blocks: list[str] = []
        self.scope = Scope(Unit(Place(1, 1), "TYPE", ""))
        for unit in units:
            there = self.units.get(unit.name)
            if there is not None and there.library:
                findings.error(unit.place, f"{unit.name} is a block of the library; give yours another name")
            elif there is not None:
                findings.error(unit.place, f"{unit.name} is defined twice")
            self.units[unit.name] = unit
        for one in types:
            if one.name in ("STRING", *TYPES, *ALIASES, *self.units, *self.declared):
                findings.error(one.place, f"{one.name} is defined already; give this type another name")
            else:
                self.declared[one.name] = one
        for one in self.declared.values():
            try:
                self.type_named(one.name, one.place)
            except SourceError as error:
                findings.error(error.place, error.text)

    # ---- types -------------------------------------------------------------------------------------

    def type_named(self, name: str, place: Place) -> Type:
        name = ALIASES.get(name, name)
        if name in TYPES:
            return name
        if name in self.types:
            return self.types[name]
        declared = self.declared.get(name)
        if declared is None:
            close = self.meant(name, [*TYPES, *self.declared, *self.units])
            block = self.units.get(name)
            if block is not None and block.kind == "FUNCTION_BLOCK":
                raise SourceError(place, f"an instance of {name} must be a plain variable")
            if name == "WSTRING":
                raise SourceError(place, "there is no WSTRING; STRING has ASCII characters")
            raise SourceError(place, f"unknown type {name}{close}")
        if name in self.open_types:
            raise SourceError(place, f"{name} contains itself")
        self.open_types.append(name)
        try:
            self.types[name] = self.type_of(declared)
        finally:
            self.open_types.pop()
        return self.types[name]

    def type_of(self, declared: Declared) -> Type:
        what = declared.what
        default: Initials = ()
        kind: Type
        if isinstance(what, Spelled):
            kind, default = self.resolved(what)
        elif what and isinstance(what[0], Choice):
            kind = Enumeration(declared.name, self.numbered(what))
            self.types[declared.name] = kind  # its initial value is one of its own
        else:
            kind = self.structure(declared, what)
        self.defaults[declared.name] = before(declared.initial, default)
        self.within(size_of(kind), declared.place)
        self.values_of(kind, self.defaults[declared.name])  # so that mistakes come also where nobody uses it
        return kind

    def numbered(self, choices: Sequence[Choice]) -> dict[str, int]:
        values: dict[str, int] = {}
        following = 0
        for choice in choices:
            number = following if choice.number is None else int(self.constant(choice.number, "DINT"))
            if choice.name in values:
                raise SourceError(choice.place, f"{choice.spelling} is declared twice")
            if number in values.values():
                same = next(name for name, its in values.items() if its == number)
                raise SourceError(choice.place, f"{choice.spelling} is {number}, as {same} is")
            values[choice.name] = number
            following = number + 1
        return values

    def structure(self, declared: Declared, variables: Sequence[Variable]) -> Structure:
        members: dict[str, Type] = {}
        defaults: dict[str, Initials] = {}
        if not variables:
            raise SourceError(declared.place, f"{declared.spelling} has no member")
        for variable in variables:
            if variable.name in members:
                raise SourceError(variable.place, f"{variable.spelling} is declared twice")
            kind, default = self.block_type(variable.type) or self.resolved(variable.type)
            members[variable.name] = kind
            defaults[variable.name] = before(variable.initial, default)
        return Structure(declared.name, members, defaults)

    def block_type(self, spelled: Spelled) -> tuple[Type, Initials] | None:
        """Of a function block; None: it is another type."""
        unit = self.units.get(spelled.name)
        if unit is None or unit.kind != "FUNCTION_BLOCK":
            return None
        bounds = tuple(self.limits(*pair) for pair in spelled.bounds)
        return (ArrayOf(BlockOf(unit.name), bounds) if bounds else BlockOf(unit.name)), ()

    def resolved(self, spelled: Spelled) -> tuple[Type, Initials]:
        """The type, and what its declaration says of initial values."""
        kind = (
            self.characters(spelled)
            if spelled.name == "STRING"
            else self.type_named(spelled.name, spelled.place)
        )
        default = self.defaults.get(spelled.name, ())
        if not spelled.bounds:
            return kind, default
        bounds = tuple(self.limits(*pair) for pair in spelled.bounds)
        if isinstance(kind, ArrayOf):
            if default:
                raise SourceError(
                    spelled.place, f"{spelled.name} has initial values; only a plain variable of it can"
                )
            kind = ArrayOf(kind.element, bounds + kind.bounds, kind.default)
        else:
            kind = ArrayOf(kind, bounds, default)
        self.within(size_of(kind), spelled.place)
        return kind, ()

    def characters(self, spelled: Spelled) -> Characters:
        if spelled.length is None:
            return Characters(STRING_OCTETS)
        octets = int(self.constant(spelled.length, "DINT"))
        if not 1 <= octets <= OCTETS_MAX:
            raise SourceError(
                spelled.length.place, f"a STRING has 1 to {OCTETS_MAX} characters, not {octets}"
            )
        return Characters(octets)

    def limits(self, first: Expression, last: Expression) -> Bounds:
        low, high = int(self.constant(first, "DINT")), int(self.constant(last, "DINT"))
        if low > high:
            raise SourceError(first.place, f"an array from {low} to {high} has no element")
        return low, high

    @staticmethod
    def within(size: int, place: Place) -> None:
        if size > ELEMENTS_MAX:
            raise SourceError(place, f"{size} values are too many; a variable has {ELEMENTS_MAX} at most")

    # ---- initial values ----------------------------------------------------------------------------

    def values_of(self, kind: Type, initials: Initials) -> dict[str, list[int | float]]:
        """Of each leaf, by its path."""
        values: dict[str, list[int | float]] = {path: [0] * leaf.size for path, leaf in leaves_of(kind)}
        self.fill(values, kind, initials, "", 0)
        return values

    def fill(
        self, values: dict[str, list[int | float]], kind: Type, initials: Initials, path: str, at: int
    ) -> None:
        """At: the number of the element among those of the arrays around it."""
        if isinstance(kind, ArrayOf):
            self.fill_array(values, kind, initials, path, at)
        elif isinstance(kind, Structure):
            given = [self.members_of(kind, one) for one in initials]
            for name, member in kind.members.items():
                overriding = tuple(one[name] for one in given if name in one)
                self.fill(values, member, overriding + kind.defaults[name], f"{path}.{name}", at)
        elif isinstance(kind, BlockOf):
            if initials:
                raise SourceError(initials[0].place, f"{kind.name} is a block, and has no initial value")
        elif isinstance(kind, Characters):
            words = words_of(self.initial_text(kind, initials), kind.octets)
            values[path][at * kind.size : (at + 1) * kind.size] = words
        elif initials:
            if isinstance(initials[0], Listed | Filled):
                raise SourceError(initials[0].place, f"expected a value of {name_of(kind)}, not of many")
            values[path][at] = self.constant(initials[0], name_of(kind))
        elif isinstance(kind, Enumeration):
            values[path][at] = next(iter(kind.values.values()))

    def initial_text(self, kind: Characters, initials: Initials) -> str:
        if not initials:
            return ""
        text = initials[0]
        if not isinstance(text, Text):
            raise SourceError(text.place, f"expected a text of {kind.name}: '…'")
        if len(text.text) > kind.octets or not text.text.isascii():
            raise SourceError(text.place, f"{kind.name} has {kind.octets} ASCII characters at most")
        return text.text

    def members_of(self, kind: Structure, initial: Initial) -> dict[str, Initial]:
        if not isinstance(initial, Filled):
            first = next(iter(kind.members))
            raise SourceError(initial.place, f"expected the members of {kind.name}: ({first} := …)")
        given: dict[str, Initial] = {}
        for member, value in initial.members:
            if member.name not in kind.members:
                close = self.meant(member.name, list(kind.members))
                raise SourceError(member.place, f"{kind.name} has no member {member.name}{close}")
            if member.name in given:
                raise SourceError(member.place, f"{member.name} is given twice")
            given[member.name] = value
        return given

    def fill_array(
        self, values: dict[str, list[int | float]], kind: ArrayOf, initials: Initials, path: str, at: int
    ) -> None:
        """Several dimensions as one list, the last index running first; or a list for each of the first."""
        groups: tuple[tuple[int, tuple[Initial, ...]], ...] = ()
        if initials:
            if not isinstance(initials[0], Listed):
                raise SourceError(initials[0].place, f"expected '[' and the values of {kind.name}")
            groups = initials[0].groups
        element: Type = kind.element
        lists = groups and all(isinstance(value, Listed) for _, group in groups for value in group)
        if lists and len(kind.bounds) > 1:
            element = replace(kind, bounds=kind.bounds[1:])
            kind = ArrayOf(kind.element, kind.bounds[:1])
        found = sum(times * len(group) for times, group in groups)
        if found > kind.count:
            raise SourceError(initials[0].place, f"{found} initial values for {kind.count} elements")
        listed = [value for times, group in groups for _ in range(times) for value in group]
        for number in range(kind.count):
            given = (listed[number], *kind.default) if number < len(listed) else kind.default
            self.fill(values, element, given, path, at * kind.count + number)

    # ---- variables ---------------------------------------------------------------------------------

    def scope_of(self, unit: Unit, path: str) -> Scope:
        scope = Scope(unit)
        outer, self.scope = self.scope, scope
        variables = list(unit.variables)
        if unit.result is not None:
            result = Variable(unit.place, unit.name, "VAR_OUTPUT", unit.result, spelling=unit.name)
            variables.insert(0, result)
        for variable in variables:
            try:
                self.declare(scope, variable, path)
            except SourceError as error:
                scope.broken.setdefault(variable.name, error)
                self.findings.error(error.place, error.text)
        if unit.result is not None and unit.name in scope.names:
            scope.names[unit.name].read = True
        self.scope = outer
        return scope

    def declare(self, scope: Scope, variable: Variable, path: str) -> None:
        if variable.name in scope.names:
            raise SourceError(variable.place, f"{variable.spelling} is declared twice")
        if variable.section == "VAR_EXTERNAL" and scope.unit.kind != "PROGRAM":
            raise SourceError(variable.place, "points belong to the PROGRAM; pass them as inputs")
        block = self.units.get(variable.type.name)
        if block is not None and block.kind == "FUNCTION_BLOCK":
            bounds = tuple(self.limits(*pair) for pair in variable.type.bounds)
            if bounds:
                what = self.blocks(scope, variable, block, path, bounds, list(places_on((("", bounds),))))
            else:
                what = self.instance(scope, variable, block, path)
            scope.names[variable.name] = Bound(variable, what)
            return
        kind, default = self.resolved(variable.type)
        if (
            variable.name == scope.unit.name
            and scope.unit.kind == "FUNCTION"
            and not isinstance(kind, str | Enumeration | Characters)
        ):
            raise SourceError(
                variable.place, f"the result of a FUNCTION is one value; return {name_of(kind)} by VAR_OUTPUT"
            )
        if variable.retain and (scope.unit.kind == "FUNCTION" or variable.section == "VAR_TEMP"):
            raise SourceError(variable.place, "a FUNCTION and VAR_TEMP cannot retain a value")
        if variable.constant and variable.initial is None:
            raise SourceError(variable.place, f"the constant {variable.spelling} needs a value")
        values = self.values_of(kind, before(variable.initial, default))
        if variable.constant and is_single(kind):
            value = Literal(variable.place, name_of(kind), values[""][0])
            scope.names[variable.name] = Bound(variable, value)
            return
        if variable.section == "VAR_EXTERNAL":
            self.check_point(variable, kind)
        scope.names[variable.name] = self.stored(variable, kind, values, path)
        for way, block_type in blocks_of(kind):
            self.declare_inner(scope, variable, way, self.units[block_type.name], path)

    def declare_inner(self, scope: Scope, variable: Variable, way: Way, block: Unit, path: str) -> None:
        """A block in a structure is a variable of its own, whose name no text can have: P.T."""
        if variable.section in ("VAR_INPUT", "VAR_OUTPUT", "VAR_IN_OUT"):
            raise SourceError(
                variable.place, f"{variable.spelling} has a {block.name} in it: it must be a plain variable"
            )
        variable = replace(variable, initial=None)
        bounds = tuple(one for _, some in way for one in some)
        name = f"{variable.name}{''.join(member for member, _ in way)}"
        if bounds:
            what = self.blocks(scope, variable, block, path, bounds, list(places_on(way)))
        else:
            what = self.instance(scope, replace(variable, name=name), block, path)
        scope.names[name] = Bound(variable, what, read=True)

    def stored(
        self, variable: Variable, kind: Type, values: dict[str, list[int | float]], path: str
    ) -> Bound:
        """The variable's memory."""
        leaves = dict(leaves_of(kind))
        for name, leaf in leaves.items():
            machine = name_of(leaf.kind)
            for value in values[name]:
                slot = self.program.add(Slot(machine, True))
                leaf.slots.append(slot)
                if value:
                    self.program.initial[slot] = pack(machine, value)
            kept = retained_name(f"{path}{variable.name}{name}", leaf)
            if variable.retain:
                self.program.retained.append((kept, leaf.slots))
            elif self.scope.unit.library and self.scope.unit.name not in ("COMMAND", "REQUEST"):
                self.program.remembered.append((kept, leaf.slots))
        if not is_single(kind):
            return Bound(variable, Stored(kind, leaves))
        bound = Bound(variable, leaves[""].slots[0])
        if variable.section == "VAR_EXTERNAL":
            bound.point = Point(variable.spelling, name_of(kind), leaves[""].slots[0])
            self.program.points.append(bound.point)
        return bound

    @staticmethod
    def check_point(variable: Variable, kind: Type) -> None:
        if not is_single(kind) or variable.initial is not None:
            raise SourceError(
                variable.place,
                f"the point {variable.spelling} cannot be an array, a structure or a STRING, "
                "or have an initial value",
            )
        if isinstance(kind, Enumeration):
            raise SourceError(
                variable.place,
                f"the point {variable.spelling} cannot be a {kind.name}; {kind.name}_TO_DINT(…) is a number",
            )

    def instance(self, scope: Scope, variable: Variable, block: Unit, path: str) -> Instance:
        if variable.initial is not None or variable.constant or variable.section == "VAR_EXTERNAL":
            raise SourceError(variable.place, f"an instance of {block.name} must be a plain variable")
        if scope.unit.kind == "FUNCTION" or variable.section == "VAR_TEMP":
            raise SourceError(
                variable.place, f"{block.name} keeps a state, but a FUNCTION and VAR_TEMP keep none"
            )
        if block is scope.unit or block.name in self.open_blocks:
            raise SourceError(variable.place, f"{block.name} contains itself")
        self.open_blocks.append(block.name)
        first = len(self.program.slots)
        inner = self.scope_of(block, f"{path}{variable.name}.")
        self.open_blocks.pop()
        return Instance(block, inner, self.program.slots[first:])

    def blocks(
        self,
        scope: Scope,
        variable: Variable,
        block: Unit,
        path: str,
        bounds: tuple[Bounds, ...],
        places: list[str],
    ) -> Instances:
        if block.library and block.name in ("COMMAND", "REQUEST"):
            raise SourceError(variable.place, f"a {block.name} has one point; it must be a plain variable")
        kept, remembered = len(self.program.retained), len(self.program.remembered)
        working = self.instance(scope, variable, block, path)
        del self.program.retained[kept:], self.program.remembered[remembered:]
        if not working.slots:
            raise SourceError(variable.place, f"{block.name} has no variables; call one of it")
        self.within(len(places) * len(working.slots), variable.type.place)
        elements = []
        for place in places:
            element = replace(variable, name=f"{variable.name}{place}")
            elements.append(self.instance(scope, element, block, path))
        slots = zip(*(element.slots for element in elements), strict=True)
        leaves = [Leaf(self.kind_of_slot(alike[0]), bounds, slots=list(alike)) for alike in slots]
        return Instances(bounds, places, elements, working, leaves)


def before(initial: Initial | None, default: Initials) -> Initials:
    return default if initial is None else (initial, *default)
