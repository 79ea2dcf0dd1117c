# SPDX-License-Identifier: GPL-3.0-or-later
"""The tools for engineers, behind one command, `openrtu`."""
