# SPDX-License-Identifier: GPL-3.0-or-later
"""An outstation below the gateway, in the configuration."""

from typing import Any

CA, THERE = 501, 47  # here, and at the outstation
QUICK = {"retry_ms": 50, "retry_max_ms": 200, "t1": 3, "t2": 1, "t3": 4, "confirmation_ms": 30000}
NAMES = ["breaker", "position", "tap", "bits", "share", "level", "power", "energy"]
TYPES = ["single", "double", "step", "bitstring", "normalized", "scaled", "float", "counter"]


def points() -> list[dict[str, Any]]:
    """One of each type: IOA 101… here, 1… there; commands at 11… there."""
    made: list[dict[str, Any]] = []
    for number, (name, kind) in enumerate(zip(NAMES, TYPES, strict=True), start=1):
        point = {"name": name, "type": kind, "ioa": 100 + number, "remote_ioa": number}
        if kind != "counter":
            point |= {"command": True, "command_ioa": 10 + number, "select": name == "position"}
        made.append(point)
    made[0] |= {"short_pulse_ms": 500, "long_pulse_ms": 3000}
    return made


def outstation(port: int, **keys: Any) -> dict[str, Any]:
    sets = [{"ca": CA, "remote_ca": THERE, "points": points()}]
    return {"name": "town", "addresses": ["127.0.0.1"], "port": port, "sets": sets, **QUICK, **keys}
