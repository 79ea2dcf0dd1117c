# SPDX-License-Identifier: GPL-3.0-or-later
"""Modules of others for a gateway: scripts and C programs with the library that they need beside them."""

from __future__ import annotations

import shlex
import shutil
import subprocess
import sys
from pathlib import Path

from lab.errors import LabError
from lab.gateway import REPOSITORY

EXAMPLES = REPOSITORY / "docs/examples/modules"
PACKAGE = REPOSITORY / "package/openrtu/python"
HEADER = REPOSITORY / "package/openrtu/src/lib/openrtu.h"
# A module's user need not be able to walk to the interpreter that runs this.
PYTHON = "/usr/bin/python3" if Path("/usr/bin/python3").exists() else sys.executable


def library(build: Path) -> Path:
    return (build / "lib/libopenrtu.so.0").resolve()


def program(directory: Path, name: str, script: Path) -> str:
    """A script with the library and the package that it needs, where a module's user can reach them."""
    path = directory / name
    shutil.copy(script, directory / f"{name}.py")
    words = [PYTHON, f"{directory}/{name}.py"]
    path.write_text(
        "#!/bin/sh\n"
        f"export OPENRTU_LIBRARY={directory}/libopenrtu.so.0 PYTHONPATH={directory}\n"
        "export PYTHONDONTWRITEBYTECODE=1\n"
        f'exec {shlex.join(words)} "$@"\n'
    )
    path.chmod(0o755)
    return str(path)


def compiled(directory: Path, name: str, source: Path) -> str:
    path = directory / name
    flags = ["-O2", "-Wall", "-Wextra", "-Werror", f"-I{HEADER.parent}", f"-Wl,-rpath,{directory}"]
    command = ["cc", *flags, "-o", path, source, directory / "libopenrtu.so.0"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise LabError(f"{source} cannot be compiled: {done.stderr.strip()}")
    return str(path)


def place(directory: Path, build: Path) -> None:
    """What every module needs, beside it."""
    shutil.copy(library(build), directory / "libopenrtu.so.0")
    shutil.copytree(PACKAGE / "openrtu", directory / "openrtu", ignore=shutil.ignore_patterns("__pycache__"))
