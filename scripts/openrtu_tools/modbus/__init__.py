# SPDX-License-Identifier: GPL-3.0-or-later
"""Modbus devices that are in no file, asked by hand: docs/toolbox.md. Needs Python alone.

From below; a file knows those above it in this list:

made          formats, orders and numbers of registers, from the rules of the configuration
errors        what can go wrong on a line, a class each
frames        requests and answers, without what a link puts around them
registers     an object's place, as manuals print it
values        between registers and numbers
serial_port   a port of this machine for us alone
links         RTU and TCP: a request out, its answer in
arguments     what all of the commands take
read, write, poll, scan
"""
