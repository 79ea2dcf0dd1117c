# SPDX-License-Identifier: GPL-3.0-or-later
"""Boot and flash a NUC980 board over its debug UART and Ethernet: docs/netboot.md.

From below; a file knows those above it in this list, and none below. All know `errors`.

facts         limits, board (what a board is, the factory's), uimage, site, commandline (what is typed)
host's side   transport (serial port), power, tftp, host (addresses), progress
console       arrival (to the prompt), console (a command and its status), linux (what a kernel says)
session       what a plan runs on: a console, a server for files, how board and host reach each other
plan          a pure value: steps, and the lines that they type; it knows `commandline` only
work          steps (loading), environment, probe, boot: steps and plans of one subject each
flash/        layout, images, journal; backup, steps, plan; resume; flasher, which does it
for users     report, terminal; target (the library), fixture (pytest); run, flash/command, cli

A plan is made of facts alone: nothing is asked and nothing opened, so that a dry run shows what a run types.
"""
