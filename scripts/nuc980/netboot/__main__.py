# SPDX-License-Identifier: GPL-3.0-or-later
"""nuc980-netboot, started by scripts/nuc980-netboot."""

import sys

from nuc980.netboot.cli import main

sys.exit(main())
