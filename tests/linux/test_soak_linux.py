# SPDX-License-Identifier: GPL-3.0-or-later
"""Linux started again and again: each start's time, and each anomaly with its console, is kept.

OPENRTU_BOOTS and OPENRTU_NETBOOTS are how often, if not 500 and 200 times. What is kept is in build/soak.
"""

import io
import os
import statistics
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import pytest

from lab.board import ETHERNET, netboot
from nuc980.netboot.errors import NetbootError
from nuc980.netboot.progress import Progress
from nuc980.twin.linux import TROUBLE, Kernel, Linux, LinuxError
from nuc980.twin.machine import Machine, MachineError

ROOT = Path(__file__).resolve().parents[2]
KEPT = ROOT / "build/soak"
SYSTEM = ROOT / "build/system"

pytestmark = pytest.mark.soak


def again_and_again(name: str, times: int, start: Callable[[int], str]) -> None:
    """Starts so many times; start returns what the console said."""
    KEPT.mkdir(parents=True, exist_ok=True)
    seconds, anomalies = [], []
    with (KEPT / f"{name}.log").open("w") as log:
        for at in range(times):
            begin = time.monotonic()
            try:
                console = start(at)
                wrong = TROUBLE.findall(console)
            except (LinuxError, MachineError, NetbootError) as error:
                console, wrong = str(error), [type(error).__name__]
            seconds.append(time.monotonic() - begin)
            log.write(f"{at}: {seconds[-1]:.2f} s {'; '.join(wrong)}\n")
            log.flush()
            if wrong:
                (KEPT / f"{name}-{at}.console").write_text(console)
                anomalies.append(f"{at}: {'; '.join(wrong)}")
        log.write(
            f"{times} starts, {min(seconds):.2f} to {max(seconds):.2f} s, median"
            f" {statistics.median(seconds):.2f} s, {len(anomalies)} anomalies\n"
        )
    assert not anomalies, f"{KEPT}/{name}-*.console: " + "\n".join(anomalies)


def test_kernel_boots(qemu: Path, kernel: Kernel) -> None:
    def start(at: int) -> str:
        with Linux.boot(qemu, kernel) as linux:
            linux.run("test -c /dev/ttyS8 && test -d /sys/class/net/eth1")
            return linux.log

    again_and_again("boots", int(os.environ.get("OPENRTU_BOOTS", "500")), start)


def test_netboots(qemu: Path, uboot: Path, tmp_path: Path) -> None:
    """Each from reset, through U-Boot and TFTP, to the log-in."""

    def start(at: int) -> str:
        folder = tmp_path / str(at)
        folder.mkdir()
        console = folder / "console.log"
        nics = [word for network in ETHERNET for word in network.arguments({})]
        chardevs = {0: f"pty,logfile={console}"}
        with ExitStack() as stack:
            machine = stack.enter_context(Machine(qemu, "-bios", uboot, *nics, uarts=(), chardevs=chardevs))
            output = io.StringIO()
            netboot(machine, folder, SYSTEM / "uImage", SYSTEM / "nuc980-gateway.dtb", Progress(output))
            return console.read_text(errors="replace")

    again_and_again("netboots", int(os.environ.get("OPENRTU_NETBOOTS", "200")), start)
