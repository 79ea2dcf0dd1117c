# SPDX-License-Identifier: GPL-3.0-or-later
"""What is typed at a terminal that does not show it."""

import getpass
import warnings

from nuc980.errors import UnusableInput


def secret(prompt: str, otherwise: str) -> str:
    """otherwise: the next step where there is no terminal. Raises EOFError when nothing is typed."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", getpass.GetPassWarning)
        try:
            return getpass.getpass(prompt)
        except getpass.GetPassWarning:
            raise UnusableInput("there is no terminal to type at", next_step=otherwise) from None
