# SPDX-License-Identifier: GPL-3.0-or-later
"""What a user can do something about."""


class UnusableInput(Exception):
    """A file or word that cannot be used. The message names it, the cause and the next step."""
