# SPDX-License-Identifier: GPL-3.0-or-later
"""
Random programs of Structured Text, each as text and as a tree; and a slow interpreter of the tree.

It shares no code with the compiler or the machine: values and qualities follow docs/logic.md.
"""

from __future__ import annotations

import math
import random
import struct
from dataclasses import dataclass, field

INVALID, OVERFLOW = 0x80, 0x01
RANGES = {"INT": (-32768, 32767), "DINT": (-(1 << 31), (1 << 31) - 1), "WORD": (0, 65535)}
INPUTS = {"b_in": "BOOL", "i_in": "INT", "d_in": "DINT", "x_in": "LREAL", "r_in": "REAL"}
OUTPUTS = {
    "b_out": "BOOL",
    "i_out": "INT",
    "d_out": "DINT",
    "x_out": "LREAL",
    "r_out": "REAL",
    "w_out": "WORD",
}
LOW, HIGH = -2, 5  # of the array
Tagged = tuple  # value, quality


class Leave(Exception):
    """EXIT or CONTINUE on its way."""


@dataclass
class Random:
    """A program: its tree, and what the tree is as text."""

    random: random.Random
    loops: int = 0
    depth: int = 0
    used: list[str] = field(default_factory=list)

    def expression(self, kind: str, depth: int = 0) -> tuple:
        pick = self.random.choice
        names = [name for name, its in (INPUTS | OUTPUTS).items() if its == kind]
        if depth > 3 or self.random.random() < 0.25:
            if kind == "INT" and self.random.random() < 0.3:
                return ("element", self.expression("INT", depth + 2))
            return (
                ("name", pick(names), kind)
                if self.random.random() < 0.7
                else ("literal", kind, self.literal(kind))
            )
        if kind == "BOOL":
            which = self.random.random()
            if which < 0.5:
                of = pick(["INT", "DINT", "LREAL", "REAL"])
                operators = ["<", ">", "<=", ">="] + (["=", "<>"] if of in RANGES else [])
                return (
                    "binary",
                    pick(operators),
                    of,
                    self.expression(of, depth + 1),
                    self.expression(of, depth + 1),
                )
            if which < 0.6:
                return ("good", pick(list(INPUTS)))
            if which < 0.7:
                return ("unary", "NOT", kind, self.expression(kind, depth + 1))
            return (
                "binary",
                pick(["AND", "OR", "XOR"]),
                kind,
                *(self.expression(kind, depth + 1) for _ in "ab"),
            )
        if self.random.random() < 0.15:
            return (
                "choose",
                self.expression("BOOL", depth + 1),
                *(self.expression(kind, depth + 1) for _ in "ab"),
            )
        if kind == "WORD":
            if self.random.random() < 0.2:
                return ("unary", "NOT", kind, self.expression(kind, depth + 1))
            return (
                "binary",
                pick(["AND", "OR", "XOR"]),
                kind,
                *(self.expression(kind, depth + 1) for _ in "ab"),
            )
        if self.random.random() < 0.2:
            source = {"INT": "LREAL", "DINT": "INT", "LREAL": "DINT", "REAL": "INT"}[kind]
            return ("convert", source, kind, self.expression(source, depth + 1))
        if self.random.random() < 0.15:
            return ("unary", pick(["-", "ABS"]), kind, self.expression(kind, depth + 1))
        operators = ["+", "-", "*", "/"] + (["MOD"] if kind in RANGES else [])
        return (
            "binary",
            pick(operators),
            kind,
            self.expression(kind, depth + 1),
            self.expression(kind, depth + 1),
        )

    def literal(self, kind: str) -> bool | int | float:
        if kind == "BOOL":
            return self.random.random() < 0.5
        if kind in RANGES:
            return self.random.choice([0, 1, 2, 7, 100, RANGES[kind][1]])
        return self.random.choice([0.0, 0.5, 3.25, 1e3, 0.0001])

    def block(self, size: int) -> list[tuple]:
        return [self.statement() for _ in range(self.random.randint(1, size))]

    def statement(self) -> tuple:
        which = self.random.random()
        self.depth += 1
        try:
            if self.depth < 4 and which < 0.2:
                branches = [
                    (self.expression("BOOL"), self.block(2)) for _ in range(self.random.randint(1, 2))
                ]
                return ("if", branches, self.block(2) if self.random.random() < 0.5 else [])
            if self.depth < 4 and which < 0.3:
                labels = self.random.sample(range(-3, 8), 4)
                branches = [(labels[:2], self.block(2)), (labels[2:], self.block(2))]
                return (
                    "case",
                    self.expression("INT"),
                    branches,
                    self.block(1) if self.random.random() < 0.5 else [],
                )
            if self.depth < 4 and which < 0.42:
                self.loops += 1
                name = f"n{self.depth}"
                loop = (
                    "for",
                    name,
                    self.random.randint(-2, 2),
                    self.expression_small(),
                    self.random.choice([1, 2]),
                    self.block(3),
                )
                self.loops -= 1
                return loop
            if self.loops and which < 0.5:
                return (
                    "if",
                    [(self.expression("BOOL"), [("leave", self.random.choice(["EXIT", "CONTINUE"]))])],
                    [],
                )
            if which < 0.6:
                return ("store", self.expression("INT", 2), self.expression("INT"))
            name = self.random.choice(list(OUTPUTS))
            return ("assign", name, self.expression(OUTPUTS[name]))
        finally:
            self.depth -= 1

    def expression_small(self) -> tuple:
        """The end of a loop: not far away, sometimes of doubtful quality."""
        return ("binary", "MOD", "INT", self.expression("INT", 2), ("literal", "INT", 7))


