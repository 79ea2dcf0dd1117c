# SPDX-License-Identifier: GPL-3.0-or-later
"""Modbus devices of other makes: servers of pymodbus and libmodbus, each on a serial line of its own."""
