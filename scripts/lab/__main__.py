# SPDX-License-Identifier: GPL-3.0-or-later
"""python -m lab: the show of `make run`."""

import sys

from lab.show import main

sys.exit(main())
