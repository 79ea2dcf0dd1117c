# SPDX-License-Identifier: GPL-3.0-or-later
"""A number that C, Python, JavaScript and the MIB share is a row of one table: scripts/codes.py."""

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "centre" / "page" / "js"
# A bare number where a name is to be had.
BARE = re.compile(r"\.(link|state|result|content|cause|quality|reason)\s*(===|!==|&)\s*\d")


def test_what_is_made_is_as_c_has_it() -> None:
    """In a process of its own: Python 3.11's parser fails if a finaliser formats a traceback meanwhile."""
    command = [sys.executable, ROOT / "scripts" / "codes.py", "--check", ROOT]
    old = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (old.returncode, old.stdout, old.stderr) == (0, "", ""), "type `make codes`"


def test_the_page_says_names() -> None:
    found = [
        f"{script.name}: {line.strip()}"
        for script in sorted(PAGE.glob("*.js"))
        for line in script.read_text(encoding="utf-8").splitlines()
        if BARE.search(line)
    ]
    assert not found
