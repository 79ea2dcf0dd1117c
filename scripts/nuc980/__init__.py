# SPDX-License-Identifier: GPL-3.0-or-later
"""Tools for boards with a Nuvoton NUC980."""

from pathlib import Path

_HERE = Path(__file__).resolve().parent

# In the tree these lead by links to the files that it has once; pip installs copies.
VERSION = (_HERE / "VERSION").read_text(encoding="utf-8").strip()
PIN_TABLE = (_HERE / "board" / "gateway" / "pins.yml").resolve()
IMAGE_LIMITS = (_HERE / "board" / "gateway" / "image-limits.toml").resolve()
