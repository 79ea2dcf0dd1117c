# SPDX-License-Identifier: GPL-3.0-or-later
"""Numbers by their words.

Made by `make codes` from the headers of C; do not edit.
"""

# A value's qualities, the worst first: bits.
QUALITIES = {
    "invalid": 0x80,
    "not topical": 0x40,
    "substituted": 0x20,
    "blocked": 0x10,
    "overflow": 0x01,
}

# Types of points.
TYPES = {
    "single": 0,
    "double": 1,
    "step": 2,
    "bitstring": 3,
    "normalized": 4,
    "scaled": 5,
    "float": 6,
    "counter": 7,
    "integer": 8,
    "angle": 9,
}