def shown(node: tuple) -> str:
    match node:
        case ("name", name, _):
            return name
        case ("literal", kind, value):
            return str(value).upper() if kind == "BOOL" else f"{kind}#{value}"
        case ("element", index):
            return f"a[{shown(index)}]"
        case ("good", name):
            return f"IS_GOOD({name})"
        case ("unary", "ABS", _, operand):
            return f"ABS({shown(operand)})"
        case ("unary", operator, _, operand):
            return f"({operator} ({shown(operand)}))"
        case ("binary", operator, _, left, right):
            return f"({shown(left)} {operator} {shown(right)})"
        case ("choose", condition, yes, no):
            return f"SEL({shown(condition)}, {shown(no)}, {shown(yes)})"
        case ("convert", source, target, operand):
            return f"{source}_TO_{target}({shown(operand)})"
    raise ValueError(node)


def lines(statements: list[tuple]) -> list[str]:
    found = []
    for statement in statements:
        match statement:
            case ("assign", name, value):
                found.append(f"{name} := {shown(value)};")
            case ("store", index, value):
                found.append(f"a[{shown(index)}] := {shown(value)};")
            case ("leave", word):
                found.append(f"{word};")
            case ("if", branches, otherwise):
                for number, (condition, body) in enumerate(branches):
                    found += [f"{'ELSIF' if number else 'IF'} {shown(condition)} THEN", *lines(body)]
                found += [*(["ELSE", *lines(otherwise)] if otherwise else []), "END_IF;"]
            case ("case", selector, branches, otherwise):
                found.append(f"CASE {shown(selector)} OF")
                for labels, body in branches:
                    found += [f"{', '.join(map(str, labels))}:", *lines(body)]
                found += [*(["ELSE", *lines(otherwise)] if otherwise else []), "END_CASE;"]
            case ("for", name, first, last, step, body):
                found += [f"FOR {name} := {first} TO {shown(last)} BY {step} DO", *lines(body), "END_FOR;"]
    return found


def text_of(statements: list[tuple]) -> str:
    points = "; ".join(f"{name} : {kind}" for name, kind in (INPUTS | OUTPUTS).items())
    return "\n".join(
        [
            f"PROGRAM random\nVAR_EXTERNAL {points}; END_VAR",
            f"VAR a : ARRAY[{LOW}..{HIGH}] OF INT; n1, n2, n3 : INT; END_VAR",
            *[f"{name} := {name};" for name in OUTPUTS],  # so all of them are outputs
            *lines(statements),
            "END_PROGRAM",
        ]
    )


def written(statements: list[tuple]) -> set[str]:
    found: set[str] = set()
    for statement in statements:
        match statement:
            case ("assign", name, _):
                found.add(name)
            case ("store", _, _):
                found.add("a")
            case ("if", branches, otherwise) | ("case", _, branches, otherwise):
                found |= written(otherwise).union(*(written(body) for _, body in branches))
            case ("for", name, _, _, _, body):
                found |= {name} | written(body)
    return found


def decides(statements: list[tuple]) -> bool:
    """Whether the statements may leave the loop that they are in."""
    for statement in statements:
        match statement:
            case ("leave", _):
                return True
            case ("if", branches, otherwise) | ("case", _, branches, otherwise):
                if decides(otherwise) or any(decides(body) for _, body in branches):
                    return True
    return False


def single(value: float) -> float:
    try:
        return struct.unpack("f", struct.pack("f", value))[0]
    except OverflowError:
        return math.inf


