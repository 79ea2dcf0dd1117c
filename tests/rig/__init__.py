# SPDX-License-Identifier: GPL-3.0-or-later
"""What tests of several rooms work on: gateways, stations, recorders, roots of others."""
