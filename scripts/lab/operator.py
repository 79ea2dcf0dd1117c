# SPDX-License-Identifier: GPL-3.0-or-later
"""
libiec61850's client commands: port, data object, value, then what to do: browse, report, select, operate,
cancel.
Prints the control model, what became of each, the termination and what was reported, as JSON.
"""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pyiec61850 import pyiec61850 as lib

from lab.errors import LabError
from lab.libiec61850 import check, close, connected, texts_of
from lab.patience import Deadline, slowness

ANSWER_S = 10.0
WHOLE_S = 120.0


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


class Reports:
    """What changes under ST of a device, by a process of its own.

    A call of libiec61850 holds Python's lock until its answer is there: a report that comes before that waits
    for the lock, and the answer waits behind the report.
    """

    def __init__(self, port: str, device: str) -> None:
        command = [sys.executable, "-m", "lab.reports", port, device]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        if self._line() != "ready":
            sys.exit("no report is to be had")

    def _line(self) -> str:
        assert self.process.stdout
        return self.process.stdout.readline().strip()

    def changed(self) -> list[str]:
        """Members of the data set, once there is one."""
        found: list[str] = json.loads(self._line() or "[]")
        assert self.process.stdin
        self.process.stdin.close()
        self.process.wait()
        return found


def browsed(connection: Any) -> dict[str, int]:
    """The logical devices, and how many logical nodes each has."""
    listed, error = lib.IedConnection_getLogicalDeviceList(connection)
    check(error, "logical devices")
    found = {}
    for device in texts_of(listed):
        nodes, error = lib.IedConnection_getLogicalDeviceDirectory(connection, device)
        check(error, device)
        found[device] = len(texts_of(nodes))
    return found


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
    patience_s = WHOLE_S * slowness()
    run = subprocess.run(command, env=paths, capture_output=True, text=True, timeout=patience_s, check=False)
    if run.returncode != 0:
        raise OperatorError(f"libiec61850's client: {run.stderr.strip() or run.stdout.strip()}")
    outcomes: dict[str, Any] = json.loads(run.stdout)
    return outcomes


def wait(condition: Callable[[], bool]) -> None:
    """Until it is so, or has not become so in time: what was seen tells."""
    deadline = Deadline(ANSWER_S)
    while not condition() and not deadline.over:
        time.sleep(0.01)


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
    outcomes: dict[str, Any] = {"model": model}
    reports = None
    for action in actions:
        if action == "browse":
            outcomes[action] = browsed(connection)
        elif action == "report":
            reports = Reports(port, reference.partition("/")[0])
        else:
            outcomes[action] = outcome(control, act(control, action, value))
    if outcomes.get("operate", {}).get("done"):
        if model in (lib.CONTROL_MODEL_DIRECT_ENHANCED, lib.CONTROL_MODEL_SBO_ENHANCED):
            wait(lambda: bool(handler.seen))
        if reports:
            outcomes["report"] = reports.changed()
    print(json.dumps(outcomes | {"terminations": handler.seen}), flush=True)
    close(connection)


if __name__ == "__main__":
    main()
