# SPDX-License-Identifier: GPL-3.0-or-later
"""A pytest plug-in: boards in tests. `pytest -p nuc980.netboot.fixture --nuc980-port /dev/ttyUSB0 …`"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from nuc980.netboot.errors import NetbootError
from nuc980.netboot.target import Linux, Target, UBoot

OPTIONS = {
    "port": "the board's serial port or its URL; without it, tests that need a board are skipped",
    "board-ip": "the board's ADDRESS/PREFIX",
    "server-ip": "this host's address, as the board sees it",
    "tftp-port": "UDP port of the server",
    "ethact": "U-Boot's name of the Ethernet port",
    "listen": "behind a NAT: where the server listens",
    "seen-as": "behind a NAT: the board, as the server sees it",
    "baud": "bit/s",
    "power-cycle": "a command that switches the board off and on",
    "prompt": "U-Boot's prompt, a regular expression",
    "autoboot": "the line that says how autoboot is stopped, a regular expression",
    "interrupt": "what stops autoboot",
    "password-prompt": "what U-Boot asks with for its password, a regular expression",
    "password-file": "a file with U-Boot's password, or with a secret that stops autoboot",
    "log": "a file for every byte of the line",
    "site": "the folder of the board's own files",
}
TYPES = {"tftp-port": int, "baud": int, "log": Path}


def _field(option: str) -> str:
    """The field of Target that an option sets."""
    return option.replace("-", "_")


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("nuc980", "a NUC980 board on a bench")
    for name, meaning in OPTIONS.items():
        default = getattr(Target, _field(name), None)
        group.addoption(f"--nuc980-{name}", type=TYPES.get(name, str), default=default, help=meaning)


@pytest.fixture(scope="session")
def nuc980_target(request: pytest.FixtureRequest) -> Target:
    """How the board is reached, by the command line's options."""
    found = {_field(name): request.config.getoption(f"--nuc980-{name}") for name in OPTIONS}
    if not found["port"]:
        pytest.skip("needs a board: --nuc980-port")
    return Target(**found)


@pytest.fixture
def nuc980_uboot(nuc980_target: Target) -> Iterator[UBoot]:
    """The board at U-Boot's prompt. From a Linux that a test left, only --nuc980-power-cycle leads back."""
    try:
        with nuc980_target.uboot() as uboot:
            yield uboot
    except NetbootError as error:
        pytest.fail(str(error), pytrace=False)


@pytest.fixture
def nuc980_boot(nuc980_uboot: UBoot) -> Callable[..., Linux]:
    """Boots kernel and device tree: (uimage, dtb, bootargs=None, goal=Goal())."""
    return nuc980_uboot.boot
