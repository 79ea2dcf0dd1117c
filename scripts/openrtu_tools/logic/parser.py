# SPDX-License-Identifier: GPL-3.0-or-later
"""
Text into a tree, by recursive descent.

After a mistake it goes on behind the statement, so that all mistakes come at once.
"""

from __future__ import annotations

import calendar
import re
from dataclasses import dataclass

from openrtu_tools.logic.errors import Findings, Place, SourceError
from openrtu_tools.logic.syntax import (
    Argument,
    Assign,
    Binary,
    Call,
    Case,
    Choice,
    Declared,
    Enumerated,
    Expression,
    Filled,
    For,
    If,
    Indexed,
    Initial,
    Leave,
    Listed,
    Literal,
    Member,
    Name,
    Repeat,
    Spelled,
    Statement,
    Text,
    Unary,
    Unit,
    Variable,
    While,
)
from openrtu_tools.logic.types import TYPES

TOKEN = re.compile(
    r"""(?P<space>\s+|//[^\n]*|\(\*.*?\*\))
      |(?P<time>(?:TIME|T)\#-?[0-9][0-9_.a-z]*)
      |(?P<date>(?:DATE_AND_TIME|DT)\#[0-9:.\-]+)
      |(?P<typed>[A-Z_]\w*\#[-+]?(?:[0-9][0-9A-Z_#]*(?:\.[0-9][0-9_]*(?:E[+-]?[0-9]+)?)?|[A-Z_]\w*))
      |(?P<based>(?:2|8|16)\#[0-9A-F_]+)
      |(?P<real>[0-9][0-9_]*\.[0-9][0-9_]*(?:E[+-]?[0-9]+)?)
      |(?P<integer>[0-9][0-9_]*)
      |(?P<text>'(?:[^'$\n]|\$[^\n])*')
      |(?P<word>[A-Z_]\w*)
      |(?P<sign>:=|=>|<>|<=|>=|\*\*|\.\.|\((?!\*)|[-+*/&=<>)\[\],;:.])""",
    re.VERBOSE | re.IGNORECASE | re.DOTALL,
)
UNITS = {"d": 86_400_000_000, "h": 3_600_000_000, "m": 60_000_000, "s": 1_000_000, "ms": 1000, "us": 1}
SECTIONS = ("VAR", "VAR_INPUT", "VAR_OUTPUT", "VAR_IN_OUT", "VAR_EXTERNAL", "VAR_TEMP")
BEGINNINGS = ("PROGRAM", "FUNCTION", "FUNCTION_BLOCK", "TYPE")
KEYWORDS = {
    *SECTIONS,
    *[
        "PROGRAM",
        "END_PROGRAM",
        "FUNCTION",
        "END_FUNCTION",
        "FUNCTION_BLOCK",
        "END_FUNCTION_BLOCK",
        "END_VAR",
        "CONSTANT",
        "RETAIN",
        "IF",
        "THEN",
        "ELSIF",
        "ELSE",
        "END_IF",
        "CASE",
        "OF",
        "END_CASE",
        "FOR",
        "TO",
        "BY",
        "DO",
        "END_FOR",
        "WHILE",
        "END_WHILE",
        "REPEAT",
        "UNTIL",
        "END_REPEAT",
        "EXIT",
        "CONTINUE",
        "RETURN",
        "AND",
        "OR",
        "XOR",
        "NOT",
        "MOD",
        "TRUE",
        "FALSE",
        "ARRAY",
        "TYPE",
        "END_TYPE",
        "STRUCT",
        "END_STRUCT",
    ],
}
BINARY = [
    ("OR",),
    ("XOR",),
    ("AND", "&"),
    ("=", "<>"),
    ("<", ">", "<=", ">="),
    ("+", "-"),
    ("*", "/", "MOD"),
    ("**",),
]


