# SPDX-License-Identifier: GPL-3.0-or-later
"""What to type when a Python package is missing."""

import sys
from pathlib import Path

CLONE = Path(__file__).resolve().parents[2]


def what_to_type(error: ModuleNotFoundError, extra: str) -> str:
    """One line. Raises the error again where no extra brings the module: that is a fault of ours."""
    if not error.name or not extra:
        raise error
    command = f"{sys.executable} -m pip install 'openrtu-tools[{extra}]'"
    if (CLONE / "pyproject.toml").is_file():
        command = f"make -C {CLONE} tools"
    return f"the Python package {error.name.partition('.')[0]} is missing; type: {command}"
