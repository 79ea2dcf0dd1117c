# SPDX-License-Identifier: GPL-3.0-or-later
"""The twin: QEMU's machine nuc980, started and looked into from Python."""