@dataclass(frozen=True)
class Token:
    place: Place
    kind: str
    text: str

    @property
    def word(self) -> str:
        return self.text.upper() if self.kind in ("word", "sign") else ""

    @property
    def shown(self) -> str:
        return "the end of the file" if self.kind == "end" else f"'{self.text}'"


def tokens_of(text: str, findings: Findings) -> list[Token]:
    tokens, at, line, start = [], 0, 1, 0
    while at < len(text):
        place = Place(line, at - start + 1)
        found = TOKEN.match(text, at)
        if found is None:
            if text.startswith("(*", at):
                findings.error(place, "a comment '(*' without its end '*)'")
                at = len(text)
            elif text[at] == "'":
                findings.error(place, 'a text without its end "\'" in this line')
                end = text.find("\n", at)
                at = len(text) if end < 0 else end
            else:
                findings.error(place, f"unknown character {text[at]!r}")
                at += 1
            continue
        if found.lastgroup != "space":
            tokens.append(Token(place, str(found.lastgroup), found[0]))
        newlines = found[0].count("\n")
        if newlines:
            line += newlines
            start = at + found[0].rindex("\n") + 1
        at = found.end()
    tokens.append(Token(Place(line, max(1, at - start + 1)), "end", ""))
    return tokens


def parse(text: str, findings: Findings) -> tuple[list[Unit], list[Declared]]:
    """All units and types of the text; what could not be read is among the findings."""
    parser = Parser(tokens_of(text, findings), findings)
    return parser.units(), parser.types


