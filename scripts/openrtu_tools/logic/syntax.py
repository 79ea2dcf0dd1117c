# SPDX-License-Identifier: GPL-3.0-or-later
"""The tree of a program's text. Names are in capitals: the language does not tell small letters from them."""

from __future__ import annotations

from dataclasses import dataclass, field

from openrtu_tools.logic.errors import Place


@dataclass(frozen=True)
class Literal:
    place: Place
    type: str | None  # None: a number that takes the type of where it stands
    value: int | float | bool


@dataclass(frozen=True)
class Indexed:
    """Of an array: [i, j]."""

    place: Place
    indices: tuple[Expression, ...]


@dataclass(frozen=True)
class Member:
    """Of a structure, or of a block's instance: .name."""

    place: Place
    name: str


@dataclass(frozen=True)
class Name:
    place: Place
    name: str
    path: tuple[Indexed | Member, ...] = ()


@dataclass(frozen=True)
class Enumerated:
    """A value of an enumeration, with its type: MODE#AUTO."""

    place: Place
    type: str
    name: str


@dataclass(frozen=True)
class Unary:
    place: Place
    operator: str
    operand: Expression


@dataclass(frozen=True)
class Binary:
    place: Place
    operator: str
    left: Expression
    right: Expression


@dataclass(frozen=True)
class Argument:
    place: Place
    name: str | None
    value: Expression
    output: bool  # NAME => variable


@dataclass(frozen=True)
class Call:
    place: Place
    name: str
    arguments: tuple[Argument, ...]
    path: tuple[Indexed | Member, ...] = ()  # to a block of an array


@dataclass(frozen=True)
class Text:
    """'…', a STRING, or what a MESSAGE says."""

    place: Place
    text: str


Expression = Literal | Name | Enumerated | Text | Unary | Binary | Call


@dataclass(frozen=True)
class Listed:
    """Initial values of an array; each group as often as its count says: [1, 3(0)]."""

    place: Place
    groups: tuple[tuple[int, tuple[Initial, ...]], ...]


@dataclass(frozen=True)
class Filled:
    """Initial values of a structure: (x := 1, y := 2)."""

    place: Place
    members: tuple[tuple[Member, Initial], ...]


Initial = Expression | Listed | Filled


@dataclass(frozen=True)
class Spelled:
    """A type where it is used: its name, behind the bounds if it is an array of that."""

    place: Place
    name: str
    bounds: tuple[tuple[Expression, Expression], ...] = ()
    length: Expression | None = None  # of a STRING


@dataclass(frozen=True)
class Assign:
    place: Place
    target: Name
    value: Expression


@dataclass(frozen=True)
class If:
    place: Place
    branches: tuple[tuple[Expression, tuple[Statement, ...]], ...]
    otherwise: tuple[Statement, ...]


@dataclass(frozen=True)
class Case:
    place: Place
    selector: Expression
    branches: tuple[tuple[tuple[tuple[Expression, Expression | None], ...], tuple[Statement, ...]], ...]
    otherwise: tuple[Statement, ...]


@dataclass(frozen=True)
class For:
    place: Place
    variable: Name
    first: Expression
    last: Expression
    step: Expression | None
    body: tuple[Statement, ...]


@dataclass(frozen=True)
class While:
    place: Place
    condition: Expression
    body: tuple[Statement, ...]


@dataclass(frozen=True)
class Repeat:
    place: Place
    body: tuple[Statement, ...]
    until: Expression


@dataclass(frozen=True)
class Leave:
    place: Place
    word: str  # EXIT, CONTINUE or RETURN


Statement = Assign | Call | If | Case | For | While | Repeat | Leave


@dataclass(frozen=True)
class Variable:
    place: Place
    name: str
    section: str  # VAR, VAR_INPUT, …; STRUCT of a structure's member
    type: Spelled
    initial: Initial | None = None
    constant: bool = False
    retain: bool = False
    spelling: str = ""  # as it was typed: a point's name has small letters


@dataclass(frozen=True)
class Choice:
    """A value of an enumeration where it is declared."""

    place: Place
    name: str
    spelling: str
    number: Expression | None


@dataclass(frozen=True)
class Declared:
    """Of TYPE: an enumeration, a structure, or another name of a type."""

    place: Place
    name: str
    what: tuple[Choice, ...] | tuple[Variable, ...] | Spelled
    initial: Initial | None = None
    spelling: str = ""


@dataclass
class Unit:
    """A PROGRAM, FUNCTION or FUNCTION_BLOCK."""

    place: Place
    kind: str
    name: str
    result: Spelled | None = None
    variables: list[Variable] = field(default_factory=list)
    body: tuple[Statement, ...] = ()
    library: bool = False
