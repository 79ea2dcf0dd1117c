# SPDX-License-Identifier: GPL-3.0-or-later
"""The one right answer to a finding, written into a source; kept only if nothing else is found then."""

from __future__ import annotations

import difflib
import os
import re
import shutil
import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from nuc980.errors import UnusableInput
from nuc980.pins.findings import Finding, Fix

Check = Callable[[Path], Sequence[Finding]]
CODING = ("utf-8", "surrogateescape")  # bytes come back as they were
UNPRINTED = re.compile(r"(?!\r\n)[^\n\t]")  # but for the ends of lines, which patch compares
NO_END = "\n\\ No newline at end of file\n"


@dataclass(frozen=True)
class Mended:
    """A source, before and after."""

    file: Path
    before: str
    after: str

    def diff(self) -> str:
        """For people, and for patch."""
        lines = difflib.unified_diff(
            _lines(self.before), _lines(self.after), str(self.file), str(self.file), lineterm="\n"
        )
        text = "".join(line if line.endswith("\n") else f"{line}{NO_END}" for line in lines)
        return UNPRINTED.sub(lambda found: found[0] if found[0].isprintable() else "?", text)

    def write(self) -> None:
        """All of it or nothing, unless the file has another name or owner; a link stays one."""
        target = self.file.resolve()
        was = target.stat()
        if not was.st_mode & 0o222:
            raise UnusableInput(
                f"{self.file} is read-only; make it writable (chmod u+w), or patch with the diff"
            )
        if was.st_nlink > 1 or (was.st_uid, was.st_gid) != (os.geteuid(), os.getegid()):
            target.write_bytes(self.after.encode(*CODING))
            return
        handle, name = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.")
        try:
            with os.fdopen(handle, "wb") as stream:
                stream.write(self.after.encode(*CODING))
            shutil.copymode(target, name)
            Path(name).replace(target)
        except BaseException:
            Path(name).unlink(missing_ok=True)
            raise


def mended(file: Path, findings: Sequence[Finding], check: Check) -> Mended:
    """
    The source without the findings that have one right answer in one of its own lines: what an included file
    says stays. `check` tells the findings of a changed copy, which has the same includes; an answer that
    leaves its finding, or brings another one, is not taken.
    """
    before = text = file.read_bytes().decode(*CODING)
    answers = [
        (place.line, finding.fix)
        for finding in findings
        if finding.fix
        and (place := finding.fix.place or finding.place)
        and Path(place.file).resolve() == file.resolve()
        and not finding.accepted
    ]
    found = _counted(findings)
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / file.name
        for line, fix in sorted(dict.fromkeys(answers), key=lambda answer: -answer[0]):  # lines above stay
            changed = _changed(text, line, fix)
            if changed is None:
                continue
            copy.write_bytes(changed.encode(*CODING))
            left = _counted(check(copy))
            if left < found:
                text, found = changed, left
    return Mended(file, before, text)


def _counted(findings: Sequence[Finding]) -> Counter[tuple[str, str]]:
    return Counter((finding.rule, finding.node) for finding in findings if not finding.accepted)


def _lines(text: str) -> list[str]:
    """As dtc counts them, with their ends: splitlines knows further ends."""
    return re.findall(r"[^\n]*\n|[^\n]+", text)


def _changed(text: str, number: int, fix: Fix) -> str | None:
    """The text with the answer in a line; None: the line is not written as the answer needs it."""
    new = mended_line(text, number, fix)
    lines = _lines(text)
    return None if new is None else "".join([*lines[: number - 1], new, *lines[number:]])


def mended_line(text: str, number: int, fix: Fix) -> str | None:
    """What becomes of a line: one, two or none; None: it is not written as the answer needs it."""
    lines = _lines(text)
    if not 0 < number <= len(lines):
        return None
    if fix.name is None:
        return _with_statement(lines[number - 1], fix.becomes, _next_indent(lines, number))
    return _replaced(lines[number - 1], fix)


def _replaced(line: str, fix: Fix) -> str | None:
    """With the property's one statement as it becomes; a statement over several lines has no end here."""
    name = re.escape(fix.name or "")
    found = list(re.finditer(rf"(?<![\w#,.+?-]){name}(?![\w#,.+?-])(?P<value>\s*=\s*[^;{{}}]*)?\s*;", line))
    if len(found) != 1:
        return None
    [statement] = found
    becomes = f"{fix.becomes}{statement['value'] or ''};" if fix.keeps_value else fix.becomes
    new = line[: statement.start()] + becomes + line[statement.end() :]
    return new if new.strip() else ""


def _with_statement(line: str, statement: str, indent: str) -> str | None:
    """With a statement behind the one { of a node's first line."""
    if line.count("{") != 1:
        return None
    head, _, rest = line.partition("{")
    if rest.strip():
        return f"{head}{{ {statement}{rest}"
    ending = line[len(line.rstrip("\r\n")) :]
    return f"{line}{indent}{statement}{ending}"


def _next_indent(lines: Sequence[str], number: int) -> str:
    """That of the first line in a node's body."""
    below = next((line for line in lines[number:] if line.strip()), "")
    own = re.match(r"\s*", lines[number - 1])[0]
    indent = re.match(r"[ \t]*", below)[0]
    return indent if len(indent) > len(own) else f"{own}\t"
