# SPDX-License-Identifier: GPL-3.0-or-later
"""As much of U-Boot's hush (common/cli_hush.c) as a line of commands needs; and its simple parser instead."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

MARK = "\x03"  # around a variable's name, as in the original
ASSIGNMENT = re.compile(r"([A-Za-z][A-Za-z0-9_]*)=")
RESERVED = ("if", "then", "elif", "else", "fi")
NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*|\{[^}]*\}|\?")


class SyntaxFault(Exception):
    """What hush calls a syntax error."""


class Unfinished(Exception):
    """A quote or an `if` is open: hush asks for another line."""


@dataclass
class Word:
    text: str = ""
    quoted: bool = False


@dataclass
class Command:
    """follow: what stands after it: `;`, `&&` or `||`."""

    words: list[Word] = field(default_factory=list)
    follow: str = ";"


@dataclass
class If:
    """choices: conditions, each with what is done then; the last condition may be missing, an `else`."""

    choices: list[tuple[Sequence[Node] | None, Sequence[Node]]]
    follow: str = ";"


Node = Command | If


def tokens(line: str, again: bool = False) -> list[Word | str]:
    """Words, and between them `;`, `&&`, `||`. again: the second pass, over the values of variables."""
    found: list[Word | str] = []
    word: Word | None = None
    quote = False
    at = 0

    def end_word() -> None:
        nonlocal word
        if word is not None and (word.text or word.quoted):
            word.text = re.sub(r"\\(.)", r"\1", word.text, flags=re.DOTALL)
            found.append(word)
        word = None

    while at < len(line):
        key = line[at]
        at += 1
        if key in " \t" and not quote:
            end_word()
        elif key == "\n" and not quote:
            end_word()
            found.append(";")
        elif key in ";&|" and not quote and not again:
            end_word()
            if key != ";" and line[at : at + 1] != key:
                raise SyntaxFault
            found.append(key if key == ";" else key * 2)
            at += key != ";"
        elif key == "#" and not quote and not again and not (word and word.text):
            at = line.find("\n", at) if "\n" in line[at:] else len(line)
        else:
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
                    raise SyntaxFault if again else Unfinished
                word.text += line[at:end]
                at = end + 1
            elif key == "$" and not again and (name := NAME.match(line, at)):
                word.text += MARK + name[0].strip("{}") + MARK
                at = name.end()
            else:
                word.text += _protected(key, quote)
    if quote and not again:
        raise Unfinished
    if quote and word:
        word.text += "\n"  # the second pass has its line end in the quotes
    end_word()
    return found


def _protected(key: str, quote: bool) -> str:
    return "\\" + key if quote and key in "*?[\\" else key


class Parser:
    """Nodes of tokens: commands, and `if` up to its `fi`."""

    def __init__(self, line: str) -> None:
        self._tokens = tokens(line)

    def nodes(self) -> list[Node]:
        """Of a whole line."""
        found = self._list(())
        if self._tokens:
            raise SyntaxFault
        return found

    def _list(self, ends: Sequence[str]) -> list[Node]:
        """Up to one of these reserved words, which stays; without any, up to the line's end."""
        found: list[Node] = []
        while self._tokens:
            reserved = self._reserved()
            if reserved in ends:
                return found
            if reserved == "if":
                found.append(self._if())
            elif reserved:
                raise SyntaxFault
            else:
                found.append(self._command())
        if ends:
            raise Unfinished
        return found

    def _if(self) -> If:
        self._tokens.pop(0)
        choices: list[tuple[Sequence[Node] | None, Sequence[Node]]] = []
        end = "if"
        while end in ("if", "elif"):
            condition = self._list(("then",))
            self._tokens.pop(0)
            does = self._list(("elif", "else", "fi"))
            choices.append((condition, does))
            end = self._word()
        if end == "else":
            choices.append((None, self._list(("fi",))))
            self._word()
        return If(choices, self._follow())

    def _command(self) -> Command:
        words: list[Word] = []
        while self._tokens and isinstance(self._tokens[0], Word):
            words.append(self._tokens.pop(0))  # type: ignore[arg-type]
        return Command(words, self._follow())

    def _follow(self) -> str:
        if not self._tokens:
            return ";"
        follow = self._tokens.pop(0)
        if not isinstance(follow, str):
            raise SyntaxFault
        return follow

    def _word(self) -> str:
        word = self._tokens.pop(0)
        return word.text if isinstance(word, Word) else word

    def _reserved(self) -> str:
        """The reserved word that is next, or ""."""
        word = self._tokens[0]
        is_one = isinstance(word, Word) and not word.quoted and word.text in RESERVED
        return word.text if is_one else ""


def commands(nodes: Sequence[Node]) -> Iterator[list[str]]:
    """The words of all commands in a line, whether they are run or not."""
    for node in nodes:
        if isinstance(node, Command):
            yield [word.text for word in node.words]
        else:
            for condition, does in node.choices:
                yield from commands(condition or ())
                yield from commands(does)


class Hush:
    """Runs lines. call: runs a command by its words and says its exit status."""

    def __init__(self, variables: Mapping[str, str], call: Callable[[list[str]], int]) -> None:
        self._variables = variables
        self._call = call
        self._own: dict[str, str] = {}
        self.status = 0

    def run(self, line: str) -> int:
        """The last command's status; Unfinished when a quote or an `if` is open."""
        self._run_list(Parser(line).nodes())
        return self.status

    def _run_list(self, nodes: Sequence[Node]) -> None:
        skip = False
        for node in nodes:
            if skip or (isinstance(node, Command) and not node.words):
                skip = skip and node.follow != ";"
                continue
            if isinstance(node, If):
                self._run_if(node)
            else:
                self.status = 1 if self._run_command(node) else 0
            skip = node.follow == ("||" if self.status == 0 else "&&")

    def _run_if(self, node: If) -> None:
        for condition, does in node.choices:
            if condition is not None:
                self._run_list(condition)
            if condition is None or self.status == 0:
                self._run_list(does)
                return

    def _run_command(self, command: Command) -> int:
        typed = list(command.words)
        while typed and (assigned := ASSIGNMENT.match(typed[0].text)):
            value = self._valued(typed.pop(0).text[assigned.end() :])
            if value:
                self._own[assigned[1]] = value
        if not typed:
            return 0
        if not any(MARK in word.text for word in typed):
            return self._call([word.text for word in typed])
        line = " ".join(
            f"'{self._valued(word.text)}'" if word.quoted else self._valued(word.text) for word in typed
        )
        words = [word.text for word in tokens(line, again=True) if isinstance(word, Word)]
        return self._call(words) if words else 0

    def _valued(self, text: str) -> str:
        def value(name: re.Match[str]) -> str:
            if name[1] == "?":
                return str(self.status)
            return self._variables.get(name[1], self._own.get(name[1], ""))

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
