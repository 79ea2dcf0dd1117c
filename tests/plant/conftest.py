# SPDX-License-Identifier: GPL-3.0-or-later
"""Where worlds of the plant run."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from lab.gateway import remove, run_directory


@pytest.fixture(scope="module")
def folder() -> Iterator[Path]:
    directory = run_directory()
    yield directory
    remove(directory)
