# SPDX-License-Identifier: GPL-3.0-or-later
"""openrtu, started by scripts/openrtu."""

import sys

from openrtu_tools.cli import main

sys.exit(main())
