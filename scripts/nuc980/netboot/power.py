# SPDX-License-Identifier: GPL-3.0-or-later
"""A power hook: any command that switches the board off and on."""

from __future__ import annotations

import shlex
import subprocess

from nuc980.netboot.errors import PowerHookFailed, UnusableInput

# Longer than any relay with its pause; shorter than a person's trust.
HOOK_SECONDS = 120.0


class PowerHook:
    """A command line, run without a shell; called, it raises PowerHookFailed with what the command said."""

    def __init__(self, command: str) -> None:
        try:
            self._words = shlex.split(command)
        except ValueError as error:
            raise UnusableInput(f"--power-cycle {command!r}: {error}") from error
        if not self._words:
            raise UnusableInput("--power-cycle needs a command")

    def __call__(self) -> None:
        command = shlex.join(self._words)
        try:
            done = subprocess.run(
                self._words, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=HOOK_SECONDS
            )
        except subprocess.TimeoutExpired as error:
            raise PowerHookFailed(f"'{command}' did not end within {HOOK_SECONDS:g} s.") from error
        except OSError as error:
            raise PowerHookFailed(f"'{command}' cannot be started: {error.strerror}") from error
        if done.returncode:
            output = (done.stderr or done.stdout).strip() or "no message"
            raise PowerHookFailed(f"'{command}' ended with {done.returncode}: {output}")