class Parser:
    def __init__(self, tokens: list[Token], findings: Findings) -> None:
        self.tokens = tokens
        self.findings = findings
        self.at = 0
        self.types: list[Declared] = []

    @property
    def next(self) -> Token:
        return self.tokens[self.at]

    def take(self) -> Token:
        token = self.next
        self.at = min(self.at + 1, len(self.tokens) - 1)
        return token

    def accept(self, *words: str) -> Token | None:
        return self.take() if self.next.word in words else None

    def expect(self, word: str, where: str) -> Token:
        if self.next.word == word:
            return self.take()
        place = self.next.place
        if word == ";" and self.at:  # it is missing where the statement ends, not where the next one begins
            before = self.tokens[self.at - 1]
            place = Place(before.place.line, before.place.column + len(before.text))
        raise SourceError(place, f"expected '{word}' {where}, found {self.next.shown}")

    def name(self, what: str) -> Token:
        if self.next.kind == "word" and self.next.word not in KEYWORDS:
            return self.take()
        raise SourceError(self.next.place, f"expected {what}, found {self.next.shown}")

    # ---- units -------------------------------------------------------------------------------------

    def units(self) -> list[Unit]:
        units = []
        while self.next.kind != "end":
            try:
                if self.accept("TYPE"):
                    self.type_section()
                else:
                    units.append(self.unit())
            except SourceError as error:
                self.findings.error(error.place, error.text)
                while self.next.kind != "end" and self.next.word not in BEGINNINGS:
                    self.take()
        return units

    def unit(self) -> Unit:
        head = self.accept("PROGRAM", "FUNCTION", "FUNCTION_BLOCK")
        if head is None:
            raise SourceError(
                self.next.place,
                f"expected PROGRAM, FUNCTION, FUNCTION_BLOCK or TYPE, found {self.next.shown}",
            )
        unit = Unit(head.place, head.word, self.name(f"the name of the {head.word}").text.upper())
        if head.word == "FUNCTION":
            self.expect(":", "and the type of the function's result")
            unit.result = self.spelled()
        while self.next.word in SECTIONS:
            self.section(unit.variables)
        end = f"END_{head.word}"
        unit.body = self.statements(end)
        self.expect(end, f"at the end of {unit.name}")
        return unit

    def section(self, variables: list[Variable]) -> None:
        section = self.take().word
        constant = retain = False
        while qualifier := self.accept("CONSTANT", "RETAIN"):
            constant |= qualifier.word == "CONSTANT"
            retain |= qualifier.word == "RETAIN"
        self.variables(variables, section, "END_VAR", constant, retain)

    def variables(
        self, found: list[Variable], section: str, end: str, constant: bool = False, retain: bool = False
    ) -> None:
        while self.next.word != end and self.next.kind != "end":
            try:
                found.extend(self.variable(section, end, constant, retain))
            except SourceError as error:
                self.findings.error(error.place, error.text)
                self.recover(end)
                if self.next.word.startswith("END_"):
                    break
        self.expect(end, f"at the end of {section}")

    def variable(self, section: str, end: str, constant: bool, retain: bool) -> list[Variable]:
        names = [self.name(f"the name of a variable, or {end}")]
        while self.accept(","):
            names.append(self.name("the name of a variable"))
        self.expect(":", "and a type after the name")
        kind = self.spelled()
        initial = self.initial() if self.accept(":=") else None
        self.expect(";", "after the declaration")
        return [
            Variable(name.place, name.text.upper(), section, kind, initial, constant, retain, name.text)
            for name in names
        ]

    # ---- types -------------------------------------------------------------------------------------

    def type_section(self) -> None:
        while self.next.word != "END_TYPE" and self.next.word not in BEGINNINGS and self.next.kind != "end":
            try:
                self.types.append(self.declared())
            except SourceError as error:
                self.findings.error(error.place, error.text)
                self.recover("END_TYPE")
                # recover() stops before each END_…: what stays there would be met for ever.
                if self.next.word.startswith("END_") and self.next.word != "END_TYPE":
                    self.take()
                    self.accept(";")
        self.expect("END_TYPE", "at the end of TYPE")
        self.accept(";")

    def declared(self) -> Declared:
        name = self.name("the name of a type, or END_TYPE")
        self.expect(":", f"after {name.text}, the name of the type")
        what: tuple[Choice, ...] | tuple[Variable, ...] | Spelled
        if self.accept("STRUCT"):
            members: list[Variable] = []
            self.variables(members, "STRUCT", "END_STRUCT")
            self.accept(";")
            return Declared(name.place, name.text.upper(), tuple(members), spelling=name.text)
        what = self.choices() if self.accept("(") else self.spelled()
        initial = self.initial() if self.accept(":=") else None
        self.expect(";", "after the declaration of the type")
        return Declared(name.place, name.text.upper(), what, initial, name.text)

    def choices(self) -> tuple[Choice, ...]:
        found: list[Choice] = []
        while not found or self.accept(","):
            name = self.name("the name of a value")
            number = self.expression() if self.accept(":=") else None
            found.append(Choice(name.place, name.text.upper(), name.text, number))
        self.expect(")", "or ',' after a value of the enumeration")
        return tuple(found)

    def spelled(self) -> Spelled:
        """A type; ARRAY OF ARRAY is an array with the dimensions of both."""
        place, bounds = self.next.place, []
        while self.accept("ARRAY"):
            self.expect("[", "after ARRAY")
            before = len(bounds)
            while len(bounds) == before or self.accept(","):
                first = self.expression()
                self.expect("..", "between the bounds")
                bounds.append((first, self.expression()))
            self.expect("]", "or ',' after the bounds")
            self.expect("OF", "after the bounds")
        if self.next.word in ("(", "STRUCT"):
            raise SourceError(
                self.next.place,
                f"expected the name of a type, found {self.next.shown}; declare it in TYPE … END_TYPE",
            )
        name, length = self.name("a type").text.upper(), None
        if name == "STRING" and (opening := self.accept("(", "[")):
            length = self.expression()
            self.expect({"(": ")", "[": "]"}[opening.word], "after the length of the STRING")
        return Spelled(place, name, tuple(bounds), length)

    def initial(self) -> Initial:
        place, after = self.next.place, self.tokens[min(self.at + 2, len(self.tokens) - 1)].word
        if self.accept("["):
            groups: list[tuple[int, tuple[Initial, ...]]] = []
            while not groups or self.accept(","):
                groups.append(self.group())
            self.expect("]", "or ',' after the initial values")
            return Listed(place, tuple(groups))
        if self.next.word == "(" and after == ":=":
            self.take()
            members: list[tuple[Member, Initial]] = []
            while not members or self.accept(","):
                name = self.name("the name of a member")
                self.expect(":=", f"and a value after the member {name.text}")
                members.append((Member(name.place, name.text.upper()), self.initial()))
            self.expect(")", "or ',' after the value of a member")
            return Filled(place, tuple(members))
        return self.expression()

    def group(self) -> tuple[int, tuple[Initial, ...]]:
        """One initial value, or 3(0): three of them."""
        after = self.tokens[min(self.at + 1, len(self.tokens) - 1)].word
        if self.next.kind != "integer" or after != "(":
            return 1, (self.initial(),)
        token = self.take()
        count = whole(token, token.text.replace("_", ""))
        self.take()
        repeated = [self.initial()]
        while self.accept(","):
            repeated.append(self.initial())
        self.expect(")", "or ',' after the values that are repeated")
        return count, tuple(repeated)

    def recover(self, *ends: str) -> None:
        """Behind the next ';', or before what ends the list."""
        while (
            self.next.kind != "end" and self.next.word not in ends and not self.next.word.startswith("END_")
        ):
            if self.take().word == ";":
                return

    # ---- statements --------------------------------------------------------------------------------

    def statements(self, *ends: str) -> tuple[Statement, ...]:
        found = []
        while (
            self.next.kind != "end" and self.next.word not in ends and not self.next.word.startswith("END_")
        ):
            if self.next.word in BEGINNINGS:
                break
            before = self.at
            try:
                if not self.accept(";"):
                    found.append(self.statement())
            except SourceError as error:
                self.findings.error(error.place, error.text)
                self.recover(*ends)
                if self.at == before:
                    self.take()
        return tuple(found)

    def statement(self) -> Statement:
        head = self.next
        compound = {
            "IF": self.if_,
            "CASE": self.case,
            "FOR": self.for_,
            "WHILE": self.while_,
            "REPEAT": self.repeat,
        }
        if head.word in compound:
            self.take()
            statement = compound[head.word](head.place)
            self.expect(f"END_{head.word}", f"for the {head.word} of line {head.place.line}")
            self.expect(";", f"after END_{head.word}")
            return statement
        if self.accept("EXIT", "CONTINUE", "RETURN"):
            self.expect(";", f"after {head.word}")
            return Leave(head.place, head.word)
        target = self.primary("a statement")
        if isinstance(target, Name) and target.path and self.accept("("):
            target = Call(target.place, target.name, self.arguments(), target.path)
        if isinstance(target, Call):
            self.expect(";", "after the call")
            return target
        if not isinstance(target, Name):
            raise SourceError(head.place, f"expected a statement, found {head.shown}")
        self.expect(":=", f"after {head.text}: an assignment, or '(' of a call")
        value = self.expression()
        self.expect(";", "after the assignment")
        return Assign(head.place, target, value)

    def if_(self, place: Place) -> If:
        branches, otherwise = [], ()
        condition = self.expression()
        while True:
            self.expect("THEN", "after the condition")
            branches.append((condition, self.statements("ELSIF", "ELSE", "END_IF")))
            if not self.accept("ELSIF"):
                break
            condition = self.expression()
        if self.accept("ELSE"):
            otherwise = self.statements("END_IF")
        return If(place, tuple(branches), otherwise)

    def case(self, place: Place) -> Case:
        selector = self.expression()
        self.expect("OF", "after the selector of CASE")
        branches, otherwise = [], ()
        while self.next.word not in ("ELSE", "END_CASE") and self.next.kind != "end":
            labels = [self.label()]
            while self.accept(","):
                labels.append(self.label())
            self.expect(":", "after the values of a case")
            branches.append((tuple(labels), self.case_body()))
        if self.accept("ELSE"):
            otherwise = self.statements("END_CASE")
        return Case(place, selector, tuple(branches), otherwise)

    def label(self) -> tuple[Expression, Expression | None]:
        first = self.expression()
        return first, self.expression() if self.accept("..") else None

    def case_body(self) -> tuple[Statement, ...]:
        """Up to the next label: a number, or a name that ':', ',' or '..' follows."""
        found: list[Statement] = []
        while self.next.word not in ("ELSE", "END_CASE") and self.next.kind != "end":
            after = self.tokens[min(self.at + 1, len(self.tokens) - 1)].word
            if (
                self.next.kind in ("integer", "based", "typed")
                or self.next.word == "-"
                or after in (":", ",", "..")
            ):
                break
            if self.accept(";"):
                continue
            found.append(self.statement())
        return tuple(found)

    def for_(self, place: Place) -> For:
        variable = self.name("the variable of the loop")
        self.expect(":=", "after the variable of the loop")
        first = self.expression()
        self.expect("TO", "after the first value")
        last = self.expression()
        step = self.expression() if self.accept("BY") else None
        self.expect("DO", "before the statements of the loop")
        body = self.statements("END_FOR")
        return For(place, Name(variable.place, variable.text.upper()), first, last, step, body)

    def while_(self, place: Place) -> While:
        condition = self.expression()
        self.expect("DO", "after the condition")
        return While(place, condition, self.statements("END_WHILE"))

    def repeat(self, place: Place) -> Repeat:
        body = self.statements("UNTIL", "END_REPEAT")
        self.expect("UNTIL", "and a condition at the end of REPEAT")
        return Repeat(place, body, self.expression())

    # ---- expressions -------------------------------------------------------------------------------

    def expression(self, level: int = 0) -> Expression:
        if level == len(BINARY):
            return self.unary()
        left = self.expression(level + 1)
        while operator := self.accept(*BINARY[level]):
            word = "AND" if operator.word == "&" else operator.word
            left = Binary(operator.place, word, left, self.expression(level + 1))
        return left

    def unary(self) -> Expression:
        if operator := self.accept("-", "NOT", "+"):
            operand = self.unary()
            if operator.word == "-" and isinstance(operand, Literal) and not isinstance(operand.value, bool):
                return Literal(operator.place, operand.type, -operand.value)
            return operand if operator.word == "+" else Unary(operator.place, operator.word, operand)
        return self.primary("a value")

    def primary(self, what: str) -> Expression:
        token = self.next
        if self.accept("("):
            inner = self.expression()
            self.expect(")", f"for the '(' of column {token.place.column}")
            return inner
        if self.accept("TRUE", "FALSE"):
            return Literal(token.place, "BOOL", token.word == "TRUE")
        if token.kind == "text":
            return Text(self.take().place, unescaped(token))
        if token.kind == "typed" and token.text.upper().partition("#")[0] not in TYPES:
            kind, _, value = self.take().text.upper().partition("#")
            return Enumerated(token.place, kind, value)
        if token.kind in ("integer", "based", "real", "time", "date", "typed"):
            return literal(self.take())
        after = self.tokens[min(self.at + 1, len(self.tokens) - 1)].word
        named = token.word in ("AND", "OR", "XOR", "MOD") and after == "("
        name = (self.take() if named else self.name(what)).text.upper()
        if self.accept("("):
            return Call(token.place, name, self.arguments())
        return Name(token.place, name, self.path(token.text))

    def path(self, shown: str) -> tuple[Indexed | Member, ...]:
        """What follows a variable's name: indices, members."""
        found: list[Indexed | Member] = []
        while True:
            place = self.next.place
            if self.accept("["):
                indices = [self.expression()]
                while self.accept(","):
                    indices.append(self.expression())
                self.expect("]", f"or ',' after the index of {shown}")
                found.append(Indexed(place, tuple(indices)))
            elif self.accept("."):
                name = self.name(f"a member or an output of {shown}")
                found.append(Member(name.place, name.text.upper()))
                shown = name.text
            else:
                return tuple(found)

    def arguments(self) -> tuple[Argument, ...]:
        found: list[Argument] = []
        while not self.accept(")"):
            if found:
                self.expect(",", "or ')' after an argument")
            place, name, output = self.next.place, None, False
            if self.tokens[min(self.at + 1, len(self.tokens) - 1)].word in (":=", "=>"):
                name = self.name("the name of an argument").text.upper()
                output = self.take().word == "=>"
            found.append(Argument(place, name, self.expression(), output))
        return tuple(found)


