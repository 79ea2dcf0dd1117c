# SPDX-License-Identifier: GPL-3.0-or-later
"""STRING: a count and the octets behind it, in cells of LINT; its functions of few operations."""

from __future__ import annotations

from collections.abc import Sequence

from openrtu_tools.logic.binary import Slot, String
from openrtu_tools.logic.errors import Place, SourceError
from openrtu_tools.logic.layout import Enumeration, inner, words_of
from openrtu_tools.logic.syntax import Call, Expression, Literal, Text
from openrtu_tools.logic.types import INTEGERS, TYPES
from openrtu_tools.logic.values import Reference, Values

OCTETS_MAX = 255  # LOGIC_STRING_MAX
SHOWN_OCTETS = 24  # the longest text of a number


class Texts(Values):
    def text(self, expression: Expression) -> String:
        value = self.any_value(expression)
        if not isinstance(value, String):
            kind = value.type or "a number"
            how = f"; {kind}_TO_STRING(…) is its text" if value.type else ""
            raise SourceError(expression.place, f"expected STRING, found {kind}{how}")
        return value

    def text_constant(self, text: Text) -> String:
        if not text.text.isascii():
            raise SourceError(text.place, "a STRING has ASCII characters only")
        if len(text.text) > OCTETS_MAX:
            raise SourceError(text.place, f"a STRING has {OCTETS_MAX} characters at most")
        octets = max(1, len(text.text))
        cells = enumerate(words_of(text.text, octets))
        keys = [(f"{text.text!r}[{at}]", bits) for at, bits in cells]  # new ones lie behind each other
        return String([self.program.constants.setdefault(key, Slot("LINT", False)) for key in keys], octets)

    def characters_at(self, reference: Reference) -> String:
        """A variable itself; of an index that is no constant, a copy."""
        leaf, at = reference.bound.what.leaves[reference.path], self.settle(reference)
        if all(isinstance(index, int) for index in at):
            return String(inner(leaf, at), reference.type.octets)
        copy = self.body.text(reference.type.octets)
        for number, slot in enumerate(copy.slots):
            with self.body.temporaries():
                self.body.emit("LOAD", "LINT", slot, *self.element(leaf, [*at, number]))
        return copy

    def store_text(self, reference: Reference, value: String) -> None:
        leaf, at = reference.bound.what.leaves[reference.path], self.settle(reference)
        if all(isinstance(index, int) for index in at):
            self.body.emit("TEXT", "BOOL", String(inner(leaf, at), reference.type.octets), value)
            return
        octets = reference.type.octets
        fitted = String(self.body.text(octets).slots, octets)  # a temporary may have more room
        self.body.emit("TEXT", "BOOL", fitted, value)
        for number, slot in enumerate(fitted.slots):
            with self.body.temporaries():
                self.body.emit("STORE", "LINT", slot, *self.element(leaf, [*at, number]))

    def copied(self, value: Slot | String) -> Slot | String:
        """In a temporary."""
        if isinstance(value, Slot):
            copy = self.body.temporary(value.type)
            self.body.emit("MOVE", copy.type, copy, value)
            return copy
        text = self.body.text(value.octets)
        self.body.emit("TEXT", "BOOL", text, value)
        return text

    # ---- functions ---------------------------------------------------------------------------------

    def text_function(self, call: Call) -> Slot | String:
        arguments = [argument.value for argument in call.arguments]
        first = self.text(arguments[0])
        place = call.place
        match call.name:
            case "LEN":
                return self.counted("LENGTH", first)
            case "FIND":
                return self.counted("FIND", first, self.text(arguments[1]))
            case "CONCAT":
                for argument in arguments[1:]:
                    first = self.together(first, self.text(argument))
                return first
            case "LEFT":
                return self.cut("HEAD", first, self.count_of(arguments[1]))
            case "RIGHT":
                return self.cut("LAST", first, self.count_of(arguments[1]))
            case "INSERT":
                second, at = self.text(arguments[1]), self.count_of(arguments[2])
                left = self.together(self.cut("HEAD", first, at), second)
                return self.together(left, self.cut("TAIL", first, at))
        second = self.text(arguments[1]) if call.name == "REPLACE" else None
        length, before = self.count_of(arguments[-2]), self.before(self.count_of(arguments[-1]), place)
        behind = self.cut("TAIL", first, before)
        if call.name == "MID":
            return self.cut("HEAD", behind, length)
        left = self.cut("HEAD", first, before)
        left = left if second is None else self.together(left, second)
        return self.together(left, self.cut("TAIL", behind, length))

    def count_of(self, expression: Expression) -> Slot:
        value = self.any_value(expression)
        if (value.type or "DINT") not in INTEGERS:
            raise SourceError(expression.place, f"expected a number of characters, found {value.type}")
        return self.become(value, value.type or "DINT", expression.place)

    def before(self, position: Slot, place: Place) -> Slot:
        return self.joined("SUB", "LINT", self.become(position, "LINT", place), self.literal("LINT", 1))

    def counted(self, operation: str, *texts: String) -> Slot:
        result = self.body.temporary("INT")
        self.body.emit(operation, "BOOL", result, *texts)
        return result

    def together(self, first: String, second: String) -> String:
        result = self.body.text(min(OCTETS_MAX, first.octets + second.octets))
        self.body.emit("JOIN", "BOOL", result, first, second)
        return result

    def cut(self, operation: str, text: String, count: Slot) -> String:
        result = self.body.text(text.octets)
        self.body.emit(operation, "BOOL", result, text, count)
        return result

    def text_of_value(self, call: Call, source: str) -> String:
        """As a MESSAGE shows the value."""
        kind = self.types.get(source, source)
        if (source not in TYPES and not isinstance(kind, Enumeration)) or source == "DATE_AND_TIME":
            raise SourceError(call.place, f"{call.name} is not a conversion of the language")
        self.count(call, 1)
        value = self.value(call.arguments[0].value, source)
        longest = max(map(len, kind.values)) if isinstance(kind, Enumeration) else 0
        result = self.body.text(max(SHOWN_OCTETS, longest))
        self.body.emit("FORMAT", "BOOL", result, self.placed(value), value)
        return result

    def placed(self, value: Slot | String) -> str:
        """Where a value stands in a text; logic/message.c reads the names of an enumeration there."""
        if isinstance(value, String):
            return f"\x03{value.octets}\x02"
        kind = self.types.get(value.type)
        if not isinstance(kind, Enumeration):
            return "{}"
        return f"\x01{','.join(f'{number}={name}' for name, number in kind.values.items())}\x02"

    def compared_texts(self, left: String, right: String) -> tuple[Slot, Slot]:
        """What compares as they do."""
        return self.counted("COMPARE", left, right), self.literal("INT", 0)

    def copies(self, values: Sequence[Slot | String | Literal]) -> list[Slot]:
        """Copies of a message's values, one behind the other, which nothing else writes."""
        slots: list[Slot] = []
        for value in values:
            if isinstance(value, String):
                copy = String([self.program.add(Slot("LINT", True)) for _ in value.slots], value.octets)
                self.body.emit("TEXT", "BOOL", copy, value)
                slots += copy.slots
            else:
                slot = self.program.add(Slot(value.type, True))
                self.body.emit("MOVE", slot.type, slot, value)
                slots.append(slot)
        return slots
