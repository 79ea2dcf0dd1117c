# SPDX-License-Identifier: GPL-3.0-or-later
"""
Random programs of Structured Text, each as text and as a tree; and a slow interpreter of the tree.

It shares no code with the compiler or the machine: values and qualities follow docs/logic.md.
"""

from __future__ import annotations

import math
import random
import struct
from dataclasses import dataclass

INVALID, OVERFLOW = 0x80, 0x01
RANGES = {"INT": (-32768, 32767), "DINT": (-(1 << 31), (1 << 31) - 1), "WORD": (0, 65535)}
TEXTS = {"k": "STRING", "l": "STRING"}
ROOM = {"k": 12, "l": 5, "z": 7}  # of a STRING
INPUTS = {"b_in": "BOOL", "i_in": "INT", "d_in": "DINT", "x_in": "LREAL", "r_in": "REAL"}
OUTPUTS = {
    "b_out": "BOOL",
    "i_out": "INT",
    "d_out": "DINT",
    "x_out": "LREAL",
    "r_out": "REAL",
    "w_out": "WORD",
}
MODES = {"OFF": 0, "RUN": 3, "TRIP": 4}
TYPES = """TYPE
mode : (OFF, RUN := 3, TRIP);
pair : STRUCT n : INT; d : DINT := 7; END_STRUCT
unit : STRUCT m : mode := RUN; p : pair := (n := 4); v : ARRAY[0..2] OF INT := [1, 2(5)]; END_STRUCT
END_TYPE
FUNCTION half : DINT VAR_INPUT q : pair; END_VAR half := q.d / 2; END_FUNCTION
FUNCTION_BLOCK turn VAR_IN_OUT q : pair; END_VAR q.n := q.n MOD 7 + 1; END_FUNCTION_BLOCK
FUNCTION_BLOCK adds VAR_INPUT v : INT; END_VAR VAR_OUTPUT s : INT; END_VAR
s := (s + v) MOD 100; END_FUNCTION_BLOCK
TYPE holder : STRUCT first : INT; a : adds; last : INT; END_STRUCT END_TYPE"""
DECLARED = """VAR a : ARRAY[-2..5] OF INT; n1, n2, n3 : INT; m : ARRAY[1..3, -1..1] OF INT := [3(2), 4, 5];
s, t : unit; u : ARRAY[2..3, 0..1] OF unit; b : turn;
k : STRING(12) := 'abc'; l : STRING(5); z : ARRAY[1..3] OF STRING(7); c : ARRAY[1..3] OF adds;
h : ARRAY[1..3] OF holder; END_VAR"""
# The dimensions and the type behind each variable: indices, or members.
PAIR = {"n": "INT", "d": "DINT"}
UNIT = {"m": "MODE", "p": PAIR, "v": [(0, 2), "INT"]}
PLACES = {
    "a": [(-2, 5), "INT"],
    "m": [(1, 3), (-1, 1), "INT"],
    "s": UNIT,
    "t": UNIT,
    "u": [(2, 3), (0, 1), UNIT],
    "z": [(1, 3), "STRING"],
    "c": [(1, 3), {"v": "INT", "s": "INT"}],
    "h": [(1, 3), {"a": {"v": "INT", "s": "INT"}}],
}
BLOCKS = ("c", "h")  # their outputs are written by a call only
Tagged = tuple  # value, quality
Key = tuple  # the name of a variable, members, indices


def paths(kind: object, key: Key = ()) -> list[tuple[Key, str]]:
    """Of each value within: what leads to it, and its type."""
    if isinstance(kind, str):
        return [(key, kind)]
    if isinstance(kind, dict):
        return [one for name, inner in kind.items() for one in paths(inner, (*key, name))]
    (low, high), *rest = kind
    inner = rest[0] if len(rest) == 1 else rest
    return [one for index in range(low, high + 1) for one in paths(inner, (*key, index))]


ELEMENTS = [((name, *key), its) for name, kind in PLACES.items() for key, its in paths(kind)]
PRIME = 1_000_003


