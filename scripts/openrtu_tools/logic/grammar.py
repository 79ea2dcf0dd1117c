# SPDX-License-Identifier: GPL-3.0-or-later
"""An extension of editors that colours Structured Text: a TextMate grammar of the compiler's own words."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path

from nuc980 import VERSION
from openrtu_tools.logic.compile import library
from openrtu_tools.logic.parser import KEYWORDS
from openrtu_tools.logic.types import ALIASES, TYPES
from openrtu_tools.logic.values import BUILT_IN, OF_TEXTS

OPERATORS = ("AND", "OR", "XOR", "NOT", "MOD")
CONSTANTS = ("TRUE", "FALSE")
NAME = "structured-text"


def words(scope: str, names: Iterable[str]) -> dict[str, str]:
    return {"name": f"{scope}.{NAME}", "match": rf"(?i)\b(?:{'|'.join(sorted(names))})\b"}


def grammar() -> dict[str, object]:
    """In this order: what is found first counts."""
    blocks = [unit.name for unit in library() if unit.kind == "FUNCTION_BLOCK"]
    functions = [
        *BUILT_IN,
        *OF_TEXTS,
        *(unit.name for unit in library() if unit.kind == "FUNCTION"),
        "MESSAGE",
    ]
    sections = ("VAR", "PROGRAM", "FUNCTION", "TYPE", "STRUCT")
    storage = {word for word in KEYWORDS if word.removeprefix("END_").startswith(sections)} | {
        "CONSTANT",
        "RETAIN",
        "ARRAY",
    }
    control = KEYWORDS - storage - {*OPERATORS, *CONSTANTS}
    patterns: list[dict[str, object]] = [
        {"name": f"comment.line.{NAME}", "match": "//.*$"},
        {"name": f"comment.block.{NAME}", "begin": r"\(\*", "end": r"\*\)"},
        {
            "name": f"string.quoted.single.{NAME}",
            "begin": "'",
            "end": "'|$",
            "patterns": [
                {"name": f"constant.character.escape.{NAME}", "match": r"\$."},
                {"name": f"constant.other.placeholder.{NAME}", "match": r"\{\}"},
            ],
        },
        {
            "name": f"constant.numeric.{NAME}",
            "match": r"(?i)\b(?:(?:TIME|T|DATE_AND_TIME|DT)#-?[0-9][0-9A-Z_.:\-]*"
            r"|(?:[A-Z]\w*#)?(?:2|8|16)#[0-9A-F_]+|(?:[A-Z]\w*#)?[0-9][0-9_]*(?:\.[0-9][0-9_]*)?(?:E[+-]?[0-9]+)?)(?![0-9A-Z_])",
        },
        {"name": f"constant.other.enumeration.{NAME}", "match": r"(?i)\b[A-Z_]\w*#[A-Z_]\w*"},
        words("constant.language", CONSTANTS),
        words("keyword.operator.word", OPERATORS),
        words("storage.modifier", storage),
        words("keyword.control", control),
        words("storage.type", ["STRING", *TYPES, *ALIASES]),
        words("support.class", blocks),
        {"name": f"support.function.{NAME}", "match": r"(?i)\b[A-Z]\w*_TO_\w+(?=\s*\()"},
        {**words("support.function", functions), "match": words("", functions)["match"] + r"(?=\s*\()"},
        {"name": f"keyword.operator.{NAME}", "match": r":=|=>|<>|<=|>=|\*\*|\.\.|[-+*/&=<>]"},
    ]
    return {
        "name": "Structured Text",
        "scopeName": f"source.{NAME}",
        "fileTypes": ["st"],
        "patterns": patterns,
    }


def write(directory: Path) -> list[Path]:
    """The extension: what Visual Studio Code loads, and JetBrains' editors as a TextMate bundle."""
    directory.mkdir(parents=True, exist_ok=True)
    contributes = {
        "languages": [{"id": NAME, "extensions": [".st"], "configuration": "./language-configuration.json"}],
        "grammars": [{"language": NAME, "scopeName": f"source.{NAME}", "path": "./st.tmLanguage.json"}],
    }
    package = {
        "name": f"openrtu-{NAME}",
        "publisher": "openrtu",
        "version": VERSION,
        "engines": {"vscode": "^1.50.0"},
        "contributes": contributes,
    }
    brackets = [["(", ")"], ["[", "]"]]
    configuration = {
        "comments": {"lineComment": "//", "blockComment": ["(*", "*)"]},
        "brackets": brackets,
        "autoClosingPairs": [*brackets, ["(*", "*)"]],
    }
    files = {
        "package.json": package,
        "language-configuration.json": configuration,
        "st.tmLanguage.json": grammar(),
    }
    for name, content in files.items():
        (directory / name).write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    return [directory / name for name in files]
