# SPDX-License-Identifier: GPL-3.0-or-later
"""What to type when a Python package is missing."""

import sys
import sysconfig
from pathlib import Path

CLONE = Path(__file__).resolve().parents[2]
STANDARD = Path(sysconfig.get_path("stdlib"))
# Where Debian's package is not called python3- and the module.
DEBIAN = {"paho": "python3-paho-mqtt"}


def in_clone() -> bool:
    """Whether this runs in the tree, and not as pip has installed it."""
    return (CLONE / "pyproject.toml").is_file()


def of_debian() -> bool:
    """Whether this Python takes nothing from pip (PEP 668)."""
    return sys.prefix == sys.base_prefix and (STANDARD / "EXTERNALLY-MANAGED").is_file()


def what_to_type(error: ModuleNotFoundError, extra: str) -> str:
    """One line. Raises the error again where no extra brings the module: that is a fault of ours."""
    if not error.name or not extra:
        raise error
    package = error.name.partition(".")[0]
    if package == "openrtu":  # for modules; it goes with the gateway's library
        command = "apt install python3-openrtu, or install its wheel (docs/writing-a-module.md)"
    elif in_clone():
        command = f"make -C {CLONE} tools"
    elif of_debian() and extra == "oidc":
        command = "pipx install 'openrtu-tools[centre,oidc]' (Debian's Authlib is too old)"
    elif of_debian():
        command = f"apt install {DEBIAN.get(package, f'python3-{package}')}"
    else:
        command = f"{sys.executable} -m pip install 'openrtu-tools[{extra}]'"
    return f"the Python package {package} is missing; type: {command}"
