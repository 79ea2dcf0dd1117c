# SPDX-License-Identifier: GPL-3.0-or-later
"""What has a value without running, and the types of such values."""

from __future__ import annotations

from collections.abc import Callable

from openrtu_tools.logic.errors import Place, SourceError
from openrtu_tools.logic.syntax import (
    Binary,
    Literal,
    Unary,
)
from openrtu_tools.logic.types import BITS, INTEGERS, NUMBERS, RANGES, REAL_MAX, REALS, TYPES, common, widens

ARITHMETIC = {"+": "ADD", "-": "SUB", "*": "MUL", "/": "DIV", "MOD": "MOD"}
COMPARED = {
    "=": ("EQ", False),
    "<>": ("NE", False),
    "<": ("LT", False),
    "<=": ("LE", False),
    ">": ("LT", True),
    ">=": ("LE", True),
}


def fitted(literal: Literal, kind: str, place: Place) -> bool | int | float:
    """The value of a literal in a type that has it."""
    value = literal.value
    if literal.type is not None and literal.type != kind and not widens(literal.type, kind):
        raise SourceError(place, f"expected {kind}, found {literal.type}")
    if kind not in TYPES:
        if literal.type is None:
            raise SourceError(
                place, f"expected {kind}, found {value}; write {kind}#… with a name of its values"
            )
        return value
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
        value = -operand.value if operand.type in (None, "TIME", *NUMBERS) else None
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
