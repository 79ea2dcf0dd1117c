# SPDX-License-Identifier: GPL-3.0-or-later
"""nuc980-pins: from the pin table to a checked device tree. This package owns the meaning of a pin."""
