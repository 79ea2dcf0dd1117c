# SPDX-License-Identifier: GPL-3.0-or-later
"""What an attribute of a process picture says: the one place where it is read. docs/process-pictures.md.

What the page gets is read already; js/bound.js only looks values up in it.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from itertools import pairwise
from typing import Any

OF_EDITORS = ("data-name",)  # an editor's own

# Of a quality, as the page finds it; the page's words are in lang/.
QUALITIES = ("invalid", "lost", "never", "not-topical", "substituted", "blocked", "overflow", "good")
# Of the page's own colours, which are others in the dark; `none` paints nothing.
COLOURS = ("text", "muted", "line", "panel", "accent", "good", "old", "bad", "none")
FIELDS = ("value", "unit", "name", "quality", "time")

NUMBER = r"[+-]?\d+(?:\.\d+)?"
CASES_MOST = 64
TEXT_MOST = 200


class BindingError(Exception):
    """Says what is wrong with a text."""


def _name(text: str) -> str:
    if "/" not in text.strip("/"):
        raise BindingError(f"{text[:60]!r} is not STATION/POINT")
    return text


def _command(text: str) -> str:
    return _name(text) if text else ""


def _picture(text: str) -> str:
    if not text.strip():
        raise BindingError("it names no picture")
    return text.strip()


def _template(text: str) -> str:
    if len(text) > TEXT_MOST:
        raise BindingError(f"it has more than {TEXT_MOST} characters")
    for field in re.findall(r"{([^{}]*)}?", text):
        if not re.fullmatch(rf"(?:{'|'.join(FIELDS)})|value:[0-6]", field):
            known = ", ".join(f"{{{each}}}" for each in FIELDS)
            raise BindingError(f"{{{field}}} is none of {known}, {{value:2}}")
    return text or "{value}"


def _condition(text: str) -> Any:
    """A range as [low, high] of which each may be open, a word of a quality, or None for all else."""
    word = text.strip()
    if word == "else":
        return None
    if word in QUALITIES:
        return word
    if re.fullmatch(NUMBER, word):
        return [float(word), float(word)]
    found = re.fullmatch(rf"({NUMBER})?\.\.({NUMBER})?", word)
    if not found or not any(found.groups()):
        known = ", ".join(("else", *QUALITIES))
        raise BindingError(f"{word[:60]!r} is no value (1), no range (5..10, ..5, 80..), and none of {known}")
    low, high = (None if each is None else float(each) for each in found.groups())
    if low is not None and high is not None and low > high:
        raise BindingError(f"{word} ends before it begins")
    return [low, high]


def _conditions(text: str) -> list[Any]:
    conditions = [_condition(each) for each in text.split(",")]
    if None in conditions:
        raise BindingError("else says nothing here: name when it is to be seen")
    return conditions


def _pairs(text: str) -> list[tuple[str, str]]:
    parts = [part for part in text.split(";") if part.strip()]
    if not parts or len(parts) > CASES_MOST:
        raise BindingError(f"1 to {CASES_MOST} of WHEN: WHAT, with ; between them")
    pairs = []
    for part in parts:
        when, colon, what = part.partition(":")
        if not colon:
            raise BindingError(f"{part.strip()[:60]!r} is not WHEN: WHAT")
        pairs.append((when.strip(), what.strip()))
    return pairs


def _colour(text: str) -> str:
    if not re.fullmatch(r"#(?:[0-9a-fA-F]{3}|[0-9a-fA-F]{6})", text) and text not in COLOURS:
        raise BindingError(f"{text[:60]!r} is no colour: #rrggbb, or one of {', '.join(COLOURS)}")
    return text


def _cases(result: Callable[[str], str]) -> Callable[[str], Any]:
    return lambda text: [[_condition(when), result(what)] for when, what in _pairs(text)]


def _scale(count: int) -> Callable[[str], Any]:
    """Between two values it is proportional; beyond the first and last it stays."""

    def read(text: str) -> list[list[float]]:
        steps = []
        for when, what in _pairs(text):
            words = [when, *re.split(r"[\s,]+", what)]
            if len(words) != 1 + count or not all(re.fullmatch(NUMBER, word) for word in words):
                raise BindingError(f"{when}: {what}: not a value and {count} number{'s' * (count > 1)}")
            steps.append([float(word) for word in words])
        if len(steps) < 2 or any(a[0] >= b[0] for a, b in pairwise(steps)):
            raise BindingError("this takes two values or more, each greater than the one before")
        return steps

    return read


def _level(text: str) -> Any:
    steps = _scale(1)(text)
    if any(not 0 <= share <= 1 for _, share in steps):
        raise BindingError("a level is from 0 (empty) to 1 (full)")
    return steps


def _place(text: str) -> list[float]:
    words = re.split(r"[\s,]+", text.strip())
    if len(words) != 2 or not all(re.fullmatch(NUMBER, word) for word in words):
        raise BindingError("this takes two numbers, x and y")
    return [float(word) for word in words]


# Each with how it is read; docs/process-pictures.md says what it does.
ATTRIBUTES: dict[str, Callable[[str], Any]] = {
    "data-point": _name,
    "data-text": _template,
    "data-words": _cases(_template),
    "data-fill": _cases(_colour),
    "data-stroke": _cases(_colour),
    "data-visible": _conditions,
    "data-rotate": _scale(1),
    "data-pivot": _place,
    "data-level": _level,
    "data-move": _scale(2),
    "data-command": _command,
    "data-picture": _picture,
}


def read_binding(name: str, text: str) -> Any:
    """Raises BindingError."""
    return ATTRIBUTES[name](text.strip())
