# SPDX-License-Identifier: GPL-3.0-or-later
"""The Debian packages that tests install: built once for a run of pytest, for all workers."""

import fcntl
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "build/tested-debs"
RUN = os.environ.get("PYTEST_XDIST_TESTRUNUID") or f"pid {os.getpid()}"
QUICK = {  # Debian's hardening needs -O1
    "DEB_CFLAGS_APPEND": "-O1 -g0",
    "DEB_BUILD_OPTIONS": "noautodbgsym",
}


@contextmanager
def alone(name: str) -> Iterator[None]:
    """One process at a time works on what is below build/ for all."""
    with (ROOT / "build" / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def built(folder: Path) -> Path:
    with alone("wheels"):  # which tests of pip make anew
        build(folder)
    return folder


def build(folder: Path) -> None:
    done = subprocess.run(
        ["scripts/build-deb.sh", folder],
        cwd=ROOT,
        env=os.environ | QUICK,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout


def packages() -> Path:
    """Their folder."""
    made = FOLDER / "run"
    with alone("tested-debs"):
        if not made.exists() or made.read_text() != RUN:
            built(FOLDER)
            made.write_text(RUN)
    return FOLDER


def file_of(folder: Path, name: str) -> Path:
    (file,) = folder.glob(f"{name}_*.deb")
    return file


def wheels_with_needs(folder: Path) -> None:
    """The wheel of the tools that are in them, and those that it needs: for a machine without network."""
    pip = [sys.executable, "-m", "pip", "wheel", "--quiet", "--disable-pip-version-check"]
    with alone("wheels"):
        (wheel,) = (ROOT / "build/wheels").glob("openrtu_tools-*.whl")
        done = subprocess.run(
            [*pip, "--wheel-dir", folder, wheel], capture_output=True, text=True, check=False
        )
    assert done.returncode == 0, done.stdout + done.stderr
