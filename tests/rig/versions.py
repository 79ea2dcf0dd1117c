# SPDX-License-Identifier: GPL-3.0-or-later
"""Versions of one release and its neighbours, by which each tool's order is judged."""

IN_ORDER = (
    "0.1.0",
    "1.0.0-rc1",
    "1.0.0-rc2",
    "1.0.0-rc10",
    "1.0.0",
    "1.0.1-rc1",
    "1.0.1",
)  # the oldest first
