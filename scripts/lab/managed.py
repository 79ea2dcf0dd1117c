# SPDX-License-Identifier: GPL-3.0-or-later
"""The management system of the shows: Net-SNMP's commands as a manager, and its receiver of informs."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lab.manager import (
    CENTRE,
    USERS,
    Manager,
    Receiver,
    free_udp_port,
    make_keys,
    receiver,
)

BREAKER = "1010.1"  # with selection
ON = 3  # of a double point
INACTIVE, SELECT, ACCEPTED, EXECUTE, EXECUTING, EXECUTED = 1, 2, 3, 7, 8, 10
NAMES = {ACCEPTED: "acceptedSelection", EXECUTING: "executing", EXECUTED: "executedCommand"}


@dataclass
class Managed:
    """Who asks, and who is told."""

    manager: Manager
    received: Receiver

    def last(self) -> int:
        """The number of the last event."""
        (number,) = self.manager.get("rtuEventLast.0")
        assert isinstance(number, int)
        return number

    def told(self, state: int, after: int) -> str:
        """The inform of this state of the breaker's command behind that event, in words. Waits for it."""
        wanted = {
            f"rtuCommandState.{BREAKER}": state,
            f"rtuCommandOwner.{BREAKER}": self.manager.user.name.encode(),  # what others did is told late
        }
        inform = self.received.wait_until(
            "rtuCommandChanged",
            lambda each: wanted.items() <= each.objects.items() and each.numbers[0] > after,
        )
        return f"inform {inform.numbers[0]}: {NAMES[state]}"


def settings(sink_address: str, **more: Any) -> dict[str, Any]:
    """The object `snmp`: the users of the shows, and a sink at a port of this machine that is free now."""
    sink = {"name": "nms", "address": sink_address, "port": free_udp_port(), "user": CENTRE.name}
    users = [{"name": user.name, "role": role} for user, role in USERS.items()]
    return {"users": users, "sinks": [sink], **more}


def keys_of(folder: Path) -> Path:
    """Where `managed` has made those of the agent."""
    return folder / "keys"


@contextlib.contextmanager
def managed(folder: Path, snmp: dict[str, Any], port: int) -> Iterator[Managed]:
    """The manager of an agent with these settings, reached at this port; a new folder gets its keys."""
    folder.mkdir()
    make_keys({"snmp": snmp}, folder)
    with receiver(snmp["sinks"][0]["port"], folder / "receiver") as received:
        yield Managed(Manager(port, folder, timeout_s=60), received)
