# SPDX-License-Identifier: GPL-3.0-or-later
import sys

from openrtu_tools.logic.cli import main

sys.exit(main())