class Reference:
    def __init__(self) -> None:
        self.values: dict[str, Tagged] = {name: (zero(kind), 0) for name, kind in OUTPUTS.items()}
        self.values |= {name: (0, 0) for name in ("n1", "n2", "n3")}
        self.array: list[Tagged] = [(0, 0)] * (HIGH - LOW + 1)
        self.faults = 0
        self.doubts: list[int] = []

    def scan(self, statements: list[tuple], inputs: dict[str, Tagged]) -> dict[str, Tagged]:
        self.values |= inputs
        self.run(statements)
        return {name: self.values[name] for name in OUTPUTS}

    def doubt(self, names: set[str], quality: int) -> None:
        for name in names:
            if name == "a":
                self.array = [(value, old | quality) for value, old in self.array]
            else:
                self.values[name] = (self.values[name][0], self.values[name][1] | quality)

    def run(self, statements: list[tuple]) -> None:
        for statement in statements:
            match statement:
                case ("assign", name, value):
                    self.values[name] = self.value(value)
                case ("store", index, value):
                    new, at = self.value(value), self.value(index)
                    doubt = at[1]
                    if LOW <= at[0] <= HIGH:
                        self.array[at[0] - LOW] = new
                    else:
                        self.faults += 1
                        doubt |= INVALID
                    self.doubt({"a"}, doubt)
                case ("leave", word):
                    raise Leave(word)
                case ("if", branches, otherwise):
                    self.branch([(lambda c=c: self.value(c), body) for c, body in branches], otherwise)
                case ("case", selector, branches, otherwise):
                    value, quality = self.value(selector)
                    hits = [((value in labels, quality), body) for labels, body in branches]
                    self.branch([(lambda hit=hit: hit, body) for hit, body in hits], otherwise)
                case ("for", name, first, last, step, body):
                    self.loop(name, first, self.value(last), step, body)

    def branch(self, branches: list, otherwise: list[tuple]) -> None:
        everything = [one for _, body in branches for one in body] + otherwise
        doubt, chosen = 0, otherwise
        for condition, body in branches:
            value, quality = condition()
            doubt |= quality
            if value:
                chosen = body
                break
        if decides(everything):
            self.doubts[-1] |= doubt
        self.run(chosen)
        self.doubt(written(everything), doubt)

    def loop(self, name: str, first: int, last: Tagged, step: int, body: list[tuple]) -> None:
        self.doubts.append(last[1])
        count = first
        while count <= last[0]:
            self.values[name] = (count, 0)
            try:
                self.run(body)
            except Leave as leave:
                if leave.args[0] == "EXIT":
                    break
            count += step
        self.doubt({name} | written(body), self.doubts.pop())

    def value(self, node: tuple) -> Tagged:
        match node:
            case ("name", name, _):
                return self.values[name]
            case ("literal", kind, value):
                return (single(value) if kind == "REAL" else value, 0)
            case ("element", index):
                at, quality = self.value(index)
                if LOW <= at <= HIGH:
                    return (self.array[at - LOW][0], self.array[at - LOW][1] | quality)
                self.faults += 1
                return (0, quality | INVALID)
            case ("good", name):
                return ((self.values[name][1] & 0xC1) == 0, 0)
            case ("unary", operator, kind, operand):
                value, quality = self.value(operand)
                if operator == "NOT":
                    return (not value if kind == "BOOL" else value ^ 0xFFFF, quality)
                return self.fitted(kind, abs(value) if operator == "ABS" else -value, quality)
            case ("choose", condition, yes, no):
                # SEL computes both, so that both count faults; the quality is that of the chosen one.
                which, other, first = self.value(condition), self.value(no), self.value(yes)
                chosen = first if which[0] else other
                return (chosen[0], chosen[1] | which[1])
            case ("convert", source, target, operand):
                value, quality = self.value(operand)
                if source == "LREAL":
                    return self.fitted(target, round(value), quality)
                return self.fitted(target, float(value) if target in ("LREAL", "REAL") else value, quality)
            case ("binary", operator, kind, left, right):
                return self.computed(operator, kind, self.value(left), self.value(right))
        raise ValueError(node)

    def computed(self, operator: str, kind: str, left: Tagged, right: Tagged) -> Tagged:
        (a, first), (b, second) = left, right
        quality = first | second
        compared = {"<": a < b, ">": a > b, "<=": a <= b, ">=": a >= b, "=": a == b, "<>": a != b}
        if operator in compared:
            return (compared[operator], quality)
        if operator in ("AND", "OR", "XOR"):
            return ({"AND": a & b, "OR": a | b, "XOR": a ^ b}[operator], quality)
        if operator in ("/", "MOD"):
            if b == 0:
                self.faults += 1
                return (zero(kind), quality | INVALID)
            if kind in RANGES:
                quotient = abs(a) // abs(b) * (1 if (a < 0) == (b < 0) else -1)
                return self.fitted(kind, quotient if operator == "/" else a - quotient * b, quality)
            return self.fitted(kind, a / b, quality)
        return self.fitted(kind, {"+": a + b, "-": a - b, "*": a * b}[operator], quality)

    def fitted(self, kind: str, value: float, quality: int) -> Tagged:
        if kind == "REAL":
            value = single(value)
        fits = RANGES[kind][0] <= value <= RANGES[kind][1] if kind in RANGES else math.isfinite(value)
        if fits:
            return (value, quality)
        self.faults += 1
        return (zero(kind), quality | INVALID | OVERFLOW)


def zero(kind: str) -> bool | int | float:
    return False if kind == "BOOL" else 0 if kind in RANGES else 0.0
