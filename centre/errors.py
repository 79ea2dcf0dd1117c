# SPDX-License-Identifier: GPL-3.0-or-later
"""What a user is told."""

from __future__ import annotations

from nuc980.errors import ToolError


class CentreError(ToolError):
    """Says the cause, and what to do."""


class RefusedError(CentreError):
    """A request that the centre does not do. `status` is HTTP's; the page has words for `code`."""

    def __init__(self, status: int, code: str, text: str, wait_s: float = 0.0) -> None:
        super().__init__(text)
        self.status = status
        self.code = code
        self.wait_s = wait_s  # then it may be asked again


class StoreError(CentreError):
    """The database did not do it; nothing of it is stored. It may be done again."""
