# SPDX-License-Identifier: GPL-3.0-or-later
"""Modbus devices of other makes: servers of pymodbus and libmodbus, each on a line or TCP port of its own."""
