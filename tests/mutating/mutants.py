# SPDX-License-Identifier: GPL-3.0-or-later
"""Small faults in C, by the syntax tree that clang gives: where each is, and what stands there instead.

All mutants of a build are in it at once, and each asks whether it is on (mutant.h): a room is compiled once
for some hundred of them. So two must not overlap, and none may stand where C wants a constant.
"""

from __future__ import annotations

import random
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from clang.cindex import Cursor, CursorKind, Index, StorageClass, TranslationUnit, TypeKind

SWAPPED = {
    b"<": b"<=",
    b"<=": b"<",
    b">": b">=",
    b">=": b">",
    b"==": b"!=",
    b"!=": b"==",
    b"&&": b"||",
    b"||": b"&&",
    b"+": b"-",
    b"-": b"+",
    b"*": b"+",
    b"/": b"*",
    b"%": b"/",
    b"&": b"|",
    b"|": b"&",
    b"^": b"&",
    b"<<": b">>",
    b">>": b"<<",
}
ASSIGNED = {b"+=": b"-=", b"-=": b"+=", b"|=": b"&=", b"&=": b"|=", b"<<=": b">>=", b">>=": b"<<="}
# What is a statement may be left out.
LEFT_OUT = {
    CursorKind.CALL_EXPR,
    CursorKind.BINARY_OPERATOR,
    CursorKind.COMPOUND_ASSIGNMENT_OPERATOR,
    CursorKind.UNARY_OPERATOR,
}
BODIES = {
    CursorKind.COMPOUND_STMT,
    CursorKind.IF_STMT,
    CursorKind.WHILE_STMT,
    CursorKind.FOR_STMT,
    CursorKind.DO_STMT,
    CursorKind.CASE_STMT,
    CursorKind.DEFAULT_STMT,
}
SIZEOF = CursorKind.CXX_UNARY_EXPR  # clang's index calls sizeof and alignof so
POINTERS = {TypeKind.POINTER, TypeKind.CONSTANTARRAY, TypeKind.INCOMPLETEARRAY, TypeKind.VARIABLEARRAY}


@dataclass(frozen=True, order=True)
class Mutant:
    """`text` replaces the octets from start to end; a NUL in it stands for the question whether it is on."""

    file: Path
    start: int
    end: int
    line: int
    what: str
    text: bytes


def mutants_of(file: Path, arguments: list[str]) -> list[Mutant]:
    """All mutants of the functions that `file` defines, compiled with these arguments."""
    unit = Index.create().parse(
        str(file), args=arguments, options=TranslationUnit.PARSE_DETAILED_PROCESSING_RECORD
    )
    return sorted(set(_File(file, unit).mutants()))


def choose(mutants: list[Mutant], count: int, seed: int) -> list[Mutant]:
    """At most `count` of them, none within another. The seed decides which."""
    taken: list[Mutant] = []
    by_file: dict[Path, list[Mutant]] = {}
    for mutant in random.Random(seed).sample(mutants, len(mutants)):
        others = by_file.setdefault(mutant.file, [])
        if len(taken) < count and all(mutant.end <= o.start or o.end <= mutant.start for o in others):
            others.append(mutant)
            taken.append(mutant)
    return sorted(taken)


def written(source: bytes, mutants: dict[int, Mutant]) -> bytes:
    """The source with these mutants in it, each by its number."""
    for number, mutant in sorted(mutants.items(), key=lambda item: -item[1].start):
        text = mutant.text.replace(b"\0", b"mutant(%d)" % number)
        source = source[: mutant.start] + text + source[mutant.end :]
    return source