def initial(key: Key) -> int | str:
    if key[0] == "z":
        return ""
    if key[0] in BLOCKS:
        return 0
    members = [step for step in key if isinstance(step, str)]
    if key[0] == "m":
        return [2, 2, 2, 4, 5, 0, 0, 0, 0][(key[1] - 1) * 3 + key[2] + 1]
    if "v" in members:
        return [1, 5, 5][key[-1]]
    return {"m": 3, "n": 4, "d": 7}.get(members[-1], 0) if key[0] != "a" else 0


class Leave(Exception):
    """EXIT or CONTINUE on its way."""


@dataclass
class Random:
    """A program: its tree, and what the tree is as text."""

    random: random.Random
    loops: int = 0
    depth: int = 0
    messages: int = 0

    def place(self, wanted: str, depth: int) -> tuple:
        """A member or an element of this type: its indices are expressions."""
        while True:
            found = self.walk(self.random.choice(list(PLACES)), wanted, depth)
            if found is not None:
                return found

    def target(self, wanted: str) -> tuple:
        while True:
            found = self.place(wanted, 1)
            if found[1] not in BLOCKS:
                return found

    def walk(self, name: str, wanted: str, depth: int) -> tuple | None:
        kind, steps = PLACES[name], []
        while True:
            if wanted == {id(PAIR): "PAIR", id(UNIT): "UNIT"}.get(id(kind), kind):
                return ("place", name, tuple(steps))
            if isinstance(kind, str):
                return None
            if isinstance(kind, dict):
                step = self.random.choice(list(kind))
                steps.append(step)
                kind = kind[step]
                continue
            (low, high), *rest = kind
            steps.append((low, high, self.index(low, high, depth)))
            kind = rest[0] if len(rest) == 1 else rest

    def index(self, low: int, high: int, depth: int) -> tuple:
        """Often inside; a constant one always is: another one is a mistake that the compiler finds."""
        if self.random.random() < 0.3:
            return ("literal", "INT", self.random.randint(low, high))
        found = self.expression("INT", depth + 2)
        if self.random.random() < 0.5:
            found = ("binary", "MOD", "INT", found, ("literal", "INT", 3))
        return ("binary", "+", "INT", ("name", "i_in", "INT"), found) if is_constant(found) else found

    def expression(self, kind: str, depth: int = 0) -> tuple:
        pick = self.random.choice
        names = [name for name, its in (INPUTS | OUTPUTS | TEXTS).items() if its == kind]
        if kind == "STRING" and depth < 4 and self.random.random() < 0.6:
            return self.text(depth)
        if kind == "INT" and depth < 4 and self.random.random() < 0.1:
            texts = [self.expression("STRING", depth + 1) for _ in "ab"]
            return ("text", *pick([("LEN", texts[0]), ("FIND", *texts)]))
        if kind == "MODE" or (
            kind in ("INT", "DINT", "STRING") and depth < 4 and self.random.random() < 0.15
        ):
            if kind == "MODE" and (depth > 3 or self.random.random() < 0.4):
                return ("literal", kind, pick(list(MODES)))
            if kind == "DINT" and self.random.random() < 0.3:
                return ("half", self.place("PAIR", depth))
            return self.place(kind, depth)
        if depth > 3 or self.random.random() < 0.25:
            return (
                ("name", pick(names), kind)
                if self.random.random() < 0.7
                else ("literal", kind, self.literal(kind))
            )
        if kind == "BOOL":
            which = self.random.random()
            if which < 0.5:
                of = pick(["INT", "DINT", "LREAL", "REAL", "STRING"])
                operators = ["<", ">", "<=", ">="] + (["=", "<>"] if of in RANGES or of == "STRING" else [])
                return (
                    "binary",
                    pick(operators),
                    of,
                    self.expression(of, depth + 1),
                    self.expression(of, depth + 1),
                )
            if which < 0.55:
                return (
                    "binary",
                    pick(["=", "<>"]),
                    "MODE",
                    *(self.expression("MODE", depth + 1) for _ in "ab"),
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
        if kind == "STRING" or self.random.random() < 0.15:
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

    def text(self, depth: int) -> tuple:
        """What a function makes of texts, or a number as text."""
        if self.random.random() < 0.3:
            source = self.random.choice(["INT", "DINT", "BOOL", "WORD", "REAL", "LREAL", "MODE"])
            return ("convert", source, "STRING", self.expression(source, depth + 1))
        name, texts, numbers = self.random.choice(
            [
                ("CONCAT", 2, 0),
                ("LEFT", 1, 1),
                ("RIGHT", 1, 1),
                ("MID", 1, 2),
                ("INSERT", 2, 1),
                ("DELETE", 1, 2),
                ("REPLACE", 2, 2),
            ]
        )
        of = [self.expression("STRING", depth + 1) for _ in range(texts)]
        return ("text", name, *of, *(self.expression_small() for _ in range(numbers)))

    def literal(self, kind: str) -> bool | int | float | str:
        if kind == "STRING":
            return self.random.choice(["", "a", "bc", "it's", "abcabc"])
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
            if self.depth < 4 and which < 0.23:
                first, *others = self.random.sample(list(MODES), 3)
                branches = [([first], self.block(2)), (others, self.block(2))]
                return ("case", self.expression("MODE"), branches[: self.random.randint(1, 2)], self.block(1))
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
            if which < 0.68:
                kind = self.random.choice(["INT", "INT", "DINT", "MODE", "STRING"])
                return ("store", self.target(kind), self.expression(kind))
            if which < 0.76:
                kind = self.random.choice(["PAIR", "UNIT"])
                return ("copy", self.place(kind, 1), self.place(kind, 1))
            if which < 0.78:
                return self.message()
            if which < 0.81:
                return ("turn", self.place("PAIR", 1))
            if which < 0.85:
                return ("adds", self.adds(self.index(1, 3, 1)), self.expression("INT"))
            name = self.random.choice([*OUTPUTS, *TEXTS])
            return ("assign", name, self.expression((OUTPUTS | TEXTS)[name]))
        finally:
            self.depth -= 1

    def adds(self, index: tuple) -> tuple:
        """A block of an array, or in a structure of one."""
        step = (1, 3, index)
        return self.random.choice([("place", "c", (step,)), ("place", "h", (step, "a"))])

    def message(self) -> tuple:
        self.messages += 1
        kinds = self.random.choices([*OUTPUTS.values(), "MODE", "STRING"], k=self.random.randint(0, 3))
        values = [(kind, self.expression(kind, 2)) for kind in kinds]
        return ("say", self.messages, [one for one in values if not is_constant(one[1])])

    def expression_small(self) -> tuple:
        """The end of a loop: not far away, sometimes of doubtful quality."""
        return ("binary", "MOD", "INT", self.expression("INT", 2), ("literal", "INT", 7))


def is_constant(node: tuple) -> bool:
    """What the compiler may compute itself."""
    match node:
        case ("literal", *_):
            return True
        case ("unary", _, _, operand):
            return is_constant(operand)
        case ("binary", _, _, left, right):
            return is_constant(left) and is_constant(right)
    return False


def shown_place(name: str, steps: tuple) -> str:
    text = name
    for step in steps:
        text += f".{step}" if isinstance(step, str) else f"[{shown(step[2])}]"
    return text.replace("][", ", ") if name == "m" else text


def shown(node: tuple) -> str:
    match node:
        case ("place", name, steps):
            return shown_place(name, steps)
        case ("half", operand):
            return f"half({shown(operand)})"
        case ("name", name, _):
            return name
        case ("literal", "STRING", value):
            return "'" + value.replace("'", "$'") + "'"
        case ("text", name, *operands):
            return f"{name}({', '.join(map(shown, operands))})"
        case ("literal", kind, value):
            return str(value).upper() if kind == "BOOL" else f"{kind}#{value}"
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
            case ("store" | "copy", place, value):
                found.append(f"{shown(place)} := {shown(value)};")
            case ("say", number, values):
                arguments = "".join(f", {shown(value)}" for _, value in values)
                found.append(f"MESSAGE('{number}{' {}' * len(values)}'{arguments});")
            case ("adds", (_, name, steps), value):
                found.append(f"{shown_place(name, steps)}(v := {shown(value)});")
            case ("turn", place):
                found.append(f"b(q := {shown(place)});")
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


def seen(key: Key, kind: str) -> list[str]:
    """All elements and members are in two sums, whatever the statements did to them."""
    name = "".join(f".{step}" if isinstance(step, str) else f"[{step}]" for step in key)[1:]
    name = name.replace("][", ", ")
    value = f"LEN(AS_GOOD({name}))" if kind == "STRING" else f"{kind}_TO_LINT(AS_GOOD({name}))"
    return [
        f"values := (values * 31 + {value}) MOD {PRIME};",
        f"flags := (flags * 31 + BYTE_TO_LINT(QUALITY({name}))) MOD {PRIME};",
    ]


def text_of(statements: list[tuple]) -> str:
    points = "; ".join(f"{name} : {kind}" for name, kind in (INPUTS | OUTPUTS).items())
    return "\n".join(
        [
            f"{TYPES}\nPROGRAM random\nVAR_EXTERNAL {points}; values, flags : LINT; END_VAR",
            DECLARED,
            *[f"{name} := {name};" for name in OUTPUTS],  # so all of them are outputs
            "MESSAGE('0 {} {} {} {} {}', k, l, z[1], z[2], z[3]);",
            *lines(statements),
            "values := 0; flags := 0;",
            *(line for key, kind in ELEMENTS for line in seen(key, kind)),
            "END_PROGRAM",
        ]
    )


def kind_at(place: tuple) -> object:
    kind = PLACES[place[1]]
    for step in place[2]:
        kind = kind[step] if isinstance(step, str) else kind[1] if len(kind) == 2 else kind[1:]
    return kind


def touched(place: tuple) -> set[Key]:
    """
    What an assignment may write, the index being what it may be.

    With several indices that are no constants, each element behind the constant ones before them.
    """
    _, name, steps = place
    indices = [step for step in steps if not isinstance(step, str)]
    varied = [number for number, step in enumerate(indices) if step[2][0] != "literal"]
    fixed = len(indices) if len(varied) < 2 else varied[0]
    keys: list[Key] = [(name,)]
    number = 0
    for step in steps:
        if isinstance(step, str):
            keys = [(*key, step) for key in keys]
            continue
        low, high, index = step
        held = index[0] == "literal" and number < fixed
        keys = [(*key, i) for key in keys for i in ([index[2]] if held else range(low, high + 1))]
        number += 1
    return {(*key, *tail) for key in keys for tail, _ in paths(kind_at(place))}


def written(statements: list[tuple]) -> set[object]:
    found: set[object] = set()
    for statement in statements:
        match statement:
            case ("assign", name, _):
                found.add(name)
            case ("say", number, values):
                found |= {("message", number, place) for place in range(len(values))}
            case ("store" | "copy", place, _) | ("turn", place):
                found |= touched(place)
            case ("adds", place, _):
                found |= touched(place)
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


def fits_tail(key: Key, place: tuple, tail: Key) -> bool:
    """Whether this is the same value of an element as the tail's."""
    return not tail or key[len(place[2]) + 1 :] == tail


def tagged_text(kind: str, tagged: Tagged) -> str:
    value, quality = tagged
    if kind == "STRING":
        return value + ("!" if quality & 0xC1 else "")
    texts = {"BOOL": str(bool(value)).upper(), "REAL": f"{value:.7g}", "LREAL": f"{value:.15g}"}
    if kind == "MODE":
        texts["MODE"] = next((name for name, number in MODES.items() if number == value), str(value))
    text = f"16#{value:X}" if kind == "WORD" else texts.get(kind, str(value))
    return text + ("!" if quality & 0xC1 else "")


def single(value: float) -> float:
    try:
        return struct.unpack("f", struct.pack("f", value))[0]
    except OverflowError:
        return math.inf


class Reference:
    def __init__(self) -> None:
        self.values: dict[object, Tagged] = {name: (zero(kind), 0) for name, kind in OUTPUTS.items()}
        self.values |= {name: (0, 0) for name in ("n1", "n2", "n3")}
        self.values |= {"k": ("abc", 0), "l": ("", 0)}
        self.values |= {key: (initial(key), 0) for key, _ in ELEMENTS}
        self.first = ""  # what the scan says before its statements
        self.messages_of_scan: dict[int, list[str]] = {}  # of this scan: the types of each message's values
        self.faults = 0
        self.doubts: list[int] = []

    def scan(self, statements: list[tuple], inputs: dict[str, Tagged]) -> dict[str, Tagged]:
        self.values |= inputs
        self.messages_of_scan.clear()
        texts = [self.values[key] for key in ("k", "l", ("z", 1), ("z", 2), ("z", 3))]
        self.first = " ".join(["0", *(tagged_text("STRING", text) for text in texts)])
        self.run(statements)
        values = flags = 0
        for key, _ in ELEMENTS:
            value = self.values[key][0]
            value = len(value) if isinstance(value, str) else value
            values = int(math.fmod(values * 31 + value, PRIME))
            flags = (flags * 31 + self.values[key][1]) % PRIME
        sums = {"values": (values, 0), "flags": (flags, 0)}
        return {name: self.values[name] for name in OUTPUTS} | sums

    def doubt(self, names: set[object], quality: int) -> None:
        for name in names:
            value, its = self.values.get(name, (0, 0))  # of a message: not said yet
            self.values[name] = (value, its | quality)

    def reached(self, place: tuple) -> tuple[Key, int, bool]:
        """The place with its indices computed, their quality, and whether all are inside."""
        key, quality, inside = [place[1]], 0, True
        for step in place[2]:
            if isinstance(step, str):
                key.append(step)
                continue
            index, its = self.value(step[2])
            key.append(index)
            quality |= its
            inside &= step[0] <= index <= step[1]
        return tuple(key), quality, inside

    def read(self, key: Key, quality: int, inside: bool) -> Tagged:
        if inside:
            return (self.values[key][0], self.values[key][1] | quality)
        self.faults += 1
        if key[0] == "z":  # its length, and its octets
            self.faults += 1
            return ("", quality | INVALID)
        return (0, quality | INVALID)

    def write(self, key: Key, quality: int, inside: bool, new: Tagged, might: set[object]) -> None:
        if inside:
            self.values[key] = new
        else:
            self.faults += 2 if key[0] == "z" else 1
            quality |= INVALID
        self.doubt(might, quality)

    def copied(self, place: tuple) -> list[Tagged]:
        key, quality, inside = self.reached(place)
        return [self.read((*key, *tail), quality, inside) for tail, _ in paths(kind_at(place))]

    def put(self, place: tuple, reached: tuple[Key, int, bool], new: Tagged, tail: Key) -> None:
        """One value of a place: the element's others are not in doubt by it."""
        key, quality, inside = reached
        might = {one for one in touched(place) if fits_tail(one, place, tail)}
        self.write((*key, *tail), quality, inside, new, might)

    def run(self, statements: list[tuple]) -> None:
        for statement in statements:
            match statement:
                case ("assign", name, value):
                    self.values[name] = fitting(name, self.value(value))
                case ("store", place, value):
                    new = self.value(value)
                    self.put(place, self.reached(place), fitting(place[1], new), ())
                case ("copy", place, source):
                    to, of = self.reached(place), self.reached(source)
                    for tail, _ in paths(kind_at(place)):
                        self.put(place, to, self.read((*of[0], *tail), *of[1:]), tail)
                case ("say", number, values):
                    for place, (_, value) in enumerate(values):
                        self.values[("message", number, place)] = self.value(value)
                    if number in self.messages_of_scan or len(self.messages_of_scan) < 7:  # and the first one
                        self.messages_of_scan[number] = [kind for kind, _ in values]
                case ("adds", place, value):
                    key, *rest = reached = self.reached(place)
                    state = {name: self.read((*key, name), *rest) for name in ("v", "s")}
                    state["v"] = self.value(value)
                    added = self.computed("+", "INT", state["s"], state["v"])
                    state["s"] = self.computed("MOD", "INT", added, (100, 0))
                    for name, new in state.items():
                        self.put(place, reached, new, (name,))
                case ("turn", place):
                    pair = dict(zip(PAIR, self.copied(place), strict=True))
                    n, quality = pair["n"]
                    pair["n"] = (int(math.fmod(n, 7)) + 1, quality)
                    reached = self.reached(place)
                    for name, value in pair.items():
                        self.put(place, reached, value, (name,))
                case ("leave", word):
                    raise Leave(word)
                case ("if", branches, otherwise):
                    self.branch([(lambda c=c: self.value(c), body) for c, body in branches], otherwise)
                case ("case", selector, branches, otherwise):
                    value, quality = self.value(selector)
                    hits = [
                        ((value in [MODES.get(label, label) for label in labels], quality), body)
                        for labels, body in branches
                    ]
                    self.branch([(lambda hit=hit: hit, body) for hit, body in hits], otherwise)
                case ("for", name, first, last, step, body):
                    self.loop(name, first, self.value(last), step, body)

    def messages(self) -> list[str]:
        """The values as they are when the scan ends: what a condition doubts is marked."""
        lines = [self.first]
        for number, kinds in self.messages_of_scan.items():
            values = [self.values[("message", number, place)] for place in range(len(kinds))]
            lines.append(
                " ".join([str(number), *(tagged_text(*pair) for pair in zip(kinds, values, strict=True))])
            )
        return lines

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
                return (single(value) if kind == "REAL" else MODES.get(value, value), 0)
            case ("place", *_):
                return self.read(*self.reached(node))
            case ("half", place):
                _, (d, quality) = self.copied(place)
                return (int(d / 2), quality)
            case ("text", name, *operands):
                return self.text(name, [self.value(one) for one in operands])
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
                if target == "STRING":
                    return (tagged_text(source, (value, 0)), quality)
                if source == "LREAL":
                    return self.fitted(target, round(value), quality)
                return self.fitted(target, float(value) if target in ("LREAL", "REAL") else value, quality)
            case ("binary", operator, kind, left, right):
                return self.computed(operator, kind, self.value(left), self.value(right))
        raise ValueError(node)

    def part(self, which: str, text: Tagged, number: Tagged, less: int = 0) -> Tagged:
        (value, quality), count = text, number[0] - less
        if count < 0:
            self.faults += 1
            return ("", quality | number[1] | INVALID)
        if which == "last":
            value = value[max(0, len(value) - count) :]
        else:
            value = value[:count] if which == "first" else value[count:]
        return (value, quality | number[1])

    def text(self, name: str, given: list[Tagged]) -> Tagged:
        first, *rest = given
        parts: list[Tagged] = []
        match name:
            case "LEN":
                return (len(first[0]), first[1])
            case "FIND":
                found = first[0].find(rest[0][0]) + 1 if rest[0][0] else 0
                return (found, first[1] | rest[0][1])
            case "CONCAT":
                parts = given
            case "LEFT":
                parts = [self.part("first", first, rest[0])]
            case "RIGHT":
                parts = [self.part("last", first, rest[0])]
            case "MID":
                parts = [self.part("first", self.part("rest", first, rest[1], 1), rest[0])]
            case "INSERT":
                parts = [self.part("first", first, rest[1]), rest[0], self.part("rest", first, rest[1])]
            case "DELETE" | "REPLACE":
                *new, length, at = rest
                behind = self.part("rest", self.part("rest", first, at, 1), length)
                parts = [self.part("first", first, at, 1), *new, behind]
        quality = 0
        for _, its in parts:
            quality |= its
        return ("".join(text for text, _ in parts), quality)

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


def fitting(name: str, new: Tagged) -> Tagged:
    """What a variable has no room for is cut."""
    if name not in ROOM or len(new[0]) <= ROOM[name]:
        return new
    return (new[0][: ROOM[name]], new[1] | OVERFLOW)


def zero(kind: str) -> bool | int | float:
    return False if kind == "BOOL" else 0 if kind in RANGES else 0.0
