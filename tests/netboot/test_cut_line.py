# SPDX-License-Identifier: GPL-3.0-or-later
"""bootm's last words, cut off where the UART loses its pins: on the double, and on the emulated board."""

from __future__ import annotations

import pytest

from netboot.double import Double
from netboot.images import uimage
from netboot.scenario import hurry
from nuc980.netboot.boot import Addresses, StartKernel, WatchLinux
from nuc980.netboot.console import Console
from nuc980.netboot.errors import BootmFailed, KernelPanic
from nuc980.netboot.linux import Goal
from nuc980.netboot.progress import Progress
from nuc980.netboot.session import Session
from nuc980.netboot.transport import Line

pytestmark = pytest.mark.slow

LAST_WORDS = len("\n\rStarting kernel ...\n\r\n\r")
TREE = bytes.fromhex("d00dfeed00000028")
GOAL = Goal(seconds=60.0, bootm_seconds=60.0)


def started(board: Double) -> None:
    """What `boot` does once kernel and device tree are in the RAM."""
    addresses = Addresses()
    with Line(board.port) as line:
        console = Console(line)
        console.reach()
        session = Session(console, Progress())
        StartKernel(addresses, GOAL).run(session)
        WatchLinux(GOAL).run(session)


@pytest.mark.sample(6)
@pytest.mark.parametrize("cuts", range(LAST_WORDS + 1))
def test_double_that_cuts(cuts: int, monkeypatch: pytest.MonkeyPatch) -> None:
    hurry(monkeypatch, 5.0)
    for ending in ("login", "panic first"):
        with Double(state="prompt", cuts=cuts, linux=ending) as double:
            kernel = uimage(b"a kernel")
            double.ram[0x7FC0 : 0x7FC0 + len(kernel)] = kernel
            double.ram[0xA00000 : 0xA00000 + len(TREE)] = TREE
            if ending == "login":
                started(double)
            else:
                with pytest.raises(KernelPanic, match="Attempted to kill init"):
                    started(double)
            assert double.kernels_started == 1


@pytest.mark.parametrize(
    ("kernel", "tree", "words"),
    [
        (b"", TREE, "no uImage at the address"),
        (uimage(b"a kernel")[:-1] + b"?", TREE, "changed since it was checked"),
        (uimage(b"a kernel"), b"", "no device tree at the address"),
        (uimage(b"a kernel", processor=3), TREE, "another processor"),
    ],
)
def test_bootm_that_fails_is_still_named(
    kernel: bytes, tree: bytes, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    hurry(monkeypatch, 5.0)
    with Double(state="prompt") as double:
        double.ram[0x7FC0 : 0x7FC0 + len(kernel)] = kernel
        double.ram[0xA00000 : 0xA00000 + len(tree)] = tree
        with pytest.raises(BootmFailed, match=words):
            started(double)
        assert double.kernels_started == 0
