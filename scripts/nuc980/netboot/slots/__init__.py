# SPDX-License-Identifier: GPL-3.0-or-later
"""Two slots in a board's flash, and a boot command that falls back by itself: `install` and `slots`.

layout (where things are), script (the boot command, made for a board), marks (the pages that say which slot
boots), command (the options).
"""
