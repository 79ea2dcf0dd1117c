# SPDX-License-Identifier: GPL-3.0-or-later
"""The boards that this tree knows: a folder for each in board/nuc980/boards."""

from __future__ import annotations

from pathlib import Path

from nuc980 import PIN_TABLE
from nuc980.errors import UnusableInput

BOARDS = PIN_TABLE.parent.parent
GATEWAY = "gateway"
TABLE = PIN_TABLE.name


def board_names() -> list[str]:
    """All boards, the default first."""
    names = {table.parent.name for table in BOARDS.glob(f"*/{TABLE}")}
    return [GATEWAY, *sorted(names - {GATEWAY})]


def pin_table(board: str) -> Path:
    """The file with a board's pin table. Raises UnusableInput for a board that the tree does not have."""
    if board not in board_names():
        raise UnusableInput(f"there is no board {board}; boards are {', '.join(board_names())}")
    return BOARDS / board / TABLE


def table_path(board: str) -> str:
    """The same file, from the tree's root."""
    return f"board/nuc980/boards/{board}/{TABLE}"
