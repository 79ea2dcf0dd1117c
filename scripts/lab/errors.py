# SPDX-License-Identifier: GPL-3.0-or-later
"""What all errors of a show have in common."""

from __future__ import annotations


class LabError(Exception):
    """Something did not happen as expected.

    `expected` and `seen` are a line each, `advice` is the probable cause and what to type. The first and the
    last are empty where they are not known. `late`: it did not happen in time, so a busy machine may be the
    cause. str() has more lines where an engineer wants them.
    """

    def __init__(
        self, text: str, *, expected: str = "", seen: str = "", advice: str = "", late: bool = False
    ) -> None:
        super().__init__(text)
        self.expected = expected
        self.seen = seen or text.partition("\n")[0]
        self.advice = advice
        self.late = late
