# SPDX-License-Identifier: GPL-3.0-or-later
"""A gateway that a manager of SNMPv3 watches and commands: the tools of Net-SNMP, and its snmptrapd."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lab.gateway import Gateway, free_port, listening_on
from lab.linesim import LineSim
from lab.manager import CENTRE, USERS, Manager, Receiver, free_udp_port, make_keys, receiver

BREAKER = "1010.1"  # with selection
ON = 3  # of a double point
SELECT, ACCEPTED, EXECUTE, EXECUTING, EXECUTED = 2, 3, 7, 8, 10
NAMES = {ACCEPTED: "acceptedSelection", EXECUTING: "executing", EXECUTED: "executedCommand"}


@dataclass
class Managed:
    """Who asks, and who is told."""

    gateway: Gateway
    manager: Manager
    received: Receiver

    def told(self, state: int) -> str:
        """The inform of this state, in words. Waits for it."""
        count = 1 + (ACCEPTED, EXECUTING, EXECUTED).index(state)
        inform = self.received.wait_for("rtuCommandChanged", count)[count - 1]
        assert inform.value("rtuCommandState") == state, inform
        return f"inform {inform.numbers[0]}: {NAMES[state]}"


def configuration(config: dict[str, Any], folder: Path) -> dict[str, Any]:
    """The same with SNMP, on ports that are free now."""
    sink = {"name": "nms", "address": "127.0.0.1", "port": free_udp_port(), "user": CENTRE.name}
    return listening_on(config, free_port()) | {
        "snmp": {
            "address": "127.0.0.1",
            "port": free_udp_port(),
            "users": [{"name": user.name, "role": role} for user, role in USERS.items()],
            "sinks": [sink],
            "keys": str(folder / "keys"),
            "state": str(folder / "state"),
        }
    }


@contextlib.contextmanager
def managed(folder: Path, config: dict[str, Any], values: Path) -> Iterator[Managed]:
    """A gateway of its own on lines of its own, in a new folder."""
    folder.mkdir()
    config = configuration(config, folder)
    snmp = config["snmp"]
    make_keys(config, folder)
    lines = folder / "linesim.json"
    lines.write_text(json.dumps(config))
    with contextlib.ExitStack() as stack:
        received = stack.enter_context(receiver(snmp["sinks"][0]["port"], folder / "receiver"))
        stack.enter_context(LineSim(lines, values, folder / "dev"))
        gateway = stack.enter_context(Gateway(config, folder))
        yield Managed(gateway, Manager(snmp["port"], folder, timeout_s=30), received)
