# SPDX-License-Identifier: GPL-3.0-or-later
"""What fits the gateway's memory and flash: its image-limits.toml, which both images obey."""

from __future__ import annotations

import tomllib

from nuc980 import IMAGE_LIMITS

_LIMITS = tomllib.loads(IMAGE_LIMITS.read_text(encoding="utf-8"))

# Of the board, bytes.
MEMORY: int = _LIMITS["memory"]["size"]
FLASH: int = _LIMITS["flash"]["size"]
BLOCK: int = _LIMITS["flash"]["block"]
PAGE: int = _LIMITS["flash"]["page"]

# In RAM: the whole uImage, the kernel in it, which runs there, and the device tree.
UIMAGE_AT: int = _LIMITS["memory"]["uimage"]
ENTRY: int = _LIMITS["memory"]["entry"]
DEVICE_TREE_AT: int = _LIMITS["memory"]["device_tree"]

# In the flash, bytes: the device tree's partition for UBI.
ROOT_OFFSET: int = _LIMITS["flash"]["root"]["offset"]
ROOT_SIZE: int = _LIMITS["flash"]["root"]["size"]
ROOT_VOLUME: int = _LIMITS["flash"]["root"]["volume"]
# Of boards with slots: tables of places, by slot and by mark.
SLOTS: dict[str, dict[str, dict[str, int]]] = _LIMITS["flash"]["slots"]
MARKS: dict[str, dict[str, int]] = _LIMITS["flash"]["marks"]
