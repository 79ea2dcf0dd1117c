# SPDX-License-Identifier: GPL-3.0-or-later
"""The board's image: what Buildroot is told, checked; what Buildroot made, judged."""
