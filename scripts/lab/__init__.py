# SPDX-License-Identifier: GPL-3.0-or-later
"""The gateway on a desk: simulated lines, rtud and a controlling station, for `make run` and the tests."""
