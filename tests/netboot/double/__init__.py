# SPDX-License-Identifier: GPL-3.0-or-later
"""A board with U-Boot on a pty, for the tests of nuc980-netboot: README.md."""

from . import faults
from .board import Board, Double
from .nand import BLOCK, PAGE, Nand, Operation
from .variant import BOOTCMD, FACTORY_ENVIRONMENT

__all__ = [
    "BLOCK",
    "BOOTCMD",
    "FACTORY_ENVIRONMENT",
    "PAGE",
    "Board",
    "Double",
    "Nand",
    "Operation",
    "faults",
]
