# SPDX-License-Identifier: GPL-3.0-or-later
"""The subcommand `flash`: images into a board's NAND, with a backup, a journal and a way back.

layout (where things are), images (what a file must be), backup and steps (what is done to a board), plan (in
which order), flasher with its journal (doing it, going on after an interruption), command (the options).
"""