# ---- literals ----------------------------------------------------------------------------------------


def literal(token: Token) -> Literal:
    text = token.text.replace("_", "")
    if token.kind == "real":
        return Literal(token.place, None, float(text))
    if token.kind == "time":
        return Literal(token.place, "TIME", duration(token))
    if token.kind == "date":
        return Literal(token.place, "DATE_AND_TIME", date(token))
    if token.kind != "typed":
        return Literal(token.place, None, whole(token, text))
    kind, _, digits = token.text.upper().partition("#")
    try:
        if kind == "BOOL":
            return Literal(token.place, kind, {"0": False, "1": True, "FALSE": False, "TRUE": True}[digits])
        if kind in ("REAL", "LREAL"):
            return Literal(token.place, kind, float(digits.replace("_", "")))
    except (KeyError, ValueError):
        raise SourceError(token.place, f"{token.text} is no {kind}") from None
    return Literal(token.place, kind, whole(token, digits.replace("_", "")))


def unescaped(token: Token) -> str:
    """$' is ', $$ is $: what a line of the log can have."""
    text = re.sub(r"\$(.)", lambda found: found[1] if found[1] in "'$" else "\0", token.text[1:-1])
    if not text.isprintable():
        raise SourceError(token.place, "a text has printable characters, $' and $$; it is one line")
    return text


