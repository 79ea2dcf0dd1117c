# SPDX-License-Identifier: GPL-3.0-or-later
import signal
import sys

from nuc980.pins.cli import main

signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # ends quietly when `| head` has seen enough
sys.exit(main())
