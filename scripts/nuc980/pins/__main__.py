# SPDX-License-Identifier: GPL-3.0-or-later
"""nuc980-pins, started by scripts/nuc980-pins or as pip installs it."""

import signal
import sys

from nuc980.pins.cli import main


def program() -> int:
    """Ends quietly when `| head` has seen enough."""
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)
    return main()


if __name__ == "__main__":
    sys.exit(program())