def whole(token: Token, text: str) -> int:
    base, mark, digits = text.partition("#")
    try:
        return int(digits, int(base)) if mark else int(text)
    except ValueError:
        raise SourceError(token.place, f"{token.text} is not a number") from None


def duration(token: Token) -> int:
    text = token.text.partition("#")[2].replace("_", "").lower()
    negative, text = text.startswith("-"), text.lstrip("-")
    parts = re.findall(r"([0-9]+(?:\.[0-9]+)?)(ms|us|d|h|m|s)", text)
    if "".join(number + unit for number, unit in parts) != text or not parts:
        raise SourceError(token.place, f"{token.text} is not a duration; write T#1d2h3m4s5ms, or T#1.5s")
    total = sum(round(float(number) * UNITS[unit]) for number, unit in parts)
    return -total if negative else total


def date(token: Token) -> int:
    found = re.fullmatch(
        r"(\d{4})-(\d\d?)-(\d\d?)-(\d\d?):(\d\d?):(\d\d?(?:\.\d+)?)", token.text.partition("#")[2]
    )
    if found is None:
        raise SourceError(token.place, f"{token.text} is not a date and time; write DT#2026-01-31-12:30:00")
    year, month, day, hour, minute = (int(found[i]) for i in range(1, 6))
    if not (
        1 <= month <= 12 and 1 <= day <= calendar.monthrange(year, month)[1] and hour < 24 and minute < 60
    ):
        raise SourceError(token.place, f"{token.text} is not a date and time")
    return calendar.timegm((year, month, day, hour, minute, 0)) * 1_000_000 + round(
        float(found[6]) * 1_000_000
    )
