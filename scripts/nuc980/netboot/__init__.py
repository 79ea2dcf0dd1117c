# SPDX-License-Identifier: GPL-3.0-or-later
"""Boot and flash a NUC980 board over its debug UART and Ethernet."""
