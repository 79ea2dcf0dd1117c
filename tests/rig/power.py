# SPDX-License-Identifier: GPL-3.0-or-later
"""A power cut: all processes killed at once, the map gone, the files as they were synchronised."""

import contextlib
import os
import shutil
import signal
from typing import Any

from lab.gateway import Gateway
from rig.substation import SOON_S


def state(gateway: Gateway) -> dict[str, Any]:
    found: dict[str, Any] = gateway.modules()["rtu-journal"]["journal"]
    return found


def wait_journal(gateway: Gateway, events: int) -> None:
    """Until the file holds so many events that somebody has not acknowledged."""
    gateway.wait_for(
        lambda: state(gateway)["events"] == events,
        SOON_S,
        f"{events} events are in the journal: {state(gateway)}",
    )


def cut_power(gateway: Gateway) -> None:
    """Every process at once; the memory with them."""
    pids = [module["pid"] for module in gateway.modules().values() if module["pid"]]
    assert gateway.process is not None and gateway.process.pid in pids
    for pid in pids:
        with contextlib.suppress(ProcessLookupError):  # it died with rtud, and was reaped
            os.kill(pid, signal.SIGKILL)
    gateway.process.wait(SOON_S)
    shutil.rmtree(gateway.map)
