# SPDX-License-Identifier: GPL-3.0-or-later
"""Rights that a test needs and its user may lack. The summary counts in a line what was left out for that."""

import os
import re
import subprocess
from collections import Counter
from functools import cache

import pytest

SUPERUSER, NETWORK = "root", "a network of its own"
LACKED = re.compile(r"(?:Skipped: )?needs ([\w ]+): ")


@cache
def may_have_network() -> bool:
    """Whether this user gets a name space: in a chroot and in some containers only root does."""
    command = ["unshare", *([] if os.geteuid() == 0 else ["--map-root-user"]), "--net", "true"]
    return subprocess.run(command, capture_output=True, check=False).returncode == 0


def lacks(right: str) -> bool:
    return os.geteuid() != 0 if right == SUPERUSER else not may_have_network()


def needed(right: str, why: str) -> pytest.MarkDecorator:
    """The mark of a test, or of all tests of a file."""
    return pytest.mark.skipif(lacks(right), reason=f"needs {right}: {why}")


def need(right: str, why: str) -> None:
    """The same within a test or a fixture."""
    if lacks(right):
        pytest.skip(f"needs {right}: {why}")


class Rights:
    """The plugin that counts them (conftest.py registers it)."""

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        skipped = terminalreporter.stats.get("skipped", [])
        found = Counter(match[1] for report in skipped if (match := LACKED.match(report.longrepr[2])))
        if found:
            listed = ", ".join(f"{count} {right}" for right, count in found.most_common())
            terminalreporter.write_line(f"left out, since this user lacks the right: {listed}")
