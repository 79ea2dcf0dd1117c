# SPDX-License-Identifier: GPL-3.0-or-later
"""How a U-Boot lets somebody in: what stops autoboot, its password, its prompt; as labgrid's UBootDriver."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

from nuc980.asked import secret
from nuc980.netboot.errors import UnusableInput

# Of CONFIG_AUTOBOOT_KEYED too, whose default is "Autoboot in %d seconds": its text is free.
AUTOBOOT = r"(?i:autoboot)"
ANY_KEY = re.compile(rb"any key|ctrl[-+ ]?c\b|\^C", re.IGNORECASE)  # Ctrl-C does
PASSWORD_PROMPT = r"(?i:password|passphrase|passwd)[^\n]{0,20}[:?>] *$"
FROM_TERMINAL = Path("-")


@dataclass(frozen=True)
class Entrance:
    """Regular expressions; an empty one: the usual ones. interrupt, password: what is typed, in bytes."""

    prompt: str = ""
    autoboot: str = ""
    interrupt: bytes = field(default=b"", repr=False)
    password_prompt: str = ""
    password: bytes = field(default=b"", repr=False)

    @property
    def interrupt_keys(self) -> bytes:
        """What stops autoboot, if Ctrl-C does not: the string itself, else the password.

        An Enter behind the password is for CONFIG_AUTOBOOT_ENCRYPTION, which waits for one; where the string
        alone counts, it comes to an empty prompt.
        """
        return self.interrupt or self.password_keys

    @property
    def password_keys(self) -> bytes:
        """What answers a password prompt."""
        return self.password and self.password + b"\r"

    def autoboot_line(self, words: bytes) -> re.Match[bytes] | None:
        """The line that says how autoboot is stopped."""
        return re.search(rb"^[^\n]*(?:%s)[^\n]*" % (self.autoboot or AUTOBOOT).encode(), words, re.MULTILINE)

    def keyed_line(self, words: bytes) -> bytes:
        """The same, if Ctrl-C does not stop this one; else an empty text."""
        found = self.autoboot_line(words)
        return found[0] if found and (self.interrupt or not ANY_KEY.search(found[0])) else b""

    def asks_password(self, words: bytes) -> bool:
        """Whether the last words do."""
        last = words.rpartition(b"\n")[2]
        return bool(re.search((self.password_prompt or PASSWORD_PROMPT).encode(), last))

    def prompt_in(self, words: bytes) -> re.Match[bytes] | None:
        """The prompt at the end, if it was named; group 1."""
        return re.search(rb"(?:^|\n)(%s)\Z" % self.prompt.encode(), words) if self.prompt else None


OPEN = Entrance()  # to anybody who presses Ctrl-C


def read_password(file: Path) -> bytes:
    """The first line of a file, or what is typed at the terminal for "-". Raises UnusableInput."""
    if file == FROM_TERMINAL:
        try:
            line = secret("U-Boot's password: ", "name a file whose first line it is: --password-file FILE")
        except EOFError:
            raise UnusableInput("--password-file -: no password was typed") from None
    else:
        try:
            line = file.read_text(encoding="utf-8").partition("\n")[0].rstrip("\r")
        except (OSError, UnicodeDecodeError) as error:
            raise UnusableInput(f"{file}: {getattr(error, 'strerror', None) or 'is no text'}") from error
    if not line or not line.isascii() or not line.isprintable():
        where = "The password" if file == FROM_TERMINAL else str(file)
        raise UnusableInput(f"{where}: must be one line of printable ASCII")
    return line.encode()


def keys_of(text: str) -> bytes:
    r"""What is typed for a text with \xHH, \r, \n, \t and \\. Raises ValueError."""
    escapes = {"r": "\r", "n": "\n", "t": "\t", "\\": "\\"}

    def key(found: re.Match[str]) -> str:
        if found[1]:
            return chr(int(found[1], 16))
        if found[2] not in escapes:
            raise ValueError(rf"{found[0]!r} is none of \xHH, \r, \n, \t and \\")
        return escapes[found[2]]

    keys = re.sub(r"\\(?:x([0-9a-fA-F]{2})|(.?))", key, text)
    if not keys or not keys.isascii():
        raise ValueError("it must be ASCII, and not empty")
    return keys.encode("ascii")
