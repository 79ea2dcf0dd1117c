# SPDX-License-Identifier: GPL-3.0-or-later
"""As much of U-Boot's hush (common/cli_hush.c) as a line of commands needs; and its simple parser instead."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

MARK = "\x03"  # around a variable's name, as in the original
NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*|\{[^}]*\}|\?")


class SyntaxFault(Exception):
    """What hush calls a syntax error."""


class Unfinished(Exception):
    """A quote is open: hush asks for another line."""


@dataclass
class Word:
    text: str = ""
    quoted: bool = False


@dataclass
class Command:
    words: list[Word] = field(default_factory=list)
    follow: str = ";"

    @property
    def has_variable(self) -> bool:
        return any(MARK in word.text for word in self.words)


def parse(line: str, again: bool = False) -> list[Command]:
    """The commands of a line. again: the second pass, over a line whose variables have their values."""
    commands = [Command()]
    word: Word | None = None
    quote = False
    at = 0

    def end_word() -> None:
        nonlocal word
        if word is not None and (word.text or word.quoted):
            word.text = re.sub(r"\\(.)", r"\1", word.text, flags=re.DOTALL)
            commands[-1].words.append(word)
        word = None

    while at < len(line):
        key = line[at]
        at += 1
        if key in " \t" and not quote:
            end_word()
            continue
        if key in ";&|" and not quote and not again:
            end_word()
            follow = key
            if key != ";":
                if line[at : at + 1] != key:
                    raise SyntaxFault
                at += 1
                follow = key * 2
            commands[-1].follow = follow
            commands.append(Command())
            continue
        if key == "#" and not quote and not again and not (word and word.text):
            break
        word = word or Word()
        if key == "\\":
            if at == len(line):
                raise SyntaxFault
            word.text += ("\\\\" if quote else "\\") + _protected(line[at], quote)
            at += 1
        elif key == '"':
            word.quoted, quote = True, not quote
        elif key == "'":
            word.quoted = True
            end = line.find("'", at)
            if end < 0:
                raise Unfinished
            word.text += line[at:end]
            at = end + 1
        elif key == "$" and not again and (name := NAME.match(line, at)):
            word.text += MARK + name[0].strip("{}") + MARK
            at = name.end()
        else:
            word.text += _protected(key, quote)
    if quote:
        raise Unfinished
    end_word()
    return commands


def _protected(key: str, quote: bool) -> str:
    return "\\" + key if quote and key in "*?[\\" else key


class Hush:
    """Runs lines. call: runs a command by its words and says its exit status."""

    def __init__(self, variables: Mapping[str, str], call: Callable[[list[str]], int]) -> None:
        self._variables = variables
        self._call = call
        self.status = 0

    def run(self, line: str) -> int:
        """The last command's status; Unfinished when a quote is open."""
        skip = False
        for command in parse(line):
            if command.words and not skip:
                self.status = 1 if self._run(command) else 0
                skip = command.follow == ("||" if self.status == 0 else "&&")
            elif command.follow == ";":
                skip = False
        return self.status

    def _run(self, command: Command) -> int:
        if not command.has_variable:
            return self._call([word.text for word in command.words])
        line = " ".join(
            f"'{self._valued(word.text)}'" if word.quoted else self._valued(word.text)
            for word in command.words
        )
        words = [word.text for again in parse(line, again=True) for word in again.words]
        return self._call(words) if words else 0

    def _valued(self, text: str) -> str:
        def value(name: re.Match[str]) -> str:
            return str(self.status) if name[1] == "?" else self._variables.get(name[1], "")

        return re.sub(f"{MARK}(.*?){MARK}", value, text, flags=re.DOTALL)


class SimpleParser(Hush):
    """A build without CONFIG_HUSH_PARSER: `;` and ${name} only. It knows no `$?`, so it echoes it."""

    def run(self, line: str) -> int:
        for part in re.split(r"(?<!\\);", line):
            text = re.sub(r"\$[{(](\w+)[)}]", lambda name: self._variables.get(name[1], ""), part)
            words = [quoted or plain for quoted, plain in re.findall(r"'([^']*)'|(\S+)", text)]
            if words:
                self.status = self._call(words)
        return self.status