class _File:
    def __init__(self, file: Path, unit: TranslationUnit) -> None:
        self.file = file
        self.unit = unit
        self.source = file.read_bytes()
        self.macros = [
            (cursor.extent.start.offset, cursor.extent.end.offset)
            for cursor in unit.cursor.get_children()
            if cursor.kind is CursorKind.MACRO_INSTANTIATION and self._here(cursor)
        ]

    def mutants(self) -> Iterator[Mutant]:
        for cursor in self.unit.cursor.get_children():
            if cursor.kind is CursorKind.FUNCTION_DECL and self._here(cursor):
                for child in cursor.get_children():
                    if child.kind is CursorKind.COMPOUND_STMT:
                        yield from self._within(child)

    def _here(self, cursor: Cursor) -> bool:
        return cursor.location.file is not None and Path(cursor.location.file.name) == self.file

    def _within(self, cursor: Cursor) -> Iterator[Mutant]:
        children = list(cursor.get_children())
        if cursor.kind is CursorKind.DECL_STMT:
            for variable in children:
                if variable.kind is CursorKind.VAR_DECL and variable.storage_class is not StorageClass.STATIC:
                    yield from self._initialiser(variable)
            return
        if cursor.kind is SIZEOF or (cursor.kind.is_declaration() and cursor.kind is not CursorKind.VAR_DECL):
            return
        if cursor.kind is CursorKind.CASE_STMT:
            children = children[1:]
        yield from self._at(cursor)
        for place, child in enumerate(children):
            if cursor.kind in BODIES and child.kind in LEFT_OUT and self._is_statement(cursor, place, child):
                yield from self._left_out(child)
            yield from self._within(child)

    def _initialiser(self, variable: Cursor) -> Iterator[Mutant]:
        """A size in its type is a constant. What stands behind the = is none, but a list has designators."""
        text = self._text(variable)
        equals = re.search(rb"(?<![=!<>])=(?!=)", text)
        if equals is None:
            return
        begin = variable.extent.start.offset + equals.end()
        for child in variable.get_children():
            if child.extent.start.offset >= begin and child.kind is not CursorKind.INIT_LIST_EXPR:
                yield from self._within(child)

    def _at(self, cursor: Cursor) -> Iterator[Mutant]:
        if cursor.kind is CursorKind.BINARY_OPERATOR:
            yield from self._swapped(cursor)
        elif cursor.kind is CursorKind.COMPOUND_ASSIGNMENT_OPERATOR:
            yield from self._swapped_assignment(cursor)
        elif cursor.kind is CursorKind.UNARY_OPERATOR and self._text(cursor).startswith(b"!"):
            yield from self._mutant(
                cursor, "! left out", b"(\0 ? !!(%s) : (%s))" % (self._text(cursor)[1:], self._text(cursor))
            )
        elif cursor.kind is CursorKind.INTEGER_LITERAL:
            text = self._text(cursor)
            yield from self._mutant(
                cursor, f"{text.decode()} one more", b"(\0 ? (%s) + 1 : (%s))" % (text, text)
            )
        elif cursor.kind is CursorKind.RETURN_STMT:
            yield from self._returned(cursor)

    def _swapped(self, cursor: Cursor) -> Iterator[Mutant]:
        found = self._operator(cursor)
        if found is None or found[1] not in SWAPPED:
            return
        left, operator, right = found
        pointers = [child.type.get_canonical().kind in POINTERS for child in cursor.get_children()]
        if operator in (b"+", b"-") and (pointers[1] or not all(k in b"+-" for k in operator)):
            return
        other = SWAPPED[operator]
        yield from self._mutant(
            cursor,
            f"{operator.decode()} to {other.decode()}",
            b"(\0 ? (%s) %s (%s) : (%s%s%s))" % (left, other, right, left, operator, right),
        )

    def _swapped_assignment(self, cursor: Cursor) -> Iterator[Mutant]:
        found = self._operator(cursor)
        if found is None or found[1] not in ASSIGNED:
            return
        left, operator, right = found
        other = ASSIGNED[operator]
        yield from self._mutant(
            cursor,
            f"{operator.decode()} to {other.decode()}",
            b"(\0 ? (%s %s %s) : (%s %s %s))" % (left, other, right, left, operator, right),
        )

    def _returned(self, cursor: Cursor) -> Iterator[Mutant]:
        """What a function says, it says not: its truth, or 0."""
        values = list(cursor.get_children())
        if not values or values[0].kind is CursorKind.INTEGER_LITERAL:
            return
        kind = values[0].type.get_canonical().kind
        text = self._text(values[0])
        if kind is TypeKind.BOOL or text in (b"true", b"false"):
            yield from self._mutant(
                values[0], "returned as its contrary", b"(\0 ? !(%s) : (%s))" % (text, text), macros=True
            )
        elif kind in (
            TypeKind.INT,
            TypeKind.UINT,
            TypeKind.LONG,
            TypeKind.ULONG,
            TypeKind.USHORT,
            TypeKind.UCHAR,
        ):
            yield from self._mutant(values[0], "returned as 0", b"(\0 ? 0 : (%s))" % text)

    def _is_statement(self, parent: Cursor, place: int, child: Cursor) -> bool:
        """Not a condition, nor a part of a for's head: its semicolon follows, and no parenthesis is open."""
        if parent.kind is CursorKind.COMPOUND_STMT:
            return True
        behind = self.source[child.extent.end.offset :].lstrip()[:1]
        if parent.kind in (CursorKind.IF_STMT, CursorKind.WHILE_STMT):
            return place > 0 and behind == b";"
        if parent.kind is CursorKind.FOR_STMT:
            return child == list(parent.get_children())[-1] and behind == b";"
        return parent.kind in (CursorKind.CASE_STMT, CursorKind.DEFAULT_STMT) and behind == b";"

    def _left_out(self, cursor: Cursor) -> Iterator[Mutant]:
        text = self._text(cursor)
        semicolon = self.source.find(b";", cursor.extent.end.offset)
        if text.startswith(b"assert") or self.source[cursor.extent.end.offset : semicolon].strip():
            return
        if self._in_macro(cursor.extent.start.offset, cursor.extent.end.offset):
            return
        line = cursor.extent.start.line
        what = f"left out: {' '.join(text.decode(errors='replace').split())[:60]}"
        replaced = b"{ if (!\0) { %s; } }" % text
        yield Mutant(self.file, cursor.extent.start.offset, semicolon + 1, line, what, replaced)

    def _operator(self, cursor: Cursor) -> tuple[bytes, bytes, bytes] | None:
        children = list(cursor.get_children())
        if len(children) != 2:
            return None
        left, right = children
        between = self.source[left.extent.end.offset : right.extent.start.offset]
        # A parenthesis or a macro between them says that the extents are not what they seem.
        operator = between.strip()
        return (
            (self._text(left), operator, self._text(right))
            if re.fullmatch(rb"[-+*/%&|^<>=!]+", operator)
            else None
        )

    def _mutant(self, cursor: Cursor, what: str, text: bytes, *, macros: bool = False) -> Iterator[Mutant]:
        start, end = cursor.extent.start.offset, cursor.extent.end.offset
        if start < end and (macros or not self._in_macro(start, end)):
            yield Mutant(self.file, start, end, cursor.extent.start.line, what, text)

    def _in_macro(self, start: int, end: int) -> bool:
        """Within one's arguments, which may be used twice or as a string. One within the range may be."""
        return any(begin <= start and end <= stop for begin, stop in self.macros)

    def _text(self, cursor: Cursor) -> bytes:
        return self.source[cursor.extent.start.offset : cursor.extent.end.offset]
