# SPDX-License-Identifier: GPL-3.0-or-later
"""The boards that this tree knows: the gateway, and a folder for each other one in board/nuc980/boards."""

from __future__ import annotations

from pathlib import Path

from nuc980 import PIN_TABLE
from nuc980.errors import UnusableInput

GATEWAY = "gateway"  # its files are in board/nuc980 itself
OTHERS = PIN_TABLE.parent / "boards"
TABLE = "pins.yml"


def board_names() -> list[str]:
    """All boards, the default first."""
    return [GATEWAY, *sorted(table.parent.name for table in OTHERS.glob(f"*/{TABLE}"))]


def pin_table(board: str) -> Path:
    """The file with a board's pin table. Raises UnusableInput for a board that the tree does not have."""
    if board not in board_names():
        raise UnusableInput(f"there is no board {board}; boards are {', '.join(board_names())}")
    return PIN_TABLE if board == GATEWAY else OTHERS / board / TABLE


def table_path(board: str) -> str:
    """The same file, from the tree's root."""
    return f"board/nuc980/{TABLE}" if board == GATEWAY else f"board/nuc980/boards/{board}/{TABLE}"
