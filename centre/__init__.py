# SPDX-License-Identifier: GPL-3.0-or-later
"""The control centre: stores what rtu-centre hands over, serves it, and commands. docs/control-centre.md."""
