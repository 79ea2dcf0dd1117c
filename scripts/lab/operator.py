# SPDX-License-Identifier: GPL-3.0-or-later
"""
libiec61850's client commands: port, data object, value, then what to do: select, operate, cancel.
Prints the control model, what became of each, and the termination, as JSON.
"""

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from pyiec61850 import pyiec61850 as lib

from lab.errors import LabError
from lab.libiec61850 import connected

TERMINATION_S = 10


class OperatorError(LabError):
    """The client has not come so far as to ask."""


class Termination(lib.CommandTermHandler):  # type: ignore[misc]
    """Takes CommandTermination, in a thread of libiec61850's."""

    def __init__(self) -> None:
        super().__init__()
        self.seen: list[dict[str, int]] = []
        self.control: Any = None

    def trigger(self) -> None:
        last = lib.ControlObjectClient_getLastApplError(self.control)
        self.seen.append({"error": last.error, "cause": last.addCause})


def value_of(text: str, kind: int) -> Any:
    if kind == lib.MMS_BOOLEAN:
        return lib.MmsValue_newBoolean(text == "true")
    if kind == lib.MMS_INTEGER:
        return lib.MmsValue_newIntegerFromInt32(int(text))
    structure = lib.MmsValue_createEmptyStructure(1)
    lib.MmsValue_setElement(structure, 0, lib.MmsValue_newFloat(float(text)))
    return structure


def outcome(control: Any, done: bool) -> dict[str, Any]:
    last = lib.ControlObjectClient_getLastApplError(control)
    return {"done": bool(done), "error": last.error, "cause": last.addCause}


def act(control: Any, action: str, value: Any) -> bool:
    if action == "operate":
        return bool(lib.ControlObjectClient_operate(control, value, 0))
    if action == "cancel":
        return bool(lib.ControlObjectClient_cancel(control))
    if lib.ControlObjectClient_getControlModel(control) == lib.CONTROL_MODEL_SBO_ENHANCED:
        return bool(lib.ControlObjectClient_selectWithValue(control, value))
    return bool(lib.ControlObjectClient_select(control))


def operate(port: int, reference: str, value: str, *actions: str) -> dict[str, Any]:
    """What a process of this file prints."""
    command = [sys.executable, "-m", "lab.operator", str(port), reference, value, *actions]
    paths = os.environ | {"PYTHONPATH": str(Path(__file__).resolve().parents[1])}
    run = subprocess.run(command, env=paths, capture_output=True, text=True, timeout=120, check=False)
    if run.returncode != 0:
        raise OperatorError(f"libiec61850's client: {run.stderr.strip() or run.stdout.strip()}")
    said: dict[str, Any] = json.loads(run.stdout)
    return said


def main() -> None:
    port, reference, text, *actions = sys.argv[1:]
    connection = connected(int(port))
    control = lib.ControlObjectClient_create(reference, connection)
    lib.ControlObjectClient_setOrigin(control, "tests", 2)
    model = lib.ControlObjectClient_getControlModel(control)
    handler, subscriber = Termination(), lib.CommandTermSubscriber()
    handler.control = control
    subscriber.setLibiec61850ControlObjectClient(control)
    subscriber.setEventHandler(handler.__disown__())
    subscriber.subscribe()
    value = value_of(text, lib.ControlObjectClient_getCtlValType(control))
    said: dict[str, Any] = {"model": model}
    for action in actions:
        said[action] = outcome(control, act(control, action, value))
    deadline = time.monotonic() + TERMINATION_S
    while (
        model in (lib.CONTROL_MODEL_DIRECT_ENHANCED, lib.CONTROL_MODEL_SBO_ENHANCED)
        and said.get("operate", {}).get("done")
        and not handler.seen
        and time.monotonic() < deadline
    ):
        time.sleep(0.01)
    print(json.dumps(said | {"terminations": handler.seen}), flush=True)
    lib.IedConnection_close(connection)


if __name__ == "__main__":
    main()
