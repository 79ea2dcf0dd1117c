# SPDX-License-Identifier: GPL-3.0-or-later
"""Tools for boards with a Nuvoton NUC980."""
